"""Compiled: the cost of an edge: the cost of a metre, integrated along it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Floats
from cspace.compiling import bind_kernel, dispatch_on_type, kernel
from cspace.map.clearance import clearance_at
from cspace.map.edges import between
from cspace.map.mip import OccupancyBits, PlaneMarks, SpaceMarks
from cspace.map.points import Numbers, replaced
from cspace.map.storage import Map
from cspace.space import CSpace
from cspace.spectral.overlap import field_at

Field = OccupancyBits | Floats | None
"""What has a value at each configuration: the clearance, by the marks of a map; an array of cells; or nothing."""

LONGEST_TURN: Final = math.radians(5.0)
"""Largest turn, in radians, of a step."""


class CostDensity(NamedTuple):
    """What a metre costs where a field has a value: ``1 + weight * max(0, offset + slope * value)**2``.

    A radian of turn counts as ``turn_weight`` metres. ``by_metre`` asks for the mean cost of a metre, not for that of
    all.
    """

    offset: float
    slope: float
    weight: float
    turn_weight: float
    by_metre: bool = False


def value_at(field: Field, map_: Map, q: Numbers) -> float:
    """The value of a field at a configuration; compiled code takes one of those below, by the kind of field."""
    raise NotImplementedError


def _no_value(field: None, map_: Map, q: Numbers) -> float:
    return 0.0


def _clearance(field: OccupancyBits, map_: Map, q: Numbers) -> float:
    return clearance_at(map_, field, q, math.inf) * map_.spacing


def _overlap(field: Floats, map_: Map, q: Numbers) -> float:
    return field_at(map_, field, q)


dispatch_on_type(value_at, {object: _no_value, PlaneMarks: _clearance, SpaceMarks: _clearance, np.ndarray: _overlap})


@kernel
def cost_at(map_: Map, field: Field, law: CostDensity, q: Numbers) -> float:
    """Cost of a metre at a configuration."""
    penalty = max(0.0, law.offset + law.slope * value_at(field, map_, q))
    return 1.0 + law.weight * penalty * penalty


@kernel
def cost_of_one(map_: Map, field: Field, law: CostDensity, both: Numbers) -> float:
    """Cost of a straight edge between two configurations, given one after the other in ``both``.

    The integral takes the middles of steps of at most one cell and 5 degrees.
    """
    q0 = map_.lower + map_.rotations.zeros()
    q1, size, dim, square = q0, len(q0), len(map_.lower), 0.0
    for axis in range(size):
        q0, q1 = replaced(q0, axis, both[axis]), replaced(q1, axis, both[size + axis])
    for axis in range(dim):
        square += (q1[axis] - q0[axis]) ** 2
    metres, angle = math.sqrt(square), map_.rotations.turn_of(q0, q1, 0)[0]
    steps, total = max(1, math.ceil(max(metres / map_.spacing, angle / LONGEST_TURN))), 0.0
    for k in range(steps):
        t = (k + 0.5) / steps
        q = map_.rotations.turned(q0, q1, 0, t)
        for axis in range(dim):
            q = replaced(q, axis, between(q0[axis], q1[axis], t))
        total += cost_at(map_, field, law, q)
    return (1.0 if law.by_metre else metres + law.turn_weight * angle) * total / steps


def edge_cost(space: CSpace, field: Field, law: CostDensity) -> Callable[..., float]:
    """``cost(*q0, *q1)`` of straight edges of a map."""
    fixed = (space._kernel_map, field, law)
    query = bind_kernel(cost_of_one, (*fixed, (0.0,) * (2 * space.size)), 0).func  # type: ignore[attr-defined]
    return lambda *endpoints: query(*fixed, endpoints)

"""Compiled: the cost of an edge: the cost of a metre, integrated along it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from numba import types
from numba.extending import overload

from cspace.arrays import Floats
from cspace.compiling import entry, jit
from cspace.map.clearance import clearance_at
from cspace.map.edges import between
from cspace.map.mip import Marks
from cspace.map.points import Numbers, replaced
from cspace.map.record import Map
from cspace.space import CSpace
from cspace.spectral.field import field_at

Field = Marks | Floats | None
"""What has a value at each configuration: the clearance, by the marks of a map; an array of cells; or nothing."""

LONGEST_TURN: Final = math.radians(5.0)
"""Largest turn, in radians, of a step."""


class Law(NamedTuple):
    """What a metre costs where a field has a value: ``1 + weight * max(0, offset + slope * value)**2``.

    A radian of turn counts as ``turn_weight`` metres.
    """

    offset: float
    slope: float
    weight: float
    turn_weight: float


def value_at(map_: Map, field: Field, q: Numbers) -> float:
    """The value of a field at a configuration; numba takes the implementation for the field that it is given."""
    raise NotImplementedError


def _no_value(map_: Map, field: Field, q: Numbers) -> float:
    return 0.0


def _clearance(map_: Map, field: Any, q: Numbers) -> float:
    return clearance_at(map_, field, q, math.inf) * map_.spacing


def _overlap(map_: Map, field: Any, q: Numbers) -> float:
    return field_at(map_, field, q)


_VALUES: Final[dict[type, Callable[..., float]]] = {
    types.NoneType: _no_value,
    types.NamedTuple: _clearance,
    types.Array: _overlap,
}
overload(value_at, strict=False)(lambda map_, field, q: _VALUES.get(type(field), _clearance))


@jit
def metre_cost(map_: Map, field: Field, law: Law, q: Numbers) -> float:
    """Cost of a metre at a configuration."""
    penalty = max(0.0, law.offset + law.slope * value_at(map_, field, q))
    return 1.0 + law.weight * penalty * penalty


@jit
def cost_of_one(map_: Map, field: Field, law: Law, both: Numbers) -> float:
    """Cost of a straight edge between two configurations, given one after the other in ``both``.

    The integral takes the middles of steps of at most one cell and 5 degrees.
    """
    q0 = map_.lower + map_.rotations.origin()
    q1, dof, dim, square = q0, len(q0), len(map_.lower), 0.0
    for axis in range(dof):
        q0, q1 = replaced(q0, axis, both[axis]), replaced(q1, axis, both[dof + axis])
    for axis in range(dim):
        square += (q1[axis] - q0[axis]) ** 2
    metres, angle = math.sqrt(square), map_.rotations.turn_of(q0, q1, 0)[0]
    steps, total = math.ceil(max(metres / map_.spacing, angle / LONGEST_TURN)), 0.0
    for k in range(steps):
        t = (k + 0.5) / steps
        q = map_.rotations.turned(q0, q1, 0, t)
        for axis in range(dim):
            q = replaced(q, axis, between(q0[axis], q1[axis], t))
        total += metre_cost(map_, field, law, q)
    return (metres + law.turn_weight * angle) * total / max(steps, 1)


def edge_cost(space: CSpace, field: Field, law: Law) -> Callable[..., float]:
    """``cost(*q0, *q1)`` of straight edges of a map."""
    fixed = (space.record, field, law)
    query = entry(cost_of_one, (*fixed, (0.0,) * (2 * space.dof)), 0).func  # type: ignore[attr-defined]
    return lambda *endpoints: query(*fixed, endpoints)

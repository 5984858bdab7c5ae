"""Kernels that integrate a cost density along straight edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Floats
from cspace.compiling import bind_kernel, dispatch_on_type, kernel
from cspace.map.distance import DistanceMap, DistanceTable, clearance_at
from cspace.map.edges import between
from cspace.map.points import Numbers, replaced
from cspace.map.storage import Map
from cspace.space import CSpace
from cspace.spectral.field import field_at

Field = DistanceMap | Floats | None
"""Source of a value at each configuration: the clearance, by distances; an array of cells; or none (zero)."""

Values = DistanceTable | Floats | None
"""A field as kernels take it."""

MAX_RADIANS_PER_STEP: Final = math.radians(5.0)
"""Largest rotation of an integration step, in radians (5 degrees)."""


class CostDensity(NamedTuple):
    """Cost of a metre, by the value of a field.

    It is ``1 + weight * max(0, offset + slope * value)**2``. A radian of rotation counts as ``rotation_weight`` metres.
    ``by_metre`` selects the mean cost of a metre, instead of the cost of the whole edge.
    """

    offset: float
    slope: float
    weight: float
    rotation_weight: float
    by_metre: bool = False


def value_at(field: Values, map_: Map, q: Numbers) -> float:
    """Return a field's value; compiled code dispatches on its type."""
    raise NotImplementedError


def _no_value(field: None, map_: Map, q: Numbers) -> float:
    return 0.0


def _clearance(field: DistanceTable, map_: Map, q: Numbers) -> float:
    return clearance_at(map_, field, q)


def _overlap(field: Floats, map_: Map, q: Numbers) -> float:
    return field_at(map_, field, q)


dispatch_on_type(value_at, {object: _no_value, DistanceTable: _clearance, np.ndarray: _overlap})


@kernel
def cost_at(map_: Map, field: Values, density: CostDensity, q: Numbers) -> float:
    """Return the cost of a metre at a configuration."""
    penalty = max(0.0, density.offset + density.slope * value_at(field, map_, q))
    return 1.0 + density.weight * penalty * penalty


@kernel
def straight_edge_cost(map_: Map, field: Values, density: CostDensity, both: Numbers) -> float:
    """Integrate the cost along a straight edge between ``both`` configurations.

    The midpoint rule has steps of at most one cell and 5 degrees.
    """
    q0 = map_.lower + map_.rotations.zeros()
    q1, size, dim, square = q0, len(q0), len(map_.lower), 0.0
    for axis in range(size):
        q0, q1 = replaced(q0, axis, both[axis]), replaced(q1, axis, both[size + axis])
    for axis in range(dim):
        square += (q1[axis] - q0[axis]) ** 2
    metres, angle = math.sqrt(square), map_.rotations.arc_angle_and_error(q0, q1, 0)[0]
    steps, total = max(1, math.ceil(max(metres / map_.spacing, angle / MAX_RADIANS_PER_STEP))), 0.0
    for k in range(steps):
        t = (k + 0.5) / steps
        q = map_.rotations.turned(q0, q1, 0, t)
        for axis in range(dim):
            q = replaced(q, axis, between(q0[axis], q1[axis], t))
        total += cost_at(map_, field, density, q)
    return (1.0 if density.by_metre else metres + density.rotation_weight * angle) * total / steps


def make_edge_cost(space: CSpace, field: Field, density: CostDensity) -> Callable[..., float]:
    """Make ``cost(*q0, *q1)``, the cost of straight edges."""
    return bind_cost(straight_edge_cost, space, field, density)


def bind_cost(kernel: Any, space: CSpace, field: Field, *fixed: Any) -> Callable[..., float]:
    """Make ``cost(*q0, *q1)`` from ``kernel(map, values, *fixed, both)``; it follows changes of the map."""

    def values() -> Values:
        return field.whole() if isinstance(field, DistanceMap) else field

    query = bind_kernel(kernel, (space._kernel_map,), values(), *fixed, (0.0,) * (2 * space.size))
    return lambda *both: query(values(), *fixed, both)

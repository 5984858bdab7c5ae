"""Costs on the cells of a map, and kernels that integrate them along straight edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from cspace import CSpace
from cspace.inside import (
    DistanceTable,
    Map,
    Row,
    bind_kernel,
    check_memory,
    clearance_at,
    configuration_along,
    internal,
    kernel,
    map_record,
    measure_edge,
    slice_of,
)
from planners._estimate import Costs

Field: TypeAlias = Literal["clearance"] | Costs | None
"""Source of a value at each configuration: the clearance; values of cells; or none (zero)."""

Numbers = tuple[float, ...]
"""Coordinates of a rotation, or of configurations."""

NO_VALUES = 0
CLEARANCES = 1
OVERLAPS = 2
"""Kinds of :class:`Values`."""

MAX_RADIANS_PER_STEP: Final = math.radians(5.0)
"""Largest rotation of an integration step, in radians (5 degrees)."""

BYTES_PER_CELL: Final = 16
"""Memory of the costs of a cell, bytes, with what makes them."""


class Values(NamedTuple):
    """A field as kernels take it; what its kind does not need is empty."""

    kind: int
    distances: DistanceTable
    overlaps: Costs


class CostDensity(NamedTuple):
    """Cost of a metre, by the value of a field.

    It is ``1 + weight * max(0, offset + slope * value)**2``. A radian of rotation counts as
    ``rotation_weight`` metres. ``mean_per_metre`` selects the mean cost of a metre, instead of the
    cost of the whole edge.
    """

    offset: float
    slope: float
    weight: float
    rotation_weight: float = 0.0
    mean_per_metre: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class CellCost:
    """What a metre costs in the cells of a map, and along edges.

    Attributes
    ----------
    factors : ndarray of float32, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Cost of a metre in each cell, 1 or above.
    field, density
        Cost of a metre at each configuration; the rotation weight is that of the edges.
    """

    factors: Costs
    field: Field
    density: CostDensity


Weigh: TypeAlias = Callable[[CSpace], CellCost | None]
"""Maker of what a metre costs on a map in memory; None if each one costs its length."""


def check_costs_fit(space: CSpace) -> None:
    """Raise InputError if the costs of all cells do not fit into memory."""
    needed = BYTES_PER_CELL * len(space.slice_rotations) * space.grid.size
    check_memory(needed, "the map, to weigh its cells,", space.grid)


@internal
def cost_at(
    map_: Map, values: Values, density: CostDensity, position: Row, rotation: Numbers
) -> float:
    """Return a metre's cost at a configuration, from the field."""
    value = 0.0
    if values.kind == CLEARANCES:
        value = clearance_at(map_, values.distances, position, rotation)
    elif values.kind == OVERLAPS:
        value = field_at(map_, values.overlaps, position, rotation)
    penalty = max(0.0, density.offset + density.slope * value)
    return 1.0 + density.weight * penalty * penalty


@internal
def field_at(map_: Map, values: Costs, position: Row, rotation: Numbers) -> float:
    """Interpolate a field at a configuration, for compiled callers.

    ``values``, shape (cells,), are the overlaps of all cells of all slices in C order, and
    ``position`` has three coordinates, metres. The weights are those of linear interpolation
    between the eight cell centers around the position.
    """
    s = slice_of(map_, rotation)
    total = 0.0
    for corner in range(8):  # of the cube of eight cell centers around the position
        weight = 1.0
        cell = s
        for axis in range(3):
            # Each bit of the corner selects the lower or the upper center along an axis.
            is_upper = (corner >> axis) & 1
            count = map_.states.shape[axis + 1]
            place = (position[axis] - map_.lower[axis]) / map_.spacing - 0.5
            place = min(max(place, 0.0), count - 1.0)
            k = min(int(place), max(count - 2, 0))
            share = place - k
            if is_upper:
                k = min(k + 1, count - 1)
                weight *= share
            else:
                weight *= 1.0 - share
            cell = cell * count + k
        if weight > 0.0:
            total += weight * values[cell]
    return max(total, 0.0)


@kernel
def integrate_straight_edge(
    map_: Map, values: Values, density: CostDensity, size: int, numbers: Numbers
) -> float:
    """Integrate the cost along a straight edge.

    ``numbers`` are the configurations of both ends, each of length ``size``. The midpoint rule has
    steps of at most one cell and 5 degrees.
    """
    metres, radians = measure_edge(map_, size, numbers)
    cells = metres / map_.spacing
    steps = max(1, math.ceil(max(cells, radians / MAX_RADIANS_PER_STEP)))
    total = 0.0
    for step in range(steps):
        share = (step + 0.5) / steps
        position, rotation = configuration_along(map_, size, numbers, share)
        total += cost_at(map_, values, density, position, rotation)
    mean_cost = total / steps
    if density.mean_per_metre:
        return mean_cost
    return mean_cost * (metres + density.rotation_weight * radians)


def bind_cost(kernel: Any, space: CSpace, field: Field, *fixed: Any) -> Callable[..., float]:
    """Make ``cost(*q0, *q1)`` from ``kernel(map, values, *fixed, numbers)``.

    The numbers are both configurations. The function follows changes of the map.
    """
    # Kernels take one type of record, so what a field does not need is empty.
    no_distances = DistanceTable(
        np.empty(0, dtype=np.float32),
        np.empty((0, 2, space.grid.dim)),
        np.empty(0, dtype=np.bool_),
    )
    no_overlaps = np.empty(0, dtype=np.float32)
    zeros = (0.0,) * (2 * space.size)

    def get_values() -> Values:
        """Return the field's present values."""
        if isinstance(field, str):
            return Values(CLEARANCES, DistanceTable.of(space), no_overlaps)
        if field is None:
            return Values(NO_VALUES, no_distances, no_overlaps)
        return Values(OVERLAPS, no_distances, field.reshape(-1))

    integrate = bind_kernel(kernel, (map_record(space),), get_values(), *fixed, zeros)
    return lambda *ends: integrate(get_values(), *fixed, ends)

"""Costs on the cells of a map, and kernels that integrate them along straight edges."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

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

if TYPE_CHECKING:
    from planners._searches.estimate import Costs

Numbers = tuple[float, ...]
"""Coordinates of a rotation, or of configurations."""

MAX_RADIANS_PER_STEP: Final = math.radians(5.0)
"""Largest rotation of an integration step, in radians (5 degrees)."""

BYTES_PER_CELL: Final = 16
"""Memory to make and keep the cost of a cell, bytes."""


class CostDensity(NamedTuple):
    """Cost of a metre as a function of the clearance.

    It is ``1 + weight * max(0, offset + slope * clearance)**2``. A radian of rotation counts as
    ``rotation_weight`` metres.
    """

    offset: float = 0.0
    slope: float = 0.0
    weight: float = 0.0
    rotation_weight: float = 0.0


class Values(NamedTuple):
    """Record for kernels that gives the cost of a metre: factors of cells, or distances."""

    distances: DistanceTable
    factors: Costs  # (cells,), all slices in C order; empty for clearances


@dataclass(frozen=True, slots=True, eq=False)
class CellCost:
    """Cost of a metre in the cells of a map, and along edges.

    Attributes
    ----------
    factors : ndarray of float32, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Cost of a metre in each cell, 1 or above. Along edges it is interpolated linearly between
        cell centers.
    density : CostDensity, optional
        Cost of a metre along edges by the clearance, instead of ``factors``.
    bound : dict
        Bound kernels of edges, cached because binding takes longer than hundreds of edges.
    """

    factors: Costs
    density: CostDensity | None = None
    bound: dict[object, Callable[..., float]] = field(default_factory=dict)


Weigh: TypeAlias = Callable[[CSpace], CellCost | None]
"""Maker of the cost of a metre on a map in memory; None if the cost is the length."""


def check_costs_fit(space: CSpace) -> None:
    """Raise InputError if the cells' costs do not fit into memory."""
    needed = BYTES_PER_CELL * len(space.slice_rotations) * space.grid.size
    check_memory(needed, "the map, to weigh its cells,", space.grid)


@internal
def cost_at(
    map_: Map, values: Values, density: CostDensity, position: Row, rotation: Numbers
) -> float:
    """Return a metre's cost at a configuration."""
    if len(values.factors) > 0:
        return factor_between(map_, values.factors, position, rotation)
    clearance = clearance_at(map_, values.distances, position, rotation)
    penalty = max(0.0, density.offset + density.slope * clearance)
    return 1.0 + density.weight * penalty * penalty


@internal
def factor_between(map_: Map, factors: Costs, position: Row, rotation: Numbers) -> float:
    """Interpolate the factors of cells linearly at a configuration.

    ``factors`` are as in :class:`Values`, and ``position`` has three coordinates, metres. The
    factor is interpolated between the eight cell centers around the position.
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
            total += weight * factors[cell]
    return max(total, 1.0)


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
    return total / steps * (metres + density.rotation_weight * radians)


def bind_cost(
    kernel: Any, space: CSpace, weights: CellCost, rotation_weight: float, *fixed: Any
) -> Callable[..., float]:
    """Make ``cost(*q0, *q1)`` from ``kernel(map, values, density, *fixed, numbers)``.

    The numbers are both configurations. The function follows updates of the map.
    """
    # Kernels take one type of record, so unused fields are empty.
    no_distances = DistanceTable(
        np.empty(0, dtype=np.float32),
        np.empty((0, 2, space.grid.dim)),
        np.empty(0, dtype=np.bool_),
    )
    by_clearance = weights.density is not None
    factors = np.empty(0, dtype=np.float32) if by_clearance else weights.factors.reshape(-1)
    density = (weights.density or CostDensity())._replace(rotation_weight=rotation_weight)
    values = Values(no_distances, factors)
    integrate = weights.bound.get((kernel, fixed))
    if integrate is None:
        zeros = (0.0,) * (2 * space.size)
        integrate = bind_kernel(kernel, (map_record(space),), values, density, *fixed, zeros)
        weights.bound[kernel, fixed] = integrate
    if not by_clearance:
        return lambda *ends: integrate(values, density, *fixed, ends)

    def measure(*ends: float) -> float:
        """Return the cost by the map's present distances."""
        present = Values(DistanceTable.of(space), factors)
        cost: float = integrate(present, density, *fixed, ends)
        return cost

    return measure

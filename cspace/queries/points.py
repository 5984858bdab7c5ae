"""Look-ups of configurations for kernels: cells, states, and free neighborhoods.

Kernels take a configuration as a position (three numbers, in the middle of the layer in the plane)
and a rotation (a tuple, see :mod:`cspace.rotations.lookup`), or configurations as rows of an array,
shape (n, size).
"""

from __future__ import annotations

import math
from typing import Final

from cspace.grid import MAX_COORDINATE, SLACK
from cspace.record.cells import Map
from cspace.rotations.lookup import (
    OTHER_COMPONENTS,
    QUOTIENT_SLACK,
    cell_index,
    first_widened_cell,
    is_rotation,
    normalise,
    parts_around,
    rotation_cell,
    rotation_in,
    widened_bounds,
    wrap_to_cells,
)
from cspace.support.arrays import FREE, MIXED, Bools, Floats, Numbers, Row, States
from cspace.support.compiling import inlined, kernel

Cell = tuple[int, int, int]
"""A cell along three axes."""

MAX_CELL: Final = 2.0**62
"""Largest coordinate, in cells; larger ones are clamped so that they fit 64-bit integers."""

MAX_POSITION: Final = 8.0 * MAX_COORDINATE
"""Maximum sum of coordinates, in cells, of the ends of an edge or box that is not refused."""


# ---- configurations ------------------------------------------------------------------------------


@inlined
def position_in_plane(map_: Map, x: float, y: float) -> Row:
    """Return a position in the plane, which is in the middle of the layer."""
    return 0.5 * map_.spacing, x, y


@inlined
def position_in(map_: Map, points: Floats, k: int) -> Row:
    """Return the position of row k of an array of configurations."""
    if map_.dim == 2:
        return position_in_plane(map_, points[k, 0], points[k, 1])
    return points[k, 0], points[k, 1], points[k, 2]


@inlined
def configuration_in(map_: Map, points: Floats, k: int) -> tuple[Row, Numbers]:
    """Return position and rotation of row k of an array of configurations."""
    return position_in(map_, points, k), rotation_in(map_.rotations.borders, points[k])


@inlined
def is_usable(position: Row, rotation: Numbers) -> bool:
    """Return True if a configuration is finite and its rotation exact enough."""
    x, y, z = position
    return math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and is_rotation(rotation)


# ---- states --------------------------------------------------------------------------------------


@inlined
def cell_along(coordinate: float, lower: float, upper: float, spacing: float, count: int) -> int:
    """Return the cell of a coordinate, as ``Grid.cell_of``; it may be outside the grid."""
    cell = math.floor(min(max((coordinate - lower) / spacing, -MAX_CELL), MAX_CELL))
    return count - 1 if cell == count and coordinate <= upper else cell


@inlined
def cell_of(map_: Map, position: Row) -> Cell:
    """Return the cell of a position, which may be outside the grid."""
    (a, b, c), (x, y, z), h = map_.lower, map_.upper, map_.spacing
    _, nx, ny, nz = map_.states.shape
    return (
        cell_along(position[0], a, x, h, nx),
        cell_along(position[1], b, y, h, ny),
        cell_along(position[2], c, z, h, nz),
    )


@inlined
def is_in_grid(map_: Map, cell: Cell) -> bool:
    """Return True if a cell is in the grid."""
    _, nx, ny, nz = map_.states.shape
    i, j, k = cell
    return bool(0 <= i < nx and 0 <= j < ny and 0 <= k < nz)


@inlined
def slice_of(map_: Map, rotation: Numbers) -> int:
    """Return the slice that contains a rotation."""
    return int(map_.rotations.slice_of[rotation_cell(map_.rotations.borders, rotation)])


@inlined
def state_at(map_: Map, position: Row, rotation: Numbers) -> int:
    """Return the state of a configuration."""
    s, cell = slice_of(map_, rotation), cell_of(map_, position)
    if is_in_grid(map_, cell):
        return int(map_.states[s, cell[0], cell[1], cell[2]])
    first, last = exterior_box(map_, s)
    in_box, finite = True, True
    for axis in range(3):
        in_box &= first[axis] <= cell[axis] <= last[axis]
        finite &= math.isfinite(position[axis])
    return MIXED if in_box or not finite else int(map_.exterior[s, 2 * map_.dim])


@kernel
def exterior_box(map_: Map, s: int) -> tuple[Cell, Cell]:
    """Return the first and the last cell of the box of MIXED cells outside the grid."""
    row = map_.exterior[s]
    if map_.dim == 2:
        return (0, row[0], row[1]), (0, row[2], row[3])
    return (row[0], row[1], row[2]), (row[3], row[4], row[5])


@kernel
def classify(map_: Map, points: Floats, out: States) -> int:
    """Write states; return the index of the first unusable configuration, or -1."""
    for k in range(points.shape[0]):
        position, rotation = configuration_in(map_, points, k)
        if not is_usable(position, rotation):
            return k
        out[k] = state_at(map_, position, rotation)
    return -1


# ---- boxes of cells ------------------------------------------------------------------------------


@inlined
def run_is_free(map_: Map, s: int, i: int, j: int, first: int, last: int) -> bool:
    """Return True if cells ``first`` to ``last`` along the last axis are FREE.

    Outside the grid, cells in the exterior box are MIXED; all others must be known to be FREE.
    """
    _, nx, ny, nz = map_.states.shape
    in_grid = 0 <= i < nx and 0 <= j < ny
    if in_grid:
        if not run_in_grid_is_free(map_, s, i, j, max(first, 0), min(last, nz - 1)):
            return False
        if first >= 0 and last < nz:
            return True
    low, high = exterior_box(map_, s)
    if not (low[0] <= i <= high[0] and low[1] <= j <= high[1]):
        return True
    begin, end = max(first, low[2]), min(last, high[2])
    return begin > end or (in_grid and begin >= 0 and end < nz)


@inlined
def run_in_grid_is_free(map_: Map, s: int, i: int, j: int, first: int, last: int) -> bool:
    """Return True if cells ``first`` to ``last`` along the last axis, all in the grid, are FREE."""
    # Most runs have one or two cells, which no loop tests: processors guess wrong when it ends.
    for k in range(first + 1, last):
        if map_.states[s, i, j, k] != FREE:
            return False
    return bool(first > last or (map_.states[s, i, j, first] | map_.states[s, i, j, last]) == FREE)


@kernel
def grid_box(map_: Map) -> tuple[Cell, Cell]:
    """Return the first and the last cell of the grid."""
    _, nx, ny, nz = map_.states.shape
    return (0, 0, 0), (nx - 1, ny - 1, nz - 1)


@kernel
def outer_box(map_: Map, s: int) -> tuple[Cell, Cell]:
    """Return the first and the last cell of the box around the grid and the exterior box."""
    (a, b, c), (x, y, z) = exterior_box(map_, s)
    _, nx, ny, nz = map_.states.shape
    return (min(a, 0), min(b, 0), min(c, 0)), (max(x, nx - 1), max(y, ny - 1), max(z, nz - 1))


@inlined
def near_cells(map_: Map, position: Row, reach: float, axis: int) -> tuple[int, int]:
    """Return the first and the last closed cell along an axis within ``reach`` cells."""
    place = (position[axis] - map_.lower[axis]) / map_.spacing
    return math.ceil(place - reach) - 1, math.floor(place + reach)


@kernel
def box_is_free(map_: Map, s: int, position: Row, distance: float) -> bool:
    """Return True if all cells of a slice within ``distance`` along each axis are FREE.

    The cells are closed, and SLACK is added to the distance. In the plane, the box stays in the
    layer.
    """
    reach, total = distance / map_.spacing + SLACK, 0.0
    for axis in range(3):
        total += abs(position[axis] - map_.lower[axis]) / map_.spacing
    if not total + reach <= MAX_POSITION:  # True for NaN
        return False
    i0, i1 = near_cells(map_, position, reach if map_.dim == 3 else 0.0, 0)
    j0, j1 = near_cells(map_, position, reach, 1)
    k0, k1 = near_cells(map_, position, reach, 2)
    low, high = grid_box(map_)
    inside = (
        low[0] <= i0
        and low[1] <= j0
        and low[2] <= k0
        and i1 <= high[0]
        and j1 <= high[1]
        and k1 <= high[2]
    )
    if not inside:
        if map_.exterior[s, 2 * map_.dim] != FREE:
            return False
        low, high = outer_box(map_, s)
    for i in range(max(i0, low[0]), min(i1, high[0]) + 1):
        for j in range(max(j0, low[1]), min(j1, high[1]) + 1):
            if not run_is_free(map_, s, i, j, max(k0, low[2]), min(k1, high[2])):
                return False
    return True


@kernel
def boxes_are_free(map_: Map, distance: float, angle: float, points: Floats, out: Bools) -> int:
    """Write if everything around configurations is FREE.

    Return the index of the first unusable configuration, or -1. The distance is along each axis.
    """
    for k in range(points.shape[0]):
        position, rotation = configuration_in(map_, points, k)
        if not is_usable(position, rotation):
            return k
        out[k] = around_is_free(map_, position, rotation, distance, angle)
    return -1


@kernel
def around_is_free(
    map_: Map, position: Row, rotation: Numbers, distance: float, angle: float
) -> bool:
    """Return True if all configurations within ``distance`` and ``angle`` are proven free."""
    if len(rotation) == 4:
        return quaternions_around_are_free(map_, position, rotation, distance, angle)
    borders = map_.rotations.borders
    if borders.shape[0] == 0:
        return box_is_free(map_, int(map_.rotations.slice_of[0]), position, distance)
    start, reach = wrap_to_cells(borders, rotation[0]), min(angle, math.pi)
    first = first_widened_cell(borders, start - reach)
    for cell in range(first, first + borders.shape[0] - 1):
        k, low, _ = widened_bounds(borders, cell)
        if low > start + reach:
            return True
        if not box_is_free(map_, int(map_.rotations.slice_of[k]), position, distance):
            return False
    return True


@kernel
def quaternions_around_are_free(
    map_: Map, position: Row, rotation: Numbers, distance: float, angle: float
) -> bool:
    """Return the answer of :func:`around_is_free` for quaternions."""
    borders, q = map_.rotations.borders[0], normalise(rotation, 1.0)
    reach = (
        math.sin(0.5 * min(angle, math.pi)) + QUOTIENT_SLACK
    )  # a rotation's angle is twice that of its quaternion
    for chart in range(4):
        a, b, c = OTHER_COMPONENTS[chart]
        i0, i1 = parts_around(borders, q[chart], q[a], reach)
        j0, j1 = parts_around(borders, q[chart], q[b], reach)
        k0, k1 = parts_around(borders, q[chart], q[c], reach)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    s = int(map_.rotations.slice_of[cell_index(borders, chart, i, j, k)])
                    if not box_is_free(map_, s, position, distance):
                        return False
    return True

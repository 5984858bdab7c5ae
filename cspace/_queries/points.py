"""Look-ups of configurations for kernels: cells, states, and free neighborhoods.

Kernels take a configuration as a position (three numbers, in the middle of the layer in the plane)
and a rotation (a tuple, see :mod:`cspace._rotations.lookup`), or configurations as rows of an
array, shape (n, size).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cspace._grid import MAX_COORDINATE, SLACK
from cspace._record.cells import Map
from cspace._rotations.lookup import (
    OTHER_COMPONENTS,
    QUOTIENT_SLACK,
    cell_index,
    first_widened_cell,
    guess_cell,
    is_rotation,
    normalise,
    parts_around,
    rotation_cell,
    rotation_in,
    widened_bounds,
    wrap_near,
    wrap_to_cells,
)
from cspace._support.arrays import (
    FREE,
    MIXED,
    Floats,
    Ints,
    Numbers,
    Row,
    States,
)
from cspace._support.compiling import inlined, internal, kernel

Cell = tuple[int, int, int]
"""A cell along three axes."""

NOT_USABLE: Final = 255
"""Answer for coordinates that are not finite, or of an invalid rotation."""

MAX_CELL: Final = 2.0**62
"""Largest coordinate, in cells; larger ones are clamped so that they fit 64-bit integers."""

MAX_POSITION: Final = 8.0 * MAX_COORDINATE
"""Maximum sum of coordinates, in cells, of the ends of an edge or box that is not refused."""


# ---- configurations ------------------------------------------------------------------------------


@inlined
def position_in_plane(map_: Map, x: float, y: float) -> Row:
    """Return a plane position in space, in the middle of the layer."""
    return 0.5 * map_.spacing, x, y


@inlined
def configuration_in(map_: Map, points: Floats, k: int) -> tuple[Row, Numbers]:
    """Return position and rotation of row k of an array of configurations."""
    rotation = rotation_in(map_.rotations.borders, points[k])
    if map_.dim == 2:
        return position_in_plane(map_, points[k, 0], points[k, 1]), rotation
    return (points[k, 0], points[k, 1], points[k, 2]), rotation


@inlined
def is_usable(position: Row, rotation: Numbers) -> bool:
    """Return True if a configuration is finite and its rotation valid."""
    x, y, z = position
    return math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and is_rotation(rotation)


@inlined
def position_in_cells(map_: Map, position: Row) -> Row:
    """Return a position in cells from the lower corner of the grid."""
    x, y, z = position
    x0, y0, z0 = map_.lower
    h = map_.spacing
    return (x - x0) / h, (y - y0) / h, (z - z0) / h


# ---- states --------------------------------------------------------------------------------------


@inlined
def cell_along(place: float, coordinate: float, upper: float, count: int) -> int:
    """Return the cell of a coordinate along an axis.

    It may be outside the grid. ``place`` is the coordinate in cells. The upper border belongs to
    the last of ``count`` cells.
    """
    cell = math.floor(min(max(place, -MAX_CELL), MAX_CELL))
    return count - 1 if cell == count and coordinate <= upper else cell


@inlined
def cell_of(map_: Map, position: Row) -> Cell:
    """Return the cell of a position, which may be outside the grid."""
    u, v, w = position_in_cells(map_, position)
    x, y, z = map_.upper
    _, nx, ny, nz = map_.states.shape
    return (
        cell_along(u, position[0], x, nx),
        cell_along(v, position[1], y, ny),
        cell_along(w, position[2], z, nz),
    )


@inlined
def slice_of(map_: Map, rotation: Numbers) -> int:
    """Return the slice that contains a rotation."""
    return int(map_.rotations.slice_of[rotation_cell(map_.rotations.borders, rotation)])


@inlined
def state_at(map_: Map, position: Row, rotation: Numbers) -> int:
    """Return the state of a configuration, or NOT_USABLE.

    It is NOT_USABLE if its position is not finite.
    """
    s = slice_of(map_, rotation)
    u, v, w = position_in_cells(map_, position)
    if is_in_grid(map_, u, v, w):
        # Indices without a sign need no test for negative ones.
        return int(map_.states[s, np.uint32(u), np.uint32(v), np.uint32(w)])
    return state_outside(map_, s, position)


@inlined
def is_in_grid(map_: Map, u: float, v: float, w: float) -> bool:
    """Return True for a position in cells in the grid, but not on its upper border."""
    _, nx, ny, nz = map_.states.shape
    # Most positions are in the grid, so all tests are done at once.
    return bool((u >= 0.0) & (v >= 0.0) & (w >= 0.0) & (u < nx) & (v < ny) & (w < nz))


@internal
def state_outside(map_: Map, s: int, position: Row) -> int:
    """Return the state of a position outside the grid.

    The position may also be on the upper border of the grid.
    """
    i, j, k = cell_of(map_, position)
    _, nx, ny, nz = map_.states.shape
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return int(map_.states[s, i, j, k])
    x, y, z = position
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return NOT_USABLE
    first, last = exterior_box(map_, s)
    if first[0] <= i <= last[0] and first[1] <= j <= last[1] and first[2] <= k <= last[2]:
        return MIXED
    return int(map_.exterior[s, 2 * map_.dim])


@internal
def exterior_box(map_: Map, s: int) -> tuple[Cell, Cell]:
    """Return the first and the last cell of a slice's exterior box.

    The box contains the MIXED cells outside the grid.
    """
    # A row has the first cell, the last cell, and the state of all other cells outside.
    row = map_.exterior[s]
    if map_.dim == 2:
        return (0, row[0], row[1]), (0, row[2], row[3])
    return (row[0], row[1], row[2]), (row[3], row[4], row[5])


def classify(map_: Map, points: Floats, out: States) -> int:
    """Write the states of configurations.

    ``points`` has shape (n, size), ``out`` (n,). Returns the first unusable row, or -1.
    """
    # Number of configurations whose cells are found before their states are read.
    block = 4096
    return classify_blocks(map_, points, np.empty(block), np.empty(block, dtype=np.int64), out)


@kernel
def classify_blocks(map_: Map, points: Floats, places: Floats, cells: Ints, out: States) -> int:
    """Write the states of configurations, like `classify`, by blocks as long as ``places``.

    A processor computes many cells at once, and waits for many states at once, in loops that do
    nothing else. ``places`` and ``cells``, shape (block,), are scratch.
    """
    states = map_.states.reshape(-1)
    for start in range(0, points.shape[0], places.shape[0]):
        rows = points[start : start + places.shape[0]]
        answers = out[start : start + places.shape[0]]
        # Index of the cell among the cells of all slices, axis by axis; -1 beyond the grid.
        find_slices(map_.rotations.borders, map_.rotations.slice_of, rows, cells)
        for axis in range(map_.dim):
            lower = map_.lower[axis - map_.dim]
            count = map_.states.shape[axis - map_.dim]
            for k in range(rows.shape[0]):
                places[k] = rows[k, axis]
            for k in range(rows.shape[0]):
                place = (places[k] - lower) / map_.spacing
                is_inside = (cells[k] >= 0) & (place >= 0.0) & (place < count)
                cells[k] = cells[k] * count + np.int64(place) if is_inside else -1
        least = 0
        for k in range(rows.shape[0]):
            answers[k] = states[cells[k]] if cells[k] >= 0 else NOT_USABLE
            least = min(least, cells[k])
        if least >= 0:  # no row is beyond the grid
            continue
        for k in range(rows.shape[0]):
            if cells[k] >= 0:
                continue
            position, rotation = configuration_in(map_, rows, k)
            if is_rotation(rotation):
                answers[k] = state_outside(map_, slice_of(map_, rotation), position)
            if answers[k] == NOT_USABLE:
                return start + k
    return -1


@inlined
def find_slices(borders: Floats, slice_of: Ints, rows: Floats, slices: Ints) -> None:
    """Write the slices of the rotations of configurations, or -1 for one that is not usable.

    ``borders`` and ``slice_of`` are those of the map's rotations; ``rows`` has shape (n, size).
    """
    if borders.ndim == 1:
        # A processor guesses many yaws at once, and few of them wrong.
        for k in range(rows.shape[0]):
            cell = guess_cell(borders, wrap_near(borders, rows[k, -1]))
            slices[k] = slice_of[cell] if cell >= 0 else -1
    for k in range(rows.shape[0]):
        if borders.ndim == 1 and slices[k] >= 0:
            continue
        rotation = rotation_in(borders, rows[k])
        slices[k] = slice_of[rotation_cell(borders, rotation)] if is_rotation(rotation) else -1


# ---- boxes of cells ------------------------------------------------------------------------------


@inlined
def run_is_free(map_: Map, s: int, i: int, j: int, first: int, last: int) -> bool:
    """Return True if a run of cells along the last axis is FREE.

    The run reaches from ``first`` to ``last``. Outside the grid, cells in the exterior box are
    MIXED; all others must be known to be FREE.
    """
    _, nx, ny, nz = map_.states.shape
    in_grid = 0 <= i < nx and 0 <= j < ny
    if in_grid:
        start = max(first, 0)
        stop = min(last, nz - 1)
        # Most runs have one or two cells, which no loop tests: processors guess wrong when it ends.
        for k in range(start + 1, stop):
            if map_.states[s, i, j, k] != FREE:
                return False
        if start <= stop and (map_.states[s, i, j, start] | map_.states[s, i, j, stop]) != FREE:
            return False
        if first >= 0 and last < nz:
            return True
    # Cells outside the grid are FREE unless the run meets the exterior box there.
    low, high = exterior_box(map_, s)
    if not (low[0] <= i <= high[0] and low[1] <= j <= high[1]):
        return True
    begin = max(first, low[2])
    end = min(last, high[2])
    return begin > end or (in_grid and begin >= 0 and end < nz)


@internal
def box_to_test(map_: Map, s: int, inside: bool) -> tuple[Cell, Cell]:
    """Return the first and last cell that a test must visit.

    They are those of the grid, if `inside`, and otherwise of the box around the grid and the
    exterior box, beyond which all cells have one state.
    """
    _, nx, ny, nz = map_.states.shape
    if inside:
        return (0, 0, 0), (nx - 1, ny - 1, nz - 1)
    first, last = exterior_box(map_, s)
    low = min(first[0], 0), min(first[1], 0), min(first[2], 0)
    high = max(last[0], nx - 1), max(last[1], ny - 1), max(last[2], nz - 1)
    return low, high


@inlined
def closed_cells(low: float, high: float) -> tuple[int, int]:
    """Return the first and last closed cell that an interval meets."""
    # A coordinate on a boundary belongs to the cells on both sides.
    return math.ceil(low) - 1, math.floor(high)


@internal
def box_is_free(map_: Map, s: int, position: Row, distance: float) -> bool:
    """Return True if all cells near a position are FREE.

    They are the cells of slice ``s`` within ``distance`` along each axis. The cells are closed, and
    SLACK is added to the distance. In the plane, the box stays in the layer.
    """
    u, v, w = position_in_cells(map_, position)
    reach = distance / map_.spacing + SLACK
    if not abs(u) + abs(v) + abs(w) + reach <= MAX_POSITION:  # refuses NaN too
        return False
    # First and last cell of the box along each axis.
    across = reach if map_.dim == 3 else 0.0
    i0, i1 = closed_cells(u - across, u + across)
    j0, j1 = closed_cells(v - reach, v + reach)
    k0, k1 = closed_cells(w - reach, w + reach)
    _, nx, ny, nz = map_.states.shape
    inside = min(i0, j0, k0) >= 0 and i1 < nx and j1 < ny and k1 < nz
    state_beyond = map_.exterior[s, 2 * map_.dim]
    if not inside and state_beyond != FREE:
        return False
    # Cells beyond the grid and the exterior box need no test.
    low, high = box_to_test(map_, s, inside)
    for i in range(max(i0, low[0]), min(i1, high[0]) + 1):
        for j in range(max(j0, low[1]), min(j1, high[1]) + 1):
            if not run_is_free(map_, s, i, j, max(k0, low[2]), min(k1, high[2])):
                return False
    return True


@internal
def neighborhood_is_free(
    map_: Map, position: Row, rotation: Numbers, distance: float, angle: float
) -> bool:
    """Return True if all configurations near a given one are proven free.

    They are at most ``distance`` away along each axis, metres, and rotated by at most ``angle``.
    """
    if len(rotation) == 4:
        return quaternion_neighborhood_is_free(map_, position, rotation, distance, angle)
    if len(rotation) == 0:
        return box_is_free(map_, int(map_.rotations.slice_of[0]), position, distance)
    borders = map_.rotations.borders
    # Test the yaw cells in reach, at most all of them once.
    start = wrap_to_cells(borders, rotation[0])
    reach = min(angle, math.pi)
    first = first_widened_cell(borders, start - reach)
    n_cells = borders.shape[0] - 1
    for cell in range(first, first + n_cells):
        index, low, _ = widened_bounds(borders, cell)
        if low > start + reach:
            return True
        if not box_is_free(map_, int(map_.rotations.slice_of[index]), position, distance):
            return False
    return True


@internal
def quaternion_neighborhood_is_free(
    map_: Map, position: Row, rotation: Numbers, distance: float, angle: float
) -> bool:
    """Return True if all configurations near a given one are proven free.

    Its rotation is a quaternion. They are at most ``distance`` away along each axis, metres, and
    rotated by at most ``angle``.
    """
    borders = map_.rotations.borders[0]
    q = normalise(rotation, 1.0)
    # A rotation's angle is twice that of its quaternion.
    reach = math.sin(0.5 * min(angle, math.pi)) + QUOTIENT_SLACK
    # Rotation cells are cells of four cubes, the charts, by the largest component.
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

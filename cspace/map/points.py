"""Compiled look-ups of configurations: cells, states, and free neighborhoods.

Every function takes the record of a map, and a configuration as a tuple or configurations as an array, shape (n, size).
The compiler unrolls loops over axes, so the same code serves two and three axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numba.cpython.unsafe.tuple import tuple_setitem

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints, States
from cspace.compiling import always_inline, jit, kernel
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.map.storage import Map

Numbers = tuple[float, ...]
Cell = tuple[int, ...]
Entries = TypeVar("Entries", bound=tuple[float, ...])


class Replaced(Protocol):
    """Function that replaces one entry of a tuple."""

    def __call__(self, entries: Entries, index: int, entry: float, /) -> Entries:
        """Return the tuple with another entry at an index."""
        ...


replaced: Replaced = tuple_setitem  # type: ignore[assignment]  # the type it has in compiled code

MAX_CELL = 2.0**62
"""Largest coordinate, in cells; larger ones are clamped so that they fit 64-bit integers."""

MAX_POSITION = 8.0 * MAX_COORDINATE
"""Maximum sum of coordinates, in cells, of the ends of an edge or box that is not refused."""

POINTS_PER_BLOCK = 1024
"""Points looked up at a time, so that their scratch fits a core's first cache."""

MAX_POINTS_ONE_BY_ONE = 32
"""Number of points up to which each is looked up alone; the faster kernel for more takes a second to compile."""

INSIDE, UNDECIDED = 255, 254
"""Codes of points in the grid, and of points that need a closer look; all other codes are states."""


# ---- one configuration -----------------------------------------------------------------------------------------------


@always_inline
def configuration(map_: Map, points: Floats, k: int) -> Numbers:
    """Return row k of an array as a tuple."""
    q = map_.lower + map_.rotations.zeros()
    for axis in range(len(q)):
        q = replaced(q, axis, points[k, axis])
    return q


@always_inline
def state_in(cells: States, index: int) -> int:
    """Return the state of a cell by its index over all slices."""
    state: int = cells[np.uint64(index)]  # an unsigned index needs no check for negative ones
    return state


@always_inline
def is_usable(map_: Map, q: Numbers) -> bool:
    """Return True if a configuration is finite and exact enough."""
    usable = map_.rotations.is_usable(q)
    for axis in range(len(map_.lower)):
        usable &= math.isfinite(q[axis])
    return usable


@kernel
def cell_of(map_: Map, q: Numbers) -> tuple[bool, int, Cell]:
    """Return (is in the grid, cell index, cell) of a configuration.

    The index counts all slices in a row. The cell is ``(slice, x, y)`` or ``(slice, x, y, z)``; along each axis it
    agrees with ``Grid.cell_of``.
    """
    inside: bool = np.bool_(True)  # type: ignore[assignment]  # numba requires one type from the start
    index = map_.rotations.slice_at(q)
    cell: Cell = replaced(map_.states.shape, 0, index)
    for axis in range(len(map_.lower)):
        n = map_.states.shape[axis + 1]
        i = math.floor(min(max((q[axis] - map_.lower[axis]) / map_.spacing, -MAX_CELL), MAX_CELL))
        if i == n and q[axis] <= map_.upper[axis]:
            i = n - 1
        inside &= (i >= 0) & (i < n)
        index = index * n + i
        cell = replaced(cell, axis + 1, i)
    return inside, index, cell


@always_inline  # a call would take as long as its body
def state_at(map_: Map, q: Numbers) -> int:
    """Return the state of one configuration."""
    inside, number, cell = cell_of(map_, q)
    if inside:
        return state_in(map_.cells, number)
    boxed: bool = np.bool_(True)  # type: ignore[assignment]  # numba requires one type from the start
    exterior, dim, finite = map_.exterior[cell[0]], len(map_.lower), boxed
    for axis in range(dim):
        boxed &= (exterior[axis] <= cell[axis + 1]) & (cell[axis + 1] <= exterior[axis + dim])
        finite &= math.isfinite(q[axis])
    return exterior[2 * dim] if finite & (not boxed) else MIXED


# ---- batches ---------------------------------------------------------------------------------------------------------


@kernel
def compute_codes(map_: Map, coordinates: Floats, slices: Ints, cells: Ints, codes: States) -> int:
    """Compute cells and codes; count the UNDECIDED ones.

    ``coordinates`` has all configurations in a row. A point in the grid gets its cell's index in ``cells`` and the code
    INSIDE. A point clearly outside gets its state, if the robot does not rotate. All others are UNDECIDED: unusable, or
    so near the grid's upper border that rounding may decide. There are no branches and all coordinates are read, so
    that the loop is vectorized.
    """
    dim, shape = len(map_.lower), map_.states.shape
    size = dim + len(map_.rotations.zeros())
    # Tuples, because array entries would be read again after every write.
    sizes, first, last = map_.lower, map_.lower, map_.lower
    for axis in range(dim):
        sizes = replaced(sizes, axis, float(shape[axis + 1]))
        first = replaced(first, axis, float(map_.exterior[0, axis]))
        last = replaced(last, axis, float(map_.exterior[0, axis + dim]) + 1.0)
    # ``rotates`` is a compile-time constant, so dead code is removed.
    exterior, rotates = np.uint8(map_.exterior[0, 2 * dim]), size > dim
    n_undecided = 0
    q = map_.lower + map_.rotations.zeros()
    for k in range(cells.shape[0]):
        for axis in range(size):
            q = replaced(
                q, axis, coordinates[np.uint64(size * k + axis)]
            )  # unsigned indices need no check for negative ones
        cell, inside, near_border = map_.rotations.slice_among(slices, k), map_.rotations.is_usable(q), rotates
        boxed, total = True, 0.0
        for axis in range(dim):
            u, n = (q[axis] - map_.lower[axis]) / map_.spacing, sizes[axis]
            inside &= (u >= 0.0) & (u < n)
            near_border |= (n <= u) & (u < n + 1.0)
            boxed &= (first[axis] <= u) & (u < last[axis])
            total += abs(u)
            cell = cell * shape[axis + 1] + int(np.int64(u))
        cells[k] = cell if inside else 0
        unsure = near_border | (not (total < MAX_CELL))
        code = INSIDE if inside else (UNDECIDED if unsure else (MIXED if boxed else exterior))
        codes[k] = code
        n_undecided += code == UNDECIDED
    return n_undecided


@kernel
def read_states(flat: States, cells: Ints, codes: States, out: States) -> None:
    """Write the states of points from their codes.

    A separate loop without branches reads the map, so that many reads of a map larger than the cache overlap.
    """
    for k in range(cells.shape[0]):
        out[k] = state_in(flat, cells[k])
    for k in range(cells.shape[0]):
        out[k] = out[k] if codes[k] == INSIDE else codes[k]


def classify(map_: Map, points: Floats, out: States) -> int:
    """Write states; return the first unusable row, or -1."""
    one_by_one = len(points) <= MAX_POINTS_ONE_BY_ONE
    kernel = classify_few if one_by_one else classify_many
    return kernel(map_, points, out)


@kernel
def classify_few(map_: Map, points: Floats, out: States) -> int:
    """Write states one by one; see :func:`classify`."""
    for k in range(points.shape[0]):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = state_at(map_, q)
    return -1


@jit
def classify_many(map_: Map, points: Floats, out: States) -> int:
    """Write states block by block; see :func:`classify`."""
    # The length of a tuple is a compile-time constant, which lets the compiler vectorize.
    size, coordinates, count = (
        len(map_.lower + map_.rotations.zeros()),
        points.reshape(-1),
        min(POINTS_PER_BLOCK, len(points)),
    )
    cells, codes, slices = np.empty(count, np.int64), np.empty(count, np.uint8), np.empty(count, np.int64)
    for first in range(0, points.shape[0], POINTS_PER_BLOCK):
        last = min(first + POINTS_PER_BLOCK, points.shape[0])
        part = coordinates[size * first : size * last]
        map_.rotations.slices_at(part, size, slices[: last - first])
        n_undecided = compute_codes(map_, part, slices, cells[: last - first], codes)
        read_states(map_.cells, cells[: last - first], codes, out[first:last])
        if n_undecided == 0:
            continue
        for k in range(first, last):
            if codes[k - first] == UNDECIDED:
                q = configuration(map_, points, k)
                if not is_usable(map_, q):
                    return k
                out[k] = state_at(map_, q)
    return -1


# ---- boxes of cells --------------------------------------------------------------------------------------------------
#
# Loops over cells are written for three axes; the plane is space with one layer of cells along the first axis.


@kernel
def drop_slice(cell: Cell, layer: int) -> Cell:
    """Return three axes of a cell, without its slice.

    Cells are ``(slice, x, y)`` or ``(slice, x, y, z)``; ``layer`` fills the missing axis.
    """
    three = (layer, layer, layer)
    for axis in range(len(cell) - 1):
        three = replaced(three, 4 - len(cell) + axis, cell[axis + 1])
    return three


class Slice(NamedTuple):
    """One slice of a map along three axes.

    Attributes
    ----------
    cells : ndarray of uint8, shape (n,)
        States of all slices in a row.
    start : int
        Index of the first cell of this slice.
    shape : tuple of int, length 3
        Cells along each axis.
    low, high : tuple of int, length 3
        First and last cell of a box. Its cells outside the grid are not FREE; all other cells outside the grid are.
    """

    cells: States
    start: int
    shape: Cell
    low: Cell
    high: Cell


@always_inline
def get_slice(map_: Map, s: int, inside: bool) -> Slice:
    """Return a slice by its index.

    If ``inside``, everything outside the grid counts as FREE. Otherwise the box of MIXED cells is included, and all
    other cells outside the grid must be FREE.
    """
    one: int = np.int64(1)  # type: ignore[assignment]  # numba requires one type from the start
    dim, size, last = len(map_.lower), one, -one if inside else one - one
    shape, low, high = (one, one, one), (one - one, one - one, one - one), (last, last, last)
    for axis in range(dim):
        size *= map_.states.shape[axis + 1]
        shape = replaced(shape, 3 - dim + axis, map_.states.shape[axis + 1])
        if not inside:
            low = replaced(low, 3 - dim + axis, map_.exterior[s, axis])
            high = replaced(high, 3 - dim + axis, map_.exterior[s, axis + dim])
    return Slice(map_.cells, s * size, shape, low, high)


@always_inline
def run_is_free(part: Slice, i: int, j: int, first: int, last: int) -> bool:
    """Return True if cells ``first`` to ``last`` are FREE.

    Cells outside both grid and box count as FREE.
    """
    nx, ny, nz = part.shape
    in_grid = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
    if in_grid:
        column = part.start + (i * ny + j) * nz
        for k in range(max(first, 0), min(last, nz - 1) + 1):
            if state_in(part.cells, column + k) != FREE:
                return False
    low, high = max(first, part.low[2]), min(last, part.high[2])
    if low > high:
        return True
    in_box = (part.low[0] <= i) & (i <= part.high[0]) & (part.low[1] <= j) & (j <= part.high[1])
    return (not in_box) | (in_grid & (low >= 0) & (high < nz))


@kernel
def box_is_free(map_: Map, s: int, q: Numbers, distance: float) -> bool:
    """Return True if all cells within ``distance`` are FREE.

    The cells are closed, and SLACK is added to the distance.
    """
    inside: bool = np.bool_(True)  # type: ignore[assignment]  # numba requires one type from the start
    dim, reach, total = len(map_.lower), distance / map_.spacing + SLACK, 0.0
    first, last = (0, 0, 0), (0, 0, 0)
    for axis in range(dim):
        position = (q[axis] - map_.lower[axis]) / map_.spacing
        total += abs(position)
        if total <= MAX_POSITION:  # False for NaN
            low, high = math.ceil(position - reach) - 1, math.floor(position + reach)
            inside &= (low >= 0) & (high < map_.states.shape[axis + 1])
            first, last = replaced(first, 3 - dim + axis, low), replaced(last, 3 - dim + axis, high)
    if not total + reach <= MAX_POSITION:
        return False
    if not inside and map_.exterior[s, 2 * dim] != FREE:
        return False
    part = get_slice(map_, s, inside)
    if not inside:
        for axis in range(3):
            first = replaced(first, axis, max(first[axis], min(part.low[axis], 0)))
            last = replaced(last, axis, min(last[axis], max(part.high[axis], part.shape[axis] - 1)))
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            if not run_is_free(part, i, j, first[2], last[2]):
                return False
    return True


@kernel
def boxes_are_free(map_: Map, distance: float, angle: float, points: Floats, out: Bools) -> int:
    """Write if everything around configurations is FREE.

    Return the index of the first unusable configuration, or -1. The distance is along each axis.
    """
    for k in range(points.shape[0]):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = around_is_free(map_, q, distance, angle)
    return -1


@kernel
def around_is_free(map_: Map, q: Numbers, distance: float, angle: float) -> bool:
    """Return True if all near configurations are proven free.

    They are within `distance` and `angle` of q.
    """
    cursor = map_.rotations.first_around(q, angle)
    while True:
        more, s, cursor = map_.rotations.next_around(cursor)
        if not more:
            return True
        if not box_is_free(map_, s, q, distance):
            return False

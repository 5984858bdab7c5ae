"""Compiled look-ups of configurations: their cells, their states, and whether all around them is FREE.

Every function takes the record of a map, and a configuration as a tuple or configurations as an array, shape (n, size).
Loops over axes are unrolled by the compiler, and what is written for one axis here becomes code for two or for three.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numba.cpython.unsafe.tuple import tuple_setitem

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints, States
from cspace.compiling import always_inline, jit, kernel
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.map.storage import Cells, Map, TileCells, state_in

Numbers = tuple[float, ...]
Cell = tuple[int, ...]
Entries = TypeVar("Entries", bound=tuple[float, ...])


class Replaced(Protocol):
    """A tuple with another entry at an index."""

    def __call__(self, entries: Entries, index: int, entry: float, /) -> Entries: ...


replaced: Replaced = tuple_setitem  # type: ignore[assignment]  # this is what it is to compiled code

FAR = 2.0**62

MAX_PLACE = 8.0 * MAX_COORDINATE
"""Farthest place, in cells, of which edges and boxes are answered; all axes and both ends together."""

BLOCK = 1024
"""Points that are looked up at a time; what is noted of them stays in a core's nearest cache."""

FEW = 32
"""Points up to which each is looked up on its own; what is quicker for more takes a second to compile."""

INSIDE, UNSURE = 255, 254
"""Codes of points in the grid, and of those that need a closer look; all others are states."""


# ---- one configuration -----------------------------------------------------------------------------------------------


@always_inline
def configuration(map_: Map, points: Floats, k: int) -> Numbers:
    """Row k of an array of configurations as a tuple."""
    q = map_.lower + map_.rotations.zeros()
    for axis in range(len(q)):
        q = replaced(q, axis, points[k, axis])
    return q


@always_inline
def halves(map_: Map, both: Numbers) -> tuple[Numbers, Numbers]:
    """Two configurations that are given in a row."""
    q0 = map_.lower + map_.rotations.zeros()
    q1, size = q0, len(q0)
    for axis in range(size):
        q0, q1 = replaced(q0, axis, both[axis]), replaced(q1, axis, both[size + axis])
    return q0, q1


@always_inline
def is_usable(map_: Map, q: Numbers) -> bool:
    """Whether all is finite, and the rotation exact enough."""
    usable = map_.rotations.is_usable(q)
    for axis in range(len(map_.lower)):
        usable &= math.isfinite(q[axis])
    return usable


@kernel
def cell_of(map_: Map, q: Numbers) -> tuple[bool, int, Cell]:
    """Whether a configuration lies in the grid, its cell's number, all slices in a row, and the cell.

    That is ``(slice, x, y)`` or ``(slice, x, y, z)``; along an axis it is that of ``Grid.cell_of``.
    """
    inside: bool = np.bool_(True)  # type: ignore[assignment]  # of one type for the compiler from the start
    number = map_.rotations.states_at(q)
    cell: Cell = replaced(map_.states.shape, 0, number)
    for axis in range(len(map_.lower)):
        n = map_.states.shape[axis + 1]
        i = math.floor(min(max((q[axis] - map_.lower[axis]) / map_.spacing, -FAR), FAR))
        if i == n and q[axis] <= map_.upper[axis]:
            i = n - 1
        inside &= (i >= 0) & (i < n)
        number = number * n + i
        cell = replaced(cell, axis + 1, i)
    return inside, number, cell


@always_inline  # a call takes as long as what it does
def state_at(map_: Map, q: Numbers) -> int:
    """State of one configuration."""
    inside, number, cell = cell_of(map_, q)
    if inside:
        return state_in(map_.cells, number)
    boxed: bool = np.bool_(True)  # type: ignore[assignment]  # of one type for the compiler from the start
    exterior, dim, finite = map_.exterior[cell[0]], len(map_.lower), boxed
    for axis in range(dim):
        boxed &= (exterior[axis] <= cell[axis + 1]) & (cell[axis + 1] <= exterior[axis + dim])
        finite &= math.isfinite(q[axis])
    return exterior[2 * dim] if finite & (not boxed) else MIXED


# ---- batches ---------------------------------------------------------------------------------------------------------


@kernel
def codes_of(map_: Map, numbers: Floats, slices: Ints, cells: Ints, codes: States) -> int:
    """Cells of configurations, whose numbers are in a row, and a code for each; how many are UNSURE.

    A point in the grid gets its cell's number in ``cells`` and the code INSIDE; one that is plainly outside gets its
    state for a code, where the robot does not turn; and what is left UNSURE: not usable, or so near the grid's upper
    border that rounding may decide. There are no branches, and all numbers are read, so that the loop becomes wide
    instructions.
    """
    dim, shape = len(map_.lower), map_.states.shape
    size = dim + len(map_.rotations.zeros())
    # As tuples: what lies in arrays would be read again after every write.
    sizes, first, last = map_.lower, map_.lower, map_.lower
    for axis in range(dim):
        sizes = replaced(sizes, axis, float(shape[axis + 1]))
        first = replaced(first, axis, float(map_.exterior[0, axis]))
        last = replaced(last, axis, float(map_.exterior[0, axis + dim]) + 1.0)
    # Which is known to the compiler: it leaves out the rest.
    exterior, several = np.uint8(map_.exterior[0, 2 * dim]), size > dim
    left = 0
    q = map_.lower + map_.rotations.zeros()
    for k in range(cells.shape[0]):
        for axis in range(size):
            q = replaced(q, axis, numbers[np.uint64(size * k + axis)])  # unsigned: no index is counted from the end
        cell, inside, border = map_.rotations.slice_among(slices, k), map_.rotations.is_usable(q), several
        boxed, total = True, 0.0
        for axis in range(dim):
            u, n = (q[axis] - map_.lower[axis]) / map_.spacing, sizes[axis]
            inside &= (u >= 0.0) & (u < n)
            border |= (n <= u) & (u < n + 1.0)
            boxed &= (first[axis] <= u) & (u < last[axis])
            total += abs(u)
            cell = cell * shape[axis + 1] + int(np.int64(u))
        cells[k] = cell if inside else 0
        unsure = border | (not (total < FAR))
        code = INSIDE if inside else (UNSURE if unsure else (MIXED if boxed else exterior))
        codes[k] = code
        left += code == UNSURE
    return left


@kernel
def read_states(flat: Cells, cells: Ints, codes: States, out: States) -> None:
    """States of points with given cells and codes.

    The map is read in a loop of its own and without a branch, so that many reads of a map larger than the cache are
    under way at once.
    """
    for k in range(cells.shape[0]):
        out[k] = state_in(flat, cells[k])
    for k in range(cells.shape[0]):
        out[k] = out[k] if codes[k] == INSIDE else codes[k]


def classify(map_: Map, points: Floats, out: States) -> int:
    """States of configurations; the index of the first one that is not usable, or -1."""
    few = len(points) <= FEW or isinstance(map_.cells, TileCells)
    kernel = classify_few if few else classify_many
    return kernel(map_, points, out)


@kernel
def classify_few(map_: Map, points: Floats, out: States) -> int:
    """The same, one by one."""
    for k in range(points.shape[0]):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = state_at(map_, q)
    return -1


@jit
def classify_many(map_: Map, points: Floats, out: States) -> int:
    """The same, step by step for all of a block."""
    # As the length of a tuple, which the compiler knows: it takes numbers of several points at once.
    size, numbers, count = len(map_.lower + map_.rotations.zeros()), points.reshape(-1), min(BLOCK, len(points))
    cells, codes, slices = np.empty(count, np.int64), np.empty(count, np.uint8), np.empty(count, np.int64)
    for first in range(0, points.shape[0], BLOCK):
        last = min(first + BLOCK, points.shape[0])
        part = numbers[size * first : size * last]
        map_.rotations.slices_at(part, size, slices[: last - first])
        left = codes_of(map_, part, slices, cells[: last - first], codes)
        read_states(map_.cells, cells[: last - first], codes, out[first:last])
        if left == 0:
            continue
        for k in range(first, last):
            if codes[k - first] == UNSURE:
                q = configuration(map_, points, k)
                if not is_usable(map_, q):
                    return k
                out[k] = state_at(map_, q)
    return -1


# ---- boxes of cells --------------------------------------------------------------------------------------------------
#
# What walks over cells is written for three axes; the plane is space with one layer of cells along the first.


@kernel
def layered(cell: Cell, layer: int) -> Cell:
    """A cell ``(slice, x, y)`` or ``(slice, x, y, z)`` along three axes, without the slice."""
    three = (layer, layer, layer)
    for axis in range(len(cell) - 1):
        three = replaced(three, 4 - len(cell) + axis, cell[axis + 1])
    return three


class Slice(NamedTuple):
    """One slice of a map along three axes.

    Attributes
    ----------
    cells : ndarray of uint8, shape (n,), or TwoBits
        The states of all slices in a row.
    start : int
        Where those of this one begin.
    shape : tuple of int, length 3
    low, high : tuple of int, length 3
        First and last cell of a box; what of it lies outside the grid is not FREE, and all else there is.
    """

    cells: Cells
    start: int
    shape: Cell
    low: Cell
    high: Cell


@always_inline
def slice_of(map_: Map, number: int, inside: bool) -> Slice:
    """A slice by its number, as if all were FREE outside the grid, or with the box of cells there that are MIXED.

    All else there must be FREE.
    """
    one: int = np.int64(1)  # type: ignore[assignment]  # of one type for the compiler from the start
    dim, size, last = len(map_.lower), one, -one if inside else one - one
    shape, low, high = (one, one, one), (one - one, one - one, one - one), (last, last, last)
    for axis in range(dim):
        size *= map_.states.shape[axis + 1]
        shape = replaced(shape, 3 - dim + axis, map_.states.shape[axis + 1])
        if not inside:
            low = replaced(low, 3 - dim + axis, map_.exterior[number, axis])
            high = replaced(high, 3 - dim + axis, map_.exterior[number, axis + dim])
    return Slice(map_.cells, number * size, shape, low, high)


@always_inline
def run_is_free(part: Slice, i: int, j: int, first: int, last: int) -> bool:
    """Whether the cells ``first <= k <= last`` of the column (i, j) are FREE, if all outside grid and box is."""
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
def box_is_free(map_: Map, number: int, q: Numbers, distance: float) -> bool:
    """Whether every closed cell within SLACK of all positions within ``distance`` along each axis is FREE."""
    dim, reach, total, inside = len(map_.lower), distance / map_.spacing + SLACK, 0.0, True
    first, last = (0, 0, 0), (0, 0, 0)
    for axis in range(dim):
        place = (q[axis] - map_.lower[axis]) / map_.spacing
        total += abs(place)
        if total <= MAX_PLACE:  # nor is NaN
            low, high = math.ceil(place - reach) - 1, math.floor(place + reach)
            inside &= (low >= 0) & (high < map_.states.shape[axis + 1])
            first, last = replaced(first, 3 - dim + axis, low), replaced(last, 3 - dim + axis, high)
    if not total + reach <= MAX_PLACE:
        return False
    if not inside and map_.exterior[number, 2 * dim] != FREE:
        return False
    part = slice_of(map_, number, inside)
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
    """Whether all is FREE within a distance along each axis and within an angle of configurations.

    Gives the index of the first configuration that is not usable, or -1.
    """
    for k in range(points.shape[0]):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = around_is_free(map_, q, distance, angle)
    return -1


@kernel
def around_is_free(map_: Map, q: Numbers, distance: float, angle: float) -> bool:
    """The same of one configuration that is usable."""
    cursor = map_.rotations.first_around(q, angle)
    while True:
        more, number, cursor = map_.rotations.next_around(cursor)
        if not more:
            return True
        if not box_is_free(map_, number, q, distance):
            return False

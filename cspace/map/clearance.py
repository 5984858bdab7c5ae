"""Clearance: proven distances to the nearest configuration that is not FREE.

The search uses the marks of :mod:`cspace.map.mip` and keeps no data. It proceeds from the configuration
outwards, first over large blocks of cells. It opens only marked blocks that are nearer than the nearest cell so far.
Positions are in cells along three axes; the plane is space with one layer of cells.

*Inflation* is the largest clearance of a robot in each cell of the plane over all rotations. Clearance is measured from
the center of a cell to the nearest cell that is not FREE, a closed square. In half cells, two cells k apart along an
axis are ``2 k - 1`` apart, so squared distances are exact integers. Distances within columns are computed first, then
the nearest of the columns around. Both end at a limit. A cell is skipped once an earlier slice has a larger clearance
there, because costs require few of all distances.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Floats, Ints, States, Words
from cspace.compiling import kernel
from cspace.errors import InputError
from cspace.grid import SLACK
from cspace.map.callbacks import callback
from cspace.map.derived import Lock
from cspace.map.mip import BLOCK_SHIFT, BLOCK_SIDE, ROWS_PER_BLOCK_ROW, OccupancyBits, PlaneMarks, SpaceMarks
from cspace.map.points import MAX_CELL, Cell, Numbers, configuration, is_usable, replaced, state_at
from cspace.map.storage import Map, Stack, zeros_above, zeros_below
from cspace.rotations.records import always_inline, compilable, dispatch_on_type
from cspace.threads import in_chunks

Position = tuple[float, float, float]

BYTE_MASK, LAST, ONE, EIGHT, SEVEN = np.uint64(255), np.uint64(63), np.uint64(1), np.uint64(8), np.uint64(7)

ALL_BITS, COLUMN = ~np.uint64(0), np.uint64(0x0101010101010101)
BIT_SHIFT, BYTE_SHIFT = np.uint64(0), np.uint64(3)
"""Shifts from the index of a cell or block to its first bit: one bit, or one byte, for each."""

BLOCK_SIZE: Final = float(BLOCK_SIDE)
NODE_SIZE: Final = BLOCK_SIZE * BLOCK_SIZE
"""Cells along each side of a block, and of a node, which is a block of blocks."""

WINDOW_CELLS_BELOW: Final = 4
"""Cells below the query cell, per axis, in the window searched first."""

WINDOW_SQUARE: Final = (BLOCK_SIZE - WINDOW_CELLS_BELOW - 1.0) ** 2
"""Squared distance within which that window has every cell."""

CENTER_BIT: Final = 31
"""Bit of the query block in a word of the blocks of a row around it."""

NEAR_BLOCKS: Final = np.uint64(0x7F << (CENTER_BIT - 3))
"""Bits of the blocks whose cells are all in words of cells around the query cell."""

NO_CELL: Final = 2**40
"""Index of a cell that is farther away than any other."""

ROWS_SQUARE: Final = ((CENTER_BIT - 1) * BLOCK_SIZE) ** 2
"""Squared distance within which words around the query cell show every cell."""

CLEARANCE_ROUNDING: Final = 2.0**-40
"""Relative increase of a distance that must not be below the true one despite rounding."""


@kernel
def clearance_at(map_: Map, marks: OccupancyBits, q: Numbers, upper_bound: float) -> float:
    """Return a lower bound of the clearance, in cells.

    Clearance is the distance, at one rotation, from configuration `q` to the nearest configuration that is not FREE.
    ``upper_bound`` is a known upper bound of the result, in cells, or infinity.
    """
    if state_at(map_, q) != FREE:
        return 0.0
    s, dim, position = map_.rotations.slice_at(q), len(map_.lower), (0.5, 0.5, 0.5)
    to_border = math.inf
    for axis in range(dim):
        # Positions beyond the limit are equally far from everything.
        coordinate = min(max((q[axis] - map_.lower[axis]) / map_.spacing, -MAX_CELL), MAX_CELL)
        to_border = min(to_border, coordinate, map_.states.shape[axis + 1] - coordinate)
        position = replaced(position, 3 - dim + axis, coordinate)
    # In cluttered maps the nearest cells suffice.
    best, searched = upper_bound * upper_bound, 0.0
    if to_border > 0.0:
        searched, best = search_nearby(marks, s, position, best)
    if not best < to_border * abs(to_border):
        best = min(best, square_outside(map_, s, position))
    if best > searched:
        best = search_nodes(marks, s, position, best)
    return max(0.0, math.sqrt(best) * (1.0 - 2.0**-48) - 4.0 * SLACK)


@kernel
def square_outside(map_: Map, s: int, position: Position) -> float:
    """Return the squared distance to non-FREE cells outside the grid.

    The distance, in cells, is that from ``position``, in cells along three axes, in slice `s`. The result is infinite
    if the exterior is FREE.
    """
    dim, best = len(map_.lower), math.inf
    for side in range(2 * dim):
        square, empty = 0.0, False
        for axis in range(dim):
            low, high = range_outside(map_.exterior, map_.states.shape, s, side, axis)
            empty |= low >= high
            gap_along = max(0.0, low - position[3 - dim + axis], position[3 - dim + axis] - high)
            square += gap_along * gap_along
        if not empty:
            best = min(best, square)
    return best


@always_inline
def range_outside(exterior: Ints, shape: tuple[int, ...], s: int, side: int, axis: int) -> tuple[float, float]:
    """Return the range, along an axis, of non-FREE cells beyond a side of the grid.

    ``shape`` has the slices, and the cells of the grid; sides ``2 * axis`` and ``2 * axis + 1`` are the lower and the
    upper one along an axis. The range, in cells, is infinite where nothing bounds it, and empty if its first end is
    not below its second. These ranges of one side make a box; the boxes of all sides are all non-FREE cells outside.
    """
    dim, low, high = len(shape) - 1, -math.inf, math.inf
    if exterior[s, 2 * dim] == FREE:
        low, high = float(exterior[s, axis]), exterior[s, dim + axis] + 1.0
    if side == 2 * axis:
        high = min(high, 0.0)
    elif side == 2 * axis + 1:
        low = max(low, float(shape[axis + 1]))
    return low, high


# ---- the nearest cell ------------------------------------------------------------------------------------------------
#
# At each scale (node, block, cell), words are visited in order of distance, layer by layer and row by row. In each word
# the nearest non-zero byte comes first. Whatever is no nearer than the best cell so far is skipped.


def search_nearby(marks: OccupancyBits, s: int, position: Position, best: float) -> tuple[float, float]:
    """Search the cells near a position in the grid.

    In slice `s`, return the squared distance within which the search is complete, and the squared distance to the
    nearest marked cell found, or ``best``. Distances are in cells.
    """
    raise NotImplementedError


def _search_nearby_in_space(marks: SpaceMarks, s: int, position: Position, best: float) -> tuple[float, float]:
    """Search the window around a position, if its block is marked."""
    i, j, k = int(position[0]) >> BLOCK_SHIFT, int(position[1]) >> BLOCK_SHIFT, int(position[2]) >> BLOCK_SHIFT
    word = marks.blocks[s, i >> BLOCK_SHIFT, j >> BLOCK_SHIFT, k >> BLOCK_SHIFT, i & (BLOCK_SIDE - 1)]
    if (word >> np.uint64(((k & (BLOCK_SIDE - 1)) << BLOCK_SHIFT) + (j & (BLOCK_SIDE - 1)))) & ONE:
        return WINDOW_SQUARE, search_window(marks, s, position, best)
    return 0.0, best


def _search_nearby_in_plane(marks: PlaneMarks, s: int, position: Position, best: float) -> tuple[float, float]:
    # In an empty neighborhood, scanning rows is wasted.
    """Search the rows around a position, if its node is marked."""
    if marks.nodes[s, 0, int(position[1]) >> 2 * BLOCK_SHIFT, int(position[2]) >> 3 * BLOCK_SHIFT] == 0:
        return 0.0, best
    return ROWS_SQUARE, search_rows(marks, s, position, best)


@kernel
def search_window(marks: SpaceMarks, s: int, position: Position, best: float) -> float:
    """Search eight cells per axis around a position.

    Return the squared distance to the nearest marked cell in slice `s`, in cells, at most ``best``.
    """
    _, count, wide, long, _ = marks.cells.shape
    first_x, first_y = int(position[0]) - WINDOW_CELLS_BELOW, int(position[1]) - WINDOW_CELLS_BELOW
    first_z = int(position[2]) - WINDOW_CELLS_BELOW
    stop_x, first_x, b, c = (
        min(first_x + BLOCK_SIDE, BLOCK_SIDE * count),
        max(first_x, 0),
        first_y >> BLOCK_SHIFT,
        first_z >> BLOCK_SHIFT,
    )
    # Cut the 8 x 8 window out of four words.
    low_y, low_z = np.uint64(first_y & (BLOCK_SIDE - 1)), np.uint64((first_z & (BLOCK_SIDE - 1)) << BLOCK_SHIFT)
    mask = (BYTE_MASK >> low_y) * COLUMN
    below_x, above_x = start_outward(position[0], 1.0, first_x, stop_x)
    while True:
        i, x_gap, below_x, above_x = next_nearest(position[0], 1.0, first_x, stop_x, below_x, above_x)
        if not x_gap * x_gap < best:
            return best
        word = np.uint64(0)
        for n in range(max(b, 0), min(b + 2, wide)):
            column = np.uint64(0)
            for m in range(max(c, 0), min(c + 2, long)):
                cells = marks.cells[s, i >> BLOCK_SHIFT, n, m, i & (BLOCK_SIDE - 1)]
                column |= cells >> low_z if m == c else cells << EIGHT << (LAST - SEVEN - low_z)
            if n == b:
                word |= (column >> low_y) & mask
            else:
                word |= (column << (EIGHT - low_y)) & ~mask
        best = search_word(word, position, (first_y, first_z), x_gap * x_gap, 0.0, best)


@kernel
def search_rows(marks: PlaneMarks, s: int, position: Position, best: float) -> float:
    """Search the plane by rows of blocks.

    The search goes as far as words around the position reach. Return the squared distance to the nearest marked cell in
    slice `s`, in cells, at most ``best``.
    """
    y, block, count = (
        int(position[1]) >> BLOCK_SHIFT,
        int(position[2]) >> BLOCK_SHIFT,
        marks.cells.shape[1] // ROWS_PER_BLOCK_ROW,
    )
    for k in range(2 * CENTER_BIT):
        j = y - ((k + 1) >> 1) if k & 1 else y + (k >> 1)
        y_gap = gap(position[1], j, BLOCK_SIZE)
        square = y_gap * y_gap
        if not square < best:
            if k & 1 == 0:  # all rows that follow are farther
                return best
            continue
        if not 0 <= j < count:
            continue
        word = read_word(marks.cells[s, ROWS_PER_BLOCK_ROW * j + BLOCK_SIDE], block - CENTER_BIT)
        if word & NEAR_BLOCKS and k < BLOCK_SIDE:
            best = search_block_row(marks, s, j, position, best)
            word &= ~NEAR_BLOCKS
        upper, lower = word >> np.uint64(CENTER_BIT), word << np.uint64(BLOCK_SIDE * BLOCK_SIDE - CENTER_BIT)
        if upper != 0:
            n = block + int(np.int64(zeros_below(upper)))
            z_gap = gap(position[2], n, BLOCK_SIZE)
            if square + z_gap * z_gap < best:
                best = search_row_from(marks, s, j, n, position, best)
        if lower != 0:
            n = block - 1 - int(np.int64(zeros_above(lower)))
            z_gap = gap(position[2], n, BLOCK_SIZE)
            if square + z_gap * z_gap < best:
                best = search_row_from(marks, s, j, n, position, best)
    return best


@always_inline
def search_block_row(marks: PlaneMarks, s: int, block: int, position: Position, best: float) -> float:
    """Search eight rows of cells in a marked block row.

    Return the squared distance to the nearest marked cell, in cells, at most ``best``. There are no branches, because
    they would be unpredictable. A word without a mark counts as a cell 32 cells away, farther than the mark nearby.
    """
    z, up, down = int(position[2]), np.uint64(CENTER_BIT), np.uint64(LAST) - np.uint64(CENTER_BIT)
    for k in range(BLOCK_SIDE):
        word = read_word(marks.cells[s, ROWS_PER_BLOCK_ROW * block + k], z - CENTER_BIT)
        above: int = np.int64(zeros_below(word >> up))  # type: ignore[assignment]
        below: int = np.int64(zeros_above(word << down))  # type: ignore[assignment]
        y_gap, z_gap = (
            gap(position[1], BLOCK_SIDE * block + k, 1.0),
            max(0.0, min(z + above - position[2], position[2] - z + below - 1)),
        )
        best = min(best, y_gap * y_gap + z_gap * z_gap)
    return best


@kernel
def search_row_from(marks: PlaneMarks, s: int, row: int, block: int, position: Position, best: float) -> float:
    """Search a row of blocks, away from the position.

    The search begins at block ``block`` of row ``row``. Return the squared distance to the nearest marked cell, in
    cells, at most ``best``.
    """
    z, first, last = int(position[2]), block << BLOCK_SHIFT, (block << BLOCK_SHIFT) + BLOCK_SIDE - 1
    if last + 1 >= position[2]:
        first = max(first, z)
        for k in range(BLOCK_SIDE):
            word = read_word(marks.cells[s, ROWS_PER_BLOCK_ROW * row + k], first)
            cell = first + np.int64(zeros_below(word)) if word != 0 else NO_CELL
            y_gap, z_gap = gap(position[1], BLOCK_SIDE * row + k, 1.0), max(0.0, cell - position[2])
            best = min(best, y_gap * y_gap + z_gap * z_gap)
    if first <= position[2]:
        last = min(last, z)
        for k in range(BLOCK_SIDE):
            word = read_word(marks.cells[s, ROWS_PER_BLOCK_ROW * row + k], last + 1 - BLOCK_SIDE * BLOCK_SIDE)
            cell = last - np.int64(zeros_above(word)) if word != 0 else -NO_CELL
            y_gap, z_gap = gap(position[1], BLOCK_SIDE * row + k, 1.0), max(0.0, position[2] - cell - 1)
            best = min(best, y_gap * y_gap + z_gap * z_gap)
    return best


@always_inline
def read_word(row: Words, index: int) -> np.uint64:
    """Read 64 bits of a row from an index on.

    The index may be as low as -64.
    """
    word_index, shift = (index + 64) >> 6, np.uint64(index & 63)
    word: np.uint64 = row[word_index] >> shift | row[word_index + 1] << ONE << (LAST - shift)
    return word


@always_inline
def search_nodes(marks: OccupancyBits, s: int, position: Position, best: float) -> float:
    """Search all nodes of a slice, nearest first.

    Return the squared distance to the nearest marked cell, in cells, at most ``best``.
    """
    _, nx, ny, nz = marks.nodes.shape
    below_x, above_x = start_outward(position[0], NODE_SIZE, 0, nx)
    while True:
        i, x_gap, below_x, above_x = next_nearest(position[0], NODE_SIZE, 0, nx, below_x, above_x)
        if not x_gap * x_gap < best:
            return best
        below_y, above_y = start_outward(position[1], NODE_SIZE, 0, ny)
        while True:
            j, y_gap, below_y, above_y = next_nearest(position[1], NODE_SIZE, 0, ny, below_y, above_y)
            square = x_gap * x_gap + y_gap * y_gap
            if not square < best:
                break
            below_z, above_z = start_outward(position[2], BLOCK_SIZE * NODE_SIZE, 0, nz)
            while True:
                k, z_gap, below_z, above_z = next_nearest(position[2], BLOCK_SIZE * NODE_SIZE, 0, nz, below_z, above_z)
                if not square + z_gap * z_gap < best:
                    break
                word = marks.nodes[s, i, j, k]
                while word != 0:
                    n, gap_along = find_nearest_part(word, BYTE_SHIFT, position[2], NODE_SIZE, BLOCK_SIDE * k)
                    if not square + gap_along * gap_along < best:
                        break
                    gaps = y_gap * y_gap, gap_along * gap_along
                    best = search_node(marks, s, (i, j, BLOCK_SIDE * k + n), position, gaps, best)
                    word &= ~(BYTE_MASK << np.uint64(8 * n))


@always_inline
def search_node(
    marks: OccupancyBits, s: int, node: Cell, position: Position, gaps: tuple[float, float], best: float
) -> float:
    """Search a node, which is a block of blocks.

    ``gaps`` are the squared distances to the node along y and z, in cells. Return the squared distance to the nearest
    marked cell, at most ``best``.
    """
    layers = marks.blocks[s, node[0], node[1], node[2]]
    first_x, first_y, first_z = node[0] * layers.shape[0], node[1] << BLOCK_SHIFT, node[2] << BLOCK_SHIFT
    last_x, seen, known = first_x + layers.shape[0], ALL_BITS, math.inf
    y_min, z_min = gaps
    below_x, above_x = start_outward(position[0], BLOCK_SIZE, first_x, last_x)
    while True:
        i, x_gap, below_x, above_x = next_nearest(position[0], BLOCK_SIZE, first_x, last_x, below_x, above_x)
        x_square = x_gap * x_gap
        if not x_square + y_min + z_min < best:
            return best
        word = layers[i - first_x]
        if word != 0 and best < known:
            # Later layers are farther, so bits outside the window stay too far.
            seen, known = near_bits(marks, node, position, x_square, gaps, best), best
        word &= seen
        while word != 0:
            n, z_gap = find_nearest_part(word, BYTE_SHIFT, position[2], BLOCK_SIZE, first_z)
            square = x_square + z_gap * z_gap
            if not square + y_min < best:
                break
            column = (word >> np.uint64(8 * n)) & BYTE_MASK
            while column != 0:
                m, y_gap = find_nearest_part(column, BIT_SHIFT, position[1], BLOCK_SIZE, first_y)
                if not square + y_gap * y_gap < best:
                    break
                best = search_block(marks, s, (i, first_y + m, first_z + n), position, best)
                column &= ~(ONE << np.uint64(m))
            word &= ~(BYTE_MASK << np.uint64(8 * n))


def near_bits(
    marks: OccupancyBits, node: Cell, position: Position, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    """Return the bits of a layer that may be near enough.

    The layer of blocks in ``node`` has the squared distance ``x_square`` along x. Other bits are farther than the
    square root of ``best``.
    """
    raise NotImplementedError


def _near_bits_in_space(
    marks: SpaceMarks, node: Cell, position: Position, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    """Return the bits of the blocks that may be near enough."""
    return near_window(
        position,
        BLOCK_SIZE,
        node[1] << BLOCK_SHIFT,
        node[2] << BLOCK_SHIFT,
        best,
        x_square + gaps[1],
        x_square + gaps[0],
    )


def _near_bits_in_plane(
    marks: PlaneMarks, node: Cell, position: Position, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    """Return all bits."""
    return ALL_BITS  # scanning a single layer is faster than masking it


def search_block(marks: OccupancyBits, s: int, block: Cell, position: Position, best: float) -> float:
    """Search a block of cells.

    Return the squared distance to the nearest marked cell, in cells, at most ``best``.
    """
    raise NotImplementedError


def _search_block_in_plane(marks: PlaneMarks, s: int, block: Cell, position: Position, best: float) -> float:
    """Search the row of blocks that has the block."""
    return search_row_from(marks, s, block[1], block[2], position, best)


def _search_block_in_space(marks: SpaceMarks, s: int, block: Cell, position: Position, best: float) -> float:
    """Search a block layer by layer, nearest first."""
    layers = marks.cells[s, block[0], block[1], block[2]]
    first_x, first_y, first_z = block[0] * layers.shape[0], block[1] << BLOCK_SHIFT, block[2] << BLOCK_SHIFT
    last_x, seen = first_x + layers.shape[0], np.uint64(0)
    y_min, z_min = bound_squares(layers, position, 1.0, first_y, first_z)
    below_x, above_x = start_outward(position[0], 1.0, first_x, last_x)
    while True:
        i, x_gap, below_x, above_x = next_nearest(position[0], 1.0, first_x, last_x, below_x, above_x)
        x_square = x_gap * x_gap
        if not x_square + y_min + z_min < best:
            return best
        word = layers[i - first_x]
        if word != 0:
            if seen == 0:  # once is enough for cells
                seen = near_window(position, 1.0, first_y, first_z, best, x_square + z_min, x_square + y_min)
            word &= seen
        best = search_word(word, position, (first_y, first_z), x_square, y_min, best)


dispatch_on_type(search_nearby, {SpaceMarks: _search_nearby_in_space, PlaneMarks: _search_nearby_in_plane})
dispatch_on_type(near_bits, {SpaceMarks: _near_bits_in_space, PlaneMarks: _near_bits_in_plane})
dispatch_on_type(search_block, {SpaceMarks: _search_block_in_space, PlaneMarks: _search_block_in_plane})


@always_inline
def search_word(
    word: np.uint64, position: Position, first: tuple[int, int], x_square: float, y_min: float, best: float
) -> float:
    """Search a word of 8 x 8 cells.

    Its first cell along y and z is ``first``, and its layer has the squared distance ``x_square``. ``y_min`` is a lower
    bound of squared distances along y. Return the squared distance to the nearest marked cell, at most ``best``.
    """
    while word != 0:
        n, z_gap = find_nearest_part(word, BYTE_SHIFT, position[2], 1.0, first[1])
        square = x_square + z_gap * z_gap
        if not square + y_min < best:
            return best
        column = (word >> np.uint64(8 * n)) & BYTE_MASK
        _, y_gap = find_nearest_part(column, BIT_SHIFT, position[1], 1.0, first[0])
        best = min(best, square + y_gap * y_gap)
        word &= ~(BYTE_MASK << np.uint64(8 * n))
    return best


@always_inline
def bound_squares(layers: Words, position: Position, size: float, first_y: int, first_z: int) -> tuple[float, float]:
    """Return squared distances along y and z to the nearest mark.

    ``size`` is the size of a cell or block, in cells; both are infinite if no layer has a mark.
    """
    union = np.uint64(0)
    for layer in layers:
        union |= layer
    if union == 0:
        return math.inf, math.inf
    _, z_gap = find_nearest_part(union, BYTE_SHIFT, position[2], size, first_z)
    union |= union >> np.uint64(32)
    union |= union >> np.uint64(16)
    union |= union >> np.uint64(8)
    _, y_gap = find_nearest_part(union & BYTE_MASK, BIT_SHIFT, position[1], size, first_y)
    return y_gap * y_gap, z_gap * z_gap


@always_inline
def near_window(
    position: Position, size: float, first_y: int, first_z: int, best: float, other_y: float, other_z: float
) -> np.uint64:
    """Return a mask of the cells that may be near.

    The cells are those of a word, 8 x 8 along y and z. They may be nearer to the position than the square root of
    ``best``. ``other_y`` and ``other_z`` are lower bounds of the amount that the other axes add to squared distances
    along y and along z.
    """
    low_y, high_y = near_range(position[1], size, first_y, best, other_y)
    low_z, high_z = near_range(position[2], size, first_z, best, other_z)
    column = BYTE_MASK >> np.uint64(BLOCK_SIDE - 1 + low_y - high_y) << np.uint64(low_y)
    layer = ALL_BITS >> np.uint64(BLOCK_SIDE * (BLOCK_SIDE - 1 + low_z - high_z)) << np.uint64(BLOCK_SIDE * low_z)
    return (column * COLUMN) & layer


@always_inline
def near_range(position: float, size: float, first: int, best: float, other: float) -> tuple[int, int]:
    """Return the range of eight blocks that may be near enough.

    The blocks begin at index ``first`` along an axis. ``other`` is the part of squared distances along other axes.
    Bounds are widened, so that rounding loses none.
    """
    reach = math.sqrt(max(best * (1.0 + CLEARANCE_ROUNDING) - other, 0.0)) / size + CLEARANCE_ROUNDING
    at = position / size - first
    return int(min(max(at - reach, 0.0), BLOCK_SIZE - 1.0)), int(min(max(at + reach, 0.0), BLOCK_SIZE - 1.0))


@always_inline
def gap(position: float, index: int, size: float) -> float:
    """Return the distance from a position to a block.

    Both lie along one axis; block ``index`` has ``size`` cells.
    """
    return max(0.0, index * size - position, position - (index + 1) * size)


@always_inline
def start_outward(position: float, size: float, first: int, stop: int) -> tuple[int, int]:
    """Return the indices below and above a position.

    Both lie within ``first`` and ``stop``, or just outside.
    """
    above = int(min(max(position / size, float(first)), stop - 1.0))
    return above - 1, above


@always_inline
def next_nearest(
    position: float, size: float, first: int, stop: int, below: int, above: int
) -> tuple[int, float, int, int]:
    """Return the nearer of the next blocks.

    The result is its index, its distance, and the next indices below and above.
    """
    low = gap(position, below, size) if below >= first else math.inf
    high = gap(position, above, size) if above < stop else math.inf
    if low <= high:
        return below, low, below - 1, above
    return above, high, below, above + 1


@always_inline
def find_nearest_part(word: np.uint64, wide: np.uint64, position: float, size: float, first: int) -> tuple[int, float]:
    """Return the nearest of eight marked blocks, and its distance.

    ``wide`` is BYTE_SHIFT if each block has a byte of the word, BIT_SHIFT if it has a bit.
    """
    at = np.uint64(min(max(int(position / size) - first, 0), BLOCK_SIDE - 1)) << wide
    upper, lower = word >> at << at, word & ((ONE << at) - ONE)
    above: int = np.int64(zeros_below(upper) >> wide)  # type: ignore[assignment]
    below: int = np.int64((LAST - zeros_above(lower)) >> wide)  # type: ignore[assignment]
    high = gap(position, first + above, size) if upper != 0 else math.inf
    low = gap(position, first + below, size) if lower != 0 else math.inf
    return (below, low) if low < high else (above, high)


@kernel
def clearances(map_: Map, marks: OccupancyBits, points: Floats, out: Floats) -> int:
    """Compute clearances of configurations, shape (n, size), in metres.

    Return the index of the first unusable configuration, or -1.
    """
    last, dim = map_.lower + map_.rotations.zeros(), len(map_.lower)
    known = math.inf
    for n in range(points.shape[0]):
        q = configuration(map_, points, n)
        if not is_usable(map_, q):
            return n
        # Clearance is 1-Lipschitz at the same rotation, so the previous clearance bounds this one.
        upper_bound = math.inf
        if map_.rotations.slice_at(q) == map_.rotations.slice_at(last):
            square = 0.0
            for axis in range(dim):
                square += ((q[axis] - last[axis]) / map_.spacing) ** 2
            upper_bound = (known + 8.0 * SLACK + math.sqrt(square)) * (1.0 + CLEARANCE_ROUNDING)
        known, last = clearance_at(map_, marks, q, upper_bound), q
        out[n] = known * map_.spacing
    return -1


@compilable
class Clearance(NamedTuple):
    """Query for the clearance of a configuration, in metres."""

    map_: Map
    marks: OccupancyBits

    def evaluate(self, q: Numbers) -> float:
        """Return the clearance of a usable configuration, in metres."""
        return clearance_at(self.map_, self.marks, q, math.inf) * self.map_.spacing


def checker(map_: Map, marks: OccupancyBits, size: int) -> Callable[..., float]:
    """Return a fast clearance function of one configuration's coordinates.

    It follows all changes of the map.
    """
    return callback(Clearance(map_, marks), size)


Squares = NDArray[np.int32]

MAX_REACH_CELLS: Final = 16_000
"""Largest distance, in cells, for which the sum of two squares in half cells fits 32 bits."""

ROWS_PER_STRIP: Final = 64
"""Rows of cells computed together, so that their scratch stays in the cache."""

MIN_ROWS_PER_THREAD: Final = 16
"""Rows of cells below which a second thread costs more than it saves."""

SLICES_PER_BATCH: Final = 8
"""Number of packed slices unpacked together."""

MAX_DIRTY_WINDOWS: Final = 32
"""Changed windows recorded separately; beyond that number, their bounding window is."""


class Inflation:
    """Largest clearances over all slices, in the plane.

    The states and the exterior table are shared, not copied. The lock is held during updates of the map, and while
    clearances are computed.
    """

    def __init__(self, states: Stack, exterior: Ints, lock: Lock) -> None:
        self._states, self._exterior, self._lock = states, exterior, lock
        self._squares = np.empty(states.shape[1:], dtype=np.int32)
        self._reach, self._seen, self._dirty_windows = -1, exterior.copy(), list[Ints]()

    def refresh(self, boxes: Ints) -> None:
        """Record boxes of changed states, shape (slices, 6)."""
        changed = boxes[(boxes[:, :3] <= boxes[:, 3:]).all(axis=1)]
        if len(changed):
            self._dirty_windows.append(np.array([changed[:, 1:3].min(axis=0), changed[:, 4:].max(axis=0) + 1]))
        if len(self._dirty_windows) > MAX_DIRTY_WINDOWS:
            self._dirty_windows = [_bounding_window(self._dirty_windows)]

    def clearances(self, limit: float) -> Floats:
        """Return clearances in cells, infinite above ``limit``.

        Raises InputError if the limit and the map exceed :data:`MAX_REACH_CELLS` cells.
        """
        with self._lock:
            reach = compute_reach(limit, self._squares.shape, self._exterior)
            if reach != self._reach or not np.array_equal(self._seen, self._exterior):
                self._reach, self._seen = reach, self._exterior.copy()
                self._dirty_windows = [np.array([(0, 0), self._squares.shape])]
            grown = np.array([[-reach], [reach]])
            for changed in self._dirty_windows:
                # Cells farther from the change than the reach keep their squares.
                update_squares(self._states, self._exterior, reach, changed + grown, self._squares)
            self._dirty_windows = []
            return to_cells(self._squares, reach)


def slice_clearances(states: States, exterior: Ints, limit: float) -> Floats:
    """Return the clearances (nx, ny) of one slice.

    See :meth:`Inflation.clearances`.
    """
    reach, squares = compute_reach(limit, states.shape, exterior), np.empty(states.shape, dtype=np.int32)
    update_squares(states[np.newaxis], exterior[np.newaxis], reach, np.array([(0, 0), states.shape]), squares)
    return to_cells(squares, reach)


def compute_reach(limit: float, shape: Sequence[int], exterior: Ints) -> int:
    """Return the search radius in cells.

    It is the limit, or the distance of the farthest non-FREE cell.
    """
    boxes = exterior.reshape(-1, exterior.shape[-1])[:, :-1].reshape(-1, 2, len(shape))
    farthest = np.maximum(boxes[:, 1], shape).max() - min(int(boxes[:, 0].min()), 0)
    reach = int(min(math.ceil(max(limit, 0.0)), farthest))
    if reach > MAX_REACH_CELLS:
        problem, rule = f"reaches {reach} cells beyond the robot", f"the maximum is {MAX_REACH_CELLS} cells"
        raise InputError("inflation_radius", problem, rule, "pass a smaller radius, or part of the map", value=limit)
    return reach


def to_cells(squares: Squares, reach: int) -> Floats:
    """Convert squares to distances in cells, rounded down.

    Rounding is as in :func:`cspace.map.clearance.clearance_at`.
    """
    cells = np.maximum(0.5 * np.sqrt(squares) * (1.0 - 2.0**-48) - 4.0 * SLACK, 0.0)
    cells[squares == (2 * reach + 1) ** 2] = np.inf
    return np.asarray(cells)


def update_squares(states: Stack, exterior: Ints, reach: int, changed: Ints, out: Squares) -> None:
    """Recompute the largest squares in a window of ``out``.

    ``changed`` has the first cell, and the cell after the last, of the window.
    """
    first_cell, stop_cell = np.maximum(changed[0], 0).tolist(), np.minimum(changed[1], out.shape).tolist()
    squares = out[first_cell[0] : stop_cell[0], first_cell[1] : stop_cell[1]]
    squares[...] = 0
    for start_slice, batch in _unpack_batches(states):
        table = exterior[start_slice : start_slice + len(batch)]

        def raise_strips(start: int, stop: int, batch: States = batch, table: Ints = table) -> int:
            rows, width = min(ROWS_PER_STRIP, stop - start), squares.shape[1] + 2 * reach
            counts, line, row = np.empty((rows, width), np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
            mask, best = np.empty(width, np.uint8), np.empty(squares.shape[1], np.int32)
            for begin in range(start, stop, ROWS_PER_STRIP):
                strip = squares[begin : min(begin + ROWS_PER_STRIP, stop)]
                corner = (first_cell[0] + begin, first_cell[1])
                raise_squares(batch, table, reach, corner, (counts, line, row, mask, best), strip)
            return -1

        in_chunks(raise_strips, len(squares), MIN_ROWS_PER_THREAD)


def _unpack_batches(states: Stack) -> Iterator[tuple[int, States]]:
    """Yield slices as bytes, in batches with first indices."""
    if isinstance(states, np.ndarray):
        yield 0, states
        return
    for first in range(0, len(states), SLICES_PER_BATCH):
        yield first, states[first : first + SLICES_PER_BATCH]


def _bounding_window(windows: list[Ints]) -> Ints:
    """Return the bounding window of windows."""
    bounds = np.array(windows)
    return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


@kernel
def raise_squares(
    states: States,
    exterior: Ints,
    reach: int,
    corner: tuple[int, int],
    scratch: tuple[Squares, Squares, Squares, States, Squares],
    out: Squares,
) -> None:
    """Raise squares (nx, ny) to the maximum over slices.

    ``corner`` is the window's first cell.
    """
    counts, line, row, mask, best = scratch
    nx, ny = out.shape
    cap, width, top = np.int32(reach + 1), ny + 2 * reach, np.int32((2 * reach + 1) ** 2)
    for s in range(len(states)):
        # Distance to the nearest non-FREE cell in the same column, from below and from above.
        for backwards in range(2):
            line[:] = cap
            for step in range(nx + reach):
                x = step - reach if backwards == 0 else nx - 1 + reach - step
                read_row(states[s], exterior[s], corner[0] + x, corner[1] - reach, mask)
                for k in range(width):
                    more = min(np.int32(line[k] + np.int32(1)), cap)
                    line[k] = np.int32(0) if mask[k] != FREE else more
                if step >= reach:
                    column_cells = counts[x]
                    for k in range(width):
                        column_cells[k] = line[k] if backwards == 0 else min(column_cells[k], line[k])
        for x in range(nx):
            column_cells, result = counts[x], out[x]
            for k in range(width):
                half = np.int32(np.int32(2) * column_cells[k] - np.int32(1))
                row[k] = np.int32(half * half) if column_cells[k] > 0 else np.int32(0)
            center = row[reach : reach + ny]
            for k in range(ny):
                best[k] = center[k]
            for distance in range(1, reach + 1):
                step_square = np.int32((2 * distance - 1) ** 2)
                open_ = np.int32(0)
                for k in range(ny):
                    open_ |= np.int32(best[k] > max(result[k], step_square))
                if open_ == 0:
                    break
                left = row[reach - distance : reach - distance + ny]
                right = row[reach + distance : reach + distance + ny]
                for k in range(ny):
                    best[k] = min(best[k], np.int32(min(left[k], right[k]) + step_square))
            for k in range(ny):
                result[k] = max(result[k], min(best[k], top))


@kernel
def read_row(states: States, table: Ints, x: int, y: int, mask: States) -> None:
    """Copy the states of a row of cells.

    The row begins at ``(x, y)``; ``mask`` receives the states. Cells outside the grid get 0 if they are FREE, otherwise
    1. ``table`` has the first and last cell of the box of MIXED cells there, and the state of the others; see
    :class:`cspace.map.exterior.Exterior`.
    """
    nx, ny = states.shape
    before, stop = min(max(-y, 0), len(mask)), min(max(ny - y, 0), len(mask))
    if x < 0 or x >= nx:
        before, stop = len(mask), len(mask)
    outside = table[4] != FREE
    for k in range(before):
        mask[k] = outside or (table[0] <= x <= table[2] and table[1] <= y + k <= table[3])
    for k in range(stop, len(mask)):
        mask[k] = outside or (table[0] <= x <= table[2] and table[1] <= y + k <= table[3])
    if before < stop:
        cells, inside = states[x, y + before : y + stop], mask[before:stop]
        for k in range(len(inside)):
            inside[k] = cells[k]

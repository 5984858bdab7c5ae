"""Clearance: proven distances to the nearest configuration that is not FREE.

Nothing is kept for it but the marks of :mod:`cspace.map.mip`. The nearest cell is searched from the configuration
outwards: first among large blocks of cells, and only those that are not all FREE, and nearer than the best cell so far,
are looked into. Places are counted in cells, along three axes; the plane is space with one layer of cells.

*Inflation* is the largest clearance that a robot has in each cell of the plane, over all of its rotations.
Clearance is counted from the middle of a cell to the nearest cell that is not FREE, a closed square. In half cells, two
cells that are k cells apart along an axis are ``2 k - 1`` apart, so that squares of distances are exact integers.
Distances within columns come first, then the nearest of the columns around. Both end at a limit, and a cell is skipped
as soon as a slice before has a larger clearance there: for costs, few of all distances are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Floats, Ints, States, Words
from cspace.compiling import always_inline, compilable, dispatch_on_type, kernel
from cspace.errors import InputError
from cspace.grid import SLACK
from cspace.map.callbacks import callback
from cspace.map.derived import Lock
from cspace.map.mip import ROWS, SHIFT, SIDE, OccupancyBits, PlaneMarks, SpaceMarks
from cspace.map.points import FAR, Cell, Numbers, configuration, is_usable, replaced, state_at
from cspace.map.storage import Map, Stack, zeros_above, zeros_below
from cspace.threads import in_chunks

Place = tuple[float, float, float]

ALL, LAST, ONE, EIGHT, SEVEN = np.uint64(255), np.uint64(63), np.uint64(1), np.uint64(8), np.uint64(7)

EVERY, COLUMN = ~np.uint64(0), np.uint64(0x0101010101010101)
BIT, BYTE = np.uint64(0), np.uint64(3)
"""Binary logarithms of how many bits of a word stand for a block or a cell."""

SIZE: Final = float(SIDE)
NODE: Final = SIZE * SIZE
"""Cells along each side of a block, and of a block of blocks."""

AHEAD: Final = 4
"""Cells before the one of a place that are looked at first."""

NEAR: Final = (SIZE - AHEAD - 1.0) ** 2
"""Squared distance below which these, and as many behind them, are all."""

MIDDLE: Final = 31
"""The bit of the block of a place in a word of a row of blocks around it."""

AROUND: Final = np.uint64(0x7F << (MIDDLE - 3))
"""The bits of the blocks all of whose cells are in words of rows of cells around the place."""

NONE: Final = 2**40
"""Number of a cell that is farther away than any."""

FAR_ROWS: Final = ((MIDDLE - 1) * SIZE) ** 2
"""Squared distance below which all is seen in words around a place."""

ROUNDING: Final = 2.0**-40
"""Share by which a distance is raised that must not be below the true one, whatever was rounded."""


@kernel
def clearance_at(map_: Map, marks: OccupancyBits, q: Numbers, most: float) -> float:
    """Lower bound of the distance from a configuration to the nearest one that is not FREE, in cells.

    ``most`` is known to be above it; infinity, if nothing is known.
    """
    if state_at(map_, q) != FREE:
        return 0.0
    s, dim, place = map_.rotations.states_at(q), len(map_.lower), (0.5, 0.5, 0.5)
    border = math.inf
    for axis in range(dim):
        # What is farther away is no nearer to anything.
        cells = min(max((q[axis] - map_.lower[axis]) / map_.spacing, -FAR), FAR)
        border = min(border, cells, map_.states.shape[axis + 1] - cells)
        place = replaced(place, 3 - dim + axis, cells)
    # Where much is not FREE, the nearest cells are enough.
    best, near = most * most, 0.0
    if border > 0.0:
        near, best = nearest_close(marks, s, place, best)
    if not best < border * abs(border):
        best = min(best, square_outside(map_, s, place))
    if best > near:
        best = nearest_square(marks, s, place, best)
    return max(0.0, math.sqrt(best) * (1.0 - 2.0**-48) - 4.0 * SLACK)


@kernel
def square_outside(map_: Map, s: int, place: Place) -> float:
    """Squared distance to what is not FREE outside the grid, in cells; infinite where all is."""
    dim, table = len(map_.lower), map_.exterior
    taken, best = table[s, 2 * dim] != FREE, math.inf
    for side in range(2 * dim):
        # A box as wide as what is not FREE, from one border of the grid on.
        square, empty = 0.0, False
        for axis in range(dim):
            low = -math.inf if taken else float(table[s, axis])
            high = math.inf if taken else table[s, dim + axis] + 1.0
            if side == 2 * axis:
                high = min(high, 0.0)
            elif side == 2 * axis + 1:
                low = max(low, float(map_.states.shape[axis + 1]))
            empty |= low >= high
            apart = max(0.0, low - place[3 - dim + axis], place[3 - dim + axis] - high)
            square += apart * apart
        if not empty:
            best = min(best, square)
    return best


# ---- the nearest cell ------------------------------------------------------------------------------------------------
#
# Words of eight are taken by their distance, layer by layer and row by row, and in each the nearest byte that is not
# zero: a block of blocks, a block, a cell. What is no nearer than the best cell so far is not looked into.


def nearest_close(marks: OccupancyBits, s: int, place: Place, best: float) -> tuple[float, float]:
    """The same of a place in the grid, of what is near, and the squared distance up to which that is all."""
    raise NotImplementedError


def _close_in_space(marks: SpaceMarks, s: int, place: Place, best: float) -> tuple[float, float]:
    i, j, k = int(place[0]) >> SHIFT, int(place[1]) >> SHIFT, int(place[2]) >> SHIFT
    word = marks.blocks[s, i >> SHIFT, j >> SHIFT, k >> SHIFT, i & (SIDE - 1)]
    if (word >> np.uint64(((k & (SIDE - 1)) << SHIFT) + (j & (SIDE - 1)))) & ONE:
        return NEAR, nearest_around(marks, s, place, best)
    return 0.0, best


def _close_in_plane(marks: PlaneMarks, s: int, place: Place, best: float) -> tuple[float, float]:
    # Where nothing is marked far and wide, rows would be gone through in vain.
    if marks.nodes[s, 0, int(place[1]) >> 2 * SHIFT, int(place[2]) >> 3 * SHIFT] == 0:
        return 0.0, best
    return FAR_ROWS, nearest_in_rows(marks, s, place, best)


@kernel
def nearest_around(marks: SpaceMarks, s: int, place: Place, best: float) -> float:
    """The same of the eight cells, along each axis, around a place in the grid."""
    _, count, wide, long, _ = marks.cells.shape
    first_x, first_y, first_z = int(place[0]) - AHEAD, int(place[1]) - AHEAD, int(place[2]) - AHEAD
    stop_x, first_x, b, c = min(first_x + SIDE, SIDE * count), max(first_x, 0), first_y >> SHIFT, first_z >> SHIFT
    # Of four words, what lies in the eight by eight cells.
    low_y, low_z = np.uint64(first_y & (SIDE - 1)), np.uint64((first_z & (SIDE - 1)) << SHIFT)
    mask = (ALL >> low_y) * COLUMN
    below_x, above_x = around(place[0], 1.0, first_x, stop_x)
    while True:
        i, x_gap, below_x, above_x = nearer(place[0], 1.0, first_x, stop_x, below_x, above_x)
        if not x_gap * x_gap < best:
            return best
        word = np.uint64(0)
        for n in range(max(b, 0), min(b + 2, wide)):
            column = np.uint64(0)
            for m in range(max(c, 0), min(c + 2, long)):
                cells = marks.cells[s, i >> SHIFT, n, m, i & (SIDE - 1)]
                column |= cells >> low_z if m == c else cells << EIGHT << (LAST - SEVEN - low_z)
            if n == b:
                word |= (column >> low_y) & mask
            else:
                word |= (column << (EIGHT - low_y)) & ~mask
        best = nearest_in_word(word, place, (first_y, first_z), x_gap * x_gap, 0.0, best)


@kernel
def nearest_in_rows(marks: PlaneMarks, s: int, place: Place, best: float) -> float:
    """The same of a place in the plane, row by row of blocks, as far as words around the place go."""
    y, number, count = int(place[1]) >> SHIFT, int(place[2]) >> SHIFT, marks.cells.shape[1] // ROWS
    for k in range(2 * MIDDLE):
        j = y - ((k + 1) >> 1) if k & 1 else y + (k >> 1)
        y_gap = gap(place[1], j, SIZE)
        square = y_gap * y_gap
        if not square < best:
            if k & 1 == 0:  # all that follow are farther than this one
                return best
            continue
        if not 0 <= j < count:
            continue
        word = word_from(marks.cells[s, ROWS * j + SIDE], number - MIDDLE)
        if word & AROUND and k < SIDE:
            best = nearest_in_eight(marks, s, j, place, best)
            word &= ~AROUND
        upper, lower = word >> np.uint64(MIDDLE), word << np.uint64(SIDE * SIDE - MIDDLE)
        if upper != 0:
            n = number + int(np.int64(zeros_below(upper)))
            z_gap = gap(place[2], n, SIZE)
            if square + z_gap * z_gap < best:
                best = nearest_in_row(marks, s, j, n, place, best)
        if lower != 0:
            n = number - 1 - int(np.int64(zeros_above(lower)))
            z_gap = gap(place[2], n, SIZE)
            if square + z_gap * z_gap < best:
                best = nearest_in_row(marks, s, j, n, place, best)
    return best


@always_inline
def nearest_in_eight(marks: PlaneMarks, s: int, block: int, place: Place, best: float) -> float:
    """The same of the eight rows of cells of a row of blocks, of which a cell near the place is marked.

    Without a branch, for none could be foretold: without a bit, the next cell is 32 away, farther than the one near.
    """
    z, up, down = int(place[2]), np.uint64(MIDDLE), np.uint64(LAST) - np.uint64(MIDDLE)
    for k in range(SIDE):
        word = word_from(marks.cells[s, ROWS * block + k], z - MIDDLE)
        above: int = np.int64(zeros_below(word >> up))  # type: ignore[assignment]
        below: int = np.int64(zeros_above(word << down))  # type: ignore[assignment]
        y_gap, z_gap = (
            gap(place[1], SIDE * block + k, 1.0),
            max(0.0, min(z + above - place[2], place[2] - z + below - 1)),
        )
        best = min(best, y_gap * y_gap + z_gap * z_gap)
    return best


@kernel
def nearest_in_row(marks: PlaneMarks, s: int, row: int, block: int, place: Place, best: float) -> float:
    """The same of a row of blocks in the plane, from a block on and away from the place."""
    z, first, last = int(place[2]), block << SHIFT, (block << SHIFT) + SIDE - 1
    if last + 1 >= place[2]:
        first = max(first, z)
        for k in range(SIDE):
            word = word_from(marks.cells[s, ROWS * row + k], first)
            cell = first + np.int64(zeros_below(word)) if word != 0 else NONE
            y_gap, z_gap = gap(place[1], SIDE * row + k, 1.0), max(0.0, cell - place[2])
            best = min(best, y_gap * y_gap + z_gap * z_gap)
    if first <= place[2]:
        last = min(last, z)
        for k in range(SIDE):
            word = word_from(marks.cells[s, ROWS * row + k], last + 1 - SIDE * SIDE)
            cell = last - np.int64(zeros_above(word)) if word != 0 else -NONE
            y_gap, z_gap = gap(place[1], SIDE * row + k, 1.0), max(0.0, place[2] - cell - 1)
            best = min(best, y_gap * y_gap + z_gap * z_gap)
    return best


@always_inline
def word_from(row: Words, number: int) -> np.uint64:
    """The 64 bits of a row of the plane from a cell, or a block, on; it may lie as many before the first one."""
    index, shift = (number + 64) >> 6, np.uint64(number & 63)
    word: np.uint64 = row[index] >> shift | row[index + 1] << ONE << (LAST - shift)
    return word


@always_inline
def nearest_square(marks: OccupancyBits, s: int, place: Place, best: float) -> float:
    """Squared distance to the nearest cell of a slice that is not FREE; ``best``, if that is less."""
    _, nx, ny, nz = marks.nodes.shape
    below_x, above_x = around(place[0], NODE, 0, nx)
    while True:
        i, x_gap, below_x, above_x = nearer(place[0], NODE, 0, nx, below_x, above_x)
        if not x_gap * x_gap < best:
            return best
        below_y, above_y = around(place[1], NODE, 0, ny)
        while True:
            j, y_gap, below_y, above_y = nearer(place[1], NODE, 0, ny, below_y, above_y)
            square = x_gap * x_gap + y_gap * y_gap
            if not square < best:
                break
            below_z, above_z = around(place[2], SIZE * NODE, 0, nz)
            while True:
                k, z_gap, below_z, above_z = nearer(place[2], SIZE * NODE, 0, nz, below_z, above_z)
                if not square + z_gap * z_gap < best:
                    break
                word = marks.nodes[s, i, j, k]
                while word != 0:
                    n, apart = nearest_part(word, BYTE, place[2], NODE, SIDE * k)
                    if not square + apart * apart < best:
                        break
                    gaps = y_gap * y_gap, apart * apart
                    best = nearest_in_node(marks, s, (i, j, SIDE * k + n), place, gaps, best)
                    word &= ~(ALL << np.uint64(8 * n))


@always_inline
def nearest_in_node(
    marks: OccupancyBits, s: int, node: Cell, place: Place, gaps: tuple[float, float], best: float
) -> float:
    """The same of a block of blocks."""
    layers = marks.blocks[s, node[0], node[1], node[2]]
    first_x, first_y, first_z = node[0] * layers.shape[0], node[1] << SHIFT, node[2] << SHIFT
    last_x, seen, known = first_x + layers.shape[0], EVERY, math.inf
    y_least, z_least = gaps
    below_x, above_x = around(place[0], SIZE, first_x, last_x)
    while True:
        i, x_gap, below_x, above_x = nearer(place[0], SIZE, first_x, last_x, below_x, above_x)
        x_square = x_gap * x_gap
        if not x_square + y_least + z_least < best:
            return best
        word = layers[i - first_x]
        if word != 0 and best < known:
            # What is cut off stays too far away in the layers that follow.
            seen, known = seen_in_node(marks, node, place, x_square, gaps, best), best
        word &= seen
        while word != 0:
            n, z_gap = nearest_part(word, BYTE, place[2], SIZE, first_z)
            square = x_square + z_gap * z_gap
            if not square + y_least < best:
                break
            column = (word >> np.uint64(8 * n)) & ALL
            while column != 0:
                m, y_gap = nearest_part(column, BIT, place[1], SIZE, first_y)
                if not square + y_gap * y_gap < best:
                    break
                best = nearest_in_block(marks, s, (i, first_y + m, first_z + n), place, best)
                column &= ~(ONE << np.uint64(m))
            word &= ~(ALL << np.uint64(8 * n))


def seen_in_node(
    marks: OccupancyBits, node: Cell, place: Place, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    """The bits of a layer of a block of blocks that may be near enough."""
    raise NotImplementedError


def _seen_in_space(
    marks: SpaceMarks, node: Cell, place: Place, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    return window(place, SIZE, node[1] << SHIFT, node[2] << SHIFT, best, x_square + gaps[1], x_square + gaps[0])


def _seen_in_plane(
    marks: PlaneMarks, node: Cell, place: Place, x_square: float, gaps: tuple[float, float], best: float
) -> np.uint64:
    return EVERY  # a single layer is looked through sooner than cut down


def nearest_in_block(marks: OccupancyBits, s: int, block: Cell, place: Place, best: float) -> float:
    """The same of a block of cells."""
    raise NotImplementedError


def _nearest_in_plane(marks: PlaneMarks, s: int, block: Cell, place: Place, best: float) -> float:
    return nearest_in_row(marks, s, block[1], block[2], place, best)


def _nearest_in_space(marks: SpaceMarks, s: int, block: Cell, place: Place, best: float) -> float:
    layers = marks.cells[s, block[0], block[1], block[2]]
    first_x, first_y, first_z = block[0] * layers.shape[0], block[1] << SHIFT, block[2] << SHIFT
    last_x, seen = first_x + layers.shape[0], np.uint64(0)
    y_least, z_least = least_squares(layers, place, 1.0, first_y, first_z)
    below_x, above_x = around(place[0], 1.0, first_x, last_x)
    while True:
        i, x_gap, below_x, above_x = nearer(place[0], 1.0, first_x, last_x, below_x, above_x)
        x_square = x_gap * x_gap
        if not x_square + y_least + z_least < best:
            return best
        word = layers[i - first_x]
        if word != 0:
            if seen == 0:  # once, which is enough for cells
                seen = window(place, 1.0, first_y, first_z, best, x_square + z_least, x_square + y_least)
            word &= seen
        best = nearest_in_word(word, place, (first_y, first_z), x_square, y_least, best)


dispatch_on_type(nearest_close, {SpaceMarks: _close_in_space, PlaneMarks: _close_in_plane})
dispatch_on_type(seen_in_node, {SpaceMarks: _seen_in_space, PlaneMarks: _seen_in_plane})
dispatch_on_type(nearest_in_block, {SpaceMarks: _nearest_in_space, PlaneMarks: _nearest_in_plane})


@always_inline
def nearest_in_word(
    word: np.uint64, place: Place, first: tuple[int, int], x_square: float, y_least: float, best: float
) -> float:
    """The same of a word of cells, from ``first`` on along y and z."""
    while word != 0:
        n, z_gap = nearest_part(word, BYTE, place[2], 1.0, first[1])
        square = x_square + z_gap * z_gap
        if not square + y_least < best:
            return best
        column = (word >> np.uint64(8 * n)) & ALL
        _, y_gap = nearest_part(column, BIT, place[1], 1.0, first[0])
        best = min(best, square + y_gap * y_gap)
        word &= ~(ALL << np.uint64(8 * n))
    return best


@always_inline
def least_squares(layers: Words, place: Place, size: float, first_y: int, first_z: int) -> tuple[float, float]:
    """Squared distances along y, and along z, to the nearest block of a size that any of some layers marks."""
    every = np.uint64(0)
    for layer in layers:
        every |= layer
    if every == 0:
        return math.inf, math.inf
    _, z_gap = nearest_part(every, BYTE, place[2], size, first_z)
    every |= every >> np.uint64(32)
    every |= every >> np.uint64(16)
    every |= every >> np.uint64(8)
    _, y_gap = nearest_part(every & ALL, BIT, place[1], size, first_y)
    return y_gap * y_gap, z_gap * z_gap


@always_inline
def window(place: Place, size: float, first_y: int, first_z: int, best: float, but_y: float, but_z: float) -> np.uint64:
    """The bits of a word of blocks of a size that may be nearer than the square root of ``best``.

    ``but_y`` and ``but_z`` are the least that the other axes add to the squares of distances along y and along z.
    """
    low_y, high_y = near_parts(place[1], size, first_y, best, but_y)
    low_z, high_z = near_parts(place[2], size, first_z, best, but_z)
    column = ALL >> np.uint64(SIDE - 1 + low_y - high_y) << np.uint64(low_y)
    layer = EVERY >> np.uint64(SIDE * (SIDE - 1 + low_z - high_z)) << np.uint64(SIDE * low_z)
    return (column * COLUMN) & layer


@always_inline
def near_parts(place: float, size: float, first: int, best: float, others: float) -> tuple[int, int]:
    """The first and the last of eight blocks along an axis that may be so near; none is lost by rounding."""
    reach, at = math.sqrt(max(best * (1.0 + ROUNDING) - others, 0.0)) / size + ROUNDING, place / size - first
    return int(min(max(at - reach, 0.0), SIZE - 1.0)), int(min(max(at + reach, 0.0), SIZE - 1.0))


@always_inline
def gap(place: float, number: int, size: float) -> float:
    """Distance along an axis from a place to a block, or a cell, of a size, by its number."""
    return max(0.0, number * size - place, place - (number + 1) * size)


@always_inline
def around(place: float, size: float, first: int, stop: int) -> tuple[int, int]:
    """The blocks below and above a place, of those from ``first`` on and before ``stop``."""
    above = int(min(max(place / size, float(first)), stop - 1.0))
    return above - 1, above


@always_inline
def nearer(place: float, size: float, first: int, stop: int, below: int, above: int) -> tuple[int, float, int, int]:
    """The nearer one of the next blocks below and above, its distance, and the next ones after it."""
    low = gap(place, below, size) if below >= first else math.inf
    high = gap(place, above, size) if above < stop else math.inf
    if low <= high:
        return below, low, below - 1, above
    return above, high, below, above + 1


@always_inline
def nearest_part(word: np.uint64, wide: np.uint64, place: float, size: float, first: int) -> tuple[int, float]:
    """The nearest of eight blocks along an axis, from ``first`` on, that a word marks, and its distance.

    ``wide`` is BYTE where a byte of the word stands for each, and BIT where a bit does.
    """
    at = np.uint64(min(max(int(place / size) - first, 0), SIDE - 1)) << wide
    upper, lower = word >> at << at, word & ((ONE << at) - ONE)
    above: int = np.int64(zeros_below(upper) >> wide)  # type: ignore[assignment]
    below: int = np.int64((LAST - zeros_above(lower)) >> wide)  # type: ignore[assignment]
    high = gap(place, first + above, size) if upper != 0 else math.inf
    low = gap(place, first + below, size) if lower != 0 else math.inf
    return (below, low) if low < high else (above, high)


@kernel
def clearances(map_: Map, marks: OccupancyBits, points: Floats, out: Floats) -> int:
    """Clearances of configurations, shape (n, size), metres; the index of the first one that is not usable, or -1."""
    last, dim = map_.lower + map_.rotations.zeros(), len(map_.lower)
    known = math.inf
    for n in range(points.shape[0]):
        q = configuration(map_, points, n)
        if not is_usable(map_, q):
            return n
        # A configuration near the last one is not much farther from what is not FREE, at the same rotation.
        most = math.inf
        if map_.rotations.states_at(q) == map_.rotations.states_at(last):
            square = 0.0
            for axis in range(dim):
                square += ((q[axis] - last[axis]) / map_.spacing) ** 2
            most = (known + 8.0 * SLACK + math.sqrt(square)) * (1.0 + ROUNDING)
        known, last = clearance_at(map_, marks, q, most), q
        out[n] = known * map_.spacing
    return -1


@compilable
class Clearance(NamedTuple):
    """The clearance of a configuration, in metres."""

    map_: Map
    marks: OccupancyBits

    def evaluate(self, q: Numbers) -> float:
        return clearance_at(self.map_, self.marks, q, math.inf) * self.map_.spacing


def checker(map_: Map, marks: OccupancyBits, size: int) -> Callable[..., float]:
    """A quick clearance of the numbers of one configuration; it stays right through all changes."""
    return callback(Clearance(map_, marks), size)


Squares = NDArray[np.int32]

MAX_REACH: Final = 16_000
"""Largest distance in cells whose squares, in half cells, two of them added, are integers of 32 bits."""

ROWS_PER_STRIP: Final = 64
"""Rows of cells that are computed together, so that their scratch stays in the cache."""

MIN_ROWS_PER_THREAD: Final = 16
"""Rows of cells below which a second thread costs more than it saves."""

SLICES_PER_BATCH: Final = 8
"""Slices of packed states that are unpacked together."""

MAX_NOTED: Final = 32
"""Changed windows that are noted one by one; of more, the window around all of them."""


class Inflation:
    """The largest clearances over all slices of a map of the plane; they follow updates of the map.

    The states and the table of the exterior are shared, not copied; the lock is held while they change, and while
    clearances are computed.
    """

    def __init__(self, states: Stack, exterior: Ints, lock: Lock) -> None:
        self._states, self._exterior, self._lock = states, exterior, lock
        self._squares = np.empty(states.shape[1:], dtype=np.int32)
        self._reach, self._seen, self._noted = -1, exterior.copy(), list[Ints]()

    def refresh(self, boxes: Ints) -> None:
        """Note the box in which states of each slice have changed, shape (slices, 6)."""
        changed = boxes[(boxes[:, :3] <= boxes[:, 3:]).all(axis=1)]
        if len(changed):
            self._noted.append(np.array([changed[:, 1:3].min(axis=0), changed[:, 4:].max(axis=0) + 1]))
        if len(self._noted) > MAX_NOTED:
            self._noted = [_around(self._noted)]

    def clearances(self, limit: float) -> Floats:
        """Return the clearances in cells, shape (nx, ny); infinite where they are above ``limit``.

        Raises InputError if the limit and the map are more than :data:`MAX_REACH` cells wide.
        """
        with self._lock:
            reach = reach_of(limit, self._squares.shape, self._exterior)
            if reach != self._reach or not np.array_equal(self._seen, self._exterior):
                self._reach, self._seen = reach, self._exterior.copy()
                self._noted = [np.array([(0, 0), self._squares.shape])]
            grown = np.array([[-reach], [reach]])
            for window in self._noted:
                # A cell that is farther from the change than the reach keeps its square.
                write_squares(self._states, self._exterior, reach, window + grown, self._squares)
            self._noted = []
            return in_cells(self._squares, reach)


def clearances_of(states: States, exterior: Ints, limit: float) -> Floats:
    """As :meth:`Inflation.clearances`, of one slice, states of shape (nx, ny)."""
    reach, squares = reach_of(limit, states.shape, exterior), np.empty(states.shape, dtype=np.int32)
    write_squares(states[np.newaxis], exterior[np.newaxis], reach, np.array([(0, 0), states.shape]), squares)
    return in_cells(squares, reach)


def reach_of(limit: float, shape: Sequence[int], exterior: Ints) -> int:
    """Return how many cells away the search ends: at the limit, or where nothing follows that is not FREE."""
    boxes = exterior.reshape(-1, exterior.shape[-1])[:, :-1].reshape(-1, 2, len(shape))
    farthest = np.maximum(boxes[:, 1], shape).max() - min(int(boxes[:, 0].min()), 0)
    reach = int(min(math.ceil(max(limit, 0.0)), farthest))
    if reach > MAX_REACH:
        rule, hint = f"at most {MAX_REACH} cells are searched", "pass a smaller radius, or a part of the map"
        raise InputError("inflation_radius", f"reaches {reach} cells beyond the robot", rule, hint, value=limit)
    return reach


def in_cells(squares: Squares, reach: int) -> Floats:
    """Return squares as distances in cells, rounded down as :func:`cspace.map.clearance.clearance_at` does."""
    cells = np.maximum(0.5 * np.sqrt(squares) * (1.0 - 2.0**-48) - 4.0 * SLACK, 0.0)
    cells[squares == (2 * reach + 1) ** 2] = np.inf
    return np.asarray(cells)


def write_squares(states: Stack, exterior: Ints, reach: int, window: Ints, out: Squares) -> None:
    """Write the largest square over some slices into a window of ``out``, its first cell and the one after its last."""
    first, last = np.maximum(window[0], 0).tolist(), np.minimum(window[1], out.shape).tolist()
    part = out[first[0] : last[0], first[1] : last[1]]
    part[...] = 0
    for number, batch in _batches(states):
        table = exterior[number : number + len(batch)]

        def work(start: int, stop: int, batch: States = batch, table: Ints = table) -> int:
            rows, width = min(ROWS_PER_STRIP, stop - start), part.shape[1] + 2 * reach
            counts, line, row = np.empty((rows, width), np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
            mask, best = np.empty(width, np.uint8), np.empty(part.shape[1], np.int32)
            for begin in range(start, stop, ROWS_PER_STRIP):
                strip = part[begin : min(begin + ROWS_PER_STRIP, stop)]
                corner = (first[0] + begin, first[1])
                raise_squares(batch, table, reach, corner, (counts, line, row, mask, best), strip)
            return -1

        in_chunks(work, len(part), MIN_ROWS_PER_THREAD)


def _batches(states: Stack) -> Iterator[tuple[int, States]]:
    """Yield all slices as bytes, some at a time, with the number of the first."""
    if isinstance(states, np.ndarray):
        yield 0, states
        return
    for first in range(0, len(states), SLICES_PER_BATCH):
        yield first, states[first : first + SLICES_PER_BATCH]


def _around(windows: list[Ints]) -> Ints:
    """Return the window around some windows."""
    corners = np.array(windows)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


@kernel
def raise_squares(
    states: States,
    exterior: Ints,
    reach: int,
    corner: tuple[int, int],
    scratch: tuple[Squares, Squares, Squares, States, Squares],
    out: Squares,
) -> None:
    """Raise squares in a window, shape (nx, ny), to those of each slice; its first cell is at ``corner``."""
    counts, line, row, mask, best = scratch
    nx, ny = out.shape
    cap, width, top = np.int32(reach + 1), ny + 2 * reach, np.int32((2 * reach + 1) ** 2)
    for s in range(len(states)):
        # Cells to the nearest one that is not FREE in the same column, from below and from above.
        for backwards in range(2):
            line[:] = cap
            for step in range(nx + reach):
                x = step - reach if backwards == 0 else nx - 1 + reach - step
                read_row(states[s], exterior[s], corner[0] + x, corner[1] - reach, mask)
                for k in range(width):
                    more = min(np.int32(line[k] + np.int32(1)), cap)
                    line[k] = np.int32(0) if mask[k] != FREE else more
                if step >= reach:
                    near = counts[x]
                    for k in range(width):
                        near[k] = line[k] if backwards == 0 else min(near[k], line[k])
        for x in range(nx):
            near, result = counts[x], out[x]
            for k in range(width):
                half = np.int32(np.int32(2) * near[k] - np.int32(1))
                row[k] = np.int32(half * half) if near[k] > 0 else np.int32(0)
            middle = row[reach : reach + ny]
            for k in range(ny):
                best[k] = middle[k]
            for apart in range(1, reach + 1):
                step_square = np.int32((2 * apart - 1) ** 2)
                open_ = np.int32(0)
                for k in range(ny):
                    open_ |= np.int32(best[k] > max(result[k], step_square))
                if open_ == 0:
                    break
                left, right = row[reach - apart : reach - apart + ny], row[reach + apart : reach + apart + ny]
                for k in range(ny):
                    best[k] = min(best[k], np.int32(min(left[k], right[k]) + step_square))
            for k in range(ny):
                result[k] = max(result[k], min(best[k], top))


@kernel
def read_row(states: States, table: Ints, x: int, y: int, mask: States) -> None:
    """Write the states of a row of cells from ``(x, y)`` on; all that is not FREE outside the grid counts as taken."""
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

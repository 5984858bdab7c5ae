"""Compiled distance transforms, tile by tile: how far the cells of a map are from those that are not FREE.

A map is taken as slices of three axes, of which a plane has one layer. A tile is what a slice has in WIDE places of the
last axis, so that it can be made by itself: along the last axis rows are only searched for their nearest cells, and
along the others the tile has whole lines. Distances are from the middle of a cell to the closed cells that are not
FREE, in half cells until they are stored; along an axis, a cell that is g > 0 cells away begins 2 g - 1 from there.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit
from cspace.states import FREE

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Squares = NDArray[np.int32]
Shorts = NDArray[np.uint16]

WIDE: Final = 32
"""Cells of a tile along the last axis."""

SIDE: Final = 16
"""Cells, along the other axes, of the parts of a tile whose greatest distances are kept."""

UNIT: Final = 16
"""Units of a stored distance to a cell: it is rounded down to a sixteenth of a cell."""

MOST: Final = 2**16 - 1
"""Greatest distance that is stored; it stands for every greater one too, and for none."""

LIMIT: Final = 2**26
"""Squared distance, in half cells, that is beyond what is stored."""

FAR: Final = 2**12 + 1
"""Gap in cells whose squared distance is beyond LIMIT."""

LINES: Final = 16
"""Lines that are read and written together, so that whole cache lines are."""

LARGEST: Final = 2**23
"""Cells of a window, up to which it is brought up to date after a change; tiles of a larger one are made anew."""


class Tiles(NamedTuple):
    """Distances of a map, as far as they were asked for.

    distances : ndarray of uint16, shape (slices, tiles, nx, ny, WIDE)
        In UNITs of a cell, rounded down; what is not made is not touched, and takes no memory.
    ready : ndarray of uint8, shape (slices, tiles)
        Whether a tile was made.
    peaks : ndarray of uint16, shape (slices, tiles, ceil(nx / SIDE), ceil(ny / SIDE))
        Greatest distance in each part of a tile.
    occupied : ndarray of bool, shape (slices,)
        Whether a slice has a cell that is not FREE.
    walls : ndarray of float64, shape (slices, 2 d, 2 d)
        What is not FREE outside the grid, in cells; rows that are not needed are infinitely far.
    """

    distances: Shorts
    ready: Bytes
    peaks: Shorts
    occupied: NDArray[np.bool_]
    walls: NDArray[np.float64]


# ---- squared distances -----------------------------------------------------------------------------------------------


@inner
def nearest_above(row: Bytes, first: int, stop: int) -> int:
    """The first cell from ``first`` on and before ``stop`` that is not FREE; far beyond the row without any."""
    eights, k = row[: row.size // 8 * 8].view(np.uint64), first
    while k < stop:
        if k % 8 == 0:
            while k + 8 <= stop and eights[np.uint64(k // 8)] == FREE:
                k += 8
            if k >= stop:
                break
        if row[k] != FREE:
            return k
        k += 1
    return row.size + FAR


@inner
def nearest_below(row: Bytes, last: int, stop: int) -> int:
    """The last cell up to ``last`` and not before ``stop`` that is not FREE; far before the row without any."""
    eights, k = row[: row.size // 8 * 8].view(np.uint64), last
    while k >= stop:
        if k % 8 == 7:
            while k - 7 >= stop and eights[np.uint64(k // 8)] == FREE:
                k -= 8
            if k < stop:
                break
        if row[k] != FREE:
            return k
        k -= 1
    return -FAR


@inner
def row_squares(row: Bytes, first: int, stop: int, low: int, high: int, out: Squares) -> None:
    """Squared distances along a row, of the cells from ``first`` on and before ``stop``, to those from low to high."""
    last = nearest_below(row, first - 1, max(low, first - FAR))
    for k in range(first, stop):
        if row[k] != FREE:
            last = k
        out[k - first] = min(k - last, FAR)
    last = nearest_above(row, stop, min(high, stop + FAR))
    for k in range(stop - 1, first - 1, -1):
        if row[k] != FREE:
            last = k
        half = max(2 * min(last - k, int(out[k - first])) - 1, 0)
        out[k - first] = min(half * half, LIMIT)


@jit
def spread(squares: Squares) -> None:
    """Add the squared distance along the middle axis to squared distances, shape (a, n, b), in place.

    Each line, a cell of the other two axes, gets the lower envelope of the parabolas ``square + (p - 2 i)^2``, taken at
    ``p = 2 k - 1`` for cells to the left and at ``2 k + 1`` for those to the right (Felzenszwalb and Huttenlocher,
    2012).
    """
    count, width = squares.shape[1], squares.shape[2]
    if count == 1:
        return
    lines = np.empty((LINES, count), np.int32)
    vertex = np.empty(count, np.int32)
    begin = np.empty(count + 1, np.int32)
    envelope = np.empty(count + 1, np.int64)
    for a in range(squares.shape[0]):
        for low in range(0, width, LINES):
            size = min(LINES, width - low)
            for i in range(count):
                for n in range(size):
                    lines[n, i] = squares[a, i, low + n]
            for n in range(size):
                spread_line(lines[n], vertex, begin, envelope)
            for i in range(count):
                for n in range(size):
                    squares[a, i, low + n] = lines[n, i]


@inner(error_model="numpy")
def spread_line(line: Squares, vertex: Squares, begin: Squares, envelope: Ints) -> None:
    """One line of :func:`spread`; the other arrays are for its own use.

    Parabola ``vertex[part]`` is the lowest at ``p = 2 k - 1`` for ``begin[part] <= k < begin[part + 1]``.
    """
    count = line.shape[0]
    top = -1
    for i in range(count):
        height = int(line[i])
        # One that is nowhere lower than those beside it decides nothing but its own cell, which is seen to below.
        if height == LIMIT or (0 < i < count - 1 and line[i - 1] <= height and line[i + 1] <= height):
            continue
        start = 0
        while top >= 0:
            v = int(vertex[top])
            # From this k on the new parabola is lower: height + (p - 2 i)^2 < line[v] + (p - 2 v)^2. The quotient of
            # whole numbers below 2^53 is rounded down right, as it is no nearer to the next whole number than 1 / gap.
            rise = height - int(line[v]) + 4 * (i - v) * (i + v + 1)
            start = max(math.floor(rise / (8.0 * (i - v))) + 1, 0)
            if start > begin[top]:
                break
            top -= 1
            start = 0
        if start > count:
            continue
        top += 1
        vertex[top] = i
        begin[top] = start
    if top < 0:
        return
    begin[top + 1] = count + 1
    for part in range(top + 1):
        v = int(vertex[part])
        height = int(line[v])
        for k in range(int(begin[part]), int(begin[part + 1])):
            p = 2 * (k - v) - 1
            envelope[k] = height + p * p
    for k in range(count):
        line[k] = min(envelope[k], envelope[k + 1], line[k])


@jit
def transform(state: Bytes, window: Ints, frame: Ints) -> Squares:
    """Squared distances of a window of cells to what is not FREE in a frame around it.

    Boxes hold their first cell and their last one along each axis. Gives those of the window along the last axis, and
    of the frame along the first two; callers take what they need.
    """
    first, stop = window[2], window[5] + 1
    squares = np.empty((frame[3] - frame[0] + 1, frame[4] - frame[1] + 1, stop - first), np.int32)
    for x in range(squares.shape[0]):
        for y in range(squares.shape[1]):
            row = state[frame[0] + x, frame[1] + y]
            row_squares(row, first, stop, frame[2], frame[5] + 1, squares[x, y])
    spread(squares)
    # Of the second axis, only the window counts from here on.
    low, high = window[1] - frame[1], window[4] - frame[1] + 1
    if high - low < squares.shape[1]:
        kept = np.empty((squares.shape[0], high - low, squares.shape[2]), np.int32)
        for x in range(kept.shape[0]):
            for y in range(kept.shape[1]):
                for k in range(kept.shape[2]):
                    kept[x, y, k] = squares[x, low + y, k]
        squares = kept
    spread(squares.reshape(1, squares.shape[0], squares.shape[1] * squares.shape[2]))
    return squares


# ---- tiles -----------------------------------------------------------------------------------------------------------


@inner
def stored(square: int) -> int:
    """A squared distance in half cells, as it is stored."""
    return min(int(math.sqrt(square * (UNIT * UNIT / 4.0))), MOST)


@jit
def make_tiles(states: Bytes, tiles: Tiles, s: int, start: int, end: int) -> None:
    """Make the tiles of a slice of ``states``, shape (slices, nx, ny, nz), from ``start`` on and before ``end``."""
    _, nx, ny, nz = states.shape
    first, stop = start * WIDE, min(end * WIDE, nz)
    frame = np.empty(6, np.int64)
    frame[0] = frame[1] = frame[2] = 0
    frame[3], frame[4], frame[5] = nx - 1, ny - 1, nz - 1
    window = frame.copy()
    window[2], window[5] = first, stop - 1
    squares = transform(states[s], window, frame)
    for x in range(nx):
        for y in range(ny):
            for tile in range(start, end):
                if x % SIDE == 0 and y % SIDE == 0:
                    tiles.peaks[s, tile, x // SIDE, y // SIDE] = 0
                low = (tile - start) * WIDE
                line = squares[x, y, low : min(low + WIDE, stop - first)]
                into, peak = tiles.distances[s, tile, x, y], 0
                for k in range(len(line)):
                    value = stored(line[k])
                    into[k] = value
                    peak = max(peak, value)
                if peak > tiles.peaks[s, tile, x // SIDE, y // SIDE]:
                    tiles.peaks[s, tile, x // SIDE, y // SIDE] = peak
    for tile in range(start, end):
        tiles.ready[s, tile] = 1


@inner
def gap(first: int, last: int, low: int, high: int) -> int:
    """Distance along an axis, in half cells, from middles of cells first to last to the closed cells low to high."""
    return max(0, 2 * max(low - last, first - high) - 1)


@inner
def may_change(value: int, dx: int, dy: int, dz: int) -> bool:
    """Whether a stored distance may be as great as one with these gaps; see :func:`renew_tiles`."""
    # Stored distances are rounded down, and the greatest one stands for all beyond.
    return value == MOST or (2 * (value + 1)) ** 2 > UNIT * UNIT * (dx * dx + dy * dy + dz * dz)


@jit
def changed_window(tiles: Tiles, s: int, box: Ints, shape: tuple[int, int, int]) -> Ints:
    """The box around the cells of tiles whose distances may be others after a change within a box."""
    nx, ny, nz = shape
    window = np.array([nx, ny, nz, -1, -1, -1])
    for tile in range(tiles.ready.shape[1]):
        if tiles.ready[s, tile] == 0:
            continue
        first, last = tile * WIDE, min((tile + 1) * WIDE, nz) - 1
        tile_gap = gap(first, last, box[2], box[5])
        for a in range(tiles.peaks.shape[2]):
            a_gap = gap(a * SIDE, (a + 1) * SIDE - 1, box[0], box[3])
            for b in range(tiles.peaks.shape[3]):
                b_gap = gap(b * SIDE, (b + 1) * SIDE - 1, box[1], box[4])
                if not may_change(int(tiles.peaks[s, tile, a, b]), a_gap, b_gap, tile_gap):
                    continue
                for x in range(a * SIDE, min((a + 1) * SIDE, nx)):
                    dx = gap(x, x, box[0], box[3])
                    for y in range(b * SIDE, min((b + 1) * SIDE, ny)):
                        dy, row = gap(y, y, box[1], box[4]), tiles.distances[s, tile, x, y]
                        for z in range(first, last + 1):
                            if may_change(int(row[z - first]), dx, dy, gap(z, z, box[2], box[5])):
                                window[0], window[3] = min(window[0], x), max(window[3], x)
                                window[1], window[4] = min(window[1], y), max(window[4], y)
                                window[2], window[5] = min(window[2], z), max(window[5], z)
    return window


@jit
def renew_tiles(states: Bytes, tiles: Tiles, boxes: Ints) -> None:
    """Bring tiles up to date after cells became FREE, or stopped being FREE.

    *What can change.* Let D be the box of such cells in a slice, and d(c) the distance from the middle of a cell c to
    it. Where the old distance F(c) is less than d(c), the nearest cell that is not FREE lies outside D and stays, and
    what is new lies in D, farther away: the distance stays. So the window around the cells with F >= d holds all that
    changes; parts of tiles whose greatest distance is less than that to D are passed over.

    *What it becomes.* The transform of the window and a frame of m cells around it, cut at the grid's border, is right
    wherever it gives at most 2 m + 1 half cells, for what lies beyond the frame is at least as far. It never gives too
    little, so if it gives more, it tells how wide a frame is enough.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz)
        After the change.
    boxes : ndarray of int64, shape (slices, 6)
        First and last cell of D in each slice; empty where a first one is beyond the last.
    """
    _, nx, ny, nz = states.shape
    for s in range(len(boxes)):
        box = boxes[s]
        if box[0] > box[3] or box[1] > box[4] or box[2] > box[5]:
            continue
        window = changed_window(tiles, s, box, (nx, ny, nz))
        if window[0] > window[3]:
            continue
        if (window[3] - window[0] + 1) * (window[4] - window[1] + 1) * (window[5] - window[2] + 1) > LARGEST:
            for tile in range(window[2] // WIDE, window[5] // WIDE + 1):
                tiles.ready[s, tile] = 0
            continue
        wide = max(8, window[4] - window[1] + 1, window[5] - window[2] + 1)
        while True:
            frame = window.copy()
            whole = wide >= FAR
            for axis, count in enumerate((nx, ny, nz)):
                frame[axis] = max(0, window[axis] - wide)
                frame[3 + axis] = min(count - 1, window[3 + axis] + wide)
            squares = transform(states[s], window, frame)
            low = window[0] - frame[0]
            most = np.int64(0)
            for x in range(low, low + window[3] - window[0] + 1):
                for y in range(squares.shape[1]):
                    for k in range(squares.shape[2]):
                        most = max(most, np.int64(squares[x, y, k]))
            if whole or most <= (2 * wide + 1) * (2 * wide + 1):
                break
            wide = 4 * wide if most >= LIMIT else int(math.sqrt(most)) // 2 + 1
        store_window(tiles, s, window, squares[low : low + window[3] - window[0] + 1], nz)


@inner
def store_window(tiles: Tiles, s: int, window: Ints, squares: Squares, nz: int) -> None:
    """Write squared distances of a window into the tiles that were made, and their greatest distances."""
    nx, ny = tiles.distances.shape[2], tiles.distances.shape[3]
    for tile in range(window[2] // WIDE, window[5] // WIDE + 1):
        if tiles.ready[s, tile] == 0:
            continue
        first = max(window[2], tile * WIDE)
        stop = min(window[5] + 1, (tile + 1) * WIDE)
        for x in range(squares.shape[0]):
            for y in range(squares.shape[1]):
                row = tiles.distances[s, tile, window[0] + x, window[1] + y]
                for z in range(first, stop):
                    row[z - tile * WIDE] = stored(squares[x, y, z - window[2]])
        for a in range(window[0] // SIDE, window[3] // SIDE + 1):
            for b in range(window[1] // SIDE, window[4] // SIDE + 1):
                own = tiles.distances[s, tile, a * SIDE : min((a + 1) * SIDE, nx), b * SIDE : min((b + 1) * SIDE, ny)]
                peak = 0
                for x in range(own.shape[0]):
                    for y in range(own.shape[1]):
                        for k in range(min(WIDE, nz - tile * WIDE)):
                            peak = max(peak, int(own[x, y, k]))
                tiles.peaks[s, tile, a, b] = peak

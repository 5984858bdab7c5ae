"""Compiled passes over all cells of a map, in any number of dimensions: distances, and chains of cells."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.states import FREE, MIXED

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Squares = NDArray[np.int32]

LIMIT = 2**31 - 1
"""Squared distance that stands for every greater one too, and for none."""

FAR = 2**16
"""Gap in cells whose squared distance is beyond LIMIT."""

LINES = 16
"""Lines that are read and written together, so that whole cache lines are."""

START, CLOSED = 9, 10


@njit(cache=True, nogil=True)
def row_distances(state: Bytes, out: Squares) -> None:
    """Squared distance, in half cells, from the middle of each cell to the nearest closed cell of its row, not FREE.

    A cell that is g > 0 cells away along an axis begins 2 g - 1 half cells from the middle.
    """
    rows, count = state.shape
    for r in range(rows):
        last = -FAR
        for k in range(count):
            if state[r, k] != FREE:
                last = k
            out[r, k] = min(k - last, FAR)
        last = count + FAR
        for k in range(count - 1, -1, -1):
            if state[r, k] != FREE:
                last = k
            half = max(2 * min(last - k, int(out[r, k])) - 1, 0)
            out[r, k] = min(half * half, LIMIT)


@njit(cache=True, nogil=True)
def spread_squares(squares: Squares, first: int, stop: int) -> None:
    """Add the squared distance along the middle axis to squared distances, shape (a, n, b), in place.

    Each line, a cell of the other two axes, gets the lower envelope of the parabolas ``square + (p - 2 i)^2``, taken at
    ``p = 2 k - 1`` for cells to the left and at ``2 k + 1`` for those to the right (Felzenszwalb and Huttenlocher,
    2012). For the blocks ``first <= block < stop`` of LINES lines; :func:`blocks_of` tells how many there are.
    """
    count, width = squares.shape[1], squares.shape[2]
    across = (width + LINES - 1) // LINES
    lines = np.empty((LINES, count), np.int32)
    vertex = np.empty(count, np.int64)
    begin = np.empty(count + 1, np.int64)
    envelope = np.empty(count + 1, np.int64)
    for block in range(first, stop):
        a, low = block // across, block % across * LINES
        size = min(LINES, width - low)
        for i in range(count):
            for n in range(size):
                lines[n, i] = squares[a, i, low + n]
        for n in range(size):
            spread_line(lines[n], vertex, begin, envelope)
        for i in range(count):
            for n in range(size):
                squares[a, i, low + n] = lines[n, i]


@njit(cache=True, nogil=True)
def spread_line(line: Squares, vertex: Ints, begin: Ints, envelope: Ints) -> None:
    """One line of :func:`spread_squares`; the other arrays are for its own use.

    Parabola ``vertex[part]`` is the lowest at ``p = 2 k - 1`` for ``begin[part] <= k < begin[part + 1]``.
    """
    count = line.shape[0]
    top = -1
    for i in range(count):
        height = int(line[i])
        if height == LIMIT:
            continue
        start = 0
        while top >= 0:
            v = vertex[top]
            # From this k on the new parabola is lower: height + (p - 2 i)^2 < line[v] + (p - 2 v)^2.
            rise = height - int(line[v]) + 4 * (i - v) * (i + v + 1)
            start = max(rise // (8 * (i - v)) + 1, 0)
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
        v = vertex[part]
        height = int(line[v])
        for k in range(begin[part], begin[part + 1]):
            p = 2 * (k - v) - 1
            envelope[k] = height + p * p
    for k in range(count):
        line[k] = min(envelope[k], envelope[k + 1], line[k])


@njit(cache=True, nogil=True)
def blocks_of(squares: Squares) -> int:
    """Number of blocks of lines along the middle axis."""
    return int(squares.shape[0] * ((squares.shape[2] + LINES - 1) // LINES))


@njit(cache=True, nogil=True)
def renew_squares(state: Bytes, squares: Squares, box: Ints) -> None:
    """Squared distances of one slice, shape (nx, ny, nz), after a change in a box; see ``renew_clearance``."""
    window = changed_window(squares, box)
    frame = window.copy()
    for axis in range(3):
        for side in range(2):
            width = frame_width(squares, window, axis, side)
            if side == 0:
                frame[axis] = max(0, window[axis] - width)
            else:
                frame[3 + axis] = min(squares.shape[axis] - 1, window[3 + axis] + width)
    low, high = window[2] - frame[2], window[5] - frame[2] + 1
    layers, rows = frame[3] - frame[0] + 1, frame[4] - frame[1] + 1
    made = np.empty((layers, rows, high - low), np.int32)
    line = np.empty((1, frame[5] - frame[2] + 1), np.int32)
    for x in range(layers):
        for y in range(rows):
            cells = state[frame[0] + x, frame[1] + y]
            row_distances(cells[frame[2] : frame[5] + 1].reshape(1, -1), line)
            made[x, y] = line[0, low:high]
    if rows > 1:
        spread_squares(made, 0, blocks_of(made))
    # Of the rows, only those of the window count from here on.
    low, high = window[1] - frame[1], window[4] - frame[1] + 1
    kept = made[:, low:high].copy()
    if layers > 1:
        lines = kept.reshape(1, layers, -1)
        spread_squares(lines, 0, blocks_of(lines))
    for x in range(window[0], window[3] + 1):
        for y in range(window[1], window[4] + 1):
            squares[x, y, window[2] : window[5] + 1] = kept[x - frame[0], y - window[1]]


@njit(cache=True, nogil=True)
def changed_window(squares: Squares, box: Ints) -> Ints:
    """A box of cells, first and last, outside which a change within a box leaves squared distances as they are."""
    window = box.copy()
    dims = 3 if squares.shape[0] > 1 else 2
    slack = 2.0 * math.sqrt(float(dims)) + 2.0**-10
    grown = True
    while grown:
        grown = False
        for axis in range(3):
            for side in range(2):
                end = 3 * side + axis
                border = 0 if side == 0 else squares.shape[axis] - 1
                if window[end] == border:
                    continue
                lack = side_lack(squares, window, axis, side, box, slack)
                if lack < 0.0:
                    continue
                # With each cell that a side moves out, the lack shrinks by four half cells at most.
                step = min(1 + int(lack / 4.0), squares.shape[axis])
                window[end] = max(border, window[end] - step) if side == 0 else min(border, window[end] + step)
                grown = True
    return window


@njit(cache=True, nogil=True)
def side_of(window: Ints, axis: int, side: int) -> Ints:
    """The outermost layer of cells on one side of a box."""
    layer = window.copy()
    layer[axis] = layer[3 + axis] = window[3 * side + axis]
    return layer


@njit(cache=True, nogil=True)
def side_lack(squares: Squares, window: Ints, axis: int, side: int, box: Ints, slack: float) -> float:
    """By how much distances on a side of a box, and ``slack``, exceed those to another box, at most; in half cells."""
    layer = side_of(window, axis, side)
    worst = -1.0
    for x in range(layer[0], layer[3] + 1):
        dx = max(0, 2 * max(box[0] - x, x - box[3]) - 1)
        for y in range(layer[1], layer[4] + 1):
            dy = max(0, 2 * max(box[1] - y, y - box[4]) - 1)
            row = squares[x, y]
            for z in range(layer[2], layer[5] + 1):
                dz = max(0, 2 * max(box[2] - z, z - box[5]) - 1)
                square = row[z]
                if square == LIMIT:
                    return float(8 * FAR)
                worst = max(worst, math.sqrt(float(square)) + slack - math.sqrt(float(dx * dx + dy * dy + dz * dz)))
    return worst


@njit(cache=True, nogil=True)
def frame_width(squares: Squares, window: Ints, axis: int, side: int) -> int:
    """Least m for which all distances on one side of a box are less than ``2 m + 1`` half cells."""
    if window[3 * side + axis] == (0 if side == 0 else squares.shape[axis] - 1):
        return 0
    layer = side_of(window, axis, side)
    most = np.int64(0)
    for x in range(layer[0], layer[3] + 1):
        for y in range(layer[1], layer[4] + 1):
            row = squares[x, y]
            for z in range(layer[2], layer[5] + 1):
                most = max(most, np.int64(row[z]))
    width = np.int64(0)
    while (2 * width + 1) * (2 * width + 1) <= most:
        width += 1
    return int(width)


@njit(cache=True, nogil=True)
def trace_chain(stack: Bytes, slice_of: Ints, start: Ints, goal: Ints, came: Bytes) -> bool:
    """Search a chain of cells ``(rotation, x, y, z)`` from start to goal, none BLOCKED, with the fewest MIXED ones.

    Breadth first, all FREE cells that can be reached before the next MIXED ones; only the front is held. ``came`` is 0,
    or CLOSED where a cell is left out, and is given the step by which each cell was reached: 1 and 2 for the rotation
    before and after, 3 to 8 for x, y and z alike, START for the start. In the plane z has a single cell.
    """
    count, nx, ny, nz = came.shape
    size = nx * ny * nz
    flat, reached = stack.reshape(-1), came.reshape(-1)
    origin = ((start[0] * nx + start[1]) * ny + start[2]) * nz + start[3]
    target = ((goal[0] * nx + goal[1]) * ny + goal[2]) * nz + goal[3]
    front, ahead, later = [origin], [origin], [origin]
    ahead.clear()
    later.clear()
    reached[origin] = START
    while len(front) > 0:
        for cell in front:
            if cell == target:
                return True
            r, place = cell // size, cell % size
            x, y, z = place // (ny * nz), place // nz % ny, place % nz
            for step in range(1 if count > 1 else 3, 9):
                a, near = r, place
                if step <= 2:
                    a = (r + 2 * step - 3 + count) % count
                elif step <= 4:
                    if not 0 <= x + 2 * step - 7 < nx:
                        continue
                    near += (2 * step - 7) * ny * nz
                elif step <= 6:
                    if not 0 <= y + 2 * step - 11 < ny:
                        continue
                    near += (2 * step - 11) * nz
                else:
                    if not 0 <= z + 2 * step - 15 < nz:
                        continue
                    near += 2 * step - 15
                if reached[a * size + near] != 0:
                    continue
                state = flat[slice_of[a] * size + near]
                if state == FREE:
                    reached[a * size + near] = step
                    ahead.append(a * size + near)
                elif state == MIXED:
                    reached[a * size + near] = step
                    later.append(a * size + near)
        front, ahead = ahead, front
        ahead.clear()
        if len(front) == 0:
            front, later = later, front
    return False

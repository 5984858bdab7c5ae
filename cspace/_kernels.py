"""Compiled look-ups. Points are in metres; ``frame`` is ``(lower x, lower y, spacing, upper x, upper y)``.

What lies outside the grid is given by ``box`` and ``beyond``: a cell outside the grid has the state ``beyond`` where it
lies outside the box of cells ``(x first, y first, x last, y last)``, and is MIXED where it lies in it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.coarse.sides import SHIFT, SIDE
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.states import FREE, MIXED

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]

FAR = 2.0**62

BLOCK = 1024
"""Points that are looked up at a time; what is kept of them stays in a core's nearest cache."""

INSIDE, ASK = 255, 254
"""Codes of points in the grid, and of those that need a closer look; all others are states."""


@njit(cache=True, nogil=True)
def cell_at(value: float, lower: float, spacing: float, upper: float, n: int) -> int:
    """Cell of a coordinate, as ``Grid.cell_of`` defines it."""
    i = math.floor(min(max((value - lower) / spacing, -FAR), FAR))
    if i == n and value <= upper:
        i = n - 1
    return i


@njit(cache=True, nogil=True)
def state_at(state: States, frame: Floats, box: Ints, beyond: int, x: float, y: float) -> int:
    """State of one configuration."""
    i = cell_at(x, frame[0], frame[2], frame[3], state.shape[0])
    j = cell_at(y, frame[1], frame[2], frame[4], state.shape[1])
    if 0 <= i < state.shape[0] and 0 <= j < state.shape[1]:
        return int(state[i, j])
    if box[0] <= i <= box[2] and box[1] <= j <= box[3]:
        return MIXED
    if not (math.isfinite(x) and math.isfinite(y)):
        return MIXED
    return beyond


@njit(cache=True, nogil=True, error_model="numpy")
def scaled(numbers: Floats, lows: Floats, scales: Floats, out: Floats) -> None:
    """``(numbers - lows) / scales``; one loop over plain numbers, which the compiler turns into wide instructions."""
    for m in range(numbers.shape[0]):
        out[m] = (numbers[m] - lows[m]) / scales[m]


@njit(cache=True, nogil=True)
def cells_of(uv: Floats, shape: tuple[int, int], box: Ints, beyond: int, cells: Ints, codes: States) -> int:
    """Cells of points that are given in cells, and what is to be made of each point.

    A point in the grid gets its cell's number in ``cells`` and the code INSIDE; one that is plainly outside gets its
    state for a code, and what is left ASK: not finite, or so near the grid's upper border that rounding may decide.
    There are no branches, so that the loop becomes wide instructions. Gives how many are to be asked about.
    """
    nx, ny = float(shape[0]), float(shape[1])
    left, bottom, right, top = float(box[0]), float(box[1]), float(box[2]) + 1.0, float(box[3]) + 1.0
    asked = 0
    for k in range(cells.shape[0]):
        u, v = uv[2 * k], uv[2 * k + 1]
        inside = (u >= 0.0) & (u < nx) & (v >= 0.0) & (v < ny)
        cells[k] = np.int64(u) * shape[1] + np.int64(v) if inside else 0
        border = ((nx <= u) & (u < nx + 1.0)) | ((ny <= v) & (v < ny + 1.0))
        ask = border | (not (abs(u) + abs(v) < FAR))
        boxed = (left <= u) & (u < right) & (bottom <= v) & (v < top)
        code = INSIDE if inside else (ASK if ask else (MIXED if boxed else beyond))
        codes[k] = code
        asked += code == ASK
    return asked


@njit(cache=True, nogil=True)
def read_states(flat: States, cells: Ints, codes: States, out: States) -> None:
    """States of points with given cells and codes.

    The map is read in a loop of its own and without a branch, so that many reads of a map larger than the cache are
    under way at once.
    """
    for k in range(cells.shape[0]):
        out[k] = flat[np.uint64(cells[k])]
    for k in range(cells.shape[0]):
        out[k] = out[k] if codes[k] == INSIDE else codes[k]


@njit(cache=True, nogil=True)
def classify(state: States, frame: Floats, box: Ints, beyond: int, points: Floats, out: States) -> int:
    """States of points, shape (n, 2); the index of the first point that is not finite, or -1."""
    flat, numbers = state.ravel(), points.reshape(-1)
    size = min(BLOCK, len(points))
    lows, scales, uv = np.empty(2 * size), np.full(2 * size, frame[2]), np.empty(2 * size)
    lows[0::2], lows[1::2] = frame[0], frame[1]
    cells, codes = np.empty(size, np.int64), np.empty(size, np.uint8)
    for first in range(0, points.shape[0], BLOCK):
        last = min(first + BLOCK, points.shape[0])
        scaled(numbers[2 * first : 2 * last], lows, scales, uv)
        asked = cells_of(uv, state.shape, box, beyond, cells[: last - first], codes)
        read_states(flat, cells[: last - first], codes, out[first:last])
        if asked == 0:
            continue
        for k in range(first, last):
            if codes[k - first] == ASK:
                x, y = points[k, 0], points[k, 1]
                if not (math.isfinite(x) and math.isfinite(y)):
                    return k
                out[k] = state_at(state, frame, box, beyond, x, y)
    return -1


@njit(cache=True, nogil=True)
def edge_is_free(
    state: States, frame: Floats, box: Ints, beyond: int, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Whether every closed cell within SLACK of a straight edge is FREE."""
    inside, px, py, qx, qy = ends_in_cells(frame, x0, y0, x1, y1)
    if not inside:
        return beyond_is_free(state, box, beyond, px, py, qx, qy)
    first, last = max(math.ceil(px - SLACK) - 1, 0), min(math.floor(qx + SLACK), state.shape[0] - 1)
    return columns_are_free(state, px, py, qx, qy, first, last)


@njit(cache=True, nogil=True)
def coarse_edge_is_free(
    state: States, coarse: States, frame: Floats, box: Ints, beyond: int, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """``edge_is_free`` with the help of a coarse map, which may be empty."""
    inside, px, py, qx, qy = ends_in_cells(frame, x0, y0, x1, y1)
    if not inside:
        return beyond_is_free(state, box, beyond, px, py, qx, qy)
    nx, ny = state.shape
    first, last = max(math.ceil(px - SLACK) - 1, 0), min(math.floor(qx + SLACK), nx - 1)
    if coarse.shape[0] == 0:
        return columns_are_free(state, px, py, qx, qy, first, last)
    for block in range(first >> SHIFT, (last >> SHIFT) + 1):
        begin, end = max(first, block << SHIFT), min(last, (block << SHIFT) + SIDE - 1)
        bottom, top = rows_between(px, py, qx, qy, begin, end)
        marks = coarse[np.uint64(block)]
        mark = 0
        for k in range(max(bottom, 0) >> SHIFT, (min(top, ny - 1) >> SHIFT) + 1):
            mark |= marks[np.uint64(k)]
        if mark != FREE and not columns_are_free(state, px, py, qx, qy, begin, end):
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def ends_in_cells(frame: Floats, x0: float, y0: float, x1: float, y1: float) -> tuple[bool, float, float, float, float]:
    """Whether an edge lies in the grid; and its ends in cells, the one with the lesser x first."""
    lower_x, lower_y, spacing, upper_x, upper_y = frame[0], frame[1], frame[2], frame[3], frame[4]
    px, py = (x0 - lower_x) / spacing, (y0 - lower_y) / spacing
    qx, qy = (x1 - lower_x) / spacing, (y1 - lower_y) / spacing
    inside = min(x0, x1) >= lower_x and max(x0, x1) <= upper_x and min(y0, y1) >= lower_y and max(y0, y1) <= upper_y
    inside = inside and abs(px) + abs(py) + abs(qx) + abs(qy) <= 8.0 * MAX_COORDINATE  # nor is NaN
    return (inside, qx, qy, px, py) if px > qx else (inside, px, py, qx, qy)


@njit(cache=True, nogil=True, error_model="numpy")
def rows_between(px: float, py: float, qx: float, qy: float, first: int, last: int) -> tuple[int, int]:
    """First and last row that an edge with ``px <= qx`` touches in columns of cells, with SLACK all around.

    Every operation rounds monotonically, so that the rows of several columns hold those of each.
    """
    low, high = min(py, qy), max(py, qy)
    if qx > px:
        # A ratio of differences, between 0 and 1: a slope would overflow on edges that are all but upright.
        a = py + (min(max(first - SLACK, px), qx) - px) / (qx - px) * (qy - py)
        b = py + (min(max(last + 1 + SLACK, px), qx) - px) / (qx - px) * (qy - py)
        low, high = max(min(a, b), low), min(max(a, b), high)
    return math.ceil(low - SLACK) - 1, math.floor(high + SLACK)


@njit(cache=True, nogil=True)
def columns_are_free(state: States, px: float, py: float, qx: float, qy: float, first: int, last: int) -> bool:
    """Whether the cells of an edge in the grid are FREE in some columns of it."""
    ny = state.shape[1]
    for i in range(first, last + 1):
        bottom, top = rows_between(px, py, qx, qy, i, i)
        column = state[np.uint64(i)]
        for j in range(max(bottom, 0), min(top, ny - 1) + 1):
            if column[np.uint64(j)] != FREE:
                return False
    return True


@njit(cache=True, nogil=True)
def beyond_is_free(state: States, box: Ints, beyond: int, px: float, py: float, qx: float, qy: float) -> bool:
    """The same of an edge that leaves the grid: proven only where all is FREE beyond the grid and the box."""
    if beyond != FREE or not abs(px) + abs(py) + abs(qx) + abs(qy) <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    nx, ny = state.shape
    first, last = math.ceil(px - SLACK) - 1, math.floor(qx + SLACK)
    for i in range(max(first, min(box[0], 0)), min(last, max(box[2], nx - 1)) + 1):
        bottom, top = rows_between(px, py, qx, qy, i, i)
        for j in range(max(bottom, min(box[1], 0)), min(top, max(box[3], ny - 1)) + 1):
            if 0 <= i < nx and 0 <= j < ny:
                if state[i, j] != FREE:
                    return False
            elif box[0] <= i <= box[2] and box[1] <= j <= box[3]:
                return False
    return True


@njit(cache=True, nogil=True)
def square_is_free(state: States, frame: Floats, box: Ints, beyond: int, x: float, y: float, distance: float) -> bool:
    """Whether every closed cell within SLACK of the square ``[x - distance, x + distance] x ...`` is FREE."""
    nx, ny = state.shape
    px, py, reach = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2], distance / frame[2] + SLACK
    if not abs(px) + abs(py) + reach <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    first_x, last_x = math.ceil(px - reach) - 1, math.floor(px + reach)
    first_y, last_y = math.ceil(py - reach) - 1, math.floor(py + reach)
    if min(first_x, first_y) < 0 or last_x >= nx or last_y >= ny:
        if beyond != FREE:
            return False
        first_x, last_x = max(first_x, min(box[0], 0)), min(last_x, max(box[2], nx - 1))
        first_y, last_y = max(first_y, min(box[1], 0)), min(last_y, max(box[3], ny - 1))
    for i in range(first_x, last_x + 1):
        for j in range(first_y, last_y + 1):
            if 0 <= i < nx and 0 <= j < ny:
                if state[i, j] != FREE:
                    return False
            elif box[0] <= i <= box[2] and box[1] <= j <= box[3]:
                return False
    return True


@njit(cache=True, nogil=True)
def boxes_are_free(
    state: States, frame: Floats, box: Ints, beyond: int, distance: float, points: Floats, out: NDArray[np.bool_]
) -> int:
    """``square_is_free`` around points, shape (n, 2); the index of the first point that is not finite, or -1."""
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if not (math.isfinite(x) and math.isfinite(y)):
            return k
        out[k] = square_is_free(state, frame, box, beyond, x, y, distance)
    return -1


@njit(cache=True, nogil=True)
def edges_are_free(
    state: States,
    coarse: States,
    frame: Floats,
    box: Ints,
    beyond: int,
    starts: Floats,
    ends: Floats,
    out: NDArray[np.bool_],
) -> int:
    """``edge_is_free`` of edges, shapes (n, 2); the index of the first edge that is not finite, or -1."""
    for k in range(starts.shape[0]):
        x0, y0 = starts[k, 0], starts[k, 1]
        x1, y1 = ends[k, 0], ends[k, 1]
        if not (math.isfinite(x0) and math.isfinite(y0) and math.isfinite(x1) and math.isfinite(y1)):
            return k
        out[k] = coarse_edge_is_free(state, coarse, frame, box, beyond, x0, y0, x1, y1)
    return -1


@njit(cache=True, nogil=True)
def overlap_at(sums: NDArray[np.int32], frame: Floats, runs: Ints, outside: int, x: float, y: float) -> int:
    """Overlap of a robot at a point, summed run by run.

    ``sums[i, j]`` is the number of obstacle cells among the first j of column i, and each of ``runs`` a row
    ``(dx, first dy, last dy)`` of robot offsets.
    """
    nx, ny = sums.shape[0], sums.shape[1] - 1
    i = cell_at(x, frame[0], frame[2], frame[3], nx)
    j = cell_at(y, frame[1], frame[2], frame[4], ny)
    total = 0
    for r in range(runs.shape[0]):
        column = i + runs[r, 0]
        first = j + runs[r, 1]
        last = j + runs[r, 2]
        hidden = last - first + 1
        if 0 <= column < nx:
            a = min(max(first, 0), ny)
            b = min(max(last + 1, 0), ny)
            total += sums[column, b] - sums[column, a]
            hidden -= b - a
        total += hidden * outside
    return total


@njit(cache=True, nogil=True)
def overlaps(sums: NDArray[np.int32], frame: Floats, runs: Ints, outside: int, points: Floats, out: Ints) -> int:
    """``overlap_at`` of points, shape (n, 2); the index of the first point that is not finite, or -1."""
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if not (math.isfinite(x) and math.isfinite(y)):
            return k
        out[k] = overlap_at(sums, frame, runs, outside, x, y)
    return -1


@njit(cache=True, nogil=True)
def clearance_at(
    squares: NDArray[np.int32],
    state: States,
    frame: Floats,
    box: Ints,
    beyond: int,
    walls: Floats,
    some: bool,
    x: float,
    y: float,
) -> float:
    """Lower bound of the distance from a point to the nearest configuration that is not FREE, in metres.

    Distance is 1-Lipschitz, so each neighbouring cell's middle bounds it from below; the best of nine is taken.
    ``walls`` are the rectangles of cells outside the grid that are not FREE, and ``some`` tells whether any cell in the
    grid is not.
    """
    if state_at(state, frame, box, beyond, x, y) != FREE:
        return 0.0
    nx, ny = state.shape
    px, py = (x - frame[0]) / frame[2], (y - frame[1]) / frame[2]
    best = math.inf
    i = cell_at(x, frame[0], frame[2], frame[3], nx)
    j = cell_at(y, frame[1], frame[2], frame[4], ny)
    if 0 <= i < nx and 0 <= j < ny:
        if some:
            best = 0.0
            for a in range(max(i - 1, 0), min(i + 1, nx - 1) + 1):
                for b in range(max(j - 1, 0), min(j + 1, ny - 1) + 1):
                    apart = math.hypot(a + 0.5 - px, b + 0.5 - py)
                    best = max(best, 0.5 * math.sqrt(float(squares[a, b])) - apart)
    elif some:
        dx = max(0.0, -px, px - nx)
        dy = max(0.0, -py, py - ny)
        best = math.hypot(dx, dy)
    for w in range(walls.shape[0]):
        dx = max(0.0, walls[w, 0] - px, px - walls[w, 2])
        dy = max(0.0, walls[w, 1] - py, py - walls[w, 3])
        best = min(best, math.hypot(dx, dy))
    if best == math.inf and (some or len(walls) > 0):
        return 0.0  # too far away for a distance to be told
    return max(0.0, best * (1.0 - 2.0**-48) - 4.0 * SLACK) * float(frame[2])


@njit(cache=True, nogil=True)
def clearances(
    squares: NDArray[np.int32],
    state: States,
    frame: Floats,
    box: Ints,
    beyond: int,
    walls: Floats,
    some: bool,
    points: Floats,
    out: Floats,
) -> int:
    """``clearance_at`` of points, shape (n, 2); the index of the first point that is not finite, or -1."""
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if not (math.isfinite(x) and math.isfinite(y)):
            return k
        out[k] = clearance_at(squares, state, frame, box, beyond, walls, some, x, y)
    return -1

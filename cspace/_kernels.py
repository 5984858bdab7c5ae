"""Compiled look-ups. Points are in metres; ``frame`` is ``(lower x, lower y, spacing, upper x, upper y)``.

What lies outside the grid is given by ``box`` and ``beyond``: a cell outside the grid has the state ``beyond`` where it
lies outside the box of cells ``(x first, y first, x last, y last)``, and is MIXED where it lies in it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.grid import MAX_COORDINATE, SLACK
from cspace.states import FREE, MIXED

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]

FAR = 2.0**62

BLOCK = 512


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


@njit(cache=True, nogil=True)
def classify(state: States, frame: Floats, box: Ints, beyond: int, points: Floats, out: States) -> int:
    """States of points, shape (n, 2); the index of the first point that is not finite, or -1.

    Cells are found for a block of points and then read in a loop of their own, so that many reads of a map larger than
    the cache are under way at once.
    """
    lower_x, lower_y, spacing = frame[0], frame[1], frame[2]
    nx, ny = state.shape
    flat = state.ravel()
    cells = np.empty(BLOCK, np.int64)
    for first in range(0, points.shape[0], BLOCK):
        size = min(BLOCK, points.shape[0] - first)
        for k in range(size):
            u, v = (points[first + k, 0] - lower_x) / spacing, (points[first + k, 1] - lower_y) / spacing
            inside = 0.0 <= u < nx and 0.0 <= v < ny  # nearly always; False for NaN
            cells[k] = np.int64(u) * ny + np.int64(v) if inside else -1
        for k in range(size):
            if cells[k] >= 0:
                out[first + k] = flat[np.uint64(cells[k])]
                continue
            x, y = points[first + k, 0], points[first + k, 1]
            if not (math.isfinite(x) and math.isfinite(y)):
                return first + k
            out[first + k] = state_at(state, frame, box, beyond, x, y)
    return -1


@njit(cache=True, nogil=True)
def edge_is_free(
    state: States, frame: Floats, box: Ints, beyond: int, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Whether every closed cell within SLACK of a straight edge is FREE."""
    lower_x, lower_y, spacing, upper_x, upper_y = frame[0], frame[1], frame[2], frame[3], frame[4]
    nx, ny = state.shape
    px, py = (x0 - lower_x) / spacing, (y0 - lower_y) / spacing
    qx, qy = (x1 - lower_x) / spacing, (y1 - lower_y) / spacing
    if not abs(px) + abs(py) + abs(qx) + abs(qy) <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    first_x, first_y, last_x, last_y = 0, 0, nx - 1, ny - 1
    if not (min(x0, x1) >= lower_x and max(x0, x1) <= upper_x and min(y0, y1) >= lower_y and max(y0, y1) <= upper_y):
        # An edge that leaves the grid is proven only where all is FREE beyond the grid and the box.
        if beyond != FREE:
            return False
        first_x, last_x = min(box[0], 0), max(box[2], nx - 1)
        first_y, last_y = min(box[1], 0), max(box[3], ny - 1)
    if px > qx:
        px, py, qx, qy = qx, qy, px, py
    low_y, high_y = min(py, qy), max(py, qy)
    for i in range(max(first_x, math.ceil(px - SLACK) - 1), min(last_x, math.floor(qx + SLACK)) + 1):
        low, high = low_y, high_y
        if qx > px:
            # A ratio of differences, between 0 and 1: a slope would overflow on edges that are all but upright.
            a = py + (min(max(i - SLACK, px), qx) - px) / (qx - px) * (qy - py)
            b = py + (min(max(i + 1 + SLACK, px), qx) - px) / (qx - px) * (qy - py)
            low, high = max(min(a, b), low_y), min(max(a, b), high_y)
        for j in range(max(first_y, math.ceil(low - SLACK) - 1), min(last_y, math.floor(high + SLACK)) + 1):
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
    state: States, frame: Floats, box: Ints, beyond: int, starts: Floats, ends: Floats, out: NDArray[np.bool_]
) -> int:
    """``edge_is_free`` of edges, shapes (n, 2); the index of the first edge that is not finite, or -1."""
    for k in range(starts.shape[0]):
        x0, y0 = starts[k, 0], starts[k, 1]
        x1, y1 = ends[k, 0], ends[k, 1]
        if not (math.isfinite(x0) and math.isfinite(y0) and math.isfinite(x1) and math.isfinite(y1)):
            return k
        out[k] = edge_is_free(state, frame, box, beyond, x0, y0, x1, y1)
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

"""Compiled look-ups of configurations ``(x, y, z)``, in metres.

``frame`` is the lower corner, the spacing and the upper corner of the grid. What lies outside the grid is given by
``box`` and ``beyond``: a cell outside the grid has the state ``beyond`` where it lies outside the box of cells, given
by its first cell and its last one, and is MIXED where it lies in it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace._kernels import ASK, BLOCK, FAR, INSIDE, cell_at, read_states, scaled
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.states import FREE, MIXED

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]


@njit(cache=True, nogil=True)
def state_at(state: States, frame: Floats, box: Ints, beyond: int, x: float, y: float, z: float) -> int:
    """State of one configuration."""
    nx, ny, nz = state.shape
    i = cell_at(x, frame[0], frame[3], frame[4], nx)
    j = cell_at(y, frame[1], frame[3], frame[5], ny)
    k = cell_at(z, frame[2], frame[3], frame[6], nz)
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return int(state[i, j, k])
    if box[0] <= i <= box[3] and box[1] <= j <= box[4] and box[2] <= k <= box[5]:
        return MIXED
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return MIXED
    return beyond


@njit(cache=True)  # too short to let go of the interpreter for
def point_is_free(state: States, frame: Floats, box: Ints, beyond: int, x: float, y: float, z: float) -> bool:
    """Whether one configuration is FREE."""
    return bool(state_at(state, frame, box, beyond, x, y, z) == FREE)


@njit(cache=True, nogil=True)
def cells_of(uvw: Floats, shape: tuple[int, int, int], box: Ints, beyond: int, cells: Ints, codes: States) -> int:
    """Cells and codes of points that are given in cells, as :func:`cspace._kernels.cells_of` has them in the plane."""
    nx, ny, nz = float(shape[0]), float(shape[1]), float(shape[2])
    x0, y0, z0 = float(box[0]), float(box[1]), float(box[2])
    x1, y1, z1 = float(box[3]) + 1.0, float(box[4]) + 1.0, float(box[5]) + 1.0
    asked = 0
    for n in range(cells.shape[0]):
        u, v, w = uvw[3 * n], uvw[3 * n + 1], uvw[3 * n + 2]
        inside = (u >= 0.0) & (u < nx) & (v >= 0.0) & (v < ny) & (w >= 0.0) & (w < nz)
        cells[n] = (np.int64(u) * shape[1] + np.int64(v)) * shape[2] + np.int64(w) if inside else 0
        border = ((nx <= u) & (u < nx + 1.0)) | ((ny <= v) & (v < ny + 1.0)) | ((nz <= w) & (w < nz + 1.0))
        ask = border | (not (abs(u) + abs(v) + abs(w) < FAR))
        boxed = (x0 <= u) & (u < x1) & (y0 <= v) & (v < y1) & (z0 <= w) & (w < z1)
        code = INSIDE if inside else (ASK if ask else (MIXED if boxed else beyond))
        codes[n] = code
        asked += code == ASK
    return asked


@njit(cache=True, nogil=True)
def classify(state: States, frame: Floats, box: Ints, beyond: int, points: Floats, out: States) -> int:
    """States of points, shape (n, 3); the index of the first point that is not finite, or -1."""
    flat, numbers = state.ravel(), points.reshape(-1)
    size = min(BLOCK, len(points))
    lows, scales, uvw = np.empty(3 * size), np.full(3 * size, frame[3]), np.empty(3 * size)
    lows[0::3], lows[1::3], lows[2::3] = frame[0], frame[1], frame[2]
    cells, codes = np.empty(size, np.int64), np.empty(size, np.uint8)
    for first in range(0, points.shape[0], BLOCK):
        last = min(first + BLOCK, points.shape[0])
        scaled(numbers[3 * first : 3 * last], lows, scales, uvw)
        asked = cells_of(uvw, state.shape, box, beyond, cells[: last - first], codes)
        read_states(flat, cells[: last - first], codes, out[first:last])
        if asked == 0:
            continue
        for n in range(first, last):
            if codes[n - first] == ASK:
                x, y, z = points[n, 0], points[n, 1], points[n, 2]
                if not is_usable(x, y, z):
                    return n
                out[n] = state_at(state, frame, box, beyond, x, y, z)
    return -1


@njit(cache=True, nogil=True)
def is_usable(x: float, y: float, z: float) -> bool:
    """Whether all three are finite."""
    return math.isfinite(x) and math.isfinite(y) and math.isfinite(z)


@njit(cache=True, nogil=True)
def run_is_free(state: States, box: Ints, i: int, j: int, first: int, last: int) -> bool:
    """Whether the cells ``first <= k <= last`` of the column (i, j) are FREE, all beyond the grid and the box being."""
    nx, ny, nz = state.shape
    if 0 <= i < nx and 0 <= j < ny:
        for k in range(max(first, 0), min(last, nz - 1) + 1):
            if state[i, j, k] != FREE:
                return False
    low, high = max(first, box[2]), min(last, box[5])
    if low > high or not (box[0] <= i <= box[3] and box[1] <= j <= box[4]):
        return True
    return bool(0 <= i < nx and 0 <= j < ny and low >= 0 and high < nz)


@njit(cache=True, nogil=True)
def cube_is_free(
    state: States, frame: Floats, box: Ints, beyond: int, x: float, y: float, z: float, distance: float
) -> bool:
    """Whether every closed cell within SLACK of the cube ``[x - distance, x + distance] x ...`` is FREE."""
    nx, ny, nz = state.shape
    spacing = frame[3]
    px, py, pz = (x - frame[0]) / spacing, (y - frame[1]) / spacing, (z - frame[2]) / spacing
    reach = distance / spacing + SLACK
    if not abs(px) + abs(py) + abs(pz) + reach <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    first_x, last_x = math.ceil(px - reach) - 1, math.floor(px + reach)
    first_y, last_y = math.ceil(py - reach) - 1, math.floor(py + reach)
    first_z, last_z = math.ceil(pz - reach) - 1, math.floor(pz + reach)
    if min(first_x, first_y, first_z) < 0 or last_x >= nx or last_y >= ny or last_z >= nz:
        if beyond != FREE:
            return False
        first_x, last_x = max(first_x, min(box[0], 0)), min(last_x, max(box[3], nx - 1))
        first_y, last_y = max(first_y, min(box[1], 0)), min(last_y, max(box[4], ny - 1))
    for i in range(first_x, last_x + 1):
        for j in range(first_y, last_y + 1):
            if not run_is_free(state, box, i, j, first_z, last_z):
                return False
    return True


@njit(cache=True, nogil=True)
def boxes_are_free(
    state: States, frame: Floats, box: Ints, beyond: int, distance: float, points: Floats, out: NDArray[np.bool_]
) -> int:
    """``cube_is_free`` around points, shape (n, 3); the index of the first point that is not finite, or -1."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not is_usable(x, y, z):
            return n
        out[n] = cube_is_free(state, frame, box, beyond, x, y, z, distance)
    return -1


@njit(cache=True, nogil=True)
def overlap_at(
    sums: NDArray[np.signedinteger[Any]], frame: Floats, runs: Ints, outside: int, x: float, y: float, z: float
) -> int:
    """Overlap of a robot at a point, summed run by run.

    ``sums[i, j, k]`` is the number of obstacle cells among the first k of the column (i, j), and each of ``runs`` a row
    ``(dx, dy, first dz, last dz)`` of robot offsets.
    """
    nx, ny, nz = sums.shape[0], sums.shape[1], sums.shape[2] - 1
    i = cell_at(x, frame[0], frame[3], frame[4], nx)
    j = cell_at(y, frame[1], frame[3], frame[5], ny)
    k = cell_at(z, frame[2], frame[3], frame[6], nz)
    total = 0
    for r in range(runs.shape[0]):
        a, b = i + runs[r, 0], j + runs[r, 1]
        first, last = k + runs[r, 2], k + runs[r, 3]
        hidden = last - first + 1
        if 0 <= a < nx and 0 <= b < ny:
            begin = min(max(first, 0), nz)
            end = min(max(last + 1, 0), nz)
            total += sums[a, b, end] - sums[a, b, begin]
            hidden -= end - begin
        total += hidden * outside
    return total


@njit(cache=True, nogil=True)
def overlaps(
    sums: NDArray[np.signedinteger[Any]], frame: Floats, runs: Ints, outside: int, points: Floats, out: Ints
) -> int:
    """``overlap_at`` of points, shape (n, 3); the index of the first point that is not finite, or -1."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not is_usable(x, y, z):
            return n
        out[n] = overlap_at(sums, frame, runs, outside, x, y, z)
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
    z: float,
) -> float:
    """Lower bound of the distance from a point to the nearest configuration that is not FREE, in metres.

    Distance is 1-Lipschitz, so each neighbouring cell's middle bounds it from below; the best of 27 is taken. ``walls``
    are the boxes of cells outside the grid that are not FREE, and ``some`` tells whether any cell in the grid is not.
    """
    if state_at(state, frame, box, beyond, x, y, z) != FREE:
        return 0.0
    nx, ny, nz = state.shape
    spacing = frame[3]
    px, py, pz = (x - frame[0]) / spacing, (y - frame[1]) / spacing, (z - frame[2]) / spacing
    best = math.inf
    i = cell_at(x, frame[0], spacing, frame[4], nx)
    j = cell_at(y, frame[1], spacing, frame[5], ny)
    k = cell_at(z, frame[2], spacing, frame[6], nz)
    if some and 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        best = 0.0
        for a in range(max(i - 1, 0), min(i + 1, nx - 1) + 1):
            for b in range(max(j - 1, 0), min(j + 1, ny - 1) + 1):
                for c in range(max(k - 1, 0), min(k + 1, nz - 1) + 1):
                    apart = math.sqrt((a + 0.5 - px) ** 2 + (b + 0.5 - py) ** 2 + (c + 0.5 - pz) ** 2)
                    best = max(best, 0.5 * math.sqrt(float(squares[a, b, c])) - apart)
    elif some:
        best = box_distance(np.array([0.0, 0.0, 0.0, nx, ny, nz]), px, py, pz)
    for n in range(walls.shape[0]):
        best = min(best, box_distance(walls[n], px, py, pz))
    if best == math.inf and (some or len(walls) > 0):
        return 0.0  # too far away for a distance to be told
    return max(0.0, best * (1.0 - 2.0**-48) - 4.0 * SLACK) * float(spacing)


@njit(cache=True, nogil=True)
def box_distance(box: Floats, x: float, y: float, z: float) -> float:
    """Distance of a point from a box, given by its lower corner and its upper one."""
    dx = max(0.0, box[0] - x, x - box[3])
    dy = max(0.0, box[1] - y, y - box[4])
    dz = max(0.0, box[2] - z, z - box[5])
    return math.hypot(math.hypot(dx, dy), dz)


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
    """``clearance_at`` of points, shape (n, 3); the index of the first point that is not finite, or -1."""
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not is_usable(x, y, z):
            return n
        out[n] = clearance_at(squares, state, frame, box, beyond, walls, some, x, y, z)
    return -1

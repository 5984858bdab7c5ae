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

from cspace._kernels import cell_at
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.states import FREE, MIXED

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]

BLOCK = 512

FINEST = 1.0 / 16.0
"""Least distance of points that are looked at before an edge is walked, as a part of the edge."""

NEAREST = 2.0
"""The same, in cells."""


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
def classify(state: States, frame: Floats, box: Ints, beyond: int, points: Floats, out: States) -> int:
    """States of points, shape (n, 3); the index of the first point that is not finite, or -1.

    Cells are found for a block of points and then read in a loop of their own, so that many reads of a map larger than
    the cache are under way at once.
    """
    lower_x, lower_y, lower_z, spacing = frame[0], frame[1], frame[2], frame[3]
    nx, ny, nz = state.shape
    flat = state.ravel()
    cells = np.empty(BLOCK, np.int64)
    for first in range(0, points.shape[0], BLOCK):
        size = min(BLOCK, points.shape[0] - first)
        for n in range(size):
            u = (points[first + n, 0] - lower_x) / spacing
            v = (points[first + n, 1] - lower_y) / spacing
            w = (points[first + n, 2] - lower_z) / spacing
            inside = (0.0 <= u < nx) & (0.0 <= v < ny) & (0.0 <= w < nz)  # nearly always; False for NaN
            cells[n] = (np.int64(u) * ny + np.int64(v)) * nz + np.int64(w) if inside else -1
        for n in range(size):
            if cells[n] >= 0:
                out[first + n] = flat[np.uint64(cells[n])]
                continue
            x, y, z = points[first + n, 0], points[first + n, 1], points[first + n, 2]
            if not is_usable(x, y, z):
                return first + n
            out[first + n] = state_at(state, frame, box, beyond, x, y, z)
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
def slab_times(p: float, q: float, cell: int) -> tuple[float, float]:
    """The first and last t in [0, 1] at which ``p + t (q - p)`` lies in a cell of a line, widened by SLACK.

    The first is beyond the last where it never does. Ratios of differences, between 0 and 1: a slope would overflow on
    edges that are all but upright.
    """
    low, high = cell - SLACK, cell + 1 + SLACK
    if max(p, q) < low or min(p, q) > high:
        return 1.0, 0.0
    if p == q:
        return 0.0, 1.0
    least, most = min(p, q), max(p, q)
    a = (min(max(low, least), most) - p) / (q - p)
    b = (min(max(high, least), most) - p) / (q - p)
    return min(a, b), max(a, b)


@njit(cache=True, nogil=True)
def span_between(p: float, q: float, first: float, last: float) -> tuple[float, float]:
    """The least and the greatest of ``p + t (q - p)`` for t in [first, last], never beyond p and q."""
    a, b = p + first * (q - p), p + last * (q - p)
    return max(min(a, b), min(p, q)), min(max(a, b), max(p, q))


@njit(cache=True, nogil=True)
def probes_are_free(state: States, px: float, py: float, pz: float, qx: float, qy: float, qz: float) -> bool:
    """Whether some points of an edge in the grid, in cells, lie in FREE cells: its end, its middle, its quarters, ...

    Most edges that a planner asks for meet an obstacle, and this tells sooner than a walk from one end to the other.
    Where it says no, so would the walk: the points lie on the edge but for rounding, which is far below SLACK.
    """
    nx, ny, nz = state.shape
    dx, dy, dz = qx - px, qy - py, qz - pz
    cells = max(abs(dx), abs(dy), abs(dz))
    step = 1.0
    while step >= FINEST and step * cells >= NEAREST:
        t = step
        while t <= 1.0:
            i, j, k = min(int(px + t * dx), nx - 1), min(int(py + t * dy), ny - 1), min(int(pz + t * dz), nz - 1)
            if state[i, j, k] != FREE:
                return False
            t += 2.0 * step
        step *= 0.5
    return True


@njit(cache=True, nogil=True)
def edge_is_free(
    state: States,
    frame: Floats,
    box: Ints,
    beyond: int,
    x0: float,
    y0: float,
    z0: float,
    x1: float,
    y1: float,
    z1: float,
) -> bool:
    """Whether every closed cell within SLACK of a straight edge is FREE.

    The edge is cut into the slabs of cells along x that it meets, each part into slabs along y, and what is left of it
    there meets a run of cells along z.
    """
    lower_x, lower_y, lower_z, spacing = frame[0], frame[1], frame[2], frame[3]
    upper_x, upper_y, upper_z = frame[4], frame[5], frame[6]
    nx, ny, nz = state.shape
    px, py, pz = (x0 - lower_x) / spacing, (y0 - lower_y) / spacing, (z0 - lower_z) / spacing
    qx, qy, qz = (x1 - lower_x) / spacing, (y1 - lower_y) / spacing, (z1 - lower_z) / spacing
    if not abs(px) + abs(py) + abs(pz) + abs(qx) + abs(qy) + abs(qz) <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    first_x, first_y, first_z, last_x, last_y, last_z = 0, 0, 0, nx - 1, ny - 1, nz - 1
    if not (
        min(x0, x1) >= lower_x
        and max(x0, x1) <= upper_x
        and min(y0, y1) >= lower_y
        and max(y0, y1) <= upper_y
        and min(z0, z1) >= lower_z
        and max(z0, z1) <= upper_z
    ):
        # An edge that leaves the grid is proven only where all is FREE beyond the grid and the box.
        if beyond != FREE:
            return False
        first_x, first_y, first_z = min(box[0], 0), min(box[1], 0), min(box[2], 0)
        last_x, last_y, last_z = max(box[3], nx - 1), max(box[4], ny - 1), max(box[5], nz - 1)
    elif not probes_are_free(state, px, py, pz, qx, qy, qz):
        return False
    low_x, high_x = min(px, qx), max(px, qx)
    for i in range(max(first_x, math.ceil(low_x - SLACK) - 1), min(last_x, math.floor(high_x + SLACK)) + 1):
        start, stop = slab_times(px, qx, i)
        if start > stop:
            continue
        low_y, high_y = span_between(py, qy, start, stop)
        for j in range(max(first_y, math.ceil(low_y - SLACK) - 1), min(last_y, math.floor(high_y + SLACK)) + 1):
            enter, leave = slab_times(py, qy, j)
            enter, leave = max(enter, start), min(leave, stop)
            if enter > leave:
                continue
            low_z, high_z = span_between(pz, qz, enter, leave)
            bottom, top = max(first_z, math.ceil(low_z - SLACK) - 1), min(last_z, math.floor(high_z + SLACK))
            if not run_is_free(state, box, i, j, bottom, top):
                return False
    return True


@njit(cache=True, nogil=True)
def edges_are_free(
    state: States, frame: Floats, box: Ints, beyond: int, starts: Floats, ends: Floats, out: NDArray[np.bool_]
) -> int:
    """``edge_is_free`` of edges, shapes (n, 3); the index of the first edge that is not finite, or -1."""
    for n in range(starts.shape[0]):
        x0, y0, z0 = starts[n, 0], starts[n, 1], starts[n, 2]
        x1, y1, z1 = ends[n, 0], ends[n, 1], ends[n, 2]
        if not (is_usable(x0, y0, z0) and is_usable(x1, y1, z1)):
            return n
        out[n] = edge_is_free(state, frame, box, beyond, x0, y0, z0, x1, y1, z1)
    return -1


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

"""Compiled walks along straight edges in space; frame, box and beyond are as in :mod:`cspace.spatial._kernels`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.coarse.sides import SHIFT, SIDE
from cspace.grid import MAX_COORDINATE, SLACK
from cspace.spatial._kernels import is_usable, run_is_free
from cspace.states import FREE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]

FINEST = 1.0 / 16.0
"""Least distance of points that are looked at before an edge is walked, as a part of the edge."""

NEAREST = 2.0
"""The same, in cells."""


@njit(cache=True, nogil=True, error_model="numpy")
def slab_times(p: float, q: float, first: int, last: int) -> tuple[float, float]:
    """The first and last t in [0, 1] at which ``p + t (q - p)`` lies in some cells of a line, widened by SLACK.

    The first is beyond the last where it never does. Ratios of differences, between 0 and 1: a slope would overflow on
    edges that are all but upright. Every operation rounds monotonically, so that the times of several cells hold those
    of each.
    """
    low, high = first - SLACK, last + 1 + SLACK
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
    """Whether every closed cell within SLACK of a straight edge is FREE."""
    return coarse_edge_is_free(state, state[:0], frame, box, beyond, x0, y0, z0, x1, y1, z1)


@njit(cache=True, nogil=True, inline="always")  # a call takes as long as a short edge
def coarse_edge_is_free(
    state: States,
    coarse: States,
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
    """``edge_is_free`` with the help of a coarse map, which may be empty."""
    lower_x, lower_y, lower_z, spacing = frame[0], frame[1], frame[2], frame[3]
    upper_x, upper_y, upper_z = frame[4], frame[5], frame[6]
    nx, ny, nz = state.shape
    px, py, pz = (x0 - lower_x) / spacing, (y0 - lower_y) / spacing, (z0 - lower_z) / spacing
    qx, qy, qz = (x1 - lower_x) / spacing, (y1 - lower_y) / spacing, (z1 - lower_z) / spacing
    if not abs(px) + abs(py) + abs(pz) + abs(qx) + abs(qy) + abs(qz) <= 8.0 * MAX_COORDINATE:  # nor is NaN
        return False
    edge = (px, py, pz, qx, qy, qz)
    lows, highs = (0, 0, 0), (nx - 1, ny - 1, nz - 1)
    first, last = math.ceil(min(px, qx) - SLACK) - 1, math.floor(max(px, qx) + SLACK)
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
        lows = (min(box[0], 0), min(box[1], 0), min(box[2], 0))
        highs = (max(box[3], nx - 1), max(box[4], ny - 1), max(box[5], nz - 1))
        return slabs_are_free(state, box, edge, max(first, lows[0]), min(last, highs[0]), lows, highs)
    first, last = max(first, 0), min(last, nx - 1)
    if not probes_are_free(state, px, py, pz, qx, qy, qz):
        return False
    if coarse.shape[0] == 0:
        return slabs_are_free(state, box, edge, first, last, lows, highs)
    return blocks_are_free(state, coarse, box, edge, first, last)


@njit(cache=True, nogil=True)
def slabs_are_free(
    state: States,
    box: Ints,
    edge: tuple[float, float, float, float, float, float],
    first: int,
    last: int,
    lows: tuple[int, int, int],
    highs: tuple[int, int, int],
) -> bool:
    """Whether an edge is FREE in the slabs of cells from ``first`` to ``last`` along x, looking from lows to highs.

    It is cut into those slabs, each part into slabs along y, and what is left of it there meets a run of cells along z.
    """
    px, py, pz, qx, qy, qz = edge
    for i in range(first, last + 1):
        start, stop = slab_times(px, qx, i, i)
        if start > stop:
            continue
        low, high = span_between(py, qy, start, stop)
        for j in range(max(lows[1], math.ceil(low - SLACK) - 1), min(highs[1], math.floor(high + SLACK)) + 1):
            enter, leave = slab_times(py, qy, j, j)
            enter, leave = max(enter, start), min(leave, stop)
            if enter > leave:
                continue
            bottom, top = span_between(pz, qz, enter, leave)
            k, end = max(lows[2], math.ceil(bottom - SLACK) - 1), min(highs[2], math.floor(top + SLACK))
            if not run_is_free(state, box, i, j, k, end):
                return False
    return True


@njit(cache=True, nogil=True)
def blocks_are_free(
    state: States,
    coarse: States,
    box: Ints,
    edge: tuple[float, float, float, float, float, float],
    first: int,
    last: int,
) -> bool:
    """The same of an edge in the grid: it is cut into slabs of blocks, and walked only in those that are not FREE."""
    nx, ny, nz = state.shape
    px, py, pz, qx, qy, qz = edge
    for a in range(first >> SHIFT, (last >> SHIFT) + 1):
        begin, end = max(first, a << SHIFT), min(last, (a << SHIFT) + SIDE - 1)
        start, stop = slab_times(px, qx, begin, end)
        if start > stop:
            continue
        low, high = span_between(py, qy, start, stop)
        near, far = max(0, math.ceil(low - SLACK) - 1), min(ny - 1, math.floor(high + SLACK))
        for b in range(near >> SHIFT, (far >> SHIFT) + 1):
            left, right = max(near, b << SHIFT), min(far, (b << SHIFT) + SIDE - 1)
            enter, leave = slab_times(py, qy, left, right)
            enter, leave = max(enter, start), min(leave, stop)
            if enter > leave:
                continue
            bottom, top = span_between(pz, qz, enter, leave)
            under, over = max(0, math.ceil(bottom - SLACK) - 1), min(nz - 1, math.floor(top + SLACK))
            mark = 0
            for c in range(under >> SHIFT, (over >> SHIFT) + 1):
                mark |= coarse[np.uint64(a), np.uint64(b), np.uint64(c)]
            if mark != FREE and not slabs_are_free(state, box, edge, begin, end, (0, left, 0), (nx - 1, right, nz - 1)):
                return False
    return True


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
    """``edge_is_free`` of edges, shapes (n, 3); the index of the first edge that is not finite, or -1."""
    for n in range(starts.shape[0]):
        x0, y0, z0 = starts[n, 0], starts[n, 1], starts[n, 2]
        x1, y1, z1 = ends[n, 0], ends[n, 1], ends[n, 2]
        if not (is_usable(x0, y0, z0) and is_usable(x1, y1, z1)):
            return n
        out[n] = coarse_edge_is_free(state, coarse, frame, box, beyond, x0, y0, z0, x1, y1, z1)
    return -1

"""Compiled kernels of the rasters of triangles. Lengths are in cells, in the index frame of the array that is written.

A *box* ``i`` is ``i + [b0, b1]`` along each axis: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer
raster of a robot, ``(0, 0)`` for lattice points. A *run* is a longest stretch of False entries along the last axis.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]
Labels = NDArray[np.int32]


@njit(cache=True, nogil=True)
def _at(plane: float, pa: float, qa: float, pc: float, qc: float) -> float:
    """Coordinate c where a segment meets a plane of axis a, computed from the nearer end for the smaller rounding."""
    t = (plane - pa) / (qa - pa)
    if t <= 0.5:
        return pc + t * (qc - pc)
    return qc + (plane - qa) / (pa - qa) * (pc - qc)


@njit(cache=True, nogil=True)
def _clip_to_slab(triangle: Floats, x0: float, x1: float, polygon: Floats) -> int:
    """The (y, z) of the corners, in order, of the part of a triangle over ``x0 <= x <= x1``; their number."""
    n = 0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[(e + 1) % 3]
        if x0 <= px <= x1:
            polygon[n, 0], polygon[n, 1] = py, pz
            n += 1
        for side in range(2):
            plane = x0 if (side == 0) == (px < qx) else x1
            if (px < plane < qx) or (qx < plane < px):
                polygon[n, 0] = _at(plane, px, qx, py, qy)
                polygon[n, 1] = _at(plane, px, qx, pz, qz)
                n += 1
    return n


@njit(cache=True, nogil=True)
def _span_over_slab(polygon: Floats, n: int, y0: float, y1: float) -> tuple[float, float]:
    """z-interval of the part of a convex polygon (y, z) over ``y0 <= y <= y1``; (inf, -inf) where there is none."""
    low, high = math.inf, -math.inf
    for e in range(n):
        py, pz = polygon[e]
        qy, qz = polygon[e + 1 if e + 1 < n else 0]
        if y0 <= py <= y1:
            low, high = min(low, pz), max(high, pz)
        if (py < y0 < qy) or (qy < y0 < py):
            z = _at(y0, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
        if (py < y1 < qy) or (qy < y1 < py):
            z = _at(y1, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
    return low, high


@njit(cache=True, nogil=True)
def mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float, start: int, stop: int) -> None:
    """Set ``out[i]`` where box ``i`` comes within ``slack`` of a triangle, for first indices in ``[start, stop)``."""
    _, ny, nz = out.shape
    polygon = np.empty((9, 2))
    for t in range(triangles.shape[0]):
        triangle = triangles[t]
        low_x = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        high_x = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        first = max(start, math.ceil(low_x - slack - b1))
        last = min(stop - 1, math.floor(high_x + slack - b0))
        for i in range(first, last + 1):
            n = _clip_to_slab(triangle, i + b0 - slack, i + b1 + slack, polygon)
            if n == 0:
                continue
            low_y, high_y = polygon[0, 0], polygon[0, 0]
            for e in range(1, n):
                low_y, high_y = min(low_y, polygon[e, 0]), max(high_y, polygon[e, 0])
            first_y = max(0, math.ceil(low_y - slack - b1))
            last_y = min(ny - 1, math.floor(high_y + slack - b0))
            for j in range(first_y, last_y + 1):
                low, high = _span_over_slab(polygon, n, j + b0 - slack, j + b1 + slack)
                if low > high:
                    continue
                first_z = max(0, math.ceil(low - slack - b1))
                last_z = min(nz - 1, math.floor(high + slack - b0))
                for k in range(first_z, last_z + 1):
                    out[i, j, k] = True


@njit(cache=True, nogil=True)
def count_runs(blocked: Bools, counts: Integers, start: int, stop: int) -> None:
    """Set ``counts[i * ny + j]``, for first indices in ``[start, stop)``, to the number of runs in that column."""
    _, ny, nz = blocked.shape
    for i in range(start, stop):
        for j in range(ny):
            number, before = 0, True
            for k in range(nz):
                here = blocked[i, j, k]
                number += before and not here
                before = here
            counts[i * ny + j] = number


@njit(cache=True, nogil=True)
def list_runs(blocked: Bools, offsets: Integers, lows: Labels, highs: Labels, start: int, stop: int) -> None:
    """Write first and last index of each run, for first indices in ``[start, stop)``, from the column's offset on."""
    _, ny, nz = blocked.shape
    for i in range(start, stop):
        for j in range(ny):
            run, before = offsets[i * ny + j], True
            for k in range(nz):
                here = blocked[i, j, k]
                if before and not here:
                    lows[run] = k
                elif here and not before:
                    highs[run] = k - 1
                    run += 1
                before = here
            if not before:
                highs[run] = nz - 1


@njit(cache=True, nogil=True)
def _root(parents: Labels, run: int) -> int:
    while parents[run] != run:
        parents[run] = parents[parents[run]]
        run = parents[run]
    return run


@njit(cache=True, nogil=True)
def _join_columns(offsets: Integers, lows: Labels, highs: Labels, parents: Labels, column: int, other: int) -> None:
    """Join the runs of two neighbouring columns that overlap."""
    a, b = offsets[column], offsets[other]
    while a < offsets[column + 1] and b < offsets[other + 1]:
        if lows[a] <= highs[b] and lows[b] <= highs[a]:
            first, second = _root(parents, a), _root(parents, b)
            parents[max(first, second)] = min(first, second)
        if highs[a] < highs[b]:
            a += 1
        else:
            b += 1


@njit(cache=True, nogil=True)
def label_runs(ny: int, offsets: Integers, lows: Labels, highs: Labels, parents: Labels, labels: Labels) -> int:
    """Number the components of runs that share a side of a cell, by their first runs; how many there are.

    ``parents`` is room for work, of the size of ``labels``.
    """
    for run in range(len(parents)):
        parents[run] = run
    for column in range(len(offsets) - 1):
        if column % ny > 0:
            _join_columns(offsets, lows, highs, parents, column, column - 1)
        if column >= ny:
            _join_columns(offsets, lows, highs, parents, column, column - ny)
    number = 0
    for run in range(len(parents)):
        # A root is the smallest run of its component, and a parent is smaller than its child: it has its number.
        if parents[run] == run:
            labels[run] = number
            number += 1
        else:
            labels[run] = labels[parents[run]]
    return number


@njit(cache=True, nogil=True)
def fill_runs(
    out: Bools, offsets: Integers, lows: Labels, highs: Labels, labels: Labels, chosen: Bools, start: int, stop: int
) -> None:
    """Set ``out`` on the runs of the chosen components, for first indices in ``[start, stop)``."""
    ny = out.shape[1]
    for i in range(start, stop):
        for j in range(ny):
            for run in range(offsets[i * ny + j], offsets[i * ny + j + 1]):
                if chosen[labels[run]]:
                    out[i, j, lows[run] : highs[run] + 1] = True

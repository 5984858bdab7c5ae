"""Winding numbers: how often closed surfaces of triangles go round a point.

A ray runs from the point along z, and the triangles that it crosses are summed up: 1 where the ray leaves through the
front of one, -1 where it enters. Each edge is crossed where half-open intervals say, at a point that all of its
triangles compute alike; so the crossings of closed bodies are those of closed surfaces that differ from them by the
rounding of one interpolation, and another one gives their height. Each is off by less than 3 * 2^-30 cells at
coordinates of 2^22 cells (see :mod:`cspace.raster.triangles`). So a point that is farther from the surface than 2^-27
cells is told right, however the ray meets edges, vertices, or triangles seen from the side: the sum is an integer, and
nothing is rounded to it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.threads import in_chunks

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_MOST_BUCKETS: Final = 1024
_ENTRIES_A_TRIANGLE: Final = 12
_POINTS_A_THREAD: Final = 512


class _Buckets(NamedTuple):
    """Triangles by the rectangles of the plane (x, y) that their bounding boxes meet.

    Attributes
    ----------
    low, scale, shape : ndarray, shape (2,)
        Low corner, buckets per unit length and number of buckets, along x and y.
    starts, entries : ndarray of int64
        The triangles of bucket ``b = i * shape[1] + j`` are ``entries[starts[b]:starts[b + 1]]``.
    """

    low: Floats
    scale: Floats
    shape: Integers
    starts: Integers
    entries: Integers


class Winding:
    """The winding number of closed surfaces, at any point.

    Parameters
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
        They face outward where their corners run counterclockwise; neighbours share their corners to the last bit.
    turns : ndarray of int64, shape (n,)
        How often each counts; -1 against its own direction.
    """

    def __init__(self, triangles: Floats, turns: Integers) -> None:
        self._triangles, self._turns = np.ascontiguousarray(triangles), turns
        self._buckets = _sorted(self._triangles) if len(triangles) else None

    def numbers(self, points: Floats) -> Integers:
        """Winding numbers of points, shape (n, 3), that are farther from the surfaces than rounding; shape (n,)."""
        points = np.ascontiguousarray(points)
        out = np.zeros(len(points), dtype=np.int64)
        buckets = self._buckets
        if buckets is None:
            return out

        def work(start: int, stop: int) -> int:
            _count(points[start:stop], out[start:stop], self._triangles, self._turns, buckets)
            return -1

        in_chunks(work, len(points), _POINTS_A_THREAD)
        return out


def _sorted(triangles: Floats) -> _Buckets:
    flat = triangles[..., :2].reshape(-1, 2)
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    count = min(_MOST_BUCKETS, max(1, int(np.sqrt(len(triangles)))))
    while True:
        shape = np.full(2, count, dtype=np.int64)
        scale = np.divide(shape, extent, out=np.zeros(2), where=extent > 0.0)
        number = int(_count_entries(triangles, low, scale, shape))
        # Large triangles meet many buckets: rather few buckets than long lists of them.
        if count == 1 or number <= _ENTRIES_A_TRIANGLE * len(triangles):
            break
        count //= 2
    starts = np.empty(count * count + 1, dtype=np.int64)
    entries = np.empty(number, dtype=np.int64)
    buckets = _Buckets(low, scale, shape, starts, entries)
    _sort_into_buckets(triangles, buckets)
    return buckets


@jit
def _bucket_of(value: float, low: float, scale: float, count: int) -> int:
    """Bucket of a coordinate; it never falls as the coordinate grows, whatever the rounding."""
    return int(min(max(math.floor((value - low) * scale), 0), count - 1))


@jit
def _buckets_of(triangle: Floats, low: Floats, scale: Floats, shape: Integers) -> tuple[int, int, int, int]:
    """First and last bucket, along x and along y, of a triangle's bounding box."""
    x0 = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
    x1 = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
    y0 = min(triangle[0, 1], triangle[1, 1], triangle[2, 1])
    y1 = max(triangle[0, 1], triangle[1, 1], triangle[2, 1])
    return (
        _bucket_of(x0, low[0], scale[0], shape[0]),
        _bucket_of(x1, low[0], scale[0], shape[0]),
        _bucket_of(y0, low[1], scale[1], shape[1]),
        _bucket_of(y1, low[1], scale[1], shape[1]),
    )


@jit
def _count_entries(triangles: Floats, low: Floats, scale: Floats, shape: Integers) -> int:
    """Number of (bucket, triangle) pairs."""
    number = 0
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        number += (i1 - i0 + 1) * (j1 - j0 + 1)
    return number


@jit
def _sort_into_buckets(triangles: Floats, buckets: _Buckets) -> None:
    """Fill ``starts`` and ``entries``; each bucket holds its triangles in order."""
    low, scale, shape, starts, entries = buckets
    starts[:] = 0
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                starts[i * shape[1] + j + 1] += 1
    for b in range(len(starts) - 1):
        starts[b + 1] += starts[b]
    free = starts[:-1].copy()
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                b = i * shape[1] + j
                entries[free[b]] = t
                free[b] += 1


@jit
def _crossing(triangle: Floats, x: float, y: float) -> tuple[int, float]:
    """How a line along z at (x, y) crosses a triangle: 1 where its normal points up, -1 down, 0 not; and at which z.

    An edge is met where ``x`` lies in the half-open interval of its ends, and its point there is computed from its end
    with the smaller x or from the other one, whichever is nearer, so that all triangles at an edge find the same point.
    """
    sign = 0
    above_y, above_z, below_y, below_z = 0.0, 0.0, 0.0, 0.0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[e + 1 if e < 2 else 0]
        if (px <= x) == (qx <= x):
            continue
        turn = 1
        if px <= x:
            turn = -1
        else:
            px, py, pz, qx, qy, qz = qx, qy, qz, px, py, pz
        t = (x - px) / (qx - px)
        if t <= 0.5:
            ey, ez = py + t * (qy - py), pz + t * (qz - pz)
        else:
            t = (x - qx) / (px - qx)
            ey, ez = qy + t * (py - qy), qz + t * (pz - qz)
        if ey > y:
            sign += turn
            above_y, above_z = ey, ez
        else:
            below_y, below_z = ey, ez
    if sign == 0:
        return 0, 0.0
    t = (y - below_y) / (above_y - below_y)
    if t <= 0.5:
        return sign, below_z + t * (above_z - below_z)
    return sign, above_z + (y - above_y) / (below_y - above_y) * (below_z - above_z)


@jit
def _count(points: Floats, out: Integers, triangles: Floats, turns: Integers, buckets: _Buckets) -> None:
    """Set ``out`` to the winding number of each point."""
    low, scale, shape, starts, entries = buckets
    for p in range(len(points)):
        x, y, z = points[p]
        b = _bucket_of(x, low[0], scale[0], shape[0]) * shape[1] + _bucket_of(y, low[1], scale[1], shape[1])
        number = 0
        for entry in range(starts[b], starts[b + 1]):
            t = entries[entry]
            sign, height = _crossing(triangles[t], x, y)
            if sign != 0 and height > z:
                number += sign * turns[t]
        out[p] = number

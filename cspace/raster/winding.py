"""Winding numbers: how often closed surfaces of triangles go round a point.

A ray runs from the point along z, and the triangles that it crosses are summed up: 1 where the ray leaves through the
front of one, -1 where it enters. Each edge is crossed where half-open intervals say, at a point that all of its
triangles compute alike; so the crossings of closed bodies are those of closed surfaces that differ from them by the
rounding of one interpolation, and another one gives their height. Each is off by less than 3 * 2^-30 cells at
coordinates of 2^22 cells (see :mod:`cspace.raster.triangles`). So the number is right for a point that is farther from
the surface than 2^-27 cells, however the ray meets edges, vertices, or triangles seen from the side: the sum is an
integer, and nothing is rounded to it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.threads import in_chunks

_MOST_BUCKETS: Final = 1024
_ENTRIES_A_TRIANGLE: Final = 12
_POINTS_A_THREAD: Final = 512
_SLABS_A_THREAD: Final = 32


class Buckets(NamedTuple):
    """Which triangles are near: they are sorted by the rectangles of the plane (x, y) that their bounding boxes meet.

    Attributes
    ----------
    low, scale, shape : ndarray, shape (2,)
        Low corner, buckets per unit length and number of buckets, along x and y.
    starts, entries : ndarray of int64
        The triangles of bucket ``b = i * shape[1] + j`` are ``entries[starts[b]:starts[b + 1]]``.
    """

    low: Floats
    scale: Floats
    shape: Ints
    starts: Ints
    entries: Ints

    @classmethod
    def of(cls, triangles: Floats) -> Buckets:
        """Triangles, shape (n, 3, 3), n >= 1, in buckets; each bucket holds them in order."""
        lows, highs = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
        low = lows.min(axis=0)
        extent = highs.max(axis=0) - low
        count = min(_MOST_BUCKETS, max(1, int(np.sqrt(len(triangles)))))
        while True:
            scale = np.divide(count, extent, out=np.zeros(2), where=extent > 0.0)
            # As the compiled rays find their bucket; it never falls as the coordinate grows, whatever the rounding.
            first, last = (
                np.clip(np.floor((corners - low) * scale), 0, count - 1).astype(np.int64) for corners in (lows, highs)
            )
            rows, columns = (last - first + 1).T
            numbers = rows * columns
            # Large triangles meet many buckets: rather few buckets than long lists of them.
            if count == 1 or numbers.sum() <= _ENTRIES_A_TRIANGLE * len(triangles):
                break
            count //= 2
        starts, entries = np.zeros(count * count + 1, dtype=np.int64), np.empty(numbers.sum(), dtype=np.int64)
        _fill(first, last, count, starts, entries)
        return cls(low, scale, np.full(2, count, dtype=np.int64), starts, entries)

    def near(self, lower: Floats, upper: Floats) -> Ints:
        """Numbers, ascending, of all triangles that meet a box of space, and of some that are near it."""
        corners = ((np.stack([lower, upper])[:, :2] - self.low) * self.scale, 0, self.shape - 1)
        (first, left), (last, right) = np.clip(np.floor(corners[0]), *corners[1:]).astype(np.int64)
        rows = np.arange(first, last + 1) * self.shape[1]
        runs = zip(self.starts[rows + left].tolist(), self.starts[rows + right + 1].tolist(), strict=True)
        chosen = np.zeros(int(self.entries.max()) + 1, dtype=np.bool_)
        for start, stop in runs:
            chosen[self.entries[start:stop]] = True
        return np.flatnonzero(chosen)


@kernel
def _fill(first: Ints, last: Ints, count: int, starts: Ints, entries: Ints) -> None:
    """Sort triangles into buckets, by the first and the last row and column of each, shape (n, 2)."""
    for t in range(len(first)):
        for row in range(first[t, 0], last[t, 0] + 1):
            for column in range(first[t, 1], last[t, 1] + 1):
                starts[row * count + column] += 1
    stop = 0
    for b in range(len(starts)):
        stop += starts[b]
        starts[b] = stop
    # Backwards, so that each bucket ends up with its triangles in order, and its start where it begins.
    for t in range(len(first) - 1, -1, -1):
        for row in range(first[t, 0], last[t, 0] + 1):
            for column in range(first[t, 1], last[t, 1] + 1):
                starts[row * count + column] -= 1
                entries[starts[row * count + column]] = t


class Winding:
    """The winding number of closed surfaces, at any point.

    Triangles, shape (n, 3, 3), face outward where their corners run counterclockwise; neighbours share their corners to
    the last bit. ``turns`` is how often each counts; -1 against its own direction.
    """

    def __init__(self, triangles: Floats, turns: Ints) -> None:
        self._triangles, self._turns = np.ascontiguousarray(triangles), turns
        self._buckets = Buckets.of(self._triangles) if len(triangles) else None

    def numbers(self, points: Floats) -> Ints:
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


def mark_enclosed(out: Bools, triangles: Floats, turns: Ints) -> None:
    """Set ``out[i]`` where closed surfaces go round the lattice point ``i``: their winding number there is not zero.

    The triangles, shape (n, 3, 3), are in cells, as the indices of ``out``, out of which they may reach; as those
    of :class:`Winding`, with how often each counts.
    """

    def work(start: int, stop: int) -> int:
        _mark_enclosed(out, triangles, turns, start, stop)
        return -1

    in_chunks(work, len(out), _SLABS_A_THREAD)


@kernel
def _bucket_of(value: float, low: float, scale: float, count: int) -> int:
    """Bucket of a coordinate."""
    return int(min(max(math.floor((value - low) * scale), 0), count - 1))


@kernel
def _chord(triangle: Floats, x: float) -> tuple[int, float, float, float, float]:
    """The part of a triangle that a plane across x cuts: which way it faces, and (y, z) of its lower and upper end.

    It faces up with 1 and down with -1, and is not there with 0. An edge is met where ``x`` lies in the half-open
    interval of its ends, and its point there is computed from its end with the smaller x or from the other one,
    whichever is nearer, so that all triangles at an edge compute the same point.
    """
    turn, number = 0, 0
    low_y, low_z, high_y, high_z = 0.0, 0.0, 0.0, 0.0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[e + 1 if e < 2 else 0]
        if (px <= x) == (qx <= x):
            continue
        sign = 1
        if px <= x:
            sign = -1
        else:
            px, py, pz, qx, qy, qz = qx, qy, qz, px, py, pz
        t = (x - px) / (qx - px)
        if t <= 0.5:
            y, z = py + t * (qy - py), pz + t * (qz - pz)
        else:
            t = (x - qx) / (px - qx)
            y, z = qy + t * (py - qy), qz + t * (pz - qz)
        if number == 0 or y > high_y:
            if number == 0:
                low_y, low_z = y, z
            turn, high_y, high_z = sign, y, z
        else:
            low_y, low_z = y, z
        number += 1
    return turn, low_y, low_z, high_y, high_z


@kernel
def _height(y: float, low_y: float, low_z: float, high_y: float, high_z: float) -> float:
    """Where the line from one point to another is at y, from the nearer end."""
    t = (y - low_y) / (high_y - low_y)
    if t <= 0.5:
        return low_z + t * (high_z - low_z)
    return high_z + (y - high_y) / (low_y - high_y) * (low_z - high_z)


@kernel
def turn_above(triangle: Floats, x: float, y: float, z: float) -> int:
    """1 where a triangle lies above a point and faces up, -1 where it faces down, 0 where it does not lie there."""
    turn, low_y, low_z, high_y, high_z = _chord(triangle, x)
    return turn if turn != 0 and low_y <= y < high_y and _height(y, low_y, low_z, high_y, high_z) > z else 0


@kernel
def _count(points: Floats, out: Ints, triangles: Floats, turns: Ints, buckets: Buckets) -> None:
    """Set ``out`` to the winding number of each point."""
    low, scale, shape, starts, entries = buckets
    for p in range(len(points)):
        x, y, z = points[p]
        b = _bucket_of(x, low[0], scale[0], shape[0]) * shape[1] + _bucket_of(y, low[1], scale[1], shape[1])
        number = 0
        for entry in range(starts[b], starts[b + 1]):
            t = entries[entry]
            number += turn_above(triangles[t], x, y, z) * turns[t]
        out[p] = number


@jit
def _mark_enclosed(out: Bools, triangles: Floats, turns: Ints, start: int, stop: int) -> None:
    """Set ``out[i]`` where surfaces go round the lattice point ``i``, for first indices in ``[start, stop)``.

    First the crossings of each column of points are counted, then they are listed: the first point above each.
    """
    _, ny, nz = out.shape
    begins, points = np.zeros((stop - start) * ny + 2, np.int64), np.empty(0, np.int64)
    counts = points
    for listing in range(2):
        if listing:
            for column in range(2, len(begins)):
                begins[column] += begins[column - 1]
            points, counts = np.empty(begins[-1], np.int64), np.empty(begins[-1], np.int64)
        for t in range(len(triangles)):
            if turns[t] == 0:
                continue
            triangle = triangles[t]
            low_x = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
            high_x = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
            for i in range(max(start, math.ceil(low_x)), min(stop - 1, math.floor(high_x)) + 1):
                turn, low_y, low_z, high_y, high_z = _chord(triangle, i)
                if turn == 0:
                    continue
                for j in range(max(0, math.ceil(low_y)), min(ny, math.ceil(high_y))):
                    # While a column is listed, its number in ``begins`` moves from where its list begins to its end.
                    column = (i - start) * ny + j
                    if not listing:
                        begins[column + 2] += 1
                        continue
                    place = begins[column + 1]
                    height = _height(j, low_y, low_z, high_y, high_z)
                    points[place], counts[place] = min(max(math.ceil(height), 0), nz), turn * turns[t]
                    begins[column + 1] += 1
    # From below: what faces down is entered.
    entered = np.zeros(nz + 1, np.int64)
    for column in range((stop - start) * ny):
        first, last = begins[column], begins[column + 1]
        if first == last:
            continue
        low, high = nz, 0
        for place in range(first, last):
            point = points[place]
            entered[point] -= counts[place]
            low, high = min(low, point), max(high, point)
        number, row = 0, out[start + column // ny, column % ny]
        for k in range(low, high):
            number += entered[k]
            entered[k] = 0
            if number != 0:
                row[k] = True
        entered[high] = 0

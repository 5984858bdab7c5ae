"""Surfaces in space, and what they enclose: robots and obstacles, outer and inner.

The surface is marked exactly (see :mod:`cspace.raster.triangles`). A box that no triangle touches lies on one side of
it, so that its middle, half a cell or more from the surface, decides whether it lies inside: by the winding number
of the surface, or, of a surface to be filled, by whether untouched boxes join it to those around
the surface.

*Turning.* A rotation cell holds the rotations within an angle a of its representative R. A point p of the robot A is
at most ``2 |p| sin(a / 2)`` from ``R p`` at all of them (about the z axis, ``|p|`` is the distance from it). Cut the
surface into pieces, and let ``g`` be the largest such displacement on a piece, which is that of a corner. Pieces are
small enough for it to vary by no more than about a third of a cell along a side, or a quarter of itself. A point keeps
its distance from the origin as well: it stays in the shell S between the nearest and the farthest point of its piece,
and what comes to a place q was at most ``2 |q| sin(a / 2)`` away, so that g may be that for q, if it is less.

* *Outer.* Let q lie in R' A for a rotation R' of the cell, and not in R A. On the way from R to R', which stays within
  the cell, q passes from the outside of the robot to its inside; so at some rotation R'' on the way it lies on the
  border: ``q = R'' b``, within g of ``R b`` for the piece of b, and in its S. So R A together with all that is within g
  of each piece of R's border, and in the piece's S, holds the robot at every rotation of the cell.
* *Inner.* A point that lies in R A and, for each piece, farther from it than g or not in its S, is on no border on the
  way, and so lies in the robot at every rotation of the cell.

*Winding numbers* say how often closed surfaces go round a point. A ray runs from the point along z, and the triangles
that it crosses are summed up: 1 where the ray leaves through the front of one, -1 where it enters. Each edge is crossed
where half-open intervals say, at a point that all of its triangles compute alike; so the crossings of closed bodies are
those of closed surfaces that differ from them by the rounding of one interpolation, and another one gives their height.
Each is off by less than 3 * 2^-30 cells at coordinates of 2^22 cells (see :mod:`cspace.raster.triangles`). So the
number is right for a point that is farther from the surface than 2^-27 cells, however the ray meets edges, vertices, or
triangles seen from the side: the sum is an integer, and nothing is rounded to it.

*Components* of untouched boxes are held as runs along z. There are about as many runs as columns and touched boxes, so
that labelling costs one look at each box, and memory for the runs alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.errors import InputError
from cspace.grid import SLACK, Grid, check_reach
from cspace.raster import Raster, allocate_bitmap
from cspace.raster.triangles import mark_touched, mark_within, sweep
from cspace.rotations import NO_ROTATION, RotationCell
from cspace.threads import in_chunks

Labels = NDArray[np.int32]

_SLABS_A_THREAD = 32


class Components(NamedTuple):
    """Sets of boxes, joined through sides; compiled functions take them as they are.

    Attributes
    ----------
    shape : tuple of int
        Of the array of boxes.
    offsets : ndarray of int64
        The runs of column ``i * ny + j`` are those from ``offsets[column]`` up to ``offsets[column + 1]``.
    lows, highs, labels : ndarray of int32
        For each run its first and last z, and the number of its component.
    number : int
        Of components.
    """

    shape: tuple[int, int, int]
    offsets: Ints
    lows: Labels
    highs: Labels
    labels: Labels
    number: int

    @classmethod
    def of(cls, blocked: Bools) -> Components:
        """The components of the False entries, shape (nx, ny, nz)."""
        nx, ny, nz = blocked.shape
        counts = np.empty(nx * ny, dtype=np.int64)

        def count(start: int, stop: int) -> int:
            _count_runs(blocked, counts, start, stop)
            return -1

        in_chunks(count, nx, _SLABS_A_THREAD)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        lows, highs, parents, labels = (np.empty(int(offsets[-1]), dtype=np.int32) for _ in range(4))

        def fill(start: int, stop: int) -> int:
            _list_runs(blocked, offsets, lows, highs, start, stop)
            return -1

        in_chunks(fill, nx, _SLABS_A_THREAD)
        number = int(_label_runs(ny, offsets, lows, highs, parents, labels))
        return cls((nx, ny, nz), offsets, lows, highs, labels, number)

    def at(self, boxes: Ints) -> Labels:
        """The component of untouched boxes, numbered in the order of the array, shape (n,)."""
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        starts = column * self.shape[2] + self.lows
        return np.asarray(self.labels[np.searchsorted(starts, boxes, side="right") - 1])

    def lengths(self) -> Ints:
        """How many boxes each component is long, along the axis along which that is most, shape (number,)."""
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        longest = np.zeros(self.number, dtype=np.int64)
        i, j = column // self.shape[1], column % self.shape[1]
        for low, high in ((i, i), (j, j), (self.lows, self.highs)):
            first, last = np.full(self.number, max(self.shape)), np.zeros(self.number, dtype=np.int64)
            np.minimum.at(first, self.labels, low)
            np.maximum.at(last, self.labels, high)
            longest = np.maximum(longest, last - first + 1)
        return longest

    def at_border(self) -> Bools:
        """Whether each component reaches the border of the array, shape (number,)."""
        nx, ny, nz = self.shape
        column = np.repeat(np.arange(nx * ny), np.diff(self.offsets))
        i, j = column // ny, column % ny
        outermost = (i == 0) | (i == nx - 1) | (j == 0) | (j == ny - 1) | (self.lows == 0) | (self.highs == nz - 1)
        border = np.zeros(self.number, dtype=np.bool_)
        border[self.labels[outermost]] = True
        return border

    def fill(self, out: Bools, chosen: Bools) -> None:
        """Set ``out`` on the chosen components, and leave the rest as it is."""

        def work(start: int, stop: int) -> int:
            _fill_runs(out, self, chosen, start, stop)
            return -1

        if chosen.any():
            in_chunks(work, self.shape[0], _SLABS_A_THREAD)


@kernel
def _count_runs(blocked: Bools, counts: Ints, start: int, stop: int) -> None:
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


@kernel
def _list_runs(blocked: Bools, offsets: Ints, lows: Labels, highs: Labels, start: int, stop: int) -> None:
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


@kernel
def find(parents: Labels, node: int) -> int:
    """The root of a node; the way there is halved (Tarjan, 1975)."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@kernel
def unite(parents: Labels, a: int, b: int) -> bool:
    """Join two nodes, the lower root on top; whether they were apart."""
    a, b = find(parents, a), find(parents, b)
    if a == b:
        return False
    parents[max(a, b)] = min(a, b)
    return True


@kernel
def _join_columns(offsets: Ints, lows: Labels, highs: Labels, parents: Labels, column: int, other: int) -> None:
    """Join the runs of two neighbouring columns that overlap."""
    a, b = offsets[column], offsets[other]
    while a < offsets[column + 1] and b < offsets[other + 1]:
        if lows[a] <= highs[b] and lows[b] <= highs[a]:
            unite(parents, a, b)
        if highs[a] < highs[b]:
            a += 1
        else:
            b += 1


@kernel
def _label_runs(ny: int, offsets: Ints, lows: Labels, highs: Labels, parents: Labels, labels: Labels) -> int:
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


@kernel
def _fill_runs(out: Bools, runs: Components, chosen: Bools, start: int, stop: int) -> None:
    """Set ``out`` on the runs of the chosen components, for first indices in ``[start, stop)``."""
    ny = out.shape[1]
    for i in range(start, stop):
        for j in range(ny):
            for run in range(runs.offsets[i * ny + j], runs.offsets[i * ny + j + 1]):
                if chosen[runs.labels[run]]:
                    for k in range(runs.lows[run], runs.highs[run] + 1):
                        out[i, j, k] = True


_MOST_BUCKETS: Final = 1024
_ENTRIES_A_TRIANGLE: Final = 12
_POINTS_A_THREAD: Final = 512


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
        _fill_buckets(first, last, count, starts, entries)
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
def _fill_buckets(first: Ints, last: Ints, count: int, starts: Ints, entries: Ints) -> None:
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


class WindingNumber:
    """The winding number of closed surfaces, at any point.

    Triangles, shape (n, 3, 3), face outward where their corners run counterclockwise; neighbours share their corners to
    the last bit. ``turns`` is how often each counts; -1 against its own direction.
    """

    def __init__(self, triangles: Floats, turns: Ints) -> None:
        self._triangles, self._turns = np.ascontiguousarray(triangles), turns
        self._buckets = Buckets.of(self._triangles) if len(triangles) else None

    def evaluate(self, points: Floats) -> Ints:
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
    of :class:`WindingNumber`, with how often each counts.
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
def signed_crossing(triangle: Floats, x: float, y: float, z: float) -> int:
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
            number += signed_crossing(triangles[t], x, y, z) * turns[t]
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


_MEND: Final = "check its units (metres), {}, or use a larger spacing"

_MOST_FILLED: Final = 2**30
"""Cells of the bounding box of a surface up to which it is filled."""


class ClosedSurface(NamedTuple):
    """Closed surfaces that go round an inside: wherever their winding number is not zero.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        They share edges whole, and vertices to the last bit.
    turns : ndarray of int64, shape (F,)
        How often each counts; -1 against its own direction.
    """

    vertices: Floats
    faces: Ints
    turns: Ints


class SolidSurface(NamedTuple):
    """A surface, and what it encloses.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
    shell : Shell or None
        What has the same inside, and lies on the surface; None for a surface without an inside.
    fill : callable or None
        Given where its inside is instead whatever its raster encloses; called with the spacing where that is nothing.
    source : str
        For messages.
    """

    vertices: Floats
    faces: Ints
    shell: ClosedSurface | None = None
    fill: Callable[[float], None] | None = None
    source: str = "robot"


def surface_cells(skin: SolidSurface, bounds: tuple[Floats, Floats], grid: Grid) -> tuple[Bools, Bools]:
    """Cells that a solid meets, and cells that lie in it.

    What lies outside the grid is clipped; what is filled is decided on the cells of the whole surface. Otherwise
    triangles that do not meet the grid may be missing. ``bounds`` are the lower and upper corner of the whole
    surface's bounding box, metres.

    Raises InputError if a vertex is so far from the grid that rounding could reach the certificate's slack, or a
    surface to be filled reaches far out of the grid.
    """
    lower, upper = ((corner - np.asarray(grid.lower)) / grid.spacing for corner in bounds)
    far = float(max(np.abs(lower).max(), np.abs(upper).max()))
    check_reach(far, skin.source, "the map's corner", _MEND.format("cut it to the map"))
    first, stop = np.floor(lower).astype(np.int64) - 1, np.floor(upper).astype(np.int64) + 2
    shape = np.asarray(grid.shape)
    if not skin.fill:
        first, stop = np.maximum(first, 0), np.minimum(stop, shape)
    elif float(np.prod((stop - first).astype(float))) > _MOST_FILLED:
        raise InputError(
            skin.source,
            f"is {' x '.join(str(n) for n in stop - first)} cells large",
            f"filling looks at all of them, and at most {_MOST_FILLED} are looked at",
            "use a larger spacing, cut the mesh to the map, or pass solid='surface'",
        )
    outer, inner = np.zeros(grid.shape, dtype=np.bool_), np.zeros(grid.shape, dtype=np.bool_)
    if (first >= stop).any() or (first >= shape).any() or (stop <= 0).any():
        return outer, inner
    touched = np.zeros(tuple((stop - first).tolist()), dtype=np.bool_)
    mark_touched(touched, (skin.vertices[skin.faces] - np.asarray(grid.lower)) / grid.spacing - first, 0.0, 1.0)
    enclosed = np.zeros_like(touched)
    if skin.shell is not None:
        points = (skin.shell.vertices - np.asarray(grid.lower)) / grid.spacing - first - 0.5
        mark_enclosed(enclosed, points[skin.shell.faces], skin.shell.turns)
        enclosed &= ~touched
    elif skin.fill:
        _fill(enclosed, touched)
        if not enclosed.any():
            skin.fill(grid.spacing)
    touched |= enclosed
    # The window may reach out of the grid where the surface is filled.
    low, high = np.maximum(first, 0), np.minimum(stop, shape)
    there, here = tuple(map(slice, low, high)), tuple(map(slice, low - first, high - first))
    outer[there], inner[there] = touched[here], enclosed[here]
    return outer, inner


def surface_rasters(
    skin: SolidSurface, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
) -> tuple[Raster, Raster]:
    """Outer and inner raster of a robot that is a solid; see :meth:`cspace.shapes.Shape.rasters`.

    A surface to be filled counts as itself and the cubes ``h * (m + [-1/2, 1/2]^3)`` that it encloses, turned by the
    representative rotation, without touching them.

    Raises InputError if the robot has too many cells at this spacing, or lies so far from its origin that rounding
    could reach the certificate's slack.
    """
    vertices = rotation.apply(skin.vertices) / spacing
    triangles = vertices[skin.faces]
    corners = triangles.reshape(-1, 3)
    radius = margin / spacing
    far = float(np.abs(corners).max() if rotation.matrix is None else np.linalg.norm(corners, axis=1).max())
    check_reach(far + radius, skin.source, "its origin", _MEND.format("move it to its origin"))
    swing = float(rotation.displacement(np.array([1.0, 0.0, 0.0])))
    parts = sweep(triangles, swing, rotation.about_z)
    widest = float(parts.growth.max())
    outer, lower = allocate_bitmap(
        corners.min(axis=0) - radius - widest - 1.0, corners.max(axis=0) + radius + widest + 1.0
    )
    inner = np.zeros_like(outer)
    shift = np.asarray(lower, dtype=np.float64)
    local = triangles - shift
    # Cells first: the cube m + [-1, 1]^3 is the eight cells that share its middle.
    mark_touched(outer, local, 0.0, 1.0)
    if radius + widest > 0.0:
        mark_within(outer, parts.moved(-shift - 0.5), 0.5, radius)
    for axis in range(3):
        upper, below = np.moveaxis(outer, axis, 0)[:0:-1], np.moveaxis(outer, axis, 0)[-2::-1]
        upper |= below
    if skin.shell is not None:
        mark_enclosed(inner, rotation.apply(skin.shell.vertices)[skin.shell.faces] / spacing - shift, skin.shell.turns)
        outer |= inner
        # Where a point is so near to the surface that rounding could matter, nothing is said.
        border = np.zeros_like(inner)
        mark_touched(border, local, 0.0, 0.0, 2.0 * SLACK)
        inner &= ~border
        within = Raster.from_bitmap(inner, lower)
        if widest > 0.0 and within.cells.size:
            border = ~within.cells  # no other point is looked at
            mark_within(border, parts.moved(-np.array(within.lower, dtype=np.float64)), 0.0, 0.0)
            within = Raster.from_bitmap(~border, within.lower)
        return Raster.from_bitmap(outer, lower), within
    if skin.fill:
        near = np.zeros_like(outer)
        mark_touched(near, local, -0.5, 0.5)
        _fill(inner, near)
        if not inner.any():
            skin.fill(spacing)
        outer |= _grown(inner, radius + widest)
        inner &= widest == 0.0
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def _fill(inside: Bools, touched: Bools) -> None:
    """Set ``inside`` on the untouched boxes that no untouched ones join to the border of the array."""
    components = Components.of(touched)
    components.fill(inside, ~components.at_border())


def _grown(cells: Bools, radius: float) -> Bools:
    """Lattice points m whose ``m + [-1, 1]^3`` comes within a radius of ``n + [-1/2, 1/2]^3`` for one of the cells n.

    The gap along an axis is less by one half than the distance from the cells grown by one, which adds up to less than
    one; so the result is complete and holds no point farther than one cell too far.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    grown = np.asarray(binary_dilation(cells, np.ones((3, 3, 3))))
    if radius > 0.0 and grown.any():
        grown = np.asarray(distance_transform_edt(~grown)) <= radius + math.sqrt(3.0) / 2.0 + 2.0**-20
    return grown

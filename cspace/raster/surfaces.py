"""Rasters of surfaces in space and of the solids that they enclose: robots and obstacles.

The surface is marked exactly (see :mod:`cspace.raster.triangles`). A box that no triangle touches lies on one side of
it, so its center, half a cell or more from the surface, decides if it lies inside. The winding number of the surface
decides, or, for a surface to be filled, whether untouched boxes connect it to the exterior.

*Rotation.* A rotation cell contains the rotations within an angle a of its representative R. A point p of the robot A
stays within ``2 |p| sin(a / 2)`` of ``R p`` (about the z axis, ``|p|`` is the distance from the axis). Cut the surface
into pieces, and let ``g`` be the largest displacement on a piece, attained at a corner. Pieces are so small that it
varies by at most about a third of a cell along a side, or a quarter of itself. A point also keeps its distance from the
origin: it stays in the spherical shell S between the nearest and the farthest point of its piece. A point that arrives
at a position q was at most ``2 |q| sin(a / 2)`` away, so g may be replaced by that displacement of q if it is smaller.

* *Outer.* Let q lie in R' A for a rotation R' of the cell, and not in R A. On the path from R to R', which stays in the
  cell, q passes from the exterior of the robot to its interior; so at some rotation R'' on the path it lies on the
  boundary: ``q = R'' b``, within g of ``R b`` for the piece of b, and in its S. So R A together with all points within
  g of a piece of R's boundary, and in the piece's S, contains the robot at every rotation of the cell.
* *Inner.* Let q lie in R A and, for each piece, be farther from it than g or outside its S. Then q is on no boundary
  along any path, and so lies in the robot at every rotation of the cell.

*Winding numbers* count how often closed surfaces enclose a point. A ray runs from the point along z, and the sum of its
crossings is the winding number: 1 if the ray leaves through the front of a triangle, -1 if it enters. Half-open
intervals decide if an edge is crossed, at a point that all triangles of the edge compute alike. So the crossings of
closed bodies are those of closed surfaces that differ by the rounding of one interpolation; another interpolation gives
the height. Each has an error below 3 * 2^-30 cells at coordinates of 2^22 cells (see :mod:`cspace.raster.triangles`).
So the winding number is right for a point farther than 2^-27 cells from the surface, even if the ray meets edges,
vertices, or triangles parallel to it: the sum is an integer, without rounding.

*Components* of untouched boxes are stored as runs along z. There are about as many runs as columns and touched boxes,
so labelling reads each box once, and takes memory for the runs alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import allocating, kernel
from cspace.errors import InputError
from cspace.grid import SLACK, Grid, check_reach
from cspace.raster import Raster, allocate_bitmap
from cspace.raster.triangles import mark_touched, mark_within, sweep_triangles
from cspace.rotations import NO_ROTATION, RotationCell
from cspace.threads import in_chunks

Labels = NDArray[np.int32]

_MIN_SLABS_PER_THREAD = 32
"""Minimum number of layers of boxes across x for each thread."""


class RunComponents(NamedTuple):
    """Face-connected components of boxes, stored as runs along z.

    Compiled functions take them as they are.

    Attributes
    ----------
    shape : tuple of int
        Shape of the array of boxes.
    offsets : ndarray of int64
        Column ``i * ny + j`` has the runs from ``offsets[column]`` up to ``offsets[column + 1]``.
    lows, highs, labels : ndarray of int32
        First and last z of each run, and the label of its component.
    n_components : int
    """

    shape: tuple[int, int, int]
    offsets: Ints
    lows: Labels
    highs: Labels
    labels: Labels
    n_components: int

    @classmethod
    def of(cls, blocked: Bools) -> RunComponents:
        """Label the components of the False entries, shape (nx, ny, nz)."""
        nx, ny, nz = blocked.shape
        counts = np.empty(nx * ny, dtype=np.int64)

        def count(start: int, stop: int) -> int:
            _count_runs(blocked, counts, start, stop)
            return -1

        in_chunks(count, nx, _MIN_SLABS_PER_THREAD)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        lows, highs, parents, labels = (np.empty(int(offsets[-1]), dtype=np.int32) for _ in range(4))

        def fill(start: int, stop: int) -> int:
            _list_runs(blocked, offsets, lows, highs, start, stop)
            return -1

        in_chunks(fill, nx, _MIN_SLABS_PER_THREAD)
        n_components = int(_label_runs(ny, offsets, lows, highs, parents, labels))
        return cls((nx, ny, nz), offsets, lows, highs, labels, n_components)

    def labels_at(self, boxes: Ints) -> Labels:
        """Return the labels of untouched boxes.

        ``boxes`` are flat indices, shape (n,).
        """
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        starts = column * self.shape[2] + self.lows
        return np.asarray(self.labels[np.searchsorted(starts, boxes, side="right") - 1])

    def lengths(self) -> Ints:
        """Return the longest side of each component's bounding box.

        Counted in boxes, shape (n_components,).
        """
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        longest = np.zeros(self.n_components, dtype=np.int64)
        i, j = column // self.shape[1], column % self.shape[1]
        for low, high in ((i, i), (j, j), (self.lows, self.highs)):
            first, last = np.full(self.n_components, max(self.shape)), np.zeros(self.n_components, dtype=np.int64)
            np.minimum.at(first, self.labels, low)
            np.maximum.at(last, self.labels, high)
            longest = np.maximum(longest, last - first + 1)
        return longest

    def touch_boundary(self) -> Bools:
        """Return a mask of the components at the boundary of the array."""
        nx, ny, nz = self.shape
        column = np.repeat(np.arange(nx * ny), np.diff(self.offsets))
        i, j = column // ny, column % ny
        outermost = (i == 0) | (i == nx - 1) | (j == 0) | (j == ny - 1) | (self.lows == 0) | (self.highs == nz - 1)
        touching = np.zeros(self.n_components, dtype=np.bool_)
        touching[self.labels[outermost]] = True
        return touching

    def fill(self, out: Bools, chosen: Bools) -> None:
        """Set ``out`` on the chosen components."""

        def work(start: int, stop: int) -> int:
            _fill_runs(out, self, chosen, start, stop)
            return -1

        if chosen.any():
            in_chunks(work, self.shape[0], _MIN_SLABS_PER_THREAD)


@kernel
def _count_runs(blocked: Bools, counts: Ints, start: int, stop: int) -> None:
    """Count the runs in each column.

    Sets ``counts[i * ny + j]`` for first indices in ``[start, stop)``.
    """
    _, ny, nz = blocked.shape
    for i in range(start, stop):
        for j in range(ny):
            count, before = 0, True
            for k in range(nz):
                here = blocked[i, j, k]
                count += before and not here
                before = here
            counts[i * ny + j] = count


@kernel
def _list_runs(blocked: Bools, offsets: Ints, lows: Labels, highs: Labels, start: int, stop: int) -> None:
    """Write first and last index of each run.

    Covers first indices in ``[start, stop)``, from each column's offset on.
    """
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
def find_root(parents: Labels, node: int) -> int:
    """Return the root of a node, halving its path (Tarjan, 1975)."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@kernel
def merge_sets(parents: Labels, a: int, b: int) -> bool:
    """Merge the sets of two nodes; return False if equal.

    The lower root becomes the root.
    """
    a, b = find_root(parents, a), find_root(parents, b)
    if a == b:
        return False
    parents[max(a, b)] = min(a, b)
    return True


@kernel
def _merge_columns(offsets: Ints, lows: Labels, highs: Labels, parents: Labels, column: int, other: int) -> None:
    """Merge the sets of overlapping runs in two neighbouring columns."""
    a, b = offsets[column], offsets[other]
    while a < offsets[column + 1] and b < offsets[other + 1]:
        if lows[a] <= highs[b] and lows[b] <= highs[a]:
            merge_sets(parents, a, b)
        if highs[a] < highs[b]:
            a += 1
        else:
            b += 1


@kernel
def _label_runs(ny: int, offsets: Ints, lows: Labels, highs: Labels, parents: Labels, labels: Labels) -> int:
    """Label the components of face-connected runs; return their number.

    Labels are in the order of the first runs. ``parents`` is scratch space, of the size of ``labels``.
    """
    for run in range(len(parents)):
        parents[run] = run
    for column in range(len(offsets) - 1):
        if column % ny > 0:
            _merge_columns(offsets, lows, highs, parents, column, column - 1)
        if column >= ny:
            _merge_columns(offsets, lows, highs, parents, column, column - ny)
    count = 0
    for run in range(len(parents)):
        # A root is the smallest run of its component, and a parent is smaller than its child, so it is labelled.
        if parents[run] == run:
            labels[run] = count
            count += 1
        else:
            labels[run] = labels[parents[run]]
    return count


@kernel
def _fill_runs(out: Bools, runs: RunComponents, chosen: Bools, start: int, stop: int) -> None:
    """Set ``out`` on the runs of the chosen components.

    Covers first indices in ``[start, stop)``.
    """
    ny = out.shape[1]
    for i in range(start, stop):
        for j in range(ny):
            for run in range(runs.offsets[i * ny + j], runs.offsets[i * ny + j + 1]):
                if chosen[runs.labels[run]]:
                    for k in range(runs.lows[run], runs.highs[run] + 1):
                        out[i, j, k] = True


_MAX_BUCKETS_PER_AXIS: Final = 1024
"""Maximum number of buckets along x and along y."""
_MAX_ENTRIES_PER_TRIANGLE: Final = 12
"""Maximum mean number of buckets that a triangle is listed in."""
_MIN_POINTS_PER_THREAD: Final = 512
"""Minimum number of points for each thread."""


class Buckets(NamedTuple):
    """Triangles sorted by the plane rectangles that they may meet.

    The rectangles, called buckets, divide the plane (x, y); a triangle is listed in all that its bounding box meets.

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
        """Sort triangles, shape (n, 3, 3), into buckets.

        There is at least one triangle; each bucket lists its triangles in order.
        """
        lows, highs = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
        low = lows.min(axis=0)
        extent = highs.max(axis=0) - low
        count = min(_MAX_BUCKETS_PER_AXIS, max(1, int(np.sqrt(len(triangles)))))
        while True:
            scale = np.divide(count, extent, out=np.zeros(2), where=extent > 0.0)
            # The same formula as for the compiled rays; it is monotonic in the coordinate in spite of rounding.
            first, last = (
                np.clip(np.floor((corners - low) * scale), 0, count - 1).astype(np.int64) for corners in (lows, highs)
            )
            rows, columns = (last - first + 1).T
            counts = rows * columns
            # Large triangles meet many buckets, so use fewer buckets if the lists become long.
            if count == 1 or counts.sum() <= _MAX_ENTRIES_PER_TRIANGLE * len(triangles):
                break
            count //= 2
        starts, entries = np.zeros(count * count + 1, dtype=np.int64), np.empty(counts.sum(), dtype=np.int64)
        _fill_buckets(first, last, count, starts, entries)
        return cls(low, scale, np.full(2, count, dtype=np.int64), starts, entries)

    def near(self, lower: Floats, upper: Floats) -> Ints:
        """List all triangles that meet a box, and some near it.

        Returns ascending indices.
        """
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
    """Sort triangles into buckets by their rows and columns.

    There are ``count`` x ``count`` buckets. ``first`` and ``last``, shape (n, 2), are the first and last row and column
    of each triangle. ``starts``, zero on input, receives the start of each bucket in ``entries``, and ``entries`` the
    indices of the triangles.
    """
    for t in range(len(first)):
        for row in range(first[t, 0], last[t, 0] + 1):
            for column in range(first[t, 1], last[t, 1] + 1):
                starts[row * count + column] += 1
    stop = 0
    for b in range(len(starts)):
        stop += starts[b]
        starts[b] = stop
    # Going backwards leaves the triangles of each bucket in order, and ``starts`` at the first triangle.
    for t in range(len(first) - 1, -1, -1):
        for row in range(first[t, 0], last[t, 0] + 1):
            for column in range(first[t, 1], last[t, 1] + 1):
                starts[row * count + column] -= 1
                entries[starts[row * count + column]] = t


class WindingNumber:
    """Winding number of closed surfaces at any point.

    Triangles, shape (n, 3, 3), face outward if their corners run counterclockwise; neighbours share corners to the last
    bit. ``windings``, shape (n,), is the weight of each triangle; -1 reverses it.
    """

    def __init__(self, triangles: Floats, windings: Ints) -> None:
        self._triangles, self._windings = np.ascontiguousarray(triangles), windings
        self._buckets = Buckets.of(self._triangles) if len(triangles) else None

    def evaluate(self, points: Floats) -> Ints:
        """Return the winding numbers at points, shape (n,).

        ``points``, shape (n, 3), must be farther from the surfaces than rounding.
        """
        points = np.ascontiguousarray(points)
        out = np.zeros(len(points), dtype=np.int64)
        buckets = self._buckets
        if buckets is None:
            return out

        def work(start: int, stop: int) -> int:
            _sum_crossings(points[start:stop], out[start:stop], self._triangles, self._windings, buckets)
            return -1

        in_chunks(work, len(points), _MIN_POINTS_PER_THREAD)
        return out


def mark_enclosed(out: Bools, triangles: Floats, windings: Ints) -> None:
    """Set ``out[i]`` if closed surfaces enclose lattice point ``i``.

    A point is enclosed if the winding number is not zero. The triangles, shape (n, 3, 3), are in cells, in the index
    frame of ``out``, and may reach beyond it; ``windings`` as for :class:`WindingNumber`.
    """

    def work(start: int, stop: int) -> int:
        _mark_enclosed(out, triangles, windings, start, stop)
        return -1

    in_chunks(work, len(out), _MIN_SLABS_PER_THREAD)


@kernel
def _bucket_index(value: float, low: float, scale: float, count: int) -> int:
    """Return the bucket of a coordinate.

    The first of ``count`` buckets begins at ``low``; ``scale`` is the number of buckets per unit of length.
    """
    return int(min(max(math.floor((value - low) * scale), 0), count - 1))


@kernel
def _cut_triangle(triangle: Floats, x: float) -> tuple[int, float, float, float, float]:
    """Intersect a triangle with a plane across x.

    Returns its facing and the (y, z) of its lower and upper end. The facing is 1 for up, -1 for down, 0 if they are
    disjoint. The plane meets an edge if ``x`` lies in the half-open interval of its ends. The point is computed from
    the nearer end, so that all triangles at an edge compute the same point.
    """
    sign, crossings = 0, 0
    low_y, low_z, high_y, high_z = 0.0, 0.0, 0.0, 0.0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[e + 1 if e < 2 else 0]
        if (px <= x) == (qx <= x):
            continue
        direction = 1
        if px <= x:
            direction = -1
        else:
            px, py, pz, qx, qy, qz = qx, qy, qz, px, py, pz
        t = (x - px) / (qx - px)
        if t <= 0.5:
            y, z = py + t * (qy - py), pz + t * (qz - pz)
        else:
            t = (x - qx) / (px - qx)
            y, z = qy + t * (py - qy), qz + t * (pz - qz)
        if crossings == 0 or y > high_y:
            if crossings == 0:
                low_y, low_z = y, z
            sign, high_y, high_z = direction, y, z
        else:
            low_y, low_z = y, z
        crossings += 1
    return sign, low_y, low_z, high_y, high_z


@kernel
def _interpolate_height(y: float, low_y: float, low_z: float, high_y: float, high_z: float) -> float:
    """Return the z of a line at y, from its nearer end."""
    t = (y - low_y) / (high_y - low_y)
    if t <= 0.5:
        return low_z + t * (high_z - low_z)
    return high_z + (y - high_y) / (low_y - high_y) * (low_z - high_z)


@kernel
def signed_crossing(triangle: Floats, x: float, y: float, z: float) -> int:
    """Return whether an upward ray crosses a triangle.

    The ray begins at the point (x, y, z). The result is 1 if it crosses a triangle that faces up, -1 if the triangle
    faces down, and 0 if it misses the triangle.
    """
    sign, low_y, low_z, high_y, high_z = _cut_triangle(triangle, x)
    return sign if sign != 0 and low_y <= y < high_y and _interpolate_height(y, low_y, low_z, high_y, high_z) > z else 0


@kernel
def _sum_crossings(points: Floats, out: Ints, triangles: Floats, windings: Ints, buckets: Buckets) -> None:
    """Write the winding number at each point.

    It is the sum of ``windings`` over the triangles that an upward ray crosses. ``points`` has shape (n, 3),
    ``triangles`` (m, 3, 3).
    """
    low, scale, shape, starts, entries = buckets
    for p in range(len(points)):
        x, y, z = points[p]
        b = _bucket_index(x, low[0], scale[0], shape[0]) * shape[1] + _bucket_index(y, low[1], scale[1], shape[1])
        winding = 0
        for entry in range(starts[b], starts[b + 1]):
            t = entries[entry]
            winding += signed_crossing(triangles[t], x, y, z) * windings[t]
        out[p] = winding


@allocating
def _mark_enclosed(out: Bools, triangles: Floats, windings: Ints, start: int, stop: int) -> None:
    """Set ``out[i]`` if surfaces enclose lattice point ``i``.

    Covers first indices in ``[start, stop)``. The first pass counts the crossings of each column of points; the second
    lists the first point above each crossing.
    """
    _, ny, nz = out.shape
    offsets, heights = np.zeros((stop - start) * ny + 2, np.int64), np.empty(0, np.int64)
    changes = heights
    for second_pass in range(2):
        if second_pass:
            for column in range(2, len(offsets)):
                offsets[column] += offsets[column - 1]
            heights, changes = np.empty(offsets[-1], np.int64), np.empty(offsets[-1], np.int64)
        for t in range(len(triangles)):
            if windings[t] == 0:
                continue
            triangle = triangles[t]
            low_x = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
            high_x = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
            for i in range(max(start, math.ceil(low_x)), min(stop - 1, math.floor(high_x)) + 1):
                sign, low_y, low_z, high_y, high_z = _cut_triangle(triangle, i)
                if sign == 0:
                    continue
                for j in range(max(0, math.ceil(low_y)), min(ny, math.ceil(high_y))):
                    # Here ``offsets[column + 1]`` moves from the start of the column's list to its stop.
                    column = (i - start) * ny + j
                    if not second_pass:
                        offsets[column + 2] += 1
                        continue
                    slot = offsets[column + 1]
                    z = _interpolate_height(j, low_y, low_z, high_y, high_z)
                    heights[slot], changes[slot] = min(max(math.ceil(z), 0), nz), sign * windings[t]
                    offsets[column + 1] += 1
    # From below, a ray enters through triangles that face down.
    profile = np.zeros(nz + 1, np.int64)
    for column in range((stop - start) * ny):
        begin, end = offsets[column], offsets[column + 1]
        if begin == end:
            continue
        low, high = nz, 0
        for slot in range(begin, end):
            height_index = heights[slot]
            profile[height_index] -= changes[slot]
            low, high = min(low, height_index), max(high, height_index)
        winding, row = 0, out[start + column // ny, column % ny]
        for k in range(low, high):
            winding += profile[k]
            profile[k] = 0
            if winding != 0:
                row[k] = True
        profile[high] = 0


_REACH_HINT: Final = "check its units (metres), {}, or use a larger spacing"
"""Hint of the errors for surfaces that reach too far."""

_MAX_FILLED_CELLS: Final = 2**30
"""Maximum number of cells in the bounding box of a surface to be filled."""


class ClosedSurface(NamedTuple):
    """Closed surfaces, which enclose points of non-zero winding number.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Faces share whole edges, and vertices to the last bit.
    windings : ndarray of int64, shape (F,)
        Weight of each face; -1 reverses it.
    """

    vertices: Floats
    faces: Ints
    windings: Ints


class SolidSurface(NamedTuple):
    """A surface with its interior.

    Attributes
    ----------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
    shell : ClosedSurface or None
        Part of the surface that encloses the same interior; None for a surface without interior.
    on_empty : callable or None
        If given, the surface is filled: its interior is whatever its raster encloses. Called with the spacing if that
        is nothing.
    source : str
        Name of the shape in messages.
    """

    vertices: Floats
    faces: Ints
    shell: ClosedSurface | None = None
    on_empty: Callable[[float], None] | None = None
    source: str = "robot"


def surface_cells(solid: SolidSurface, bounds: tuple[Floats, Floats], grid: Grid) -> tuple[Bools, Bools]:
    """Rasterise a solid obstacle.

    Returns the cells that it meets and the cells that lie in it. The solid is clipped to the grid, but filling uses the
    cells of the whole surface. Otherwise triangles that do not meet the grid may be missing. ``bounds`` are the lower
    and upper corner of the whole surface's bounding box, metres.

    Raises InputError if a vertex is so far from the grid that rounding could exceed ``SLACK``, or if a surface to be
    filled has too many cells.
    """
    lower, upper = ((corner - np.asarray(grid.lower)) / grid.spacing for corner in bounds)
    reach = float(max(np.abs(lower).max(), np.abs(upper).max()))
    check_reach(reach, solid.source, "the map's corner", _REACH_HINT.format("cut it to the map"))
    first, stop = np.floor(lower).astype(np.int64) - 1, np.floor(upper).astype(np.int64) + 2
    shape = np.asarray(grid.shape)
    if not solid.on_empty:
        first, stop = np.maximum(first, 0), np.minimum(stop, shape)
    elif float(np.prod((stop - first).astype(float))) > _MAX_FILLED_CELLS:
        raise InputError(
            solid.source,
            f"is {' x '.join(str(n) for n in stop - first)} cells large",
            f"at most {_MAX_FILLED_CELLS} can be filled",
            "use a larger spacing, cut the mesh to the map, or pass solid='surface'",
        )
    outer, inner = np.zeros(grid.shape, dtype=np.bool_), np.zeros(grid.shape, dtype=np.bool_)
    if (first >= stop).any() or (first >= shape).any() or (stop <= 0).any():
        return outer, inner
    touched = np.zeros(tuple((stop - first).tolist()), dtype=np.bool_)
    mark_touched(touched, (solid.vertices[solid.faces] - np.asarray(grid.lower)) / grid.spacing - first, 0.0, 1.0)
    enclosed = np.zeros_like(touched)
    if solid.shell is not None:
        points = (solid.shell.vertices - np.asarray(grid.lower)) / grid.spacing - first - 0.5
        mark_enclosed(enclosed, points[solid.shell.faces], solid.shell.windings)
        enclosed &= ~touched
    elif solid.on_empty:
        _fill_enclosed(enclosed, touched)
        if not enclosed.any():
            solid.on_empty(grid.spacing)
    touched |= enclosed
    # The window may reach out of the grid if the surface is filled.
    low, high = np.maximum(first, 0), np.minimum(stop, shape)
    in_grid, in_window = tuple(map(slice, low, high)), tuple(map(slice, low - first, high - first))
    outer[in_grid], inner[in_grid] = touched[in_window], enclosed[in_window]
    return outer, inner


def surface_rasters(
    solid: SolidSurface, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
) -> tuple[Raster, Raster]:
    """Rasterise a solid robot; see :meth:`cspace.shapes.Shape.rasters`.

    Returns the outer and the inner raster. A surface to be filled counts as itself and the enclosed cubes ``h * (m +
    [-1/2, 1/2]^3)`` that do not touch it, at the representative rotation.

    Raises InputError if the robot has too many cells at this spacing, or lies so far from its origin that rounding
    could exceed ``SLACK``.
    """
    vertices = rotation.apply(solid.vertices) / spacing
    triangles = vertices[solid.faces]
    corners = triangles.reshape(-1, 3)
    radius = margin / spacing
    reach = float(np.abs(corners).max() if rotation.matrix is None else np.linalg.norm(corners, axis=1).max())
    check_reach(reach + radius, solid.source, "its origin", _REACH_HINT.format("move it to its origin"))
    swing = float(rotation.displacement(np.array([1.0, 0.0, 0.0])))
    swept = sweep_triangles(triangles, swing, rotation.about_z)
    max_growth = float(swept.growth.max())
    outer, lower = allocate_bitmap(
        corners.min(axis=0) - radius - max_growth - 1.0, corners.max(axis=0) + radius + max_growth + 1.0
    )
    inner = np.zeros_like(outer)
    origin = np.asarray(lower, dtype=np.float64)
    local = triangles - origin
    # Cells first: the cube m + [-1, 1]^3 consists of the eight cells that share its center.
    mark_touched(outer, local, 0.0, 1.0)
    if radius + max_growth > 0.0:
        mark_within(outer, swept.translate(-origin - 0.5), 0.5, radius)
    for axis in range(3):
        upper, below = np.moveaxis(outer, axis, 0)[:0:-1], np.moveaxis(outer, axis, 0)[-2::-1]
        upper |= below
    if solid.shell is not None:
        mark_enclosed(
            inner, rotation.apply(solid.shell.vertices)[solid.shell.faces] / spacing - origin, solid.shell.windings
        )
        outer |= inner
        # Points so near to the surface that rounding could matter stay undecided.
        near_surface = np.zeros_like(inner)
        mark_touched(near_surface, local, 0.0, 0.0, 2.0 * SLACK)
        inner &= ~near_surface
        within = Raster.from_bitmap(inner, lower)
        if max_growth > 0.0 and within.cells.size:
            near_surface = ~within.cells  # skips the other points
            mark_within(near_surface, swept.translate(-np.array(within.lower, dtype=np.float64)), 0.0, 0.0)
            within = Raster.from_bitmap(~near_surface, within.lower)
        return Raster.from_bitmap(outer, lower), within
    if solid.on_empty:
        near = np.zeros_like(outer)
        mark_touched(near, local, -0.5, 0.5)
        _fill_enclosed(inner, near)
        if not inner.any():
            solid.on_empty(spacing)
        outer |= _dilate(inner, radius + max_growth)
        inner &= max_growth == 0.0
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def _fill_enclosed(inside: Bools, touched: Bools) -> None:
    """Set ``inside`` on untouched boxes cut off from the boundary.

    Boxes are cut off if no untouched boxes connect them to the boundary of the array.
    """
    components = RunComponents.of(touched)
    components.fill(inside, ~components.touch_boundary())


def _dilate(cells: Bools, radius: float) -> Bools:
    """Dilate cubes by a radius.

    Returns the lattice points m whose ``m + [-1, 1]^3`` is within the radius of ``n + [-1/2, 1/2]^3`` for a cell n.
    Along each axis, the gap is half a cell less than the distance from the cells grown by one, less than one cell in
    total. So the result is complete and has no point more than one cell too far.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt

    grown = np.asarray(binary_dilation(cells, np.ones((3, 3, 3))))
    if radius > 0.0 and grown.any():
        grown = np.asarray(distance_transform_edt(~grown)) <= radius + math.sqrt(3.0) / 2.0 + 2.0**-20
    return grown

"""Triangles in space: the boxes that they touch, those within a distance of them, and how far a point is.

A *box* ``i`` is ``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of a
robot, ``(0, 0)`` for lattice points. Lengths are in cells, as the indices of the array that is written.

*Touched boxes.* For each slab of boxes across x, a triangle is cut to the slab, then, for each slab across y, what is
left of it to that; the part that remains is convex, so that its z-values are an interval, and it meets exactly the
boxes that meet that interval.

*Safety against rounding.* Let u = 2^-53, and all vertices lie within 2^22 cells of the frame's corner (for a robot: of
its origin), so that no two differ by more than 2^23 along an axis. In units of 2^-30 cells:

* A vertex in cells has two roundings relative to its size (the difference from the corner, the division by the
  spacing), and that of a whole number of cells subtracted: less than 1.5. Where it was turned, three more: less than
  1.5 again. (By how much a matrix misses a rotation belongs to the covering angle.)
* A corner made by a cut lies on the cutting plane to the bit. Its other coordinates are ``p + t (q - p)`` with ``t``
  at most 1/2, from the nearer end: ``t`` has three roundings relative to itself, the difference and the product one
  each, so that with that of the sum it is off by less than 5 u 2^22 + 2^-31, which is 3.
* The planes of one direction do not meet, so all corners of a first cut lie on the triangle's own edges, and those of
  the second on the edges of the first result. Which corners there are is decided on the numbers as they are, without
  rounding. So each point of the part of the triangle in a slab differs from a point of the computed part by less than
  3, and after two cuts by less than 6, in y and z each.
* The ends of a run of boxes have two more roundings: less than 1.

Together that is less than 10. The slabs, and the runs of boxes, are widened to each side by ``SLACK`` = 2^-26 cells,
which is 16. So every box that a triangle meets is marked, and no box farther than 2 ``SLACK`` from it along an axis;
what is left of ``SLACK`` covers the rounding of a look-up, 4.

*Boxes within a distance.* The distance of a triangle that a cube does not meet is that of two of their features: a
corner and the triangle, a corner of the triangle and the cube, or two edges. Before that, going back and forth between
points of both that are ever nearer to each other bounds it from both sides: by their distance, and, along the way from
one to the other, by how far the corners of the triangle are past the cube. The second holds for any direction.

Let L be the size of all triangles together. A distance from the plane of a triangle is off by the rounding of its
normal, relative to it less than 2^-39 (thinner triangles than 2^-12 are taken to be as near as their height allows), so
by less than 2^-36 L. How far a corner is along a direction is off by less than 2^-50 L. The radius grows by more than
both, by 2^-20 + 2^-34 L. The result is complete, and holds no more than that, but for thin triangles: for those, what
lies within 2^-12 times their length besides.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Bytes, Floats
from cspace.compiling import jit, kernel
from cspace.grid import SLACK
from cspace.kernels import THIN, nearest_of_triangle, normal_of, point_triangle
from cspace.threads import in_chunks

STEEP: Final = 2.0**-5
"""Upward part of a plane's normal below which its heights are not used."""

_VARIATION: Final = 0.35
"""Cells by which the displacement within a turn may vary along the side of a piece,"""

_PART: Final = 0.25
"""or the part of itself, if that is more."""

_TRIES: Final = 3
"""Ways from a cube to a triangle that are tried before all of their features are."""

_ROUNDING: Final = 2.0**-20
_TRIANGLES_A_THREAD: Final = 2_000
_CUBES_A_THREAD: Final = 10_000


def mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float = SLACK) -> None:
    """Set ``out[i]``, of three axes, where the box ``i + [b0, b1]^3`` meets a triangle.

    All is in cells, as the indices of ``out``, out of which triangles, shape (n, 3, 3), may reach; ``b0`` and
    ``b1`` are multiples of one half. What is nearer than ``slack`` counts as touching.
    """
    if len(triangles) < 2 * _TRIANGLES_A_THREAD:
        _mark_touched(out, triangles, b0, b1, slack, 0, len(out))
        return
    # Each thread has slabs of its own, about as many triangles in each, so that no two write to one cell.
    middles = np.sort(np.clip(triangles[..., 0].mean(axis=1), 0, len(out)).astype(np.int64))
    size = len(middles)

    def work(start: int, stop: int) -> int:
        first = int(middles[start]) if start > 0 else 0
        last = int(middles[stop]) if stop < size else len(out)
        _mark_touched(out, triangles, b0, b1, slack, first, last)
        return -1

    in_chunks(work, size, _TRIANGLES_A_THREAD)


class SweptTriangles(NamedTuple):
    """Triangles, and where their points come as they turn about the origin by no more than some angle.

    A point of a triangle stays within the triangle's growth of its place, and as far from the origin as it is: in the
    shell between the triangle's nearest and its farthest point, and within ``swing`` times its distance from the origin
    of its place. About the z axis, it also stays at its height, and the distances are those from the axis.

    Attributes
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
    growth, nearest, farthest : ndarray of float64, shape (n,)
    origin : ndarray of float64, shape (3,)
    size : float
        Of the longest side of the box around all triangles.
    swing : float
        How far a point at distance 1 from the origin comes from its place.
    about_z : bool
    """

    triangles: Floats
    growth: Floats
    nearest: Floats
    farthest: Floats
    origin: Floats
    size: float
    swing: float
    about_z: bool

    def moved(self, shift: Floats) -> SweptTriangles:
        """The same in another frame."""
        return self._replace(triangles=self.triangles + shift, origin=self.origin + shift)


def sweep(triangles: Floats, swing: float, about_z: bool) -> SweptTriangles:
    """Triangles that turn about the origin, cut to pieces so small that their growth is about that of each point.

    A point at distance 1 from the origin (from the z axis, if ``about_z``) comes as far as ``swing`` from its place; 0
    is for triangles that do not turn. All is in cells.
    """
    still, size = np.zeros(len(triangles)), float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if swing == 0.0:
        return SweptTriangles(
            triangles, still, still, np.full(len(triangles), np.inf), np.zeros(3), size, swing, about_z
        )
    pieces = subdivide(triangles, _VARIATION / swing, _PART, about_z)
    places = pieces[..., : 2 if about_z else 3]
    middles = (places[:, 0] + places[:, 1] + places[:, 2]) / 3.0
    nearest = np.sqrt(np.einsum("ij,ij->i", middles, middles)) - _farthest(places - middles[:, None])
    # The distance from the origin is convex, so that it is largest at a corner.
    farthest = _farthest(places)
    return SweptTriangles(pieces, swing * farthest, nearest, farthest, np.zeros(3), size, swing, about_z)


def _farthest(triangles: Floats) -> Floats:
    """The distance of the farthest corner of each triangle from the origin."""
    first, second, third = np.einsum("ijk,ijk->ji", triangles, triangles)
    farthest: Floats = np.sqrt(np.maximum(np.maximum(first, second), third))
    return farthest


def mark_within(out: Bools, parts: SweptTriangles, half: float, radius: float) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` comes within a radius of where a triangle comes.

    The cubes that meet a triangle must be set already, unless ``half`` is zero. All is in cells, in the index frame of
    ``out``.
    """
    size = parts.size
    slack = _ROUNDING + 2.0**-34 * size

    def work(start: int, stop: int) -> int:
        _mark_within(out.view(np.uint8), parts, half, radius, slack, start, stop)
        return -1

    in_chunks(work, len(out), 1 + len(out) * _CUBES_A_THREAD // max(1, out.size))


@jit
def subdivide(triangles: Floats, longest: float, part: float = 0.0, about_z: bool = False) -> Floats:
    """Pieces of triangles, shape (n, 3, 3): halved across the longest side until it is no longer than it may be.

    That is ``longest``, or ``part`` of the distance of the nearest corner from the origin (from the z axis, if
    ``about_z``), whichever is more.
    """
    done, number = np.empty((2 * len(triangles) + 16, 3, 3)), 0
    waiting = np.empty((64, 3, 3))  # halves of halves: one for each halving
    axes = 2 if about_z else 3
    for triangle in triangles:
        _copy(triangle, waiting[0])
        left = 1
        while left > 0:
            piece = waiting[left - 1]
            side, square, lever = 0, 0.0, math.inf
            for e in range(3):
                length, far = 0.0, 0.0
                for axis in range(3):
                    length += (piece[(e + 1) % 3, axis] - piece[e, axis]) ** 2
                    far += piece[e, axis] ** 2 if axis < axes else 0.0
                lever = min(lever, far)
                if length > square:
                    side, square = e, length
            if math.sqrt(square) <= max(longest, part * math.sqrt(lever)) or left == len(waiting):
                if number == len(done):
                    more = np.empty((2 * number, 3, 3))
                    for k in range(number):
                        _copy(done[k], more[k])
                    done = more
                _copy(piece, done[number])
                number += 1
                left -= 1
                continue
            first, second = side, (side + 1) % 3
            for axis in range(3):
                middle = (piece[first, axis] + piece[second, axis]) / 2.0
                for e in range(3):
                    waiting[left, e, axis] = piece[e, axis]
                waiting[left, first, axis] = middle
                piece[second, axis] = middle
            left += 1
    return done[:number]


@kernel
def _copy(triangle: Floats, to: Floats) -> None:
    """Number by number: what may not fit as a whole takes two seconds of compiling, for the words of its error."""
    for e in range(3):
        for axis in range(3):
            to[e, axis] = triangle[e, axis]


@kernel
def _at(plane: float, pa: float, qa: float, pc: float, qc: float) -> float:
    """Coordinate c where a segment meets a plane of axis a, computed from the nearer end for the smaller rounding."""
    t = (plane - pa) / (qa - pa)
    if t <= 0.5:
        return pc + t * (qc - pc)
    return qc + (plane - qa) / (pa - qa) * (pc - qc)


@kernel
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


@kernel
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


@jit
def _mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float, start: int, stop: int) -> None:
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


@kernel
def _box_point(dx: float, dy: float, dz: float, half: float) -> float:
    """Distance of a point from a cube about the origin."""
    dx, dy, dz = max(abs(dx) - half, 0.0), max(abs(dy) - half, 0.0), max(abs(dz) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def _box_edges(p: Floats, q: Floats, center: Floats, half: float) -> float:
    """Smallest distance of a segment from the edges of a cube, where both are met between their ends; else inf."""
    best = math.inf
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        du, dv, da = q[u] - p[u], q[v] - p[v], q[axis] - p[axis]
        square = du * du + dv * dv
        if square == 0.0:
            continue
        for corner in range(4):
            wu = center[u] + (half if corner & 1 else -half) - p[u]
            wv = center[v] + (half if corner & 2 else -half) - p[v]
            t = (wu * du + wv * dv) / square
            if 0.0 <= t <= 1.0 and abs(p[axis] + t * da - center[axis]) <= half:
                best = min(best, abs(wu * dv - wv * du) / math.sqrt(square))
    return best


@kernel
def _box_triangle(triangle: Floats, center: Floats, half: float) -> float:
    """Distance of a triangle from a cube that it does not meet."""
    best = math.inf
    for corner in range(8):
        x = center[0] + (half if corner & 1 else -half)
        y = center[1] + (half if corner & 2 else -half)
        z = center[2] + (half if corner & 4 else -half)
        best = min(best, point_triangle((x, y, z), triangle))
    for e in range(3):
        p, q = triangle[e], triangle[e + 1 if e < 2 else 0]
        best = min(best, _box_point(p[0] - center[0], p[1] - center[1], p[2] - center[2], half))
        best = min(best, _box_edges(p, q, center, half))
    return best


@kernel
def _is_near(triangle: Floats, center: Floats, half: float, most: float, slack: float) -> bool:
    """Whether a triangle comes within a distance of a cube that it does not meet; or perhaps within ``slack`` more."""
    cx, cy, cz = center
    x, y, z = cx, cy, cz
    ax, ay, az = triangle[0]
    u = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    v = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    for _ in range(_TRIES):
        # From the point of the cube to the triangle's nearest, and from there to that of the cube.
        px, py, pz = nearest_of_triangle((x - ax, y - ay, z - az), u, v)
        px, py, pz = px + ax, py + ay, pz + az
        x = min(max(px, cx - half), cx + half)
        y = min(max(py, cy - half), cy + half)
        z = min(max(pz, cz - half), cz + half)
        dx, dy, dz = px - x, py - y, pz - z
        square = dx * dx + dy * dy + dz * dz
        if square <= most * most:
            return True
        # Along this way, whatever it is, no point of the triangle lies before its first corner.
        first = math.inf
        for corner in range(3):
            p = triangle[corner]
            first = min(first, dx * (p[0] - cx) + dy * (p[1] - cy) + dz * (p[2] - cz))
        if first - half * (abs(dx) + abs(dy) + abs(dz)) > (most + slack) * math.sqrt(square):
            return False
    return _box_triangle(triangle, center, half) <= most + slack


@jit
def _mark_within(
    out: Bytes, parts: SweptTriangles, half: float, radius: float, slack: float, start: int, stop: int
) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` comes within a radius of where triangles come.

    For first indices in ``[start, stop)``; the cubes that meet a triangle must be set already. Most cubes within reach
    of a triangle are set, some by many; so meanwhile a number above zero in ``out`` is how many from there on are.
    """
    _, ny, nz = out.shape
    center = np.empty(3)
    # Along each axis, squares: of the nearest and farthest of a cube from the origin, and of its gap to a triangle.
    lows, highs, gaps = np.empty((3, max(out.shape))), np.empty((3, max(out.shape))), np.empty((3, max(out.shape)))
    for axis in range(3):
        for k in range(out.shape[axis]):
            from_origin = abs(k - parts.origin[axis])
            lows[axis, k], highs[axis, k] = max(0.0, from_origin - half) ** 2, (from_origin + half) ** 2
    for t in range(len(parts.triangles)):
        triangle, near = parts.triangles[t], parts.growth[t] + radius
        a, b, c = triangle[0], triangle[1], triangle[2]
        mx, my, mz = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
        # Farther than this from its middle a cube is too far from all of the triangle.
        limit = math.sqrt(
            max(
                (a[0] - mx) ** 2 + (a[1] - my) ** 2 + (a[2] - mz) ** 2,
                (b[0] - mx) ** 2 + (b[1] - my) ** 2 + (b[2] - mz) ** 2,
                (c[0] - mx) ** 2 + (c[1] - my) ** 2 + (c[2] - mz) ** 2,
            )
        )
        # These, and what they are held against, are squares.
        limit = (limit + near + slack) ** 2
        outside = (parts.farthest[t] + radius + slack) ** 2
        within = max(0.0, parts.nearest[t] - radius - slack) ** 2
        reach, rise = near + half + slack, (radius if parts.about_z else near) + half + slack
        first = max(start, math.ceil(min(a[0], b[0], c[0]) - reach))
        last = min(stop - 1, math.floor(max(a[0], b[0], c[0]) + reach))
        first_y = max(0, math.ceil(min(a[1], b[1], c[1]) - reach))
        last_y = min(ny - 1, math.floor(max(a[1], b[1], c[1]) + reach))
        first_z = max(0, math.ceil(min(a[2], b[2], c[2]) - rise))
        last_z = min(nz - 1, math.floor(max(a[2], b[2], c[2]) + rise))
        # Nor does it come near where the plane of the triangle is too far: in each column, outside a stretch of it.
        along_x, along_y, middle, stretch = _slope(triangle, near + slack, half)
        for axis, (begin, end, place) in enumerate(((first, last, mx), (first_y, last_y, my), (first_z, last_z, mz))):
            for k in range(begin, end + 1):
                gaps[axis, k] = max(0.0, abs(k - place) - half) ** 2
        for i in range(first, last + 1):
            for j in range(first_y, last_y + 1):
                across, low_flat, high_flat = (
                    gaps[0, i] + gaps[1, j],
                    lows[0, i] + lows[1, j],
                    highs[0, i] + highs[1, j],
                )
                if across > limit or low_flat > outside or (parts.about_z and high_flat < within):
                    continue
                level = middle + along_x * (i - mx) + along_y * (j - my)
                row, k = out[i, j], max(first_z, math.ceil(level - stretch)) - 1
                last_k = min(last_z, math.floor(level + stretch))
                while k < last_k:
                    k += 1
                    step = row[k]
                    if step > 0:
                        after = k + step
                        if after <= last_k and row[after] > 0:
                            row[k] = min(step + row[after], 255)
                        k += step - 1
                        continue
                    gap, low, high = across + gaps[2, k], low_flat, high_flat
                    if not parts.about_z:
                        low, high = low + lows[2, k], high + highs[2, k]
                    if gap > limit or low > outside or high < within:
                        continue
                    # What comes into the cube is no farther from the origin than that, and came no farther than this.
                    most = min(near, parts.swing * (math.sqrt(high) + radius) + radius)
                    if gap > most * most:
                        center[0], center[1], center[2] = i, j, k
                        if not _is_near(triangle, center, half, most, slack):
                            continue
                    row[k] = 1
    for i in range(start, stop):
        for j in range(ny):
            row = out[i, j]
            for k in range(nz):
                row[k] = row[k] > 0


@kernel
def _slope(triangle: Floats, near: float, half: float) -> tuple[float, float, float, float]:
    """The plane of a triangle as heights: how they grow with x and y, the one at its middle, how far from it to look.

    So far are cubes that come within ``near`` of the plane; where it is steep, or the triangle thin, any distance.
    """
    a, b, c = triangle[0], triangle[1], triangle[2]
    middle = (a[2] + b[2] + c[2]) / 3.0
    x, y, z = normal_of(triangle)
    longest = 0.0
    for axis in range(3):
        longest = max(longest, (b[axis] - a[axis]) ** 2, (c[axis] - a[axis]) ** 2, (c[axis] - b[axis]) ** 2)
    if z * z <= STEEP * STEEP * (x * x + y * y + z * z) or abs(z) <= THIN * longest:
        return 0.0, 0.0, middle, 2.0**31
    normal = math.sqrt(x * x + y * y + z * z)
    return -x / z, -y / z, middle, (near * normal + half * (abs(x) + abs(y) + abs(z))) / abs(z)

"""Rasters of triangles in space: touched boxes, boxes within a distance, and point distances.

A *box* ``i`` is ``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of a
robot, ``(0, 0)`` for lattice points. Lengths are in cells, in the index frame of the output array.

*Touched boxes.* Each triangle is clipped to each slab of boxes across x, and the result to each slab across y. What
remains is convex, so its z-values form an interval, and it meets exactly the boxes that meet that interval.

*Rounding.* Let u = 2^-53. All vertices lie within 2^22 cells of the frame's corner (for a robot: of its origin), so no
two differ by more than 2^23 along an axis. In units of 2^-30 cells:

* A vertex in cells has two roundings relative to its size (the subtraction of the corner, the division by the spacing),
  and one from the subtraction of a whole number of cells: less than 1.5. Rotation adds three more: less than 1.5 again.
  (The error of the rotation matrix belongs to the covering angle.)
* A corner made by clipping lies on the clipping plane to the bit. Its other coordinates are ``p + t (q - p)`` with
  ``t`` at most 1/2, from the nearer end. The parameter ``t`` has three relative roundings, and difference, product and
  sum one each, so the error is less than 5 u 2^22 + 2^-31, which is 3.
* Planes of one direction do not intersect, so all corners of a first clip lie on the triangle's own edges, and those of
  the second on the edges of the first result. The existence of a corner is decided on the numbers as they are, without
  rounding. So each point of the part of the triangle in a slab differs from a point of the computed part by less than
  3, and after two clips by less than 6, in y and z each.
* The ends of a run of boxes have two more roundings: less than 1.

The sum is less than 10. The slabs and the runs of boxes are widened on each side by ``SLACK`` = 2^-26 cells, which is
16. So every box that meets a triangle is marked, and no box farther than 2 ``SLACK`` from it along an axis. The rest of
``SLACK`` covers the rounding of a look-up, 4.

*Boxes within a distance.* The distance between a triangle and a disjoint cube is the distance between two features: a
corner and the triangle, a corner of the triangle and the cube, or two edges. Alternating projections, tried first,
bound it from both sides: from above by the distance of the two points, and from below by the gap between cube and
triangle corners along their difference. The lower bound holds for any direction.

Let L be the extent of all triangles together. A distance to the plane of a triangle has the error of its normal, less
than 2^-39 relative to it (triangles thinner than 2^-12 are assumed as near as their height allows), so less than 2^-36
L. The position of a corner along a direction has an error below 2^-50 L. The radius grows by more than both, by 2^-20 +
2^-34 L. The result is complete. It has no boxes beyond that radius, except for thin triangles: there, within 2^-12
times their length besides.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Bytes, Floats
from cspace.compiling import allocating, kernel
from cspace.grid import SLACK
from cspace.kernels import THIN, nearest_of_triangle, normal_of, point_triangle
from cspace.threads import in_chunks

MIN_NORMAL_Z: Final = 2.0**-5
"""Minimum z-component of a unit normal for which the heights of its plane are used."""

_MAX_GROWTH_VARIATION: Final = 0.35
"""Maximum variation, in cells, of the displacement in a rotation cell along the side of a piece."""

_MAX_RELATIVE_VARIATION: Final = 0.25
"""Maximum of the same variation relative to the displacement; the larger of both maxima applies."""

_MAX_PROJECTIONS: Final = 3
"""Number of alternating projections between cube and triangle that are tried before all features."""

_RADIUS_SLACK: Final = 2.0**-20
"""Rounding allowance of a radius, in cells, before the share of the triangles' extent."""
_MIN_TRIANGLES_PER_THREAD: Final = 2_000
"""Minimum number of triangles for each thread."""
_MIN_CUBES_PER_THREAD: Final = 10_000
"""Minimum number of cubes for each thread."""


def mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float = SLACK) -> None:
    """Set ``out[i]`` if box ``i`` meets a triangle.

    Box ``i`` is ``i + [b0, b1]^3``, where ``b0`` and ``b1`` are multiples of one half. Triangles, shape (n, 3, 3), are
    in cells, in the index frame of ``out``, and may reach beyond it. A gap below ``slack`` counts as touching.
    """
    if len(triangles) < 2 * _MIN_TRIANGLES_PER_THREAD:
        _mark_touched(out, triangles, b0, b1, slack, 0, len(out))
        return
    # Each thread gets its own slabs, with about equally many triangles, so that no two threads write to one cell.
    centers = np.sort(np.clip(triangles[..., 0].mean(axis=1), 0, len(out)).astype(np.int64))
    size = len(centers)

    def work(start: int, stop: int) -> int:
        first = int(centers[start]) if start > 0 else 0
        last = int(centers[stop]) if stop < size else len(out)
        _mark_touched(out, triangles, b0, b1, slack, first, last)
        return -1

    in_chunks(work, size, _MIN_TRIANGLES_PER_THREAD)


class SweptTriangles(NamedTuple):
    """Triangles with the region that they sweep by rotations.

    The rotations are about the origin, up to an angle. A point of a triangle stays within the triangle's growth of its
    position. It keeps its distance from the origin, so it stays in the spherical shell between the triangle's nearest
    and farthest point, and within ``swing`` times that distance of its position. For rotations about the z axis it also
    keeps its height, and distances are from the axis.

    Attributes
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
    growth, nearest, farthest : ndarray of float64, shape (n,)
    origin : ndarray of float64, shape (3,)
    size : float
        Longest side of the box around all triangles.
    swing : float
        Maximum displacement of a point at distance 1 from the origin.
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

    def translate(self, shift: Floats) -> SweptTriangles:
        """Return the triangles and their origin moved by ``shift``, shape (3,)."""
        return self._replace(triangles=self.triangles + shift, origin=self.origin + shift)


def sweep_triangles(triangles: Floats, swing: float, about_z: bool) -> SweptTriangles:
    """Cut rotating triangles into pieces of nearly constant growth.

    ``swing`` is the maximum displacement of a point at distance 1 from the origin (from the z axis, if ``about_z``); 0
    if the triangles do not rotate. All lengths are in cells.
    """
    zero, size = np.zeros(len(triangles)), float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if swing == 0.0:
        return SweptTriangles(triangles, zero, zero, np.full(len(triangles), np.inf), np.zeros(3), size, swing, about_z)
    pieces = subdivide(triangles, _MAX_GROWTH_VARIATION / swing, _MAX_RELATIVE_VARIATION, about_z)
    positions = pieces[..., : 2 if about_z else 3]
    centers = (positions[:, 0] + positions[:, 1] + positions[:, 2]) / 3.0
    nearest = np.sqrt(np.einsum("ij,ij->i", centers, centers)) - _max_corner_distance(positions - centers[:, None])
    # The distance from the origin is convex, so it is largest at a corner.
    farthest = _max_corner_distance(positions)
    return SweptTriangles(pieces, swing * farthest, nearest, farthest, np.zeros(3), size, swing, about_z)


def _max_corner_distance(triangles: Floats) -> Floats:
    """Return the distance of each triangle's farthest corner from the origin."""
    first, second, third = np.einsum("ijk,ijk->ji", triangles, triangles)
    farthest: Floats = np.sqrt(np.maximum(np.maximum(first, second), third))
    return farthest


def mark_within(out: Bools, swept: SweptTriangles, half: float, radius: float) -> None:
    """Mark cubes near swept triangles.

    ``out[i]`` is set if cube ``i`` is within a radius of a swept triangle. Cube ``i`` is ``i + [-half, half]^3``. The
    cubes that meet a triangle must be set already, unless ``half`` is zero. Lengths are in cells, in the index frame of
    ``out``.
    """
    size = swept.size
    slack = _RADIUS_SLACK + 2.0**-34 * size

    def work(start: int, stop: int) -> int:
        _mark_within(out.view(np.uint8), swept, half, radius, slack, start, stop)
        return -1

    in_chunks(work, len(out), 1 + len(out) * _MIN_CUBES_PER_THREAD // max(1, out.size))


@allocating
def subdivide(triangles: Floats, max_side: float, max_relative: float = 0.0, about_z: bool = False) -> Floats:
    """Halve triangles across the longest side until it is short.

    Returns shape (n, 3, 3). The maximum side is ``max_side``, or ``max_relative`` times the distance of the nearest
    corner from the origin (from the z axis, if ``about_z``), whichever is larger.
    """
    pieces, count = np.empty((2 * len(triangles) + 16, 3, 3)), 0
    stack = np.empty((64, 3, 3))  # one triangle for each level of halving
    axes = 2 if about_z else 3
    for triangle in triangles:
        _copy(triangle, stack[0])
        depth = 1
        while depth > 0:
            piece = stack[depth - 1]
            side, square, nearest = 0, 0.0, math.inf
            for e in range(3):
                length, far = 0.0, 0.0
                for axis in range(3):
                    length += (piece[(e + 1) % 3, axis] - piece[e, axis]) ** 2
                    far += piece[e, axis] ** 2 if axis < axes else 0.0
                nearest = min(nearest, far)
                if length > square:
                    side, square = e, length
            if math.sqrt(square) <= max(max_side, max_relative * math.sqrt(nearest)) or depth == len(stack):
                if count == len(pieces):
                    larger = np.empty((2 * count, 3, 3))
                    for k in range(count):
                        _copy(pieces[k], larger[k])
                    pieces = larger
                _copy(piece, pieces[count])
                count += 1
                depth -= 1
                continue
            first, second = side, (side + 1) % 3
            for axis in range(3):
                midpoint = (piece[first, axis] + piece[second, axis]) / 2.0
                for e in range(3):
                    stack[depth, e, axis] = piece[e, axis]
                stack[depth, first, axis] = midpoint
                piece[second, axis] = midpoint
            depth += 1
    return pieces[:count]


@kernel
def _copy(triangle: Floats, to: Floats) -> None:
    """Copy a triangle element by element.

    Assigning the array would take numba two seconds more, to compile its error.
    """
    for e in range(3):
        for axis in range(3):
            to[e, axis] = triangle[e, axis]


@kernel
def _interpolate_at(plane: float, pa: float, qa: float, pc: float, qc: float) -> float:
    """Return coordinate c where a segment meets a plane of axis a.

    It is computed from the nearer end, for the smaller rounding.
    """
    t = (plane - pa) / (qa - pa)
    if t <= 0.5:
        return pc + t * (qc - pc)
    return qc + (plane - qa) / (pa - qa) * (pc - qc)


@kernel
def _clip_to_slab(triangle: Floats, x0: float, x1: float, polygon: Floats) -> int:
    """Clip a triangle to ``x0 <= x <= x1``.

    Writes the (y, z) of the corners in order, and returns their number.
    """
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
                polygon[n, 0] = _interpolate_at(plane, px, qx, py, qy)
                polygon[n, 1] = _interpolate_at(plane, px, qx, pz, qz)
                n += 1
    return n


@kernel
def _clip_to_interval(polygon: Floats, n: int, y0: float, y1: float) -> tuple[float, float]:
    """Return the z-interval of a convex polygon over an interval of y.

    The polygon is (y, z), the interval ``y0 <= y <= y1``. Returns (inf, -inf) if they are disjoint.
    """
    low, high = math.inf, -math.inf
    for e in range(n):
        py, pz = polygon[e]
        qy, qz = polygon[e + 1 if e + 1 < n else 0]
        if y0 <= py <= y1:
            low, high = min(low, pz), max(high, pz)
        if (py < y0 < qy) or (qy < y0 < py):
            z = _interpolate_at(y0, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
        if (py < y1 < qy) or (qy < y1 < py):
            z = _interpolate_at(y1, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
    return low, high


@allocating
def _mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float, start: int, stop: int) -> None:
    """Set ``out[i, j, k]`` if that box is within ``slack`` of a triangle.

    Box (i, j, k) spans ``[i + b0, i + b1]`` along x, and likewise along y and z; all lengths are in cells. Only boxes
    with ``start <= i < stop`` are set.
    """
    _, ny, nz = out.shape
    polygon = np.empty((9, 2))  # corners (y, z) of a triangle clipped to a slab
    for t in range(triangles.shape[0]):
        triangle = triangles[t]
        low_x = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        high_x = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        first = max(start, math.ceil(low_x - slack - b1))
        last = min(stop - 1, math.floor(high_x + slack - b0))
        for i in range(first, last + 1):
            # Clip the triangle to the slab of boxes with this x; n corners remain.
            n = _clip_to_slab(triangle, i + b0 - slack, i + b1 + slack, polygon)
            if n == 0:
                continue
            low_y, high_y = polygon[0, 0], polygon[0, 0]
            for e in range(1, n):
                low_y, high_y = min(low_y, polygon[e, 0]), max(high_y, polygon[e, 0])
            first_y = max(0, math.ceil(low_y - slack - b1))
            last_y = min(ny - 1, math.floor(high_y + slack - b0))
            for j in range(first_y, last_y + 1):
                # Clip that polygon to the boxes with this y. It is convex, so it touches one run of boxes along z.
                low, high = _clip_to_interval(polygon, n, j + b0 - slack, j + b1 + slack)
                if low > high:
                    continue
                first_z = max(0, math.ceil(low - slack - b1))
                last_z = min(nz - 1, math.floor(high + slack - b0))
                for k in range(first_z, last_z + 1):
                    out[i, j, k] = True


@kernel
def _cube_point_distance(dx: float, dy: float, dz: float, half: float) -> float:
    """Return the distance of a point from a cube at the origin."""
    dx, dy, dz = max(abs(dx) - half, 0.0), max(abs(dy) - half, 0.0), max(abs(dz) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def _cube_edges_distance(p: Floats, q: Floats, center: Floats, half: float) -> float:
    """Return the distance between a segment and the edges of a cube.

    Only pairs of interior points count; inf if there are none.
    """
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
def _cube_triangle_distance(triangle: Floats, center: Floats, half: float) -> float:
    """Return the distance between a triangle and a disjoint cube."""
    best = math.inf
    for corner in range(8):
        x = center[0] + (half if corner & 1 else -half)
        y = center[1] + (half if corner & 2 else -half)
        z = center[2] + (half if corner & 4 else -half)
        best = min(best, point_triangle((x, y, z), triangle))
    for e in range(3):
        p, q = triangle[e], triangle[e + 1 if e < 2 else 0]
        best = min(best, _cube_point_distance(p[0] - center[0], p[1] - center[1], p[2] - center[2], half))
        best = min(best, _cube_edges_distance(p, q, center, half))
    return best


@kernel
def _is_near(triangle: Floats, center: Floats, half: float, max_distance: float, slack: float) -> bool:
    """Return True if a triangle is within ``max_distance`` of a cube.

    They are disjoint. Up to ``slack`` beyond that, the answer may be True as well.
    """
    cx, cy, cz = center
    x, y, z = cx, cy, cz
    ax, ay, az = triangle[0]
    u = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    v = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    for _ in range(_MAX_PROJECTIONS):
        # Project the cube's point onto the triangle, and the result back onto the cube.
        px, py, pz = nearest_of_triangle((x - ax, y - ay, z - az), u, v)
        px, py, pz = px + ax, py + ay, pz + az
        x = min(max(px, cx - half), cx + half)
        y = min(max(py, cy - half), cy + half)
        z = min(max(pz, cz - half), cz + half)
        dx, dy, dz = px - x, py - y, pz - z
        square = dx * dx + dy * dy + dz * dz
        if square <= max_distance * max_distance:
            return True
        # Along any direction, a corner of the triangle comes first.
        first = math.inf
        for corner in range(3):
            p = triangle[corner]
            first = min(first, dx * (p[0] - cx) + dy * (p[1] - cy) + dz * (p[2] - cz))
        if first - half * (abs(dx) + abs(dy) + abs(dz)) > (max_distance + slack) * math.sqrt(square):
            return False
    return _cube_triangle_distance(triangle, center, half) <= max_distance + slack


@allocating
def _mark_within(
    out: Bytes, swept: SweptTriangles, half: float, radius: float, slack: float, start: int, stop: int
) -> None:
    """Mark cubes near swept triangles.

    ``out[i]`` is set if cube ``i`` is within a radius of a swept triangle. Cube ``i`` is ``i + [-half, half]^3``;
    covers first indices in ``[start, stop)``. The cubes that meet a triangle must be set already. Most cubes in reach
    are set by several triangles, so during the work a positive value in ``out`` is the number of set cubes from there
    on, which later triangles skip.
    """
    _, ny, nz = out.shape
    center = np.empty(3)
    # Squares along each axis: nearest and farthest distance of a cube from the origin, and its gap to the center.
    lows, highs, gaps = np.empty((3, max(out.shape))), np.empty((3, max(out.shape))), np.empty((3, max(out.shape)))
    for axis in range(3):
        for k in range(out.shape[axis]):
            from_origin = abs(k - swept.origin[axis])
            lows[axis, k], highs[axis, k] = max(0.0, from_origin - half) ** 2, (from_origin + half) ** 2
    for t in range(len(swept.triangles)):
        triangle, near = swept.triangles[t], swept.growth[t] + radius
        a, b, c = triangle[0], triangle[1], triangle[2]
        mx, my, mz = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
        # Radius of the triangle about its center: a cube beyond it, plus the reach, cannot be near.
        limit = math.sqrt(
            max(
                (a[0] - mx) ** 2 + (a[1] - my) ** 2 + (a[2] - mz) ** 2,
                (b[0] - mx) ** 2 + (b[1] - my) ** 2 + (b[2] - mz) ** 2,
                (c[0] - mx) ** 2 + (c[1] - my) ** 2 + (c[2] - mz) ** 2,
            )
        )
        # These three are squares, as are the values compared with them.
        limit = (limit + near + slack) ** 2
        outside = (swept.farthest[t] + radius + slack) ** 2
        within = max(0.0, swept.nearest[t] - radius - slack) ** 2
        reach, rise = near + half + slack, (radius if swept.about_z else near) + half + slack
        first_x = max(start, math.ceil(min(a[0], b[0], c[0]) - reach))
        last_x = min(stop - 1, math.floor(max(a[0], b[0], c[0]) + reach))
        first_y = max(0, math.ceil(min(a[1], b[1], c[1]) - reach))
        last_y = min(ny - 1, math.floor(max(a[1], b[1], c[1]) + reach))
        first_z = max(0, math.ceil(min(a[2], b[2], c[2]) - rise))
        last_z = min(nz - 1, math.floor(max(a[2], b[2], c[2]) + rise))
        # Cubes far from the plane of the triangle cannot be near either, which bounds k in each column.
        along_x, along_y, center_z, half_height = _plane_heights(triangle, near + slack, half)
        for axis, (begin, end, m) in enumerate(((first_x, last_x, mx), (first_y, last_y, my), (first_z, last_z, mz))):
            for k in range(begin, end + 1):
                gaps[axis, k] = max(0.0, abs(k - m) - half) ** 2
        for i in range(first_x, last_x + 1):
            for j in range(first_y, last_y + 1):
                across, low_flat, high_flat = (
                    gaps[0, i] + gaps[1, j],
                    lows[0, i] + lows[1, j],
                    highs[0, i] + highs[1, j],
                )
                if across > limit or low_flat > outside or (swept.about_z and high_flat < within):
                    continue
                level = center_z + along_x * (i - mx) + along_y * (j - my)
                row, k = out[i, j], max(first_z, math.ceil(level - half_height)) - 1
                last_k = min(last_z, math.floor(level + half_height))
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
                    if not swept.about_z:
                        low, high = low + lows[2, k], high + highs[2, k]
                    if gap > limit or low > outside or high < within:
                        continue
                    # A point in the cube is at most sqrt(high) + radius from the origin, which bounds its displacement.
                    max_distance = min(near, swept.swing * (math.sqrt(high) + radius) + radius)
                    if gap > max_distance * max_distance:
                        center[0], center[1], center[2] = i, j, k
                        if not _is_near(triangle, center, half, max_distance, slack):
                            continue
                    row[k] = 1
    for i in range(start, stop):
        for j in range(ny):
            row = out[i, j]
            for k in range(nz):
                row[k] = row[k] > 0


@kernel
def _plane_heights(triangle: Floats, distance: float, half: float) -> tuple[float, float, float, float]:
    """Return the plane of a triangle as heights over (x, y).

    Returns the slopes along x and y, the height of the center, and the half height to search. That covers all cubes
    within ``distance`` of the plane; it is unlimited if the plane is steep or the triangle thin.
    """
    a, b, c = triangle[0], triangle[1], triangle[2]
    center_z = (a[2] + b[2] + c[2]) / 3.0
    x, y, z = normal_of(triangle)
    longest = 0.0
    for axis in range(3):
        longest = max(longest, (b[axis] - a[axis]) ** 2, (c[axis] - a[axis]) ** 2, (c[axis] - b[axis]) ** 2)
    if z * z <= MIN_NORMAL_Z * MIN_NORMAL_Z * (x * x + y * y + z * z) or abs(z) <= THIN * longest:
        return 0.0, 0.0, center_z, 2.0**31
    normal = math.sqrt(x * x + y * y + z * z)
    return -x / z, -y / z, center_z, (distance * normal + half * (abs(x) + abs(y) + abs(z))) / abs(z)

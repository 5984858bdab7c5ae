"""Rasters of triangles in space: touched boxes, and boxes within a distance.

A *box* ``i`` is ``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the
outer raster of a robot, ``(0, 0)`` for lattice points. Lengths are in cells, in the index frame of
the output array.

*Touched boxes.* Each triangle is clipped to each slab of boxes across x, and the result to each
slab across y. What remains is convex, so its z-values form an interval, and it meets exactly the
boxes that meet that interval.

*Rounding.* Let u = 2^-53. All vertices lie within 2^22 cells of the frame's corner (for a robot: of
its origin), so no two differ by more than 2^23 along an axis. In units of 2^-30 cells:

* A vertex in cells has two roundings relative to its size (the subtraction of the corner, the
  division by the spacing), and one from the subtraction of a whole number of cells: less than 1.5.
  Rotation adds three more: less than 1.5 again. (The error of the rotation matrix belongs to the
  covering angle.)
* A corner made by clipping lies on the clipping plane to the bit. Its other coordinates are
  ``p + t (q - p)`` with ``t`` at most 1/2, from the nearer end. The parameter ``t`` has three
  relative roundings, and difference, product and sum one each, so the error is less than
  5 u 2^22 + 2^-31, which is 3.
* Planes of one direction do not intersect, so all corners of a first clip lie on the triangle's own
  edges, and those of the second on the edges of the first result. The existence of a corner is
  decided on the numbers as they are, without rounding. So each point of the part of the triangle in
  a slab differs from a point of the computed part by less than 3, and after two clips by less than
  6, in y and z each.
* The ends of a run of boxes have two more roundings: less than 1.

The sum is less than 10. The slabs and the runs of boxes are widened on each side by ``SLACK`` =
2^-26 cells, which is 16. So every box that meets a triangle is marked, and no box farther than 2
``SLACK`` from it along an axis. The rest of ``SLACK`` covers the rounding of a look-up, 4.

*Boxes within a distance.* The distance between a triangle and a disjoint cube is the distance
between two features: a corner and the triangle, a corner of the triangle and the cube, or two
edges. Alternating projections, tried first, bound it from both sides: from above by the distance of
the two points, and from below by the gap between cube and triangle corners along their difference.
The lower bound holds for any direction.

Let L be the extent of all triangles together. A distance to the plane of a triangle has the error
of its normal, less than 2^-39 relative to it (triangles thinner than 2^-12 are assumed as near as
their height allows), so less than 2^-36 L. The position of a corner along a direction has an error
below 2^-50 L. The radius grows by more than both, by 2^-20 + 2^-34 L. The result is complete. It
has no boxes beyond that radius, except for thin triangles: there, within 2^-12 times their length
besides.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace._grid import SLACK
from cspace._raster import find_index_ranges, run_in_slabs
from cspace._support.arrays import Bools, Floats, Ints, Row
from cspace._support.compiling import allocating, internal, kernel
from cspace._support.vectors import (
    THIN,
    add_scaled,
    dot,
    interpolate_at,
    minus,
    nearest_of_triangle,
    normal_of,
    row_at,
    triangle_distance,
)

_MAX_GROWTH_VARIATION: Final = 0.35
"""Maximum variation, in cells, of the displacement in a rotation cell along the side of a piece."""

_MAX_RELATIVE_VARIATION: Final = 0.25
"""Maximum variation of that displacement, relative to it; the larger of both maxima applies."""


def mark_touched(
    out: Bools,
    triangles: Floats,
    b0: float,
    b1: float,
    slack: float = SLACK,
) -> None:
    """Set ``out[i]`` if box ``i`` meets a triangle.

    Box ``i`` is ``i + [b0, b1]^3``, where ``b0`` and ``b1`` are multiples of one half. Triangles,
    shape (n, 3, 3), are in cells, in the index frame of ``out``, and may reach beyond it. A gap
    below ``slack`` counts as touching.
    """
    before = b0 - slack
    after = b1 + slack
    # Distance, in cells, that a clipped triangle may reach beyond its corners; it is below 2^-27.
    clipping_room = 0.001
    lows = triangles.min(axis=1) - (after + clipping_room)
    highs = triangles.max(axis=1) - (before - clipping_room)
    boxes = find_index_ranges(lows, highs, out.shape)
    run_in_slabs(_mark_touched, out, triangles, *boxes, before, after)


class SweptTriangles(NamedTuple):
    """Triangles, with bounds of the regions that they sweep when they rotate.

    The rotations are about the origin, up to an angle. A point of a triangle stays within the
    triangle's growth, ``unit_displacement * farthest``, of its position. It keeps its distance from
    the origin, so it stays in the spherical shell between the triangle's nearest and farthest
    point, and within ``unit_displacement`` times that distance of its position. For rotations about
    the z axis it also keeps its height, and distances are from the axis.

    Attributes
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
        Corners at the representative rotation, in cells.
    nearest, farthest : ndarray of float64, shape (n,)
        Bounds of the distances of each triangle's points from the origin, or from the axis.
    origin : ndarray of float64, shape (3,)
        Center of the rotations.
    unit_displacement : float
        Maximum displacement of a point at distance 1 from the origin.
    about_z : bool
        True if all rotations are about the z axis.
    """

    triangles: Floats
    nearest: Floats
    farthest: Floats
    origin: Floats
    unit_displacement: float
    about_z: bool

    def translate(self, shift: Floats) -> SweptTriangles:
        """Return the triangles and their origin moved by ``shift``, shape (3,)."""
        return self._replace(triangles=self.triangles + shift, origin=self.origin + shift)


def sweep_triangles(triangles: Floats, unit_displacement: float, about_z: bool) -> SweptTriangles:
    """Cut rotating triangles into pieces of nearly constant growth.

    ``unit_displacement`` is the maximum displacement of a point at distance 1 from the origin (from
    the z axis, if ``about_z``); 0 if the triangles do not rotate. All lengths are in cells.
    """
    max_side = _MAX_GROWTH_VARIATION / unit_displacement if unit_displacement > 0.0 else math.inf
    pieces = subdivide(triangles, max_side, _MAX_RELATIVE_VARIATION, about_z)
    centers = pieces.sum(axis=1) / 3.0
    to_corners = _measure_axis_distances(pieces - centers[:, None], about_z)
    nearest = _measure_axis_distances(centers, about_z) - to_corners.max(axis=1)
    # The distance from the origin is convex, so it is largest at a corner.
    farthest = _measure_axis_distances(pieces, about_z).max(axis=1)
    return SweptTriangles(pieces, nearest, farthest, np.zeros(3), unit_displacement, about_z)


def subdivide(
    triangles: Floats,
    max_side: float,
    max_relative: float,
    about_z: bool,
) -> Floats:
    """Subdivide triangles by halving the longest side until it is short.

    Returns shape (n, 3, 3). The maximum side is ``max_side``, or ``max_relative`` times the
    distance of the nearest corner from the origin (from the z axis, if ``about_z``), whichever is
    larger.
    """
    corners = np.ascontiguousarray(triangles.swapaxes(0, 1))
    pieces = []
    # Maximum number of times that a triangle is halved.
    for _ in range(63):
        # Side e leads from corner e to the next one.
        sides = np.linalg.norm(corners[[1, 2, 0]] - corners, axis=2)
        nearest = _measure_axis_distances(corners, about_z).min(axis=0)
        is_long = sides.max(axis=0) > np.maximum(max_side, max_relative * nearest)
        pieces.append(corners[:, ~is_long])
        corners = corners[:, is_long]
        if not corners.size:
            break
        # Corners have the shape (3, n, 3). Cut each triangle at the middle of its longest side.
        begin = sides[:, is_long].argmax(axis=0)
        end = (begin + 1) % 3
        columns = np.arange(len(begin))
        midpoints = (corners[begin, columns] + corners[end, columns]) / 2.0
        end_half = corners.copy()
        end_half[begin, columns] = midpoints
        corners[end, columns] = midpoints
        corners = np.concatenate([end_half, corners], axis=1)
    return np.concatenate([*pieces, corners], axis=1).swapaxes(0, 1).copy()


def _measure_axis_distances(points: Floats, about_z: bool) -> Floats:
    """Return the distances of points from the origin, or the z axis.

    The points have shape (..., 3).
    """
    offsets = points[..., :2] if about_z else points
    return np.asarray(np.linalg.norm(offsets, axis=-1))


def mark_within(out: Bools, swept: SweptTriangles, half: float, radius: float) -> None:
    """Set ``out[i]`` for cubes within a radius of a swept triangle.

    Cube ``i`` is ``i + [-half, half]^3``. The cubes that meet a triangle must be set already,
    unless ``half`` is zero. Lengths are in cells, in the index frame of ``out``.
    """
    extent = float(np.ptp(swept.triangles.reshape(-1, 3), axis=0).max())
    # Distances are rounded in proportion to the coordinates.
    # Rounding allowance of a radius, in cells, before the share of the triangles' extent.
    slack = 2.0**-20 + 2.0**-34 * extent
    growth = np.tile(swept.unit_displacement * swept.farthest[:, None], 3)
    if swept.about_z:
        growth[:, 2] = 0.0  # a point that rotates about z keeps its height
    reach = half + growth + (radius + slack)
    lows = swept.triangles.min(axis=1) - reach
    highs = swept.triangles.max(axis=1) + reach
    boxes = find_index_ranges(lows, highs, out.shape)
    run_in_slabs(_mark_within, out, swept, *boxes, half, radius, slack)


@internal
def _clip_to_slab(triangle: Floats, low: float, high: float, clipped: Floats) -> int:
    """Clip a triangle to the slab ``low <= x <= high``.

    The triangle has shape (3, 3). Writes the (y, z) of the corners in order into ``clipped``, shape
    (9, 2), and returns the number of corners.
    """
    count = 0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[(e + 1) % 3]
        if low <= px <= high:
            clipped[count, 0] = py
            clipped[count, 1] = pz
            count += 1
        # The edge from p to q meets the planes in this order.
        first, second = (low, high) if px < qx else (high, low)
        for plane in (first, second):
            if min(px, qx) < plane < max(px, qx):
                clipped[count, 0] = interpolate_at(plane, px, qx, py, qy)
                clipped[count, 1] = interpolate_at(plane, px, qx, pz, qz)
                count += 1
    return count


@internal
def _heights_between(polygon: Floats, n: int, low: float, high: float) -> tuple[float, float]:
    """Return a polygon's z-interval between two y.

    The polygon is convex; its ``n`` corners (y, z) are the first rows of ``polygon``, shape (9, 2).
    Returns (inf, -inf) if there is no such part.
    """
    lowest = math.inf
    highest = -math.inf
    # The extremes are at corners between the two values, or where edges from p to q cross them.
    for e in range(n):
        py, pz = polygon[e]
        qy, qz = polygon[(e + 1) % n]
        if low <= py <= high:
            lowest = min(lowest, pz)
            highest = max(highest, pz)
        for plane in (low, high):
            if min(py, qy) < plane < max(py, qy):
                z = interpolate_at(plane, py, qy, pz, qz)
                lowest = min(lowest, z)
                highest = max(highest, z)
    return lowest, highest


@allocating
def _mark_touched(
    out: Bools,
    triangles: Floats,
    first: Ints,
    last: Ints,
    before: float,
    after: float,
    start: int,
    stop: int,
) -> None:
    """Set ``out[i, j, k]`` for boxes that triangles meet.

    Box (i, j, k) spans ``[i + before, i + after]`` along x, and likewise along y and z; all lengths
    are in cells. Only boxes with ``start <= i < stop`` are set. ``first`` and ``last``, shape
    (n, 3), are the indices of the boxes around each triangle.
    """
    # Corners (y, z) of a triangle clipped to a slab; an edge adds at most three of them.
    polygon = np.empty((9, 2))
    for t in range(len(triangles)):
        first_i, first_j, first_k = first[t]
        last_i, last_j, last_k = last[t]
        for i in range(max(start, first_i), min(stop - 1, last_i) + 1):
            corners = _clip_to_slab(triangles[t], i + before, i + after, polygon)
            if corners == 0:
                continue
            # Cut the polygon into strips along z, as wide as a box.
            low_y = high_y = polygon[0, 0]
            for e in range(1, corners):
                low_y = min(low_y, polygon[e, 0])
                high_y = max(high_y, polygon[e, 0])
            lowest_j = max(first_j, math.ceil(low_y - after))
            highest_j = min(last_j, math.floor(high_y - before))
            for j in range(lowest_j, highest_j + 1):
                low_z, high_z = _heights_between(polygon, corners, j + before, j + after)
                if low_z > high_z:
                    continue
                lowest_k = max(first_k, math.ceil(low_z - after))
                highest_k = min(last_k, math.floor(high_z - before))
                for k in range(lowest_k, highest_k + 1):
                    out[i, j, k] = True


@internal
def _cube_point_distance(point: Row, half: float) -> float:
    """Return the distance of a point from the cube ``[-half, half]^3``."""
    x = max(abs(point[0]) - half, 0.0)
    y = max(abs(point[1]) - half, 0.0)
    z = max(abs(point[2]) - half, 0.0)
    return math.sqrt(x * x + y * y + z * z)


@internal
def _cube_edges_distance(p: Floats, q: Floats, center: Row, half: float) -> float:
    """Return the distance between a segment and the edges of a cube.

    The segment leads from ``p`` to ``q``, shape (3,); the cube has the sides ``2 * half``. Only
    pairs of interior points count; inf if there are none.
    """
    best = math.inf
    for axis in range(3):
        # Seen along the axis, the four edges along it are points of the plane (u, v).
        u, v = (axis + 1) % 3, (axis + 2) % 3
        du = q[u] - p[u]
        dv = q[v] - p[v]
        squared_length = du * du + dv * dv
        if squared_length == 0.0:
            continue
        for edge_u in (center[u] - half - p[u], center[u] + half - p[u]):
            for edge_v in (center[v] - half - p[v], center[v] + half - p[v]):
                # Point t of the segment, from 0 to 1, is the nearest to the line of the edge.
                t = (edge_u * du + edge_v * dv) / squared_length
                height = p[axis] + t * (q[axis] - p[axis]) - center[axis]
                if 0.0 <= t <= 1.0 and abs(height) <= half:
                    # The parallelogram of the segment and the way to the edge, as seen.
                    area = abs(edge_u * dv - edge_v * du)
                    best = min(best, area / math.sqrt(squared_length))
    return best


@internal
def _cube_triangle_distance(triangle: Floats, center: Row, half: float) -> float:
    """Return the distance of a triangle (3, 3) from a cube.

    It is attained between a corner of either and the other one, or between two edges.
    """
    best = math.inf
    center_x, center_y, center_z = center
    for x in (center_x - half, center_x + half):
        for y in (center_y - half, center_y + half):
            for z in (center_z - half, center_z + half):
                best = min(best, triangle_distance((x, y, z), triangle))
    for e in range(3):
        p, q = triangle[e], triangle[(e + 1) % 3]
        corner = minus(row_at(p, 0), center)
        best = min(best, _cube_point_distance(corner, half))
        best = min(best, _cube_edges_distance(p, q, center, half))
    return best


@internal
def _is_near(
    triangle: Floats,
    center: Row,
    half: float,
    max_distance: float,
    slack: float,
) -> bool:
    """Return True if a triangle is within ``max_distance`` of a disjoint cube.

    The cube has the sides ``2 * half``. Up to ``slack`` beyond that distance, the answer may also
    be True.
    """
    a = minus(row_at(triangle[0], 0), center)
    b = minus(row_at(triangle[1], 0), center)
    c = minus(row_at(triangle[2], 0), center)
    in_cube = (0.0, 0.0, 0.0)
    # Number of alternating projections of cube and triangle that are tried before all features.
    for _ in range(3):
        # Project the cube's point onto the triangle, and the result back onto the cube.
        from_a = nearest_of_triangle(minus(in_cube, a), minus(b, a), minus(c, a))
        in_triangle = add_scaled(from_a, a, 1.0)
        x, y, z = in_triangle
        in_cube = min(max(x, -half), half), min(max(y, -half), half), min(max(z, -half), half)
        gap = minus(in_triangle, in_cube)
        gap_x, gap_y, gap_z = gap
        square = dot(gap, gap)
        if square <= max_distance * max_distance:
            return True
        # Along the gap, the corner of the triangle that comes first must be far beyond the cube.
        triangle_start = min(dot(gap, a), dot(gap, b), dot(gap, c))
        cube_end = half * (abs(gap_x) + abs(gap_y) + abs(gap_z))
        if triangle_start - cube_end > (max_distance + slack) * math.sqrt(square):
            return False
    return _cube_triangle_distance(triangle, center, half) <= max_distance + slack


@internal
def _is_swept_near(
    swept: SweptTriangles,
    t: int,
    center: Row,
    half: float,
    radius: float,
    slack: float,
) -> bool:
    """Return True if a cube is within ``radius`` of a swept triangle.

    That is the region that triangle ``t`` sweeps.
    """
    x, y, z = minus(center, row_at(swept.origin, 0))
    level = 0.0 if swept.about_z else z
    if _cube_point_distance((x, y, level), half) > swept.farthest[t] + radius + slack:
        return False
    square = (abs(x) + half) ** 2 + (abs(y) + half) ** 2
    if not swept.about_z:
        square += (abs(z) + half) ** 2
    # No point within the radius of the cube is farther from the origin.
    max_axis_distance = math.sqrt(square) + radius
    if max_axis_distance < swept.nearest[t] - slack:
        return False
    displacement = swept.unit_displacement * min(swept.farthest[t], max_axis_distance)
    return _is_near(swept.triangles[t], center, half, displacement + radius, slack)


@kernel
def _mark_within(
    out: Bools,
    swept: SweptTriangles,
    first: Ints,
    last: Ints,
    half: float,
    radius: float,
    slack: float,
    start: int,
    stop: int,
) -> None:
    """Mark cubes near swept triangles; see :func:`mark_within`.

    Covers first indices in ``range(start, stop)``. ``first`` and ``last``, shape (n, 3), are the
    indices of the cubes around each swept triangle.
    """
    for t in range(len(swept.triangles)):
        triangle = swept.triangles[t]
        # Cubes far from the plane of the triangle cannot be near either.
        reach = swept.unit_displacement * swept.farthest[t] + radius + slack
        x, y, z = triangle[0]
        slope_x, slope_y, half_height = _plane_heights(triangle, reach, half)
        first_i, first_j, first_k = first[t]
        last_i, last_j, last_k = last[t]
        for i in range(max(start, first_i), min(stop - 1, last_i) + 1):
            for j in range(first_j, last_j + 1):
                height = z + slope_x * (i - x) + slope_y * (j - y)
                lowest_k = max(first_k, math.ceil(height - half_height))
                highest_k = min(last_k, math.floor(height + half_height))
                for k in range(lowest_k, highest_k + 1):
                    center = float(i), float(j), float(k)
                    if not out[i, j, k] and _is_swept_near(swept, t, center, half, radius, slack):
                        out[i, j, k] = True


@internal
def _plane_heights(triangle: Floats, distance: float, half: float) -> tuple[float, float, float]:
    """Bound the heights of cubes near the plane of a triangle.

    Returns the slopes of the plane along x and y, and how far above or below it the center of a
    cube within the distance can be. That is unlimited if the plane is steep or the triangle thin.
    The distance includes the allowance for rounding; with the slope it grows faster than the error
    of the heights.
    """
    normal = normal_of(triangle)
    normal_x, normal_y, normal_z = normal
    a = row_at(triangle[0], 0)
    ab = minus(row_at(triangle[1], 0), a)
    ac = minus(row_at(triangle[2], 0), a)
    bc = minus(ac, ab)
    longest = max(dot(ab, ab), dot(ac, ac), dot(bc, bc))
    length = math.sqrt(dot(normal, normal))
    # Minimum z-component of a unit normal for which the heights of its plane are used.
    if abs(normal_z) <= max(2.0**-5 * length, THIN * longest):
        # Height above all cubes, which is still an index.
        return 0.0, 0.0, 2.0**31
    # Half the extent of a cube along the normal.
    cube_extent = half * (abs(normal_x) + abs(normal_y) + abs(normal_z))
    slope_x = -normal_x / normal_z
    slope_y = -normal_y / normal_z
    return slope_x, slope_y, (distance * length + cube_extent) / abs(normal_z)

"""Small compiled functions of geometry in space, with vectors as tuples of floats.

Two kinds of geometric functions are separate, because proofs use them in different ways:

* **Nearest points** (:func:`triangle_weights`, :func:`nearest_of_triangle`, :func:`gap_between`)
  are as good as rounding allows, and poor for thin triangles and nearly parallel segments. A proof
  uses only a direction from them, or a point of the triangle: the weights lie in [0, 1], so the
  point is within 2^-50 of the coordinates of a point in it.
* **Distances** (:func:`segment_distance_square`, :func:`triangle_distance`) are within a bound of
  the true distance. Let L be the largest distance between any two of the points. With u = 2^-53,
  the foot on a segment has an error below 12 u L, and the distance below 2^-48 L. A normal has an
  error below 5 u times the square of the longest side, which is below 2^-38 of its length for
  triangles that are not thin, and so has the distance from the plane relative to L. Callers allow
  for that: rasters by
  ``2^-20 + 2^-34 L`` (:mod:`cspace._raster.triangles`), decompositions by
  :data:`cspace.spectral._regions.NORMAL_ROUNDING`, arms by ``required`` of
  :func:`cspace._bodies.scenes.make_inner_scene` for BLOCKED.
"""

from __future__ import annotations

import math
from typing import Final

from cspace._support.arrays import Floats, Row
from cspace._support.compiling import internal

Matrix = tuple[Row, Row, Row]
"""Three rows of a matrix, e.g. of a rotation."""

THIN: Final = 2.0**-12
"""Height of a triangle, relative to its longest side, below which its plane is not used."""


@internal
def row_at(array: Floats, start: int) -> Row:
    """Return three entries of an array from ``start`` on."""
    return array[start], array[start + 1], array[start + 2]


@internal
def minus(a: Row, b: Row) -> Row:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@internal
def scale_vector(a: Row, factor: float) -> Row:
    """Return ``factor * a``."""
    return factor * a[0], factor * a[1], factor * a[2]


@internal
def add_scaled(a: Row, u: Row, t: float) -> Row:
    """Return ``a + t * u``."""
    return a[0] + t * u[0], a[1] + t * u[1], a[2] + t * u[2]


@internal
def dot(a: Row, b: Row) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@internal
def cross(a: Row, b: Row) -> Row:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@internal
def rotate(matrix: Matrix, p: Row) -> Row:
    """Multiply a matrix, given by rows, by a vector."""
    x, y, z = matrix
    return dot(x, p), dot(y, p), dot(z, p)


@internal
def rotate_back(matrix: Matrix, p: Row) -> Row:
    """Multiply a matrix's transpose, given by rows, by a vector."""
    x, y, z = matrix
    return (
        x[0] * p[0] + y[0] * p[1] + z[0] * p[2],
        x[1] * p[0] + y[1] * p[1] + z[1] * p[2],
        x[2] * p[0] + y[2] * p[1] + z[2] * p[2],
    )


@internal
def apply_pose(matrix: Matrix, position: Row, p: Row) -> Row:
    """Rotate a point by a matrix's rows, then translate it."""
    return add_scaled(rotate(matrix, p), position, 1.0)


@internal
def box_extent(matrix: Matrix, half: Row) -> Row:
    """Return the half sides of the axis-aligned box around a rotated box.

    ``half`` are the half sides of the box before its rotation.
    """
    x, y, z = matrix
    return (
        abs(x[0]) * half[0] + abs(x[1]) * half[1] + abs(x[2]) * half[2],
        abs(y[0]) * half[0] + abs(y[1]) * half[1] + abs(y[2]) * half[2],
        abs(z[0]) * half[0] + abs(z[1]) * half[1] + abs(z[2]) * half[2],
    )


# ---- nearest points, as good as rounding allows --------------------------------------------------


@internal
def nearest_of_segment(p: Row, u: Row) -> tuple[float, float]:
    """Find the point from p to p + u nearest the origin.

    Returns t in [0, 1], where the point is ``p + t u``, and its squared distance.
    """
    square = dot(u, u)
    t = min(max(-dot(p, u) / square, 0.0), 1.0) if square > 0.0 else 0.0
    point = add_scaled(p, u, t)
    return t, dot(point, point)


@internal
def triangle_weights(a: Row, b: Row, c: Row) -> tuple[float, float]:
    """Return weights (s, t) of a triangle's point nearest the origin.

    The point is ``a + s (b - a) + t (c - a)``. Both weights lie in [0, 1]. On a side or corner, s,
    t or ``1 - s - t`` is exactly zero. Corners may coincide. C. Ericson, "Real-Time Collision
    Detection", 2005, section 5.1.5.
    """
    ab = minus(b, a)
    ac = minus(c, a)
    bc = minus(c, b)
    # Signed areas over the sides opposite the corners, each times the same factor.
    weight_a = dot(ab, b) * dot(ac, c) - dot(ab, c) * dot(ac, b)
    weight_b = dot(ab, c) * dot(ac, a) - dot(ab, a) * dot(ac, c)
    weight_c = dot(ab, a) * dot(ac, b) - dot(ab, b) * dot(ac, a)
    if weight_a > 0.0 and weight_b > 0.0 and weight_c > 0.0:
        total = weight_a + weight_b + weight_c
        s = min(weight_b / total, 1.0)
        return s, min(weight_c / total, 1.0 - s)
    # Otherwise the nearest point lies on a side.
    t_ab, square_ab = nearest_of_segment(a, ab)
    t_ac, square_ac = nearest_of_segment(a, ac)
    t_bc, square_bc = nearest_of_segment(b, bc)
    if square_ab <= square_ac and square_ab <= square_bc:
        return t_ab, 0.0
    if square_ac <= square_bc:
        return 0.0, t_ac
    return 1.0 - t_bc, t_bc


@internal
def nearest_of_triangle(p: Row, u: Row, v: Row) -> Row:
    """Return the point of the triangle (0, u, v) nearest to p."""
    s, t = triangle_weights(scale_vector(p, -1.0), minus(u, p), minus(v, p))
    return s * u[0] + t * v[0], s * u[1] + t * v[1], s * u[2] + t * v[2]


@internal
def gap_between(p: Row, u: Row, q: Row, v: Row) -> Row:
    """Return the vector between two segments' nearest points.

    It leads from the second, ``q + t v``, to the first, ``p + s u``, where s and t lie in [0, 1].
    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
    """
    r = minus(p, q)
    # The nearest points of the lines, then of the segments: s for the lines, t for that s clipped
    # to its segment, and s again for that t. The area is zero if the segments are parallel.
    uu = dot(u, u)
    vv = dot(v, v)
    uv = dot(u, v)
    ur = dot(u, r)
    vr = dot(v, r)
    area = uu * vv - uv * uv
    s = min(max((uv * vr - ur * vv) / area, 0.0), 1.0) if area > 0.0 else 0.0
    t = min(max((uv * s + vr) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    s = min(max((uv * t - ur) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    return r[0] + s * u[0] - t * v[0], r[1] + s * u[1] - t * v[1], r[2] + s * u[2] - t * v[2]


# ---- distances that bound the true one -----------------------------------------------------------


@internal
def segment_distance_square(p: Row, a: Row, b: Row) -> float:
    """Return the squared distance of p from the segment a to b."""
    ab = minus(b, a)
    ap = minus(p, a)
    square = dot(ab, ab)
    t = min(max(dot(ap, ab) / square, 0.0), 1.0) if square > 0.0 else 0.0
    # The gap is measured from the nearer end, for the smaller rounding.
    gap = add_scaled(minus(p, b), ab, 1.0 - t) if t > 0.5 else add_scaled(ap, ab, -t)
    return dot(gap, gap)


@internal
def triangle_distance(p: Row, triangle: Floats) -> float:
    """Return a point's distance from a triangle (3, 3).

    For a triangle thinner than :data:`THIN`, it is too small by at most THIN times the longest
    side.
    """
    near, _ = bound_triangle_distance(p, triangle)
    return near


@internal
def bound_triangle_distance(p: Row, triangle: Floats) -> tuple[float, float]:
    """Bound a point's distance from a triangle (3, 3) from below and above.

    The bounds differ for triangles thinner than :data:`THIN`. A segment repeats the last corner.
    """
    a = row_at(triangle[0], 0)
    b = row_at(triangle[1], 0)
    c = row_at(triangle[2], 0)
    if b == c:
        distance = math.sqrt(segment_distance_square(p, a, b))
        return distance, distance
    ab = minus(b, a)
    bc = minus(c, b)
    ca = minus(a, c)
    square = min(
        segment_distance_square(p, a, b),
        segment_distance_square(p, b, c),
        segment_distance_square(p, c, a),
    )
    distance = math.sqrt(square)
    longest_square = max(dot(ab, ab), dot(bc, bc), dot(ca, ca))
    normal = normal_of(triangle)
    length = math.sqrt(dot(normal, normal))
    # The length of the normal is the longest side times the height over it.
    if length <= THIN * longest_square:
        # Every point of the triangle is within its height of its sides.
        return max(0.0, distance - THIN * math.sqrt(longest_square)), distance
    n = normal[0] / length, normal[1] / length, normal[2] / length
    ap = minus(p, a)
    # Beside the triangle, seen along the normal, the nearest point is on a side.
    is_beside = (
        dot(n, cross(ab, ap)) < 0.0
        or dot(n, cross(bc, minus(p, b))) < 0.0
        or dot(n, cross(ca, minus(p, c))) < 0.0
    )
    if not is_beside:
        distance = min(distance, abs(dot(n, ap)))
    return distance, distance


@internal
def box_distance(box: Floats, p: Row) -> float:
    """Return a point's distance from a box: center, half sides."""
    center = row_at(box, 0)
    half_x, half_y, half_z = row_at(box, 3)
    x, y, z = minus(p, center)
    dx = max(abs(x) - half_x, 0.0)
    dy = max(abs(y) - half_y, 0.0)
    dz = max(abs(z) - half_z, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@internal
def boxes_are_apart(offset: Row, half: Row, other_half: Row) -> bool:
    """Return True if two axis-aligned boxes are apart.

    ``offset`` leads between their centers; their half sides are ``half`` and ``other_half``.
    """
    largest_gap = 0.0
    for axis in range(3):
        gap = abs(offset[axis]) - (half[axis] + other_half[axis])
        largest_gap = max(largest_gap, gap)
    return largest_gap > 0.0


@internal
def normal_of(triangle: Floats) -> Row:
    """Return a triangle's normal, twice its area long."""
    a = row_at(triangle[0], 0)
    ab = minus(row_at(triangle[1], 0), a)
    ac = minus(row_at(triangle[2], 0), a)
    return cross(ab, ac)


# ---- crossings of lines and planes ---------------------------------------------------------------


@internal
def interpolate_at(plane: float, pa: float, qa: float, pc: float, qc: float) -> float:
    """Interpolate a coordinate of a segment where it meets a plane.

    The segment leads from p to q. Along the axis of the plane, its ends have the coordinates ``pa``
    and ``qa``; the ends of the interpolated coordinate are ``pc`` and ``qc``. The result is
    computed from the nearer end, for the smaller rounding.
    """
    from_p = (plane - pa) / (qa - pa)
    if from_p <= 0.5:
        return pc + from_p * (qc - pc)
    from_q = (plane - qa) / (pa - qa)
    return qc + from_q * (pc - qc)


@internal
def cut_triangle(triangle: Floats, x: float) -> tuple[int, float, float, float, float]:
    """Intersect a triangle with a plane across x.

    Returns its facing and the (y, z) of its lower and upper end. The facing is 1 for up, -1 for
    down, 0 if they are disjoint. The plane meets an edge if ``x`` lies in the half-open interval of
    its ends. The point is computed from the nearer end, so that all triangles at an edge compute
    the same point.
    """
    # The plane meets two edges or none; the higher crossing tells the facing.
    facing = 0
    crossings = 0
    low_y = 0.0
    low_z = 0.0
    high_y = 0.0
    high_z = 0.0
    for e in range(3):
        p, q = triangle[e], triangle[(e + 1) % 3]
        p_is_left = p[0] <= x
        if p_is_left == (q[0] <= x):
            continue
        direction = -1 if p_is_left else 1
        if not p_is_left:
            p, q = q, p
        left_x, left_y, left_z = p
        right_x, right_y, right_z = q
        y = interpolate_at(x, left_x, right_x, left_y, right_y)
        z = interpolate_at(x, left_x, right_x, left_z, right_z)
        is_highest = crossings == 0 or y > high_y
        if crossings == 0 or not is_highest:
            low_y = y
            low_z = z
        if is_highest:
            facing = direction
            high_y = y
            high_z = z
        crossings += 1
    return facing, low_y, low_z, high_y, high_z


@internal
def signed_crossing(triangle: Floats, x: float, y: float, z: float) -> int:
    """Return the sign of an upward ray's crossing of a triangle.

    The ray begins at the point (x, y, z). The sign is 1 if the triangle faces up, -1 if it faces
    down, and 0 if the ray misses it.
    """
    facing, low_y, low_z, high_y, high_z = cut_triangle(triangle, x)
    if facing == 0 or not low_y <= y < high_y:
        return 0
    height = interpolate_at(y, low_y, high_y, low_z, high_z)
    return facing if height > z else 0

"""Small compiled functions: geometry in space, with vectors as tuples of floats, and unaligned words.

Two kinds of geometric functions are kept apart, because proofs use them in different ways:

* **Nearest points** (:func:`triangle_weights`, :func:`nearest_of_triangle`, :func:`gap_between`) are as good as
  rounding allows, poor for thin triangles and nearly parallel segments. A proof takes only a direction from them,
  or a point of the triangle: the weights lie in [0, 1], so that the point is within 2^-50 of the coordinates of one.
* **Distances** (:func:`point_segment`, :func:`point_triangle`) are within a bound of the true one. Let L be the largest
  distance between any two of the points. With u = 2^-53, the foot on a segment is off by less than 12 u L, and the
  distance by less than 2^-48 L. A normal is off by less than 5 u times the square of the longest side, which is below
  2^-38 of its length for triangles that are not thin, and so is the distance from the plane relative to L. Callers
  allow for that: rasters by ``2^-20 + 2^-34 L`` (:mod:`cspace.raster.triangles`), decompositions by
  :data:`cspace.spectral.regions.NORMAL_ROUNDING`, arms by :data:`cspace.arms.hulls.FLAT` for what is FREE and by
  ``least`` of :func:`cspace.arms.solids.scene_within` for what is BLOCKED.
"""

from __future__ import annotations

import math
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cspace.arrays import Floats, Matrix, Row
from cspace.compiling import always_inline, kernel

THIN: Final = 2.0**-12
"""Height of a triangle, relative to its longest side, below which its plane is not used."""


@always_inline
def row_of(numbers: Floats, first: int) -> Row:
    """Return three consecutive numbers of an array."""
    return numbers[first], numbers[first + 1], numbers[first + 2]


@always_inline
def minus(a: Row, b: Row) -> Row:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@always_inline
def scaled(a: Row, factor: float) -> Row:
    """Return ``factor * a``."""
    return factor * a[0], factor * a[1], factor * a[2]


@always_inline
def shifted(a: Row, u: Row, t: float) -> Row:
    """Return ``a + t * u``."""
    return a[0] + t * u[0], a[1] + t * u[1], a[2] + t * u[2]


@always_inline
def dot(a: Row, b: Row) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@always_inline
def cross(a: Row, b: Row) -> Row:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@always_inline
def rotated(matrix: Matrix, p: Row) -> Row:
    """Return the product of a matrix, given by its rows, and a vector."""
    x, y, z = matrix
    return dot(x, p), dot(y, p), dot(z, p)


@always_inline
def rotated_back(matrix: Matrix, p: Row) -> Row:
    """Return the product of a transposed matrix, given by its rows before, and a vector."""
    x, y, z = matrix
    return (
        x[0] * p[0] + y[0] * p[1] + z[0] * p[2],
        x[1] * p[0] + y[1] * p[1] + z[1] * p[2],
        x[2] * p[0] + y[2] * p[1] + z[2] * p[2],
    )


@always_inline
def placed(matrix: Matrix, place: Row, p: Row) -> Row:
    """Return where a point comes by a rotation, given by its rows, and then a translation."""
    return shifted(rotated(matrix, p), place, 1.0)


@always_inline
def box_extent(matrix: Matrix, half: Row) -> Row:
    """Return half the sides of the upright box around a rotated box, by half the sides of that."""
    x, y, z = matrix
    return extent_along(x, half), extent_along(y, half), extent_along(z, half)


@always_inline
def extent_along(n: Row, half: Row) -> float:
    """Return half the length of an upright box's projection onto a line, by half its sides."""
    return abs(n[0]) * half[0] + abs(n[1]) * half[1] + abs(n[2]) * half[2]


# ---- nearest points, as good as rounding allows ----------------------------------------------------------------------


@kernel
def triangle_weights(a: Row, b: Row, c: Row) -> tuple[float, float]:
    """Return the weights (s, t) of the triangle's point nearest to the origin, ``a + s (b - a) + t (c - a)``.

    Both lie in [0, 1]. On a side or corner, s, t or ``1 - s - t`` is exactly zero. Corners may coincide.
    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    ab, ac = minus(b, a), minus(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return (d1 / (d1 - d3) if d1 > d3 else 0.0), 0.0
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, (d2 / (d2 - d6) if d2 > d6 else 0.0)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        whole = (d4 - d3) + (d5 - d6)
        t = (d4 - d3) / whole if whole > 0.0 else 0.0
        return 1.0 - t, t
    whole = va + vb + vc
    s = min(max(vb / whole, 0.0), 1.0) if whole > 0.0 else 0.0
    return s, (min(max(vc / whole, 0.0), 1.0 - s) if whole > 0.0 else 0.0)


@kernel
def nearest_of_triangle(p: Row, u: Row, v: Row) -> Row:
    """Return the point nearest to p of the triangle with the corners 0, u and v."""
    s, t = triangle_weights(scaled(p, -1.0), minus(u, p), minus(v, p))
    return s * u[0] + t * v[0], s * u[1] + t * v[1], s * u[2] + t * v[2]


@kernel
def gap_between(p: Row, u: Row, q: Row, v: Row) -> Row:
    """Return the shortest way to one segment, from p along u, from another one, from q along v.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9.
    """
    r = minus(p, q)
    uu, vv, uv, ur, vr = dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)
    area = uu * vv - uv * uv
    s = min(max((uv * vr - ur * vv) / area, 0.0), 1.0) if area > 0.0 else 0.0
    t = min(max((uv * s + vr) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    s = min(max((uv * t - ur) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    return r[0] + s * u[0] - t * v[0], r[1] + s * u[1] - t * v[1], r[2] + s * u[2] - t * v[2]


# ---- distances that bound the true one -------------------------------------------------------------------------------


@kernel
def point_segment(p: Row, a: Row, b: Row) -> float:
    """Return the squared distance between p and the segment from a to b."""
    ab, ap = minus(b, a), minus(p, a)
    square = dot(ab, ab)
    t = min(max(dot(ap, ab) / square, 0.0), 1.0) if square > 0.0 else 0.0
    # From the nearer end, for the smaller rounding.
    way = shifted(minus(p, b), ab, 1.0 - t) if t > 0.5 else shifted(ap, ab, -t)
    return dot(way, way)


@kernel
def point_triangle(p: Row, triangle: Floats) -> float:
    """Return the distance between p and a triangle, shape (3, 3).

    It is up to :data:`THIN` times the longest side too small for a triangle thinner than that.
    """
    a, b, c = row_of(triangle[0], 0), row_of(triangle[1], 0), row_of(triangle[2], 0)
    ab, bc, ca = minus(b, a), minus(c, b), minus(a, c)
    distance = math.sqrt(min(point_segment(p, a, b), point_segment(p, b, c), point_segment(p, c, a)))
    longest, n = max(dot(ab, ab), dot(bc, bc), dot(ca, ca)), normal_of(triangle)
    length = math.sqrt(dot(n, n))
    if length <= THIN * longest:
        # No point of the triangle is farther from its sides than its height.
        return max(0.0, distance - THIN * math.sqrt(longest))
    n, ap = (n[0] / length, n[1] / length, n[2] / length), minus(p, a)
    if dot(n, cross(ab, ap)) < 0.0 or dot(n, cross(bc, minus(p, b))) < 0.0 or dot(n, cross(ca, minus(p, c))) < 0.0:
        return distance
    return min(distance, abs(dot(n, ap)))


@kernel
def normal_of(triangle: Floats) -> Row:
    """Return the normal of a triangle, shape (3, 3), twice as long as its area."""
    a = row_of(triangle[0], 0)
    return cross(minus(row_of(triangle[1], 0), a), minus(row_of(triangle[2], 0), a))


# ---- unaligned words -----------------------------------------------------------------------------------------------


def _load(context: Any, octets: Any, number: Any) -> Any:
    """The word that begins with a byte of an array, wherever that lies; seven more must follow it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_place(context, builder, signature, arguments), align=1)

    return types.uint64(octets, types.int64), generate


def _store(context: Any, octets: Any, number: Any, word: Any) -> Any:
    """Write a word over the byte of an array and the seven that follow it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _place(context, builder, signature, arguments), align=1)
        return context.get_dummy_value()

    return types.void(octets, types.int64, types.uint64), generate


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    return builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())


# A view of bytes as words takes a quarter of a second to compile.
load: Any = intrinsic(_load)
store: Any = intrinsic(_store)

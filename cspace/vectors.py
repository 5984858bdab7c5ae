"""Vectors in space, as tuples of floats, in compiled code."""

from __future__ import annotations

from cspace.arrays import Floats, Row
from cspace.compiling import always_inline, kernel


@always_inline
def row_of(numbers: Floats, first: int) -> Row:
    """Three of some numbers."""
    return numbers[first], numbers[first + 1], numbers[first + 2]


@always_inline
def minus(a: Row, b: Row) -> Row:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@always_inline
def dot(a: Row, b: Row) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@always_inline
def cross(a: Row, b: Row) -> Row:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def nearest_of_triangle(p: Row, a1: Row, a2: Row) -> Row:
    """The point of a triangle with one corner in the origin that is nearest to p, as well as rounding allows.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
    """
    b, c = minus(p, a1), minus(p, a2)
    d1, d2, d3, d4, d5, d6 = dot(a1, p), dot(a2, p), dot(a1, b), dot(a2, b), dot(a1, c), dot(a2, c)
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0, 0.0
    if d3 >= 0.0 and d4 <= d3:
        return a1
    if d6 >= 0.0 and d5 <= d6:
        return a2
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3) if d1 > d3 else 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6) if d2 > d6 else 0.0
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        whole = (d4 - d3) + (d5 - d6)
        t = (d4 - d3) / whole if whole > 0.0 else 0.0
        s = 1.0 - t
    else:
        whole = va + vb + vc
        s, t = (vb / whole, vc / whole) if whole > 0.0 else (0.0, 0.0)
    return s * a1[0] + t * a2[0], s * a1[1] + t * a2[1], s * a1[2] + t * a2[2]

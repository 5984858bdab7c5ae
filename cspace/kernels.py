"""Small functions for compiled code: vectors in space as tuples of floats, and unaligned words."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

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

"""Look-ups of single floats, for callbacks that are called a million times: no arrays, no errors, one compiled call.

What is no number, or no rotation that look-ups take, is not FREE. A position that is none is in no cell.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, Final, NamedTuple

from cspace.arrays import FREE, Numbers
from cspace.compiling import bind_kernel, compilable, jit
from cspace.map.edges import edge_is_free
from cspace.map.points import state_at
from cspace.map.storage import Map


def point_checker(map_: Map, size: int) -> Callable[..., bool]:
    """``check(*q)``: whether a configuration is FREE."""
    # Looking up a point is too short to let go of the interpreter for.
    return callback(Point(map_), size, nogil=False)


def edge_checker(map_: Map, size: int) -> Callable[..., bool]:
    """``check(*q0, *q1)``: whether an edge is FREE all along."""
    return bind_kernel(_compiled(_OF_TWO[size], nogil=True), (Edge(map_),), 2 * size)


def callback(query: Any, size: int, nogil: bool = True) -> Callable[..., Any]:
    """``call(*q)``: the method ``answer`` of a record, for the floats of one configuration."""
    return bind_kernel(_compiled(_OF_ONE[size], nogil), (query,), size)


@compilable
class Point(NamedTuple):
    """Whether a configuration is FREE."""

    map_: Map

    def evaluate(self, q: Numbers) -> bool:
        return self.map_.rotations.is_usable(q) and state_at(self.map_, q) == FREE


@compilable
class Edge(NamedTuple):
    """Whether an edge is FREE all along."""

    map_: Map

    def evaluate_edge(self, q0: Numbers, q1: Numbers) -> bool:
        rotations = self.map_.rotations
        return rotations.is_usable(q0) and rotations.is_usable(q1) and edge_is_free(self.map_, None, q0, q1)


# Numba calls a function of so many floats quicker than one that takes a tuple of them.

_OF_ONE: Final[dict[int, Any]] = {
    2: lambda query, a, b: query.evaluate((a, b)),
    3: lambda query, a, b, c: query.evaluate((a, b, c)),
    4: lambda query, a, b, c, d: query.evaluate((a, b, c, d)),
    7: lambda query, a, b, c, d, e, f, g: query.evaluate((a, b, c, d, e, f, g)),
}
_OF_TWO: Final[dict[int, Any]] = {
    2: lambda query, a, b, h, i: query.evaluate_edge((a, b), (h, i)),
    3: lambda query, a, b, c, h, i, j: query.evaluate_edge((a, b, c), (h, i, j)),
    4: lambda query, a, b, c, d, h, i, j, k: query.evaluate_edge((a, b, c, d), (h, i, j, k)),
    7: lambda query, a, b, c, d, e, f, g, h, i, j, k, m, n, o: query.evaluate_edge(
        (a, b, c, d, e, f, g), (h, i, j, k, m, n, o)
    ),
}
"""What numba compiles for a query, by the length of a configuration."""


@cache
def _compiled(written: FunctionType, nogil: bool) -> Any:
    """One of these; numba keeps it by its name."""
    named = FunctionType(written.__code__, written.__globals__)
    named.__qualname__ = f"spread_{'without' if nogil else 'with'}_lock"
    return jit(named, _nrt=False, nogil=nogil)

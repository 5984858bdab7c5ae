"""Callbacks on single floats, without arrays or errors.

NaN, infinity and unusable rotations are not FREE, because such a position is in no cell.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, Final, NamedTuple

from cspace.arrays import FREE, Numbers
from cspace.map.edges import edge_is_free
from cspace.map.points import state_at
from cspace.map.storage import Map
from cspace.rotations.records import bind_kernel, compilable, jit


def point_checker(map_: Map, size: int) -> Callable[..., bool]:
    """Return ``check(*q)``, True if a configuration is FREE."""
    # A point query is shorter than releasing the interpreter lock.
    return callback(Point(map_), size, nogil=False)


def edge_checker(map_: Map, size: int) -> Callable[..., bool]:
    """Return ``check(*q0, *q1)``, True if an edge is FREE."""
    return bind_kernel(_compiled(_OF_TWO[size], nogil=True), (Edge(map_),), *[0.0] * (2 * size))


def callback(query: Any, size: int, nogil: bool = True) -> Callable[..., Any]:
    """Return ``evaluate`` of a record as ``call(*q)``."""
    return bind_kernel(_compiled(_OF_ONE[size], nogil), (query,), *[0.0] * size)


@compilable
class Point(NamedTuple):
    """Query for whether a configuration is FREE."""

    map_: Map

    def evaluate(self, q: Numbers) -> bool:
        """Return True if the configuration is usable and FREE."""
        return self.map_.rotations.is_usable(q) and state_at(self.map_, q) == FREE


@compilable
class Edge(NamedTuple):
    """Query for whether an edge is FREE."""

    map_: Map

    def evaluate_edge(self, q0: Numbers, q1: Numbers) -> bool:
        """Return True if both ends are usable and the edge is FREE."""
        rotations = self.map_.rotations
        return rotations.is_usable(q0) and rotations.is_usable(q1) and edge_is_free(self.map_, None, q0, q1)


# Numba calls a function of several floats faster than a function of one tuple.

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
"""Functions that numba compiles for a query, by the length of a configuration."""


@cache
def _compiled(written: FunctionType, nogil: bool) -> Any:
    """Compile a function under a name for numba's cache."""
    named = FunctionType(written.__code__, written.__globals__)
    named.__qualname__ = f"spread_{'without' if nogil else 'with'}_lock"
    return jit(named, _nrt=False, nogil=nogil)

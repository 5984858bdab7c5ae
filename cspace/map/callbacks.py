"""Look-ups of one configuration, given by its numbers, without arrays or errors."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, Final, NamedTuple

from cspace.arrays import FREE, MIXED, Numbers
from cspace.map.edges import edge_is_free
from cspace.map.points import cell_of, is_usable, state_at
from cspace.map.storage import Map
from cspace.rotations.records import bind_kernel, compilable, jit

NOT_USABLE: Final = 255
"""Answer for numbers that are not finite, or no rotation."""


def state_lookup(map_: Map, size: int) -> Callable[..., int]:
    """Return ``look_up(*q)``: the state of a configuration, or NOT_USABLE."""
    # A look-up is shorter than releasing the interpreter lock.
    return callback(Point(map_), size, nogil=False)


def place_lookup(map_: Map, size: int) -> Callable[..., int]:
    """Return ``look_up(*q)``: the index of a cell over all rotation cells; -1 if it is not in the grid."""
    return callback(Place(map_), size, nogil=False)


def motion_lookup(map_: Map, size: int) -> Callable[..., int]:
    """Return ``look_up(*q0, *q1)``: FREE, MIXED if the motion is not proven, or NOT_USABLE."""
    return bind_kernel(_compiled(_OF_TWO[size], nogil=True), (Edge(map_),), *[0.0] * (2 * size))


def point_checker(map_: Map, size: int) -> Callable[..., bool]:
    """Return ``check(*q)``, True if a configuration is FREE."""
    look_up = state_lookup(map_, size)
    return lambda *q: look_up(*q) == FREE


def edge_checker(map_: Map, size: int) -> Callable[..., bool]:
    """Return ``check(*q0, *q1)``, True if an edge is FREE."""
    look_up = motion_lookup(map_, size)
    return lambda *both: look_up(*both) == FREE


def callback(query: Any, size: int, nogil: bool = True) -> Callable[..., Any]:
    """Return ``evaluate`` of a record as ``call(*q)``."""
    return bind_kernel(_compiled(_OF_ONE[size], nogil), (query,), *[0.0] * size)


@compilable
class Point(NamedTuple):
    """Query for the state of a configuration."""

    map_: Map

    def evaluate(self, q: Numbers) -> int:
        """Return the state, or NOT_USABLE."""
        return state_at(self.map_, q) if is_usable(self.map_, q) else NOT_USABLE


@compilable
class Place(NamedTuple):
    """Query for the cell of a configuration."""

    map_: Map

    def evaluate(self, q: Numbers) -> int:
        """Return the index of the cell over all rotation cells, or -1."""
        if not is_usable(self.map_, q):
            return -1
        inside, _, cell = cell_of(self.map_, q)
        place = self.map_.rotations.cell_at(q)
        for axis in range(len(self.map_.lower)):
            place = place * self.map_.states.shape[axis + 1] + cell[axis + 1]
        return place if inside else -1


@compilable
class Edge(NamedTuple):
    """Query for whether an edge is FREE."""

    map_: Map

    def evaluate_edge(self, q0: Numbers, q1: Numbers) -> int:
        """Return FREE if the edge is FREE, else MIXED; NOT_USABLE if an end is not usable."""
        if not (is_usable(self.map_, q0) and is_usable(self.map_, q1)):
            return NOT_USABLE
        return FREE if edge_is_free(self.map_, q0, q1) else MIXED


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

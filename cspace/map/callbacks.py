"""Look-ups of single floats, for callbacks that are called a million times: no arrays, no checks, one compiled call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import entry, jit
from cspace.map.edges import edge_is_free
from cspace.map.kept import Change
from cspace.map.points import state_at
from cspace.map.record import Map
from cspace.states import FREE

States = NDArray[np.uint8]


def point_checker(map_: Map, dof: int) -> Callable[..., bool]:
    """``check(*q)``: whether a configuration is FREE."""
    return entry(_POINTS[dof], (map_,), dof)


def edge_checker(map_: Map, dof: int) -> Callable[..., bool]:
    """``check(*q0, *q1)``: whether an edge is FREE all along."""
    return entry(_EDGES[dof], (map_,), 2 * dof)


# Numba calls a function of so many floats quicker than one that takes a tuple of them. Looking up a point is too short
# to let go of the interpreter for.


@jit(nogil=False)
def _point_2(map_: Map, x: float, y: float) -> bool:
    return state_at(map_, (x, y)) == FREE


@jit(nogil=False)
def _point_3(map_: Map, a: float, b: float, c: float) -> bool:
    return state_at(map_, (a, b, c)) == FREE


@jit(nogil=False)
def _point_4(map_: Map, a: float, b: float, c: float, d: float) -> bool:
    return state_at(map_, (a, b, c, d)) == FREE


@jit
def _edge_2(map_: Map, a: float, b: float, c: float, d: float) -> bool:
    return edge_is_free(map_, map_.states.ravel(), map_.states.ravel()[:0], (a, b), (c, d))


@jit
def _edge_3(map_: Map, a: float, b: float, c: float, d: float, e: float, f: float) -> bool:
    return edge_is_free(map_, map_.states.ravel(), map_.states.ravel()[:0], (a, b, c), (d, e, f))


@jit
def _edge_4(map_: Map, a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float) -> bool:
    return edge_is_free(map_, map_.states.ravel(), map_.states.ravel()[:0], (a, b, c, d), (e, f, g, h))


_POINTS: Final = {2: _point_2, 3: _point_3, 4: _point_4}
_EDGES: Final = {2: _edge_2, 3: _edge_3, 4: _edge_4}


class Rows:
    """The rows of a plane map as bytes: from Python, a look-up in them takes half as long as a compiled call.

    Parameters
    ----------
    states : ndarray of uint8, shape (1, nx, ny)
        Kept, not copied.
    """

    def __init__(self, states: States) -> None:
        self._cells = states[0]
        # The last row and column stand twice, for points on the grid's upper border.
        self._rows = [self._row(x) for x in range(len(self._cells))]
        self._rows.append(self._rows[-1])

    def renew(self, change: Change) -> None:
        """Take the rows again in which a state has changed."""
        first, last = int(change.states[0, 1]), int(change.states[0, 4])
        for x in range(first, last + 1):
            self._rows[x] = self._row(x)
        self._rows[-1] = self._rows[-2]

    def _row(self, x: int) -> bytes:
        row = self._cells[x].tobytes()
        return row + row[-1:]

    def checker(self, map_: Map) -> Callable[..., bool]:
        """``check(x, y)``: whether a configuration is FREE."""
        rows, spacing = self._rows, map_.spacing
        (lower_x, lower_y), (upper_x, upper_y) = map_.lower, map_.upper
        outside = point_checker(map_, 2)

        def check(x: float, y: float) -> bool:
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                return not rows[int((x - lower_x) / spacing)][int((y - lower_y) / spacing)]
            return outside(x, y)

        return check

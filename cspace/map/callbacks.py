"""Look-ups of single floats, for callbacks that are called a million times: no arrays, no checks, one compiled call."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from cspace.angles import TURN
from cspace.compiling import entry, reader
from cspace.map.edges import edge_is_free
from cspace.map.points import state_at
from cspace.map.record import Map
from cspace.states import FREE

T = TypeVar("T")


def point_checker(map_: Map, dof: int) -> Callable[..., bool]:
    """``check(*q)``: whether a configuration is FREE."""
    return entry(_POINTS[dof], (map_,), dof)


def edge_checker(map_: Map, dof: int) -> Callable[..., bool]:
    """``check(*q0, *q1)``: whether an edge is FREE all along."""
    return entry(_EDGES[dof], (map_,), 2 * dof)


def brought(check: Callable[..., T], endless: Sequence[bool]) -> Callable[..., T]:
    """The function, with angles wrapped to half a turn from 0, and those of a second configuration from the first."""
    circles, dof = [k for k, turns in enumerate(endless) if turns], len(endless)
    if not circles:
        return check

    def wrapped(*numbers: float) -> T:
        near = list(numbers)
        for k in circles:
            near[k] = math.remainder(numbers[k], TURN)
            for n in range(dof + k, len(near), dof):
                near[n] = near[k] + math.remainder(numbers[n] - numbers[k], TURN)
        return check(*near)

    return wrapped


def below_half_a_turn(check: Callable[..., bool], endless: Sequence[bool]) -> Callable[..., bool]:
    """The check, False where an angle changes by half a turn or more, and the shorter arc may be the other one."""
    circles, dof = [k for k, turns in enumerate(endless) if turns], len(endless)
    if not circles:
        return check
    return lambda *both: all(abs(both[dof + k] - both[k]) < 0.499 * TURN for k in circles) and check(*both)


# Numba calls a function of so many floats quicker than one that takes a tuple of them. Looking up a point is too short
# to let go of the interpreter for.


@reader(nogil=False)
def _point_2(map_: Map, x: float, y: float) -> bool:
    return state_at(map_, (x, y)) == FREE


@reader(nogil=False)
def _point_3(map_: Map, a: float, b: float, c: float) -> bool:
    return state_at(map_, (a, b, c)) == FREE


@reader(nogil=False)
def _point_4(map_: Map, a: float, b: float, c: float, d: float) -> bool:
    return state_at(map_, (a, b, c, d)) == FREE


@reader(nogil=False)
def _point_7(map_: Map, a: float, b: float, c: float, d: float, e: float, f: float, g: float) -> bool:
    return state_at(map_, (a, b, c, d, e, f, g)) == FREE


@reader
def _edge_2(map_: Map, a: float, b: float, c: float, d: float) -> bool:
    return edge_is_free(map_, None, (a, b), (c, d))


@reader
def _edge_3(map_: Map, a: float, b: float, c: float, d: float, e: float, f: float) -> bool:
    return edge_is_free(map_, None, (a, b, c), (d, e, f))


@reader
def _edge_4(map_: Map, a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float) -> bool:
    return edge_is_free(map_, None, (a, b, c, d), (e, f, g, h))


@reader
def _edge_7(
    map_: Map,
    a: float,
    b: float,
    c: float,
    d: float,
    e: float,
    f: float,
    g: float,
    h: float,
    i: float,
    j: float,
    k: float,
    l: float,  # noqa: E741
    m: float,
    n: float,
) -> bool:
    return edge_is_free(map_, None, (a, b, c, d, e, f, g), (h, i, j, k, l, m, n))


_POINTS: Final = {2: _point_2, 3: _point_3, 4: _point_4, 7: _point_7}
_EDGES: Final = {2: _edge_2, 3: _edge_3, 4: _edge_4, 7: _edge_7}

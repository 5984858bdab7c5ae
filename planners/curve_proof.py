"""Compiled proof that the curve of a car is free all along."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import entry, jit
from cspace.map.points import around_is_free
from cspace.map.record import Map
from cspace.space import CSpace
from cspace.states import MIXED
from planners.shortest_curves import (
    GAP,
    MOST,
    REEDS_SHEPP,
    Pose,
    is_new,
    onwards,
    reverse,
    swaps,
    tied_words,
    total_length,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TIE = 1e-6
"""By how much curves may differ in length, in turning radii, to count as equally short."""

ROUNDING = 1e-9
"""Allowance for the rounding of a curve's points, in turning radii and in radians."""

LONGEST = 4.0
"""Longest piece of a curve that is proven at once, in cells."""

SHORTEST = 1.0 / 16.0
"""Shortest one."""


def prover(space: CSpace, kind: int, radius: float) -> Callable[..., float]:
    """:func:`proven_length` of the floats of two configurations."""
    map_ = space._map
    # A curve that leaves the grid is not proven, whatever is known out there.
    map_ = map_._replace(exterior=np.full_like(map_.exterior, MIXED))
    return entry(proven_length, (map_, kind, radius), 6)


@jit
def proven_length(
    map_: Map, kind: int, radius: float, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
) -> float:
    """Metres of the shortest curve where every configuration of it lies in FREE cells of the grid, otherwise -1.

    Where several curves are equally short but for ``TIE``, that holds for every one of them, whichever is driven.
    """
    q0, q1 = (x0, y0, yaw0), (x1, y1, yaw1)
    if swaps(kind, q0, q1):
        q0, q1 = q1, q0
    turns, lengths = np.zeros((2 * MOST, 5), np.int64), np.zeros((2 * MOST, 5))
    count, gap = tied_words(kind, radius, (q0, q1), TIE, turns, lengths)
    if not gap <= GAP:
        return -1.0
    shortest = total_length(lengths[0])
    if kind == REEDS_SHEPP:
        # OMPL may have found its curve from the other end, where rounding prefers another of those that tie.
        others, _ = tied_words(kind, radius, (q1, q0), TIE, turns[count:], lengths[count:])
        for row in range(count, count + others):
            for k in range(5):
                turns[count, k], lengths[count, k] = turns[row, k], lengths[row, k]
            reverse(turns[count], lengths[count])
            count += is_new(turns, lengths, count)
    # However the gap is spread along the curve, and whichever end it is drawn from, it stays this close.
    spare = (gap if count == 1 else GAP) * (1.0 + shortest + TIE) + ROUNDING
    for end in (q0, q1):
        if not around_is_free(map_, end, spare * radius, spare):
            return -1.0
    for row in range(count):
        if not _word_is_free(map_, radius, q0, turns[row], lengths[row], spare):
            return -1.0
    return radius * shortest


@jit
def _word_is_free(map_: Map, radius: float, q0: Pose, turns: Ints, lengths: Floats, spare: float) -> bool:
    """Whether every configuration within ``spare`` of a word, but for its ends, lies in FREE cells of the grid.

    A piece of the curve of length l lies within l / 2 of its middle, and turns by at most l / (2 radius) from there; so
    a box of that size around the middle holds all of it. Where a box is not free, the piece is halved, until the middle
    itself is not free or the piece is a sixteenth of a cell.
    """
    longest, least = LONGEST * map_.spacing / radius, SHORTEST * map_.spacing / radius
    pose = (0.0, 0.0, q0[2])
    for k in range(5):
        total, sign, turn = abs(lengths[k]), math.copysign(1.0, lengths[k]), turns[k]
        done, step = 0.0, longest
        while done < total:
            last = step >= total - done
            part = total - done if last else step
            half = 0.5 * part
            u, v, yaw = onwards(pose, turn, sign * (done + half))
            middle = (q0[0] + radius * u, q0[1] + radius * v, yaw)
            if around_is_free(map_, middle, (half + spare) * radius, (half if turn != 0 else 0.0) + spare):
                if last:
                    break
                done, step = done + part, min(2.0 * step, longest)
            elif part <= least or not around_is_free(map_, middle, spare * radius, spare):
                return False
            else:
                step = half
        pose = onwards(pose, turn, lengths[k])
    return True

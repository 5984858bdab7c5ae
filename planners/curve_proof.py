"""Compiled proof that the curve of a car is free all along."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._kernels import square_is_free
from cspace.compiling import entry, jit
from cspace.rotations import TURN, YAW_SLACK
from cspace.space import CSpace
from cspace.states import MIXED
from cspace.turning._kernels import first_cell
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


class Cells(NamedTuple):
    """The map, as the proof reads it."""

    states: NDArray[np.uint8]
    slice_of: Ints
    borders: Floats
    frame: Floats
    nothing: Ints


def prover(space: CSpace, kind: int, radius: float) -> Callable[..., float]:
    """:func:`proven_length` of the floats of two configurations."""
    frame = np.array([*space.grid.lower, space.grid.spacing, *space.grid.upper])
    borders = np.asarray(space.rotations.borders) if space.rotations else np.empty(0)
    cells = Cells(space.stack, space.slice_of, borders, frame, np.array([0, 0, -1, -1], dtype=np.int64))
    return entry(proven_length, (cells, kind, radius), 6)


@jit
def proven_length(
    cells: Cells, kind: int, radius: float, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
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
    if not _box_is_free(cells, q0, spare * radius, spare) or not _box_is_free(cells, q1, spare * radius, spare):
        return -1.0
    for row in range(count):
        if not _word_is_free(cells, radius, q0, turns[row], lengths[row], spare):
            return -1.0
    return radius * shortest


@jit
def _word_is_free(cells: Cells, radius: float, q0: Pose, turns: Ints, lengths: Floats, spare: float) -> bool:
    """Whether every configuration within ``spare`` of a word, but for its ends, lies in FREE cells of the grid.

    A piece of the curve of length l lies within l / 2 of its middle, and turns by at most l / (2 radius) from there; so
    a box of that size around the middle holds all of it. Where a box is not free, the piece is halved, until the middle
    itself is not free or the piece is a sixteenth of a cell.
    """
    spacing = cells.frame[2]
    longest, least = LONGEST * spacing / radius, SHORTEST * spacing / radius
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
            if _box_is_free(cells, middle, (half + spare) * radius, (half if turn != 0 else 0.0) + spare):
                if last:
                    break
                done, step = done + part, min(2.0 * step, longest)
            elif part <= least or not _box_is_free(cells, middle, spare * radius, spare):
                return False
            else:
                step = half
        pose = onwards(pose, turn, lengths[k])
    return True


@jit
def _box_is_free(cells: Cells, q: Pose, distance: float, angle: float) -> bool:
    """Whether all cells are FREE that meet the box of configurations around one; none is that lies outside the grid."""
    x, y, yaw = q
    borders = cells.borders
    count, reach = cells.slice_of.shape[0], min(angle, math.pi)
    start = yaw - math.floor((yaw - borders[0]) / TURN) * TURN
    cell = first_cell(borders, start - reach)
    for _ in range(count):
        wraps = math.floor(cell / count)
        k = cell - wraps * count
        if borders[k] + wraps * TURN - YAW_SLACK > start + reach:
            return True
        if not square_is_free(cells.states[cells.slice_of[k]], cells.frame, cells.nothing, MIXED, x, y, distance):
            return False
        cell += 1
    return True

"""Compiled proof that the curve of a car is free all along."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace._kernels import square_is_free
from cspace.rotations import TURN, YAW_SLACK
from cspace.states import MIXED
from cspace.turning._kernels import first_cell
from planners.words._kernels import FORMS, GAP, REEDS_SHEPP, onwards, search, swaps, tied_words, total_length

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stack = NDArray[np.uint8]

TIE = 1e-6
"""By how much curves may differ in length, in turning radii, to count as equally short."""

ROUNDING = 1e-9
"""Allowance for the rounding of a curve's points, in turning radii and in radians."""

LONGEST = 4.0
"""Longest piece of a curve that is proven at once, in cells."""

SHORTEST = 1.0 / 16.0
"""Shortest one."""


@njit(cache=True, nogil=True)
def _box_is_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    box: Ints,
    x: float,
    y: float,
    yaw: float,
    distance: float,
    angle: float,
) -> bool:
    """Whether all cells are FREE that meet the box of configurations around one; none is that lies outside the grid."""
    count, reach = slice_of.shape[0], min(angle, math.pi)
    start = yaw - math.floor((yaw - borders[0]) / TURN) * TURN
    cell = first_cell(borders, start - reach)
    for _ in range(count):
        wraps = math.floor(cell / count)
        k = cell - wraps * count
        if borders[k] + wraps * TURN - YAW_SLACK > start + reach:
            return True
        if not square_is_free(state[slice_of[k]], frame, box, MIXED, x, y, distance):
            return False
        cell += 1
    return True


@njit(cache=True, nogil=True)
def curve_is_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    box: Ints,
    kind: int,
    radius: float,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> bool:
    """``proven_length``, as a yes or no."""
    return proven_length(state, slice_of, borders, frame, box, kind, radius, x0, y0, yaw0, x1, y1, yaw1) >= 0.0


@njit(cache=True, nogil=True)
def proven_length(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    box: Ints,
    kind: int,
    radius: float,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> float:
    """Metres of the shortest curve where every configuration of it lies in FREE cells of the grid, otherwise -1.

    Where several curves are equally short but for ``TIE``, that holds for every one of them, whichever is driven.
    """
    if swaps(kind, x0, y0, yaw0, x1, y1, yaw1):
        x0, y0, yaw0, x1, y1, yaw1 = x1, y1, yaw1, x0, y0, yaw0
    best = search(kind, radius, x0, y0, yaw0, x1, y1, yaw1)
    if not best[2] <= GAP:
        return -1.0
    turns, lengths = np.zeros((16 * FORMS + 1, 5), np.int64), np.zeros((16 * FORMS + 1, 5))
    for k in range(5):
        turns[0, k], lengths[0, k] = best[0][k], best[1][k]
    longest = total_length(best[1]) + TIE
    count = tied_words(kind, radius, x0, y0, yaw0, x1, y1, yaw1, longest, turns, lengths, 1, False)
    if kind == REEDS_SHEPP:
        count = tied_words(kind, radius, x1, y1, yaw1, x0, y0, yaw0, longest, turns, lengths, count, True)
    # However the gap is spread along the curve, and whichever end it is drawn from, it stays this close.
    spare = (best[2] if count == 1 else GAP) * (1.0 + longest) + ROUNDING
    for x, y, yaw in ((x0, y0, yaw0), (x1, y1, yaw1)):
        if not _box_is_free(state, slice_of, borders, frame, box, x, y, yaw, spare * radius, spare):
            return -1.0
    for row in range(count):
        if not _word_is_free(
            state, slice_of, borders, frame, box, radius, x0, y0, yaw0, turns[row], lengths[row], spare
        ):
            return -1.0
    return radius * total_length(best[1])


@njit(cache=True, nogil=True)
def _word_is_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    box: Ints,
    radius: float,
    x0: float,
    y0: float,
    yaw0: float,
    turns: Ints,
    lengths: Floats,
    spare: float,
) -> bool:
    """Whether every configuration within ``spare`` of a word, but for its ends, lies in FREE cells of the grid.

    A piece of the curve of length l lies within l / 2 of its middle, and turns by at most l / (2 radius) from there; so
    a box of that size around the middle holds all of it. Where a box is not free, the piece is halved, until the middle
    itself is not free or the piece is a sixteenth of a cell.
    """
    longest, least = LONGEST * frame[2] / radius, SHORTEST * frame[2] / radius
    u, v, yaw = 0.0, 0.0, yaw0
    for k in range(5):
        total, sign, turn = abs(lengths[k]), math.copysign(1.0, lengths[k]), turns[k]
        done, step = 0.0, longest
        while done < total:
            last = step >= total - done
            part = total - done if last else step
            half = 0.5 * part
            px, py, angle = onwards(u, v, yaw, turn, sign * (done + half))
            x, y = x0 + radius * px, y0 + radius * py
            reach, swing = (half + spare) * radius, (half if turn != 0 else 0.0) + spare
            if _box_is_free(state, slice_of, borders, frame, box, x, y, angle, reach, swing):
                if last:
                    break
                done, step = done + part, min(2.0 * step, longest)
            elif part <= least or not _box_is_free(
                state, slice_of, borders, frame, box, x, y, angle, spare * radius, spare
            ):
                return False
            else:
                step = half
        u, v, yaw = onwards(u, v, yaw, turn, lengths[k])
    return True

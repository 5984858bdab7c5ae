"""Rotation cells in compiled code: what look-ups ask of them.

Numba takes the implementation for the record that a map carries as it compiles a look-up, so that a robot that only
translates pays for nothing. A configuration is a tuple of floats; the last of them are its rotation. Another kind of
rotation cells is one more section and one more column here, beside its class in :mod:`cspace.rotations`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from cspace.compiling import inner
from cspace.rotations import MAX_YAW, TURN, YAW_SLACK, CompiledRotations, OneCell, YawCells

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Numbers = tuple[float, ...]
Cursor = Any
"""Where a walk over rotation cells is: numbers that only the kind itself reads."""


# ---- what look-ups call ----------------------------------------------------------------------------------------------


def blank(rotations: CompiledRotations) -> Numbers:
    """A tuple as long as the rotation in a configuration."""
    raise NotImplementedError


def is_usable(rotations: CompiledRotations, q: Numbers) -> bool:
    """Whether a rotation's numbers are finite, and exact enough."""
    raise NotImplementedError


def slice_at(rotations: CompiledRotations, q: Numbers) -> int:
    """The slice of the rotation cell that holds the rotation of a configuration."""
    raise NotImplementedError


def slices_at(rotations: CompiledRotations, points: Floats, out: Ints) -> None:
    """The same of many, shape (n, dof), for :func:`slice_among` to read."""
    raise NotImplementedError


def slice_among(rotations: CompiledRotations, slices: Ints, k: int) -> int:
    """One of those; -1 where a rotation is not usable."""
    raise NotImplementedError


def first_piece(rotations: CompiledRotations, q0: Numbers, q1: Numbers) -> Cursor:
    """Begin a walk along an edge, on which the rotation goes the shortest way."""
    raise NotImplementedError


def next_piece(rotations: CompiledRotations, cursor: Cursor) -> tuple[bool, int, float, float, Cursor]:
    """The next piece of the edge: whether there is one, its slice, and where it begins and ends.

    Parameters along an edge go from 0 to 1. Rotation cells count as wider by the rounding allowance: pieces overlap.
    """
    raise NotImplementedError


def first_around(rotations: CompiledRotations, q: Numbers, angle: float) -> Cursor:
    """Begin a walk over the rotation cells within an angle of the rotation of a configuration."""
    raise NotImplementedError


def next_around(rotations: CompiledRotations, cursor: Cursor) -> tuple[bool, int, Cursor]:
    """The next of these cells: whether there is one, and its slice."""
    raise NotImplementedError


# ---- one cell --------------------------------------------------------------------------------------------------------


def _one_blank(rotations: OneCell) -> tuple[()]:
    return ()


def _one_is_usable(rotations: OneCell, q: Numbers) -> bool:
    return True


def _one_slice_at(rotations: OneCell, q: Numbers) -> int:
    return 0


def _one_slices_at(rotations: OneCell, points: Floats, out: Ints) -> None:
    pass


def _one_slice_among(rotations: OneCell, slices: Ints, k: int) -> int:
    return 0


def _one_first_piece(rotations: OneCell, q0: Numbers, q1: Numbers) -> bool:
    return True


def _one_next_piece(rotations: OneCell, cursor: bool) -> tuple[bool, int, float, float, bool]:
    return cursor, 0, 0.0, 1.0, False


def _one_first_around(rotations: OneCell, q: Numbers, angle: float) -> bool:
    return True


def _one_next_around(rotations: OneCell, cursor: bool) -> tuple[bool, int, bool]:
    return cursor, 0, False


# ---- yaw cells -------------------------------------------------------------------------------------------------------
#
# Where a walk may pass the last border, cells are counted on beyond 0 and n, n of them to a turn.


@inner
def wrapped(borders: Floats, yaw: float) -> float:
    """A yaw from the first border to the last, but for rounding."""
    return yaw - math.floor((yaw - float(borders[0])) / TURN) * TURN


@inner
def cell_of_wrapped(borders: Floats, yaw: float) -> int:
    """Rotation cell of a wrapped yaw, a border belonging to the cell above it: guessed as if all were equally wide."""
    count = borders.shape[0] - 1
    guess = (yaw - borders[0]) * (count / TURN)
    low = np.int64(guess) if 0.0 <= guess < count else 0
    if borders[np.uint64(low)] <= yaw < borders[np.uint64(low + 1)]:
        return int(low)
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if yaw >= borders[middle]:
            low = middle
        else:
            high = middle
    return low


@inner
def first_cell(borders: Floats, least: float) -> int:
    """First cell, widened by YAW_SLACK, that holds an angle."""
    turns = math.floor((least - borders[0]) / TURN)
    k = cell_of_wrapped(borders, wrapped(borders, least))
    on_border = least - (borders[k] + turns * TURN) <= YAW_SLACK
    return int(k + turns * (borders.shape[0] - 1) - (1 if on_border else 0))


@inner
def widened(borders: Floats, cell: int) -> tuple[int, float, float]:
    """A cell's own number, and its borders widened by YAW_SLACK."""
    count = borders.shape[0] - 1
    turns = math.floor(cell / count)
    k = cell - turns * count
    return k, borders[k] + turns * TURN - YAW_SLACK, borders[k + 1] + turns * TURN + YAW_SLACK


@inner
def shorter_turn(first: float, second: float) -> float:
    """Signed angle from one yaw to another along the shorter arc, in [-pi, pi]."""
    turn = second - first
    turn -= math.floor(turn / TURN) * TURN
    return turn - TURN if turn > math.pi else turn


@inner
def share(low: float, high: float, start: float, turn: float) -> tuple[float, float]:
    """The parameters between which a turn from a yaw is between two angles."""
    if turn == 0.0:
        return 0.0, 1.0
    a = min(max((low - start) / turn, 0.0), 1.0)
    b = min(max((high - start) / turn, 0.0), 1.0)
    return min(a, b), max(a, b)


def _yaw_blank(rotations: YawCells) -> tuple[float]:
    return (0.0,)


def _yaw_is_usable(rotations: YawCells, q: Numbers) -> bool:
    return abs(q[-1]) <= MAX_YAW  # nor is NaN


def _yaw_slice_at(rotations: YawCells, q: Numbers) -> int:
    return int(rotations.slice_of[cell_of_wrapped(rotations.borders, wrapped(rotations.borders, q[-1]))])


def _yaw_slices_at(rotations: YawCells, points: Floats, out: Ints) -> None:
    borders, last = rotations.borders, points.shape[1] - 1
    angles = np.empty(len(points))
    for k in range(len(points)):  # one loop over plain numbers, which the compiler turns into wide instructions
        angles[k] = points[k, last] - np.floor((points[k, last] - borders[0]) / TURN) * TURN
    for k in range(len(points)):
        number = rotations.slice_of[np.uint64(cell_of_wrapped(borders, angles[k]))]
        out[k] = number if abs(points[k, last]) <= MAX_YAW else -1


def _yaw_slice_among(rotations: YawCells, slices: Ints, k: int) -> int:
    return int(slices[k])


def _yaw_first_piece(rotations: YawCells, q0: Numbers, q1: Numbers) -> tuple[float, float, float, int]:
    turn = shorter_turn(q0[-1], q1[-1])
    other = 0.0
    if math.pi - abs(turn) <= YAW_SLACK:  # both arcs are equally long but for rounding, and both are walked
        other = turn - TURN if turn > 0.0 else turn + TURN
    start = wrapped(rotations.borders, q0[-1])
    return start, turn, other, first_cell(rotations.borders, min(start, start + turn))


def _yaw_next_piece(
    rotations: YawCells, cursor: tuple[float, float, float, int]
) -> tuple[bool, int, float, float, tuple[float, float, float, int]]:
    start, turn, other, cell = cursor
    k, low, high = widened(rotations.borders, cell)
    if low > max(start, start + turn) and other != 0.0:
        turn, other = other, 0.0
        cell = first_cell(rotations.borders, min(start, start + turn))
        k, low, high = widened(rotations.borders, cell)
    if low > max(start, start + turn):  # NaN is not, and fails where its position is looked at
        return False, 0, 0.0, 0.0, cursor
    a, b = share(low, high, start, turn)
    return True, rotations.slice_of[k], a, b, (start, turn, other, cell + 1)


def _yaw_first_around(rotations: YawCells, q: Numbers, angle: float) -> tuple[float, int, int]:
    start, reach = wrapped(rotations.borders, q[-1]), min(angle, math.pi)
    return start + reach, first_cell(rotations.borders, start - reach), len(rotations.borders) - 1


def _yaw_next_around(rotations: YawCells, cursor: tuple[float, int, int]) -> tuple[bool, int, tuple[float, int, int]]:
    most, cell, left = cursor
    k, low, _ = widened(rotations.borders, cell)
    return left > 0 and not low > most, rotations.slice_of[k], (most, cell + 1, left - 1)


# ---- which is taken --------------------------------------------------------------------------------------------------

_MADE = {
    blank: {OneCell: _one_blank, YawCells: _yaw_blank},
    is_usable: {OneCell: _one_is_usable, YawCells: _yaw_is_usable},
    slice_at: {OneCell: _one_slice_at, YawCells: _yaw_slice_at},
    slices_at: {OneCell: _one_slices_at, YawCells: _yaw_slices_at},
    slice_among: {OneCell: _one_slice_among, YawCells: _yaw_slice_among},
    first_piece: {OneCell: _one_first_piece, YawCells: _yaw_first_piece},
    next_piece: {OneCell: _one_next_piece, YawCells: _yaw_next_piece},
    first_around: {OneCell: _one_first_around, YawCells: _yaw_first_around},
    next_around: {OneCell: _one_next_around, YawCells: _yaw_next_around},
}


def _register(function: Any, made: dict[type, Any]) -> None:
    overload(function, strict=False)(lambda rotations, *others: made[rotations.instance_class])


for _function, _made in _MADE.items():
    _register(_function, _made)

"""Rotation cells in compiled code, as look-ups use them.

Numba takes the implementation for the record that a map carries as it compiles a look-up, so that a robot that only
translates pays for nothing. A configuration is a tuple of floats; the last of them are its rotation. Another kind of
rotation cells is one more section and one more column here, beside its class in :mod:`cspace.rotations`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cspace.arrays import Floats, Ints
from cspace.compiling import by_kind, inner
from cspace.rotations import (
    MAX_YAW,
    NORM_SLACK,
    QUOTIENT_SLACK,
    TURN,
    YAW_SLACK,
    CompiledRotations,
    OneCell,
    QuaternionCells,
    YawCells,
)
from cspace.vectors import Row as Row

Numbers = tuple[float, ...]
Matrix = tuple[Row, Row, Row]
Cursor = Any
"""Where a walk over rotation cells is: numbers that only the kind itself reads."""


# ---- what look-ups call ----------------------------------------------------------------------------------------------


def origin(rotations: CompiledRotations) -> Numbers:
    """What the numbers of a rotation in a configuration are counted from, a yaw from the first border; a tuple."""
    raise NotImplementedError


def is_usable(rotations: CompiledRotations, q: Numbers) -> bool:
    """Whether a rotation's numbers are finite, and exact enough."""
    raise NotImplementedError


def slice_at(rotations: CompiledRotations, q: Numbers) -> int:
    """The slice of the rotation cell that holds the rotation of a configuration."""
    raise NotImplementedError


def slices_at(rotations: CompiledRotations, points: Floats, places: Floats, out: Ints) -> None:
    """The same of many, shape (n, dof), for :func:`slice_among` to read; a yaw's ``places`` are turns from its origin.

    Those are all numbers in a row, as the compiler likes them.
    """
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


def arc_count(rotations: CompiledRotations, q0: Numbers, q1: Numbers) -> int:
    """Number of shortest arcs from one rotation to another: two where they are equally long but for rounding."""
    raise NotImplementedError


def turn_of(rotations: CompiledRotations, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
    """The angle of one of these arcs, and how far from it a planner may take the rotation to be, radians."""
    raise NotImplementedError


def turned(rotations: CompiledRotations, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    """The first configuration with the rotation at t in [0, 1] along one of these arcs."""
    raise NotImplementedError


def matrix_of(rotations: CompiledRotations, q: Numbers) -> Matrix:
    """The rows of the rotation matrix of a configuration in space."""
    raise NotImplementedError


# ---- one cell --------------------------------------------------------------------------------------------------------


def _one_origin(rotations: OneCell) -> tuple[()]:
    return ()


def _one_is_usable(rotations: OneCell, q: Numbers) -> bool:
    return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start


def _one_slice_at(rotations: OneCell, q: Numbers) -> int:
    return 0


def _one_slices_at(rotations: OneCell, points: Floats, places: Floats, out: Ints) -> None:
    pass


def _one_slice_among(rotations: OneCell, slices: Ints, k: int) -> int:
    return 0


def _one_first_piece(rotations: OneCell, q0: Numbers, q1: Numbers) -> bool:
    return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start


def _one_next_piece(rotations: OneCell, cursor: bool) -> tuple[bool, int, float, float, bool]:
    return cursor, 0, 0.0, 1.0, False


def _one_first_around(rotations: OneCell, q: Numbers, angle: float) -> bool:
    return True


def _one_next_around(rotations: OneCell, cursor: bool) -> tuple[bool, int, bool]:
    return cursor, 0, False


def _one_arc_count(rotations: OneCell, q0: Numbers, q1: Numbers) -> int:
    return 1


def _one_turn_of(rotations: OneCell, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
    return 0.0, 0.0


def _one_turned(rotations: OneCell, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    return q0


def _one_matrix_of(rotations: OneCell, q: Numbers) -> Matrix:
    return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


# ---- yaw cells -------------------------------------------------------------------------------------------------------
#
# Where a walk may pass the last border, cells are counted on below 0 and above n, n of them to a turn.


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


def _yaw_origin(rotations: YawCells) -> tuple[float]:
    return (rotations.borders[0],)


def _yaw_is_usable(rotations: YawCells, q: Numbers) -> bool:
    return abs(q[-1]) <= MAX_YAW  # nor is NaN


def _yaw_slice_at(rotations: YawCells, q: Numbers) -> int:
    return int(rotations.slice_of[cell_of_wrapped(rotations.borders, wrapped(rotations.borders, q[-1]))])


def _yaw_slices_at(rotations: YawCells, points: Floats, places: Floats, out: Ints) -> None:
    last = np.uint64(points.shape[1] - 1)  # unsigned: no index is counted from the end
    for k in range(len(points)):
        yaw = points[k, last]
        angle = yaw - np.floor(places[np.uint64(points.shape[1] * k) + last]) * TURN
        number = rotations.slice_of[np.uint64(cell_of_wrapped(rotations.borders, angle))]
        out[k] = number if abs(yaw) <= MAX_YAW else -1


def _yaw_slice_among(rotations: YawCells, slices: Ints, k: int) -> int:
    return int(slices[k])


def _yaw_first_piece(rotations: YawCells, q0: Numbers, q1: Numbers) -> tuple[float, float, float, int]:
    turn = shorter_turn(q0[-1], q1[-1])
    other = 0.0
    if math.pi - abs(turn) <= YAW_SLACK:  # both arcs are equally long but for rounding, and both are walked
        other = yaw_arc(q0, q1, 1)
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


@inner
def yaw_arc(q0: Numbers, q1: Numbers, arc: int) -> float:
    """Signed angle from one yaw to another along the shorter arc, or along the other one."""
    turn = shorter_turn(q0[-1], q1[-1])
    return turn if arc == 0 else (turn - TURN if turn > 0.0 else turn + TURN)


def _yaw_arc_count(rotations: YawCells, q0: Numbers, q1: Numbers) -> int:
    return 2 if math.pi - abs(yaw_arc(q0, q1, 0)) <= YAW_SLACK else 1


def _yaw_turn_of(rotations: YawCells, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
    return abs(yaw_arc(q0, q1, arc)), 0.0


def _yaw_turned(rotations: YawCells, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    return (*q0[:-1], q0[-1] + t * yaw_arc(q0, q1, arc))


def _yaw_matrix_of(rotations: YawCells, q: Numbers) -> Matrix:
    cosine, sine = math.cos(q[-1]), math.sin(q[-1])
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


# ---- quaternion cells ------------------------------------------------------------------------------------------------

QUARTER = math.pi / 4.0

EQUAL = 4e-9
"""Unit quaternions whose dot product is as near to 1 count as equal for OMPL, which then lets the rotation jump.

It takes 1e-9, of numbers whose norm it lets be off by as much.
"""

SHORT = 1e-9
"""Angle between two quaternions below which the chord between them is as good as the arc."""

Parts = tuple[int, int, int, int, int, int]
Walk = tuple[Numbers, Numbers, float, float, float, float, bool, bool, bool]
Look = tuple[Numbers, float, int, Parts, int, int, int]


@inner
def part_of(borders: Floats, quotient: float) -> int:
    """The part of an axis that holds a quotient, a border belonging to the part above it."""
    parts = borders.shape[0] - 1
    # The arc tangent to a few thousandths, which is enough of a guess.
    angle = quotient * (QUARTER + 0.273 * (1.0 - abs(quotient)))
    guess = (angle + QUARTER) * (parts / (2.0 * QUARTER))
    k = np.int64(guess) if 0.0 <= guess < parts else (0 if guess < 0.0 else parts - 1)
    while k > 0 and quotient < borders[np.uint64(k)]:
        k -= 1
    while k < parts - 1 and quotient >= borders[np.uint64(k + 1)]:
        k += 1
    return int(k)


@inner
def chart_of(x: float, y: float, z: float, w: float) -> int:
    """The component of the largest modulus; the first of equals."""
    chart, most = 0, abs(x)
    if abs(y) > most:
        chart, most = 1, abs(y)
    if abs(z) > most:
        chart, most = 2, abs(z)
    return 3 if abs(w) > most else chart


@inner
def split(q: Numbers, chart: int) -> tuple[float, float, float, float]:
    """A component of a quaternion, and the others in their order."""
    x, y, z, w = q
    if chart == 0:
        return x, y, z, w
    if chart == 1:
        return y, x, z, w
    if chart == 2:
        return z, x, y, w
    return w, x, y, z


@inner
def parts_of(borders: Floats, q: Numbers) -> tuple[int, int, int, int]:
    """Chart of a quaternion, and the parts that hold its quotients there."""
    chart = chart_of(q[0], q[1], q[2], q[3])
    largest, a, b, c = split(q, chart)
    return chart, part_of(borders, a / largest), part_of(borders, b / largest), part_of(borders, c / largest)


@inner
def cell_of_parts(borders: Floats, chart: int, i: int, j: int, k: int) -> int:
    """Number of a cell."""
    n = borders.shape[0] - 1
    return int(((chart * n + i) * n + j) * n + k)


@inner
def is_unit(q: Numbers) -> bool:
    """Whether the norm of a quaternion is 1, but for what is normalised away."""
    return abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 2.0 * NORM_SLACK  # nor is NaN


def _quaternion_origin(rotations: QuaternionCells) -> tuple[float, float, float, float]:
    return (0.0, 0.0, 0.0, 0.0)


def _quaternion_is_usable(rotations: QuaternionCells, q: Numbers) -> bool:
    return is_unit(q[-4:])


def _quaternion_slice_at(rotations: QuaternionCells, q: Numbers) -> int:
    chart, i, j, k = parts_of(rotations.borders, q[-4:])
    return int(rotations.slice_of[cell_of_parts(rotations.borders, chart, i, j, k)])


def _quaternion_slices_at(rotations: QuaternionCells, points: Floats, places: Floats, out: Ints) -> None:
    borders = rotations.borders
    for m in range(len(points)):
        q = (points[m, 3], points[m, 4], points[m, 5], points[m, 6])
        chart, i, j, k = parts_of(borders, q)
        number = rotations.slice_of[np.uint64(cell_of_parts(borders, chart, i, j, k))]
        out[m] = number if is_unit(q) else -1


def _quaternion_slice_among(rotations: QuaternionCells, slices: Ints, k: int) -> int:
    return int(slices[k])


@inner
def normalised(q: Numbers, scale: float) -> Numbers:
    """A quaternion as long as a scale."""
    scale /= math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@inner
def begin_arc(a: Numbers, b: Numbers, other: bool) -> Walk:
    """A walk from one unit quaternion to another, no farther than a right angle and a rounding error.

    SLERP turns evenly from a to b, and meets the chord between them at ``m + s d`` for s from -1 to 1, m the middle and
    d half of the way: at the time t with ``tan((2 t - 1) angle) = s tan(angle)``, ``angle`` being half of that between
    a and b. The chord is straight in every chart, and so it meets borders where linear functions of s are zero.
    """
    half, middle, dot = 0.0, 0.0, 0.0
    for n in range(4):
        half += (b[n] - a[n]) ** 2
        middle += (b[n] + a[n]) ** 2
        dot += a[n] * b[n]
    tangent = math.sqrt(half / middle)
    return a, b, 0.0, 0.0, tangent, math.atan(tangent), other, dot > 1.0 - EQUAL, True


@inner
def arc_endpoints(q0: Numbers, q1: Numbers, arc: int) -> tuple[Numbers, Numbers, float]:
    """Unit quaternions between which SLERP goes along one of the shortest arcs, and the angle between them."""
    a, b = normalised(q0[-4:], 1.0), normalised(q1[-4:], 1.0)
    if (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0.0) != (arc == 1):
        b = normalised(b, -1.0)
    return a, b, 2.0 * begin_arc(a, b, False)[5]


@inner
def both_arcs(a: Numbers, b: Numbers) -> bool:
    """Whether both arcs between two unit quaternions are equally long but for rounding: then both are walked."""
    return abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]) <= QUOTIENT_SLACK


def _quaternion_first_piece(rotations: QuaternionCells, q0: Numbers, q1: Numbers) -> Walk:
    a, b, _ = arc_endpoints(q0, q1, 0)
    return begin_arc(a, b, both_arcs(a, b))


@inner
def leaving(
    share: float, largest: float, largest1: float, other: float, other1: float, low: float, high: float
) -> float:
    """How much of the way from one quaternion to another is in a part of an axis, widened, and no more than a share.

    Of both the largest component is given, which is above zero in the first, and another one.
    """
    for side in range(2):
        # Zero on the border, and below it inside.
        here = other - high * largest if side == 0 else low * largest - other
        there = other1 - high * largest1 if side == 0 else low * largest1 - other1
        if there > 0.0:
            share = min(share, here / (here - there))
    return share


@inner
def next_part(borders: Floats, walk: Walk) -> tuple[int, float, float, Walk]:
    """The next cell of a walk, where the walk is in it, widened by QUOTIENT_SLACK, and the rest of the walk.

    What is farther than rounding from the cell that was left is in another one: there are as many cells as borders on
    the way, and no border is passed twice.
    """
    a, b, done, start, tangent, angle, other, equal, _ = walk
    q = (
        a[0] + done * (b[0] - a[0]),
        a[1] + done * (b[1] - a[1]),
        a[2] + done * (b[2] - a[2]),
        a[3] + done * (b[3] - a[3]),
    )
    chart, i, j, k = parts_of(borders, q)
    p, p1 = split(q, chart), split(b, chart)
    sign = math.copysign(1.0, p[0])
    share, parts = 1.0, (i, j, k)
    for n in range(3):
        low, high = borders[parts[n]] - QUOTIENT_SLACK, borders[parts[n] + 1] + QUOTIENT_SLACK
        share = leaving(share, sign * p[0], sign * p1[0], sign * p[n + 1], sign * p1[n + 1], low, high)
    more, stop = share < 1.0, 1.0
    if more:
        done += (1.0 - done) * share
        stop = min(max(0.5 + 0.5 * math.atan((2.0 * done - 1.0) * tangent) / angle, start), 1.0)
    if not tangent < 2.0:  # nor is NaN, with which the position then fails
        start = stop = math.nan
    cell = cell_of_parts(borders, chart, i, j, k)
    rest = (a, b, done, stop, tangent, angle, other, equal, more)
    return (cell, 0.0, 1.0, rest) if equal else (cell, start, stop, rest)


def _quaternion_next_piece(rotations: QuaternionCells, cursor: Walk) -> tuple[bool, int, float, float, Walk]:
    if not cursor[8]:
        if not cursor[6]:
            return False, 0, 0.0, 0.0, cursor
        cursor = begin_arc(cursor[0], normalised(cursor[1], -1.0), False)
    cell, start, stop, rest = next_part(rotations.borders, cursor)
    return True, rotations.slice_of[cell], start, stop, rest


@inner
def parts_around(borders: Floats, largest: float, other: float, reach: float) -> tuple[int, int]:
    """First and last part of an axis that the quaternions near one may be in; the first above the last if none.

    Those within an angle whose sine is ``reach``, of which two components are given. The quotient is u on a plane
    through zero, and that is within reach where ``r |sin(atan u - atan(other / largest))| <= reach``, r the length of
    the two components.
    """
    last, length = borders.shape[0] - 2, math.hypot(largest, other)
    if not reach < length:
        return 0, last
    middle = math.atan(other / largest) if largest != 0.0 else 2.0 * QUARTER
    swing = math.asin(reach / length) + 2.0 * QUOTIENT_SLACK
    if middle - swing <= -3.0 * QUARTER or middle + swing >= 3.0 * QUARTER:  # past the other end as well
        return 0, last
    low, high = max(middle - swing, -QUARTER), min(middle + swing, QUARTER)
    if low > high:
        return 0, -1
    return part_of(borders, math.tan(low) - QUOTIENT_SLACK), part_of(borders, math.tan(high) + QUOTIENT_SLACK)


@inner
def next_chart(borders: Floats, q: Numbers, reach: float, chart: int) -> Look:
    """Begin with the cells of a chart."""
    largest, a, b, c = split(q, chart)
    i, i1 = parts_around(borders, largest, a, reach)
    j, j1 = parts_around(borders, largest, b, reach)
    k, k1 = parts_around(borders, largest, c, reach)
    if j > j1 or k > k1:
        i1 = i - 1
    return q, reach, chart, (i, i1, j, j1, k, k1), i, j, k


def _quaternion_first_around(rotations: QuaternionCells, q: Numbers, angle: float) -> Look:
    # A rotation's angle is twice that of its quaternion.
    reach = math.sin(min(angle / 2.0, 2.0 * QUARTER)) + QUOTIENT_SLACK
    return next_chart(rotations.borders, normalised(q[-4:], 1.0), reach, 0)


def _quaternion_next_around(rotations: QuaternionCells, cursor: Look) -> tuple[bool, int, Look]:
    q, reach, chart, ranges, i, j, k = cursor
    while i > ranges[1]:
        if chart == 3:
            return False, 0, cursor
        q, reach, chart, ranges, i, j, k = next_chart(rotations.borders, q, reach, chart + 1)
    number = rotations.slice_of[cell_of_parts(rotations.borders, chart, i, j, k)]
    k += 1
    if k > ranges[5]:
        k = ranges[4]
        j += 1
    if j > ranges[3]:
        j = ranges[2]
        i += 1
    return True, number, (q, reach, chart, ranges, i, j, k)


def _quaternion_arc_count(rotations: QuaternionCells, q0: Numbers, q1: Numbers) -> int:
    return 2 if both_arcs(normalised(q0[-4:], 1.0), normalised(q1[-4:], 1.0)) else 1


def _quaternion_turn_of(rotations: QuaternionCells, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
    # A rotation's angle is twice that of its quaternion.
    a, b, angle = arc_endpoints(q0, q1, arc)
    return 2.0 * angle, 2.0 * angle if begin_arc(a, b, False)[7] else 0.0


@inner
def slerp(q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    """The unit quaternion at t."""
    a, b, angle = arc_endpoints(q0, q1, arc)
    first, second = 1.0 - t, t
    if angle > SHORT:
        first, second = math.sin(first * angle), math.sin(second * angle)
    q = (
        first * a[0] + second * b[0],
        first * a[1] + second * b[1],
        first * a[2] + second * b[2],
        first * a[3] + second * b[3],
    )
    return normalised(q, 1.0)


def _quaternion_turned(rotations: QuaternionCells, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    return q0[:-4] + slerp(q0, q1, arc, t)


def _quaternion_matrix_of(rotations: QuaternionCells, q: Numbers) -> Matrix:
    x, y, z, w = normalised(q[-4:], 1.0)
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
    )


# ---- which is taken --------------------------------------------------------------------------------------------------

_MADE: dict[Any, dict[type, Any]] = {
    origin: {OneCell: _one_origin, YawCells: _yaw_origin, QuaternionCells: _quaternion_origin},
    is_usable: {OneCell: _one_is_usable, YawCells: _yaw_is_usable, QuaternionCells: _quaternion_is_usable},
    slice_at: {OneCell: _one_slice_at, YawCells: _yaw_slice_at, QuaternionCells: _quaternion_slice_at},
    slices_at: {OneCell: _one_slices_at, YawCells: _yaw_slices_at, QuaternionCells: _quaternion_slices_at},
    slice_among: {OneCell: _one_slice_among, YawCells: _yaw_slice_among, QuaternionCells: _quaternion_slice_among},
    first_piece: {OneCell: _one_first_piece, YawCells: _yaw_first_piece, QuaternionCells: _quaternion_first_piece},
    next_piece: {OneCell: _one_next_piece, YawCells: _yaw_next_piece, QuaternionCells: _quaternion_next_piece},
    first_around: {OneCell: _one_first_around, YawCells: _yaw_first_around, QuaternionCells: _quaternion_first_around},
    next_around: {OneCell: _one_next_around, YawCells: _yaw_next_around, QuaternionCells: _quaternion_next_around},
    arc_count: {OneCell: _one_arc_count, YawCells: _yaw_arc_count, QuaternionCells: _quaternion_arc_count},
    turn_of: {OneCell: _one_turn_of, YawCells: _yaw_turn_of, QuaternionCells: _quaternion_turn_of},
    turned: {OneCell: _one_turned, YawCells: _yaw_turned, QuaternionCells: _quaternion_turned},
    matrix_of: {OneCell: _one_matrix_of, YawCells: _yaw_matrix_of, QuaternionCells: _quaternion_matrix_of},
}


for _function, _made in _MADE.items():
    by_kind(_function, _made, makes_arrays=True)

"""Look-ups of rotations for kernels, for all kinds of rotation cells.

A rotation is a tuple: a quaternion, or a single yaw, which is zero for a robot that only
translates. Borders are those of :class:`cspace._rotations.base.RotationTable`. The branches on the
length of a rotation, or on the axes of borders, are taken when functions are compiled.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from cspace._rotations.base import ANGLE_SLACK, MAX_ANGLE, TWO_PI
from cspace._support.arrays import Floats, Numbers, Row
from cspace._support.compiling import inlined, internal
from cspace._support.vectors import Matrix, dot, scale_vector

NORM_SLACK: Final = 1e-6
"""Largest deviation of the norm of a quaternion from 1."""

QUOTIENT_SLACK: Final = 1e-9
"""Rounding allowance by which cells are widened at each boundary, in quotients of components."""

OTHER_COMPONENTS: Final = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
"""Indices of the other three components, for each component of a quaternion."""

QUARTER_PI: Final = math.pi / 4.0
"""Half a right angle, in radians."""

OMPL_EQUALITY_SLACK: Final = 4e-9
"""Distance of a dot product from 1 up to which unit quaternions count as equal.

OMPL's rotation may jump between such quaternions. OMPL uses 1e-9, for quaternions whose norm may be
off by as much.
"""


# ---- all kinds of rotations ----------------------------------------------------------------------


@inlined
def rotation_in(borders: Floats, row: Floats) -> Numbers:
    """Return the rotation in a row of coordinates.

    ``borders``, of :class:`cspace._rotations.base.RotationTable`, have two axes for quaternions,
    and none for a robot that does not turn.
    """
    if borders.ndim == 2:
        return row[-4], row[-3], row[-2], row[-1]
    if borders.ndim == 1:
        return (row[-1],)
    return ()


@inlined
def is_rotation(rotation: Numbers) -> bool:
    """Return True if a rotation's coordinates are valid.

    They are finite, a yaw is not too large, and a quaternion has norm 1.
    """
    if len(rotation) == 4:
        return abs(dot_product(rotation, rotation) - 1.0) <= 2.0 * NORM_SLACK  # False for NaN
    if len(rotation) == 1:
        return abs(rotation[0]) <= MAX_ANGLE  # False for NaN
    return True


@inlined
def rotation_cell(borders: Floats, rotation: Numbers) -> int:
    """Return the rotation cell that contains a rotation.

    ``borders`` are those of :class:`cspace._rotations.base.RotationTable`.
    """
    if len(rotation) == 4:  # a quaternion
        chart, i, j, k = find_parts(borders[0], rotation)
        return cell_index(borders[0], chart, i, j, k)
    if len(rotation) == 1:
        return find_cell(borders, rotation[0])
    return 0


@internal
def arc_count(first: Numbers, second: Numbers) -> int:
    """Return the number of shortest arcs between two rotations.

    Two arcs that are equal up to rounding count as two.
    """
    if len(first) == 4:
        cosine = dot_product(normalise(first, 1.0), normalise(second, 1.0))
        return 2 if abs(cosine) <= QUOTIENT_SLACK else 1
    if len(first) == 0:
        return 1
    shorter_arc = len(first) - 1  # zero; for a constant, numba would compile the function again
    angle = signed_angle(first[0], second[0], shorter_arc)
    return 2 if math.pi - abs(angle) <= ANGLE_SLACK else 1


@internal
def arc_angle_and_error(first: Numbers, second: Numbers, arc: int) -> tuple[float, float]:
    """Return the angle of a shortest arc, and its error; radians.

    The error bounds the angle between the rotations on the arc and those of a planner that
    interpolates in its own way: OMPL's may jump between nearly equal quaternions, so that it may be
    off by the whole angle.
    """
    if len(first) == 4:
        path = find_arc(first, second, arc)
        # Twice the half angle is the angle of the quaternions, and a rotation turns twice that.
        angle = 4.0 * path.half_angle
        error = angle if path.is_tiny else 0.0
        return angle, error
    if len(first) == 0:
        return 0.0, 0.0
    return abs(signed_angle(first[0], second[0], arc)), 0.0


@internal
def arc_axis(first: Numbers, second: Numbers, arc: int) -> Row:
    """Return the unit axis about which an arc turns by its angle, in the turning frame."""
    if len(first) == 4:
        path = find_arc(first, second, arc)
        x, y, z, w = path.first
        u, v, t, s = path.second
        # The vector part of the second quaternion as seen from the first.
        step = (
            w * u - x * s - y * t + z * v,
            w * v - y * s - z * u + x * t,
            w * t - z * s - x * v + y * u,
        )
        length = math.sqrt(dot(step, step))
        if length > 0.0:
            return scale_vector(step, 1.0 / length)
    if len(first) == 1:
        return 0.0, 0.0, math.copysign(1.0, signed_angle(first[0], second[0], arc))
    return 0.0, 0.0, 1.0


@internal
def rotation_along(first: Numbers, second: Numbers, arc: int, t: float) -> Numbers:
    """Return the rotation at t, from 0 to 1, along an arc.

    Quaternions are interpolated by SLERP.
    """
    if len(first) == 4:
        path = find_arc(first, second, arc)
        angle = 2.0 * path.half_angle  # between the quaternions
        first_weight = 1.0 - t
        second_weight = t
        # Angle between two quaternions, radians, below which the chord replaces the arc.
        if angle > 1e-9:
            first_weight = math.sin(first_weight * angle)
            second_weight = math.sin(second_weight * angle)
        return normalise(weighted_sum(path.first, path.second, first_weight, second_weight), 1.0)
    if len(first) == 1:
        return (first[0] + t * signed_angle(first[0], second[0], arc),)
    return ()


@internal
def matrix_rows(rotation: Numbers) -> Matrix:
    """Return the rows of the rotation matrix in space."""
    if len(rotation) == 4:
        x, y, z, w = normalise(rotation, 1.0)
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
        )
    if len(rotation) == 0:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    cosine = math.cos(rotation[0])
    sine = math.sin(rotation[0])
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


# ---- yaws ----------------------------------------------------------------------------------------
#
# In walks past the last boundary, cell indices go on below 0 and above n, with n cells to a turn.


@inlined
def wrap_to_cells(borders: Floats, yaw: float) -> float:
    """Wrap a yaw into the range of the cells, up to rounding."""
    return yaw - math.floor((yaw - float(borders[0])) / TWO_PI) * TWO_PI


@inlined
def wrap_near(borders: Floats, yaw: float) -> float:
    """Return what `wrap_to_cells` does, without a division; NaN beyond a turn from the cells."""
    turn = yaw - borders[0]
    wrapped = yaw if turn >= 0.0 else yaw + TWO_PI
    return wrapped if abs(turn) < TWO_PI else math.nan


@inlined
def guess_cell(borders: Floats, yaw: float) -> int:
    """Return the cell of a wrapped yaw, without a branch, or -1 if a guess fails.

    The guess assumes that all cells have one width.
    """
    count = borders.shape[0] - 1
    # The number of cells of equal width below the yaw.
    guess = (yaw - borders[0]) * (count / TWO_PI)
    cell = int(guess) if (guess >= 0.0) & (guess < count) else 0
    is_inside = (borders[cell] <= yaw) & (yaw < borders[cell + 1])
    return cell if is_inside else -1


@inlined
def find_cell(borders: Floats, yaw: float) -> int:
    """Return the cell of a yaw.

    A boundary belongs to the cell above it. A wrong guess is followed by bisection.
    """
    yaw = wrap_to_cells(borders, yaw)
    cell = guess_cell(borders, yaw)
    if cell >= 0:
        return cell
    # Bisect between the boundaries ``low`` and ``high``.
    low = 0
    high = borders.shape[0] - 1
    while high - low > 1:
        center = (low + high) // 2
        if yaw >= borders[center]:
            low = center
        else:
            high = center
    return low


@internal
def first_widened_cell(borders: Floats, angle: float) -> int:
    """Return the first cell, widened by ANGLE_SLACK, that contains an angle.

    ``borders``, shape (n + 1,), are in radians. Indices of cells go on in other turns.
    """
    revolutions = math.floor((angle - borders[0]) / TWO_PI)
    count = borders.shape[0] - 1
    k = find_cell(borders, angle)
    cell = int(k + revolutions * count)
    boundary = borders[k] + revolutions * TWO_PI
    if angle - boundary <= ANGLE_SLACK:
        return cell - 1
    return cell


@inlined
def widened_bounds(borders: Floats, cell: int) -> tuple[int, float, float]:
    """Return the index and the widened bounds of a yaw cell.

    The index is within one turn, the bounds are widened by ANGLE_SLACK. The given index may lie in
    another turn; the bounds then do too.
    """
    count = borders.shape[0] - 1
    revolutions = math.floor(cell / count)
    k = cell - revolutions * count
    low = borders[k] + revolutions * TWO_PI - ANGLE_SLACK
    high = borders[k + 1] + revolutions * TWO_PI + ANGLE_SLACK
    return k, low, high


@inlined
def signed_angle(first: float, second: float, arc: int) -> float:
    """Return the signed angle between two yaws.

    Arc 0 is the shorter one, in [-pi, pi], and arc 1 the other one.
    """
    angle = second - first
    angle -= math.floor(angle / TWO_PI) * TWO_PI
    if angle > math.pi:
        angle -= TWO_PI
    if arc == 0:
        return angle
    return angle - TWO_PI if angle > 0.0 else angle + TWO_PI


# ---- quaternions ---------------------------------------------------------------------------------


class Arc(NamedTuple):
    """A shortest arc between two unit quaternions, with its chord.

    SLERP turns evenly from the first to the second. It meets the chord at ``m + s d`` for s from -1
    to 1, where m is the midpoint and d half the chord. The time t satisfies ``tan((2 t - 1)
    half_angle) = s tan(half_angle)``. The chord is straight in every chart, so it meets boundaries
    at zeros of linear functions of s.

    Attributes
    ----------
    first, second : tuple of float, length 4
        Ends, at most a right angle apart up to rounding.
    tangent, half_angle : float
        Tangent of half the angle between the quaternions, and that half, radians.
    is_tiny : bool
        True if OMPL counts both ends as equal, and may jump between them.
    """

    first: Numbers
    second: Numbers
    tangent: float
    half_angle: float
    is_tiny: bool


@internal
def find_part(borders: Floats, quotient: float) -> int:
    """Return the axis part that contains a quotient.

    A boundary belongs to the part above it.
    """
    parts = borders.shape[0] - 1
    # This polynomial is the arc tangent to a few thousandths.
    angle = quotient * (QUARTER_PI + 0.273 * (1.0 - abs(quotient)))
    guess = (angle + QUARTER_PI) * (parts / (2.0 * QUARTER_PI))
    # Step from the guess to the part that contains the quotient.
    part = int(min(max(guess, 0.0), parts - 1.0))
    while part > 0 and quotient < borders[part]:
        part -= 1
    while part < parts - 1 and quotient >= borders[part + 1]:
        part += 1
    return part


@internal
def find_parts(borders: Floats, q: Numbers) -> tuple[int, int, int, int]:
    """Return the chart of a quaternion, and the parts of its quotients.

    The chart is the component of the largest modulus; the first of equals.
    """
    chart = 0
    for component in range(1, 4):
        if abs(q[component]) > abs(q[chart]):
            chart = component
    largest = q[chart]
    a, b, c = OTHER_COMPONENTS[chart]
    return (
        chart,
        find_part(borders, q[a] / largest),
        find_part(borders, q[b] / largest),
        find_part(borders, q[c] / largest),
    )


@internal
def cell_index(borders: Floats, chart: int, i: int, j: int, k: int) -> int:
    """Encode a chart and three parts as the index of a cell.

    ``borders``, shape (n + 1,), bound the n parts of an axis.
    """
    n = borders.shape[0] - 1
    return int(((chart * n + i) * n + j) * n + k)


@internal
def dot_product(a: Numbers, b: Numbers) -> float:
    """Return the scalar product of quaternions."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@internal
def weighted_sum(a: Numbers, b: Numbers, a_weight: float, b_weight: float) -> Numbers:
    """Return the weighted sum of two quaternions."""
    return (
        a_weight * a[0] + b_weight * b[0],
        a_weight * a[1] + b_weight * b[1],
        a_weight * a[2] + b_weight * b[2],
        a_weight * a[3] + b_weight * b[3],
    )


@internal
def normalise(q: Numbers, scale: float) -> Numbers:
    """Normalise a quaternion, and multiply it by ``scale``, 1 or -1."""
    scale /= math.sqrt(dot_product(q, q))
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@internal
def find_arc(q0: Numbers, q1: Numbers, arc: int) -> Arc:
    """Return a shortest arc between two quaternions.

    Arc 0 is the shorter one; arc 1 is the other one, if both are equal up to rounding.
    """
    a, b = normalise(q0, 1.0), normalise(q1, 1.0)
    # Both signs of a quaternion are one rotation; the nearer sign gives the shorter arc.
    is_beyond_right_angle = dot_product(a, b) < 0.0
    if is_beyond_right_angle != (arc == 1):
        b = normalise(b, -1.0)
    # For unit vectors at an angle t, |b - a| = 2 sin(t / 2) and |b + a| = 2 cos(t / 2).
    difference = weighted_sum(b, a, 1.0, -1.0)
    total = weighted_sum(b, a, 1.0, 1.0)
    tangent = math.sqrt(dot_product(difference, difference) / dot_product(total, total))
    is_tiny = dot_product(a, b) > 1.0 - OMPL_EQUALITY_SLACK
    return Arc(a, b, tangent, math.atan(tangent), is_tiny)


@internal
def find_cell_exit(borders: Floats, arc: Arc, done: float) -> tuple[int, float, float, bool]:
    """Find where an arc's chord leaves its cell.

    ``done`` is the fraction of the chord before the point. Returns the cell, the fraction before
    the next cell, the time from 0 to 1 at which SLERP passes it, and whether there is a next cell.
    The cell is widened by QUOTIENT_SLACK. A point farther than rounding from the previous cell lies
    in another one. So there are as many cells as boundaries on the path, and no boundary is crossed
    twice.
    """
    end = arc.second
    point = weighted_sum(arc.first, weighted_sum(end, arc.first, 1.0, -1.0), 1.0, done)
    chart, i, j, k = find_parts(borders, point)
    parts = i, j, k
    # With the sign that makes the largest component positive, quotients compare without division.
    sign = math.copysign(1.0, point[chart])
    largest = sign * point[chart]
    largest_at_end = sign * end[chart]
    share = 1.0  # fraction of the remaining chord before it leaves the cell
    for n in range(3):
        component = OTHER_COMPONENTS[chart][n]
        value = sign * point[component]
        value_at_end = sign * end[component]
        low = borders[parts[n]] - QUOTIENT_SLACK
        high = borders[parts[n] + 1] + QUOTIENT_SLACK
        # Zero on a boundary of the cell, and negative inside.
        above = value - high * largest
        above_at_end = value_at_end - high * largest_at_end
        below = low * largest - value
        below_at_end = low * largest_at_end - value_at_end
        # The functions are linear along the chord, so these are their zeros.
        if above_at_end > 0.0:
            share = min(share, above / (above - above_at_end))
        if below_at_end > 0.0:
            share = min(share, below / (below - below_at_end))
    done += (1.0 - done) * share
    along_chord = 2.0 * done - 1.0
    time = 0.5 + 0.5 * math.atan(along_chord * arc.tangent) / arc.half_angle
    return cell_index(borders, chart, i, j, k), done, min(time, 1.0), share < 1.0


@internal
def parts_around(borders: Floats, largest: float, other: float, reach: float) -> tuple[int, int]:
    """Return the range of an axis' parts within reach of a quaternion.

    The range is given by its first and last part. The first is above the last if there are none.
    ``reach`` is the sine of an angle. ``largest`` and ``other`` are the two components of the
    quaternion whose quotient the axis has. The plane through zero of quotient u is within reach if
    ``r |sin(atan u - atan(other / largest))| <= reach``, where r is the length of the two
    components.
    """
    last = borders.shape[0] - 2
    length = math.hypot(largest, other)
    if not reach < length:
        return 0, last
    # Parts are intervals of quotients, the tangents of angles from -pi / 4 to pi / 4.
    center = math.atan(other / largest) if largest != 0.0 else 2.0 * QUARTER_PI
    swing = math.asin(reach / length) + 2.0 * QUOTIENT_SLACK
    if abs(center) + swing >= 3.0 * QUARTER_PI:  # beyond the other end as well
        return 0, last
    low = max(center - swing, -QUARTER_PI)
    high = min(center + swing, QUARTER_PI)
    if low > high:
        return 0, -1
    first = find_part(borders, math.tan(low) - QUOTIENT_SLACK)
    last = find_part(borders, math.tan(high) + QUOTIENT_SLACK)
    return first, last

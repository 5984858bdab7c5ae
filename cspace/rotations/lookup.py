"""Look-ups of rotations for kernels, for all kinds of rotation cells.

A rotation is a tuple: a quaternion, or a single yaw, which is zero for a robot that only
translates. Borders are those of :class:`cspace.rotations.base.RotationTable`. The branches on the
length of a rotation, or on the axes of borders, are taken when functions are compiled.
"""

from __future__ import annotations

import math

from cspace.rotations.base import MAX_ANGLE
from cspace.rotations.quaternion import (
    cell_index,
    count_arcs,
    find_arc,
    find_parts,
    is_unit,
    normalise,
    slerp,
)
from cspace.rotations.yaw import count_yaw_arcs, find_cell, signed_angle, wrap_to_cells
from cspace.support.arrays import Floats, Matrix, Numbers
from cspace.support.compiling import inlined, kernel


@inlined
def rotation_in(borders: Floats, row: Floats) -> Numbers:
    """Return the rotation at the end of the numbers of a configuration."""
    if borders.ndim == 2:
        return row[-4], row[-3], row[-2], row[-1]
    return (row[-1] if borders.shape[0] > 0 else 0.0,)


@inlined
def is_rotation(rotation: Numbers) -> bool:
    """Return True if the coordinates of a rotation are finite and exact enough."""
    if len(rotation) == 4:
        return is_unit(rotation)
    return abs(rotation[0]) <= MAX_ANGLE  # False for NaN


@inlined
def rotation_cell(borders: Floats, rotation: Numbers) -> int:
    """Return the rotation cell that contains a rotation."""
    if len(rotation) == 4:
        chart, i, j, k = find_parts(borders[0], rotation)
        return cell_index(borders[0], chart, i, j, k)
    if borders.shape[0] == 0:
        return 0
    return find_cell(borders, wrap_to_cells(borders, rotation[0]))


@kernel
def arc_count(first: Numbers, second: Numbers) -> int:
    """Return the number of shortest arcs between two rotations.

    Two arcs that are equal up to rounding count as two.
    """
    if len(first) == 4:
        return count_arcs(first, second)
    return count_yaw_arcs(first[0], second[0])


@kernel
def arc_angle_and_error(first: Numbers, second: Numbers, arc: int) -> tuple[float, float]:
    """Return the angle of a shortest arc, and its error; radians.

    The error bounds the angle between the rotations on the arc and those of a planner that
    interpolates in its own way: OMPL's may jump between nearly equal quaternions, so that it may be
    off by the whole angle.
    """
    if len(first) == 4:
        path = find_arc(first, second, arc)
        angle = 4.0 * path.half_angle
        return angle, angle if path.is_tiny else 0.0
    return abs(signed_angle(first[0], second[0], arc)), 0.0


@kernel
def rotation_along(first: Numbers, second: Numbers, arc: int, t: float) -> Numbers:
    """Return the rotation at t, from 0 to 1, along an arc."""
    if len(first) == 4:
        return slerp(first, second, arc, t)
    return (first[0] + t * signed_angle(first[0], second[0], arc),)


@kernel
def matrix_rows(rotation: Numbers) -> Matrix:
    """Return the rows of the rotation matrix in space."""
    if len(rotation) == 4:
        x, y, z, w = normalise(rotation, 1.0)
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
        )
    cosine, sine = math.cos(rotation[0]), math.sin(rotation[0])
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)

"""Directions that links keep, and the proof that a motion keeps them.

A cone bounds the angle between an axis of a body and a direction of the base. Let u be the axis, a
unit vector, at the joint rates r, and R the sum of the rates of the revolute joints that carry the
body. Let a motion last from time 0 to 1, and a part from h before a moment to h after. With
the body's angular velocity w at that moment, ``u' = w x u``. The body turns by at most h R, and so
does u.

Better for small h: the axes of joints turn with the joints before them, so ``|w'| <= R^2 / 2``. The
part of ``u'' = w' x u + w x (w x u)`` across u is at most ``R^2 / 2 + |w . u| |w x u| <= R^2``. So
the speed of u is at most ``|w x u| + h R^2``, and u turns by at most ``h |w x u| + h^2 R^2 / 2``.

The angle changes by at most the turn of u. A part is proven if the angle halfway, with the smaller
of both bounds and the rounding, is within the cone. Otherwise it is halved.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace._bodies import ADVANCE_FACTOR, DISTANCE_ROUNDING
from cspace._bodies.chain import (
    REVOLUTE,
    SPIN,
    Chain,
    column_at,
    forward_kinematics,
    motion_bounds,
    rotation_rows,
)
from cspace._support import vectors
from cspace._support.arrays import Floats, Ints, Row
from cspace._support.compiling import internal, kernel

ANGLE_ROUNDING: Final = 4.0 * DISTANCE_ROUNDING
"""Rounding allowance of an angle, radians."""

MIN_PART: Final = 2.0**-12
"""Smallest part of a motion that is tested, as a share of the motion."""

AIMED_SHARE = 0.4
ENOUGH_SHARE = 0.5
"""Shares of the tolerance at which a projection aims, and at which it ends."""

MIN_SLOPE: Final = 1e-6
"""Smallest change of an angle by the joints that a projection follows."""


class Cones(NamedTuple):
    """Bounds of the angles between axes of bodies and directions of the base.

    Attributes
    ----------
    bodies : ndarray of int64, shape (k,)
    axes, directions : ndarray of float64, shape (k, 3)
        Unit vectors, in the frames of body and base.
    angles, tolerances : ndarray of float64, shape (k,)
        Each angle differs from ``angles`` by at most ``tolerances``, radians.
    lower, upper : ndarray of float64, shape (dof,)
        Limits of the joints.
    """

    bodies: Ints
    axes: Floats
    directions: Floats
    angles: Floats
    tolerances: Floats
    lower: Floats
    upper: Floats


NO_CONES: Final[Cones] = Cones(
    bodies=np.zeros(0, dtype=np.int64),
    axes=np.zeros((0, 3)),
    directions=np.zeros((0, 3)),
    angles=np.zeros(0),
    tolerances=np.zeros(0),
    lower=np.zeros(0),
    upper=np.zeros(0),
)
"""No cones."""


@internal
def measure_angle(cones: Cones, k: int, poses: Floats) -> tuple[float, Row]:
    """Return the angle of cone k, and its axis in the base.

    The poses of all bodies have shape (b, 3, 6), as in
    :func:`cspace._bodies.chain.forward_kinematics`.
    """
    axis = vectors.rotate(rotation_rows(poses[cones.bodies[k]]), vectors.row_at(cones.axes[k], 0))
    direction = vectors.row_at(cones.directions[k], 0)
    across = vectors.cross(axis, direction)
    # The arc tangent is precise at all angles, whatever the lengths of both vectors.
    return math.atan2(math.sqrt(vectors.dot(across, across)), vectors.dot(axis, direction)), axis


@internal
def stays_in_cones(chain: Chain, cones: Cones, q0: Floats, q1: Floats, poses: Floats) -> bool:
    """Return True if a motion is proven to keep all angles.

    It leads from ``q0`` to ``q1``, shapes (dof,); equal endpoints mean a point. ``poses`` is
    scratch, shape (b, 3, 6).
    """
    is_kept = True
    for k in range(len(cones.bodies)):
        is_kept = is_kept and stays_in_cone(chain, cones, k, q0, q1, poses)
    return is_kept


@internal
def stays_in_cone(
    chain: Chain, cones: Cones, k: int, q0: Floats, q1: Floats, poses: Floats
) -> bool:
    """Return True if a motion is proven to keep the angle of cone k.

    Arguments are as for :func:`stays_in_cones`.
    """
    body = cones.bodies[k]
    _, _, turn = motion_bounds(chain, body, 0, 0.0, q0, q1)
    rounding = ANGLE_ROUNDING * (1.0 + turn)
    # An angle of a joint is off by a few units in its last digit.
    for b in range(1, len(chain.parents)):
        index = chain.joint_indices[b]
        largest = abs(q0[index]) + abs(q1[index])
        values = abs(chain.factors[b]) * largest + abs(chain.offsets[b])
        rounding += DISTANCE_ROUNDING * 2.0**-9 * values
    tolerance = cones.tolerances[k] - rounding
    # Parts follow each other; each ends at a place at which a part of twice the width may begin.
    start = 0.0
    width = 1.0
    # Parts of a motion tested before it counts as not proven, because it grazes a cone.
    for _ in range(2000):
        half = 0.5 * width
        forward_kinematics(chain, q0, q1, start + half, poses)
        angle, axis = measure_angle(cones, k, poses)
        deviation = abs(angle - cones.angles[k])
        # NaN in a configuration proves nothing.
        if not deviation <= tolerance:
            return False
        across = vectors.cross(column_at(poses[body], SPIN), axis)
        speed = math.sqrt(vectors.dot(across, across))
        change = half * min(turn, speed + 0.5 * half * turn * turn)
        if deviation + change / ADVANCE_FACTOR <= tolerance:
            start += width
            if start >= 1.0:
                return True
            # All widths are powers of 1/2, so these sums are exact.
            while start % (2.0 * width) == 0.0:
                width *= 2.0
        elif width > MIN_PART:
            width = half
        else:
            return False
    return False


@kernel
def move_into_cones(chain: Chain, cones: Cones, q: Floats, slopes: Floats, poses: Floats) -> bool:
    """Move a configuration ``q``, shape (dof,), in place well into all cones.

    Each step follows the pseudo-inverse of the angle's derivative, within the limits of the joints
    (D. Berenson and others, "Manipulation planning on constraint manifolds", 2009). A configuration
    that already is well within stays. Returns False if the projection fails. ``slopes``, shape
    (dof,), and ``poses`` are scratch.
    """
    # Steps after which a projection fails.
    for _ in range(20):
        is_within = True
        for k in range(len(cones.bodies)):
            forward_kinematics(chain, q, q, 0.0, poses)
            angle, axis = measure_angle(cones, k, poses)
            deviation = angle - cones.angles[k]
            if abs(deviation) <= ENOUGH_SHARE * cones.tolerances[k]:
                continue
            is_within = False
            excess = abs(deviation) - AIMED_SHARE * cones.tolerances[k]
            change = -math.copysign(excess, deviation)
            square = fill_slopes(chain, cones, k, angle, axis, change, q, slopes, poses)
            if square < MIN_SLOPE * MIN_SLOPE:
                return False
            step = change / square
            # Longest step of a projection, radians or metres.
            step *= min(1.0, 1.0 / (abs(step) * math.sqrt(square)))
            for d in range(len(q)):
                q[d] = min(max(q[d] + step * slopes[d], cones.lower[d]), cones.upper[d])
        if is_within:
            return True
    return False


@internal
def fill_slopes(
    chain: Chain,
    cones: Cones,
    k: int,
    angle: float,
    axis: Row,
    change: float,
    q: Floats,
    slopes: Floats,
    poses: Floats,
) -> float:
    """Write the derivatives of an angle by the joints; return their squares' sum.

    The angle belongs to cone k. A joint at a limit that the wanted ``change`` of the angle would
    push further has none. Other arguments are as for :func:`move_into_cones`.
    """
    direction = vectors.row_at(cones.directions[k], 0)
    # The unit vector along which the axis moves away from the direction.
    outward = vectors.minus(vectors.scale_vector(axis, math.cos(angle)), direction)
    length = math.sqrt(vectors.dot(outward, outward))
    if length < MIN_SLOPE:
        # Where both are parallel, any vector across the axis will do.
        outward = vectors.cross(axis, (0.0, 0.0, 1.0))
        if abs(axis[2]) > 0.9:
            outward = vectors.cross(axis, (1.0, 0.0, 0.0))
        length = math.sqrt(vectors.dot(outward, outward))
    for d in range(len(slopes)):
        slopes[d] = 0.0
    body = cones.bodies[k]
    while body > 0:
        if chain.kinds[body] == REVOLUTE:
            pose_rows = rotation_rows(poses[body])
            moved = vectors.cross(
                vectors.rotate(pose_rows, vectors.row_at(chain.axes[body], 0)), axis
            )
            slopes[chain.joint_indices[body]] += (
                chain.factors[body] * vectors.dot(moved, outward) / length
            )
        body = chain.parents[body]
    square = 0.0
    for d in range(len(slopes)):
        way = change * slopes[d]
        if (q[d] <= cones.lower[d] and way < 0.0) or (q[d] >= cones.upper[d] and way > 0.0):
            slopes[d] = 0.0
        square += slopes[d] * slopes[d]
    return square

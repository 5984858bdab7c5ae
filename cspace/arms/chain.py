"""Chain: where the bodies of an arm are at given joint positions, and how far a motion of the joints can carry them.

A body is what moves as one: the links that fixed joints hold together. Each body but the base hangs on another one by a
joint, whose axis runs through the body's own origin.

*How a body moves.* At a moment, each body turns and slides as the sum of what its joints do, and as seen from another
one, as the difference of both: a rigid motion, so that the velocity of a point p is ``drift + spin x p``. Over a time
h it leaves that by at most half the square of h times its largest acceleration. Of joints i and j, i nearer to the one
that looks, the second derivative of p is ``u_i x (u_j x (p - o_j))`` where both turn, with u the axes and o points on
them, ``u_i x u_j`` where j slides, and none where i slides. So the acceleration is at most the sum over the joints
between, at the rates r, of ``r_j (r_j + 2 sum of the turning r_i) D_j``, or ``2 r_j sum of the turning r_i`` where j
slides. D_j is the farthest that a point of the body can be from the origin of j: the lengths between the two origins in
all, and the reach of the body from its own. Nor does a point move farther than the sum of ``r_j D_j`` and, where j
slides, ``r_j`` (for chains: F. Schwarzer, M. Saha and J.-C. Latombe, "Adaptive dynamic collision checking for single
and multiple articulated robots in complex environments", 2005).

*Rounding.* A body's place is found by at most :data:`MOST_BODIES` products of a rotation and a translation. Each adds
less than 2^-48 of the arm's reach, so that a point is off by less than 2^-42 of it: less than a quarter of
:data:`cspace.exact.ROUNDING`. A pose as seen from another body is one more product.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.hulls import RelativeMotion
from cspace.arrays import Bools, Floats, Ints, Matrix, Row
from cspace.compiling import always_inline, kernel
from cspace.kernels import add_scaled, cross, dot, minus, rotate, row_at
from cspace.map.batches import own

MOST_BODIES: Final = 64

STILL, TURNS, SLIDES = 0, 1, 2
"""What a joint does."""


class Chain(NamedTuple):
    """Bodies, each after the one that it hangs on; the first is the base.

    Attributes
    ----------
    parents : ndarray of int64, shape (b,)
    frames : ndarray of float64, shape (b, 3, 4)
        Rotation and translation of a body's joint in the frame of its parent.
    axes : ndarray of float64, shape (b, 3)
        Unit vectors, in the body's frame.
    kinds : ndarray of int64, shape (b,)
        STILL, TURNS or SLIDES.
    numbers : ndarray of int64, shape (b,)
        Which number of a configuration moves it, as ``factors * q + offsets``.
    factors, offsets : ndarray of float64, shape (b,)
    between : ndarray of bool, shape (b, b, b)
        ``between[a, b]`` says which bodies' joints move a against b; the base stands for what does not move.
    lengths : ndarray of float64, shape (b, b)
        The most that the origins of two bodies can be apart.
    """

    parents: Ints
    frames: Floats
    axes: Floats
    kinds: Ints
    numbers: Ints
    factors: Floats
    offsets: Floats
    between: Bools
    lengths: Floats


@kernel
def place(chain: Chain, q0: Floats, q1: Floats, t: float, poses: Floats) -> None:
    """Write the poses and velocities of all bodies at a part ``t`` of a motion into ``poses``, shape (b, 3, 6).

    The columns are those of a body's rotation, its translation, its angular velocity, and the velocity of the point of
    it that is at the base's origin.
    """
    for b in range(len(chain.parents)):
        frame, out = chain.frames[b], poses[b]
        if b == 0:
            for i in range(3):
                for j in range(4):
                    out[i, j] = frame[i, j]
                out[i, 4] = out[i, 5] = 0.0
            continue
        number = chain.numbers[b]
        value = chain.factors[b] * (q0[number] + t * (q1[number] - q0[number])) + chain.offsets[b]
        x, y, z = chain.axes[b]
        sine, versine, along = 0.0, 0.0, value
        if chain.kinds[b] == TURNS:
            # 1 - cos loses digits where the angle is small.
            sine, versine, along = math.sin(value), 2.0 * math.sin(0.5 * value) ** 2, 0.0
        # Rodrigues' formula, row by row.
        turn = (
            (1.0 - versine * (y * y + z * z), versine * x * y - sine * z, versine * x * z + sine * y),
            (versine * x * y + sine * z, 1.0 - versine * (x * x + z * z), versine * y * z - sine * x),
            (versine * x * z - sine * y, versine * y * z + sine * x, 1.0 - versine * (x * x + y * y)),
        )
        parent = poses[chain.parents[b]]
        for i in range(3):
            a0 = parent[i, 0] * frame[0, 0] + parent[i, 1] * frame[1, 0] + parent[i, 2] * frame[2, 0]
            a1 = parent[i, 0] * frame[0, 1] + parent[i, 1] * frame[1, 1] + parent[i, 2] * frame[2, 1]
            a2 = parent[i, 0] * frame[0, 2] + parent[i, 1] * frame[1, 2] + parent[i, 2] * frame[2, 2]
            a3 = parent[i, 0] * frame[0, 3] + parent[i, 1] * frame[1, 3] + parent[i, 2] * frame[2, 3] + parent[i, 3]
            out[i, 0] = a0 * turn[0][0] + a1 * turn[1][0] + a2 * turn[2][0]
            out[i, 1] = a0 * turn[0][1] + a1 * turn[1][1] + a2 * turn[2][1]
            out[i, 2] = a0 * turn[0][2] + a1 * turn[1][2] + a2 * turn[2][2]
            out[i, 3] = a3 + along * (a0 * x + a1 * y + a2 * z)
            out[i, 4], out[i, 5] = parent[i, 4], parent[i, 5]
        rate = chain.factors[b] * (q1[number] - q0[number])
        u = rotate(rotation_of(out), (x, y, z))
        moment = cross(column(out, 3), u)
        for i in range(3):
            if chain.kinds[b] == TURNS:
                out[i, 4] += rate * u[i]
                out[i, 5] += rate * moment[i]
            elif chain.kinds[b] == SLIDES:
                out[i, 5] += rate * u[i]


@always_inline
def relative_pose(one: Floats, other: Floats) -> tuple[Matrix, Row]:
    """Return the rotation, by rows, and the translation of a placed body as seen from another placed body."""
    x, y, z = transposed = column(other, 0), column(other, 1), column(other, 2)
    away = minus(column(one, 3), column(other, 3))
    u, v, w = column(one, 0), column(one, 1), column(one, 2)
    matrix = (dot(x, u), dot(x, v), dot(x, w)), (dot(y, u), dot(y, v), dot(y, w)), (dot(z, u), dot(z, v), dot(z, w))
    return matrix, rotate(transposed, away)


@kernel
def flight_of(
    one: Floats, other: Floats, half: float, curvature_bound: float, most: float, least: float
) -> RelativeMotion:
    """Return how one of two placed bodies moves as seen from the other one."""
    spin, transposed = minus(column(one, 4), column(other, 4)), (column(other, 0), column(other, 1), column(other, 2))
    swept = cross(spin, column(other, 3))
    drift = add_scaled(swept, minus(column(one, 5), column(other, 5)), 1.0)
    matrix, place = relative_pose(one, other)
    return RelativeMotion(
        matrix, place, rotate(transposed, spin), rotate(transposed, drift), half, curvature_bound, most, least
    )


@always_inline
def rotation_of(pose: Floats) -> Matrix:
    """Return the rows of the rotation of a pose."""
    return row_at(pose[0], 0), row_at(pose[1], 0), row_at(pose[2], 0)


@always_inline
def column(pose: Floats, k: int) -> Row:
    """Return a column of an array with three rows."""
    return pose[0, k], pose[1, k], pose[2, k]


@kernel
def bounds_of(chain: Chain, a: int, b: int, rho: float, q0: Floats, q1: Floats) -> tuple[float, float, float]:
    """Along all of a motion: how far points of a body, up to ``rho`` from its origin, move as seen from another one.

    Besides half their largest acceleration, and how far all joints between turn.
    """
    far = bent = turned = 0.0
    between, above, lengths = chain.between[a, b], chain.between[b, 0], chain.lengths[a]
    count = len(chain.parents)
    for k in range(2 * count):
        # First those that move the other one, from it to what both hang on, then those of the body.
        j = count - 1 - k if k < count else k - count
        if not between[j] or above[j] != (k < count):
            continue
        rate = abs(chain.factors[j] * (q1[chain.numbers[j]] - q0[chain.numbers[j]]))
        if chain.kinds[j] == TURNS:
            reach = rate * (lengths[j] + rho)
            far, bent, turned = far + reach, bent + (0.5 * rate + turned) * reach, turned + rate
        elif chain.kinds[j] == SLIDES:
            far, bent = far + rate, bent + turned * rate
    return far, bent, turned


def place_bodies(chain: Chain, q: Floats) -> Floats:
    """Rotation and translation of every body at a configuration, shape (b, 3, 4)."""
    poses = np.empty((len(chain.parents), 3, 6))
    row = own(q)
    place(chain, row, row, 0.0, poses)
    return poses[:, :, :4]

"""Chain: where the bodies of an arm are at given joint positions, and how far a motion of the joints can carry them.

A body is what moves as one: the links that fixed joints hold together. Each body but the base hangs on another one by a
joint, whose axis runs through the body's own origin.

*How fast a point moves.* While joint j moves at the rate r_j, a point of body b moves no faster than the sum, over the
joints on its way to the base, of ``|r_j|`` times its distance from the axis of j, where j turns, or of ``|r_j|``, where
j slides. With a lever rho, the distance of the point from the origin of b, the former is at most ``d_j + rho``, where
d_j is that of the origin of b. Along a motion d_j is at most what it is in the middle plus what the joints between can
have changed, and never more than the lengths between the two origins in all. Seen from another body, only the joints on
the way between the two count (conservative advancement: B. Mirtich, 1996; for chains: F. Schwarzer, M. Saha and J.-C.
Latombe, "Adaptive dynamic collision checking for single and multiple articulated robots in complex environments",
2005).

*Rounding.* A body's place is found by at most :data:`MOST_BODIES` products of a rotation and a translation. Each adds
less than 2^-48 of the arm's reach, so that a point is off by less than 2^-42 of it: less than a quarter of
:data:`cspace.exact.ROUNDING`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit
from cspace.exact.triangles import Motion
from cspace.map.turning import Row

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

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


@inner(error_model="numpy")
def place(chain: Chain, q0: Floats, q1: Floats, t: float, poses: Floats) -> None:
    """Rotation and translation of every body, shape (b, 3, 4), at a part of the way between two configurations."""
    for b in range(len(chain.parents)):
        frame, out = chain.frames[b], poses[b]
        if b == 0:
            for i in range(3):
                for j in range(4):
                    out[i, j] = frame[i, j]
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


@inner(error_model="numpy")
def motion_of(chain: Chain, a: int, b: int, poses: Floats, rates: Floats, half: float, least: float) -> Motion:
    """How body ``a`` is placed and moves as seen from body ``b``, over a part of a motion that is ``half`` either way.

    ``rates`` says how far the joint of each body moves along all of the motion.
    """
    one, other, moving, lengths = poses[a], poses[b], chain.between[a, b], chain.lengths[a]
    x, y, z = one[0, 3], one[1, 3], one[2, 3]
    drift = 0.0
    for j in range(len(rates)):
        if moving[j]:
            drift += abs(rates[j]) * (lengths[j] if chain.kinds[j] == TURNS else 1.0)
    slide = angle = 0.0
    for j in range(len(rates)):
        rate = abs(rates[j])
        if not moving[j] or rate == 0.0:
            continue
        if chain.kinds[j] == SLIDES:
            slide += rate
            continue
        joint, axis = poses[j], chain.axes[j]
        ux = joint[0, 0] * axis[0] + joint[0, 1] * axis[1] + joint[0, 2] * axis[2]
        uy = joint[1, 0] * axis[0] + joint[1, 1] * axis[1] + joint[1, 2] * axis[2]
        uz = joint[2, 0] * axis[0] + joint[2, 1] * axis[1] + joint[2, 2] * axis[2]
        dx, dy, dz = x - joint[0, 3], y - joint[1, 3], z - joint[2, 3]
        cx, cy, cz = uy * dz - uz * dy, uz * dx - ux * dz, ux * dy - uy * dx
        now = math.sqrt(cx * cx + cy * cy + cz * cz) + least
        slide += rate * min(lengths[j], now + half * (drift - rate * lengths[j]))
        angle += rate
    dx, dy, dz = x - other[0, 3], y - other[1, 3], z - other[2, 3]
    a0, a1 = (other[0, 0], other[1, 0], other[2, 0]), (other[0, 1], other[1, 1], other[2, 1])
    a2 = other[0, 2], other[1, 2], other[2, 2]
    matrix = (_row(a0, one), _row(a1, one), _row(a2, one))
    place = (_along(a0, dx, dy, dz), _along(a1, dx, dy, dz), _along(a2, dx, dy, dz))
    return Motion(matrix, place, (0.0, 0.0, 0.0), angle, least, slide)


@inner(forceinline=True)
def _along(axis: Row, x: float, y: float, z: float) -> float:
    return axis[0] * x + axis[1] * y + axis[2] * z


@inner(forceinline=True)
def _row(axis: Row, pose: Floats) -> Row:
    """A row of the product of a transposed rotation, whose column is given, and another rotation."""
    return (
        _along(axis, pose[0, 0], pose[1, 0], pose[2, 0]),
        _along(axis, pose[0, 1], pose[1, 1], pose[2, 1]),
        _along(axis, pose[0, 2], pose[1, 2], pose[2, 2]),
    )


@jit
def place_bodies(chain: Chain, q: Floats) -> Floats:
    """Rotation and translation of every body at a configuration, shape (b, 3, 4)."""
    poses = np.empty((len(chain.parents), 3, 4))
    place(chain, q, q, 0.0, poses)
    return poses

"""Kinematics of an arm: the poses of its bodies, and bounds of their motions.

A body consists of links held together by fixed joints. Each body but the base hangs on its parent
by a joint, whose axis passes through the origin of the body.

*How a body moves.* At any moment, the motion of a body is the sum of the motions of its joints. As
seen from another body, it is the difference of both: a rigid motion, so that the velocity of a
point p is ``velocity + spin x p``. Over a time h, p deviates from that by at most half the square
of h times its largest acceleration. Let u be the axes, o points on them, and joint i nearer to the
observing body than joint j. The second derivative of p is ``u_i x (u_j x (p - o_j))`` if both are
revolute, ``u_i x u_j`` if j is prismatic, and zero if i is. So at the joint rates r, the
acceleration is at most the sum over the joints between of ``r_j (r_j + 2 sum of the revolute r_i)
D_j``, or ``2 r_j sum of the revolute r_i`` if j is prismatic. D_j bounds the distance of a point of
the body from the origin of j: the lengths between the two origins, plus the reach of the body. No
point moves farther than the sum of ``r_j D_j``, or ``r_j`` if j is prismatic (for chains: F.
Schwarzer, M. Saha and J.-C. Latombe, "Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments", 2005).

*Rounding.* The pose of a body is the product of at most :data:`MAX_BODIES` rotations and
translations. Each adds less than 2^-48 of the arm's reach, so that a point is off by less than
2^-42 of that reach: less than a quarter of :data:`DISTANCE_ROUNDING`. A pose as seen from another
body is one more product.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cspace._queries.batches import as_contiguous
from cspace._support import vectors
from cspace._support.arrays import Bools, Floats, Ints, Row
from cspace._support.compiling import internal, kernel
from cspace._support.records import keep

MAX_BODIES: Final = 64
"""Largest number of bodies; the bound of rounding assumes it."""


FIXED = 0
REVOLUTE = 1
PRISMATIC = 2
FLOATING = 3
"""Kinds of joints. A floating joint slides along its parent's axes, and turns about its own."""

POSITION = 3
SPIN = 4
VELOCITY = 5
"""Columns of a moving body's pose, after those of its rotation.

They hold the position, the angular velocity, and the velocity of the body's point at the origin of
the base.
"""


class Frame(NamedTuple):
    """The frame of a link or an attached object.

    Attributes
    ----------
    body : int
    pose : ndarray of float64, shape (4, 4)
        From the frame to the frame of its body.
    """

    body: int
    pose: Floats


class Chain(NamedTuple):
    """Bodies, each after its parent; the first is the base.

    Attributes
    ----------
    parents : ndarray of int64, shape (b,)
    frames : ndarray of float64, shape (b, 3, 4)
        Rotation and translation of a body's joint in the frame of its parent.
    axes : ndarray of float64, shape (b, 3)
        Unit vectors, in the body's frame.
    kinds : ndarray of int64, shape (b,)
        FIXED, REVOLUTE, PRISMATIC or FLOATING.
    joint_indices : ndarray of int64, shape (b,)
        Index of the configuration entry that moves the body, as ``factors * q + offsets``. A
        floating joint also slides, by the next three entries.
    factors, offsets : ndarray of float64, shape (b,)
    between : ndarray of bool, shape (b, b, b)
        ``between[a, b]`` marks the bodies whose joints move a against b; the base stands for the
        world.
    lengths : ndarray of float64, shape (b, b)
        Largest distance between the origins of two bodies.
    """

    parents: Ints
    frames: Floats
    axes: Floats
    kinds: Ints
    joint_indices: Ints
    factors: Floats
    offsets: Floats
    between: Bools
    lengths: Floats


def make_floating_chain() -> Chain:
    """Make a chain of one body that turns about z and slides, by an angle and a position."""
    chain = Chain(
        parents=np.zeros(2, dtype=np.int64),
        frames=np.tile(np.eye(4)[:3], (2, 1, 1)),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
        kinds=np.array([FIXED, FLOATING]),
        joint_indices=np.zeros(2, dtype=np.int64),
        factors=np.array([0.0, 1.0]),
        offsets=np.zeros(2),
        between=np.array([[[False, False], [False, True]], [[False, True], [False, False]]]),
        lengths=np.zeros((2, 2)),
    )
    return keep(chain)


@kernel
def forward_kinematics(chain: Chain, q0: Floats, q1: Floats, t: float, poses: Floats) -> None:
    """Compute the poses and velocities of all bodies during a motion of the joints.

    The motion leads from ``q0`` to ``q1``, shapes (dof,); ``t`` is its time, from 0 to 1. Writes to
    ``poses``, shape (b, 3, 6), whose columns are the rotation, then :data:`POSITION`, :data:`SPIN`
    and :data:`VELOCITY`.
    """
    # The base has a fixed pose, and never moves.
    for i in range(3):
        for j in range(4):
            poses[0, i, j] = chain.frames[0, i, j]
        poses[0, i, SPIN] = poses[0, i, VELOCITY] = 0.0
    # Each body follows its parent, whose pose and velocity have been computed.
    for b in range(1, len(chain.parents)):
        frame = chain.frames[b]
        parent = poses[chain.parents[b]]
        out = poses[b]
        index = chain.joint_indices[b]
        motion = q1[index] - q0[index]
        value = chain.factors[b] * (q0[index] + t * motion) + chain.offsets[b]
        rate = chain.factors[b] * motion
        joint_axis = vectors.row_at(chain.axes[b], 0)
        parent_rotation = rotation_rows(parent)
        joint_rotation = multiply(parent_rotation, rotation_columns(frame))
        angle = turning = 0.0
        slide = sliding = (0.0, 0.0, 0.0)
        if chain.kinds[b] == PRISMATIC or chain.kinds[b] == FIXED:
            direction = vectors.rotate(joint_rotation, joint_axis)
            slide = vectors.scale_vector(direction, value)
            sliding = vectors.scale_vector(direction, rate)
        else:
            angle = value
            turning = rate
        if chain.kinds[b] == FLOATING:
            begin = vectors.row_at(q0, index + 1)
            way = vectors.minus(vectors.row_at(q1, index + 1), begin)
            slide = vectors.rotate(parent_rotation, vectors.add_scaled(begin, way, t))
            sliding = vectors.rotate(parent_rotation, way)
        # Pose: first the frame of the joint on the parent, then the joint's own motion.
        rotation = joint_rotation
        if chain.kinds[b] != PRISMATIC:
            rotation = multiply(joint_rotation, turn_columns(joint_axis, angle))
        origin = vectors.apply_pose(
            parent_rotation, column_at(parent, POSITION), column_at(frame, POSITION)
        )
        position = vectors.add_scaled(origin, slide, 1.0)
        # The parent's velocity, plus the joint's turning about its axis, or sliding.
        axis = vectors.rotate(rotation, joint_axis)
        moment = vectors.cross(position, axis)
        for i in range(3):
            for j in range(3):
                out[i, j] = rotation[i][j]
            out[i, POSITION] = position[i]
            out[i, SPIN] = parent[i, SPIN] + turning * axis[i]
            out[i, VELOCITY] = parent[i, VELOCITY] + turning * moment[i] + sliding[i]


@internal
def turn_columns(axis: Row, angle: float) -> vectors.Matrix:
    """Return the columns of the rotation by an angle about a unit vector."""
    x, y, z = axis
    sine = math.sin(angle)
    # 1 - cos loses digits at small angles, so it is computed from the half angle.
    versine = 2.0 * math.sin(0.5 * angle) ** 2
    # Rodrigues' formula, column by column.
    return (
        (1.0 - versine * (y * y + z * z), versine * x * y + sine * z, versine * x * z - sine * y),
        (versine * x * y - sine * z, 1.0 - versine * (x * x + z * z), versine * y * z + sine * x),
        (versine * x * z + sine * y, versine * y * z - sine * x, 1.0 - versine * (x * x + y * y)),
    )


@internal
def relative_pose(pose: Floats, base_pose: Floats) -> tuple[vectors.Matrix, Row]:
    """Return the pose of a body as seen from another body.

    Both poses have shape (3, 6), as in :func:`forward_kinematics`. Returns the rows of the
    rotation, and the translation.
    """
    offset = vectors.minus(column_at(pose, POSITION), column_at(base_pose, POSITION))
    to_base = rotation_columns(base_pose)
    return multiply(to_base, rotation_columns(pose)), vectors.rotate(to_base, offset)


@internal
def multiply(rows: vectors.Matrix, columns: vectors.Matrix) -> vectors.Matrix:
    """Multiply a matrix, given by its rows, and a matrix, given by its columns.

    Returns the rows of the product.
    """
    u, v, w = rows
    # Entry j of a row is its scalar product with column j, as `rotate` computes it.
    return vectors.rotate(columns, u), vectors.rotate(columns, v), vectors.rotate(columns, w)


@internal
def rotation_rows(pose: Floats) -> vectors.Matrix:
    """Return the rows of the rotation of a pose, shape (3, 6)."""
    return vectors.row_at(pose[0], 0), vectors.row_at(pose[1], 0), vectors.row_at(pose[2], 0)


@internal
def column_at(pose: Floats, k: int) -> Row:
    """Return column k of a pose, shape (3, 6), such as :data:`POSITION`."""
    return pose[0, k], pose[1, k], pose[2, k]


@internal
def rotation_columns(pose: Floats) -> vectors.Matrix:
    """Return the columns of the rotation of a pose, which are the rows of its inverse."""
    return column_at(pose, 0), column_at(pose, 1), column_at(pose, 2)


@kernel
def motion_bounds(
    chain: Chain, a: int, b: int, radius: float, q0: Floats, q1: Floats
) -> tuple[float, float, float]:
    """Bound the motion of body a as seen from body b, from ``q0`` to ``q1``, shapes (dof,).

    The bounds hold for points up to ``radius`` from the origin of a. Returns the largest
    displacement, half the largest acceleration, and the sum of the rotations between them.
    """
    displacement = curvature = rotation = 0.0
    # Masks of bodies: the joints of the first move a against b, and the others carry b.
    between = chain.between[a, b]
    carries_b = chain.between[b, 0]
    lengths = chain.lengths[a]
    # The order matters for curvature: from b towards the base to the common ancestor, then to a.
    # The first steps count bodies down from b, the others count them up to a.
    for step in range(a + b):
        towards_base = step < b
        j = b - step if towards_base else step - b + 1
        if not between[j] or carries_b[j] != towards_base:
            continue
        index = chain.joint_indices[j]
        rate = abs(chain.factors[j] * (q1[index] - q0[index]))
        if chain.kinds[j] == FLOATING:
            way = vectors.minus(vectors.row_at(q1, index + 1), vectors.row_at(q0, index + 1))
            length = math.sqrt(vectors.dot(way, way))
            displacement += length
            curvature += rotation * length
        if chain.kinds[j] == REVOLUTE or chain.kinds[j] == FLOATING:
            travel = rate * (lengths[j] + radius)
            displacement += travel
            curvature += (0.5 * rate + rotation) * travel
            rotation += rate
        elif chain.kinds[j] == PRISMATIC:
            displacement += rate
            curvature += rotation * rate
    return displacement, curvature, rotation


def compute_poses(chain: Chain, q: Floats, bodies: Sequence[int] | slice = slice(None)) -> Floats:
    """Compute the poses of all bodies, or of some, at configurations.

    The configurations have shape (..., dof), the poses (..., b, 4, 4).
    """
    rows = as_contiguous(q.reshape(-1, q.shape[-1]))
    moving_poses = np.empty((len(rows), len(chain.parents), 3, 6))
    for row, row_poses in zip(rows, moving_poses, strict=True):
        forward_kinematics(chain, row, row, 0.0, row_poses)
    # Leave out the velocities, and add the last row of homogeneous matrices.
    upper_rows = moving_poses[:, bodies, :, : POSITION + 1]
    poses = np.tile(np.eye(4), (*upper_rows.shape[:2], 1, 1))
    poses[:, :, :3] = upper_rows
    return poses.reshape(*q.shape[:-1], *poses.shape[1:])

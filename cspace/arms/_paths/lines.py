"""Motions of an arm that bring a frame along straight lines, and the proof of how near they stay.

A line leads from pose to pose. While its parameter grows from 0 to 1, its target moves straight and
turns about one axis (K. Shoemake, "Animating rotation with quaternion curves", 1985). Inverse
kinematics gives the configuration at the next parameter, starting from the one before, so that a
redundant arm moves its joints little. A straight motion of the joints leads there, if it is proven
free and within the tolerance. Otherwise the step shrinks.

*Deviation.* Let a motion last from time 0 to 1, while the parameter grows at a constant rate. Cut
it into parts. Let e be the vector from the target to the frame's origin, halfway through a part
that lasts from h before to h after, and e' its derivative. The target does not accelerate, so e''
is the acceleration of the frame's origin, at most 2 c by
:func:`cspace._bodies.chain.motion_bounds`. By Taylor's theorem, ``|e| <= max |e +- h e'| + c
h^2`` during the part.

*Angle.* Let w and v be the angular velocities of the frame and of the target. The angle between
frame and target changes at most at the rate |w - v|. The axis of a joint turns with the joints
before it. So with the sum R of the joints' rates, ``|w'| <= R^2 / 2``, and v is constant. During
the part, the angle is at most the angle halfway plus ``h |w - v| + R^2 h^2 / 4``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms._checks import check_rigid
from cspace.arms._inverse import (
    TINY,
    Branch,
    PoseProblem,
    PoseScratch,
    descend,
    make_pose_problem,
    make_pose_scratch,
)
from cspace.arms._snapshots import Snapshot
from cspace.errors import InputError
from cspace.inside import (
    ADVANCE_FACTOR,
    DISTANCE_ROUNDING,
    METRES_PER_RADIAN,
    POSITION,
    REVOLUTE,
    SPIN,
    VELOCITY,
    ArmScene,
    Floats,
    Ints,
    are_free,
    check_finite,
    forward_kinematics,
    frozen,
    motion_bounds,
)

DEFAULT_LINE_TOLERANCE: Final[tuple[float, float]] = 1e-3, 1e-2
"""Distance in metres and angle in radians by which a motion may leave its line."""

MIN_LINE_PARTS = 8
MAX_LINE_PARTS = 64
"""Parts into which the proof cuts a motion, at first and at last."""

LINE_ROUNDING: Final = 4.0 * DISTANCE_ROUNDING
"""Rounding allowance of a deviation, relative to the largest coordinate, and of an angle, radians.
"""

MAX_LINE_COORDINATE: Final = 1e100
"""Largest coordinate of a pose, metres; squares of much larger ones overflow."""

REACHED, OUT_OF_REACH, JUMP, COLLISION = range(4)
"""Why a motion along a line ends: at the line's end, or because a step fails."""


class PoseLine(NamedTuple):
    """A straight line between poses, with parameters from 0 to 1.

    Attributes
    ----------
    origin, direction : ndarray of float64, shape (3,)
        First position, and vector to the last one, metres.
    rotation : ndarray of float64, shape (3, 3)
        First rotation.
    turn : ndarray of float64, shape (3,)
        Rotation vector from the first rotation to the last one, in the frame of the base, radians.
    """

    origin: Floats
    direction: Floats
    rotation: Floats
    turn: Floats

    @property
    def angle(self) -> float:
        """Rotation from first to last pose, radians."""
        return float(np.linalg.norm(self.turn))

    @property
    def length(self) -> float:
        """Metres, plus half a metre for each radian."""
        return float(np.linalg.norm(self.direction)) + METRES_PER_RADIAN * self.angle

    def poses(self, parameters: Floats) -> Floats:
        """Return the poses, shape (n, 4, 4), at parameters, shape (n,)."""
        from scipy.spatial.transform import Rotation

        along = parameters[:, np.newaxis]
        poses = np.tile(np.eye(4), (len(parameters), 1, 1))
        turns = Rotation.from_rotvec(along * self.turn)
        poses[:, :3, :3] = turns.as_matrix() @ self.rotation
        poses[:, :3, 3] = self.origin + along * self.direction
        return poses


class LineProblem(NamedTuple):
    """A line to follow.

    Attributes
    ----------
    line : Line
    pose : PoseProblem
        Its ``target`` is not used.
    scratch : PoseScratch
    joints : ndarray of int64, shape (k,)
        Indices of the branch's joints in configurations of the arm.
    tolerance : ndarray of float64, shape (2,)
        Metres and radians.
    max_coordinate : float
        Largest coordinate of the frame and of the line, metres.
    """

    line: PoseLine
    pose: PoseProblem
    scratch: PoseScratch
    joints: Ints
    tolerance: Floats
    max_coordinate: float


class LineStep(NamedTuple):
    """A motion along a part of a line.

    Attributes
    ----------
    outcome : int
        REACHED, OUT_OF_REACH or JUMP.
    last : ndarray of float64, shape (k,)
        The branch's configuration at the end.
    share : float
        Largest deviation or angle that was seen, as a share of the tolerance.
    bounds : ndarray of float64, shape (2,)
        Proven bounds of both.
    """

    outcome: int
    last: Floats
    share: float
    bounds: Floats


class Waypoint(NamedTuple):
    """A configuration on the way along lines.

    Attributes
    ----------
    joints : ndarray of float64, shape (dof,)
    parameter : float
        Number of the line, plus the place on it, from 0 to 1.
    bounds : ndarray of float64, shape (2,)
        Proven bounds of deviation, metres, and angle, radians, on the motion to it.
    """

    joints: Floats
    parameter: float
    bounds: Floats


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LineMotion:
    """A motion that brings a frame along straight lines.

    :meth:`cspace.ArmSpace.follow_line` makes it. Between two waypoints all joints move in step. All
    motions between the waypoints are proven free, and proven to stay near the line as ``deviation``
    and ``angle`` say. If the motion stops early, so do the waypoints: test ``certified``.

    Attributes
    ----------
    poses : ndarray of float64, shape (m + 1, 4, 4), read-only
        Corners of the line: the pose of the frame at the start, then the given ones.
    path : ndarray of float64, shape (n, dof), read-only
        Waypoints: configurations from the start on, radians and metres.
    parameters : ndarray of float64, shape (n,), read-only
        Target of each waypoint on the line: 1.25 is a quarter of the way from ``poses[1]`` to
        ``poses[2]``. Between two waypoints, the target moves evenly.
    certified : bool
        Whether the motion reaches the last pose, so that all of the line is proven.
    fraction : float
        Share of the line that the waypoints follow; a radian of rotation counts as half a metre.
    deviation : float
        Proven upper bound of the distance between the frame's origin and its target, in metres,
        along the whole motion. So the frame's origin is never farther from the line.
    angle : float
        Proven upper bound of the angle between the rotations of frame and target, in radians; at
        most pi.
    stopped_by : str
        Why the motion ends early: ``"collision"``, ``"limit"`` (a joint is at its limit),
        ``"reach"`` (no configuration near the last one reaches farther), or ``"jump"`` (the joints
        would leave the line on the way to the next configuration, as at a singularity); empty if
        certified.
    status : str
        The result in a line, with what touches, which joint is at its limit, and how near the pose
        came.
    """

    _frame: str
    poses: Floats
    path: Floats
    parameters: Floats
    certified: bool
    fraction: float
    deviation: float
    angle: float
    stopped_by: str
    status: str

    def __bool__(self) -> bool:
        """Return :attr:`certified`."""
        return self.certified

    def __repr__(self) -> str:
        """Return status, bounds and number of waypoints."""
        near = f"within {self.deviation:.2g} m and {self.angle:.2g} rad of the line"
        return f"LineMotion({self._frame}: {self.status}; {near}, {len(self.path)} waypoints)"


def check_corners(poses: ArrayLike) -> Floats:
    """Return a line's corners as poses (m, 4, 4).

    Raises InputError if one is no rigid motion or beyond MAX_LINE_COORDINATE.
    """
    matrices = check_finite(poses, "poses")
    are_poses = matrices.ndim in (2, 3) and matrices.shape[-2:] == (4, 4)
    if not are_poses or not len(matrices):
        raise InputError(
            "poses",
            f"has shape {matrices.shape}",
            "it must be one pose, shape (4, 4), or several",
        )
    rows = matrices.reshape(-1, 4, 4)
    corners = np.stack([check_rigid(pose, f"poses[{k}]") for k, pose in enumerate(rows)])
    largest = float(np.abs(corners[:, :3, 3]).max())
    if largest > MAX_LINE_COORDINATE:
        raise InputError(
            "poses",
            f"has the coordinate {largest:g} m",
            f"the limit is {MAX_LINE_COORDINATE:g} m",
        )
    return corners


def make_lines(corners: Floats) -> list[PoseLine]:
    """Return the lines between poses, shape (m + 1, 4, 4).

    Raises
    ------
    InputError
        If the rotation from a pose to the next is half a turn.
    """
    from scipy.spatial.transform import Rotation

    lines = []
    for number, (first, last) in enumerate(itertools.pairwise(corners)):
        first_rotation = first[:3, :3]
        first_position = first[:3, 3]
        turn = Rotation.from_matrix(last[:3, :3] @ first_rotation.T).as_rotvec()
        angle = float(np.linalg.norm(turn))
        # Radians; a rotation nearer to half a turn has no shorter way round.
        if angle > math.pi - 1e-6:
            # The first corner is no pose of the caller's.
            before = f"poses[{number - 1}]" if number else "the pose at q0"
            raise InputError(
                f"poses[{number}]",
                f"is half a turn from {before}",
                "both ways round are as short",
            )
        lines.append(PoseLine(first_position, last[:3, 3] - first_position, first_rotation, turn))
    return lines


def follow_lines(
    snapshot: Snapshot,
    start: Floats,
    frame: str,
    corners: Floats,
    lines: Sequence[PoseLine],
    tolerance: Floats,
) -> LineMotion:
    """Follow lines one after the other from a FREE configuration, shape (dof,).

    ``corners`` are the poses between which the lines lead, shape (m + 1, 4, 4). Raises InputError
    if rounding exceeds the tolerance.
    """
    arm = snapshot.arm
    branch, tool = arm._branch_to(frame)
    scratch = make_pose_scratch(branch)
    limits = arm.lower[branch.joints], arm.upper[branch.joints]
    pose = make_pose_problem(branch, tool, np.eye(4), tolerance, limits)
    # A tolerance below the rounding errors of positions and rotations proves nothing.
    reach = float(branch.chain.lengths[-1, 0]) + float(np.linalg.norm(tool[:3, 3]))
    max_coordinate = reach + float(np.abs(corners[:, :3, 3]).max())
    scale = np.array([max_coordinate, 1.0])
    rounding = LINE_ROUNDING * scale
    max_distance, max_angle = tolerance.tolist()
    if (tolerance < rounding).any():
        raise InputError(
            "tolerance",
            f"is {(max_distance, max_angle)}",
            f"rounding errors reach {rounding[0]:.2g} m and {rounding[1]:.2g} rad",
        )
    waypoints = [Waypoint(start, 0.0, DISTANCE_ROUNDING * scale)]
    fraction = 1.0
    stopped_by = ""
    status = "pose reached" if len(lines) == 1 else f"all {len(lines)} poses reached"
    for number, line in enumerate(lines):
        problem = LineProblem(line, pose, scratch, branch.joints, tolerance, max_coordinate)
        outcome, failed = _follow_line(snapshot.outer, problem, waypoints)
        if outcome == REACHED:
            continue
        # Say how far the motion came, and why it goes no further.
        last = waypoints[-1]
        fraction = _measure_fraction(lines, last.parameter)
        stopped_by, reason = _explain_stop(snapshot, branch, outcome, last.joints, failed)
        rest = number + 1 - last.parameter
        metres = rest * float(np.linalg.norm(line.direction))
        place = f"{metres:.3g} m and {rest * line.angle:.3g} rad before poses[{number}]"
        status = f"stopped after {100.0 * fraction:.3g} %, {place}: {reason}"
        break
    joints, parameters, bounds = (np.array(column) for column in zip(*waypoints, strict=True))
    deviation, angle = bounds.max(axis=0).tolist()
    return LineMotion(
        _frame=frame,
        poses=frozen(corners),
        path=frozen(joints),
        parameters=frozen(parameters),
        certified=not stopped_by,
        fraction=fraction,
        deviation=deviation,
        angle=min(angle, math.pi),
        stopped_by=stopped_by,
        status=status,
    )


def _measure_fraction(lines: Sequence[PoseLine], parameter: float) -> float:
    """Return the share of length before a parameter.

    Line k has the parameters from k to k + 1.
    """
    lengths = np.maximum([line.length for line in lines], np.finfo(float).tiny)
    share_of_each = np.clip(parameter - np.arange(len(lines)), 0.0, 1.0)
    fraction = float(share_of_each @ lengths / lengths.sum())
    # Only a motion that is certified has all of the line.
    return min(fraction, math.nextafter(1.0, 0.0))


def _follow_line(
    scene: ArmScene, problem: LineProblem, waypoints: list[Waypoint]
) -> tuple[int, Floats]:
    """Follow one line from the last waypoint, and add the new ones.

    Returns why they end, one of REACHED, OUT_OF_REACH, JUMP and COLLISION, and the configuration of
    the last step, shape (dof,), even if it failed.
    """
    begin = waypoints[-1].parameter
    now = 0.0
    step = 1.0
    outcome = REACHED
    failed = waypoints[-1].joints
    # Smallest step, as a fraction of a line between two poses; a motion that needs smaller steps
    # stops.
    min_line_step = 2.0**-14
    while now < 1.0:
        here = waypoints[-1].joints
        rest = 1.0 - now
        stop = 1.0
        if step < rest:
            # A step that would leave a small rest is at most half of the rest.
            stop = now + min(step, max(0.5 * rest, min_line_step))
        attempt = try_step(problem, here[problem.joints], now, stop)
        outcome = attempt.outcome
        length = stop - now
        ahead = here.copy()
        ahead[problem.joints] = attempt.last
        if outcome == REACHED and not are_free(scene, here[np.newaxis], ahead[np.newaxis])[0]:
            outcome = COLLISION
        # The deviation grows with the square of the step, so this ratio of the next step to this
        # one would just use up the tolerance.
        # Share of the step at which the deviation would just be the tolerance.
        best_ratio = 0.8 / math.sqrt(max(attempt.share, TINY))
        if outcome == REACHED:
            now = stop
            waypoints.append(Waypoint(ahead, begin + now, attempt.bounds))
            # Steps shrink only when one fails, so that their number stays bounded where the
            # deviation approaches the tolerance slowly.
            step = length * min(max(best_ratio, 1.0), 2.0)
            continue
        failed = ahead
        # Rounding may have made the shortest step longer.
        if length < 1.5 * min_line_step:
            break
        # Shrink the step; by half if its deviation says nothing about the cause.
        leaves_line = outcome == JUMP and attempt.share > 1.0
        ratio = min(max(best_ratio, 0.1), 0.7) if leaves_line else 0.5
        step = max(ratio * length, min_line_step)
    return outcome, failed


def _explain_stop(
    snapshot: Snapshot, branch: Branch, outcome: int, last: Floats, failed: Floats
) -> tuple[str, str]:
    """Return a stop's name for :attr:`LineMotion.stopped_by`, and its reason.

    ``outcome`` is OUT_OF_REACH, JUMP or COLLISION. ``last`` is the last waypoint, ``failed`` the
    configuration that could not be reached from it, shapes (dof,).
    """
    arm = snapshot.arm
    if outcome == COLLISION:
        link, other, *_ = snapshot.contact(snapshot.outer, failed[np.newaxis])
        return "collision", f"{link} is in collision with {other}, or nearly so"
    if outcome == JUMP:
        # Name the joint that moves farthest.
        travel = np.abs(failed - last)
        joint = int(travel.argmax())
        reason = "the motion to the next configuration, as at a singularity, leaves the line by "
        reason += f"more than the tolerance: it moves {arm.joints[joint]} by {travel[joint]:.3g} "
        return "jump", reason + arm.units[joint]
    # Joints of the branch that could not go on.
    at_limit = [
        f"{arm.joints[k]} is at its limit of {failed[k]:.6g} {arm.units[k]}"
        for k in branch.joints.tolist()
        if not arm.lower[k] < failed[k] < arm.upper[k]
    ]
    if at_limit:
        return "limit", ", ".join(at_limit)
    return "reach", "no configuration near the last one reaches farther"


def bound_deviation(
    problem: LineProblem, ends: tuple[Floats, Floats], start: float, stop: float, parts: int
) -> tuple[Floats, Floats]:
    """Bound a frame's deviation from a line.

    The motion leads between two configurations of the branch, shapes (k,), while the parameter
    grows from ``start`` to ``stop``. It is cut into ``parts``. Returns the proven bounds of
    deviation in metres and angle in radians, and the largest deviation and angle halfway through
    the parts, shapes (2,). Bounds are NaN if a value is not finite.
    """
    from scipy.spatial.transform import Rotation

    line = problem.line
    chain = problem.pose.chain
    tool = problem.pose.tool
    last_body = len(chain.parents) - 1
    # Pose, angular velocity and velocity of the frame halfway through each part.
    half = 0.5 / parts
    times = np.linspace(half, 1.0 - half, parts)
    poses = np.empty((parts, last_body + 1, 3, 6))
    for time, moment_poses in zip(times, poses, strict=True):
        forward_kinematics(chain, *ends, time, moment_poses)
    body_pose = poses[:, last_body]
    tip_pose = body_pose[:, :, : POSITION + 1] @ tool
    tip = tip_pose[:, :, POSITION]
    spin = body_pose[:, :, SPIN]
    velocity = np.cross(spin, tip) + body_pose[:, :, VELOCITY]
    # First order: the error at both ends of each part, if its rate were constant.
    rate = stop - start
    target = line.poses(start + times * rate)
    error = tip - target[:, :3, 3]
    error_rate = velocity - rate * line.direction
    errors_at_ends = [error + half * error_rate, error - half * error_rate]
    farthest = np.linalg.norm(errors_at_ends, axis=2).max()
    from_target = tip_pose[:, :, :3] @ target[:, :3, :3].swapaxes(1, 2)
    angles = Rotation.from_matrix(from_target).magnitude()
    angle_rates = np.linalg.norm(spin - rate * line.turn, axis=1)
    # The second order of both, from bounds on the whole motion; see the module for the formulas.
    radius = float(np.linalg.norm(tool[:3, 3]))
    _, curvature, rotation = motion_bounds(chain, last_body, 0, radius, *ends)
    bend = half**2 * curvature / ADVANCE_FACTOR
    twist = 0.25 * (half * rotation) ** 2 / ADVANCE_FACTOR
    # Rounding grows with the joint values; the base, which comes first, has none.
    largest = np.abs(ends).sum(axis=0)[chain.joint_indices]
    body_values = np.abs(chain.factors) * largest + np.abs(chain.offsets)
    rounding = LINE_ROUNDING * (1.0 + rotation)
    rounding += DISTANCE_ROUNDING * 2.0**-9 * body_values[1:].sum()
    deviation = farthest + bend + rounding * problem.max_coordinate
    angle = (angles + half * angle_rates / ADVANCE_FACTOR).max() + twist + rounding
    seen = np.array([np.linalg.norm(error, axis=1).max(), angles.max()])
    return np.array([deviation, angle]), seen


def try_step(problem: LineProblem, first: Floats, start: float, stop: float) -> LineStep:
    """Try to move the frame from parameter ``start`` to ``stop``.

    ``first``, shape (k,), is the branch's configuration at ``start``. Collisions are not tested.
    """
    chain = problem.pose.chain
    max_distance, max_angle = problem.tolerance
    last = first.copy()
    unproven = np.full(2, np.inf)
    # Inverse kinematics begins at the first configuration, so it finds the nearest branch.
    (target,) = problem.line.poses(np.array([stop]))
    distance, angle, _ = descend(problem.pose._replace(target=target), last, problem.scratch)
    if not (distance <= max_distance and angle <= max_angle):
        return LineStep(OUT_OF_REACH, last, np.inf, unproven)
    travel = np.abs(last - first)[chain.joint_indices]
    turns_less_than_half = travel[chain.kinds == REVOLUTE] < math.pi
    if not turns_less_than_half.all():
        return LineStep(JUMP, last, np.inf, unproven)
    parts = MIN_LINE_PARTS
    while True:
        bounds, seen = bound_deviation(problem, (first, last), start, stop, parts)
        share = float((seen / problem.tolerance).max())
        if (bounds <= problem.tolerance).all():
            return LineStep(REACHED, last, share, bounds)
        # Smaller parts tighten the bounds, but do not help if the motion itself leaves the line.
        parts *= MAX_LINE_PARTS // MIN_LINE_PARTS
        if share > 1.0 or parts > MAX_LINE_PARTS:
            return LineStep(JUMP, last, share, bounds)

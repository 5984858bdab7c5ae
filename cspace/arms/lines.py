"""Motions of an arm that bring a frame along straight lines, and the proof of how near they stay.

A line leads from pose to pose. While its parameter grows from 0 to 1, its target moves straight and
turns about one axis (K. Shoemake, "Animating rotation with quaternion curves", 1985). Inverse
kinematics gives the configuration at the next parameter, starting from the one before, so that a
redundant arm moves its joints little. A straight motion of the joints leads there, if it is proven
free and within the tolerance. Otherwise the step shrinks.

*Deviation.* Let a motion last from time 0 to 1, while the parameter grows at a constant rate. Cut
it into parts. Let e be the vector from the target to the frame's origin, halfway through a part
that lasts from h before to h after, and e' its derivative. The target does not accelerate, so e''
is the acceleration of the frame's origin, at most 2 c by :func:`cspace.arms.chain.motion_bounds`.
By Taylor's theorem, ``|e| <= max |e +- h e'| + c h^2`` during the part.

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

from cspace.arms.chain import (
    REVOLUTE,
    forward_kinematics,
    motion_bounds,
    position_of,
    spin_of,
    velocity_of,
)
from cspace.arms.inverse import (
    Branch,
    PoseProblem,
    PoseScratch,
    compare_pose,
    descend,
    make_pose_problem,
    make_pose_scratch,
)
from cspace.arms.proofs import Scene, are_free
from cspace.arms.snapshots import Snapshot
from cspace.arms.solids import check_rigid
from cspace.bodies import ADVANCE_FACTOR, DISTANCE_ROUNDING
from cspace.errors import InputError
from cspace.rotations.base import METRES_PER_RADIAN
from cspace.support.arrays import Floats, Ints, Row, frozen
from cspace.support.check import check_finite
from cspace.support.compiling import kernel
from cspace.support.vectors import add_scaled, cross, dot, minus, row_at

DEFAULT_LINE_TOLERANCE: Final = 1e-3, 1e-2
"""Distance in metres and angle in radians by which a motion may leave its line."""

MIN_LINE_STEP: Final = 2.0**-14
"""Smallest step, as a fraction of a line between two poses; a motion that needs smaller steps
stops."""

MIN_LINE_PARTS, MAX_LINE_PARTS = 8, 64
"""Parts into which the proof cuts a motion, at first and at last."""

STEP_SAFETY: Final = 0.8
"""Share of the step at which the deviation would just be the tolerance."""

HALF_TURN_SLACK: Final = 1e-6
"""Radians; a rotation nearer to half a turn has no shorter way round."""

LINE_ROUNDING: Final = 4.0 * DISTANCE_ROUNDING
"""Rounding allowance of a deviation, relative to the largest coordinate, and of an angle, radians.
"""

MAX_LINE_COORDINATE: Final = 1e100
"""Largest coordinate of a pose, metres; squares of much larger ones overflow."""

REACHED, OUT_OF_REACH, JUMP, COLLISION = range(4)
"""Why a motion along a line ends: at the line's end, or because a step fails."""


class Line(NamedTuple):
    """A straight line between poses, with parameters from 0 to 1.

    Attributes
    ----------
    origin, direction : ndarray of float64, shape (3,)
        First position, and vector to the last one, metres.
    rotation : ndarray of float64, shape (3, 3)
        First rotation.
    axis : ndarray of float64, shape (3,)
        Unit vector, in the frame of the base.
    angle : float
        Rotation from the first pose to the last one, radians.
    """

    origin: Floats
    direction: Floats
    rotation: Floats
    axis: Floats
    angle: float

    @property
    def length(self) -> float:
        """Metres, plus half a metre for each radian."""
        return float(np.linalg.norm(self.direction)) + METRES_PER_RADIAN * self.angle


class LineProblem(NamedTuple):
    """A line to follow, for kernels.

    Attributes
    ----------
    line : Line
    pose : PoseProblem
        Its ``target`` is overwritten by poses on the line.
    joints : ndarray of int64, shape (k,)
        Indices of the branch's joints in configurations of the arm.
    radius : float
        Distance of the frame's origin from that of its body, metres.
    max_coordinate : float
        Largest coordinate of the frame and of the line, metres.
    """

    line: Line
    pose: PoseProblem
    joints: Ints
    radius: float
    max_coordinate: float


class LineScratch(NamedTuple):
    """Scratch buffers of a motion along a line.

    Attributes
    ----------
    pose : PoseScratch
    first, last : ndarray of float64, shape (k,)
        Configurations of the branch at the ends of a step.
    error : ndarray of float64, shape (6,)
    """

    pose: PoseScratch
    first: Floats
    last: Floats
    error: Floats


class LineRows(NamedTuple):
    """Configurations along a line.

    Attributes
    ----------
    joints : ndarray of float64, shape (n, dof)
    parameters : ndarray of float64, shape (n,)
        Places on the line, from 0 to 1.
    bounds : ndarray of float64, shape (n, 2)
        Proven bounds of deviation, metres, and angle, radians, on the motion from the row before.
    """

    joints: Floats
    parameters: Floats
    bounds: Floats


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LineMotion:
    """A motion that brings a frame along straight lines.

    :meth:`cspace.ArmSpace.follow_line` makes it. Between two waypoints all joints move in step. All
    motions between the waypoints are proven free, and proven to stay near the line as ``deviation``
    and ``angle`` say. If the motion stops early, so do the waypoints: test ``certified``.

    Attributes
    ----------
    frame : str
    poses : ndarray of float64, shape (m + 1, 4, 4), read-only
        Corners of the line: the pose of the frame at the start, then the given ones.
    tolerance : tuple of float
        Metres and radians, as given.
    waypoints : ndarray of float64, shape (n, dof), read-only
        Configurations from the start on, radians and metres.
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

    frame: str
    poses: Floats
    tolerance: tuple[float, float]
    waypoints: Floats
    parameters: Floats
    certified: bool
    fraction: float
    deviation: float
    angle: float
    stopped_by: str
    status: str

    @property
    def path(self) -> Floats:
        """The waypoints, which pictures and the viewer draw as a path."""
        return self.waypoints

    def __repr__(self) -> str:
        """Return the status, the bounds and the number of waypoints."""
        near = f"within {self.deviation:.2g} m and {self.angle:.2g} rad of the line"
        return f"LineMotion({self.frame}: {self.status}; {near}, {len(self.waypoints)} waypoints)"


def check_corners(poses: ArrayLike) -> Floats:
    """Return poses, shape (m, 4, 4), from one pose or several.

    Raises InputError if one is no rigid motion or beyond MAX_LINE_COORDINATE.
    """
    given = check_finite(poses, "poses")
    if given.ndim not in (2, 3) or given.shape[-2:] != (4, 4) or not len(given):
        rule, hint = "it must be one pose, shape (4, 4), or several", "pass e.g. [first, second]"
        raise InputError("poses", f"has shape {given.shape}", rule, hint, value=poses)
    corners = np.stack(
        [check_rigid(pose, f"poses[{k}]") for k, pose in enumerate(given.reshape(-1, 4, 4))]
    )
    largest = float(np.abs(corners[:, :3, 3]).max())
    if largest > MAX_LINE_COORDINATE:
        problem, rule = (
            f"has the coordinate {largest:g} m",
            f"the limit is {MAX_LINE_COORDINATE:g} m",
        )
        raise InputError("poses", problem, rule, "check its unit", value=poses)
    return corners


def make_lines(corners: Floats) -> list[Line]:
    """Return the lines between poses, shape (m + 1, 4, 4).

    Raises
    ------
    InputError
        If the rotation from a pose to the next is half a turn.
    """
    from scipy.spatial.transform import Rotation

    lines = []
    for number, (first, last) in enumerate(itertools.pairwise(corners)):
        vector = Rotation.from_matrix(last[:3, :3] @ first[:3, :3].T).as_rotvec()
        angle = float(np.linalg.norm(vector))
        if angle > math.pi - HALF_TURN_SLACK:
            before = f"poses[{number - 1}]" if number else "the pose at q0"
            problem, rule = f"is half a turn from {before}", "both ways round are as short"
            raise InputError(
                f"poses[{number}]", problem, rule, "pass a pose between them", value=last
            )
        axis = vector / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
        lines.append(
            Line(first[:3, 3].copy(), last[:3, 3] - first[:3, 3], first[:3, :3].copy(), axis, angle)
        )
    return lines


def follow_lines(
    snapshot: Snapshot,
    start: Floats,
    frame: str,
    corners: Floats,
    lines: Sequence[Line],
    tolerance: Floats,
) -> LineMotion:
    """Follow lines one after the other from a FREE configuration, shape (dof,).

    ``corners`` are the poses between which the lines lead, shape (m + 1, 4, 4). Raises InputError
    if rounding exceeds the tolerance.
    """
    arm, scene = snapshot.arm, snapshot.outer
    branch, tool = arm.branch_to(frame)
    count = len(branch.joints)
    scratch = LineScratch(make_pose_scratch(branch), np.empty(count), np.empty(count), np.empty(6))
    limits = arm.lower[branch.joints], arm.upper[branch.joints]
    pose = make_pose_problem(branch, tool, np.eye(4), tolerance, limits)
    radius = float(np.linalg.norm(tool[:3, 3]))
    size = float(branch.chain.lengths[-1, 0]) + radius + float(np.abs(corners[:, :3, 3]).max())
    for given, rounding, unit in zip(
        tolerance, (LINE_ROUNDING * size, LINE_ROUNDING), ("m", "rad"), strict=True
    ):
        if given < rounding:
            rule = f"its proof allows for rounding errors of up to {rounding:.2g} {unit}"
            hint = "pass a larger tolerance" + ", or nearer poses" * (unit == "m")
            raise InputError(
                "tolerance", f"is {given:g} {unit}", rule, hint, value=tuple(tolerance.tolist())
            )
    found = [LineRows(start[np.newaxis], np.zeros(1), DISTANCE_ROUNDING * np.array([[size, 1.0]]))]
    outcome, failed = REACHED, start
    for number, line in enumerate(lines):
        problem = LineProblem(line, pose, branch.joints, radius, size)
        rows, outcome, failed = _follow_line(scene, problem, found[-1].joints[-1], scratch)
        found.append(rows._replace(parameters=number + rows.parameters))
        if outcome != REACHED:
            break
    joints, parameters, bounds = (np.concatenate(column) for column in zip(*found, strict=True))
    stopped_by, fraction = "", 1.0
    status = "pose reached" if len(lines) == 1 else f"all {len(lines)} poses reached"
    if outcome != REACHED:
        lengths, parameter = np.array([line.length for line in lines]), float(parameters[-1])
        weights = (
            lengths / lengths.sum() if lengths.any() else np.full(len(lines), 1.0 / len(lines))
        )
        fraction = float(np.clip(parameter - np.arange(len(lines)), 0.0, 1.0) @ weights)
        # Only a motion that is certified has all of the line.
        fraction = min(fraction, math.nextafter(1.0, 0.0))
        stopped_by, reason = _explain_stop(snapshot, branch, outcome, joints[-1], failed)
        number = min(int(parameter), len(lines) - 1)
        left, line = number + 1 - parameter, lines[number]
        ahead = (
            f"{left * np.linalg.norm(line.direction):.3g} m and {left * line.angle:.3g} rad before "
            f"poses[{number}]"
        )
        status = f"stopped after {100.0 * fraction:.3g} %, {ahead}: {reason}"
    deviation, angle = bounds.max(axis=0).tolist()
    return LineMotion(
        frame=frame,
        poses=frozen(corners),
        tolerance=(float(tolerance[0]), float(tolerance[1])),
        waypoints=frozen(joints),
        parameters=frozen(parameters),
        certified=outcome == REACHED,
        fraction=fraction,
        deviation=deviation,
        angle=min(angle, math.pi),
        stopped_by=stopped_by,
        status=status,
    )


def _follow_line(
    scene: Scene, problem: LineProblem, start: Floats, scratch: LineScratch
) -> tuple[LineRows, int, Floats]:
    """Follow one line.

    Return the new rows, why they end, and the configuration of the last step, even if it failed.
    """
    joints, parameters, bounds = [start], [0.0], [(0.0, 0.0)]
    step, outcome, failed = 1.0, REACHED, start
    while parameters[-1] < 1.0:
        # A step that leaves a small rest is cut in two halves or takes the rest too.
        now = parameters[-1]
        left = 1.0 - now
        stop = 1.0 if step >= left else now + min(step, max(0.5 * left, MIN_LINE_STEP))
        outcome, share, deviation, angle = try_step(problem, joints[-1], now, stop, scratch)
        taken, failed = stop - now, joints[-1].copy()
        failed[problem.joints] = scratch.last
        if (
            outcome == REACHED
            and not are_free(scene, joints[-1][np.newaxis], failed[np.newaxis])[0]
        ):
            outcome, share = COLLISION, 0.0
        if outcome == REACHED:
            joints.append(failed)
            parameters.append(stop)
            bounds.append((deviation, angle))
            # The deviation grows with the square of the step. Steps shrink only when one fails, so
            # that their number stays bounded where the deviation approaches the tolerance slowly.
            step = taken * min(max(STEP_SAFETY / math.sqrt(max(share, 1e-300)), 1.0), 2.0)
        elif taken < 1.5 * MIN_LINE_STEP:  # rounding may have made the shortest step longer
            break
        elif share > 1.0 and outcome == JUMP:
            step = max(taken * min(max(STEP_SAFETY / math.sqrt(share), 0.1), 0.7), MIN_LINE_STEP)
        else:
            step = max(0.5 * taken, MIN_LINE_STEP)
    rows = LineRows(np.array(joints), np.array(parameters), np.array(bounds))
    return LineRows(*(column[1:] for column in rows)), outcome, failed


def _explain_stop(
    snapshot: Snapshot, branch: Branch, outcome: int, last: Floats, failed: Floats
) -> tuple[str, str]:
    """Return the name and the reason of a stop.

    ``last`` is the last waypoint, ``failed`` the configuration that could not be reached from it,
    shapes (dof,).
    """
    arm = snapshot.arm
    if outcome == COLLISION:
        link, other, *_ = snapshot.contact(snapshot.outer, failed[np.newaxis])
        return "collision", f"{link} is in collision with {other}, or nearly so"
    if outcome == JUMP:
        moved = np.abs(failed - last)
        joint = int(moved.argmax())
        motion = f"{arm.joints[joint]} by {moved[joint]:.3g} {arm.units[joint]}"
        rule = f"leaves the line by more than the tolerance: it moves {motion}"
        return "jump", f"the motion to the next configuration, as at a singularity, {rule}"
    at_limit = [
        f"{arm.joints[k]} is at its limit of {failed[k]:.6g} {arm.units[k]}"
        for k in branch.joints.tolist()
        if not arm.lower[k] < failed[k] < arm.upper[k]
    ]
    if at_limit:
        return "limit", ", ".join(at_limit)
    return "reach", "no configuration near the last one reaches farther"


@kernel
def write_target(line: Line, parameter: float, target: Floats) -> None:
    """Write a line's pose at a parameter into ``target``."""
    value = parameter * line.angle
    sine, versine = math.sin(value), 2.0 * math.sin(0.5 * value) ** 2
    axis = row_at(line.axis, 0)
    for k in range(3):
        # Rodrigues' formula for each column of the first rotation.
        u = line.rotation[0, k], line.rotation[1, k], line.rotation[2, k]
        side = cross(axis, u)
        turned = add_scaled(add_scaled(u, side, sine), cross(axis, side), versine)
        for i in range(3):
            target[i, k] = turned[i]
        target[k, 3] = line.origin[k] + parameter * line.direction[k]


@kernel
def norm(u: Row) -> float:
    """Return the length of a vector."""
    return math.sqrt(dot(u, u))


@kernel
def bound_deviation(
    problem: LineProblem, start: float, stop: float, parts: int, scratch: LineScratch
) -> tuple[float, float, float, float]:
    """Bound a frame's deviation from a line on a motion.

    The motion leads from ``scratch.first`` to ``scratch.last``, the parameter from ``start`` to
    ``stop``. Returns the proven bounds of deviation and angle, and the largest deviation and angle
    halfway through the parts.
    """
    pose, line, q0, q1 = problem.pose, problem.line, scratch.first, scratch.last
    chain, poses, tip, target = pose.chain, scratch.pose.poses, scratch.pose.tip, pose.target
    last, rate = len(chain.parents) - 1, stop - start
    _, curvature, rotation = motion_bounds(chain, last, 0, problem.radius, q0, q1)
    half = 0.5 / parts
    bend = half * half * curvature / ADVANCE_FACTOR
    twist = 0.25 * half * half * rotation * rotation / ADVANCE_FACTOR
    direction, turning = row_at(line.direction, 0), row_at(line.axis, 0)
    deviation = angle = sampled = sampled_angle = 0.0
    for k in range(parts):
        t = (2 * k + 1) * half
        forward_kinematics(chain, q0, q1, t, poses)
        write_target(line, start + t * rate, target)
        apart, turned, _ = compare_pose(pose, scratch.pose, scratch.error)
        point, spin = position_of(tip), spin_of(poses[last])
        error = minus(point, position_of(target))
        velocity = add_scaled(cross(spin, point), velocity_of(poses[last]), 1.0)
        drift = add_scaled(velocity, direction, -rate)
        spin = add_scaled(spin, turning, -rate * line.angle)
        ends = max(norm(add_scaled(error, drift, half)), norm(add_scaled(error, drift, -half)))
        deviation = max(deviation, ends + bend)
        angle = max(angle, turned + half * norm(spin) / ADVANCE_FACTOR + twist)
        sampled, sampled_angle = max(sampled, apart), max(sampled_angle, turned)
    size = 0.0
    for b in range(1, last + 1):
        n = chain.joint_indices[b]
        size += abs(chain.factors[b]) * (abs(q0[n]) + abs(q1[n])) + abs(chain.offsets[b])
    rounding = LINE_ROUNDING * (1.0 + rotation) + DISTANCE_ROUNDING * 2.0**-9 * size
    # The comparison is False for NaN, which then remains.
    if deviation + angle < np.inf:
        return (
            deviation + rounding * problem.max_coordinate,
            angle + rounding,
            sampled,
            sampled_angle,
        )
    return np.nan, np.nan, sampled, sampled_angle


@kernel
def try_step(
    problem: LineProblem, q: Floats, start: float, stop: float, scratch: LineScratch
) -> tuple[int, float, float, float]:
    """Try to move the frame from a configuration at ``start`` to ``stop``.

    Returns REACHED or why it fails, the largest deviation or angle that was seen as a share of the
    tolerance, and the proven bounds of both.
    """
    pose, tolerance = problem.pose, problem.pose.tolerance
    for k in range(len(problem.joints)):
        scratch.first[k] = scratch.last[k] = q[problem.joints[k]]
    write_target(problem.line, stop, pose.target)
    distance, turned, _ = descend(pose, scratch.last, scratch.pose)
    if not (distance <= tolerance[0] and turned <= tolerance[1]):
        return OUT_OF_REACH, np.inf, np.inf, np.inf
    for b in range(1, len(pose.chain.parents)):
        k = pose.chain.joint_indices[b]
        turned = abs(scratch.last[k] - scratch.first[k])
        if pose.chain.kinds[b] == REVOLUTE and not turned < math.pi:
            return JUMP, np.inf, np.inf, np.inf
    parts, share, deviation, angle = MIN_LINE_PARTS, 0.0, np.inf, np.inf
    while True:
        deviation, angle, sampled, sampled_angle = bound_deviation(
            problem, start, stop, parts, scratch
        )
        share = max(sampled / tolerance[0], sampled_angle / tolerance[1])
        if deviation <= tolerance[0] and angle <= tolerance[1]:
            break
        # Smaller parts tighten the bounds, but do not help if the motion itself leaves the line.
        parts *= MAX_LINE_PARTS // MIN_LINE_PARTS
        if share > 1.0 or parts > MAX_LINE_PARTS:
            return JUMP, share, deviation, angle
    return REACHED, share, deviation, angle

"""Inverse kinematics: configurations of an arm that bring a frame to a pose.

Damped least squares from several starts. A step minimises ``|J s + e|^2 + damping |s|^2``, where
the rows of the error e and of its Jacobian J are the distance, divided by the arm's reach, and the
rotation vector. The damping follows the error (N. Yamashita and M. Fukushima, "On the rate of
convergence of the Levenberg-Marquardt method", 2001). Joints stop at their limits, and leave a step
that would push them further (D. P. Bertsekas, "Projected Newton methods for optimization problems
with simple constraints", 1982).
"""

# Libraries were considered (2026) and do not fit. pink and placo need pinocchio, mink needs MuJoCo,
# each with its own reading of the URDF, and they solve a quadratic program for each step, from one
# start. ikpy takes 7 to 50 ms a pose, by its own page. All leave restarts, joints that mimic
# others, and whole turns to the caller.

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace import Goal
from cspace.arms._checks import check_rigid
from cspace.errors import InputError
from cspace.inside import (
    POSITION,
    REVOLUTE,
    Bools,
    Chain,
    Floats,
    Ints,
    as_contiguous,
    check_real,
    check_text,
    column_at,
    forward_kinematics,
    frozen,
    internal,
    keep,
    kernel,
    rotation_rows,
    suggest_radians,
    vectors,
)

DEFAULT_TOLERANCE: Final[tuple[float, float]] = 1e-4, 1e-3
"""Distance in metres and angle in radians within which a pose counts as reached."""

POLISHED_SHARE: Final = 1e-3
"""Share of the tolerance at which a solution is good enough; the last steps converge quadratically.
"""

MAX_VAIN_STARTS: Final = 64
"""Starts in a row that find no further configuration, after which a search that found one ends."""

MAX_STARTS: Final = 256
"""Starts after which a pose counts as out of reach."""

MAX_GAP: Final = 1e-5
"""Largest part of a turn, radians, that the limits of a joint may lack if it counts as a circle."""

MIN_JOINT_DISTANCE: Final = 0.01
"""Largest difference of a joint between configurations that count as the same, radians or metres.
"""

FIRST_DAMPING: Final = 0.1
"""Damping of the first step, divided by the squared error."""

DAMPING_DECREASE: Final = 0.3
"""Factor of the damping after a step that lowers the error."""

DAMPING_INCREASE: Final = 5.0
"""Factor of the damping after a step that does not."""

MIN_DAMPING: Final = 1e-6
"""Smallest damping, divided by the squared error."""

DAMPING_FLOOR: Final = 1e-14
"""Added to every damping, so that a step is defined when the error vanishes."""

RIGHT_SIDE: Final = 6
"""Column of :attr:`PoseScratch.system` after the six of the matrix."""

MAX_REJECTED_STEPS: Final = 8
"""Steps in a row that do not lower the error, after which a start is abandoned."""

SLOW_DECREASE: Final = 0.8
"""Ratio of squared errors above which a step counts as slow."""

MAX_SLOW_STEPS: Final = 6
"""Slow steps in a row after which a start is abandoned, mostly near a local minimum."""

IGNORED_SHARE: Final = 0.99
"""Share of the tolerance that is no error to starts that are retried."""

MAX_STEPS: Final = 100
"""Steps after which a start is abandoned."""

TINY: Final = 1e-300
"""Smallest divisor, so that zero is never one."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseGoal(Goal):
    """A pose for an arm's frame, as a goal of :func:`planners.plan`.

    Attributes
    ----------
    frame : str
        One of :attr:`Arm.frames`, such as ``"tool0"``.
    pose : ndarray of float64, shape (4, 4)
        From the frame to that of the arm's base, metres, as :meth:`Arm.pose` returns it.
    tolerance : tuple of float
        Largest distance in metres, and largest angle in radians, from the pose. ``(1e-3,
        math.inf)`` asks for the position alone.

    Raises
    ------
    InputError
        If the frame is no string, the pose is no rigid motion, or the tolerance is not two numbers
        above zero; one may be infinite.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> pose = np.eye(4)
    >>> pose[:3, 3] = 0.4, 0.1, 0.5
    >>> goal = cspace.PoseGoal("tool0", pose, tolerance=(1e-3, 0.01))
    """

    frame: str
    pose: ArrayLike
    tolerance: tuple[float, float] = DEFAULT_TOLERANCE

    def __post_init__(self) -> None:
        """Check the fields, and replace pose and tolerance by floats."""
        check_text(self.frame, "frame")
        tolerance = check_pose_tolerance(self.tolerance)
        object.__setattr__(self, "pose", frozen(check_rigid(self.pose, "pose")))
        object.__setattr__(self, "tolerance", tuple(tolerance.tolist()))


def check_pose_tolerance(tolerance: tuple[float, float]) -> Floats:
    """Return the tolerance of a pose, shape (2,).

    Raise InputError unless both are above zero and one is finite.
    """
    pair = np.asarray(check_real(tolerance, "tolerance", ("metres", "radians")), dtype=np.float64)
    if pair.shape != (2,) or not (pair > 0.0).all() or np.isinf(pair).all():
        raise InputError(
            "tolerance",
            f"is {tolerance!r}",
            "it must be two numbers above zero, metres and radians, of which one may be infinite",
        )
    if math.pi < pair[1] < math.inf:
        rule = "an angle is at most pi radians, or infinite for any rotation"
        raise InputError("tolerance", f"is {tolerance!r}", rule, suggest_radians(pair[1]))
    return pair


class Branch(NamedTuple):
    """The chain of bodies from the base to one body.

    Attributes
    ----------
    chain : Chain
        Its ``joint_indices`` count the joints of the branch.
    joints : ndarray of int64, shape (k,)
        Indices of these joints in the configurations of the arm.
    """

    chain: Chain
    joints: Ints


class PoseProblem(NamedTuple):
    """A pose to reach, for kernels.

    Attributes
    ----------
    chain : Chain
        Of the branch.
    tool : ndarray of float64, shape (4, 4)
        From the frame to that of the last body.
    target : ndarray of float64, shape (4, 4)
    weights : ndarray of float64, shape (2,)
        Of the distance, 1 / m, and of the angle, 1 / rad; zero if it does not matter.
    ignored : ndarray of float64, shape (2,)
        Distance and angle that are no error.
    enough : ndarray of float64, shape (2,)
        Distance and angle at which a start is solved.
    tolerance : ndarray of float64, shape (2,)
    lower, upper : ndarray of float64, shape (k,)
        Limits of the joints.
    max_slow_steps : int
    """

    chain: Chain
    tool: Floats
    target: Floats
    weights: Floats
    ignored: Floats
    enough: Floats
    tolerance: Floats
    lower: Floats
    upper: Floats
    max_slow_steps: int


class PoseScratch(NamedTuple):
    """Scratch buffers of a search.

    Attributes
    ----------
    poses : ndarray of float64, shape (b, 3, 6)
    tip : ndarray of float64, shape (3, 4)
        Pose of the frame.
    errors : ndarray of float64, shape (2, 6)
        Error of the best configuration and of a trial: three rows of the distance, three of the
        rotation vector.
    jacobian : ndarray of float64, shape (6, k)
    system : ndarray of float64, shape (6, 7)
        Matrix and right side of a step.
    trial : ndarray of float64, shape (k,)
    """

    poses: Floats
    tip: Floats
    errors: Floats
    jacobian: Floats
    system: Floats
    trial: Floats


class PoseSolutions(NamedTuple):
    """Configurations of a branch for a pose.

    Attributes
    ----------
    joints : ndarray of float64, shape (n, k)
        Configurations that reach the pose, in the order of the search.
    nearest : ndarray of float64, shape (k,)
        The configuration with the smallest error.
    distance, angle : float
        Its distance and angle from the pose, metres and radians.
    """

    joints: Floats
    nearest: Floats
    distance: float
    angle: float


@internal
def compare_pose(
    problem: PoseProblem, scratch: PoseScratch, error: Floats
) -> tuple[float, float, float]:
    """Compare the frame's pose, at the body poses of ``scratch``, with the target.

    Writes the weighted error, shape (6,): the distance vector, then the rotation vector. Returns
    the distance in metres, the angle in radians, and the squared error.
    """
    place_tip(problem.tool, scratch)
    tip = scratch.tip
    target = problem.target
    offset = vectors.minus(column_at(tip, POSITION), column_at(target, POSITION))
    distance = math.sqrt(vectors.dot(offset, offset))
    # With R = tip target^T, half of R - R^T holds the axis times the sine of the angle.
    doubled_axis = (0.0, 0.0, 0.0)
    trace = 0.0
    for k in range(3):
        tip_axis = column_at(tip, k)
        target_axis = column_at(target, k)
        doubled_axis = vectors.add_scaled(doubled_axis, vectors.cross(target_axis, tip_axis), 1.0)
        trace += vectors.dot(tip_axis, target_axis)
    sine = 0.5 * math.sqrt(vectors.dot(doubled_axis, doubled_axis))
    angle = math.atan2(sine, 0.5 * (trace - 1.0))
    # The error is the way to the nearest pose at the ignored distance and angle.
    distance_error = problem.weights[0] * max(distance - problem.ignored[0], 0.0)
    angle_error = problem.weights[1] * max(angle - problem.ignored[1], 0.0)
    for i in range(3):
        error[i] = distance_error / max(distance, TINY) * offset[i]
        error[3 + i] = angle_error / max(2.0 * sine, TINY) * doubled_axis[i]
    return distance, angle, distance_error * distance_error + angle_error * angle_error


@internal
def place_tip(tool: Floats, scratch: PoseScratch) -> None:
    """Write the frame's pose to ``scratch.tip``, from its pose ``tool`` on the last body.

    It is the product of the body's pose and ``tool``, shape (4, 4).
    """
    body = scratch.poses[len(scratch.poses) - 1]
    tip = scratch.tip
    for i in range(3):
        for j in range(4):
            tip[i, j] = body[i, 0] * tool[0, j] + body[i, 1] * tool[1, j] + body[i, 2] * tool[2, j]
        tip[i, POSITION] += body[i, POSITION]


@internal
def fill_jacobian(problem: PoseProblem, scratch: PoseScratch) -> None:
    """Write the derivative of the weighted error by the joints, at the poses of ``scratch``.

    ``scratch.jacobian`` has shape (6, k): three rows of the distance, three of the rotation vector.
    """
    chain = problem.chain
    jacobian = scratch.jacobian
    weights = problem.weights
    for i in range(6):
        for k in range(jacobian.shape[1]):
            jacobian[i, k] = 0.0
    # A joint may move several bodies, because others mimic it, so that its columns add up.
    tip = column_at(scratch.tip, POSITION)
    for b in range(1, len(chain.parents)):
        joint = chain.joint_indices[b]
        factor = chain.factors[b]
        pose = scratch.poses[b]
        axis = vectors.rotate(rotation_rows(pose), vectors.row_at(chain.axes[b], 0))
        velocity = axis
        if chain.kinds[b] == REVOLUTE:
            # A turn about an axis moves the tip across its lever arm.
            velocity = vectors.cross(axis, vectors.minus(tip, column_at(pose, POSITION)))
            for i in range(3):
                jacobian[3 + i, joint] += factor * weights[1] * axis[i]
        for i in range(3):
            jacobian[i, joint] += factor * weights[0] * velocity[i]


@internal
def take_step(problem: PoseProblem, q: Floats, scratch: PoseScratch, damping: float) -> None:
    """Take a damped least squares step from ``q``, shape (k,), to ``scratch.trial``.

    With Jacobian J and error e, the step is ``-J^T (J J^T + damping)^-1 e``.
    """
    jacobian = scratch.jacobian
    system = scratch.system
    error = scratch.errors[0]
    # The system has 6 rows, with the matrix in the first 6 columns and the right side in the last.
    for i in range(6):
        for j in range(6):
            system[i, j] = damping if i == j else 0.0
        system[i, RIGHT_SIDE] = error[i]
    for k in range(len(q)):
        slope = 0.0
        for i in range(6):
            slope += jacobian[i, k] * error[i]
        # A joint at a limit that the step would push further does not take part.
        stuck_below = q[k] <= problem.lower[k] and slope > 0.0
        stuck_above = q[k] >= problem.upper[k] and slope < 0.0
        if stuck_below or stuck_above:
            for i in range(6):
                jacobian[i, k] = 0.0
        for i in range(6):
            for j in range(6):
                system[i, j] += jacobian[i, k] * jacobian[j, k]
    solve_system(system)
    for k in range(len(q)):
        step = 0.0
        for i in range(6):
            step -= jacobian[i, k] * system[i, RIGHT_SIDE]
        scratch.trial[k] = min(max(q[k] + step, problem.lower[k]), problem.upper[k])


@internal
def solve_system(system: Floats) -> None:
    """Solve a symmetric, positive definite system, shape (6, 7), in place.

    Its last column becomes the solution. Such a system needs no pivots (Gauss and Jordan).
    """
    for j in range(6):
        # Scale row j so that its diagonal entry is 1, then clear column j of all other rows.
        pivot = max(system[j, j], TINY)
        for k in range(j, 7):
            system[j, k] /= pivot
        for i in range(6):
            ratio = system[i, j] if i != j else 0.0
            for k in range(j, 7):
                system[i, k] -= ratio * system[j, k]


@kernel
def descend(problem: PoseProblem, q: Floats, scratch: PoseScratch) -> tuple[float, float, float]:
    """Move a configuration ``q``, shape (k,), in place to a pose or a local minimum.

    Returns the distance from the pose in metres, the angle in radians, and the squared error.
    """
    forward_kinematics(problem.chain, q, q, 0.0, scratch.poses)
    distance, angle, cost = compare_pose(problem, scratch, scratch.errors[0])
    factor = FIRST_DAMPING
    slow_steps = 0
    for _ in range(MAX_STEPS):
        if distance <= problem.enough[0] and angle <= problem.enough[1]:
            break
        fill_jacobian(problem, scratch)
        # Try steps with more and more damping until one lowers the error.
        is_lower = False
        new_distance = distance
        new_angle = angle
        new_cost = cost
        for _ in range(MAX_REJECTED_STEPS):
            take_step(problem, q, scratch, factor * cost + DAMPING_FLOOR)
            forward_kinematics(problem.chain, scratch.trial, scratch.trial, 0.0, scratch.poses)
            new_distance, new_angle, new_cost = compare_pose(problem, scratch, scratch.errors[1])
            is_lower = new_cost < cost
            if is_lower:
                break
            factor *= DAMPING_INCREASE
        if not is_lower:
            break
        # Accept the trial, and trust the next step more.
        slow_steps = slow_steps + 1 if new_cost > SLOW_DECREASE * cost else 0
        distance = new_distance
        angle = new_angle
        cost = new_cost
        for k in range(len(q)):
            q[k] = scratch.trial[k]
        for i in range(6):
            scratch.errors[0, i] = scratch.errors[1, i]
        factor = max(factor * DAMPING_DECREASE, MIN_DAMPING)
        if slow_steps >= problem.max_slow_steps:
            break
    return distance, angle, cost


def branch_to(chain: Chain, body: int) -> Branch:
    """Return the branch of a chain from the base to a body, with its own numbers of joints."""
    towards_base = [body]
    while towards_base[-1] > 0:
        parent = chain.parents[towards_base[-1]]
        towards_base.append(int(parent))
    bodies = np.flip(towards_base)
    # Number the joints that move these bodies from 0; the base, which comes first, has none.
    joints, joint_indices = np.unique(chain.joint_indices[bodies[1:]], return_inverse=True)
    branch_chain = Chain(
        # Each body hangs on the one before; the base is its own parent.
        parents=np.maximum(np.arange(len(bodies)) - 1, 0),
        frames=chain.frames[bodies],
        axes=chain.axes[bodies],
        kinds=chain.kinds[bodies],
        joint_indices=np.concatenate([[0], joint_indices]),
        factors=chain.factors[bodies],
        offsets=chain.offsets[bodies],
        between=chain.between[np.ix_(bodies, bodies, bodies)],
        lengths=chain.lengths[np.ix_(bodies, bodies)],
    )
    return Branch(keep(branch_chain), joints)


def make_pose_problem(
    branch: Branch,
    tool: Floats,
    target: Floats,
    tolerance: Floats,
    limits: tuple[Floats, Floats],
    enough_share: float = POLISHED_SHARE,
) -> PoseProblem:
    """Describe for kernels how a branch shall bring a frame to a pose; see :class:`PoseProblem`.

    ``tool`` and ``target`` have shape (4, 4), ``tolerance`` is (metres, radians), and ``limits``
    are the lower and upper ones, shapes (k,). A start is solved at ``enough_share`` of the
    tolerance. If that is all of it, starts are followed to the end.
    """
    chain = branch.chain
    # Divide distances by the arm's reach, to weigh them like angles.
    link_lengths = np.linalg.norm(chain.frames[1:, :, POSITION], axis=1)
    reach = link_lengths.sum() + np.linalg.norm(tool[:3, 3])
    # Smallest length, in metres, by which distances are divided; an arm without links has none.
    distance_weight = 1.0 / max(reach, 1e-6)
    is_patient = enough_share == 1.0
    return PoseProblem(
        chain,
        as_contiguous(tool),
        target,
        weights=np.where(np.isfinite(tolerance), (distance_weight, 1.0), 0.0),
        ignored=IGNORED_SHARE * tolerance if is_patient else np.zeros(2),
        enough=enough_share * tolerance,
        tolerance=tolerance,
        lower=as_contiguous(limits[0]),
        upper=as_contiguous(limits[1]),
        max_slow_steps=MAX_STEPS if is_patient else MAX_SLOW_STEPS,
    )


def make_pose_scratch(branch: Branch) -> PoseScratch:
    """Allocate scratch buffers for a branch."""
    count = len(branch.joints)
    return PoseScratch(
        poses=np.empty((len(branch.chain.parents), 3, 6)),
        tip=np.empty((3, 4)),
        errors=np.empty((2, 6)),
        jacobian=np.empty((6, count)),
        system=np.empty((6, 7)),
        trial=np.empty(count),
    )


def solve_pose(
    branch: Branch,
    tool: Floats,
    goal: PoseGoal,
    limits: tuple[Floats, Floats],
    ranges: tuple[Floats, Floats],
    near: Floats,
    whole_turns: Bools,
    max_solutions: int,
    rng: np.random.Generator,
) -> PoseSolutions:
    """Find configurations of a branch, shape (k,) each, that bring a frame to a pose.

    ``tool``, shape (4, 4), is the frame's pose on the last body. The first start is ``near``; the
    others are uniform within ``ranges``. Solutions are moved towards ``near`` by whole turns of the
    joints in the mask ``whole_turns``, within ``limits``. The search ends after
    :data:`MAX_VAIN_STARTS` starts in a row that find nothing new.
    """
    tolerance = np.array(goal.tolerance)
    target = np.array(goal.pose)
    scratch = make_pose_scratch(branch)
    lower, upper = limits
    # A joint that can make a whole turn stops nowhere; otherwise it would get stuck at its limits.
    circles = whole_turns & (upper - lower > math.tau - MAX_GAP)
    open_limits = np.where(circles, -np.inf, lower), np.where(circles, np.inf, upper)
    quick = make_pose_problem(branch, tool, target, tolerance, open_limits)
    # The pose itself may be out of reach and poses within the tolerance not; and some valleys are
    # long.
    patient = make_pose_problem(branch, tool, target, tolerance, open_limits, 1.0)
    within_limits = make_pose_problem(branch, tool, target, tolerance, limits, 1.0)
    solutions: list[Floats] = []

    def try_start(problem: PoseProblem, q: Floats) -> tuple[float, float, float]:
        """Move a start in place, and add its end to ``solutions`` if the end is new."""
        distance, angle, cost = descend(problem, q, scratch)
        if distance <= tolerance[0] and angle <= tolerance[1]:
            turned = _turn_towards(near, q, limits, whole_turns)
            # It was moved onto a limit if it lay in the gap of a circle.
            last_distance, last_angle, _ = descend(within_limits, turned, scratch)
            is_solved = last_distance <= tolerance[0] and last_angle <= tolerance[1]
            is_new = all(np.abs(turned - other).max() > MIN_JOINT_DISTANCE for other in solutions)
            if is_solved and is_new:
                solutions.append(turned)
        return distance, angle, cost

    starts = np.vstack([near, rng.uniform(*ranges, (MAX_STARTS - 1, len(near)))])
    errors = []
    vain_starts = 0
    for q in starts:
        known = len(solutions)
        errors.append(try_start(quick, q))
        is_vain = known > 0 and len(solutions) == known
        vain_starts = vain_starts + 1 if is_vain else 0
        if len(solutions) == max_solutions or vain_starts == MAX_VAIN_STARTS:
            break
    best_first = np.argsort([cost for *_, cost in errors], kind="stable")
    nearest = _turn_towards(near, starts[best_first[0]], limits, whole_turns)
    distance, angle, _ = errors[best_first[0]]
    # Before giving up, follow the best starts to the end.
    if not solutions:
        # Starts with the smallest errors that are followed to the end if none reaches the pose.
        for row in best_first[:32]:
            if len(solutions) < max_solutions:
                try_start(patient, starts[row])
    return PoseSolutions(np.array(solutions).reshape(-1, len(near)), nearest, distance, angle)


def _turn_towards(
    near: Floats, q: Floats, limits: tuple[Floats, Floats], whole_turns: Bools
) -> Floats:
    """Move a configuration, shape (k,), by whole turns towards another, within the limits."""
    lower, upper = limits
    fewest = np.ceil((lower - q) / math.tau)
    most = np.floor((upper - q) / math.tau)
    turns = np.clip(np.rint((near - q) / math.tau), fewest, most)
    turned = np.where(whole_turns, q + math.tau * turns, q)
    return np.asarray(turned.clip(lower, upper))

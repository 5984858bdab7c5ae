"""Motions of arms along straight lines, against forward kinematics and collisions of other
libraries."""

import math
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from cspace import Arm, ArmSpace, ConfigurationError, InputError, Robot, build_arm_space
from cspace.arms import LineMotion, PosedShape
from cspace.arms.inverse import make_pose_problem, make_pose_scratch
from cspace.arms.lines import LineProblem, bound_deviation, make_lines
from tests.helpers.refusals import refusals
from tests.helpers.solids import ArmOracle, box
from tests.helpers.urdfs import (
    joint,
    link,
    planar_with_tip,
    pose_at,
    pose_of,
    posed_box,
    random_chain,
    write_urdf,
)

pytest.importorskip("yourdfpy")

Poses = Callable[[np.ndarray], np.ndarray]
"""Poses of a frame, shape (..., 4, 4), at configurations, shape (..., dof), computed without the
library."""

ROUNDING = 1e-11
"""Metres and radians by which two libraries may differ."""


FREE_ROTATION = (1e-3, math.inf)
"""A tolerance that asks for positions alone."""


def without_collisions(arm: Arm) -> ArmSpace:
    """Build the space of an arm whose links may touch."""
    names = [link.name for link in arm.links]
    return build_arm_space(
        {}, arm, allowed_collisions=[(a, b) for a in names for b in names if a < b]
    )


def poses_by_urdf(path: Path, arm: Arm, frame: str = "tool0") -> Poses:
    """Return the forward kinematics of a frame."""
    return lambda q: pose_of(path, frame, dict(zip(arm.joints, np.moveaxis(q, -1, 0), strict=True)))


def sample_motion(waypoints: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Return configurations on the motions between waypoints, shape (n - 1, samples, dof), and
    their times."""
    times = np.linspace(0.0, 1.0, samples)
    steps = np.diff(waypoints, axis=0)
    return waypoints[:-1, None] + times[:, None] * steps[:, None], times


def sample_deviation(motion: LineMotion, poses: Poses, samples: int = 33) -> tuple[float, float]:
    """Return the largest distance and angle between the frame and its target, at samples."""
    if len(motion.waypoints) < 2:
        return 0.0, 0.0
    q, times = sample_motion(motion.waypoints, samples)
    parameters = motion.parameters[:-1, None] + times * np.diff(motion.parameters)[:, None]
    number = np.minimum(motion.parameters[:-1].astype(int), len(motion.poses) - 2)
    share = (parameters - number[:, None]).clip(0.0, 1.0)
    first, last = motion.poses[number], motion.poses[number + 1]
    reached = poses(q)
    targets = first[:, None, :3, 3] + share[..., None] * (last - first)[:, None, :3, 3]
    turns = [
        Slerp([0.0, 1.0], Rotation.from_matrix([a[:3, :3], b[:3, :3]]))(row)
        for a, b, row in zip(first, last, share, strict=True)
    ]
    angles = [
        (Rotation.from_matrix(row[:, :3, :3]).inv() * turn).magnitude()
        for row, turn in zip(reached, turns, strict=True)
    ]
    distances = np.linalg.norm(reached[..., :3, 3] - targets, axis=-1)
    return float(distances.max()), float(np.max(angles))


def check_motion(motion: LineMotion, arm: Arm, poses: Poses) -> None:
    """Assert that a motion keeps its promises, except those on collisions."""
    deviation, angle = sample_deviation(motion, poses)
    assert deviation <= motion.deviation + ROUNDING and angle <= motion.angle + ROUNDING
    assert motion.deviation <= motion.tolerance[0] and motion.angle <= max(
        motion.tolerance[1], math.pi
    )
    assert motion.angle <= motion.tolerance[1]
    assert ((motion.waypoints >= arm.lower) & (motion.waypoints <= arm.upper)).all()
    parameters, end = motion.parameters, len(motion.poses) - 1
    assert parameters[0] == 0.0 and (np.diff(parameters) > 0.0).all()
    assert set(range(int(parameters[-1]) + 1)) <= set(
        parameters.tolist()
    )  # each pose that it reaches is a waypoint
    assert (
        motion.certified
        == (parameters[-1] == end)
        == (motion.fraction == 1.0)
        == (not motion.stopped_by)
    )
    assert 0.0 <= motion.fraction <= 1.0
    if not motion.certified:
        assert motion.stopped_by in {"collision", "limit", "reach", "jump"}
        assert f"before poses[{int(parameters[-1])}]" in motion.status


def draw_line(
    folder: Path, seed: int, count: int
) -> tuple[ArmSpace, ArmOracle, Poses, np.ndarray, np.ndarray]:
    """Draw a chain among boxes, a free start, and one to three poses."""
    rng = np.random.default_rng(seed)
    path = random_chain(folder, seed, count)
    arm = Arm.from_urdf(path)
    blocks = {
        f"block {n}": (
            rng.uniform(0.05, 0.2, 3),
            pose_at(*rng.uniform(-0.8, 0.8, 3), rng.normal(size=3)),
        )
        for n in range(3)
    }
    shapes = {
        name: PosedShape(Robot.box(size).shape, pose) for name, (size, pose) in blocks.items()
    }
    try:
        space = build_arm_space(shapes, arm)
        start = space.sample_free(rng=rng)
    except ConfigurationError:  # a box is where no joint moves
        assume(False)
    still = {name: [box(size, pose[:3, 3], pose[:3, :3])] for name, (size, pose) in blocks.items()}
    poses = poses_by_urdf(path, arm)
    if rng.random() < 0.5:  # poses that the chain reaches
        steps = rng.normal(scale=rng.choice([0.1, 0.4]), size=(rng.integers(1, 4), arm.dof))
        corners = poses((start + np.cumsum(steps, axis=0)).clip(arm.lower, arm.upper))
    else:
        corners = np.array([poses(start)] * rng.integers(1, 3))
        corners[:, :3, 3] += rng.normal(scale=0.15, size=(len(corners), 3))
        if rng.random() < 0.5:
            corners[:, :3, :3] = (
                Rotation.from_rotvec(rng.normal(scale=0.3, size=3)).as_matrix() @ corners[:, :3, :3]
            )
    return space, ArmOracle(path, arm, still, arm.allowed_collisions), poses, start, corners


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(2, 7),
    tolerance=st.sampled_from(
        [(1e-3, 1e-2), (1e-4, 1e-3), (0.03, 0.3), (1e-3, math.inf), (math.inf, 1e-2)]
    ),
)
def test_motions_stay_within_their_bounds_and_free(
    seed: int, count: int, tolerance: tuple[float, float]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        space, oracle, poses, start, corners = draw_line(Path(folder), seed, count)
        motion = space.follow_line(start, "tool0", corners, tolerance=tolerance)
        np.testing.assert_array_equal(motion.waypoints[0], start)
        np.testing.assert_allclose(motion.poses, [poses(start), *corners], atol=1e-6)
        check_motion(motion, space.arm, poses)
        if len(motion.waypoints) > 1:
            q, _ = sample_motion(motion.waypoints, 8)
            rows = q.reshape(-1, space.arm.dof)
            assert all(oracle.apart(row) > 0.0 for row in rows[:: 1 + len(rows) // 150])
            assert np.asarray(space.certify_path(motion.waypoints)).all()


def test_lines_that_the_arm_can_follow_are_followed(tmp_path: Path) -> None:
    """Follow lines of chains with six or seven joints, none of which is obstructed."""
    followed = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        path = random_chain(tmp_path, seed, 6 + seed % 2)
        arm = Arm.from_urdf(path)
        start = 0.5 * (np.maximum(arm.lower, -3.0) + np.minimum(arm.upper, 3.0)) + rng.normal(
            scale=0.2, size=arm.dof
        )
        space = without_collisions(arm)
        start = start.clip(arm.lower, arm.upper)
        corner = arm.pose(start, "tool0")
        corner[:3, 3] += 0.03 * rng.normal(size=3)
        motion = space.follow_line(start, "tool0", corner, tolerance=FREE_ROTATION)
        check_motion(motion, arm, poses_by_urdf(path, arm))
        followed.append(motion.certified)
    assert sum(followed) >= 36


def bound_line(
    arm: Arm, ends: np.ndarray, waypoints: np.ndarray, parameters: np.ndarray, parts: int
) -> np.ndarray:
    """Return the bounds of deviation and angle on a motion, and the largest values halfway through
    its parts."""
    (line,) = make_lines(ends)
    branch, tool = arm.branch_to("tool0")
    pose = make_pose_problem(branch, tool, np.eye(4), np.ones(2), (arm.lower, arm.upper))
    scratch = make_pose_scratch(branch)
    problem = LineProblem(line, pose, scratch, branch.joints, np.ones(2), 10.0)
    return np.concatenate(
        bound_deviation(problem, (waypoints[0], waypoints[1]), *parameters.tolist(), parts)
    )


@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 7),
    size=st.sampled_from([1e-3, 0.05, 0.5, 3.0]),
    parts=st.sampled_from([1, 2, 8, 64]),
)
def test_bounds_hold_for_any_motion_and_line(
    seed: int, count: int, size: float, parts: int
) -> None:
    """The bounds need no inverse kinematics: they hold far from the line, too."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = random_chain(Path(folder), seed, count)
        arm = Arm.from_urdf(path)
        poses, ranges = poses_by_urdf(path, arm), arm.ranges()
        q0 = rng.uniform(*ranges)
        q1 = (q0 + size * rng.normal(size=arm.dof)).clip(*ranges)
        ends = poses(np.array([q0, (q0 + size * rng.normal(size=arm.dof)).clip(*ranges)]))
        assume(Rotation.from_matrix(ends[1, :3, :3] @ ends[0, :3, :3].T).magnitude() < 3.1)
        waypoints, parameters = np.array([q0, q1]), np.sort(rng.uniform(size=2))
        bounds = bound_line(arm, ends, waypoints, parameters, parts)
        motion = LineMotion(
            "tool0", ends, (1.0, 1.0), waypoints, parameters, False, 0.0, *bounds[:2], "", ""
        )
        deviation, angle = sample_deviation(motion, poses, 129)
        assert deviation <= bounds[0] + ROUNDING and min(angle, math.pi) <= bounds[1] + ROUNDING
        assert (
            bounds[2] <= deviation + ROUNDING + size / 4
            and bounds[2] <= bounds[0]
            and bounds[3] <= bounds[1]
        )
        if parts == 64 and size <= 0.5:  # close enough to be of use
            assert bounds[0] <= deviation + 0.01 * size and bounds[1] <= angle + 0.1 * size


@given(
    seed=st.integers(0, 2**32 - 1), count=st.integers(1, 7), size=st.sampled_from([0.01, 0.1, 0.4])
)
def test_bounds_hold_for_lines_tangent_to_the_motion(seed: int, count: int, size: float) -> None:
    """Halfway, frame and target coincide and move alike, so that only the bounds of accelerations
    are left."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = random_chain(Path(folder), seed, count)
        arm = Arm.from_urdf(path)
        poses = poses_by_urdf(path, arm)
        center, step = rng.uniform(*arm.ranges()), size * rng.uniform(-1.0, 1.0, arm.dof)
        before, middle, after = poses(center + 1e-5 * step * np.array([[-1.0], [0.0], [1.0]]))
        velocity = (after - before)[:3, 3] / 2e-5
        spin = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec() / 2e-5
        assume(np.linalg.norm(spin) < 3.1)
        ends = np.array([middle, middle])
        for end, time in zip(ends, (-0.5, 0.5), strict=True):
            end[:3, 3] += time * velocity
            end[:3, :3] = Rotation.from_rotvec(time * spin).as_matrix() @ end[:3, :3]
        waypoints = center + step * np.array([[-0.5], [0.5]])
        bounds = bound_line(arm, ends, waypoints, np.array([0.0, 1.0]), 1)
        motion = LineMotion(
            "tool0", ends, (1.0, 1.0), waypoints, np.arange(2.0), False, 0.0, *bounds[:2], "", ""
        )
        deviation, angle = sample_deviation(motion, poses)
        # Differences give the velocities up to 1e-9.
        assert deviation <= bounds[0] + 1e-8 and angle <= bounds[1] + 1e-8


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name, frame", [("panda", "panda_hand"), ("ur5", "tool0")])
def test_real_arms_stay_near_lines_by_pinocchio(data: Path, name: str, frame: str) -> None:
    pin = pytest.importorskip("pinocchio")
    urdf = data / "arms" / name / f"{name}.urdf"
    model, arm = pin.buildModelFromUrdf(str(urdf), mimic=True), Arm.from_urdf(urdf)
    state, number = model.createData(), model.getFrameId(frame)
    indices = [model.joints[model.getJointId(each)].idx_q for each in arm.joints]

    def pose_by_pinocchio(q: np.ndarray) -> np.ndarray:
        theirs = pin.neutral(model)
        theirs[indices] = q
        pin.framesForwardKinematics(model, state, theirs)
        return np.array(state.oMf[number].homogeneous)

    def poses(q: np.ndarray) -> np.ndarray:
        return np.array([pose_by_pinocchio(row) for row in q.reshape(-1, arm.dof)]).reshape(
            *q.shape[:-1], 4, 4
        )

    ball = PosedShape(Robot.ball(0.1).shape, pose_at(0.3, -0.6, 0.2))
    space = build_arm_space({"ball": ball}, arm)
    reasons, ratios = [], []
    for start in space.sample_free(12, np.random.default_rng(3)):
        corner = pose_by_pinocchio(start)
        corners = np.array([corner, corner, corner])
        corners[0, 2, 3] += (
            0.1  # up, then to the side while it turns, then 0.3 m at a constant rotation
        )
        corners[1, :3, 3] += 0.1, 0.05, 0.1
        corners[1:, :3, :3] = Rotation.from_euler("z", 0.3).as_matrix() @ corner[:3, :3]
        corners[2, :3, 3] += 0.1, 0.35, 0.1
        motion = space.follow_line(start, frame, corners)
        check_motion(motion, arm, poses)
        assert np.asarray(space.certify_path(motion.waypoints)).all()
        reasons.append(motion.stopped_by)
        if motion.certified:
            ratios.append(motion.deviation / sample_deviation(motion, poses)[0])
            last = motion.waypoints[motion.parameters >= 2.0]
            turns = (
                Rotation.from_matrix(poses(last)[:, :3, :3])
                * Rotation.from_matrix(corners[2, :3, :3]).inv()
            )
            assert (turns.magnitude() <= motion.angle + ROUNDING).all()
    assert reasons.count("") >= 2 and len(set(reasons)) >= 2
    assert max(ratios) < 2.0  # the bound is not far above the truth


def polar(folder: Path, **shapes: PosedShape) -> ArmSpace:
    """Build the space of a bar that turns about the origin and slides out by up to 1 m, with the
    frame hand."""
    path = write_urdf(
        folder,
        link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.5))),
        link("arm"),
        link("hand", ((0.02, 0.02, 0.02), (0, 0, 0))),
        joint("turn", "foot", "arm"),
        joint("slide", "arm", "hand", axis=(1, 0, 0), kind="prismatic", limits=(0.0, 1.0)),
    )
    return build_arm_space(shapes, Arm.from_urdf(path))


def test_a_bar_follows_a_line_beside_its_axis(tmp_path: Path) -> None:
    space = polar(tmp_path)
    motion = space.follow_line(
        (-1.0, 0.5 / math.cos(1.0)), "hand", pose_at(0.5, 0.5), tolerance=FREE_ROTATION
    )
    assert motion.certified and motion.status == "pose reached"
    np.testing.assert_allclose(motion.waypoints[-1], (math.pi / 4, math.sqrt(0.5)), atol=1e-3)
    assert motion.deviation <= 1e-3 and motion.angle > 0.7  # the hand turns with the bar
    x = motion.waypoints[:, 1] * np.cos(motion.waypoints[:, 0])
    np.testing.assert_allclose(x, 0.5, atol=1e-3)
    fine = space.follow_line(
        (-1.0, 0.5 / math.cos(1.0)), "hand", pose_at(0.5, 0.5), tolerance=(1e-5, math.inf)
    )
    assert fine.certified and len(fine.waypoints) > 5 * len(motion.waypoints)


def test_stops_are_explained(tmp_path: Path) -> None:
    bar = PosedShape(Robot.box((0.1, 0.1, 0.1)).shape, pose_at(0.5, 0.3))
    collision = polar(tmp_path, block=bar).follow_line(
        (0.0, 0.5), "hand", pose_at(0.5, 0.5), tolerance=FREE_ROTATION
    )
    assert (collision.certified, collision.stopped_by) == (False, "collision")
    assert collision.fraction == pytest.approx((0.3 - 0.05 - 0.01 * math.cos(0.5)) / 0.5, abs=0.02)
    assert "hand is in collision with block, or nearly so" in collision.status
    limit = polar(tmp_path).follow_line(
        (0.0, 0.5), "hand", [pose_at(0.5, 0.2), pose_at(1.5, 0.2)], tolerance=(1e-3, 7.0)
    )
    assert limit.stopped_by == "limit" and "slide is at its limit of 1 m" in limit.status
    assert limit.fraction == pytest.approx((0.2 + math.sqrt(0.96) - 0.5) / 1.2, abs=2e-3)
    assert "m and 0 rad before poses[1]" in limit.status
    # Beside the axis, where the bar would have to turn by half a turn within a hair's breadth.
    jump = polar(tmp_path).follow_line(
        (0.0, 0.5), "hand", [pose_at(0.5, 1e-4), pose_at(-0.5, 1e-4)], tolerance=(1e-6, 7.0)
    )
    assert (
        jump.stopped_by == "jump"
        and "as at a singularity" in jump.status
        and "it moves turn by" in jump.status
    )
    arm = planar_with_tip(tmp_path)
    stretched = build_arm_space({}, arm).follow_line(
        (0.5, 0.5), "tip", pose_at(4, 1), tolerance=FREE_ROTATION
    )
    assert (
        stretched.stopped_by == "reach"
        and "no configuration near the last one reaches farther" in stretched.status
    )
    tip = np.array(arm.pose(stretched.waypoints[-1], "tip"))[:2, 3]
    assert np.linalg.norm(tip) == pytest.approx(2.0, abs=2e-3)


@given(
    seed=st.integers(0, 2**32 - 1),
    thickness=st.sampled_from([0.002, 0.05]),
)
def test_a_gantry_stops_where_it_hits_the_first_box(seed: int, thickness: float) -> None:
    """Straight motions of the joints are straight lines, so that a step may be as long as the line."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = write_urdf(
            Path(folder),
            link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.5))),
            link("cart"),
            link("hand", ((0.02, 0.02, 0.02), (0, 0, 0))),
            joint("x", "foot", "cart", axis=(1, 0, 0), kind="prismatic", limits=(-1, 1)),
            joint("y", "cart", "hand", axis=(0, 1, 0), kind="prismatic", limits=(-1, 1)),
        )
        arm = Arm.from_urdf(path)
    centers, sides = (
        rng.uniform(-0.6, 0.6, (3, 2)),
        rng.permuted([[thickness, 0.3, 0.1]] * 3, axis=1),
    )
    start, goal = rng.uniform(-0.9, 0.9, (2, 2))
    boxes = {
        f"box {k}": posed_box(side, *center)
        for k, (side, center) in enumerate(zip(sides, centers, strict=True))
    }
    space = build_arm_space(boxes, arm)
    assume(space.is_free(start))
    motion = space.follow_line(start, "hand", pose_at(*goal))
    # The line enters a box, grown by half a hand, where it has crossed the nearer side along both
    # axes.
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = (centers + 0.5 * np.array([[[-1]], [[1]]]) * (sides[:, :2] + 0.02) - start) / (
            goal - start
        )
    enters, leaves = crossings.min(axis=0).max(axis=1), crossings.max(axis=0).min(axis=1)
    hits = enters[(enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)]
    assert motion.certified == (not len(hits)) and motion.stopped_by == (
        "collision" if len(hits) else ""
    )
    assert motion.fraction == pytest.approx(hits.min(initial=1.0), abs=2e-4)


def test_poses_equal_to_the_start_are_reached_at_once(tmp_path: Path) -> None:
    space = polar(tmp_path)
    here = space.arm.pose((0.3, 0.4), "hand")
    motion = space.follow_line((0.3, 0.4), "hand", [here, here])
    assert motion.certified and motion.fraction == 1.0
    np.testing.assert_array_equal(motion.waypoints, [(0.3, 0.4)] * 3)
    np.testing.assert_array_equal(motion.parameters, (0.0, 1.0, 2.0))
    assert 0.0 < motion.deviation < 1e-10


@pytest.fixture(scope="module")
def open_polar(tmp_path_factory: pytest.TempPathFactory) -> ArmSpace:
    """Build the polar arm without obstacles."""
    return polar(tmp_path_factory.mktemp("polar"))


def poses_of_polar(q: np.ndarray) -> np.ndarray:
    """Compute the poses of the hand by hand, shape (..., 4, 4)."""
    poses = np.zeros((*q.shape[:-1], 4, 4))
    poses[..., :3, :3] = Rotation.from_rotvec(q[..., :1] * [0.0, 0.0, 1.0]).as_matrix()
    poses[..., 0, 3], poses[..., 1, 3] = (
        q[..., 1] * np.cos(q[..., 0]),
        q[..., 1] * np.sin(q[..., 0]),
    )
    poses[..., 3, 3] = 1.0
    return poses


sizes = st.sampled_from(
    [0.0, 1e-320, 1e-15, 1e-9, 0.1, 1e8, 1e9, 1e80, 1e99, 1e154, 1e160, 1e300, math.inf]
)
"""Metres and radians from rounding errors to overflow."""


@example(steps=[(0.0, 0.0)], tolerance=(1e-15, 1e-15))
@example(steps=[(0.0, 0.0), (0.0, 0.0)], tolerance=(4.2e-12, 4.2e-12))
@example(steps=[(1e300, 0.0)], tolerance=(1e-3, 1e-2))
@example(steps=[(1e300, 0.0), (-1e300, 0.0)], tolerance=(math.inf, 7.0))
@example(steps=[(0.1, 0.0), (1e-320, 1e-320)], tolerance=(1e-3, 7.0))
@given(
    steps=st.lists(st.tuples(sizes, sizes | st.floats(-1.0, 1.0)), min_size=1, max_size=3),
    tolerance=st.tuples(sizes | st.floats(1e-13, 1e-9), sizes | st.floats(1e-13, 1e-9)),
)
@settings(max_examples=300)
def test_extreme_lines_are_refused_or_followed_in_part(
    open_polar: ArmSpace, steps: list[tuple[float, float]], tolerance: tuple[float, float]
) -> None:
    here = open_polar.arm.pose((0.3, 0.4), "hand")
    corners = np.array([here] * len(steps))
    with np.errstate(all="ignore"):
        corners[:, :2, 3] += np.cumsum(steps, axis=0)
    try:
        motion = open_polar.follow_line((0.3, 0.4), "hand", corners, tolerance=tolerance)
    except InputError as error:
        size = 1.0 + float(np.abs(corners[:, :3, 3]).max())
        assert error.argument in {"tolerance", "poses"} or error.argument.startswith("poses[")
        assert not size < 1e100 or min(tolerance) < 1e-11 * size or np.isinf(tolerance).all()
        return
    check_motion(motion, open_polar.arm, poses_of_polar)
    assert "nan" not in motion.status and "inf" not in motion.status


def test_joints_that_do_not_move_the_frame_stay(tmp_path: Path) -> None:
    path = write_urdf(
        tmp_path,
        link("a", ((0.05, 0.05, 0.05), (0, 0, -0.5))),
        *(link(name, ((0.02, 0.02, 0.02), (0, 0, 0))) for name in "bcd"),
        joint("x", "a", "b", axis=(1, 0, 0), kind="prismatic", limits=(-1, 1)),
        joint("beside", "a", "d", at=(0, 0, 2), limits=(-1, 1)),
        joint("y", "b", "c", axis=(0, 1, 0), kind="prismatic", limits=(-1, 1)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    q = space.arm.configuration({"beside": 0.7})
    motion = space.follow_line(q, "c", pose_at(0.5, 0.5))
    assert motion.certified
    beside = space.axes.index("beside")
    assert (motion.waypoints[:, beside] == 0.7).all()


def test_a_start_beyond_a_limit_moves_onto_it(tmp_path: Path) -> None:
    space = polar(tmp_path)
    motion = space.follow_line((0.0, 1.0 + 5e-6), "hand", pose_at(0.5, 0.0))
    assert motion.certified and motion.waypoints[0, 1] == 1.0
    np.testing.assert_allclose(motion.poses[0], pose_at(1.0, 0.0), atol=1e-12)


def test_motions_are_read_only_and_can_be_pickled(tmp_path: Path) -> None:
    motion = polar(tmp_path).follow_line((0.0, 0.5), "hand", pose_at(0.7, 0.0))
    copied = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(copied.waypoints, motion.waypoints)
    assert repr(copied) == repr(motion)
    assert repr(motion).startswith("LineMotion(hand: pose reached; within ")
    for array in (motion.poses, motion.waypoints, motion.parameters):
        with pytest.raises(ValueError):
            array[0] = 0.0


@refusals(
    "options, message",
    ({"frame": "tool9"}, "frame is 'tool9'; there are foot, arm, hand"),
    ({"frame": "foot"}, "frame is 'foot'; no joint of the arm moves it"),
    (
        {"poses": np.eye(3)},
        r"poses has shape \(3, 3\); it must be one pose, shape \(4, 4\), or several",
    ),
    ({"poses": np.empty((0, 4, 4))}, r"poses has shape \(0, 4, 4\); it must be one pose"),
    ({"poses": [np.eye(4), 2 * np.eye(4)]}, r"poses\[1\] has shape.*it must be a rigid motion"),
    ({"poses": np.full((4, 4), np.nan)}, r"poses\[0, 0\] is nan"),
    (
        {"poses": pose_at(1, 0, 0, (0, 0, math.pi))},
        r"poses\[0\] is half a turn from the pose at q0; both ways",
    ),
    (
        {"poses": [np.eye(4), pose_at(0, 0, 0, (math.pi, 0, 0))]},
        r"poses\[1\] is half a turn from poses\[0\]",
    ),
    ({"tolerance": 1e-3}, "tolerance is 0.001; it must be two numbers above zero"),
    ({"tolerance": (0.0, 1.0)}, r"tolerance is \(0.0, 1.0\); it must be two numbers above zero"),
    (
        {"tolerance": (1e-15, 1.0)},
        r"tolerance is \(1e-15, 1.0\); rounding errors reach .* m and 4e-12 rad; pass a larger",
    ),
    (
        {"tolerance": (1.0, 1e-15)},
        r"tolerance is \(1.0, 1e-15\); rounding errors reach .* 4e-12 rad",
    ),
    (
        {"poses": pose_at(1e10, 0)},
        r"tolerance is \(0.001, .*\); rounding errors reach 0.04 m and .*, or nearer poses",
    ),
    (
        {"poses": [np.eye(4), pose_at(1e300, 0)]},
        r"poses has the coordinate 1e\+300 m; the limit is 1e\+100 m",
    ),
    ({"q0": (0.0,)}, r"q0 has shape \(1,\)"),
    ({"q0": np.zeros((2, 2))}, r"q0 has shape \(2, 2\); it must be one configuration"),
    ({"q0": (0.0, 2.0)}, "q0 has slide at 2; its limits are 0 and 1"),
    ({"q0": (0.0, 0.8)}, r"q0 \(0, 0.8\) is not proven free: hand is in collision with block"),
)
def test_follow_line_rejects_invalid_arguments(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    space = polar(tmp_path, block=PosedShape(Robot.box((0.1, 0.1, 0.1)).shape, pose_at(0.8, 0.0)))
    arguments = {"q0": (0.0, 0.5), "frame": "hand", "poses": np.eye(4), **options}
    with pytest.raises(InputError, match=message):
        space.follow_line(**arguments)

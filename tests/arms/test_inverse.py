"""Inverse kinematics of arms, against forward kinematics of other libraries."""

import math
import pickle
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Arm, ConfigurationError, InputError, PoseGoal
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import (
    joint,
    link,
    planar,
    planar_with_tip,
    pose_at,
    pose_of,
    poses_apart,
    random_chain,
    two_arms,
    write_urdf,
)

pytest.importorskip("yourdfpy")

BOX = ((0.05, 0.05, 0.05), (0, 0, 0))


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 8))
def test_solutions_reach_the_pose_within_tolerance_and_limits(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = random_chain(Path(folder), seed, count)
        arm = Arm.from_urdf(path)
        q, near = rng.uniform(*arm.ranges(), (2, arm.dof))
        pose, tolerance = (
            pose_of(path, "tool0", dict(zip(arm.joints, q, strict=True))),
            (1e-3, 1e-2),
        )
        # The pose is reached from q itself; from elsewhere nearly always.
        for solutions in (
            arm.inverse("tool0", pose, tolerance=tolerance, near=q, seed=seed % 100),
            _solutions_or_none(arm, pose, tolerance, near),
        ):
            assert ((solutions >= arm.lower) & (solutions <= arm.upper)).all()
            for each in solutions:
                reached = pose_of(path, "tool0", dict(zip(arm.joints, each, strict=True)))
                assert (np.array(poses_apart(reached, pose)) <= np.array(tolerance) + 1e-9).all()
            between = np.abs(solutions[:, np.newaxis] - solutions).max(axis=2)
            assert (between[~np.eye(len(solutions), dtype=bool)] > 1e-3).all()


def _solutions_or_none(
    arm: Arm, pose: np.ndarray, tolerance: tuple[float, float], near: np.ndarray
) -> np.ndarray:
    """Return solutions, the nearest first, or none if the pose counts as out of reach."""
    try:
        solutions = arm.inverse("tool0", pose, tolerance=tolerance, near=near, max_solutions=8)
    except ConfigurationError as error:
        assert (
            np.array(poses_apart(arm.pose(error.nearest or (), "tool0"), pose)) > tolerance
        ).any()
        return np.empty((0, arm.dof))
    distances = np.linalg.norm(solutions - near, axis=1)
    assert 1 <= len(solutions) <= 8
    assert (np.diff(distances) >= 0.0).all()
    return solutions


def test_nearly_all_reachable_poses_of_random_chains_are_reached(tmp_path: Path) -> None:
    refused = 0
    for seed in range(40):
        arm = Arm.from_urdf(random_chain(tmp_path, seed, 2 + seed % 6))
        for q in np.random.default_rng(seed).uniform(*arm.ranges(), (5, arm.dof)):
            refused += not len(
                _solutions_or_none(arm, arm.pose(q, "tool0"), (1e-4, 1e-3), arm.configuration())
            )
    assert refused <= 2


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name, frame", [("panda", "panda_hand"), ("ur5", "tool0")])
def test_poses_of_real_arms_are_reached_by_pinocchio(data: Path, name: str, frame: str) -> None:
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

    for q in np.random.default_rng(1).uniform(*arm.ranges(), (100, arm.dof)):
        pose = pose_by_pinocchio(q)
        solutions = arm.inverse(frame, pose, max_solutions=4)
        assert ((solutions >= arm.lower) & (solutions <= arm.upper)).all()
        for each in solutions:
            assert (np.array(poses_apart(pose_by_pinocchio(each), pose)) <= (1e-4, 1e-3)).all()


UPPER_ARM, FOREARM, SHOULDER_HEIGHT = 0.425, 0.39225, 0.089159
"""Lengths of a ur5, metres; its shoulder turns about z, and elbow and wrist 1 move in a plane."""

PLANE_OFFSET, WRIST_1_LENGTH, WRIST_2_LENGTH = 0.13585 - 0.1197 + 0.093, 0.093, 0.09465
"""Distance of wrist 2 from the axis of the shoulder, and lengths of the wrist, metres."""


def ur5_branches(arm: Arm, pose: np.ndarray) -> np.ndarray:
    """Return the (at most 8) configurations of a ur5 that bring tool0 to a pose."""
    poses, y_axis = arm.poses(np.zeros(6)), np.array([0.0, 1.0, 0.0])
    to_wrist = np.linalg.solve(poses["tool0"], poses["wrist_3_link"])
    wrist = np.linalg.solve(poses["base_link"], pose @ to_wrist)
    ahead, found = math.atan2(wrist[1, 3], wrist[0, 3]), []
    offset = math.asin(min(PLANE_OFFSET / math.hypot(*wrist[:2, 3]), 1.0))
    for pan in (ahead - offset, ahead - math.pi + offset):
        # In this frame, the joints from lift to wrist 1 turn about y.
        frame = Rotation.from_euler("z", -pan).as_matrix() @ wrist[:3]
        for sign in (1.0, -1.0):
            wrist_2 = sign * math.acos(frame[1, 1])
            first = (math.cos(wrist_2) * y_axis - frame[:, 1]) / math.sin(wrist_2)
            third = np.cross(first, y_axis)
            turn = Rotation.from_euler("z", -wrist_2).as_matrix() @ [first, y_axis, third]
            wrist_3 = math.atan2(*(turn @ frame[:, :3])[0, [2, 0]])
            x, _, z = frame[:, 3] - WRIST_2_LENGTH * third - WRIST_1_LENGTH * y_axis
            for lift, elbow in two_links(x, z - SHOULDER_HEIGHT):
                wrist_1 = math.atan2(-first[2], first[0]) - lift - elbow - math.pi / 2
                found.append((pan, lift - math.pi / 2, elbow, wrist_1, wrist_2, wrist_3))
    return np.array(found).reshape(-1, 6)


def two_links(x: float, z: float) -> list[tuple[float, float]]:
    """Return the angles of upper arm (from z to x) and forearm that bring its end to a point."""
    cosine = (x * x + z * z - UPPER_ARM**2 - FOREARM**2) / (2.0 * UPPER_ARM * FOREARM)
    if abs(cosine) > 1.0:
        return []
    elbows = math.acos(cosine), -math.acos(cosine)
    inner = [math.atan2(FOREARM * math.sin(q), UPPER_ARM + FOREARM * cosine) for q in elbows]
    return [(math.atan2(x, z) - angle, elbow) for angle, elbow in zip(inner, elbows, strict=True)]


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
def test_nearly_all_branches_of_a_ur5_are_found(data: Path) -> None:
    arm = Arm.from_urdf(data / "arms" / "ur5" / "ur5.urdf", tip="tool0")
    missed = total = 0
    for q in np.random.default_rng(1).uniform(arm.lower, arm.upper, (60, 6)):
        pose = arm.pose(q, "tool0")
        branches, solutions = ur5_branches(arm, pose), arm.inverse("tool0", pose)
        np.testing.assert_allclose(arm.pose(branches, "tool0"), [pose] * len(branches), atol=1e-7)
        steps = branches[:, np.newaxis] - solutions
        apart = np.abs(steps - math.tau * np.rint(steps / math.tau)).max(axis=2).min(axis=1)
        total, missed = total + len(branches), missed + int((apart > 0.05).sum())
    assert total > 400 and missed < 0.01 * total


def test_equal_seeds_give_equal_solutions(tmp_path: Path) -> None:
    arm = Arm.from_urdf(random_chain(tmp_path, 3, 8))
    pose = arm.pose(np.random.default_rng(3).uniform(*arm.ranges()), "tool0")
    first = arm.inverse("tool0", pose, seed=5)
    np.testing.assert_array_equal(arm.inverse("tool0", pose, seed=5), first)
    np.testing.assert_array_equal(
        pickle.loads(pickle.dumps(arm)).inverse("tool0", pose, seed=5), first
    )
    assert not np.array_equal(arm.inverse("tool0", pose, seed=6), first)
    assert [len(arm.inverse("tool0", pose, max_solutions=n)) for n in (1, 3)] == [1, 3]


def test_both_elbows_of_a_planar_arm_are_found(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path)
    both = arm.inverse("tip", pose_at(1, 1), tolerance=(1e-4, math.inf), near=(0.1, 1.0))
    np.testing.assert_allclose(both, [(0.0, math.pi / 2), (math.pi / 2, -math.pi / 2)], atol=2e-4)
    one = arm.inverse("tip", arm.pose((0.3, -0.7), "tip"))
    np.testing.assert_allclose(one, [(0.3, -0.7)], atol=2e-3)


def test_loose_tolerances_reach_poses_that_are_out_of_reach(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path)
    lifted, turned = pose_at(1, 1, 0.1), pose_at(1, 1, 0, (0, 0, math.pi / 2 + 0.3))
    for pose, tight, loose in (
        (lifted, (0.09, math.inf), (0.11, math.inf)),
        (turned, (1e-3, 0.25), (1e-3, 0.35)),
        (pose_at(9, 9, 0, (0, 0, 1)), (math.inf, 1e-3), (math.inf, 1e-3)),
    ):
        if tight != loose:
            with pytest.raises(ConfigurationError, match="out of reach of tip"):
                arm.inverse("tip", pose, tolerance=tight)
        solutions = arm.inverse("tip", pose, tolerance=loose)
        for q in solutions:
            assert (np.array(poses_apart(arm.pose(q, "tip"), pose)) <= loose).all()


def test_an_unreachable_pose_is_refused_with_the_nearest_one(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path)
    message = (
        r"pose is out of reach of tip: the nearest pose that it reached is 1 m and .* rad away; "
        r"it must be within 0.0001 m and 0.001 rad; move the pose, or pass a larger tolerance"
    )
    with pytest.raises(ConfigurationError, match=message) as caught:
        arm.inverse("tip", pose_at(3, 0))
    assert caught.value.nearest is not None
    np.testing.assert_allclose(caught.value.nearest, (0, 0), atol=1e-3)
    with pytest.raises(
        ConfigurationError,
        match=r"reached is 0.5 m away; it must be within 0.01 m; move",
    ):
        arm.inverse("tip", pose_at(0, 2.5), tolerance=(0.01, math.inf))


def test_joints_turn_towards_the_given_configuration(tmp_path: Path) -> None:
    """Continuous joints turn without end; a joint mimicked by half would move its follower."""
    path = write_urdf(
        tmp_path,
        *(link(name, BOX) for name in "abcd"),
        joint("endless", "a", "b", kind="continuous", limits=None),
        joint("wide", "b", "c", at=(1, 0, 0), limits=(-7.0, 7.0)),
        joint("narrow", "c", "d", at=(1, 0, 0), limits=(-2.0, 3.0)),
    )
    arm = Arm.from_urdf(path)
    pose = arm.pose((0.5, 0.6, 0.7), "d")
    (q,) = arm.inverse("d", pose, near=(20.0, 6.5, 0.7), max_solutions=1)
    np.testing.assert_allclose(q, (0.5 + 6 * math.pi, 0.6 + 2 * math.pi, 0.7), atol=2e-3)
    assert all(abs(each[1]) <= 7.0 for each in arm.inverse("d", pose, near=(20.0, 7.0, 0.7)))
    follows = joint(
        "half",
        "d",
        "e",
        kind="continuous",
        limits=None,
        extra='<mimic joint="endless" multiplier="0.5"/>',
    )
    path.write_text(path.read_text().replace("</robot>", f"{link('e', BOX)}{follows}</robot>"))
    arm = Arm.from_urdf(path)
    for q in arm.inverse("e", arm.pose((0.5, 0.6, 0.7), "e"), near=(20.0, 6.5, 0.7)):
        assert max(poses_apart(arm.pose(q, "e"), arm.pose((0.5, 0.6, 0.7), "e"))) < 1e-3


def test_joints_that_do_not_move_the_frame_keep_their_values(tmp_path: Path) -> None:
    arm = Arm.from_urdf(two_arms(tmp_path))
    near = np.random.default_rng(2).uniform(-1.0, 1.0, arm.dof)
    left = np.array([name.startswith("left") for name in arm.joints])
    pose = arm.pose(np.random.default_rng(3).uniform(-1.0, 1.0, arm.dof), "left_6")
    for given_near, expected in ((near, near), (None, np.zeros(arm.dof))):
        solutions = arm.inverse("left_6", pose, near=given_near)
        assert len(solutions) > 1
        assert (solutions[:, ~left] == expected[~left]).all()
    with pytest.raises(ConfigurationError) as caught:
        arm.inverse("left_6", pose_at(9, 9, 9), near=near)
    assert (np.array(caught.value.nearest)[~left] == near[~left]).all()


def test_held_joints_stay_where_they_are_held(tmp_path: Path) -> None:
    path = random_chain(tmp_path, 12, 7)
    whole = Arm.from_urdf(path)
    arm = Arm.from_urdf(path, joints=whole.joints[1:], held_joints={whole.joints[0]: 0.4})
    q = np.random.default_rng(4).uniform(*arm.ranges())
    pose = pose_of(path, "tool0", dict(zip(whole.joints, (0.4, *q), strict=True)))
    for each in arm.inverse("tool0", pose):
        assert (
            max(
                poses_apart(
                    pose_of(path, "tool0", dict(zip(whole.joints, (0.4, *each), strict=True))), pose
                )
            )
            < 1e-3
        )


def test_a_pose_goal_keeps_a_rigid_pose_and_both_tolerances() -> None:
    rounded = pose_at(1, 2, 3, (0.3, 0.4, 0.5)).round(7)
    goal = PoseGoal("tool0", rounded.tolist(), tolerance=(0.01, math.inf))
    pose = np.asarray(goal.pose)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(pose, rounded, atol=1e-6)
    assert (goal.frame, goal.tolerance) == ("tool0", (0.01, math.inf))
    assert PoseGoal("tool0", rounded).tolerance == (1e-4, 1e-3)
    with pytest.raises(ValueError):
        pose[0, 0] = 2.0
    copied = pickle.loads(pickle.dumps(goal))
    np.testing.assert_array_equal(copied.pose, goal.pose)


@refusals(
    "options, message",
    ({"frame": "tool9"}, "frame is 'tool9'; there are foot, upper, fore"),
    ({"frame": 3}, "frame is 3; it must be a non-empty string"),
    ({"frame": "foot"}, "frame is 'foot'; no joint of the arm moves it"),
    ({"pose": np.eye(3)}, r"pose has shape \(3, 3\); it must be a rigid motion"),
    ({"pose": 2 * np.eye(4)}, "pose has shape.*it must be a rigid motion"),
    ({"pose": np.full((4, 4), np.nan)}, r"pose\[0, 0\] is nan"),
    (
        {"tolerance": 0.01},
        "tolerance is 0.01; it must be two numbers above zero, metres and radians",
    ),
    ({"tolerance": (0.01, 0.0)}, r"tolerance is \(0.01, 0.0\); it must be two numbers above zero"),
    ({"tolerance": (0.01, math.nan)}, r"tolerance is \(0.01, nan\); it must be two numbers"),
    ({"tolerance": (math.inf, math.inf)}, "of which one may be infinite"),
    ({"tolerance": "fine"}, "tolerance is 'fine'; it must be numeric"),
    (
        {"near": (0.0,)},
        r"near has shape \(1,\); the last axis must hold one number for each of shoulder, elbow",
    ),
    ({"near": np.zeros((2, 2))}, r"near has shape \(2, 2\); it must be one configuration"),
    ({"near": (0.0, 9.0)}, "near has elbow at 9; its limits are -3 and 3"),
    ({"max_solutions": 0}, "max_solutions is 0; it must be a whole number above zero"),
    ({"seed": -1}, "seed is -1"),
)
def test_inverse_rejects_invalid_arguments(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    arguments = {"frame": "fore", "pose": np.eye(4), **options}
    with pytest.raises(InputError, match=message):
        arm.inverse(**arguments)

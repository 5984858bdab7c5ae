"""Inverse kinematics of arms, against forward kinematics of other code."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import Arm, ConfigurationError, InputError, PoseGoal
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    draw_chain,
    joint,
    link,
    planar_with_tip,
    pose_at,
    pose_of,
    poses_apart,
    random_chain,
    two_arms,
    write_urdf,
)

BOX = ((0.05, 0.05, 0.05), (0, 0, 0))
TOLERANCE = (1e-3, 1e-2)


@examples(25)
@given(seed=seeds, count=st.integers(1, 8))
def test_solutions_reach_the_pose_within_tolerance_and_limits(tmp_path_factory, seed, count):
    """A pose is reached from its own configuration, and hold a joint that does not move."""
    rng, path, arm = draw_chain(tmp_path_factory, seed, count)
    held = {}
    if arm.dof > 2 and rng.random() < 0.3:
        held = {arm.joints[0]: float(np.clip(0.4, arm.lower[0], arm.upper[0]))}
        arm = Arm.from_urdf(path, joints=arm.joints[1:], held_joints=held)

    def place_tip(q):
        return pose_of(path, "tool0", held | dict(zip(arm.joints, q, strict=True)))

    q, other = rng.uniform(*arm._ranges(), (2, arm.dof))
    pose = place_tip(q)
    for near in (q, other):
        try:
            solutions = arm.inverse("tool0", pose, tolerance=TOLERANCE, near=near, max_solutions=8)
        except ConfigurationError as error:
            nearest = place_tip(np.array(error.nearest))
            assert near is other
            assert (np.array(poses_apart(nearest, pose)) > TOLERANCE).any()
            continue
        assert 1 <= len(solutions) <= 8
        assert ((solutions >= arm.lower) & (solutions <= arm.upper)).all()
        assert (np.diff(np.linalg.norm(solutions - near, axis=1)) >= 0.0).all()
        for solution in solutions:
            reached = np.array(poses_apart(place_tip(solution), pose))
            assert (reached <= np.array(TOLERANCE) + 1e-9).all()
        between = np.abs(solutions[:, np.newaxis] - solutions).max(axis=2)
        assert (between[~np.eye(len(solutions), dtype=bool)] > 1e-3).all()


def test_nearly_all_reachable_poses_of_random_chains_are_reached(tmp_path):
    refused = 0
    for seed in range(20):
        arm = Arm.from_urdf(random_chain(tmp_path, seed, 2 + seed % 6))
        for q in np.random.default_rng(seed).uniform(*arm._ranges(), (4, arm.dof)):
            try:
                arm.inverse("tool0", arm.pose(q, "tool0"), max_solutions=1)
            except ConfigurationError:
                refused += 1
    assert refused <= 2


def test_equal_seeds_give_equal_solutions(tmp_path):
    arm = Arm.from_urdf(random_chain(tmp_path, 3, 8))
    pose = arm.pose(np.random.default_rng(3).uniform(*arm._ranges()), "tool0")
    first = arm.inverse("tool0", pose, seed=5)
    for same in (arm, pickle.loads(pickle.dumps(arm))):
        np.testing.assert_array_equal(same.inverse("tool0", pose, seed=5), first)
    assert not np.array_equal(arm.inverse("tool0", pose, seed=6), first)


@pytest.mark.parametrize(
    "pose, tight, loose",
    [
        (pose_at(1, 1, 0.1), (0.09, math.inf), (0.11, math.inf)),
        (pose_at(1, 1, 0, (0, 0, math.pi / 2 + 0.3)), (1e-3, 0.25), (1e-3, 0.35)),
        (pose_at(9, 9, 0, (0, 1e-2, 1)), (math.inf, 1e-3), (math.inf, 2e-2)),
    ],
)
def test_tolerances_decide_what_is_in_reach(tmp_path, pose, tight, loose):
    arm = planar_with_tip(tmp_path)
    with pytest.raises(ConfigurationError, match="out of reach of tip"):
        arm.inverse("tip", pose, tolerance=tight)
    for q in arm.inverse("tip", pose, tolerance=loose):
        assert (np.array(poses_apart(arm.pose(q, "tip"), pose)) <= loose).all()


def test_joints_turn_towards_the_given_configuration(tmp_path):
    """Continuous joints turn without end, others within their limits."""
    endless = {"kind": "continuous", "limits": None}
    parts = (
        *(link(name, BOX) for name in "abcd"),
        joint("endless", "a", "b", **endless),
        joint("wide", "b", "c", at=(1, 0, 0), limits=(-7.0, 7.0)),
        joint("narrow", "c", "d", at=(1, 0, 0), limits=(-2.0, 3.0)),
    )
    q = np.array([0.5, 0.6, 0.7])
    arm = Arm.from_urdf(write_urdf(tmp_path, *parts))
    pose = arm.pose(q, "d")
    for near, turns in (((20.0, 6.5, 0.7), (3, 1, 0)), ((-6.0, -5.5, 0.7), (-1, -1, 0))):
        (solution,) = arm.inverse("d", pose, near=near, max_solutions=1)
        np.testing.assert_allclose(solution, q + math.tau * np.array(turns), atol=2e-3)
    # A further turn of wide would exceed its limit.
    q[1] = 1.0
    solutions = arm.inverse("d", arm.pose(q, "d"), near=(0.5, 7.0, 0.7))
    assert np.abs(solutions - q).max(axis=1).min() < 2e-3


def test_joints_that_do_not_move_the_frame_keep_their_values(tmp_path):
    arm = Arm.from_urdf(two_arms(tmp_path))
    near = np.random.default_rng(2).uniform(-1.0, 1.0, arm.dof)
    right = np.array([name.startswith("right") for name in arm.joints])
    pose = arm.pose(np.random.default_rng(3).uniform(-1.0, 1.0, arm.dof), "left_6")
    for given_near, kept in ((near, near), (None, np.zeros(arm.dof))):
        solutions = arm.inverse("left_6", pose, near=given_near, max_solutions=4)
        assert (solutions[:, right] == kept[right]).all()


def test_a_pose_goal_keeps_a_rigid_pose_and_both_tolerances():
    rounded = pose_at(1, 2, 3, (0.3, 0.4, 0.5)).round(7)
    goal = pickle.loads(pickle.dumps(PoseGoal("tool0", rounded.tolist(), (0.01, math.inf))))
    pose = np.asarray(goal.pose)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(pose, rounded, atol=1e-6)
    assert (goal.frame, goal.tolerance) == ("tool0", (0.01, math.inf))
    with pytest.raises(ValueError):
        np.asarray(PoseGoal("tool0", rounded).pose)[0, 0] = 2.0


def test_many_poses_are_reached_where_two_links_reach(tmp_path):
    """By the triangle of both links, whose elbow turns to at most 2 rad."""
    limits = (-2.0, 2.0)
    arm = planar_with_tip(tmp_path, elbow={"limits": limits})
    rng = np.random.default_rng(4)
    radii = np.concatenate([rng.uniform(0.0, 2.4, 60), [2.0, 2.001]])
    angles = rng.uniform(-2.9, 2.9, len(radii))
    poses = np.array(
        [pose_at(r * np.cos(a), r * np.sin(a)) for r, a in zip(radii, angles, strict=True)]
    )
    options = {"tolerance": (1e-4, math.inf), "max_solutions": 4}
    rows = arm.inverse("tip", poses, **options)
    assert rows.shape == (len(poses), 2)
    # The base turns to 3 rad, which the links can exceed by half of the elbow's turn.
    shortest = 2.0 * math.cos(0.5 * limits[1])
    reached = ~np.isnan(rows).any(axis=1)
    assert not reached[(radii > 2.0002) | (radii < shortest - 2e-4)].any()
    within = (radii < 2.0001) & (radii > shortest)
    assert reached[within].all() and within.sum() > 20 and (~reached).sum() > 20
    first, second = rows[reached].T
    tips = np.stack(
        [np.cos(first) + np.cos(first + second), np.sin(first) + np.sin(first + second)]
    )
    assert np.linalg.norm(tips.T - poses[reached, :2, 3], axis=1).max() < 1e-4 + 1e-9
    for k in np.flatnonzero(reached)[:5]:
        np.testing.assert_array_equal(rows[k], arm.inverse("tip", poses[k], **options)[0])
    assert arm.inverse("tip", poses[:0]).shape == (0, 2)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"frame": "nose"}, "frame is 'nose'"),
        ({"pose": np.ones((2, 4, 4))}, r"pose\[0\] has the last row "),
        ({"pose": np.diag([1.0, 1.0, -1.0, 1.0])[np.newaxis]}, r"pose\[0\] has R = "),
        ({"pose": np.zeros((2, 3, 4))}, r"pose\[0\] has shape \(3, 4\)"),
        ({"pose": np.full((1, 4, 4), np.nan)}, r"pose\[0, 0, 0\] is nan"),
        ({"near": (9.0, 0.0)}, "near has shoulder at 9"),
        ({"max_solutions": 0}, "max_solutions is 0"),
    ],
    ids=["frame", "motion", "mirror", "shape", "nan", "near", "count"],
)
def test_many_poses_are_refused_like_one(tmp_path, change, message):
    arm = planar_with_tip(tmp_path)
    with pytest.raises((InputError, ConfigurationError), match=message):
        arm.inverse(**{"frame": "tip", "pose": pose_at(1, 1)[np.newaxis], **change})

"""Plans of arms to poses, and to one of several goals."""

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import cspace
import planners
from cspace import ConfigurationError, InputError
from tests.helpers.planning import plan_patiently
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    joint,
    link,
    place_link,
    planar,
    planar_with_tip,
    pose_at,
    posed_box,
    poses_apart,
    post,
    random_chain,
    write_urdf,
)

START, GOAL = (-0.6, 0.3), (1.4, -0.2)


def build_space(folder, **obstacles):
    """Build the space of two links of 1 m, with the frame tip at their end, among obstacles."""
    return cspace.build_arm_space(obstacles, planar_with_tip(folder))


def aim_at(x, y):
    """Return the goal to bring the tip to a point."""
    return cspace.PoseGoal("tip", pose_at(x, y), tolerance=(1e-3, math.inf))


@examples(10)
@given(seeds, st.integers(3, 7), st.sampled_from([1e-3, 3e-2]))
def test_plans_to_poses_are_certified_and_end_within_tolerance(seed, count, metres):
    rng = np.random.default_rng(seed)
    tolerance = metres, 10.0 * metres
    with tempfile.TemporaryDirectory() as folder:
        path = random_chain(Path(folder), seed, count)
        arm = cspace.Arm.from_urdf(path)
        sides, places = rng.uniform(0.05, 0.2, (4, 3)), rng.uniform(-0.8, 0.8, (4, 3))
        boxes = {f"box {k}": posed_box(sides[k], *places[k]) for k in range(4)}
        try:
            space = cspace.build_arm_space(boxes, arm)
            start, end = space.sample_free(2, rng)
        except ConfigurationError:  # a box is where no joint moves
            assume(False)
        pose = place_link(path, arm, "tool0", end)
        goal = cspace.PoseGoal("tool0", pose, tolerance)
        try:
            plan = planners.plan(space, start, goal, seed=seed % 1000)
        except ConfigurationError as error:  # the free configuration was not among those found
            assert "none is proven free" in str(error) or "out of reach" in str(error)
            assume(False)
        assume(bool(plan))
        assert plan.certified and plan.recheck().all()
        last = plan.path[-1]
        assert ((last >= arm.lower) & (last <= arm.upper)).all()
        reached = place_link(path, arm, "tool0", last)
        assert (np.array(poses_apart(reached, pose)) <= np.array(tolerance) + 1e-9).all()


def test_poses_out_of_reach_or_in_collision_are_refused(tmp_path):
    space = build_space(tmp_path, crate=posed_box((0.3, 0.3, 0.3), 1.0, 1.0))
    message = "goal is out of reach of tip: the nearest pose that it reached is 1 m and .* rad away"
    with pytest.raises(ConfigurationError, match=message) as caught:
        planners.plan(space, START, cspace.PoseGoal("tip", pose_at(3, 0)))
    nearest = space.arm.pose(caught.value.nearest, "tip")
    np.testing.assert_allclose(nearest[:3, 3], (2, 0, 0), atol=1e-3)
    message = (
        r"goal has 2 configurations that reach the pose, and none is proven free: \w+ is in "
        r"collision with crate, or nearly so, in \d of them"
    )
    with pytest.raises(ConfigurationError, match=message):
        planners.plan(space, START, aim_at(1, 1))


def build_slot(folder):
    """Build a bar that spins and slides up, below a ring with a slot of 14 degrees between walls.

    It passes the ring in the slot alone, and then cannot spin on.
    """
    path = write_urdf(
        folder,
        link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.5))),
        link("cart"),
        link("bar", ((1.0, 0.1, 0.1), (0.5, 0, 0))),
        joint("spin", "foot", "cart"),
        joint("slide", "cart", "bar", kind="prismatic", limits=(0.0, 1.2)),
    )
    first, last = 2.85, 2.15 + math.tau
    ring = [(angle, 0.1, 0.5) for angle in np.arange(first, last, 0.1)]
    walls = [(first, 1.0, 1.0), (last, 1.0, 1.0)]
    boxes = {
        f"box {angle:.1f} {z}": posed_box(
            (0.2, 0.2, height), 0.8 * math.cos(angle), 0.8 * math.sin(angle), z
        )
        for angle, height, z in [*ring, *walls]
    }
    return cspace.build_arm_space(boxes, cspace.Arm.from_urdf(path))


@pytest.mark.parametrize("planner, iterations", [(None, None), ("RRTConnect", 5_000)])
def test_a_plan_tries_further_configurations(tmp_path, planner, iterations):
    space = build_slot(tmp_path)
    goal = cspace.PoseGoal("bar", pose_at(0, 0, 1), tolerance=(1e-3, math.inf))
    first = space.arm.inverse("bar", goal.pose, tolerance=goal.tolerance, near=(0, 0), seed=1)
    is_free = space.is_free(first)
    assert len(first) == 16 and is_free.sum() > 10
    assert not is_free[np.abs(first[:, 0] - 2.5) < 0.3].any()
    options = {"planner": planners.Search(planner, iterations=iterations), "time_limit": 20.0}
    plan, again = (planners.plan(space, (0.0, 0.0), goal, seed=1, **options) for _ in range(2))
    assert plan.certified and tuple(plan.path[-1]) == tuple(plan.goal)
    assert plan.goal[0] == pytest.approx(2.5, abs=0.3)
    np.testing.assert_array_equal(plan.path, again.path)


@refusals(
    "goal, message",
    (np.zeros((2, 3)), r"goal\[0\] has shape \(3,\); it must be one configuration of 2 numbers"),
    ([(9.0, 0.0), (0.0, 9.0)], r"2 alternatives, none of them .*goal\[0\] has shoulder at 9"),
    ([aim_at(9, 9), aim_at(8, 8)], r"2 alternatives.*goal\[0\] is out of reach"),
)
def test_plans_reject_invalid_goals(tmp_path, goal, message):
    with pytest.raises(InputError, match=message):
        planners.plan(build_space(tmp_path), START, goal)


@pytest.mark.parametrize("planner", ["BiRRT", "RRTConnect", "RRTstar"])
def test_a_plan_ends_at_one_of_several_goals(tmp_path, planner):
    space = build_space(tmp_path, post=post())
    # A far one, one in collision, and one behind the post.
    goals = [(2.9, 2.9), (0.37, 0.0), GOAL]
    poses = [aim_at(9, 9), cspace.PoseGoal("tip", space.arm.pose(GOAL, "tip"), (1e-3, 0.1))]
    for goal in (goals, [*poses, (2.9, 2.9)]):
        plan = plan_patiently(space, (START, goal), (0.2, 2.0, 20.0), planner=planner)
        assert plan.certified and tuple(plan.start) == START
        assert tuple(plan.path[-1]) == tuple(plan.goal)
        gap = poses_apart(space.arm.pose(plan.goal, "tip"), space.arm.pose(GOAL, "tip"))[0]
        assert gap < 1e-3 or tuple(plan.goal) == (2.9, 2.9)


def test_a_plan_prefers_the_nearest_goal(tmp_path):
    space = build_space(tmp_path)
    goals = [(2.0, 2.0), (0.1, 0.2), (-1.0, 1.0)]
    for planner in ("BiRRT", "RRTConnect"):
        assert planners.plan(space, (0.0, 0.0), goals, planner=planner).goal.tolist() == [0.1, 0.2]
    for goal in (cspace.PoseGoal("tip", space.arm.pose(START, "tip")), [GOAL, START]):
        still = planners.plan(space, START, goal)
        assert still.certified and still.length == 0.0 and "the start is the goal" in still.status


def test_a_plan_begins_at_one_of_several_starts(tmp_path):
    space = build_space(tmp_path, post=post())
    near, far, inside = (1.2, -0.1), (-0.6, 0.3), (0.37, 0.0)
    plan = planners.plan(space, [far, inside, near], GOAL)
    assert plan.certified and tuple(plan.start) == near
    with pytest.raises(ConfigurationError, match="start has 2 alternatives, none of them proven"):
        planners.plan(space, [inside, inside], GOAL)
    tip = space.arm.pose(far, "tip")[:2, 3]
    plan = planners.plan(space, aim_at(*tip), [GOAL, (1.5, 0.2)], time_limit=5.0)
    assert plan.certified and not plan.is_disconnected
    np.testing.assert_allclose(space.arm.pose(plan.path[0], "tip")[:2, 3], tip, atol=2e-3)
    assert plan.trajectory(max_velocity=1.0, max_acceleration=1.0).certified
    both = planners.plan(space, aim_at(*tip), aim_at(1.2, 0.9), time_limit=5.0)
    assert both.certified
    with pytest.raises(InputError, match="start is out of reach"):
        planners.plan(space, aim_at(9.0, 9.0), GOAL)


def test_every_start_keeps_its_whole_turns(tmp_path):
    arm = cspace.Arm.from_urdf(planar(tmp_path, kind="continuous", limits=None))
    space = cspace.build_arm_space({}, arm)
    starts = [(5.0 + 2.0 * math.tau, 0.1), (1.0 - math.tau, 0.1)]
    for goal, start in (((0.9, 0.1), starts[1]), ((5.5, 0.1), starts[0])):
        plan = planners.plan(space, starts, goal)
        assert tuple(plan.path[0]) == tuple(plan.start) == start
        assert abs(plan.path[-1, 0] - start[0]) < math.pi

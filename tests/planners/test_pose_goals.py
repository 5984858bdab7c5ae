"""Plans of arms to poses, and to one of several goals."""

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import cspace
import planners
from cspace import (
    Arm,
    ArmSpace,
    ConfigurationError,
    InputError,
    PoseGoal,
    Robot,
    Workspace,
    build_arm_space,
)
from cspace.arms import PosedShape
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import (
    joint,
    link,
    planar_with_tip,
    pose_at,
    pose_of,
    posed_box,
    poses_apart,
    post,
    random_chain,
    write_urdf,
)

pytest.importorskip("yourdfpy")

START, GOAL = (-0.6, 0.3), (1.4, -0.2)


def space_with_tip(folder: Path, **obstacles: PosedShape) -> ArmSpace:
    """Build the space of two links of 1 m, with the frame tip at their end, among obstacles."""
    return build_arm_space(obstacles, planar_with_tip(folder))


def point_goal(x: float, y: float) -> PoseGoal:
    """Return the goal to bring the tip to a point."""
    return PoseGoal("tip", pose_at(x, y), tolerance=(1e-3, math.inf))


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 7))
def test_plans_to_poses_are_certified_and_end_within_tolerance(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = random_chain(Path(folder), seed, count)
        arm = Arm.from_urdf(path)
        boxes = {
            f"box {k}": posed_box(rng.uniform(0.05, 0.2, 3), *rng.uniform(-0.8, 0.8, 3))
            for k in range(4)
        }
        try:
            space = build_arm_space(boxes, arm)
            start, end = space.sample_free(2, rng)
        except ConfigurationError:  # a box is where no joint moves
            assume(False)
        pose, tolerance = (
            pose_of(path, "tool0", dict(zip(arm.joints, end, strict=True))),
            (1e-3, 1e-2),
        )
        goal = PoseGoal("tool0", pose, tolerance)
        try:
            plan = planners.plan(space, start, goal, seed=seed % 1000)
        except ConfigurationError as error:  # the free configuration was not among those found
            assert "none is proven free" in str(error) or "out of reach" in str(error)
            assume(False)
        assume(plan.solved)
        assert plan.certified
        assert plan.recheck().all()
        assert np.array_equal(
            plan.goal, np.array(planners.plan(space, start, goal, seed=seed % 1000).goal)
        )
        last = plan.path[-1]
        assert ((last >= arm.lower) & (last <= arm.upper)).all()
        reached = pose_of(path, "tool0", dict(zip(arm.joints, last, strict=True)))
        assert (np.array(poses_apart(reached, pose)) <= np.array(tolerance) + 1e-9).all()


def test_a_plan_takes_the_free_one_of_two_configurations(tmp_path: Path) -> None:
    elbow = posed_box(
        (0.2, 0.2, 0.2), 1.0, 0.0
    )  # where the elbow would be with the arm to the right
    free = space_with_tip(tmp_path)
    near = planners.plan(free, (0.2, 1.2), point_goal(1, 1))
    np.testing.assert_allclose(near.goal, (0.0, math.pi / 2), atol=3e-3)
    blocked = space_with_tip(tmp_path, elbow=elbow)
    plan = planners.plan(blocked, (1.2, 0.1), point_goal(1, 1))
    assert plan.certified
    np.testing.assert_allclose(plan.goal, (math.pi / 2, -math.pi / 2), atol=3e-3)
    np.testing.assert_array_equal(plan.path[-1], plan.goal)


def test_a_pose_out_of_reach_is_refused_with_the_nearest_one(tmp_path: Path) -> None:
    space = space_with_tip(tmp_path)
    message = r"goal is out of reach of tip: the nearest pose that it reached is 1 m and .* rad away; it must be within"
    with pytest.raises(ConfigurationError, match=message) as caught:
        planners.plan(space, START, PoseGoal("tip", pose_at(3, 0)))
    assert caught.value.nearest is not None and space.is_free(caught.value.nearest)
    np.testing.assert_allclose(
        space.arm.pose(caught.value.nearest, "tip")[:3, 3], (2, 0, 0), atol=1e-3
    )


def test_a_pose_whose_configurations_all_collide_is_refused_with_what_touches(
    tmp_path: Path,
) -> None:
    space = space_with_tip(tmp_path, crate=posed_box((0.3, 0.3, 0.3), 1.0, 1.0))
    message = (
        r"goal has 2 configurations that reach the pose, and none is proven free: \w+ is in collision with crate, "
        r"or nearly so, in \d of them; a path must end in FREE; .*allowed_collisions="
    )
    with pytest.raises(ConfigurationError, match=message):
        planners.plan(space, START, point_goal(1, 1))


@pytest.mark.parametrize("planner", ["BiRRT", "RRTConnect", "RRT", "RRTstar"])
def test_a_plan_ends_at_one_of_several_goals(tmp_path: Path, planner: str) -> None:
    space = space_with_tip(tmp_path, post=post())
    configurations = [
        (2.9, 2.9),
        (0.37, 0.0),
        GOAL,
    ]  # a far one, one in collision, and one behind the post
    poses = [
        PoseGoal("tip", pose_at(9, 9)),
        PoseGoal("tip", space.arm.pose(GOAL, "tip"), (1e-3, 0.1)),
    ]
    for goal in (configurations, np.array(configurations), poses, [*poses, (2.9, 2.9)]):
        for limit in (0.2, 2.0, 20.0):
            plan = planners.plan(space, START, goal, planner=planner, time_limit=limit, seed=3)
            if plan.solved:
                break
        assert plan.certified
        np.testing.assert_array_equal(plan.path[-1], plan.goal)
        at_pose = poses_apart(*(space.arm.pose(q, "tip") for q in (plan.goal, GOAL)))[0] < 1e-3
        assert at_pose or tuple(plan.goal) == (2.9, 2.9)
        assert tuple(plan.start) == START


@pytest.mark.parametrize(
    "planner, reason",
    [("PRM", "second thread"), ("PRMstar", "second thread"), ("BFMT", "may end the process")],
)
def test_some_planners_take_one_goal(tmp_path: Path, planner: str, reason: str) -> None:
    space = space_with_tip(tmp_path)
    message = f"goal has 2 configurations and planner is '{planner}'; {planner} .*{reason}"
    with pytest.raises(InputError, match=message):
        planners.plan(space, START, [(2.9, 2.9), GOAL], planner=planner)
    assert planners.plan(space, START, [GOAL], planner=planner, time_limit=5.0).certified


def test_a_plan_prefers_the_nearest_goal(tmp_path: Path) -> None:
    space = space_with_tip(tmp_path)
    for planner in ("BiRRT", "RRTConnect"):
        plan = planners.plan(
            space, (0.0, 0.0), [(2.0, 2.0), (0.1, 0.2), (-1.0, 1.0)], planner=planner
        )
        assert tuple(plan.goal) == (0.1, 0.2) and plan.length == pytest.approx(math.hypot(0.1, 0.2))
    at_start = planners.plan(space, (0.4, 0.5), PoseGoal("tip", space.arm.pose((0.4, 0.5), "tip")))
    assert (
        at_start.certified and at_start.length == 0.0 and "the start is the goal" in at_start.status
    )
    either = planners.plan(space, (0.4, 0.5), [(1.0, 1.0), (0.4, 0.5)])
    assert either.certified and either.length == 0.0
    moved = planners.plan(space, (0.4, 0.5), [(3.0 + 5e-6, 3.0), (3.0, 2.0)])
    assert moved.goal[0] == 3.0
    moved = planners.plan(space, (0.4, 0.5), [(-3.0, -3.0), (3.0 + 5e-6, 0.5)])
    assert moved.goal[0] == 3.0


def test_continuous_joints_end_at_wrapped_goals(tmp_path: Path) -> None:
    arm = planar_with_tip(tmp_path, kind="continuous", limits=None)
    space = build_arm_space({}, arm)
    for planner in ("BiRRT", "RRTConnect"):
        plan = planners.plan(
            space, (3.0, 0.4), PoseGoal("tip", arm.pose((-3.0, 0.4), "tip")), planner=planner
        )
        assert plan.certified and plan.length == pytest.approx(2 * math.pi - 6.0, abs=1e-2)


def space_with_slot(folder: Path) -> ArmSpace:
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
    slot, half = 2.5, 0.35
    boxes = {}
    for angle in np.arange(slot + half, slot - half + math.tau, 0.1).tolist():
        x, y = 0.8 * math.cos(angle), 0.8 * math.sin(angle)
        boxes[f"ring {angle:.1f}"] = posed_box((0.2, 0.2, 0.1), x, y, 0.5)
    for angle in (slot - half, slot + half):
        x, y = 0.8 * math.cos(angle), 0.8 * math.sin(angle)
        boxes[f"wall {angle:.1f}"] = posed_box((0.2, 0.2, 1.0), x, y, 1.0)
    return build_arm_space(boxes, Arm.from_urdf(path))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("planner", [None, "RRTConnect", "RRT"])
def test_a_plan_tries_further_configurations(
    tmp_path: Path,
    planner: str | None,
    seed: int,
) -> None:
    space = space_with_slot(tmp_path)
    goal = PoseGoal("bar", pose_at(0, 0, 1), tolerance=(1e-3, math.inf))
    first = space.arm.inverse("bar", goal.pose, tolerance=goal.tolerance, near=(0, 0), seed=seed)
    assert len(first) == 16 and space.is_free(first).sum() > 10
    assert not space.is_free(first)[np.abs(first[:, 0] - 2.5) < 0.3].any()
    options: dict[str, Any] = {"planner": planner, "seed": seed, "time_limit": 20.0}
    if planner is not None:
        options["iterations"] = 5_000
    plan, again = (planners.plan(space, (0.0, 0.0), goal, **options) for _ in range(2))
    assert plan.certified
    assert plan.goal[0] == pytest.approx(2.5, abs=0.3) and tuple(plan.path[-1]) == tuple(plan.goal)
    np.testing.assert_array_equal(plan.path, again.path)


@refusals(
    "goal, message",
    (PoseGoal("tool9", np.eye(4)), "frame is 'tool9'; there are foot, upper, fore, tip"),
    (PoseGoal("foot", np.eye(4)), "frame is 'foot'; no joint of the arm moves it"),
    (np.empty((0, 2)), r"goal has shape \(0, 2\); it must be one configuration"),
    (np.zeros((2, 3)), r"goal\[0\] has shape \(3,\); it must be one configuration of 2 numbers"),
    ([PoseGoal("tip", np.eye(4)), "home"], r"goal\[1\] is 'home'; it must be numeric"),
    ("home", "goal is 'home'; it must be numeric"),
    (
        [(9.0, 0.0), (0.0, 9.0)],
        r"goal has 2 alternatives, none of them proven free; .*goal\[0\] has shoulder at 9",
    ),
    (
        [PoseGoal("tip", pose_at(9, 9)), PoseGoal("tip", pose_at(8, 8))],
        r"2 alternatives.*goal\[0\] is out of reach",
    ),
)
def test_plans_reject_invalid_goals(tmp_path: Path, goal: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        planners.plan(space_with_tip(tmp_path), START, goal)


def test_maps_refuse_poses() -> None:
    space = cspace.build(Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1), Robot.disc(0.2))
    with pytest.raises(
        InputError,
        match=r"goal is a PoseGoal; the space of an arm is needed .*; pass a configuration",
    ):
        planners.plan(space, (1.0, 1.0), PoseGoal("tip", np.eye(4)))

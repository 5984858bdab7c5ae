"""Plans of arms through places on the way, and goals and options that are for maps alone."""

import math

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import InputError
from tests.helpers.motions import pass_near
from tests.helpers.planning import check_support, plan_patiently
from tests.helpers.urdfs import (
    joint,
    link,
    planar,
    planar_with_tip,
    pose_at,
    posed_box,
    poses_apart,
    post,
    write_slider,
    write_urdf,
)

START, GOAL = (-0.6, 0.3), (1.4, -0.2)


@pytest.mark.parametrize("planner", ["BiRRT", "RRTConnect"])
def test_an_arm_goes_through_joints_and_poses_without_a_stop(tmp_path, planner):
    space = cspace.build_arm_space({"post": post()}, planar_with_tip(tmp_path))
    pose = space.arm.pose((0.6, -1.5), "tip")
    via = [(-0.9, 1.2), cspace.PoseGoal("tip", pose, (1e-3, 0.1)), [(2.9, 2.9), (0.9, -1.2)]]
    options = {"planner": planner, "via": via}
    plan = plan_patiently(space, (START, GOAL), (1.0, 5.0, 20.0), **options)
    assert plan.certified and plan.recheck().all() and "through 3 places" in plan.status
    assert tuple(plan.path[0]) == START and tuple(plan.path[-1]) == GOAL == tuple(plan.goal)
    first, second, third = plan.path[list(plan.via_rows)]
    assert tuple(first) == via[0] and tuple(third) in via[2]
    metres, radians = poses_apart(space.arm.pose(second, "tip"), pose)
    assert metres < 1e-3 and radians < 0.1
    places = np.array([START, first, second, third, GOAL])
    straight = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    assert plan.lower_bound == pytest.approx(straight) and plan.length >= straight * (1.0 - 1e-9)
    limits = {"max_velocity": 1.0, "max_acceleration": 2.0}
    flowing = plan.trajectory(**limits)
    halting = plan.trajectory(**limits, stop_at_via=True)
    assert flowing.certified and halting.certified and flowing.duration < halting.duration
    for place in places[1:-1]:
        gap, _ = pass_near(flowing, place)
        assert gap < 1e-4
        gap, speed = pass_near(halting, place)
        assert gap < 1e-4 and speed < 0.01


def test_whole_turns_of_a_continuous_joint_add_up_from_place_to_place(tmp_path):
    arm = cspace.Arm.from_urdf(planar(tmp_path, kind="continuous", limits=None))
    space = cspace.build_arm_space({}, arm)
    assert space.periodic_axes == (True, False)
    places = [(2.0, 0.1), (-2.0, 0.2), (0.0, 0.0)]
    plan = planners.plan(space, (0.0, 0.0), places[-1], via=places[:-1])
    rows = plan.path[[*plan.via_rows, -1]]
    np.testing.assert_allclose(rows[:, 0], [2.0, -2.0 + math.tau, math.tau], atol=1e-9)


def test_an_arm_names_the_place_that_it_cannot_use(tmp_path):
    space = cspace.build_arm_space({"post": post()}, planar_with_tip(tmp_path))
    with pytest.raises(InputError, match=r"^via\[1\] .*not proven free"):
        planners.plan(space, START, GOAL, via=[START, (0.37, 0.0)])
    far = cspace.PoseGoal("tip", pose_at(9, 9))
    with pytest.raises(InputError, match=r"^via\[0\] is out of reach"):
        planners.plan(space, START, GOAL, via=[far])
    goals = [far, GOAL]
    assert tuple(planners.plan(space, START, goals, time_limit=5.0).goal) == GOAL


@pytest.mark.parametrize("is_map", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_a_start_and_a_place_beyond_a_wall_give_way_to_others(tmp_path, is_map):
    path = write_slider(tmp_path, ((0.2, 0.2, 0.2), (0, 0, 0)), limits=(0.0, 6.0))
    wall = posed_box((20.0, 0.2, 2.0), 3.0, 2.0)
    space = cspace.build_arm_space({"wall": wall}, cspace.Arm.from_urdf(path))
    space = cspace.build_joint_map(space, spacing=0.1) if is_map else space
    low, high, both, goal = (3.9, 1.0), (1.0, 3.0), [(4.0, 1.0), (4.0, 3.0)], (5.0, 2.6)
    plan = planners.plan(space, [low, high], goal, via=[both], time_limit=20.0)
    assert plan.certified and plan.start.tolist() == list(high)
    assert plan.path[plan.via_rows[0]].tolist() == list(both[1])
    apart = planners.plan(space, [low, high], goal, via=[both[0]], time_limit=0.3)
    assert not apart and apart.is_disconnected == is_map


def test_the_table_says_what_arms_and_maps_of_joints_take(tmp_path):
    arm = planar_with_tip(tmp_path)
    spaces = {
        "arms": cspace.build_arm_space({}, arm),
        "maps of joints": cspace.build_joint_map(cspace.build_arm_space({}, arm), spacing=0.2),
    }
    given = {
        "a list of alternatives": {"goal": [GOAL, (0.2, 0.3)]},
        "`cspace.PoseGoal`": {"goal": cspace.PoseGoal("tip", arm.pose(GOAL, "tip"), (1e-2, 0.1))},
        "a place with any rotation": {"goal": (0.9, None)},
        "a place that is a region": {"goal": shapely.box(0.5, 0.5, 0.8, 0.8)},
        "`planners.Near`": {"goal": planners.Near(GOAL, 0.1)},
        "`planners.Near` as the start": {"start": planners.Near(START, 0.1)},
        "`via`": {"via": [(0.5, 0.1)]},
        "`keep`": {"keep": planners.Upright("tip", tolerance=math.pi)},
    }
    for kind, space in spaces.items():
        check_support(kind, space, given, start=START, goal=GOAL, time_limit=5.0)


@pytest.mark.parametrize("via", [(0.5,), (1.5,), (1.0,)], ids=["between", "beyond", "the goal"])
def test_a_lift_of_one_joint_goes_through_a_place(tmp_path, via):
    path = write_urdf(
        tmp_path,
        link("base"),
        link("cart", ((0.1, 0.1, 0.1), (0.0, 0.0, 0.0))),
        joint("slide", "base", "cart", kind="prismatic", limits=(0.0, 2.0)),
    )
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
    plan = planners.plan(space, (0.0,), (1.0,), via=[via])
    trajectory = plan.trajectory(max_velocity=0.5, max_acceleration=1.0)
    assert trajectory.certified and pass_near(trajectory, np.array(via))[0] < 1e-6
    # There and back takes as long as two motions from rest to rest.
    legs = [abs(via[0]), abs(1.0 - via[0])] if via[0] > 1.0 else [1.0]
    rest = sum(leg / 0.5 + 0.5 for leg in legs)
    assert trajectory.duration == pytest.approx(rest, rel=1e-6)

"""Plans of arms."""

import warnings

import numpy as np
import pytest
from ompl import base as ob

import cspace
import planners
from cspace import AngleWarning, InputError
from planners import Trajectory
from planners._catalogue import planner_names
from planners._ompl.states import find_state_kind
from tests.helpers.urdfs import (
    CONTINUOUS,
    build_plane_arm,
    joint,
    link,
    posed_box,
    space_of,
    write_urdf,
)

START, GOAL = (-0.6, 0.3), (1.4, -0.2)
BLOCKED = (0.37, 0.0)


def test_a_plan_says_what_is_proven_of_an_arm():
    plan = planners.plan(space_of(), START, GOAL, seed=1)
    assert plan.certified and plan.exact and not (plan.is_connected or plan.is_disconnected)
    assert plan.axes == ("shoulder", "elbow")
    np.testing.assert_array_equal(plan.path[[0, -1]], [START, GOAL])
    assert plan.length == pytest.approx(np.linalg.norm(np.diff(plan.path, axis=0), axis=1).sum())
    assert plan.length_unit == "rad"


def test_a_continuous_joint_takes_the_shorter_direction():
    space = space_of(kind="continuous", limits=None)
    assert planners.choices(space) == ((*planner_names(), "BiRRT"), ())
    plan = planners.plan(space, (3.0, 0.4), (-3.0 + 4 * np.pi, 0.4))
    # Rows are interpolated linearly, so the second angle exceeds half a turn.
    np.testing.assert_allclose(plan.path, [(3.0, 0.4), (2 * np.pi - 3.0, 0.4)])
    for planner in ("BiRRT", "RRTConnect"):
        around = planners.plan(space, START, (2.8, 0.0), planner=planner, time_limit=20.0, seed=2)
        assert around.certified and space.certify_path(around.path).all()
        # The post blocks the other direction.
        assert around.path[-1] == pytest.approx((2.8 - 2 * np.pi, 0.0))


@pytest.mark.parametrize("planner", ["BiRRT", "RRTConnect", "BKPIECE1"])
@pytest.mark.parametrize("turns", [0, 1, -2, 1000])
def test_a_path_begins_at_the_turn_given_and_goes_on_without_jumps(turns, planner):
    space = space_of(kind="continuous", limits=None)
    start = START[0] + 2 * np.pi * turns, START[1]
    with warnings.catch_warnings(action="ignore", category=AngleWarning):
        plan = planners.plan(space, start, (2.8, 0.0), planner=planner, time_limit=20.0, seed=2)
        again = planners.plan(space, start, (2.8, 0.0), previous=plan)
    for each in (plan, again):
        assert each.certified and each.recheck().all()
        assert tuple(each.start) == tuple(each.path[0]) == start
        # The post blocks the shorter direction.
        assert each.path[-1] == pytest.approx((2.8 + 2 * np.pi * (turns - 1), 0.0), abs=1e-9)
        assert np.abs(np.diff(each.path[:, 0])).max() < np.pi
        trajectory = each.trajectory(max_velocity=1.0, max_acceleration=1.0)
        rows = [point.positions for point in trajectory.to_joint_trajectory().points]
        assert tuple(rows[0]) == start and trajectory.recheck(space).all()
        np.testing.assert_allclose(rows[-1], each.path[-1], atol=1e-12)
        assert np.abs(np.diff(rows, axis=0)).max() < np.pi
        there = planners.plan(space, rows[-1], each.goal)
        assert there.certified and np.abs(there.path - rows[-1]).max() < 1e-9


@pytest.mark.parametrize("planner", [None, "RRTConnect"])
@pytest.mark.parametrize("endpoints", [(4.0, 4.5), (3.0, -3.0), (3.0, 6.5)])
def test_a_joint_mimicked_by_half_keeps_its_numbers(tmp_path, endpoints, planner):
    """A turn of it moves the other joint."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in "abc"),
        joint("one", "a", "b", at=(1, 0, 0), limits=None, kind="continuous"),
        joint("two", "b", "c", at=(1, 0, 0), extra='<mimic joint="one" multiplier="0.5"/>'),
    )
    space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path), allowed_collisions=[("a", "c")])
    plan = planners.plan(space, endpoints[:1], endpoints[1:], planner=planner, seed=1)
    assert plan.certified and plan.path[[0, -1], 0].tolist() == list(endpoints)


@pytest.mark.parametrize(
    "changes, kind",
    [
        ({}, ob.RealVectorStateSpace),
        ({"kind": "continuous", "limits": None}, ob.CompoundStateSpace),
    ],
)
def test_simple_setup_samples_and_measures_states_of_an_arm(changes, kind):
    space = space_of(**changes)
    setup = planners.simple_setup(space)
    information = setup.getSpaceInformation()
    checker = setup.getStateValidityChecker()
    assert isinstance(setup.getStateSpace(), kind)
    state = information.allocState()
    assert information.allocValidStateSampler().sample(state) and information.isValid(state)
    for q in (START, GOAL, BLOCKED):
        find_state_kind(space).write(state, *q)
        assert checker.clearance(state) == space.obstacle_distance(q)
        assert information.isValid(state) == (q != BLOCKED)
    # Beyond the limits of the elbow.
    find_state_kind(space).write(state, 0.0, 9.0)
    assert checker.clearance(state) == 0.0


def test_joints_that_cannot_move_are_refused_if_ompl_needs_their_range(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link("base"), link("mast"), link("head", ((0.1, 0.1, 0.1), (0.5, 0, 0)))),
        joint("spin", "base", "mast", kind="continuous", limits=None),
        joint("lift", "mast", "head", limits=(1, 1)),
    )
    space = cspace.build_arm_space(
        {"far": posed_box((0.1,) * 3, 9.0, 9.0)}, cspace.Arm.from_urdf(path)
    )
    assert planners.plan(space, (0.0, 1.0), (2.0, 1.0)).certified
    with pytest.raises(InputError, match=r"space spans 0 rad; OMPL's planners need at least"):
        planners.plan(space, (0.0, 1.0), (2.0, 1.0), planner="RRTConnect")


@pytest.mark.parametrize("planner", ["Grid", "RRTConnect"])
def test_plans_on_joint_maps_turn_by_less_than_half_a_turn_from_row_to_row(planner):
    """A controller that takes the shorter way would drive through the post."""
    space = build_plane_arm(((1.6, 0.9, 0.2),), **CONTINUOUS)
    joint_map = cspace.build_joint_map(space, 0.1)
    rng = np.random.default_rng(0)
    split = 0
    for _ in range(12):
        start, goal = joint_map.sample_free(2, rng)
        start[0], goal[0] = -3.1, 3.1
        if not joint_map.is_free([start, goal]).all():
            continue
        plan = planners.plan(joint_map, start, goal, planner=planner, seed=1)
        if not plan:
            continue
        steps = np.diff(plan.waypoints, axis=0)
        assert plan.certified and plan.recheck().all()
        assert (np.abs(steps) < np.pi).all()
        assert space.certify_path(plan.waypoints).all()
        assert Trajectory.along(space, plan.waypoints, max_velocity=1.0, max_acceleration=1.0)
        driven = plan.trajectory(max_velocity=1.0, max_acceleration=1.0)
        assert (np.abs(np.diff(driven.positions, axis=0)) < np.pi).all()
        split += len(plan.waypoints) > 2
    assert split > 1

"""Plans of arms."""

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import base as ob

import planners
from cspace import ArmSpace, InputError
from cspace.arms import Arm, build_arm_space
from planners.states import find_state_kind
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import joint, link, planar, posed_box, post, write_urdf

pytest.importorskip("yourdfpy")

START, GOAL = (-0.6, 0.3), (1.4, -0.2)


def space_of(folder: Path, **changes: Any) -> ArmSpace:
    """Build the space of two links of 1 m beside a post."""
    return build_arm_space({"post": post()}, Arm.from_urdf(planar(folder, **changes)))


def test_planners_and_options_of_arms_can_be_chosen(tmp_path: Path) -> None:
    choices = planners.choices(space_of(tmp_path))
    assert choices == ((*planners.planner_names(), "BiRRT"), ("holonomic",), ())


@pytest.mark.parametrize("name", ["BiRRT", *planners.planner_names()])
def test_every_planner_finds_a_proven_path(tmp_path: Path, name: str) -> None:
    space = space_of(tmp_path)
    for limit in (
        0.05,
        0.5,
        20.0,
    ):  # anytime planners use all of it; a busy machine needs the longer limits
        plan = planners.plan(space, START, GOAL, planner=name, time_limit=limit, seed=1)
        if plan.solved:
            break
        assert "undecided whether one exists" in plan.status and "more time" in plan.hint
    assert plan.certified and not (plan.is_connected or plan.is_disconnected) and plan.exact
    assert np.array_equal(plan.path[[0, -1]], [START, GOAL]) and plan.axes == ("shoulder", "elbow")
    between = np.concatenate(
        [np.linspace(a, b, 60) for a, b in zip(plan.path[:-1], plan.path[1:], strict=True)]
    )
    assert np.asarray(space.is_free(between)).all()
    assert plan.length == pytest.approx(np.linalg.norm(np.diff(plan.path, axis=0), axis=1).sum())
    room = np.asarray(space.obstacle_distance(between)).min()
    assert 0.0 <= plan.obstacle_distance <= room + 1e-9 and math.isnan(plan.clearance)
    assert plan.units == ("rad", "rad") and (plan.length_unit, plan.distance_unit) == ("rad", "m")


def test_obstacle_distance_is_within_10_percent_of_the_minimum(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    plan = planners.plan(space, (-0.5, 0.0), (-1.5, 0.5))
    between = np.linspace(plan.path[0], plan.path[-1], 400)
    minimum = np.asarray(space.obstacle_distance(between)).min()
    assert len(plan.path) == 2 and 0.9 * minimum < plan.obstacle_distance <= minimum
    assert pickle.loads(pickle.dumps(plan)).obstacle_distance == plan.obstacle_distance


def test_a_continuous_joint_takes_the_shorter_direction(tmp_path: Path) -> None:
    space = space_of(tmp_path, kind="continuous", limits=None)
    assert space.periodic_axes == (True, False)
    plan = planners.plan(space, (3.0, 0.4), (-3.0 + 4 * np.pi, 0.4))
    assert plan.certified and plan.length == pytest.approx(2 * np.pi - 6.0)
    # Rows are interpolated linearly, so the second yaw exceeds half a turn.
    np.testing.assert_allclose(plan.path, [(3.0, 0.4), (2 * np.pi - 3.0, 0.4)])
    assert space.certify_path(plan.path).all()
    for planner in ("BiRRT", "RRTConnect"):
        around = planners.plan(space, START, (2.8, 0.0), planner=planner, time_limit=20.0, seed=2)
        assert around.certified and space.certify_path(around.path).all()
        assert around.path[-1] == pytest.approx(
            (2.8 - 2 * np.pi, 0.0)
        )  # the post blocks the other direction


@pytest.mark.parametrize("planner", [None, "RRTConnect"])
@pytest.mark.parametrize("endpoints", [(4.0, 4.5), (3.0, -3.0), (3.0, 6.5)])
def test_a_joint_mimicked_by_half_is_not_periodic(
    tmp_path: Path, endpoints: tuple[float, float], planner: str | None
) -> None:
    # One turn moves the other joint, so a plan keeps the numbers of its endpoints.
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    follows = '<mimic joint="one" multiplier="0.5"/>'
    path = write_urdf(
        tmp_path,
        *(link(name, bar) for name in "abc"),
        joint("one", "a", "b", at=(1, 0, 0), limits=None, kind="continuous"),
        joint("two", "b", "c", at=(1, 0, 0), extra=follows),
    )
    space = build_arm_space({}, Arm.from_urdf(path), allowed_collisions=[("a", "c")])
    assert space.periodic_axes == (False,)
    plan = planners.plan(space, endpoints[:1], endpoints[1:], planner=planner, seed=1)
    assert plan.certified
    assert plan.path[[0, -1], 0].tolist() == list(endpoints)


def test_simple_setup_samples_valid_states_of_an_arm(tmp_path: Path) -> None:
    for changes, kind in (
        ({}, ob.RealVectorStateSpace),
        ({"kind": "continuous", "limits": None}, ob.CompoundStateSpace),
    ):
        space = space_of(tmp_path, **changes)
        setup = planners.simple_setup(space)
        assert isinstance(setup.getStateSpace(), kind) and str(setup)
        states = [setup.getStateSpace().allocState() for _ in range(2)]
        sampler = setup.getSpaceInformation().allocValidStateSampler()
        assert all(sampler.sample(state) for state in states)
        assert all(setup.getSpaceInformation().isValid(state) for state in states)
        setup.setStartAndGoalStates(*states)


def test_validity_checker_returns_the_obstacle_distance_as_clearance(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    setup = planners.simple_setup(space)
    checker, state = setup.getStateValidityChecker(), setup.getSpaceInformation().allocState()
    for q in (START, GOAL, (0.37, 0.0)):  # the last configuration is in collision
        find_state_kind(space).write(state, *q)
        assert checker.clearance(state) == space.obstacle_distance(q) and (
            checker.clearance(state) > 0.0
        ) == (q != (0.37, 0.0))
    find_state_kind(space).write(state, 0.0, 9.0)  # beyond the limits of the elbow
    assert checker.clearance(state) == 0.0


def test_plans_of_an_arm_are_shortened_unless_told_otherwise(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    options: dict[str, Any] = {"seed": 3, "time_limit": 60.0}
    first = planners.plan(space, START, GOAL, simplify=False, iterations=5, **options)
    np.testing.assert_array_equal(first.path, space.find_path(START, GOAL, straight=False, seed=3))
    plans = [
        planners.plan(space, START, GOAL, iterations=count, **options) for count in (1, 5, None)
    ]
    lengths = [first.length, *(plan.length for plan in plans)]
    assert lengths == sorted(lengths, reverse=True) and lengths[-1] < lengths[0]
    straight = math.dist(START, GOAL)
    for plan in plans:
        assert plan.certified and plan.lower_bound == pytest.approx(straight)
        assert plan.gap == pytest.approx(plan.length / straight - 1.0)
    np.testing.assert_array_equal(plans[-1].path, planners.plan(space, START, GOAL, **options).path)


@pytest.mark.parametrize("planner", ["BiRRT", *planners.planner_names()])
def test_every_planner_moves_joints_by_a_few_millimetres(tmp_path: Path, planner: str) -> None:
    cube = ((0.001, 0.001, 0.001), (0, 0, 0))
    slides: dict[str, Any] = {"kind": "prismatic", "limits": (0.0, 0.006)}
    parts = (
        joint("x", "base", "rail", axis=(1, 0, 0), **slides),
        joint("y", "rail", "pin", axis=(0, 1, 0), **slides),
    )
    arm = Arm.from_urdf(write_urdf(tmp_path, link("base"), link("rail"), link("pin", cube), *parts))
    space = build_arm_space({"wall": posed_box((0.001, 0.006, 0.001), 0.003, 0.0)}, arm)
    for limit in (
        0.2,
        20.0,
    ):  # anytime planners use all of it; a busy machine needs the longer limit
        plan = planners.plan(
            space, (0.0, 0.0), (0.006, 0.0), planner=planner, time_limit=limit, seed=1
        )
        if plan.solved:
            break
    assert plan.certified and 0.0085 < plan.length < 0.02


def test_joints_that_cannot_move_are_refused_if_ompl_needs_their_range(tmp_path: Path) -> None:
    links = link("base"), link("mast"), link("head", ((0.1, 0.1, 0.1), (0.5, 0, 0)))
    parts = (
        joint("spin", "base", "mast", kind="continuous", limits=None),
        joint("lift", "mast", "head", limits=(1, 1)),
    )
    space = build_arm_space({}, Arm.from_urdf(write_urdf(tmp_path, *links, *parts)))
    assert planners.plan(space, (0.0, 1.0), (2.0, 1.0)).certified
    message = r"space spans 0 rad; OMPL's planners need at least .* rad; use a larger unit, or leave planner out"
    for refuse in (
        lambda: planners.plan(space, (0.0, 1.0), (2.0, 1.0), planner="RRTConnect"),
        lambda: planners.simple_setup(space),
    ):
        with pytest.raises(InputError, match=message):
            refuse()


@refusals(
    "options, message",
    ({"start": (0.0, 9.0)}, "start has elbow at 9; its limits are -3 and 3"),
    (
        {"start": (0.37, 0.0)},
        r"start \(0.37, 0\) is not proven free: fore is in collision with post.*allowed_collisions=",
    ),
    ({"goal": (0.0,)}, r"goal has shape \(1,\)"),
    ({"goal": (0.0, np.nan)}, "nan"),
    (
        {"planner": "Grid"},
        "planner is 'Grid' and space is ArmSpace.* its built-in searches are BiRRT;",
    ),
    ({"planner": "MaxClearance"}, "planner is 'MaxClearance' and space is ArmSpace"),
    ({"objective": "clearance"}, "objective is for maps.*weighs cells"),
    (
        {"objective": lambda si: None},
        "objective is a function and no planner is named; .*planner='RRTstar'",
    ),
    ({"drive": "differential"}, "it is for the axes .x, y, yaw."),
    ({"turning_radius": 1.0}, "a radius is for curves"),
    ({"time_limit": 0.0}, "time_limit"),
)
def test_plans_of_arms_reject_invalid_arguments(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    given = {"start": START, "goal": GOAL, **options}
    with pytest.raises(InputError, match=message):
        planners.plan(space_of(tmp_path), given.pop("start"), given.pop("goal"), **given)

"""Plans on tiled maps."""

import numpy as np
import pytest

import cspace
import planners
from cspace.errors import ConfigurationError, InputError
from planners.local_planner import local_planner
from tests.helpers.handmade import fill_boxes
from tests.helpers.planning import make_state
from tests.helpers.refusals import refusals

DISC = cspace.Robot.disc(0.25)
SMALL_CAR = cspace.Robot.rectangle(0.5, 0.2)


def maze(side=90):
    """Build walls with gaps at alternate ends."""
    walls = np.zeros((side, side), dtype=bool)
    for k, x in enumerate(range(15, side - 5, 15)):
        walls[x : x + 2] = True
        walls[x : x + 2, slice(3, 15) if k % 2 else slice(side - 15, side - 3)] = False
    return cspace.Workspace.from_array(walls, 0.1)


@pytest.fixture(scope="module")
def tiled_maze(tmp_path_factory):
    return cspace.build(maze(), DISC, store=tmp_path_factory.mktemp("maze") / "m", tile=20)


def test_a_path_through_many_tiles_is_certified_and_repeatable(tiled_maze):
    plan = planners.plan(tiled_maze, (0.7, 0.7), (8.5, 8.4), seed=1)
    assert plan.certified and plan.is_connected
    np.testing.assert_allclose(plan.waypoints[[0, -1]], [(0.7, 0.7), (8.5, 8.4)])
    assert cspace.build(maze(), DISC).certify_path(plan.waypoints).all()
    assert 30.0 < plan.length < 60.0
    assert any(line.get_label() == "path" for line in plan.plot().lines)  # drawn over an overview
    again = planners.plan(tiled_maze, (0.7, 0.7), (8.5, 8.4), seed=1)
    np.testing.assert_array_equal(plan.waypoints, again.waypoints)


def test_a_path_of_length_zero_is_certified(tiled_maze):
    assert planners.plan(tiled_maze, (0.7, 0.7), (0.7, 0.7)).certified


@pytest.mark.parametrize(
    ("wall", "status"),
    [
        (np.s_[30:32], "no path exists: proven"),
        # The gap is as wide as the robot.
        (
            np.s_[30:32, 4:],
            "no chain of FREE cells joins start and goal; undecided whether one exists",
        ),
    ],
    ids=["closed", "narrow"],
)
def test_the_status_tells_whether_a_path_exists(wall, status, tmp_path):
    workspace = cspace.Workspace.from_array(fill_boxes((60, 40), wall), 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.2), store=tmp_path / "m", tile=15)
    plan = planners.plan(tiled, (0.7, 3.2), (5.3, 3.2))
    assert not plan.solved and not plan.is_connected
    assert (plan.status, plan.is_disconnected) == (status, "proven" in status)


@refusals(
    "options, message",
    ({"start": [-0.7, 0.7]}, r"start .* lies outside"),
    ({"exact": True}, "exact needs a map in memory"),
    ({"drive": "dubins", "turning_radius": 1.0}, r"it is for the axes .x, y, yaw."),
)
def test_plans_on_tiled_maps_refuse_invalid_arguments(tiled_maze, options, message):
    with pytest.raises(InputError, match=message):
        planners.plan(tiled_maze, **{"start": [0.7, 0.7], "goal": [0.7, 5.0], **options})


def test_a_blocked_goal_is_refused_with_the_nearest_free_one(tiled_maze):
    with pytest.raises(ConfigurationError, match=r"goal .*BLOCKED.*the nearest is") as caught:
        planners.plan(tiled_maze, (0.7, 0.7), (1.55, 4.0))
    assert tiled_maze.is_free(caught.value.nearest)


def test_a_setup_for_a_tiled_map_proves_states_and_motions(tiled_maze):
    si = planners.simple_setup(tiled_maze).getSpaceInformation()
    answers = set()
    for ends in np.random.default_rng(0).uniform(0.0, 9.0, (40, 2, 2)):
        states = [make_state(tiled_maze, si, q) for q in ends.tolist()]
        assert si.isValid(states[0]) == tiled_maze.is_free(ends[0])
        assert si.checkMotion(*states) == tiled_maze.motion_is_free(*ends)
        answers.add(si.checkMotion(*states))
    assert answers == {True, False}


@pytest.mark.parametrize(
    "options",
    [
        {"drive": "reeds-shepp", "turning_radius": 0.3},
        {"objective": "clearance", "planner": "RRTstar", "time_limit": 0.1},
    ],
    ids=["drive", "objective"],
)
def test_tiled_plans_accept_the_options_of_plans_in_memory(options, tmp_path):
    # Tiles are planned in memory; the path is also proven on the whole map in memory.
    tiled = cspace.build(maze(60), SMALL_CAR, rotations=16, store=tmp_path / "m", tile=30)
    space = cspace.build(maze(60), SMALL_CAR, rotations=16)
    ends = (0.7, 0.9, 0.1), (5.3, 4.9, 0.1)
    plan = planners.plan(tiled, *ends, seed=1, **{"time_limit": 3.0, **options})
    assert plan.certified and "through" in plan.status
    np.testing.assert_allclose(plan.waypoints[[0, -1]], ends)
    drive = options.get("drive", "holonomic")
    edges = local_planner(space, False, drive, options.get("turning_radius"))
    assert edges.are_free(plan.waypoints) and plan.recheck().all()
    assert plan.clearance == pytest.approx(edges.clearance(plan.waypoints))


def test_a_car_turns_in_a_bay(tmp_path):
    # The car fits between walls only lengthwise, also if the planner has no time.
    bays = np.s_[10:20, 10:110], np.s_[10:110, 100:110], np.s_[5:25, 90:115]
    workspace = cspace.Workspace.from_array(fill_boxes((120, 120), np.s_[:, :], but=bays), 0.1)
    robot = cspace.Robot.rectangle(1.2, 0.4)
    tiled = cspace.build(workspace, robot, rotations=16, store=tmp_path / "m", tile=40)
    ends = (1.5, 2.0, np.pi / 2), (10.0, 10.5, 0.0)
    for options in ({}, {"planner": "RRTConnect", "time_limit": 1e-4}):
        assert planners.plan(tiled, *ends, **options).certified

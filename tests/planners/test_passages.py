"""Plans through passages a hair wider than the robot."""

import itertools

import numpy as np
import pytest
import shapely
import trimesh

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from cspace.map.search import find_chain
from tests.maps import proven_paths
from tests.placements import collides
from tests.planning import build_three_rooms, compile_for, sample_edge

WIDTH = 0.5
"""Width of the robot in metres."""


def corridor(gap, robot, rotations=72, spacing=WIDTH / 5):
    """Build two rooms with a corridor; return map and walls."""
    walls = [shapely.box(1.5, 0, 3.5, 1.5 - gap / 2), shapely.box(1.5, 1.5 + gap / 2, 3.5, 3)]
    workspace = Workspace.from_polygons(walls, spacing, bounds=(0, 0, 5, 3))
    return cspace.build(workspace, robot, rotations=rotations), shapely.union_all(walls)


@pytest.mark.parametrize(
    ("endpoints", "seed"), [(((0.7, 1.0, 0.0), (4.3, 2.0, 0.0)), 6), (((0.7, 1.5, 0.3), (4.3, 1.5, -0.4)), 2)]
)
def test_a_corridor_two_per_cent_wider_than_the_robot_is_crossed(endpoints, seed):
    space, walls = corridor(WIDTH * 1.02, Robot.rectangle(0.8, WIDTH))
    assert proven_paths(space, *endpoints) is None
    plan = planners.plan(space, *endpoints, planner="RRTConnect", exact=True, seed=seed, time_limit=60)
    assert plan.solved and plan.certified and plan.status.startswith("path found")
    assert plan.path[0] == pytest.approx(endpoints[0]) and plan.path[-1] == pytest.approx(endpoints[1])
    for first, second in itertools.pairwise(plan.waypoints):
        assert not collides(space, sample_edge(space, first, second, np.linspace(0, 1, 200))[0], [walls]).any()


def test_without_exact_the_corridor_is_not_crossed():
    space, _ = corridor(WIDTH * 1.02, Robot.rectangle(0.8, WIDTH))
    assert not planners.plan(space, (0.7, 1.0, 0.0), (4.3, 2.0, 0.0), seed=0, time_limit=0.2).solved


def test_compiling_chains_takes_no_time_from_the_search(monkeypatch):
    space, _ = corridor(WIDTH, Robot.rectangle(0.8, WIDTH))
    endpoints, begun = ((0.7, 1.0, 0.0), (4.3, 2.0, 0.0)), []

    def slow(*arguments, **options):
        if not begun:
            compile_for(0.6)
        begun.append(1)
        return find_chain(*arguments, **options)

    monkeypatch.setattr(planners.passages, "find_chain", slow)
    plan = planners.plan(space, *endpoints, exact=True, seed=0, time_limit=0.3)
    assert begun and plan.times.setup >= 0.6 and plan.times.planning < 0.6


def test_a_disc_crosses_the_corridor():
    space, _ = corridor(WIDTH * 1.02, Robot.disc(WIDTH / 2), rotations=None)
    plan = planners.plan(space, (0.7, 1.0), (4.3, 2.0), exact=True, seed=1, time_limit=30)
    assert plan.solved and plan.certified and plan.status.startswith("path found")


def test_a_corridor_as_wide_as_the_robot_is_never_crossed():
    space, _ = corridor(WIDTH, Robot.rectangle(0.8, WIDTH))
    plan = planners.plan(space, (0.7, 1.0, 0.0), (4.3, 2.0, 0.0), exact=True, seed=0, time_limit=0.6)
    assert not plan.solved and not len(plan.path)
    # No edge near the middle line is free either.
    hair = np.random.default_rng(0).normal(size=(2, 500, 3)) * 10.0 ** np.linspace(-17, -3, 500)[:, None]
    assert not space.motion_is_free(*hair + np.array([(1.0, 1.5, 0.0), (4.0, 1.5, 0.0)])[:, None], exact=True).any()


def test_a_wide_corridor_needs_no_passage_search():
    space, _ = corridor(WIDTH * 2.5, Robot.rectangle(0.8, WIDTH))
    plan = planners.plan(space, (0.7, 1.0, 0.0), (4.3, 2.0, 0.0), exact=True, seed=0, time_limit=10)
    assert plan.solved and "passages" not in plan.status
    assert (space.classify(plan.path) == FREE).any()


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(
    ("robot", "rotations", "turn"),
    [
        (Robot.disc(0.04), None, ()),
        (Robot.ball(0.04), None, ()),
        (Robot.rectangle(0.5, 0.15), 36, (1.5,)),
        (Robot.box((0.5, 0.15, 0.1)), 36, (1.5,)),
        (Robot.box((0.12, 0.05, 0.05)), cspace.Rotations.quaternions(4), (0, 0, 0.6, 0.8)),
    ],
    ids=["R^2", "R^3", "SE(2)", "R^3 x yaw", "SE(3)"],
)
def test_grid_plans_by_default_and_ompl_takes_over_if_it_finds_nothing(monkeypatch, robot, rotations, turn, exact):
    space = cspace.build(build_three_rooms(robot.dim), robot, rotations=rotations)
    endpoints = (*np.full(robot.dim, 0.35), *turn), (3.6, *np.full(robot.dim - 1, 0.35), *turn)
    assert space.is_connected(*endpoints)
    plan = planners.plan(space, *endpoints, exact=exact, time_limit=20)
    assert plan.solved and plan.certified and plan.planner == "Grid" and plan.status == "path found"
    assert plan.path[[0, -1]] == pytest.approx(np.array(endpoints)) and space.certify_path(plan.path, exact=exact).all()
    assert len(plan.waypoints) < 60
    long = planners.plan(space, *endpoints, exact=exact, time_limit=20, simplify=False)
    assert long.certified and len(long.waypoints) > len(plan.waypoints)
    monkeypatch.setattr(cspace.CSpace, "find_path", lambda *how, **options: np.empty((0, space.size)))
    late = planners.plan(space, *endpoints, exact=exact, seed=0, time_limit=2.0)
    assert not late.solved or late.status == "path found: by RRTConnect, as Grid found none"


# ---- in space --------------------------------------------------------------------------------------------------------


def shaft(gap, robot, spacing=WIDTH / 5):
    """Build two rooms with a shaft; return map and corners of walls."""
    low, high = 1.0 - gap / 2, 1.0 + gap / 2
    walls = np.array(
        [
            [(1.5, 0, 0), (2.5, low, 2)],
            [(1.5, high, 0), (2.5, 2, 2)],
            [(1.5, low, 0), (2.5, high, low)],
            [(1.5, low, high), (2.5, high, 2)],
        ]
    )
    meshes = [trimesh.creation.box(bounds=wall) for wall in walls]
    mesh = trimesh.util.concatenate(meshes)
    workspace = Workspace.from_mesh((mesh.vertices, mesh.faces), spacing, bounds=(0, 0, 0, 4, 2, 2))
    return cspace.build(workspace, robot), walls


SHAFT_ROBOTS = [Robot.box((0.6, WIDTH, WIDTH)), Robot.ball(WIDTH / 2)]
SHAFT_ENDPOINTS = (0.6, 0.7, 0.8), (3.4, 1.3, 1.2)


@pytest.mark.parametrize(("robot", "seed"), [(SHAFT_ROBOTS[0], 1), (SHAFT_ROBOTS[1], 0)], ids=["box", "ball"])
def test_a_shaft_four_per_cent_wider_than_the_robot_is_crossed(robot, seed):
    space, walls = shaft(WIDTH * 1.04, robot)
    assert proven_paths(space, *SHAFT_ENDPOINTS) is None
    assert not planners.plan(space, *SHAFT_ENDPOINTS, seed=0, time_limit=0.1).solved
    plan = planners.plan(space, *SHAFT_ENDPOINTS, exact=True, seed=seed, time_limit=120)
    assert plan.solved and plan.certified and plan.exact and plan.status.startswith("path found")
    assert (space.classify(plan.path) != BLOCKED).all() and (space.classify(plan.path) == MIXED).any()
    assert tuple(plan.path[0]) == SHAFT_ENDPOINTS[0] and tuple(plan.path[-1]) == SHAFT_ENDPOINTS[1]
    along = np.linspace(0.0, 1.0, 1000)[:, None, None]
    points = (plan.path[:-1] + along * np.diff(plan.path, axis=0)).reshape(-1, 1, 3)
    half_sides = 0.5 * np.array([0.6, WIDTH, WIDTH]) if robot is SHAFT_ROBOTS[0] else np.zeros(3)
    apart = np.maximum(np.maximum(walls[:, 0] - points, points - walls[:, 1]) - half_sides, 0.0)
    assert np.linalg.norm(apart, axis=-1).min() > (0.0 if robot is SHAFT_ROBOTS[0] else WIDTH / 2)


@pytest.mark.parametrize("robot", SHAFT_ROBOTS, ids=["box", "ball"])
def test_a_shaft_as_wide_as_the_robot_is_never_crossed(robot):
    space, _ = shaft(WIDTH, robot)
    plan = planners.plan(space, *SHAFT_ENDPOINTS, exact=True, seed=0, time_limit=0.4)
    assert not plan.solved and not len(plan.path)
    hair = np.random.default_rng(0).normal(size=(2, 500, 3)) * 10.0 ** np.linspace(-17, -3, 500)[:, None]
    assert not space.motion_is_free(*hair + np.array([(1.0, 1.0, 1.0), (3.0, 1.0, 1.0)])[:, None], exact=True).any()

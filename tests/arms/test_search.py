"""Paths of arms, proven, short and reproducible."""

import numpy as np
import pytest

import planners
from cspace.arms import Arm, build_arm_space
from tests.helpers.oracles import cheapest_chain, path_length
from tests.helpers.strategies import few
from tests.helpers.urdfs import planar_arm, posed_box, random_arm

START, GOAL = (-1.2, 0.4), (1.2, -0.4)
IN_WALL = (0.0, 0.0)
OPTIONS = {"seed": 1, "time_limit": 60.0}


@pytest.fixture(scope="module", params=few([0.001, 0.1]), ids=["sheet", "wall"])
def space(request):
    """Build an arm that passes a wall only folded; sampling a motion misses the thin sheet."""
    arm = planar_arm()
    return build_arm_space({"wall": posed_box((0.9, request.param, 1.0), 1.55, 0.0, 0.0)}, arm)


def find_path(space, start, goals, iterations=None, simplify=True, **options):
    """Return the waypoints of a plan by BiRRT."""
    search = planners.Search("BiRRT", iterations, simplify)
    return planners.plan(space, start, goals, planner=search, **OPTIONS | options).waypoints


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_paths_of_all_kinds_of_joints_are_proven(tmp_path, seed):
    """The path ends at a goal or whole turns from it; further searches never lengthen it."""
    arm = Arm.from_urdf(random_arm(tmp_path, seed))
    posts = {f"post {x}": posed_box((0.2, 0.2, 2.0), x, 0.9 - x) for x in (0.8, 0.1)}
    may_touch = [("l0", name) for name in posts]
    space = build_arm_space(posts, arm, allowed_collisions=may_touch)
    q0, *goals = space.sample_free(4, np.random.default_rng(seed))
    lengths = []
    searches = [{"simplify": False}, {"iterations": 1}, {"iterations": 4}, {"iterations": 12}]
    for options in searches:
        path = find_path(space, q0, goals, **options)
        np.testing.assert_array_equal(path[0], q0)
        turned = [np.abs(np.exp(1j * path[-1]) - np.exp(1j * goal)).max() for goal in goals]
        assert min(turned) < 1e-9
        lengths.append(path_length(path))
    assert (np.diff(lengths) < 1e-9).all()
    np.testing.assert_array_equal(path, find_path(space, q0, goals, iterations=12))


def test_a_search_reaches_the_nearest_free_goal(space):
    near = -1.0, 0.3
    path = find_path(space, START, [IN_WALL, GOAL, near], iterations=10**9)
    np.testing.assert_array_equal(path, [START, near])
    around = find_path(space, START, [IN_WALL, GOAL], iterations=1)
    np.testing.assert_array_equal(around[[0, -1]], [START, GOAL])
    assert not space.motion_is_free(START, GOAL)
    assert len(find_path(space, START, GOAL, iterations=1)) > 2
    # No path exists past a wall that the arm can not fold away from.
    space.add_obstacle("bar", posed_box((1.0, 0.1, 1.0), 0.8, 0.0, 0.0))
    assert find_path(space, START, GOAL, time_limit=0.1).shape == (0, 2)
    space.remove_obstacle("bar")


def test_further_searches_find_the_shortest_way_around_a_wall(space):
    """Compare with the shortest chain of proven motions on a grid of configurations."""
    path = find_path(space, START, GOAL, iterations=40)
    assert space.certify_path(path).all()
    assert path_length(path) < path_length(find_path(space, START, GOAL))
    # Both endpoints are on the grid.
    shoulder = np.linspace(-1.5, 1.5, 51)
    elbow = np.linspace(-2.4, 2.4, 73)
    points = np.stack(np.meshgrid(shoulder, elbow, indexing="ij"), axis=-1).reshape(-1, 2)
    chain = cheapest_chain(space, points, 0.21, START, GOAL)
    assert path_length(path) <= 1.01 * chain

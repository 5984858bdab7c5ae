"""Paths found by the map itself, also through MIXED cells that exact geometry proves free."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
import planners
from cspace import BLOCKED, MIXED, InputError, Robot, Rotations, Workspace
from tests.helpers.handmade import map_of
from tests.helpers.oracles import path_length
from tests.helpers.placements import turn_between
from tests.helpers.strategies import examples, seeds


def compute_length(space, path):
    """Return metres plus half a metre per radian."""
    dim = space.grid.dim
    turns = np.abs(turn_between(path[:-1, dim:], path[1:, dim:])).sum()
    return path_length(path[:, :dim]) + 0.5 * float(turns)


def find_path(space, *endpoints, simplify=True, **options):
    """Return the waypoints of a plan by Grid."""
    search = planners.Search("Grid", simplify=simplify)
    return planners.plan(space, *endpoints, planner=search, **options).waypoints


def test_search_stops_at_its_time_limit():
    states = np.zeros((1500, 1500), dtype=np.uint8)
    states[9:-9:90, 9:-9:90] = BLOCKED
    states[700, 9:-9] = BLOCKED
    space = map_of(states, outside="blocked", spacing=1.0)
    endpoints = (1.5, 1.5), (1498.5, 1498.5)
    assert planners.plan(space, *endpoints, planner="Grid", time_limit=100.0)  # compiled
    late = planners.plan(space, *endpoints, planner="Grid", time_limit=1e-9)
    assert late.waypoints.shape == (0, 2)


def test_searches_beyond_memory_are_refused_and_answered_later(monkeypatch):
    states = np.zeros((300, 300), dtype=np.uint8)
    states[150, :200] = MIXED
    space = map_of(states, outside="blocked", spacing=0.1).exact
    ends = (5.0, 5.0), (25.0, 5.0)
    options = {"planner": planners.Search(simplify=False)}
    with monkeypatch.context() as patch:
        patch.setattr("cspace._support.limits.free_bytes", lambda: 1000)
        with pytest.raises(InputError, match=r"needs about .* of memory.*at most 950 bytes"):
            planners.plan(space, *ends, **options)
    assert planners.plan(space, *ends, **options)


@pytest.mark.parametrize(
    "rotations, start, goal",
    [
        (4, [-math.pi], [math.pi]),
        (Rotations.quaternions(1), [0.1, -0.5, 0.5, 0.7], [-0.1, 0.5, -0.5, -0.7]),
    ],
)
def test_equal_rotations_in_other_numbers_need_no_turn(rotations, start, goal):
    states = np.zeros((rotations if rotations == 4 else len(rotations), 30, 5, 5))
    states[:, 12:15, :4] = MIXED  # an obstacle to go around
    space = map_of(states, rotations, spacing=0.25)
    assert space.is_connected([0.3, 0.6, 0.6, *start], [7.1, 0.6, 0.6, *goal])
    path = find_path(space, [0.3, 0.6, 0.6, *start], [7.1, 0.6, 0.6, *goal])
    assert len(path) > 2 and (path[:, 3:] == start).all() and space.certify_path(path).all()


SIDE = 4.0
"""Side of the drawn rooms in metres."""


def build_gap(width, robot, rotations=None):
    """Build two halves of a room joined by a gap near a wall and a wide door far away."""
    walls = [shapely.box(1.9, 0.0, 2.1, 0.43), shapely.box(1.9, 0.43 + width, 2.1, 3.0)]
    workspace = Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, SIDE, SIDE))
    return cspace.build(workspace, robot, rotations=rotations, outside="free")


@examples(40)
@given(seeds, st.sampled_from([None, 8]))
def test_exact_paths_keep_clear_of_obstacles_and_are_no_longer(seed, rotations):
    rng = np.random.default_rng(seed)
    corners, sides = rng.uniform(0.0, SIDE, (6, 2)), rng.uniform(0.1, 1.2, (6, 2))
    obstacles = [
        shapely.box(*corner, *(corner + side)) for corner, side in zip(corners, sides, strict=True)
    ]
    robot = Robot.rectangle(*rng.uniform(0.1, 0.5, 2))
    workspace = Workspace.from_polygons(
        obstacles, rng.uniform(0.08, 0.2), bounds=(0.0, 0.0, SIDE, SIDE)
    )
    space = cspace.build(workspace, robot, rotations=rotations)
    start, goal = rng.uniform(space.grid.lower, space.grid.upper, (2, 2))
    yaw = [0.3] if rotations else []
    ends = np.array([(*start, *yaw), (*goal, *yaw)])
    if not space.exact.is_free(ends).all():
        return
    path = find_path(space.exact, *ends)
    find_path(space.exact, *ends, simplify=False)  # the checker replays it, too
    if space.is_free(ends).all() and len(through_free := find_path(space, *ends)):
        assert len(path)
        assert compute_length(space, path) <= compute_length(space, through_free) * (1.0 + 1e-9)
    if len(path):
        assert space.min_path_length(*ends) <= compute_length(space, path) * (1.0 + 1e-6)
    else:
        assert not space.exact.motion_is_free(*ends)


def test_exact_paths_turn_where_the_gap_demands_it():
    space = build_gap(0.3, Robot.rectangle(0.6, 0.22), rotations=24)
    start, goal = (1.0, 1.0, 1.5), (3.0, 1.0, 1.5)
    assert len(find_path(space, start, goal)) and find_path(space, start, goal)[:, 1].max() > 3.0
    path = find_path(space.exact, start, goal)
    assert path[:, 1].max() < 1.1 and space.exact.certify_path(path).all()

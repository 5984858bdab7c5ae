"""Lower bounds of the length of paths: against exact shortest paths, and against paths that planners find."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import cspace
import planners
from cspace import BLOCKED, MIXED, ConfigurationError, InputError, Robot, Workspace
from tests.planning import ENDPOINTS, build_from_states, build_room
from tests.strategies import seeds


def shortest_length(obstacles: Any, start: Any, goal: Any) -> float:
    """Return the length of the shortest path around open polygons, by a visibility graph; infinity if none exists."""
    parts = shapely.get_parts(obstacles)
    corners = [tuple(start), tuple(goal)]
    for part in parts:
        for ring in (part.exterior, *part.interiors):
            corners += [tuple(corner) for corner in ring.coords[:-1]]
    points = np.unique(np.array(corners[2:]).reshape(-1, 2), axis=0)
    points = np.vstack([start, goal, points])
    pairs = np.array(list(itertools.combinations(range(len(points)), 2)))
    inside = shapely.buffer(obstacles, -1e-7, join_style="mitre")
    first, last = pairs[~shapely.intersects(inside, shapely.linestrings(points[pairs]))].T
    lengths = np.linalg.norm(points[first] - points[last], axis=1)
    graph = coo_array((lengths, (first, last)), shape=(len(points),) * 2).tocsr()
    return float(dijkstra(graph, directed=False, indices=0)[1])


@settings(max_examples=60)
@given(seeds, st.sampled_from(["blocked", "free"]))
def test_no_path_in_the_plane_is_shorter_than_the_bound(seed: int, outside: str) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.random(rng.integers(3, 8, 2)) < rng.uniform(0.1, 0.4)
    half, parts = rng.uniform(0.05, 0.6, 2), int(rng.integers(4, 10))
    workspace = Workspace.from_array(np.kron(cells, np.ones((parts, parts), dtype=bool)), 1.0 / parts)
    space = cspace.build(workspace, Robot.rectangle(*(2.0 * half)), outside=outside)
    grown = [shapely.box(*(np.array(cell) - half), *(np.array(cell) + 1.0 + half)) for cell in np.argwhere(cells)]
    if outside == "blocked":  # the robot stays inside
        frame = shapely.box(-9, -9, 99, 99) - shapely.box(*half, *(np.array(cells.shape) - half))
        grown.append(frame)
    obstacles = shapely.union_all(grown)
    inner = shapely.Polygon(shapely.box(*space.grid.lower, *space.grid.upper)) - obstacles
    if inner.is_empty:
        return
    points = [p for p in rng.uniform(space.grid.lower, space.grid.upper, (20, 2)) if inner.contains(shapely.Point(p))]
    for start, goal in itertools.pairwise(points[:3]):
        bound, exact = space.min_path_length(start, goal), shortest_length(obstacles, start, goal)
        assert np.linalg.norm(goal - start) * (1 - 1e-6) <= bound <= exact * (1 + 1e-7)


def test_the_bound_is_exact_if_no_cell_is_mixed() -> None:
    state = np.zeros((20, 20), dtype=np.uint8)
    state[10, 2:] = BLOCKED
    space = build_from_states(state)
    around = math.dist((5.5, 15.5), (10, 2)) + 1.0 + math.dist((11, 2), (15.5, 15.5))
    assert space.min_path_length((5.5, 15.5), (15.5, 15.5)) == pytest.approx(around, abs=1e-5)
    plan = planners.plan(space, (5.5, 15.5), (15.5, 15.5))
    assert plan.lower_bound == pytest.approx(around, abs=1e-5) and 0.0 <= plan.gap < 1e-4
    state[10] = BLOCKED
    assert build_from_states(state).min_path_length((5.5, 15.5), (15.5, 15.5)) == math.inf


def test_paths_may_pass_mixed_cells_but_not_the_corner_between_two_blocked_ones() -> None:
    state = np.array([[0, 0, 0], [BLOCKED, MIXED, BLOCKED], [0, 0, 0]], dtype=np.uint8)
    assert build_from_states(state).min_path_length((0.5, 1.5), (2.5, 1.5)) == pytest.approx(2.0, abs=1e-6)
    state = np.array([[0, BLOCKED], [BLOCKED, 0]], dtype=np.uint8)
    assert build_from_states(state).min_path_length((0.5, 0.5), (1.5, 1.5)) == math.inf


def test_a_wall_in_space_is_seen_from_above() -> None:
    state = np.zeros((20, 20, 4), dtype=np.uint8)
    state[10, 2:] = BLOCKED
    space = build_from_states(state)
    start, goal = (5.5, 15.5, 0.5), (15.5, 15.5, 3.5)
    around = math.dist((5.5, 15.5), (10, 2)) + 1.0 + math.dist((11, 2), (15.5, 15.5))
    assert space.min_path_length(start, goal) == pytest.approx(math.hypot(around, 3.0), abs=1e-5)


@pytest.mark.parametrize("name", ENDPOINTS)
@settings(max_examples=4)
@given(seeds)
def test_no_certified_path_is_shorter_than_the_bound(name: str, seed: int) -> None:
    space = build_room(name)
    start, goal = space.sample_free(2, np.random.default_rng(seed))
    for options in ({}, {"planner": "RRTConnect", "seed": seed % 1000}):
        plan = planners.plan(space, start, goal, time_limit=1.0, **options)
        if plan.certified:
            straight = math.dist(start[: space.grid.dim], goal[: space.grid.dim])
            assert straight * (1.0 - 1e-6) <= plan.lower_bound <= plan.length + 0.5 * plan.total_rotation
            assert plan.gap >= 0.0


def test_a_point_outside_the_grid_has_no_bound() -> None:
    space = build_room("plane")
    with pytest.raises(ConfigurationError, match="in the grid"):
        space.min_path_length((-100.0, 0.0), (1.0, 1.0))
    with pytest.raises(InputError, match="q1"):
        space.min_path_length((1.0, 1.0), (np.nan, 1.0))

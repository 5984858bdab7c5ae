"""Lower bounds of the length of paths: against exact shortest paths, and against paths that
planners find."""

import math

import numpy as np
import pytest
from hypothesis import given, settings

import planners
from cspace import BLOCKED, MIXED, ConfigurationError, InputError
from tests.helpers.planning import ENDPOINTS, build_from_states, build_room
from tests.helpers.strategies import seeds
from tests.soak import lengths


@pytest.mark.parametrize("kind", lengths.WORLDS)
@settings(max_examples=30)
@given(seeds)
def test_no_path_is_shorter_than_the_bound(kind: str, seed: int) -> None:
    outcomes = lengths.WORLDS[kind](np.random.default_rng(seed))
    assert lengths.is_between(*np.reshape(outcomes, (-1, 3)).T)


def is_near(bound: float, length: float) -> bool:
    """Return True if a bound is below a length by at most 3 % and two cells of 1 m."""
    return length / 1.03 - 2.0 <= bound <= length * (1.0 + 1e-9)


def test_the_bound_is_near_the_length_if_no_cell_is_mixed() -> None:
    state = np.zeros((20, 20), dtype=np.uint8)
    state[10, 2:] = BLOCKED
    space = build_from_states(state)
    around = math.dist((5.5, 15.5), (10, 2)) + 1.0 + math.dist((11, 2), (15.5, 15.5))
    assert is_near(space.min_path_length((5.5, 15.5), (15.5, 15.5)), around)
    plan = planners.plan(space, (5.5, 15.5), (15.5, 15.5))
    assert is_near(plan.lower_bound, around) and 0.0 <= plan.gap < 0.1
    state[10] = BLOCKED
    assert build_from_states(state).min_path_length((5.5, 15.5), (15.5, 15.5)) == math.inf


def test_paths_may_pass_mixed_cells_but_not_the_corner_between_two_blocked_ones() -> None:
    state = np.array([[0, 0, 0], [BLOCKED, MIXED, BLOCKED], [0, 0, 0]], dtype=np.uint8)
    assert build_from_states(state).min_path_length((0.5, 1.5), (2.5, 1.5)) == pytest.approx(
        2.0, abs=1e-3
    )
    state = np.array([[0, BLOCKED], [BLOCKED, 0]], dtype=np.uint8)
    assert build_from_states(state).min_path_length((0.5, 0.5), (1.5, 1.5)) == math.inf


def test_a_wall_in_space_is_seen_from_above() -> None:
    state = np.zeros((20, 20, 4), dtype=np.uint8)
    state[10, 2:] = BLOCKED
    space = build_from_states(state)
    start, goal = (5.5, 15.5, 0.5), (15.5, 15.5, 3.5)
    around = math.dist((5.5, 15.5), (10, 2)) + 1.0 + math.dist((11, 2), (15.5, 15.5))
    assert is_near(space.min_path_length(start, goal), math.hypot(around, 3.0))


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
            assert (
                straight * (1.0 - 1e-6)
                <= plan.lower_bound
                <= plan.length + 0.5 * plan.total_rotation
            )
            assert plan.gap >= 0.0


def test_a_point_outside_the_grid_has_no_bound() -> None:
    space = build_room("plane")
    with pytest.raises(ConfigurationError, match="in the grid"):
        space.min_path_length((-100.0, 0.0), (1.0, 1.0))
    with pytest.raises(InputError, match="q1"):
        space.min_path_length((1.0, 1.0), (np.nan, 1.0))

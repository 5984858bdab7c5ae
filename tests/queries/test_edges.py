"""Edges against exact clipping."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, Robot
from cspace._rotations import Rotations
from cspace._rotations.base import TWO_PI
from tests.helpers import oracles
from tests.helpers.handmade import (
    ALL_FREE,
    MAP_KINDS,
    Outside,
    build_empty,
    cells_around,
    configurations,
    free_except,
    make_map,
    map_of,
    outsides,
    random_states,
    state_of,
    states,
)
from tests.helpers.strategies import boundary_yaws, examples, resolve_yaw, rotation_cells, uniform

H = 0.25

# ---- positions -----------------------------------------------------------------------------------


def touches(start, end, cells, spacing, lower, slack=0):
    """Return True if a segment meets a widened cell, exactly."""
    (h, slack), *rest = map(oracles.units, ((spacing, slack), lower, start, end))
    corner, start, end = rest
    for cell in cells:
        low = [c + h * i - slack for c, i in zip(corner, cell, strict=True)]
        high = [c + h * (i + 1) + slack for c, i in zip(corner, cell, strict=True)]
        if oracles.segment_meets_block(start, end, low, high):
            return True
    return False


places = st.one_of(
    st.integers(-2, 7).map(lambda k: k / 4),
    st.integers(0, 4).map(lambda k: k / 4),
    st.floats(-0.5, 1.75),
    st.integers(-6, 21).map(lambda k: k / 12),
    st.sampled_from([5e-324, 1e-300, 1e-12, 0.25 + 2.0**-54]),
)
points = st.tuples(places, places, places)


@examples(200)
@given(states(5, (FREE,) * 12 + (MIXED,)), outsides(), points, points)
@example(free_except((1, 1, 2)), ALL_FREE, (0.25,) * 3, (0.75,) * 3)  # through a lattice point
@example(free_except((0, 0, 2)), ALL_FREE, (0.0, 0.0, 0.0), (5e-324, 1e-300, 1.0))
@example(
    free_except(),
    Outside(np.array([1, 1, 4, 2, 2, 5]), FREE),
    (0.3, 0.3, 0.9),
    (0.3, 0.3, 1.0 + 2.0**-20),
)
def test_motion_is_free_exactly_if_all_touched_cells_are_free(state, outside, start, end):
    dim, outside = state.ndim, outside.project(state.ndim)
    start, end, lower, upper = start[:dim], end[:dim], (0.0,) * dim, H * np.array(state.shape)
    stays = all(
        0.0 <= value <= top for q in (start, end) for value, top in zip(q, upper, strict=True)
    )
    near = np.ndindex(state.shape) if stays else cells_around(state, outside)
    blocked = [cell for cell in near if state_of(state, outside, cell) != FREE]
    touched = touches(start, end, blocked, H, lower) or not (stays or outside.state == FREE)
    space = map_of(state, outside=outside)
    free = space.motion_is_free(start, end)
    assert free == space.motion_is_free(end, start) == space.edge_checker()(*start, *end)
    if free == touched:
        # The query may refuse a cell within its slack.
        assert not free
        assert touches(start, end, blocked, H, lower, 2.0**-26)


@pytest.mark.parametrize("dim", [2, 3])
def test_long_edges_outside_the_grid_are_decided(dim):
    space = map_of(np.zeros((4,) * dim))
    rest = (0.6,) * (dim - 1)
    assert space.motion_is_free((-100.0, *[0.5] * (dim - 1)), (100.0, *rest))  # no obstacle at all
    assert not space.motion_is_free((-1e9, *rest), (1e9, *rest))  # too far for the certificate


# ---- many edges, which are tested in blocks first ------------------------------------------------


def ask_alone(space, starts, ends):
    """Query each edge by itself, of which no block is made."""
    edges = zip(starts.tolist(), ends.tolist(), strict=True)
    return [space.motion_is_free(tuple(start), tuple(end)) for start, end in edges]


def draw_near_borders(rng, space, number):
    """Draw configurations on, near and between the borders of cells, also outside the grid."""
    dim, upper = space.grid.dim, np.array(space.grid.upper)
    reach = rng.choice([0.0, 0.3])
    q = rng.uniform(-7.0, 7.0, (number, space.size))
    q[:, :dim] = rng.uniform(-reach, upper + reach, (number, dim))
    nudges = np.array([0.0, 0.0, 1e-12, 2.0**-30, 2.0**-28, 2.0**-25, 2.0**-22])
    on_borders = np.round(q[:, :dim] / H) * H
    on_borders += rng.choice([-1.0, 1.0], on_borders.shape) * rng.choice(nudges, on_borders.shape)
    q[:, :dim] = np.where(rng.random(on_borders.shape) < 0.5, on_borders, q[:, :dim])
    return configurations(space, q)


@pytest.mark.parametrize("kind", MAP_KINDS)
def test_many_edges_get_the_answers_of_each_alone(kind):
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(20):
        cells = random_states(rng, kind, max_side=24, mixture=(FREE,) * 100 + (MIXED, BLOCKED))
        space = make_map(cells, kind, rng.choice(["free", "blocked"]))
        starts, ends = (draw_near_borders(rng, space, 300) for _ in range(2))
        short = rng.random(300) < 0.5
        ends[short] = configurations(space, starts + 0.1 * (ends - starts))[short]
        free = space.motion_is_free(starts, ends)
        assert free.tolist() == ask_alone(space, starts, ends)
        shares.append(free.mean())
    assert 0.1 < np.mean(shares) < 0.9


def test_many_edges_see_updates():
    space = build_empty((64, 64), Robot.disc(0.2))
    starts = np.tile([1.0, 3.2], (500, 1))
    ends = np.column_stack([np.linspace(1.1, 5.0, 500), np.full(500, 3.0)])
    assert space.motion_is_free(starts, ends).all()
    space.add_obstacle("crate", shapely.box(3.0, 2.0, 3.2, 4.0))
    free = space.motion_is_free(starts, ends)
    assert free.tolist() == ask_alone(space, starts, ends)
    assert 0.3 < free.mean() < 0.6


# ---- positions and yaws --------------------------------------------------------------------------

SIDE = 4
ROOMS = st.sampled_from([(SIDE, SIDE), (2, 2, 2)])
"""Cells of positions, in the plane and in space."""


def map_free_except(closed, rotations, shape=(SIDE, SIDE)):
    """Build a map that is FREE except in some cells."""
    state = np.full((len(Rotations.of(rotations)), *shape), FREE, dtype=np.uint8)
    for cell in closed:
        state[tuple(c % n for c, n in zip(cell, state.shape, strict=False))] = MIXED
    return map_of(state, rotations, spacing=H)


coordinates = st.one_of(st.integers(0, 8).map(lambda k: k / 8), st.floats(0, 1), uniform(0, 1))
yaws = st.one_of(st.floats(-7, 7), uniform(-7, 7), uniform(-7, 7), boundary_yaws)
endpoints = st.tuples(coordinates, coordinates, coordinates, yaws)


def resolve_configuration(end, borders, shape):
    """Return a drawn configuration as floats."""
    *position, yaw = end
    return (
        *(value * n / SIDE for value, n in zip(position, shape, strict=False)),
        resolve_yaw(yaw, borders),
    )


@examples(60)
@given(rotation_cells(6), endpoints, endpoints, ROOMS)
def test_edges_test_exactly_the_touched_cells(rotations, start, end, shape):
    """Block all cells off the edge, then each on it."""
    boundaries = Rotations.of(rotations).borders
    q0, q1 = (
        resolve_configuration(start, boundaries, shape),
        resolve_configuration(end, boundaries, shape),
    )
    walk = (q0, q1, H, (0,) * len(shape), shape, boundaries)
    state = np.full((len(boundaries) - 1, *shape), MIXED, dtype=np.uint8)
    for cell in oracles.touched_turned_cells(*walk, slack=1e-8):
        state[cell] = FREE
    assert map_of(state, rotations, spacing=H).motion_is_free(q0, q1)
    for cell in oracles.touched_turned_cells(*walk):
        one = state.copy()
        one[cell] = MIXED
        assert not map_of(one, rotations, spacing=H).motion_is_free(q0, q1)


def test_edges_rotate_the_shorter_way_or_both_at_half_a_turn():
    start, ahead, back = (0.3, 0.3, 0.0), (0.3, 0.3, 2.0), (0.3, 0.3, -2.0)
    quarter = map_free_except([(2, 1, 1)], 8)  # closed at a quarter turn to the left
    assert not quarter.motion_is_free(start, ahead) and quarter.motion_is_free(start, back)
    half = (0.3, 0.3, math.pi)
    assert not quarter.motion_is_free(start, half)
    assert not map_free_except([(6, 1, 1)], 8).motion_is_free(start, half)
    for away, expected in ((1e-6, True), (-1e-6, False), (1e-11, False), (-1e-11, False)):
        assert quarter.motion_is_free(start, (0.3, 0.3, math.pi + away)) == expected
    assert quarter.motion_is_free(start, (0.3, 0.3, 40 * TWO_PI - 2.0))

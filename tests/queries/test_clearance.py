"""Clearance against brute force over all cells."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from tests.helpers import handmade, oracles
from tests.helpers.strategies import examples, seeds


def measure_distances(points, cells):
    """Return distances from points (n, d) to cells (m, d)."""
    return oracles.box_gaps(points[:, None], points[:, None], cells, cells + 1).min(
        axis=1, initial=math.inf
    )


def measure_slice_distances(states, points, slices):
    """Return distances from points to cells of their slices."""
    blocked = [np.argwhere(part != FREE) for part in states]
    pairs = zip(
        points[:, None], slices % len(states), strict=True
    )  # a map of all rotations repeats its slices
    return np.concatenate([measure_distances(point, blocked[s]) for point, s in pairs])


@st.composite
def sparse_states(draw, kind):
    """Draw few cells that are not FREE in possibly long grids."""
    rng = np.random.default_rng(draw(seeds))
    shape = rng.integers(1, 20, 3 if "space" in kind else 2)
    shape[rng.integers(len(shape))] = draw(st.sampled_from([1, 8, 63, 64, 65, 200]))
    states = np.zeros((4 if "turning" in kind else 1, *shape), dtype=np.uint8)
    for s in range(len(states)):
        for _ in range(draw(st.sampled_from([0, 1, 2, 30]))):
            states[(s, *(int(rng.integers(n)) for n in shape))] = rng.choice([MIXED, BLOCKED])
    return states


def check_bounds(space, q, distances):
    """Fail unless clearances are close lower bounds of distances, both in cells."""
    dim, bounds = space.grid.dim, np.asarray(space.clearance(q)) / space.grid.spacing
    distances = np.where(space.classify(q) == FREE, distances, 0.0)
    assert (bounds <= distances).all()
    inside = space.grid.contains(q[:, :dim])
    near = inside & np.isfinite(distances)
    assert (bounds[near] >= distances[near] * (1.0 - 1e-5) - math.sqrt(dim) - 1e-6).all()
    assert np.isinf(bounds[inside & np.isinf(distances)]).all()
    centers = near & (
        np.abs((q[:, :dim] - space.grid.lower) / space.grid.spacing % 1.0 - 0.5) < 1e-9
    ).all(axis=1)
    np.testing.assert_allclose(bounds[centers], distances[centers], rtol=1e-5, atol=1e-6)


def draw_near_borders(rng, q, dim):
    """Move configurations to borders of cells of size 1, beside them, or to centers."""
    moves = rng.integers(0, 4, len(q))
    q[moves == 1, :dim] = np.rint(q[moves == 1, :dim])
    q[moves == 2, :dim] = np.rint(q[moves == 2, :dim]) + rng.choice(
        [-1e-9, 1e-9, -1e-15], ((moves == 2).sum(), dim)
    )
    q[moves == 3, :dim] = np.floor(q[moves == 3, :dim]) + 0.5
    return q


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
@examples(40)
@given(st.data(), seeds)
def test_clearance_is_a_close_lower_bound_of_the_distance_to_cells(kind, data, seed):
    states, rng = data.draw(sparse_states(kind)), np.random.default_rng(seed)
    space, dim = handmade.make_map(states, kind, spacing=1.0), states.ndim - 1
    scale = [*states.shape[1:], *[9.0] * (space.size - dim)]
    q = handmade.configurations(space, rng.uniform(-0.3, 1.3, (60, space.size)) * scale)
    draw_near_borders(rng, q, dim)
    # Tuples are looked up by themselves, also while the distances of some slices are unknown.
    one_by_one = [space.clearance(tuple(one)) for one in q.tolist()]
    check_bounds(
        space, q, measure_slice_distances(states, q[:, :dim], space.rotations._find_cells(q))
    )
    assert space.clearance(q).tolist() == one_by_one == [space.clearance(one) for one in q]


@examples(80)
@given(st.data(), seeds)
def test_clearance_counts_cells_outside_the_grid(data, seed):
    state = data.draw(handmade.states(side=4, mixture=(FREE, FREE, FREE, FREE, MIXED)))
    outside = data.draw(handmade.outsides(state.ndim))
    space = handmade.map_of(state, outside=outside, spacing=1.0)
    around = [
        cell
        for cell in handmade.cells_around(state, outside)
        if handmade.state_of(state, outside, cell) != FREE
    ]
    cells, rng = np.array(around).reshape(-1, state.ndim), np.random.default_rng(seed)
    q = np.concatenate(
        [rng.uniform(-8.0, 16.0, (30, state.ndim)), rng.uniform(0.0, state.shape, (30, state.ndim))]
    )
    draw_near_borders(rng, q, state.ndim)
    check_bounds(space, q, measure_distances(q, cells))
    if outside.state == FREE and len(cells):
        low, high = np.minimum(cells.min(axis=0), 0), np.maximum(cells.max(axis=0) + 1, state.shape)
        assert (space.clearance(q) >= oracles.box_gaps(q, q, low, high) * (1.0 - 1e-5) - 1e-6).all()


# ---- maps that were built ------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_clearance_is_finite_far_away_and_zero_for_nan(dim):
    occupied = np.zeros((6, 5, 4)[:dim], bool)
    occupied[(2,) * dim] = True
    robot = Robot.disc(0.1) if dim == 2 else Robot.ball(0.1)
    space = cspace.build(Workspace.from_array(occupied, 1.0), robot, outside="free")
    rest = (1.5,) * (dim - 1)
    for far in (1e15, 1e18, 1e300, 1.7e308):
        assert 0.0 <= space.clearance((far, *rest)) < np.inf
        nearest = space.nearest_free((far, *rest))
        assert nearest[0] == 5.5 and space.is_free(nearest)

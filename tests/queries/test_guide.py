"""The guide of searches among rotations: shortest chains over blocks of cells, by scipy."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from cspace.queries.guide import Directions, measure_way
from cspace.support.arrays import BLOCKED, FREE, MIXED
from tests.helpers.strategies import seeds


def draw_directions(rng, slices, dim):
    """Draw directions in a ring, each with two slices and three moves."""
    count = int(rng.integers(1, 5))
    moves = rng.integers(-2, 3, (count, 3, 3))
    moves[..., : 3 - dim] = 0
    order = np.arange(count)
    return Directions(
        slices=rng.integers(0, slices, (count, 2)),
        moves=moves,
        move_costs=rng.uniform(3.0, 5.0, (count, 3)),
        neighbors=np.stack([order - 1, order + 1], axis=1) % count,
        turn_costs=rng.uniform(1.0, 3.0, (count, 2)),
    )


def find_passable(states, directions, side, worst_state):
    """Return the blocks that each direction may pass, of shape (directions, x, y, z)."""
    shape = [math.ceil(size / side) for size in states.shape[1:]]
    passable = np.zeros((len(directions.slices), *shape), dtype=bool)
    for direction, *block in itertools.product(*map(range, passable.shape)):
        cells = tuple(slice(side * index, side * (index + 1)) for index in block)
        near = states[(directions.slices[direction], *cells)]
        passable[direction, *block] = (near <= worst_state).any()
    return passable


def link(passable, directions, side):
    """Return the costs between blocks, from each to those that lead to it."""
    index = np.arange(passable.size).reshape(passable.shape)
    costs = {}
    for direction, *block in np.argwhere(np.ones_like(passable)).tolist():
        here = index[direction, *block]
        ways = [
            (direction, *(np.array(block) - move), cost)
            for move, cost in zip(
                directions.moves[direction], directions.move_costs[direction], strict=True
            )
        ] + [
            (other, *block, cost / side)
            for other, cost in zip(
                directions.neighbors[direction], directions.turn_costs[direction], strict=True
            )
        ]
        for other, *place, cost in ways:
            is_inside = all(0 <= a < n for a, n in zip(place, passable.shape[1:], strict=True))
            if is_inside and passable[other, *place]:
                there = index[other, *place]
                costs[here, there] = min(cost, costs.get((here, there), math.inf))
    rows, columns = np.array(list(costs)).reshape(-1, 2).T
    return csr_array((list(costs.values()), (rows, columns)), (passable.size,) * 2)


@pytest.mark.parametrize("dim", [2, 3])
@settings(max_examples=15)
@given(seeds)
def test_a_guide_measures_shortest_chains(dim, seed):
    rng = np.random.default_rng(seed)
    shape = (1,) * (3 - dim) + tuple(rng.integers(3, 8, dim))
    states = rng.choice(np.uint8([FREE, MIXED, BLOCKED]), (3, *shape), p=[0.3, 0.2, 0.5])
    directions = draw_directions(rng, len(states), dim)
    side = int(rng.integers(1, 4))
    worst_state = int(rng.choice([FREE, MIXED]))
    start, goal = (
        (int(rng.integers(len(directions.slices))), tuple(rng.integers(0, shape).tolist()))
        for _ in range(2)
    )
    estimate = measure_way(states, directions, start, goal, side, math.inf, worst_state=worst_state)
    graph = link(find_passable(states, directions, side, worst_state), directions, side)
    first, last = (
        int(np.ravel_multi_index((direction, *np.array(cell) // side), estimate.measured.shape))
        for direction, cell in (goal, start)
    )
    expected = dijkstra(graph, indices=first).reshape(estimate.measured.shape)
    measured = estimate.measured
    np.testing.assert_allclose(estimate.positions[measured], expected[measured], rtol=0.01)
    assert measured.ravel()[last] == np.isfinite(expected.ravel()[last])
    # Without a way to the start, everything that leads to the goal is measured.
    if not measured.ravel()[last]:
        np.testing.assert_array_equal(measured, np.isfinite(expected))

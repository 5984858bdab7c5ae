"""The guide of searches: shortest chains over blocks of cells, by scipy."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from cspace._support.arrays import BLOCKED, FREE, MIXED, frozen
from cspace._support.deadlines import NEVER
from planners._searches.estimate import DEAD_END_COST
from planners._searches.guide import POSITIONS_WEIGHT, Directions, Guide, any_direction
from tests.helpers.strategies import examples, seeds


def draw_directions(rng, slices, dim):
    """Draw directions in a ring, each with some slices and three moves."""
    count = int(rng.integers(1, 5))
    moves = rng.integers(-2, 3, (count, 3, 3))
    moves[..., : 3 - dim] = 0
    order = np.arange(count)
    return Directions(
        slices=rng.integers(0, slices, (count, int(rng.choice([2, 8])))),
        moves=moves,
        move_costs=rng.uniform(3.0, 5.0, (count, 3)),
        neighbors=np.stack([order - 1, order + 1], axis=1) % count,
        turn_costs=rng.uniform(1.0, 3.0, (count, 2)),
    )


def find_cost_factors(states, directions, side, worst_state):
    """Return the cost factor of each block in each direction, of shape (directions, x, y, z).

    It is infinite where no cell is passable at a rotation of the direction. Otherwise it is 1, and
    one more where the middle is passable at none of four rotations, and less where it is at some.
    """
    shape = [math.ceil(size / side) for size in states.shape[1:]]
    factors = np.full((len(directions.slices), *shape), math.inf)
    for direction, *block in itertools.product(*map(range, factors.shape)):
        numbers = directions.slices[direction]
        cells = tuple(slice(side * index, side * (index + 1)) for index in block)
        if (states[(numbers, *cells)] <= worst_state).any():
            middle = np.minimum(side * np.array(block) + side // 2, np.array(states.shape[1:]) - 1)
            looked_at = numbers[[0, 1]] if len(numbers) == 2 else numbers[[0, 2, 4, 6]]
            is_passable = states[(looked_at, *middle)] <= worst_state
            factors[direction, *block] = 2.0 - is_passable.mean()
    return factors


def link(factors, directions, side):
    """Return the costs between blocks, from each to those that lead to it."""
    index = np.arange(factors.size).reshape(factors.shape)
    costs = {}
    for direction, *block in np.ndindex(factors.shape):
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
            is_inside = all(0 <= a < n for a, n in zip(place, factors.shape[1:], strict=True))
            if is_inside and factors[other, *place] < math.inf:
                there = index[other, *place]
                cost *= factors[other, *place]
                costs[here, there] = min(cost, costs.get((here, there), math.inf))
    rows, columns = np.array(list(costs)).reshape(-1, 2).T
    return csr_array((list(costs.values()), (rows, columns)), (factors.size,) * 2)


@pytest.mark.parametrize("dim", [2, 3])
@example(8)
@examples(15)
@given(seeds)
def test_a_guide_measures_short_chains(dim, seed):
    rng = np.random.default_rng(seed)
    shape = (1,) * (3 - dim) + tuple(rng.integers(3, 8, dim))
    states = rng.choice(np.uint8([FREE, MIXED, BLOCKED]), (3, *shape), p=[0.3, 0.2, 0.5])
    directions = draw_directions(rng, len(states), dim)
    side = int(rng.integers(1, 4))
    worst_state = int(rng.choice([FREE, MIXED]))

    def draw_state():
        return int(rng.integers(len(directions.slices))), tuple(rng.integers(0, shape).tolist())

    start, goal, *others = (draw_state() for _ in range(6))
    guide = Guide(
        frozen(states), directions, start, goal, side, narrow_cost=1.0, worst_state=worst_state
    )
    graph = link(find_cost_factors(states, directions, side, worst_state), directions, side)
    estimate = guide.estimate
    block_of = {state: (state[0], *np.array(state[1]) // side) for state in (start, goal, *others)}
    first = int(np.ravel_multi_index(block_of[goal], estimate.positions.shape))
    expected = dijkstra(graph, indices=first).reshape(estimate.positions.shape)
    for state in (start, *others):
        guide.reach(*state, NEVER)
        block = block_of[state]
        is_dead_end = estimate.positions == DEAD_END_COST
        is_reached = (estimate.reached != 0) & ~is_dead_end
        assert is_reached[block] == np.isfinite(expected[block])
        if is_reached[block]:
            assert expected[block] <= 1.001 * estimate.positions[block]
            assert estimate.positions[block] <= 1.3 * expected[block]
        elif not is_dead_end[block]:
            # Everything that leads to the goal is known.
            np.testing.assert_array_equal(is_reached, np.isfinite(expected))
            assert estimate.bound[0] == -math.inf
        # What is known is the cost of a chain.
        assert (estimate.positions[is_reached] * 1.001 >= expected[is_reached]).all()


@pytest.mark.parametrize("dim", [2, 3])
@examples(15)
@given(seeds)
def test_blocks_join_where_their_cells_meet_at_a_rotation(dim, seed):
    rng = np.random.default_rng(seed)
    shape = (1,) * (3 - dim) + tuple(rng.integers(4, 16, dim))
    count = int(rng.integers(1, 4))
    states = rng.choice(
        np.uint8([FREE, BLOCKED]), (count, *shape), p=[0.4 / count, 1 - 0.4 / count]
    )
    side = int(rng.integers(1, 5))
    goal = tuple(rng.integers(0, shape).tolist())
    states[(0, *goal)] = FREE
    blocks = tuple(-(-size // side) for size in shape)
    number = np.arange(math.prod(blocks)).reshape(blocks)
    block_of = number[np.ix_(*(np.arange(size) // side for size in shape))]
    # Blocks joined by two cells that share a face.
    pairs = []
    for axis in range(3):
        lower = np.moveaxis(states == FREE, 1 + axis, 1)
        numbers = np.moveaxis(block_of, axis, 0)
        meets = (lower[:, :-1] & lower[:, 1:]).any(axis=0)
        pairs.append(np.stack([numbers[:-1][meets], numbers[1:][meets]]))
    rows, columns = np.concatenate(pairs, axis=1)
    graph = csr_array((np.ones(len(rows)), (rows, columns)), (number.size,) * 2)
    graph.data[:] = 1.0
    steps = dijkstra(graph, directed=False, indices=block_of[goal], unweighted=True)
    directions = any_direction(frozen(states))._replace(joins=True)
    for cell in rng.integers(0, shape, (5, 3)).tolist():
        guide = Guide(states, directions, (0, tuple(cell)), (0, goal), side, narrow_cost=0.0)
        guide.reach(0, tuple(cell), NEVER)
        block = tuple(np.array(cell) // side)
        expected = steps[number[block]]
        reached = guide.estimate.reached[(0, *block)] != 0
        assert reached == np.isfinite(expected)
        if reached:
            straight = math.dist(block, np.array(goal) // side)
            cost = guide.estimate.positions[(0, *block)]
            assert straight * 0.999 <= cost <= POSITIONS_WEIGHT * 1.001 * expected


def test_a_dead_end_is_found_without_a_look_at_the_whole_map():
    states = np.full((2, 1, 40, 40), FREE, np.uint8)
    # At the first rotation, walls close off a cell; at the second one, the cell is blocked.
    states[0, 0, 19:22, 19:22] = BLOCKED
    states[0, 0, 20, 20] = FREE
    states[1, 0, 20, 20] = BLOCKED
    frozen(states)
    steps = np.array([(0, 1, 0), (0, 0, 1), (0, 1, 1)])
    directions = Directions(
        slices=np.array([[0], [1]]),
        moves=np.stack([steps, steps]),
        move_costs=np.ones((2, 3)),
        neighbors=np.array([[1], [0]]),
        turn_costs=np.ones((2, 1)),
    )
    guide = Guide(states, directions, (0, (0, 30, 30)), (0, (0, 39, 39)), 1, narrow_cost=1.0)
    guide.reach(0, (0, 30, 30), NEVER)
    count = np.count_nonzero(guide.estimate.reached)
    assert count < states.size / 2
    guide.reach(0, (0, 20, 20), NEVER)
    assert guide.estimate.positions[0, 0, 20, 20] == DEAD_END_COST
    assert np.count_nonzero(guide.estimate.reached) == count + 1

"""Chains of cells with the fewest MIXED cells."""

import heapq
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED
from cspace.map.search import open_chain
from tests import handmade
from tests.strategies import seeds


def find_chain(space, start, goal, closed=None):
    return open_chain(space._grid_kernel_map, space.rotations._neighbors, np.array(start), np.array(goal), closed)


def count_fewest_mixed(states, closed, start, goal, kind):
    """Return the fewest MIXED cells of a chain, by Dijkstra."""
    best, todo = {start: 0}, [(0, start)]
    while todo:
        cost, here = heapq.heappop(todo)
        if here == goal:
            return cost
        for near in handmade.side_neighbors(here, states.shape, kind):
            if states[near] == BLOCKED or closed[near]:
                continue
            total = cost + int(states[near] == MIXED)
            if total < best.get(near, 10**9):
                best[near] = total
                heapq.heappush(todo, (total, near))
    return None


@settings(max_examples=100)
@given(seeds, st.sampled_from(handmade.MAP_KINDS), st.booleans())
def test_chains_have_the_fewest_mixed_cells(seed, kind, shuts):
    rng = np.random.default_rng(seed)
    states = handmade.random_states(rng, kind, 7, (FREE, FREE, MIXED, MIXED, BLOCKED))
    closed = rng.random(states.shape) < (0.15 if shuts else 0.0)
    passable = np.argwhere(states != BLOCKED)
    if not len(passable):
        return
    space = handmade.make_map(states, kind)
    endpoints = passable[rng.integers(len(passable), size=2)]
    start, goal = map(tuple, endpoints.tolist())
    path = find_chain(space, *endpoints, closed if shuts else None)
    expected = count_fewest_mixed(states, closed, start, goal, kind)
    if expected is None:
        assert path.shape == (0, states.ndim)
        return
    cells = list(map(tuple, path.tolist()))
    assert cells[0] == start and cells[-1] == goal and len(set(cells)) == len(cells)
    for here, near in pairwise(cells):
        assert near in set(handmade.side_neighbors(here, states.shape, kind))
        assert states[near] != BLOCKED and not closed[near]
    assert sum(int(states[cell] == MIXED) for cell in cells[1:]) == expected


def test_chains_avoid_closed_cells():
    states = np.zeros((1, 3, 3, 3), dtype=np.uint8)
    space, closed = handmade.make_map(states, "space"), np.zeros(states.shape, dtype=bool)
    endpoints = (0, 0, 0, 0), (0, 2, 0, 0)
    assert len(find_chain(space, *endpoints, closed)) == 3
    closed[0, 1] = True
    assert find_chain(space, *endpoints, closed).shape == (0, 4)
    closed[0, 1, 2, 2] = False
    assert len(find_chain(space, *endpoints, closed)) == 11


@pytest.mark.parametrize("kind", handmade.MAP_KINDS)
def test_chains_from_or_to_blocked_cells_are_empty(kind):
    states = np.zeros((4 if "turning" in kind else 1, *((5, 4, 3) if "space" in kind else (5, 4))), np.uint8)
    states[0, 2, 1] = BLOCKED
    space = handmade.make_map(states, kind)
    blocked, free = ((0, n, *[1] * (states.ndim - 2)) for n in (2, 0))
    for endpoints in ((blocked, free), (free, blocked), (blocked, blocked)):
        assert find_chain(space, *endpoints).shape == (0, states.ndim)
    assert len(find_chain(space, free, free)) == 1

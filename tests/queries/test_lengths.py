"""Lengths of paths in the plane and their lower bounds, against visibility graphs."""

import math

import numpy as np
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE
from tests.fuzz.lengths import shortest_length
from tests.helpers.handmade import map_of
from tests.helpers.oracles import path_length
from tests.helpers.strategies import seeds

NARROW = 1e-6
"""Growth of blocked cells in the oracle, in cells, so that two of them close a common corner."""


def find_shortest_length(blocked, start, goal):
    """Return the length of the shortest path among blocked cells; infinity if none exists."""
    framed = np.argwhere(np.pad(blocked, 1, constant_values=True)) - 1
    walls = shapely.union_all(shapely.box(*framed.T, *(framed + 1).T))
    return shortest_length(walls.buffer(NARROW, join_style="mitre"), start, goal)


@settings(max_examples=150)
@example(seed=514, share=0.375, block=3)  # begins between a border and the margin before it
@example(seed=2495, share=0.2633594727491589, block=3)  # blocks of 4 cells hide a shorter way
@given(seeds, st.floats(0.0, 0.5), st.sampled_from([1, 3]))
def test_paths_and_bounds_are_near_the_shortest_length(seed, share, block):
    rng = np.random.default_rng(seed)
    blocked = rng.random(rng.integers(2, 11, 2)) < share
    blocked = np.kron(blocked, np.ones((block, block), dtype=bool))[:20, :20]
    free = np.argwhere(~blocked)
    if not len(free):
        return
    start, goal = free[rng.integers(len(free), size=2)] + rng.choice([0.5, 0.1, 0.999], (2, 2))
    space = map_of(
        np.where(blocked, BLOCKED, FREE).astype(np.uint8), outside="blocked", spacing=0.25
    )
    path = space.find_path(0.25 * start, 0.25 * goal) / 0.25
    bound = space.min_path_length(0.25 * start, 0.25 * goal) / 0.25
    expected = find_shortest_length(blocked, start, goal)
    assert bound <= expected * (1.0 + 1e-9)
    assert math.isinf(expected) == math.isinf(bound) == (len(path) == 0)
    if len(path):
        assert bound >= expected / 1.03 - 3.0
        # Chains of cells begin and end at centers, up to 0.71 cells from the ends, there and back.
        assert path_length(path) <= 1.15 * expected + 2.0 * math.sqrt(2.0)
        assert (path[[0, -1]] == [start, goal]).all()
        assert space.certify_path(0.25 * path).all()

"""Lengths of paths in the plane and their lower bounds, against visibility graphs."""

import itertools
import math

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from cspace import BLOCKED, FREE
from tests.helpers.handmade import map_of
from tests.helpers.oracles import path_length
from tests.helpers.strategies import seeds

NARROW = 1e-6
"""Widening of free space in the oracle, and distance at which a segment touches a corner, in cells.
"""


def find_shortest_length(free, start, goal):
    """Return the length of the shortest path by a visibility graph.

    The path may not pass through a corner that only two cells share.
    """
    world = shapely.union_all([shapely.box(i, j, i + 1, j + 1) for i, j in np.argwhere(free)])
    walls = np.pad(~free, 1, constant_values=True)
    around = np.stack([walls[:-1, :-1], walls[:-1, 1:], walls[1:, :-1], walls[1:, 1:]])
    turning = np.argwhere(around.sum(axis=0) == 1)
    squeezes = np.argwhere((around.sum(axis=0) == 2) & (around[0] == around[3]))
    points = np.vstack([start, goal, turning])
    pairs = np.array(list(itertools.combinations(range(len(points)), 2)))
    segments = shapely.linestrings(points[pairs])
    grown = world.buffer(NARROW / 10, join_style="mitre")
    visible = shapely.covers(grown, segments)
    if len(squeezes):
        visible &= shapely.distance(segments, shapely.multipoints(squeezes)) > NARROW
    first, last = pairs[visible].T
    lengths = np.linalg.norm(points[first] - points[last], axis=1)
    graph = sparse.coo_array((lengths, (first, last)), shape=(len(points),) * 2).tocsr()
    return sparse.csgraph.dijkstra(graph, directed=False, indices=0)[1]


@settings(max_examples=150)
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
    expected = find_shortest_length(~blocked, start, goal)
    assert bound <= expected * (1.0 + 1e-9)
    assert math.isinf(expected) == math.isinf(bound) == (len(path) == 0)
    if len(path):
        assert bound >= expected / 1.03 - 3.0
        assert path_length(path) <= 1.15 * expected + 0.5
        assert (path[[0, -1]] == [start, goal]).all()
        assert space.certify_path(0.25 * path).all()

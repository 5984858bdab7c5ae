"""Exact queries at the largest allowed coordinates."""

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import MIXED, Robot, Workspace
from cspace._grid import MAX_COORDINATE
from tests.helpers.strategies import examples, seeds

CELLS = 48
CORNERS = [(1, 1), (-1, 1), (-1, -1)]
RADIUS = 0.37


def find_farthest_lower(signs, spacing):
    """Return the lower corner of the farthest allowed grid."""
    last = MAX_COORDINATE - CELLS - 1
    return np.where(np.array(signs) > 0, last, -last - CELLS) * spacing


@examples(15)
@given(seeds, st.sampled_from(CORNERS), st.sampled_from([0.0625, 0.05]))
def test_points_and_edges_agree_with_shapely_near_the_origin(seed, signs, spacing):
    """Differences of near coordinates are exact, so shapely's are as exact as near the origin."""
    rng = np.random.default_rng(seed)
    lower = find_farthest_lower(signs, spacing)
    low = lower + rng.uniform(0.2, 2.0, (6, 2))
    high = low + rng.uniform(0.05, 0.4, (6, 2))
    bounds = np.concatenate([lower, lower + CELLS * spacing])
    boxes = shapely.box(*low.T, *high.T)
    space = cspace.build(
        Workspace.from_polygons(boxes, spacing, bounds), Robot.disc(RADIUS), outside="free"
    )
    q = rng.uniform(lower, lower + CELLS * spacing, (400, 2))
    q = q[space.classify(q) == MIXED][:40]
    other = q + rng.uniform(-0.1, 0.1, q.shape)
    obstacles = shapely.union_all(shapely.box(*(low - lower).T, *(high - lower).T))
    edges = shapely.linestrings(np.stack([q, other], axis=1) - lower)
    for gaps, is_free in (
        (shapely.distance(shapely.points(q - lower), obstacles), space.exact.is_free(q)),
        (shapely.distance(edges, obstacles), space.exact.motion_is_free(q, other)),
    ):
        assert (gaps[is_free] > RADIUS - 1e-14).all()
        assert (gaps[~is_free] < RADIUS + 1e-3).all()

"""Exact queries at the largest allowed coordinates."""

from fractions import Fraction

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import MIXED, Robot, Workspace
from cspace.grid import MAX_COORDINATE
from tests.helpers.oracles import exact, square_distance_to_box
from tests.helpers.strategies import seeds

CELLS = 48
CORNERS = [(1, 1), (-1, 1), (-1, -1)]
RADIUS = 0.37


def find_farthest_lower(signs, spacing):
    """Return the lower corner of the farthest allowed grid."""
    last = MAX_COORDINATE - CELLS - 1
    return np.where(np.array(signs) > 0, last, -last - CELLS) * spacing


def draw_boxes(lower, rng, count=6):
    low = lower + rng.uniform(0.2, 2.0, (count, len(lower)))
    return np.hstack([low, low + rng.uniform(0.05, 0.4, low.shape)])


@settings(max_examples=15)
@given(seeds, st.sampled_from(CORNERS), st.sampled_from([0.0625, 0.05]))
def test_points_and_edges_agree_with_rational_arithmetic(seed, signs, spacing):
    rng = np.random.default_rng(seed)
    lower = find_farthest_lower(signs, spacing)
    boxes = draw_boxes(lower, rng)
    bounds = np.concatenate([lower, lower + CELLS * spacing])
    workspace = Workspace.from_polygons([shapely.box(*box) for box in boxes], spacing, bounds)
    space = cspace.build(workspace, Robot.disc(RADIUS), outside="free")
    q = rng.uniform(lower, lower + CELLS * spacing, (400, 2))
    q = q[space.classify(q) == MIXED][:40]
    other = q + rng.uniform(-0.1, 0.1, q.shape)
    blocks = [exact(box) for box in boxes]
    for one, two, point, edge in zip(
        q,
        other,
        space.is_free(q, exact=True),
        space.motion_is_free(q, other, exact=True),
        strict=True,
    ):
        for end, answer in ((one, point), (two, edge)):
            gap = min(square_distance_to_box((exact(one), exact(end)), block) for block in blocks)
            near = Fraction(RADIUS) ** 2
            assert gap > near if answer else gap < Fraction(RADIUS + 1e-3) ** 2

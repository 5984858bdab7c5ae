"""Exact queries at the largest allowed coordinates."""

from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import MIXED, Grid, Robot, Workspace
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
    rng, lower = np.random.default_rng(seed), find_farthest_lower(signs, spacing)
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


@pytest.mark.parametrize("signs", CORNERS)
def test_rotating_robots_agree_with_shapely(signs):
    spacing, rng = 0.0625, np.random.default_rng(1)
    lower = find_farthest_lower(signs, spacing)
    boxes = draw_boxes(np.zeros(2), rng)
    workspace = Workspace.from_polygons(
        [shapely.box(*box) for box in boxes + np.tile(lower, 2)],
        spacing,
        [*lower, *(lower + CELLS * spacing)],
    )
    length, width = 0.6, 0.3
    space = cspace.build(workspace, Robot.rectangle(length, width), rotations=16, outside="free")
    q = np.column_stack([rng.uniform(0, CELLS * spacing, (2000, 2)), rng.uniform(-3, 3, 2000)])
    offset = np.array([*lower, 0.0])
    far = q + offset
    mixed = space.classify(far) == MIXED
    near = far[mixed] - offset
    body = [
        shapely.affinity.rotate(shapely.box(-0.3, -0.15, 0.3, 0.15), yaw, (0, 0), True)
        for yaw in near[:, 2]
    ]
    placed = [
        shapely.affinity.translate(part, x, y) for part, (x, y, _) in zip(body, near, strict=True)
    ]
    gaps = shapely.distance(
        np.array(placed), shapely.union_all([shapely.box(*box) for box in boxes])
    )
    answers = space.is_free(far[mixed], exact=True)
    assert answers[gaps > 1e-3].all()
    assert not answers[gaps == 0.0].any()
    assert 50 < answers.sum() < len(answers) - 50


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1)])
def test_balls_in_space_agree_with_distances(signs):
    spacing, rng = 0.0625, np.random.default_rng(2)
    lower = find_farthest_lower(signs, spacing)
    centers = lower + rng.uniform(0.5, 2.5, (8, 3))
    workspace = Workspace.from_balls(centers, 0.2, spacing, [*lower, *(lower + CELLS * spacing)])
    space = cspace.build(workspace, Robot.ball(RADIUS), outside="free")
    q = rng.uniform(lower, lower + CELLS * spacing, (3000, 3))
    q = q[space.classify(q) == MIXED]
    gaps = np.linalg.norm(q[:, None] - centers, axis=-1).min(axis=1) - 0.2 - RADIUS
    answers = space.is_free(q, exact=True)
    assert answers[gaps > 1e-3].all()
    assert not answers[gaps < 0.0].any()
    assert 50 < answers.sum() < len(answers) - 50


def test_grids_refuse_to_reach_farther():
    lower = find_farthest_lower((1, 1), 0.05)
    Grid(lower, 0.05, (CELLS, CELLS))
    with pytest.raises(cspace.InputError, match="cells from the origin"):
        Grid(lower, 0.05, (CELLS + 3, CELLS))

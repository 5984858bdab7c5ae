"""Boundaries: clipping, caps, and connected parts."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import cspace
from cspace import Robot, Workspace
from cspace._exact.boundaries import clip_to_grid, obstacle_boundary
from cspace._shapes import RoundedSimplices
from tests.helpers.strategies import examples, seeds, stars


def to_pieces(simplices):
    return RoundedSimplices(simplices, np.zeros(len(simplices)))


def compute_areas(triangles):
    return 0.5 * np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )


@examples(30)
@given(seeds)
def test_clip_keeps_the_part_in_the_box(seed):
    rng = np.random.default_rng(seed)
    grid = cspace.Grid((0.0, 0.0, 0.0), 0.5, (2, 2, 2))
    triangles = rng.uniform(-1, 2, (5, 3, 3))
    triangles[0, :, 0] = 1.0  # on a face of the box
    parts = clip_to_grid(to_pieces(triangles), grid).simplices
    assert (parts >= 0.0).all() and (parts <= 1.0).all()
    weights = rng.dirichlet(np.ones(3), 20_000)
    for triangle in triangles:
        inside = (np.abs(weights @ triangle - 0.5) <= 0.5 + 1e-9).all(axis=1).mean()
        whole = compute_areas(triangle[None])[0]
        part = clip_to_grid(to_pieces(triangle[None]), grid).simplices
        assert compute_areas(part).sum() == pytest.approx(inside * whole, abs=0.03 * whole)


@examples(80)
@given(st.lists(stars(2.0), min_size=1, max_size=3), seeds, st.booleans())
def test_boundary_of_a_clipped_polygon_agrees_with_shapely(corners, seed, rounded):
    """Include caps, and corners on the boundary of the grid."""
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-1, 2, (len(corners), 2))
    polygons = [shapely.Polygon(part + by) for part, by in zip(corners, shift, strict=True)]
    if rounded:
        polygons = [
            shapely.set_precision(shapely.set_precision(part, 0.25), 0.0) for part in polygons
        ]
    polygons = [
        part
        for part in polygons
        if part.geom_type == "Polygon" and part.intersects(shapely.box(0, 0, 1, 1))
    ]
    if not polygons:
        return
    workspace = Workspace.from_polygons(polygons, 0.25, (0, 0, 1, 1))
    for exterior_blocked in (False, True):
        pieces = obstacle_boundary(workspace, exterior_blocked=exterior_blocked).pieces
        segments = np.concatenate([part.simplices for part in pieces])
        assert (segments >= 0.0).all() and (segments <= 1.0).all()
        ours = shapely.union_all([*shapely.linestrings(segments), *shapely.points(segments[:, 0])])
        true = shapely.get_parts([part.intersection(shapely.box(0, 0, 1, 1)) for part in polygons])
        border = shapely.union_all([part.boundary if part.area else part for part in true])
        assert shapely.hausdorff_distance(ours, border, densify=0.05) < 1e-9 or exterior_blocked
        if exterior_blocked:  # the exterior decides about the boundary of the grid itself
            inner = border.intersection(shapely.box(0.01, 0.01, 0.99, 0.99))
            assert inner.difference(ours.buffer(1e-9)).is_empty


def test_clip_keeps_balls_that_reach_the_grid():
    grid = cspace.Grid((0.0, 0.0), 0.5, (2, 2))
    balls = RoundedSimplices(
        np.array([[[1.5, 0.5]], [[1.5, 1.5]], [[0.5, 0.5]], [[5.0, 0.5]]]),
        np.array([0.5, 0.6, 0.0, 1.0]),
    )
    np.testing.assert_array_equal(clip_to_grid(balls, grid).radii, [0.5, 0.0])


@pytest.mark.parametrize("excess", [0.0, 2e-10])
def test_a_wall_a_sliver_beyond_its_own_grid_is_an_obstacle(excess):
    # The grid that covers a mesh may end a billionth of a cell before its last wall.
    top = 1.0 + excess
    vertices = [(0, 0, 0), (0, top, 0), (1, top, 0), (0, top, 1), (1, top, 1)]
    workspace = Workspace.from_mesh(
        (vertices, [(1, 2, 3), (2, 4, 3), (0, 1, 3)]), 0.25, solid="surface"
    )
    assert workspace.grid.upper == (1.0, 1.0, 1.0)
    space = cspace.build(workspace, Robot.ball(0.05), outside="free")
    near, far = (0.5, 0.98, 0.5), (0.5, 0.9, 0.5)
    assert not space.exact.is_free(near) and space.exact.is_free(far)
    assert space.obstacle_distance([far]) <= 0.05 + 1e-9

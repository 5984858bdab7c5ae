"""Algebra of descriptors, against brute force, shapely and trimesh."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import convolve

from cspace import Grid, InputError, Mesh
from cspace._shapes import Balls
from cspace.spectral import (
    BallDescriptor,
    Bump,
    Descriptor,
    indicator,
    intersection,
    minkowski_sum,
    superlevel,
    union,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

dims = st.sampled_from([2, 3])


def place_on_grid(values, lower=0.0, spacing=0.5):
    """Return a descriptor with these values, the same lower coordinate on all axes."""
    values = np.asarray(values)
    return Descriptor(Grid((lower,) * values.ndim, spacing, values.shape), values)


@given(hnp.array_shapes(min_dims=2, max_dims=3, max_side=6), seeds)
def test_union_and_intersection_act_on_superlevel_sets(shape, seed):
    rng = np.random.default_rng(seed)
    values = np.where(rng.random((3, *shape)) < 0.5, rng.random((3, *shape)), 0.0)
    parts = [place_on_grid(each) for each in values]
    np.testing.assert_array_equal(superlevel(union(*parts)), (values > 0.0).any(axis=0))
    np.testing.assert_array_equal(superlevel(intersection(*parts)), (values > 0.0).all(axis=0))
    np.testing.assert_array_equal(superlevel(parts[0], values[0].max()), np.zeros(shape, bool))
    np.testing.assert_array_equal(union(*parts[:2]).values, values[0] + values[1])
    np.testing.assert_array_equal(intersection(*parts[:2]).values, values[0] * values[1])


@given(dims, seeds, st.sampled_from(["whole", "tiny", "signed"]))
def test_minkowski_sum_is_the_convolution_and_dilates_superlevel_sets(dim, seed, values):
    """Draw whole numbers, positive ones of many orders of magnitude, or numbers of any sign."""
    rng = np.random.default_rng(seed)
    shapes = rng.integers(1, 8, (2, dim))
    f, g = ((rng.random(shape) < 0.4).astype(float) for shape in shapes)
    if values == "tiny":
        # Small values drown in the rounding of a transform.
        f *= 10.0 ** rng.uniform(-250.0, 3.0, f.shape)
        g *= 10.0 ** rng.uniform(-250.0, 3.0, g.shape)
    elif values == "signed":
        f *= rng.normal(size=f.shape)
    first = place_on_grid(f, -0.3)
    second = place_on_grid(g, 1.1)
    result = minkowski_sum(first, second)
    expected = convolve(f, g, method="direct") * 0.5**dim
    if values == "whole":
        np.testing.assert_array_equal(result.values, expected)
    else:
        scale = np.abs(f).max() * g.max() * f.size + np.finfo(float).tiny
        np.testing.assert_allclose(result.values, expected, rtol=0.0, atol=1e-14 * scale + 1e-300)
    if values != "signed":
        dilated = convolve(1 * (f > 0.0), 1 * (g > 0.0), method="direct") > 0
        np.testing.assert_array_equal(superlevel(result), dilated)
    corners = first.grid.center_of(np.array(f.shape) - 1) + second.grid.center_of([0] * dim)
    center = result.grid.center_of(np.array(f.shape) - 1)
    np.testing.assert_allclose(center, corners, atol=1e-12)


@given(dims, seeds, st.sampled_from([0.3, 2.0, 25.0, math.inf]))
def test_sample_adds_the_bumps_of_all_balls(dim, seed, alpha):
    """Include balls between cell centers, beyond the border of the grid and far away."""
    rng = np.random.default_rng(seed)
    bump = Bump(alpha)
    grid = Grid((-1.0,) * dim, 0.11, (19, 17, 15)[:dim])
    centers = np.vstack([rng.uniform(-1.3, 1.3, (9, dim)), np.full((1, dim), 1e9)])
    balls = BallDescriptor(centers, rng.uniform(0.01, 0.7, 10), bump)
    axes = (grid.centers(axis) for axis in range(dim))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distances = np.linalg.norm(points[..., None, :] - centers, axis=-1) / balls.radii
    expected = bump.profile(distances).sum(axis=-1)
    np.testing.assert_allclose(balls.sample(grid).values, expected, atol=1e-12)


def test_indicator_contains_the_cell_centers_in_a_plane_shape():
    grid = Grid((-1.0, -1.0), 0.1, (20, 25))
    shape = shapely.Point(0.1, 0.2).buffer(0.6).difference(shapely.box(-0.2, -0.2, 0.2, 0.2))
    x, y = np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij")
    cells = shapely.contains_xy(shape, x, y)
    np.testing.assert_array_equal(superlevel(indicator(shape, grid)), cells)
    np.testing.assert_array_equal(superlevel(indicator(cells, grid)), cells)
    balls = Balls(np.array([[0.0, 0.0], [0.5, 0.7]]), np.array([0.5, 0.33]))
    expected = (np.hypot(x, y) <= 0.5) | (np.hypot(x - 0.5, y - 0.7) <= 0.33)
    np.testing.assert_array_equal(superlevel(indicator(balls, grid)), expected)


@pytest.mark.parametrize("spacing", [0.1, 0.125])
def test_indicator_of_a_hollow_mesh_includes_its_boundary(spacing):
    """Let faces pass through cell centers, exactly if the spacing is a power of two."""
    grid = Grid((-1.0, -1.0, -1.0), spacing, (20, 22, 24))
    half = -grid.center_of((4, 5, 5))
    hole_half = -grid.center_of((6, 6, 7))
    hole = trimesh.creation.box(extents=2.0 * hole_half)
    hole.invert()
    hollow = trimesh.util.concatenate([trimesh.creation.box(extents=2.0 * half), hole])
    axes = (grid.centers(axis) for axis in range(3))
    distances = np.abs(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    in_box = (distances < half + 1e-12).all(axis=-1)
    in_hole = (distances < hole_half - 1e-12).all(axis=-1)
    result = superlevel(indicator(Mesh.of(hollow), grid))
    np.testing.assert_array_equal(result, in_box & ~in_hole)


PLANE = place_on_grid(np.ones((3, 3)))
DISC = BallDescriptor([[0.0, 0.0]], 1.0)


@refusals(
    "ask, message",
    (lambda: union(PLANE, place_on_grid(np.ones((3, 3)), lower=0.1)), "sample all on it"),
    (lambda: union(DISC, BallDescriptor([[0.0, 0.0]], 1.0, Bump(3.0))), "they must agree"),
    (lambda: union(PLANE, DISC), "sampled on a grid"),
    (lambda: minkowski_sum(PLANE, place_on_grid(np.ones((3, 3, 3)))), "they must agree"),
    (lambda: BallDescriptor([[0.0, 0.0]], 0.0), "above zero"),
)
def test_descriptors_refuse_invalid_arguments(ask, message):
    with pytest.raises(InputError, match=message):
        ask()

"""Algebra of descriptors, against brute force."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from cspace import Grid, InputError, Mesh
from cspace.shapes import Balls
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

TINY = np.finfo(float).tiny  # tiny values stay positive


def bitmaps(dim, side=7):
    return hnp.arrays(np.bool_, hnp.array_shapes(min_dims=dim, max_dims=dim, max_side=side))


two_bitmaps = st.sampled_from([2, 3]).flatmap(lambda dim: st.tuples(bitmaps(dim), bitmaps(dim)))


def place_on_grid(values, lower=0.0, spacing=0.5):
    values = np.asarray(values)
    return Descriptor(Grid((lower,) * values.ndim, spacing, values.shape), values)


def sum_by_brute_force(f, g):
    """Add products of pairs at sums of indices."""
    shape = np.add(f.shape, g.shape) - 1
    positions = np.add.outer(
        *(np.ravel_multi_index(np.indices(each.shape), shape).ravel() for each in (f, g))
    )
    products = np.multiply.outer(f.ravel(), g.ravel())
    return np.bincount(positions.ravel(), products.ravel(), np.prod(shape)).reshape(shape)


def dilate(f, g):
    """Return the Minkowski sum of cells."""
    return sum_by_brute_force(f, g) > 0.0


@given(hnp.array_shapes(min_dims=2, max_dims=3, max_side=6), seeds)
def test_union_and_intersection_act_on_superlevel_sets(shape, seed):
    rng = np.random.default_rng(seed)
    f, g, h = (np.where(rng.random(shape) < 0.5, rng.random(shape), 0.0) for _ in range(3))
    a, b, c = place_on_grid(f), place_on_grid(g), place_on_grid(h)
    np.testing.assert_array_equal(
        superlevel(union(a, b, c)), superlevel(a) | superlevel(b) | superlevel(c)
    )
    np.testing.assert_array_equal(
        superlevel(intersection(a, b, c)), superlevel(a) & superlevel(b) & superlevel(c)
    )
    np.testing.assert_array_equal(union(a, b).values, f + g)
    np.testing.assert_array_equal(intersection(a, b).values, f * g)
    np.testing.assert_array_equal(union(a).values, f)


def test_intersections_do_not_underflow():
    tiny, smaller, normal = (
        place_on_grid(np.array([[low, -low, 0.0]])) for low in (1e-200, 1e-300, 1.0)
    )
    for other in (tiny, smaller):
        both = intersection(tiny, other)
        np.testing.assert_array_equal(np.sign(both.values), [[1.0, 1.0, 0.0]])
        np.testing.assert_array_equal(
            superlevel(intersection(both, normal)), [[True, False, False]]
        )
    np.testing.assert_array_equal(intersection(tiny, normal).values, [[1e-200, 1e-200, 0.0]])


def test_superlevel_is_strict():
    values = np.array([[0.0, 0.5], [0.5 + 1e-15, -1.0]])
    np.testing.assert_array_equal(
        superlevel(place_on_grid(values), 0.5), [[False, False], [True, False]]
    )
    np.testing.assert_array_equal(superlevel(place_on_grid(values)), [[False, True], [True, False]])
    np.testing.assert_array_equal(
        superlevel(place_on_grid(values), -1.0), [[True, True], [True, False]]
    )


@given(two_bitmaps)
def test_minkowski_sum_of_indicators_is_the_dilation(pair):
    f, g = pair
    result = minkowski_sum(place_on_grid(f), place_on_grid(g))
    np.testing.assert_array_equal(superlevel(result), dilate(f, g))
    # Sums of cells are whole numbers times the measure of a cell, exactly.
    np.testing.assert_array_equal(result.values, sum_by_brute_force(f, g) * 0.5**f.ndim)


def test_large_minkowski_sum_agrees_with_scipy_dilation():
    rng = np.random.default_rng(3)
    shape, tool = rng.random((300, 200)) < 0.01, rng.random((21, 15)) < 0.2
    result = superlevel(minkowski_sum(place_on_grid(shape), place_on_grid(tool)))
    padded = np.pad(shape, ((10, 10), (7, 7)))
    np.testing.assert_array_equal(result, ndimage.binary_dilation(padded, tool))


@pytest.mark.parametrize("dim", [2, 3])
@given(seed=seeds)
def test_minkowski_sum_neither_adds_nor_loses_cells(dim, seed):
    rng = np.random.default_rng(seed)
    # Use many orders of magnitude, so that small values drown in the rounding of a transform.
    f, g = (
        np.where(rng.random(s) < 0.3, 10.0 ** rng.uniform(-250, 3, s), 0.0)
        for s in ((6,) * dim, (4,) * dim)
    )
    result = minkowski_sum(place_on_grid(f), place_on_grid(g))
    np.testing.assert_array_equal(superlevel(result), dilate(f > 0.0, g > 0.0))
    scale = f.max() * g.max() * f.size
    expected = sum_by_brute_force(f, g) * 0.5**dim
    np.testing.assert_allclose(result.values, expected, rtol=0.0, atol=1e-14 * scale + TINY)


@given(two_bitmaps, seeds)
def test_minkowski_sum_commutes_and_translates(pair, seed):
    rng = np.random.default_rng(seed)
    f, g = (rng.normal(size=each.shape) for each in pair)
    a, b = place_on_grid(f, -0.3), place_on_grid(g, 1.1)
    one, other = minkowski_sum(a, b), minkowski_sum(b, a)
    assert one.grid.shape == other.grid.shape and one.grid.lower == pytest.approx(other.grid.lower)
    np.testing.assert_allclose(one.values, other.values, atol=1e-12)
    moved = minkowski_sum(place_on_grid(f, 2.2), b)
    np.testing.assert_allclose(moved.values, one.values, atol=1e-12)
    np.testing.assert_allclose(np.subtract(moved.grid.lower, one.grid.lower), 2.5)
    # Distributive over union.
    doubled = minkowski_sum(union(a, a), b)
    np.testing.assert_allclose(doubled.values, 2.0 * one.values, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_cell_centers_of_a_sum_are_sums_of_cell_centers(dim):
    f, g = np.zeros((4, 5, 6)[:dim]), np.zeros((3, 2, 4)[:dim])
    f[(1, 3, 2)[:dim]] = g[(2, 0, 1)[:dim]] = 1.0
    a, b = place_on_grid(f, -0.7, 0.3), place_on_grid(g, 0.4, 0.3)
    result = minkowski_sum(a, b)
    (cell,) = np.argwhere(superlevel(result))
    expected = a.grid.center_of((1, 3, 2)[:dim]) + b.grid.center_of((2, 0, 1)[:dim])
    np.testing.assert_allclose(result.grid.center_of(cell), expected, atol=1e-12)
    assert result.integral == pytest.approx(a.integral * b.integral)


@pytest.mark.parametrize("dim", [2, 3])
def test_minkowski_sum_of_two_bumps_is_their_pair_integral(dim):
    grid = Grid((-1.2,) * dim, 0.05, (48,) * dim)
    one, other = (BallDescriptor(np.zeros((1, dim)), radius).sample(grid) for radius in (1.0, 0.7))
    result = minkowski_sum(one, other)
    for shift in (0, 7, 20):
        cell = np.array([47] * dim)
        cell[0] += shift
        distance = abs(result.grid.center_of(cell)[0])
        assert result.values[tuple(cell)] == pytest.approx(
            Bump().pair_integral(1.0, 0.7, distance, dim), rel=1e-4
        )


@pytest.mark.parametrize("alpha", [0.3, 2.0, 25.0, math.inf])
@pytest.mark.parametrize("dim", [2, 3])
def test_sample_adds_the_bumps_of_all_balls(dim, alpha):
    rng = np.random.default_rng(0)
    grid = Grid((-1.0,) * dim, 0.11, (19, 17, 15)[:dim])
    # Include balls between cell centers, beyond the boundary and far away.
    centers = np.concatenate([rng.uniform(-1.3, 1.3, (20, dim)), np.full((1, dim), 1e9)])
    radii = np.concatenate([rng.uniform(0.01, 0.7, 20), [1.0]])
    balls = BallDescriptor(centers, radii, Bump(alpha))
    middles = np.stack(np.meshgrid(*(grid.centers(a) for a in range(dim)), indexing="ij"), axis=-1)
    expected = sum(
        Bump(alpha).profile(np.linalg.norm(middles - center, axis=-1) / radius)
        for center, radius in zip(centers, radii, strict=True)
    )
    np.testing.assert_allclose(balls.sample(grid).values, expected, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_integral_of_balls_agrees_with_fine_samples(dim):
    balls = BallDescriptor(
        np.random.default_rng(1).uniform(-0.5, 0.5, (8, dim)), np.linspace(0.2, 0.5, 8)
    )
    lower, upper = balls.bounds
    grid = Grid(lower, 0.02, np.ceil((upper - lower) / 0.02).astype(int))
    assert balls.sample(grid).integral == pytest.approx(balls.integral, rel=1e-4)


def test_union_of_balls_is_balls():
    one, other = (
        BallDescriptor([[0.0, 0.0]], 1.0),
        BallDescriptor([[0.5, 0.0], [2.0, 1.0]], [0.3, 0.4]),
    )
    both = union(one, other)
    grid = Grid((-1, -1), 0.1, (40, 30))
    np.testing.assert_allclose(
        both.sample(grid).values, union(one.sample(grid), other.sample(grid)).values
    )
    with pytest.raises(InputError, match="they must agree"):
        union(one, BallDescriptor([[0.0, 0.0]], 1.0, Bump(3.0)))
    with pytest.raises(InputError, match="they must agree"):
        union(one, BallDescriptor([[0.0, 0.0, 0.0]], 1.0))
    with pytest.raises(InputError, match="sampled on a grid"):
        union(one.sample(grid), other)
    with pytest.raises(InputError, match="sampled on a grid"):
        intersection(one, other)


def test_indicator_contains_the_cell_centers_in_a_shape():
    grid = Grid((-1.0, -1.0), 0.1, (20, 25))
    shape = shapely.Point(0.1, 0.2).buffer(0.6).difference(shapely.box(-0.2, -0.2, 0.2, 0.2))
    x, y = np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij")
    np.testing.assert_array_equal(
        superlevel(indicator(shape, grid)), shapely.contains_xy(shape, x, y)
    )
    np.testing.assert_array_equal(
        indicator(shapely.contains_xy(shape, x, y), grid).values, indicator(shape, grid).values
    )
    balls = Balls(np.array([[0.0, 0.0], [0.5, 0.7]]), np.array([0.5, 0.33]))
    expected = (np.hypot(x, y) <= 0.5) | (np.hypot(x - 0.5, y - 0.7) <= 0.33)
    np.testing.assert_array_equal(superlevel(indicator(balls, grid)), expected)


@pytest.mark.parametrize("spacing", [0.1, 0.125])
def test_indicator_of_a_box_includes_its_boundary(spacing):
    # Faces pass through cell centers along every axis, exactly if the spacing is a power of two.
    grid = Grid((-1.0, -1.0, -1.0), spacing, (20, 22, 24))
    middles = np.stack(np.meshgrid(*(grid.centers(a) for a in range(3)), indexing="ij"), axis=-1)
    half = -grid.center_of((5, 6, 7))
    result = superlevel(indicator(Mesh.of(trimesh.creation.box(extents=2.0 * half)), grid))
    np.testing.assert_array_equal(result, (np.abs(middles) <= half + 1e-12).all(axis=-1))
    assert result[5, 6, 7] and result.sum() == np.prod(np.round(2.0 * half / spacing) + 1.0)


def test_indicator_agrees_with_solids():
    grid = Grid((-1.0, -1.0, -1.0), 0.1, (20, 22, 24))
    middles = np.stack(np.meshgrid(*(grid.centers(a) for a in range(3)), indexing="ij"), axis=-1)
    outer, cavity = (
        trimesh.creation.box(extents=(1.0, 0.8, 0.6)),
        trimesh.creation.box(extents=(0.7, 0.5, 0.3)),
    )
    cavity.invert()
    hollow_box = trimesh.util.concatenate([outer, cavity])
    result = superlevel(indicator(Mesh.of(hollow_box), grid))
    np.testing.assert_array_equal(result, superlevel(indicator(hollow_box, grid)))
    # The boundary of the cavity, which passes through cell centers, belongs to the solid.
    within = (np.abs(middles) < np.array([0.5, 0.4, 0.3]) + 1e-12).all(axis=-1)
    hollow = (np.abs(middles) < np.array([0.35, 0.25, 0.15]) - 1e-12).all(axis=-1)
    np.testing.assert_array_equal(result, within & ~hollow)
    ball = Balls(np.array([[0.1, 0.0, 0.0]]), np.array([0.52]))
    np.testing.assert_array_equal(
        superlevel(indicator(ball, grid)),
        np.linalg.norm(middles - (0.1, 0.0, 0.0), axis=-1) <= 0.52,
    )


def test_descriptors_copy_their_arguments():
    values = np.ones((2, 3))
    result = place_on_grid(values)
    values[0, 0] = 5.0
    assert result.values[0, 0] == 1.0
    with pytest.raises(ValueError):
        result.values[0, 0] = 2.0
    with pytest.raises(ValueError):
        BallDescriptor([[0.0, 0.0]], 1.0).centers[0, 0] = 2.0


PLANE = place_on_grid(np.ones((3, 3)))


@refusals(
    "ask, match",
    (lambda: place_on_grid(np.full((2, 2), math.nan)), "must be finite"),
    (lambda: Descriptor(Grid((0, 0), 1.0, (2, 3)), np.ones((3, 2))), "values has shape"),
    (lambda: union(PLANE, place_on_grid(np.ones((3, 4)))), "sample all on it"),
    (lambda: union(PLANE, place_on_grid(np.ones((3, 3)), lower=0.1)), "sample all on it"),
    (lambda: intersection(PLANE, place_on_grid(np.ones((3, 3)), spacing=0.6)), "sample all on it"),
    (lambda: minkowski_sum(PLANE, place_on_grid(np.ones((3, 3)), spacing=0.6)), "they must agree"),
    (lambda: minkowski_sum(PLANE, place_on_grid(np.ones((3, 3, 3)))), "they must agree"),
    (lambda: minkowski_sum(PLANE, np.ones((3, 3))), "no Descriptor"),
    (lambda: superlevel(PLANE, math.nan), "threshold"),
    (lambda: superlevel(PLANE, [0.0, 1.0]), "threshold"),
    (lambda: superlevel(BallDescriptor([[0.0, 0.0]], 1.0)), "no Descriptor"),
    (
        lambda: indicator(shapely.box(0, 0, 1, 1), Grid((0, 0, 0), 1.0, (2, 2, 2))),
        "has 2 dimensions",
    ),
    (lambda: indicator(np.ones((2, 2), dtype=bool), PLANE.grid), "values has shape"),
    (lambda: indicator(np.full((3, 3), 0.5), PLANE.grid), "boolean"),
    (lambda: BallDescriptor([[0.0, 0.0]], 0.0), "above zero"),
    (lambda: BallDescriptor([[0.0, 0.0]], -1.0), "below zero"),
    (lambda: BallDescriptor([[0.0, math.nan]], 1.0), "must be finite"),
    (lambda: BallDescriptor([[0.0, 0.0]], 1.0, 2.0), "must be a Bump"),
    (lambda: BallDescriptor(np.empty((0, 2)), 1.0), "at least 1"),
    (
        lambda: BallDescriptor([[0.0, 0.0]], 1.0).sample(Grid((0, 0, 0), 1.0, (2, 2, 2))),
        "has 2 dimensions",
    ),
)
def test_descriptors_refuse_invalid_arguments(ask, match):
    with pytest.raises(InputError, match=match):
        ask()

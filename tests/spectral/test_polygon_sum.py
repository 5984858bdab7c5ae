"""Minkowski sums of polygons, against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid
from cspace.errors import GeometryError, InputError
from cspace.spectral import Descriptor, minkowski_sum
from tests.helpers.refusals import refusals
from tests.helpers.strategies import stars

eighths = st.integers(-8, 8).map(lambda n: n / 8)


def is_in_sum(first, second, points):
    """Return True for points (n, 2) in the sum: one polygon meets the mirror image of the other.

    The error of these tests is far smaller than the distance of both bounds from the sum.
    """
    mirrored = [shapely.transform(second, lambda corners, p=p: p - corners) for p in points]
    return shapely.intersects(first, mirrored)


@st.composite
def star_polygons(draw):
    """Draw a star-shaped polygon, possibly with a hole."""
    ring = draw(stars(2.0))
    center = ring.mean(axis=0)
    holes = [center + 0.3 * (ring - center)] if draw(st.booleans()) else []
    return shapely.Polygon(ring, holes)


@st.composite
def unions_of_boxes(draw):
    """Draw boxes on a lattice, so that edges of sums coincide."""
    boxes = draw(st.lists(st.tuples(eighths, eighths, eighths, eighths), min_size=1, max_size=3))
    return shapely.union_all(
        [shapely.box(min(a, c), min(b, d), max(a, c), max(b, d)) for a, b, c, d in boxes]
    )


def is_usable(geometry):
    return geometry.geom_type == "Polygon" and geometry.is_valid and geometry.area > 1e-6


polygons = (star_polygons() | unions_of_boxes()).filter(is_usable)


@settings(max_examples=80)
@given(polygons, polygons, st.integers(0, 2**16))
def test_bounds_hold(first, second, seed):
    inner, outer = minkowski_sum(first, second)
    assert inner.is_valid and outer.is_valid and outer.geom_type == "Polygon"
    rng = np.random.default_rng(seed)
    one, other = (rng.choice(shapely.get_coordinates(part), 30) for part in (first, second))
    assert shapely.intersects_xy(outer, one + other).all()
    corners = rng.permutation(shapely.get_coordinates(inner))[:20]
    middles = shapely.line_interpolate_point(inner.boundary, rng.random(20), normalized=True)
    assert is_in_sum(first, second, corners).all()
    assert is_in_sum(first, second, shapely.get_coordinates(middles)).all()
    # The two bounds are close to each other.
    largest = np.abs(outer.bounds).max()
    assert outer.area - inner.area <= 4e-9 * largest * (outer.length + 1.0)


def test_lines_points_and_collections_have_sums():
    square = shapely.box(0, 0, 1, 1)
    inner, outer = minkowski_sum(square, shapely.LineString([(0, 0), (2, 0), (2, 3)]))
    assert outer.covers(shapely.union_all([shapely.box(0, 0, 3, 1), shapely.box(2, 0, 3, 4)]))
    assert (inner.area, outer.area) == pytest.approx((6.0, 6.0), abs=1e-6)
    inner, outer = minkowski_sum(shapely.LineString([(0, 0), (1, 0)]), shapely.Point(2, 2))
    assert inner.is_empty
    assert outer.covers(shapely.LineString([(2, 2), (3, 2)])) and outer.area < 1e-6
    squares = shapely.MultiPolygon([square, shapely.box(5, 5, 6, 6)])
    assert minkowski_sum(squares, square).inner.area == pytest.approx(8.0, abs=1e-6)


def test_coordinates_may_be_large():
    rectangle = shapely.affinity.translate(shapely.box(0, 0, 2, 1), 500_000.1, 5_200_000.7)
    inner, outer = minkowski_sum(rectangle, shapely.Point(0, 0).buffer(0.4))
    assert rectangle.buffer(0.41).covers(outer)
    assert inner.covers(rectangle.buffer(0.39))


POINT = shapely.Point(0, 0)
FINE_CIRCLE = POINT.buffer(1, 4000).boundary


@refusals(
    "first, second, error, message",
    (POINT, Descriptor(Grid((0, 0), 1.0, (1, 1)), [[1.0]]), InputError, "is a Point, no Desc"),
    (shapely.Polygon(), POINT, GeometryError, "empty"),
    (FINE_CIRCLE, FINE_CIRCLE, InputError, "at most 10,000,000 are united; simplify"),
)
def test_minkowski_sum_refuses_invalid_geometries(first, second, error, message):
    with pytest.raises(error, match=message):
        minkowski_sum(first, second)

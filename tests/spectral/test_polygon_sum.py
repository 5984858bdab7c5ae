"""Minkowski sums of polygons, against exact fractions."""

from fractions import Fraction
from itertools import pairwise

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


def list_corners(ring):
    """Return the corners of a closed ring as exact fractions."""
    return [(Fraction(x), Fraction(y)) for x, y in ring.coords]


def list_edges(polygon):
    """Return the exact edges of a polygon, holes included."""
    rings = polygon.exterior, *polygon.interiors
    return [edge for ring in rings for edge in pairwise(list_corners(ring))]


def orientation(a, b, c):
    """Return 1 if c lies to the left of the line from a to b, -1 to the right, else 0."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (area > 0) - (area < 0)


def overlap_along(first, second, axis):
    """Return True if two segments overlap along an axis."""
    low = max(min(a[axis] for a in first), min(b[axis] for b in second))
    high = min(max(a[axis] for a in first), max(b[axis] for b in second))
    return low <= high


def meet(first, second):
    """Return True if two segments have a common point."""
    (a, b), (c, d) = first, second
    signs = orientation(a, b, c), orientation(a, b, d), orientation(c, d, a), orientation(c, d, b)
    if not any(signs):
        return overlap_along(first, second, 0) and overlap_along(first, second, 1)
    return signs[0] * signs[1] <= 0 and signs[2] * signs[3] <= 0


def contains(edges, point):
    """Return True if a polygon, given by its edges, contains a point."""
    inside = False
    for a, b in edges:
        if meet((a, b), (point, point)):
            return True
        if (a[1] <= point[1]) != (b[1] <= point[1]):
            inside ^= (orientation(a, b, point) > 0) == (b[1] > a[1])
    return inside


def is_in_sum(first, second, point):
    """Return True if a point lies in the sum: one polygon meets the mirror image of the other."""
    mirrored = [tuple((point[0] - x, point[1] - y) for x, y in edge) for edge in second]
    if contains(first, mirrored[0][0]) or contains(mirrored, first[0][0]):
        return True
    return any(meet(one, other) for one in first for other in mirrored)


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
def test_bounds_hold_exactly(first, second, seed):
    inner, outer = minkowski_sum(first, second)
    assert inner.is_valid and outer.is_valid and outer.geom_type == "Polygon"
    first_edges = list_edges(first)
    second_edges = list_edges(second)
    outer_edges = list_edges(outer)
    rng = np.random.default_rng(seed)
    for i, j in rng.integers((len(first_edges), len(second_edges)), size=(8, 2)):
        ax, ay = first_edges[i][0]
        bx, by = second_edges[j][0]
        assert contains(outer_edges, (ax + bx, ay + by))
    inner_edges = [edge for part in shapely.get_parts(inner) for edge in list_edges(part)]
    for k in rng.permutation(len(inner_edges))[:10]:
        a, b = inner_edges[k]
        middle = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        assert is_in_sum(first_edges, second_edges, a)
        assert is_in_sum(first_edges, second_edges, middle)
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

"""Minkowski sums of polygons, against exact fractions and Clipper."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pyclipper
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid
from cspace.errors import GeometryError, InputError
from cspace.spectral import Descriptor, minkowski_sum
from tests.helpers.refusals import refusals

NUMBERS = st.floats(-5.0, 5.0, allow_subnormal=False)
EIGHTHS = st.integers(-8, 8).map(lambda n: n / 8)


def exact_ring(ring):
    return [(Fraction(x), Fraction(y)) for x, y in list(ring.coords)]


def contains_exactly(point, polygon):
    """Return True if a polygon contains a point, exactly."""
    x, y = point
    odd = False
    for ring in (polygon.exterior, *polygon.interiors):
        for (ax, ay), (bx, by) in pairwise(exact_ring(ring)):
            turn = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
            if turn == 0 and min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
                return True
            if (ay <= y) != (by <= y):
                odd ^= (turn > 0) == (by > ay)
    return odd


def list_edges(polygon, point=None):
    """Yield exact edges of a polygon or its mirror image.

    The mirror image is moved to a point.
    """
    for ring in (polygon.exterior, *polygon.interiors):
        corners = exact_ring(ring)
        if point is not None:
            corners = [(point[0] - x, point[1] - y) for x, y in corners]
        yield from pairwise(corners)


def orientation(a, b, c):
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (area > 0) - (area < 0)


def cross(one, other):
    (a, b), (c, d) = one, other
    signs = orientation(a, b, c), orientation(a, b, d), orientation(c, d, a), orientation(c, d, b)
    if signs == (0, 0, 0, 0):
        return all(
            max(min(a[k], b[k]), min(c[k], d[k])) <= min(max(a[k], b[k]), max(c[k], d[k]))
            for k in (0, 1)
        )
    return signs[0] * signs[1] <= 0 and signs[2] * signs[3] <= 0


def is_sum(point, first, second):
    """Return True if ``point`` is in the sum, exactly."""
    mirrored = list(list_edges(second, point))
    if contains_exactly(mirrored[0][0], first):
        return True
    corner = exact_ring(first.exterior)[0]
    if contains_exactly((point[0] - corner[0], point[1] - corner[1]), second):
        return True
    return any(cross(one, other) for one in list_edges(first) for other in mirrored)


@st.composite
def polygons(draw, numbers=NUMBERS):
    """Draw a polygon, possibly with a hole."""
    count, center = draw(st.integers(3, 7)), (draw(numbers), draw(numbers))
    angles = sorted(draw(st.lists(st.floats(0, 6.28), min_size=count, max_size=count, unique=True)))
    radii = draw(st.lists(st.floats(0.05, 2.0), min_size=count, max_size=count))
    ring = [
        (center[0] + r * math.cos(a), center[1] + r * math.sin(a))
        for a, r in zip(angles, radii, strict=True)
    ]
    polygon = shapely.Polygon(ring)
    if draw(st.booleans()):
        polygon = shapely.Polygon(ring, [center + 0.3 * (np.array(ring) - center)])
    return polygon


@st.composite
def rectilinear(draw):
    """Draw boxes on a lattice, so that edges coincide."""
    boxes = draw(st.lists(st.tuples(EIGHTHS, EIGHTHS, EIGHTHS, EIGHTHS), min_size=1, max_size=3))
    ends = [(np.minimum(box[:2], box[2:]), np.maximum(box[:2], box[2:])) for box in boxes]
    return shapely.union_all([shapely.box(*low, *high) for low, high in ends if (low < high).all()])


def usable(geometry):
    return (
        geometry.geom_type == "Polygon"
        and not geometry.is_empty
        and geometry.is_valid
        and geometry.area > 1e-6
    )


def check_bounds(first, second, points):
    """Check both bounds at sums of points."""
    inner, outer = minkowski_sum(first, second)
    assert inner.is_valid and outer.is_valid and outer.geom_type == "Polygon"
    # The outer bound contains the sums of two corners.
    both = [[q for ring in list_edges(each) for q in ring] for each in (first, second)]
    for share in points:
        a, b = (corners[int(share * len(corners))] for corners in both)
        assert contains_exactly((a[0] + b[0], a[1] + b[1]), outer)
    for part in shapely.get_parts(inner):
        for ring in (part.exterior, *part.interiors):
            corners = exact_ring(ring)[:-1]
            for k, corner in enumerate(corners):
                center = tuple((x + y) / 2 for x, y in zip(corner, corners[k - 1], strict=True))
                assert is_sum(corner, first, second) and is_sum(center, first, second)
    # The two bounds are close to each other.
    far = max(abs(float(x)) for x in outer.bounds)
    assert outer.area - inner.area <= 4e-9 * far * (outer.length + 1.0)
    return inner, outer


@settings(max_examples=60)
@given(polygons(), polygons(), st.lists(st.floats(0, 0.999), min_size=8, max_size=8))
def test_bounds_hold_exactly(first, second, points):
    if usable(first) and usable(second):
        check_bounds(first, second, points)


@settings(max_examples=60)
@given(rectilinear(), rectilinear(), st.lists(st.floats(0, 0.999), min_size=8, max_size=8))
def test_bounds_hold_if_edges_coincide(first, second, points):
    if usable(first) and usable(second):
        check_bounds(first, second, points)


@settings(max_examples=30)
@given(polygons(), polygons())
def test_area_agrees_with_clipper(first, second):
    """Sum boundaries by Clipper; copies fill the interior."""
    if not (usable(first) and usable(second)):
        return
    scale, (one, other) = 2**30, [np.array(each.exterior.coords)[:-1] for each in (first, second)]
    paths = pyclipper.MinkowskiSum(
        np.rint(one * scale).astype(int), np.rint(other * scale).astype(int), True
    )
    parts = [shapely.make_valid(shapely.Polygon(np.array(path) / scale)) for path in paths]
    theirs = shapely.union_all(
        [*parts, shapely.Polygon(one + other[0]), shapely.Polygon(other + one[0])]
    )
    outer = minkowski_sum(shapely.Polygon(one), shapely.Polygon(other)).outer
    assert fill_holes(outer).symmetric_difference(fill_holes(theirs)).area < 1e-6


def fill_holes(geometry):
    """Return a geometry without its holes."""
    return shapely.union_all(
        [shapely.Polygon(part.exterior) for part in shapely.get_parts(geometry)]
    )


def test_lines_points_and_collections_have_sums():
    square = shapely.box(0, 0, 1, 1)
    inner, outer = minkowski_sum(square, shapely.LineString([(0, 0), (2, 0), (2, 3)]))
    assert outer.covers(shapely.union_all([shapely.box(0, 0, 3, 1), shapely.box(2, 0, 3, 4)]))
    assert inner.area == pytest.approx(3 + 3, abs=1e-6) and outer.area == pytest.approx(6, abs=1e-6)
    inner, outer = minkowski_sum(shapely.LineString([(0, 0), (1, 0)]), shapely.Point(2, 2))
    assert (
        inner.is_empty and outer.covers(shapely.LineString([(2, 2), (3, 2)])) and outer.area < 1e-6
    )
    both = shapely.MultiPolygon([square, shapely.box(5, 5, 6, 6)])
    assert minkowski_sum(both, square).inner.area == pytest.approx(8.0, abs=1e-6)


def test_holes_remain_unless_filled():
    frame = shapely.Polygon(shapely.box(0, 0, 3, 3).exterior, [shapely.box(1, 1, 2, 2).exterior])
    inner, outer = minkowski_sum(frame, shapely.box(-0.25, -0.25, 0.25, 0.25))
    assert (
        inner.area == pytest.approx(3.5**2 - 0.5**2, abs=1e-6)
        and len(outer.interiors) == len(inner.interiors) == 1
    )
    assert not minkowski_sum(frame, shapely.box(0, 0, 1.5, 1.5)).outer.interiors


def test_coordinates_may_be_large():
    rectangle = shapely.affinity.translate(shapely.box(0, 0, 2, 1), 500_000.1, 5_200_000.7)
    inner, outer = minkowski_sum(rectangle, shapely.Point(0, 0).buffer(0.4))
    assert (
        outer.covers(rectangle.buffer(0.3))
        and rectangle.buffer(0.41).covers(outer)
        and inner.covers(rectangle.buffer(0.39))
    )


@refusals(
    "arguments, error, expected",
    (
        (shapely.Point(0, 0), Descriptor(Grid((0, 0), 1.0, (1, 1)), [[1.0]])),
        InputError,
        "is a Point, no Desc",
    ),
    ((shapely.Polygon(), shapely.Point(0, 0)), GeometryError, "empty"),
    (
        (shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), shapely.Point(0, 0)),
        GeometryError,
        "polygons",
    ),
    (
        (shapely.Point(0, 0).buffer(1, 4000).boundary,) * 2,
        InputError,
        "at most 10,000,000 are united; simplify",
    ),
)
def test_minkowski_sum_refuses_invalid_geometries(arguments, error, expected):
    with pytest.raises(error, match=expected):
        minkowski_sum(*arguments)

"""Numbers of cases, and strategies for exteriors, robots, bitmaps and rotation cells."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.helpers.scenes import ROBOTS, Scale, draw_polygon, draw_robot


def examples(count, **options):
    """Draw ``count`` examples if all tests run, and a tenth if only the quick ones do."""
    share = settings().max_examples / settings.get_profile("all").max_examples
    return settings(max_examples=max(2, round(share * count)), **options)


def few(cases, quick=1):
    """Return parameters of a test; only the first ``quick`` ones run in the quick set."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    marks = [() if number < quick else pytest.mark.thorough for number in range(len(rows))]
    return [pytest.param(*row, marks=mark) for row, mark in zip(rows, marks, strict=True)]


seeds = st.integers(0, 2**32 - 1)
exteriors = st.sampled_from(["blocked", "free"])
L_SHAPE = [(-0.1, -0.1), (0.6, -0.1), (0.6, 0.1), (0.1, 0.1), (0.1, 0.4), (-0.1, 0.4)]
"""Corners of an asymmetric robot, in metres."""


def bitmaps(side=12):
    """Draw plane bitmaps up to ``side`` cells across."""
    return hnp.arrays(np.bool_, st.tuples(st.integers(1, side), st.integers(1, side)))


@st.composite
def stars(draw, radius=1.0):
    """Draw the vertices of a rectangle or a star-shaped polygon near the reference point."""
    rng = np.random.default_rng(draw(seeds))
    middle = draw(st.sampled_from([0.0, 0.3, 1.5])) * radius * rng.uniform(-1, 1, 2)
    polygon = draw_polygon(rng, middle, radius, Scale(1.0, draw(st.sampled_from([0.0, 0.1])), 0.0))
    return shapely.get_coordinates(polygon.exterior)[:-1]


@st.composite
def robots(draw, size=1.0, dim=2):
    """Draw robots about ``size`` across of every kind, in space without meshes."""
    rng = np.random.default_rng(draw(seeds))
    kind = draw(st.sampled_from(ROBOTS[2] if dim == 2 else ("balls", "box", "bitmap")))
    scale = Scale(size / 4.0, draw(st.sampled_from([0.0, 0.5])), 0.0)
    return draw_robot(rng, kind, rng.uniform(1.0, 8.0), scale, dim)[0]


def uniform(low, high):
    """Draw floats uniformly, because hypothesis prefers round ones."""
    return seeds.map(lambda seed: float(np.random.default_rng(seed).uniform(low, high)))


boundary_yaws = st.tuples(
    st.just("boundary"),
    st.integers(0, 11),
    st.sampled_from([0.0, math.pi, -math.pi, 2 * math.pi, -2 * math.pi]),
)
"""Boundaries of rotation cells, by number, plus half or whole turns."""


def resolve_yaw(yaw, borders):
    """Return a yaw as a float; it may be drawn as a boundary of a rotation cell."""
    return borders[yaw[1] % len(borders)] + yaw[2] if isinstance(yaw, tuple) else yaw


@st.composite
def rotation_cells(draw, max_cells=12):
    """Draw a number of rotation cells, or the boundaries of unequal cells."""
    if draw(st.booleans()):
        return draw(st.integers(1, max_cells))
    rng = np.random.default_rng(draw(seeds))
    first = draw(st.sampled_from([0.0, -math.pi, -0.3, 2.0, -6.0]))
    widths = rng.uniform(0.1, 1.0, draw(st.integers(1, max_cells)))
    return first + np.append(0.0, np.cumsum(widths) / widths.sum()) * 2 * math.pi

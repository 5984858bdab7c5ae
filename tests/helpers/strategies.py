"""Hypothesis strategies for exteriors, robots, bitmaps and rotation cells."""

import math

import numpy as np
import shapely
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cspace import Robot

seeds = st.integers(0, 2**32 - 1)
exteriors = st.sampled_from(["blocked", "free"])
L_SHAPE = [(-0.1, -0.1), (0.6, -0.1), (0.6, 0.1), (0.1, 0.1), (0.1, 0.4), (-0.1, 0.4)]
"""Corners of an asymmetric robot, in metres."""

ALIGNED_CELL_SIDE = 0.15
"""Side of the cells that some solid robots are aligned with, in metres."""


def bitmaps(side=12):
    """Draw plane bitmaps up to ``side`` cells across."""
    return hnp.arrays(np.bool_, st.tuples(st.integers(1, side), st.integers(1, side)))


@st.composite
def stars(draw, radius=1.0):
    """Draw the vertices of a star-shaped polygon near the reference point."""
    corners = draw(st.integers(3, 9))
    rng = np.random.default_rng(draw(seeds))
    gaps = rng.uniform(0.2, 1.0, corners)
    angles = np.cumsum(gaps) / gaps.sum() * 2 * math.pi
    spokes = rng.uniform(0.3, 1.0, corners) * radius
    center = rng.uniform(-1, 1, 2) * draw(st.sampled_from([0.0, 0.3, 1.5])) * radius
    vertices = center + spokes[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if draw(st.booleans()):
        vertices = np.round(vertices, 1)
    polygon = shapely.Polygon(vertices)
    if not polygon.is_valid or polygon.area < 1e-3:
        vertices = np.array([[-0.5, -0.4], [0.6, -0.4], [0.1, 0.5]]) * radius
    return vertices


@st.composite
def robots(draw, size=1.0):
    """Draw plane robots of every kind."""
    kind = draw(st.sampled_from(["disc", "rectangle", "star", "ring", "parts", "balls", "cells"]))
    rng = np.random.default_rng(draw(seeds))
    center = rng.uniform(-1, 1, 2) * size
    if kind == "disc":
        return Robot.disc(size * rng.uniform(0.1, 1.0), center)
    if kind == "rectangle":
        return Robot.rectangle(*(size * rng.uniform(0.1, 2.0, 2)), center)
    if kind == "star":
        return Robot.polygon(draw(stars(size)))
    if kind == "ring":
        hull = shapely.Point(center).buffer(size, quad_segs=3)
        return Robot.polygon(hull.difference(shapely.Point(center).buffer(size * 0.6, quad_segs=2)))
    if kind == "parts":
        return Robot.polygon(
            [shapely.Polygon(draw(stars(size / 2))), shapely.box(size, 0.0, 1.4 * size, size / 2)]
        )
    if kind == "balls":
        n = int(rng.integers(2, 6))
        return Robot.from_balls(rng.uniform(-size, size, (n, 2)), size * rng.uniform(0.1, 0.5, n))
    occupied = rng.random((int(rng.integers(1, 6)), int(rng.integers(1, 6)))) < 0.6
    occupied[0, 0] = True
    return Robot.from_bitmap(occupied, size / 4 * rng.uniform(0.5, 1.5), center)


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


@st.composite
def solid_robots(draw, size=0.4):
    """Draw solid robots and their boxes and balls (lower, upper, radius)."""
    kind = draw(st.sampled_from(["ball", "box", "balls", "cells"]))
    rng = np.random.default_rng(draw(seeds))
    center = rng.uniform(-1, 1, 3) * size
    if draw(st.booleans()):
        center = np.round(center / ALIGNED_CELL_SIDE) * ALIGNED_CELL_SIDE
    if kind == "box":
        extents = size * rng.uniform(0.1, 2.0, 3)
        return Robot.box(extents, center), [(center - extents / 2, center + extents / 2, 0.0)]
    if kind == "cells":
        occupied = rng.random(rng.integers(1, 5, 3)) < 0.5
        occupied[0, 0, 0] = True
        side = draw(st.sampled_from([ALIGNED_CELL_SIDE, 0.11]))
        lows = center + side * np.argwhere(occupied)
        return Robot.from_bitmap(occupied, side, center), [(low, low + side, 0.0) for low in lows]
    n = 1 if kind == "ball" else int(rng.integers(2, 5))
    centers, radii = (
        center + rng.uniform(-size, size, (n, 3)) * (n > 1),
        size * rng.uniform(0.1, 0.9, n),
    )
    robot = Robot.ball(radii[0], centers[0]) if n == 1 else Robot.from_balls(centers, radii)
    return robot, [(c, c, r) for c, r in zip(centers, radii, strict=True)]

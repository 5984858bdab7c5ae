"""Rasters in the plane, against exact rational arithmetic and shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cspace import Grid, InputError, Robot
from cspace.shapes import Balls, Polygons
from tests.helpers import oracles
from tests.helpers.placements import ORACLE_BAND
from tests.helpers.strategies import robots, seeds, spacings, stars

"""In metres: more than the slack of any grid used here."""


def check_between(cells, low, high):
    """Fail unless a raster has the required offsets only."""
    assert low <= cells, f"missing {sorted(low - cells)[:5]}"
    assert cells <= high, f"too many {sorted(cells - high)[:5]}"


@settings(max_examples=5)
@given(stars(0.35), st.sampled_from([0.25, 0.37]), st.sampled_from([0.0, 0.0625, 0.3]))
@example(np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]), 0.25, 0.0)
@example(np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]), 0.25, 0.25)
def test_polygon_rasters_are_exact_in_their_direction(vertices, spacing, margin):
    outer, inner = (
        oracles.raster_offsets(raster)
        for raster in Robot.polygon(vertices).rasters(spacing, margin)
    )
    reach = int(1.2 / spacing) + 2
    check_between(
        outer,
        *oracles.polygon_outer_offsets(vertices, spacing, (margin, margin + ORACLE_BAND), reach),
    )
    within = oracles.polygon_inner_offsets(vertices, spacing, reach)
    shape = shapely.Polygon(vertices)
    deep = {
        m
        for m in within
        if shape.exterior.distance(shapely.Point(np.multiply(m, spacing))) > ORACLE_BAND
    }
    check_between(inner, deep, within)


@settings(max_examples=20)
@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    st.floats(0.01, 1.0),
    st.sampled_from([0.25, 0.37]),
    st.sampled_from([0.0, 0.125]),
)
@example((0.0, 0.0), 1.0, 0.25, 0.0)
@example((0.0, 0.0), 0.5, 0.1, 0.0)
def test_disc_rasters_are_exact_in_their_direction(center, radius, spacing, margin):
    outer, inner = (
        oracles.raster_offsets(raster)
        for raster in Robot.disc(radius, center).rasters(spacing, margin)
    )
    reach = int(2.0 / spacing) + 2
    touching = oracles.disc_outer_offsets(center, radius, spacing, margin, reach)
    check_between(
        outer,
        touching,
        oracles.disc_outer_offsets(center, radius, spacing, margin + ORACLE_BAND, reach),
    )
    within = oracles.disc_inner_offsets(center, radius, spacing, reach)
    check_between(
        inner,
        oracles.disc_inner_offsets(center, max(radius - ORACLE_BAND, 0.0), spacing, reach),
        within,
    )


@settings(max_examples=40)
@given(robots(), st.sampled_from([0.1, 0.25, 0.37]), st.sampled_from([0.0, 0.2]))
def test_every_kind_of_robot_agrees_with_shapely(robot, spacing, margin):
    outer, inner = robot.rasters(spacing, margin)
    offsets = np.stack(np.meshgrid(*(np.arange(-30, 31),) * 2, indexing="ij"), axis=-1)
    low, high = (offsets - 1) * spacing, (offsets + 1) * spacing
    boxes = shapely.box(low[..., 0], low[..., 1], high[..., 0], high[..., 1])
    points = shapely.points(offsets * spacing)
    if isinstance(robot.shape, Balls):
        centers = shapely.points(robot.shape.centers)[:, None, None]
        gap = (shapely.distance(boxes, centers) - robot.shape.radii[:, None, None]).min(axis=0)
        depth = (shapely.distance(points, centers) - robot.shape.radii[:, None, None]).min(axis=0)
    else:
        gap = shapely.distance(boxes, robot.geometry)
        border = shapely.distance(points, robot.geometry.boundary)
        depth = np.where(shapely.intersects(robot.geometry, points), -border, border)
    for raster, must, may in (
        (outer, gap <= margin - 1e-9, gap <= margin + ORACLE_BAND),
        (inner, depth < -ORACLE_BAND, depth <= 0),
    ):
        members = oracles.raster_offsets(raster)
        as_set = [{tuple(m) for m in offsets[which].tolist()} for which in (must, may)]
        check_between({m for m in members if max(map(abs, m)) <= 30}, *as_set)


@given(robots(), spacings)
def test_grown_segments_obey_their_laws(robot, spacing):
    """Test that a margin only grows the outer raster."""
    outer, inner = (oracles.raster_offsets(raster) for raster in robot.rasters(spacing))
    grown, same = (oracles.raster_offsets(raster) for raster in robot.rasters(spacing, 0.15))
    assert inner <= outer <= grown
    assert same == inner


@settings(max_examples=40)
@given(seeds, st.sampled_from([0.1, 0.25, 0.33]))
def test_obstacle_cells_agree_with_shapely(seed, spacing):
    rng = np.random.default_rng(seed)
    shapes = [
        shapely.box(*np.round(rng.uniform(-3, 0, 2), 1), *np.round(rng.uniform(0.5, 3, 2), 1)),
        shapely.Point(rng.uniform(-2, 2, 2))
        .buffer(0.8)
        .difference(shapely.Point(0, 0).buffer(0.5)),
        shapely.MultiPolygon([shapely.box(1, 1, 1.5, 1.7), shapely.box(-2.5, 1, -2.1, 2.9)]),
        shapely.LineString(rng.uniform(-3, 3, (4, 2))),
        shapely.Point(rng.uniform(-2, 2, 2)),
        shapely.GeometryCollection([shapely.box(-1, -2.2, -0.7, -1.4)]),
    ]
    chosen = [shapes[i] for i in rng.permutation(len(shapes))[: rng.integers(1, 6)]]
    grid = Grid((-2.0, -1.5), spacing, (int(4 / spacing), int(3 / spacing)))
    outer, inner = Polygons(chosen).cells(grid)
    corners = (
        np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1) * spacing
        + grid.lower
    )
    cells = shapely.box(
        corners[..., 0], corners[..., 1], corners[..., 0] + spacing, corners[..., 1] + spacing
    )
    gap = np.min([shapely.distance(cells, shape) for shape in chosen], axis=0)
    assert outer[gap == 0].all()
    assert not outer[gap > ORACLE_BAND].any()
    covered = np.any([shapely.covers(shape, cells) for shape in chosen], axis=0)
    deep = np.any(
        [shapely.contains(shape.buffer(-ORACLE_BAND), cells) for shape in chosen if shape.area],
        axis=0,
    )
    assert not inner[
        ~covered & ~shapely.contains(shapely.union_all(chosen).buffer(ORACLE_BAND), cells)
    ].any()
    assert inner[deep].all()
    assert not (inner & ~outer).any()


def test_obstacles_too_far_for_the_certificate_are_refused():
    with pytest.raises(InputError, match="rounding"):
        Polygons([shapely.box(0, 0, 1e9, 1)]).cells(Grid((0, 0), 0.01, (10, 10)))


def test_a_robot_500_cells_across_costs_its_boundary():
    """Compare marked boundary cells with the diameter."""
    marked = []
    for across in (125, 250, 500):
        outer, inner = Robot.polygon(shapely.Point(0, 0).buffer(across / 2, quad_segs=64)).rasters(
            1.0
        )
        assert max(outer.cells.shape) == pytest.approx(across, abs=4)
        marked.append(outer.count - inner.count)
    assert marked[2] / marked[0] == pytest.approx(4.0, rel=0.1)

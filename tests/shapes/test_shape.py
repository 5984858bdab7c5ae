"""Laws of all shapes."""

import json

import numpy as np
import pytest
import shapely
import trimesh

from cspace import Grid, InputError, Robot, make_mesh
from cspace._rotations import RotationCell
from cspace._shapes import Balls, Box, Polygons, Voxels, as_shape, shape_from_spec
from cspace._shapes.prism import extrude
from tests.helpers.refusals import refusals

TORUS_MESH = trimesh.creation.torus(0.5, 0.2, major_sections=12, minor_sections=8)
CYLINDER = Robot.cylinder(0.4, 0.7, (0.1, 0.0, 0.2)).shape
BITS = np.random.default_rng(0).random((5, 4, 3)) < 0.6

SHAPE_BUILDERS = {
    "polygons": lambda: Polygons(
        [
            shapely.box(-1, -0.8, 0.6, 0.7).difference(shapely.box(-0.5, -0.4, 0.1, 0.2)),
            shapely.MultiPolygon([shapely.box(0.8, 0.8, 1.0, 1.1)]),
            shapely.LineString([(-1.2, 0.9), (0.3, 1.3), (0.9, 0.1)]),
            shapely.Point(1.1, -0.9),
        ]
    ),
    "robot of two parts": lambda: Polygons.of(
        [shapely.box(-1, -0.2, 0, 0.3), shapely.box(-0.3, 0.1, 0.7, 0.5)]
    ),
    "discs": lambda: Balls.of([(0.3, 0.1), (-0.4, 0.2)], [0.3, 0.5]),
    "cells of the plane": lambda: Voxels.of(BITS[..., 0], 0.31, (-0.7, -0.6)),
    "balls": lambda: Balls.of([(0.3, 0.1, 0.0), (-0.4, 0.2, 0.1)], [0.3, 0.5]),
    "points": lambda: Balls.of(np.random.default_rng(1).uniform(-1, 1, (20, 3)), 0.0),
    "many radii": lambda: Balls.of(
        np.random.default_rng(1).uniform(-1, 1, (12, 3)), np.linspace(0.1, 0.4, 12)
    ),
    "box": lambda: Box.of((1.1, 0.7, 0.5), (0.2, -0.1, 0.15)),
    "voxels": lambda: Voxels.of(BITS, 0.29, (-0.7, -0.6, -0.4)),
    "mesh": lambda: make_mesh((TORUS_MESH.vertices, TORUS_MESH.faces)),
    "cylinder": lambda: CYLINDER,
    "shadow of a cylinder": lambda: CYLINDER.project_to_plane(),
    "prism": lambda: extrude(SHAPE_BUILDERS["polygons"](), -0.31, 0.53),
    "cylinders": lambda: extrude(SHAPE_BUILDERS["discs"](), 0.13, 0.74),
    "prism with bounds": lambda: extrude(CYLINDER.project_to_plane(), -0.3, 0.4),
    "surface": lambda: make_mesh((TORUS_MESH.vertices, TORUS_MESH.faces), "surface"),
}


@pytest.fixture(params=SHAPE_BUILDERS)
def shape(request):
    return SHAPE_BUILDERS[request.param]()


def grid_around(shape, spacing=0.09):
    lower, upper = shape.outer.bounds
    lower = lower - 2.3 * spacing
    return Grid(
        lower, spacing, tuple((np.ceil((upper - lower) / spacing) + 3).astype(int).tolist())
    )


def draw_boundary_points(shape, rng, count=2000):
    """Draw points of the boundary."""
    simplices, radii = shape.outer.boundary()
    which = rng.integers(len(simplices), size=count)
    weights = rng.dirichlet(np.ones(simplices.shape[1]), count)
    direction = rng.normal(size=(count, shape.dim))
    if simplices.shape[1] == 2 and shape.dim == 3:  # axes of upright cylinders
        direction[:, 2] = 0.0
    direction *= (radii[which] / np.linalg.norm(direction, axis=1))[:, None]
    return np.einsum("nk,nkd->nd", weights, simplices[which]) + direction


def test_a_spec_restores_the_shape(shape):
    again = shape_from_spec(json.loads(json.dumps(shape.spec)))
    assert type(again) is type(shape)
    assert again.spec == shape.spec
    for mine, theirs in zip(shape.rasters(0.13, 0.05), again.rasters(0.13, 0.05), strict=True):
        assert mine.lower == theirs.lower
        assert (mine.cells == theirs.cells).all()


def test_cells_agree_with_points(shape):
    grid = grid_around(shape)
    rng = np.random.default_rng(0)
    outer, inner = shape.cells(grid)
    centers = grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))
    assert not (inner & ~outer).any()
    assert shape.inner.contains(centers)[inner].all()
    assert not shape.outer.contains(centers)[~outer].any()
    points = draw_boundary_points(shape, rng)
    if shape.inner.encloses:
        # Boundary points of a part may lie inside another part.
        assert inner.any()
    assert outer[tuple(grid.cell_of(points).T)].all()


def test_offsets_of_the_inner_raster_lie_in_the_shape(shape):
    _, inner = shape.rasters(0.09)
    if inner.count:
        assert shape.inner.contains(0.09 * (np.argwhere(inner.cells) + inner.lower)).all()


def test_the_raster_of_a_robot_equals_the_outer_cells_around_each_offset(shape):
    spacing = 0.11
    reach = int(np.ceil(max(np.abs(shape.outer.bounds).max() / spacing, 1))) + 2
    outer, _ = shape.cells(Grid((-reach * spacing,) * shape.dim, spacing, (2 * reach,) * shape.dim))
    robot, _ = shape.rasters(spacing)
    # An offset m is in the raster if any of the 2^d cells around h m meets the shape.
    expected = np.zeros((2 * reach + 1,) * shape.dim, dtype=bool)
    for corner in np.ndindex((2,) * shape.dim):
        expected[tuple(slice(c, c + 2 * reach) for c in corner)] |= outer
    raster = np.zeros_like(expected)
    start = np.add(robot.lower, reach)
    raster[tuple(slice(a, a + n) for a, n in zip(start, robot.cells.shape, strict=True))] = (
        robot.cells
    )
    assert (raster == expected).all()


def test_the_drawing_fills_the_bounds(shape):
    exact = shape.outer
    if shape.dim == 2:
        drawn = np.reshape(exact.outline.bounds, (2, 2))
    else:
        vertices, faces = exact.surface
        drawn = np.array([vertices[faces].min(axis=(0, 1)), vertices[faces].max(axis=(0, 1))])
    np.testing.assert_allclose(drawn, exact.bounds, atol=0.02)


def test_the_measure_agrees_with_random_points(shape):
    exact = shape.outer
    if np.isnan(exact.measure) or not exact.encloses:
        return
    lower, upper = exact.bounds
    points = np.random.default_rng(3).uniform(lower, upper, (20_000, shape.dim))
    share = exact.contains(points).mean()
    whole = np.prod(upper - lower)
    assert exact.measure == pytest.approx(share * whole, abs=0.02 * whole)


def test_an_asymmetric_shape_equals_itself_only_unrotated(shape):
    assert shape.is_same(np.eye(shape.dim))
    quarter = np.eye(shape.dim)
    quarter[:2, :2] = [[0, -1], [1, 0]]
    assert not shape.is_same(quarter)
    assert not shape.is_round
    same = shape.rasters(0.13, 0.0, RotationCell(np.eye(shape.dim), 0.0, about_z=True))
    for mine, theirs in zip(shape.rasters(0.13), same, strict=True):
        assert mine.lower == theirs.lower
        assert (mine.cells == theirs.cells).all()


@pytest.mark.parametrize(
    "shape, axis, same",
    [
        (Box.of((1, 1, 0.5)), 2, True),
        (Box.of((1, 1, 0.5), (0.1, 0, 0)), 2, False),
        (Voxels.of(np.ones((2, 2, 1), bool), 0.5, (-0.5, -0.5, 0.25)), 2, True),
        (Balls.of([(0, 0, 0.5), (0, 0, -0.5)], 0.2), 1, False),
        (make_mesh(trimesh.creation.box((1, 0.5, 1))), 2, False),
    ],
)
def test_quarter_turns_map_symmetric_solids_to_themselves(shape, axis, same):
    quarter = np.roll([[0, -1, 0], [1, 0, 0], [0, 0, 1]], axis - 2, axis=(0, 1)).astype(float)
    assert shape.is_same(quarter) is same


def test_contains_refuses_invalid_points():
    with pytest.raises(InputError, match="3 long"):
        Box.of((1, 1, 1)).contains(np.zeros((2, 5)))
    with pytest.raises(InputError, match="nan"):
        Box.of((1, 1, 1)).contains([np.nan] * 3)


@pytest.mark.parametrize(
    "source, radius, kind",
    [
        (shapely.box(0, 0, 1, 1), None, "polygon"),
        ({"type": "Point", "coordinates": (1.0, 2.0)}, None, "polygon"),
        ("POLYGON ((0 0, 1 0, 0 1, 0 0))", None, "polygon"),
        ("ellipse:0.5,0.3", None, "bounded"),
        ([(0, 0), (1, 0), (0, 1)], 0.2, "balls"),
        (Robot.ball(0.3), None, "balls"),
        (TORUS_MESH, None, "mesh"),
    ],
)
def test_anything_that_describes_a_shape_becomes_one(source, radius, kind):
    assert as_shape(source, radius).kind == kind


@refusals(
    "source, message",
    (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
        "points need a radius, and corners of a polygon have no height; use",
    ),
    ("robot.txt", "it must be a shorthand, WKT, or a file"),
    ((1, 1, 2, 2), "is 4 numbers; a polygon or a mesh is needed"),
    (np.arange(6.0), "is 6 numbers; a polygon or a mesh is needed"),
)
def test_other_sources_are_refused(source, message):
    with pytest.raises(InputError, match=message):
        as_shape(source)

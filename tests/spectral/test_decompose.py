"""Balls that fill or cover shapes, against shapely and sampled points."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from cspace import InputError, make_mesh
from cspace._shapes import Polygons, Voxels
from cspace.spectral import decompose
from cspace.spectral._regions import Lattice, Region, bound_balls_to_shape, bound_shape_to_balls
from tests.helpers.balls import draw_directions
from tests.helpers.oracles import distance_to_triangles, winds_around
from tests.helpers.strategies import examples, few, seeds, stars

ELL = shapely.union(shapely.box(0.0, 0.0, 2.0, 0.7), shapely.box(0.0, 0.0, 0.7, 2.0))
PLUS = shapely.union(shapely.box(-1.5, -0.5, 1.5, 0.5), shapely.box(-0.5, -1.5, 0.5, 1.5))
DISC = shapely.Point(0, 0).buffer(1.0)
FLAT = {
    "needle": shapely.Polygon([(0, 0), (5, 0.1), (5, -0.1)]),
    "ring": DISC.difference(shapely.Point(0.2, 0).buffer(0.6)),
    "parts": shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 2.3, 3)]),
    "ell": ELL,
    "tiny": shapely.box(0, 0, 3e-7, 1e-7),
}
SOLIDS = {
    "icosphere": trimesh.creation.icosphere(subdivisions=1),
    "torus": trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12),
    "plate": trimesh.creation.box((1.0, 1.0, 0.05)),
}
kinds = st.sampled_from(["inner", "outer"])


def measure_gaps(points, balls):
    """Return the distances of points (n, d) from balls, negative inside."""
    return (cdist(points, balls.centers) - balls.radii).min(axis=1)


def measure_polygon(shape):
    """Return the diagonal of the bounding box of a polygon."""
    return float(np.hypot(*np.ptp(np.array(shape.bounds).reshape(2, 2), axis=0)))


def check_plane(balls, shape, rng):
    """Check all claims about balls of a polygon, with points of it and of the circles."""
    size = measure_polygon(shape)
    low, high = balls.hausdorff
    x, y = rng.uniform(shape.bounds[:2], shape.bounds[2:], (3000, 2)).T
    inside = shapely.contains_xy(shape, x, y)
    boundary = shapely.segmentize(shape.boundary, size / 300)
    points = np.vstack([np.transpose([x, y])[inside], shapely.get_coordinates(boundary)])
    gaps = measure_gaps(points, balls)
    # Polygons with many corners are inscribed in the discs.
    centers = shapely.points(balls.centers)
    discs = shapely.union_all(shapely.buffer(centers, balls.radii, quad_segs=64))
    assert balls.measure.lower * (1.0 - 1e-3) <= discs.area <= balls.measure.upper * (1.0 + 1e-9)
    assert balls.measure.upper - balls.measure.lower <= 1e-4 * balls.measure.upper
    assert balls.volume_ratio == pytest.approx(discs.area / shape.area, rel=1e-3)
    if balls.kind == "inner":
        depths = shapely.distance(centers, shape.boundary)
        assert shapely.covers(shape, centers).all()
        assert (balls.radii <= depths + 1e-15 * size).all()
        assert gaps.max() <= high
        assert 0.0 <= low <= high <= gaps.max() + 0.05 * size
    else:
        assert gaps.max() <= 0.0
        circles = balls.centers[:, None] + balls.radii[:, None, None] * draw_directions(rng, 60, 2)
        out = shapely.distance(shapely.points(circles), shape)
        assert out.max() <= high + 1e-12 * size
        assert 0.0 <= low <= out.max() + 0.05 * size


@pytest.mark.parametrize("kind", ["inner", "outer"])
@pytest.mark.parametrize("name", few(FLAT, 2))
def test_balls_fill_or_cover_plane_shapes(name, kind):
    shape = FLAT[name]
    rng = np.random.default_rng(0)
    balls = decompose(shape, kind=kind, number=40)
    assert len(balls) <= 40
    check_plane(balls, shape, rng)
    tolerance = 0.03 * measure_polygon(shape)
    balls = decompose(shape, kind=kind, tolerance=tolerance)
    assert balls.hausdorff.upper <= tolerance
    check_plane(balls, shape, rng)


@pytest.mark.parametrize(
    "shape, options, most, distance",
    [
        (shapely.box(0, 0, 1, 1), {"number": 4}, 4, 0.11),
        (shapely.box(0, 0, 2, 0.4), {"number": 2}, 2, 0.36),
        (PLUS, {"number": 9}, 9, 0.18),
        (trimesh.creation.box((2.0, 1.0, 1.0)), {"tolerance": 0.4}, 2, 0.4),
        pytest.param(
            *(trimesh.creation.box((2.0, 1.0, 1.0)), {"number": 3}, 3, 0.4),
            marks=pytest.mark.thorough,
        ),
    ],
    ids=["square", "bar", "plus", "box", "three in a box"],
)
def test_few_balls_are_arranged_well(shape, options, most, distance):
    balls = decompose(shape, kind="outer", **options)
    assert len(balls) <= most
    assert balls.hausdorff.upper <= distance


@pytest.mark.thorough
@examples(30)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=3) | stars(),
    kinds,
    st.floats(0.02, 0.3),
    seeds,
)
@example([(0, 0), (1, 0.3), (1, 0.35)], "outer", 0.1 / math.hypot(1.0, 0.35), 0)
def test_balls_meet_the_tolerance(vertices, kind, share, seed):
    shape = shapely.Polygon(vertices)
    tolerance = share * measure_polygon(shape)
    assume(shape.is_valid and shape.area > 1e-3 * measure_polygon(shape) ** 2)
    try:
        balls = decompose(vertices, kind=kind, tolerance=tolerance)
    except InputError as error:
        assert kind == "inner" and error.argument in {"shape", "tolerance"}
        return
    assert balls.hausdorff.upper <= tolerance
    check_plane(balls, shape, np.random.default_rng(seed))


def check_solid(balls, mesh, rng):
    """Check all claims about balls of a closed mesh, with points of it and of the spheres."""
    triangles = np.asarray(mesh.triangles)
    points = rng.uniform(*mesh.bounds, (400, 3))
    points = points[winds_around(points, triangles)]
    gaps = measure_gaps(np.vstack([mesh.sample(2000, seed=0), mesh.vertices, points]), balls)
    if balls.kind == "inner":
        depths = distance_to_triangles(balls.centers, triangles)
        assert winds_around(balls.centers, triangles).all()
        assert (balls.radii <= depths + 1e-12).all()
        assert balls.hausdorff.lower - 0.05 <= gaps.max() <= balls.hausdorff.upper
    else:
        assert gaps.max() <= 0.0
        chosen = rng.integers(len(balls), size=300)
        rim = balls.centers[chosen] + balls.radii[chosen, None] * draw_directions(rng, 300, 3)
        rim = rim[~winds_around(rim, triangles)]
        assert distance_to_triangles(rim, triangles).max() <= balls.hausdorff.upper
    low = (balls.centers - balls.radii[:, None]).min(axis=0)
    high = (balls.centers + balls.radii[:, None]).max(axis=0)
    share = (measure_gaps(rng.uniform(low, high, (20_000, 3)), balls) <= 0.0).mean()
    volume = share * float(np.prod(high - low))
    assert 0.93 * balls.measure.lower <= volume <= 1.07 * balls.measure.upper


@pytest.mark.parametrize("kind", ["inner", "outer"])
@pytest.mark.parametrize("name", few(SOLIDS, 2))
def test_balls_fill_or_cover_solids(name, kind):
    mesh = SOLIDS[name]
    tolerance = 0.08 * float(np.linalg.norm(mesh.extents))
    balls = decompose(mesh, kind=kind, tolerance=tolerance)
    assert balls.hausdorff.upper <= tolerance
    check_solid(balls, mesh, np.random.default_rng(0))


def test_balls_cover_open_surfaces_lines_and_cells():
    sheet = trimesh.Trimesh([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.2]], [[0, 1, 2]])
    balls = decompose(make_mesh(sheet, "surface"), kind="outer", tolerance=0.1)
    assert measure_gaps(sheet.sample(2000, seed=0), balls).max() <= 0.0
    assert balls.hausdorff.upper <= 0.1
    assert math.isinf(balls.volume_ratio)
    line = shapely.LineString([(0, 0), (1, 2), (3, 2)])
    balls = decompose(line, kind="outer", number=30)
    points = shapely.get_coordinates(shapely.segmentize(line, 0.01))
    assert measure_gaps(points, balls).max() <= 0.0
    assert balls.hausdorff.upper <= 0.15
    cells = np.random.default_rng(0).random((5, 4)) < 0.6
    balls = decompose(Voxels.of(cells, 0.1, (0.3, -2.0)), kind="outer", number=40)
    corners = np.argwhere(cells)[:, None] + [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert measure_gaps((0.3, -2.0) + 0.1 * corners.reshape(-1, 2), balls).max() <= 0.0


def test_balls_fill_the_hollow_of_an_open_mesh():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    # Six faces with gaps along the edges enclose nothing.
    corners = box.triangles + 0.001 * box.face_normals[:, None]
    faces = np.arange(36).reshape(12, 3)
    mesh = make_mesh(trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False), "surface")
    assert not mesh.is_watertight
    balls = decompose(mesh, kind="outer", number=1)
    # The point farthest from the faces, in the middle, lies 0.501 from them. The mesh still has no
    # inside, so the ball sticks out as far into it.
    low, high = balls.hausdorff
    assert low <= 0.501 <= high <= 0.515
    assert measure_gaps(corners.reshape(-1, 3), balls).max() <= 0.0


@pytest.mark.parametrize("seed", range(3))
def test_balls_stick_out_within_near_bounds(seed):
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-1.0, 1.0, (4, 2))
    radii = rng.uniform(0.1, 1.5, 4)
    low, high = bound_balls_to_shape(Region(Polygons.of(ELL)), centers, radii)
    discs = shapely.union_all(
        [shapely.Point(*c).buffer(r, 256) for c, r in zip(centers, radii, strict=True)]
    )
    exact = shapely.distance(shapely.points(shapely.get_coordinates(discs)), ELL).max()
    assert low <= exact + 1e-4
    assert exact <= high <= 1.03 * exact


def test_foil_is_filled():
    foil = trimesh.creation.box((1.0, 1.0, 0.002))
    balls = decompose(foil, kind="inner", tolerance=0.1)
    assert balls.hausdorff.upper <= 0.1
    assert (np.abs(balls.centers[:, 2]) + balls.radii <= 0.001).all()


def test_distance_of_a_sheet_from_balls_has_near_bounds():
    corners = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.4, 0.8, 0.0)])
    sheet = make_mesh(trimesh.Trimesh(corners, [[0, 1, 2]]), "surface")
    lattice = Lattice.for_count(Region(sheet), 3)
    low, high, _ = bound_shape_to_balls(lattice, corners, np.full(3, 0.1))
    # The point farthest from the corners is the center of their circle.
    a, b, c = np.linalg.norm(np.roll(corners, 1, axis=0) - corners, axis=1)
    exact = a * b * c / (4.0 * 0.4) - 0.1
    assert low <= exact <= high <= 1.03 * low

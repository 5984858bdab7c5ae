"""Balls that fill or cover shapes, against shapely."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from cspace import InputError
from cspace.cli.demo import floor_plan
from cspace.shapes import Mesh, Voxels
from cspace.spectral import decompose
from cspace.spectral.regions import bound_ball_measure, cube_gaps
from tests.helpers.oracles import distance_to_triangles, sample_surface, winds_around
from tests.helpers.strategies import seeds, stars

RECTANGLE = shapely.box(0.0, 0.0, 3.0, 1.0)
ELL = shapely.union(shapely.box(0.0, 0.0, 2.0, 0.7), shapely.box(0.0, 0.0, 0.7, 2.0))


def spiked(corners, inner, hole=0.0):
    angles = np.pi * np.arange(2 * corners) / corners
    spokes = np.where(np.arange(2 * corners) % 2, 1.0, inner)
    shape = shapely.Polygon(np.stack([spokes * np.cos(angles), spokes * np.sin(angles)], axis=1))
    return shape.difference(shapely.box(-hole, -hole, hole, hole)) if hole else shape


def bitmap(shape, seed, part=0.6):
    return np.random.default_rng(seed).random(shape) < part


def to_cells(cells, spacing, lower=(0.0, 0.0)):
    corners = np.argwhere(cells)
    whole = shapely.union_all(shapely.box(*corners.T, *(corners + 1).T))
    return shapely.transform(whole, lambda points: points * spacing + np.asarray(lower))


BALL_KINDS = ["inner", "outer"]
BITMAPS = {"bitmap": bitmap((12, 9), 0), "thin bitmap": bitmap((30, 4), 1, 0.8)}
FLAT = {
    "rectangle": RECTANGLE,
    "ell": ELL,
    "square": shapely.box(-5.0, 2.0, -4.0, 3.0),
    "triangle": shapely.Polygon([(0, 0), (4, 0), (1, 2)]),
    "needle": shapely.Polygon([(0, 0), (5, 0.1), (5, -0.1)]),
    "star": spiked(7, 0.4),
    "star with a hole": spiked(9, 0.6, 0.3),
    "ring": shapely.Point(0, 0).buffer(1.0).difference(shapely.Point(0.2, 0).buffer(0.6)),
    "parts": shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 2.3, 3)]),
    "overlapping": [shapely.box(0, 0, 2, 1), shapely.box(1, 0.5, 3, 2)],
    "tiny": shapely.box(0, 0, 3e-7, 1e-7),
}
SOLIDS = {
    "box": trimesh.creation.box((1.0, 0.6, 0.4)),
    "icosphere": trimesh.creation.icosphere(subdivisions=1),
    "torus": trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12),
    "cone": trimesh.creation.cone(0.5, 1.2, sections=16),
    "plate": trimesh.creation.box((1.0, 1.0, 0.02)),
}
OPTIONS = {"number": {"number": 40}, "few": {"number": 7}, "tolerance": {"part": 0.03}}
LOOSE = {"part": 0.08}
"""A tolerance relative to the size of the shape; searching for a number of balls tries many
tolerances, which is slow.
"""


def make_balls(shape, size, kind, limit):
    """Decompose a shape, and check its limit."""
    options = {name: value for name, value in limit.items() if name != "part"}
    if "part" in limit:
        options["tolerance"] = limit["part"] * size
    balls = decompose(shape, kind=kind, **options)
    if "number" in limit:
        assert len(balls) <= limit["number"]
    else:
        assert balls.hausdorff.upper <= options["tolerance"]
    return balls


def diagonal(shape):
    return float(np.hypot(*np.ptp(np.array(shape.bounds).reshape(2, 2), axis=0)))


def sample_shape(shape, rng, number=4000):
    """Sample points inside and on a plane shape."""
    low, high = np.array(shape.bounds).reshape(2, 2)
    points = rng.uniform(low, high, (number, 2))
    border = shapely.boundary(shape)
    along = shapely.line_interpolate_point(
        shapely.get_parts(border)[:, None], rng.random(500)[None], normalized=True
    ).ravel()
    return np.vstack(
        [
            points[shapely.contains_xy(shape, *points.T)],
            shapely.get_coordinates(along),
            shapely.get_coordinates(shape),
        ]
    )


def measure_gaps(points, balls):
    """Return distances to balls, negative inside."""
    return (cdist(points, balls.centers) - balls.radii).min(axis=1)


def check_plane(balls, shape, rng):
    size = diagonal(shape)
    points = sample_shape(shape, rng)
    low, high = balls.hausdorff
    assert 0.0 <= low <= high
    # Polygons with many corners are inscribed in the discs and circumscribed about them.
    count = 64
    inner = shapely.union_all(
        shapely.buffer(shapely.points(balls.centers), balls.radii, quad_segs=count)
    )
    sag = 1.0 / math.cos(math.pi / (4 * count))
    outer = shapely.union_all(
        shapely.buffer(shapely.points(balls.centers), balls.radii * sag, quad_segs=count)
    )
    if len(balls) < 200:
        assert inner.area <= balls.measure.upper * (1 + 1e-9)
        assert outer.area >= balls.measure.lower * (1 - 1e-9)
    assert balls.volume_bounds.upper - balls.volume_bounds.lower <= 1e-4 * balls.volume_ratio
    if balls.kind == "inner":
        centers = shapely.points(balls.centers)
        assert shapely.covers(shape, centers).all()
        assert (
            balls.radii <= shapely.distance(centers, shapely.boundary(shape)) + 1e-15 * size
        ).all()
        assert shapely.within(inner, shape.buffer(1e-9 * size))
        gap = float(measure_gaps(points, balls).max())
        assert gap <= high
        assert low <= high <= gap + 0.05 * size
        assert balls.volume_bounds.upper <= 1.0 + 1e-9
    else:
        assert (measure_gaps(points, balls) <= 0.0).all()
        assert shape.difference(outer).area <= 1e-12 * size**2
        around = np.linspace(0.0, 2 * np.pi, 60)
        rim = balls.centers[:, None] + balls.radii[:, None, None] * np.stack(
            [np.cos(around), np.sin(around)], -1
        )
        gap = float(shapely.distance(shapely.points(rim), shape).max())
        assert gap <= high + 1e-12 * size
        assert low <= gap + 0.05 * size


@pytest.mark.parametrize("kind", BALL_KINDS)
@pytest.mark.parametrize("limit", ["number", "tolerance"])
@pytest.mark.parametrize("name", FLAT)
def test_balls_bound_plane_shapes(name, kind, limit):
    shape = FLAT[name]
    whole = shapely.union_all(shape) if isinstance(shape, list) else shape
    balls = make_balls(shape, diagonal(whole), kind, OPTIONS[limit])
    check_plane(balls, whole, np.random.default_rng(0))


@pytest.mark.parametrize("kind", BALL_KINDS)
@pytest.mark.parametrize("name", BITMAPS)
def test_balls_bound_bitmaps(name, kind):
    cells, lower = BITMAPS[name], (0.3, -2.0)
    balls = decompose(Voxels.of(cells, 0.1, lower), kind=kind, number=40)
    check_plane(balls, to_cells(cells, 0.1, lower), np.random.default_rng(0))


@pytest.mark.parametrize("kind", BALL_KINDS)
def test_balls_bound_a_large_bitmap(kind):
    x, y = np.mgrid[:700, :500]
    cells = (x - 350) ** 2 / 3 + (y - 250) ** 2 < 150**2
    balls = decompose(Voxels.of(cells, 0.01), kind=kind, number=10)
    points = (np.argwhere(cells) + np.random.default_rng(0).random((int(cells.sum()), 2))) * 0.01
    near = measure_gaps(points, balls)
    assert balls.volume_ratio > 0.85
    assert near.max() <= (balls.hausdorff.upper if kind == "inner" else 0.0)


def test_64_balls_fill_most_of_a_shape():
    balls = decompose(ELL, number=64)
    discs = shapely.union_all(
        shapely.buffer(shapely.points(balls.centers), balls.radii, quad_segs=64)
    )
    assert discs.area / ELL.area > 0.98
    assert balls.volume_ratio == pytest.approx(discs.area / ELL.area, abs=1e-3)


@settings(max_examples=6)
@given(stars(), st.sampled_from(BALL_KINDS), st.sampled_from(list(OPTIONS.values())), seeds)
def test_balls_bound_random_polygons(vertices, kind, limit, seed):
    shape = shapely.Polygon(vertices)
    check_plane(
        make_balls(vertices, diagonal(shape), kind, limit), shape, np.random.default_rng(seed)
    )


@settings(max_examples=40)
@example([(0, 0), (1, 0.3), (1, 0.35)], "outer", 0.1 / math.hypot(1.0, 0.35), 0)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=3)
    | st.tuples(st.floats(-1, 1), st.floats(0.003, 0.1)).map(
        lambda each: [(0, 0), (1, each[0]), (1, sum(each))]
    )
    | stars(),
    st.sampled_from(BALL_KINDS),
    st.floats(0.02, 0.3),
    seeds,
)
def test_balls_meet_the_tolerance(vertices, kind, part, seed):
    shape = shapely.Polygon(vertices)
    assume(shape.is_valid and shape.area > 1e-3 * diagonal(shape) ** 2)
    try:
        balls = make_balls(shape, diagonal(shape), kind, {"part": part})
    except InputError as error:
        assert kind == "inner" and error.argument in {"shape", "tolerance"}
    else:
        check_plane(balls, shape, np.random.default_rng(seed))


def check_solid(balls, mesh, rng):
    triangles = np.asarray(mesh.triangles)
    size = float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)))
    low, high = mesh.bounds
    surface = np.vstack([sample_surface(triangles, 3000, rng), np.asarray(mesh.vertices)])
    points = rng.uniform(low, high, (400, 3))
    points = np.vstack([surface, points[winds_around(points, triangles)]])
    near = measure_gaps(points, balls)
    if balls.kind == "inner":
        assert winds_around(balls.centers, triangles).all()
        assert (balls.radii <= distance_to_triangles(balls.centers, triangles) + 1e-12 * size).all()
        assert near.max() <= balls.hausdorff.upper
        assert balls.hausdorff.lower <= near.max() + 0.05 * size
        assert balls.volume_bounds.lower <= 1.0
    else:
        assert (near <= 0.0).all()
        turns = rng.normal(size=(20, 3))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        rim = (balls.centers[:, None] + balls.radii[:, None, None] * turns).reshape(-1, 3)
        rim = rim[rng.choice(len(rim), min(300, len(rim)), replace=False)]
        out = np.where(winds_around(rim, triangles), 0.0, distance_to_triangles(rim, triangles))
        assert out.max() <= balls.hausdorff.upper
        assert balls.volume_bounds.upper >= 1.0 - 1e-9
    held = rng.uniform(low - 0.3, high + 0.3, (30_000, 3))
    share = (measure_gaps(held, balls) <= 0.0).mean() * float(np.prod(high - low + 0.6))
    if (balls.centers - balls.radii[:, None] > low - 0.3).all():
        assert balls.measure.lower * 0.93 - 0.02 <= share <= balls.measure.upper * 1.07 + 0.02


@pytest.mark.parametrize("kind", BALL_KINDS)
@pytest.mark.parametrize("name", SOLIDS)
def test_balls_bound_solids(name, kind):
    mesh, limit = SOLIDS[name], OPTIONS["number"] if name == "icosphere" else LOOSE
    balls = make_balls(mesh, float(np.linalg.norm(mesh.extents)), kind, limit)
    check_solid(balls, mesh, np.random.default_rng(0))


@pytest.mark.parametrize("kind", BALL_KINDS)
def test_balls_bound_voxels(kind):
    cells = bitmap((6, 5, 7), 3)
    balls = decompose(Voxels.of(cells, 0.2), kind=kind, tolerance=0.15)
    points = (np.argwhere(cells)[:, None] + np.random.default_rng(1).random((60, 3))).reshape(
        -1, 3
    ) * 0.2
    corners = (np.argwhere(cells)[:, None] + np.argwhere(np.ones((2, 2, 2)))).reshape(-1, 3) * 0.2
    near = measure_gaps(np.vstack([points, corners]), balls)
    assert near.max() <= (balls.hausdorff.upper if kind == "inner" else 0.0)
    if kind == "inner":
        turns = np.random.default_rng(2).normal(size=(200, 3))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        rim = (balls.centers[:, None] + 0.999999 * balls.radii[:, None, None] * turns).reshape(
            -1, 3
        )
        assert cells[tuple(np.floor(rim / 0.2).astype(int).T)].all()


def test_balls_cover_open_surfaces_and_lines():
    sheet = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0.2]]), np.array([[0, 1, 2]]), "surface")
    balls = decompose(sheet, kind="outer", tolerance=0.1)
    assert (
        measure_gaps(sample_surface(sheet.triangles, 5000, np.random.default_rng(0)), balls) <= 0.0
    ).all()
    assert math.isinf(balls.volume_ratio)
    assert balls.hausdorff.upper <= 0.1
    line = shapely.LineString([(0, 0), (1, 2), (3, 2)])
    balls = decompose(line, kind="outer", number=30)
    along = shapely.get_coordinates(
        shapely.line_interpolate_point(line, np.linspace(0, 1, 999), normalized=True)
    )
    assert (measure_gaps(along, balls) <= 0.0).all()
    assert len(balls) <= 30 and balls.hausdorff.upper <= 0.15


def test_inner_balls_avoid_the_cavity_of_a_hollow_mesh():
    hull, hole = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((0.6, 0.6, 0.6))
    hole.invert()
    hollow = trimesh.util.concatenate([hull, hole])
    balls = decompose(hollow, tolerance=0.15)
    away = np.linalg.norm(np.maximum(np.abs(balls.centers) - 0.3, 0.0), axis=1)
    assert (balls.radii <= away).all()
    assert (balls.radii <= 0.5 - np.abs(balls.centers).max(axis=1)).all()
    assert balls.shape_measure.lower <= 1 - 0.6**3 <= balls.shape_measure.upper


NEAR = {
    "ell": (ELL, 0.1),
    "torus": (SOLIDS["torus"], 0.15),
    "capsule": (trimesh.creation.capsule(1.0, 0.3, count=[8, 8]), 0.06),
}


@pytest.mark.parametrize(
    ("name", "kind"), [("ell", "inner"), ("ell", "outer"), ("torus", "inner"), ("capsule", "outer")]
)
def test_more_balls_are_nearer_and_as_near_as_with_a_tolerance(name, kind):
    shape, tolerance = NEAR[name]
    within = decompose(shape, kind=kind, tolerance=tolerance)
    enough = math.ceil(1.1 * len(within))
    numbers = sorted({6, enough, 24} if name in FLAT else {6, enough})
    found = {
        number: decompose(shape, kind=kind, number=number).hausdorff.upper for number in numbers
    }
    assert found[enough] <= tolerance
    # Bounds of a distance differ by up to 2 %.
    distances = np.array(list(found.values()))
    assert (np.diff(distances) <= 0.02 * distances[:-1]).all()
    assert distances[-1] < 0.7 * distances[0]


def test_bounds_of_the_distance_are_tight_for_many_balls():
    low, high = decompose(SOLIDS["torus"], number=80).hausdorff
    assert low <= high <= 1.03 * low


@given(dim=st.sampled_from([2, 3]), number=st.integers(1, 60), seed=seeds)
def test_cubes_are_measured_against_all_balls(dim, number, seed):
    rng = np.random.default_rng(seed)
    points, centers = rng.uniform(-1.2, 1.2, (40, dim)), rng.uniform(-1.0, 1.0, (number, dim))
    radii, half = rng.uniform(-0.2, 0.3, number), rng.choice([0.0, 0.01, 0.3])
    near, far, owners = cube_gaps(points, half, centers, radii)
    offsets = np.abs(points[:, None] - centers)
    growths = np.linalg.norm(offsets + half, axis=2) - radii
    assert near == pytest.approx((np.linalg.norm(offsets, axis=2) - radii).min(axis=1), abs=1e-12)
    assert growths[np.arange(40), owners] == pytest.approx(far, abs=1e-12)


def test_decompose_is_deterministic():
    one, other = (decompose(ELL, number=20) for _ in range(2))
    assert (one.centers == other.centers).all()
    assert (one.radii == other.radii).all()


@pytest.mark.parametrize("shape", [RECTANGLE, shapely.box(0.25, 0.5, 3.25, 1.5)])
def test_decompose_accepts_geojson_wkt_and_vertices(shape):
    by_shape = decompose(shape, number=5)
    for same in (shape.wkt, json.loads(shapely.to_geojson(shape)), np.array(shape.exterior.coords)):
        assert np.allclose(decompose(same, number=5).radii, by_shape.radii)


def test_area_bounds_hold_for_nearly_touching_discs():
    """Test circles whose angles lose digits.

    The area changes at most by the boundary length times the change of radii.
    """
    rng = np.random.default_rng(0)
    for _ in range(30):
        u = np.exp(1j * rng.uniform(0.0, 6.28))
        one, two, three = rng.uniform(0.3, 3.0, 3)
        center = complex(*rng.uniform(-5.0, 5.0, 2))
        gap = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-17.0, -13.0)
        beside = center + u * (one + rng.choice([-1.0, 1.0]) * two + gap)
        # The boundary of the third disc passes through the point of contact.
        through = center + u * one + three * np.exp(1j * rng.uniform(0.0, 6.28))
        centers = np.array([[p.real, p.imag] for p in (center, beside, through)])
        radii = np.array([one, two, three])
        change = 3e-13
        less, same, more = (
            bound_ball_measure(centers, radii * (1.0 + s * change)) for s in (-1.0, 0.0, 1.0)
        )
        boundary = 2.0 * np.pi * float((radii**2).sum()) * change
        assert less[0] <= same[1] and same[0] <= more[1]
        assert same[0] - boundary <= less[1] and more[0] <= same[1] + boundary
        assert same[1] - same[0] <= 1e-4 * same[0]


def test_area_bounds_hold_for_nearly_coincident_discs():
    for gaps in ([0.0, 0.0], [1e-17, 1e-13], [1e-9, 1e-8], [1e-7, -1e-7]):
        centers = np.array([[0.0, 0.0], *([gap, 0.5 * gap] for gap in gaps)])
        low, high = bound_ball_measure(centers, np.ones(3))
        spread = math.hypot(1.0, 0.5) * (max(0.0, *gaps) - min(0.0, *gaps))
        assert low <= math.pi + 2.0 * spread and math.pi <= high
        assert high - low <= 1e-4
    grid = np.stack(np.meshgrid(np.arange(12.0), np.arange(12.0)), axis=-1).reshape(-1, 2)
    low, high = bound_ball_measure(grid, np.full(144, 0.5))
    assert low <= 36.0 * math.pi <= high <= low * (1.0 + 1e-3)
    # The four discs at the corners of a square meet in its center, opposite discs just touching.
    low, high = bound_ball_measure(grid, np.full(144, math.sqrt(0.5)))
    assert low <= 121.0 + 44.0 * (math.pi / 8.0 + 0.25) + 4.0 * math.pi / 8.0 <= high
    assert high <= low * (1.0 + 1e-3)


# ---- real shapes ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", BALL_KINDS)
def test_balls_bound_the_bundled_floor_plan(kind):
    shape = shapely.union_all(floor_plan())
    check_plane(decompose(shape, kind=kind, number=200), shape, np.random.default_rng(0))


@pytest.mark.parametrize("kind", BALL_KINDS)
def test_balls_bound_real_polygons(data, kind):
    folder = data / "polygons"
    cars = json.loads((folder / "parking1.geojson").read_text())["features"]
    shapes = [shapely.geometry.shape(car["geometry"]) for car in cars[::4]]
    for shape in (shapely.from_geojson((folder / "car.geojson").read_text()), *shapes):
        check_plane(
            make_balls(shape, diagonal(shape), kind, LOOSE), shape, np.random.default_rng(0)
        )


@pytest.mark.parametrize("kind", BALL_KINDS)
@pytest.mark.parametrize("name", ["ZTunnel/obstacles.obj", "LTunnel/l-robot.obj"])
def test_balls_bound_real_meshes(data, name, kind):
    mesh = Mesh.of(data / "solids" / name)
    corners = SimpleNamespace(triangles=mesh.triangles, vertices=mesh.vertices, bounds=mesh.bounds)
    balls = make_balls(mesh, float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))), kind, LOOSE)
    check_solid(balls, corners, np.random.default_rng(0))

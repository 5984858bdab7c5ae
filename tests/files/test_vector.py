"""Obstacles from shapely geometries, GeoJSON and WKT."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import box, mapping

import cspace
from cspace import Grid, Robot, Workspace
from cspace.errors import FileError, GeometryError, InputError
from cspace.files.vector import read_shapes
from tests.helpers.refusals import refusals

L_SHAPE = shapely.Polygon([(0.1, 0.1), (2.9, 0.1), (2.9, 0.9), (0.9, 0.9), (0.9, 1.9), (0.1, 1.9)])
FAR = box(4.0, 0.25, 6.0, 1.75)
BOTH = shapely.MultiPolygon([L_SHAPE, FAR])


def check_cells(workspace, shapes):
    """Fail unless outer cells meet shapes and inner cells lie in one, by shapely."""
    grid = workspace.grid
    corners = np.array(grid.lower) + grid.spacing * np.indices(grid.shape).reshape(2, -1).T
    cells = shapely.box(*corners.T, *(corners + grid.spacing).T).reshape(grid.shape)
    union = shapely.union_all(shapes)
    assert not (shapely.intersects(cells, union) & ~workspace.outer).any()
    assert not (workspace.outer & (shapely.distance(cells, union) > 1e-6)).any()
    assert not (workspace.inner & ~shapely.covers(union.buffer(1e-9), cells)).any()
    for shape in shapes:
        deep = shapely.covers(shape.buffer(-1e-6), cells)
        assert workspace.inner[deep].all()


QUARTERS = st.integers(-2, 18).map(lambda quarters: quarters / 4)
POINTS = st.lists(st.tuples(QUARTERS, QUARTERS), min_size=3, max_size=6, unique=True)


@given(
    drawn=st.lists(POINTS, min_size=1, max_size=4),
    bounds=st.sampled_from([(0, 0, 4, 3), (0.1, -0.1, 3.1, 2.4)]),
    spacing=st.sampled_from([0.25, 0.5, 1.0]),
)
def test_outer_cells_meet_shapes_and_inner_cells_lie_in_them(drawn, bounds, spacing):
    """Draw corners on the borders of cells."""
    shapes = [shapely.Point(0.5, 0.5), shapely.LinearRing([(1, 1), (3, 1), (3, 2)])]
    for points in drawn:
        hull = shapely.convex_hull(shapely.MultiPoint(points))
        shapes += [hull, shapely.LineString(points[:2])]
    check_cells(Workspace.from_polygons(shapes, spacing, bounds), shapes)


@pytest.mark.parametrize(
    "source",
    [
        np.array([L_SHAPE, FAR]),
        [L_SHAPE.wkt, mapping(FAR)],
        f"  geometrycollection({L_SHAPE.wkt}, {FAR.wkt})",
        {
            "type": "FeatureCollection",
            "features": [{"type": "Feature", "properties": None, "geometry": mapping(BOTH)}],
        },
    ],
    ids=str,
)
def test_polygons_are_read_from_every_source(source):
    assert read_shapes(source) == [L_SHAPE, FAR]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.geojson", "\ufeff" + json.dumps(mapping(BOTH))),
        ("a.wkt", f"{L_SHAPE.wkt}\n\n{FAR.wkt}\n"),
        ("a.WKT", BOTH.wkt.replace(",", ",\n")),
    ],
)
def test_polygon_files_are_read(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    shapes = read_shapes(str(path))
    assert [shape.equals(other) for shape, other in zip(shapes, BOTH.geoms, strict=True)] == [
        True
    ] * 2
    workspace = Workspace.from_polygons(path, 0.5)
    assert workspace.source == str(path)
    assert workspace.grid == Grid((0.1, 0.1), 0.5, (12, 4))


@pytest.mark.parametrize(
    ("bounds", "spacing", "shape"),
    [
        ((0.1, 0.2, 0.4, 0.9), 0.1, (3, 7)),
        ((0, 0, 1.0 + 1e-6, 1.0), 0.1, (11, 10)),
        (None, 0.5, (1, 1)),
    ],
)
def test_bounds_decide_the_number_of_cells(bounds, spacing, shape):
    lower = bounds[:2] if bounds else (2.0, 3.0)
    workspace = Workspace.from_polygons(shapely.Point(lower), spacing, bounds)
    assert workspace.grid == Grid(lower, spacing, shape)
    assert workspace.outer[0, 0]


@given(
    lower=st.floats(-1e3, 1e3),
    extent=st.integers(1, 40),
    spacing=st.sampled_from([0.05, 0.1, 0.3, 1.0 / 3.0, 7.0]),
)
def test_an_obstacle_on_the_upper_border_marks_the_last_cell(lower, extent, spacing):
    points = shapely.MultiPoint([(lower, -lower), (lower + extent * spacing, spacing - lower)])
    workspace = Workspace.from_polygons(points, spacing)
    assert workspace.outer[0, 0]
    assert workspace.outer[-1, -1]
    assert workspace.grid.shape[0] == extent


def test_bounds_without_an_obstacle_warn():
    with pytest.warns(UserWarning, match="has no obstacle"):
        assert not Workspace.from_polygons(FAR, 0.1, (0, 0, 1, 1)).outer.any()


def test_a_real_car_has_its_distance_from_a_real_parking_lot(data):
    files = [data / "polygons" / f"{name}.geojson" for name in ("car", "parking1")]
    car, lot = (shapely.union_all(shapely.from_geojson(file.read_text())) for file in files)
    workspace = Workspace.open(files[1], spacing=0.25)
    space = cspace.build(workspace, Robot.open(files[0]), rotations=8, outside="free")
    for x, y, yaw in ((4.03, -2.6, 1.5708), (9.9, -12.0, -1.5708)):
        turned = affinity.rotate(car, yaw, origin=(0, 0), use_radians=True)
        gap = affinity.translate(turned, x, y).distance(lot)
        assert space.obstacle_distance((x, y, yaw)) == pytest.approx(gap, abs=1e-3)


BOW_TIE = "POLYGON ((0 0, 1 1, 1 0, 0 1, 0 0))"


@refusals(
    "source, message",
    ([L_SHAPE, shapely.Polygon()], r"polygons\[1\] is empty"),
    (BOW_TIE, "polygons is not valid: .*; a boundary may not cross itself"),
    (
        [FAR, f"MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)), {BOW_TIE[8:]})"],
        r"polygons\[1\], part 1 is not",
    ),
    ([L_SHAPE, "POLYGON ((0 0, nan 1, 1 1, 0 0))"], r"polygons\[1\] has a vertex at \(nan, 1.0\)"),
    (shapely.Point(1, 2, 3), "polygons has z coordinates"),
    ("POLYGON ((0 0, 1 0, 1 1, 0 0))\0POLYGON ((5 5, 6 5, 6 6, 5 5))", "NUL"),
)
def test_unusable_geometries_are_refused(source, message):
    with pytest.raises(GeometryError, match=message):
        Workspace.from_polygons(source, 0.1, (0, 0, 1, 1))


@pytest.mark.parametrize(
    "make", [Workspace.open, Robot.open, Robot.polygon], ids=lambda m: m.__qualname__
)
def test_curves_are_refused_within_collections(make, tmp_path):
    text = "GEOMETRYCOLLECTION (POINT (1 1), CURVEPOLYGON (CIRCULARSTRING (0 0, 2 2, 0 0)))"
    (tmp_path / "a.wkt").write_text(f"GEOMETRYCOLLECTION ({text})")
    source = shapely.from_wkt(text) if make == Robot.polygon else tmp_path / "a.wkt"
    options = {"spacing": 0.1} if make == Workspace.open else {}
    with pytest.raises(GeometryError, match="has curved edges"):
        make(source, **options)


@refusals(
    "name, text, error, message",
    ("a.geojson", "{", FileError, r"a\.geojson: cannot be read as a JSON file"),
    ("a.wkt", f"POINT (1 2)\n{BOW_TIE}", GeometryError, r"a\.wkt, geometry 2 is not valid"),
)
def test_unusable_files_are_refused(tmp_path, name, text, error, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(error, match=message):
        read_shapes(tmp_path / name)


@refusals(
    "options, message",
    ({"spacing": 1e-9}, "the map has .* cells of 1e-09 m and needs"),
    ({"bounds": (0, 2, 3, 2)}, "bounds is .* xmax, ymax must be above xmin, ymin"),
)
def test_unusable_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Workspace.from_polygons(L_SHAPE, **({"spacing": 0.5} | options))

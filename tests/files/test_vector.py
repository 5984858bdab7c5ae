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
from cspace._files.vector import read_shapes
from cspace.errors import GeometryError, InputError, UnitWarning
from cspace.inside import measure_shapes
from tests.helpers.commands import run
from tests.helpers.refusals import refusals, write

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
    "name, text",
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
    "bounds, spacing, shape",
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


@pytest.mark.filterwarnings("ignore:.*look like degrees")
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


def test_altitudes_of_zero_are_none_and_others_are_refused():
    corners = [(0, 0, 0.0), (2, 0, 0.0), (2, 1, 0.0), (0, 0, 0.0)]
    for z in (0.0, 0.3):
        rows = [(x, y, z * (x > 1)) for x, y, _ in corners]
        document = {"type": "Polygon", "coordinates": [rows]}
        for source in (
            document,
            shapely.Polygon(rows),
            shapely.MultiPolygon([shapely.Polygon(rows)]),
        ):
            if z:
                with pytest.raises(GeometryError, match=r"shapely\.force_2d drops heights"):
                    read_shapes(source)
                (shape,) = read_shapes(shapely.force_2d(shapely.Polygon(rows)))
                assert shape.equals(shapely.Polygon([row[:2] for row in rows]))
            else:
                (shape,) = read_shapes(source)
                assert shape.equals(shapely.Polygon([row[:2] for row in corners]))
                assert not shape.has_z and Robot.polygon([shape]).geometry.area == pytest.approx(1)


def test_members_of_geojson_that_nobody_reads_are_named_once():
    point = {"type": "Point", "coordinates": [1, 2]}
    harmless = {"type": "Feature", "id": 1, "bbox": [0, 0, 1, 1], "geometry": point}
    features = [harmless | {"properties": {"name": "post"}}] * 3
    read_shapes({"type": "FeatureCollection", "name": "room", "features": features})
    thick = [harmless | {"properties": {"Radius": 0.5}}, harmless | {"geometri": None, "scale": 2}]
    with pytest.warns(UserWarning, match=r"not read: Radius \(properties\).*, scale$"):
        read_shapes({"type": "FeatureCollection", "features": thick})


@refusals(
    "source, message",
    (
        {"version": "5.0", "shapes": []},
        "has no type, only version, shapes.*",
    ),
    ([L_SHAPE, shapely.Polygon()], r"polygons\[1\] is empty"),
    (
        [FAR, f"MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)), {BOW_TIE[8:]})"],
        r"polygons\[1\], part 1 is not",
    ),
    ("POLYGON ((0 0, 1 0, 1 1, 0 0))\0POLYGON ((5 5, 6 5, 6 6, 5 5))", "NUL"),
)
def test_unusable_geometries_are_refused(source, message):
    with pytest.raises(GeometryError, match=message):
        Workspace.from_polygons(source, 0.1, (0, 0, 1, 1))


# Reference systems, curves and other frames


HOUSES = [box(x, 47.37, x + 3e-4, 47.3702) for x in (8.54, 8.55)]
"""Two buildings of 30 m in Zurich, in degrees."""


def town(crs=None, **members):
    """Return GeoJSON of the buildings."""
    features = [{"type": "Feature", "properties": {}, "geometry": mapping(b)} for b in HOUSES]
    if crs:
        members["crs"] = {"type": "name", "properties": {"name": crs}}
    return {"type": "FeatureCollection", "features": features, **members}


class Geometries:
    """Geometries with a reference system, as in a column of geopandas."""

    def __init__(self, shapes, crs):
        self.shapes = shapes
        self.crs = crs

    def __iter__(self):
        return iter(self.shapes)


class Table:
    """As a geopandas.GeoDataFrame."""

    def __init__(self, document, crs):
        self.__geo_interface__ = document
        self.crs = crs

    def __iter__(self):
        return iter(["geometry"])


DEGREES = [
    "urn:ogc:def:crs:OGC:1.3:CRS84",
    "urn:ogc:def:crs:EPSG::4326",
    "EPSG:4258",
    "http://www.opengis.net/def/crs/EPSG/0/4326",
    'GEOGCS["WGS 84",DATUM["WGS_1984"]]',
    "+proj=longlat +datum=WGS84 +no_defs",
    "EPSG:3857",
    *("EPSG:7844", "urn:ogc:def:crs:EPSG::6668", "urn:ogc:def:crs:OGC:1.3:CRS84h"),
    *("EPSG:2227", "EPSG:32664", "+proj=latlong +datum=WGS84"),
    'COMPD_CS["a",GEOGCS["b"],VERT_CS["c"],AUTHORITY["EPSG","9518"]]',
]
JSON_FG = [
    "http://www.opengis.net/def/crs/EPSG/0/4326",
    "[EPSG:4326]",
    {"type": "Reference", "href": "http://www.opengis.net/def/crs/OGC/0/CRS84"},
    ["http://www.opengis.net/def/crs/EPSG/0/4258", "http://www.opengis.net/def/crs/EPSG/0/5703"],
]
OTHERS = {
    "column": Geometries([L_SHAPE], "EPSG:4326"),
    "table": Table(mapping(L_SHAPE), "EPSG:4326"),
    "WKT": f"SRID=4326;{L_SHAPE.wkt}",
    "spaced WKT": f" srid=4258 ; {L_SHAPE.wkt}",
    "shapely": shapely.set_srid(L_SHAPE, 4326),
    "part of shapely": shapely.set_srid(BOTH, 4326),
}
IN_DEGREES_OR_FEET = {
    **{crs: town(crs) for crs in DEGREES},
    **{f"JSON-FG {systems}": town(coordRefSys=systems) for systems in JSON_FG},
    **OTHERS,
}
"""Sources that name a system of other units, or of none on the ground."""


@pytest.mark.parametrize("source", IN_DEGREES_OR_FEET)
def test_reference_systems_that_are_not_metres_are_refused(tmp_path, source):
    pytest.importorskip("pyproj")
    given = IN_DEGREES_OR_FEET[source]
    sources = [given, write(tmp_path, "a.geojson", given)] if isinstance(given, dict) else [given]
    for each in sources:
        with pytest.raises(GeometryError, match=r"coordinate reference system .*ground"):
            Workspace.from_polygons(each, 0.5)
    readers = {"shapely": Robot.polygon, "part of shapely": Robot.polygon}
    readers["column"] = lambda shapes: Workspace.from_shapes(shapes, 0.5)
    if source in readers:
        with pytest.raises(GeometryError, match="reference system EPSG:4326"):
            readers[source](given)


PLACE = {"coordRefSys": "http://www.opengis.net/def/crs/EPSG/0/25832"}
IN_METRES = {
    **{
        crs: mapping(L_SHAPE) | {"crs": {"type": "name", "properties": {"name": crs}}}
        for crs in ("urn:ogc:def:crs:EPSG::32632", "EPSG:25832", "EPSG:32719")
    },
    "JSON-FG": mapping(L_SHAPE) | PLACE,
    "feature": {"type": "Feature", "geometry": mapping(L_SHAPE), "properties": {}, **PLACE},
    "column": Geometries([L_SHAPE], "EPSG:32632"),
    "table": Table(mapping(L_SHAPE), "EPSG:32632"),
    "table without a system": Table(mapping(L_SHAPE), None),
    "WKT": f"SRID=32632;{L_SHAPE.wkt}",
    "shapely": shapely.set_srid(L_SHAPE, 32632),
}
"""Sources that name a system of metres."""


@pytest.mark.parametrize("source", IN_METRES)
def test_reference_systems_of_metres_are_read_without_a_warning(source):
    (shape,) = read_shapes(IN_METRES[source])
    assert shape.equals(L_SHAPE)
    assert Workspace.from_polygons(IN_METRES[source], 0.5).grid.shape == (6, 4)


def test_a_place_of_json_fg_is_refused_and_a_table_is_an_obstacle():
    place = {"type": "Feature", "geometry": None, "place": mapping(L_SHAPE), **PLACE}
    with pytest.raises(GeometryError, match="has a place, the geometry of JSON-FG"):
        read_shapes(place)
    space = cspace.build(Workspace.from_polygons(FAR, 0.1, (0, 0, 8, 3)), "disc:0.1")
    space.add_obstacle("table", Table(mapping(BOTH), None))
    assert not space.is_free((0.5, 0.5))


def test_other_reference_systems_warn():
    for crs in (
        {"type": "name", "properties": {"name": "EPSG:2056"}},
        "local",
        {"type": "link"},
    ):
        with pytest.warns(UnitWarning, match="are read as metres"):
            read_shapes(mapping(L_SHAPE) | {"crs": crs})


def test_sizes_within_a_collection_are_named():
    line = {"type": "LineString", "coordinates": [[0, 0], [3, 3]], "width": 1.0}
    collection = {"type": "GeometryCollection", "geometries": [line]}
    with pytest.warns(UserWarning, match="these fields are not read: width$"):
        assert len(read_shapes(collection)) == 1
    with pytest.raises(GeometryError, match="has geometries 5; they must be a list"):
        read_shapes({"type": "GeometryCollection", "geometries": 5})
    with pytest.raises(GeometryError, match="has no type"):
        read_shapes({"type": ["GeometryCollection"], "geometries": []})


ROOM = box(8.5, 5.0, 8.6, 5.1)

CITY = "8.40{0}49.00{0}110\n8.90{0}49.40{0}112\n8.60{0}49.20{0}115\n"


def open_points(folder, name, separator, offset=None):
    """Open points in degrees."""
    text = CITY.format(separator)
    return Workspace.open(write(folder, name, text), spacing=0.1, radius=0.05, offset=offset)


IN_DEGREES = {
    "GeoJSON": lambda _: Workspace.from_polygons(town(), 1e-4),
    "null": lambda _: Workspace.from_polygons(town() | {"crs": None}, 1e-4),
    "list": lambda _: Workspace.from_polygons(HOUSES, 1e-4),
    "generator": lambda _: Workspace.from_polygons(iter(HOUSES), 1e-4),
    "array": lambda _: Workspace.from_polygons(np.array(HOUSES), 1e-4),
    "MultiPolygon": lambda _: Workspace.from_polygons(shapely.MultiPolygon(HOUSES), 1e-4),
    "WKT": lambda _: Workspace.from_polygons(shapely.MultiPolygon(HOUSES).wkt, 1e-4),
    "list of WKT": lambda _: Workspace.from_polygons([house.wkt for house in HOUSES], 1e-4),
    "lazy": lambda _: Workspace.from_polygons(HOUSES, 1e-4, lazy=True),
    "bounds": lambda _: Workspace.from_polygons(HOUSES, 1e-4, (8.5, 47.3, 8.6, 47.4)),
    "shapes": lambda _: Workspace.from_shapes(HOUSES, 1e-4),
    "points": lambda _: Workspace.from_points([(8.54, 47.37), (8.55, 47.38)], 1e-4),
    "robot": lambda _: Robot.polygon(HOUSES[0]),
    "robot to build": lambda _: cspace.build(
        Workspace.from_array(np.zeros((20, 20), dtype=bool), 1e-4), HOUSES[0], outside="free"
    ),
    "robot file": lambda folder: Robot.open(write(folder, "a.wkt", HOUSES[0].wkt)),
    "moved": lambda _: Workspace.from_polygons(HOUSES, 1e-4, offset=(-8.54, -47.37)),
    "points file": lambda folder: open_points(folder, "a.xyz", " "),
    "points of a table": lambda folder: open_points(folder, "a.csv", ","),
    "moved points": lambda folder: open_points(folder, "a.csv", ",", (-8.4, -49.0, -110.0)),
    "info": lambda folder: measure_shapes(write(folder, "a.geojson", json.dumps(town()))),
}
"""Calls with two houses in degrees."""


@pytest.mark.parametrize("call", IN_DEGREES)
def test_coordinates_like_degrees_are_warned_of_once_at_every_door(call, tmp_path):
    with pytest.warns(UnitWarning) as caught:
        IN_DEGREES[call](tmp_path)
    assert ["look like degrees" in str(each.message) for each in caught].count(True) == 1


def test_small_shapes_far_from_the_origin_of_a_map_are_metres():
    for plan in (L_SHAPE, affinity.translate(L_SHAPE, 50, 40), affinity.scale(L_SHAPE, 20, 20)):
        assert read_shapes(mapping(plan)) == [plan]
    bounds = (0, 0, 10, 10)
    workspace = Workspace.from_polygons([ROOM], 0.05, bounds)
    assert Workspace.from_polygons(mapping(ROOM), 0.05, bounds).outer.any()
    space = cspace.build(workspace, "disc:0.1")
    pallet = affinity.translate(ROOM, -3.0, 0.0)
    for shape in (pallet, mapping(pallet), pallet.wkt):
        space.add_obstacle("pallet", shape)
        assert not space.is_free((5.55, 5.05))
        space.remove_obstacle("pallet")


ARC = "CIRCULARSTRING (0 0, 4 0, 4 4, 0 4, 0 0)"


@pytest.mark.parametrize(
    "text",
    [
        ARC,
        f"CURVEPOLYGON ({ARC})",
        f"COMPOUNDCURVE ({ARC})",
        f"MULTICURVE ({ARC}, (0 0, 1 1))",
        f"MULTISURFACE (CURVEPOLYGON ({ARC}))",
        f"GEOMETRYCOLLECTION (POINT (9 9), {ARC})",
        f"GEOMETRYCOLLECTION (GEOMETRYCOLLECTION (POINT (1 1), CURVEPOLYGON ({ARC})), POINT (9 9))",
        f"POINT (1 2)\n{ARC}",
    ],
)
def test_curves_are_refused_by_name(tmp_path, text):
    path = write(tmp_path, "arc.wkt", text)
    for read in (lambda path: Workspace.open(path, spacing=0.1), Robot.open):
        with pytest.raises(GeometryError, match="is or holds a curve, such as CIRCULARSTRING"):
            read(path)
    result = run("build", str(path), "--robot", "disc:0.1", "--spacing", "0.1")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "holds a curve" in result.stderr
    if text.startswith("GEOMETRYCOLLECTION"):
        with pytest.raises(GeometryError, match="is or holds a curve"):
            Robot.polygon(shapely.from_wkt(text))


@pytest.mark.parametrize("name", ["TIN", "TRIANGLE", "POLYHEDRALSURFACE"])
def test_surfaces_are_refused_by_name(name):
    with pytest.raises(GeometryError, match=name):
        read_shapes(f"{name} (((0 0, 1 0, 1 1, 0 0)))")


def test_an_offset_moves_a_far_frame(tmp_path):
    far = affinity.translate(L_SHAPE, 692_000, 5_334_000)
    (tmp_path / "utm.wkt").write_text(far.wkt)
    with pytest.raises(InputError, match="cells from the origin"):
        Workspace.from_polygons(tmp_path / "utm.wkt", 0.1)
    offset = (-692_000, -5_334_000)
    for lazy in (False, True):
        workspace = Workspace.from_polygons(tmp_path / "utm.wkt", 0.1, offset=offset, lazy=lazy)
        check_cells(workspace, [affinity.translate(far, *offset)])

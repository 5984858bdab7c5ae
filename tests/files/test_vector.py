"""Obstacles from shapely geometries, GeoJSON and WKT."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import box, mapping

from cspace import Grid, Workspace
from cspace.errors import FileError, GeometryError, InputError
from cspace.files.vector import read_shapes
from tests.helpers.refusals import refusals

L_SHAPE = shapely.Polygon([(0.1, 0.1), (2.9, 0.1), (2.9, 0.9), (0.9, 0.9), (0.9, 1.9), (0.1, 1.9)])
"""Touches all of the 3 x 2 unit cells except (1, 1) and (2, 1)."""

FAR = box(4.0, 0.25, 6.0, 1.75)


def _meets(shapes: list[Any], grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of touched and covered cells, by shapely."""
    union = shapely.union_all(shapes)
    corners = [grid.lower + grid.spacing * np.array(index) for index in np.ndindex(*grid.shape)]
    cells = [box(*corner, *(corner + grid.spacing)) for corner in corners]
    meets = np.reshape([cell.intersects(union) for cell in cells], grid.shape)
    covered = np.reshape([union.buffer(1e-9).covers(cell) for cell in cells], grid.shape)
    return meets, covered


RING = shapely.LinearRing([(0.5, 0.5), (2.5, 0.5), (2.5, 2.5), (0.5, 2.5)])


@pytest.mark.parametrize(
    ("source", "size", "outer", "inner", "name"),
    [
        (L_SHAPE, (3, 2), ["##", "#.", "#."], ["..", "..", ".."], "1 polygon"),
        (box(0.5, 0.5, 3.5, 2.5), (4, 3), ["###"] * 4, ["...", ".#.", ".#.", "..."], "1 polygon"),
        (
            [RING, shapely.Point(4.5, 0.5)],
            (5, 3),
            ["###", "#.#", "###", "...", "#.."],
            ["..."] * 5,
            "2 polygons",
        ),
    ],
)
def test_cells_meet_or_lie_in_polygons(
    source: Any, size: tuple[int, int], outer: list[str], inner: list[str], name: str
) -> None:
    """Compare outer and inner cells with shapely."""
    workspace = Workspace.from_polygons(source, 1.0, (0, 0, *size))
    assert workspace.grid == Grid((0.0, 0.0), 1.0, size)
    for cells, columns in ((workspace.outer, outer), (workspace.inner, inner)):
        assert ["".join(".#"[cell] for cell in column) for column in cells.astype(int)] == columns
    assert workspace.source == name


@pytest.mark.parametrize(
    "source",
    [
        [L_SHAPE, FAR],
        (L_SHAPE, FAR),
        pytest.param(iter([L_SHAPE, FAR]), id="iterator"),
        np.array([L_SHAPE, FAR]),
        shapely.MultiPolygon([L_SHAPE, FAR]),
        shapely.GeometryCollection([shapely.MultiPolygon([L_SHAPE]), FAR]),
        [L_SHAPE.wkt, mapping(FAR)],
        shapely.MultiPolygon([L_SHAPE, FAR]).wkt,
        f"  geometrycollection({L_SHAPE.wkt}, {FAR.wkt})",
        mapping(shapely.MultiPolygon([L_SHAPE, FAR])),
        {"type": "GeometryCollection", "geometries": [mapping(L_SHAPE), mapping(FAR)]},
        {
            "type": "FeatureCollection",
            "features": [
                {"type": "Feature", "properties": None, "geometry": mapping(s)}
                for s in (L_SHAPE, FAR)
            ],
        },
    ],
    ids=str,
)
def test_polygons_are_read_from_every_source(source: Any) -> None:
    shapes = read_shapes(source)
    assert [shape.geom_type for shape in shapes] == ["Polygon", "Polygon"]
    assert shapes[0].equals(L_SHAPE)
    assert shapes[1].equals(FAR)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.geojson", json.dumps(mapping(shapely.MultiPolygon([L_SHAPE, FAR])))),
        (
            "a.json",
            "\ufeff"
            + json.dumps(
                {"type": "Feature", "geometry": mapping(shapely.MultiPolygon([L_SHAPE, FAR]))}
            ),
        ),
        ("a.wkt", f"{L_SHAPE.wkt}\n\n{FAR.wkt}\n"),
        ("a.WKT", shapely.MultiPolygon([L_SHAPE, FAR]).wkt.replace(",", ",\n")),
    ],
)
@pytest.mark.parametrize("kind", [str, Path])
def test_polygon_files_are_read(tmp_path: Path, name: str, text: str, kind: type) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    path = kind(tmp_path / name)
    shapes = read_shapes(path)
    assert shapes[0].equals(L_SHAPE)
    assert shapes[1].equals(FAR)
    assert Workspace.from_polygons(path, 1.0).source == str(path)


@pytest.mark.parametrize(
    ("wkt", "kinds"),
    [
        ("POINT (1 2)", ["Point"]),
        ("MULTIPOINT (1 2, 3 4)", ["Point", "Point"]),
        ("LINESTRING (0 0, 1 1, 0 1, 1 0)", ["LineString"]),
        ("MULTILINESTRING ((0 0, 1 1), (2 2, 3 3))", ["LineString", "LineString"]),
        ("LINEARRING (0 0, 1 0, 1 1, 0 0)", ["LinearRing"]),
        (
            "GEOMETRYCOLLECTION (POINT (1 2), GEOMETRYCOLLECTION (POLYGON ((0 0, 1 0, 1 1, 0 0))))",
            ["Point", "Polygon"],
        ),
    ],
)
def test_every_kind_of_geometry_is_read(wkt: str, kinds: list[str]) -> None:
    assert [shape.geom_type for shape in read_shapes(wkt)] == kinds


def test_polygons_that_overlap_are_one_obstacle() -> None:
    squares = shapely.MultiPolygon([box(0.5, 0.5, 3.5, 3.5), box(1.5, 1.5, 4.5, 4.5)])
    workspace = Workspace.from_polygons(squares, 1.0, (0, 0, 5, 5))
    assert workspace.inner[2, 2]
    assert workspace.outer[2, 2]


@pytest.mark.parametrize(
    ("bounds", "spacing", "shape"),
    [
        ((0, 0, 1.0, 1.0), 0.1, (10, 10)),
        ((0.1, 0.2, 0.4, 0.9), 0.1, (3, 7)),
        ((1000.1, -7.3, 1001.1, -6.3), 0.1, (10, 10)),
        ((0, 0, 1.0, 1.01), 0.1, (10, 11)),
        ((0, 0, 1.0 + 1e-6, 1.0), 0.1, (11, 10)),
        ((0, 0, 0.01, 0.01), 1.0, (1, 1)),
    ],
)
def test_bounds_decide_the_number_of_cells(
    bounds: tuple[float, ...], spacing: float, shape: tuple[int, int]
) -> None:
    workspace = Workspace.from_polygons(shapely.Point(bounds[:2]), spacing, bounds)
    assert workspace.grid == Grid(bounds[:2], spacing, shape)
    assert workspace.outer[0, 0]


@given(
    lower=st.floats(-1e3, 1e3),
    extent=st.integers(1, 40),
    spacing=st.sampled_from([0.05, 0.1, 0.3, 1.0 / 3.0, 7.0]),
)
def test_an_obstacle_on_the_upper_border_marks_the_last_cell(
    lower: float, extent: int, spacing: float
) -> None:
    points = shapely.MultiPoint([(lower, -lower), (lower + extent * spacing, spacing - lower)])
    workspace = Workspace.from_polygons(points, spacing)
    assert workspace.outer[0, 0]
    assert workspace.outer[-1, -1]
    assert workspace.grid.shape[0] == extent


def test_default_bounds_are_the_bounding_box() -> None:
    workspace = Workspace.from_polygons([L_SHAPE, FAR], 0.5)
    assert workspace.grid == Grid((0.1, 0.1), 0.5, (12, 4))


def test_a_point_alone_gets_one_cell() -> None:
    workspace = Workspace.from_polygons("POINT (2 3)", 0.5)
    assert workspace.grid == Grid((2.0, 3.0), 0.5, (1, 1))
    assert workspace.outer.all()


def test_geometries_are_clipped_to_the_bounds() -> None:
    whole = Workspace.from_polygons([L_SHAPE, FAR], 0.1, (0, 0, 6, 2))
    part = Workspace.from_polygons([L_SHAPE, FAR], 0.1, (2, 0, 5, 1))
    assert np.array_equal(part.outer, whole.outer[20:50, :10])
    assert np.array_equal(part.inner, whole.inner[20:50, :10])
    with pytest.warns(UserWarning, match="has no obstacle"):
        assert not Workspace.from_polygons(FAR, 0.1, (0, 0, 1, 1)).outer.any()


BOW_TIE = "POLYGON ((0 0, 1 1, 1 0, 0 1, 0 0))"


@refusals(
    "source, message",
    ([], "holds no geometry"),
    ({"type": "FeatureCollection", "features": []}, "holds no geometry"),
    ("POLYGON EMPTY", "polygons is empty"),
    ([L_SHAPE, shapely.Polygon()], r"polygons\[1\] is empty"),
    (shapely.GeometryCollection(), "polygons is empty"),
    (BOW_TIE, "polygons is not valid: .*; a boundary may not cross itself"),
    ([L_SHAPE, BOW_TIE], r"polygons\[1\] is not valid"),
    (shapely.MultiPolygon([L_SHAPE, shapely.from_wkt(BOW_TIE)]), "polygons, part 1 is not valid"),
    (
        [FAR, shapely.MultiPolygon([L_SHAPE, shapely.from_wkt(BOW_TIE)])],
        r"polygons\[1\], part 1 is not valid",
    ),
    ("POLYGON ((0 0, 1 0, 2 0, 0 0))", "polygons is not valid"),
    ("LINESTRING (0 0, 0 0)", "polygons is not valid: "),
    (shapely.Point(float("nan"), 0.0), r"vertex at \(nan, "),
    ([L_SHAPE, "POLYGON ((0 0, nan 1, 1 1, 0 0))"], r"polygons\[1\] has a vertex at \(nan, 1.0\)"),
    ({"type": "LineString", "coordinates": [[0, 0], [1, float("inf")]]}, r"vertex at \(1.0, inf\)"),
    (shapely.Point(1, 2, 3), "polygons has z coordinates"),
    ({"type": "Point", "coordinates": [1, 2, 0]}, "polygons has z coordinates"),
    ({"type": "Feature", "geometry": None}, "polygons has geometry None"),
    (
        {"type": "FeatureCollection", "features": [{"type": "Feature"}]},
        "feature 0 has geometry None",
    ),
    ({"type": "FeatureCollection"}, "has features None"),
    ({"type": "Blob", "coordinates": []}, "type 'Blob' is not GeoJSON"),
    ({"coordinates": []}, "type None is not GeoJSON"),
    ({"type": "Polygon"}, "type 'Polygon' is not GeoJSON"),
    (
        {"type": "Polygon", "coordinates": [[[0, 0], [1, "a"], [1, 1]]]},
        "type 'Polygon' is not GeoJSON",
    ),
    ({"type": "Point", "coordinates": [1]}, "type 'Point' is not GeoJSON"),
    ("POLYGON ((0 0, 1 0))", "polygons is not WKT"),
    ("POLYGON ((0 0, 1 0, 1 1, 0 0))\0POLYGON ((5 5, 6 5, 6 6, 5 5))", "NUL"),
)
def test_unusable_geometries_are_refused(source: Any, message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        Workspace.from_polygons(source, 0.1, (0, 0, 1, 1))


@pytest.mark.parametrize(
    "source",
    [7, [1.0], "a string", "CIRCULARSTRING (0 0, 1 1, 2 0)", "map.png", None, Path("a.stl")],
)
def test_sources_of_another_kind_are_refused(source: Any) -> None:
    with pytest.raises(InputError, match="polygons"):
        read_shapes(source)


@refusals(
    "name, text, error, message",
    ("a.geojson", "{", FileError, r"a\.geojson: cannot be read as a JSON file"),
    ("a.json", "[1, 2]", FileError, "holds a JSON list"),
    ("a.json", "", FileError, "as a JSON file"),
    (
        "a.json",
        '{"type": "Point", "coordinates": [NaN, 1]}',
        GeometryError,
        r"a\.json has a vertex at \(nan",
    ),
    ("a.wkt", "", FileError, r"a\.wkt: begins with ''"),
    ("a.wkt", "POINT (1 2)\nCIRCLE (1 2)", GeometryError, "is not WKT"),
    ("a.wkt", f"POINT (1 2)\n{BOW_TIE}", GeometryError, r"a\.wkt, geometry 2 is not valid"),
)
def test_unusable_files_are_refused(
    tmp_path: Path, name: str, text: str, error: type[Exception], message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(error, match=message):
        read_shapes(tmp_path / name)


@refusals(
    "options, message",
    ({"spacing": 0.0}, "spacing is 0.0"),
    ({"spacing": -0.5}, "spacing is -0.5"),
    ({"spacing": float("nan")}, "spacing is nan"),
    ({"spacing": 1e-9}, "the map has .* cells of 1e-09 m and needs"),
    ({"spacing": 5e-324}, r"in \[1e-100, 1e100\]"),
    ({"bounds": (3, 0, 0, 2)}, "bounds is .* xmax, ymax must be above xmin, ymin"),
    ({"bounds": (0, 2, 3, 2)}, "ymax must be above xmin, ymin"),
    ({"bounds": (0, 0, 3)}, "four numbers"),
    ({"bounds": (0, 0, 0, 3, 3, 3)}, "four numbers"),
    ({"bounds": (0, 0, 3, float("nan"))}, r"bounds\[3\] is nan"),
)
def test_unusable_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Workspace.from_polygons(L_SHAPE, **({"spacing": 0.5} | options))


@pytest.mark.parametrize(("name", "parts", "spacing"), [("parking1", 13, 0.5), ("car", 1, 0.2)])
def test_real_polygons_agree_with_shapely(
    data: Path, name: str, parts: int, spacing: float
) -> None:
    path = data / "polygons" / f"{name}.geojson"
    shapes = read_shapes(path)
    workspace = Workspace.open(path, spacing=spacing)
    assert len(shapes) == parts
    meets, covered = _meets(shapes, workspace.grid)
    assert not (meets & ~workspace.outer).any()
    assert not (workspace.inner & ~covered).any()
    assert (workspace.outer & ~meets).mean() < 0.01
    assert workspace.inner.sum() > 0.9 * covered.sum() > 0

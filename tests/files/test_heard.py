"""What a file says of its numbers is heard in every reader: units, axes, moves and meanings."""

import json
import warnings
from collections import namedtuple
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
import trimesh
import zarr

import cspace
from cspace import Robot, Workspace
from cspace.errors import (
    FileError,
    InputError,
    UnitWarning,
)
from tests.helpers.handmade import build_empty
from tests.helpers.refusals import write

xarray = pytest.importorskip("xarray")

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

CELLS = np.zeros((6, 4), dtype="i1")
CELLS[0] = 1


def read(folder, name, text, **options):
    """Write a file and read it, with the options of its format."""
    return Workspace.open(write(folder, name, text), **{"spacing": 0.1} | options)


def list_warnings(function, *values, **options):
    """Return the warnings of a call, as category and text."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        function(*values, **options)
    return [(warning.category, str(warning.message)) for warning in caught]


# ---- degrees -------------------------------------------------------------------------------------

CITY = "8.40{0}49.00{0}110\n8.90{0}49.40{0}112\n8.60{0}49.20{0}115\n"


PCD = "VERSION 0.7\nFIELDS lon lat alt\nSIZE 4 4 4\nTYPE F F F\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA ascii"
PROPERTIES = "\n".join(f"property float {each}" for each in ("longitude", "latitude", "z"))
PLY = f"ply\nformat ascii 1.0\nelement vertex 3\n{PROPERTIES}\nend_header"


@pytest.mark.parametrize(
    ("name", "heading"),
    [
        ("cloud.csv", "lon,lat,alt"),
        ("cloud.csv", "Longitude,Latitude,Height"),
        ("cloud.txt", "# lon lat alt"),
        ("cloud.xyz", "# lat_deg lon_deg alt_m"),
        ("cloud.xyz", "// Lat Lng Alt"),
        ("cloud.pcd", PCD),
        ("cloud.ply", PLY),
    ],
)
def test_columns_of_degrees_are_refused(tmp_path, name, heading):
    rows = CITY.format("," if name.endswith("csv") else " ")
    with pytest.raises(FileError, match="metres, not degrees"):
        read(tmp_path, name, f"{heading}\n{rows}", radius=0.05)


# ---- units and sizes -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "note",
    [
        "vertex coordinates are measured in units, where 1 unit = 1.000000 mm",
        "1 mm = 1 unit",
        *("1 unit = 0.0254 m", "unit is 0.001 meters", "Unit = 25.4 mm"),
        *("Scale factor 0.001", "scale: 25.4", "Scaling of 1e-3", "scale 1:100", "bracket_mm"),
        *("metersPerUnit = 0.01", "UnitScaleFactor 2.54", "unit_scale_factor: 100"),
    ],
)
def test_a_sentence_of_units_is_heard(tmp_path, note):
    def write(name, text):
        (tmp_path / name).write_text(text)
        return list_warnings(Workspace.open, tmp_path / name, spacing=0.1, **options)

    options = {"solid": "surface"}
    assert UnitWarning in dict(write("a.obj", f"# {note}\n{TETRAHEDRON}"))
    assert write("a.obj", f"# 1 unit = 1.0 m\n# unit: metres\n{TETRAHEDRON}") == []
    ones = "# Scale: 1.0\n# scale factor 1\n# scale 1:1\n# metersPerUnit = 1\n# scaler v0.5\n"
    assert write("a.obj", f"{ones}# hole_10_mm, grayscale 255\n{TETRAHEDRON}") == []
    options = {"radius": 0.1}
    assert UnitWarning in dict(write("a.xyz", f"# {note}\n0 0 0\n1 1 1\n"))


@pytest.mark.parametrize("note", ["Up axis: Y", "y-up", "Y_AXIS_UP", "exported with y up", "up=+Y"])
def test_an_axis_that_a_comment_calls_upright_is_heard(tmp_path, note):
    path = tmp_path / "a.obj"
    path.write_text(f"# {note}\n{TETRAHEDRON}")
    with pytest.warns(UserWarning, match="and its axes stay as they are"):
        Workspace.from_mesh(path, 0.1)
    assert list_warnings(Workspace.from_mesh, path, 0.1, up="y") == []
    path.write_text(f"# z-up\n# up axis: z\n# setup: yes\n{TETRAHEDRON}")
    assert list_warnings(Workspace.from_mesh, path, 0.1) == []


def test_sizes_are_heard_in_any_spelling(tmp_path):
    names = "wallThickness", "WALLTHICKNESS", "Thickness (m)", "wall-width", "lineWidth", "radius1"
    names += "inflation", "Clearance (m)", "safetyMargin", "padding", "units"
    for name in names:
        line = {"type": "LineString", "coordinates": [[0, 0], [5, 0], [5, 5]]}
        feature = {"type": "Feature", "properties": {name: 0.4}, "geometry": line}
        with pytest.warns(UserWarning, match="not read") as caught:
            Workspace.from_polygons(feature, 0.1)
        assert name in str(caught[0].message)
    drawn = dict.fromkeys(("stroke-width", "strokeWidth", "marker-size", "bandwidth"), 2)
    feature["properties"] = drawn
    assert list_warnings(Workspace.from_polygons, feature, 0.1) == []


def test_a_table_in_millimetres_is_refused():
    space = cspace.build(Workspace.from_array(np.zeros((9, 9), dtype=bool), 0.1), Robot.disc(0.1))
    for key in ("units", "unit"):
        table = pd.DataFrame({"x": [0.1, 0.2], "y": [0.1, 0.2]})
        table.attrs[key] = "mm"
        for use in (space.is_free, lambda rows: Workspace.from_points(rows, 0.1)):
            with pytest.raises(InputError, match="has the unit mm"):
                use(table)


def test_another_spacing_in_a_comment_is_warned_of(tmp_path):
    path = tmp_path / "map.pgm"
    note = "# CREATOR: map_generator.cpp 0.050 m/pix"
    path.write_bytes(f"P5\n{note}\n2 2\n255\n".encode() + bytes([0, 254, 254, 254]))
    (tmp_path / "map.yaml").write_text(
        "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    for use in (
        lambda: Workspace.open(path, spacing=0.1),
        lambda: Workspace.open(tmp_path / "map.yaml"),
    ):
        with pytest.warns(UnitWarning, match=r"says 0.05 m a pixel, and 0.1 m is taken"):
            use()
    assert list_warnings(Workspace.open, path, spacing=0.05) == []
    path.write_bytes(b"P5\n# 2.5 cm per pixel\n1 1\n255\n\0")
    with pytest.warns(UnitWarning, match=r"says 0.025 m a pixel"):
        Workspace.open(path, spacing=0.05)


# ---- names of dimensions -------------------------------------------------------------------------


class Variable:
    """As a variable of netCDF4, h5netcdf or h5py."""

    def __init__(self, data, **fields):
        self._data = data
        self.shape, self.dtype, self.ndim = data.shape, data.dtype, data.ndim
        self.__dict__.update(fields)

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self._data)

    def __getitem__(self, key):
        return self._data[key]


class Scale:
    """As a dimension of h5py."""

    def __init__(self, label, *names):
        self.label = label
        self._names = names

    def __iter__(self):
        return iter(self._names)


@pytest.mark.parametrize(
    ("fields", "is_right"),
    [
        ({"dimensions": ("y", "x")}, False),
        ({"dimensions": ("x", "y")}, True),
        ({"dims": (Scale("y"), Scale("x"))}, False),
        ({"dims": (Scale("", "y"), Scale("", "x"))}, False),
        ({"dims": (Scale("x"), Scale("y"))}, True),
        ({"dims": (Scale(""), Scale(""))}, True),
        ({"dimensions": ("row", "column")}, False),
        ({"isel": None, "dims": ("y", "x")}, False),
    ],
)
def test_names_of_dimensions_are_heard_wherever_they_stand(fields, is_right):
    array = Variable(CELLS, **fields)
    if is_right:
        assert (Workspace.from_array(array, 0.1).outer == CELLS).all()
    else:
        with pytest.raises(InputError, match="has the dimensions"):
            Workspace.from_array(array, 0.1)


def test_masked_cells_of_netcdf_are_refused():
    masked = np.ma.masked_equal(CELLS, 0)
    array = Variable(masked, dimensions=("x", "y"), ncattrs=list)
    with pytest.raises(InputError, match="masked entries"):
        Workspace.from_array(array, 0.1)
    scaled = Variable(CELLS, ncattrs=lambda: ["scale_factor"], getncattr=lambda _: 0.5)
    with pytest.raises(InputError, match="stand for others"):
        Workspace.from_array(scaled, 0.1)


def test_a_group_of_zarr_is_refused():
    with pytest.raises(InputError, match="occupied"):
        Workspace.from_array(zarr.group(), 0.1)


# ---- meanings of cells ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"flag_values": [0, 1], "flag_meanings": "occupied free"}, "0 is occupied and 1 is free"),
        ({"flag_meanings": "unknown occupied"}, "0 is unknown"),
        ({"flag_values": [2, 1, 0], "flag_meanings": "lethal free unknown"}, "0 is unknown"),
        ({"flag_values": [0, 1], "flag_meanings": "obstacles free_space"}, "1 is free_space"),
        ({"long_name": "Free space"}, "1 is free_space"),
        ({"long_name": "Drivable area"}, "1 is drivable_area"),
        ({"comment": "1 = free, 0 = occupied"}, "0 is occupied and 1 is free"),
        ({"description": "0: unknown, 1 means occupied"}, "0 is unknown"),
        ({"missing_value": 0}, "stand for others"),
        ({"missing_value": [9, 1]}, "stand for others"),
    ],
)
@pytest.mark.parametrize("has_places", [True, False])
def test_meanings_other_than_free_and_occupied_are_refused(attributes, message, has_places):
    place = {"x": 0.1 * np.arange(6), "y": 0.1 * np.arange(4)} if has_places else {}
    cells = xarray.DataArray(CELLS, dims=("x", "y"), coords=place, attrs=attributes)
    with pytest.raises(InputError, match=message):
        Workspace.from_array(cells, 0.1)


@pytest.mark.parametrize("meanings", ["free occupied", "not_occupied occupied", "Empty full", ""])
def test_usual_meanings_are_silent_and_others_warned_of(meanings):
    attributes = {"flag_meanings": meanings, "missing_value": -1}
    cells = xarray.DataArray(CELLS, dims=("x", "y"), attrs=attributes)
    assert list_warnings(Workspace.from_array, cells, 0.1) == []
    cells.attrs["flag_meanings"] = "street house"
    with pytest.warns(UserWarning, match="not read: flag_meanings"):
        Workspace.from_array(cells, 0.1)
    cells.attrs = {"flag_values": "0b, 1b", "flag_meanings": "occupied free"}
    with pytest.warns(UserWarning, match="not read: flag_meanings"):
        Workspace.from_array(cells, 0.1)
    place = {"x": ("x", 0.1 * np.arange(6), {"long_name": "x", "valid_min": 0.0})}
    placed = xarray.DataArray(CELLS, dims=("x", "y"), coords=place | {"y": 0.1 * np.arange(4)})
    assert list_warnings(Workspace.from_array, placed, 0.1) == []
    with pytest.raises(InputError, match="1 is free"):
        Workspace.from_array(placed.rename("free"), 0.1)
    cells.attrs = {"valid_min": 1}
    with pytest.warns(UserWarning, match="not read: valid_min"):
        Workspace.from_array(cells, 0.1)


# ---- rows of numbers that are no points ----------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 1 0\n0 1 1 0\n0 0 0 0\n", "values of cells"),
        ("-1 100 0 0\n-1 0 0 0\n", "values of cells"),
        ("0 1 1\n" * 9, "values of cells"),
        ("0,1,2\n10.0,20.0,30.0\n10.5,20.5,30.1\n", "numbers of its columns"),
        ("0 10 20 30\n1 10.5 20 30\n2 11 20 30\n", "begins each row with its number"),
        ("1 10 20 30\n2 10.5 20 30\n3 11 20 30\n", "begins each row with its number"),
        ("# id px py pz\n7 1 2 3\n9 1 2 3\n", "under the heading id px py pz"),
        ("# timestamp tx ty tz\n7.5 1 2 3\n9.5 1 2 3\n", "under the heading timestamp tx"),
        ("# i east north up\n7 1 2 3\n9 1 2 3\n", "under the heading i east north up"),
        ("# label x [m] y [m]  z [m]\n7 1 2 3\n9 1 2 3\n", ""),
        ("# N points follow\n1 5 1\n1 6 2\n", ""),
    ],
)
def test_rows_that_do_not_begin_with_x_y_and_z(tmp_path, text, message):
    if not message:
        assert read(tmp_path, "a.txt", text, radius=0.01).grid.shape[0] == 1  # x is 1 in both rows
        return
    with pytest.raises(FileError, match=message):
        read(tmp_path, "a.txt", text)


def test_the_corners_of_a_cube_are_points(tmp_path):
    corners = "".join(f"{k >> 2 & 1} {k >> 1 & 1} {k & 1}\n" for k in range(8))
    assert read(tmp_path, "a.xyz", corners).grid.shape == (10, 10, 10)
    assert read(tmp_path, "a.xyz", "x y z\n0 1 2\n3 4 5\n").grid.shape == (30, 30, 30)


def test_bounds_of_geopandas_are_taken_in_any_order():
    row = pd.Series({"maxx": 3.0, "miny": 0.0, "minx": 0.0, "maxy": 4.0})
    corners = namedtuple("Corners", "ymin xmin ymax xmax")(0.0, 0.0, 4.0, 3.0)
    for bounds in (row, pd.DataFrame([row]), corners):
        assert Workspace.from_polygons("POINT (1 1)", 0.1, bounds=bounds).grid.shape == (30, 40)


# ---- messages ------------------------------------------------------------------------------------


@dataclass
class Header:
    """As rosbags writes std_msgs/Header."""

    frame_id: str
    __msgtype__: ClassVar[str] = "std_msgs/msg/Header"


@dataclass
class Stamped:
    """As rosbags writes a message with a header."""

    header: Header
    pose: object
    __msgtype__: ClassVar[str] = "geometry_msgs/msg/PoseStamped"


POSE = {
    "position": {"x": 0.2, "y": 0.3, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


@pytest.fixture(scope="module")
def space():
    return build_empty((9, 9), Robot.disc(0.1), rotations=8)


def test_types_of_messages_are_no_fields(space):
    message = {"header": {"frame_id": "map", "__msgtype__": "std_msgs/msg/Header"}, "pose": POSE}
    for each in (message, Stamped(Header("map"), POSE)):
        assert list_warnings(cspace.ros.configuration_of, each, space) == []


# ---- parts that move, and hostile repetitions ----------------------------------------------------


@pytest.mark.parametrize("suffix", [".gltf", ".dae"])
def test_animations_are_warned_of(tmp_path, suffix):
    box = trimesh.creation.box((1, 1, 1))
    path = tmp_path / f"a{suffix}"
    if suffix == ".gltf":
        files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box))
        document = json.loads(files["model.gltf"])
        document["animations"] = [{"channels": [{"target": {"node": 0, "path": "rotation"}}]}]
        for name, content in files.items():
            (tmp_path / name).write_bytes(content)
        path.write_text(json.dumps(document))
    else:
        text = trimesh.exchange.dae.export_collada(box).decode()
        animation = "<library_animations><animation><channel/></animation></library_animations>"
        path.write_text(
            text.replace("<library_visual_scenes", f"{animation}<library_visual_scenes")
        )
    with pytest.warns(UserWarning, match="1 animations, which are not read"):
        Workspace.from_mesh(path, 0.5, up="z")


SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}


@pytest.mark.parametrize(
    "name, head",
    [
        ("a.xyz", "//Global Shift: -400000.0 -5000000.0 0.0\n"),
        ("a.txt", "# global_shift -400000 -5000000 0\n"),
        ("a.ply", "comment Global shift: (-100, 200, 0)\n"),
        ("a.ply", "obj_info is_cyberware shift -100 200 0\n"),
        ("a.ply", "comment offset 0.5 0 0\n"),
    ],
)
def test_shifts_in_comments_are_warned_of(tmp_path, name, head):
    rows = "1 2 3\n4 5 6\n"
    if name == "a.ply":
        properties = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat ascii 1.0\n{head}element vertex 2\n{properties}end_header\n"
    (tmp_path / name).write_text(head + rows)
    with pytest.warns(UserWarning, match="says '.*(shift|offset).*its points stay as they are"):
        Workspace.from_points(tmp_path / name, 0.5)


@pytest.mark.parametrize("head", ["# shift 0 0 0\n", "# shape 3\n", "# night shift\n"])
def test_comments_without_shifts_are_silent(tmp_path, head):
    (tmp_path / "a.txt").write_text(f"{head}1 2 3\n4 5 6\n")
    Workspace.from_points(tmp_path / "a.txt", 0.5)


def test_offsets_of_features_are_warned_of(tmp_path):
    feature = {"type": "Feature", "geometry": SQUARE, "properties": {"offset": [1, 2]}}
    with pytest.warns(UserWarning, match=r"not read: offset \(properties\)"):
        Workspace.from_polygons(feature, 0.1)
    with pytest.warns(UserWarning, match="not read: offset$"):
        Workspace.from_polygons({**SQUARE, "offset": [1, 2]}, 0.1)


@pytest.mark.parametrize(
    "size", [{"robot_radius": 30.0}, {"footprint": "[[30, 20], [30, -20], [-30, -20], [-30, 20]]"}]
)
def test_footprints_in_centimetres_are_warned_of(tmp_path, size):
    (tmp_path / "nav2.yaml").write_text(json.dumps({"local_costmap": size}))
    with pytest.warns(UnitWarning, match="in centimetres it would be 0.6 m"):
        Robot.open(tmp_path / "nav2.yaml")

"""Hints of readers: each edit or call that a hint names is made, and the file is read."""

import copy
import json

import numpy as np
import pytest
import trimesh
from PIL import Image

from cspace import Robot, Workspace
from cspace._files.ros_maps import OccupancyGrid
from tests.helpers.mesh_files import make_collada, write_gltf
from tests.helpers.refusals import check_refused, refusals, write

PAGE = 'the page "Bring your file" says how'


def read(path):
    """Read a file by its name, with the options that it needs."""
    kind = path.name.partition(".")[0]
    if kind == "robot":
        return Robot.open(path)
    if path.suffix in (".yaml", ".bt", ".3dmap", ".map"):
        return Workspace.open(path)
    if path.suffix in (".xyz", ".csv", ".pcd"):
        return Workspace.open(path, spacing=0.1, radius=0.1)
    return Workspace.open(path, spacing=0.1)


def feature(geometry, **more):
    """Write GeoJSON with one feature."""
    one = {"type": "Feature", "properties": {}, "geometry": geometry}
    return json.dumps({"type": "FeatureCollection", "features": [one]} | more)


OCTILE = "type octile\nheight 1\nwidth 1\nmap\n"

POINT = {"type": "Point", "coordinates": [1.0, 2.0]}
BOW = "POLYGON ((0 0, 1 1, 1 0, 0 1, 0 0))"
DEGREES = {"type": "name", "properties": {"name": "EPSG:4326"}}


ROS_MAP = """image: map.png
resolution: 0.1
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""

OBJ = """v 0 0 0
v 1 0 0
v 1 1 0.5
v 0 1 0
f 1 2 3 4
"""
TETRAHEDRON = OBJ.replace("f 1 2 3 4", "f 1 2 3\nf 1 3 4")

PCD = """VERSION .7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
WIDTH 1
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 1
DATA ascii
0 0 0
"""


def write_old_version(header, _):
    header["asset"]["version"] = "1.0"


@refusals(
    "name, wrong, hint",
    # Meshes and points.
    (
        "a.pcd",
        PCD.replace("x y z", "range yaw pitch"),
        "a.pcd: has the fields range yaw pitch ... cloud",
    ),
    (
        "a.dae",
        make_collada().replace('"X"', '"A"'),
        "a.dae: has positions with the columns ['A', 'Y', 'Z'] ... X, Y and Z",
    ),
    (
        "a.gltf",
        write_gltf(write_old_version, glb=False).decode(),
        "a.gltf: is of version 1.0 ... glTF",
    ),
    # Polygons.
    ("a.wkt", "HELLO", "a.wkt: begins with 'HELLO' ... WKT"),
    ("a.json", "{", "a.json: cannot be read as a JSON file"),
    ("a.wkt", f"POINT (1 2)\n{BOW}", "a.wkt, geometry 2 is not valid"),
    ("a.json", "[[0, 0, 1], [0, 0, 0]]", f"a.json: holds a JSON list ... {PAGE}"),
    ("a.json", feature(None), "a.json, feature 0 has geometry None ... obstacle"),
    (
        "a.wkt",
        "POINT (nan 0)\nPOINT (0 0)",
        "a.wkt, geometry 1 has a vertex at (nan, 0.0) ... 1e+100",
    ),
    ("a.wkt", "POLYGON EMPTY\nPOINT (0 0)", "a.wkt, geometry 1 is empty ... cover some ground"),
    (
        "a.wkt",
        BOW,
        "a.wkt is not valid: Self-intersection[0.5 0.5] ... cross",
    ),
    (
        "a.json",
        feature(POINT, crs=DEGREES),
        'a.json has the coordinate reference system EPSG:4326 ... units ... the page "Bring your file" says how',
    ),
    # Points.
    ("a.xyz", "0 0\n1 1\n", "a.xyz has 2 columns ... points"),
    ("a.txt", "#####\n#...#\n#####\n", f"a.txt holds no point ... {PAGE}"),
    ("a.txt", "0010\n0000\n", f"a.txt has 1 columns ... {PAGE}"),
    ("a.csv", "0,0,1,0\n0,0,0,0\n", f"a.csv: holds the values of cells ... {PAGE}"),
    # ROS maps.
    ("a.yaml", "[1]", f"a.yaml: map is [1] ... list ... {PAGE}"),
    (
        "a.yaml",
        ROS_MAP.replace("negate: 0\n", ""),
        "a.yaml: map has no negate ... resolution",
    ),
    (
        "a.yaml",
        ROS_MAP.replace("negate: 0", "negate: 1\nmode: raw"),
        "a.yaml: map has negate 1 in raw mode ... disagree",
    ),
    (
        "a.yaml",
        ROS_MAP.replace("0.65", "0.1"),
        "a.yaml: map has free_thresh 0.196 and occupied_thresh 0.1 ... second",
    ),
    # Cells.
    (
        "a.map",
        OCTILE + "x",
        "a.map: line 5, column 1 is 'x' ... '.GS'",
    ),
    # Meshes.
    (
        "a.obj",
        OBJ,
        "a.obj has a face of 4 corners (vertices 0, 1, 2, 3, counted ... flat",
    ),
    ("a.obj", f"{TETRAHEDRON}surf 0 1", "a.obj has a statement 'surf', which is not read ... lost"),
    # Robots.
    (
        "robot.yaml",
        "a: 1",
        "robot.yaml: holds neither footprint nor robot_radius ... costmap",
    ),
    (
        "robot.yaml",
        "footprint: '[[1, 2]]'",
        "robot.yaml: the file: footprint is '[[1, 2]]' ... points",
    ),
    # Planning scenes.
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_wrong_file_is_refused(name, wrong, hint, tmp_path):
    Image.fromarray(np.full((3, 4), 254, dtype=np.uint8)).save(tmp_path / "map.png")
    trimesh.creation.box().export(tmp_path / "a.stl")
    check_refused(lambda: read(write(tmp_path, name, wrong)), hint)


# ---- calls ---------------------------------------------------------------------------------------

MESSAGE = OccupancyGrid()
MESSAGE.info.resolution = 0.1
MESSAGE.info.width = MESSAGE.info.height = 2
MESSAGE.data.extend([0, 100, -1, 0])


CUBE = trimesh.creation.box((0.3, 0.3, 0.3))
CLOUD = trimesh.PointCloud(CUBE.vertices)


def change(message, **fields):
    """Copy a message, with other fields of its info."""
    changed = copy.deepcopy(message)
    vars(changed.info).update(fields)
    return changed


def turned(z, w):
    """Return an origin that is turned about z."""
    origin = copy.deepcopy(MESSAGE.info.origin)
    origin.orientation.z, origin.orientation.w = z, w
    return origin


def save_image(folder, pixels, name="a.png", **options):
    """Save an image, and return its path."""
    Image.fromarray(np.asarray(pixels)).save(folder / name, **options)
    return folder / name


def from_image(path, **options):
    """Read an image."""
    return Workspace.open(path, spacing=0.1, **options)


def from_array(array, **options):
    """Read an array."""
    return Workspace.from_array(array, **{"spacing": 0.1} | options)


def from_mesh(mesh, **options):
    """Read a mesh."""
    return Workspace.from_mesh(mesh, 0.1, **options)


GREY = np.full((3, 4), 254, dtype=np.uint8)


@refusals(
    "call, hint",
    (
        lambda f: from_image(save_image(f, GREY), threshold=50),
        "threshold is 50 ... number",
    ),
    (lambda f: from_image(save_image(f, GREY), dark="black"), "dark is 'black'"),
    (
        lambda f: Workspace.from_occupancy_grid(MESSAGE, free_thresh=0.9),
        "free_thresh is 0.9 and occupied_thresh is 0.65 ... 0 to 1",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, width=3)),
        "msg has data of shape (4,) and type int8 ... -1 to 100",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(np.eye(2)),
        "msg is array([[1., 0.], [0., 1.]]) ... ndarray",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, origin=turned(1.57, 1.0))),
        "msg.info.origin.orientation is (0, 0, 1.57, 1), which is no ... norm",
    ),
    (
        lambda f: from_mesh(trimesh.Scene([CUBE, CLOUD])),
        "mesh has a cloud of points (PointCloud) among its meshes ... lost",
    ),
    (
        lambda f: from_mesh((CUBE.vertices[:, :2], CUBE.faces)),
        "vertices of mesh has shape (8, 2) ... (V, 3), in metres",
    ),
    (
        lambda f: from_mesh((CUBE.vertices, [])),
        "mesh has no triangles ... needs",
    ),
    (
        lambda f: [np.save(f / "a.npy", np.eye(2)), Workspace.from_points(f / "a.npy", 0.1)],
        "a.npy: holds shape (2, 2) and type float64 ... boolean",
    ),
    (
        lambda f: [
            np.save(f / "a.npy", np.ones((9, 4), dtype=np.float32)),
            Workspace.open(f / "a.npy", spacing=0.1, radius=0.1),
        ],
        "a.npy: holds shape (9, 4) and type float32 ... boolean",
    ),
    (
        lambda f: Workspace.open(write(f, "a.xyz", "0 0 0")),
        "it is in metres, and not in the file",
    ),
    (
        lambda f: Workspace.open(write(f, "depot.xyz", "0 0 0").with_stem("depott")),
        "depott.xyz: does not exist ... plain file ... did you mean",
    ),
    (
        lambda f: Workspace.open(f / "a.map", unknown="free"),
        "a.map: does not exist",
    ),
    (
        lambda f: Workspace.open(write(f, "a.bt", "# Octomap\n"), unknown="free"),
        "a.bt: begins with '# Octomap' ... '# Octomap OcTree binary file'",
    ),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_calls_that_read_a_file_wrongly_are_refused(call, hint, tmp_path):
    check_refused(lambda: call(tmp_path), hint)

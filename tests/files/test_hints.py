"""Hints of readers: each edit or call that a hint names is made, and the file is read."""

import copy
import json
import math
import re
import struct
import warnings
from functools import cache

import numpy as np
import pytest
import shapely
import trimesh
import zarr
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import cspace
from cspace import Robot, Workspace, build
from cspace._files.ros_maps import OccupancyGrid
from cspace._shapes import MeshWarning
from tests.helpers.mesh_files import make_collada, write_gltf
from tests.helpers.refusals import check_followed, refusals


def read(path):
    """Read a file by its name, with the options that it needs."""
    kind = path.name.partition(".")[0]
    if kind == "robot":
        return Robot.open(path)
    if kind == "scene":
        return Workspace.from_moveit_scene(path, 0.1, (-2, -2, -2, 2, 2, 2))
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
FAR = {"type": "Polygon", "coordinates": [[[9.1, 48.1], [9.2, 48.1], [9.1, 48.2], [9.1, 48.1]]]}
BOW = "POLYGON ((0 0, 1 1, 1 0, 0 1, 0 0))"
LEVEL = "POLYGON Z ((0 0 1, 1 0 1, 0 1 1, 0 0 1))"
UTM = {"type": "name", "properties": {"name": "EPSG:32632"}}
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

BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
URDF = f'<robot name="r"><link name="base">{BOX}</link><link name="top">{BOX}</link>JOINT</robot>'
JOINT = '<joint name="j" type="fixed"><parent link="base"/><child link="top"/></joint>'
SECOND = '<joint name="k" type="fixed"><parent link="top"/><child link="base"/></joint>'
GOOD_URDF = URDF.replace("JOINT", JOINT)
MIMIC = '<joint name="j" type="revolute"><parent link="base"/><child link="top"/><mimic joint="j"/>'
TURNING = f'{MIMIC}<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
LINKS = "robot.urdf"

CORNERS = "[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]"

THING = {"id": "thing", "primitives": [{"type": 1, "dimensions": [1, 1, 1]}]}
MESH = {
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "triangles": [{"vertex_indices": row} for row in ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])],
}
FAR_POSE = {"position": [1e6, 0, 0], "orientation": [0, 0, 0, 1]}
NEAR_POSE = {"position": [1, 0, 0], "orientation": [0, 0, 0, 1]}
MOVED = {"header": {}, "transform": {"translation": [1, 0, 0], "rotation": [0, 0, 0, 1]}}
HELD = {"link_name": "hand", "object": THING | {"id": "held"}}


def scene(*objects, **more):
    """Write a planning scene."""
    return json.dumps({"world": {"collision_objects": list(objects)}} | more)


def write_old_version(header, _):
    header["asset"]["version"] = "1.0"


NAV2 = "local_costmap: {robot_radius: 0.2}\nglobal_costmap: {robot_radius: RADIUS}\n"


@refusals(
    "name, wrong, right, hint",
    # Meshes and points.
    ("a.pcd", PCD.replace("x y z", "range yaw pitch"), PCD, "write its points with these fields"),
    ("a.dae", make_collada(unit='<unit meter="-1"/>'), make_collada(), "correct <unit meter=...>"),
    ("a.dae", make_collada().replace('"X"', '"A"'), make_collada(), "write them in this order"),
    (
        "a.gltf",
        write_gltf(write_old_version, glb=False).decode(),
        write_gltf(glb=False).decode(),
        "export it as glTF 2",
    ),
    # Polygons.
    ("a.wkt", "HELLO", "POINT (1 2)", "write e.g. 'POINT (1 2)'"),
    ("a.json", "{", "a.json: cannot be read as a JSON file"),
    ("a.wkt", f"POINT (1 2)\n{BOW}", "a.wkt, geometry 2 is not valid"),
    ("a.json", "[1]", feature(POINT), "write e.g. {'type': ...}"),
    ("a.json", feature(None), feature(POINT), "remove or correct the feature"),
    ("a.wkt", "CIRCULARSTRING (0 0, 1 1, 2 0)", "LINESTRING (0 0, 1 1, 2 0)", "ST_CurveToLine"),
    (
        "a.wkt",
        "POINT (nan 0)\nPOINT (0 0)",
        "POINT (0 0)",
        "a.wkt, geometry 1 has a vertex at (nan, 0.0); coordinates must be finite, and at most 1e+100; drop or replace it",
    ),
    ("a.wkt", "POLYGON EMPTY\nPOINT (0 0)", "POINT (0 0)", "remove it"),
    (
        "a.wkt",
        LEVEL,
        shapely.force_2d(shapely.from_wkt(LEVEL)).wkt,
        "has z coordinates; obstacles in the plane have two; drop them with shapely.force_2d if height does not matter",
    ),
    (
        "a.wkt",
        BOW,
        shapely.make_valid(shapely.from_wkt(BOW)).wkt,
        "is not valid: Self-intersection[0.5 0.5]; a boundary may not cross itself; redraw it, or try shapely.make_valid",
    ),
    ("a.json", feature(POINT, crs=DEGREES), feature(POINT, crs=UTM), "project it to metres, e.g."),
    # Points.
    ("a.xyz", "0 0\n1 1\n", "0 0 0\n1 1 0\n", "write three columns"),
    (
        "a.csv",
        "id,x,y\n1,2,3,4\n",
        "id,x,y,z\n1,2,3,4\n",
        "has 4 columns under the heading id x y; it must name every column, and x, y and z once each, in metres; name them, e.g. id,x,y,z",
    ),
    ("a.xyz", "0 0 0\n1 x 1\n", "0 0 0\n1 0 1\n", "correct the line"),
    ("a.pcd", PCD.replace("DATA ascii", "DATA asci"), PCD, "write it again"),
    # ROS maps.
    ("a.yaml", "[1]", ROS_MAP, "write such a table, or pass another file"),
    ("a.yaml", ROS_MAP.replace("negate: 0\n", ""), ROS_MAP, "add it"),
    ("a.yaml", f"{ROS_MAP}mode: x", f"{ROS_MAP}mode: raw", "correct it"),
    ("a.yaml", ROS_MAP.replace("negate: 0", "negate: 2"), ROS_MAP, "write 'negate: 0' if dark"),
    (
        "a.yaml",
        ROS_MAP.replace("negate: 0", "negate: 1\nmode: raw"),
        ROS_MAP.replace("negate: 0", "negate: 1"),
        "map has negate 1 in raw mode; ROS 1 and ROS 2 disagree on its effect; remove it",
    ),
    ("a.yaml", ROS_MAP.replace("0.65", "0.1"), ROS_MAP, "exchange them"),
    ("a.yaml", ROS_MAP.replace("[0.0, 0.0, 0.0]", "0"), ROS_MAP, "write e.g. 'origin: [0.0, 0.0,"),
    ("a.yaml", ROS_MAP.replace("map.png", "''"), ROS_MAP, "write e.g. 'image: map.pgm'"),
    ("a.yaml", f"&a {{{ROS_MAP}}}", ROS_MAP, "correct that line"),
    ("a.yaml", f"{ROS_MAP}---\na: 1", ROS_MAP, "remove the others"),
    # Cells.
    (
        "a.map",
        OCTILE + "x",
        OCTILE + ".",
        "line 5, column 1 is 'x'; cells are '.GS' (passable) or '@OTW'; replace it",
    ),
    ("a.3dmap", "voxel 1 1 1\n1 0 0", "voxel 1 1 1\n0 0 0", "correct it or fetch it again"),
    # Meshes.
    ("a.obj", OBJ, TETRAHEDRON, "triangulate the faces where the file is written"),
    ("a.obj", OBJ.replace("f 1", "f 1\\\n"), TETRAHEDRON, "write it again with whole lines"),
    ("a.obj", f"{TETRAHEDRON}surf 0 1", TETRAHEDRON, "export it as plain triangles, e.g. as STL"),
    # Robots.
    (
        LINKS,
        GOOD_URDF.replace('"top">', '"base">', 1),
        GOOD_URDF,
        "has 'base' twice as a link; names must differ; rename or remove one",
    ),
    (
        LINKS,
        GOOD_URDF.replace('child link="top"', 'child link="t"'),
        GOOD_URDF,
        "joins 'base' to 't' by the joint 'j'; both must be links of the robot; correct the names",
    ),
    (
        LINKS,
        URDF.replace("JOINT", JOINT + SECOND),
        GOOD_URDF,
        "joins 'top' in a loop of joints; links must form a tree; remove a joint",
    ),
    (
        LINKS,
        URDF.replace("JOINT", ""),
        GOOD_URDF,
        "has these links without a parent: base, top; there must be one root; join the others",
    ),
    (
        LINKS,
        GOOD_URDF.replace("1 1 1", "1,1,1"),
        GOOD_URDF,
        "has size='1,1,1' at the box of link 'base'; it must be 3 finite numbers; write numbers, separated by blanks",
    ),
    (
        LINKS,
        GOOD_URDF.replace(' size="1 1 1"', ""),
        GOOD_URDF,
        "lacks the size of the box of link 'base', collision 0; it must be there; add it",
    ),
    (LINKS, GOOD_URDF.replace("robot", "model"), GOOD_URDF, "pass the right file"),
    (
        LINKS,
        URDF.replace("JOINT", TURNING),
        GOOD_URDF,
        "has the joint 'j', which mimics itself; it must mimic another joint; remove <mimic>",
    ),
    (LINKS, GOOD_URDF.replace("1 1 1", "${a} 1 1"), GOOD_URDF, "run xacro robot.urdf.xacro > rob"),
    (
        LINKS,
        GOOD_URDF.replace('<box size="1 1 1"/>', '<mesh filename="a.stl" scale="0 1 1"/>'),
        GOOD_URDF.replace('<box size="1 1 1"/>', '<mesh filename="a.stl" scale="1 1 1"/>'),
        "link 'base', collision 0: mesh: scale is [0.0, 1.0, 1.0]; no factor may be zero; correct it",
    ),
    (
        LINKS,
        GOOD_URDF.replace(BOX, ""),
        GOOD_URDF,
        "link is base, top; no such link has collision geometry; add <collision>, or pass visuals=True",
    ),
    (
        "robot.yaml",
        "a: 1",
        "a: {robot_radius: 0.22}",
        "holds neither footprint nor robot_radius; a costmap has one of them; write e.g. 'robot_radius: 0.22' in its local_costmap and global_costmap",
    ),
    ("robot.yaml", "footprint: '[[1, 2]]'", f"footprint: {CORNERS}", f"write e.g. {CORNERS}"),
    # Planning scenes.
    ("scene.yaml", scene(THING, extra=1), scene(THING), "correct or remove it"),
    (
        "scene.yaml",
        scene(THING | {"pose": FAR_POSE}),
        scene(THING | {"pose": NEAR_POSE}),
        "has a position beyond 1000 m at scene.world.collision_objects[0].pose.position; its digits would be lost; use metres and a nearer frame",
    ),
    (
        "scene.yaml",
        scene(THING, fixed_frame_transforms=[MOVED]),
        scene(THING),
        "has a motion as scene.fixed_frame_transforms[0].transform; frames are not transformed; remove it; write poses in the planning frame, and pass base_pose= of build_arm_space",
    ),
    (
        "scene.yaml",
        scene(THING | {"primitive_poses": [NEAR_POSE, NEAR_POSE]}),
        scene(THING | {"primitive_poses": [NEAR_POSE]}),
        "has 1 primitives but 2 primitive_poses at object 'thing'; each needs a pose; add or remove some",
    ),
    ("scene.yaml", scene(THING | {"planes": [{"coef": [1]}]}), scene(THING), "write a box"),
    (
        "scene.yaml",
        scene(THING | {"subframe_names": ["a"]}),
        scene(THING),
        "remove them, and write poses in the planning frame",
    ),
    (
        "scene.yaml",
        scene(THING | {"operation": 1}),
        scene(THING),
        "has 1 as scene.world.collision_objects[0].operation; it must be 'add' or 'ADD' or '' or 0 or '\\x00'; write the scene as it is",
    ),
    ("scene.yaml", scene(THING, is_diff=True), scene(THING), "write the whole scene"),
    (
        "scene.yaml",
        scene(THING, robot_state={"is_diff": True}),
        scene(THING, robot_state={"is_diff": False}),
        "write the whole state",
    ),
    ("scene.yaml", scene(THING, THING), scene(THING, THING | {"id": "b"}), "rename one"),
    (
        "scene.yaml",
        scene({"id": "a"}, THING),
        scene({"id": "a", "meshes": [MESH]}, THING),
        "has no shape at object 'a'; it must have primitives or meshes; add them, or remove the object",
    ),
    ("scene.yaml", scene({"id": "a"}, THING), scene(THING), "or remove the object"),
    (
        "scene.yaml",
        scene({"id": "a", "meshes": [MESH | {"resource": "a.stl"}]}),
        scene({"id": "a", "meshes": [{"resource": "a.stl"}]}),
        "has vertices and a resource or dimensions at meshes[0] of object 'a'; a mesh has one of them; remove one",
    ),
    (
        "scene.yaml",
        scene(THING | {"header": {"frame_id": "a"}}, THING | {"id": "b"}),
        scene(THING, THING | {"id": "b"}),
        "write them in the planning frame",
    ),
    ("scene.yaml", scene(), scene(THING), "pass another scene"),
    (
        "scene.yaml",
        scene(THING, robot_state={"attached_collision_objects": [HELD]}),
        scene(
            THING,
            robot_state={
                "attached_collision_objects": [
                    {**HELD, "object": HELD["object"] | {"header": {"frame_id": "hand"}}}
                ]
            },
        ),
        "add it, e.g. hand",
    ),
    (
        "scene.yaml",
        scene(THING, link_padding=[{"link_name": "a", "padding": 0.1}]),
        scene(THING),
        "has 0.1 as scene.link_padding[0].padding; it must be 0.0; remove it, and pass padding= to build_arm_space",
    ),
    (
        "scene.yaml",
        scene(THING | {"primitives": [{"type": 5, "dimensions": [1], "polygon": {"points": [1]}}]}),
        scene(THING),
        "write another primitive",
    ),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_file_that_is_edited_as_the_hint_says_is_read(name, wrong, right, hint, tmp_path):
    Image.fromarray(np.full((3, 4), 254, dtype=np.uint8)).save(tmp_path / "map.png")
    trimesh.creation.box().export(tmp_path / "a.stl")
    file = tmp_path / name

    def read_text(text):
        file.write_text(text)
        read(file)

    check_followed(lambda: read_text(wrong), right and (lambda: read_text(right)), hint)


@refusals(
    "name, wrong, right, hint",
    ("a.pcd", PCD.replace("T 0 0 0", "T 1 0 0"), PCD, "write VIEWPOINT 0 0 0 1 0 0 0"),
    (
        LINKS,
        GOOD_URDF.replace("<child", '<origin rpy="0 0 180"/><child'),
        GOOD_URDF.replace("<child", '<origin rpy="0 0 3.14159"/><child'),
        "write 3.14159 for 180 degrees",
    ),
    (
        LINKS,
        URDF.replace("collision", "visual", 2).replace("JOINT", JOINT),
        GOOD_URDF,
        "add <collision>",
    ),
    (
        "a.obj",
        f"# units: mm\n{TETRAHEDRON}",
        TETRAHEDRON,
        "a mesh of trimesh by apply_scale(0.001)",
    ),
)
def test_a_file_that_is_edited_as_the_warning_says_is_read_silently(
    name, wrong, right, hint, tmp_path
):
    file = tmp_path / name
    file.write_text(wrong)
    with pytest.warns(UserWarning, match=re.escape(hint)):
        read(file)
    file.write_text(right)
    with warnings.catch_warnings(action="error", category=UserWarning):
        warnings.simplefilter("ignore", MeshWarning)
        read(file)


# ---- calls ---------------------------------------------------------------------------------------

MESSAGE = OccupancyGrid()
MESSAGE.info.resolution = 0.1
MESSAGE.info.width = MESSAGE.info.height = 2
MESSAGE.data.extend([0, 100, -1, 0])


@cache
def small_map():
    """Build a small map."""
    return build(Workspace.from_array(np.eye(2, dtype=bool), 0.1), "disc:0.01")


CUBE = trimesh.creation.box((0.3, 0.3, 0.3))
CLOUD = trimesh.PointCloud(CUBE.vertices)
X = 0.05 + 0.1 * np.arange(4)


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


def tilt(x):
    """Return an origin that is turned about x."""
    origin = copy.deepcopy(MESSAGE.info.origin)
    origin.orientation.x = x
    return origin


def raster(x=X, **attributes):
    """Make cells with coordinates."""
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(np.eye(4, dtype=bool), dims=("x", "y"), coords={"x": x, "y": X})
    array.x.attrs.update(attributes)
    return array


def save_image(folder, pixels, name="a.png", **options):
    """Save an image, and return its path."""
    Image.fromarray(np.asarray(pixels)).save(folder / name, **options)
    return folder / name


def write(folder, name, text):
    """Write a text, and return its path."""
    (folder / name).write_text(text)
    return folder / name


def append(file):
    """Append bytes to a file."""
    file.write_bytes(file.read_bytes() + b"12")


def write_array(folder, options=None):
    """Write an array of free cells, by default with all its chunks, and return its path."""
    options = {"config": {"write_empty_chunks": True}} if options is None else options
    file = folder / "a.zarr"
    array = zarr.create_array(
        file, shape=(4, 4), chunks=(2, 2), dtype="bool", overwrite=True, **options
    )
    array[:] = False
    return file


def from_image(path, **options):
    """Read an image."""
    return Workspace.from_image(path, 0.1, **options)


def from_array(array, **options):
    """Read an array."""
    return Workspace.from_array(array, **{"spacing": 0.1} | options)


def from_mesh(mesh, **options):
    """Read a mesh."""
    return Workspace.from_mesh(mesh, 0.1, **options)


GREY = np.full((3, 4), 254, dtype=np.uint8)
TURNED = Image.Exif()
TURNED[274] = 3
WITH_MESH = GOOD_URDF.replace('<box size="1 1 1"/>', '<mesh filename="package://p/a.stl"/>')
SEVERAL = NAV2.replace("RADIUS", "0.3")
IMAGE_OF_MAP = ROS_MAP.replace("map.png", "a.png")


def write_package(folder):
    """Write a URDF beside its package, which it does not find."""
    (folder / "far" / "p").mkdir(parents=True)
    CUBE.export(folder / "far" / "p" / "a.stl")
    return write(folder, "robot.urdf", WITH_MESH)


@refusals(
    "call, advised, hint",
    (
        lambda f: from_image(save_image(f, GREY), threshold=50),
        lambda f: from_image(f / "a.png", threshold=0.5),
        "pass e.g. 0.5",
    ),
    (lambda f: from_image(save_image(f, GREY), dark="black"), "dark is 'black'"),
    (
        lambda f: from_image(save_image(f, GREY.astype(np.int32), "a.tif")),
        lambda f: from_image(save_image(f, GREY)),
        "convert it, e.g. to an 8-bit grey PNG",
    ),
    (
        lambda f: [
            save_image(f, GREY, exif=TURNED),
            Workspace.open(write(f, "a.yaml", IMAGE_OF_MAP)),
        ],
        lambda f: [save_image(f, GREY[::-1, ::-1]), Workspace.open(f / "a.yaml")],
        "save it upright",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(MESSAGE, free_thresh=0.9),
        lambda f: Workspace.from_occupancy_grid(MESSAGE, free_thresh=0.25, occupied_thresh=0.65),
        "pass e.g. 0.25 and 0.65",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, width=3)),
        lambda f: Workspace.from_occupancy_grid(MESSAGE),
        "msg has data of shape (4,) and type int8; it must have width x height = 3 x 2 whole numbers, from -1 to 100; pass the whole message",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(np.eye(2)),
        lambda f: Workspace.from_occupancy_grid(MESSAGE),
        "pass such a message or write such a table",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, origin=tilt(0.5))),
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, origin=tilt(0.0))),
        "msg.info.origin.orientation is (0.5, 0, 0, 1), which is tilted; a map must lie flat, turned about z only; publish it in a frame whose z points up",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(change(MESSAGE, origin=turned(1.57, 1.0))),
        lambda f: Workspace.from_occupancy_grid(
            change(MESSAGE, origin=turned(math.sin(1.57 / 2), math.cos(1.57 / 2)))
        ),
        "set z to sin(yaw / 2) and w to cos(yaw / 2)",
    ),
    (
        lambda f: small_map().to_costmap(MESSAGE),
        "nav2_msgs",
    ),
    (
        lambda f: from_array(raster().transpose("y", "x").drop_vars(["x", "y"])),
        lambda f: from_array(raster().drop_vars(["x", "y"])),
        "they must be x, y (and z), in this order; project, rename or transpose it",
    ),
    (
        lambda f: from_mesh(trimesh.Scene([CUBE, CLOUD])),
        lambda f: from_mesh(trimesh.Scene([CUBE])),
        "remove it, or pass the meshes alone",
    ),
    (
        lambda f: from_mesh(CLOUD),
        lambda f: Workspace.from_points(np.asarray(CLOUD.vertices), 0.1, radius=0.0),
        "use Workspace.from_points for points",
    ),
    (
        lambda f: from_mesh(3),
        lambda f: [
            from_mesh(mesh) for mesh in (CUBE, trimesh.Scene([CUBE]), (CUBE.vertices, CUBE.faces))
        ],
        "pass a file name, a trimesh.Trimesh, a trimesh.Scene, or vertices and faces",
    ),
    (
        lambda f: from_mesh((CUBE.vertices[:, :2], CUBE.faces)),
        lambda f: from_mesh((CUBE.vertices, CUBE.faces)),
        "pass x, y, z of each vertex",
    ),
    (
        lambda f: from_mesh((CUBE.vertices, CUBE.faces[:, :2])),
        lambda f: from_mesh((CUBE.vertices, CUBE.faces)),
        "faces of mesh has shape (12, 2) and dtype int64; it must be (F, 3), of whole numbers; pass three vertex indices per triangle",
    ),
    (
        lambda f: from_mesh((CUBE.vertices, [])),
        lambda f: Workspace.from_points(CUBE.vertices, 0.1, radius=0.0),
        "mesh has no triangles; a mesh needs one; for a cloud of points use Workspace.from_points",
    ),
    (
        lambda f: Workspace.open(write(f, "a.xyz", "nan 0 0\n1 1 1\n"), spacing=0.1, radius=0.1),
        lambda f: Workspace.open(f / "a.xyz", spacing=0.1, radius=0.1, drop_missing=True),
        "pass drop_missing=True to leave them out",
    ),
    (
        lambda f: [np.save(f / "a.npy", np.eye(2)), Workspace.from_points(f / "a.npy", 0.1)],
        lambda f: [np.save(f / "a.npy", np.eye(3)), Workspace.from_points(f / "a.npy", 0.1)],
        "save one of that shape",
    ),
    (
        lambda f: Robot.open(write(f, "a.yaml", SEVERAL)),
        lambda f: [
            Robot.from_nav2(f / "a.yaml", costmap="local_costmap"),
            Robot.open(f"{f}/a.yaml#local_costmap"),
        ],
        "pass e.g. costmap='local_costmap', or a.yaml#local_costmap",
    ),
    (
        lambda f: Robot.from_nav2(write(f, "a.yaml", SEVERAL), "near"),
        lambda f: Robot.from_nav2(f / "a.yaml", "global_costmap"),
        "name one of these",
    ),
    (
        lambda f: Robot.open(write_package(f)),
        lambda f: Robot.open(f / "robot.urdf", package_dirs=f / "far"),
        "or pass package_dirs=FOLDER, where FOLDER holds the folder of its package",
    ),
    (
        lambda f: Robot.from_urdf(write_package(f), package_dirs=3),
        lambda f: Robot.from_urdf(f / "robot.urdf", package_dirs=[f / "far"]),
        "package_dirs is 3; it must be a folder, or a list of folders; pass paths",
    ),
    (
        lambda f: Robot.from_urdf(write_package(f), package_dirs=[f / "fra"]),
        lambda f: Robot.from_urdf(f / "robot.urdf", package_dirs=[f / "far"]),
        "each must be an existing folder that holds the folders of packages; correct its name",
    ),
    (
        lambda f: Robot.from_urdf(write(f, "a.urdf", GOOD_URDF), solid="surface"),
        lambda f: Robot.from_urdf(f / "a.urdf"),
        "omit it, or name links with only meshes",
    ),
    (
        lambda f: Robot.from_urdf(write(f, "a.urdf", GOOD_URDF.replace(BOX, "", 1)), "base"),
        lambda f: Robot.from_urdf(f / "a.urdf", "top"),
        "name links that have: top",
    ),
    (
        lambda f: Workspace.open(3, spacing=0.1),
        lambda f: [from_image(str(save_image(f, GREY))), from_image(f / "a.png")],
        "pass a string or a pathlib.Path",
    ),
    (
        lambda f: Workspace.open(f / "a.xyz"),
        lambda f: Workspace.open(write(f, "a.xyz", "0 0 0"), spacing=0.05, radius=0.05),
        "pass e.g. spacing=0.05",
    ),
    (
        lambda f: Workspace.open(write(f, "a.map", f"{OCTILE}."), unknown="free"),
        lambda f: Workspace.open(f / "a.map"),
        "leave it out",
    ),
    (
        lambda f: small_map().export(write(f, "a.yaml", "")),
        lambda f: small_map().export(f / "a.yaml", overwrite=True),
        "pass overwrite=True",
    ),
    (
        lambda f: small_map().export(f / "new" / "a.yaml"),
        lambda f: [(f / "new").mkdir(), small_map().export(f / "new" / "a.yaml")],
        "create it first",
    ),
    (
        lambda f: Workspace.open(write(f, "a.bt", "# Octomap\n"), unknown="free"),
        lambda f: Workspace.open(save_image(f, GREY), spacing=0.1),
        "pass an OctoMap",
    ),
    (
        lambda f: [save_image(f, GREY, "a.pgm"), append(f / "a.pgm"), from_image(f / "a.pgm")],
        lambda f: from_image(save_image(f, GREY, "a.pgm")),
        "fetch it again, as a binary file",
    ),
    (
        lambda f: [(f / "a.zarr").mkdir(), Workspace.open(f / "a.zarr", spacing=0.1)],
        lambda f: [write_array(f), Workspace.open(f / "a.zarr", spacing=0.1)],
        "write it with zarr.create_array",
    ),
    (
        lambda f: Workspace.open(write_array(f, {}), spacing=0.1).outer,
        lambda f: Workspace.open(write_array(f), spacing=0.1).outer,
        "zarr.create_array(..., config={'write_empty_chunks': True})",
    ),
    (
        lambda f: cspace.open(f / "a.zarr"),
        lambda f: [small_map().save(f / "a.zarr"), cspace.open(f / "a.zarr")],
        "build the map first, with cspace.build",
    ),
    (
        lambda f: Workspace.open(save_image(f, GREY).with_name("b.png"), spacing=0.1),
        lambda f: Workspace.open(f / "a.png", spacing=0.1),
        "a.png? check the name",
    ),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_file_that_is_read_as_the_hint_says_is_accepted(call, advised, hint, tmp_path):
    check_followed(lambda: call(tmp_path), advised and (lambda: advised(tmp_path)), hint)


@refusals(
    "call, advised, hint",
    (
        lambda f: from_image(save_image(f, GREY, pnginfo=with_gamma(100_000))),
        lambda f: from_image(save_image(f, GREY, pnginfo=with_gamma(45_455))),
        "save it with a gamma of 1/2.2",
    ),
    (
        lambda f: from_image(save_image(f, GREY, "a.tif", tiffinfo={33550: (0.1, 0.1, 0.0)})),
        lambda f: from_array(np.asarray(Image.open(f / "a.tif"))[::-1].T < 128),
        "pass the array to Workspace.from_array",
    ),
    (
        lambda f: Workspace.from_occupancy_grid(with_data(254)),
        lambda f: Workspace.from_occupancy_grid(
            with_data(*np.where(np.array([254]) >= 253, 100, 0))
        ),
        "pass e.g. np.where(costs >= 253, 100, 0)",
    ),
    (
        lambda f: Workspace.from_moveit_scene(
            write(f, "s.yaml", CARRIED), 0.1, (-2,) * 3 + (2,) * 3
        ),
        lambda f: read_scene(f / "s.yaml"),
        "use arm.attach",
    ),
    (
        lambda f: Robot.open(write(f, "a.urdf", URDF.replace("JOINT", SWINGING))),
        lambda f: Robot.from_urdf(f / "a.urdf", ["base", "top"]),
        "name all links, which are placed with their joints at zero",
    ),
    (
        lambda f: Robot.open(write(f, "a.urdf", GOOD_URDF.replace("collision", "visual", 2))),
        lambda f: Robot.open(f / "a.urdf", visuals=True),
        "or pass visuals=True",
    ),
    (
        lambda f: Robot.open(write_elsewhere(f)),
        lambda f: Robot.open(f / "u" / "robot.urdf", package_dirs=f / "far"),
        "if this is wrong, pass package_dirs=FOLDER",
    ),
)
def test_a_file_that_is_read_as_the_warning_says_gives_no_warning(call, advised, hint, tmp_path):
    with pytest.warns(UserWarning, match=re.escape(hint)):
        call(tmp_path)
    with warnings.catch_warnings(action="error", category=UserWarning):
        warnings.filterwarnings("ignore", ".*fits into one cell", UserWarning)
        advised(tmp_path)


CARRIED = scene(
    THING,
    robot_state={
        "attached_collision_objects": [
            {"link_name": "top", "object": THING | {"id": "held", "header": {"frame_id": "top"}}}
        ]
    },
)
SWINGING = TURNING.replace('<mimic joint="j"/>', "")


def read_scene(file):
    """Attach the objects of a scene to an arm."""
    arm = cspace.Arm.from_urdf(write(file.parent, "a.urdf", URDF.replace("JOINT", SWINGING)))
    for name, carried in cspace.arms.read_moveit_scene(file).attached.items():
        arm = arm.attach(name, carried.shape.shape, carried.link, carried.shape.pose)
    return arm


def with_gamma(value):
    """Return the metadata of a PNG with a gamma, times 100,000."""
    info = PngInfo()
    info.add(b"gAMA", struct.pack(">I", value))
    return info


def with_data(*data):
    """Return a message of one row of cells."""
    message = change(MESSAGE, width=len(data), height=1)
    message.data = [int(value) for value in data]
    return message


def write_elsewhere(folder):
    """Write a URDF whose mesh lies beside it without the folder of its package."""
    write_package(folder)
    (folder / "u").mkdir()
    CUBE.export(folder / "u" / "a.stl")
    return write(folder / "u", "robot.urdf", WITH_MESH)

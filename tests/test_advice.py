"""Each hint that names something to do is followed, and makes the right world."""

import ast
import dataclasses
import inspect
import math
import re
import warnings
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import matplotlib.patches
import matplotlib.path
import numpy as np
import pandas as pd
import pytest
import scipy.linalg
import scipy.ndimage
import scipy.sparse
import shapely
import trimesh
import xarray
import yaml
import yourdfpy
from PIL import Image
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import Grid, Robot, Workspace, build
from cspace.lanes import Mover, apart
from tests.helpers.refusals import list_calls, write
from tests.helpers.urdfs import joint, link, planar_arm
from tests.helpers.urdfs import write_urdf as write_arm

ADVICE = re.compile(
    r"""
    \b(?P<name>\w+)=(?P<value>'[^']*'|\([^)]*\)|\[[^\]]*\]|True|False|-?\d[\d.e-]*)  # an option
    | \.(?P<method>\w+)\(\)                                      # a method
    | (?:pass|write|cells\ of)\ (?P<number>[\d.]+\w*)\ (?:for|m)  # a value
    | by\ (?P<move>\(.*?\))\ m                                   # a way
    """,
    re.VERBOSE,
)
"""Option, method or value that a message advises."""

WALL = np.zeros((30, 20), dtype=bool)
WALL[4, 2:9] = True


def read_message(call):
    """Return the texts of the warnings, and the hint of the refusal, of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            call()
        except cspace.CspaceError as error:
            caught.append(error)
    return "; ".join(str(getattr(each, "message", "")) or each.hint for each in caught)


def read_advice(text):
    """Return the options of each way that a message advises."""
    ways = [{}]
    for found in ADVICE.finditer(text):
        value = found["value"] or found["move"] or "None"
        name, value = found["name"] or "move", ast.literal_eval(value)
        if found["method"]:
            name, value = "method", found["method"]
        if found["number"]:
            name, value = "value", found["number"]
        if ways[-1].get(name, value) != value:
            ways.append({})
        ways[-1][name] = value
    if "space.exact" in text:
        ways[-1]["exact"] = True
    return ways


def open_array(array, **options):
    return Workspace.from_array(array, **{"spacing": 0.1} | options)


def open_corner(x, y, **options):
    """Return the world of a wall with its lower corner near a place."""
    wall = shapely.box(x + 0.25, y + 0.5, x + 2.0, y + 1.0)
    return Workspace.from_polygons([wall], 0.25, **options)


def label(cells, spacing):
    """Return cells with the coordinates of their centers."""
    coordinates = {
        name: spacing * (np.arange(count) + 0.5)
        for name, count in zip("xy", cells.shape, strict=True)
    }
    return xarray.DataArray(cells, dims=("x", "y"), coords=coordinates)


def write_ros_image(folder):
    """Write the image of a ROS map, all unknown but a free and an occupied cell."""
    pixels = np.full((20, 30), 205, dtype=np.uint8)
    pixels[:, :10] = 254
    pixels[5] = 0
    Image.fromarray(pixels).save(folder / "map.pgm")
    lines = ["image: map.pgm", "resolution: 0.1", "origin: [0, 0, 0]", "negate: 0"]
    thresholds = ["occupied_thresh: 0.65", "free_thresh: 0.196"]
    (folder / "map.yaml").write_text("\n".join(lines + thresholds))
    return folder / "map.pgm"


def write_nav2(folder):
    """Write the parameters of two costmaps with robots of different radius."""
    path = folder / "nav2.yaml"
    lines = [
        "{0}:",
        "  {0}:",
        "    ros__parameters:",
        "      robot_radius: {1}",
        "      footprint_padding: 0.0",
        "",
    ]
    costmap = "\n".join(lines)
    path.write_text(costmap.format("local_costmap", 0.2) + costmap.format("global_costmap", 0.4))
    return path


def write_urdf(folder, kind):
    """Write a robot of one link whose box is drawn, or collides."""
    path = folder / kind / "robot.urdf"
    path.parent.mkdir(exist_ok=True)
    box = f'<{kind}><geometry><box size="0.4 0.2 0.1"/></geometry></{kind}>'
    path.write_text(f'<robot name="r"><link name="base">{box}</link></robot>')
    return path


def write_points(folder):
    path = folder / "scan.npy"
    np.save(path, np.array([[0.5, 0.5, 0.5], [np.nan] * 3, [1.5, 0.5, 0.5]]))
    return path


def open_points(path, **options):
    return Workspace.open(path, spacing=0.1, radius=0.1, **options)


def tilted_pose():
    turn = {"x": np.sin(0.05), "y": 0.0, "z": 0.0, "w": np.cos(0.05)}
    pose = {"position": dict.fromkeys("xyz", 0.0), "orientation": turn}
    return {"header": {"frame_id": "map"}, "pose": pose}


def write_grey_map(folder):
    """Write a ROS map with a grey that map savers write for unknown cells, below free_thresh."""
    path = write_ros_image(folder).with_suffix(".yaml")
    path.write_text(path.read_text().replace("0.196", "0.25"))
    return path


def turning():
    """Build a map of a robot that turns."""
    return build(Workspace.from_array(WALL, 0.1), Robot.disc(0.05), rotations=4)


# ---- meshes and robots ---------------------------------------------------------------------------

CORNERS = np.array([(0.0, 0.0), (0.4, 0.0), (0.4, 0.2), (0.0, 0.2)])
PLATE = trimesh.creation.box((1.2, 0.3, 0.8))


def measure_plate(folder, **options):
    """Return the box of a plate whose file has y up."""
    PLATE.export(folder / "plate.glb")
    return np.array(cspace.make_mesh(folder / "plate.glb", **options).bounds)


def loose_box():
    """Make a box with a lid that touches no wall."""
    box = trimesh.creation.box((0.9, 0.9, 0.9))
    box.update_faces(box.face_normals[:, 2] < 0.5)
    lid = [(-0.43, -0.43, 0.45), (0.43, -0.43, 0.45), (0.43, 0.43, 0.45), (-0.43, 0.43, 0.45)]
    return trimesh.util.concatenate([box, trimesh.Trimesh(lid, [(0, 1, 2), (0, 2, 3)])])


def fill_box(solid):
    """Return the cells of a box of 10 cells a side, which may be hollow."""
    cells = np.ones((10, 10, 10), dtype=bool)
    cells[1:9, 1:9, 1:9] = solid == "fill"
    return Workspace.from_array(cells, 0.1, (-0.5, -0.5, -0.5))


def map_wall(robot):
    return build(Workspace.from_array(WALL, 0.1), robot, outside="free").cell_states


def use_method(robot, method=None):
    """Return what a method of a robot makes, or the robot."""
    return getattr(robot, method)() if method else robot


# ---- limits and outputs --------------------------------------------------------------------------


def raster_wall(value):
    """Map the wall, while memory is scarce."""
    with mock.patch("cspace._support.limits.free_bytes", return_value=4400):
        walls = [shapely.box(0.42, 0.22, 0.48, 0.88)]
        return Workspace.from_polygons(walls, float(value), bounds=(0, 0, 3, 2))


def read_limited(folder, max_bytes=16):
    """Read points, while files may hold few bytes."""
    with cspace.raised_limits(max_bytes=max_bytes):
        return open_points(write_points(folder), drop_missing=True)


def export_again(folder, **options):
    """Export a map to a file that exists, and read it."""
    file = folder / "map.npz"
    if not file.exists():
        file.write_text("old")
    build(Workspace.from_array(WALL, 0.1), Robot.disc(0.05), outside="free").export(file, **options)
    return np.load(file)["cell_states"]


# ---- plans ---------------------------------------------------------------------------------------


def start_beside(exact=False):
    """Plan from a place beside the wall, in an undecided cell, and return where it starts."""
    space = build(Workspace.from_array(WALL, 0.1), Robot.disc(0.05))
    plan = planners.plan(space.exact if exact else space, (0.345, 0.55), (0.15, 0.55))
    return plan.waypoints[0]


def turn_at_most_half(rate):
    """Return 1.0 if rows of a tight turn lie at most half a turn apart, or else 0.0."""
    space = build(
        Workspace.from_array(np.zeros((60, 60), dtype=bool), 0.1), "disc:0.1", rotations=8
    )
    plan = planners.plan(space, (3, 3, 0), (3, 3.1, 3), drive=planners.Car(turning_radius=0.5))
    motion = plan.trajectory(max_velocity=1.0, max_angular_velocity=9.0, max_acceleration=100.0)
    fine = motion.sample_uniform(1000.0)
    yaws = np.unwrap(fine.positions[:, 2])
    rows = motion.sample_uniform(rate).times
    return float(np.abs(np.diff(np.interp(rows, fine.times, yaws))).max() <= np.pi)


# ---- arms, graphs and commands -------------------------------------------------------------------


def write_chain(folder, floats):
    """Write an arm of one joint, on a base that floats or is fixed."""
    bar = ((0.3, 0.1, 0.1), (0.2, 0, 0))
    parts = [link("l0"), joint("j0", "l0", "l1", kind="floating", limits=None)]
    moves = joint("j1", "l1", "l2", (0.5, 0, 0))
    return write_arm(folder, *parts * floats, link("l1", bar), link("l2", bar), moves)


def reach(urdf, **options):
    """Return poses of the last link of an arm."""
    arm = cspace.Arm.from_urdf(urdf, **options)
    return np.stack([arm.pose((q,), "l2") for q in (-1.0, 0.0, 2.0)])


def stand_in_post(folder, **options):
    """Return whether an arm moves whose last link always stands in a post."""
    place = trimesh.transformations.translation_matrix((0.5, 0, 0))
    post = cspace.arms.PosedShape(Robot.box((0.2, 0.2, 0.2)).shape, place)
    arm = cspace.Arm.from_urdf(write_chain(folder, False))
    return cspace.build_arm_space({"post": post}, arm, **options).is_free([(-1.0,), (2.0,)]) * 1.0


def place_nodes(folder, *levels, **options):
    """Return the nodes of a graph, whose levels have a lane each."""
    nodes = {
        name: [[n, 0.0, {"name": "a"}], [n, 5.0, {"name": "b"}]] for n, name in enumerate(levels)
    }
    graph = {name: {"vertices": each, "lanes": [[0, 1, {}]]} for name, each in nodes.items()}
    file = folder / "rmf.yaml"
    file.write_text(yaml.safe_dump({"building_name": "b", "levels": graph}))
    return np.array(cspace.lanes.RouteGraph.open(file, **options).positions)


def parse_yaw(value="90"):
    """Parse a yaw of a command."""
    from cspace._cli.options import parse_angle

    return np.array(parse_angle(value, "yaw", "yaw"))


ROWS = {
    "the spacing of labelled cells": (
        lambda _, **options: open_array(label(WALL, 0.5), **options),
        lambda _: Workspace.from_array(WALL, 0.5),
    ),
    "the threshold of a picture with unknown cells": (
        lambda folder, **options: Workspace.open(write_ros_image(folder), spacing=0.1, **options),
        lambda folder: Workspace.open(write_ros_image(folder).with_suffix(".yaml")),
    ),
    "points without coordinates": (
        lambda folder, **options: open_points(write_points(folder), **options),
        lambda _: Workspace.from_points([(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)], 0.1, radius=0.1),
    ),
    "one of two costmaps": (
        lambda folder, path=None: Robot.open(path or write_nav2(folder)),
        lambda _: Robot.disc(0.2),
    ),
    "a pose that is tilted a little": (
        lambda _, **options: cspace.ros.configuration_of(tilted_pose(), turning(), **options),
        lambda _: (0.0, 0.0, 0.0),
    ),
    "an angle in degrees": (
        lambda _, value=30.0: planners.Upright("hand", tolerance=float(value)).tolerance,
        lambda _: np.radians(30.0),
    ),
    "milliseconds": (
        lambda _, value=100.0: cspace.Gate(turning(), dt=float(value), max_velocity=1.0).dt,
        lambda _: 0.1,
    ),
    "unknown cells of a map as free": (
        lambda folder, **options: Workspace.open(write_grey_map(folder), **options),
        lambda folder: Workspace.open(write_ros_image(folder), spacing=0.1, threshold=0.1),
    ),
    "heights without data": (
        lambda _, **options: (
            1.0 * Workspace.from_heights([[0.0, 1.0, np.nan]], 0.5, **options).outer
        ),
        lambda _, unknown: np.array([[[0.0] * 2, [1.0] * 2, [float(unknown == "occupied")] * 2]]),
    ),
    "links that are only drawn": (
        lambda folder, **options: Robot.open(write_urdf(folder, "visual"), **options),
        lambda folder: Robot.open(write_urdf(folder, "collision")),
    ),
    "the axis that points up": (
        lambda folder, **options: measure_plate(folder, **options),
        lambda _, up: PLATE.bounds if up == "z" else PLATE.bounds[:, [0, 2, 1]],
    ),
    "an open mesh": (
        lambda _, **options: Workspace.from_mesh(
            loose_box(), 0.1, bounds=((-0.5,) * 3, (0.5,) * 3), **options
        ),
        lambda _, solid: fill_box(solid),
    ),
    "a robot far from its origin": (
        lambda _, move=(0, 0): map_wall(Robot.polygon(CORNERS + 5.0 + move)),
        lambda _: map_wall(Robot.rectangle(0.4, 0.2)),
    ),
    "a mesh far from its origin": (
        lambda _, move=(0, 0, 0): (
            Robot.from_mesh(
                PLATE.copy().apply_translation((1e3, 0, 0)).apply_translation(move)
            ).shape.bounds
        ),
        lambda _: PLATE.bounds,
    ),
    "a robot in space on a map of the plane": (
        lambda _, **way: map_wall(use_method(Robot.box((0.4, 0.2, 0.5)), **way)),
        lambda _: map_wall(Robot.rectangle(0.4, 0.2)),
    ),
    "cells that fit into memory": (
        lambda _, value=1e-3: raster_wall(value),
        lambda _: Workspace.from_array(WALL, 0.1),
    ),
    "a file above a limit": (
        read_limited,
        lambda _: Workspace.from_points([(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)], 0.1, radius=0.1),
    ),
    "a file that exists": (
        export_again,
        lambda _: np.where(WALL, 2, scipy.ndimage.maximum_filter(WALL, 3))[np.newaxis],
    ),
    "a start in an undecided cell": (
        lambda _, **options: start_beside(**options),
        lambda _: np.array((0.345, 0.55)),
    ),
    "a low rate": (
        lambda _, rate=0.1: turn_at_most_half(rate),
        lambda _: 1.0,
    ),
    "a base that floats": (
        lambda folder, **options: reach(write_chain(folder, True), **options),
        lambda folder: reach(write_chain(folder, False)),
    ),
    "a link that always touches": (
        stand_in_post,
        lambda _: np.ones(2),
    ),
    "one of two levels": (
        lambda folder, **options: place_nodes(folder, "L1", "L2", **options),
        lambda folder: place_nodes(folder, "L1"),
    ),
    "a yaw in degrees": (
        lambda _, **way: parse_yaw(**way),
        lambda _: np.pi / 2,
    ),
    "obstacles in survey coordinates": (
        lambda _, **way: open_corner(515000.0, 4250000.0, **way),
        lambda _: open_corner(0.0, 0.0),
    ),
}
"""Call that is refused or warned of and takes what the message advises, and the right world."""


@pytest.mark.parametrize("call, right", ROWS.values(), ids=ROWS)
def test_what_a_message_advises_makes_the_right_world(call, right, tmp_path):
    ways = read_advice(read_message(lambda: call(tmp_path)))
    for way in ways:
        assert way
        with warnings.catch_warnings(action="ignore"):
            world = right(tmp_path, **way) if len(ways) > 1 else right(tmp_path)
            assert describe(call(tmp_path, **way)) == describe(world)


def describe(world):
    """Return what tells worlds apart: cells and places, outlines, faces, nodes, numbers."""
    if isinstance(world, Workspace):
        lower = np.round(world.grid.lower, 9).tolist()
        return lower, world.grid.spacing, world.outer.tolist()
    if isinstance(world, Robot):
        return world.spec
    for name in ("faces", "regular_faces", "positions", "pose"):
        world = getattr(world, name, world)
    return np.round(np.asarray(world, float), 6).tolist()


# ---- values of other kinds -----------------------------------------------------------------------

POINTS = np.array([(0.5, 0.5, 0.25), (1.5, 1.0, 0.5)])
MESH = trimesh.creation.box().vertices, trimesh.creation.box().faces
TRIANGLES = SimpleNamespace(points=MESH[0], regular_faces=MESH[1])
"""The mesh as PyVista has it."""

SQUARE = [[0.5, 0.5], [2.0, 0.5], [2.0, 1.5], [0.5, 1.5]]
HOLE = [[1.0, 0.75], [1.5, 0.75], [1.0, 1.25]]
PLACE = SimpleNamespace(x=0.5, y=1.5, z=0.0)
TURN = SimpleNamespace(x=0.0, y=0.0, z=0.6, w=0.8)
POSE = SimpleNamespace(position=PLACE, orientation=TURN)
HERE = (0.5, 1.5, 2.0 * math.atan2(0.6, 0.8))
TABLE = pd.DataFrame({"y": [1.55], "x": [0.55]})
BRAKES = {
    "max_velocity": 1.0,
    "max_acceleration": 0.5,
    "max_angular_velocity": 1.0,
    "max_angular_acceleration": 1.0,
}
CAN = {
    "id": "can",
    "header": {"frame_id": "world"},
    "primitives": [{"type": "box", "dimensions": [0.5, 0.5, 1.0]}],
    "primitive_poses": [{"position": [0.75, 0.5, 0.5], "orientation": [0, 0, 0, 1]}],
    "operation": "add",
}
SCENE = {"world": {"collision_objects": [CAN]}}
LEVELS = {"building_name": "b", "levels": {"L": {"vertices": [[1, 2, {}]], "lanes": []}}}
NODE = {"nodeId": "a", "nodePosition": {"x": 1.0, "y": 2.0}}
LAYOUTS = {"metaInformation": {}, "layouts": [{"nodes": [NODE], "edges": []}]}


def shift(*position):
    """Return the pose of a frame that is moved, shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = position
    return pose


def make_message(**fields):
    return SimpleNamespace(header=SimpleNamespace(frame_id="map"), **fields)


def make_grid():
    """Make the message of the wall."""
    grid = cspace.ros.OccupancyGrid()
    grid.info.width, grid.info.height, grid.info.resolution = 30, 20, 0.1
    grid.data.extend((100 * WALL.T.ravel()).tolist())
    return grid


def read_fields(cloud):
    """Return the points of a message as ``sensor_msgs_py.point_cloud2`` does."""
    return np.frombuffer(cloud.data, [(name, "f4") for name in cloud.fields])


@cache
def find_plan():
    return planners.plan(turning(), (0.2, 1.5, 0.0), (2.5, 1.5, 0.5))


def move():
    return find_plan().trajectory(**BRAKES)


class Tensor:
    """As a tensor of Open3D, on another device."""

    def cpu(self):
        """Return a copy in memory."""
        return SimpleNamespace(numpy=lambda: POINTS)

    numpy = None


def make_graph():
    """Make a graph of networkx with one edge."""
    graph = pytest.importorskip("networkx").DiGraph()
    graph.add_node("a", pos=(0.0, 1.0))
    graph.add_node("b", pos=(2.0, 1.0))
    graph.add_edge("a", "b")
    return graph


def make_octree():
    """Make an OctoMap with one voxel."""
    tree = pytest.importorskip("octomap").OcTree(0.25)
    tree.updateNode(np.full(3, 0.125), True)
    return tree


# ---- calls that refuse such a value --------------------------------------------------------------


def from_array(value):
    return Workspace.from_array(value, 0.25)


def from_mesh(value):
    return Workspace.from_mesh(value, 0.1)


def from_points(value):
    return Workspace.from_points(value, 0.25)


def open_coarse(path):
    return Workspace.open(path, spacing=0.25)


def map_disc(workspace):
    return build(workspace, "disc:0.1")


def ask_place(q):
    return map_disc(Workspace.from_array(WALL, 0.1)).is_free(q)


def certify(path):
    return turning().certify_path(path)


def reach_pose(pose):
    return cspace.PoseGoal("fore", pose)


def add_zone(shape):
    return turning().add_obstacle("zone", shape)


def slow_in(areas):
    return planners.SpeedZones([(areas, 0.5)])


def meet(motion):
    return apart(Mover("disc:0.1", motion), Mover("disc:0.1", (2.0, 0.5)))


# ---- what holds for what a hint makes of it ------------------------------------------------------


def is_proven(path):
    return certify(path).all()


def is_met(motion):
    return meet(motion).verdict


def has_can(space):
    return list(space.obstacles) == ["can"]


def is_filled(workspace):
    return workspace.outer.all()


def covers(area):
    """Return whether polygons, as zones, cover an area."""
    return lambda areas: slow_in(areas).zones[0][0].area == area


def is_in_cell(table):
    return Grid((0, 0), 0.1, (30, 20)).cell_of(table).tolist() == [[5, 15]]


def holds_balls(centers):
    """Return whether a workspace holds balls."""
    return lambda world: world.shapes[0].centers.tolist() == centers


KINDS = {
    "a cloud": (
        make_message(data=POINTS.astype("f4").tobytes(), point_step=12, fields="xyz"),
        from_points,
        lambda world: np.stack([world[axis] for axis in "xyz"], -1).tolist() == POINTS.tolist(),
    ),
    "a grid": (make_grid(), map_disc, Workspace.from_array(WALL, 0.1)),
    "a grid in a file": (
        lambda folder: write(folder, "grid.yaml", dataclasses.asdict(make_grid())),
        Workspace.open,
        Workspace.from_array(WALL, 0.1),
    ),
    "a scene": (
        lambda folder: write(folder, "scene.yaml", SCENE),
        open_coarse,
        is_filled,
        has_can,
    ),
    "a scene in a file of polygons": (
        lambda folder: write(folder, "scene.json", SCENE),
        open_coarse,
        is_filled,
        has_can,
    ),
    "a stamped pose": (make_message(pose=POSE), lambda q: turning().is_free(q), HERE),
    "a pose": (POSE, lambda q: planners.plan(turning(), q, (2.5, 1.5, 0.5)), HERE),
    "a pose without its stamp": (
        {"position": vars(PLACE), "orientation": vars(TURN)},
        lambda q: cspace.ros.configuration_of(q, turning()),
        HERE,
    ),
    "a transform": (
        make_message(transform=SimpleNamespace(translation=PLACE, rotation=TURN)),
        lambda q: turning().clearance(q),
        HERE,
    ),
    "a path of poses": (
        make_message(poses=[make_message(pose=POSE)] * 2),
        certify,
        [HERE, HERE],
    ),
    "joints": (
        make_message(name=["elbow", "shoulder"], position=[0.5, 0.25], velocity=[0.0, 0.0]),
        lambda q: planar_arm().pose(q, "fore"),
        [0.25, 0.5],
    ),
    "levels of lanes": (
        lambda folder: write(folder, "rmf.yaml", LEVELS),
        Workspace.open,
        [[1.0, 2.0]],
    ),
    "layouts": (lambda folder: write(folder, "lif.json", LAYOUTS), Robot.open, [[1.0, 2.0]]),
    "a plan for rows": (
        lambda _: find_plan(),
        certify,
        is_proven,
        lambda motion: motion.duration > 1.0,
    ),
    "a plan for a motion": (
        lambda _: find_plan(),
        meet,
        lambda path: path.shape[1] == 3,
        is_met,
    ),
    "a timing for a motion": (lambda _: cspace.lanes.Timing(move(), 1.0), meet, is_met),
    "a robot in space on a motion in the plane": (
        lambda _: Mover(Robot.box((0.2, 0.1, 0.3)), move()),
        lambda mover: apart(mover, Mover("disc:0.1", (2.0, 0.5))),
        lambda robot: robot.dim == 2,
    ),
    "corners with a height": ([(*corner, 0.5) for corner in SQUARE], add_zone, covers(1.5)),
    "a trajectory": (lambda _: move(), certify, is_proven),
    "a map": (lambda _: turning(), map_disc, Workspace.from_array(WALL, 0.1)),
    "a rigid motion": (
        SimpleNamespace(
            translation=np.ones(3), rotation=Rotation.identity(), as_matrix=lambda: np.eye(4)
        ),
        reach_pose,
        np.eye(4),
        (1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    ),
    "a rotation": (
        Rotation.identity(),
        cspace.Rotations.quaternions(1).check_rotation,
        [0.0, 0.0, 0.0, 1.0],
        0.0,
        np.eye(4),
    ),
    "a rotation in a row": (
        [(1.0, 1.0, 0.5), (1.0, 1.0, Rotation.from_rotvec((0.0, 0.0, 0.5)))],
        lambda q: turning().is_free(q),
        lambda quaternion: quaternion.shape == (4,),
        lambda yaw: yaw == pytest.approx(0.5),
        lambda pose: pose.shape == (4, 4),
    ),
    "a transposed pose": (shift(0.1, 0.2, 0.3).T, reach_pose, shift(0.1, 0.2, 0.3)),
    "a mesh of faces": (
        SimpleNamespace(vertices=MESH[0], faces=MESH[1]),
        from_mesh,
        MESH[1],
    ),
    "a cloud of trimesh": (trimesh.PointCloud(POINTS), from_mesh, holds_balls(POINTS.tolist())),
    "voxels of trimesh": (
        trimesh.creation.box(bounds=[(0.25, 0.5, 0.75), (1.5, 2.0, 1.25)]).voxelized(0.25),
        from_array,
        lambda world: (
            np.allclose(world.grid.lower, (0.125, 0.375, 0.625)) and world.grid.shape == (6, 7, 3)
        ),
    ),
    "an outline of trimesh": (
        lambda _: trimesh.load_path(shapely.box(0, 0, 1, 2)),
        lambda polygons: Workspace.from_polygons(polygons, 0.25),
        covers(2.0),
    ),
    "a graph": (lambda _: make_graph(), from_array, [[0.0, 1.0], [2.0, 1.0]]),
    "a mesh of triangles": (
        SimpleNamespace(vertices=MESH[0], triangles=MESH[1]),
        add_zone,
        MESH[1],
    ),
    "a mesh of cells": (
        SimpleNamespace(points=MESH[0], regular_faces=None, triangulate=lambda: TRIANGLES),
        Robot.from_mesh,
        MESH[1],
        MESH[0],
    ),
    "cells of a mesh": (
        SimpleNamespace(points_to_double=None, extract_surface=lambda: TRIANGLES),
        from_mesh,
        MESH[1],
    ),
    "cells with values": (
        SimpleNamespace(extract_surface=None, threshold=lambda lowest: (lowest, TRIANGLES)),
        from_mesh,
        lambda made: made == (0.5, TRIANGLES),
    ),
    "blocks of meshes": (
        SimpleNamespace(extract_surface=None, combine=lambda: TRIANGLES),
        from_mesh,
        MESH[1],
    ),
    "a mesh of several cells": (
        SimpleNamespace(points=MESH[0], cells_dict={"triangle": MESH[1]}),
        from_mesh,
        MESH[1],
    ),
    "a box of points": (
        SimpleNamespace(get_box_points=lambda: MESH[0]),
        from_mesh,
        lambda hull: hull.volume == 1.0 and hull.bounds.tolist() == [[-0.5] * 3, [0.5] * 3],
    ),
    "lines": (
        SimpleNamespace(points=MESH[0], lines=[(0, 1)], get_line_coordinate=None),
        from_mesh,
        [[0, 1, 1]],
    ),
    "a variable of several": (
        lambda _: xarray.Dataset({"cost": label(WALL, 0.1)}),
        from_array,
        lambda world: (world == WALL).all(),
    ),
    "a path of a plot": (
        matplotlib.path.Path([*SQUARE, SQUARE[0]], closed=True),
        lambda polygons: Workspace.from_polygons(polygons, 0.25),
        covers(1.5),
    ),
    "a rectangle of a plot": (
        matplotlib.patches.Rectangle((0.5, 0.5), 1.5, 1.0),
        Robot.polygon,
        covers(1.5),
    ),
    "a polygon of a plot": (matplotlib.patches.Polygon(SQUARE), add_zone, covers(1.5)),
    "an arm that was loaded": (
        lambda folder: yourdfpy.URDF.load(write_chain(folder, False)),
        cspace.Arm.from_urdf,
        lambda text: cspace.Arm.from_urdf(text).joints == ("j1",),
    ),
    "a map for a robot": (
        lambda _: turning(),
        lambda space: apart(Mover(space, (0.5, 0.5)), Mover("disc:0.1", (2.0, 0.5))),
        lambda robot: robot.spec == turning().robot.spec,
    ),
    "a field of distances": (
        SimpleNamespace(extract_triangle_mesh=lambda: TRIANGLES),
        from_mesh,
        MESH[1],
    ),
    "a mesh of tensors": (
        SimpleNamespace(vertex=None, cpu=None, to_legacy=lambda: TRIANGLES),
        from_mesh,
        MESH[1],
    ),
    "a tensor": (Tensor(), from_points, POINTS),
    "a cloud with normals": (
        SimpleNamespace(points=POINTS, normals=POINTS),
        from_points,
        POINTS,
    ),
    "voxels": (
        SimpleNamespace(
            voxel_size=0.25,
            get_voxels=lambda: [SimpleNamespace(grid_index=index) for index in (1, 3)],
            get_voxel_center_coordinate=lambda index: np.full(3, 0.125 + 0.25 * index),
        ),
        from_array,
        holds_balls([[0.375] * 3, [0.875] * 3]),
    ),
    "a tree of voxels": (
        lambda _: make_octree(),
        from_points,
        lambda _: np.count_nonzero(Workspace.open("map.bt").outer) == 1,
    ),
    "a relation": (SimpleNamespace(fetchdf=lambda: TABLE), ask_place, is_in_cell),
    "a lazy table": (SimpleNamespace(collect=lambda: TABLE), ask_place, is_in_cell),
    "sparse cells": (scipy.sparse.csr_array(WALL), from_array, WALL),
    "corners": (
        SQUARE,
        lambda polygons: Workspace.from_polygons(polygons, 0.25),
        covers(1.5),
    ),
    "rings": ([SQUARE, HOLE], add_zone, covers(1.375), covers(1.5)),
    "rings of several polygons": (
        [[SQUARE, HOLE], [(5.0 + np.array(SQUARE)).tolist()]],
        slow_in,
        covers(2.875),
    ),
}
"""Value, or what makes it in a folder; a call that refuses it; what each call of its hint makes."""


def refuse_kind(kind, folder):
    """Return the error of the call that refuses the value of a kind, and names for its hint."""
    value, refuse, *_ = KINDS[kind]
    if inspect.isfunction(value):
        value = value(folder)
    names = {
        "cspace": cspace,
        "name": "cost",
        "numpy": np,
        "scipy": scipy,
        "shapely": shapely,
        "point_cloud2": SimpleNamespace(read_points=read_fields),
        "space": turning(),
        "arm": planar_arm(),
        "first": SimpleNamespace(motion=value, robot=getattr(value, "robot", None)),
        "zones": [value],
        "spacing": 0.25,
        "lowest": 0.5,
        "trimesh": trimesh,
    }
    with pytest.raises(cspace.CspaceError) as caught:
        refuse(value)
    names.setdefault(caught.value.argument.partition("[")[0], value)
    return caught.value, names


@pytest.mark.parametrize("kind", KINDS)
def test_a_value_of_another_kind_is_taken_by_the_calls_of_its_hint(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # which a hint may write to
    error, names = refuse_kind(kind, tmp_path)
    limits = ", ".join(f"{name}={value}" for name, value in BRAKES.items())
    for call, expected in zip(list_calls(error.hint), KINDS[kind][2:], strict=True):
        world = eval(call.replace("...", limits), names)
        if inspect.isfunction(expected):
            assert expected(world), call
        else:
            assert describe(world) == describe(expected), call


# ---- no hint without a world ---------------------------------------------------------------------

ROOT = Path(cspace.__file__).parents[1]

MADE_ELSEWHERE = re.compile(r"suggest_\w+\(|\berrors?\b|BRING_YOUR_FILE|hint\b|\.parts")
"""Hints from other functions: the nearest name, a page, those of another error, an argument."""

NAMES_OPTION = re.compile(
    r"\b(?<!not )(?:add|call|pass|run|set|use|write) (?:e\.g\. )?(?:\w*=|\0|[\w.]+\(|[\[({])"
)
"""Advice anywhere in a text, whose values are replaced by zeros."""


def join_pieces(text):
    """Return a text of a program, with zeros for values."""
    parts = text.values if isinstance(text, ast.JoinedStr) else [text]
    joined = "".join(str(part.value) if isinstance(part, ast.Constant) else "\0" for part in parts)
    return joined.replace("{}", "\0")


def list_texts(expression, function):
    """Return the texts that a hint may be; a name stands for what a function assigns to it."""
    if isinstance(expression, ast.Constant | ast.JoinedStr):
        return [join_pieces(expression)]
    if isinstance(expression, ast.IfExp):
        return [t for e in (expression.body, expression.orelse) for t in list_texts(e, function)]
    assigned = [
        node.value
        for node in ast.walk(function)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == ast.unparse(expression)
    ]
    if assigned:
        return [text for value in assigned for text in list_texts(value, function)]
    source = ast.unparse(expression)
    return [] if MADE_ELSEWHERE.search(source) else [f"? {source}"]


def iterate_hints(function):
    """Yield the hint of each error that a function makes."""
    for node in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        position = {"fail": 2, "ContentError": 2}.get(name, 3)
        if name.endswith("Error") or name == "fail":
            yield from node.args[position : position + 1]
            yield from (each for each in node.args if isinstance(each, ast.Starred))
            yield from (keyword.value for keyword in node.keywords if keyword.arg == "hint")


def list_advice(tree):
    """Return each text of a file that advises, with zeros for values."""
    texts = set()
    passed = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for part in node.values
    }
    passed |= {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)
    }  # docstrings
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            texts.update(t for hint in iterate_hints(node) for t in list_texts(hint, node))
        elif isinstance(node, ast.JoinedStr | ast.Constant) and id(node) not in passed:
            text = join_pieces(node)
            texts.update([text] if NAMES_OPTION.search(text) else [])
    return texts - {""}


def is_part(text, messages):
    """Return True if a message has a text, with any values in place of its zeros."""
    pattern = ".+?".join(map(re.escape, text.split("\0")))
    return any(re.search(pattern, message) for message in messages)


def test_each_hint_of_the_packages_is_followed_into_its_world(tmp_path):
    messages = [read_message(partial(call, tmp_path)) for call, _ in ROWS.values()]
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        messages.append(refuse_kind(kind, tmp_path / kind)[0].hint)
    files = [file for name in ("cspace", "planners") for file in (ROOT / name).rglob("*.py")]
    advice = {text: file for file in files for text in list_advice(ast.parse(file.read_text()))}
    assert len(advice) > 15
    assert not {text: file for text, file in advice.items() if not is_part(text, messages)}


@pytest.mark.parametrize(
    "code",
    [
        'raise InputError("a", "is 1", "it must be 2", "take 2")',
        'hint = f"take {n}"\n    raise InputError("a", "is 1", "it must be 2", hint)',
        'warn_user(f"odd; pass frobnicate={n}")',
        'yield f"odd; pass {option}"',
        'raise InputError("a", "is 1", "it must be 2", advise(2))',
        'raise InputError("a", "is 1", *ADVICE)',
        'raise table.fail("is 1", "it must be 2", "take 2" if a else "")',
    ],
)
def test_advice_without_a_world_is_found(code):
    (text,) = list_advice(ast.parse(f"def check():\n    {code}"))
    assert not is_part(text, ["pass spacing=2"])

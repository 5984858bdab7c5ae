"""Work of one kind on growing inputs: ``python tests/growth/count.py KIND`` prints its counts as JSON.

Work is counted, not timed: lines of Python that run, kernels among them, as this process does not
compile; numbers that are allocated, which NumPy's results are; and numbers that ``reduceat`` reads,
which it may do again and again without an allocation.
"""

import gc
import itertools
import json
import math
import os
import sys
import tempfile
import tracemalloc
import warnings
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from unittest.mock import Mock

import numba


def interpret(**options):
    """Take the place of ``numba.njit``, so that kernels run as Python."""

    def decorate(function):
        function.compile = lambda types: None
        function.enable_caching = lambda: None
        function._cache = Mock()
        function.get_overload = lambda types: function
        return function

    return decorate


numba.njit = interpret
os.sched_getaffinity = lambda process: {0}  # one thread, which is traced

import numpy as np  # noqa: E402
import shapely  # noqa: E402
import trimesh  # noqa: E402
from PIL import Image  # noqa: E402

import cspace  # noqa: E402
import planners  # noqa: E402
from cspace import Robot, Workspace  # noqa: E402
from cspace._support import limits  # noqa: E402
from cspace.arms import PosedShape  # noqa: E402
from cspace.errors import FileError  # noqa: E402
from cspace.lanes import RouteGraph  # noqa: E402
from tests.helpers.handmade import build_empty  # noqa: E402

for each in walk_packages(cspace.__path__, "cspace."):
    if each.name.startswith(("cspace.arms.", "cspace._bodies.", "cspace._exact.")):
        module = import_module(each.name)
        if hasattr(module, "call"):
            module.call = lambda function, arguments: function(*arguments)
        if hasattr(module, "find_address"):
            module.find_address = lambda function, *_: function

limits.free_bytes = lambda: 2.0**40  # it is read at times

BYTES_PER_NUMBER = 8


class Reductions:
    """A ufunc that counts the numbers that ``reduceat`` reads."""

    read = 0

    def __init__(self, ufunc):
        self._ufunc = ufunc

    def __call__(self, *arguments, **options):
        return self._ufunc(*arguments, **options)

    def __getattr__(self, name):
        return getattr(self._ufunc, name)

    def reduceat(self, array, indices, axis=0, **options):
        """Reduce slices; one that does not ascend is a single row."""
        length = np.shape(array)[axis]
        stops = np.append(indices[1:], length)
        rows = np.maximum(stops - indices, 1).sum()
        Reductions.read += int(rows) * np.size(array) // max(length, 1)
        return self._ufunc.reduceat(array, indices, axis=axis, **options)


class Counter:
    """Counts of the work of one call."""

    def __init__(self):
        self.lines = 0
        self.bytes = 0
        self._now = 0

    def count(self, job):
        """Return the work of a call."""
        gc.collect()
        Reductions.read = 0
        tracemalloc.start()
        self._now, _ = tracemalloc.get_traced_memory()
        sys.settrace(self._trace)
        try:
            job()
        finally:
            sys.settrace(None)
            tracemalloc.stop()
        return self.lines + self.bytes // BYTES_PER_NUMBER + Reductions.read

    def _trace(self, *_):
        """Count a line, and the memory that was allocated since the last one."""
        self.lines += 1
        now, peak = tracemalloc.get_traced_memory()
        self.bytes += max(peak - self._now, 0)
        self._now = now
        tracemalloc.reset_peak()
        return self._trace


# Inputs


def make_floor(n):
    """Make a square of n cells with walls that have doors."""
    side = math.isqrt(n)
    occupied = np.zeros((side, side), dtype=np.bool_)
    occupied[:: max(side // 4, 8)] = True
    occupied[:, 2 : side : side // 2] = False
    occupied[:, 3 : side : side // 2] = False
    occupied[:, 4 : side : side // 2] = False
    return Workspace.from_array(occupied, 0.1)


def list_squares(n):
    """Return n squares of 0.3 m in rows, 1 m apart."""
    places = itertools.islice(np.ndindex(math.isqrt(n) + 1, math.isqrt(n) + 1), n)
    return [shapely.box(x, y, x + 0.3, y + 0.3) for x, y in places]


def make_sphere(n):
    """Make a ball of about n triangles with small bumps, so that its hull has many corners."""
    ball = trimesh.creation.uv_sphere(count=[math.isqrt(n // 2)] * 2)
    radii = 1.0 + 0.002 * np.sin(7.0 * ball.vertices).sum(axis=1)
    return trimesh.Trimesh(radii[:, np.newaxis] * ball.vertices, ball.faces)


def list_boxes(n):
    """Make a mesh of n boxes apart from each other."""
    side = math.ceil(n ** (1 / 3))
    places = itertools.islice(np.ndindex(side, side, side), n)
    boxes = [
        trimesh.creation.box((0.5, 0.4, 0.3), trimesh.transformations.translation_matrix(place))
        for place in places
    ]
    return trimesh.util.concatenate(boxes)


# Kinds


def build_disc(n, folder):
    floor = make_floor(n)
    return lambda: cspace.build(floor, Robot.disc(0.15))


def build_yaws(n, folder):
    floor = make_floor(n)
    return lambda: cspace.build(floor, Robot.rectangle(0.3, 0.2, (0.05, 0.0)), rotations=6)


def build_ball(n, folder):
    side = round(n ** (1 / 3))
    occupied = np.zeros((side, side, side), dtype=np.bool_)
    occupied[::6, : side // 2] = True
    return lambda: cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(0.15))


def build_polygons(n, folder):
    squares = list_squares(n)
    return lambda: cspace.build(
        Workspace.from_polygons(squares, spacing=0.25), Robot.disc(0.1), rotations=None
    )


def build_holes(n, folder):
    holes = [square.exterior.coords for square in list_squares(n)]
    side = math.isqrt(n) + 2.0
    plate = shapely.Polygon(shapely.box(-1, -1, side, side).exterior.coords, holes)
    return lambda: cspace.build(Workspace.from_polygons([plate], spacing=0.25), Robot.disc(0.05))


def build_mesh(n, folder):
    mesh = make_sphere(n)
    spacing = 6.0 / math.sqrt(n)
    return lambda: cspace.build(Workspace.from_mesh(mesh, spacing=spacing), Robot.ball(0.01))


def build_balls(n, folder):
    side = math.ceil(n ** (1 / 3))
    centers = np.array(list(itertools.islice(np.ndindex(side, side, side), n)), dtype=float)
    radii = np.full(n, 0.4)
    workspace = Workspace.from_array(np.zeros((side + 4,) * 3, dtype=np.bool_), 1.0)
    return lambda: cspace.build(workspace, Robot.from_balls(centers, radii))


def add_obstacles(n, folder):
    space = build_empty((80, 80), Robot.disc(0.05), outside="blocked", spacing=0.25)
    squares = list_squares(n)

    def job():
        for number, square in enumerate(squares):
            space.add_obstacle(f"crate {number}", square)

    return job


def label_components(n, folder):
    space = cspace.build(make_floor(n), Robot.rectangle(0.1, 0.05), rotations=4)
    q = space.sample_free(2, np.random.default_rng(0))
    return lambda: space.is_connected(*q)


def measure_clearance(n, folder):
    space = cspace.build(make_floor(n), Robot.disc(0.06))
    q = space.sample_free(2, np.random.default_rng(0))
    return lambda: space.clearance(q)


def plan_through_floor(n, folder):
    space = cspace.build(make_floor(n), Robot.disc(0.06))
    side = 0.1 * math.isqrt(n)
    q = [space.nearest_free(corner) for corner in ((0.15, 0.15), (side - 0.15, side - 0.15))]
    return lambda: planners.plan(space, *q, time_limit=1e6)


def ask_again(prepare):
    """Make the job of a second question, for which the first has prepared the map."""

    def prepare_again(n, folder):
        job = prepare(n, folder)
        job()
        return job

    return prepare_again


def make_hall(n):
    """Make an empty square of n cells between walls."""
    side = math.isqrt(n)
    occupied = np.pad(np.zeros((side - 2, side - 2), dtype=np.bool_), 1, constant_values=True)
    return Workspace.from_array(occupied, 0.1)


def measure_clearance_far_from_walls(n, folder):
    space = cspace.build(make_hall(n), Robot.disc(0.06))
    middle = 0.05 * math.isqrt(n)
    return lambda: space.clearance((middle, middle))


def grow_region_far_from_walls(n, folder):
    space = cspace.build(make_hall(n), Robot.disc(0.06))
    middle = 0.05 * math.isqrt(n)
    return lambda: space.free_region((middle, middle), reach=middle)


def plan_far_from_walls(n, folder):
    space = cspace.build(make_hall(n), Robot.disc(0.06))
    side = 0.1 * math.isqrt(n)
    ends = (0.3 * side, 0.5 * side), (0.7 * side, 0.5 * side)
    return lambda: planners.plan(space, *ends, time_limit=1e6)


def build_on_floor(n, folder):
    """A hall of n cells in space, eight of them high."""
    side = math.isqrt(n // 8)
    occupied = np.zeros((side, side, 8), dtype=np.bool_)
    occupied[::6, : side // 2, 2:5] = True
    robot = Robot.box((0.2, 0.1, 0.5), (0.0, 0.0, 0.3))
    scene = Workspace.from_array(occupied, 0.1)
    return lambda: cspace.build(scene, robot, rotations=4, floor=0.0)


def measure_clearance_on_floor(n, folder):
    space = build_on_floor(n, folder)()
    q = space.sample_free(2, np.random.default_rng(0))
    return lambda: space.clearance(q)


def plan_to_places(n, folder):
    """Goals of which any may be reached."""
    side = 4 * math.isqrt(n)
    space = cspace.build(make_hall(side**2), Robot.disc(0.06))
    places = space.sample_free(n, np.random.default_rng(0))
    start = space.nearest_free((0.2, 0.2))
    return lambda: planners.plan(space, start, list(places), time_limit=1e6)


def build_in_tiles(n, folder):
    """Tiles of 256 cells."""
    floor, robot = make_floor(n), Robot.disc(0.06)
    store = tempfile.mkdtemp(dir=folder)
    return lambda: cspace.build(floor, robot, store=store, tile=16)


def classify_in_tiles(n, folder):
    tiled = build_in_tiles(n, folder)()
    side = 0.1 * math.isqrt(n)
    q = np.random.default_rng(0).uniform(0.0, side, (n // 4, 2))
    return lambda: tiled.classify(q)


def label_tiles(n, folder):
    tiled = build_in_tiles(n, folder)()
    side = 0.1 * math.isqrt(n)
    q = [tiled.nearest_free(corner) for corner in ((0.15, 0.15), (side - 0.15, side - 0.15))]
    return lambda: tiled.is_connected(*q)


def measure_mesh_distance(n, folder):
    workspace = Workspace.from_mesh(make_sphere(n), 0.2, (-2, -2, -2, 2, 2, 2))
    space = cspace.build(workspace, Robot.ball(0.1))
    q = space.sample_free(20, np.random.default_rng(0))
    return lambda: space.obstacle_distance(q)


def make_long_plan(n):
    """Make a plan of about n waypoints around teeth."""
    occupied = np.zeros((4 * n, 12), dtype=np.bool_)
    occupied[3::8, :8] = True
    occupied[7::8, 4:] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.disc(0.05))
    goal = space.nearest_free((0.4 * n - 0.15, 0.65))
    return planners.plan(space, (0.15, 0.15), goal, time_limit=1e6)


def recheck_plan(n, folder):
    return make_long_plan(n).recheck


def time_plan(n, folder):
    plan = make_long_plan(n)
    return lambda: plan.trajectory(max_velocity=1.0, max_acceleration=1.0, blend=False)


def print_plan_among_voxels(n, folder):
    """A hall of about n voxels."""
    occupied = np.random.default_rng(0).random((2 * n, 6, 6)) < 1 / 72
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(0.01))
    ends = (0.0, 0.3, 0.3), (0.2 * n, 0.3, 0.3)
    plan = planners.plan(space, *map(space.nearest_free, ends), time_limit=1e6)
    return lambda: str(plan)


def explain_among_voxels(n, folder):
    """A hall of n voxels in rows."""
    occupied = np.zeros((n + 3, 9, 9), dtype=np.bool_)
    occupied[3::4, 2::4, 2::4] = True
    space = cspace.build(Workspace.from_array(occupied, 0.1), Robot.ball(0.01))
    ends = (0.0, 0.5, 0.5), (0.1 * n, 0.5, 0.5)
    return lambda: space.explain(*map(space.nearest_free, ends))


def explain_obstacles(n, folder):
    squares = list_squares(n)
    side = math.isqrt(n) + 1.0
    wall = shapely.box(-0.6, -0.35, side, -0.1)
    workspace = Workspace.from_polygons(
        [wall, *squares], spacing=0.1, bounds=(-0.6, -1.0, side, side)
    )
    space = cspace.build(workspace, Robot.disc(0.05), outside="blocked")
    return lambda: space.explain((0.0, -0.7), (0.5, 0.5))


def export_map(n, folder):
    space = cspace.build(make_floor(n), Robot.disc(0.06))
    return space.to_costmap


def find_conflicts(n, folder):
    """Lanes side by side, of which each meets its neighbours."""
    space = build_empty((30, 30), Robot.rectangle(0.6, 0.4))
    y = 0.35 * np.repeat(np.arange(n), 2)
    nodes = np.column_stack([np.tile([0.0, 2.0], n), y])
    edges = np.arange(2 * n).reshape(n, 2)
    graph = RouteGraph.from_arrays(nodes, edges, 0.0)
    return lambda: cspace.lanes.conflicts(space, graph)


# Readers


def read_image(n, folder):
    path = folder / f"{n}.png"
    side = math.isqrt(n)
    pixels = np.random.default_rng(0).random((side, side)) < 0.5
    Image.fromarray(np.where(pixels, 255, 0).astype(np.uint8)).save(path)
    return lambda: Workspace.open(path, spacing=0.1)


def read_polygons(n, folder):
    path = folder / f"{n}.geojson"
    path.write_text(shapely.to_geojson(shapely.MultiPolygon(list_squares(n))))
    return lambda: Workspace.open(path, spacing=0.25)


def read_points(n, folder):
    path = folder / f"{n}.xyz"
    side = math.ceil(n ** (1 / 3))
    np.savetxt(path, list(itertools.islice(np.ndindex(side, side, side), n)))
    return lambda: Workspace.open(path, spacing=0.5, radius=0.1)


def read_mesh(kind):
    def prepare(n, folder):
        path = folder / f"{n}{kind}"
        list_boxes(n).export(path)
        return lambda: Workspace.open(path, spacing=1.0)

    return prepare


def read_bodies(n, folder):
    """Many objects in one scene."""
    path = folder / f"{n}.glb"
    scene = trimesh.Scene()
    for number in range(n):
        scene.add_geometry(
            trimesh.creation.box((0.5, 0.4, 0.3)),
            transform=trimesh.transformations.translation_matrix(
                (number % 8, number // 8 % 8, number // 64)
            ),
        )
    scene.export(path)
    return lambda: Workspace.open(path, spacing=1.0)


def read_octomap(n, folder):
    path = folder / f"{n}.bt"
    data = bytearray()

    def write(level, count):
        """Write a node above ``count`` occupied leaves; each child takes two bits."""
        if level == 1:
            bits = sum(0b10 << 2 * child for child in range(min(count, 8)))
            data.extend(bits.to_bytes(2, "little"))
            return
        below = 8 ** (level - 1)
        parts = [min(max(count - below * child, 0), below) for child in range(8)]
        bits = sum(0b11 << 2 * child for child, part in enumerate(parts) if part)
        data.extend(bits.to_bytes(2, "little"))
        for part in parts:
            if part:
                write(level - 1, part)

    write(16, n)
    nodes = len(data) // 2 + n
    header = f"# Octomap OcTree binary file\nid OcTree\nsize {nodes}\nres 0.1\ndata\n"
    path.write_bytes(header.encode() + bytes(data))
    return lambda: Workspace.open(path)


def read_scene(n, folder):
    path = folder / f"{n}.yaml"
    boxes = [
        f"  - {{id: box{k}, header: {{frame_id: world}}, operation: 0,"
        f" primitives: [{{type: 1, dimensions: [0.5, 0.4, 0.3]}}],"
        f" primitive_poses: [{{position: {{x: {k % 8}, y: {k // 8 % 8}, z: {k // 64}}},"
        " orientation: {x: 0, y: 0, z: 0, w: 1}}]}"
        for k in range(n)
    ]
    path.write_text("world:\n  collision_objects:\n" + "\n".join(boxes))
    return lambda: Workspace.from_moveit_scene(path, spacing=1.0)


def read_repeated_key(n, folder):
    path = folder / f"{n}.json"
    keys = [*range(n), n - 1]
    path.write_text("{" + ", ".join(f'"k{k}": 0' for k in keys) + "}")

    def read():
        with suppress(FileError):
            Workspace.open(path, spacing=0.1)

    return read


# Arms

BALL = "<collision><geometry><sphere radius='0.1'/></geometry></collision>"


def write_chain(path, n, kind="fixed", extra=""):
    """Write a chain of n links without shapes, all fixed or alike, and a turning ball at its end."""
    links = [f"<link name='link{k}'/>" for k in range(n)] + [f"<link name='link{n}'>{BALL}</link>"]
    limit = "<axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='1' velocity='1'/>"
    joints = [
        f"<joint name='joint{k}' type='{kind if k < n - 1 else 'revolute'}'>{extra * (k < n - 1)}"
        f"<parent link='link{k}'/><child link='link{k + 1}'/>{limit}</joint>"
        for k in range(n)
    ]
    path.write_text(f"<robot name='chain'>{''.join(links + joints)}</robot>")


def read_fixed_chain(n, folder):
    path = folder / f"{n}.urdf"
    write_chain(path, n)
    return lambda: cspace.Arm.from_urdf(path)


def read_mimicking_chain(n, folder):
    path = folder / f"{n}.urdf"
    write_chain(path, n, "continuous", f"<mimic joint='joint{n - 1}' multiplier='0'/>")
    return lambda: cspace.Arm.from_urdf(path)


def read_allowed_pairs(n, folder):
    """Pairs of links without shapes."""
    urdf, srdf = folder / f"{n}.urdf", folder / f"{n}.srdf"
    write_chain(urdf, math.isqrt(2 * n) + 2)
    pairs = itertools.islice(itertools.combinations(range(math.isqrt(2 * n) + 2), 2), n)
    rows = (f"<disable_collisions link1='link{a}' link2='link{b}' reason='x'/>" for a, b in pairs)
    srdf.write_text(f"<robot name='chain'>{''.join(rows)}</robot>")
    return lambda: cspace.Arm.from_urdf(urdf, srdf)


def set_up_meshes(n, folder):
    """An arm whose hand is a mesh of n triangles."""
    mesh, urdf = folder / f"{n}.stl", folder / f"{n}.urdf"
    make_sphere(n).export(mesh)
    hand = f"<collision><geometry><mesh filename='{mesh}'/></geometry></collision>"
    limit = "<axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='1' velocity='1'/>"
    urdf.write_text(
        f"<robot name='arm'><link name='foot'/><link name='hand'>{hand}</link><joint name='turn' "
        f"type='revolute'><parent link='foot'/><child link='hand'/>{limit}</joint></robot>"
    )
    pose = np.eye(4)
    pose[:3, 3] = 3.0
    post = {"post": PosedShape(Robot.box((0.1, 0.1, 0.1)).shape, pose)}
    return lambda: cspace.build_arm_space(post, cspace.Arm.from_urdf(urdf)).closest([0.0])


def place_boxes(n, folder):
    """An arm among n boxes."""
    path = folder / f"{n}.urdf"
    write_chain(path, 2)
    arm = cspace.Arm.from_urdf(path)
    boxes = {}
    for k in range(n):
        pose = trimesh.transformations.euler_matrix(0.1, 0.2, 0.3)
        pose[:3, 3] = 1 + k % 8, k // 8 % 8, k // 64
        boxes[f"box {k}"] = PosedShape(Robot.box((0.5, 0.4, 0.3)).shape, pose)
    return lambda: cspace.build_arm_space(boxes, arm).closest([0.0])


KINDS = {
    "build a map of n cells": (32**2, build_disc),
    "build a map of n cells and yaws": (24**2, build_yaws),
    "build a map of n cells in space": (12**3, build_ball),
    "build a map of n polygons": (16, build_polygons),
    "build a map of n holes": (16, build_holes),
    "build a map of n triangles": (100, build_mesh),
    "build a map for n balls": (30, build_balls),
    "add n obstacles": (16, add_obstacles),
    "label the components of n cells": (24**2, label_components),
    "measure a clearance among n cells": (16**2, measure_clearance),
    "plan among n cells": (40**2, plan_through_floor),
    "measure the distance to n triangles": (100, measure_mesh_distance),
    "label the components of n cells, again": (24**2, ask_again(label_components)),
    "measure a clearance among n cells, again": (16**2, ask_again(measure_clearance)),
    "plan among n cells, again": (40**2, ask_again(plan_through_floor)),
    "measure the distance to n triangles, again": (100, ask_again(measure_mesh_distance)),
    "explain among n voxels, again": (8, ask_again(explain_among_voxels)),
    "measure a clearance in a hall of n cells": (16**2, measure_clearance_far_from_walls),
    "measure a clearance in a hall of n cells, again": (
        16**2,
        ask_again(measure_clearance_far_from_walls),
    ),
    "grow a region in a hall of n cells": (16**2, grow_region_far_from_walls),
    "plan in a hall of n cells": (24**2, plan_far_from_walls),
    "build a map of n cells over a floor": (8 * 16**2, build_on_floor),
    "measure a clearance on a floor, again": (8 * 16**2, ask_again(measure_clearance_on_floor)),
    "plan to n places": (16, plan_to_places),
    "plan to n places, again": (16, ask_again(plan_to_places)),
    "build n cells in tiles": (32**2, build_in_tiles),
    "classify n configurations in tiles": (32**2, classify_in_tiles),
    "classify n configurations in tiles, again": (32**2, ask_again(classify_in_tiles)),
    "label the components of n cells in tiles": (32**2, label_tiles),
    "label the components of n cells in tiles, again": (32**2, ask_again(label_tiles)),
    "check a plan of n waypoints": (8, recheck_plan),
    "time a plan of n waypoints": (16, time_plan),
    "find conflicts of n lanes": (16, find_conflicts),
    "print a plan among n voxels": (4, print_plan_among_voxels),
    "explain among n voxels": (8, explain_among_voxels),
    "explain among n obstacles": (8, explain_obstacles),
    "export n cells": (16**2, export_map),
    "read an image of n pixels": (300**2, read_image),
    "read n keys, of which the last stands twice": (64, read_repeated_key),
    "read n polygons": (16, read_polygons),
    "read n points": (256, read_points),
    "read an STL file of n boxes": (8, read_mesh(".stl")),
    "read an OBJ file of n boxes": (8, read_mesh(".obj")),
    "read a PLY file of n boxes": (8, read_mesh(".ply")),
    "read a scene of n bodies": (16, read_bodies),
    "read an OctoMap of n voxels": (8192, read_octomap),
    "read a MoveIt scene of n objects": (16, read_scene),
    "read a chain of n links": (64, read_fixed_chain),
    "read a chain of n mimicking links": (64, read_mimicking_chain),
    "read n allowed pairs": (64, read_allowed_pairs),
    "set up an arm of n triangles": (800, set_up_meshes),
    "set up an arm among n boxes": (8, place_boxes),
}
"""Smallest n, and the job of each n, by kind."""


def count_work(kind):
    """Return the work on inputs of n, 4 n and 16 n."""
    for name in ("add", "maximum", "minimum", "logical_or", "bitwise_or"):
        setattr(np, name, Reductions(getattr(np, name)))
    warnings.simplefilter("ignore")  # small maps are coarse
    n, prepare = KINDS[kind]
    with tempfile.TemporaryDirectory() as name:
        for size in (n, 4 * n):
            prepare(size, Path(name))()  # imports
        return [Counter().count(prepare(size, Path(name))) for size in (n, 4 * n, 16 * n)]


if __name__ == "__main__":
    print(json.dumps(count_work(sys.argv[1])))

"""Planning scenes of MoveIt and MotionBenchMaker."""

import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Arm, FileError, Robot, Workspace, build, build_arm_space
from cspace.arms import PosedShape, read_moveit_scene
from cspace.errors import GeometryError, InputError
from tests.refusals import refusals

NAMES = ("box", "sphere", "cylinder", "cone")
BOUNDS = (-2.0, -2.0, -2.0, 2.0, 2.0, 2.0)


def write_scene(folder: Path, *objects: dict[str, Any], **more: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"name": "test", "world": {"collision_objects": list(objects)}, **more}))
    return path


def make_pose(position: Any = (0, 0, 0), orientation: Any = (0, 0, 0, 1)) -> dict[str, list[float]]:
    return {"position": [float(x) for x in position], "orientation": [float(x) for x in orientation]}


def make_primitive(kind: Any, dimensions: Any, at: Any = None, name: str = "thing", **more: Any) -> dict[str, Any]:
    one = {"type": kind, "dimensions": list(dimensions)}
    return {"id": name, "primitives": [one], "primitive_poses": [at or make_pose()], **more}


def contains(kind: str, sizes: Any, points: Any, slack: float) -> Any:
    """Return True for points in a grown primitive."""
    x, y, z = points.T
    if kind == "box":
        return (np.abs(points) <= np.array(sizes) / 2 + slack).all(axis=1)
    if kind == "sphere":
        return np.linalg.norm(points, axis=1) <= sizes[0] + slack
    height, radius = sizes
    around = np.hypot(x, y)
    if kind == "cylinder":
        return (np.abs(z) <= height / 2 + slack) & (around <= radius + slack)
    share = np.clip(0.5 - z / height, 0.0, 1.0)  # the tip is up
    return (np.abs(z) <= height / 2 + slack) & (around <= radius * share + slack)


COORDINATES = st.floats(-1.0, 1.0)
SIZES = st.floats(0.2, 0.9)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(
    kind=st.sampled_from(NAMES),
    sizes=st.tuples(SIZES, SIZES, SIZES),
    places=st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=2, max_size=2),
    angles=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)),
    layout=st.integers(0, 2),
    seed=st.integers(0, 2**20),
)
def test_primitives_are_bounded_by_the_cells(tmp_path, kind, sizes, places, angles, layout, seed):
    """Pose both the primitive and its object anywhere."""
    count = {"box": 3, "sphere": 1}.get(kind, 2)
    turns = Rotation.from_euler("xyz", angles), Rotation.from_euler("z", angles[0])
    poses = [make_pose(position, turn.as_quat()) for position, turn in zip(places, turns, strict=True)]
    dimensions, kind_written = list(sizes[:count]), kind
    if layout == 1:  # the text that ROS prints
        kind_written, dimensions = 1 + NAMES.index(kind), dimensions + [0.0] * (3 - count)
        poses = [{name: dict(zip("xyzw", numbers, strict=False)) for name, numbers in each.items()} for each in poses]
    elif layout == 2:
        kind_written = kind.upper()
    path = write_scene(
        tmp_path, make_primitive(kind_written, dimensions, poses[1], pose=poses[0], operation="\0" * (layout == 1))
    )
    workspace = Workspace.from_moveit_scene(path, 0.11, (-3, -3, -3, 3, 3, 3))
    rng = np.random.default_rng(seed)
    local = rng.uniform(-0.7, 0.7, (4000, 3))
    points = turns[0].apply(turns[1].apply(local[contains(kind, sizes[:count], local, -1e-9)]) + places[1]) + places[0]
    cells = np.floor((points - np.array(workspace.grid.lower)) / 0.11).astype(int)
    assert len(points) > 0 and workspace.outer[tuple(cells.T)].all()
    inner = np.argwhere(workspace.inner)
    corners = (inner[:, None] + rng.random((1, 20, 3))).reshape(-1, 3) * 0.11 + workspace.grid.lower
    back = turns[1].inv().apply(turns[0].inv().apply(corners - places[0]) - places[1])
    assert contains(kind, sizes[:count], back, 1e-9).all()
    arm_side = read_moveit_scene(path).obstacles["thing"]
    center = arm_side.pose[:3, 3]
    np.testing.assert_allclose(center, turns[0].apply(places[1]) + places[0], atol=1e-12)


@pytest.fixture(scope="module")
def panda(data: Path) -> Arm:
    pytest.importorskip("yourdfpy")
    with warnings.catch_warnings(action="ignore"):  # a link's mesh is open
        return Arm.from_urdf(data / "arms" / "panda" / "panda.urdf", data / "arms" / "panda" / "panda.srdf")


@pytest.mark.filterwarnings("ignore:.*without collision geometry")
@pytest.mark.parametrize("robot", ["panda", "ur5"])
def test_motion_bench_maker_scenes_agree_with_planning_scenes(tmp_path, robot, data, panda):
    """Compare scenes of a benchmark with shapes made directly. One arm is enough; the bodies of a ur5 take long."""
    arm, rng = panda, np.random.default_rng(0)
    problems = json.loads((data / "arms" / robot / "problems.json").read_text())["problems"]
    for each in [problem for of_kind in problems.values() for problem in of_kind[:1]]:
        objects, expected = [], {}
        for kind, sizes in (("box", None), ("cylinder", ("length", "radius")), ("sphere", ("radius",))):
            for number, item in enumerate(each[kind]):
                name, turn = f"{kind}{number}", item.get("orientation_quat_xyzw", [0, 0, 0, 1])
                numbers = [2 * x for x in item["half_extents"]] if sizes is None else [item[key] for key in sizes]
                header = {"header": {"frame_id": arm.frames[0]}}
                objects.append(make_primitive(kind, numbers, make_pose(item["position"], turn), name, **header))
                matrix = np.eye(4)
                matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(turn).as_matrix(), item["position"]
                make = {
                    "box": lambda *n: Robot.box(n),
                    "sphere": Robot.ball,
                    "cylinder": lambda h, r: Robot.cylinder(r, h),
                }
                expected[name] = PosedShape(make[kind](*numbers).shape, matrix)
        read = read_moveit_scene(write_scene(tmp_path, *objects))
        assert read.obstacles.keys() == expected.keys()
        spaces = build_arm_space(read, arm), build_arm_space(expected, arm)
        points = rng.uniform(*arm._ranges(), (300, arm.dof))
        points[0, : len(each["start"])] = each["start"]
        points[0] = arm._clamp(points[0])
        states = [np.asarray(space.classify(points)) for space in spaces]
        assert (states[0] == states[1]).all() and len(set(states[0].tolist())) > 1


def test_scenes_become_maps_and_arms(tmp_path):
    path = write_scene(
        tmp_path,
        make_primitive("box", (1, 1, 1), name="a"),
        make_primitive("sphere", (0.3,), make_pose((1.2, 0, 0)), "b"),
    )
    workspace = Workspace.from_moveit_scene(path, 0.05, BOUNDS)
    assert len(workspace.shapes) == 2 and repr(workspace).startswith(f"Workspace({path}: 80 x 80 x 80 cells")
    space = build(workspace, Robot.ball(0.1))
    assert space.is_free((0.0, 1.0, 0.0)) and not space.is_free((0.55, 0, 0))
    assert not space.is_free((0.85, 0.0, 0.0), exact=True) and space.is_free((0.75, 0.0, 0.0), exact=True)
    plain = Workspace.from_moveit_scene(path, 0.05)
    assert plain.grid.lower == (-0.5, -0.5, -0.5) and plain.grid.upper[0] == pytest.approx(1.5)


def test_operations_add_append_and_remove_shapes(tmp_path):
    table = {
        "id": "table",
        "primitives": [{"type": "box", "dimensions": [1, 1, 0.1]}, {"type": 3, "dimensions": [0.7, 0.05]}],
        "primitive_poses": [make_pose((0, 0, 0.7)), make_pose((0, 0, 0.35))],
    }
    old, gone = make_primitive("box", (1, 1, 1), name="cup"), make_primitive("sphere", (1,), name="gone")
    more = make_primitive("sphere", (0.1,), make_pose((0, 0, 2)), "cap", operation="append")
    new = make_primitive("sphere", (0.2,), name="cup")
    scene = write_scene(tmp_path, table, old, gone, new, more, {"id": "gone", "operation": 1})
    read = read_moveit_scene(scene).obstacles
    assert list(read) == ["table/0", "table/1", "cup", "cap"]
    assert read["cup"].shape.outer.bounds[1][0] == 0.2 and read["cap"].pose[2, 3] == 2.0


@refusals(
    "ids, expected",
    (["a", "a/0"], "has the shape 'a/0' of object 'a' and of object 'a/0'; names of shapes must differ; rename one"),
    (["a/1", "a"], "has the shape 'a/1' of object 'a/1' and of object 'a'"),
    (["a", "a/0", "a/0/1"], "has the shape 'a/0' of object 'a' and of object 'a/0'"),
    ([5, "5"], "has the id '5' again at collision_objects.1., once as a number; ids are text; put them in quotes"),
    ([5, 5], "has the id '5' again"),
    ([True, "a"], r"has 'True' as id of collision_objects\[0\]; it must be a name"),
    ([1.5, "a"], r"has '1.5' as id of collision_objects\[0\]"),
    (["a", None], r"has None as id of collision_objects\[1\]; it must be a name; add it"),
    (["object 1", ""], r"has '' as id of collision_objects\[1\]"),
)
def test_names_that_hide_an_obstacle_are_refused(tmp_path, ids, expected):
    """Give the objects without a slash two shapes."""
    objects = [make_primitive("box", (1, 1, 1), make_pose((3 * n, 0, 0)), name) for n, name in enumerate(ids)]
    for each in objects:
        if "/" not in str(each["id"]):
            each["primitives"], each["primitive_poses"] = each["primitives"] * 2, each["primitive_poses"] * 2
    path = write_scene(tmp_path, *objects)
    for read in (read_moveit_scene, lambda path: Workspace.from_moveit_scene(path, 0.1, BOUNDS)):
        with pytest.raises(FileError, match=expected) as caught:
            read(path)
        assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_later_objects_of_an_id_replace_earlier_ones_with_all_their_shapes(tmp_path):
    """MoveIt's ``processCollisionObjectAdd`` removes the old object first."""
    two = make_primitive("box", (1, 1, 1), name="a")
    two["primitives"], two["primitive_poses"] = two["primitives"] * 2, two["primitive_poses"] * 2
    one, part = make_primitive("box", (1, 1, 2), name="a"), make_primitive("box", (1, 1, 3), name="a/0")
    read = read_moveit_scene(write_scene(tmp_path, two, one, part)).obstacles
    assert {name: each.shape.outer.bounds[1][2] for name, each in read.items()} == {"a": 1.0, "a/0": 1.5}


def test_numbers_without_quotes_are_ids(tmp_path):
    """robowflex writes the id "7" without quotes."""
    assert list(read_moveit_scene(write_scene(tmp_path, make_primitive("box", (1, 1, 1), name=7))).obstacles) == ["7"]


def test_meshes_are_read_from_the_scene_and_from_files(tmp_path):
    cube = trimesh.creation.box((1, 2, 3))
    (tmp_path / "cubes" / "meshes").mkdir(parents=True)
    cube.export(tmp_path / "cubes" / "meshes" / "cube.stl")
    corners = [dict(zip("xyz", row, strict=True)) for row in cube.vertices.tolist()]
    inline = {"vertices": corners, "triangles": [{"vertex_indices": row} for row in cube.faces.tolist()]}
    plain = {"vertices": cube.vertices.tolist(), "triangles": cube.faces.tolist()}
    scaled = {"resource": "package://cubes/meshes/cube.stl", "dimensions": [0.5, 0.5, 0.5]}
    near = {"resource": "cubes/meshes/cube.stl"}
    turn = make_pose((5, 0, 0), Rotation.from_euler("z", 90, degrees=True).as_quat())
    for number, (mesh, factor) in enumerate(((inline, 1.0), (plain, 1.0), (scaled, 0.5), (near, 1.0))):
        path = write_scene(tmp_path, {"id": f"m{number}", "meshes": [mesh], "mesh_poses": [turn]})
        workspace = Workspace.from_moveit_scene(path, 0.1)
        expected = np.array([[-1, -0.5, -1.5], [1, 0.5, 1.5]]) * factor + [5, 0, 0]
        np.testing.assert_allclose(workspace.shapes[0].bounds, expected, atol=1e-7)
        assert workspace.inner.any()


@pytest.mark.parametrize(("place", "coef"), [(make_pose(), [0, 0, 2, 1.0]), (make_pose((0, 0, -0.5)), [0, 0, -1, 0])])
def test_planes_reach_as_far_as_the_bounds(tmp_path, place, coef):
    """Use the plane z = -0.5, in maps and for arms."""
    path = write_scene(tmp_path, {"id": "ground", "planes": [{"coef": coef}], "plane_poses": [place]})
    workspace = Workspace.from_moveit_scene(path, 0.2, (-2, -2, -1.5, 3, 2, 1))
    layers = np.flatnonzero(workspace.outer.any(axis=(0, 1)))
    assert workspace.outer[:, :, layers].all() and layers.tolist() in ([4, 5], [4], [5]) and not workspace.inner.any()
    ground = read_moveit_scene(path, plane_radius=7.0).obstacles["ground"]
    lower, upper = ground.shape.outer.bounds
    assert lower[2] == pytest.approx(-0.5) == upper[2] and (upper - lower)[:2].min() >= 14.0 - 1e-9
    with pytest.raises(FileError, match=r"a plane has no end.*pass bounds for a workspace, or plane_radius"):
        Workspace.from_moveit_scene(path, 0.2)


def write_transform(frame: str, child: str, position: Any, orientation: Any = (0, 0, 0, 1)) -> dict[str, Any]:
    """Write a transform that maps points of ``frame`` to ``child``, as MoveIt's ``Transforms::copyTransforms`` does."""
    motion = {"translation": list(map(float, position)), "rotation": list(map(float, orientation))}
    return {"header": {"frame_id": frame}, "child_frame_id": child, "transform": motion}


def test_transforms_lead_from_the_frame_of_their_header_to_their_child(tmp_path):
    """Use the numbers of robowflex's fetch_scenes/scene_vicon0002.yaml, in which both give the place of a can."""
    at, turn = (0.5265398368491891, 0.4824386423589078, 0.9894246997403088), (0.0077, 0.0012, 0.5116, 0.8592)
    can = make_primitive("cylinder", (0.12, 0.03), name="can", header={"frame_id": "vicon/Can1/Can1"})
    base = make_primitive("sphere", (0.1,), name="base", header={"frame_id": "base_link"})
    links = [
        write_transform("base_link", "base_link", (0, 0, 0)),
        write_transform("vicon/Can1/Can1", "base_link", at, turn),
    ]
    scene = read_moveit_scene(write_scene(tmp_path, can, base, fixed_frame_transforms=links))
    assert scene.frame == "base_link"
    np.testing.assert_allclose(scene.obstacles["can"].pose[:3, 3], (0.526539867, 0.482431894, 0.989428485), atol=1e-5)
    np.testing.assert_allclose(scene.obstacles["can"].pose[:3, :3], Rotation.from_quat(turn).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(scene.obstacles["base"].pose, np.eye(4))


def test_frames_are_joined_by_their_transforms(tmp_path):
    one, other = ({"header": {"frame_id": name}} for name in ("world", "/table"))
    objects = (
        make_primitive("sphere", (0.1,), name="a", **one),
        make_primitive("sphere", (0.1,), make_pose((1, 0, 0)), "b", **other),
    )
    turn = Rotation.from_euler("z", 90, degrees=True).as_quat().tolist()
    chain = [write_transform("table", "room", (0, 0, 3), turn), write_transform("room", "world", (0, 2, 0))]
    scene = read_moveit_scene(write_scene(tmp_path, *objects, fixed_frame_transforms=chain))
    np.testing.assert_allclose(scene.obstacles["b"].pose[:3, 3], (0, 3, 3), atol=1e-12)
    with pytest.raises(FileError, match=r"has objects in the frames 'table', 'world'; fixed_frame_transforms must"):
        read_moveit_scene(write_scene(tmp_path, *objects))
    alone = read_moveit_scene(write_scene(tmp_path, objects[1], fixed_frame_transforms=chain))
    assert alone.frame == "world"
    np.testing.assert_allclose(alone.obstacles["b"].pose[:3, 3], (0, 3, 3), atol=1e-12)
    assert read_moveit_scene(write_scene(tmp_path, objects[1])).frame == "table"
    loop = [write_transform("table", "room", (0, 0, 3)), write_transform("room", "table", (0, 2, 0))]
    with pytest.raises(FileError, match="has transforms of 'table' in a loop"):
        read_moveit_scene(write_scene(tmp_path, objects[1], fixed_frame_transforms=loop))
    two = [write_transform("table", "room", (0, 0, height)) for height in (2, 3)]
    with pytest.raises(FileError, match="has two transforms of the frame 'table'"):
        read_moveit_scene(write_scene(tmp_path, objects[1], fixed_frame_transforms=two))
    for transform, message in (
        (write_transform("world", "world", (0, 0, 1)), "moves the frame 'world' against itself"),
        (write_transform("table", "world", (0, 0, 1), (0, 0, 0, 2)), "as rotation of fixed_frame_transforms"),
    ):
        with pytest.raises(FileError, match=message):
            read_moveit_scene(write_scene(tmp_path, objects[1], fixed_frame_transforms=[transform]))


TILTED = Rotation.from_euler("xyz", (0.4, -0.7, 1.1))


@pytest.mark.parametrize("coef", [[0, 0, 1, 0], [1, 2, -3, 0.5], [1e-170, 0, 1e-170, 0], [3e99, 0, 1e99, 1e99]])
def test_planes_reach_around_the_scene_from_any_frame(tmp_path, coef):
    """The frame of the header and the pose lead far away; compare with all cells that the plane crosses."""
    motion = write_transform("camera", "world", (40, -30, 20), TILTED.as_quat())
    back = TILTED.inv().apply(np.array((0.1, 0.2, -0.1)) - (40, -30, 20))  # near the origin of the world
    ground = {"id": "ground", "planes": [{"coef": coef}], "plane_poses": [make_pose(back, TILTED.as_quat())]}
    path = write_scene(tmp_path, ground | {"header": {"frame_id": "camera"}}, fixed_frame_transforms=[motion])
    numbers = np.array(coef) / np.abs(coef).max()
    normal = (TILTED * TILTED).apply(numbers[:3] / np.linalg.norm(numbers[:3]))
    offset = numbers[3] / np.linalg.norm(numbers[:3]) - normal @ (0.1, 0.2, -0.1)
    for bounds, spacing in (((-1, -1, -1, 1, 1, 1), 0.1), ((-0.1, -0.1, -0.1, 0.1, 0.1, 0.1), 1.0)):
        workspace = Workspace.from_moveit_scene(path, spacing, bounds)
        centers = np.indices(workspace.outer.shape).reshape(3, -1).T * spacing + workspace.grid.lower + spacing / 2
        crossed = np.abs(centers @ normal + offset) < np.abs(normal).sum() * spacing / 2 - 1e-9
        assert crossed.any() and workspace.outer.reshape(-1)[crossed].all()
    placed = read_moveit_scene(path, plane_radius=3.0).obstacles["ground"]
    corners = placed.transform(placed.shape.vertices)
    np.testing.assert_allclose(corners @ normal, -offset, atol=1e-12)
    foot = -offset * normal
    np.testing.assert_allclose(corners.mean(axis=0), foot, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(corners - foot, axis=1), 3.0 * np.sqrt(2.0))


def test_a_warning_names_parts_that_enlarge_the_robot(tmp_path):
    mug = make_primitive("sphere", (0.1,), name="mug", header={"frame_id": "hand"})
    attached = {"attached_collision_objects": [{"link_name": "hand", "object": mug}]}
    padding = [{"link_name": "hand", "padding": 0.01}]
    path = write_scene(tmp_path, make_primitive("sphere", (1,)), robot_state=attached, link_padding=padding)
    with pytest.warns(UserWarning, match=r"attached objects \(mug\), link_padding enlarge the robot and are not read"):
        Workspace.from_moveit_scene(path, 0.1)


BOX = {"type": "box", "dimensions": [1, 1, 1]}


@refusals(
    "objects, expected",
    (
        [make_primitive("prism", [1, 1])],
        r"has the type 'prism' at primitives\[0\] of object 'thing'; .* box \(1\), sphere",
    ),
    ([make_primitive(5, [1, 1])], r"has the type 5 at"),
    ([make_primitive(None, [1, 1])], r"has the type None at"),
    ([make_primitive("cylinder", [1])], r"has the dimensions \[1.0\] at .*; a cylinder has height, radius"),
    ([make_primitive("cylinder", [1, 0])], r"has the dimensions \[1.0, 0.0\]"),
    ([make_primitive("sphere", [1, 2])], r"has the dimensions \[1.0, 2.0\] at .*; a sphere has radius"),
    ([make_primitive("box", ["a", 1, 1])], r"has \['a', 1, 1\] as dimensions of .*; it must be 3 finite numbers"),
    ([{"id": "a", "primitives": [{"type": 1}]}], r"has the dimensions \[\] at"),
    (
        [make_primitive("box", [1, 1, 1], {"position": [0, 0]})],
        r"as position of primitive_poses\[0\] of object 'thing'",
    ),
    ([make_primitive("box", [1, 1, 1], {"orientation": {"x": 1}})], r"as orientation of .* 4 finite numbers"),
    (
        [{"id": "a", "primitives": [dict(BOX), {}], "primitive_poses": [make_pose()]}],
        "has 2 primitives but 1 primitive_poses",
    ),
    ([{"id": "a"}], "has no shape at object 'a'"),
    ([], "holds no shape"),
    ([make_primitive("box", [1, 1, 1], operation="move")], "has the operation 'move' at object 'thing'"),
    *(
        (
            [make_primitive("box", [1, 1, 1], operation=value)],
            f"has the operation {re.escape(repr(value))} at obj",
        )
        for value in (True, False, 1.0, "?", 9, [0])
    ),
    (
        [make_primitive("box", [1, 1, 1]), make_primitive("box", [1, 1, 2], operation="append")],
        "appends to object 'thing'; versions of MoveIt differ in the pose; write all its shapes in one object",
    ),
    ([make_primitive("box", [1, 1, 1], header={"frame_id": 5})], "has '5' as frame_id of object 'thing'; it must be a"),
    ([make_primitive("box", [1, 1, 1], subframe_names=["a"])], "has 1 subframe_names but 0 subframe_poses at object"),
    (
        [make_primitive("box", [1, 1, 1]), make_primitive("box", [1, 1, 1], name="b", header={"frame_id": "thing"})],
        "has poses in the frame 'thing', which is of object 'thing'; MoveIt places them by that object",
    ),
    (
        [
            make_primitive("box", [1, 1, 1], subframe_names=["top"], subframe_poses=[make_pose()]),
            make_primitive("box", [1, 1, 1], name="b", header={"frame_id": "/thing/top"}),
        ],
        "has poses in the frame 'thing/top', which is of object 'thing'",
    ),
    ([{"id": "a", "primitives": [BOX | {"polygon": {"points": [[0, 0]]}}]}], "has a polygon at primitives"),
    ([{"id": "a", "planes": [{"coef": [0, 0, 1, 0], "d": 1}]}], "has the unknown field 'd' at planes"),
    (
        [{"id": "a", "meshes": [{"resource": "x.stl", "vertices": [[0, 0, 0]]}]}],
        "has a resource and vertices at meshes",
    ),
    ([{"id": "a", "meshes": [{"vertices": [], "dimensions": [1, 1, 1]}]}], "has dimensions without resource at meshes"),
    ([make_primitive("box", [1, 1, 1], make_pose((1500, 0, 0)))], "has a position beyond 1000 m at primitive_poses"),
    ([{"id": "a", "meshes": [{"vertices": [[0, 0, 0]], "triangles": [[0, 1, 2]]}]}], "of its 1 vertices at meshes"),
    ([{"id": "a", "meshes": [{"vertices": [], "triangles": []}]}], "has no triangles"),
    ([{"id": "a", "meshes": [{"resource": "package://none/x.stl"}]}], "does not exist"),
    ([{"id": "a", "planes": [{"coef": [0, 0, 0, 1]}]}], "a, b and c may not all be zero"),
    ([{"id": "a", "planes": [{"coef": [0, 0, 1]}]}], "as coef of planes"),
    (["box"], r"has 'box' as collision_objects\[0\]; it must be a table"),
    ([{"id": "a", "primitive": [BOX]}], r"has the unknown field 'primitive' at collision_objects\[0\]"),
    ([make_primitive("box", [1, 1, 1], pose={"xyz": [0, 0, 0]})], "unknown field 'xyz' at the pose of object 'thing'"),
    ([{"id": "a", "meshes": [{"faces": []}]}], r"unknown field 'faces' at meshes\[0\] of object 'a'"),
)
def test_malformed_scenes_are_refused_in_one_line(tmp_path, objects, expected):
    path = write_scene(tmp_path, *objects)
    with pytest.raises((FileError, GeometryError), match=expected) as caught:
        Workspace.from_moveit_scene(path, 0.1, BOUNDS)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_a_scene_with_more_shapes_than_the_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("cspace.shapes.scenes.MAX_SHAPES", 20)
    boxes = [make_primitive("box", [1, 1, 1], name=f"b{n}") for n in range(21)]
    assert len(read_moveit_scene(write_scene(tmp_path, *boxes[:20])).obstacles) == 20
    with pytest.raises(FileError, match="holds more than 20 shapes"):
        read_moveit_scene(write_scene(tmp_path, *boxes))


@refusals(
    "text, expected",
    ("world: {}", "has no world.collision_objects"),
    ("[1, 2]", "it must be a table"),
    ("(noname)\n* Box\n", "has no world.collision_objects|it must be a table|cannot be read"),
    ("world: {collision_objects: [], octomap: {octomap: {data: [1]}}}", r"holds an OctoMap; .* Workspace.from_octomap"),
    ("world: {collision_objects: [], octomap: {data: [1]}}", "has the unknown field 'data' at octomap"),
    ("world: {collision_objects: [], octomap: {octomap: {cells: [1]}}}", "has the unknown field 'cells' at octomap"),
    ("{world: {collision_objects: []}, is_diff: true}", "has is_diff: true; it only changes another scene; write the"),
    ("{world: {collision_objects: []}, is_diff: 1}", "has 1 as is_diff; it must be true or false"),
    ("world: {objects: []}", "has the unknown field 'objects' at world; the fields are collision_objects, octomap"),
    ("{world: {collision_objects: []}, worlds: []}", "has the unknown field 'worlds' at the scene"),
    ("world: {collision_objects: 3}", "has '3' as collision_objects; it must be a list"),
)
def test_other_files_are_refused_in_one_line(tmp_path, text, expected):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(FileError, match=expected):
        Workspace.from_moveit_scene(path, 0.1)
    with pytest.raises(FileError, match=expected):
        read_moveit_scene(path)


def test_numbers_of_the_caller_are_checked(tmp_path):
    path = write_scene(tmp_path, make_primitive("sphere", (1,)))
    with pytest.raises(InputError, match="spacing"):
        Workspace.from_moveit_scene(path, 0.0)
    with pytest.raises(InputError, match="plane_radius"):
        read_moveit_scene(path, plane_radius=-1)

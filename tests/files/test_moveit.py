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
from tests.helpers.refusals import refusals

NAMES = ("box", "sphere", "cylinder", "cone")
BOUNDS = (-2.0, -2.0, -2.0, 2.0, 2.0, 2.0)


def write_scene(folder: Path, *objects: dict[str, Any], **more: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(
        json.dumps({"name": "test", "world": {"collision_objects": list(objects)}, **more})
    )
    return path


def make_pose(position: Any = (0, 0, 0), orientation: Any = (0, 0, 0, 1)) -> dict[str, list[float]]:
    return {
        "position": [float(x) for x in position],
        "orientation": [float(x) for x in orientation],
    }


def make_primitive(
    kind: Any, dimensions: Any, at: Any = None, name: str = "thing", **more: Any
) -> dict[str, Any]:
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
    poses = [
        make_pose(position, turn.as_quat()) for position, turn in zip(places, turns, strict=True)
    ]
    dimensions, kind_written = list(sizes[:count]), kind
    if layout == 1:  # the text that ROS prints
        kind_written, dimensions = 1 + NAMES.index(kind), dimensions + [0.0] * (3 - count)
        poses = [
            {name: dict(zip("xyzw", numbers, strict=False)) for name, numbers in each.items()}
            for each in poses
        ]
    elif layout == 2:
        kind_written = kind.upper()
    path = write_scene(
        tmp_path,
        make_primitive(
            kind_written, dimensions, poses[1], pose=poses[0], operation="\0" * (layout == 1)
        ),
    )
    workspace = Workspace.from_moveit_scene(path, 0.11, (-3, -3, -3, 3, 3, 3))
    rng = np.random.default_rng(seed)
    local = rng.uniform(-0.7, 0.7, (4000, 3))
    points = (
        turns[0].apply(
            turns[1].apply(local[contains(kind, sizes[:count], local, -1e-9)]) + places[1]
        )
        + places[0]
    )
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
        return Arm.from_urdf(
            data / "arms" / "panda" / "panda.urdf", data / "arms" / "panda" / "panda.srdf"
        )


@pytest.mark.filterwarnings("ignore:.*without collision geometry")
@pytest.mark.parametrize("robot", ["panda", "ur5"])
def test_motion_bench_maker_scenes_agree_with_planning_scenes(tmp_path, robot, data, panda):
    """Compare scenes of a benchmark with shapes made directly. One arm is enough; the bodies of a
    ur5 take long."""
    arm, rng = panda, np.random.default_rng(0)
    problems = json.loads((data / "arms" / robot / "problems.json").read_text())["problems"]
    for each in [problem for of_kind in problems.values() for problem in of_kind[:1]]:
        objects, expected = [], {}
        for kind, sizes in (
            ("box", None),
            ("cylinder", ("length", "radius")),
            ("sphere", ("radius",)),
        ):
            for number, item in enumerate(each[kind]):
                name, turn = f"{kind}{number}", item.get("orientation_quat_xyzw", [0, 0, 0, 1])
                numbers = (
                    [2 * x for x in item["half_extents"]]
                    if sizes is None
                    else [item[key] for key in sizes]
                )
                header = {"header": {"frame_id": arm.frames[0]}}
                objects.append(
                    make_primitive(kind, numbers, make_pose(item["position"], turn), name, **header)
                )
                matrix = np.eye(4)
                matrix[:3, :3], matrix[:3, 3] = (
                    Rotation.from_quat(turn).as_matrix(),
                    item["position"],
                )
                make = {
                    "box": lambda *n: Robot.box(n),
                    "sphere": Robot.ball,
                    "cylinder": lambda h, r: Robot.cylinder(r, h),
                }
                expected[name] = PosedShape(make[kind](*numbers).shape, matrix)
        read = read_moveit_scene(write_scene(tmp_path, *objects))
        assert read.obstacles.keys() == expected.keys()
        spaces = build_arm_space(read, arm), build_arm_space(expected, arm)
        points = rng.uniform(*arm.ranges(), (300, arm.dof))
        points[0, : len(each["start"])] = each["start"]
        points[0] = arm.clamp(points[0])
        states = [np.asarray(space.classify(points)) for space in spaces]
        assert (states[0] == states[1]).all() and len(set(states[0].tolist())) > 1


def test_scenes_become_maps_and_arms(tmp_path):
    path = write_scene(
        tmp_path,
        make_primitive("box", (1, 1, 1), name="a"),
        make_primitive("sphere", (0.3,), make_pose((1.2, 0, 0)), "b"),
    )
    workspace = Workspace.from_moveit_scene(path, 0.05, BOUNDS)
    assert len(workspace.shapes) == 2 and repr(workspace).startswith(
        f"Workspace({path}: 80 x 80 x 80 cells"
    )
    space = build(workspace, Robot.ball(0.1))
    assert space.is_free((0.0, 1.0, 0.0)) and not space.is_free((0.55, 0, 0))
    assert not space.is_free((0.85, 0.0, 0.0), exact=True) and space.is_free(
        (0.75, 0.0, 0.0), exact=True
    )
    plain = Workspace.from_moveit_scene(path, 0.05)
    assert plain.grid.lower == (-0.5, -0.5, -0.5) and plain.grid.upper[0] == pytest.approx(1.5)


@refusals(
    "ids, expected",
    (["a", "a/0"], "has 'a/0' twice; ids and names of shapes must differ; rename one"),
    (["a/1", "a"], "has 'a/1' twice"),
    (["a", "a/0", "a/0/1"], "has 'a/0' twice"),
    (
        ["a", "b", "a"],
        "has 'a(/.)?' twice",
    ),
    ([5, "5"], "has '5(/.)?' twice"),
    ([True, "a"], r"has True as world.collision_objects\[0\].id; it must be a name"),
    ([1.5, "a"], r"has 1.5 as world.collision_objects\[0\].id"),
    (["a", None], r"has None as world.collision_objects\[1\].id; it must be a name"),
    (["object 1", ""], r"has '' as world.collision_objects\[1\].id"),
)
def test_names_that_hide_an_obstacle_are_refused(tmp_path, ids, expected):
    """Give the objects without a slash two shapes."""
    objects = [
        make_primitive("box", (1, 1, 1), make_pose((3 * n, 0, 0)), name)
        for n, name in enumerate(ids)
    ]
    for each in objects:
        if "/" not in str(each["id"]):
            each["primitives"], each["primitive_poses"] = (
                each["primitives"] * 2,
                each["primitive_poses"] * 2,
            )
    path = write_scene(tmp_path, *objects)
    for read in (read_moveit_scene, lambda path: Workspace.from_moveit_scene(path, 0.1, BOUNDS)):
        with pytest.raises(FileError, match=expected) as caught:
            read(path)
        assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_numbers_without_quotes_are_ids(tmp_path):
    """robowflex writes the id "7" without quotes."""
    assert list(
        read_moveit_scene(write_scene(tmp_path, make_primitive("box", (1, 1, 1), name=7))).obstacles
    ) == ["7"]


def test_meshes_are_read_from_the_scene_and_from_files(tmp_path):
    cube = trimesh.creation.box((1, 2, 3))
    (tmp_path / "cubes" / "meshes").mkdir(parents=True)
    cube.export(tmp_path / "cubes" / "meshes" / "cube.stl")
    corners = [dict(zip("xyz", row, strict=True)) for row in cube.vertices.tolist()]
    inline = {
        "vertices": corners,
        "triangles": [{"vertex_indices": row} for row in cube.faces.tolist()],
    }
    plain = {"vertices": cube.vertices.tolist(), "triangles": cube.faces.tolist()}
    scaled = {"resource": "package://cubes/meshes/cube.stl", "dimensions": [0.5, 0.5, 0.5]}
    near = {"resource": "cubes/meshes/cube.stl"}
    turn = make_pose((5, 0, 0), Rotation.from_euler("z", 90, degrees=True).as_quat())
    for number, (mesh, factor) in enumerate(
        ((inline, 1.0), (plain, 1.0), (scaled, 0.5), (near, 1.0))
    ):
        path = write_scene(tmp_path, {"id": f"m{number}", "meshes": [mesh], "mesh_poses": [turn]})
        workspace = Workspace.from_moveit_scene(path, 0.1)
        expected = np.array([[-1, -0.5, -1.5], [1, 0.5, 1.5]]) * factor + [5, 0, 0]
        np.testing.assert_allclose(workspace.shapes[0].bounds, expected, atol=1e-7)
        assert workspace.inner.any()


def test_objects_are_read_in_one_frame(tmp_path):
    one, other = ({"header": {"frame_id": name}} for name in ("/table", "world"))
    objects = (
        make_primitive("sphere", (0.1,), name="a", **one),
        make_primitive("sphere", (0.1,), make_pose((1, 0, 0)), "b", **other),
    )
    identity = {
        "header": {"frame_id": "world"},
        "child_frame_id": "table",
        "transform": {"rotation": [0, 0, 0, 1]},
    }
    scene = read_moveit_scene(write_scene(tmp_path, objects[0], fixed_frame_transforms=[identity]))
    assert scene.frame == "table" and list(scene.obstacles) == ["a"]
    with pytest.raises(
        FileError, match=r"has poses in the frames 'table', 'world'; they must be in one frame"
    ):
        read_moveit_scene(write_scene(tmp_path, *objects))


def test_a_warning_names_parts_that_enlarge_the_robot(tmp_path):
    mug = make_primitive("sphere", (0.1,), name="mug", header={"frame_id": "hand"})
    attached = {"attached_collision_objects": [{"link_name": "hand", "object": mug}]}
    path = write_scene(tmp_path, make_primitive("sphere", (1,)), robot_state=attached)
    with pytest.warns(
        UserWarning, match=r"attached objects \(mug\) enlarge the robot and are not read"
    ):
        Workspace.from_moveit_scene(path, 0.1)


BOX = {"type": "box", "dimensions": [1, 1, 1]}


@refusals(
    "objects, expected",
    (
        [make_primitive("prism", [1, 1])],
        r"has 'prism' as world.collision_objects\[0\].primitives\[0\].type; .* box \(1\), sphere",
    ),
    ([make_primitive(5, [1, 1])], r"has 5 as .*primitives\[0\].type"),
    ([make_primitive(None, [1, 1])], r"has None as .*primitives\[0\].type"),
    (
        [make_primitive("cylinder", [1])],
        r"has \[1.0\] as .*dimensions; a cylinder has height, radius",
    ),
    ([make_primitive("cylinder", [1, 0])], r"has \[1.0, 0.0\] as .*dimensions"),
    (
        [make_primitive("sphere", [1, 2])],
        r"has \[1.0, 2.0\] as .*dimensions; a sphere has radius",
    ),
    (
        [make_primitive("box", ["a", 1, 1])],
        r"has 'a' as .*dimensions\[0\]; it must be one finite number",
    ),
    ([{"id": "a", "primitives": [{"type": 1}]}], r"has \[\] as .*dimensions"),
    (
        [make_primitive("box", [1, 1, 1], {"position": [0, 0]})],
        r"as .*primitive_poses\[0\].position; it must be 3 finite numbers",
    ),
    (
        [make_primitive("box", [1, 1, 1], {"orientation": {"x": 1}})],
        r"as .*orientation; it must be 4 finite numbers",
    ),
    (
        [{"id": "a", "primitives": [BOX, BOX], "primitive_poses": [make_pose()]}],
        "has 2 primitives but 1 primitive_poses",
    ),
    ([{"id": "a"}], "has no shape at object 'a'"),
    ([], "holds no shape"),
    (
        [make_primitive("box", [1, 1, 1], operation="move")],
        "has 'move' as .*operation; it must be 'add'",
    ),
    *(
        (
            [make_primitive("box", [1, 1, 1], operation=value)],
            f"has {re.escape(repr(value))} as .*operation",
        )
        for value in (True, False, 1.0, "?", 9, [0], 1, "remove", "append")
    ),
    (
        [make_primitive("box", [1, 1, 1], subframe_names=["a"], subframe_poses=[make_pose()])],
        r"has world.collision_objects\[0\].subframe_names; it is not read; remove them, and write",
    ),
    (
        [
            make_primitive("box", [1, 1, 1]),
            make_primitive("box", [1, 1, 1], name="b", header={"frame_id": "thing"}),
        ],
        "has poses in the frames 'thing', 'world'",
    ),
    (
        [{"id": "a", "primitives": [BOX | {"polygon": {"points": [[0, 0]]}}]}],
        r"has .*primitives\[0\].polygon; it is not read",
    ),
    (
        [{"id": "a", "planes": [{"coef": [0, 0, 1, 0]}]}],
        "has .*planes; it is not read; a plane has no end; write a box",
    ),
    (
        [{"id": "a", "meshes": [{"resource": "x.stl", "vertices": [[0, 0, 0]]}]}],
        "has vertices and a resource or dimensions at meshes",
    ),
    (
        [{"id": "a", "meshes": [{"vertices": [[0, 0, 0]], "dimensions": [1, 1, 1]}]}],
        "has vertices and a resource or dimensions at meshes",
    ),
    (
        [make_primitive("box", [1, 1, 1], make_pose((1500, 0, 0)))],
        "has a position beyond 1000 m at .*primitive_poses",
    ),
    (
        [{"id": "a", "meshes": [{"vertices": [[0, 0, 0]], "triangles": [[0, 1, 2]]}]}],
        "as a triangle of .* of its 1 vertices",
    ),
    ([{"id": "a", "meshes": [{"vertices": [], "triangles": []}]}], "has no triangles"),
    ([{"id": "a", "meshes": [{"resource": "package://none/x.stl"}]}], "does not exist"),
    (["box"], r"has 'box' as world.collision_objects\[0\]; it must be a table"),
    (
        [{"id": "a", "primitive": [BOX]}],
        r"has the unknown field 'primitive' at world.collision_objects\[0\]",
    ),
    (
        [make_primitive("box", [1, 1, 1], pose={"xyz": [0, 0, 0]})],
        "unknown field 'xyz' at .*pose; the fields are position, orientation",
    ),
    (
        [{"id": "a", "meshes": [{"faces": []}]}],
        r"unknown field 'faces' at .*meshes\[0\]",
    ),
)
def test_malformed_scenes_are_refused_in_one_line(tmp_path, objects, expected):
    path = write_scene(tmp_path, *objects)
    with pytest.raises((FileError, GeometryError), match=expected) as caught:
        Workspace.from_moveit_scene(path, 0.1, BOUNDS)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@refusals(
    "text, expected",
    ("[1, 2]", "it must be a table"),
    ("(noname)\n* Box\n", "it must be a table|cannot be read"),
    (
        "world: {collision_objects: [], octomap: {octomap: {data: [1]}}}",
        r"has world.octomap.octomap.data; .* Workspace.from_octomap",
    ),
    (
        "world: {collision_objects: [], octomap: {data: [1]}}",
        "has the unknown field 'data' at world.octomap",
    ),
    (
        "world: {collision_objects: [], octomap: {octomap: {cells: [1]}}}",
        "has the unknown field 'cells' at world.octomap.octomap",
    ),
    (
        "{world: {collision_objects: []}, is_diff: true}",
        "has True as is_diff; it must be False; write the whole scene",
    ),
    ("{world: {collision_objects: []}, is_diff: 1}", "has 1 as is_diff; it must be False"),
    (
        "world: {objects: []}",
        "has the unknown field 'objects' at world; the fields are collision_objects, octomap",
    ),
    ("{world: {collision_objects: []}, world2: []}", "has the unknown field 'world2' at the top"),
    ("world: {collision_objects: 3}", "has 3 as world.collision_objects; it must be a list"),
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

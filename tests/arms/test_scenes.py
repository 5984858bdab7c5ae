"""Planning scenes of MoveIt."""

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import cspace
from cspace import FileError, Workspace
from cspace.errors import AngleWarning, GeometryError, InputError
from tests.helpers.refusals import refusals, write

BOUNDS = (-3.0, -3.0, -3.0, 3.0, 3.0, 3.0)


def write_scene(folder, *objects, **more):
    scene = {"name": "test", "world": {"collision_objects": objects}, **more}
    return write(folder, "scene.yaml", scene)


def make_pose(position=(0, 0, 0), orientation=(0, 0, 0, 1)):
    return {
        "position": [float(x) for x in position],
        "orientation": [float(x) for x in orientation],
    }


def make_object(kind, sizes, place=None, name="thing", **more):
    """Return a collision object of one primitive."""
    shape = {"type": kind, "dimensions": list(sizes)}
    return {"id": name, "primitives": [shape], "primitive_poses": [place or make_pose()], **more}


@pytest.mark.parametrize(
    "kind, sizes, sides",
    [
        (1, (1, 2, 3), (1, 3, 2)),
        ("SPHERE", (1.5, 0, 0), (3, 3, 3)),
        ("cylinder", (1, 2), (4, 1, 4)),
        (4, (1, 2, 0), (4, 1, 4)),
    ],
)
def test_primitives_have_the_size_and_pose_of_the_message(tmp_path, kind, sizes, sides):
    """Turn y towards z; MoveIt writes the height before the radius, and a box as number 1."""
    lie = make_pose((5, 0, 0), Rotation.from_euler("x", 90, degrees=True).as_quat())
    path = write_scene(tmp_path, make_object(kind, sizes, lie, 7, pose=make_pose((0, 7, 0))))
    (shape,) = Workspace.from_moveit_scene(path, 0.1).shapes
    lower, upper = shape.outer.bounds
    np.testing.assert_allclose(upper - lower, sides, rtol=0.1)
    np.testing.assert_allclose(upper + lower, (10, 14, 0), atol=0.1)


@refusals(
    "ids, expected",
    (["a", "a/0"], "has 'a/0' twice; ids and names of shapes must differ"),
    ([True, "a"], r"has True as scene.world.collision_objects\[0\].id; it must be a name"),
)
def test_names_that_hide_an_obstacle_are_refused(tmp_path, ids, expected):
    """Give the objects without a slash two shapes."""
    objects = [make_object("box", (1, 1, 1), name=name) for name in ids]
    for thing in objects:
        if "/" not in str(thing["id"]):
            thing["primitives"] *= 2
            thing["primitive_poses"] *= 2
    path = write_scene(tmp_path, *objects)
    with pytest.raises(FileError, match=expected):
        cspace.arms.read_moveit_scene(path)
    with pytest.raises(FileError, match=expected):
        Workspace.from_moveit_scene(path, 0.1, BOUNDS)


def test_meshes_are_read_from_the_scene_and_from_files(tmp_path):
    cube = trimesh.creation.box((1, 2, 3))
    folder = tmp_path / "cubes" / "meshes"
    folder.mkdir(parents=True)
    cube.export(folder / "cube.stl")
    corners = [dict(zip("xyz", row, strict=True)) for row in cube.vertices.tolist()]
    triangles = [{"vertex_indices": row} for row in cube.faces.tolist()]
    scaled = {"resource": "package://cubes/meshes/cube.stl", "dimensions": [0.5, 0.5, 0.5]}
    turn = make_pose((5, 0, 0), Rotation.from_euler("z", 90, degrees=True).as_quat())
    for mesh, factor in (
        ({"vertices": corners, "triangles": triangles}, 1.0),
        (scaled, 0.5),
        ({"resource": "cubes/meshes/cube.stl"}, 1.0),
    ):
        path = write_scene(tmp_path, {"id": "m", "meshes": [mesh], "mesh_poses": [turn]})
        workspace = Workspace.from_moveit_scene(path, 0.1)
        expected = np.array([[-1, -0.5, -1.5], [1, 0.5, 1.5]]) * factor + [5, 0, 0]
        np.testing.assert_allclose(workspace.shapes[0].bounds, expected, atol=1e-7)
        assert workspace.inner.any()


def test_objects_are_read_in_one_frame(tmp_path):
    first = make_object("sphere", (0.1,), name="a", header={"frame_id": "/table"})
    second = make_object("sphere", (0.1,), name="b", header={"frame_id": "world"})
    identity = {"child_frame_id": "table", "transform": {"rotation": [0, 0, 0, 1]}}
    scene = cspace.arms.read_moveit_scene(
        write_scene(tmp_path, first, fixed_frame_transforms=[identity])
    )
    assert scene.frame == "table"
    path = write_scene(tmp_path, first, second)
    message = r"has poses in the frames 'table', 'world'; they must be in one frame"
    with pytest.raises(FileError, match=message):
        cspace.arms.read_moveit_scene(path)


def make_box(**changes):
    """Return a collision object of a box with other fields."""
    return make_object("box", [1, 1, 1]) | changes


def make_mesh(**fields):
    return {"id": "a", "meshes": [fields]}


POINT = [[0, 0, 0]]


@refusals(
    "thing, expected",
    (make_object("prism", [1]), r"has 'prism' as .*primitives\[0\].type; .* box \(1\), sphere"),
    (make_object("cylinder", [1]), r"has \[1.0\] as .*; a cylinder has height, radius"),
    (make_box(header={"frame_id": []}), r"has \[\] as .*frame_id; it must be a name"),
    (make_mesh(vertices=POINT, triangles=[[0, 1, 2]]), "as a triangle of .* of its 1 vertices"),
)
def test_malformed_objects_are_refused_in_one_line(tmp_path, thing, expected):
    path = write_scene(tmp_path, thing)
    with pytest.raises((FileError, GeometryError), match=expected) as caught:
        Workspace.from_moveit_scene(path, 0.1, BOUNDS)
    assert re.fullmatch(f"{path}.*", str(caught.value))


@refusals(
    "text, expected",
    (
        "world: {octomap: {octomap: {data: [1]}}}",
        r"has scene\.world\.octomap\.octomap\.data",
    ),
    (
        "world: {objects: []}",
        r"scene\.world has the unknown field 'objects'; the fields are collision_objects, octomap",
    ),
    (
        "allowed_collision_matrix: {entry_names: [a]}",
        "of another size than its names; it is square",
    ),
)
def test_other_files_are_refused(tmp_path, text, expected):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises((FileError, GeometryError), match=expected):
        Workspace.from_moveit_scene(path, 0.1)


def test_the_frame_of_a_scene_is_that_of_its_map(tmp_path):
    path = write_scene(tmp_path, make_box(header={"frame_id": "/table"}))
    workspace = Workspace.from_moveit_scene(path, 0.1, BOUNDS)
    assert workspace.grid.frame_id == "table"
    path = write_scene(tmp_path, make_box())
    assert Workspace.from_moveit_scene(path, 0.1, BOUNDS).grid.frame_id == "world"


def test_an_echo_that_was_cut_says_so(tmp_path):
    path = write_scene(tmp_path, make_object("box", (1, "...")))
    hint = "and the message whole"
    with pytest.raises(FileError, match=rf"dimensions\[1\] has the value '\.\.\.'; .*{hint}"):
        Workspace.from_moveit_scene(path, 0.1)
    path = write_scene(tmp_path, make_object("box", (1, 1, 1)))
    path.write_text(f"{path.read_text()}\n---\n")
    assert len(Workspace.from_moveit_scene(path, 0.1).shapes) == 1


def test_a_quaternion_of_an_angle_warns(tmp_path):
    turned = make_box(pose=make_pose((0, 0, 0), (0, 0, 90, 1)))
    with pytest.warns(AngleWarning, match="component 90, beyond 1,"):
        Workspace.from_moveit_scene(write_scene(tmp_path, turned), 0.1)
    half = np.radians(90) / 2
    right = make_box(pose=make_pose((0, 0, 0), (0, 0, np.sin(half), np.cos(half))))
    (shape,) = Workspace.from_moveit_scene(write_scene(tmp_path, right), 0.1).shapes
    np.testing.assert_allclose(np.diff(shape.outer.bounds, axis=0), 1.0)


def test_a_mapping_that_is_nested_too_deep_is_refused():
    polygon = {}
    for _ in range(10_000):
        polygon = {"points": polygon}
    thing = make_object("box", (1, 1, 1))
    thing["primitives"][0]["polygon"] = polygon
    with pytest.raises(InputError, match=r"has scene.*polygon; it is not read"):
        Workspace.from_moveit_scene({"world": {"collision_objects": [thing]}}, 0.1)

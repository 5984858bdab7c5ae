"""Hints about files of arms and of their scenes: each is followed by code."""

import json
import re

import pytest
import trimesh

from cspace import Robot, Workspace
from tests.helpers.refusals import check_refused, refusals, write

CUBE = trimesh.creation.box((0.3, 0.3, 0.3))


def read(path):
    """Read a file by its name."""
    if path.name.startswith("robot"):
        return Robot.open(path)
    return Workspace.from_moveit_scene(path, 0.1, (-2, -2, -2, 2, 2, 2))


BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision>'


URDF = f'<robot name="r"><link name="base">{BOX}</link><link name="top">{BOX}</link>JOINT</robot>'


JOINT = '<joint name="j" type="fixed"><parent link="base"/><child link="top"/></joint>'


SECOND = '<joint name="k" type="fixed"><parent link="top"/><child link="base"/></joint>'


GOOD_URDF = URDF.replace("JOINT", JOINT)


MIMIC = '<joint name="j" type="revolute"><parent link="base"/><child link="top"/><mimic joint="j"/>'


TURNING = f'{MIMIC}<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'


LINKS = "robot.urdf"


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


WITH_MESH = GOOD_URDF.replace('<box size="1 1 1"/>', '<mesh filename="package://p/a.stl"/>')


def write_package(folder):
    """Write a URDF beside its package, which it does not find."""
    (folder / "far" / "p").mkdir(parents=True)
    CUBE.export(folder / "far" / "p" / "a.stl")
    return write(folder, "robot.urdf", WITH_MESH)


@refusals(
    "name, wrong, hint",
    (
        LINKS,
        GOOD_URDF.replace('"top">', '"base">', 1),
        "robot.urdf: has 'base' twice as a link ... differ",
    ),
    (
        LINKS,
        GOOD_URDF.replace('child link="top"', 'child link="t"'),
        "robot.urdf: joins 'base' to 't' by the joint 'j' ... links",
    ),
    (
        LINKS,
        URDF.replace("JOINT", JOINT + SECOND),
        "robot.urdf: joins 'top' in a loop of joints ... form",
    ),
    (
        LINKS,
        URDF.replace("JOINT", ""),
        "robot.urdf: has these links without a parent: base, top ... one root",
    ),
    (
        LINKS,
        GOOD_URDF.replace("1 1 1", "1,1,1"),
        "robot.urdf: has size='1,1,1' at the box of link 'base' ... 3 finite numbers",
    ),
    (
        LINKS,
        GOOD_URDF.replace(' size="1 1 1"', ""),
        "robot.urdf: lacks the size of the box of link 'base', ... there",
    ),
    (
        LINKS,
        URDF.replace("JOINT", TURNING),
        "robot.urdf: has the joint 'j', which mimics itself ... mimic another joint",
    ),
    (
        LINKS,
        GOOD_URDF.replace("1 1 1", "${a} 1 1"),
        'robot.urdf: holds xacro macros ... expanded ... the page "Bring your file" says how',
    ),
    (
        LINKS,
        GOOD_URDF.replace('<box size="1 1 1"/>', '<mesh filename="a.stl" scale="0 1 1"/>'),
        "robot.urdf: link 'base', collision 0: mesh: scale is [0.0, ... factor",
    ),
    (
        "scene.yaml",
        scene(THING, extra=1),
        "scene.yaml: scene has the unknown field 'extra' ... allowed_collision_matrix",
    ),
    (
        "scene.yaml",
        scene(THING | {"pose": FAR_POSE}),
        "scene.yaml: has a position beyond 1000 m at ... digits",
    ),
    (
        "scene.yaml",
        scene(THING, fixed_frame_transforms=[MOVED]),
        "has a motion as scene.fixed_frame_transforms[0].transform",
    ),
    (
        "scene.yaml",
        scene(THING | {"primitive_poses": [NEAR_POSE, NEAR_POSE]}),
        "scene.yaml: has 1 primitives but 2 primitive_poses at ... needs",
    ),
    (
        "scene.yaml",
        scene(THING | {"planes": [{"coef": [1]}]}),
        "scene.yaml: has scene.world.collision_objects[0].planes ... not read",
    ),
    (
        "scene.yaml",
        scene(THING | {"subframe_names": ["a"]}),
        "scene.yaml: has scene.world.collision_objects[0].subframe_names ... not read",
    ),
    (
        "scene.yaml",
        scene(THING | {"operation": 1}),
        "scene.yaml: has 1 as scene.world.collision_objects[0].operation ... 'add'",
    ),
    ("scene.yaml", scene(THING, is_diff=True), "scene.yaml: has True as scene.is_diff ... False"),
    (
        "scene.yaml",
        scene(THING, robot_state={"is_diff": True}),
        "scene.yaml: has True as scene.robot_state.is_diff ... False",
    ),
    (
        "scene.yaml",
        scene({"id": "a"}, THING),
        "scene.yaml: has no shape at object 'a' ... primitives or meshes",
    ),
    (
        "scene.yaml",
        scene({"id": "a", "meshes": [MESH | {"resource": "a.stl"}]}),
        "scene.yaml: has vertices and a resource or dimensions at ... mesh",
    ),
    ("scene.yaml", scene(), "scene.yaml holds no shape ... needs"),
    (
        "scene.yaml",
        scene(THING, robot_state={"attached_collision_objects": [HELD]}),
        "scene.yaml: has no header.frame_id at object 'held' ... robowflex",
    ),
    (
        "scene.yaml",
        scene(THING, link_padding=[{"link_name": "a", "padding": 0.1}]),
        "scene.yaml: has 0.1 as scene.link_padding[0].padding ... 0.0",
    ),
    (
        "scene.yaml",
        scene(THING | {"primitives": [{"type": 5, "dimensions": [1], "polygon": {"points": [1]}}]}),
        "scene.yaml: has ... not read",
    ),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_wrong_file_is_refused(name, wrong, hint, tmp_path):
    trimesh.creation.box().export(tmp_path / "a.stl")
    check_refused(lambda: read(write(tmp_path, name, wrong)), hint)


@refusals(
    "name, wrong, hint",
    (
        LINKS,
        GOOD_URDF.replace("<child", '<origin rpy="0 0 180"/><child'),
        "180 degrees are 3.14159 rad",
    ),
    (
        LINKS,
        URDF.replace("collision", "visual", 2).replace("JOINT", JOINT),
        "pass visuals=True to use <visual> there",
    ),
)
def test_what_a_file_says_oddly_is_warned_of(name, wrong, hint, tmp_path):
    with pytest.warns(UserWarning, match=re.escape(hint)):
        read(write(tmp_path, name, wrong))


@refusals(
    "call, hint",
    (
        lambda f: Robot.open(write_package(f)),
        "does not exist; the search covers package_dirs",
    ),
    (
        lambda f: Robot.from_urdf(write_package(f), package_dirs=3),
        "package_dirs is 3 ... folders",
    ),
    (
        lambda f: Robot.from_urdf(write_package(f), package_dirs=[f / "fra"]),
        "each must be an existing folder that holds the folders of packages",
    ),
    (lambda f: Robot.from_urdf(write(f, "a.urdf", GOOD_URDF), 3), "link is 3 ... list of names"),
    (
        lambda f: Robot.from_urdf(write(f, "a.urdf", GOOD_URDF), solid="surface"),
        "only a mesh can be a surface without an inside",
    ),
)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_calls_that_read_a_file_wrongly_are_refused(call, hint, tmp_path):
    check_refused(lambda: call(tmp_path), hint)


@refusals(
    "call, hint",
    (
        lambda f: Workspace.from_moveit_scene(
            write(f, "s.yaml", CARRIED), 0.1, (-2,) * 3 + (2,) * 3
        ),
        "enlarge the robot and are not read",
    ),
    (
        lambda f: Robot.open(write(f, "a.urdf", URDF.replace("JOINT", SWINGING))),
        "are omitted",
    ),
    (
        lambda f: Robot.open(write(f, "a.urdf", GOOD_URDF.replace("collision", "visual", 2))),
        "pass visuals=True",
    ),
    (
        lambda f: Robot.open(write_elsewhere(f)),
        "is read instead",
    ),
)
def test_what_a_file_does_not_say_is_warned_of(call, hint, tmp_path):
    with pytest.warns(UserWarning, match=re.escape(hint)):
        call(tmp_path)


CARRIED = scene(
    THING,
    robot_state={
        "attached_collision_objects": [
            {"link_name": "top", "object": THING | {"id": "held", "header": {"frame_id": "top"}}}
        ]
    },
)


SWINGING = TURNING.replace('<mimic joint="j"/>', "")


def write_elsewhere(folder):
    """Write a URDF whose mesh lies beside it without the folder of its package."""
    write_package(folder)
    (folder / "u").mkdir()
    CUBE.export(folder / "u" / "a.stl")
    return write(folder / "u", "robot.urdf", WITH_MESH)

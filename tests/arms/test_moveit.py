"""MoveIt's planning scenes and motion plan requests, applied to arms."""

import json
import math
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import planners
from cspace import Arm, PoseGoal, Robot, build_arm_space
from cspace.arms import JointValues, read_moveit_request, read_moveit_scene
from cspace.errors import ConfigurationError, FileError, InputError
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import joint, link, posed_box, write_urdf

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))
SQUARE = Rotation.from_euler("z", 90, degrees=True).as_quat().tolist()


def write_arm(folder: Path) -> tuple[Path, Path]:
    """Write a lift that carries two bars in the plane and a gripper; the group is the bars."""
    path = write_urdf(
        folder,
        link("base_link", ((0.2, 0.2, 0.2), (0, 0, -0.3))),
        *(link(name, BAR) for name in ("upper", "fore")),
        *(link(name) for name in ("column", "stand", "tool")),
        *(link(name, ((0.04, 0.04, 0.04), (1.05, 0, 0))) for name in ("left", "right")),
        joint("lift", "base_link", "column", kind="prismatic", limits=(0.0, 1.0)),
        joint("mount", "column", "stand", at=(0, 0, 0.5), kind="fixed"),
        joint("shoulder", "stand", "upper"),
        joint("elbow", "upper", "fore", at=(1, 0, 0), kind="continuous", limits=None),
        joint("wrist", "fore", "tool", at=(1, 0, 0), kind="fixed"),
        joint("finger", "fore", "left", axis=(0, 1, 0), kind="prismatic", limits=(0.03, 0.1)),
        joint(
            *("follower", "fore", "right"),
            axis=(0, -1, 0),
            kind="prismatic",
            limits=(0.03, 0.1),
            extra='<mimic joint="finger"/>',
        ),
    )
    srdf = folder / "arm.srdf"
    pairs = (
        ("upper", "fore"),
        ("fore", "left"),
        ("fore", "right"),
        ("left", "right"),
        ("base_link", "upper"),
    )
    disabled = "".join(f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in pairs)
    srdf.write_text(
        '<robot name="small"><group name="bars"><joint name="shoulder"/><joint name="elbow"/></group>'
        f"{disabled}</robot>"
    )
    return path, srdf


STATE = {
    "lift": 0.25,
    "shoulder": 0.5,
    "elbow": -0.5,
    "finger": 0.05,
    "follower": 0.05,
}
"""A state of all joints, as robots report it."""


def joint_state(values: dict[str, float]) -> dict[str, Any]:
    return {"joint_state": {"name": list(values), "position": list(values.values())}}


def make_object(
    name: str, position: Any = (0, 0, 0), side: float = 0.2, **more: Any
) -> dict[str, Any]:
    """Make a cube as a collision object."""
    pose = {"position": list(map(float, position)), "orientation": [0, 0, 0, 1]}
    return {
        "id": name,
        "primitives": [{"type": "box", "dimensions": [side] * 3}],
        "primitive_poses": [pose],
        **more,
    }


ON_TOOL = {"header": {"frame_id": "tool"}}


def write_scene(folder: Path, *objects: dict[str, Any], **more: Any) -> Path:
    path = folder / "scene.yaml"
    path.write_text(json.dumps({"world": {"collision_objects": list(objects)}, **more}))
    return path


def read_arm(folder: Path, **options: Any) -> Arm:
    path, srdf = write_arm(folder)
    return Arm.from_urdf(
        path, srdf, **{"joints": "bars", "held_joints": JointValues(STATE), **options}
    )


def make_matrix(names: Any, pairs: Any = (), **defaults: bool) -> dict[str, Any]:
    """Make an allowed collision matrix in which pairs may touch."""
    allowed = {frozenset(pair) for pair in pairs}
    return {
        "entry_names": list(names),
        "entry_values": [{"enabled": [frozenset((a, b)) in allowed for b in names]} for a in names],
        "default_entry_names": list(defaults),
        "default_entry_values": list(defaults.values()),
    }


# ---- states --------------------------------------------------------------------------------------


def test_joint_values_give_the_held_joints_and_the_configuration(tmp_path: Path) -> None:
    arm = read_arm(tmp_path)
    assert arm.joints == ("shoulder", "elbow") and arm.held_joints == {"lift": 0.25, "finger": 0.05}
    assert arm.configuration(JointValues(STATE)).tolist() == [0.5, -0.5]
    assert arm.configuration(JointValues(elbow=0.1), (0.3, 0.4)).tolist() == [0.3, 0.1]
    urdf = yourdfpy.URDF.load(str(tmp_path / "arm.urdf"), load_meshes=False)
    urdf.update_cfg({name: STATE[name] for name in urdf.actuated_joint_names})
    for frame in arm.frames:
        np.testing.assert_allclose(
            arm.pose((0.5, -0.5), frame), urdf.get_transform(frame), atol=1e-12
        )
    assert Arm.from_urdf(*write_arm(tmp_path)).held_joints == {}
    assert Arm.from_urdf(*write_arm(tmp_path), joints="bars").held_joints == {
        "lift": 0.0,
        "finger": 0.03,
    }


@refusals(
    "values, message",
    (
        STATE | {"lift": 0.3},
        "values has lift at 0.3; the arm holds it at 0.25; pass these values as held_joints=",
    ),
    (
        STATE | {"wheel": 0.0},
        "values names 'wheel'; there are shoulder, elbow, lift, finger, follower",
    ),
    (
        {"shoulder": 0.0, "lift": 0.25},
        "values lack elbow; they are values of all joints of a robot",
    ),
    (STATE | {"elbow": math.nan}, r"values\['elbow'\] is nan"),
)
def test_joint_values_of_another_robot_are_refused(
    tmp_path: Path, values: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_arm(tmp_path).configuration(JointValues(values))


def test_held_joints_of_another_robot_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="held_joints names 'wheel'; there are lift, mount, shoulder"
    ):
        read_arm(tmp_path, held_joints=JointValues(wheel=0.0))
    with pytest.raises(InputError, match="held_joints has lift at 2; its limits are 0 and 1"):
        read_arm(tmp_path, held_joints=JointValues(STATE | {"lift": 2.0}))


# ---- scenes --------------------------------------------------------------------------------------


def count_equal(space: Any, expected: Any, seed: int = 0) -> int:
    """Check that two spaces classify configurations alike, and return how many states there are."""
    points = np.random.default_rng(seed).uniform(-3, 3, (400, space.arm.dof))
    states = np.asarray(space.classify(points))
    np.testing.assert_array_equal(states, expected.classify(points))
    return len(set(states.tolist()))


def test_frames_of_the_arm_place_the_obstacles(tmp_path: Path) -> None:
    arm, box = read_arm(tmp_path), posed_box((0.2, 0.2, 0.2), 1.5, 0.3, 0.75)
    expected = build_arm_space({"box": box}, arm)
    world = write_scene(tmp_path, make_object("box", (1.5, 0.3, 0.75)))
    assert count_equal(build_arm_space(read_moveit_scene(world), arm), expected) > 1
    stand = write_scene(tmp_path, make_object("box", (1.5, 0.3, 0), header={"frame_id": "stand"}))
    assert count_equal(build_arm_space(read_moveit_scene(stand), arm), expected) > 1
    shelf = read_moveit_scene(
        write_scene(tmp_path, make_object("box", header={"frame_id": "shelf"}))
    )
    pose = np.linalg.inv(box.pose)
    assert count_equal(build_arm_space(shelf, arm, base_pose=pose), expected) > 1
    with pytest.raises(
        InputError,
        match=r"has poses in the frame 'shelf'; the arm has no such frame; .* base_pose=",
    ):
        build_arm_space(shelf, arm)
    moving = read_moveit_scene(
        write_scene(tmp_path, make_object("box", header={"frame_id": "tool"}))
    )
    with pytest.raises(
        InputError, match="has poses in the frame 'tool'; a joint of the arm moves it"
    ):
        build_arm_space(moving, arm)


@pytest.mark.parametrize("frame", ["tool", "world"])
def test_attached_objects_are_carried(tmp_path: Path, frame: str) -> None:
    """Let the state give the place of an object in the planning frame."""
    arm, post = read_arm(tmp_path), make_object("post", (1.2, 1.2, 0.75), 0.3)
    at = (0.2, 0, 0) if frame == "tool" else (1.6, 0.9, 0.75)
    held = make_object("mug", at, header={"frame_id": frame})
    carried = {
        "link_name": "tool",
        "object": held,
        "touch_links": ["left", "right", "fore", "camera"],
    }
    state = joint_state(STATE) | {"attached_collision_objects": [carried]}
    path = write_scene(tmp_path, post, robot_state=state)
    scene = read_moveit_scene(path)
    assert (
        repr(scene) == f"PlanningScene({path}: 1 obstacles, 1 attached)"
        and scene.robot_state == STATE
    )
    space = build_arm_space(scene, arm)
    urdf = yourdfpy.URDF.load(str(tmp_path / "arm.urdf"), load_meshes=False)
    urdf.update_cfg({name: STATE[name] for name in urdf.actuated_joint_names})
    on_base = np.eye(4) if frame == "world" else urdf.get_transform(frame)
    point = on_base @ [*at, 1.0]
    np.testing.assert_allclose(space.arm.pose((0.5, -0.5), "mug")[:3, 3], point[:3], atol=1e-12)
    on_tool = np.linalg.solve(arm.pose((0.5, -0.5), "tool"), space.arm.pose((0.5, -0.5), "mug"))
    held_arm = arm.attach(
        "mug", Robot.box((0.2, 0.2, 0.2)).shape, "tool", on_tool, ["left", "right", "fore"]
    )
    expected = build_arm_space({"post": posed_box((0.3, 0.3, 0.3), 1.2, 1.2, 0.75)}, held_arm)
    assert count_equal(space, expected) > 1


def test_a_scene_without_a_world_may_carry_objects(tmp_path: Path) -> None:
    two = make_object("mug", (0.3, 0, 0), header={"frame_id": "tool"})
    two["primitives"], two["primitive_poses"] = two["primitives"] * 2, two["primitive_poses"] * 2
    state = {"attached_collision_objects": [{"link_name": "tool", "object": two}]}
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps({"robot_state": state}))
    space = build_arm_space(read_moveit_scene(path), read_arm(tmp_path))
    assert [each.name for each in space.arm.links][-2:] == ["mug/0", "mug/1"]
    state["attached_collision_objects"][0]["link_name"] = two["header"]["frame_id"] = "hand"
    path.write_text(json.dumps({"robot_state": state}))
    with pytest.raises(InputError, match="link_name of 'mug/0' is 'hand'"):
        build_arm_space(read_moveit_scene(path), read_arm(tmp_path))


def test_the_matrix_replaces_the_pairs_that_may_touch(tmp_path: Path) -> None:
    """Compare every pair with MoveIt's rule for entries and defaults that agree."""
    arm = read_arm(tmp_path)
    names = ["upper", "fore", "left", "right", "base_link", "camera", "table"]
    pairs = [
        ("upper", "fore"),
        ("fore", "left"),
        ("fore", "right"),
        ("left", "right"),
        ("table", "left"),
    ]
    shelf = make_object("table", (1.5, 0.3, 0.75))
    shelf["primitives"], shelf["primitive_poses"] = (
        shelf["primitives"] * 2,
        shelf["primitive_poses"] * 2,
    )
    matrix = make_matrix(names, pairs)
    scene = read_moveit_scene(write_scene(tmp_path, shelf, allowed_collision_matrix=matrix))
    assert scene.may_touch("table/1", "left") and scene.may_touch("left", "table/0")
    assert not scene.may_touch("table/0", "right") and not scene.may_touch("upper", "lamp")
    space = build_arm_space(scene, arm)
    assert space.allowed_collisions == [("left", "table/0"), ("left", "table/1")]
    assert set(space.arm.allowed_collisions) == {
        tuple(sorted(pair)) for pair in pairs[:4]
    }  # not base_link with upper
    box = posed_box((0.2, 0.2, 0.2), 1.5, 0.3, 0.75)
    expected = build_arm_space({"table": box}, arm, allowed_collisions=[("table", "left")])
    assert count_equal(space, expected) > 1
    none = read_moveit_scene(write_scene(tmp_path, shelf, allowed_collision_matrix=make_matrix(())))
    assert build_arm_space(none, arm).arm.allowed_collisions == arm.allowed_collisions


def test_both_entries_of_the_matrix_must_agree(tmp_path: Path) -> None:
    matrix = {"entry_names": ["a", "b"], "entry_values": [[True, True], [False, True]]}
    path = write_scene(tmp_path, make_object("box"), allowed_collision_matrix=matrix)
    scene = read_moveit_scene(path)
    assert not scene.may_touch("a", "b") and not scene.may_touch("b", "a")


@pytest.mark.parametrize(
    "entry, defaults, expected",
    [
        (True, {}, True),
        (False, {}, False),
        (None, {}, False),
        (None, {"a": True}, True),
        (None, {"a": True, "b": True}, True),
        (None, {"a": True, "b": False}, False),
        (False, {"a": True}, False),  # versions of MoveIt differ
        (True, {"b": False}, False),
    ],
)
def test_defaults_and_entries_of_the_matrix_must_agree(
    tmp_path: Path, entry: bool | None, defaults: dict[str, bool], expected: bool
) -> None:
    matrix = make_matrix(
        "ab" if entry is not None else "cd", [("a", "b")] if entry else [], **defaults
    )
    path = write_scene(tmp_path, make_object("box"), allowed_collision_matrix=matrix)
    assert read_moveit_scene(path).may_touch("b", "a") is expected


TWO = {"primitives": [{"type": "box", "dimensions": [0.1] * 3}] * 2, "primitive_poses": [{}, {}]}
"""Two shapes in place of those of an object."""


def carry(link: str, *objects: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Make a state of the robot with attached objects."""
    return {
        "attached_collision_objects": [
            {"link_name": link, "object": each, **more} for each in objects
        ]
    }


@refusals(
    "objects, state, message",
    (
        [make_object("tool")],
        {},
        "has the object 'tool'; the arm has a frame of that name; rename the object",
    ),
    ([make_object("fore")], {}, "has the object 'fore'; the arm has a frame of that name"),
    (
        [],
        carry("tool", make_object("left", **ON_TOOL)),
        "has the object 'left'; the arm has a frame",
    ),
    (
        [make_object("box")],
        carry("hand", make_object("mug", header={"frame_id": "hand"})),
        "link_name of 'mug' is 'hand'",
    ),
    (
        [make_object("box")],
        carry("old", make_object("mug", header={"frame_id": "old"})),
        "link_name of 'mug' is 'old'",
    ),
    (
        [make_object("box")],
        joint_state(STATE | {"lift": 0.5}),
        "has lift at 0.5; the arm holds it at 0.25; pass held_",
    ),
)
def test_scenes_of_another_arm_are_refused(
    tmp_path: Path, objects: list[Any], state: dict[str, Any], message: str
) -> None:
    scene = read_moveit_scene(write_scene(tmp_path, *objects, robot_state=state))
    with pytest.raises(InputError, match=message):
        build_arm_space(scene, read_arm(tmp_path).attach("old", Robot.ball(0.1).shape, "tool"))


def test_a_base_below_the_world_of_a_urdf_is_not_taken_for_it(tmp_path: Path) -> None:
    bar = link("bar", BAR)
    path = write_urdf(
        tmp_path,
        *(link("world"), link("base"), bar),
        joint("mount", "world", "base", at=(0, 0, 1), kind="fixed"),
        joint("turn", "base", "bar"),
    )
    scene = read_moveit_scene(write_scene(tmp_path, make_object("box", (0.5, 0, 1))))
    assert not build_arm_space(scene, Arm.from_urdf(path)).is_free((0.0,))
    for name in ("world", "floor"):  # without a link "world", MoveIt takes the root for it
        path.write_text(path.read_text().replace('"world"', f'"{name}"'))
        with pytest.raises(
            InputError, match="in the frame 'world'; the arm has no such frame; its base is 'base'"
        ):
            build_arm_space(scene, Arm.from_urdf(path, base="base"))
    assert not build_arm_space(scene, Arm.from_urdf(path)).is_free((0.0,))
    pose = np.eye(4)
    pose[2, 3] = 1.0
    assert not build_arm_space(scene, Arm.from_urdf(path, base="base"), base_pose=pose).is_free(
        (0.0,)
    )


@refusals(
    "more, message",
    (
        {"link_scale": [{"link_name": "fore", "scale": 1.1}]},
        r"has 1.1 as link_scale\[0\].scale; it must be 1.0; remove it",
    ),
    (
        {"link_padding": [{"link_name": "fore", "padding": 0.1}]},
        r"has 0.1 as link_padding\[0\].padding; .*, and pass padding= to build_arm_space",
    ),
    (
        {"link_padding": [{"link_name": "fore", "padding": "a"}]},
        r"has 'a' as link_padding\[0\].padding",
    ),
    (
        {"link_padding": [{"name": "fore", "padding": 1}]},
        r"the unknown field 'name' at link_padding\[0\]",
    ),
    (
        {
            "fixed_frame_transforms": [
                {
                    "header": {"frame_id": "map"},
                    "child_frame_id": "world",
                    "transform": {"translation": [0, 0, 1]},
                }
            ]
        },
        r"has a motion as fixed_frame_transforms\[0\].transform; frames are not transformed; remove it",
    ),
    ({"robot_state": {"joints": {}}}, "has the unknown field 'joints' at robot_state"),
    (
        {"robot_state": {"joint_state": {"name": ["a"], "position": []}}},
        "has 1 joints but 0 positions at robot_state",
    ),
    (
        {"robot_state": {"joint_state": {"name": ["a"], "position": [".nan"]}}},
        r"has '.nan' as robot_state.joint_state.position\[0\]; it must be one finite",
    ),
    (
        {"robot_state": joint_state({"a": 1}) | {"joint_state": {"name": ["a", "a"]}}},
        "has 'a' twice in robot_state.joint_state.name",
    ),
    (
        {
            "robot_state": {
                "multi_dof_joint_state": {
                    "joint_names": ["base"],
                    "transforms": [{"translation": [0, 0, 1]}],
                }
            }
        },
        r"has a motion as robot_state.multi_dof_joint_state.transforms\[0\]; .* base_pose=",
    ),
    (
        {
            "robot_state": {
                "attached_collision_objects": [
                    {"link_name": "tool", "object": {"id": "mug", **ON_TOOL}}
                ]
            }
        },
        "has no shape at object 'mug'",
    ),
    (
        {"robot_state": {"attached_collision_objects": [{"object": make_object("mug")}]}},
        r"has None as .*attached_collision_objects\[0\].link_name; it must be a name",
    ),
    (
        {"robot_state": carry("a", make_object("b", operation=1, **ON_TOOL))},
        "has 1 as .*operation; it must be 'add'",
    ),
    (
        {"robot_state": carry("a", make_object("b", **ON_TOOL), make_object("b", **ON_TOOL))},
        "has 'b' twice",
    ),
    (
        {"robot_state": carry("a", make_object("b", operation=True, **ON_TOOL))},
        "has True as .*operation",
    ),
    (
        {"robot_state": carry("a", make_object("b"))},
        r"has no header.frame_id at object 'b'; MoveIt and robowflex would take the frame of",
    ),
    (
        {
            "robot_state": carry(
                "tool", make_object("h", **ON_TOOL) | TWO, make_object("h/0", **ON_TOOL)
            )
        },
        "has 'h/0' twice; ids and names of shapes must differ",
    ),
    (
        {"robot_state": carry("tool", make_object("box", **ON_TOOL) | TWO)},
        "has 'box(/.)?' twice",
    ),
    (
        {"robot_state": carry("tool", {"id": "b", "planes": [{"coef": [0, 0, 1, 0]}], **ON_TOOL})},
        "has .*object.planes; .* a plane has no end; write a box",
    ),
    (
        {"robot_state": carry("a", make_object("b", header={"frame_id": "box"}))},
        "has poses in the frames 'box', 'world'; they must be in one frame",
    ),
    (
        {"robot_state": carry("tool", make_object("b", header={"frame_id": "fore"}))},
        "has poses in the frames 'fore', 'world'; .* may be in its link's frame",
    ),
    (
        {"robot_state": {"is_diff": True}},
        "has True as robot_state.is_diff; it must be False; write the whole state",
    ),
    (
        {"robot_state": {"is_diff": "yes please"}},
        "as robot_state.is_diff; it must be False",
    ),
    (
        {"allowed_collision_matrix": {"entry_names": ["a"]}},
        "has an allowed_collision_matrix of another size than its names",
    ),
    (
        {"allowed_collision_matrix": {"entry_names": ["a"], "entry_values": [["yes please"]]}},
        r"has 'yes please' as allowed_collision_matrix.entry_values\[0\]\[0\]; it must be False or True",
    ),
    (
        {"allowed_collision_matrix": {"default_entry_names": ["a"]}},
        r"has an allowed_collision_matrix of another size",
    ),
)
def test_what_cannot_be_kept_of_a_scene_is_refused(
    tmp_path: Path, more: dict[str, Any], message: str
) -> None:
    path = write_scene(tmp_path, make_object("box"), **more)
    with pytest.raises(FileError, match=message) as caught:
        read_moveit_scene(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def list_tables(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """List the paths to all tables of a message."""
    items = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    return [
        *[path] * isinstance(node, dict),
        *(each for key, value in items for each in list_tables(value, (*path, key))),
    ]


def test_unknown_fields_of_any_table_are_refused(tmp_path: Path) -> None:
    """Those of colors, of the type of an object, and of what moves it after it is detached, have no
    meaning here."""
    at = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    head = {"header": {"seq": 0, "stamp": 0, "frame_id": "map"}}
    motion = {"translation": at["position"], "rotation": at["orientation"]}
    corners = [{"x": x, "y": y, "z": z} for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    every = {
        "id": "all",
        **head,
        "pose": at,
        "primitives": [{"type": 1, "dimensions": [1, 1, 1], "polygon": {"points": []}}],
        "primitive_poses": [at],
        "meshes": [{"triangles": [{"vertex_indices": [0, 1, 2]}], "vertices": corners}],
        "mesh_poses": [at],
        "planes": [],
        "plane_poses": [],
        "subframe_names": [],
        "subframe_poses": [],
        "operation": 0,
    }
    mug = make_object("mug", **head)
    message: dict[str, Any] = {
        "name": "",
        "robot_model_name": "small",
        "is_diff": False,
        "world": {
            "collision_objects": [every],
            "octomap": {
                **head,
                "origin": at,
                "octomap": {**head, "binary": True, "id": "", "resolution": 0, "data": []},
            },
        },
        "robot_state": {
            "joint_state": {**head, "name": [], "position": [], "velocity": [], "effort": []},
            "multi_dof_joint_state": {
                **head,
                "joint_names": ["a"],
                "transforms": [motion],
                "twist": [],
                "wrench": [],
            },
            "attached_collision_objects": [
                {"link_name": "tool", "object": mug, "touch_links": ["fore"], "weight": 1}
            ],
            "is_diff": False,
        },
        "fixed_frame_transforms": [{**head, "child_frame_id": "map", "transform": motion}],
        "allowed_collision_matrix": {
            "entry_names": ["a"],
            "entry_values": [{"enabled": [True]}],
            "default_entry_names": ["a"],
            "default_entry_values": [False],
        },
        "link_padding": [{"link_name": "tool", "padding": 0.0}],
        "link_scale": [{"link_name": "tool", "scale": 1.0}],
    }
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(message))
    read_moveit_scene(path)
    tables = list_tables(message)
    assert len(tables) > 45
    for place in tables:
        changed = json.loads(json.dumps(message))
        reduce(lambda node, key: node[key], place, changed)["zebra"] = 1
        path.write_text(json.dumps(changed))
        with pytest.raises(FileError, match=r"zebra|finite numbers|polygon; it is not read"):
            read_moveit_scene(path)


# ---- requests ------------------------------------------------------------------------------------


def write_request(folder: Path, *goals: Any, **more: Any) -> Path:
    path = folder / "request.yaml"
    request = {
        "group_name": "bars",
        "start_state": joint_state(STATE),
        "goal_constraints": list(goals),
        **more,
    }
    path.write_text(json.dumps(request))
    return path


def joint_goal(**values: Any) -> dict[str, Any]:
    return {
        "joint_constraints": [
            {"joint_name": name, "position": value} for name, value in values.items()
        ]
    }


def pose_goal(
    region: Any = None,
    orientation: Any = None,
    link: str = "tool",
    frame: str = "world",
    **more: Any,
) -> dict[str, Any]:
    """Make a goal from a region, as (type, dimensions, position), and an orientation, as
    (quaternion, tolerances)."""
    head: dict[str, Any] = {"header": {"frame_id": frame}, "link_name": link}
    goal: dict[str, Any] = {}
    if region is not None:
        kind, dimensions, position = region
        pose = {"position": list(map(float, position)), "orientation": SQUARE}
        volume = {
            "primitives": [{"type": kind, "dimensions": list(dimensions)}],
            "primitive_poses": [pose],
        }
        goal["position_constraints"] = [head | {"constraint_region": volume, "weight": 1.0} | more]
    if orientation is not None:
        tolerances = {
            f"absolute_{axis}_axis_tolerance": x
            for axis, x in zip("xyz", orientation[1], strict=True)
        }
        goal["orientation_constraints"] = [
            head | {"orientation": list(map(float, orientation[0]))} | tolerances
        ]
    return goal


ROBOWFLEX = """
start_state:
  joint_state:
    name: [shoulder, lift, elbow]
    position: [0, 0.25, 0.1]
    header:
      frame_id: base_link
workspace_parameters:
  header:
    frame_id: ""
  min_corner: [-1, -1, -1]
  max_corner: [1, 1, 1]
allowed_planning_time: 60
max_velocity_scaling_factor: 0
max_acceleration_scaling_factor: 0
goal_constraints:
  - joint_constraints:
      - joint_name: shoulder
        position: -1.553916788418684
      - position: 0.04659921947761923
        joint_name: elbow
planner_id: BKPIECEGood
group_name: bars
num_planning_attempts: 2
"""
"""The layout of robowflex and MotionBenchMaker, as in robowflex's fetch_box/request0003.yaml."""


def test_requests_of_motion_bench_maker_are_planned(tmp_path: Path) -> None:
    path = tmp_path / "request.yaml"
    path.write_text(ROBOWFLEX)
    request = read_moveit_request(path)
    assert (
        repr(request) == f"MotionPlanRequest({path}: bars, 1 goals)" and request.time_limit == 60.0
    )
    arm = Arm.from_urdf(*write_arm(tmp_path), joints=request.group, held_joints=request.start_state)
    assert arm.held_joints == {"lift": 0.25, "finger": 0.03}
    space = build_arm_space(
        read_moveit_scene(write_scene(tmp_path, make_object("box", (0.5, 1.5, 0.75)))), arm
    )
    plan = planners.plan(
        space, arm.configuration(request.start_state), request.make_goals(arm), seed=0
    )
    assert plan.certified and plan.start.tolist() == [0.0, 0.1]
    assert plan.goal.tolist() == [-1.553916788418684, 0.04659921947761923]


def test_joint_goals_keep_other_joints_and_move_onto_limits(tmp_path: Path) -> None:
    arm = read_arm(tmp_path)
    near = {
        "joint_name": "shoulder",
        "position": 3.05,
        "tolerance_below": 0.1,
        "tolerance_above": 0.0,
    }
    goals = (
        joint_goal(elbow=9.0),
        {"joint_constraints": [near]},
        joint_goal(lift=0.25, shoulder=1, elbow=2),
    )
    made = read_moveit_request(write_request(tmp_path, *goals)).make_goals(arm)
    assert [goal.tolist() for goal in made] == [[0.5, 9.0], [3.0, -0.5], [1.0, 2.0]]
    beyond = read_moveit_request(write_request(tmp_path, joint_goal(shoulder=3.1)))
    with pytest.raises(ConfigurationError, match=r"has shoulder at 3\.1; its limits are -3 and 3"):
        beyond.make_goals(arm)
    for values, message in (
        ({"lift": 0.3}, r"goal_constraints\[0\] has lift at 0.3; the arm holds it at 0.25"),
        ({"wheel": 0.3}, r"goal_constraints\[0\] names 'wheel'"),
        ({"follower": 0.3}, r"goal_constraints\[0\] names 'follower'"),
    ):
        with pytest.raises(InputError, match=message):
            read_moveit_request(write_request(tmp_path, joint_goal(**values))).make_goals(arm)


def test_plans_reach_the_poses_of_a_request(tmp_path: Path) -> None:
    arm = read_arm(tmp_path)
    turn = Rotation.from_euler("z", 1.0)
    at = (math.cos(0.3) + math.cos(1.0), math.sin(0.3) + math.sin(1.0), 0.75)
    path = write_request(
        tmp_path, pose_goal(("sphere", (0.02,), at), (turn.as_quat(), (0.1, 0.1, 3.2)))
    )
    (goal,) = read_moveit_request(path).make_goals(arm)
    assert isinstance(goal, PoseGoal) and goal.tolerance == (0.02, 0.1)
    plan = planners.plan(build_arm_space({}, arm), (0.0, 0.5), [goal], seed=0)
    reached = arm.pose(plan.goal, "tool")
    assert np.linalg.norm(reached[:3, 3] - at) <= 0.02
    assert (turn.inv() * Rotation.from_matrix(reached[:3, :3])).magnitude() <= 0.1


def test_frames_of_pose_goals_are_those_of_the_arm(tmp_path: Path) -> None:
    arm = read_arm(tmp_path)
    for frame, at in (("world", (1, 1, 0.75)), ("stand", (1, 1, 0)), ("base_link", (1, 1, 0.75))):
        path = write_request(tmp_path, pose_goal(("box", (0.1, 0.2, 0.3), at), frame=frame))
        (goal,) = read_moveit_request(path).make_goals(arm)
        np.testing.assert_allclose(goal.pose[:3, 3], (1, 1, 0.75))
        assert goal.tolerance == (0.05, math.inf)
    request = read_moveit_request(
        write_request(tmp_path, pose_goal(("box", (1, 1, 1), (0, 2, 0)), frame="map"))
    )
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_quat(SQUARE).as_matrix(), (5, 0, 0)
    (goal,) = request.make_goals(arm, base_pose=base)
    np.testing.assert_allclose(goal.pose[:3, 3], (2, 5, 0), atol=1e-12)
    for frame, message in (
        ("map", "the arm has no such frame"),
        ("fore", "a joint of the arm moves it"),
    ):
        request = read_moveit_request(
            write_request(tmp_path, pose_goal(("box", (1, 1, 1), (0, 2, 0)), frame=frame))
        )
        with pytest.raises(InputError, match=f"has poses in the frame '{frame}'; {message}"):
            request.make_goals(arm)
    with pytest.raises(InputError, match="link_name is 'hand'"):
        read_moveit_request(
            write_request(tmp_path, pose_goal(("box", (1, 1, 1), (0, 2, 0)), link="hand"))
        ).make_goals(arm)


def satisfies(goal: dict[str, Any], pose: np.ndarray) -> bool:
    """Return True if a pose satisfies the constraints, by the rules of MoveIt's
    kinematic_constraint.cpp."""
    for each in goal.get("position_constraints", ()):
        point = pose[:3, 3]
        volume, inside = each["constraint_region"], False
        for shape, placed in zip(volume["primitives"], volume["primitive_poses"], strict=True):
            x, y, z = (
                Rotation.from_quat(placed["orientation"]).inv().apply(point - placed["position"])
            )
            sizes = shape["dimensions"]
            if shape["type"] == "box":
                inside |= bool((np.abs((x, y, z)) <= np.array(sizes) / 2).all())
            elif shape["type"] == "sphere":
                inside |= math.hypot(x, y, z) <= sizes[0]
            else:
                inside |= abs(z) <= sizes[0] / 2 and math.hypot(x, y) <= sizes[1]
        if not inside:
            return False
    for each in goal.get("orientation_constraints", ()):
        apart = Rotation.from_quat(each["orientation"]).inv() * Rotation.from_matrix(pose[:3, :3])
        angles = apart.as_rotvec() if each.get("parameterization") == 1 else apart.as_euler("XYZ")
        if (np.abs(angles) > [each[f"absolute_{axis}_axis_tolerance"] for axis in "xyz"]).any():
            return False
    return True


TURNS = st.tuples(*[st.floats(-3, 3)] * 3)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(
    kind=st.sampled_from([None, "box", "sphere", "cylinder"]),
    sizes=st.tuples(*[st.floats(0.05, 1.0)] * 3),
    at=TURNS,
    turn=TURNS,
    tolerances=st.none() | st.tuples(*[st.floats(0.01, 4.0)] * 3),
    parameterization=st.integers(0, 1),
    seed=st.integers(0, 2**20),
)
def test_pose_goals_satisfy_the_constraints(
    tmp_path: Path,
    kind: str | None,
    sizes: Any,
    at: Any,
    turn: Any,
    tolerances: Any,
    parameterization: int,
    seed: int,
) -> None:
    """Draw poses up to the tolerance of the goal."""
    region = None if kind is None else (kind, sizes[: {"sphere": 1, "box": 3}.get(kind, 2)], at)
    wanted = (
        None if tolerances is None else (Rotation.from_euler("xyz", turn).as_quat(), tolerances)
    )
    goal = pose_goal(region, wanted)
    for each in goal.get("orientation_constraints", ()):
        each["parameterization"] = parameterization
    try:
        (made,) = read_moveit_request(write_request(tmp_path, goal)).goals
    except FileError as error:
        assert any(reason in str(error) for reason in ("any pose", "0 pose constraints"))
        return
    assert isinstance(made, PoseGoal)
    rng, (distance, angle) = np.random.default_rng(seed), made.tolerance
    for _ in range(40):
        pose = np.array(made.pose)
        step, spin = rng.normal(size=(2, 3))
        share = rng.choice([0.5, 1 - 1e-9], size=2)
        pose[:3, 3] += (
            step / np.linalg.norm(step) * (9.0 if math.isinf(distance) else share[0] * distance)
        )
        spin *= (
            rng.uniform(0, math.pi) if math.isinf(angle) else share[1] * angle
        ) / np.linalg.norm(spin)
        pose[:3, :3] = Rotation.from_rotvec(spin).as_matrix() @ pose[:3, :3]
        assert satisfies(goal, pose)


SPHERE = ("sphere", (0.1,), (1, 0, 0))
EASY = ((0, 0, 0, 1), (0.1, 0.1, 0.1))


@refusals(
    "goals, more, message",
    ([], {}, "has no goal_constraints; a request has at least one"),
    (
        [joint_goal(elbow=1)],
        {"path_constraints": joint_goal(elbow=1)},
        "has path_constraints; it is not read; remove it; plans would not obey it",
    ),
    (
        [joint_goal(elbow=1)],
        {"trajectory_constraints": {"constraints": [joint_goal(elbow=1)]}},
        "has trajectory_constraints; it is not read",
    ),
    ([joint_goal(elbow=1)], {"goal": 1}, "has the unknown field 'goal' at the top"),
    ([joint_goal(elbow=1)], {"planning_options": {}}, "has the unknown field 'planning_options'"),
    ([joint_goal(elbow=1)], {"group_name": [1]}, r"has \[1\] as group_name"),
    ([joint_goal(elbow=1)], {"allowed_planning_time": "a"}, "has 'a' as allowed_planning_time"),
    (
        [joint_goal(elbow=1)],
        {"start_state": {"attached_collision_objects": [{"link_name": "a"}]}},
        "has start_state.attached_collision_objects; it is not read",
    ),
    (
        [joint_goal(elbow=1) | pose_goal(SPHERE)],
        {},
        r"has 1 joint and 1 pose constraints at goal_constraints\[0\]",
    ),
    ([{}], {}, "has 0 joint and 0 pose constraints"),
    ([{"visibility_constraints": [{}]}], {}, "has .*visibility_constraints; it is not read"),
    ([{"joint_goals": [{}]}], {}, r"has the unknown field 'joint_goals' at goal_constraints\[0\]"),
    ([joint_goal(elbow=None)], {}, r"has None as .*joint_constraints\[0\].position"),
    ([{"joint_constraints": [{"position": 1}]}], {}, "has None as .*joint_name"),
    (
        [{"joint_constraints": [{"joint_name": "a", "position": 1, "tolerance_below": -1}]}],
        {},
        "has -1 as .*tolerance_below; it may not be negative",
    ),
    (
        [{"position_constraints": pose_goal(SPHERE)["position_constraints"] * 2}],
        {},
        "has 2 constraints of tool at",
    ),
    (
        [pose_goal(SPHERE) | pose_goal(None, EASY, link="fore")],
        {},
        "has 2 constraints of fore, tool at goal",
    ),
    (
        [pose_goal(SPHERE), pose_goal(SPHERE, frame="map")],
        {},
        "has poses in the frames 'map', 'world'",
    ),
    (
        [pose_goal(("cone", (1, 1), (0, 0, 0)))],
        {},
        r"has 'cone' as region of goal_constraints\[0\]; it must be one of box, sphere, cylinder",
    ),
    ([pose_goal(("prism", (1, 1), (0, 0, 0)))], {}, "has 'prism' as .*type"),
    (
        [pose_goal(SPHERE, target_point_offset=[1, 0, 0])],
        {},
        "has .*target_point_offset; it is not read",
    ),
    (
        [pose_goal(None, ((0, 0, 0, 1), (0.1, 0, 1)))],
        {},
        "has a tolerance of zero at goal",
    ),
    ([pose_goal(None, ((0, 0, 0, 1), (4, 4, 4)))], {}, "has tolerances beyond half a turn"),
    (
        [pose_goal(SPHERE, constraint_region={"meshes": [{}]})],
        {},
        "has .*constraint_region.meshes; it is not read",
    ),
    ([pose_goal(SPHERE, constraint_region={})], {}, "has 'nothing' as region of goal"),
    ([pose_goal(SPHERE, link="")], {}, "has '' as .*link_name"),
)
def test_what_a_plan_would_not_obey_is_refused(
    tmp_path: Path, goals: list[Any], more: dict[str, Any], message: str
) -> None:
    path = write_request(tmp_path, *goals, **more)
    with pytest.raises(FileError, match=message) as caught:
        read_moveit_request(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)

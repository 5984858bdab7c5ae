"""Arms from URDF files, against yourdfpy and pinocchio."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yourdfpy

from cspace import MeshWarning, Robot
from cspace.arms import Arm, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, FileError, InputError
from cspace.shapes import Mesh
from tests.helpers.refusals import refusals
from tests.helpers.urdfs import joint, link, planar, pose_at, posed_box, random_arm, write_urdf

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))


@pytest.mark.parametrize("seed", range(4))
def test_frames_stand_where_yourdfpy_places_them(tmp_path: Path, seed: int) -> None:
    """Include all kinds of joints, a mimic joint, and links without geometry."""
    path = random_arm(tmp_path, seed)
    bare = (
        link("tool0"),
        joint("mount", "l4", "tool0", at=(0.1, 0.2, 0.3), rpy=(0.4, 0.5, 0.6), kind="fixed"),
    )
    path.write_text(path.read_text().replace("</robot>", f"{''.join(bare)}</robot>"))
    arm = Arm.from_urdf(path)
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert list(arm.joints) == urdf.actuated_joint_names
    assert set(arm.frames) == set(urdf.link_map)
    for q in np.random.default_rng(seed).uniform(-0.4, 0.7, (5, arm.dof)):
        urdf.update_cfg(q)
        for name, pose in arm.poses(q).items():
            np.testing.assert_allclose(pose, urdf.get_transform(name), atol=1e-9)
            np.testing.assert_array_equal(arm.pose(q, name), pose)


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_poses_and_joint_order_agree_with_pinocchio(data: Path, name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    urdf = data / "arms" / name / f"{name}.urdf"
    model = pin.buildModelFromUrdf(str(urdf), mimic=True)
    arm, state = Arm.from_urdf(urdf), model.createData()
    assert arm.joints == tuple(each for each in list(model.names)[1:] if each in arm.joints)
    q = np.random.default_rng(0).uniform(*arm.ranges(), (2, 3, arm.dof))
    poses = {frame: arm.pose(q, frame) for frame in arm.frames}
    indices = [model.joints[model.getJointId(each)].idx_q for each in arm.joints]
    for row in np.ndindex(2, 3):
        theirs = pin.neutral(model)
        theirs[indices] = q[row]
        pin.framesForwardKinematics(model, state, theirs)
        for frame, pose in poses.items():
            np.testing.assert_allclose(
                pose[row], state.oMf[model.getFrameId(frame)].homogeneous, atol=1e-9
            )


def test_joints_are_ordered_depth_first_and_branches_by_name(tmp_path: Path) -> None:
    path = write_urdf(
        tmp_path,
        *(link(name, BAR) for name in "abcdef"),
        joint("right_1", "a", "b"),
        joint("left_1", "a", "c"),
        joint("right_2", "b", "d"),
        joint("left_3", "c", "f"),
        joint("left_2", "c", "e"),
    )
    assert Arm.from_urdf(path).joints == ("left_1", "left_2", "left_3", "right_1", "right_2")


def test_poses_of_a_batch_are_those_of_its_rows(tmp_path: Path) -> None:
    """Use enough configurations for several threads."""
    arm = Arm.from_urdf(random_arm(tmp_path, 5))
    q = np.random.default_rng(5).uniform(-0.4, 0.7, (3, 2000, arm.dof))
    poses = arm.pose(q, "l4")
    assert poses.shape == (3, 2000, 4, 4)
    for row in np.ndindex(3, 20):
        np.testing.assert_array_equal(poses[row], arm.pose(q[row], "l4"))
    assert arm.pose(q[:0], "l4").shape == (0, 2000, 4, 4)


def test_only_joints_between_base_and_tip_move(tmp_path: Path) -> None:
    """Hold other joints at zero or their nearest limit."""
    path = write_urdf(
        tmp_path,
        *(link(name, BAR) for name in "abcd"),
        joint("one", "a", "b", at=(1, 0, 0)),
        joint("two", "b", "c", at=(1, 0, 0), limits=(0.5, 1.0)),
        joint("three", "b", "d", at=(1, 0, 0), kind="prismatic", axis=(0, 0, 2)),
    )
    assert Arm.from_urdf(path).joints == ("one", "three", "two")
    arm = Arm.from_urdf(path, tip="d")
    assert arm.joints == ("one", "three")
    np.testing.assert_allclose(arm.poses((0.0, 0.2))["d"][:3, 3], (2, 0, 0.2))
    # A link on a held joint belongs to the body of its parent.
    assert {each.name: each.body for each in arm.links} == {"a": 0, "b": 1, "c": 1, "d": 2}
    only = Arm.from_urdf(path, base="b", tip="c")
    assert [each.name for each in only.links] == ["b", "d", "c"]
    assert only.lower.tolist() == [0.5]


def test_pickled_arm_keeps_its_hulls(tmp_path: Path) -> None:
    part = Arm.from_urdf(planar(tmp_path)).links[0].parts[0]
    made = part.hulls
    kept = pickle.loads(pickle.dumps(part)).__dict__["hulls"]
    np.testing.assert_array_equal(kept.corners, made.corners)


def test_neighbours_may_touch_unless_an_srdf_lists_pairs(tmp_path: Path) -> None:
    """Include links connected over a link without geometry."""
    path = write_urdf(
        tmp_path,
        link("a", BAR),
        link("bare"),
        link("b", BAR),
        link("c", BAR),
        joint("one", "a", "bare"),
        joint("two", "bare", "b", axis=(1, 0, 0)),
        joint("three", "b", "c", at=(1, 0, 0)),
    )
    assert Arm.from_urdf(path).allowed_collisions == {
        ("a", "b"): "adjacent",
        ("b", "c"): "adjacent",
    }
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(
        '<robot name="small"><disable_collisions link1="c" link2="a" reason="Never"/></robot>'
    )
    assert Arm.from_urdf(path, srdf).allowed_collisions == {("a", "c"): "Never"}
    srdf.write_text(
        '<robot name="small"><group name="all"><chain base_link="a" tip_link="c"/></group>'
        '<disable_default_collisions link="b"/><enable_collisions link1="b" link2="c"/></robot>'
    )
    assert Arm.from_urdf(path, srdf).allowed_collisions.keys() == {("a", "b")}


def test_srdf_names_of_missing_and_bare_links_are_skipped_with_one_warning(tmp_path: Path) -> None:
    path = write_urdf(
        tmp_path,
        *(link(name, BAR) for name in "ab"),
        link("bare"),
        joint("one", "a", "b"),
        joint("two", "b", "bare"),
    )
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(
        """<robot name="small"><virtual_joint name="world" type="planar" parent_frame="map" child_link="a"/>
        <disable_collisions link1="a" link2="bellows"/><disable_collisions link1="lost" link2="b"/>
        <disable_collisions link1="a" link2="bare"/><disable_collisions link1="b" link2="a"/>
        <disable_default_collisions link="bellows"/><enable_collisions link1="a" link2="bellows"/>
        <group name="g"><link name="gone"/><joint name="two"/><joint name="world"/></group>
        <group_state name="s" group="g"><joint name="three" value="1"/><joint name="world" value="0 0 0"/></group_state>
        <group_state name="other" group="g"><joint name="three" value="1"/></group_state>
        <group_state name="alone"><joint name="two" value="1"/></group_state>
        </robot>"""
    )
    with pytest.warns(
        UserWarning, match=r"bellows, lost, gone, three, which the URDF.* bare, without coll"
    ) as heard:
        arm = Arm.from_urdf(path, srdf)
    assert [each.filename for each in heard] == [__file__]
    assert arm.allowed_collisions == {("a", "b"): "SRDF"}
    assert arm.groups == {"g": ("two",)}
    assert {name: q.tolist() for name, q in arm.named_configurations.items()} == {
        "g/s": [0, 0],
        "alone": [0, 1],
    }


def test_srdf_groups_states_and_end_effectors_are_read(tmp_path: Path) -> None:
    """Read states of two groups with one name."""
    path = write_urdf(
        tmp_path,
        *(link(name, BAR) for name in "abcdef"),
        joint("one", "a", "b"),
        joint("two", "b", "c", limits=(0.5, 1.0)),
        joint("three", "c", "d", kind="continuous", limits=None),
        joint("mount", "c", "e", kind="fixed"),
        joint("four", "e", "f", kind="prismatic", extra='<mimic joint="one"/>'),
    )
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(
        """<robot name="small"><group name="arm"><chain base_link="a" tip_link="c"/></group>
        <group name="hand"><link name="d"/><link name="f"/></group>
        <group name="branch"><chain base_link="d" tip_link="e"/></group>
        <group name="all"><group name="hand"/><group name="arm"/></group><group name="none"/>
        <group_state name="home" group="arm"><joint name="two" value="0.75"/></group_state>
        <group_state name="home" group="hand">
          <joint name="three" value="-4"/><joint name="four" value="9"/></group_state>
        <end_effector name="gripper" parent_link="c" group="hand" parent_group="arm"/>
        <end_effector name="camera" parent_link="b" group="none"/></robot>"""
    )
    arm = Arm.from_urdf(path, srdf)
    assert arm.joints == ("one", "two", "three")
    assert arm.groups == {
        "arm": ("one", "two"),
        "hand": ("three",),
        "branch": ("three",),
        "all": ("one", "two", "three"),
        "none": (),
    }
    named = {name: q.tolist() for name, q in arm.named_configurations.items()}
    assert named == {"arm/home": [0.0, 0.75, 0.0], "hand/home": [0.0, 0.5, -4.0]}
    assert arm.end_effectors == {"gripper": ("c", "hand", "arm"), "camera": ("b", "none", "")}
    only = Arm.from_urdf(path, srdf, tip="b")
    assert (only.groups["all"], only.named_configurations["arm/home"].tolist()) == (("one",), [0.0])
    bare = Arm.from_urdf(path)
    assert bare.groups == bare.named_configurations == bare.end_effectors == {}


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_named_configurations_agree_with_pinocchio(data: Path, name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    urdf, srdf = (data / "arms" / name / f"{name}.{suffix}" for suffix in ("urdf", "srdf"))
    model = pin.buildModelFromUrdf(str(urdf))
    pin.loadReferenceConfigurations(model, str(srdf), False)
    arm = Arm.from_urdf(urdf, srdf)
    assert {key.partition("/")[2] for key in arm.named_configurations} == {
        each.key() for each in model.referenceConfigurations
    }
    for key, q in arm.named_configurations.items():
        group, _, state = key.partition("/")
        theirs = model.referenceConfigurations[state]
        for joint_name in arm.groups[group]:
            assert (
                q[arm.joints.index(joint_name)]
                == theirs[model.joints[model.getJointId(joint_name)].idx_q]
            )


def test_pairs_are_sorted_into_always_sometimes_and_never(tmp_path: Path) -> None:
    """Include distant links whose bodies are adjacent."""
    path = write_urdf(
        tmp_path,
        link("base", BAR),
        link("sleeve", ((1.0, 0.3, 0.3), (0.5, 0, 0))),
        link("core", ((3.5, 0.05, 0.05), (0, 0, 0))),
        link("lamp", ((0.1, 0.1, 0.1), (0, 0, 5))),
        link("hook", ((0.1, 0.1, 0.1), (-0.5, 0.3, 0))),
        joint("swing", "base", "sleeve", at=(1, 0, 0)),
        joint("spin", "sleeve", "core", at=(0, 0, 0), axis=(1, 0, 0)),
        joint("mount", "core", "lamp", kind="fixed"),
        joint("other", "sleeve", "hook", kind="fixed"),
    )
    arm = Arm.from_urdf(path)
    assert arm.allowed_collisions == {
        ("base", "sleeve"): "adjacent",
        ("core", "sleeve"): "adjacent",
        ("hook", "sleeve"): "one body",
        ("core", "lamp"): "one body",
        ("base", "core"): "always",
    }
    assert arm.pairs == arm.allowed_collisions | {
        ("base", "hook"): "sometimes",
        ("base", "lamp"): "never",
        ("core", "hook"): "never",
        ("hook", "lamp"): "never",
        ("lamp", "sleeve"): "never",
    }
    # If the SRDF forgets a pair that always touches, no configuration is free.
    srdf = tmp_path / "arm.srdf"
    srdf.write_text('<robot name="small"><disable_collisions link1="base" link2="core"/></robot>')
    forgotten = Arm.from_urdf(path, srdf)
    assert forgotten.pairs["core", "sleeve"] == "always"
    message = r"touches 'sleeve'.*in 1000 random configurations.*allowed_collisions=\[\('core', 'sleeve'\)\]"
    with pytest.raises(ConfigurationError, match=message):
        build_arm_space({}, forgotten, allowed_collisions=[("base", "sleeve")])
    known = build_arm_space(
        {}, forgotten, allowed_collisions=[("base", "sleeve"), ("core", "sleeve")]
    )
    assert known.is_free((0.0, 0.0))
    assert not known.is_free((0.54, 0.0))


def test_meshes_of_packages_are_found_in_given_folders(tmp_path: Path) -> None:
    mesh = tmp_path / "ws" / "arm" / "meshes" / "bar.stl"
    mesh.parent.mkdir(parents=True)
    trimesh.creation.box((2.0, 0.1, 0.1)).export(mesh)
    (tmp_path / "urdf").mkdir()
    extra = '<collision><geometry><mesh filename="package://arm/meshes/bar.stl"/></geometry></collision>'
    path = write_urdf(
        tmp_path / "urdf", link("a", BAR), link("b", extra=extra), joint("one", "a", "b")
    )
    with pytest.raises(FileError, match=r"pass package_dirs=FOLDER"):
        Arm.from_urdf(path)
    arm = Arm.from_urdf(path, package_dirs=tmp_path / "ws")
    np.testing.assert_allclose(
        arm.links[1].parts[0].shape.outer.bounds[1], (1.0, 0.05, 0.05), atol=1e-6
    )
    assert [
        link.name for link in Arm.from_urdf(path, package_dirs=[str(tmp_path / "ws")]).links
    ] == ["a", "b"]


OPEN_MESH = '<collision><geometry><mesh filename="open.stl"/></geometry></collision>'


def write_arm_with_open_mesh(folder: Path) -> Path:
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(folder / "open.stl")
    return write_urdf(folder, link("a", BAR), link("b", extra=OPEN_MESH), joint("one", "a", "b"))


def test_warnings_of_open_meshes_name_an_option_that_the_caller_takes(tmp_path: Path) -> None:
    path = write_arm_with_open_mesh(tmp_path)
    with pytest.warns(MeshWarning, match=r"link 'b', collision 0 are open") as heard:
        Arm.from_urdf(path)
    assert [each.filename for each in heard] == [__file__]
    assert "pass solid='surface'" in str(heard[0].message) and "fill" not in str(heard[0].message)
    arm = Arm.from_urdf(path, solid="surface")  # warns of nothing
    ball = {"ball": Robot.ball(0.05).shape}
    assert build_arm_space(ball, arm, allowed_collisions=[("a", "ball")]).is_free((0.0,))
    options: Any = {"solid": "fill"}
    with pytest.raises(InputError, match=r"solid is 'fill'.*must be 'auto' or 'surface'"):
        Arm.from_urdf(path, **options)
    with pytest.warns(MeshWarning, match=r"pass solid='surface' .*, or solid='fill'") as heard:
        Robot.from_urdf(path, "b")
    assert [each.filename for each in heard] == [__file__]


def test_warnings_of_open_shapes_name_what_makes_surfaces_of_them(tmp_path: Path) -> None:
    """Test functions without an option ``solid``."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    arm = Arm.from_urdf(planar(tmp_path))
    may = [("foot", "tool"), ("upper", "tool")]
    for call in (
        lambda: arm.attach("tool", open_box, "fore"),
        lambda: build_arm_space({"tool": open_box}, arm, allowed_collisions=may),
    ):
        with pytest.warns(
            MeshWarning, match=r"pass cspace.Mesh.of\(mesh, solid='surface'\)"
        ) as heard:
            call()
        assert [each.filename for each in heard] == [__file__]
    arm.attach("tool", Mesh.of(open_box, solid="surface"), "fore")


def test_boxes_keep_their_inside_when_meshes_are_surfaces(tmp_path: Path) -> None:
    path = write_urdf(
        tmp_path,
        link("a", BAR),
        link("b", ((2, 2, 2), (9, 0, 0))),
        joint("one", "a", "b", limits=(-0.01, 0.01)),
    )
    inside = PosedShape(
        Robot.ball(0.1).shape, np.array([[1, 0, 0, 9], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    )
    for solid in ("auto", "surface"):
        options: Any = {"solid": solid}
        with pytest.raises(ConfigurationError, match="b touches 'ball'"):
            build_arm_space({"ball": inside}, Arm.from_urdf(path, **options))


def write_chain(folder: Path, leader: str) -> Path:
    """Write an arm of three joints; the second mimics ``leader``."""
    mimics = ["", f'<mimic joint="{leader}"/>', '<mimic joint="one"/>' if leader == "three" else ""]
    joints = zip(("one", "two", "three"), "abc", "bcd", mimics, strict=True)
    links = (link(name, BAR) for name in "abcd")
    return write_urdf(
        folder, *links, *(joint(name, a, b, extra=mimic) for name, a, b, mimic in joints)
    )


def write_rack(folder: Path, factor: float) -> Path:
    """Write a pinion that turns without end, and a rack that slides by ``factor`` metres for each
    radian of it."""
    mimic = f'<mimic joint="pinion" multiplier="{factor}" offset="0.3"/>'
    return write_urdf(
        folder,
        *(link(name, BAR) for name in "abc"),
        joint("pinion", "a", "b", at=(0, 0, 1), kind="continuous", limits=None),
        joint("rack", "a", "c", axis=(1, 0, 0), kind="prismatic", limits=(-1, 1), extra=mimic),
    )


def write_arm_with_mesh(folder: Path) -> Path:
    mesh = '<collision><geometry><mesh filename="package://arm/meshes/lost.stl"/></geometry></collision>'
    return write_urdf(folder, link("a", BAR), link("b", extra=mesh), joint("one", "a", "b"))


@refusals(
    "write, options, error, message",
    (planar, {"tip": "hand"}, InputError, r"is 'hand'.*there are foot, upper, fore"),
    (planar, {"base": "hand"}, InputError, r"base is 'hand'"),
    (planar, {"base": "fore", "tip": "foot"}, InputError, "is not below"),
    (planar, {"base": "fore"}, InputError, "no joint that moves"),
    (planar, {"limits": (1.0, -1.0)}, InputError, "limits are 1 and -1"),
    (planar, {"limits": None}, InputError, "has no limits"),
    (planar, {"kind": "floating"}, InputError, "is 'floating'; there are fixed"),
    (planar, {"axis": (0, 0, 0)}, FileError, "axis '0.0 0.0 0.0' at the joint 'shoulder'"),
    (
        planar,
        {"axis": (0, 1)},
        FileError,
        "has xyz='0.0 1.0' at the axis of joint 'shoulder'; it must be 3 numbers",
    ),
    (
        planar,
        {"extra": '<limit lower="low" upper="1"/>', "limits": None},
        FileError,
        "has lower='low' at the limit of joint 'shoulder'",
    ),
    (
        planar,
        {"extra": '<mimic joint="lost"/>', "tip": "upper"},  # no other joint moves there
        InputError,
        "joint 'shoulder' mimics 'lost'; there are elbow",
    ),
    (
        write_chain,
        {"leader": "lost"},
        InputError,
        "joint 'two' mimics 'lost'; there are one, three",
    ),
    (
        write_chain,
        {"leader": "one", "base": "b"},
        InputError,
        "mimics 'one'; there are three",
    ),
    (
        write_chain,
        {"leader": "three"},
        InputError,
        "mimics 'three'; there are one",
    ),
    (
        write_rack,
        {"factor": 0.01},
        InputError,
        "joint 'rack' mimics 'pinion'; a prismatic joint would slide without end",
    ),
    (
        write_arm_with_mesh,
        {},
        FileError,
        "link 'b', collision 0: mesh package://arm/meshes/lost.stl: does not exist",
    ),
    (
        lambda folder: write_urdf(folder, link("a"), link("b"), joint("one", "a", "b")),
        {},
        InputError,
        "no collision geom",
    ),
)
def test_from_urdf_refuses_invalid_files_and_links(
    tmp_path: Path, write: Any, options: dict[str, Any], error: Any, message: str
) -> None:
    ends = {name: options[name] for name in ("base", "tip") if name in options}
    path = write(tmp_path, **{name: value for name, value in options.items() if name not in ends})
    with pytest.raises(error, match=message):
        Arm.from_urdf(path, **ends)


def test_a_rack_may_mimic_a_pinion_that_does_not_move_it(tmp_path: Path) -> None:
    """A factor of zero, or a pinion that is held, leaves the rack where it is."""
    still = Arm.from_urdf(write_rack(tmp_path, 0.0))
    space = build_arm_space({"box": posed_box((0.2, 0.2, 0.2), 0.8, 0.5, 1.0)}, still)
    assert still.whole_turns.all() and np.isfinite(still.chain.lengths).all()
    assert space.is_free((0.0,)) and not space.is_free((0.5,))
    np.testing.assert_allclose(still.pose((7.0,), "c")[:3, 3], (0.3, 0, 0))
    path = write_rack(tmp_path, 0.01)
    path.write_text(
        path.read_text().replace("</robot>", link("d", BAR) + joint("arm", "a", "d") + "</robot>")
    )
    held = Arm.from_urdf(path, joints=["arm"], held_joints={"pinion": 20.0})
    np.testing.assert_allclose(held.pose((0.0,), "c")[:3, 3], (0.5, 0, 0))


def test_joint_may_mimic_a_later_one(tmp_path: Path) -> None:
    assert Arm.from_urdf(planar(tmp_path, extra='<mimic joint="elbow"/>')).joints == ("elbow",)


@refusals(
    "text, message",
    (
        '<robot name="small"><disable_collisions link1="foot"/></robot>',
        "has a <disable_collisions> without link2",
    ),
    ('<robot name="small"><group/></robot>', "has a <group> without name"),
    (
        '<robot name="small"><group name="g"><group name="g"/></group></robot>',
        "has the group 'g' within itself",
    ),
    (
        '<robot><group_state name="s" group="g"><joint name="elbow" value="up"/></group_state></robot>',
        "has elbow at 'up' in the state 'g/s'; it must be one finite number",
    ),
    ('<robot xmlns:x="http://www.ros.org/wiki/xacro"><x:if/></robot>', "xacro macros"),
    ("<html/>", "holds <html>, not <robot>"),
    ("<robot", "arm.srdf"),
)
def test_from_urdf_refuses_invalid_srdf_files(tmp_path: Path, text: str, message: str) -> None:
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(text)
    with pytest.raises(FileError, match=message):
        Arm.from_urdf(planar(tmp_path), srdf)


BALL = Robot.ball(0.1)


@refusals(
    "arguments, message",
    (("tool", None, "fore"), "shape is a NoneType"),
    (("tool", 5, "fore"), "shape is a int"),
    (("tool", "no such text", "fore"), "shape is 'no such text'"),
    (("tool", np.zeros((3, 3)), "fore"), "shape is points"),
    (("tool", Robot.disc(1.0), "fore"), "shape is in the plane; arms are in space"),
    (("tool", trimesh.Trimesh(), "fore"), "without triangles"),
    (("tool", (np.eye(3), [[0, 1, 5]]), "fore"), "name vertex 5"),
    (("tool", lambda: None, "fore"), "shape is a function"),
    (("fore", BALL, "upper"), "a link has it"),
    (("tool", BALL, "wing"), "is 'wing'"),
    (("tool", BALL, "fore", 2.0 * np.eye(4)), "rigid motion"),
    (("tool", BALL, "fore", None, 5), "touch_links is 5; it must be a list of names"),
    ((5, BALL, "fore"), "name is 5; it must be a non-empty string"),
)
def test_attach_refuses_invalid_arguments(
    tmp_path: Path, arguments: tuple[Any, ...], message: str
) -> None:
    *given, touch = (*arguments, ()) if len(arguments) < 5 else arguments
    with pytest.raises(InputError, match=message):
        Arm.from_urdf(planar(tmp_path)).attach(*given, touch_links=touch)


def test_attach_takes_frames_without_geometry_and_adds_a_frame(tmp_path: Path) -> None:
    path = planar(tmp_path)
    bare = (
        link("tool0"),
        joint("mount", "fore", "tool0", at=(1, 0, 0), rpy=(0, 0, 0.5), kind="fixed"),
    )
    path.write_text(path.read_text().replace("</robot>", f"{''.join(bare)}</robot>"))
    arm = Arm.from_urdf(path)
    held = arm.attach("ball", BALL, "tool0", pose_at(0.2, 0.0), touch_links="upper")
    q = np.array((0.3, -0.7))
    np.testing.assert_allclose(
        held.pose(q, "ball"), arm.pose(q, "tool0") @ pose_at(0.2, 0.0), atol=1e-12
    )
    assert held.allowed_collisions == arm.allowed_collisions | {("ball", "upper"): "held"}
    assert (held.frames, "ball" in arm.frames) == ((*arm.frames, "ball"), False)
    # The ball is where its frame is: it touches a post there, and no other.
    center = held.pose(q, "ball")[:3, 3]
    for offset, free in ((0.0, False), (0.3, True)):
        space = build_arm_space({"post": posed_box((0.1, 0.1, 0.1), *center + offset)}, held)
        assert bool(space.is_free(q)) is free
    stacked = held.attach("lid", BALL, "ball", pose_at(0.0, 0.1))
    np.testing.assert_allclose(
        stacked.pose(q, "lid"), held.pose(q, "ball") @ pose_at(0.0, 0.1), atol=1e-12
    )


@refusals(
    "q, frame, message",
    ((0.0, 0.0), "wing", "frame is 'wing'; there are foot, upper, fore"),
    ((0.0, 0.0), 3, "frame is 3; there are"),
    (
        (0.0,),
        "fore",
        r"q has shape \(1,\); the last axis must hold one number for each of shoulder, elbow",
    ),
    ((0.0, np.nan), "fore", r"q\[1\] is nan; it must be finite"),
)
def test_pose_refuses_invalid_arguments(tmp_path: Path, q: Any, frame: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Arm.from_urdf(planar(tmp_path)).pose(q, frame)


JOINTS = ("one", "two", "three")
"""The joints that move of :func:`write_arm_with_states`."""


def write_arm_with_states(folder: Path) -> tuple[Path, Path]:
    """Write an arm with a hand; both have a state "home"."""
    path = write_urdf(
        folder,
        *(link(name, BAR) for name in "abcde"),
        joint("one", "a", "b"),
        joint("two", "b", "c", limits=(0.5, 1.0)),
        joint("three", "c", "d", kind="prismatic", limits=(0.0, 0.04)),
        joint("four", "c", "e", kind="prismatic", extra='<mimic joint="three"/>'),
    )
    srdf = folder / "arm.srdf"
    srdf.write_text(
        """<robot name="small"><group name="arm"><chain base_link="a" tip_link="c"/></group>
        <group name="hand"><joint name="three"/><joint name="four"/></group>
        <group_state name="home" group="arm"><joint name="one" value="0.2"/><joint name="two" value="0.7"/>
        </group_state><group_state name="home" group="hand"><joint name="three" value="0.01"/></group_state>
        <group_state name="open" group="hand"><joint name="three" value="0.04"/></group_state></robot>"""
    )
    return path, srdf


@pytest.mark.parametrize(
    "values, base, expected",
    [
        (None, None, (0.0, 0.5, 0.0)),
        ({"three": 0.02}, None, (0.0, 0.5, 0.02)),
        ({"two": 0.6, "one": -1}, (0.1, 0.9, 0.03), (-1.0, 0.6, 0.03)),
        ("arm/home", None, (0.2, 0.7, 0.0)),
        ("open", None, (0.0, 0.5, 0.04)),
        ("open", "arm/home", (0.2, 0.7, 0.04)),
        ({"one": 1.0}, "arm/home", (1.0, 0.7, 0.0)),
        ("open", (1.0, 0.9, 0.0), (1.0, 0.9, 0.04)),
    ],
)
def test_configurations_have_named_joints_at_their_values(
    tmp_path: Path, values: Any, base: Any, expected: tuple[float, ...]
) -> None:
    arm = Arm.from_urdf(*write_arm_with_states(tmp_path))
    assert arm.joints == JOINTS
    assert arm.configuration(values, base).tolist() == list(expected)


@refusals(
    "values, base, error, message",
    ({"five": 1.0}, None, InputError, "values names 'five'; there are one, two, three"),
    ({"four": 0.0}, None, InputError, "values names 'four'; there are one, two, three"),
    ({"one": "up"}, None, InputError, r"values\['one'\] is 'up'; it must be numeric"),
    (
        {"one": (1.0, 2.0)},
        None,
        InputError,
        r"values\['one'\] has shape \(2,\); a joint has one number",
    ),
    ({"one": np.inf}, None, InputError, r"values\['one'\] is inf; it must be finite"),
    ({"two": 1.5}, None, ConfigurationError, "values has two at 1.5; its limits are 0.5 and 1"),
    (None, (0.0, 0.0, 0.0), ConfigurationError, "base has two at 0; its limits are 0.5 and 1"),
    (None, (0.0, 0.0), InputError, r"base has shape \(2,\); the last axis must hold one number"),
    (None, np.zeros((1, 3)), InputError, r"base has shape \(1, 3\); it must be one configuration"),
    (
        (0.0, 0.5, 0.0),
        None,
        InputError,
        "it must map names of joints to numbers; pass e.g. {'one': 0.0}",
    ),
    (
        "home",
        None,
        InputError,
        "values is 'home'; there are arm/home, hand/home; did you mean",
    ),
    (
        "closed",
        None,
        InputError,
        "values is 'closed'; there are arm/home, hand/home, hand/open",
    ),
    (None, "closed", InputError, "base is 'closed'; there are arm/home"),
)
def test_configuration_refuses_unknown_names_and_values_beyond_limits(
    tmp_path: Path, values: Any, base: Any, error: Any, message: str
) -> None:
    arm = Arm.from_urdf(*write_arm_with_states(tmp_path))
    with pytest.raises(error, match=message):
        arm.configuration(values, base)


def test_configuration_without_srdf_says_that_there_are_no_states(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"values is 'home'; the arm has none; pass srdf= to Arm.from_urdf"
    ):
        Arm.from_urdf(planar(tmp_path)).configuration("home")


def test_joints_of_a_group_move_and_others_are_held_at_their_values(tmp_path: Path) -> None:
    path, srdf = write_arm_with_states(tmp_path)
    whole = Arm.from_urdf(path, srdf)
    arm = Arm.from_urdf(path, srdf, joints="arm", held_joints={"three": 0.03})
    assert arm.joints == ("one", "two")
    # Joint four mimics the held joint three.
    for frame, pose in arm.poses((0.4, 0.6)).items():
        np.testing.assert_allclose(pose, whole.pose((0.4, 0.6, 0.03), frame), atol=1e-12)
    assert arm.configuration("home").tolist() == [0.2, 0.7]
    hand = Arm.from_urdf(path, srdf, joints="hand")
    assert hand.joints == ("three",)
    np.testing.assert_allclose(
        hand.pose((0.02,), "e"), whole.pose((0.0, 0.5, 0.02), "e"), atol=1e-12
    )
    chosen = Arm.from_urdf(path, joints=["three", "one"], held_joints={"two": 0.9})
    assert chosen.joints == ("one", "three")
    np.testing.assert_allclose(
        chosen.pose((0.1, 0.02), "d"), whole.pose((0.1, 0.9, 0.02), "d"), atol=1e-12
    )


@refusals(
    "options, message",
    ({"joints": "leg"}, "joints is 'leg'; there are arm, hand"),
    (
        {"joints": "arm", "srdf": None},
        "joints is 'arm'; no SRDF gives groups; pass srdf=, or a list of joints",
    ),
    ({"joints": ["leg"]}, "joints names 'leg'; there are one, two, three"),
    ({"joints": ["four"]}, "joints names 'four'; there are one, two, three"),
    ({"joints": 5}, "joints is 5; it must be a list of names"),
    ({"joints": []}, "has no joint that moves there"),
    ({"joints": "arm", "tip": "b"}, "joints is given with tip; both say which joints move"),
    ({"joints": "arm", "held_joints": {"one": 0.0}}, "names 'one'; there are three"),
    ({"joints": "arm", "held_joints": {"mount": 0.0}}, "names 'mount'; there are three"),
    ({"joints": JOINTS, "held_joints": {"mount": 0.0}}, "'mount'; there is none; leave it out$"),
    ({"joints": JOINTS, "held_joints": {"four": 0.0}}, "'four'; there is none; leave it out$"),
    ({"joints": "arm", "held_joints": {"leg": 0.0}}, "'leg'; there are three"),
    ({"base": "b", "held_joints": {"one": 0.0}}, "'one'; there is none; leave it out$"),
    (
        {"joints": "arm", "held_joints": {"three": 0.05}},
        "has three at 0.05; its limits are 0 and 0.04",
    ),
    (
        {"joints": "arm", "held_joints": [0.0]},
        r"held_joints is \[0.0\]; it must map names of joints to numbers",
    ),
    ({"held_joints": {"one": 0.0}}, "held_joints names 'one'; there is none"),
    ({"held_joints": [0.0]}, r"it must map names of joints to numbers; pass e.g. \{'elbow': 0.0\}"),
)
def test_from_urdf_refuses_joints_that_cannot_move_or_be_held(
    tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    path, srdf = write_arm_with_states(tmp_path)
    mount = joint("mount", "d", "f", kind="fixed", limits=None)
    path.write_text(path.read_text().replace("</robot>", f"{link('f')}{mount}</robot>"))
    with pytest.raises(InputError, match=message):
        Arm.from_urdf(path, **{"srdf": srdf, **options})


def test_attach_takes_one_name_of_a_link(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path)).attach("tool", BALL, "fore", touch_links="upper")
    assert arm.allowed_collisions["tool", "upper"] == "held"

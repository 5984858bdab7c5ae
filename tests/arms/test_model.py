"""Arms from URDF and SRDF files, against yourdfpy."""

import math
import warnings
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import trimesh
import yourdfpy
from hypothesis import given

from cspace import MeshWarning, Robot
from cspace.arms import Arm, JointValues, build_arm_space
from cspace.errors import AngleWarning, ConfigurationError, FileError, InputError, UnitWarning
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import joint, link, planar, pose_at, random_arm, write_urdf

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))


@given(seed=seeds)
@examples(12)
def test_frames_stand_where_yourdfpy_places_them(tmp_path_factory, seed):
    """Include all kinds of joints, a mimic joint, and links without geometry."""
    path = random_arm(tmp_path_factory.mktemp("arm"), seed)
    mount = joint("mount", "l4", "tool0", (0.1, 0.2, 0.3), rpy=(0.4, 0.5, 0.6), kind="fixed")
    path.write_text(path.read_text().replace("</robot>", f"{link('tool0')}{mount}</robot>"))
    arm = Arm.from_urdf(path)
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert list(arm.joints) == urdf.actuated_joint_names
    assert set(arm.frames) == set(urdf.link_map)
    rows = np.random.default_rng(seed).uniform(-0.4, 0.7, (2, 3, arm.dof))
    batch = arm.pose(rows, "l4")
    for row in np.ndindex(2, 3):
        urdf.update_cfg(rows[row])
        poses = arm.poses(rows[row])
        for name, pose in poses.items():
            np.testing.assert_allclose(pose, urdf.get_transform(name), atol=1e-9)
        np.testing.assert_array_equal(batch[row], poses["l4"])
    assert arm.pose(rows[:0], "l4").shape == (0, 3, 4, 4)


@pytest.mark.filterwarnings("ignore::cspace.MeshWarning", "ignore:.*without collision geometry")
@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_real_arms_stand_where_yourdfpy_places_them(data, name):
    path = data / "arms" / name / f"{name}.urdf"
    arm = Arm.from_urdf(path, path.with_suffix(".srdf"))
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    for q in np.random.default_rng(0).uniform(*arm._ranges(), (9, arm.dof)):
        urdf.update_cfg(dict(zip(arm.joints, q, strict=True)))
        for frame, pose in arm.poses(q).items():
            np.testing.assert_allclose(pose, urdf.get_transform(frame), atol=1e-9)


def test_only_joints_between_base_and_tip_move(tmp_path):
    """Other joints are held at zero or their nearest limit."""
    path = write_urdf(
        tmp_path,
        *(link(name, BAR) for name in "abcd"),
        joint("one", "a", "b", at=(1, 0, 0)),
        joint("two", "b", "c", at=(1, 0, 0), limits=(0.5, 1.0)),
        joint("three", "b", "d", at=(1, 0, 0), kind="prismatic", axis=(0, 0, 2)),
    )
    arm = Arm.from_urdf(path, tip="d")
    assert arm.joints == ("one", "three")
    np.testing.assert_allclose(arm.pose((0.0, 0.2), "d")[:3, 3], (2, 0, 0.2))
    # A link on a held joint belongs to the body of its parent.
    assert {each.name: each.body for each in arm.links} == {"a": 0, "b": 1, "c": 1, "d": 2}
    only = Arm.from_urdf(path, base="b", tip="c")
    assert [each.name for each in only.links] == ["b", "d", "c"]
    assert only.lower.tolist() == [0.5]


def two_bars(folder, elbow, kind="revolute", above=""):
    """Write an arm whose second joint has the given parts."""
    turn = joint("elbow", "upper", "fore", at=(1, 0, 0), kind=kind, limits=None, extra=elbow)
    parts = [
        link("foot"),
        link("upper", BAR),
        link("fore", BAR),
        joint("shoulder", "foot", "upper"),
    ]
    return write_urdf(folder, *parts, turn, above)


SOFT = '<limit lower="-2" upper="2"/><safety_controller k_velocity="1" {}/>'


@pytest.mark.parametrize(
    "elbow, limits",
    [
        ('<limit upper="0.04"/>', (0.0, 0.04)),
        ('<limit lower="-0.5"/>', (-0.5, 0.0)),
        (SOFT.format('soft_lower_limit="-1" soft_upper_limit="1.5"'), (-1.0, 1.5)),
        (SOFT.format('soft_lower_limit="-3" soft_upper_limit="1.5"'), (-2.0, 1.5)),
        (SOFT.format('soft_upper_limit="3"'), (-2.0, 2.0)),
        (SOFT.format(""), (-2.0, 2.0)),
    ],
)
def test_limits_have_the_defaults_of_the_format_and_soft_ones_narrow_them(tmp_path, elbow, limits):
    path = two_bars(tmp_path, elbow)
    arm = Arm.from_urdf(path)
    assert (arm.lower[1], arm.upper[1]) == limits
    held = Arm.from_urdf(path, joints=["shoulder"])
    assert held.held_joints == {"elbow": 0.0}


def test_a_limit_of_effort_alone_holds_the_joint_with_a_warning(tmp_path):
    path = two_bars(tmp_path, '<limit effort="9" velocity="1"/>')
    with pytest.warns(UserWarning, match="'elbow': <limit> has neither lower nor upper") as heard:
        arm = Arm.from_urdf(path)
    assert len(heard) == 1 and (arm.lower[1], arm.upper[1]) == (0.0, 0.0)


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_joints_above_the_base_may_be_of_any_type(tmp_path, kind):
    world = link("world") + joint("root", "world", "foot", kind=kind, limits=None)
    path = two_bars(tmp_path, '<limit lower="-1" upper="1"/>', above=world)
    with pytest.raises(InputError, match=f"'root' is of type '{kind}'.*pass base='foot'"):
        Arm.from_urdf(path)
    arm = Arm.from_urdf(path, base="foot")
    assert arm.joints == ("shoulder", "elbow")
    whole_robot = JointValues(root=1.0, shoulder=0.5, elbow=0.25)
    assert arm.configuration(whole_robot).tolist() == [0.5, 0.25]


def test_a_chain_of_mimicking_joints_follows_the_first(tmp_path):
    def read(elbow, wrist):
        hand = link("hand", BAR) + joint("wrist", "fore", "hand", at=(1, 0, 0), extra=wrist)
        elbow = f'<limit lower="-1" upper="1"/>{elbow}'
        return Arm.from_urdf(two_bars(tmp_path, elbow, above=hand))

    follows = read(
        '<mimic joint="shoulder" multiplier="-2" offset="1"/>',
        '<mimic joint="elbow" multiplier="3" offset="0.5"/>',
    )
    pose = read("", "").pose([0.3, 0.4, 1.7], "hand")
    np.testing.assert_allclose(follows.pose([0.3], "hand"), pose, atol=1e-12)


def write_srdf(folder, text):
    path = folder / "arm.srdf"
    path.write_text(f'<robot name="small">{text}</robot>')
    return path


@pytest.mark.parametrize(
    "text, allowed",
    [
        (None, {("a", "b"): "adjacent", ("b", "c"): "adjacent"}),
        ('<disable_collisions link1="c" link2="a" reason="User"/>', {("a", "c"): "User"}),
        (
            '<disable_default_collisions link="b"/><enable_collisions link1="b" link2="c"/>',
            {("a", "b"): "SRDF"},
        ),
    ],
)
def test_neighbours_may_touch_unless_an_srdf_lists_pairs(tmp_path, text, allowed):
    """A link without geometry does not separate neighbours."""
    path = write_urdf(
        tmp_path,
        *(link("a", BAR), link("bare"), link("b", BAR), link("c", BAR)),
        joint("one", "a", "bare"),
        joint("two", "bare", "b", axis=(1, 0, 0)),
        joint("three", "b", "c", at=(1, 0, 0)),
    )
    srdf = None if text is None else write_srdf(tmp_path, text)
    assert Arm.from_urdf(path, srdf).allowed_collisions.keys() == allowed.keys()


def write_arm_with_states(folder):
    """Write an arm with groups, states of one name, end effectors, and names of other robots."""
    path = write_urdf(
        folder,
        *(link(name, BAR) for name in "abcde"),
        link("bare"),
        joint("one", "a", "b"),
        joint("two", "b", "c", at=(1, 0, 0), limits=(0.5, 1.0)),
        joint("three", "c", "d", at=(1, 0, 0), kind="prismatic", limits=(0, 0.04)),
        joint("four", "c", "e", kind="prismatic", extra='<mimic joint="three"/>'),
        joint("mount", "d", "bare", kind="fixed", limits=None),
    )
    srdf = write_srdf(
        folder,
        """<group name="arm"><chain base_link="a" tip_link="c"/></group>
        <group name="hand"><link name="d"/><link name="e"/><link name="gone"/></group>
        <group name="all"><group name="hand"/><group name="arm"/></group><group name="none"/>
        <group name="fingers"><chain base_link="d" tip_link="e"/></group>
        <group_state name="home" group="arm"><joint name="one" value="0.2"/>
          <joint name="two" value="0.7"/></group_state>
        <group_state name="home" group="hand"><joint name="three" value="0.01"/>
          <joint name="four" value="9"/></group_state>
        <group_state name="open" group="hand"><joint name="three" value="0.04"/></group_state>
        <group_state name="other" group="arm"><joint name="wheel" value="1"/></group_state>
        <end_effector name="gripper" parent_link="c" group="hand" parent_group="arm"/>
        <disable_collisions link1="b" link2="a"/><disable_collisions link1="a" link2="bare"/>
        <disable_collisions link1="lost" link2="b"/>""",
    )
    return path, srdf


IGNORE_NAMES = pytest.mark.filterwarnings("ignore:.*which the URDF")


def test_srdf_names_are_read_and_missing_ones_skipped_with_one_warning(tmp_path):
    path, srdf = write_arm_with_states(tmp_path)
    with pytest.warns(UserWarning, match=r"lost, .*which the URDF.* bare, without coll") as heard:
        arm = Arm.from_urdf(path, srdf)
    assert [each.filename for each in heard] == [__file__]
    assert arm.joints == ("one", "two", "three")
    assert arm.allowed_collisions == {("a", "b"): "SRDF"}
    whole = ("one", "two", "three")
    hand = whole[2:]
    assert arm.groups == {"arm": whole[:2], "hand": hand, "all": whole, "none": (), "fingers": hand}
    named = {name: q.tolist() for name, q in arm.named_configurations.items()}
    assert named == {
        "arm/home": [0.2, 0.7, 0.0],
        "hand/home": [0.0, 0.5, 0.01],
        "hand/open": [0.0, 0.5, 0.04],
    }


@pytest.mark.parametrize(
    "text, message",
    [
        ('<disable_colisions link1="a" link2="c"/>', "did you mean 'disable_collisions'"),
        ('<disable_collisions link1="a" link2="c" margin="1"/>', "margin .disable_collisions."),
    ],
)
def test_parts_that_no_srdf_has_are_named(tmp_path, text, message):
    path, _ = write_arm_with_states(tmp_path)
    with pytest.warns(UserWarning, match=rf"arm\.srdf: these fields are not read: .*{message}"):
        Arm.from_urdf(path, write_srdf(tmp_path, text))


def test_states_of_an_srdf_are_in_radians_and_named_once(tmp_path):
    path, _ = write_arm_with_states(tmp_path)
    state = '<group_state name="home"><joint name="one" value="{}"/></group_state>'
    with pytest.warns(AngleWarning, match="one of the state 'home'.* is beyond a whole turn"):
        Arm.from_urdf(path, write_srdf(tmp_path, state.format(90)))
    with pytest.raises(FileError, match="has the state 'home' twice"):
        Arm.from_urdf(path, write_srdf(tmp_path, 2 * state.format(1)))


def test_a_series_of_pandas_is_a_configuration(tmp_path):
    path, _ = write_arm_with_states(tmp_path)
    q = Arm.from_urdf(path).configuration(pd.Series({"two": 0.7, "one": 0.1}))
    assert q.tolist() == [0.1, 0.7, 0.0]


def test_joints_and_links_in_millimetres_are_warned_of(tmp_path):
    long = ((1000.0, 100.0, 100.0), (500.0, 0.0, 0.0))
    for links, at, message in (
        ((link("a", BAR), link("b", BAR)), (1000, 0, 0), "the way from its parent is 1000 m x"),
        ((link("a", BAR), link("b", long)), (1, 0, 0), "link 'b', collision 0 is 1000 m x 100 m"),
    ):
        path = write_urdf(tmp_path, *links, joint("one", "a", "b", at=at))
        with pytest.warns(UnitWarning, match=message):
            Arm.from_urdf(path)


def test_a_mesh_scaled_from_millimetres_twice_is_warned_of(tmp_path):
    trimesh.creation.box((0.3, 0.1, 0.1)).export(tmp_path / "bar.stl")
    mesh = '<mesh filename="bar.stl" scale="{0} {0} {0}"/>'
    bar = '<link name="b"><collision><geometry>{}</geometry></collision></link>'
    for scale in (1.0, 0.001):
        body = bar.format(mesh.format(scale))
        path = write_urdf(tmp_path, link("a", BAR), body, joint("one", "a", "b"))
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            Arm.from_urdf(path)
        assert [w.category for w in heard] == [UnitWarning] * (scale < 1.0)
        assert all("0.0003 m x 0.0001 m" in str(w.message) for w in heard)


def test_a_long_slide_has_its_own_limits(tmp_path):
    path = write_urdf(
        tmp_path,
        *(link("a", BAR), link("b", BAR)),
        joint("slide", "a", "b", kind="prismatic", limits=(0, 30)),
    )
    space = build_arm_space({}, Arm.from_urdf(path))
    assert [bound.tolist() for bound in space.bounds] == [[0.0], [30.0]]


def test_joints_without_motors_are_warned_of_unless_named(tmp_path):
    path, _ = write_arm_with_states(tmp_path)
    srdf = write_srdf(tmp_path, '<passive_joint name="two"/><passive_joint name="four"/>')
    with pytest.warns(UserWarning, match="have no motor, and plans move them"):
        Arm.from_urdf(path, srdf)
    with warnings.catch_warnings(action="error"):
        assert Arm.from_urdf(path, srdf, joints=["one", "three"]).dof == 2
    srdf = write_srdf(tmp_path, '<passive_joint name="tow"/>')
    with pytest.warns(UserWarning, match="names tow, which the URDF does not have"):
        Arm.from_urdf(path, srdf)


@IGNORE_NAMES
@pytest.mark.parametrize(
    "values, base, expected",
    [
        (None, None, (0.0, 0.5, 0.0)),
        ("arm/home", None, (0.2, 0.7, 0.0)),
        ("open", None, (0.0, 0.5, 0.04)),
        ({"two": 0.9}, "open", (0.0, 0.9, 0.04)),
    ],
)
def test_configuration_takes_states_and_values_by_name(tmp_path, values, base, expected):
    arm = Arm.from_urdf(*write_arm_with_states(tmp_path))
    assert arm.configuration(values, base).tolist() == list(expected)


def write_gripper(folder, **follower):
    """Write a gripper on a turning wrist; the right finger mimics the left one by its double."""
    slides = {"kind": "prismatic", "limits": (0.0, 0.04)}
    mimic = '<mimic joint="left" multiplier="2" offset="0.01"/>'
    return write_urdf(
        folder,
        *(link(name, BAR) for name in "abcd"),
        joint("wrist", "a", "b"),
        joint("left", "b", "c", **slides),
        joint("right", "b", "d", extra=mimic, **{**slides, **follower}),
    )


@pytest.mark.parametrize("right, is_right", [(0.03, True), (0.035, False), (0.03 + 1e-7, True)])
def test_a_joint_off_the_one_that_it_mimics_is_warned_of(tmp_path, right, is_right):
    path = write_gripper(tmp_path)
    values = JointValues(wrist=0.2, left=0.01, right=right)
    state = SimpleNamespace(name=list(values), position=list(values.values()))
    group = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in values.items())
    srdf = write_srdf(tmp_path, f'<group_state name="held" group="hand">{group}</group_state>')
    arm = Arm.from_urdf(path, srdf)
    short = Arm.from_urdf(path, joints=["wrist"], held_joints={"left": 0.01})
    calls = [
        lambda: arm.configuration(state),
        lambda: arm.configuration(values),
        lambda: arm.configuration("held"),
        lambda: arm.configuration(base="held"),
        lambda: arm.configuration(JointValues(right=right), base=(0.0, 0.01)),
        lambda: short.configuration(values),
        lambda: Arm.from_urdf(path, joints=["wrist"], held_joints=values),
    ]
    for number, call in enumerate(calls):
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            call()
        texts = [str(each.message) for each in heard]
        said = "right is at 0.035, but it mimics left, which puts it at 0.03; proofs are for that"
        assert len(texts) == (not is_right) and all(said in text for text in texts), (number, texts)
        assert all(each.filename == __file__ for each in heard)


def test_whole_turns_are_no_way_from_the_joint_that_is_mimicked(tmp_path):
    arm = Arm.from_urdf(write_gripper(tmp_path, kind="continuous", limits=None))
    with warnings.catch_warnings(action="error"):
        arm.configuration(JointValues(wrist=0.0, left=0.01, right=0.03 - math.tau))
    with pytest.warns(UserWarning, match="right is at 3"):
        arm.configuration(JointValues(wrist=0.0, left=0.01, right=3.0))


@IGNORE_NAMES
@refusals(
    "values, base, message",
    ({"one": np.inf}, None, r"values\['one'\] is inf; it must be finite"),
    (None, (0.0, 0.0, 0.0), "base has two at 0; its limits are 0.5 and 1"),
    ("home", None, "values is 'home'; there are arm/home, hand/home"),
)
def test_configuration_refuses_unknown_names_and_values_beyond_limits(
    tmp_path, values, base, message
):
    arm = Arm.from_urdf(*write_arm_with_states(tmp_path))
    with pytest.raises((InputError, ConfigurationError), match=message):
        arm.configuration(values, base)


@IGNORE_NAMES
@pytest.mark.parametrize(
    "options, q, whole_q",
    [
        ({"joints": "arm", "held_joints": {"three": 0.03}}, (0.4, 0.6), (0.4, 0.6, 0.03)),
        ({"joints": ["three", "one"], "held_joints": {"two": 0.9}}, (0.1, 0.02), (0.1, 0.9, 0.02)),
    ],
)
def test_chosen_joints_move_and_others_are_held(tmp_path, options, q, whole_q):
    """Joint four mimics joint three, held or not."""
    path, srdf = write_arm_with_states(tmp_path)
    whole = Arm.from_urdf(path, srdf)
    arm = Arm.from_urdf(path, srdf, **options)
    for frame, pose in arm.poses(q).items():
        np.testing.assert_allclose(pose, whole.pose(whole_q, frame), atol=1e-12)


@IGNORE_NAMES
@refusals(
    "options, message",
    ({"joints": ["four"]}, "joints names 'four'; there are one, two, three"),
    ({"joints": "arm", "held_joints": {"one": 0.0}}, "names 'one'; there are three"),
    ({"held_joints": {"one": 0.0}}, "held_joints names 'one'; there is none$"),
)
def test_from_urdf_refuses_joints_that_cannot_move_or_be_held(tmp_path, options, message):
    path, srdf = write_arm_with_states(tmp_path)
    with pytest.raises(InputError, match=message):
        Arm.from_urdf(path, **{"srdf": srdf, **options})


def test_pairs_are_sorted_into_always_sometimes_and_never(tmp_path):
    path = write_urdf(
        tmp_path,
        link("base", BAR),
        link("sleeve", ((1.0, 0.3, 0.3), (0.5, 0, 0))),
        link("core", ((3.5, 0.05, 0.05), (0, 0, 0))),
        link("lamp", ((0.1, 0.1, 0.1), (0, 0, 5))),
        link("hook", ((0.1, 0.1, 0.1), (-0.5, 0.3, 0))),
        joint("swing", "base", "sleeve", at=(1, 0, 0)),
        joint("spin", "sleeve", "core", axis=(1, 0, 0)),
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
    sampled = {pair: why for pair, why in arm.pairs.items() if pair not in arm.allowed_collisions}
    assert sampled == {
        ("base", "hook"): "sometimes",
        ("base", "lamp"): "never",
        ("core", "hook"): "never",
        ("hook", "lamp"): "never",
        ("lamp", "sleeve"): "never",
    }
    # If the SRDF forgets a pair that always touches, no configuration is free.
    text = '<disable_collisions link1="base" link2="core"/>'
    forgotten = Arm.from_urdf(path, write_srdf(tmp_path, text))
    assert forgotten.pairs["core", "sleeve"] == "always"
    may_touch = [("base", "sleeve")]
    with pytest.raises(ConfigurationError, match=r"touches 'sleeve'.*in 1000 random"):
        build_arm_space({}, forgotten, allowed_collisions=may_touch)


def test_warnings_of_open_meshes_name_what_makes_surfaces_of_them(tmp_path):
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    open_box = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    open_box.export(tmp_path / "open.stl")
    shape = '<collision><geometry><mesh filename="open.stl"/></geometry></collision>'
    path = write_urdf(tmp_path, link("a", BAR), link("b", extra=shape), joint("one", "a", "b"))
    with pytest.warns(MeshWarning, match=r"link 'b', collision 0 are open.*pass solid='surface'"):
        Arm.from_urdf(path)
    arm = Arm.from_urdf(path, solid="surface")
    ball = {"ball": Robot.ball(0.05)}
    assert build_arm_space(ball, arm, allowed_collisions=[("a", "ball")]).is_free((0.0,))
    with pytest.warns(
        MeshWarning, match=r"pass cspace.make_mesh\(mesh, solid='surface'\)"
    ) as heard:
        arm.attach("tool", open_box, "b")
    assert [each.filename for each in heard] == [__file__]


def test_attach_adds_a_frame_and_takes_frames_without_geometry(tmp_path):
    path = planar(tmp_path)
    mount = joint("mount", "fore", "tool0", at=(1, 0, 0), rpy=(0, 0, 0.5), kind="fixed")
    path.write_text(path.read_text().replace("</robot>", f"{link('tool0')}{mount}</robot>"))
    arm = Arm.from_urdf(path)
    held = arm.attach("ball", Robot.ball(0.1), "tool0", pose_at(0.2, 0.0), touch_links="upper")
    q = np.array((0.3, -0.7))
    expected = arm.pose(q, "tool0") @ pose_at(0.2, 0.0)
    np.testing.assert_allclose(held.pose(q, "ball"), expected, atol=1e-12)
    added = held.allowed_collisions.keys() - arm.allowed_collisions.keys()
    assert added == {("ball", "upper")}
    assert held.detach("ball").frames == arm.frames


def write_chain(folder, leader):
    """Write an arm of three joints; the second mimics ``leader``."""
    follows = f'<mimic joint="{leader}"/>'
    return write_urdf(
        folder,
        *(link(name, BAR) for name in "abcd"),
        joint("one", "a", "b"),
        joint("two", "b", "c", extra=follows),
        joint("three", "c", "d"),
    )


def write_rack(folder, factor):
    """Write a pinion without limits, and a rack that slides by ``factor`` m a radian of it."""
    mimic = f'<mimic joint="pinion" multiplier="{factor}" offset="0.3"/>'
    return write_urdf(
        folder,
        *(link(name, BAR) for name in "abcd"),
        joint("pinion", "a", "b", at=(0, 0, 1), kind="continuous", limits=None),
        joint("rack", "a", "c", axis=(1, 0, 0), kind="prismatic", limits=(-1, 1), extra=mimic),
        joint("arm", "a", "d"),
    )


@refusals(
    "write, changes, options, message",
    (planar, {"axis": (0, 0, 0)}, {}, "axis '0.0 0.0 0.0' at the joint 'shoulder'"),
    (write_chain, {"leader": "one"}, {"base": "b"}, "mimics 'one'; there are three"),
    (write_rack, {"factor": 0.01}, {}, "a prismatic joint would slide without end"),
)
def test_from_urdf_refuses_invalid_files_and_links(tmp_path, write, changes, options, message):
    path = write(tmp_path, **changes)
    with pytest.raises((InputError, FileError), match=message):
        Arm.from_urdf(path, **options)


@refusals(
    "text, message",
    ('<robot><disable_collisions link1="foot"/></robot>', "<disable_collisions> without link2"),
    ('<robot><group name="g"><group name="g"/></group></robot>', "has the group 'g' within itself"),
    (
        '<robot><group_state name="s"><joint name="elbow" value="up"/></group_state></robot>',
        "has elbow at 'up' in the state 's'; it must be one finite number",
    ),
)
def test_from_urdf_refuses_invalid_srdf_files(tmp_path, text, message):
    path = tmp_path / "arm.srdf"
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        Arm.from_urdf(planar(tmp_path), path)

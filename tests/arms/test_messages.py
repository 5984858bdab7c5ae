"""Arms from texts and messages of ROS: descriptions, states and limits of joints."""

import dataclasses
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import cspace
import planners
from cspace import Arm, Robot
from cspace.errors import AngleWarning, ConfigurationError, FileError, InputError
from tests.helpers.handmade import build_empty

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def make_text(velocity=1.0):
    """Return a URDF of a slide, and a turn on it that has no speed."""
    limits = f'<limit lower="0" upper="2" effort="1" velocity="{velocity}"/>'
    turn = '<limit lower="-3" upper="3" effort="1" velocity="0"/>'
    return f"""<?xml version="1.0"?>
        <robot name="r"><link name="base"/><link name="arm">{BOX}</link><link name="hand">{BOX}</link>
        <joint name="slide" type="prismatic"><parent link="base"/><child link="arm"/>
        <axis xyz="1 0 0"/>{limits}</joint><joint name="turn" type="revolute"><parent link="arm"/>
        <child link="hand"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>{turn}</joint></robot>"""


SRDF = """<robot name="r"><group name="all"><joint name="slide"/></group>
    <disable_collisions link1="arm" link2="hand" reason="Never"/></robot>"""


@pytest.fixture(scope="module")
def arm():
    return Arm.from_urdf(make_text(), SRDF)


def test_descriptions_may_be_texts(arm, tmp_path):
    (tmp_path / "r.urdf").write_text(make_text())
    (tmp_path / "r.srdf").write_text(SRDF)
    of_files = Arm.from_urdf(tmp_path / "r.urdf", str(tmp_path / "r.srdf"))
    assert arm.groups == of_files.groups == {"all": ("slide",)}
    assert arm.allowed_collisions == of_files.allowed_collisions
    text = f'<robot name="r"><link name="base">{BOX}</link></robot>'
    assert Robot.from_urdf(text).shape.outer.bounds[1].tolist() == [0.05, 0.05, 0.05]
    assert "robot_description" in repr(Robot.from_urdf(text))
    with pytest.raises(FileError, match=r"^robot_description: is not XML"):
        Arm.from_urdf("<robot>")
    with pytest.raises(FileError, match="package_dirs"):
        Robot.from_urdf(text.replace('<box size="0.1 0.1 0.1"/>', '<mesh filename="no.stl"/>'))
    with cspace.raised_limits(max_description_bytes=9), pytest.raises(FileError, match="limit"):
        Arm.from_urdf(make_text())


@pytest.mark.parametrize("kind", [dict, lambda **fields: SimpleNamespace(**fields)])
def test_a_state_of_joints_is_a_configuration_and_a_start(arm, kind):
    header = kind(frame_id="", stamp=kind(sec=1, nanosec=2))
    names = ["turn", "slide"]
    state = kind(header=header, name=names, position=np.array([0.5, 1.5]), velocity=[], effort=[])
    assert arm.configuration(state).tolist() == [1.5, 0.5]
    space = cspace.build_arm_space({}, arm)
    with warnings.catch_warnings(action="error"):
        plan = planners.plan(space, state, (0.2, 0.1), seed=1)
    assert plan.path[0].tolist() == [1.5, 0.5]
    partial = kind(header=header, name=["slide"], position=[1.0])
    assert arm.configuration(partial, base=(0.0, 0.7)).tolist() == [1.0, 0.7]
    for wrong, error, message in (
        (partial, InputError, "lack turn"),
        (kind(header=header, name=names, position=[1.0]), InputError, "2 joints but 1 positions"),
        (kind(name=["slide", "hip"], position=[1.0, 1.0]), InputError, "hip"),
        (kind(name=names, position=[0.5, np.nan]), InputError, "finite"),
        (kind(name=names, position=[0.5, 150.0]), ConfigurationError, "slide at 150"),
    ):
        with pytest.raises(error, match=message):
            arm.configuration(wrong)


def test_a_pose_of_ros_is_a_start():
    space = build_empty((60, 60), Robot.disc(0.2))
    pose = {"position": {"x": 1, "y": 2, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    header = {"frame_id": "map"}
    for message in (
        {"header": header, "pose": pose},
        {"header": header, "pose": {"pose": pose, "covariance": [0.0] * 36}},
        SimpleNamespace(header=header, pose={"pose": pose}, child_frame_id="base", twist={}),
    ):
        assert planners.plan(space, message, (4, 4)).path[0].tolist() == [1.0, 2.0]
        assert space.check_configuration(message).tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match=r"msg\.header\.frame_id is 'odom'.*frame"):
        planners.plan(space, {"header": {"frame_id": "odom"}, "pose": pose}, (4, 4))


LIMITS = """
joint_limits:
  slide: {has_velocity_limits: true, max_velocity: 0.5, has_acceleration_limits: true,
          max_acceleration: 2.0, has_jerk_limits: true, max_jerk: 20.0}
  turn: {has_velocity_limits: true, max_velocity: 0.25, has_acceleration_limits: true,
         max_acceleration: 1.0, max_jerk: 10.0}
"""
FINGER = "  finger: {has_velocity_limits: true, max_velocity: 0.1}\n"


def test_limits_of_joints_are_those_of_moveit(arm, tmp_path):
    path = tmp_path / "joint_limits.yaml"
    space = cspace.build_arm_space({}, arm)
    plan = planners.plan(space, (0.0, 0.0), (1.0, 1.0), seed=1)
    given = {"max_velocity": {"slide": 0.5, "turn": 0.25}}
    given |= {
        "max_acceleration": {"slide": 2.0, "turn": 1.0},
        "max_jerk": {"slide": 20, "turn": 10},
    }
    expected = plan.trajectory(**given)
    table = {"joint_limits": {"slide": {"max_velocity": 0.5}, "turn": {"max_velocity": 0.25}}}
    path.write_text(LIMITS)
    with warnings.catch_warnings(action="error"):
        for file in (path, str(path)):
            read = plan.trajectory(**dict.fromkeys(given, file))
            assert read.duration == expected.duration
        for limits in (table, table["joint_limits"]):
            read = plan.trajectory(**given | {"max_velocity": limits})
            assert read.duration == expected.duration
        along = planners.Trajectory.along(space, plan.path, **dict.fromkeys(given, path))
    assert along.duration == planners.Trajectory.along(space, plan.path, **given).duration


def make_typed(kind, /, **values):
    """Make a message as of rosbags, whose type is a field of its dataclass."""
    fields = [*values, ("__msgtype__", str, dataclasses.field(default=kind))]
    return dataclasses.make_dataclass(kind, fields)(**values)


def test_the_type_of_a_message_is_no_field_of_it(arm):
    header = make_typed("Header", frame_id="", stamp=make_typed("Time", sec=1, nanosec=0))
    state = {"name": ["turn", "slide"], "position": np.array([0.2, 0.1])}
    state |= {"velocity": np.zeros(0), "effort": np.zeros(0), "header": header}
    with warnings.catch_warnings(action="error"):
        assert tuple(arm.configuration(make_typed("JointState", **state))) == (0.1, 0.2)


def test_limits_of_joints_that_are_off_or_wrong_are_heard(arm, tmp_path):
    path = tmp_path / "joint_limits.yaml"
    space = cspace.build_arm_space({}, arm)
    plan = planners.plan(space, (0.0, 0.0), (1.0, 1.0), seed=1)

    def time_with(text):
        path.write_text(text)
        return plan.trajectory(max_velocity=1.0, max_acceleration=path).duration

    off = LIMITS.replace("has_acceleration_limits: true", "has_acceleration_limits: false")
    with pytest.raises(InputError, match="lacks slide, turn"):
        time_with(off)
    with pytest.raises(FileError, match="has the max_acceleration 'fast'"):
        time_with(LIMITS.replace("max_acceleration: 2.0", "max_acceleration: fast"))
    with pytest.raises(FileError, match="has no joint_limits"):
        time_with("default_velocity_scaling_factor: 0.1\n")
    with pytest.warns(UserWarning) as caught:
        time_with(
            f"default_velocity_scaling_factor: 0.1\n{LIMITS}{FINGER}".replace(
                "max_jerk: 10.0", "has_position_limits: true, min_position: 0.0"
            )
        )
    fields, others = (str(warning.message) for warning in caught)
    assert "limits of finger are not read" in others
    assert "not read: default_velocity_scaling_factor, min_position (joint)" in fields
    assert "did you mean" not in fields
    path.write_text(LIMITS.replace("0.25", "90.0"))
    with pytest.warns(AngleWarning, match="max_velocity is beyond 8 turns a second"):
        plan.trajectory(max_velocity=path, max_acceleration=1.0)


LIMIT_SLIPS = {
    "prefix": ("  slide", "  left_slide", "names left_slide, and not slide"),
    "letter": ("  turn", "  turm", "names turm, and not turn; the joints are slide, turn"),
    "number": ("max_velocity: 0.5", "max_velocty: 0.5", "has no max_velocity; .*max_velocty"),
    "flag": ("has_velocity_limits", "has_velocity_limit", "did you mean 'has_velocity_limits'"),
    "text": ("has_velocity_limits: true", "has_velocity_limits: 'false'", "it must be true or"),
    "no number": (", max_velocity: 0.5", "", "has no max_velocity"),
    "heading": ("joint_limits:", "joint_limts:", "(has no joint_limits|names joint_limts)"),
}
"""Slips in a file of limits by which one would be lost."""


@pytest.mark.parametrize("slip", LIMIT_SLIPS)
def test_a_limit_that_a_slip_would_lose_is_refused(arm, tmp_path, slip):
    right, wrong, message = LIMIT_SLIPS[slip]
    path = tmp_path / "joint_limits.yaml"
    path.write_text(LIMITS.replace(right, wrong))
    plan = planners.plan(cspace.build_arm_space({}, arm), (0.0, 0.0), (1.0, 1.0), seed=1)
    for source in (path, yaml.safe_load(path.read_text())):
        with pytest.raises(InputError if source is not path else FileError, match=message):
            plan.trajectory(max_velocity=source, max_acceleration=1.0)

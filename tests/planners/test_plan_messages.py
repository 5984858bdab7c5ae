"""Plans as messages of ROS 1 and 2."""

import copy
import sys
from array import array
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import planners
from cspace import InputError
from cspace.arms import Arm, build_arm_space
from cspace.files import ros as messages
from planning import ENDPOINTS, SPACES, room
from refusals import refusals
from urdfs import joint, link, planar, post, written


@pytest.fixture(scope="module")
def arm_plan(tmp_path_factory: pytest.TempPathFactory) -> planners.Plan:
    pytest.importorskip("yourdfpy")
    space = build_arm_space({"post": post()}, Arm.from_urdf(planar(tmp_path_factory.mktemp("arm"))))
    return planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=20.0, seed=1)


@pytest.mark.parametrize("name", SPACES)
def test_path_message_holds_the_poses_of_the_plan(name: str) -> None:
    plan = planners.plan(room(name), *ENDPOINTS[name], time_limit=20.0, seed=1)
    for each in (plan, copy.deepcopy(plan)):  # copies have no map
        msg = each.to_path(frame_id="odom")
        assert isinstance(msg, messages.Path) and len(msg.poses) == len(plan.path)
        assert {msg.header.frame_id, *(pose.header.frame_id for pose in msg.poses)} == {"odom"}
        for row, stamped in zip(plan.path, msg.poses, strict=True):
            q, place, turn = dict(zip(plan.axes, row, strict=True)), stamped.pose.position, stamped.pose.orientation
            assert (place.x, place.y, place.z) == (q["x"], q["y"], q.get("z", 0.0))
            expected = Rotation.from_euler("z", q.get("yaw", 0.0))
            if "qw" in q:
                expected = Rotation.from_quat([q["qx"], q["qy"], q["qz"], q["qw"]])
            given = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
            assert (given * expected.inv()).magnitude() < 1e-12


class PoseStamped(messages.PoseStamped):
    """An element of ROS 2, declared by ``PathOf2``."""


class Point(SimpleNamespace):
    """An element of ROS 1, whose durations have fields ``secs`` and ``nsecs``."""

    def __init__(self) -> None:
        super().__init__(positions=[], time_from_start=SimpleNamespace(secs=0, nsecs=0))


class PathOf2(messages.Path):
    """A message that declares its fields like ROS 2."""

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return {"header": "std_msgs/Header", "poses": "sequence<fake_msgs/PoseStamped>"}


class TrajectoryOf1:
    """A message that declares its fields like ROS 1."""

    __slots__ = ("header", "joint_names", "points")
    _slot_types = ("std_msgs/Header", "string[]", "fake_msgs/Point[]")

    def __init__(self) -> None:
        self.header, self.joint_names, self.points = SimpleNamespace(frame_id=""), [], []


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    made: Any = ModuleType("fake_msgs.msg")
    made.PoseStamped, made.Point = PoseStamped, Point
    monkeypatch.setitem(sys.modules, "fake_msgs", ModuleType("fake_msgs"))
    monkeypatch.setitem(sys.modules, "fake_msgs.msg", made)


@pytest.mark.usefixtures("ros")
def test_elements_have_the_class_declared_by_the_message(arm_plan: planners.Plan) -> None:
    plan = planners.plan(room("plane"), *ENDPOINTS["plane"], time_limit=20.0)
    msg = PathOf2()
    msg.header.stamp = messages.Time(7, 8)
    assert plan.to_path(msg) is msg
    assert {type(pose) for pose in msg.poses} == {PoseStamped}
    assert all(pose.header.stamp == messages.Time(7, 8) for pose in msg.poses)
    trajectory = arm_plan.to_joint_trajectory(TrajectoryOf1(), duration=2.5, frame_id="base")
    assert {type(point) for point in trajectory.points} == {Point} and trajectory.header.frame_id == "base"
    last = trajectory.points[-1].time_from_start
    assert (last.secs, last.nsecs) == (2, 500_000_000)


def seconds(msg: messages.JointTrajectory) -> np.ndarray:
    return np.array([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in msg.points])


def test_joint_trajectory_takes_the_time_of_the_slowest_joint(arm_plan: planners.Plan) -> None:
    assert len(arm_plan.path) > 2
    steps = np.abs(np.diff(arm_plan.path, axis=0))
    for velocities, speeds in ((2.0, [2.0, 2.0]), ([0.5, 3.0], [0.5, 3.0]), ({"elbow": 3, "shoulder": 1}, [1.0, 3.0])):
        msg = arm_plan.to_joint_trajectory(velocities=velocities)
        assert isinstance(msg, messages.JointTrajectory) and msg.joint_names == ["shoulder", "elbow"]
        assert [point.positions for point in msg.points] == [array("d", row) for row in arm_plan.path.tolist()]
        taken = np.diff(seconds(msg))
        np.testing.assert_allclose(taken, [max(row / speeds) for row in steps], atol=2e-9)
        assert (steps <= np.multiply(taken[:, None] + 2e-9, speeds)).all() and seconds(msg)[0] == 0.0


def test_joint_trajectory_distributes_its_duration_by_length(arm_plan: planners.Plan) -> None:
    msg = copy.deepcopy(arm_plan).to_joint_trajectory(duration=6.0)
    lengths = np.linalg.norm(np.diff(arm_plan.path, axis=0), axis=1)
    np.testing.assert_allclose(seconds(msg)[1:], 6.0 * np.cumsum(lengths) / lengths.sum(), atol=2e-9)


def test_joints_named_x_and_y_give_no_pose(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    slides = {"kind": "prismatic", "limits": (-1, 1)}
    box = ((0.1, 0.1, 0.1), (0, 0, 0))
    parts = link("foot", ((0.1, 0.1, 0.1), (0, 0, -1))), link("rail"), link("head", box)
    rails = joint("x", "foot", "rail", axis=(1, 0, 0), **slides), joint("y", "rail", "head", axis=(0, 1, 0), **slides)
    space = build_arm_space({}, Arm.from_urdf(written(tmp_path, *parts, *rails)))
    plan = planners.plan(space, (0.0, 0.0), (0.5, 0.5))
    assert plan.to_joint_trajectory(velocities=0.1).joint_names == ["x", "y"]
    with pytest.raises(InputError, match="plan moves the joints x, y; a path holds poses"):
        plan.to_path()


@refusals(
    "options, expected",
    ({}, "velocities and duration are left out; a plan has no times"),
    ({"velocities": 1.0, "duration": 1.0}, "velocities and duration are both given"),
    ({"duration": 0.0}, "duration is 0"),
    ({"velocities": 0.0}, "velocities is 0.0; it must be one number, or one for each of shoulder, elbow"),
    ({"velocities": [1, 2, 3]}, r"velocities is \[1, 2, 3\]"),
    ({"velocities": [1, np.nan]}, "velocities"),
    ({"velocities": {"elbow": 1}}, "velocities lacks shoulder"),
    ({"duration": 1.0, "msg": SimpleNamespace(header=None)}, r"msg has no header\.frame_id; .*JointTrajectory"),
)
def test_joint_trajectories_reject_invalid_arguments(
    arm_plan: planners.Plan, options: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        arm_plan.to_joint_trajectory(**options)


def test_plans_of_the_other_kind_and_without_a_path_are_refused(arm_plan: planners.Plan) -> None:
    with pytest.raises(InputError, match=r"plan moves the joints shoulder, elbow; .* use to_joint_trajectory"):
        arm_plan.to_path()
    plan = planners.plan(room("plane"), *ENDPOINTS["plane"], time_limit=20.0)
    with pytest.raises(InputError, match=r"plan moves x, y; .* use to_path\(\)"):
        plan.to_joint_trajectory(duration=1.0)
    with pytest.raises(InputError, match=r"msg has no poses; it must have the fields of nav_msgs/Path"):
        plan.to_path(SimpleNamespace(header=SimpleNamespace(frame_id="")))
    with pytest.raises(InputError, match="plan has no path: no path exists: proven"):
        replace(plan, solved=False, status="no path exists: proven").to_path()

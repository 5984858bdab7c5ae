"""Plans as messages of ROS 1 and 2."""

import copy
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

import planners
from cspace import InputError
from cspace.arms import Arm, build_arm_space
from cspace.files import ros as messages
from tests.helpers.planning import ENDPOINTS, SPACES, build_room
from tests.helpers.urdfs import joint, link, planar, post, write_urdf

TIMING_LIMITS: dict[str, Any] = {"max_velocity": 1.0, "max_acceleration": 1.0}


@pytest.fixture(scope="module")
def arm_plan(tmp_path_factory: pytest.TempPathFactory) -> planners.Plan:
    pytest.importorskip("yourdfpy")
    space = build_arm_space({"post": post()}, Arm.from_urdf(planar(tmp_path_factory.mktemp("arm"))))
    return planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=20.0, seed=1)


@pytest.mark.parametrize("name", SPACES)
def test_path_message_holds_the_poses_of_the_plan(name: str) -> None:
    plan = planners.plan(build_room(name), *ENDPOINTS[name], time_limit=20.0, seed=1)
    for each in (plan, copy.deepcopy(plan)):  # copies have no map
        msg = each.to_path(frame_id="odom")
        assert isinstance(msg, messages.Path) and len(msg.poses) == len(plan.path)
        assert {msg.header.frame_id, *(pose.header.frame_id for pose in msg.poses)} == {"odom"}
        for row, stamped in zip(plan.path, msg.poses, strict=True):
            q, place, turn = (
                dict(zip(plan.axes, row, strict=True)),
                stamped.pose.position,
                stamped.pose.orientation,
            )
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
        super().__init__(
            positions=[], velocities=[], time_from_start=SimpleNamespace(secs=0, nsecs=0)
        )


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
    plan = planners.plan(build_room("plane"), *ENDPOINTS["plane"], time_limit=20.0)
    msg = PathOf2()
    msg.header.stamp = messages.Time(7, 8)
    assert plan.to_path(msg) is msg
    assert {type(pose) for pose in msg.poses} == {PoseStamped}
    assert all(pose.header.stamp == messages.Time(7, 8) for pose in msg.poses)
    trajectory = arm_plan.trajectory(**TIMING_LIMITS, duration=12.5).to_joint_trajectory(
        TrajectoryOf1(), frame_id="base"
    )
    assert {type(point) for point in trajectory.points} == {
        Point
    } and trajectory.header.frame_id == "base"
    last = trajectory.points[-1].time_from_start
    assert (last.secs, last.nsecs) == (12, 500_000_000)


def test_joints_named_x_and_y_give_no_pose(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    slides = {"kind": "prismatic", "limits": (-1, 1)}
    box = ((0.1, 0.1, 0.1), (0, 0, 0))
    parts = link("foot", ((0.1, 0.1, 0.1), (0, 0, -1))), link("rail"), link("head", box)
    rails = (
        joint("x", "foot", "rail", axis=(1, 0, 0), **slides),
        joint("y", "rail", "head", axis=(0, 1, 0), **slides),
    )
    space = build_arm_space({}, Arm.from_urdf(write_urdf(tmp_path, *parts, *rails)))
    plan = planners.plan(space, (0.0, 0.0), (0.5, 0.5))
    assert plan.trajectory(**TIMING_LIMITS).to_joint_trajectory().joint_names == ["x", "y"]
    with pytest.raises(InputError, match="plan moves the joints x, y; a path holds poses"):
        plan.to_path()


def test_plans_of_the_other_kind_and_without_a_path_are_refused(arm_plan: planners.Plan) -> None:
    with pytest.raises(
        InputError, match=r"plan moves the joints shoulder, elbow; .*\.to_joint_trajectory"
    ):
        arm_plan.to_path()
    plan = planners.plan(build_room("plane"), *ENDPOINTS["plane"], time_limit=20.0)
    with pytest.raises(InputError, match=r"msg has no header\.frame_id; .*JointTrajectory"):
        arm_plan.trajectory(**TIMING_LIMITS).to_joint_trajectory(SimpleNamespace(header=None))
    with pytest.raises(
        InputError, match=r"msg has no poses; it must have the fields of nav_msgs/Path"
    ):
        plan.to_path(SimpleNamespace(header=SimpleNamespace(frame_id="")))
    with pytest.raises(InputError, match="plan has no path: no path exists: proven"):
        replace(plan, solved=False, status="no path exists: proven").to_path()

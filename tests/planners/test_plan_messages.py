"""Plans as messages of ROS 1 and 2."""

import copy
import math
import pickle
import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import cspace
import planners
from cspace import InputError
from cspace._files import ros_maps as messages
from tests.helpers.drives import make_drive
from tests.helpers.planning import ENDPOINTS, SPACES, build_room
from tests.helpers.urdfs import planar

LIMITS = {"max_velocity": 1.0, "max_acceleration": 1.0}


class PoseStamped(messages.PoseStamped):
    """An element of ROS 2, declared by ``PathOf2``."""


class Point(SimpleNamespace):
    """An element of ROS 1, whose durations have fields ``secs`` and ``nsecs``."""

    def __init__(self):
        duration = SimpleNamespace(secs=0, nsecs=0)
        super().__init__(positions=[], velocities=[], time_from_start=duration)


class PathOf2(messages.Path):
    """A message that declares its fields like ROS 2."""

    @classmethod
    def get_fields_and_field_types(cls):
        return {"header": "std_msgs/Header", "poses": "sequence<fake_msgs/PoseStamped>"}


class TrajectoryOf1:
    """A message that declares its fields like ROS 1."""

    __slots__ = ("header", "joint_names", "points")
    _slot_types = ("std_msgs/Header", "string[]", "fake_msgs/Point[]")

    def __init__(self):
        self.header = SimpleNamespace(frame_id="")
        self.joint_names = []
        self.points = []


@pytest.fixture(scope="module")
def joint_plan(tmp_path_factory):
    """Plan for an arm whose joints are named like axes of the plane."""
    path = planar(tmp_path_factory.mktemp("arm"))
    path.write_text(path.read_text().replace("shoulder", "x").replace("elbow", "y"))
    arm = cspace.Arm.from_urdf(path)
    return planners.plan(cspace.build_arm_space({}, arm), (0.0, 0.0), (0.5, 0.5))


def test_elements_have_the_class_declared_by_the_message(joint_plan, monkeypatch):
    made = ModuleType("fake_msgs.msg")
    made.PoseStamped, made.Point = PoseStamped, Point
    monkeypatch.setitem(sys.modules, "fake_msgs", ModuleType("fake_msgs"))
    monkeypatch.setitem(sys.modules, "fake_msgs.msg", made)
    message = PathOf2()
    message.header.stamp = messages.Time(7, 8)
    plan = planners.plan(build_room("plane"), *ENDPOINTS["plane"])
    assert plan.to_path(message) is message
    assert {type(pose) for pose in message.poses} == {PoseStamped}
    assert all(pose.header.stamp == messages.Time(7, 8) for pose in message.poses)
    motion = joint_plan.trajectory(**LIMITS, duration=12.5)
    filled = motion.to_joint_trajectory(TrajectoryOf1(), frame_id="base")
    assert {type(point) for point in filled.points} == {Point}
    assert (filled.joint_names, filled.header.frame_id) == (["x", "y"], "base")
    last = filled.points[-1].time_from_start
    assert (last.secs, last.nsecs) == (12, 500_000_000)


@pytest.mark.parametrize("name", SPACES)
def test_path_message_holds_the_poses_of_the_plan(name):
    plan = planners.plan(build_room(name), *ENDPOINTS[name], time_limit=20.0, seed=1)
    message = copy.deepcopy(plan).to_path(frame_id="odom")  # copies have no map
    assert {pose.header.frame_id for pose in message.poses} == {message.header.frame_id} == {"odom"}
    for row, stamped in zip(plan.path, message.poses, strict=True):
        q = dict(zip(plan.axes, row, strict=True))
        place, turn = stamped.pose.position, stamped.pose.orientation
        assert (place.x, place.y, place.z) == (q["x"], q["y"], q.get("z", 0.0))
        half = 0.5 * q.get("yaw", 0.0)
        expected = [0.0, 0.0, math.sin(half), math.cos(half)]
        if "qw" in q:
            expected = row[3:]
        given = [turn.x, turn.y, turn.z, turn.w]
        assert abs(np.dot(given, expected)) == pytest.approx(1.0, abs=1e-12)


def test_plans_without_a_path_and_other_messages_are_refused():
    plan = planners.plan(build_room("plane"), *ENDPOINTS["plane"])
    lost = replace(plan, waypoints=plan.waypoints[:0], status="no path exists: proven")
    with pytest.raises(InputError, match="plan has no path: no path exists: proven"):
        lost.to_path()
    with pytest.raises(InputError, match="msg has no poses"):
        plan.to_path(SimpleNamespace(header=SimpleNamespace(frame_id="")))


@pytest.mark.parametrize(
    "name, word",
    [("plane", None), ("turning", None), ("turning", "differential"), ("turning", "reeds-shepp")],
)
def test_poses_of_a_path_are_a_step_apart_and_on_it(name, word):
    space = build_room(name)
    plan = planners.plan(space, *ENDPOINTS[name], time_limit=20, drive=make_drive(word))
    poses = plan.to_path(step=0.07).poses
    rows = np.array([cspace.ros.configuration_of(pose, space) for pose in poses])
    assert np.hypot(*np.diff(rows[:, :2], axis=0).T).max() <= 0.07 + 1e-12
    assert space.is_free(rows).all()
    distances = np.linalg.norm(rows[:, None, :2] - plan.path[None, :, :2], axis=2)
    assert distances.min(axis=0).max() < 0.07  # all poses of the plan are near one of the path
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(InputError, match="step"):
            plan.to_path(step=bad)
    with pytest.raises(InputError, match=r"makes .* poses; at most 1000000"):
        plan.to_path(step=1e-9)
    assert len(plan.to_path(step=0.05).poses) >= len(poses)
    pickled = pickle.loads(pickle.dumps(plan))
    with pytest.raises(InputError, match=r"plan has no map.*pickling"):
        pickled.to_path(step=0.1)
    assert len(pickled.to_path().poses) == len(plan.path)

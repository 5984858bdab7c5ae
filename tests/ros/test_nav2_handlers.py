"""The node's handlers for Nav2, with stand-ins for its messages, and trajectories of arms."""

import importlib.util
import math
import threading
import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from builtin_interfaces.msg import Duration  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from nav_msgs.msg import Path  # noqa: E402
from trajectory_msgs.msg import JointTrajectory  # noqa: E402

import cspace  # noqa: E402
import planners  # noqa: E402
from tests.helpers.repository import ROOT  # noqa: E402
from tests.helpers.urdfs import planar, post  # noqa: E402
from tests.ros.test_planner_node import GOAL, KEPT, START, build, make_grid, make_pose, make_room  # noqa: E402

SPEC = importlib.util.spec_from_file_location("planner_node", ROOT / "examples/ros/planner_node.py")
planner_node = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(planner_node)


class Result:
    """nav2_msgs/ComputePathToPose_Result."""

    def __init__(self):
        self.path = Path()
        self.planning_time = Duration()
        self.error_code = 0
        self.error_msg = ""


class Goal:
    """The handle of a goal, which is cancelled once the node has asked some times."""

    def __init__(self, start=START, goal=GOAL, max_asks=math.inf, frame="map", use_start=True):
        poses = make_pose(*start, frame), make_pose(*goal)
        self.request = SimpleNamespace(start=poses[0], goal=poses[1], use_start=use_start)
        self.max_asks = max_asks
        self.asked = []  # the thread's CPU seconds, which other processes do not lengthen
        self.state = ""

    @property
    def is_cancel_requested(self):
        self.asked.append(time.thread_time())
        return len(self.asked) > self.max_asks

    def succeed(self):
        self.state = "succeeded"

    def abort(self):
        self.state = "aborted"

    def canceled(self):
        self.state = "canceled"


@pytest.fixture(scope="module")
def node():
    parameters = [
        "footprint:='[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]'",
        "time_limit:=30.0",
    ]
    arguments = [word for each in parameters for word in ("-p", each)]
    rclpy.init(args=["--ros-args", *arguments])
    node = planner_node.PlannerNode()
    node.compute_path = SimpleNamespace(Result=Result)
    yield node
    node.destroy_node()
    rclpy.shutdown()


def ask(node, **fields):
    """Execute a goal; return its state and result."""
    goal = Goal(**fields)
    return goal, node.compute_path_to_pose(goal)


def test_without_a_map_there_is_a_reason(node):
    goal, result = ask(node)
    assert (goal.state, result.error_code) == ("aborted", planner_node.UNKNOWN)
    assert result.error_msg == "there is no map yet"


def test_goals_succeed_and_codes_say_why_not(node):
    node.on_map(make_grid(make_room()))
    goal, result = ask(node)
    assert (goal.state, result.error_code, result.error_msg) == ("succeeded", 0, "")
    assert len(result.path.poses) > 10 and result.path.header.frame_id == "map"
    wanted = {
        202: {"frame": "odom"},
        203: {"start": (30.0, 1.0, 0.0)},
        204: {"goal": (30.0, 1.0, 0.0)},
        205: {"start": (3.0, 1.0, 0.0)},
        206: {"goal": (3.0, 1.0, 0.0)},
    }
    for code, fields in wanted.items():
        goal, result = ask(node, **fields)
        assert (goal.state, result.error_code) == ("aborted", code) and result.error_msg
    assert ask(node, use_start=False)[1].error_code == 202  # tf2 is not installed
    moved = TransformStamped()
    moved.header.frame_id = "map"
    moved.transform.translation.x, moved.transform.translation.y = START[:2]
    node.transforms = SimpleNamespace(lookup_transform=lambda *frames: moved)
    _, result = ask(node, start=(30.0, 1.0, 0.0), use_start=False)
    assert result.path.poses[0].pose.position.x == START[0]
    node.transforms = None
    node.on_map(make_grid(make_room(gap=3)))
    assert ask(node)[1].error_code == 208
    node.on_map(make_grid(make_room()))


def test_a_goal_can_be_cancelled_while_it_plans(node, monkeypatch):
    real = planners.plan

    def search_on(*ends, stop, **options):  # the optimising planner goes on until it is stopped
        options |= {"planner": "RRTstar", "previous": None}
        return real(*ends, stop=stop, **options)

    node.on_map(make_grid(make_room()))
    monkeypatch.setattr(planner_node.planners, "plan", search_on)
    node.last = None
    ask(node, max_asks=50)  # compiles
    node.last = None
    goal, _ = ask(node, max_asks=50)
    assert goal.state == "canceled" and time.thread_time() - goal.asked[49] < 0.2


def test_a_map_that_comes_while_it_plans_counts(node, monkeypatch):
    real = planners.plan
    maps = [make_grid(make_room(gap=3))]

    def plan_while_a_map_comes(*ends, **options):
        found = real(*ends, **options)
        while maps:
            follower = threading.Thread(target=node.on_map, args=[maps.pop()])
            follower.start()
            follower.join(60.0)
            assert not follower.is_alive(), "the map waits for the plan"
        return found

    monkeypatch.setattr(planner_node.planners, "plan", plan_while_a_map_comes)
    node.last = None
    goal, result = ask(node)
    assert (goal.state, result.error_code) == ("aborted", 208) and not result.path.poses
    node.on_map(make_grid(make_room()))


def test_paths_are_valid_until_an_obstacle_comes(node):
    _, result = ask(node)
    request = SimpleNamespace(path=result.path)
    answer = node.is_path_valid(request, SimpleNamespace())
    assert answer.is_valid and not answer.invalid_pose_indices
    node.on_map(make_grid(make_room(gap=3)))
    answer = node.is_path_valid(request, SimpleNamespace())
    assert not answer.is_valid and answer.invalid_pose_indices
    node.on_map(make_grid(make_room()))


def test_updates_of_a_part_equal_a_new_build(node):
    cells = make_room()
    cells[20:30, 10:14] = -1
    update = cspace.ros.OccupancyGridUpdate(x=20, y=10, width=10, height=4)
    update.data.extend([-1] * 40)
    node.on_update(update)
    np.testing.assert_array_equal(node.space.cell_states, build(cells).cell_states)
    update.x = 115  # not in the grid
    node.on_update(update)
    np.testing.assert_array_equal(node.space.cell_states, build(cells).cell_states)
    node.on_map(make_grid(make_room()))


def test_a_controller_follows_an_arms_trajectory(node, tmp_path):
    pytest.importorskip("yourdfpy")
    space = cspace.build_arm_space({"post": post()}, cspace.Arm.from_urdf(planar(tmp_path)))
    plan = planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=10.0, seed=1)
    received = []
    publisher = node.create_publisher(JointTrajectory, "controller/joint_trajectory", KEPT)
    node.create_subscription(JointTrajectory, "controller/joint_trajectory", received.append, KEPT)
    publisher.publish(plan.trajectory(max_acceleration=1.0).to_joint_trajectory(JointTrajectory()))
    end = time.monotonic() + 120.0
    while not received and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=1.0)
    states = replay(received[0], rate=100.0)
    assert list(received[0].joint_names) == ["shoulder", "elbow"] and len(states) > 100
    assert space.is_free(states).all()
    assert all(space.motion_is_free(*edge) for edge in pairwise(states))
    np.testing.assert_allclose(states[[0, -1]], [plan.start, plan.goal], atol=1e-9)


def replay(msg, rate):
    """Return the states of a controller that joins points by cubic polynomials, shape (n, dof)."""
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in msg.points]
    rows = ([getattr(p, name) for p in msg.points] for name in ("positions", "velocities"))
    return CubicHermiteSpline(times, *rows)(
        np.append(np.arange(0.0, times[-1], 1.0 / rate), times[-1])
    )

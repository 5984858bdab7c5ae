"""The node's handlers for Nav2, with stand-ins for its messages, and trajectories of arms."""

import importlib.util
import itertools
import math
import os
import subprocess
import sys
import threading
import time
from collections import deque
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from builtin_interfaces.msg import Duration  # noqa: E402
from geometry_msgs.msg import Point32, Polygon, TransformStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Path  # noqa: E402
from trajectory_msgs.msg import JointTrajectory  # noqa: E402

import cspace  # noqa: E402
import planners  # noqa: E402
from tests.helpers.handmade import build_empty  # noqa: E402
from tests.helpers.repository import ROOT  # noqa: E402
from tests.helpers.urdfs import planar, post  # noqa: E402
from tests.ros.test_planner_node import (  # noqa: E402
    FOOTPRINT,
    GOAL,
    KEPT,
    PACKAGE,
    START,
    Cells,
    make_grid,
    make_pose,
    make_room,
    spoil_maps,
)

SPEC = importlib.util.spec_from_file_location(
    "planner_node", PACKAGE / "cspace_nav2_py/planner_node.py"
)
planner_node = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(planner_node)


class Result:
    """nav2_msgs/ComputePathToPose_Result."""

    def __init__(self):
        self.path = Path()
        self.planning_time = Duration()
        self.error_code = 0
        self.error_msg = ""


KIND = SimpleNamespace(Result=Result)
"""nav2_msgs/ComputePathToPose, or ComputePathThroughPoses."""


class Goal:
    """The handle of a goal, which is cancelled once the node has asked some times."""

    def __init__(
        self, start=START, goal=GOAL, max_asks=math.inf, frame="map", use_start=True, via=None
    ):
        poses = make_pose(*start, frame), make_pose(*goal)
        self.request = SimpleNamespace(start=poses[0], use_start=use_start)
        if via is None:
            self.request.goal = poses[1]
        else:
            self.request.goals = [*(make_pose(*place) for place in via), poses[1]]
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
        "drive:=holonomic",
        "time_limit:=30.0",
    ]
    arguments = [word for each in parameters for word in ("-p", each)]
    rclpy.init(args=["--ros-args", *arguments])
    node = planner_node.PlannerNode()
    yield node
    node.destroy_node()
    rclpy.shutdown()


def open_node(monkeypatch, path):
    """Return a node with a saved map, and the start and goal poses of a plan on it."""
    monkeypatch.setitem(planner_node.PARAMETERS, "saved_map", (str(path), "", None))
    return planner_node.PlannerNode()


def test_a_saved_map_with_a_floor_is_planned_on(node, monkeypatch, tmp_path):
    cells = np.repeat((make_room() > 0)[:, :, None], 8, axis=2)
    cells[58:62, :, :6] = False  # the wall is a beam, 0.3 m above the ground
    workspace = cspace.Workspace.from_array(cells, 0.05)
    robot = cspace.Robot.box((0.6, 0.4, 0.25), (0.0, 0.0, 0.125))
    space = cspace.build(workspace, robot, rotations=72, floor=0.01)
    space.save(tmp_path / "hall")
    other = open_node(monkeypatch, tmp_path / "hall")
    try:
        catch_up(other)
        path, code, reason = other.answer(make_pose(*START), [make_pose(*GOAL)])
        assert (code, reason) == (0, "")
        places = [(each.pose.position.x, each.pose.position.y) for each in path.poses]
        assert max(x for x, _ in places) > 1.0 and max(abs(y - 1.0) for _, y in places) < 0.1
        assert other.outline.bounds == (-0.3, -0.2, 0.3, 0.2)
        expected = space.to_occupancy_grid(rotation=0.0)
        assert list(other.shown.data) == list(expected.data)
        assert other.count_subscribers("footprint") == 1  # of the other node
    finally:
        other.destroy_node()


def test_saved_maps_that_are_none_end_the_node(node, monkeypatch, tmp_path):
    with pytest.raises(cspace.errors.CspaceError, match="nowhere"):
        open_node(monkeypatch, tmp_path / "nowhere")
    build_empty((9, 9), cspace.Robot.disc(0.1)).save(tmp_path / "plane")
    with pytest.raises(cspace.errors.InputError, match=r"saved_map .* it must be of x, y and yaw"):
        open_node(monkeypatch, tmp_path / "plane")


def make_filter(kind=1):
    """Return the information of a speed filter, whose lowest value is the quickest."""
    return SimpleNamespace(type=kind, base=100.0, multiplier=-1.0, filter_mask_topic="speed_mask")


def find_highest(node):
    """Return the largest y of a path between two places at y = 1."""
    path, code, reason = node.answer(make_pose(*START), [make_pose(*GOAL)])
    assert (code, reason) == (0, "")
    return max(each.pose.position.y for each in path.poses)


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_a_speed_mask_makes_plans_the_quickest(node, monkeypatch, drive):
    monkeypatch.setitem(planner_node.PARAMETERS, "max_velocity", (1.0, "", (0.0, 100.0)))
    slow = np.zeros((120, 80), dtype=np.int8)
    slow[50:70, :48] = 92  # 8 per cent up to y = 2.4 m
    other = planner_node.PlannerNode()
    try:
        monkeypatch.setattr(
            other, "read_drive", {"holonomic": lambda: None}.get(drive, planners.Differential)
        )
        give(other, make_room(gap=80))
        assert find_highest(other) < 1.2
        other.on_speed_filter(make_filter())
        assert other.mask_subscription.topic_name == "/speed_mask"
        assert find_highest(other) < 1.2  # the mask has not come yet
        other.on_speed_mask(make_grid(slow))
        assert 2.4 < find_highest(other) < 2.8
        assert 2.4 < find_highest(other) < 2.8  # along the last plan
        other.on_speed_mask(make_grid(slow[:, ::-1]))
        assert find_highest(other) < 1.5
        # A mask in another frame, and one that is malformed.
        turned = make_grid(slow)
        turned.header.frame_id = "odom"
        other.on_speed_mask(turned)
        _, code, reason = other.answer(make_pose(*START), [make_pose(*GOAL)])
        assert code == planner_node.UNKNOWN and "speed has the frame 'odom'" in reason
        other.on_speed_mask(make_grid(0 * slow))
        assert other.zones is None and "has no cell with a limit" in str(other.complaints)
        other.on_speed_filter(make_filter(kind=0))
        assert "speed_filter_info.type" in str(other.complaints)
    finally:
        other.destroy_node()
    node.on_speed_filter(make_filter())
    assert node.mask_subscription is None and "max_velocity" in str(node.complaints)


TIMES = itertools.count(1)
"""When messages were sent."""


def give(node, cells):
    """Give the node a map, and wait until it is built."""
    node.on_map(make_grid(cells), {"source_timestamp": next(TIMES)})
    catch_up(node)


def catch_up(node):
    """Wait until the map holds all messages; the first one compiles."""
    end = time.monotonic() + 300.0
    while node.version < node.arrived and time.monotonic() < end:
        time.sleep(0.01)
    assert node.version == node.arrived


def make_update(x, y, cells):
    """Return an update of cells [x, y]."""
    width, height = cells.shape
    box = {"x": x, "y": y, "width": width, "height": height}
    data = cells.T.ravel().tolist()
    return SimpleNamespace(header=SimpleNamespace(frame_id="map"), **box, data=data)


def ask(node, **fields):
    """Execute a goal; return its state and result."""
    goal = Goal(**fields)
    return goal, node.compute_path(KIND, goal)


REQUESTS = f"""
import rclpy
from numba.core import event
from tests.ros.test_nav2_handlers import *

rclpy.init(args=["--ros-args", "-p", "footprint:='{FOOTPRINT}'", "-p", "drive:=differential"])
node = planner_node.PlannerNode()
give(node, make_room())
with event.install_recorder("numba:compile") as compiled:
    _, result = ask(node)
    assert check(node, result.path) == (True, [])
    codes = [result.error_code, ask(node, start=(3.0, 1.0, 0.0))[1].error_code]
    node.explaining.join() if node.explaining.ident else None
print(codes, len(compiled.buffer))
"""
"""Requests to a node that is ready, and the number of functions that they compile."""


@pytest.mark.thorough
def test_the_requests_of_a_ready_node_compile_nothing(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-W", "ignore", "-c", REQUESTS]
    done = subprocess.run(
        command, env=environment, cwd=ROOT, text=True, stdout=subprocess.PIPE, check=True
    )
    assert done.stdout.split("\n")[-2] == "[0, 205] 0"


def test_without_a_map_there_is_a_reason(node):
    goal, result = ask(node)
    assert (goal.state, result.error_code) == ("aborted", planner_node.UNKNOWN)
    assert result.error_msg == "there is no good map yet"


def test_goals_succeed_and_codes_say_why_not(node):
    give(node, make_room())
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
    give(node, make_room(gap=3))
    assert ask(node)[1].error_code == 208
    give(node, make_room())


def test_a_path_goes_through_poses_or_near_them(node):
    give(node, make_room())
    beside = (5.0, 3.0, 0.0)
    _, result = ask(node, goal=(1.0, 3.0, 0.0), via=[beside, GOAL])
    assert result.error_code == 0
    places = [(each.pose.position.x, each.pose.position.y) for each in result.path.poses]
    away = [min(math.dist(place, stop[:2]) for place in places) for stop in (beside, GOAL)]
    assert max(away) < 0.26 and away[0] > 0.01
    node.set_parameters([rclpy.parameter.Parameter("via_tolerance", value=0.0)])
    _, result = ask(node, goal=(1.0, 3.0, 0.0), via=[beside, GOAL])
    places = [(each.pose.position.x, each.pose.position.y) for each in result.path.poses]
    assert (
        max(min(math.dist(place, stop[:2]) for place in places) for stop in (beside, GOAL)) < 1e-6
    )
    node.set_parameters([rclpy.parameter.Parameter("via_tolerance", value=0.25)])
    assert ask(node, via=[(30.0, 1.0, 0.0)])[1].error_code in (304, 306)
    goal = Goal(via=[])
    goal.request.goals = []
    assert node.compute_path(KIND, goal).error_code == 309
    node.last = None


def test_each_parameter_says_what_it_is(node):
    for name in planner_node.PARAMETERS:
        rule = node.describe_parameter(name)
        assert rule.description
        is_number = isinstance(node.option(name), (int, float))
        assert is_number == bool(rule.floating_point_range or rule.integer_range)


@pytest.fixture
def transforms(node):
    """Let tf2 know the robot at the start, and a frame that is shifted and turned."""
    known = {"base_link": START, "odom": (2.0, 3.0, math.pi / 2.0)}

    def look_up(frame, source, _time):
        moved = TransformStamped()
        x, y, yaw = known[source]
        moved.transform.translation.x, moved.transform.translation.y = x, y
        moved.transform.rotation.z, moved.transform.rotation.w = (
            math.sin(yaw / 2),
            math.cos(yaw / 2),
        )
        return moved

    node.transforms = SimpleNamespace(lookup_transform=look_up)
    yield known
    node.transforms = None


def test_poses_in_other_frames_are_transformed(node, transforms):
    give(node, make_room())
    _, result = ask(node, start=(30.0, 1.0, 0.0), use_start=False)
    assert result.path.poses[0].pose.position.x == START[0]
    # (1, 1) of the map is one metre right of and two metres behind the origin of odom.
    _, result = ask(node, start=(-2.0, 1.0, -math.pi / 2.0), frame="odom")
    first = result.path.poses[0].pose
    assert first.position.x == pytest.approx(START[0]) and first.position.y == pytest.approx(
        START[1]
    )
    assert first.orientation.z == pytest.approx(0.0, abs=1e-9)
    assert ask(node, frame="elsewhere")[1].error_code == 202
    goal = Goal(frame="odom")
    goal.request.start.pose.orientation.w = 0.5
    result = node.compute_path(KIND, goal)
    assert result.error_code == 200 and "(0, 0, 0, 0.5)" in result.error_msg


def test_only_the_way_ahead_of_the_robot_is_checked(node, transforms):
    give(node, make_room())
    transforms["base_link"] = (5.0, 1.2, 0.0)
    beyond = (5.0, 2.0, 0.0)
    assert check(node, make_path(IN_WALL, GOAL, beyond)) == (True, [])
    assert check(node, make_path(START, IN_WALL, GOAL, beyond, IN_WALL)) == (False, [4])
    assert check(node, make_path((-2.0, 1.0, 0.0), frame="odom", pose_frame="")) == (True, [])


@pytest.mark.parametrize("tilt, code", [(0.04, 0), (0.06, planner_node.UNKNOWN)])
def test_a_robot_on_a_ramp_is_projected(node, tilt, code):
    give(node, make_room())
    goal = Goal()
    turn = goal.request.start.pose.orientation
    turn.x, turn.w = math.sin(tilt / 2), math.cos(tilt / 2)
    assert node.compute_path(KIND, goal).error_code == code


def test_parameters_change_if_they_may(node):
    def change(name, value):
        return node.set_parameters([rclpy.parameter.Parameter(name, value=value)])[0].successful

    assert not change("drive", "nonsense") and not change("footprint", "[]")
    assert not change("time_limit", -1.0) and not change("step", "a")
    assert change("step", 0.5)
    give(node, make_room())
    assert len(ask(node)[1].path.poses) < 40
    assert change("step", 0.05)


def test_the_same_footprint_builds_nothing(node):
    give(node, make_room())
    corners = [(0.5, 0.25), (0.5, -0.25), (-0.5, -0.25), (-0.5, 0.25)]
    polygon = Polygon(points=[Point32(x=x, y=y) for x, y in corners])
    before = node.arrived
    for _ in range(3):
        node.on_footprint(polygon)
        assert node.arrived == before + 1
    catch_up(node)
    square = node.make_robot("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]")
    node.robot, node.outline = square
    node.corners = None
    give(node, make_room())


def test_a_new_goal_ends_the_one_before(node, monkeypatch):
    real = planners.plan
    searching = threading.Event()

    def search(*ends, stop, **options):
        if not searching.is_set():
            searching.set()
            options |= {"planner": "RRTstar", "previous": None, "time_limit": 600.0}
        return real(*ends, stop=stop, **options)

    give(node, make_room())
    monkeypatch.setattr(planner_node.planners, "plan", search)
    node.last = None
    first = Goal()
    found = []
    thread = threading.Thread(target=lambda: found.append(node.compute_path(KIND, first)))
    thread.start()
    assert searching.wait(300.0)
    goal, _ = ask(node)
    thread.join(300.0)
    assert (first.state, goal.state) == ("aborted", "succeeded")
    assert found[0].error_msg == "a newer goal came"


def test_a_goal_can_be_cancelled_while_it_plans(node, monkeypatch):
    real = planners.plan

    def search_on(*ends, stop, **options):  # the optimising planner goes on until it is stopped
        options |= {"planner": "RRTstar", "previous": None}
        return real(*ends, stop=stop, **options)

    give(node, make_room())
    monkeypatch.setattr(planner_node.planners, "plan", search_on)
    node.last = None
    ask(node, max_asks=50)  # compiles
    node.last = None
    goal, _ = ask(node, max_asks=50)
    assert goal.state == "canceled" and time.thread_time() - goal.asked[49] < 0.2


def test_a_map_that_comes_while_it_plans_counts(node, monkeypatch):
    real = planners.plan
    maps = [make_room(gap=3)]

    def plan_while_a_map_comes(*ends, **options):
        found = real(*ends, **options)
        while maps:
            follower = threading.Thread(target=give, args=[node, maps.pop()])
            follower.start()
            follower.join(60.0)
            assert not follower.is_alive(), "the map waits for the plan"
        return found

    monkeypatch.setattr(planner_node.planners, "plan", plan_while_a_map_comes)
    node.last = None
    goal, result = ask(node)
    assert (goal.state, result.error_code) == ("aborted", 208) and not result.path.poses
    give(node, make_room())


def test_paths_are_valid_until_an_obstacle_comes(node):
    _, result = ask(node)
    assert check(node, result.path) == (True, [])
    give(node, make_room(gap=3))
    is_valid, bad = check(node, result.path)
    assert not is_valid and bad
    give(node, make_room())


def check(node, path):
    """Ask whether a path is valid; return the answer and the bad poses."""
    answer = SimpleNamespace(invalid_pose_indices=[])
    node.is_path_valid(SimpleNamespace(path=path), answer)
    return answer.is_valid, answer.invalid_pose_indices


def make_path(*places, frame="map", pose_frame="map"):
    """Return a path of configurations."""
    path = Path(poses=[make_pose(*place, pose_frame) for place in places])
    path.header.frame_id = frame
    return path


IN_WALL = (3.0, 1.0, 0.0)


@pytest.mark.parametrize(
    "path, answer",
    [
        pytest.param(make_path(), (False, []), id="no pose"),
        pytest.param(make_path(START), (True, []), id="one free pose"),
        pytest.param(make_path(IN_WALL), (False, [0]), id="one pose in collision"),
        pytest.param(make_path(START, START), (True, []), id="twice"),
        pytest.param(make_path(IN_WALL, START), (False, [0, 1]), id="start in collision"),
        pytest.param(make_path(START, GOAL), (False, [1]), id="through the wall"),
        pytest.param(make_path(START, frame="map", pose_frame=""), (True, []), id="frame of path"),
        pytest.param(make_path(START, frame="", pose_frame=""), (False, []), id="no frame"),
        pytest.param(make_path(START, frame="odom", pose_frame=""), (False, []), id="other frame"),
    ],
)
def test_validity_holds_for_poses_and_motions(node, path, answer):
    assert check(node, path) == answer


def fail(*arguments, **options):
    """Stand in for a call that runs out of memory."""
    raise MemoryError


def test_requests_fail_without_memory_and_the_node_goes_on(node, monkeypatch):
    _, result = ask(node)
    with monkeypatch.context() as broken:
        broken.setattr(node.space, "certify_path", fail)
        assert check(node, result.path) == (False, [])
    plan = SimpleNamespace(explain=fail)
    unhandled = []
    with monkeypatch.context() as broken:
        broken.setattr(threading, "excepthook", unhandled.append)
        node.explaining.join(60.0)
        node.explain(plan)
        node.explaining.join(60.0)
    assert not unhandled
    assert check(node, result.path) == (True, [])


def test_messages_without_memory_are_not_planned_on(node, monkeypatch):
    _, result = ask(node)
    update = make_update(0, 0, np.zeros((2, 2), dtype=np.int8))
    calls = [
        (node.on_map, make_grid(make_room())),
        (node.on_update, update),
    ]
    for call, message in calls:
        info = {"source_timestamp": next(TIMES), "publication_sequence_number": None}
        monkeypatch.setattr(node, "option", lambda name: 0.1 if name == "time_limit" else fail())
        call(message, info)
        assert check(node, result.path) == (False, [])
        monkeypatch.undo()
        give(node, make_room())
        assert check(node, result.path) == (True, [])


def make_polygon(*corners):
    """Return the message of a footprint."""
    return Polygon(points=[Point32(x=float(x), y=float(y)) for x, y in corners])


SQUARE = make_polygon((0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2))


@pytest.mark.parametrize(
    "corners",
    [
        [],
        [(0.0, 0.0)],
        [(math.nan, 0.0), (1.0, 0.0), (0.0, 1.0)],
        [(0, 0), (1, 1), (0, 1), (1, 0)],
        pytest.param(None, id="no memory"),
    ],
)
def test_requests_fail_after_a_bad_footprint_until_a_good_one(node, corners, monkeypatch):
    node.on_footprint(SQUARE)
    give(node, make_room())
    _, result = ask(node)
    assert check(node, result.path) == (True, [])
    with monkeypatch.context() as broken:
        if corners is None:
            broken.setattr(node, "make_robot", fail)
        node.on_footprint(make_polygon(*corners or []))
    node.on_map(make_grid(make_room()), {"source_timestamp": next(TIMES)})
    goal, failed = ask(node)
    assert (goal.state, failed.error_msg) == ("aborted", "the newest footprint was refused")
    assert not failed.path.poses and check(node, result.path) == (False, [])
    node.on_footprint(SQUARE)
    catch_up(node)
    assert check(node, result.path) == (True, [])


def test_requests_fail_after_a_bad_map_until_a_good_one(node):
    for bad in spoil_maps():
        give(node, make_room())
        node.on_map(bad, {"source_timestamp": next(TIMES)})
        assert ask(node)[1].error_msg == "there is no good map yet"
    for field, fault in (("frame_id", "''"), ("orientation", "(0, 0, 0, 0)")):
        bad = make_grid(make_room())
        if field == "frame_id":
            bad.header.frame_id = ""
        else:
            bad.info.origin.orientation.w = 0.0
        node.on_map(bad, {"source_timestamp": next(TIMES)})
        assert any(field in said and fault in said for said in node.complaints)
    node.on_footprint(make_polygon((0.1, 0.1), (-0.1, 0.1), (0.0, -0.1)))  # builds nothing
    assert ask(node)[1].error_msg == "there is no good map yet"
    node.on_footprint(SQUARE)
    give(node, make_room())
    assert len(ask(node)[1].path.poses) > 10


def test_a_reader_that_cannot_be_served_ends_nothing(node, monkeypatch):
    give(node, make_room())
    asked = []
    monkeypatch.setattr(node, "find_doubt", lambda: asked.append(1) or fail())
    reader = node.create_subscription(OccupancyGrid, "cspace_planner/map", asked.append, KEPT)
    end = time.monotonic() + 300.0
    while 1 not in asked and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=1.0)
    assert 1 in asked
    node.destroy_subscription(reader)
    monkeypatch.undo()
    give(node, make_room())
    assert len(ask(node)[1].path.poses) > 10


class Publisher(Cells):
    """A costmap, and the queues on the way to the node.

    `meets` counts the steps of a discovery: the publisher knows the node, then they know each
    other. Only what was sent last is kept for a node that does not know the publisher yet.
    """

    def __init__(self, node, always_full, is_watched):
        super().__init__(np.zeros((4, 3), dtype=np.int8), always_full)
        self.node = node
        self.is_watched = is_watched  # by another listener, so that updates are numbered
        self.number = self.meets = 0
        self.queues = {"updates": [], "live": [], "kept": []}
        self.latest = {name: [] for name in self.queues}

    def meet(self):
        """Go on with the discovery."""
        self.meets += 1
        if self.meets == 2:
            self.queues |= {name: list(latest) for name, latest in self.latest.items()}

    def cycle(self, is_fast=False):
        """Publish; a fast cycle replaces the last message, if it is still on the way."""
        is_heard = self.is_watched or self.meets > 0
        grid, window = self.end_cycle(is_heard, is_heard)
        info = {"source_timestamp": next(TIMES)}
        if grid is not None:
            self.send("kept", (grid, info), is_fast)
            if self.meets:
                self.send("live", (grid, info, True), is_fast)
        if window is not None:
            self.number += 1
            info["publication_sequence_number"] = self.number
            self.send("updates", (make_update(*window), info), is_fast)

    def send(self, name, message, is_fast):
        """Keep a message, and let it travel if they know each other."""
        self.latest[name] = [message]
        if self.meets > 1:
            queue = self.queues[name]
            self.queues[name] = [*(queue[:-1] if is_fast else queue), message]

    def deliver(self, name):
        """Give the node the next message of a queue."""
        if self.queues[name]:
            message = self.queues[name].pop(0)
            (self.node.on_update if name == "updates" else self.node.on_map)(*message)


NAMES = ["updates", "live", "kept"]
CHANGES = st.tuples(
    st.just("change"), st.integers(0, 3), st.integers(0, 2), st.sampled_from([0, 100])
)
CYCLES = st.tuples(st.just("cycle"), st.booleans())
STEPS = st.one_of(
    st.tuples(CHANGES),
    st.tuples(CYCLES),
    st.tuples(CHANGES, CYCLES),
    st.tuples(CHANGES, CYCLES, CHANGES, st.just(("grow",)), CYCLES),
    st.tuples(st.tuples(st.just("deliver"), st.sampled_from(NAMES))),
    st.tuples(st.sampled_from([("meet",), ("meet",), ("grow",)])),
)


@settings(max_examples=500, deadline=None)
@given(st.lists(STEPS, max_size=40), st.booleans(), st.booleans(), st.permutations(NAMES))
def test_a_grid_without_doubt_is_the_publishers(node, steps, always_full, is_watched, order):
    """Whatever is lost or late: once all came, the node doubts, or has the publisher's cells."""
    forget(node)
    publisher = Publisher(node, always_full, is_watched)
    end = [("cycle",), ("meet",), ("meet",)]
    for name, *arguments in itertools.chain(*steps, end):
        getattr(publisher, name)(*arguments)
    for is_last in (False, True):
        for name in order:
            while publisher.queues[name]:
                publisher.deliver(name)
        doubt = node.find_doubt()
        if not doubt:
            data = make_grid(publisher.cells).data
            assert node.grid.info.width == len(publisher.cells) and node.grid.data == data
        assert not (doubt and is_last), "a full grid does not help"
        publisher.grow()
        publisher.cycle()


def test_doubt_stays_when_updates_were_forgotten_or_cannot_be_heard(node):
    forget(node)
    publisher = Publisher(node, always_full=False, is_watched=False)
    steps = [("meet",), ("meet",), ("cycle",)]
    for x in range(3):  # the node keeps two
        steps += [("change", x, 0, 100), ("cycle",), ("deliver", "updates")]
    for name, *arguments in [*steps, ("deliver", "live")]:
        getattr(publisher, name)(*arguments)
    assert node.find_doubt()
    grid = make_grid(publisher.cells)
    forget(node)
    node.on_map(grid, {"source_timestamp": next(TIMES)})
    node.count_publishers = lambda topic: 0  # the costmap ended
    assert node.find_doubt()
    forget(node)
    node.on_map(grid, {"source_timestamp": next(TIMES)}, is_live=True)
    assert not node.find_doubt()
    node.update_subscription = None  # map_msgs is not installed
    assert node.find_doubt()


def forget(node):
    """Let the node be as at its start, with a publisher of updates, and let it not build."""
    node.grid = node.workspace = None
    node.sent = node.since = node.number = 0
    node.is_live = node.has_updates = False
    node.updates = deque(maxlen=2)
    node.count_publishers = lambda topic: 1
    node.update_subscription = SimpleNamespace(get_publisher_count=lambda: 1)
    node.news = threading.Event()


def test_a_controller_follows_an_arms_trajectory(node, tmp_path):
    space = cspace.build_arm_space({"post": post()}, cspace.Arm.from_urdf(planar(tmp_path)))
    plan = planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=10.0, seed=1)
    received = []
    publisher = node.create_publisher(JointTrajectory, "controller/joint_trajectory", KEPT)
    node.create_subscription(JointTrajectory, "controller/joint_trajectory", received.append, KEPT)
    publisher.publish(plan.trajectory(max_acceleration=1.0).to_joint_trajectory(JointTrajectory()))
    end = time.monotonic() + 600.0
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

"""The gate node in lockstep with a simulated robot; run by ``nox -s ros``."""

import importlib.util
import math
import os
import signal
from concurrent.futures import Future
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation
from shapely import affinity

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from geometry_msgs.msg import TransformStamped, Twist  # noqa: E402
from rclpy.clock import ClockType  # noqa: E402
from sensor_msgs.msg import LaserScan  # noqa: E402

from cspace.errors import InputError  # noqa: E402
from tests.helpers.repository import ROOT  # noqa: E402
from tests.ros.test_planner_node import PACKAGE, interrupt_node, make_grid, make_room  # noqa: E402

SPEC = importlib.util.spec_from_file_location("gate_node", PACKAGE / "cspace_nav2_py/gate_node.py")
gate_node = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(gate_node)

NOW = rclpy.time.Time(seconds=9, clock_type=ClockType.ROS_TIME)
BODY = shapely.Polygon(gate_node.FOOTPRINT)
WALL = shapely.box(2.9, 0.0, 3.1, 3.0)
WALLS = shapely.union_all([WALL, shapely.LinearRing([(0, 0), (6, 0), (6, 4), (0, 4)])])
POSTS = shapely.union_all(
    [shapely.Point(1.5, 2.6).buffer(0.1), shapely.Point(4.5, 1.2).buffer(0.1)]
)


class Robot:
    """A robot that does what it is told, and a laser that sees posts the map lacks."""

    def __init__(self):
        self.pose = np.array([1.0, 1.0, 0.0])
        self.stamp = NOW
        self.twist = np.zeros(2)
        self.turn = (0.0, 0.0, 0.0, 1.0)  # of the laser on the robot

    def can_transform(self, _map, _frame, time):
        """Return True if a time is not later than the newest one."""
        return time.nanoseconds <= self.stamp.nanoseconds

    def lookup_transform(self, _map, frame, _time):
        """Return where the robot, and its laser, is."""
        moved = TransformStamped()
        x, y, yaw = self.pose.tolist()
        moved.header.stamp = self.stamp.to_msg()
        moved.transform.translation.x, moved.transform.translation.y = x, y
        turn = Rotation.from_rotvec([0.0, 0.0, yaw])
        if frame == "laser":
            turn *= Rotation.from_quat(self.turn)
        rotation = moved.transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = turn.as_quat().tolist()
        return moved

    def publish(self, command):
        """Take a command."""
        self.twist = np.array([command.linear.x, command.angular.z])

    def drive(self):
        """Drive for a cycle; return whether the body touches anything meanwhile."""
        touches = False
        for _ in range(10):
            v, omega = self.twist * gate_node.DT / 10
            x, y, yaw = self.pose
            middle = yaw + omega / 2
            self.pose = np.array([x + v * math.cos(middle), y + v * math.sin(middle), yaw + omega])
            turned = affinity.rotate(BODY, self.pose[2], (0, 0), use_radians=True)
            body = affinity.translate(turned, *self.pose[:2])
            touches |= body.intersects(WALLS) or body.intersects(POSTS)
        return touches

    def scan(self):
        """Return what the laser sees of the posts."""
        msg = LaserScan(angle_min=-math.pi, angle_increment=math.pi / 180, range_max=20.0)
        msg.header.frame_id, msg.header.stamp = "laser", self.stamp.to_msg()
        x, y, yaw = self.pose
        angles = yaw - math.pi + np.arange(360) * math.pi / 180
        ends = np.stack([x + 20 * np.cos(angles), y + 20 * np.sin(angles)], axis=1)
        rays = shapely.linestrings([[(x, y), end] for end in ends.tolist()])
        hits = shapely.distance(shapely.Point(x, y), shapely.intersection(rays, POSTS))
        msg.ranges = np.where(np.isfinite(hits), hits, np.inf).tolist()
        return msg


@pytest.fixture(scope="module")
def node():
    rclpy.init()
    node = gate_node.GateNode(None)
    node.on_map(make_grid(make_room()))
    node.building.result()
    yield node
    node.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def robot(node, monkeypatch):
    """Put a robot at rest into the room, and let the clocks be ours."""
    robot = Robot()
    node.transforms = node.publisher = robot
    node.ramp = [(0.0, 0.0)]
    node.scans.clear()
    node.heard = dict.fromkeys(node.heard, 0.0)
    robot.clock = 0.0
    monkeypatch.setattr(gate_node.time, "monotonic", lambda: robot.clock)
    node.get_clock = lambda: SimpleNamespace(now=lambda: robot.stamp)
    return robot


def step(node, robot, twist, silent=""):
    """Go on by a cycle, in which one input may be silent; return whether the robot touches."""
    robot.clock += gate_node.DT * (10 if silent == "cycle" else 1)
    if silent != "scan":
        node.on_scan(robot.scan())
    if silent != "command":
        command = Twist()
        command.linear.x, command.angular.z = twist
        node.on_command(command)
    node.cycle()
    return robot.drive()


DEAR = [pytest.param(seed, marks=pytest.mark.thorough) for seed in range(20, 200)]


@pytest.mark.parametrize("seed", [*range(20), *DEAR])
def test_nothing_is_touched_on_random_drives(node, robot, seed):
    rng = np.random.default_rng(seed)
    moved = 0.0
    for k in range(100):
        if k % 10 == 0:
            twist = rng.normal((0.5, 0.0), (0.4, 1.0)).tolist()
        assert not step(node, robot, twist)
        moved += abs(robot.twist[0]) * gate_node.DT
    assert moved > 0.1


@pytest.mark.parametrize("x", [1.5 - 0.1 - 0.301, 1.5 - 0.1 - 0.32])
def test_it_drives_away_from_what_it_nearly_touches_and_not_nearer(node, robot, x):
    """A post is 1 and 20 mm ahead, as a person who has stepped up."""
    robot.pose = np.array([x, 2.6, 0.0])
    for twist in ((0.2, 0.0), (0.2, 0.5), (0.0, 0.5)):
        for _ in range(4):
            assert not step(node, robot, twist)
            assert not robot.twist.any()
    for _ in range(20):
        assert not step(node, robot, (-0.2, 0.0))
    assert robot.pose[0] < x - 0.15
    for _ in range(100):
        assert not step(node, robot, (0.2, 0.0))


@pytest.mark.parametrize("silent", ["scan", "command", "cycle", "pose", "map"])
def test_it_stops_without_an_input(node, robot, silent, monkeypatch):
    for _ in range(10):
        assert not step(node, robot, (0.6, 0.3))
    assert robot.twist[0] > 0.5
    if silent == "pose":

        def fail(*_):
            raise LookupError("base_link is unknown")

        monkeypatch.setattr(robot, "lookup_transform", fail)
    if silent == "map":
        monkeypatch.setattr(node, "building", Future())
    speeds = [robot.twist[0]]
    for _ in range(30):
        assert not step(node, robot, (0.6, 0.3), silent)
        speeds.append(robot.twist[0])
    assert not robot.twist.any() and np.diff(speeds[1:]).max() <= 0.0
    assert np.diff(speeds).min() >= -1.0 * gate_node.DT - 1e-9  # no harder than it can


def drive_off(node, robot):
    """Drive ahead until the robot is quick."""
    for _ in range(10):
        assert not step(node, robot, (0.6, 0.3))
    assert robot.twist[0] > 0.5


def test_it_brakes_no_harder_than_it_can(node, robot):
    drive_off(node, robot)
    before = robot.twist[0]
    step(node, robot, (0.0, 0.0))
    assert 0.0 < before - robot.twist[0] <= 1.0 * gate_node.DT + 1e-9


def count_moving_cycles(node, robot):
    """Return how many of the next cycles move the robot, without a scan from the test."""
    moving = 0
    for _ in range(30):
        assert not step(node, robot, (0.6, 0.3), "scan")
        moving += robot.twist.any()
    return moving


def break_map(msg):
    msg.info.resolution = 0.0


def fill_map(msg):
    msg.data = [100] * len(msg.data)


@pytest.mark.parametrize("damage", [break_map, fill_map])
def test_it_brakes_on_a_map_without_use(node, robot, damage, monkeypatch):
    monkeypatch.setattr(node, "building", node.building)
    drive_off(node, robot)
    bad = make_grid(make_room())
    damage(bad)
    node.on_map(bad)
    node.building.exception()
    for _ in range(30):
        assert not step(node, robot, (0.6, 0.3))
    assert not robot.twist.any()


def test_it_brakes_while_a_second_map_is_built(node, robot, monkeypatch):
    monkeypatch.setattr(node, "building", node.building)
    monkeypatch.setattr(node, "builder", SimpleNamespace(submit=lambda *_: Future()))
    drive_off(node, robot)
    node.on_map(make_grid(make_room()))
    speeds = []
    for _ in range(30):
        assert not step(node, robot, (0.6, 0.3))
        speeds.append(robot.twist[0])
    assert speeds[0] < 0.6 and not robot.twist.any() and np.diff(speeds).max() <= 0.0


def test_a_second_map_waits_for_its_own_scan(node, robot):
    drive_off(node, robot)
    node.on_map(make_grid(make_room()))
    node.building.result()
    assert count_moving_cycles(node, robot) < 15
    drive_off(node, robot)


def test_tf_is_asked_for_the_frame_of_the_map(node, robot, monkeypatch):
    hall = make_grid(make_room())
    hall.header.frame_id = "hall"
    monkeypatch.setattr(node, "building", node.building)
    node.on_map(hall)
    node.building.result()
    asked = []

    def ask(name, frame, *rest):
        asked.append(frame)
        return getattr(Robot, name)(robot, frame, *rest)

    for name in ("can_transform", "lookup_transform"):
        monkeypatch.setattr(robot, name, partial(ask, name))
    drive_off(node, robot)
    assert set(asked) == {"hall"}


@pytest.mark.parametrize(
    "ranges, drives",
    [
        pytest.param([math.inf] * 360, True, id="nothing is near"),
        pytest.param([0.05] * 360, True, id="all below the least range"),
        pytest.param([1e6], True, id="a point far away"),
        pytest.param([-math.inf] * 360, False, id="all too near"),
        pytest.param([math.nan] * 360, False, id="no number"),
        pytest.param([], False, id="empty"),
    ],
)
def test_scans_without_a_point_in_range(node, robot, ranges, drives):
    for _ in range(10):
        msg = robot.scan()
        msg.ranges, msg.range_min, msg.range_max = ranges, 0.1, math.inf
        node.on_scan(msg)
        assert not step(node, robot, (0.6, 0.3), "scan")
    assert robot.twist.any() == drives


@pytest.mark.parametrize("seconds", [-1.0, 1.0, -9.0])
def test_a_scan_counts_by_its_stamp(node, robot, seconds):
    drive_off(node, robot)
    for _ in range(20):
        msg = robot.scan()
        msg.header.stamp = (NOW + rclpy.duration.Duration(seconds=seconds)).to_msg()
        node.on_scan(msg)
        assert not step(node, robot, (0.6, 0.3), "scan")
    assert not robot.twist.any()


@pytest.mark.parametrize("command", [(math.nan, 0.0), (0.5, math.nan), (0.5, math.inf)])
def test_it_brakes_on_commands_that_are_no_numbers(node, robot, command):
    drive_off(node, robot)
    for _ in range(20):
        assert not step(node, robot, command)
    assert not robot.twist.any()


def place_scan(node, msg):
    """Let the node place a scan; return its map."""
    node.on_scan(msg)
    space = node.building.result().space
    node.place_scans(space)
    return space


def place_points(node, robot, ranges):
    """Return the points of a scan in the map."""
    msg = robot.scan()
    msg.ranges, msg.angle_min, msg.angle_increment = ranges, -0.5, 1.0
    return np.asarray(place_scan(node, msg).obstacles["scan"].centers)


def test_points_are_gone_with_the_next_scan(node, robot):
    assert len(place_points(node, robot, [2.0, 2.0])) == 2
    msg = robot.scan()
    msg.ranges = [math.inf] * 360
    assert "scan" not in place_scan(node, msg).obstacles


def test_points_beyond_the_lasers_own_range_are_none(node, robot):
    assert len(place_points(node, robot, [25.0, 2.0])) == 1


def test_a_scan_waits_until_tf_knows_its_time(node, robot):
    msg = robot.scan()
    later = NOW + rclpy.duration.Duration(seconds=0.1)
    msg.header.stamp = later.to_msg()
    space = place_scan(node, msg)
    assert len(node.scans) == 1
    robot.stamp = later
    node.place_scans(space)
    assert not node.scans


@pytest.mark.parametrize("seconds, age", [(0.2, 0.2), (-0.2, 0.0), (-1.0, None)])
def test_a_scan_is_as_old_as_its_stamp(node, robot, seconds, age):
    robot.clock = 5.0
    now = NOW + rclpy.duration.Duration(seconds=seconds)
    node.get_clock = lambda: SimpleNamespace(now=lambda: now)
    if age is None:  # of the future
        with pytest.raises(TimeoutError, match=r"the scan is -1\.00 s old"):
            place_scan(node, robot.scan())
    else:
        place_scan(node, robot.scan())
        assert node.heard["scan"] == pytest.approx(5.0 - age)


def test_a_laser_upside_down_or_tilted_is_placed_in_three_dimensions(node, robot):
    left = robot.pose[:2] + 2.0 * np.array([math.cos(0.5), math.sin(0.5)])
    right = left * (1, -1) + (0, 2 * robot.pose[1])
    np.testing.assert_allclose(place_points(node, robot, [30.5, 2.0]), [left], atol=1e-6)
    robot.turn = (1.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(place_points(node, robot, [30.5, 2.0]), [right], atol=1e-6)
    robot.turn = tuple(Rotation.from_euler("y", 0.5).as_quat())
    tilted = robot.pose[:2] + 2.0 * np.array([math.cos(0.5) ** 2, math.sin(0.5)])
    np.testing.assert_allclose(place_points(node, robot, [30.5, 2.0]), [tilted], atol=1e-6)


@pytest.mark.parametrize("turn", [(math.nan, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)])
def test_it_brakes_if_the_laser_has_no_rotation(node, robot, turn, monkeypatch):
    drive_off(node, robot)
    look_up = robot.lookup_transform

    def spoil(*names):
        moved = look_up(*names)
        rotation = moved.transform.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = turn
        return moved

    monkeypatch.setattr(robot, "lookup_transform", spoil)
    for _ in range(20):
        assert not step(node, robot, (0.6, 0.3))
    assert not robot.twist.any()


def test_a_pose_that_is_old_counts_as_none(node, robot):
    space = node.building.result().space
    assert node.locate(space) == pytest.approx((1.0, 1.0, 0.0))
    old = robot.lookup_transform
    robot.lookup_transform = lambda *names: shift(old(*names))
    with pytest.raises(TimeoutError, match=r"pose of base_link is 1\.00 s old"):
        node.locate(space)


def test_a_tilted_robot_has_no_pose(node, robot):
    level = robot.lookup_transform
    robot.lookup_transform = lambda *names: tilt(level(*names))
    with pytest.raises(InputError, match=r"0\.2"):
        node.locate(node.building.result().space)


def tilt(moved):
    """Tilt a transform."""
    rotation = moved.transform.rotation
    rotation.x, _, _, rotation.w = Rotation.from_euler("x", 0.2).as_quat().tolist()
    return moved


def shift(moved):
    """Make a transform a second older."""
    moved.header.stamp.sec -= 1
    return moved


TF = """
class Buffer: pass
class TransformListener:
    def __init__(self, *_): pass
"""


@pytest.mark.parametrize(
    "moment, number",
    [
        (("Node", "create_publisher"), signal.SIGTERM),
        (("Executor", "get_nodes"), signal.SIGTERM),
        (("Executor", "get_nodes"), signal.SIGINT),
        (("Executor", "get_nodes"), 0),
    ],
)
def test_an_interrupt_ends_it_with_0_and_a_fault_with_1(moment, number, tmp_path):
    (tmp_path / "tf2_ros.py").write_text(TF)
    path = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    busy = {"BUSY": "a thread computes"} if number else {}
    code, errors = interrupt_node("gate_node.py", moment, int(number), PYTHONPATH=path, **busy)
    assert code == (0 if number else 1), errors
    assert ("RuntimeError: a fault" in errors) == ("Traceback" in errors) == (not number), errors

"""The gate of examples/ros in lockstep with a simulated robot; run by ``nox -s ros``."""

import importlib.util
import math
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from shapely import affinity

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from geometry_msgs.msg import TransformStamped, Twist  # noqa: E402
from rclpy.clock import ClockType  # noqa: E402
from sensor_msgs.msg import LaserScan  # noqa: E402

from tests.helpers.repository import ROOT  # noqa: E402
from tests.ros.test_planner_node import make_grid, make_room  # noqa: E402

SPEC = importlib.util.spec_from_file_location("gate_node", ROOT / "examples/ros/gate_node.py")
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

    def lookup_transform(self, _map, _frame, _time):
        """Return where the robot, and its laser, is."""
        moved = TransformStamped()
        x, y, yaw = self.pose.tolist()
        moved.header.stamp = self.stamp.to_msg()
        moved.transform.translation.x, moved.transform.translation.y = x, y
        moved.transform.rotation.z, moved.transform.rotation.w = (
            math.sin(yaw / 2),
            math.cos(yaw / 2),
        )
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
    yield node
    node.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def robot(node, monkeypatch):
    """Put a robot at rest into the room, and let the clocks be ours."""
    robot = Robot()
    node.transforms = node.publisher = robot
    node.ramp = [(0.0, 0.0)]
    node.heard = dict.fromkeys(node.heard, 0.0)
    robot.clock = 0.0
    monkeypatch.setattr(gate_node.time, "monotonic", lambda: robot.clock)
    node.get_clock = lambda: SimpleNamespace(now=lambda: robot.stamp)
    return robot


def step(node, robot, twist, silent=""):
    """Go on by a cycle, in which one input may be silent; return whether the robot touches."""
    robot.clock += gate_node.DT
    if silent != "scan":
        node.on_scan(robot.scan())
    if silent != "command":
        command = Twist()
        command.linear.x, command.angular.z = twist
        node.on_command(command)
    if silent == "cycle":
        robot.clock += 10 * gate_node.DT
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
        monkeypatch.setattr(node, "gate", None)
    speeds = []
    for _ in range(30):
        assert not step(node, robot, (0.6, 0.3), silent)
        speeds.append(robot.twist[0])
    assert not robot.twist.any() and np.diff(speeds).max() <= 0.0


def test_a_map_that_cannot_be_read_changes_nothing(node):
    gate, bad = node.gate, make_grid(make_room())
    bad.info.resolution = 0.0
    node.on_map(bad)
    assert node.gate is gate


def test_a_pose_that_is_old_counts_as_none(node, robot):
    assert node.locate("base_link") == pytest.approx((1.0, 1.0, 0.0))
    old = robot.lookup_transform
    robot.lookup_transform = lambda *names: shift(old(*names))
    with pytest.raises(TimeoutError, match=r"pose of base_link is 1\.00 s old"):
        node.locate("base_link")


def shift(moved):
    """Make a transform a second older."""
    moved.header.stamp.sec -= 1
    return moved

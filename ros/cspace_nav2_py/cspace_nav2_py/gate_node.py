"""A ROS 2 node that slows commands down so far that the robot can stop before it touches anything.

It stands between ``cmd_vel_smoothed`` and ``cmd_vel``. Callbacks only store; all work is done in
one cycle, which brakes along the proven way to rest if anything in it fails.
"""

import os
import signal
import threading
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import LaserScan

import cspace

FOOTPRINT = [(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)]
DT, MAX_AGE = 0.05, 0.3
"""Seconds of a cycle, and after which a command, a scan or a pose is too old."""
MAX_RANGE = 30.0
"""Metres from the laser beyond which no point can matter before the next scan."""


class GateNode(Node):
    """Lets through the fastest proven share of each command."""

    def __init__(self, transforms):
        super().__init__("cspace_gate")
        self.transforms = transforms  # a tf2_ros.Buffer
        self.wanted = (0.0, 0.0)
        self.ramp = [(0.0, 0.0)]  # what it drives, then the proven way to rest
        self.scans = deque(maxlen=10)  # until tf knows where the laser was
        self.heard = dict.fromkeys(("command", "scan", "cycle"), -np.inf)
        self.builder, self.building = ThreadPoolExecutor(1), Future()  # of the gate
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(OccupancyGrid, "map", self.on_map, kept)
        self.create_subscription(LaserScan, "scan", self.on_scan, 1)
        self.create_subscription(Twist, "cmd_vel_smoothed", self.on_command, 1)
        self.publisher = self.create_publisher(Twist, "cmd_vel", 1)
        # Other clocks may stand still or jump.
        self.create_timer(DT, self.cycle, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_map(self, msg):
        """Build the gate of a map in a thread; the robot brakes until it and a scan are there."""
        self.building.cancel()
        self.building = self.builder.submit(self.build, msg)
        self.heard["scan"] = -np.inf

    def on_scan(self, msg):
        """Keep a scan."""
        self.scans.append(msg)

    def on_command(self, msg):
        """Keep the newest command."""
        self.wanted, self.heard["command"] = (msg.linear.x, msg.angular.z), time.monotonic()

    def build(self, msg):
        """Return the gate of a map."""
        workspace = cspace.Workspace.from_occupancy_grid(msg)
        space = cspace.build(workspace, cspace.Robot.from_footprint(FOOTPRINT), rotations=72)
        gate = cspace.Gate(space, dt=DT, tracking=0.02, max_deceleration=(1.0, 2.0))
        middle = 0.5 * (np.array(space.grid.lower) + space.grid.upper)
        space.add_obstacle("scan", [middle], radius=0.03)  # compiles, as the next line does
        gate.slow_down((*middle, 0.0), (0.1, 0.1))
        self.get_logger().info(f"stops within {100 * gate.stop_distance((0.5, 0.0)):.0f} cm")
        return gate

    def find_age(self, stamp, name):
        """Return the seconds since a stamp; raise an error if it is old, or of the future."""
        age = (self.get_clock().now() - rclpy.time.Time.from_msg(stamp)).nanoseconds / 1e9
        if abs(age) > MAX_AGE:
            raise TimeoutError(f"the {name} is {age:.2f} s old")
        return age

    def place_scans(self, space):
        """Set the points of scans whose place tf knows as obstacles."""
        while self.scans:
            frame, stamp = self.scans[0].header.frame_id, self.scans[0].header.stamp
            when = rclpy.time.Time.from_msg(stamp)
            if not self.transforms.can_transform(space.frame_id, frame, when):
                return
            msg = self.scans.popleft()
            age = self.find_age(stamp, "scan")
            moved = self.transforms.lookup_transform(space.frame_id, frame, when).transform
            place, turn = moved.translation, moved.rotation
            points = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply(list_points(msg))
            points = points[:, :2] + (place.x, place.y)
            if len(points):
                space.add_obstacle("scan", points, radius=0.03)
            elif "scan" in space.obstacles:
                space.remove_obstacle("scan")
            self.heard["scan"] = time.monotonic() - max(age, 0.0)

    def locate(self, space):
        """Return the robot's configuration; raise an error if it is unknown, old or tilted."""
        moved = self.transforms.lookup_transform(space.frame_id, "base_link", rclpy.time.Time())
        self.find_age(moved.header.stamp, "pose of base_link")
        place, turn = moved.transform.translation, moved.transform.rotation
        pose = {"position": place, "orientation": turn}
        msg = {"header": {"frame_id": space.frame_id}, "pose": pose}
        return cspace.ros.configuration_of(msg, space, tilt_tolerance=0.1)

    def slow_down(self, now):
        """Return the commands from now to rest; raise an error if anything is missing or late."""
        if not self.building.done():
            raise TimeoutError("no map is built")
        gate = self.building.result()
        self.place_scans(gate.space)
        late = [name for name, at in self.heard.items() if not now - at <= MAX_AGE]
        if late:
            raise TimeoutError(f"no {', '.join(late)}; {len(self.scans)} scans wait for tf")
        pose = self.locate(gate.space)
        options = {"twist_now": self.ramp[0], "leaving": True}
        return gate.slow_down(pose, self.wanted, **options).commands

    def cycle(self):
        """Send the next command; brake along the proven ramp if anything fails."""
        now = time.monotonic()
        try:
            self.ramp = self.slow_down(now).tolist()
        except Exception as error:  # whatever it is, the robot must stop
            self.ramp = self.ramp[1:] or [(0.0, 0.0)]
            self.get_logger().warning(f"stops: {error!r}", throttle_duration_sec=1.0)
        self.heard["cycle"] = now
        command = Twist()
        command.linear.x, command.angular.z = self.ramp[0]
        self.publisher.publish(command)


def list_points(msg):
    """Return the points of a scan in the frame of the laser, shape (n, 3)."""
    ranges = np.asarray(msg.ranges, dtype=float)
    ranges[np.isneginf(ranges)] = msg.range_min  # an object too near to measure
    if np.isnan(ranges).all():
        raise ValueError("the scan has no ray that was measured")
    angles = msg.angle_min + msg.angle_increment * np.arange(len(ranges))
    seen = (ranges >= msg.range_min) & (ranges <= min(msg.range_max, MAX_RANGE))
    ranges, angles = ranges[seen], angles[seen]
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles), 0.0 * angles], axis=1)


def main():
    """Run the node until it is interrupted; its last command is to stand."""
    import tf2_ros

    ended = threading.Event()  # an exception could come anywhere, and be lost there
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = GateNode(tf2_ros.Buffer())
    node.listener = tf2_ros.TransformListener(node.transforms, node)
    try:
        while not ended.is_set():
            rclpy.spin_once(node, timeout_sec=DT)
    finally:
        node.publisher.publish(Twist())
        node.publisher.wait_for_all_acked(Duration(seconds=1.0))
        node.destroy_node()
    os._exit(0)  # a map may be built for minutes


if __name__ == "__main__":
    main()

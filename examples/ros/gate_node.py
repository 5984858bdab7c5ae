"""A ROS 2 node that slows commands down so far that the robot can stop before it touches anything.

It stands between ``cmd_vel_smoothed`` and ``cmd_vel``, and stops if an input falls silent.
"""

import time

import numpy as np
import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import LaserScan

import cspace
from cspace.errors import CspaceError

FOOTPRINT = [(0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2)]
DT, MAX_AGE = 0.05, 0.3
"""Seconds of a cycle, and after which a command, a scan or a pose is too old."""


class GateNode(Node):
    """Lets through the fastest proven share of each command."""

    def __init__(self, transforms):
        super().__init__("cspace_gate")
        self.transforms = transforms  # a tf2_ros.Buffer
        self.gate, self.wanted = None, (0.0, 0.0)
        self.ramp = [(0.0, 0.0)]  # what it drives, then the proven way to rest
        self.heard = dict.fromkeys(("command", "scan", "cycle"), -np.inf)
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(OccupancyGrid, "map", self.on_map, kept)
        self.create_subscription(LaserScan, "scan", self.on_scan, 1)
        self.create_subscription(Twist, "cmd_vel_smoothed", self.on_command, 1)
        self.publisher = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_timer(DT, self.cycle)

    def on_map(self, msg):
        """Build the map; the robot stands meanwhile. A bad message changes nothing."""
        try:
            workspace = cspace.Workspace.from_occupancy_grid(msg)
        except CspaceError as error:
            self.get_logger().error(f"map: {error}")
            return
        space = cspace.build(workspace, cspace.Robot.from_footprint(FOOTPRINT), rotations=72)
        self.gate = cspace.Gate(space, dt=DT, tracking=0.02, max_deceleration=(1.0, 2.0))
        self.gate.slow_down(space.sample_free(), (0.1, 0.1))  # compiles
        self.get_logger().info(f"stops within {100 * self.gate.stop_distance((0.5, 0.0)):.0f} cm")

    def on_scan(self, msg):
        """Set the points of a scan as obstacles."""
        angles = msg.angle_min + msg.angle_increment * np.arange(len(msg.ranges))
        ranges = np.asarray(msg.ranges)
        seen = (ranges >= msg.range_min) & (ranges <= msg.range_max)
        try:
            x, y, yaw = self.locate(msg.header.frame_id)
        except Exception:  # tf2 has several kinds; without scans, the robot stops
            return
        points = complex(x, y) + ranges[seen] * np.exp(1j * (angles[seen] + yaw))
        if self.gate is not None:
            self.gate.space.add_obstacle("scan", points.view(float).reshape(-1, 2), radius=0.03)
            self.heard["scan"] = time.monotonic()

    def on_command(self, msg):
        """Keep the newest command."""
        self.wanted, self.heard["command"] = (msg.linear.x, msg.angular.z), time.monotonic()

    def locate(self, frame):
        """Return x, y and yaw of a frame in the map; raise an error if it is unknown or old."""
        moved = self.transforms.lookup_transform("map", frame, rclpy.time.Time())
        age = self.get_clock().now() - rclpy.time.Time.from_msg(moved.header.stamp)
        if age.nanoseconds > 1e9 * MAX_AGE:
            raise TimeoutError(f"the pose of {frame} is {age.nanoseconds / 1e9:.2f} s old")
        place, turn = moved.transform.translation, moved.transform.rotation
        return place.x, place.y, 2.0 * np.arctan2(turn.z, turn.w)

    def cycle(self):
        """Send the next command; brake along the proven ramp if anything is missing or late."""
        now = time.monotonic()
        late = [name for name, at in self.heard.items() if now - at > MAX_AGE]
        self.heard["cycle"] = now
        commands = self.ramp[1:] or [(0.0, 0.0)]
        try:
            if late or self.gate is None:
                raise TimeoutError(f"no {', '.join(late) or 'map'}")
            pose = self.locate("base_link")
            commands = self.gate.slow_down(pose, self.wanted, twist_now=self.ramp[0]).commands
        except Exception as error:  # tf2 has several kinds
            self.get_logger().warning(f"stops: {error}", throttle_duration_sec=1.0)
        self.ramp = list(commands)
        command = Twist()
        command.linear.x, command.angular.z = map(float, self.ramp[0])
        self.publisher.publish(command)


def main():
    """Run the node until it is interrupted."""
    import tf2_ros

    rclpy.init()
    node = GateNode(tf2_ros.Buffer())
    node.listener = tf2_ros.TransformListener(node.transforms, node)
    rclpy.spin(node)


if __name__ == "__main__":
    main()

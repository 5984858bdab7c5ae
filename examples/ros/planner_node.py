"""A ROS 2 node that plans proven paths on an occupancy grid, for Nav2 or by itself.

Run it with ``python planner_node.py --ros-args --params-file params.yaml``; the page
"Plan in ROS 2" describes topics, services and parameters.
"""

import copy
import itertools
import threading
import time
from importlib.util import find_spec

import numpy as np
import rclpy
import shapely
from geometry_msgs.msg import Point, Polygon, PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from shapely import affinity
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

import cspace
import planners
from cspace.errors import ConfigurationError, CspaceError

PARAMETERS = {
    "footprint": "[]",
    "robot_radius": 0.2,
    "footprint_padding": 0.01,
    "rotations": 72,
    "drive": "holonomic",
    "turning_radius": 0.0,
    "unknown": "occupied",
    "free_thresh": 0.25,
    "occupied_thresh": 0.65,
    "time_limit": 1.0,
    "step": 0.05,
    "robot_base_frame": "base_link",
}
"""Parameters and their defaults, in metres, radians and seconds."""

UNKNOWN, TF_ERROR, TIMEOUT, NO_VALID_PATH = 200, 202, 207, 208
OUTSIDE = {"start": 203, "goal": 204}
OCCUPIED = {"start": 205, "goal": 206}
"""Error codes of nav2_msgs/ComputePathToPose."""


class NoPlanError(Exception):
    """A request without a path, its error code, and the plan that failed, if there is one."""

    def __init__(self, reason, code, plan=None):
        super().__init__(reason)
        self.code = code
        self.plan = plan


class PlannerNode(Node):
    """Keeps a map of configurations up to date, and plans on copies of it."""

    def __init__(self):
        super().__init__("cspace_planner")
        self.option = {
            name: self.declare_parameter(name, default).value
            for name, default in PARAMETERS.items()
        }
        self.lock = threading.Lock()  # of the map and its grid
        self.planning = threading.Lock()
        self.explaining = threading.Thread()
        self.grid = self.space = self.last = None
        self.version = 0  # of the map
        self.frame = "map"
        self.complaints = set()
        self.robot, self.outline = self.make_robot(self.option["footprint"])
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(OccupancyGrid, "map", self.on_map, kept)
        self.create_subscription(Polygon, "footprint", self.on_footprint, 1)
        self.map_publisher = self.create_publisher(OccupancyGrid, "~/map", kept)
        self.path_publisher = self.create_publisher(Path, "~/plan", kept)
        self.marker_publisher = self.create_publisher(MarkerArray, "~/markers", kept)
        one_at_a_time = MutuallyExclusiveCallbackGroup()
        self.create_service(GetPlan, "~/make_plan", self.make_plan, callback_group=one_at_a_time)
        if find_spec("map_msgs"):
            from map_msgs.msg import OccupancyGridUpdate

            self.create_subscription(OccupancyGridUpdate, "map_updates", self.on_update, 10)
        if find_spec("nav2_msgs"):
            self.serve_nav2(ReentrantCallbackGroup())
        self.transforms = None
        if find_spec("tf2_ros"):
            import tf2_ros

            self.transforms = tf2_ros.Buffer()
            self.listener = tf2_ros.TransformListener(self.transforms, self)

    def serve_nav2(self, group):
        """Serve Nav2's action and service under private names."""
        from nav2_msgs.action import ComputePathToPose
        from nav2_msgs.srv import IsPathValid
        from rclpy.action import ActionServer, CancelResponse

        self.compute_path = ComputePathToPose
        self.action = ActionServer(
            self,
            ComputePathToPose,
            "~/compute_path_to_pose",
            self.compute_path_to_pose,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=group,
        )
        self.create_service(
            IsPathValid, "~/is_path_valid", self.is_path_valid, callback_group=group
        )

    def complain(self, problem):
        """Log a problem once."""
        if problem not in self.complaints:
            self.complaints.add(problem)
            self.get_logger().warning(problem)

    # ---- the world -------------------------------------------------------------------------------

    def make_robot(self, footprint):
        """Return the robot of a footprint, or of the radius if it is empty, and its outline."""
        padding = self.option["footprint_padding"]
        if footprint == "[]":
            radius = self.option["robot_radius"] + padding
            return cspace.Robot.disc(radius), shapely.Point(0.0, 0.0).buffer(radius)
        robot = cspace.Robot.from_footprint(footprint, padding=padding)
        return robot, robot.shape.geometries[0]

    def on_map(self, msg):
        """Follow a map: update in place, or build if its grid is another one."""
        try:
            self.follow(msg)
        except CspaceError as error:
            self.complain(f"map: {error}")

    def on_update(self, update):
        """Follow an update of a part of the map."""
        if self.grid is None:
            return
        try:
            grid = copy.copy(self.grid)
            cspace.ros.update_occupancy_grid(grid, update)
            self.follow(grid)
        except CspaceError as error:
            self.complain(f"map_updates: {error}")

    def on_footprint(self, msg):
        """Build the map for a new footprint."""
        try:
            robot, outline = self.make_robot([(corner.x, corner.y) for corner in msg.points])
            if self.grid is not None:
                self.follow(self.grid, robot)
            self.robot, self.outline = robot, outline
        except CspaceError as error:
            self.complain(f"footprint: {error}")

    def follow(self, grid, robot=None):
        """Make the map equal to a new one of an occupancy grid."""
        option = self.option
        workspace = cspace.Workspace.from_occupancy_grid(
            grid,
            option["unknown"],
            free_thresh=option["free_thresh"],
            occupied_thresh=option["occupied_thresh"],
        )
        frame = grid.header.frame_id or "map"
        if robot is None and self.space is not None and self.space.grid == workspace.grid:
            with self.lock:
                self.space.update(workspace)
                self.grid, self.frame, self.version = grid, frame, self.version + 1
        else:
            space = cspace.build(workspace, robot or self.robot, rotations=option["rotations"])
            if self.space is None:
                planners.warm_up(space, option["drive"])
            with self.lock:
                self.space, self.grid, self.frame, self.last = space, grid, frame, None
                self.version += 1
        self.map_publisher.publish(
            self.space.to_occupancy_grid(OccupancyGrid(), rotation=0.0, frame_id=frame)
        )

    # ---- plans -----------------------------------------------------------------------------------

    def find_plan(self, start, goal, is_cancelled=lambda: False):
        """Return a plan between stamped poses that is proven on the newest map.

        Raises NoPlanError with the reason, also if the request is cancelled.
        """
        end = time.monotonic() + self.option["time_limit"]

        def stop():
            return is_cancelled() or time.monotonic() > end or not rclpy.ok()

        with self.planning:
            while True:
                with self.lock:
                    version, frame, last = self.version, self.frame, self.last
                    space = copy.copy(self.space)
                if space is None:
                    raise NoPlanError("there is no map yet", UNKNOWN)
                plan = self.plan_once(space, frame, last, (start, goal), stop)
                with self.lock:  # the map may have changed since
                    if plan.solved and plan.recheck(self.space).all():
                        self.last = plan
                        return plan
                    if version == self.version and not plan.solved:
                        code = TIMEOUT if stop() else NO_VALID_PATH
                        raise NoPlanError(plan.status, code, plan)
                if stop():
                    raise NoPlanError("the map changed, and time is over", TIMEOUT)

    def plan_once(self, space, frame, last, poses, stop):
        """Plan on a map that does not change; go on along the last plan if its goal is the same."""
        option = self.option
        try:
            start, goal = (cspace.ros.configuration_of(pose, space, frame) for pose in poses)
        except CspaceError as error:
            code = TF_ERROR if "frame_id" in error.argument else UNKNOWN
            raise NoPlanError(str(error), code) from error
        if last is not None and not np.allclose(last.goal, goal):
            last = None
        try:
            return planners.plan(
                space,
                start,
                goal,
                drive=option["drive"],
                turning_radius=option["turning_radius"] or None,
                time_limit=option["time_limit"],
                previous=last,
                stop=stop,
            )
        except ConfigurationError as error:
            codes = OUTSIDE if error.reason == "outside" else OCCUPIED
            raise NoPlanError(str(error), codes[error.end]) from error

    def answer(self, start, goal, is_cancelled=lambda: False):
        """Plan, and publish the path and what shows it; return the path, a code and the reason.

        Without a start, the plan begins where the robot is.
        """
        path = Path()
        path.header.frame_id = self.frame
        path.header.stamp = self.get_clock().now().to_msg()
        code, reason = 0, ""
        try:
            plan = self.find_plan(start or self.locate_robot(), goal, is_cancelled)
            plan.to_path(path, frame_id=self.frame, step=self.option["step"])
            self.marker_publisher.publish(self.mark_path(plan))
        except NoPlanError as error:
            code, reason = error.code, str(error)
            self.explain(error.plan)
        except CspaceError as error:
            code, reason = UNKNOWN, str(error)
        if reason:
            self.complain(reason)
        self.path_publisher.publish(path)
        return path, code, reason

    def make_plan(self, request, response):
        """Answer nav_msgs/GetPlan; without a path, it has no poses."""
        response.plan, _, _ = self.answer(request.start, request.goal)
        return response

    def compute_path_to_pose(self, goal_handle):
        """Execute nav2_msgs/ComputePathToPose."""
        request = goal_handle.request
        result = self.compute_path.Result()
        began = time.monotonic()
        start = request.start if request.use_start else None
        result.path, result.error_code, reason = self.answer(
            start, request.goal, lambda: goal_handle.is_cancel_requested
        )
        if hasattr(result, "error_msg"):  # since Kilted
            result.error_msg = reason
        result.planning_time = Duration(seconds=time.monotonic() - began).to_msg()
        if goal_handle.is_cancel_requested:
            goal_handle.canceled()
        elif result.error_code:
            goal_handle.abort()
        else:
            goal_handle.succeed()
        return result

    def locate_robot(self):
        """Return the robot's pose; raise NoPlanError if tf2 does not know it."""
        if self.transforms is None:
            raise NoPlanError("use_start is false, and tf2_ros is not installed", TF_ERROR)
        try:
            frames = self.frame, self.option["robot_base_frame"]
            moved = self.transforms.lookup_transform(*frames, rclpy.time.Time())
        except Exception as error:  # tf2 has several kinds
            raise NoPlanError(str(error), TF_ERROR) from error
        start = PoseStamped(header=moved.header)
        place = moved.transform.translation
        start.pose.position = Point(x=place.x, y=place.y, z=place.z)
        start.pose.orientation = moved.transform.rotation
        return start

    def is_path_valid(self, request, response):
        """Answer nav2_msgs/IsPathValid: all motions between successive poses are proven free."""
        response.is_valid = False
        try:
            with self.lock:
                poses = request.path.poses
                rows = [cspace.ros.configuration_of(one, self.space, self.frame) for one in poses]
                free = self.space.certify_path(rows)
            response.is_valid = bool(free.all())
            response.invalid_pose_indices = (np.flatnonzero(~free) + 1).tolist()
        except (CspaceError, AttributeError) as error:  # there may be no map yet
            self.complain(f"is_path_valid: {error}")
        return response

    # ---- what RViz shows -------------------------------------------------------------------------

    def make_marker(self, kind, points, size):
        """Return a message of one marker, after which all others are gone."""
        marker = Marker(type=kind, id=1, color=ColorRGBA(r=1.0, g=0.4, a=1.0))
        marker.header.frame_id = self.frame
        marker.scale.x = marker.scale.y = marker.scale.z = size
        marker.points = [Point(x=x, y=y) for x, y in points]
        return MarkerArray(markers=[Marker(action=Marker.DELETEALL), marker])

    def mark_path(self, plan):
        """Return the footprints along a path as lines."""
        lines = []
        for x, y, yaw in plan.path:
            turned = affinity.rotate(self.outline, yaw, (0.0, 0.0), use_radians=True)
            corners = shapely.get_coordinates(affinity.translate(turned, x, y)).tolist()
            lines += [corner for side in itertools.pairwise(corners) for corner in side]
        return self.make_marker(Marker.LINE_LIST, lines, 0.02)

    def explain(self, plan):
        """Publish the barrier of a plan without a path, in a thread, as it may take a second."""
        if plan is None or self.explaining.is_alive():
            return

        def publish():
            barrier = plan.explain().barrier[:, 1:]
            points = plan.space.grid.center_of(np.unique(barrier, axis=0)).tolist()
            spacing = plan.space.grid.spacing
            self.marker_publisher.publish(self.make_marker(Marker.CUBE_LIST, points, spacing))

        self.explaining = threading.Thread(target=publish, daemon=True)
        self.explaining.start()


def main():
    """Run the node until it is interrupted."""
    rclpy.init()
    node = PlannerNode()
    try:
        rclpy.spin(node, MultiThreadedExecutor(num_threads=4))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

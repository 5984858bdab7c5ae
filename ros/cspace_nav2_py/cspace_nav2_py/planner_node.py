"""A ROS 2 node that plans proven paths on an occupancy grid, for Nav2 or by itself.

The page "Plan in ROS 2" describes topics, services and parameters.
"""

import contextlib
import copy
import io
import itertools
import math
import os
import signal
import sys
import threading
import time
from array import array
from collections import deque
from functools import partial, wraps
from importlib.util import find_spec

import numpy as np
import rclpy
import shapely
from geometry_msgs.msg import Point, Polygon, PoseStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from scipy.spatial.transform import Rotation
from shapely import affinity
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

import cspace
import planners
from cspace.errors import ConfigurationError, CspaceError, InputError

DRIVES = ("holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp")
WORDS = {"drive": DRIVES, "unknown": ("occupied", "free")}
"""Values of the parameters that are words."""

PARAMETERS = {
    "saved_map": ("", "folder of a saved map, instead of the topics map and footprint", None),
    "footprint": ("[]", "corners of the robot, as Nav2 writes them; [] for a disc", None),
    "robot_radius": (0.2, "metres, without a footprint", (0.001, 100.0)),
    "footprint_padding": (0.01, "metres by which the robot is grown", (0.0, 10.0)),
    "rotations": (72, "cells of yaw", (1, 1000)),
    "drive": ("", f"how the robot moves: {', '.join(DRIVES)}", None),
    "turning_radius": (0.0, "least turning radius of a car, metres", (0.0, 1000.0)),
    "unknown": ("occupied", "what unknown cells are: occupied, free", None),
    "free_thresh": (0.25, "share of 100 below which cells are free; 0.995 on costmaps", (0.0, 1.0)),
    "occupied_thresh": (
        0.65,
        "share of 100 from which cells are occupied; 1.0 on costmaps",
        (0.0, 1.0),
    ),
    "max_velocity": (0.0, "m/s, for quickest ways by a speed mask; 0 without one", (0.0, 100.0)),
    "time_limit": (1.0, "seconds of a request", (0.001, 3600.0)),
    "step": (0.05, "metres between poses of a path", (0.001, 10.0)),
    "tilt_tolerance": (0.05, "radians of a pose's roll and pitch that are ignored", (0.0, 3.2)),
    "tolerance": (0.0, "metres from a start or goal that cannot be used", (0.0, 100.0)),
    "via_tolerance": (0.25, "metres around a pose on the way; 0 for exactly there", (0.0, 100.0)),
    "robot_base_frame": ("base_link", "frame of the robot", None),
}
"""Parameters: their defaults, what they are, and their ranges."""

AT_RUN_TIME = {"time_limit", "step", "tilt_tolerance", "tolerance", "via_tolerance"}
"""Parameters that may change while the node runs; the rest is read-only."""

UNITS = {1: "percent", 2: "m/s"}
"""Units of Nav2's speed masks, by the type of their filter."""

OCCUPANCY = np.array([0, -1, 100], dtype=np.int8)
"""Occupancy of the states FREE, MIXED and BLOCKED, in per cent."""

UNKNOWN, TF_ERROR, TIMEOUT, NO_VALID_PATH = 200, 202, 207, 208
OUTSIDE = {"start": 203, "goal": 204}
OCCUPIED = {"start": 205, "goal": 206}
THROUGH_POSES, NO_VIAPOINTS = 100, 309
"""Error codes of nav2_msgs/ComputePathToPose, and what ComputePathThroughPoses adds to them."""


REHEARSAL_SECONDS = 60.0
"""Limit of the requests that the node makes before it is ready, besides their compilation."""


class NoPlanError(Exception):
    """A request without a path, its error code, and the plan that failed, if there is one."""

    def __init__(self, reason, code, plan=None):
        super().__init__(reason)
        self.code = code
        self.plan = plan


def guard(*lost):
    """Return a decorator of callbacks that log any error, after which attributes are None."""

    def decorate(callback):
        @wraps(callback)  # rclpy reads the signature
        def call(self, *arguments, **options):
            try:
                callback(self, *arguments, **options)
            except Exception as error:  # MemoryError, too: the next message may be smaller
                self.complain(f"{callback.__name__}: {error!r}")
                with self.lock:
                    for name in lost:
                        setattr(self, name, None)

        return call

    return decorate


def check_turn(name, turn):
    """Raise InputError if a quaternion does not have norm 1."""
    numbers = (turn.x, turn.y, turn.z, turn.w)
    if not abs(math.hypot(*numbers) - 1.0) <= 1e-3:  # beyond rounding, or no number
        problem = f"is ({', '.join(f'{number:g}' for number in numbers)})"
        raise InputError(name, problem, "its norm must be 1")


def make_pose(x, y, yaw, frame):
    """Return a stamped pose."""
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position = Point(x=x, y=y)
    pose.pose.orientation = Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    return pose


class PlannerNode(Node):
    """Keeps a map of configurations up to date, and plans on copies of it."""

    def __init__(self):
        super().__init__("cspace_planner")
        for name in PARAMETERS:
            self.declare(name)
        self.read_drive()
        cell = OccupancyGrid(data=[0])
        cell.info.width = cell.info.height = 1
        cell.info.resolution = 1.0
        self.read_grid(cell)  # wrong thresholds end the node now
        self.lock = threading.Condition()  # of the map, and of what it follows
        self.planning = threading.Lock()
        self.explaining = threading.Thread()
        self.space = self.last = self.shown = None
        self.zones = self.mask_subscription = None  # of the newest speed mask
        self.lags = True  # readers of the shown map need all of it
        self.frame = "map"
        self.grid = self.workspace = None  # the newest, which the map follows
        self.arrived = self.version = 0  # messages that came, and that the map holds
        self.sent = self.since = 0  # times of the newest grid, and after which one is whole
        self.is_live = self.has_updates = False
        self.updates = deque(maxlen=100)  # with their times, as their grid may come after them
        self.number = 0  # of the newest update
        self.complaints = set()
        self.corners = self.option("footprint")
        self.kept = kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.window_publisher = None
        self.saved = self.open_map(self.option("saved_map"))
        if self.saved is None:
            self.robot, self.outline = self.make_robot(self.corners)
            self.subscribe(kept)
        else:
            self.robot = self.saved.drawn_robot
            self.outline = self.robot.shape.outer.outline
            self.arrived = 1
        readers = PublisherEventCallbacks(matched=self.on_reader)
        self.map_publisher = self.create_publisher(
            OccupancyGrid, "~/map", kept, event_callbacks=readers
        )
        self.path_publisher = self.create_publisher(Path, "~/plan", kept)
        self.marker_publisher = self.create_publisher(MarkerArray, "~/markers", kept)
        one_at_a_time = MutuallyExclusiveCallbackGroup()
        self.create_service(GetPlan, "~/make_plan", self.make_plan, callback_group=one_at_a_time)
        if find_spec("nav2_msgs"):
            self.serve_nav2(ReentrantCallbackGroup())
        self.transforms = None
        if find_spec("tf2_ros"):
            import tf2_ros

            self.transforms = tf2_ros.Buffer()
            self.listener = tf2_ros.TransformListener(self.transforms, self)
        self.news = threading.Event()
        if self.saved is not None:
            self.news.set()
        threading.Thread(target=self.keep_up, daemon=True).start()

    def declare(self, name):
        """Declare a parameter; InputError if it is no word that it may be."""
        default, about, bounds = PARAMETERS[name]
        rule = ParameterDescriptor(description=about, read_only=name not in AT_RUN_TIME)
        if isinstance(default, float):
            rule.floating_point_range = [
                FloatingPointRange(from_value=bounds[0], to_value=bounds[1])
            ]
        elif isinstance(default, int):
            rule.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1], step=1)]
        word = self.declare_parameter(name, default, rule).value
        if word not in WORDS.get(name, (word,)):
            problem = f"is {word!r}" if word else "is missing"
            raise InputError(name, problem, f"it must be one of {WORDS[name]}", "correct it")

    def subscribe(self, kept):
        """Subscribe to the world; these callbacks only store, and wait for nothing else."""
        group = MutuallyExclusiveCallbackGroup()
        subscribe = partial(self.create_subscription, callback_group=group)
        self.update_topic = self.resolve_topic_name("map") + "_updates"
        self.update_subscription = None
        if find_spec("map_msgs"):
            from map_msgs.msg import OccupancyGridUpdate

            # Not kept, or a late reader would write old windows over a newer grid.
            self.window_publisher = self.create_publisher(OccupancyGridUpdate, "~/map_updates", 100)
            # Kept updates tell whether any was sent before this node was heard.
            every = QoSProfile(history=HistoryPolicy.KEEP_ALL, durability=kept.durability)
            self.update_subscription = subscribe(
                OccupancyGridUpdate, self.update_topic, self.on_update, every
            )
            # Publishers learn of subscriptions in their order: one that sends a grid to this one,
            # which gets no kept grid, sends all updates after the grid to the one above.
            subscribe(OccupancyGrid, "map", partial(self.on_map, is_live=True), QoSProfile(depth=1))
        subscribe(OccupancyGrid, "map", self.on_map, kept)
        subscribe(Polygon, "footprint", self.on_footprint, 1)

    def serve_nav2(self, group):
        """Serve Nav2's action and service under private names."""
        from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
        from nav2_msgs.msg import CostmapFilterInfo
        from nav2_msgs.srv import IsPathValid
        from rclpy.action import ActionServer, CancelResponse

        self.actions = [
            ActionServer(
                self,
                kind,
                f"~/{name}",
                partial(self.compute_path, kind),
                cancel_callback=lambda goal: CancelResponse.ACCEPT,
                callback_group=group,
            )
            for name, kind in (
                ("compute_path_to_pose", ComputePathToPose),
                ("compute_path_through_poses", ComputePathThroughPoses),
            )
        ]
        self.create_service(
            IsPathValid, "~/is_path_valid", self.is_path_valid, callback_group=group
        )
        self.create_subscription(
            CostmapFilterInfo, "speed_filter_info", self.on_speed_filter, self.kept
        )

    def option(self, name):
        """Return the value of a parameter."""
        return self.get_parameter(name).value

    def read_drive(self):
        """Return the robot's drive, or None; InputError if the parameters do not go together."""
        word, radius = self.option("drive"), self.option("turning_radius")
        reverse = word in ("differential-reverse", "reeds-shepp")
        if word in ("dubins", "reeds-shepp"):
            return planners.Car(turning_radius=radius, reverse=reverse)
        if radius:
            raise InputError(
                "turning_radius", f"is {radius} and drive is {word!r}", "it is for cars"
            )
        return None if word == "holonomic" else planners.Differential(reverse=reverse)

    def complain(self, problem):
        """Log a problem once; after a shutdown, everything fails."""
        if problem not in self.complaints and rclpy.ok():
            self.complaints.add(problem)
            self.get_logger().warning(problem)

    # ---- the world -------------------------------------------------------------------------------

    def open_map(self, path):
        """Return a saved map, or None without a path; InputError if the node cannot plan on it."""
        if not path:
            return None
        space = cspace.open(path)
        if not isinstance(space, cspace.CSpace) or space.axes != ("x", "y", "yaw"):
            raise InputError(
                "saved_map", f"is {space!r}", "it must be of x, y and yaw, and no tiles"
            )
        return space

    def make_robot(self, footprint):
        """Return the robot of a footprint, or of the radius if it is empty, and its outline."""
        padding = self.option("footprint_padding")
        if footprint == "[]":
            radius = self.option("robot_radius") + padding
            return cspace.Robot.disc(radius), shapely.Point(0.0, 0.0).buffer(radius)
        robot = cspace.Robot.from_footprint(footprint, padding=padding)
        return robot, robot.shape.geometries[0]

    @guard("grid", "is_live")
    def on_map(self, msg, info, is_live=False):
        """Take a full grid; live ones were sent after the publisher had met this node."""
        sent = info["source_timestamp"]
        if self.is_live and not is_live and sent <= self.sent:
            return  # it came live before
        updates = self.updates
        has_all = len(updates) < updates.maxlen or updates[0][0] <= sent
        with self.lock:
            self.sent, self.is_live = sent, is_live and has_all
            self.take(msg, updates)

    @guard("grid", "is_live")
    def on_update(self, update, info):
        """Take an update of a part of the grid."""
        sent, number = info["source_timestamp"], info["publication_sequence_number"]
        if number != self.number + 1:  # None if the middleware does not count
            self.since = sent
            self.complain("map: updates were sent that did not come")
        self.number = number or 0
        self.updates.append((sent, update))
        if self.grid is not None:
            self.take(self.grid, [(sent, update)])

    @guard("robot", "corners")
    def on_footprint(self, msg):
        """Take a footprint, unless it is the newest one again."""
        corners = [(corner.x, corner.y) for corner in msg.points]
        if corners == self.corners:
            return
        robot, outline = self.make_robot(corners)
        with self.lock:
            self.robot, self.outline, self.corners = robot, outline, corners
            self.arrived += 1
        self.news.set()

    @guard("zones", "last")
    def on_speed_filter(self, info):
        """Subscribe to the mask of a speed filter, whose cells have a largest speed."""
        if info.type not in UNITS:
            rule = f"it must be one of {UNITS}"
            raise InputError("speed_filter_info.type", f"is {info.type}", rule)
        unit, speed = UNITS[info.type], self.option("max_velocity")
        if not speed:
            raise InputError("max_velocity", "is 0", "quickest ways by a speed mask need it")
        self.read_mask = partial(
            planners.SpeedZones.from_mask,
            unit=unit,
            base=info.base,
            multiplier=info.multiplier,
            max_velocity=speed if unit == "percent" else None,
        )
        if self.mask_subscription is not None:
            self.destroy_subscription(self.mask_subscription)
        self.mask_subscription = self.create_subscription(
            OccupancyGrid, info.filter_mask_topic, self.on_speed_mask, self.kept
        )

    @guard("zones", "last")
    def on_speed_mask(self, mask):
        """Take a speed mask; a plan by others is not gone on with."""
        zones = self.read_mask(mask)
        with self.lock:
            self.zones, self.last = zones, None

    def take(self, grid, updates):
        """Let the map follow a grid with the updates that were sent after it."""
        grid = copy.copy(grid)
        frame = grid.header.frame_id
        if not frame:
            raise InputError("map.header.frame_id", "is ''", "it must name the map's frame")
        check_turn("map.info.origin.orientation", grid.info.origin.orientation)
        for sent, update in updates:
            if sent <= self.sent:
                continue
            if update.header.frame_id != frame:
                problem = f"is {update.header.frame_id!r}"
                rule = f"it must be {frame!r}, the frame of the map"
                raise InputError("update.header.frame_id", problem, rule, "send both in one")
            cspace.ros.update_occupancy_grid(grid, update)
        workspace = self.read_grid(grid)
        self.find_doubt()  # a publisher of updates that ends later counts
        with self.lock:
            self.grid, self.workspace = grid, workspace
            self.arrived += 1
        self.news.set()

    def read_grid(self, grid):
        """Return the workspace of a grid."""
        return cspace.Workspace.from_occupancy_grid(
            grid,
            self.option("unknown"),
            free_thresh=self.option("free_thresh"),
            occupied_thresh=self.option("occupied_thresh"),
        )

    def find_doubt(self):
        """Return why the grid may lack obstacles, or an empty text.

        A grid is whole without a publisher of updates, or if it came live and all updates since.
        """
        if self.saved is not None:
            return ""
        publishers = self.count_publishers(self.update_topic)
        self.has_updates = self.has_updates or publishers > 0
        listener = self.update_subscription
        is_heard = listener and listener.get_publisher_count() >= publishers
        if not self.has_updates or (is_heard and self.is_live and self.sent > self.since):
            return ""
        return (
            f"waiting for a full grid, as updates on {self.update_topic} may be missing: set "
            "always_send_full_costmap: true in the costmap, or start it after this node"
        )

    def keep_up(self):
        """Follow what arrives."""
        while self.news.wait():
            self.news.clear()
            try:
                self.follow()
            except Exception as error:  # MemoryError, too: the next grid may be smaller
                self.complain(f"the map is not built: {error!r}")

    def follow(self):
        """Make the map equal to the newest grid, for the newest footprint; or take a saved one."""
        with self.lock:
            grid, workspace, robot, arrived = self.grid, self.workspace, self.robot, self.arrived
        if self.saved is None and (grid is None or robot is None):
            return
        if self.space is None:
            self.get_logger().info("building the first map, which may compile for minutes")
        space = self.make_map(workspace, robot)
        frame = space.frame_id or "map"
        if self.space is None:
            planners.warm_up(space, self.read_drive())
            self.rehearse(space, frame)
            self.get_logger().info("ready to plan")
        with self.lock:
            window = None
            if space is self.space:
                window = self.show_changes(space, space.update(workspace))
            else:
                self.space, self.last = space, None
                self.shown = space.to_occupancy_grid(OccupancyGrid(), rotation=0.0, frame_id=frame)
            self.frame, self.version = frame, arrived
            self.lock.notify_all()
        doubt = self.find_doubt()
        if doubt:
            self.complain(doubt)
        with self.lock:
            self.publish_map(window, doubt)

    def rehearse(self, space, frame):
        """Make the requests that the first ones may be, so that these compile nothing."""
        end = time.monotonic() + REHEARSAL_SECONDS
        blocked = np.argwhere(space.states_at(0.0) == cspace.BLOCKED)[:1]
        taken = [(*space.grid.center_of(cell), 0.0) for cell in blocked]
        try:
            start, goal = space.sample_free(2, np.random.default_rng(0))
            closed = copy.copy(space)
            reach = np.linalg.norm(shapely.get_coordinates(self.outline), axis=1).max()
            ring = shapely.Point(goal[:2]).buffer(2.0 * reach)
            closed.add_obstacle("ring", ring.exterior.buffer(2.0 * space.grid.spacing))
            space.certify_path([start, goal])
        except CspaceError:  # nothing is free
            return
        for known, first in ((space, start), (closed, start), *((space, cell) for cell in taken)):
            poses = [make_pose(*q, frame) for q in (first, goal)]
            with contextlib.suppress(NoPlanError):
                plan = self.plan_once(
                    known, frame, None, None, poses, lambda: time.monotonic() > end
                )
                if plan:
                    plan.to_path(Path(), frame_id=frame, step=self.option("step"))
                else:
                    plan.explain()

    def make_map(self, workspace, robot):
        """Return the saved map, the node's map if it can follow a workspace, or a new one."""
        if self.saved is not None:
            return self.saved
        space, frame = self.space, workspace.grid.frame_id or "map"
        is_same = space is not None and space.frame_id == frame and space.grid == workspace.grid
        if is_same and space.robot is robot:
            return space
        return cspace.build(workspace, robot, rotations=self.option("rotations"))

    def publish_map(self, window, doubt):
        """Publish a window that changed, or the whole map to readers that need it; hold the lock."""
        readers = self.map_publisher.get_subscription_count()
        hears = self.window_publisher and self.window_publisher.get_subscription_count() >= readers
        if doubt or not readers or not rclpy.ok():
            self.lags = True
        elif self.lags or window is None or not hears:
            self.map_publisher.publish(self.shown)
            self.lags = False
        else:
            self.window_publisher.publish(self.cut(*window))

    @guard()
    def on_reader(self, status):
        """Publish the whole map for a new reader, as the one that is kept may be old."""
        if status.current_count_change > 0:
            with self.lock:
                if self.shown is not None:
                    self.publish_map(None, self.find_doubt())

    def cut(self, lower, upper):
        """Return the message of the cells of the shown map from one index to another."""
        from map_msgs.msg import OccupancyGridUpdate

        update = OccupancyGridUpdate(header=self.shown.header)
        update.x, update.y, right, top = map(int, (*lower, *upper))
        update.width, update.height = right - update.x, top - update.y
        shown = np.frombuffer(self.shown.data, np.int8).reshape(-1, self.shown.info.width)
        update.data = array("b", shown[update.y : top, update.x : right].tobytes())
        return update

    def show_changes(self, space, update):
        """Write the cells that an update computed again into the shown map; return its corners."""
        info = self.shown.info
        shown = np.frombuffer(self.shown.data, np.int8).reshape(info.height, info.width)
        (left, bottom), (right, top) = update.lower, update.upper
        states = space.states_at(0.0)[left:right, bottom:top]
        shown[bottom:top, left:right] = OCCUPANCY[states].T
        return update.lower, update.upper

    def wait_for_map(self, stop):
        """Wait, with the lock, until the map holds all that came before; raise NoPlanError if not."""
        if self.grid is None and self.saved is None:
            raise NoPlanError(self.find_doubt() or "there is no good map yet", UNKNOWN)
        if self.robot is None:
            raise NoPlanError("the newest footprint was refused", UNKNOWN)
        wanted = self.arrived
        while self.version < wanted or self.find_doubt():
            if stop():
                raise NoPlanError(self.find_doubt() or "the newest map is not built", TIMEOUT)
            self.lock.wait(0.05)

    # ---- plans -----------------------------------------------------------------------------------

    def find_plan(self, start, goals, is_cancelled=lambda: False):
        """Return a plan through stamped poses that is proven on the newest map.

        Raises NoPlanError with the reason, also if the request is cancelled.
        """

        def stop():
            return is_cancelled() or time.monotonic() > end or not rclpy.ok()

        with self.planning:
            end = time.monotonic() + self.option("time_limit")  # from when it is served
            while True:
                with self.lock:
                    self.wait_for_map(stop)
                    version, frame, last = self.version, self.frame, self.last
                    space, zones = copy.copy(self.space), self.zones
                plan = self.plan_once(space, frame, last, zones, (start, *goals), stop)
                with self.lock:
                    self.wait_for_map(stop)  # it may have changed since
                    if plan and plan.recheck(self.space).all():
                        self.last = plan if zones is self.zones else None
                        return plan
                    if version == self.version and not plan:
                        code = TIMEOUT if stop() else NO_VALID_PATH
                        raise NoPlanError(plan.status, code, plan)
                if stop():
                    raise NoPlanError("the map changed, and time is over", TIMEOUT)

    def plan_once(self, space, frame, last, zones, poses, stop):
        """Plan on a map that does not change; go on along the last plan if its goal is the same."""
        try:
            start, *via, goal = (self.configure(pose, space, frame) for pose in poses)
        except CspaceError as error:
            code = TF_ERROR if "frame_id" in error.argument else UNKNOWN
            raise NoPlanError(str(error), code) from error
        if last is not None and (via or not np.allclose(last.goal, goal)):
            last = None
        tolerance, room = self.option("tolerance"), self.option("via_tolerance")
        quickest = {}
        if zones is not None:
            quickest = {"objective": "time", "speed": [self.option("max_velocity"), zones]}
        find = partial(
            planners.plan,
            space,
            planners.Near(start, tolerance),
            drive=self.read_drive(),
            time_limit=self.option("time_limit"),
            previous=last,
            stop=stop,
            via=[planners.Near(q, room, math.pi) for q in via] if room else via,
            **quickest,
        )
        try:
            return find(goal) if not tolerance else self.find_near(find, goal, tolerance, stop)
        except ConfigurationError as error:
            codes = OUTSIDE if error.reason == "outside" else OCCUPIED
            raise NoPlanError(str(error), codes.get(error.end, codes["goal"])) from error

    def find_near(self, find, goal, tolerance, stop):
        """Plan to the goal, or if it is not reached to a place within a tolerance, metres."""
        try:
            plan = find(goal)
            if plan or stop():
                return plan
        except ConfigurationError as error:
            if error.end != "goal":
                raise
        return find(planners.Near(goal, tolerance))

    def answer(self, start, goals, is_cancelled=lambda: False):
        """Plan, and publish the path and what shows it; return the path, a code and the reason.

        Without a start, the plan begins where the robot is.
        """
        path = Path()
        path.header.frame_id = self.frame
        path.header.stamp = self.get_clock().now().to_msg()
        code, reason = 0, ""
        try:
            plan = self.find_plan(start or self.locate_robot(), goals, is_cancelled)
            plan.to_path(path, frame_id=self.frame, step=self.option("step"))
            self.marker_publisher.publish(self.mark_path(plan))
        except NoPlanError as error:
            code, reason = error.code, str(error)
            self.explain(error.plan)
        except Exception as error:  # a request that fails must not end the node
            code, reason = UNKNOWN, str(error) or repr(error)
        if reason:
            self.complain(reason)
        self.path_publisher.publish(path)
        return path, code, reason

    def make_plan(self, request, response):
        """Answer nav_msgs/GetPlan; without a path, it has no poses."""
        response.plan, _, _ = self.answer(request.start, [request.goal])
        return response

    def compute_path(self, kind, goal_handle):
        """Execute nav2_msgs/ComputePathToPose, or ComputePathThroughPoses."""
        request, result = goal_handle.request, kind.Result()
        began = time.monotonic()
        goals, shift = [getattr(request, "goal", None)], 0
        if hasattr(request, "goals"):
            goals, shift = list(getattr(request.goals, "goals", request.goals)), THROUGH_POSES
        start = request.start if request.use_start else None
        self.newest = goal_handle

        def is_cancelled():
            """Return True if the goal is cancelled, or a newer one came."""
            return goal_handle.is_cancel_requested or self.newest is not goal_handle

        if goals:
            result.path, code, reason = self.answer(start, goals, is_cancelled)
            result.error_code = code and code + shift
        else:
            result.error_code, reason = NO_VIAPOINTS, "there is no goal"
        if result.error_code and self.newest is not goal_handle:
            result.error_code, reason = UNKNOWN + shift, "a newer goal came"
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
        robot = PoseStamped()
        robot.header.frame_id = self.option("robot_base_frame")
        return self.transform(robot, self.frame)

    def transform(self, pose, frame):
        """Return a pose in a frame, by the newest transform; raise NoPlanError without one."""
        try:
            moved = self.transforms.lookup_transform(frame, pose.header.frame_id, rclpy.time.Time())
            place, turn = moved.transform.translation, moved.transform.rotation
            turn = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
            own, ahead = pose.pose.position, pose.pose.orientation
            own = turn.apply([own.x, own.y, own.z]) + np.array([place.x, place.y, place.z])
            ahead = turn * Rotation.from_quat([ahead.x, ahead.y, ahead.z, ahead.w])
        except Exception as error:  # tf2 has several kinds
            raise NoPlanError(str(error), TF_ERROR) from error
        found = PoseStamped()
        found.header.frame_id = frame
        found.pose.position = Point(**dict(zip("xyz", own.tolist(), strict=True)))
        found.pose.orientation = Quaternion(**dict(zip("xyzw", ahead.as_quat(), strict=True)))
        return found

    def configure(self, pose, space, frame):
        """Return the configuration of a pose, which tf2 transforms if its frame is another one."""
        own = pose.header.frame_id
        check_turn("pose.orientation", pose.pose.orientation)  # which a transform would scale
        if self.transforms is not None and own not in ("", frame):
            pose = self.transform(pose, frame)
        tolerance = self.option("tilt_tolerance")
        return cspace.ros.configuration_of(pose, space, frame, tilt_tolerance=tolerance)

    def is_path_valid(self, request, response):
        """Answer nav2_msgs/IsPathValid: poses, and motions between them, are proven free.

        Where tf2 knows the robot, the way behind the pose nearest to it does not count.
        """
        response.is_valid = False
        end = time.monotonic() + self.option("time_limit")
        poses = request.path.poses
        try:
            for pose in poses:
                pose.header.frame_id = pose.header.frame_id or request.path.header.frame_id
            with self.lock:
                self.wait_for_map(lambda: time.monotonic() > end)
                rows = [self.configure(one, self.space, self.frame) for one in poses]
                if rows:
                    first = self.find_nearest(rows)
                    ahead = rows[first:]
                    bad = ~self.space.is_free(ahead)
                    bad[1:] |= ~self.space.certify_path(ahead)[: len(ahead) - 1]
                    response.is_valid = not bad.any()
                    response.invalid_pose_indices = (first + np.flatnonzero(bad)).tolist()
        except Exception as error:  # a request that fails must not end the node
            response.is_valid = False
            self.complain(f"is_path_valid: {str(error) or repr(error)}")
        return response

    def find_nearest(self, rows):
        """Return the number of the pose nearest to the robot; 0 if its place is unknown."""
        if self.transforms is None:
            return 0
        x, y, _ = self.configure(self.locate_robot(), self.space, self.frame)
        return int(np.argmin([math.dist(row[:2], (x, y)) for row in rows]))

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
            try:
                barrier = plan.explain().barrier[:, 1:]
                points = plan.space.grid.center_of(np.unique(barrier, axis=0)).tolist()
                markers = self.make_marker(Marker.CUBE_LIST, points, plan.space.grid.spacing)
                if rclpy.ok():
                    self.marker_publisher.publish(markers)
            except Exception as error:  # the plan has failed already; only the picture is missing
                self.complain(f"the barrier is not shown: {error!r}")

        self.explaining = threading.Thread(target=publish, daemon=True)
        self.explaining.start()


def main():
    """Run the node until it is interrupted; an error after that is part of the end."""
    ended = threading.Event()  # after a signal, rclpy's own handlers may leave spin() asleep
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = MultiThreadedExecutor(num_threads=4)
    node = None
    try:
        node = PlannerNode()
        executor.add_node(node)
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.1)
    except (CspaceError, ParameterException) as error:
        sys.exit(f"cspace_planner: {error}")
    except Exception:
        if not ended.is_set():
            raise
    finally:
        if ended.is_set():  # what callbacks say from now on is of the end, too
            sys.stderr = io.StringIO()
        rclpy.try_shutdown()
        if node is not None:
            node.destroy_node()
        if ended.is_set():
            os._exit(0)  # else Python waits for threads that plan or compile


if __name__ == "__main__":
    main()

"""The planner node of ROS 2, in a process of its own; run by ``nox -s ros``."""

import json
import math
import os
import pathlib
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from geometry_msgs.msg import Point32, Polygon, PoseStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Path  # noqa: E402
from nav_msgs.srv import GetPlan  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from std_msgs.msg import Empty  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

import cspace  # noqa: E402
from tests.helpers.repository import ROOT  # noqa: E402

PACKAGE = ROOT / "ros/cspace_nav2_py"
FOOTPRINT = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
START, GOAL = (1.0, 1.0, 0.0), (5.0, 1.0, 0.0)
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def make_room(gap=20):
    """Return the cells of a room of 6 m x 4 m with a wall that leaves a gap."""
    cells = np.zeros((120, 80), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[58:62, : 80 - gap] = 100
    return cells


def make_grid(cells):
    """Return the message of cells [x, y]."""
    msg = OccupancyGrid()
    msg.header.frame_id = "map"
    msg.info.resolution = 0.05
    msg.info.width, msg.info.height = cells.shape
    msg.info.origin.orientation.w = 1.0
    msg.data = cells.T.ravel().tolist()
    return msg


class Cells:
    """Cells [x, y] that are published by the rules of Nav2's node.

    A full grid is sent first, and when the size changes; else the window that changed. Both are
    left out if nobody listens then, except the first grid, and a window left out is not sent later.
    """

    def __init__(self, cells, always_full):
        self.cells, self.always_full = cells, always_full
        self.sent_shape = None
        self.changed = np.zeros_like(cells, dtype=bool)

    def change(self, x, y, value):
        """Change cells."""
        self.cells[x, y] = value
        self.changed[x, y] = True

    def grow(self, columns=1):
        """Add free columns."""
        self.cells = np.pad(self.cells, ((0, columns), (0, 0)))
        self.changed = np.zeros_like(self.cells, dtype=bool)

    def end_cycle(self, is_heard, is_updating):
        """Return the grid to send, and the place and the cells of the window; or None for each."""
        grid = window = None
        if self.always_full or self.sent_shape != self.cells.shape:
            if is_heard or self.sent_shape is None:
                grid = make_grid(self.cells)
            self.sent_shape = self.cells.shape
        elif self.changed.any() and is_updating:
            x, y = (slice(each.min(), each.max() + 1) for each in np.nonzero(self.changed))
            window = x.start, y.start, self.cells[x, y]
        self.changed = np.zeros_like(self.cells, dtype=bool)
        return grid, window


def make_pose(x, y, yaw, frame="map", tilt=0.0):
    """Return a stamped pose, tilted if its quaternion has an x."""
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.x = tilt
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def build(cells, footprint=FOOTPRINT):
    """Build the node's map by the library alone."""
    robot = cspace.Robot.from_footprint(footprint, padding=0.01)
    return cspace.build(cspace.Workspace.from_occupancy_grid(make_grid(cells)), robot, rotations=72)


class Client:
    """A node that talks to the planner, and keeps the last message of each of its topics."""

    def __init__(self):
        self.node = rclpy.create_node("client")
        self.executor = SingleThreadedExecutor()  # the default one ends with the first context
        self.executor.add_node(self.node)
        self.maps = self.node.create_publisher(OccupancyGrid, "map", KEPT)
        self.footprints = self.node.create_publisher(Polygon, "footprint", 1)
        self.service = self.node.create_client(GetPlan, "cspace_planner/make_plan")
        self.last = {}
        for name, kind in (("map", OccupancyGrid), ("plan", Path), ("markers", MarkerArray)):
            self.node.create_subscription(
                kind, f"cspace_planner/{name}", lambda msg, name=name: self.keep(name, msg), KEPT
            )

    def keep(self, name, msg):
        """Keep the last message."""
        self.last[name] = msg

    def wait(self, is_done, seconds=600.0):
        """Spin until a condition holds, on a busy machine, too."""
        assert self.spin(is_done, seconds), "nothing came in time"

    def spin(self, is_done, seconds):
        """Spin until a condition holds; return False if it does not in time."""
        end = time.monotonic() + seconds
        while not is_done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        return is_done()

    def send(self, cells):
        """Publish a map, and return the map of configurations at yaw 0, [x, y]."""
        self.last.pop("map", None)
        self.maps.publish(make_grid(cells))
        self.wait(lambda: "map" in self.last)
        msg = self.last["map"]
        return np.reshape(msg.data, (msg.info.height, msg.info.width)).T

    def plan(self, start=START, goal=GOAL, **options):
        """Ask for a plan; return its poses as configurations, shape (n, 3)."""
        request = GetPlan.Request(start=make_pose(*start), goal=make_pose(*goal, **options))
        future = self.service.call_async(request)
        while not self.spin(future.done, 30.0):  # a node that was killed did not answer
            future = self.service.call_async(request)
        poses = [each.pose for each in future.result().plan.poses]
        places = [(p.position.x, p.position.y, p.orientation.z, p.orientation.w) for p in poses]
        x, y, sine, cosine = np.reshape(places, (-1, 4)).T
        return np.stack([x, y, 2 * np.arctan2(sine, cosine)], axis=1)

    def send_footprint(self, corners):
        """Publish a footprint."""
        points = [Point32(x=float(x), y=float(y)) for x, y in corners]
        self.last.pop("map", None)
        self.footprints.publish(Polygon(points=points))


def start_node(*arguments, stderr=None, **variables):
    """Start the node in a process of its own, with some variables of the environment."""
    command = [sys.executable, PACKAGE / "cspace_nav2_py/planner_node.py", "--ros-args"]
    command += ["--params-file", PACKAGE / "params.yaml", "-p", "time_limit:=10.0"]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, **variables}
    return subprocess.Popen([*command, *arguments], env=environment, stderr=stderr)


def stop_node(process, log=None):
    """Ask the node to end, and fail with its log if it goes on, or ends by an error."""
    process.terminate()
    try:
        code = process.wait(600)
    finally:
        process.kill()
    assert code == 0, log and log.read_text()


INTERRUPT = """
import concurrent.futures, os, runpy, sys, time
import rclpy, rclpy.executors, rclpy.node
file, kind, name, number = sys.argv[1:5]
kind = {"Node": rclpy.node.Node, "Executor": rclpy.executors.Executor}[kind]
call = getattr(kind, name)
def interrupt(*args, **options):
    setattr(kind, name, call)
    if number == "0":
        raise RuntimeError("a fault")
    if "BUSY" in os.environ:
        concurrent.futures.ThreadPoolExecutor(1).submit(time.sleep, 600.0)
    os.kill(os.getpid(), int(number))
    end = time.monotonic() + 1.0
    while rclpy.ok() and time.monotonic() < end:
        time.sleep(0.01)
    return call(*args, **options)
setattr(kind, name, interrupt)
del sys.argv[1:5]
runpy.run_path(file, run_name="__main__")
"""
"""Runs a node that is interrupted in a call of rclpy, or with signal 0 has a fault there."""


def interrupt_node(name, moment, number, **variables):
    """Run a node that is interrupted in a call of rclpy; return its exit code and errors."""
    command = [sys.executable, "-c", INTERRUPT, PACKAGE / "cspace_nav2_py" / name]
    command += [*moment, str(number), "--ros-args", "-p", "drive:=holonomic"]
    environment = {**os.environ, **variables}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    return ended.returncode, ended.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("moment", [("Node", "create_publisher"), ("Executor", "get_nodes")])
def test_an_interrupt_ends_it_at_any_moment(moment, number):
    code, errors = interrupt_node("planner_node.py", moment, int(number))
    assert code == 0 and "Traceback" not in errors, errors


def test_an_interrupt_ends_it_while_a_callback_takes_long():
    moment = ("Executor", "get_nodes")
    code, errors = interrupt_node("planner_node.py", moment, int(signal.SIGINT), BUSY="1")
    assert (code, errors) == (0, "")


def test_a_fault_ends_it_loudly():
    code, errors = interrupt_node("planner_node.py", ("Executor", "get_nodes"), 0)
    assert code == 1 and "RuntimeError: a fault" in errors, errors


TALK = """
import time, rclpy
from std_msgs.msg import Empty
rclpy.init()
publisher = rclpy.create_node("talker").create_publisher(Empty, "probe", 1)
while True:
    publisher.publish(Empty())
    time.sleep(0.1)
"""


@pytest.fixture(scope="module")
def ros():
    """Start ROS; skip if two processes cannot hear each other, e.g. without multicast."""
    rclpy.init()
    talker = subprocess.Popen([sys.executable, "-c", TALK])
    listener = Client()
    heard = []
    listener.node.create_subscription(Empty, "probe", heard.append, 1)
    hears = listener.spin(lambda: heard, 60.0)
    talker.kill()
    talker.wait()
    listener.node.destroy_node()
    if not hears:
        pytest.skip("two ROS processes do not discover each other on this machine")
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def client(ros):
    process = start_node()
    client = Client()
    client.maps.publish(make_grid(make_room()))
    client.process = process
    client.wait(lambda: "map" in client.last)  # the first start compiles
    yield client
    stop_node(client.process)


def assert_equal_map(client, cells):
    """Compare the published map with the library's."""
    expected = build(cells).to_occupancy_grid(rotation=0.0)
    np.testing.assert_array_equal(client.send(cells), np.reshape(expected.data, (80, 120)).T)


def assert_free(rows, cells):
    """Prove a path again."""
    assert len(rows) > 1 and build(cells).certify_path(rows).all()
    np.testing.assert_allclose(rows[[0, -1]], [START, GOAL], atol=1e-9)


def test_maps_and_updates_are_those_of_the_library(client):
    for gap in (20, 30, 20):
        assert_equal_map(client, make_room(gap))
    other = np.pad(make_room(), 3)  # another grid
    assert client.send(other).shape == other.shape
    assert_equal_map(client, make_room())


def test_paths_are_proven_and_shown(client):
    client.send(make_room())
    assert_free(client.plan(), make_room())
    client.wait(lambda: client.last.get("plan") and client.last["plan"].poses)
    markers = client.last["markers"].markers
    assert len(markers[1].points) > 8 and markers[1].header.frame_id == "map"


def test_without_a_path_the_barrier_is_shown(client):
    client.send(make_room(gap=3))
    client.last.pop("markers", None)
    assert not len(client.plan())
    client.wait(lambda: "markers" in client.last)  # the first explanation compiles
    points = np.array([(p.x, p.y) for p in client.last["markers"].markers[1].points])
    assert len(points) and (np.abs(points[:, 0] - 3.0) < 1.0).any()
    client.send(make_room())


def spoil_maps():
    """Yield maps that are none."""
    for name, value in (("resolution", math.nan), ("resolution", 0.0), ("width", 0), ("width", 7)):
        msg = make_grid(make_room())
        setattr(msg.info, name, value)
        yield msg
    msg = make_grid(make_room())
    msg.info.origin.orientation.x = 1.0
    yield msg
    yield OccupancyGrid()


def set_tolerance(client, metres):
    """Set the node's tolerance while it runs."""
    service = client.node.create_client(SetParameters, "cspace_planner/set_parameters")
    assert service.wait_for_service(60.0)
    parameter = Parameter("tolerance", value=metres).to_parameter_msg()
    future = service.call_async(SetParameters.Request(parameters=[parameter]))
    client.wait(future.done)
    assert future.result().results[0].successful


def test_a_blocked_start_or_goal_moves_within_the_tolerance(client):
    client.send(make_room())
    blocked = (3.0, 1.0, 0.3)
    space = build(make_room())
    try:
        for metres in (0.0, 0.1, 0.8):
            set_tolerance(client, metres)
            assert_free(client.plan(), make_room())  # nothing else moves
            is_near = metres == 0.8
            for ends in ({"goal": blocked}, {"start": blocked}):
                rows = client.plan(**ends)
                assert (len(rows) > 1) == is_near
                if is_near:
                    assert space.certify_path(rows).all()
                    moved, other = rows[[0, -1]] if "start" in ends else rows[[-1, 0]]
                    assert 0.3 < math.dist(moved[:2], blocked[:2]) <= metres
                    assert "start" in ends or moved[2] == pytest.approx(blocked[2])
                    np.testing.assert_allclose(other, GOAL if "start" in ends else START, atol=1e-9)
        sealed = make_room(gap=3)
        client.send(sealed)
        assert not len(client.plan())  # the other side of the wall is farther away
        set_tolerance(client, 2.7)
        rows = client.plan()
        assert build(sealed).certify_path(rows).all() and math.dist(rows[-1, :2], GOAL[:2]) <= 2.7
    finally:
        set_tolerance(client, 0.0)
        client.send(make_room())


def test_a_new_footprint_builds_anew(client):
    long = [(0.9, 0.2), (0.9, -0.2), (-0.3, -0.2), (-0.3, 0.2)]
    client.send_footprint(long)
    client.wait(lambda: "map" in client.last)
    single = np.float32(long).tolist()  # as messages have it
    expected = build(make_room(), single).to_occupancy_grid(rotation=0.0)
    assert list(client.last["map"].data) == list(expected.data)
    client.send_footprint(json.loads(FOOTPRINT))
    client.wait(lambda: "map" in client.last)
    client.send(make_room())  # a node that starts again reads it


def test_the_node_is_killed_and_starts_again(client):
    client.process.kill()
    client.process.wait()
    client.last.pop("map", None)
    client.process = start_node()
    client.wait(lambda: "map" in client.last)  # it reads the last map again
    assert_free(client.plan(), make_room())


END = os.WEXITED | os.WNOHANG | os.WNOWAIT
"""Options that look whether a process ended, and leave its figures."""


def measure_cpu(pid):
    """Return the CPU seconds of a process, also of one that ended and was not waited for."""
    text = pathlib.Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    fields = text.rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_an_interrupt_ends_it_while_the_first_map_compiles(client, tmp_path):
    client.send(make_room())
    with (tmp_path / "log").open("w+") as log:
        options = ("-r", "__node:=second", "-p", "drive:=differential")
        process = start_node(*options, stderr=log, XDG_CACHE_HOME=str(tmp_path))
        client.wait(lambda: "building the first map" in (tmp_path / "log").read_text(), 300.0)
        before = measure_cpu(process.pid)
        process.send_signal(signal.SIGINT)
        try:
            while os.waitid(os.P_PID, process.pid, END) is None:
                time.sleep(0.1)
            assert measure_cpu(process.pid) - before < 1.0  # other processes do not lengthen it
            assert process.wait() == 0
        finally:
            process.kill()
    text = (tmp_path / "log").read_text()
    assert "ready" not in text and "Traceback" not in text


@pytest.mark.parametrize(
    "setting, message",
    [
        ("drive:=''", "drive is missing; it must be"),
        ("drive:=nonsense", "drive is 'nonsense'; it must be"),
        ("drive:=dubins", "turning_radius is 0.0"),
        ("rotations:=0", "rotations"),
        ("time_limit:=-1.0", "time_limit"),
        ("free_thresh:=0.9", "free_thresh"),
    ],
)
def test_a_wrong_parameter_ends_it_with_one_line(ros, setting, message, tmp_path):
    with (tmp_path / "log").open("w+") as log:
        process = start_node("-p", setting, stderr=log)
        assert process.wait(600) == 1
    last = (tmp_path / "log").read_text().strip().splitlines()[-1]
    assert last.startswith("cspace_planner: ") and message in last

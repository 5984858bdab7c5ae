"""The ROS 2 node on a costmap whose publisher follows the rules of Nav2 1.3.13.

That publisher is C++ without a wheel; a class here publishes by the same rules through ROS 2. The
update is map_msgs' own where it is installed, else a stand-in with its fields.
"""

import os
import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 has an environment of its own: nox -s ros")

from tests.helpers.repository import ROOT  # noqa: E402

if not find_spec("map_msgs"):
    STAND_IN = str(ROOT / "tests/ros/messages")
    sys.path.append(STAND_IN)
    os.environ["PYTHONPATH"] = os.pathsep.join([os.environ.get("PYTHONPATH", ""), STAND_IN])

from map_msgs.msg import OccupancyGridUpdate  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from rclpy.duration import Duration  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402

from tests.ros.test_planner_node import (  # noqa: E402, F401
    KEPT,
    Cells,
    Client,
    assert_free,
    build,
    make_room,
    ros,
    start_node,
    stop_node,
)

# The stand-in gives grids the fields of updates, too.
pytestmark = pytest.mark.filterwarnings("ignore:.*not read. height, width, x, y")

TOPIC = "/global_costmap/costmap"
OPTIONS = ["-r", f"map:={TOPIC}", "-p", "free_thresh:=0.995", "-p", "occupied_thresh:=1.0"]
WAITS = "waiting for a full grid"


class Costmap(Cells):
    """A node that publishes cells."""

    def __init__(self, cells):
        super().__init__(cells, always_full=False)
        self.node = rclpy.create_node("costmap")
        self.grids = self.node.create_publisher(OccupancyGrid, TOPIC, KEPT)
        self.updates = self.node.create_publisher(OccupancyGridUpdate, f"{TOPIC}_updates", KEPT)

    def is_heard(self):
        """Return True if a planner listens to both topics."""
        return self.grids.get_subscription_count() > 1 and self.is_updating()

    def is_updating(self):
        """Return True if anyone listens to updates."""
        return self.updates.get_subscription_count() > 0

    def is_alone(self):
        """Return True if nobody listens."""
        return not self.grids.get_subscription_count() and not self.is_updating()

    def set(self, x, y, value):
        """Change the cells of two slices, and publish."""
        self.change(x, y, value)
        self.publish()

    def grow(self, columns=8):
        """Add free columns, and publish."""
        super().grow(columns)
        self.publish()

    def publish(self):
        """End a cycle."""
        is_heard = self.grids.get_subscription_count() > 0
        grid, window = self.end_cycle(is_heard, self.is_updating())
        if grid is not None:
            self.send(self.grids, grid)
        if window is not None:
            self.send(self.updates, make_update(*window))

    def send(self, publisher, msg):
        """Publish a message with the time, and wait until it came, as a slow cycle does."""
        msg.header.stamp = self.node.get_clock().now().to_msg()
        publisher.publish(msg)
        publisher.wait_for_all_acked(Duration(seconds=60.0))


def make_update(x, y, cells, frame="map"):
    """Return an update of cells [x, y]."""
    msg = OccupancyGridUpdate()
    msg.header.frame_id = frame
    msg.x, msg.y = int(x), int(y)
    msg.width, msg.height = cells.shape
    msg.data = cells.T.ravel().tolist()
    return msg


class Planner:
    """A node in a process of its own, with its log, and a client."""

    def __init__(self, folder):
        self.log = folder / "node.log"
        self.client = Client()
        with self.log.open("w") as log:
            self.process = start_node(*OPTIONS, stderr=log)

    def says(self, text):
        """Return True if the log has a text."""
        return text in self.log.read_text()

    def assert_follows(self, cells):
        """Wait until its map is the library's, and it plans a proven path."""
        expected = list(build(cells).to_occupancy_grid(rotation=0.0).data)
        last = self.client.last
        self.client.wait(lambda: "map" in last and list(last["map"].data) == expected, 300.0)
        assert_free(self.client.plan(), cells)


@pytest.fixture
def start(ros, tmp_path):  # noqa: F811
    made = []

    def make():
        made.append(Planner(tmp_path))
        return made[-1]

    yield make
    for each in made:
        each.client.node.destroy_node()
        stop_node(each.process, each.log)


@pytest.fixture
def publish(ros):  # noqa: F811
    made = []

    def make(*args, **options):
        made.append(Costmap(*args, **options))
        return made[-1]

    yield make
    for each in made:
        each.node.destroy_node()


def test_updates_from_the_start_are_all_seen(start, publish):
    planner = start()
    costmap = publish(make_room())
    planner.client.wait(costmap.is_heard, 300.0)  # Nav2 configures before it activates
    costmap.publish()
    for step in range(40):  # it builds for longer than that
        costmap.set(slice(2 * step + 5, 2 * step + 7), slice(2, 6), 100)
        time.sleep(0.02)
    planner.assert_follows(costmap.cells)
    costmap.set(slice(58, 62), slice(0, 80), 100)
    closed = list(build(costmap.cells).to_occupancy_grid(rotation=0.0).data)
    planner.client.wait(lambda: list(planner.client.last["map"].data) == closed)
    assert not len(planner.client.plan())
    costmap.set(slice(58, 62), slice(60, 79), 0)
    planner.assert_follows(costmap.cells)
    assert not planner.says(WAITS)
    free = np.zeros((10, 10), dtype=np.int8)
    for wrong in (
        make_update(costmap.cells.shape[0] - 5, 0, free),
        make_update(0, 0, free, "odom"),
    ):
        costmap.updates.publish(wrong)
        planner.client.wait(lambda: not len(planner.client.plan()))
        costmap.grow()
        planner.assert_follows(costmap.cells)
    assert planner.says(WAITS) and planner.says("(115, 0)") and planner.says("'odom'")


class Reader:
    """A reader of the node's map that applies its windows, as RViz does."""

    def __init__(self, hears_windows=True):
        self.node = rclpy.create_node("reader")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.cells, self.grids, self.windows = None, 0, []
        subscribe = self.node.create_subscription
        subscribe(OccupancyGrid, "cspace_planner/map", self.on_map, KEPT)
        if hears_windows:
            subscribe(OccupancyGridUpdate, "cspace_planner/map_updates", self.on_window, 100)

    def on_map(self, msg):
        self.grids += 1
        self.cells = np.reshape(msg.data, (msg.info.height, msg.info.width)).T

    def on_window(self, msg):
        self.windows.append((msg.width, msg.height))
        window = np.reshape(msg.data, (msg.height, msg.width)).T
        self.cells[msg.x : msg.x + msg.width, msg.y : msg.y + msg.height] = window

    def wait_for(self, cells):
        """Wait until it has the library's map; one that misses obstacles never gets there."""
        grid = build(cells).to_occupancy_grid(rotation=0.0)
        wanted = np.reshape(grid.data, cells.T.shape).T
        end = time.monotonic() + 300.0
        while not np.array_equal(self.cells, wanted) and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        np.testing.assert_array_equal(self.cells, wanted)


def test_its_map_is_published_as_windows_and_late_readers_miss_nothing(start, publish):
    planner = start()
    planner.client.node.destroy_node()  # it hears no windows
    planner.client.node = rclpy.create_node("none")
    costmap = publish(make_room())
    first = Reader()
    end = time.monotonic() + 300.0
    while not costmap.is_heard() and time.monotonic() < end:
        time.sleep(0.05)
    costmap.publish()
    first.wait_for(costmap.cells)
    grids = first.grids
    for step in range(3):
        costmap.set(slice(20 * step + 5, 20 * step + 9), slice(20, 24), 100)
        first.wait_for(costmap.cells)
    assert first.grids == grids and first.windows
    assert all(width < 60 and height < 60 for width, height in first.windows)
    late, plain = Reader(), Reader(hears_windows=False)
    late.wait_for(costmap.cells)
    plain.wait_for(costmap.cells)
    costmap.set(slice(100, 104), slice(40, 44), 100)  # one of them hears no windows
    for reader in (first, late, plain):
        reader.wait_for(costmap.cells)
        reader.node.destroy_node()
    while planner.process.poll() is None and costmap.node.count_subscribers("cspace_planner/map"):
        time.sleep(0.05)
    costmap.set(slice(110, 114), slice(60, 64), 100)  # for nobody
    time.sleep(0.5)
    last = Reader()
    last.wait_for(costmap.cells)
    last.node.destroy_node()

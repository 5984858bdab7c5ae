"""The package for Nav2 in a process, over stubs, and a room in which it plans."""

import json
import math
from xml.etree import ElementTree

import numpy as np
import shapely
from shapely import affinity

import cspace
from tests.helpers.cpp import Program, build_program
from tests.helpers.repository import ROOT

PACKAGE = ROOT / "ros" / "cspace_nav2"
ANSWERS = ROOT / "tests" / "cpp" / "nav2"
HALF_SIDES = (0.3, 0.2)
LETHAL = 254

DRIVES = {"differential": 0, "differential-reverse": 0, "dubins": 0.4, "reeds-shepp": 0.4}
WALLS = shapely.union_all([shapely.box(2.8, 0, 3.2, 2.5), shapely.box(0, 0, 7, 3.8).boundary])
"""Turning radii of drives that cannot move aside, and the walls of the room."""


def write_pose(x, y, yaw, tilt=0.0):
    half, lean = yaw / 2, tilt / 2
    sines = (math.cos(half) * math.sin(lean), math.sin(half) * math.sin(lean))
    rest = (math.sin(half) * math.cos(lean), math.cos(half) * math.cos(lean))
    return " ".join(map(repr, (float(x), float(y), *sines, *rest)))


class Nav2(Program):
    """A planner server in a process."""

    def __init__(self, program, log):
        super().__init__([program], log)
        self.tell("footprint", *HALF_SIDES)

    def ask(self, command):
        self.tell(command)
        return json.loads(self.read_line())

    def set(self, **parameters):
        for name, value in parameters.items():
            self.tell(f"set plan.{name}", value)

    def configure(self, room, **parameters):
        usual = {"drive": "holonomic", "time_limit": 5, "tolerance": 0, "start_tolerance": 0}
        self.set(map=room, **{**usual, **parameters})
        assert self.ask("configure") == {"code": 0}

    def add_cost(self, low, high, cost=LETHAL):
        """Give cells of 0.1 m from one corner to another a cost."""
        inner = [*np.add(low, 0.05), *np.subtract(high, 0.05)]
        self.tell("costs", *inner, cost)

    def plan(self, *poses):
        return self.ask(" ".join(["plan", *(write_pose(*pose) for pose in poses)]))

    def find_path(self, *poses):
        answer = self.plan(*poses)
        assert answer["code"] == 0, answer
        return np.array(answer["path"])

    def send_grid(self, cells, file, side=0.1, frame="map", origin=(0, 0)):
        """Publish a grid of cells [x, y], 0 for free, 1 for occupied, 2 for unknown."""
        file.write_text("".join(map(str, np.asarray(cells, dtype=int).T.ravel())))
        columns, rows = cells.shape
        self.tell(f"grid {frame} {columns} {rows} {side} {origin[0]} {origin[1]} {file}")


def outline_cells(pose, side):
    """Return the cells of a costmap that Nav2's footprint checker tests at a pose."""
    x, y, yaw = pose
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    corners = np.multiply([(1, 1), (1, -1), (-1, -1), (-1, 1)], HALF_SIDES) @ turn.T + (x, y)
    cells = np.floor(corners / side).astype(int)
    # The line from the last corner to the first is drawn from the first.
    ends = [(cells[0], cells[1]), (cells[1], cells[2]), (cells[2], cells[3]), (cells[0], cells[3])]
    return {cell for first, last in ends for cell in line_cells(first, last)}


def line_cells(first, last):
    """Return the cells of a line between two cells, by Bresenham's rule with halves rounded as in Nav2."""
    steps = int(np.abs(last - first).max())
    minor = int(np.abs(last - first).argmin()) if steps else 0
    gain = abs(int(last[minor] - first[minor]))
    cells = []
    for k in range(steps + 1):
        cell = first + np.sign(last - first) * k
        cell[minor] = first[minor] + np.sign(last - first)[minor] * (
            (steps // 2 + k * gain) // max(steps, 1)
        )
        cells.append(tuple(cell.tolist()))
    return cells


def list_needs(folder):
    """Return the keys that a package gives to rosdep."""
    tags = ("depend", "buildtool_depend", "build_depend", "exec_depend")
    return {
        each.text
        for each in ElementTree.parse(folder / "package.xml").getroot()
        if each.tag in tags
    }


def list_stubs(version):
    """Return the folders of the stubs of a version, "jazzy" or "main"."""
    return [ANSWERS / "stubs" / version, ANSWERS / "stubs" / "common"]


def build_server(target, version, *flags):
    """Compile the package over the stubs of a version, "jazzy" or "main"."""
    folders = [PACKAGE / "include", *list_stubs(version)]
    return build_program(
        target,
        *flags,
        str(PACKAGE / "src" / "planner.cpp"),
        *(f"-I{folder}" for folder in folders),
        source=ANSWERS / "answers.cpp",
    )


def make_room():
    """Return the cells of a room that a wall divides up to y = 2.5; the costmap has 6 x 4 m of it."""
    cells = np.zeros((70, 38), dtype=bool)
    cells[28:32, :25] = True
    return cells


def build_room(robot, rotations):
    """Build a map of the room."""
    return cspace.build(cspace.Workspace.from_array(make_room(), 0.1), robot, rotations=rotations)


def place_body(pose):
    """Return the robot at a pose."""
    x, y = HALF_SIDES
    turned = affinity.rotate(shapely.box(-x, -y, x, y), pose[2], (0, 0), use_radians=True)
    return affinity.translate(turned, *pose[:2])

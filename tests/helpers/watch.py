"""A watch of a gate in a C++ process, and a robot with a laser that it drives among people."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

import cspace
from tests.helpers.cpp import Program, build_program
from tests.helpers.leaving import drive, place_along
from tests.helpers.nav2 import ANSWERS, PACKAGE, list_stubs
from tests.helpers.regions import place_polygon

DT, BRAKES, TRACKING, POINT_RADIUS = 0.05, np.array([1.0, 2.0]), 0.02, 0.02
"""Seconds of a cycle, m/s^2 and rad/s^2 of the brakes, metres and radians, metres."""

BODY = shapely.box(-0.3, -0.2, 0.3, 0.2)
MAX_SPEED = 0.8 + 1.5 * 0.36
"""Of any point of the robot, m/s, if commands are at most 0.8 m/s and 1.5 rad/s."""

PERSON, TALL = 0.2, 1.8
"""Radius and height of a person, metres."""

CLOCK = 1_700_000_000_000_000_000
"""Nanoseconds by which the clock of stamps is ahead."""

WALLS = shapely.union_all(
    [
        shapely.box(0, 0, 6, 4).exterior.buffer(0.05, join_style="mitre"),
        shapely.box(2.9, 0.0, 3.1, 2.4),
        shapely.box(4.5, 2.5, 4.9, 2.9),
    ]
)


def save_room(folder):
    """Save the map of a room that has the walls, and no people; return its path."""
    cells = np.zeros((120, 80), dtype=bool)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[58:62, :48] = cells[90:98, 50:58] = True
    workspace = cspace.Workspace.from_array(cells, 0.05)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=72)
    space.save(folder / "map", compress=False)
    return folder / "map"


def build_watch(target, *flags):
    """Compile the program over messages that are installed beside Python, else over stubs."""
    installed = Path(sys.prefix, "include")
    has_messages = (installed / "sensor_msgs").is_dir()
    folders = list(installed.iterdir()) if has_messages else list_stubs("jazzy")
    options = [option for folder in folders for option in ("-isystem", str(folder))]
    own = f"-I{PACKAGE / 'include'}"
    return build_program(target, *flags, own, *options, source=ANSWERS / "watch.cpp")


class Decided(NamedTuple):
    """What the robot is to drive, why it brakes, and microseconds of CPU."""

    twist: np.ndarray
    reason: str
    spent: float


class WatchInCpp(Program):
    """A watch of a running program; ``look_up`` answers where frames are."""

    def __init__(self, program, map_, point_radius=POINT_RADIUS, sources="scan", size=2):
        """Start the program; twists have ``size`` numbers, the third one to the side."""
        self.size = size
        numbers = (DT, *BRAKES, *(TRACKING,) * 3, point_radius)
        super().__init__([program, map_, *map(float, numbers), sources])

    def decide(self, now, clock, look_up):
        """Return what it decides."""
        self.tell("decide", now, clock)
        while True:
            word, *words = self.read_line().split(" ")
            if word != "look":
                break
            self.tell(look_up(words[0], words[1], int(words[2])))
        twist = np.array(list(map(float, (word, *words[:2])))[: self.size])
        return Decided(twist, " ".join(words[3:]), float(words[2]))


class Frame(NamedTuple):
    """A rigid motion: a rotation and a translation."""

    turn: Rotation
    at: np.ndarray

    def then(self, other):
        """Return this motion after another one, which is applied first."""
        return Frame(self.turn * other.turn, self.at + self.turn.apply(other.at))

    def invert(self):
        """Return the inverse."""
        turn = self.turn.inv()
        return Frame(turn, -turn.apply(self.at))


def make_frame(x, y, yaw, z=0.0):
    """Return the frame at a pose, or the frames at many."""
    zeros = np.zeros_like(yaw)
    at = np.stack(np.broadcast_arrays(x, y, z + zeros), axis=-1)
    return Frame(Rotation.from_rotvec(np.stack([zeros, zeros, yaw], axis=-1)), at)


class Robot:
    """A robot that drives what it is told, and the frames that tf knows of it."""

    def __init__(self, pose, mount=None):
        """Stand at a pose at time 0; ``mount`` is the laser's frame on the robot."""
        self.now, self.cycles = 0, [(0, np.array(pose, dtype=float), np.zeros(2))]
        self.mount = mount or Frame(Rotation.identity(), np.array((0.1, 0.0, 0.25)))
        self.odometry = make_frame(0.4, -0.3, 0.7)
        self.late = 0  # nanoseconds by which tf lags
        self.unknown = ()  # frames that tf does not have
        self.asked = []

    @property
    def pose(self):
        """Where it is now."""
        return self.pose_at(self.now)

    @property
    def twist(self):
        """What it drives now."""
        return self.cycles[-1][2]

    def pose_at(self, time):
        """Return where it was."""
        return self.poses_at(np.array([time]))[0]

    def poses_at(self, times):
        """Return where it was at times, shape (n, 3)."""
        begins = np.array([begin for begin, _, _ in self.cycles])
        numbers = np.maximum(np.searchsorted(begins, times, side="right") - 1, 0)
        poses = np.empty((len(times), 3))
        for number in np.unique(numbers):
            begin, pose, twist = self.cycles[number]
            chosen = numbers == number
            poses[chosen] = drive(pose, twist, np.maximum(times[chosen] - begin, 0) / 1e9)
        return poses

    def frame_at(self, frame, time):
        """Return a frame in the map."""
        if frame == "map":
            return make_frame(0.0, 0.0, 0.0)
        if frame == "odom":
            return self.odometry
        base = make_frame(*self.pose_at(time))
        return base.then(self.mount) if frame == "laser" else base

    def look_up(self, target, frame, stamp):
        """Answer where a frame is in another one."""
        self.asked.append((target, frame))
        for name in {target, frame} & set(self.unknown):
            return f"never {name}"
        newest = self.now - self.late
        time = newest if stamp == 0 else stamp - CLOCK
        if time > newest:
            return "later"
        moved = self.frame_at(target, time).invert().then(self.frame_at(frame, time))
        numbers = [*moved.at, *moved.turn.as_quat()]
        return " ".join([*(repr(float(number)) for number in numbers), str(time + CLOCK)])

    def drive(self, twist):
        """Go on by a cycle; return the bodies on the way, at most 5 mm apart."""
        self.cycles.append((self.now, self.pose, np.array(twist)))
        self.now += round(1e9 * DT)
        start = self.cycles[-1][1]
        return place_polygon(BODY, place_along(start, [twist], DT, instants=12))

    def scan(self, people, rays=360, sweep=0):
        """Return the ranges of a laser that sees people, and the floor, since ``sweep`` nanoseconds."""
        instants = self.now - sweep + sweep * np.arange(rays) // max(rays - 1, 1)
        lasers = make_frame(*self.poses_at(instants).T).then(self.mount)
        places = lasers.at
        angles = np.arange(rays) * 2.0 * math.pi / rays
        ways = lasers.turn.apply(np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1))
        level = np.hypot(ways[:, 0], ways[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges = np.where(ways[:, 2] < 0.0, -places[:, 2] / ways[:, 2], np.inf)
            for person in np.reshape(people, (-1, 2)):
                offset = person - places[:, :2]
                along = (ways[:, :2] * offset).sum(axis=1) / level
                half = PERSON**2 - ((offset**2).sum(axis=1) - along**2)
                hit = np.where(half >= 0.0, (along - np.sqrt(half)) / level, np.inf)
                height = places[:, 2] + hit * ways[:, 2]
                seen = (hit > 0.0) & (height >= 0.0) & (height <= TALL)
                ranges = np.where(seen, np.minimum(ranges, hit), ranges)
        return np.where(ranges <= 20.0, ranges, np.inf)

    def brake(self):
        """Return the commands that bring it to rest after the present one."""
        steps = math.ceil(float((np.abs(self.twist) / (DT * BRAKES)).max()) - 1e-9)
        return [self.twist * (1.0 - k / steps) for k in range(1, steps)]


def send_scan(watch, robot, ranges, stamp=None, name="scan", frame="laser", sweep=0):
    """Send a scan of a whole turn, of now if it has no stamp; its rays take ``sweep`` nanoseconds."""
    step = 2.0 * math.pi / max(len(ranges), 1)
    stamp = robot.now if stamp is None else stamp
    words = " ".join(repr(float(number)) for number in ranges)
    seconds = sweep / 1e9 / max(len(ranges) - 1, 1)
    watch.tell("scan", name, frame, stamp + CLOCK, 0.0, step, 0.02, 25.0, seconds, words)


def sweep(pose, commands):
    """Return robots along commands, at most 5 mm apart."""
    if not len(commands):
        return place_polygon(BODY, np.array([pose]))
    return place_polygon(BODY, place_along(pose, commands, DT, instants=12))


class People:
    """Two people who walk at random, or step up as near as the robot can still stop."""

    def __init__(self, rng, reaction=0.0):
        """Begin far from the room; ``reaction`` is how long the robot may not know, seconds."""
        self.rng, self.reaction = rng, reaction
        self.places = np.array([(20.0, 20.0), (30.0, 20.0)])

    def step(self, pose, brake):
        """Move each person, unless a robot with commands that brake could not stop before them."""
        bodies = shapely.multipolygons(sweep(pose, brake))
        reach = PERSON + self.reaction * MAX_SPEED
        for k, old in enumerate(self.places):
            kind = self.rng.integers(8)
            place = old + self.rng.normal(0.0, 0.04, 2)
            if kind == 0:  # a person comes from behind a door
                place = pose[:2] + self.rng.normal(0.0, 0.8, 2)
            if kind <= 2:  # the person steps up to within millimetres
                near = shapely.shortest_line(bodies, shapely.Point(place))
                touch, far = shapely.get_coordinates(near)
                gap = reach + self.rng.choice([0.001, 0.005, 0.02, 0.06])
                length = np.hypot(*(far - touch))
                if length > reach - PERSON:
                    place = touch + gap * (far - touch) / length
            if bodies.distance(shapely.Point(place)) > reach:
                self.places[k] = place

    def measure_distance(self, bodies):
        """Return the least distance of bodies from the people."""
        points = shapely.points(self.places)
        return float(shapely.distance(np.array(bodies)[:, np.newaxis], points).min()) - PERSON

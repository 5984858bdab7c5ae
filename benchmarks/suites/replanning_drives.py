"""A robot that drives at speed among moving crates: distance covered, proofs, limits and cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import shapely
import shapely.affinity

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing
from cspace import ConfigurationError, CSpace, Robot, Workspace
from cspace._support.arrays import Floats
from planners import Plan, Trajectory

SCENES, QUICK_SCENES = 20, 1
"""Number of scenes for each drive."""

SIDE, SPACING, DENSITY, YAWS = 240, 0.05, 0.08, 36
"""Cells along each side of a scene, their size in metres, share of occupied cells, yaw cells."""

FOOTPRINT = 0.6, 0.4
"""Length and width of the robot, metres."""

PERIOD, CYCLES, QUICK_CYCLES = 0.1, 200, 20
"""Seconds of a cycle, and number of cycles of a scene."""

CRATES, CRATE_SIDE, CRATE_SPEED, WAITING = 5, 0.5, 0.4, 0.25
"""Number of crates, their side and mean speed, and how near to robot and goal they wait; metres."""

GOALS, LEAST_DISTANCE = 20, 5.0
"""Number of goals, and their least distance, metres."""

LIMITS = {"max_velocity": 0.8, "max_acceleration": 0.8}
TURNING_LIMITS = {"max_angular_velocity": 1.5, "max_angular_acceleration": 3.0}

DRIVES: dict[str, planners.Car | planners.Differential | None] = {
    "holonomic": None,
    "differential": planners.Differential(),
    "reeds-shepp": planners.Car(turning_radius=0.5, reverse=True),
}
"""Drives by name."""

MIN_SHARE, MAX_MEDIAN_SECONDS, MAX_SLOW_SECONDS = 0.9, 0.025, 0.06
"""Targets: median share of the distance without crates, and CPU seconds of a cycle after its updates.
"""

INSTANTS, JUMP_SLACK = 20, 1.001
"""Instants of each cycle at which the robot is compared with crates and limits, and slack."""


@dataclass
class Crates:
    """Crates that move to and fro, and wait for the robot."""

    centers: Floats
    velocities: Floats
    placed: dict[str, shapely.Polygon] = field(default_factory=dict)

    @classmethod
    def draw(cls, space: CSpace, rng: np.random.Generator) -> Crates:
        """Draw places and velocities."""
        centers = rng.uniform(space.grid.lower, space.grid.upper, (CRATES, 2))
        return cls(centers, rng.normal(0.0, CRATE_SPEED, (CRATES, 2)))

    def move(self, space: CSpace, kept: shapely.Geometry) -> None:
        """Move all crates for a cycle, but those that would come too near robot or goal."""
        moving = dict[str, shapely.Polygon]()
        for k, moved in enumerate(self.centers + PERIOD * self.velocities):
            half = 0.5 * CRATE_SIDE
            shape = shapely.box(*(moved - half), *(moved + half))
            if shape.distance(kept) > WAITING:
                self.centers[k] = moved
                moving[f"crate {k}"] = shape
        self.placed |= moving
        space.update(moving)
        is_out = (self.centers < space.grid.lower) | (self.centers > space.grid.upper)
        self.velocities[is_out] *= -1.0


@dataclass
class Drive:
    """What a robot drove, and how long the updates and the rest of its cycles took."""

    distance: float = 0.0
    touched: int = 0
    jumps: int = 0
    stops: int = 0
    cycles: Timing = field(default_factory=lambda: Timing(None))
    updates: Timing = field(default_factory=lambda: Timing(None))


class Driver:
    """The loop: plan anew in each cycle, go on at speed, and stop by proof."""

    def __init__(
        self, space: CSpace, start: Floats, drive: planners.Car | planners.Differential | None
    ) -> None:
        self.space = space
        self.drive = drive
        turns_freely = not isinstance(drive, planners.Car)
        self.limits = LIMITS | (TURNING_LIMITS if turns_freely else {})
        self.plan: Plan = planners.plan(space, start, start, drive=drive)
        self.motion: Trajectory = self.plan.trajectory(**self.limits)
        self.clock = 0.0

    def step(self, goal: Floats) -> bool:
        """Choose the motion after this cycle; return whether it is proven now and ends at the goal.

        Otherwise it is the stop that was proven before.
        """
        old, at = self.motion, self.clock + PERIOD
        left = old.duration - at if is_for(old, goal) else 0.0
        for place in old.starts_after(at):
            try:
                plan = planners.plan(self.space, place, goal, drive=self.drive, previous=self.plan)
            except ConfigurationError:  # a crate is near that place
                continue
            self.plan = plan if plan else self.plan
            new = plan.trajectory(**self.limits, after=old, at=at)
            is_quicker = is_for(new, goal) and new.duration < left
            if left > 0.0 and not is_quicker and old.recheck(self.space).all():
                self.clock = at
                return True
            if is_for(new, goal):
                self.motion, self.clock = new, 0.0
                return True
        self.motion, self.clock = old.braked(at), 0.0
        return False


def run_drives(report: Report, seed: int) -> None:
    """Drive through scenes with and without crates, with each drive."""
    for drive, kind in DRIVES.items():
        scenes = QUICK_SCENES if report.quick else SCENES
        report.section(
            f"{drive}: {scenes} drives at {LIMITS['max_velocity']} m/s among {CRATES} crates"
        )
        alone, among = [], []
        for number in range(scenes):
            drive_through = partial(_drive_through, kind, seed + number)
            alone.append(drive_through(report, False))
            among.append(drive_through(report, True))
        shares = [b.distance / a.distance for a, b in zip(alone, among, strict=True)]
        cycles, updates = Timing(None), Timing(None)
        whole = np.concatenate([np.add(each.updates.cpu, each.cycles.cpu) for each in among])
        for driven in among:
            cycles.cpu += driven.cycles.cpu
            cycles.seconds += driven.cycles.seconds
            updates.cpu += driven.updates.cpu
            updates.seconds += driven.updates.seconds
        stops = sum(driven.stops for driven in among)
        slow = float(np.percentile(cycles.cpu, 95))
        report.timing(f"{drive}, the updates of a cycle", updates)
        report.timing(
            f"{drive}, a cycle after its updates",
            cycles,
            cpu_95_s=round(slow, 4),
            stops_by_proof=stops,
        )
        report.figure(
            "share of the distance without crates", float(np.median(shares)), "", least=MIN_SHARE
        )
        report.figure(
            "median CPU time of a cycle",
            1e3 * cycles.median_cpu,
            "ms",
            most=1e3 * MAX_MEDIAN_SECONDS,
        )
        report.figure("95 % of CPU times", 1e3 * slow, "ms", most=1e3 * MAX_SLOW_SECONDS)
        for name, share in (("median", 0.5), ("95 %", 0.95)):
            milliseconds = 1e3 * float(np.quantile(whole, share))
            report.figure(f"CPU time of a cycle with its updates, {name}", milliseconds, "ms")
        touched = sum(driven.touched for driven in among)
        report.check(touched == 0, f"{touched} instants touch a crate where it was when proven")
        jumps = sum(driven.jumps for driven in among)
        report.check(jumps == 0, f"{jumps} changes of velocity are beyond the limits")


def _drive_through(
    kind: planners.Car | planners.Differential | None, seed: int, report: Report, has_crates: bool
) -> Drive:
    """Drive from goal to goal for some seconds."""
    rng = np.random.default_rng(seed)
    occupied = inputs.boxes(SIDE, DENSITY, rng, each=1)
    workspace = Workspace.from_array(occupied, SPACING)
    space = cspace.build(workspace, Robot.rectangle(*FOOTPRINT), rotations=YAWS)
    crates = Crates.draw(space, rng)
    goals = _draw_goals(space, rng, GOALS)
    driver = Driver(space, goals[0], kind)
    drive = Drive()
    proven_among: list[shapely.Polygon] = []
    goal = 1
    t = np.linspace(0.0, PERIOD, INSTANTS + 1)
    for _ in range(QUICK_CYCLES if report.quick else CYCLES):
        motion = driver.motion
        now = driver.clock
        here = motion.sample(now)[0]
        if now >= motion.duration and is_for(motion, goals[goal]):
            goal += 1
        if has_crates:
            kept = _place(here).union(_place(goals[goal]))
            drive.updates.take(partial(crates.move, space, kept))
        is_new = drive.cycles.take(partial(driver.step, goals[goal]))
        drive.stops += not is_new
        rows, velocities, _ = motion.sample(now + t)
        drive.distance += float(np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1).sum())
        touching = shapely.STRtree(proven_among)
        drive.touched += len(touching.query([_place(q) for q in rows], predicate="intersects")[0])
        _, after, _ = driver.motion.sample(driver.clock)
        changes = np.diff(velocities[:, :2], axis=0, append=after[np.newaxis, :2])
        gains = np.linalg.norm(changes, axis=1)
        most = (
            LIMITS["max_acceleration"]
            * t[1]
            * (math.sqrt(2.0) if isinstance(kind, planners.Car) else 1.0)
        )
        drive.jumps += int(np.count_nonzero(gains > JUMP_SLACK * most))
        if is_new:
            proven_among = list(crates.placed.values())
    return drive


def is_for(motion: Trajectory, goal: Floats) -> bool:
    """Return whether a motion ends at a goal."""
    return bool(math.dist(motion.positions[-1][:2], goal[:2]) < 1e-6)


def _place(q: Floats) -> shapely.Polygon:
    """Return the robot, a little smaller, at a configuration."""
    length, width = FOOTPRINT
    robot = shapely.box(-length / 2, -width / 2, length / 2, width / 2).buffer(-1e-6)
    turned = shapely.affinity.rotate(robot, q[2], (0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, q[0], q[1])


def _draw_goals(space: CSpace, rng: np.random.Generator, count: int) -> list[Floats]:
    """Draw FREE configurations, each far from the one before and joined to it."""
    goals = [space.sample_free(1, rng)[0]]
    while len(goals) < count:
        q = space.sample_free(1, rng)[0]
        is_far = math.dist(q[:2], goals[-1][:2]) > LEAST_DISTANCE
        if is_far and space.motion_is_free(q, q) and space.is_connected(goals[0], q):
            goals.append(q)
    return goals

"""A robot that drives among moving crates and plans anew at each step; plans on large maps."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.paths import GENERATED_SPACING, RECTANGLE
from benchmarks.timing import Timing
from cspace import CSpace, Robot, Workspace
from cspace._rotations.base import METRES_PER_RADIAN
from cspace._support.arrays import Floats
from planners import Plan

SIDE, QUICK_SIDE, DENSITY, SCENE_YAWS = 1000, 300, 0.15, 36
"""Cells along each side of the scene, its share of occupied cells, and its yaw cells."""

STEPS, QUICK_STEPS, STEP = 100, 5, 0.5
"""Number of steps, and metres that the robot drives in each."""

CRATES, CRATE_SIDE, CRATE_STEP, CLEAR_RADIUS = 5, 0.8, 0.3, 1.5
"""Number of crates, their side and typical step, and the metres around start and goal that they
leave free."""

LEAST_DISTANCE_SHARE = 0.3
"""Least distance of a new goal, as a share of the map's diagonal."""

TIME_LIMIT = 10.0
"""Time limit of plans, seconds, so that all can succeed."""

DRIVES: dict[str, tuple[planners.Car | planners.Differential | None, float]] = {
    "holonomic": (None, 0.04),
    "differential": (planners.Differential(), 0.04),
    "reeds-shepp": (planners.Car(turning_radius=0.5, reverse=True), 0.08),
}
"""Each drive, and the target of the median CPU seconds of a plan."""

MAX_SLOW_SECONDS = 0.1
"""Target of the 95th percentile of CPU seconds."""

OFFICE_SIDE, OFFICE_YAWS, OFFICE_PLANS, MAX_OFFICE_SECONDS = 1520, 72, 20, 0.06
"""An office of rooms: cells along each side, yaw cells, number of plans, and the target of the
median CPU seconds."""

LARGE_SIDES, LARGE_PLANS, MAX_LARGE_SECONDS = (2000, 4000, 8000), 4, 0.6
"""Cells along each side of large offices, plans from corner to corner, and the target of the median
CPU seconds on the largest."""


def run_scenes(report: Report, seed: int) -> None:
    """Drive through a scene with each drive, and plan on large maps."""
    for name in DRIVES:
        _drive_through(report, name, seed)
    if not report.quick:
        _measure_office(report, seed)
        _measure_growth(report, seed)


def _build(occupied: Any, yaws: int) -> CSpace:
    """Build the map of a rectangle that rotates."""
    workspace = Workspace.from_array(occupied, GENERATED_SPACING)
    return cspace.build(workspace, Robot.polygon(RECTANGLE), rotations=yaws)


def _drive_through(report: Report, name: str, seed: int) -> None:
    """Plan anew at each step of a drive among moving crates."""
    rng = np.random.default_rng(seed)
    side = QUICK_SIDE if report.quick else SIDE
    space = _build(inputs.boxes(side, DENSITY, rng), SCENE_YAWS)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    crates = rng.uniform(lower, upper, (CRATES, 2))
    velocities = rng.normal(0.0, CRATE_STEP, crates.shape)
    steps = QUICK_STEPS if report.quick else STEPS
    report.section(
        f"{name}: {steps} steps among {CRATES} moving crates, {side} x {side} x {SCENE_YAWS} cells"
    )
    drive, target = DRIVES[name]
    fresh, again, quick = Timing(None), Timing(None), Timing(None)
    unsolved = longer = reused = 0
    slowest, seconds = None, 0.0
    here, goal = _draw_pair(space, rng)
    previous: Plan | None = None
    for step in range(steps):
        crates = crates + velocities
        velocities[(crates < lower) | (crates > upper)] *= -1.0
        _place_crates(space, crates, (here, goal))
        plan_here = partial(
            planners.plan, space, here, goal, time_limit=TIME_LIMIT, seed=step, drive=drive
        )
        plan = fresh.take(plan_here)
        short = quick.take(partial(plan_here, planner="RRTConnect"))
        if not plan.certified:
            unsolved += 1
            here, goal = _draw_pair(space, rng)
            previous = None
            continue
        longer += short.certified and _weighted_length(plan) > _weighted_length(short) + 1e-9
        if fresh.cpu[-1] > seconds:
            slowest, seconds = plan, fresh.cpu[-1]
        if previous is not None:
            followed = again.take(partial(plan_here, previous=previous))
            reused += followed.status.endswith("previous plan")
        previous = plan
        here = _advance(plan)
        if math.dist(here[:2], goal[:2]) < 2.0 * STEP:
            here, goal = _draw_pair(space, rng)
            previous = None
    slow = float(np.percentile(fresh.cpu, 95))
    report.timing(f"{name}, default", fresh, cpu_95_s=round(slow, 4), unsolved=unsolved)
    report.timing(f"{name}, default, previous=", again, reused=reused)
    report.timing(f"{name}, RRTConnect", quick)
    report.figure("median CPU time", 1e3 * fresh.median_cpu, "ms", most=1e3 * target)
    report.figure("95 % of CPU times", 1e3 * slow, "ms", most=1e3 * MAX_SLOW_SECONDS)
    report.figure("share of plans longer than RRTConnect's", longer / steps, "", most=0.0)
    if report.folder is not None and slowest is not None:
        _draw(slowest, report, f"replanning-{name}.png")


def _place_crates(space: CSpace, crates: Floats, keep_free: tuple[Floats, Floats]) -> None:
    """Move the crates that are far enough from start and goal."""
    for number, (x, y) in enumerate(crates.tolist()):
        if min(math.dist((x, y), q[:2]) for q in keep_free) > CLEAR_RADIUS:
            half = 0.5 * CRATE_SIDE
            crate = shapely.box(x - half, y - half, x + half, y + half)
            space.add_obstacle(f"crate {number}", crate)


def _draw_pair(space: CSpace, rng: np.random.Generator, share: float = LEAST_DISTANCE_SHARE) -> Any:
    """Draw two FREE configurations far apart that a chain of FREE cells joins."""
    least = share * math.dist(space.grid.lower, space.grid.upper)
    while True:
        q = space.sample_free(2, rng)
        is_far = math.dist(*q[:, :2]) > least
        if is_far and space.motion_is_free(q, q).all() and space.is_connected(*q):
            return q


def _advance(plan: Plan) -> Floats:
    """Return the configuration of a path after a step."""
    metres = np.linalg.norm(np.diff(plan.path[:, :2], axis=0), axis=1)
    after = int(np.searchsorted(np.cumsum(metres), STEP))
    return plan.path[min(after, len(plan.path) - 1)]


def _weighted_length(plan: Plan) -> float:
    """Return the length of a plan, in metres; a radian of rotation counts as half a metre."""
    rotation = 0.0 if isinstance(plan.drive, planners.Car) else plan.total_rotation
    return plan.length + METRES_PER_RADIAN * rotation


def _draw(plan: Plan, report: Report, name: str) -> None:
    """Save a picture of a plan."""
    report.folder.mkdir(parents=True, exist_ok=True)
    axes = plan.plot()
    axes.figure.savefig(report.folder / name, dpi=130)
    plt.close(axes.figure)
    report.note(f"the slowest plan: {report.folder / name}")


def _measure_office(report: Report, seed: int) -> None:
    """Time default plans in an office of rooms."""
    rng = np.random.default_rng(seed)
    space = _build(inputs.rooms(OFFICE_SIDE, rng), OFFICE_YAWS)
    report.section(f"rooms, {OFFICE_SIDE} x {OFFICE_SIDE} x {OFFICE_YAWS} cells")
    pairs = [_draw_pair(space, rng) for _ in range(OFFICE_PLANS)]
    for drive in ("holonomic", "differential"):
        timing = _time_plans(report, space, pairs, drive)
        median = 1e3 * timing.median_cpu
        report.figure("median CPU time", median, "ms", most=1e3 * MAX_OFFICE_SECONDS)


def _measure_growth(report: Report, seed: int) -> None:
    """Time plans from corner to corner of larger and larger offices."""
    medians = []
    for side in LARGE_SIDES:
        rng = np.random.default_rng(seed)
        space = _build(inputs.rooms(side, rng), SCENE_YAWS)
        report.section(f"rooms, {side} x {side} x {SCENE_YAWS} cells, across the map")
        pairs = [_draw_pair(space, rng, share=0.8) for _ in range(LARGE_PLANS)]
        medians.append(_time_plans(report, space, pairs, "holonomic").median_cpu)
        _time_plans(report, space, pairs, "differential")
    report.figure("median on the largest", medians[-1], "s", most=MAX_LARGE_SECONDS)
    sides = math.log(LARGE_SIDES[-1] / LARGE_SIDES[0])
    report.figure("power of the side", math.log(medians[-1] / medians[0]) / sides, "", most=2.0)


def _time_plans(report: Report, space: CSpace, pairs: Any, drive: str) -> Timing:
    """Time default plans between pairs of configurations."""
    timing = Timing(None)
    unsolved = 0
    for number, (start, goal) in enumerate(pairs):
        plan = timing.take(
            partial(
                planners.plan,
                space,
                start,
                goal,
                drive=DRIVES[drive][0],
                time_limit=TIME_LIMIT,
                seed=number,
            )
        )
        unsolved += not plan.certified
    report.timing(f"{drive}, default", timing, unsolved=unsolved)
    return timing

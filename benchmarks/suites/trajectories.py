"""Trajectories: durations against the least conceivable ones, and CPU times."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.arm_peers import Folder
from benchmarks.suites.paths import DEPOT, DISC_RADIUS, OFFICE, RECTANGLE, YAW_CELLS
from benchmarks.timing import Timing
from cspace import ConfigurationError, CSpace, Robot, Workspace
from cspace._rotations.base import wrap_steps
from cspace._support.arrays import Floats
from planners import Plan, Trajectory

PLANS, QUICK_PLANS = 34, 4
"""Number of plans on each map."""

PROBLEMS, QUICK_PROBLEMS = 20, 2
"""Number of problems of each set of an arm."""

MIN_DISTANCE = 5.0
"""Smallest distance of start and goal, metres."""

SPEED, ACCELERATION, TURN_RATE, TURN_ACCELERATION = 0.8, 0.5, 1.0, 2.0
"""Limits of robots on maps, in metres, radians and seconds."""

ARM_ACCELERATIONS = 1.0, 5.0
"""Largest accelerations of the joints, rad/s^2; their velocities are those of the URDF."""

MAX_RATIO, MAX_ARM_RATIO = 1.2, 0.6
"""Targets: median duration over the least one; of arms over that with stops at corners."""

RAMP_SECONDS, ARM_RAMP_SECONDS = 0.2, 0.1
"""Seconds in which the largest jerk reaches the largest acceleration, on maps and of arms."""

MAX_JERK_RATIO, MAX_JERK_SECONDS = 1.3, 0.03
"""Targets with a limit of jerk: median duration over that without one; CPU seconds."""

MAX_SECONDS, CORNERS, SPREAD = 0.02, 30, 10
"""Target: CPU seconds of a trajectory with that number of corners, and by how much it may differ in
the plans that are counted."""


def run(report: Report, seed: int) -> None:
    """Time trajectories on three maps and of two arms."""
    folder = inputs.data_folder()
    if folder is None:
        report.note(inputs.NO_DATA)
        return
    maps = {"depot": DEPOT, "willow": OFFICE}
    workspaces = {name: inputs.real_map(path) for name, path in maps.items()}
    workspaces["warehouse"] = make_warehouse(np.random.default_rng(seed))
    disc = Robot.disc(DISC_RADIUS)
    rectangle = Robot.polygon(RECTANGLE)
    for robot, rotations, drive in (
        (disc, None, None),
        (rectangle, YAW_CELLS, None),
        (rectangle, YAW_CELLS, planners.Differential()),
    ):
        ratios: list[float] = []
        for name, workspace in workspaces.items():
            if workspace is not None:
                space = cspace.build(workspace, robot, rotations=rotations)
                report.section(f"{name}, {drive}, {'turns' if rotations else 'a disc'}")
                ratios += _measure(report, space, drive, np.random.default_rng(seed))
        _judge(report, f"{drive}, {'turns' if rotations else 'a disc'}", ratios, MAX_RATIO)
    for acceleration in ARM_ACCELERATIONS:
        _measure_arms(report, folder, acceleration)


def make_warehouse(rng: np.random.Generator) -> Workspace:
    """Draw shelves of 22 x 130 cells with aisles of 38 cells, and crates."""
    occupied = np.zeros((600, 400), dtype=np.bool_)
    occupied[[0, 1, -2, -1]] = True
    occupied[:, [0, 1, -2, -1]] = True
    for first in range(60, 540, 60):
        occupied[first : first + 22, 50:180] = True
        occupied[first : first + 22, 230:360] = True
    for i, j in rng.integers((10, 10), (580, 380), (30, 2)).tolist():
        occupied[i : i + 8, j : j + 8] = True
    return Workspace.from_array(occupied, 0.05)


def _measure(
    report: Report, space: CSpace, drive: planners.Differential | None, rng: np.random.Generator
) -> list[float]:
    """Return the ratios of durations to the least ones, of default plans on one map."""
    limits: dict[str, Any] = {"max_velocity": SPEED, "max_acceleration": ACCELERATION}
    if space.size == 3:
        limits["max_angular_velocity"] = TURN_RATE
        limits["max_angular_acceleration"] = TURN_ACCELERATION
    plans = draw_plans(space, drive, QUICK_PLANS if report.quick else PLANS, rng)
    least = np.array([least_duration(plan) for plan in plans])
    blended = _time(report, plans, limits)
    jerks = {"max_jerk": ACCELERATION / RAMP_SECONDS}
    if space.size == 3 and drive is None:
        jerks["max_angular_jerk"] = TURN_ACCELERATION / RAMP_SECONDS
    _judge_jerk(report, plans, limits | jerks, blended)
    stopping = np.array([plan.trajectory(**limits, blend=False).duration for plan in plans])
    ratios = np.array([trajectory.duration for trajectory in blended]) / least
    report.note(
        f"duration over the least: median {np.median(ratios):.3f}, "
        f"90 % {np.quantile(ratios, 0.9):.3f}; with stops {np.median(stopping / least):.3f}"
    )
    return list(ratios.tolist())


def draw_plans(
    space: CSpace, drive: planners.Differential | None, number: int, rng: np.random.Generator
) -> list[Plan]:
    """Return default plans between random configurations far apart."""
    plans: list[Plan] = []
    while len(plans) < number:
        start, goal = space.sample_free(2, rng=rng)
        if np.linalg.norm((goal - start)[:2]) < MIN_DISTANCE:
            continue
        try:
            plan = planners.plan(space, start, goal, drive=drive, time_limit=5.0)
        except ConfigurationError:  # on the border of a cell
            continue
        if plan.certified:
            plans.append(plan)
    return plans


def least_duration(plan: Plan) -> float:
    """Return the least conceivable duration along a path.

    It is that of driving its length or of turning its rotation, each with one ramp up and one down;
    for a differential drive, driving plus the turns at start and goal.
    """
    rows = plan.waypoints
    metres = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    driving = ramped_duration(float(metres.sum()), SPEED, ACCELERATION)
    if rows.shape[1] == 2:
        return driving
    turns = np.abs(wrap_steps(np.diff(rows[:, 2])))
    if plan.drive is None:
        turning = ramped_duration(float(turns.sum()), TURN_RATE, TURN_ACCELERATION)
        return max(driving, turning)
    moves = np.flatnonzero(metres)
    ends = turns[: moves[0]].sum(), turns[moves[-1] + 1 :].sum()
    return driving + sum(ramped_duration(float(end), TURN_RATE, TURN_ACCELERATION) for end in ends)


def ramped_duration(length: float, speed: float, acceleration: float) -> float:
    """Return the seconds of a motion from rest to rest."""
    if length > speed**2 / acceleration:
        return length / speed + speed / acceleration
    return 2.0 * math.sqrt(length / acceleration)


def _judge_jerk(
    report: Report, plans: list[Plan], limits: Mapping[str, Any], unlimited: list[Trajectory]
) -> None:
    """Compare trajectories with limited jerk to those without a limit."""
    limited = _time(report, plans, limits, MAX_JERK_SECONDS)
    pairs = zip(limited, unlimited, strict=True)
    ratios = [one.duration / other.duration for one, other in pairs]
    _judge(report, "limited jerk, duration over that without a limit", ratios, MAX_JERK_RATIO)
    report.note(f"limited jerk: 90 % {np.quantile(ratios, 0.9):.3f}, largest {max(ratios):.3f}")


def _time(
    report: Report, plans: list[Plan], limits: Mapping[str, Any], largest: float = MAX_SECONDS
) -> list[Trajectory]:
    """Make the trajectories of plans, and report their CPU times."""
    plans[0].trajectory(**limits)  # compiles
    timing = Timing(None)
    trajectories = [timing.take(partial(plan.trajectory, **limits)) for plan in plans]
    report.check(all(each.certified for each in trajectories), "all trajectories are certified")
    report.timing("plan.trajectory", timing)
    corners = np.array([len(plan.waypoints) - 2 for plan in plans])
    is_near = np.abs(corners - CORNERS) <= SPREAD
    if is_near.any():
        seconds = float(np.median(np.array(timing.cpu)[is_near]))
        verdict = "reached" if seconds <= largest else "not reached"
        report.note(
            f"{1e3 * seconds:.1f} ms of CPU for {CORNERS} corners give or take {SPREAD}, "
            f"{np.count_nonzero(is_near)} plans; target {verdict}"
        )
    return trajectories


def _judge(report: Report, name: str, ratios: list[float], largest: float) -> None:
    """Report whether the median of ratios reaches a target."""
    median = float(np.median(ratios))
    verdict = "reached" if median <= largest else "not reached"
    report.note(f"{name}: median {median:.3f} of {len(ratios)}, target {largest:g} {verdict}")


def _measure_arms(report: Report, folder: Path, acceleration: float) -> None:
    """Compare trajectories of arms with those that stop at corners, and with full speed."""
    limits = {"max_acceleration": acceleration}
    for name in ("panda", "ur5"):
        files = Folder(folder / "arms" / name)
        if not files.path.is_dir():
            continue
        report.section(f"{name}, joints accelerate by {acceleration:g} rad/s^2")
        plans: list[Plan] = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # open meshes
            for problem in files.problems(QUICK_PROBLEMS if report.quick else PROBLEMS):
                goal = problem.goals[0]
                plan = planners.plan(problem.space(), problem.start, goal, time_limit=5.0)
                if plan.certified and len(plan.waypoints) > 2:
                    plans.append(plan)
            stopping = [plan.trajectory(**limits, blend=False).duration for plan in plans]
            trajectories = _time(report, plans, limits)
            jerks = {"max_jerk": acceleration / ARM_RAMP_SECONDS}
            _judge_jerk(report, plans, limits | jerks, trajectories)
            blended = [trajectory.duration for trajectory in trajectories]
        least = [_full_speed_duration(plan) for plan in plans]
        report.note(
            f"full speed on every edge takes {np.median(np.array(least) / stopping):.3f} "
            "of the duration with stops"
        )
        _judge(report, name, (np.array(blended) / stopping).tolist(), MAX_ARM_RATIO)


def _full_speed_duration(plan: Plan) -> float:
    """Return the seconds of an arm's path if its joints had no limits of acceleration."""
    space: Any = plan.space
    fastest: Floats = np.array([space.max_velocity[axis] for axis in plan.axes])
    return float((np.abs(np.diff(plan.waypoints, axis=0)) / fastest).max(axis=1).sum())

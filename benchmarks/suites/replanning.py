"""Plans among moving obstacles: the rate of each planner, and how the default plan varies."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import shapely

import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.paths import OUR_TIME_LIMIT, Problem, list_problems
from benchmarks.suites.replanning_drives import run_drives
from benchmarks.suites.replanning_scenes import run_scenes
from benchmarks.timing import Timing
from cspace import CSpace
from cspace._rotations.base import METRES_PER_RADIAN
from cspace._support.arrays import Floats
from planners import Plan

CRATE_SIDE, STEP = 0.6, 0.1
"""Side of the crate, and its move between two plans, metres."""

MOVES, QUICK_MOVES = 100, 5
"""Number of moves of the crate."""

END_SHARE = 0.2
"""Share of the route at either end that the crate stays away from."""

MIN_ROUTE_SHARE = 0.3
"""Least distance between start and goal, as a share of the map's diagonal."""

TURNING_RADIUS = 0.5
"""Turning radius of cars, metres."""

MAX_MEDIAN_SECONDS = 0.05
"""Target: median CPU time of a default plan."""

DEFAULT = "default"
HOLONOMIC_WAYS: dict[str, dict[str, Any]] = {
    DEFAULT: {},
    "RRTConnect": {"planner": "RRTConnect"},
    "default, objective='clearance'": {"objective": "clearance"},
}
"""Options of :func:`planners.plan` for every robot, by name."""

CAR_WAYS: dict[str, dict[str, Any]] = {
    "default, drive='differential'": {"drive": planners.Differential()},
    "RRTConnect, drive='differential'": {"drive": planners.Differential(), "planner": "RRTConnect"},
    "default, drive='reeds-shepp'": {
        "drive": planners.Car(turning_radius=TURNING_RADIUS, reverse=True)
    },
}
"""Options of :func:`planners.plan` for robots that turn in the plane, by name."""


@dataclass
class Replanning:
    """Plans of one way of planning, one after each move of the crate.

    Attributes
    ----------
    planning : Timing
    lengths : list of float
        Weighted lengths of the certified paths, metres.
    failed : int
        Number of plans without a certified path.
    """

    planning: Timing = field(default_factory=lambda: Timing(None))
    lengths: list[float] = field(default_factory=list)
    failed: int = 0

    def add(self, space: CSpace, route: Floats, options: Mapping[str, Any]) -> None:
        """Plan once more."""
        plan = self.planning.take(partial(plan_patiently, space, route, options))
        if plan.certified:
            self.lengths.append(weighted_length(plan))
        else:
            self.failed += 1


def run(report: Report, seed: int) -> None:
    """Plan anew as a crate moves, on four maps; drive through scenes."""
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA + "; generated maps take their place")
    for problem in list_problems(report.quick, seed):
        measure(report, problem, QUICK_MOVES if report.quick else MOVES, seed)
    run_scenes(report, seed)
    run_drives(report, seed)


def measure(report: Report, problem: Problem, moves: int, seed: int) -> None:
    """Plan again in every way after each move of a crate across a route."""
    space = problem.build()
    ways = HOLONOMIC_WAYS | (CAR_WAYS if problem.rotations else {})
    endpoints = draw_route(space, ways, np.random.default_rng(seed))
    route = planners.plan(space, *endpoints)
    center, across = widest_place(space, route.path)
    crate_moves = f"a crate of {CRATE_SIDE:g} m moves {moves} times by {STEP:g} m"
    report.section(f"{problem.name}: {crate_moves} across a route of {route.length:.1f} m")
    updating, checking = Timing(None), Timing(None)
    found = {name: Replanning() for name in ways}
    for move in range(moves):
        place = center + STEP * (move - (moves - 1) / 2) * across
        crate = shapely.box(*(place - CRATE_SIDE / 2), *(place + CRATE_SIDE / 2))
        updating.take(partial(space.add_obstacle, "crate", crate))
        checking.take(route.recheck)
        for name, options in ways.items():
            found[name].add(space, endpoints, options)
    space.remove_obstacle("crate")
    report.timing("add_obstacle", updating)
    report.timing("plan.recheck", checking)
    for name, replanning in found.items():
        _report_way(report, name, replanning, updating)
    _report_default(report, found[DEFAULT])
    again = planners.plan(space, *endpoints)
    same = again.certified and math.isclose(weighted_length(again), weighted_length(route))
    report.check(same, "without the crate, the path is as long as at first")


def _report_way(report: Report, name: str, replanning: Replanning, updating: Timing) -> None:
    """Report the times of a way of planning, and its rate, updates included."""
    seconds = replanning.planning.cpu
    slow = float(np.percentile(seconds, 95))
    rate = 1.0 / (updating.median_cpu + replanning.planning.median_cpu)
    report.timing(name, replanning.planning, cpu_95_s=round(slow, 4), unsolved=replanning.failed)
    report.mark(method="replanning")
    report.figure("  updates and plans a second, by CPU time", rate, "Hz")


def _report_default(report: Report, default: Replanning) -> None:
    """Report the default plans beside their target; all must be certified.

    Their length jumps if the crate closes a way.
    """
    report.check(default.failed == 0, f"{default.failed} default plans have no certified path")
    median = 1e3 * default.planning.median_cpu
    report.figure("median CPU time of a default plan", median, "ms", most=1e3 * MAX_MEDIAN_SECONDS)
    changes = (abs(after / before - 1.0) for before, after in itertools.pairwise(default.lengths))
    variation = 100.0 * max(changes, default=math.nan)
    report.figure("largest change of its length from plan to plan", variation, "%")


def weighted_length(plan: Plan) -> float:
    """Return the length of a plan, in metres; a radian of rotation counts as half a metre."""
    return plan.length + METRES_PER_RADIAN * plan.total_rotation


def plan_patiently(space: CSpace, route: Floats, options: Mapping[str, Any]) -> Plan:
    """Plan between two configurations, with time enough on a busy machine."""
    return planners.plan(space, *route, time_limit=OUR_TIME_LIMIT, **options)


def draw_route(space: CSpace, ways: Mapping[str, Any], rng: np.random.Generator) -> Floats:
    """Draw FREE configurations far apart that every way of planning joins.

    No free edge joins them.
    """
    least = MIN_ROUTE_SHARE * math.dist(space.grid.lower, space.grid.upper)
    while True:
        q = space.sample_free(2, rng)
        if math.dist(*q[:, : space.grid.dim]) < least:
            continue
        if space.is_disconnected(*q) or space.motion_is_free(*q):
            continue
        if all(plan_patiently(space, q, options).certified for options in ways.values()):
            return q


def widest_place(space: CSpace, path: Floats) -> tuple[Floats, Floats]:
    """Return the point of a route of largest clearance, and the direction across it."""
    points = path[:, :2]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(END_SHARE, 1.0 - END_SHARE, 200) * along[-1]
    places = np.column_stack([np.interp(at, along, column) for column in path.T])
    k = int(np.argmax(space.clearance(places)))
    ahead = places[min(k + 1, len(places) - 1), :2] - places[max(k - 1, 0), :2]
    return places[k, :2], np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)

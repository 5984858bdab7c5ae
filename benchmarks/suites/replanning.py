"""Plans among moving obstacles: their time, and how much their length varies."""

from __future__ import annotations

import itertools
import math
from functools import partial

import numpy as np
import shapely

import planners
from benchmarks.report import Report
from benchmarks.timing import Timing
from cspace import CSpace
from cspace.arrays import Floats
from cspace.rotations.base import METRES_PER_RADIAN

CRATE_SIDE, STEP = 0.6, 0.1
"""Side of the crate, and its move between two plans, metres."""

END_SHARE = 0.2
"""Share of the route at either end that the crate stays away from."""

MIN_ROUTE_SHARE = 0.3
"""Least distance between start and goal, as a share of the map's diagonal."""

MAX_MEDIAN_SECONDS, MAX_VARIATION = 0.05, 0.05
"""Targets: median time of a plan, and largest relative change of length from a plan to the next."""


def measure(report: Report, name: str, space: CSpace, moves: int, seed: int) -> None:
    """Plan again after each move of a crate across a route."""
    start, goal = draw_route(space, np.random.default_rng(seed))
    route = planners.plan(space, start, goal)
    center, across = widest_place(space, route.path)
    report.section(
        f"{name}: a crate of {CRATE_SIDE:g} m moves {moves} times by {STEP:g} m across a route of {route.length:.1f} m"
    )
    updating, planning, lengths = Timing(None), Timing(None), list[float]()
    for move in range(-1, moves):  # the first one fills caches
        place = center + STEP * (move - (moves - 1) / 2) * across
        crate = shapely.box(*(place - CRATE_SIDE / 2), *(place + CRATE_SIDE / 2))
        updating.take(partial(space.add_obstacle, "crate", crate))
        plan = planning.take(partial(planners.plan, space, start, goal))
        if move < 0:
            updating.forget()
            planning.forget()
            continue
        report_failure = f"move {move}: {plan.status}"
        if not plan.certified:
            report.check(False, report_failure)
        lengths.append(plan.length + METRES_PER_RADIAN * plan.total_rotation)
    space.remove_obstacle("crate")
    report.timing("add_obstacle", updating)
    report.timing("plan", planning, worst_cpu_s=round(max(planning.cpu), 3))
    report.mark(method="replanning")
    report.figure("  median CPU time of a plan", planning.median_cpu * 1e3, "ms", most=1e3 * MAX_MEDIAN_SECONDS)
    variation = max((abs(b / a - 1.0) for a, b in itertools.pairwise(lengths)), default=math.nan)
    report.figure("  largest change of length from plan to plan", 100.0 * variation, "%", most=100.0 * MAX_VARIATION)
    report.figure("  longest over shortest path", max(lengths) / min(lengths))
    again = planners.plan(space, start, goal)
    same = again.length + METRES_PER_RADIAN * again.total_rotation
    report.check(
        again.certified and math.isclose(same, route.length + METRES_PER_RADIAN * route.total_rotation),
        "without the crate, the path is as long as at first",
    )


def draw_route(space: CSpace, rng: np.random.Generator) -> Floats:
    """Draw FREE configurations far apart that FREE cells join, but no free edge."""
    least = MIN_ROUTE_SHARE * math.dist(space.grid.lower, space.grid.upper)
    while True:
        q = space.sample_free(2, rng)
        far = math.dist(*q[:, : space.grid.dim]) >= least
        if far and space.is_connected(*q) and not space.motion_is_free(*q):
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

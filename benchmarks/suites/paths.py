"""Length, success and proofs of default paths, against OMPL's planners on equal collision checks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from ompl import geometric as og
from ompl import util as ou

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import drives
from benchmarks.suites.lookups import at_half_a_cell, states_of
from benchmarks.timing import Timing
from cspace import CSpace, Robot, Workspace
from cspace._rotations.base import METRES_PER_RADIAN, wrap_angles
from cspace._support.arrays import Floats
from planners._ompl.states import find_state_kind

Query = tuple[Floats, Floats]

DISC_RADIUS, YAW_CELLS, GENERATED_SPACING = 0.3, 72, 0.05
"""Radius of the disc in metres, yaw cells of footprints, and side of the cells of generated maps in
metres."""

RECTANGLE = [(-0.45, -0.25), (0.45, -0.25), (0.45, 0.25), (-0.45, 0.25)]
NOTCHED = [(-0.3, -0.25), (0.4, -0.25), (0.4, 0.0), (0.05, 0.0), (0.05, 0.35), (-0.3, 0.35)]
"""Footprints, metres."""

OFFICE, DEPOT = "maps/willow-full-0.05.yaml", "maps/depot.yaml"
"""Real maps."""

IMPROVING_PLANNERS = "RRTstar", "InformedRRTstar", "BITstar"
"""Planners of OMPL that go on improving their path until the time limit."""

MAX_RATIO = 1.05
"""Largest allowed ratio of the length of our path to the best one known."""

OUR_TIME_LIMIT = 10.0
"""Time limit of our plans by the clock, seconds; above the default, because other work may slow the
machine."""

MIN_SOLVE_SHARE = 0.5
"""Share of its time after which a planner that returns is through."""

OURS, CONNECT, STEPPED = (
    "plan, default",
    "RRTConnect",
    "RRTConnect, motions in steps of half a cell",
)
"""Names of methods that stop at their first path."""


@dataclass(frozen=True)
class Sizes:
    """Number of queries and time limits of a run.

    Attributes
    ----------
    queries : int
        Random queries on each map.
    limits : sequence of (float, int)
        Seconds of CPU time that a planner of OMPL gets, and for how many of the queries. The first
        limit is also that of RRTConnect on all queries.
    drives : int
        Queries of drives.
    """

    queries: int
    limits: Sequence[tuple[float, int]]
    drives: int


FULL = Sizes(20, ((1.0, 4), (10.0, 1)), 24)
QUICK = Sizes(2, ((0.2, 1),), 2)


@dataclass(frozen=True)
class Problem:
    """A robot on a map."""

    name: str
    workspace: Workspace
    robot: Robot
    rotations: int | None

    def build(self) -> CSpace:
        """Build the map."""
        return cspace.build(self.workspace, self.robot, rotations=self.rotations)


@dataclass
class Outcome:
    """Results of a method: one for each run.

    Attributes
    ----------
    timing : Timing
    queries : list of int
        Number of the query.
    lengths : list of float
        Weighted length in metres; infinite if no path was found.
    certified : list of bool
        Whether the map proves every edge.
    """

    timing: Timing = field(default_factory=lambda: Timing(None))
    queries: list[int] = field(default_factory=list)
    lengths: list[float] = field(default_factory=list)
    certified: list[bool] = field(default_factory=list)

    def add(self, space: CSpace, query: int, find: Callable[[], Floats]) -> None:
        """Run a search and measure its path."""
        path = self.timing.take(find)
        self.queries.append(query)
        self.lengths.append(weighted_length(path) if len(path) else math.inf)
        self.certified.append(len(path) > 0 and bool(np.all(space.certify_path(path))))

    def ratios(self, best: Floats) -> list[float]:
        """Return length over best known for each path found."""
        pairs = zip(self.lengths, best[self.queries].tolist(), strict=True)
        return [length / shortest for length, shortest in pairs if math.isfinite(length)]


def run(report: Report, seed: int) -> None:
    """Compare paths on four maps, then drives on a lattice, and park cars."""
    sizes = QUICK if report.quick else FULL
    ou.setLogLevel(ou.LOG_NONE)
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA + "; generated maps take their place")
    for problem in list_problems(report.quick, seed):
        _compare(report, problem, sizes, seed)
    office = list_problems(report.quick, seed)[-1]
    drives.compare(report, office.name, office.build(), sizes.drives, seed)
    drives.park(report)


def list_problems(quick: bool, seed: int) -> list[Problem]:
    """Return a disc and a footprint on two maps, real ones if they are available."""
    rng = np.random.default_rng(seed)
    size = 480 if quick else 960
    maps = []
    for name, title, draw in (
        (DEPOT, "boxes", partial(inputs.boxes, size, 0.2)),
        (OFFICE, "rooms", partial(inputs.rooms, size)),
    ):
        workspace = inputs.real_map(name)
        if workspace is None:
            name, workspace = title, Workspace.from_array(draw(rng), GENERATED_SPACING)
        maps.append((name, workspace))
    footprints = ("rectangle", RECTANGLE), ("notched footprint", NOTCHED)
    problems = [
        Problem(f"{name}, disc of {DISC_RADIUS:g} m", each, Robot.disc(DISC_RADIUS), None)
        for name, each in maps
    ]
    for (name, each), (title, corners) in zip(maps, footprints, strict=True):
        problems.append(
            Problem(f"{name}, {title}, {YAW_CELLS} yaws", each, Robot.polygon(corners), YAW_CELLS)
        )
    return problems


def draw_queries(space: CSpace, number: int, rng: np.random.Generator) -> list[Query]:
    """Draw pairs of FREE configurations that FREE cells join."""
    queries: list[Query] = []
    while len(queries) < number:
        start, goal = space.sample_free(2, rng)
        if space.is_connected(start, goal):
            queries.append((start, goal))
    return queries


def weighted_length(path: Floats) -> float:
    """Return the length of a path in metres; a radian of rotation counts as half a metre."""
    steps = np.diff(path, axis=0)
    rotations = np.abs(wrap_angles(steps[:, 2:])).sum() if path.shape[1] == 3 else 0.0
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum() + METRES_PER_RADIAN * rotations)


def _compare(report: Report, problem: Problem, sizes: Sizes, seed: int) -> None:
    """Run all methods on one map, and report their figures."""
    space = problem.build()
    queries = draw_queries(space, sizes.queries, np.random.default_rng(seed))
    shape = " x ".join(map(str, space.grid.shape))
    report.section(
        f"{problem.name}: {shape} cells of {space.grid.spacing:g} m, {len(queries)} queries"
    )
    (first, _), *_ = sizes.limits
    for query in queries[:2]:  # compiles, and fills caches of the map
        planners.plan(space, *query)
        find_by_ompl(space, CONNECT, first, query, seed)
    runs = {CONNECT: (CONNECT, first, sizes.queries), STEPPED: (CONNECT, first, sizes.queries)}
    for seconds, count in sizes.limits:
        names = IMPROVING_PLANNERS if seconds == first else (CONNECT, *IMPROVING_PLANNERS)
        runs |= {f"{name}, {seconds:g} s": (name, seconds, count) for name in names}
    outcomes, bounds = (
        {OURS: Outcome(), **{name: Outcome() for name in runs}},
        np.empty(len(queries)),
    )
    for index, query in enumerate(queries):
        outcomes[OURS].add(space, index, partial(_plan, space, query))
        bounds[index] = planners.plan(space, *query, time_limit=OUR_TIME_LIMIT).lower_bound
        for name, (planner, seconds, count) in runs.items():
            if index < count:
                find = partial(find_by_ompl, space, planner, seconds, query, seed, name == STEPPED)
                outcomes[name].add(space, index, find)
    best = np.full(len(queries), math.inf)
    for outcome in outcomes.values():
        certified = np.array(outcome.certified)
        np.minimum.at(
            best, np.array(outcome.queries)[certified], np.array(outcome.lengths)[certified]
        )
    for name, outcome in outcomes.items():
        _report_outcome(report, name, outcome, best, bounds)
    _check_ours(report, outcomes, best, bounds)


def _plan(space: CSpace, query: Query) -> Floats:
    """Return the waypoints of the default plan."""
    return planners.plan(space, *query, time_limit=OUR_TIME_LIMIT).waypoints


def _report_outcome(
    report: Report, name: str, outcome: Outcome, best: Floats, bounds: Floats
) -> None:
    """Report a method's time, lengths, success and proofs."""
    ratios, found = outcome.ratios(best), np.isfinite(outcome.lengths)
    figures: dict[str, Any] = dict(
        zip(
            ("ratio_median", "ratio_95", "ratio_worst"),
            map(_rounded, np.percentile(ratios or [math.nan], (50, 95, 100))),
            strict=True,
        )
    )
    share = np.count_nonzero(outcome.certified) / max(np.count_nonzero(found), 1)
    gaps = np.array(outcome.lengths)[found] / bounds[outcome.queries][found] - 1.0
    figures |= {
        "solved": _rounded(found.mean()),
        "certified": _rounded(share),
        "gap": _rounded(np.median(gaps)) if len(gaps) else math.nan,
    }
    report.timing(name, outcome.timing, **figures)
    report.mark(
        method=name, ratios=[round(ratio, 5) for ratio in ratios], queries=len(set(outcome.queries))
    )


def _rounded(value: Any) -> float:
    return round(float(value), 4)


def _check_ours(report: Report, outcomes: dict[str, Outcome], best: Floats, bounds: Floats) -> None:
    """Fail the run if ours is long, unproven or missing, or if a lower bound is false."""
    ours = outcomes[OURS]
    report.check(
        all(ours.certified),
        f"{len(ours.certified) - sum(ours.certified)} of our paths are missing or not certified",
    )
    worst = max(ours.ratios(best), default=math.inf)
    report.check(
        worst <= MAX_RATIO,
        f"ours is {worst:.4f} times the best known at worst, at most {MAX_RATIO:g}",
    )
    false = np.count_nonzero(bounds > best * (1.0 + 1e-9))
    report.check(not false, f"{false} lower bounds exceed a certified path")


# ---- OMPL ----------------------------------------------------------------------------------------


def find_by_ompl(
    space: CSpace, planner: str, seconds: float, query: Query, seed: int, stepped: bool = False
) -> Floats:
    """Return the path of one of OMPL's planners, simplified, of length 0 if none is found in CPU
    time.

    Our checkers decide states and motions, or states alone if motions are ``stepped`` by OMPL.
    """
    ou.RNG.setSeed(seed + 1)
    setup = og.SimpleSetup(planners.state_space(space)) if stepped else planners.simple_setup(space)
    si = setup.getSpaceInformation()
    if stepped:
        setup.setStateValidityChecker(planners.StateValidityChecker(si, space))
        at_half_a_cell(space, si)
    setup.setStartAndGoalStates(*states_of(space, si, query))
    setup.setPlanner(getattr(og, planner)(si))
    began = time.process_time()
    # The planner goes on if other work on the machine took a part of its time.
    while (left := seconds + began - time.process_time()) > 0.0:
        clock = time.perf_counter()
        setup.solve(left)
        if (
            planner == CONNECT and setup.haveExactSolutionPath()
        ) or time.perf_counter() - clock < MIN_SOLVE_SHARE * left:
            break
    if not setup.haveExactSolutionPath():
        return np.empty((0, space.size))
    found = [_rows(space, setup)]
    setup.simplifySolution(seconds)
    found.append(_rows(space, setup))
    return min(found, key=weighted_length)


def _rows(space: CSpace, setup: Any) -> Floats:
    """Return the configurations of the path of a set-up."""
    read = find_state_kind(space).read
    return np.array([read(state) for state in setup.getSolutionPath().getStates()])

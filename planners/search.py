"""A search by OMPL, and its deadline.

OMPL checks its termination condition only between two steps of a planner, but a single step may
check thousands of edges. After the deadline all edges are refused without a test, so that the
planner ends soon and keeps its best path. If that does not end it, an exception does.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from cspace.queries.paths import pulled_straight
from cspace.support.arrays import Floats
from cspace.support.compiling import clock
from planners.catalogue import (
    BIDIRECTIONAL_BY_DRIVE,
    PLANNERS_WITHOUT_OBJECTIVE,
    THREADED_PLANNERS,
    PlannerName,
    make_planner,
    planner_named,
)
from planners.lattice import shorten_path
from planners.local_planner import HOLONOMIC, Endpoints, LocalPlanner
from planners.objectives import WeightedLength
from planners.setup import MakeObjective, make_setup
from planners.states import below_half_a_turn, kind_of

GRACE_SECONDS: Final = 0.1
"""Seconds from a deadline until callbacks raise an exception."""

_USUAL_STATUSES: Final = ("Timeout", "Exact solution", "Approximate solution", "Unknown status")
"""Outcomes that OMPL's planners report if nothing is wrong."""

NO_SEARCH: Final = "a single edge is free; no search needed"
"""Note of a path that is a single edge."""

INITIAL_TIME_SHARE: Final = 0.1
"""Share of the time limit for the first path, which a planner with an objective must beat."""

PERTURBATION_SHARE: Final = 0.05
"""Distance by which waypoints are moved to make a path cheaper, as a fraction of the state space's
extent."""

ATTEMPTS_PER_ROUND: Final = 100
"""Attempts to move waypoints or cut corners between two checks of the time limit."""


class OutOfTime(Exception):  # noqa: N818 - it ends a search, and is no error
    """Signal that ends a search at its deadline."""


class Callbacks(Protocol):
    """A checker, validator or objective that OMPL calls."""

    def _override(self, replacement: Callable[..., Any] | None) -> None:
        """Replace the callback by a function; None restores it."""


class Deadline:
    """Context manager that ends OMPL's work after some seconds.

    It overrides callbacks of OMPL, and restores them on exit. A thread waits, so that no callback
    reads the clock.

    Parameters
    ----------
    seconds : float
        Time until the deadline.
    refusing : sequence of Callbacks
        Callbacks that return False after the deadline.
    raising : sequence of Callbacks
        Callbacks that raise :class:`OutOfTime` :data:`GRACE_SECONDS` after the deadline.
    """

    def __init__(
        self, seconds: float, refusing: Sequence[Callbacks], raising: Sequence[Callbacks] = ()
    ) -> None:
        self._end = clock() + seconds
        self._refusing, self._raising = refusing, raising
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="planners deadline", daemon=True)

    @property
    def left(self) -> float:
        """Seconds until the deadline, at least zero."""
        return max(0.0, self._end - clock())

    def __enter__(self) -> Deadline:
        """Start to wait for the deadline."""
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Stop waiting and restore the callbacks."""
        self._is_over.set()
        self._thread.join()
        for each in (*self._refusing, *self._raising):
            each._override(None)

    def _watch(self) -> None:
        """Override the callbacks at the deadline, in a thread."""
        stages = (
            (self._end, self._refusing, _refuse),
            (self._end + GRACE_SECONDS, self._raising, _raise),
        )
        for end, callbacks, replacement in stages:
            while (
                left := end - clock()
            ) > 0.0:  # the clock excludes compilation, which delays the deadline
                if self._is_over.wait(left):
                    return
            for each in callbacks:
                each._override(replacement)


def _refuse(*states: Any) -> bool:
    """Return False for any states."""
    return False


def _raise(*states: Any) -> bool:
    """Raise OutOfTime for any states."""
    raise OutOfTime


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Outcome of a search."""

    path: Floats  # (n, size), configurations that edges join; n is 0 if the goal was not reached
    note: str = ""  # source of the path, or reason of the failure
    planning: float = 0.0  # seconds
    simplification: float = 0.0  # seconds
    proven: bool = False  # whether all edges were proven free in a final check
    lattice: str = ""  # proof by a lattice of headings, in words
    where: str = (
        ""  # part of the path that was not found, " from ... to ...", if the map has several tiles
    )


@dataclass(frozen=True, slots=True)
class Search:
    """Planner and options of a search."""

    planner: PlannerName  # name of a planner of OMPL, or of a built-in search
    objective: MakeObjective | None = None  # takes the space information; None for the length
    iterations: int | None = None  # largest number of checks of OMPL's termination condition
    simplify: bool = True
    seed: int | None = None
    fallback: PlannerName | None = None  # planner that takes over if this one finds no path

    def run(self, edges: LocalPlanner, endpoints: Endpoints, time_limit: float) -> SearchResult:
        """Search by OMPL for a path from start to goal.

        The path leads from the first configuration to any other. The goals are sorted by their
        distance from the start. The limit, in seconds, covers the search and the simplification,
        but neither caches of the map nor compilation.
        """
        with _silence():
            if self.seed is not None:
                # OMPL reports an error if numbers have been drawn, but generators made from here on
                # follow the seed.
                ou.RNG.setSeed(self.seed + 1)
            if self.planner in BIDIRECTIONAL_BY_DRIVE.get(edges.drive, ()):
                edges = replace(edges, bidirectional=True)
            run = _Run(self, edges, endpoints)
            # OMPL's SORRTstar never returns once it has found a path of the least possible length.
            if run.by_length and edges.edge_checker()(*endpoints[0], *endpoints[1]):
                return SearchResult(kind_of(edges.space).unwind(np.array(endpoints[:2])), NO_SEARCH)
            return run.solve(time_limit)


def shorten(edges: LocalPlanner, path: Floats, until: float) -> Floats:
    """Shorten a path, shape (n, size), by proven edges, until a reading of the clock."""
    if edges.drive != HOLONOMIC:
        return shorten_path(edges, path, until)
    check = below_half_a_turn(edges.edge_checker(), edges.space.periodic_axes)
    return pulled_straight(
        path, edges.space.rotations, lambda *edge: clock() < until and check(*edge)
    )


class _Run:
    """OMPL's objects for one search; a deadline overrides their callbacks."""

    def __init__(self, search: Search, edges: LocalPlanner, endpoints: Endpoints) -> None:
        self._search, self._edges, self._endpoints, self._kind = (
            search,
            edges,
            endpoints,
            kind_of(edges.space),
        )
        self._is_threaded = search.planner in THREADED_PLANNERS
        has_objective = search.objective is not None and not self._is_threaded
        self._setup = setup = make_setup(edges, search.objective if has_objective else None)
        self._objective = objective = setup.getOptimizationObjective()
        is_length = isinstance(objective, WeightedLength) and objective.is_length
        self._has_weights = has_objective and not is_length
        self.by_length = not self._has_weights or isinstance(
            objective, ob.PathLengthOptimizationObjective
        )
        self._must_beat = has_objective and search.planner not in PLANNERS_WITHOUT_OBJECTIVE
        callbacks = [
            setup.getStateValidityChecker(),
            setup.getSpaceInformation().getMotionValidator(),
        ]
        self._refusing: list[Callbacks] = callbacks
        self._raising: list[Callbacks] = []
        if not self._is_threaded:
            self._raising = [*callbacks, *([objective] if hasattr(objective, "_override") else [])]

    def solve(self, time_limit: float) -> SearchResult:
        """Search for a path and simplify it, within ``time_limit`` seconds."""
        setup, search, note, began = self._setup, self._search, "", clock()
        self._set_endpoints()
        best: og.PathGeometric | None = None
        with Deadline(time_limit, self._refusing, self._raising) as deadline:
            first = planner_named(None, self._edges.drive)
            if self._must_beat:
                self._run_planner(first, INITIAL_TIME_SHARE * time_limit, None)
                if setup.haveExactSolutionPath():
                    best = self._improve(setup.getSolutionPath(), deadline)
                setup.getProblemDefinition().clearSolutionPaths()
            if best is None or deadline.left > 0.0:
                status = self._run_planner(search.planner, deadline.left, search.iterations)
                note = "" if status in _USUAL_STATUSES else f"OMPL reports {status!r}"
        if setup.haveExactSolutionPath():
            found = setup.getSolutionPath()
            if best is None or self._is_cheaper(found, best):
                best = found
            else:
                note = f"the first one, by {first}, as {search.planner} found none better"
        elif best is not None:
            note = f"the first one, by {first}, as {search.planner} found none better"
        planning = clock() - began
        if best is None:
            return SearchResult(np.empty((0, len(self._endpoints[0]))), note, planning)
        if not search.simplify:
            return SearchResult(self._rows(best), note, planning)
        began = clock()
        path = self._simplify(best, max(time_limit + GRACE_SECONDS - planning, 1e-3))
        return SearchResult(path, note, planning, clock() - began)

    def _set_endpoints(self) -> None:
        """Give OMPL the start and the goals."""
        setup = self._setup
        start, *goals = self._make_path(np.array(self._endpoints)).getStates()
        if len(goals) == 1:
            setup.setStartAndGoalStates(start, goals[0])
            return
        alternatives = ob.GoalStates(setup.getSpaceInformation())
        for goal in goals:
            alternatives.addState(goal)
        setup.setStartState(start)
        setup.setGoal(alternatives)

    def _run_planner(self, name: PlannerName, seconds: float, iterations: int | None) -> str:
        """Run a planner of OMPL and return its outcome, empty after the deadline."""
        setup, end, checks = self._setup, clock() + seconds, itertools.count(1)
        most = math.inf if iterations is None else iterations
        # OMPL's own clock counts compilation, but its threads cannot call ours.
        condition = ob.timedPlannerTerminationCondition(seconds)
        if not self._is_threaded:
            condition = ob.PlannerTerminationCondition(lambda: next(checks) > most or clock() > end)
        with suppress(OutOfTime):
            setup.setPlanner(make_planner(name, setup.getSpaceInformation()))
            return str(setup.solve(condition).asString())
        return ""

    def _simplify(self, found: og.PathGeometric, seconds: float) -> Floats:
        """Simplify a path; the result is proven and no worse."""
        edges, path = self._edges, self._rows(found)
        fallback = edges.remove_turns(path)
        if self._has_weights:
            with Deadline(seconds, self._refusing, self._raising) as deadline:
                better = self._rows(self._improve(found, deadline))
            return (
                edges.remove_turns(better)
                if self._kind.reached_goal(better, self._endpoints)
                else fallback
            )
        shorter = shorten(edges, path, clock() + seconds)
        lengths = [
            float(edges.edge_lengths(rows[:-1], rows[1:]).sum()) for rows in (shorter, fallback)
        ]
        return shorter if lengths[0] <= lengths[1] else fallback

    def _improve(self, path: og.PathGeometric, deadline: Deadline) -> og.PathGeometric:
        """Return a cheaper, proven path, or a copy of `path`.

        Corners are cut and waypoints are moved while that makes the path cheaper and time is left.
        """
        setup, objective, better = self._setup, self._objective, og.PathGeometric(path)
        simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
        step, last = (
            PERTURBATION_SHARE * setup.getStateSpace().getMaximumExtent(),
            objective.infiniteCost(),
        )
        with suppress(OutOfTime):
            while deadline.left > 0.0 and objective.isCostBetterThan(better.cost(objective), last):
                last = better.cost(objective)
                simplifier.partialShortcutPath(better, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)
                simplifier.perturbPath(better, step, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)
            if self._is_cheaper(better, path) and self._edges.are_free(self._rows(better)):
                return better
        return og.PathGeometric(path)

    def _is_cheaper(self, first: og.PathGeometric, second: og.PathGeometric) -> bool:
        """Return True if the first path costs less."""
        objective = self._objective
        return bool(objective.isCostBetterThan(first.cost(objective), second.cost(objective)))

    def _make_path(self, rows: Floats) -> og.PathGeometric:
        """Make OMPL's path of configurations, shape (n, size)."""
        path, state = (
            og.PathGeometric(self._setup.getSpaceInformation()),
            self._setup.getStateSpace().allocState(),
        )
        for q in rows.tolist():
            self._kind.write(state, *q)
            path.append(state)
        return path

    def _rows(self, path: og.PathGeometric) -> Floats:
        """Return the configurations of OMPL's path, shape (n, size)."""
        return self._kind.unwind(np.array([self._kind.read(state) for state in path.getStates()]))


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress OMPL's messages; search results report the important ones."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)

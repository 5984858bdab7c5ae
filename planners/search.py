"""A search by OMPL, and its deadline.

OMPL checks its termination condition only between two steps of a planner, but a single step may check thousands of
edges. After the deadline all edges are refused without a test, so that the planner ends soon and keeps its best path.
If that does not end it, an exception does.
"""

from __future__ import annotations

import itertools
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Any, Final, Protocol

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from cspace.arrays import Floats
from cspace.compiling import clock
from cspace.map.paths import pulled_straight
from cspace.rotations import Rotations
from planners.catalogue import (
    BIDIRECTIONAL_BY_DRIVE,
    PLANNERS_WITHOUT_OBJECTIVE,
    THREADED_PLANNERS,
    make_planner,
    planner_named,
)
from planners.lattice import shorten_path
from planners.local_planner import HOLONOMIC, EdgesOnMap, Endpoints, LocalPlanner, MoreGoals
from planners.objectives import WeightedLength
from planners.setup import MakeObjective, make_setup
from planners.states import Configuration, below_half_a_turn, kind_of

GRACE_SECONDS: Final = 0.1
"""Seconds from a deadline until callbacks raise an exception."""

_USUAL_STATUSES: Final = ("Timeout", "Exact solution", "Approximate solution", "Unknown status")
"""Outcomes that OMPL's planners report if nothing is wrong."""

NO_SEARCH: Final = "a single edge is free; no search needed"
"""Note of a path that is a single edge."""

MAX_INITIAL_PATHS: Final = 8
"""Largest number of quickly found paths; an optimising planner must beat the cheapest of these."""

INITIAL_PATHS_TIME_SHARE: Final = 0.1
"""Fraction of the time limit after which no further initial path is sought."""

MORE_GOALS_SHARE: Final = 0.25
"""Share of the time, or of the iterations, after which further goals join a search."""

PERTURBATION_SHARE: Final = 0.05
"""Distance by which waypoints are moved to make a path cheaper, as a fraction of the state space's extent."""

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

    It overrides callbacks of OMPL, and restores them on exit. A thread waits, so that no callback reads the clock.

    Parameters
    ----------
    seconds : float
        Time until the deadline.
    refusing : sequence of Callbacks
        Callbacks that return False after the deadline.
    raising : sequence of Callbacks
        Callbacks that raise :class:`OutOfTime` :data:`GRACE_SECONDS` after the deadline.
    """

    def __init__(self, seconds: float, refusing: Sequence[Callbacks], raising: Sequence[Callbacks] = ()) -> None:
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Stop waiting and restore the callbacks."""
        self._is_over.set()
        self._thread.join()
        for each in (*self._refusing, *self._raising):
            each._override(None)

    def _watch(self) -> None:
        """Override the callbacks at the deadline, in a thread."""
        stages = (self._end, self._refusing, _refuse), (self._end + GRACE_SECONDS, self._raising, _raise)
        for end, callbacks, replacement in stages:
            while (left := end - clock()) > 0.0:  # the clock excludes compilation, which delays the deadline
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
    where: str = ""  # part of the path that was not found, " from ... to ...", if the map has several tiles


@dataclass(frozen=True, slots=True)
class Search:
    """Planner and options of a search."""

    planner: str  # name of a planner of OMPL, or of a built-in search
    objective: MakeObjective | None = None  # takes the space information; None for the length
    iterations: int | None = None  # largest number of checks of OMPL's termination condition
    simplify: bool = True
    seed: int | None = None
    fallback: str | None = None  # planner that takes over if this one finds no path
    more_goals: MoreGoals | None = None  # further goals, for which a search asks if it takes long

    def run(self, edges: LocalPlanner, endpoints: Endpoints, time_limit: float) -> SearchResult:
        """Search by OMPL for a path from start to goal.

        The path leads from the first configuration to any other. The goals are sorted by their distance from the start.
        The limit, in seconds, covers the search and the simplification, but neither caches of the map nor compilation.
        """
        with _silence():
            if self.seed is not None:
                # OMPL reports an error if numbers have been drawn, but generators made from here on follow the seed.
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
    if isinstance(edges, EdgesOnMap) and edges.drive != HOLONOMIC:
        return shorten_path(edges, path, until)
    check = below_half_a_turn(edges.edge_checker(), edges.space.periodic_axes)
    rotations = edges.space.rotations if isinstance(edges, EdgesOnMap) else Rotations.of(None)
    return pulled_straight(path, rotations, lambda *edge: clock() < until and check(*edge))


class _Run:
    """OMPL's objects for one search; a deadline overrides their callbacks."""

    def __init__(self, search: Search, edges: LocalPlanner, endpoints: Endpoints) -> None:
        is_threaded = search.planner in THREADED_PLANNERS
        self._search, self._edges, self._endpoints, self._kind = search, edges, endpoints, kind_of(edges.space)
        self._setup = setup = make_setup(edges, None if is_threaded else search.objective)
        self._objective = objective = setup.getOptimizationObjective()
        self._goals = ob.GoalStates(setup.getSpaceInformation())
        self._more_goals = search.more_goals
        self._has_weights = not is_threaded and search.objective is not None
        self._has_weights &= not (isinstance(objective, WeightedLength) and objective.is_length)
        self.by_length = not self._has_weights or isinstance(objective, ob.PathLengthOptimizationObjective)
        callbacks = [setup.getStateValidityChecker(), setup.getSpaceInformation().getMotionValidator()]
        self._refusing: list[Callbacks] = callbacks
        raising = [*callbacks, *([objective] if hasattr(objective, "_override") else [])]
        self._raising: list[Callbacks] = [] if is_threaded else raising

    def solve(self, time_limit: float) -> SearchResult:
        """Search for a path and simplify it, within ``time_limit`` seconds."""
        setup, search, note, began = self._setup, self._search, "", clock()
        ends = self._make_path(np.array(self._endpoints))
        if len(self._endpoints) == 2 and search.more_goals is None:
            setup.setStartAndGoalStates(*ends.getStates())
        else:
            for state in ends.getStates()[1:]:
                self._goals.addState(state)
            setup.setStartState(ends.getState(0))
            setup.setGoal(self._goals)
        initial, default = None, planner_named(None, self._edges.drive)
        with Deadline(time_limit, self._refusing, self._raising) as deadline:
            if search.objective is not None and search.planner not in PLANNERS_WITHOUT_OBJECTIVE | THREADED_PLANNERS:
                initial = self._find_initial_path(default, deadline)
            with suppress(OutOfTime):
                setup.setPlanner(make_planner(search.planner, setup.getSpaceInformation()))
                if initial is None or deadline.left > 0.0:
                    status = self._run_planner(deadline)
                    note = "" if status in _USUAL_STATUSES else f"OMPL reports {status!r}"
        if initial is not None and not (
            setup.haveExactSolutionPath() and self._is_cheaper(setup.getSolutionPath(), initial)
        ):
            setup.getProblemDefinition().clearSolutionPaths()
            setup.getProblemDefinition().addSolutionPath(initial)
            note = f"the first one, by {default}, as {search.planner} found none better"
        planning = clock() - began
        if not setup.haveExactSolutionPath():
            return SearchResult(np.empty((0, len(self._endpoints[0]))), note, planning)
        path = self._rows(setup.getSolutionPath())
        if not search.simplify:
            return SearchResult(path, note, planning)
        began = clock()
        path = self._simplify(path, max(time_limit + GRACE_SECONDS - planning, 1e-3))
        return SearchResult(path, note, planning, clock() - began)

    def _run_planner(self, deadline: Deadline) -> str:
        """Run OMPL's planner and return its outcome.

        The planner runs again if OMPL's own clock ended it too early, because that clock counts compilation.
        """
        setup, counted = self._setup, self._search.iterations is not None  # with iterations, our clock decides
        while True:
            began, seconds = time.perf_counter(), deadline.left
            status: str = setup.solve(self._make_termination(seconds)).asString()
            in_time = time.perf_counter() - began < seconds or deadline.left <= 0.0
            if in_time or counted or setup.haveExactSolutionPath():
                return status

    def _make_termination(self, seconds: float) -> ob.PlannerTerminationCondition:
        """Create OMPL's termination condition, by seconds or iterations.

        It also adds the further goals, if the search takes long.
        """
        iterations = self._search.iterations
        if iterations is None and self._more_goals is None:
            return ob.timedPlannerTerminationCondition(seconds)
        begin, checks = clock(), itertools.count(1)

        def is_over() -> bool:
            elapsed = clock() - begin
            used, most = (elapsed, seconds) if iterations is None else (next(checks), iterations)
            if self._more_goals is not None and used > MORE_GOALS_SHARE * most:
                self._add_goals(self._more_goals())
                self._more_goals = None
            return used > most or elapsed > seconds

        return ob.PlannerTerminationCondition(is_over)

    def _add_goals(self, goals: Sequence[Configuration]) -> None:
        """Add goals during a search."""
        for state in self._make_path(np.array(goals)).getStates():
            self._goals.addState(state)
        self._endpoints = (*self._endpoints, *goals)

    def _find_initial_path(self, planner: str, deadline: Deadline) -> og.PathGeometric | None:
        """Find the cheapest of a few paths, and improve it.

        The paths often pass obstacles on different sides. A planner with an objective must beat the result, because it
        may find its first path too late. One round of improvement tells which path is cheapest.
        """
        setup, best, limit = self._setup, None, deadline.left
        for _ in range(MAX_INITIAL_PATHS):
            setup.setPlanner(make_planner(planner, setup.getSpaceInformation()))
            with suppress(OutOfTime):
                setup.solve(ob.timedPlannerTerminationCondition(deadline.left))
                if setup.haveExactSolutionPath():
                    path = self._improve(setup.getSolutionPath(), deadline, 1)
                    best = path if best is None or self._is_cheaper(path, best) else best
            setup.getProblemDefinition().clearSolutionPaths()
            if deadline.left < (1.0 - INITIAL_PATHS_TIME_SHARE) * limit:
                break
        return None if best is None else self._improve(best, deadline)

    def _simplify(self, path: Floats, seconds: float) -> Floats:
        """Simplify a path; the result is proven and no worse."""
        edges, fallback = self._edges, self._edges.remove_turns(path)
        if self._has_weights:
            with Deadline(seconds, self._refusing, self._raising) as deadline:
                better = self._rows(self._improve(self._setup.getSolutionPath(), deadline))
            return edges.remove_turns(better) if self._kind.reached_goal(better, self._endpoints) else fallback
        shorter = shorten(edges, path, clock() + seconds)
        lengths = [float(edges.edge_lengths(rows[:-1], rows[1:]).sum()) for rows in (shorter, fallback)]
        return shorter if lengths[0] <= lengths[1] else fallback

    def _improve(self, path: og.PathGeometric, deadline: Deadline, rounds: int = sys.maxsize) -> og.PathGeometric:
        """Return a cheaper, proven path, or a copy of `path`.

        Corners are cut and waypoints are moved while that makes the path cheaper and time is left.
        """
        setup, objective, better = self._setup, self._objective, og.PathGeometric(path)
        simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
        step, last = PERTURBATION_SHARE * setup.getStateSpace().getMaximumExtent(), objective.infiniteCost()
        with suppress(OutOfTime):
            for _ in range(rounds):
                cost = better.cost(objective)
                if deadline.left <= 0.0 or not objective.isCostBetterThan(cost, last):
                    break
                last = cost
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
        path, state = og.PathGeometric(self._setup.getSpaceInformation()), self._setup.getStateSpace().allocState()
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

"""A search by OMPL, and its deadline.

OMPL checks its termination condition only between two steps of a planner, but a single step, or the simplification of a
path, may check thousands of edges. After the deadline all edges are refused without a test, so that the planner ends
soon and keeps its best path. If that does not end it, an exception does.
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
import scipy  # its submodules are imported on first use
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from cspace.arrays import Floats
from cspace.compiling import clock
from planners.catalogue import (
    BIDIRECTIONAL_BY_DRIVE,
    PLANNERS_WITHOUT_OBJECTIVE,
    THREADED_PLANNERS,
    make_planner,
    planner_named,
)
from planners.local_planner import EdgesOnMap, Endpoints, LocalPlanner
from planners.objectives import WeightedLength
from planners.setup import MakeObjective, make_setup, narrow_bounds
from planners.states import Configuration, StateKind, kind_of

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

CORNER_CUTTING_ROUNDS: Final = 8
"""Number of rounds that cut the corners of a path that turns on the spot.

Twice as many rounds shortened paths by another 4 %, and took longer than the search.
"""

PERTURBATION_SHARE: Final = 0.05
"""Distance by which waypoints are moved to make a path cheaper, as a fraction of the state space's extent."""

ATTEMPTS_PER_ROUND: Final = 100
"""Attempts to move waypoints or cut corners between two checks of the time limit."""


class OutOfTime(Exception):  # noqa: N818 - it ends a search, and is no error
    """Signal that ends a search at its deadline.

    Callbacks raise it, and the caller of OMPL catches it.
    """


class Callbacks(Protocol):
    """A checker, validator or objective that OMPL calls."""

    def _override(self, replacement: Callable[..., Any] | None) -> None:
        """Replace the callback by a function; None restores it."""


class Deadline:
    """Context manager that ends OMPL's work after some seconds.

    It overrides callbacks of OMPL, and restores them on exit. A thread waits for the deadline, so that no callback has
    to read the clock.

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
        """Wait for the deadline, and override the callbacks; a thread runs it."""
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
    """Outcome of a search.

    Attributes
    ----------
    path : ndarray of float64, shape (n, size)
        Configurations that edges join; n is 0 if the goal was not reached.
    note : str
        Remark on how the path was found, or why none was found; may be empty.
    planning, simplification : float
        Seconds that the steps took.
    proven : bool
        Whether all edges were proven free in a final check.
    lattice : str
        Proof by a lattice of headings, in words; may be empty.
    where : str
        Part of the path that was not found, " from ... to ...", if the map has several tiles.
    """

    path: Floats
    note: str = ""
    planning: float = 0.0
    simplification: float = 0.0
    proven: bool = False
    lattice: str = ""
    where: str = ""


@dataclass(frozen=True, slots=True)
class Search:
    """Planner and options of a search.

    Attributes
    ----------
    planner : str
        Name of a planner of OMPL, or of a built-in search.
    objective : callable or None
        Function that takes the space information and returns an objective; None for the length.
    iterations : int or None
        Largest number of checks of OMPL's termination condition.
    simplify : bool
        Whether to simplify the path.
    seed : int or None
        Seed of OMPL's generators.
    fallback : str or None
        Planner of OMPL that takes over if a built-in search runs out of time.
    """

    planner: str
    objective: MakeObjective | None = None
    iterations: int | None = None
    simplify: bool = True
    seed: int | None = None
    fallback: str | None = None

    @property
    def may_stop(self) -> bool:
        """Whether the planner may be stopped after some iterations.

        The first path must suffice.
        """
        return self.objective is None and self.iterations is None and self.planner == planner_named(None)

    def run(
        self,
        edges: LocalPlanner,
        endpoints: Endpoints,
        time_limit: float,
        *,
        joined: bool = False,
    ) -> SearchResult:
        """Search for a path between configurations.

        The goals are sorted by their distance from the start. The limit, in seconds, covers the search and the
        simplification, but neither caches of the map nor compilation. With ``joined``, FREE cells are known to join
        start and goal, so the search stays in the bounding box of their component.
        """
        with _silence():
            if self.seed is not None:
                # OMPL reports an error if numbers have been drawn, but generators made from here on follow the seed.
                ou.RNG.setSeed(self.seed + 1)
            if self.planner in BIDIRECTIONAL_BY_DRIVE.get(edges.drive, ()):
                edges = replace(edges, bidirectional=True)
            setup = make_setup(edges, None if self.planner in THREADED_PLANNERS else self.objective)
            start, goal, *_ = endpoints
            if self._is_shortest(edges, setup, start, goal):
                path = kind_of(edges.space).unwind(np.array([start, goal]))
                return SearchResult(path, NO_SEARCH)
            if joined and isinstance(edges, EdgesOnMap) and not edges.exact:
                narrow_bounds(setup, edges, start)
            return _Run(self, edges, setup, endpoints).solve(time_limit)

    def _is_shortest(
        self, edges: LocalPlanner, setup: og.SimpleSetup, start: Configuration, goal: Configuration
    ) -> bool:
        """Return True if a single free edge is the shortest path.

        The objective must be the length. Testing this edge first saves time, and OMPL's SORRTstar never returns once it
        has found a path of the least possible length.
        """
        objective = setup.getOptimizationObjective()
        by_length = self.objective is None or self.planner in THREADED_PLANNERS
        by_length |= isinstance(objective, ob.PathLengthOptimizationObjective)
        by_length |= isinstance(objective, WeightedLength) and objective.is_length
        return by_length and edges.edge_checker()(*start, *goal)


class _Run:
    """OMPL's objects for one search.

    A deadline overrides their callbacks.
    """

    def __init__(self, search: Search, edges: LocalPlanner, setup: og.SimpleSetup, endpoints: Endpoints) -> None:
        self._search, self._edges, self._setup, self._endpoints = search, edges, setup, endpoints
        self._kind: StateKind = kind_of(edges.space)
        si = setup.getSpaceInformation()
        self._refusing: list[Callbacks] = [setup.getStateValidityChecker(), si.getMotionValidator()]
        objective = setup.getOptimizationObjective()
        raising = [*self._refusing, *([objective] if hasattr(objective, "_override") else [])]
        self._raising: list[Callbacks] = [] if search.planner in THREADED_PLANNERS else raising

    def solve(self, time_limit: float) -> SearchResult:
        """Search for a path and simplify it.

        ``time_limit`` is in seconds.
        """
        setup, states = self._setup, []
        for end in self._endpoints:
            states.append(setup.getStateSpace().allocState())
            self._kind.write(states[-1], *end)
        if len(states) == 2:
            setup.setStartAndGoalStates(*states)
        else:
            goals = ob.GoalStates(setup.getSpaceInformation())
            for state in states[1:]:
                goals.addState(state)
            setup.setStartState(states[0])
            setup.setGoal(goals)
        began, note, objective = clock(), "", setup.getOptimizationObjective()
        with Deadline(time_limit, self._refusing, self._raising) as deadline:
            initial = self._find_initial_path(deadline)
            try:
                setup.setPlanner(make_planner(self._search.planner, setup.getSpaceInformation()))
                if initial is None or deadline.left > 0.0:
                    status = self._run_planner(deadline)
                    note = "" if status in _USUAL_STATUSES else f"OMPL reports {status!r}"
                    self._optimise_on_roadmap()
            except OutOfTime:
                pass
        if initial is not None and not (
            setup.haveExactSolutionPath()
            and objective.isCostBetterThan(setup.getSolutionPath().cost(objective), initial.cost(objective))
        ):
            # The planner found no cheaper path, so the initial one is simplified instead.
            setup.getProblemDefinition().clearSolutionPaths()
            setup.getProblemDefinition().addSolutionPath(initial)
            note = f"the first one, by {self._default_planner}, as {self._search.planner} found none better"
        planning = clock() - began
        left = time_limit + GRACE_SECONDS - planning
        if not setup.haveExactSolutionPath():
            return SearchResult(np.empty((0, len(self._endpoints[0]))), note, planning)
        path = self._rows(setup.getSolutionPath())
        if not self._search.simplify:
            return SearchResult(path, note, planning)
        began = clock()
        path = self._simplify(path, max(left, 1e-3))
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

    def _optimise_on_roadmap(self) -> None:
        """Replace the path by the shortest one on the roadmap.

        Only planners that cannot call our objective need this.
        """
        setup, make = self._setup, self._search.objective
        if self._search.planner not in THREADED_PLANNERS or make is None or not setup.haveExactSolutionPath():
            return
        si, problem = setup.getSpaceInformation(), setup.getProblemDefinition()
        roadmap = ob.PlannerData(si)
        setup.getPlanner().getPlannerData(roadmap)
        vertices = range(roadmap.numVertices())
        # Dijkstra's search on the roadmap, with the lengths that the objective counts.
        states, ends_of = [roadmap.getVertex(v).getState() for v in vertices], [roadmap.getEdges(v) for v in vertices]
        starts, ends = np.repeat(vertices, [len(each) for each in ends_of]), np.concatenate(ends_of).astype(np.int64)
        rows = np.array([self._kind.read(state) for state in states])
        lengths = self._edges.edge_lengths(rows[starts], rows[ends])
        graph = scipy.sparse.coo_array((lengths, (starts, ends)), shape=(len(rows), len(rows))).tocsr()
        start, chain = roadmap.getStartIndex(0), [roadmap.getGoalIndex(0)]
        predecessors = scipy.sparse.csgraph.dijkstra(graph, indices=start, return_predecessors=True)[1]
        while chain[-1] != start:
            chain.append(predecessors[chain[-1]])
        path = og.PathGeometric(si)
        for vertex in reversed(chain):
            path.append(states[vertex])
        problem.clearSolutionPaths()
        problem.addSolutionPath(path)
        setup.setOptimizationObjective(make(si))  # from here on, only this thread calls it

    @property
    def _default_planner(self) -> str:
        """Name of the planner that is mostly the fastest."""
        return planner_named(None, self._edges.drive)

    def _find_initial_path(self, deadline: Deadline) -> og.PathGeometric | None:
        """Find a path that a slow planner must beat.

        It serves planners with an objective, which may find their first path too late. It is the cheapest of several
        paths, which often pass obstacles on different sides. One round of improvement tells which is cheapest, because
        it brings most of the gain.
        """
        setup, best, limit = self._setup, None, deadline.left
        if self._search.objective is None or self._search.planner in PLANNERS_WITHOUT_OBJECTIVE | THREADED_PLANNERS:
            return None
        objective = setup.getOptimizationObjective()
        for _ in range(MAX_INITIAL_PATHS):
            setup.setPlanner(make_planner(self._default_planner, setup.getSpaceInformation()))
            with suppress(OutOfTime):
                setup.solve(ob.timedPlannerTerminationCondition(deadline.left))
                if setup.haveExactSolutionPath():
                    candidate = self._improve(setup.getSolutionPath(), deadline, 1)
                    if best is None or objective.isCostBetterThan(candidate.cost(objective), best.cost(objective)):
                        best = candidate
            setup.getProblemDefinition().clearSolutionPaths()
            if deadline.left < (1.0 - INITIAL_PATHS_TIME_SHARE) * limit:
                break
        return None if best is None else self._improve(best, deadline)

    def _improve(self, path: og.PathGeometric, deadline: Deadline, rounds: int = sys.maxsize) -> og.PathGeometric:
        """Return a cheaper path, or a copy of the path.

        A cheaper path is proven free.
        """
        objective, better = self._setup.getOptimizationObjective(), og.PathGeometric(path)
        with suppress(OutOfTime):
            self._improve_in_place(better, deadline, rounds)
            if objective.isCostBetterThan(better.cost(objective), path.cost(objective)):
                return better if self._edges.are_free(self._rows(better)) else og.PathGeometric(path)
        return og.PathGeometric(path)

    def _improve_in_place(self, path: og.PathGeometric, deadline: Deadline, rounds: int = sys.maxsize) -> None:
        """Make a path cheaper while time is left.

        Corners are cut and waypoints are moved, in at most ``rounds`` rounds.
        """
        setup, objective = self._setup, self._setup.getOptimizationObjective()
        simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
        step, last = PERTURBATION_SHARE * setup.getStateSpace().getMaximumExtent(), objective.infiniteCost()
        for _ in range(rounds):
            cost = path.cost(objective)
            if deadline.left <= 0.0 or not objective.isCostBetterThan(cost, last):
                break
            last = cost
            simplifier.partialShortcutPath(path, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)
            simplifier.perturbPath(path, step, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)

    def _make_termination(self, seconds: float) -> ob.PlannerTerminationCondition:
        """Create OMPL's termination condition.

        It ends the search after some seconds or iterations.
        """
        if self._search.iterations is None:
            return ob.timedPlannerTerminationCondition(seconds)
        checks, max_checks = itertools.count(1), self._search.iterations
        end = clock() + seconds
        return ob.PlannerTerminationCondition(lambda: next(checks) > max_checks or clock() > end)

    def _simplify(self, path: Floats, seconds: float) -> Floats:
        """Simplify a path by OMPL, and remove needless turns.

        ``path`` has shape (n, size). If the result is worse by the objective or not proven free, only needless turns
        are removed.
        """
        setup, edges, objective = self._setup, self._edges, self._setup.getOptimizationObjective()
        has_weights = objective is not None and not getattr(objective, "is_length", False)
        cost = setup.getSolutionPath().cost(objective) if has_weights else None
        fallback = edges.remove_turns(path)
        try:
            with Deadline(seconds, self._refusing, self._raising) as deadline:
                if has_weights and isinstance(objective, WeightedLength):
                    self._improve_in_place(setup.getSolutionPath(), deadline)
                else:
                    setup.simplifySolution(ob.timedPlannerTerminationCondition(seconds))
                if not has_weights and isinstance(objective, WeightedLength):
                    # If edges differ on the way back, OMPL's simplification only leaves states out.
                    simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
                    for _ in range(CORNER_CUTTING_ROUNDS):
                        simplifier.partialShortcutPath(setup.getSolutionPath())
        except OutOfTime:
            return fallback
        solution = setup.getSolutionPath()
        simple = self._rows(solution)
        if not self._kind.reached_goal(simple, self._endpoints) or not edges.are_free(simple):
            return fallback
        if has_weights:
            return (
                fallback if objective.isCostBetterThan(cost, solution.cost(objective)) else edges.remove_turns(simple)
            )
        # OMPL's simplifier counts metres alone, and treats curves as straight when it cuts corners, so compare lengths.
        simple = edges.remove_turns(simple)
        lengths = [float(edges.edge_lengths(rows[:-1], rows[1:]).sum()) for rows in (simple, fallback)]
        return simple if lengths[0] <= lengths[1] * (1.0 + 1e-12) else fallback

    def _rows(self, path: og.PathGeometric) -> Floats:
        """Return the configurations of an OMPL path.

        The result has shape (n, size).
        """
        return self._kind.unwind(np.array([self._kind.read(state) for state in path.getStates()]))


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress OMPL's messages.

    The result of the search reports the important ones.
    """
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)

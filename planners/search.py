"""One search by OMPL, and the deadlines that it keeps.

OMPL checks its termination condition between two steps of a planner, and a single step, or the simplification of a
path, may check thousands of edges. After the deadline all edges are refused without a look-up, so that the planner ends
soon and keeps its best path; if that is not enough, an exception ends it.
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
import scipy  # its parts are read when they are first used
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from cspace.arrays import Floats
from cspace.compiling import clock
from planners.catalogue import BIDIRECTIONAL, IGNORE_OBJECTIVES, SECOND_THREAD, make_planner, planner_named
from planners.local_planner import LocalPlanner
from planners.objectives import WeightedLength
from planners.setup import MakeObjective, narrow, set_up
from planners.states import Configuration, StateKind, kind_of

GRACE: Final = 0.1
"""Seconds after a deadline from which on callbacks raise."""

_ORDINARY: Final = ("Timeout", "Exact solution", "Approximate solution", "Unknown status")
"""What OMPL's planners report where nothing is wrong."""

TRIES: Final = 8
"""Paths that are found quickly, of which the cheapest is what an optimising planner has to beat."""

SHARE: Final = 0.1
"""Part of the time after which no more of them are looked for."""

CUTS: Final = 8
"""How often corners are cut of a path that turns on the spot; twice as often saved 4 % more, and took longer than the
search."""

STEP: Final = 0.05
"""How far waypoints are moved to make a path cheaper, as a share of the state space's extent."""

STEPS: Final = 100
"""How often that is tried in a round, between two looks at the clock."""


class OutOfTime(Exception):  # noqa: N818 - it ends a search, and is no error
    """Raised through OMPL, and caught where OMPL was called."""


class Callbacks(Protocol):
    """What OMPL calls: a checker, a validator or an objective."""

    def _override(self, answer: Callable[..., Any] | None) -> None:
        """Answer by a function from now on, or as before if None."""


class Deadline:
    """A context in which OMPL's callbacks end their work after some seconds; on leaving, they are as before.

    A thread waits for the time, so that no callback has to read the clock.

    Parameters
    ----------
    seconds : float
    refusing : sequence of Callbacks
        Those that answer no after the deadline.
    raising : sequence of Callbacks
        Those that raise :class:`OutOfTime` from :data:`GRACE` later on.
    """

    def __init__(self, seconds: float, refusing: Sequence[Callbacks], raising: Sequence[Callbacks] = ()) -> None:
        self._end = clock() + seconds
        self._refusing, self._raising = refusing, raising
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="planners deadline", daemon=True)

    @property
    def left(self) -> float:
        """Seconds that are left, zero or above."""
        return max(0.0, self._end - clock())

    def __enter__(self) -> Deadline:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._is_over.set()
        self._thread.join()
        for each in (*self._refusing, *self._raising):
            each._override(None)

    def _watch(self) -> None:
        stages = (self._end, self._refusing, _refuse), (self._end + GRACE, self._raising, _raise)
        for end, callbacks, answer in stages:
            while (left := end - clock()) > 0.0:  # compiling, which the clock leaves out, delays the deadline
                if self._is_over.wait(left):
                    return
            for each in callbacks:
                each._override(answer)


def _refuse(*asked: Any) -> bool:
    return False


def _raise(*asked: Any) -> bool:
    raise OutOfTime


@dataclass(frozen=True, slots=True)
class SearchResult:
    """What came out of a search.

    Attributes
    ----------
    path : ndarray of float64, shape (n, size)
        The configurations that edges join; none where the goal was not reached.
    note : str
        How the path was found, or why not, where there is more to say.
    planning, simplification : float
        Seconds.
    proven : bool
        Whether all edges were proven free, checked again on the map.
    where : str
        On which part of the path the search failed, if it has several.
    """

    path: Floats
    note: str = ""
    planning: float = 0.0
    simplification: float = 0.0
    proven: bool = False
    where: str = ""


@dataclass(frozen=True, slots=True)
class Search:
    """How to search.

    Attributes
    ----------
    planner : str
        Name of one of OMPL's.
    objective : callable or None
        Given the space information, returns an objective; None for the length.
    iterations : int or None
        How often OMPL may check its termination condition.
    simplify : bool
    seed : int or None
    falls_back : bool
        Whether the map's own search takes over if the planner finds no path soon.
    """

    planner: str
    objective: MakeObjective | None = None
    iterations: int | None = None
    simplify: bool = True
    seed: int | None = None
    falls_back: bool = False

    @property
    def may_stop(self) -> bool:
        """Whether any path will do, and the planner may be stopped after some iterations."""
        return self.objective is None and self.iterations is None and self.planner == planner_named(None)

    def run(
        self,
        edges: LocalPlanner,
        start: Configuration,
        goal: Configuration,
        time_limit: float,
        *,
        joined: bool = False,
    ) -> SearchResult:
        """Search a path between two configurations at which motions can be proven free.

        The limit, in seconds, is for the search and the simplification, but not for what the map makes first, nor for
        compiling. Where FREE cells are known to have ``joined`` the two, the search keeps to the box around all that
        they join.
        """
        with _silence():
            if self.seed is not None:
                # OMPL calls this an error once numbers have been drawn, but what is made from here on obeys it.
                ou.RNG.setSeed(self.seed + 1)
            if self.planner in BIDIRECTIONAL.get(edges.drive, ()):
                edges = replace(edges, bidirectional=True)
            setup = set_up(edges, None if self.planner in SECOND_THREAD else self.objective)
            if self._is_shortest(edges, setup, start, goal):
                return SearchResult(
                    kind_of(edges.space).unwind(np.array([start, goal])), "a single edge is free; no search needed"
                )
            if joined and not edges.exact:
                narrow(setup, edges, start)
            return _Run(self, edges, setup).solve(start, goal, time_limit)

    def _is_shortest(
        self, edges: LocalPlanner, setup: og.SimpleSetup, start: Configuration, goal: Configuration
    ) -> bool:
        """Whether the shortest path is wanted and is the single edge from start to goal.

        This is more than a short cut: OMPL's SORRTstar never returns once it has found a path of the least conceivable
        length.
        """
        objective = setup.getOptimizationObjective()
        wanted = self.objective is None or self.planner in SECOND_THREAD
        wanted |= isinstance(objective, ob.PathLengthOptimizationObjective)
        wanted |= isinstance(objective, WeightedLength) and objective.is_length
        return wanted and edges.edge_checker()(*start, *goal)


class _Run:
    """OMPL's objects of one search, and what ends their work in time."""

    def __init__(self, search: Search, edges: LocalPlanner, setup: og.SimpleSetup) -> None:
        self._search, self._edges, self._setup = search, edges, setup
        self._kind: StateKind = kind_of(edges.space)
        si = setup.getSpaceInformation()
        self._refusing: list[Callbacks] = [setup.getStateValidityChecker(), si.getMotionValidator()]
        objective = setup.getOptimizationObjective()
        raising = [*self._refusing, *([objective] if hasattr(objective, "_override") else [])]
        self._raising: list[Callbacks] = [] if search.planner in SECOND_THREAD else raising

    def solve(self, start: Configuration, goal: Configuration, time_limit: float) -> SearchResult:
        setup, states = self._setup, []
        for end in (start, goal):
            states.append(setup.getStateSpace().allocState())
            self._kind.write(states[-1], *end)
        setup.setStartAndGoalStates(*states)
        began, note, objective = clock(), "", setup.getOptimizationObjective()
        with Deadline(time_limit, self._refusing, self._raising) as deadline:
            first = self._first(deadline)
            try:
                setup.setPlanner(make_planner(self._search.planner, setup.getSpaceInformation()))
                if first is None or deadline.left > 0.0:
                    status = self._solved(deadline)
                    note = "" if status in _ORDINARY else f"OMPL reports {status!r}"
                    self._choose_on_roadmap()
            except OutOfTime:
                pass
        if first is not None and not (
            setup.haveExactSolutionPath()
            and objective.isCostBetterThan(setup.getSolutionPath().cost(objective), first.cost(objective))
        ):
            # No path that is as good was found, so the first one is what there is to improve.
            setup.getProblemDefinition().clearSolutionPaths()
            setup.getProblemDefinition().addSolutionPath(first)
            note = f"the first one, by {self._quickest}, as {self._search.planner} found none better"
        planning = clock() - began
        left = time_limit + GRACE - planning
        if not setup.haveExactSolutionPath():
            return SearchResult(np.empty((0, len(start))), note, planning)
        path = self._rows(setup.getSolutionPath())
        if not self._search.simplify:
            return SearchResult(path, note, planning)
        began = clock()
        path = self._simplified(path, max(left, 1e-3))
        return SearchResult(path, note, planning, clock() - began)

    def _solved(self, deadline: Deadline) -> str:
        """Have OMPL search, and say how it ended; again where its own clock ended it, which counts compiling."""
        setup, counted = self._setup, self._search.iterations is not None  # then ours is asked, see :meth:`_stop`
        while True:
            began, seconds = time.perf_counter(), deadline.left
            status: str = setup.solve(self._stop(seconds)).asString()
            in_time = time.perf_counter() - began < seconds or deadline.left <= 0.0
            if in_time or counted or setup.haveExactSolutionPath():
                return status

    def _choose_on_roadmap(self) -> None:
        """For planners that cannot call our objective, take the cheapest path on their roadmap by it."""
        setup, make = self._setup, self._search.objective
        if self._search.planner not in SECOND_THREAD or make is None or not setup.haveExactSolutionPath():
            return
        si, problem = setup.getSpaceInformation(), setup.getProblemDefinition()
        roadmap = ob.PlannerData(si)
        setup.getPlanner().getPlannerData(roadmap)
        vertices = range(roadmap.numVertices())
        states, after = [roadmap.getVertex(v).getState() for v in vertices], [roadmap.getEdges(v) for v in vertices]
        firsts, lasts = np.repeat(vertices, [len(each) for each in after]), np.concatenate(after).astype(np.int64)
        rows = np.array([self._kind.read(state) for state in states])
        lengths = self._edges.lengths(rows[firsts], rows[lasts])
        graph = scipy.sparse.coo_array((lengths, (firsts, lasts)), shape=(len(rows), len(rows))).tocsr()
        start, chain = roadmap.getStartIndex(0), [roadmap.getGoalIndex(0)]
        before = scipy.sparse.csgraph.dijkstra(graph, indices=start, return_predecessors=True)[1]
        while chain[-1] != start:
            chain.append(before[chain[-1]])
        path = og.PathGeometric(si)
        for vertex in reversed(chain):
            path.append(states[vertex])
        problem.clearSolutionPaths()
        problem.addSolutionPath(path)
        setup.setOptimizationObjective(make(si))  # from here on, only this thread asks it

    @property
    def _quickest(self) -> str:
        """The planner that mostly finds a path soonest."""
        return planner_named(None, self._edges.drive)

    def _first(self, deadline: Deadline) -> og.PathGeometric | None:
        """A path to begin with, for a planner that optimises what is not the length: it may find its own too late.

        It is the cheapest of several, which often pass obstacles on other sides; one round tells which that is, for it
        gains most of what there is to gain.
        """
        setup, best, limit = self._setup, None, deadline.left
        if self._search.objective is None or self._search.planner in IGNORE_OBJECTIVES | SECOND_THREAD:
            return None
        objective = setup.getOptimizationObjective()
        for _ in range(TRIES):
            setup.setPlanner(make_planner(self._quickest, setup.getSpaceInformation()))
            with suppress(OutOfTime):
                setup.solve(ob.timedPlannerTerminationCondition(deadline.left))
                if setup.haveExactSolutionPath():
                    candidate = self._improved(setup.getSolutionPath(), deadline, 1)
                    if best is None or objective.isCostBetterThan(candidate.cost(objective), best.cost(objective)):
                        best = candidate
            setup.getProblemDefinition().clearSolutionPaths()
            if deadline.left < (1.0 - SHARE) * limit:
                break
        return None if best is None else self._improved(best, deadline)

    def _improved(self, path: og.PathGeometric, deadline: Deadline, rounds: int = sys.maxsize) -> og.PathGeometric:
        """A path made cheaper; or as it was, where that did not succeed, or is not proven free."""
        objective, better = self._setup.getOptimizationObjective(), og.PathGeometric(path)
        with suppress(OutOfTime):
            self._improve(better, deadline, rounds)
            if objective.isCostBetterThan(better.cost(objective), path.cost(objective)):
                return better if self._edges.are_free(self._rows(better)) else og.PathGeometric(path)
        return og.PathGeometric(path)

    def _improve(self, path: og.PathGeometric, deadline: Deadline, rounds: int = sys.maxsize) -> None:
        """Cut corners, and move waypoints, as long as that makes a path cheaper and time is left."""
        setup, objective = self._setup, self._setup.getOptimizationObjective()
        simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
        step, last = STEP * setup.getStateSpace().getMaximumExtent(), objective.infiniteCost()
        for _ in range(rounds):
            cost = path.cost(objective)
            if deadline.left <= 0.0 or not objective.isCostBetterThan(cost, last):
                break
            last = cost
            simplifier.partialShortcutPath(path, STEPS, STEPS)
            simplifier.perturbPath(path, step, STEPS, STEPS)

    def _stop(self, seconds: float) -> ob.PlannerTerminationCondition:
        """OMPL's rule for when to give up."""
        if self._search.iterations is None:
            return ob.timedPlannerTerminationCondition(seconds)
        asked, most = itertools.count(1), self._search.iterations
        end = clock() + seconds
        return ob.PlannerTerminationCondition(lambda: next(asked) > most or clock() > end)

    def _simplified(self, path: Floats, seconds: float) -> Floats:
        """The path, settled, after OMPL's simplification, unless that made it worse or it is no longer proven free."""
        setup, edges, objective = self._setup, self._edges, self._setup.getOptimizationObjective()
        weighs = objective is not None and not getattr(objective, "is_length", False)
        cost = setup.getSolutionPath().cost(objective) if weighs else None
        settled = edges.settled(path)
        try:
            with Deadline(seconds, self._refusing, self._raising) as deadline:
                if weighs and isinstance(objective, WeightedLength):
                    self._improve(setup.getSolutionPath(), deadline)
                else:
                    setup.simplifySolution(ob.timedPlannerTerminationCondition(seconds))
                if not weighs and isinstance(objective, WeightedLength):
                    # Where the way back is another, OMPL only leaves states out.
                    simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
                    for _ in range(CUTS):
                        simplifier.partialShortcutPath(setup.getSolutionPath())
        except OutOfTime:
            return settled
        solution = setup.getSolutionPath()
        simple = self._rows(solution)
        if not self._kind.same(simple[[0, -1]], path[[0, -1]]) or not edges.are_free(simple):
            return settled
        if weighs:
            return settled if objective.isCostBetterThan(cost, solution.cost(objective)) else edges.settled(simple)
        # OMPL's simplifier goes by metres, and takes curves for straight where it cuts corners.
        simple = edges.settled(simple)
        lengths = [float(edges.lengths(rows[:-1], rows[1:]).sum()) for rows in (simple, settled)]
        return simple if lengths[0] <= lengths[1] * (1.0 + 1e-12) else settled

    def _rows(self, path: og.PathGeometric) -> Floats:
        """The configurations of a path, shape (n, size)."""
        return self._kind.unwind(np.array([self._kind.read(state) for state in path.getStates()]))


@contextmanager
def _silence() -> Iterator[None]:
    """Hold back OMPL's messages; what matters of them is in the result."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)

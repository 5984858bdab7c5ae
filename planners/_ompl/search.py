"""A search by OMPL, and its deadline.

OMPL checks its termination condition only between two steps of a planner, but a single step may
check thousands of edges. After the deadline all edges are refused without a test, so that the
planner ends soon and keeps its best path. If that does not end it, an exception does.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from typing import Any, Final, cast

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from cspace import Space
from cspace.inside import NEVER, Effort, Floats, is_over, now, spend
from planners._catalogue import OmplName
from planners._edges.local_planner import LocalPlanner
from planners._ompl.checkers import EdgeCosts
from planners._ompl.setup import make_bounded_states, make_setup
from planners._ompl.states import find_state_kind
from planners._searches.objectives import FUNCTION, MakeObjective
from planners._searches.paths import MAX_SHORTENING, reached_goal, unwind
from planners._searches.shortening import shorten
from planners._task import NO_SEARCH, WEIGHTED, Planner, PlanTask, SearchResult

GRACE_SECONDS: Final = 0.1
"""Seconds from a deadline until callbacks raise an exception."""

_USUAL_STATUSES: Final = ("Timeout", "Exact solution", "Approximate solution", "Unknown status")
"""Outcomes that OMPL's planners report if nothing is wrong."""

NANOSECONDS_PER_STEP: Final = 10_000
NANOSECONDS_PER_DRIVEN_STEP: Final = 30_000
"""Work of an iteration of a planner, and of one of OMPL's calls of our code: holonomic, and with a
drive."""

ATTEMPTS_PER_ROUND: Final = 100
"""Attempts to move waypoints or cut corners between two checks of the time limit."""


class OutOfTime(Exception):  # noqa: N818 - it ends a search, and is no error
    """Signal that ends a search at its deadline."""


class Deadline:
    """A moment at which the callbacks of OMPL end its work.

    Callbacks hold it, so it must not hold OMPL's objects, which would never be freed.

    Attributes
    ----------
    step : int
        Work of a call, nanoseconds.
    end : Effort
        Never by default, and at once if the caller or a signal ends the search.
    """

    def __init__(self, step: int = NANOSECONDS_PER_STEP) -> None:
        self.step = step
        self.end = NEVER
        self._interrupts = list[BaseException]()

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Let a signal, or Python's end, end OMPL's work in a block; then raise what it raised."""
        with Effort.hold_exit() as self._interrupts:
            yield

    def is_stopped(self) -> bool:
        """Return True after a signal, the caller's stop, or as Python ends."""
        return bool(self._interrupts) or is_over(NEVER)

    def check(self) -> bool:
        """Return True before the deadline; raise OutOfTime long after."""
        spend(self.step)
        seconds_late = self.end.seconds_late()
        if seconds_late < 0.0 and self.is_stopped():
            # Callbacks raise the exception 0.01 s after the caller ended the search.
            seconds_late = GRACE_SECONDS - 0.01
            self.end = now() - Effort.from_seconds(seconds_late, seconds_late)
        if seconds_late > GRACE_SECONDS:
            raise OutOfTime
        return seconds_late < 0.0

    def refuse_late(self, check: Callable[..., bool]) -> Callable[..., bool]:
        """Let a check refuse everything after the deadline."""

        def check_in_time(*states: Any) -> bool:
            return self.check() and check(*states)

        return check_in_time

    def end_late(self, cost: Callable[..., float]) -> Callable[..., float]:
        """Let a cost end the work after the deadline."""

        def cost_in_time(*states: Any) -> float:
            self.check()
            return cost(*states)

        return cost_in_time


def make_objective(task: PlanTask) -> MakeObjective | None:
    """Return the maker of OMPL's objective, or None for the length."""
    edges = task.edges
    make = task.objective.make
    if not task.planner.optimises:  # its path is shortened by cost
        edges = replace(edges, weights=None)
    if edges.weights is None and not edges.turns_on_spot:  # OMPL measures metres alone
        return make
    return partial(EdgeCosts, edges=edges) if make is None else make


def set_seed(seed: int) -> None:
    """Seed all planners and samplers of OMPL that are made later."""
    # OMPL reports an error if numbers have been drawn, but obeys.
    with _silence():
        ou.RNG.setSeed(seed + 1)


@contextmanager
def repeat_draws() -> Iterator[None]:
    """Draw the same numbers each time, without a change of later ones."""
    next_seed = ou.RNG().getLocalSeed()
    set_seed(0)
    try:
        yield
    finally:
        set_seed(next_seed)


def run_ompl(task: PlanTask) -> SearchResult:
    """Search by OMPL for a path from start to goal.

    The path leads from the first configuration to any other. A long search asks the task once
    whether it may succeed. The limit covers the search and the simplification, but not caches of
    the map, the task's answer and compilation.
    """
    with _silence():
        edges = task.edges
        ends = task.endpoints[:2]
        if not edges.reverses and cast(OmplPlanner, task.planner).drives_back:
            task = replace(task, edges=replace(edges, bidirectional=True))
        run = _Run(task)
        # OMPL's SORRTstar never returns once it has found a path of the least possible length.
        if run.by_length and edges.weights is None and edges.edge_checker()(*ends[0], *ends[1]):
            path = unwind(np.array(ends), edges.space.is_periodic)
            return SearchResult(path, NO_SEARCH)
        return run.solve()


class _Run:
    """OMPL's objects for one search, and its deadline."""

    def __init__(self, task: PlanTask) -> None:
        self._task = task
        self._edges = task.edges
        self._kind = find_state_kind(task.edges.space)
        drives = task.edges.has_heading
        step = NANOSECONDS_PER_DRIVEN_STEP if drives else NANOSECONDS_PER_STEP
        self._deadline = deadline = Deadline(step)
        make = make_objective(task)
        self._setup = setup = make_setup(task.edges, make)
        checker = setup.getStateValidityChecker()
        validator = setup.getSpaceInformation().getMotionValidator()
        checker.is_free = deadline.refuse_late(checker.is_free)
        validator.is_free = deadline.refuse_late(validator.is_free)
        self._objective = objective = setup.getOptimizationObjective()
        is_length = isinstance(objective, ob.PathLengthOptimizationObjective)
        if isinstance(objective, EdgeCosts):
            is_length = objective.is_length
            objective.edge_cost = deadline.end_late(objective.edge_cost)
        self.by_length = make is None or is_length
        self._must_beat = make is not None and task.planner.optimises

    def solve(self) -> SearchResult:
        """Search for a path and simplify it, within the time limit."""
        self._set_endpoints()
        self._began = now()
        self._deadline.end = self._began + self._task.limit
        with self._deadline.hold():
            best, note = self._search()
            rows = np.empty((0, self._edges.space.size)) if best is None else self._rows(best)
        planning = now() - self._began
        if best is None or not self._task.simplify:
            return SearchResult(rows, note, planning)
        began = now()
        until = self._began + self._task.limit + MAX_SHORTENING
        if self.by_length:
            path = shorten(self._edges, rows, until)
        else:
            self._deadline.end = until
            with self._deadline.hold():
                rows = self._rows(self._improve(best))
            path = self._edges.remove_turns(rows)
        return SearchResult(path, note, planning, (now() - began).seconds)

    def _search(self) -> tuple[og.PathGeometric | None, str]:
        """Search for a path; return it, if there is one, and a note."""
        setup = self._setup
        task = self._task
        note = ""
        first_planner = self._edges.tree_planner
        best = None
        if self._must_beat:
            # Share of the limit for the first path, which a planner with an objective must beat.
            self._run_planner(first_planner, task.limit.share(0.1), None)
            if setup.haveExactSolutionPath():
                best = self._improve(setup.getSolutionPath())
                self._task = replace(task, existence=None)
            setup.getProblemDefinition().clearSolutionPaths()
        left = self._deadline.end - now()
        if best is None or left.is_left:
            note = self._run_planner(task.planner.name, left, task.iterations)
        self._deadline.end = NEVER
        solution = setup.getSolutionPath() if setup.haveExactSolutionPath() else None
        if solution is not None and (best is None or self._is_cheaper(solution, best)):
            best = solution
        elif best is not None:
            note = f"the first one, by {first_planner}, as {task.planner.name} found none better"
        return best, note

    def _set_endpoints(self) -> None:
        """Give OMPL the start and the goals."""
        setup = self._setup
        states = []
        for q in self._task.endpoints:
            state = setup.getStateSpace().allocState()
            self._kind.write(state, *q)
            states.append(state)
        if len(states) == 2:
            setup.setStartAndGoalStates(*states)
            return
        alternatives = ob.GoalStates(setup.getSpaceInformation())
        for goal in states[1:]:
            alternatives.addState(goal)
        setup.setStartState(states[0])
        setup.setGoal(alternatives)

    def _run_planner(self, name: str, limit: Effort, iterations: int | None) -> str:
        """Run a planner of OMPL; return a note on an unusual outcome."""
        setup = self._setup
        began = now()
        end = began + limit
        # Seconds after which a search labels the cells of a map, to see if a path may exist.
        asks_at = began + Effort.from_seconds(0.05, 0.05)
        checks = itertools.count(1)
        max_checks = math.inf if iterations is None else iterations

        def has_to_end() -> bool:
            """Return True to end; ask once if a path may exist."""
            nonlocal end, asks_at
            spend(self._deadline.step)
            if next(checks) > max_checks or end.seconds_late() > 0.0 or self._deadline.is_stopped():
                return True
            if asks_at.seconds_late() < 0.0 or setup.haveExactSolutionPath():
                return False
            # The limit does not count the time of the answer.
            asks_at = NEVER
            asked = now()
            if not self._task.may_succeed():
                return True
            waited = now() - asked
            end += waited
            self._deadline.end += waited
            self._began += waited
            return False

        condition = ob.PlannerTerminationCondition(has_to_end)
        status = "Timeout"
        with suppress(OutOfTime):
            setup.setPlanner(make_planner(name, setup.getSpaceInformation(), self._task.range))
            status = str(setup.solve(condition).asString())
        return "" if status in _USUAL_STATUSES else f"OMPL reports {status!r}"

    def _improve(self, path: og.PathGeometric) -> og.PathGeometric:
        """Return a cheaper, proven path, or a copy of `path`.

        Cut corners and move waypoints while the path becomes cheaper and time is left.
        """
        setup = self._setup
        objective = self._objective
        better = og.PathGeometric(path)
        simplifier = og.PathSimplifier(setup.getSpaceInformation(), setup.getGoal(), objective)
        # Waypoints move by at most 5 % of the extent.
        step = 0.05 * setup.getStateSpace().getMaximumExtent()
        last = objective.infiniteCost()
        with suppress(OutOfTime):
            while self._deadline.check() and objective.isCostBetterThan(
                better.cost(objective), last
            ):
                last = better.cost(objective)
                simplifier.partialShortcutPath(better, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)
                simplifier.perturbPath(better, step, ATTEMPTS_PER_ROUND, ATTEMPTS_PER_ROUND)
            rows = self._rows(better)
            ends = self._task.endpoints
            reaches_goal = reached_goal(rows, ends, self._edges.space.is_periodic)
            if self._is_cheaper(better, path) and reaches_goal and self._edges.are_free(rows):
                return better
        return og.PathGeometric(path)

    def _is_cheaper(self, first: og.PathGeometric, second: og.PathGeometric) -> bool:
        """Return True if the first path costs less."""
        objective = self._objective
        return bool(objective.isCostBetterThan(first.cost(objective), second.cost(objective)))

    def _rows(self, path: og.PathGeometric) -> Floats:
        """Return the configurations of OMPL's path, shape (n, size)."""
        rows = [self._kind.read(state) for state in path.getStates()]
        is_periodic = self._edges.space.is_periodic
        return unwind(np.array(rows), is_periodic, self._task.endpoints[0])


def make_planner(name: str, si: ob.SpaceInformation, range_: float | None = None) -> ob.Planner:
    """Create an OMPL planner by name, with short steps."""
    planner = getattr(og, name)(si)
    if range_ is not None:
        planner.setRange(range_)
    if name == "BITstar":
        # Pruning rebuilds the search tree at every 500th sample. Along curves, one such step takes
        # minutes, so the planner would exceed its time limit.
        planner.setPruning(False)
    has_curves = isinstance(si.getStateSpace(), (ob.DubinsStateSpace, ob.ReedsSheppStateSpace))
    if name == "FMT" and has_curves:
        # More are drawn if needed. A step measures from each neighbor to all samples, which takes
        # tenths of a second along curves.
        # OMPL's default is 1000. Within 8 s, both gave as many paths of the same length;
        # within 2 s, 1000 samples gave a quarter as many along Dubins curves.
        planner.setNumSamples(300)
    return planner


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress OMPL's messages; search results report the important ones."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)


class OmplPlanner(Planner):
    """A planner of OMPL.

    Attributes
    ----------
    drives_back : bool
        Whether it also follows edges from end to start. A robot that turns on the spot only turns
        around for the way back. A car's way back is a loop, which is hardly ever free.
    """

    counts_iterations = True

    def __init__(
        self, name: OmplName, *, optimises: bool = False, drives_back: bool = False
    ) -> None:
        """Declare the options of the planner, as OMPL documents them."""
        self.name = name
        self.drives_back = drives_back
        self.has_range = hasattr(getattr(og, name), "setRange")
        if optimises:
            self.objectives = (*WEIGHTED, FUNCTION)

    @property
    def optimises(self) -> bool:
        """Whether it goes on after the first path."""
        return FUNCTION in self.objectives

    def takes_space(self, space: Space) -> bool:
        """Return True; :meth:`prepare` refuses spaces without OMPL's states."""
        return True

    def takes_drive(self, edges: LocalPlanner) -> bool:
        """Return whether it searches along the edges of a drive."""
        return edges.reverses or not (self.drives_back and edges.has_curves)

    def prepare(self, task: PlanTask) -> None:
        """Raise InputError for a space without OMPL's states."""
        make_bounded_states(task.edges)

    def find(self, task: PlanTask) -> SearchResult:
        """Search for a path between the endpoints of a task."""
        # Without a seed, the searches of a default plan draw the same numbers each time.
        is_default = task.seed is None and not task.is_named
        with repeat_draws() if is_default else nullcontext():
            return run_ompl(task)


PLANNERS: Final = {
    planner.name: planner
    for planner in (
        OmplPlanner("BITstar", optimises=True),
        OmplPlanner("BKPIECE1", drives_back=True),
        OmplPlanner("FMT", optimises=True),
        OmplPlanner("InformedRRTstar", optimises=True),
        OmplPlanner("KPIECE1"),
        OmplPlanner("LBKPIECE1", drives_back=True),
        OmplPlanner("RRT"),
        OmplPlanner("RRTConnect"),
        OmplPlanner("RRTstar", optimises=True),
        OmplPlanner("SORRTstar", optimises=True),
    )
}
"""Planners of OMPL, in alphabetical order."""

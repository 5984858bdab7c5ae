"""One search by OMPL."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob
from ompl import util as ou

from planners.ends import End
from planners.spaces import narrow, simple_setup
from planners.states import Kind, kind_of
from planners.ways import Way

Floats = NDArray[np.float64]

STRAIGHT: Final = "Exact solution (the straight edge is free; no search needed)"
CURVED: Final = "Exact solution (the shortest curve is free; no search needed)"


@dataclass(frozen=True, slots=True)
class Found:
    """What came out of a search: the configurations that edges join, none where the goal was not reached.

    Times are in seconds.
    """

    path: Floats
    status: str
    planning: float = 0.0
    simplification: float = 0.0


@dataclass(frozen=True, slots=True)
class Search:
    """How to search.

    Attributes
    ----------
    planner : type
        Subclass of ``ompl.base.Planner``.
    objective : callable or None
        Given the space information, returns an objective; None for the length.
    time_limit : float
        Seconds.
    iterations : int or None
        How often OMPL may ask whether to go on.
    simplify : bool
    seed : int or None
    joined : dict
        What :func:`planners.simple_setup` is to know of the edges: exact, curve and turning radius.
    """

    planner: Any
    objective: Callable[[Any], Any] | None
    time_limit: float
    iterations: int | None
    simplify: bool
    seed: int | None
    joined: dict[str, Any]

    def run(self, way: Way, start: End, goal: End) -> Found:
        """Search a path between two configurations at which motions can be proven free."""
        with _silence():
            if self.seed is not None:
                # OMPL calls this an error once numbers have been drawn, but what is made from here on obeys it.
                ou.RNG.setSeed(self.seed + 1)
            setup = simple_setup(way.space, objective=self.objective, **self.joined)
            if self._is_shortest(way, setup, start, goal):
                return Found(np.array([start, goal]), CURVED if self.joined["curve"] else STRAIGHT)
            if not self.joined["exact"] and way.space.path_exists(start, goal):
                narrow(setup, way.space, start)
            kind = kind_of(way.space)
            setup.setStartAndGoalStates(*(_state(setup, kind, end) for end in (start, goal)))
            setup.setPlanner(self.planner(setup.getSpaceInformation()))
            began = time.perf_counter()
            status = setup.solve(self._stop())
            planning = time.perf_counter() - began
            if not setup.haveExactSolutionPath():
                return Found(np.empty((0, len(start))), status.asString(), planning)
            path = _array(setup, kind)
            if not self.simplify:
                return Found(path, status.asString(), planning)
            began = time.perf_counter()
            path = _simplified(way, setup, path, kind)
            return Found(path, status.asString(), planning, time.perf_counter() - began)

    def _is_shortest(self, way: Way, setup: Any, start: End, goal: End) -> bool:
        """Whether the shortest path is wanted and is the single edge from start to goal.

        This is more than a short cut: OMPL's SORRTstar never returns once it has found a path of the least conceivable
        length, and its AORRTC reports such a path as an invalid goal.
        """
        objective = setup.getOptimizationObjective()
        wanted = objective is None or isinstance(objective, ob.PathLengthOptimizationObjective)
        return wanted and way.edge_checker()(*start, *goal)

    def _stop(self) -> Any:
        """OMPL's rule for when to give up."""
        if self.iterations is None:
            return ob.timedPlannerTerminationCondition(self.time_limit)
        asked, most = itertools.count(1), self.iterations
        end = time.perf_counter() + self.time_limit
        return ob.PlannerTerminationCondition(lambda: next(asked) > most or time.perf_counter() > end)


def _simplified(way: Way, setup: Any, path: Floats, kind: Kind) -> Floats:
    """The path after OMPL's simplification, unless that made it worse or left the proven ground."""
    objective = setup.getOptimizationObjective()
    solution = setup.getSolutionPath()
    length, cost = solution.length(), None if objective is None else solution.cost(objective)
    setup.simplifySolution()
    solution = setup.getSolutionPath()
    simple = _array(setup, kind)
    if objective is None:
        # OMPL's simplifier takes curves for straight where it cuts corners.
        worse = solution.length() > length * (1.0 + 1e-12)
    else:
        worse = objective.isCostBetterThan(cost, solution.cost(objective))
    ends = np.array_equal(simple[[0, -1]], path[[0, -1]])
    return simple if ends and not worse and way.are_free(simple) else path


def _state(setup: Any, kind: Kind, point: End) -> Any:
    state = setup.getStateSpace().allocState()
    kind.write(state, point)
    return state


def _array(setup: Any, kind: Kind) -> Floats:
    """The solution path, shape (n, dof)."""
    return np.array([kind.read(state) for state in setup.getSolutionPath().getStates()])


@contextmanager
def _silence() -> Iterator[None]:
    """Hold back OMPL's messages; what matters of them is in the status."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)

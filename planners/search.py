"""One search by OMPL."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob
from ompl import util as ou

from planners.ends import End
from planners.spaces import simple_setup

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]

STRAIGHT: Final = "Exact solution (the straight edge is free; no search needed)"


@dataclass(frozen=True, slots=True)
class Found:
    """What came out of a search: an empty path where the goal was not reached. Times are in seconds."""

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
    """

    planner: Any
    objective: Callable[[Any], Any] | None
    time_limit: float
    iterations: int | None
    simplify: bool
    seed: int | None

    def run(self, space: CSpace, start: End, goal: End) -> Found:
        """Search a path between two configurations at which motions can be proven free."""
        with _silence():
            if self.seed is not None:
                # OMPL calls this an error once numbers have been drawn, but what is made from here on obeys it.
                ou.RNG.setSeed(self.seed + 1)
            setup = simple_setup(space, objective=self.objective)
            if self._is_straight(space, setup, start, goal):
                return Found(np.array([start, goal]), STRAIGHT)
            setup.setStartAndGoalStates(_state(setup, start), _state(setup, goal))
            setup.setPlanner(self.planner(setup.getSpaceInformation()))
            began = time.perf_counter()
            status = setup.solve(self._stop())
            planning = time.perf_counter() - began
            if not setup.haveExactSolutionPath():
                return Found(np.empty((0, len(start))), status.asString(), planning)
            path = _array(setup, len(start))
            if not self.simplify:
                return Found(path, status.asString(), planning)
            began = time.perf_counter()
            path = _simplified(space, setup, path)
            return Found(path, status.asString(), planning, time.perf_counter() - began)

    def _is_straight(self, space: CSpace, setup: Any, start: End, goal: End) -> bool:
        """Whether the shortest path is wanted and is the straight edge.

        This is more than a short cut: OMPL's SORRTstar never returns once it has found a path of the least conceivable
        length, and its AORRTC reports such a path as an invalid goal.
        """
        objective = setup.getOptimizationObjective()
        wanted = objective is None or isinstance(objective, ob.PathLengthOptimizationObjective)
        return wanted and space.edge_checker()(*start, *goal)

    def _stop(self) -> Any:
        """OMPL's rule for when to give up."""
        if self.iterations is None:
            return ob.timedPlannerTerminationCondition(self.time_limit)
        asked, most = itertools.count(1), self.iterations
        end = time.perf_counter() + self.time_limit
        return ob.PlannerTerminationCondition(lambda: next(asked) > most or time.perf_counter() > end)


def _simplified(space: CSpace, setup: Any, path: Floats) -> Floats:
    """The path after OMPL's simplification, unless that made it worse or left the proven ground."""
    objective = setup.getOptimizationObjective()
    before = None if objective is None else setup.getSolutionPath().cost(objective)
    setup.simplifySolution()
    after = None if objective is None else setup.getSolutionPath().cost(objective)
    simple = _array(setup, path.shape[1])
    worse = objective is not None and objective.isCostBetterThan(before, after)
    return path if worse or not space.motion_is_free(simple[:-1], simple[1:]).all() else simple


def _state(setup: Any, point: End) -> Any:
    state = setup.getStateSpace().allocState()
    for axis, value in enumerate(point):
        state[axis] = value
    return state


def _array(setup: Any, dof: int) -> Floats:
    """The solution path, shape (n, dof)."""
    return np.array([[state[axis] for axis in range(dof)] for state in setup.getSolutionPath().getStates()])


@contextmanager
def _silence() -> Iterator[None]:
    """Hold back OMPL's messages; what matters of them is in the status."""
    level = ou.getLogLevel()
    ou.setLogLevel(ou.LOG_NONE)
    try:
        yield
    finally:
        ou.setLogLevel(level)

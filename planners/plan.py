"""plan: from a map, a start and a goal to a checked path."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.grid import positive
from planners.ends import End, check_end
from planners.objectives import ClearanceObjective
from planners.registry import IGNORE_OBJECTIVES, SECOND_THREAD, find_planner
from planners.result import Plan, Times, least_clearance
from planners.search import Found, Search

if TYPE_CHECKING:
    from cspace.space import CSpace

Objective = Callable[[Any], Any]

MAX_SEED: Final = 2**32 - 2
"""Largest seed: OMPL's generator takes 32 bits, and refuses zero."""

INFEASIBLE: Final = "infeasible (proven: no path exists)"
THERE: Final = "Exact solution (the start is the goal)"


def plan(
    space: CSpace,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    planner: str = "RRTConnect",
    time_limit: float = 1.0,
    iterations: int | None = None,
    simplify: bool = True,
    seed: int | None = None,
    objective: str | Objective = "length",
) -> Plan:
    """Find a path on a map, with any geometric planner of OMPL, and check it.

    No search is run where the map proves that no path exists, or where the shortest path is wanted and is the straight
    edge. OMPL's messages are held back while it runs.

    Planners that go on improving their path (AORRTC, BITstar, InformedRRTstar, PRMstar, RRTstar, SORRTstar) use up the
    time limit.

    *Repeatable runs.* A seed sets OMPL's global seed generator, from which every planner, sampler and simplifier made
    afterwards draws its own seed; so the same call with the same seed gives the same path, also with other plans in
    between and in another process. That does not hold where the clock decides: for planners that use up the time limit
    (give ``iterations``, and a time limit that is not reached), for a search that the time limit cuts off, and for PRM
    and PRMstar, which look for the solution from a second thread. Nor does it hold where other threads of the process
    use OMPL at the same time.

    Parameters
    ----------
    space : CSpace
    start, goal : array-like, shape (2,)
        Configurations, in metres.
    planner : str
        Name of a planner, in upper or lower case; :func:`planners.planner_names` lists them.
    time_limit : float
        Seconds after which the search gives up. Simplification, usually a few milliseconds, comes on top.
    iterations : int, optional
        Give up also once OMPL has asked this often whether to go on, which is about once for each iteration of the
        planner. Not for PRM and PRMstar.
    simplify : bool
        Whether OMPL shall shorten and smooth the path. The outcome is kept only where it is certified and no worse by
        the objective.
    seed : int, optional
        From 0 to 2^32 - 2.
    objective : {"length", "clearance"} or callable
        What to optimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults. A callable is given the
        space information and returns an ``ompl.base.OptimizationObjective``. Anything but the length is for planners
        that heed it: BITstar, InformedRRTstar, RRTstar, SORRTstar, and, with a time limit of many seconds, FMT and
        BFMT, which ask for the cost between all pairs of near samples. AORRTC optimises the length whatever it is told;
        BKPIECE1, KPIECE1, LBKPIECE1, RRT and RRTConnect stop at the first path; PRM and PRMstar cannot call Python from
        their second thread.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigurationError
        If start or goal lies outside the map, is not FREE, or lies on the border of a cell that is not FREE. The
        message says which, and names the nearest FREE configuration, which is also its ``nearest``.
    InputError
        If a number is NaN, infinite or out of range, start or goal has the wrong dimension, a name is unknown, or the
        planner does not go together with ``objective`` or ``iterations``.
    """
    began = time.perf_counter()
    kind = find_planner(planner)
    name = kind.__name__
    make = _objective(space, objective, name)
    limit = positive(time_limit, "time_limit", "seconds")
    most = None if iterations is None else _iterations(iterations, name)
    number = None if seed is None else _whole(seed, "seed", 0, MAX_SEED)
    ends = check_end(space, start, "start"), check_end(space, goal, "goal")
    exists = space.path_exists(*ends)
    if exists is False:
        found = Found(np.empty((0, len(ends[0]))), INFEASIBLE)
    elif ends[0] == ends[1]:
        found = Found(np.array(ends[:1]), THERE)
    else:
        found = Search(kind, make, limit, most, simplify, number).run(space, *ends)
    searched = time.perf_counter()
    path = found.path
    path.flags.writeable = False
    solved = len(path) > 0
    certified = solved and _is_certified(space, found, *ends)
    length = math.fsum(map(math.dist, path[:-1], path[1:])) if solved else math.nan
    clearance = least_clearance(space, path) if solved else math.nan
    setup = searched - began - found.planning - found.simplification
    return Plan(
        path=path,
        solved=solved,
        certified=certified,
        status=found.status,
        length=length,
        clearance=clearance,
        path_exists=exists,
        planner=name,
        objective=objective if isinstance(objective, str) else "custom",
        seed=number,
        times=Times(setup, found.planning, found.simplification, time.perf_counter() - searched),
    )


def _is_certified(space: CSpace, found: Found, start: End, goal: End) -> bool:
    """Whether the path joins start and goal and every edge is proven free, asked of the map itself."""
    path = found.path
    joined = tuple(path[0].tolist()) == start and tuple(path[-1].tolist()) == goal
    firsts, lasts = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
    return joined and bool(np.all(space.motion_is_free(firsts, lasts)))


def _objective(space: CSpace, objective: str | Objective, planner: str) -> Objective | None:
    """What makes the objective; None for OMPL's own, the length."""
    if objective == "length":
        return None
    make = (lambda si: ClearanceObjective(si, space)) if objective == "clearance" else objective
    if not callable(make):
        raise InputError(
            f"objective is {objective!r}; it must be 'length', 'clearance', or a function from the space information "
            "to an ompl.base.OptimizationObjective; choose one of them"
        )
    if planner in IGNORE_OBJECTIVES | SECOND_THREAD:
        why = "heeds no objective" if planner in IGNORE_OBJECTIVES else "cannot call Python from its second thread"
        raise InputError(
            f"objective is {objective!r} and planner is {planner!r}; {planner} {why}; choose a planner that optimises, "
            "e.g. RRTstar, or leave the objective out"
        )
    return make


def _iterations(value: Any, planner: str) -> int:
    count = _whole(value, "iterations", 1, 2**62)
    if planner in SECOND_THREAD:
        raise InputError(
            f"iterations is {count} and planner is {planner!r}; {planner} asks whether to go on from a second thread, "
            "which cannot call Python; leave iterations out or choose another planner"
        )
    return count


def _whole(value: Any, name: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(f"{name} is {value!r}; it must be a whole number from {least} to {most}; pass e.g. 1000")
    return int(value)

"""plan: from a map, a start and a goal to a checked path."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import positive
from planners.cubes import NAME, check_cubes, is_cubes, run_cubes
from planners.ends import End, check_end
from planners.objectives import ClearanceObjective, OverlapObjective, field_of
from planners.passages import Passages
from planners.registry import IGNORE_OBJECTIVES, SECOND_THREAD, check_curve, default_planner, find_planner
from planners.result import Plan, Times, least_clearance
from planners.search import Found, Search
from planners.states import kind_of
from planners.ways import Way, way_of

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]
Objective = Callable[[Any], Any]

MAX_SEED: Final = 2**32 - 2
"""Largest seed: OMPL's generator takes 32 bits, and refuses zero."""

_BY_NAME: Final[dict[str, type[ClearanceObjective]]] = {"clearance": ClearanceObjective, "overlap": OverlapObjective}
"""What can be optimised beside the length."""

INFEASIBLE: Final = "infeasible (proven: no path exists)"
THERE: Final = "Exact solution (the start is the goal)"


def plan(
    space: CSpace,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    planner: str | None = None,
    time_limit: float = 1.0,
    iterations: int | None = None,
    simplify: bool = True,
    seed: int | None = None,
    objective: str | Objective = "length",
    exact: bool = False,
    curve: str | None = None,
    turning_radius: float | None = None,
) -> Plan:
    """Find a path on a map, with any geometric planner of OMPL, and check it.

    No search is run where the map proves that no path exists, or where the shortest path is wanted and is the single
    edge from start to goal. OMPL's messages are held back while it runs.

    *Robots that turn.* On a map with rotations, an edge is straight in x and y, and yaw turns evenly along the shorter
    arc, as in OMPL's SE(2). With ``curve``, edges are the shortest curves of a car instead: Dubins' for one that drives
    forwards alone, Reeds and Shepp's for one that reverses too. They are proven along the real curve. The start and the
    goal of the car are those of the robot's reference point, which therefore belongs in the middle of the axle that
    does not steer.

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
    start, goal : array-like, shape (dof,)
        Configurations ``(x, y)``, ``(x, y, z)`` or ``(x, y, yaw)``, in metres; yaw in radians, wrapped.
    planner : str, optional
        Name of a planner, in upper or lower case; :func:`planners.planner_names` lists them. RRTConnect, if left out,
        but RRT for Dubins curves: RRTConnect's tree at the goal grows by curves that leave the goal, where a car that
        cannot reverse needs those that arrive, so it often fails among obstacles. Planners that take edges from their
        ends are refused for Dubins curves. Or "Cubes", which is the map's own search, :meth:`cspace.CSpace.free_path`:
        for robots that only translate, it finds a path in milliseconds wherever FREE cells join start and goal, and the
        same one every time.
    time_limit : float
        Seconds after which the search gives up. Simplification, usually a few milliseconds, comes on top.
    iterations : int, optional
        Give up also once OMPL has asked this often whether to go on, which is about once for each iteration of the
        planner. Not for PRM and PRMstar.
    simplify : bool
        Whether the path shall be shortened, by OMPL also smoothed. The outcome is kept only where it is certified and
        no worse by the objective.
    seed : int, optional
        From 0 to 2^32 - 2.
    objective : {"length", "clearance", "overlap"} or callable
        What to optimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults, and "overlap"
        :class:`planners.OverlapObjective` with the field that the map carries. A callable is given the space
        information and returns an ``ompl.base.OptimizationObjective``. Anything but the length is for planners that
        heed it: BITstar, InformedRRTstar, RRTstar, SORRTstar, and, with a time limit of many seconds, FMT and
        BFMT, which ask for the cost between all pairs of near samples. AORRTC optimises the length whatever it is told;
        BKPIECE1, KPIECE1, LBKPIECE1, RRT and RRTConnect stop at the first path; PRM and PRMstar cannot call Python from
        their second thread.
    exact : bool
        Ask the geometry itself in cells that the map leaves MIXED, so that passages are solved which are a hair wider
        than the robot. Slower there; edges are no less proven. Where the map cannot decide whether a path exists, the
        planner joins the FREE stretches of a chain of undecided cells, and the others are crossed by samples of their
        own; that can take seconds, so give it time. Not for curves.
    curve : {"dubins", "reeds-shepp"}, optional
        Curves of a car, on a map with rotations.
    turning_radius : float, optional
        Of the car, in metres; for curves, which need it.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigurationError
        If start or goal lies outside the map, is not FREE, or lies on the border of a cell that is not FREE; or, with
        ``exact``, is not proven free by the geometry either. The
        message says which, and names the nearest FREE configuration, which is also its ``nearest``.
    InputError
        If a number is NaN, infinite or out of range, start or goal has the wrong dimension, a name is unknown, or the
        planner does not go together with ``objective``, ``iterations`` or ``curve``, or the objective is "overlap" and
        the map carries no overlap field. As well where a curve is unknown,
        the map has no rotations for it, the turning radius is missing or not above zero, or ``exact`` is wanted too.
    """
    began = time.perf_counter()
    cubes = is_cubes(planner)
    kind = None if cubes else find_planner(default_planner(curve) if planner is None else planner)
    name = NAME if kind is None else kind.__name__
    way = way_of(space, exact, curve, turning_radius)
    check_curve(name, curve)
    if cubes:
        given: dict[str, Any] = {"exact": exact or None, "curve": curve, "iterations": iterations}
        given["objective"] = None if objective == "length" else objective
        check_cubes(space, **{option: value for option, value in given.items() if value is not None})
    make = _objective(space, objective, name, {"curve": curve, "turning_radius": turning_radius})
    limit = positive(time_limit, "time_limit", "seconds")
    most = None if iterations is None else _iterations(iterations, name)
    number = None if seed is None else _whole(seed, "seed", 0, MAX_SEED)
    asked = exact_counts(space) if exact else {}
    ends = check_end(space, start, "start", exact), check_end(space, goal, "goal", exact)
    exists = space.path_exists(*ends)
    if exists is False:
        found = Found(np.empty((0, len(ends[0]))), INFEASIBLE)
    elif ends[0] == ends[1]:
        found = Found(np.array(ends[:1]), THERE)
    elif cubes:
        found = run_cubes(space, *ends, simplify)
    else:
        joined = {"exact": exact, "curve": curve, "turning_radius": turning_radius}
        search = Search(kind, make, limit, most, simplify, number, joined)
        found = Passages(search, way).run(*ends) if exact and exists is None else search.run(way, *ends)
    searched = time.perf_counter()
    waypoints = found.path
    solved = len(waypoints) > 0
    certified = solved and _is_certified(way, waypoints, *ends)
    path, direction = way.dense(waypoints)
    length = math.fsum(way.lengths(waypoints)) if solved else math.nan
    clearance = least_clearance(space, waypoints, way) if solved else math.nan
    for array in (path, waypoints, direction):
        if array is not None:
            array.flags.writeable = False
    setup = searched - began - found.planning - found.simplification
    return Plan(
        path=path,
        waypoints=waypoints,
        axes=kind_of(space).axes,
        direction=direction,
        solved=solved,
        certified=certified,
        status=found.status,
        length=length,
        clearance=clearance,
        path_exists=exists,
        planner=name,
        objective=objective if isinstance(objective, str) else "custom",
        curve=curve,
        turning_radius=None if curve is None else float(turning_radius or 0.0),
        exact=bool(exact),
        exact_counts={key: count - asked.get(key, 0) for key, count in exact_counts(space).items()} if exact else {},
        seed=number,
        times=Times(setup, found.planning, found.simplification, time.perf_counter() - searched),
    )


def exact_counts(space: CSpace) -> dict[str, int]:
    """How often the geometry was asked on a map so far."""
    return dict(space.exact_counts)


def _is_certified(way: Way, path: Floats, start: End, goal: End) -> bool:
    """Whether the path joins start and goal and every edge is proven free, asked of the map itself."""
    joined = tuple(path[0].tolist()) == start and tuple(path[-1].tolist()) == goal
    return joined and way.are_free(path)


def _objective(space: CSpace, objective: str | Objective, planner: str, curve: dict[str, Any]) -> Objective | None:
    """What makes the objective; None for OMPL's own, the length."""
    if objective == "length":
        return None
    kind = _BY_NAME.get(objective) if isinstance(objective, str) else None
    make = objective if kind is None else (lambda si: kind(si, space, **curve))
    if not callable(make):
        raise InputError(
            f"objective is {objective!r}; it must be 'length', {', '.join(map(repr, _BY_NAME))}, or a function from "
            "the space information to an ompl.base.OptimizationObjective; choose one of them"
        )
    if kind is OverlapObjective:
        field_of(space)
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

"""plan: from a map, a start and a goal to a checked path."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace.check import check_count, check_flag, check_positive
from cspace.compiling import clock
from cspace.configuration_space import ConfigurationSpace, Leg
from cspace.errors import InputError
from cspace.space import CSpace
from planners.catalogue import (
    BIRRT,
    GRID,
    IGNORE_OBJECTIVES,
    MAX_CLEARANCE,
    OWN,
    SECOND_THREAD,
    planner_named,
    planner_names,
)
from planners.local_planner import CAR_AXES, CURVES, DRIVES, HOLONOMIC, ON_THE_SPOT, LocalPlanner, local_planner, text
from planners.objectives import ClearanceObjective, OverlapObjective, WeightedLength, edges_on_map, overlap_field
from planners.passages import Passages, shortened
from planners.result import Plan, Times
from planners.search import Search, SearchResult
from planners.setup import MakeObjective
from planners.states import Configuration, kind_of

MAX_SEED: Final = 2**32 - 2
"""Largest seed: OMPL's generator takes 32 bits, and refuses zero."""

AHEAD: Final = 32
"""Waypoints that one edge may skip, at most, to shorten a path."""

NO_CHAIN: Final = "no chain of FREE cells joins start and goal"
"""Status of a plan without a search, which could only follow such a chain."""

_BY_NAME: Final[dict[str, type[ClearanceObjective | OverlapObjective]]] = {
    "clearance": ClearanceObjective,
    "overlap": OverlapObjective,
}
"""What can be optimised beside the length."""


class Choices(NamedTuple):
    """What :func:`plan` can be given on a space.

    Attributes
    ----------
    planners : tuple of str
        Names of planners: OMPL's, and the searches of our own that there are.
    drives : tuple of str
        Names of drives, "holonomic" first.
    curves : tuple of str
        Those of the drives that need a turning radius.
    """

    planners: tuple[str, ...]
    drives: tuple[str, ...]
    curves: tuple[str, ...]


def choices(space: ConfigurationSpace) -> Choices:
    """What :func:`plan` can be given on a space, as for a panel or a form.

    Parameters
    ----------
    space : CSpace, TiledCSpace or ArmSpace

    Returns
    -------
    Choices

    Raises
    ------
    InputError
        If ``space`` is none.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> choices = planners.choices(cspace.build(workspace, cspace.Robot.disc(0.2)))
    >>> choices.planners[-2:], choices.drives, choices.curves
    (('Grid', 'MaxClearance'), ('holonomic',), ())
    """
    own = local_planner(space).own
    if not isinstance(space, CSpace):
        own = tuple(name for name in own if name != MAX_CLEARANCE)  # which takes a map in memory
    turns = space.axes == CAR_AXES
    return Choices((*planner_names(), *own), DRIVES if turns else DRIVES[:1], CURVES if turns else ())


def plan(
    space: ConfigurationSpace,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    planner: str | None = None,
    time_limit: float = 1.0,
    iterations: int | None = None,
    simplify: bool = True,
    seed: int | None = None,
    objective: str | MakeObjective = "length",
    exact: bool = False,
    drive: str = HOLONOMIC,
    turning_radius: float | None = None,
) -> Plan:
    """Find a path on a map, with any geometric planner of OMPL, and check it; in SE(2) for any ``drive``.

    On a map of (x, y, yaw), paths are those of a robot that also moves sideways, unless ``drive`` says otherwise:
    "differential" for one that turns on the spot and drives straight on, as most mobile robots do.

    No search is run where the map proves that no path exists, or where the shortest path is wanted and is the single
    edge from start to goal. OMPL's messages are held back while it runs.

    *Time.* The search and the simplification of its path end within the time limit and a quarter of a second. What the
    map computes once, at the first plan (components, free blocks, compiled functions), comes on top and is listed
    separately in :attr:`Plan.times`.

    *What the map knows.* Unless ``exact``, a path of any drive leads through FREE cells. So a plan ends at once if no
    chain of them joins start and goal, and says what to try. If the drive is not holonomic and no path is found,
    :attr:`Plan.status` names the yaws that are proven free at start and goal, where these are not all.

    *Maps in a store.* On a :class:`cspace.TiledCSpace` the path goes from tile to tile, of which only those on the way
    are opened, through the middle of the FREE part of each common face. The planner has the time limit in each tile.
    Without a drive, the map's own search takes its place where it finds no path, or where no planner is named and the
    objective is the length; straight paths are shortened once more as a whole. Objectives and drives apply tile by
    tile; ``exact``, and "overlap", need a map in memory.

    *Arms.* In the space of an arm (:func:`cspace.build_arm_space`), an edge moves all joints in step, continuous ones
    the shorter way, and is proven all along by the geometry itself, so that ``exact`` changes nothing. Its path counts
    whole turns, so that straight motions join the rows. Drives, "Grid", "MaxClearance", "clearance" and "overlap" are
    for maps.

    *Long tails.* If FREE cells join start and goal, RRTConnect mostly ends at once, and sometimes takes very long. So,
    if ``planner`` is left out, the drive is holonomic and the objective is the length, it has ten thousand iterations,
    or ``iterations``; then the map's own search takes over, see "Grid". That has the rest of the time limit, and a
    tenth of a second at least. A planner that is named keeps the search to itself.

    Planners that go on improving their path (BITstar, InformedRRTstar, PRMstar, RRTstar, SORRTstar) use up the time
    limit.

    *Repeatable runs.* A seed sets OMPL's global seed generator, from which every planner, sampler and simplifier made
    afterwards draws its own seed; so the same call with the same seed gives the same path, also with other plans in
    between and in another process. That does not hold where the clock decides: for planners that use up the time limit
    (give ``iterations``, and a time limit that is not reached), for a search that the time limit cuts off, and for PRM
    and PRMstar, which look for the solution from a second thread. Nor does it hold where other threads of the process
    use OMPL at the same time.

    Parameters
    ----------
    space : CSpace, TiledCSpace or ArmSpace
    start, goal : array-like, shape (size,)
        Configurations, of an arm one number for each joint, or in metres: ``(x, y)``, ``(x, y, yaw)``, ``(x, y, z)``,
        ``(x, y, z, yaw)`` or ``(x, y, z, qx, qy, qz, qw)``; yaw in radians, wrapped.
    planner : str, optional
        Name of a planner, in upper or lower case; :func:`planners.planner_names` lists OMPL's. If left out, RRTConnect;
        but for Dubins curves RRT, for RRTConnect's tree at the goal grows by curves that leave the goal, where a car
        that cannot reverse needs those that arrive, so it often fails among obstacles. Planners that also follow edges
        backwards are refused for Dubins curves, and for "differential" get edges that are free both ways. Or a search
        of our own. "Grid", :meth:`cspace.CSpace.find_path` of a map, moves the robot in any direction and turns it on
        the spot; it finds a path in milliseconds wherever FREE cells join start and goal, and is deterministic.
        "MaxClearance", :meth:`cspace.CSpace.find_widest_path`, gives the path of the largest clearance, and then the
        shortest; it is deterministic, unless the time limit ends it; not on a map in a store. "BiRRT",
        :meth:`cspace.ArmSpace.find_path`, is the default for an arm: two trees in compiled code, whose motions are
        proven only where a path may be.
    time_limit : float
        Seconds after which the search gives up. Where it uses them up, a tenth of a second more goes to simplification.
        What a map computes once, and what is compiled, is not within them; see :class:`planners.Times`.
    iterations : int, optional
        Stop the planner also after so many checks of OMPL's termination condition, about one for each iteration. The
        map's own search counts none. Not for PRM and PRMstar.
    simplify : bool
        Whether the path shall be shortened, by OMPL also smoothed. The outcome is kept only where it is certified and
        no worse by the objective.
    seed : int, optional
        From 0 to 2^32 - 2. The map's own search draws no numbers: its path is the same for every seed.
    objective : {"length", "clearance", "overlap"} or callable
        What to optimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults, and "overlap"
        :class:`planners.OverlapObjective` with the field that the map carries. A callable is given the space
        information and returns an ``ompl.base.OptimizationObjective``. Anything but the length is for planners that
        heed it: BITstar, InformedRRTstar, RRTstar, SORRTstar, and, with a time limit of many seconds, FMT and
        BFMT, which ask for the cost between all pairs of near samples. They have to beat the cheapest of a few paths
        that RRTConnect finds in a tenth of the time, so that there is one where it finds any. BKPIECE1, KPIECE1,
        LBKPIECE1, RRT and RRTConnect stop at the first path; PRM and PRMstar cannot call Python from their second
        thread. The length counts a radian of turn as half a metre, but for curves; see :attr:`Plan.total_rotation`.
    exact : bool
        Decide MIXED cells by the geometry itself, so that passages are solved which are a hair wider than the robot.
        Slower there; edges are no less proven. Where the map cannot decide whether a path exists, the planner joins the
        FREE stretches of a chain of undecided cells, and the others are crossed by samples of their own, if the robot
        is holonomic; that can take seconds, so give it time. Not for curves.
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        How the robot moves along an edge, which is proven along what is really driven. "holonomic": straight, turning
        evenly the shorter way. "differential": it turns on the spot, drives straight ahead along its x axis, and turns
        again, each time the shorter way; "differential-reverse" drives backwards where that takes less turning.
        "dubins" and "reeds-shepp" are the shortest curves of a car, ahead alone, or in reverse too. All but the first
        are for maps of (x, y, yaw), with the reference point in the middle of the axle that does not steer.
    turning_radius : float, optional
        Of the car, in metres; for curves, which need it.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigurationError
        If start or goal lies outside the map, is not FREE, or lies on the border of a cell that is not FREE; or, with
        ``exact``, is not proven free by the geometry either. The message says which, and names the nearest FREE
        configuration, which is also its ``nearest``.
    InputError
        If a number is NaN, infinite or out of range, start or goal has the wrong dimension, a name is unknown, or the
        planner does not go together with ``objective``, ``iterations`` or ``drive``, or the objective is "overlap" and
        the map carries no overlap field. Also if a drive is unknown, the map is not one of (x, y, yaw), the turning
        radius is missing or not above zero, or ``exact`` is wanted along a curve.

    Warns
    -----
    AngleWarning
        If the yaw, or the angle of a continuous joint, of start or goal is beyond a whole turn, as degrees are.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> occupied = np.zeros((80, 60), dtype=bool)
    >>> occupied[40:42, :45] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.2))
    >>> plan = planners.plan(space, (1.0, 1.0), (7.0, 1.0), planner="RRTConnect", seed=1)
    >>> plan.status, plan.certified
    ('path found', True)
    >>> planners.plan(space, (1.0, 1.0), (1.0, 5.0)).length
    4.0
    """
    began = time.perf_counter()
    name = planner_named(planner, drive)
    # The search and its proofs go by parts of a map in a store, in memory.
    edges = local_planner(space, exact, drive, turning_radius)
    name = edges.quickest if planner is None else name
    check_flag(simplify, "simplify")

    def search_on(part: CSpace) -> Search:
        return Search(
            planner=name,
            objective=_objective(part, objective, name, drive, turning_radius),
            iterations=_iterations(iterations, name),
            simplify=simplify,
            seed=None if seed is None else check_count(seed, "seed", 0, MAX_SEED),
            falls_back=planner is None and objective == "length",
        )

    search = search_on(edges.space)
    limit = check_positive(time_limit, "time_limit", "seconds")
    endpoints = edges.endpoint(start, "start"), edges.endpoint(goal, "goal")
    if name in OWN:
        if name not in edges.own:
            rule = f"{BIRRT} is for arms, {GRID} and {MAX_CLEARANCE} follow the cells of a map"
            hint = "leave planner out, or choose e.g. planner='RRTConnect'"
            raise InputError("planner", f"is {name!r}, and space is {space!r}", rule, hint, value=name)
        asks = exact and edges.follows_cells  # without cells, the geometry is asked anyway
        _check_own(name, objective=objective, exact=asks, drive=drive, iterations=iterations)
    if name == MAX_CLEARANCE and not isinstance(space, CSpace):
        rule, hint = "a path there is found part by part", "choose another, or plan on space.window(lower, upper)"
        raise InputError("planner", f"is {name!r}, on a map in a store", rule, hint, value=name)
    exists = edges.prove_existence(endpoints)
    legs = space._tile_subproblems(*endpoints) if edges.may_join(exists) else []
    if planner is None and len(legs) > 1 and (objective, drive, iterations) == ("length", HOLONOMIC, None):
        name = GRID
    result = _search(search_on, edges, legs, exists, limit)
    searched = time.perf_counter()
    waypoints = edges.corners(result.path)
    solved = len(waypoints) > 0
    path, direction = edges.dense(waypoints)
    first, last = map(np.array, endpoints)
    for array in (path, waypoints, first, last, direction):
        if array is not None:
            array.flags.writeable = False
    if len(result.path):
        status, hint = "path found" + (f": {result.note}" if result.note else ""), ""
    elif exists is False:
        status, hint = "no path exists: proven", ""
    elif not legs:
        status = f"{NO_CHAIN}; {edges.known(exists)}"
        hint = _either(edges.decide(name))
    else:
        status = "; ".join([_gave_up(result, limit), edges.known(exists), *edges.limits_at(endpoints)])
        refused = {"exact=True": exact, "objective": objective != "length", "iterations": iterations is not None}
        without = [option for option, given in refused.items() if given]
        hint = _either(edges.advise(exists, name, planner is not None, f"time_limit={10 * limit:g}", without))
    clamping = edges.explain_clamping(start, "start"), edges.explain_clamping(goal, "goal")
    status = "; ".join(filter(None, (status, *clamping)))
    certified = solved and result.proven and kind_of(space).same(result.path[[0, -1]], np.array(endpoints))
    length, rotation = edges.measured(waypoints) if solved else (math.nan, math.nan)
    setup = searched - began - result.planning - result.simplification
    return Plan(
        path=path,
        waypoints=waypoints,
        start=first,
        goal=last,
        axes=space.axes,
        units=space.units,
        length_unit=edges.length_unit,
        distance_unit=edges.distance_unit,
        direction=direction,
        solved=solved,
        certified=certified,
        status=status,
        hint=hint,
        length=length,
        total_rotation=rotation,
        is_connected=exists is True,
        is_disconnected=exists is False,
        planner=name,
        objective=objective if isinstance(objective, str) else "custom",
        drive=drive,
        turning_radius=None if turning_radius is None else float(turning_radius),
        exact=edges.exact,
        seed=search.seed,
        time_limit=limit,
        times=Times(setup, result.planning, result.simplification, time.perf_counter() - searched),
        space=space,
    )


def _search(
    search_on: Callable[[CSpace], Search],
    edges: LocalPlanner,
    legs: Sequence[Leg],
    exists: bool | None,
    limit: float,
) -> SearchResult:
    """What the search finds, part by part of the map, or what is known without one."""
    path, planning, simplification = np.empty((0, edges.space.size)), 0.0, 0.0
    for opened, first, last in legs:
        part = replace(edges, space=opened())
        endpoints = tuple(first.tolist()), tuple(last.tolist())
        result = _leg(search_on(part.space), part, endpoints, exists, limit)
        if len(legs) > 1 and not len(result.path) and edges.drive == HOLONOMIC:
            result = _leg(replace(search_on(part.space), planner=GRID), part, endpoints, exists, limit)
        planning, simplification = planning + result.planning, simplification + result.simplification
        result = replace(result, path=edges.wrap_yaws(result.path))
        waypoints = edges.corners(result.path)
        result = replace(result, proven=len(waypoints) > 0 and part.are_free(waypoints))
        if len(legs) == 1 or not result.proven:
            where = f" from {text(endpoints[0])} to {text(endpoints[1])}" if len(legs) > 1 else ""
            return replace(result, where=where, planning=planning, simplification=simplification)
        path = np.concatenate([path[:-1], result.path])
    if not legs:
        return SearchResult(path)
    began = clock()
    search = search_on(edges.space)
    if search.simplify and search.objective is None and edges.drive == HOLONOMIC:
        path = shortened(edges.space, path, AHEAD)
    return SearchResult(path, f"through {len(legs)} tiles", planning, simplification + clock() - began, True)


def _leg(
    search: Search,
    edges: LocalPlanner,
    endpoints: tuple[Configuration, Configuration],
    exists: bool | None,
    limit: float,
) -> SearchResult:
    """What the search finds on one map in memory."""
    if endpoints[0] == endpoints[1]:
        return SearchResult(np.array(endpoints[:1]), "the start is the goal")
    if search.planner in OWN:
        # What a map keeps of a first search is made here, and not within the time limit.
        edges.search(search.planner, (endpoints[0], endpoints[0]), search.simplify, search.seed, limit)
        began = clock()
        path = edges.search(search.planner, endpoints, search.simplify, search.seed, limit)
        return SearchResult(path, "", clock() - began)
    if edges.follows_cells:
        passages = Passages(search, edges, limit)
        if edges.exact and exists is None:
            return passages.run(*endpoints)
        if exists and search.falls_back:
            return passages.run_free(*endpoints)
    return search.run(edges, *endpoints, limit, joined=exists is True)


def _gave_up(result: SearchResult, limit: float) -> str:
    """Say how a search ended that found no path."""
    if result.planning >= 0.95 * limit:
        return f"no path found within {limit:g} s{result.where}"
    return f"no path found: {result.note or 'the planner gave up'} after {result.planning:.2g} s{result.where}"


def _either(hints: list[str]) -> str:
    """Join alternatives: "a, b, or c"."""
    return ", or ".join(filter(None, [", ".join(hints[:-1]), *hints[-1:]]))


def _objective(
    space: CSpace, objective: str | MakeObjective, planner: str, drive: str, turning_radius: float | None
) -> MakeObjective | None:
    """What makes the objective; None for OMPL's own, the length."""
    if objective == "length":
        return (lambda si: WeightedLength(si, space, drive=drive)) if drive in ON_THE_SPOT else None
    kind = _BY_NAME.get(objective) if isinstance(objective, str) else None
    if kind is None and not callable(objective):
        rule = (
            f"it must be 'length', {', '.join(map(repr, _BY_NAME))}, or a function from the space information to an "
            "ompl.base.OptimizationObjective"
        )
        raise InputError("objective", f"is {objective!r}", rule, "choose one of them", value=objective)
    if kind is not None:
        edges_on_map(space, drive, turning_radius)
    if kind is OverlapObjective:
        overlap_field(space)
    if planner in IGNORE_OBJECTIVES | SECOND_THREAD:
        why = "heeds no objective" if planner in IGNORE_OBJECTIVES else "cannot call Python from its second thread"
        problem, hint = f"is {objective!r} and planner is {planner!r}", "choose one that optimises: planner='RRTstar'"
        raise InputError("objective", problem, f"{planner} {why}", hint, value=objective)
    if kind is None:
        return objective  # type: ignore[return-value]  # a string was refused above
    return lambda si: kind(si, space, drive=drive, turning_radius=turning_radius)


def _check_own(planner: str, **options: object) -> None:
    """Refuse what a search of the map's own cannot do."""
    for name, value in options.items():
        if value not in (None, False, "length", HOLONOMIC):
            problem = f"is {value!r} and planner is {planner!r}"
            rule = f"{planner} looks for the shortest of straight edges, to any side, in its own way"
            raise InputError(name, problem, rule, f"leave {name} out, or use planner='RRTConnect'", value=value)


def _iterations(value: int | None, planner: str) -> int | None:
    if value is None:
        return None
    count = check_count(value, "iterations", 1, 2**62)
    if planner in SECOND_THREAD:
        problem = f"is {count} and planner is {planner!r}"
        rule = f"{planner} asks whether to go on from a second thread, which cannot call Python"
        raise InputError("iterations", problem, rule, "leave iterations out or choose another planner", value=count)
    return count

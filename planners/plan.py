"""plan: find a checked path from start to goal."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace.arms.space import ArmSpace
from cspace.arrays import MIXED, Floats
from cspace.check import check_count, check_flag, check_positive
from cspace.compiling import clock
from cspace.configuration_space import ConfigurationSpace, TileSubproblem
from cspace.errors import InputError
from cspace.rotations.base import TWO_PI
from cspace.space import CSpace
from cspace.words import Drive
from planners.catalogue import (
    BIRRT,
    BUILT_IN_SEARCHES,
    GRID,
    LATTICE,
    MAX_CLEARANCE,
    PLANNERS_WITHOUT_OBJECTIVE,
    THREADED_PLANNERS,
    PlannerName,
    planner_named,
    planner_names,
)
from planners.lattice import find_lattice_path
from planners.local_planner import (
    CAR_AXES,
    CURVES,
    DRIVES,
    HOLONOMIC,
    ON_THE_SPOT,
    EdgesOnMap,
    Endpoints,
    GoalLike,
    LocalPlanner,
    local_planner,
    map_in_memory,
)
from planners.objectives import (
    ClearanceObjective,
    OverlapObjective,
    WeightedLength,
    edges_on_map,
    find_clear_path,
)
from planners.passages import Passages
from planners.result import Plan, Times
from planners.search import GRACE_SECONDS, NO_SEARCH, Search, SearchResult, shorten
from planners.setup import MakeObjective, make_bounded_states
from planners.states import kind_of

MAX_SEED: Final = 2**32 - 2
"""Largest seed: OMPL's generator takes 32 bits, and refuses zero."""

GRID_TIME_SHARE: Final = 0.5
"""Share of the time limit after which another search takes over from "Grid", or from passages."""

FIRST_SLOT_SHARE: Final = 0.1
"""Share of the time limit, at most 1 s, that OMPL's planner has before passages are searched; most are wide enough."""

MAX_SKIPPED_WAYPOINTS: Final = 32
"""Number of next waypoints that an edge of a path through tiles may lead to."""

MAX_SAMPLES_BETWEEN: Final = 256
"""Largest number of positions along an axis at which a failed search looks for MIXED cells."""

NO_CHAIN: Final = "no chain of FREE cells joins start and goal"
"""Status of a plan without a search, because every path would follow such a chain."""

CLEARANCE: Final = "clearance"

NO_SECOND_THREAD: Final = "cannot call Python from its second thread"
"""What planners with threads must not do: it would wait for the first thread for ever."""

_WHY_ONE_GOAL: Final = {
    **dict.fromkeys(THREADED_PLANNERS, NO_SECOND_THREAD),
    "BFMT": "of OMPL 2.0.1 may end the process if it has several",
}
"""Planners that take one goal, with the reason."""

_OBJECTIVES: Final[dict[str, type[ClearanceObjective | OverlapObjective]]] = {
    CLEARANCE: ClearanceObjective,
    "overlap": OverlapObjective,
}
"""Objectives other than the length, by name."""


class Choices(NamedTuple):
    """Options of :func:`plan` that a space supports.

    Attributes
    ----------
    planners : tuple of str
        Names of OMPL's planners and of the built-in searches.
    drives : tuple of str
        Names of drives, "holonomic" first.
    curves : tuple of str
        Names of the drives that need a turning radius.
    """

    planners: tuple[PlannerName, ...]
    drives: tuple[Drive, ...]
    curves: tuple[Drive, ...]


def choices(space: ConfigurationSpace) -> Choices:
    """List the options of :func:`plan` for a space.

    Parameters
    ----------
    space : CSpace, TiledCSpace or ArmSpace

    Returns
    -------
    Choices

    Raises
    ------
    InputError
        If ``space`` is neither a map nor the space of an arm.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> choices = planners.choices(cspace.build(workspace, cspace.Robot.disc(0.2)))
    >>> choices.planners[-2:], choices.drives, choices.curves
    (('Grid', 'MaxClearance'), ('holonomic',), ())
    """
    searches, is_car = local_planner(space).built_in_searches, space.axes == CAR_AXES
    if not isinstance(space, CSpace):
        searches = searches[:1]  # MaxClearance needs a map in memory
    lattice: tuple[PlannerName, ...] = (LATTICE,) if is_car else ()
    names = (*planner_names(), *searches, *lattice)
    return Choices(names, DRIVES if is_car else DRIVES[:1], CURVES if is_car else ())


def plan(
    space: ConfigurationSpace,
    start: ArrayLike,
    goal: GoalLike,
    *,
    planner: PlannerName | None = None,
    time_limit: float = 1.0,
    iterations: int | None = None,
    simplify: bool = True,
    seed: int | None = None,
    objective: str | MakeObjective = "length",
    exact: bool = False,
    drive: Drive = HOLONOMIC,
    turning_radius: float | None = None,
) -> Plan:
    """Find and prove a path on a map or for an arm.

    Any geometric planner of OMPL may search. On a map of (x, y, yaw) the robot may move sideways, unless ``drive``
    restricts it. "differential" is for robots that turn on the spot and drive straight on, as most mobile robots do.

    No search is run if the map proves that no path exists. Nor is one run if the objective is the length and the single
    edge from start to goal is free. OMPL's messages are held back while it runs.

    *Time.* Search and simplification end within the time limit plus 0.25 s. The first plan on a map also computes
    components and compiles functions; these times are not limited, see :attr:`Plan.times`.

    *FREE cells.* Unless ``exact``, a path of any drive leads through FREE cells. So a plan ends at once if no chain of
    FREE cells joins start and goal, and :attr:`Plan.hint` says what to try. If a drive that is not holonomic finds no
    path, :attr:`Plan.status` names the yaws that are proven free at start and goal, unless all are.

    *Tiled maps.* On a :class:`cspace.TiledCSpace` the path goes from tile to tile, through the middle of the FREE
    part of each common face. Only tiles on the way are opened, and the time limit holds for each tile. If the drive is
    holonomic, "Grid" takes over in tiles where the planner finds no path. Straight paths are then shortened as a whole.
    Objectives and drives apply tile by tile; ``exact`` and "overlap" need a map in memory.

    *Arms.* In the space of an arm (:func:`cspace.build_arm_space`), an edge moves all joints in step, continuous joints
    the shorter way. The geometry itself proves every edge, so ``exact`` changes nothing. Angles of continuous joints in
    the path are not wrapped, so that straight motions join its rows. Drives, "Grid", "MaxClearance", "clearance" and
    "overlap" are for maps.

    *Default.* Without a planner, another objective or ``iterations``, built-in searches go first if FREE cells join
    start and goal, or if ``exact``. "Grid" plans for holonomic robots: in the plane no path through FREE cells is
    shorter, in other spaces few are. Unless ``exact``, "Lattice" plans for other drives. OMPL's default planner takes
    over if "Grid" has no path after half the time limit, or "Lattice" has none.

    *Repeatable runs.* "Grid" always gives the same path. A seed sets OMPL's global seed generator, from which every
    planner and sampler made afterwards draws its own seed, and the random starts of poses. So the same call with the
    same seed gives the same path, in any process and after any other plans. Searches that the
    clock ends, or to which it adds configurations at a pose, are an exception: give ``iterations``
    to planners that use up the time limit. So are PRM and PRMstar, which search in a second thread,
    and OMPL used by other threads at the same time.

    Parameters
    ----------
    space : CSpace, TiledCSpace or ArmSpace
    start, goal : array-like, shape (size,)
        Configurations. An arm has one number for each joint, a map ``(x, y)``, ``(x, y, yaw)``, ``(x, y, z)``,
        ``(x, y, z, yaw)`` or ``(x, y, z, qx, qy, qz, qw)`` in metres; yaw in radians, wrapped. The goal of an arm may
        also be a :class:`cspace.PoseGoal`, or several goals: configurations, shape (n, size), or a list with pose
        goals. Goals that are not proven free are dropped, and the path ends at one of the others, :attr:`Plan.goal`.
        BFMT, PRM and PRMstar take one configuration. A pose becomes at most 16 configurations of
        :meth:`cspace.Arm.inverse`. If the search takes long, the free ones of 128 join, except with
        FMT. These are not all configurations at the pose, so "no path found" proves nothing.
    planner : str, optional
        Name, in upper or lower case, of a planner of OMPL (:func:`planners.planner_names`) or of a built-in search;
        type checkers know the names as OMPL spells them. The default is "Grid" or "Lattice" as said above, otherwise
        RRTConnect, for Dubins curves RRT, and for an arm BiRRT.

        - "Grid", :meth:`cspace.CSpace.find_path`: a short holonomic path in milliseconds if FREE cells join start and
          goal; deterministic.
        - "MaxClearance", :meth:`cspace.CSpace.find_widest_path`: the path of largest clearance, and of these the
          shortest; deterministic unless the time limit ends it; not for tiled maps.
        - "Lattice": a search along headings for drives that are not holonomic, Dolgov and others (2008); deterministic.
        - "BiRRT", :meth:`cspace.ArmSpace.find_path`: two trees of an arm's motions, in compiled code. It goes on to
          shorten its path while that gains 1 %, at most until the time limit; not with ``simplify=False``.

        BITstar, InformedRRTstar, PRMstar, RRTstar and SORRTstar improve their path until the time limit. RRTConnect
        often fails for Dubins curves, because its tree at the goal grows by curves that leave the goal. Planners that
        also follow edges backwards are refused for Dubins curves; for "differential" their edges must be free both
        ways.
    time_limit : float
        Seconds after which the search ends. Simplification then has another 0.1 s.
    iterations : int, optional
        Largest number of checks of OMPL's termination condition, about one for each iteration of the planner. For
        BiRRT, the largest number of further searches for a shorter path. Not for PRM, PRMstar and the built-in searches
        of maps.
    simplify : bool
        Whether to shorten the path. The result replaces the path only if it is certified and no worse by the objective.
    seed : int, optional
        From 0 to 2^32 - 2. Grid, MaxClearance and Lattice ignore it.
    objective : {"length", "clearance", "overlap"} or callable
        Quantity to minimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults,
        by "Grid" if no planner is named; the robot must then be holonomic. "overlap" is
        :class:`planners.OverlapObjective` with the field that the map carries. A callable takes the
        space information and returns an ``ompl.base.OptimizationObjective``. The length counts a
        radian of rotation as half a metre, except along curves; see :attr:`Plan.total_rotation`.

        Objectives other than the length are for BITstar, InformedRRTstar, RRTstar and SORRTstar. FMT and BFMT take them
        with a time limit of many seconds, because they compute the cost between all pairs of near samples. Each of
        these must beat the cheapest of a few paths that RRTConnect finds in a tenth of the time. Other planners are
        refused.
    exact : bool
        Whether the geometry itself decides MIXED cells, which finds shorter paths, and passages hardly wider than the
        robot; slower. "Grid" tests the centers of MIXED cells on its way. If it finds no path, the map is undecided and
        the robot holonomic, samples cross the MIXED cells of a chain of cells. The same happens if RRT, RRTConnect or a
        relative of KPIECE finds none at once. This can take seconds. Not for curves.
    drive : {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"}
        Motion of the robot along an edge, which is proven along that motion. All but the first are for maps of
        (x, y, yaw), with the reference point in the middle of the axle that does not steer.

        - "holonomic": straight, turning evenly the shorter way.
        - "differential": it turns on the spot, drives straight ahead along its x axis, and turns again.
        - "differential-reverse": also backwards, when that takes less rotation.
        - "dubins", "reeds-shepp": the shortest curve of a car, forwards only, or also in reverse.
    turning_radius : float, optional
        Smallest turning radius of the car, in metres; needed by curves alone.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigurationError
        If start or goal lies outside the map or is not FREE (with ``exact``, not proven free by the geometry either).
        Also if it lies on the border of a cell that is not FREE. The message names the nearest FREE configuration,
        which is also the error's ``nearest``. Also if no configuration found for a pose is within its tolerance, or if
        all of these collide. If none is within it, the message says how far the nearest pose reached is.
    InputError
        If a number is NaN, infinite or out of range; start or goal has the wrong length; a name is unknown. Also if the
        space, planner, objective, drive and other options do not go together. Also if the space is so small that OMPL
        takes steps in it for zero, and a planner of OMPL is named.

    Warns
    -----
    AngleWarning
        If the yaw of start or goal, or the angle of a continuous joint, is beyond 2 pi, as degrees are.

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
    edges = local_planner(space, exact, drive, turning_radius)
    if planner is None:
        name = _choose_planner(edges, objective, iterations)
    if planner is not None and name not in BUILT_IN_SEARCHES:
        make_bounded_states(edges)  # refuses spaces that are too small for OMPL
    check_flag(simplify, "simplify")
    search = Search(
        planner=name,
        objective=_make_objective(space, objective, name, edges),
        iterations=_check_iterations(iterations, name),
        simplify=simplify,
        seed=None if seed is None else check_count(seed, "seed", 0, MAX_SEED),
    )
    limit = check_positive(time_limit, "time_limit", "seconds")
    checked = edges.check_endpoint(start, "start")
    goals, given_goals = zip(*edges.find_goals(goal, checked, search.seed), strict=True)
    if name not in _WHY_ONE_GOAL:
        search = replace(search, more_goals=edges.more_goals(goal, checked, search.seed))
    elif len(goals) > 1:
        problem = f"has {len(goals)} configurations and planner is {name!r}"
        hint = "pass one configuration or choose another planner"
        raise InputError("goal", problem, f"{name} {_WHY_ONE_GOAL[name]}", hint, value=goal)
    task = _Task(edges, (checked, *goals), given_goals, search, objective, limit, planner is not None)
    if name in BUILT_IN_SEARCHES:
        _check_built_in_search(task)
    exists = task.edges.prove_existence(task.endpoints)
    subproblems = space._tile_subproblems(*task.endpoints[:2]) if task.edges.may_join(exists) else []
    if exists or task.edges.exact:
        task = _prefer_built_in(task)
    result = _search_tile_by_tile(task, subproblems, exists)
    if search.more_goals is not None:
        found = search.more_goals.found
        all_goals = (*task.given_goals, *found)
        task = replace(task, endpoints=(*task.endpoints, *found), given_goals=all_goals)
    return _make_plan(task, start, result, exists, began)


def _choose_planner(
    edges: LocalPlanner,
    objective: str | MakeObjective,
    iterations: int | None,
) -> PlannerName:
    """Choose the planner of a plan that names none.

    Raises InputError if none that is chosen by default minimises the objective.
    """
    name = BIRRT if BIRRT in edges.built_in_searches else planner_named(None, edges.drive)
    is_known = isinstance(objective, str) and objective in _OBJECTIVES
    is_for_map = is_known and isinstance(edges, EdgesOnMap)
    if not is_for_map and not callable(objective):  # the length, or an error for later
        return name
    given = "a function" if callable(objective) else repr(objective)
    problem = f"is {given} and no planner is named"
    rule = "the default planners minimise the length"
    if objective == CLEARANCE:
        # OMPL's default planner ignores objectives, but the map's own search weighs clearance.
        if edges.drive != HOLONOMIC:
            conflict, rule = f"drive is {edges.drive!r}", "it is for holonomic robots"
        elif edges.exact:
            conflict, rule = "exact is True", "it is for FREE cells"
        elif iterations is not None:
            conflict, rule = f"iterations is {iterations!r}", "there are no iterations"
        else:
            return GRID
        problem, rule = f"is {objective!r} and {conflict}", f"without a planner, {rule}"
    hint = "name a planner that optimises: planner='RRTstar'"
    raise InputError("objective", problem, rule, hint, value=objective)


@dataclass(frozen=True, slots=True)
class _Task:
    """The checked arguments of a plan."""

    edges: LocalPlanner  # on the whole space
    endpoints: Endpoints  # start and goals as OMPL holds them, the nearest goal first
    given_goals: tuple[ArrayLike, ...]  # as the user gave them
    search: Search
    objective: str | MakeObjective
    time_limit: float
    is_named: bool  # whether the user chose the planner

    def search_on(self, part: ConfigurationSpace) -> Search:
        """Return the search, with the objective for a part."""
        return replace(self.search, objective=_make_objective(part, self.objective, self.search.planner, self.edges))


def _check_built_in_search(task: _Task) -> None:
    """Raise InputError if a built-in search does not support the task."""
    edges, name = task.edges, task.search.planner
    if (name == BIRRT) != (BIRRT in edges.built_in_searches):
        rule, hint = f"{BIRRT} is for arms, {GRID}, {MAX_CLEARANCE} and {LATTICE} are for maps", "leave planner out"
        raise InputError("planner", f"is {name!r} and space is {edges.space!r}", rule, hint, value=name)
    if name == LATTICE and edges.drive == HOLONOMIC:
        problem, rule = f"is {name!r} and drive is {edges.drive!r}", f"{name} is for all other drives"
        raise InputError("planner", problem, rule, "use planner='Grid', or pass drive='differential'", value=name)
    keeps_away = name == GRID and task.objective == CLEARANCE
    decides_mixed = name == BIRRT or (name == GRID and not keeps_away)
    refused: dict[str, object] = {
        "objective": task.objective if task.objective != "length" and not keeps_away else None,
        "exact": True if edges.exact and edges.drive == HOLONOMIC and not decides_mixed else None,
        "drive": edges.drive if edges.drive != HOLONOMIC and name != LATTICE else None,
        "iterations": task.search.iterations if name != BIRRT else None,
    }
    minimised = "length or clearance" if name == GRID else "the length"
    rules = {
        "objective": f"{name} minimises {minimised}",
        "exact": f"{name} uses FREE cells" + f" for objective={CLEARANCE!r}" * keeps_away,
        "drive": f"{name} is for holonomic robots",
        "iterations": f"{name} counts none",
    }
    other = planner_named(None, edges.drive) if task.objective == "length" else "RRTstar"
    for option, value in refused.items():
        if value is not None:
            problem = f"is {value!r} and planner is {name!r}"
            hint = f"leave {option} out, or use planner={other!r}"
            raise InputError(option, problem, rules[option], hint, value=value)
    if name == MAX_CLEARANCE and not isinstance(edges.space, CSpace):
        rule, hint = "it needs a map in memory", "choose another, or plan on space.window(lower, upper)"
        raise InputError("planner", f"is {name!r} and the map is tiled", rule, hint, value=name)


def _check_iterations(value: int | None, planner: PlannerName) -> int | None:
    """Check the number of iterations for a planner."""
    if value is None:
        return None
    count = check_count(value, "iterations", 1, 2**62)
    if planner in THREADED_PLANNERS:
        problem, rule = f"is {count} and planner is {planner!r}", f"{planner} {NO_SECOND_THREAD}"
        raise InputError("iterations", problem, rule, "leave iterations out or choose another planner", value=count)
    return count


def _make_objective(
    space: ConfigurationSpace, objective: str | MakeObjective, planner: PlannerName, edges: LocalPlanner
) -> MakeObjective | None:
    """Return the maker of the objective; None for OMPL's length."""
    drive, radius = edges.drive, edges.turning_radius
    if objective == "length":
        if drive not in ON_THE_SPOT:
            return None
        plane = edges_on_map(space, drive, radius).space
        return lambda si: WeightedLength(si, plane, drive=drive)
    kind = _OBJECTIVES.get(objective) if isinstance(objective, str) else None
    if kind is None and not callable(objective):
        rule = f"it must be 'length', {', '.join(map(repr, _OBJECTIVES))}, or a function that makes OMPL's objective"
        raise InputError("objective", f"is {objective!r}", rule, "choose one of them", value=objective)
    cells = edges_on_map(space, drive, radius).space if kind is not None else None
    is_overlap = cells is not None and kind is OverlapObjective
    if is_overlap and map_in_memory(cells, "overlap_field").overlap_field is None:
        rule = "it needs an overlap field, but the map carries none"
        hint = "plan on space.with_overlap_field(overlap)"
        raise InputError("objective", f"is {objective!r}", rule, hint, value=objective)
    if planner in PLANNERS_WITHOUT_OBJECTIVE | THREADED_PLANNERS:
        without = planner in PLANNERS_WITHOUT_OBJECTIVE
        rule = f"{planner} {'ignores objectives' if without else NO_SECOND_THREAD}"
        problem, hint = f"is {objective!r} and planner is {planner!r}", "choose one that optimises: planner='RRTstar'"
        raise InputError("objective", problem, rule, hint, value=objective)
    if kind is None or cells is None:
        return objective  # type: ignore[return-value]  # unknown strings were refused above
    return lambda si: kind(si, cells, drive=drive, turning_radius=radius)


def _prefer_built_in(task: _Task) -> _Task:
    """Choose a built-in search with OMPL's default as fallback.

    The task stays unchanged if another option needs OMPL.
    """
    edges, search = task.edges, task.search
    is_holonomic = edges.drive == HOLONOMIC
    if task.is_named or not isinstance(edges, EdgesOnMap) or (task.objective, search.iterations) != ("length", None):
        return task
    if edges.exact and not is_holonomic:
        return task
    fallback: PlannerName | None = search.planner
    try:
        make_bounded_states(edges)
    except InputError:  # the space is too small for OMPL
        fallback = None
    return replace(task, search=replace(search, planner=GRID if is_holonomic else LATTICE, fallback=fallback))


def _search_tile_by_tile(task: _Task, subproblems: Sequence[TileSubproblem], exists: bool | None) -> SearchResult:
    """Search tile by tile, join the paths, prove the edges.

    The first part without a proven path ends the search. There are no parts if a path cannot exist.
    """
    edges, is_tiled = task.edges, len(subproblems) > 1
    path, planning, simplification = np.empty((0, edges.space.size)), 0.0, 0.0
    for open_part, first, last in subproblems:
        part = replace(edges, space=open_part())
        endpoints = tuple(first.tolist()), tuple(last.tolist()), *task.endpoints[2:]
        search = task.search_on(part.space)
        if is_tiled and edges.drive == HOLONOMIC and search.planner not in BUILT_IN_SEARCHES:
            search = replace(search, fallback=GRID)
        result = _search(search, part, endpoints, exists, task.time_limit)
        planning, simplification = planning + result.planning, simplification + result.simplification
        result = replace(result, path=edges.wrap_yaws(result.path), planning=planning, simplification=simplification)
        waypoints = edges.breakpoints(result.path)
        result = replace(result, proven=len(waypoints) > 0 and part.are_free(waypoints))
        if not is_tiled or not result.proven:
            first_text, last_text = map(part.format_configuration, endpoints[:2])
            return replace(result, where=f" from {first_text} to {last_text}" * is_tiled)
        path = np.concatenate([path[:-1], result.path])
    if not subproblems:
        return SearchResult(path)
    began = clock()
    if task.search.simplify and task.search.objective is None and edges.drive == HOLONOMIC:
        path = _skip_waypoints(edges.space, path)
    return SearchResult(path, f"through {len(subproblems)} tiles", planning, simplification + clock() - began, True)


def _skip_waypoints(space: ConfigurationSpace, path: Floats) -> Floats:
    """Skip waypoints, shape (n, size), by free edges.

    From each waypoint, the path takes the free edge to the farthest of the next ones. Edges are proven in one batch,
    because a single look-up in tiles takes as long.
    """
    kept = [0]
    while kept[-1] < len(path) - 1:
        after = np.arange(kept[-1] + 1, min(kept[-1] + 1 + MAX_SKIPPED_WAYPOINTS, len(path)))
        free = np.asarray(space.motion_is_free(path[kept[-1]], path[after]))
        free[0] = True  # the edge of the path itself
        kept.append(int(after[np.flatnonzero(free)[-1]]))
    return path[kept]


def _search(
    search: Search, edges: LocalPlanner, endpoints: Endpoints, exists: bool | None, limit: float
) -> SearchResult:
    """Search for a path in a space in memory."""
    if endpoints[0] in endpoints[1:]:
        return SearchResult(np.array(endpoints[:1]), "the start is the goal")
    stops_at_first_path = search.planner in PLANNERS_WITHOUT_OBJECTIVE and search.iterations is None
    if search.planner in BUILT_IN_SEARCHES:
        result = _search_built_in(search, edges, endpoints, limit)
    elif exists is None and isinstance(edges, EdgesOnMap) and edges.drive == HOLONOMIC and stops_at_first_path:
        result = _search_passages(search, edges, endpoints, limit)
    else:
        result = search.run(edges, endpoints, limit)
    left = limit if search.fallback == GRID else limit - result.planning
    if len(result.path) or search.fallback is None or left <= 0.0:
        return result
    other = _search(replace(search, planner=search.fallback, fallback=None), edges, endpoints, exists, left)
    note = f"by {search.fallback}, as {search.planner} found none" if len(other.path) else other.note
    return replace(other, note=note, planning=result.planning + other.planning, lattice=result.lattice)


def _search_built_in(search: Search, edges: LocalPlanner, endpoints: Endpoints, limit: float) -> SearchResult:
    """Run a built-in search; "Grid" leaves time for a fallback."""
    # A search from the start to itself fills the caches of the map, which the time limit leaves out.
    _find_path(replace(search, simplify=False), edges, (endpoints[0], endpoints[0]), limit)
    seconds = limit
    if search.fallback is not None and search.planner == GRID:
        seconds = max(GRID_TIME_SHARE * limit, GRACE_SECONDS)
    began = clock()
    path, proof = _find_path(search, edges, endpoints, seconds)
    is_by_length = search.planner == LATTICE or (search.planner == GRID and search.objective is None)
    return SearchResult(path, NO_SEARCH * (is_by_length and len(path) == 2), clock() - began, lattice=proof)


def _find_path(search: Search, edges: LocalPlanner, endpoints: Endpoints, seconds: float) -> tuple[Floats, str]:
    """Find a path by a built-in search.

    Returns its waypoints, shape (n, size), where n is 0 if none is found, and what a lattice proves, in words.
    """
    straight = search.simplify
    if not isinstance(edges, EdgesOnMap):
        start, *goals = endpoints
        space, iterations = cast(ArmSpace, edges.space), search.iterations if straight else 0
        options = straight, iterations, search.seed, seconds
        return space._find_path(start, goals, *options, search.more_goals), ""
    if search.planner == LATTICE:
        return find_lattice_path(edges, endpoints, straight, seconds)
    if search.planner == MAX_CLEARANCE:
        return edges.space.find_widest_path(*endpoints, straight=straight, time_limit=seconds), ""
    if search.objective is not None:
        return find_clear_path(edges, endpoints, straight, seconds), ""
    exact = {"exact": True} if edges.exact else {}  # only maps in memory have geometry
    return edges.space.find_path(*endpoints, straight=straight, time_limit=seconds, **exact), ""


def _search_passages(search: Search, edges: EdgesOnMap, endpoints: Endpoints, limit: float) -> SearchResult:
    """Search by OMPL, along chains of cells, by OMPL again."""
    result = search.run(edges, endpoints, min(FIRST_SLOT_SHARE * limit, 1.0))
    if len(result.path):
        return result
    edges.space.is_free(np.array(endpoints[:1]), exact=True)  # fills caches of exact geometry, outside the limit
    began, left = clock(), limit - result.planning
    rng, until = np.random.default_rng(search.seed), began + GRID_TIME_SHARE * left
    path = Passages(edges, rng, until).find(endpoints)
    if not len(path):
        return search.run(edges, endpoints, max(left - (clock() - began), 1e-3))
    planning, began = result.planning + clock() - began, clock()
    path = shorten(edges, path, began + limit - planning) if search.simplify else path
    return SearchResult(path, "through undecided passages", planning, clock() - began)


def _describe_outcome(task: _Task, result: SearchResult, exists: bool | None) -> tuple[str, str]:
    """Return a plan's status, and a hint if a search failed."""
    edges = task.edges
    if len(result.path):
        return "path found" + (f": {result.note}" if result.note else ""), ""
    if exists is False:
        return "no path exists: proven", ""
    existence = "unknown whether one exists"
    if isinstance(edges, EdgesOnMap):
        sideways = "a path exists" if edges.drive == HOLONOMIC else "one exists for a robot that also moves sideways"
        existence = sideways if exists else "undecided whether one exists"
    is_late = result.planning >= 0.95 * task.time_limit
    hints = _list_hints(task, exists, is_late)
    hint = ", or ".join(filter(None, [", ".join(hints[:-1]), *hints[-1:]]))
    if not edges.may_join(exists):
        return f"{NO_CHAIN}; {existence}", hint
    failure = f"no path found: {result.note or 'the planner gave up'} after {result.planning:.2g} s{result.where}"
    if is_late:
        failure = f"no path found within {task.time_limit:g} s{result.where}"
    limits = _describe_free_yaws(edges, task.endpoints) if isinstance(edges, EdgesOnMap) else []
    return "; ".join(filter(None, [failure, result.lattice, existence, *limits])), hint


def _list_hints(task: _Task, exists: bool | None, is_late: bool) -> list[str]:
    """List hints for a failed search, which the time limit ended if ``is_late``."""
    edges, planner, more = task.edges, task.search.planner, f"more time (time_limit={10 * task.time_limit:g})"
    if not isinstance(edges, EdgesOnMap):
        return [more, "another seed", "another planner"]
    finer = "a finer spacing" + " or more rotations" * bool(edges.space.rotations.names)
    no_exact_search = task.is_named and planner in (MAX_CLEARANCE, LATTICE)
    exact = "planner='RRTConnect' with exact=True" if no_exact_search else "exact=True"
    exact += "" if isinstance(edges.space, CSpace) else " on space.window(lower, upper)"
    decide_mixed = [exact] * (edges.drive not in CURVES and not edges.exact)
    if not edges.may_join(exists):
        wider = ["a workspace with wider bounds"] * (edges.space.outside == "free")
        return [*decide_mixed, finer, *wider]
    if exists is None:
        return [finer, more]
    if edges.drive != HOLONOMIC:
        is_coarse = not edges.exact and _has_mixed_between(edges, task.endpoints)
        resolve = [f"{finer} (MIXED cells lie between)", *decide_mixed] * is_coarse
        # More time does not help Lattice if its search ended before.
        needs_more = is_late or planner != LATTICE or task.search.fallback is not None
        other = "another planner" if needs_more else f"planner={planner_named(None, edges.drive)!r}"
        radius = ["a smaller turning_radius"] * (edges.drive in CURVES)
        return [*resolve, *[more] * needs_more, *radius, other]
    if planner == GRID:
        return [more, "planner='RRTConnect'"]
    given = {"exact=True": edges.exact, "objective": task.objective != "length", "iterations": task.search.iterations}
    unsupported = " and ".join(option for option, is_given in given.items() if is_given)
    by_grid = f"planner='Grid'{f' without {unsupported}' if unsupported else ''}, which finds one"
    return [*[by_grid] * task.is_named, more]


def _has_mixed_between(edges: EdgesOnMap, endpoints: Endpoints) -> bool:
    """Return True if MIXED cells lie between start and goal, at a yaw of theirs.

    The box around both is sampled, grown by the turning radius or the robot's size.
    """
    grid = edges.space.grid
    positions = np.array(endpoints)[:, :2]
    reach = edges.turning_radius or edges.space.robot.span
    lower = np.maximum(positions.min(axis=0) - reach, grid.lower)
    upper = np.minimum(positions.max(axis=0) + reach, grid.upper)
    counts = np.ceil((upper - lower) / grid.spacing).astype(np.int64) + 1
    x, y = (
        np.linspace(low, high, min(int(n), MAX_SAMPLES_BETWEEN))
        for low, high, n in zip(lower, upper, counts, strict=True)
    )
    positions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    for q in endpoints:
        samples = np.insert(positions, 2, q[2], axis=1)
        if np.any(edges.space.classify(samples) == MIXED):
            return True
    return False


def _describe_free_yaws(edges: EdgesOnMap, endpoints: Endpoints) -> list[str]:
    """Name the yaws proven free at start and goal.

    The robot reaches these on the spot through FREE cells. If it reaches all, or is holonomic, nothing is named.
    """
    if edges.drive == HOLONOMIC:
        return []
    limits, rotations = [], edges.space.rotations
    borders = np.asarray(rotations._coordinates["yaw_bounds"])
    for name, q in zip(("start", "goal"), endpoints, strict=True):
        free = edges.space.is_free(np.column_stack([np.tile(q[:2], (len(rotations), 1)), rotations.centers]))
        cell = int(rotations.cell_of(q[2]))
        if free.all() or not free[cell]:
            continue
        free, widths = np.roll(free, -cell), np.roll(np.diff(borders, axis=1)[:, 0], -cell)
        above, below = int(np.argmin(free)), int(np.argmin(free[::-1]))  # FREE cells from q's cell on, and before it
        lowest = q[2] - (q[2] - borders[cell, 0]) % TWO_PI
        low = lowest - float(widths[len(widths) - below :].sum())
        high = lowest + float(widths[:above].sum())
        yaws = f"{math.ceil(1e3 * low) / 1e3:g} to {math.floor(1e3 * high) / 1e3:g} rad"
        too_few = ", too few to turn around" * (edges.drive in ON_THE_SPOT)
        limits.append(f"at the {name} only yaws {yaws} are proven free{too_few}")
    return limits


def _make_plan(task: _Task, given: ArrayLike, result: SearchResult, exists: bool | None, began: float) -> Plan:
    """Make the plan of a search, and measure its path.

    ``given`` is the start as the user gave it; ``began`` is a reading of ``time.perf_counter`` before all checks.
    """
    searched = time.perf_counter()
    status, hint = _describe_outcome(task, result, exists)
    reached = kind_of(task.edges.space).reached_goal(result.path, task.endpoints) if len(result.path) else 0
    ends = zip((given, task.given_goals[max(reached, 1) - 1]), ("start", "goal"), strict=True)
    status = "; ".join(filter(None, (status, *(task.edges.explain_clamping(*each) for each in ends))))
    edges, search = task.edges, task.search
    waypoints = edges.breakpoints(result.path)
    solved = len(waypoints) > 0
    path, direction = edges.resample(waypoints)
    start, goal = np.array(task.endpoints[0]), np.array(task.endpoints[max(reached, 1)])
    for array in (path, waypoints, start, goal, direction):
        if array is not None:
            array.flags.writeable = False
    length, rotation = edges.measure(waypoints) if solved else (math.nan, math.nan)
    setup = searched - began - result.planning - result.simplification
    return Plan(
        path=path,
        waypoints=waypoints,
        start=start,
        goal=goal,
        axes=edges.space.axes,
        units=edges.space.units,
        length_unit=edges.units[0],
        distance_unit=edges.units[1],
        direction=direction,
        solved=solved,
        certified=reached > 0 and result.proven,
        status=status,
        hint=hint,
        length=length,
        total_rotation=rotation,
        is_connected=exists is True,
        is_disconnected=exists is False,
        planner=search.planner,
        objective=task.objective if isinstance(task.objective, str) else "custom",
        drive=edges.drive,
        turning_radius=edges.turning_radius,
        exact=edges.exact,
        seed=search.seed,
        time_limit=task.time_limit,
        times=Times(setup, result.planning, result.simplification, time.perf_counter() - searched),
        space=edges.space,
    )

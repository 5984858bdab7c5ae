"""plan: find a checked path from start to goal."""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from numbers import Number
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import CSpace, Goal, Space
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    NEVER,
    Car,
    ConfigurationMap,
    ConfigurationSpace,
    Differential,
    Effort,
    Endpoint,
    Floats,
    PlaceLike,
    SearchOptions,
    check_count,
    frozen,
    gather_goals,
    is_labelled,
    is_over,
    names_options,
    now,
)
from cspace.inside import Upright as Upright
from planners._catalogue import (
    BUILT_IN_SEARCHES,
    GRID,
    LATTICE,
    LENGTH,
    MAX_CLEARANCE,
    NEAR_START,
    OWN_SPACES,
    SKILLS,
    TILED_MAPS,
    PlannerName,
    Search,
    Skills,
    check_skills,
    check_support,
    default_planner,
    find_space_kind,
    planner_named,
    planner_names,
)
from planners._drives import has_drives, local_planner
from planners._goals import (
    MAX_TRIED_GOALS,
    Near,
    PlaceParts,
    Room,
    begin_in_rooms,
    end_in_rooms,
    find_room_goals,
    find_routes,
    list_all_rooms,
    list_rooms,
    sort_goals,
    split_places,
)
from planners._local_planner import MAX_RADIANS, Drive, Endpoints, LocalPlanner
from planners._objectives import ObjectiveLike, name_kind, read_objective
from planners._own_space import check_found_path, check_space
from planners._paths import drop_repeats, reached_goal, skip_points, unwind
from planners._result import Plan, Times
from planners._shortening import shorten
from planners._stages import Existence, Stage
from planners._task import DEFAULT_SECONDS, NO_EFFORT, NO_SEARCH, PlanTask, SearchResult

if TYPE_CHECKING:
    from planners._speed_limits import SpeedLike

QUICK_PLANNER: Final[PlannerName] = "RRTConnect"
"""Planner of the first path of robots that rotate, except along Dubins curves."""

QUICK_ITERATIONS: Final = 500
"""Iterations of the quick first search of a default plan, which take about 10 ms."""

EXACT_SHARE: Final = 0.5
"""Share of the effort left for the quick search, and then for the built-in one, if geometry decides
MIXED cells: a search through many such cells may not end."""

SHARES_BESIDE: Final = [sign * step / 64 for step in range(1, 33) for sign in (1.0, -1.0)]
"""Distances beside a way that are tried for a detour, as shares of its length; positive to the
left."""

MAX_SAVING: Final = 0.01
"""Share by which the lower bound of another path between the same two rooms must be less, for a
further search: a path begins and ends where it leaves and enters rooms."""

MAX_DETOUR: Final = 1.5
"""Length of a path by its lower bound, up to which the bounds of others tell whether to search."""

GOAL_SHARE: Final = 0.5
"""Share of the effort left for the search to one of several goals, except the last one."""

FURTHER_FACTOR: Final = 2.0
MIN_FURTHER: Final = Effort.from_seconds(0.05, math.inf)
"""Work of a further search to a room for a drive, relative to that of the best one, and its least
value: configurations of a room may be free, and yet out of the drive's reach."""


class Choices(NamedTuple):
    """Options of :func:`plan` that a space supports.

    Attributes
    ----------
    planners : tuple of str
        Names of OMPL's planners and of the built-in searches.
    drives : tuple of type
        Classes of drives.
    """

    planners: tuple[PlannerName, ...]
    drives: tuple[type[Drive], ...]


def choices(space: Space) -> Choices:
    """List the options of :func:`plan` for a space.

    Parameters
    ----------
    space : Space

    Returns
    -------
    Choices

    Raises
    ------
    InputError
        If ``space`` is no :class:`cspace.Space`.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> choices = planners.choices(cspace.build(workspace, cspace.Robot.disc(0.2)))
    >>> choices.planners[-2:], choices.drives
    (('Grid', 'MaxClearance'), ())
    """
    check_space(space)
    planners = (*planner_names(), *_list_searches(space))
    return Choices(planners, (Differential, Car) if has_drives(space) else ())


def _list_searches(space: Space) -> tuple[PlannerName, ...]:
    """List the built-in searches for a space."""
    names = space.searches
    if isinstance(space, ConfigurationMap):
        names = (GRID, MAX_CLEARANCE) if isinstance(space, CSpace) else (GRID,)
    if has_drives(space):
        names = (*names, LATTICE)
    return cast(tuple[PlannerName, ...], names)


@names_options
def plan(
    space: Space,
    start: PlaceLike,
    goal: PlaceLike,
    *,
    planner: PlannerName | Search | None = None,
    time_limit: float | None = None,
    seed: int | None = None,
    objective: ObjectiveLike = "length",
    speed: SpeedLike | Sequence[SpeedLike] | None = None,
    drive: Drive | None = None,
    via: Sequence[PlaceLike] = (),
    previous: Plan | None = None,
    stop: Callable[[], bool] | None = None,
    keep: Upright | Sequence[Upright] | None = None,
) -> Plan:
    """Find and prove a path on a map or for an arm.

    A geometric planner of OMPL may search, or a search of our own. Every edge of the path is
    proven free by the map, or for an arm by the geometry. The page on planning describes defaults,
    time, refused options, previous plans, tiled maps and repeatable runs.

    Parameters
    ----------
    space : Space
        With ``space.exact`` the geometry itself decides MIXED cells, which finds shorter paths, and
        passages little wider than the robot; slower.
    start, goal : place
        A configuration by the axes of the space, such as ``(x, y, yaw)`` in metres and radians, or
        a number for each joint, or a message that :func:`cspace.ros.configuration_of` or
        :meth:`cspace.Arm.configuration` takes. It may be a :class:`cspace.PoseGoal` for an arm, and
        on a map :class:`planners.Near`, ``(x, y, None)`` for any yaw, a polygon of shapely as a
        region of positions, or ``(polygon, yaw)``; or a list of alternatives, of which the shortest
        path found takes one. A list of numbers is one configuration, a region and a number are one
        place, and every other list is of alternatives. A start Near one configuration moves only if
        that is not free.
    planner : str or Search, optional
        Name, in upper or lower case, of a planner of OMPL (:func:`planners.choices`) or of a
        built-in search: "Grid", "MaxClearance" and "Lattice" on maps, "BiRRT" for arms.
        :class:`planners.Search` is one with settings.
    time_limit : float, optional
        Seconds after which the search ends. Simplification then has another 0.1 s. Work that a map
        does once, and compiling, also by other threads of this process, come on top. By default,
        the search ends after counted work, of about a second on an idle machine.
    seed : int, optional
        From 0 to 2^32 - 2. The same call with the same seed gives the same path, unless a time
        limit ends the search. Default planners need none.
    objective : {"length", "clearance", "time"}, WeightedLength, ClearanceObjective or callable
        Quantity to minimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults,
        "time" that of driving as fast as ``speed`` allows. A callable takes the space information
        and returns an ``ompl.base.OptimizationObjective``. The length counts a radian of rotation
        as half a metre, except along curves; so do the others, at the cost of a metre there.
    speed : number, SpeedZones, SlowNear, or a list of these, optional
        Largest speeds, for the objective "time": a number for all places, m/s, and
        limits of places. Trajectories get theirs by :meth:`planners.Plan.trajectory`.
    drive : Car or Differential, optional
        :class:`planners.Car` or :class:`planners.Differential`, for maps of (x, y, yaw): the motion
        along an edge, which is proven along that motion. By default the robot moves in any
        direction.
    via : sequence, optional
        Places on the way, in this order, each like the goal. Each part of the path is the best
        from the end of the part before, if that leads on; they share the time limit evenly.
    previous : Plan, optional
        The last plan for a space with these axes, in memory. The path joins it and follows it; only
        a blocked part of it is searched anew. If a start lies in a MIXED cell and the geometry
        proves it free, the plan is ``exact``. By another objective than the length it was a plan
        by that one, too; not for functions.
    stop : callable, optional
        Called without arguments every 5 ms or more, in this thread, until it returns True, which
        ends the search soon after: for a request to cancel, or a deadline of all work, such as
        ``lambda: time.monotonic() > end``. A map of ten million cells ends it within 50 ms, once a
        first plan has filled its caches. Only planners of OMPL return a path found before.
    keep : Upright or sequence of Upright, optional
        Directions that links of an arm keep all along the path, as proven as that it is free; for
        "BiRRT".

    Returns
    -------
    Plan
        Without a path, :attr:`Plan.status` says what is proven, and :attr:`Plan.hint` what helps.

    Raises
    ------
    ConfigurationError
        If start or goal is not proven free and upright, or no such one is found for a pose. The
        message and the error's ``nearest`` give the nearest FREE configuration.
    InputError
        If a number is NaN, infinite or out of range, a name is unknown, or the space, planner,
        objective, drive and other options do not go together.

    Warns
    -----
    AngleWarning
        If an angle is beyond 2 pi, as degrees are.

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
    began = time.monotonic()
    _check_stop(stop)
    edges = local_planner(space, drive)
    space = edges.space
    kept = _check_keep(keep)
    if kept:
        check_support("`keep`", "keep", keep, space)
        edges = replace(edges, space=space.keep(kept))
    search = planner if isinstance(planner, Search) else Search()
    name = search.name if isinstance(planner, Search) else planner
    task = PlanTask(
        edges=edges,
        planner=planner_named(default_planner(drive) if name is None else name, space.searches),
        objective=objective,
        weigh=read_objective(objective, speed, space),
        limit=Effort.within(time_limit, DEFAULT_SECONDS),
        time_limit=None if time_limit is None else float(time_limit),
        iterations=search.iterations,
        range=search.range,
        simplify=search.simplify,
        seed=None if seed is None else check_count(seed, "seed", 0, 2**32 - 2),
        is_named=name is not None,
        previous=np.empty((0, space.size)),
        keep=kept,
    )
    origins = split_places(space, _drop_zeros(start), "start", NEAR_START)
    if previous is not None:
        task = _add_previous(task, previous, origins)
        if task.edges is not edges:  # the geometry proves the start
            space = task.edges.space
    task = _choose_searches(task)
    places = _check_places(via, goal, task)
    origin, moved = _check_start(task, origins)
    ends = [_check_stage(task, name, place, origin.rooms[0]) for name, place in places]
    if drive is not None:
        import planners._lattice  # noqa: F401 - a search would import it later, on its time
    task = replace(task, edges=_weigh_edges(task, task.edges))
    if task.seed is not None:
        from planners._ompl_search import set_seed

        set_seed(task.seed)
    with Effort.stopping(stop):
        journey = _search_stages(task, [origin, *ends])
        return _make_plan(journey, space, moved, began)


def _weigh_edges(task: PlanTask, edges: LocalPlanner) -> LocalPlanner:
    """Return edges with the costs of a task; a map in tiles has them tile by tile."""
    if task.weigh is None or find_space_kind(edges.space) == TILED_MAPS:
        return edges
    return replace(edges, weights=task.weigh(edges.cells))


def _check_stop(stop: object) -> None:
    """Raise InputError for a stopping rule that cannot be called."""
    if stop is not None and not callable(stop):
        rule = "it is called to ask whether the search ends"
        raise InputError("stop", f"is {stop!r}", rule)


def _check_keep(keep: Upright | Sequence[Upright] | None) -> tuple[Upright, ...]:
    """Return a plan's constraints; raise InputError for anything else."""
    if keep is None:
        return ()
    given = [keep] if isinstance(keep, Upright) else keep
    if isinstance(given, Sequence) and all(isinstance(each, Upright) for each in given):
        return tuple(given)
    rule = "it must be an Upright, or a list of several"
    raise InputError("keep", f"is {keep!r}", rule)


def _add_previous(task: PlanTask, previous: Plan, starts: Sequence[PlaceParts]) -> PlanTask:
    """Let a task follow the previous plan, by the geometry if only this proves the start."""
    task = replace(task, previous=_check_previous(task, previous))
    edges = task.edges
    # A robot on its way cannot choose another start.
    if len(starts) == 1 and starts[0].is_one and not edges.exact:
        start = cast("ArrayLike", starts[0].configuration)
        if _needs_geometry(edges.space, start):
            task = replace(task, edges=replace(edges, space=edges.space.exact))
    return task


def _needs_geometry(space: Space, start: ArrayLike) -> bool:
    """Return whether only the geometry proves a start."""
    try:
        space.check_endpoint(start, "start")
    except ConfigurationError:
        with suppress(ConfigurationError):
            space.exact.check_endpoint(start, "start")
            return True
    return False


def _check_previous(task: PlanTask, previous: Plan) -> Floats:
    """Return the waypoints of the previous plan, shape (n, size); n is 0 if there are none."""
    space = task.edges.space
    if not isinstance(previous, Plan):
        raise InputError(
            "previous",
            f"is {previous!r}",
            "it is what planners.plan returned before",
        )
    if previous.axes != space.axes or find_space_kind(space) == TILED_MAPS:
        raise InputError(
            "previous",
            f"has the axes ({', '.join(previous.axes)}) and space is {space!r}",
            "it is a plan for the axes of the space, which is in memory",
        )
    if callable(task.objective) or task.planner == MAX_CLEARANCE:
        raise InputError(
            "previous",
            f"is a plan, the objective {task.objective!r} and the planner {task.planner!r}",
            "a path along a previous one is short, or cheap by the cost of cells",
        )
    kind = name_kind(task.objective)
    if task.weigh is not None and previous.objective != kind:
        problem = f"is a plan by {previous.objective!r}, and the objective is {kind!r}"
        raise InputError("previous", problem, "a path along a previous one is cheap as that was")
    return previous.waypoints


def _choose_searches(task: PlanTask) -> PlanTask:
    """Choose a planner if none is named, and a fallback; check the options of the planner."""
    space = task.edges.space
    default = task.planner
    if not task.is_named:
        task = replace(task, planner=_choose_planner(task))
    searches = _list_searches(space)
    name = task.planner
    if name in BUILT_IN_SEARCHES and name not in searches:
        raise InputError(
            "planner",
            f"is {name!r} and space is {space!r}",
            f"its built-in searches are {', '.join(searches) or 'none'}",
        )
    objective = task.objective
    kind = name_kind(objective)
    check_skills(name, task.edges.drive, objective, kind, task.keep, task.is_named)
    if name not in searches:
        _check_states(task.edges)
    elif find_space_kind(space) == OWN_SPACES:
        from planners._ompl_states import find_state_kind

        find_state_kind(space)  # refuses poses whose axes are in another order
    # Grid finds each path of a robot that does not turn through FREE cells.
    may_fail = task.edges.exact or bool(space.rotations.names)
    if name != default and may_fail and isinstance(space, ConfigurationMap):
        with suppress(InputError):  # the space may be too small for OMPL
            _check_states(task.edges)
            task = replace(task, fallback=default)
    return task


def _check_states(edges: LocalPlanner) -> None:
    """Raise InputError for poses and extents that OMPL has no states for."""
    from planners._setup import make_bounded_states

    make_bounded_states(edges)


def _check_places(
    via: Sequence[PlaceLike], goal: PlaceLike, task: PlanTask
) -> list[tuple[str, PlaceLike]]:
    """Return the places on the way and the goal, with their names in messages."""
    is_list = isinstance(via, (tuple, list, np.ndarray))
    if not is_list or any(isinstance(place, Number) for place in via):
        raise InputError("via", f"is {via!r}", "it lists places on the way")
    if len(via) and len(task.previous):
        raise InputError(
            "via",
            f"has {len(via)} places, and previous is given",
            "a previous plan is followed to one goal",
        )
    return [*((f"via[{k}]", place) for k, place in enumerate(via)), ("goal", goal)]


def _drop_zeros(start: PlaceLike) -> PlaceLike:
    """Return the configuration of a start that is Near it by nothing, or the start as it is."""
    if isinstance(start, Near) and not (start.distance or start.angle):
        return start.configuration
    return start


def _check_start(task: PlanTask, places: Sequence[PlaceParts]) -> tuple[Stage, dict[Endpoint, str]]:
    """Return the checked start, and texts for configurations that were moved.

    Raises InputError or ConfigurationError if the start cannot be used.
    """
    space = task.edges.space
    moved: dict[Endpoint, str] = {}

    def find_rooms(place: PlaceParts, name: str) -> list[Room]:
        """Return the room of a place, or those of its configurations."""
        if isinstance(place.configuration, Goal):
            near = tuple(np.clip(0.0, *space.bounds).tolist())
            goals = space.find_goals(place.configuration, near, task.seed, name=name)
            return [Room(name, np.array(q)) for q in goals[:MAX_TRIED_GOALS]]
        if not place.is_one:
            return list(list_rooms(task.edges.cells, [place]))
        q, text = _move_start(task.edges, place)
        moved[q] = text
        return [Room(name, np.array(q))]

    rooms = gather_goals("start", places, find_rooms)
    goals = [tuple(room.middle.tolist()) for room in rooms]
    whole = list_all_rooms(space, places, goals)
    return Stage("start", goals, tuple(rooms), whole), moved


def _move_start(edges: LocalPlanner, place: PlaceParts) -> tuple[Endpoint, str]:
    """Return a checked configuration, and a text if it was moved near the given one."""
    space = edges.space
    start = space.check_configuration(cast("ArrayLike", place.configuration), place.name)
    try:
        return space.check_endpoint(start, place.name), ""
    except ConfigurationError:
        if place.near is None:
            raise
    (room,) = list_rooms(edges.cells, [place])
    moved = room.find_goals(edges, tuple(start.tolist()))[0]
    distance = float(space.distance(start, np.array(moved)))
    return moved, f"{place.name} moved by {distance:.3g} m to {moved}"


def _check_stage(task: PlanTask, name: str, place: PlaceLike, start: Room) -> Stage:
    """Return a checked place; raise InputError or ConfigurationError if it cannot be used."""
    edges = task.edges
    space = edges.space
    places = split_places(space, place, name)
    near = start.find_inner(space)
    rooms: tuple[Room, ...] = ()
    if isinstance(space, ConfigurationMap) and not (len(places) == 1 and places[0].is_plain):
        rooms = list_rooms(space, places)
        goals = find_room_goals(edges, rooms, name, near)
    else:
        options = {} if name == "goal" else {"name": name}
        goals = sort_goals(space, space.find_goals(place, near, task.seed, **options), near)
    return Stage(name, goals, rooms, list_all_rooms(space, places, goals))


def _choose_planner(task: PlanTask) -> PlannerName:
    """Choose the planner of a plan that names none.

    Raises InputError for a function, which no default planner minimises.
    """
    edges = task.edges
    objective = task.objective
    if callable(objective):
        raise InputError(
            "objective",
            "is a function and no planner is named",
            "the default planners take no function",
        )
    if not isinstance(edges.space, ConfigurationMap):
        searches = _list_searches(edges.space)
        return searches[0] if searches else task.planner
    search: PlannerName = GRID if edges.drive is None else LATTICE
    if objective != LENGTH:
        if task.iterations is not None:
            problem = f"is {task.iterations} and objective is {objective!r}"
            raise InputError("iterations", problem, f"{search}, its default planner, counts none")
        return search
    if task.iterations is not None or (edges.exact and isinstance(edges.drive, Differential)):
        return task.planner
    return search


class Journey(NamedTuple):
    """The search of a plan, up to a stage that is not reached."""

    task: PlanTask  # of the last part
    start: Endpoint
    result: SearchResult  # the whole path
    existence: Existence  # of a path through all stages of the plan
    number: int  # of the last stage
    vias: list[int]  # rows of the path at the places on the way


def _search_stages(task: PlanTask, stages: Sequence[Stage]) -> Journey:
    """Search for a path from stage to stage."""
    edges = task.edges
    origin, first, *rest = stages
    routes = _find_routes(edges, origin, first, is_first=True)
    existence = Existence(edges, stages, routes)
    if rest and isinstance(edges.space, ConfigurationMap) and len(routes) > 1:
        routes = existence.select_routes() or routes
    legs, searched = _find_legs(task, existence, routes)
    result, vias = _join_legs(legs, searched)
    limit = legs[-1].task.limit + (result.planning - legs[-1].result.planning)
    part = replace(legs[-1].task, limit=limit)
    path = legs[0].result.path
    start = tuple(path[0].tolist()) if len(path) else routes[0][0]
    number = len(legs)
    if not len(result.path) and existence.is_disconnected:
        # No path leads through the first so many stages.
        counts = range(2, len(stages))
        number = 1 + bisect_left(counts, True, key=lambda k: existence.upto(k).is_disconnected)
        if number > len(legs):
            part = replace(part, endpoints=(start, *stages[number].goals))
    return Journey(part, start, result, existence, number, vias)


class Leg(NamedTuple):
    """The search from a stage to the next."""

    task: PlanTask
    result: SearchResult
    others: list[Endpoints]  # routes to other goals


def _find_legs(
    task: PlanTask, existence: Existence, routes: Sequence[Endpoints]
) -> tuple[list[Leg], list[SearchResult]]:
    """Search from stage to stage, at first along routes; return the legs and all results.

    If an end leads no further, another one of its stage is tried, or of those before. While there
    are others, a search hurries; if all fail, the farthest one is repeated with the time left. The
    legs are all, or those up to the farthest stage that was not reached.
    """
    stages = existence.stages
    starts = stages[0].rooms
    # FREE cells tell at once that an end leads no further. Other searches take long to end, and
    # planners that optimise use all of their time.
    is_slow = task.edges.exact or task.edges.drive is not None
    is_slow &= not SKILLS.get(task.planner, Skills()).optimises
    legs: list[Leg] = []
    best: list[Leg] = []
    searched: list[SearchResult] = []
    tried: set[tuple[int, Endpoint]] = set()
    hurries = is_last_try = False
    while True:
        number = len(legs) + 1
        missing = len(stages) - number
        share = GOAL_SHARE / missing if hurries else 1.0 / missing
        limited = replace(task, limit=_measure_left(task, searched).share(share))
        leg = _search_leg(limited, stages, number, starts, routes)
        searched.append(leg.result)
        tip = [*legs, leg]
        if len(leg.result.path):
            if missing == 1:
                return tip, searched
            legs.append(leg)
            hurries |= is_slow and not is_last_try and bool(leg.others)
            end = tuple(leg.result.path[-1].tolist())
            if is_last_try or (number, end) not in tried:
                tried.add((number, end))
                origin = Stage.of(stages[number].name, [end])
                starts = origin.rooms
                routes = _find_routes(task.edges, origin, stages[number + 1])
                continue
        best = tip if is_last_try else max(best, tip, key=len)
        if is_last_try or not (existence.may_join and _measure_left(task, searched).is_left):
            return best, searched
        choice = _pop_choice(legs)
        if choice is not None:
            starts, routes = choice.task.starts, choice.others
        elif hurries:
            hurries, is_last_try = False, True
            *legs, leg = best
            starts, routes = leg.task.starts, leg.task.routes
        else:
            return best, searched


def _pop_choice(legs: list[Leg]) -> Leg | None:
    """Remove legs up to the last one with other routes, and return that."""
    while legs:
        leg = legs.pop()
        if leg.others:
            return leg
    return None


def _search_leg(
    task: PlanTask,
    stages: Sequence[Stage],
    number: int,
    starts: tuple[Room, ...],
    routes: Sequence[Endpoints],
) -> Leg:
    """Search for the best path along routes to a stage, whose end leads on to the next."""
    onward = stages[number + 1].goals if number + 1 < len(stages) else ()
    task = replace(
        task,
        endpoints=routes[0],
        routes=tuple(routes),
        starts=starts,
        rooms=stages[number].rooms,
    )
    result = _search_goals(task, onward)
    return Leg(task, result, _leave_out(routes, result.goal))


def _leave_out(routes: Sequence[Endpoints], goal: Endpoint) -> list[Endpoints]:
    """Return routes without a goal."""
    kept = ((start, *(q for q in goals if q != goal)) for start, *goals in routes)
    return [route for route in kept if len(route) > 1]


def _find_routes(
    edges: LocalPlanner, origin: Stage, stage: Stage, is_first: bool = False
) -> list[Endpoints]:
    """Return starts with their goals, the most promising first."""
    starts = origin.rooms
    is_map = isinstance(edges.space, ConfigurationMap)
    if is_map and not (len(starts) == 1 and starts[0].is_point):
        goals = stage.rooms or [Room(stage.name, np.array(q)) for q in stage.goals]
        return find_routes(edges, starts, goals, stage.name)
    if stage.rooms:
        (start,) = origin.goals
        # They were found from the first start.
        ends = stage.goals if is_first else stage.find_goals(edges, start)
        return [(start, goal) for goal in ends]
    routes = [(start, *sort_goals(edges.space, stage.goals, start)) for start in origin.goals]
    if len(routes) == 1:
        return routes
    return sorted(routes, key=lambda route: edges.min_length(*np.array(route[:2])))


def _join_legs(
    legs: Sequence[Leg], searched: Sequence[SearchResult]
) -> tuple[SearchResult, list[int]]:
    """Return the whole way with the times of all searches, and its rows at places on the way.

    If a place is not reached, it is the result of the last leg, without rows.
    """
    results = [leg.result for leg in legs]
    proven = all(each.proven for each in results)
    whole = replace(_sum_times(results[-1], searched), proven=proven)
    if len(legs) == 1 or not len(whole.path):
        return whole, []
    # Each path begins where the one before ends.
    paths = [results[0].path, *(each.path[1:] for each in results[1:])]
    ends = np.cumsum(list(map(len, paths))) - 1
    through = f"{len(legs) - 1} places" if len(legs) > 2 else "1 place"
    return replace(whole, path=np.concatenate(paths), note=f"through {through}"), ends[:-1].tolist()


def _search_goals(task: PlanTask, onward: Sequence[Endpoint] = ()) -> SearchResult:
    """Search for a path between the rooms of a task, and keep the cheapest of those found.

    Before goals to go onward to, the way that counts goes on to the nearest of them, without
    obstacles. Paths are searched along one route after another, unless its lower bound is no
    shorter than the best way. Each search but the last has half of the time left.
    """
    if len(task.routes) == 1 and not task.rooms and all(room.is_point for room in task.starts):
        return _search_route(task, task.routes[0], task.limit)
    results: list[SearchResult] = []
    best = RoutedPath(SearchResult(np.empty((0, task.edges.space.size))), math.inf, math.inf)
    for number, route in enumerate(task.routes):
        least = _bound_route(task.edges, route, onward)
        if best.result.proven and not _may_cost_less(task, route, least, best, onward):
            continue
        if not _measure_left(task, results).is_left:
            break
        is_last = number == len(task.routes) - 1
        found = _search_route(task, route, _limit_route(task, results, best.result, is_last))
        results.append(found)
        cost = _measure_way(task.edges, found.path, onward) if found.proven else math.inf
        if cost < best.cost or not (found.proven or len(best.result.path)):
            best = RoutedPath(found, cost, least)
    return _sum_times(best.result, results) if results else best.result


class RoutedPath(NamedTuple):
    """What the search along a route found, with its cost and a lower bound of all its paths."""

    result: SearchResult
    cost: float
    least: float


def _may_cost_less(
    task: PlanTask, route: Endpoints, least: float, best: RoutedPath, onward: Sequence[Endpoint]
) -> bool:
    """Return False if a route is not worth a search after the best way that was found."""
    bound = best.cost
    edges = task.edges
    # Lower bounds are lengths. They say little of ways that obstacles make much longer, and of
    # places with other costs.
    is_told = best.cost < MAX_DETOUR * best.least
    if edges.weights is not None:
        path = best.result.path
        is_told &= (1.0 - MAX_SAVING) * edges.path_cost(path) <= edges.path_length(path)
    is_holonomic = edges.drive is None
    if is_holonomic and is_told and not onward and _share_rooms(task, route, best.result.path):
        bound = min(bound, (1.0 - MAX_SAVING) * best.least)
    return least < bound


def _bound_route(edges: LocalPlanner, route: Endpoints, onward: Sequence[Endpoint]) -> float:
    """Return a lower bound of the ways along a route, and onward from its goals."""
    start, *goals = np.array(route)
    return min(
        edges.min_length(start, goal) + _measure_onward(edges, goal, onward) for goal in goals
    )


def _limit_route(
    task: PlanTask, results: Sequence[SearchResult], best: SearchResult, is_last: bool
) -> Effort:
    """Return the limit of the search of a route, after those before and the best of them."""
    limit = _measure_left(task, results)
    if not is_last:
        limit = limit.share(GOAL_SHARE)
    if best.proven and task.edges.drive is not None:
        work = max(FURTHER_FACTOR * best.planning.work, MIN_FURTHER.work)
        limit = limit.at_most(Effort(work, math.inf))
    return limit


def _search_route(task: PlanTask, route: Endpoints, limit: Effort) -> SearchResult:
    """Search along one route, and end a proven path where it first enters the rooms."""
    edges = task.edges
    existence = Existence.along(edges, route)
    found = _search_and_prove(replace(task, endpoints=route, limit=limit, existence=existence))
    if not len(found.path):
        return found
    reached = reached_goal(found.path, route, edges.space.is_periodic)
    found = replace(found, goal=route[max(reached, 1)])
    if not found.proven:
        return found
    path = end_in_rooms(edges, found.path, task.rooms)
    return replace(found, path=begin_in_rooms(edges, path, task.starts))


def _measure_way(edges: LocalPlanner, path: Floats, onward: Sequence[Endpoint]) -> float:
    """Return the cost of a path, and the length onward from its end."""
    return edges.path_cost(path) + _measure_onward(edges, path[-1], onward)


def _share_rooms(task: PlanTask, route: Endpoints, path: Floats) -> bool:
    """Return True if a route leads from and to the same rooms as a path."""
    space = task.edges.space
    ends = np.array([route[0], path[0]]), np.array([route[-1], path[-1]])
    return all(
        any(room.contains(space, rows).all() for room in rooms)
        for rooms, rows in zip((task.starts, task.rooms), ends, strict=True)
    )


def _measure_onward(edges: LocalPlanner, end: Floats, goals: Sequence[Endpoint]) -> float:
    """Return the length of the shortest edge from a configuration to goals; 0 without any."""
    rows = np.reshape(goals, (-1, len(end)))
    lengths = edges.edge_lengths(np.broadcast_to(end, rows.shape), rows)
    return float(lengths.min()) if len(rows) else 0.0


def _search_and_prove(task: PlanTask) -> SearchResult:
    """Search for a path and prove its edges; a map in tiles is searched tile by tile."""
    space = task.edges.space
    # A proven path saves labelling the cells of a map, so a search goes first then.
    if is_labelled(space) and not task.may_succeed():
        return SearchResult(np.empty((0, space.size)))
    if find_space_kind(space) == TILED_MAPS:
        return _search_tiles(task)
    result = _search(task)
    path = task.edges.insert_breakpoints(space.rotations.make_canonical(result.path))
    return replace(result, path=path, proven=len(path) > 0 and task.edges.are_free(path))


def _search_tiles(task: PlanTask) -> SearchResult:
    """Search the tiles on the way, and join their paths; a tile without one ends the search.

    Grid takes over in a tile where a planner of OMPL finds no path of a holonomic robot.
    """
    edges = task.edges
    is_holonomic = edges.drive is None
    parts = edges.tiles.subproblems(*task.endpoints[:2])
    paths: list[Floats] = []
    results: list[SearchResult] = []
    for open_part, *ends in parts:
        part = _weigh_edges(task, replace(edges, space=open_part()))
        start, goal = (tuple(q.tolist()) for q in ends)
        part_task = replace(task, edges=part, endpoints=(start, goal))
        results.append(_search_and_prove(part_task))
        if (
            not results[-1].proven
            and is_holonomic
            and task.planner not in _list_searches(part.space)
        ):
            results.append(_search_and_prove(replace(part_task, planner=GRID)))
        paths.append(results[-1].path if not paths else results[-1].path[1:])
        if len(parts) == 1:
            return _sum_times(results[-1], results)
        if not results[-1].proven:
            where = f" from {start} to {goal}"
            return replace(_sum_times(results[-1], results), where=where)
    began = now()
    path = np.concatenate(paths)
    if task.simplify and task.objective == LENGTH and is_holonomic:
        path = skip_points(path, edges.tiles.edge_checker())
    total = _sum_times(results[-1], results)
    seconds = total.simplification + (now() - began).seconds
    return SearchResult(path, f"through {len(parts)} tiles", total.planning, seconds, True)


def _sum_times(result: SearchResult, results: Sequence[SearchResult]) -> SearchResult:
    """Return a result with the times of several."""
    simplification = sum(each.simplification for each in results)
    return replace(result, planning=_sum_planning(results), simplification=simplification)


def _search(task: PlanTask) -> SearchResult:
    """Search for a path in a space in memory; of several, take the cheapest."""
    start, *goals = task.endpoints
    if start in goals:
        return SearchResult(np.array([start]), "the start is the goal")
    results: list[SearchResult] = []
    if len(task.previous):
        results.append(_follow_previous(task))
        if len(results[0].path):
            return results[0]
    if task.fallback == QUICK_PLANNER and task.edges.space.rotations.names:
        results.append(_search_quickly(task))
        if len(results[-1].path):
            task = replace(task, existence=None)  # a quick path saves labelling the cells
    limit = _measure_left(task, results)
    if task.edges.exact and task.fallback is not None:
        limit = limit.share(EXACT_SHARE)
    if limit.is_left:
        results.append(_run_planner(replace(task, limit=limit)))
    limit = _measure_left(task, results)
    is_found = any(len(result.path) for result in results)
    if task.fallback is not None and limit.is_left and not is_found and task.may_succeed():
        last_task = replace(task, planner=task.fallback, is_named=False, limit=limit)
        results.append(_run_planner(last_task))
    return _choose_cheapest(task, results)


def _search_quickly(task: PlanTask) -> SearchResult:
    """Search for a first path, a short one."""
    task = replace(
        task,
        edges=replace(task.edges, weights=None),
        planner=QUICK_PLANNER,
        is_named=False,
        iterations=QUICK_ITERATIONS,
        limit=task.limit.share(EXACT_SHARE),
        existence=None,
    )
    return _run_planner(task)


def _measure_left(task: PlanTask, results: Sequence[SearchResult]) -> Effort:
    """Return the effort left after some searches; none if the caller ended them."""
    if results and is_over(NEVER):
        return NO_EFFORT
    return task.limit - _sum_planning(results)


def _sum_planning(results: Sequence[SearchResult]) -> Effort:
    """Return the effort of several searches."""
    return sum((result.planning for result in results), NO_EFFORT)


def _run_planner(task: PlanTask) -> SearchResult:
    """Search by the planner of a task alone."""
    edges = task.edges
    name = task.planner
    if name not in _list_searches(edges.space):
        from planners._ompl_search import repeat_draws, run_ompl

        # Without a seed, the searches of a default plan draw the same numbers each time.
        is_default = task.seed is None and not task.is_named
        with repeat_draws() if is_default else nullcontext():
            return replace(run_ompl(task), planner=name)
    is_quick = name in (GRID, LATTICE)
    if (edges.exact or not is_quick) and not task.may_succeed():
        return SearchResult(np.empty((0, edges.space.size)), planner=name)
    if name == MAX_CLEARANCE:
        # A search from the start to itself fills the caches of the map, which the time limit leaves
        # out.
        start = task.endpoints[0]
        _find_path(replace(task, endpoints=(start, start), simplify=False))
    began = now()
    path, proof = _find_path(task)
    if len(path) > 2 and is_over(NEVER):
        path = path[:0]  # to prove and measure thousands of edges takes long
    planning = now() - began
    note = NO_SEARCH if len(path) == 2 and is_quick and edges.weights is None else ""
    return SearchResult(path, note, planning, lattice=proof, planner=name)


def _choose_cheapest(task: PlanTask, results: Sequence[SearchResult]) -> SearchResult:
    """Choose the cheapest path of several searches; its times are those of all."""

    def measure(result: SearchResult) -> tuple[float, bool]:
        """Return the cost of a path, and whether another planner than the task's found it."""
        return task.edges.path_cost(result.path), result.planner != task.planner

    found = [result for result in results if len(result.path)]
    best = min(found, key=measure, default=results[-1])
    note = best.note
    if found and best.planner != task.planner:
        worse = "a longer one" if task.edges.weights is None else "one that costs more"
        others = f"found {worse}" if len(found) > 1 else "found none"
        note = f"by {best.planner}, as {task.planner} {others}"
    lattice = "".join(result.lattice for result in results)
    return _sum_times(replace(best, note=note, lattice=lattice), results)


def _follow_previous(task: PlanTask) -> SearchResult:
    """Go along the previous plan; search only around the part that is blocked."""
    began = now()
    edges = task.edges
    start, goal = np.array(task.endpoints[:2])
    way = edges.insert_breakpoints(np.vstack([task.previous, goal]))
    blocked = np.flatnonzero(~edges.edges_are_free(way))
    tail = way[blocked[-1] + 1 :] if len(blocked) else way
    path = _join_way(edges, start, tail)
    if not len(path) and len(blocked):
        head = _join_way(edges, start, way[: blocked[0] + 1])
        # If no free edge leads to the way before, the detour begins at the start.
        head = head if len(head) else start[np.newaxis]
        detour = _find_detour(task, head[-1], way[blocked[0] : blocked[-1] + 2])
        path = np.concatenate([head, detour, tail]) if len(detour) else detour
    if len(path):
        path = drop_repeats(unwind(path, edges.space.is_periodic))
        if task.simplify:
            path = shorten(edges, path, began + task.limit)
    return SearchResult(path, "along the previous plan", now() - began)


def _find_detour(task: PlanTask, start: Floats, way: Floats) -> Floats:
    """Find a path from a configuration to the end of a blocked way; both have shape (n, size).

    A way past the middle of the blocked part is tried first. Otherwise there is a search, and no
    row if it takes too long.
    """
    edges = task.edges
    if isinstance(edges.space, ConfigurationMap) and edges.space.dim == 2:
        for beside in _list_ways_beside(edges, way):
            if edges.are_free(np.vstack([start, beside, way[-1]])):
                return beside
    gap_task = replace(
        task,
        endpoints=(tuple(start.tolist()), tuple(way[-1].tolist())),
        limit=task.limit_trial(),
        simplify=False,  # the whole path is shortened later
        existence=None,
    )
    return _run_planner(gap_task).path


def _list_ways_beside(edges: LocalPlanner, way: Floats) -> Iterator[Floats]:
    """Yield detours around the blocked part of a way in the plane, near ones first.

    Each has three rows, shape (3, size). It begins and ends on the way, as far from the blocked
    part as that is long.
    """
    rows = edges.split_path(way, 2.0 * edges.space.resolution, MAX_RADIANS).points
    blocked = np.flatnonzero(~np.asarray(edges.space.is_free(rows)))
    if len(blocked):
        first, last = blocked[[0, -1]].tolist()
        count = last - first + 1
        places = np.clip([first - count, (first + last) // 2, last + count], 0, len(rows) - 1)
        beside = rows[places]
        x, y = beside[2, :2] - beside[0, :2]
        middle = beside[1, :2].copy()
        for share in SHARES_BESIDE:
            beside[1, :2] = middle + share * np.array([-y, x])
            yield beside.copy()


def _join_way(edges: LocalPlanner, start: Floats, way: Floats) -> Floats:
    """Join a configuration to a free way, shape (n, size), by the free edge of the least total.

    Returns the path from the configuration to the end of the way, or no row if no edge is free.
    """
    costs = edges.edge_costs(way[:-1], way[1:])
    left = np.append(np.cumsum(costs[::-1])[::-1], 0.0)
    totals = edges.edge_costs(np.broadcast_to(start, way.shape), way) + left
    is_free = edges.edge_checker()
    for k in np.argsort(totals, kind="stable").tolist():
        if is_free(*start.tolist(), *way[k].tolist()):
            return np.vstack([start, way[k:]])
    return way[:0]


def _find_path(task: PlanTask) -> tuple[Floats, str]:
    """Find a path by a built-in search.

    Returns its waypoints, shape (n, size), and what a lattice proves, in words. If no path is
    found, n is 0.
    """
    edges = task.edges
    limit = task.limit
    if task.planner == LATTICE:
        from planners._lattice import find_lattice_path

        return find_lattice_path(edges, task.endpoints, task.simplify, limit, task.may_succeed)
    if isinstance(edges.space, ConfigurationMap):
        return _search_cells(task), ""
    options = SearchOptions(task.simplify, edges.exact, task.iterations, task.seed, limit)
    path = edges.space.search(task.planner, task.endpoints, options)
    if isinstance(edges.space, ConfigurationSpace):
        return path, ""
    path = check_found_path(edges.space, path)
    if len(path):
        _check_ends(task, path)
    return path, ""


def _check_ends(task: PlanTask, path: Floats) -> None:
    """Raise InputError unless a path of a space's own search leads from the start to a goal."""
    space = task.edges.space
    rows = space.rotations.make_canonical(path)
    if reached_goal(rows, task.endpoints, space.is_periodic):
        return
    first, last = map(tuple, rows[[0, -1]].tolist())
    start, *goals = map(str, task.endpoints)
    problem = f"returned a path from {first} to {last}"
    rule = f"a path leads from {start} to {' or '.join(goals[:3])}, or has no row"
    raise InputError("search", problem, rule)


def _search_cells(task: PlanTask) -> Floats:
    """Find a path by "Grid" or "MaxClearance", shape (n, size); n is 0 if none is found in time."""
    from planners._grid_search import find_cheap_path, find_exact_path, find_short_path

    edges = task.edges
    space = edges.cells
    endpoints = space.rotations.make_canonical(np.array(task.endpoints))
    options = task.simplify, task.limit
    until = now() + task.limit
    path = endpoints[:0]
    with suppress(TimeoutError):
        if task.planner == MAX_CLEARANCE:
            from planners._widest import find_widest_path

            path = find_widest_path(space, endpoints, *options)
        elif edges.weights is not None:
            path = find_cheap_path(edges, endpoints, *options)
        elif not edges.exact:
            path = find_short_path(space, endpoints, *options)
        # FREE cells are clear; if they give no path, the geometry may.
        if edges.exact and not len(path):
            path = find_exact_path(space, endpoints, task.simplify, until - now())
    return path


def _describe_outcome(
    task: PlanTask, result: SearchResult, existence: Existence
) -> tuple[str, str]:
    """Return a plan's status, and a hint if a search failed."""
    if len(result.path):
        return ": ".join(filter(None, ["path found", result.note])), ""
    if existence.is_disconnected:
        return "no path exists: proven", ""
    if is_over(NEVER):
        return f"no path found: stopped after {result.planning.seconds:.2g} s{result.where}", ""
    from planners._advice import describe_failure

    def finds_path(trial: PlanTask) -> bool:
        """Return True if a task with other options finds a path."""
        return _search_goals(_choose_searches(trial)).proven

    return describe_failure(task, result, existence.is_connected, finds_path)


def _make_plan(journey: Journey, space: Space, moved: Mapping[Endpoint, str], began: float) -> Plan:
    """Make the plan of a search, and measure its path.

    The plan has the living ``space``, of which the task may have a copy that keeps directions.
    ``moved`` says how far starts were moved, if they were; ``began`` is a reading of the clock,
    with compilations, before all checks.
    """
    task, start, result, existence, number, vias = journey
    stages = existence.stages
    searched = time.monotonic()
    status, hint = _describe_outcome(task, result, existence.upto(number + 1))
    if number + 1 < len(stages):
        status = f"{stages[number].name} is not reached: {status}"
    status = "; ".join(filter(None, [status, moved.get(start)]))
    edges = task.edges
    is_proven = isinstance(space, ConfigurationMap) and result.proven
    endpoints = (start, *task.endpoints[1:])
    if len(result.path) and task.rooms:
        endpoints = (start, tuple(result.path[-1].tolist()))
    waypoints = result.path
    reached = 0
    length = rotation = math.nan
    if len(waypoints):
        reached = reached_goal(waypoints, endpoints, edges.space.is_periodic)
        length, rotation = edges.measure(waypoints)
    path = edges.resample(waypoints)
    direction = edges.find_directions(path)
    length_unit = " or ".join(dict.fromkeys(edges.space.units[: edges.space.dim]))
    planning = result.planning.seconds + result.simplification
    setup = searched - began - planning
    return Plan(
        path=frozen(path),
        waypoints=frozen(waypoints),
        start=frozen(np.array(start)),
        goal=frozen(np.array(endpoints[max(reached, 1)])),
        axes=edges.space.axes,
        units=edges.space.units,
        length_unit=length_unit,
        direction=None if direction is None else frozen(direction),
        certified=reached > 0 and result.proven,
        status=status,
        hint=hint,
        length=length,
        total_rotation=rotation,
        is_connected=is_proven or existence.is_connected,
        is_disconnected=not is_proven and existence.is_disconnected,
        planner=task.planner,
        objective="custom" if callable(task.objective) else name_kind(task.objective),
        drive=edges.drive,
        exact=edges.exact,
        times=Times(setup, planning, time.monotonic() - searched),
        frame_id=edges.space.frame_id,
        keep=task.keep,
        space=space,
        via_rows=tuple(len(edges.resample(waypoints[: row + 1])) - 1 for row in vias),
        _vias=tuple(vias),
        _via_stops=tuple(
            row
            for row, stage in zip(vias, stages[1:], strict=False)
            if stage.asks_turn(edges, waypoints, row)
        ),
    )

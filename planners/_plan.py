"""plan: find a checked path from start to goal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from numbers import Number
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import Goal, Space
from cspace.errors import ConfigurationError, InputError, MissingPackageError
from cspace.inside import (
    NEVER,
    Drive,
    Effort,
    Endpoint,
    Floats,
    PlaceLike,
    check_count,
    frozen,
    gather_goals,
    is_over,
    list_alternatives,
    names_options,
)
from cspace.inside import Upright as Upright
from planners._catalogue import (
    PlannerName,
    Search,
    find_planner,
    list_searches,
    planner_named,
    planner_names,
)
from planners._edges.drives import DRIVES, has_drives, local_planner
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import check_space
from planners._goals import (
    MAX_TRIED_GOALS,
    Near,
    PlaceParts,
    Room,
    find_closest,
    find_room_goals,
    list_all_rooms,
    list_rooms,
    sort_goals,
    split_places,
)
from planners._journey import Journey, search_goals, search_stages
from planners._result import Plan, Times
from planners._route_search import weigh_edges
from planners._searches.objectives import FUNCTION, LENGTH, Objective, ObjectiveLike, read_objective
from planners._searches.paths import reached_goal
from planners._space_kinds import NEAR_START, check_support, is_tiled
from planners._stages import Existence, Stage
from planners._task import DEFAULT_SECONDS, Planner, PlanTask, SearchResult

if TYPE_CHECKING:
    from planners._motion.speed_limits import SpeedLike


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
    (('SORRTstar', 'Grid'), ())
    """
    check_space(space)
    planners = (*planner_names(), *list_searches(space))
    return Choices(planners, tuple(DRIVES) if has_drives(space) else ())


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
        region of positions, or ``(polygon, yaw)``; or a list of alternatives; the shortest path
        found takes one. A list of numbers is one configuration, a region and a number are one
        place, and every other list is of alternatives. A start Near one configuration moves only if
        the latter is not free.
    planner : str or Search, optional
        Name, in upper or lower case, of a planner of OMPL (:func:`planners.choices`) or of a
        built-in search: "Grid" and "Lattice" on maps, "BiRRT" for arms.
        :class:`planners.Search` is one with settings.
    time_limit : float, optional
        Seconds after which the search ends. Simplification then has another 0.1 s. Work that a map
        does once, and compiling, also by other threads of this process, come on top. The default is
        counted work, about a second for each part on an idle machine.
    seed : int, optional
        From 0 to 2^32 - 2. The same call with the same seed gives the same path, unless a time
        limit ends the search. Default planners need none.
    objective : {"length", "clearance", "time"}, WeightedLength, ClearanceObjective or callable
        Quantity to minimise. "clearance" is :class:`planners.ClearanceObjective` with its defaults,
        "time" the time of driving as fast as ``speed`` allows. A callable takes the space
        information and returns an ``ompl.base.OptimizationObjective``. The length counts a radian
        of rotation as half a metre, except along curves; so do the others, at the cost of a metre
        there.
    speed : number, SpeedZones, SlowNear, or a list of these, optional
        Largest speeds, for the objective "time": a number for all places, m/s, and
        limits of places. Trajectories get theirs by :meth:`planners.Plan.trajectory`.
    drive : Car or Differential, optional
        :class:`planners.Car` or :class:`planners.Differential`, for maps of (x, y, yaw): the motion
        along an edge, along which the edge is proven. Without a drive, the robot moves in any
        direction.
    via : sequence, optional
        Places on the way, in this order, each like the goal. Each part of the path is the best
        from the end of the part before, if that leads on. They share the time limit evenly at
        first; a part that fails may use all that is left.
    previous : Plan, optional
        The last plan for a space with these axes, in memory. The path joins it and follows it; only
        a blocked part is searched anew. If a start lies in a MIXED cell and the geometry proves it
        free, the plan is ``exact``. For another objective than the length, the last plan had the
        same objective; not for functions.
    stop : callable, optional
        Called without arguments every 5 ms or more, in this thread, until it returns True, which
        ends the search soon after: for a request to cancel, or a deadline of all work, such as
        ``lambda: time.monotonic() > end``. A map of ten million cells ends it within 50 ms, once a
        first plan has filled its caches. Only planners of OMPL return a path found before.
    keep : Upright or sequence of Upright, optional
        Directions that links of an arm keep along the whole path, with the same proof; for "BiRRT".

    Returns
    -------
    Plan
        Without a path, :attr:`Plan.status` gives the proofs, and :attr:`Plan.hint` advice.

    Raises
    ------
    ConfigurationError
        If start or goal is not proven free and upright, or the search for a pose finds no such
        configuration. The message and the error's ``nearest`` give the nearest FREE configuration.
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
    checked = read_objective(objective, speed, space)
    if name is None:
        chosen = _choose_planner(edges, checked, search.iterations)
    else:
        chosen = find_planner(planner_named(name, space.searches))
    task = PlanTask(
        edges=edges,
        planner=chosen,
        objective=checked,
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
    if time_limit is None:
        task = replace(task, limit=task.limit.share(len(places)))
    origin, moved = _check_start(task, origins)
    stages, texts = _check_stages(task, places, origin)
    task = replace(task, edges=weigh_edges(task, task.edges))
    if task.seed is not None:
        with suppress(ImportError):  # without OMPL, its draws need no seed
            from planners._ompl.search import set_seed

            set_seed(task.seed)
    with Effort.stopping(stop):
        journey = search_stages(task, stages)
        return _make_plan(journey, space, moved, texts, began)


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
    """Let a task follow the previous plan.

    If only the geometry proves the start, the plan becomes exact.
    """
    task = replace(task, previous=_check_previous(task, previous))
    edges = task.edges
    # A robot on its way cannot choose another start.
    if len(starts) == 1 and starts[0].is_one:
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
    """Return the checked waypoints of the previous plan, shape (n, size)."""
    space = task.edges.space
    if not isinstance(previous, Plan):
        raise InputError(
            "previous",
            f"is {previous!r}",
            "it is what planners.plan returned before",
        )
    if previous.axes != space.axes or is_tiled(space):
        raise InputError(
            "previous",
            f"has the axes ({', '.join(previous.axes)}) and space is {space!r}",
            "it is a plan for the axes of the space, which is in memory",
        )
    objective = task.objective
    if objective.kind == FUNCTION:
        raise InputError(
            "previous",
            f"is a plan, and the objective {objective.given!r}",
            "a path along a previous one is short, or cheap by the cost of cells",
        )
    if objective.kind not in (LENGTH, previous.objective):
        problem = f"is a plan by {previous.objective!r}, and the objective is {objective.kind!r}"
        raise InputError("previous", problem, "a path along a previous one is cheap as that was")
    return previous.waypoints


def _choose_searches(task: PlanTask) -> PlanTask:
    """Choose a planner, unless the user did, and a fallback; check options."""
    edges = task.edges
    space = edges.space
    if not task.is_named:
        planner = _choose_planner(edges, task.objective, task.iterations)
        task = replace(task, planner=planner)
    planner = task.planner
    if not planner.takes_space(space):
        raise InputError(
            "planner",
            f"is {planner.name!r} and space is {space!r}",
            f"its built-in searches are {', '.join(list_searches(space)) or 'none'}",
        )
    planner.check(task)
    planner.prepare(task)
    if planner.may_fail(edges) and not task.is_named:
        # The space may be too small for OMPL, or OMPL missing.
        with suppress(InputError, MissingPackageError):
            fallback = find_planner(edges.tree_planner)
            fallback.prepare(task)
            task = replace(task, fallback=fallback)
    return task


def _check_places(
    via: Sequence[PlaceLike], goal: PlaceLike, task: PlanTask
) -> list[tuple[str, PlaceLike]]:
    """List the places on the way and the goal, with their names."""
    is_table = not isinstance(via, list | tuple) and np.ndim(cast("ArrayLike", via)) == 2
    if is_table:
        via = list_alternatives(via, "via", task.edges.space.axes)
    is_list = isinstance(via, (tuple, list, np.ndarray))
    if not is_list or any(isinstance(place, Number) for place in via):
        rule = "it lists places on the way, each with coordinates of its own"
        raise InputError("via", f"is {via!r}", rule)
    if len(via) and len(task.previous):
        raise InputError(
            "via",
            f"has {len(via)} places, and previous is given",
            "a previous plan is followed to one goal",
        )
    return [*((f"via[{k}]", place) for k, place in enumerate(via)), ("goal", goal)]


def _drop_zeros(start: PlaceLike) -> PlaceLike:
    """Replace Near with zero distance and angle by its configuration."""
    if isinstance(start, Near) and not (start.distance or start.angle):
        return start.configuration
    return start


def _check_start(task: PlanTask, places: Sequence[PlaceParts]) -> tuple[Stage, dict[Endpoint, str]]:
    """Check the start; return also texts for moved configurations.

    Raises InputError or ConfigurationError if the start cannot be used.
    """
    edges = task.edges
    space = edges.space
    moved: dict[Endpoint, str] = {}

    def find_rooms(place: PlaceParts, name: str) -> list[Room]:
        """Return the room of a place, or the rooms of its configurations."""
        if isinstance(place.configuration, Goal):
            near = tuple(np.clip(0.0, *space.bounds).tolist())
            goals = space.find_goals(place.configuration, near, task.seed, name=name)
            return [Room(name, np.array(q)) for q in goals[:MAX_TRIED_GOALS]]
        if not place.is_one:
            return list(list_rooms(edges, [place]))
        q, text = _move_start(edges, place)
        moved[q] = text
        return [Room(name, np.array(q))]

    rooms = gather_goals("start", places, find_rooms)
    goals = [tuple(room.middle.tolist()) for room in rooms]
    whole = list_all_rooms(edges, places, list_rooms(edges, places), goals)
    return Stage("start", goals, tuple(rooms) if edges.has_cells else (), whole), moved


def _move_start(edges: LocalPlanner, place: PlaceParts) -> tuple[Endpoint, str]:
    """Check a configuration; return it, and a text if it was moved."""
    space = edges.space
    start = space.check_configuration(cast("ArrayLike", place.configuration), place.name)
    try:
        return space.check_endpoint(start, place.name), ""
    except ConfigurationError:
        if place.near is None:
            raise
    (room,) = list_rooms(edges, [place])
    moved = room.find_goals(edges, tuple(start.tolist()))[0]
    distance = float(space.distance(start, np.array(moved)))
    return moved, f"{place.name} moved by {distance:.3g} m to {moved}"


def _check_stages(
    task: PlanTask, places: Sequence[tuple[str, PlaceLike]], origin: Stage
) -> tuple[list[Stage], list[str]]:
    """Check places after the start; return the stages, and how far closest ends are from places.

    Raises InputError or ConfigurationError if a place is unusable.
    """
    edges = task.edges
    space = edges.space
    start = origin.goals[0]
    position, rotation = start[: space.dim], start[space.dim :]
    near = (*np.clip(position, *space.bounds).tolist(), *rotation)
    given = [split_places(space, place, name) for name, place in places]
    wholes = [origin.rooms, *(list_rooms(edges, parts) for parts in given)]
    stages = [origin]
    texts: list[str] = []
    for k, ((name, place), parts) in enumerate(zip(places, given, strict=True), 1):
        rooms = whole = wholes[k]
        chosen, told = find_closest(edges, name, parts, [*wholes[:k], *wholes[k + 1 :]])
        if chosen is not parts:
            texts += told
            rooms = wholes[k] = list_rooms(edges, chosen)
            place = [cast("PlaceLike", each.configuration) for each in chosen]
        if rooms and not (len(chosen) == 1 and chosen[0].is_plain):
            rooms, goals = find_room_goals(edges, rooms, name, near)
        else:
            rooms, options = (), {} if name == "goal" else {"name": name}
            goals = sort_goals(space, space.find_goals(place, near, task.seed, **options), near)
        stages.append(Stage(name, goals, rooms, list_all_rooms(edges, parts, whole, goals)))
    return stages, texts


def _choose_planner(edges: LocalPlanner, objective: Objective, iterations: int | None) -> Planner:
    """Choose the planner of a plan that names none.

    Raises InputError for a function, which no default planner minimises.
    """
    if objective.kind == FUNCTION:
        raise InputError(
            "objective",
            "is a function and no planner is named",
            "the default planners take no function",
        )
    planner = find_planner(edges.search)
    counts_none = iterations is not None and not planner.counts_iterations
    if objective.kind != LENGTH:
        if counts_none:
            problem = f"is {iterations} and objective is {objective.given!r}"
            rule = f"{planner.name}, its default planner, counts none"
            raise InputError("iterations", problem, rule)
        return planner
    return find_planner(edges.tree_planner if counts_none else edges.search_by_length)


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
        return search_goals(_choose_searches(trial)).proven

    return describe_failure(task, result, existence.is_connected, finds_path)


def _make_plan(
    journey: Journey,
    space: Space,
    moved: Mapping[Endpoint, str],
    texts: Sequence[str],
    began: float,
) -> Plan:
    """Make the plan of a search, and measure its path.

    The plan has the live ``space``; the task's may be a copy that keeps directions. ``moved`` has
    texts for moved starts, and ``texts`` are those of the closest goals; ``began`` is a reading of
    the clock, which includes compilations, before all checks.
    """
    task, start, result, existence, number, vias = journey
    stages = existence.stages
    searched = time.monotonic()
    status, hint = _describe_outcome(task, result, existence.upto(number + 1))
    if number + 1 < len(stages):
        status = f"{stages[number].name} is not reached: {status}"
    status = "; ".join(filter(None, [status, moved.get(start), *texts]))
    edges = task.edges
    is_proven = edges.has_cells and result.proven
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
        planner=cast(PlannerName, task.planner.name),
        objective=task.objective.name,
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

"""The searches from stage to stage of a plan, along the most promising routes."""

from __future__ import annotations

import heapq
import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cspace.inside import Effort, Endpoint, Floats, find_components
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._goals import (
    Room,
    begin_in_rooms,
    end_in_rooms,
    find_room_goals,
    find_routes,
    sort_goals,
)
from planners._route_search import measure_left, search_and_prove, sum_times
from planners._searches.paths import reached_goal
from planners._stages import Existence, Stage
from planners._task import PlanTask, SearchResult

MAX_SAVING: Final = 0.01
"""Share by which another path between the same two rooms must have a smaller lower bound for a
further search, because ends in rooms shorten paths, too."""

MAX_DETOUR: Final = 1.5
"""Largest ratio of a path's length to its lower bound at which bounds of other paths decide whether
to search."""

GOAL_SHARE: Final = 0.5
"""Share of the effort left for the search to one of several goals, except the last one."""

FURTHER_FACTOR: Final = 2.0
MIN_FURTHER: Final = Effort.from_seconds(0.05, math.inf)
"""Work of a further search to a room for a drive, relative to the best search, and its least value:
configurations of a room may be free, but out of the drive's reach."""


class Journey(NamedTuple):
    """The search of a plan, up to the first stage not reached."""

    task: PlanTask  # of the last part
    start: Endpoint
    result: SearchResult  # the whole path
    existence: Existence  # of a path through all stages of the plan
    number: int  # of the last stage
    vias: list[int]  # rows of the path at the places on the way


def search_stages(task: PlanTask, stages: Sequence[Stage]) -> Journey:
    """Search for a path from stage to stage."""
    existence = Existence(task.edges, stages)
    routes = _find_first_routes(existence)
    legs, searched = _find_legs(task, existence, routes)
    result, vias = _join_legs(legs, searched)
    limit = legs[-1].task.limit + (result.planning - legs[-1].result.planning)
    part = replace(legs[-1].task, limit=limit)
    path = legs[0].result.path
    start = tuple(path[0].tolist()) if len(path) else routes[0][0]
    number = len(legs)
    if not len(result.path) and existence.is_disconnected:
        # Find the least number of stages through which no path leads.
        counts = range(2, len(stages))
        number = 1 + bisect_left(counts, True, key=lambda k: existence.upto(k).is_disconnected)
        if number > len(legs):
            part = replace(part, endpoints=(start, *stages[number].goals))
    return Journey(part, start, result, existence, number, vias)


class SearchedLeg(NamedTuple):
    """The search from a stage to the next."""

    task: PlanTask
    result: SearchResult
    others: list[Endpoints]  # routes to other goals


def _find_legs(
    task: PlanTask, existence: Existence, routes: Sequence[Endpoints]
) -> tuple[list[SearchedLeg], list[SearchResult]]:
    """Search from stage to stage; return the legs and all results.

    ``routes`` lead from the first stage to the second. If no path leads on from an end, try another
    end of its stage, or of earlier stages. While other ends remain, a search hurries; if all fail,
    repeat the farthest leg with the time left. The legs are all, or end with the farthest stage not
    reached.
    """
    stages = existence.stages
    starts = stages[0].rooms
    # FREE cells show at once that no path leads on from an end. Other searches end late, and
    # planners that optimise use all of their time.
    is_slow = task.edges.exact or task.edges.has_heading
    is_slow &= not task.planner.optimises
    legs: list[SearchedLeg] = []
    best: list[SearchedLeg] = []
    searched: list[SearchResult] = []
    tried: set[tuple[int, Endpoint]] = set()
    hurries = is_last_try = False
    while True:
        number = len(legs) + 1
        missing = len(stages) - number
        share = 1.0 if is_last_try else (GOAL_SHARE if hurries else 1.0) / missing
        limited = replace(task, limit=measure_left(task, searched).share(share))
        leg = _search_leg(limited, stages, number, starts, routes)
        searched.append(leg.result)
        tip = [*legs, leg]
        if len(leg.result.path):
            if missing == 1:
                return tip, searched
            legs.append(leg)
            is_last_try = False
            hurries |= is_slow and bool(leg.others)
            end = tuple(leg.result.path[-1].tolist())
            if (number, end) not in tried:
                tried.add((number, end))
                starts = Stage.of(stages[number].name, [end]).rooms
                routes = _find_routes(task.edges, end, stages[number + 1])
                continue
        best = tip if is_last_try else max(best, tip, key=len)
        if is_last_try or not (existence.may_join and measure_left(task, searched).is_left):
            return best, searched
        choice = _pop_choice(legs)
        if choice is not None:
            starts, routes = choice.task.starts, choice.others
        elif share == 1.0:
            return best, searched
        else:
            is_last_try = True
            is_slow = hurries = False
            tried.clear()
            *legs, leg = best
            starts, routes = leg.task.starts, leg.task.routes


def _pop_choice(legs: list[SearchedLeg]) -> SearchedLeg | None:
    """Remove legs back to the last with other routes; return it."""
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
) -> SearchedLeg:
    """Search for the best path along routes to a stage.

    The length onward from its end to the next stage counts, too.
    """
    onward = stages[number + 1].goals if number + 1 < len(stages) else ()
    task = replace(
        task,
        endpoints=routes[0],
        routes=tuple(routes),
        starts=starts,
        rooms=stages[number].rooms,
    )
    result = search_goals(task, onward)
    return SearchedLeg(task, result, _leave_out(routes, result.goal))


def _leave_out(routes: Sequence[Endpoints], goal: Endpoint) -> list[Endpoints]:
    """Return routes without a goal."""
    kept = ((start, *(q for q in goals if q != goal)) for start, *goals in routes)
    return [route for route in kept if len(route) > 1]


def _find_routes(edges: LocalPlanner, start: Endpoint, stage: Stage) -> list[Endpoints]:
    """Find routes from a configuration to a stage, the most promising first."""
    if not stage.rooms:
        return [(start, *sort_goals(edges.space, stage.goals, start))]
    _, goals = find_room_goals(edges, stage.rooms, stage.name, start)
    return [(start, goal) for goal in goals]


def _find_first_routes(existence: Existence) -> list[Endpoints]:
    """Find routes between the first two stages, the most promising first."""
    edges = existence.edges
    origin, stage, *others = existence.stages
    is_wide = not all(room.is_point for room in origin.rooms)
    if len(origin.rooms) <= 1 and not is_wide:
        return _find_routes_from_points(edges, origin, stage)
    if not others and not (is_wide and stage.rooms):
        return find_routes(edges, origin.rooms, stage.choices)
    joined = existence.find_joined()
    routes = find_routes(edges, origin.rooms, stage.choices, joined)
    begins = np.array([route[0] for route in routes])
    labels = find_components(edges.cells, begins, edges.exact)
    kept = [route for route, label in zip(routes, labels, strict=True) if label in joined]
    return kept or routes


def _find_routes_from_points(edges: LocalPlanner, origin: Stage, stage: Stage) -> list[Endpoints]:
    """Find routes from one configuration of a map, or from several of another space."""
    if stage.rooms:  # the goals were found from this start
        return [(*origin.goals, goal) for goal in stage.goals]
    routes = [_find_routes(edges, q, stage)[0] for q in origin.goals]
    return sorted(routes, key=lambda route: edges.min_length(*np.array(route[:2])))


def _join_legs(
    legs: Sequence[SearchedLeg], searched: Sequence[SearchResult]
) -> tuple[SearchResult, list[int]]:
    """Join the legs' paths; return also the rows at places.

    The result has the times of all searches. If a place is not reached, return the last leg's
    result, without rows.
    """
    results = [leg.result for leg in legs]
    proven = all(each.proven for each in results)
    whole = replace(sum_times(results[-1], searched), proven=proven)
    if len(legs) == 1 or not len(whole.path):
        return whole, []
    # Each path begins at the end of its predecessor.
    paths = [results[0].path, *(each.path[1:] for each in results[1:])]
    ends = np.cumsum(list(map(len, paths))) - 1
    through = f"{len(legs) - 1} places" if len(legs) > 2 else "1 place"
    return replace(whole, path=np.concatenate(paths), note=f"through {through}"), ends[:-1].tolist()


def search_goals(task: PlanTask, onward: Sequence[Endpoint] = ()) -> SearchResult:
    """Search for the cheapest path between the rooms of a task.

    If the plan goes ``onward``, the straight way from the path's end to the nearest of these goals
    counts, too. Search along one route after another, those between points by their lower bounds,
    except routes with a lower bound not below the best cost. Each search but the last has half of
    the time left.
    """
    if len(task.routes) == 1 and not task.rooms and all(room.is_point for room in task.starts):
        return _search_route(task, task.routes[0], task.limit)
    edges = task.edges
    results: list[SearchResult] = []
    best = RoutedPath(SearchResult(np.empty((0, edges.space.size))), math.inf, math.inf)
    waiting = _list_routes(task, onward)
    while measure_left(task, results).is_left:
        chosen = _take_route(task, onward, waiting, best)
        if chosen is None:
            break
        route, least = chosen
        found = _search_route(task, route, _limit_route(task, results, best.result, not waiting))
        results.append(found)
        cost = _measure_way(edges, found.path, onward) if found.proven else math.inf
        if cost < best.cost or not (found.proven or len(best.result.path)):
            best = RoutedPath(found, cost, least)
    return sum_times(best.result, results) if results else best.result


def _take_route(
    task: PlanTask,
    onward: Sequence[Endpoint],
    waiting: list[tuple[float, int, float | None]],
    best: RoutedPath,
) -> tuple[Endpoints, float] | None:
    """Take the next route that may cost less than the best path, and its lower bound."""
    while waiting:
        key, number, least = heapq.heappop(waiting)
        route = task.routes[number]
        if least is not None:
            if not best.result.proven or _may_cost_less(task, route, least, best, onward):
                return route, least
        elif key < best.cost:
            bound = _bound_route(task.edges, route, onward)
            heapq.heappush(waiting, (bound, number, bound))
    return None


def _list_routes(
    task: PlanTask, onward: Sequence[Endpoint]
) -> list[tuple[float, int, float | None]]:
    """List a heap of routes by their order, with their numbers and lower bounds of their costs.

    A bound takes a search of its own, so between points it is left out at first, and the order is
    that of straight lengths.
    """
    edges = task.edges
    rooms = (*task.starts, *task.rooms)
    if not (onward or edges.has_heading) and all(room.is_point for room in rooms):
        straight = [_measure_onward(edges, np.array(start), goals) for start, *goals in task.routes]
        return sorted((key, number, None) for number, key in enumerate(straight))
    bounds = [_bound_route(edges, route, onward) for route in task.routes]
    is_ordered = len(task.starts) <= 1 and all(room.is_point for room in task.starts)
    if is_ordered and len(task.rooms) <= 1:
        return [(number, number, bound) for number, bound in enumerate(bounds)]
    curves = [_bound_curve(edges, route) for route in task.routes]
    keys = map(max, bounds, curves)
    return sorted(zip(keys, range(len(bounds)), bounds, strict=True))


class RoutedPath(NamedTuple):
    """Result of a search along a route, its cost, and a lower bound of all costs."""

    result: SearchResult
    cost: float
    least: float


def _may_cost_less(
    task: PlanTask, route: Endpoints, least: float, best: RoutedPath, onward: Sequence[Endpoint]
) -> bool:
    """Return False if a route cannot improve the best path enough."""
    edges = task.edges
    if least >= best.cost or onward or least < (1.0 - MAX_SAVING) * best.least:
        return least < best.cost
    # Lower bounds are lengths. They say little about ways that obstacles make much longer, and
    # about places with other costs.
    is_told = best.cost < MAX_DETOUR * best.least
    if edges.has_costs:
        path = best.result.path
        is_told &= (1.0 - MAX_SAVING) * edges.path_cost(path) <= edges.path_length(path)
    # Ways of cars differ by more than their bounds do.
    is_told &= edges.turns_on_spot or not edges.has_heading
    return not (is_told and _joins_same_rooms(task, route, best.result.path))


def _bound_route(edges: LocalPlanner, route: Endpoints, onward: Sequence[Endpoint]) -> float:
    """Bound the length along a route and onward from below."""
    start, *goals = np.array(route)
    return min(
        edges.min_length(start, goal) + _measure_onward(edges, goal, onward) for goal in goals
    )


def _bound_curve(edges: LocalPlanner, route: Endpoints) -> float:
    """Bound the length along a drive's curves from below, without obstacles."""
    start, goal = np.array(route)[:, np.newaxis]
    return float(edges.curve_lengths(start, goal)[0])


def _limit_route(
    task: PlanTask, results: Sequence[SearchResult], best: SearchResult, is_last: bool
) -> Effort:
    """Return the limit of the search along a route.

    It depends on earlier results and the best of these.
    """
    limit = measure_left(task, results)
    if not is_last:
        limit = limit.share(GOAL_SHARE)
    if best.proven and task.edges.has_heading:
        work = max(FURTHER_FACTOR * best.planning.work, MIN_FURTHER.work)
        limit = limit.at_most(Effort(work, math.inf))
    return limit


def _search_route(task: PlanTask, route: Endpoints, limit: Effort) -> SearchResult:
    """Search along a route; cut a proven path at its rooms."""
    edges = task.edges
    existence = Existence.along(edges, route)
    found = search_and_prove(replace(task, endpoints=route, limit=limit, existence=existence))
    if not len(found.path):
        return found
    reached = reached_goal(found.path, route, edges.space.is_periodic)
    found = replace(found, goal=route[max(reached, 1)])
    if not found.proven:
        return found
    path = end_in_rooms(edges, found.path, task.rooms)
    return replace(found, path=begin_in_rooms(edges, path, task.starts))


def _measure_way(edges: LocalPlanner, path: Floats, onward: Sequence[Endpoint]) -> float:
    """Return a path's cost plus the length onward."""
    return edges.path_cost(path) + _measure_onward(edges, path[-1], onward)


def _joins_same_rooms(task: PlanTask, route: Endpoints, path: Floats) -> bool:
    """Return True if a route and a path join the same rooms."""
    space = task.edges.space
    ends = np.array([route[0], path[0]]), np.array([route[-1], path[-1]])
    return all(
        any(room.contains(space, rows).all() for room in rooms)
        for rooms, rows in zip((task.starts, task.rooms), ends, strict=True)
    )


def _measure_onward(edges: LocalPlanner, end: Floats, goals: Sequence[Endpoint]) -> float:
    """Return the shortest edge's length to goals; 0 without goals."""
    rows = np.reshape(goals, (-1, len(end)))
    lengths = edges.edge_lengths(np.broadcast_to(end, rows.shape), rows)
    return float(lengths.min()) if len(rows) else 0.0

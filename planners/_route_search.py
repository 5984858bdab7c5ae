"""The search along one route, by a planner, its fallback and tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cspace.inside import (
    NEVER,
    Effort,
    Floats,
    is_labelled,
    is_over,
    now,
)
from planners._catalogue import find_planner, list_searches
from planners._edges.local_planner import LocalPlanner
from planners._replanning import follow_previous
from planners._searches.objectives import LENGTH
from planners._searches.paths import skip_points
from planners._space_kinds import is_tiled
from planners._task import NO_EFFORT, Planner, PlanTask, SearchResult

EXACT_SHARE: Final = 0.5
"""Share of the effort left for the quick search, and then for the built-in one, if geometry decides
MIXED cells: a search through many such cells may not end."""


def search_and_prove(task: PlanTask) -> SearchResult:
    """Search for a path, and prove its edges.

    A map in tiles is searched tile by tile.
    """
    space = task.edges.space
    # A proven path saves labelling the cells of a map, so an unlabelled map is searched first.
    if is_labelled(space) and not task.may_succeed():
        return SearchResult(np.empty((0, space.size)))
    if is_tiled(space):
        return _search_tiles(task)
    result = _search(task)
    path = task.edges.insert_breakpoints(space.rotations.make_canonical(result.path))
    return replace(result, path=path, proven=len(path) > 0 and task.edges.are_free(path))


def _search_tiles(task: PlanTask) -> SearchResult:
    """Search the tiles on the way, and join their paths.

    A tile without a path ends the search. Grid searches a tile again if a planner of OMPL finds no
    path of a holonomic robot there.
    """
    edges = task.edges
    is_holonomic = not edges.has_heading
    parts = edges.tiles.subproblems(*task.endpoints[:2])
    paths: list[Floats] = []
    results: list[SearchResult] = []
    for open_part, *ends in parts:
        part = weigh_edges(task, replace(edges, space=open_part()))
        start, goal = (tuple(q.tolist()) for q in ends)
        part_task = replace(task, edges=part, endpoints=(start, goal))
        results.append(search_and_prove(part_task))
        if (
            not results[-1].proven
            and is_holonomic
            and task.planner.name not in list_searches(part.space)
        ):
            grid = find_planner("Grid")
            results.append(search_and_prove(replace(part_task, planner=grid)))
        paths.append(results[-1].path if not paths else results[-1].path[1:])
        if len(parts) == 1:
            return sum_times(results[-1], results)
        if not results[-1].proven:
            where = f" from {start} to {goal}"
            return replace(sum_times(results[-1], results), where=where)
    began = now()
    path = np.concatenate(paths)
    if task.simplify and task.objective.kind == LENGTH and is_holonomic:
        path = skip_points(path, edges.space.edge_checker())
    total = sum_times(results[-1], results)
    seconds = total.simplification + (now() - began).seconds
    return SearchResult(path, f"through {len(parts)} tiles", total.planning, seconds, True)


def sum_times(result: SearchResult, results: Sequence[SearchResult]) -> SearchResult:
    """Return a result with the times of all results."""
    simplification = sum(each.simplification for each in results)
    return replace(result, planning=_sum_planning(results), simplification=simplification)


def _search(task: PlanTask) -> SearchResult:
    """Find the cheapest path of several searches in memory."""
    start, *goals = task.endpoints
    if start in goals:
        return SearchResult(np.array([start]), "the start is the goal")
    results: list[SearchResult] = []
    if len(task.previous):
        results.append(follow_previous(task))
        if len(results[0].path):
            return results[0]
    if task.fallback is not None and task.edges.tries_trees:
        results.append(_search_quickly(task, task.fallback))
        if len(results[-1].path):
            task = replace(task, existence=None)  # a quick path saves labelling the cells
    limit = measure_left(task, results)
    if task.edges.exact and task.fallback is not None:
        limit = limit.share(EXACT_SHARE)
    if limit.is_left:
        results.append(_run_planner(replace(task, limit=limit)))
    if task.fallback is not None and not any(len(result.path) for result in results):
        limit = measure_left(task, results)
        if limit.is_left and task.may_succeed():
            last_task = replace(task, planner=task.fallback, is_named=False, limit=limit)
            results.append(_run_planner(last_task))
    return _choose_cheapest(task, results)


def _search_quickly(task: PlanTask, planner: Planner) -> SearchResult:
    """Search for a first path, in about 10 ms."""
    task = replace(
        task,
        edges=replace(task.edges, weights=None),
        planner=planner,
        is_named=False,
        iterations=500,
        limit=task.limit.share(EXACT_SHARE),
        existence=None,
    )
    return _run_planner(task)


def measure_left(task: PlanTask, results: Sequence[SearchResult]) -> Effort:
    """Return the effort left after searches, unless the caller ended them."""
    if results and is_over(NEVER):
        return NO_EFFORT
    return task.limit - _sum_planning(results)


def _sum_planning(results: Sequence[SearchResult]) -> Effort:
    """Return the sum of the efforts of searches."""
    return sum((result.planning for result in results), NO_EFFORT)


def _run_planner(task: PlanTask) -> SearchResult:
    """Search by the planner of a task alone."""
    return replace(task.planner.find(task), found_by=task.planner.name)


def _choose_cheapest(task: PlanTask, results: Sequence[SearchResult]) -> SearchResult:
    """Choose the cheapest path, with the times of all searches."""

    def measure(result: SearchResult) -> tuple[float, bool]:
        """Return the cost of a path, then whether another planner found it."""
        return task.edges.path_cost(result.path), result.found_by != task.planner.name

    results = results or [SearchResult(np.empty((0, task.edges.space.size)))]  # no time was left
    found = [result for result in results if len(result.path)]
    best = min(found, key=measure, default=results[-1])
    note = best.note
    if found and best.found_by != task.planner.name:
        worse = "one that costs more" if task.edges.has_costs else "a longer one"
        others = f"found {worse}" if len(found) > 1 else "found none"
        note = f"by {best.found_by}, as {task.planner.name} {others}"
    lattice = "".join(result.lattice for result in results)
    return sum_times(replace(best, note=note, lattice=lattice), results)


def weigh_edges(task: PlanTask, edges: LocalPlanner) -> LocalPlanner:
    """Return edges with a task's costs, except on a tiled map."""
    if is_tiled(edges.space):
        return edges
    weights = task.objective.weigh(edges.cells)
    return edges if weights is None else replace(edges, weights=weights)

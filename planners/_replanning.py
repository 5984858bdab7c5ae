"""Paths along a previous plan, with detours around blocked parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cspace.inside import Floats, now
from planners._edges.local_planner import MAX_RADIANS, LocalPlanner
from planners._searches.paths import drop_repeats, unwind
from planners._searches.shortening import shorten
from planners._task import PlanTask, SearchResult


def follow_previous(task: PlanTask) -> SearchResult:
    """Follow the previous plan, with a detour around its blocked part."""
    began = now()
    edges = task.edges
    start, goal = np.array(task.endpoints[:2])
    way = edges.insert_breakpoints(np.vstack([task.previous, goal]))
    blocked = np.flatnonzero(~edges.edges_are_free(way))
    tail = way[blocked[-1] + 1 :] if len(blocked) else way
    path = _join_way(edges, start, tail)
    if not len(path) and len(blocked):
        head = _join_way(edges, start, way[: blocked[0] + 1])
        # If no free edge leads to the way before the block, the detour begins at the start.
        head = head if len(head) else start[np.newaxis]
        detour = _find_detour(task, head[-1], way[blocked[0] : blocked[-1] + 2])
        path = np.concatenate([head, detour, tail]) if len(detour) else detour
    if len(path):
        path = drop_repeats(unwind(path, edges.space.is_periodic))
        if task.simplify:
            path = shorten(edges, path, began + task.limit)
    return SearchResult(path, "along the previous plan", now() - began)


def _find_detour(task: PlanTask, start: Floats, way: Floats) -> Floats:
    """Find a path to a blocked way's end, shape (n, size).

    The way has shape (n, size), too. Try detours past the middle of the blocked part first, then
    search. The path has no row if the search takes too long.
    """
    edges = task.edges
    if edges.has_cells and edges.space.dim == 2:
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
    return gap_task.planner.find(gap_task).path


def _list_ways_beside(edges: LocalPlanner, way: Floats) -> Iterator[Floats]:
    """Yield detours around the blocked part of a way, near ones first.

    Each has three rows, shape (3, size). It begins and ends on the way, at a distance from the
    blocked part that equals the part's length.
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
        # Half the length of the way at most, to the left and to the right.
        for share in [sign * step / 64 for step in range(1, 33) for sign in (1.0, -1.0)]:
            beside[1, :2] = middle + share * np.array([-y, x])
            yield beside.copy()


def _join_way(edges: LocalPlanner, start: Floats, way: Floats) -> Floats:
    """Join a configuration to a free way by the cheapest free edge.

    The way has shape (n, size), and the total cost counts. Return the path from the configuration
    to the end of the way, or no row if no edge is free.
    """
    costs = edges.edge_costs(way[:-1], way[1:])
    left = np.append(np.cumsum(costs[::-1])[::-1], 0.0)
    totals = edges.edge_costs(np.broadcast_to(start, way.shape), way) + left
    is_free = edges.edge_checker()
    for k in np.argsort(totals, kind="stable").tolist():
        if is_free(*start.tolist(), *way[k].tolist()):
            return np.vstack([start, way[k:]])
    return way[:0]

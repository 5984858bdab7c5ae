"""Reasons and hints of plans without a path."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import cast

import numpy as np

from cspace import Space
from cspace.errors import InputError
from planners._catalogue import PlannerName, Search
from planners._edges.drives import local_planner
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._searches.objectives import FUNCTION, LENGTH
from planners._task import DEFAULT_SECONDS, PlanTask, SearchResult


def describe_failure(
    task: PlanTask,
    result: SearchResult,
    is_connected: bool,
    finds_path: Callable[[PlanTask], bool],
) -> tuple[str, str]:
    """Describe a failed search; return a status and a hint.

    ``is_connected`` is True if a holonomic robot has a path; ``finds_path`` tests other options.
    """
    edges = task.edges
    existence = "a path exists" if is_connected else "undecided whether one exists"
    limits: list[str] = []
    if edges.has_heading:
        limits = _describe_free_yaws(edges, task.endpoints)
        if is_connected:
            existence = "one exists for a robot that also moves sideways"
    left = task.limit.share(0.95) - result.planning
    is_late = not left.is_left
    *hints, last_hint = _list_hints(task, is_connected, is_late, finds_path)
    hint = ", or ".join(filter(None, [", ".join(hints), last_hint]))
    if not (edges.exact or is_connected):
        return f"no chain of FREE cells joins start and goal; {existence}", hint
    reason = result.note or "the planner gave up"
    failure = f"no path found: {reason} after {result.planning.seconds:.2g} s{result.where}"
    if is_late:
        failure = f"no path found within {_describe_limit(task)}{result.where}"
    return "; ".join(filter(None, [failure, result.lattice, existence, *limits])), hint


def _describe_limit(task: PlanTask) -> str:
    """Describe a search's limit: seconds if given, otherwise work."""
    if task.time_limit is None:
        return f"{task.limit.work_seconds:.3g} s of work"
    return f"{task.limit.seconds:.3g} s"


def _list_hints(
    task: PlanTask, is_connected: bool, is_late: bool, finds_path: Callable[[PlanTask], bool]
) -> list[str]:
    """List hints for a search, which timed out if ``is_late``."""
    edges = task.edges
    more = _name_more(task, is_late)
    if not edges.has_cells:
        return [more, "another seed", "a larger tolerance" if task.keep else "another planner"]
    if is_connected and not edges.has_heading:
        if task.planner.name == edges.search or task.objective.kind == FUNCTION:
            return [more]
        return [f"planner={edges.search!r}, which finds one", more]
    if options := _try_options(task, is_connected, finds_path):
        return [f"{options}, which finds a path"]
    if not is_connected:
        return _list_undecided_hints(task, more)
    hints = _list_drive_hints(task)
    # More time does not help Lattice if its search ended before.
    if is_late or task.planner.name != edges.search or task.fallback is not None:
        return [more, *hints]
    return hints


def _name_more(task: PlanTask, is_late: bool) -> str:
    """Name more time, or more iterations if they ended the search."""
    if task.iterations is not None and not is_late:
        name = cast(PlannerName, task.planner.name) if task.is_named else None
        search = Search(name, 10 * task.iterations, task.simplify, task.range)
        return f"more iterations by planner=planners.{search}"
    seconds = task.time_limit or max(DEFAULT_SECONDS, task.limit.work_seconds)
    return f"more time (time_limit={10.0 * seconds:.3g})"


def _list_drive_hints(task: PlanTask) -> list[str]:
    """List hints, except more time, for a drive that is not holonomic."""
    hints = [_name_finer(task.edges.space), *_list_exact_hints(task)]
    hints += task.edges.hints
    if task.is_named:
        hints.append("the default planner")
    return hints


def _list_undecided_hints(task: PlanTask, more: str) -> list[str]:
    """List hints if the map is undecided; ``more`` extends the search."""
    edges = task.edges
    # An explanation takes longer than a failed plan on large maps, so the hint repeats none of it.
    is_explained = edges.in_memory and len(edges.space.rotations.names) < 2
    change = "what plan.explain() names" if is_explained else _name_finer(edges.space)
    if edges.exact:
        return [change, more]
    hints = [*_list_exact_hints(task), change]
    if edges.cells.outside == "free":  # a path may lead around all obstacles
        hints.insert(0, "a workspace with wider bounds")
    return hints


def _name_finer(space: Space) -> str:
    """Name finer cells of a map."""
    return "a finer spacing" + (" or more rotations" if space.rotations.names else "")


def _try_options(task: PlanTask, is_connected: bool, finds_path: Callable[[PlanTask], bool]) -> str:
    """Return options with which a short search finds a path.

    The text is empty if there are none.
    """
    for trial, hint in _list_trials(task, is_connected):
        with suppress(InputError):  # options may not go together
            if finds_path(trial):
                return hint
    return ""


def _list_trials(task: PlanTask, is_connected: bool) -> Iterator[tuple[PlanTask, str]]:
    """Yield short searches with other options, and hints for these."""
    edges = task.edges
    space = edges.space
    # No drive has a path through FREE cells that do not join the ends.
    spaces = [space] if edges.exact or is_connected else []
    if edges.cells.tries_exact:
        spaces.append(space.exact)
    drives = edges.list_drives() if edges.in_memory else ()
    for other_space, drive in itertools.product(dict.fromkeys(spaces), drives):
        other = replace(local_planner(other_space, drive), weights=edges.weights)
        changes = [] if other_space is space else ["space.exact"]
        if drive != edges.drive:
            changes.append(f"drive=planners.{drive}")
        if not changes:
            continue
        trial = replace(
            task,
            edges=other,
            fallback=None,
            limit=task.limit_trial(),
            simplify=False,
            previous=task.previous[:0],
        )
        if task.is_named:
            yield trial, " with ".join(changes)
            changes.append("the default planner")
        yield replace(trial, is_named=False), " with ".join(changes)


def _list_exact_hints(task: PlanTask) -> list[str]:
    """List the hint to use the geometry, if it was not tried."""
    edges = task.edges
    if edges.exact or edges.cells.tries_exact or task.objective.kind != LENGTH:
        return []
    hint = "space.exact"
    if task.is_named:
        hint += " with the default planner"
    if not edges.in_memory:
        hint += " on space.window(lower, upper)"
    return [hint]


def _describe_free_yaws(edges: LocalPlanner, endpoints: Endpoints) -> list[str]:
    """Name the yaws proven free at start and goal.

    The robot reaches these on the spot through FREE cells. If it reaches all yaws, the list is
    empty.
    """
    limits = []
    for name, (x, y, yaw) in zip(("start", "goal"), endpoints[:2], strict=True):
        intervals = edges.cells.free_yaws((x, y))
        widths = np.ptp(intervals, axis=1)
        beyond_lower = (yaw - intervals[:, 0]) % math.tau
        around_yaw = np.flatnonzero(beyond_lower <= widths)
        if not len(around_yaw) or widths[around_yaw[0]] >= math.tau:
            continue
        low = yaw - beyond_lower[around_yaw[0]]
        high = low + widths[around_yaw[0]]
        # Bounds are rounded inwards, to milliradians.
        interval = f"{math.ceil(1e3 * low) / 1e3:g} to {math.floor(1e3 * high) / 1e3:g} rad"
        limit = f"at the {name} only yaws {interval} are proven free"
        if edges.turns_on_spot:
            limit += ", too few to turn around"
        limits.append(limit)
    return limits

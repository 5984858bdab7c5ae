"""Plans on maps that stay in their store: from tile to tile, of which only those on the way are opened."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final, TypedDict, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import ConfigurationError, InputError
from cspace.grid import finite
from cspace.space import CSpace
from cspace.tiles.space import TiledCSpace
from planners.catalogue import CUBES, planner_named
from planners.local_planner import HOLONOMIC, StraightEdges
from planners.result import Plan, Times
from planners.states import Floats

AHEAD: Final = 32
"""Waypoints that a shorter way may pass by at once."""

Leg = Callable[..., Plan]
"""What plans on a map in memory: :func:`planners.plan`."""


class Options(TypedDict):
    """What holds for the plan in each tile."""

    planner: str | None
    time_limit: float
    simplify: bool
    seed: int | None


def plan_in_tiles(
    space: TiledCSpace,
    start: ArrayLike,
    goal: ArrayLike,
    leg: Leg,
    **options: Unpack[Options],
) -> Plan:
    """A path on a stored map: see :func:`planners.plan`.

    The components of the map's tiles give a chain of tiles; where it crosses from one into the next, the path goes
    through a cell of their common face, in the middle of FREE ones. In each tile a planner joins the two cells where it
    is entered and left, or, where it finds no way in its time, the map's own search. What is left out of the path
    because its neighbours can be joined straight, and then every edge, is proven on the stored map.
    """
    began, name, simplify = time.perf_counter(), planner_named(options["planner"]), options["simplify"]
    ends = [_endpoint(space, q, which, leg) for q, which in ((start, "start"), (goal, "goal"))]
    exists = space.path_exists(*ends)
    chain = space.chain(*ends) if exists else []
    set_up = time.perf_counter()
    path, planning, simplification = np.array(ends[:1]), 0.0, 0.0
    status, advice = ("path found", "") if exists else ("no path exists: proven", "")
    if exists is None:
        status, advice = "undecided whether a path exists", "a finer spacing" + " or more rotations" * (space.dof > 2)
    for window, first, last in chain:
        found = leg(window(), first, last, **options)
        if not found.solved and name != CUBES and not space.rotations.steps(first, last)[space.grid.dim :].any():
            found = leg(window(), first, last, planner=CUBES, simplify=simplify)
        planning += found.times.planning
        simplification += found.times.simplification
        if not found.solved:
            status = f"{found.status}, in the tile from ({', '.join(f'{x:g}' for x in first[: space.grid.dim])}) m"
            advice, chain = found.advice, []
            break
        path = np.concatenate([path, found.waypoints])
    solved, edges = bool(chain), StraightEdges(cast(CSpace, space))
    if solved:
        shortened = time.perf_counter()
        path = np.concatenate([path[:1], path[1:][np.any(path[1:] != path[:-1], axis=1)]])
        path = _shortened(space, path) if simplify else path
        simplification += time.perf_counter() - shortened
    searched = time.perf_counter()
    path = path if solved else np.empty((0, space.dof))
    dense, _ = edges.dense(path)
    for array in (dense, path):
        array.flags.writeable = False
    certified = solved and bool(space.certify_path(path).all()) and bool(np.all(space.is_free(path)))
    return Plan(
        path=dense,
        waypoints=path,
        axes=space.axes,
        direction=None,
        solved=solved,
        certified=certified,
        status=status,
        advice=advice,
        length=math.fsum(edges.pieces(path, math.inf, math.inf).lengths) if solved else math.nan,
        clearance=math.nan,
        path_exists=exists,
        planner=name,
        objective="length",
        drive=HOLONOMIC,
        turning_radius=None,
        exact=False,
        seed=options["seed"],
        time_limit=options["time_limit"],
        times=Times(set_up - began, planning, simplification, time.perf_counter() - searched),
    )


def check_options(**options: object) -> None:
    """Refuse what goes together with a map in memory alone.

    Raises
    ------
    InputError
        If an option is not as it is if left out.
    """
    for name, value in options.items():
        if value not in (None, False, "length", HOLONOMIC):
            found, rule = f"is {value!r}, on a map in a store", "a path there is straight edges, and goes by length"
            raise InputError(name, found, rule, "leave it out, or plan on space.window(lower, upper)", value=value)


def _endpoint(space: TiledCSpace, q: ArrayLike, name: str, leg: Leg) -> Floats:
    """A start or goal where a motion can be proven free."""
    point = finite(q, name)
    if point.shape != (space.dof,):
        rule, mend = f"it must be one configuration of {space.dof} numbers", f"pass ({', '.join(space.axes)})"
        raise InputError(name, f"has shape {point.shape}", rule, mend, value=q)
    point = space.rotations.canonical(point, name)
    position, grid = point[: space.grid.dim], space.grid
    if not grid.contains(position):
        found = f"lies outside the map, which reaches from {grid.lower} to {grid.upper}"
        raise ConfigurationError(name, found, "a path stays within the map", "choose one within", value=q)
    if not space.motion_is_free(point, point):
        around = grid.spacing * np.array(space.tile) / 2.0
        try:
            leg(space.window(position - around, position + around), point, point)
        except ConfigurationError as error:  # which knows the nearest one
            words = (error.found or "").removeprefix("start ")
            raise ConfigurationError(name, words, error.rule, error.mend, value=q, nearest=error.nearest) from error
    return point


def _shortened(space: TiledCSpace, path: Floats) -> Floats:
    """A path without the waypoints that a straight edge may pass by."""
    kept, at = [0], 0
    while at < len(path) - 1:
        ahead = np.arange(at + 1, min(at + 1 + AHEAD, len(path)))
        free = np.asarray(space.motion_is_free(np.repeat(path[at : at + 1], len(ahead), axis=0), path[ahead]))
        at = int(ahead[np.flatnonzero(free)[-1]]) if free.any() else at + 1
        kept.append(at)
    return path[kept]

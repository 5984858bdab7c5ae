"""Short and cheap paths along chains of cells: the planner "Grid"."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace import CSpace, Space
from cspace.inside import (
    NEVER,
    ConfigurationMap,
    Effort,
    Floats,
    Ints,
    check_memory,
    is_labelled,
    is_over,
    map_record,
    now,
)
from planners._searches.built_in import BuiltInSearch
from planners._searches.paths import (
    MAX_SHORTENING,
    MIN_GAIN_BEFORE_MOVES,
    Check,
    Cost,
    are_free,
    keep_rotation,
    move_points,
    path_length,
    pulled_straight,
    thin_path,
    waypoints,
)
from planners._task import WEIGHTED, PlanTask

if TYPE_CHECKING:
    from planners._edges.integrals import CellCost
    from planners._edges.local_planner import LocalPlanner
    from planners._searches.estimate import Costs


def find_short_path(space: CSpace, endpoints: Floats, straight: bool, limit: Effort) -> Floats:
    """Find a path through FREE cells, shape (n, size).

    ``endpoints``, shape (2, size), are FREE and canonical. The path is one straight edge if
    possible, and otherwise follows a short chain of cells (Hart, Nilsson and Raphael 1968). The
    length n is 0 if there is none. If not ``straight``, waypoints are the centers of the cells
    passed. Raises TimeoutError at the limit.
    """
    start, goal = endpoints
    dim = space.dim
    if not space.rotations.steps_between(start, goal)[dim:].any():
        # The same rotation may be given in other numbers, e.g. other signs.
        endpoints = np.stack([start, np.concatenate([goal[:dim], start[dim:]])])
    if straight and are_free(endpoints, space.edge_checker()):
        return endpoints
    return _find_path_along_chain(space, endpoints, straight, limit)


def find_exact_path(space: CSpace, endpoints: Floats, straight: bool, limit: Effort) -> Floats:
    """Find a path that geometry proves, shape (n, size).

    A search through FREE cells, and another one through MIXED cells, give the shorter path.
    Otherwise, arguments, result and errors are as for :func:`find_short_path`.
    """
    until = now() + limit
    check = space.exact.edge_checker()
    if straight and are_free(endpoints, check):
        return endpoints
    measure = partial(path_length, rotations=space.rotations)
    paths = list[Floats]()
    max_length = math.inf
    if np.all(space.is_free(endpoints)):
        free_path = find_short_path(space, endpoints, straight, limit)
        if len(free_path):
            paths.append(free_path)
            max_length = measure(free_path)
    mixed_path = _find_path_through_mixed(space, endpoints, check, max_length, until)
    if len(mixed_path):
        paths.append(mixed_path)
    if straight:
        end = until + MAX_SHORTENING
        paths = [pulled_straight(path, space.rotations, check, until=end) for path in paths]
    return min(paths, key=measure, default=endpoints[:0])


def _find_path_through_mixed(
    space: CSpace, endpoints: Floats, check: Check, max_length: float, until: Effort
) -> Floats:
    """Find a path of edges that pass ``check`` through MIXED cells.

    ``endpoints`` has shape (2, size), the path (n, size). It is empty if no path promises to be
    shorter than ``max_length``, or after ``until``.
    """
    from planners._searches.undecided import UNDECIDED_BYTES_PER_CELL, MixedCellSearch

    needed = UNDECIDED_BYTES_PER_CELL * space.grid.size * len(space.rotations)
    check_memory(needed, "the map, to search its MIXED cells,", space.grid)
    # One array for each rotation cell, because geometry decides each on its own.
    states = space.cell_states.reshape(-1, *space.grid.shape)
    return MixedCellSearch(space, states, check).find(endpoints, max_length, until)


def _find_path_along_chain(
    space: CSpace,
    endpoints: Floats,
    straight: bool,
    limit: Effort,
    costs: tuple[Costs, Cost] | None = None,
) -> Floats:
    """Find a path along a short chain of cells.

    It has shape (n, size), where n is 0 without a path, and is shortened if ``straight``. ``costs``
    holds the cost of a metre in each cell, shape (slices, ...), and the cost of an edge; by default
    costs are lengths.
    """
    no_path = endpoints[:0]
    start, goal = map(tuple, endpoints.tolist())

    def may_exist() -> bool:
        return bool(space.is_connected(start, goal))

    # If components are known already, they save a search that cannot succeed.
    if is_labelled(space) and not may_exist():
        return no_path
    until = now() + limit
    check = space.edge_checker()
    if straight and costs is None and space.size == 2:
        path = _find_taut_path(space, endpoints, until, may_exist)
        if len(path) and are_free(path, check):
            return path
    cells = _find_chain_between(space, endpoints, until, costs, may_exist)
    if not len(cells) or is_over(NEVER):  # before thousands of edges are proven
        return no_path
    path = keep_rotation(waypoints(space, endpoints, cells), cells[:, 0], space.dim, check)
    # Only the edges from start and to goal may fail, if they touch cells that are not FREE.
    if not are_free(path, check):
        return no_path
    if not straight:
        return path
    end = until + MAX_SHORTENING
    if costs is None:
        return pulled_straight(path, space.rotations, check, until=end)
    factors, cost = costs
    numbers, *positions = cells[[0, *range(len(cells)), -1]].T  # with start and goal
    along = factors[map_record(space).rotations.slice_of[numbers], *positions]
    path = thin_path(path, along, space.rotations, check, cost)
    path = pulled_straight(path, space.rotations, check, cost, end, MIN_GAIN_BEFORE_MOVES)
    if is_over(end):
        return path
    return move_points(path, space.dim, space.grid.spacing, check, cost)


def _find_chain_between(
    space: CSpace,
    endpoints: Floats,
    until: Effort,
    costs: tuple[Costs, Cost] | None,
    may_exist: Callable[[], bool],
) -> Ints:
    """Find a short chain of FREE cells, shape (n, 1 + d)."""
    from planners._searches.chains import find_cells, find_chain
    from planners._searches.guide import NO_FACTORS

    map_ = map_record(space)
    states = map_.states.reshape(-1, *space.grid.shape)
    first, last = find_cells(space, endpoints)
    factors, _ = costs or (NO_FACTORS, None)
    return find_chain(
        space, states, map_.rotations.slice_of, first, last, until, factors, may_exist
    )


def _find_taut_path(
    space: CSpace, endpoints: Floats, until: Effort, may_exist: Callable[[], bool]
) -> Floats:
    """Find the shortest path in the plane with a margin.

    It passes obstacles on the same sides as the shortest path without a margin. Its shape is
    (n, 2), where n is 0 without a path.
    """
    from cspace.inside import find_crossed_runs
    from planners._searches.taut import pull_taut

    grid = space.grid
    start, goal = (endpoints - grid.lower) / grid.spacing
    runs = find_crossed_runs(space, start, goal, until, may_exist)
    if not len(runs):
        return endpoints[:0]
    taut = pull_taut(runs, start, goal)
    path: Floats = np.asarray(grid.lower) + grid.spacing * taut
    path[[0, -1]] = endpoints
    return path


def find_cheap_path(
    edges: LocalPlanner, weights: CellCost, endpoints: Floats, straight: bool, limit: Effort
) -> Floats:
    """Find a path of low cost through FREE cells, by ``weights``.

    It is the cheaper of up to two paths. Otherwise, arguments, result and errors are as for
    :func:`find_short_path`.
    """
    space = edges.cells
    until = now() + limit
    paths: list[Floats] = []
    if space.size == 2:
        paths.append(find_short_path(space, endpoints, straight, limit))
    elif are_free(endpoints, space.edge_checker()):
        paths.append(endpoints)
    for path in paths:
        # Up to a cost of 0.1 % above its length, no path of lower cost is searched.
        if len(path) and edges.path_cost(path) <= 1.001 * edges.path_length(path):
            return path
    with suppress(TimeoutError):
        left = until - now()
        costs = weights.factors, edges.cost()
        paths.append(_find_path_along_chain(space, endpoints, straight, left, costs))
    paths = [path for path in paths if len(path)]
    return min(paths, key=edges.path_cost, default=endpoints[:0])


class GridSearch(BuiltInSearch):
    """Search along chains of cells, for robots that move in any direction."""

    name = "Grid"
    objectives = WEIGHTED

    def takes_space(self, space: Space) -> bool:
        """Return True for maps."""
        return isinstance(space, ConfigurationMap)

    def may_fail(self, edges: LocalPlanner) -> bool:
        """Return False if it finds every path through FREE cells."""
        return edges.exact or bool(edges.space.rotations.names)

    def find_path(self, task: PlanTask) -> tuple[Floats, str]:
        """Return waypoints, shape (n, size), and no proof."""
        edges = task.edges
        space = edges.cells
        endpoints = space.rotations.make_canonical(np.array(task.endpoints))
        until = now() + task.limit
        path = endpoints[:0]
        with suppress(TimeoutError):
            if edges.weights is not None:
                path = find_cheap_path(edges, edges.weights, endpoints, task.simplify, task.limit)
            elif not edges.exact:
                path = find_short_path(space, endpoints, task.simplify, task.limit)
            # FREE cells are clear; if they give no path, the geometry may.
            if edges.exact and not len(path):
                path = find_exact_path(space, endpoints, task.simplify, until - now())
        return path, ""


PLANNERS: Final = {GridSearch.name: GridSearch()}
"""Searches of this module."""

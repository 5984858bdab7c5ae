"""Search for short chains of cells: A* over the cells of a map.

A chain is a sequence of cells, each next to the one before. Within a slice, a chain moves between
the centers of near cells, and all closed cells that a move touches are passable. At one position, a
chain rotates between neighbouring rotation cells.

The estimate of the remaining cost is the length of a chain over positions that are passable at any
rotation (:mod:`planners._searches.guide`), and the cost of rotating to the goal's rotation cell (P.
Hart, N. Nilsson and B. Raphael, "A formal basis for the heuristic determination of minimum cost
paths", 1968).

Kernels see three axes: a map of the plane has one layer of cells along the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from cspace import FREE, CSpace
from cspace.inside import METRES_PER_RADIAN, Effort, Floats, Ints, States, frozen, internal, kernel
from planners._edges.local_planner import LocalPlanner
from planners._searches.estimate import (
    DONE,
    GOES_ON,
    NEEDS_ESTIMATE,
    NO_NODE,
    POPS_PER_CLOCK_CHECK,
    UNKNOWN,
    Cell,
    Costs,
    Estimate,
    expand_until_done,
    is_cheaper,
    pop_best,
    reach_cell,
    start_progress,
)
from planners._searches.frontier import Progress
from planners._searches.guide import (
    NO_FACTORS,
    POSITIONS_WEIGHT,
    Guide,
    any_direction,
    factor_at,
    measure_turns,
)
from planners._searches.moves import Moves, list_moves

BLOCK_SIDE: Final = 4
"""Cells along each side of the blocks of the guide."""

MAX_POSITIONS_WITHOUT_BLOCKS: Final = 2**14
"""Largest number of cells of a map without rotations whose guide examines each cell, in a few
milliseconds. Blocks of cells may hide the shorter way around an obstacle."""


class Graph(NamedTuple):
    """Cells of a map and the moves between them, for kernels.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz), read-only
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    turns : ndarray of float64, shape (rotations, n)
        Cost of rotating to each neighbor, in cells.
    moves : Moves
    factors : ndarray of float32, shape (slices, nx, ny, nz), or empty
        Factor of the cost of moves in each cell.
    """

    states: States
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Moves
    factors: Costs


def find_chain(
    space: CSpace,
    states: States,
    slice_of: Ints,
    start: Ints,
    goal: Ints,
    until: Effort,
    factors: Costs = NO_FACTORS,
    may_exist: Callable[[], bool] | None = None,
) -> Ints:
    """Find a short chain of passable cells.

    Parameters
    ----------
    space : CSpace
        Map with the grid and the rotation cells of the chain; its states are ignored.
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Passable cells are FREE.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell, writeable.
    start, goal : ndarray of int64, shape (1 + d,)
        Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid.
    until : Effort
        Reading of :func:`cspace.inside.now` at which the search ends.
    factors : ndarray of float32, the shape of states, optional
        Factor, 1 or above, of the cost of moves in each cell.
    may_exist : callable, optional
        Returns False if no chain exists. A long search calls it once.

    Returns
    -------
    ndarray of int64, shape (n, 1 + d)
        Cells from start to goal; n is 0 if no chain exists.

    Raises
    ------
    TimeoutError
        If time runs out.
    """
    # Rotations cost their angles as lengths, in cells.
    neighbors = space.rotations.neighbors
    centers = space.rotations.centers
    steps = space.rotations.steps_between(centers[:, np.newaxis], centers[neighbors])
    turns = METRES_PER_RADIAN / space.grid.spacing * np.linalg.norm(steps, axis=-1)
    dim = states.ndim - 1
    # Kernels see three axes.
    missing_axes = (1,) * (3 - dim)
    shape = (*missing_axes, *states.shape[1:])
    graph = Graph(
        states=frozen(np.ascontiguousarray(states.reshape(-1, *shape))),
        slice_of=slice_of,
        neighbors=neighbors,
        turns=np.asarray(turns),
        moves=list_moves(dim),
        factors=factors.reshape(-1, *shape) if factors.size else NO_FACTORS,
    )
    cells_shape = (len(slice_of), *states.shape[1:])
    start_cell = int(np.ravel_multi_index(tuple(start), cells_shape))
    goal_cell = int(np.ravel_multi_index(tuple(goal), cells_shape))
    progress = _search_guided(graph, start_cell, goal_cell, until, may_exist)
    if not progress.closed[goal_cell]:
        return np.empty((0, 1 + dim), dtype=np.int64)
    # Follow the chain back from the goal; the cells before are stored plus 1.
    cell = goal_cell
    cells = [cell]
    while cell != start_cell:
        cell = int(progress.previous[cell]) - 1
        cells.append(cell)
    cells.reverse()
    return np.stack(np.unravel_index(cells, cells_shape), axis=1)


def find_cells(space: CSpace, q: Floats) -> Ints:
    """Return the cells of configurations, shape (..., 1 + d).

    Cells are ``(rotation, x, ...)``. ``q`` has shape (..., size). Cells may lie outside the grid.
    """
    positions = space.grid.cell_of(q[..., : space.dim])
    # Without rotations, the only cell is 0.
    rotations = np.resize(space.rotations.cell_of(q[..., space.dim :]), (*q.shape[:-1], 1))
    return np.concatenate([rotations, positions], axis=-1)


def _locate(index: int, shape: Cell) -> Cell:
    """Return the cell of an index over all cells."""
    i, j, k = np.unravel_index(index, shape)
    return int(i), int(j), int(k)


def _search_guided(
    graph: Graph,
    start: int,
    goal: int,
    until: Effort,
    may_exist: Callable[[], bool] | None,
) -> Progress:
    """Search from start to goal, given as cell indices.

    Indices count cells over all rotation cells. A long search ends if ``may_exist`` returns False.
    Raises TimeoutError after ``until``.
    """
    shape = graph.states.shape[1:]
    size = math.prod(shape)
    goal_rotation, goal_position = divmod(goal, size)
    goal_cell = _locate(goal_position, shape)
    start_cell = _locate(start % size, shape)
    turns = len(graph.slice_of) > 1
    guide = Guide(
        graph.states,
        any_direction(graph.states)._replace(joins=True),
        (0, start_cell),
        (0, goal_cell),
        BLOCK_SIDE if turns or size > MAX_POSITIONS_WITHOUT_BLOCKS else 1,
        narrow_cost=LocalPlanner.narrow_cost if turns else 0.0,
        # A guide without rotations is exact enough for shorter ways around each obstacle.
        weight=POSITIONS_WEIGHT if turns else 1.02,
        factors=graph.factors,
    )
    guide.reach(0, start_cell, until, may_exist)
    if not guide.is_reached(start_cell):
        return start_progress(start, len(graph.slice_of) * size)
    rotations = measure_turns(graph.neighbors, graph.turns, goal_rotation)
    # With this weight, the search expands far fewer cells, for chains that are hardly longer.
    estimate = guide.estimate._replace(weight=1.2, rotations=rotations)

    def reach_block(node: int) -> None:
        guide.reach(0, _locate(node % size, shape), until)

    return expand_until_done(
        lambda progress: expand_cells(graph, estimate, progress, goal),
        start_progress(start, len(graph.slice_of) * size),
        len(graph.moves.steps) + graph.neighbors.shape[1],
        until,
        reach_block,
        may_exist,
    )


@kernel
def expand_cells(graph: Graph, estimate: Estimate, progress: Progress, goal: int) -> int:
    """Expand queued nodes until the goal was expanded.

    Return :data:`GOES_ON` after many cells, or if the queue is nearly full.
    """
    nx, ny, nz = estimate.shape
    steps = graph.moves.steps
    n_moves = steps.shape[0]
    n_neighbors = graph.neighbors.shape[1]
    for _ in range(POPS_PER_CLOCK_CHECK):
        if progress.length[0] + n_moves + n_neighbors >= progress.keys.shape[0]:
            return GOES_ON
        cell = pop_best(estimate, progress)
        if cell == UNKNOWN:
            return NEEDS_ESTIMATE
        if cell == NO_NODE:
            return DONE
        progress.closed[cell] = True
        if cell == goal:
            return DONE
        # Decode the cell's index over all rotation cells.
        k = cell % nz
        j = cell // nz % ny
        i = cell // (nz * ny) % nx
        rotation = cell // (nz * ny * nx)
        here = graph.slice_of[rotation]
        factor = factor_at(graph.factors, here, i, j, k)
        passable = passable_near(graph, here, i, j, k)
        for option in range(n_moves + n_neighbors):
            other, there, u, v, w = rotation, here, i, j, k
            if option < n_moves:
                # Move to a near cell of the slice, if all cells on the way are passable.
                needed = graph.moves.needed[option]
                if passable & needed != needed:
                    continue
                u += steps[option, 0]
                v += steps[option, 1]
                w += steps[option, 2]
                length = graph.moves.lengths[option]
            else:
                # Rotate to a neighbouring rotation cell at the same position.
                other = graph.neighbors[rotation, option - n_moves]
                if other < 0:
                    continue
                there = graph.slice_of[other]
                if graph.states[there, i, j, k] != FREE:
                    continue
                length = graph.turns[rotation, option - n_moves]
            mean = 0.5 * (factor + factor_at(graph.factors, there, u, v, w))
            cost = progress.cost[cell] + mean * length
            if is_cheaper(progress, ((other * nx + u) * ny + v) * nz + w, cost):
                reach_cell(estimate, progress, cell, other, u, v, w, cost)
    return GOES_ON


@internal
def passable_near(graph: Graph, number: int, i: int, j: int, k: int) -> int:
    """Return a bit mask of a node's passable neighbours.

    ``number`` is the slice's number; bit b stands for row b of ``graph.moves.near_cells``.
    """
    _, nx, ny, nz = graph.states.shape
    near_cells = graph.moves.near_cells
    mask = 0
    for bit in range(near_cells.shape[0]):
        u = i + near_cells[bit, 0]
        v = j + near_cells[bit, 1]
        w = k + near_cells[bit, 2]
        is_inside = 0 <= u < nx and 0 <= v < ny and 0 <= w < nz
        if is_inside and graph.states[number, u, v, w] == FREE:
            mask |= 1 << bit
    return mask

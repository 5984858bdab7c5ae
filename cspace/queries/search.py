"""Search for short chains of cells: A* over the cells of a map.

A chain is a sequence of cells, each next to the one before. Within a slice, a chain moves from the
center of a cell to that of a near cell, and all closed cells that the move touches are passable. At
one position, a chain rotates between neighbouring rotation cells.

The estimate of the remaining cost is the length of the shortest chain over positions that are
passable at any rotation, and the cost of rotating to the goal's rotation cell (P. Hart, N. Nilsson
and B. Raphael, "A formal basis for the heuristic determination of minimum cost paths", 1968).
A search from the goal to the start measures these lengths, and only near the way between them.

Kernels see three axes: a map of the plane has one layer of cells along the first.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.queries.points import Cell
from cspace.record.states import read_only
from cspace.rotations import Rotations
from cspace.rotations.base import METRES_PER_RADIAN
from cspace.support.arrays import FREE, Bools, Floats, Ints, States
from cspace.support.compiling import clock, kernel

Costs = NDArray[np.float32]

EXACT_WEIGHT: Final = 1.0
"""Weight of the estimate in searches for shortest chains."""

SHORT_WEIGHT: Final = 1.2
"""Weight of the estimate in searches for short chains, which expand far fewer cells."""

STRAIGHT_WEIGHT: Final = 1.1
"""Largest weight of the estimate that ignores obstacles."""

POPS_PER_CLOCK_CHECK: Final = 2**14
"""Cells taken from the queue between two checks of the time limit, about 10 ms."""

INITIAL_QUEUE_LENGTH: Final = 2**14
"""Entries that the queue of a search can hold at first; the length doubles as needed."""

GUIDE_MARGIN_CELLS: Final = 10.0
"""Cells by which chains over positions may be longer than the shortest one to be measured."""

TIE_WEIGHT: Final = 1.001
"""Weight of the estimate over positions; above 1, the search goes on along one of the chains that
are equally short."""

MAX_OFFSET_SUM: Final = 3
"""Largest sum of the offsets of a move along all axes, in cells."""

NO_FACTORS: Final[Costs] = np.empty((0, 0, 0, 0), dtype=np.float32)
"""Stands for cells that all cost their length."""


class Moves(NamedTuple):
    """Moves from a node to near nodes of its slice.

    Attributes
    ----------
    steps : ndarray of int64, shape (m, 3)
        Offset of the node that each move leads to.
    lengths : ndarray of float64, shape (m,)
        Length of each move, in cells.
    near_cells : ndarray of int64, shape (n, 3)
        Offsets from the node to the cells that its moves may touch.
    needed : ndarray of int64, shape (m,)
        Bit mask of the near cells that must be passable for each move.
    """

    steps: Ints
    lengths: Floats
    near_cells: Ints
    needed: Ints


class Graph(NamedTuple):
    """Nodes of a map and the moves between them, for kernels.

    A node is a cell, or in :mod:`cspace.queries.lower_bound` a corner of cells.

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


class Estimate(NamedTuple):
    """Estimate of the remaining cost: that of positions, and that of rotations, in cells.

    Attributes
    ----------
    weight : float
        Factor of the estimate.
    shape : tuple of int
        Number of nodes along each axis.
    goal : tuple of int
        Cell ``(x, y, z)`` of the goal.
    positions : ndarray of float32, shape (cells,) or (0,)
        Cost from each measured position; empty for the straight distance.
    measured : ndarray of bool, the shape of positions
    beyond : float
        Cost from all other positions.
    rotations : ndarray of float64, shape (rotations,)
    """

    weight: float
    shape: Cell
    goal: Cell
    positions: Costs
    measured: Bools
    beyond: float
    rotations: Floats


class Progress(NamedTuple):
    """State of a search, which kernels change.

    Attributes
    ----------
    cost : ndarray of float32, shape (cells,)
        Cost of the best chain found to each reached cell, in cells.
    previous : ndarray of int64, shape (cells,)
        The cell before each reached cell of its best chain, plus 1; 0 for cells not reached, so
        that a large map takes memory only where the search leads.
    closed : ndarray of bool, shape (cells,)
        True for cells that were expanded.
    keys, queue : ndarray of float64 and int64, shape (n,)
        Binary heap of cells by their expected cost.
    length : ndarray of int64, shape (1,)
        Number of entries of the heap.
    """

    cost: Costs
    previous: Ints
    closed: Bools
    keys: Floats
    queue: Ints
    length: Ints


def find_chain(
    states: States,
    slice_of: Ints,
    rotations: tuple[Ints, Floats],
    start: Ints,
    goal: Ints,
    until: float,
    *,
    weight: float = SHORT_WEIGHT,
    factors: Costs = NO_FACTORS,
) -> Ints:
    """Find a short chain of passable cells from start to goal.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    rotations : tuple of ndarray, shape (rotations, n)
        Adjacent rotation cells, padded with -1, and the cost of rotating to them, in cells.
    start, goal : ndarray of int64, shape (1 + d,)
        Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid.
    until : float
        Reading of :data:`cspace.support.compiling.clock` at which the search ends.
    weight : float
        Weight of the estimated cost; at 1, the chain is a shortest one, above 1 the search is
        faster.
    factors : ndarray of float32, the shape of states, optional
        Factor, 1 or above, of the cost of moves in each cell.

    Returns
    -------
    ndarray of int64, shape (n, 1 + d)
        Cells from start to goal; n is 0 if no chain exists.

    Raises
    ------
    TimeoutError
        If time runs out.
    """
    neighbors, turns = rotations
    dim = states.ndim - 1
    # Kernels see three axes.
    missing_axes = (1,) * (3 - dim)
    shape = (*missing_axes, *states.shape[1:])
    graph = Graph(
        states=read_only(states.reshape(-1, *shape)),
        slice_of=slice_of,
        neighbors=neighbors,
        turns=turns,
        moves=_list_moves(dim),
        factors=factors.reshape(-1, *shape) if factors.size else NO_FACTORS,
    )
    cells_shape = (len(slice_of), *states.shape[1:])
    start_cell = int(np.ravel_multi_index(tuple(start), cells_shape))
    goal_cell = int(np.ravel_multi_index(tuple(goal), cells_shape))
    estimate = _estimate_cost(graph, start_cell, goal_cell, weight, until)
    progress = search(graph, estimate, start_cell, goal_cell, until)
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


def turn_costs(rotations: Rotations, dim: int, spacing: float) -> Floats:
    """Return the cost of rotating to neighbouring rotation cells.

    Costs are in cells, shape (rotations, n); `dim` is the dimension of the grid, and ``spacing`` is
    in metres.
    """
    # Steps between the centers of rotation cells at one position.
    origins = np.zeros((len(rotations), dim))
    centers = np.column_stack([origins, rotations.centers])
    steps = rotations.steps_between(centers[:, np.newaxis], centers[rotations.neighbors])
    angles = np.linalg.norm(steps, axis=-1)
    return np.asarray(METRES_PER_RADIAN / spacing * angles)


def check_deadline(until: float) -> None:
    """Raise TimeoutError after ``until``, in seconds of :data:`cspace.support.compiling.clock`."""
    if clock() > until:
        raise TimeoutError


@cache
def _list_moves(dim: int) -> Moves:
    """List the moves between centers of cells in the plane or in space, shortest first.

    The offsets of a move have no common divisor.
    """
    largest = (0, 2, 2) if dim == 2 else (1, 1, 1)
    ranges = [range(-offset, offset + 1) for offset in largest]
    steps = [step for step in product(*ranges) if math.gcd(*step) == 1]
    steps = [step for step in steps if sum(map(abs, step)) <= MAX_OFFSET_SUM]
    steps.sort(key=lambda step: math.hypot(*step))
    # The near cells are those that the moves lead to, so cell b of a mask is that of move b.
    masks = []
    for step in steps:
        touched_bits = [_touches(step, cell) << bit for bit, cell in enumerate(steps)]
        masks.append(sum(touched_bits))
    offsets = np.array(steps)
    return Moves(offsets, np.linalg.norm(offsets, axis=1), offsets, np.array(masks))


def _touches(move: tuple[int, ...], cell: tuple[int, ...]) -> bool:
    """Return True if a move between centers of cells touches a cell.

    The move is the segment from the center of cell (0, 0, 0) to the center of cell ``move``; the
    cell is closed.
    """
    lower = [index - 0.5 for index in cell]
    enter, leave = times_in_box(move, lower)
    return enter <= leave


def times_in_box(step: Sequence[int], lower: Sequence[float]) -> tuple[float, float]:
    """Return the fractions between which the segment from zero to ``step`` is in a closed box.

    The box is a cell with the corner ``lower``. The first fraction is above the second one if the
    segment misses the box.
    """
    enter = 0.0
    leave = 1.0
    for length, low in zip(step, lower, strict=True):
        high = low + 1.0
        if length != 0:
            enter = max(enter, min(low / length, high / length))
            leave = min(leave, max(low / length, high / length))
        elif not low <= 0.0 <= high:
            return 1.0, 0.0
    return enter, leave


def straight_estimate(shape: Cell, goal: Cell, weight: float) -> Estimate:
    """Estimate the cost to the node ``goal`` as if there were no obstacles."""
    return Estimate(
        weight=weight,
        shape=shape,
        goal=goal,
        positions=np.empty(0, dtype=np.float32),
        measured=np.empty(0, dtype=np.bool_),
        beyond=0.0,
        rotations=np.zeros(1),
    )


def _locate(index: int, shape: Cell) -> Cell:
    """Return the cell of an index over all cells."""
    i, j, k = np.unravel_index(index, shape)
    return int(i), int(j), int(k)


def _estimate_cost(graph: Graph, start: int, goal: int, weight: float, until: float) -> Estimate:
    """Compute the estimate of the cost from each cell to the goal.

    ``start`` and ``goal`` are indices of cells over all rotation cells. Raises TimeoutError after
    ``until``.
    """
    shape = graph.states.shape[1:]
    goal_rotation, goal_position = divmod(goal, math.prod(shape))
    goal_cell = _locate(goal_position, shape)
    # Without rotations, straight distances are as good as a search, and quicker.
    if len(graph.slice_of) == 1:
        return straight_estimate(shape, goal_cell, min(weight, STRAIGHT_WEIGHT))
    # A position is passable if it is FREE, the lowest state, at any rotation.
    lowest = graph.states.min(axis=0)
    factors = graph.factors.min(axis=0, keepdims=True) if graph.factors.size else NO_FACTORS
    start_cell = _locate(start % math.prod(shape), shape)
    estimate = measure_positions(lowest, start_cell, goal_cell, until, factors)
    rotations = _compute_rotation_costs(graph, goal_rotation)
    return estimate._replace(weight=weight, rotations=rotations)


def measure_positions(
    states: States,
    start: Cell,
    goal: Cell,
    until: float,
    factors: Costs = NO_FACTORS,
) -> Estimate:
    """Measure the shortest chains from positions to the goal, around the way from the start.

    ``states``, shape (nx, ny, nz), are the lowest at any rotation, and start and goal cells of
    them. Raises TimeoutError after ``until``.
    """
    no_rotations = np.empty((1, 0), dtype=np.int64)
    graph = Graph(
        states=read_only(states[np.newaxis]),
        slice_of=np.zeros(1, dtype=np.int64),
        neighbors=no_rotations,
        turns=no_rotations.astype(np.float64),
        moves=_list_moves(2 if states.shape[0] == 1 else 3),
        factors=factors,
    )
    first, last = (int(np.ravel_multi_index(cell, states.shape)) for cell in (goal, start))
    to_start = straight_estimate(states.shape, start, TIE_WEIGHT)
    reached = search(graph, to_start, first, last, until, margin=GUIDE_MARGIN_CELLS)
    beyond = float(reached.cost[last]) + GUIDE_MARGIN_CELLS
    estimate = straight_estimate(states.shape, goal, 1.0)
    return estimate._replace(positions=reached.cost, measured=reached.closed, beyond=beyond)


def _compute_rotation_costs(graph: Graph, goal: int) -> Floats:
    """Compute the lowest cost of rotating from each rotation cell to ``goal``, in cells.

    Costs, shape (rotations,), are lowered by way of neighbors until none changes.
    """
    costs = np.full(len(graph.slice_of), np.inf)
    costs[goal] = 0.0
    is_settled = False
    while not is_settled:
        by_neighbors = np.where(graph.neighbors < 0, np.inf, costs[graph.neighbors] + graph.turns)
        lower_costs = np.minimum(costs, by_neighbors.min(axis=1))
        is_settled = np.array_equal(costs, lower_costs)
        costs = lower_costs
    return costs


def search(
    graph: Graph,
    estimate: Estimate,
    start: int,
    goal: int,
    until: float,
    *,
    margin: float = 0.0,
    excluded: Bools | None = None,
) -> Progress:
    """Expand nodes from ``start`` on until ``goal`` is reached or no node is left.

    It goes on to the nodes of chains that promise to be longer by ``margin``. ``excluded``, shape
    (nodes,), are nodes that no chain may pass. Raises TimeoutError after ``until``.
    """
    n_nodes = len(graph.slice_of) * math.prod(estimate.shape)
    progress = make_progress(n_nodes, INITIAL_QUEUE_LENGTH)
    if excluded is not None:
        progress = progress._replace(closed=excluded)
    # The start is its own predecessor.
    progress.previous[start] = start + 1
    push(progress, 0.0, start)
    max_new_entries = len(graph.moves.steps) + graph.neighbors.shape[1]
    while not expand_cells(graph, estimate, progress, goal, margin):
        check_deadline(until)
        # Double the queue if one more cell could overflow it.
        if progress.length[0] + max_new_entries >= len(progress.queue):
            keys = np.concatenate([progress.keys, np.empty_like(progress.keys)])
            queue = np.concatenate([progress.queue, np.empty_like(progress.queue)])
            progress = progress._replace(keys=keys, queue=queue)
    return progress


def make_progress(count: int, length: int) -> Progress:
    """Make an empty search over ``count`` nodes, with room for ``length`` in its queue."""
    return Progress(
        cost=sparse_zeros(count, np.float32),
        previous=sparse_zeros(count, np.int64),
        closed=sparse_zeros(count, np.bool_),
        keys=np.empty(length),
        queue=np.empty(length, dtype=np.int64),
        length=np.zeros(1, dtype=np.int64),
    )


def sparse_zeros(count: int, kind: type[np.generic]) -> NDArray[Any]:
    """Return zeros, shape (count,), that take time and memory only where they are touched.

    Large arrays of numpy come in pages of megabytes, and a search touches few bytes of each.
    """
    memory = mmap.mmap(-1, count * np.dtype(kind).itemsize)
    if hasattr(mmap, "MADV_NOHUGEPAGE"):
        with suppress(OSError):  # a system without large pages
            memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, dtype=kind)


@kernel
def expand_cells(
    graph: Graph, estimate: Estimate, progress: Progress, goal: int, margin: float
) -> bool:
    """Expand queued nodes; return True when the search is done, or no node is left.

    It is done when the goal was expanded, and all others are dearer by more than ``margin``.
    Return False after many cells, or if the queue is nearly full; the next call goes on.
    """
    nx, ny, nz = estimate.shape
    steps = graph.moves.steps
    n_moves = steps.shape[0]
    n_neighbors = graph.neighbors.shape[1]
    for _ in range(POPS_PER_CLOCK_CHECK):
        if progress.length[0] == 0:
            return True
        if progress.length[0] + n_moves + n_neighbors >= progress.keys.shape[0]:
            return False
        if progress.closed[goal] and progress.keys[0] >= progress.cost[goal] + margin:
            return True
        cell = pop_first(progress)
        if progress.closed[cell]:
            continue
        progress.closed[cell] = True
        # Decode the cell's index over all rotation cells.
        k = cell % nz
        j = cell // nz % ny
        i = cell // (nz * ny) % nx
        rotation = cell // (nz * ny * nx)
        here = graph.slice_of[rotation]
        factor = factor_at(graph, here, i, j, k)
        # Move to near cells of the slice, if all cells on the way are passable.
        passable = passable_near(graph, here, i, j, k)
        for move in range(n_moves):
            needed = graph.moves.needed[move]
            if passable & needed == needed:
                u = i + steps[move, 0]
                v = j + steps[move, 1]
                w = k + steps[move, 2]
                mean = 0.5 * (factor + factor_at(graph, here, u, v, w))
                cost = mean * graph.moves.lengths[move]
                reach_cell(estimate, progress, cell, rotation, u, v, w, cost)
        # Rotate to neighbouring rotation cells at the same position.
        for column in range(n_neighbors):
            other = graph.neighbors[rotation, column]
            if other < 0:
                continue
            there = graph.slice_of[other]
            if graph.states[there, i, j, k] == FREE:
                mean = 0.5 * (factor + factor_at(graph, there, i, j, k))
                cost = mean * graph.turns[rotation, column]
                reach_cell(estimate, progress, cell, other, i, j, k, cost)
    return False


@kernel
def passable_near(graph: Graph, number: int, i: int, j: int, k: int) -> int:
    """Return a bit mask of the near cells of node (i, j, k) that a chain may pass.

    ``number`` is that of the slice; bit b stands for row b of ``graph.moves.near_cells``.
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


@kernel
def factor_at(graph: Graph, number: int, i: int, j: int, k: int) -> np.float32:
    """Return the factor of the cost of moves in cell (i, j, k) of slice ``number``."""
    if graph.factors.shape[0] == 0:
        return np.float32(1.0)
    factor: np.float32 = graph.factors[number, i, j, k]
    return factor


@kernel
def reach_cell(
    estimate: Estimate,
    progress: Progress,
    cell: int,
    rotation: int,
    u: int,
    v: int,
    w: int,
    step: float,
) -> None:
    """Record a step from a cell to (u, v, w) at a rotation, if its chain is the cheapest so far.

    ``step`` is the cost of the step, in cells.
    """
    nx, ny, nz = estimate.shape
    reached = ((rotation * nx + u) * ny + v) * nz + w
    cost = progress.cost[cell] + step
    if progress.closed[reached]:
        return
    is_first = progress.previous[reached] == 0
    if is_first or np.float32(cost) < progress.cost[reached]:
        progress.cost[reached] = cost
        progress.previous[reached] = cell + 1
        remaining = remaining_cost(estimate, u, v, w) + estimate.rotations[rotation]
        push(progress, cost + estimate.weight * remaining, reached)


@kernel
def remaining_cost(estimate: Estimate, i: int, j: int, k: int) -> float:
    """Estimate the cost from a position to the goal's, in cells."""
    _, ny, nz = estimate.shape
    if len(estimate.positions) > 0:
        position = (i * ny + j) * nz + k
        if estimate.measured[position]:
            return float(estimate.positions[position])
        return estimate.beyond
    return unhindered_cost(estimate, i, j, k)


@kernel
def unhindered_cost(estimate: Estimate, i: int, j: int, k: int) -> float:
    """Return the cost from a position to the goal's without obstacles, in cells."""
    a = abs(i - estimate.goal[0])
    b = abs(j - estimate.goal[1])
    c = abs(k - estimate.goal[2])
    long = max(a, b, c)
    short = min(a, b, c)
    middle = a + b + c - long - short
    if estimate.shape[0] > 1:
        # A shortest chain moves along one, two and three axes.
        return long - middle + math.sqrt(2.0) * (middle - short) + math.sqrt(3.0) * short
    # In the plane, it combines two of the moves (1, 0), (1, 1) and (2, 1).
    knights = min(middle, long - middle)
    diagonals = middle - knights
    straights = long - 2 * knights - diagonals
    return straights + math.sqrt(2.0) * diagonals + math.sqrt(5.0) * knights


@kernel
def push(progress: Progress, key: float, cell: int) -> None:
    """Add a cell to the binary heap, in which a smaller key is nearer to the root."""
    keys = progress.keys
    queue = progress.queue
    position = progress.length[0]
    progress.length[0] += 1
    # Entries with larger keys move down, from the last place towards the root.
    while position > 0:
        parent = (position - 1) // 2
        if keys[parent] <= key:
            break
        keys[position] = keys[parent]
        queue[position] = queue[parent]
        position = parent
    keys[position] = key
    queue[position] = cell


@kernel
def pop_first(progress: Progress) -> int:
    """Remove the cell of the lowest key from the heap, and return it."""
    keys = progress.keys
    queue = progress.queue
    first: int = queue[0]
    progress.length[0] -= 1
    count = progress.length[0]
    # The last entry sinks from the root.
    key = keys[count]
    cell = queue[count]
    position = 0
    child = 1
    while child < count:
        if child + 1 < count and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[position] = keys[child]
        queue[position] = queue[child]
        position = child
        child = 2 * position + 1
    keys[position] = key
    queue[position] = cell
    return first

"""Searches over cells: shortest FREE chains, and non-BLOCKED chains with the fewest MIXED cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Bytes, Floats, Ints
from cspace.compiling import clock, jit, kernel
from cspace.map.storage import Cells, Map, Stack, cells_of, check_bytes, state_in

Costs = NDArray[np.float32]
Position = tuple[int, int, int]
GridCell = tuple[int, int, int, int]
"""Rotation cell, and position along three axes."""

GREEDY_WEIGHT: Final = 8.0
"""Weight of the remaining length if any chain will do; above 1, chains are found sooner but are longer."""

TURN_COST: Final = 4.0
"""Cost of rotating into the next rotation cell, in cells, if any chain will do; straight moves are tried first."""

MAX_DETOUR_CELLS: Final = 16.0
"""Cells by which a chain may exceed the shortest chain over positions before the heuristic weakens."""

INFINITE_PERIOD: Final = 2**30
"""Stands for the period of an axis that is not periodic."""

CELLS_PER_CLOCK_CHECK: Final = 2**11
"""Cells expanded between two looks at the clock: half a millisecond, or up to 100 ms if all memory is new."""

INITIAL_ENTRIES: Final = 4096
"""Initial capacity of the queue."""

ROUNDING_SHARE: Final = 1e-6
"""Relative difference of costs that may be single-precision rounding."""

REACHED_START, EXPANDED = 127, 128
"""Bit in ``reached_by`` of cells that were expanded."""

BUCKETS_PER_CELL: Final = 8
"""Buckets of the queue per cell of cost; within a bucket, order is ignored."""

BUCKETS: Final = 4096
"""Number of buckets. Costs beyond them share the last bucket, whose order is ignored too."""


class Graph(NamedTuple):
    """Graph of the cells of a map.

    Cells are indexed in a row, rotation cell by rotation cell, along three axes; the plane has one layer along x.

    Attributes
    ----------
    cells : ndarray of uint8, shape (n,), or TwoBits
        States of all slices in a row.
    shape : tuple of int, length 3
        Shape of a slice.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    turns : ndarray of float64, shape (rotations, n)
        Cost of rotating to each neighbor, in cells.
    moves : ndarray of int64, shape (m, 3)
        Offsets to adjacent cells, across sides first, then across edges and corners. Cells touched by a move are
        reached by earlier moves.
    steps, lengths : ndarray, shape (m,)
        Change of the cell's index, and length in cells, of each move.
    parts : ndarray of int64, shape (m,)
        Bit mask of the moves to the cells that each move touches.
    periods : tuple of int, length 3
        Number of cells along each periodic axis, next to each other at the ends; :data:`INFINITE_PERIOD` for other
        axes.
    """

    cells: Cells
    shape: Position
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Ints
    steps: Ints
    lengths: Floats
    parts: Ints
    periods: Position

    @classmethod
    def of(cls, states: Stack, slice_of: Ints, neighbors: Ints, turns: Floats, periodic_axes: Sequence[bool]) -> Graph:
        """Build from states by slice, of shape (slices, ...)."""
        dim = states.ndim - 1
        nx, ny, nz = (1,) * (3 - dim) + tuple(states.shape[1:])
        offsets = [(-1, 0, 1)] * dim
        moves = np.stack(np.meshgrid(*[[0]] * (3 - dim), *offsets, indexing="ij"), axis=-1).reshape(-1, 3)
        moves = moves[np.argsort(np.abs(moves).sum(axis=1), kind="stable")][1:]
        touched = ((moves == 0) | (moves == moves[:, None])).all(axis=2)
        parts, steps = (touched << np.arange(len(moves))).sum(axis=1), (moves * (ny * nz, nz, 1)).sum(axis=1)
        periodic = (False,) * (3 - dim) + tuple(periodic_axes)
        i, j, k = (n if wraps else INFINITE_PERIOD for n, wraps in zip((nx, ny, nz), periodic, strict=True))
        cells, lengths = cells_of(states), np.linalg.norm(moves, axis=1)
        return cls(cells, (nx, ny, nz), slice_of, neighbors, turns, moves, steps, lengths, parts, (i, j, k))

    def chain(
        self, start: Ints, goal: Ints, until: float, *, greed: float = 1.0, free_positions: Graph | None = None
    ) -> Ints:
        """Return the shortest chain of FREE cells from start to goal.

        Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``. The chain has shape (n, 1 + d), where n is 0 if none
        exists. If ``greed`` is above 1, return a longer chain sooner. ``free_positions`` has the positions that are
        FREE at any rotation; lengths of shortest chains over them are the heuristic. Raises TimeoutError after
        ``until``, in seconds of :data:`cspace.compiling.clock`.
        """
        shape, size, bound = (len(self.slice_of), *self.shape[4 - len(start) :]), math.prod(self.shape), 0.0
        start_index, goal_index = (int(np.ravel_multi_index(tuple(cell), shape)) for cell in (start, goal))
        costs = np.empty(0, dtype=np.float32)
        if start_index == goal_index:
            return start[None]
        if free_positions is not None:
            task = Task(goal_index % size, start_index % size, 1.0, MAX_DETOUR_CELLS, costs, bound, np.zeros(1))
            costs = free_positions._search(task, until).cost
            bound = float(costs[start_index % size]) + MAX_DETOUR_CELLS
        task = Task(start_index, goal_index, greed, 0.0, costs, bound, self._rotation_costs(goal[0]))
        trace, indices = self._search(task, until), np.empty(0, dtype=np.int64)
        indices = np.empty(trace_back(self, trace.reached_by, start_index, goal_index, indices), dtype=np.int64)
        trace_back(self, trace.reached_by, start_index, goal_index, indices)
        return np.stack(np.unravel_index(indices, shape), axis=-1)

    def _search(self, task: Task, until: float) -> Trace:
        """Expand cells until the search ends, growing the queue as needed."""
        trace = Trace.of(len(self.slice_of) * math.prod(self.shape), task.start, task.greed > 1.0)
        while not expand_cells(self, task, trace):
            check_deadline(until)
            if trace.state[3] + len(self.moves) + self.neighbors.shape[1] >= len(trace.next_entry):
                waiting, next_entry, costs = (np.concatenate([each, each]) for each in trace[3:6])
                trace = trace._replace(waiting=waiting, next_entry=next_entry, costs=costs)
        return trace

    def _rotation_costs(self, goal: int) -> Floats:
        """Return the minimum cost of rotating from each rotation cell to ``goal``."""
        costs, previous = np.full(len(self.slice_of), np.inf), np.empty(0)
        costs[goal] = 0.0
        while self.neighbors.size and not np.array_equal(costs, previous):
            previous = costs
            neighbor_costs = np.where(self.neighbors < 0, np.inf, costs[self.neighbors] + self.turns)
            costs = np.minimum(costs, neighbor_costs.min(axis=1))
        return costs


class Task(NamedTuple):
    """Parameters of a search.

    Attributes
    ----------
    start, goal : int
        Indices of cells.
    greed : float
        Weight of the remaining length relative to the length so far.
    margin : float
        Expand cells on chains up to this many cells longer than the shortest chain.
    position_costs : ndarray of float32
        Length of the shortest chain from each position to the goal's, at any rotation; zero where not computed. Empty
        if unknown.
    min_length : float
        Lower bound of the length of chains over positions that were not computed.
    rotation_costs : ndarray of float64, shape (rotations,)
        Minimum cost of rotating from each rotation cell to the goal's.
    """

    start: int
    goal: int
    greed: float
    margin: float
    position_costs: Costs
    min_length: float
    rotation_costs: Floats


class Trace(NamedTuple):
    """State of a search.

    Attributes
    ----------
    cost : ndarray of float32, shape (cells,)
        Lowest cost found of a chain to each cell; empty in greedy searches. Like ``reached_by``, it takes memory only
        where written.
    reached_by : ndarray of uint8, shape (cells,)
        How each cell was reached: 0 if not at all, else 1 plus the index of the move that led there, or of the rotation
        that leads back; with the bit :data:`EXPANDED` once the cell was expanded.
    buckets : ndarray of int64, shape (BUCKETS,)
        First entry of each bucket of the queue; -1 if empty.
    waiting, next_entry, costs : ndarray of int64, int64 and float64, shape (n,)
        Cell of each entry, next entry of its bucket or of the free list, and cost at which it was queued.
    state : ndarray of float64, shape (5,)
        Number of waiting entries, lowest bucket, first free entry, number of entries used, and cost of the goal.
    """

    cost: Costs
    reached_by: Bytes
    buckets: Ints
    waiting: Ints
    next_entry: Ints
    costs: Floats
    state: Floats

    @classmethod
    def of(cls, cells: int, start: int, greedy: bool) -> Trace:
        """Return a trace of ``cells`` cells with only the start queued."""
        cost, reached_by = np.zeros(0 if greedy else cells, dtype=np.float32), np.zeros(cells, dtype=np.uint8)
        buckets, waiting, next_entry = (
            np.full(BUCKETS, -1),
            np.full(INITIAL_ENTRIES, start),
            np.full(INITIAL_ENTRIES, -1),
        )
        reached_by[start], buckets[0] = REACHED_START, 0
        return cls(
            cost,
            reached_by,
            buckets,
            waiting,
            next_entry,
            np.zeros(INITIAL_ENTRIES),
            np.array([1.0, 0.0, -1.0, 1.0, np.inf]),
        )


def check_deadline(until: float) -> None:
    """Raise TimeoutError after ``until``, in seconds of :data:`cspace.compiling.clock`."""
    if clock() > until:
        raise TimeoutError


@kernel
def _split_index(graph: Graph, cell: int) -> GridCell:
    """Split a cell's index into its rotation cell and position."""
    nx, ny, nz = graph.shape
    # Divisions dominate the time; in the plane, or with one rotation, one division is enough.
    rotation = cell // (nx * ny * nz) if cell >= nx * ny * nz else 0
    cell -= rotation * nx * ny * nz
    i = cell // (ny * nz) if cell >= ny * nz else 0
    cell -= i * ny * nz
    return rotation, i, cell // nz, cell % nz


@kernel
def _apply_move(graph: Graph, at: GridCell, move: int, sign: int) -> Position:
    """Return the position that a move leads to, or from if ``sign`` is -1.

    Positions wrap around periodic axes; -1 along other axes means that there is no cell.
    """
    (nx, ny, nz), moves = graph.shape, graph.moves
    i, j, k = at[1] + sign * moves[move, 0], at[2] + sign * moves[move, 1], at[3] + sign * moves[move, 2]
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return i, j, k
    return _wrap(i, nx, graph.periods[0]), _wrap(j, ny, graph.periods[1]), _wrap(k, nz, graph.periods[2])


@kernel
def _wrap(i: int, count: int, ring: int) -> int:
    """Wrap an index along a periodic axis; return -1 if it is past the end of another axis."""
    return i % count if ring == count else i if i < count else -1


@kernel
def _free_moves(graph: Graph, first: int, at: GridCell) -> int:
    """Return a bit mask of the moves from a cell that touch FREE cells only.

    ``first`` is the index of the first cell of the slice.
    """
    (nx, ny, nz), (_, i, j, k), position = graph.shape, at, (at[1] * graph.shape[1] + at[2]) * graph.shape[2] + at[3]
    free, allowed, x_layers = 0, 0, 1 if len(graph.moves) > 8 else 0
    if x_layers <= i < nx - x_layers and 0 < j < ny - 1 and 0 < k < nz - 1:
        for move in range(len(graph.moves)):
            free |= (state_in(graph.cells, first + position + graph.steps[move]) == FREE) << move
    else:
        for move in range(len(graph.moves)):
            u, v, w = _apply_move(graph, at, move, 1)
            if min(u, v, w) >= 0:
                free |= (state_in(graph.cells, first + (u * ny + v) * nz + w) == FREE) << move
    if free == (1 << len(graph.moves)) - 1:
        return free
    for move in range(len(graph.moves)):
        allowed |= ((free & graph.parts[move]) == graph.parts[move]) << move
    return allowed


@kernel
def _empty_grid_distance(graph: Graph, a: Position, b: Position) -> float:
    """Return the length of the shortest chain of moves on an empty grid."""
    i, j, k = abs(a[0] - b[0]), abs(a[1] - b[1]), abs(a[2] - b[2])
    i, j, k = min(i, graph.periods[0] - i), min(j, graph.periods[1] - j), min(k, graph.periods[2] - k)
    largest, smallest = max(i, j, k), min(i, j, k)
    between = i + j + k - largest - smallest
    return largest + (math.sqrt(2.0) - 1.0) * between + (math.sqrt(3.0) - math.sqrt(2.0)) * smallest


@kernel
def _heuristic(graph: Graph, task: Task, start: Position, goal: Position, rotation: int, at: Position) -> float:
    """Return a lower bound of the cost from a cell to the goal."""
    remaining = _empty_grid_distance(graph, at, goal)
    if len(task.position_costs):
        exact = task.position_costs[(at[0] * graph.shape[1] + at[1]) * graph.shape[2] + at[2]]
        fallback = task.min_length - _empty_grid_distance(graph, at, start)
        remaining = max(remaining, min(exact, fallback) if exact > 0.0 or at == goal else fallback)
    return remaining + float(task.rotation_costs[rotation])


@kernel
def expand_cells(graph: Graph, task: Task, trace: Trace) -> bool:
    """Expand queued cells; return True once the search is complete.

    Return False if the queue is full or a clock check is due; the next call goes on from there. The heuristic never
    overestimates (P. Hart, N. Nilsson and B. Raphael, "A formal basis for the heuristic determination of minimum cost
    paths", 1968), except in greedy searches, which reach each cell only once.
    """
    size, straight = graph.shape[0] * graph.shape[1] * graph.shape[2], len(graph.moves)
    cost_to, reached_by, buckets, waiting, next_entry, costs, state = trace
    n_waiting, lowest, free_entry, n_used = int(state[0]), int(state[1]), int(state[2]), int(state[3])
    goal_cost = state[4]
    degree, greedy = straight + graph.neighbors.shape[1], task.greed > 1.0
    _, si, sj, sk = _split_index(graph, task.start % size)
    _, gi, gj, gk = _split_index(graph, task.goal % size)
    for _ in range(CELLS_PER_CLOCK_CHECK):
        # The queue has a circle of buckets by cost instead of a heap, so the next entry is found without comparisons
        # (R. Dial, "Algorithm 360: Shortest-path forest with topological ordering", 1969).
        while n_waiting > 0 and buckets[lowest % BUCKETS] < 0:
            lowest += 1
        if n_waiting == 0 or lowest >= BUCKETS_PER_CELL * (goal_cost + task.margin):
            return True
        if n_used + degree >= len(next_entry):
            break
        # The entry returns to the free list, so memory grows with the front only.
        entry = buckets[lowest % BUCKETS]
        cell, buckets[lowest % BUCKETS], next_entry[entry] = waiting[entry], next_entry[entry], free_entry
        n_waiting, free_entry = n_waiting - 1, entry
        # If a shorter chain to a queued cell is found, the cell is queued again and the cheaper entry comes first. So
        # a later entry may belong to an expanded cell.
        if reached_by[cell] & EXPANDED:
            continue
        reached_by[cell] |= EXPANDED
        at, cost_here = _split_index(graph, cell), costs[entry] if greedy else float(cost_to[cell])
        rotation, i, j, k = at
        allowed = _free_moves(graph, graph.slice_of[rotation] * size, at)
        for move in range(degree):
            next_rotation, u, v, w, arrival = rotation, i, j, k, move
            if move < straight:
                if not (allowed >> move) & 1:
                    continue
                u, v, w = _apply_move(graph, at, move, 1)
                cost = cost_here + graph.lengths[move]
            else:
                next_rotation, arrival = graph.neighbors[rotation, move - straight], straight
                if next_rotation < 0:
                    continue
                cost = cost_here + graph.turns[rotation, move - straight]
            position = (u * graph.shape[1] + v) * graph.shape[2] + w
            next_cell = next_rotation * size + position
            if reached_by[next_cell] and (greedy or cost >= cost_to[next_cell] * (1.0 - ROUNDING_SHARE)):
                continue
            if move >= straight:
                if state_in(graph.cells, graph.slice_of[next_rotation] * size + position) != FREE:
                    continue
                # Store the column in which the next rotation cell has this one as neighbor, for tracing back.
                while graph.neighbors[next_rotation, arrival - straight] != rotation:
                    arrival += 1
            remaining = _heuristic(graph, task, (si, sj, sk), (gi, gj, gk), next_rotation, (u, v, w))
            if cost + remaining >= goal_cost + task.margin:
                continue
            reached_by[next_cell] = arrival + 1
            if not greedy:
                cost_to[next_cell] = cost
            if next_cell == task.goal:
                goal_cost = cost
                if greedy:
                    return True
            if free_entry >= 0:
                entry, free_entry = free_entry, next_entry[free_entry]
            else:
                entry, n_used = n_used, n_used + 1
            # Costs only rise, except in greedy searches, where a falling cost merely disturbs the order of buckets.
            bucket = min(int(BUCKETS_PER_CELL * (cost + task.greed * remaining)), lowest + BUCKETS - 1)
            waiting[entry], costs[entry], next_entry[entry] = next_cell, cost, buckets[bucket % BUCKETS]
            buckets[bucket % BUCKETS] = entry
            n_waiting, lowest = n_waiting + 1, min(lowest, bucket)
    state[0], state[1], state[2], state[3], state[4] = n_waiting, lowest, free_entry, n_used, goal_cost
    return False


@kernel
def trace_back(graph: Graph, reached_by: Bytes, start: int, goal: int, cells: Ints) -> int:
    """Count the cells from start to goal, and write as many as fit."""
    cell, count, straight = goal, 0, len(graph.moves)
    while reached_by[cell]:
        count += 1
        if count <= len(cells):
            cells[len(cells) - count] = cell
        if cell == start:
            break
        at, move = _split_index(graph, cell), int(reached_by[cell] & (EXPANDED - 1)) - 1
        rotation, i, j, k = at
        if move < straight:
            i, j, k = _apply_move(graph, at, move, -1)
        else:
            rotation = graph.neighbors[rotation, move - straight]
        cell = ((rotation * graph.shape[0] + i) * graph.shape[1] + j) * graph.shape[2] + k
    return count


FRONT_START, EXCLUDED = 254, 255
"""Marks an excluded cell in ``reached_by`` of :func:`trace_chain`."""

FIRST_ROTATION_STEP = 7
"""Index of the first step that rotates."""


@jit
def trace_chain(cells: Cells, slice_of: Ints, neighbors: Ints, start: Ints, goal: Ints, reached_by: Bytes) -> bool:
    """Search a chain without BLOCKED cells and with the fewest MIXED cells.

    Cells are ``(rotation, x, y, z)``; in the plane x has a single cell. The search is breadth first: it expands all
    FREE cells in reach before the next MIXED ones, and holds only the front. ``reached_by`` is 0, or EXCLUDED, on
    input; it receives the step by which each cell was reached.
    """
    _, nx, ny, nz = reached_by.shape
    size, n_neighbors = nx * ny * nz, neighbors.shape[1]
    reached = reached_by.reshape(-1)
    start_cell = ((start[0] * nx + start[1]) * ny + start[2]) * nz + start[3]
    if state_in(cells, slice_of[start[0]] * size + start_cell % size) == BLOCKED:
        return False
    goal_cell = ((goal[0] * nx + goal[1]) * ny + goal[2]) * nz + goal[3]
    # Breadth-first search with steps of cost 0 (into FREE cells) and 1 (into MIXED cells). MIXED cells wait in
    # ``later``, which becomes the front when no FREE cell is left. The cost of a step depends only on the cell entered,
    # so the first way into a cell is a cheapest one.
    front, next_front, later = [start_cell], [start_cell], [start_cell]
    next_front.clear()
    later.clear()
    reached[start_cell] = FRONT_START
    strides = (ny * nz, nz, 1)
    while len(front) > 0:
        for cell in front:
            if cell == goal_cell:
                return True
            r, position = cell // size, cell % size
            at = (position // (ny * nz), position // nz % ny, position % nz)
            for step in range(1, FIRST_ROTATION_STEP + n_neighbors):
                next_rotation, next_position = r, position
                if step < FIRST_ROTATION_STEP:
                    axis, up = (step - 1) // 2, (step - 1) % 2
                    if at[axis] == (reached_by.shape[1 + axis] - 1 if up else 0):
                        continue
                    next_position += strides[axis] if up else -strides[axis]
                else:
                    next_rotation = neighbors[r, step - FIRST_ROTATION_STEP]
                    if next_rotation < 0:
                        continue
                next_cell = next_rotation * size + next_position
                if reached[next_cell] != 0:
                    continue
                state = state_in(cells, slice_of[next_rotation] * size + next_position)
                if state != FREE and state != MIXED:
                    continue
                reached[next_cell] = step
                if step >= FIRST_ROTATION_STEP:
                    # Store the column in which the next rotation cell has this one as neighbor, for tracing back.
                    for trace_back in range(n_neighbors):
                        if neighbors[next_rotation, trace_back] == r:
                            reached[next_cell] = FIRST_ROTATION_STEP + trace_back
                if state == FREE:
                    next_front.append(next_cell)
                else:
                    later.append(next_cell)
        front, next_front = next_front, front
        next_front.clear()
        if len(front) == 0:
            front, later = later, front
    return False


def open_chain(map_: Map, neighbors: Ints, start: Ints, goal: Ints, excluded: Bools | None = None) -> Ints:
    """Return a chain of FREE and MIXED cells with the fewest MIXED cells.

    Each cell shares a side with the next. If a map proves neither that a path exists nor that none does, look for a
    path along this chain, with ``exact=True``. Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid.
    The chain has shape (n, 1 + d), from start to goal; n is 0 if none exists. ``neighbors``, shape (rotations, n), are
    the adjacent rotation cells, padded with -1. Cells that are ``closed``, of the shape of all cells, are excluded.
    """
    shape, slice_of = map_.states.shape[1:], map_.slice_of
    position_costs = (1,) * (3 - len(shape))  # the plane is space with one layer
    check_bytes(len(slice_of) * math.prod(shape))
    reached_by = np.zeros((len(slice_of), *position_costs, *shape), dtype=np.uint8)
    if excluded is not None:
        reached_by[excluded.reshape(reached_by.shape)] = EXCLUDED
    start_cell, goal_cell = (
        np.array([cell[0], *[0] * len(position_costs), *cell[1:]], dtype=np.int64) for cell in (start, goal)
    )
    if not trace_chain(map_.cells, slice_of, neighbors, start_cell, goal_cell, reached_by):
        return np.empty((0, 1 + len(shape)), dtype=np.int64)
    cell, cells = goal_cell.tolist(), [goal_cell.tolist()]
    while (step := int(reached_by[tuple(cell)])) != FRONT_START:
        if step < FIRST_ROTATION_STEP:
            cell[1 + (step - 1) // 2] -= 2 * ((step - 1) % 2) - 1
        else:
            cell[0] = int(neighbors[cell[0], step - FIRST_ROTATION_STEP])
        cells.append(cell.copy())
    rows = np.array(cells[::-1], dtype=np.int64)
    return np.delete(rows, 1, axis=1) if position_costs else rows

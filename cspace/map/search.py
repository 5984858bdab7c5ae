"""Searches over the cells of a map: shortest FREE chains, and chains with the fewest MIXED cells.

A chain is a sequence of adjacent cells.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Bytes, Floats, Ints
from cspace.compiling import clock, kernel
from cspace.map.storage import Cells, Map, Stack, cells_of, check_bytes, row_in, state_in
from cspace.rotations import Rotations
from cspace.rotations.base import METRES_PER_RADIAN
from cspace.rotations.records import jit

Costs = NDArray[np.float32]
Levels = NDArray[np.uint16]
"""Distances from cells to the nearest one that is not FREE, in 64ths of a cell."""

Position = tuple[int, int, int]
GridCell = tuple[int, int, int, int]
"""Rotation cell, and position along three axes."""

SHORT_WEIGHT: Final = 1.1
"""Weight of the remaining length in searches for short chains; exactly shortest chains take most of the time."""

GUIDE_WEIGHT: Final = 1.05
"""Largest weight of the remaining length in searches of guides, whose costs must be nearly the lowest."""

GREEDY_WEIGHT: Final = 8.0
"""Weight of the remaining length in searches for any chain, on maps too large to store the cost of each cell."""

MAX_COSTED_CELLS: Final = 2**29
"""Largest number of cells of a map for which a search stores costs, at four bytes each."""

MAX_DETOUR_CELLS: Final = 4.0
"""Cells by which chains of a guide may exceed the shortest chain before its estimates get rough."""

GUIDE_BLOCKS: Final = 2, 4
"""Cells along each side of the blocks of the guides of a search, finest guide first."""

ROTATIONS_PER_GROUP: Final = 4
"""Number of neighboring yaw cells that the finer guide of a search merges."""

INFINITE_PERIOD: Final = 2**30
"""Period, in cells, that stands for an axis without a period."""

CELLS_PER_CLOCK_CHECK: Final = 2**11
"""Cells expanded between two checks of the time limit: half a millisecond, or up to 100 ms if all memory is new."""

INITIAL_ENTRIES: Final = 4096
"""Initial capacity of the queue of a search; it doubles as needed."""

ROUNDING_SHARE: Final = 1e-6
"""Relative difference of costs that may come from single-precision rounding."""

REACHED_START, EXPANDED = 127, 128
"""Value in ``reached_by`` of the start, and the bit of cells that were expanded."""

BUCKETS_PER_CELL: Final = 8
"""Buckets of the queue per cell of cost; the order within a bucket is ignored."""

BUCKETS: Final = 4096
"""Number of buckets. Costs beyond them share the last bucket."""


WAITING_ENTRIES, LOWEST_USED_BUCKET, FIRST_FREE_ENTRY, ENTRIES_IN_USE, GOAL_COST = range(5)
"""Indices into :attr:`Trace.state`."""


class CellFactors(NamedTuple):
    """Factors of the cost of moves in each cell, by its level of clearance.

    Attributes
    ----------
    levels : ndarray of uint16, shape (n,)
        Level of each cell of all slices in a row; empty if all factors are 1.
    of_level : ndarray of float32, shape (65536,)
        Factor at each level, 1 or above; higher levels have no higher factors.
    """

    levels: Levels
    of_level: Costs


NO_FACTORS: Final = CellFactors(np.empty(0, dtype=np.uint16), np.empty(0, dtype=np.float32))
"""Factors of the plain length."""


class Graph(NamedTuple):
    """Cells of a map and the moves between them.

    Cells are numbered rotation cell by rotation cell, along three axes. A map of the plane has one layer along x.

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
        Offsets to near cells, shortest first: across sides, edges and corners, and in a plane without periodic axes
        also two cells along one axis and one along the other. Earlier moves reach the cells that a move touches.
    reach : tuple of int, length 3
        Largest offset along each axis.
    steps, lengths : ndarray, shape (m,)
        Change of the cell's index, and length in cells, of each move.
    parts : ndarray of int64, shape (m,)
        Bit mask of the moves to the cells that each move touches.
    periods : tuple of int, length 3
        Number of cells along each periodic axis, next to each other at the ends; :data:`INFINITE_PERIOD` for other
        axes.
    factors : CellFactors
        The cost of a move or rotation is its length, times the mean factor of the cells at its ends.
    """

    cells: Cells
    shape: Position
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Ints
    reach: Position
    steps: Ints
    lengths: Floats
    parts: Ints
    periods: Position
    factors: CellFactors = NO_FACTORS

    @classmethod
    def of(
        cls,
        states: Stack,
        slice_of: Ints,
        neighbors: Ints,
        turns: Floats,
        periodic_axes: Sequence[bool],
        factors: CellFactors = NO_FACTORS,
    ) -> Graph:
        """Build the graph of a map from its states.

        ``states`` has shape (slices, ...); the other arguments are as the attributes.
        """
        dim = states.ndim - 1
        nx, ny, nz = (1,) * (3 - dim) + tuple(states.shape[1:])
        # Around a short periodic axis, a move of two cells would be more than half a turn.
        reach = (1, 1, 1) if dim == 3 else (0, 1, 1) if any(periodic_axes) else (0, 2, 2)
        moves, parts = _moves_within(reach)
        steps = (moves * (ny * nz, nz, 1)).sum(axis=1)
        periodic = (False,) * (3 - dim) + tuple(periodic_axes)
        i, j, k = (n if wraps else INFINITE_PERIOD for n, wraps in zip((nx, ny, nz), periodic, strict=True))
        cells, lengths = cells_of(states), np.linalg.norm(moves, axis=1)
        shape, periods = (nx, ny, nz), (i, j, k)
        return cls(cells, shape, slice_of, neighbors, turns, moves, reach, steps, lengths, parts, periods, factors)

    def chain(self, start: Ints, goal: Ints, until: float, *, greed: float = 1.0, guides: Sequence[Guide] = ()) -> Ints:
        """Find a short chain of FREE cells.

        It leads from start to goal. Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``. ``greed`` is the weight
        of the remaining length; above 1, the search is faster and chains are longer. ``guides`` are coarser graphs,
        finest first. At weight 1, the chain is the shortest without guides, or with one guide whose blocks are single
        cells.

        Returns shape (n, 1 + d), where n is 0 if no chain exists. Raises TimeoutError after ``until``, in seconds of
        :data:`cspace.compiling.clock`.
        """
        shape = (len(self.slice_of), *self.shape[4 - len(start) :])
        start_index, goal_index = (int(np.ravel_multi_index(tuple(cell), shape)) for cell in (start, goal))
        if start_index == goal_index:
            return start[None]
        heuristic = self._heuristic(start, goal, guides, until, min(greed, GUIDE_WEIGHT))
        trace = self._search(Task(start_index, goal_index, greed, 0.0, heuristic), until)
        # The first trace counts the cells of the chain, the second writes them.
        length = trace_back(self, trace.reached_by, start_index, goal_index, np.empty(0, dtype=np.int64))
        indices = np.empty(length, dtype=np.int64)
        trace_back(self, trace.reached_by, start_index, goal_index, indices)
        return np.stack(np.unravel_index(indices, shape), axis=-1)

    def _heuristic(self, start: Ints, goal: Ints, guides: Sequence[Guide], until: float, greed: float) -> Heuristic:
        """Compute the estimate of the cost to the goal.

        The first guide is searched from the goal to the start, itself guided by the coarser ones. ``greed`` is the
        weight of that search's remaining length. Without guides, the estimate is the distance on an empty grid.
        """
        rotation_costs, no_costs = self._rotation_costs(goal[0]), np.empty(0, dtype=np.float32)
        if not guides:
            same = np.zeros_like(rotation_costs)
            return Heuristic(no_costs, (1, 1, 1), 1, 0.0, self.slice_of, rotation_costs, same)
        guide, *coarser = guides
        from_cell, to_cell = (np.array([guide.group_of[cell[0]], *(cell[1:] // guide.block)]) for cell in (goal, start))
        shape = (len(guide.graph.slice_of), *guide.graph.shape[4 - len(start) :])
        from_index, to_index = (int(np.ravel_multi_index(tuple(cell), shape)) for cell in (from_cell, to_cell))
        relative = [each.relative_to(guide) for each in coarser]
        estimate = guide.graph._heuristic(from_cell, to_cell, relative, until, greed)
        task = Task(from_index, to_index, greed, MAX_DETOUR_CELLS, estimate)
        costs = guide.graph._search(task, until).cost
        min_cost = guide.block * (float(costs[to_index]) + MAX_DETOUR_CELLS)
        rest = rotation_costs if shape[0] == 1 else np.zeros_like(rotation_costs)
        return Heuristic(costs, guide.graph.shape, guide.block, min_cost, guide.group_of, rotation_costs, rest)

    def _search(self, task: Task, until: float) -> Trace:
        """Expand cells until the search ends.

        The queue grows as needed. Raises TimeoutError after ``until``.
        """
        trace = Trace.of(len(self.slice_of) * math.prod(self.shape), task.start, task.greed >= GREEDY_WEIGHT)
        while not expand_cells(self, task, trace):
            check_deadline(until)
            if trace.state[ENTRIES_IN_USE] + len(self.moves) + self.neighbors.shape[1] >= len(trace.next_entry):
                waiting, next_entry, costs = (np.concatenate([each, each]) for each in trace[3:6])
                trace = trace._replace(waiting=waiting, next_entry=next_entry, costs=costs)
        return trace

    def _rotation_costs(self, goal: int) -> Floats:
        """Compute the lowest costs of rotating to ``goal``.

        The costs are those from each rotation cell to ``goal``, in cells, shape (rotations,).
        """
        costs, previous = np.full(len(self.slice_of), np.inf), np.empty(0)
        costs[goal] = 0.0
        while self.neighbors.size and not np.array_equal(costs, previous):
            previous = costs
            neighbor_costs = np.where(self.neighbors < 0, np.inf, costs[self.neighbors] + self.turns)
            costs = np.minimum(costs, neighbor_costs.min(axis=1))
        return costs


@cache
def _moves_within(reach: Position) -> tuple[Ints, Ints]:
    """List the moves to near cells, shortest first.

    ``reach`` is the largest offset along each axis. The offsets of a move have no common divisor. Returns the moves,
    shape (m, 3), and for each a bit mask of the moves to the cells that it touches, shape (m,).
    """
    offsets = product(*(range(-each, each + 1) for each in reach))
    moves = sorted((each for each in offsets if math.gcd(*each) == 1), key=lambda each: sum(x * x for x in each))
    parts = [sum(_touches(move, cell) << bit for bit, cell in enumerate(moves)) for move in moves]
    return np.array(moves), np.array(parts)


def _touches(move: tuple[int, ...], cell: tuple[int, ...]) -> bool:
    """Return True if a move touches a cell.

    The move is the segment from the center of cell (0, 0, 0) to the center of cell ``move``; the cell is closed.
    """
    enter, leave = 0.0, 1.0  # fractions of the segment between which it is in the cell
    for step, offset in zip(move, cell, strict=True):
        if step == 0 and offset != 0:
            return False
        if step != 0:
            sides = (offset - 0.5) / step, (offset + 0.5) / step
            enter, leave = max(enter, min(sides)), min(leave, max(sides))
    return enter <= leave


class Guide(NamedTuple):
    """A coarse graph that estimates distances to the goal.

    Attributes
    ----------
    graph : Graph
        Its rotation cells are groups of rotation cells of the fine graph, and its cells are blocks of cells.
    group_of : ndarray of int64, shape (rotations,)
        Group of each rotation cell of the fine graph.
    block : int
        Cells of the fine graph along each side of a block.
    """

    graph: Graph
    group_of: Ints
    block: int

    def relative_to(self, finer: Guide) -> Guide:
        """Return this guide for a finer guide's graph."""
        first_members = np.unique(finer.group_of, return_index=True)[1]
        return Guide(self.graph, self.group_of[first_members], self.block // finer.block)


class Heuristic(NamedTuple):
    """Estimate of the remaining cost to the goal.

    Attributes
    ----------
    costs : ndarray of float32
        Cost of the cells of a guide, in its own cells; zero where not computed. Empty without a guide.
    shape : tuple of int, length 3
        Shape of a slice of the guide.
    block : int
        Cells along each side of a guide's cell.
    min_cost : float
        Cost of the shortest chain that passes a cell whose cost was not computed.
    group_of : ndarray of int64, shape (rotations,)
        Rotation cell of the guide for each rotation cell.
    rotation_costs : ndarray of float64, shape (rotations,)
        Minimum cost of rotating from each rotation cell to the goal's.
    rest : ndarray of float64, shape (rotations,)
        ``rotation_costs``, or zeros if the costs of the guide contain rotations.
    """

    costs: Costs
    shape: Position
    block: int
    min_cost: float
    group_of: Ints
    rotation_costs: Floats
    rest: Floats


class Task(NamedTuple):
    """Start, goal and settings of a search.

    Attributes
    ----------
    start, goal : int
        Indices of cells.
    greed : float
        Weight of the remaining length relative to the length so far.
    margin : float
        Cells by which a chain may exceed the shortest chain and still be expanded.
    heuristic : Heuristic
    """

    start: int
    goal: int
    greed: float
    margin: float
    heuristic: Heuristic


class Trace(NamedTuple):
    """State of a search: costs, queue, and counts.

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
        """Create the trace of a new search.

        It has ``cells`` cells, and only the start is queued. A greedy search stores no costs.
        """
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


def turn_costs(rotations: Rotations, dim: int, spacing: float) -> Floats:
    """Return the cost of rotating to neighboring rotation cells.

    Costs are in cells, shape (rotations, n); `dim` is the dimension of the grid, and ``spacing`` is in metres.
    """
    centers = np.column_stack([np.zeros((len(rotations), dim)), rotations.centers])
    steps = rotations._steps_between(centers[:, None], centers[rotations._neighbors])
    return np.asarray(METRES_PER_RADIAN / spacing * np.linalg.norm(steps, axis=-1))


class Coarse:
    """Lowest state in each block of a map.

    A block holds cells of several rotations: it has ``block`` cells along each side, and a group of rotation cells.

    Parameters
    ----------
    cells : Cells
        States of all slices in a row.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    shape : sequence of int
        Shape of a slice.
    group_of : ndarray of int64, shape (rotations,)
        Group of each rotation cell.
    block : int
        Cells along each side of a block.

    Attributes
    ----------
    states : ndarray of uint8, shape (groups, ...)
        FREE if any cell of the block is at any rotation of the group. They follow changes of the map.
    """

    def __init__(self, cells: Cells, slice_of: Ints, shape: Sequence[int], group_of: Ints, block: int) -> None:
        self.group_of, self.block, self._cells = group_of, block, cells
        i, j, k = (1,) * (3 - len(shape)) + tuple(shape)
        self._shape = i, j, k
        groups = [np.unique(slice_of[group_of == group]) for group in range(int(group_of.max()) + 1)]
        self._first = np.cumsum([0, *map(len, groups)])
        self._slices = np.concatenate(groups)
        self.states = np.empty((len(groups), *(-(-n // block) for n in shape)), dtype=np.uint8)
        self._write(np.array([0, 0, 0, *(n - 1 for n in self._shape)]))

    def refresh(self, boxes: Ints) -> None:
        """Recompute the states around changes.

        ``boxes``, shape (slices, 6), has the box of changed cells of each slice: lowest and highest cell.
        """
        self._write(np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)]))

    def highest(self, levels: Levels) -> Levels:
        """Return the highest level in each block, in a row; ``levels`` has shape (slices, ...)."""
        rows = []
        for first, stop in itertools.pairwise(self._first.tolist()):
            top = levels[self._slices[first]]
            for s in self._slices[first + 1 : stop]:
                top = np.maximum(top, levels[s])
            for axis, count in enumerate(levels.shape[1:]):
                top = np.maximum.reduceat(top, range(0, count, self.block), axis=axis)
            rows.append(top.reshape(-1))
        return np.concatenate(rows)

    def _write(self, box: Ints) -> None:
        """Recompute the states in a box of cells.

        ``box``, shape (6,), has the lowest and the highest cell.
        """
        layered = self.states.reshape(len(self.states), *(-(-n // self.block) for n in self._shape))
        write_lowest(self._cells, self._shape, self._first, self._slices, self.block, box // self.block, layered)


class Guides:
    """Coarse copies of a map that guide searches.

    They follow changes of the map.

    Parameters
    ----------
    states : Stack
        States by slice.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    turns : ndarray of float64, shape (rotations, n)
        Cost of rotating to each neighbor, in cells.
    """

    def __init__(self, states: Stack, slice_of: Ints, neighbors: Ints, turns: Floats) -> None:
        count, shape, dim = len(slice_of), states.shape[1:], states.ndim - 1
        # Only yaws, which lie on a ring, are grouped; the coarser guide has one group.
        order = np.arange(count)
        is_ring = np.array_equal(neighbors, np.column_stack([order - 1, order + 1]) % count)
        groups = count // ROTATIONS_PER_GROUP if is_ring else 1
        group_of = order * groups // count if groups > 2 else np.zeros_like(order)
        each = (group_of, GUIDE_BLOCKS[0]), (np.zeros_like(order), GUIDE_BLOCKS[1])
        self._levels = [Coarse(cells_of(states), slice_of, shape, *level) for level in each]
        self._turn, self._dim = float(turns.max(initial=0.0)) * count, dim
        self._highest: tuple[Levels | None, list[Levels]] = None, []

    def refresh(self, boxes: Ints) -> None:
        """Recompute the copies around changes.

        ``boxes``, shape (slices, 6), has the box of changed cells of each slice: lowest and highest cell.
        """
        for level in self._levels:
            level.refresh(boxes)

    def all(self, levels: Levels | None = None, of_level: Costs = NO_FACTORS.of_level) -> list[Guide]:
        """List the guides, finest first.

        With ``levels`` of clearance, shape (slices, ...), the factors of each block are those of its highest level.
        """
        if levels is None:
            return [self._guide(level, NO_FACTORS) for level in self._levels]
        if self._highest[0] is not levels:
            self._highest = levels, [level.highest(levels) for level in self._levels]
        pairs = zip(self._levels, self._highest[1], strict=True)
        return [self._guide(level, CellFactors(highest, of_level)) for level, highest in pairs]

    def _guide(self, level: Coarse, factors: CellFactors) -> Guide:
        """Return the guide of a coarse copy."""
        count = len(level.states)
        order = np.arange(count)
        neighbors = np.column_stack([order - 1, order + 1]) % count if count > 1 else np.empty((1, 0), dtype=np.int64)
        turns = np.full(neighbors.shape, self._turn / (count * level.block))
        graph = Graph.of(level.states, order, neighbors, turns, [False] * self._dim, factors)
        return Guide(graph, level.group_of, level.block)


@jit
def write_lowest(
    cells: Cells, shape: Position, first: Ints, slices: Ints, block: int, box: Ints, lowest: Bytes
) -> None:
    """Write the lowest state of blocks in a box.

    Group g has ``slices[first[g]:first[g + 1]]``; ``shape`` is the shape of a slice. `box`, shape (6,), has the lowest
    and the highest block. ``lowest`` has shape (groups, x, y, z).
    """
    nx, ny, nz = shape
    width = 64 // block * block
    for group in range(len(first) - 1):
        for x in range(box[0], box[3] + 1):
            for y in range(box[1], box[4] + 1):
                for k in range(box[2] * block, min((box[5] + 1) * block, nz), width):
                    # Words have a bit for each cell of a row. A bit stays set if no row of the blocks clears it.
                    count = min(width, nz - k)
                    not_free = blocked = ~np.uint64(0)
                    for s in slices[first[group] : first[group + 1]]:
                        for i in range(x * block, min((x + 1) * block, nx)):
                            for j in range(y * block, min((y + 1) * block, ny)):
                                row = ((s * nx + i) * ny + j) * nz + k
                                row_not_free, row_blocked = row_in(cells, row, count)
                                not_free, blocked = not_free & row_not_free, blocked & row_blocked
                        if not_free == 0:
                            break
                    # Each block along z has `block` bits of the words.
                    mask = (np.uint64(1) << np.uint64(block)) - np.uint64(1)
                    for z in range(k // block, -(-(k + count) // block)):
                        shift = np.uint64(z * block - k)
                        free = (~not_free >> shift) & mask
                        passable = (~blocked >> shift) & mask
                        lowest[group, x, y, z] = FREE if free else MIXED if passable else BLOCKED


def check_deadline(until: float) -> None:
    """Raise TimeoutError after ``until``.

    It is in seconds of :data:`cspace.compiling.clock`.
    """
    if clock() > until:
        raise TimeoutError


@kernel
def _split_index(graph: Graph, cell: int) -> GridCell:
    """Split a cell's index into rotation cell and position."""
    nx, ny, nz = graph.shape
    # Divisions dominate the time; in the plane, or with one rotation, one division is enough.
    rotation = cell // (nx * ny * nz) if cell >= nx * ny * nz else 0
    cell -= rotation * nx * ny * nz
    i = cell // (ny * nz) if cell >= ny * nz else 0
    cell -= i * ny * nz
    return rotation, i, cell // nz, cell % nz


@kernel
def _apply_move(graph: Graph, at: GridCell, move: int, sign: int) -> Position:
    """Return the position that a move leads to.

    With ``sign`` -1, return the position that it comes from. Positions wrap around periodic axes; -1 along other axes
    means that the position is outside the grid.
    """
    (nx, ny, nz), moves = graph.shape, graph.moves
    i, j, k = at[1] + sign * moves[move, 0], at[2] + sign * moves[move, 1], at[3] + sign * moves[move, 2]
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return i, j, k
    return _wrap(i, nx, graph.periods[0]), _wrap(j, ny, graph.periods[1]), _wrap(k, nz, graph.periods[2])


@kernel
def _wrap(i: int, count: int, ring: int) -> int:
    """Wrap an index along a periodic axis.

    ``ring`` is the period, :data:`INFINITE_PERIOD` for other axes. Along these, return -1 beyond the `count` cells.
    """
    return i % count if ring == count else i if i < count else -1


@kernel
def _free_moves(graph: Graph, first: int, at: GridCell) -> int:
    """Return a bit mask of moves through FREE cells.

    All cells that such a move from cell ``at`` touches are FREE. ``first`` is the index of the first cell of the slice.
    """
    (nx, ny, nz), (_, i, j, k), position = graph.shape, at, (at[1] * graph.shape[1] + at[2]) * graph.shape[2] + at[3]
    (x_reach, y_reach, z_reach), free, allowed = graph.reach, 0, 0
    # Away from the borders, the index of each cell in reach differs by a constant.
    if x_reach <= i < nx - x_reach and y_reach <= j < ny - y_reach and z_reach <= k < nz - z_reach:
        for move in range(len(graph.moves)):
            free |= (state_in(graph.cells, first + position + graph.steps[move]) == FREE) << move
    else:
        for move in range(len(graph.moves)):
            u, v, w = _apply_move(graph, at, move, 1)
            if min(u, v, w) >= 0:
                free |= (state_in(graph.cells, first + (u * ny + v) * nz + w) == FREE) << move
    if free == (1 << len(graph.moves)) - 1:
        return free
    # A move is allowed if the moves to all cells that it touches lead to FREE cells.
    for move in range(len(graph.moves)):
        allowed |= ((free & graph.parts[move]) == graph.parts[move]) << move
    return allowed


@kernel
def _empty_grid_distance(graph: Graph, a: Position, b: Position) -> float:
    """Return the chain length between two positions without obstacles.

    The chain is the shortest sequence of moves; its length is in cells.
    """
    i, j, k = abs(a[0] - b[0]), abs(a[1] - b[1]), abs(a[2] - b[2])
    i, j, k = min(i, graph.periods[0] - i), min(j, graph.periods[1] - j), min(k, graph.periods[2] - k)
    # A shortest chain has as many moves across corners as the smallest offset allows, then edges, then sides.
    largest, smallest = max(i, j, k), min(i, j, k)
    between = i + j + k - largest - smallest
    if graph.reach[2] == 2:  # in the plane, where the smallest is zero
        long_moves = min(between, largest - between)
        straight, diagonal = largest - between - long_moves, between - long_moves
        return straight + math.sqrt(2.0) * diagonal + math.sqrt(5.0) * long_moves
    return largest + (math.sqrt(2.0) - 1.0) * between + (math.sqrt(3.0) - math.sqrt(2.0)) * smallest


@kernel
def _estimate(graph: Graph, by: Heuristic, start: Position, goal: Position, rotation: int, at: Position) -> float:
    """Estimate the remaining cost to the goal, in cells.

    ``rotation`` and ``at`` are the cell's rotation cell and position. The estimate is the cost on an empty grid, or the
    cost of the guide's cell if that is higher.
    """
    remaining = _empty_grid_distance(graph, at, goal)
    estimate = remaining + float(by.rotation_costs[rotation])
    if len(by.costs):
        i, j, k = at
        if by.block > 1:
            i, j, k = i // by.block, j // by.block, k // by.block
        guided = by.block * by.costs[((by.group_of[rotation] * by.shape[0] + i) * by.shape[1] + j) * by.shape[2] + k]
        # A chain through a cell that the guide did not cost is at least `min_cost` long.
        not_costed = by.min_cost - _empty_grid_distance(graph, at, start)
        guided = min(guided, not_costed) if guided > 0.0 or remaining < by.block else not_costed
        estimate = max(estimate, guided + float(by.rest[rotation]))
    return estimate


@kernel
def _factor_at(graph: Graph, cell: int) -> float:
    """Return the factor of a cell of the slices."""
    return float(graph.factors.of_level[graph.factors.levels[cell]])


@kernel
def expand_cells(graph: Graph, task: Task, trace: Trace) -> bool:
    """Expand queued cells; return True when done.

    Return False if the queue is full or a clock check is due; the next call goes on from there. The heuristic never
    overestimates (P. Hart, N. Nilsson and B. Raphael, "A formal basis for the heuristic determination of minimum cost
    paths", 1968), except in greedy searches, which reach each cell only once.
    """
    # Moves are numbered first; the numbers from `straight` on are rotations to the columns of `graph.neighbors`.
    size, straight = graph.shape[0] * graph.shape[1] * graph.shape[2], len(graph.moves)
    cost_to, reached_by, buckets, waiting, next_entry, costs, state = trace
    n_waiting, lowest = int(state[WAITING_ENTRIES]), int(state[LOWEST_USED_BUCKET])
    free_entry, n_used = int(state[FIRST_FREE_ENTRY]), int(state[ENTRIES_IN_USE])
    goal_cost = state[GOAL_COST]
    degree, greedy = straight + graph.neighbors.shape[1], len(cost_to) == 0
    weighs = len(graph.factors.levels) > 0
    # If estimates are not consistent, cells would be expanded very often again for little gain.
    is_rough = task.greed > 1.0 or task.heuristic.block > 1
    _, start_i, start_j, start_k = _split_index(graph, task.start % size)
    _, goal_i, goal_j, goal_k = _split_index(graph, task.goal % size)
    start, goal = (start_i, start_j, start_k), (goal_i, goal_j, goal_k)
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
        factor = _factor_at(graph, graph.slice_of[rotation] * size + cell % size) if weighs else 1.0
        for move in range(degree):
            next_rotation, next_i, next_j, next_k, arrival = rotation, i, j, k, move
            if move < straight:
                if not (allowed >> move) & 1:
                    continue
                next_i, next_j, next_k = _apply_move(graph, at, move, 1)
                step = graph.lengths[move]
            else:
                next_rotation, arrival = graph.neighbors[rotation, move - straight], straight
                if next_rotation < 0:
                    continue
                step = graph.turns[rotation, move - straight]
            position = (next_i * graph.shape[1] + next_j) * graph.shape[2] + next_k
            next_cell = next_rotation * size + position
            # Skip a cell that was reached as cheaply before.
            reached = reached_by[next_cell]
            if reached and (greedy or (is_rough and reached & EXPANDED)):
                continue
            if weighs:
                step *= 0.5 * (factor + _factor_at(graph, graph.slice_of[next_rotation] * size + position))
            cost = cost_here + step
            if reached and cost >= cost_to[next_cell] * (1.0 - ROUNDING_SHARE):
                continue
            if move >= straight:
                if state_in(graph.cells, graph.slice_of[next_rotation] * size + position) != FREE:
                    continue
                # Store the column in which the next rotation cell has this one as neighbor, for tracing back.
                while graph.neighbors[next_rotation, arrival - straight] != rotation:
                    arrival += 1
            remaining = _estimate(graph, task.heuristic, start, goal, next_rotation, (next_i, next_j, next_k))
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
    state[WAITING_ENTRIES], state[LOWEST_USED_BUCKET] = n_waiting, lowest
    state[FIRST_FREE_ENTRY], state[ENTRIES_IN_USE], state[GOAL_COST] = free_entry, n_used, goal_cost
    return False


@kernel
def trace_back(graph: Graph, reached_by: Bytes, start: int, goal: int, cells: Ints) -> int:
    """Count and write the cells from start to goal.

    ``reached_by`` is as in :class:`Trace`. Cells that do not fit into ``cells`` are not written.
    """
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
"""Values in ``reached_by`` of :func:`trace_chain` for the start and for excluded cells."""

FIRST_ROTATION_STEP = 7
"""Number of the first step that rotates; steps 1 to 6 go down and up each axis."""


@jit
def trace_chain(cells: Cells, slice_of: Ints, neighbors: Ints, start: Ints, goal: Ints, reached_by: Bytes) -> bool:
    """Search for a chain with the fewest MIXED cells.

    No cell of the chain is BLOCKED. Cells are ``(rotation, x, y, z)``; in the plane x has a single cell. The search is
    breadth first: it expands all reachable FREE cells before the next MIXED cells, and stores only the front.
    ``reached_by``, shape (rotations, x, y, z), is 0 or EXCLUDED on input, and receives the step that reached each cell.
    """
    _, nx, ny, nz = reached_by.shape
    size, n_neighbors = nx * ny * nz, neighbors.shape[1]
    reached = reached_by.reshape(-1)
    start_cell = ((start[0] * nx + start[1]) * ny + start[2]) * nz + start[3]
    if state_in(cells, slice_of[start[0]] * size + start_cell % size) == BLOCKED:
        return False
    goal_cell = ((goal[0] * nx + goal[1]) * ny + goal[2]) * nz + goal[3]
    # Steps into FREE cells cost 0, into MIXED cells 1. MIXED cells wait in ``later``, which becomes the front when no
    # FREE cell is left. The cost of a step depends only on the cell entered, so the first way into a cell is a cheapest
    # one.
    front, next_front, later = [start_cell], [start_cell], [start_cell]
    next_front.clear()
    later.clear()
    reached[start_cell] = FRONT_START
    strides = (ny * nz, nz, 1)
    while len(front) > 0:
        for cell in front:
            if cell == goal_cell:
                return True
            rotation, position = cell // size, cell % size
            at = (position // (ny * nz), position // nz % ny, position % nz)
            for step in range(1, FIRST_ROTATION_STEP + n_neighbors):
                next_rotation, next_position = rotation, position
                if step < FIRST_ROTATION_STEP:
                    axis, up = (step - 1) // 2, (step - 1) % 2
                    if at[axis] == (reached_by.shape[1 + axis] - 1 if up else 0):
                        continue
                    next_position += strides[axis] if up else -strides[axis]
                else:
                    next_rotation = neighbors[rotation, step - FIRST_ROTATION_STEP]
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
                    for column in range(n_neighbors):
                        if neighbors[next_rotation, column] == rotation:
                            reached[next_cell] = FIRST_ROTATION_STEP + column
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
    """Find a chain with the fewest MIXED cells.

    Its other cells are FREE. Each cell shares a side with the next. If a map proves neither that a path exists nor that
    none does, look for a path along this chain, with ``exact=True``.

    Parameters
    ----------
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    start, goal : ndarray of int64, shape (1 + d,)
        Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid.
    excluded : ndarray of bool, optional
        Cells that the chain must avoid, of the shape of all cells.

    Returns
    -------
    ndarray of int64, shape (n, 1 + d)
        Cells from start to goal; n is 0 if no chain exists.
    """
    shape, slice_of = map_.states.shape[1:], map_.slice_of
    padding = (1,) * (3 - len(shape))  # the plane is space with one layer
    check_bytes(len(slice_of) * math.prod(shape))
    reached_by = np.zeros((len(slice_of), *padding, *shape), dtype=np.uint8)
    if excluded is not None:
        reached_by[excluded.reshape(reached_by.shape)] = EXCLUDED
    start_cell, goal_cell = (
        np.array([cell[0], *[0] * len(padding), *cell[1:]], dtype=np.int64) for cell in (start, goal)
    )
    if not trace_chain(map_.cells, slice_of, neighbors, start_cell, goal_cell, reached_by):
        return np.empty((0, 1 + len(shape)), dtype=np.int64)
    # Undo the step that reached each cell, from the goal back to the start.
    cell, cells = goal_cell.tolist(), [goal_cell.tolist()]
    while (step := int(reached_by[tuple(cell)])) != FRONT_START:
        if step < FIRST_ROTATION_STEP:
            cell[1 + (step - 1) // 2] -= 2 * ((step - 1) % 2) - 1
        else:
            cell[0] = int(neighbors[cell[0], step - FIRST_ROTATION_STEP])
        cells.append(cell.copy())
    rows = np.array(cells[::-1], dtype=np.int64)
    return np.delete(rows, 1, axis=1) if padding else rows

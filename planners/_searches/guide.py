"""The way to a goal over blocks of cells, which guides searches over cells and rotations.

A state is a direction of the robot and a block. A block is passable in a direction if it has a cell
that is FREE at a rotation of the direction. So a chain of blocks may promise a way that the robot
cannot take, but misses hardly any passage. Blocks in which the robot can hardly turn cost more. If
a direction has one rotation, or a chain of cells is to follow the blocks, passable cells of blocks
must also meet at a rotation, because blocks are wider than the thinnest walls.

A search from the goal to the start measures short chains. It goes on when another search, from the
start, needs the cost of a block that it has not reached (D. Silver, "Cooperative pathfinding",
2005), and examines the cells that it meets. So its time does not grow with the map. A short search
ahead from such a block finds dead ends, which the search from the goal would only detect after it
has examined all blocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from cspace import FREE
from cspace.inside import Bools, Effort, Floats, Ints, States, internal, kernel
from planners._searches.estimate import (
    DEAD_END_COST,
    DONE,
    GOES_ON,
    NEEDS_ESTIMATE,
    NO_NODE,
    POPS_PER_CLOCK_CHECK,
    UNKNOWN,
    Cell,
    Costs,
    Estimate,
    estimate_without_obstacles,
    expand_until_done,
    is_cheaper,
    pop_best,
    reach_cell,
    start_progress,
)
from planners._searches.frontier import Progress, sparse_zeros
from planners._searches.moves import list_moves

POSITIONS_WEIGHT: Final = 1.1
DIRECTIONS_WEIGHT: Final = 1.05
"""Weights of the estimates of guides with one direction and with several; above 1, guides examine
far fewer blocks, for chains that are hardly longer."""

MAX_SAMPLES: Final = 4
"""Number of rotations that are sampled in the middle of a block."""

NO_FACTORS: Final[Costs] = np.empty((0, 0, 0, 0), dtype=np.float32)
"""Stands for cells that all cost their length."""


class Directions(NamedTuple):
    """Directions of a robot, and its moves in each. Costs are in cells.

    Attributes
    ----------
    slices : ndarray of int64, shape (directions, n)
        Slices of the rotations of each direction.
    moves : ndarray of int64, shape (directions, m, 3)
        Offsets of the blocks to which the robot may move.
    move_costs : ndarray of float64, shape (directions, m)
    neighbors : ndarray of int64, shape (directions, k)
        Directions to which it may turn.
    turn_costs : ndarray of float64, shape (directions, k)
    joins : bool
        Whether passable cells of blocks must meet; always with one rotation.
    """

    slices: Ints
    moves: Ints
    move_costs: Floats
    neighbors: Ints
    turn_costs: Floats
    joins: bool = False


class Blocks(NamedTuple):
    """Blocks of cells, for kernels.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz), read-only
    factors : ndarray of float32, the shape of states, or empty
        Factor of the cost of moves in each cell.
    worst_state : int
        Largest state that the robot may pass: FREE, or MIXED if geometry decides.
    side : int
        Cells along each side of a block.
    narrow_cost : float
        Added to the cost of a block if the robot passes at no sampled rotation.
    costs : ndarray of float32, shape (directions, x, y, z)
        Factor of the cost in each block, infinite if it is not passable, 0 if not examined yet.
    """

    states: States
    factors: Costs
    worst_state: int
    side: int
    narrow_cost: float
    costs: Costs


def any_direction(states: States) -> Directions:
    """Make the single direction of a holonomic robot."""
    moves = list_moves(2 if states.shape[1] == 1 else 3)
    return Directions(
        slices=np.arange(len(states))[np.newaxis],
        moves=moves.steps[np.newaxis],
        move_costs=moves.lengths[np.newaxis],
        neighbors=np.empty((1, 0), dtype=np.int64),
        turn_costs=np.empty((1, 0)),
    )


class Guide:
    """Costs of short chains from blocks to the goal, measured as a search needs them.

    A guide with several directions has a guide over positions alone, from the goal to the start.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz), read-only
    directions : Directions
    start, goal : tuple
        A direction, and a cell of the grid.
    side : int
        Cells along each side of a block.
    narrow_cost : float
        Share by which a block costs more if the robot passes at few rotations.
    weight : float
        Weight of the estimate, for one direction.
    factors : ndarray of float32, the shape of states, optional
        Factor, 1 or above, of the cost of moves in each cell.
    worst_state : int
        Largest state that the robot may pass: FREE, or MIXED if geometry decides.

    Attributes
    ----------
    estimate : Estimate
        In cells, with weight 1. It shares memory with the guide.
    """

    def __init__(
        self,
        states: States,
        directions: Directions,
        start: tuple[int, Cell],
        goal: tuple[int, Cell],
        side: int,
        *,
        narrow_cost: float,
        weight: float = POSITIONS_WEIGHT,
        factors: Costs = NO_FACTORS,
        worst_state: int = FREE,
    ) -> None:
        start_direction, start_cell = start
        goal_direction, goal_cell = goal
        nx, ny, nz = states.shape[1:]
        shape = (len(directions.slices), -(-nx // side), -(-ny // side), -(-nz // side))
        count = math.prod(shape)
        self._shape = shape
        self._side = side
        self._directions = directions
        self._blocks = Blocks(
            states=states,
            factors=factors,
            worst_state=worst_state,
            side=side,
            narrow_cost=narrow_cost,
            costs=sparse_zeros(count, np.float32).reshape(shape),
        )
        goal_block = self._find_block(goal_cell)
        self._goal = int(np.ravel_multi_index((goal_direction, *goal_block), shape))
        # The goal counts as passable, even if its block does not.
        self._blocks.costs[goal_direction, *goal_block] = 1.0
        self.estimate = estimate_without_obstacles((nx, ny, nz), goal_cell, 1.0)
        start_block = self._find_block(start_cell)
        self._to_start = estimate_without_obstacles(shape[1:], start_block, weight)
        self._guide: Guide | None = None
        if len(directions.slices) > 1:
            self._guide = Guide(
                states,
                any_direction(states),
                (0, goal_cell),
                (0, start_cell),
                side,
                narrow_cost=narrow_cost,
                factors=factors,
                worst_state=worst_state,
            )
            turns = directions.turn_costs / side
            self._to_start = self._to_start._replace(
                weight=DIRECTIONS_WEIGHT,
                rotations=measure_turns(directions.neighbors, turns, start_direction),
            )
        self._begin()

    def _begin(self) -> None:
        """Begin the search from the goal."""
        self._progress = start_progress(self._goal, math.prod(self._shape))
        self.estimate = self.estimate._replace(
            positions=self._progress.cost.reshape(self._shape),
            reached=self._progress.previous.reshape(self._shape),
            side=self._side,
            bound=np.zeros(1),
        )
        if self._guide is not None:
            positions = self._guide.estimate
            self._to_start = self._to_start._replace(
                positions=positions.positions, reached=positions.reached, bound=positions.bound
            )

    def avoid(self, blocks: Bools) -> None:
        """Raise the costs of blocks, and restart the search.

        ``blocks``, shape (x, y, z), marks blocks that a stalled search never entered.
        """
        costs = self._blocks.costs[:, blocks]
        # Almost any detour costs less than a block with this factor, which stays passable. Zero
        # marks a block that is not examined yet.
        self._blocks.costs[:, blocks] = np.where(costs > 0.0, costs + 1e4, 0.0)
        if self._guide is not None:
            self._guide.avoid(blocks)
        self._begin()

    def is_reached(self, cell: Cell) -> bool:
        """Return True if a cell's block has been reached."""
        return bool(self.estimate.reached[0, *self._find_block(cell)] != 0)

    def measure(self, cells: Ints) -> Floats:
        """Return costs of chains from blocks, for one direction.

        They are in cells, and infinite for blocks not reached.
        """
        blocks = (0, *(cells // self._side).T)
        is_known = self.estimate.reached[blocks] != 0
        return np.where(is_known, self._side * self.estimate.positions[blocks], math.inf)

    def reach(
        self,
        direction: int,
        cell: Cell,
        until: Effort,
        may_exist: Callable[[], bool] | None = None,
    ) -> None:
        """Search until a cell's block is reached.

        A long search calls ``may_exist`` once, and ends if no chain exists. Raises TimeoutError
        after ``until``, a reading of :func:`cspace._support.deadlines.now`.
        """
        last = int(np.ravel_multi_index((direction, *self._find_block(cell)), self._shape))
        is_first = self.estimate.bound[0] == 0.0  # the search from the goal has not begun
        if self._guide is not None and not is_first and self._is_dead_end(last):
            # Otherwise the search would examine all other blocks in vain.
            self._progress.cost[last] = DEAD_END_COST
            self._progress.previous[last] = last + 1
            return
        self._progress = expand_until_done(
            lambda progress: expand_blocks(
                self._blocks,
                self._directions,
                self._to_start,
                progress,
                last,
                POPS_PER_CLOCK_CHECK,
            ),
            self._progress,
            self._directions.moves.shape[1] + self._directions.neighbors.shape[1],
            until,
            lambda state: self._reach_positions(state, until),
            may_exist,
        )
        is_exhausted = self._progress.length[0] == 0
        lowest_key = -math.inf if is_exhausted else self._progress.keys[0]
        # The weight makes keys larger than the costs of chains, at most by this factor.
        self.estimate.bound[0] = lowest_key / self._to_start.weight

    def _is_dead_end(self, state: int) -> bool:
        """Return True if a short search ahead ends without the goal."""
        progress = start_progress(state, len(self._progress.cost))
        ahead = self._directions._replace(moves=-self._directions.moves)
        # With weight 0, the nearest states come first.
        estimate = estimate_without_obstacles(self._shape[1:], (0, 0, 0), 0.0)._replace(
            rotations=np.zeros(self._shape[0])
        )
        # Largest number of states that a search ahead expands to prove a dead end.
        expand_blocks(self._blocks, ahead, estimate, progress, self._goal, 2**10)
        return bool(progress.length[0] == 0 and not progress.closed[self._goal])

    def _reach_positions(self, state: int, until: Effort) -> None:
        """Search over positions until a state's block is reached."""
        if self._guide is not None:
            _, *block = np.unravel_index(state, self._shape)
            i, j, k = (self._side * int(index) for index in block)
            self._guide.reach(0, (i, j, k), until)

    def _find_block(self, cell: Cell) -> Cell:
        """Return the block of a cell."""
        i, j, k = cell
        return i // self._side, j // self._side, k // self._side


def measure_turns(neighbors: Ints, turns: Floats, goal: int) -> Floats:
    """Return lowest costs of turning from rotations to ``goal``.

    ``neighbors``, shape (rotations, n), are rotations, padded with -1, and ``turns`` the costs of
    turning to them.
    """
    costs = np.full(len(neighbors), np.inf)
    costs[goal] = 0.0
    is_settled = False
    while not is_settled:
        by_neighbors = np.where(neighbors < 0, np.inf, costs[neighbors] + turns)
        lower_costs = np.minimum(costs, by_neighbors.min(axis=1, initial=np.inf))
        is_settled = np.array_equal(costs, lower_costs)
        costs = lower_costs
    return costs


@kernel
def expand_blocks(
    blocks: Blocks,
    directions: Directions,
    to_start: Estimate,
    progress: Progress,
    last: int,
    max_states: int,
) -> int:
    """Expand queued states until ``last`` was expanded, or all.

    Return :data:`GOES_ON` after ``max_states``, or if the queue is nearly full.
    """
    nx, ny, nz = to_start.shape
    n_moves = directions.moves.shape[1]
    n_turns = directions.neighbors.shape[1]
    joins = directions.joins or directions.slices.shape[1] == 1
    for _ in range(max_states):
        if progress.closed[last]:
            return DONE
        if progress.length[0] + n_moves + n_turns >= len(progress.keys):
            return GOES_ON
        state = pop_best(to_start, progress)
        if state == NO_NODE:
            return DONE
        if state == UNKNOWN:
            return NEEDS_ESTIMATE
        progress.closed[state] = True
        k = state % nz
        j = state // nz % ny
        i = state // (nz * ny) % nx
        direction = state // (nz * ny * nx)
        for option in range(n_moves + n_turns):
            other, u, v, w = direction, i, j, k
            if option < n_moves:
                # The search runs backwards: the robot moves from the block behind to this one.
                u -= directions.moves[direction, option, 0]
                v -= directions.moves[direction, option, 1]
                w -= directions.moves[direction, option, 2]
                length = directions.move_costs[direction, option]
                if not (0 <= u < nx and 0 <= v < ny and 0 <= w < nz):
                    continue
            else:
                other = directions.neighbors[direction, option - n_moves]
                length = directions.turn_costs[direction, option - n_moves] / blocks.side
            factor = blocks.costs[other, u, v, w]
            if factor == 0.0:
                factor = find_cost_factor(blocks, directions.slices, other, u, v, w)
            reached = ((other * nx + u) * ny + v) * nz + w
            cost = progress.cost[state] + length * factor
            if not is_cheaper(progress, reached, cost):
                continue
            slices = directions.slices[direction]
            if joins and option < n_moves and not are_joined(blocks, slices, (i, j, k), (u, v, w)):
                continue
            reach_cell(to_start, progress, state, other, u, v, w, cost)
    return GOES_ON


@internal
def find_cost_factor(
    blocks: Blocks, slices: Ints, direction: int, u: int, v: int, w: int
) -> np.float32:
    """Compute and store a block's cost factor, or infinity.

    ``slices`` are as in :class:`Directions`. The factor is the factor of a passable cell; it grows
    with the share of rotations at which the middle of the block is impassable.
    """
    _, nx, ny, nz = blocks.states.shape
    side = blocks.side
    count = slices.shape[1]
    n_samples = min(count, MAX_SAMPLES)
    i = min(side * u + side // 2, nx - 1)
    j = min(side * v + side // 2, ny - 1)
    k = min(side * w + side // 2, nz - 1)
    factor = np.float32(math.inf)
    n_passable = 0
    for sample in range(n_samples):
        number = slices[direction, sample * count // n_samples]
        if blocks.states[number, i, j, k] <= blocks.worst_state:
            n_passable += 1
            factor = factor_at(blocks.factors, number, i, j, k)
    if n_passable == 0:
        factor = factor_of_any(blocks, slices[direction], u, v, w)
    cost = np.float32(factor * (1.0 + blocks.narrow_cost * (1.0 - n_passable / n_samples)))
    blocks.costs[direction, u, v, w] = cost
    return cost


@internal
def are_joined(blocks: Blocks, slices: Ints, first: Cell, last: Cell) -> bool:
    """Return True if chains join two near blocks.

    Each block of a chain shares a face with the next, and passable cells meet at the face. If two
    axes have equally many steps left, one chain prefers the first axis, and the other chain the
    last.
    """
    for prefers_last in range(2):
        block = first
        is_open = True
        while is_open and block != last:
            next_block = step_towards(block, last, prefers_last == 1)
            is_open = meet_at_face(blocks, slices, block, next_block)
            block = next_block
        if is_open:
            return True
    return False


@internal
def step_towards(block: Cell, last: Cell, prefers_last: bool) -> Cell:
    """Return the next block along the axis with most steps left."""
    i, j, k = block
    x = abs(last[0] - i)
    y = abs(last[1] - j)
    z = abs(last[2] - k)
    if z > max(x, y) or (z == max(x, y) and prefers_last):
        return i, j, k + (1 if last[2] > k else -1)
    if y > x or (y == x and prefers_last):
        return i, j + (1 if last[1] > j else -1), k
    return i + (1 if last[0] > i else -1), j, k


@internal
def meet_at_face(blocks: Blocks, slices: Ints, first: Cell, second: Cell) -> bool:
    """Return True if passable cells of a slice meet at two blocks' common face."""
    _, nx, ny, nz = blocks.states.shape
    side = blocks.side
    du = second[0] - first[0]
    dv = second[1] - first[1]
    dw = second[2] - first[2]
    low_u = side * first[0] + (side - 1 if du > 0 else 0)
    low_v = side * first[1] + (side - 1 if dv > 0 else 0)
    low_w = side * first[2] + (side - 1 if dw > 0 else 0)
    high_u = low_u + (1 if du != 0 else side)
    high_v = low_v + (1 if dv != 0 else side)
    high_w = low_w + (1 if dw != 0 else side)
    for number in slices:
        for i in range(low_u, min(high_u, nx)):
            for j in range(low_v, min(high_v, ny)):
                for k in range(low_w, min(high_w, nz)):
                    if (
                        blocks.states[number, i, j, k] <= blocks.worst_state
                        and blocks.states[number, i + du, j + dv, k + dw] <= blocks.worst_state
                    ):
                        return True
    return False


@internal
def factor_of_any(blocks: Blocks, slices: Ints, u: int, v: int, w: int) -> np.float32:
    """Return the factor of a block's passable cell, or infinity."""
    _, nx, ny, nz = blocks.states.shape
    side = blocks.side
    for number in slices:
        for i in range(side * u, min(side * (u + 1), nx)):
            for j in range(side * v, min(side * (v + 1), ny)):
                for k in range(side * w, min(side * (w + 1), nz)):
                    if blocks.states[number, i, j, k] <= blocks.worst_state:
                        return factor_at(blocks.factors, number, i, j, k)
    return np.float32(math.inf)


@internal
def factor_at(factors: Costs, number: int, i: int, j: int, k: int) -> np.float32:
    """Return the cost factor of moves in a cell of a slice."""
    if factors.shape[0] == 0:
        return np.float32(1.0)
    factor: np.float32 = factors[number, i, j, k]
    return factor

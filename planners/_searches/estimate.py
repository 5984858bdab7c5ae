"""Estimates of the remaining cost, and searches that they guide."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.inside import Effort, Floats, heap, internal, spend
from planners._searches.frontier import Progress, check_deadline, double, make_progress

Cell = tuple[int, int, int]
"""A cell along three axes."""

Costs = NDArray[np.float32]
Nodes = NDArray[np.signedinteger[Any]]
"""Numbers of nodes, plus 1: int32, or int64 if there are more than 2^31 nodes."""

POPS_PER_CLOCK_CHECK: Final = 2**14
"""Nodes taken from the queue between two checks of the time limit."""

NANOSECONDS_PER_POP: Final = 800
"""Work of taking a node from the queue and expanding it."""

NO_NODE: Final = -1
UNKNOWN: Final = -2
"""Results of :func:`pop_best` other than a node: the queue is empty, or the guide has not reached
the node's block."""

DONE: Final = 0
GOES_ON: Final = 1
"""Results of kernels that expand nodes: they are done, or the next call goes on."""

NEEDS_ESTIMATE: Final = 2
"""Result of a kernel that expands nodes, beside :data:`DONE` and :data:`GOES_ON`: the next call
goes on after the guide has reached the block of the first node."""

DEAD_END_COST: Final = 1e9
"""Cost from a dead end to the goal, in blocks; larger than the cost of any chain, so that searches
try a dead end last."""


class Estimate(NamedTuple):
    """Estimate of the cost from a node to the goal.

    A node is a position and a rotation, and has the sum of their costs. The cost of a position is
    the cost of its block, a cube of positions, if a guide has reached the block.

    Attributes
    ----------
    weight : float
        Factor of the estimate.
    shape : tuple of int
        Number of positions along each axis.
    goal : tuple of int
        Position ``(x, y, z)`` of the goal.
    positions : ndarray of float32, shape (directions, x, y, z), or empty
        Cost from each reached block to the goal, in blocks; empty for the cost without obstacles.
    reached : ndarray of int32 or int64, the shape of positions
        Nonzero for blocks that the guide has reached.
    side : int
        Positions along each side of a block.
    bound : ndarray of float64, shape (1,)
        Lower bound of the cost, in blocks, of chains from start to goal through unreached blocks;
        -inf if there are none.
    rotations : ndarray of float64, shape (rotations,)
        Cost of turning from each rotation to the goal's, in cells.
    """

    weight: float
    shape: Cell
    goal: Cell
    positions: Costs
    reached: Nodes
    side: int
    bound: Floats
    rotations: Floats


def estimate_without_obstacles(shape: Cell, goal: Cell, weight: float) -> Estimate:
    """Estimate the cost to ``goal`` without obstacles."""
    return Estimate(
        weight=weight,
        shape=shape,
        goal=goal,
        positions=np.empty((0, 0, 0, 0), dtype=np.float32),
        reached=np.empty((0, 0, 0, 0), dtype=np.int32),
        side=1,
        bound=np.zeros(1),
        rotations=np.zeros(1),
    )


def start_progress(start: int, count: int) -> Progress:
    """Make a search over ``count`` nodes from a start."""
    # The queue's length doubles as needed.
    progress = make_progress(count, 2**14)
    # The start is its own predecessor.
    progress.previous[start] = start + 1
    heap.push(progress, 0.0, start)
    return progress


def expand_until_done(
    expand: Callable[[Progress], int],
    progress: Progress,
    max_new_entries: int,
    until: Effort,
    reach_first: Callable[[int], None] | None,
    may_exist: Callable[[], bool] | None,
) -> Progress:
    """Call ``expand`` until it returns :data:`DONE`.

    ``expand`` adds at most ``max_new_entries`` to the queue for each node; the queue doubles as
    needed. If ``expand`` needs an estimate, call ``reach_first`` with the first node of the queue.
    A long search calls ``may_exist`` once, and ends if no chain exists. Raises TimeoutError after
    ``until``.
    """
    rounds = itertools.count(1)
    # To label all nodes takes as long as to expand 1/256 of them.
    asks_after = math.ceil(len(progress.cost) / 256 / POPS_PER_CLOCK_CHECK)
    while True:
        outcome = expand(progress)
        # The other calls end early, after an unknown number of nodes.
        spend(NANOSECONDS_PER_POP * (POPS_PER_CLOCK_CHECK if outcome == GOES_ON else 2**5))
        is_long = outcome == GOES_ON and next(rounds) == asks_after
        if outcome == DONE or (is_long and may_exist is not None and not may_exist()):
            return progress
        check_deadline(until)
        if outcome == NEEDS_ESTIMATE and reach_first is not None:
            reach_first(int(progress.queue[0]))
        if progress.length[0] + max_new_entries >= len(progress.queue):
            keys = double(progress.keys)
            progress = progress._replace(keys=keys, queue=double(progress.queue))


@internal
def reach_cell(
    estimate: Estimate,
    progress: Progress,
    cell: int,
    rotation: int,
    u: int,
    v: int,
    w: int,
    cost: float,
) -> None:
    """Record the cell before (u, v, w) on its cheapest chain.

    ``cost`` is the chain's cost, in cells.
    """
    nx, ny, nz = estimate.shape
    reached = ((rotation * nx + u) * ny + v) * nz + w
    progress.cost[reached] = cost
    progress.previous[reached] = cell + 1
    heap.push(progress, expected_cost(estimate, progress, reached, rotation, u, v, w), reached)


@internal
def is_cheaper(progress: Progress, node: int, cost: float) -> bool:
    """Return True if a chain is the cheapest to an open node.

    ``cost`` is the chain's cost, or infinite without a chain.
    """
    if progress.closed[node] or cost == math.inf:
        return False
    is_first: bool = progress.previous[node] == 0
    return is_first or np.float32(cost) < progress.cost[node]


@internal
def expected_cost(
    estimate: Estimate, progress: Progress, node: int, rotation: int, u: int, v: int, w: int
) -> float:
    """Return the expected cost of chains through a node."""
    cost: float = progress.cost[node]
    remaining: float = remaining_cost(estimate, cost, 0, u, v, w) + estimate.rotations[rotation]
    return cost + estimate.weight * remaining


@internal
def pop_best(estimate: Estimate, progress: Progress) -> int:
    """Remove and return the node of lowest expected cost.

    Return :data:`NO_NODE` if the queue is empty, and :data:`UNKNOWN` if the guide has not reached
    the block of the first node.
    """
    nx, ny, nz = estimate.shape
    while progress.length[0] > 0:
        node: int = progress.queue[0]
        w = node % nz
        v = node // nz % ny
        u = node // (nz * ny) % nx
        rotation = node // (nz * ny * nx)
        is_closed = progress.closed[node]
        if not is_closed and not is_known(estimate, 0, u, v, w):
            return UNKNOWN
        former_key = progress.keys[0]
        heap.pop_first(progress)
        if is_closed:
            continue
        if len(estimate.positions) == 0:
            return node
        # The guide may have reached the block since the node was queued.
        key = expected_cost(estimate, progress, node, rotation, u, v, w)
        if key <= former_key:
            return node
        heap.push(progress, key, node)
    return NO_NODE


@internal
def is_known(estimate: Estimate, direction: int, i: int, j: int, k: int) -> bool:
    """Return True if the guide knows a position's block or neighbour.

    Also return True if the guide has no more blocks to reach.
    """
    if len(estimate.positions) == 0 or estimate.bound[0] == -math.inf:
        return True
    side = estimate.side
    return cost_by_block(estimate, direction, i // side, j // side, k // side) < math.inf


@internal
def remaining_cost(
    estimate: Estimate, cost: float, direction: int, i: int, j: int, k: int
) -> float:
    """Estimate the cost from a position to the goal, in cells.

    ``cost`` is the cost from the start to the position, in cells.
    """
    unhindered = unhindered_cost(estimate, i, j, k)
    if len(estimate.positions) == 0:
        return unhindered
    side = estimate.side
    u = i // side
    v = j // side
    w = k // side
    remaining = side * cost_by_block(estimate, direction, u, v, w)
    if remaining == math.inf:
        remaining = side * estimate.bound[0] - cost
    return remaining if remaining > unhindered else unhindered


@internal
def cost_by_block(estimate: Estimate, direction: int, u: int, v: int, w: int) -> float:
    """Return a block's cost, in blocks, or infinity.

    If the guide has not reached the block, return the cost of the best neighbouring block or turn,
    plus one for each step. Searches beside the guide's chain need no better cost.
    """
    positions = estimate.positions
    if estimate.reached[direction, u, v, w] != 0:
        return float(positions[direction, u, v, w])
    count, nx, ny, nz = positions.shape
    # A block beside a dead end need not be a dead end.
    best = DEAD_END_COST
    turns = 1 if count > 1 else 0
    for turn in range(-turns, turns + 1):
        other = (direction + turn) % count
        for i in range(u - 1, u + 2):
            for j in range(v - 1, v + 2):
                for k in range(w - 1, w + 2):
                    is_inside = 0 <= i < nx and 0 <= j < ny and 0 <= k < nz
                    if not is_inside or estimate.reached[other, i, j, k] == 0:
                        continue
                    steps = abs(turn) + abs(i - u) + abs(j - v) + abs(k - w)
                    cost = positions[other, i, j, k] + steps
                    if cost < best:
                        best = cost
    return best if best < DEAD_END_COST else math.inf


@internal
def unhindered_cost(estimate: Estimate, i: int, j: int, k: int) -> float:
    """Return the cost without obstacles, in cells."""
    short = abs(i - estimate.goal[0])
    middle = abs(j - estimate.goal[1])
    long = abs(k - estimate.goal[2])
    if short > middle:
        short, middle = middle, short
    if middle > long:
        middle, long = long, middle
    if short > middle:
        short, middle = middle, short
    if estimate.shape[0] > 1:
        # A shortest chain moves along one, two and three axes.
        return long - middle + math.sqrt(2.0) * (middle - short) + math.sqrt(3.0) * short
    # In the plane, it combines two of the moves (1, 0), (1, 1) and (2, 1).
    if 2 * middle <= long:
        return long - 2 * middle + math.sqrt(5.0) * middle
    return math.sqrt(2.0) * (2 * middle - long) + math.sqrt(5.0) * (long - middle)

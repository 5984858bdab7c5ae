"""The way to a goal over positions, which guides searches among rotations.

Positions are blocks of cells. A block is passable in a direction if one of its cells is FREE at a
rotation that the robot may have there. So a chain of blocks may promise a way that the robot cannot
take, but leads through every passage that it can. A search from the goal to the start measures the
shortest chains, and only near the way between the two. It examines the cells that it meets, so that
its time does not grow with the map (P. Hart, N. Nilsson and B. Raphael, "A formal basis for the
heuristic determination of minimum cost paths", 1968).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.queries.frontier import (
    POPS_PER_CLOCK_CHECK,
    Costs,
    Estimate,
    Progress,
    begin_at,
    estimate_without_obstacles,
    expand_until_done,
    pop_first,
    reach_cell,
    sparse_zeros,
)
from cspace.queries.moves import Moves, list_moves
from cspace.queries.points import Cell
from cspace.support.arrays import FREE, Ints, States
from cspace.support.compiling import kernel

BLOCK_SIDE: Final = 2
"""Cells along each side of a block."""

MARGIN_BLOCKS: Final = 10.0
"""Blocks by which a chain may be longer than the shortest one to be measured."""

TIE_WEIGHT: Final = 1.001
"""Weight of the estimate; above 1, the search goes on along one of the chains that are equally
short."""

NO_FACTORS: Final[Costs] = np.empty((0, 0, 0, 0), dtype=np.float32)
"""Stands for cells that all cost their length."""


class Blocks(NamedTuple):
    """Blocks of cells and the moves between them, for kernels.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz), read-only
    factors : ndarray of float32, the shape of states, or empty
        Factor of the cost of moves in each cell.
    moves : Moves
    slices : ndarray of int64, shape (moves, n) or (1, n)
        Slices of the rotations that the robot may have on each move, or on all.
    prices : ndarray of float32, shape (moves or 1, x, y, z)
        Factor of the cost in each block, infinite if it is not passable, 0 if not examined yet.
    """

    states: States
    factors: Costs
    moves: Moves
    slices: Ints
    prices: Costs


def measure_way(
    states: States,
    slices: Ints,
    start: Cell,
    goal: Cell,
    until: float,
    factors: Costs = NO_FACTORS,
) -> Estimate:
    """Measure the shortest chains from blocks to the goal, near the way from the start.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz), read-only
    slices : ndarray of int64, shape (moves, n) or (1, n)
        Slices of the rotations that the robot may have on each move of
        :func:`cspace.queries.moves.list_moves`, or on all.
    start, goal : tuple of int
        Cells of the grid.
    until : float
        Reading of :data:`cspace.support.compiling.clock` at which the search ends.
    factors : ndarray of float32, the shape of states, optional
        Factor, 1 or above, of the cost of moves in each cell.

    Returns
    -------
    Estimate
        In cells, with weight 1.

    Raises
    ------
    TimeoutError
        If time runs out.
    """
    nx, ny, nz = states.shape[1:]
    shape = -(-nx // BLOCK_SIDE), -(-ny // BLOCK_SIDE), -(-nz // BLOCK_SIDE)
    moves = list_moves(2 if nx == 1 else 3)
    size = math.prod(shape)
    blocks = Blocks(
        states=states,
        factors=factors,
        moves=moves,
        slices=slices,
        prices=sparse_zeros(len(slices) * size, np.float32).reshape(-1, *shape),
    )
    start_block = _block_of(start)
    first, last = (int(np.ravel_multi_index(_block_of(cell), shape)) for cell in (goal, start))
    to_start = estimate_without_obstacles(shape, start_block, TIE_WEIGHT)
    progress = expand_until_done(
        lambda progress: expand_blocks(blocks, to_start, progress, last),
        begin_at(first, size),
        len(moves.steps),
        until,
    )
    estimate = estimate_without_obstacles((nx, ny, nz), goal, 1.0)
    return estimate._replace(
        positions=progress.cost.reshape(shape),
        measured=progress.closed.reshape(shape),
        side=BLOCK_SIDE,
        beyond=BLOCK_SIDE * (float(progress.cost[last]) + MARGIN_BLOCKS),
    )


def _block_of(cell: Cell) -> Cell:
    """Return the block of a cell."""
    i, j, k = cell
    return i // BLOCK_SIDE, j // BLOCK_SIDE, k // BLOCK_SIDE


@kernel
def expand_blocks(blocks: Blocks, to_start: Estimate, progress: Progress, start: int) -> bool:
    """Expand queued blocks from the goal on; return True when done, or no block is left.

    It is done when the start was expanded, and chains through all others are longer by a margin.
    Return False after many blocks, or if the queue is nearly full; the next call goes on.
    """
    nx, ny, nz = to_start.shape
    steps = blocks.moves.steps
    for _ in range(POPS_PER_CLOCK_CHECK):
        if progress.length[0] == 0:
            return True
        if progress.length[0] + len(steps) >= len(progress.keys):
            return False
        if progress.closed[start] and progress.keys[0] > progress.cost[start] + MARGIN_BLOCKS:
            return True
        block = pop_first(progress)
        if progress.closed[block]:
            continue
        progress.closed[block] = True
        k = block % nz
        j = block // nz % ny
        i = block // (nz * ny)
        # The search runs backwards: the robot makes each move from the block behind to this one.
        for move in range(len(steps)):
            u = i - steps[move, 0]
            v = j - steps[move, 1]
            w = k - steps[move, 2]
            if 0 <= u < nx and 0 <= v < ny and 0 <= w < nz:
                row = move if len(blocks.slices) > 1 else 0
                price = price_of(blocks, row, u, v, w)
                if price < math.inf:
                    cost = price * blocks.moves.lengths[move]
                    reach_cell(to_start, progress, block, 0, u, v, w, cost)
    return False


@kernel
def price_of(blocks: Blocks, row: int, u: int, v: int, w: int) -> float:
    """Return the factor of the cost in block (u, v, w); infinity if it is not passable.

    ``row`` is that of ``blocks.slices``.
    """
    price = blocks.prices[row, u, v, w]
    if price == 0.0:
        price = examine_block(blocks, row, u, v, w)
        blocks.prices[row, u, v, w] = price
    return float(price)


@kernel
def examine_block(blocks: Blocks, row: int, u: int, v: int, w: int) -> np.float32:
    """Return the factor of the first cell found FREE in a block; infinity if none is."""
    _, nx, ny, nz = blocks.states.shape
    for number in blocks.slices[row]:
        for i in range(BLOCK_SIDE * u, min(BLOCK_SIDE * (u + 1), nx)):
            for j in range(BLOCK_SIDE * v, min(BLOCK_SIDE * (v + 1), ny)):
                for k in range(BLOCK_SIDE * w, min(BLOCK_SIDE * (w + 1), nz)):
                    if blocks.states[number, i, j, k] == FREE:
                        return factor_at(blocks.factors, number, i, j, k)
    return np.float32(math.inf)


@kernel
def factor_at(factors: Costs, number: int, i: int, j: int, k: int) -> np.float32:
    """Return the factor of the cost of moves in cell (i, j, k) of slice ``number``."""
    if factors.shape[0] == 0:
        return np.float32(1.0)
    factor: np.float32 = factors[number, i, j, k]
    return factor

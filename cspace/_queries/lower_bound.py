"""Lower bounds of the length of every collision-free path in the plane.

Let U be the union of the closed cells through which a path may lead; other cells are closed, too,
so that no path leads through a *pinch*, a corner where just two opposite cells are in U. A shortest
path in U is a polyline that bends at corners of cells only, and never at a pinch. So let G be the
graph of all other corners, with moves along a side (1, 0), across a cell (1, 1), and across two
cells (2, 1), and their mirror images. A move is in G if the cells that it crosses are in U; along a
side, one of the two cells beside it.

Claim: if a segment in U leads from corner A to corner B, the distance of A and B in G is at most
STRETCH times its length. Proof: cut the segment where it passes a corner; let it rise from (0, 0)
to (a, b) with 0 <= b <= a (the rest by symmetry), with height y(x), and cross no corner between.
Every cell that it crosses is in U. The corners (x, floor of y(x)) that follow are no pinches, as
the segment crosses the cells to their upper left and upper right.

* b = 0, or a = b, or a = 2 b: the segment is one move.
* 0 < 2 b < a. In each column k from k to k + 1 in which the floor of y rises from f to f + 1,
  y(k) > f + 1/2, so y(k - 1) > f, and the cells (k - 1, f) and (k, f) are crossed: the move from
  (k - 1, f) to (k + 1, f + 1) is in G. Such columns are at least two apart, so that these moves
  do not overlap; moves along sides of crossed cells join them.
* b < a < 2 b. In each column k in which the floor f of y stays, y(k + 1) is in (f, f + 1) and
  y(k + 2) > f + 1: the cells (k, f) and (k + 1, f) are crossed, and the move from (k, f) to
  (k + 2, f + 1) is in G. Such moves do not overlap; moves across crossed cells join them.

Either way, the moves have two neighbouring directions, at most atan(1/2) apart, and sum up to (a,
b). Their total length is at most the distance divided by the cosine of half that angle.

A path from p to q, extended by the segments to corners A and B of their cells, leads from A to B.
So its length is at least d(A, B) / STRETCH - |pA| - |qB|, with d the distance in G.
"""

from __future__ import annotations

import itertools
import math
from functools import cache
from typing import Final

import numpy as np
from scipy import ndimage

from cspace._queries.frontier import estimate_without_obstacles
from cspace._queries.guide import NO_FACTORS
from cspace._queries.moves import Moves, times_in_box
from cspace._queries.search import Graph, search
from cspace._record.states import read_only
from cspace._support.arrays import BLOCKED, FREE, Bools, Floats, Ints

STRETCH: Final = 1.0 / math.cos(0.5 * math.atan(0.5))
"""Largest distance of two corners in the graph, over the length of a segment that joins them."""

ROUNDING_SHARE: Final = 1e-5
"""Share by which sums in single precision may exceed the exact distance."""

STRAIGHT_ROUNDING_SHARE: Final = 1e-12
"""Share by which a distance in double precision may exceed the exact one."""


def min_length(passable: Bools, is_open: bool, start: Floats, goal: Floats) -> float:
    """Bound the length of paths through passable cells from below, in cells.

    In space, it is the largest bound of the three projections along an axis, with the difference
    along that axis.

    Parameters
    ----------
    passable : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
        Cells through which paths may lead.
    is_open : bool
        Whether paths may leave the grid.
    start, goal : ndarray of float64, shape (d,)
        Positions in cells, in the grid.

    Returns
    -------
    float
        Infinite if no path exists.
    """
    if passable.ndim == 2:
        return _min_length_in_plane(passable, is_open, start, goal)
    bounds = []
    for axis in range(3):
        projected = np.asarray(passable.any(axis=axis))
        ends = np.delete(start, axis), np.delete(goal, axis)
        across = _min_length_in_plane(projected, is_open, *ends)
        bounds.append(math.hypot(across, goal[axis] - start[axis]))
    return max(bounds)


def _min_length_in_plane(passable: Bools, is_open: bool, start: Floats, goal: Floats) -> float:
    """Bound the length of paths in the plane from below, in cells; infinite if there is none.

    ``passable``, shape (nx, ny), are the cells through which paths may lead; ``is_open`` says if
    they may leave the grid. ``start`` and ``goal``, shape (2,), are positions in cells.
    """
    if is_open:
        # A shortest path outside leads along the border of the grid, through these cells.
        passable = np.pad(passable, 1, constant_values=True)
        start = start + 1.0
        goal = goal + 1.0
    last_cell = np.array(passable.shape) - 1
    start_cell = np.clip(np.floor(start), 0, last_cell).astype(np.int64)
    goal_cell = np.clip(np.floor(goal), 0, last_cell).astype(np.int64)
    labels, _ = ndimage.label(passable)
    label = labels[tuple(start_cell)]
    if label == 0 or label != labels[tuple(goal_cell)]:
        return math.inf
    straight = float(np.linalg.norm(goal - start)) * (1.0 - STRAIGHT_ROUNDING_SHARE)
    pinches = _find_pinches(passable)
    start_corner = _nearest_corner(start, start_cell, pinches)
    goal_corner = _nearest_corner(goal, goal_cell, pinches)
    if start_corner is None or goal_corner is None:
        return straight
    distance = _distance_of_corners(passable, pinches, start_corner, goal_corner)
    to_corners = np.linalg.norm(start - start_corner) + np.linalg.norm(goal - goal_corner)
    return max(straight, distance * (1.0 - ROUNDING_SHARE) / STRETCH - float(to_corners))


def _find_pinches(passable: Bools) -> Bools:
    """Find the corners where just two opposite cells are passable, shape (nx + 1, ny + 1)."""
    # The four cells around each corner; none outside the grid is passable.
    around = np.pad(passable, 1)
    low_low = around[:-1, :-1]
    low_high = around[:-1, 1:]
    high_low = around[1:, :-1]
    high_high = around[1:, 1:]
    return np.asarray((low_low == high_high) & (low_high == high_low) & (low_low != low_high))


def _nearest_corner(q: Floats, cell: Ints, pinches: Bools) -> Ints | None:
    """Find the corner of a position's cell nearest to it that is no pinch; None if all are."""
    corners = [cell + offset for offset in itertools.product((0, 1), repeat=2)]
    usable_corners = [corner for corner in corners if not pinches[tuple(corner)]]
    return min(usable_corners, key=lambda corner: math.dist(q, corner), default=None)


def _distance_of_corners(passable: Bools, pinches: Bools, start: Ints, goal: Ints) -> float:
    """Return the distance of two corners in the graph, in cells; infinite without a path.

    ``passable`` has shape (nx, ny), ``pinches`` marks corners that no path passes. The search is
    that of cells, with corners as nodes, and the straight distance as its estimate.
    """
    states = np.where(passable, np.uint8(FREE), np.uint8(BLOCKED))
    no_rotations = np.empty((1, 0), dtype=np.int64)
    graph = Graph(
        states=read_only(states[np.newaxis, np.newaxis]),
        slice_of=np.zeros(1, dtype=np.int64),
        neighbors=no_rotations,
        turns=no_rotations.astype(np.float64),
        moves=_list_moves(),
        factors=NO_FACTORS,
    )
    nodes_shape = (1, *pinches.shape)
    goal_node = (0, int(goal[0]), int(goal[1]))
    estimate = estimate_without_obstacles(nodes_shape, goal_node, 1.0)
    first = int(np.ravel_multi_index(tuple(start), pinches.shape))
    last = int(np.ravel_multi_index(tuple(goal), pinches.shape))
    progress = search(graph, estimate, first, last, math.inf, excluded=pinches.ravel())
    return float(progress.cost[last]) if progress.closed[last] else math.inf


@cache
def _list_moves() -> Moves:
    """List the moves between corners of cells, and the cells that each needs.

    The near cells of a corner are those within two cells; a move needs those that it crosses.
    """
    near_cells = list(itertools.product((-2, -1, 0, 1), repeat=2))
    steps = []
    needed = []
    for step in itertools.product((-2, -1, 0, 1, 2), repeat=2):
        # Longer moves in the same direction consist of several.
        if math.gcd(*step) != 1:
            continue
        masks = [1 << bit for bit, cell in enumerate(near_cells) if _crosses(step, cell)]
        # A move along a side needs one of two cells, so it is listed once with each.
        if 0 not in step:
            masks = [sum(masks)]
        steps += [(0, *step)] * len(masks)
        needed += masks
    in_space = np.array([(0, *cell) for cell in near_cells])
    return Moves(np.array(steps), np.linalg.norm(steps, axis=1), in_space, np.array(needed))


def _crosses(step: tuple[int, ...], cell: tuple[int, ...]) -> bool:
    """Return True if a segment crosses a cell or is one of its sides.

    The segment leads from corner (0, 0) to ``step``.
    """
    enter, leave = times_in_box(step, cell)
    return enter < leave

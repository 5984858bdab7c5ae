"""Lower bounds of the length of every collision-free path.

In the plane, let U be the union of the closed cells through which a path may lead; other cells are
closed, too, so that no path leads through a *pinch*, a corner where just two opposite cells are in
U. The bound is the length of the shortest path in U without pinches, less what rounding may add.
"""

from __future__ import annotations

import math

import numpy as np

from cspace._queries.any_angle import (
    INSET,
    MAX_ERROR_PER_CELL,
    find_shortest_way,
    list_rectangles,
)
from cspace._support.arrays import BLOCKED, FREE, Bools, Floats


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
    """Bound lengths of paths in the plane from below, in cells.

    ``passable``, shape (nx, ny), are the cells through which paths may lead; ``is_open`` says if
    they may leave the grid. ``start`` and ``goal``, shape (2,), are positions in cells.
    """
    if is_open:
        # A shortest path outside leads along the border of the grid, through these cells.
        passable = np.pad(passable, 1, constant_values=True)
        start = start + 1.0
        goal = goal + 1.0
    states = np.where(passable, np.uint8(FREE), np.uint8(BLOCKED))
    length = find_shortest_way(list_rectangles(states), start, goal).length
    # Share by which a distance in double precision may exceed the exact one.
    straight = float(np.linalg.norm(goal - start)) * (1.0 - 1e-12)
    return max(straight, length * (1.0 - MAX_ERROR_PER_CELL) - 2.0 * (INSET + MAX_ERROR_PER_CELL))

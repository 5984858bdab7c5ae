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
    Rectangles,
    find_shortest_way,
    list_rectangles,
)
from cspace._support.arrays import BLOCKED, FREE, Bools, Floats


def list_projections(passable: Bools, is_open: bool) -> list[Rectangles]:
    """List passable cells of the plane, or in space of the projection along each axis.

    ``passable`` has shape (nx, ny) or (nx, ny, nz); ``is_open`` says if paths may leave the grid.
    """
    planes = [passable]
    if passable.ndim == 3:
        planes = [np.asarray(passable.any(axis=axis)) for axis in range(3)]
    # A shortest path outside leads along the border of the grid, through further cells.
    padded = [np.pad(plane, int(is_open), constant_values=True) for plane in planes]
    return [list_rectangles(np.where(plane, FREE, BLOCKED).astype(np.uint8)) for plane in padded]


def min_length(projections: list[Rectangles], is_open: bool, start: Floats, goal: Floats) -> float:
    """Bound the length of paths through passable cells from below, in cells.

    In space, it is the largest bound of the three projections along an axis, with the difference
    along that axis.

    Parameters
    ----------
    projections : list of Rectangles
        Cells through which paths may lead, by :func:`list_projections`.
    is_open : bool
        Whether paths may leave the grid.
    start, goal : ndarray of float64, shape (d,)
        Positions in cells, in the grid.

    Returns
    -------
    float
        Infinite if no path exists.
    """
    # Positions are off by a few units in their last digit, much of the way between near ones.
    rounding = 2.0**-50 * float(np.linalg.norm(start) + np.linalg.norm(goal))
    if len(start) == 2:
        return max(0.0, _min_length_in_plane(projections[0], is_open, start, goal) - rounding)
    bounds = [0.0]
    for axis, projection in enumerate(projections):
        ends = np.delete(start, axis), np.delete(goal, axis)
        across = _min_length_in_plane(projection, is_open, *ends)
        bounds.append(math.hypot(across, goal[axis] - start[axis]) - rounding)
    return max(bounds)


def _min_length_in_plane(
    rectangles: Rectangles, is_open: bool, start: Floats, goal: Floats
) -> float:
    """Bound lengths of paths in the plane from below, in cells.

    ``start`` and ``goal``, shape (2,), are positions in cells.
    """
    length = find_shortest_way(rectangles, start + float(is_open), goal + float(is_open)).length
    # Share by which a distance in double precision may exceed the exact one.
    straight = float(np.linalg.norm(goal - start)) * (1.0 - 1e-12)
    return max(straight, length * (1.0 - MAX_ERROR_PER_CELL) - 2.0 * (INSET + MAX_ERROR_PER_CELL))

"""Intervals of yaw at which a robot is free."""

from __future__ import annotations

import math

import numpy as np

from cspace._rotations.base import TWO_PI, wrap_angles
from cspace._support.arrays import Bools, Floats


def join_yaw_cells(is_free: Bools, bounds: Floats) -> Floats:
    """Join neighbouring free yaw cells to intervals, radians.

    ``bounds``, shape (cells, 2), are the lower and upper bound of each cell, one after another all
    around. Intervals begin in [-pi, pi), in rising order, and end up to a turn later.
    """
    if is_free.all():
        return np.array([[-math.pi, math.pi]])
    first_cells = np.flatnonzero(is_free & ~np.roll(is_free, 1))
    last_cells = np.flatnonzero(is_free & ~np.roll(is_free, -1))
    if len(first_cells) and last_cells[0] < first_cells[0]:
        # The last interval goes on at the first cell.
        last_cells = np.roll(last_cells, -1)
    low = wrap_angles(bounds[first_cells, 0])
    widths = (bounds[last_cells, 1] - bounds[first_cells, 0]) % TWO_PI
    intervals = np.column_stack([low, low + widths])
    return intervals[np.argsort(low)]

"""Sampling of FREE cells, and the nearest one."""

from __future__ import annotations

import math

import numpy as np

from cspace._grid import Grid
from cspace._rotations import Rotations
from cspace._rotations.base import METRES_PER_RADIAN
from cspace._support.arrays import FREE, Floats, Ints, States


class FreeCells:
    """FREE cells of each slice, for sampling.

    Attributes
    ----------
    counts : ndarray of int64, shape (slices,)
        Number of FREE cells of each slice.
    """

    def __init__(self, states: States) -> None:
        """Count the FREE cells of each slice of ``states``, shape (slices, ...)."""
        self._states = states
        # Flat indices of the FREE cells of slices, listed when first needed.
        self._indices: dict[int, Ints] = {}
        # FREE is zero, and zeros are counted fastest.
        self.counts = np.array(
            [cells.size - np.count_nonzero(cells) for cells in states], dtype=np.int64
        )

    def draw(self, slices: Ints, rng: np.random.Generator) -> Ints:
        """Draw a uniform FREE cell of each slice, as flat indices.

        ``slices``, shape (n,), may repeat; each must have a FREE cell.
        """
        drawn = np.empty(len(slices), dtype=np.int64)
        ranks = rng.integers(0, self.counts[slices])
        for number in np.unique(slices).tolist():
            if number not in self._indices:
                self._indices[number] = np.flatnonzero(self._states[number] == FREE)
            in_slice = slices == number
            drawn[in_slice] = self._indices[number][ranks[in_slice]]
        return drawn


def sample(
    free: FreeCells,
    slice_of: Ints,
    rotations: Rotations,
    grid: Grid,
    n: int,
    rng: np.random.Generator,
) -> Floats:
    """Draw ``n`` uniform configurations from all FREE cells, shape (n, size).

    There must be at least one FREE cell.
    """
    # Draw rotation cells by volume and number of FREE cells, then a cell of each, then a point.
    rotation_cells = rotations._draw_cells(free.counts[slice_of], n, rng)
    indices = free.draw(slice_of[rotation_cells], rng)
    cells = np.stack(np.unravel_index(indices, grid.shape), axis=1)
    # Fraction of a cell's width without samples at each border, so that rounding moves none out.
    border_margin = 2.0**-20
    within_cell = rng.uniform(border_margin, 1.0 - border_margin, size=(n, grid.dim))
    positions = grid.lower + grid.spacing * (cells + within_cell)
    turns = rotations._sample(rotation_cells, border_margin, rng)
    return np.concatenate([positions, turns], axis=1)


def find_nearest(
    states: States, slice_of: Ints, rotations: Rotations, grid: Grid, q: Floats
) -> Floats | None:
    """Return the nearest FREE cell's center, or None.

    A radian counts as half a metre.
    """
    position = q[: grid.dim]
    turn_lengths = METRES_PER_RADIAN * rotations._angles_to_centers(q)
    nearest_first = np.argsort(turn_lengths, kind="stable")
    best = None
    min_distance = math.inf
    tested_slices = set[int]()
    for rotation in nearest_first.tolist():
        number = int(slice_of[rotation])
        # All further rotations alone cost more than the best cell so far.
        if turn_lengths[rotation] >= min_distance:
            break
        # The first rotation cell of a slice is its nearest one.
        if number in tested_slices:
            continue
        tested_slices.add(number)
        center = _find_nearest_center(states[number], grid, position)
        if center is None:
            continue
        distance = math.hypot(*(center - position)) + turn_lengths[rotation]
        if distance < min_distance:
            best = np.array([*center, *rotations.centers[rotation]])
            min_distance = distance
    return best


def _find_nearest_center(states: States, grid: Grid, position: Floats) -> Floats | None:
    """Return the center of a slice's FREE cell nearest to a position.

    Returns None if no cell is FREE. The search looks at cells within a distance of the grid's point
    nearest to the position, and doubles it until it finds one. Each cell nearer to the position is
    within that distance of this point, because the grid is convex.
    """
    shape = np.array(states.shape)
    nearest_point = np.clip(position, grid.lower, grid.upper)
    inside = grid.cell_of(nearest_point)
    farthest = float(np.linalg.norm(shape))
    # Distance, in cells, within which the search for the nearest FREE cell begins.
    reach = 16.0
    while True:
        first = np.clip(np.floor(inside - reach), 0, shape).astype(np.int64)
        stop = np.clip(np.ceil(inside + reach) + 1.0, 0, shape).astype(np.int64)
        window = tuple(map(slice, first, stop))
        cells = np.argwhere(states[window] == FREE) + first
        if len(cells):
            centers = grid.center_of(cells)
            nearest_row = np.argmin(_distance_keys(centers, nearest_point, position))
            center = centers[nearest_row]
            # A nearer cell may be beyond the window, unless it reaches as far as this center.
            needed_reach = float(np.linalg.norm(center - position)) / grid.spacing + 1.0
            if needed_reach <= reach or reach >= farthest:
                return np.asarray(center)
        elif reach >= farthest:
            return None
        else:
            needed_reach = 2.0 * reach
        reach = min(needed_reach, farthest)


def _distance_keys(centers: Floats, nearest_point: Floats, position: Floats) -> Floats:
    """Return sort keys for the distances of centers from a position.

    They have shape (n,). ``centers`` has shape (n, d). The keys are squared distances less the one
    of ``nearest_point``, and scaled, because squares of far positions would lose the difference, or
    overflow.
    """
    offsets = centers - nearest_point
    beyond = nearest_point - position
    scale = max(1.0, float(np.abs(beyond).max()))
    squares = (offsets**2).sum(axis=1)
    return np.asarray(squares / scale + 2.0 * (offsets @ (beyond / scale)))

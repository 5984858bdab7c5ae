"""What is known of configurations outside the grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.raster.raster import Raster
from cspace.states import BLOCKED, FREE, MIXED


@dataclass(frozen=True, slots=True)
class Outside:
    """One state for all cells outside the grid, but for a box in which they are MIXED.

    Attributes
    ----------
    box : ndarray of int64, shape (4,)
        Cells ``(x first, y first, x last, y last)``; empty where a first one is beyond the last.
    state : int
        State of every cell that lies neither in the grid nor in the box.
    """

    box: NDArray[np.int64]
    state: int

    @classmethod
    def of(cls, occupied: NDArray[np.bool_], outer: Raster, inner: Raster, policy: str) -> Outside:
        """What is proven outside the grid of a workspace.

        Parameters
        ----------
        occupied : ndarray of bool, shape (nx, ny)
            Outer obstacle cells.
        outer, inner : Raster
            The robot's.
        policy : {"blocked", "free"}
            Whether all beyond the workspace is obstacle or free.
        """
        if policy == "blocked":
            # BLOCKED is proven where an inner offset falls beyond the workspace.
            first, last = -np.asarray(inner.lower), np.asarray(occupied.shape) - 1 - inner.upper
            return cls(np.array([*first, *last]), BLOCKED if inner.count else MIXED)
        obstacles = Raster.trimmed(occupied, (0, 0))
        if not obstacles.count:
            return cls(np.array([0, 0, -1, -1]), FREE)
        # FREE is proven where no outer offset can fall on the bounding box of the obstacles.
        low, high = np.asarray(obstacles.lower), np.asarray(obstacles.upper)
        return cls(np.array([*(low - outer.upper), *(high - outer.lower)]), FREE)

    def is_all_blocked(self, shape: tuple[int, ...]) -> bool:
        """Whether every cell outside a grid of this shape is BLOCKED."""
        first, last = self.box[:2], self.box[2:]
        hidden = (first > last).any() or ((first >= 0).all() and (last < shape).all())
        return bool(self.state == BLOCKED and hidden)

    def walls(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """What is not FREE outside a grid of this shape: rectangles ``(x0, y0, x1, y1)`` in cells, shape (n, 4)."""
        first_x, first_y, stop_x, stop_y = (-np.inf, -np.inf, np.inf, np.inf)
        if self.state == FREE:
            first_x, first_y, stop_x, stop_y = self.box[0], self.box[1], self.box[2] + 1, self.box[3] + 1
        nx, ny = map(float, shape)
        walls = [
            (first_x, first_y, min(stop_x, 0.0), stop_y),
            (max(first_x, nx), first_y, stop_x, stop_y),
            (first_x, first_y, stop_x, min(stop_y, 0.0)),
            (first_x, max(first_y, ny), stop_x, stop_y),
        ]
        real = [wall for wall in walls if wall[0] < wall[2] and wall[1] < wall[3]]
        return np.asarray(real, dtype=np.float64).reshape(-1, 4)

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
    box : ndarray of int64, shape (2 d,)
        First cells along each axis, then the last ones; empty where a first one is beyond the last. An update of the
        workspace changes it in place.
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
        occupied : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
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
        obstacles = Raster.trimmed(occupied, (0,) * occupied.ndim)
        return cls(reached(np.array([*obstacles.lower, *obstacles.upper]), outer), FREE)

    def is_all_blocked(self, shape: tuple[int, ...]) -> bool:
        """Whether every cell outside a grid of this shape is BLOCKED."""
        first, last = self.box[: len(shape)], self.box[len(shape) :]
        hidden = (first > last).any() or ((first >= 0).all() and (last < shape).all())
        return bool(self.state == BLOCKED and hidden)

    def walls(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """What is not FREE outside a grid of this shape: boxes in cells, lower corners then upper ones, shape (n, 2 d).

        The boxes may overlap, and those of a state that is not FREE reach to infinity.
        """
        dim = len(shape)
        whole = np.repeat([-np.inf, np.inf], dim)
        if self.state == FREE:
            whole = self.box + np.repeat([0.0, 1.0], dim)
        walls = np.tile(whole, (2 * dim, 1))
        for axis, count in enumerate(shape):
            below, above = walls[2 * axis], walls[2 * axis + 1]
            below[dim + axis] = min(below[dim + axis], 0.0)
            above[axis] = max(above[axis], float(count))
        return walls[(walls[:, :dim] < walls[:, dim:]).all(axis=1)]


def reached(obstacles: NDArray[np.int64], outer: Raster) -> NDArray[np.int64]:
    """The box from whose cells some offset can fall on a box of obstacle cells; beyond it FREE is proven.

    Both boxes are first cells along each axis, then last ones, shape (2 d,); empty where a first one is beyond the
    last.
    """
    dim = len(obstacles) // 2
    low, high = obstacles[:dim], obstacles[dim:]
    if (low > high).any():
        return np.repeat([0, -1], dim)
    return np.array([*(low - outer.upper), *(high - outer.lower)])

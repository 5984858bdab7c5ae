"""What is known of configurations outside the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Ints
from cspace.raster import Raster

OUTSIDES: Final = ("blocked", "free")
"""What lies outside the grid."""

UNKNOWN: Final = "unknown"
"""What lies outside a part of a larger map: nothing is known of it, and so all there is MIXED."""


@dataclass(frozen=True, slots=True)
class Exterior:
    """For each slice one state for all cells outside the grid, but for a box in which they are MIXED.

    Attributes
    ----------
    table : ndarray of int64, shape (slices, 2 d + 1)
        The box's first cell, its last cell, and the state of every cell that lies neither in the grid nor in the box.
        A box is empty where a first number is above the last. An update of the workspace changes it in place.
    """

    table: Ints

    @classmethod
    def of(cls, occupied: Bools, rasters: Sequence[tuple[Raster, Raster]], policy: str) -> Exterior:
        """What is proven outside the grid, from the outer cells of a workspace and the robot's rasters, of each slice.

        ``policy`` is what lies outside the workspace: "blocked", "free" or "unknown".
        """
        box = np.zeros((2, occupied.ndim), dtype=np.int64)
        if policy == "free":
            cells = Raster.from_bitmap(occupied, (0,) * occupied.ndim)
            box = np.array([cells.lower, cells.upper])
        return cls.around(occupied.shape, box, rasters, policy)

    @classmethod
    def around(cls, shape: Sequence[int], box: Ints, rasters: Sequence[tuple[Raster, Raster]], policy: str) -> Exterior:
        """The same of a workspace of a shape, by the first and last cell of its obstacles, which only "free" reads."""
        if policy == UNKNOWN:
            nowhere = np.repeat([0, -1], len(shape))
            return cls(np.array([[*nowhere, MIXED]] * len(rasters), dtype=np.int64))
        if policy == "free":
            return cls(np.array([[*reached(box.ravel(), outer), FREE] for outer, _ in rasters], dtype=np.int64))
        # BLOCKED is proven where an inner offset falls outside the workspace.
        last = np.asarray(shape) - 1
        rows = [
            [*-np.asarray(inner.lower), *(last - inner.upper), BLOCKED if inner.count else MIXED]
            for _, inner in rasters
        ]
        return cls(np.array(rows, dtype=np.int64))

    @property
    def boxes(self) -> Ints:
        """First and last cell of each box, shape (slices, 2 d); a view."""
        return self.table[:, :-1]

    def is_all_blocked(self, shape: tuple[int, ...]) -> Bools:
        """Whether every cell outside a grid of this shape is BLOCKED, for each slice."""
        first, last = self.boxes[:, : len(shape)], self.boxes[:, len(shape) :]
        hidden = (first > last).any(axis=1) | ((first >= 0) & (last < shape)).all(axis=1)
        return np.asarray((self.table[:, -1] == BLOCKED) & hidden)


def reached(obstacles: Ints, outer: Raster) -> Ints:
    """The box from whose cells some offset can fall on a box of obstacle cells; outside it FREE is proven.

    Both boxes are first cells along each axis, then last ones, shape (2 d,); empty where a first one is above the
    last.
    """
    dim = len(obstacles) // 2
    low, high = obstacles[:dim], obstacles[dim:]
    if (low > high).any():
        return np.repeat([0, -1], dim)
    return np.array([*(low - outer.upper), *(high - outer.lower)])

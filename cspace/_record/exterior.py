"""Proven states of configurations outside the grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, get_args

import numpy as np

from cspace._grid import FARTHEST_CELL
from cspace._raster import Raster
from cspace._support.arrays import BLOCKED, FREE, MIXED, Bools, Ints
from cspace._support.words import Outside

OUTSIDES: Final[tuple[Outside, ...]] = get_args(Outside)
"""Assumptions about the workspace outside its grid."""

UNKNOWN: Final = "unknown"
"""Outside a part of a larger map nothing is known, so all cells there are MIXED."""

_STATES: Final = {"free": (FREE,), "blocked": (MIXED, BLOCKED), UNKNOWN: (MIXED,)}
"""States that cells outside the grid may have, for each state of the space outside."""


@dataclass(frozen=True, slots=True)
class Exterior:
    """States of configuration cells outside the grid, for each slice.

    All cells outside have one state, except that cells in a box are MIXED. If the space outside the
    workspace is free, the robot may reach an obstacle from the box; if that space is blocked, it
    may fit into the workspace there.

    Attributes
    ----------
    table : ndarray of int64, shape (slices, 2 d + 1)
        First cell of the box, its last cell, and the state of cells outside both grid and box. A
        box is empty if first > last along an axis. Workspace updates change the table in place. On
        a floor, d is 2, and the box is that of all heights.
    """

    table: Ints

    @classmethod
    def checked(cls, table: Ints, outside: str) -> Exterior:
        """Return an exterior that a file holds.

        Raises ValueError if it contradicts the space outside.
        """
        boxes = table[:, :-1]
        states = table[:, -1]
        if not np.isin(states, _STATES[outside]).all():
            raise ValueError(f"its exterior has other states than space that is {outside} outside")
        # Largest coordinate of a cell of the exterior's box; real ones stay below twice 2^22.
        is_far = np.abs(boxes) > 2**40
        if outside == "blocked":  # boxes have no end where a joint goes on beyond a map of it
            is_far &= np.abs(boxes) != FARTHEST_CELL
        if is_far.any():
            raise ValueError("its exterior reaches beyond all grids")
        return cls(table)

    @classmethod
    def of(
        cls,
        occupied: Bools,
        rasters: Sequence[tuple[Raster, Raster]],
        policy: str,
        on_floor: bool = False,
    ) -> Exterior:
        """Compute the exterior from a workspace's outer cells.

        ``rasters`` are the outer and inner raster of each slice. ``policy`` is the state of the
        space outside the workspace: "blocked", "free" or "unknown". ``on_floor`` says whether the
        robot keeps its heights, the third axis.
        """
        box = np.zeros((2, occupied.ndim), dtype=np.int64)
        if policy == "free":
            cells = Raster.from_bitmap(occupied, (0,) * occupied.ndim)
            box = np.array([cells.lower, cells.upper])
        table = cls.around(occupied.shape, box, rasters, policy).table
        return cls(table.take([0, 1, 3, 4, 6], axis=1) if on_floor else table)

    @classmethod
    def around(
        cls, shape: Sequence[int], box: Ints, rasters: Sequence[tuple[Raster, Raster]], policy: str
    ) -> Exterior:
        """Compute the exterior from a grid's shape and its obstacles' box.

        ``box``, shape (2, d), has the first and last obstacle cell; only policy "free" reads it.
        Other arguments are as for :meth:`of`.
        """
        nowhere = np.repeat([0, -1], len(shape))  # an empty box: its first cell is 0, its last -1
        rows = list[list[int]]()
        for outer, inner in rasters:
            if policy == UNKNOWN:
                row = [*nowhere, MIXED]
            elif policy == "free":
                # A cell k is MIXED if one of the cells k + m may be an obstacle, where m is an
                # offset of the outer raster.
                low, high = box
                reached = [*(low - outer.upper), *(high - outer.lower)]
                is_empty = (low > high).any()
                row = [*(nowhere if is_empty else reached), FREE]
            else:
                # A cell k is MIXED if all cells k + m lie in the workspace, where m is an offset of
                # the inner raster.
                last = np.asarray(shape) - 1
                state = BLOCKED if inner.count else MIXED
                row = [*np.negative(inner.lower), *(last - inner.upper), state]
            rows.append(row)
        return cls(np.array(rows, dtype=np.int64))

    def is_all_blocked(self, shape: tuple[int, ...]) -> Bools:
        """Return a mask of the slices with only BLOCKED cells outside.

        ``shape`` is that of the grid.
        """
        boxes = self.table[:, :-1]
        beyond = self.table[:, -1]
        first, last = np.split(boxes, 2, axis=1)
        # A box that is empty or within the grid has no MIXED cell outside the grid.
        is_empty = (first > last).any(axis=1)
        is_in_grid = ((first >= 0) & (last < shape)).all(axis=1)
        return np.asarray((beyond == BLOCKED) & (is_empty | is_in_grid))

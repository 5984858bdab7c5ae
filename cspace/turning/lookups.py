"""Look-ups in the map of a robot that translates and turns in the plane."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import partial
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.clearance import clearance_field
from cspace.coarse import coarse_for
from cspace.once import Once
from cspace.outside import Outside
from cspace.overlap import raster_runs
from cspace.plane import table_of
from cspace.raster.raster import Raster
from cspace.rotations import TURN, Rotations
from cspace.translating import Kernel, entry


class TurningLookups:
    """The compiled look-ups of a stack; each kernel takes arrays of shape (n, 3) and fills one of shape (n,).

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny)
    slice_of : ndarray of int64, shape (rotations,)
    rotations : Rotations
    frame : ndarray of float64, shape (5,)
        Lower corner, spacing and upper corner of the grid.
    outsides : sequence of Outside, one for each slice
    """

    dof = 3

    def __init__(
        self,
        stack: NDArray[np.uint8],
        slice_of: NDArray[np.int64],
        rotations: Rotations,
        frame: NDArray[np.float64],
        outsides: Sequence[Outside],
    ) -> None:
        self._stack, self._slice_of, self._frame, self._outsides = stack, slice_of, frame, outsides
        self._borders = np.asarray(rotations.borders)
        boxes = np.array([outside.box for outside in outsides], dtype=np.int64)
        beyonds = np.array([outside.state for outside in outsides], dtype=np.int64)
        self._map = (stack, slice_of, self._borders, frame, boxes, beyonds)
        self._once = Once()

    def classify(self) -> Kernel:
        """Kernel of states."""
        from cspace.turning import _kernels

        return partial(_kernels.classify, *self._map)

    def edges(self, number: int = 0) -> Kernel:
        """Kernel of edges along the shorter arc, of which there are some ``number`` to come."""
        from cspace.turning.walks import _kernels

        stack, *rest = self._map
        return partial(_kernels.edges_are_free, stack, coarse_for(number, stack, self._once), *rest)

    def boxes(self, distance: float, angle: float) -> Kernel:
        """Kernel of boxes of configurations around configurations."""
        from cspace.turning import _kernels

        return partial(_kernels.boxes_are_free, *self._map, distance, angle)

    def clearances(self) -> Kernel:
        """Kernel of clearances."""
        from cspace.turning import _kernels

        return partial(_kernels.clearances, *self._clearance())

    def overlaps(self, sums: NDArray[np.int32], rasters: list[Raster], beyond: int) -> Kernel:
        """Kernel of overlaps of the robot with the obstacle cells of ``sums``."""
        from cspace.turning import _kernels

        runs = self._once("runs", lambda: [raster_runs(raster) for raster in rasters])
        ends = np.cumsum([len(rows) for rows in runs])
        return partial(
            _kernels.overlaps, sums, self._slice_of, self._borders, self._frame, np.concatenate(runs), ends, beyond
        )

    def point_checker(self) -> Callable[..., bool]:
        """``check(x, y, yaw)``: whether a configuration is FREE."""
        tables = self._once("tables", lambda: [table_of(part) for part in self._stack])
        slices = [tables[number] for number in self._slice_of.tolist()]
        lower_x, lower_y, spacing, upper_x, upper_y = self._frame.tolist()
        borders = self._borders.tolist()
        first, last = borders[0], len(slices) - 1
        state_at = self._state_at()

        def check(x: float, y: float, yaw: float) -> bool:
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                cell = bisect_right(borders, yaw - floor((yaw - first) / TURN) * TURN) - 1
                rows = slices[min(max(cell, 0), last)]
                return not rows[int((x - lower_x) / spacing)][int((y - lower_y) / spacing)]
            return not state_at(x, y, yaw)

        return check

    def edge_checker(self) -> Callable[..., bool]:
        """``check(x0, y0, yaw0, x1, y1, yaw1)``: whether an edge along the shorter arc is FREE."""
        from cspace.turning.walks import _kernels

        return self._once("edge", lambda: entry(_kernels.turning_edge_is_free, self._map, 6))

    def clearance_checker(self) -> Callable[..., float]:
        """``check(x, y, yaw)``: the clearance of a configuration."""
        from cspace.turning import _kernels

        return self._once("clearance of", lambda: entry(_kernels.turning_clearance_at, self._clearance(), 3))

    def _state_at(self) -> Callable[..., int]:
        from cspace.turning import _kernels

        return self._once("state of", lambda: entry(_kernels.turning_state_at, self._map, 3))

    def _clearance(self) -> tuple[Any, ...]:
        def make() -> tuple[Any, ...]:
            squares = np.empty(self._stack.shape, dtype=np.int32)
            some = np.array([clearance_field(part, out).some for part, out in zip(self._stack, squares, strict=True)])
            walls = [outside.walls(self._stack.shape[1:]) for outside in self._outsides]
            return squares, some, np.concatenate(walls), np.cumsum([len(part) for part in walls])

        return *self._once("clearance", make), *self._map

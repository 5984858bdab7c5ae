"""Look-ups in the map of a robot that translates in the plane."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.clearance import clearance_field
from cspace.once import Once
from cspace.outside import Outside
from cspace.overlap import raster_runs
from cspace.raster.raster import Raster

Kernel = Callable[..., int]


class PlaneLookups:
    """The compiled look-ups of one slice; each kernel takes arrays of shape (n, 2) and fills one of shape (n,).

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny)
    frame : ndarray of float64, shape (5,)
        Lower corner, spacing and upper corner of the grid.
    outside : Outside
    """

    dof = 2

    def __init__(self, state: NDArray[np.uint8], frame: NDArray[np.float64], outside: Outside) -> None:
        self._state, self._frame, self._outside = state, frame, outside
        self._map = (state, frame, outside.box, outside.state)
        self._once = Once()

    def classify(self) -> Kernel:
        """Kernel of states."""
        from cspace import _kernels

        return partial(_kernels.classify, *self._map)

    def edges(self) -> Kernel:
        """Kernel of straight edges."""
        from cspace import _kernels

        return partial(_kernels.edges_are_free, *self._map)

    def boxes(self, distance: float, angle: float) -> Kernel:
        """Kernel of squares around configurations; the angle plays no part."""
        from cspace import _kernels

        return partial(_kernels.squares_are_free, *self._map, distance)

    def clearances(self) -> Kernel:
        """Kernel of clearances."""
        from cspace import _kernels

        return partial(_kernels.clearances, *self._clearance())

    def overlaps(self, sums: NDArray[np.int32], rasters: list[Raster], beyond: int) -> Kernel:
        """Kernel of overlaps of the robot with the obstacle cells of ``sums``."""
        from cspace import _kernels

        runs = self._once("runs", lambda: raster_runs(rasters[0]))
        return partial(_kernels.overlaps, sums, self._frame, runs, beyond)

    def point_checker(self) -> Callable[..., bool]:
        """``check(x, y)``: whether a configuration is FREE."""
        # The last row and column stand twice, for points on the grid's upper border.
        rows = self._once("rows", lambda: table_of(self._state))
        lower_x, lower_y, spacing, upper_x, upper_y = self._frame.tolist()
        state_at = self._state_at()

        def check(x: float, y: float) -> bool:
            if lower_x <= x <= upper_x and lower_y <= y <= upper_y:
                return not rows[int((x - lower_x) / spacing)][int((y - lower_y) / spacing)]
            return not state_at(x, y)

        return check

    def edge_checker(self) -> Callable[..., bool]:
        """``check(x0, y0, x1, y1)``: whether a straight edge is FREE."""
        from cspace import _kernels

        return self._once("edge", lambda: entry(_kernels.edge_is_free, self._map, 4))

    def clearance_checker(self) -> Callable[..., float]:
        """``check(x, y)``: the clearance of a configuration."""
        from cspace import _kernels

        return self._once("clearance of", lambda: entry(_kernels.clearance_at, self._clearance(), 2))

    def _state_at(self) -> Callable[..., int]:
        from cspace import _kernels

        return self._once("state of", lambda: entry(_kernels.state_at, self._map, 2))

    def _clearance(self) -> tuple[Any, ...]:
        field = self._once("clearance", lambda: clearance_field(self._state))
        return field.squares, *self._map, self._outside.walls(self._state.shape), field.some


def table_of(state: NDArray[np.uint8]) -> list[bytes]:
    """The rows of a map, each and all with the last entry twice, for quick look-ups from Python."""
    return [row.tobytes() for row in np.pad(state, ((0, 1), (0, 1)), mode="edge")]


def entry(kernel: Any, fixed: tuple[Any, ...], floats: int) -> Callable[..., Any]:
    """A kernel with its first arguments bound and some floats to come, without numba's dispatch on every call."""
    import numba

    types = (*map(numba.typeof, fixed), *[numba.float64] * floats)
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)

"""Look-ups in the map of a robot that only translates, in the plane or in space."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.clearance import clearance_field
from cspace.coarse import coarse_for
from cspace.once import Once
from cspace.outside import Outside
from cspace.overlap import raster_runs
from cspace.raster.raster import Raster

Kernel = Callable[..., int]


class TranslatingLookups(ABC):
    """The compiled look-ups of one slice; each kernel takes arrays of shape (n, d) and fills one of shape (n,).

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
        In one piece, in C order.
    frame : ndarray of float64, shape (2 d + 1,)
        Lower corner, spacing and upper corner of the grid.
    outside : Outside
    """

    def __init__(self, state: NDArray[np.uint8], frame: NDArray[np.float64], outside: Outside) -> None:
        self.dof = state.ndim
        self._state, self._frame, self._outside = state, frame, outside
        self._map = (state, frame, outside.box, outside.state)
        self._once = Once()

    @property
    @abstractmethod
    def _kernels(self) -> ModuleType:
        """The compiled kernels of the dimension."""

    @property
    @abstractmethod
    def _walks(self) -> ModuleType:
        """Those of edges."""

    def classify(self) -> Kernel:
        """Kernel of states."""
        return partial(self._kernels.classify, *self._map)

    def edges(self, number: int = 0) -> Kernel:
        """Kernel of straight edges, of which there are some ``number`` to come; many are worth a coarse map."""
        state, *rest = self._map
        return partial(self._walks.edges_are_free, state, self.coarse(number), *rest)

    def coarse(self, number: int) -> NDArray[np.uint8]:
        """The coarse map, if it was made before or pays for a number of edges; else an empty one."""
        coarse: NDArray[np.uint8] = coarse_for(number, self._state[None], self._once)[0]
        return coarse

    def boxes(self, distance: float, angle: float) -> Kernel:
        """Kernel of squares or cubes around configurations; the angle plays no part."""
        return partial(self._kernels.boxes_are_free, *self._map, distance)

    def clearances(self) -> Kernel:
        """Kernel of clearances."""
        return partial(self._kernels.clearances, *self._clearance())

    def overlaps(self, sums: NDArray[Any], rasters: list[Raster], beyond: int) -> Kernel:
        """Kernel of overlaps of the robot with the obstacle cells of ``sums``."""
        runs = self._once("runs", lambda: raster_runs(rasters[0]))
        return partial(self._kernels.overlaps, sums, self._frame, runs, beyond)

    @abstractmethod
    def point_checker(self) -> Callable[..., bool]:
        """``check(*q)``: whether a configuration is FREE."""

    def edge_checker(self) -> Callable[..., bool]:
        """``check(*q0, *q1)``: whether a straight edge is FREE."""
        return self._once("edge", lambda: entry(self._walks.edge_is_free, self._map, 2 * self.dof))

    def clearance_checker(self) -> Callable[..., float]:
        """``check(*q)``: the clearance of a configuration."""
        return self._once("clearance of", lambda: entry(self._kernels.clearance_at, self._clearance(), self.dof))

    def _clearance(self) -> tuple[Any, ...]:
        field = self._once("clearance", lambda: clearance_field(self._state))
        return field.squares, *self._map, self._outside.walls(self._state.shape), field.some


def entry(kernel: Any, fixed: tuple[Any, ...], floats: int) -> Callable[..., Any]:
    """A kernel with its first arguments bound and some floats to come, without numba's dispatch on every call."""
    import numba

    types = (*map(numba.typeof, fixed), *[numba.float64] * floats)
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)

"""Engines: what decides, for every position of a robot at once, whether it overlaps the obstacles.

There are two, which share no code and make the same map: transforms, whose cost hardly depends on the robot, and
dilation, 64 cells at a time, which costs a step for each row of the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools
from cspace.engines import dilation, fft
from cspace.raster import Raster

ROWS: Final = {2: 30, 3: 280}
"""Rows of consecutive offsets, in the plane and in space, for each cell that a robot is across, from which on
transforms are the quicker engine.

Measured once, on two cores: robots 40 to 400 cells across break even at 23 to 50 in the plane, 280 to 350 in space."""


class Engine(Protocol):
    """What :func:`cspace.build` needs of an engine."""

    COUNTS: bool
    """Whether it can count overlaps."""

    def collide(
        self,
        occupied: Bools,
        rasters: Sequence[Raster],
        out: Sequence[NDArray[Any]],
        *,
        outside: bool,
        add: bool = False,
        workers: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> str:
        """Write, for every cell k of the map, what becomes of the overlaps of ``W[k + m]`` with the offsets m.

        Parameters
        ----------
        occupied : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
            Obstacle cells W.
        rasters : sequence of Raster
            Robot offsets.
        out : sequence of ndarray, one for each raster, all of the shape of ``occupied`` or of a smaller one
            C-ordered; a smaller one gets the first cells. Booleans become whether there is any overlap; int32, with
            engines that count, how many there are.
        outside : bool
            Whether the cells outside the map are obstacles.
        add : bool
            Add 1 to ``out``, arrays of uint8, wherever there is any overlap.
        workers : int, optional
            Threads; by default one for each core that the process may use.
        progress : callable, optional
            Called with (parts done, parts in all), from the calling thread.

        Returns
        -------
        {"integer", "float32", "float64"}
            The arithmetic that it took.
        """

    def bytes_needed(self, shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
        """Memory that :meth:`collide` takes at most beside its input and results, in bytes."""


ENGINES: Final[dict[str, Engine]] = {"fft": fft, "direct": dilation}

METHODS: Final = (*ENGINES, "auto")


def choose(rasters: Sequence[Raster], *, counts: bool = False) -> str:
    """The engine to take for a robot's rasters: dilation, unless overlaps are counted or it has very many rows."""
    if counts:
        return "fft"
    sample = [raster.cells for raster in rasters[:: max(1, len(rasters) // 8)]]  # turned robots are much alike
    most = sum(ROWS[cells.ndim] * max(cells.shape) for cells in sample)
    return "direct" if sum(map(_rows, sample)) <= most else "fft"


def _rows(cells: Bools) -> int:
    """Number of runs of set entries along the last axis."""
    return int(np.count_nonzero(cells[..., :1]) + np.count_nonzero(cells[..., 1:] > cells[..., :-1]))

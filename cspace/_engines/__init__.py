"""Engines, which test all robot positions at once for overlaps with obstacles.

There are two; they share no code and build the same map. The cost of transforms hardly depends on
the robot; dilation handles 64 cells at a time, at the cost of one step for each row of the robot.

Words that the modules of this package share:

- *slice*: the map at one rotation cell, or at several where the robot covers the same cells.
- *run*: consecutive cells of a row.
- *tile*: a part of the map that one transform handles.
- *window*: a box of indices, from its start to before its stop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from cspace._engines import dilation, fft
from cspace._raster import Raster
from cspace._support.arrays import Bools
from cspace._support.words import Method

MAX_ROWS_PER_CELL: Final = {2: 60, 3: 900}
"""Rows of offsets, per cell of robot diameter, up to which dilation is faster, by dimension.

Measured once, on one core: robots 40 to 400 cells across break even at 45 to 220 in the plane and
at 840 to 1240 in space, with most results near the values here.
"""


class Engine(Protocol):
    """Interface of engines to :func:`cspace.build`."""

    COUNTS: bool
    """True if the engine can count overlaps."""

    def write_overlaps(
        self,
        occupied: Bools,
        rasters: Sequence[Raster],
        out: Sequence[NDArray[Any]],
        *,
        outside: bool,
        add: bool = False,
        workers: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        """Write the robot's overlaps with obstacles at each cell.

        The overlaps at cell k are the offsets m of the robot with ``W[k + m]`` set.

        Parameters
        ----------
        occupied : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
            Obstacle cells W.
        rasters : sequence of Raster
            Robot offsets.
        out : sequence of ndarray, one for each raster
            C-ordered, all of the shape of ``occupied`` or of one smaller shape, for the first
            cells. Booleans are set to True if any offset overlaps; int32, with engines that count,
            to the number of overlaps.
        outside : bool
            True if the cells outside the map are obstacles.
        add : bool
            Instead, add 1 to ``out``, arrays of uint8, at each cell with any overlap.
        workers : int, optional
            Threads; by default one for each core that the process may use.
        progress : callable, optional
            Called with (finished parts, all parts), from the calling thread.
        """


ENGINES: Final[dict[str, Engine]] = {"fft": fft, "direct": dilation}

METHODS: Final[tuple[Method, ...]] = get_args(Method)
"""Values of ``method`` in :func:`cspace.build`."""


def choose_engine(rasters: Sequence[Raster], *, counts: bool = False) -> Method:
    """Return the name of the faster engine for a robot's rasters.

    That is dilation, unless overlaps are counted or the robot has very many rows.
    """
    if counts:
        return "fft"
    # Rotations of one robot are similar, so about eight of them represent all.
    stride = max(1, len(rasters) // 8)
    sample = [raster.cells for raster in rasters[::stride]]
    rows = sum(_count_rows(cells) for cells in sample)
    max_rows = sum(MAX_ROWS_PER_CELL[cells.ndim] * max(cells.shape) for cells in sample)
    return "direct" if rows <= max_rows else "fft"


def put_layers_first(cells: Bools) -> Bools:
    """Return cells (x, y, layer) as (layer, x, y), so that runs of rasters lie along y."""
    return np.ascontiguousarray(np.moveaxis(cells, 2, 0))


def find_overlaps(
    occupied: Bools, rasters: Sequence[Raster], *, outside: bool, on_floor: bool = False
) -> Bools:
    """Return a mask of the cells at which each raster meets occupied cells.

    With ``outside``, all cells outside the map are occupied too. With ``on_floor``, the robot keeps
    its heights, the third axis, which the mask then lacks.
    """
    shape = occupied.shape
    if on_floor:
        occupied = put_layers_first(occupied)
        rasters = [raster.layers_first for raster in rasters]
        shape = (1, *shape[:2])
    hits = np.zeros((len(rasters), *shape), dtype=np.bool_)
    engine = ENGINES[choose_engine(rasters)]
    engine.write_overlaps(occupied, rasters, list(hits), outside=outside)
    return hits[:, 0] if on_floor else hits


def _count_rows(cells: Bools) -> int:
    """Return the number of runs of set entries along the last axis."""
    # A run begins at the first entry of a line, or after an entry that is not set.
    begin_lines = np.count_nonzero(cells[..., :1])
    begin_after_gaps = np.count_nonzero(cells[..., 1:] > cells[..., :-1])
    return int(begin_lines + begin_after_gaps)

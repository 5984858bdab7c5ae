"""Stamping: what a ROS user would run. The obstacle cells on a border print the robot's bitmap, one yaw at a time."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cspace.arrays import Bools, Ints
from cspace.compiling import jit
from cspace.raster import Raster
from cspace.threads import cores


@jit
def _stamp(out: Bools, border: Ints, runs: Ints) -> None:
    """Set the rows ``(x, first y, stop y)`` of a bitmap around every border cell, clipped to the map."""
    nx, ny = out.shape
    for c in range(border.shape[0]):
        x, y = border[c]
        for r in range(runs.shape[0]):
            i = x + runs[r, 0]
            if 0 <= i < nx:
                out[i, max(0, y + runs[r, 1]) : max(0, min(ny, y + runs[r, 2]))] = True


def stamp(occupied: Bools, rasters: Sequence[Raster], workers: int | None = None) -> list[Bools]:
    """Where robots touch obstacles, with everything beyond the map free.

    A robot whose offsets hang together by their sides and that meets the obstacles meets one of their border cells, or
    has all of its offsets in them. The border cells are stamped; the others are covered by the map itself, moved by one
    of the offsets.

    Parameters
    ----------
    occupied : ndarray of bool, shape (nx, ny)
    rasters : sequence of Raster
        Each in one piece, by steps along the axes.
    workers : int, optional
        Threads, which take a robot each; by default one for each core.

    Returns
    -------
    list of ndarray of bool, shape (nx, ny)
    """
    border = border_cells(occupied)

    def one(raster: Raster) -> Bools:
        out = np.zeros_like(occupied)
        dx, dy = (np.argwhere(raster.cells)[raster.count // 2] + raster.lower).tolist()
        target, source = zip(*(_overlap(n, d) for n, d in zip(occupied.shape, (dx, dy), strict=True)), strict=True)
        out[target] = occupied[source]
        _stamp(out, border, _mirrored_runs(raster))
        return out

    with ThreadPoolExecutor(workers or cores()) as pool:
        return list(pool.map(one, rasters))


def border_cells(occupied: Bools) -> Ints:
    """Occupied cells beside one that is not, or on the border of the map, shape (n, 2)."""
    wide = np.pad(occupied, 1)
    hidden = wide[:-2, 1:-1] & wide[2:, 1:-1] & wide[1:-1, :-2] & wide[1:-1, 2:]
    return np.argwhere(occupied & ~hidden)


def _overlap(size: int, by: int) -> tuple[slice, slice]:
    """Cells k, and cells k + by, that both lie within the map."""
    first, stop = max(0, -by), max(0, min(size, size - by))
    return slice(min(first, stop), stop), slice(min(first, stop) + by, stop + by) if first < stop else slice(0, 0)


def _mirrored_runs(raster: Raster) -> Ints:
    """Runs ``(x, first y, stop y)`` of the offsets ``-m``, as a configuration k is hit where k + m is occupied."""
    steps = np.diff(np.pad(raster.cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, starts = np.nonzero(steps > 0)
    stops = np.nonzero(steps < 0)[1]
    x, y = raster.lower
    return np.column_stack([-(rows + x), 1 - (stops + y), 1 - (starts + y)])

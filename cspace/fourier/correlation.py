"""Correlation of a workspace bitmap with robot rasters (Kavraki, 1995), by overlap-save in tiles.

``overlap[k] = sum over m of W[k + m] * A[m]`` for every cell k of the map, where W beyond the map is all obstacle or
all free. The map is read in tiles small enough for a core's cache. A tile without obstacles, or all obstacle, is
settled without a transform; the spectrum of any other is multiplied with that of every raster. Where it is proven that
the rounding allows it, one transform yields the overlaps with several rasters, or in several tiles, as digits of one
number.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspace.costs import figures
from cspace.fourier.precision import most_digits
from cspace.fourier.tile_run import Part, TileRun, write
from cspace.fourier.tiles import Tiling, choose_tiling
from cspace.raster.raster import Raster
from cspace.threads import cores, in_threads

Bools = NDArray[np.bool_]
Item = TypeVar("Item")

TILE_SPECTRA = 3
"""Arrays as large as a tile's spectrum that a thread holds at once, at most."""

SPECTRA_BYTES = 2**25
"""Memory for robot spectra held at once; more rasters than fit are taken in turns."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """Results of :func:`correlate`.

    Attributes
    ----------
    results : list of ndarray
        For each raster, over the map: whether any offset meets an obstacle cell (bool), or how many do (int32).
    precision : str
        "float32" or "float64", whichever the transforms were run in.
    error : float
        Proven bound of the error of an overlap, or of a sum of several, before it was rounded; always below 1/4.
    """

    results: list[NDArray[Any]]
    precision: str
    error: float


def correlate(
    occupied: Bools,
    rasters: Sequence[Raster],
    *,
    outside: bool,
    counts: bool = False,
    out: Sequence[NDArray[Any]] | None = None,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Correlation:
    """Correlate one bitmap with several rasters.

    Parameters
    ----------
    occupied : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
        Obstacle cells W.
    rasters : sequence of Raster
        Robot offsets A.
    outside : bool
        Whether the cells beyond the map are obstacle.
    counts : bool
        Return overlap counts rather than whether there is any overlap.
    out : sequence of ndarray, optional
        Where to write the results, one C-ordered array for each raster; new arrays if left out.
    add : bool
        Add 1 to ``out``, arrays of uint8, wherever there is any overlap.
    workers : int, optional
        Threads; by default one for each core that the process may use. With 1 everything runs in the calling thread,
        where ``scipy.fft.set_backend`` holds.
    progress : callable, optional
        Called with (tiles done, tiles in all), from the calling thread.

    Returns
    -------
    Correlation
    """
    shape = occupied.shape
    dtype = np.int32 if counts else np.bool_
    results: list[NDArray[Any]] = [np.empty(shape, dtype) for _ in rasters] if out is None else list(out)
    parts = [Part.within_reach(raster, shape, outside) for raster in rasters]
    live = [(part, result) for part, result in zip(parts, results, strict=True) if part.cells.size]
    for part, result in zip(parts, results, strict=True):
        if not part.cells.size:
            write(result, part.constant, add)
    if not live:
        return Correlation(results, "float32", 0.0)

    threads = workers or cores()
    lower, tiling = _tiling([part for part, _ in live], shape, threads)
    corners = list(itertools.product(*(range(0, n, s) for n, s in zip(shape, tiling.step, strict=True))))
    stacks = [corners[first : first + tiling.stack] for first in range(0, len(corners), tiling.stack)]
    groups = [live[first : first + tiling.digits] for first in range(0, len(live), tiling.digits)]
    turns = min(len(groups), math.ceil(len(groups) * tiling.spectrum_bytes / SPECTRA_BYTES))
    pieces = math.ceil(tiling.pieces / turns)
    for turn in range(turns):
        run = TileRun(occupied, outside, tiling, lower, add)
        members = _share(groups, turn, turns)
        # Of a single robot the lines of its transform are shared out, of several the robots.
        alone = partial(run.robot_spectrum, threads=threads if len(members) == 1 else 1)
        ready = list(zip(members, in_threads(alone, members, threads), strict=True))
        tasks = [(stack, _share(ready, piece, pieces)) for piece in range(pieces) for stack in stacks]
        advance = None if progress is None else partial(_advance, progress, turn * len(tasks), turns * len(tasks))
        in_threads(run.settle, tasks, threads, advance)
    return Correlation(results, tiling.precision, tiling.error)


def transform_bytes(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Memory that :func:`correlate` takes at most beside its input and results, in bytes.

    Parameters
    ----------
    shape : sequence of int
        Cells of the map.
    rasters : sequence of Raster
    workers : int, optional
        As for :func:`correlate`.
    """
    live = [part for part in (Part.within_reach(raster, shape, False) for raster in rasters) if part.cells.size]
    if not live:
        return 0
    threads = workers or cores()
    _, tiling = _tiling(live, shape, threads)
    tiles = math.prod(-(-n // step) for n, step in zip(shape, tiling.step, strict=True)) * tiling.pieces
    robots = min(-(-len(live) // tiling.digits) * tiling.spectrum_bytes, SPECTRA_BYTES + tiling.spectrum_bytes)
    return robots + TILE_SPECTRA * min(threads, tiles) * tiling.spectrum_bytes


def transform_seconds(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> float:
    """How long :func:`correlate` is expected to take on this machine, parameters as for :func:`transform_bytes`."""
    live = [part for part in (Part.within_reach(raster, shape, False) for raster in rasters) if part.cells.size]
    return _tiling(live, shape, workers or cores())[1].seconds if live else 0.0


def least_seconds(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> float:
    """A bound below what :func:`transform_seconds` tells, for next to nothing.

    Every result lies in an inverse transform, which yields no more digits than its error allows for.
    """
    live = [raster for raster in rasters if raster.cells.size]
    if not live:
        return 0.0
    extent = np.max([raster.cells.shape for raster in live], axis=0).tolist()
    count, costs = max(raster.count for raster in live), figures().now
    each = min(
        min(known) / most_digits(extent, count, precision)
        for precision, known in (("float32", costs.float32), ("float64", costs.float64))
    )
    return len(live) * math.prod(shape) * each / (workers or cores())


def _tiling(parts: Sequence[Part], shape: Sequence[int], threads: int) -> tuple[tuple[int, ...], Tiling]:
    """The first offset of one window for all rasters, so that they share the tiles and their spectra; and the tiles."""
    axes = range(len(shape))
    lower = tuple(min(part.lower[a] for part in parts) for a in axes)
    extent = tuple(max(part.lower[a] + part.cells.shape[a] for part in parts) - lower[a] for a in axes)
    return lower, choose_tiling(shape, extent, max(part.count for part in parts), threads, len(parts))


def _share(items: Sequence[Item], number: int, of: int) -> Sequence[Item]:
    """One of several parts of a sequence that are about equally long."""
    return items[len(items) * number // of : len(items) * (number + 1) // of]


def _advance(progress: Callable[[int, int], None], before: int, total: int, done: int) -> None:
    progress(before + done, total)

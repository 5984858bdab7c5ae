"""Correlation of a workspace bitmap with robot rasters (Kavraki, 1995), by overlap-save in tiles.

``overlap[k] = sum over m of W[k + m] * A[m]`` for every cell k of the map, where W beyond the map is all obstacle or
all free. The map is read in tiles small enough for a core's cache. A tile without obstacles, or all obstacle, is
settled without a transform; the spectrum of any other is computed once and multiplied with that of every raster.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.fourier.tiles import Tiling, choose_tiling
from cspace.raster.raster import Raster
from cspace.threads import cores

Bools = NDArray[np.bool_]

SPECTRA_BYTES = 2**26
"""Memory for robot spectra held at once; more rasters than fit share the tiles' spectra in groups."""


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
        Proven bound of the error of an overlap before it was rounded; always below 1/4.
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
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Correlation:
    """Correlate one bitmap with several rasters.

    Parameters
    ----------
    occupied : ndarray of bool, shape (nx, ny)
        Obstacle cells W.
    rasters : sequence of Raster
        Robot offsets A.
    outside : bool
        Whether the cells beyond the map are obstacle.
    counts : bool
        Return overlap counts rather than whether there is any overlap.
    out : sequence of ndarray, optional
        Where to write the results, one array for each raster; new arrays if left out.
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
    parts = [_Part.within_reach(raster, shape, outside) for raster in rasters]
    live = [(part, result) for part, result in zip(parts, results, strict=True) if part.cells.size]
    for part, result in zip(parts, results, strict=True):
        if not part.cells.size:
            result[...] = part.constant
    if not live:
        return Correlation(results, "float32", 0.0)

    # One window of offsets for all rasters, so that they share the tiles and their spectra.
    lower = tuple(min(part.lower[a] for part, _ in live) for a in range(len(shape)))
    upper = tuple(max(part.lower[a] + part.cells.shape[a] for part, _ in live) for a in range(len(shape)))
    extent = tuple(high - low for low, high in zip(lower, upper, strict=True))
    threads = workers or cores()
    tiling = choose_tiling(shape, extent, max(part.count for part, _ in live), threads)
    corners = list(itertools.product(*(range(0, n, s) for n, s in zip(shape, tiling.step, strict=True))))
    group = max(1, SPECTRA_BYTES // tiling.spectrum_bytes)
    total = math.ceil(len(live) / group) * len(corners)
    for first in range(0, len(live), group):
        run = _TileRun(occupied, outside, tiling, lower, live[first : first + group])
        before = first // group * len(corners)
        _settle(run, corners, threads, None if progress is None else partial(_advance, progress, before, total))
    return Correlation(results, tiling.precision, tiling.error)


def _advance(progress: Callable[[int, int], None], before: int, total: int, done: int) -> None:
    progress(before + done, total)


def _settle(
    run: _TileRun, corners: Sequence[tuple[int, ...]], threads: int, progress: Callable[[int], None] | None
) -> None:
    """Settle tiles in threads; a failure or Ctrl-C stops those that have not begun."""
    threads = min(threads, len(corners))
    if threads == 1:
        _consume(map(run.settle, corners), progress)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            _consume(pool.map(run.settle, corners), progress)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _consume(done: Iterable[None], progress: Callable[[int], None] | None) -> None:
    for number, _ in enumerate(done, start=1):
        if progress is not None:
            progress(number)


@dataclass(frozen=True, slots=True)
class _Part:
    """The offsets of a raster that can fall on the map, and what the others contribute everywhere."""

    cells: Bools
    lower: tuple[int, ...]
    count: int
    constant: int

    @classmethod
    def within_reach(cls, raster: Raster, shape: Sequence[int], outside: bool) -> _Part:
        window, lower = [], []
        for low, size, n in zip(raster.lower, raster.cells.shape, shape, strict=True):
            start = max(0, 1 - n - low)
            window.append(slice(start, max(start, min(size, n - low))))
            lower.append(low + start)
        cells = raster.cells[tuple(window)]
        count = int(np.count_nonzero(cells))
        beyond = raster.count - count
        if not count:
            cells = cells[(slice(0, 0),) * cells.ndim]
        return cls(cells, tuple(lower), count, beyond if outside else 0)


class _TileRun:
    """The tiles of one correlation: what they share, and how one of them is settled."""

    def __init__(
        self,
        occupied: Bools,
        outside: bool,
        tiling: Tiling,
        lower: tuple[int, ...],
        members: Sequence[tuple[_Part, NDArray[Any]]],
    ) -> None:
        self.occupied, self.outside, self.tiling, self.lower = occupied, outside, tiling, lower
        self.parts, self.results = [part for part, _ in members], [result for _, result in members]
        self.real = np.dtype(tiling.precision)
        self.spectra = [_robot_spectrum(part, lower, tiling) for part in self.parts]

    def settle(self, corner: tuple[int, ...]) -> None:
        """Write the results from ``corner`` on, as far as one tile yields them."""
        window, place = self._window(corner)
        tile = self.tiling.tile
        occupied = int(np.count_nonzero(window)) + self.outside * (math.prod(tile) - window.size)
        views = [self._view(result, corner) for result in self.results]
        if occupied in (0, math.prod(tile)):
            for part, view in zip(self.parts, views, strict=True):
                view[...] = part.constant + (part.count if occupied else 0)
            return
        spectrum = self._tile_spectrum(window, place)
        for number, (part, robot, view) in enumerate(zip(self.parts, self.spectra, views, strict=True), start=1):
            last = number == len(self.parts)
            product = np.multiply(spectrum, robot, out=spectrum if last else None)
            centred = self._invert(product)[tuple(slice(n) for n in view.shape)]
            # The transform saw W - 1/2, so half the robot's cells are missing from each overlap.
            missing = part.constant + part.count / 2
            if view.dtype == np.bool_:
                np.greater(centred, 0.5 - missing, out=view)
            else:
                view[...] = np.rint(centred + np.float64(missing))

    def _window(self, corner: tuple[int, ...]) -> tuple[Bools, tuple[slice, ...]]:
        """The part of the map that the tile at ``corner`` covers, and its place in the tile."""
        source, place = [], []
        for start, low, length, n in zip(corner, self.lower, self.tiling.tile, self.occupied.shape, strict=True):
            first = start + low
            begin, end = min(max(first, 0), n), min(max(first + length, 0), n)
            source.append(slice(begin, end))
            place.append(slice(begin - first, end - first) if begin < end else slice(0, 0))
        return self.occupied[tuple(source)], tuple(place)

    def _view(self, result: NDArray[Any], corner: tuple[int, ...]) -> NDArray[Any]:
        return result[tuple(slice(start, start + step) for start, step in zip(corner, self.tiling.step, strict=True))]

    def _tile_spectrum(self, window: Bools, place: tuple[slice, ...]) -> NDArray[Any]:
        """Spectrum of W - 1/2 over the tile; rows wholly beyond the map are constant and are not transformed."""
        from scipy import fft

        tile, rows = self.tiling.tile, place[:-1]
        beyond = self.real.type(self.outside - 0.5)
        data = np.full((*window.shape[:-1], tile[-1]), beyond, self.real)
        np.subtract(window, self.real.type(0.5), out=data[..., place[-1]])
        spectrum = fft.rfft(data, axis=-1, overwrite_x=True)
        if spectrum.shape[:-1] != tile[:-1]:
            whole = np.zeros((*tile[:-1], tile[-1] // 2 + 1), spectrum.dtype)
            whole[..., 0] = beyond * tile[-1]
            whole[rows] = spectrum
            spectrum = whole
        for axis in range(len(tile) - 1):
            spectrum = fft.fft(spectrum, axis=axis, overwrite_x=True)
        return np.asarray(spectrum)

    def _invert(self, product: NDArray[Any]) -> NDArray[Any]:
        """Inverse transform, axis by axis, keeping only the rows that carry results."""
        from scipy import fft

        for axis, keep in enumerate(self.tiling.step[:-1]):
            product = fft.ifft(product, axis=axis, overwrite_x=True)[(slice(None),) * axis + (slice(keep),)]
        return np.asarray(fft.irfft(product, n=self.tiling.tile[-1], axis=-1, overwrite_x=True))


def _robot_spectrum(part: _Part, lower: tuple[int, ...], tiling: Tiling) -> NDArray[Any]:
    """Conjugate spectrum of a raster in the frame of ``lower``, transformed in float64 from the rows that it fills."""
    from scipy import fft

    spectrum = np.zeros(tuple(s + p - q for s, p, q in zip(part.cells.shape, part.lower, lower, strict=True)))
    spectrum[tuple(slice(p - q, None) for p, q in zip(part.lower, lower, strict=True))] = part.cells
    spectrum = fft.rfft(spectrum, n=tiling.tile[-1], axis=-1)
    for axis, length in enumerate(tiling.tile[:-1]):
        spectrum = fft.fft(spectrum, n=length, axis=axis)
    conjugate: NDArray[Any] = np.conj(spectrum)
    return conjugate.astype(np.complex64 if tiling.precision == "float32" else np.complex128)

"""Engine by transforms: correlation of a workspace bitmap with robot rasters (Kavraki, 1995).

``overlap[k] = sum over m of W[k + m] * A[m]`` for every cell k of the map, where W outside the map
is all obstacle or all free. The map is read in overlapping tiles (overlap-save). The spectrum of a
tile is multiplied by the spectrum of each flipped raster, transformed back and rounded.

*Rounding is right if the error is below 1/2.* Let w be the N cells of a tile minus 1/2, a the
raster with c cells, u the unit roundoff, and ``|x|`` the 2-norm: ``|w| = sqrt(N) / 2``,
``|a| = sqrt(c)``. A transform has a pass for each prime factor p of its lengths, of butterflies
of p numbers and twiddle factors.

* *One pass.* A complex sum has relative error u, a complex product sqrt(5) u (Brent, Percival and
  Zimmermann, 2007), a stored twiddle factor u. So the product with a twiddle factor has 3.24 u,
  and a pass of radix 2 has 4.3 u. In a butterfly of radix 3 (or 5), each input reaches each output
  in two real products, after at most 5 (or 6) roundings: an error of ``5 sqrt(2) u`` (or
  ``6 sqrt(2) u``) times the sum of the moduli of the inputs. In the 2-norm that is sqrt(p) times
  as much, with twiddle factors 15.5 u (or 22.3 u). A pass of radix 4 or 8 errs by less than two or
  three of radix 2. Float64 counts four times, because its twiddle factors are products of two
  numbers from tables, with an error of at most 9 u.
* *Spectra.* Passes are multiples of unitary maps, so their errors in the 2-norm add: the spectra
  of w and a have the relative error ``g u``, where g is the sum over all passes (compare Higham,
  2002, theorem 24.2, and Brisebarre et al., 2020). Their product adds sqrt(5) u. By Cauchy and
  Schwarz, this changes each number of the exact inverse by at most ``(2 g + sqrt(5)) u |w| |a|``.
* *Inverse.* Each result is a sum with one path through the passes for each number of the product,
  so it errs by at most ``g u`` times their mean modulus, which is at most ``|w| |a|``. Scaling
  adds ``2 u |w| |a|``, and adding ``c / 2`` at most ``u c``, which is at most ``2 u |w| |a|``.

The sum is below ``(3 g + 8) u |w| |a|``, terms of second order included. Float32 is taken if this
is below 1/2. Float64 is always exact: for rasters of 2^28 cells, which no raster exceeds, and tiles
of 2^33 cells, which take 64 GiB, the sum is below 0.001.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import scipy  # loads its submodules on first use
from numpy.typing import NDArray

from cspace._raster import Raster
from cspace._support.arrays import Bools, Ints
from cspace._support.threads import count_cores, map_in_threads

COUNTS: Final = True
"""True if the engine can count overlaps."""

MAX_ERROR: Final = 0.5
"""Overlaps are rounded from sums whose proven error is below this."""

PASS_ERRORS: Final = {2: 4.3, 3: 15.5, 5: 22.3}
"""Relative error of a pass of a transform, in units of the roundoff, by its radix."""

ROUNDOFFS: Final = {"float32": 2.0**-24, "float64": 4.0 * 2.0**-53}
"""Unit roundoff of each precision, as the proof counts it."""

TILE_STEPS: Final = tuple(2**k for k in range(5, 13))
"""Numbers of results of a tile along an axis, among which the cheapest is chosen."""

MAX_SPECTRA_BYTES: Final = 2**26
"""Memory for the spectra of the rasters that are used at a time, bytes."""


def write_overlaps(
    occupied: Bools,
    rasters: Sequence[Raster],
    out: Sequence[NDArray[Any]],
    *,
    outside: bool,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Correlate one bitmap with several rasters; see :class:`cspace._engines.Engine`.

    With one worker everything runs in the calling thread, where ``scipy.fft.set_backend`` holds.
    """
    outputs = []
    for raster, result in zip(rasters, out, strict=True):
        clipped = clip_raster(raster, occupied.shape)
        # Add back the subtracted halves, and add the offsets that always fall outside.
        correction = clipped.count / 2.0 + (raster.count - clipped.count) * outside
        if clipped.count:
            outputs.append(RasterOutput(clipped, correction, result))
        else:
            _write(result, 0.0, correction, add)
    if not outputs:
        return
    tiling = choose_tiling(out[0].shape, [output.raster for output in outputs])
    axes = zip(out[0].shape, tiling.step.tolist(), strict=True)
    starts = [range(0, n, step) for n, step in axes]
    corners = list(itertools.product(*starts))
    threads = workers or count_cores()
    # If there are fewer tiles than threads, several threads share a tile, and each takes a group
    # of its rasters.
    group_count = min(len(outputs), math.ceil(threads / len(corners)))
    batch_size = max(1, MAX_SPECTRA_BYTES // tiling.bytes)
    batches = [outputs[first : first + batch_size] for first in range(0, len(outputs), batch_size)]
    total = len(batches) * len(corners) * group_count
    finished = itertools.count(1)
    advance = None if progress is None else lambda _: progress(next(finished), total)
    for batch in batches:
        spectra = map_in_threads(
            tiling.transform_raster, [output.raster for output in batch], threads
        )
        pairs = list(zip(batch, spectra, strict=True))
        groups = [pairs[first::group_count] for first in range(group_count)]
        tasks = list(itertools.product(corners, groups))
        map_in_threads(partial(fill_tile, occupied, outside, add, tiling), tasks, threads, advance)


class RasterOutput(NamedTuple):
    """A raster, the array for its overlaps, and a correction.

    Attributes
    ----------
    raster : Raster
    correction : float
        Number of overlaps minus the computed sum, because the cells of a tile count 1/2 less.
    out : ndarray
        Overlaps.
    """

    raster: Raster
    correction: float
    out: NDArray[Any]


def clip_raster(raster: Raster, shape: Sequence[int]) -> Raster:
    """Clip a raster to the offsets that can fall on a map.

    ``shape`` is that of the map.
    """
    lower = np.array(raster.lower)
    cells = np.array(shape)
    start, stop = _intersect(lower, lower + raster.cells.shape, 1 - cells, cells)
    window = _make_window(start - lower, stop - lower)
    return Raster(raster.cells[window], tuple(start.tolist()))


class Tiling(NamedTuple):
    """Tiles of a map, for rasters with a common window of offsets.

    Attributes
    ----------
    lower : ndarray of int64, shape (d,)
        First offset of the window.
    size : ndarray of int64, shape (d,)
        Number of cells of a tile along each axis: a product of 2, 3 and 5.
    step : ndarray of int64, shape (d,)
        Number of results of a tile along each axis.
    precision : {"float32", "float64"}
        Arithmetic of the transforms.
    """

    lower: Ints
    size: Ints
    step: Ints
    precision: str

    @property
    def bytes(self) -> int:
        """Memory of a tile or of a spectrum."""
        return int(self.size.prod()) * np.dtype(self.precision).itemsize

    def transform_raster(self, raster: Raster) -> NDArray[Any]:
        """Return the spectrum of a flipped raster."""
        flipped = np.flip(raster.cells).astype(self.precision)
        return np.asarray(scipy.fft.rfftn(flipped, s=self.size))

    def read_tile(self, occupied: Bools, outside: bool, corner: Ints) -> NDArray[Any]:
        """Return the cells, minus 1/2, that a tile's results depend on.

        The first result is at ``corner``.
        """
        first = corner + self.lower
        start, stop = _intersect(first, first + self.size, 0, occupied.shape)
        cells = np.full(self.size, outside, self.precision)
        cells[_make_window(start - first, stop - first)] = occupied[_make_window(start, stop)]
        cells -= 0.5
        return cells

    def invert(self, product: NDArray[Any], first: Ints, stop: Ints) -> NDArray[Any]:
        """Return a window of the inverse of a spectrum.

        The window reaches from ``first`` up to ``stop``. Other numbers are left out after the
        transform along each axis.
        """
        *leading_windows, last_window = _make_window(first, stop)
        for axis, window in enumerate(leading_windows):
            product = scipy.fft.ifft(product, axis=axis, overwrite_x=True)
            axes_before = (slice(None),) * axis
            product = product[(*axes_before, window)]
        # The spectrum of real numbers has half its entries along the last axis.
        numbers = scipy.fft.irfft(product, n=self.size[-1], overwrite_x=True)
        return np.asarray(numbers[..., last_window])


def choose_tiling(shape: Sequence[int], rasters: Sequence[Raster]) -> Tiling:
    """Choose the cheapest tiling for exact overlaps with ``shape`` results."""
    lower = np.min([raster.lower for raster in rasters], axis=0)
    reach = np.max([raster.upper for raster in rasters], axis=0) - lower
    count = max(raster.count for raster in rasters)
    # A tile reads ``reach`` cells more than it has results, so small tiles read much twice.
    tilings_by_cost = {}
    for step in TILE_STEPS:
        tiles = np.ceil(np.array(shape) / step)
        lengths = np.ceil(np.array(shape) / tiles).astype(int) + reach
        size = np.array([scipy.fft.next_fast_len(n, real=True) for n in lengths.tolist()])
        is_proven = error_bound(size, count, "float32") < MAX_ERROR
        precision = "float32" if is_proven else "float64"
        tiling = Tiling(lower, size, size - reach, precision)
        # Large tiles leave the cache, which the last factor estimates.
        # Size of a tile, in bytes, whose transform takes twice as long per point as a small tile's.
        cost = tiles.prod() * tiling.bytes * (1.0 + tiling.bytes / 2**22)
        tilings_by_cost[cost] = tiling
    return tilings_by_cost[min(tilings_by_cost)]


def error_bound(size: Ints, count: int, precision: str) -> float:
    """Bound the rounding error of overlaps from above.

    ``size`` is the number of cells of a tile along each axis, and ``count`` that of a raster.
    """
    # These are g, |w|, |a| and u of the proof above.
    growth = 0.0
    for length in size.tolist():
        for prime, error in PASS_ERRORS.items():
            while length % prime == 0:
                length //= prime
                growth += error
    tile_norm = math.sqrt(size.prod()) / 2.0
    raster_norm = math.sqrt(count)
    return (3.0 * growth + 8.0) * ROUNDOFFS[precision] * tile_norm * raster_norm


Task: TypeAlias = tuple[tuple[int, ...], Sequence[tuple[RasterOutput, NDArray[Any]]]]
"""First result of a tile, and rasters with their spectra."""


def fill_tile(occupied: Bools, outside: bool, add: bool, tiling: Tiling, task: Task) -> None:
    """Write the results of a tile for some rasters."""
    first_result, pairs = task
    corner = np.array(first_result)
    results = _make_window(corner, corner + tiling.step)
    cells = tiling.read_tile(occupied, outside, corner)
    # If all cells of a tile are equal, so are all sums, and no transform is needed.
    level = cells.flat[0]
    if (cells == level).all():
        for output, _ in pairs:
            sums = level * output.raster.count
            _write(output.out[results], sums, output.correction, add)
        return
    spectrum = scipy.fft.rfftn(cells)
    for output, raster_spectrum in pairs:
        out = output.out[results]
        first = output.raster.upper - tiling.lower
        sums = tiling.invert(spectrum * raster_spectrum, first, first + out.shape)
        _write(out, sums, output.correction, add)


def _intersect(start: Ints, stop: Ints, lower: Any, upper: Any) -> tuple[Ints, Ints]:
    """Intersect two boxes; equal start and stop if empty."""
    start = np.maximum(start, lower)
    return start, np.maximum(start, np.minimum(stop, upper))


def _make_window(start: Ints, stop: Ints) -> tuple[slice, ...]:
    """Return the index window from ``start`` to before ``stop`` along each axis."""
    return tuple(map(slice, start.tolist(), stop.tolist()))


def _write(out: NDArray[Any], sums: Any, correction: float, add: bool) -> None:
    """Write the overlap counts ``sums + correction``.

    An array of booleans gets True if the count is above zero; with ``add``, 1 is added then.
    """
    if add:
        out += np.greater(sums, 0.5 - correction)
    elif out.dtype == np.bool_:
        np.greater(sums, 0.5 - correction, out=out)
    else:
        # In double precision, in NumPy 1.26 as well: single precision cannot count beyond 2^24.
        out[...] = np.rint(np.add(sums, correction, dtype=np.float64))

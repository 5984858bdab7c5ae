"""Engine by transforms: correlation of a workspace bitmap with robot rasters (Kavraki, 1995) in tiles.

``overlap[k] = sum over m of W[k + m] * A[m]`` for every cell k of the map, where W outside the map is all obstacle or
all free. The map is read in tiles that fit a core's cache (overlap-save). Tiles without obstacles, or all obstacle,
need no transform; the spectrum of any other tile is multiplied by the spectrum of every raster. If the rounding
provably allows it, one transform yields the overlaps with several rasters, or in several tiles, as digits of one
number.

*Error of an FFT correlation.* A tile of ``W - 1/2`` (values of modulus 1/2, so 2-norm ``sqrt(T) / 2`` for T cells) is
correlated with a robot bitmap ``A`` (2-norm ``sqrt(count)``). Let ``u`` be the unit roundoff. Each transform consists
of passes over the prime factors of its lengths, and each pass of small butterflies followed by twiddle factors.

* *One pass.* A complex addition has relative error u, a complex product sqrt(5) u (Brent, Percival and Zimmermann,
  2007), a stored twiddle factor u. A radix-2 butterfly therefore perturbs its result by at most (1 + sqrt(5) + 1) u =
  4.3 u, relative to the 2-norm and equally relative to the sum of the moduli of its inputs; radices 4 and 8 are cheaper
  than two and three such passes. Radix 3 and 5 butterflies, as sums of at most 5 products in any order, stay below 12 u
  and 19 u in the 2-norm; the code uses 14 and 23.
* *Forward.* Passes are multiples of unitary maps, so their errors add: the spectrum of the tile has relative 2-norm
  error at most ``g u``, with ``g`` the sum of the pass constants (Higham, 2002, theorem 24.2, has the same shape with a
  larger constant). Constant lines and layers of the tile are not transformed: their result is a multiple of 1/2, and
  exact. The robot's spectrum is computed in float64 and rounded once.
* *Product.* By Cauchy-Schwarz the errors of both spectra change the exact inverse transform, at any point, by at most
  ``(g + 1) u |W - 1/2| |A|``; the product's own rounding adds ``sqrt(5) u |W - 1/2| |A|``.
* *Inverse.* Each result is a sum over paths through the passes, so its error is at most ``g u`` times the mean modulus
  of the product, which Cauchy-Schwarz again bounds by ``|W - 1/2| |A|``.

The sum is ``(2 g + 8) u |W - 1/2| |A|``, where 8 covers the terms of order one (product, scaling, conversions) and
those of second order. In float64 the robot's spectrum is not more precise than the tile's, which adds another ``g``.

*Several rasters, or tiles, in one transform.* With overlaps below ``B = 2^b``, the digits to base ``B`` of the overlap
with ``A_0 + B A_1 + B^2 A_2 + ...`` are the overlaps with ``A_0``, ``A_1``, ... So if the error of the sum, whose
2-norm is at most ``(1 + B + B^2 + ...) |A|``, is below 1/4, one transform yields them all. In the same way one
transform can contain several tiles of the map, ``(W_0 - 1/2) + B (W_1 - 1/2) + ...``; with n rasters, and B^n for B,
there is a digit for each tile and raster. Float64 costs half as much again as float32 and often carries three or four
digits. Sums stay below 2^50, so adding the omitted part in float64 costs at most another 1/8.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Final, TypeVar

import numpy as np
import scipy  # loads its submodules on first use
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import allocating, kernel
from cspace.raster import Raster
from cspace.threads import cores, in_threads

MAX_ERROR = 0.25
"""Largest proven error of a transform from which overlaps are rounded."""

UNIT_ROUNDOFF = {"float32": 2.0**-24, "float64": 2.0**-53}
"""Unit roundoff of each precision."""

MAX_SUM_BITS = 50
"""Largest number of bits of a sum whose digits are the overlaps with several rasters."""

_PASS_ERRORS = {2: 4.3, 3: 14.0, 5: 23.0}
"""Relative error of a pass of a transform, in units of the roundoff, by its radix."""

TILE_TASKS_PER_THREAD = 8
"""Number of tasks for each thread, so that all threads finish at about the same time."""

MIN_INVERSES_PER_TASK = 4
"""Smallest number of inverse transforms in a task, because each task computes the spectrum of its tile again."""

TIMED_SIZES: Final = tuple(2**k for k in (12, 14, 16, 18, 20, 22))
"""Numbers of points of the transforms that were timed, on two cores of a server."""

SECONDS_PER_POINT: Final = {
    "float32": (2.4e-9, 2.5e-9, 2.5e-9, 2.6e-9, 3.0e-9, 4.8e-9),
    "float64": (3.4e-9, 3.5e-9, 3.6e-9, 4.0e-9, 7.0e-9, 14.0e-9),
}
"""Half the time per point of a tile, in seconds, for each of TIMED_SIZES, by precision."""

SECONDS_PER_TILE: Final = 4e-5
"""Time per tile, in seconds, independent of its size."""


@dataclass(frozen=True, slots=True)
class Tiling:
    """Tiles of a map for overlap-save correlation.

    Attributes
    ----------
    tile : tuple of int
        Transform length along each axis.
    step : tuple of int
        Number of results of a tile along each axis.
    precision : str
        "float32" or "float64".
    error : float
        Proven bound of the error of an overlap.
    digits : int
        Number of rasters that share a transform.
    stack : int
        Number of tiles that share a transform.
    bits : int
        Number of bits of the overlaps with one raster in a sum.
    pieces : int
        Number of parts into which the rasters of a tile are split, so that all threads have work.
    """

    tile: tuple[int, ...]
    step: tuple[int, ...]
    precision: str
    error: float
    digits: int
    stack: int
    bits: int
    pieces: int

    @property
    def spectrum_bytes(self) -> int:
        """Memory of the spectrum of a tile or robot."""
        width = 8 if self.precision == "float32" else 16
        return math.prod(self.tile[:-1]) * (self.tile[-1] // 2 + 1) * width


def choose_tiling(
    shape: Sequence[int], extent: Sequence[int], count: int, threads: int = 1, rasters: int = 1
) -> Tiling:
    """Choose the cheapest tiling for exact overlaps.

    Its proven error stays below a quarter. ``shape`` is the map's shape, and ``extent`` the size of the robots' common
    bounding box, in cells; ``count`` is the largest number of offsets in a raster. Each of the ``threads`` works on a
    tile of its own. Raises OverflowError if no tiling is exact.
    """
    candidates = [_lengths(n, r) for n, r in zip(shape, extent, strict=True)]
    bits = count.bit_length()
    max_shares = max(1, MAX_SUM_BITS // bits)
    best, best_cost = None, math.inf
    for axes in itertools.product(*candidates):
        tile, counts = zip(*axes, strict=True)
        tiles = math.prod(counts)
        # The more rasters and tiles share a transform, the cheaper it is, but the larger its error. So try the largest
        # number first.
        for precision in UNIT_ROUNDOFF:
            transform_cost = transform_seconds(math.prod(tile), precision)
            for shares in range(min(max_shares, rasters * tiles), 0, -1):
                digits = min(shares, rasters)
                stack = shares // digits
                inverses = -(-rasters // digits)
                pieces = max(
                    1, min(inverses // MIN_INVERSES_PER_TASK, -(-TILE_TASKS_PER_THREAD * threads * stack // tiles))
                )
                rounds = math.ceil(math.ceil(tiles / stack) * pieces / threads)
                cost = rounds * (1 - (-inverses // pieces)) * transform_cost
                if cost >= best_cost:
                    break
                if (error := error_bound(tile, count, precision, digits * stack)) < MAX_ERROR:
                    step = tuple(length - r + 1 for length, r in zip(tile, extent, strict=True))
                    best = Tiling(tile, step, precision, error, digits, stack, bits, pieces)
                    best_cost = cost
                    break
    if best is None:
        raise OverflowError(f"no transform of a map of {tuple(shape)} cells keeps overlaps exact in float64")
    return best


@cache
def transform_seconds(size: int, precision: str) -> float:
    """Estimate half the time of a tile, in seconds.

    The tile has ``size`` points. It covers one transform and its share of the rest.
    """
    known = SECONDS_PER_POINT[precision]
    position = max(math.log2(size / TIMED_SIZES[0]) / 2.0, 0.0)
    index = min(int(position), len(TIMED_SIZES) - 2)
    # The cost of a point is interpolated between the timed sizes, and extrapolated above the largest.
    return (
        size * (known[index + 1] + (known[index + 1] - known[index]) * (position - index - 1)) + 0.5 * SECONDS_PER_TILE
    )


def _lengths(cells: int, extent: int) -> list[tuple[int, int]]:
    """List useful transform lengths along an axis.

    Each comes with its number of tiles. Only the shortest length for each number of tiles is useful.
    """
    whole = fast_length(cells + extent - 1)
    shortest = min(whole, max(extent + extent // 2, 64))
    tiles = {
        -(-cells // (length - extent + 1)): length for length in reversed(_fast_lengths(whole)) if length >= shortest
    }
    return [(length, count) for count, length in tiles.items()]


def fast_length(minimum: int) -> int:
    """Return the smallest fast length of at least ``minimum``."""
    return min(length for length in _fast_lengths(2 * minimum) if length >= minimum)


@cache
def _fast_lengths(maximum: int) -> tuple[int, ...]:
    """List the fast transform lengths up to ``maximum``.

    They are powers of two times 1, 3, 5, 9 or 15.
    """
    odd = (1, 3, 5, 9, 15)
    return tuple(sorted(o << k for o in odd for k in range(maximum.bit_length()) if o << k <= maximum))


@cache
def growth(length: int) -> float:
    """Return the sum of pass errors of a transform.

    The errors are in units of the roundoff. Raises ValueError if the length has a prime factor above 5.
    """
    total = 0.0
    for prime, constant in _PASS_ERRORS.items():
        while length % prime == 0:
            length //= prime
            total += constant
    if length != 1:
        raise ValueError(f"transform length has the prime factor {length}; lengths are products of 2, 3 and 5")
    return total


def error_bound(tile: Sequence[int], count: int, precision: str, digits: int = 1) -> float:
    """Return an upper bound of the rounding error of overlaps.

    The overlap counts are computed by transforms on a tile. ``tile`` is the transform lengths, and ``count`` the
    largest number of offsets in a robot raster. Several rasters and tiles may share a transform, each as a digit of one
    number to the base ``2 ** count.bit_length()``; ``digits`` is the number of such pairs. The certificate page has the
    proof and the constants.
    """
    passes = sum(growth(length) for length in tile)
    transforms = 2 if precision == "float32" else 3
    norms = math.sqrt(math.prod(tile)) / 2.0 * math.sqrt(count)
    norms *= sum(2.0 ** (count.bit_length() * k) for k in range(digits))
    return (transforms * passes + 8.0) * UNIT_ROUNDOFF[precision] * norms


Corner = tuple[int, ...]
"""First cell of a tile's results."""

Item = TypeVar("Item")

PRECISION: Final = "float64"
"""This engine takes single precision if its error bound allows, and double precision otherwise."""

COUNTS: Final = True
"""True if the engine can count overlaps."""

MAX_SPECTRA_PER_THREAD: Final = 3
"""Largest number of arrays of the size of a tile's spectrum that a thread uses at once."""

MAX_SPECTRA_BYTES: Final = 2**25
"""Memory for robot spectra, bytes; if more rasters are needed, they are transformed in several rounds."""

MAX_MIXED_FRACTION: Final = 0.8
"""Fraction of mixed lines in a tile above which constant lines are transformed too, which saves a copy."""

ROUNDING_OFFSET: Final = 1.5 * 2.0**52
"""Number whose addition rounds a number below 2^50 to a whole number, in the low bits of the sum."""


def collide(
    occupied: Bools,
    rasters: Sequence[Raster],
    out: Sequence[NDArray[Any]],
    *,
    outside: bool,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> str:
    """Correlate one bitmap with several rasters.

    See :class:`cspace.engines.Engine`. With one worker everything runs in the calling thread, where
    ``scipy.fft.set_backend`` holds.
    """
    shape = occupied.shape
    clipped = [ClippedRaster.clip(raster, shape, outside) for raster in rasters]
    used = [(raster, result) for raster, result in zip(clipped, out, strict=True) if raster.cells.size]
    for raster, result in zip(clipped, out, strict=True):
        if not raster.cells.size:
            _write(result, raster.constant, add)
    if not used:
        return "float32"

    # Rounds keep the memory of the robot spectra bounded; in each, tasks compute stacks of tiles for some rasters.
    threads = workers or cores()
    lower, tiling = _choose_window([raster for raster, _ in used], shape, threads)
    corners = list(itertools.product(*(range(0, n, s) for n, s in zip(out[0].shape, tiling.step, strict=True))))
    stacks = [corners[first : first + tiling.stack] for first in range(0, len(corners), tiling.stack)]
    groups = [used[first : first + tiling.digits] for first in range(0, len(used), tiling.digits)]
    rounds = min(len(groups), math.ceil(len(groups) * tiling.spectrum_bytes / MAX_SPECTRA_BYTES))
    pieces = math.ceil(tiling.pieces / rounds)
    for part in range(rounds):
        run = _TileRun(occupied, outside, tiling, lower, add)
        members = _split(groups, part, rounds)
        # Threads share the lines of a single robot's transform, or else the robots.
        transform = partial(run.robot_spectrum, threads=threads if len(members) == 1 else 1)
        ready = list(zip(members, in_threads(transform, members, threads), strict=True))
        tasks = [(stack, _split(ready, piece, pieces)) for piece in range(pieces) for stack in stacks]
        advance = (
            None if progress is None else partial(_report_progress, progress, part * len(tasks), rounds * len(tasks))
        )
        in_threads(run.compute_tiles, tasks, threads, advance)
    return tiling.precision


def bytes_needed(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Return the peak memory of :func:`collide`, in bytes.

    Input and results are excluded.
    """
    used = [raster for raster in (ClippedRaster.clip(raster, shape, False) for raster in rasters) if raster.cells.size]
    if not used:
        return 0
    threads = workers or cores()
    _, tiling = _choose_window(used, shape, threads)
    tiles = math.prod(-(-n // step) for n, step in zip(shape, tiling.step, strict=True)) * tiling.pieces
    robots = min(-(-len(used) // tiling.digits) * tiling.spectrum_bytes, MAX_SPECTRA_BYTES + tiling.spectrum_bytes)
    return robots + MAX_SPECTRA_PER_THREAD * min(threads, tiles) * tiling.spectrum_bytes


def _choose_window(
    rasters: Sequence[ClippedRaster], shape: Sequence[int], threads: int
) -> tuple[tuple[int, ...], Tiling]:
    """Return first offset and tiling of a common window.

    All rasters share the window, and so the tiles and their spectra.
    """
    axes = range(len(shape))
    lower = tuple(min(raster.lower[a] for raster in rasters) for a in axes)
    extent = tuple(max(raster.lower[a] + raster.cells.shape[a] for raster in rasters) - lower[a] for a in axes)
    return lower, choose_tiling(shape, extent, max(raster.count for raster in rasters), threads, len(rasters))


def _split(items: Sequence[Item], part: int, parts: int) -> Sequence[Item]:
    """Return part `part` of `parts` of a sequence.

    The parts have about equal length.
    """
    return items[len(items) * part // parts : len(items) * (part + 1) // parts]


def _report_progress(progress: Callable[[int, int], None], previous: int, total: int, finished: int) -> None:
    """Report progress over several rounds."""
    progress(previous + finished, total)


def _write(out: NDArray[Any], value: Any, add: bool) -> None:
    """Set results, or add 1 for any overlap."""
    if add:
        out += np.not_equal(value, 0)
    else:
        out[...] = value


@dataclass(frozen=True, slots=True)
class ClippedRaster:
    """Offsets of a raster that can fall on the map.

    ``constant`` is the overlap of all other offsets, which is the same at every cell. ``count`` is the number of cells
    that are set.
    """

    cells: Bools
    lower: tuple[int, ...]
    count: int
    constant: int

    @classmethod
    def clip(cls, raster: Raster, shape: Sequence[int], outside: bool) -> ClippedRaster:
        """Clip a raster to the offsets that can fall on a map."""
        window, lower = [], []
        for low, size, n in zip(raster.lower, raster.cells.shape, shape, strict=True):
            start = max(0, 1 - n - low)
            window.append(slice(start, max(start, min(size, n - low))))
            lower.append(low + start)
        cells = raster.cells[tuple(window)]
        count = int(np.count_nonzero(cells))
        unreached = raster.count - count
        if not count:
            cells = cells[(slice(0, 0),) * cells.ndim]
        return cls(cells, tuple(lower), count, unreached if outside else 0)


@dataclass(frozen=True, slots=True)
class Tile:
    """A tile of the map, with its obstacle counts.

    ``corner`` is the first cell of its results, and ``first`` its first cell on three axes. ``counts`` has an entry for
    each line.
    """

    corner: Corner
    first: Ints
    counts: Ints


Member = tuple[ClippedRaster, NDArray[Any]]
"""A raster, and the array for its results."""

Group = Sequence[Member]
"""Rasters that share a transform."""

Spectrum = NDArray[Any]
"""Complex spectrum of a tile or robot."""


class _TileRun:
    """Tiles of one correlation, and their settings."""

    def __init__(
        self,
        occupied: Bools,
        outside: bool,
        tiling: Tiling,
        lower: tuple[int, ...],
        add: bool,
    ) -> None:
        self.outside, self.tiling, self.lower, self.add = outside, tiling, lower, add
        self.cells = np.expand_dims(np.ascontiguousarray(occupied).view(np.uint8), tuple(range(3 - occupied.ndim)))
        self.real = np.dtype(tiling.precision)

    def robot_spectrum(self, members: Group, threads: int = 1) -> Spectrum:
        """Return the conjugate spectrum of several rasters.

        The rasters are the digits of one array. It is transformed in float64, from non-empty rows only.
        """
        starts = [tuple(p - q for p, q in zip(raster.lower, self.lower, strict=True)) for raster, _ in members]
        stops = [np.add(start, raster.cells.shape) for start, (raster, _) in zip(starts, members, strict=True)]
        spectrum = np.zeros(np.max(stops, axis=0))
        for digit, (start, stop, (raster, _)) in enumerate(zip(starts, stops, members, strict=True)):
            spectrum[tuple(map(slice, start, stop))] += raster.cells * 2.0 ** (self.tiling.bits * digit)
        spectrum = scipy.fft.rfft(spectrum, n=self.tiling.tile[-1], axis=-1, workers=threads)
        for axis, length in enumerate(self.tiling.tile[:-1]):
            spectrum = scipy.fft.fft(spectrum, n=length, axis=axis, workers=threads)
        np.conj(spectrum, out=spectrum)
        return np.asarray(spectrum, np.complex64 if self.real == np.float32 else np.complex128)

    def compute_tiles(self, task: tuple[Sequence[Corner], Sequence[tuple[Group, Spectrum]]]) -> None:
        """Compute the results of tiles that share a transform.

        ``task`` is the corners of the tiles and the groups of rasters with their spectra.
        """
        corners, groups = task
        tiles = [tile for corner in corners if (tile := self._read_tile(corner, groups)) is not None]
        if not tiles:
            return
        spectrum = self._spectrum(tiles)
        product = spectrum if len(groups) == 1 else np.empty_like(spectrum)
        for members, robots in groups:
            sums = self._invert(np.multiply(spectrum, robots, out=product))
            if len(members) == len(tiles) == 1:
                self._write_overlaps(members[0], sums, tiles[0].corner)
            else:
                self._write_digits(members, sums, tiles)

    def _read_tile(self, corner: Corner, groups: Sequence[tuple[Group, Spectrum]]) -> Tile | None:
        """Count the obstacles of a tile.

        If all cells are equal, write the results and return None.
        """
        lengths = self.tiling.tile
        first = np.array([0] * (3 - len(lengths)) + [c + low for c, low in zip(corner, self.lower, strict=True)])
        counts = np.empty((1, *lengths[:-1])[-2:], np.int64)
        occupied = count_lines(self.cells, first, lengths[-1], self.outside, counts)
        if occupied not in (0, math.prod(lengths)):
            return Tile(corner, first, counts)
        for raster, result in itertools.chain.from_iterable(members for members, _ in groups):
            _write(self._result_view(result, corner), raster.constant + (raster.count if occupied else 0), self.add)
        return None

    def _write_overlaps(self, member: Member, sums: NDArray[Any], corner: Corner) -> None:
        """Write the results of one raster.

        They come from an inverse transform.
        """
        raster, result = member
        view = self._result_view(result, corner)
        centered = sums[tuple(slice(n) for n in view.shape)]
        # The transform used W - 1/2, so half the robot's cells are missing from each overlap.
        missing = raster.constant + raster.count / 2
        if view.dtype == np.bool_:
            np.greater(centered, 0.5 - missing, out=view)
        elif self.add:
            view += centered > 0.5 - missing
        else:
            view[...] = np.rint(centered + np.float64(missing))

    def _write_digits(self, members: Group, sums: NDArray[Any], tiles: Sequence[Tile]) -> None:
        """Write the results of several rasters and tiles.

        Their overlaps are the digits of each sum.
        """
        bits = self.tiling.bits
        digits = [
            (bits * (self.tiling.digits * stacked + digit), member, tile.corner)
            for stacked, tile in enumerate(tiles)
            for digit, member in enumerate(members)
        ]
        sums = np.ascontiguousarray(sums, np.float64)
        round_sums(sums, sum(raster.count << shift for shift, (raster, _), _ in digits) / 2)
        whole = sums.view(np.int64)
        ones = (1 << bits) - 1
        for shift, (raster, result), corner in digits:
            view = self._result_view(result, corner)
            if view.dtype.itemsize == 1:
                always_hit, flags = raster.constant > 0, result.view(np.uint8)
                layers = 3 - flags.ndim
                mark_digit(
                    np.expand_dims(whole, tuple(range(layers))),
                    ones << shift,
                    always_hit,
                    self.add,
                    np.expand_dims(flags, tuple(range(layers))),
                    np.array([0] * layers + list(corner)),
                    np.array([1] * layers + list(view.shape)),
                )
            else:
                shifted = whole[tuple(slice(n) for n in view.shape)] >> shift
                view[...] = (shifted & ones) + raster.constant

    def _result_view(self, result: NDArray[Any], corner: Corner) -> NDArray[Any]:
        """Return the part of a result for one tile."""
        return result[tuple(slice(start, start + step) for start, step in zip(corner, self.tiling.step, strict=True))]

    def _spectrum(self, tiles: Sequence[Tile]) -> Spectrum:
        """Return the spectrum of several tiles.

        The tiles, as W - 1/2, are the digits of one array. Constant lines and layers are not transformed.
        """
        tile, length = self.tiling.tile, self.tiling.tile[-1]
        scales = [2.0 ** (self.tiling.bits * self.tiling.digits * stacked) for stacked in range(len(tiles))]
        mixed = np.any([(contents.counts > 0) & (contents.counts < length) for contents in tiles], axis=0)
        if np.count_nonzero(mixed) > MAX_MIXED_FRACTION * mixed.size:
            mixed[...] = True
        cells = np.zeros((int(np.count_nonzero(mixed)), length), self.real)
        for scale, contents in zip(scales, tiles, strict=True):
            add_lines(self.cells, contents.first, self.outside, scale, mixed, cells)
        lines = scipy.fft.rfft(cells, axis=-1, overwrite_x=True)
        levels = np.zeros(mixed.shape)
        for scale, contents in zip(scales, tiles, strict=True):
            levels += scale * (contents.counts - length / 2)
        layers = lines.reshape(*mixed.shape, -1) if mixed.all() else place_lines(mixed, levels, lines)
        # Along the second axis, only the layers that are not constant are transformed.
        if len(tile) == 3:
            changing = np.flatnonzero(mixed.any(axis=1) | (levels != levels[:, :1]).any(axis=1))
            low, high = (int(changing[0]), int(changing[-1]) + 1) if changing.size else (0, 0)
            transformed = scipy.fft.fft(layers[low:high], axis=1)
            for constant in (layers[:low], layers[high:]):
                level = constant[:, 0, 0] * tile[1]
                constant[...] = 0.0
                constant[:, 0, 0] = level
            layers[low:high] = transformed
        return np.asarray(scipy.fft.fft(layers.reshape(*tile[:-1], -1), axis=0, overwrite_x=True))

    def _invert(self, product: NDArray[Any]) -> NDArray[Any]:
        """Invert a spectrum; keep only rows with results."""
        for axis, keep in enumerate(self.tiling.step[:-1]):
            product = scipy.fft.ifft(product, axis=axis, overwrite_x=True)[(slice(None),) * axis + (slice(keep),)]
        return np.asarray(scipy.fft.irfft(product, n=self.tiling.tile[-1], axis=-1, overwrite_x=True))


@kernel
def count_lines(occupied: NDArray[np.uint8], first: Ints, length: int, outside: bool, counts: Ints) -> int:
    """Count the obstacle cells of each line of a tile.

    Returns their sum. Lines are along the last axis. Cells have three axes; a plane map is one layer. ``first`` is the
    first cell of the tile; ``counts`` has an entry for each line.
    """
    nx, ny, nz = occupied.shape
    low, high = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
    padding = (length - (high - low)) * outside
    total = 0
    for i in range(counts.shape[0]):
        x = first[0] + i
        for j in range(counts.shape[1]):
            y = first[1] + j
            if 0 <= x < nx and 0 <= y < ny:
                row, count = occupied[x, y, low:high], padding
                for k in range(row.size):
                    count += row[k]
            else:
                count = length * outside
            counts[i, j] = count
            total += count
    return total


@kernel
def add_lines(
    occupied: NDArray[np.uint8],
    first: Ints,
    outside: bool,
    scale: float,
    mixed: Bools,
    lines: NDArray[np.floating],
) -> None:
    """Add scaled W - 1/2 to lines of a tile.

    Only the ``mixed`` lines are computed. These are not constant; ``lines`` has an entry for each of them, in order.
    Cells are as for :func:`count_lines`.
    """
    unit = lines.dtype.type(scale)
    half = lines.dtype.type(0.5 * scale)
    nx, ny, nz = occupied.shape
    length = lines.shape[1]
    padding = outside * unit - half
    line_index = 0
    for i in range(mixed.shape[0]):
        x = first[0] + i
        for j in range(mixed.shape[1]):
            if not mixed[i, j]:
                continue
            y = first[1] + j
            low = high = 0
            if 0 <= x < nx and 0 <= y < ny:
                low, high = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
            line = lines[line_index]
            before = low - first[2] if low < high else length
            for k in range(before):
                line[k] += padding
            if low < high:
                row, inside, rest = occupied[x, y, low:high], line[before:], line[high - first[2] :]
                for k in range(row.size):
                    inside[k] += row[k] * unit - half
                for k in range(rest.size):
                    rest[k] += padding
            line_index += 1


def place_lines(mixed: Bools, levels: Floats, lines: NDArray[Any]) -> NDArray[Any]:
    """Return the spectra of all lines of a tile.

    Mixed lines have their transforms, constant lines their sums.
    """
    spectrum = np.zeros((*mixed.shape, lines.shape[1]), lines.dtype)
    spectrum[mixed] = lines
    spectrum[~mixed, 0] = levels[~mixed]
    return spectrum


@allocating
def round_sums(sums: Floats, missing: float) -> None:
    """Add ``missing`` to sums, and round them.

    The low bits of the results are the whole numbers.
    """
    flat = sums.ravel()
    for k in range(flat.size):
        flat[k] = (flat[k] + missing) + ROUNDING_OFFSET


@kernel
def mark_digit(
    whole: Ints,
    mask: int,
    always_hit: bool,
    add: bool,
    out: NDArray[np.uint8],
    corner: Ints,
    shape: Ints,
) -> None:
    """Write whether bits of whole numbers are set.

    With ``add``, add 1 if they are. ``out`` is written from ``corner`` on; ``shape`` is the number of entries along
    each axis. Arrays have three axes; a plane map is one layer.
    """
    x, y, z = corner
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            row, numbers = out[x + i, y + j, z : z + nz], whole[i, j]
            if add:
                for k in range(nz):
                    row[k] += always_hit or (numbers[k] & mask) != 0
            else:
                for k in range(nz):
                    row[k] = always_hit or (numbers[k] & mask) != 0

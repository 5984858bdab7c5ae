"""The engine by transforms: correlation of a workspace bitmap with robot rasters (Kavraki, 1995) in tiles.

``overlap[k] = sum over m of W[k + m] * A[m]`` for every cell k of the map, where W outside the map is all obstacle or
all free. The map is read in tiles small enough for a core's cache (overlap-save). A tile without obstacles, or all
obstacle, is settled without a transform; the spectrum of any other is multiplied with that of every raster. Where it is
proven that the rounding allows it, one transform yields the overlaps with several
rasters, or in several tiles, as digits of one number.

*How far a correlation by FFT can be from the integer that it stands for.* A tile of ``W - 1/2`` (values of modulus 1/2,
so 2-norm ``sqrt(T) / 2`` for T cells) is correlated with a robot bitmap ``A`` (2-norm ``sqrt(count)``). Let ``u`` be
the unit roundoff and write each transform as passes over the prime factors of its lengths, every pass a set of small
butterflies followed by twiddle factors.

* *One pass.* A complex addition has relative error u, a complex product sqrt(5) u (Brent, Percival and Zimmermann,
  2007), a stored twiddle factor u. A radix-2 butterfly therefore perturbs its result by at most (1 + sqrt(5) + 1) u
  = 4.3 u, relative to the 2-norm and equally relative to the sum of the moduli of its inputs; radices 4 and 8 are
  cheaper than two and three such passes. Radix 3 and 5 butterflies, as sums of at most 5 products in any order, stay
  below 12 u and 19 u in the 2-norm; 14 and 23 are used.
* *Forward.* Passes are multiples of unitary maps, so their errors add: the spectrum of the tile has relative 2-norm
  error at most ``g u``, with ``g`` the sum of the pass constants (Higham, 2002, theorem 24.2, has the same shape with a
  larger constant). Lines and layers of the tile that are constant are not transformed: what they would yield is a
  multiple of 1/2, and exact. The robot's spectrum is computed in float64 and rounded once.
* *Product.* By Cauchy-Schwarz the errors of both spectra change the exact inverse transform, at any point, by at most
  ``(g + 1) u |W - 1/2| |A|``; the product's own rounding adds ``sqrt(5) u |W - 1/2| |A|``.
* *Inverse.* Each result is a sum over paths through the passes, so its error is at most ``g u`` times the mean modulus
  of the product, which Cauchy-Schwarz again bounds by ``|W - 1/2| |A|``.

Together ``(2 g + 8) u |W - 1/2| |A|``, where 8 covers the terms of order one (product, scaling, conversions) and those
of second order. In float64 the robot's spectrum is not better than the tile's, which adds another ``g``.

*Several rasters, or tiles, in one transform.* With overlaps below ``B = 2^b``, the digits to base ``B`` of the overlap
with ``A_0 + B A_1 + B^2 A_2 + ...`` are the overlaps with ``A_0``, ``A_1``, ... So where the error of the sum, whose
2-norm is at most ``(1 + B + B^2 + ...) |A|``, is below 1/4, one transform yields them all. In the same way a tile can
hold several of the map, ``(W_0 - 1/2) + B (W_1 - 1/2) + ...``; with n rasters, and B^n for B, there is a digit for each
tile and raster. Float64 costs half as much again as float32 and often carries three or four digits. Sums stay below
2^50, so that adding what the transform left out, in float64, costs at most another 1/8.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Final, TypeVar

import numpy as np
import scipy  # its parts are read when they are first used
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.raster import Raster
from cspace.threads import cores, in_threads

MARGIN = 0.25
"""Largest proven error with which overlaps, being whole numbers, are taken from a transform."""

UNIT_ROUNDOFF = {"float32": 2.0**-24, "float64": 2.0**-53}

SUM_BITS = 50
"""Bits that the overlaps with several rasters may take together, as digits of one sum."""

_PASS = {2: 4.3, 3: 14.0, 5: 23.0}

TASKS = 8
"""Tasks that each thread should have, for all to end at about the same time."""

LEAST_INVERSES = 4
"""Inverse transforms in one task, at least: each task makes the spectrum of its tile afresh."""

SIZES: Final = tuple(2**k for k in (12, 14, 16, 18, 20, 22))
"""Points of the transforms that were timed, once, on two cores of a server."""

SECONDS_A_POINT: Final = {
    "float32": (2.4e-9, 2.5e-9, 2.5e-9, 2.6e-9, 3.0e-9, 4.8e-9),
    "float64": (3.4e-9, 3.5e-9, 3.6e-9, 4.0e-9, 7.0e-9, 14.0e-9),
}
"""Half of what a tile's transforms, there and back, and all that is done with its numbers take, for each size."""

SECONDS_A_TILE: Final = 4e-5
"""For each tile, whatever its size."""


@dataclass(frozen=True, slots=True)
class Tiling:
    """How a map is cut for overlap-save correlation.

    Attributes
    ----------
    tile : tuple of int
        Transform length along each axis.
    step : tuple of int
        Results that one tile yields along each axis.
    precision : str
        "float32" or "float64".
    error : float
        Proven bound of the error of an overlap.
    digits : int
        Rasters that share a transform.
    stack : int
        Tiles that share a transform.
    bits : int
        Bits that the overlaps with one raster take in their sum.
    pieces : int
        Parts that the rasters of a tile are settled in, so that all threads have work.
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
        """Memory that the spectrum of a tile or robot takes."""
        width = 8 if self.precision == "float32" else 16
        return math.prod(self.tile[:-1]) * (self.tile[-1] // 2 + 1) * width


def choose_tiling(
    shape: Sequence[int], extent: Sequence[int], count: int, threads: int = 1, rasters: int = 1
) -> Tiling:
    """The cheapest tiling whose proven error stays below a quarter.

    ``shape`` is that of the map, and ``extent`` that of the robots' common bounding box, in cells; ``count`` is the
    largest number of offsets in one of the rasters. So many ``threads`` work on a tile each.
    """
    candidates = [_lengths(n, r) for n, r in zip(shape, extent, strict=True)]
    bits = count.bit_length()
    most = max(1, SUM_BITS // bits)
    best, best_cost = None, math.inf
    for axes in itertools.product(*candidates):
        tile, numbers = zip(*axes, strict=True)
        tiles = math.prod(numbers)
        for precision in UNIT_ROUNDOFF:
            cost_of_one = transform_seconds(math.prod(tile), precision)
            for shares in range(min(most, rasters * tiles), 0, -1):
                digits = min(shares, rasters)
                stack = shares // digits
                inverses = -(-rasters // digits)
                pieces = max(1, min(inverses // LEAST_INVERSES, -(-TASKS * threads * stack // tiles)))
                rounds = math.ceil(math.ceil(tiles / stack) * pieces / threads)
                cost = rounds * (1 - (-inverses // pieces)) * cost_of_one
                if cost >= best_cost:
                    break
                if (error := error_bound(tile, count, precision, digits * stack)) < MARGIN:
                    step = tuple(length - r + 1 for length, r in zip(tile, extent, strict=True))
                    best = Tiling(tile, step, precision, error, digits, stack, bits, pieces)
                    best_cost = cost
                    break
    if best is None:
        raise OverflowError(f"no transform of a map of {tuple(shape)} cells keeps overlaps exact in float64")
    return best


@cache
def transform_seconds(size: int, precision: str) -> float:
    """Half of what a tile of so many points takes: one transform and its share of the rest."""
    known = SECONDS_A_POINT[precision]
    place = max(math.log2(size / SIZES[0]) / 2.0, 0.0)
    left = min(int(place), len(SIZES) - 2)
    # Between the sizes that were timed, and above the largest, the cost of a point goes on as it does around.
    return size * (known[left + 1] + (known[left + 1] - known[left]) * (place - left - 1)) + 0.5 * SECONDS_A_TILE


def _lengths(cells: int, extent: int) -> list[tuple[int, int]]:
    """Transform lengths worth a try, and the number of tiles that each makes: the shortest one for each number."""
    whole = fast_length(cells + extent - 1)
    least = min(whole, max(extent + extent // 2, 64))
    tiles = {-(-cells // (length - extent + 1)): length for length in reversed(_fast_lengths(whole)) if length >= least}
    return [(length, number) for number, length in tiles.items()]


def fast_length(least: int) -> int:
    """The smallest length with quick transforms that is not below ``least``."""
    return min(length for length in _fast_lengths(2 * least) if length >= least)


@cache
def _fast_lengths(most: int) -> tuple[int, ...]:
    """Lengths with quick transforms: powers of two times 1, 3, 5, 9 or 15."""
    odd = (1, 3, 5, 9, 15)
    return tuple(sorted(o << k for o in odd for k in range(most.bit_length()) if o << k <= most))


@cache
def growth(length: int) -> float:
    """Sum of the pass constants of a transform whose length has no prime factor above 5."""
    total = 0.0
    for prime, constant in _PASS.items():
        while length % prime == 0:
            length //= prime
            total += constant
    if length != 1:
        raise ValueError(f"transform length has the prime factor {length}; lengths are products of 2, 3 and 5")
    return total


def error_bound(tile: Sequence[int], count: int, precision: str, digits: int = 1) -> float:
    """Largest error of an overlap, or of a sum of several as digits, that a tile's transforms can make.

    ``tile`` are the transforms' lengths, and ``count`` is the number of offsets in the robot's raster; the largest, for
    several. There are so many ``digits``: those of rasters that share a transform, times those of the tiles.
    """
    passes = sum(growth(length) for length in tile)
    transforms = 2 if precision == "float32" else 3
    norms = math.sqrt(math.prod(tile)) / 2.0 * math.sqrt(count)
    norms *= sum(2.0 ** (count.bit_length() * k) for k in range(digits))
    return (transforms * passes + 8.0) * UNIT_ROUNDOFF[precision] * norms


Corner = tuple[int, ...]
Item = TypeVar("Item")

COUNTS: Final = True
"""This engine counts overlaps."""

TILE_SPECTRA: Final = 3
"""Arrays as large as a tile's spectrum that a thread holds at once, at most."""

SPECTRA_BYTES: Final = 2**25
"""Memory for robot spectra held at once; more rasters than fit are taken in turns."""

FEW: Final = 0.8
"""Part of a tile's lines above which those that are constant are transformed too, which saves a copy of all."""

NEAREST: Final = 1.5 * 2.0**52
"""A number below 2^50 that is added to this is rounded to the nearest whole one, which the low bits then hold."""


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
    """Correlate one bitmap with several rasters; see :class:`cspace.engines.Engine`.

    With one worker everything runs in the calling thread, where ``scipy.fft.set_backend`` holds.
    """
    shape = occupied.shape
    parts = [Part.within_reach(raster, shape, outside) for raster in rasters]
    live = [(part, result) for part, result in zip(parts, out, strict=True) if part.cells.size]
    for part, result in zip(parts, out, strict=True):
        if not part.cells.size:
            _write(result, part.constant, add)
    if not live:
        return "float32"

    threads = workers or cores()
    lower, tiling = _tiling([part for part, _ in live], shape, threads)
    corners = list(itertools.product(*(range(0, n, s) for n, s in zip(out[0].shape, tiling.step, strict=True))))
    stacks = [corners[first : first + tiling.stack] for first in range(0, len(corners), tiling.stack)]
    groups = [live[first : first + tiling.digits] for first in range(0, len(live), tiling.digits)]
    turns = min(len(groups), math.ceil(len(groups) * tiling.spectrum_bytes / SPECTRA_BYTES))
    pieces = math.ceil(tiling.pieces / turns)
    for turn in range(turns):
        run = _TileRun(occupied, outside, tiling, lower, add)
        members = _share(groups, turn, turns)
        # Of a single robot the lines of its transform are shared out, of several the robots.
        alone = partial(run.robot_spectrum, threads=threads if len(members) == 1 else 1)
        ready = list(zip(members, in_threads(alone, members, threads), strict=True))
        tasks = [(stack, _share(ready, piece, pieces)) for piece in range(pieces) for stack in stacks]
        advance = None if progress is None else partial(_advance, progress, turn * len(tasks), turns * len(tasks))
        in_threads(run.settle, tasks, threads, advance)
    return tiling.precision


def bytes_needed(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Memory that :func:`collide` takes at most beside its input and results, in bytes."""
    live = [part for part in (Part.within_reach(raster, shape, False) for raster in rasters) if part.cells.size]
    if not live:
        return 0
    threads = workers or cores()
    _, tiling = _tiling(live, shape, threads)
    tiles = math.prod(-(-n // step) for n, step in zip(shape, tiling.step, strict=True)) * tiling.pieces
    robots = min(-(-len(live) // tiling.digits) * tiling.spectrum_bytes, SPECTRA_BYTES + tiling.spectrum_bytes)
    return robots + TILE_SPECTRA * min(threads, tiles) * tiling.spectrum_bytes


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


def _write(out: NDArray[Any], value: Any, add: bool) -> None:
    """Set results, or add to them whether there is any overlap."""
    if add:
        out += np.not_equal(value, 0)
    else:
        out[...] = value


@dataclass(frozen=True, slots=True)
class Part:
    """The offsets of a raster that can fall on the map, and what the others contribute everywhere."""

    cells: Bools
    lower: tuple[int, ...]
    count: int
    constant: int

    @classmethod
    def within_reach(cls, raster: Raster, shape: Sequence[int], outside: bool) -> Part:
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
    """Where a tile's results begin, its first cell with three coordinates, and how many obstacles its lines have."""

    corner: Corner
    first: Ints
    counts: Ints


Member = tuple[Part, NDArray[Any]]
Group = Sequence[Member]
Spectrum = NDArray[Any]


class _TileRun:
    """The tiles of one correlation: what they share, and how one of them is settled."""

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
        """Conjugate spectrum of rasters, as digits of one, transformed in float64 from the rows that they fill."""
        firsts = [tuple(p - q for p, q in zip(part.lower, self.lower, strict=True)) for part, _ in members]
        lasts = [np.add(first, part.cells.shape) for first, (part, _) in zip(firsts, members, strict=True)]
        spectrum = np.zeros(np.max(lasts, axis=0))
        for number, (first, last, (part, _)) in enumerate(zip(firsts, lasts, members, strict=True)):
            spectrum[tuple(map(slice, first, last))] += part.cells * 2.0 ** (self.tiling.bits * number)
        spectrum = scipy.fft.rfft(spectrum, n=self.tiling.tile[-1], axis=-1, workers=threads)
        for axis, length in enumerate(self.tiling.tile[:-1]):
            spectrum = scipy.fft.fft(spectrum, n=length, axis=axis, workers=threads)
        np.conj(spectrum, out=spectrum)
        return np.asarray(spectrum, np.complex64 if self.real == np.float32 else np.complex128)

    def settle(self, task: tuple[Sequence[Corner], Sequence[tuple[Group, Spectrum]]]) -> None:
        """Write the results from corners on, as far as one transform yields them, for groups with their spectra."""
        corners, groups = task
        tiles = [tile for corner in corners if (tile := self._read(corner, groups)) is not None]
        if not tiles:
            return
        spectrum = self._spectrum(tiles)
        product = spectrum if len(groups) == 1 else np.empty_like(spectrum)
        for members, robots in groups:
            sums = self._invert(np.multiply(spectrum, robots, out=product))
            if len(members) == len(tiles) == 1:
                self._take(members[0], sums, tiles[0].corner)
            else:
                self._take_digits(members, sums, tiles)

    def _read(self, corner: Corner, groups: Sequence[tuple[Group, Spectrum]]) -> Tile | None:
        """What a tile holds; None, with the results written, where it is all obstacle or all free."""
        lengths = self.tiling.tile
        first = np.array([0] * (3 - len(lengths)) + [c + low for c, low in zip(corner, self.lower, strict=True)])
        counts = np.empty((1, *lengths[:-1])[-2:], np.int64)
        occupied = count_lines(self.cells, first, lengths[-1], self.outside, counts)
        if occupied not in (0, math.prod(lengths)):
            return Tile(corner, first, counts)
        for part, result in itertools.chain.from_iterable(members for members, _ in groups):
            _write(self._view(result, corner), part.constant + (part.count if occupied else 0), self.add)
        return None

    def _take(self, member: Member, sums: NDArray[Any], corner: Corner) -> None:
        """Results of one raster from what a transform yields."""
        part, result = member
        view = self._view(result, corner)
        centred = sums[tuple(slice(n) for n in view.shape)]
        # The transform saw W - 1/2, so half the robot's cells are missing from each overlap.
        missing = part.constant + part.count / 2
        if view.dtype == np.bool_:
            np.greater(centred, 0.5 - missing, out=view)
        elif self.add:
            view += centred > 0.5 - missing
        else:
            view[...] = np.rint(centred + np.float64(missing))

    def _take_digits(self, members: Group, sums: NDArray[Any], tiles: Sequence[Tile]) -> None:
        """Results of several rasters or tiles, whose overlaps are the digits of one sum."""
        bits = self.tiling.bits
        digits = [
            (bits * (self.tiling.digits * above + number), member, tile.corner)
            for above, tile in enumerate(tiles)
            for number, member in enumerate(members)
        ]
        sums = np.ascontiguousarray(sums, np.float64)
        round_sums(sums, sum(part.count << shift for shift, (part, _), _ in digits) / 2)
        whole = sums.view(np.int64)
        ones = (1 << bits) - 1
        for shift, (part, result), corner in digits:
            view = self._view(result, corner)
            if view.dtype.itemsize == 1:
                always, marks = part.constant > 0, result.view(np.uint8)
                layers = 3 - marks.ndim
                mark_digit(
                    np.expand_dims(whole, tuple(range(layers))),
                    ones << shift,
                    always,
                    self.add,
                    np.expand_dims(marks, tuple(range(layers))),
                    np.array([0] * layers + list(corner)),
                    np.array([1] * layers + list(view.shape)),
                )
            else:
                part_of_sum = whole[tuple(slice(n) for n in view.shape)] >> shift
                view[...] = (part_of_sum & ones) + part.constant

    def _view(self, result: NDArray[Any], corner: Corner) -> NDArray[Any]:
        return result[tuple(slice(start, start + step) for start, step in zip(corner, self.tiling.step, strict=True))]

    def _spectrum(self, tiles: Sequence[Tile]) -> Spectrum:
        """Spectrum of W - 1/2 over tiles, as digits of one; lines and layers that are constant are not transformed."""
        tile, length = self.tiling.tile, self.tiling.tile[-1]
        scales = [2.0 ** (self.tiling.bits * self.tiling.digits * above) for above in range(len(tiles))]
        mixed = np.any([(each.counts > 0) & (each.counts < length) for each in tiles], axis=0)
        if np.count_nonzero(mixed) > FEW * mixed.size:
            mixed[...] = True
        cells = np.zeros((int(np.count_nonzero(mixed)), length), self.real)
        for scale, each in zip(scales, tiles, strict=True):
            add_lines(self.cells, each.first, self.outside, scale, mixed, cells)
        lines = scipy.fft.rfft(cells, axis=-1, overwrite_x=True)
        levels = np.zeros(mixed.shape)
        for scale, each in zip(scales, tiles, strict=True):
            levels += scale * (each.counts - length / 2)
        layers = lines.reshape(*mixed.shape, -1) if mixed.all() else place_lines(mixed, levels, lines)
        if len(tile) == 3:
            changing = np.flatnonzero(mixed.any(axis=1) | (levels != levels[:, :1]).any(axis=1))
            begin, end = (int(changing[0]), int(changing[-1]) + 1) if changing.size else (0, 0)
            turned = scipy.fft.fft(layers[begin:end], axis=1)
            for constant in (layers[:begin], layers[end:]):
                level = constant[:, 0, 0] * tile[1]
                constant[...] = 0.0
                constant[:, 0, 0] = level
            layers[begin:end] = turned
        return np.asarray(scipy.fft.fft(layers.reshape(*tile[:-1], -1), axis=0, overwrite_x=True))

    def _invert(self, product: NDArray[Any]) -> NDArray[Any]:
        """Inverse transform, axis by axis, keeping only the rows that carry results."""
        for axis, keep in enumerate(self.tiling.step[:-1]):
            product = scipy.fft.ifft(product, axis=axis, overwrite_x=True)[(slice(None),) * axis + (slice(keep),)]
        return np.asarray(scipy.fft.irfft(product, n=self.tiling.tile[-1], axis=-1, overwrite_x=True))


@kernel
def count_lines(occupied: NDArray[np.uint8], first: Ints, length: int, outside: bool, counts: Ints) -> int:
    """Obstacle cells of each line along the last axis of a tile whose first cell is given, and of the whole tile.

    Arrays of cells have three axes; those of the plane are one layer. ``counts`` has a number for each line.
    """
    nx, ny, nz = occupied.shape
    begin, end = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
    padding = (length - (end - begin)) * outside
    total = 0
    for i in range(counts.shape[0]):
        x = first[0] + i
        for j in range(counts.shape[1]):
            y = first[1] + j
            if 0 <= x < nx and 0 <= y < ny:
                row, number = occupied[x, y, begin:end], padding
                for k in range(row.size):
                    number += row[k]
            else:
                number = length * outside
            counts[i, j] = number
            total += number
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
    """Add W - 1/2, times a scale, to those lines of a tile that are ``mixed``, not constant; in their order.

    Arrays of cells as for :func:`count_lines`.
    """
    unit = lines.dtype.type(scale)
    half = lines.dtype.type(0.5 * scale)
    nx, ny, nz = occupied.shape
    length = lines.shape[1]
    padding = outside * unit - half
    number = 0
    for i in range(mixed.shape[0]):
        x = first[0] + i
        for j in range(mixed.shape[1]):
            if not mixed[i, j]:
                continue
            y = first[1] + j
            begin = end = 0
            if 0 <= x < nx and 0 <= y < ny:
                begin, end = min(max(first[2], 0), nz), min(max(first[2] + length, 0), nz)
            line = lines[number]
            low = begin - first[2] if begin < end else length
            for k in range(low):
                line[k] += padding
            if begin < end:
                row, inside, rest = occupied[x, y, begin:end], line[low:], line[end - first[2] :]
                for k in range(row.size):
                    inside[k] += row[k] * unit - half
                for k in range(rest.size):
                    rest[k] += padding
            number += 1


def place_lines(mixed: Bools, levels: Floats, lines: NDArray[Any]) -> NDArray[Any]:
    """Spectra of all lines: those of the lines that are not constant, in order, and from the sums of the others."""
    spectrum = np.zeros((*mixed.shape, lines.shape[1]), lines.dtype)
    spectrum[mixed] = lines
    spectrum[~mixed, 0] = levels[~mixed]
    return spectrum


@jit
def round_sums(sums: Floats, missing: float) -> None:
    """Add to sums what they miss, and put the nearest whole numbers into the low bits of the results."""
    flat = sums.ravel()
    for k in range(flat.size):
        flat[k] = (flat[k] + missing) + NEAREST


@kernel
def mark_digit(
    whole: Ints,
    mask: int,
    always: bool,
    add: bool,
    out: NDArray[np.uint8],
    corner: Ints,
    shape: Ints,
) -> None:
    """Whether bits of the first whole numbers, as many as ``shape``, are set, written or added to ``out`` at a corner.

    Arrays have three axes; those of the plane are one layer.
    """
    x, y, z = corner
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            row, numbers = out[x + i, y + j, z : z + nz], whole[i, j]
            if add:
                for k in range(nz):
                    row[k] += always or (numbers[k] & mask) != 0
            else:
                for k in range(nz):
                    row[k] = always or (numbers[k] & mask) != 0

"""Tiles of a correlation: their spectrum, the products with those of the robots, and what they yield."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.fourier.tiles import Tiling
from cspace.raster.raster import Raster

FEW = 0.8
"""Part of a tile's lines above which those that are constant are transformed too, which saves a copy of all."""

Bools = NDArray[np.bool_]
Corner = tuple[int, ...]


def write(out: NDArray[Any], value: Any, add: bool) -> None:
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
        beyond = raster.count - count
        if not count:
            cells = cells[(slice(0, 0),) * cells.ndim]
        return cls(cells, tuple(lower), count, beyond if outside else 0)


@dataclass(frozen=True, slots=True)
class Tile:
    """Where a tile's results begin, its first cell with three coordinates, and how many obstacles its lines have."""

    corner: Corner
    first: NDArray[np.int64]
    counts: NDArray[np.int64]


Member = tuple[Part, NDArray[Any]]
Group = Sequence[Member]
Spectrum = NDArray[Any]


class TileRun:
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
        from scipy import fft

        firsts = [tuple(p - q for p, q in zip(part.lower, self.lower, strict=True)) for part, _ in members]
        lasts = [np.add(first, part.cells.shape) for first, (part, _) in zip(firsts, members, strict=True)]
        spectrum = np.zeros(np.max(lasts, axis=0))
        for number, (first, (part, _)) in enumerate(zip(firsts, members, strict=True)):
            place = tuple(slice(low, low + n) for low, n in zip(first, part.cells.shape, strict=True))
            spectrum[place] += part.cells * 2.0 ** (self.tiling.bits * number)
        spectrum = fft.rfft(spectrum, n=self.tiling.tile[-1], axis=-1, workers=threads)
        for axis, length in enumerate(self.tiling.tile[:-1]):
            spectrum = fft.fft(spectrum, n=length, axis=axis, workers=threads)
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
        from cspace.fourier import _kernels

        lengths = self.tiling.tile
        first = np.array([0] * (3 - len(lengths)) + [c + low for c, low in zip(corner, self.lower, strict=True)])
        counts = np.empty((1, *lengths[:-1])[-2:], np.int64)
        occupied = _kernels.count_lines(self.cells, first, lengths[-1], self.outside, counts)
        if occupied not in (0, math.prod(lengths)):
            return Tile(corner, first, counts)
        for part, result in itertools.chain.from_iterable(members for members, _ in groups):
            write(self._view(result, corner), part.constant + (part.count if occupied else 0), self.add)
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
        from cspace.fourier import _kernels

        bits = self.tiling.bits
        digits = [
            (bits * (self.tiling.digits * above + number), member, tile.corner)
            for above, tile in enumerate(tiles)
            for number, member in enumerate(members)
        ]
        sums = np.ascontiguousarray(sums, np.float64)
        _kernels.round_sums(sums, sum(part.count << shift for shift, (part, _), _ in digits) / 2)
        whole = sums.view(np.int64)
        ones = (1 << bits) - 1
        for shift, (part, result), corner in digits:
            view = self._view(result, corner)
            if view.dtype.itemsize == 1:
                always, marks = part.constant > 0, result.view(np.uint8)
                layers = 3 - marks.ndim
                _kernels.mark_digit(
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
        from scipy import fft

        from cspace.fourier import _kernels

        tile, length = self.tiling.tile, self.tiling.tile[-1]
        scales = [2.0 ** (self.tiling.bits * self.tiling.digits * above) for above in range(len(tiles))]
        mixed = np.any([(each.counts > 0) & (each.counts < length) for each in tiles], axis=0)
        if np.count_nonzero(mixed) > FEW * mixed.size:
            mixed[...] = True
        cells = np.zeros((int(np.count_nonzero(mixed)), length), self.real)
        for scale, each in zip(scales, tiles, strict=True):
            _kernels.add_lines(self.cells, each.first, self.outside, scale, mixed, cells)
        lines = fft.rfft(cells, axis=-1, overwrite_x=True)
        levels = np.zeros(mixed.shape)
        for scale, each in zip(scales, tiles, strict=True):
            levels += scale * (each.counts - length / 2)
        layers = lines.reshape(*mixed.shape, -1) if mixed.all() else _kernels.place_lines(mixed, levels, lines)
        if len(tile) == 3:
            changing = np.flatnonzero(mixed.any(axis=1) | (levels != levels[:, :1]).any(axis=1))
            begin, end = (int(changing[0]), int(changing[-1]) + 1) if changing.size else (0, 0)
            turned = fft.fft(layers[begin:end], axis=1)
            for constant in (layers[:begin], layers[end:]):
                level = constant[:, 0, 0] * tile[1]
                constant[...] = 0.0
                constant[:, 0, 0] = level
            layers[begin:end] = turned
        return np.asarray(fft.fft(layers.reshape(*tile[:-1], -1), axis=0, overwrite_x=True))

    def _invert(self, product: NDArray[Any]) -> NDArray[Any]:
        """Inverse transform, axis by axis, keeping only the rows that carry results."""
        from scipy import fft

        for axis, keep in enumerate(self.tiling.step[:-1]):
            product = fft.ifft(product, axis=axis, overwrite_x=True)[(slice(None),) * axis + (slice(keep),)]
        return np.asarray(fft.irfft(product, n=self.tiling.tile[-1], axis=-1, overwrite_x=True))

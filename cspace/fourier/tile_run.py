"""One tile of a correlation: its spectrum, the products with those of the robots, and what they yield."""

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

Bools = NDArray[np.bool_]


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

    def robot_spectrum(self, members: Group) -> Spectrum:
        """Conjugate spectrum of rasters, as digits of one, transformed in float64 from the rows that they fill."""
        from scipy import fft

        firsts = [tuple(p - q for p, q in zip(part.lower, self.lower, strict=True)) for part, _ in members]
        lasts = [np.add(first, part.cells.shape) for first, (part, _) in zip(firsts, members, strict=True)]
        spectrum = np.zeros(np.max(lasts, axis=0))
        for number, (first, (part, _)) in enumerate(zip(firsts, members, strict=True)):
            place = tuple(slice(low, low + n) for low, n in zip(first, part.cells.shape, strict=True))
            spectrum[place] += part.cells * 2.0 ** (self.tiling.bits * number)
        spectrum = fft.rfft(spectrum, n=self.tiling.tile[-1], axis=-1)
        for axis, length in enumerate(self.tiling.tile[:-1]):
            spectrum = fft.fft(spectrum, n=length, axis=axis)
        np.conj(spectrum, out=spectrum)
        return np.asarray(spectrum, np.complex64 if self.real == np.float32 else np.complex128)

    def settle(self, task: tuple[tuple[int, ...], Sequence[tuple[Group, Spectrum]]]) -> None:
        """Write the results from a corner on, as far as one tile yields them, for groups with their spectra."""
        from cspace.fourier import _kernels

        corner, groups = task
        tile = self.tiling.tile
        first = np.array([0] * (3 - len(tile)) + [c + low for c, low in zip(corner, self.lower, strict=True)])
        counts = np.empty((1, *tile[:-1])[-2:], np.int64)
        occupied = _kernels.count_lines(self.cells, first, tile[-1], self.outside, counts)
        if occupied in (0, math.prod(tile)):
            for part, result in itertools.chain.from_iterable(members for members, _ in groups):
                write(self._view(result, corner), part.constant + (part.count if occupied else 0), self.add)
            return
        spectrum = self._tile_spectrum(first, counts)
        product = spectrum if len(groups) == 1 else np.empty_like(spectrum)
        for members, robots in groups:
            sums = self._invert(np.multiply(spectrum, robots, out=product))
            if len(members) == 1:
                self._take(members[0], sums, corner)
            else:
                self._take_digits(members, sums, corner)

    def _take(self, member: Member, sums: NDArray[Any], corner: tuple[int, ...]) -> None:
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

    def _take_digits(self, members: Group, sums: NDArray[Any], corner: tuple[int, ...]) -> None:
        """Results of several rasters, whose overlaps are the digits of one sum."""
        from cspace.fourier import _kernels

        bits = self.tiling.bits
        sums = np.ascontiguousarray(sums, np.float64)
        _kernels.round_sums(sums, sum(part.count << bits * k for k, (part, _) in enumerate(members)) / 2)
        whole = sums.view(np.int64)
        for number, (part, result) in enumerate(members):
            shift, ones = bits * number, (1 << bits) - 1
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
                digits = whole[tuple(slice(n) for n in view.shape)] >> shift
                view[...] = (digits & ones) + part.constant

    def _view(self, result: NDArray[Any], corner: tuple[int, ...]) -> NDArray[Any]:
        return result[tuple(slice(start, start + step) for start, step in zip(corner, self.tiling.step, strict=True))]

    def _tile_spectrum(self, first: NDArray[np.int64], counts: NDArray[np.int64]) -> Spectrum:
        """Spectrum of W - 1/2 over the tile; lines and layers that are constant are not transformed, but known."""
        from scipy import fft

        from cspace.fourier import _kernels

        tile, length = self.tiling.tile, self.tiling.tile[-1]
        mixed = (counts > 0) & (counts < length)
        cells = np.empty((int(np.count_nonzero(mixed)), length), self.real)
        _kernels.centred_lines(self.cells, first, self.outside, counts, cells)
        lines = fft.rfft(cells, axis=-1, overwrite_x=True)
        layers = np.empty((*counts.shape, length // 2 + 1), lines.dtype)
        _kernels.place_lines(counts, length, lines, layers)
        if len(tile) == 3:
            changing = np.flatnonzero(mixed.any(axis=1) | (counts != counts[:, :1]).any(axis=1))
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

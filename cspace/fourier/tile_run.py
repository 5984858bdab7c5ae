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
        self.occupied, self.outside, self.tiling, self.lower, self.add = occupied, outside, tiling, lower, add
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
        corner, groups = task
        window, place = self._window(corner)
        tile = self.tiling.tile
        occupied = int(np.count_nonzero(window)) + self.outside * (math.prod(tile) - window.size)
        if occupied in (0, math.prod(tile)):
            for part, result in itertools.chain.from_iterable(members for members, _ in groups):
                write(self._view(result, corner), part.constant + (part.count if occupied else 0), self.add)
            return
        spectrum = self._tile_spectrum(window, place)
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

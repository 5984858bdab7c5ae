"""Rasters (sets of lattice offsets) and the compiled rasterisers that the shapes share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace._support.arrays import Bools, Floats, Ints, find_box, frozen, read_only
from cspace._support.threads import run_in_chunks
from cspace.errors import InputError

MAX_RASTER_CELLS = 2**28
"""Maximum number of cells in the bounding box of a raster."""

MIN_SLABS_PER_THREAD = 32
"""Minimum number of first indices of an array for each thread."""


@dataclass(frozen=True)
class Raster:
    """A finite set of offsets in Z^d, stored as a trimmed bitmap.

    Attributes
    ----------
    cells : ndarray of bool
        ``cells[i]`` is True if the set has the offset ``lower + i``; shape (0, ...) for the empty
        set.
    lower : tuple of int
        Offset of ``cells[0, ...]``.
    """

    cells: Bools
    lower: tuple[int, ...]

    @classmethod
    def from_bitmap(cls, cells: Bools, lower: tuple[int, ...]) -> Raster:
        """Make a raster from a bitmap whose first offset is ``lower``."""
        window = find_box(cells)
        trimmed = np.ascontiguousarray(cells[window])
        if not trimmed.size:
            return cls(trimmed, (0,) * cells.ndim)
        trimmed_lower = tuple(low + cut.start for low, cut in zip(lower, window, strict=True))
        return cls(frozen(trimmed), trimmed_lower)

    def rotate(self, matrix: Floats) -> Raster:
        """Rotate by a signed permutation matrix, which is exact."""
        if not self.cells.size:
            return self
        source_axes = np.abs(matrix).argmax(axis=1)
        signs = matrix.sum(axis=1).astype(int)
        permuted = self.cells.transpose(source_axes)
        cells = permuted[tuple(slice(None, None, sign) for sign in signs)]
        # A reversed axis begins at minus its largest offset.
        low = np.take(self.lower, source_axes)
        high = np.take(self.upper, source_axes)
        lower = np.where(signs > 0, low, -high)
        return Raster(np.ascontiguousarray(cells), tuple(lower.tolist()))

    @cached_property
    def layers_first(self) -> Raster:
        """The set with offsets (x, y, layer) as (layer, x, y), so that runs lie along y."""
        return self.rotate(np.eye(3)[[2, 0, 1]])

    def translate(self, offset: Sequence[int]) -> Raster:
        """Add an offset to every offset of the set."""
        steps = zip(self.lower, offset, strict=True)
        return Raster(self.cells, tuple(low + int(step) for low, step in steps))

    @property
    def upper(self) -> tuple[int, ...]:
        """Largest offset along each axis, inclusive."""
        return tuple(low + n - 1 for low, n in zip(self.lower, self.cells.shape, strict=True))

    @property
    def count(self) -> int:
        """Number of offsets in the set."""
        return int(np.count_nonzero(self.cells))

    @cached_property
    def runs(self) -> Ints:
        """Runs of offsets along the last axis (n, 4).

        They are the first offset, with a leading 0 in the plane, and the length of each.
        """
        # With gaps at both ends of each line, each run begins and ends where cells differ.
        borders = np.argwhere(np.diff(self.cells, prepend=False, append=False)) + self.lower
        first = borders[0::2]
        lengths = borders[1::2, -1:] - first[:, -1:]
        layers = np.zeros((len(first), 3 - self.cells.ndim), dtype=np.int64)
        return read_only(np.concatenate([layers, first, lengths], axis=1))


def extract_runs(rasters: Sequence[Raster]) -> tuple[Ints, Ints]:
    """List the runs of rasters.

    Returns
    -------
    runs : ndarray of int64, shape (n, 4)
        As :attr:`Raster.runs`, in the order of the rasters.
    owner : ndarray of int64, shape (n,)
        Index of the raster that each run belongs to.
    """
    tables = [raster.runs for raster in rasters]
    return np.concatenate(tables), np.repeat(np.arange(len(tables)), list(map(len, tables)))


def find_index_ranges(lows: Floats, highs: Floats, shape: Sequence[int]) -> tuple[Ints, Ints]:
    """Return first and last array indices inside each box.

    ``lows`` and ``highs`` are the corners of the boxes, ``shape`` is that of the array. The corners
    and both results have the shape (n, d).
    """
    first = np.maximum(np.ceil(lows), 0.0).astype(np.int64)
    last = np.minimum(np.floor(highs), np.array(shape) - 1.0).astype(np.int64)
    return first, last


def run_in_slabs(kernel: Callable[..., None], out: NDArray[Any], *inputs: Any) -> None:
    """Run ``kernel(out, *inputs, start, stop)`` on slabs of ``out``, in threads.

    A slab is a range of first indices.
    """

    def run_kernel(start: int, stop: int) -> int:
        kernel(out, *inputs, start, stop)
        return -1  # no slab is invalid

    run_in_chunks(run_kernel, len(out), MIN_SLABS_PER_THREAD)


def allocate_bitmap(low: Floats, high: Floats) -> tuple[Bools, tuple[int, ...]]:
    """Allocate an empty bitmap that contains a box of lattice points.

    It is two cells larger on each side. Returns the bitmap and the offset of its first entry.
    Raises InputError if the box has more cells than a raster may.
    """
    lower = np.floor(low) - 2
    shape = np.ceil(high) + 3 - lower  # up to two cells beyond the last one
    if np.prod(shape) > MAX_RASTER_CELLS:
        size = " x ".join(f"{n:.0f}" for n in shape)
        raise InputError(
            "robot",
            f"is {size} cells large at this spacing",
            f"it may have at most {MAX_RASTER_CELLS}",
        )
    return np.zeros(tuple(shape.astype(int)), dtype=np.bool_), tuple(int(n) for n in lower)

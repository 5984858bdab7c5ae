"""Rasters: sets of lattice offsets, the discrete robot; and the compiled rasterisers that the shapes share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cspace.arrays import Bools, Floats, Ints, frozen
from cspace.errors import InputError
from cspace.limits import free_bytes

MAX_CELLS = 2**28

SMALL = 2**22
"""Cells up to which a robot is rasterised without a look at the memory."""

BYTES = 6
"""Memory for each cell of a robot while it is rasterised: several bitmaps."""


@dataclass(frozen=True, slots=True)
class Raster:
    """A finite set of offsets ``m`` in Z^d, held as a bitmap trimmed to its bounding box.

    Attributes
    ----------
    cells : ndarray of bool
        ``cells[i]`` is whether the offset ``lower + i`` belongs to the set; of shape (0, ...) for the empty set.
    lower : tuple of int
        Offset of ``cells[0, ...]``.
    """

    cells: Bools
    lower: tuple[int, ...]

    @classmethod
    def from_bitmap(cls, cells: Bools, lower: tuple[int, ...]) -> Raster:
        """The set of the True entries of ``cells``, whose first entry is the offset ``lower``."""
        window, left = [], cells
        for _ in range(cells.ndim):
            used = np.flatnonzero(left.reshape(len(left), -1).any(axis=1))
            if not len(used):
                return cls(np.zeros((0,) * cells.ndim, dtype=np.bool_), (0,) * cells.ndim)
            window.append(slice(int(used[0]), int(used[-1]) + 1))
            left = np.asarray(left.any(axis=0))
        tight = np.ascontiguousarray(cells[tuple(window)])
        return cls(frozen(tight), tuple(low + part.start for low, part in zip(lower, window, strict=True)))

    def turned(self, matrix: Floats) -> Raster:
        """The set turned by a matrix with one 1 or -1 in each row and column: an exact permutation of the lattice."""
        if not self.cells.size:
            return self
        axes, signs = np.abs(matrix).argmax(axis=1), matrix.sum(axis=1)
        cells = self.cells.transpose(axes)[tuple(slice(None, None, int(sign)) for sign in signs)]
        lower = tuple(self.lower[a] if sign > 0 else -self.upper[a] for a, sign in zip(axes, signs, strict=True))
        return Raster(np.ascontiguousarray(cells), lower)

    def moved(self, by: Sequence[int]) -> Raster:
        """The set with so much added to each offset."""
        return Raster(self.cells, tuple(low + int(more) for low, more in zip(self.lower, by, strict=True)))

    @property
    def upper(self) -> tuple[int, ...]:
        """The largest offset along each axis, inclusive."""
        return tuple(low + n - 1 for low, n in zip(self.lower, self.cells.shape, strict=True))

    @property
    def count(self) -> int:
        """Number of offsets in the set."""
        return int(np.count_nonzero(self.cells))


def extract_runs(rasters: Sequence[Raster]) -> tuple[Ints, Ints]:
    """The offsets of rasters as runs along the last axis, shape (n, 4), and which raster each is of, shape (n,).

    A run is its first offset, with 0 before it in the plane, and its length. Those of a raster follow each other.
    """
    places: list[Ints] = []
    for raster in rasters:
        lines, n = math.prod(raster.cells.shape[:-1]), raster.cells.shape[-1]
        # With a gap before the first line and behind each: a run begins, or has ended, where two that follow differ.
        bits = np.zeros(1 + lines * (n + 1), dtype=np.bool_)
        bits[1:].reshape(lines, n + 1)[:, :n] = raster.cells.reshape(lines, n)
        places.append(np.flatnonzero(bits[1:] != bits[:-1]))
    owner = np.repeat(np.arange(len(rasters)), [len(each) // 2 for each in places])
    shapes = np.array([(1, *raster.cells.shape)[-3:] for raster in rasters])[owner]
    lower = np.array([(0, *raster.lower)[-3:] for raster in rasters])[owner]
    first, stop = np.concatenate(places).reshape(-1, 2).T
    line, last = np.divmod(first, shapes[:, 2] + 1)
    table = np.empty((len(first), 4), dtype=np.int64)
    table[:, 0], table[:, 1] = np.divmod(line, shapes[:, 1])
    table[:, 2], table[:, 3] = last, stop - first
    table[:, :3] += lower
    return table, owner


def allocate_bitmap(low: Floats, high: Floats) -> tuple[Bools, tuple[int, ...]]:
    """An empty bitmap over the lattice points of a box, with two cells to spare, and the offset of its first entry.

    Raises InputError if the box holds more cells than a raster may.
    """
    first = np.floor(low) - 2
    shape = np.ceil(high) + 3 - first
    cells, most = float(np.prod(shape)), MAX_CELLS
    if cells > SMALL:
        most = min(MAX_CELLS, (free_bytes() or BYTES * MAX_CELLS) // BYTES)
    if cells > most:
        across = " x ".join(f"{n:.0f}" for n in shape)
        raise InputError(
            "robot",
            f"is {across} cells large at this spacing",
            f"at most {most} cells are rasterised, with the memory that is free",
            "use a larger spacing, or check the robot's units (metres)",
        )
    return np.zeros(tuple(shape.astype(int)), dtype=np.bool_), tuple(int(n) for n in first)

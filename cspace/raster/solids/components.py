"""Components: the connected sets of untouched boxes, held as runs along z.

There are about as many runs as columns and touched boxes, so that labelling costs one look at each box, and memory
for the runs alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.threads import in_chunks

Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]
Labels = NDArray[np.int32]

_SLABS_A_THREAD = 32


@dataclass(frozen=True, slots=True, eq=False)
class Components:
    """Sets of boxes, joined through sides.

    Attributes
    ----------
    shape : tuple of int
        Of the array of boxes.
    offsets : ndarray of int64
        The runs of column ``i * ny + j`` are those from ``offsets[column]`` up to ``offsets[column + 1]``.
    lows, highs, labels : ndarray of int32
        For each run its first and last z, and the number of its component.
    count : int
        Number of components.
    """

    shape: tuple[int, int, int]
    offsets: Integers
    lows: Labels
    highs: Labels
    labels: Labels
    count: int

    @classmethod
    def of(cls, blocked: Bools) -> Components:
        """The components of the False entries, shape (nx, ny, nz)."""
        from cspace.raster.solids import _kernels

        nx, ny, nz = blocked.shape
        counts = np.empty(nx * ny, dtype=np.int64)

        def count(start: int, stop: int) -> int:
            _kernels.count_runs(blocked, counts, start, stop)
            return -1

        in_chunks(count, nx, _SLABS_A_THREAD)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        lows, highs, parents, labels = (np.empty(int(offsets[-1]), dtype=np.int32) for _ in range(4))

        def fill(start: int, stop: int) -> int:
            _kernels.list_runs(blocked, offsets, lows, highs, start, stop)
            return -1

        in_chunks(fill, nx, _SLABS_A_THREAD)
        number = int(_kernels.label_runs(ny, offsets, lows, highs, parents, labels))
        return cls((nx, ny, nz), offsets, lows, highs, labels, number)

    def members(self) -> Integers:
        """Index of one box of each component, shape (count, 3)."""
        runs = np.unique(self.labels, return_index=True)[1]
        column = np.searchsorted(self.offsets, runs, side="right") - 1
        return np.stack([column // self.shape[1], column % self.shape[1], self.lows[runs]], axis=1).astype(np.int64)

    def samples(self, chosen: Bools, most: int) -> tuple[Integers, Integers]:
        """Boxes of the chosen components, about ``most`` at most, shape (n, 3), and the component of each.

        First boxes of runs: of all runs of a small component, and of as many of a large one, evenly drawn.
        """
        runs = np.flatnonzero(chosen[self.labels])
        runs = runs[np.argsort(self.labels[runs], kind="stable")]
        counts = np.bincount(self.labels[runs], minlength=self.count)
        rank = np.arange(len(runs)) - np.repeat(np.cumsum(counts) - counts, counts)
        step = np.maximum(1, -(-counts * int(chosen.sum()) // most))
        runs = runs[rank % np.repeat(step, counts) == 0]
        column = np.searchsorted(self.offsets, runs, side="right") - 1
        boxes = np.stack([column // self.shape[1], column % self.shape[1], self.lows[runs]], axis=1)
        return boxes.astype(np.int64), self.labels[runs].astype(np.int64)

    def at_border(self) -> Bools:
        """Whether each component reaches the border of the array, shape (count,)."""
        nx, ny, nz = self.shape
        column = np.repeat(np.arange(nx * ny), np.diff(self.offsets))
        i, j = column // ny, column % ny
        ends = (i == 0) | (i == nx - 1) | (j == 0) | (j == ny - 1) | (self.lows == 0) | (self.highs == nz - 1)
        border = np.zeros(self.count, dtype=np.bool_)
        border[self.labels[ends]] = True
        return border

    def fill(self, out: Bools, chosen: Bools) -> None:
        """Set ``out`` on the chosen components, and leave the rest as it is."""
        from cspace.raster.solids import _kernels

        def work(start: int, stop: int) -> int:
            _kernels.fill_runs(out, self.offsets, self.lows, self.highs, self.labels, chosen, start, stop)
            return -1

        if chosen.any():
            in_chunks(work, self.shape[0], _SLABS_A_THREAD)

"""Components: the connected sets of untouched boxes, held as runs along z.

There are about as many runs as columns and touched boxes, so that labelling costs one look at each box, and memory
for the runs alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Ints
from cspace.compiling import kernel
from cspace.threads import in_chunks

Labels = NDArray[np.int32]

_SLABS_A_THREAD = 32


class Components(NamedTuple):
    """Sets of boxes, joined through sides; compiled functions take them as they are.

    Attributes
    ----------
    shape : tuple of int
        Of the array of boxes.
    offsets : ndarray of int64
        The runs of column ``i * ny + j`` are those from ``offsets[column]`` up to ``offsets[column + 1]``.
    lows, highs, labels : ndarray of int32
        For each run its first and last z, and the number of its component.
    number : int
        Of components.
    """

    shape: tuple[int, int, int]
    offsets: Ints
    lows: Labels
    highs: Labels
    labels: Labels
    number: int

    @classmethod
    def of(cls, blocked: Bools) -> Components:
        """The components of the False entries, shape (nx, ny, nz)."""
        nx, ny, nz = blocked.shape
        counts = np.empty(nx * ny, dtype=np.int64)

        def count(start: int, stop: int) -> int:
            _count_runs(blocked, counts, start, stop)
            return -1

        in_chunks(count, nx, _SLABS_A_THREAD)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        lows, highs, parents, labels = (np.empty(int(offsets[-1]), dtype=np.int32) for _ in range(4))

        def fill(start: int, stop: int) -> int:
            _list_runs(blocked, offsets, lows, highs, start, stop)
            return -1

        in_chunks(fill, nx, _SLABS_A_THREAD)
        number = int(_label_runs(ny, offsets, lows, highs, parents, labels))
        return cls((nx, ny, nz), offsets, lows, highs, labels, number)

    def at(self, boxes: Ints) -> Labels:
        """The component of untouched boxes, numbered in the order of the array, shape (n,)."""
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        starts = column * self.shape[2] + self.lows
        return np.asarray(self.labels[np.searchsorted(starts, boxes, side="right") - 1])

    def lengths(self) -> Ints:
        """How many boxes each component is long, along the axis along which that is most, shape (number,)."""
        column = np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))
        longest = np.zeros(self.number, dtype=np.int64)
        i, j = column // self.shape[1], column % self.shape[1]
        for low, high in ((i, i), (j, j), (self.lows, self.highs)):
            first, last = np.full(self.number, max(self.shape)), np.zeros(self.number, dtype=np.int64)
            np.minimum.at(first, self.labels, low)
            np.maximum.at(last, self.labels, high)
            longest = np.maximum(longest, last - first + 1)
        return longest

    def at_border(self) -> Bools:
        """Whether each component reaches the border of the array, shape (number,)."""
        nx, ny, nz = self.shape
        column = np.repeat(np.arange(nx * ny), np.diff(self.offsets))
        i, j = column // ny, column % ny
        outermost = (i == 0) | (i == nx - 1) | (j == 0) | (j == ny - 1) | (self.lows == 0) | (self.highs == nz - 1)
        border = np.zeros(self.number, dtype=np.bool_)
        border[self.labels[outermost]] = True
        return border

    def fill(self, out: Bools, chosen: Bools) -> None:
        """Set ``out`` on the chosen components, and leave the rest as it is."""

        def work(start: int, stop: int) -> int:
            _fill_runs(out, self, chosen, start, stop)
            return -1

        if chosen.any():
            in_chunks(work, self.shape[0], _SLABS_A_THREAD)


@kernel
def _count_runs(blocked: Bools, counts: Ints, start: int, stop: int) -> None:
    """Set ``counts[i * ny + j]``, for first indices in ``[start, stop)``, to the number of runs in that column."""
    _, ny, nz = blocked.shape
    for i in range(start, stop):
        for j in range(ny):
            number, before = 0, True
            for k in range(nz):
                here = blocked[i, j, k]
                number += before and not here
                before = here
            counts[i * ny + j] = number


@kernel
def _list_runs(blocked: Bools, offsets: Ints, lows: Labels, highs: Labels, start: int, stop: int) -> None:
    """Write first and last index of each run, for first indices in ``[start, stop)``, from the column's offset on."""
    _, ny, nz = blocked.shape
    for i in range(start, stop):
        for j in range(ny):
            run, before = offsets[i * ny + j], True
            for k in range(nz):
                here = blocked[i, j, k]
                if before and not here:
                    lows[run] = k
                elif here and not before:
                    highs[run] = k - 1
                    run += 1
                before = here
            if not before:
                highs[run] = nz - 1


@kernel
def find(parents: Labels, node: int) -> int:
    """The root of a node; the way there is halved (Tarjan, 1975)."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@kernel
def unite(parents: Labels, a: int, b: int) -> bool:
    """Join two nodes, the lower root on top; whether they were apart."""
    a, b = find(parents, a), find(parents, b)
    if a == b:
        return False
    parents[max(a, b)] = min(a, b)
    return True


@kernel
def _join_columns(offsets: Ints, lows: Labels, highs: Labels, parents: Labels, column: int, other: int) -> None:
    """Join the runs of two neighbouring columns that overlap."""
    a, b = offsets[column], offsets[other]
    while a < offsets[column + 1] and b < offsets[other + 1]:
        if lows[a] <= highs[b] and lows[b] <= highs[a]:
            unite(parents, a, b)
        if highs[a] < highs[b]:
            a += 1
        else:
            b += 1


@kernel
def _label_runs(ny: int, offsets: Ints, lows: Labels, highs: Labels, parents: Labels, labels: Labels) -> int:
    """Number the components of runs that share a side of a cell, by their first runs; how many there are.

    ``parents`` is room for work, of the size of ``labels``.
    """
    for run in range(len(parents)):
        parents[run] = run
    for column in range(len(offsets) - 1):
        if column % ny > 0:
            _join_columns(offsets, lows, highs, parents, column, column - 1)
        if column >= ny:
            _join_columns(offsets, lows, highs, parents, column, column - ny)
    number = 0
    for run in range(len(parents)):
        # A root is the smallest run of its component, and a parent is smaller than its child: it has its number.
        if parents[run] == run:
            labels[run] = number
            number += 1
        else:
            labels[run] = labels[parents[run]]
    return number


@kernel
def _fill_runs(out: Bools, runs: Components, chosen: Bools, start: int, stop: int) -> None:
    """Set ``out`` on the runs of the chosen components, for first indices in ``[start, stop)``."""
    ny = out.shape[1]
    for i in range(start, stop):
        for j in range(ny):
            for run in range(runs.offsets[i * ny + j], runs.offsets[i * ny + j + 1]):
                if chosen[runs.labels[run]]:
                    for k in range(runs.lows[run], runs.highs[run] + 1):
                        out[i, j, k] = True

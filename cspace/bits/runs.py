"""Runs: a robot's offsets as rows of consecutive ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.raster.raster import Raster

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Runs:
    """The offsets of a raster that can fall on a map, as rows of consecutive ones along the last axis.

    Attributes
    ----------
    table : ndarray of int64, shape (n, 4)
        The first offset of each, with 0 along the first axis in the plane, and how many offsets it has; ascending in
        this number.
    lower, upper : ndarray of int64, shape (3,)
        The least and the greatest offset along each axis.
    lengths : int
        How many different lengths there are.
    beyond : bool
        Whether there are other offsets, which always fall beyond the map.
    """

    table: Ints
    lower: Ints
    upper: Ints
    lengths: int
    beyond: bool

    @classmethod
    def of(cls, raster: Raster, shape: Sequence[int]) -> Runs:
        """The runs of a raster on a map of a shape of two or three axes."""
        from cspace.bits import _kernels

        extra = 3 - raster.cells.ndim
        cells = np.ascontiguousarray(raster.cells).reshape((1,) * extra + raster.cells.shape).view(np.uint8)
        lower = np.array((0,) * extra + raster.lower, dtype=np.int64)
        table, ends, lengths, offsets = _kernels.find_runs(cells, lower, np.array(in_space(shape), dtype=np.int64))
        return cls(table, ends[:3], ends[3:], int(lengths), bool(offsets < raster.count))

    def __len__(self) -> int:
        return len(self.table)

    @property
    def longest(self) -> int:
        """The greatest number of offsets in a row."""
        return int(self.table[-1, 3])


def in_space(shape: Sequence[int]) -> tuple[int, int, int]:
    """The shape of a map with three axes; one in the plane has one layer."""
    layers, rows, cells = (*(1,) * (3 - len(shape)), *shape)
    return layers, rows, cells

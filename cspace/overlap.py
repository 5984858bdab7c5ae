"""Overlaps at single configurations, without a stored grid of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.raster.raster import Raster


def column_sums(occupied: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Running counts of obstacle cells: entry ``[i, j]`` counts the first j of column i; shape (nx, ny + 1)."""
    sums = np.zeros((occupied.shape[0], occupied.shape[1] + 1), dtype=np.int32)
    np.cumsum(occupied, axis=1, dtype=np.int32, out=sums[:, 1:])
    return sums


def raster_runs(raster: Raster) -> NDArray[np.int64]:
    """The offsets of a raster as rows ``(dx, first dy, last dy)``, shape (n, 3)."""
    steps = np.diff(raster.cells.astype(np.int8), axis=1, prepend=0, append=0)
    column, first = np.nonzero(steps == 1)
    last = np.nonzero(steps == -1)[1] - 1
    return np.stack([column + raster.lower[0], first + raster.lower[1], last + raster.lower[1]], axis=1)

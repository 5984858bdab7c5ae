"""Overlaps at single configurations, without a stored grid of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.raster.raster import Raster


def column_sums(occupied: NDArray[np.bool_]) -> NDArray[Any]:
    """Running counts of obstacle cells along the last axis.

    Parameters
    ----------
    occupied : ndarray of bool, shape (..., n)

    Returns
    -------
    ndarray of int16 or int32, shape (..., n + 1)
        Entry ``[..., j]`` counts the first j cells of its column; of 16 bits where they suffice.
    """
    count = occupied.shape[-1]
    dtype = np.int16 if count <= np.iinfo(np.int16).max else np.int32
    sums = np.zeros((*occupied.shape[:-1], count + 1), dtype=dtype)
    for part, into in zip(occupied, sums, strict=True):  # one by one: numpy would first copy all to the wider type
        np.cumsum(part, axis=-1, dtype=dtype, out=into[..., 1:])
    return sums


def raster_runs(raster: Raster) -> NDArray[np.int64]:
    """The offsets of a raster as rows of an offset, its last entry replaced by the first and the last of a run.

    Rows ``(dx, first dy, last dy)`` in the plane and ``(dx, dy, first dz, last dz)`` in space; shape (n, d + 1).
    """
    steps = np.diff(raster.cells.astype(np.int8), axis=-1, prepend=0, append=0)
    *columns, first = np.nonzero(steps == 1)
    last = np.nonzero(steps == -1)[-1] - 1
    runs: NDArray[np.int64] = np.stack([*columns, first, last], axis=-1)
    runs += [*raster.lower, raster.lower[-1]]
    return runs

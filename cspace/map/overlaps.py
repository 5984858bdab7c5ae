"""Overlaps without stored counts, from rows of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints, Numbers, Row
from cspace.compiling import kernel
from cspace.map.points import cell_of, is_usable, position_in, slice_of
from cspace.map.record import Map
from cspace.raster import Raster, extract_runs
from cspace.rotations.lookup import rotation_in

Counts = NDArray[np.int16] | NDArray[np.int32]


class Sums:
    """Running counts of obstacle cells along the last axis.

    Attributes
    ----------
    counts : ndarray of int16 or int32, shape (nx, ny, nz + 1)
        Entry ``[i, j, k]`` counts the first k cells of its column; the plane has one layer. The type is int16 if it
        suffices.
    """

    def __init__(self, cells: Bools) -> None:
        cells = _with_three_axes(cells)
        kind = np.int16 if cells.shape[2] <= np.iinfo(np.int16).max else np.int32
        self.counts: Counts = np.zeros((*cells.shape[:2], cells.shape[2] + 1), dtype=kind)
        for part, into in zip(
            cells, self.counts, strict=True
        ):  # slice by slice, because numpy would first copy all to that type
            np.cumsum(part, axis=-1, dtype=kind, out=into[..., 1:])

    def refresh(self, cells: Bools, box: Ints) -> None:
        """Count again in a box (6,) of changed cells."""
        refresh_counts(self.counts, _with_three_axes(cells), box)


def _with_three_axes(cells: Bools) -> Bools:
    """Return cells with three axes."""
    return cells.reshape(*(1,) * (3 - cells.ndim), *cells.shape)


class Runs(NamedTuple):
    """Robot offsets of each slice, as rows.

    Attributes
    ----------
    rows : ndarray of int64, shape (n, 4)
        ``(dx, dy, first dz, number of dz)``; in the plane dx is 0, and dy and dz stand for the two axes.
    stops : ndarray of int64, shape (slices,)
        End of the rows of each slice.
    """

    rows: Ints
    stops: Ints

    @classmethod
    def of(cls, rasters: Sequence[Raster]) -> Runs:
        """Extract the rows of rasters, one for each slice."""
        rows, owner = extract_runs(rasters)
        return cls(rows, np.searchsorted(owner, np.arange(len(rasters)), side="right"))


@kernel
def overlaps(map_: Map, counts: Counts, runs: Runs, outside: int, points: Floats, out: Ints) -> int:
    """Compute overlaps; return the first unusable row, or -1.

    ``outside`` is 1 if cells outside the grid are obstacles, otherwise 0.
    """
    for k in range(points.shape[0]):
        position, rotation = position_in(map_, points, k), rotation_in(map_.rotations.borders, points[k])
        if not is_usable(position, rotation):
            return k
        out[k] = overlap_at(map_, counts, runs, outside, position, rotation)
    return -1


@kernel
def overlap_at(map_: Map, counts: Counts, runs: Runs, outside: int, position: Row, rotation: Numbers) -> int:
    """Return the overlap at one configuration."""
    nx, ny, nz = counts.shape[0], counts.shape[1], counts.shape[2] - 1
    i, j, k = cell_of(map_, position)
    s = slice_of(map_, rotation)
    total = 0
    for r in range(runs.stops[s - 1] if s > 0 else 0, runs.stops[s]):
        a, b = i + runs.rows[r, 0], j + runs.rows[r, 1]
        first, uncounted = k + runs.rows[r, 2], runs.rows[r, 3]
        if 0 <= a < nx and 0 <= b < ny:
            begin = min(max(first, 0), nz)
            end = min(max(first + uncounted, 0), nz)
            total += counts[a, b, end] - counts[a, b, begin]
            uncounted -= end - begin
        total += uncounted * outside
    return total


@kernel
def refresh_counts(counts: Counts, cells: Bools, box: Ints) -> None:
    """Update running counts after cells changed within a box.

    ``box`` has the first and last changed cell, shape (6,).
    """
    for x in range(box[0], box[3] + 1):
        for y in range(box[1], box[4] + 1):
            row, into = cells[x, y], counts[x, y]
            before = into[box[5] + 1]
            for z in range(box[2], box[5] + 1):
                into[z + 1] = into[z] + row[z]
            step = into[box[5] + 1] - before
            if step != 0:
                for z in range(box[5] + 2, into.shape[0]):
                    into[z] += step

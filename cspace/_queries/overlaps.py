"""Overlap counts at configurations, summed over rows of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._queries.points import cell_of, configuration_in, is_usable, slice_of
from cspace._raster import Raster, extract_runs
from cspace._record.cells import Map
from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.compiling import kernel

BYTES_PER_CELL: Final = 8
"""Memory of the running counts for each cell, bytes, while they are made."""

DX, DY, FIRST_DZ, LENGTH = range(4)
"""Columns of :attr:`RobotRows.rows`."""


class RobotRows(NamedTuple):
    """Rows of the robot's raster cells in each slice.

    Attributes
    ----------
    rows : ndarray of int64, shape (n, 4)
        Offsets ``(dx, dy, first dz, number of dz)`` of each row from the robot's cell; in the plane
        dx is 0, and dy and dz are along the two axes.
    stops : ndarray of int64, shape (slices,)
        Index after the last row of each slice.
    """

    rows: Ints
    stops: Ints

    @classmethod
    def of(cls, rasters: Sequence[Raster]) -> RobotRows:
        """Extract the rows of rasters, one for each slice."""
        rows, owner = extract_runs(rasters)
        return cls(rows, np.searchsorted(owner, np.arange(len(rasters)), side="right"))


def sum_columns(cells: Bools) -> NDArray[np.int32]:
    """Count obstacle cells cumulatively along the last axis.

    Entry ``[i, j, k]`` of the result, shape (nx, ny, nz + 1), counts the first k cells of a column.
    In the plane, nx is 1, and j and k are the two axes.
    """
    missing_axes = (1,) * (3 - cells.ndim)
    in_space = cells.reshape(*missing_axes, *cells.shape)
    nx, ny, nz = in_space.shape
    counts = np.zeros((nx, ny, nz + 1), dtype=np.int32)
    np.cumsum(in_space, axis=-1, dtype=np.int32, out=counts[..., 1:])
    return counts


@kernel
def count_overlaps(
    map_: Map,
    counts: NDArray[np.int32],
    robot: RobotRows,
    outside: int,
    points: Floats,
    out: Ints,
) -> int:
    """Count obstacle cells that the robot overlaps.

    ``points`` has shape (n, size). Writes the counts to ``out``, shape (n,); returns the index of
    the first unusable configuration, or -1. ``counts`` are those of :func:`sum_columns`.
    ``outside`` is 1 if cells outside the grid are obstacles, otherwise 0.
    """
    nx, ny, n_sums = counts.shape
    nz = n_sums - 1
    for n in range(points.shape[0]):
        position, rotation = configuration_in(map_, points, n)
        if not is_usable(position, rotation):
            return n
        i, j, k = cell_of(map_, position)
        s = slice_of(map_, rotation)
        first_row = robot.stops[s - 1] if s > 0 else 0
        total = 0
        for row in range(first_row, robot.stops[s]):
            x = i + robot.rows[row, DX]
            y = j + robot.rows[row, DY]
            first = k + robot.rows[row, FIRST_DZ]
            length = robot.rows[row, LENGTH]
            # The counts at both ends of a row give the obstacle cells between.
            inside = 0
            if 0 <= x < nx and 0 <= y < ny:
                begin = min(max(first, 0), nz)
                end = min(max(first + length, 0), nz)
                total += counts[x, y, end] - counts[x, y, begin]
                inside = end - begin
            total += (length - inside) * outside
        out[n] = total
    return -1

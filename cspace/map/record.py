"""The record of a map: all that compiled look-ups need, in one tuple that numba takes as it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cspace.arrays import Ints
from cspace.map.storage import Cells
from cspace.rotations import CompiledRotations


class Map(NamedTuple):
    """States over rotation cells times cells of a grid, in the plane or in space, whether the robot turns or not.

    The arrays are views of the map's own: an update of the workspace is seen through the record.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz), or TwoBits
        FREE, MIXED or BLOCKED; read-only, in C order. Compiled code reads its shape alone.
    cells : ndarray of uint8, shape (slices * nx * ny,) or (slices * nx * ny * nz,), or TwoBits
        The same in a row; compiled code reads it by :mod:`cspace.map.storage` alone.
    rotations : NamedTuple
        The rotation cells, and the slice that each has; look-ups call its methods alone.
    lower, upper : tuple of float, length d
        Corners of the grid, metres.
    spacing : float
    exterior : ndarray of int64, shape (slices, 2 d + 1)
        What lies outside the grid: :attr:`cspace.map.exterior.Exterior.table`.
    """

    states: Cells
    cells: Cells
    rotations: CompiledRotations
    lower: tuple[float, ...]
    spacing: float
    upper: tuple[float, ...]
    exterior: Ints

    @property
    def slice_of(self) -> Ints:
        """The slice of each rotation cell, shape (rotations,)."""
        return np.asarray(self.rotations.slice_of)

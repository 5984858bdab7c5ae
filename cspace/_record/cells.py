"""The arrays and numbers of a map in one record, an argument of compiled functions."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from cspace._grid import Grid
from cspace._rotations.base import RotationTable
from cspace._support.arrays import MIXED, Ints, Row, States, read_only


class Map(NamedTuple):
    """Cells of a map, of one type for all kinds of maps.

    The plane is space with one layer of cells along the first axis; a position in it is in the
    middle of that layer. The arrays are views of the map's own arrays, so updates are visible here.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny, nz)
        FREE, MIXED or BLOCKED; read-only. In the plane nx is 1, and ny and nz count the cells along
        x and y.
    dim : int
        2 in the plane, 3 in space.
    lower, upper : tuple of float, length 3
        Corners of the grid, metres.
    spacing : float
        Side of a cell, metres.
    exterior : ndarray of int64, shape (slices, 2 dim + 1)
        States outside the grid: :attr:`cspace._record.exterior.Exterior.table`.
    rotations : RotationTable
        Rotation cells and their slices.
    """

    states: States
    dim: int
    lower: Row
    upper: Row
    spacing: float
    exterior: Ints
    rotations: RotationTable


def make_map_record(states: States, grid: Grid, exterior: Ints, rotations: RotationTable) -> Map:
    """Return the record of a map with these states.

    States have the shape (slices, x, y) or (slices, x, y, z).
    """
    lower = tuple(grid.lower)
    upper = tuple(grid.upper)
    if grid.dim == 2:
        # The plane is one layer of cells, from 0 to the spacing along the first axis.
        states = states[:, None]
        lower = (0.0, *lower)
        upper = (grid.spacing, *upper)
    return Map(
        states=read_only(states),
        dim=grid.dim,
        lower=cast("Row", lower),
        upper=cast("Row", upper),
        spacing=grid.spacing,
        exterior=exterior,
        rotations=rotations,
    )


def hide_cells(map_: Map) -> Map:
    """Return a copy of a map whose configurations are all MIXED."""
    exterior = np.zeros_like(map_.exterior[:1])
    exterior[:, -1] = MIXED
    slices = np.zeros_like(map_.rotations.slice_of)
    x, y, z = map_.lower
    spacing = map_.spacing
    return map_._replace(
        states=read_only(np.full((1, 1, 1, 1), MIXED, dtype=np.uint8)),
        upper=(x + spacing, y + spacing, z + spacing),
        exterior=exterior,
        rotations=map_.rotations._replace(slice_of=slices),
    )

"""Overviews of tiled maps: the whole map in coarse cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cspace.grid import Grid
from cspace.record.exterior import UNKNOWN
from cspace.space import CSpace
from cspace.support.arrays import BLOCKED, MIXED, reduce_blocks
from cspace.tiles.folder import TileFolder
from cspace.workspace import Workspace


def build_overview(folder: TileFolder, max_cells: int) -> CSpace:
    """Return a map of at most ``max_cells`` cells along an axis, as a map in memory."""
    grid = folder.grid
    factor = max(1, -(-max(grid.shape) // max_cells))
    shape = tuple(-(-n // factor) for n in grid.shape)
    slices = np.arange(folder.slices)
    lowest = np.full((folder.slices, *shape), BLOCKED, dtype=np.uint8)
    highest = np.zeros_like(lowest)
    outer = np.zeros(shape, dtype=np.bool_)
    for index in folder:
        tile = folder.read_tile(index)
        own = folder.own(index)
        corners = folder.interior(index)
        # Coarse cells in the tile, and the first cell of each there.
        sides = [np.unique(np.arange(*side) // factor, return_index=True) for side in corners.T]
        coarse, starts = zip(*sides, strict=True)
        every = np.ix_(slices, *coarse)
        layers = [slices, *starts]
        part = tile.states[(slice(None), *own)]
        lowest[every] = np.minimum(lowest[every], reduce_blocks(part, layers, np.minimum))
        highest[every] = np.maximum(highest[every], reduce_blocks(part, layers))
        outer[np.ix_(*coarse)] |= reduce_blocks(tile.workspace.outer[own], starts)
    states = np.where(lowest == highest, lowest, np.uint8(MIXED))
    for axis, n in enumerate(grid.shape):
        if n % factor:  # the last coarse cells extend beyond the map, where nothing is known
            np.moveaxis(states, 1 + axis, 0)[-1] = MIXED
    coarse = Grid(grid.lower, grid.spacing * factor, shape, grid.axes, grid.units)
    # Obstacles fill no coarse cell for certain, so the inner cells are empty.
    workspace = Workspace(
        coarse, outer, np.zeros_like(outer), source=f"overview of {folder.path.name}"
    )
    return CSpace(
        replace(folder.frame, workspace=workspace, states=states, outside=UNKNOWN, exterior=None)
    )

"""Blocks of cells of a map, few enough for a browser."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

from cspace._space import CSpace
from cspace._support.arrays import block_starts, reduce_blocks
from cspace.plot._artists import Classes, classify_cells, classify_ground

if TYPE_CHECKING:
    from cspace._tiles.space import TiledCSpace

MAX_BLOCKS: Final = 2**21
"""Maximum number of blocks of a map, roughly."""
_MAX_CACHED_SLICES: Final = 24
"""Maximum number of slices whose blocks are cached."""


class Blocks(NamedTuple):
    """Blocks of cells with the largest, most important class in each.

    Attributes
    ----------
    classes : ndarray of uint8
        Indices into :data:`cspace.plot._artists.CLASSES`, by x, y and, in space, z.
    side : int
        Cells along each axis of a block; blocks at the upper border of the map may be smaller.
    """

    classes: Classes
    side: int


class Cells:
    """Blocks of the cells of a map; of a tiled map, of an overview.

    Attributes
    ----------
    drawn : CSpace
        The map that is drawn and sampled.
    make_blocks : callable
        Return the blocks of the map at a rotation cell, or those of the workspace if it is None.
    """

    def __init__(self, space: CSpace | TiledCSpace) -> None:
        """Choose the map to draw; blocks are made when they are first needed, and cached."""
        self._space = space
        self.make_blocks = lru_cache(_MAX_CACHED_SLICES)(self._reduce_to_blocks)
        self.invalidate()

    def invalidate(self) -> None:
        """Clear the cache, because the map has changed."""
        self.make_blocks.cache_clear()
        if isinstance(self._space, CSpace):
            self.drawn = self._space
        else:
            # An overview has at most about as many cells as the page has blocks.
            grid = self._space.grid
            share = (MAX_BLOCKS / grid.size) ** (1.0 / grid.dim)
            longest_side = math.floor(share * max(grid.shape))
            self.drawn = self._space.overview(max(1, longest_side))

    def _reduce_to_blocks(self, cell: int | None) -> Blocks:
        """Reduce the map at a rotation cell to blocks; without a cell, reduce the workspace."""
        space = self.drawn
        if cell is None:
            classes = classify_ground(space.workspace)
        else:
            classes = classify_cells(space, space.rotations.centers[cell])
        cells_per_block = space.grid.size / MAX_BLOCKS
        side = math.ceil(cells_per_block ** (1.0 / space.grid.dim))
        starts = block_starts(classes.shape, side)
        return Blocks(reduce_blocks(classes, starts), side)

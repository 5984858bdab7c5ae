"""Level of detail: the whole map in large blocks of cells, the part near the camera in small blocks."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from cspace.arrays import Floats, Ints, block_starts, reduce_blocks
from cspace.grid import Grid
from cspace.plot.artists import Classes, classify_cells, classify_ground

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.tiles.space import TiledCSpace

MAX_BLOCKS: Final = 2**21
"""Maximum number of blocks of the whole map, and of the part of it in small blocks."""
_MAX_CACHED_SLICES: Final = 24
"""Maximum number of slices whose blocks of the whole map are cached."""
MAX_CELLS_PER_SLAB: Final = 2**24
"""Maximum number of cells classified at once."""


class Blocks(NamedTuple):
    """Blocks of cells with the largest, most important class in each.

    Attributes
    ----------
    classes : ndarray of uint8
        Indices into :data:`cspace.plot.artists.CLASSES`, by x, y and, in space, z.
    first : ndarray of int64, shape (d,)
        First cell of the first block.
    side : int
        Cells along each axis of a block; blocks at the upper border of the map may be smaller.
    """

    classes: Classes
    first: Ints
    side: int


class Part(NamedTuple):
    """A part of a map, shown in smaller blocks.

    It has the cells ``first`` to ``stop - 1`` along each axis.
    """

    first: tuple[int, ...]
    stop: tuple[int, ...]
    side: int


class CellsInMemory:
    """Blocks of the cells of a :class:`cspace.CSpace`.

    Attributes
    ----------
    grid : Grid
    side : int
        Cells along an axis of a block of the whole map.
    sampling_map : CSpace
        The map, or its overview, to sample configurations from.
    is_quick : bool
        True if components are fast to compute. Those of a tiled map take long and are written to its store.
    """

    is_quick = True

    def __init__(self, space: CSpace) -> None:
        self.sampling_map, self.grid = space, space.grid
        self.side = math.ceil((space.grid.size / MAX_BLOCKS) ** (1.0 / space.grid.dim))
        self._cached: OrderedDict[int, Blocks] = OrderedDict()

    def map_blocks(self, rotation: Floats | None) -> Blocks:
        """Return the blocks of the map, or without rotation of the workspace."""
        key = -1 if rotation is None else int(self.sampling_map.rotations.find_cells(rotation))
        if key not in self._cached:
            everything = Part((0,) * self.grid.dim, self.grid.shape, self.side)
            self._cached[key] = self.part_blocks(rotation, everything)
        self._cached.move_to_end(key)
        while len(self._cached) > _MAX_CACHED_SLICES:
            self._cached.popitem(last=False)
        return self._cached[key]

    def part_blocks(self, rotation: Floats | None, part: Part) -> Blocks:
        """Return the blocks of a part of the map or workspace."""
        return make_blocks(lambda box: _classes(self.sampling_map, rotation, box), part)

    def invalidate(self) -> None:
        """Clear the cache, because the map has changed."""
        self._cached.clear()


class CellsInStore:
    """Blocks of the cells of a :class:`cspace.TiledCSpace`."""

    is_quick = False

    def __init__(self, space: TiledCSpace) -> None:
        self._space, self.grid = space, space.grid
        slices = len(space.slice_rotations)
        self.side = math.ceil((space.grid.size * slices / (_MAX_CACHED_SLICES * MAX_BLOCKS)) ** (1.0 / space.grid.dim))
        self.side = max(self.side, math.ceil((space.grid.size / MAX_BLOCKS) ** (1.0 / space.grid.dim)))

    @cached_property
    def sampling_map(self) -> CSpace:
        """An overview of the map, to sample configurations from."""
        return self._space.overview(math.ceil(max(self.grid.shape) / self.side))

    def map_blocks(self, rotation: Floats | None) -> Blocks:
        """Return the blocks of the map, or without rotation of the workspace."""
        side = round(self.sampling_map.grid.spacing / self.grid.spacing)
        return Blocks(_classes(self.sampling_map, rotation), np.zeros(self.grid.dim, dtype=np.int64), side)

    def part_blocks(self, rotation: Floats | None, part: Part) -> Blocks:
        """Return the blocks of a part of the map or workspace."""
        first, stop = np.array(part.first), np.array(part.stop)
        window = self._space.window(self.grid.center_of(first), self.grid.center_of(stop - 1))
        begin = np.rint((np.array(window.grid.lower) - self.grid.lower) / self.grid.spacing).astype(np.int64)

        def classes(box: tuple[slice, ...]) -> Classes:
            window_box = tuple(slice(b.start - n, b.stop - n) for b, n in zip(box, begin.tolist(), strict=True))
            return _classes(window, rotation, window_box)

        return make_blocks(classes, part)

    def invalidate(self) -> None:
        """Clear the cache, because the map has changed."""
        self.__dict__.pop("sampling_map", None)


Cells: TypeAlias = CellsInMemory | CellsInStore
"""Blocks of the cells of a map."""


def _classes(space: CSpace, rotation: Floats | None, box: tuple[slice, ...] = ()) -> Classes:
    """Return the classes of a box of cells at a rotation."""
    return classify_ground(space.workspace, box) if rotation is None else classify_cells(space, rotation, box)


def make_blocks(classes: Callable[[tuple[slice, ...]], Classes], part: Part) -> Blocks:
    """Return the blocks of a part of a map.

    ``classes`` returns the classes of a box of cells. To save memory, the cells are classified in slabs of at most
    :data:`MAX_CELLS_PER_SLAB`, or one row of blocks.
    """
    shape = np.subtract(part.stop, part.first)
    rows = part.side * max(1, MAX_CELLS_PER_SLAB // int(np.prod(shape[1:]) * part.side))
    others = tuple(map(slice, part.first[1:], part.stop[1:]))
    slabs = []
    for low in range(part.first[0], part.stop[0], rows):
        slab = classes((slice(low, min(low + rows, part.stop[0])), *others))
        slabs.append(reduce_blocks(slab, block_starts(slab.shape, part.side)))
    return Blocks(np.concatenate(slabs), np.array(part.first), part.side)


def choose_part(grid: Grid, point: Floats, reach: float, coarsest: int) -> Part | None:
    """Return the part around a point to show in smaller blocks.

    The part extends ``reach`` metres to each side and has about as many blocks as the whole map. Its corners move in
    steps, so that it stays the same while the camera moves a little. Return None if its blocks would not be smaller
    than the blocks of the whole map, whose side is ``coarsest`` cells.
    """
    reach = 2.0 ** (math.ceil(2.0 * math.log2(max(reach, grid.spacing))) / 2.0)
    blocks_per_axis = MAX_BLOCKS ** (1.0 / grid.dim)
    side = math.ceil(2.0 * reach / grid.spacing / blocks_per_axis)
    if side >= coarsest:
        return None
    half = math.ceil(side * blocks_per_axis / 2.0 / coarsest) * coarsest
    step = max(1, half // (4 * coarsest)) * coarsest
    center = np.rint((point - grid.lower) / grid.spacing / step) * step
    first, stop = np.maximum(center - half, 0).astype(int), np.minimum(center + half, grid.shape).astype(int)
    return Part(tuple(first.tolist()), tuple(stop.tolist()), side) if (first < stop).all() else None

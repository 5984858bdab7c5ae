"""Level of detail: the whole map in large blocks of cells, the part that the camera looks at in small ones."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np

from cspace.arrays import Floats, Ints, block_starts, reduce_blocks
from cspace.grid import Grid
from cspace.plot.artists import Classes, classes_of, ground_of

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.tiles.space import TiledCSpace

MOST: Final = 2**21
"""Blocks that are drawn at once, at most: of the whole map, and as many of a part of it."""
_CACHED: Final = 24
"""Slices whose blocks of the whole map are cached."""
SLAB: Final = 2**24
"""Cells whose classes are made at once."""


class Blocks(NamedTuple):
    """Blocks of cells, and the largest class in each, the most important to see.

    Attributes
    ----------
    classes : ndarray of uint8
        Indices into :data:`cspace.plot.artists.CLASSES`, by x, y and, in space, z.
    first : ndarray of int64, shape (d,)
        The first cell of the first block.
    side : int
        Cells along each axis of a block; at the upper border of the map there may be fewer.
    """

    classes: Classes
    first: Ints
    side: int


class Part(NamedTuple):
    """A part of a map that is shown in smaller blocks: from one cell on to before another, along each axis."""

    first: tuple[int, ...]
    stop: tuple[int, ...]
    side: int


class CellsInMemory:
    """The cells of a :class:`cspace.CSpace` as the page draws them.

    Attributes
    ----------
    grid : Grid
    side : int
        Cells along an axis of a block of the whole map.
    near : CSpace
        The map, or an overview of it, to sample configurations from.
    quick : bool
        Whether the components of the cells are soon known; those of a map in a store take long, and are written there.
    """

    quick = True

    def __init__(self, space: CSpace) -> None:
        self.near, self.grid = space, space.grid
        self.side = math.ceil((space.grid.size / MOST) ** (1.0 / space.grid.dim))
        self._cached: OrderedDict[int, Blocks] = OrderedDict()

    def whole(self, rotation: Floats | None) -> Blocks:
        """Return the blocks of the whole map at a rotation; without one, of the workspace alone."""
        number = -1 if rotation is None else int(self.near.rotations.cells_of(rotation))
        if number not in self._cached:
            everything = Part((0,) * self.grid.dim, self.grid.shape, self.side)
            self._cached[number] = self.part(rotation, everything)
        self._cached.move_to_end(number)
        while len(self._cached) > _CACHED:
            self._cached.popitem(last=False)
        return self._cached[number]

    def part(self, rotation: Floats | None, part: Part) -> Blocks:
        """Return the blocks of a part of the map."""
        return blocks(lambda box: _classes(self.near, rotation, box), part)

    def forget(self) -> None:
        """Drop what is cached, because the map has changed."""
        self._cached.clear()


class CellsInStore:
    """The cells of a :class:`cspace.TiledCSpace`: all of them from an overview, a part of them from a window."""

    quick = False

    def __init__(self, space: TiledCSpace) -> None:
        self._space, self.grid = space, space.grid
        slices = len(space.slice_rotations)
        self.side = math.ceil((space.grid.size * slices / (_CACHED * MOST)) ** (1.0 / space.grid.dim))
        self.side = max(self.side, math.ceil((space.grid.size / MOST) ** (1.0 / space.grid.dim)))

    @cached_property
    def near(self) -> CSpace:
        return self._space.overview(math.ceil(max(self.grid.shape) / self.side))

    def whole(self, rotation: Floats | None) -> Blocks:
        side = round(self.near.grid.spacing / self.grid.spacing)
        return Blocks(_classes(self.near, rotation), np.zeros(self.grid.dim, dtype=np.int64), side)

    def part(self, rotation: Floats | None, part: Part) -> Blocks:
        first, stop = np.array(part.first), np.array(part.stop)
        window = self._space.window(self.grid.center_of(first), self.grid.center_of(stop - 1))
        begin = np.rint((np.array(window.grid.lower) - self.grid.lower) / self.grid.spacing).astype(np.int64)

        def classes(box: tuple[slice, ...]) -> Classes:
            own = tuple(slice(b.start - n, b.stop - n) for b, n in zip(box, begin.tolist(), strict=True))
            return _classes(window, rotation, own)

        return blocks(classes, part)

    def forget(self) -> None:
        self.__dict__.pop("near", None)


Cells: TypeAlias = CellsInMemory | CellsInStore
"""The cells of a map as the page draws them."""


def _classes(space: CSpace, rotation: Floats | None, box: tuple[slice, ...] = ()) -> Classes:
    """Classes of a box of cells at a rotation; without one, those of the workspace alone."""
    return ground_of(space.workspace, box) if rotation is None else classes_of(space, rotation, box)


def blocks(classes: Callable[[tuple[slice, ...]], Classes], part: Part) -> Blocks:
    """Blocks of a part of a map, made slab by slab from the classes of boxes of cells."""
    shape = np.subtract(part.stop, part.first)
    rows = part.side * max(1, SLAB // int(np.prod(shape[1:]) * part.side))
    others = tuple(map(slice, part.first[1:], part.stop[1:]))
    made = []
    for low in range(part.first[0], part.stop[0], rows):
        slab = classes((slice(low, min(low + rows, part.stop[0])), *others))
        made.append(reduce_blocks(slab, block_starts(slab.shape, part.side)))
    return Blocks(np.concatenate(made), np.array(part.first), part.side)


def part_around(grid: Grid, point: Floats, reach: float, coarsest: int) -> Part | None:
    """The part of a map to show in smaller blocks, around a point, ``reach`` metres to each side.

    It has about as many blocks as the whole map, and moves in steps, so that it stays the same while the camera moves a
    little. None where its blocks would not be smaller than ``coarsest``, those of the whole map.
    """
    reach = 2.0 ** (math.ceil(2.0 * math.log2(max(reach, grid.spacing))) / 2.0)
    along = MOST ** (1.0 / grid.dim)
    side = math.ceil(2.0 * reach / grid.spacing / along)
    if side >= coarsest:
        return None
    half = math.ceil(side * along / 2.0 / coarsest) * coarsest
    step = max(1, half // (4 * coarsest)) * coarsest
    middle = np.rint((point - grid.lower) / grid.spacing / step) * step
    first, stop = np.maximum(middle - half, 0).astype(int), np.minimum(middle + half, grid.shape).astype(int)
    return Part(tuple(first.tolist()), tuple(stop.tolist()), side) if (first < stop).all() else None

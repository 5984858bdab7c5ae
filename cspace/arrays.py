"""Types that all rooms share, of arrays by what they hold; arrays that are not to be written, and blocks of entries."""

import os
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]
Words = NDArray[np.uint64]

Cell = TypeVar("Cell", np.bool_, np.uint8)

Numbers = tuple[float, ...]
"""A configuration, or what compiled code makes of one."""

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]

Surface = tuple[Floats, Ints]
"""Triangles: vertices, shape (V, 3), metres, and the numbers of their corners among these, shape (F, 3)."""

Box = tuple[slice, ...]
"""Cells along each axis."""

StrPath = str | os.PathLike[str]
"""The name of a file."""


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array, not to be written."""
    array.setflags(write=False)
    return array


def in_blocks(cells: NDArray[Cell], starts: Sequence[Ints], most: np.ufunc = np.maximum) -> NDArray[Cell]:
    """The largest entry in each block of cells, or the least, by ``np.minimum``; of booleans, whether any is set.

    ``starts`` are the first cells of the blocks along each axis, from 0 on.
    """
    # Entries of all blocks are compared at once: twenty times faster than ``reduceat``, which goes block by block.
    for axis, start in enumerate(starts):
        last = np.append(start[1:], cells.shape[axis]) - 1
        reduced = cells.take(start, axis)
        for step in range(1, int((last - start).max()) + 1):
            most(reduced, cells.take(np.minimum(start + step, last), axis), out=reduced)
        cells = reduced
    return cells


def block_starts(shape: Sequence[int], side: int) -> list[Ints]:
    """The first cells, along each axis, of blocks of so many cells."""
    return [np.arange(0, n, side) for n in shape]


def shared(box: Sequence[slice], other: Sequence[slice]) -> tuple[Box, Box]:
    """Intersect two boxes of cells; return the intersection in the indices of each box."""
    pairs = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(box, other, strict=True)]
    here, there = (
        tuple(slice(low - part.start, high - part.start) for (low, high), part in zip(pairs, each, strict=True))
        for each in (box, other)
    )
    return here, there

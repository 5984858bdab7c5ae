"""Array types and cell states that all rooms share, and functions on plain arrays."""

import os
from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]
Words = NDArray[np.uint64]

Cell = TypeVar("Cell", np.bool_, np.uint8)
Scalar = TypeVar("Scalar", bound=np.generic)

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

FREE: Final = 0
"""State of a cell in which every configuration is proven collision-free."""

MIXED: Final = 1
"""State of a cell that is not decided at this resolution."""

BLOCKED: Final = 2
"""State of a cell in which every configuration is proven to be in collision."""

STATE_NAMES: Final = ("free", "mixed", "blocked")
"""Name of each state, by its value."""

FIELD_NAMES: Final = ("penetration", "penetration_x", "penetration_y", "penetration_z")
"""Names of a map's overlap field in files: the overlap of descriptors, and its derivatives along the axes."""

BAND_BYTES: Final = 16
"""Bytes of a row that are written together when a plane is transposed: 8 to 16 are quickest, 64 take twice as long."""


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array, not to be written."""
    array.setflags(write=False)
    return array


def in_c_order(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return an array in C order: itself if it is, else a copy."""
    if array.ndim != 2 or abs(array.strides[0]) >= abs(array.strides[1]):
        return np.ascontiguousarray(array)
    copy = np.empty(array.shape, dtype=array.dtype)
    copy_transposed(array.T, copy)
    return copy


def copy_transposed(rows: NDArray[Scalar], out: NDArray[Scalar]) -> None:
    """Copy rows, shape (n, m), into the columns of ``out``, shape (m, n), in narrow bands.

    Copied at once, each cache line of the result would be read and written for every one of its entries: for 16,384 x
    16,384 bytes that takes eight times as long.
    """
    width = max(1, BAND_BYTES // rows.itemsize)
    for first in range(0, len(rows), width):
        out[:, first : first + width] = rows[first : first + width].T


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

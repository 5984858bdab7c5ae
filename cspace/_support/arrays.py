"""Array types, cell states and functions on plain arrays."""

import math
import os
from collections.abc import Sequence
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
"""Array of truth values."""

Bytes = NDArray[np.uint8]
"""Array of bytes, e.g. of colours."""

Floats = NDArray[np.float64]
"""Array of numbers in double precision."""

Ints = NDArray[np.int64]
"""Array of whole numbers."""

States = NDArray[np.uint8]
"""Array of states of cells: FREE, MIXED or BLOCKED."""

Words = NDArray[np.uint64]
"""Array of words of 64 bits."""

Cell = TypeVar("Cell", np.bool_, np.uint8)

Numbers = tuple[float, ...]
"""Coordinates of a configuration, or values that compiled code computes from them."""

Row = tuple[float, float, float]
"""Three numbers in compiled code, e.g. a vector."""

Surface = tuple[Floats, Ints]
"""Triangles: vertices, shape (V, 3), metres, and vertex indices of the faces, shape (F, 3)."""

Box = tuple[slice, ...]
"""Range of cells along each axis."""

StrPath = str | os.PathLike[str]
"""Path of a file."""

FREE: Final = 0
"""State of a cell in which every configuration is proven collision-free."""

MIXED: Final = 1
"""State of a cell that is undecided at this resolution."""

BLOCKED: Final = 2
"""State of a cell in which every configuration is proven to be in collision."""

AXES: Final = ("x", "y", "z")
"""Names of the axes of space; a plane has the first two."""

STATE_NAMES: Final = ("free", "mixed", "blocked")
"""Names of the states, in the order of their values."""

MAX_EXPECTED_ANGLE: Final = math.tau * (1.0 + 0.01)
"""Largest angle, in radians, that is not suspected to be in degrees.

It exceeds a whole turn, because files have few digits.
"""


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    array.setflags(write=False)
    return array


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only view of an array."""
    return frozen(np.ascontiguousarray(array).view())


def count_states(states: States) -> Ints:
    """Count each slice's FREE, MIXED and BLOCKED cells, shape (slices, 3)."""
    counts = np.zeros((len(states), 3), dtype=np.int64)
    for number, cells in enumerate(states):
        # A comparison and a count take a tenth of the time of np.bincount, and need memory.
        for part in np.array_split(cells.reshape(-1), 1 + cells.size // 2**24):
            counts[number] += [np.count_nonzero(part == kind) for kind in (FREE, MIXED, BLOCKED)]
    return counts


def find_box(cells: Bools) -> tuple[slice, ...]:
    """Return the smallest box of an array that holds all set cells; empty if none is set."""
    box = []
    for axis in range(cells.ndim):
        other_axes = tuple(k for k in range(cells.ndim) if k != axis)
        taken = np.flatnonzero(cells.any(axis=other_axes))
        box.append(slice(int(taken[0]), int(taken[-1]) + 1) if len(taken) else slice(0, 0))
    return tuple(box)


def number_parts(counts: Ints) -> tuple[Ints, Ints]:
    """Return the owner of each of several parts, and its number among those of the owner."""
    owners = np.repeat(np.arange(len(counts)), counts)
    return owners, np.arange(len(owners)) - (np.cumsum(counts) - counts)[owners]


def reduce_blocks(
    cells: NDArray[Cell], blocks: int | Sequence[Ints], combine: np.ufunc = np.maximum
) -> NDArray[Cell]:
    """Return the maximum of each block of cells.

    ``blocks`` is the side of all blocks, in cells, or has the first cells of the blocks along each
    axis, ascending from 0. ``combine`` may be another ufunc, such as ``np.minimum``.
    """
    if isinstance(blocks, int):
        starts: Sequence[Ints] = [np.arange(0, n, blocks) for n in cells.shape]
    else:
        starts = blocks
    # Combine the k-th cells of all blocks for each k. That is twenty times faster than
    # ``reduceat``, which goes block by block.
    for axis, first in enumerate(starts):
        last = np.append(first[1:], cells.shape[axis]) - 1
        longest = int((last - first).max())
        reduced = cells.take(first, axis)
        for step in range(1, longest + 1):
            member = np.minimum(first + step, last)
            combine(reduced, cells.take(member, axis), out=reduced)
        cells = reduced
    return cells


def intersect_boxes(box: Sequence[slice], other: Sequence[slice]) -> tuple[Box, Box]:
    """Return the intersection of two boxes, relative to each box's first cell."""
    # Along each axis, it is from the later start to the earlier stop.
    in_box = list[slice]()
    in_other = list[slice]()
    for a, b in zip(box, other, strict=True):
        low = max(a.start, b.start)
        high = min(a.stop, b.stop)
        in_box.append(slice(low - a.start, high - a.start))
        in_other.append(slice(low - b.start, high - b.start))
    return tuple(in_box), tuple(in_other)

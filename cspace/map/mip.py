"""A coarse map beside the map: blocks of cells, each with whether a cell in it is not FREE.

An edge that keeps to blocks of FREE cells need not be walked cell by cell, and a coarse map is so small that it stays
in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit, reader
from cspace.map.kept import Change
from cspace.map.storage import Stack, read_only
from cspace.states import FREE
from cspace.threads import in_chunks

States = NDArray[np.uint8]
Ints = NDArray[np.int64]

SHIFT: Final = 3

SIDE: Final = 1 << SHIFT
"""Cells along each side of a block; a power of two, so that a cell's block is a shift away."""

CELLS_AN_EDGE: Final = 4_000
"""Cells of a map for each edge that is asked about, below which a coarse map pays; making it takes some hundredths of a
nanosecond for each cell, and it saves a few hundred nanoseconds for each edge."""

CELLS_A_THREAD: Final = 10_000_000
"""Cells below which a second thread costs more than it saves."""


@reader
def depth_of(count: int) -> int:
    """Blocks that are kept for a row of cells: so many that each row of blocks begins with a word of eight."""
    return (count + SIDE * SIDE - 1) >> (2 * SHIFT) << SHIFT


class Mip:
    """The coarse map of all slices.

    Parameters
    ----------
    states : ndarray of uint8, or PackedStates, shape (slices, nx, ny) or (slices, nx, ny, nz)
        In one piece, in C order; kept, not copied.

    Attributes
    ----------
    blocks : ndarray of uint8, shape (slices, ceil(nx / SIDE), ceil(ny / SIDE), depth_of(nz))
        Zero where all cells of a block are FREE; the plane has one layer of blocks before the others.
    nodes : ndarray of uint8
        The same of blocks of these blocks.
    """

    def __init__(self, states: Stack) -> None:
        self._states, self._shape = states, (*(1,) * (4 - states.ndim), *states.shape[1:])
        self.blocks = blocks_of((len(states), *self._shape))
        self.nodes = blocks_of(self.blocks.shape)
        last = [n - 1 for n in self._shape]
        self._mark(np.array([[0, 0, 0, *last]] * len(states), dtype=np.int64))

    def renew(self, change: Change) -> None:
        """Mark the blocks again in which a state has changed."""
        self._mark(change.states)

    @property
    def words(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """The blocks and the nodes, eight along the last axis in a word, not to be written."""
        return read_only(self.blocks.view(np.uint64)), read_only(self.nodes.view(np.uint64))

    @property
    def flat(self) -> States:
        """The blocks in a row, not to be written."""
        return read_only(self.blocks.reshape(-1))

    def _mark(self, boxes: Ints) -> None:
        by_rows(mark_blocks, self._states, self._shape, self.blocks, boxes)
        empty = (boxes[:, :3] > boxes[:, 3:]).any(axis=1, keepdims=True)
        by_rows(mark_blocks, self.blocks, self.blocks.shape[1:], self.nodes, np.where(empty, boxes, boxes >> SHIFT))


class Bits:
    """A bit for each cell: whether it is not FREE.

    Parameters
    ----------
    states : ndarray of uint8, or PackedStates, shape (slices, nx, ny) or (slices, nx, ny, nz)
        In one piece, in C order; kept, not copied.

    Attributes
    ----------
    words : ndarray of uint64, shape (*blocks, 1) or (*blocks, SIDE)
        For each block of :class:`Mip`, and each of its layers, a byte for each cell along z, in which there is a bit
        for each one along y.
    """

    def __init__(self, states: Stack) -> None:
        self._states, self._shape = states, (*(1,) * (4 - states.ndim), *states.shape[1:])
        last = [n - 1 for n in self._shape]
        blocks = blocks_of((len(states), *self._shape))
        self.words = np.zeros((*blocks.shape, SIDE if last[0] else 1), dtype=np.uint64)
        self._set(np.array([[0, 0, 0, *last]] * len(states), dtype=np.int64))

    def renew(self, change: Change) -> None:
        """Set the bits again where a state has changed."""
        self._set(change.states)

    def _set(self, boxes: Ints) -> None:
        by_rows(set_bits, self._states, self._shape, self.words, boxes)


def blocks_of(shape: tuple[int, ...]) -> States:
    """Room for the blocks of cells, given their shape (slices, nx, ny, nz), all FREE."""
    slices, nx, ny, nz = shape
    return np.zeros((slices, -(-nx // SIDE), -(-ny // SIDE), depth_of(nz)), dtype=np.uint8)


def by_rows(work: Callable[..., None], states: Stack, shape: tuple[int, ...], into: NDArray[Any], boxes: Ints) -> None:
    """Do :func:`mark_blocks` or :func:`set_bits` of all rows of blocks that boxes touch, one a slice, in threads."""
    touched = np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1))
    if not len(touched):
        return
    sides = (boxes[touched, 3:] >> SHIFT) - (boxes[touched, :3] >> SHIFT) + 1
    rows, count = int(sides[:, :2].prod(axis=1).max()), int(sides.prod(axis=1).sum()) << 3 * SHIFT

    def do(cells: States, part: NDArray[Any], its: Ints) -> None:
        def some(start: int, stop: int) -> int:
            work(cells, part, its, start, stop)
            return -1

        in_chunks(some, rows, least=max(1, rows * CELLS_A_THREAD // count))

    if isinstance(states, np.ndarray):
        do(states.reshape(len(states), *shape), into, boxes)
    else:
        for s in touched.tolist():
            do(states[s].reshape(1, *shape), into[s : s + 1], boxes[s : s + 1])


@jit
def mark_blocks(states: States, blocks: States, boxes: Ints, start: int, stop: int) -> None:
    """Mark the blocks that a box of cells in each slice touches by whether a cell in them is not FREE, which is zero.

    A box is given by its first cell and its last one, along three axes; there is none where one is beyond the other.
    Its rows of blocks along the last axis are numbered, and those from ``start`` to before ``stop`` are marked.
    """
    line = np.empty((states.shape[3] + SIDE * SIDE) >> SHIFT << SHIFT, np.uint8)
    for s in range(len(boxes)):
        mark_slice(states[s], blocks[s], boxes[s], line, start, stop)


@inner
def rows_of(box: Ints, depth: int) -> tuple[int, int, int, int]:
    """How many rows of blocks a box of cells touches, how many of them along y, and which cells along z."""
    columns = (box[4] >> SHIFT) - (box[1] >> SHIFT) + 1
    rows = ((box[3] >> SHIFT) - (box[0] >> SHIFT) + 1) * columns
    low, high = (box[2] >> SHIFT) << SHIFT, min(((box[5] >> SHIFT) + 1) << SHIFT, depth)
    return rows if box[0] <= box[3] and box[1] <= box[4] and box[2] <= box[5] else 0, columns, low, high


@inner
def mark_slice(state: States, blocks: States, box: Ints, room: States, start: int, stop: int) -> None:
    """The same of one slice."""
    rows, columns, low, high = rows_of(box, state.shape[2])
    first_a, first_b = box[0] >> SHIFT, box[1] >> SHIFT
    line = room[: ((high - low + SIDE - 1) >> SHIFT) << SHIFT]
    for row in range(start, min(stop, rows)):
        a, b = first_a + row // columns, first_b + row % columns
        # All columns of cells of these blocks are united into one, in wide instructions, and that one is then cut.
        line[:] = 0
        for i in range(a << SHIFT, min((a + 1) << SHIFT, state.shape[0])):
            for j in range(b << SHIFT, min((b + 1) << SHIFT, state.shape[1])):
                unite(line, state[i, j, low:high])
        marks = blocks[a, b, (low >> SHIFT) :]
        for block in range(line.shape[0] >> SHIFT):
            mark = np.uint8(0)
            for k in range(SIDE):
                mark |= line[(block << SHIFT) + k]
            marks[block] = mark


@jit
def unite(into: States, cells: States) -> None:
    """Set the bits of some bytes in others."""
    for k in range(cells.shape[0]):
        into[k] |= cells[k]


@jit
def set_bits(states: States, words: NDArray[np.uint64], boxes: Ints, start: int, stop: int) -> None:
    """Set the words of the blocks that a box of cells in each slice touches; as :func:`mark_blocks`."""
    line = np.empty((states.shape[3] + SIDE * SIDE) >> SHIFT << SHIFT, np.uint8)
    for s in range(len(boxes)):
        set_slice(states[s], words[s], boxes[s], line, start, stop)


@inner
def set_slice(state: States, words: NDArray[np.uint64], box: Ints, room: States, start: int, stop: int) -> None:
    """The same of one slice."""
    rows, columns, low, high = rows_of(box, state.shape[2])
    first_a, first_b = box[0] >> SHIFT, box[1] >> SHIFT
    line = room[: ((high - low + SIDE - 1) >> SHIFT) << SHIFT]
    for row in range(start, min(stop, rows)):
        a, b = first_a + row // columns, first_b + row % columns
        for i in range(a << SHIFT, min((a + 1) << SHIFT, state.shape[0])):
            line[:] = 0
            for j in range(b << SHIFT, min((b + 1) << SHIFT, state.shape[1])):
                add_bit(line, state[i, j, low:high], np.uint8(1 << (j % SIDE)))
            eights = line.view(np.uint64)
            for block in range(len(eights)):
                words[a, b, (low >> SHIFT) + block, i % SIDE] = eights[block]


@jit
def add_bit(into: States, cells: States, bit: np.uint8) -> None:
    """Set a bit of the bytes whose cells are not FREE."""
    for k in range(cells.shape[0]):
        into[k] |= bit if cells[k] != FREE else np.uint8(0)

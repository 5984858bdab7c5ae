"""Bit marks of non-FREE cells at three scales.

With them, an edge through blocks of FREE cells is not walked cell by cell, and the nearest cell that is not FREE is
searched in marked blocks only. Positions are along three axes; the plane is space with one layer of cells.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import FREE, Ints, States, Words
from cspace.compiling import kernel
from cspace.map.derived import Lock
from cspace.map.storage import Stack, read_only
from cspace.rotations.records import always_inline, dispatch_on_type
from cspace.threads import in_chunks

BLOCK_SHIFT: Final = 3
"""Binary logarithm of :data:`BLOCK_SIDE`."""

BLOCK_SIDE: Final = 1 << BLOCK_SHIFT
"""Cells along each side of a block, and blocks along each side of a node."""

ROWS_PER_BLOCK_ROW: Final = BLOCK_SIDE + 1
"""Rows of bits in the plane for each row of blocks: eight rows of cells and one of blocks."""

MAX_CELLS_PER_EDGE: Final = 4_000
"""Cells of a map, for each edge of a query, below which marks pay. They cost some hundredths of a nanosecond a cell and
save a few hundred nanoseconds an edge."""

MIN_MARKED_CELLS_PER_THREAD: Final = 10_000_000
"""Number of cells below which a second thread costs more than it saves."""

MIN_BOX_PIECES: Final = 64
"""Minimum number of pieces into which boxes are cut for threads."""

SIDE_MASK: Final = BLOCK_SIDE - 1

NO_BIT, ONE, LOW_BYTE = np.uint64(0), np.uint64(1), np.uint64(255)

MAX_DIRTY_BOXES: Final = 32
"""Changes recorded separately; beyond that number, their bounding box is."""


class SpaceMarks(NamedTuple):
    """Marks of non-FREE cells in space, for kernels.

    A word has 8 x 8 bits: a byte for each position along z, and in it a bit for each position along y.

    Attributes
    ----------
    cells : ndarray of uint64, shape (*number of blocks along each axis of (slices, x, y, z), layers)
        A bit for each cell; a word for each of the 8 layers of cells in a block. Empty until needed.
    blocks : ndarray of uint64, shape (*number of nodes, layers)
        A bit for each block, in the same order: set if any cell of the block is marked.
    nodes : ndarray of uint64
        A byte for each node, eight along the last axis in a word: non-zero if any block of the node is marked.
    """

    cells: Words
    blocks: Words
    nodes: Words


class PlaneMarks(NamedTuple):
    """Marks of non-FREE cells in the plane.

    This is a separate type so that no kernel is compiled for both.

    Attributes
    ----------
    cells : ndarray of uint64, shape (slices, y, words)
        Rows of bits along z, with a word of zeros before and behind: eight rows of cells, then the row of their blocks,
        and so on. Empty until needed.
    blocks, nodes : ndarray of uint64
        As in :class:`SpaceMarks`, with one layer.
    """

    cells: Words
    blocks: Words
    nodes: Words


OccupancyBits = SpaceMarks | PlaneMarks

_MARKS_BY_NDIM: Final[dict[int, tuple[type[OccupancyBits], int]]] = {3: (PlaneMarks, 1), 4: (SpaceMarks, BLOCK_SIDE)}
"""Type of the marks and number of layers of their words, by the number of axes of the states."""


class OccupancyPyramid:
    """Marks of all slices, refreshed by :meth:`marks`.

    The states, contiguous in C order, are shared, not copied. The lock is held while they change, and while marks are
    updated.
    """

    def __init__(self, states: Stack, lock: Lock) -> None:
        self._states, self._lock = states, lock
        self._shape = (*(1,) * (4 - states.ndim), *states.shape[1:])
        self._blocks_shape = tuple(-(-n // BLOCK_SIDE) for n in self._shape)
        nodes = tuple(-(-n // BLOCK_SIDE) for n in self._blocks_shape)
        self._kind, layers = _MARKS_BY_NDIM[states.ndim]
        rows = ROWS_PER_BLOCK_ROW * self._blocks_shape[1], -(-self._shape[2] // 64) + 2
        self._cells_shape = (len(states), *((*self._blocks_shape, layers) if layers > 1 else rows))
        self._cells = np.zeros((0,) * len(self._cells_shape), dtype=np.uint64)
        self._blocks = np.zeros((len(states), *nodes, layers), dtype=np.uint64)
        self._nodes = np.zeros((len(states), *nodes[:2], -(-nodes[2] // BLOCK_SIDE) * BLOCK_SIDE), dtype=np.uint8)
        self._dirty_boxes, self._eager = [self._whole()], False

    def refresh(self, boxes: Ints) -> None:
        """Record boxes of changed states, shape (slices, 6)."""
        self._dirty_boxes.append(boxes)
        if len(self._dirty_boxes) > MAX_DIRTY_BOXES:
            dirty = np.array(self._dirty_boxes)
            self._dirty_boxes = [np.concatenate([dirty[..., :3].min(axis=0), dirty[..., 3:].max(axis=0)], axis=1)]
        if self._eager:
            self._flush()

    def marks(self, cells: bool, eager: bool = False) -> OccupancyBits:
        """Return the current marks; ``eager`` ones follow changes.

        Marks of single cells are included if ``cells`` is True.
        """
        if self._dirty_boxes or cells > bool(self._cells.size) or eager > self._eager:
            with self._lock:
                if cells and not self._cells.size:
                    self._cells = np.zeros(self._cells_shape, dtype=np.uint64)
                    self._dirty_boxes = [self._whole()]
                self._eager |= eager
                self._flush()
        return self._kind(*map(read_only, (self._cells, self._blocks, self._nodes.view(np.uint64))))

    def _whole(self) -> Ints:
        """Return the box of all cells for each slice."""
        return np.array([[0, 0, 0, *(n - 1 for n in self._shape)]] * len(self._states), dtype=np.int64)

    def _flush(self) -> None:
        """Mark all dirty boxes; an error leaves them dirty."""
        for boxes in self._dirty_boxes:
            self._mark(boxes)
        self._dirty_boxes = []

    def _mark(self, boxes: Ints) -> None:
        """Mark the boxes of all slices."""
        if isinstance(self._states, np.ndarray):
            self._mark_slices(self._states, slice(None), boxes)
        else:  # unpack one slice at a time
            for s in np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1)).tolist():
                self._mark_slices(self._states[s], slice(s, s + 1), boxes)

    def _mark_slices(self, states: States, part: slice, boxes: Ints) -> None:
        """Mark boxes of slices, in threads if that pays."""
        states = read_only(states.reshape(-1, *self._shape))
        marks = self._kind(self._cells[part], self._blocks[part], self._nodes[part].view(np.uint64))
        rows = np.flatnonzero((boxes[part, :3] <= boxes[part, 3:]).all(axis=1))
        if not len(rows):
            return
        parts = boxes[part][rows]
        size = float(np.prod(parts[:, 3:] - parts[:, :3] + BLOCK_SIDE, axis=1).sum())
        # Boxes are cut along y, between nodes, because threads must not share nodes.
        cuts = 1 if size < MIN_MARKED_CELLS_PER_THREAD else -(-MIN_BOX_PIECES // len(rows))
        parts, piece = np.repeat(np.column_stack([rows, parts]), cuts, axis=0), np.tile(np.arange(cuts), len(rows))
        first, last = parts[:, 2] >> 2 * BLOCK_SHIFT, parts[:, 5] >> 2 * BLOCK_SHIFT
        low, stop = (first + (last + 1 - first) * (piece + end) // cuts << 2 * BLOCK_SHIFT for end in (0, 1))
        parts[:, 2], parts[:, 5] = np.maximum(parts[:, 2], low), np.minimum(parts[:, 5], stop - 1)

        def mark_parts(start: int, stop: int) -> int:
            line = np.zeros(self._blocks_shape[2], dtype=np.uint64)
            mark_boxes(states, marks, (line.view(np.uint8), line, line.copy()), parts[start:stop])
            return -1

        in_chunks(mark_parts, len(parts), min_items=1 + int(len(parts) * MIN_MARKED_CELLS_PER_THREAD / max(size, 1.0)))
        touched = (
            slice(None),
            *map(
                slice, parts[:, 1:4].min(axis=0) >> 2 * BLOCK_SHIFT, (parts[:, 4:].max(axis=0) >> 2 * BLOCK_SHIFT) + 1
            ),
        )
        self._nodes[part][touched] = marks.blocks[touched].any(axis=-1)


@always_inline
def transpose_bits(word: np.uint64) -> np.uint64:
    """Transpose the bits of eight bytes.

    Bit i of byte k becomes bit k of byte i. Source: Warren, Hacker's Delight, 2012.
    """
    for shift, mask in ((7, 0x00AA00AA00AA00AA), (14, 0x0000CCCC0000CCCC), (28, 0x00000000F0F0F0F0)):
        swap = (word ^ (word >> np.uint64(shift))) & np.uint64(mask)
        word ^= swap ^ (swap << np.uint64(shift))
    return word


def mark_layer(marks: OccupancyBits, s: int, i: int, b: int, first: int, depth: int, words: Words) -> None:
    """Mark a layer of cells in blocks along z."""
    raise NotImplementedError


def _mark_layer_in_space(marks: SpaceMarks, s: int, i: int, b: int, first: int, depth: int, words: Words) -> None:
    for c in range(depth):
        marks.cells[s, i >> BLOCK_SHIFT, b, first + c, i & SIDE_MASK] = words[c]


def _mark_layer_in_plane(marks: PlaneMarks, s: int, i: int, b: int, first: int, depth: int, words: Words) -> None:
    for c in range(depth):
        z, word = first + c, transpose_bits(words[c])
        put_bits(marks.cells[s, ROWS_PER_BLOCK_ROW * b + BLOCK_SIDE], z, ONE, ONE if word != 0 else NO_BIT)
        for j in range(ROWS_PER_BLOCK_ROW * b, ROWS_PER_BLOCK_ROW * b + BLOCK_SIDE):
            put_bits(marks.cells[s, j], z << BLOCK_SHIFT, LOW_BYTE, word & LOW_BYTE)
            word >>= np.uint64(BLOCK_SIDE)


dispatch_on_type(mark_layer, {SpaceMarks: _mark_layer_in_space, PlaneMarks: _mark_layer_in_plane})


@kernel
def mark_boxes(states: States, marks: OccupancyBits, scratch: tuple[States, Words, Words], boxes: Ints) -> None:
    """Mark the blocks that boxes touch.

    See :class:`SpaceMarks`. A box, shape (7,), has its slice, first cell and last cell, along three axes; it is empty
    if first > last. Each mark is written once, cells first. Threads may take boxes that share no node. ``scratch`` has
    a row of blocks along z as bytes, the same memory as words, and as many words again.
    """
    nx, ny, nz = states.shape[1], states.shape[2], states.shape[3]
    line, words, marked = scratch
    for n in range(len(boxes)):
        box = boxes[n]
        s, first, n_blocks = box[0], box[3] >> BLOCK_SHIFT, (box[6] >> BLOCK_SHIFT) - (box[3] >> BLOCK_SHIFT) + 1
        low, high = first << BLOCK_SHIFT, min((first + n_blocks) << BLOCK_SHIFT, nz)
        for a in range(box[1] >> BLOCK_SHIFT, (box[4] >> BLOCK_SHIFT) + 1):
            for b in range(box[2] >> BLOCK_SHIFT, (box[5] >> BLOCK_SHIFT) + 1):
                marked[:] = 0
                for i in range(a << BLOCK_SHIFT, min((a + 1) << BLOCK_SHIFT, nx)):
                    line[:] = 0
                    for j in range(b << BLOCK_SHIFT, min((b + 1) << BLOCK_SHIFT, ny)):
                        add_bit(line, states[s, i, j, low:high], np.uint8(1 << (j & SIDE_MASK)))
                    for c in range(n_blocks):
                        marked[c] |= words[c]
                    if len(marks.cells) > 0:
                        mark_layer(marks, s, i, b, first, n_blocks, words)
                layer = marks.blocks[s, a >> BLOCK_SHIFT, b >> BLOCK_SHIFT, :, a & SIDE_MASK]
                for c in range(n_blocks):
                    z = first + c
                    bit = ONE << np.uint64(((z & SIDE_MASK) << BLOCK_SHIFT) + (b & SIDE_MASK))
                    word = layer[z >> BLOCK_SHIFT]
                    layer[z >> BLOCK_SHIFT] = word | bit if marked[c] != 0 else word & ~bit


@kernel
def put_bits(row: Words, index: int, mask: np.uint64, bits: np.uint64) -> None:
    """Replace bits within one word of a row."""
    shift = np.uint64(index & 63)
    row[(index >> 6) + 1] = (row[(index >> 6) + 1] & ~(mask << shift)) | bits << shift


@kernel
def add_bit(into: States, cells: States, bit: np.uint8) -> None:
    """Set a bit in bytes whose cell is not FREE."""
    for k in range(cells.shape[0]):
        into[k] |= bit if cells[k] != FREE else np.uint8(0)

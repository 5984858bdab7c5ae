"""Marks beside the map: bits for what is not FREE, at three scales.

An edge through blocks of FREE cells need not be walked cell by cell, and the nearest cell that is not FREE is searched
in marked blocks alone. Places are counted along three axes; the plane is space with one layer of cells.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import FREE, Ints, States, Words
from cspace.compiling import always_inline, dispatch_on_type, kernel
from cspace.map.derived import Lock
from cspace.map.storage import Stack, read_only
from cspace.threads import in_chunks

SHIFT: Final = 3

SIDE: Final = 1 << SHIFT
"""Cells along each side of a block, and blocks along each side of a node; a power of two, so that they are a shift
away."""

ROWS: Final = SIDE + 1
"""Rows of bits of the plane from one row of blocks to the next."""

CELLS_AN_EDGE: Final = 4_000
"""Cells of a map for each edge of a look-up, below which marks pay; making them takes some hundredths of a
nanosecond for each cell, and they save a few hundred nanoseconds for each edge."""

CELLS_A_THREAD: Final = 10_000_000
"""Cells below which a second thread costs more than it saves."""

PIECES: Final = 64
"""Parts that a map is marked in by threads, at least."""

LAST: Final = SIDE - 1

ZERO, ONE, BYTE = np.uint64(0), np.uint64(1), np.uint64(255)

MOST_NOTED: Final = 32
"""Changes that are noted one by one; of more, the box around all is."""


class SpaceMarks(NamedTuple):
    """What is not FREE in space, at three scales, as compiled code takes it; not to be written.

    A word has 8 x 8 bits, a byte for each place along z, and in it a bit for each one along y.

    Attributes
    ----------
    cells : ndarray of uint64, shape (*number of blocks along each axis of (slices, x, y, z), layers)
        A bit for each cell; a word for each of the 8 layers of cells in a block. Of size 0 until they are needed.
    blocks : ndarray of uint64, shape (*number of nodes, layers)
        A bit for each block, alike: whether one of its cells is marked.
    nodes : ndarray of uint64
        A byte for each node, eight along the last axis in a word: whether one of its blocks is marked.
    """

    cells: Words
    blocks: Words
    nodes: Words


class PlaneMarks(NamedTuple):
    """The same in the plane, which is one layer: of another type, so that neither is compiled for both.

    Attributes
    ----------
    cells : ndarray of uint64, shape (slices, y, words)
        Rows of bits along z, between a word of zeros before and behind: eight rows of cells, and the row of their
        blocks, and so on. Of size 0 until they are needed.
    blocks, nodes : ndarray of uint64
    """

    cells: Words
    blocks: Words
    nodes: Words


OccupancyBits = SpaceMarks | PlaneMarks

_KINDS: Final[dict[int, tuple[type[OccupancyBits], int]]] = {3: (PlaneMarks, 1), 4: (SpaceMarks, SIDE)}
"""The kind of the marks of a map, by the number of axes of its states, and how many layers its words have."""


class OccupancyPyramid:
    """The marks of all slices. Changes are noted, and followed at the next call of :meth:`marks`.

    The states, in one piece, in C order, are shared, not copied; the lock is held while they change, and while the
    marks follow.
    """

    def __init__(self, states: Stack, lock: Lock) -> None:
        self._states, self._lock = states, lock
        self._shape = (*(1,) * (4 - states.ndim), *states.shape[1:])
        self._blocks_shape = tuple(-(-n // SIDE) for n in self._shape)
        nodes = tuple(-(-n // SIDE) for n in self._blocks_shape)
        self._kind, layers = _KINDS[states.ndim]
        rows = ROWS * self._blocks_shape[1], -(-self._shape[2] // 64) + 2
        self._cells_shape = (len(states), *((*self._blocks_shape, layers) if layers > 1 else rows))
        self._cells = np.zeros((0,) * len(self._cells_shape), dtype=np.uint64)
        self._blocks = np.zeros((len(states), *nodes, layers), dtype=np.uint64)
        self._nodes = np.zeros((len(states), *nodes[:2], -(-nodes[2] // SIDE) * SIDE), dtype=np.uint8)
        self._noted, self._eager = [self._whole()], False

    def refresh(self, boxes: Ints) -> None:
        """Note the box in which states of each slice have changed, shape (slices, 6)."""
        self._noted.append(boxes)
        if len(self._noted) > MOST_NOTED:
            noted = np.array(self._noted)
            self._noted = [np.concatenate([noted[..., :3].min(axis=0), noted[..., 3:].max(axis=0)], axis=1)]
        if self._eager:
            self._follow()

    def marks(self, cells: bool, eager: bool = False) -> OccupancyBits:
        """The marks as of now, with those of ``cells`` or not; ``eager`` ones follow each change at once."""
        if self._noted or cells > bool(self._cells.size) or eager > self._eager:
            with self._lock:
                if cells and not self._cells.size:
                    self._cells = np.zeros(self._cells_shape, dtype=np.uint64)
                    self._noted = [self._whole()]
                self._eager |= eager
                self._follow()
        return self._kind(*map(read_only, (self._cells, self._blocks, self._nodes.view(np.uint64))))

    def _whole(self) -> Ints:
        return np.array([[0, 0, 0, *(n - 1 for n in self._shape)]] * len(self._states), dtype=np.int64)

    def _follow(self) -> None:
        """Mark what has changed; it stays noted until all is done."""
        for boxes in self._noted:
            self._mark(boxes)
        self._noted = []

    def _mark(self, boxes: Ints) -> None:
        if isinstance(self._states, np.ndarray):
            self._mark_of(self._states, slice(None), boxes)
        else:  # bytes are made of some slices at a time
            for s in np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1)).tolist():
                self._mark_of(self._states[s], slice(s, s + 1), boxes)

    def _mark_of(self, states: States, part: slice, boxes: Ints) -> None:
        """Mark a part of the slices, in threads where that pays."""
        states = read_only(states.reshape(-1, *self._shape))
        marks = self._kind(self._cells[part], self._blocks[part], self._nodes[part].view(np.uint64))
        rows = np.flatnonzero((boxes[part, :3] <= boxes[part, 3:]).all(axis=1))
        if not len(rows):
            return
        its = boxes[part][rows]
        size = float(np.prod(its[:, 3:] - its[:, :3] + SIDE, axis=1).sum())
        # Each box is cut along y, between nodes, into as many pieces as threads may want.
        cuts = 1 if size < CELLS_A_THREAD else -(-PIECES // len(rows))
        its, number = np.repeat(np.column_stack([rows, its]), cuts, axis=0), np.tile(np.arange(cuts), len(rows))
        first, last = its[:, 2] >> 2 * SHIFT, its[:, 5] >> 2 * SHIFT
        low, stop = (first + (last + 1 - first) * (number + end) // cuts << 2 * SHIFT for end in (0, 1))
        its[:, 2], its[:, 5] = np.maximum(its[:, 2], low), np.minimum(its[:, 5], stop - 1)

        def work(start: int, stop: int) -> int:
            line = np.zeros(self._blocks_shape[2], dtype=np.uint64)
            mark(states, marks, (line.view(np.uint8), line, line.copy()), its[start:stop])
            return -1

        in_chunks(work, len(its), min_items=1 + int(len(its) * CELLS_A_THREAD / max(size, 1.0)))
        every = (
            slice(None),
            *map(slice, its[:, 1:4].min(axis=0) >> 2 * SHIFT, (its[:, 4:].max(axis=0) >> 2 * SHIFT) + 1),
        )
        self._nodes[part][every] = marks.blocks[every].any(axis=-1)


@always_inline
def flipped(word: np.uint64) -> np.uint64:
    """The bits of eight bytes, bit i of byte k as bit k of byte i (Warren, Hacker's Delight, 2012)."""
    for shift, mask in ((7, 0x00AA00AA00AA00AA), (14, 0x0000CCCC0000CCCC), (28, 0x00000000F0F0F0F0)):
        swap = (word ^ (word >> np.uint64(shift))) & np.uint64(mask)
        word ^= swap ^ (swap << np.uint64(shift))
    return word


def mark_layer(marks: OccupancyBits, s: int, i: int, b: int, first: int, depth: int, eights: Words) -> None:
    """Mark the cells of a layer, in blocks that follow each other along z, by each word of the bits."""
    raise NotImplementedError


def _mark_layer_in_space(marks: SpaceMarks, s: int, i: int, b: int, first: int, depth: int, eights: Words) -> None:
    for c in range(depth):
        marks.cells[s, i >> SHIFT, b, first + c, i & LAST] = eights[c]


def _mark_layer_in_plane(marks: PlaneMarks, s: int, i: int, b: int, first: int, depth: int, eights: Words) -> None:
    for c in range(depth):
        z, eight = first + c, flipped(eights[c])
        put(marks.cells[s, ROWS * b + SIDE], z, ONE, ONE if eight != 0 else ZERO)
        for j in range(ROWS * b, ROWS * b + SIDE):
            put(marks.cells[s, j], z << SHIFT, BYTE, eight & BYTE)
            eight >>= np.uint64(SIDE)


dispatch_on_type(mark_layer, {SpaceMarks: _mark_layer_in_space, PlaneMarks: _mark_layer_in_plane})


@kernel
def mark(states: States, marks: OccupancyBits, room: tuple[States, Words, Words], boxes: Ints) -> None:
    """Mark what boxes of cells touch; see :class:`SpaceMarks`.

    ``room`` is for its own use: a row of blocks along z, as bytes and as the same words, and as many words again.

    A box, shape (7,), is given by its slice, its first cell and its last one, along three axes; there is none where one
    is above the other. Each mark is written once, those of cells first; threads may take boxes that share no node.
    """
    nx, ny, nz = states.shape[1], states.shape[2], states.shape[3]
    line, eights, met = room
    for n in range(len(boxes)):
        box = boxes[n]
        s, first, depth = box[0], box[3] >> SHIFT, (box[6] >> SHIFT) - (box[3] >> SHIFT) + 1
        low, high = first << SHIFT, min((first + depth) << SHIFT, nz)
        for a in range(box[1] >> SHIFT, (box[4] >> SHIFT) + 1):
            for b in range(box[2] >> SHIFT, (box[5] >> SHIFT) + 1):
                met[:] = 0
                for i in range(a << SHIFT, min((a + 1) << SHIFT, nx)):
                    line[:] = 0
                    for j in range(b << SHIFT, min((b + 1) << SHIFT, ny)):
                        add_bit(line, states[s, i, j, low:high], np.uint8(1 << (j & LAST)))
                    for c in range(depth):
                        met[c] |= eights[c]
                    if len(marks.cells) > 0:
                        mark_layer(marks, s, i, b, first, depth, eights)
                layer = marks.blocks[s, a >> SHIFT, b >> SHIFT, :, a & LAST]
                for c in range(depth):
                    z = first + c
                    bit = ONE << np.uint64(((z & LAST) << SHIFT) + (b & LAST))
                    word = layer[z >> SHIFT]
                    layer[z >> SHIFT] = word | bit if met[c] != 0 else word & ~bit


@kernel
def put(row: Words, number: int, mask: np.uint64, bits: np.uint64) -> None:
    """Replace bits of a row, from the one of a number on; they lie in one word."""
    shift = np.uint64(number & 63)
    row[(number >> 6) + 1] = (row[(number >> 6) + 1] & ~(mask << shift)) | bits << shift


@kernel
def add_bit(into: States, cells: States, bit: np.uint8) -> None:
    """Set a bit of the bytes whose cells are not FREE."""
    for k in range(cells.shape[0]):
        into[k] |= bit if cells[k] != FREE else np.uint8(0)

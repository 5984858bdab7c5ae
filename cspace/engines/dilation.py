"""The engine by dilation: a workspace bitmap dilated by robot rasters, 64 cells a word, in integers.

For every cell k of the map: whether ``W[k + m]`` is set for any offset m of the robot. The offsets are taken as runs
along the last axis. A bitmap in which bit k tells whether any of the ``L`` cells from k on is set serves all runs of
length L; it is made from that for the next shorter length with one shift. Each run then costs one shift of this bitmap
to the robot's place. So the work is cells / 64 times (runs + lengths), whatever the number of offsets.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cspace.engines.packed import Packed, Scratch, runs_of, settle_block
from cspace.raster.raster import Raster
from cspace.threads import cores, in_threads

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Cells = NDArray[np.uint8]
Task: TypeAlias = tuple[Ints, Cells, tuple[int, int]]

COUNTS: Final = False
"""This engine tells only whether there is any overlap."""

PACKED: Final = 2**20
"""Cells that are packed into words at a time."""

WORD: Final = 64
"""Cells in a word."""

OCTET: Final = 8
"""Cells in a byte."""

BLOCK: Final = 2**14
"""Words of results that are made together, at least: with what they are made from they fit a core's cache."""

TASKS: Final = 16
"""Parts of the work that each thread should have, for all to end at about the same time."""

LEAST: Final = 2_000_000
"""Words times runs below which a second thread costs more than it saves."""


def collide(
    occupied: Bools,
    rasters: Sequence[Raster],
    out: Sequence[NDArray[Any]],
    *,
    outside: bool,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> str:
    """Dilate one bitmap by several rasters; see :class:`cspace.engines.Engine`. Small work takes one thread."""
    shape = in_space(occupied.shape)
    live: list[tuple[Runs, Cells]] = []
    for raster, result in zip(rasters, out, strict=True):
        runs = Runs.of(raster, shape)
        if len(runs) and not (outside and runs.clipped):
            live.append((runs, result.reshape(shape).view(np.uint8)))
        elif add:
            result += np.uint8(outside and runs.clipped)
        else:
            result[...] = outside and runs.clipped
    if not live:
        return "integer"
    board = Board(np.ascontiguousarray(occupied).reshape(shape).view(np.uint8), [runs for runs, _ in live], outside)
    tasks: list[Task] = []
    for runs, view in live:
        table = board.placed(runs)
        tasks += [(table, view, block) for block in board.blocks(table)]
    work = sum(len(table) * (last - first) * board.cells for table, _, (first, last) in tasks) // WORD
    threads = (workers or cores()) if work >= LEAST else 1
    parts = min(len(tasks), TASKS * threads)
    groups = [tasks[len(tasks) * k // parts : len(tasks) * (k + 1) // parts] for k in range(parts)]
    advance = None if progress is None else partial(_advance, progress, parts)
    in_threads(partial(board.settle, add), groups, threads, advance)
    return "integer"


def bytes_needed(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Memory that :func:`collide` takes at most beside its input and results, in bytes, but for a few megabytes."""
    live = [raster for raster in rasters if raster.cells.size]
    if not live:
        return 0
    far = np.array(in_space(shape)) - 1  # offsets beyond this cannot fall on the map
    front = ((0, 0), (3 - len(shape), 0))
    lower = np.pad([raster.lower for raster in live], front)
    upper = lower + np.pad([raster.cells.shape for raster in live], front, constant_values=1) - 1
    lower, upper = np.clip(lower, -far, far), np.clip(upper, -far, far)
    _, (rows, _, cells) = padded(in_space(shape), lower, upper)
    return int(rows * cells) // OCTET


@dataclass(frozen=True, slots=True)
class Runs:
    """The offsets of a raster that can fall on a map, as rows of consecutive ones along the last axis.

    Attributes
    ----------
    table : ndarray of int64, shape (n, 4)
        The first offset of each, with 0 along the first axis in the plane, and how many offsets it has; ascending in
        this number. The last one of each length is told again until their number is a multiple of four.
    lower, upper : ndarray of int64, shape (3,)
        The least and the greatest offset along each axis.
    clipped : bool
        Whether there are other offsets, which always fall beyond the map.
    """

    table: Ints
    lower: Ints
    upper: Ints
    clipped: bool

    @classmethod
    def of(cls, raster: Raster, shape: Sequence[int]) -> Runs:
        """The runs of a raster on a map of a shape of two or three axes."""
        cells = raster.cells.view(np.uint8).reshape(in_space(raster.cells.shape))
        cells.setflags(write=False)
        table, (lower, upper), clipped = runs_of(cells, in_space(raster.lower, 0), in_space(shape))
        return cls(table, lower, upper, clipped)

    def __len__(self) -> int:
        return len(self.table)

    @property
    def once(self) -> Ints:
        """The table with each run once."""
        again: NDArray[np.bool_] = (np.diff(self.table, axis=0, prepend=-1) == 0).all(axis=1)
        return self.table[~again]

    @property
    def longest(self) -> int:
        """The greatest number of offsets in a row."""
        return int(self.table[-1, 3])


def in_space(numbers: Sequence[int], front: int = 1) -> tuple[int, int, int]:
    """Numbers along three axes, such as a map's shape; one in the plane has one layer, as the first axis."""
    layers, rows, cells = (*(front,) * (3 - len(numbers)), *numbers)
    return layers, rows, cells


def padded(shape: Sequence[int], lower: Ints, upper: Ints) -> tuple[Ints, Ints]:
    """How much before a map's first cells robots reach, shape (3,), and rows, rows of a layer, and cells of a row.

    What is around the map is the same everywhere, so that the end of a row is the beginning of the next one, and the
    last rows of a layer are the first ones of the next. Rows begin with a byte.

    ``lower`` and ``upper``, shape (robots, 3), are their least and greatest offsets.
    """
    below: Ints = np.maximum(0, -lower.min(axis=0))
    above = np.maximum(0, upper.max(axis=0))
    _, rows, cells = shape + np.maximum(below, above)
    layers = below[0] + shape[0] + above[0]
    return below, np.array([(layers - 1) * rows + below[1] + shape[1] + above[1], rows, -(-cells // OCTET) * OCTET])


def _advance(progress: Callable[[int, int], None], total: int, done: int) -> None:
    progress(done, total)


class Board:
    """A map in bits, with as much around it as robots reach; its rows follow each other without a gap.

    Parameters
    ----------
    occupied : ndarray of uint8, shape (layers, rows, cells)
        0 or 1.
    runs : sequence of Runs
        Of the robots.
    outside : bool
        What lies around the map.
    """

    def __init__(self, occupied: Cells, runs: Sequence[Runs], outside: bool) -> None:
        self.shape = in_space(occupied.shape)
        lower, upper = np.array([each.lower for each in runs]), np.array([each.upper for each in runs])
        self.pads, (total, self.rows, self.cells) = padded(self.shape, lower, upper)
        # A block is read beyond the last run's place, as far as the longest run reaches, and one word more.
        self.beyond = max(each.longest for each in runs) // WORD + 2
        words = np.full(total * self.cells // WORD + 2 + self.beyond, ~np.uint64(0) if outside else np.uint64(0))
        before, above, left = self.pads.tolist()
        each = max(1, PACKED // self.cells)
        slab, octets = np.full((min(each, self.shape[1]), self.cells), outside, dtype=np.uint8), words.view(np.uint8)
        for layer, own in enumerate(occupied, start=before):
            for row in range(0, len(own), each):
                part = slab[: len(own) - row]
                part[:, left : left + self.shape[2]] = own[row : row + each]
                first = (layer * self.rows + above + row) * self.cells // OCTET
                octets[first : first + part.size // OCTET] = np.packbits(part, bitorder="little")
        self.packed = Packed(words, int(self.cells) // OCTET, int(self.rows))
        self._buffers = threading.local()

    def placed(self, runs: Runs) -> Ints:
        """Length, word and shift of each run."""
        row = self.rows * self.cells
        bits = runs.table[:, :3] @ (row, self.cells, 1) + self.pads @ (row, self.cells, 1)
        return np.stack([runs.table[:, 3], bits // WORD, bits % WORD], axis=1)

    def blocks(self, table: Ints) -> list[tuple[int, int]]:
        """First row, and the one after the last, of the parts in which results are made; the first begins a word."""
        rows = (self.shape[0] - 1) * self.rows + self.shape[1]
        each = max(BLOCK, int(table[:, 1].max())) * WORD / self.cells
        number = max(1, round(rows / each))
        return list(itertools.pairwise([*(rows * k // number // OCTET * OCTET for k in range(number)), rows]))

    def settle(self, add: bool, tasks: Sequence[Task]) -> None:
        """Make the results of blocks of rows for robots, and write them."""
        buffers = self._buffers
        for table, out, part in tasks:
            size = -(-(part[1] - part[0]) * self.cells // WORD)
            reach = size + int(table[:, 1].max()) + self.beyond
            if getattr(buffers, "size", 0) < reach:
                buffers.arrays, buffers.size = [np.empty(reach, np.uint64) for _ in range(3)], reach
            now, then, words = buffers.arrays
            scratch = Scratch(now[:reach], then[:reach], words[:size], words[:size].view(np.uint8))
            settle_block(self.packed, table, scratch, part, add, out)

"""The engine by dilation: a workspace bitmap dilated by robot rasters, 64 cells a word, in integers.

For every cell k of the map: whether ``W[k + m]`` is set for any offset m of the robot. The offsets are taken as runs
along the last axis. A bitmap in which bit k says whether any of the ``L`` cells from k on is set serves all runs of
length L; it is made from that for the next shorter length with one shift. Each run then costs one shift of this bitmap
to the robot's place. So the work is cells / 64 times (runs + lengths), whatever the number of offsets.
The lowest bit of a word is the first cell, and its lowest byte the first.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Bytes, Ints, Words
from cspace.compiling import always_inline, kernel
from cspace.kernels import load, store
from cspace.raster import Raster, extract_runs
from cspace.threads import cores, in_threads

Cells = NDArray[np.uint8]
Task: TypeAlias = tuple[Words, int, Cells, tuple[int, int]]
"""Runs, as :meth:`PackedGrid.placed` gives them; their last word; results; and a block of rows of these."""

COUNTS: Final = False
"""This engine finds only whether there is any overlap."""

PACKED: Final = 2**20
"""Cells that are packed into words at a time."""

WORD: Final = 64
"""Cells in a word."""

OCTET: Final = 8
"""Cells in a byte."""

FOUR: Final = 4
"""Runs that are added to a result at a time."""

BLOCK: Final = 2**14
"""Words of results that are made together, at least: with what they are made from they fit a core's cache."""

TASKS: Final = 16
"""Parts of the work that each thread should have, for all to end at about the same time."""

LEAST: Final = 2_000_000
"""Words times runs below which a second thread costs more than it saves."""

_REPEAT = np.uint64(0x0101010101010101)
_SELECT = np.uint64(0x8040201008040201)
_CARRY = np.uint64(0x7F7F7F7F7F7F7F7F)
_ONE, _LAST, _EVERY = np.uint64(1), np.uint64(63), ~np.uint64(0)


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
    shape, results = in_space(occupied.shape), in_space(out[0].shape)
    live: list[tuple[Raster, Ints, Cells]] = []
    for raster, runs, result in zip(rasters, Runs.of(rasters, shape), out, strict=True):
        if len(runs.table) and not (outside and runs.clipped):
            live.append((raster, runs.table, result.reshape(results).view(np.uint8)))
        elif add:
            result += np.uint8(outside and runs.clipped)
        else:
            result[...] = outside and runs.clipped
    if not live:
        return "integer"
    longest = max(int(table[-1, 3]) for _, table, _ in live)
    cells = occupied.view(np.uint8).reshape(shape)
    board = PackedGrid(cells, results, [raster for raster, _, _ in live], longest, outside)
    placed, stops = board.placed(np.concatenate([table for _, table, _ in live])), [0]
    stops += np.cumsum([len(table) // FOUR for _, table, _ in live]).tolist()
    reaches = np.maximum.reduceat(placed[:, 1::2].max(axis=1), stops[:-1]).tolist()
    tasks: list[Task] = []
    for (a, b), reach, (_, _, view) in zip(itertools.pairwise(stops), reaches, live, strict=True):
        tasks += [(placed[a:b], reach, view, block) for block in board.blocks(reach)]
    work = sum(FOUR * len(table) * (last - first) * board.cells for table, _, _, (first, last) in tasks) // WORD
    threads = (workers or cores()) if work >= LEAST else 1
    parts = min(len(tasks), TASKS * threads)
    groups = [tasks[len(tasks) * k // parts : len(tasks) * (k + 1) // parts] for k in range(parts)]
    advance = None if progress is None else lambda done: progress(done, parts)
    in_threads(partial(board.settle, add), groups, threads, advance)
    return "integer"


def bytes_needed(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Memory that :func:`collide` takes at most beside its input and results, in bytes, but for a few megabytes."""
    live = [raster for raster in rasters if raster.cells.size]
    if not live:
        return 0
    _, (rows, _, cells) = padded(in_space(shape), in_space(shape), live)
    return int(rows * cells) // OCTET


class Runs(NamedTuple):
    """The offsets of a raster that can fall on a map, as rows of consecutive ones along the last axis.

    Attributes
    ----------
    table : ndarray of int64, shape (n, 4)
        The first offset of each, with 0 along the first axis in the plane, and how many offsets it has; ascending in
        this number. The last one of each length is repeated until their number is a multiple of FOUR.
    clipped : bool
        Whether there are other offsets, which always fall outside the map.
    """

    table: Ints
    clipped: bool

    @property
    def is_first(self) -> Bools:
        """Whether a row is the first of its kind, shape (n,)."""
        return np.append(True, (self.table[1:] != self.table[:-1]).any(axis=1))[: len(self.table)]

    @classmethod
    def of(cls, rasters: Sequence[Raster], shape: tuple[int, int, int]) -> list[Runs]:
        """The runs of rasters on a map of a shape; all at once, for many are small."""
        table, owner = extract_runs(rasters)
        clipped = np.zeros(len(rasters), dtype=np.bool_)
        *far, longest = np.abs(table).max(axis=0, initial=0).tolist()
        if far[0] >= shape[0] or far[1] >= shape[1] or far[2] + longest >= shape[2]:
            before = np.bincount(owner, table[:, 3], len(rasters))
            first, stop = np.maximum(table[:, 2], 1 - shape[2]), np.minimum(table[:, 2] + table[:, 3], shape[2])
            near = (np.abs(table[:, :2]) < shape[:2]).all(axis=1) & (first < stop)
            table, owner = np.column_stack([table[:, :2], first, stop - first])[near], owner[near]
            clipped = np.bincount(owner, table[:, 3], len(rasters)) < before
        kind = (longest + 1) * owner + table[:, 3]
        order = np.argsort(kind, kind="stable")
        table, owner, kind = table[order], owner[order], kind[order]
        last = np.flatnonzero(np.append(kind[1:] != kind[:-1], len(kind) > 0))  # of each length
        times = np.ones(len(table), dtype=np.int64)
        times[last] += -np.diff(last, prepend=-1) % FOUR
        bounds = np.append(0, np.cumsum(times))[np.searchsorted(owner, np.arange(len(rasters) + 1))].tolist()
        table = np.repeat(table, times, axis=0)
        parts = itertools.pairwise(bounds)
        return [cls(table[a:b], far) for (a, b), far in zip(parts, clipped.tolist(), strict=True)]


def in_space(numbers: Sequence[int], front: int = 1) -> tuple[int, int, int]:
    """Numbers along three axes, such as a map's shape; one in the plane has one layer, as the first axis."""
    layers, rows, cells = (*(front,) * (3 - len(numbers)), *numbers)
    return layers, rows, cells


def padded(shape: Sequence[int], results: Sequence[int], rasters: Sequence[Raster]) -> tuple[Ints, Ints]:
    """How much before a map's first cells robots reach, shape (3,), and rows, rows of a layer, and cells of a row.

    ``results`` are the first cells, as many along each axis, that robots are placed at. What is around the map is the
    same everywhere, so that the end of a row is the beginning of the next one, and the last rows of a layer are the
    first ones of the next. Rows begin with a byte, and one more is read from than robots reach.
    """
    far = np.array(shape) - 1  # larger offsets cannot fall on the map
    first = np.array([raster.lower for raster in rasters])
    last = first + [raster.cells.shape for raster in rasters] - 1
    before, after = (np.array(in_space(reach.max(axis=0).tolist(), 0)) for reach in (-first, last))
    after -= np.subtract(shape, results)
    below, above = np.minimum(np.maximum(before, 0), far), np.minimum(np.maximum(after, 0), far)
    _, rows, cells = shape + np.maximum(below, above)
    layers = below[0] + shape[0] + above[0]
    return below, np.array([(layers - 1) * rows + below[1] + shape[1] + above[1] + 1, rows, -(-cells // OCTET) * OCTET])


class Rows(NamedTuple):
    """Rows of bits from the first one to before ``stop``, as many in each as ``octets`` bytes hold.

    A layer has ``each`` of them.
    """

    first: int
    stop: int
    octets: int
    each: int


class Scratch(NamedTuple):
    """What a block is made from, and what becomes of it."""

    now: Words
    then: Words
    result: Words
    octets: Bytes  # of the result


class PackedGrid:
    """A map in bits, with as much around it as robots reach; its rows follow each other without a gap.

    ``occupied`` holds 0 or 1, shape (layers, rows, cells), and ``results`` is how many of its first layers, rows and
    cells robots are placed at; ``longest`` is the greatest number of a robot's offsets in a row, and ``outside`` what
    lies around the map.
    """

    def __init__(
        self,
        occupied: Cells,
        results: tuple[int, int, int],
        rasters: Sequence[Raster],
        longest: int,
        outside: bool,
    ) -> None:
        self.results = results
        self.pads, sizes = padded(occupied.shape, results, rasters)
        total, self.rows, self.cells = sizes.tolist()
        # A block is read past the last run's place, as far as the longest run reaches, and two words more.
        self.padding = longest // WORD + 3
        words = np.full(total * self.cells // WORD + 2 + self.padding, ~np.uint64(0) if outside else np.uint64(0))
        before, above, left = self.pads.tolist()
        each = max(1, PACKED // self.cells)
        slab, octets = (
            np.full((min(each, occupied.shape[1]), self.cells), outside, dtype=np.uint8),
            words.view(np.uint8),
        )
        for layer, own in enumerate(occupied, start=before):
            for row in range(0, len(own), each):
                part = slab[: len(own) - row]
                part[:, left : left + own.shape[1]] = own[row : row + each]
                first = (layer * self.rows + above + row) * self.cells // OCTET
                octets[first : first + part.size // OCTET] = np.packbits(part, bitorder="little")
        self.words = words
        self._buffers = threading.local()

    def placed(self, runs: Ints) -> Words:
        """The runs of tables, FOUR of one length in a row: it, and the word and the shift of each."""
        steps = np.array([self.rows * self.cells, self.cells, 1])
        words, shifts = np.divmod((runs[:, :3] + self.pads) @ steps, WORD)
        placed = np.empty((len(runs) // FOUR, 1 + 2 * FOUR), dtype=np.uint64)
        placed[:, 0] = runs[::FOUR, 3]
        placed[:, 1::2], placed[:, 2::2] = words.reshape(-1, FOUR), shifts.reshape(-1, FOUR)
        return placed

    def blocks(self, reach: int) -> list[tuple[int, int]]:
        """First row, and the one after the last, of the parts in which results are made; the first begins a word.

        ``reach`` is the last word of any run.
        """
        rows = (self.results[0] - 1) * self.rows + self.results[1]
        each = max(BLOCK, reach) * WORD / self.cells
        number = max(1, round(rows / each))
        return list(itertools.pairwise([*(rows * k // number // OCTET * OCTET for k in range(number)), rows]))

    def settle(self, add: bool, tasks: Sequence[Task]) -> None:
        """Make the results of blocks of rows for robots, and write them."""
        buffers = self._buffers
        for table, last, out, part in tasks:
            size = -(-(part[1] - part[0]) * self.cells // WORD)
            reach = size + last + self.padding
            if getattr(buffers, "size", 0) < reach:
                buffers.arrays, buffers.size = [np.empty(reach, np.uint64) for _ in range(3)], reach
            now, then, words = buffers.arrays
            scratch = Scratch(now[:reach], then[:reach], words[:size], words[:size].view(np.uint8))
            rows = Rows(*part, self.cells // OCTET, self.rows)
            near = self.words[rows.first * rows.octets // OCTET :][:reach]
            settle_block(near, table, scratch, rows, add, out)


@kernel
def dilate_block(near: Words, runs: Words, spare: Words, more: Words, result: Words) -> bool:
    """Whether some cell of a set lies at each place from the first word on, moved by any offset of a robot's runs.

    ``runs`` are those of :meth:`PackedGrid.placed`, by ascending length. ``near``, ``spare`` and ``more`` are as long
    as ``result`` and the reach of all runs, and a word more. False, and nothing is written, where nothing is near.
    """
    any_bit = np.uint64(0)
    for k in range(near.size):
        any_bit |= near[k]
        spare[k] = near[k]
    if any_bit == 0:
        return False
    for k in range(result.size):
        result[k] = 0
    length: int = np.int64(1)  # type: ignore[assignment]  # of one type for the compiler from the start
    now, then = spare, more
    for four in runs:
        longer: int = np.int64(four[0])  # type: ignore[assignment]
        while length < longer:
            # A bit stands for as many cells from its own on as ``length``.
            step = min(length, longer - length)
            _widen(now, step, then)
            now, then = then, now
            length += step
        _unite(now, four, result)
    return True


@always_inline
def _shifted(words: Words, k: np.uint64, shift: np.uint64) -> np.uint64:
    """The word that begins so many bits after the beginning of word k."""
    word: np.uint64 = (words[k] >> shift) | ((words[k + _ONE] << _ONE) << (_LAST - shift))
    return word


@kernel
def _widen(now: Words, step: int, then: Words) -> None:
    """``then[k] = now[k] | now[k + step]``, bit by bit; the last ``step`` bits, and a word, are left out."""
    jump, shift = step >> 6, np.uint64(step & 63)
    for k in range(now.size - jump - 1):
        then[k] = now[k] | _shifted(now, np.uint64(jump + k), shift)


@kernel
def _unite(now: Words, four: Words, result: Words) -> None:
    """Add four runs to a result."""
    a, b, c, d = four[1], four[3], four[5], four[7]
    s, t, u, v = four[2], four[4], four[6], four[8]
    for n in range(result.size):
        k = np.uint64(n)
        result[n] |= (
            _shifted(now, a + k, s) | _shifted(now, b + k, t) | _shifted(now, c + k, u) | _shifted(now, d + k, v)
        )


@kernel
def unpack(octets: Bytes, rows: Rows, any_set: bool, add: bool, out: Bytes) -> None:
    """Write rows of bits into ``out``, shape (layers, rows, cells), or add them; those past its rows are left out.

    Unless something was ``any_set``, all are zero.
    """
    cells, old = out.shape[2], _EVERY if add else np.uint64(0)
    eights = cells >> 3
    for row in range(rows.stop - rows.first):
        x, y = (rows.first + row) // rows.each, (rows.first + row) % rows.each
        if x >= out.shape[0] or y >= out.shape[1]:
            continue
        line = out[x, y]
        if not any_set:
            for k in range(0 if add else cells):
                line[k] = 0
            continue
        first = row * rows.octets
        for k in range(eights):
            store(line, 8 * k, (load(line, 8 * k) & old) + spread(np.uint64(octets[first + k])))
        for k in range(8 * eights, cells):
            bit = (octets[first + (k >> 3)] >> np.uint8(k & 7)) & np.uint8(1)
            line[k] = line[k] + bit if add else bit


@always_inline
def spread(byte: np.uint64) -> np.uint64:
    """The bits of a byte, as 0 or 1 in each byte of a word."""
    return ((((byte * _REPEAT) & _SELECT) + _CARRY) >> np.uint64(7)) & _REPEAT


@kernel
def settle_block(near: Words, runs: Words, scratch: Scratch, rows: Rows, add: bool, out: NDArray[np.uint8]) -> None:
    """Dilate the rows from the first, which begins a word, to before the last; write or add them."""
    any_set = dilate_block(near, runs, scratch.now, scratch.then, scratch.result)
    unpack(scratch.octets, rows, any_set, add, out)

"""Engine by dilation: a workspace bitmap dilated by robot rasters, 64 cells a word, in integers.

For every cell k of the map, compute whether ``W[k + m]`` is set for any offset m of the robot. The offsets are grouped
into runs along the last axis. A bitmap whose bit k is set if any of the ``L`` cells from k on is set serves all runs of
length L; it results from the bitmap of the next shorter length by one shift. Each run then costs one shift of this
bitmap by the run's offset. So the work is cells / 64 times (runs + lengths), whatever the number of offsets. The lowest
bit of a word is the first cell, and its lowest byte the first eight.
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
from cspace.kernels import load_word, store_word
from cspace.raster import Raster, extract_runs
from cspace.threads import cores, in_threads

Cells = NDArray[np.uint8]
Task: TypeAlias = tuple[Words, int, Cells, tuple[int, int]]
"""Batches of runs from :meth:`PackedGrid.place_runs`; their last word; results; and a block of rows."""

PRECISION: Final = "integer"
"""This engine computes with words of bits."""

COUNTS: Final = False
"""True if the engine can count overlaps."""

CELLS_PER_PACKING: Final = 2**20
"""Cells that are packed into words at a time."""

WORD_BITS: Final = 64
"""Cells in a word."""

BYTE_BITS: Final = 8
"""Cells in a byte."""

RUNS_PER_BATCH: Final = 4
"""Runs that are added to a result at a time."""

MIN_WORDS_PER_BLOCK: Final = 2**14
"""Minimum number of result words in a block: with their source they fit a core's cache."""

BLOCK_TASKS_PER_THREAD: Final = 16
"""Groups of blocks for each thread, so that all threads finish at about the same time."""

MIN_WORD_RUNS_FOR_THREADS: Final = 2_000_000
"""Number of words times runs below which a second thread costs more than it saves."""

_REPEAT = np.uint64(0x0101010101010101)
_SELECT = np.uint64(0x8040201008040201)
_CARRY = np.uint64(0x7F7F7F7F7F7F7F7F)
_ONE, _LAST_BIT, _ALL_BITS = np.uint64(1), np.uint64(63), ~np.uint64(0)


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
    """Dilate one bitmap by several rasters; see :class:`cspace.engines.Engine`.

    Small work takes one thread.
    """
    shape, results = to_three_axes(occupied.shape), to_three_axes(out[0].shape)
    used: list[tuple[Raster, Ints, Cells]] = []
    for raster, runs, result in zip(rasters, ClippedRuns.of(rasters, shape), out, strict=True):
        if len(runs.table) and not (outside and runs.clipped):
            used.append((raster, runs.table, result.reshape(results).view(np.uint8)))
        elif add:
            result += np.uint8(outside and runs.clipped)
        else:
            result[...] = outside and runs.clipped
    if not used:
        return "integer"
    longest = max(int(table[-1, 3]) for _, table, _ in used)
    cells = occupied.view(np.uint8).reshape(shape)
    grid = PackedGrid(cells, results, [raster for raster, _, _ in used], longest, outside)
    batches, stops = grid.place_runs(np.concatenate([table for _, table, _ in used])), [0]
    stops += np.cumsum([len(table) // RUNS_PER_BATCH for _, table, _ in used]).tolist()
    last_words = np.maximum.reduceat(batches[:, 1::2].max(axis=1), stops[:-1]).tolist()
    tasks: list[Task] = []
    for (a, b), last_word, (_, _, view) in zip(itertools.pairwise(stops), last_words, used, strict=True):
        tasks += [(batches[a:b], last_word, view, block) for block in grid.blocks(last_word)]
    word_runs = (
        sum(RUNS_PER_BATCH * len(table) * (last - first) * grid.cells for table, _, _, (first, last) in tasks)
        // WORD_BITS
    )
    threads = (workers or cores()) if word_runs >= MIN_WORD_RUNS_FOR_THREADS else 1
    n_groups = min(len(tasks), BLOCK_TASKS_PER_THREAD * threads)
    groups = [tasks[len(tasks) * k // n_groups : len(tasks) * (k + 1) // n_groups] for k in range(n_groups)]
    advance = None if progress is None else lambda done: progress(done, n_groups)
    in_threads(partial(grid.dilate_blocks, add), groups, threads, advance)
    return "integer"


def bytes_needed(shape: Sequence[int], rasters: Sequence[Raster], workers: int | None = None) -> int:
    """Return the peak memory of :func:`collide`, in bytes.

    Excludes its input, its results and up to a few megabytes.
    """
    used = [raster for raster in rasters if raster.cells.size]
    if not used:
        return 0
    _, (rows, _, cells) = padded_sizes(to_three_axes(shape), to_three_axes(shape), used)
    return int(rows * cells) // BYTE_BITS


class ClippedRuns(NamedTuple):
    """Runs of the offsets of a raster.

    They lie along the last axis. Only offsets that can fall on a map are included.

    Attributes
    ----------
    table : ndarray of int64, shape (n, 4)
        First offset (x, y, z) of each run, and its length; ascending in length. In the plane x is 0. The last run of
        each length is repeated to fill batches of RUNS_PER_BATCH.
    clipped : bool
        True if the raster also has offsets that always fall outside the map.
    """

    table: Ints
    clipped: bool

    @property
    def is_first(self) -> Bools:
        """Mask of the rows that differ from the row before, shape (n,)."""
        return np.append(True, (self.table[1:] != self.table[:-1]).any(axis=1))[: len(self.table)]

    @classmethod
    def of(cls, rasters: Sequence[Raster], shape: tuple[int, int, int]) -> list[ClippedRuns]:
        """Return the runs of each raster on a map of a shape.

        All rasters are handled at once, because many are small.
        """
        table, owner = extract_runs(rasters)
        clipped = np.zeros(len(rasters), dtype=np.bool_)
        *reach, longest = np.abs(table).max(axis=0, initial=0).tolist()
        if reach[0] >= shape[0] or reach[1] >= shape[1] or reach[2] + longest >= shape[2]:
            lengths = np.bincount(owner, table[:, 3], len(rasters))
            start, stop = np.maximum(table[:, 2], 1 - shape[2]), np.minimum(table[:, 2] + table[:, 3], shape[2])
            reachable = (np.abs(table[:, :2]) < shape[:2]).all(axis=1) & (start < stop)
            table, owner = np.column_stack([table[:, :2], start, stop - start])[reachable], owner[reachable]
            clipped = np.bincount(owner, table[:, 3], len(rasters)) < lengths
        key = (longest + 1) * owner + table[:, 3]
        order = np.argsort(key, kind="stable")
        table, owner, key = table[order], owner[order], key[order]
        last = np.flatnonzero(np.append(key[1:] != key[:-1], len(key) > 0))  # of each length
        repeats = np.ones(len(table), dtype=np.int64)
        repeats[last] += -np.diff(last, prepend=-1) % RUNS_PER_BATCH
        bounds = np.append(0, np.cumsum(repeats))[np.searchsorted(owner, np.arange(len(rasters) + 1))].tolist()
        table = np.repeat(table, repeats, axis=0)
        parts = itertools.pairwise(bounds)
        return [cls(table[a:b], reach) for (a, b), reach in zip(parts, clipped.tolist(), strict=True)]


def to_three_axes(values: Sequence[int], fill: int = 1) -> tuple[int, int, int]:
    """Prepend ``fill`` to values along two axes."""
    layers, rows, cells = (*(fill,) * (3 - len(values)), *values)
    return layers, rows, cells


def padded_sizes(shape: Sequence[int], results: Sequence[int], rasters: Sequence[Raster]) -> tuple[Ints, Ints]:
    """Return the padding of a map by the reach of robots.

    Returns the reach before the map's first cells, shape (3,), and the padded sizes: total rows, rows per layer and
    cells per row. ``results`` is the number of first cells along each axis that are robot positions. The padding has
    one value, so the end of a row serves as the beginning of the next one, and the last rows of a layer as the first
    rows of the next. Rows begin at a byte, and one row more is read than robots reach.
    """
    largest = np.array(shape) - 1  # larger offsets cannot fall on the map
    first = np.array([raster.lower for raster in rasters])
    last = first + [raster.cells.shape for raster in rasters] - 1
    before, after = (np.array(to_three_axes(reach.max(axis=0).tolist(), 0)) for reach in (-first, last))
    after -= np.subtract(shape, results)
    below, above = np.minimum(np.maximum(before, 0), largest), np.minimum(np.maximum(after, 0), largest)
    _, rows, cells = shape + np.maximum(below, above)
    layers = below[0] + shape[0] + above[0]
    return below, np.array(
        [(layers - 1) * rows + below[1] + shape[1] + above[1] + 1, rows, -(-cells // BYTE_BITS) * BYTE_BITS]
    )


class RowRange(NamedTuple):
    """Rows of bits from ``first`` up to ``stop``, with ``bytes_per_row`` bytes each.

    A layer has ``rows_per_layer`` rows.
    """

    first: int
    stop: int
    bytes_per_row: int
    rows_per_layer: int


class Scratch(NamedTuple):
    """Buffers of one block: two of the source's length, and the result."""

    current: Words
    widened: Words
    result: Words
    result_bytes: Bytes  # view of result


class PackedGrid:
    """A map in bits, padded by the reach of robots.

    Rows follow each other without a gap. ``occupied`` contains 0 or 1, shape (layers, rows, cells). ``results`` is the
    number of first layers, rows and cells that are robot positions, ``longest`` the length of the longest run, and
    ``outside`` the value of the padding.
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
        self.pads, sizes = padded_sizes(occupied.shape, results, rasters)
        total, self.rows, self.cells = sizes.tolist()
        # A block is read past the last run's position by the length of the longest run, and two words more.
        self.padding = longest // WORD_BITS + 3
        words = np.full(total * self.cells // WORD_BITS + 2 + self.padding, ~np.uint64(0) if outside else np.uint64(0))
        before, above, left = self.pads.tolist()
        chunk = max(1, CELLS_PER_PACKING // self.cells)
        unpacked, packed = (
            np.full((min(chunk, occupied.shape[1]), self.cells), outside, dtype=np.uint8),
            words.view(np.uint8),
        )
        for layer, cells in enumerate(occupied, start=before):
            for row in range(0, len(cells), chunk):
                rows_part = unpacked[: len(cells) - row]
                rows_part[:, left : left + cells.shape[1]] = cells[row : row + chunk]
                first_byte = (layer * self.rows + above + row) * self.cells // BYTE_BITS
                packed[first_byte : first_byte + rows_part.size // BYTE_BITS] = np.packbits(
                    rows_part, bitorder="little"
                )
        self.words = words
        self._buffers = threading.local()

    def place_runs(self, runs: Ints) -> Words:
        """Return batches of runs: the length, and word and shift of each.

        A batch has RUNS_PER_BATCH runs of one length.
        """
        steps = np.array([self.rows * self.cells, self.cells, 1])
        words, shifts = np.divmod((runs[:, :3] + self.pads) @ steps, WORD_BITS)
        batches = np.empty((len(runs) // RUNS_PER_BATCH, 1 + 2 * RUNS_PER_BATCH), dtype=np.uint64)
        batches[:, 0] = runs[::RUNS_PER_BATCH, 3]
        batches[:, 1::2], batches[:, 2::2] = words.reshape(-1, RUNS_PER_BATCH), shifts.reshape(-1, RUNS_PER_BATCH)
        return batches

    def blocks(self, last_word: int) -> list[tuple[int, int]]:
        """Split the rows into blocks (start, stop); each start begins a word.

        ``last_word`` is the last word of any run.
        """
        rows = (self.results[0] - 1) * self.rows + self.results[1]
        chunk = max(MIN_WORDS_PER_BLOCK, last_word) * WORD_BITS / self.cells
        count = max(1, round(rows / chunk))
        return list(itertools.pairwise([*(rows * k // count // BYTE_BITS * BYTE_BITS for k in range(count)), rows]))

    def dilate_blocks(self, add: bool, tasks: Sequence[Task]) -> None:
        """Dilate blocks of rows by robots, and write or add the results."""
        buffers = self._buffers
        for table, last_word, out, block in tasks:
            size = -(-(block[1] - block[0]) * self.cells // WORD_BITS)
            reach = size + last_word + self.padding
            if getattr(buffers, "size", 0) < reach:
                buffers.arrays, buffers.size = [np.empty(reach, np.uint64) for _ in range(3)], reach
            current, widened, words = buffers.arrays
            scratch = Scratch(current[:reach], widened[:reach], words[:size], words[:size].view(np.uint8))
            rows = RowRange(*block, self.cells // BYTE_BITS, self.rows)
            source = self.words[rows.first * rows.bytes_per_row // BYTE_BITS :][:reach]
            dilate_rows(source, table, scratch, rows, add, out)


@kernel
def dilate_block(source: Words, runs: Words, current: Words, widened: Words, result: Words) -> bool:
    """Dilate a packed bitmap by robot runs.

    Returns False, writing nothing, if the bitmap is empty. ``runs`` are batches of :meth:`PackedGrid.place_runs`, by
    ascending length. ``source``, ``current`` and ``widened`` have the length of ``result`` plus the reach of all runs
    plus one word.
    """
    any_bits = np.uint64(0)
    for k in range(source.size):
        any_bits |= source[k]
        current[k] = source[k]
    if any_bits == 0:
        return False
    for k in range(result.size):
        result[k] = 0
    length: int = np.int64(1)  # type: ignore[assignment]  # numba needs one type throughout
    wide, wider = current, widened
    for batch in runs:
        next_length: int = np.int64(batch[0])  # type: ignore[assignment]
        while length < next_length:
            # A bit of ``wide`` covers ``length`` cells from its own cell on.
            step = min(length, next_length - length)
            _widen(wide, step, wider)
            wide, wider = wider, wide
            length += step
        _unite(wide, batch, result)
    return True


@always_inline
def _shifted(words: Words, k: np.uint64, shift: np.uint64) -> np.uint64:
    """Return the word that begins ``shift`` bits into word k."""
    word: np.uint64 = (words[k] >> shift) | ((words[k + _ONE] << _ONE) << (_LAST_BIT - shift))
    return word


@kernel
def _widen(words: Words, step: int, widened: Words) -> None:
    """Set ``widened[k] = words[k] | words[k + step]`` for each bit.

    The last ``step`` bits, and a word, are left out.
    """
    jump, shift = step >> 6, np.uint64(step & 63)
    for k in range(words.size - jump - 1):
        widened[k] = words[k] | _shifted(words, np.uint64(jump + k), shift)


@kernel
def _unite(words: Words, batch: Words, result: Words) -> None:
    """Add a batch of runs to a result."""
    a, b, c, d = batch[1], batch[3], batch[5], batch[7]
    s, t, u, v = batch[2], batch[4], batch[6], batch[8]
    for n in range(result.size):
        k = np.uint64(n)
        result[n] |= (
            _shifted(words, a + k, s)
            | _shifted(words, b + k, t)
            | _shifted(words, c + k, u)
            | _shifted(words, d + k, v)
        )


@kernel
def unpack(packed: Bytes, rows: RowRange, any_set: bool, add: bool, out: Bytes) -> None:
    """Write or add rows of bits to ``out``.

    ``out`` has the shape (layers, rows, cells); rows outside it are skipped. Unless ``any_set``, all bits are zero.
    """
    cells, mask = out.shape[2], _ALL_BITS if add else np.uint64(0)
    n_bytes = cells >> 3
    for row in range(rows.stop - rows.first):
        x, y = (rows.first + row) // rows.rows_per_layer, (rows.first + row) % rows.rows_per_layer
        if x >= out.shape[0] or y >= out.shape[1]:
            continue
        line = out[x, y]
        if not any_set:
            for k in range(0 if add else cells):
                line[k] = 0
            continue
        first = row * rows.bytes_per_row
        for k in range(n_bytes):
            store_word(line, 8 * k, (load_word(line, 8 * k) & mask) + spread(np.uint64(packed[first + k])))
        for k in range(8 * n_bytes, cells):
            bit = (packed[first + (k >> 3)] >> np.uint8(k & 7)) & np.uint8(1)
            line[k] = line[k] + bit if add else bit


@always_inline
def spread(byte: np.uint64) -> np.uint64:
    """Spread the bits of a byte over the bytes of a word."""
    return ((((byte * _REPEAT) & _SELECT) + _CARRY) >> np.uint64(7)) & _REPEAT


@kernel
def dilate_rows(
    source: Words, runs: Words, scratch: Scratch, rows: RowRange, add: bool, out: NDArray[np.uint8]
) -> None:
    """Dilate a range of rows, and write or add it.

    The first row begins a word.
    """
    any_set = dilate_block(source, runs, scratch.current, scratch.widened, scratch.result)
    unpack(scratch.result_bytes, rows, any_set, add, out)

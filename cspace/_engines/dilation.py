"""Engine by dilation: a workspace bitmap dilated by robot rasters, 64 cells a word, in integers.

For every cell k of the map, compute whether ``W[k + m]`` is set for any offset m of the robot. The
map is one string of bits, in which each offset is a distance; offsets are grouped into runs along
the last axis::

    map                        0 0 1 1 0 0 0 1 0 0
    wide bits for length 3     1 1 1 1 0 1 1 1 0 0    bit k: any of 3 bits from k on is set
    a run at distance 2        1 1 0 1 1 1 0 0        bit k: the run hits; wide bit k + 2

Wide bits of one length are those of a shorter length, united with a shift of them, and each run is
one shift more. So the work is cells / 64 times (runs + lengths), whatever the number of offsets.
The lowest bit of a word is the first cell.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._raster import Raster, extract_runs
from cspace._support.arrays import Bools, Ints, Words
from cspace._support.compiling import inlined, kernel
from cspace._support.threads import count_cores, map_in_threads

Cells = NDArray[np.uint8]

COUNTS: Final = False
"""True if the engine can count overlaps."""

WORD_BITS: Final = 64
"""Cells in a word."""

BYTE_BITS: Final = 8
"""Cells in a byte."""

BLOCK_TASKS_PER_THREAD: Final = 16
"""Groups of blocks for each thread, so that all threads finish at about the same time."""

MIN_WORD_RUNS_FOR_THREADS: Final = 2_000_000
"""Number of words times runs below which a second thread costs more than it saves."""

_ONE = np.uint64(1)
_LAST_BIT = np.uint64(63)


class Block(NamedTuple):
    """Part of a result array: all rows of some layers, or some rows of one layer."""

    first_layer: int
    stop_layer: int
    first_row: int
    stop_row: int


class BlockTask(NamedTuple):
    """A block of the results of one raster.

    Attributes
    ----------
    lengths, distances : ndarray of int64, shape (n,)
        Number of cells of each run, ascending, and number of bits from a cell to its run.
    block : Block
    out : ndarray of uint8, shape (layers, rows, cells)
        All results.
    """

    lengths: Ints
    distances: Ints
    block: Block
    out: Cells


def write_overlaps(
    occupied: Bools,
    rasters: Sequence[Raster],
    out: Sequence[NDArray[Any]],
    *,
    outside: bool,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Dilate one bitmap by several rasters; see :class:`cspace._engines.Engine`.

    Small inputs are dilated in one thread.
    """
    shape = to_three_axes(occupied.shape)
    results = to_three_axes(out[0].shape)
    used_rasters = []
    used_runs = []
    used_outputs = []
    for raster, runs, result in zip(rasters, ClippedRuns.of(rasters, shape), out, strict=True):
        is_blocked = outside and runs.clipped  # at every cell, by obstacles outside
        if len(runs.table) and not is_blocked:
            used_rasters.append(raster)
            used_runs.append(runs.table)
            used_outputs.append(result.reshape(results).view(np.uint8))
        elif add:
            result += np.uint8(is_blocked)
        else:
            result[...] = is_blocked
    if not used_rasters:
        return
    bits = PaddedBits(occupied.reshape(shape), results, used_rasters, outside)
    tasks: list[BlockTask] = []
    for table, result in zip(used_runs, used_outputs, strict=True):
        tasks += bits.make_tasks(table, result)
    word_runs = bits.words.size * sum(map(len, used_runs))
    threads = (workers or count_cores()) if word_runs >= MIN_WORD_RUNS_FOR_THREADS else 1
    count = min(len(tasks), BLOCK_TASKS_PER_THREAD * threads)
    groups = [tasks[first::count] for first in range(count)]
    advance = None if progress is None else lambda done: progress(done, len(groups))
    map_in_threads(partial(bits.dilate_blocks, add), groups, threads, advance)


class ClippedRuns(NamedTuple):
    """Runs of a raster's offsets that can fall on a map.

    Runs lie along the last axis.

    Attributes
    ----------
    table : ndarray of int64, shape (n, 4)
        First offset (x, y, z) of each run, and its length; ascending in length. In the plane x is
        0.
    clipped : bool
        True if the raster also has offsets that always fall outside the map.
    """

    table: Ints
    clipped: bool

    @classmethod
    def of(cls, rasters: Sequence[Raster], shape: tuple[int, int, int]) -> list[ClippedRuns]:
        """Return the runs of each raster on a map of a shape.

        All rasters are handled at once, because many are small.
        """
        table, owner = extract_runs(rasters)  # the owner of a run is the number of its raster
        x, y, z, length = table.T
        layers, rows, cells = shape
        offset_counts = np.bincount(owner, length, len(rasters))
        # An offset falls on the map from some cell of it if it is shorter than the map.
        start = np.maximum(z, 1 - cells)
        stop = np.minimum(z + length, cells)
        can_hit = (np.abs(x) < layers) & (np.abs(y) < rows) & (start < stop)
        table = np.column_stack([x, y, start, stop - start])[can_hit]
        owner = owner[can_hit]
        length = (stop - start)[can_hit]
        is_clipped = np.bincount(owner, length, len(rasters)) < offset_counts
        by_raster_and_length = np.lexsort((length, owner))
        first_runs = np.searchsorted(owner, np.arange(1, len(rasters)))
        tables = np.split(table[by_raster_and_length], first_runs)
        return list(map(cls, tables, is_clipped.tolist()))


def to_three_axes(values: Sequence[int], fill: int = 1) -> tuple[int, int, int]:
    """Prepend ``fill`` to two values; return three values unchanged."""
    if len(values) == 2:
        values = fill, *values
    layers, rows, cells = values
    return layers, rows, cells


def round_up_to_byte(number: int) -> int:
    """Round a number of bits up to a multiple of 8."""
    return -(-number // BYTE_BITS) * BYTE_BITS


class Padding(NamedTuple):
    """Size of a map that is padded by the reach of robots.

    The padding has one value, so the end of a row serves as the beginning of the next one, and the
    last rows of a layer as the first rows of the next.

    Attributes
    ----------
    before : tuple of int
        Layers, rows and cells before those of the map; the cells are a multiple of 8.
    rows : int
        Rows of a layer, a multiple of 8, so that each layer begins at a word.
    cells : int
        Cells of a row, a multiple of 8, so that each row begins at a byte.
    total_rows : int
        Rows of all layers, and those that offsets reach behind the last layer.
    """

    before: tuple[int, int, int]
    rows: int
    cells: int
    total_rows: int

    @classmethod
    def of(cls, shape: Sequence[int], results: Sequence[int], rasters: Sequence[Raster]) -> Padding:
        """Compute the padding of a map for rasters.

        The first ``results`` cells of the map are robot positions.
        """
        # Offsets of all rasters lie in this box; negative ones need padding before the map.
        lower = np.array([to_three_axes(raster.lower, 0) for raster in rasters]).min(axis=0)
        upper = np.array([to_three_axes(raster.upper, 0) for raster in rasters]).max(axis=0)
        largest = np.array(shape) - 1  # larger offsets cannot fall on the map
        unused = np.subtract(shape, results)
        layers_before, rows_before, cells_before = np.clip(-lower, 0, largest).tolist()
        layers_after, rows_after, cells_after = np.clip(upper - unused, 0, largest).tolist()
        cells_before = round_up_to_byte(cells_before)
        rows = round_up_to_byte(shape[1] + max(rows_before, rows_after))
        cells = round_up_to_byte(shape[2] + max(cells_before, cells_after))
        layers = layers_before + shape[0] + layers_after
        # The last row of a layer may be padding, and its farthest offset lies these rows behind it.
        # Three more rows hold the words that are read at the end.
        _, unused_rows, _ = unused.tolist()
        rows_behind = rows_before + rows_after + unused_rows + 3
        before = layers_before, rows_before, cells_before
        return cls(before, rows, cells, layers * rows + rows_behind)


class PaddedBits:
    """A map in bits, padded by the reach of robots.

    ``occupied`` has the shape (layers, rows, cells). ``results`` is the number of first layers,
    rows and cells that are robot positions, and ``outside`` the value of the padding.
    """

    def __init__(
        self,
        occupied: Bools,
        results: tuple[int, int, int],
        rasters: Sequence[Raster],
        outside: bool,
    ) -> None:
        """Pack the map into bits, with padding around it."""
        self.results = results
        self.padding = Padding.of(occupied.shape, results, rasters)
        packed = np.packbits(occupied, axis=2, bitorder="little")
        layers, rows, row_bytes = packed.shape
        used_bits = occupied.shape[2] % BYTE_BITS
        if outside and used_bits:
            # Set the unused bits of the last byte of each row.
            packed[:, :, -1] |= np.uint8(0xFF << used_bits & 0xFF)
        # Shifts read up to three words beyond the last row.
        total_words = self.padding.total_rows * self.padding.cells // WORD_BITS + 3
        fill = ~np.uint64(0) if outside else np.uint64(0)
        self.words = np.full(total_words, fill)
        first_layer, first_row, first_cell = self.padding.before
        first_byte = first_cell // BYTE_BITS
        stop_layer = first_layer + layers
        layer_bytes = self.padding.rows * self.padding.cells // BYTE_BITS
        padded_bytes = self.words.view(np.uint8)[: stop_layer * layer_bytes]
        padded = padded_bytes.reshape(stop_layer, self.padding.rows, -1)
        # Copy the map behind the padding of its layers, rows and bytes of rows.
        padded = padded[first_layer:, first_row : first_row + rows]
        padded[:, :, first_byte : first_byte + row_bytes] = packed

    def make_tasks(self, runs: Ints, out: Cells) -> list[BlockTask]:
        """Return the tasks of one raster, by its runs from :class:`ClippedRuns`."""
        layer_bits = self.padding.rows * self.padding.cells
        strides = np.array([layer_bits, self.padding.cells, 1])
        # Runs are (x, y, z, length). A distance is the number of bits from a result to a run.
        distances = (runs[:, :3] + self.padding.before) @ strides
        lengths = np.ascontiguousarray(runs[:, 3])
        blocks = self._split_results(int(distances.max()) // WORD_BITS)
        return [BlockTask(lengths, distances, block, out) for block in blocks]

    def _split_results(self, reach: int) -> list[Block]:
        """Split results into blocks that begin at a word.

        ``reach`` is the number of words between a cell and the farthest run. Each block reads and
        widens that many additional words, so it has at least about as many words of its own.
        """
        layers, rows, _ = self.results
        # Minimum number of result words in a block; with source and scratch they fit a core's
        # cache.
        rows_of_block = max(2**13, reach) * WORD_BITS / self.padding.cells
        if rows_of_block > self.padding.rows:
            step = max(1, round(rows_of_block / self.padding.rows))
            starts = range(0, layers, step)
            return [Block(layer, min(layer + step, layers), 0, rows) for layer in starts]
        blocks_of_layer = max(1, round(rows / rows_of_block))
        step = round_up_to_byte(math.ceil(rows / blocks_of_layer))
        corners = itertools.product(range(layers), range(0, rows, step))
        return [Block(layer, layer + 1, row, min(row + step, rows)) for layer, row in corners]

    def dilate_blocks(self, add: bool, tasks: Sequence[BlockTask]) -> None:
        """Dilate blocks, and write their results, or add them to ``out``."""
        row_bits = self.padding.cells
        scratch = np.empty((3, 0), dtype=np.uint64)
        for lengths, distances, block, out in tasks:
            hits = out[block.first_layer : block.stop_layer, block.first_row : block.stop_row]
            layers, rows, cells = hits.shape
            # The layers of a block follow each other with their padding.
            rows_of_layer = self.padding.rows if layers > 1 else rows
            size = math.ceil(layers * rows_of_layer * row_bits / WORD_BITS)
            reach = (int(distances.max()) + int(lengths[-1])) // WORD_BITS + 3
            first_row = block.first_layer * self.padding.rows + block.first_row
            first_word = first_row * row_bits // WORD_BITS
            source = self.words[first_word : first_word + size + reach]
            if scratch.shape[1] < source.size:
                scratch = np.empty((3, source.size), dtype=np.uint64)
            wide, wider, longest_result = scratch
            result = longest_result[:size]
            if dilate(source, lengths, distances, wide, wider, result):
                row_bytes = row_bits // BYTE_BITS
                result_bytes = result.view(np.uint8)[: layers * rows_of_layer * row_bytes]
                packed = result_bytes.reshape(layers, rows_of_layer, row_bytes)[:, :rows]
                new_hits = np.unpackbits(packed, axis=2, count=cells, bitorder="little")
                if add:
                    hits += new_hits
                else:
                    hits[...] = new_hits
            elif not add:
                hits[...] = 0


@kernel
def dilate(
    source: Words, lengths: Ints, distances: Ints, wide: Words, wider: Words, result: Words
) -> bool:
    """Dilate a string of bits by runs, into ``result``.

    Sets bit k of the result if a run of bits that begins ``distance`` after bit k has a set bit.
    Returns False, without a result, if no bit of the source is set. ``wide`` and ``wider`` are
    scratch, at least as long as the source. The source reaches a word beyond the last run.
    """
    all_bits = np.uint64(0)
    for k in range(source.size):
        all_bits |= source[k]
        wide[k] = source[k]
    if all_bits == 0:
        return False
    for k in range(result.size):
        result[k] = 0
    # Bit k of ``wide`` tells if any of ``length`` bits from k on is set.
    length = 1
    run = 0
    while run < lengths.size:
        while length < lengths[run]:
            step = min(lengths[run] - length, length)
            # The last words are out of date from here on, but all runs end before them.
            for k in range(np.uint64(source.size - step // WORD_BITS - 1)):
                wider[k] = wide[k] | read_word(wide, k, step)
            wide, wider = wider, wide
            length += step
        # Four runs of one length share a pass over the result; the last one replaces missing ones.
        last = run
        while last < min(run + 3, lengths.size - 1) and lengths[last + 1] == length:
            last += 1
        a = distances[run]
        b = distances[min(run + 1, last)]
        c = distances[min(run + 2, last)]
        d = distances[last]
        for k in range(np.uint64(result.size)):
            first_two = read_word(wide, k, a) | read_word(wide, k, b)
            result[k] |= first_two | read_word(wide, k, c) | read_word(wide, k, d)
        run = last + 1
    return True


@inlined
def read_word(words: Words, k: int, distance: int) -> np.uint64:
    """Return the 64 bits that begin ``distance`` bits after word k."""
    first = k + np.uint64(distance // WORD_BITS)
    shift = np.uint64(distance % WORD_BITS)
    # The second word is shifted twice, because a shift by 64 bits is undefined.
    word: np.uint64 = (words[first] >> shift) | (words[first + _ONE] << _ONE) << (_LAST_BIT - shift)
    return word

"""Dilation of a workspace bitmap by robot rasters, 64 cells a word.

For every cell k of the map: whether ``W[k + m]`` is set for any offset m of the robot. The offsets are taken as runs
along the last axis. A bitmap in which bit k tells whether any of the ``L`` cells from k on is set serves all runs of
length L; it is made from that for the next shorter length with one shift. Each run then costs one shift of this bitmap
to the robot's place. So the work is cells / 64 times (runs + lengths), whatever the number of offsets.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cspace.bits.runs import Runs, in_space
from cspace.costs import figures
from cspace.raster.raster import Raster
from cspace.threads import cores, in_threads

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Cells = NDArray[np.uint8]
Task: TypeAlias = tuple[Ints, Cells, tuple[int, int]]

WORD = 64
"""Cells in a word."""

BLOCK = 2**14
"""Words of results that are made together, at least: with what they are made from they fit a core's cache."""

TASKS = 16
"""Parts of the work that each thread should have, for all to end at about the same time."""

LEAST = 2_000_000
"""Words times runs below which a second thread costs more than it saves."""


def dilate(
    occupied: Bools,
    robots: Sequence[Raster | Runs],
    *,
    outside: bool,
    out: Sequence[NDArray[Any]] | None = None,
    add: bool = False,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[NDArray[Any]]:
    """Dilate one bitmap by several rasters: the booleans of :func:`cspace.fourier.correlate`.

    Parameters
    ----------
    occupied : ndarray of bool, shape (nx, ny) or (nx, ny, nz)
        Obstacle cells W.
    robots : sequence of Raster, or of their Runs on a map of this shape
        Robot offsets A.
    outside : bool
        Whether the cells beyond the map are obstacle.
    out : sequence of ndarray of bool or uint8, optional
        Where to write the results, one C-ordered array for each raster; new arrays if left out.
    add : bool
        Add 1 to ``out``, arrays of uint8, wherever there is any overlap.
    workers : int, optional
        Threads; by default one for each core that the process may use. Small work takes one.
    progress : callable, optional
        Called with (parts done, parts in all), from the calling thread.

    Returns
    -------
    list of ndarray
    """
    results: list[NDArray[Any]] = [np.empty(occupied.shape, np.bool_) for _ in robots] if out is None else list(out)
    shape = in_space(occupied.shape)
    live: list[tuple[Runs, Cells]] = []
    for robot, result in zip(robots, results, strict=True):
        runs = robot if isinstance(robot, Runs) else Runs.of(robot, shape)
        if len(runs) and not (outside and runs.beyond):
            live.append((runs, result.reshape(shape).view(np.uint8)))
        elif add:
            result += np.uint8(outside and runs.beyond)
        else:
            result[...] = outside and runs.beyond
    if not live:
        return results
    board = Board(np.ascontiguousarray(occupied).reshape(shape).view(np.uint8), [runs for runs, _ in live], outside)
    tasks: list[Task] = []
    for runs, view in live:
        table = board.placed(runs)
        tasks += [(table, view, block) for block in board.blocks(table)]
    work = sum(len(table) * (last - first) * board.width for table, _, (first, last) in tasks)
    threads = (workers or cores()) if work >= LEAST else 1
    parts = min(len(tasks), TASKS * threads)
    groups = [tasks[len(tasks) * k // parts : len(tasks) * (k + 1) // parts] for k in range(parts)]
    advance = None if progress is None else partial(_advance, progress, parts)
    in_threads(partial(board.settle, add), groups, threads, advance)
    return results


def dilation_bytes(shape: Sequence[int], robots: Sequence[Runs]) -> int:
    """Memory that :func:`dilate` takes at most beside its input and results, in bytes; a few megabytes are left out."""
    live = [runs for runs in robots if len(runs)]
    return _words(shape, live) * WORD // 8 if live else 0


def dilation_seconds(shape: Sequence[int], robots: Sequence[Runs], workers: int | None = None) -> float:
    """How long :func:`dilate` is expected to take on this machine; ``workers`` as there."""
    live = [runs for runs in robots if len(runs)]
    if not live:
        return 0.0
    costs, words = figures().now, _words(shape, live)
    # A word for each length of a run, and the filling up of fours, cost as much as a run.
    steps = sum(len(runs) + 3 * runs.lengths for runs in live)
    threads = (workers or cores()) if words * steps >= LEAST else 1
    return (words * steps * costs.run + len(live) * math.prod(shape) * costs.cell) / threads


def frame(shape: tuple[int, int, int], robots: Sequence[Runs]) -> tuple[Ints, list[int]]:
    """How much before a map's first cells robots reach, shape (3,), and the size with all that they reach."""
    below: Ints = np.maximum(0, -np.min([runs.lower for runs in robots], axis=0))
    above = np.maximum(0, np.max([runs.upper for runs in robots], axis=0))
    return below, (below + shape + above).tolist()


def _words(shape: Sequence[int], robots: Sequence[Runs]) -> int:
    _, (layers, rows, cells) = frame(in_space(shape), robots)
    return int(layers * rows * -(-cells // WORD))


def _advance(progress: Callable[[int, int], None], total: int, done: int) -> None:
    progress(done, total)


class Board:
    """A map in words, with as much around it as robots reach; its rows follow each other without a gap.

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
        from cspace.bits import _kernels

        self.shape = in_space(occupied.shape)
        self.pads, (layers, self.rows, cells) = frame(self.shape, runs)
        self.width = -(-cells // WORD)
        # A block is read a row beyond the last run's place, and as far as the longest run reaches, and one word more.
        self.beyond = max(each.longest for each in runs) // WORD + 2
        self.words = np.zeros((layers * self.rows + 1) * self.width + self.beyond, np.uint64)
        before, above, left = self.pads.tolist()
        for layer, slab in enumerate(occupied, start=before):
            first = (layer * self.rows + above) * self.width + left // WORD
            _kernels.pack(slab, left % WORD, int(outside), self.words, first, self.width)
        if outside:
            np.invert(self.words, out=self.words)

        self._buffers = threading.local()

    def placed(self, runs: Runs) -> Ints:
        """Length, word and shift of each run."""
        from cspace.bits import _kernels

        table: Ints = _kernels.place_runs(runs.table, self.pads, self.rows, self.width)
        return table

    def blocks(self, table: Ints) -> list[tuple[int, int]]:
        """First row, and the one after the last, of the parts in which results are made."""
        rows = (self.shape[0] - 1) * self.rows + self.shape[1]
        each = max(BLOCK, int(table[:, 1].max())) / self.width
        number = max(1, round(rows / each))
        return list(itertools.pairwise(rows * k // number for k in range(number + 1)))

    def settle(self, add: bool, tasks: Sequence[Task]) -> None:
        """Make the results of blocks of rows for robots, and write them."""
        from cspace.bits import _kernels

        buffers = self._buffers
        for table, out, (first, last) in tasks:
            size = (last - first) * self.width
            reach = size + int(table[:, 1].max()) + self.beyond
            if getattr(buffers, "size", 0) < reach:
                buffers.arrays, buffers.size = [np.empty(reach, np.uint64) for _ in range(3)], reach
            words, now, then = (array[:reach] for array in buffers.arrays)
            _kernels.settle_block(self.words, table, now, then, words[:size], self.width, first, self.rows, add, out)

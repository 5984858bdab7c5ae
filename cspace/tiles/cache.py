"""Queries of stored maps, with a cache of tiles.

Kernels read cells by :func:`cspace.map.storage.state_in`. It returns FREE for a cell of a missing tile and marks the
tile. The query loads marked tiles and runs again until no tile is marked. Then each cell was read from a loaded tile at
least once, and the result is the worst of all passes; so no missing tile makes a result FREE.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from math import prod
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bytes, Floats
from cspace.configuration_map import Result
from cspace.errors import FileError
from cspace.map.batches import Kernel, Query, as_contiguous
from cspace.map.exterior import Exterior
from cspace.map.storage import ASIDE, MISSING, USED, Map, TileCells, pack, read_only
from cspace.obstacles import CellsInMemory
from cspace.store import Record, Store, unfinished_map_error
from cspace.threads import MIN_ITEMS_PER_THREAD, in_chunks
from cspace.tiles.work import Job

ROWS_PER_PIECE: Final = 2**18
"""Configurations or edges that are copied and evaluated at a time."""


class ChunkCache:
    """Least-recently-used cache of packed chunks.

    Parameters
    ----------
    shape, sides : tuple of int
        Slices and cells of the map, and of a chunk.
    limit : int
        Memory in bytes; the cache holds at least one chunk.
    load : callable
        Returns the states of a chunk, given its number.
    """

    def __init__(
        self, shape: tuple[int, ...], sides: tuple[int, ...], limit: int, load: Callable[[int], Bytes]
    ) -> None:
        counts = tuple(-(-n // side) for n, side in zip(shape, sides, strict=True))
        self._chunk_bytes, self._load = -(-prod(sides) // 4), load
        self.capacity = max(1, min(limit // self._chunk_bytes, prod(counts)))
        self._packed = np.zeros(0, dtype=np.uint8)
        self._places, self._marks = np.full(prod(counts), MISSING), np.zeros(prod(counts) + 1, dtype=np.int64)
        self._slots: OrderedDict[int, int] = OrderedDict()
        self._shape = tuple(map(int, shape)), tuple(map(int, sides)), counts

    @property
    def cells(self) -> TileCells:
        """Cells for kernels, until the next chunk is loaded."""
        return TileCells(read_only(self._packed.view()), self._places, self._marks, *self._shape)

    def begin(self) -> None:
        """Begin a query by resetting marks of chunks."""
        self._places[self._places < 0] = MISSING
        self._marks[:] = 0

    def requested(self, max_count: int) -> list[int]:
        """Return at most ``capacity`` missing chunks, in reading order."""
        for chunk in np.flatnonzero(self._marks[:-1] == USED).tolist():
            self._slots.move_to_end(chunk)
        marked = np.flatnonzero(self._marks[:-1] > 0)
        chunks: list[int] = marked[np.argsort(self._marks[marked])][: min(max_count, self.capacity)].tolist()
        self._marks[:] = 0
        return chunks

    def load(self, chunks: Iterable[int]) -> None:
        """Load chunks, evicting the least recently used ones."""
        for chunk in chunks:
            states = self._load(chunk)
            if len(self._slots) < self.capacity:
                slot = len(self._slots)
                if (slot + 1) * self._chunk_bytes > len(self._packed):
                    size = min(max(2 * slot, 4), self.capacity) * self._chunk_bytes
                    self._packed = np.concatenate([self._packed, np.empty(size - len(self._packed), dtype=np.uint8)])
            else:
                oldest, slot = self._slots.popitem(last=False)
                self._places[oldest] = ASIDE
            pack(states.reshape(-1), self._packed[slot * self._chunk_bytes : (slot + 1) * self._chunk_bytes])
            self._slots[chunk] = slot
            self._places[chunk] = 4 * slot * self._chunk_bytes


class TileBackend:
    """Backend that loads tiles for kernels.

    Parameters
    ----------
    store : Store
    cache_bytes : int
        Memory for decoded tiles.
    """

    def __init__(self, store: Store, cache_bytes: int) -> None:
        self.lock, self.limit = threading.RLock(), int(cache_bytes)
        self._open(store)

    def _open(self, store: Store) -> None:
        """Open a store, and reset the caches."""
        self.__dict__.pop("exterior", None)
        self.store, self._records = store, {}  # type: tuple[Store, dict[tuple[int, ...], Record]]
        shape = (store.slices, *store.grid.shape)
        self._cache = ChunkCache(shape, (store.depth, *store.tile), self.limit, self._read_chunk)
        self.job = Job(store, CellsInMemory(np.empty(0, np.bool_), np.empty(0, np.bool_)))

    @property
    def latest(self) -> Store:
        """The current store, reopened if another process changed it."""
        with self.lock:
            if self.store.is_past:
                self._open(Store.open(self.store.path))
            return self.store

    @property
    def share_done(self) -> float:
        """Fraction of the tiles that are done."""
        return self.latest.share_done

    def check_done(self) -> None:
        """Raise FileError unless all tiles are done."""
        if not self.latest.is_done:
            raise unfinished_map_error(self.store.path, self.share_done)

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` on one version of the store.

        Run it again if the store changes meanwhile.
        """
        with self.lock:
            while True:
                store = self.latest
                self.check_done()
                try:
                    result = work()
                except FileError:  # an update may have replaced a file
                    if not self.store.is_past:
                        raise
                else:
                    if self.store is store and not store.is_past:
                        return result

    def query(self, kernel: Kernel, *arguments: Any, passed: object = None, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """Return a query for a kernel; see :class:`cspace.configuration_map.Backend`."""

        def run(*rows_and_out: Any) -> int:
            *rows, out = rows_and_out
            return self._run_until_loaded(partial(_run_on_rows, kernel, arguments), rows, out, passed, least)

        return lambda parts, out: self.at_one_moment(lambda: fill_in_pieces(run, parts, out))

    def _run_until_loaded(
        self, kernel: Kernel, rows: list[Floats], out: NDArray[Any], passed: object, least: int
    ) -> int:
        """Run a kernel until all its tiles were loaded.

        Return the first bad row, or -1. A result other than ``passed`` is final. The other rows run again, with some of
        the missing tiles loaded.
        """
        cache, pending = self._cache, np.arange(len(out))
        cache.begin()
        while len(pending):
            is_whole = len(pending) == len(out)
            pending_rows = rows if is_whole else [part[pending] for part in rows]
            values = np.empty(len(pending), dtype=out.dtype)
            bad = in_chunks(partial(kernel, self._map, pending_rows, values), len(pending), least)
            if bad >= 0:
                return bad
            out[pending] = values
            pending = pending[values == passed]
            # Load at most one tile per pending row: few rows often fail in the first tiles that they read.
            requested = cache.requested(len(pending))
            if not requested:
                break
            cache.load(requested)
        return -1

    @property
    def _map(self) -> Map:
        """The map for kernels, with currently loaded tiles."""
        grid, cells = self.store.grid, self._cache.cells
        rotations = self.store.rotations.make_lookups(self.store.slice_of)
        return Map(cells, cells, rotations, grid.lower, grid.spacing, grid.upper, self.exterior.table)

    @cached_property
    def exterior(self) -> Exterior:
        """Known states outside the map."""
        if "exterior" in self.store.names:
            return Exterior(self.store.array("exterior"))
        box, outside = np.array(self.store.metadata["box"]), str(self.store.metadata["outside"])
        return Exterior.around(self.store.grid.shape, box, self.job.pairs, outside)

    def _read_chunk(self, number: int) -> Bytes:
        """Return the states of a chunk, given its number."""
        store = self.store
        layer, *index = np.unravel_index(number, (store.layers, *store.counts))
        tile = tuple(int(i) for i in index)
        return store.states(tile, int(layer), self.record(tile))

    def record(self, tile: tuple[int, ...]) -> Record:
        """Return the record of a tile, cached."""
        if tile not in self._records:
            self._records[tile] = self.store.known(tile)
        return self._records[tile]


def fill_in_pieces(kernel: Kernel, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out``; return the first bad row, or -1.

    Rows are copied a piece at a time.
    """
    for start in range(0, len(out), ROWS_PER_PIECE):
        piece = slice(start, start + ROWS_PER_PIECE)
        bad = kernel(*(as_contiguous(part[piece]) for part in parts), out[piece])
        if bad >= 0:
            return start + bad
    return -1


def _run_on_rows(
    kernel: Kernel, arguments: tuple[Any, ...], map_: Map, rows: list[Floats], out: NDArray[Any], start: int, stop: int
) -> int:
    """Run a kernel on some rows of a batch."""
    return kernel(map_, *arguments, *(part[start:stop] for part in rows), out[start:stop])

"""Decoded tiles in memory, up to a number of bytes, as compiled look-ups take them.

Look-ups are compiled for the whole map, whose cells they read by :func:`cspace.map.storage.state_in`; here is what it
does for cells that lie in tiles: a cell of a tile that is not there counts as FREE, and the tile is marked. So a
look-up is repeated, with other tiles loaded, until none is marked: each cell that it reads was then there at least
once, and its answer is the worst of all passes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from math import prod
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bytes, Floats
from cspace.errors import FileError
from cspace.map.backend import Result
from cspace.map.batches import Kernel, Query, as_contiguous
from cspace.map.derived import Lock
from cspace.map.exterior import Exterior
from cspace.map.storage import ASIDE, MISSING, USED, Map, TileCells, pack, read_only
from cspace.obstacles import CellsInMemory
from cspace.store import Record, Store, unfinished_map_error
from cspace.threads import MIN_ITEMS_PER_THREAD, in_chunks
from cspace.tiles.work import Job

ROWS_IN_A_PIECE: Final = 2**18
"""Configurations, or edges, of a batch that are copied and answered at a time."""


class Cache:
    """Room for as many chunks as a number of bytes holds, the least recently used of which goes first.

    ``shape`` and ``sides`` are slices and cells of the map, and of a chunk. ``limit`` is in bytes; there is room for
    one chunk at least. ``load`` gives the states of a chunk, by its number.
    """

    def __init__(
        self, shape: tuple[int, ...], sides: tuple[int, ...], limit: int, load: Callable[[int], Bytes]
    ) -> None:
        counts = tuple(-(-n // side) for n, side in zip(shape, sides, strict=True))
        self._each, self._load = -(-prod(sides) // 4), load
        self.room = max(1, min(limit // self._each, prod(counts)))
        self._packed = np.zeros(0, dtype=np.uint8)
        self._places, self._wanted = np.full(prod(counts), MISSING), np.zeros(prod(counts) + 1, dtype=np.int64)
        self._used: OrderedDict[int, int] = OrderedDict()
        self._shape = tuple(map(int, shape)), tuple(map(int, sides)), counts

    @property
    def cells(self) -> TileCells:
        """What compiled code takes, until the next chunk is loaded."""
        return TileCells(read_only(self._packed.view()), self._places, self._wanted, *self._shape)

    def begin(self) -> None:
        """Begin a look-up: what earlier ones evicted or wanted counts as missing, like all that is not there."""
        self._places[self._places < 0] = MISSING
        self._wanted[:] = 0

    def wanted(self, most: int) -> list[int]:
        """The chunks that were read and are missing, in the order of reading, as many as there is room for."""
        for chunk in np.flatnonzero(self._wanted[:-1] == USED).tolist():
            self._used.move_to_end(chunk)
        marked = np.flatnonzero(self._wanted[:-1] > 0)
        first: list[int] = marked[np.argsort(self._wanted[marked])][: min(most, self.room)].tolist()
        self._wanted[:] = 0
        return first

    def load(self, chunks: Iterable[int]) -> None:
        """Load chunks; the least recently used ones make room for them."""
        for chunk in chunks:
            states = self._load(chunk)
            if len(self._used) < self.room:
                place = len(self._used)
                if (place + 1) * self._each > len(self._packed):
                    size = min(max(2 * place, 4), self.room) * self._each
                    self._packed = np.concatenate([self._packed, np.empty(size - len(self._packed), dtype=np.uint8)])
            else:
                oldest, place = self._used.popitem(last=False)
                self._places[oldest] = ASIDE
            pack(states.reshape(-1), self._packed[place * self._each : (place + 1) * self._each])
            self._used[chunk] = place
            self._places[chunk] = 4 * place * self._each


class TileBackend:
    """The cells of a map in a store, over which kernels are run as its tiles are read.

    Parameters
    ----------
    store : Store
    cache_bytes : int
        Memory for decoded tiles.
    """

    def __init__(self, store: Store, cache_bytes: int) -> None:
        self.lock, self.limit = Lock(), int(cache_bytes)
        self._take(store)

    def _take(self, store: Store) -> None:
        self.__dict__.pop("exterior", None)
        self.store, self._records = store, {}  # type: tuple[Store, dict[tuple[int, ...], Record]]
        shape = (store.slices, *store.grid.shape)
        self._cache = Cache(shape, (store.depth, *store.tile), self.limit, self._chunk)
        self.job = Job(store, CellsInMemory(np.empty(0, np.bool_), np.empty(0, np.bool_)))

    @property
    def latest(self) -> Store:
        """The store as it is now, opened again if another process has changed it."""
        with self.lock:
            if self.store.is_past:
                self._take(Store.open(self.store.path))
            return self.store

    @property
    def done(self) -> float:
        """Share of the tiles that are done."""
        return self.latest.share_done

    def check_done(self) -> None:
        """Raise FileError unless all tiles are done."""
        if not self.latest.is_done:
            raise unfinished_map_error(self.store.path, self.done)

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Return the result of some work, all of which saw the store as it was at one moment."""
        with self.lock:
            while True:
                store = self.latest
                self.check_done()
                try:
                    result = work()
                except FileError:  # as where a file was replaced
                    if not self.store.is_past:
                        raise
                else:
                    if self.store is store and not store.is_past:
                        return result

    def query(self, kernel: Kernel, *arguments: Any, passed: object = None, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """See :meth:`cspace.map.backend.Backend.query`; rows are copied in pieces."""

        def run(*rows_and_out: Any) -> int:
            *rows, out = rows_and_out
            return self._run_in_turns(partial(_run, kernel, arguments), rows, out, passed, least)

        return lambda parts, out: self.at_one_moment(lambda: fill_in_pieces(run, parts, out))

    def _run_in_turns(self, kernel: Kernel, rows: list[Floats], out: NDArray[Any], passed: object, least: int) -> int:
        """Run a kernel until each tile that it reads was there; return the index of the first bad row, or -1.

        Rows that did not pass are known. The others are run again, with some of the tiles that were not there.
        """
        cache, live = self._cache, np.arange(len(out))
        cache.begin()
        while len(live):
            whole = len(live) == len(out)
            left = rows if whole else [part[live] for part in rows]
            values = np.empty(len(live), dtype=out.dtype)
            bad = in_chunks(partial(kernel, self._map, left, values), len(live), least)
            if bad >= 0:
                return bad
            out[live] = values
            live = live[values == passed]
            # A few rows may well fail in the first tiles that they come to.
            wanted = cache.wanted(len(live))
            if not wanted:
                break
            cache.load(wanted)
        return -1

    @property
    def _map(self) -> Map:
        """The record that compiled look-ups take; its tiles are those that are there now."""
        grid, cells = self.store.grid, self._cache.cells
        rotations = self.store.rotations.compiled(self.store.slice_of)
        return Map(cells, cells, rotations, grid.lower, grid.spacing, grid.upper, self.exterior.table)

    @cached_property
    def exterior(self) -> Exterior:
        """What is known outside the map."""
        if "exterior" in self.store.names:
            return Exterior(self.store.array("exterior"))
        box, outside = np.array(self.store.metadata["box"]), str(self.store.metadata["outside"])
        return Exterior.around(self.store.grid.shape, box, self.job.pairs, outside)

    def _chunk(self, number: int) -> Bytes:
        """States of a chunk, by its number."""
        store = self.store
        layer, *index = np.unravel_index(number, (store.layers, *store.counts))
        tile = tuple(int(i) for i in index)
        return store.states(tile, int(layer), self.record(tile))

    def record(self, tile: tuple[int, ...]) -> Record:
        """What is known of a tile."""
        if tile not in self._records:
            self._records[tile] = self.store.known(tile)
        return self._records[tile]


def fill_in_pieces(kernel: Kernel, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out`` by a kernel of rows, which are copied a piece at a time; return the first bad row, or -1."""
    for start in range(0, len(out), ROWS_IN_A_PIECE):
        piece = slice(start, start + ROWS_IN_A_PIECE)
        bad = kernel(*(as_contiguous(part[piece]) for part in parts), out[piece])
        if bad >= 0:
            return start + bad
    return -1


def _run(
    kernel: Kernel, arguments: tuple[Any, ...], map_: Map, rows: list[Floats], out: NDArray[Any], start: int, stop: int
) -> int:
    return kernel(map_, *arguments, *(part[start:stop] for part in rows), out[start:stop])

"""Decoded tiles in memory, up to a number of bytes, as compiled look-ups take them.

Look-ups are compiled for the whole map, whose cells they read by :func:`cspace.map.storage.state_in`; here is what it
does for cells that lie in tiles: a cell of a tile that is not there counts as FREE, and the tile is marked. So a
look-up is repeated, with other tiles loaded, until none is marked: each cell that it reads was then there at least
once, and its answer is the worst of all passes.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from math import prod

import numpy as np

from cspace.arrays import Bytes
from cspace.map.storage import ASIDE, MISSING, USED, TileCells, pack, read_only


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

"""TiledCSpace: a map in a store, looked up where it lies."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FREE, STATE_NAMES, Bools, Floats, Ints
from cspace.check import whole
from cspace.configuration_map import ConfigurationMap, Result
from cspace.engines.slices import Progress
from cspace.errors import ConfigurationError, FileError, InputError
from cspace.grid import Grid
from cspace.map.batches import EDGES_A_THREAD, Kernel, Query
from cspace.map.batches import own as owned
from cspace.map.derived import Lock
from cspace.map.exterior import Exterior
from cspace.map.storage import Map, read_only
from cspace.obstacles import Held
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.space import CSpace
from cspace.store.tiled import Record, Store
from cspace.threads import LEAST, in_chunks
from cspace.tiles.cache import Cache
from cspace.tiles.labels import Joined, label_all
from cspace.tiles.parts import overview_of, window_of
from cspace.tiles.update import update_store
from cspace.tiles.work import Job
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client

    from cspace.exact.queries import Exact


Leg = tuple[Callable[[], CSpace], Floats, Floats]
"""What opens a part of a map in memory, and two configurations in it."""

AROUND: Final = {2: 1024, 3: 256}
"""Cells along an axis of what is opened around configurations, by the number of axes."""

CACHE_BYTES: Final = 2**29
"""Memory for decoded tiles, unless ``cache_bytes`` says otherwise: 2 x 10^9 states."""

ROWS_IN_A_PIECE: Final = 2**18
"""Configurations, or edges, of a batch that are copied and answered at a time."""

_OF_A_WHOLE: Final = ("place", "placed", "remove")
"""What only a map answers that is whole, and in memory."""


class TiledCSpace(ConfigurationMap):
    """A certified map that stays in its store; look-ups read it tile by tile.

    :func:`cspace.build` makes it with a ``store``, and :func:`cspace.open` opens it. Its answers are those of the same
    map in memory, :class:`cspace.CSpace`, look-up by look-up. It takes one configuration, shape (dof,), or any batch,
    shape (..., dof); a batch is answered in pieces of 262,144 configurations, each of which reads a tile at most once.
    :meth:`window` gives a part of it as a map in memory, for everything else.

    A store that is half done opens too: :attr:`done` is the share, and look-ups refuse.

    Parameters
    ----------
    store : cspace.store.tiled.Store
    cache_bytes : int
        Memory for decoded tiles, of which there is always one; a state takes two bits.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> field = cspace.Workspace.from_array(np.eye(300, dtype=bool), 0.1)
    >>> space = cspace.build(field, cspace.Robot.disc(0.2), store="tiles.zarr", tile=128)
    >>> space.is_free([(5.0, 20.0), (5.0, 5.0)])
    array([ True, False])
    >>> space.window((0.0, 15.0), (10.0, 25.0)).clearance((5.0, 20.0)) > 1.0
    True
    """

    def __init__(self, store: Store, cache_bytes: int = CACHE_BYTES) -> None:
        self._lock = Lock()
        self._limit = int(cache_bytes)
        self._take(store)

    def _take(self, store: Store) -> None:
        self._store, self._records = store, {}  # type: tuple[Store, dict[tuple[int, ...], Record]]
        shape = (store.slices, *store.grid.shape)
        self._cache = Cache(shape, (store.depth, *store.tile), self._limit, self._chunk)
        self._job = Job(store, Held(np.empty(0, np.bool_), np.empty(0, np.bool_)))
        self._table: Ints | None = None
        self._parts: Joined | None = None

    @classmethod
    def open(cls, path: str | os.PathLike[str], cache_bytes: int = CACHE_BYTES) -> TiledCSpace:
        """The map in a store, whole or half done; see :func:`cspace.open`."""
        return cls(Store.open(path), cache_bytes)

    # ---- what the map is ---------------------------------------------------------------------------------------------

    @property
    def grid(self) -> Grid:
        return self._store.grid

    @property
    def robot(self) -> Robot:
        return self._store.robot

    @property
    def rotations(self) -> Rotations:
        return self._store.rotations

    @property
    def slice_of(self) -> Ints:
        return read_only(self._store.slice_of)

    @property
    def outside(self) -> str:
        return str(self._store.metadata["outside"])

    @property
    def margin(self) -> float:
        return float(self._store.metadata["margin"])

    @property
    def path(self) -> str:
        """The store's folder."""
        return str(self._store.path)

    @property
    def tile(self) -> tuple[int, ...]:
        """Cells of a tile along each axis."""
        return self._store.tile

    @property
    def done(self) -> float:
        """Share of the tiles that are done; 1 for a map that may be looked up."""
        store = self._now
        return 1.0 if store.metadata["box"] is not None else min(len(store.done()) / len(store), 1.0 - 2.0**-20)

    @property
    def version(self) -> int:
        """How many updates the map has seen."""
        return int(self._now.metadata["version"])

    def count(self) -> tuple[int, int, int]:
        self._check_done()
        store = self._now
        free, mixed, blocked = np.array(store.metadata["counts"])[store.slice_of].sum(axis=0).tolist()
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        share = "" if self.done == 1.0 else f", {self.done:.1%} of them done"
        return f"{len(self._store)} tiles of {' x '.join(map(str, self.tile))}{share}"

    @property
    def facts(self) -> dict[str, object]:
        cells = {"cells": dict(zip(STATE_NAMES, self.count(), strict=True))} if self.done == 1.0 else {}
        return {"tile": list(self.tile), "done_percent": round(100.0 * self.done, 4), **cells, "version": self.version}

    def __reduce__(self) -> tuple[Callable[..., TiledCSpace], tuple[str, int]]:
        return TiledCSpace.open, (self.path, self._limit)

    if not TYPE_CHECKING:  # which tells of such a name before it is asked for

        def __getattr__(self, name: str) -> NoReturn:
            if name.startswith("_") or not hasattr(CSpace, name):
                raise AttributeError(f"'TiledCSpace' object has no attribute {name!r}")
            raise self._elsewhere(name)

    @staticmethod
    def _elsewhere(name: str) -> ConfigurationError:
        mend = "ask a part of it: space.window(lower, upper)"
        if name in _OF_A_WHOLE:  # which parts refuse as well
            mend = "change its cells: space.update(cells, lower)"
        return ConfigurationError(name, "needs a map in memory", "this one stays in its store", mend)

    # ---- what FREE cells join ----------------------------------------------------------------------------------------

    def label(self, client: Client | None = None, progress: Progress | None = None) -> None:
        """Label the components of the map, tile by tile, and keep them in the store.

        :meth:`path_exists` does it at the first call, in threads of this process; here it is done beforehand, or on a
        cluster. After an update only the tiles that it changed are labelled again.

        Parameters
        ----------
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        progress : callable, optional
            Called with (tiles done, tiles in all).
        """

        def advance(number: int) -> None:
            if progress is not None:
                progress(number, len(self._store))

        self._at_one_moment(lambda: self._join(client, advance))

    def _join(self, client: Client | None = None, progress: Callable[[int], None] | None = None) -> Joined:
        if self._parts is None:
            label_all(self._job, client, progress)
            self._parts = Joined(self._store, Exterior(self._exterior))
        return self._parts

    @property
    def _components(self) -> Joined:
        return self._join()

    def legs(self, q0: ArrayLike, q1: ArrayLike) -> list[Leg]:
        """The tiles through which FREE cells join two configurations, one after the other, for a planner of your own.

        Parameters
        ----------
        q0, q1 : array-like, shape (dof,)
            FREE configurations in the grid.

        Returns
        -------
        list of (callable, ndarray of float64, ndarray of float64)
            What opens the tile as a map in memory, and the configurations, shape (dof,), from which and to which a path
            leads through it, yaw in [-pi, pi); the last one is the first one of the next tile. Empty where FREE cells
            do not join the two.
        """
        q0, q1 = (self.rotations.canonical(self.checked(q, name), name) for q, name in ((q0, "q0"), (q1, "q1")))
        cells = [self._cells_of(q) for q in (q0, q1)]
        tiles, crossings = self._at_one_moment(lambda: self._join().chain(*cells))
        if not tiles:
            return []
        turns = self.rotations.centers[crossings[:, 0]]
        points = [q0, *np.concatenate([self.grid.center_of(crossings[:, 1:]), turns], axis=1), q1]
        next_cells = [*crossings[:, 1:], cells[1][1:]]
        return [
            (partial(self._opened, tile, cell), points[k], points[k + 1])
            for k, (tile, cell) in enumerate(zip(tiles, next_cells, strict=True))
        ]

    def _opened(self, tile: tuple[int, ...], cell: Ints) -> CSpace:
        """A tile as a map in memory, with a cell that lies in it or beside it."""
        low, high = np.array([[part.start, part.stop] for part in self._store.cells(tile)]).T
        return self._part(np.minimum(low, cell), np.maximum(high, cell + 1))

    def nearest_free(self, q: ArrayLike) -> Floats:
        """As :meth:`cspace.CSpace.nearest_free`, of the FREE cells near there: half a tile to each side at most."""
        point = self.checked(q)
        middle = np.clip(point[: self.grid.dim], self.grid.lower, self.grid.upper)
        around = 0.5 * self.grid.spacing * np.minimum(self.tile, AROUND[self.grid.dim])
        return self.window(middle - around, middle + around).nearest_free(point)

    def _part(self, first: Ints, stop: Ints) -> CSpace:
        """The cells from a first one up to the one before another, in memory."""
        return self._at_one_moment(lambda: window_of(self._store, self._record, self._exterior, first, stop))

    # ---- parts, and changes ------------------------------------------------------------------------------------------

    def window(self, lower: ArrayLike, upper: ArrayLike) -> CSpace:
        """A part of the map, in memory, with the answers of the whole map within a box.

        It holds the cells of the box and as many around it as the robot reaches, also beyond the border of the map.
        Everything farther away is unknown: it is MIXED, and ``outside`` is "unknown". So a path is only proven not to
        exist where none does in the whole map, and a clearance ends at the window's border. A window of the whole map
        is the map, with its own ``outside``. With ``exact=True`` it uses the obstacles that the map was built on, where
        these are shapes, and else, as after an update, the outer cells; so it does at the border of a map that is free
        around it, where a shape sticks out of it.

        Parameters
        ----------
        lower, upper : array-like, shape (d,)
            Corners of the box, metres; what lies beyond the map is cut off.

        Returns
        -------
        CSpace
            Updates of the stored map do not reach it.

        Raises
        ------
        InputError
            If the box shares no cell with the map, or does not fit into memory.
        """
        grid = self.grid
        corners = [grid.coordinates(corner, name) for corner, name in ((lower, "lower"), (upper, "upper"))]
        if any(corner.ndim != 1 for corner in corners) or (corners[0] > corners[1]).any():
            rule = f"it must be a lower and an upper corner of {grid.dim} numbers each"
            raise InputError(
                "window", f"is from {lower!r} to {upper!r}", rule, "pass them in metres", value=(lower, upper)
            )
        first, last = map(grid.cell_of, corners)
        first, stop = np.maximum(first, 0), np.minimum(last + 1, grid.shape)
        if (first >= stop).any():
            rule = f"the map reaches from {grid.lower} to {grid.upper}"
            raise InputError(
                "window",
                f"from {lower!r} to {upper!r} holds no cell of the map",
                rule,
                "pass a part of that",
                value=(lower, upper),
            )
        return self._part(first + self._job.reach[0], stop + self._job.reach[1])

    def overview(self, most: int = 1024, client: Client | None = None) -> CSpace:
        """The whole map in larger cells, in memory: to be drawn, and to be looked up roughly.

        A cell is FREE where all that it is made of is FREE, BLOCKED where all is BLOCKED, and otherwise MIXED; so it is
        as proven as the map itself. Tiles are reduced in tasks.

        Parameters
        ----------
        most : int
            Cells along an axis, at most.
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        """
        count = whole(most, "most", 1, hint="pass e.g. 1024")
        return self._at_one_moment(lambda: overview_of(self._job, count, client))

    def update(
        self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None, client: Client | None = None
    ) -> Update:
        """Change a box of workspace cells, and with it the stored map, to what a build would give.

        Only the tiles that the change reaches are made anew. They take the place of the old ones at one moment, and
        :attr:`version` grows: look-ups, in this process or another, see the map before or after, and never between. An
        update that is killed has either not taken place, or has. Updates wait for each other.

        Parameters
        ----------
        cells, lower, inner
            As for :meth:`cspace.CSpace.update`.
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.

        Returns
        -------
        Update
        """
        patch = Patch.of(self.grid, cells, lower, inner)
        with self._lock:
            self._check_done()
            return update_store(self._now, patch, client, self._job.reach)

    # ---- who answers -------------------------------------------------------------------------------------------------

    def _classify(self) -> Query:
        from cspace.map.points import classify_few

        return partial(self._query, classify_few, FREE, LEAST)

    def _clearances(self) -> Query:
        return self._in_windows

    def _in_windows(self, parts: Sequence[Any], out: NDArray[Any]) -> int:
        """Fill ``out`` with the clearance of configurations, block by block of them."""
        return _in_pieces(self._clearances_of, parts, out)

    def _clearances_of(self, rows: Floats, out: Floats) -> int:
        near = AROUND[self.grid.dim] // 16
        bad = self._classify()([rows], np.empty(len(rows), dtype=np.uint8))
        if bad >= 0:
            return bad
        cells = self.grid.cell_of(rows[:, : self.grid.dim])
        blocks, block = np.unique(cells // AROUND[self.grid.dim], axis=0, return_inverse=True)
        for number in range(len(blocks)):
            own = np.flatnonzero(block.reshape(-1) == number)
            part = self._part(cells[own].min(axis=0) - near, cells[own].max(axis=0) + near + 1)
            out[own] = np.minimum(part.clearance(rows[own]), near * self.grid.spacing)
        return -1

    def _edges(self, number: int, exact: bool) -> Query:
        from cspace.map.edges import edges_are_free

        if exact:
            raise self._elsewhere("exact")

        def kernel(map_: Map, first: Floats, last: Floats, out: Bools) -> int:
            return edges_are_free(map_, None, first, last, out)

        return partial(self._query, kernel, True, EDGES_A_THREAD)

    @property
    def _exact(self) -> Exact:
        raise self._elsewhere("exact")

    def _query(self, kernel: Kernel, passed: int, least: int, parts: Sequence[Any], out: NDArray[Any]) -> int:
        """Fill ``out`` by a kernel of rows, shape (n, dof); ``passed`` is its result where all cells are FREE."""

        def work(*rows_and_out: Any) -> int:
            *rows, answers = rows_and_out
            return self._in_turns(kernel, rows, answers, passed, least)

        return self._at_one_moment(lambda: _in_pieces(work, parts, out))

    @property
    def _now(self) -> Store:
        """The store as it is now, if another process has changed it."""
        with self._lock:
            if self._store.is_past:
                self._take(Store.open(self.path))
            return self._store

    def _at_one_moment(self, work: Callable[[], Result]) -> Result:
        """The result of some work, all of which saw the map as it was at one moment."""
        with self._lock:
            while True:
                store = self._now
                self._check_done()
                try:
                    result = work()
                except FileError:  # as where a file was replaced
                    if not self._store.is_past:
                        raise
                else:
                    if self._store is store and not store.is_past:
                        return result

    def _in_turns(self, kernel: Kernel, rows: list[Floats], out: NDArray[Any], passed: int, least: int) -> int:
        """Run a kernel until each tile that it reads was there; the index of the first row that is not usable, or -1.

        Rows that did not pass are known. The others are run again, with some of the tiles that were not there.
        """
        cache, live = self._cache, np.arange(len(out))
        cache.begin()
        while len(live):
            whole = len(live) == len(out)
            own = rows if whole else [part[live] for part in rows]
            values = np.empty(len(live), dtype=out.dtype)
            bad = in_chunks(partial(_run, kernel, self._map, own, values), len(live), least)
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
        grid, cells = self.grid, self._cache.cells
        rotations = self.rotations.compiled(self._store.slice_of)
        return Map(cells, cells, rotations, grid.lower, grid.spacing, grid.upper, self._exterior)

    @property
    def _exterior(self) -> Ints:
        if self._table is None:
            box = np.array(self._store.metadata["box"])
            self._table = Exterior.around(self.grid.shape, box, self._job.pairs, self.outside).table
        return self._table

    def _chunk(self, number: int) -> NDArray[np.uint8]:
        """States of a chunk, by its number."""
        store = self._store
        layer, *index = np.unravel_index(number, (store.layers, *store.counts))
        tile = tuple(int(i) for i in index)
        return store.states(tile, int(layer), self._record(tile))

    def _record(self, tile: tuple[int, ...]) -> Record:
        if tile not in self._records:
            self._records[tile] = self._store.known(tile)
        return self._records[tile]

    def _check_done(self) -> None:
        if self._now.metadata["box"] is None:
            fault = f"is {self.done:.1%} done"
            mend = "run the same build again: only what is missing is done"
            raise FileError(self.path, fault, "a map is looked up once all of it is there", mend)


def _in_pieces(kernel: Kernel, parts: Sequence[Any], out: NDArray[Any]) -> int:
    """Fill ``out`` by a kernel of rows, which are copied a piece at a time; return the first bad row, or -1."""
    for start in range(0, len(out), ROWS_IN_A_PIECE):
        piece = slice(start, start + ROWS_IN_A_PIECE)
        bad = kernel(*(owned(part[piece]) for part in parts), out[piece])
        if bad >= 0:
            return start + bad
    return -1


def _run(kernel: Kernel, map_: Map, rows: list[Floats], out: NDArray[Any], start: int, stop: int) -> int:
    return kernel(map_, *(part[start:stop] for part in rows), out[start:stop])

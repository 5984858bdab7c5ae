"""TiledCSpace: a map in a store, looked up where it lies."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import STATE_NAMES, Floats, Ints
from cspace.check import check_count
from cspace.configuration_map import ConfigurationMap
from cspace.engines.slices import Progress
from cspace.errors import ConfigurationError, InputError
from cspace.map.batches import Query
from cspace.space import CSpace
from cspace.store import UNTILED, Store
from cspace.tiles.cache import TileBackend, fill_in_pieces
from cspace.tiles.labels import TiledLabels, label_all
from cspace.tiles.parts import overview_of, window_of
from cspace.tiles.update import update_store
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client

    from cspace.exact.proofs import ExactQueries


AROUND: Final = {2: 1024, 3: 256}
"""Cells along an axis of what is opened around configurations, by the number of axes."""

CACHE_BYTES: Final = 2**29
"""Memory for decoded tiles, unless ``cache_bytes`` says otherwise: 2 x 10^9 states."""

IN_A_PART: Final = "ask a part of it: space.window(lower, upper)"

BY_CELLS: Final = "change its cells: space.update(cells, lower)"

ONLY_IN_MEMORY: Final = {
    "workspace precision overlap_counts cell_states states_at": IN_A_PART,
    "overlap_count contains_robot obstacle_distance overlap_field with_overlap_field": IN_A_PART,
    "point_checker edge_checker clearance_checker": IN_A_PART,
    "reachable_bounds find_path find_widest_path sample_free": IN_A_PART,
    "save export to_xarray to_occupancy_grid to_costmap": IN_A_PART,
    "add_obstacle obstacles remove_obstacle": BY_CELLS,
}
"""What :class:`cspace.CSpace` can do and :class:`TiledCSpace` cannot, with the hint of the error; besides, ``exact``.

``docs/reference/stores.md`` lists them.
"""


class TiledCSpace(ConfigurationMap):
    """A certified map that stays in its store; look-ups read it tile by tile.

    :func:`cspace.build` makes it with a ``store``, and :func:`cspace.open` opens it. Its answers are those of the same
    map in memory, :class:`cspace.CSpace`, look-up by look-up. It takes one configuration, shape (size,), or any batch,
    shape (..., size); a batch is answered in pieces of 262,144 configurations, each of which reads a tile at most once.
    :meth:`window` gives a part of it as a map in memory, for everything else: the page on large maps has the list.

    A store that is half done opens too: :attr:`progress` is the share, and look-ups refuse.

    Parameters
    ----------
    store : cspace.store.Store
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
        self._tiles, self._parts = TileBackend(store, cache_bytes), None  # type: tuple[TileBackend, TiledLabels | None]

    @staticmethod
    def holds(store: Store) -> bool:
        """Return whether a map may stay in its store: not one with periodic axes, overlap counts or a field."""
        return "periodic_axes" not in store.metadata and not store.names.intersection(UNTILED)

    @classmethod
    def open(cls, path: str | os.PathLike[str], cache_bytes: int = CACHE_BYTES) -> TiledCSpace:
        """Open a stored map, whole or half done, and leave it in its store; see :func:`cspace.open`."""
        return cls.of_store(Store.open(path), cache_bytes)

    @classmethod
    def of_store(cls, store: Store, cache_bytes: int = CACHE_BYTES) -> TiledCSpace:
        """Return the map of an open store, after a check of its files except those of tiles.

        Raises ConfigurationError if the map must be in memory, and FileError if a file is missing or damaged.
        """
        if not cls.holds(store):
            what = (
                "has periodic axes"
                if "periodic_axes" in store.metadata
                else "carries overlap counts or an overlap field"
            )
            problem, rule = f"is False and {store.path} {what}", "only a map in memory can hold that"
            raise ConfigurationError("in_memory", problem, rule, "open it with in_memory=True")
        store.check_files()
        return cls(store, cache_bytes)

    # ---- what the map is ---------------------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        """The store's folder."""
        return str(self._kept.path)

    @property
    def tile(self) -> tuple[int, ...]:
        """Cells of a tile along each axis."""
        return self._kept.tile

    @property
    def progress(self) -> float:
        """Share of the tiles that are done; 1 for a map that may be looked up."""
        return self._tiles.done

    @property
    def version(self) -> int:
        """How many updates the map has seen."""
        return int(self._tiles.latest.metadata["version"])

    @property
    def _kept(self) -> Store:
        return self._tiles.store

    def count(self) -> tuple[int, int, int]:
        self._tiles.check_done()
        store = self._tiles.latest
        free, mixed, blocked = np.array(store.metadata["counts"])[store.slice_of].sum(axis=0).tolist()
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        share = "" if self.progress == 1.0 else f", {self.progress:.1%} of them done"
        return f"{len(self._kept)} tiles of {' x '.join(map(str, self.tile))}{share}"

    @property
    def _facts(self) -> dict[str, object]:
        cells = {"cells": dict(zip(STATE_NAMES, self.count(), strict=True))} if self.progress == 1.0 else {}
        return {
            "tile": list(self.tile),
            "done_percent": round(100.0 * self.progress, 4),
            **cells,
            "version": self.version,
        }

    def __reduce__(self) -> tuple[Callable[..., TiledCSpace], tuple[str, int]]:
        return TiledCSpace.open, (self.path, self._tiles.limit)

    # ---- what FREE cells join ----------------------------------------------------------------------------------------

    def compute_components(self, client: Client | None = None, progress: Progress | None = None) -> None:
        """Compute the components of the map, tile by tile, and keep them in the store.

        :meth:`is_connected` does it at the first call, in threads of this process; here it is done beforehand, or on a
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
                progress(number, len(self._kept))

        self._tiles.at_one_moment(lambda: self._join(client, advance))

    def _join(self, client: Client | None = None, progress: Callable[[int], None] | None = None) -> TiledLabels:
        if self._parts is None or self._parts.store is not self._kept:
            label_all(self._tiles.job, client, progress)
            self._parts = TiledLabels(self._kept, self._tiles.exterior)
        return self._parts

    @property
    def _components(self) -> TiledLabels:
        return self._join()

    def _tile_subproblems(self, q0: ArrayLike, q1: ArrayLike) -> list[tuple[Callable[[], CSpace], Floats, Floats]]:
        """The tiles through which FREE cells join two configurations, one after the other, for a planner of your own.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.

        Returns
        -------
        list of (callable, ndarray of float64, ndarray of float64)
            What opens the tile as a map in memory, and the configurations, shape (size,), from which and to which a
            path leads through it, yaw in [-pi, pi); the last one is the first one of the next tile. Empty where FREE
            cells do not join the two.
        """
        q0, q1 = (
            self.rotations.canonical(self._check_configurations(q, name), name) for q, name in ((q0, "q0"), (q1, "q1"))
        )
        cells = [self._cells_of(q) for q in (q0, q1)]
        tiles, crossings = self._tiles.at_one_moment(lambda: self._join().chain(*cells))
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
        low, high = np.array([[part.start, part.stop] for part in self._kept.cells(tile)]).T
        return self._part(np.minimum(low, cell), np.maximum(high, cell + 1))

    def nearest_free(self, q: ArrayLike) -> Floats:
        """As :meth:`cspace.CSpace.nearest_free`, of the FREE cells near there: half a tile to each side at most."""
        point = self._check_configurations(q)
        middle = np.clip(point[: self.grid.dim], self.grid.lower, self.grid.upper)
        around = 0.5 * self.grid.spacing * np.minimum(self.tile, AROUND[self.grid.dim])
        return self.window(middle - around, middle + around).nearest_free(point)

    def _part(self, first: Ints, stop: Ints) -> CSpace:
        """The cells from a first one up to the one before another, in memory."""
        tiles = self._tiles
        return tiles.at_one_moment(lambda: window_of(tiles.store, tiles.record, tiles.exterior.table, first, stop))

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
        return self._part(first + self._tiles.job.reach[0], stop + self._tiles.job.reach[1])

    def overview(self, max_cells: int = 1024, client: Client | None = None) -> CSpace:
        """The whole map in larger cells, in memory: to be drawn, and to be looked up roughly.

        A cell is FREE where all that it is made of is FREE, BLOCKED where all is BLOCKED, and otherwise MIXED; so it is
        as proven as the map itself. Tiles are reduced in tasks.

        Parameters
        ----------
        max_cells : int
            Cells along an axis, at most.
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        """
        count = check_count(max_cells, "max_cells", 1, hint="pass e.g. 1024")
        return self._tiles.at_one_moment(lambda: overview_of(self._tiles.job, count, client))

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
        with self._tiles.lock:
            self._tiles.check_done()
            return update_store(self._tiles.latest, patch, client, self._tiles.job.reach)

    # ---- kernels -----------------------------------------------------------------------------------------------------

    @property
    def _backend(self) -> TileBackend:
        return self._tiles

    def _clearances(self) -> Query:
        return partial(fill_in_pieces, self._clearances_in_windows)

    def _clearances_in_windows(self, rows: Floats, out: Floats) -> int:
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

    @property
    def _exact(self) -> ExactQueries:
        raise needs_memory("exact")


class OnlyInMemory:
    """Attribute of :class:`cspace.CSpace` that a map in a store refuses, with a hint."""

    def __init__(self, name: str, hint: str) -> None:
        self._refused = name, hint

    def __get__(self, space: TiledCSpace | None, kind: type[TiledCSpace]) -> NoReturn:
        if space is None:
            raise AttributeError(f"type object 'TiledCSpace' has no attribute {self._refused[0]!r}")
        raise needs_memory(*self._refused)


def needs_memory(name: str, hint: str = IN_A_PART) -> ConfigurationError:
    """Return the error for what only a map in memory can do."""
    return ConfigurationError(name, "needs a map in memory", "this one stays in its store", hint)


for _names, _hint in ONLY_IN_MEMORY.items():
    for _name in _names.split():
        setattr(TiledCSpace, _name, OnlyInMemory(_name, _hint))

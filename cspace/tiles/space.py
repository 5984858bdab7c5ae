"""TiledCSpace, a map that stays in its store."""

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
from cspace.tiles.labels import TiledLabels, label_tiles
from cspace.tiles.parts import build_overview, extract_window
from cspace.tiles.update import update_store
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client

    from cspace.exact.proofs import ExactQueries


WINDOW_CELLS: Final = {2: 1024, 3: 256}
"""Cells per axis of the windows that clearance queries open, by the dimension of the grid."""

CLEARANCE_LOSS_CELLS: Final = 2
"""Cells by which clearance may be below the distance, rounded up."""

DEFAULT_CACHE_BYTES: Final = 2**29
"""Default memory for decoded tiles, in bytes; holds 2 x 10^9 states."""

WINDOW_HINT: Final = "use a part of it: space.window(lower, upper)"

UPDATE_HINT: Final = "change its cells: space.update(cells, lower)"

ONLY_IN_MEMORY: Final = {
    "workspace precision overlap_counts cell_states states_at": WINDOW_HINT,
    "overlap_count contains_robot obstacle_distance": WINDOW_HINT,
    "point_checker edge_checker clearance_checker": WINDOW_HINT,
    "reachable_bounds find_path find_widest_path min_path_length sample_free": WINDOW_HINT,
    "save export to_xarray to_occupancy_grid to_costmap": WINDOW_HINT,
    "add_obstacle obstacles remove_obstacle": UPDATE_HINT,
}
"""Names of :class:`cspace.CSpace` that :class:`TiledCSpace` refuses, and the hint of the error.

``exact`` is refused too. ``docs/reference/stores.md`` lists the names.
"""


class TiledCSpace(ConfigurationMap):
    """A certified map that is read tile by tile.

    :func:`cspace.build` with a ``store`` builds it, and :func:`cspace.open` opens it. Queries return the results of the
    same map in memory, :class:`cspace.CSpace`. They take one configuration, shape (size,), or any batch, shape
    (..., size). Batches are processed in pieces of 262,144 configurations; each piece reads a tile at most once.
    :meth:`window` returns a part as a map in memory, which has all other methods; the page on large maps lists them.

    A partial store opens too: :attr:`progress` is the fraction done, and queries raise FileError.

    Parameters
    ----------
    store : cspace.store.Store
    cache_bytes : int
        Memory for decoded tiles, at least one; a state takes two bits.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> field = cspace.Workspace.from_array(np.eye(300, dtype=bool), 0.1)
    >>> space = cspace.build(field, cspace.Robot.disc(0.2), store="tiles.zarr", tile=128)
    >>> space.is_free([(5.0, 20.0), (5.0, 5.0)]).tolist()
    [True, False]
    >>> space.window((0.0, 15.0), (10.0, 25.0)).clearance((5.0, 20.0)) > 1.0
    True
    """

    def __init__(self, store: Store, cache_bytes: int = DEFAULT_CACHE_BYTES) -> None:
        self._tiles, self._labels = TileBackend(store, cache_bytes), None  # type: tuple[TileBackend, TiledLabels | None]

    @staticmethod
    def _holds(store: Store) -> bool:
        """Return True unless tiles exclude the map.

        These are maps with overlap counts.
        """
        return not store.names.intersection(UNTILED)

    @classmethod
    def open(cls, path: str | os.PathLike[str], cache_bytes: int = DEFAULT_CACHE_BYTES) -> TiledCSpace:
        """Open a stored map, complete or partial; see :func:`cspace.open`."""
        return cls._of_store(Store.open(path), cache_bytes)

    @classmethod
    def _of_store(cls, store: Store, cache_bytes: int = DEFAULT_CACHE_BYTES) -> TiledCSpace:
        """Return the map of an open store.

        All files are checked, except tiles. Raises ConfigurationError if the map must be in memory, and FileError if a
        file is missing or damaged.
        """
        if not cls._holds(store):
            raise ConfigurationError(
                "in_memory",
                f"is False, but {store.path} has overlap counts",
                "only a map in memory supports them",
                "open it with in_memory=True",
            )
        store.check_files()
        return cls(store, cache_bytes)

    # ---- properties --------------------------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        """Folder of the store."""
        return str(self._kept.path)

    @property
    def tile(self) -> tuple[int, ...]:
        """Cells of a tile along each axis."""
        return self._kept.tile

    @property
    def progress(self) -> float:
        """Fraction of tiles built; queries need 1."""
        return self._tiles.share_done

    @property
    def version(self) -> int:
        """Number of updates since the build."""
        return int(self._tiles.latest.metadata["version"])

    @property
    def _kept(self) -> Store:
        return self._tiles.store

    def count(self) -> tuple[int, int, int]:
        """Return the number of FREE, MIXED and BLOCKED cells."""
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
        """Pickle the path, not the content of the store."""
        return TiledCSpace.open, (self.path, self._tiles.limit)

    # ---- connectivity ------------------------------------------------------------------------------------------------

    def compute_components(self, client: Client | None = None, progress: Progress | None = None) -> None:
        """Compute and store the connected components.

        The first :meth:`is_connected` calls this in threads of this process; call it to do so earlier or on a cluster.
        After an update only the changed tiles are labelled again.

        Parameters
        ----------
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        progress : callable, optional
            Called with (tiles done, number of tiles).
        """

        def advance(count: int) -> None:
            if progress is not None:
                progress(count, len(self._kept))

        self._tiles.at_one_moment(lambda: self._update_labels(client, advance))

    def _update_labels(
        self, client: Client | None = None, progress: Callable[[int], None] | None = None
    ) -> TiledLabels:
        """Return current labels, computing missing ones."""
        if self._labels is None or self._labels.store is not self._kept:
            label_tiles(self._tiles.job, client, progress)
            self._labels = TiledLabels(self._kept, self._tiles.exterior)
        return self._labels

    @property
    def _components(self) -> TiledLabels:
        return self._update_labels()

    def _tile_subproblems(self, q0: ArrayLike, q1: ArrayLike) -> list[tuple[Callable[[], CSpace], Floats, Floats]]:
        """Split a planning problem into one per tile.

        The tiles form a chain joined by FREE cells.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.

        Returns
        -------
        list of (callable, ndarray of float64, ndarray of float64)
            For each tile, a function that returns it as a map in memory, and the start and goal in it, shape (size,),
            yaw in [-pi, pi). Each goal is the start of the next tile. Empty if no FREE cells connect q0 and q1.
        """
        q0, q1 = (
            self.rotations.make_canonical(self._check_configurations(q, name), name)
            for q, name in ((q0, "q0"), (q1, "q1"))
        )
        cells = [self._cells_of(q) for q in (q0, q1)]
        tiles, crossings = self._tiles.at_one_moment(lambda: self._update_labels().chain(*cells))
        if not tiles:
            return []
        rotations = self.rotations.centers[crossings[:, 0]]
        points = [q0, *np.concatenate([self.grid.center_of(crossings[:, 1:]), rotations], axis=1), q1]
        next_cells = [*crossings[:, 1:], cells[1][1:]]
        return [
            (partial(self._open_tile, tile, cell), points[k], points[k + 1])
            for k, (tile, cell) in enumerate(zip(tiles, next_cells, strict=True))
        ]

    def _open_tile(self, tile: tuple[int, ...], cell: Ints) -> CSpace:
        """Return a tile and a cell as a map in memory."""
        low, high = np.array([[part.start, part.stop] for part in self._kept.cells(tile)]).T
        return self._window_of_cells(np.minimum(low, cell), np.maximum(high, cell + 1))

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Return the nearest FREE configuration within half a tile.

        See :meth:`cspace.CSpace.nearest_free`.
        """
        point = self._check_configurations(q)
        center = np.clip(point[: self.grid.dim], self.grid.lower, self.grid.upper)
        half_side = 0.5 * self.grid.spacing * np.minimum(self.tile, WINDOW_CELLS[self.grid.dim])
        return self.window(center - half_side, center + half_side).nearest_free(point)

    def _window_of_cells(self, start: Ints, stop: Ints) -> CSpace:
        """Return the cells [start, stop) as a map."""
        tiles = self._tiles
        return tiles.at_one_moment(lambda: extract_window(tiles.store, tiles.record, tiles.exterior.table, start, stop))

    # ---- windows and updates -----------------------------------------------------------------------------------------

    def window(self, lower: ArrayLike, upper: ArrayLike) -> CSpace:
        """Return the map of a box, in memory.

        It holds the cells of the box and the cells that the robot reaches from it, also beyond the boundary of the map.
        All other cells count as MIXED, and ``outside`` is "unknown". So the window proves two configurations
        disconnected only if they are so in the whole map, and clearances end at the window's boundary. A window of the
        whole map is the map, with its own ``outside``.

        With ``exact=True`` the window uses the shapes that the map was built on. It uses the outer cells instead if the
        map was built on cells, after an update, and if a shape extends beyond a map with a free exterior.

        Parameters
        ----------
        lower, upper : array-like, shape (d,)
            Corners of the box, metres; the box is clipped to the map.

        Returns
        -------
        CSpace
            Independent of later updates of the stored map.

        Raises
        ------
        InputError
            If the box shares no cell with the map, or exceeds the memory.
        """
        grid = self.grid
        corners = [grid.coordinates(corner, name) for corner, name in ((lower, "lower"), (upper, "upper"))]
        problem = f"is from {lower!r} to {upper!r}"
        if any(corner.ndim != 1 for corner in corners) or (corners[0] > corners[1]).any():
            rule = f"it must be a lower and an upper corner of {grid.dim} numbers each"
            raise InputError("window", problem, rule, "pass them in metres", value=(lower, upper))
        start, last = map(grid.cell_of, corners)
        start, stop = np.maximum(start, 0), np.minimum(last + 1, grid.shape)
        if (start >= stop).any():
            rule = f"it must overlap the map, from {grid.lower} to {grid.upper}"
            raise InputError("window", problem, rule, "pass a part of the map", value=(lower, upper))
        return self._window_of_cells(start + self._tiles.job.reach[0], stop + self._tiles.job.reach[1])

    def overview(self, max_cells: int = 1024, client: Client | None = None) -> CSpace:
        """Return the whole map in coarse cells, in memory.

        It serves plots and rough queries. A coarse cell is FREE if all its cells are FREE, BLOCKED if all are BLOCKED,
        and else MIXED; so the overview is certified like the map.

        Parameters
        ----------
        max_cells : int
            Maximum number of cells along an axis.
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        """
        count = check_count(max_cells, "max_cells", 1, hint="pass e.g. 1024")
        return self._tiles.at_one_moment(lambda: build_overview(self._tiles.job, count, client))

    def update(
        self, cells: ArrayLike, lower: Sequence[int], *, inner: ArrayLike | None = None, client: Client | None = None
    ) -> Update:
        """Replace a box of workspace cells; update the map.

        The result equals a new build; only the affected tiles are rebuilt. They replace the old tiles atomically, and
        :attr:`version` grows: queries, in any process, see the map before or after the update, even if it is killed.
        Concurrent updates wait for each other.

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
        """Fill ``out`` with clearances, in windows of blocks."""
        max_distance = WINDOW_CELLS[self.grid.dim] // 16
        margin = max_distance + CLEARANCE_LOSS_CELLS
        bad = self._classify()([rows], np.empty(len(rows), dtype=np.uint8))
        if bad >= 0:
            return bad
        cells = self.grid.cell_of(rows[:, : self.grid.dim])
        blocks, block_of = np.unique(cells // WINDOW_CELLS[self.grid.dim], axis=0, return_inverse=True)
        for block in range(len(blocks)):
            chosen = np.flatnonzero(block_of.reshape(-1) == block)
            lower, upper = cells[chosen].min(axis=0), cells[chosen].max(axis=0)
            window = self._window_of_cells(lower - margin, upper + margin + 1)
            # Beyond `max_distance` the window's boundary may be nearer than any cell that is not FREE.
            out[chosen] = np.minimum(window.clearance(rows[chosen]), max_distance * self.grid.spacing)
        return -1

    @property
    def _exact(self) -> ExactQueries:
        raise in_memory_error("exact")


class RefusedAttribute:
    """Descriptor for attributes that stored maps refuse."""

    def __init__(self, name: str, hint: str) -> None:
        self._refused = name, hint

    def __get__(self, space: TiledCSpace | None, kind: type[TiledCSpace]) -> NoReturn:
        """Raise ConfigurationError for maps, AttributeError for the class."""
        if space is None:
            raise AttributeError(f"type object 'TiledCSpace' has no attribute {self._refused[0]!r}")
        raise in_memory_error(*self._refused)


def in_memory_error(name: str, hint: str = WINDOW_HINT) -> ConfigurationError:
    """Return the error of methods for maps in memory."""
    return ConfigurationError(name, "needs a map in memory", "this one stays in its store", hint)


for _names, _hint in ONLY_IN_MEMORY.items():
    for _name in _names.split():
        setattr(TiledCSpace, _name, RefusedAttribute(_name, _hint))

"""TiledCSpace, a map that stays in its folder."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property, partial
from threading import RLock
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace import CSpace, Grid
from cspace._tiles.folder import LAST_TO_STOP, TileFolder, grow_box
from cspace._tiles.labels import TiledComponents
from cspace._tiles.open_tiles import OpenTiles
from cspace.errors import FileError, InputError
from cspace.inside import (
    FARTHEST_CELL,
    Bools,
    ConfigurationMap,
    Contents,
    Floats,
    Ints,
    States,
    StrPath,
    check_count,
    check_point,
)

if TYPE_CHECKING:
    from distributed import Client

DEFAULT_CACHE_BYTES: Final = 2**30
"""Default memory for open tiles, in bytes."""


class TiledCSpace(ConfigurationMap):
    """A certified map in a folder of tiles.

    :func:`cspace.build` with a ``store`` builds it, and :func:`cspace.open` opens it. Queries
    return the results of the same map in memory, :class:`cspace.CSpace`; :meth:`clearance` is at
    most the width of the halo of a tile, less two cells. A query groups its configurations by tile,
    so that each tile is read once. :meth:`window` returns a part as a map in memory, which has all
    other methods.

    A partial map opens too: :attr:`progress` is the fraction done, and queries raise FileError.

    Parameters
    ----------
    folder : cspace._tiles.folder.TileFolder
    cache_bytes : int
        Memory for open tiles; at least one stays open.

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

    def __init__(self, folder: TileFolder, cache_bytes: int = DEFAULT_CACHE_BYTES) -> None:
        """Store the folder; queries read tiles when needed."""
        self._folder = folder
        self._lock = RLock()
        self._cache_bytes = int(cache_bytes)
        self._tiles = OpenTiles(folder, self._cache_bytes)
        self._labels: TiledComponents | None = None

    def __reduce__(self) -> tuple[Callable[..., TiledCSpace], tuple[str, int]]:
        """Pickle the path, not the tiles."""
        return open_tiles, (self.path, self._cache_bytes)

    def _map_lock(self) -> AbstractContextManager[Any]:
        """Return the lock of a complete map, held while tiles are read.

        One thread at a time opens and closes tiles.

        Raises FileError if the map is not complete.
        """
        if self._folder.frame.exterior is None:
            problem = f"is {self.progress:.1%} done"
            rule = "a map must be complete to be read"
            raise FileError(self.path, problem, rule)
        return self._lock

    # ---- properties ------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        """Folder of the map."""
        return str(self._folder.path)

    @property
    def tile(self) -> tuple[int, ...]:
        """Cells of a tile along each axis, without halo."""
        return self._folder.tile

    @property
    def progress(self) -> float:
        """Fraction of tiles built; open a complete map again."""
        return self._folder.progress

    @property
    def grid(self) -> Grid:
        """Grid of positions."""
        return self._folder.grid

    @property
    def _map_contents(self) -> Contents:
        return self._folder.frame

    @property
    def exact(self) -> NoReturn:
        """Raise InputError: only maps in memory, such as a :meth:`window`, have it."""
        rule = "geometry decides the MIXED cells of maps in memory, such as space.window"
        raise InputError("exact", "is that of a map in tiles", rule)

    def count(self) -> tuple[int, int, int]:
        """Return the number of FREE, MIXED and BLOCKED cells."""
        with self._map_lock():
            free, mixed, blocked = self._folder.layout["counts"]
        return free, mixed, blocked

    @property
    def _summary(self) -> str:
        sides = " x ".join(map(str, self.tile))
        share = "" if self.progress == 1.0 else f", {self.progress:.1%} of them done"
        return f"{len(self._folder)} tiles of {sides}{share}"

    @property
    def _facts(self) -> dict[str, object]:
        """Plain values by name that describe the map, except its grid."""
        facts = {"tile": list(self.tile), "done_percent": round(100.0 * self.progress, 4)}
        if self.progress == 1.0:
            facts["cells"] = self._count_by_name()
        return facts

    # ---- queries ---------------------------------------------------------------------------------

    def _find_unusable(self, rows: Floats) -> int:
        """Return the first unusable configuration's index, or -1."""
        return self._tiles.frame._find_unusable(rows)

    def _query_parts(
        self, query: Callable[[CSpace, Floats], Any], rows: Floats, out: NDArray[Any], reach: int
    ) -> int:
        """Query parts of the map in memory, and write the results.

        ``rows`` are configurations, shape (n, size), and ``out`` has shape (n,). Each row is
        queried in a part with all cells within ``reach``, a number of cells. Returns the index of
        the first unusable row, or -1.
        """
        with self._map_lock():
            bad = self._find_unusable(rows)
            if bad < 0:
                cells = self.grid.cell_of(rows[:, : self.dim])
                for space, chosen in self._tiles.parts_near(cells, reach):
                    out[chosen] = query(space, rows[chosen])
            return bad

    def _write_states(self, rows: Floats, out: States) -> int:
        # Parts classify the center of the cell in which the whole map locates a configuration,
        # because rounding could locate a point on a border differently in a part.
        def classify(space: CSpace, points: Floats) -> States:
            return space.classify(self._centers_of(self._cells_of(points)))

        return self._query_parts(classify, rows, out, reach=0)

    @cached_property
    def _look_up_state(self) -> Callable[[tuple[float, ...]], int]:
        """Look-up of one configuration's state, as of many, but without arrays."""
        grid = self.grid
        axes = list(zip(grid.lower, grid.upper, grid.shape, strict=True))
        tiles = list(zip(self.tile, self._folder.counts, strict=True))

        def look_up(numbers: tuple[float, ...]) -> int:
            """Return the state; below 0 if the numbers are not usable."""
            with self._map_lock():
                space = self._tiles.frame
                state: int = space._look_up_state(numbers)
                if state < 0:
                    return state
                cells = []
                for x, (lower, upper, count) in zip(map(float, numbers), axes, strict=False):
                    place = min(max((x - lower) / grid.spacing, -FARTHEST_CELL), FARTHEST_CELL)
                    cell = math.floor(place)
                    cells.append(cell - 1 if cell == count and x <= upper else cell)
                if all(0 <= cell < count for cell, count in zip(cells, grid.shape, strict=True)):
                    number = 0
                    for cell, (side, count) in zip(cells, tiles, strict=True):
                        number = number * count + cell // side
                    space = self._tiles.tile(number).space
                # As of many, a part is asked for the center of the cell of the whole map.
                centers = [
                    lower + grid.spacing * (cell + 0.5)
                    for cell, lower in zip(cells, grid.lower, strict=True)
                ]
                return int(space._look_up_state((*centers, *numbers[len(cells) :])))

        return look_up

    def _centers_of(self, cells: Ints) -> Floats:
        """Return the configurations at the centers of cells, shape (n, size).

        Cells ``(rotation, x, ...)`` have the shape (n, 1 + d).
        """
        rotations, *position_cells = cells.T
        positions = self.grid.center_of(np.stack(position_cells, axis=1))
        return np.concatenate([positions, self.rotations.centers[rotations]], axis=1)

    def _write_motions(self, starts: Floats, ends: Floats, out: Bools) -> int:
        with self._map_lock():
            ends_in_turn = np.stack([starts, ends], axis=1).reshape(-1, self.size)
            # A motion has two rows; -1, for none, stays -1.
            bad = self._find_unusable(ends_in_turn) // 2
            if bad < 0:
                self._tiles.motions_are_free(starts, ends, out)
            return bad

    def _count_free_tubes(self, starts: Floats, ends: Floats, radii: Floats, counts: Ints) -> None:
        first = starts[:, : self.dim]
        tested = ends[:, : counts.max(initial=0), : self.dim]
        # Refused rows may lie anywhere, so that those farther away than the map is long are left
        # out. Parts may do so, because all beyond a part counts as MIXED.
        longest = self.grid.spacing * max(self.grid.shape)
        with np.errstate(over="ignore"):
            steps = np.abs(tested - first[:, np.newaxis])
        steps[~(steps <= longest)] = 0.0
        metres = steps.max(initial=0.0) + radii[:, : self.dim].max(initial=0.0)
        reach = math.ceil(min(metres, longest) / self.grid.spacing) + 1  # cells
        with self._map_lock():
            for space, chosen in self._tiles.parts_near(self.grid.cell_of(first), reach):
                part = counts[chosen]
                space._count_free_tubes(starts[chosen], ends[chosen], radii[chosen], part)
                counts[chosen] = part

    def _write_clearances(self, rows: Floats, out: Floats) -> int:
        # Cells beyond the halo of a tile count as not FREE, and a clearance may be two cells too
        # small. So a value above the halo less two cells would depend on the tile.
        def measure(space: CSpace, points: Floats) -> Floats:
            clearances = np.empty(len(points))
            space._write_clearances(points, clearances)
            return clearances

        bad = self._query_parts(measure, rows, out, self._folder.halo - 1)
        np.minimum(out, (self._folder.halo - 2) * self.grid.spacing, out=out)
        return bad

    # ---- connectivity ----------------------------------------------------------------------------

    def compute_components(
        self, client: Client | None = None, progress: Callable[[int, int], None] | None = None
    ) -> None:
        """Compute the connected components, which the map keeps while it is open.

        The first :meth:`is_connected` calls this in threads of this process; call it to do so
        earlier or on a cluster.

        Parameters
        ----------
        client : dask.distributed.Client, optional
            As for :func:`cspace.build`.
        progress : callable, optional
            Called with (tiles done, number of tiles).
        """
        with self._map_lock():
            self._labels = self._labels or TiledComponents(self._tiles, client, progress)

    @property
    def _components(self) -> TiledComponents:
        self._labels = self._labels or TiledComponents(self._tiles)
        return self._labels

    def subproblems(
        self, q0: ArrayLike, q1: ArrayLike
    ) -> list[tuple[Callable[[], CSpace], Floats, Floats]]:
        """Split a planning problem into one per tile.

        The tiles form a chain joined by FREE cells.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,)
            FREE configurations in the grid.

        Returns
        -------
        list of (callable, ndarray of float64, ndarray of float64)
            For each tile, a function that returns it as a map in memory, and the start and goal in
            it, shape (size,), yaw in [-pi, pi). Each goal is the start of the next tile. Empty if
            no FREE cells connect q0 and q1.
        """
        make_canonical = self.rotations.make_canonical
        start = make_canonical(self._check_configurations(q0, "q0"), "q0")
        goal = make_canonical(self._check_configurations(q1, "q1"), "q1")
        with self._map_lock():
            tiles, cells = self._components.chain(self._cells_of(start), self._cells_of(goal))
        # Each subproblem leads from the start or a crossing to the next crossing or the goal.
        crossings = self._centers_of(np.array(cells, dtype=np.int64).reshape(-1, 1 + self.dim))
        starts = [start, *crossings]
        goals = [*crossings, goal]
        open_parts = [partial(self._open_part, tile) for tile in tiles]
        return list(zip(open_parts, starts, goals, strict=False))  # no tiles without a chain

    def _open_part(self, tile: int) -> CSpace:
        """Return a tile as a map in memory."""
        with self._map_lock():
            return self._tiles.tile(tile).space

    def nearest_free(self, q: ArrayLike) -> Floats:
        """Return the center of the nearest FREE cell within half a tile.

        See :meth:`cspace.CSpace.nearest_free`.
        """
        grid = self.grid
        point = self.check_configuration(q, "q")
        center = np.clip(point[: grid.dim], grid.lower, grid.upper)
        # Maximum distance along an axis at which :meth:`TiledCSpace.nearest_free` searches, in
        # cells.
        reach = grid.spacing * np.minimum(0.5 * np.array(self.tile), 512)
        return self.window(center - reach, center + reach).nearest_free(point)

    def path_obstacle_distance(self, path: ArrayLike) -> float:
        """Return NaN, because the geometry of a tiled map is not asked."""
        self._check_configurations(path, "path")
        return math.nan

    # ---- parts -----------------------------------------------------------------------

    def window(self, lower: ArrayLike, upper: ArrayLike) -> CSpace:
        """Return the map of a box, in memory.

        It holds the cells of the box and the cells that the robot reaches from it, also beyond the
        boundary of the map if the space there is free. All other cells count as MIXED, and
        ``outside`` is "unknown". So the window proves two configurations disconnected only if they
        are so in the whole map, and clearances end at the window's boundary. A window of the whole
        map is the map, with its own ``outside``.

        Its :attr:`cspace.CSpace.exact` uses the shapes that the map was built on. It uses the outer
        cells instead if the map was built on cells, and if a shape extends beyond a map with a free
        exterior.

        Parameters
        ----------
        lower, upper : array-like, shape (d,)
            Corners of the box, metres; the box is clipped to the map.

        Returns
        -------
        CSpace
            Its updates leave the tiled map as it is.

        Raises
        ------
        InputError
            If the box shares no cell with the map, or exceeds the memory.
        """
        folder = self._folder
        grid = self.grid
        box = np.stack(
            [
                check_point(lower, "lower of the window", grid.dim),
                check_point(upper, "upper of the window", grid.dim),
            ]
        )
        # Two corners, shape (2, d): the first cell, and the cell after the last one.
        cells = folder.clip(grid.cell_of(box) + LAST_TO_STOP)
        if (box[0] > box[1]).any() or (cells[0] >= cells[1]).any():
            problem = f"is from {box[0].tolist()} to {box[1].tolist()}"
            rule = f"it must be a box in the map, {grid.lower} to {grid.upper}"
            raise InputError("window", problem, rule)
        reached = grow_box(cells, folder.reach)
        inside = folder.clip(reached)
        is_whole = (inside[1] - inside[0] == grid.shape).all()
        with self._map_lock():
            if is_whole:
                return self._tiles.window(inside, folder.frame.exterior)
            return self._tiles.window(reached)

    def overview(self, max_cells: int = 1024) -> CSpace:
        """Return the whole map in coarse cells, in memory.

        It serves plots and rough queries. A coarse cell is FREE if all its cells are FREE, BLOCKED
        if all are BLOCKED, and else MIXED; so the overview is certified like the map.

        Parameters
        ----------
        max_cells : int
            Maximum number of cells along an axis.
        """
        count = check_count(max_cells, "max_cells", 1)
        with self._map_lock():
            return self._tiles.overview(count)


def open_tiles(path: StrPath, cache_bytes: int) -> TiledCSpace:
    """Open a tiled map, complete or partial; see :func:`cspace.open`."""
    return TiledCSpace(TileFolder.open(path), cache_bytes)

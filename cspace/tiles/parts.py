"""Open tiles of a map, and parts of the map in memory.

All outside a part is unknown, so MIXED there; each proof by a part holds in the whole map.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import MIXED, Bools, Floats, Ints
from cspace.limits import WORKSPACE_CELL_BYTES, check_memory, map_bytes
from cspace.map.contents import Contents
from cspace.map.exterior import UNKNOWN, Exterior
from cspace.space import CSpace
from cspace.tiles.folder import ONE_MORE, Index, TileFolder, as_box, grow
from cspace.tiles.motions import cut_motions
from cspace.workspace import Workspace

INSIDE, BORDER, FAR = 0, 1, 2
"""Places of pieces: of a motion in the grid; of one that leaves it, up to a cell outside; farther."""

Kept = TypeVar("Kept", Contents, CSpace)

Ask = Callable[[CSpace, Floats], Any]
"""Query of some configurations on a map in memory."""


class OpenTiles:
    """The tiles of a map at one moment, read when they are needed.

    Parameters
    ----------
    folder : TileFolder
        Complete folder.
    max_bytes : int
        Memory for the states and obstacles of open tiles, and for as many parts; one stays open.
    """

    def __init__(self, folder: TileFolder, max_bytes: int) -> None:
        self.folder, self.max_bytes = folder, max_bytes
        self._tiles: OrderedDict[Index, Contents] = OrderedDict()
        self._parts: OrderedDict[Index, CSpace] = OrderedDict()

    @cached_property
    def frame(self) -> CSpace:
        """Map of the space outside the grid; in the grid, it proves less than the tiles."""
        return CSpace(self.folder.frame)

    def contents(self, index: Index) -> Contents:
        """Return what a tile holds: its interior, and its halo in the grid."""
        return self._keep(self._tiles, index, lambda: self.folder.read_tile(index))

    def part(self, index: Index, beyond: bool = False) -> CSpace:
        """Return a tile as a map in memory; with ``beyond``, also its halo outside the grid."""
        if not beyond:
            return self._keep(self._parts, index, lambda: CSpace(self.contents(index)))
        corners = grow(self.folder.interior(index), self.folder.halo)
        return self._keep(self._parts, (*index, 1), lambda: self.window(corners))

    def _keep(self, cache: OrderedDict[Index, Kept], key: Index, make: Callable[[], Kept]) -> Kept:
        """Return an entry of a cache, made if it is new, and drop those not used for longest."""
        if key not in cache:
            cache[key] = make()
            size = (self.folder.slices + WORKSPACE_CELL_BYTES) * cache[key].grid.size
            while len(cache) > max(1, self.max_bytes // size):
                cache.popitem(last=False)
        cache.move_to_end(key)
        return cache[key]

    def window(self, corners: Ints, exterior: Exterior | None = None) -> CSpace:
        """Return a box of cells, in the grid or not, as a map in memory.

        All outside it is unknown, unless the states outside are given. Raises InputError if the map
        does not fit into memory.
        """
        folder, frame = self.folder, self.folder.frame
        inside = folder.clip(corners)
        if folder.outside == "blocked":
            corners = inside  # nothing is FREE outside
        grid = folder.sub_grid(corners)
        needed = map_bytes(grid.shape, folder.slices) + WORKSPACE_CELL_BYTES * grid.size
        check_memory(needed, "the window", grid, hint="use a smaller window")
        states = np.empty((folder.slices, *grid.shape), dtype=np.uint8)
        outer, inner = np.zeros((2, *grid.shape), dtype=np.bool_)
        for row, part in zip(folder.exterior.table, states, strict=True):
            part[...] = row[-1]
            mixed = np.clip(row[:-1].reshape(2, -1) + ONE_MORE - corners[0], 0, grid.shape)
            part[as_box(mixed)] = MIXED
        for index in folder.tiles_in(corners):
            tile, interior = self.contents(index), folder.interior(index)
            both = np.clip(interior, *corners)
            here, there = as_box(both - corners[0]), as_box(both - folder.cells(index)[0])
            states[(slice(None), *here)] = np.asarray(tile.states)[(slice(None), *there)]
            outer[here] = tile.workspace.outer[there]
            inner[here] = tile.workspace.inner[there]
        shapes, whole = frame.workspace.shapes, folder.grid
        if shapes is not None and (inside != corners).any():
            # Parts of shapes beyond the map do not count if the space outside is free.
            low, high = zip(*(shape.outer.bounds for shape in shapes), strict=True)
            fits = (np.array(low) >= whole.lower).all() and (np.array(high) <= whole.upper).all()
            shapes = shapes if fits else None
        source = f"a window of {folder.path.name}"
        workspace = Workspace(grid, outer, inner, source=source, shapes=shapes)
        shared = folder.robot, folder.rotations, folder.slice_of, states
        outside = folder.outside if exterior else UNKNOWN
        return CSpace(Contents(workspace, *shared, outside, folder.margin, exterior=exterior))

    # ---- queries ---------------------------------------------------------------------------------

    def ask(self, query: Ask, rows: Floats, out: NDArray[Any], reach: float | None = None) -> None:
        """Write the answers for configurations, shape (n, size), to ``out``.

        A query reads only the cell of a configuration, or all within ``reach`` metres along each axis.
        A tile answers it, a window if the reach is longer than the halo, or the frame if no cell of
        the grid is near.
        """
        grid = self.folder.grid
        cells = 0 if reach is None else math.ceil(reach / grid.spacing) + 1
        position = grid.cell_of(rows[:, : grid.dim])
        if reach is None:  # a point on a border belongs to the cell that the whole map gives it
            turns = self.folder.rotations.centers[self.folder.rotations._cells_of(rows)]
            rows = np.concatenate([grid.center_of(position), turns], axis=1)
        near = ((position >= -cells) & (position < np.add(grid.shape, cells))).all(axis=1)
        if not near.all():
            out[~near] = query(self.frame, rows[~near])
        tiles = np.clip(position, 0, np.subtract(grid.shape, 1)) // self.folder.tile
        for index, chosen in group_rows(tiles, np.flatnonzero(near)):
            around = position[chosen]
            corners = grow(np.stack([around.min(axis=0), around.max(axis=0) + 1]), cells)
            out[chosen] = query(self._map_around(index, corners), rows[chosen])

    def _map_around(self, index: Index, corners: Ints) -> CSpace:
        """Return the part of a tile if it has the cells of a box, else a window of them."""
        folder = self.folder
        if folder.outside == "blocked":
            corners = folder.clip(corners)  # nothing is FREE outside
        halo = grow(folder.interior(index), folder.halo)
        for beyond, part in enumerate((folder.cells(index), halo)):
            if (part[0] <= corners[0]).all() and (corners[1] <= part[1]).all():
                return self.part(index, bool(beyond))
        return self.window(corners)

    def motions_are_free(self, starts: Floats, ends: Floats, out: Bools) -> None:
        """Write whether motions, from ``starts`` to ``ends`` of shape (n, size), are free.

        They are cut at the borders of tiles, and the part of its tile proves each piece. A motion in
        the closed grid ignores the cells outside, as in a map in memory.
        """
        folder, grid, dim = self.folder, self.folder.grid, self.folder.grid.dim
        inside = grid.contains(starts[:, :dim]) & grid.contains(ends[:, :dim])
        out[:] = inside | (folder.outside == "free")
        pieces = cut_motions(grid, folder.tile, folder.rotations, starts, ends)
        place = np.where(inside[pieces.motions], INSIDE, np.where(pieces.is_far, FAR, BORDER))
        keys = np.column_stack([place, pieces.tiles])
        for (where, *index), rows in group_rows(keys, np.arange(len(keys))):
            left = rows[out[pieces.motions[rows]]]  # other motions have failed in another tile
            if len(left):
                part = self.frame if where == FAR else self.part(tuple(index), where == BORDER)
                q = np.stack([pieces.starts[left], pieces.ends[left]])
                if where == INSIDE:  # rounding may put the upper border just outside the part
                    q[..., :dim] = np.clip(q[..., :dim], part.grid.lower, part.grid.upper)
                out[pieces.motions[left[~part.motion_is_free(*q)]]] = False


def group_rows(keys: Ints, rows: Ints) -> Iterator[tuple[Index, Ints]]:
    """Yield each key among some rows, with its rows; ``keys`` are integers of shape (n, k)."""
    if not len(rows):
        return
    chosen = keys[rows]
    first, spans = chosen.min(axis=0), np.ptp(chosen, axis=0) + 1
    flat = np.ravel_multi_index(tuple((chosen - first).T), tuple(spans))
    if np.prod(spans) <= 2**16:
        flat = flat.astype(np.uint16)  # numpy sorts 16-bit integers in linear time
    order = np.argsort(flat, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(flat[order])) + 1):
        yield tuple(chosen[part[0]].tolist()), rows[part]

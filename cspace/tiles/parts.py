"""Open tiles of a map, and parts of the map in memory.

All outside a part is unknown, so MIXED there; each proof by a part holds in the whole map.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.limits import WORKSPACE_CELL_BYTES, check_memory, map_bytes
from cspace.record.exterior import UNKNOWN, Exterior
from cspace.shapes import Shape
from cspace.space import CSpace
from cspace.support.arrays import MIXED, Bools, Floats, Ints
from cspace.tiles.folder import ONE_MORE, Index, TileFolder, as_box, grow
from cspace.tiles.motions import cut_motions
from cspace.workspace import Workspace

MAX_PIECES: Final = 2**17
"""Maximum number of pieces of motions in memory at a time; a motion of more pieces is not proven.
"""

Ask = Callable[[CSpace, Floats], Any]
"""Query of some configurations on a map in memory."""


class OpenTiles:
    """The tiles of a map at one moment, read when they are needed.

    Parameters
    ----------
    folder : TileFolder
        Complete folder.
    max_bytes : int
        Memory for the states and obstacles of open tiles; one stays open.
    """

    def __init__(self, folder: TileFolder, max_bytes: int) -> None:
        self.folder = folder
        sides = np.add(folder.tile, 2 * folder.halo).tolist()
        tile_bytes = (folder.slices + WORKSPACE_CELL_BYTES) * math.prod(sides)
        self._max_tiles = max(1, max_bytes // tile_bytes)
        self._tiles: OrderedDict[Index, CSpace] = OrderedDict()

    @cached_property
    def frame(self) -> CSpace:
        """Map of the space outside the grid; in the grid, it proves less than the tiles."""
        frame = self.folder.frame
        cell = np.array([[0] * frame.grid.dim, [1] * frame.grid.dim])
        return CSpace(replace(frame, states=self._outside_states(cell, frame.grid.shape)))

    def part(self, index: Index) -> CSpace:
        """Return a tile, with its halo in the grid, as a map in memory."""
        if index not in self._tiles:
            self._tiles[index] = CSpace(self.folder.read_tile(index))
            if len(self._tiles) > self._max_tiles:
                self._tiles.popitem(last=False)
        self._tiles.move_to_end(index)
        return self._tiles[index]

    def window(self, corners: Ints, exterior: Exterior | None = None) -> CSpace:
        """Return a box of cells, in the grid or not, as a map in memory.

        All outside it is unknown, unless the states outside are given. Raises InputError if the map
        does not fit into memory.
        """
        folder, frame = self.folder, self.folder.frame
        corners = self._limit(corners)
        grid = folder.sub_grid(corners)
        needed = map_bytes(grid.shape, folder.slices) + WORKSPACE_CELL_BYTES * grid.size
        check_memory(needed, "the window", grid, hint="use a smaller window")
        states = self._outside_states(corners, grid.shape)
        outer, inner = np.zeros((2, *grid.shape), dtype=np.bool_)
        for index in folder.tiles_in(corners):
            tile = self.part(index)
            both = np.clip(folder.interior(index), *corners)
            here = as_box(both - corners[0])
            there = as_box(both - folder.cells(index)[0])
            states[(slice(None), *here)] = tile._contents.states[(slice(None), *there)]
            outer[here] = tile.workspace.outer[there]
            inner[here] = tile.workspace.inner[there]
        source = f"a window of {folder.path.name}"
        workspace = Workspace(grid, outer, inner, source=source, shapes=self._shapes_in(corners))
        outside = frame.outside if exterior else UNKNOWN
        contents = replace(
            frame, workspace=workspace, states=states, outside=outside, exterior=exterior
        )
        return CSpace(contents)

    def _limit(self, corners: Ints) -> Ints:
        """Return the part of a box in which cells may be FREE."""
        return corners if self.folder.frame.outside == "free" else self.folder.clip(corners)

    def _outside_states(self, corners: Ints, shape: tuple[int, ...]) -> NDArray[np.uint8]:
        """Return the states of a box of cells as if all were outside the grid.

        They hold in the grid, too, because the states outside follow from boxes around all
        obstacles, or around the workspace.
        """
        table = self.folder.exterior.table
        states = np.empty((len(table), *shape), dtype=np.uint8)
        for row, part in zip(table, states, strict=True):
            part[...] = row[-1]
            mixed = row[:-1].reshape(2, -1) + ONE_MORE - corners[0]
            part[as_box(np.clip(mixed, 0, shape))] = MIXED
        return states

    def _shapes_in(self, corners: Ints) -> tuple[Shape, ...] | None:
        """Return the obstacles of a window as shapes, if they describe its cells."""
        folder, shapes = self.folder, self.folder.frame.workspace.shapes
        if shapes is None or np.array_equal(folder.clip(corners), corners):
            return shapes
        # Parts of shapes beyond the map do not count if the space outside is free.
        lower, upper = folder.grid.lower, folder.grid.upper
        bounds = [shape.outer.bounds for shape in shapes]
        fits = all((low >= lower).all() and (high <= upper).all() for low, high in bounds)
        return shapes if fits else None

    # ---- queries ---------------------------------------------------------------------------------

    def ask(self, query: Ask, rows: Floats, out: NDArray[Any], reach: float | None = None) -> None:
        """Write the answers for configurations, shape (n, size), to ``out``.

        A query reads only the cell of a configuration, or all within ``reach`` metres along each
        axis. A tile answers it, a window if it reads cells beyond the tile, or the frame if no cell
        of the grid is near.
        """
        folder, grid, rotations = self.folder, self.folder.grid, self.folder.frame.rotations
        cells = 0 if reach is None else math.ceil(reach / grid.spacing) + 1
        position = grid.cell_of(rows[:, : grid.dim])
        if reach is None:  # a point on a border belongs to the cell that the whole map gives it
            turns = rotations.centers[rotations.find_cells(rows)]
            rows = np.concatenate([grid.center_of(position), turns], axis=1)
        near = ((position >= -cells) & (position < np.add(grid.shape, cells))).all(axis=1)
        if not near.all():
            out[~near] = query(self.frame, rows[~near])
        for index, chosen in folder.group_by_tile(position, np.flatnonzero(near)):
            around = position[chosen]
            corners = np.stack([around.min(axis=0), around.max(axis=0) + 1])
            corners = self._limit(grow(corners, cells))
            is_held = np.array_equal(np.clip(corners, *folder.cells(index)), corners)
            part = self.part(index) if is_held else self.window(corners)
            out[chosen] = query(part, rows[chosen])

    def motions_are_free(self, starts: Floats, ends: Floats, out: Bools) -> None:
        """Write whether motions, from ``starts`` to ``ends`` of shape (n, size), are free."""
        grid = self.folder.grid
        position, last = starts[:, : grid.dim], ends[:, : grid.dim]
        lengths = np.abs(last - position).max(axis=1) / grid.spacing
        pieces = lengths / (self.folder.halo - 1) + 2.0
        inside = grid.contains(position) & grid.contains(last)
        out[:] = (inside | (self.folder.frame.outside == "free")) & (pieces <= MAX_PIECES)
        for choice in (inside, ~inside):
            rows = np.flatnonzero(out & choice)
            batch = np.cumsum(pieces[rows]) // MAX_PIECES
            for part in np.split(rows, np.flatnonzero(np.diff(batch)) + 1):
                out[part] = self._prove_motions(starts[part], ends[part], bool(choice is inside))

    def _prove_motions(self, starts: Floats, ends: Floats, is_inside: bool) -> Bools:
        """Return whether motions are free that lie in the closed grid, or that leave it.

        A motion in the closed grid ignores the cells outside, as in a map in memory.
        """
        folder, grid, halo = self.folder, self.folder.grid, self.folder.halo
        dim, shape = grid.dim, grid.shape
        out = np.ones(len(starts), dtype=np.bool_)
        motions, first, last = cut_motions(grid, folder.frame.rotations, halo - 1, starts, ends)
        position = grid.cell_of(first[:, :dim])
        far = ((position < -halo) | (position > np.add(shape, halo))).any(axis=1)
        is_free = self.frame.motion_is_free(first[far], last[far])
        out[motions[far][~is_free]] = False
        for index, rows in folder.group_by_tile(position, np.flatnonzero(~far)):
            left = rows[out[motions[rows]]]  # other motions have failed in another tile
            if not len(left):
                continue
            q = np.stack([first[left], last[left]])
            if is_inside:
                part = self.part(index)
                # Rounding may put the border of the grid just outside the part.
                q[..., :dim] = np.clip(q[..., :dim], part.grid.lower, part.grid.upper)
            else:
                cells = grid.cell_of(q[..., :dim]).reshape(-1, dim)
                corners = np.stack([cells.min(axis=0), cells.max(axis=0) + 1])
                part = self.window(grow(corners, 2))
            out[motions[left[~part.motion_is_free(*q)]]] = False
        return out

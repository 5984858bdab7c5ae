"""Open tiles of a map, and parts of the map in memory.

All outside a part is unknown, so MIXED there; each proof by a part holds in the whole map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.limits import WORKSPACE_CELL_BYTES, check_memory, map_bytes
from cspace.record.contents import Contents
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
        self.tile = lru_cache(max(1, max_bytes // tile_bytes))(self._read)

    def _read(self, index: Index) -> tuple[Contents, CSpace]:
        """Return the contents of a tile with its halo in the grid, and their map in memory."""
        contents = self.folder.read_tile(index)
        return contents, CSpace(contents)

    def part(self, index: Index) -> CSpace:
        """Return a tile, with its halo in the grid, as a map in memory."""
        space: CSpace = self.tile(index)[1]
        return space

    @cached_property
    def frame(self) -> CSpace:
        """Map of the space outside the grid; in the grid, it proves less than the tiles."""
        frame = self.folder.frame
        cell = np.array([[0] * frame.grid.dim, [1] * frame.grid.dim])
        return CSpace(replace(frame, states=self._outside_states(cell, frame.grid.shape)))

    def window(self, corners: Ints, exterior: Exterior | None = None) -> CSpace:
        """Return a box of cells, in the grid or not, as a map in memory.

        All outside it is unknown, unless the states outside are given. Raises InputError if the map
        does not fit into memory.
        """
        folder, frame = self.folder, self.folder.frame
        if frame.outside != "free":  # no cell beyond the grid is FREE
            corners = folder.clip(corners)
        grid = folder.sub_grid(corners)
        needed = map_bytes(grid.shape, folder.slices) + WORKSPACE_CELL_BYTES * grid.size
        check_memory(needed, "the window", grid, hint="use a smaller window")
        states = self._outside_states(corners, grid.shape)
        outer, inner = np.zeros((2, *grid.shape), dtype=np.bool_)
        for index in folder.tiles_in(corners):
            tile, _ = self.tile(index)
            both = np.clip(folder.interior(index), *corners)
            here = as_box(both - corners[0])
            there = as_box(both - folder.cells(index)[0])
            states[(slice(None), *here)] = tile.states[(slice(None), *there)]
            outer[here] = tile.workspace.outer[there]
            inner[here] = tile.workspace.inner[there]
        source = f"a window of {folder.path.name}"
        workspace = Workspace(grid, outer, inner, source=source, shapes=self._shapes_in(corners))
        outside = frame.outside if exterior else UNKNOWN
        contents = replace(
            frame, workspace=workspace, states=states, outside=outside, exterior=exterior
        )
        return CSpace(contents)

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

    def parts_near(
        self, cells: Ints, reach: int, is_inside: bool = False
    ) -> Iterator[tuple[Callable[[], CSpace], Ints]]:
        """Group cells, shape (n, d), by the map in memory that answers queries near them.

        Yields functions that open a map, and the rows of ``cells`` that it is for. The map has all
        cells within ``reach``, or only those in the grid if ``is_inside``. It is a tile, a window
        if it has cells beyond the tile, or the frame if no cell of the grid is within reach.
        """
        folder = self.folder
        near = ((cells >= -reach) & (cells < np.add(folder.grid.shape, reach))).all(axis=1)
        if not near.all():
            yield lambda: self.frame, np.flatnonzero(~near)
        for index, rows in folder.group_by_tile(cells, np.flatnonzero(near)):
            group = cells[rows]
            corners = grow(np.stack([group.min(axis=0), group.max(axis=0) + 1]), reach)
            if is_inside or folder.frame.outside != "free":
                corners = folder.clip(corners)
            if np.array_equal(np.clip(corners, *folder.cells(index)), corners):
                yield partial(self.part, index), rows
            else:
                yield partial(self.window, corners), rows

    def motions_are_free(self, starts: Floats, ends: Floats, out: Bools) -> None:
        """Write whether motions, from ``starts`` to ``ends`` of shape (n, size), are free."""
        grid = self.folder.grid
        position, last = starts[:, : grid.dim], ends[:, : grid.dim]
        lengths = np.abs(last - position).max(axis=1) / grid.spacing
        pieces = lengths / (self.folder.halo - 1) + 2.0
        inside = grid.contains(position) & grid.contains(last)
        out[:] = (inside | (self.folder.frame.outside == "free")) & (pieces <= MAX_PIECES)
        for is_inside in (True, False):
            rows = np.flatnonzero(out & (inside == is_inside))
            batch = np.cumsum(pieces[rows]) // MAX_PIECES
            for part in np.split(rows, np.flatnonzero(np.diff(batch)) + 1):
                out[part] = self._prove_motions(starts[part], ends[part], is_inside)

    def _prove_motions(self, starts: Floats, ends: Floats, is_inside: bool) -> Bools:
        """Return whether motions are free that lie in the closed grid, or that leave it.

        A motion in the closed grid ignores the cells outside, as in a map in memory.
        """
        folder, grid = self.folder, self.folder.grid
        out = np.ones(len(starts), dtype=np.bool_)
        pieces = cut_motions(grid, folder.frame.rotations, folder.halo - 1, starts, ends)
        cells = grid.cell_of(pieces.starts[:, : grid.dim])
        for open_part, rows in self.parts_near(cells, folder.halo, is_inside):
            left = rows[out[pieces.motions[rows]]]  # other motions have failed in another tile
            if not len(left):
                continue
            part = open_part()
            q = np.stack([pieces.starts[left], pieces.ends[left]])
            if is_inside:
                # Rounding may put the border of the grid just outside the part.
                place = q[..., : grid.dim]
                place[...] = np.clip(place, part.grid.lower, part.grid.upper)
            out[pieces.motions[left[~part.motion_is_free(*q)]]] = False
        return out

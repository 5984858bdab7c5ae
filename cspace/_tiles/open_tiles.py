"""Open tiles of a map, and parts of the map in memory.

All cells outside a part count as MIXED, so each proof by a part holds in the whole map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Final, NamedTuple

import numpy as np

from cspace import BLOCKED, FREE, MIXED, CSpace, Grid, Workspace
from cspace._tiles.folder import LAST_TO_STOP, WORKSPACE_CELL_BYTES, TileFolder, grow_box, to_slices
from cspace._tiles.motions import cut_motions
from cspace.inside import (
    Bools,
    Components,
    Contents,
    Exterior,
    Floats,
    Ints,
    Shape,
    States,
    check_memory,
    reduce_blocks,
)

MAX_PIECES: Final = 2**17
"""Maximum number of pieces of motions in memory; a motion cut into more pieces is not proven."""


class OpenTile(NamedTuple):
    """A tile in memory.

    Attributes
    ----------
    first : ndarray of int64, shape (d,)
        First cell of the tile and its halo in the grid.
    contents : Contents
    space : CSpace
        The tile as a map.
    components : Components
        Connected components of the tile's cells, without ways outside the tile.
    """

    first: Ints
    contents: Contents
    space: CSpace
    components: Components

    def find_labels(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return components in this tile of the map's cells, or -1.

        Cells have shape (..., 1 + d).
        """
        return self.components.find(cells - np.array([0, *self.first]), mixed)


def open_tile(folder: TileFolder, number: int) -> OpenTile:
    """Read a tile; prepare its map and components."""
    tile = folder.read_tile(number)
    # Components do not join through the exterior of the tile.
    closed = np.zeros(folder.slices, dtype=np.bool_)
    components = Components(tile.states, tile.slice_of, tile.rotations.neighbors, closed)
    return OpenTile(folder.locate_tile(number)[0], tile, CSpace(tile), components)


class OpenTiles:
    """A cache of the tiles of a map, read when needed.

    Parameters
    ----------
    folder : TileFolder
    max_bytes : int
        Memory for the states and obstacles of open tiles; at least one stays open.

    Attributes
    ----------
    frame : CSpace
        Map of the first cell, which knows the states outside the grid.
    """

    def __init__(self, folder: TileFolder, max_bytes: int) -> None:
        """Create an empty cache of tiles."""
        self.folder = folder
        tile_bytes = (folder.slices + WORKSPACE_CELL_BYTES) * folder.cells_of_tile
        keep_recent = lru_cache(max(1, max_bytes // tile_bytes))
        self.tile: Callable[[int], OpenTile] = keep_recent(partial(open_tile, folder))
        self.frame = CSpace(folder.frame)

    def window(self, corners: Ints, exterior: Exterior | None = None) -> CSpace:
        """Return a box of cells as a map.

        The box may extend beyond the grid.

        ``corners``, shape (2, d), are the first cell and the cell after the last one. Cells outside
        the box are MIXED, unless their states are given by ``exterior``. Raises InputError if the
        map does not fit into memory.
        """
        folder = self.folder
        frame = folder.frame
        if frame.outside != "free":  # no cell beyond the grid is FREE
            corners = folder.clip(corners)
        grid = folder.sub_grid(corners)
        needed = (folder.slices + WORKSPACE_CELL_BYTES) * grid.size
        check_memory(needed, "the window", grid)
        states = np.empty((folder.slices, *grid.shape), dtype=np.uint8)
        if frame.exterior is not None:
            _write_outside(frame.exterior, corners[0], states)
        outer, inner = np.zeros((2, *grid.shape), dtype=np.bool_)
        for number in folder.list_tiles(corners):
            tile = self.tile(number)
            shared = np.clip(folder.locate_interior(number), *corners)
            in_window = to_slices(shared - corners[0])
            in_tile = to_slices(shared - tile.first)
            states[:, *in_window] = tile.contents.states[:, *in_tile]
            outer[in_window] = tile.contents.workspace.outer[in_tile]
            inner[in_window] = tile.contents.workspace.inner[in_tile]
        source = f"a window of {folder.path.name}"
        workspace = Workspace(grid, outer, inner, source=source, shapes=self._shapes_in(corners))
        return CSpace(folder.make_part(workspace, states, exterior))

    def _shapes_in(self, corners: Ints) -> tuple[Shape, ...] | None:
        """Return the shapes of a window's obstacles, if they describe its cells."""
        folder = self.folder
        shapes = folder.frame.workspace.shapes
        if not shapes or np.array_equal(folder.clip(corners), corners):
            return shapes
        # A window beyond the map has free space there, so shapes must not extend beyond the map.
        corners_of_shapes = [shape.outer.bounds for shape in shapes]
        return shapes if folder.grid.contains(corners_of_shapes).all() else None

    def overview(self, max_cells: int) -> CSpace:
        """Return the whole map with at most ``max_cells`` along an axis."""
        folder = self.folder
        grid = folder.grid
        factor = max(1, -(-max(grid.shape) // max_cells))
        shape = tuple(-(-n // factor) for n in grid.shape)
        # The bit ``1 << state`` of a coarse cell is set if one of its cells has the state.
        seen = np.zeros((folder.slices, *shape), dtype=np.uint8)
        outer = np.zeros(shape, dtype=np.bool_)
        slices = np.arange(folder.slices)
        for number in range(len(folder)):
            tile = folder.read_tile(number)
            interior = folder.locate_interior_in_tile(number)
            # Along each axis, the coarse cells that meet the tile, and the index in its interior of
            # the first cell of each.
            sides = [np.arange(*ends) // factor for ends in folder.locate_interior(number).T]
            pairs = [np.unique(side, return_index=True) for side in sides]
            coarse, starts = zip(*pairs, strict=True)
            # A coarse cell may have parts in several tiles, so bits are added.
            bits = np.left_shift(1, tile.states[:, *interior], dtype=np.uint8)
            seen[np.ix_(slices, *coarse)] |= reduce_blocks(bits, [slices, *starts], np.bitwise_or)
            outer[np.ix_(*coarse)] |= reduce_blocks(tile.workspace.outer[interior], starts)
        for axis, n in enumerate(grid.shape):
            if n % factor:  # the last coarse cells extend beyond the map, where nothing is known
                np.moveaxis(seen, 1 + axis, 0)[-1] |= 1 << MIXED
        states = np.full_like(seen, MIXED)
        states[seen == 1 << FREE] = FREE
        states[seen == 1 << BLOCKED] = BLOCKED
        coarse_grid = Grid(
            grid.lower, grid.spacing * factor, shape, grid.axes, grid.units, grid.frame_id
        )
        # No coarse cell is known to lie in obstacles, so the inner cells are empty.
        inner = np.zeros_like(outer)
        source = f"overview of {folder.path.name}"
        workspace = Workspace(coarse_grid, outer, inner, source=source)
        return CSpace(folder.make_part(workspace, states))

    # ---- queries ---------------------------------------------------------------------------------

    def parts_near(
        self, cells: Ints, reach: int, is_inside: bool = False
    ) -> Iterator[tuple[CSpace, Ints]]:
        """Yield maps in memory for queries near cells, with their rows.

        ``cells`` have shape (n, d). A map has all cells within ``reach`` of its rows, or only those
        in the grid if ``is_inside``. It is a tile, a window if cells beyond the tile are within
        reach, or the frame if no cell of the grid is.
        """
        folder = self.folder
        near = ((cells >= -reach) & (cells < np.add(folder.grid.shape, reach))).all(axis=1)
        if not near.all():
            yield self.frame, np.flatnonzero(~near)
        for number, rows in folder.group_by_tile(cells, np.flatnonzero(near)):
            # The box around the cells of the group, grown by the reach.
            group = cells[rows]
            needed = grow_box(np.stack([group.min(axis=0), group.max(axis=0) + 1]), reach)
            if is_inside or folder.frame.outside != "free":
                needed = folder.clip(needed)
            in_tile = np.clip(needed, *folder.locate_tile(number))
            if np.array_equal(in_tile, needed):
                yield self.tile(number).space, rows
            else:
                yield self.window(needed), rows

    def motions_are_free(self, starts: Floats, ends: Floats, out: Bools) -> None:
        """Write True for each motion that is proven free, else False.

        Motions lead from ``starts`` to ``ends``, both of shape (n, size); ``out`` has shape (n,).
        """
        grid = self.folder.grid
        first = starts[:, : grid.dim]
        last = ends[:, : grid.dim]
        # Upper bounds of the number of pieces that a motion is cut into; the 2 is for rounding up,
        # and for half turns.
        cells = np.abs(last - first).max(axis=1) / grid.spacing
        pieces = cells / (self.folder.halo - 1) + 2.0
        inside = grid.contains(first) & grid.contains(last)
        may_leave = self.folder.frame.outside == "free"
        out[:] = (inside | may_leave) & (pieces <= MAX_PIECES)
        # Motions that leave the grid need the cells outside, so they are proven separately.
        for is_inside in (True, False):
            remaining = np.flatnonzero(out & (inside == is_inside))
            batch_size = int(MAX_PIECES / pieces[remaining].max(initial=1.0))
            while len(remaining):
                rows, remaining = np.split(remaining, [batch_size])
                out[rows] = self._prove_motions(starts[rows], ends[rows], is_inside)

    def _prove_motions(self, starts: Floats, ends: Floats, is_inside: bool) -> Bools:
        """Return a mask of the motions that tiles prove free, shape (n,).

        ``starts`` and ``ends`` have the shape (n, size). If ``is_inside``, all motions lie in the
        closed grid, and ignore the cells outside as in a map in memory. Otherwise all leave it.
        """
        grid = self.folder.grid
        rotations = self.folder.frame.rotations
        longest = self.folder.halo - 1  # a piece and its neighbor cells lie in a tile and its halo
        motions, *ends_of_pieces = cut_motions(grid, rotations, longest, starts, ends)
        pieces = np.stack(ends_of_pieces)  # their starts, then their ends, shape (2, m, size)
        first_cells = grid.cell_of(pieces[0, :, : grid.dim])
        out = np.ones(len(starts), dtype=np.bool_)
        for space, rows in self.parts_near(first_cells, self.folder.halo, is_inside):
            q0, q1 = pieces[:, rows]
            if is_inside:
                # Rounding may put the border of the grid just outside the map of the tile.
                for q in (q0, q1):
                    position = q[:, : grid.dim]
                    position.clip(space.grid.lower, space.grid.upper, out=position)
            unproven = rows[~space.motion_is_free(q0, q1)]
            out[motions[unproven]] = False
        return out


def _write_outside(exterior: Exterior, first: Ints, states: States) -> None:
    """Write the states that a box of cells has outside the grid.

    ``first`` is the first cell of the box. ``states`` have the shape (slices, ...) of the box.
    """
    # A row has the first and the last cell of a box of MIXED cells, and the state of all others.
    for row, slice_states in zip(exterior.table, states, strict=True):
        *mixed_cells, other_state = row
        slice_states[...] = other_state
        mixed = np.reshape(mixed_cells, (2, -1)) + LAST_TO_STOP - first
        slice_states[to_slices(np.clip(mixed, 0, slice_states.shape))] = MIXED

"""Parts of a stored map, as maps in memory."""

from __future__ import annotations

from typing import Final

import numpy as np

from cspace.arrays import Ints
from cspace.grid import Grid
from cspace.map.contents import Contents
from cspace.map.exterior import UNKNOWN
from cspace.memory import WORKSPACE_BYTES, check_memory, map_bytes
from cspace.shapes import Shape, Voxels
from cspace.space import CSpace
from cspace.tiles.sources import Box
from cspace.tiles.store import Known, Store
from cspace.workspace import Workspace

_MEND: Final = "ask for a smaller window"


def window_of(store: Store, known: Known, table: Ints, first: Ints, stop: Ints) -> CSpace:
    """The part of a map from a first cell up to the one before another; all of it, if it has no cell beyond.

    ``known`` gives the records of tiles, and ``table``, shape (slices, 2 d + 1), what is known outside the whole map
    (:attr:`cspace.map.exterior.Exterior.table`). Raises InputError if the part does not fit into memory.
    """
    whole, outside = store.grid, str(store.metadata["outside"])
    if (first > 0).any() or (stop < whole.shape).any():
        # Cells of the window say what lies beyond the map's border; what lies farther is not known.
        outside = UNKNOWN
    else:
        first, stop = np.zeros_like(first), np.array(whole.shape)
    lower = np.array(whole.lower) + whole.spacing * first
    grid = Grid(tuple(lower.tolist()), whole.spacing, tuple((stop - first).tolist()))
    needed = map_bytes(grid.shape, store.slices) + WORKSPACE_BYTES * grid.size
    check_memory(needed, "the window", grid, mend=_MEND)
    box = tuple(map(slice, first.tolist(), stop.tolist()))
    outer, inner = store.obstacles_in(box, known)
    workspace = Workspace(grid, outer, inner, source=f"a part of {store.path.name}", shapes=_shapes(store, grid, box))
    return CSpace(
        Contents(
            workspace,
            store.robot,
            store.rotations,
            store.slice_of,
            store.states_in(box, known, table),
            outside,
            float(store.metadata["margin"]),
            str(store.metadata["precision"]),
            proves_blocked=bool(store.metadata["inner"]),
        )
    )


def _shapes(store: Store, grid: Grid, box: Box) -> tuple[Shape, ...] | None:
    """The obstacles on a grid of some cells, as shapes; None where only their cells are known."""
    sides = list(zip(box, store.grid.shape, strict=True))
    if store.shapes is None or all(part.start >= 0 and part.stop <= n for part, n in sides):
        return store.shapes
    if store.metadata["outside"] == "blocked":
        around = np.ones(grid.shape, dtype=np.bool_)
        around[tuple(slice(max(0, -part.start), n - part.start) for part, n in sides)] = False
        return (*store.shapes, Voxels(around, grid.spacing, np.asarray(grid.lower)))
    whole, bounds = store.grid, [shape.bounds for shape in store.shapes]
    # What of them lies beyond a map that is free around it does not count.
    inside = all((low >= whole.lower).all() and (high <= whole.upper).all() for low, high in bounds)
    return store.shapes if inside else None

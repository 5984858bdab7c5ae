"""Windows and overviews of a stored map, in memory."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Box, Bytes, Ints, intersect_boxes, reduce_blocks
from cspace.grid import Grid
from cspace.limits import WORKSPACE_CELL_BYTES, check_memory, map_bytes
from cspace.map.contents import Contents
from cspace.map.exterior import UNKNOWN
from cspace.shapes import Shape, Voxels
from cspace.space import CSpace
from cspace.store import Index, RecordReader, Store
from cspace.tiles.work import Job, run_tasks
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client


def extract_window(store: Store, known: RecordReader, table: Ints, start: Ints, stop: Ints) -> CSpace:
    """Return the cells [start, stop) as a map.

    Return the whole map if they contain it. ``known`` returns the record of a tile. ``table``, shape (slices, 2 d + 1),
    holds the states outside the whole map (:attr:`cspace.map.exterior.Exterior.table`). Raises InputError if the window
    exceeds the memory.
    """
    whole, outside = store.grid, str(store.metadata["outside"])
    if (start > 0).any() or (stop < whole.shape).any():
        # The window's own cells hold the states just outside the map; the rest is unknown.
        outside = UNKNOWN
    else:
        start, stop = np.zeros_like(start), np.array(whole.shape)
    lower = np.array(whole.lower) + whole.spacing * start
    grid = Grid(tuple(lower.tolist()), whole.spacing, tuple((stop - start).tolist()), whole.axes, whole.units)
    needed = map_bytes(grid.shape, store.slices) + WORKSPACE_CELL_BYTES * grid.size
    check_memory(needed, "the window", grid, hint="use a smaller window")
    box = tuple(map(slice, start.tolist(), stop.tolist()))
    outer, inner = store.obstacles_in(box, known)
    source, shapes = f"a window of {store.path.name}", _shapes_in(store, grid, box)
    workspace = Workspace(grid, outer, inner, source=source, unknown=_unknown_in(store, box), shapes=shapes)
    return CSpace(
        Contents(
            workspace,
            store.robot,
            store.rotations,
            store.slice_of,
            store.states_in(box, known, table),
            outside,
            float(store.metadata["margin_m"]),
            str(store.metadata["precision"]),
            proves_blocked=store.proves_blocked,
        )
    )


def _unknown_in(store: Store, box: Box) -> Bools | None:
    """Return a mask of unknown cells, or None."""
    if "unknown" not in store.names:
        return None
    unknown = np.zeros(tuple(part.stop - part.start for part in box), dtype=np.bool_)
    in_box, in_map = intersect_boxes(box, tuple(slice(0, n) for n in store.grid.shape))
    unknown[in_box] = store.array("unknown")[in_map]
    return unknown


def _shapes_in(store: Store, grid: Grid, box: Box) -> tuple[Shape, ...] | None:
    """Return obstacles of a window as shapes, or None.

    None means that the obstacles are only cells. ``grid`` is the window's grid and ``box`` its cells in the map.
    """
    sides = list(zip(box, store.grid.shape, strict=True))
    if store.shapes is None or all(part.start >= 0 and part.stop <= n for part, n in sides):
        return store.shapes
    if store.metadata["outside"] == "blocked":
        around = np.ones(grid.shape, dtype=np.bool_)
        around[tuple(slice(max(0, -part.start), n - part.start) for part, n in sides)] = False
        return (*store.shapes, Voxels(around, grid.spacing, np.asarray(grid.lower)))
    whole, bounds = store.grid, [shape.outer.bounds for shape in store.shapes]
    # If the exterior is free, parts of shapes beyond the map do not count, so shapes that stick out cannot be used.
    inside = all((low >= whole.lower).all() and (high <= whole.upper).all() for low, high in bounds)
    return store.shapes if inside else None


class ReducedTile(NamedTuple):
    """A tile in coarse cells.

    Cells at its boundary may lie partly in other tiles.

    Attributes
    ----------
    start : tuple of int
        First coarse cell.
    min_states, max_states : ndarray of uint8, shape (slices, ...)
        Smallest and greatest state in each coarse cell.
    outer : ndarray of bool
        True for coarse cells with an occupied outer cell.
    """

    start: tuple[int, ...]
    min_states: Bytes
    max_states: Bytes
    outer: Bools


def build_overview(job: Job, max_cells: int, client: Client | None) -> CSpace:
    """Return a map of at most ``max_cells`` cells per axis.

    A coarse cell is FREE or BLOCKED if all its cells are, else MIXED. Each tile is reduced in a task.
    """
    store, grid = job.store, job.store.grid
    factor = max(1, -(-max(grid.shape) // max_cells))
    shape = tuple(-(-n // factor) for n in grid.shape)
    min_states = np.full((store.slices, *shape), BLOCKED, dtype=np.uint8)
    max_states = np.zeros_like(min_states)
    outer = np.zeros(shape, dtype=np.bool_)
    for tile in run_tasks(partial(_reduce_tile, factor=factor), job, list(store), client, None):
        box = tuple(slice(low, low + n) for low, n in zip(tile.start, tile.outer.shape, strict=True))
        min_states[(slice(None), *box)] = np.minimum(min_states[(slice(None), *box)], tile.min_states)
        max_states[(slice(None), *box)] = np.maximum(max_states[(slice(None), *box)], tile.max_states)
        outer[box] |= tile.outer
    states = np.where(max_states == FREE, FREE, np.where(min_states == BLOCKED, BLOCKED, MIXED)).astype(np.uint8)
    for axis, n in enumerate(grid.shape):
        if n % factor:  # the last coarse cells extend beyond the map, where nothing is known
            last_cells = np.moveaxis(states, 1 + axis, 0)[-1]
            last_cells[...] = MIXED
    coarse = Grid(grid.lower, grid.spacing * factor, shape, grid.axes, grid.units)
    # Obstacles fill no coarse cell for certain, so the inner cells are empty.
    inner = np.zeros_like(outer) if factor > 1 else outer
    workspace = Workspace(coarse, outer, inner, source=f"overview of {store.path.name}")
    margin = float(store.metadata["margin_m"])
    return CSpace(Contents(workspace, store.robot, store.rotations, store.slice_of, states, UNKNOWN, margin))


def _reduce_tile(job: Job, index: Index, factor: int) -> ReducedTile:
    """Reduce a tile to coarse cells; a task."""
    store, cells = job.store, job.store.cells(index)
    record = store.known(index)
    inside = tuple(slice(0, part.stop - part.start) for part in cells)
    cuts = [np.unique([part.start, *range(-(-part.start // factor) * factor, part.stop, factor)]) for part in cells]
    cell_starts = [cut - part.start for cut, part in zip(cuts, cells, strict=True)]
    min_states, max_states = [], []
    for layer in range(store.layers):
        block = store.states(index, layer, record)[(slice(0, len(store.numbers(layer))), *inside)]
        starts = [np.arange(len(block)), *cell_starts]
        min_states.append(reduce_blocks(block, starts, np.minimum))
        max_states.append(reduce_blocks(block, starts))
    outer = reduce_blocks(store.obstacles(index, record)[0], cell_starts)
    start = tuple(part.start // factor for part in cells)
    return ReducedTile(start, np.concatenate(min_states), np.concatenate(max_states), outer)

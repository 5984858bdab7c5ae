"""Parts of a stored map, and all of it in larger cells, as maps in memory: as proven as the map itself."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Box, Bytes, Ints, intersect_boxes, reduce_blocks
from cspace.grid import Grid
from cspace.limits import WORKSPACE_CELL_BYTES, check_memory, map_bytes
from cspace.map.contents import Contents
from cspace.map.exterior import UNKNOWN
from cspace.shapes import Shape, Voxels
from cspace.space import CSpace
from cspace.store import Index, RecordReader, Store
from cspace.tiles.work import Job, run
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client

_MEND: Final = "ask for a smaller window"


def window_of(store: Store, known: RecordReader, table: Ints, first: Ints, stop: Ints) -> CSpace:
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
    grid = Grid(tuple(lower.tolist()), whole.spacing, tuple((stop - first).tolist()), whole.axes, whole.units)
    needed = map_bytes(grid.shape, store.slices) + WORKSPACE_CELL_BYTES * grid.size
    check_memory(needed, "the window", grid, hint=_MEND)
    box = tuple(map(slice, first.tolist(), stop.tolist()))
    outer, inner = store.obstacles_in(box, known)
    source, shapes = f"a part of {store.path.name}", _shapes(store, grid, box)
    workspace = Workspace(grid, outer, inner, source=source, unknown=_unknown(store, box), shapes=shapes)
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
            proves_blocked=store.proves_blocked,
        )
    )


def _unknown(store: Store, box: Box) -> Bools | None:
    """Return which cells of a box nothing is known of; None if the map does not say it of its cells."""
    if "unknown" not in store.names:
        return None
    unknown = np.zeros(tuple(part.stop - part.start for part in box), dtype=np.bool_)
    here, there = intersect_boxes(box, tuple(slice(0, n) for n in store.grid.shape))
    unknown[here] = store.array("unknown")[there]
    return unknown


def _shapes(store: Store, grid: Grid, box: Box) -> tuple[Shape, ...] | None:
    """The obstacles on a grid of some cells, as shapes; None where only their cells are known."""
    sides = list(zip(box, store.grid.shape, strict=True))
    if store.shapes is None or all(part.start >= 0 and part.stop <= n for part, n in sides):
        return store.shapes
    if store.metadata["outside"] == "blocked":
        around = np.ones(grid.shape, dtype=np.bool_)
        around[tuple(slice(max(0, -part.start), n - part.start) for part, n in sides)] = False
        return (*store.shapes, Voxels(around, grid.spacing, np.asarray(grid.lower)))
    whole, bounds = store.grid, [shape.outer.bounds for shape in store.shapes]
    # What of them lies beyond a map that is free around it does not count.
    inside = all((low >= whole.lower).all() and (high <= whole.upper).all() for low, high in bounds)
    return store.shapes if inside else None


class Reduced(NamedTuple):
    """A tile in larger cells, of which those at its border may lie in part in other tiles.

    Attributes
    ----------
    first : tuple of int
        Its first larger cell.
    least, most : ndarray of uint8, shape (slices, ...)
        The least and the greatest state in each.
    outer : ndarray of bool
        Whether some cell in it meets an obstacle.
    """

    first: tuple[int, ...]
    least: Bytes
    most: Bytes
    outer: Bools


def overview_of(job: Job, most: int, client: Client | None) -> CSpace:
    """A map of at most so many cells along each axis: FREE where all cells are FREE, BLOCKED where all are.

    Each tile is reduced in a task.
    """
    store, grid = job.store, job.store.grid
    factor = max(1, -(-max(grid.shape) // most))
    shape = tuple(-(-n // factor) for n in grid.shape)
    least = np.full((store.slices, *shape), BLOCKED, dtype=np.uint8)
    greatest = np.zeros_like(least)
    outer = np.zeros(shape, dtype=np.bool_)
    for part in run(partial(_reduce, factor=factor), job, list(store), client, None):
        box = tuple(slice(low, low + n) for low, n in zip(part.first, part.outer.shape, strict=True))
        least[(slice(None), *box)] = np.minimum(least[(slice(None), *box)], part.least)
        greatest[(slice(None), *box)] = np.maximum(greatest[(slice(None), *box)], part.most)
        outer[box] |= part.outer
    states = np.where(greatest == FREE, FREE, np.where(least == BLOCKED, BLOCKED, MIXED)).astype(np.uint8)
    for axis, n in enumerate(grid.shape):
        if n % factor:  # what lies beyond the map is not known here
            rim = np.moveaxis(states, 1 + axis, 0)[-1]
            rim[...] = MIXED
    larger = Grid(grid.lower, grid.spacing * factor, shape, grid.axes, grid.units)
    none = np.zeros_like(outer) if factor > 1 else outer
    workspace = Workspace(larger, outer, none, source=f"{store.path.name}, from afar")
    margin = float(store.metadata["margin"])
    return CSpace(Contents(workspace, store.robot, store.rotations, store.slice_of, states, UNKNOWN, margin))


def _reduce(job: Job, index: Index, factor: int) -> Reduced:
    """The task: a tile in larger cells."""
    store, cells = job.store, job.store.cells(index)
    record = store.known(index)
    own = tuple(slice(0, part.stop - part.start) for part in cells)
    cuts = [np.unique([part.start, *range(-(-part.start // factor) * factor, part.stop, factor)]) for part in cells]
    begins = [cut - part.start for cut, part in zip(cuts, cells, strict=True)]
    least, most = [], []
    for layer in range(store.layers):
        block = store.states(index, layer, record)[(slice(0, len(store.numbers(layer))), *own)]
        starts = [np.arange(len(block)), *begins]
        least.append(reduce_blocks(block, starts, np.minimum))
        most.append(reduce_blocks(block, starts))
    outer = reduce_blocks(store.obstacles(index, record)[0], begins)
    first = tuple(part.start // factor for part in cells)
    return Reduced(first, np.concatenate(least), np.concatenate(most), outer)

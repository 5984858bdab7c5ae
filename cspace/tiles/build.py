"""Maps built tile by tile into a store, on this machine or on a cluster."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np
from numpy.typing import NDArray

from cspace.engines import ENGINES, choose_engine
from cspace.engines.slices import Progress, raster_bytes
from cspace.errors import FileError, InputError
from cspace.files.access import replacing
from cspace.limits import check_memory
from cspace.map.description import AXES, describe_map, shapes_array
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.store import CHUNK_CELLS, Index, Store, fit_tile, is_store
from cspace.tiles.space import TiledCSpace
from cspace.tiles.work import Job, run
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client

_OTHER: Final = ("library_version", "stamp", "workspace_source", "precision", "depth")
"""Metadata of a new store in which a store of the same map may differ."""


class Settings(TypedDict):
    """What a map is built with, checked: see :func:`cspace.build`."""

    rotations: Rotations
    inner: bool
    method: str
    outside: str
    margin: float
    client: Client | None
    workers: int | None
    progress: Progress | None


def build_tiles(
    workspace: Workspace,
    robot: Robot,
    store: str | os.PathLike[str],
    tile: int | Sequence[int],
    settings: Settings,
) -> TiledCSpace:
    """What :func:`cspace.build` does with a ``store``; its arguments are checked.

    What an earlier call left half done is gone on with.

    Raises InputError if the tile is not usable, or a task does not fit into memory, and FileError if the store is of
    something else, or cannot be written, or the workspace has changed.
    """
    grid, cells, rotations = workspace.grid, workspace.cells, settings["rotations"]
    slices = int(rotations.slices_for(robot.shape).max()) + 1
    sides = tile_sides(tile, grid.shape)
    needed = raster_bytes(robot, grid.spacing, settings["margin"], rotations, slices)  # each process has all of them
    check_memory(needed, "the map", grid, fewer=rotations.fewer, slices=slices, rasters=needed)
    outside, margin = settings["outside"], settings["margin"]
    about = {
        **describe_map(grid, robot, rotations, slices, outside, margin, workspace.source),
        "inner": int(settings["inner"]),
        "tile": list(sides),
        "depth": max(1, min(slices, CHUNK_CELLS // math.prod(sides))),
        "method": settings["method"],
        "same": cells.same,
        "stamp": cells.stamp,
        "precision": "",
    }
    shapes = shapes_array(workspace.shapes)
    if is_store(store):
        made = Store.open(store)
        _check_same(made, about, rotations, shapes)
    elif Path(store).exists() and any(Path(store).iterdir() if Path(store).is_dir() else [1]):
        rule = "tiles go into a store of their own"
        raise FileError(str(store), "exists, and is no store of tiles", rule, "choose another name, or remove it")
    else:
        centers = {axis: grid.centers(k) for k, axis in enumerate(AXES[: grid.dim])}
        arrays = {"slice_of": rotations.slices_for(robot.shape), **rotations.coordinates, **centers, **shapes}
        with replacing(store, folder=is_store) as temporary:
            Store.create(temporary, about, arrays)
        made = Store.open(store)
    if not made.is_done:
        _fill(Job(made, cells), settings)
        made = Store.open(store)
    return TiledCSpace(made)


def _fill(job: Job, settings: Settings) -> None:
    """Make the tiles that are not there, and write down that all are."""
    store, progress = job.store, settings["progress"]
    done = set(store.done())
    todo = [index for index in store if index not in done]

    def advance(number: int) -> None:
        if progress is not None:
            progress(len(done) + number, len(store))

    run(make, job, todo, settings["client"], settings["workers"], advance)
    advance(len(todo))
    engine = store.metadata["method"]
    if engine == "auto":
        engine = choose_engine([outer for outer, _ in job.pairs])
    store.tidy()
    store.reseal(**store.totals(), precision=ENGINES[engine].PRECISION)


def make(job: Job, index: Index) -> None:
    """The task of a build."""
    job.make(index)


def tile_sides(tile: int | Sequence[int], shape: Sequence[int]) -> tuple[int, ...]:
    """Return the cells of a tile along each axis: no more than there are, or than a chunk may hold.

    Raises InputError if it is not one whole number above zero, or one for each axis.
    """
    given = np.asarray(tile)
    if given.dtype.kind not in "iu" or given.shape not in ((), (len(shape),)) or (given < 1).any():
        rule = "it must be a whole number of cells above zero, or one for each axis"
        raise InputError("tile", f"is {tile!r}", rule, "pass e.g. 4096", value=tile)
    sides = np.broadcast_to(given, (len(shape),))
    return fit_tile([min(int(side), n) for side, n in zip(sides, shape, strict=True)])


def _check_same(store: Store, about: dict[str, Any], rotations: Rotations, shapes: dict[str, NDArray[Any]]) -> None:
    """Refuse to go on with the store of another map.

    Raises FileError if a setting or the workspace is another one.
    """
    hint = "choose another name, or remove it"
    settings = {name: (store.metadata.get(name), value) for name, value in about.items() if name not in _OTHER}
    for name, (theirs, ours) in {**settings, "rotations": (store.rotations, rotations)}.items():
        if theirs != ours:
            problem = f"exists, and is of another map: its {name} is {theirs!s:.60} and not {ours!s:.60}"
            raise FileError(
                str(store.path), problem, "a build goes on with what was begun with the same settings", hint
            )
    is_same = store.metadata["stamp"] == about["stamp"]
    if is_same and "shapes" in store.names:
        is_same = "shapes" in shapes and np.array_equal(store.array("shapes"), shapes["shapes"])
    if not is_same:
        problem = f"exists, and its workspace, {store.metadata['workspace_source']}, was another one"
        rule = "a build goes on with what was begun on the same obstacles, by their size, time or digest"
        raise FileError(str(store.path), problem, rule, hint)

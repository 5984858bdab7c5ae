"""Build a map into a store, tile by tile."""

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
from cspace.tiles.work import Job, run_tasks
from cspace.words import Method, Outside
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client

_METADATA_NOT_COMPARED: Final = ("library_version", "stamp", "workspace_source", "precision", "depth")
"""Metadata that may differ between two stores of the same map; the stamp is compared separately."""


class Settings(TypedDict):
    """Checked options of a build; see :func:`cspace.build`."""

    rotations: Rotations
    inner: bool
    method: Method
    outside: Outside
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
    """Build a map into a store, or complete one.

    The caller, :func:`cspace.build`, has checked the arguments. Raises InputError if ``tile`` is invalid or a task
    exceeds the memory; FileError if ``store`` holds something else, cannot be written, or the workspace has changed.
    """
    grid, cells, rotations = workspace.grid, workspace.cells, settings["rotations"]
    slices = int(rotations._slices_for(robot.shape).max()) + 1
    sides = resolve_tile(tile, grid.shape)
    needed = raster_bytes(robot, grid.spacing, settings["margin"], rotations, slices)  # every process holds all rasters
    check_memory(needed, "the map", grid, slices=slices)
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
        opened = Store.open(store)
        _check_same(opened, about, rotations, shapes)
    elif Path(store).exists() and any(Path(store).iterdir() if Path(store).is_dir() else [1]):
        raise FileError(
            str(store), "exists, but is not a map", "store must be new, empty or a map", "choose another name"
        )
    else:
        centers = {axis: grid.centers(k) for k, axis in enumerate(AXES[: grid.dim])}
        arrays = {"slice_of": rotations._slices_for(robot.shape), **rotations._coordinates, **centers, **shapes}
        with replacing(store, folder=is_store) as temporary:
            Store.create(temporary, about, arrays)
        opened = Store.open(store)
    if not opened.is_done:
        _build_missing_tiles(Job(opened, cells), settings)
        opened = Store.open(store)
    return TiledCSpace(opened)


def _build_missing_tiles(job: Job, settings: Settings) -> None:
    """Build missing tiles, then mark the store complete."""
    store, progress = job.store, settings["progress"]
    done = set(store.done())
    missing = [index for index in store if index not in done]

    def advance(count: int) -> None:
        if progress is not None:
            progress(len(done) + count, len(store))

    run_tasks(build_tile, job, missing, settings["client"], settings["workers"], advance)
    advance(len(missing))
    engine = store.metadata["method"]
    if engine == "auto":
        engine = choose_engine([outer for outer, _ in job.pairs])
    store.tidy()
    store.reseal(**store.totals(), precision=ENGINES[engine].PRECISION)


def build_tile(job: Job, index: Index) -> None:
    """Build and write one tile, as a task."""
    job.build_tile(index)


def resolve_tile(tile: int | Sequence[int], shape: Sequence[int]) -> tuple[int, ...]:
    """Return the cells of a tile along each axis.

    The grid and the size of a chunk limit them. Raises InputError unless ``tile`` is a positive integer, or one for
    each axis.
    """
    given = np.asarray(tile)
    if given.dtype.kind not in "iu" or given.shape not in ((), (len(shape),)) or (given < 1).any():
        rule = "it must be a positive integer, or one for each axis"
        raise InputError("tile", f"is {tile!r}", rule, "pass e.g. 4096", value=tile)
    sides = np.broadcast_to(given, (len(shape),))
    return fit_tile([min(int(side), n) for side, n in zip(sides, shape, strict=True)])


def _check_same(store: Store, about: dict[str, Any], rotations: Rotations, shapes: dict[str, NDArray[Any]]) -> None:
    """Raise FileError if a store has other settings or cells."""
    hint = "choose another name, or remove it"
    settings = {
        name: (store.metadata.get(name), value) for name, value in about.items() if name not in _METADATA_NOT_COMPARED
    }
    for name, (theirs, ours) in {**settings, "rotations": (store.rotations, rotations)}.items():
        if theirs != ours:
            problem = f"holds another map: {name} is {theirs!s:.60}, not {ours!s:.60}"
            raise FileError(str(store.path), problem, "a build can only resume with the same settings", hint)
    is_same = store.metadata["stamp"] == about["stamp"]
    if is_same and "shapes" in store.names:
        is_same = "shapes" in shapes and np.array_equal(store.array("shapes"), shapes["shapes"])
    if not is_same:
        problem = f"was built on other obstacles: {store.metadata['workspace_source']} has another size, time or digest"
        raise FileError(str(store.path), problem, "a build can only resume on the same obstacles", hint)

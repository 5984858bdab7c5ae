"""Maps built tile by tile into a store, on this machine or on a cluster."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict

import numpy as np

from cspace.engines import choose
from cspace.engines.slices import Progress, raster_bytes
from cspace.errors import FileError, InputError
from cspace.limits import check_memory
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.store.saved import digest_of_array, shapes_array
from cspace.store.tiled import CHUNK_CELLS, Index, Store, is_tiled
from cspace.tiles.space import TiledCSpace
from cspace.tiles.work import Job, run
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client

_OWN: Final = (
    *("version", "aside", "box", "counts", "digest", "digests", "library_version"),
    *("stamp", "shapes", "workspace_source"),
)
"""Metadata that are no setting of a build."""

_NEW: Final = {"version": 0, "aside": "", "box": None, "counts": None}
"""Those of a store in which nothing is done yet."""


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
    about: dict[str, Any] = {
        "lower": list(grid.lower),
        "spacing": grid.spacing,
        "shape": list(grid.shape),
        "axes": " ".join((*grid.axes, *rotations.names)),
        "units": " ".join(grid.units),
        "outside": settings["outside"],
        "margin": float(settings["margin"]),
        "rotations": rotations.count,
        "slices": slices,
        "robot": robot.definition,
        "tile": list(sides),
        "depth": max(1, min(slices, CHUNK_CELLS // math.prod(sides))),
        "inner": bool(settings["inner"]),
        "method": settings["method"],
        "same": cells.same,
    }
    stamp = cells.stamp
    shapes = shapes_array(workspace.shapes)
    digest = "".join(map(digest_of_array, shapes.values()))
    own = {"workspace_source": workspace.source, "stamp": stamp, "shapes": digest, "precision": ""}
    if is_tiled(store):
        made = Store.open(store)
        _check_same(made, about, stamp, digest)
    elif Path(store).exists() and any(Path(store).iterdir() if Path(store).is_dir() else [1]):
        rule = "tiles go into a store of their own"
        raise FileError(str(store), "exists, and is no store of tiles", rule, "choose another name, or remove it")
    else:
        made = Store.create(store, {**about, **own, **_NEW}, robot, rotations, shapes)
    if made.metadata["box"] is None:
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
        engine = choose([outer for outer, _ in job.pairs])
    store.tidy()
    store.sealed(**store.totals(), precision="integer" if engine == "direct" else "float64")


def make(job: Job, index: Index) -> None:
    """The task of a build."""
    job.make(index)


def tile_sides(tile: int | Sequence[int], shape: Sequence[int]) -> tuple[int, ...]:
    """Cells of a tile along each axis, no more than there are.

    Raises InputError if it is not one whole number above zero, or one for each axis.
    """
    given = np.asarray(tile)
    if given.dtype.kind not in "iu" or given.shape not in ((), (len(shape),)) or (given < 1).any():
        rule = "it must be a whole number of cells above zero, or one for each axis"
        raise InputError("tile", f"is {tile!r}", rule, "pass e.g. 4096", value=tile)
    return tuple(min(int(side), n) for side, n in zip(np.broadcast_to(given, (len(shape),)), shape, strict=True))


def _check_same(store: Store, settings: dict[str, Any], stamp: str, shapes: str) -> None:
    """Refuse to go on with the store of another map."""
    theirs = {name: value for name, value in store.metadata.items() if name not in _OWN}
    for name, value in settings.items():
        if theirs.get(name) != value:
            fault = f"exists, and is of another map: its {name} is {theirs.get(name)!s:.60} and not {value!s:.60}"
            mend = "choose another name, or remove it"
            raise FileError(str(store.path), fault, "a build goes on with what was begun with the same settings", mend)
    if store.metadata["stamp"] != stamp or store.metadata.get("shapes", "") not in ("", shapes):
        fault = f"exists, and its workspace, {store.metadata['workspace_source']}, was another one"
        rule = "a build goes on with what was begun on the same obstacles, by their size, time or digest"
        raise FileError(str(store.path), fault, rule, "choose another name, or remove it")

"""Updates of tiled maps: the tiles that a change reaches are built again."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cspace.arrays import Bools, Box, Ints, intersect_boxes
from cspace.tiles.build import BuildJob, bytes_to_build, make_tile
from cspace.tiles.folder import Index, TileFolder, fresh_name, grow, tile_name
from cspace.tiles.parts import OpenTiles
from cspace.tiles.work import run_tasks
from cspace.update import Patch, Update

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True)
class PatchedCells:
    """Workspace cells of a tiled map with a patch, as a source."""

    folder: TileFolder
    patch: Patch
    same = False

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box in the grid."""
        corners = np.array([[part.start, part.stop] for part in box]).T
        outer, inner = read_obstacles(self.folder, corners)
        here, there = intersect_boxes(box, self.patch.window)
        if all(part.start < part.stop for part in here):
            outer[here], inner[here] = self.patch.outer[there], self.patch.inner[there]
        return outer, inner

    @property
    def stamp(self) -> str:
        """Stamp of the workspace that the map was built on."""
        return str(self.folder.attributes["source_stamp"])


def read_obstacles(folder: TileFolder, corners: Ints) -> tuple[Bools, Bools]:
    """Read the outer and inner workspace cells of a box in the grid."""
    workspace = OpenTiles(folder, 0).window(corners).workspace
    return workspace.outer.copy(), workspace.inner.copy()


def update_tiles(path: Path, patch: Patch, client: Client | None) -> Update:
    """Write a patch of the workspace into a map, and replace all tiles that it reaches together.

    Raises FileError if the map cannot be read or written. An update that fails changes nothing.
    """
    with _lock_folder(path):
        folder = TileFolder.open(path)
        first = np.array(patch.lower)
        outer, inner = read_obstacles(folder, np.stack([first, first + patch.outer.shape]))
        differ = (outer != patch.outer) | (inner != patch.inner)
        if not differ.any():
            return Update(0, patch.lower, patch.lower, 0)
        cells = np.argwhere(differ) + first
        changed = np.stack([cells.min(axis=0), cells.max(axis=0) + 1])
        reached = folder.clip(grow(changed, folder.reach))
        touched = list(folder.tiles_in(grow(reached, folder.halo)))
        names = {tile_name(index): fresh_name(tile_name(index)) for index in touched}
        job, needed = BuildJob(folder, PatchedCells(folder, patch)), bytes_to_build(folder)
        numbers = run_tasks(partial(_rebuild_tile, names), job, touched, needed, client)
        names = {**folder.attributes["names"], **names}
        folder.commit(names=names, updates=folder.attributes["updates"] + 1)
    lower, upper = map(tuple, reached.tolist())
    return Update(int(np.count_nonzero(differ)), lower, upper, sum(numbers))


def _rebuild_tile(names: dict[str, str], job: BuildJob, index: Index) -> int:
    """Write a new tile beside the old one, as a task; return the number of changed states."""
    folder, own = job.folder, (slice(None), *job.folder.own(index))
    tile, old = make_tile(job, index), folder.read_tile(index)
    folder.write_tile(index, tile, names[tile_name(index)])
    differ = (tile.states[own] != old.states[own]).reshape(folder.slices, -1)
    return int(np.bincount(folder.slice_of) @ np.count_nonzero(differ, axis=1))


@contextmanager
def _lock_folder(path: Path) -> Iterator[None]:
    """Let the updates of other processes wait, except on Windows, which has no such locks."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)

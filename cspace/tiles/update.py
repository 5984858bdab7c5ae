"""Updates of tiled maps: all tiles that a change reaches are replaced at one moment."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from cspace.files.access import replacing
from cspace.map.contents import Contents
from cspace.map.exterior import Exterior
from cspace.save import is_map_folder
from cspace.tiles.folder import TileFolder, as_box, grow, write_root
from cspace.tiles.parts import OpenTiles
from cspace.update import Patch, Update


def update_tiles(path: Path, patch: Patch) -> Update:
    """Write a patch of the workspace into a map, and replace its folder by a new one.

    A window around the patch is updated in memory. Tiles that the change does not reach are linked
    into the new folder. Raises InputError if the window does not fit into memory, and FileError if
    the map cannot be read or written; the old folder then stays.
    """
    with _lock(path.parent):
        folder = TileFolder.open(path)
        tiles, first = OpenTiles(folder, 0), np.array(patch.lower)
        corners = np.stack([first, first + patch.outer.shape])
        reached = folder.clip(grow(corners, folder.reach))
        around = folder.clip(grow(reached, folder.reach))
        window = tiles.window(around, Exterior(folder.exterior.table.copy()))
        update = window.update(patch.outer, first - around[0], inner=patch.inner)
        lower, upper = (tuple((around[0] + end).tolist()) for end in (update.lower, update.upper))
        if not update.occupied:
            return replace(update, lower=lower, upper=upper)
        touched = set(folder.tiles_in(grow(reached, folder.halo)))
        with replacing(path, overwrite=True, folder=is_map_folder) as temporary:
            kept = [folder.tile_path(index) for index in folder if index not in touched]
            for source in kept:
                shutil.copytree(source, temporary / source.name, copy_function=os.link)
            cell = replace(
                folder.frame.workspace, shapes=None
            )  # shapes no longer describe the cells
            frame = replace(folder.frame, workspace=cell, exterior=None)
            write_root(temporary, frame, {**folder.about, "updates": folder.about["updates"] + 1})
            new = TileFolder.open(temporary)
            for index in touched:
                tile, cells = folder.read_tile(index), folder.cells(index)
                both = np.clip(reached, *cells)
                here, there = as_box(both - cells[0]), as_box(both - around[0])
                new.write_tile(index, _copy_cells(window._contents, there, tile, here))
            new.complete()
    return replace(update, lower=lower, upper=upper)


def _copy_cells(
    source: Contents, there: tuple[slice, ...], tile: Contents, here: tuple[slice, ...]
) -> Contents:
    """Return a tile with a box of cells from another map."""
    outer, inner = tile.workspace.outer.copy(), tile.workspace.inner.copy()
    outer[here] = source.workspace.outer[there]
    inner[here] = source.workspace.inner[there]
    tile.states[(slice(None), *here)] = source.states[(slice(None), *there)]
    return replace(tile, workspace=replace(tile.workspace, outer=outer, inner=inner))


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Let the updates of other processes wait, except on Windows, which has no such locks."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)

"""Folders of tiled maps: a saved map for each tile, and what all tiles share.

A tiled map is a saved map of its first cell, the *frame*, which has the robot, the rotation cells
and the obstacles as shapes. Its attributes also describe the tiles and the state of the build. Each
tile is a saved map in a folder of its own, with the tile's cells, its *interior*, and a *halo* of
the cells around them, clipped to the grid. It is named by its index, such as ``0.3``, and written
under another name first, so a tile with its name is complete.

A *stamp* is a digest of everything that the map depends on, so that only a build of the same map
resumes, and only with its own tiles. Each tile has the stamp of its map. The frame of a complete
map also has the states outside the grid.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final

import numpy as np

from cspace.engines.slices import slice_rasters
from cspace.files.access import replacing
from cspace.files.zarr_folders import ROOT_FILE
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.record.contents import Contents
from cspace.record.description import FORMAT, arrays_of, metadata_of
from cspace.record.exterior import Exterior
from cspace.record.save import (
    TILES_FORMAT,
    is_map_folder,
    making_map,
    map_error,
    read_map_and_attributes,
    read_root,
    write_map,
)
from cspace.record.states import count_states
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.support.arrays import MIXED, Box, Ints, StrPath
from cspace.workspace import Workspace

MIN_HALO_CELLS: Final = 4
"""Minimum width of the halo of a tile, in cells; proofs of motions and clearances need it."""

MAX_HALO_CELLS: Final = 64
"""Maximum width of the halo of a tile, in cells."""

TILE_SIDES_PER_HALO: Final = 16
"""Shortest side of a tile, in widths of its halo; halos then add little to a map."""

Index = tuple[int, ...]
"""Index of a tile along each axis."""

# Boxes of cells are arrays of two corners, shape (2, d): the first cell, and the cell after the
# last.

ONE_MORE: Final = np.array([[0], [1]])
"""Makes corners of a first and a last cell."""


@dataclass(frozen=True)
class TileFolder:
    """The folder of a tiled map at one moment.

    Attributes
    ----------
    path : Path
    layout : mapping
        ``shape`` of the grid and ``side`` of a tile, in cells; ``stamp``, and ``source_stamp`` of
        the workspace.
    frame : Contents
        Map of the first cell; if all tiles are complete, with the states outside the grid.
    """

    path: Path
    layout: Mapping[str, Any]
    frame: Contents

    @cached_property
    def grid(self) -> Grid:
        """Grid of the whole map."""
        return self.sub_grid(np.array([[0] * len(self.tile), self.layout["shape"]]))

    def sub_grid(self, corners: Ints) -> Grid:
        """Return the grid of a box of cells, inside the whole grid or not."""
        cell = self.frame.grid
        lower = np.array(cell.lower) + cell.spacing * corners[0]
        return Grid(lower, cell.spacing, corners[1] - corners[0], cell.axes, cell.units)

    @property
    def tile(self) -> tuple[int, ...]:
        """Number of cells of a tile's interior along each axis."""
        return tuple(self.layout["side"])

    @property
    def halo(self) -> int:
        """Width of the halo of a tile, in cells."""
        width = min(self.tile) // TILE_SIDES_PER_HALO
        return min(MAX_HALO_CELLS, max(MIN_HALO_CELLS, width))

    @property
    def slices(self) -> int:
        """Number of slices."""
        return len(self.frame.states)

    @cached_property
    def reach(self) -> int:
        """Number of cells along an axis from which the robot may touch a cell, rounded up."""
        frame = self.frame
        farthest_corner = np.abs(frame.robot.shape.outer.bounds).max(axis=0)
        radius = np.linalg.norm(farthest_corner)
        angle = min(frame.rotations.covering_angles.max(), math.pi)
        # The outer raster is that of a robot whose points move within a rotation cell.
        metres = radius * (1.0 + 2.0 * math.sin(angle / 2.0)) + frame.margin
        return math.ceil(metres / frame.grid.spacing) + 2

    # ---- tiles -----------------------------------------------------------------------------------

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each axis."""
        counts = -(-np.array(self.layout["shape"]) // self.tile)
        return tuple(counts.tolist())

    def __iter__(self) -> Iterator[Index]:
        """Iterate over the indices of all tiles."""
        return itertools.product(*map(range, self.counts))

    def __len__(self) -> int:
        """Return the number of tiles."""
        return math.prod(self.counts)

    def find_number(self, index: Index) -> int:
        """Return the position of a tile among all tiles."""
        return int(np.ravel_multi_index(index, self.counts))

    def find_index(self, number: int) -> Index:
        """Return the index of the tile at a position among all tiles."""
        return tuple(map(int, np.unravel_index(number, self.counts)))

    def locate_interior(self, index: Index) -> Ints:
        """Return the corners of a tile without its halo."""
        first = np.multiply(index, self.tile)
        return self.clip(np.stack([first, first + self.tile]))

    def locate_tile(self, index: Index) -> Ints:
        """Return the corners of a tile with its halo."""
        return self.clip(grow(self.locate_interior(index), self.halo))

    def locate_interior_in_tile(self, index: Index) -> Box:
        """Return the interior of a tile, in the indices of the tile's arrays."""
        return as_box(self.locate_interior(index) - self.locate_tile(index)[0])

    def clip(self, corners: Ints) -> Ints:
        """Return the part of a box in the grid."""
        return np.clip(corners, 0, self.layout["shape"])

    def list_tiles(self, corners: Ints) -> Iterator[Index]:
        """Iterate over the tiles whose interiors meet a box."""
        first, stop = self.clip(corners)
        stop_index = -(-stop // self.tile)
        return itertools.product(*map(range, first // self.tile, stop_index))

    def group_by_tile(self, cells: Ints, rows: Ints) -> Iterator[tuple[Index, Ints]]:
        """Group rows of cells, shape (n, d), by the tiles that the cells lie in.

        Yields each tile with its rows. A cell outside the grid counts to the nearest tile.
        """
        indices = tuple((cells[rows] // self.tile).T)
        numbers = np.ravel_multi_index(indices, self.counts, mode="clip")
        for number in np.unique(numbers):
            yield self.find_index(number), rows[numbers == number]

    def tile_path(self, index: Index) -> Path:
        """Return the folder of a tile, which exists if the tile is complete."""
        return self.path / ".".join(map(str, index))

    @property
    def progress(self) -> float:
        """Fraction of complete tiles, below 1 until the map is complete."""
        if self.frame.exterior is not None:
            return 1.0
        done = sum(self.tile_path(index).exists() for index in self)
        return min(done / len(self), 1.0 - 2.0**-20)

    def read_tile(self, index: Index) -> Contents:
        """Read a tile, as a map whose outside is unknown.

        Raises FileError if it is missing, damaged or a tile of another map or place.
        """
        path = self.tile_path(index)
        tile, attributes = read_map_and_attributes(path)
        self._check_stamp(index, attributes)
        if tile.grid != self.sub_grid(self.locate_tile(index)):
            raise map_error(path, "it is a tile of another place")
        return tile

    def read_summaries(self) -> list[dict[str, Any]]:
        """Read the attributes of all tiles.

        Raises FileError if a tile is of another map.
        """
        summaries = []
        for index in self:
            attributes, _ = read_root(self.tile_path(index), FORMAT)
            self._check_stamp(index, attributes)
            summaries.append(attributes)
        return summaries

    def _check_stamp(self, index: Index, attributes: Mapping[str, Any]) -> None:
        """Raise FileError unless the attributes of a tile have the stamp of the map."""
        if attributes.get("stamp") != self.layout["stamp"]:
            raise map_error(self.tile_path(index), "it is a tile of another map")

    def write_tile(self, index: Index, contents: Contents) -> None:
        """Write a tile; its name appears when it is complete.

        Its attributes also have the number of FREE, MIXED and BLOCKED cells of its interior, and
        the box of obstacles in it.
        """
        states = contents.states[:, *self.locate_interior_in_tile(index)]
        rotations_of_slice = np.bincount(self.frame.slice_of)
        counts = rotations_of_slice @ count_states(states)
        first_cell = tuple(self.locate_tile(index)[0].tolist())
        occupied = Raster.from_bitmap(contents.workspace.outer, first_cell)
        box = [occupied.lower, occupied.upper] if occupied.count else None
        summary = {"stamp": self.layout["stamp"], "counts": counts.tolist(), "obstacles": box}
        with replacing(self.tile_path(index), overwrite=True, folder=is_map_folder) as temporary:
            write_map(contents, temporary, **summary)

    # ---- the folder ------------------------------------------------------------------------------

    @classmethod
    def open(cls, path: StrPath) -> TileFolder:
        """Open the folder of a tiled map, complete or not; tiles are read later.

        Raises FileError if it is missing or was changed, of another version, or describes no map.
        """
        root = Path(path).absolute()  # workers have other working folders
        frame, attributes = read_map_and_attributes(root, TILES_FORMAT)
        with making_map(root):
            layout = attributes["tiles"]
            sizes = np.array([layout["shape"], layout["side"]])
            if sizes.dtype.kind != "i" or sizes.shape != (2, frame.grid.dim) or sizes.min() < 1:
                raise ValueError(f"its grid and tiles have the sides {sizes.tolist()}")
            return cls(root, layout, frame)

    def complete(self) -> TileFolder:
        """Write the states outside the grid; return the complete folder.

        Raises FileError if a tile is of another map.
        """
        frame = self.frame
        shape = self.layout["shape"]
        no_box = [[max(shape)] * len(shape), [-1] * len(shape)]
        boxes = np.array([tile["obstacles"] or no_box for tile in self.read_summaries()])
        obstacles = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
        rasters = slice_rasters(frame.robot, frame.grid.spacing, frame.margin, frame.rotations)
        exterior = Exterior.around(shape, obstacles, rasters, frame.outside)
        temporary = Path(mkdtemp(prefix=".cspace-", dir=self.path))
        write_root(temporary, replace(frame, exterior=exterior), self.layout)
        with suppress(OSError):  # another build of the map has just written the same
            (temporary / "exterior").rename(self.path / "exterior")
        (temporary / ROOT_FILE).replace(self.path / ROOT_FILE)
        for leftover in self.path.glob(".cspace-*"):
            shutil.rmtree(leftover, ignore_errors=True)
        return TileFolder.open(self.path)


def grow(corners: Ints, cells: int) -> Ints:
    """Return a box with more cells on every side."""
    return np.stack([corners[0] - cells, corners[1] + cells])


def as_box(corners: Ints) -> Box:
    """Return corners, shape (2, d), as slices: the first cell, and the cell after the last one."""
    return tuple(map(slice, *corners.tolist()))


def make_frame(
    workspace: Workspace, robot: Robot, rotations: Rotations, **options: Any
) -> Contents:
    """Return a map of the first cell of a workspace, with what all tiles share."""
    whole = workspace.grid
    one_cell = (1,) * whole.dim
    grid = Grid(whole.lower, whole.spacing, one_cell, whole.axes, whole.units)
    occupied = np.ones(one_cell, dtype=np.bool_)
    cell = Workspace(grid, occupied, occupied, source=workspace.source, shapes=workspace.shapes)
    slice_of = rotations.assign_slices(robot.shape)
    slices = int(slice_of.max()) + 1
    states = np.full((slices, *one_cell), MIXED, dtype=np.uint8)
    return Contents(cell, robot, rotations, slice_of, states, **options)


def make_stamp(frame: Contents, *others: Any) -> str:
    """Return a digest of a frame and of other values, on which a tiled map depends."""
    # The same map may be built from another file, or by another version.
    metadata = {**metadata_of(frame), "workspace_source": "", "library_version": ""}
    digest = hashlib.sha256(json.dumps([metadata, *others], sort_keys=True).encode())
    for array in arrays_of(frame).values():
        digest.update(array.tobytes())
    return digest.hexdigest()


def write_root(path: Path, frame: Contents, layout: Mapping[str, Any]) -> None:
    """Write what all tiles of a map share into a folder."""
    write_map(frame, path, format=TILES_FORMAT, tiles=layout)

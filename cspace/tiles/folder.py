"""Folders of tiled maps: a saved map for each tile, and what all tiles share.

A tiled map is a Zarr group. ``zarr.json`` has the shape of the whole grid, the size of a tile, and
the state of the build. ``frame`` is a saved map of one cell; it has the robot, the rotation cells,
and the obstacles as shapes. Each tile is a saved map with its own cells, its *interior*, and a
*halo* of the cells around them, clipped to the grid. It is named by its index, such as ``0.3``, and
written under another name first, so a tile with its name is complete.

A *stamp* is a digest of everything that the map depends on. Only a build with the same stamp
resumes, and only tiles with the stamp of the folder are read. A complete map also knows the digests
of its tiles, so it refuses a tile of an earlier state.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import shutil
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace import __version__
from cspace.arrays import MIXED, Box, Ints, StrPath
from cspace.engines.slices import slice_rasters
from cspace.errors import FileError
from cspace.files.access import replacing
from cspace.files.zarr_folders import ROOT_FILE
from cspace.grid import Grid
from cspace.map.contents import Contents
from cspace.map.description import FORMAT, VERSION
from cspace.map.exterior import Exterior
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.save import (
    TILES_FORMAT,
    check_digest,
    check_exterior,
    is_map_folder,
    making_map,
    map_error,
    read_map,
    read_map_and_attributes,
    read_root,
    write_folder,
    write_map,
)
from cspace.workspace import Workspace

MAX_HALO_CELLS: Final = 64
"""Maximum width of the halo of a tile, in cells."""

DIGITS: Final = 16
"""Digits of the digest of a tile that the map keeps."""

SUMS: Final = ("counts", "exterior", "tiles")
"""Attributes of complete maps only."""

MIN_HALO_CELLS: Final = 2
"""Minimum width of the halo of a tile, in cells; proofs of motions need it."""

TILE_SIDES_PER_HALO: Final = 16
"""Shortest side of a tile, in widths of its halo; halos then add little to a map."""

Index = tuple[int, ...]
"""Index of a tile along each axis."""

# Boxes of cells are arrays of two corners, shape (2, d): the first cell, and the cell after the last.

ONE_MORE: Final = np.array([[0], [1]])
"""Makes corners of a first and a last cell."""


@dataclass(frozen=True)
class TileFolder:
    """The folder of a tiled map at one moment.

    Attributes
    ----------
    path : Path
    attributes : mapping
        ``shape`` of the grid and ``tile``, in cells; ``stamp``, and ``source_stamp`` of the
        workspace; ``inner``, true if BLOCKED is proven; ``updates``, their number. Once all tiles are
        complete also ``counts``, the numbers of FREE, MIXED and BLOCKED cells; ``exterior``, the
        table of the states outside; ``tiles``, the beginnings of the digests of all tiles.
    frame : Contents
        Map of the first cell, with the states outside the grid.
    moment : tuple
        Changes with every change of the map.
    """

    path: Path
    attributes: Mapping[str, Any]
    frame: Contents
    moment: tuple[int, int]

    # ---- what it holds ---------------------------------------------------------------------------

    @cached_property
    def grid(self) -> Grid:
        """Grid of the whole map."""
        cell = self.frame.grid
        return Grid(cell.lower, cell.spacing, self.attributes["shape"], cell.axes, cell.units)

    @property
    def robot(self) -> Robot:
        """Robot of the map."""
        return self.frame.robot

    @property
    def rotations(self) -> Rotations:
        """Rotation cells of the map."""
        return self.frame.rotations

    @property
    def slice_of(self) -> Ints:
        """Slice of each rotation cell."""
        return self.frame.slice_of

    @property
    def outside(self) -> str:
        """State of space outside the workspace."""
        return self.frame.outside

    @property
    def margin(self) -> float:
        """Metres by which the robot was grown to prove FREE."""
        return self.frame.margin

    @property
    def exterior(self) -> Exterior:
        """States outside the grid of a complete map."""
        return self.frame.exterior or Exterior(np.empty((0, 0), dtype=np.int64))

    @property
    def slices(self) -> int:
        """Number of slices."""
        return len(self.frame.states)

    @property
    def tile(self) -> tuple[int, ...]:
        """Number of cells of a tile's interior along each axis."""
        return tuple(self.attributes["tile"])

    @property
    def halo(self) -> int:
        """Width of the halo of a tile, in cells."""
        return min(MAX_HALO_CELLS, max(MIN_HALO_CELLS, min(self.tile) // TILE_SIDES_PER_HALO))

    @cached_property
    def reach(self) -> int:
        """Number of cells along an axis from which the robot may touch a cell, rounded up."""
        corner = np.abs(self.robot.shape.outer.bounds).max(axis=0)
        radius = np.linalg.norm(corner) if self.rotations.names else corner.max()
        angle = min(float(self.rotations.covering_angles.max()), math.pi)
        # The outer raster is that of a robot whose points move within a rotation cell.
        far = float(radius) * (1.0 + 2.0 * math.sin(angle / 2.0)) + self.margin
        return math.ceil(far / self.grid.spacing) + 2

    # ---- tiles -----------------------------------------------------------------------------------

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each axis."""
        return tuple(-(-n // t) for n, t in zip(self.grid.shape, self.tile, strict=True))

    def __iter__(self) -> Iterator[Index]:
        """Iterate over the indices of all tiles."""
        return itertools.product(*map(range, self.counts))

    def __len__(self) -> int:
        """Return the number of tiles."""
        return math.prod(self.counts)

    def interior(self, index: Index) -> Ints:
        """Return the corners of a tile without its halo."""
        first = np.multiply(index, self.tile)
        return self.clip(np.stack([first, first + self.tile]))

    def cells(self, index: Index) -> Ints:
        """Return the corners of a tile with its halo."""
        return self.clip(grow(self.interior(index), self.halo))

    def own(self, index: Index) -> Box:
        """Return the interior of a tile, in the indices of the tile's arrays."""
        return as_box(self.interior(index) - self.cells(index)[0])

    def clip(self, corners: Ints) -> Ints:
        """Return the part of a box in the grid."""
        return np.asarray(np.clip(corners, 0, self.grid.shape))

    def tiles_in(self, corners: Ints) -> Iterator[Index]:
        """Iterate over the tiles whose interiors meet a box."""
        first, stop = self.clip(corners)
        return itertools.product(*map(range, first // self.tile, -(-stop // self.tile)))

    def sub_grid(self, corners: Ints) -> Grid:
        """Return the grid of a box of cells, inside the whole grid or not."""
        whole = self.grid
        lower = np.array(whole.lower) + whole.spacing * corners[0]
        return Grid(lower, whole.spacing, corners[1] - corners[0], whole.axes, whole.units)

    def tile_path(self, index: Index) -> Path:
        """Return the folder of a tile, which exists if the tile is complete."""
        return self.path / ".".join(map(str, index))

    @property
    def is_done(self) -> bool:
        """True if all tiles are complete and summed up."""
        return "counts" in self.attributes

    @property
    def progress(self) -> float:
        """Fraction of complete tiles, below 1 until all are done."""
        if self.is_done:
            return 1.0
        done = sum(self.tile_path(index).exists() for index in self)
        return min(done / len(self), 1.0 - 2.0**-20)

    def read_tile(self, index: Index) -> Contents:
        """Read a tile as a map whose outside is unknown.

        Raises FileError if it is missing, damaged, or of another map.
        """
        path, grid = self.tile_path(index), self.sub_grid(self.cells(index))
        contents, about = read_map_and_attributes(path)
        found = about.get("tile"), about.get("stamp"), contents.grid, contents.rotations
        if found != (list(index), self.attributes["stamp"], grid, self.rotations):
            raise map_error(path, "it is a tile of another map or another place")
        if self.is_done and about["digest"][:DIGITS] != self._digests[index]:
            raise map_error(path, "it has changed since the map was complete")
        with making_map(path):
            return replace(contents, robot=self.robot, slice_of=self.slice_of)

    def write_tile(self, index: Index, contents: Contents) -> None:
        """Write a tile; its name appears when it is complete."""
        own, dim = self.own(index), self.grid.dim
        outer, counts = contents.workspace.outer[own], np.zeros(3, dtype=np.int64)
        for states, weight in zip(contents.states, np.bincount(self.slice_of), strict=True):
            counts += weight * np.array([np.count_nonzero(states[own] == k) for k in range(3)])
        obstacles = []
        for axis, low in enumerate(self.interior(index)[0].tolist()):
            others = tuple(k for k in range(dim) if k != axis)
            used = low + np.flatnonzero(outer.any(axis=others))
            obstacles.append([int(used.min(initial=2**40)), int(used.max(initial=-(2**40)))])
        summary = {
            "tile": list(index),
            "stamp": self.attributes["stamp"],
            "counts": counts.tolist(),
            "obstacles": obstacles,
        }
        with replacing(self.tile_path(index), overwrite=True, folder=is_map_folder) as temporary:
            write_map(contents, temporary, **summary)

    @cached_property
    def _digests(self) -> Mapping[Index, str]:
        """Beginning of the digest of each tile of a complete map."""
        text = self.attributes["tiles"]
        return {index: text[DIGITS * k : DIGITS * (k + 1)] for k, index in enumerate(self)}

    # ---- the folder ------------------------------------------------------------------------------

    @classmethod
    def open(cls, path: StrPath) -> TileFolder:
        """Open the folder of a tiled map, complete or not; tiles are read later.

        Raises FileError if it is missing or was changed, of another version, or describes no map.
        """
        root = Path(path).absolute()  # workers have other working folders
        moment = find_moment(root)
        attributes, digest = read_root(root, TILES_FORMAT)
        check_digest(root, attributes, digest)
        frame = read_map(root / "frame")
        with making_map(root):
            check_attributes(attributes, frame)
            if "exterior" in attributes:
                table = np.array(attributes["exterior"], dtype=np.int64)
                table = table.reshape(len(frame.states), 2 * frame.grid.dim + 1)
                frame = replace(frame, exterior=check_exterior(table, frame.outside))
            if attributes["updates"]:  # the shapes of the obstacles are those before
                frame = replace(frame, workspace=replace(frame.workspace, shapes=None))
            folder = cls(root, attributes, frame, moment)
            _ = folder.grid  # raises if there is no such grid
            return folder

    def complete(self) -> TileFolder:
        """Sum up the tiles and write the sums; return the complete folder."""
        roots = [read_root(self.tile_path(index), FORMAT)[0] for index in self]
        box = np.array([root["obstacles"] for root in roots])
        obstacles = np.stack([box[..., 0].min(axis=0), box[..., 1].max(axis=0)])
        rasters = slice_rasters(self.robot, self.grid.spacing, self.margin, self.rotations)
        exterior = Exterior.around(self.grid.shape, obstacles, rasters, self.outside)
        counts = np.sum([root["counts"] for root in roots], axis=0)
        tiles = "".join(root["digest"][:DIGITS] for root in roots)
        sums = dict(zip(SUMS, (counts.tolist(), exterior.table.tolist(), tiles), strict=True))
        temporary = self.path / f".cspace-{uuid.uuid4().hex[:12]}"
        write_attributes(temporary, {**self.attributes, **sums})
        (temporary / ROOT_FILE).replace(self.path / ROOT_FILE)
        for unused in self.path.glob(".cspace-*"):
            shutil.rmtree(unused, ignore_errors=True)
        return TileFolder.open(self.path)


def grow(corners: Ints, cells: int) -> Ints:
    """Return a box with more cells on every side."""
    return np.stack([corners[0] - cells, corners[1] + cells])


def as_box(corners: Ints) -> Box:
    """Return corners, shape (2, d), as slices: the first cell, and the cell after the last one."""
    return tuple(map(slice, *corners.tolist()))


def find_moment(path: Path) -> tuple[int, int]:
    """Return numbers that change when the attributes of a folder are replaced."""
    try:
        status = (path / ROOT_FILE).stat()
    except OSError:
        return 0, 0
    return status.st_ino, status.st_mtime_ns


def make_frame(workspace: Workspace, robot: Robot, rotations: Rotations, outside: str, margin: float) -> Contents:
    """Return a map of the first cell of a workspace, with what all tiles share."""
    whole, slice_of = workspace.grid, rotations._slices_for(robot.shape)
    ones = (1,) * whole.dim
    occupied = np.ones(ones, dtype=np.bool_)
    grid = Grid(whole.lower, whole.spacing, ones, whole.axes, whole.units)
    cell = Workspace(grid, occupied, occupied, source=workspace.source, shapes=workspace.shapes)
    states = np.full((int(slice_of.max()) + 1, *ones), MIXED, dtype=np.uint8)
    return Contents(cell, robot, rotations, slice_of, states, outside, margin)


def make_stamp(frame: Contents, *others: Any) -> str:
    """Return a digest of a frame and of other values, on which a tiled map depends."""
    grid, shapes = frame.grid, frame.workspace.shapes
    specs = None if shapes is None else [each.spec for each in shapes]
    turns = {name: array.tolist() for name, array in frame.rotations._coordinates.items()}
    about = grid.lower, grid.spacing, grid.axes, frame.outside, frame.margin, turns, specs, others
    text = json.dumps([VERSION, frame.robot._definition, *about], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def write_attributes(path: Path, attributes: Mapping[str, Any]) -> None:
    """Write the attributes of a tiled map into a folder."""
    about = {"format": TILES_FORMAT, "format_version": VERSION, "library_version": __version__}
    known = {key: attributes[key] for key in attributes if key not in (*about, "digest")}
    write_folder(path, {**about, **known})


def check_attributes(attributes: Mapping[str, Any], frame: Contents) -> None:
    """Raise ValueError, or any other error, if attributes make no tiled map."""
    shape, tile, counts = (attributes.get(name, [0, 0, 1]) for name in ("shape", "tile", "counts"))
    numbers = [*shape, *tile, *counts, attributes["updates"], attributes["inner"]]
    if not all(isinstance(n, int) and n >= 0 for n in numbers) or min(*shape, *tile) < 1:
        raise ValueError(f"its sizes are {shape}, {tile} and {counts}")
    if (len(shape), len(tile), len(counts)) != (frame.grid.dim, frame.grid.dim, 3):
        raise ValueError("its sizes differ in length")
    is_done = "counts" in attributes
    if is_done and len(attributes["tiles"]) != DIGITS * math.prod(-(-n // t) for n, t in zip(shape, tile, strict=True)):
        raise ValueError("it does not know all its tiles")
    if is_done and sum(counts) != math.prod(shape) * len(frame.slice_of):
        raise ValueError("its counts differ from its number of cells")
    if {name in attributes for name in SUMS} != {is_done} or not isinstance(attributes["stamp"], str):
        raise ValueError("it is neither complete nor incomplete")


def unfinished_map_error(folder: TileFolder) -> FileError:
    """Return the error for a map with unfinished tiles."""
    rule, hint = "a map must be complete to be read", "run the same build again to finish it"
    return FileError(str(folder.path), f"is {folder.progress:.1%} done", rule, hint)

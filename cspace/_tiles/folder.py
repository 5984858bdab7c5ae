"""Folders of tiled maps: one for each tile, and a saved map with what all tiles share.

A tiled map is a saved map of its first cell, the *frame*, which has the robot, the rotation cells
and the obstacles as shapes. Its attributes also describe the tiles. Each tile has a folder of its
own, with the tile's cells, its *interior*, and a *halo* of the cells around them, clipped to the
grid; all else is in the frame. It is named by its index, such as ``0.3``, and written under another
name first, so a tile with its name is complete.

A *stamp* is a digest of everything that the map depends on, so that only a build of the same map
resumes, and only with its own tiles. Each tile has the stamp of its map and its own index. A
complete map also has the folder ``whole``, with the states outside the grid and the counts of the
states.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace import BLOCKED, FREE, MIXED, Grid, Robot, Rotations, Workspace
from cspace.errors import FileError
from cspace.inside import (
    Contents,
    Exterior,
    Ints,
    MapFolder,
    Raster,
    States,
    StrPath,
    collect_arrays,
    make_metadata,
    rasters_of,
    replacing,
)

MIN_HALO_CELLS: Final = 4
"""Minimum width of the halo of a tile, in cells; proofs of motions and clearances need it."""

MAX_HALO_CELLS: Final = 64
"""Maximum width of the halo of a tile, in cells."""

WORKSPACE_CELL_BYTES: Final = 2
"""Bytes for each cell of a workspace: one in its outer and one in its inner bitmap."""

MAX_TILES: Final = 2**22
"""Maximum number of tiles of a map."""

TILE_SIDES_PER_HALO: Final = 16
"""Shortest side of a tile, in widths of its halo; halos then add little to a map."""

WHOLE: Final = "whole"
"""Folder of what all tiles of a complete map give together."""

# Boxes of cells are arrays of two corners, shape (2, d): the first cell, and the cell after the
# last.

LAST_TO_STOP: Final = np.array([[0], [1]])
"""Added to the first and the last cell of a box, gives its corners, shape (2, d)."""


@dataclass(frozen=True)
class TileFolder:
    """The folder of a tiled map at one moment.

    Attributes
    ----------
    path : Path
    layout : mapping
        ``shape`` of the grid and ``side`` of a tile, in cells; ``stamp``, and ``source_stamp`` of
        the workspace; of a complete map also ``counts`` of its FREE, MIXED and BLOCKED cells.
    frame : Contents
        Map of the first cell; if all tiles are complete, with the states outside the grid.
    """

    path: Path
    layout: Mapping[str, Any]
    frame: Contents

    def __post_init__(self) -> None:
        """Raise any error if the layout is invalid; files may be forged."""
        layout = self.layout
        sizes = np.array([layout["shape"], layout["side"]])
        dim = len(self.frame.grid.shape)
        if sizes.dtype.kind != "i" or sizes.shape != (2, dim) or sizes.min() < 1:
            raise ValueError(f"its grid and tiles have the sides {sizes.tolist()!s:.80}")
        # Making the grid raises an error for cells too far from the origin.
        if self.grid.size < 1 or math.prod(self.counts) > MAX_TILES:
            raise ValueError(f"it has more than {MAX_TILES} tiles")
        if not isinstance(layout["stamp"] + layout["source_stamp"], str):
            raise ValueError("its stamps are no texts")

    @cached_property
    def grid(self) -> Grid:
        """Grid of the whole map."""
        return self.sub_grid(np.array([[0] * len(self.tile), self.layout["shape"]]))

    def sub_grid(self, corners: Ints) -> Grid:
        """Return the grid of a box of cells, inside or not."""
        cell = self.frame.grid
        first, stop = corners
        lower, upper = cell.lower + cell.spacing * corners
        # Rounding may put the upper corner below that of these cells in the whole map.
        missing = upper - (lower + cell.spacing * (stop - first))
        lower += 2.0 * np.maximum(missing, 0.0)
        return Grid(lower, cell.spacing, stop - first, cell.axes, cell.units, cell.frame_id)

    @property
    def tile(self) -> tuple[int, ...]:
        """Number of a tile's interior cells along each axis."""
        return tuple(self.layout["side"])

    @property
    def halo(self) -> int:
        """Width of the halo of a tile, in cells."""
        width = min(self.tile) // TILE_SIDES_PER_HALO
        return min(MAX_HALO_CELLS, max(MIN_HALO_CELLS, width))

    @property
    def cells_of_tile(self) -> int:
        """Maximum number of a tile's cells with halo."""
        return math.prod(side + 2 * self.halo for side in self.tile)

    @property
    def slices(self) -> int:
        """Number of slices."""
        return len(self.frame.states)

    @cached_property
    def reach(self) -> int:
        """Reach of the robot along an axis, in cells, rounded up."""
        frame = self.frame
        farthest_corner = np.abs(frame.robot.shape.outer.bounds).max(axis=0)
        radius = float(np.linalg.norm(farthest_corner))
        # A point moves by at most its radius times this angle within a rotation cell.
        angle = float(frame.rotations.covering_angles.max())
        metres = radius * (1.0 + angle) + frame.margin
        # Two cells more: one because cells have a size, one for rounding.
        return math.ceil(metres / frame.grid.spacing) + 2

    @cached_property
    def rasters(self) -> list[tuple[Raster, Raster]]:
        """Outer and inner raster of the robot at each slice."""
        return rasters_of(self.frame, self.frame.margin)

    # ---- tiles -----------------------------------------------------------------------------------

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of tiles along each axis."""
        counts = -(-np.array(self.layout["shape"]) // self.tile)
        return tuple(counts.tolist())

    def __len__(self) -> int:
        """Return the number of tiles."""
        return math.prod(self.counts)

    @property
    def numbers(self) -> Ints:
        """Index of each tile, as an array of the shape ``counts``."""
        return np.arange(len(self)).reshape(self.counts)

    def locate_interior(self, tile: int) -> Ints:
        """Return the corners of a tile without its halo, shape (2, d)."""
        index = np.unravel_index(tile, self.counts)
        first = np.multiply(index, self.tile)
        return self.clip(np.stack([first, first + self.tile]))

    def locate_tile(self, tile: int) -> Ints:
        """Return the corners of a tile with its halo, shape (2, d)."""
        return self.clip(grow_box(self.locate_interior(tile), self.halo))

    def locate_interior_in_tile(self, tile: int) -> tuple[slice, ...]:
        """Return the interior of a tile as slices of the tile's arrays."""
        return to_slices(self.locate_interior(tile) - self.locate_tile(tile)[0])

    def clip(self, corners: Ints) -> Ints:
        """Return the part of a box that lies in the grid."""
        return np.clip(corners, 0, self.layout["shape"])

    def list_tiles(self, corners: Ints) -> list[int]:
        """Return indices of tiles whose interiors meet a box of cells."""
        first, stop = self.clip(corners)
        # The box of tiles; the division of ``stop`` rounds up.
        tiles = np.stack([first // self.tile, -(-stop // self.tile)])
        return [int(tile) for tile in self.numbers[to_slices(tiles)].flat]

    def group_by_tile(self, cells: Ints, rows: Ints) -> Iterator[tuple[int, Ints]]:
        """Group cells by tile; yield tiles with rows of their cells.

        ``cells`` have shape (n, d), and ``rows`` selects the cells to group. A cell outside the
        grid belongs to the nearest tile.
        """
        indices = tuple((cells[rows] // self.tile).T)
        tiles = np.ravel_multi_index(indices, self.counts, mode="clip")
        for tile in np.unique(tiles).tolist():
            yield tile, rows[tiles == tile]

    def tile_path(self, tile: int) -> Path:
        """Return a tile's folder, which exists when complete."""
        index = np.unravel_index(tile, self.counts)
        return self.path / ".".join(map(str, index))

    @property
    def progress(self) -> float:
        """Fraction of complete tiles, below 1 until the map is complete."""
        if self.frame.exterior is not None:
            return 1.0
        done = sum(self.tile_path(tile).exists() for tile in range(len(self)))
        return min(done / len(self), 1.0 - 2.0**-20)  # 1 only when the frame is written too

    def read_tile(self, tile: int) -> Contents:
        """Read a tile as a map, unknown outside.

        Raises FileError if it is missing, damaged or a tile of another map or place.
        """
        saved = MapFolder(self.tile_path(tile))
        attributes, arrays = saved.read_arrays(("cell_states", "outer"))
        self._check_stamp(tile, attributes)
        with saved.reporting_damage():
            grid = self.sub_grid(self.locate_tile(tile))
            outer = arrays["outer"]
            inner = arrays.get("inner", outer)
            source = self.frame.workspace.source
            contents = self.make_part(
                Workspace(grid, outer, inner, source=source), arrays["cell_states"]
            )
            # Stamps may be forged, and arrays of other sizes would raise any error later.
            saved.check_metadata(attributes, contents)
            return contents

    def make_part(
        self, workspace: Workspace, states: States, exterior: Exterior | None = None
    ) -> Contents:
        """Return a map of this robot, MIXED outside without ``exterior``."""
        outside = self.frame.outside if exterior else "unknown"
        return replace(
            self.frame, workspace=workspace, states=states, outside=outside, exterior=exterior
        )

    def _make_stamp(self, tile: int) -> str:
        """Return a tile's stamp: the map's, and the tile's name."""
        return f"{self.layout['stamp']} {self.tile_path(tile).name}"

    def _check_stamp(self, tile: int, attributes: Mapping[str, Any]) -> None:
        """Raise FileError unless the attributes of a tile have its stamp."""
        if attributes.get("stamp") != self._make_stamp(tile):
            raise MapFolder(self.tile_path(tile)).fail("it is a tile of another map or place")

    def write_tile(self, tile: int, contents: Contents) -> None:
        """Write a tile, which gets its name when it is complete.

        Attributes of the tile give the number of FREE, MIXED and BLOCKED cells of its interior, and
        the box of its obstacles, for :meth:`complete`.
        """
        states = contents.states[:, *self.locate_interior_in_tile(tile)]
        rotations_of_slice = np.bincount(self.frame.slice_of)
        kinds = FREE, MIXED, BLOCKED
        counts_of_slice = [[np.count_nonzero(cells == kind) for kind in kinds] for cells in states]
        counts = rotations_of_slice @ np.array(counts_of_slice)
        first_cell = tuple(self.locate_tile(tile)[0].tolist())
        occupied = Raster.from_bitmap(contents.workspace.outer, first_cell)
        box = [occupied.lower, occupied.upper] if occupied.count else None
        summary = {"stamp": self._make_stamp(tile), "counts": counts.tolist(), "obstacles": box}
        # All else is in the frame.
        only = ("cell_states", "outer", "inner")
        write_once(self.tile_path(tile), contents, only=only, **summary)

    # ---- the folder ------------------------------------------------------------------------------

    @classmethod
    def open(cls, path: StrPath) -> TileFolder:
        """Open a tiled map's folder without its tiles.

        Raises FileError if it is missing or was changed, of another version, or describes no map.
        """
        root = Path(path).absolute()  # workers have other working folders
        saved = MapFolder(root, tiles=True)
        frame, attributes = saved.read()
        with saved.reporting_damage():
            folder = cls(root, attributes["tiles"], frame)
            return folder._read_whole() if (root / WHOLE).exists() else folder

    def _read_whole(self) -> TileFolder:
        """Return the folder of a complete map.

        Raises any error if what is stored of the whole map is invalid.
        """
        saved = MapFolder(self.path / WHOLE, tiles=True)
        attributes, arrays = saved.read_arrays(("exterior",))
        saved.check_metadata(attributes, self.frame)
        layout = attributes["tiles"]
        if layout != {**self.layout, "counts": layout["counts"]}:
            raise saved.fail("it is of another map")
        _check_counts(layout["counts"], self.grid.size * len(self.frame.slice_of))
        exterior = Exterior.checked(arrays["exterior"], self.frame.outside)
        return TileFolder(self.path, layout, replace(self.frame, exterior=exterior))

    def complete(self) -> TileFolder:
        """Write what all tiles give together, and return the complete map.

        That are the counts of states and the states outside the grid. Raises FileError if a tile is
        of another map.
        """
        frame = self.frame
        shape = self.layout["shape"]
        counts = np.zeros(3, dtype=np.int64)
        # First and last cell of the box of obstacles in each tile, after those of an empty box.
        boxes = [[[max(shape)] * len(shape), [-1] * len(shape)]]
        for tile in range(len(self)):
            saved = MapFolder(self.tile_path(tile))
            summary = saved.read_attributes()
            self._check_stamp(tile, summary)
            with saved.reporting_damage():
                cells = self.sub_grid(self.locate_interior(tile)).size
                counts += _check_counts(summary["counts"], cells * len(frame.slice_of))
                if summary["obstacles"]:
                    boxes.append(np.reshape(summary["obstacles"], (2, len(shape))).tolist())
        obstacles = np.stack([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])
        exterior = Exterior.around(shape, obstacles, self.rasters, frame.outside)
        layout = {**self.layout, "counts": counts.tolist()}
        whole = replace(self, layout=layout, frame=replace(frame, exterior=exterior))
        write_once(self.path / WHOLE, whole.frame, only=("exterior",), tiles=layout)
        MapFolder(self.path).remove_leftovers()
        return whole


def grow_box(corners: Ints, cells: int) -> Ints:
    """Extend a box, shape (2, d), by ``cells`` on every side."""
    first, stop = corners
    return np.stack([first - cells, stop + cells])


def to_slices(corners: Ints) -> tuple[slice, ...]:
    """Convert corners, shape (2, d), to a slice for each axis."""
    return tuple(map(slice, *corners.tolist()))


def make_frame(
    workspace: Workspace, robot: Robot, rotations: Rotations, **options: Any
) -> Contents:
    """Make a tiled map's frame, a map of its first cell.

    It has the robot, the rotation cells and the obstacles as shapes.
    """
    whole = workspace.grid
    one_cell = (1,) * whole.dim
    grid = Grid(whole.lower, whole.spacing, one_cell, whole.axes, whole.units, whole.frame_id)
    occupied = np.ones(one_cell, dtype=np.bool_)
    cell = Workspace(grid, occupied, occupied, source=workspace.source, shapes=workspace.shapes)
    return Contents.undecided(cell, robot, rotations, **options)


def _check_counts(counts: Any, total: int) -> Ints:
    """Return counts of FREE, MIXED and BLOCKED, shape (3,).

    Raises ValueError unless their sum is ``total``.
    """
    values = np.array(counts)
    if values.shape != (3,) or values.dtype.kind != "i" or values.min() < 0 or sum(counts) != total:
        raise ValueError(f"it counts {counts!r:.80} of {total} cells")
    return values


def make_stamp(frame: Contents, *others: Any) -> str:
    """Return a digest of all values that determine a tiled map."""
    metadata = {**make_metadata(frame), "workspace_source": "", "library_version": ""}
    digest = hashlib.sha256(json.dumps([metadata, *others], sort_keys=True).encode())
    for array in collect_arrays(frame).values():
        digest.update(array.values.tobytes())
    return digest.hexdigest()


def write_once(path: Path, contents: Contents, **options: Any) -> bool:
    """Write a map, and return True, unless another process has.

    ``options`` are those of :meth:`MapFolder.write`; with ``tiles``, it is a map in tiles.
    """
    is_tiled = "tiles" in options
    try:
        # Only an empty folder is replaced; otherwise FileError is raised.
        with replacing(path, overwrite=True, folder=lambda _: False) as temporary:
            MapFolder(temporary, is_tiled).write(contents, **options)
            return True
    except FileError:
        if not MapFolder(path, is_tiled).exists():
            raise
        return False

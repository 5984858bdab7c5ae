"""Sources of the cells of a workspace, and named obstacles over them.

Sources are in memory or on disk.
"""

from __future__ import annotations

import hashlib
import json
import math
import mmap
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Protocol

import numpy as np

from cspace._files.access import decoding
from cspace._files.zarr_folders import MISSING_CHUNKS_ATTRIBUTE, ZarrArray, missing_chunk
from cspace._grid import Grid
from cspace._shapes import Shape, Voxels
from cspace._support.arrays import Bools, Box, Ints, intersect_boxes
from cspace._support.check import check_cells, check_dims
from cspace.errors import FileError

_LAZY_PACKAGES: Final = frozenset({"dask", "zarr"})
"""Packages whose arrays read their values when they are indexed."""

_DIGESTED_CELLS: Final = 2**26
"""Approximate number of cells that are read and digested at a time."""


class Source(Protocol):
    """Cells of a workspace, read a box at a time.

    Sources can be pickled and read by several threads.
    """

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return outer and inner cells of a box, one array if equal."""

    @property
    def stamp(self) -> str:
        """Digest that changes when the cells change."""


class CellsInMemory:
    """Outer and inner cells in memory; one array if they are equal."""

    def __init__(self, outer: Bools, inner: Bools) -> None:
        """Keep the arrays, without copies."""
        self.outer = outer
        self.inner = inner

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""
        outer = self.outer[box]
        inner = outer if self.inner is self.outer else self.inner[box]
        return outer, inner

    @cached_property
    def stamp(self) -> str:
        """Digest of the cells."""
        digest = hashlib.sha256(np.packbits(self.outer).data)
        if self.inner is not self.outer:
            digest.update(np.packbits(self.inner).data)
        return digest.hexdigest()


class LazyCells:
    """Cells of a lazy array, read a box at a time.

    The array is of zarr, dask or ``numpy.memmap``, or an xarray of these. It is boolean, or has
    values 0 and 1, and is indexed [x, y] or [x, y, z].
    """

    def __init__(self, array: Any, digest: str = "") -> None:
        """Keep the array after checking its type and shape."""
        check_dims(array, "occupied")  # of xarray
        self.array = array = _unwrap(array)
        self.shape = tuple(int(n) for n in array.shape)
        self._digest = digest
        check_cells(np.zeros((1,) * len(self.shape), dtype=array.dtype), "occupied")
        if 0 in self.shape:
            check_cells(np.zeros(self.shape, dtype=np.bool_), "occupied")

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return a box's cells, both outer and inner."""
        with decoding(self.name, "array of cells", "a part is missing or damaged"):
            values = self.array[box]
            if hasattr(values, "compute"):
                # In this thread: a dask worker that waited for its own cluster would hang.
                values = values.compute(scheduler="synchronous")
            cells = check_cells(np.asarray(values), "occupied")
        if cells.shape != tuple(side.stop - side.start for side in box):
            raise changed_source(self.name, "its shape is different now")
        return cells, cells

    @property
    def name(self) -> str:
        """File or package of the array, for messages."""
        return str(self._file or f"{_package_of(self.array)} array")

    @property
    def stamp(self) -> str:
        """Digest that changes when the cells change.

        The digest is that of the sizes and times of the array's files. An array without files, or a
        part of a mapped file, is read as a whole, once. The name of a dask array is not used,
        because it may differ in the process that resumes a build.
        """
        if self._file is None:
            self._digest = self._digest or self._digest_cells()
            return self._digest
        # The shape and type of the array, and its place in a mapped file, then the state of each
        # file.
        parts = [f"{self.shape} {np.dtype(self.array.dtype).str}"]
        if isinstance(self.array, np.memmap):
            parts.append(f"{self.array.offset} {self.array.strides}")
        for path in _files_to_watch(self._file):
            try:
                status = path.stat()
            except OSError as error:
                problem = f"it cannot be read any more ({error.strerror})"
                raise changed_source(str(path), problem) from error
            size = status.st_size if path.is_file() else 0
            parts.append(f"{path} {size} {status.st_mtime_ns}")
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _digest_cells(self) -> str:
        """Return the digest of all cells, read some rows at a time."""
        digest = hashlib.sha256()
        n_rows, *row_shape = self.shape
        rows_at_once = max(1, _DIGESTED_CELLS // math.prod(row_shape))
        row = [slice(0, n) for n in row_shape]
        for first in range(0, n_rows, rows_at_once):
            stop = min(first + rows_at_once, n_rows)
            cells, _ = self.read((slice(first, stop), *row))
            digest.update(np.packbits(cells).data)
        return digest.hexdigest()

    @property
    def _file(self) -> Path | None:
        """File or folder that contains the array, if it is known."""
        array = self.array
        file = None
        if isinstance(getattr(array, "base", None), mmap.mmap):  # a whole file, not a part of it
            file = getattr(array, "filename", None)
        zarr_root = getattr(getattr(array, "store", None), "root", None)
        if zarr_root is not None:
            file = Path(zarr_root) / getattr(array, "path", "")
        return Path(file).absolute() if file and Path(file).exists() else None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle a mapped file's name, not its values."""
        array = self.array
        if not isinstance(array, np.memmap) or self._file is None:
            return LazyCells, (array, self._digest)
        order = "C" if array.flags.c_contiguous else "F"
        return _open_memmap, (self._file, array.dtype, array.offset, array.shape, order)


def _unwrap(array: Any) -> Any:
    """Return an xarray's array, or the array itself."""
    return array.data if hasattr(array, "variable") else array


def _package_of(array: Any) -> str:
    """Return the name of the package that defines an array's type."""
    return type(array).__module__.partition(".")[0]


def _open_memmap(
    file: Path, dtype: np.dtype[Any], offset: int, shape: tuple[int, ...], order: Literal["C", "F"]
) -> LazyCells:
    """Map an array of a file into memory, from byte ``offset`` on."""
    return LazyCells(np.memmap(file, dtype, "r", offset, shape, order))


def _files_to_watch(file: Path) -> list[Path]:
    """Return the files and folders whose times change with an array.

    For an array in a folder, these are all of its folders, whose times change when a file in them
    is replaced, and all files of metadata.
    """
    watched = [path for path in file.rglob("*") if path.is_dir() or path.name == "zarr.json"]
    return [file, *sorted(watched)]


class ShapeCells:
    """Cells of a shape, rasterized a box at a time.

    A spatial index finds the parts near a box.
    """

    def __init__(self, shape: Shape, grid: Grid) -> None:
        """Keep the shape and the grid on which it is rasterized."""
        self.shape = shape
        self.grid = grid

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""
        first = np.array([side.start for side in box])
        stop = np.array([side.stop for side in box])
        lower = self.grid.lower + self.grid.spacing * first
        return self.shape.cells(Grid(lower, self.grid.spacing, stop - first))

    @cached_property
    def stamp(self) -> str:
        """Digest of the shape."""
        text = json.dumps(self.shape.spec, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def check_no_chunk_missing(array: Any) -> None:
    """Raise FileError if a zarr array lacks chunks.

    No error is raised if its attributes declare that missing chunks have the fill value.
    """
    if _package_of(array) != "zarr" or not is_lazy(array):
        return
    if array.attrs.get(MISSING_CHUNKS_ATTRIBUTE) == "fill_value":
        return
    with decoding(LazyCells(array).name, "Zarr array"):
        missing = array.nchunks - array.nchunks_initialized
        if missing:
            raise missing_chunk(f"{missing} of {array.nchunks} chunks")


def is_lazy(array: Any) -> bool:
    """Return True if indexing an array reads it.

    Such arrays are kept as :class:`LazyCells`.
    """
    data = _unwrap(array)
    if not hasattr(data, "shape"):  # a group of arrays
        return False
    return isinstance(data, ZarrArray | np.memmap) or _package_of(data) in _LAZY_PACKAGES


def changed_source(name: str, problem: str) -> FileError:
    """Make the error for cells changed during builds."""
    rule = "the workspace must not change while a map is built"
    return FileError(name, f"has changed: {problem}", rule)


CellBox = tuple[Ints, Ints]
"""First cell of a box, and the cell after the last one; empty for obstacles outside the grid."""


class Obstacle(NamedTuple):
    """A shape and its cells on a grid.

    Attributes
    ----------
    shape : Shape
    box : CellBox
        Box of the grid that contains all cells that the obstacle can touch.
    outer, inner : ndarray of bool
        Cells of the box that touch the obstacle, and cells inside it.
    """

    shape: Shape
    box: CellBox
    outer: Bools
    inner: Bools

    @classmethod
    def of(cls, shape: Shape, grid: Grid) -> Obstacle:
        """Rasterize a shape.

        Its cells are clipped to the grid, but its geometry is not.

        Raises InputError if the shape is so far from the grid that rounding could exceed the
        certificate's slack, or if its interior depends on the spacing.
        """
        shape.outer.boundary()  # raises the errors of later exact queries now
        low, high = (shape.outer.bounds - np.array(grid.lower)) / grid.spacing
        # One cell more on each side covers rounding.
        first = np.clip(np.floor(low - 1.0), 0, grid.shape).astype(np.int64)
        stop = np.clip(np.floor(high + 2.0), 0, grid.shape).astype(np.int64)
        # This grid has the same lower corner as that of a build, so that its cells are equal to the
        # bit.
        near = Grid(grid.lower, grid.spacing, np.maximum(stop, 1).tolist())
        outer, inner = shape.cells(near)
        window = tuple(map(slice, first, stop))
        return cls(shape, (first, stop), outer[window].copy(), inner[window].copy())


@dataclass(slots=True, eq=False)
class ObstacleLayers:
    """Cells of a workspace: a base, and named obstacles on top of it.

    Attributes
    ----------
    grid : Grid
    outer, inner : ndarray of bool
        Cells of the base that meet obstacles, and cells inside obstacles; copies.
    unknown : ndarray of bool, or None
        Unknown cells of the base; a copy.
    shapes : tuple or None
        Obstacles of the base as shapes; None if only their cells are known.
    named : dict of str to Obstacle
        Obstacles on top of the base.
    """

    grid: Grid
    outer: Bools = field(repr=False)
    inner: Bools = field(repr=False)
    unknown: Bools | None = field(repr=False)
    shapes: tuple[Shape, ...] | None
    named: dict[str, Obstacle] = field(default_factory=dict)
    _base_shapes: tuple[Shape, ...] | None = field(default=None, repr=False)

    def copy(self) -> ObstacleLayers:
        """Return a copy that shares no arrays."""
        outer = self.outer.copy()
        inner = self.inner.copy()
        unknown = None if self.unknown is None else self.unknown.copy()
        return replace(self, outer=outer, inner=inner, unknown=unknown, named=dict(self.named))

    @property
    def obstacles(self) -> tuple[Shape, ...] | None:
        """All obstacles as shapes; None if only their cells are known."""
        if not self.named:
            return self.shapes
        if self._base_shapes is None and self.shapes is None:
            cells = Voxels(self.outer.copy(), self.grid.spacing, np.array(self.grid.lower))
            self._base_shapes = (cells,) if self.outer.any() else ()
        base = self._base_shapes or self.shapes or ()
        return (*base, *(obstacle.shape for obstacle in self.named.values()))

    def write(self, window: tuple[slice, ...], outer: Bools, inner: Bools) -> None:
        """Replace a box of the base's cells; forget the base's shapes."""
        self.outer[window] = outer
        self.inner[window] = inner
        if self.unknown is not None:
            self.unknown[window] = False
        self.shapes = self._base_shapes = None

    def set_obstacle(self, name: str, obstacle: Obstacle | None) -> list[CellBox]:
        """Add, replace or remove a named obstacle.

        Returns the boxes of cells that may have changed.
        """
        # Cells of the new and of the old obstacle may change.
        changed = [obstacle, self.named.get(name)]
        if obstacle is None:
            del self.named[name]
        else:
            self.named[name] = obstacle
        return [item.box for item in changed if item is not None and item.outer.size]

    def find_names(self, cells: Ints) -> set[str]:
        """Return names of obstacles that touch any cell, shape (n, d)."""
        names = set[str]()
        for name, obstacle in self.named.items():
            first, stop = obstacle.box
            near = cells[((cells >= first) & (cells < stop)).all(axis=1)] - first
            if obstacle.outer[tuple(near.T)].any():
                names.add(name)
        return names

    def cells(self, first: Ints, stop: Ints) -> tuple[Bools, Bools, Bools]:
        """Return the outer, inner and unknown cells from ``first`` to before ``stop``."""
        window = tuple(map(slice, first, stop))
        # The base, and over it each obstacle, under which nothing is unknown.
        outer = self.outer[window].copy()
        inner = self.inner[window].copy()
        unknown = np.zeros_like(outer) if self.unknown is None else self.unknown[window].copy()
        obstacles = list(self.named.values())
        # Compare all boxes at once, because few of many obstacles are near.
        firsts = np.array([obstacle.box[0] for obstacle in obstacles]).reshape(-1, len(first))
        stops = np.array([obstacle.box[1] for obstacle in obstacles]).reshape(-1, len(first))
        is_near = ((firsts < stop) & (first < stops) & (firsts < stops)).all(axis=1)
        for number in np.flatnonzero(is_near):
            obstacle = obstacles[number]
            box = tuple(map(slice, *obstacle.box))
            in_window, in_obstacle = intersect_boxes(window, box)
            outer[in_window] |= obstacle.outer[in_obstacle]
            inner[in_window] |= obstacle.inner[in_obstacle]
            unknown[in_window] &= ~obstacle.outer[in_obstacle]
        return outer, inner, unknown

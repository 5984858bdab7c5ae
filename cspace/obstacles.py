"""Obstacles of a workspace: cells in memory or on disk, read a box at a time, and shapes placed by name over them."""

from __future__ import annotations

import hashlib
import json
import mmap
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from cspace.arrays import Bools, Box, Ints
from cspace.check import check_cells, check_dims
from cspace.errors import FileError
from cspace.files.access import decoding
from cspace.files.chunks import MISSING_CHUNKS_ATTRIBUTE, ZarrArray, missing_chunk
from cspace.grid import Grid
from cspace.shapes import Shape, Voxels

_AWAY: Final = frozenset({"dask", "h5py", "tensorstore", "xarray", "zarr"})
"""Packages whose arrays are read when they are indexed."""


class Source(Protocol):
    """The cells of a workspace; it is pickled for workers, and read by several at once."""

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """The cells of a box that meet an obstacle, and those that lie in one; one array where both are the same."""

    @property
    def stamp(self) -> str:
        """A text that is another one once the cells are."""

    @property
    def same(self) -> bool:
        """Whether both are always one array."""


class Held:
    """Cells in memory.

    Outer and inner ones are the same array where both are the same.
    """

    def __init__(self, outer: Bools, inner: Bools) -> None:
        self.outer, self.inner = outer, inner
        self.same = inner is outer

    def read(self, box: Box) -> tuple[Bools, Bools]:
        outer = self.outer[box]
        return outer, outer if self.inner is self.outer else self.inner[box]

    @cached_property
    def stamp(self) -> str:
        digest = hashlib.sha256(np.packbits(self.outer).data)
        if self.inner is not self.outer:
            digest.update(np.packbits(self.inner).data)
        return digest.hexdigest()


class Lazy:
    """An array that is read a box at a time: of zarr, dask, h5py or xarray, or a ``numpy.memmap``.

    It is boolean, or holds 0 and 1, and is indexed [x, y] or [x, y, z].
    """

    same: Final = True

    def __init__(self, array: Any) -> None:
        self.array, self.shape = array, tuple(int(n) for n in array.shape)
        check_cells(np.zeros((1,) * len(self.shape), dtype=array.dtype), "occupied")
        if 0 in self.shape:
            check_cells(np.zeros(self.shape, dtype=np.bool_), "occupied")
        check_dims(getattr(array, "variable", None), "occupied")  # of xarray

    def read(self, box: Box) -> tuple[Bools, Bools]:
        rule, hint = "a part of it is missing or damaged", "copy it from where it is whole, and build the map anew"
        with decoding(self.name, "array of cells", rule, hint):
            part = self.array[box]
            if hasattr(part, "compute"):  # not on the cluster that this may run on, which could wait for itself
                part = part.compute(scheduler="synchronous")
            cells = check_cells(np.asarray(part), "occupied")
        if cells.shape != tuple(part.stop - part.start for part in box):
            raise changed(self.name, "it has another shape now")
        return cells, cells

    @property
    def name(self) -> str:
        """What it is, for messages."""
        files = [str(file) for file in self._files()]
        return files[0] if files else f"{type(self.array).__module__.partition('.')[0]} array"

    @property
    def stamp(self) -> str:
        parts = [f"{self.shape} {np.dtype(self.array.dtype).str}"]
        for file in self._files():
            for path in _watched(file):
                try:
                    status = path.stat()
                except OSError as error:
                    raise changed(str(file), f"it is not there any more ({error.strerror})") from error
                parts.append(f"{path} {status.st_size if path.is_file() else 0} {status.st_mtime_ns}")
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def _files(self) -> list[Path]:
        """The files, or folders, that hold it, as far as they are known."""
        array = self.array
        encoding = getattr(array, "encoding", {})
        named = [
            getattr(array, "filename", None),  # numpy.memmap
            getattr(getattr(array, "file", None), "filename", None),  # h5py
            encoding.get("source") if isinstance(encoding, dict) else None,  # xarray
        ]
        if self._root is not None:
            named.append(self._root / getattr(array, "path", ""))
        return [Path(os.fspath(name)).absolute() for name in named if name and Path(os.fspath(name)).exists()]

    @property
    def _root(self) -> Path | None:
        """The folder of an array of zarr."""
        root = getattr(getattr(self.array, "store", None), "root", None)
        return None if root is None else Path(root).absolute()

    def __reduce__(self) -> tuple[Any, ...]:
        array = self.array
        if isinstance(array, np.memmap):
            whole: Any = array
            while not isinstance(whole.base, mmap.mmap):
                whole = whole.base
            begin = array.__array_interface__["data"][0] - whole.__array_interface__["data"][0]
            return _mapped, (
                str(array.filename),
                whole.offset,
                whole.nbytes,
                begin,
                array.shape,
                array.dtype,
                array.strides,
            )
        if type(array).__module__.startswith("h5py"):
            return _opened, (str(Path(array.file.filename).absolute()), array.name)
        if self._root is not None:
            return _stored, (str(self._root), array.path)
        return Lazy, (array,)


def _mapped(
    file: str,
    offset: int,
    size: int,
    begin: int,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    strides: tuple[int, ...],
) -> Lazy:
    """The part of a file that a memmap, or a view of one, shows."""
    whole = np.memmap(file, dtype=np.uint8, mode="r", offset=offset, shape=(size,))
    view: Any = np.ndarray(shape, dtype, whole, begin, strides).view(np.memmap)
    view.filename = Path(file)
    return Lazy(view)


def _opened(file: str, name: str) -> Lazy:
    """An array of an HDF5 file."""
    import h5py

    return Lazy(h5py.File(file, "r")[name])


def _stored(folder: str, path: str) -> Lazy:
    """An array of a folder in the Zarr format."""
    import zarr

    return Lazy(zarr.open_array(folder, path=path, mode="r"))


def _watched(file: Path) -> Iterable[Path]:
    """The file itself; of a folder, it and its folders, which change where a file in them is replaced."""
    yield file
    if file.is_dir():
        for folder, _, names in sorted(os.walk(file)):
            yield Path(folder)
            if "zarr.json" in names:
                yield Path(folder) / "zarr.json"


class Drawn:
    """Obstacles that are cut into cells a box at a time; an index finds those near it."""

    same: Final = False

    def __init__(self, shape: Shape, grid: Grid) -> None:
        self.shape, self.grid = shape, grid

    def read(self, box: Box) -> tuple[Bools, Bools]:
        first, last = np.array([[part.start, part.stop] for part in box]).T
        lower = self.grid.lower + self.grid.spacing * first
        grid = Grid(tuple(lower.tolist()), self.grid.spacing, tuple((last - first).tolist()))
        return self.shape.cells(grid)

    @cached_property
    def stamp(self) -> str:
        return hashlib.sha256(json.dumps(self.shape.spec, sort_keys=True).encode()).hexdigest()


def check_no_chunk_missing(array: Any) -> None:
    """Refuse an open array of zarr with missing chunks, unless its attributes say that they hold the fill value.

    Raises FileError.
    """
    if type(array).__module__.partition(".")[0] == "zarr" and array.attrs.get(MISSING_CHUNKS_ATTRIBUTE) != "fill_value":
        with decoding(Lazy(array).name, "Zarr array"):
            if array.nchunks_initialized < array.nchunks:
                raise missing_chunk(f"{array.nchunks - array.nchunks_initialized} of {array.nchunks} chunks")


def is_away(array: Any) -> bool:
    """Whether an array is one that is read when it is indexed, and not before."""
    if isinstance(array, ZarrArray):
        return True
    if not (hasattr(array, "shape") and hasattr(array, "dtype") and hasattr(array, "__getitem__")):
        return False
    data = getattr(array, "variable", None)
    if data is not None and hasattr(data, "_data"):  # xarray: what it has in memory already is no such array
        return not isinstance(data._data, np.ndarray) or isinstance(data._data, np.memmap)
    return isinstance(array, np.memmap) or type(array).__module__.partition(".")[0] in _AWAY


def changed(name: str, what: str) -> FileError:
    """The error for a source that is not what it was."""
    rule = "the workspace of a map must stay as it is while the map is built"
    return FileError(name, f"has changed: {what}", rule, "build the map anew, into another store")


CellBox = tuple[Ints, Ints]
"""First cell, and the one after the last; with no cell in between where an obstacle lies outside the grid."""


class Obstacle(NamedTuple):
    """An obstacle, and what it is in the cells of a box of the grid.

    Attributes
    ----------
    shape : Shape
    box : CellBox
        All cells of the grid that the obstacle can meet.
    outer, inner : ndarray of bool
        The cells of the box that meet the obstacle, and those that lie in it.
    """

    shape: Shape
    box: CellBox
    outer: Bools
    inner: Bools

    @classmethod
    def of(cls, shape: Shape, grid: Grid, periodic_axes: Sequence[bool] = ()) -> Obstacle:
        """An obstacle where it is; what lies outside the grid is clipped, but for exact answers.

        Along axes that close in a circle nothing lies outside: there it comes in again, whole turns on.

        Raises InputError if it is so far from the grid that rounding could reach the certificate's slack, or its inside
        depends on the spacing.
        """
        shape.outer.boundary()  # exact look-ups will need it
        turn = grid.spacing * np.array(grid.shape) * (periodic_axes or np.zeros(grid.dim))
        low, high = (
            np.floor(np.divide(corner + more - grid.lower, turn, out=np.zeros(grid.dim), where=turn > 0.0)).astype(int)
            for corner, more in zip(shape.outer.bounds, (-grid.spacing, grid.spacing), strict=True)
        )
        times = product(*map(range, low.tolist(), (high + 1).tolist()))
        parts = [cls._clipped(shape, Grid(grid.lower + turn * each, grid.spacing, grid.shape)) for each in times]
        if len(parts) == 1:
            return parts[0]
        first = np.min([each.box[0] for each in parts], axis=0)
        stop = np.max([each.box[1] for each in parts], axis=0)
        outer, inner = np.zeros((2, *(stop - first)), dtype=np.bool_)
        for each in parts:
            window = tuple(map(slice, each.box[0] - first, each.box[1] - first))
            outer[window] |= each.outer
            inner[window] |= each.inner
        return cls(shape, (first, stop), outer, inner)

    @classmethod
    def _clipped(cls, shape: Shape, grid: Grid) -> Obstacle:
        low, high = ((corner - grid.lower) / grid.spacing for corner in shape.outer.bounds)
        first, stop = (np.clip(np.floor(cell), 0, grid.shape).astype(np.int64) for cell in (low - 1.0, high + 2.0))
        # The cells are those of a build to the bit, as they are counted from the same corner, and fewer.
        outer, inner = shape.cells(Grid(grid.lower, grid.spacing, np.maximum(stop, 1).tolist()))
        window = tuple(map(slice, first, stop))
        return cls(shape, (first, stop), outer[window].copy(), inner[window].copy())


@dataclass(slots=True, eq=False)
class ObstacleLayers:
    """What the cells of a workspace come from: those that stay, and those of obstacles that have a name.

    Attributes
    ----------
    outer, inner : ndarray of bool
        The cells that stay; its own.
    unknown : ndarray of bool, or None
        Which of them nothing is known of; its own, too.
    shapes : tuple or None
        The obstacles that stay, where they are known otherwise than by their cells.
    grid : Grid
    placed : dict of str to Obstacle
    """

    grid: Grid
    outer: Bools = field(repr=False)
    inner: Bools = field(repr=False)
    unknown: Bools | None = field(repr=False)
    shapes: tuple[Shape, ...] | None
    placed: dict[str, Obstacle] = field(default_factory=dict)
    _still: tuple[Shape, ...] | None = field(default=None, repr=False)

    def copy(self) -> ObstacleLayers:
        """The same, in arrays of its own."""
        outer, inner = self.outer.copy(), self.inner.copy()
        unknown = None if self.unknown is None else self.unknown.copy()
        return replace(self, outer=outer, inner=inner, unknown=unknown, placed=dict(self.placed))

    @property
    def obstacles(self) -> tuple[Shape, ...] | None:
        """All obstacles as shapes; None where only their cells are known."""
        if not self.placed:
            return self.shapes
        if self._still is None and self.shapes is None:
            cells = Voxels(self.outer.copy(), self.grid.spacing, np.array(self.grid.lower))
            self._still = (cells,) if self.outer.any() else ()
        return (*(self._still or self.shapes or ()), *(each.shape for each in self.placed.values()))

    def write(self, window: tuple[slice, ...], outer: Bools, inner: Bools) -> None:
        """Change a box of the cells that stay, which from then on are all that is known of what stays."""
        self.outer[window], self.inner[window] = outer, inner
        if self.unknown is not None:
            self.unknown[window] = False
        self.shapes = self._still = None

    def put(self, name: str, placed: Obstacle | None) -> list[CellBox]:
        """Place an obstacle, or take it away; the boxes of the cells that may differ from then on."""
        boxes = [each.box for each in (placed, self.placed.get(name)) if each is not None and each.outer.size]
        if placed is None:
            del self.placed[name]
        else:
            self.placed[name] = placed
        return boxes

    def cells(self, first: Ints, stop: Ints) -> tuple[Bools, Bools, Bools]:
        """The cells of a box that meet an obstacle, those that lie in one, and those that nothing is known of."""
        window = tuple(map(slice, first, stop))
        outer, inner = self.outer[window].copy(), self.inner[window].copy()
        unknown = np.zeros_like(outer) if self.unknown is None else self.unknown[window].copy()
        for each in self.placed.values():
            low, high = np.maximum(first, each.box[0]), np.minimum(stop, each.box[1])
            if (low < high).all():
                here = tuple(map(slice, low - first, high - first))
                there = tuple(map(slice, low - each.box[0], high - each.box[0]))
                outer[here] |= each.outer[there]
                inner[here] |= each.inner[there]
                unknown[here] &= ~each.outer[there]
        return outer, inner, unknown

"""Arrays that are read when they are indexed, and their cells as a source of a workspace."""

from __future__ import annotations

import hashlib
import math
import mmap
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from cspace._files.access import check_file, decoding
from cspace._files.zarr_folders import MISSING_CHUNKS_ATTRIBUTE, ZarrArray, missing_chunk
from cspace._support.arrays import Bools, Box, StrPath
from cspace._support.check import check_cells, check_dims
from cspace.errors import FileError

_NUMPY_KIND: Final = "NumPy array"

_LAZY_PACKAGES: Final = frozenset({"dask", "zarr"})
"""Packages whose arrays read their values when they are indexed."""

_DIGESTED_CELLS: Final = 2**26
"""Approximate number of cells that are read and digested at a time."""


def read_npy(path: StrPath) -> NDArray[Any]:
    """Map a ``.npy`` file's array into memory, read-only.

    Raises FileError if the file is missing, truncated, in another format, or holds Python objects.
    """
    file = check_file(path, _NUMPY_KIND)
    rule = "it must hold one array, boolean for cells or floating-point for points"
    with decoding(file, _NUMPY_KIND, rule), np.errstate(over="raise"):
        return np.lib.format.open_memmap(file, mode="r")


def read_zarr_array(path: StrPath) -> ZarrArray:
    """Open a Zarr folder as an array that reads when indexed.

    Raises FileError if the folder is missing or holds no array.
    """
    if not Path(path).is_dir():
        check_file(path, "Zarr array")
    return ZarrArray(path)


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

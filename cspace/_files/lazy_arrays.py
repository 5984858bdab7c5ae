"""Arrays that are read when they are indexed: ``.npy`` files and Zarr folders."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace._files.access import check_file, decoding
from cspace._files.zarr_folders import ZarrArray
from cspace._support.arrays import StrPath

_NUMPY_KIND: Final = "NumPy array"


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

"""Arrays of numpy and of Zarr, of which nothing is read before it is used."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, InputError
from cspace.io.input import decoding, existing

KIND = "NumPy array"


def read_npy(path: str | os.PathLike[str]) -> NDArray[Any]:
    """The array of a ``.npy`` file, read-only, its values left in the file until they are used.

    Raises
    ------
    FileError
        If the file is missing, is no such file, is truncated, or holds Python objects.
    """
    file = existing(path, KIND)

    def refusal(reason: str) -> FileError:
        rule = "it must hold one array, boolean for cells or floating-point for points"
        return FileError(str(file), f"cannot be read: {reason}", rule, "write it with numpy.save")

    with decoding(file, KIND, refusal), np.errstate(over="raise"):
        return np.lib.format.open_memmap(file, mode="r")


def read_cells(path: str | os.PathLike[str]) -> NDArray[Any]:
    """The array of a ``.npy`` file, to be taken as cells.

    Raises
    ------
    InputError
        If it rather holds points, as whole numbers.
    FileError
        As :func:`read_npy`.
    """
    array = read_npy(path)
    if array.dtype.kind in "iu" and array.shape[1:] == (3,) and ((array != 0) & (array != 1)).any():
        raise InputError(
            os.fspath(path),
            f"holds {len(array)} rows of three whole numbers, other ones than 0 and 1",
            "cells are booleans and points are floating-point numbers",
            "save it as array.astype(float) if it holds points in metres, or as booleans if it holds cells",
        )
    return array


def read_zarr_array(path: str | os.PathLike[str]) -> Any:
    """The array of a folder in the Zarr format, whose values are read where it is indexed.

    Raises
    ------
    FileError
        If there is none.
    """
    import zarr

    def refusal(reason: str) -> FileError:
        rule = "it must be one array in the Zarr format, of booleans"
        return FileError(os.fspath(path), f"cannot be read: {reason}", rule, "write it with zarr.save_array")

    if not Path(path).is_dir():
        existing(path, "Zarr array")
        raise refusal("it is not a folder")
    with decoding(path, "Zarr array", refusal):
        return zarr.open_array(os.fspath(path), mode="r")

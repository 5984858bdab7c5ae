"""Which constructor of a workspace a file goes to, by its suffix; and arrays, of numpy and of Zarr, whose type decides.

Of arrays nothing is read before it is used.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import StrPath
from cspace.errors import InputError
from cspace.io.chunks import ZarrArray
from cspace.io.files import decoding, existing, suffix_of
from cspace.io.ply import read_ply_header

_KIND: Final = "NumPy array"

METHODS: Final[dict[str, str]] = {
    **dict.fromkeys((".yaml", ".yml"), "from_ros_map"),
    **dict.fromkeys((".map", ".3dmap"), "from_movingai"),
    **dict.fromkeys((".geojson", ".json", ".wkt"), "from_polygons"),
    **dict.fromkeys((".npy", ".zarr"), "from_array"),
    **dict.fromkeys((".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".dae"), "from_mesh"),
    **dict.fromkeys((".bt", ".ot"), "from_octomap"),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pcd"), "from_points"),
    **dict.fromkeys((".png", ".pgm", ".ppm", ".pbm", ".pnm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"), "from_image"),
}
"""The classmethod of ``Workspace`` that reads a file, by its suffix."""


def method_of(path: StrPath) -> str:
    """Name of the classmethod of ``Workspace`` that reads a file: by its suffix, and else by how the file begins.

    Raises InputError if the suffix is unknown, and FileError if the file had to be looked into and is missing or
    malformed.
    """
    suffix = suffix_of(path, METHODS, "the suffix says which format to read")
    if suffix == ".npy":
        array = read_npy(path)
        return "from_points" if array.dtype.kind == "f" and array.shape[1:] == (3,) else "from_array"
    if suffix == ".ply":
        return "from_mesh" if read_ply_header(path).faces else "from_points"
    return METHODS[suffix]


def dimension_of(path: StrPath) -> int:
    """Dimensions of a workspace's file, without reading it, or no more than its header.

    Raises InputError or FileError as :func:`method_of`.
    """
    method = method_of(path)
    if method == "from_array":
        read = read_zarr_array if Path(path).suffix.lower() == ".zarr" else read_npy
        return int(read(path).ndim)
    in_space = method in ("from_mesh", "from_octomap", "from_points") or Path(path).suffix.lower() == ".3dmap"
    return 3 if in_space else 2


def read_npy(path: str | os.PathLike[str]) -> NDArray[Any]:
    """The array of a ``.npy`` file, read-only, its values left in the file until they are used.

    Raises FileError if the file is missing, is no such file, is truncated, or holds Python objects.
    """
    file = existing(path, _KIND)
    rule = "it must hold one array, boolean for cells or floating-point for points"
    with decoding(file, _KIND, rule, "write it with numpy.save"), np.errstate(over="raise"):
        return np.lib.format.open_memmap(file, mode="r")


def read_cells(path: str | os.PathLike[str]) -> NDArray[Any]:
    """The array of a ``.npy`` file, to be taken as cells.

    Raises InputError if it rather holds points, as whole numbers, and FileError as :func:`read_npy`.
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


def read_zarr_array(path: str | os.PathLike[str]) -> ZarrArray:
    """The array of a folder in the Zarr format, whose values are read where it is indexed.

    Raises FileError if there is none.
    """
    if not Path(path).is_dir():
        existing(path, "Zarr array")
    return ZarrArray(path)

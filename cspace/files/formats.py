"""Which constructor of a workspace a file goes to, by its suffix; and arrays, of numpy and of Zarr, whose type decides.

Of arrays nothing is read before it is used.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import StrPath
from cspace.errors import InputError
from cspace.files import meshes, ros, vector
from cspace.files.access import decoding, existing, suffix_of
from cspace.files.chunks import ZarrArray
from cspace.files.polygons import read_ply_header
from cspace.files.voxels import read_nrrd_dimension

_KIND: Final = "NumPy array"


class Format(NamedTuple):
    """How the files of a suffix are read.

    Attributes
    ----------
    method : str
        The classmethod of ``Workspace`` that reads them.
    dimension : int or None
        2 in the plane, 3 in space; None if each file says.
    """

    method: str
    dimension: int | None


_IMAGES: Final = (".png", ".pgm", ".ppm", ".pbm", ".pnm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")

FORMATS: Final[dict[str, Format]] = {
    **dict.fromkeys(ros.SUFFIXES, Format("from_ros_map", 2)),
    ".map": Format("from_movingai", 2),
    ".3dmap": Format("from_movingai", 3),
    **dict.fromkeys(vector.SUFFIXES, Format("from_polygons", 2)),
    **dict.fromkeys((".npy", ".zarr"), Format("from_array", None)),
    **dict.fromkeys(meshes.SUFFIXES, Format("from_mesh", 3)),
    **dict.fromkeys((".bt", ".ot"), Format("from_octomap", 3)),
    ".nrrd": Format("from_nrrd", None),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pcd"), Format("from_points", 3)),
    **dict.fromkeys(_IMAGES, Format("from_image", 2)),
}
"""How the file of a workspace is read, by its suffix."""


def method_of(path: StrPath) -> str:
    """Return the name of the classmethod of ``Workspace`` that reads a file: by its suffix, then by how it begins.

    Raises InputError if the suffix is unknown, and FileError if the file had to be looked into and is missing or
    malformed.
    """
    suffix = suffix_of(path, FORMATS, "the suffix says which format to read")
    if suffix == ".npy":
        array = read_npy(path)
        return "from_points" if array.dtype.kind == "f" and array.shape[1:] == (3,) else "from_array"
    if suffix == ".ply":
        return "from_mesh" if read_ply_header(path).faces else "from_points"
    return FORMATS[suffix].method


def dimension_of(path: StrPath) -> int:
    """Return the dimension of a workspace's file, reading no more than its header.

    Raises InputError or FileError as :func:`method_of`.
    """
    method, suffix = method_of(path), Path(path).suffix.lower()
    dimension = FORMATS[suffix].dimension
    if method == "from_nrrd":
        return read_nrrd_dimension(path)
    if dimension is None:
        array = read_zarr_array(path) if suffix == ".zarr" else read_npy(path)
        dimension = 3 if method == "from_points" else int(array.ndim)
    return dimension


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

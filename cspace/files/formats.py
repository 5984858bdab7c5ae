"""Formats of workspace files by suffix; lazy NumPy and Zarr arrays."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.files import meshes, ros, vector
from cspace.files.access import check_file, check_suffix, decoding
from cspace.files.polygons import read_ply_header
from cspace.files.zarr_folders import ZarrArray
from cspace.support.arrays import StrPath

_NUMPY_KIND: Final = "NumPy array"


class Format(NamedTuple):
    """The reader of the files of a suffix.

    Attributes
    ----------
    method : str
        Name of the classmethod of ``Workspace`` that reads them.
    dimension : int or None
        2 in the plane, 3 in space; None if it depends on the file.
    """

    method: str
    dimension: int | None


_IMAGE_SUFFIXES: Final = (
    ".png",
    ".pgm",
    ".ppm",
    ".pbm",
    ".pnm",
    ".jpg",
    ".jpeg",
    ".bmp",
    ".tif",
    ".tiff",
)

WORKSPACE_FORMATS: Final[dict[str, Format]] = {
    **dict.fromkeys(ros.ROS_MAP_SUFFIXES, Format("from_ros_map", 2)),
    ".map": Format("from_movingai", 2),
    ".3dmap": Format("from_movingai", 3),
    **dict.fromkeys(vector.POLYGON_SUFFIXES, Format("from_polygons", 2)),
    **dict.fromkeys((".npy", ".zarr"), Format("from_array", None)),
    **dict.fromkeys(meshes.MESH_SUFFIXES, Format("from_mesh", 3)),
    **dict.fromkeys((".bt", ".ot"), Format("from_octomap", 3)),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pcd"), Format("from_points", 3)),
    **dict.fromkeys(_IMAGE_SUFFIXES, Format("from_image", 2)),
}
"""Reader of each suffix of a workspace file."""


def find_constructor(path: StrPath) -> str:
    """Return the name of the ``Workspace`` classmethod that reads a file.

    The suffix decides, then the header.

    Raises InputError if the suffix is unknown. Raises FileError if the header is needed and is
    missing or malformed.
    """
    suffix = check_suffix(path, WORKSPACE_FORMATS, "the suffix selects the format")
    if suffix == ".npy":
        array = read_npy(path)
        return (
            "from_points" if array.dtype.kind == "f" and array.shape[1:] == (3,) else "from_array"
        )
    if suffix == ".ply":
        return "from_mesh" if read_ply_header(path).faces else "from_points"
    return WORKSPACE_FORMATS[suffix].method


def read_dimension(path: StrPath) -> int:
    """Return the dimension of a workspace file, reading at most its header.

    Raises InputError or FileError as :func:`find_constructor`.
    """
    method, suffix = find_constructor(path), Path(path).suffix.lower()
    dimension = WORKSPACE_FORMATS[suffix].dimension
    if dimension is None:
        array = read_zarr_array(path) if suffix == ".zarr" else read_npy(path)
        dimension = 3 if method == "from_points" else int(array.ndim)
    return dimension


def read_npy(path: str | os.PathLike[str]) -> NDArray[Any]:
    """Map the array of a ``.npy`` file into memory, read-only.

    Raises FileError if the file is missing, truncated, in another format, or holds Python objects.
    """
    file = check_file(path, _NUMPY_KIND)
    rule = "it must hold one array, boolean for cells or floating-point for points"
    with decoding(file, _NUMPY_KIND, rule, "write it with numpy.save"), np.errstate(over="raise"):
        return np.lib.format.open_memmap(file, mode="r")


def read_zarr_array(path: str | os.PathLike[str]) -> ZarrArray:
    """Open a Zarr folder as an array that reads when indexed.

    Raises FileError if the folder is missing or holds no array.
    """
    if not Path(path).is_dir():
        check_file(path, "Zarr array")
    return ZarrArray(path)

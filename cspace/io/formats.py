"""Which constructor of a workspace a file goes to, by its suffix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from cspace.io.input import suffix_of
from cspace.io.npy import read_npy, read_zarr_array
from cspace.io.ply import read_ply_header

Named = str | os.PathLike[str]

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


def method_of(path: Named) -> str:
    """Name of the classmethod of ``Workspace`` that reads a file: by its suffix, and else by how the file begins.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file had to be looked into and is missing or malformed.
    """
    suffix = suffix_of(path, METHODS, "the suffix says which format to read")
    if suffix == ".npy":
        array = read_npy(path)
        return "from_points" if array.dtype.kind == "f" and array.shape[1:] == (3,) else "from_array"
    if suffix == ".ply":
        return "from_mesh" if read_ply_header(path).faces else "from_points"
    return METHODS[suffix]


def dimension_of(path: Named) -> int:
    """Dimensions of a workspace's file, without reading it, or no more than its header.

    Raises
    ------
    InputError, FileError
        As :func:`method_of`.
    """
    method = method_of(path)
    if method == "from_array":
        read = read_zarr_array if Path(path).suffix.lower() == ".zarr" else read_npy
        return int(read(path).ndim)
    in_space = method in ("from_mesh", "from_octomap", "from_points") or Path(path).suffix.lower() == ".3dmap"
    return 3 if in_space else 2

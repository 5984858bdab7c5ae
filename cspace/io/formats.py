"""Which constructor of a workspace a file goes to, by its suffix."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from cspace.errors import InputError
from cspace.io.npy import npy_header
from cspace.io.ply import read_ply_header

Named = str | os.PathLike[str]

METHODS: Final[dict[str, str]] = {
    **dict.fromkeys((".yaml", ".yml"), "from_ros_map"),
    **dict.fromkeys((".map", ".3dmap"), "from_movingai"),
    **dict.fromkeys((".geojson", ".json", ".wkt"), "from_polygons"),
    ".npy": "from_array",
    **dict.fromkeys((".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".dae"), "from_mesh"),
    **dict.fromkeys((".bt", ".ot"), "from_octomap"),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pcd"), "from_points"),
    **dict.fromkeys((".png", ".pgm", ".ppm", ".pbm", ".pnm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"), "from_image"),
}
"""The classmethod of ``Workspace`` that reads a file, by its suffix."""

_DIMENSIONS: Final = {
    **dict.fromkeys(("from_ros_map", "from_image", "from_polygons"), 2),
    **dict.fromkeys(("from_mesh", "from_octomap", "from_points"), 3),
}
"""Dimensions of what a method makes of a file, where they do not depend on the file."""


def method_of(path: Named) -> str:
    """Name of the classmethod of ``Workspace`` that reads a file: by its suffix, and else by how the file begins.

    Raises
    ------
    InputError
        If the suffix is unknown.
    FileError
        If the file had to be looked into and is missing or malformed.
    """
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError("path", f"is {path!r}", "it must be a file name", "pass a string or a pathlib.Path") from error
    if suffix not in METHODS:
        raise InputError(
            "path",
            f"is {os.fspath(path)}, which ends in {suffix!r}",
            "the suffix says which format to read",
            f"use one of {', '.join(METHODS)}",
            value=path,
        )
    if suffix == ".npy":
        shape, dtype = npy_header(path)
        return "from_points" if dtype.kind == "f" and shape[1:] == (3,) else "from_array"
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
        return len(npy_header(path)[0])
    if method == "from_movingai":
        return 3 if Path(path).suffix.lower() == ".3dmap" else 2
    return _DIMENSIONS[method]

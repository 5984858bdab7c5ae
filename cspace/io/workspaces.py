"""Which reader a workspace's file goes to, by its suffix."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.io.meshes import SUFFIXES as MESHES
from cspace.io.npy import npy_header, read_npy
from cspace.io.ply import read_ply_header
from cspace.workspace import Workspace

Named = str | os.PathLike[str]
Reader = Callable[..., Workspace]


def open_workspace(path: Named, **options: Any) -> Workspace:
    """Read a workspace, as :meth:`Workspace.open` tells."""
    reader = reader_of(path, options)
    for name, parameter in _options_of(reader).items():
        if parameter.default is parameter.empty and name not in options:
            raise InputError(
                f"{name} is missing for {os.fspath(path)}; such a file does not hold it; pass e.g. {name}=0.05 (metres)"
            )
    return reader(path, **options)


def reader_of(path: Named, options: Iterable[str] = ()) -> Reader:
    """What reads a workspace's file, by its suffix and, where that does not tell enough, by what it begins with.

    Parameters
    ----------
    path : path-like
    options : iterable of str
        Names of options that it must take.

    Raises
    ------
    InputError
        If the suffix is unknown, or an option does not apply.
    FileError
        If the file had to be looked into and is missing.
    """
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    if suffix not in READERS:
        raise InputError(
            f"{os.fspath(path)} ends in {suffix!r}; the suffix says which format to read; use one of "
            f"{', '.join(READERS)}"
        )
    reader = _CHOICES[suffix](path) if suffix in _CHOICES else READERS[suffix]
    known = _options_of(reader)
    for name in options:
        if name not in known:
            raise InputError(
                f"{name} is given for {os.fspath(path)}; a {suffix} file takes {', '.join(known)}; leave it out"
            )
    return reader


def dimension_of(path: Named) -> int:
    """Dimensions of a workspace's file, without reading it, or no more than its header.

    Raises
    ------
    InputError, FileError
        As :func:`reader_of`.
    """
    reader = reader_of(path)
    if reader is _cells_file:
        return len(npy_header(path)[0])
    if reader == Workspace.from_movingai:
        return 3 if Path(path).suffix.lower() == ".3dmap" else 2
    return _DIMENSIONS[reader]


def _options_of(reader: Reader) -> dict[str, inspect.Parameter]:
    return dict(list(inspect.signature(reader).parameters.items())[1:])


def _cells_file(path: Named, spacing: float, lower: ArrayLike | None = None) -> Workspace:
    """A boolean array saved by :func:`numpy.save`."""
    array = read_npy(path)
    if array.dtype.kind in "iu" and array.shape[1:] == (3,) and ((array != 0) & (array != 1)).any():
        raise InputError(
            f"{os.fspath(path)} holds {len(array)} rows of three whole numbers, other ones than 0 and 1; cells are "
            "booleans and points are floating-point numbers; save it as array.astype(float) if it holds points in "
            "metres, or as booleans if it holds cells"
        )
    return replace(Workspace.from_array(array, spacing, lower), source=str(path))


def _reader_of_npy(path: Named) -> Reader:
    """Rows of three floating-point numbers are points; anything else is cells."""
    shape, dtype = npy_header(path)
    return Workspace.from_points if dtype.kind == "f" and shape[1:] == (3,) else _cells_file


def _reader_of_ply(path: Named) -> Reader:
    """A PLY file without faces is a point cloud."""
    return Workspace.from_mesh if read_ply_header(path).faces else Workspace.from_points


READERS: Final[dict[str, Reader]] = {
    **dict.fromkeys((".yaml", ".yml"), Workspace.from_ros_map),
    **dict.fromkeys((".map", ".3dmap"), Workspace.from_movingai),
    **dict.fromkeys((".geojson", ".json", ".wkt"), Workspace.from_polygons),
    ".npy": _cells_file,
    **dict.fromkeys(MESHES, Workspace.from_mesh),
    **dict.fromkeys((".bt", ".ot"), Workspace.from_octomap),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".pcd"), Workspace.from_points),
    **dict.fromkeys(
        (".png", ".pgm", ".ppm", ".pbm", ".pnm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"), Workspace.from_image
    ),
}
"""What reads a file, by its suffix."""

_CHOICES: Final[dict[str, Callable[[Named], Reader]]] = {
    ".npy": _reader_of_npy,
    ".ply": _reader_of_ply,
}
"""What looks into a file whose suffix does not tell enough."""

_DIMENSIONS: Final[dict[Reader, int]] = {
    Workspace.from_ros_map: 2,
    Workspace.from_image: 2,
    Workspace.from_polygons: 2,
    Workspace.from_mesh: 3,
    Workspace.from_octomap: 3,
    Workspace.from_points: 3,
}
"""Dimensions of what a reader makes of a file, where they do not depend on the file."""

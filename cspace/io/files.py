"""Which function reads or writes a map, by the suffix of its name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cspace.errors import FileError, InputError
from cspace.io.input import unreadable
from cspace.io.npz import read_npz, write_npz
from cspace.io.store import read_store, write_store

if TYPE_CHECKING:
    from cspace.space import CSpace


def _write_ros_map(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    from cspace.io.rosmap import write_ros_map

    write_ros_map(space.state, space.grid, path, overwrite=overwrite)


_Writer = Callable[["CSpace", str | os.PathLike[str], bool], None]

SAVES: Final[Mapping[str, _Writer]] = {".zarr": write_store, "": write_store, ".npz": write_npz}
"""Formats that ``open_map`` reads again, by suffix."""

EXPORTS: Final[Mapping[str, _Writer]] = {**SAVES, ".yaml": _write_ros_map, ".yml": _write_ros_map}
"""All formats, by suffix."""


def save(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Save a map, complete, so that :func:`open_map` gives it back.

    Parameters
    ----------
    space : CSpace
    path : path-like
        ``.zarr`` or no suffix: a Zarr folder. ``.npz``: one NumPy file.
    overwrite : bool
        Whether an existing map may be replaced.

    Raises
    ------
    InputError
        If the suffix is another one.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    _by_suffix(SAVES, path)(space, path, overwrite)


def export(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map for other software.

    Parameters
    ----------
    space : CSpace
    path : path-like
        ``.npz``: one NumPy file. ``.yaml``: a ROS map, with its image beside it. ``.zarr`` or no suffix: a Zarr folder.
    overwrite : bool
        Whether an existing output may be replaced.

    Raises
    ------
    InputError
        If the suffix is another one.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    _by_suffix(EXPORTS, path)(space, path, overwrite)


def open_map(path: str | os.PathLike[str]) -> CSpace:
    """Open a map that was saved.

    Parameters
    ----------
    path : path-like
        A Zarr folder or an ``.npz`` file.

    Returns
    -------
    CSpace
        Equal to the one that was saved.

    Raises
    ------
    FileError
        If there is nothing, or nothing that can be read, or not a map, or a map that is truncated or changed.
    """
    try:
        where = Path(path)
        there, folder = where.exists(), where.is_dir()
    except (TypeError, ValueError) as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    except OSError as error:
        raise unreadable(path, "saved map", error) from error
    if not there:
        raise FileError(f"{where} does not exist; a saved map is a folder or an .npz file; check the name")
    if folder:
        return read_store(where)
    if where.suffix.lower() != ".npz":
        raise FileError(
            f"{where} is not a saved map; a saved map is a Zarr folder or an .npz file; build the map first, with "
            "cspace.build (cspace map on the command line)"
        )
    return read_npz(where)


def _by_suffix(writers: Mapping[str, _Writer], path: str | os.PathLike[str]) -> _Writer:
    """The writer for a name."""
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    if suffix not in writers:
        raise InputError(
            f"{Path(path)} ends in {suffix!r}; the suffix says which format to write; use one of "
            f"{', '.join(name for name in writers if name)}"
        )
    return writers[suffix]

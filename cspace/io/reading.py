"""Saved maps, opened: the one place in which files make a :class:`cspace.CSpace`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from cspace.errors import FileError, InputError
from cspace.io.arrays import one_yaw
from cspace.io.input import unreadable
from cspace.io.npz import read_npz
from cspace.io.store import read_slice, read_store

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cspace.space import CSpace


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
    return read_store(path) if _is_folder(path) else read_npz(path)


def open_slice(path: str | os.PathLike[str], yaw: float = 0.0) -> NDArray[np.uint8]:
    """Read the states of one yaw from a map that was saved.

    Of a Zarr folder, nothing but that slice is read, and only that is proven unchanged; an ``.npz`` file is read whole.

    Parameters
    ----------
    path : path-like
        A Zarr folder or an ``.npz`` file.
    yaw : float
        Radians, wrapped. Plays no part in the map of a robot that only translates, whose states are one slice.

    Returns
    -------
    ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
        FREE, MIXED or BLOCKED of each cell, proven for all yaw angles of the rotation cell that holds ``yaw``.

    Raises
    ------
    InputError
        If ``yaw`` is not one finite number that can be wrapped.
    FileError
        As :func:`open_map`, of what is read.
    """
    return read_slice(path, yaw) if _is_folder(path) else read_npz(path).slice_at(one_yaw(yaw))


def _is_folder(path: str | os.PathLike[str]) -> bool:
    """Whether a saved map is a folder, or else an ``.npz`` file."""
    try:
        where = Path(path)
        there, folder = where.exists(), where.is_dir()
    except (TypeError, ValueError) as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    except OSError as error:
        raise unreadable(path, "saved map", error) from error
    if not there:
        raise FileError(f"{where} does not exist; a saved map is a folder or an .npz file; check the name")
    if not folder and where.suffix.lower() != ".npz":
        raise FileError(
            f"{where} is not a saved map; a saved map is a Zarr folder or an .npz file; build the map first, with "
            "cspace.build (cspace map on the command line)"
        )
    return folder

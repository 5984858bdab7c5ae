"""Opening of stored maps as :class:`cspace.CSpace` or :class:`cspace.TiledCSpace`."""

from __future__ import annotations

import os
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import StrPath
from cspace.errors import FileError
from cspace.files.access import inspect_path, retry_if_replaced, suggest_name
from cspace.space import CSpace
from cspace.store import Store, making_map, unfinished_map_error
from cspace.tiles.space import TiledCSpace


@overload
def open_map(path: StrPath, in_memory: None = None) -> CSpace | TiledCSpace: ...
@overload
def open_map(path: StrPath, in_memory: Literal[True]) -> CSpace: ...
@overload
def open_map(path: StrPath, in_memory: Literal[False]) -> TiledCSpace: ...
@overload
def open_map(path: StrPath, in_memory: bool) -> CSpace | TiledCSpace: ...
def open_map(path: StrPath, in_memory: bool | None = None) -> CSpace | TiledCSpace:
    """Open a stored map, saved or built into a store.

    Parameters
    ----------
    path : path-like
        A Zarr folder.
    in_memory : bool, optional
        True to read the map into memory as a :class:`cspace.CSpace`; False to leave it in its store as a
        :class:`cspace.TiledCSpace`, which reads tiles when needed. By default, a finished map of one tile, as
        :meth:`cspace.CSpace.save` writes it, is read into memory; any other map stays in its store.

    Returns
    -------
    CSpace or TiledCSpace
        Equal to the map that was saved or built.

    Raises
    ------
    FileError
        If the map is missing, unreadable, truncated or changed, or if `in_memory` is True and tiles are unfinished.
    ConfigurationError
        If `in_memory` is False and the map has overlap counts.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> space = cspace.build(cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))
    >>> space.save("map.zarr")
    >>> cspace.open("map.zarr").count() == space.count()
    True
    >>> type(cspace.open("map.zarr", in_memory=False)).__name__
    'TiledCSpace'
    """
    return retry_if_replaced(path, lambda: _open_unchanged(path, in_memory))


open = open_map  # noqa: A001 - its public name, cspace.open


def _open_unchanged(path: StrPath, in_memory: bool | None) -> CSpace | TiledCSpace:
    """Open a map, assuming that no other process replaces it."""
    _check_folder(path)
    store = Store.open(path)
    if in_memory is None:
        in_memory = store.is_done and (len(store) == 1 or not TiledCSpace._holds(store))
    if not in_memory:
        return TiledCSpace._of_store(store)
    contents = store.contents()
    with making_map(path):
        return CSpace(contents)


def open_slice(path: StrPath, rotation: ArrayLike = ()) -> NDArray[np.uint8]:
    """Read the states at one rotation from a stored map.

    Only the chunks of that slice are read; their digests are checked.

    Parameters
    ----------
    path : path-like
        A Zarr folder.
    rotation : array-like, shape (k,)
        As in a configuration: a yaw in radians, a quaternion, or nothing for a robot that only translates.

    Returns
    -------
    ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
        FREE, MIXED or BLOCKED of each cell, proven for the whole rotation cell that contains the rotation.

    Raises
    ------
    InputError
        If `rotation` is not one rotation of the map.
    FileError
        As :func:`cspace.open`, for the files read.
    """

    def read() -> NDArray[np.uint8]:
        _check_folder(path)
        store = Store.open(path)
        if not store.is_done:
            raise unfinished_map_error(path, store.share_done)
        number = int(store.slice_of[store.rotations.find_cells(store.rotations.check_rotation(rotation))])
        return store.states_at(number)

    return retry_if_replaced(path, read)


def _check_folder(path: str | os.PathLike[str]) -> None:
    """Raise FileError if there is no folder at a path."""
    (file, what), rule = inspect_path(path, "saved map"), "a saved map is a Zarr folder"
    if not what:
        raise FileError(str(file), "does not exist", rule, suggest_name(file) or "check the name")
    if what != "a folder" and file.suffix.lower() == ".npz":
        rule = f"{rule}; .npz is an export, for numpy.load"
        raise FileError(str(file), "is not a saved map", rule, "save the map with space.save('map.zarr')")
    if what != "a folder":
        hint = "build the map first, with cspace.build or cspace map"
        raise FileError(str(file), "is not a saved map", rule, hint)

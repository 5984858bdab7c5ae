"""Saved maps, opened: the one place in which files make a :class:`cspace.CSpace`."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import FIELD_NAMES
from cspace.errors import FileError
from cspace.files.access import look_up, retry_if_replaced
from cspace.map.contents import Contents
from cspace.map.exterior import Exterior
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.space import CSpace
from cspace.store.saved import grid_of, read_npz, read_slice, read_store, shapes_from, unusable
from cspace.store.tiled import is_tiled
from cspace.tiles.space import TiledCSpace
from cspace.workspace import Workspace

_ROUNDING = 1e-12
"""By which coordinates of rotation cells may differ from machine to machine; cells are proven with far more to spare.
"""


def open_map(path: str | os.PathLike[str]) -> CSpace | TiledCSpace:
    """Open a map that was saved, or one that was built into a store.

    Parameters
    ----------
    path : path-like
        A Zarr folder or an ``.npz`` file.

    Returns
    -------
    CSpace
        Equal to the one that was saved. Of a store of tiles, a :class:`cspace.TiledCSpace`, which reads it at need.

    Raises
    ------
    FileError
        If there is nothing, or nothing that can be read, or not a map, or a map that is truncated or changed.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> space = cspace.build(cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))
    >>> space.save("map.zarr")
    >>> cspace.open("map.zarr").count() == space.count()
    True
    """
    return retry_if_replaced(path, lambda: _opened(path))


open = open_map  # noqa: A001 - its public name, cspace.open


def _opened(path: str | os.PathLike[str]) -> CSpace | TiledCSpace:
    """Open a map that no other process replaces."""
    if (folder := _is_folder(path)) and is_tiled(path):
        return TiledCSpace.open(path)
    metadata, arrays = read_store(path) if folder else read_npz(path)
    try:
        return _restored(metadata, arrays)
    except MemoryError:
        raise
    except Exception as error:  # What agrees with its digests may still be anything, and meets several libraries.
        raise unusable(path, f"its parts make no map: {error}") from error


def open_slice(path: str | os.PathLike[str], rotation: ArrayLike = ()) -> NDArray[np.uint8]:
    """Read the states at one rotation from a map that was saved.

    Of a Zarr folder, nothing but that slice is read, and only that is proven unchanged; an ``.npz`` file is read whole.

    Parameters
    ----------
    path : path-like
        A Zarr folder or an ``.npz`` file.
    rotation : array-like, shape (k,)
        As in a configuration: a yaw in radians, a quaternion, or nothing for a robot that only translates.

    Returns
    -------
    ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
        FREE, MIXED or BLOCKED of each cell, proven for all of the rotation cell that holds it.

    Raises
    ------
    InputError
        If it is not one rotation of the map.
    FileError
        As :func:`cspace.open`, of what is read.
    """

    def number_of(table: Mapping[str, NDArray[Any]]) -> int:
        rotations = Rotations.from_coordinates(table)
        return int(table["slice_of"][rotations.cells_of(rotations.checked(rotation))])

    def read() -> NDArray[np.uint8]:
        if _is_folder(path):
            return read_slice(path, number_of)
        return cast(CSpace, _opened(path)).slice_at(rotation)  # only folders hold tiles

    return retry_if_replaced(path, read)


def _restored(metadata: Mapping[str, Any], arrays: Mapping[str, Any]) -> CSpace:
    """The map of what was read and proven unchanged."""
    workspace = Workspace(
        grid=grid_of(metadata),
        outer=arrays["outer"],
        inner=arrays.get("inner", arrays["outer"]),
        source=metadata["workspace_source"],
        unknown=arrays.get("unknown"),
        shapes=shapes_from(arrays),
    )
    rotations = Rotations.from_coordinates(arrays)
    robot = Robot.from_spec(json.loads(metadata["robot"]))
    slice_of = rotations.slices_for(robot.shape)
    for name, needed in ({"slice_of": slice_of} | rotations.coordinates).items():
        if not np.allclose(arrays[name], needed, rtol=0.0, atol=_ROUNDING):
            raise ValueError(f"its array {name!r} is not that of its rotation cells and its robot")
    leading = (*rotations.leading(len(arrays["state"])), *workspace.grid.shape)
    endless = metadata.get("endless", "").split()
    return CSpace(
        Contents(
            workspace,
            robot,
            rotations,
            slice_of,
            arrays["state"],
            metadata["outside"],
            metadata["margin"],
            metadata["precision"],
            arrays.get("overlap"),
            {name: arrays[name].reshape(leading) for name in FIELD_NAMES if name in arrays},
            None if "exterior" not in arrays else Exterior(np.array(arrays["exterior"])),
            bool(metadata["inner"]) if "inner" in metadata else None,
            endless=tuple(axis in endless for axis in workspace.grid.axes) if endless else (),
        )
    )


def _is_folder(path: str | os.PathLike[str]) -> bool:
    """Whether a saved map is a folder, or else an ``.npz`` file."""
    (where, what), rule = look_up(path, "saved map"), "a saved map is a Zarr folder or an .npz file"
    if not what:
        raise FileError(str(where), "does not exist", rule, "check the name")
    if what != "a folder" and where.suffix.lower() != ".npz":
        raise FileError(str(where), "is not a saved map", rule, "build the map first, with cspace.build or cspace map")
    return what == "a folder"

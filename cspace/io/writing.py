"""Maps, written: which function does it, by the suffix of the name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.io.border import WRITERS, write_border
from cspace.io.input import suffix_of
from cspace.io.npz import write_npz
from cspace.io.record import STACKED, arrays_of
from cspace.io.rosmap import write_ros_map
from cspace.io.store import write_store
from cspace.io.vti import write_vti

if TYPE_CHECKING:
    from cspace.io.record import SavedMap

Named = str | os.PathLike[str]

SAVES: Final[Mapping[str, Callable[[SavedMap, Named, bool], None]]] = {
    ".zarr": write_store,
    "": write_store,
    ".npz": write_npz,
}
"""Formats that :func:`cspace.open` reads again, by suffix."""


def _ros_map(space: SavedMap, number: int, path: Named, overwrite: bool) -> None:
    write_ros_map(space._seen[number], space.grid, path, overwrite)


def _vti(space: SavedMap, number: int, path: Named, overwrite: bool) -> None:
    cells = {
        name: array[number] if name in STACKED else array
        for name, array in arrays_of(space).items()
        if name in (*STACKED, "outer", "inner")
    }
    write_vti(cells, space.grid, path, overwrite)


def _border(space: SavedMap, number: int, path: Named, overwrite: bool) -> None:
    write_border(space._seen[number], space.grid, path, overwrite)


_SLICES: Final[Mapping[str, Callable[[SavedMap, int, Named, bool], None]]] = {
    ".vti": _vti,
    **dict.fromkeys((".yaml", ".yml"), _ros_map),
    **dict.fromkeys(WRITERS, _border),
}
"""Formats that hold one slice of a map, by suffix."""

EXPORTS: Final = (*SAVES, *_SLICES)
"""All formats, by suffix."""

_RULE: Final = "the suffix says which format to write"


def save(space: SavedMap, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Save a map, complete, so that :func:`cspace.open` gives it back.

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
    SAVES[suffix_of(path, SAVES, _RULE)](space, path, overwrite)


def export(
    space: SavedMap, path: str | os.PathLike[str], overwrite: bool = False, *, rotation: ArrayLike | None = None
) -> None:
    """Write a map for other software.

    Parameters
    ----------
    space : CSpace
    path : path-like
        ``.npz``: one NumPy file. ``.zarr`` or no suffix: a Zarr folder. ``.vti``: cells for ParaView, with the arrays
        ``state``, ``outer``, and where the map has them ``inner``, ``overlap`` and those of its overlap field
        (:data:`cspace.states.FIELDS`). ``.yaml``: a map of the plane as a ROS map, with its image beside it.
        ``.ply``, ``.obj``, ``.stl``: the border of the free space, of a map in space
        (:func:`cspace.io.border.free_border`); STL in single precision.
    overwrite : bool
        Whether an existing output may be replaced.
    rotation : array-like, shape (k,), optional
        For what holds one slice of a robot that turns, and needed there: the rotation to write, as a configuration
        tells it. What the map calls free is proven for all of the rotation cell that holds it, and for no other.

    Raises
    ------
    InputError
        If the suffix is another one, the format cannot hold the map, or ``rotation`` is missing or has no place.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    suffix = suffix_of(path, EXPORTS, _RULE)
    if suffix in _SLICES:
        _SLICES[suffix](space, _slice_number(space, path, rotation), path, overwrite)
        return
    if rotation is not None:
        rule = f"a {suffix or 'Zarr'} map holds every slice"
        raise InputError("rotation", f"is {rotation!r}", rule, "leave it out", value=rotation)
    SAVES[suffix](space, path, overwrite)


def _slice_number(space: SavedMap, path: str | os.PathLike[str], rotation: ArrayLike | None) -> int:
    """Number of the one slice of a map that is asked for."""
    rotations = space.rotations
    if rotation is None and rotations.count > 1:
        raise InputError(
            "rotation",
            f"is missing for {Path(path)}",
            f"such a file holds one slice, and this map has {rotations.count} rotation cells",
            f"pass the one to write, by {', '.join(rotations.names)}",
        )
    given = rotations.centers[0] if rotation is None else rotations.checked(rotation)
    return int(space._slice_of[rotations.cells_of(given)])

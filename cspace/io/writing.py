"""Maps, written: which function does it, by the suffix of the name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.io.border import WRITERS, write_border
from cspace.io.input import suffix_of
from cspace.io.npz import write_npz
from cspace.io.record import STACKED, arrays_of
from cspace.io.rosmap import write_ros_map
from cspace.io.store import write_store
from cspace.io.vti import write_vti
from cspace.map.contents import Contents

Named = str | os.PathLike[str]

SAVES: Final[Mapping[str, Callable[[Contents, Named, bool], None]]] = {
    ".zarr": write_store,
    "": write_store,
    ".npz": write_npz,
}
"""Formats that :func:`cspace.open` reads again, by suffix."""


def _ros_map(contents: Contents, number: int, path: Named, overwrite: bool) -> None:
    write_ros_map(contents.states[number], contents.grid, path, overwrite)


def _vti(contents: Contents, number: int, path: Named, overwrite: bool) -> None:
    cells = {
        name: array[number] if name in STACKED else array
        for name, array in arrays_of(contents).items()
        if name in (*STACKED, "outer", "inner")
    }
    write_vti(cells, contents.grid, path, overwrite)


def _border(contents: Contents, number: int, path: Named, overwrite: bool) -> None:
    write_border(contents.states[number], contents.grid, path, overwrite)


_SLICES: Final[Mapping[str, tuple[Callable[[Contents, int, Named, bool], None], Mapping[int, str]]]] = {
    ".vti": (_vti, {}),
    **dict.fromkeys((".yaml", ".yml"), (_ros_map, {3: "a ROS map is plane, and the map is one in space"})),
    **dict.fromkeys(WRITERS, (_border, {2: "the border of the free space is a mesh only in space"})),
}
"""What writes one slice of a map, by suffix; and why it does not in one of the dimensions."""

EXPORTS: Final = (*SAVES, *_SLICES)
"""All formats, by suffix."""

_RULE: Final = "the suffix says which format to write"


def save(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Save a map, complete, so that :func:`cspace.open` gives it back.

    Parameters
    ----------
    contents : Contents
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
    SAVES[suffix_of(path, SAVES, _RULE)](contents, path, overwrite)


def export(
    contents: Contents, path: str | os.PathLike[str], overwrite: bool = False, *, rotation: ArrayLike | None = None
) -> None:
    """Write a map for other software.

    Parameters
    ----------
    contents : Contents
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
        write, refused = _SLICES[suffix]
        grid = contents.grid
        if grid.dim in refused:
            found = f"is {Path(path)}, for {' x '.join(map(str, grid.shape))} cells"
            raise InputError("path", found, refused[grid.dim], "write another format, e.g. .vti", value=path)
        rule = f"{Path(path)} holds one slice"
        number = contents.slice_of[contents.rotations.one_cell(rotation, "rotation", rule)]
        write(contents, int(number), path, overwrite)
        return
    if rotation is not None:
        rule = f"a {suffix or 'Zarr'} map holds every slice"
        raise InputError("rotation", f"is {rotation!r}", rule, "leave it out", value=rotation)
    SAVES[suffix](contents, path, overwrite)

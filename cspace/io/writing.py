"""Maps, written: which function does it, by the suffix of the name."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from cspace.errors import InputError
from cspace.io.arrays import one_yaw
from cspace.io.border import WRITERS, write_border
from cspace.io.npz import write_npz
from cspace.io.store import write_store
from cspace.io.vti import write_vti

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cspace.space import CSpace


_Writer = Callable[["CSpace", str | os.PathLike[str], bool], None]

SAVES: Final[Mapping[str, _Writer]] = {".zarr": write_store, "": write_store, ".npz": write_npz}
"""Formats that :func:`cspace.open` reads again, by suffix."""


def _export_ros_map(space: CSpace, path: str | os.PathLike[str], overwrite: bool, yaw: float | None) -> None:
    from cspace.io.rosmap import write_ros_map

    if space.grid.dim != 2:
        raise InputError(
            f"{Path(path)} names a ROS map; the map has {' x '.join(map(str, space.grid.shape))} cells in space, and a "
            f"ROS map is plane; write {', '.join(suffix for suffix in (*SAVES, '.vti', *WRITERS) if suffix)}"
        )
    write_ros_map(space.stack[_slice_number(space, path, yaw)], space.grid, path, overwrite=overwrite)


def _export_vti(space: CSpace, path: str | os.PathLike[str], overwrite: bool, yaw: float | None) -> None:
    number = _slice_number(space, path, yaw)
    arrays: dict[str, NDArray[Any]] = {"state": space.stack[number], "outer": space.workspace.outer}
    if space.workspace.inner is not space.workspace.outer:
        arrays["inner"] = space.workspace.inner
    if space.overlaps is not None:
        arrays["overlap"] = space.overlaps if space.rotations is None else space.overlaps[number]
    arrays |= {name: field if space.rotations is None else field[number] for name, field in space.fields.items()}
    write_vti(arrays, space.grid, path, overwrite)


def _export_border(space: CSpace, path: str | os.PathLike[str], overwrite: bool, yaw: float | None) -> None:
    if space.grid.dim == 3:
        _slice_number(space, path, yaw)
    write_border(space, path, overwrite)


_SLICES: Final[Mapping[str, Callable[[CSpace, str | os.PathLike[str], bool, float | None], None]]] = {
    ".vti": _export_vti,
    **dict.fromkeys((".yaml", ".yml"), _export_ros_map),
    **dict.fromkeys(WRITERS, _export_border),
}
"""Formats that hold one slice of a map, by suffix."""

EXPORTS: Final = (*SAVES, *_SLICES)
"""All formats, by suffix."""


def save(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
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
    SAVES[_suffix(path, SAVES)](space, path, overwrite)


def export(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False, *, yaw: float | None = None) -> None:
    """Write a map for other software.

    Parameters
    ----------
    space : CSpace
    path : path-like
        ``.npz``: one NumPy file. ``.zarr`` or no suffix: a Zarr folder. ``.vti``: cells for ParaView, with the arrays
        ``state``, ``outer``, and where the map has them ``inner``, ``overlap`` and those of its overlap field
        (:data:`cspace.io.arrays.FIELDS`). ``.yaml``: a map of the plane as a ROS map, with its image beside it.
        ``.ply``, ``.obj``, ``.stl``: the border of the free space, of a map in space
        (:func:`cspace.io.border.free_border`); STL in single precision.
    overwrite : bool
        Whether an existing output may be replaced.
    yaw : float, optional
        For the ``.yaml`` or ``.vti`` of a robot that turns, and needed there: the orientation to write, in radians.
        What the map calls free is proven for all yaw angles of the rotation cell that holds it, and for no other.

    Raises
    ------
    InputError
        If the suffix is another one, the format cannot hold the map, or ``yaw`` is missing or has no place.
    FileError
        If the output exists and may not be replaced, or cannot be written.
    """
    suffix = _suffix(path, EXPORTS)
    if suffix in _SLICES:
        _SLICES[suffix](space, path, overwrite, yaw)
        return
    if yaw is not None:
        raise InputError(f"yaw is {yaw!r} for {Path(path)}; a {suffix or 'Zarr'} map holds every slice; leave it out")
    SAVES[suffix](space, path, overwrite)


def _slice_number(space: CSpace, path: str | os.PathLike[str], yaw: float | None) -> int:
    """Number of the one slice of a map that is asked for."""
    if space.rotations is None:
        if yaw is not None:
            raise InputError(f"yaw is {yaw!r} for a robot that only translates; its map has one slice; leave it out")
        return 0
    if yaw is None:
        raise InputError(
            f"yaw is missing for {Path(path)}; such a file holds one orientation, and this map has "
            f"{space.rotations.count} rotation cells; pass the yaw to write, e.g. yaw=0.0 (radians)"
        )
    return int(space.slice_of[space.rotations.cell_of(one_yaw(yaw))])


def _suffix(path: str | os.PathLike[str], known: Iterable[str]) -> str:
    """The suffix of a name, in small letters."""
    try:
        suffix = Path(path).suffix.lower()
    except TypeError as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    if suffix not in known:
        raise InputError(
            f"{Path(path)} ends in {suffix!r}; the suffix says which format to write; use one of "
            f"{', '.join(name for name in known if name)}"
        )
    return suffix

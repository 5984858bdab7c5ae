"""What a saved map holds, whatever the format: named arrays, plain metadata, and digests that tell of any change."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.errors import FileError, InputError
from cspace.grid import Grid
from cspace.states import BLOCKED, NAMES

if TYPE_CHECKING:
    from cspace.space import CSpace

FORMAT: Final = "cspace-map"
VERSION: Final = 1
"""Version of the format; a reader refuses every other one."""

AXES: Final = ("x", "y", "z")

ATTRIBUTES: Final[dict[str, dict[str, Any]]] = {
    "state": {
        "long_name": "state of the configurations in a cell",
        "flag_values": list(range(len(NAMES))),
        "flag_meanings": " ".join(NAMES),
    },
    "outer": {"long_name": "workspace cells that meet an obstacle"},
    "inner": {"long_name": "workspace cells that lie in obstacles"},
    "overlap": {"long_name": "number of coinciding pairs of obstacle cell and robot offset", "units": "1"},
    **{axis: {"long_name": f"{axis} of the middle of a cell", "units": "m", "axis": axis.upper()} for axis in AXES},
}
"""Attributes of each array, after the CF conventions."""

FILLS: Final[dict[str, Any]] = {"state": 255, "outer": True, "inner": True, "overlap": -1}
"""What stands in for cells that were lost: never a value that would call them free."""

_DTYPES: Final = {"state": "uint8", "outer": "bool", "inner": "bool", "overlap": "int32"}
_REQUIRED: Final = ("state", "outer")
_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("robot", "workspace_source"),
)


def metadata_of(space: CSpace) -> dict[str, Any]:
    """All of a map but its arrays, as plain values: text, numbers and lists of numbers.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    dict
        ``lower`` and ``spacing`` in metres; ``robot`` as JSON text for ``Robot.from_spec``.
    """
    grid = space.grid
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "library_version": __version__,
        "lower": list(grid.lower),
        "spacing": grid.spacing,
        "shape": list(grid.shape),
        "outside": space.outside,
        "margin": float(space.margin),
        "precision": space.precision,
        "robot": space.robot.definition,
        "workspace_source": space.workspace.source,
    }


def arrays_of(space: CSpace) -> dict[str, NDArray[Any]]:
    """The arrays of a map over its cells, then the coordinates of the cells.

    ``inner`` is there only if it differs from ``outer``, ``overlap`` only if the map was built with it.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    dict of str to ndarray
        Cells are indexed [x, y]; the coordinates ``x`` and ``y``, in metres, have one axis.
    """
    workspace, grid = space.workspace, space.grid
    arrays: dict[str, NDArray[Any]] = {"state": space.state, "outer": workspace.outer}
    if workspace.inner is not workspace.outer:
        arrays["inner"] = workspace.inner
    if space.overlaps is not None:
        arrays["overlap"] = space.overlaps
    return arrays | {axis: grid.centers(i) for i, axis in enumerate(AXES[: grid.dim])}


def seal(metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """``metadata`` with the digest of every array, and a digest of itself."""
    digests = {"digests": " ".join(f"{name}:{_digest(array)}" for name, array in arrays.items())}
    sealed = {**metadata, **digests}
    return {**sealed, "digest": _digest_of_metadata(sealed)}


def unseal(metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> dict[str, str]:
    """Check the metadata of a map that was read.

    Parameters
    ----------
    metadata : mapping
        As :func:`seal` made it; further entries are ignored.
    path : path-like
        Where it was read, for the messages.

    Returns
    -------
    dict of str to str
        The digest of each array that the map must hold, by name.

    Raises
    ------
    FileError
        If it is no map, is of an unknown format version, or was changed.
    """
    if metadata.get("format") != FORMAT:
        raise unusable(path, f"its metadata say format {metadata.get('format')!r}, not {FORMAT!r}")
    if metadata.get("format_version") != VERSION:
        raise FileError(
            f"{os.fspath(path)} has format version {metadata.get('format_version')!r}; cspace {__version__} reads "
            f"version {VERSION} only; open it with the version of cspace that wrote it "
            f"({metadata.get('library_version', 'unknown')}), or build it again"
        )
    missing = [key for key in (*_KEYS, "digests", "digest") if key not in metadata]
    if missing:
        raise unusable(path, f"its metadata lack {', '.join(missing)}")
    if metadata["digest"] != _digest_of_metadata(metadata):
        raise unusable(path, "its metadata differ from their digest")
    digests = dict(entry.split(":") for entry in metadata["digests"].split())
    lacking = [name for name in _REQUIRED if name not in digests]
    if lacking:
        raise unusable(path, f"it holds no {' and no '.join(lacking)}")
    return digests


def restore(metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], path: str | os.PathLike[str]) -> CSpace:
    """The map that was read, once every array is proven to be what was written.

    Parameters
    ----------
    metadata : mapping
        As :func:`seal` made it.
    arrays : mapping of str to ndarray
        As :func:`arrays_of` made them.
    path : path-like
        Where they were read, for the messages.

    Returns
    -------
    CSpace

    Raises
    ------
    FileError
        If an array is missing, has the wrong shape or type, differs from its digest or holds an unknown state.
    """
    from cspace.robot import Robot
    from cspace.space import CSpace
    from cspace.workspace import Workspace

    shape = tuple(metadata["shape"])
    for name, digest in unseal(metadata, path).items():
        if name not in arrays:
            raise unusable(path, f"its array {name!r} is missing")
        array = arrays[name]
        if name in _DTYPES and (array.shape != shape or array.dtype != _DTYPES[name]):
            raise unusable(
                path, f"its array {name!r} is {array.dtype} {array.shape} where {_DTYPES[name]} {shape} is needed"
            )
        if _digest(array) != digest:
            raise unusable(path, f"its array {name!r} differs from its digest")
    highest = int(arrays["state"].max())
    if highest > BLOCKED:
        raise unusable(path, f"its array 'state' holds {highest}, which is none of the states 0 to {BLOCKED}")
    try:
        workspace = Workspace(
            grid=Grid(metadata["lower"], metadata["spacing"], shape),
            outer=arrays["outer"],
            inner=arrays.get("inner", arrays["outer"]),
            source=metadata["workspace_source"],
        )
        return CSpace(
            workspace,
            Robot.from_spec(json.loads(metadata["robot"])),
            arrays["state"],
            outside=metadata["outside"],
            margin=metadata["margin"],
            precision=metadata["precision"],
            overlaps=arrays.get("overlap"),
        )
    except (InputError, ValueError, TypeError) as error:
        raise unusable(path, f"its parts make no map: {error}") from error


def unusable(path: str | os.PathLike[str], what: str) -> FileError:
    """The error for a saved map that cannot be trusted, and so is not opened at all."""
    return FileError(
        f"{Path(path)} is not a usable map: {what}; a saved map is opened only if it is complete and unchanged; copy "
        "it again from where it is whole, or build it again"
    )


def _digest(array: NDArray[Any]) -> str:
    """Digest of an array's type, shape and values, the same on every machine."""
    portable = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    digest = hashlib.blake2b(f"{portable.dtype.str}{array.shape}".encode(), digest_size=16)
    digest.update(portable.data)
    return digest.hexdigest()


def _digest_of_metadata(metadata: Mapping[str, Any]) -> str:
    text = json.dumps({key: metadata[key] for key in (*_KEYS, "digests")}, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

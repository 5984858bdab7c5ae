"""What a saved map holds, whatever the format: named arrays, plain metadata, and digests that tell of any change."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.errors import FileError, InputError
from cspace.grid import Grid
from cspace.io.arrays import DTYPES, FIELDS, STACKED, TURNS, expected_shape, rotation_arrays, rotations_from
from cspace.io.geometry import shapes_from
from cspace.states import BLOCKED

if TYPE_CHECKING:
    from cspace.space import CSpace

FORMAT: Final = "cspace-map"
VERSION: Final = 1
"""Version of the format; a reader refuses every other one."""

_REQUIRED: Final = ("state", "outer")
_KEYS: Final = (
    *("format", "format_version", "library_version", "lower", "spacing", "shape", "outside", "margin", "precision"),
    *("rotations", "robot", "workspace_source"),
)


def metadata_of(space: CSpace) -> dict[str, Any]:
    """All of a map but its arrays, as plain values: text, numbers and lists of numbers.

    Parameters
    ----------
    space : CSpace

    Returns
    -------
    dict
        ``lower`` and ``spacing`` in metres; ``rotations`` the number of rotation cells, 0 for a robot that only
        translates; ``robot`` as JSON text for ``Robot.from_spec``.
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
        "rotations": 0 if space.rotations is None else space.rotations.count,
        "robot": space.robot.definition,
        "workspace_source": space.workspace.source,
    }


def seal(metadata: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """``metadata`` with the digests of every array, one for each slice of a stack, and a digest of itself."""
    digests = {name: ",".join(map(_digest, _parts(name, array, metadata))) for name, array in arrays.items()}
    sealed = {**metadata, "digests": " ".join(f"{name}:{digest}" for name, digest in digests.items())}
    return {**sealed, "digest": _digest_of_metadata(sealed)}


def unseal(metadata: Mapping[str, Any], path: str | os.PathLike[str]) -> dict[str, list[str]]:
    """Check the metadata of a map that was read.

    Parameters
    ----------
    metadata : mapping
        As :func:`seal` made it; further entries are ignored.
    path : path-like
        Where it was read, for the messages.

    Returns
    -------
    dict of str to list of str
        The digests of each array that the map must hold, by name: one, or those of the slices of a stack.

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
    entries = (entry.partition(":") for entry in metadata["digests"].split())
    digests = {name: joined.split(",") for name, _, joined in entries}
    required = (*_REQUIRED, *(TURNS if metadata["rotations"] else ()))
    lacking = [name for name in required if name not in digests]
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
        As :func:`cspace.io.arrays.arrays_of` made them.
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

    for name, digests in unseal(metadata, path).items():
        if name not in arrays:
            raise unusable(path, f"its array {name!r} is missing")
        check_kind(name, arrays[name], metadata, len(digests), path)
        parts = _parts(name, arrays[name], metadata)
        for number, (part, digest) in enumerate(zip(parts, digests, strict=True)):
            check_part(name, part, digest, path, number if len(digests) > 1 else None)
    try:
        workspace = Workspace(
            grid=Grid(metadata["lower"], metadata["spacing"], tuple(metadata["shape"])),
            outer=arrays["outer"],
            inner=arrays.get("inner", arrays["outer"]),
            source=metadata["workspace_source"],
            shapes=shapes_from(arrays),
        )
        space = CSpace(
            workspace,
            Robot.from_spec(json.loads(metadata["robot"])),
            arrays["state"],
            outside=metadata["outside"],
            margin=metadata["margin"],
            precision=metadata["precision"],
            overlaps=arrays.get("overlap"),
            rotations=rotations_from(arrays["yaw_bounds"]) if metadata["rotations"] else None,
            fields={name: arrays[name] for name in FIELDS if name in arrays},
        )
    except (InputError, ValueError, TypeError) as error:
        raise unusable(path, f"its parts make no map: {error}") from error
    if space.rotations is not None:
        for name, needed in rotation_arrays(space.rotations, space.slice_of).items():
            if not np.array_equal(arrays[name], needed):
                raise unusable(path, f"its array {name!r} is not that of its rotation cells and its robot")
    return space


def check_kind(name: str, array: Any, metadata: Mapping[str, Any], slices: int, path: str | os.PathLike[str]) -> None:
    """Raise FileError for an array of another shape or type than the map needs; its values are not looked at.

    Parameters
    ----------
    name : str
    array : object with ``shape`` and ``dtype``
    metadata : mapping
        As :func:`seal` made it.
    slices : int
        How many digests the array has.
    path : path-like
        Where it was read, for the message.
    """
    shape = expected_shape(name, tuple(metadata["shape"]), metadata["rotations"], slices, array.shape)
    dtype = DTYPES.get(name, array.dtype)
    if array.shape != shape or array.dtype != dtype:
        raise unusable(path, f"its array {name!r} is {array.dtype} {array.shape} where {dtype} {shape} is needed")


def check_part(
    name: str, part: NDArray[Any], digest: str, path: str | os.PathLike[str], number: int | None = None
) -> None:
    """Raise FileError for an array, or slice ``number`` of a stack, that is not what was written, or no state."""
    what = f"its array {name!r}" if number is None else f"slice {number} of its array {name!r}"
    if _digest(part) != digest:
        raise unusable(path, f"{what} differs from its digest")
    if name == "state" and part.max() > BLOCKED:
        raise unusable(path, f"{what} holds {part.max()}, which is none of the states 0 to {BLOCKED}")


def unusable(path: str | os.PathLike[str], what: str) -> FileError:
    """The error for a saved map that cannot be trusted, and so is not opened at all."""
    return FileError(
        f"{Path(path)} is not a usable map: {what}; a saved map is opened only if it is complete and unchanged; copy "
        "it again from where it is whole, or build it again"
    )


def _parts(name: str, array: NDArray[Any], metadata: Mapping[str, Any]) -> Iterable[NDArray[Any]]:
    """What has a digest of its own: the slices of a stack, or the array."""
    return array if metadata["rotations"] and name in STACKED else [array]


def _digest(array: NDArray[Any]) -> str:
    """Digest of an array's type, shape and values, the same on every machine."""
    portable = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    digest = hashlib.blake2b(f"{portable.dtype.str}{array.shape}".encode(), digest_size=16)
    digest.update(portable.data)
    return digest.hexdigest()


def _digest_of_metadata(metadata: Mapping[str, Any]) -> str:
    text = json.dumps({key: metadata[key] for key in (*_KEYS, "digests")}, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

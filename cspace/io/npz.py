"""Maps as one compressed NumPy file, complete, and plain to read without this library."""

from __future__ import annotations

import json
import os
import zipfile
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.io.input import existing
from cspace.io.limits import check_bytes
from cspace.io.output import replacing
from cspace.io.record import (
    arrays_of,
    check_kind,
    check_names,
    check_states,
    decoding_map,
    digest_of_array,
    metadata_of,
    seal,
    unseal,
    unusable,
)
from cspace.map.contents import Contents

_KIND: Final = "saved map"
_NUMBERS: Final = ("lower", "spacing")
"""Members that repeat what the metadata tell, for those who read the file without this library."""

_LONGEST: Final = 2**28
"""Bytes of the metadata, at most."""


def write_npz(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as an ``.npz`` file.

    ``numpy.load`` finds the arrays of :data:`cspace.io.record.ARRAYS`: ``state`` (uint8 [slice, x, y] or
    [slice, x, y, z]: 0 free, 1 mixed, 2 blocked), ``slice_of`` (the slice of each rotation cell: the states by rotation
    are ``state[slice_of]``), ``x``, ``y`` and in space ``z`` (middles of the cells, metres), ``outer``, where they are
    needed ``inner``, ``overlap``, those of the overlap field, those of the rotation cells and ``shapes``; besides,
    ``lower``, ``spacing`` and ``metadata`` (JSON text).

    Raises
    ------
    FileError
        As :func:`cspace.io.output.replacing`.
    """
    members: dict[str, Any] = {
        **{name: np.asarray(array) for name, array in arrays_of(contents).items()},
        "lower": np.array(contents.grid.lower),
        "spacing": np.array(contents.grid.spacing),
    }
    sealed = seal(metadata_of(contents), {name: digest_of_array(array) for name, array in members.items()})
    members["metadata"] = json.dumps(sealed, sort_keys=True)
    # An open file, because np.savez would add a suffix to any name that does not end in lower-case ".npz".
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **members)


def read_npz(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Metadata and arrays of a map that :func:`write_npz` wrote.

    Raises
    ------
    FileError
        If the file cannot be read, is not such a map, or is truncated or changed.
    """
    file = existing(path, _KIND)
    with decoding_map(path), file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
        names = archive.namelist()
        if len(set(names)) < len(names) or any(part in name for name in names for part in ("/", "\\", ":", "..")):
            raise unusable(path, "it has members whose names climb out of it, or twice the same")
        if "metadata.npy" not in names:
            raise unusable(path, "it holds no metadata")
        if archive.getinfo("metadata.npy").file_size > _LONGEST:
            raise unusable(path, f"its metadata are over {_LONGEST} bytes long")
        metadata = json.loads(str(_member(archive, "metadata")[()]))
        digests = unseal(metadata, path)
        check_names([name for name in digests if name not in _NUMBERS], metadata, path)
        arrays = {}
        for name, digest in digests.items():
            if f"{name}.npy" not in names:
                raise unusable(path, f"its array {name!r} is missing")
            header = _Header(archive, name)
            if name not in _NUMBERS:
                check_kind(name, header, metadata, path)
            check_bytes(path, archive.getinfo(f"{name}.npy").file_size, f"has an array {name!r} that unpacks to")
            arrays[name] = _member(archive, name)
            if digest_of_array(arrays[name]) != digest:
                raise unusable(path, f"its array {name!r} differs from its digest")
    check_states(arrays["state"], path)
    return metadata, arrays


class _Header:
    """Shape and type of a member, whose size agrees with them, before it is unpacked."""

    def __init__(self, archive: zipfile.ZipFile, name: str) -> None:
        with archive.open(f"{name}.npy") as stream:
            if np.lib.format.read_magic(stream) != (1, 0):
                raise ValueError(f"{name} is of another version of the format of NumPy")
            self.shape, _, self.dtype = np.lib.format.read_array_header_1_0(stream)
            size = stream.tell() + self.dtype.itemsize * int(np.prod(self.shape, dtype=object))
        if size != archive.getinfo(f"{name}.npy").file_size:
            raise ValueError(f"{name} is longer or shorter than its header says")


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as stream:
        return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))

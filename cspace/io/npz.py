"""Maps as one compressed NumPy file, complete, and plain to read without this library."""

from __future__ import annotations

import json
import os
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.errors import FileError
from cspace.io.arrays import arrays_of
from cspace.io.input import unreadable
from cspace.io.output import replacing
from cspace.io.record import metadata_of, restore, seal, unseal, unusable

if TYPE_CHECKING:
    from cspace.space import CSpace


def write_npz(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as an ``.npz`` file.

    ``numpy.load`` finds ``state`` (uint8 [x, y] or [x, y, z]: 0 free, 1 mixed, 2 blocked), ``x``, ``y`` and in space
    ``z`` (middles of the cells, metres), ``lower``, ``spacing``, ``outer``, ``inner``, ``overlap`` and those of the
    overlap field (:data:`cspace.io.arrays.FIELDS`) where they are needed, and ``metadata`` (JSON text).
    Obstacles that are known as shapes are in ``geometry``, a GeometryCollection in WKB, or in space in ``shapes`` and
    the arrays of :func:`cspace.io.geometry.geometry_arrays`.

    The map of a robot that turns has ``state``, ``overlap`` and the field by [slice, x, y] and, by rotation cell,
    ``slice_of`` and in radians ``yaw`` (the representative), ``yaw_bounds`` (the borders) and ``covering_angle``: the
    states by [rotation, x, y] are ``state[slice_of]``.

    Parameters
    ----------
    space : CSpace
    path : path-like
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    FileError
        If the file exists and may not be replaced, or cannot be written.
    """
    metadata, arrays = metadata_of(space), arrays_of(space)
    arrays |= {"lower": np.array(space.grid.lower), "spacing": np.array(space.grid.spacing)}
    members: dict[str, Any] = {**arrays, "metadata": json.dumps(seal(metadata, arrays), sort_keys=True)}
    # An open file, because np.savez would add a suffix to any name that does not end in lower-case ".npz".
    with replacing(path, overwrite) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **members)


def read_npz(path: str | os.PathLike[str]) -> CSpace:
    """Read a map that :func:`write_npz` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    CSpace

    Raises
    ------
    FileError
        If the file cannot be read, is not such a map, or is truncated or changed.
    """
    try:
        content = BytesIO(Path(path).read_bytes())  # np.load would leave a damaged file open.
    except OSError as error:
        raise unreadable(path, "saved map", error) from error
    try:
        members = np.load(content, allow_pickle=False)
        if "metadata" not in members:
            raise unusable(path, "it holds no metadata")
        metadata = json.loads(str(members["metadata"][()]))
        arrays = {name: members[name] for name in unseal(metadata, path) if name in members}
    except FileError:
        raise
    except Exception as error:  # A damaged file makes the decoders raise almost anything.
        raise unusable(path, f"it cannot be decoded ({type(error).__name__}: {error})") from error
    return restore(metadata, arrays, path)

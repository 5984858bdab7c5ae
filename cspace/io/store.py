"""Maps as a folder in the Zarr format: chunked, compressed, with a checksum on every chunk.

Zarr reads a chunk that is missing as the fill value, without a word; were that 0, a lost chunk would be called FREE. So
the fill value is no state, every chunk is written, and a map is opened only if every chunk is there and every array
agrees with its digest.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError
from cspace.io.input import unreadable
from cspace.io.output import replacing
from cspace.io.record import ATTRIBUTES, AXES, FILLS, arrays_of, metadata_of, restore, seal, unseal, unusable

if TYPE_CHECKING:
    import zarr

    from cspace.space import CSpace

_CHUNK: Final = {1: 2**20, 2: 1024, 3: 128}
"""Cells of a chunk along each axis, by the number of axes: about a million cells."""


def write_store(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as a Zarr folder, which ``xarray.open_zarr`` reads too.

    Parameters
    ----------
    space : CSpace
    path : path-like
    overwrite : bool
        Whether an existing map may be replaced. A folder that holds anything else never is.

    Raises
    ------
    FileError
        If the folder exists and may not be replaced, or cannot be written.
    """
    arrays = arrays_of(space)
    with replacing(path, overwrite, folder=_is_ours) as temporary:
        for name, content in _encoded(seal(metadata_of(space), arrays), arrays).items():
            file = temporary / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)


def read_store(path: str | os.PathLike[str]) -> CSpace:
    """Read a map that :func:`write_store` wrote.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    CSpace

    Raises
    ------
    FileError
        If the folder cannot be read, is not such a map, or any part of it is missing, truncated or changed.
    """
    import zarr

    if not (Path(path) / "zarr.json").is_file():
        raise unusable(path, "it holds no zarr.json")
    try:
        # Zarr 3 only: arrays of version 2 may name a codec that unpickles.
        group = zarr.open_group(Path(path), mode="r", zarr_format=3)
        metadata: dict[str, Any] = dict(group.attrs)
        digests = unseal(metadata, path)
        arrays = {name: _read_array(group, name, tuple(metadata["shape"]), path) for name in digests}
    except FileError:
        raise
    except PermissionError as error:
        raise unreadable(path, "saved map", error) from error
    except Exception as error:  # A damaged file makes the decoders raise almost anything.
        raise unusable(path, f"it cannot be decoded ({type(error).__name__}: {error})") from error
    return restore(metadata, arrays, path)


def _encoded(metadata: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> dict[str, bytes]:
    """The files of a Zarr folder by their names.

    They are encoded in memory, compressed, because Zarr writes from threads that go on after an interruption.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec
    from zarr.storage import MemoryStore

    files: dict[str, Any] = {}
    group = zarr.create_group(MemoryStore(files), zarr_format=3, attributes=metadata)
    for name, array in arrays.items():
        group.create_array(
            name,
            shape=array.shape,
            dtype=array.dtype,
            chunks=tuple(min(n, _CHUNK[array.ndim]) for n in array.shape),
            compressors=[ZstdCodec(level=3), Crc32cCodec()],
            fill_value=FILLS.get(name, np.nan),
            attributes=ATTRIBUTES[name],
            dimension_names=(name,) if name in AXES else AXES[: array.ndim],
            config={"write_empty_chunks": True},
        )[...] = array
    return {name: content.to_bytes() for name, content in files.items()}


def _read_array(group: zarr.Group, name: str, shape: tuple[int, ...], path: str | os.PathLike[str]) -> NDArray[Any]:
    """One array, after the checks that cost nothing."""
    import zarr

    array = group.get(name)
    if not isinstance(array, zarr.Array):
        raise unusable(path, f"its array {name!r} is missing")
    expected = (shape[AXES.index(name)],) if name in AXES else shape
    if array.shape != expected:  # Before reading: a changed shape could ask for more memory than there is.
        raise unusable(path, f"its array {name!r} has shape {array.shape} where {expected} is needed")
    if array.nchunks_initialized != array.nchunks:
        raise unusable(path, f"its array {name!r} lacks {array.nchunks - array.nchunks_initialized} chunks")
    return np.asarray(array[...])


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds nothing but a map, whole or damaged."""
    parts = {"zarr.json", "c"}
    return all(
        (entry.name == "zarr.json" and entry.is_file())
        or (entry.name in ATTRIBUTES and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        for entry in folder.iterdir()
    )

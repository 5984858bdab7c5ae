"""Maps as a folder in the Zarr format: chunked, compressed, with a checksum on every chunk.

Zarr reads a chunk that is missing as the fill value, without a word; were that 0, a lost chunk would be called FREE. So
the fill value is no state, every chunk is written, and a map is opened only if every chunk is there and every array
agrees with its digest. The map of a robot that turns is stored slice by slice, each in chunks and with a digest of its
own, so that one is read and proven without the rest.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError
from cspace.io.arrays import (
    ATTRIBUTES,
    FILLS,
    TURNS,
    arrays_of,
    attributes_of,
    dimensions_of,
    one_yaw,
    rotations_from,
)
from cspace.io.input import unreadable
from cspace.io.output import replacing
from cspace.io.record import check_kind, check_part, metadata_of, restore, seal, unseal, unusable

if TYPE_CHECKING:
    import zarr

    from cspace.space import CSpace

_CHUNK: Final = {1: 2**20, 2: 1024, 3: 128}
"""Cells of a chunk along each axis, by the number of axes: about a million cells."""

_SLICE_CHUNK: Final = 4096
"""Cells of a chunk of a stack along x and y, which is one slice thick: a whole slice, but for huge ones."""

_ROWS: Final = 2**18
"""Rows of a chunk of the tables of shapes, whose rows are never cut."""


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
        for name, content in _encoded(seal(metadata_of(space), arrays), arrays):
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
    with _decoding(path):
        group, metadata, digests = _opened(path)
        arrays = {name: _read(group, name, metadata, len(digests[name]), path) for name in digests}
    return restore(metadata, arrays, path)


def read_slice(path: str | os.PathLike[str], yaw: float = 0.0) -> NDArray[np.uint8]:
    """Read the slice of one yaw from a map that :func:`write_store` wrote, and nothing else of the map.

    What is read is checked as :func:`read_store` does; damage elsewhere goes unnoticed.

    Parameters
    ----------
    path : path-like
    yaw : float
        Radians, wrapped. Plays no part in the map of a robot that only translates.

    Returns
    -------
    ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
        FREE, MIXED or BLOCKED of each cell, proven for all yaw angles of the rotation cell that holds ``yaw``;
        :meth:`CSpace.slice_at` of the whole map.

    Raises
    ------
    InputError
        If ``yaw`` is not one finite number that can be wrapped.
    FileError
        If the folder cannot be read, is not such a map, or what is read of it is missing, truncated or changed.
    """
    angle = one_yaw(yaw)
    with _decoding(path):
        group, metadata, digests = _opened(path)
        needed = ("yaw_bounds", "slice_of") if metadata["rotations"] else ()
        table = {name: _read(group, name, metadata, len(digests[name]), path) for name in needed}
        for name, array in table.items():
            check_part(name, array, digests[name][0], path)
        rotations = rotations_from(table["yaw_bounds"]) if table else None
    number = None if rotations is None else int(table["slice_of"][rotations.cell_of(angle)])
    with _decoding(path):
        state = _read(group, "state", metadata, len(digests["state"]), path, number)
        check_part("state", state, digests["state"][number or 0], path, number)
    return state


def _encoded(metadata: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Iterator[tuple[str, bytes]]:
    """The files of a Zarr folder with their names, a layer of chunks at a time.

    They are encoded in memory, compressed, because Zarr writes from threads that go on after an interruption.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec
    from zarr.storage import MemoryStore

    files: dict[str, Any] = {}
    dimensions = dimensions_of(len(metadata["shape"]), turns=bool(metadata["rotations"]))
    # Global "coordinates" tell readers of the CF conventions which arrays label others.
    labels = {"coordinates": " ".join(TURNS)} if metadata["rotations"] else {}
    group = zarr.create_group(MemoryStore(files), zarr_format=3, attributes={**metadata, **labels})
    for name, array in arrays.items():
        chunks = _chunks(array.shape, dimensions[name])
        stored = group.create_array(
            name,
            shape=array.shape,
            dtype=array.dtype,
            chunks=chunks,
            compressors=[ZstdCodec(level=3), Crc32cCodec()],
            fill_value=FILLS.get(name, np.nan),
            attributes=attributes_of(name, len(metadata["shape"])),
            dimension_names=dimensions[name],
            config={"write_empty_chunks": True},
        )
        for start in range(0, len(array), chunks[0]):
            stored[start : start + chunks[0]] = array[start : start + chunks[0]]
            for chunk in [file for file in files if "/c/" in file]:
                yield chunk, files.pop(chunk).to_bytes()
    for file, content in files.items():
        yield file, content.to_bytes()


def _chunks(shape: tuple[int, ...], dimensions: tuple[str, ...]) -> tuple[int, ...]:
    """Shape of the chunks of an array."""
    longest = [_CHUNK[len(shape)]] * len(shape)
    if dimensions[0] == "slice":
        longest = [1, _SLICE_CHUNK, _SLICE_CHUNK]
    elif dimensions[0] in ("vertex", "face", "ball"):
        longest = [_ROWS, *shape[1:]]
    return tuple(map(min, shape, longest))


@contextmanager
def _decoding(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn whatever a damaged folder makes the decoders raise into a FileError."""
    try:
        yield
    except FileError:
        raise
    except PermissionError as error:
        raise unreadable(path, "saved map", error) from error
    except Exception as error:
        raise unusable(path, f"it cannot be decoded ({type(error).__name__}: {error})") from error


def _opened(path: str | os.PathLike[str]) -> tuple[zarr.Group, dict[str, Any], dict[str, list[str]]]:
    """A saved map with its metadata, checked, and its digests."""
    import zarr

    if not (Path(path) / "zarr.json").is_file():
        raise unusable(path, "it holds no zarr.json")
    # Zarr 3 only: arrays of version 2 may name a codec that unpickles.
    group = zarr.open_group(Path(path), mode="r", zarr_format=3)
    metadata: dict[str, Any] = dict(group.attrs)
    return group, metadata, unseal(metadata, path)


def _read(
    group: zarr.Group,
    name: str,
    metadata: Mapping[str, Any],
    slices: int,
    path: str | os.PathLike[str],
    number: int | None = None,
) -> NDArray[Any]:
    """One array, or slice ``number`` of it, after the checks that cost nothing."""
    import zarr

    array = group.get(name)
    if not isinstance(array, zarr.Array):
        raise unusable(path, f"its array {name!r} is missing")
    # Before reading: a changed shape could ask for more memory than there is.
    check_kind(name, array, metadata, slices, path)
    if number is None:
        lacking = array.nchunks - array.nchunks_initialized
    else:
        chunks = [(number, *rest) for rest in np.ndindex(array.cdata_shape[1:])]
        lacking = sum(not Path(path, name, array.metadata.encode_chunk_key(chunk)).is_file() for chunk in chunks)
    if lacking:
        raise unusable(path, f"its array {name!r} lacks {lacking} chunks")
    return np.asarray(array[... if number is None else number])


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds nothing but a map, whole or damaged."""
    parts = {"zarr.json", "c"}
    return all(
        (entry.name == "zarr.json" and entry.is_file())
        or (entry.name in ATTRIBUTES and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        for entry in folder.iterdir()
    )

"""Saved maps: a folder in the Zarr format, chunked, with a digest of every file in it, or one compressed NumPy file.

Zarr reads a chunk that is missing as the fill value, without a word; were that 0, a lost chunk would be called FREE. So
the fill value is no state, every chunk is written, and a map is opened only if every file is there and agrees, to the
byte, with its digest. States are stored slice by slice, each in chunks of its own, so that one is read and proven
without the rest.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.io.input import existing
from cspace.io.limits import check_bytes
from cspace.io.output import replacing
from cspace.io.record import (
    ARRAYS,
    arrays_of,
    axes_of,
    check_kind,
    check_names,
    check_states,
    decoding_map,
    digest_of,
    digest_of_array,
    grid_of,
    metadata_of,
    seal,
    turns_of,
    unseal,
    unusable,
    zarr_options,
)
from cspace.map.contents import Contents
from cspace.map.storage import PackedStates
from cspace.memory import is_packed

_ROOT: Final = "zarr.json"

CHUNK: Final = {1: 2**20, 2: 1024, 3: 128}
"""Cells of a chunk along each axis, by the number of axes: about a million cells."""

SLICE_CHUNK: Final = {2: 4096, 3: 256}
"""The same for a chunk of a slice: all of a slice in the plane, but for huge ones."""

_CODECS: Final = {"bytes", "zstd", "crc32c"}
"""What a chunk may be encoded with; others may do more than decode."""

_NUMBERS: Final = ("lower", "spacing")
"""Members that repeat the metadata, for those who read the file without this library."""

_LONGEST: Final = 2**28
"""Bytes of the metadata, at most."""


def write_store(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as a Zarr folder, which ``xarray.open_zarr`` reads too; it replaces no folder of anything else.

    Raises FileError as :func:`cspace.io.output.replacing`.
    """
    with replacing(path, overwrite, folder=_is_ours) as temporary:
        for name, content in _encoded(metadata_of(contents), arrays_of(contents)):
            file = temporary / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)


def read_store(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Metadata and arrays of a map that :func:`write_store` wrote; very many states in two bits each.

    Raises FileError if the folder cannot be read, is not such a map, or any part of it is missing, truncated or
    changed.
    """
    with decoding_map(path):
        metadata, digests = _opened(path)
        names = [name.removesuffix(f"/{_ROOT}") for name in digests if name.endswith(f"/{_ROOT}")]
        check_names(names, metadata, path)
        files = {name: _proven(path, name, digests) for name in digests}
        return metadata, {name: _array(path, name, metadata, files) for name in names}


def read_parts(
    path: str | os.PathLike[str], number: int | None = None
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Metadata and the arrays of the rotation cells; or, with ``number``, that slice of the states, and nothing else.

    What is read is checked as :func:`read_store` does; damage elsewhere goes unnoticed.

    Raises FileError as :func:`read_store`, of what is read.
    """
    with decoding_map(path):
        metadata, digests = _opened(path)
        names = ("state",) if number is not None else ("slice_of", *turns_of(name.split("/")[0] for name in digests))
        wanted = [f"state/c/{number}/"] if number is not None else [f"{name}/c/" for name in names]
        wanted += [f"{name}/{_ROOT}" for name in names]
        files = {name: _proven(path, name, digests) for name in digests if name.startswith(tuple(wanted))}
        return metadata, {name: _array(path, name, metadata, files, number) for name in names}


def _encoded(metadata: dict[str, Any], arrays: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """The files of a Zarr folder with their names, a layer of chunks at a time; last the one that seals them.

    They are encoded in memory, because Zarr writes from threads that go on after an interruption.
    """
    import zarr
    from zarr.codecs import Crc32cCodec, ZstdCodec
    from zarr.storage import MemoryStore

    files: dict[str, Any] = {}
    digests: dict[str, str] = {}
    grid = grid_of(metadata)

    def finished(ending: str) -> Iterator[tuple[str, bytes]]:
        for name in [name for name in files if ending in name]:
            content = files.pop(name).to_bytes()
            digests[name] = digest_of(content)
            yield name, content

    group = zarr.create_group(MemoryStore(files), zarr_format=3)
    for name, array in arrays.items():
        chunks = _chunks(array.shape, axes_of(name, grid.dim))
        codecs, options = [ZstdCodec(level=3), Crc32cCodec()], zarr_options(name, grid)
        stored = group.create_array(
            name, shape=array.shape, dtype=array.dtype, chunks=chunks, compressors=codecs, **options
        )
        for start in range(0, len(array), chunks[0]):
            stored[start : start + chunks[0]] = array[start : start + chunks[0]]
            yield from finished("/c/")
    yield from finished(f"/{_ROOT}")
    document = json.loads(files[_ROOT].to_bytes())
    # Global "coordinates" tell readers of the CF conventions which arrays label others.
    labels = {"coordinates": " ".join((*turns_of(arrays), "slice_of"))}
    document["attributes"] = seal(metadata | labels, digests)
    yield _ROOT, _written(document)


def _written(document: Mapping[str, Any]) -> bytes:
    """The one way in which the root's text is written."""
    return json.dumps(document, indent=2).encode()


def _chunks(shape: tuple[int, ...], axes: tuple[str, ...]) -> tuple[int, ...]:
    """Shape of the chunks of an array."""
    longest = [CHUNK.get(len(shape), 1)] * len(shape)
    if axes[0] == "slice" and len(shape) > 2:
        longest = [1] + [SLICE_CHUNK[len(shape) - 1]] * (len(shape) - 1)
    return tuple(max(1, min(pair)) for pair in zip(shape, longest, strict=True))


def _opened(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Metadata, checked, and the digest of each file."""
    root = Path(path) / _ROOT
    if not root.is_file():
        raise unusable(path, f"it holds no {_ROOT}")
    check_bytes(root, root.stat().st_size, memory=8.0)
    content = root.read_bytes()
    document = json.loads(content)
    metadata: dict[str, Any] = document["attributes"]
    digests = unseal(metadata, path)
    if content != _written(document) or set(document) != {"attributes", "zarr_format", "node_type"}:
        raise unusable(path, f"its {_ROOT} was changed")
    if (document["zarr_format"], document["node_type"]) != (3, "group"):
        raise unusable(path, f"its {_ROOT} was changed")
    return metadata, digests


def _proven(path: str | os.PathLike[str], name: str, digests: Mapping[str, str]) -> bytes:
    """The content of a file of the folder, which agrees with its digest."""
    file = Path(path) / name
    if ".." in name or not file.is_file():
        raise unusable(path, f"its file {name!r} is missing")
    check_bytes(file, file.stat().st_size)
    content = file.read_bytes()
    if digest_of(content) != digests[name]:
        raise unusable(path, f"its file {name!r} differs from its digest")
    return content


def _array(
    path: str | os.PathLike[str],
    name: str,
    metadata: Mapping[str, Any],
    files: Mapping[str, bytes],
    number: int | None = None,
) -> Any:
    """One array, or slice ``number`` of it."""
    import zarr
    from zarr.core.buffer import default_buffer_prototype
    from zarr.storage import MemoryStore

    # Before zarr looks for what decodes it, which may be any package that is installed.
    codecs = {codec["name"] for codec in json.loads(files[f"{name}/{_ROOT}"])["codecs"]}
    if not codecs <= _CODECS:
        raise unusable(path, f"its array {name!r} is encoded with {', '.join(map(str, codecs))}")
    buffer = default_buffer_prototype().buffer.from_bytes
    ours = {file[len(name) + 1 :]: buffer(files[file]) for file in files if file.startswith(f"{name}/")}
    array = zarr.open_array(MemoryStore(ours), mode="r", zarr_format=3)
    # Before reading: a forged shape could ask for more memory than there is.
    check_kind(name, array, metadata, path)
    has_overlap = "overlap" in {file.split("/")[0] for file in files}
    packed = name == "state" and number is None and is_packed(array.shape[1:], array.shape[0], has_overlap)
    size = array.nbytes // 4 if packed else array.nbytes if number is None else array.nbytes // array.shape[0]
    check_bytes(Path(path) / name, size, "unpacks to")
    front = () if number is None else (number,)
    chunks = np.ndindex(array.cdata_shape[len(front) :])
    lacking = sum(array.metadata.encode_chunk_key((*front, *chunk)) not in ours for chunk in chunks)
    if lacking:
        raise unusable(path, f"its array {name!r} lacks {lacking} chunks")
    if packed:
        states = PackedStates(array.shape)
        for k in range(len(states)):
            values = np.asarray(array[k])
            check_states(values, path)
            states.write(k, values)
        return states
    values = np.asarray(array[... if number is None else number])
    if name == "state":
        check_states(values, path)
    return values


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds nothing but a map, whole or damaged, of this version or an earlier one."""
    parts = {_ROOT, "c"}
    known = {*ARRAYS, "geometry", "vertices", "faces", "centers", "radii"}
    return all(
        (entry.name == _ROOT and entry.is_file())
        or (entry.name in known and entry.is_dir() and {part.name for part in entry.iterdir()} <= parts)
        for entry in folder.iterdir()
    )


def write_npz(contents: Contents, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write a map as an ``.npz`` file.

    ``numpy.load`` finds the arrays of :data:`cspace.io.record.ARRAYS`: ``state`` (uint8 [slice, x, y] or
    [slice, x, y, z]: 0 free, 1 mixed, 2 blocked), ``slice_of`` (the slice of each rotation cell: the states by rotation
    are ``state[slice_of]``), ``x``, ``y`` and in space ``z`` (middles of the cells, metres), ``outer``, where they are
    needed ``inner``, ``overlap``, those of the overlap field, those of the rotation cells and ``shapes``; besides,
    ``lower``, ``spacing`` and ``metadata`` (JSON text).

    Raises FileError as :func:`cspace.io.output.replacing`.
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

    Raises FileError if the file cannot be read, is not such a map, or is truncated or changed.
    """
    file = existing(path, "saved map")
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

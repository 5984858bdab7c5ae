"""Arrays in Zarr folders of version 3, written and read chunk by chunk.

This is the part of the format that the zarr package writes by default, and that package reads all
of it. It is not used here for two reasons: importing it takes 0.3 s of CPU time, and it trusts the
folder. A chunk of a few kilobytes can declare gigabytes, the metadata can name any installed
package as codec, and a missing chunk is read as the fill value, which could pass for free space.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numcodecs import Zstd
from numpy.typing import NDArray

from cspace._files.access import ContentError, decoding, inspect_path, read_member
from cspace._files.plain import read_json
from cspace._support.arrays import Box, Bytes, StrPath, intersect_boxes
from cspace._support.limits import bytes_text

ROOT_FILE: Final = "zarr.json"
"""Name of the file with the metadata of a folder or an array."""

MAX_CHUNK_BYTES: Final = 2**28
"""Maximum number of bytes that one chunk may unpack to."""

WRITTEN_CHUNK_BYTES: Final = 2**24
"""Maximum number of bytes in a chunk that this module writes, unless one row of cells has more."""

ZSTD_LEVEL: Final = 1
"""Level of zstd; higher levels take more time and save little, or even enlarge slices of rotated
robots."""

MISSING_CHUNKS_ATTRIBUTE: Final = "missing_chunks"
"""Attribute of an array; if it is "fill_value", missing chunks hold the fill value."""

_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_RAW: Final[dict[str, Any]] = {"name": "bytes", "configuration": {"endian": "little"}}
_ZSTD: Final[dict[str, Any]] = {
    "name": "zstd",
    "configuration": {"level": ZSTD_LEVEL, "checksum": False},
}

_ARRAY_KIND: Final = "Zarr array"
_ARRAY_RULE: Final = "it must be a folder with one array of booleans, and not a saved map"


@dataclass(frozen=True)
class Layout:
    """Division of an array into chunks.

    Attributes
    ----------
    shape, chunks : tuple of int
        Entries of the array and of a chunk along each axis.
    dtype : numpy.dtype
        Booleans, integers or floats, little-endian.
    compressed : bool
        True if chunks are compressed by zstd, False if they hold raw bytes.
    separator : {".", "/"}
        Sign between the numbers in the name of a chunk; "/" makes a folder for each axis.
    """

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]
    compressed: bool
    separator: str = "."

    @classmethod
    def of(cls, shape: Sequence[int], dtype: str, compressed: bool) -> Layout:
        """Choose chunks of whole rows, of at most ``WRITTEN_CHUNK_BYTES`` if possible."""
        # From the first axis on, until an index of the rest fits into a chunk.
        chunks = list(shape)
        for axis, count in enumerate(shape):
            bytes_per_index = np.dtype(dtype).itemsize * math.prod(shape[axis + 1 :])
            chunks[axis] = max(1, min(count, WRITTEN_CHUNK_BYTES // bytes_per_index))
            if bytes_per_index <= WRITTEN_CHUNK_BYTES:
                break
        return cls(tuple(shape), tuple(chunks), np.dtype(dtype).newbyteorder("<"), compressed)

    @classmethod
    def parse(cls, metadata: Any) -> Layout:
        """Parse the metadata of an array.

        Raises ContentError if this module cannot read such an array, and any error if the metadata
        are malformed.
        """
        # Its kind, then the type of its entries, then its shape and chunks.
        if (metadata["zarr_format"], metadata.get("node_type")) != (3, "array"):
            raise ContentError("holds no array", _ARRAY_RULE)
        codecs, separator = _check_codecs(metadata)
        data_type = str(metadata["data_type"])
        if not re.fullmatch(r"bool|u?int(8|16|32|64)|float(32|64)", data_type):
            problem = f"has entries of type {data_type:.40}"
            raise ContentError(problem, "cells are booleans")
        dtype = np.dtype(data_type).newbyteorder("<")
        shape = _check_counts(metadata["shape"])
        chunks = _check_counts(metadata["chunk_grid"]["configuration"]["chunk_shape"])
        layout = cls(shape, chunks, dtype, "zstd" in codecs, separator)
        # Maximum number of bytes that an array may declare; all indices then fit into 64 bits.
        if len(shape) != len(chunks) or layout.nbytes > 2**62:
            problem = f"has the shape {shape!s:.40} and chunks of {chunks!s:.40}"
            raise ContentError(problem)
        if layout.chunk_bytes > MAX_CHUNK_BYTES:
            problem = f"has chunks of {bytes_text(layout.chunk_bytes)}"
            rule = f"a chunk may unpack to at most {bytes_text(MAX_CHUNK_BYTES)}"
            raise ContentError(problem, rule)
        return layout

    @property
    def chunk_bytes(self) -> int:
        """Number of bytes that a chunk unpacks to."""
        return math.prod(self.chunks) * self.dtype.itemsize

    @property
    def nbytes(self) -> int:
        """Number of bytes of the whole array."""
        return math.prod(self.shape) * self.dtype.itemsize

    def describe(self, fill: Any, attributes: Mapping[str, Any], axes: Sequence[str]) -> bytes:
        """Return the content of the array's metadata file."""
        special = {"nan": "NaN", "inf": "Infinity"}  # numbers that JSON lacks
        document = {
            "zarr_format": 3,
            "node_type": "array",
            "shape": self.shape,
            "data_type": self.dtype.name,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": self.chunks}},
            "chunk_key_encoding": {
                "name": "default",
                "configuration": {"separator": self.separator},
            },
            "fill_value": special.get(str(fill), fill),
            "codecs": [_RAW, _ZSTD] if self.compressed else [_RAW],
            "attributes": attributes,
            "dimension_names": axes,
        }
        return _indent(json.dumps(document)).encode()

    def iterate_chunks(self, box: Box | None = None) -> Iterator[tuple[str, Box]]:
        """Yield file name and cells of each chunk in a box.

        The box defaults to the whole array, and cells are clipped to the array.
        """
        box = box or tuple(slice(0, count) for count in self.shape)
        # Chunks along each axis that meet the box.
        spans = [
            range(cells.start // side, -(-cells.stop // side))
            for cells, side in zip(box, self.chunks, strict=True)
        ]
        counts = list(map(len, spans))
        # Files may declare any number of chunks, which np.ndindex would list in memory.
        for number in range(math.prod(counts)):
            place = np.unravel_index(number, counts)
            index = [span[k] for span, k in zip(spans, place, strict=True)]
            axes = zip(index, self.chunks, self.shape, strict=True)
            cells = tuple(slice(i * side, min((i + 1) * side, count)) for i, side, count in axes)
            yield self.separator.join(["c", *map(str, index)]), cells

    def encode(self, block: NDArray[Any], fill: Any) -> bytes:
        """Encode a chunk, padded with ``fill`` beyond the array."""
        if block.shape != self.chunks:
            padded = np.full(self.chunks, fill, dtype=self.dtype)
            padded[tuple(slice(0, count) for count in block.shape)] = block
            block = padded
        raw = np.ascontiguousarray(block, dtype=self.dtype)
        return bytes(Zstd(ZSTD_LEVEL).encode(raw)) if self.compressed else raw.tobytes()

    def decode(self, content: bytes) -> NDArray[Any]:
        """Decode a chunk.

        Raises ContentError if its size differs from the declared one, before it is unpacked, and
        any error of the decoder if it is damaged.
        """
        declared = _zstd_size(content) if self.compressed else len(content)
        if declared not in (None, self.chunk_bytes):
            needed = f"{self.chunk_bytes} are needed"
            raise ContentError(f"has a chunk that unpacks to {declared} bytes but {needed}")
        raw: Bytes = np.frombuffer(content, dtype=np.uint8)
        if self.compressed:
            raw = Zstd().decode(content, out=np.empty(self.chunk_bytes, dtype=np.uint8))
        return raw.view(self.dtype).reshape(self.chunks)


@lru_cache
def _indent(text: str) -> str:
    """Return indented JSON; the metadata of an array are those of all tiles of a map."""
    return json.dumps(json.loads(text), indent=2)


def _zstd_size(content: bytes) -> int | None:
    """Return the first zstd frame's size, bytes.

    Returns None if it declares none; numcodecs then checks that the content fills its buffer.
    """
    # RFC 8878: magic, descriptor, window (unless a single segment), dictionary, declared size.
    if content[:4] != _ZSTD_MAGIC:
        raise ContentError("has a chunk that is not compressed by zstd")
    # The bits of the descriptor say how many bytes the next fields take.
    descriptor = content[4]
    is_single_segment = descriptor >> 5 & 1
    window_bytes = 1 - is_single_segment
    dictionary_bytes = (0, 1, 2, 4)[descriptor & 0b11]
    size_bytes = (is_single_segment, 2, 4, 8)[descriptor >> 6]
    if not size_bytes:
        return None
    start = 5 + window_bytes + dictionary_bytes  # after the magic number and the descriptor
    declared = int.from_bytes(content[start : start + size_bytes], "little")
    # Two bytes count from 256 on, because one byte serves smaller sizes.
    return declared + 256 if size_bytes == 2 else declared


def _check_codecs(metadata: Any) -> tuple[list[str], str]:
    """Return the names of an array's codecs, and the separator in names of chunks.

    Raises ContentError if its chunks are encoded, divided or named in another way than by default.
    """
    codecs = metadata["codecs"]
    names = [str(codec["name"]) for codec in codecs]
    endian = codecs[0].get("configuration", {}).get("endian", "little")
    keys = metadata["chunk_key_encoding"]
    separator = keys.get("configuration", {}).get("separator", "/")
    rule = "chunks may use bytes, then zstd; they must be regular, and have zarr's default names"
    if names not in (["bytes"], ["bytes", "zstd"]) or endian != "little":
        raise ContentError(f"is encoded with {', '.join(names):.80}", rule)
    is_default = keys["name"] == "default" and separator in ("/", ".")
    if not is_default or metadata["chunk_grid"]["name"] != "regular":
        raise ContentError("has other chunks than zarr's default", rule)
    return names, separator


def missing_chunk(name: str) -> ContentError:
    """Return the error for an array that lacks one or more chunks."""
    rule = (
        "a lost chunk would pass for free space, unless the attribute "
        f"{MISSING_CHUNKS_ATTRIBUTE} is 'fill_value'"
    )
    return ContentError(f"lacks {name}", rule)


def _check_counts(numbers: Any) -> tuple[int, ...]:
    """Return positive whole numbers as a tuple.

    Raises ContentError if a number is not a positive int.
    """
    # Maximum number of axes of an array.
    is_list = isinstance(numbers, list) and len(numbers) <= 32
    if not is_list or not all(type(number) is int and number > 0 for number in numbers):
        problem = f"has the shape {numbers!r:.40}; all sides must be whole numbers above zero"
        raise ContentError(problem)
    return tuple(numbers)


class ZarrArray:
    """An array in a Zarr folder that reads chunks when indexed.

    Raises FileError if the folder holds no array, or an array that cannot be read.
    """

    def __init__(self, path: StrPath) -> None:
        """Read the metadata of the array, but no chunk."""
        self.filename = Path(path).absolute()  # workers have other working folders
        file = self.filename / ROOT_FILE
        with decoding(path, _ARRAY_KIND, _ARRAY_RULE):
            if not inspect_path(file, _ARRAY_KIND)[1]:
                raise ContentError("holds no array of Zarr version 3", _ARRAY_RULE)
            metadata = read_json(file, _ARRAY_KIND)
            self._layout = Layout.parse(metadata)
            self._fill = metadata["fill_value"]
            attributes = metadata.get("attributes") or {}
            meaning = attributes.get(MISSING_CHUNKS_ATTRIBUTE)
        self.attrs = attributes
        is_number = isinstance(self._fill, bool | int | float)
        self._may_miss_chunks = is_number and meaning == "fill_value"
        self.shape = self._layout.shape
        self.dtype = self._layout.dtype
        self.ndim = len(self.shape)
        self.dims = tuple(metadata.get("dimension_names") or ())

    def __getitem__(self, box: Sequence[slice]) -> NDArray[Any]:
        """Read the entries in a box.

        Raises FileError if a chunk is missing, damaged, of the wrong size, or not a plain file.
        """
        entries = np.empty([cells.stop - cells.start for cells in box], dtype=self.dtype)
        with decoding(self.filename, _ARRAY_KIND):
            for name, cells in self._layout.iterate_chunks(tuple(box)):
                in_box, in_chunk = intersect_boxes(box, cells)
                content = read_member(self.filename, name, "chunk")
                if content is not None:
                    entries[in_box] = self._layout.decode(content)[in_chunk]
                elif self._may_miss_chunks:
                    entries[in_box] = self._fill
                else:
                    raise missing_chunk(f"its chunk {name}")
        return entries

    def __reduce__(self) -> tuple[type[ZarrArray], tuple[Path]]:
        """Pickle the path, so that each process reads the folder itself."""
        return ZarrArray, (self.filename,)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Read all entries as a NumPy array."""
        whole = tuple(slice(0, count) for count in self.shape)
        return np.asarray(self[whole], dtype=dtype)

"""Arrays in the Zarr format, read chunk by chunk.

A chunk of a few kilobytes can unpack to gigabytes, and the metadata can name any installed package as codec. So this
module parses the metadata itself, accepts few codecs, and unpacks each chunk into a buffer of the declared size. A
missing chunk is an error, because its fill value could pass for free space.
"""

from __future__ import annotations

import io
import itertools
import math
import os
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bytes, intersect_boxes
from cspace.files.access import ContentError, decoding, inspect_path, read_member
from cspace.files.plain import read_json
from cspace.limits import bytes_text

COMPRESSORS: Final = ("zstd", "gzip", "blosc")
"""Compressors that can be read; the only other codecs are "bytes" and "crc32c"."""

MAX_CHUNK_BYTES: Final = 2**28
"""Maximum number of bytes that one chunk may unpack to."""

MISSING_CHUNKS_ATTRIBUTE: Final = "missing_chunks"
"""Attribute of an array; if it is "fill_value", missing chunks hold the fill value."""

_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"

_ZARR_KIND: Final = "Zarr array"
_ARRAY_RULE: Final = "it must be a folder with one array of booleans, and not a saved map"
_ARRAY_HINT: Final = "write it with zarr.create_array"


def unpack(content: bytes, compressor: str, size: int, out: Bytes | None = None) -> Bytes:
    """Decompress a chunk of exactly `size` bytes.

    zstd unpacks into `out`, if given. At most `size` + 1 bytes are unpacked, whatever the content declares.

    Raises ContentError if it unpacks to another size, and any error of the decoders if it is damaged.
    """
    import numcodecs

    unpacked: Bytes
    if compressor == "zstd":
        _check_size(_zstd_size(content), size)
        unpacked = numcodecs.Zstd().decode(content, out=np.empty(size, dtype=np.uint8) if out is None else out)
    elif compressor == "blosc":
        (declared, _, stored) = struct.unpack_from("<III", content, 4)
        _check_size(declared, size)
        if stored != len(content):
            raise ContentError(f"has a chunk of {len(content)} bytes that declares {stored}")
        unpacked = numcodecs.Blosc().decode(content, out=np.empty(size, dtype=np.uint8))
    elif compressor == "gzip":
        unpacked = np.frombuffer(_gunzip(content, size + 1), dtype=np.uint8)
    else:
        unpacked = np.frombuffer(content, dtype=np.uint8)
    _check_size(len(unpacked), size)
    return unpacked


def _check_size(declared: int | None, size: int) -> None:
    if declared not in (None, size):
        raise ContentError(f"has a chunk that unpacks to {declared} bytes but {size} are needed")


def _zstd_size(content: bytes) -> int | None:
    """Return the size that the first zstd frame declares.

    Returns None if it declares none; numcodecs then checks that the content fills `out`.
    """
    if content[:4] != _ZSTD_MAGIC:
        raise ContentError("has a chunk that is not compressed by zstd")
    descriptor = content[4]
    single = descriptor >> 5 & 1
    width = (single, 2, 4, 8)[descriptor >> 6]
    start = 5 + (1 - single) + (0, 1, 2, 4)[descriptor & 3]
    declared = int.from_bytes(content[start : start + width], "little") + (256 if width == 2 else 0)
    return declared if width else None


def _gunzip(content: bytes, limit: int) -> bytes:
    """Decompress gzip data up to ``limit`` bytes."""
    import gzip

    with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
        return stream.read(limit)


@dataclass(frozen=True)
class Layout:
    """Division of an array into chunks, and their encoding.

    Attributes
    ----------
    shape, chunks : tuple of int
        Entries of the array and of a chunk along each axis.
    dtype : numpy.dtype
        Booleans, integers or floats, in the byte order of the file.
    order : {"C", "F"}
        Order of the entries within a chunk.
    compressor : str
        One of :data:`COMPRESSORS`, or empty.
    checksums : int
        Number of CRC-32C checksums after the compressed bytes.
    prefix, separator : str
        A chunk file is named by the prefix, then the indices of the chunk, separated.
    fill : object
        Fill value of missing chunks; None if no chunk may be missing.
    """

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: np.dtype[Any]
    order: str
    compressor: str
    checksums: int
    prefix: str
    separator: str
    fill: object

    @classmethod
    def parse(cls, metadata: Any, attributes: Any = None) -> Layout:
        """Parse array metadata of Zarr version 2 or 3.

        `attributes` is for version 2, which keeps them in a separate file.

        Raises ContentError if this module cannot read such an array, and any error if the metadata are malformed.
        """
        if metadata["zarr_format"] == 2:
            codecs = [codec["id"] for codec in (metadata["compressor"], *(metadata["filters"] or ())) if codec]
            text, chunks, order = str(metadata["dtype"]), metadata["chunks"], metadata["order"]
            prefix, separator = "", metadata.get("dimension_separator", ".")
        elif (metadata["zarr_format"], metadata.get("node_type")) == (3, "array"):
            first, *others = metadata["codecs"]
            codecs = [codec["name"] for codec in (others if first["name"] == "bytes" else metadata["codecs"])]
            little = first.get("configuration", {}).get("endian", "little") == "little"
            text, order = ("<" if little else ">") + np.dtype(str(metadata["data_type"])).str[1:], "C"
            chunks, keys = metadata["chunk_grid"]["configuration"]["chunk_shape"], metadata["chunk_key_encoding"]
            prefix, separator = {"default": ("c", "/"), "v2": ("", ".")}[keys["name"]]
            separator = keys.get("configuration", {}).get("separator", separator)
            prefix, attributes = prefix and prefix + separator, metadata.get("attributes")
        else:
            raise ContentError("holds no array", _ARRAY_RULE, _ARRAY_HINT)
        compressor = codecs.pop(0) if codecs and codecs[0] in COMPRESSORS else ""
        if set(codecs) - {"crc32c"} or (codecs and metadata["zarr_format"] == 2):
            problem = f"is encoded with {', '.join(map(str, (*filter(None, [compressor]), *codecs))):.80}"
            rule = f"chunks may use one of {', '.join(COMPRESSORS)}, then crc32c"
            raise ContentError(problem, rule, "use zarr's default codecs, or open it with zarr and pass the array")
        if not re.fullmatch(r"[<>|][biuf]\d", text) or order not in ("C", "F") or separator not in (".", "/"):
            raise ContentError(f"has entries of type {text:.40}, which cannot be read")
        fill = metadata["fill_value"] if (attributes or {}).get(MISSING_CHUNKS_ATTRIBUTE) == "fill_value" else None
        shapes = _check_counts(metadata["shape"]), _check_counts(chunks)
        layout = cls(*shapes, np.dtype(text), order, compressor, len(codecs), prefix, separator, fill)
        if len(layout.shape) != len(layout.chunks) or not isinstance(fill, bool | int | float | None):
            problem = f"has the shape {layout.shape}, chunks of {layout.chunks} and the fill value {fill!r:.40}"
            raise ContentError(problem)
        if layout.chunk_bytes > MAX_CHUNK_BYTES:
            rule = f"a chunk may unpack to at most {bytes_text(MAX_CHUNK_BYTES)}"
            raise ContentError(f"has chunks of {bytes_text(layout.chunk_bytes)}", rule, "write smaller chunks")
        return layout

    @property
    def chunk_bytes(self) -> int:
        """Number of bytes that a chunk unpacks to."""
        return math.prod(self.chunks) * self.dtype.itemsize

    def key(self, index: Sequence[int]) -> str:
        """Return the name of a chunk's file."""
        return self.prefix + self.separator.join(map(str, index))

    def decode(self, content: bytes) -> NDArray[Any]:
        """Decode a chunk.

        Raises ContentError if its size differs from the declared one, and any error of the decoders if it is damaged.
        """
        from numcodecs.checksum32 import CRC32C

        for _ in range(self.checksums):
            content = bytes(CRC32C(location="end").decode(content))
        entries = unpack(content, self.compressor, self.chunk_bytes).view(self.dtype)
        return entries.reshape(self.chunks, order=self.order)  # type: ignore[call-overload, no-any-return]

    def read(self, box: Sequence[slice], content_of: Callable[[str], bytes | None]) -> NDArray[Any]:
        """Read the entries in a box.

        `content_of` returns the content of a named chunk file, or None if it is missing.

        Raises ContentError if a chunk is missing, and as :meth:`decode`.
        """
        entries = np.empty([part.stop - part.start for part in box], dtype=self.dtype.newbyteorder("="))
        spans = [range(p.start // n, -(-p.stop // n)) for p, n in zip(box, self.chunks, strict=True)]
        for index in itertools.product(*spans):
            here, there = intersect_boxes(
                box, [slice(i * n, (i + 1) * n) for i, n in zip(index, self.chunks, strict=True)]
            )
            content = content_of(self.key(index))
            if content is None and self.fill is None:
                raise missing_chunk(f"its chunk {self.key(index)}")
            entries[here] = self.fill if content is None else self.decode(content)[there]
        return entries


def missing_chunk(name: str) -> ContentError:
    """Return the error for an array that lacks one or more chunks."""
    attribute = MISSING_CHUNKS_ATTRIBUTE
    return ContentError(
        f"lacks {name}",
        "a lost chunk would pass for free space",
        "copy the array again, or write it with zarr.create_array(..., config={'write_empty_chunks': True}); "
        f'if missing chunks hold the fill value, set array.attrs["{attribute}"] = "fill_value"',
    )


def _check_counts(numbers: Any) -> tuple[int, ...]:
    """Return positive whole numbers as a tuple.

    Raises ContentError if a number is not a positive int.
    """
    if not all(type(number) is int and number > 0 for number in numbers):
        raise ContentError(f"has the shape {numbers!r:.40}; all sides must be whole numbers above zero")
    return tuple(numbers)


class ZarrArray:
    """An array in a Zarr folder that reads chunks when indexed.

    Raises FileError if the folder holds no array, or an array that cannot be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.filename = Path(path).absolute()  # workers have other working folders
        with decoding(path, _ZARR_KIND, _ARRAY_RULE, _ARRAY_HINT):
            document, attributes = self._read_json("zarr.json"), None
            if document is None:
                document, attributes = self._read_json(".zarray"), self._read_json(".zattrs")
            if document is None:
                raise ContentError("holds no array", _ARRAY_RULE, _ARRAY_HINT)
            self._layout = Layout.parse(document, attributes)
        self.shape, self.dtype, self.ndim = self._layout.shape, self._layout.dtype, len(self._layout.shape)

    def __getitem__(self, box: Sequence[slice]) -> NDArray[Any]:
        """Read the entries in a box.

        Raises FileError if a chunk is missing, damaged, of the wrong size, or not a plain file.
        """
        with decoding(self.filename, _ZARR_KIND):
            return self._layout.read(box, self._content)

    def __reduce__(self) -> tuple[type[ZarrArray], tuple[Path]]:
        """Pickle the path, so that each process reads the folder itself."""
        return ZarrArray, (self.filename,)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Read all entries as a NumPy array."""
        return np.asarray(self[tuple(slice(0, n) for n in self.shape)], dtype=dtype)

    def _read_json(self, name: str) -> Any:
        file = self.filename / name
        return read_json(file, _ZARR_KIND) if inspect_path(file, _ZARR_KIND)[1] else None

    def _content(self, name: str) -> bytes | None:
        return read_member(self.filename, name, "chunk")

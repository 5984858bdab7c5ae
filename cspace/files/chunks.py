"""Arrays in the Zarr format, read chunk by chunk; no chunk unpacks to more than its array declares.

A chunk of a few kilobytes can unpack to gigabytes, and the metadata of an array can name any installed package as its
codec. So this module reads the metadata itself, accepts few codecs, and unpacks each chunk into a buffer of the size
that the array declares. A missing chunk is an error, because its fill value could pass for free space.
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

from cspace.arrays import Bytes, shared
from cspace.files.access import Fault, decoding, look_up, read_part
from cspace.files.plain import read_json
from cspace.limits import bytes_text

COMPRESSORS: Final = ("zstd", "gzip", "blosc")
"""Compressors that are read; beside them, only the codecs "bytes" and "crc32c" are."""

MAX_CHUNK_BYTES: Final = 2**28
"""Most bytes that one chunk of an array may unpack to."""

MISSING: Final = "missing_chunks"
"""Attribute of an array; with the value "fill_value", its missing chunks hold the fill value."""

_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"

_KIND: Final = "Zarr array"
_RULE: Final = "it must be a folder with one array of booleans, and not a saved map"
_MEND: Final = "write it with zarr.create_array"


def unpack(content: bytes, compressor: str, size: int, out: Bytes | None = None) -> Bytes:
    """Decompress a chunk that must unpack to exactly `size` bytes, into `out` if it is zstd and `out` is given.

    At most `size` + 1 bytes are unpacked, whatever the content declares.

    Raises Fault if it unpacks to another size, and any error of the decoders if it is damaged.
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
            raise Fault(f"has a chunk of {len(content)} bytes that declares {stored}")
        unpacked = numcodecs.Blosc().decode(content, out=np.empty(size, dtype=np.uint8))
    elif compressor == "gzip":
        unpacked = np.frombuffer(_gunzip(content, size + 1), dtype=np.uint8)
    else:
        unpacked = np.frombuffer(content, dtype=np.uint8)
    _check_size(len(unpacked), size)
    return unpacked


def _check_size(declared: int | None, size: int) -> None:
    if declared not in (None, size):
        raise Fault(f"has a chunk that unpacks to {declared} bytes where {size} are needed")


def _zstd_size(content: bytes) -> int | None:
    """Return the size that the first frame declares; None if it declares none, so that numcodecs must fill `out`."""
    if content[:4] != _ZSTD_MAGIC:
        raise Fault("has a chunk that is not compressed by zstd")
    descriptor = content[4]
    single = descriptor >> 5 & 1
    width = (single, 2, 4, 8)[descriptor >> 6]
    start = 5 + (1 - single) + (0, 1, 2, 4)[descriptor & 3]
    declared = int.from_bytes(content[start : start + width], "little") + (256 if width == 2 else 0)
    return declared if width else None


def _gunzip(content: bytes, limit: int) -> bytes:
    import gzip

    with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
        return stream.read(limit)


@dataclass(frozen=True)
class Layout:
    """How an array is cut into chunks, and how these are encoded.

    Attributes
    ----------
    shape, chunks : tuple of int
        Entries of the array and of a chunk along each axis.
    dtype : numpy.dtype
        Booleans, whole or floating-point numbers, with the byte order of the file.
    order : {"C", "F"}
        Order of the entries of a chunk.
    compressor : str
        One of :data:`COMPRESSORS`, or empty.
    checksums : int
        Number of CRC-32C checksums after the compressed bytes.
    prefix, separator : str
        The name of a chunk's file is the prefix and the indices of the chunk, separated.
    fill : object
        Value of the missing chunks, as the metadata have it; None if they must not be missing.
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
        """Parse the metadata of an array, as versions 2 and 3 of Zarr have them; version 2 keeps `attributes` apart.

        Raises Fault if the array is not one that is read, and any error if the metadata are malformed.
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
            raise Fault("holds no array", _RULE, _MEND)
        compressor = codecs.pop(0) if codecs and codecs[0] in COMPRESSORS else ""
        if set(codecs) - {"crc32c"} or (codecs and metadata["zarr_format"] == 2):
            raise Fault(
                f"is encoded with {', '.join(map(str, (*filter(None, [compressor]), *codecs))):.80}",
                f"one compressor of {', '.join(COMPRESSORS)} is read, and crc32c after it",
                "write it again with zarr's default codecs, or open it with zarr and pass the array",
            )
        if not re.fullmatch(r"[<>|][biuf]\d", text) or order not in ("C", "F") or separator not in (".", "/"):
            raise Fault(f"has entries of type {text:.40}, which is not read")
        fill = metadata["fill_value"] if (attributes or {}).get(MISSING) == "fill_value" else None
        shapes = _counts(metadata["shape"]), _counts(chunks)
        layout = cls(*shapes, np.dtype(text), order, compressor, len(codecs), prefix, separator, fill)
        if len(layout.shape) != len(layout.chunks) or not isinstance(fill, bool | int | float | None):
            raise Fault(f"has the shape {layout.shape}, chunks of {layout.chunks} and the fill value {fill!r:.40}")
        if layout.chunk_bytes > MAX_CHUNK_BYTES:
            rule = f"a chunk may unpack to {bytes_text(MAX_CHUNK_BYTES)} at most"
            raise Fault(f"has chunks of {bytes_text(layout.chunk_bytes)}", rule, "write it again in smaller chunks")
        return layout

    @property
    def chunk_bytes(self) -> int:
        """Bytes that a chunk unpacks to."""
        return math.prod(self.chunks) * self.dtype.itemsize

    def key(self, index: Sequence[int]) -> str:
        """Return the name of a chunk's file."""
        return self.prefix + self.separator.join(map(str, index))

    def decode(self, content: bytes) -> NDArray[Any]:
        """Decode a chunk.

        Raises Fault if it unpacks to another size than declared, and any error of the decoders if it is damaged.
        """
        from numcodecs.checksum32 import CRC32C

        for _ in range(self.checksums):
            content = bytes(CRC32C(location="end").decode(content))
        entries = unpack(content, self.compressor, self.chunk_bytes).view(self.dtype)
        return entries.reshape(self.chunks, order=self.order)  # type: ignore[call-overload, no-any-return]

    def read(self, box: Sequence[slice], content_of: Callable[[str], bytes | None]) -> NDArray[Any]:
        """Read the entries in a box; `content_of` gives the content of a file by its name, or None if it is missing.

        Raises Fault if a chunk is missing, and errors as :meth:`decode`.
        """
        entries = np.empty([part.stop - part.start for part in box], dtype=self.dtype.newbyteorder("="))
        spans = [range(p.start // n, -(-p.stop // n)) for p, n in zip(box, self.chunks, strict=True)]
        for index in itertools.product(*spans):
            here, there = shared(box, [slice(i * n, (i + 1) * n) for i, n in zip(index, self.chunks, strict=True)])
            content = content_of(self.key(index))
            if content is None and self.fill is None:
                raise missing_chunk(f"its chunk {self.key(index)}")
            entries[here] = self.fill if content is None else self.decode(content)[there]
        return entries


def missing_chunk(name: str) -> Fault:
    """Return the error for an array that lacks a chunk, or several."""
    return Fault(
        f"lacks {name}",
        "a chunk that was lost would pass for free space",
        "copy the array again, or write it with zarr.create_array(..., config={'write_empty_chunks': True}); "
        f'if missing chunks hold the fill value, set array.attrs["{MISSING}"] = "fill_value"',
    )


def _counts(numbers: Any) -> tuple[int, ...]:
    """Return whole numbers above zero as a tuple.

    Raises Fault if one is not.
    """
    if not all(type(number) is int and number > 0 for number in numbers):
        raise Fault(f"has the shape {numbers!r:.40}; all sides must be whole numbers above zero")
    return tuple(numbers)


class ZarrArray:
    """An array in a Zarr folder, of which an index of slices reads the chunks that it needs.

    Raises FileError if the folder holds no array, or one that is not read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.filename = Path(path).absolute()  # workers have other working folders
        with decoding(path, _KIND, _RULE, _MEND):
            document, attributes = self._read_json("zarr.json"), None
            if document is None:
                document, attributes = self._read_json(".zarray"), self._read_json(".zattrs")
            if document is None:
                raise Fault("holds no array", _RULE, _MEND)
            self._layout = Layout.parse(document, attributes)
        self.shape, self.dtype, self.ndim = self._layout.shape, self._layout.dtype, len(self._layout.shape)

    def __getitem__(self, box: Sequence[slice]) -> NDArray[Any]:
        """Read the entries in a box.

        Raises FileError if a chunk is missing, damaged or unpacks to another size, or is not a plain file.
        """
        with decoding(self.filename, _KIND):
            return self._layout.read(box, self._content)

    def __reduce__(self) -> tuple[type[ZarrArray], tuple[Path]]:
        return ZarrArray, (self.filename,)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[tuple(slice(0, n) for n in self.shape)], dtype=dtype)

    def _read_json(self, name: str) -> Any:
        file = self.filename / name
        return read_json(file, _KIND) if look_up(file, _KIND)[1] else None

    def _content(self, name: str) -> bytes | None:
        return read_part(self.filename, name, "chunk")

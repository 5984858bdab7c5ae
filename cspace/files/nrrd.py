"""Grids of values in the NRRD format (teem.sourceforge.net/nrrd), as they come from 3D Slicer and ITK.

pynrrd is no alternative: it unpacks whatever a file holds before it looks at the declared size, so that a file of a few
megabytes takes gigabytes. Here at most the declared size is unpacked, a block at a time.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import re
from collections.abc import Iterator
from typing import IO, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats
from cspace.check import check_point, finite, positive
from cspace.errors import InputError
from cspace.files.access import Fault, decoding, existing, header_lines, is_count, read_bytes
from cspace.limits import check_cells

KIND: Final = "grid in NRRD"

_TYPES: Final = {
    "i1": ("signed char", "int8", "int8_t"),
    "u1": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "i4": ("int", "signed int", "int32", "int32_t"),
    "u4": ("uint", "unsigned int", "uint32", "uint32_t"),
    "i8": (
        *("longlong", "long long", "long long int", "signed long long", "signed long long int"),
        *("int64", "int64_t"),
    ),
    "u8": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
"""Names of the types of values, by their code in numpy."""

_ENDIANS: Final = {"little": "<", "big": ">"}
_METRES: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
"""Lengths of the units in which a file may give its spacing, metres."""

_VECTOR: Final = re.compile(r"none|\(([^()]*)\)")

_HEADER_BYTES: Final = 2**16
"""Bytes in which the header must end."""

_BLOCK_BYTES: Final = 2**22
"""Bytes of values that are unpacked and compared at a time."""

_MAX_COMPRESSED_VOXELS: Final = 2**28
_MAX_VOXELS_PER_BYTE: Final = 25
"""Voxels of compressed files that are read: the first number, or if that is more, the second for each byte."""

_SAME: Final = 1e-6
"""Relative difference up to which sides of a voxel count as equal: files round them to a few digits."""


class Header(NamedTuple):
    """What the text before the values says.

    Attributes
    ----------
    sizes : tuple of int
        Voxels along each axis.
    dtype : dtype
        Of the values.
    compressed : bool
        Whether the values are compressed with gzip.
    sides : ndarray of float64, shape (d, d), or None
        From a voxel to the next one along each axis, metres, a row for each axis; None if the file does not say.
    center : ndarray of float64, shape (d,), or None
        Center of the first voxel, metres.
    has_bounds : bool
        Whether it says where the grid begins or ends along its axes.
    begins : int
        Byte at which the values begin.
    """

    sizes: tuple[int, ...]
    dtype: np.dtype[Any]
    compressed: bool
    sides: Floats | None
    center: Floats | None
    has_bounds: bool
    begins: int


def read_nrrd(
    path: str | os.PathLike[str],
    spacing: float | None = None,
    lower: ArrayLike | None = None,
    threshold: float | None = None,
) -> tuple[Floats, float, Bools]:
    """Read the lower corner, the side of a cell and the occupied cells of an NRRD file.

    Arguments are those of ``Workspace.from_nrrd``.

    Raises InputError and FileError as that does.
    """
    side = None if spacing is None else positive(spacing, "spacing")
    level = None if threshold is None else finite(threshold, "threshold")
    if level is not None and level.ndim:
        raise InputError("threshold", f"is {threshold!r}", "it must be one number", "pass e.g. 0.5", value=threshold)
    content = read_bytes(path, KIND)
    with decoding(path, KIND):
        header = _header(content)
        check_cells(path, header.sizes, memory=2.0)
        _check_compressed(header, len(content))
        corner, side, order, flipped = _placement(path, header, side, lower)
        occupied, at = np.empty(math.prod(header.sizes), dtype=np.bool_), 0
        for values in _blocks(content, header):
            part = occupied[at : at + len(values)]
            at += len(values)
            if values.dtype.kind == "f" and np.isnan(values).any():
                raise Fault("holds NaN", "each voxel must have a value", "replace NaN before it is written")
            if level is not None:
                np.greater_equal(values, float(level), out=part)
                continue
            np.not_equal(values, 0, out=part)
            wrong = values[part & (values != 1)]
            if len(wrong):
                fault = f"is missing for {os.fspath(path)}, which holds {wrong[0]:g}"
                rule = "without it a voxel is 0, free, or 1, occupied"
                hint = "pass e.g. threshold=0.5: voxels of at least that value are occupied"
                raise InputError("threshold", fault, rule, hint)
    return corner, side, np.flip(occupied.reshape(header.sizes, order="F").transpose(order), flipped)


def read_nrrd_dimension(path: str | os.PathLike[str]) -> int:
    """Return the number of axes of an NRRD file, 2 or 3, from its header.

    Raises FileError as :func:`read_nrrd`.
    """
    with decoding(path, KIND), existing(path, KIND).open("rb") as file:
        return len(_header(file.read(_HEADER_BYTES)).sizes)


def _header(content: bytes) -> Header:
    """Parse the text before the values."""
    fields: dict[str, str] = {}
    begins = None
    for number, (text, after) in enumerate(header_lines(content)):
        line = text.rstrip("\r")
        if number == 0 and not re.fullmatch(r"NRRD000[1-5]", line):
            raise Fault(f"begins with {line[:20]!r}", "an NRRD file begins with NRRD0001 to NRRD0005", "pass another")
        if number and not line:
            begins = after
            break
        key, colon, value = line.partition(": ")
        if number and colon and not line.startswith("#") and ":=" not in key:
            name = key.strip().lower()
            if name in fields:
                raise Fault(f"says {name!r} twice")
            fields[name] = value.strip()
    if begins is None:
        raise Fault("has no empty line after its header")
    for name in ("data file", "datafile"):
        if name in fields:
            hint = "join the two into one .nrrd, e.g. with 'unu save' or 3D Slicer"
            raise Fault("keeps its values in another file", "an attached header is read", hint)
    for name in ("line skip", "lineskip", "byte skip", "byteskip"):
        if fields.get(name, "0") != "0":
            raise Fault(f"skips data ({name})", "values are read from the end of the header on", "write it again")
    encoding = fields.get("encoding", "").lower()
    if encoding not in ("raw", "gzip", "gz"):
        raise Fault(f"has the encoding {encoding[:20]!r}", "raw and gzip are read", "write it with encoding gzip")
    sizes = _sizes(fields)
    sides, center = _axes(fields, len(sizes))
    has_bounds = any(name in fields for name in ("axis mins", "axismins", "axis maxs", "axismaxs"))
    return Header(sizes, _dtype(fields), encoding != "raw", sides, center, has_bounds, begins)


def _sizes(fields: dict[str, str]) -> tuple[int, ...]:
    words = fields.get("sizes", "").split()
    if not words or not all(is_count(word) and int(word) > 0 for word in words):
        raise Fault(f"says sizes {fields.get('sizes', '')[:40]!r}", "they must be whole numbers above zero")
    if fields.get("dimension") != str(len(words)) or len(words) not in (2, 3):
        dimension = fields.get("dimension", "")[:20]
        rule, hint = "a grid has 2 or 3 axes, and a size for each", "drop axes of channels or time"
        raise Fault(f"says dimension {dimension!r} and has {len(words)} sizes", rule, hint)
    return tuple(map(int, words))


def _dtype(fields: dict[str, str]) -> np.dtype[Any]:
    kind = " ".join(fields.get("type", "").lower().split())
    code = next((code for code, names in _TYPES.items() if kind in names), None)
    if code is None:
        raise Fault(f"has values of type {kind[:20]!r}", "they must be whole numbers or floats", "convert them")
    endian = fields.get("endian", "little" if code.endswith("1") else "").lower()
    if endian not in _ENDIANS:
        raise Fault(f"says endian {endian[:20]!r}", "it must be little or big", "write it again")
    return np.dtype(_ENDIANS[endian] + code)


def _axes(fields: dict[str, str], dim: int) -> tuple[Floats | None, Floats | None]:
    """Return the steps between voxels, shape (d, d), and the center of the first one, metres; None if unknown."""
    units = [fields[name] for name in ("space units", "units") if name in fields]
    named = re.findall(r'"([^"]*)"', units[0]) if units else []
    if any(unit not in _METRES for unit in named) or len(set(named)) > 1:
        rule = f"one of {', '.join(_METRES)} must hold for all axes"
        raise Fault(f"has the units {', '.join(map(repr, named))[:60]}", rule, "convert it to metres")
    scale = _METRES[named[0]] if named else 1.0
    sides = center = None
    if "space directions" in fields:
        sides = scale * _vectors(fields["space directions"], "space directions", (dim, dim))
    elif "spacings" in fields:
        sides = scale * np.diag(_vectors(f"({','.join(fields['spacings'].split())})", "spacings", (1, dim))[0])
    if "space origin" in fields:
        center = scale * _vectors(fields["space origin"], "space origin", (1, dim))[0]
    return sides, center


def _vectors(text: str, name: str, shape: tuple[int, int]) -> Floats:
    """Parse vectors such as ``(1,0) (0,1)``, shape (n, d)."""
    try:
        rows = [[float(word) for word in match[1].split(",")] for match in _VECTOR.finditer(text) if match[1]]
        vectors = np.array(rows)
    except ValueError:
        vectors = np.empty(0)
    if vectors.shape != shape or not np.isfinite(vectors).all():
        what = f"{shape[0]} vector{'s' * (shape[0] > 1)} of {shape[1]} finite numbers"
        raise Fault(f"says {name} {text[:60]!r}", f"it must be {what}, one for each axis", "write it again")
    return vectors


def _placement(
    path: str | os.PathLike[str], header: Header, side: float | None, lower: ArrayLike | None
) -> tuple[Floats, float, tuple[int, ...], tuple[int, ...]]:
    """Return where the voxels lie, and how the file orders them.

    These are the lower corner, the side of a voxel, the order of the file's axes, and the axes that it counts downward.
    """
    dim, order, flipped = len(header.sizes), tuple(range(len(header.sizes))), tuple[int, ...]()
    if header.sides is not None:
        length = float(np.abs(header.sides).max())
        order = tuple(np.abs(header.sides).argmax(axis=0).tolist())
        steps = header.sides[list(order)]
        cubes = length > 0.0 and np.abs(np.abs(steps) / length - np.eye(dim)).max() <= _SAME
        if not cubes or len(set(order)) < dim:
            rule, hint = "cells must be cubes along the axes", "resample it, or pass the values as an array"
            raise Fault(f"has the steps {header.sides.tolist()} m between voxels", rule, hint)
        flipped = tuple(np.flatnonzero(np.diag(steps) < 0.0).tolist())
        side = length if side is None else side
    if side is None:
        rule, hint = "the file does not hold it", "pass e.g. spacing=0.05"
        raise InputError("spacing", f"is missing for {os.fspath(path)}", rule, hint)
    shape, corner = tuple(header.sizes[k] for k in order), np.zeros(dim)
    if lower is not None:
        corner = check_point(lower, "lower", dim)
    elif header.center is not None:
        ahead = [shape[k] - 1 if k in flipped else 0 for k in range(dim)]
        corner = header.center - side * (np.array(ahead) + 0.5)
    elif header.has_bounds:
        rule = "whether they are centers or borders of voxels, files leave open"
        raise Fault("says where it begins by axis mins or maxs", rule, "pass lower=, the lower corner, in metres")
    return corner, side, order, flipped


def _check_compressed(header: Header, size: int) -> None:
    """Refuse compressed values that take far more memory than the file is large."""
    voxels = math.prod(header.sizes)
    if header.compressed and voxels > max(_MAX_COMPRESSED_VOXELS, _MAX_VOXELS_PER_BYTE * size):
        rule = f"at most {_MAX_COMPRESSED_VOXELS:,}, or {_MAX_VOXELS_PER_BYTE} for each byte, are read"
        raise Fault(f"declares {voxels:,} compressed voxels in {size:,} bytes", rule, "write it with encoding raw")


def _blocks(content: bytes, header: Header) -> Iterator[NDArray[Any]]:
    """Yield the values in the order of the file, which must hold as many as it declares and no more."""
    stream: IO[bytes] = io.BytesIO(content)
    stream.seek(header.begins)
    if header.compressed:
        stream = gzip.GzipFile(fileobj=stream)  # type: ignore[assignment]
    left = math.prod(header.sizes) * header.dtype.itemsize
    while left:
        block = stream.read(min(left, _BLOCK_BYTES))
        if len(block) < min(left, _BLOCK_BYTES):
            raise Fault("holds fewer values than its header declares")
        left -= len(block)
        yield np.frombuffer(block, dtype=header.dtype)
    if stream.read(1):
        raise Fault("holds more values than its header declares")

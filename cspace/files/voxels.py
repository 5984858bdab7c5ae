"""Voxels from NRRD files (teem.sourceforge.net/nrrd) and OctoMaps (Hornung et al., "OctoMap", 2013).

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
from dataclasses import dataclass
from typing import IO, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Bytes, Floats, Ints, frozen
from cspace.check import check_point, finite, positive
from cspace.compiling import kernel
from cspace.errors import InputError
from cspace.files.access import Fault, decoding, existing, header_lines, is_count, read_bytes
from cspace.limits import check_cells

_NRRD: Final = "grid in NRRD"

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
    content = read_bytes(path, _NRRD)
    with decoding(path, _NRRD):
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
                problem = f"is missing for {os.fspath(path)}, which holds {wrong[0]:g}"
                rule = "without it a voxel is 0, free, or 1, occupied"
                hint = "pass e.g. threshold=0.5: voxels of at least that value are occupied"
                raise InputError("threshold", problem, rule, hint)
    return corner, side, np.flip(occupied.reshape(header.sizes, order="F").transpose(order), flipped)


def read_nrrd_dimension(path: str | os.PathLike[str]) -> int:
    """Return the number of axes of an NRRD file, 2 or 3, from its header.

    Raises FileError as :func:`read_nrrd`.
    """
    with decoding(path, _NRRD), existing(path, _NRRD).open("rb") as file:
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


_OCTOMAP: Final = "OctoMap"

_FIRST_LINES: Final = {"# Octomap OcTree binary file": True, "# Octomap OcTree file": False}
_COLOURS: Final = {"OcTree": 0, "ColorOcTree": 3}
"""Bytes of colour in a node of a full tree, by the tree's type."""

DEPTH: Final = 16
"""Levels below the root of an octree: 2^16 cells along each axis."""

_HALF: Final = 2 ** (DEPTH - 1)
"""Cell of the octree at the origin, along each axis."""


@dataclass(frozen=True, slots=True)
class _Header:
    """What the text before the nodes says."""

    binary: bool
    tree: str
    size: int
    resolution: float


def read_octomap(path: str | os.PathLike[str], unknown_is_occupied: bool = True) -> tuple[Floats, float, Bools, Bools]:
    """Read the lower corner of an OctoMap, the side of a cell, its occupied and its unknown cells.

    ``.bt`` is a binary tree, and ``.ot`` a full one, of type OcTree or ColorOcTree; the first line says which. The
    corner lies a whole number of cells from the origin; both are in metres. Coarse leaves are
    expanded to the finest cells. A leaf of a full tree is occupied from a probability of one half on, as in OctoMap;
    the file holds no other threshold. Cells without a leaf are occupied if ``unknown_is_occupied``.

    Raises FileError if the file is missing, is no OctoMap, is of another
    type, is truncated or damaged, knows no cell, or so many that they are too large (:mod:`cspace.limits`).
    """
    # A leaf of five numbers for each byte at most.
    content = read_bytes(path, _OCTOMAP, memory=80.0)
    with decoding(path, _OCTOMAP):
        header, end = _split(content)
        leaves = _leaves(header, content[end:])
    first = leaves[:, :3].min(axis=0)
    shape = (leaves[:, :3] + leaves[:, 3:4]).max(axis=0) - first
    across = tuple(int(n) for n in shape)
    check_cells(path, across, memory=2.0)
    leaves[:, :3] -= first
    unseen, occupied = np.ones(across, dtype=np.bool_), np.zeros(across, dtype=np.bool_)
    fill_leaves(unseen, np.ascontiguousarray(leaves[:, :4]), False)
    fill_leaves(occupied, np.ascontiguousarray(leaves[leaves[:, 4] == 1, :4]), True)
    if unknown_is_occupied:
        occupied |= unseen
    lower = (first - _HALF) * header.resolution
    return lower, header.resolution, frozen(occupied), frozen(unseen)


def _split(content: bytes) -> tuple[_Header, int]:
    """The header, and the byte at which the nodes begin."""
    entries: dict[str, str] = {}
    binary: bool | None = None
    for line, after in header_lines(content):
        text = line.strip()
        if binary is None:
            if text not in _FIRST_LINES:
                begins = " or ".join(map(repr, _FIRST_LINES))
                raise Fault(f"begins with {line[:40]!r}", f"an OctoMap begins with {begins}", "pass another file")
            binary = _FIRST_LINES[text]
        elif text == "data":
            return _octomap_header(entries, binary), after
        elif text and not text.startswith("#"):
            key, _, value = text.partition(" ")
            entries[key] = value.strip()
    raise Fault("has no line 'data' after its header" if content else "is empty")


def _octomap_header(entries: dict[str, str], binary: bool) -> _Header:
    """The header, checked."""
    tree, size, resolution = entries.get("id", ""), entries.get("size", ""), entries.get("res", "")
    if tree not in _COLOURS:
        raise Fault(
            f"holds a tree of type {tree!r:.60}", f"{' and '.join(_COLOURS)} are read", "convert it with OctoMap"
        )
    try:
        count, side = int(size), float(resolution)
    except ValueError:
        count, side = -1, math.nan
    if count < 0 or not 0.0 < side < math.inf:
        values = f"size {size[:40]!r} and res {resolution[:40]!r}"
        raise Fault(f"says {values}, where the number of nodes and the side of cells in metres must be")
    if count == 0:
        raise Fault("knows no cell", "a map needs some known space", "insert a scan before it is written")
    return _Header(binary, tree, count, side)


def _leaves(header: _Header, data: bytes) -> Ints:
    """First cell, side in cells, and whether occupied, of each leaf, shape (n, 5)."""
    values = np.empty(0, dtype=np.float32)
    if header.binary:
        records = np.frombuffer(data, dtype=np.uint8, count=len(data) // 2 * 2).reshape(-1, 2)
    else:
        record = np.dtype([("value", "<f4"), ("colour", "V", _COLOURS[header.tree]), ("children", "u1")])
        full = np.frombuffer(data, dtype=record, count=len(data) // record.itemsize)
        values = full["value"]
        records = np.stack([full["children"], values >= 0.0], axis=1).astype(np.uint8)
        records.setflags(write=False)  # as those of a binary tree, so that both are read by the same compiled code
    leaves = np.empty((min(header.size, 8 * len(records)), 5), dtype=np.int64)
    way = np.zeros((DEPTH + 1, 4), dtype=np.int64)
    nodes, count, problem = leaves_of(records, header.binary, leaves, way)
    broken = int(np.isnan(values[:nodes]).sum())
    if broken:
        raise Fault(f"has {broken} nodes without a value (NaN)")
    if problem == 1:
        raise Fault(f"ends after {nodes} nodes, and its header says {header.size}")
    if problem or nodes != header.size:
        reason = {2: f"an inner node below level {DEPTH}", 3: "an inner node without children"}.get(
            problem, f"{'more' if problem else nodes} nodes, where its header says {header.size}"
        )
        raise Fault(f"holds {reason}", "that is no octree of OctoMap", "the file is damaged, fetch it again")
    return leaves[:count]


@kernel
def leaves_of(records: Bytes, binary: bool, leaves: Ints, way: Ints) -> tuple[int, int, int]:
    """Leaves of an octree whose nodes are written in depth-first order: nodes met, leaves written, and a fault.

    The records, shape (n, 2), of a binary tree are one for each inner node: two bits for each of its eight children,
    where 01 is a free leaf, 10 an occupied one, 11 an inner node and 00 unknown. Those of a full tree are one for
    each node: a bit for each child, and whether the node is occupied; a node without children is a leaf. ``leaves``,
    shape (m, 5), are written: first cell, side in cells, and 1 where occupied. The fault is 0 for a whole tree; 1
    where records are missing, 2 where a node lies too deep, 3 where an inner node has no child, 4 where ``leaves`` is
    full. ``way``, zeros at first, holds for each level on the way down the first cell of a node, and the inner children
    that are still to be entered, one bit each.
    """
    # A loop and not recursion: however deep a damaged file leads, nothing is held but ``way``.
    corner, pending = way[:, :3], way[:, 3]
    nodes, count, used, depth = 1, 0, 0, 0
    entering = True
    while depth >= 0:
        if entering:
            if used == len(records):
                return nodes if binary else used, count, 1
            first, second = np.int64(records[used, 0]), np.int64(records[used, 1])
            used += 1
            children = np.int64(0)
            if binary:
                # Leaves have no record of their own: they are counted and written where their parent is met.
                kinds = first | second << 8
                if kinds == 0:
                    return nodes, count, 3
                for child in range(8):
                    kind = (kinds >> (2 * child)) & 3
                    nodes += kind != 0
                    if kind == 3:
                        children |= 1 << child
                    elif kind != 0:
                        if count == len(leaves):
                            return nodes, count, 4
                        side = 1 << (DEPTH - 1 - depth)
                        _place(leaves[count], corner[depth], child, side)
                        leaves[count, 3], leaves[count, 4] = side, kind == 2
                        count += 1
            else:
                nodes, children = used, first
                if children == 0:
                    if count == len(leaves):
                        return nodes, count, 4
                    _place(leaves[count], corner[depth], 0, 0)
                    leaves[count, 3], leaves[count, 4] = 1 << (DEPTH - depth), second
                    count += 1
            # A node of level DEPTH is a single cell: it has no children, and in a binary tree no record either.
            if children and depth == DEPTH - binary:
                return nodes, count, 2
            pending[depth] = children
        entering = pending[depth] != 0
        if entering:
            child = _lowest(pending[depth])
            pending[depth] &= pending[depth] - 1
            _place(corner[depth + 1], corner[depth], child, 1 << (DEPTH - 1 - depth))
            depth += 1
        else:
            depth -= 1
    return nodes, count, 0


@kernel
def _place(out: Ints, corner: Ints, child: int, side: int) -> None:
    """Write the first cell of a child."""
    for axis in range(3):
        out[axis] = corner[axis] + ((child >> axis) & 1) * side


@kernel
def _lowest(bits: int) -> int:
    """Number of the lowest bit that is set."""
    number = 0
    while not (bits >> number) & 1:
        number += 1
    return number


@kernel
def fill_leaves(out: Bools, leaves: Ints, value: bool) -> None:
    """Set ``out`` to ``value`` in leaves, each a cube of cells given by its first cell and its side, shape (n, 4)."""
    for n in range(len(leaves)):
        x, y, z, side = leaves[n]
        for i in range(x, x + side):
            for j in range(y, y + side):
                for k in range(z, z + side):
                    out[i, j, k] = value

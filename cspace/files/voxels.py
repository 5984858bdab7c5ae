"""Voxels from NRRD files (teem.sourceforge.net/nrrd) and OctoMaps (Hornung et al., "OctoMap", 2013).

pynrrd is not used, because it unpacks a file before it checks the declared size, so that a few megabytes can take
gigabytes. This module unpacks at most the declared size, block by block.
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
from cspace.check import check_finite, check_point, check_positive
from cspace.compiling import kernel
from cspace.errors import InputError
from cspace.files.access import ContentError, check_file, decoding, is_count, iterate_header_lines, read_bytes
from cspace.limits import check_cells

_NRRD_KIND: Final = "grid in NRRD"

_NRRD_TYPES: Final = {
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
"""Type names of NRRD by numpy type code."""

_BYTE_ORDERS: Final = {"little": "<", "big": ">"}
_METRES_PER_UNIT: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
"""Length in metres of each unit in which a file may give its spacing."""

_VECTOR_PATTERN: Final = re.compile(r"none|\(([^()]*)\)")

_MAX_NRRD_HEADER_BYTES: Final = 2**16
"""Maximum size of the header in bytes."""

_BYTES_PER_BLOCK: Final = 2**22
"""Number of bytes of values that are unpacked and compared at once."""

_MAX_COMPRESSED_VOXELS: Final = 2**28
_MAX_VOXELS_PER_BYTE: Final = 25
"""Limits on compressed files: the larger of `_MAX_COMPRESSED_VOXELS` and this number times the bytes of the file."""

_SIDE_ROUNDING: Final = 1e-6
"""Relative difference up to which two sides of a voxel count as equal, because files round to a few digits."""


class NrrdHeader(NamedTuple):
    """Content of the text before the values of an NRRD file.

    Attributes
    ----------
    sizes : tuple of int
        Number of voxels along each axis.
    dtype : dtype
        Data type of the values.
    compressed : bool
        True if the values are compressed with gzip.
    sides : ndarray of float64, shape (d, d), or None
        Step in metres to the next voxel along each axis, one row per axis; None if undeclared.
    center : ndarray of float64, shape (d,), or None
        Center of the first voxel, metres; None if undeclared.
    has_bounds : bool
        True if the header gives the minimum or maximum of the grid along its axes.
    begins : int
        Position of the first byte of the values.
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
    """Read the placement and occupied cells of an NRRD file.

    Returns the lower corner and the voxel size, in metres, and the cells.

    Parameters are as for ``Workspace.from_nrrd``.

    Raises InputError and FileError as that method does.
    """
    side = None if spacing is None else check_positive(spacing, "spacing")
    level = None if threshold is None else check_finite(threshold, "threshold")
    if level is not None and level.ndim:
        raise InputError("threshold", f"is {threshold!r}", "it must be one number", "pass e.g. 0.5", value=threshold)
    content = read_bytes(path, _NRRD_KIND)
    with decoding(path, _NRRD_KIND):
        header = _parse_nrrd_header(content)
        check_cells(path, header.sizes, memory=2.0)
        _check_compressed(header, len(content))
        corner, side, order, flipped = _find_placement(path, header, side, lower)
        occupied, at = np.empty(math.prod(header.sizes), dtype=np.bool_), 0
        for values in _iterate_blocks(content, header):
            part = occupied[at : at + len(values)]
            at += len(values)
            if values.dtype.kind == "f" and np.isnan(values).any():
                raise ContentError("holds NaN", "each voxel must have a value", "replace NaN before writing")
            if level is not None:
                np.greater_equal(values, float(level), out=part)
                continue
            np.not_equal(values, 0, out=part)
            wrong = values[part & (values != 1)]
            if len(wrong):
                problem = f"is missing for {os.fspath(path)}, which holds {wrong[0]:g}"
                rule, hint = "without it voxels must be 0 (free) or 1 (occupied)", "pass e.g. threshold=0.5"
                raise InputError("threshold", problem, rule, f"{hint}: voxels of at least that value are occupied")
    return corner, side, np.flip(occupied.reshape(header.sizes, order="F").transpose(order), flipped)


def read_nrrd_dimension(path: str | os.PathLike[str]) -> int:
    """Return the number of axes of an NRRD file.

    Raises FileError as :func:`read_nrrd`.
    """
    with decoding(path, _NRRD_KIND), check_file(path, _NRRD_KIND).open("rb") as file:
        return len(_parse_nrrd_header(file.read(_MAX_NRRD_HEADER_BYTES)).sizes)


def _parse_nrrd_header(content: bytes) -> NrrdHeader:
    """Parse the header of an NRRD file."""
    fields: dict[str, str] = {}
    begins = None
    for number, (text, after) in enumerate(iterate_header_lines(content)):
        line = text.rstrip("\r")
        if number == 0 and not re.fullmatch(r"NRRD000[1-5]", line):
            rule = "an NRRD file begins with NRRD0001 to NRRD0005"
            raise ContentError(f"begins with {line[:20]!r}", rule, "pass an NRRD file")
        if number and not line:
            begins = after
            break
        key, colon, value = line.partition(": ")
        if number and colon and not line.startswith("#") and ":=" not in key:
            name = key.strip().lower()
            if name in fields:
                raise ContentError(f"says {name!r} twice")
            fields[name] = value.strip()
    if begins is None:
        raise ContentError("has no empty line after its header")
    for name in ("data file", "datafile"):
        if name in fields:
            hint = "join both files into one .nrrd, e.g. with 'unu save' or 3D Slicer"
            raise ContentError("keeps its values in another file", "the header must be attached", hint)
    for name in ("line skip", "lineskip", "byte skip", "byteskip"):
        if fields.get(name, "0") != "0":
            rule = "values must follow the header directly"
            raise ContentError(f"skips data ({name})", rule, "write it again")
    encoding = fields.get("encoding", "").lower()
    if encoding not in ("raw", "gzip", "gz"):
        problem = f"has the encoding {encoding[:20]!r}"
        raise ContentError(problem, "only raw and gzip are read", "write it with encoding gzip")
    sizes = _parse_sizes(fields)
    sides, center = _parse_axes(fields, len(sizes))
    has_bounds = any(name in fields for name in ("axis mins", "axismins", "axis maxs", "axismaxs"))
    return NrrdHeader(sizes, _parse_dtype(fields), encoding != "raw", sides, center, has_bounds, begins)


def _parse_sizes(fields: dict[str, str]) -> tuple[int, ...]:
    """Parse the number of cells along each axis.

    Raises ContentError if they are missing or malformed.
    """
    words = fields.get("sizes", "").split()
    if not words or not all(is_count(word) and int(word) > 0 for word in words):
        raise ContentError(f"says sizes {fields.get('sizes', '')[:40]!r}", "they must be whole numbers above zero")
    if fields.get("dimension") != str(len(words)) or len(words) not in (2, 3):
        dimension = fields.get("dimension", "")[:20]
        rule, hint = "a grid has 2 or 3 axes, and a size for each", "remove axes of channels or time"
        raise ContentError(f"says dimension {dimension!r} but has {len(words)} sizes", rule, hint)
    return tuple(map(int, words))


def _parse_dtype(fields: dict[str, str]) -> np.dtype[Any]:
    """Parse the type of the values.

    Raises ContentError if it is unknown.
    """
    kind = " ".join(fields.get("type", "").lower().split())
    code = next((code for code, names in _NRRD_TYPES.items() if kind in names), None)
    if code is None:
        raise ContentError(f"has values of type {kind[:20]!r}", "they must be integers or floats", "convert them")
    endian = fields.get("endian", "little" if code.endswith("1") else "").lower()
    if endian not in _BYTE_ORDERS:
        raise ContentError(f"says endian {endian[:20]!r}", "it must be little or big", "write it again")
    return np.dtype(_BYTE_ORDERS[endian] + code)


def _parse_axes(fields: dict[str, str], dim: int) -> tuple[Floats | None, Floats | None]:
    """Return the steps between voxels and the first center, metres.

    The steps have shape (d, d); either is None if unknown.
    """
    units = [fields[name] for name in ("space units", "units") if name in fields]
    named = re.findall(r'"([^"]*)"', units[0]) if units else []
    if any(unit not in _METRES_PER_UNIT for unit in named) or len(set(named)) > 1:
        rule = f"one of {', '.join(_METRES_PER_UNIT)} must hold for all axes"
        raise ContentError(f"has the units {', '.join(map(repr, named))[:60]}", rule, "convert it to metres")
    scale = _METRES_PER_UNIT[named[0]] if named else 1.0
    sides = center = None
    if "space directions" in fields:
        sides = scale * _parse_vectors(fields["space directions"], "space directions", (dim, dim))
    elif "spacings" in fields:
        sides = scale * np.diag(_parse_vectors(f"({','.join(fields['spacings'].split())})", "spacings", (1, dim))[0])
    if "space origin" in fields:
        center = scale * _parse_vectors(fields["space origin"], "space origin", (1, dim))[0]
    return sides, center


def _parse_vectors(text: str, name: str, shape: tuple[int, int]) -> Floats:
    """Parse vectors such as ``(1,0) (0,1)``, shape (n, d)."""
    try:
        rows = [[float(word) for word in match[1].split(",")] for match in _VECTOR_PATTERN.finditer(text) if match[1]]
        vectors = np.array(rows)
    except ValueError:
        vectors = np.empty(0)
    if vectors.shape != shape or not np.isfinite(vectors).all():
        what = f"{shape[0]} vector{'s' * (shape[0] > 1)} of {shape[1]} finite numbers"
        raise ContentError(f"says {name} {text[:60]!r}", f"it must be {what}, one for each axis", "write it again")
    return vectors


def _find_placement(
    path: str | os.PathLike[str], header: NrrdHeader, side: float | None, lower: ArrayLike | None
) -> tuple[Floats, float, tuple[int, ...], tuple[int, ...]]:
    """Return the placement of voxels and the order of axes.

    Returns the lower corner, the voxel size, the order of the file's axes, and the axes to flip.

    Raises InputError if the spacing is neither given nor declared, and ContentError if the voxels are not cubes.
    """
    dim, order, flipped = len(header.sizes), tuple(range(len(header.sizes))), tuple[int, ...]()
    if header.sides is not None:
        length = float(np.abs(header.sides).max())
        order = tuple(np.abs(header.sides).argmax(axis=0).tolist())
        steps = header.sides[list(order)]
        cubes = length > 0.0 and np.abs(np.abs(steps) / length - np.eye(dim)).max() <= _SIDE_ROUNDING
        if not cubes or len(set(order)) < dim:
            rule, hint = "cells must be cubes along the axes", "resample it, or pass the values as an array"
            raise ContentError(f"has the steps {header.sides.tolist()} m between voxels", rule, hint)
        flipped = tuple(np.flatnonzero(np.diag(steps) < 0.0).tolist())
        side = length if side is None else side
    if side is None:
        rule, hint = "the file does not declare it", "pass e.g. spacing=0.05"
        raise InputError("spacing", f"is missing for {os.fspath(path)}", rule, hint)
    shape, corner = tuple(header.sizes[k] for k in order), np.zeros(dim)
    if lower is not None:
        corner = check_point(lower, "lower", dim)
    elif header.center is not None:
        ahead = [shape[k] - 1 if k in flipped else 0 for k in range(dim)]
        corner = header.center - side * (np.array(ahead) + 0.5)
    elif header.has_bounds:
        problem, hint = "gives its bounds as axis mins or maxs", "pass lower=, the lower corner, in metres"
        raise ContentError(problem, "these may be centers or edges of voxels", hint)
    return corner, side, order, flipped


def _check_compressed(header: NrrdHeader, size: int) -> None:
    """Refuse values that unpack to far more than the file."""
    voxels = math.prod(header.sizes)
    if header.compressed and voxels > max(_MAX_COMPRESSED_VOXELS, _MAX_VOXELS_PER_BYTE * size):
        problem = f"declares {voxels:,} compressed voxels in {size:,} bytes"
        rule = f"at most {_MAX_COMPRESSED_VOXELS:,}, or {_MAX_VOXELS_PER_BYTE} per byte, are read"
        raise ContentError(problem, rule, "write it with encoding raw")


def _iterate_blocks(content: bytes, header: NrrdHeader) -> Iterator[NDArray[Any]]:
    """Yield the values in blocks, in the order of the file.

    Refuses more or fewer values than declared.
    """
    stream: IO[bytes] = io.BytesIO(content)
    stream.seek(header.begins)
    if header.compressed:
        stream = gzip.GzipFile(fileobj=stream)  # type: ignore[assignment]
    left = math.prod(header.sizes) * header.dtype.itemsize
    while left:
        block = stream.read(min(left, _BYTES_PER_BLOCK))
        if len(block) < min(left, _BYTES_PER_BLOCK):
            raise ContentError("holds fewer values than its header declares")
        left -= len(block)
        yield np.frombuffer(block, dtype=header.dtype)
    if stream.read(1):
        raise ContentError("holds more values than its header declares")


_OCTOMAP_KIND: Final = "OctoMap"

_FIRST_LINES: Final = {"# Octomap OcTree binary file": True, "# Octomap OcTree file": False}
_COLOUR_BYTES: Final = {"OcTree": 0, "ColorOcTree": 3}
"""Bytes of colour in a node of a full tree, by the tree's type."""

OCTREE_LEVELS: Final = 16
"""Number of levels below the root of an octree: 2^16 cells along each axis."""

_ORIGIN_CELL: Final = 2 ** (OCTREE_LEVELS - 1)
"""Index of the octree cell at the origin, along each axis."""


@dataclass(frozen=True, slots=True)
class _OctomapHeader:
    """Content of the text before the nodes of an OctoMap."""

    binary: bool
    tree: str
    size: int
    resolution: float


def read_octomap(path: str | os.PathLike[str], unknown_is_occupied: bool = True) -> tuple[Floats, float, Bools, Bools]:
    """Read the placement, occupied and unknown cells of an OctoMap.

    Returns the lower corner and the cell size, in metres, and the cells. The first line says whether the tree is
    binary (``.bt``) or full (``.ot``, of type OcTree or ColorOcTree). The corner lies a whole number of cells from
    the origin. Coarse leaves are expanded to the finest cells. A leaf of a full tree is occupied if its probability
    is at least one half, as in OctoMap, because the file holds no other threshold. Cells without a leaf are
    occupied if `unknown_is_occupied`.

    Raises FileError if the file is missing, is not an OctoMap, has an unsupported type, is truncated or damaged, has
    no known cell, or is larger than :mod:`cspace.limits` allows.
    """
    # Each byte becomes a leaf of five 8-byte numbers at most, and a copy of it.
    content = read_bytes(path, _OCTOMAP_KIND, memory=80.0)
    with decoding(path, _OCTOMAP_KIND):
        header, end = _parse_octomap_header(content)
        leaves = _read_leaves(header, content[end:])
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
    lower = (first - _ORIGIN_CELL) * header.resolution
    return lower, header.resolution, frozen(occupied), frozen(unseen)


def _parse_octomap_header(content: bytes) -> tuple[_OctomapHeader, int]:
    """Return the header and the position of the first node."""
    entries: dict[str, str] = {}
    binary: bool | None = None
    for line, after in iterate_header_lines(content):
        text = line.strip()
        if binary is None:
            if text not in _FIRST_LINES:
                rule = f"an OctoMap begins with {' or '.join(map(repr, _FIRST_LINES))}"
                raise ContentError(f"begins with {line[:40]!r}", rule, "pass an OctoMap")
            binary = _FIRST_LINES[text]
        elif text == "data":
            return _check_octomap_header(entries, binary), after
        elif text and not text.startswith("#"):
            key, _, value = text.partition(" ")
            entries[key] = value.strip()
    raise ContentError("has no line 'data' after its header" if content else "is empty")


def _check_octomap_header(entries: dict[str, str], binary: bool) -> _OctomapHeader:
    """Check the entries of a header and convert them."""
    tree, size, resolution = entries.get("id", ""), entries.get("size", ""), entries.get("res", "")
    if tree not in _COLOUR_BYTES:
        rule = f"only {' and '.join(_COLOUR_BYTES)} are read"
        raise ContentError(f"holds a tree of type {tree!r:.60}", rule, "convert it with OctoMap")
    try:
        count, side = int(size), float(resolution)
    except ValueError:
        count, side = -1, math.nan
    if count < 0 or not 0.0 < side < math.inf:
        problem = f"says size {size[:40]!r} and res {resolution[:40]!r}"
        raise ContentError(problem, "they must be the number of nodes and the cell size in metres")
    if count == 0:
        raise ContentError("has no known cell", "a map needs some known space", "insert a scan before writing it")
    return _OctomapHeader(binary, tree, count, side)


def _read_leaves(header: _OctomapHeader, data: bytes) -> Ints:
    """Decode the leaves of an octree, shape (n, 5).

    Columns are the first cell (3), the side in cells, and 1 if occupied.
    """
    values = np.empty(0, dtype=np.float32)
    if header.binary:
        records = np.frombuffer(data, dtype=np.uint8, count=len(data) // 2 * 2).reshape(-1, 2)
    else:
        record = np.dtype([("value", "<f4"), ("colour", "V", _COLOUR_BYTES[header.tree]), ("children", "u1")])
        full = np.frombuffer(data, dtype=record, count=len(data) // record.itemsize)
        values = full["value"]
        records = np.stack([full["children"], values >= 0.0], axis=1).astype(np.uint8)
        records.setflags(write=False)  # like those of a binary tree, so that one compiled variant reads both
    leaves = np.empty((min(header.size, 8 * len(records)), 5), dtype=np.int64)
    stack = np.zeros((OCTREE_LEVELS + 1, 4), dtype=np.int64)
    nodes, count, problem = decode_leaves(records, header.binary, leaves, stack)
    broken = int(np.isnan(values[:nodes]).sum())
    if broken:
        raise ContentError(f"has {broken} nodes without a value (NaN)")
    if problem == 1:
        raise ContentError(f"ends after {nodes} nodes but its header says {header.size}")
    if problem or nodes != header.size:
        reason = {2: f"an inner node below level {OCTREE_LEVELS}", 3: "an inner node without children"}.get(
            problem, f"{'more' if problem else nodes} nodes but its header says {header.size}"
        )
        raise ContentError(f"holds {reason}", "the octree is invalid", "the file is damaged; fetch it again")
    return leaves[:count]


@kernel
def decode_leaves(records: Bytes, binary: bool, leaves: Ints, stack: Ints) -> tuple[int, int, int]:
    """Collect the leaves of an octree in depth-first order.

    Returns the numbers of nodes visited and leaves written, and an error code. `records` has shape (n, 2). A binary
    tree has one record per inner node, with two bits for each of its eight children: 01 is a free leaf, 10 an
    occupied leaf, 11 an inner node and 00 unknown. A full tree has one record per node: one bit per child, and 1 if
    the node is occupied; a node without children is a leaf.

    Writes `leaves`, shape (m, 5): first cell, side in cells, and 1 if occupied. `stack`, shape (levels + 1, 4), must be
    zeros; it holds, for each level of the current branch, the first cell of the node and a bit for each inner child
    still to be visited.

    Error codes: 0 for a valid tree, 1 if records are missing, 2 if a node lies too deep, 3 if an inner node has no
    child, 4 if `leaves` is full.
    """
    # A loop instead of recursion, so that memory is bounded by `stack` however deep a damaged file leads.
    corner, pending = stack[:, :3], stack[:, 3]
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
                # Leaves have no record of their own, so they are counted and written with their parent.
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
                        side = 1 << (OCTREE_LEVELS - 1 - depth)
                        _write_child_corner(leaves[count], corner[depth], child, side)
                        leaves[count, 3], leaves[count, 4] = side, kind == 2
                        count += 1
            else:
                nodes, children = used, first
                if children == 0:
                    if count == len(leaves):
                        return nodes, count, 4
                    _write_child_corner(leaves[count], corner[depth], 0, 0)
                    leaves[count, 3], leaves[count, 4] = 1 << (OCTREE_LEVELS - depth), second
                    count += 1
            # A node of the last level is a single cell: it has no children, and no record in a binary tree.
            if children and depth == OCTREE_LEVELS - binary:
                return nodes, count, 2
            pending[depth] = children
        entering = pending[depth] != 0
        if entering:
            child = _lowest_bit(pending[depth])
            pending[depth] &= pending[depth] - 1
            _write_child_corner(corner[depth + 1], corner[depth], child, 1 << (OCTREE_LEVELS - 1 - depth))
            depth += 1
        else:
            depth -= 1
    return nodes, count, 0


@kernel
def _write_child_corner(out: Ints, corner: Ints, child: int, side: int) -> None:
    """Write the first cell of a child into `out`."""
    for axis in range(3):
        out[axis] = corner[axis] + ((child >> axis) & 1) * side


@kernel
def _lowest_bit(bits: int) -> int:
    """Return the index of the lowest bit set."""
    number = 0
    while not (bits >> number) & 1:
        number += 1
    return number


@kernel
def fill_leaves(out: Bools, leaves: Ints, value: bool) -> None:
    """Set `out` to `value` in cubic leaves.

    `leaves` has shape (n, 4): first cell and side.
    """
    for n in range(len(leaves)):
        x, y, z, side = leaves[n]
        for i in range(x, x + side):
            for j in range(y, y + side):
                for k in range(z, z + side):
                    out[i, j, k] = value

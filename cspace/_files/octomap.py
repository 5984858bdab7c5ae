"""Voxels from OctoMaps (Hornung et al., "OctoMap", 2013)."""

from __future__ import annotations

import os
from array import array
from typing import Final, NamedTuple

import numpy as np

from cspace._files.access import ContentError, decoding, iterate_header_lines, read_bytes
from cspace._files.fields import Fields, Ledger
from cspace._support.arrays import Bools, Bytes, Floats, Ints, StrPath, frozen
from cspace._support.check import parse_finite
from cspace._support.limits import check_cells

_OCTOMAP_KIND: Final = "OctoMap"

FIELDS: Final = (
    Fields(
        "`.bt`, `.ot`",
        honoured="first line, `id`; `size`; `res`; unknown cells",
        refused="trees but OcTree and ColorOcTree; values that are NaN; a field given twice",
        warned="unknown fields of the header",
    ),
)

_FIRST_LINES: Final = {"# Octomap OcTree binary file": True, "# Octomap OcTree file": False}
_COLOUR_BYTES: Final = {"OcTree": 0, "ColorOcTree": 3}
"""Bytes of colour in a node of a full tree, by the tree's type."""

_LEVELS: Final = 16
"""Number of levels below the root of an octree."""

_SIDE: Final = 2**_LEVELS
"""Number of finest cells along each axis of an octree. The origin is in the middle."""

_OCTREE_SHAPE: Final = (_SIDE, _SIDE, _SIDE)

_BOUND_SLACK: Final = 1e-9
"""Distance from the next cell, in cells, at which a bound counts as its border."""

_CHILD_OFFSETS: Final[Ints] = np.ravel_multi_index(
    np.unravel_index(np.arange(8), (2, 2, 2), order="F"), _OCTREE_SHAPE
)
"""Flat index of each child's first cell, if children are one cell across; x varies fastest."""

_UNSEEN: Final = 2
"""State of cells without a leaf; 0 is free and 1 is occupied."""


class _OctomapHeader(NamedTuple):
    """Content of the text before the nodes of an OctoMap."""

    binary: bool
    tree: str
    size: int
    resolution: float


def read_octomap(
    path: StrPath, unknown_is_occupied: bool = True, bounds: Floats | None = None
) -> tuple[Floats, float, Bools, Bools]:
    """Read an OctoMap's placement, occupied and unknown cells.

    Returns the lower corner and the cell size, in metres, and the cells. The first line says
    whether the tree is binary (``.bt``) or full (``.ot``, of type OcTree or ColorOcTree). The
    corner lies a whole number of cells from the origin. Coarse leaves are expanded to the finest
    cells. A leaf of a full tree is occupied if its probability is at least one half, as in OctoMap,
    because the file holds no other threshold. Cells without a leaf are occupied if
    `unknown_is_occupied`. The cells cover `bounds`, shape (2, 3), or all leaves.

    Raises FileError if the file is missing, is not an OctoMap, has an unsupported type, is
    truncated or damaged, has no known cell, or is larger than :mod:`cspace._support.limits` allows.
    """
    # A byte becomes four leaves at most, of ten 8-byte numbers with their intermediate results:
    # 320 bytes.
    content = read_bytes(path, _OCTOMAP_KIND, memory=320.0)
    with decoding(path, _OCTOMAP_KIND):
        entries, binary, end = _parse_octomap_header(content)
        header = _check_octomap_header(entries, binary, end < len(content))
        leaves = _read_leaves(header, content[end:])
    entries.close(os.fspath(path))
    # Cells count from the origin, which is in the middle of the octree.
    corners = leaves.corners - _SIDE // 2
    first = corners.min(axis=0)
    last = (corners + leaves.sides[:, None]).max(axis=0)
    if bounds is not None:
        lower, upper = bounds / header.resolution
        first = np.floor(lower + _BOUND_SLACK)
        last = np.maximum(np.ceil(upper - _BOUND_SLACK), first + 1.0)
    shape = tuple(map(int, last - first))
    check_cells(path, shape, memory=3.0)  # the states and two masks
    states = np.full(shape, _UNSEEN, dtype=np.uint8)
    _fill_leaves(states, leaves._replace(corners=corners - first))
    unseen = states == _UNSEEN
    occupied = states == 1  # as _fill_leaves writes it
    if unknown_is_occupied:
        occupied |= unseen
    return first * header.resolution, header.resolution, frozen(occupied), frozen(unseen)


def _parse_octomap_header(content: bytes) -> tuple[Ledger, bool, int]:
    """Return the header, whether it is binary, and its length."""
    entries: dict[str, str | float] = {}
    binary: bool | None = None
    for line, after in iterate_header_lines(content):
        text = line.strip()
        if binary is None:
            if text not in _FIRST_LINES:
                rule = f"an OctoMap begins with {' or '.join(map(repr, _FIRST_LINES))}"
                raise ContentError(f"begins with {line[:40]!r}", rule)
            binary = _FIRST_LINES[text]
        elif text == "data":
            return Ledger(entries, "header", FIELDS[0]), binary, after
        elif text and not text.startswith("#"):
            key, _, value = text.partition(" ")
            if key in entries:
                raise ContentError(f"has {key} twice", "a header has it once")
            numbers = parse_finite(value)
            entries[key] = numbers[0] if numbers else value.strip()
    raise ContentError("has no line 'data' after its header" if content else "is empty")


def _check_octomap_header(header: Ledger, binary: bool, has_nodes: bool) -> _OctomapHeader:
    """Check and convert the entries of a header."""
    header.need("id")
    rule = f"only {' and '.join(_COLOUR_BYTES)} are read"
    header.refuse("id", *_COLOUR_BYTES, rule=rule)
    count = header.count("size")
    # Smallest side of a cell, metres.
    side = header.number("res", lowest=1e-12)
    if count == 0 and not has_nodes:
        raise ContentError("has no known cell", "a map needs some known space")
    return _OctomapHeader(binary, header.get("id"), count, side)


_FREE_LEAF: Final = 1
_OCCUPIED_LEAF: Final = 2
_INNER_NODE: Final = 3
"""Kinds of nodes of a binary octree; 0 is unknown."""


class _Leaves(NamedTuple):
    """Leaves of an octree.

    Attributes
    ----------
    corners : ndarray of int, shape (n, 3)
        First cell of each leaf.
    sides : ndarray of int, shape (n,)
        Side of each leaf, in cells.
    occupied : ndarray of bool, shape (n,)
    """

    corners: Ints
    sides: Ints
    occupied: Bools


def _read_leaves(header: _OctomapHeader, data: bytes) -> _Leaves:
    """Decode the leaves of an octree.

    Raises ContentError if it is truncated, invalid, or has another size than its header.
    """
    if header.binary:
        leaves, nodes = _decode_binary(data)
    else:
        leaves, nodes = _decode_full(data, _COLOUR_BYTES[header.tree])
    if nodes != header.size:
        rule = "both must agree, so that no part of it is lost"
        raise ContentError(f"holds {nodes} nodes but its header says {header.size}", rule)
    return leaves


def _decode_binary(data: bytes) -> tuple[_Leaves, int]:
    """Decode the leaves of a binary octree, and count its nodes.

    It has one record per inner node, with two bits for each of its eight children: 01 is a free
    leaf, 10 an occupied leaf, 11 an inner node, and 00 unknown.
    """
    # Kinds of the children of each record, shape (records, 8).
    records = np.frombuffer(data, dtype="<u2", count=len(data) // 2)
    first_bits = np.arange(0, 16, 2, dtype=np.uint16)
    kinds = (records[:, None] >> first_bits & 0b11).astype(np.uint8)
    inner_masks = np.packbits(kinds == _INNER_NODE, axis=1, bitorder="little")
    firsts, sides = _place_nodes(inner_masks, 2)
    kinds = kinds[: len(firsts)]
    if not kinds.any(axis=1).all():
        raise ContentError("holds an inner node without children")
    is_leaf = (kinds == _FREE_LEAF) | (kinds == _OCCUPIED_LEAF)
    # A leaf has half the side of its parent.
    parents, children = np.nonzero(is_leaf)
    leaf_sides = sides[parents] // 2
    corners = _unravel(firsts[parents] + leaf_sides * _CHILD_OFFSETS[children])
    leaves = _Leaves(corners, leaf_sides, kinds[is_leaf] == _OCCUPIED_LEAF)
    below_root = int(np.count_nonzero(kinds))
    return leaves, 1 + below_root


def _decode_full(data: bytes, colour_bytes: int) -> tuple[_Leaves, int]:
    """Return the leaves and the number of nodes of a full tree.

    It has one record per node: its value, its colour, and a bit for each child. A node without
    children is a leaf.
    """
    record = np.dtype([("value", "<f4"), ("colour", "V", colour_bytes), ("children", "u1")])
    nodes = np.frombuffer(data, dtype=record, count=len(data) // record.itemsize)
    firsts, sides = _place_nodes(nodes["children"], 1)
    nodes = nodes[: len(firsts)]
    broken = np.count_nonzero(np.isnan(nodes["value"]))
    if broken:
        raise ContentError(f"has {broken} nodes without a value (NaN)")
    is_leaf = nodes["children"] == 0
    corners = _unravel(firsts[is_leaf])
    return _Leaves(corners, sides[is_leaf], nodes["value"][is_leaf] >= 0.0), len(nodes)


def _place_nodes(masks: Bytes, smallest: int) -> tuple[Ints, Ints]:
    """Return the first cell and the side of each recorded node.

    Records are in depth-first order; `masks` has a bit for each child with a record. A node of
    `smallest` cells across has no such child.

    Raises ContentError if a node lies too deep or records are missing.
    """
    # For each mask of eight children, the offsets of the children, in cells of half a side.
    every_mask = np.arange(2**8, dtype=np.uint8)[:, None]
    has_child = np.unpackbits(every_mask, axis=1, bitorder="little") == 1
    # The last pending node is the next one, so children are appended in reverse.
    offsets_by_mask = [_CHILD_OFFSETS[children][::-1].tolist() for children in has_child]
    firsts = array("q")
    sides = array("q")
    pending = [(0, _SIDE)]
    for mask in masks.tobytes():
        if not pending:
            break
        first, side = pending.pop()
        firsts.append(first)
        sides.append(side)
        if mask and side == smallest:
            raise ContentError(f"holds an inner node below level {_LEVELS}")
        half = side // 2
        pending += [(first + half * offset, half) for offset in offsets_by_mask[mask]]
    if pending:
        raise ContentError(f"ends after {len(masks)} records, within its octree")
    return np.array(firsts), np.array(sides)


def _unravel(firsts: Ints) -> Ints:
    """Return the cells of flat indices, shape (n, 3)."""
    return np.stack(np.unravel_index(firsts, _OCTREE_SHAPE), axis=1)


def _fill_leaves(states: Bytes, leaves: _Leaves) -> None:
    """Set the cells in leaves to 1 if occupied, otherwise 0.

    Parts of leaves outside the array are skipped.
    """
    lows = np.clip(leaves.corners, 0, states.shape).astype(np.int64)
    highs = np.clip(leaves.corners + leaves.sides[:, None], 0, states.shape).astype(np.int64)
    sides = highs - lows
    is_cell = (sides == 1).all(axis=1)
    states[tuple(lows[is_cell].T)] = leaves.occupied[is_cell]
    is_coarse = (sides > 0).all(axis=1) & ~is_cell
    columns = (column[is_coarse].tolist() for column in (lows, highs, leaves.occupied))
    for low, high, occupied in zip(*columns, strict=True):
        states[tuple(map(slice, low, high))] = occupied

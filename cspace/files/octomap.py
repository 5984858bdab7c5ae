"""Voxels from OctoMaps (Hornung et al., "OctoMap", 2013)."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.files.access import ContentError, decoding, iterate_header_lines, read_bytes
from cspace.limits import check_cells
from cspace.support.arrays import Bools, Bytes, Floats, Ints, frozen
from cspace.support.compiling import kernel

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


def read_octomap(
    path: str | os.PathLike[str], unknown_is_occupied: bool = True
) -> tuple[Floats, float, Bools, Bools]:
    """Read the placement, occupied and unknown cells of an OctoMap.

    Returns the lower corner and the cell size, in metres, and the cells. The first line says
    whether the tree is binary (``.bt``) or full (``.ot``, of type OcTree or ColorOcTree). The
    corner lies a whole number of cells from the origin. Coarse leaves are expanded to the finest
    cells. A leaf of a full tree is occupied if its probability is at least one half, as in OctoMap,
    because the file holds no other threshold. Cells without a leaf are occupied if
    `unknown_is_occupied`.

    Raises FileError if the file is missing, is not an OctoMap, has an unsupported type, is
    truncated or damaged, has no known cell, or is larger than :mod:`cspace.limits` allows.
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
    fill_leaves(unseen, leaves[:, :4], False)
    fill_leaves(occupied, leaves[leaves[:, 4] == 1, :4], True)
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
        raise ContentError(
            "has no known cell", "a map needs some known space", "insert a scan before writing it"
        )
    return _OctomapHeader(binary, tree, count, side)


def _read_leaves(header: _OctomapHeader, data: bytes) -> Ints:
    """Decode the leaves of an octree, shape (n, 5).

    Columns are the first cell (3), the side in cells, and 1 if occupied.
    """
    values = np.empty(0, dtype=np.float32)
    if header.binary:
        records = np.frombuffer(data, dtype=np.uint8, count=len(data) // 2 * 2).reshape(-1, 2)
    else:
        record = np.dtype(
            [("value", "<f4"), ("colour", "V", _COLOUR_BYTES[header.tree]), ("children", "u1")]
        )
        full = np.frombuffer(data, dtype=record, count=len(data) // record.itemsize)
        values = full["value"]
        records = np.stack([full["children"], values >= 0.0], axis=1).astype(np.uint8)
        records.setflags(
            write=False
        )  # like those of a binary tree, so that one compiled variant reads both
    leaves = np.empty((min(header.size, 8 * len(records)), 5), dtype=np.int64)
    stack = np.zeros((OCTREE_LEVELS + 1, 4), dtype=np.int64)
    nodes, count, problem = decode_leaves(records, header.binary, leaves, stack)
    broken = int(np.isnan(values[:nodes]).sum())
    if broken:
        raise ContentError(f"has {broken} nodes without a value (NaN)")
    if problem == 1:
        raise ContentError(f"ends after {nodes} nodes but its header says {header.size}")
    if problem or nodes != header.size:
        reason = {
            2: f"an inner node below level {OCTREE_LEVELS}",
            3: "an inner node without children",
        }.get(problem, f"{'more' if problem else nodes} nodes but its header says {header.size}")
        raise ContentError(
            f"holds {reason}", "the octree is invalid", "the file is damaged; fetch it again"
        )
    return leaves[:count]


@kernel
def decode_leaves(records: Bytes, binary: bool, leaves: Ints, stack: Ints) -> tuple[int, int, int]:
    """Collect the leaves of an octree in depth-first order.

    Returns the numbers of nodes visited and leaves written, and an error code. `records` has shape
    (n, 2). A binary tree has one record per inner node, with two bits for each of its eight
    children: 01 is a free leaf, 10 an occupied leaf, 11 an inner node and 00 unknown. A full tree
    has one record per node: one bit per child, and 1 if the node is occupied; a node without
    children is a leaf.

    Writes `leaves`, shape (m, 5): first cell, side in cells, and 1 if occupied. `stack`, shape
    (levels + 1, 4), must be zeros; it holds, for each level of the current branch, the first cell
    of the node and a bit for each inner child still to be visited.

    Error codes: 0 for a valid tree, 1 if records are missing, 2 if a node lies too deep, 3 if an
    inner node has no child, 4 if `leaves` is full.
    """
    # A loop instead of recursion, so that memory is bounded by `stack` however deep a damaged file
    # leads.
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
                # Leaves have no record of their own, so they are counted and written with their
                # parent.
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
            # A node of the last level is a single cell: it has no children, and no record in a
            # binary tree.
            if children and depth == OCTREE_LEVELS - binary:
                return nodes, count, 2
            pending[depth] = children
        entering = pending[depth] != 0
        if entering:
            child = _lowest_bit(pending[depth])
            pending[depth] &= pending[depth] - 1
            _write_child_corner(
                corner[depth + 1], corner[depth], child, 1 << (OCTREE_LEVELS - 1 - depth)
            )
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


def fill_leaves(out: Bools, leaves: Ints, value: bool) -> None:
    """Set `out` to `value` in cubic leaves.

    `leaves` has shape (n, 4): first cell and side.
    """
    is_cell = leaves[:, 3] == 1
    out[tuple(leaves[is_cell, :3].T)] = value
    for x, y, z, side in leaves[~is_cell].tolist():
        out[x : x + side, y : y + side, z : z + side] = value

"""Voxels from OctoMaps (Hornung et al., "OctoMap", 2013)."""

from __future__ import annotations

import math
import os
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints, frozen
from cspace.compiling import kernel
from cspace.files.access import ContentError, decoding, iterate_header_lines, read_bytes
from cspace.limits import check_cells

_OCTOMAP_KIND: Final = "OctoMap"

_FIRST_LINE: Final = "# Octomap OcTree binary file"

_TREE_TYPES: Final = ("OcTree", "ColorOcTree")

OCTREE_LEVELS: Final = 16
"""Number of levels below the root of an octree: 2^16 cells along each axis."""

_ORIGIN_CELL: Final = 2 ** (OCTREE_LEVELS - 1)
"""Index of the octree cell at the origin, along each axis."""


def read_octomap(
    path: str | os.PathLike[str], unknown_is_occupied: bool = True
) -> tuple[Floats, float, Bools, Bools]:
    """Read the placement, occupied and unknown cells of an OctoMap.

    Returns the lower corner and the cell size, in metres, and the cells. The file holds a binary
    tree (``.bt``). The corner lies a whole number of cells from the origin. Coarse leaves are
    expanded to the finest cells. Cells without a leaf are occupied if `unknown_is_occupied`.

    Raises FileError if the file is missing, is not an OctoMap, has an unsupported type, is
    truncated or damaged, has no known cell, or is larger than :mod:`cspace.limits` allows.
    """
    # Each byte becomes a leaf of five 8-byte numbers at most, and a copy of it.
    content = read_bytes(path, _OCTOMAP_KIND, memory=80.0)
    with decoding(path, _OCTOMAP_KIND):
        size, resolution, end = _parse_octomap_header(content)
        leaves = _read_leaves(size, content[end:])
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
    lower = (first - _ORIGIN_CELL) * resolution
    return lower, resolution, frozen(occupied), frozen(unseen)


def _parse_octomap_header(content: bytes) -> tuple[int, float, int]:
    """Return the number of nodes, the cell size in metres, and the position of the first node."""
    lines = iterate_header_lines(content)
    first, _ = next(lines, ("", 0))
    if first.strip() != _FIRST_LINE:
        rule = f"an OctoMap .bt begins with {_FIRST_LINE!r}"
        raise ContentError(f"begins with {first[:40]!r}", rule, "pass a binary OctoMap")
    entries: dict[str, str] = {}
    for line, after in lines:
        key, _, value = line.strip().partition(" ")
        if key == "data":
            return *_check_octomap_header(entries), after
        entries[key] = value.strip()
    raise ContentError("has no line 'data' after its header")


def _check_octomap_header(entries: dict[str, str]) -> tuple[int, float]:
    """Return the number of nodes and the cell size of a header."""
    tree, size, resolution = entries.get("id", ""), entries.get("size", ""), entries.get("res", "")
    if tree not in _TREE_TYPES:
        rule = f"only {' and '.join(_TREE_TYPES)} are read"
        raise ContentError(f"holds a tree of type {tree!r:.60}", rule, "convert it with OctoMap")
    try:
        count, side = int(size), float(resolution)
    except ValueError:
        count, side = -1, math.nan
    if count < 0 or not 0.0 < side < math.inf:
        problem = f"says size {size[:40]!r} and res {resolution[:40]!r}"
        raise ContentError(problem, "they must be the number of nodes and the cell size in metres")
    if count == 0:
        rule, hint = "a map needs some known space", "insert a scan before writing it"
        raise ContentError("has no known cell", rule, hint)
    return count, side


def _read_leaves(size: int, data: bytes) -> Ints:
    """Decode the leaves of an octree, shape (n, 5).

    Columns are the first cell (3), the side in cells, and 1 if occupied.
    """
    records = np.frombuffer(data, dtype="<u2", count=len(data) // 2)
    leaves = np.empty((min(size, 8 * len(records)), 5), dtype=np.int64)
    stack = np.zeros((OCTREE_LEVELS, 4), dtype=np.int64)
    nodes, count, problem = decode_leaves(records, leaves, stack)
    if problem == 1:
        raise ContentError(f"ends after {nodes} nodes but its header says {size}")
    reasons = {
        2: f"an inner node below level {OCTREE_LEVELS}",
        3: "an inner node without children",
        4: f"more nodes but its header says {size}",
    }
    if problem == 0 and nodes != size:
        reasons[0] = f"{nodes} nodes but its header says {size}"
    if problem in reasons:
        hint = "the file is damaged; fetch it again"
        raise ContentError(f"holds {reasons[problem]}", "the octree is invalid", hint)
    return leaves[:count]


@kernel
def decode_leaves(records: NDArray[np.uint16], leaves: Ints, stack: Ints) -> tuple[int, int, int]:
    """Collect the leaves of an octree in depth-first order.

    Returns the numbers of nodes visited and leaves written, and an error code. `records`, shape
    (n,), has one record per inner node, with two bits for each of its eight children: 1 is a free
    leaf, 2 an occupied leaf, 3 an inner node and 0 unknown.

    Writes `leaves`, shape (m, 5): first cell, side in cells, and 1 if occupied. `stack`, shape
    (levels, 4), must be zeros; it holds, for each level of the current branch, the first cell of
    the node and a bit for each inner child still to be visited.

    Error codes: 0 for a valid tree, 1 if records are missing, 2 if a node lies too deep, 3 if an
    inner node has no child, 4 if `leaves` is full.
    """
    # A loop instead of recursion, so that memory is bounded by `stack` however deep a damaged file
    # leads.
    corner, pending = stack[:, :3], stack[:, 3]
    nodes, count, used, depth = 1, 0, 0, 0
    entering = True
    while depth >= 0:
        side = 1 << (OCTREE_LEVELS - 1 - depth)
        if entering:
            if used == len(records):
                return nodes, count, 1
            kinds = np.int64(records[used])
            used += 1
            if kinds == 0:
                return nodes, count, 3
            for child in range(8):
                kind = (kinds >> (2 * child)) & 3
                nodes += kind != 0
                if kind == 3:
                    # A node of the last level is a single cell and has no children.
                    if depth == OCTREE_LEVELS - 1:
                        return nodes, count, 2
                    pending[depth] |= 1 << child
                elif kind != 0:
                    if count == len(leaves):
                        return nodes, count, 4
                    _write_child_corner(leaves[count], corner[depth], child, side)
                    leaves[count, 3], leaves[count, 4] = side, kind == 2
                    count += 1
        entering = pending[depth] != 0
        if entering:
            child = _lowest_bit(pending[depth])
            pending[depth] &= pending[depth] - 1
            _write_child_corner(corner[depth + 1], corner[depth], child, side)
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

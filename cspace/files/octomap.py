"""OctoMaps (Hornung et al., "OctoMap", 2013): octrees of occupied and free space, ``.bt`` and ``.ot``."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.arrays import Bools, Bytes, Floats, Ints, frozen
from cspace.compiling import kernel
from cspace.files.access import Fault, decoding, header_lines, read_bytes
from cspace.limits import check_cells

KIND: Final = "OctoMap"

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
    content = read_bytes(path, KIND, memory=80.0)
    with decoding(path, KIND):
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
            return _header(entries, binary), after
        elif text and not text.startswith("#"):
            key, _, value = text.partition(" ")
            entries[key] = value.strip()
    raise Fault("has no line 'data' after its header" if content else "is empty")


def _header(entries: dict[str, str], binary: bool) -> _Header:
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
    nodes, count, fault = leaves_of(records, header.binary, leaves, way)
    broken = int(np.isnan(values[:nodes]).sum())
    if broken:
        raise Fault(f"has {broken} nodes without a value (NaN)")
    if fault == 1:
        raise Fault(f"ends after {nodes} nodes, and its header says {header.size}")
    if fault or nodes != header.size:
        reason = {2: f"an inner node below level {DEPTH}", 3: "an inner node without children"}.get(
            fault, f"{'more' if fault else nodes} nodes, where its header says {header.size}"
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

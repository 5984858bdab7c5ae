"""Compiled walks through the octrees of OctoMap, one pass over their bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

DEPTH = 16
"""Levels below the root of an octree: 2^16 cells along each axis."""


@jit
def leaves_of(records: Bytes, binary: bool, leaves: Ints) -> tuple[int, int, int]:
    """Leaves of an octree whose nodes are written in depth-first order.

    Parameters
    ----------
    records : ndarray of uint8, shape (n, 2)
        Of a binary tree, one for each inner node: two bits for each of its eight children, where 01 is a free leaf, 10
        an occupied one, 11 an inner node and 00 unknown. Of a full tree, one for each node: a bit for each child, and
        whether the node is occupied; a node without children is a leaf.
    binary : bool
    leaves : ndarray of int64, shape (m, 5)
        Written: first cell, side in cells, and 1 where occupied.

    Returns
    -------
    nodes, count, fault : int
        Nodes met, leaves written, and 0 for a whole tree; 1 where records are missing, 2 where a node lies too deep, 3
        where an inner node has no child, 4 where ``leaves`` is full.
    """
    corner = np.zeros((DEPTH + 1, 3), dtype=np.int64)
    # For each level on the way down, the inner children that are still to be entered, one bit each.
    pending = np.zeros(DEPTH + 1, dtype=np.int64)
    nodes, count, used, depth = 1, 0, 0, 0
    entering = True
    while depth >= 0:
        if entering:
            if used == len(records):
                return nodes if binary else used, count, 1
            first, second = np.int64(records[used, 0]), np.int64(records[used, 1])
            used += 1
            inner = np.int64(0)
            if binary:
                kinds = first | second << 8
                if kinds == 0:
                    return nodes, count, 3
                for child in range(8):
                    kind = (kinds >> (2 * child)) & 3
                    nodes += kind != 0
                    if kind == 3:
                        inner |= 1 << child
                    elif kind != 0:
                        if count == len(leaves):
                            return nodes, count, 4
                        side = 1 << (DEPTH - 1 - depth)
                        _place(leaves[count], corner[depth], child, side)
                        leaves[count, 3], leaves[count, 4] = side, kind == 2
                        count += 1
            else:
                nodes, inner = used, first
                if inner == 0:
                    if count == len(leaves):
                        return nodes, count, 4
                    _place(leaves[count], corner[depth], 0, 0)
                    leaves[count, 3], leaves[count, 4] = 1 << (DEPTH - depth), second
                    count += 1
            if inner and depth == DEPTH - binary:
                return nodes, count, 2
            pending[depth] = inner
        entering = pending[depth] != 0
        if entering:
            child = _lowest(pending[depth])
            pending[depth] &= pending[depth] - 1
            _place(corner[depth + 1], corner[depth], child, 1 << (DEPTH - 1 - depth))
            depth += 1
        else:
            depth -= 1
    return nodes, count, 0


@jit
def _place(out: Ints, corner: Ints, child: int, side: int) -> None:
    """Write the first cell of a child."""
    for axis in range(3):
        out[axis] = corner[axis] + ((child >> axis) & 1) * side


@jit
def _lowest(bits: int) -> int:
    """Number of the lowest bit that is set."""
    number = 0
    while not (bits >> number) & 1:
        number += 1
    return number


@jit
def paint_cubes(out: Bools, cubes: Ints, value: bool) -> None:
    """Set ``out`` to ``value`` in cubes of cells, each given by its first cell and its side, shape (n, 4)."""
    for n in range(len(cubes)):
        x, y, z, side = cubes[n]
        for i in range(x, x + side):
            for j in range(y, y + side):
                for k in range(z, z + side):
                    out[i, j, k] = value

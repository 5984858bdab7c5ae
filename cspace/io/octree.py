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
def leaves_of_binary(records: Bytes, leaves: Ints) -> tuple[int, int, int]:
    """Leaves of an octree whose inner nodes, in depth-first order, are two bits for each of the eight children.

    01 is a free leaf, 10 an occupied one, 11 an inner node, which has a record of its own; 00 is unknown.

    Parameters
    ----------
    records : ndarray of uint8, shape (n, 2)
    leaves : ndarray of int64, shape (m, 5)
        Written: first cell, side in cells, and 1 where occupied.

    Returns
    -------
    nodes, count, fault : int
        Nodes met, leaves written, and 0 for a whole tree; 1 where records are missing, 2 where an inner node lies too
        deep, 3 where one has no child, 4 where ``leaves`` is full.
    """
    corner = np.zeros((DEPTH + 1, 3), dtype=np.int64)
    pending = np.zeros(DEPTH + 1, dtype=np.int64)
    nodes, count, used, depth = 1, 0, 0, 0
    entering = True
    while depth >= 0:
        if entering:
            if used == len(records):
                return nodes, count, 1
            bits = np.int64(records[used, 0]) | np.int64(records[used, 1]) << 8
            used += 1
            if bits == 0:
                return nodes, count, 3
            side = 1 << (DEPTH - 1 - depth)
            inner = 0
            for child in range(8):
                kind = (bits >> (2 * child)) & 3
                if kind == 0:
                    continue
                nodes += 1
                if kind == 3:
                    inner |= 1 << child
                    continue
                if count == len(leaves):
                    return nodes, count, 4
                for axis in range(3):
                    leaves[count, axis] = corner[depth, axis] + ((child >> axis) & 1) * side
                leaves[count, 3] = side
                leaves[count, 4] = kind == 2
                count += 1
            if inner and side == 1:
                return nodes, count, 2
            pending[depth] = inner
        entering = False
        if pending[depth] == 0:
            depth -= 1
            continue
        child = _lowest(pending[depth])
        pending[depth] &= pending[depth] - 1
        side = 1 << (DEPTH - 1 - depth)
        for axis in range(3):
            corner[depth + 1, axis] = corner[depth, axis] + ((child >> axis) & 1) * side
        depth += 1
        entering = True
    return nodes, count, 0


@jit
def leaves_of_full(children: Bytes, occupied: Bools, leaves: Ints) -> tuple[int, int, int]:
    """Leaves of an octree whose nodes, in depth-first order, each name their children by one bit.

    Parameters
    ----------
    children : ndarray of uint8, shape (n,)
        Zero for a leaf.
    occupied : ndarray of bool, shape (n,)
    leaves : ndarray of int64, shape (m, 5)
        Written: first cell, side in cells, and 1 where occupied.

    Returns
    -------
    nodes, count, fault : int
        As for :func:`leaves_of_binary`.
    """
    corner = np.zeros((DEPTH + 1, 3), dtype=np.int64)
    pending = np.zeros(DEPTH + 1, dtype=np.int64)
    nodes, count, depth = 0, 0, 0
    entering = True
    while depth >= 0:
        if entering:
            if nodes == len(children):
                return nodes, count, 1
            pending[depth] = children[nodes]
            if pending[depth] == 0:
                if count == len(leaves):
                    return nodes, count, 4
                leaves[count, :3] = corner[depth]
                leaves[count, 3] = 1 << (DEPTH - depth)
                leaves[count, 4] = occupied[nodes]
                count += 1
            elif depth == DEPTH:
                return nodes, count, 2
            nodes += 1
        entering = False
        if pending[depth] == 0:
            depth -= 1
            continue
        child = _lowest(pending[depth])
        pending[depth] &= pending[depth] - 1
        side = 1 << (DEPTH - 1 - depth)
        for axis in range(3):
            corner[depth + 1, axis] = corner[depth, axis] + ((child >> axis) & 1) * side
        depth += 1
        entering = True
    return nodes, count, 0


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

"""Compiled search from cube to cube of FREE cells. Cells are ``(i, j, k)``; a map in the plane is one layer."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.states import FREE

States = NDArray[np.uint8]
Ints = NDArray[np.int64]

UNSEEN, QUEUED, DONE = 0, 1, 2

GREED = 8.0
"""Weight of the distance to the goal against the way that was come: above 1 a search is quicker and its path longer."""

LISTS = 40.0
"""Lists for every cell of the map's diagonal; what costs more than they hold waits in the last one."""


@njit(cache=True, nogil=True)
def _is_run_free(state: States, i: int, j: int, first: int, last: int, step: int) -> bool:
    # numba compiles no all() of a generator.
    for k in range(first, last + 1, step):  # noqa: SIM110
        if state[i, j, k] != FREE:
            return False
    return True


@njit(cache=True, nogil=True)
def _is_shell_free(state: States, i: int, j: int, k: int, r: int, flat: bool) -> bool:
    """Whether the cells at a distance of exactly r along some axis, and at most r along the others, are FREE."""
    nx, ny, nz = state.shape
    rz = 0 if flat else r
    if i < r or j < r or k < rz or i + r >= nx or j + r >= ny or k + rz >= nz:
        return False
    for a in range(i - r, i + r + 1):
        for b in range(j - r, j + r + 1):
            whole = flat or abs(a - i) == r or abs(b - j) == r
            if flat and abs(a - i) < r and abs(b - j) < r:
                continue
            if not _is_run_free(state, a, b, k - rz, k + rz, 1 if whole else 2 * r):
                return False
    return True


@njit(cache=True, nogil=True)
def free_radius(state: States, i: int, j: int, k: int, most: int, flat: bool) -> int:
    """Largest r, at most ``most``, for which all cells within r of a FREE cell along each axis are FREE."""
    r = 0
    while r < most and _is_shell_free(state, i, j, k, r + 1, flat):
        r += 1
    return r


@njit(cache=True, nogil=True)
def trace_cubes(state: States, start: Ints, goal: Ints, most: int, flat: bool) -> Ints:
    """Middles of cubes of FREE cells, each in the cube before it, from a cell to one whose cube holds another cell.

    Cells wait by the length of the way to them, from middle to middle, and :data:`GREED` times the distance to the
    goal; all that is joined to the start is looked at before the search gives up.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny, nz)
    start, goal : ndarray of int64, shape (3,)
        FREE cells.
    most : int
        Largest distance, in cells, from the middle of a cube to its sides.
    flat : bool
        Whether the map is one layer of cells, and its cubes are squares.

    Returns
    -------
    ndarray of int64, shape (n, 3)
        Of length 0 where there is no such path.
    """
    nx, ny, nz = state.shape
    seen = np.zeros(state.shape, np.uint8)
    # What waits, in lists by its rounded cost; a list that is not empty has its first entry in ``heads``.
    heads = np.full(int(LISTS * math.sqrt(float(nx * nx + ny * ny + nz * nz))) + 8, -1, np.int64)
    size, room = 0, 1024
    after, cell, parent = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64)
    nodes, came, far = np.empty((256, 3), np.int64), np.empty(256, np.int64), np.empty(256)
    count, lowest = 0, 0
    after[0], cell[0], parent[0] = -1, (start[0] * ny + start[1]) * nz + start[2], -1
    size, heads[0] = 1, 0
    while lowest < len(heads):
        entry = heads[lowest]
        if entry < 0:
            lowest += 1
            continue
        heads[lowest] = after[entry]
        k = cell[entry] % nz
        j = cell[entry] // nz % ny
        i = cell[entry] // nz // ny
        if seen[i, j, k] == DONE:
            continue
        if count == len(came):
            nodes = np.concatenate((nodes, np.empty_like(nodes)))
            came, far = np.concatenate((came, np.empty_like(came))), np.concatenate((far, np.empty_like(far)))
        node, before = count, parent[entry]
        count += 1
        nodes[node, 0], nodes[node, 1], nodes[node, 2] = i, j, k
        came[node], far[node] = before, 0.0
        if before >= 0:
            u, v, w = i - nodes[before, 0], j - nodes[before, 1], k - nodes[before, 2]
            far[node] = far[before] + math.sqrt(float(u * u + v * v + w * w))
        r = free_radius(state, i, j, k, most, flat)
        if max(abs(goal[0] - i), abs(goal[1] - j), abs(goal[2] - k)) <= r:
            length = 0
            step = node
            while step >= 0:
                length, step = length + 1, came[step]
            path = np.empty((length, 3), np.int64)
            step = node
            while step >= 0:
                length -= 1
                path[length] = nodes[step]
                step = came[step]
            return path
        # Inside the cube nothing is left to be found; on its sides, or beside a lone cell, the search goes on.
        reach = max(r, 1)
        rz = 0 if flat else reach
        for a in range(max(i - reach, 0), min(i + reach, nx - 1) + 1):
            for b in range(max(j - reach, 0), min(j + reach, ny - 1) + 1):
                for c in range(max(k - rz, 0), min(k + rz, nz - 1) + 1):
                    if seen[a, b, c] == DONE:
                        continue
                    u, v, w = abs(a - i), abs(b - j), abs(c - k)
                    if max(u, v, w) < r or u + v + w == 0:
                        seen[a, b, c] = DONE
                        continue
                    if seen[a, b, c] != UNSEEN or (r == 0 and (u + v + w != 1 or state[a, b, c] != FREE)):
                        continue
                    seen[a, b, c] = QUEUED
                    if size == room:
                        room *= 2
                        after = np.concatenate((after, np.empty_like(after)))
                        cell = np.concatenate((cell, np.empty_like(cell)))
                        parent = np.concatenate((parent, np.empty_like(parent)))
                    gx, gy, gz = float(goal[0] - a), float(goal[1] - b), float(goal[2] - c)
                    cost = far[node] + math.sqrt(float(u * u + v * v + w * w))
                    cost += GREED * math.sqrt(gx * gx + gy * gy + gz * gz)
                    bucket = min(int(cost), len(heads) - 1)
                    after[size], cell[size], parent[size] = heads[bucket], (a * ny + b) * nz + c, node
                    heads[bucket] = size
                    lowest = min(lowest, bucket)
                    size += 1
    return np.empty((0, 3), np.int64)

"""Paths through cubes of FREE cells: the map's own search, without a sampling planner."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.states import FREE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]
Check = Callable[..., bool]

LARGEST: Final = 8
"""Cells from the middle of a cube to its sides, at most: larger cubes cost more than they save."""

ROUNDS: Final = 2
"""How often a path is pulled straight, from either end."""

UNSEEN, QUEUED, DONE = 0, 1, 2

GREED = 8.0
"""Weight of the distance to the goal against the way that was come: above 1 a search is quicker and its path longer."""

LISTS = 40.0
"""Lists for every cell of the map's diagonal; what costs more than they hold waits in the last one."""


# ---- the search ------------------------------------------------------------------------------------------------------


@jit
def _is_run_free(state: States, i: int, j: int, first: int, last: int, step: int) -> bool:
    # numba compiles no all() of a generator.
    for k in range(first, last + 1, step):  # noqa: SIM110
        if state[i, j, k] != FREE:
            return False
    return True


@jit
def _is_shell_free(state: States, i: int, j: int, k: int, r: int) -> bool:
    """Whether the cells at a distance of exactly r along some axis, and at most r along the others, are FREE."""
    nx, ny, nz = state.shape
    flat = state.shape[2] == 1
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


@jit
def free_radius(state: States, i: int, j: int, k: int, most: int) -> int:
    """Largest r, at most ``most``, for which all cells within r of a FREE cell along each axis are FREE."""
    r = 0
    while r < most and _is_shell_free(state, i, j, k, r + 1):
        r += 1
    return r


@jit
def trace_cubes(state: States, start: Ints, goal: Ints, most: int) -> Ints:
    """Middles of cubes of FREE cells, each in the cube before it, from a cell to one whose cube holds another cell.

    Of a single layer of cells, as in the plane, the cubes are squares.

    Cells wait by the length of the way to them, from middle to middle, and :data:`GREED` times the distance to the
    goal; all that is joined to the start is looked at before the search gives up.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny, nz)
    start, goal : ndarray of int64, shape (3,)
        FREE cells.
    most : int
        Largest distance, in cells, from the middle of a cube to its sides.

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
        r = free_radius(state, i, j, k, most)
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
        rz = 0 if nz == 1 else reach
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


# ---- paths -----------------------------------------------------------------------------------------------------------


def cube_path(state: NDArray[np.uint8], start: NDArray[np.int64], goal: NDArray[np.int64]) -> NDArray[np.int64]:
    """A chain of FREE cells from one to another, the straight edge from each to the next touching none but FREE ones.

    Every cell of the chain lies in the largest cube of FREE cells around the one before it, as far as such cubes are
    looked at, so that both middles and the edge between them lie inside that cube, or the two share a side. The search
    prefers the direction of the goal, finds a path wherever there is one, and the same one every time.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
    start, goal : ndarray of int64, shape (d,)
        FREE cells.

    Returns
    -------
    ndarray of int64, shape (n, d)
        From start to goal; of length 0 where no chain of FREE cells joins them.
    """
    dim = state.ndim
    layered = state.reshape(*state.shape, *[1] * (3 - dim))
    first, last = (np.pad(cell, (0, 3 - dim)) for cell in (start, goal))
    middles = trace_cubes(layered, first, last, LARGEST)[:, :dim]
    if not len(middles) or (middles[-1] == goal).all():
        return np.asarray(middles)
    return np.vstack([middles, goal])


def pulled_straight(points: Floats, check: Check, step: float) -> Floats:
    """A shorter path with the same ends, by leaving out points between which the straight edge is free.

    Parameters
    ----------
    points : ndarray, shape (n, d)
        A path, each edge of which is free.
    check : callable
        Whether the straight edge between two configurations, given by their numbers, is free.
    step : float
        Metres between points that are put on long edges before they are pulled a second time.

    Returns
    -------
    ndarray, shape (m, d)
    """
    dof = points.shape[1]

    def backwards(*q: float) -> bool:
        return check(*q[dof:], *q[:dof])  # every edge is asked for in the direction in which it is driven

    path = points
    for number in range(ROUNDS):
        path = _dense(path, step, check) if number else path
        path = _pulled(_pulled(path, check)[::-1], backwards)[::-1]
    return np.ascontiguousarray(path)


def _pulled(points: Floats, check: Check) -> Floats:
    """The path from each point that is kept straight to one as far on as strides of doubling length find free."""
    rows = points.tolist()
    kept, last = [0], len(rows) - 1
    while kept[-1] < last:
        here = kept[-1]
        seen, stride, blocked = here + 1, 2, last + 1
        while seen < last:
            ahead = min(here + stride, last)
            if not check(*rows[here], *rows[ahead]):
                blocked = ahead
                break
            seen, stride = ahead, 2 * stride
        while blocked - seen > 1:
            middle = (seen + blocked) // 2
            if middle > last:
                break
            if check(*rows[here], *rows[middle]):
                seen = middle
            else:
                blocked = middle
        kept.append(seen)
    return points[kept]


def _dense(points: Floats, step: float, check: Check) -> Floats:
    """The path with points on its edges, but for edges of which rounding would make pieces that are not proven."""
    rows = [points[:1]]
    for a, b in itertools.pairwise(points):
        number = max(1, int(np.linalg.norm(b - a) / step))
        pieces = a + np.arange(1, number + 1)[:, None] / number * (b - a)
        pieces[-1] = b
        stops = np.vstack([a, pieces]).tolist()
        proven = all(check(*p, *q) for p, q in itertools.pairwise(stops))
        rows.append(pieces if proven else b[None])
    return np.concatenate(rows)

"""Paths through cubes of FREE cells: the map's own search, without a sampling planner."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bytes, Floats, Ints
from cspace.compiling import inner, reader
from cspace.map.storage import Cells, Stack, cells_of, state_in
from cspace.states import FREE

Check = Callable[..., bool]

LARGEST: Final = 8
"""Cells from the middle of a cube to its sides, at most: larger cubes cost more than they save."""

ROOM: Final = 1024
"""Entries and cubes that there is room for in the beginning."""

ROUNDS: Final = 2
"""How often a path is pulled straight, from either end."""

TURN = 4.0
"""Cells of way that a turn into the next rotation cell counts as: straight on is tried first."""

UNSEEN, QUEUED, DONE = 0, 1, 2

GREED = 8.0
"""Weight of the distance to the goal against the way that was come: above 1 a search is quicker and its path longer."""

STEPS: Final = 2**18
"""Cells that a search looks at between two looks at the clock: 5 to 50 ms."""

PULLING: Final = 0.1
"""Seconds after the time limit in which a path that was found in time is still pulled straight."""

LISTS = 40.0
"""Lists for every cell of the map's diagonal; what costs more than they hold waits in the last one."""


# ---- the search ------------------------------------------------------------------------------------------------------


class Field(NamedTuple):
    """The states of a map along three axes, and the rotation cells that the robot may turn through.

    Attributes
    ----------
    cells : ndarray of uint8, shape (n,), or TwoBits
        States of all slices in a row.
    shape : tuple of int, length 3
        Of a slice; in the plane the last one is 1.
    slice_of : ndarray of int64, shape (rotations,)
    neighbors : ndarray of int64, shape (rotations, n)
        The rotation cells that each one shares a border with; -1 fills up.
    """

    cells: Cells
    shape: tuple[int, int, int]
    slice_of: Ints
    neighbors: Ints


@inner
def _is_run_free(cells: Cells, first: int, last: int, step: int) -> bool:
    # numba compiles no all() of a generator.
    for k in range(first, last + 1, step):  # noqa: SIM110
        if state_in(cells, k) != FREE:
            return False
    return True


@inner
def _is_shell_free(field: Field, start: int, at: tuple[int, int, int], r: int) -> bool:
    """Whether the cells at a distance of exactly r along some axis, and at most r along the others, are FREE."""
    (nx, ny, nz), (i, j, k) = field.shape, at
    flat = nz == 1
    rz = 0 if flat else r
    if i < r or j < r or k < rz or i + r >= nx or j + r >= ny or k + rz >= nz:
        return False
    for a in range(i - r, i + r + 1):
        for b in range(j - r, j + r + 1):
            whole = flat or abs(a - i) == r or abs(b - j) == r
            if flat and abs(a - i) < r and abs(b - j) < r:
                continue
            middle = start + (a * ny + b) * nz + k
            if not _is_run_free(field.cells, middle - rz, middle + rz, 1 if whole else 2 * r):
                return False
    return True


@reader
def free_radius(field: Field, turn: int, at: tuple[int, int, int], most: int) -> int:
    """Largest r, at most ``most``, for which all cells within r of a FREE cell along each axis are FREE."""
    start, r = field.slice_of[turn] * (field.shape[0] * field.shape[1] * field.shape[2]), 0
    while r < most and _is_shell_free(field, start, at, r + 1):
        r += 1
    return r


class Trace(NamedTuple):
    """How far :func:`trace_cubes` has come.

    Attributes
    ----------
    seen : ndarray of uint8, shape (n,)
        Of cells: :data:`UNSEEN`, :data:`QUEUED`, or :data:`DONE`.
    heads : ndarray of int64, shape (lists,)
        What waits, in lists by its rounded cost; a list that is not empty has its first entry here.
    after, cell, parent : ndarray of int32, int64 and int32, shape (m,)
        Entries: the next one, the cell, and the node that it was come to from.
    nodes : ndarray of int64, shape (k, 4)
        Middles of cubes, as cells.
    came, far : ndarray of int64 and float64, shape (k,)
        The node before each, and the way to it.
    counts : ndarray of int64, shape (3,)
        Of entries, of nodes, and of lists that are through.
    """

    seen: Bytes
    heads: Ints
    after: NDArray[np.int32]
    cell: Ints
    parent: NDArray[np.int32]
    nodes: Ints
    came: Ints
    far: Floats
    counts: Ints

    @classmethod
    def of(cls, field: Field, first: Ints, more: int) -> Trace:
        """From one cell, with room for so many more entries."""
        seen = np.zeros(len(field.slice_of) * math.prod(field.shape), dtype=np.uint8)
        heads = np.full(int(LISTS * math.hypot(*field.shape)) + 8, -1)
        after, parent, cell = np.empty(2 * more, np.int32), np.empty(2 * more, np.int32), np.empty(2 * more, np.int64)
        heads[0], after[0], parent[0] = 0, -1, -1
        cell[0] = ((first[0] * field.shape[0] + first[1]) * field.shape[1] + first[2]) * field.shape[2] + first[3]
        nodes, came, far = np.empty((ROOM, 4), np.int64), np.empty(ROOM, np.int64), np.empty(ROOM)
        return cls(seen, heads, after, cell, parent, nodes, came, far, np.array([1, 0, 0]))

    def roomy(self, more: int, until: float) -> Trace:
        """With room for so many more entries, and one more node, that of twice as many where it was scarce."""
        trace = self
        if self.counts[0] + more > len(self.cell):
            trace = trace._replace(**doubled(until, after=self.after, cell=self.cell, parent=self.parent))
        if self.counts[1] == len(self.came):
            trace = trace._replace(**doubled(until, nodes=self.nodes, came=self.came, far=self.far))
        return trace


def doubled(until: float, **arrays: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Arrays with room for twice as many rows, which takes no memory before it is used; TimeoutError from a time on."""
    twice = dict[str, NDArray[Any]]()
    for name, each in arrays.items():
        keep_on(until)  # large ones take a tenth of a second
        twice[name] = np.empty((2 * len(each), *each.shape[1:]), each.dtype)
        twice[name][: len(each)] = each
    return twice


@reader
def trace_cubes(field: Field, trace: Trace, last: Ints, most: int, more: int) -> int:
    """The node of a cube that holds a cell, behind others, each with its middle in the cube before it, from another.

    Of a single layer of cells, as in the plane, the cubes are squares. A cube has one rotation, and from each of its
    cells the search turns on the spot into the neighbouring ones. Cells wait by the length of the way to them, from
    middle to middle, and :data:`GREED` times the distance to the goal; all that is joined to the start is looked at
    before the search gives up.

    -1 where there is none; -2 now and then, and where there is no room for ``more`` entries: it goes on from there.

    Where the rotation changes, it does in the place of the later node, which lies in the cube of the one before.
    ``most`` is the largest distance, in cells, from the middle of a cube to its sides.
    """
    nx, ny, nz = field.shape
    volume, goal = nx * ny * nz, (last[1], last[2], last[3])
    seen, heads, after, cell, parent, nodes, came, far, counts = trace
    size, count, lowest, looked = counts[0], counts[1], counts[2], 0
    while lowest < len(heads):
        if looked >= STEPS or size + more > len(cell) or count == len(came):
            counts[0], counts[1], counts[2] = size, count, lowest
            return -2
        entry = heads[lowest]
        if entry < 0:
            lowest += 1
            continue
        heads[lowest], looked = after[entry], looked + 1
        turn, k = cell[entry] // volume, cell[entry] % nz
        j = cell[entry] // nz % ny
        i = cell[entry] // nz // ny % nx
        if seen[cell[entry]] == DONE:
            continue
        node, before = count, parent[entry]
        count += 1
        nodes[node, 0], nodes[node, 1], nodes[node, 2], nodes[node, 3] = turn, i, j, k
        came[node], far[node] = before, 0.0
        if before >= 0:
            u, v, w = i - nodes[before, 1], j - nodes[before, 2], k - nodes[before, 3]
            far[node] = far[before] + math.sqrt(float(u * u + v * v + w * w))
            far[node] += TURN * (turn != nodes[before, 0])
        r = free_radius(field, turn, (i, j, k), most)
        if turn == last[0] and max(abs(goal[0] - i), abs(goal[1] - j), abs(goal[2] - k)) <= r:
            return int(node)
        # Inside the cube nothing is left but turns; on its sides, or beside a lone cell, the search goes on.
        reach = max(r, 1)
        rz = 0 if nz == 1 else reach
        looked += (2 * reach + 1) ** 2 * (2 * rz + 1)
        for a in range(max(i - reach, 0), min(i + reach, nx - 1) + 1):
            for b in range(max(j - reach, 0), min(j + reach, ny - 1) + 1):
                row = (a * ny + b) * nz
                for c in range(max(k - rz, 0), min(k + rz, nz - 1) + 1):
                    if seen[turn * volume + row + c] == DONE:
                        continue
                    u, v, w = abs(a - i), abs(b - j), abs(c - k)
                    inside = r > 0 or u + v + w == 0
                    if not inside and u + v + w > 1:
                        continue
                    if max(u, v, w) < r or u + v + w == 0:
                        seen[turn * volume + row + c] = DONE
                    for index in range(-1, field.neighbors.shape[1] if inside else 0):
                        there = turn if index < 0 else field.neighbors[turn, index]
                        number = there * volume + row + c
                        if there < 0 or seen[number] != UNSEEN:
                            continue
                        if (index >= 0 or not inside) and state_in(
                            field.cells, field.slice_of[there] * volume + row + c
                        ) != FREE:
                            continue
                        seen[number] = QUEUED
                        gx, gy, gz = float(goal[0] - a), float(goal[1] - b), float(goal[2] - c)
                        cost = far[node] + math.sqrt(float(u * u + v * v + w * w)) + TURN * (index >= 0)
                        cost += GREED * math.sqrt(gx * gx + gy * gy + gz * gz)
                        bucket = min(int(cost), len(heads) - 1)
                        after[size], cell[size], parent[size] = heads[bucket], number, node
                        heads[bucket] = size
                        lowest = min(lowest, bucket)
                        size += 1
    return -1


# ---- paths -----------------------------------------------------------------------------------------------------------


def keep_on(until: float) -> None:
    """Raise TimeoutError from a time on, in seconds of :func:`time.perf_counter`."""
    if time.perf_counter() > until:
        raise TimeoutError


def in_time(check: Check, until: float) -> Check:
    """The check, False some time after a time limit, so that a path that is pulled straight by it stays as it is."""
    end = until + PULLING
    return check if end == math.inf else lambda *both: time.perf_counter() < end and check(*both)


def cube_path(states: Stack, slice_of: Ints, neighbors: Ints, start: Ints, goal: Ints, until: float = math.inf) -> Ints:
    """A chain of FREE cells from one to another, the straight edge from each to the next touching none but FREE ones.

    Every cell of the chain lies in the largest cube of FREE cells around the one before it, as far as such cubes are
    looked at, so that both middles and the edge between them lie inside that cube, or the two share a side; or it has
    the place of the one before it, in a neighbouring rotation cell. The search prefers the direction of the goal, finds
    a path wherever there is one, and the same one every time.

    Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``, and the chain has the shape (n, 1 + d); n is 0 where none
    joins them. ``neighbors``, shape (rotations, n), are the rotation cells into which each one may be left; none, where
    n is 0. TimeoutError is raised from a time on.
    """
    dim = states.ndim - 1
    nx, ny, nz = np.pad(states.shape[1:], (0, 3 - dim), constant_values=1).tolist()
    first, last = (np.pad(cell, (0, 3 - dim)) for cell in (start, goal))
    field = Field(cells_of(states), (nx, ny, nz), slice_of, neighbors)
    more = (2 * LARGEST + 1) ** dim * (1 + neighbors.shape[1])
    trace = Trace.of(field, first, more)
    while (node := trace_cubes(field, trace, last, LARGEST, more)) == -2:
        keep_on(until)
        trace = trace.roomy(more, until)
    back = []
    while node >= 0:
        back.append(node)
        node = int(trace.came[node])
    middles = trace.nodes[back[::-1], : 1 + dim]
    if not len(middles):
        return np.asarray(middles)
    # Where the robot turns, it first goes there as it is turned.
    turns = np.flatnonzero(middles[1:, 0] != middles[:-1, 0])
    between = np.column_stack([middles[turns, :1], middles[turns + 1, 1:]])
    cells = np.vstack([np.insert(middles, turns + 1, between, axis=0), goal])
    return np.asarray(cells[np.append(True, (cells[1:] != cells[:-1]).any(axis=1))])


def pulled_straight(points: Floats, dim: int, check: Check, step: float) -> Floats:
    """A shorter path with the same endpoints, by leaving out points between which the straight edge is free.

    ``points``, shape (n, dof), are a path, each edge of which is free by ``check``, of the numbers of two
    configurations; the first ``dim`` of these are a position. On long edges points are put, ``step`` metres apart,
    before they are pulled a second time.
    """
    dof = points.shape[1]

    def backwards(*q: float) -> bool:
        return check(*q[dof:], *q[:dof])  # every edge is checked in the direction in which it is driven

    path = points
    for number in range(ROUNDS):
        path = _dense(path, dim, step, check) if number else path
        path = _pulled(_pulled(path, check)[::-1], backwards)[::-1]
    return np.ascontiguousarray(path)


def _pulled(points: Floats, check: Check) -> Floats:
    """The path from each point that is kept straight to one as far on as strides of doubling length find free."""
    rows = points.tolist()
    corners, last = [0], len(rows) - 1
    while corners[-1] < last:
        here = corners[-1]
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
        corners.append(seen)
    return points[corners]


def _dense(points: Floats, dim: int, step: float, check: Check) -> Floats:
    """The path with points on edges that do not turn, unless rounding would make pieces of them that are not proven."""
    rows = [points[:1]]
    for a, b in itertools.pairwise(points):
        if (a[dim:] != b[dim:]).any():
            rows.append(b[None])
            continue
        number = max(1, int(np.linalg.norm(b - a) / step))
        pieces = a + np.arange(1, number + 1)[:, None] / number * (b - a)
        pieces[-1] = b
        stops = np.vstack([a, pieces]).tolist()
        proven = all(check(*p, *q) for p, q in itertools.pairwise(stops))
        rows.append(pieces if proven else b[None])
    return np.concatenate(rows)

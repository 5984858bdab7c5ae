"""Paths along chains of cells, pulled straight as far as the edges between their waypoints are free."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from cspace.arrays import Floats, Ints
from cspace.compiling import clock
from cspace.grid import Grid
from cspace.rotations import Rotations
from cspace.rotations.base import beside

Check = Callable[..., bool]

ROUNDS: Final = 2
"""How often a path is pulled straight, from either end."""

PULLING: Final = 0.1
"""Seconds after the time limit in which a path that was found in time is still pulled straight."""


def unwind(cells: Ints, shape: Sequence[int], periodic_axes: Sequence[bool]) -> Ints:
    """Cells ``(rotation, x, ...)`` of a chain, shape (n, 1 + d), that count on where axes close in a circle."""
    cells = cells.copy()
    for axis in np.flatnonzero(periodic_axes).tolist():
        cells[:, 1 + axis] = np.unwrap(cells[:, 1 + axis], period=shape[axis])
    return cells


def waypoints(
    grid: Grid, rotations: Rotations, endpoints: Floats, cells: Ints, periodic_axes: Sequence[bool]
) -> Floats:
    """The path from one configuration to another, shape (2, size), by the middles of cells, shape (n, 1 + d).

    Cells may count on, as of :func:`unwind`; then endpoints are moved by whole turns to where the cells are.
    """
    middles = np.column_stack([grid.center_of(cells[:, 1:]), rotations.centers[cells[:, 0]]])
    path = np.vstack([endpoints[0], middles, endpoints[1]])
    for axis in np.flatnonzero(periodic_axes).tolist():
        path[[0, -1], axis] = beside(path[[0, -1], axis], path[[1, -2], axis])
    return path


def in_time(check: Check, until: float) -> Check:
    """The check, False some time after a time limit, so that a path that is pulled straight by it stays as it is."""
    end = until + PULLING
    return check if end == math.inf else lambda *both: clock() < end and check(*both)


def pulled_straight(points: Floats, dim: int, check: Check, step: float) -> Floats:
    """A shorter path with the same endpoints, by leaving out points between which the straight edge is free.

    ``points``, shape (n, size), are a path, each edge of which is free by ``check``, of the numbers of two
    configurations; the first ``dim`` of these are a position. On long edges points are put, ``step`` metres apart,
    before they are pulled a second time.
    """
    size = points.shape[1]

    def backwards(*q: float) -> bool:
        return check(*q[size:], *q[:size])  # every edge is checked in the direction in which it is driven

    path = points
    for number in range(ROUNDS):
        path = _dense(path, dim, step, check) if number else path
        path = _pulled(_pulled(path, check)[::-1], backwards)[::-1]
    return np.ascontiguousarray(path)


def _pulled(points: Floats, check: Check) -> Floats:
    """The path from each point that is kept straight to one as far on as strides of doubling length find free."""
    corners, last = [0], len(points) - 1
    while corners[-1] < last:
        here = corners[-1]
        first = points[here].tolist()  # all of them together may be larger than the map
        seen, stride, blocked = here + 1, 2, last + 1
        while seen < last:
            ahead = min(here + stride, last)
            if not check(*first, *points[ahead].tolist()):
                blocked = ahead
                break
            seen, stride = ahead, 2 * stride
        while blocked - seen > 1:
            middle = (seen + blocked) // 2
            if middle > last:
                break
            if check(*first, *points[middle].tolist()):
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

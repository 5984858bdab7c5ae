"""Paths along chains of cells, shortened by skipping waypoints."""

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

SHORTENING_ROUNDS: Final = 2
"""Number of times a path is shortened from either end."""

MAX_SHORTENING_SECONDS: Final = 0.1
"""Seconds after the time limit in which a path found in time may still be shortened."""


def unwind(cells: Ints, shape: Sequence[int], periodic_axes: Sequence[bool]) -> Ints:
    """Unwrap chains (n, 1 + d) along periodic axes."""
    cells = cells.copy()
    for axis in np.flatnonzero(periodic_axes).tolist():
        cells[:, 1 + axis] = np.unwrap(cells[:, 1 + axis], period=shape[axis])
    return cells


def waypoints(
    grid: Grid, rotations: Rotations, endpoints: Floats, cells: Ints, periodic_axes: Sequence[bool]
) -> Floats:
    """Return the path through the centers of cells.

    ``endpoints`` has shape (2, size), ``cells`` shape (n, 1 + d). If cells are unwrapped, as by :func:`unwind`,
    endpoints are shifted by whole turns to match.
    """
    centers = np.column_stack([grid.center_of(cells[:, 1:]), rotations.centers[cells[:, 0]]])
    path = np.vstack([endpoints[0], centers, endpoints[1]])
    for axis in np.flatnonzero(periodic_axes).tolist():
        path[[0, -1], axis] = beside(path[[0, -1], axis], path[[1, -2], axis])
    return path


def in_time(check: Check, until: float) -> Check:
    """Wrap a check to fail after a time limit.

    A path that is being shortened then stays as it is.
    """
    end = until + MAX_SHORTENING_SECONDS
    return check if end == math.inf else lambda *both: clock() < end and check(*both)


def pulled_straight(points: Floats, dim: int, check: Check, step: float) -> Floats:
    """Shorten a path by skipping waypoints.

    Every edge of ``points``, shape (n, size), passes ``check``, which takes the coordinates of two configurations. The
    first ``dim`` coordinates are a position. Before the second round, long edges get points ``step`` metres apart.
    """
    size = points.shape[1]

    def check_reversed(*q: float) -> bool:
        return check(*q[size:], *q[:size])  # check every edge in driving direction

    path = points
    for k in range(SHORTENING_ROUNDS):
        path = _add_points(path, dim, step, check) if k else path
        path = _skip_points(_skip_points(path, check)[::-1], check_reversed)[::-1]
    return np.ascontiguousarray(path)


def _skip_points(points: Floats, check: Check) -> Floats:
    """Skip waypoints with strides of doubling length."""
    kept, last = [0], len(points) - 1
    while kept[-1] < last:
        here = kept[-1]
        first = points[here].tolist()  # one at a time, because all may exceed the map's memory
        farthest, stride, blocked = here + 1, 2, last + 1
        while farthest < last:
            candidate = min(here + stride, last)
            if not check(*first, *points[candidate].tolist()):
                blocked = candidate
                break
            farthest, stride = candidate, 2 * stride
        while blocked - farthest > 1:
            center = (farthest + blocked) // 2
            if center > last:
                break
            if check(*first, *points[center].tolist()):
                farthest = center
            else:
                blocked = center
        kept.append(farthest)
    return points[kept]


def _add_points(points: Floats, dim: int, step: float, check: Check) -> Floats:
    """Add points on edges that pass the check.

    Rounding may make a piece fail.
    """
    rows = [points[:1]]
    for a, b in itertools.pairwise(points):
        if (a[dim:] != b[dim:]).any():
            rows.append(b[None])
            continue
        count = max(1, int(np.linalg.norm(b - a) / step))
        pieces = a + np.arange(1, count + 1)[:, None] / count * (b - a)
        pieces[-1] = b
        stops = np.vstack([a, pieces]).tolist()
        proven = all(check(*p, *q) for p, q in itertools.pairwise(stops))
        rows.append(pieces if proven else b[None])
    return np.concatenate(rows)

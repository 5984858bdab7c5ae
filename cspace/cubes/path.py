"""Paths through cubes of FREE cells."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Check = Callable[..., bool]

LARGEST: Final = 8
"""Cells from the middle of a cube to its sides, at most: larger cubes cost more than they save."""

ROUNDS: Final = 2
"""How often a path is pulled straight, from either end."""


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
    from cspace.cubes import _kernels

    dim = state.ndim
    layered = state.reshape(*state.shape, *[1] * (3 - dim))
    first, last = (np.pad(cell, (0, 3 - dim)) for cell in (start, goal))
    middles = _kernels.trace_cubes(layered, first, last, LARGEST, dim == 2)[:, :dim]
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

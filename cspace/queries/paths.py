"""Paths along chains of cells, shortened by skipping waypoints and cutting corners."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from cspace.grid import Grid
from cspace.rotations import Rotations
from cspace.rotations.base import METRES_PER_RADIAN, wrapped
from cspace.support.arrays import Floats, Ints
from cspace.support.compiling import clock

Check = Callable[..., bool]
Cost = Callable[..., float]

MAX_CUTTING_ROUNDS: Final = 10
"""Number of times the corners of a path are cut."""

MIN_GAIN_SHARE: Final = 1e-3
"""Share of the length that a round of cutting corners must gain for another to follow."""

SHARES_PER_EDGE: Final = 64
"""Number of parts of an edge that a cut corner may reach."""

LONGEST_STRIDE_LOG: Final = 6
"""Binary logarithm of the number of waypoints that an edge may replace at a time, if edges have
costs."""

MAX_SHORTENING_SECONDS: Final = 0.1
"""Seconds after the time limit in which a path found in time may still be shortened."""


def waypoints(grid: Grid, rotations: Rotations, endpoints: Floats, cells: Ints) -> Floats:
    """Return the path through the centers of cells.

    ``endpoints`` has shape (2, size), ``cells`` shape (n, 1 + d).
    """
    centers = np.column_stack([grid.center_of(cells[:, 1:]), rotations.centers[cells[:, 0]]])
    return np.vstack([endpoints[0], centers, endpoints[1]])


def in_time(check: Check, until: float) -> Check:
    """Wrap a check to fail after a time limit.

    A path that is being shortened then stays as it is.
    """
    end = until + MAX_SHORTENING_SECONDS
    return check if end == math.inf else lambda *both: clock() < end and check(*both)


def pulled_straight(
    path: Floats, rotations: Rotations, check: Check, cost: Cost | None = None
) -> Floats:
    """Shorten a path by skipping waypoints and cutting corners.

    Every edge of ``path``, shape (n, size), passes ``check``, which takes the coordinates of two
    configurations. So does every edge of the result. With a ``cost`` of edges, which takes the same
    coordinates, each change lowers the cost of the path instead of its length.
    """
    size = path.shape[1]

    def check_reversed(*q: float) -> bool:
        return check(*q[size:], *q[:size])  # check every edge in driving direction

    if cost is None:
        path = _skip_points(_skip_points(path, check)[::-1], check_reversed)[::-1]
    else:
        path = _cheapest_subpath(path, check, cost)
    total = _measure(path, rotations, cost)
    for _ in range(MAX_CUTTING_ROUNDS):
        path = _cut_corners(path, rotations, check, cost)
        before = total
        total = _measure(path, rotations, cost)
        if total > (1.0 - MIN_GAIN_SHARE) * before:
            break
    return np.ascontiguousarray(path)


def edge_costs(path: Floats, cost: Cost) -> Floats:
    """Return the cost of each edge of a path, shape (n - 1,)."""
    return np.array([cost(*first, *last) for first, last in itertools.pairwise(path.tolist())])


def _measure(path: Floats, rotations: Rotations, cost: Cost | None) -> float:
    """Return the cost of a path; without a cost, its length."""
    return path_length(path, rotations) if cost is None else float(edge_costs(path, cost).sum())


def path_length(path: Floats, rotations: Rotations) -> float:
    """Return the length of a path in metres.

    A radian counts as :data:`METRES_PER_RADIAN`.
    """
    steps = rotations.steps_between(path[:-1], path[1:])
    dim = path.shape[1] - len(rotations.names)
    lengths = np.linalg.norm(steps[:, :dim], axis=1) + METRES_PER_RADIAN * np.linalg.norm(
        steps[:, dim:], axis=1
    )
    return float(lengths.sum())


def _cut_corners(path: Floats, rotations: Rotations, check: Check, cost: Cost | None) -> Floats:
    """Replace corners by free edges.

    Each edge joins points at equal fractions of the two edges at a corner; the longest free one is
    chosen. With a cost, it may not cost more than the way around the corner.
    """
    shares = np.linspace(0.0, 1.0, SHARES_PER_EDGE + 1)[:, None]
    kept = [path[0]]
    for corner, after in itertools.pairwise(path[1:]):
        corners = np.repeat(corner[None], len(shares), axis=0)
        backward = rotations.add_steps(corners, shares * rotations.steps_between(corner, kept[-1]))
        forward = rotations.add_steps(corners, shares * rotations.steps_between(corner, after))
        first = kept[-1].tolist()
        last = after.tolist()
        if check(*first, *last) and _saves(cost, first, corner.tolist(), last):
            continue
        low = 0
        high = SHARES_PER_EDGE
        while high - low > 1:
            center = (low + high) // 2
            before = backward[center].tolist()
            beyond = forward[center].tolist()
            # Rounding may make a part of a free edge fail.
            is_free = check(*before, *beyond) and check(*first, *before) and check(*beyond, *last)
            if is_free and _saves(cost, before, corner.tolist(), beyond):
                low = center
            else:
                high = center
        kept += [backward[low], forward[low]] if low else [corner]
    is_yaw = [False] * (path.shape[1] - len(rotations.names)) + [
        name == "yaw" for name in rotations.names
    ]
    return wrapped(np.array([*kept, path[-1]]), is_yaw)


def _cheapest_subpath(points: Floats, check: Check, cost: Cost) -> Floats:
    """Skip waypoints so that the cost of the path is least, by dynamic programming.

    An edge may skip to the 2nd, 4th, 8th, ... waypoint ahead.
    """
    rows = points.tolist()
    least = np.full(len(points), math.inf)
    previous = np.zeros(len(points), dtype=np.int64)
    least[0] = 0.0
    for here in range(1, len(rows)):
        for before in [here - 2**k for k in range(LONGEST_STRIDE_LOG + 1) if here >= 2**k]:
            total = least[before] + cost(*rows[before], *rows[here])
            if total < least[here] and (here == before + 1 or check(*rows[before], *rows[here])):
                least[here] = total
                previous[here] = before
    kept = [len(rows) - 1]
    while kept[-1]:
        kept.append(int(previous[kept[-1]]))
    return points[kept[::-1]]


def _saves(
    cost: Cost | None, before: Sequence[float], corner: Sequence[float], beyond: Sequence[float]
) -> bool:
    """Return whether the edge past a corner costs at most as much as the edges to and from it."""
    return cost is None or cost(*before, *beyond) <= cost(*before, *corner) + cost(*corner, *beyond)


def _skip_points(points: Floats, check: Check) -> Floats:
    """Skip waypoints with strides of doubling length."""
    kept = [0]
    last = len(points) - 1
    while kept[-1] < last:
        here = kept[-1]
        first = points[here].tolist()  # one at a time, because all may exceed the map's memory
        farthest = here + 1
        stride = 2
        blocked = last + 1
        while farthest < last:
            candidate = min(here + stride, last)
            if not check(*first, *points[candidate].tolist()):
                blocked = candidate
                break
            farthest = candidate
            stride = 2 * stride
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

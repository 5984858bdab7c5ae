"""Paths along chains of cells, and how they are shortened."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace import CSpace, Rotations
from cspace.inside import (
    METRES_PER_RADIAN,
    NEVER,
    Effort,
    Endpoint,
    Floats,
    Ints,
    is_over,
    measure_steps,
    spend,
    wrap_angles,
)

if TYPE_CHECKING:
    from planners._edges.local_planner import Endpoints
    from planners._searches.estimate import Costs

Check = Callable[..., bool]
Cost = Callable[..., float]

SHARES_PER_EDGE: Final = 64
"""Number of parts of an edge; a cut corner begins and ends at a border between two."""

SHARES: Final = np.linspace(0.0, 1.0, SHARES_PER_EDGE + 1)[:, np.newaxis]
"""Ends of the parts of an edge, as shares of the edge, shape (n, 1)."""

CELLS_PER_EDGE: Final = 8
"""Cells of a chain that an edge replaces before others are tried, if it costs no more."""

MIN_GAIN: Final = 1e-3
MIN_GAIN_BEFORE_MOVES: Final = 3e-3
"""Least shares of a length or cost that a round of cutting corners gains, if another round is to
follow."""

MAX_SHORTENING: Final = Effort.from_seconds(0.1, 0.1)
"""Effort after the limit by which a path found in time may still be shortened."""

NANOSECONDS_PER_EDGE: Final = 10_000
"""Work of measuring and proving an edge."""


def waypoints(space: CSpace, endpoints: Floats, cells: Ints) -> Floats:
    """Return the path through cells' centers, shape (n + 2, size).

    ``endpoints`` has shape (2, size), ``cells``, each ``(rotation, x, ...)``, shape (n, 1 + d).
    """
    start, goal = endpoints
    rotation_cells = cells[:, 0]
    centers = [space.grid.center_of(cells[:, 1:]), space.rotations.centers[rotation_cells]]
    return np.vstack([start, np.column_stack(centers), goal])


def thin_path(
    path: Floats, factors: Costs, rotations: Rotations, check: Check, cost: Cost
) -> Floats:
    """Skip waypoints of a path, (n, size), if that costs no more.

    ``factors``, shape (n,), are the costs of a metre at the waypoints.
    """
    means = 0.5 * (factors[1:] + factors[:-1])
    costs = np.concatenate([[0.0], np.cumsum(means * _edge_lengths(path, rotations))]).tolist()
    rows = path.tolist()
    last = len(rows) - 1
    kept = [0]
    for before in range(0, last, CELLS_PER_EDGE):
        after = min(before + CELLS_PER_EDGE, last)
        edge = *rows[before], *rows[after]
        spend(NANOSECONDS_PER_EDGE)
        if cost(*edge) > costs[after] - costs[before] or not check(*edge):
            kept += range(before + 1, after)
        kept.append(after)
    return path[kept]


def drop_repeats(path: Floats) -> Floats:
    """Drop configurations of a path that equal the next."""
    differs_from_next = (path[1:] != path[:-1]).any(axis=1)
    distinct: Floats = path[np.append(differs_from_next, True)]
    return distinct


def keep_rotation(path: Floats, rotation_cells: Ints, dim: int, check: Check) -> Floats:
    """Keep both ends' common rotation along the path.

    ``path`` has shape (n + 2, size), with the centers of ``rotation_cells``, shape (n,), between
    its ends. If an edge fails ``check``, because the rotation is on the border of a rotation cell
    that is not FREE, the path stays as it is.
    """
    turns = (rotation_cells != rotation_cells[0]).any()
    if turns or dim == path.shape[1] or (path[0, dim:] != path[-1, dim:]).any():
        return path
    still = path.copy()
    still[:, dim:] = path[0, dim:]
    return still if are_free(still, check) else path


def pulled_straight(
    path: Floats,
    rotations: Rotations,
    check: Check,
    cost: Cost | None = None,
    until: Effort = NEVER,
    min_gain: float = MIN_GAIN,
) -> Floats:
    """Shorten a path by skipping waypoints and cutting corners.

    Every edge of ``path``, shape (n, size), passes ``check``, which takes the coordinates of two
    configurations. So does every edge of the result. With a ``cost`` of edges, which takes the same
    coordinates, each change lowers the cost of the path instead of its length. The path stays as it
    is after ``until``. Rounds of cutting corners end when one gains less than ``min_gain``.
    """
    if cost is None:
        path = _skip_points_both_ways(path, check, until)
    else:
        dim = path.shape[1] - len(rotations.names)
        path = find_cheapest_subpath(path, dim, check, cost, until=until)
    total = _measure(path, rotations, cost)
    # Number of times the corners of a path are cut.
    for _ in range(10):
        if is_over(until):
            break
        path = _cut_corners(path, rotations, check, cost, until)
        before = total
        total = _measure(path, rotations, cost)
        if total > (1.0 - min_gain) * before:
            break
    return np.ascontiguousarray(path)


def unwind(path: Floats, periodic_axes: Sequence[bool], start: Endpoint | None = None) -> Floats:
    """Unwrap continuous joints of a path (n, size).

    A path from ``start``, or whole turns from it, then begins there.
    """
    unwound = path.copy()
    if start is not None and len(path) and _are_equal(path[0], np.array(start), periodic_axes):
        unwound[0] = start
    joints = np.flatnonzero(periodic_axes)
    unwound[:, joints] = np.unwrap(unwound[:, joints], axis=0)
    return unwound


def _are_equal(first: Floats, second: Floats, periodic_axes: Sequence[bool]) -> bool:
    """Return True if all configurations (..., size) are equal.

    Continuous joints are compared modulo 2 pi.
    """
    gaps = np.abs(wrap_angles(first - second, periodic_axes))
    # Rounding of angles that are equal modulo 2 pi; relative beyond 1 rad.
    rounding = 1e-12 * np.maximum(1.0, np.abs(first))
    return bool((gaps <= rounding * np.array(periodic_axes)).all())


def reached_goal(path: Floats, endpoints: Endpoints, periodic_axes: Sequence[bool]) -> int:
    """Return the endpoint's index that a path reaches.

    It is 0 if the path does not lead from the first endpoint to another.
    """
    if not _are_equal(path[0], np.array(endpoints[0]), periodic_axes):
        return 0
    for k, goal in enumerate(endpoints[1:], 1):
        if _are_equal(path[-1], np.array(goal), periodic_axes):
            return k
    return 0


def are_free(path: Floats, check: Check) -> bool:
    """Return True if all edges pass ``check``."""
    return all(check(*start, *end) for start, end in itertools.pairwise(path.tolist()))


def edge_costs(path: Floats, cost: Cost) -> Floats:
    """Return each edge's cost, shape (n - 1,)."""
    return np.array([cost(*first, *last) for first, last in itertools.pairwise(path.tolist())])


def path_cost(path: Floats, cost: Cost) -> float:
    """Return the sum of the costs of all edges."""
    return float(edge_costs(path, cost).sum())


def _measure(path: Floats, rotations: Rotations, cost: Cost | None) -> float:
    """Return a path's cost, or its length without costs."""
    return path_length(path, rotations) if cost is None else path_cost(path, cost)


def path_length(path: Floats, rotations: Rotations) -> float:
    """Return a path's length, metres, by :data:`METRES_PER_RADIAN`."""
    return float(_edge_lengths(path, rotations).sum())


def _edge_lengths(path: Floats, rotations: Rotations) -> Floats:
    """Return each edge's length, shape (n - 1,)."""
    steps = rotations.steps_between(path[:-1], path[1:])
    dim = path.shape[1] - len(rotations.names)
    lengths, angles = measure_steps(steps, dim)
    return np.asarray(lengths + METRES_PER_RADIAN * angles)


def _cut_corners(
    path: Floats, rotations: Rotations, check: Check, cost: Cost | None, until: Effort
) -> Floats:
    """Replace corners by free edges until the search ends.

    Each edge joins points at equal fractions of the two edges at a corner; the longest free one is
    chosen. With a cost, it may not cost more than the way around the corner.
    """
    points = [path[0]]
    for corner, after in itertools.pairwise(path[1:]):
        if is_over(until):
            points.append(corner)
            continue
        spend(200_000)  # nanoseconds
        points += _cut_corner(points[-1], corner, after, rotations, check, cost)
    dim = path.shape[1] - len(rotations.names)
    is_yaw = [False] * dim + [name == "yaw" for name in rotations.names]
    return wrap_angles(np.array([*points, path[-1]]), is_yaw)


def _cut_corner(
    before: Floats,
    corner: Floats,
    after: Floats,
    rotations: Rotations,
    check: Check,
    cost: Cost | None,
) -> list[Floats]:
    """Return points that replace a corner, or the corner.

    The corner is between ``before`` and ``after``, shapes (size,). Bisection finds the longest edge
    past the corner that passes.
    """
    first = before.tolist()
    last = after.tolist()
    if check(*first, *last) and _saves(cost, first, corner.tolist(), last):
        return []
    # Points at shares of both edges, counted from the corner.
    steps = rotations.steps_between(np.stack([corner, corner]), np.stack([before, after]))
    corners = np.broadcast_to(corner, (2, len(SHARES), len(corner)))
    backward, forward = rotations.add_steps(corners, SHARES * steps[:, np.newaxis])
    low = 0
    high = SHARES_PER_EDGE
    while high - low > 1:
        center = (low + high) // 2
        start = backward[center].tolist()
        end = forward[center].tolist()
        # Rounding may make a part of a free edge fail.
        is_free = check(*start, *end) and check(*first, *start) and check(*end, *last)
        if is_free and _saves(cost, start, corner.tolist(), end):
            low = center
        else:
            high = center
    return [backward[low], forward[low]] if low else [corner]


def move_points(path: Floats, dim: int, step: float, check: Check, cost: Cost) -> Floats:
    """Move waypoints of a path, shape (n, size), to lower its cost.

    ``path`` has shape (n, size). Each waypoint moves in its first ``dim`` coordinates, by at most a
    few times ``step``, metres, if both its edges pass.
    """
    rows = path.tolist()
    ways = [way for way in itertools.product((-1.0, 0.0, 1.0), repeat=dim) if any(way)]
    for size in step * np.array([1.0, 0.5, 0.25]):
        for k in range(1, len(rows) - 1):
            before, here, after = rows[k - 1 : k + 2]
            least = cost(*before, *here) + cost(*here, *after)
            for way in ways:
                moved = [x + size * unit for x, unit in zip(here, way, strict=False)] + here[dim:]
                # An edge costs at least its length.
                rest = math.dist(moved[:dim], after[:dim])
                if math.dist(before[:dim], moved[:dim]) + rest >= least:
                    continue
                spend(2 * NANOSECONDS_PER_EDGE)
                total = cost(*before, *moved)
                if total + rest >= least:
                    continue
                total += cost(*moved, *after)
                if total < least and check(*before, *moved) and check(*moved, *after):
                    least = total
                    rows[k] = moved
    return np.array(rows)


def find_cheapest_subpath(
    points: Floats,
    dim: int,
    check: Check,
    cost: Cost,
    strides: Sequence[int] = (1, 2, 4, 8, 16, 32, 64),
    until: Effort = NEVER,
) -> Floats:
    """Skip waypoints for the least cost, by dynamic programming.

    The numbers of edges that one edge may replace are ``strides``, which begin with 1. It costs at
    least the distance of its ends in their first ``dim`` coordinates. Waypoints not reached by
    ``until`` keep their predecessors.
    """
    rows = points.tolist()
    positions = points[:, :dim].tolist()
    least = [0.0] * len(points)
    previous = list(range(-1, len(points) - 1))
    for here in range(1, len(points)):
        if is_over(until):
            break
        least[here] = math.inf
        position = positions[here]
        earlier = [here - stride for stride in strides if stride <= here]
        options = [(least[k] + math.dist(positions[k], position), -k) for k in earlier]
        for bound, number in sorted(options):
            before = -number
            if bound >= least[here]:
                break  # all other waypoints are as dear
            edge = *rows[before], *rows[here]
            total = least[before] + cost(*edge)
            spend(NANOSECONDS_PER_EDGE)
            # Edges of the given path need no check.
            if total < least[here] and (before == here - 1 or check(*edge)):
                least[here] = total
                previous[here] = before
    kept = [len(points) - 1]
    while kept[-1] > 0:
        kept.append(previous[kept[-1]])
    kept.reverse()
    return points[kept]


def _saves(
    cost: Cost | None, before: Sequence[float], corner: Sequence[float], beyond: Sequence[float]
) -> bool:
    """Return True if cutting a corner costs no more.

    Without a cost, lengths count, and the straight edge is never longer.
    """
    if cost is None:
        return True
    around = cost(*before, *corner) + cost(*corner, *beyond)
    return cost(*before, *beyond) <= around


def _skip_points_both_ways(path: Floats, check: Check, until: Effort) -> Floats:
    """Skip waypoints from both ends until the search ends."""
    size = path.shape[1]

    def check_reversed(*endpoints: float) -> bool:
        """Check an edge of numbers, in the path's direction."""
        return check(*endpoints[size:], *endpoints[:size])

    from_start = skip_points(path, check, until)
    from_end = skip_points(np.flipud(from_start), check_reversed, until)
    return np.flipud(from_end)


def skip_points(points: Floats, check: Check, until: Effort = NEVER) -> Floats:
    """Skip waypoints (n, size) by far edges until the search ends."""
    indices = [0]
    while indices[-1] < len(points) - 1:
        if is_over(until):
            indices += range(indices[-1] + 1, len(points))
            break
        indices.append(_find_farthest(points, indices[-1], check))
        spend(2 * NANOSECONDS_PER_EDGE)
    return points[indices]


def _find_farthest(points: Floats, here: int, check: Check) -> int:
    """Return the number of a far waypoint that an edge reaches.

    Strides double while edges pass. Between the last two, bisection finds the farthest.
    """
    # Convert one row at a time, because all rows may exceed the map's memory.
    start = points[here].tolist()
    last = len(points) - 1
    farthest = here + 1
    stride = 2
    while farthest < last:
        blocked = min(here + stride, last)
        if not check(*start, *points[blocked].tolist()):
            break
        farthest = blocked
        stride *= 2
    else:
        return last
    while blocked - farthest > 1:
        center = (farthest + blocked) // 2
        if check(*start, *points[center].tolist()):
            farthest = center
        else:
            blocked = center
    return farthest

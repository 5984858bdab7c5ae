"""The shortest path in the plane that crosses given runs of cells, and keeps a margin.

A *run* is a maximal row of FREE cells along the last axis. A path crosses one run after the other;
between two runs it passes a *gate*, the part of their border that both share. The shortest path
through the gates turns only at their ends. It grows from the start on: a *funnel* holds the
shortest paths to both ends of the last gate (D. T. Lee and F. Preparata, "Euclidean shortest paths
in the presence of rectilinear barriers", 1984).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cspace.inside import Floats, Ints, internal, kernel

MARGIN: Final = 2.0**-8
"""Distance in cells that paths keep from obstacles along each axis. It is far above the rounding of
proofs: a path rounded to 32 bits is still proven on maps of thousands of cells."""


def pull_taut(runs: Ints, start: Floats, goal: Floats) -> Floats:
    """Find the shortest path through runs with a margin, (m, 2).

    ``runs``, shape (n, 3), are crossed in turn: column, first cell, and the cell after the last
    one. ``start`` and ``goal``, shape (2,), are in cells, in the first and in the last run.
    """
    gates = list_gates(runs)
    move_outer_gates(gates, start, goal)
    return pass_gates(start, goal, gates)


def list_gates(runs: Ints) -> Floats:
    """List the gates between runs, (n, 3).

    Gates are rows x, left y, right y; shape (m, 3).
    """
    columns, bottom, top = np.stack([runs[:-1], runs[1:]]).transpose(2, 0, 1)
    # Runs of the same rows make a rectangle, without corners between them.
    has_corner = (bottom[0] != bottom[1]) | (top[0] != top[1])
    before, after = columns[:, has_corner]
    lower = bottom.max(axis=0)[has_corner] + MARGIN
    upper = top.min(axis=0)[has_corner] - MARGIN
    is_forward = after > before
    left = np.where(is_forward, upper, lower)
    right = np.where(is_forward, lower, upper)
    # Obstacles are wider by the margin, so that they narrow a gate before and behind the border.
    border = np.maximum(before, after)
    gates = [(border + side * MARGIN * (after - before), left, right) for side in (-1, 1)]
    return np.array(gates).transpose(2, 0, 1).reshape(-1, 3)


def move_outer_gates(gates: Floats, start: Floats, goal: Floats) -> None:
    """Move the outer gates if start or goal lies between a pair.

    ``gates``, shape (m, 3), come in pairs around a border.
    """
    for end, inner, point in ((0, 1, start), (-1, -2, goal)) if len(gates) else ():
        if (point[0] - gates[end, 0]) * (gates[inner, 0] - gates[end, 0]) <= 0.0:
            continue
        nearest = point[1].clip(*sorted(gates[end, 1:]))
        if nearest == point[1]:
            gates[end, 0] = point[0]
        else:  # beside an obstacle, whose corner is on the path
            gates[end, 1:] = nearest


def pass_gates(start: Floats, goal: Floats, gates: Floats) -> Floats:
    """Return the shortest path through gates, shape (m, 2).

    ``gates``, shape (n, 3), have x, and y of the left and the right end.
    """
    ends = gates[:, [0, 1, 0, 2]].reshape(-1, 2)
    points = np.vstack([start, ends, goal])
    funnel = np.zeros(len(points) + 1, dtype=np.int64)
    path = np.zeros(len(points), dtype=np.int64)
    return np.asarray(points[path[: move_funnel(points, funnel, path)]])


@kernel
def move_funnel(points: Floats, funnel: Ints, path: Ints) -> int:
    """Write the shortest path through gates; return its number of points.

    The points, shape (2 n + 2, 2), are the start, the left and the right end of each gate, and the
    goal. ``path`` gets the numbers of the path's points. The apex is its last point. ``funnel``
    gets the numbers of the points from the last gate's left end along the shortest path back to the
    apex, and on along the shortest path to the right end.
    """
    apex = len(points) // 2
    left = apex
    right = apex
    count = 1
    for point in range(1, len(points)):
        is_left = point % 2 == 1
        # The right side is mirrored.
        side = 1 if is_left else -1
        end = left if is_left else right
        other_end = right if is_left else left
        while end != apex and side * turn(points, funnel[end + side], funnel[end], point) <= 0.0:
            end += side
        # If the point lies beyond the other side, the path follows that side.
        while (
            end == apex != other_end
            and side * turn(points, funnel[end], funnel[end + side], point) < 0.0
        ):
            end += side
            apex = end
            path[count] = funnel[apex]
            count += 1
        end -= side
        funnel[end] = point
        if is_left:
            left = end
        else:
            right = end
    for place in range(apex - 1, left - 1, -1):
        path[count] = funnel[place]
        count += 1
    return count


@internal
def turn(points: Floats, a: int, b: int, c: int) -> float:
    """Return twice a triangle's signed area, positive to the left."""
    first_x = points[b, 0] - points[a, 0]
    first_y = points[b, 1] - points[a, 1]
    whole_x = points[c, 0] - points[a, 0]
    whole_y = points[c, 1] - points[a, 1]
    area: float = first_x * whole_y - first_y * whole_x
    return area

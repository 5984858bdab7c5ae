"""The shortest path in the plane that passes each obstacle on the same side as a given path.

A *run* is a maximal row of FREE cells along the last axis. A path crosses one run after the other;
between two runs it passes a *gate*, the part of their border that both share. The shortest path
through the gates turns only at their ends. It grows from the start on: a *funnel* holds the
shortest paths to both ends of the last gate (D. T. Lee and F. Preparata, "Euclidean shortest paths
in the presence of rectilinear barriers", 1984).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from cspace._queries.components import list_runs
from cspace._support.arrays import FREE, Floats, Ints, States

Point = tuple[float, float]

MARGIN: Final = 2.0**-8
"""Distance in cells that paths keep from obstacles along each axis. It is far above the rounding of
proofs: a path rounded to 32 bits is still proven on maps of thousands of cells."""


def pull_taut(states: States, path: Floats) -> Floats:
    """Return the shortest path that passes obstacles on the same sides, shape (m, 2).

    ``path``, shape (n, 2), is in cells; its edges touch only FREE cells of the grid. ``states`` has
    shape (nx, ny).
    """
    # A shortest path does not leave the box around the given one.
    first = np.floor(path.min(axis=0)).astype(np.int64)
    last = np.floor(path.max(axis=0)).astype(np.int64)
    window = states[first[0] : last[0] + 1, first[1] : last[1] + 1]
    start, goal = (path[[0, -1]] - first).tolist()
    gates = list_gates(window, *list_crossings(path - first, window.shape))
    begin_before_gates(gates, start[0])
    taut: Floats = first + np.array(pass_gates(tuple(start), tuple(goal), gates.tolist()))
    return taut


def list_crossings(path: Floats, shape: tuple[int, ...]) -> tuple[Ints, Ints]:
    """List where a path passes from one column of cells to the next.

    Returns the columns before and after, shape (2, n), and the rows, shape (n,).
    """
    columns = np.minimum(np.floor(path[:, 0]).astype(np.int64), shape[0] - 1)
    steps = np.diff(columns)
    counts = np.abs(steps)
    edges = np.repeat(np.arange(len(steps)), counts)
    numbers = np.arange(len(edges)) - np.repeat(np.cumsum(counts) - counts, counts)
    before = columns[edges] + np.sign(steps)[edges] * numbers
    after = before + np.sign(steps)[edges]
    x, y = path[edges].T
    dx, dy = (path[edges + 1] - path[edges]).T
    rows = np.floor(y + (np.maximum(before, after) - x) / dx * dy).astype(np.int64)
    return np.stack([before, after]), np.minimum(rows, shape[1] - 1)


def list_gates(states: States, columns: Ints, rows: Ints) -> Floats:
    """List the gates between columns before and after: x, and y of the left and the right end.

    ``columns`` has shape (2, n) and ``rows`` (n,), the result (m, 3).
    """
    runs = list_runs(states[np.newaxis], FREE)
    width = states.shape[1]
    crossed = np.searchsorted(runs.stops, columns * width + rows, side="right")
    kept = skip_returns(*crossed.tolist())
    columns = columns[:, kept]
    bottom = runs.starts[crossed[:, kept]] - columns * width
    top = runs.stops[crossed[:, kept]] - columns * width
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


def begin_before_gates(gates: Floats, start: float) -> None:
    """Move the first gate to the start if the start lies between the gate and its border.

    ``start`` is along x; ``gates``, shape (m, 3), come in pairs around a border.
    """
    if len(gates):
        farther = np.maximum if gates[1, 0] > gates[0, 0] else np.minimum
        gates[0, 0] = farther(gates[0, 0], start)


def skip_returns(before: Sequence[int], after: Sequence[int]) -> list[int]:
    """Return the crossings that remain if a path never returns to a run by the way it came."""
    kept: list[int] = []
    for number, run in enumerate(after):
        if kept and before[kept[-1]] == run:
            kept.pop()
        else:
            kept.append(number)
    return kept


def pass_gates(start: Point, goal: Point, gates: Sequence[Sequence[float]]) -> list[Point]:
    """Return the shortest path through gates, each given by x, and y of its left and right end."""
    path = [start]
    # The shortest paths from the last point of the path to both ends of the last gate.
    left = deque(path)
    right = deque(path)

    def extend(own: deque[Point], other: deque[Point], point: Point, side: int) -> None:
        """Let one side of the funnel, 1 for the left one, end at a point."""
        while len(own) > 1 and side * turn(own[-2], own[-1], point) <= 0.0:
            own.pop()
        # If the point lies beyond the other side, the path follows that side.
        while len(own) == 1 and len(other) > 1 and side * turn(other[0], other[1], point) < 0.0:
            other.popleft()
            own[0] = other[0]
            path.append(other[0])
        own.append(point)

    for x, left_y, right_y in gates:
        extend(left, right, (x, left_y), 1)
        extend(right, left, (x, right_y), -1)
    extend(left, right, goal, 1)
    return [*path[:-1], *left]


def turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of a triangle, above zero if it turns left at b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

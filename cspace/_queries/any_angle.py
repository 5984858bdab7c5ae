"""Shortest paths in the plane at any angle.

A *run* is a maximal row of passable cells along the last axis, y. Runs of the same rows in
successive columns form a *rectangle*. Two rectangles share a *gate*, a part of their border at an
integer x, the *line* of the gate. A shortest path crosses one rectangle after the other, and turns
only at corners, which are ends of gates.

A node of the search is an *interval*, the part of a gate that is seen from a *root*, the point at
which the paths through it turned last. At the far line of the rectangle behind an interval, a part
is seen from the same root; the parts beside it are reached around the corners at the ends of the
interval. Paths come in the order of lower bounds of their lengths, so the first that reaches the
goal is the shortest (D. Harabor, A. Grastien, D. Oz and V. Aksakalli, "Optimal any-angle
pathfinding in practice", 2016; M. Cui, D. Harabor and A. Grastien, "Compromise-free pathfinding on
a navigation mesh", 2017).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._grid import SLACK
from cspace._queries.components import list_runs
from cspace._support.arrays import FREE, Floats, Ints, States
from cspace._support.compiling import inlined, internal, kernel
from cspace._support.deadlines import NEVER, Effort, is_over, spend
from cspace._support.heap import pop_first, push

INSET: Final = 2.0**-20
"""Distance in cells of ends from lines, so that no end is on a line."""

GRAZING: Final = 1e-9
"""Distance in cells within which a ray meets a corner, and an interval shows the goal: rounding
must not hide a corner or the goal from both of two neighbouring intervals."""

MAX_ERROR_PER_CELL: Final = 1e-8
"""Cells by which rounding and :data:`GRAZING` may lengthen a path, for each cell of its length: its
corners are at least a cell apart."""

NONE: Final = -1
"""Stands for no corner, no interval, and the run of an interval that is the goal itself."""


Point = tuple[float, float]


class Rectangles(NamedTuple):
    """Runs of passable cells in the order of their columns, and the rectangles that they form.

    Attributes
    ----------
    first : ndarray of int64, shape (columns + 1,)
        Number of the first run of each column; the last entry is the number of all runs.
    column, low, high : ndarray of int64, shape (runs,)
        Column of a run, its first cell, and the cell after its last one.
    begin : ndarray of int64, shape (runs,)
        First run of the rectangle of each run.
    end : ndarray of int64, shape (runs,)
        Last run of the rectangle that begins with each run.
    """

    first: Ints
    column: Ints
    low: Ints
    high: Ints
    begin: Ints
    end: Ints


class SeenIntervals(NamedTuple):
    """Intervals that a search has reached, each an entry of arrays of shape (n,).

    Attributes
    ----------
    run : ndarray of int64
        Run behind the interval.
    step : ndarray of int64
        Direction of paths through the interval, 1 or -1 along x.
    low, high : ndarray of float64
        Ends of the interval along y.
    low_corner, high_corner : ndarray of int64
        Corners at the ends, or :data:`NONE` if paths do not turn there.
    root_x, root_y, length : ndarray of float64
        The root, and the length of the path from the start to it.
    root : ndarray of int64
        Corner of the root, or :data:`NONE` for the start.
    before : ndarray of int64
        Interval that the paths came through, or :data:`NONE`.
    """

    run: Ints
    step: Ints
    low: Floats
    high: Floats
    low_corner: Ints
    high_corner: Ints
    root_x: Floats
    root_y: Floats
    length: Floats
    root: Ints
    before: Ints


class Waiting(NamedTuple):
    """The intervals that wait, in a heap of :func:`push`, by bounds of the lengths of paths."""

    keys: Floats
    queue: Ints
    length: Ints


class Front(NamedTuple):
    """State of a search, which kernels change.

    Attributes
    ----------
    intervals : SeenIntervals
    used : ndarray of int64, shape (1,)
        Number of intervals.
    queue : Waiting
    least : ndarray of float64, shape (4 runs,)
        Length of the shortest path found to each corner.
    """

    intervals: SeenIntervals
    used: Ints
    queue: Waiting
    least: Floats


class ShortestWay(NamedTuple):
    """A shortest path.

    Attributes
    ----------
    length : float
        In cells, infinite if there is no path.
    runs : ndarray of int64, shape (n,)
        Runs at which the path enters and leaves rectangles in turn.
    """

    length: float
    runs: Ints


NO_WAY: Final = ShortestWay(math.inf, np.empty(0, dtype=np.int64))


def list_rectangles(states: States) -> Rectangles:
    """List the runs of FREE cells; states have shape (nx, ny)."""
    runs = list_runs(states[np.newaxis], FREE)
    columns, width = states.shape
    column = runs.starts // width
    first = np.searchsorted(column, np.arange(columns + 1))
    low = runs.starts - column * width
    high = runs.stops - column * width
    # Each run is a rectangle, until those of the same rows are joined.
    rectangles = Rectangles(first, column, low, high, runs.labels, runs.labels.copy())
    join_runs(rectangles)
    return rectangles


def find_shortest_way(
    rectangles: Rectangles,
    start: Floats,
    goal: Floats,
    until: Effort = NEVER,
    may_exist: Callable[[], bool] | None = None,
) -> ShortestWay:
    """Find the shortest path between points in passable cells.

    Its length is exact except for :data:`MAX_ERROR_PER_CELL`, and :data:`INSET` at both ends. It
    passes no corner at which just two opposite cells are passable.

    Parameters
    ----------
    rectangles : Rectangles
    start, goal : ndarray of float64, shape (2,)
        In cells.
    until : Effort
        Reading of work and clock at which the search ends with a TimeoutError.
    may_exist : callable, optional
        Returns False if no path exists. It is asked once, if the search takes long.
    """
    first, start_point = find_run(rectangles, start)
    last, goal_point = find_run(rectangles, goal)
    if NONE in (first, last):
        return NO_WAY
    if rectangles.begin[first] == rectangles.begin[last]:
        return ShortestWay(math.dist(start_point, goal_point), np.array([first, last]))
    # All gates of the start's run and of another one may be added at once.
    room = 8 + 4 * int(np.diff(rectangles.first).max())
    front = make_front(len(rectangles.low), 2**10 + room)
    low = float(rectangles.low[first])
    high = float(rectangles.high[first])
    for step in (-1, 1):
        add_gates(
            rectangles, front, goal_point, start_point, 0.0, NONE, NONE, first, step, low, high
        )
    while True:
        used = int(front.used[0])
        is_done = expand_intervals(rectangles, front, goal_point, last, room)
        # Work of adding an interval.
        spend(250 * (int(front.used[0]) - used))
        if is_done:
            return trace_way(rectangles, front, first, last)
        if is_over(until):
            raise TimeoutError
        # Intervals after which a search asks the labels of the map whether a path may exist.
        if may_exist is not None and front.used[0] > 2**15:
            if not may_exist():
                return NO_WAY
            may_exist = None
        if front.used[0] + room >= len(front.queue.keys):
            queue = front.queue
            queue = queue._replace(keys=_double(queue.keys), queue=_double(queue.queue))
            intervals = SeenIntervals._make(map(_double, front.intervals))
            front = front._replace(intervals=intervals, queue=queue)


def _double(array: NDArray[Any]) -> NDArray[Any]:
    """Make room in an array for as many entries."""
    longer = np.empty(2 * len(array), array.dtype)
    longer[: len(array)] = array
    return longer


def find_run(rectangles: Rectangles, point: Floats) -> tuple[int, Point]:
    """Return a point's run or NONE, and the point off the lines."""
    x, y = point.tolist()
    column = min(math.floor(x), len(rectangles.first) - 2)
    first, stop = rectangles.first[column : column + 2].tolist()
    # Rounding may lift a point on the upper border of the grid above it.
    run = first + int(np.searchsorted(rectangles.high[first:stop], y - SLACK))
    contains = run < stop and rectangles.low[run] <= y
    y = min(y, float(rectangles.high[run])) if contains else y
    x = min(max(x, column + INSET), column + 1 - INSET)
    return (run if contains else NONE), (x, y)


def make_front(runs: int, capacity: int) -> Front:
    """Make an empty search with memory for some intervals."""
    floats = {"low", "high", "root_x", "root_y", "length"}
    kinds = [np.float64 if name in floats else np.int64 for name in SeenIntervals._fields]
    return Front(
        intervals=SeenIntervals._make(np.empty(capacity, dtype=kind) for kind in kinds),
        used=np.zeros(1, dtype=np.int64),
        queue=Waiting(
            keys=np.empty(capacity),
            queue=np.empty(capacity, dtype=np.int64),
            length=np.zeros(1, dtype=np.int64),
        ),
        least=np.full(4 * runs, np.inf),
    )


def trace_way(rectangles: Rectangles, front: Front, first: int, last: int) -> ShortestWay:
    """Return the path by the queue's first interval."""
    intervals = front.intervals
    if front.queue.length[0] == 0:
        return NO_WAY
    interval = int(front.queue.queue[0])
    length = float(intervals.length[interval])
    passed = []
    while (interval := int(intervals.before[interval])) != NONE:
        passed.append(interval)
    steps = intervals.step[passed[::-1]]
    entered = intervals.run[passed[::-1]]
    begins = rectangles.begin[[first, *entered[:-1]]]
    left = np.where(steps > 0, rectangles.end[begins], begins)
    return ShortestWay(length, np.array([first, *np.column_stack([left, entered]).ravel(), last]))


@kernel
def join_runs(rectangles: Rectangles) -> None:
    """Join runs of the same rows in neighbouring columns."""
    first, _, low, high, begin, end = rectangles
    for column in range(len(first) - 2):
        other = first[column + 1]
        for run in range(first[column], first[column + 1]):
            while other < first[column + 2] - 1 and low[other] < low[run]:
                other += 1
            if other < first[column + 2] and low[other] == low[run] and high[other] == high[run]:
                begin[other] = begin[run]
                end[begin[run]] = other


@internal
def find_end(rectangles: Rectangles, run: int, step: int) -> int:
    """Return the run at which paths in a direction leave a run's rectangle."""
    begin: int = rectangles.begin[run]
    return rectangles.end[begin] if step > 0 else begin


@inlined
def find_line(rectangles: Rectangles, run: int, step: int) -> float:
    """Return the line by which paths in a direction leave a run."""
    return float(rectangles.column[run] + (1 if step > 0 else 0))


@internal
def find_first_above(rectangles: Rectangles, column: int, y: float) -> int:
    """Return the first run that ends above y, or the next column's."""
    low: int = rectangles.first[column]
    high: int = rectangles.first[column + 1]
    while low < high:
        middle = (low + high) // 2
        if rectangles.high[middle] > y:
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def expand_intervals(
    rectangles: Rectangles, front: Front, goal: Point, goal_run: int, room: int
) -> bool:
    """Expand intervals; return True once the queue's first is the goal, or none is left.

    Return False after many intervals, or if less than ``room`` is left for others.
    """
    queue = front.queue
    intervals = front.intervals
    # Intervals expanded between two checks of the time limit.
    for _ in range(2**13):
        if front.used[0] + room >= len(queue.keys):
            return False
        if queue.length[0] == 0 or intervals.run[queue.queue[0]] == NONE:
            return True
        interval = queue.queue[0]
        pop_first(queue)
        root = intervals.root[interval]
        # A shorter path to the root may have been found since.
        if root == NONE or intervals.length[interval] <= front.least[root]:
            expand_interval(rectangles, front, goal, goal_run, interval)
    return False


@internal
def expand_interval(
    rectangles: Rectangles, front: Front, goal: Point, goal_run: int, interval: int
) -> None:
    """Add the gates, or the goal, that an interval reaches next."""
    intervals = front.intervals
    run = intervals.run[interval]
    step = intervals.step[interval]
    low = intervals.low[interval]
    high = intervals.high[interval]
    length = intervals.length[interval]
    far_line = find_line(rectangles, find_end(rectangles, run, step), step)
    root = intervals.root_x[interval], intervals.root_y[interval]
    run_low = float(rectangles.low[run])
    run_high = float(rectangles.high[run])
    line = find_line(rectangles, run, -step)
    seen_low = run_low
    seen_high = run_high
    crossing = root[1]
    # From a root on the line, at an end of the interval, the whole rectangle is seen.
    if root[0] != line:
        stretch = (far_line - root[0]) / (line - root[0])
        seen_low = min(max(snap(root[1] + (low - root[1]) * stretch), run_low), run_high)
        seen_high = min(max(snap(root[1] + (high - root[1]) * stretch), run_low), run_high)
        crossing = cross_line(root, goal, line)
    sees_goal = low - GRAZING <= crossing <= high + GRAZING
    has_goal = rectangles.begin[run] == rectangles.begin[goal_run]
    if has_goal and sees_goal:
        add_goal(front, length + distance(root, goal), interval)
    corner = intervals.root[interval]
    add_gates(
        rectangles, front, goal, root, length, corner, interval, run, step, seen_low, seen_high
    )
    # At each end: the parts beside what the root sees, ahead and back across the line.
    low_end = False, low, intervals.low_corner[interval], (run_low, seen_low), (run_low, low)
    high_end = True, high, intervals.high_corner[interval], (seen_high, run_high), (high, run_high)
    for is_high, y, corner, ahead, back in (low_end, high_end):
        turn = line, y
        total = length + distance(root, turn)
        if corner == NONE or total >= front.least[corner]:
            continue
        front.least[corner] = total
        if has_goal and not sees_goal and (crossing > y) == is_high:
            add_goal(front, total + distance(turn, goal), interval)
        for way, part in ((step, ahead), (-step, back)):
            add_gates(
                rectangles, front, goal, turn, total, corner, interval, run, way, part[0], part[1]
            )


@kernel
def add_gates(
    rectangles: Rectangles,
    front: Front,
    goal: Point,
    root: Point,
    length: float,
    corner: int,
    before: int,
    run: int,
    step: int,
    low: float,
    high: float,
) -> None:
    """Add gates of one side of a run's rectangle between two points.

    The side is that of ``step``. The path to ``root``, at a corner, has a length.
    """
    run = find_end(rectangles, run, step)
    beyond = rectangles.column[run] + step
    if low >= high or beyond < 0 or beyond >= len(rectangles.first) - 1:
        return
    line = find_line(rectangles, run, step)
    other = find_first_above(rectangles, beyond, low)
    while other < rectangles.first[beyond + 1] and rectangles.low[other] < high:
        gate_low = max(rectangles.low[run], rectangles.low[other])
        gate_high = min(rectangles.high[run], rectangles.high[other])
        seen_low = max(low, float(gate_low))
        seen_high = min(high, float(gate_high))
        low_corner, high_corner = find_corners(rectangles, run, other, step, seen_low, seen_high)
        is_shortest = seen_low < seen_high
        x, y = root
        total = length
        at = corner
        if is_shortest and x == line:
            # The path follows the line to the nearer end of the gate, and turns there.
            at = low_corner if y <= seen_low else high_corner
            y = seen_low if y <= seen_low else seen_high
            total += abs(y - root[1])
            is_shortest = total < front.least[at]
        if is_shortest:
            if x == line:
                front.least[at] = total
            interval = front.used[0]
            front.used[0] += 1
            intervals = front.intervals
            intervals.run[interval] = other
            intervals.step[interval] = step
            intervals.low[interval] = seen_low
            intervals.high[interval] = seen_high
            intervals.low_corner[interval] = low_corner
            intervals.high_corner[interval] = high_corner
            intervals.root_x[interval] = x
            intervals.root_y[interval] = y
            intervals.length[interval] = total
            intervals.root[interval] = at
            intervals.before[interval] = before
            bound = total + bound_length((x, y), goal, line, seen_low, seen_high)
            push(front.queue, bound, interval)
        other += 1


@inlined
def find_corners(
    rectangles: Rectangles, run: int, other: int, step: int, low: float, high: float
) -> tuple[int, int]:
    """Return the corners of a gate at a range's ends, or :data:`NONE`.

    Where both runs end, there is no corner between them.
    """
    low_corner = NONE
    high_corner = NONE
    own_low = rectangles.low[run]
    own_high = rectangles.high[run]
    other_low = rectangles.low[other]
    other_high = rectangles.high[other]
    if own_low != other_low and low == max(own_low, other_low):
        low_corner = number_corner(own_low > other_low, run, other, step)
    if own_high != other_high and high == min(own_high, other_high):
        high_corner = number_corner(own_high < other_high, run, other, step) + 1
    return low_corner, high_corner


@inlined
def snap(y: float) -> float:
    """Round y to an integer within :data:`GRAZING`, so that grazing rays meet."""
    return round(y) if abs(y - round(y)) < GRAZING else y


@inlined
def number_corner(is_own: bool, run: int, other: int, step: int) -> int:
    """Return the number of a gate's lower corner; the upper follows.

    The corner is at the end of ``run``, if it ``is_own``, and otherwise at that of the run beyond.
    """
    owner = run if is_own else other
    return 4 * owner + (2 if is_own == (step > 0) else 0)


@inlined
def add_goal(front: Front, length: float, before: int) -> None:
    """Add the goal, to which a path of a length leads."""
    interval = front.used[0]
    front.used[0] += 1
    front.intervals.run[interval] = NONE
    front.intervals.length[interval] = length
    front.intervals.before[interval] = before
    push(front.queue, length, interval)


@inlined
def bound_length(root: Point, goal: Point, line: float, low: float, high: float) -> float:
    """Return the length of the shortest path that touches an interval."""
    # A goal on the side of the root is mirrored at the line.
    if (goal[0] - line) * (root[0] - line) > 0.0:
        goal = 2.0 * line - goal[0], goal[1]
    through = line, min(max(cross_line(root, goal, line), low), high)
    return distance(root, through) + distance(through, goal)


@inlined
def cross_line(root: Point, goal: Point, line: float) -> float:
    """Return where the segment from root to goal crosses a line."""
    return root[1] + (goal[1] - root[1]) * (line - root[0]) / (goal[0] - root[0])


@inlined
def distance(a: Point, b: Point) -> float:
    """Return the distance between two points."""
    return math.hypot(b[0] - a[0], b[1] - a[1])

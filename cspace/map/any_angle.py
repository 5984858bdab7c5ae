"""Euclidean shortest paths among the cells of a plane map, at any angle.

Runs of passable cells along the second axis are rectangles. Paths cross from rectangle to rectangle through the
intervals in which two of them touch, and turn only at corners of cells that are not passable, so the shortest path is
exact although no angle is discretized (Harabor, Grastien, Oz and Aksakalli, "Optimal any-angle pathfinding in
practice", JAIR 2016; Cui, Harabor and Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017).

Coordinates are in cells: u along the second axis of the array, v along the first. Row i covers v in [i, i + 1].
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bytes, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.map.search import keep_on

NODES_PER_STEP: Final = 2**13
"""Search nodes expanded between two looks at the clock: about a millisecond."""

ROUNDING: Final = 1e-9
"""Cells within which the end of a visible interval counts as the corner next to it."""

INITIAL_NODES: Final = 2**10
"""Nodes for which there is memory at first; it doubles as needed."""

START: Final = 0
"""Point from which all paths begin."""


class Runs(NamedTuple):
    """Maximal runs of passable cells in each row of a map.

    Attributes
    ----------
    first : ndarray of int64, shape (rows + 1,)
        Index of the first run of each row, and the number of all runs.
    low, high : ndarray of int64, shape (runs,)
        First cell of a run, and the cell after its last one.
    """

    first: Ints
    low: Ints
    high: Ints


class Front(NamedTuple):
    """Search nodes: intervals through which paths enter a run, and the points where the paths turned last.

    Attributes
    ----------
    intervals : ndarray of float64, shape (nodes, 2)
        Ends of each interval along u.
    nodes : ndarray of int64, shape (nodes, 4)
        The run entered; the line v of the interval times two, plus 1 if the run lies above it; 1 if the low end is a
        corner plus 2 if the high end is; the last turning point. For a path that has reached the goal, the run is -1
        and both ends are where it crosses the line.
    heap : ndarray of int64, shape (nodes,)
        Nodes that wait, as a binary heap by their bounds.
    bounds : ndarray of float64, shape (nodes,)
        Length of the shortest path to the goal through each node if nothing were in the way.
    points : ndarray of float64, shape (points, 3)
        Turning points: u, v, and the length of the path to it.
    parents : ndarray of int64, shape (points,)
        The turning point before each, -1 for the start.
    table : ndarray of int64, shape (2 ** k,)
        Hash table of corners: the turning point of least length at each, -1 if empty.
    state : ndarray of int64, shape (4,)
        Numbers of nodes, of waiting nodes and of points, and the node that reached the goal, or -1.
    """

    intervals: Floats
    nodes: Ints
    heap: Ints
    bounds: Floats
    points: Floats
    parents: Ints
    table: Ints
    state: Ints


def shortest_path(cells: Bytes, start: Floats, goal: Floats, until: float, max_state: int = 0) -> Floats:
    """Return the shortest path between two points through cells of state at most `max_state`.

    The path may touch the borders of other cells; it does not pass between two of them that share only a corner.

    Parameters
    ----------
    cells : ndarray of uint8, shape (rows, columns)
        States of the cells.
    start, goal : ndarray of float64, shape (2,)
        Points (v, u) along the two axes of the array, in cells, both in passable cells.
    until : float
        When to give up, in seconds of :data:`cspace.compiling.clock`.
    max_state : int
        The highest passable state.

    Returns
    -------
    ndarray of float64, shape (n, 2)
        Start, corners and goal; n is 0 if no path exists.

    Raises
    ------
    TimeoutError
        If the search is not through in time.
    """
    return shortest_path_through(find_runs(cells, max_state), start, goal, until)


def shortest_path_through(runs: Runs, start: Floats, goal: Floats, until: float) -> Floats:
    """Return the shortest path through runs; see :func:`shortest_path`."""
    begin, end = (tuple(map(float, point[::-1])) for point in (start, goal))
    rows = len(runs.first) - 1
    homes = [run_at(runs, min(int(v), rows - 1), u) for u, v in (begin, end)]
    if min(homes) < 0:
        return np.empty((0, 2))
    if homes[0] == homes[1]:
        return np.stack([start, goal])
    front = _first_front()
    begin_search(runs, front, begin, end, homes[0], homes[1])
    while not expand_nodes(runs, front, end, homes[1]):
        keep_on(until)
        front = _with_room(front)
    if front.state[3] < 0:
        return np.empty((0, 2))
    path, point, crossing = [np.asarray(goal)], int(front.nodes[front.state[3], 3]), front.intervals[front.state[3], 0]
    line = front.nodes[front.state[3], 1] >> 1
    bend = np.array([line, crossing])
    root = front.points[point, 1::-1]
    if abs(np.cross(goal - root, bend - root)) > ROUNDING * max(1.0, float(np.abs(goal - root).max())):
        path.append(bend)
    while point >= 0:
        path.append(front.points[point, 1::-1])
        point = int(front.parents[point])
    path = path[::-1]
    keep = [True, *[bool((a != b).any()) for a, b in zip(path[1:], path[:-1], strict=True)]]
    return np.array(path)[keep]


def _first_front() -> Front:
    count = INITIAL_NODES
    return Front(
        np.empty((count, 2)),
        np.empty((count, 4), dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty(count),
        np.empty((count, 3)),
        np.empty(count, dtype=np.int64),
        np.full(4 * count, -1),
        np.array([0, 0, 0, -1]),
    )


def _with_room(front: Front) -> Front:
    """Return the front with twice the memory, if less than half is left."""
    count, points = len(front.bounds), len(front.parents)
    if 2 * front.state[0] > count:
        larger = [np.concatenate([each, np.empty_like(each)]) for each in front[:4]]
        front = front._replace(intervals=larger[0], nodes=larger[1], heap=larger[2], bounds=larger[3])
    if 2 * front.state[2] > points:
        table = np.full(2 * len(front.table), -1)
        both = [np.concatenate([each, np.empty_like(each)]) for each in (front.points, front.parents)]
        front = front._replace(points=both[0], parents=both[1], table=table)
        rehash(front)
    return front


@jit
def find_runs(cells: Bytes, max_state: int) -> Runs:
    """Return the runs of cells of state at most `max_state`, row by row."""
    rows, columns = cells.shape
    first = np.zeros(rows + 1, dtype=np.int64)
    for i in range(rows):
        count, before = 0, False
        for j in range(columns):
            passable = cells[i, j] <= max_state
            count += passable and not before
            before = passable
        first[i + 1] = first[i] + count
    low, high = np.empty(first[rows], dtype=np.int64), np.empty(first[rows], dtype=np.int64)
    run = 0
    for i in range(rows):
        before = False
        for j in range(columns):
            passable = cells[i, j] <= max_state
            if passable and not before:
                low[run] = j
            if before and not passable:
                high[run] = j
                run += 1
            before = passable
        if before:
            high[run] = columns
            run += 1
    return Runs(first, low, high)


@kernel
def run_at(runs: Runs, row: int, u: float) -> int:
    """Return the run of a row that contains u, ends included; -1 if there is none."""
    run = _first_beyond(runs, row, u)
    if run > runs.first[row] and runs.high[run - 1] >= u:
        return run - 1
    return run if run < runs.first[row + 1] and runs.low[run] <= u else -1


@kernel
def _first_beyond(runs: Runs, row: int, u: float) -> int:
    """Return the first run of a row that ends beyond u."""
    low, high = runs.first[row], runs.first[row + 1]
    while low < high:
        center = (low + high) // 2
        if runs.high[center] > u:
            high = center
        else:
            low = center + 1
    return low


@kernel
def begin_search(
    runs: Runs, front: Front, start: tuple[float, float], goal: tuple[float, float], home: int, aim: int
) -> None:
    """Add the start, and all that is visible from it across the borders of its run."""
    front.points[START] = start[0], start[1], 0.0
    front.parents[START] = -1
    front.state[2] = 1
    row = 0
    while runs.first[row + 1] <= home:
        row += 1
    for side in range(2):
        _add_intervals(runs, front, goal, aim, START, row, side == 1, home, float(runs.low[home]), float(runs.high[home]))


@kernel
def expand_nodes(runs: Runs, front: Front, goal: tuple[float, float], aim: int) -> bool:
    """Expand nodes, the one of least bound first; return True if the search is through.

    It returns False for a look at the clock, and if memory for nodes or points may run out.
    """
    intervals, nodes, heap, bounds, points, parents, table, state = front
    for _ in range(NODES_PER_STEP):
        if state[1] == 0:
            return True
        if 2 * state[0] > len(bounds) or 2 * state[2] > len(parents):
            return False
        node = _pop(front)
        run, line, ahead, root = nodes[node, 0], nodes[node, 1] >> 1, (nodes[node, 1] & 1) == 1, nodes[node, 3]
        if run < 0:
            state[3] = node
            return True
        low_turns, high_turns = (nodes[node, 2] & 1) == 1, (nodes[node, 2] & 2) == 2
        ru, rv, length = points[root]
        if length > _length_to(front, ru, rv, root):
            continue  # a shorter path to its turning point was found since
        low, high = intervals[node]
        row = line if ahead else line - 1
        far = line + 1 if ahead else line - 1
        left, right = float(runs.low[run]), float(runs.high[run])
        if rv == line:
            # The path runs along the line to the nearest point of the interval, from which the whole run is visible.
            near = min(max(ru, low), high)
            if near != ru:
                root = _turn_at(front, near, float(line), root)
                if root < 0:
                    continue
            if run == aim:
                _add_goal(front, goal, root, near, line)
            _add_intervals(runs, front, goal, aim, root, row, ahead, run, left, right)
            # It may go on along the line, past a cell that is not passable, and leave the run on the side it came from.
            if near == high or root == START:
                _add_intervals(runs, front, goal, aim, root, row, not ahead, run, left, low)
            if near == low or root == START:
                _add_intervals(runs, front, goal, aim, root, row, not ahead, run, high, right)
            continue
        stretch = (far - rv) / (line - rv)
        seen_low = min(max(_snapped(ru + (low - ru) * stretch), left), right)
        seen_high = max(min(_snapped(ru + (high - ru) * stretch), right), left)
        if run == aim:
            _add_goal(front, goal, root, _crossing(ru, rv, goal[0], goal[1], line, low, high), line)
        _add_intervals(runs, front, goal, aim, root, row, ahead, run, seen_low, seen_high)
        if low_turns and (seen_low > left or low > left):
            turn = _turn_at(front, low, float(line), root)
            if turn >= 0:
                _add_intervals(runs, front, goal, aim, turn, row, ahead, run, left, seen_low)
                _add_intervals(runs, front, goal, aim, turn, row, not ahead, run, left, low)
        if high_turns and (seen_high < right or high < right):
            turn = _turn_at(front, high, float(line), root)
            if turn >= 0:
                _add_intervals(runs, front, goal, aim, turn, row, ahead, run, seen_high, right)
                _add_intervals(runs, front, goal, aim, turn, row, not ahead, run, high, right)
    return False


@kernel
def _snapped(u: float) -> float:
    """Return u, or the corner within rounding of it."""
    return round(u) if abs(u - round(u)) < ROUNDING else u


@kernel
def _crossing(ru: float, rv: float, gu: float, gv: float, line: int, low: float, high: float) -> float:
    """Return where the shortest path from a root to a goal crosses a line within an interval.

    A goal on the root's side of the line is mirrored at it.
    """
    if (gv - line) * (rv - line) > 0.0:
        gv = 2.0 * line - gv
    if gv == rv:
        return min(max(ru, low), high)
    return min(max(ru + (gu - ru) * (line - rv) / (gv - rv), low), high)


@kernel
def _add_goal(front: Front, goal: tuple[float, float], root: int, crossing: float, line: int) -> None:
    """Add the node of a path that reaches the goal across a line."""
    node = front.state[0]
    front.intervals[node] = crossing, crossing
    front.nodes[node] = -1, 2 * line, 0, root
    _push(front, goal)


@kernel
def _add_intervals(
    runs: Runs,
    front: Front,
    goal: tuple[float, float],
    aim: int,
    root: int,
    row: int,
    ahead: bool,
    run: int,
    low: float,
    high: float,
) -> None:
    """Add nodes for the runs beyond one side of a run, between two places on that side.

    `row` is that of the run; ``ahead`` is the side of larger v.
    """
    beyond = row + 1 if ahead else row - 1
    if low >= high or beyond < 0 or beyond >= len(runs.first) - 1:
        return
    other = _first_beyond(runs, beyond, low)
    while other < runs.first[beyond + 1] and runs.low[other] < high:
        corner_low, corner_high = max(runs.low[other], runs.low[run]), min(runs.high[other], runs.high[run])
        node, begin, end = front.state[0], max(low, float(corner_low)), min(high, float(corner_high))
        if begin < end:
            front.intervals[node] = begin, end
            turns = (1 if begin == corner_low else 0) + (2 if end == corner_high else 0)
            front.nodes[node] = other, 2 * (row + 1 if ahead else row) + (1 if ahead else 0), turns, root
            _push(front, goal)
        other += 1


@kernel
def _slot(front: Front, u: float, v: float) -> int:
    """Return the slot of a corner in the hash table, or the empty slot where it belongs."""
    table, points = front.table, front.points
    slot = (np.int64(u) * 73856093 ^ np.int64(v) * 19349663) & (len(table) - 1)
    while table[slot] >= 0 and (points[table[slot], 0] != u or points[table[slot], 1] != v):
        slot = (slot + 1) & (len(table) - 1)
    return slot


@kernel
def _length_to(front: Front, u: float, v: float, point: int) -> float:
    """Return the length of the shortest path known to a turning point."""
    if point == START:
        return 0.0
    return front.points[front.table[_slot(front, u, v)], 2]


@kernel
def _turn_at(front: Front, u: float, v: float, parent: int) -> int:
    """Add a turning point behind another one; return -1 if a shorter path to it is known."""
    points, state = front.points, front.state
    length = points[parent, 2] + math.hypot(u - points[parent, 0], v - points[parent, 1])
    slot = _slot(front, u, v)
    known = front.table[slot]
    if known >= 0:
        if points[known, 2] < length - ROUNDING:
            return -1
        if points[known, 2] <= length:
            return known
    point = state[2]
    points[point] = u, v, length
    front.parents[point] = parent
    front.table[slot] = point
    state[2] += 1
    return point


@kernel
def rehash(front: Front) -> None:
    """Enter all turning points but the start into an empty table; the last one at a corner is the nearest."""
    for point in range(1, front.state[2]):
        front.table[_slot(front, front.points[point, 0], front.points[point, 1])] = point


@kernel
def _push(front: Front, goal: tuple[float, float]) -> None:
    """Put the node that was added last into the heap, with its bound."""
    intervals, nodes, heap, bounds, points, _, _, state = front
    node = state[0]
    ru, rv, length = points[nodes[node, 3]]
    line = nodes[node, 1] >> 1
    crossing = _crossing(ru, rv, goal[0], goal[1], line, intervals[node, 0], intervals[node, 1])
    if rv == line:
        crossing = min(max(ru, intervals[node, 0]), intervals[node, 1])
    bounds[node] = length + math.hypot(crossing - ru, line - rv) + math.hypot(goal[0] - crossing, goal[1] - line)
    child = state[1]
    state[0] += 1
    state[1] += 1
    while child > 0:
        parent = (child - 1) // 2
        if bounds[heap[parent]] <= bounds[node]:
            break
        heap[child] = heap[parent]
        child = parent
    heap[child] = node


@kernel
def _pop(front: Front) -> int:
    """Take the node of least bound out of the heap."""
    heap, bounds, state = front.heap, front.bounds, front.state
    top = heap[0]
    state[1] -= 1
    count, last = state[1], heap[state[1]]
    parent = 0
    while 2 * parent + 1 < count:
        child = 2 * parent + 1
        if child + 1 < count and bounds[heap[child + 1]] < bounds[heap[child]]:
            child += 1
        if bounds[heap[child]] >= bounds[last]:
            break
        heap[parent] = heap[child]
        parent = child
    heap[parent] = last
    return int(top)

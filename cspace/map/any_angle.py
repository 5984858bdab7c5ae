"""Euclidean shortest paths among the cells of a plane map, at any angle.

Runs of passable cells along the second axis are rectangles. Paths cross from rectangle to rectangle through the
intervals in which two of them touch, and turn only at corners of cells that are not passable, so the shortest path is
exact although no angle is discretized (Harabor, Grastien, Oz and Aksakalli, "Optimal any-angle pathfinding in
practice", JAIR 2016; Cui, Harabor and Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017).

Coordinates are in cells: u along the second axis of the array, v along the first. Row i covers v in [i, i + 1].
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Floats, Ints, States
from cspace.compiling import jit, kernel
from cspace.map.search import check_deadline
from cspace.map.storage import Cells, read_only, row_in, state_in, zeros_below

NODES_PER_STEP: Final = 2**13
"""Search nodes expanded between two looks at the clock: about a millisecond."""

ROUNDING: Final = 1e-9
"""Cells within which the end of a visible interval counts as the corner next to it."""

MAX_ERROR_PER_CELL: Final = 1e-8
"""Cells by which rounding may lengthen a shortest path, for each cell of its length.

Corners are at least a cell apart, and each adds a few times :data:`ROUNDING`.
"""

INITIAL_CAPACITY: Final = 2**10
"""Nodes for which there is memory at first; it doubles as needed."""

START: Final = 0
"""Index of the point from which all paths begin."""

NUDGE: Final = 2.0**-20
"""Cells by which corners of a path are moved away from cells that are not FREE, far above the slack of look-ups."""


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
        corner plus 2 if the high end is; the last turning point. The run is -1 if the goal is visible from there.
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


def shortest_path(
    cells: Cells, first: int, shape: tuple[int, int], start: Floats, goal: Floats, until: float, max_state: int = FREE
) -> Floats:
    """Return the shortest path between two points of a slice, through cells of state at most `max_state`.

    The path may touch the borders of other cells. It does not pass between two of them that share only a corner.

    Parameters
    ----------
    cells : Cells
        States of all slices in a row.
    first : int
        Index of the first cell of the slice.
    shape : tuple of int
        Rows and columns of the slice.
    start, goal : ndarray of float64, shape (2,)
        Points (v, u) along the two axes of the map, in cells, both in passable cells.
    until : float
        When to give up, in seconds of :data:`cspace.compiling.clock`.
    max_state : {FREE, MIXED}
        The highest passable state.

    Returns
    -------
    ndarray of float64, shape (n, 2)
        Start, corners and goal; n is 0 if no path exists.

    Raises
    ------
    TimeoutError
        If the search does not end in time.
    """
    runs = find_runs(cells, first, shape[0], shape[1], max_state)
    begin, end = ((float(point[1]), float(point[0])) for point in (start, goal))
    home, aim = (run_at(runs, min(int(v), shape[0] - 1), u) for u, v in (begin, end))
    if min(home, aim) < 0:
        return np.empty((0, 2))
    if home == aim:
        return np.stack([start, goal])
    front = _first_front()
    begin_search(runs, front, begin, end, home, aim)
    check_deadline(until)
    while not expand_nodes(runs, front, end, aim):
        check_deadline(until)
        front = _with_room(front)
    return _traced(front, start, goal)


def min_length(states: States, is_open: bool, start: Floats, goal: Floats) -> float:
    """Bound the length of paths through cells that are not BLOCKED from below, in cells.

    Parameters
    ----------
    states : ndarray of uint8, shape (n, m) or (n, m, k)
    is_open : bool
        Whether paths may also leave the grid. A path outside it is no shorter than along its border.
    start, goal : ndarray of float64, shape (d,)
        Points in the grid, in cells.

    Returns
    -------
    float
        Infinity if there is no such path. Rounding is subtracted.
    """
    framed = np.pad(states, 1, constant_values=MIXED if is_open else BLOCKED)
    length = float(np.linalg.norm(goal - start))
    if framed.ndim == 2:
        length = max(length, _length_among(framed, start, goal))
    else:
        for axis, height in enumerate((goal - start).tolist()):
            flat = _length_among(framed.min(axis=axis), np.delete(start, axis), np.delete(goal, axis))
            length = max(length, math.hypot(flat, height))
    return length if math.isinf(length) else max(0.0, length - MAX_ERROR_PER_CELL * (length + 2.0))


def _length_among(framed: States, start: Floats, goal: Floats) -> float:
    """Return the length of the shortest path among the cells of a plane within a frame that are not BLOCKED."""
    rows, columns = framed.shape
    path = shortest_path(read_only(framed).reshape(-1), 0, (rows, columns), start + 1.0, goal + 1.0, math.inf, MIXED)
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if len(path) else math.inf


def _traced(front: Front, start: Floats, goal: Floats) -> Floats:
    """Return the path that reached the goal, without repeated points; of length 0 if none did."""
    node, path = int(front.state[3]), [goal]
    if node < 0:
        return np.empty((0, 2))
    point = int(front.nodes[node, 3])
    while point != START:
        path.append(front.points[point, 1::-1])
        point = int(front.parents[point])
    path.append(start)
    return np.array([b for a, b in zip([None, *path], path, strict=False) if a is None or (a != b).any()])[::-1]


def push_from_corners(cells: Cells, first: int, shape: tuple[int, int], path: Floats, also: bool) -> Floats:
    """Return a path with its corners moved away from the cells that it turns around, by :data:`NUDGE`.

    Look-ups of edges refuse an edge that touches a cell that is not FREE, though its border is proven with the FREE
    cells beside it. With ``also``, the path gets further points, beside the corners that its edges touch.
    """
    points = [path[0]]
    for a, b in itertools.pairwise(path):
        beside = corners_beside(cells, first, shape[0], shape[1], a, b) if also else b[None]
        points.extend(beside if also else [])
        points.append(b)
    pushed = [pushed_away(cells, first, shape[0], shape[1], point[0], point[1]) for point in points[1:-1]]
    return np.array([points[0], *pushed, points[-1]])


def _first_front() -> Front:
    count = INITIAL_CAPACITY
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
def find_runs(cells: Cells, first: int, rows: int, columns: int, max_state: int) -> Runs:
    """Return the runs of cells of state at most `max_state` of a slice, row by row."""
    counts = np.zeros(rows + 1, dtype=np.int64)
    for i in range(rows):
        counts[i + 1] = counts[i] + _find_row(cells, first + i * columns, columns, max_state, counts[:0], counts[:0])
    low, high = np.empty(counts[rows], dtype=np.int64), np.empty(counts[rows], dtype=np.int64)
    for i in range(rows):
        own = slice(counts[i], counts[i + 1])
        _find_row(cells, first + i * columns, columns, max_state, low[own], high[own])
    return Runs(counts, low, high)


@kernel
def _find_row(cells: Cells, first: int, columns: int, max_state: int, low: Ints, high: Ints) -> int:
    """Return the number of runs of a row, and write their ends if there is room for any."""
    run, inside = 0, False
    for block in range(0, columns, 64):
        not_free, blocked = row_in(cells, first + block, min(64, columns - block))
        closed, j = (not_free if max_state == FREE else blocked), 0
        while j < 64:
            word = (closed if inside else ~closed) >> np.uint64(j)
            if word == 0:
                break
            j += int(zeros_below(word))
            if len(low):
                if inside:
                    high[run] = block + j
                else:
                    low[run] = block + j
            run += inside
            inside = not inside
    if inside:
        if len(low):
            high[run] = columns
        run += 1
    return run


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
    low, high = int(runs.first[row]), int(runs.first[row + 1])
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
        _add_intervals(
            runs, front, goal, aim, START, row, side == 1, home, float(runs.low[home]), float(runs.high[home])
        )


@kernel
def expand_nodes(runs: Runs, front: Front, goal: tuple[float, float], aim: int) -> bool:
    """Expand nodes, the one of least bound first; return True if the search is through.

    It returns False for a look at the clock, and if memory for nodes or points may run out.
    """
    intervals, nodes, bounds, state = front.intervals, front.nodes, front.bounds, front.state
    points, parents = front.points, front.parents
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
                _add_goal(front, goal, root)
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
            crossing = ru + (goal[0] - ru) * (line - rv) / (goal[1] - rv)
            end = low if crossing < low - ROUNDING else high
            if low - ROUNDING <= crossing <= high + ROUNDING:
                _add_goal(front, goal, root)
            elif low_turns if end == low else high_turns:
                turn = _turn_at(front, end, float(line), root)
                if turn >= 0:
                    _add_goal(front, goal, turn)
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
    if rv == line or gv == rv:
        return min(max(ru, low), high)
    return min(max(ru + (gu - ru) * (line - rv) / (gv - rv), low), high)


@kernel
def _add_goal(front: Front, goal: tuple[float, float], root: int) -> None:
    """Add the node of a path that reaches the goal straight from a turning point."""
    ru, rv, length = front.points[root]
    front.nodes[front.state[0]] = -1, 0, 0, root
    _push(front, length + math.hypot(goal[0] - ru, goal[1] - rv))


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
            _push(front, _bound(front, root, row + 1 if ahead else row, begin, end, goal))
        other += 1


@kernel
def _slot(front: Front, u: float, v: float) -> int:
    """Return the slot of a corner in the hash table, or the empty slot where it belongs."""
    table, points = front.table, front.points
    slot = (int(u) * 73856093 ^ int(v) * 19349663) & (len(table) - 1)
    while table[slot] >= 0 and (points[table[slot], 0] != u or points[table[slot], 1] != v):
        slot = (slot + 1) & (len(table) - 1)
    return slot


@kernel
def _length_to(front: Front, u: float, v: float, point: int) -> float:
    """Return the length of the shortest path known to a turning point."""
    if point == START:
        return 0.0
    return float(front.points[front.table[_slot(front, u, v)], 2])


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
            return int(known)
    point = int(state[2])
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
def _bound(front: Front, root: int, line: int, low: float, high: float, goal: tuple[float, float]) -> float:
    """Return a lower bound of the length of paths through an interval."""
    ru, rv, length = front.points[root]
    crossing = _crossing(ru, rv, goal[0], goal[1], line, low, high)
    return float(length) + math.hypot(crossing - ru, line - rv) + math.hypot(goal[0] - crossing, goal[1] - line)


@kernel
def _push(front: Front, bound: float) -> None:
    """Put the node that was added last into the heap."""
    heap, bounds, state = front.heap, front.bounds, front.state
    node = state[0]
    bounds[node] = bound
    child = state[1]
    state[0] += 1
    state[1] += 1
    while child > 0:
        parent = (child - 1) // 2
        if bounds[heap[parent]] <= bound:
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


# ---- paths that look-ups of edges certify ----------------------------------------------------------------------------


@kernel
def _away_from(cells: Cells, first: int, rows: int, columns: int, v: int, u: int) -> tuple[int, int]:
    """Return the direction away from the one cell at a corner that is not FREE; (0, 0) if another number is not."""
    count, dv, du = 0, 0, 0
    for i in range(v - 1, v + 1):
        for j in range(u - 1, u + 1):
            if not (0 <= i < rows and 0 <= j < columns) or state_in(cells, first + i * columns + j) != FREE:
                count += 1
                dv, du = (1 if i < v else -1), (1 if j < u else -1)
    return (dv, du) if count == 1 else (0, 0)


@kernel
def pushed_away(cells: Cells, first: int, rows: int, columns: int, v: float, u: float) -> tuple[float, float]:
    """Return a corner moved away from its one cell that is not FREE, by :data:`NUDGE`."""
    dv, du = _away_from(cells, first, rows, columns, int(v), int(u))
    return v + NUDGE * dv, u + NUDGE * du


@jit
def corners_beside(cells: Cells, first: int, rows: int, columns: int, a: Floats, b: Floats) -> Floats:
    """Return the corners within twice :data:`NUDGE` of a segment at which exactly one of four cells is not FREE.

    Points are in cells, shape (2,). ``first`` is the index of the slice's first cell; the slice has ``rows`` and
    ``columns``.
    """
    steep = abs(b[0] - a[0]) > abs(b[1] - a[1])
    along, across = (0, 1) if steep else (1, 0)
    corners = np.empty((int(abs(b[along] - a[along])) + 2, 2))
    count, step = 0, 1.0 if b[along] > a[along] else -1.0
    place = math.floor(a[along]) + 1.0 if step > 0.0 else math.ceil(a[along]) - 1.0
    while (b[along] - place) * step > 0.0:
        there = a[across] + (b[across] - a[across]) * (place - a[along]) / (b[along] - a[along])
        near = round(there)
        if abs(there - near) < 2.0 * NUDGE:
            v, u = (place, near) if steep else (near, place)
            if _away_from(cells, first, rows, columns, int(v), int(u)) != (0, 0):
                corners[count] = v, u
                count += 1
        place += step
    return corners[:count]

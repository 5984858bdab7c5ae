"""Shortest paths among the cells of a map of the plane, at any angle.

Each run of passable cells along the second axis is a rectangle. Paths cross from rectangle to rectangle through the
intervals in which two of them touch, and turn only at corners of cells that are not passable. So the shortest path is
exact although no angle is discretized (Harabor, Grastien, Oz and Aksakalli, "Optimal any-angle pathfinding in
practice", JAIR 2016; Cui, Harabor and Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017).

Coordinates are in cells: u along the second axis of the array, v along the first. Row i covers v in [i, i + 1]. The
root of a search node is the last point at which its path turns.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Floats, Ints, States
from cspace.compiling import kernel
from cspace.map.search import check_deadline
from cspace.map.storage import Cells, read_only, row_in, state_in, zeros_below
from cspace.rotations.records import jit

NODES_PER_STEP: Final = 2**13
"""Search nodes expanded between two checks of the time limit: about a millisecond."""

ROUNDING: Final = 1e-9
"""Distance, in cells, within which the end of a visible interval counts as the corner next to it."""

MAX_ERROR_PER_CELL: Final = 1e-8
"""Cells by which rounding may lengthen a shortest path, for each cell of its length.

Corners are at least a cell apart, and each adds a few times :data:`ROUNDING`.
"""

INITIAL_CAPACITY: Final = 2**10
"""Initial capacity of the node arrays; it doubles as needed."""

START: Final = 0
"""Index of the point from which all paths begin."""

NUDGE: Final = 2.0**-20
"""Cells by which corners of a path are moved away from cells that are not FREE, far above the tolerance of look-ups."""


FRONT_NODES, FRONT_WAITING, FRONT_POINTS, GOAL_NODE = range(4)
"""Indices into :attr:`Front.state`."""

LOW_IS_CORNER, HIGH_IS_CORNER = 1, 2
"""Bits that are set if the low end and the high end of an interval are corners, at which a path may turn."""


class Runs(NamedTuple):
    """Maximal runs of passable cells in each row.

    Attributes
    ----------
    first : ndarray of int64, shape (rows + 1,)
        Index of the first run of each row; the last entry is the number of all runs.
    low, high : ndarray of int64, shape (runs,)
        First cell of a run, and the cell after its last one.
    """

    first: Ints
    low: Ints
    high: Ints


class Front(NamedTuple):
    """Intervals to expand, and turning points, of a search.

    A search node is an interval through which paths enter a run, with the point at which they turned last.

    Attributes
    ----------
    intervals : ndarray of float64, shape (nodes, 2)
        Ends of each interval along u.
    nodes : ndarray of int64, shape (nodes, 4)
        The run entered, or -1 if the path reaches the goal; twice the line v of the interval, plus 1 if the run has
        larger v; bits :data:`LOW_IS_CORNER` and :data:`HIGH_IS_CORNER`; the root.
    heap : ndarray of int64, shape (nodes,)
        Waiting nodes, as a binary heap by their bounds.
    bounds : ndarray of float64, shape (nodes,)
        Lower bound of the length of paths to the goal through each node.
    points : ndarray of float64, shape (points, 3)
        Turning points: u, v, and the length of the path to it.
    parents : ndarray of int64, shape (points,)
        Previous turning point of each, -1 for the start.
    table : ndarray of int64, shape (2 ** k,)
        Hash table of corners: the turning point with the shortest path at each, -1 if empty.
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
    """Compute the shortest path between two points.

    It runs through cells of state at most `max_state`, and may touch the borders of other cells. It does not pass
    between two of them that share only a corner.

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
        Start, corners and goal, in cells; n is 0 if no path exists.

    Raises
    ------
    TimeoutError
        If the search does not end in time.
    """
    runs = find_runs(cells, first, shape[0], shape[1], max_state)
    start_uv, goal_uv = ((float(point[1]), float(point[0])) for point in (start, goal))
    start_run, goal_run = (run_at(runs, min(int(v), shape[0] - 1), u) for u, v in (start_uv, goal_uv))
    if min(start_run, goal_run) < 0:
        return np.empty((0, 2))
    if start_run == goal_run:
        return np.stack([start, goal])
    front = _first_front()
    begin_search(runs, front, start_uv, goal_uv, start_run, goal_run)
    check_deadline(until)
    while not expand_nodes(runs, front, goal_uv, goal_run):
        check_deadline(until)
        front = _with_room(front)
    return _traced(front, start, goal)


def min_length(states: States, is_open: bool, start: Floats, goal: Floats) -> float:
    """Compute a lower bound of collision-free path lengths.

    It holds for all paths through cells that are not BLOCKED, and is in cells.

    Parameters
    ----------
    states : ndarray of uint8, shape (n, m) or (n, m, k)
        FREE, MIXED or BLOCKED.
    is_open : bool
        Whether paths may also leave the grid. A path outside it is no shorter than along its border.
    start, goal : ndarray of float64, shape (d,)
        Points in the grid, in cells.

    Returns
    -------
    float
        Infinity if there is no such path. Rounding is subtracted.
    """
    # A frame of one cell stands for the outside of the grid.
    framed = np.pad(states, 1, constant_values=MIXED if is_open else BLOCKED)
    length = float(np.linalg.norm(goal - start))
    if framed.ndim == 2:
        length = max(length, _length_among(framed, start, goal))
    else:
        # A path in space is no shorter than its projection along an axis, in which a cell is passable if any in its
        # column is; the path also has to cover the height between start and goal.
        for axis, height in enumerate((goal - start).tolist()):
            flat = _length_among(framed.min(axis=axis), np.delete(start, axis), np.delete(goal, axis))
            length = max(length, math.hypot(flat, height))
    return length if math.isinf(length) else max(0.0, length - MAX_ERROR_PER_CELL * (length + 2.0))


def _length_among(framed: States, start: Floats, goal: Floats) -> float:
    """Return the length of the shortest path, in cells.

    The path runs through cells that are not BLOCKED. ``framed`` has shape (n, m), with a frame of one cell around the
    grid; `start` and `goal`, shape (2,), are in cells of the grid. Infinity if there is no path.
    """
    rows, columns = framed.shape
    path = shortest_path(read_only(framed).reshape(-1), 0, (rows, columns), start + 1.0, goal + 1.0, math.inf, MIXED)
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if len(path) else math.inf


def _traced(front: Front, start: Floats, goal: Floats) -> Floats:
    """Return the path that reached the goal.

    Its shape is (n, 2), and no point is repeated. `n` is 0 if the goal was not reached.
    """
    node, path = int(front.state[GOAL_NODE]), [goal]
    if node < 0:
        return np.empty((0, 2))
    point = int(front.nodes[node, 3])
    while point != START:
        path.append(front.points[point, 1::-1])
        point = int(front.parents[point])
    path.append(start)
    return np.array([b for a, b in zip([None, *path], path, strict=False) if a is None or (a != b).any()])[::-1]


def push_from_corners(cells: Cells, first: int, shape: tuple[int, int], path: Floats, also: bool) -> Floats:
    """Move the corners of a path away from obstacles.

    They move by :data:`NUDGE` away from the cell that the path turns around. Look-ups of edges refuse an edge that
    touches a cell that is not FREE, although the border is proven with the FREE cells beside it. With ``also``, the
    path gets further points, beside the corners that its edges touch. Paths have shape (n, 2), in cells.
    """
    points = [path[0]]
    for a, b in itertools.pairwise(path):
        beside = corners_beside(cells, first, shape[0], shape[1], a, b) if also else b[None]
        points.extend(beside if also else [])
        points.append(b)
    moved = [pushed_away(cells, first, shape[0], shape[1], point[0], point[1]) for point in points[1:-1]]
    return np.array([points[0], *moved, points[-1]])


def _first_front() -> Front:
    """Allocate an empty search, with memory for :data:`INITIAL_CAPACITY` nodes."""
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
    """Double the memory of a search that needs it.

    It is doubled if less than half is left.
    """
    node_capacity, point_capacity = len(front.bounds), len(front.parents)
    if 2 * front.state[FRONT_NODES] > node_capacity:
        larger = [np.concatenate([each, np.empty_like(each)]) for each in front[:4]]
        front = front._replace(intervals=larger[0], nodes=larger[1], heap=larger[2], bounds=larger[3])
    if 2 * front.state[FRONT_POINTS] > point_capacity:
        table = np.full(2 * len(front.table), -1)
        both = [np.concatenate([each, np.empty_like(each)]) for each in (front.points, front.parents)]
        front = front._replace(points=both[0], parents=both[1], table=table)
        rehash(front)
    return front


@jit
def find_runs(cells: Cells, first: int, rows: int, columns: int, max_state: int) -> Runs:
    """Find the runs of passable cells in each row.

    Passable cells have state at most `max_state`. ``first`` is the index of the slice's first cell.
    """
    # The first pass counts the runs of each row, the second writes them.
    ends = np.zeros(rows + 1, dtype=np.int64)
    for i in range(rows):
        ends[i + 1] = ends[i] + _find_row(cells, first + i * columns, columns, max_state, ends[:0], ends[:0])
    low, high = np.empty(ends[rows], dtype=np.int64), np.empty(ends[rows], dtype=np.int64)
    for i in range(rows):
        row_runs = slice(ends[i], ends[i + 1])
        _find_row(cells, first + i * columns, columns, max_state, low[row_runs], high[row_runs])
    return Runs(ends, low, high)


@kernel
def _find_row(cells: Cells, first: int, columns: int, max_state: int, low: Ints, high: Ints) -> int:
    """Count the runs of passable cells in a row.

    ``first`` is the index of the row's first cell. `low` and `high` get the first cell of each run and the cell after
    its last; if they are empty, nothing is written.
    """
    run, inside = 0, False
    for block in range(0, columns, 64):
        # A word has a bit for each of 64 cells. The next set bit ends a run, the next clear bit begins one.
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
    """Return the run of a row that contains u.

    A run contains its ends. Returns -1 if no run contains u.
    """
    run = _first_beyond(runs, row, u)
    if run > runs.first[row] and runs.high[run - 1] >= u:
        return run - 1
    return run if run < runs.first[row + 1] and runs.low[run] <= u else -1


@kernel
def _first_beyond(runs: Runs, row: int, u: float) -> int:
    """Find the first run that ends beyond u.

    It is sought in one row; the result is the first run of the next row if there is none.
    """
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
    runs: Runs, front: Front, start: tuple[float, float], goal: tuple[float, float], start_run: int, goal_run: int
) -> None:
    """Add the start and the intervals visible from it."""
    front.points[START] = start[0], start[1], 0.0
    front.parents[START] = -1
    front.state[FRONT_POINTS] = 1
    row = 0
    while runs.first[row + 1] <= start_run:
        row += 1
    low, high = float(runs.low[start_run]), float(runs.high[start_run])
    for side in range(2):
        _add_intervals(runs, front, goal, START, row, side == 1, start_run, low, high)


@kernel
def expand_nodes(runs: Runs, front: Front, goal: tuple[float, float], goal_run: int) -> bool:
    """Expand search nodes; return True when the search is over.

    The node of lowest bound comes first. It returns False after :data:`NODES_PER_STEP` nodes, and if memory for nodes
    or points may run out.
    """
    nodes, state = front.nodes, front.state
    for _ in range(NODES_PER_STEP):
        if state[FRONT_WAITING] == 0:
            return True
        if 2 * state[FRONT_NODES] > len(front.bounds) or 2 * state[FRONT_POINTS] > len(front.parents):
            return False
        node = _pop(front)
        if nodes[node, 0] < 0:
            state[GOAL_NODE] = node
            return True
        root_u, root_v, length = front.points[nodes[node, 3]]
        if length > _length_to(front, root_u, root_v, nodes[node, 3]):
            continue  # a shorter path to its turning point was found since
        if root_v == nodes[node, 1] >> 1:
            _expand_along_line(runs, front, goal, goal_run, node)
        else:
            _expand_through_interval(runs, front, goal, goal_run, node)
    return False


@kernel
def _expand_along_line(runs: Runs, front: Front, goal: tuple[float, float], goal_run: int, node: int) -> None:
    """Expand a node whose root lies on its line.

    The path runs along the line of the interval to its nearest point, from which the whole run is visible.
    """
    run, line, ahead = front.nodes[node, 0], front.nodes[node, 1] >> 1, (front.nodes[node, 1] & 1) == 1
    root, (low, high) = front.nodes[node, 3], front.intervals[node]
    row = line if ahead else line - 1
    left, right = float(runs.low[run]), float(runs.high[run])
    near = min(max(front.points[root, 0], low), high)
    if near != front.points[root, 0]:
        root = _turn_at(front, near, float(line), root)
        if root < 0:
            return
    if run == goal_run:
        _add_goal(front, goal, root)
    _add_intervals(runs, front, goal, root, row, ahead, run, left, right)
    # It may go on along the line, past a cell that is not passable, and leave the run on the side it came from.
    if near == high or root == START:
        _add_intervals(runs, front, goal, root, row, not ahead, run, left, low)
    if near == low or root == START:
        _add_intervals(runs, front, goal, root, row, not ahead, run, high, right)


@kernel
def _expand_through_interval(runs: Runs, front: Front, goal: tuple[float, float], goal_run: int, node: int) -> None:
    """Expand a node whose root sees through its interval.

    Paths go on straight to the part of the far side that the root sees. If an end of the interval is a corner, they
    also turn there, into the part of the run behind it.
    """
    run, line, ahead = front.nodes[node, 0], front.nodes[node, 1] >> 1, (front.nodes[node, 1] & 1) == 1
    low_turns, high_turns = (front.nodes[node, 2] & LOW_IS_CORNER) > 0, (front.nodes[node, 2] & HIGH_IS_CORNER) > 0
    root, (low, high) = front.nodes[node, 3], front.intervals[node]
    root_u, root_v = front.points[root, 0], front.points[root, 1]
    row = line if ahead else line - 1
    far_line = line + 1 if ahead else line - 1
    left, right = float(runs.low[run]), float(runs.high[run])
    # The rays from the root through both ends of the interval bound the visible part of the far side.
    stretch = (far_line - root_v) / (line - root_v)
    seen_low = min(max(_snapped(root_u + (low - root_u) * stretch), left), right)
    seen_high = max(min(_snapped(root_u + (high - root_u) * stretch), right), left)
    # The goal is visible if the segment to it crosses the interval; otherwise the path turns at the nearer end.
    if run == goal_run:
        crossing = root_u + (goal[0] - root_u) * (line - root_v) / (goal[1] - root_v)
        end = low if crossing < low - ROUNDING else high
        if low - ROUNDING <= crossing <= high + ROUNDING:
            _add_goal(front, goal, root)
        elif low_turns if end == low else high_turns:
            turn = _turn_at(front, end, float(line), root)
            if turn >= 0:
                _add_goal(front, goal, turn)
    _add_intervals(runs, front, goal, root, row, ahead, run, seen_low, seen_high)
    if low_turns and (seen_low > left or low > left):
        turn = _turn_at(front, low, float(line), root)
        if turn >= 0:
            _add_intervals(runs, front, goal, turn, row, ahead, run, left, seen_low)
            _add_intervals(runs, front, goal, turn, row, not ahead, run, left, low)
    if high_turns and (seen_high < right or high < right):
        turn = _turn_at(front, high, float(line), root)
        if turn >= 0:
            _add_intervals(runs, front, goal, turn, row, ahead, run, seen_high, right)
            _add_intervals(runs, front, goal, turn, row, not ahead, run, high, right)


@kernel
def _snapped(u: float) -> float:
    """Round u to a corner within :data:`ROUNDING`."""
    return round(u) if abs(u - round(u)) < ROUNDING else u


@kernel
def _crossing(ru: float, rv: float, gu: float, gv: float, line: int, low: float, high: float) -> float:
    """Return where a shortest path crosses an interval.

    The path leads from a root (ru, rv) to a goal (gu, gv); the interval [low, high] lies on the line v = `line`. A goal
    on the root's side of the line is mirrored at it.
    """
    if (gv - line) * (rv - line) > 0.0:
        gv = 2.0 * line - gv
    if rv == line or gv == rv:
        return min(max(ru, low), high)
    return min(max(ru + (gu - ru) * (line - rv) / (gv - rv), low), high)


@kernel
def _add_goal(front: Front, goal: tuple[float, float], root: int) -> None:
    """Add a node that reaches the goal.

    Its path goes straight from a turning point to the goal.
    """
    root_u, root_v, length = front.points[root]
    front.nodes[front.state[0]] = -1, 0, 0, root
    _push(front, length + math.hypot(goal[0] - root_u, goal[1] - root_v))


@kernel
def _add_intervals(
    runs: Runs,
    front: Front,
    goal: tuple[float, float],
    root: int,
    row: int,
    ahead: bool,
    run: int,
    low: float,
    high: float,
) -> None:
    """Add a node for each neighboring run in reach.

    These runs touch one side of a run between two points. The run lies in `row`. ``ahead`` selects its side of larger
    v; `low` and `high` are the points along u.
    """
    next_row, line = row + 1 if ahead else row - 1, row + 1 if ahead else row
    if low >= high or next_row < 0 or next_row >= len(runs.first) - 1:
        return
    other = _first_beyond(runs, next_row, low)
    while other < runs.first[next_row + 1] and runs.low[other] < high:
        # Where a run begins or ends beside the other, a cell that is not passable has a corner.
        corner_low, corner_high = max(runs.low[other], runs.low[run]), min(runs.high[other], runs.high[run])
        node, begin, end = front.state[FRONT_NODES], max(low, float(corner_low)), min(high, float(corner_high))
        if begin < end:
            front.intervals[node] = begin, end
            turns = (LOW_IS_CORNER if begin == corner_low else 0) + (HIGH_IS_CORNER if end == corner_high else 0)
            front.nodes[node] = other, 2 * line + (1 if ahead else 0), turns, root
            _push(front, _bound(front, root, line, begin, end, goal))
        other += 1


@kernel
def _slot(front: Front, u: float, v: float) -> int:
    """Return the hash table's slot of a corner.

    It is the empty slot where a new corner belongs.
    """
    table, points = front.table, front.points
    slot = (int(u) * 73856093 ^ int(v) * 19349663) & (len(table) - 1)
    while table[slot] >= 0 and (points[table[slot], 0] != u or points[table[slot], 1] != v):
        slot = (slot + 1) & (len(table) - 1)
    return slot


@kernel
def _length_to(front: Front, u: float, v: float, point: int) -> float:
    """Return the shortest known path length to a point.

    The point is a turning point at (u, v), with its index.
    """
    if point == START:
        return 0.0
    return float(front.points[front.table[_slot(front, u, v)], 2])


@kernel
def _turn_at(front: Front, u: float, v: float, parent: int) -> int:
    """Add a turning point, and return its index.

    The path goes straight from `parent` to (u, v). Returns -1 if a shorter path to the corner is known.
    """
    points, state = front.points, front.state
    length = points[parent, 2] + math.hypot(u - points[parent, 0], v - points[parent, 1])
    slot = _slot(front, u, v)
    known = front.table[slot]
    if known >= 0:
        if points[known, 2] < length - ROUNDING:
            return -1
        if points[known, 2] <= length:
            return int(known)
    point = int(state[FRONT_POINTS])
    points[point] = u, v, length
    front.parents[point] = parent
    front.table[slot] = point
    state[FRONT_POINTS] += 1
    return point


@kernel
def rehash(front: Front) -> None:
    """Enter all turning points into the hash table.

    The table is empty; the start is left out. The last point added at a corner has the shortest path, so it replaces
    the others.
    """
    for point in range(1, front.state[FRONT_POINTS]):
        front.table[_slot(front, front.points[point, 0], front.points[point, 1])] = point


@kernel
def _bound(front: Front, root: int, line: int, low: float, high: float, goal: tuple[float, float]) -> float:
    """Return a lower bound of the length of paths.

    The paths lead from a root through an interval to the goal. The interval [low, high] lies on the line v = `line`;
    other obstacles are ignored.
    """
    root_u, root_v, length = front.points[root]
    crossing = _crossing(root_u, root_v, goal[0], goal[1], line, low, high)
    return float(length) + math.hypot(crossing - root_u, line - root_v) + math.hypot(goal[0] - crossing, goal[1] - line)


@kernel
def _push(front: Front, bound: float) -> None:
    """Put the newest node into the heap."""
    heap, bounds, state = front.heap, front.bounds, front.state
    node = state[FRONT_NODES]
    bounds[node] = bound
    child = state[FRONT_WAITING]
    state[FRONT_NODES] += 1
    state[FRONT_WAITING] += 1
    while child > 0:
        parent = (child - 1) // 2
        if bounds[heap[parent]] <= bound:
            break
        heap[child] = heap[parent]
        child = parent
    heap[child] = node


@kernel
def _pop(front: Front) -> int:
    """Remove and return the node of lowest bound."""
    heap, bounds, state = front.heap, front.bounds, front.state
    top = heap[0]
    state[FRONT_WAITING] -= 1
    count, last = state[FRONT_WAITING], heap[state[FRONT_WAITING]]
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
    """Return the direction from a corner away from obstacles.

    It leads away from the only cell at the corner that is not FREE. The corner is (v, u), and the slice has ``rows``
    and ``columns``, its first cell at index ``first``. Returns (0, 0) if none or several of the four cells at the
    corner are not FREE.
    """
    count, dv, du = 0, 0, 0
    for i in range(v - 1, v + 1):
        for j in range(u - 1, u + 1):
            if not (0 <= i < rows and 0 <= j < columns) or state_in(cells, first + i * columns + j) != FREE:
                count += 1
                dv, du = (1 if i < v else -1), (1 if j < u else -1)
    return (dv, du) if count == 1 else (0, 0)


@kernel
def pushed_away(cells: Cells, first: int, rows: int, columns: int, v: float, u: float) -> tuple[float, float]:
    """Move a corner away from obstacles by :data:`NUDGE`.

    It moves away from its only cell that is not FREE; it stays where it is if none or several cells are not FREE.
    """
    dv, du = _away_from(cells, first, rows, columns, int(v), int(u))
    return v + NUDGE * dv, u + NUDGE * du


@jit
def corners_beside(cells: Cells, first: int, rows: int, columns: int, a: Floats, b: Floats) -> Floats:
    """List the obstacle corners that a segment nearly touches.

    The segment from `a` to `b` passes them within twice :data:`NUDGE`. Only corners at which exactly one of four cells
    is not FREE count. Points are in cells, shape (2,); the result has shape (n, 2). ``first`` is the index of the
    slice's first cell; the slice has ``rows`` and ``columns``.
    """
    steep = abs(b[0] - a[0]) > abs(b[1] - a[1])
    along, across = (0, 1) if steep else (1, 0)
    corners = np.empty((int(abs(b[along] - a[along])) + 2, 2))
    # Visit each grid line across the segment's longer axis; there, only the nearest corner can be that close.
    count, step = 0, 1.0 if b[along] > a[along] else -1.0
    line = math.floor(a[along]) + 1.0 if step > 0.0 else math.ceil(a[along]) - 1.0
    while (b[along] - line) * step > 0.0:
        crossing = a[across] + (b[across] - a[across]) * (line - a[along]) / (b[along] - a[along])
        nearest = round(crossing)
        if abs(crossing - nearest) < 2.0 * NUDGE:
            v, u = (line, nearest) if steep else (nearest, line)
            if _away_from(cells, first, rows, columns, int(v), int(u)) != (0, 0):
                corners[count] = v, u
                count += 1
        line += step
    return corners[:count]

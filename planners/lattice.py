"""Search on a lattice of headings, for robots that turn on the spot and for cars.

Two searches follow each other. The first goes by FREE cells alone, from the goal: a robot drives from cell to cell
along one of its headings, and turns on the spot from one heading to the next. It gives the cost to the goal from every
cell and heading. The second starts at the start and follows these costs. It keeps one configuration for each cell and
heading (hybrid A*), so positions are not rounded, and the map proves each motion. At last the path is shortened.

References
----------
M. Pivtoraiko and A. Kelly, "Efficient constrained path planning via search in state lattices", 2005; D. Dolgov,
S. Thrun, M. Montemerlo and J. Diebel, "Practical search techniques in path planning for autonomous driving", 2008.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple, cast

import numpy as np

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints, Words
from cspace.compiling import clock, jit, kernel
from cspace.map.edges import edge_is_free
from cspace.map.points import around_is_free
from cspace.map.search import BUCKETS_PER_CELL, Costs, check_deadline
from cspace.map.storage import Map
from cspace.rotations.base import METRES_PER_RADIAN, TWO_PI, wrapped
from cspace.rotations.yaw import shorter_angle
from planners.car_curves import MAX_GAP, POINT_ERROR, Pose, prove_length, shortest_word, word_is_free
from planners.local_planner import CURVES, EdgesOnMap, Endpoints

MAX_STEP_CELLS: Final = 2
"""Largest number of cells along x and y of a drive straight on, which gives 16 headings."""

MAX_OWN_STEP_CELLS: Final = 4
"""The same for drives at about the yaw of start or goal."""

CAR_HEADINGS: Final = (24, 48, 96)
"""Headings of the lattices of a car; an arc leads from one to the next."""

MAX_NODES: Final = (100_000, 200_000, 800_000)
"""Nodes after which the search gives up, or goes on with the next finer lattice of a car."""

CAR_GREED: Final = 1.5
"""Weight of the remaining cost for cars; above 1, paths are found sooner but may be longer."""

REVERSE_WEIGHT: Final = 1.5
"""Metres that a car's metre in reverse counts as."""

SWITCH_RADII: Final = 0.5
"""Turning radii that a car's change of direction counts as."""

UNREACHED_CELLS: Final = 400.0
"""Cells added to the cost of the start, for places that the first search did not reach."""

MARGIN_CELLS: Final = (4.0, 60.0)
"""Cells of cost by which the first search goes on past the start: on the spot, and for cars."""

CURVE_RADII: Final = 6.0
"""Turning radii from the goal within which the length of curves without obstacles is computed."""

QUEUE_BUCKETS: Final = 2**16
"""Buckets of each queue (see :mod:`cspace.map.search`); costs beyond them share the last one."""

NODES_PER_CLOCK_CHECK: Final = 2**12
"""Nodes expanded between two looks at the clock."""

NODES_PER_GOAL_EDGE: Final = 16
"""Nodes far from the goal, of which one is joined to it by an edge, if that is free."""

INITIAL_LATTICE_NODES: Final = 2**15
"""Nodes for which there is memory at first; it doubles as needed."""

PAD: Final = 4
"""Cells around the map, not FREE, that keep motions in the arrays of the first search."""

COST_TOLERANCE: Final = 0.01
"""Share of a cell's side by which a path into a cell must be cheaper to replace the one known."""

KNOWN_TOLERANCE: Final = 1e-3
"""Cells by which the cost of a state must be lower to replace the one known."""

KEY_BITS: Final = 24
"""Bits of the number of a cell along y."""

HASH_FACTOR: Final = 0x9E3779B97F4A7C1
"""Odd factor that spreads keys over the hash table (D. Knuth, "Sorting and Searching", 6.4)."""

TIE_RADIANS: Final = 1e-9
"""Difference of rotations below which driving ahead and back count as equal."""

COST_PER_EDGE: Final = 1e-6
"""Metres that an edge counts as when a path is shortened, so that straight drives become one."""

SHORTENING_ROUNDS: Final = 2
"""Rounds in which a path is shortened."""

MAX_SHORTCUTS: Final = 60
"""Largest number of earlier waypoints from which an edge to a waypoint is sought."""

POINTS_PER_PATH: Final = 100
"""Points added along the straight drives of a path to shorten it."""


class Cells(NamedTuple):
    """Lattice of cells and h headings. States are numbered ``place * h + heading``, places row by row with a margin.

    Attributes
    ----------
    free, turns : ndarray of uint64, shape (places,)
        Bit k is set if the place is FREE at heading k, and if the robot may turn from heading k to the next.
    width : int
        Places in a row.
    steps : ndarray of int64, shape (h,)
        Change of place by a drive.
    touched : ndarray of int64, shape (h, n)
        Places between the ends of a drive that it touches, relative to its start.
    lengths, angles : ndarray of float64, shape (h,)
        Cost of a drive, and of the turn to the next heading, in cells.
    reverses : bool
        Whether the robot also drives backwards.
    start : int
        State at which the search ends.
    angles_to_start : ndarray of float64, shape (h,)
        Least cost of turning to the heading of the start, in cells.
    margin : float
        Cells of cost by which the search goes on past the start.
    """

    free: Words
    turns: Words
    width: int
    steps: Ints
    touched: Ints
    lengths: Floats
    angles: Floats
    reverses: bool
    start: int
    angles_to_start: Floats
    margin: float


class Lattice(NamedTuple):
    """Motions of a drive, m from each of h headings, and the costs to its goal.

    Attributes
    ----------
    kind : int
        Kind of the curves of a car, see :mod:`planners.car_curves`; -1 for robots that turn on the spot.
    reverses : bool
        Whether the robot also drives backwards.
    headings : ndarray of float64, shape (h,)
        Yaws.
    radius : float
        Turning radius, metres.
    side : float
        Side of the cells, each of which holds one configuration for each heading, metres.
    next_heading : ndarray of int64, shape (h, m)
        Heading after each motion.
    offsets : ndarray of float64, shape (h, m, 2)
        Displacement along each motion, metres.
    costs : ndarray of float64, shape (h, m)
        Cost of each motion, metres.
    steering, lengths : ndarray, shape (m, 5)
        Words of one segment, the motions of a car.
    goal : tuple of float
        Configuration.
    nearest : ndarray of int64, shape (h,)
        Nearest heading of the table.
    columns : int
        Number of headings of the table.
    unreached : float
        Metres added to the straight distance to the goal where the table is 0.
    table : ndarray of float32, shape (places * columns,)
        Cost from each state of :class:`Cells` to the goal, plus 1, in cells, of either sign; 0 where not reached.
    """

    kind: int
    reverses: bool
    headings: Floats
    radius: float
    side: float
    next_heading: Ints
    offsets: Floats
    costs: Floats
    steering: Ints
    lengths: Floats
    goal: Pose
    nearest: Ints
    columns: int
    unreached: float
    table: Costs


class Nodes(NamedTuple):
    """Configurations reached, and the queue of those to expand.

    Attributes
    ----------
    poses : ndarray of float64, shape (n, 3)
        Configurations.
    keys : ndarray of int64, shape (n, 2)
        Number of the cell and heading, and heading.
    costs : ndarray of float64, shape (n,)
        Cost of the path; infinite if a cheaper one into the same cell was found since.
    links : ndarray of int64, shape (n, 3)
        Node before, motion that led here, and next node in the same bucket; -1 if there is none.
    table : ndarray of int64, shape (2 ** k,)
        Hash table of nodes by cell and heading; -1 where empty.
    buckets : ndarray of int64, shape (QUEUE_BUCKETS,)
        First node of each bucket of the queue; -1 if empty.
    counts : ndarray of int64, shape (5,)
        Numbers of nodes, of waiting and of expanded ones, lowest bucket, and the node before the goal, or -1.
    best : ndarray of float64, shape (1,)
        Cost of the path to the goal.
    """

    poses: Floats
    keys: Ints
    costs: Floats
    links: Ints
    table: Ints
    buckets: Ints
    counts: Ints
    best: Floats


def find_lattice_path(edges: EdgesOnMap, endpoints: Endpoints, until: float) -> tuple[Floats, str]:
    """Find a path of a drive's edges on a map in memory.

    Returns the path, shape (n, 3), and a note on lattices that have no path. The path has length 0 if none is found,
    or the clock passes ``until``.
    """
    start, goal = cast(tuple[Pose, Pose], endpoints)
    path, note, is_car = np.empty((0, 3)), "", edges.turning_radius is not None
    yaws, cells, is_own = _list_headings(endpoints)
    try:
        table, found = _spread_costs(edges, endpoints, yaws, cells, until)
        # On the spot, the table reaches all states that may lie on the path; cars may pass between them.
        unreached = math.inf if found > 0.0 and not is_car else (found + UNREACHED_CELLS) * edges.space.grid.spacing
        note = "" if found > 0.0 or is_car else f"the lattice of {len(yaws)} headings has no path"
        for level in range(len(CAR_HEADINGS) if is_car else 1):
            motions = _car_motions(edges, start, level) if is_car else _spot_motions(edges, yaws, cells, is_own)
            nearest = np.abs(wrapped(yaws - motions[0][:, None])).argmin(axis=1)
            kind = CURVES.index(edges.drive) if is_car else -1
            lattice = Lattice(kind, _reverses(edges), *motions, goal, nearest, len(yaws), unreached, table)
            nodes = _search(edges, lattice, start, MAX_NODES[level], until)
            if nodes.counts[4] >= 0:
                traced = _trace(lattice, nodes)
                return (traced, "") if edges.are_free(traced) else (path, note)
    except TimeoutError:
        pass
    return path, note


def _list_headings(endpoints: Endpoints) -> tuple[Floats, Ints, Bools]:
    """Return ascending yaws, the cells of a drive along each, and which of them are only those of start and goal."""
    cells = _list_steps(MAX_STEP_CELLS)
    yaws, own = _yaws(cells), np.unique([q[2] for q in endpoints])
    own = own[np.abs(wrapped(yaws - own[:, None])).min(axis=1) > 1e-9]
    close = _list_steps(MAX_OWN_STEP_CELLS)
    cells = np.concatenate([cells, close[np.abs(wrapped(_yaws(close) - own[:, None])).argmin(axis=1)]])
    yaws = np.concatenate([yaws, own])
    order = np.argsort(yaws)
    return yaws[order], cells[order], order >= len(yaws) - len(own)


def _list_steps(most: int) -> Ints:
    """Return the steps of up to some cells along x and y, one for each direction, shape (n, 2)."""
    steps = itertools.product(range(-most, most + 1), repeat=2)
    return np.array([step for step in steps if math.gcd(*step) == 1])


def _yaws(steps: Ints) -> Floats:
    """Return the yaws of drives, shape (n,)."""
    return wrapped(np.arctan2(steps[:, 1], steps[:, 0]))


def _spread_costs(
    edges: EdgesOnMap, endpoints: Endpoints, yaws: Floats, steps: Ints, until: float
) -> tuple[Costs, float]:
    """Return the table of :class:`Lattice`, and its entry of the start.

    Cars may turn at cells that are FREE at both headings, because they turn as they drive.
    """
    space, grid, count, is_car = edges.space, edges.space.grid, len(yaws), edges.turning_radius is not None
    rows, width = (n + 2 * PAD for n in grid.shape)
    free, turns, strides = *np.zeros((2, rows, width), dtype=np.uint64), np.array([width, 1])
    rotations, n = space.rotations.cell_of(yaws), len(space.rotations)
    for k in range(count):
        check_deadline(until)
        first, last = int(rotations[k]), int(rotations[(k + 1) % count])
        between = [last] if is_car else [(first + i) % n for i in range(1, (last - first) % n + 1)]
        worst = space.states_at(space.rotations.centers[first])
        for bits, others in ((free, []), (turns, between)):
            for cell in others:
                worst = np.maximum(worst, space.states_at(space.rotations.centers[cell]))
            bits[PAD:-PAD, PAD:-PAD] |= (worst == FREE).astype(np.uint64) << np.uint64(k)
    weight = (edges.turning_radius or METRES_PER_RADIAN) / grid.spacing
    lists = [_touched_cells(*step) for step in steps.tolist()]
    touched = np.array([[*cells, *[(0, 0)] * (max(map(len, lists)) - len(cells))] for cells in lists])
    start, goal = (
        int((grid.cell_of(q[:2]) + PAD) @ strides) * count + int(np.abs(wrapped(yaws - q[2])).argmin())
        for q in endpoints
    )
    lattice = Cells(
        free.reshape(-1),
        turns.reshape(-1),
        width,
        steps @ strides,
        touched @ strides,
        np.hypot(*steps.T),
        weight * np.diff(yaws, append=yaws[0] + TWO_PI),
        _reverses(edges),
        start,
        weight * np.abs(wrapped(yaws - endpoints[0][2])),
        MARGIN_CELLS[is_car],
    )
    table, entries = np.zeros(free.size * count, np.float32), np.empty((INITIAL_LATTICE_NODES, 2), np.int64)
    buckets, counts = np.full(QUEUE_BUCKETS, -1), np.array([1, 1, -1, 0])
    table[goal], entries[0], buckets[0] = 1.0, (goal, -1), 0
    while not spread_costs(lattice, table, entries, buckets, counts):
        check_deadline(until)
        if counts[0] + 4 * NODES_PER_CLOCK_CHECK > len(entries):
            entries = np.concatenate([entries, np.empty_like(entries)])
    return table, float(abs(table[start]))


def _touched_cells(dx: int, dy: int) -> list[tuple[int, int]]:
    """List the closed cells, other than its ends, that a segment between the centers of two cells touches."""
    xs, ys = range(min(dx, 0), max(dx, 0) + 1), range(min(dy, 0), max(dy, 0) + 1)
    box = [cell for cell in itertools.product(xs, ys) if cell not in ((0, 0), (dx, dy))]
    return [(i, j) for i, j in box if 2 * abs(dx * j - dy * i) <= abs(dx) + abs(dy)]


def _reverses(edges: EdgesOnMap) -> bool:
    return edges.drive in ("differential-reverse", "reeds-shepp")


Motions = tuple[Floats, float, float, Ints, Floats, Floats, Ints, Floats]
"""Fields ``headings`` to ``lengths`` of :class:`Lattice`."""


def _spot_motions(edges: EdgesOnMap, yaws: Floats, cells: Ints, is_own: Bools) -> Motions:
    """Return turns on the spot to the next heading on both sides, and drives ahead and back."""
    spacing, moves = edges.space.grid.spacing, 3 + _reverses(edges)
    # At the yaw of start or goal, a step as long as a cell's diagonal leaves the cell.
    diagonals = math.sqrt(2.0) * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    steps = spacing * np.where(is_own[:, None], diagonals, cells)
    following = (np.arange(len(yaws))[:, None] + [1, -1, 0, 0]) % len(yaws)
    offsets = np.stack([0.0 * steps, 0.0 * steps, steps, -steps], axis=1)[:, :moves]
    costs = METRES_PER_RADIAN * np.abs(wrapped(yaws[following] - yaws[:, None]))[:, :moves]
    costs += np.linalg.norm(offsets, axis=2)
    contiguous, words = np.ascontiguousarray, (np.zeros((moves, 5), dtype=np.int64), np.zeros((moves, 5)))
    return yaws, 0.0, spacing, contiguous(following[:, :moves]), contiguous(offsets), contiguous(costs), *words


def _car_motions(edges: EdgesOnMap, start: Pose, level: int) -> Motions:
    """Return arcs of a car to the next heading on both sides, and drives straight on, ahead and in reverse."""
    count, radius = CAR_HEADINGS[level], float(edges.turning_radius or math.nan)
    arc, spacing = TWO_PI / count, edges.space.grid.spacing
    yaws = wrapped(np.asarray(start[2] + arc * np.arange(count), dtype=np.float64))
    side = max(2.0 * radius * math.sin(0.5 * arc), spacing) / math.sqrt(2.0)
    straight, moves = max(arc * radius, 1.01 * math.sqrt(2.0) * side), 3 + 3 * _reverses(edges)
    steering, signs = np.tile([1, -1, 0], 2)[:moves], np.repeat([1, -1], 3)[:moves]
    metres = signs * np.where(steering, arc * radius, straight)
    following = (np.arange(count)[:, None] + steering * signs) % count
    first, last, turn = yaws[:, None], yaws[following], steering * radius
    x = np.where(steering, turn * (np.sin(last) - np.sin(first)), metres * np.cos(first))
    y = np.where(steering, turn * (np.cos(first) - np.cos(last)), metres * np.sin(first))
    costs = np.tile(np.abs(metres) * np.where(signs < 0, REVERSE_WEIGHT, 1.0), (count, 1))
    words = np.zeros((moves, 5), dtype=np.int64), np.zeros((moves, 5))
    words[0][:, 0], words[1][:, 0] = steering, metres / radius
    return yaws, radius, side, following, np.stack([x, y], axis=2), costs, *words


def _search(edges: EdgesOnMap, lattice: Lattice, start: Pose, max_nodes: int, until: float) -> Nodes:
    """Search from the start until a path is found, there is none, or nodes are used up."""
    map_, count = edges.space._kernel_map, INITIAL_LATTICE_NODES
    map_ = map_._replace(exterior=np.full_like(map_.exterior, MIXED))  # no motion leaves the grid
    arrays = np.empty((count, 3)), np.empty((count, 2), np.int64), np.empty(count), np.empty((count, 3), np.int64)
    counts = np.array([0, 0, 0, 0, -1])
    nodes = Nodes(*arrays, np.full(4 * count, -1), np.full(QUEUE_BUCKETS, -1), counts, np.array([math.inf]))
    begin_search(map_, lattice, nodes, start)
    while not expand_nodes(map_, lattice, nodes) and nodes.counts[0] < max_nodes:
        check_deadline(until)
        if 2 * nodes.counts[0] > len(nodes.costs):
            larger = [np.concatenate([each, np.empty_like(each)]) for each in nodes[:4]]
            nodes = Nodes(*larger, np.full(2 * len(nodes.table), -1), *nodes[5:])  # type: ignore[call-arg]  # eight fields
            rehash(nodes)
    return nodes


def _trace(lattice: Lattice, nodes: Nodes) -> Floats:
    """Return the configurations from the start to the goal, without those amid a straight drive of lattice motions."""
    node, rows, drive = int(nodes.counts[4]), [lattice.goal], -1
    while node >= 0:
        before, move = nodes.links[node, :2].tolist()
        if lattice.kind >= 0 or move < 2 or move != drive:
            rows.append(tuple(nodes.poses[node].tolist()))
        node, drive = before, move
    return np.array([b for a, b in zip([None, *rows], rows, strict=False) if a != b])[::-1]


def shorten_path(edges: EdgesOnMap, path: Floats, until: float) -> Floats:
    """Return the cheapest path over waypoints of a path, and points between them, with edges that are proven free.

    After ``until``, no more shortcuts are sought.
    """
    check, given = edges.edge_checker(), path
    for _ in range(SHORTENING_ROUNDS):
        steps = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
        rows, gap = [path[:1]], steps.sum() / POINTS_PER_PATH
        for a, b, step in zip(path[:-1], path[1:], steps.tolist(), strict=True):
            count = int(step / gap) if edges.turning_radius is None and a[2] == b[2] else 1
            rows += [a + np.arange(1, count)[:, None] / count * (b - a), b[None]]
        path = np.concatenate(rows)
        before, total = np.zeros(len(path), dtype=np.int64), np.zeros(len(path))
        apart = np.unique(np.geomspace(1, len(path), MAX_SHORTCUTS).astype(np.int64))
        for k in range(1, len(path)):
            first = k - apart[apart <= k]
            costs = total[first] + _edge_costs(edges, path[first], path[k]) + COST_PER_EDGE
            for index in np.argsort(costs, kind="stable").tolist():
                # The edge from the waypoint before belongs to the path.
                if index == 0 or (clock() < until and check(*path[first[index]].tolist(), *path[k].tolist())):
                    before[k], total[k] = first[index], costs[index]
                    break
        chain = [len(path) - 1]
        while chain[-1] > 0:
            chain.append(int(before[chain[-1]]))
        path = edges.remove_turns(path[chain[::-1]])
    return path if edges.are_free(path) else given  # rounding may make a part of an edge fail


def _edge_costs(edges: EdgesOnMap, starts: Floats, end: Floats) -> Floats:
    """Return the costs of edges to a configuration, shape (n,)."""
    if edges.turning_radius is None:
        return edges.edge_lengths(starts, np.tile(end, (len(starts), 1)))
    costs = np.empty(len(starts))
    curve_costs(CURVES.index(edges.drive), edges.turning_radius, starts, end, costs)
    return costs


@kernel
def spread_costs(cells: Cells, table: Costs, entries: Ints, buckets: Ints, counts: Ints) -> bool:
    """Expand states from the goal, the one of least bound first; return True if the search is through.

    ``table`` is negative where a state was expanded. ``entries`` are states and the next entry in the same bucket;
    ``counts`` are the entries in use and waiting, the first free one, and the lowest bucket. It returns False for a
    look at the clock, and for more memory.
    """
    free, turns, touched, width, one = cells.free, cells.turns, cells.touched, cells.width, np.uint64(1)
    count, start = len(cells.steps), cells.start // len(cells.steps)
    for _ in range(NODES_PER_CLOCK_CHECK):
        while counts[1] > 0 and buckets[counts[3]] < 0:
            counts[3] += 1
        found = abs(table[cells.start])
        if counts[1] == 0 or (found > 0.0 and counts[3] > BUCKETS_PER_CELL * (found - 1.0 + cells.margin)):
            return True
        entry = buckets[counts[3]]
        state, buckets[counts[3]] = entries[entry, 0], entries[entry, 1]
        counts[1] -= 1
        entries[entry, 1], counts[2] = counts[2], entry
        if table[state] < 0.0:
            continue
        place, k, cost = state // count, state % count, float(table[state])
        bit = one << np.uint64(k)
        table[state] = -cost
        for move in range(4 if cells.reverses else 3):
            if move < 2:
                turn = (k + count - move) % count
                if not (turns[place] >> np.uint64(turn)) & one:
                    continue
                other = place * count + (k + 1 - 2 * move + count) % count
                total = cost + cells.angles[turn]
            else:
                # The robot drives ahead to this place, or back to it.
                step = cells.steps[k] if move == 3 else -cells.steps[k]
                rear, seen = min(move - 2, 1) * place + (3 - move) * (place + step), free[place] & free[place + step]
                for n in range(touched.shape[1]):
                    seen &= free[rear + touched[k, n]]
                if not seen & bit:
                    continue
                other, total = (place + step) * count + k, cost + cells.lengths[k]
            known = abs(table[other])
            if known > 0.0 and known <= total + KNOWN_TOLERANCE:
                continue
            table[other] = total
            i, j = (other // count) // width - start // width, (other // count) % width - start % width
            bound = total - 1.0 + math.hypot(i, j) + cells.angles_to_start[other % count]
            bucket = max(min(int(BUCKETS_PER_CELL * bound), QUEUE_BUCKETS - 1), counts[3])
            if counts[2] >= 0:
                entry, counts[2] = counts[2], entries[counts[2], 1]
            else:
                entry = counts[0]
                counts[0] += 1
            entries[entry, 0], entries[entry, 1], buckets[bucket] = other, buckets[bucket], entry
            counts[1] += 1
    return False


@jit
def begin_search(map_: Map, lattice: Lattice, nodes: Nodes, start: Pose) -> None:
    """Add the start."""
    heading = 0
    for k in range(len(lattice.headings)):
        if abs(shorter_angle(start[2], lattice.headings[k])) < abs(shorter_angle(start[2], lattice.headings[heading])):
            heading = k
    _add(map_, lattice, nodes, start, heading, 0.0, -1, -1)


@jit
def expand_nodes(map_: Map, lattice: Lattice, nodes: Nodes) -> bool:
    """Expand nodes, the one of least bound first; return True if the search is through.

    It returns False for a look at the clock, and for more memory.
    """
    counts, links, goal, is_car = nodes.counts, nodes.links, lattice.goal, lattice.kind >= 0
    for _ in range(NODES_PER_CLOCK_CHECK):
        while counts[1] > 0 and nodes.buckets[counts[3]] < 0:
            counts[3] += 1
        if counts[1] == 0 or counts[3] >= BUCKETS_PER_CELL * nodes.best[0] / map_.spacing:
            return True
        if 2 * counts[0] > len(nodes.costs):
            return False
        node = nodes.buckets[counts[3]]
        nodes.buckets[counts[3]] = links[node, 2]
        counts[1] -= 1
        cost, heading = nodes.costs[node], nodes.keys[node, 1]
        if cost == math.inf:
            continue
        counts[2] += 1
        x, y, yaw = nodes.poses[node]
        apart = math.hypot(x - goal[0], y - goal[1])
        if counts[2] % NODES_PER_GOAL_EDGE == 0 or apart < max(4.0 * lattice.radius, 8.0 * map_.spacing):
            total = cost + _cost_to_goal(map_, lattice, (x, y, yaw))
            if total < nodes.best[0]:
                nodes.best[0], counts[4] = total, node
                if is_car:  # its remaining costs are no lower bounds anyway
                    return True
        for move in range(lattice.next_heading.shape[1]):
            after, step = lattice.next_heading[heading, move], lattice.costs[heading, move]
            u, v = x + lattice.offsets[heading, move, 0], y + lattice.offsets[heading, move, 1]
            if abs(u - goal[0]) + abs(v - goal[1]) < 1e-6 * lattice.side:
                u, v = goal[0], goal[1]  # else rounding would give the last edge a heading
            if is_car and links[node, 1] >= 0 and lattice.lengths[links[node, 1], 0] * lattice.lengths[move, 0] < 0.0:
                step += SWITCH_RADII * lattice.radius
            if map_.lower[0] <= u <= map_.upper[0] and map_.lower[1] <= v <= map_.upper[1]:
                _add(map_, lattice, nodes, (u, v, lattice.headings[after]), after, cost + step, node, move)
    return False


@jit
def _add(map_: Map, lattice: Lattice, nodes: Nodes, q: Pose, heading: int, cost: float, parent: int, move: int) -> None:
    """Add a node, if it is the cheapest of its cell, may beat the best path, and its motion is proven free."""
    i, j = math.floor((q[0] - map_.lower[0]) / lattice.side), math.floor((q[1] - map_.lower[1]) / lattice.side)
    key = ((i << KEY_BITS) + j) * len(lattice.headings) + heading
    slot, spare = _slot(nodes, key), MAX_GAP * (1.0 + TWO_PI) + POINT_ERROR
    known = nodes.table[slot]
    if known >= 0 and nodes.costs[known] <= cost + COST_TOLERANCE * lattice.side:
        return
    bound = cost + (CAR_GREED if lattice.kind >= 0 else 1.0) * _remaining(map_, lattice, q, heading)
    if not bound < nodes.best[0]:  # or infinite
        return
    if parent >= 0:
        p = (nodes.poses[parent, 0], nodes.poses[parent, 1], nodes.poses[parent, 2])
        if lattice.kind < 0:
            if not _is_free(map_, p, q):
                return
        elif not around_is_free(map_, q, spare * lattice.radius, spare) or not word_is_free(
            map_, lattice.radius, p, lattice.steering[move], lattice.lengths[move], spare
        ):
            return
    if known >= 0:
        nodes.costs[known] = math.inf
    node, bucket = nodes.counts[0], min(int(BUCKETS_PER_CELL * bound / map_.spacing), QUEUE_BUCKETS - 1)
    nodes.poses[node], nodes.keys[node], nodes.costs[node], nodes.table[slot] = q, (key, heading), cost, node
    nodes.links[node] = parent, move, nodes.buckets[bucket]
    nodes.buckets[bucket] = node
    nodes.counts[0] += 1
    nodes.counts[1] += 1
    nodes.counts[3] = min(bucket, nodes.counts[3])


@kernel
def _slot(nodes: Nodes, key: int) -> int:
    """Return the slot of a cell and heading in the hash table, or the empty slot where it belongs."""
    slot = (key * HASH_FACTOR >> 20) & (len(nodes.table) - 1)
    while nodes.table[slot] >= 0 and nodes.keys[nodes.table[slot], 0] != key:
        slot = (slot + 1) & (len(nodes.table) - 1)
    return slot


@kernel
def rehash(nodes: Nodes) -> None:
    """Enter all nodes into an empty hash table; the last of each cell and heading is the cheapest."""
    for node in range(nodes.counts[0]):
        nodes.table[_slot(nodes, nodes.keys[node, 0])] = node


@jit
def _remaining(map_: Map, lattice: Lattice, q: Pose, heading: int) -> float:
    """Return about the least cost from a configuration to the goal."""
    nx, ny = map_.states.shape[1], map_.states.shape[2]
    i = min(math.floor((q[0] - map_.lower[0]) / map_.spacing), nx - 1) + PAD
    j = min(math.floor((q[1] - map_.lower[1]) / map_.spacing), ny - 1) + PAD
    cells = abs(lattice.table[(i * (ny + 2 * PAD) + j) * lattice.columns + lattice.nearest[heading]]) - 1.0
    apart = math.hypot(q[0] - lattice.goal[0], q[1] - lattice.goal[1])
    metres = max(apart, cells * map_.spacing if cells >= 0.0 else apart + lattice.unreached)
    if metres < CURVE_RADII * lattice.radius:
        metres = max(metres, _curve_cost(lattice.kind, lattice.radius, q, lattice.goal))
    return metres


@jit
def _cost_to_goal(map_: Map, lattice: Lattice, q: Pose) -> float:
    """Return the cost of the edge from a configuration to the goal; infinite if it is not proven free."""
    (x, y, yaw), goal = q, lattice.goal
    if lattice.kind >= 0:
        proven = prove_length(map_, lattice.kind, lattice.radius, x, y, yaw, goal[0], goal[1], goal[2]) >= 0.0
        return _curve_cost(lattice.kind, lattice.radius, q, goal) if proven else math.inf
    metres, heading, radians = math.hypot(goal[0] - x, goal[1] - y), yaw, abs(shorter_angle(yaw, goal[2]))
    if metres > 0.0:
        ahead = math.atan2(goal[1] - y, goal[0] - x)
        heading, radians = ahead, abs(shorter_angle(yaw, ahead)) + abs(shorter_angle(ahead, goal[2]))
        back = ahead - math.copysign(math.pi, ahead)
        reverse = abs(shorter_angle(yaw, back)) + abs(shorter_angle(back, goal[2]))
        if lattice.reverses and abs(reverse - radians) < TIE_RADIANS:
            return math.inf  # rounding decides which way the robot drives
        if lattice.reverses and reverse < radians:
            heading, radians = back, reverse
    first, last = (x, y, heading), (goal[0], goal[1], heading)
    proven = _is_free(map_, q, first) and _is_free(map_, last, goal)
    return metres + METRES_PER_RADIAN * radians if proven and _is_free(map_, first, last) else math.inf


@kernel
def _is_free(map_: Map, q0: Pose, q1: Pose) -> bool:
    """Return True if a straight edge is proven free; compiled once, because it is long."""
    return edge_is_free(map_, None, q0, q1)


@jit
def curve_costs(kind: int, radius: float, starts: Floats, end: Floats, out: Floats) -> None:
    """Write the costs of the shortest curves to a configuration."""
    for k in range(len(starts)):
        out[k] = _curve_cost(kind, radius, (starts[k, 0], starts[k, 1], starts[k, 2]), (end[0], end[1], end[2]))


@jit
def _curve_cost(kind: int, radius: float, q0: Pose, q1: Pose) -> float:
    """Return the cost of the shortest curve of a car, with reversing and changes of direction."""
    _, lengths, _ = shortest_word(kind, radius, q0, q1)
    total, last = 0.0, 0.0
    for length in lengths:
        if abs(length) > MAX_GAP:
            total += abs(length) * (REVERSE_WEIGHT if length < 0.0 else 1.0)
            total += SWITCH_RADII if last * length < 0.0 else 0.0
            last = length
    return total * radius

"""Search on a lattice of headings, for non-holonomic drives.

Two searches run, one after the other. The first runs on the grid, from the goal, through FREE cells alone. There, a
robot drives from cell to cell along its heading, and turns on the spot to the next heading. It gives the cost to the
goal from every cell and heading. The second runs from the start and is guided by these costs. It keeps one
configuration for each cell and heading (hybrid A*), so positions are not rounded, and the map proves each motion. Then
:func:`shorten_path` shortens the path.

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
from cspace.compiling import allocating, clock, kernel
from cspace.map.edges import edge_is_free
from cspace.map.paths import MAX_SHORTENING_SECONDS
from cspace.map.points import position_in_plane
from cspace.map.record import Map
from cspace.map.search import Costs, check_deadline
from cspace.rotations.base import METRES_PER_RADIAN, TWO_PI, wrapped
from cspace.rotations.yaw import shorter_angle
from planners.car_curves import MAX_GAP, POINT_ERROR, Pose, pose_is_free, prove_length, shortest_word, word_is_free
from planners.local_planner import CURVES, EdgesOnMap, Endpoints

MAX_STEP_CELLS: Final = 2
"""Largest number of cells along x and y of one straight drive; 2 gives 16 headings."""

MAX_OWN_STEP_CELLS: Final = 4
"""Largest number of cells along x and y of one straight drive at about the yaw of start or goal."""

CAR_HEADINGS: Final = (24, 48, 96)
"""Numbers of headings of the lattices for a car, coarse to fine; an arc leads from one heading to the next."""

MAX_NODES: Final = (100_000, 200_000, 800_000)
"""Number of nodes after which the search on each lattice ends; a car then tries the next finer lattice."""

CAR_GREED: Final = 1.5
"""Weight of the remaining cost for cars; above 1, paths are found sooner but may be longer."""

REVERSE_WEIGHT: Final = 1.5
"""Cost of a metre that a car drives in reverse, in metres driven ahead."""

SWITCH_RADII: Final = 0.5
"""Cost of a car's change between driving ahead and in reverse, in turning radii."""

UNREACHED_CELLS: Final = 400.0
"""Cells added to the cost of the start, as the estimated cost of states that the first search did not reach."""

MARGIN_CELLS: Final = (4.0, 60.0)
"""Cells of cost by which the first search goes on past the start: for robots that turn on the spot, and for cars."""

CURVE_RADII: Final = 6.0
"""Distance from the goal, in turning radii, within which estimates include the length of the curve to the goal."""

QUEUE_BUCKETS: Final = 2**16
"""Buckets of each queue; costs beyond them share the last one."""

BUCKETS_PER_CELL: Final = 8
"""Buckets of a queue per cell of cost; the order within a bucket is ignored."""

NODES_PER_CLOCK_CHECK: Final = 2**12
"""Nodes expanded between two checks of the time limit."""

NODES_PER_GOAL_EDGE: Final = 16
"""Far from the goal, the search tests an edge to the goal from every 16th node only."""

INITIAL_LATTICE_NODES: Final = 2**15
"""Initial capacity of the node arrays; it doubles as needed."""

PAD: Final = 4
"""Cells around the map that are not FREE; they keep each motion inside the arrays of the first search."""

COST_TOLERANCE: Final = 0.01
"""Fraction of a cell's side by which a path into a cell must be cheaper to replace the known path."""

KNOWN_TOLERANCE: Final = 1e-3
"""Cells by which the cost of a state must be lower to replace the known cost."""

KEY_BITS: Final = 24
"""Bits of a hash key that hold the index of a cell along y."""

HASH_FACTOR: Final = 0x9E3779B97F4A7C1
"""Odd factor that spreads keys over the hash table (D. Knuth, "Sorting and Searching", 6.4)."""

TIE_RADIANS: Final = 1e-9
"""Difference of rotations, radians, below which driving ahead and in reverse count as equally good."""

COST_PER_EDGE: Final = 1e-6
"""Cost of an edge when a path is shortened, metres; it makes collinear drives one edge."""

SHORTENING_ROUNDS: Final = 2
"""Number of rounds in which a path is shortened."""

MAX_SHORTCUTS: Final = 60
"""Largest number of earlier waypoints tested for an edge to a waypoint."""

POINTS_PER_PATH: Final = 100
"""Number of points added along the straight drives of a path before it is shortened."""


ENTRIES_USED, ENTRIES_WAITING, UNUSED_ENTRY, LOWEST_ENTRY_BUCKET = range(4)
"""Indices into ``counts`` of :func:`spread_costs`."""

TURN_LEFT, TURN_RIGHT, DRIVE_AHEAD, DRIVE_BACK = range(4)
"""Motions of a robot that turns on the spot. A robot that does not reverse has the first three."""

NODE_COUNT, NODES_WAITING, NODES_EXPANDED, LOWEST_BUCKET, LAST_NODE = range(5)
"""Indices into :attr:`Nodes.counts`: numbers of nodes, lowest bucket that is not empty, last node before the goal."""


class Cells(NamedTuple):
    """Lattice of grid cells and h headings.

    States are numbered ``place * h + heading``. Places are the grid cells, row by row, with :data:`PAD` cells around
    them. Costs are in cells.
    """

    free: Words  # of each place, bit k is set if it is FREE at heading k
    turns: Words  # of each place, bit k is set if the robot may turn from heading k to k + 1
    width: int  # places in a row
    steps: Ints  # of each heading, the change of place by a drive
    touched: Ints  # of each heading, the places that a drive touches between its ends, relative to its start
    lengths: Floats  # of each heading, the cost of a drive
    angles: Floats  # of each heading, the cost of the turn to the next one
    reverse_weight: float  # cost of a drive in reverse over that ahead; infinite if the robot does not reverse
    start: int  # state at which the search ends
    angles_to_start: Floats  # of each heading, the least cost of turning to the start's heading
    margin: float  # cost by which the search goes on past the start


class Lattice(NamedTuple):
    """Motions of a robot, and costs to its goal.

    Each of h headings has m motions. Costs are in metres.
    """

    reverses: bool
    headings: Floats  # yaws, radians
    radius: float  # turning radius, 0 for robots that turn on the spot
    side: float  # of the cells; a cell holds one configuration for each heading
    next_heading: Ints  # (h, m), the heading after each motion
    offsets: Floats  # (h, m, 2), the displacement along each motion
    costs: Floats  # (h, m)
    steering: Ints  # (m, 5), motions of a car, as words of one segment
    lengths: Floats  # (m, 5)
    goal: Pose
    nearest: Ints  # of each heading, the nearest heading of the table
    columns: int  # headings of the table
    unreached: float  # added to the straight distance to the goal if the table is 0
    table: Costs  # of each state of Cells, the cost to the goal plus 1, in cells, of either sign; 0 if not reached


Car = tuple[int, float] | None
"""Kind of a car's curves, see :mod:`planners.car_curves`, and turning radius; None for robots that turn on the spot.

Numba leaves out the branches for cars if it is None, and with them most of the time of compiling.
"""


class Nodes(NamedTuple):
    """Configurations reached, and their queue; -1 stands for none."""

    poses: Floats  # (n, 3)
    keys: Ints  # (n, 2), hash key of the cell and heading, and heading
    costs: Floats  # of the path to each node; infinite once a cheaper path into the same cell replaced it
    links: Ints  # (n, 3), previous node, motion that led here, next node in the same bucket
    table: Ints  # hash table of nodes by cell and heading
    buckets: Ints  # first node of each bucket of the queue
    counts: Ints  # see NODE_COUNT and so on
    best: Floats  # (1,), cost of the path to the goal


def find_lattice_path(edges: EdgesOnMap, endpoints: Endpoints, simplify: bool, seconds: float) -> tuple[Floats, str]:
    """Find a path on a lattice, and shorten it.

    The map is in memory. Returns configurations (x, y, yaw), shape (n, 3), and a note. If the search finds no path, n
    is 0. The note names a lattice that has no path, or what ended the search before its time.
    """
    start, goal = cast(tuple[Pose, Pose], endpoints)
    if edges.edge_checker()(*start, *goal):
        return np.array(endpoints), ""
    path, note, is_car, until = np.empty((0, 3)), "", edges.turning_radius is not None, clock() + seconds
    yaws, steps, is_endpoint_yaw = _list_headings(endpoints)
    try:
        table, found = _spread_costs(edges, endpoints, yaws, steps, until)
        # On the spot, the table reaches all states that may lie on the path; cars may pass between them.
        unreached = math.inf if found > 0.0 and not is_car else (found + UNREACHED_CELLS) * edges.space.grid.spacing
        note = "" if found > 0.0 or is_car else f"the lattice of {len(yaws)} headings has no path"
        for level in range(len(CAR_HEADINGS) if is_car else 1):
            motions = (
                _car_motions(edges, start, level) if is_car else _spot_motions(edges, yaws, steps, is_endpoint_yaw)
            )
            nearest = np.abs(wrapped(yaws - motions[0][:, None])).argmin(axis=1)
            lattice = Lattice(_reverses(edges), *motions, goal, nearest, len(yaws), unreached, table)
            nodes = _search(edges, lattice, start, MAX_NODES[level], until)
            if nodes.counts[LAST_NODE] >= 0:
                traced = _trace(lattice, nodes, is_car)
                if not edges.are_free(traced):
                    return path, note or "rounding keeps the path of the lattice from being proven"
                return shorten_path(edges, traced, until + MAX_SHORTENING_SECONDS) if simplify else traced, ""
        is_full = nodes.counts[NODE_COUNT] >= MAX_NODES[level]
        end = f"ended at its limit of {MAX_NODES[level]:,} nodes" if is_full else "reached no more nodes"
        note = note or f"the lattice search {end}"
    except TimeoutError:
        pass
    return path, note


def _list_headings(endpoints: Endpoints) -> tuple[Floats, Ints, Bools]:
    """List a lattice's headings, with the yaws of start and goal.

    Returns the yaws, ascending; the drive along each, in cells along x and y, shape (h, 2); and whether only start or
    goal has it. A drive at the yaw of start or goal is only near that yaw.
    """
    steps = _list_steps(MAX_STEP_CELLS)
    yaws, extra_yaws = _yaws(steps), np.unique([q[2] for q in endpoints])
    extra_yaws = extra_yaws[np.abs(wrapped(yaws - extra_yaws[:, None])).min(axis=1) > 1e-9]
    finer = _list_steps(MAX_OWN_STEP_CELLS)
    steps = np.concatenate([steps, finer[np.abs(wrapped(_yaws(finer) - extra_yaws[:, None])).argmin(axis=1)]])
    yaws = np.concatenate([yaws, extra_yaws])
    order = np.argsort(yaws)
    return yaws[order], steps[order], order >= len(yaws) - len(extra_yaws)


def _list_steps(max_cells: int) -> Ints:
    """List a drive for each direction, shape (n, 2).

    Drives are coprime numbers of cells along x and y, at most `max_cells`.
    """
    steps = itertools.product(range(-max_cells, max_cells + 1), repeat=2)
    return np.array([step for step in steps if math.gcd(*step) == 1])


def _yaws(steps: Ints) -> Floats:
    """Return the yaws, radians, of drives, shape (n, 2)."""
    return wrapped(np.arctan2(steps[:, 1], steps[:, 0]))


def _spread_costs(
    edges: EdgesOnMap, endpoints: Endpoints, yaws: Floats, steps: Ints, until: float
) -> tuple[Costs, float]:
    """Compute the cost to the goal from all states.

    A state is a cell and a heading. ``yaws`` has shape (h,), ``steps`` shape (h, 2); see :func:`_list_headings`.
    Returns the table of :class:`Lattice`, and the table's entry of the start, 0 if the goal cannot be reached. Raises
    TimeoutError after ``until``.
    """
    grid, strides = edges.space.grid, np.array([edges.space.grid.shape[1] + 2 * PAD, 1])
    free, turns = _mark_free_places(edges, yaws, until)
    is_car, weight = edges.turning_radius is not None, (edges.turning_radius or METRES_PER_RADIAN) / grid.spacing
    reverse_weight = math.inf if not _reverses(edges) else REVERSE_WEIGHT if is_car else 1.0
    # Lists of touched cells differ in length; a drive's own start fills the shorter ones.
    lists = [_touched_cells(*step) for step in steps.tolist()]
    touched = np.array([[*cells, *[(0, 0)] * (max(map(len, lists)) - len(cells))] for cells in lists])
    start, goal = (
        int((grid.cell_of(q[:2]) + PAD) @ strides) * len(yaws) + int(np.abs(wrapped(yaws - q[2])).argmin())
        for q in endpoints
    )
    lattice = Cells(
        free.reshape(-1),
        turns.reshape(-1),
        free.shape[1],
        steps @ strides,
        touched @ strides,
        np.hypot(*steps.T),
        weight * np.diff(yaws, append=yaws[0] + TWO_PI),
        reverse_weight,
        start,
        weight * np.abs(wrapped(yaws - endpoints[0][2])),
        MARGIN_CELLS[is_car],
    )
    # The search begins with one entry: the goal, in the first bucket.
    table, entries = np.zeros(free.size * len(yaws), np.float32), np.empty((INITIAL_LATTICE_NODES, 2), np.int64)
    buckets, counts = np.full(QUEUE_BUCKETS, -1), np.array([1, 1, -1, 0])
    table[goal], entries[0], buckets[0] = 1.0, (goal, -1), 0
    while not spread_costs(lattice, table, entries, buckets, counts):
        check_deadline(until)
        if counts[ENTRIES_USED] + 4 * NODES_PER_CLOCK_CHECK > len(entries):
            entries = np.concatenate([entries, np.empty_like(entries)])
    return table, float(abs(table[start]))


def _mark_free_places(edges: EdgesOnMap, yaws: Floats, until: float) -> tuple[Words, Words]:
    """Mark free places and turns, a bit for each heading.

    The first array marks places at which the robot may stay, the second marks turns to the next heading. Cars may turn
    at cells that are FREE at both headings, because they turn as they drive. Other robots turn on the spot, so all
    rotation cells between the headings must be FREE. Both arrays have shape (nx + 2 PAD, ny + 2 PAD).
    """
    space, is_car = edges.space, edges.turning_radius is not None
    free, turns = np.zeros((2, *(n + 2 * PAD for n in space.grid.shape)), dtype=np.uint64)
    rotation_cells, cell_count = space.rotations.cell_of(yaws), len(space.rotations)
    for k in range(len(yaws)):
        check_deadline(until)
        first, last = int(rotation_cells[k]), int(rotation_cells[(k + 1) % len(yaws)])
        passed = [last] if is_car else [(first + i) % cell_count for i in range(1, (last - first) % cell_count + 1)]
        worst = space.states_at(space.rotations.centers[first])
        for bits, others in ((free, []), (turns, passed)):
            for cell in others:
                worst = np.maximum(worst, space.states_at(space.rotations.centers[cell]))
            bits[PAD:-PAD, PAD:-PAD] |= (worst == FREE).astype(np.uint64) << np.uint64(k)
    return free, turns


def _touched_cells(dx: int, dy: int) -> list[tuple[int, int]]:
    """List the cells that a drive touches between its ends.

    The drive leads from the center of cell (0, 0) to the center of cell (dx, dy). Cells are closed: a segment through a
    corner touches all four cells.
    """
    xs, ys = range(min(dx, 0), max(dx, 0) + 1), range(min(dy, 0), max(dy, 0) + 1)
    box = [cell for cell in itertools.product(xs, ys) if cell not in ((0, 0), (dx, dy))]
    return [(i, j) for i, j in box if 2 * abs(dx * j - dy * i) <= abs(dx) + abs(dy)]


def _reverses(edges: EdgesOnMap) -> bool:
    """Return True if the robot may drive in reverse."""
    return edges.drive in ("differential-reverse", "reeds-shepp")


Motions = tuple[Floats, float, float, Ints, Floats, Floats, Ints, Floats]
"""Fields ``headings`` to ``lengths`` of :class:`Lattice`."""


def _spot_motions(edges: EdgesOnMap, yaws: Floats, steps: Ints, is_endpoint_yaw: Bools) -> Motions:
    """List the motions of a robot that turns on the spot.

    These are turns to the next headings, and drives ahead and perhaps in reverse. The arguments are the results of
    :func:`_list_headings`.
    """
    spacing, moves = edges.space.grid.spacing, 3 + _reverses(edges)
    # At the yaw of start or goal, a step as long as a cell's diagonal leaves the cell.
    diagonals = math.sqrt(2.0) * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    drives = spacing * np.where(is_endpoint_yaw[:, None], diagonals, steps)
    next_heading = (np.arange(len(yaws))[:, None] + [1, -1, 0, 0]) % len(yaws)
    offsets = np.stack([0.0 * drives, 0.0 * drives, drives, -drives], axis=1)[:, :moves]
    costs = METRES_PER_RADIAN * np.abs(wrapped(yaws[next_heading] - yaws[:, None]))[:, :moves]
    costs += np.linalg.norm(offsets, axis=2)
    contiguous, no_words = np.ascontiguousarray, (np.zeros((moves, 5), dtype=np.int64), np.zeros((moves, 5)))
    return yaws, 0.0, spacing, contiguous(next_heading[:, :moves]), contiguous(offsets), contiguous(costs), *no_words


def _car_motions(edges: EdgesOnMap, start: Pose, level: int) -> Motions:
    """List the motions of a car.

    These are arcs to the next headings, and drives straight on, ahead or in reverse. ``level`` is an index into
    :data:`CAR_HEADINGS`; the first heading is the start's.
    """
    count, radius = CAR_HEADINGS[level], float(edges.turning_radius or math.nan)
    arc, spacing = TWO_PI / count, edges.space.grid.spacing
    yaws = wrapped(np.asarray(start[2] + arc * np.arange(count), dtype=np.float64))
    # The chord of an arc is as long as the diagonal of a cell, and a straight drive longer, so both leave the cell.
    side = max(2.0 * radius * math.sin(0.5 * arc), spacing) / math.sqrt(2.0)
    straight, moves = max(arc * radius, 1.01 * math.sqrt(2.0) * side), 3 + 3 * _reverses(edges)
    steering, signs = np.tile([1, -1, 0], 2)[:moves], np.repeat([1, -1], 3)[:moves]
    metres = signs * np.where(steering, arc * radius, straight)
    next_heading = (np.arange(count)[:, None] + steering * signs) % count
    # Along an arc to the left of radius r, x changes by r (sin b - sin a), y by r (cos a - cos b). A right arc has -r.
    before, after, signed_radius = yaws[:, None], yaws[next_heading], steering * radius
    x = np.where(steering, signed_radius * (np.sin(after) - np.sin(before)), metres * np.cos(before))
    y = np.where(steering, signed_radius * (np.cos(before) - np.cos(after)), metres * np.sin(before))
    costs = np.tile(np.abs(metres) * np.where(signs < 0, REVERSE_WEIGHT, 1.0), (count, 1))
    words = np.zeros((moves, 5), dtype=np.int64), np.zeros((moves, 5))
    words[0][:, 0], words[1][:, 0] = steering, metres / radius
    return yaws, radius, side, next_heading, np.stack([x, y], axis=2), costs, *words


def _search(edges: EdgesOnMap, lattice: Lattice, start: Pose, max_nodes: int, until: float) -> Nodes:
    """Search from the start for a path to the goal.

    The search ends with a path, at `max_nodes` nodes, or if no node is left. Raises TimeoutError after ``until``.
    """
    map_, capacity = edges.space._kernel_map, INITIAL_LATTICE_NODES
    map_ = map_._replace(exterior=np.full_like(map_.exterior, MIXED))  # no motion leaves the grid
    arrays = (
        np.empty((capacity, 3)),
        np.empty((capacity, 2), np.int64),
        np.empty(capacity),
        np.empty((capacity, 3), np.int64),
    )
    counts = np.array([0, 0, 0, 0, -1])
    nodes = Nodes(*arrays, np.full(4 * capacity, -1), np.full(QUEUE_BUCKETS, -1), counts, np.array([math.inf]))
    radius = edges.turning_radius
    car: Car = None if radius is None else (CURVES.index(edges.drive), float(radius))
    first_heading = int(np.abs(wrapped(lattice.headings - start[2])).argmin())
    add_node(map_, lattice, car, nodes, start, first_heading, 0.0, -1, -1)
    while not expand_nodes(map_, lattice, car, nodes) and nodes.counts[NODE_COUNT] < max_nodes:
        check_deadline(until)
        if 2 * nodes.counts[NODE_COUNT] > len(nodes.costs):
            larger = [np.concatenate([each, np.empty_like(each)]) for each in nodes[:4]]
            nodes = Nodes(*larger, np.full(2 * len(nodes.table), -1), *nodes[5:])  # type: ignore[call-arg]  # eight fields
            rehash(nodes)
    return nodes


def _trace(lattice: Lattice, nodes: Nodes, is_car: bool) -> Floats:
    """Return the path, shape (n, 3), merging drives along one heading."""
    node, rows, later_move = int(nodes.counts[LAST_NODE]), [lattice.goal], -1
    while node >= 0:
        parent, move = nodes.links[node, :2].tolist()
        if is_car or move < DRIVE_AHEAD or move != later_move:
            rows.append(tuple(nodes.poses[node].tolist()))
        node, later_move = parent, move
    return np.array([b for a, b in zip([None, *rows], rows, strict=False) if a != b])[::-1]


def shorten_path(edges: EdgesOnMap, path: Floats, until: float) -> Floats:
    """Shorten a path, shape (n, 3), by proven edges.

    The edges join waypoints, and points between waypoints. The result is the cheapest such path; after ``until``, the
    rest of the path stays as it is.
    """
    check, given = edges.edge_checker(), path
    for _ in range(SHORTENING_ROUNDS):
        path = _with_points_between(edges, path)
        # Dynamic programming: each point is joined to the earlier point that gives the cheapest path.
        previous, total = np.arange(-1, len(path) - 1), np.zeros(len(path))
        apart = np.unique(np.geomspace(1, len(path), MAX_SHORTCUTS).astype(np.int64))
        for k in range(1, len(path)):
            if clock() >= until:
                break  # the remaining points keep the points before them
            earlier = k - apart[apart <= k]
            costs = total[earlier] + _edge_costs(edges, path[earlier], path[k]) + COST_PER_EDGE
            for index in np.argsort(costs, kind="stable").tolist():
                # The edge from the waypoint before belongs to the path.
                if index == 0 or (clock() < until and check(*path[earlier[index]].tolist(), *path[k].tolist())):
                    previous[k], total[k] = earlier[index], costs[index]
                    break
        chain = [len(path) - 1]
        while chain[-1] > 0:
            chain.append(int(previous[chain[-1]]))
        path = edges.remove_turns(path[chain[::-1]])
    return path if edges.are_free(path) else given  # rounding may make a part of an edge fail


def _with_points_between(edges: EdgesOnMap, path: Floats) -> Floats:
    """Insert points on the drives of a path.

    About POINTS_PER_PATH points are spread over the path; only drives of constant yaw get them. A car's path is
    returned as it is, because a part of its curve need not be a shortest curve.
    """
    steps = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    rows, gap = [path[:1]], steps.sum() / POINTS_PER_PATH
    for a, b, step in zip(path[:-1], path[1:], steps.tolist(), strict=True):
        count = int(step / gap) if edges.turning_radius is None and a[2] == b[2] else 1
        rows += [a + np.arange(1, count)[:, None] / count * (b - a), b[None]]
    return np.concatenate(rows)


def _edge_costs(edges: EdgesOnMap, starts: Floats, end: Floats) -> Floats:
    """Return the costs, shape (n,), of edges from `starts` to `end`."""
    if edges.turning_radius is None:
        return edges.edge_lengths(starts, np.tile(end, (len(starts), 1)))
    costs = np.empty(len(starts))
    curve_costs(CURVES.index(edges.drive), edges.turning_radius, starts, end, costs)
    return costs


@kernel
def spread_costs(cells: Cells, table: Costs, entries: Ints, buckets: Ints, counts: Ints) -> bool:
    """Expand states from the goal; return True when done.

    After False, the caller checks the time, adds memory if needed, and calls again. ``table`` is as in
    :class:`Lattice`, and negative for expanded states. ``entries``, shape (n, 2), holds queued states, and the next
    entry in the same bucket. ``buckets`` holds the first entry of each bucket; -1 stands for none. ``counts`` holds the
    numbers of entries used and waiting, the first entry to use again, and the lowest bucket.
    """
    free, turns, touched, width, one = cells.free, cells.turns, cells.touched, cells.width, np.uint64(1)
    headings, start = len(cells.steps), cells.start // len(cells.steps)
    for _ in range(NODES_PER_CLOCK_CHECK):
        while counts[ENTRIES_WAITING] > 0 and buckets[counts[LOWEST_ENTRY_BUCKET]] < 0:
            counts[LOWEST_ENTRY_BUCKET] += 1
        # The search is over when the queue is empty, or is dearer than the start by the margin.
        found = abs(table[cells.start])
        if counts[ENTRIES_WAITING] == 0 or (
            found > 0.0 and counts[LOWEST_ENTRY_BUCKET] > BUCKETS_PER_CELL * (found - 1.0 + cells.margin)
        ):
            return True
        # Take the first entry of the bucket, and list it as unused. A state that was expanded is skipped.
        entry = buckets[counts[LOWEST_ENTRY_BUCKET]]
        state, buckets[counts[LOWEST_ENTRY_BUCKET]] = entries[entry, 0], entries[entry, 1]
        counts[ENTRIES_WAITING] -= 1
        entries[entry, 1], counts[UNUSED_ENTRY] = counts[UNUSED_ENTRY], entry
        if table[state] < 0.0:
            continue
        place, heading, cost = state // headings, state % headings, float(table[state])
        bit = one << np.uint64(heading)
        table[state] = -cost
        for move in range(4 if cells.reverse_weight < math.inf else 3):
            if move < DRIVE_AHEAD:
                turn = (heading + headings - move) % headings
                if not (turns[place] >> np.uint64(turn)) & one:
                    continue
                other = place * headings + (heading + 1 - 2 * move + headings) % headings
                total = cost + cells.angles[turn]
            else:
                # The search runs backwards: the robot drives ahead to this place from `place + step`, or back to it.
                step = cells.steps[heading] if move == DRIVE_BACK else -cells.steps[heading]
                rear = place if move == DRIVE_BACK else place + step
                is_free = free[place] & free[place + step]
                for n in range(touched.shape[1]):
                    is_free &= free[rear + touched[heading, n]]
                if not is_free & bit:
                    continue
                other, total = (place + step) * headings + heading, cost + cells.lengths[heading]
                if move == DRIVE_BACK:
                    total += (cells.reverse_weight - 1.0) * cells.lengths[heading]
            known = abs(table[other])
            if known > 0.0 and known <= total + KNOWN_TOLERANCE:
                continue
            # The bucket goes by the cost plus a lower bound of the rest: straight to the start, turning on the way.
            table[other] = total
            dx, dy = (other // headings) // width - start // width, (other // headings) % width - start % width
            bound = total - 1.0 + math.hypot(dx, dy) + cells.angles_to_start[other % headings]
            bucket = max(min(int(BUCKETS_PER_CELL * bound), QUEUE_BUCKETS - 1), counts[LOWEST_ENTRY_BUCKET])
            if counts[UNUSED_ENTRY] >= 0:
                entry, counts[UNUSED_ENTRY] = counts[UNUSED_ENTRY], entries[counts[UNUSED_ENTRY], 1]
            else:
                entry = counts[ENTRIES_USED]
                counts[ENTRIES_USED] += 1
            entries[entry, 0], entries[entry, 1], buckets[bucket] = other, buckets[bucket], entry
            counts[ENTRIES_WAITING] += 1
    return False


@allocating
def expand_nodes(map_: Map, lattice: Lattice, car: Car, nodes: Nodes) -> bool:
    """Expand nodes from the start; return True when done.

    After False, the caller checks the time, adds memory if needed, and calls again.
    """
    counts, links, goal, is_car = nodes.counts, nodes.links, lattice.goal, lattice.radius > 0.0
    for _ in range(NODES_PER_CLOCK_CHECK):
        while counts[NODES_WAITING] > 0 and nodes.buckets[counts[LOWEST_BUCKET]] < 0:
            counts[LOWEST_BUCKET] += 1
        # No node that waits can beat the best path to the goal any more.
        if counts[NODES_WAITING] == 0 or counts[LOWEST_BUCKET] >= BUCKETS_PER_CELL * nodes.best[0] / map_.spacing:
            return True
        if 2 * counts[NODE_COUNT] > len(nodes.costs):
            return False
        node = nodes.buckets[counts[LOWEST_BUCKET]]
        nodes.buckets[counts[LOWEST_BUCKET]] = links[node, 2]
        counts[NODES_WAITING] -= 1
        cost, heading = nodes.costs[node], nodes.keys[node, 1]
        if cost == math.inf:  # a cheaper path has entered its cell since
            continue
        counts[NODES_EXPANDED] += 1
        # Near the goal, and from some nodes far from it, one edge may lead to the goal itself.
        x, y, yaw = nodes.poses[node]
        to_goal = math.hypot(x - goal[0], y - goal[1])
        if counts[NODES_EXPANDED] % NODES_PER_GOAL_EDGE == 0 or to_goal < max(4.0 * lattice.radius, 8.0 * map_.spacing):
            total = cost + _cost_to_goal(map_, lattice, car, (x, y, yaw))
            if total < nodes.best[0]:
                nodes.best[0], counts[LAST_NODE] = total, node
                if is_car:  # its remaining costs are no lower bounds anyway
                    return True
        for move in range(lattice.next_heading.shape[1]):
            after, step = lattice.next_heading[heading, move], lattice.costs[heading, move]
            next_x, next_y = x + lattice.offsets[heading, move, 0], y + lattice.offsets[heading, move, 1]
            if abs(next_x - goal[0]) + abs(next_y - goal[1]) < 1e-6 * lattice.side:
                next_x, next_y = goal[0], goal[1]  # else rounding would give the last edge a heading
            if is_car and links[node, 1] >= 0 and lattice.lengths[links[node, 1], 0] * lattice.lengths[move, 0] < 0.0:
                step += SWITCH_RADII * lattice.radius
            if map_.lower[1] <= next_x <= map_.upper[1] and map_.lower[2] <= next_y <= map_.upper[2]:
                q = (next_x, next_y, lattice.headings[after])
                add_node(map_, lattice, car, nodes, q, after, cost + step, node, move)
    return False


@allocating
def add_node(
    map_: Map,
    lattice: Lattice,
    car: Car,
    nodes: Nodes,
    q: Pose,
    heading: int,
    cost: float,
    parent: int,
    move: int,
) -> None:
    """Add a configuration if its motion is proven free.

    The motion is ``move`` from node ``parent`` (-1 for the start). The configuration is left out if its cell and
    heading have a cheaper node, or if its path, which costs ``cost``, cannot beat the best.
    """
    i, j = math.floor((q[0] - map_.lower[1]) / lattice.side), math.floor((q[1] - map_.lower[2]) / lattice.side)
    key = ((i << KEY_BITS) + j) * len(lattice.headings) + heading
    slot, spare = _slot(nodes, key), MAX_GAP * (1.0 + TWO_PI) + POINT_ERROR
    known = nodes.table[slot]
    if known >= 0 and nodes.costs[known] <= cost + COST_TOLERANCE * lattice.side:
        return
    greed = CAR_GREED if lattice.radius > 0.0 else 1.0
    bound = cost + greed * _remaining(map_, lattice, car, q, heading)
    if not bound < nodes.best[0]:  # or infinite
        return
    # The proof comes last, because it takes the most time.
    if parent >= 0:
        p = (nodes.poses[parent, 0], nodes.poses[parent, 1], nodes.poses[parent, 2])
        if car is None:
            if not _is_free(map_, p, q):
                return
        elif not pose_is_free(map_, q, spare * lattice.radius, spare) or not word_is_free(
            map_, lattice.radius, p, lattice.steering[move], lattice.lengths[move], spare
        ):
            return
    # The node replaces the known node of its cell and heading, and is put first into its bucket.
    if known >= 0:
        nodes.costs[known] = math.inf
    node, bucket = nodes.counts[NODE_COUNT], min(int(BUCKETS_PER_CELL * bound / map_.spacing), QUEUE_BUCKETS - 1)
    nodes.poses[node, 0], nodes.poses[node, 1], nodes.poses[node, 2] = q
    nodes.keys[node, 0], nodes.keys[node, 1] = key, heading
    nodes.costs[node] = cost
    nodes.table[slot] = node
    nodes.links[node, 0], nodes.links[node, 1], nodes.links[node, 2] = parent, move, nodes.buckets[bucket]
    nodes.buckets[bucket] = node
    nodes.counts[NODE_COUNT] += 1
    nodes.counts[NODES_WAITING] += 1
    nodes.counts[LOWEST_BUCKET] = min(bucket, nodes.counts[LOWEST_BUCKET])


@kernel
def _slot(nodes: Nodes, key: int) -> int:
    """Return the hash table's slot for a key, perhaps empty."""
    slot = (key * HASH_FACTOR >> 20) & (len(nodes.table) - 1)
    while nodes.table[slot] >= 0 and nodes.keys[nodes.table[slot], 0] != key:
        slot = (slot + 1) & (len(nodes.table) - 1)
    return slot


@kernel
def rehash(nodes: Nodes) -> None:
    """Enter all nodes into the empty hash table.

    The last node of a cell and heading stays, because it is the cheapest.
    """
    for node in range(nodes.counts[NODE_COUNT]):
        nodes.table[_slot(nodes, nodes.keys[node, 0])] = node


@allocating
def _remaining(map_: Map, lattice: Lattice, car: Car, q: Pose, heading: int) -> float:
    """Estimate the cost to the goal, metres.

    The estimate is the largest of the straight distance, the table's cost and, near the goal, a car's curve.
    """
    rows, columns = map_.states.shape[2], map_.states.shape[3]
    i = min(math.floor((q[0] - map_.lower[1]) / map_.spacing), rows - 1) + PAD
    j = min(math.floor((q[1] - map_.lower[2]) / map_.spacing), columns - 1) + PAD
    cells = abs(lattice.table[(i * (columns + 2 * PAD) + j) * lattice.columns + lattice.nearest[heading]]) - 1.0
    to_goal = math.hypot(q[0] - lattice.goal[0], q[1] - lattice.goal[1])
    metres = max(to_goal, cells * map_.spacing if cells >= 0.0 else to_goal + lattice.unreached)
    if car is not None:
        kind, radius = car
        if metres < CURVE_RADII * radius:
            metres = max(metres, _curve_cost(kind, radius, q, lattice.goal))
    return metres


@allocating
def _cost_to_goal(map_: Map, lattice: Lattice, car: Car, q: Pose) -> float:
    """Return an edge's cost to the goal; infinite if unproven."""
    (x, y, yaw), goal = q, lattice.goal
    if car is not None:
        kind, radius = car
        is_proven = prove_length(map_, kind, radius, x, y, yaw, goal[0], goal[1], goal[2]) >= 0.0
        return _curve_cost(kind, radius, q, goal) if is_proven else math.inf
    # The robot turns towards the goal, ahead or in reverse, drives straight, and turns to the yaw of the goal.
    metres, heading, radians = math.hypot(goal[0] - x, goal[1] - y), yaw, abs(shorter_angle(yaw, goal[2]))
    if metres > 0.0:
        forward = math.atan2(goal[1] - y, goal[0] - x)
        heading, radians = forward, abs(shorter_angle(yaw, forward)) + abs(shorter_angle(forward, goal[2]))
        backward = forward - math.copysign(math.pi, forward)
        reverse = abs(shorter_angle(yaw, backward)) + abs(shorter_angle(backward, goal[2]))
        if lattice.reverses and abs(reverse - radians) < TIE_RADIANS:
            return math.inf  # rounding decides which way the robot drives
        if lattice.reverses and reverse < radians:
            heading, radians = backward, reverse
    drive_start, drive_end = (x, y, heading), (goal[0], goal[1], heading)
    proven = _is_free(map_, q, drive_start) and _is_free(map_, drive_end, goal)
    return metres + METRES_PER_RADIAN * radians if proven and _is_free(map_, drive_start, drive_end) else math.inf


@kernel
def _is_free(map_: Map, q0: Pose, q1: Pose) -> bool:
    """Return True if a straight edge is proven free.

    This wrapper is compiled once, because edge_is_free is long.
    """
    p0, p1 = position_in_plane(map_, q0[0], q0[1]), position_in_plane(map_, q1[0], q1[1])
    return edge_is_free(map_, p0, (q0[2],), p1, (q1[2],))


@allocating
def curve_costs(kind: int, radius: float, starts: Floats, end: Floats, out: Floats) -> None:
    """Write the costs, metres, of curves from `starts` to `end`."""
    for k in range(len(starts)):
        out[k] = _curve_cost(kind, radius, (starts[k, 0], starts[k, 1], starts[k, 2]), (end[0], end[1], end[2]))


@allocating
def _curve_cost(kind: int, radius: float, q0: Pose, q1: Pose) -> float:
    """Return the cost of a car's shortest curve, metres."""
    _, lengths, _ = shortest_word(kind, radius, q0, q1)
    total, previous = 0.0, 0.0
    for length in lengths:
        if abs(length) > MAX_GAP:
            total += abs(length) * (REVERSE_WEIGHT if length < 0.0 else 1.0)
            total += SWITCH_RADII if previous * length < 0.0 else 0.0
            previous = length
    return total * radius

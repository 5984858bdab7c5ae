"""Search on a lattice of headings, for non-holonomic drives.

Two searches run, one after the other. The first runs on the grid, from the goal, through FREE cells
alone, or through all that are not BLOCKED if geometry decides. There, a robot drives from cell to
cell along its heading, and turns on the spot to the next heading. It gives the cost to the goal
from every cell and heading. The second runs from the start and is guided by these costs. It keeps
one configuration for each cell and heading (hybrid A*), so positions are not rounded, and map or
geometry prove each motion. From nodes near the goal, and from some others, one edge may lead to the
goal itself. For a car that reverses, start and goal change roles if there is less room at the goal.
Then :func:`shorten_path` shortens the path.

References
----------
M. Pivtoraiko and A. Kelly, "Efficient constrained path planning via search in state
lattices", 2005; D. Dolgov, S. Thrun, M. Montemerlo and J. Diebel, "Practical search techniques in
path planning for autonomous driving", 2008.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cspace.interface import Endpoint
from cspace.queries.edges import edge_is_free
from cspace.queries.paths import MAX_SHORTENING_SECONDS, pulled_straight
from cspace.queries.points import position_in_plane
from cspace.queries.search import Estimate, Progress, check_deadline, pop_first, push, reach_cell
from cspace.record.cells import Map
from cspace.rotations.base import METRES_PER_RADIAN, TWO_PI, wrapped
from cspace.support.arrays import BLOCKED, FREE, Bools, Floats, Ints
from cspace.support.compiling import clock, kernel
from planners.car_curves import (
    MAX_GAP,
    POINT_ERROR,
    Geometry,
    Pose,
    advance,
    piece_is_free,
    segment_is_free,
)
from planners.local_planner import Endpoints, LocalPlanner

MAX_STEP_CELLS: Final = 2
"""Largest number of cells along x and y of one straight drive; 2 gives 16 headings."""

CAR_HEADINGS: Final = (24, 48, 96)
"""Numbers of headings of the lattices for a car, coarse to fine; an arc leads from one heading to
the next."""

REVERSING_HEADINGS: Final = (*CAR_HEADINGS, 192, 384)
"""Numbers of headings for a car that reverses; the finest lattices move to and fro in slots."""

MAX_NODES: Final = (100_000, 200_000, 800_000, 800_000, 800_000)
"""Number of nodes after which the search on each lattice ends; a car then tries the next finer
lattice."""

CAR_GREED: Final = 1.5
"""Weight of the remaining cost for cars; above 1, paths are found sooner but may be longer."""

UNREACHED_CELLS: Final = 400.0
"""Cells added to the cost of the start, as the estimated cost of states that the first search did
not reach."""

MARGIN_CELLS: Final = (0.0, 40.0)
"""Cells of cost by which the first search goes on past the start: for robots that turn on the spot,
and for cars."""

INITIAL_QUEUE_LENGTH: Final = 2**14
"""Entries that the queue of the first search can hold at first; the length doubles as needed."""

MAX_SPREAD: Final = 4
"""Largest number of states reached from one state in the first search."""

REVERSE_WEIGHT: Final = 1.5
"""Cost of a metre that a car drives in reverse, in metres driven ahead."""

SWITCH_RADII: Final = 0.5
"""Cost of a car's change between driving ahead and in reverse, in turning radii."""

MIN_STRAIGHT_RADII: Final = 0.07
"""Shortest straight drive of a car, in turning radii.

On shorter drives, curves that turn to and fro are as short up to
:data:`planners.car_curves.TIE_TOLERANCE`, and the proof of an edge needs these, too.
"""

ROOM_RADII: Final = 0.25
"""Distance along each axis within which the room of start and goal counts, in turning radii."""

ROOM_RADIANS: Final = 0.5
"""Rotation to either side at which the room of start and goal counts, too."""

NEAR_CELLS: Final = 8.0
"""Distance from the goal, in cells, within which each node tries an edge to the goal."""

NEAR_RADII: Final = 4.0
"""The same in turning radii, for cars."""

NODES_PER_GOAL_EDGE: Final = 16
"""Far from the goal, every 16th node tries an edge to the goal."""

NODES_PER_CLOCK_CHECK: Final = 2**12
"""Nodes expanded between two checks of the time limit."""

KNOWN_TOLERANCE: Final = 0.01
"""Fraction of a cell's side by which a path into a cell must be cheaper to replace the known path.
"""

HASH_FACTOR: Final = 0x9E3779B97F4A7C1
"""Odd factor that spreads keys over the hash table (D. Knuth, "Sorting and Searching", 6.4)."""

HASH_SHIFT: Final = 20
"""Lowest bits of a key's product that are left out, because they are spread the least."""

KEY_BITS: Final = 24
"""Bits of a hash key that hold the index of a cell along y."""

ARC_ERROR: Final = MAX_GAP * (1.0 + TWO_PI) + POINT_ERROR
"""Distance, in turning radii, within which a driven motion stays near the computed one."""

COST_PER_EDGE: Final = 1e-6
"""Cost of an edge when a path is shortened, metres; it makes collinear drives one edge."""

MAX_SHORTCUTS: Final = 60
"""Largest number of earlier waypoints tested for an edge to a waypoint."""

NO_NODE = -1
TIME_CHECK = -2
"""Results of :func:`expand_nodes` other than a node."""


class Drives(NamedTuple):
    """The h headings of a lattice, by ascending yaw, and the drive along each."""

    yaws: Floats  # (h,)
    steps: Ints  # (h, 2), cells along x and y
    is_own: Bools  # (h,), whether only start or goal has the yaw, and the drive is about as long


class Motions(NamedTuple):
    """The m motions of a robot at each of h headings. Costs are in metres."""

    headings: Floats  # (h,), yaws, radians
    nearest: Ints  # (h,), the nearest heading of the guide
    next_heading: Ints  # (h, m), the heading after each motion
    steering: Ints  # (m,), 1 to the left, -1 to the right, 0 straight on or on the spot
    lengths: Floats  # (h, m), negative in reverse, zero on the spot
    unit: float  # of the lengths, metres: the turning radius of a car, otherwise 1
    costs: Floats  # (h, m)
    side: float  # of the cells that hold one configuration for each heading
    switch_cost: float  # of a change between driving ahead and in reverse
    greed: float  # weight of the remaining cost; above 1, paths are found sooner but may be longer
    near: float  # distance from the goal within which each node tries an edge to the goal
    geometry: Geometry  # proves motions of a car that cells do not prove


class Ground(NamedTuple):
    """Grid cells and h headings, for the first search. Costs are in cells.

    There are :data:`MAX_STEP_CELLS` more cells on each side, which are not FREE.
    """

    can_drive: Bools  # (h, nx, ny), whether the robot may drive ahead from a cell
    can_turn: Bools  # (h, nx, ny), whether it may turn from a heading to the next
    steps: Ints  # (h, 2), the cells along x and y of a drive
    drive_costs: Floats  # (h,)
    turn_costs: Floats  # (h,), of the turn to the next heading
    reverse_cost: (
        float  # factor of the cost of a drive in reverse; infinite if the robot does not reverse
    )


class Guide(NamedTuple):
    """Costs to the goal, from cells and headings, which the first search finds."""

    goal: Pose
    headings: Floats  # (h,), yaws
    costs: NDArray[np.float32]  # (h, nx, ny), in cells, with the cells of Ground
    reached: Ints  # (h, nx, ny), 0 for states that were not reached
    unreached: float  # metres added to the straight distance of states not reached


class Nodes(NamedTuple):
    """Configurations reached, and their queue.

    ``progress`` holds the cost of each node, the node before it, and whether it is closed. It is
    closed when it was expanded, or when a cheaper path into its cell and heading replaced it.
    """

    progress: Progress
    poses: Floats  # (n, 3)
    motions: Ints  # (n, 2), the motion that led to each node, and its heading
    keys: Ints  # (n,), hash key of its cell and heading
    table: Ints  # hash table of nodes by key; -1 stands for none
    counts: Ints  # (2,), numbers of nodes and of expanded nodes


def find_lattice_path(
    edges: LocalPlanner, endpoints: Endpoints, simplify: bool, seconds: float
) -> tuple[Floats, str]:
    """Find a path on a lattice, and shorten it.

    The map is in memory. Returns configurations (x, y, yaw), shape (n, 3), and a note. If the
    search finds no path, n is 0. The note names a lattice that has no path, or what ended the
    search before its time.
    """
    if edges.edge_checker()(*endpoints[0], *endpoints[1]):
        return np.array(endpoints), ""
    is_backwards = _starts_at_goal(edges, endpoints)
    if is_backwards:
        endpoints = endpoints[::-1]
    path = np.empty((0, 3))
    note = ""
    until = clock() + seconds
    is_car = edges.turning_radius is not None
    try:
        guide, reaches_start = _measure_guide(edges, endpoints, is_backwards, until)
        if not is_car and not reaches_start:
            note = f"the lattice of {len(guide.headings)} headings has no path"
        levels = _list_levels(edges, endpoints, guide, is_backwards)
        for motions, max_nodes in zip(levels, MAX_NODES, strict=False):
            path, reason = _search(edges, motions, guide, endpoints, max_nodes, until)
            if is_backwards:
                path = path[::-1]
            if len(path) and not edges.are_free(path):
                path = np.empty((0, 3))
                reason = "rounding keeps the path of the lattice from being proven"
            if len(path):
                break
    except TimeoutError:
        return path, note
    if not len(path):
        return path, note or reason
    if simplify:
        path = shorten_path(edges, path, until + MAX_SHORTENING_SECONDS)
    return path, ""


def _starts_at_goal(edges: LocalPlanner, endpoints: Endpoints) -> bool:
    """Return True if the search should start at the goal, and its path be driven backwards.

    A search out of a tight place is shorter than one into it, because few motions are free there. A
    car that reverses can drive its paths both ways.
    """
    if edges.turning_radius is None or not _can_reverse(edges):
        return False
    room_at_start, room_at_goal = (_measure_room(edges, q) for q in endpoints)
    return room_at_goal < room_at_start


def _measure_room(edges: LocalPlanner, q: Endpoint) -> int:
    """Count the cells near a configuration that the robot may pass at yaws near its own."""
    grid = edges.cells.grid
    reach = math.ceil(ROOM_RADII * float(edges.turning_radius or 0.0) / grid.spacing)
    center = grid.cell_of(q[:2]) + MAX_STEP_CELLS
    low = np.maximum(center - reach, 0)
    high = center + reach + 1
    window = np.s_[low[0] : high[0], low[1] : high[1]]
    yaws = (q[2] - ROOM_RADIANS, q[2], q[2] + ROOM_RADIANS)
    return sum(int(_find_free_cells(edges, yaw)[window].sum()) for yaw in yaws)


def _list_drives(endpoints: Endpoints) -> Drives:
    """List the headings of a lattice, and the drive along each.

    These are the directions from a cell to others near it, and the yaws of start and goal, at which
    a drive is about as long as the one at the nearest direction.
    """
    reach = range(-MAX_STEP_CELLS, MAX_STEP_CELLS + 1)
    steps = np.array([step for step in itertools.product(reach, repeat=2) if math.gcd(*step) == 1])
    yaws = wrapped(np.arctan2(steps[:, 1], steps[:, 0]))
    own_yaws = np.unique([q[2] for q in endpoints])
    turns = np.abs(wrapped(yaws - own_yaws[:, None]))
    is_new = turns.min(axis=1) > 1e-9
    nearest = turns.argmin(axis=1)
    all_yaws = np.concatenate([yaws, own_yaws[is_new]])
    all_steps = np.concatenate([steps, steps[nearest[is_new]]])
    order = np.argsort(all_yaws)
    return Drives(all_yaws[order], all_steps[order], order >= len(yaws))


def _measure_guide(
    edges: LocalPlanner, endpoints: Endpoints, is_backwards: bool, until: float
) -> tuple[Guide, bool]:
    """Compute the cost to the goal from cells and headings.

    Also return whether the start is reached. The search goes on past the start, by a margin. Raises
    TimeoutError after ``until``.
    """
    grid = edges.cells.grid
    is_car = edges.turning_radius is not None
    yaws, steps, _ = _list_drives(endpoints)
    free = np.stack([_find_free_cells(edges, yaw) for yaw in yaws])
    turns = [np.abs(wrapped(yaws - q[2])) for q in endpoints]
    cells = [grid.cell_of(q[:2]) + MAX_STEP_CELLS for q in endpoints]
    start, goal = (
        int(np.ravel_multi_index((turn.argmin(), *cell), free.shape))
        for turn, cell in zip(turns, cells, strict=True)
    )
    x, y = np.ogrid[: free.shape[1], : free.shape[2]]
    to_start = np.hypot(x - cells[0][0], y - cells[0][1]).astype(np.float32)
    estimate = Estimate(1.0, to_start[None], _cells_per_radian(edges) * turns[0])
    ground = _make_ground(edges, free, yaws, steps, is_backwards)
    progress = make_progress(free.size, INITIAL_QUEUE_LENGTH)
    progress.previous[goal] = goal + 1
    push(progress, 0.0, goal)
    while not spread_costs(ground, estimate, progress, start, MARGIN_CELLS[is_car]):
        check_deadline(until)
        if progress.length[0] + MAX_SPREAD >= len(progress.queue):
            doubled = 2 * len(progress.queue)
            progress = progress._replace(
                keys=np.resize(progress.keys, doubled), queue=np.resize(progress.queue, doubled)
            )
    reaches_start = bool(progress.previous[start])
    # On the spot, the guide reaches all states that may lie on the path; cars may pass between
    # them.
    unreached = math.inf
    if is_car or not reaches_start:
        unreached = float(progress.cost[start] + UNREACHED_CELLS) * grid.spacing
    guide = Guide(
        goal=cast(Pose, endpoints[1]),
        headings=yaws,
        costs=progress.cost.reshape(free.shape),
        reached=progress.previous.reshape(free.shape),
        unreached=unreached,
    )
    return guide, reaches_start


def _cells_per_radian(edges: LocalPlanner) -> float:
    """Return the cells that a radian of rotation costs in the first search."""
    return (edges.turning_radius or METRES_PER_RADIAN) / edges.cells.grid.spacing


def _make_ground(
    edges: LocalPlanner, free: Bools, yaws: Floats, steps: Ints, is_backwards: bool
) -> Ground:
    """Make the cells and headings of the first search."""
    reverse_cost = math.inf
    if _can_reverse(edges):
        reverse_cost = REVERSE_WEIGHT if edges.turning_radius is not None else 1.0
    can_drive = [
        _can_drive(cells, dx, dy) for cells, (dx, dy) in zip(free, steps.tolist(), strict=True)
    ]
    can_turn = [_can_turn(edges, free, yaws, k) for k in range(len(yaws))]
    turns = np.diff(yaws, append=yaws[0] + TWO_PI)
    drive_costs = np.hypot(steps[:, 0], steps[:, 1])
    if is_backwards:
        # What the search drives ahead, the robot will drive in reverse.
        drive_costs *= reverse_cost
        reverse_cost = 1.0 / reverse_cost
    return Ground(
        can_drive=np.stack(can_drive),
        can_turn=np.stack(can_turn),
        steps=steps,
        drive_costs=drive_costs,
        turn_costs=_cells_per_radian(edges) * turns,
        reverse_cost=reverse_cost,
    )


def _find_free_cells(edges: LocalPlanner, yaw: float) -> Bools:
    """Return which cells of :class:`Ground` the robot may pass at a yaw, shape (nx, ny).

    These are FREE, or also MIXED if the geometry decides those.
    """
    states = edges.cells.states_at(yaw)
    may_pass = states != BLOCKED if edges.exact else states == FREE
    return np.pad(may_pass, MAX_STEP_CELLS)


def _can_drive(free: Bools, dx: int, dy: int) -> Bools:
    """Return from which cells a drive to the cell ``(dx, dy)`` further is free.

    The drive leads from center to center. Cells are closed: a segment through a corner touches all
    four cells.
    """
    can_drive: Bools = free
    columns = range(min(dx, 0), max(dx, 0) + 1)
    rows = range(min(dy, 0), max(dy, 0) + 1)
    for i, j in itertools.product(columns, rows):
        # The corners of cell (i, j) do not all lie strictly on one side of the segment.
        is_touched = 2 * abs(dx * j - dy * i) <= abs(dx) + abs(dy)
        if is_touched:
            can_drive = can_drive & np.roll(free, (-i, -j), axis=(0, 1))
    return can_drive


def _can_turn(edges: LocalPlanner, free: Bools, yaws: Floats, k: int) -> Bools:
    """Return at which cells the robot may turn from heading k to the next.

    A car needs FREE cells at both headings alone, because it turns as it drives. Other robots turn
    on the spot, so all rotation cells between must be FREE.
    """
    after = (k + 1) % len(yaws)
    can_turn: Bools = free[k] & free[after]
    if edges.turning_radius is None:
        rotations = edges.space.rotations
        first, last = rotations.cell_of(yaws[[k, after]])
        cells_to_last = (last - first) % len(rotations)
        for number in range(1, cells_to_last):
            between = (first + number) % len(rotations)
            can_turn = can_turn & _find_free_cells(edges, rotations.centers[between, 0])
    return can_turn


def make_progress(count: int, length: int) -> Progress:
    """Make an empty search over ``count`` nodes, with room for ``length`` in its queue."""
    return Progress(
        cost=np.zeros(count, dtype=np.float32),
        previous=np.zeros(count, dtype=np.int64),
        closed=np.zeros(count, dtype=np.bool_),
        keys=np.empty(length),
        queue=np.empty(length, dtype=np.int64),
        length=np.zeros(1, dtype=np.int64),
    )


def _can_reverse(edges: LocalPlanner) -> bool:
    """Return True if the robot may drive in reverse."""
    return edges.drive in ("differential-reverse", "reeds-shepp")


def _list_levels(
    edges: LocalPlanner, endpoints: Endpoints, guide: Guide, is_backwards: bool
) -> list[Motions]:
    """List the motions of each lattice, coarse to fine."""
    if edges.turning_radius is None:
        return [_list_spot_motions(edges, endpoints)]
    start = endpoints[0]
    counts = REVERSING_HEADINGS if _can_reverse(edges) else CAR_HEADINGS
    return [_list_car_motions(edges, start, count, guide, is_backwards) for count in counts]


def _list_spot_motions(edges: LocalPlanner, endpoints: Endpoints) -> Motions:
    """List the motions of a robot that turns on the spot.

    These are turns to the next headings, and drives ahead and perhaps in reverse. The headings are
    those of drives from one cell to another, and the yaws of start and goal.
    """
    spacing = edges.cells.grid.spacing
    yaws, steps, is_own = _list_drives(endpoints)
    # At the yaw of start or goal, a drive as long as a cell's diagonal leaves the cell.
    ahead = spacing * np.where(is_own, math.sqrt(2.0), np.hypot(steps[:, 0], steps[:, 1]))
    turns = [1, -1, 0]
    directions = [0.0, 0.0, 1.0]
    if _can_reverse(edges):
        turns.append(0)
        directions.append(-1.0)
    lengths = np.outer(ahead, directions)
    next_heading = (np.arange(len(yaws))[:, None] + turns) % len(yaws)
    radians = np.abs(wrapped(yaws[next_heading] - yaws[:, None]))
    return Motions(
        headings=yaws,
        nearest=np.arange(len(yaws)),
        next_heading=next_heading,
        steering=np.zeros(len(turns), dtype=np.int64),
        lengths=lengths,
        unit=1.0,
        costs=METRES_PER_RADIAN * radians + np.abs(lengths),
        side=spacing,
        switch_cost=0.0,
        greed=1.0,
        near=NEAR_CELLS * spacing,
        geometry=None,
    )


def _list_car_motions(
    edges: LocalPlanner, start: Endpoint, count: int, guide: Guide, is_backwards: bool
) -> Motions:
    """List the motions of a car.

    These are arcs to the next of ``count`` headings, and drives straight on, ahead or in reverse.
    The first heading is the start's.
    """
    radius = float(edges.turning_radius or math.nan)
    arc = TWO_PI / count
    spacing = edges.cells.grid.spacing
    yaws = wrapped(np.asarray(start[2] + arc * np.arange(count), dtype=np.float64))
    # The chord of an arc is twice as long as the diagonal of a cell. In larger cells, one
    # configuration often replaces another that alone leads into a tight slot.
    side = 0.5 * max(2.0 * radius * math.sin(0.5 * arc), spacing) / math.sqrt(2.0)
    straight = max(arc, MIN_STRAIGHT_RADII, 1.01 * math.sqrt(2.0) * side / radius)
    steering = np.array([1, -1, 0])
    lengths = np.array([arc, arc, straight])
    if _can_reverse(edges):
        steering = np.tile(steering, 2)
        lengths = np.concatenate([lengths, -lengths])
    costs = radius * np.abs(lengths) * np.where(lengths < 0.0, REVERSE_WEIGHT, 1.0)
    if is_backwards:
        # The costs are of the motions as the robot will drive them.
        lengths = -lengths
    turns = np.where(lengths < 0.0, -steering, steering)
    return Motions(
        headings=yaws,
        nearest=np.abs(wrapped(guide.headings - yaws[:, None])).argmin(axis=1),
        next_heading=(np.arange(count)[:, None] + turns) % count,
        steering=steering,
        lengths=np.tile(lengths, (count, 1)),
        unit=radius,
        costs=np.tile(costs, (count, 1)),
        side=side,
        switch_cost=SWITCH_RADII * radius,
        greed=CAR_GREED,
        near=max(NEAR_RADII * radius, NEAR_CELLS * spacing),
        geometry=edges.geometry(),
    )


def _search(
    edges: LocalPlanner,
    motions: Motions,
    guide: Guide,
    endpoints: Endpoints,
    max_nodes: int,
    until: float,
) -> tuple[Floats, str]:
    """Search from the start for a path to the goal, shape (n, 3).

    If n is 0, the note says what ended the search. Raises TimeoutError after ``until``.
    """
    start, goal = cast(tuple[Pose, Pose], endpoints)
    map_ = edges.bounded_map()
    capacity = max_nodes + motions.costs.shape[1]
    table_size = 4 * 2 ** max_nodes.bit_length()  # a power of 2, mostly empty
    progress = make_progress(capacity, capacity)
    nodes = Nodes(
        progress=progress,
        poses=np.empty((capacity, 3)),
        motions=np.empty((capacity, 2), dtype=np.int64),
        keys=np.empty(capacity, dtype=np.int64),
        table=np.full(table_size, NO_NODE),
        counts=np.zeros(2, dtype=np.int64),
    )
    radius = edges.turning_radius
    heading = int(np.abs(wrapped(motions.headings - start[2])).argmin())
    add_node(map_, motions, radius, guide, nodes, start, heading, 0.0, NO_NODE, 0)
    is_free = edges.edge_checker()
    best = math.inf
    last = NO_NODE
    reason = f"the lattice search ended at its limit of {max_nodes:,} nodes"
    # No node that waits can beat a path cheaper than the first key of the queue.
    while nodes.counts[0] < max_nodes and progress.keys[0] < best:
        node = expand_nodes(map_, motions, radius, guide, nodes, max_nodes)
        if last != NO_NODE and clock() > until:
            break
        check_deadline(until)
        if node == NO_NODE:
            reason = "the lattice search reached no more nodes"
            break
        q = nodes.poses[node]
        if node == TIME_CHECK or not is_free(*q.tolist(), *goal):
            continue
        total = progress.cost[node] + edges.edge_lengths(q[None], np.array([goal]))[0]
        if total < best:
            best = total
            last = node
        if motions.greed > 1.0:  # its remaining costs are no lower bounds anyway
            break
    if last == NO_NODE:
        return np.empty((0, 3)), reason
    return _trace_path(nodes, last, endpoints, radius is None), ""


def _trace_path(nodes: Nodes, node: int, endpoints: Endpoints, merges: bool) -> Floats:
    """Trace the path from the start by a node to the goal, shape (n, 3).

    If ``merges``, successive drives along one heading become one.
    """
    rows: list[Sequence[float]] = []
    while node != NO_NODE:
        rows.append(nodes.poses[node].tolist())
        node = int(nodes.progress.previous[node])
    path: Floats = np.array(list(reversed(rows)))
    if merges and len(path) > 2:
        turns = np.diff(path[:, 2]) != 0.0
        is_corner = turns[:-1] | turns[1:]
        path = path[np.concatenate([[True], is_corner, [True]])]
    # The edge to the goal may lead in any direction.
    path = np.vstack([path, endpoints[1]])
    differs_from_next = (path[1:] != path[:-1]).any(axis=1)
    distinct: Floats = path[np.append(differs_from_next, True)]
    return distinct


def shorten_path(edges: LocalPlanner, path: Floats, until: float) -> Floats:
    """Shorten a path, shape (n, 3), by proven edges, until a reading of the clock."""
    check = edges.edge_checker()

    def is_free(*q: float) -> bool:
        return clock() < until and check(*q)

    def measure(*q: float) -> float:
        first, last = np.reshape(q, (2, 1, 3))
        return float(edges.edge_lengths(first, last)[0]) + COST_PER_EDGE

    paths = [path, _skip_waypoints(edges, path, is_free, until)]
    # A part of a curve need not be a shortest curve.
    if edges.turning_radius is None and clock() < until:
        paths.append(pulled_straight(paths[-1], edges.space.rotations, is_free, measure))
    # Cutting a corner may add turns, and rounding may make a part of an edge fail.
    paths += [edges.remove_turns(candidate) for candidate in paths]
    paths.sort(key=lambda rows: float(edges.edge_lengths(rows[:-1], rows[1:]).sum()))
    return next(filter(edges.are_free, paths), path)


def _skip_waypoints(
    edges: LocalPlanner, path: Floats, is_free: Callable[..., bool], until: float
) -> Floats:
    """Skip waypoints of a path, shape (n, 3), by free edges, for the shortest path.

    By dynamic programming, each waypoint is joined to an earlier one, and at least to the one
    before, whose edge belongs to the path.
    """
    previous = np.arange(-1, len(path) - 1)
    total = np.zeros(len(path))
    offsets = np.unique(np.geomspace(1, len(path), MAX_SHORTCUTS).astype(np.int64))
    for k in range(1, len(path)):
        if clock() >= until:
            break  # the remaining waypoints keep the waypoints before them
        earlier = k - offsets[offsets <= k]
        lengths = edges.edge_lengths(path[earlier], np.tile(path[k], (len(earlier), 1)))
        costs = total[earlier] + lengths + COST_PER_EDGE
        for rank in np.argsort(costs, kind="stable").tolist():
            candidate = earlier[rank]
            if candidate == k - 1 or is_free(*path[candidate].tolist(), *path[k].tolist()):
                previous[k] = candidate
                total[k] = costs[rank]
                break
    kept = [len(path) - 1]
    while kept[-1] > 0:
        kept.append(int(previous[kept[-1]]))
    kept.reverse()
    return path[kept]


@kernel
def spread_costs(
    ground: Ground, estimate: Estimate, progress: Progress, start: int, margin: float
) -> bool:
    """Spread the costs of states from the goal; return True when done.

    A state is a heading and a cell, ``(heading * nx + i) * ny + j``. Return False after many
    states, or if the queue is nearly full; the next call goes on.
    """
    _, nx, ny = estimate.positions.shape
    headings = len(ground.steps)
    can_reverse = ground.reverse_cost < math.inf
    for _ in range(NODES_PER_CLOCK_CHECK):
        if progress.length[0] == 0:
            return True
        if progress.length[0] + MAX_SPREAD >= len(progress.queue):
            return False
        state = pop_first(progress)
        if progress.closed[state]:
            continue
        progress.closed[state] = True
        row, j = divmod(state, ny)
        heading, i = divmod(row, nx)
        bound = progress.cost[state] + estimate.positions[0, i, j] + estimate.rotations[heading]
        if progress.closed[start] and bound > progress.cost[start] + margin:
            return True
        before = (heading - 1 + headings) % headings
        after = (heading + 1) % headings
        if ground.can_turn[heading, i, j]:
            reach_cell(estimate, progress, state, after, 0, i, j, ground.turn_costs[heading])
        if ground.can_turn[before, i, j]:
            reach_cell(estimate, progress, state, before, 0, i, j, ground.turn_costs[before])
        # The search runs backwards: the robot drives ahead from the cell behind to this one, or
        # back to it.
        dx = ground.steps[heading, 0]
        dy = ground.steps[heading, 1]
        cost = ground.drive_costs[heading]
        if ground.can_drive[heading, i - dx, j - dy]:
            reach_cell(estimate, progress, state, heading, 0, i - dx, j - dy, cost)
        if can_reverse and ground.can_drive[heading, i, j]:
            cost *= ground.reverse_cost
            reach_cell(estimate, progress, state, heading, 0, i + dx, j + dy, cost)
    return False


@kernel
def expand_nodes(
    map_: Map, motions: Motions, radius: float | None, guide: Guide, nodes: Nodes, max_nodes: int
) -> int:
    """Expand nodes until one may see the goal, and return it.

    Return :data:`NO_NODE` if none is left, and :data:`TIME_CHECK` after many nodes or at
    `max_nodes`; the next call goes on.
    """
    progress = nodes.progress
    poses = nodes.poses
    goal = guide.goal
    for _ in range(NODES_PER_CLOCK_CHECK):
        if progress.length[0] == 0:
            return NO_NODE
        if nodes.counts[0] >= max_nodes:
            return TIME_CHECK
        node = pop_first(progress)
        if progress.closed[node]:
            continue
        progress.closed[node] = True
        nodes.counts[1] += 1
        x = poses[node, 0]
        y = poses[node, 1]
        cost = progress.cost[node]
        last = nodes.motions[node, 0]
        heading = nodes.motions[node, 1]
        for move in range(len(motions.steering)):
            after = motions.next_heading[heading, move]
            length = motions.lengths[heading, move]
            total = cost + motions.costs[heading, move]
            if motions.lengths[heading, last] * length < 0.0:
                total += motions.switch_cost
            begin = (0.0, 0.0, motions.headings[heading])
            u, v, _ = advance(begin, motions.steering[move], length)
            next_x = x + motions.unit * u
            next_y = y + motions.unit * v
            if abs(next_x - goal[0]) + abs(next_y - goal[1]) < 1e-6 * motions.side:
                # Otherwise rounding would give the last edge a heading.
                next_x = goal[0]
                next_y = goal[1]
            is_inside_x = map_.lower[1] <= next_x <= map_.upper[1]
            is_inside_y = map_.lower[2] <= next_y <= map_.upper[2]
            if is_inside_x and is_inside_y:
                q = (next_x, next_y, motions.headings[after])
                add_node(map_, motions, radius, guide, nodes, q, after, total, node, move)
        is_near = math.hypot(x - goal[0], y - goal[1]) < motions.near
        if is_near or nodes.counts[1] % NODES_PER_GOAL_EDGE == 0:
            return node
    return TIME_CHECK


@kernel
def add_node(
    map_: Map,
    motions: Motions,
    radius: float | None,
    guide: Guide,
    nodes: Nodes,
    q: Pose,
    heading: int,
    cost: float,
    parent: int,
    move: int,
) -> None:
    """Add a configuration if its motion is proven free.

    The motion is ``move`` from node ``parent`` (-1 for the start). The configuration is left out if
    its cell and heading have a node that is hardly dearer than ``cost``.
    """
    progress = nodes.progress
    key = make_key(map_, motions, q, heading)
    slot = find_slot(nodes, key)
    known = nodes.table[slot]
    if known >= 0 and progress.cost[known] <= cost + KNOWN_TOLERANCE * motions.side:
        return
    left = estimate_cost_to_goal(map_, motions, guide, q[0], q[1], heading)
    bound = cost + motions.greed * left
    if not bound < math.inf:
        return
    # The proof comes last, because it takes the most time.
    if parent >= 0 and not motion_is_free(map_, motions, radius, nodes, parent, move, q):
        return
    if known >= 0:
        progress.closed[known] = True
    node = nodes.counts[0]
    nodes.counts[0] += 1
    nodes.table[slot] = node
    nodes.keys[node] = key
    for axis in range(3):
        nodes.poses[node, axis] = q[axis]
    nodes.motions[node, 0] = move
    nodes.motions[node, 1] = heading
    progress.cost[node] = cost
    progress.previous[node] = parent
    push(progress, bound, node)


@kernel
def make_key(map_: Map, motions: Motions, q: Pose, heading: int) -> int:
    """Return the hash key of a configuration's cell and heading."""
    i = math.floor((q[0] - map_.lower[1]) / motions.side)
    j = math.floor((q[1] - map_.lower[2]) / motions.side)
    cell = (i << KEY_BITS) + j
    return cell * len(motions.headings) + heading


@kernel
def find_slot(nodes: Nodes, key: int) -> int:
    """Return the slot of the hash table that holds a key, or the free slot for it."""
    mask = len(nodes.table) - 1
    slot = (key * HASH_FACTOR >> HASH_SHIFT) & mask
    while nodes.table[slot] >= 0 and nodes.keys[nodes.table[slot]] != key:
        slot = (slot + 1) & mask
    return slot


@kernel
def motion_is_free(
    map_: Map, motions: Motions, radius: float | None, nodes: Nodes, parent: int, move: int, q: Pose
) -> bool:
    """Return True if a motion from a node to `q` is proven free."""
    x, y, yaw = nodes.poses[parent, 0], nodes.poses[parent, 1], nodes.poses[parent, 2]
    # Numba leaves the branch of cars out if there is no radius.
    if radius is None:
        start = position_in_plane(map_, x, y)
        end = position_in_plane(map_, q[0], q[1])
        return edge_is_free(map_, start, (yaw,), end, (q[2],))
    steer = motions.steering[move]
    length = motions.lengths[0, move]  # at all headings
    geometry = motions.geometry
    if not piece_is_free(map_, geometry, radius, q, 0.0, 0.0, ARC_ERROR):
        return False
    begin = (0.0, 0.0, yaw)
    origin = (x, y, yaw)
    return segment_is_free(map_, geometry, radius, origin, begin, steer, length, ARC_ERROR)


@kernel
def estimate_cost_to_goal(
    map_: Map, motions: Motions, guide: Guide, x: float, y: float, heading: int
) -> float:
    """Estimate the cost from a position and heading to the goal, metres."""
    i = math.floor((x - map_.lower[1]) / map_.spacing) + MAX_STEP_CELLS
    j = math.floor((y - map_.lower[2]) / map_.spacing) + MAX_STEP_CELLS
    straight = math.hypot(x - guide.goal[0], y - guide.goal[1])
    k = motions.nearest[heading]
    if guide.reached[k, i, j] == 0:
        return straight + guide.unreached
    metres: float = guide.costs[k, i, j] * map_.spacing
    return max(straight, metres)

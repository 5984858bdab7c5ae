"""Search on a lattice of headings, for non-holonomic drives.

The search runs from the start, guided by the length of the shortest chain of blocks of cells to the
goal. It keeps one configuration for each cell and heading (hybrid A*), so positions are not
rounded, and map or geometry prove each motion. From nodes near the goal, and from some others, one
edge may lead to the goal. For a car that reverses, the search runs from the goal if there is less
room at the goal. Then :func:`shorten_path` shortens the path.

If metres cost more in some cells, a second search minimises the cost. It goes on after the first
edge to the goal, until no other node promises a cheaper path.

References
----------
M. Pivtoraiko and A. Kelly, "Efficient constrained path planning via search in state
lattices", 2005; D. Dolgov, S. Thrun, M. Montemerlo and J. Diebel, "Practical search techniques in
path planning for autonomous driving", 2008.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, cast

import numpy as np
import shapely

from cspace import CSpace, Space
from cspace.inside import (
    NEVER,
    Bools,
    Effort,
    Endpoint,
    Floats,
    Ints,
    Map,
    heap,
    internal,
    is_over,
    kernel,
    map_record,
    now,
    slice_of,
    spend,
    tube_is_free,
    wrap_angles,
)
from planners._edges.car_curves import (
    MAX_GAP,
    POINT_ERROR,
    Pose,
    advance,
    piece_is_free,
    position_in_plane,
    segment_is_free,
)
from planners._edges.driven import FINE_HEADINGS, DrivenEdges, Motions
from planners._edges.drives import has_drives
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._searches.built_in import BuiltInSearch
from planners._searches.estimate import NO_NODE, UNKNOWN, Costs, Estimate, is_known, remaining_cost
from planners._searches.frontier import Progress, check_deadline, double, make_progress
from planners._searches.guide import NO_FACTORS, Directions, Guide, factor_at
from planners._searches.moves import list_moves
from planners._searches.paths import (
    MAX_SHORTENING,
    drop_repeats,
    find_cheapest_subpath,
    pulled_straight,
)
from planners._task import WEIGHTED, PlanTask

MAX_DEVIATION: Final = math.radians(14.0)
"""Largest angle between a move of the guide and the robot's yaw on it; at larger angles, another
move is nearer."""

KNOWN_TOLERANCE: Final = 0.01
"""Fraction of a cell's side by which a path into a cell must be cheaper to replace the known path.
"""

HASH_FACTOR: Final = 0x9E3779B97F4A7C1
"""Odd factor that spreads keys over the hash table (D. Knuth, "Sorting and Searching", 6.4)."""

ARC_ERROR: Final = MAX_GAP * (1.0 + math.tau) + POINT_ERROR
"""Distance, in turning radii, within which a driven motion stays near the computed one."""

EDGE_COST: Final = 1e-6
"""Extra cost of an edge when a path is shortened, metres; it merges collinear drives."""

MIN_DRIVE_CELLS: Final = 0.1
"""Length in cells of the shortest drive that shortening may add."""

MIN_ROUND_GAIN: Final = 1e-7
"""Share of a path by which a round must shorten it for another to follow."""

MAX_TRIES: Final = 64
"""Largest number of edges to the goal that are tried after a call of :func:`expand_nodes`."""

TIME_CHECK: Final = -3
FULL: Final = -4
"""Results of :func:`expand_nodes`, besides :data:`NO_NODE` and :data:`UNKNOWN`."""


@dataclass
class _Limit:
    """The end of a search, without the time to ask if paths exist."""

    until: Effort
    may_exist: Callable[[], bool]

    def admits_path(self) -> bool:
        """Return True if a path may exist."""
        began = now()
        answer = self.may_exist()
        self.until += now() - began
        return answer


class Target(NamedTuple):
    """The goal, and the costs on the way to it."""

    goal: Pose
    estimate: Estimate  # cost to the goal from positions and directions of the guide
    nearest: Ints  # (h,), the direction of the guide nearest to each heading
    factors: Costs  # (slices, 1, x, y), factors of the cost in each cell, or NO_FACTORS


class LatticeNodes(NamedTuple):
    """Configurations reached, and their queue.

    ``progress`` holds the cost of each node, the node before it, and whether it is closed. A node
    is closed when it was expanded, or when a cheaper path into its cell and heading replaced it.
    """

    progress: Progress
    poses: Floats  # (n, 3)
    motions: Ints  # (n, 2), the motion that led to each node, and its heading
    keys: Ints  # (n,), hash key of each node's cell and heading
    table: Ints  # hash table of nodes by key, each plus 1; 0 stands for none
    counts: Ints  # (3,), numbers of nodes, of expanded nodes, and of nodes to try
    tries: Ints  # (n,), nodes from which an edge may lead to the goal
    place: Ints  # (3,), direction and cell of the first node, if the guide has not reached it


def find_lattice_path(
    edges: DrivenEdges,
    endpoints: Endpoints,
    simplify: bool,
    effort: Effort,
    may_exist: Callable[[], bool],
) -> tuple[Floats, str]:
    """Find a path on a lattice, and shorten it.

    The map is in memory. A long search asks once whether a path ``may_exist``; the answer takes no
    time of the limit. If edges have costs, a search by cost follows that by length, and the
    cheaper path wins. Returns configurations (x, y, yaw), shape (n, 3), and a note. If the search
    finds no path, n is 0, and the note gives the reason.
    """
    began = now()
    limit = _Limit(began + effort, may_exist)
    plain = replace(edges, weights=None, drive=edges.plain_drive)
    path, reason = np.array(endpoints), ""
    if not plain.edge_checker()(*endpoints[0], *endpoints[1]):
        path, reason = _find_path(plain, endpoints, simplify, limit)
    if not edges.has_costs or not len(path):
        return path, reason
    if edges.drive_has_costs:
        path = _keep_motion(edges, plain, path, simplify, limit)
    # No path costs less than a short one whose metres cost nothing extra.
    most = 1.0 + MIN_ROUND_GAIN
    if len(path) and edges.path_cost(path) <= most * edges.path_length(path):
        return path, reason
    # The robot may be unable to drive along a cheap way.
    work = max(4.0 * (now() - began).work, Effort.from_seconds(0.25, math.inf).work)
    limit.until = limit.until.at_most(now() + Effort(work, math.inf))
    cheap_path, _ = _find_path(edges, endpoints, simplify, limit)
    edge = np.array(endpoints)
    paths = [each for each in (path, cheap_path) if len(each)]
    if edges.drive_has_costs and edges.are_free(edge):
        paths.append(edge)
    return min(paths, key=edges.path_cost, default=path), reason


def _keep_motion(
    edges: DrivenEdges, plain: DrivenEdges, path: Floats, simplify: bool, limit: _Limit
) -> Floats:
    """Return a path of ``plain`` edges as one of edges with a drive's costs, shape (n, 3).

    Of the ways along a long edge, another one may cost less. Short edges have the same motion. The
    result has no row if one is not proven.
    """
    path = plain.resample(path, edges.metres_per_radian / edges.drive.reverse_cost)
    if not edges.are_free(path):
        return path[:0]
    return shorten_path(edges, path, limit.until + MAX_SHORTENING) if simplify else path


def _find_path(
    edges: DrivenEdges, endpoints: Endpoints, simplify: bool, limit: _Limit
) -> tuple[Floats, str]:
    """Find a path by one search; see :func:`find_lattice_path`."""
    is_backwards = _starts_at_goal(edges, endpoints)
    if is_backwards:
        endpoints = endpoints[::-1]
    try:
        path, reason = _search_levels(edges, endpoints, is_backwards, limit)
    except TimeoutError:
        return np.empty((0, 3)), ""
    if simplify and len(path):
        path = shorten_path(edges, path, limit.until + MAX_SHORTENING)
    return path, reason


def _search_levels(
    edges: DrivenEdges,
    endpoints: Endpoints,
    is_backwards: bool,
    limit: _Limit,
) -> tuple[Floats, str]:
    """Search coarse to fine lattices, and around stalled blocks.

    Return path and note, and raise errors, as :func:`_search` does.
    """
    guide = _make_guide(edges, endpoints, is_backwards)
    yaws, _, lengths = _list_moves_by_yaw()
    levels = edges.list_lattices(endpoints[:2], yaws, lengths, is_backwards)
    # Least number of nodes at which a search counts as stalled; it doubles after each stall.
    min_stalled = 2**14
    while True:
        for motions in levels:
            arrival = _Arrival(edges, cast(Pose, endpoints[1]), is_backwards)
            path, reason, vain = _search(
                edges, motions, guide, endpoints, arrival, min_stalled, limit
            )
            if is_backwards:
                path = path[::-1]
            if len(path) and edges.are_free(path):
                return path, ""
            if len(path):
                reason = "rounding keeps the path of the lattice from being proven"
            if not limit.admits_path():  # finer lattices take longer than the proof
                return np.empty((0, 3)), reason
            if vain is not None and len(motions.headings) >= FINE_HEADINGS:
                break
        if vain is None:
            return np.empty((0, 3)), reason
        guide.avoid(vain)
        min_stalled *= 2


def _starts_at_goal(edges: DrivenEdges, endpoints: Endpoints) -> bool:
    """Return True if a search from the goal is easier.

    It is easier out of a tight place than into it, because few motions are free there.
    """
    if not edges.escape_reach:
        return False
    room_at_start, room_at_goal = (_measure_room(edges, q) for q in endpoints)
    return room_at_goal < room_at_start


def _measure_room(edges: DrivenEdges, q: Endpoint) -> int:
    """Count passable cells around a configuration, at yaws near its own."""
    grid = edges.cells.grid
    reach = math.ceil(edges.escape_reach / grid.spacing)
    center = grid.cell_of(q[:2])
    low = np.maximum(center - reach, 0)
    high = center + reach + 1
    window = np.s_[low[0] : high[0], low[1] : high[1]]
    yaws = (q[2] - 0.5, q[2], q[2] + 0.5)
    worst = edges.worst_state
    return sum(int((edges.cells.states_at(yaw)[window] <= worst).sum()) for yaw in yaws)


def _list_moves_by_yaw() -> tuple[Floats, Ints, Floats]:
    """List the guide's moves by yaw: (n,), (n, 3), (n,)."""
    moves = list_moves(2)
    yaws = np.arctan2(moves.steps[:, 2], moves.steps[:, 1])
    order = np.argsort(yaws)
    return yaws[order], moves.steps[order], moves.lengths[order]


def _make_guide(edges: DrivenEdges, endpoints: Endpoints, is_backwards: bool) -> Guide:
    """Make the guide over blocks of cells."""
    grid = edges.cells.grid
    nearest = _find_nearest(np.array([q[2] for q in endpoints])).tolist()
    cells = np.minimum(grid.cell_of(np.array(endpoints)[:, :2]), np.array(grid.shape) - 1)
    start, goal = (
        (direction, (0, i, j)) for direction, (i, j) in zip(nearest, cells.tolist(), strict=True)
    )
    return Guide(
        map_record(edges.cells).states,
        _list_directions(edges, is_backwards),
        start,
        goal,
        _measure_block_side(edges.cells),
        narrow_cost=edges.narrow_cost,
        factors=_list_factors(edges),
        worst_state=edges.worst_state,
    )


def _list_factors(edges: LocalPlanner) -> Costs:
    """List the factors of the cost in each cell, for kernels."""
    if edges.weights is None:
        return NO_FACTORS
    return edges.weights.factors.reshape(map_record(edges.cells).states.shape)


def _measure_block_side(space: CSpace) -> int:
    """Choose the side of the guide's blocks, in cells.

    No chain leads across a wall of blocks, because an obstacle blocks two radii of a circle in the
    robot. A circle away from the reference point moves as the robot turns, so it counts for less.
    """
    robot = space.drawn_robot
    circle = shapely.maximum_inscribed_circle(robot.geometry)  # a line from its center
    # Half its shift as the robot turns to the next direction of the guide, deviations included.
    radius = circle.length - 0.5 * math.hypot(*circle.coords[0])
    cells_per_radius = int(max(radius, robot.shape.inner.inscribed_radius) / space.grid.spacing)
    # Blocks have at most eight cells along each side.
    return min(max(cells_per_radius, 1), 8)


def _list_directions(edges: DrivenEdges, is_backwards: bool) -> Directions:
    """List the moves and turns in each direction of the guide."""
    yaws, steps, lengths = _list_moves_by_yaw()
    moves = steps[:, np.newaxis]
    costs = lengths[:, np.newaxis]
    if edges.reverses:
        # The robot drives the motions of a backward search in the opposite direction.
        weights = (1.0, edges.reverse_weight)
        if is_backwards:
            weights = weights[::-1]
        moves = np.concatenate([moves, -moves], axis=1)
        costs = costs * weights
    numbers = np.arange(len(yaws))
    neighbors = np.stack([numbers - 1, numbers + 1], axis=1) % len(yaws)
    turns = np.abs(wrap_angles(yaws[neighbors] - yaws[:, np.newaxis]))
    cells_per_radian = edges.metres_per_radian / edges.cells.grid.spacing
    return Directions(
        slices=_list_slices_near(edges, yaws),
        moves=moves,
        move_costs=costs,
        neighbors=neighbors,
        turn_costs=cells_per_radian * turns,
    )


def _list_slices_near(edges: LocalPlanner, yaws: Floats) -> Ints:
    """List slices near each yaw, nearest first, shape (yaws, n)."""
    rotations = edges.space.rotations
    slice_of: Ints = map_record(edges.cells).rotations.slice_of
    count = math.ceil(MAX_DEVIATION * len(rotations) / math.tau)
    deviations = MAX_DEVIATION * np.arange(-count, count + 1) / count
    deviations = deviations[np.argsort(np.abs(deviations))]
    near = wrap_angles(yaws[:, np.newaxis] + deviations)
    return np.asarray(slice_of[rotations.cell_of(near)])


def _find_nearest(yaws: Floats) -> Ints:
    """Find the guide's directions nearest to yaws, shape (n,)."""
    guide_yaws, _, _ = _list_moves_by_yaw()
    turns = np.abs(wrap_angles(guide_yaws - yaws[:, np.newaxis]))
    return np.asarray(turns.argmin(axis=1))


def _search(
    edges: DrivenEdges,
    motions: Motions,
    guide: Guide,
    endpoints: Endpoints,
    arrival: _Arrival,
    min_stalled: int,
    limit: _Limit,
) -> tuple[Floats, str, Bools | None]:
    """Search for a path from start to goal, shape (n, 3).

    If n is 0, the note gives the reason; if the search stalled, blocks to avoid follow. With
    fewer than ``min_stalled`` nodes, it does not count as stalled. Raises TimeoutError at
    the limit.
    """
    start, goal = cast(tuple[Pose, Pose], endpoints)
    map_ = edges.bounded_map()
    nodes = _make_nodes(2**13)
    nearest = _find_nearest(motions.headings)
    target = Target(goal, guide.estimate, nearest, _list_factors(edges))
    heading = int(np.abs(wrap_angles(motions.headings - start[2])).argmin())
    add_node(map_, motions, target, nodes, start, heading, 0.0, NO_NODE, 0)
    reason = f"the lattice search ended at its limit of {motions.max_nodes:,} nodes"
    may_fail = True
    while nodes.counts[0] < motions.max_nodes:
        before = nodes.counts[:2].sum()
        event = expand_nodes(map_, motions, target, nodes)
        spend(motions.nanoseconds * int(nodes.counts[:2].sum() - before))
        if arrival.try_edges(nodes, limit.until):
            break
        if arrival.node == NO_NODE:
            check_deadline(limit.until)
        # After this number of nodes, ask whether a path may exist.
        if may_fail and nodes.counts[1] >= 2**12:
            if not limit.admits_path():
                break
            may_fail = False
        if event == UNKNOWN:
            direction, i, j = nodes.place.tolist()
            guide.reach(direction, (0, i, j), limit.until)
        elif event == FULL:
            vain = _find_vain_blocks(map_, target, nodes)
            is_stalled = len(nodes.keys) >= min_stalled and arrival.node == NO_NODE
            if is_stalled and vain.any():
                return np.empty((0, 3)), "the lattice search stalled", vain
            nodes = _enlarge(nodes)
        elif event == NO_NODE:
            reason = "the lattice search reached no more nodes"
            break
    if arrival.node != NO_NODE:
        # A long drive in reverse may cost more than turning around, which need not be free.
        merges = not (edges.has_curves or edges.drive_has_costs)
        return _trace_path(nodes, arrival.node, endpoints, merges), "", None
    return np.empty((0, 3)), reason, None


class _Arrival:
    """The best path to the goal so far, by an edge from a node.

    In a search by length it is the first path, by cost the cheapest.
    """

    def __init__(self, edges: LocalPlanner, goal: Pose, is_backwards: bool) -> None:
        self._is_free = edges.edge_checker()
        self._measure = edges.weigh()
        self._goal = goal
        self._is_backwards = is_backwards
        self._cost = math.inf
        self.node = NO_NODE

    def try_edges(self, nodes: LatticeNodes, until: Effort) -> bool:
        """Try the nodes kept for it; return True if no open one promises a better path."""
        count = int(nodes.counts[2])
        nodes.counts[2] = 0
        for node in nodes.tries[:count].tolist():
            self._try_edge(nodes, node)
            if self._is_settled(nodes, until):
                return True
        return self._is_settled(nodes, until)

    def _try_edge(self, nodes: LatticeNodes, node: int) -> None:
        """Take the edge from a node if it is free and better."""
        pose = nodes.poses[node].tolist()
        # A search from the goal arrives where the robot begins.
        edge = (*self._goal, *pose) if self._is_backwards else (*pose, *self._goal)
        cost = -math.inf
        if self._measure is not None:
            cost = float(nodes.progress.cost[node]) + self._measure(*edge)
        if cost < self._cost and self._is_free(*edge):
            self._cost = cost
            self.node = node

    def _is_settled(self, nodes: LatticeNodes, until: Effort) -> bool:
        """Return True if no open node promises a better path.

        After ``until``, any path will do.
        """
        if self.node == NO_NODE:
            return False
        return self._cost <= nodes.progress.keys[0] or is_over(until)


def _make_nodes(capacity: int) -> LatticeNodes:
    """Make arrays for ``capacity`` nodes, a power of 2."""
    return LatticeNodes(
        progress=make_progress(capacity, capacity),
        poses=np.empty((capacity, 3)),
        motions=np.empty((capacity, 2), dtype=np.int64),
        keys=np.empty(capacity, dtype=np.int64),
        table=np.zeros(4 * capacity, dtype=np.int64),  # most slots are empty
        counts=np.zeros(3, dtype=np.int64),
        tries=np.empty(MAX_TRIES, dtype=np.int64),
        place=np.zeros(3, dtype=np.int64),
    )


def _enlarge(nodes: LatticeNodes) -> LatticeNodes:
    """Copy nodes into arrays of twice the capacity."""
    progress = nodes.progress
    larger = nodes._replace(
        progress=progress._replace(
            cost=double(progress.cost),
            previous=double(progress.previous),
            closed=double(progress.closed),
            keys=double(progress.keys),
            queue=double(progress.queue),
        ),
        poses=double(nodes.poses),
        motions=double(nodes.motions),
        keys=double(nodes.keys),
        table=np.zeros(2 * len(nodes.table), dtype=np.int64),
    )
    fill_table(larger)
    return larger


def _find_vain_blocks(map_: Map, target: Target, nodes: LatticeNodes) -> Bools:
    """Find blocks that a stalled search never entered, (1, x, y).

    They are near the node that the guide deems nearest to the goal. There are none if that node is
    among the newest three quarters, because then the search advances.
    """
    count = nodes.counts[0]
    estimate = target.estimate
    _, *shape = vain_shape = estimate.positions.shape[1:]
    offsets = nodes.poses[:count, :2] - map_.lower[1:3]
    blocks = (offsets / (estimate.side * map_.spacing)).astype(np.int64)
    columns, rows = np.minimum(blocks, np.array(shape) - 1).T
    states = target.nearest[nodes.motions[:count, 1]], 0, columns, rows
    left = np.where(estimate.reached[states] > 0, estimate.positions[states], math.inf)
    best = int(left.argmin())
    vain = np.zeros(vain_shape, dtype=np.bool_)
    if 4 * best < count:
        # Avoid blocks at most three blocks away.
        low = np.maximum(blocks[best] - 3, 0)
        high = blocks[best] + 4
        vain[0, low[0] : high[0], low[1] : high[1]] = True
        vain[0, columns, rows] = False
    return vain


def _trace_path(nodes: LatticeNodes, node: int, endpoints: Endpoints, merges: bool) -> Floats:
    """Return the path by a node to the goal, (n, 3).

    If ``merges``, successive drives along one heading become one.
    """
    chain: list[int] = []
    while node != NO_NODE:
        chain.append(node)
        node = int(nodes.progress.previous[node])
    path = nodes.poses[chain[::-1]]
    if merges and len(path) > 2:
        turns = np.diff(path[:, 2]) != 0.0
        is_corner = turns[:-1] | turns[1:]
        path = path[np.concatenate([[True], is_corner, [True]])]
    # The edge to the goal may lead in any direction.
    return drop_repeats(np.vstack([path, endpoints[1]]))


def shorten_path(edges: LocalPlanner, path: Floats, until: Effort) -> Floats:
    """Lower the cost of a path, shape (n, 3), until the end."""
    # Without cut corners, a second round of skipping gains little.
    rounds = 1 if edges.has_curves else 3
    for number in range(rounds):
        if is_over(until):
            break
        before = path
        path = _shorten_once(edges, path, until)
        if number < rounds - 1:
            most = (1.0 - MIN_ROUND_GAIN) * edges.path_cost(before)
            if edges.path_cost(path) > most:
                break
    return path


def _shorten_once(edges: LocalPlanner, path: Floats, until: Effort) -> Floats:
    """Skip waypoints of a path, and cut corners between straights."""
    is_proven = edges.edge_checker()
    cost = edges.cost()
    shortest = MIN_DRIVE_CELLS * edges.cells.grid.spacing

    def is_free(*q: float) -> bool:
        """Return True if an edge is proven, and no tiny drive between two turns."""
        metres = math.dist(q[:2], q[3:5])
        return (metres == 0.0 or metres >= shortest) and is_proven(*q)

    def measure(*q: float) -> float:
        """Return the cost of an edge, plus a little for each edge."""
        return cost(*q) + EDGE_COST

    # A cost takes longer to measure than a length.
    count = 24 if edges.weights is None else 12
    strides = np.unique(np.geomspace(1, len(path), count).astype(np.int64)).tolist()
    paths = [path, find_cheapest_subpath(path, 2, is_free, measure, strides, until)]
    # A part of a curve need not be a shortest curve.
    if not edges.has_curves and not is_over(until):
        paths.append(pulled_straight(paths[-1], edges.space.rotations, is_free, measure, until))
    if is_over(NEVER):
        return path
    # Cutting a corner may add turns, and rounding may make a part of an edge fail.
    paths += [edges.remove_turns(candidate) for candidate in paths]
    paths.sort(key=lambda rows: edges.path_cost(rows) + EDGE_COST * len(rows))
    return next(filter(edges.are_free, paths), path)


@kernel
def expand_nodes(map_: Map, motions: Motions, target: Target, nodes: LatticeNodes) -> int:
    """Expand nodes; keep those that may reach the goal.

    Return :data:`NO_NODE` if the queue is empty, and :data:`TIME_CHECK` after many nodes, or a few
    that may reach the goal; the next call goes on. Return :data:`FULL` if there is no memory for
    more nodes, and :data:`UNKNOWN` if the guide has not reached the first node.
    """
    progress = nodes.progress
    poses = nodes.poses
    goal = target.goal
    # Nodes taken from the queue between two checks of the time limit.
    for _ in range(2**12):
        if progress.length[0] == 0:
            return NO_NODE
        if nodes.counts[0] + len(motions.steering) > len(nodes.keys):
            return FULL
        node: int = progress.queue[0]
        if progress.closed[node]:
            heap.pop_first(progress)
            continue
        x = poses[node, 0]
        y = poses[node, 1]
        cost = progress.cost[node]
        last = nodes.motions[node, 0]
        heading = nodes.motions[node, 1]
        direction = target.nearest[heading]
        i, j = find_cell(map_, target, x, y)
        if not is_known(target.estimate, direction, 0, i, j):
            nodes.place[0] = direction
            nodes.place[1] = i
            nodes.place[2] = j
            return UNKNOWN
        # The guide may have reached the node since it was queued.
        bound = cost + motions.greed * estimate_cost_to_goal(map_, target, cost, direction, x, y)
        is_outdated = bound > progress.keys[0]
        heap.pop_first(progress)
        if is_outdated:
            heap.push(progress, bound, node)
            continue
        progress.closed[node] = True
        nodes.counts[1] += 1
        for move in range(len(motions.steering)):
            after = motions.next_heading[heading, move]
            length = motions.lengths[heading, move]
            factor = mean_factor(map_, motions, target, x, y, heading, move)
            total = cost + motions.costs[heading, move] * factor
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
                add_node(map_, motions, target, nodes, q, after, total, node, move)
        is_near = math.hypot(x - goal[0], y - goal[1]) < motions.near
        # Far from the goal, some nodes try an edge to the goal, too.
        if is_near or nodes.counts[1] % 16 == 0:
            nodes.tries[nodes.counts[2]] = node
            nodes.counts[2] += 1
            # A call takes longer than an edge, but no node is expanded far beyond the goal.
            if nodes.counts[2] >= min(1 + nodes.counts[1] // 64, len(nodes.tries)):
                return TIME_CHECK
    return TIME_CHECK


@kernel
def add_node(
    map_: Map,
    motions: Motions,
    target: Target,
    nodes: LatticeNodes,
    q: Pose,
    heading: int,
    cost: float,
    parent: int,
    move: int,
) -> None:
    """Add a configuration if its motion is proven free.

    The motion is ``move`` from node ``parent`` (-1 for the start). A configuration is skipped if a
    node with its cell and heading costs at most slightly more than ``cost``.
    """
    progress = nodes.progress
    key = make_key(map_, motions, q, heading)
    slot = find_slot(nodes, key)
    known = nodes.table[slot] - 1
    if known >= 0 and progress.cost[known] <= cost + KNOWN_TOLERANCE * motions.side:
        return
    left = estimate_cost_to_goal(map_, target, cost, target.nearest[heading], q[0], q[1])
    bound = cost + motions.greed * left
    if not bound < math.inf:
        return
    # The proof comes last, because it takes the most time.
    if parent >= 0 and not motion_is_free(map_, motions, motions.radius, nodes, parent, move, q):
        return
    if known >= 0:
        progress.closed[known] = True
    node = nodes.counts[0]
    nodes.counts[0] += 1
    nodes.table[slot] = node + 1
    nodes.keys[node] = key
    for axis in range(3):
        nodes.poses[node, axis] = q[axis]
    nodes.motions[node, 0] = move
    nodes.motions[node, 1] = heading
    progress.cost[node] = cost
    progress.previous[node] = parent
    heap.push(progress, progress.cost[node] + motions.greed * left, node)


@kernel
def fill_table(nodes: LatticeNodes) -> None:
    """Enter each cell and heading's last node."""
    for node in range(nodes.counts[0]):
        nodes.table[find_slot(nodes, nodes.keys[node])] = node + 1


@internal
def mean_factor(
    map_: Map, motions: Motions, target: Target, x: float, y: float, heading: int, move: int
) -> float:
    """Average the cost factor along a motion by the midpoint rule.

    The motion starts at the position (x, y).
    """
    if target.factors.shape[0] == 0:
        return 1.0
    length = motions.lengths[heading, move]
    steps = max(math.ceil(motions.unit * abs(length) / map_.spacing), 1)
    begin = (0.0, 0.0, motions.headings[heading])
    total = 0.0
    for step in range(steps):
        u, v, yaw = advance(begin, motions.steering[move], length * (step + 0.5) / steps)
        i, j = find_cell(map_, target, x + motions.unit * u, y + motions.unit * v)
        number = slice_of(map_, (yaw,))
        total += float(factor_at(target.factors, number, 0, max(i, 0), max(j, 0)))
    mean: float = total / steps
    return mean


@internal
def make_key(map_: Map, motions: Motions, q: Pose, heading: int) -> int:
    """Return the hash key of a cell and heading."""
    i = math.floor((q[0] - map_.lower[1]) / motions.side)
    j = math.floor((q[1] - map_.lower[2]) / motions.side)
    cell = (i << 24) + j
    return cell * len(motions.headings) + heading


@internal
def find_slot(nodes: LatticeNodes, key: int) -> int:
    """Return a key's slot in the hash table, or a free slot."""
    mask = len(nodes.table) - 1
    slot = (key * HASH_FACTOR >> 20) & mask  # the lowest bits are spread the least
    while nodes.table[slot] > 0 and nodes.keys[nodes.table[slot] - 1] != key:
        slot = (slot + 1) & mask
    return slot


@internal
def motion_is_free(
    map_: Map,
    motions: Motions,
    radius: float | None,
    nodes: LatticeNodes,
    parent: int,
    move: int,
    q: Pose,
) -> bool:
    """Return True if a node's motion to `q` is proven free."""
    x, y, yaw = nodes.poses[parent, 0], nodes.poses[parent, 1], nodes.poses[parent, 2]
    # Numba leaves the branch of cars out if there is no radius.
    if radius is None:
        start = position_in_plane(map_, x, y)
        end = position_in_plane(map_, q[0], q[1])
        return tube_is_free(map_, start, (yaw,), end, (q[2],), (0.0, 0.0, 0.0), 0.0)
    steer = motions.steering[move]
    length = motions.lengths[0, move]  # at all headings
    geometry = motions.geometry
    if not piece_is_free(map_, geometry, radius, q, 0.0, 0.0, ARC_ERROR):
        return False
    begin = (0.0, 0.0, yaw)
    origin = (x, y, yaw)
    return segment_is_free(map_, geometry, radius, origin, begin, steer, length, ARC_ERROR)


@internal
def estimate_cost_to_goal(
    map_: Map, target: Target, cost: float, direction: int, x: float, y: float
) -> float:
    """Estimate the cost from a position and direction to the goal, metres.

    ``cost`` is the cost from the start to the position, metres.
    """
    i, j = find_cell(map_, target, x, y)
    straight = math.hypot(x - target.goal[0], y - target.goal[1])
    cells = remaining_cost(target.estimate, cost / map_.spacing, direction, 0, i, j)
    return max(straight, cells * map_.spacing)


@internal
def find_cell(map_: Map, target: Target, x: float, y: float) -> tuple[int, int]:
    """Return the cell of a position."""
    _, nx, ny = target.estimate.shape
    i = min(math.floor((x - map_.lower[1]) / map_.spacing), nx - 1)
    j = min(math.floor((y - map_.lower[2]) / map_.spacing), ny - 1)
    return i, j


class LatticeSearch(BuiltInSearch):
    """Search on a lattice of headings, for drives."""

    name = "Lattice"
    objectives = WEIGHTED

    def takes_space(self, space: Space) -> bool:
        """Return True for maps of x, y and yaw."""
        return has_drives(space)

    def takes_drive(self, edges: LocalPlanner) -> bool:
        """Return True for robots that drive."""
        return edges.has_heading

    def may_fail(self, edges: LocalPlanner) -> bool:
        """Return True."""
        return True

    def find_path(self, task: PlanTask) -> tuple[Floats, str]:
        """Return waypoints, shape (n, 3), and a note."""
        edges = cast(DrivenEdges, task.edges)
        return find_lattice_path(edges, task.endpoints, task.simplify, task.limit, task.may_succeed)


PLANNERS: Final = {LatticeSearch.name: LatticeSearch()}
"""Searches of this module."""

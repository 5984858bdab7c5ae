"""Short paths of arms along proven motions, by a compiled search with two trees.

J. J. Kuffner and S. M. LaValle, "RRT-Connect", 2000; J. D. Gammell and others, "Informed RRT*",
2014; R. Geraerts and M. H. Overmars, "Creating high-quality paths for motion planning", 2007.
If links keep angles, nodes are projected into their cones (D. Berenson and others, "Manipulation
planning on constraint manifolds", 2009).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.inside import (
    Address,
    ArmScene,
    Effort,
    Floats,
    Ints,
    SceneScratch,
    call,
    find_proof,
    internal,
    is_over,
    keep,
    kernel,
    make_scene_scratch,
    move_into_cones,
    now,
    spend,
    stays_in_cones,
)

MAX_STRIDE: Final = 1.0
"""Longest motion by which a tree grows, radians or metres."""


MAX_HALVINGS: Final = 2
"""Largest number of times that a motion which leaves a cone is halved."""

NEAR_PER_SQRT_JOINT: Final = 1.25 * MAX_STRIDE
"""Radius of a blocked node's sampling domain, divided by the square root of the number of joints;
radians or metres.

A node from which a motion was blocked ignores farther samples (A. Yershova and others,
"Dynamic-domain RRTs", 2005). Distances between random configurations grow with that square root.
"""

SAMPLES_PER_BATCH: Final = 128
PULLS_PER_BATCH: Final = 64
"""Samples, and parts of a path that are pulled, between two checks of the time limit."""

NANOSECONDS_PER_SAMPLE: Final = 8_000
NANOSECONDS_PER_PULL: Final = 60_000
"""Work of growing the trees by a sample, and of pulling a part of a path."""

MIN_PULL: Final = 1e-3
"""Length by which a pulled part must be shorter, radians or metres; less would only add waypoints.
"""

MIN_GAIN: Final = 0.01
"""Share of the length that a batch of pulls, or MAX_VAIN_SEARCHES searches together, must gain for
more to follow."""

MAX_VAIN_SEARCHES: Final = 3
"""Searches in a row that together may gain less than :data:`MIN_GAIN` before the search stops."""


class Forest(NamedTuple):
    """Two trees, one rooted at the start and one at the goals.

    Attributes
    ----------
    nodes : ndarray of float64, shape (2, n, dof)
    parents : ndarray of int64, shape (2, n)
        -1 for a root.
    reaches : ndarray of float64, shape (2, n)
        Distance up to which a node grows towards a sample.
    counts : ndarray of int64, shape (2,)
    """

    nodes: Floats
    parents: Ints
    reaches: Floats
    counts: Ints


@internal
def extend(
    prove: Address,
    scene: ArmScene,
    forest: Forest,
    side: int,
    q: Floats,
    reaches: float,
    scratch: SceneScratch,
) -> tuple[int, bool]:
    """Grow tree ``side`` by at most a stride towards a configuration ``q``, shape (dof,).

    Configurations farther than ``reaches`` times the reach of the nearest node are ignored. Returns
    the new node, -1 if there is none, and whether it is the configuration itself.
    """
    nodes = forest.nodes[side]
    new = forest.counts[side]
    nearest, distance = find_nearest(nodes, new, q)
    if distance > reaches * forest.reaches[side, nearest]:
        return -1, False
    # Write the new node before its motion is proven; it counts only afterwards.
    if len(scene.cones.bodies) > 0:
        is_reached = write_kept_node(scene, nodes[nearest], q, distance, nodes[new], scratch)
    else:
        is_reached = write_node(nodes[nearest], q, distance, MAX_STRIDE, nodes[new])
    # Most colliding motions end in a collision.
    end_is_free = call(prove, (scene, nodes[new], nodes[new], scratch))
    if not (end_is_free and call(prove, (scene, nodes[nearest], nodes[new], scratch))):
        forest.reaches[side, nearest] = NEAR_PER_SQRT_JOINT * math.sqrt(len(q))
        return -1, False
    forest.parents[side, new] = nearest
    forest.reaches[side, new] = np.inf
    forest.counts[side] = new + 1
    return new, is_reached


@internal
def write_node(nearest: Floats, q: Floats, distance: float, stride: float, new: Floats) -> bool:
    """Write the node at most a stride from the nearest one towards ``q``, shapes (dof,).

    ``distance`` is that of ``q``. Returns True if the node is ``q`` itself.
    """
    is_reached = distance <= stride
    for d in range(len(q)):
        new[d] = q[d]
        if not is_reached:
            new[d] = nearest[d] + stride / distance * (q[d] - nearest[d])
    return is_reached


@internal
def write_kept_node(
    scene: ArmScene, nearest: Floats, q: Floats, distance: float, new: Floats, scratch: SceneScratch
) -> bool:
    """Write the node that :func:`write_node` would, projected into the cones of the scene.

    Shorter strides follow if the motion to it leaves a cone. If all fail, it is an infinite node,
    which is not free.
    """
    chain = scene.chain
    cones = scene.cones
    poses = scratch.poses
    stride = MAX_STRIDE
    for k in range(len(cones.bodies)):
        # Longest motion by which a tree grows within a cone, divided by the square root of its
        # tolerance. A straight motion of the joints leaves an angle by about an eighth of its
        # squared length.
        stride = min(stride, 2.0 * math.sqrt(cones.tolerances[k]))
    for _ in range(1 + MAX_HALVINGS):
        is_reached = write_node(nearest, q, distance, stride, new)
        # A node of the other tree is reached as it is; a sample is rarely in the cones.
        is_reached = is_reached and stays_in_cones(chain, cones, new, new, poses)
        is_near = is_reached
        if not is_reached and move_into_cones(chain, cones, new, scratch.slopes, poses):
            step = min(stride, distance)
            # Share of a motion by which a projected node must be nearer to its target, so that
            # growth ends.
            is_near = measure_distance(new, q) < distance - 0.1 * step
            is_near = is_near and measure_distance(new, nearest) < 2.0 * step
        if is_near and stays_in_cones(chain, cones, nearest, new, poses):
            return is_reached
        stride *= 0.5
    new[0] = np.inf
    return False


@internal
def measure_distance(q0: Floats, q1: Floats) -> float:
    """Return the distance of two configurations, shapes (dof,)."""
    square = 0.0
    for d in range(len(q0)):
        square += (q0[d] - q1[d]) ** 2
    return math.sqrt(square)


@internal
def find_nearest(nodes: Floats, count: int, q: Floats) -> tuple[int, float]:
    """Find the nearest to ``q`` of the first ``count`` nodes; return its index and distance.

    ``nodes`` has shape (n, dof), ``q`` (dof,).
    """
    least_square = np.inf
    nearest = 0
    for n in range(count):
        square = 0.0
        for d in range(len(q)):
            square += (nodes[n, d] - q[d]) ** 2
        if square < least_square:
            least_square = square
            nearest = n
    return nearest, math.sqrt(least_square)


@kernel
def grow_trees(
    prove: Address, scene: ArmScene, forest: Forest, samples: Floats, scratch: SceneScratch
) -> tuple[int, int]:
    """Grow the smaller tree towards each sample, shape (n, dof), and the other one towards it.

    Returns the nodes of both trees that meet, that of the start first, or -1 if none do. It stops
    if the capacity is nearly used up.
    """
    counts = forest.counts
    capacity = forest.nodes.shape[1]
    for k in range(len(samples)):
        # Both trees may be the same size, so a sample needs room for a node in each.
        if max(counts[0], counts[1]) + 2 >= capacity:
            break
        side = 0 if counts[0] <= counts[1] else 1
        other_side = 1 - side
        new, _ = extend(prove, scene, forest, side, samples[k], 1.0, scratch)
        # Grow the other tree towards the new node until a step fails.
        other = new
        meets = False
        while other >= 0 and not meets and counts[other_side] + 1 < capacity:
            target = forest.nodes[side, new]
            other, meets = extend(prove, scene, forest, other_side, target, math.inf, scratch)
        if meets and side == 0:
            return new, other
        if meets:
            return other, new
    return -1, -1


@kernel
def path_is_free(
    prove: Address, scene: ArmScene, path: Floats, spans: Floats, scratch: SceneScratch
) -> bool:
    """Return True if the motions of a path between free ends are proven free.

    The path has shape (n, dof). No joint may move farther than its span, shape (dof,).
    """
    for k in range(1, len(path)):
        for d in range(path.shape[1]):
            if abs(path[k, d] - path[k - 1, d]) > spans[d]:
                return False
    # Waypoints come first, because most colliding motions end in a collision.
    for k in range(1, len(path) - 1):
        if not call(prove, (scene, path[k], path[k], scratch)):
            return False
    is_free = True
    for k in range(1, len(path)):
        is_free = is_free and call(prove, (scene, path[k - 1], path[k], scratch))
    return is_free


@kernel
def measure_length(path: Floats) -> float:
    """Return the length of a path, shape (n, dof), in the joints."""
    length = 0.0
    for k in range(1, len(path)):
        square = 0.0
        for d in range(path.shape[1]):
            square += (path[k, d] - path[k - 1, d]) ** 2
        length += math.sqrt(square)
    return length


@internal
def copy_distinct(path: Floats, out: Floats) -> int:
    """Copy the rows of a path that differ from the row before; return their number."""
    count = 0
    for k in range(len(path)):
        differs = k == 0
        for d in range(path.shape[1]):
            out[count, d] = path[k, d]
            differs = differs or path[k, d] != path[k - 1, d]
        if differs:
            count += 1
    return count


@internal
def insert_waypoint(path: Floats, count: int, position: float) -> tuple[int, int]:
    """Insert the point of a path at a position, counted in rows, unless it is a waypoint.

    The path is the first ``count`` rows of ``path``. Returns the point's row, and the new count.
    """
    row = int(position)
    share = position - row
    if share == 0.0:
        return row, count
    for d in range(path.shape[1]):
        for k in range(count, row + 1, -1):
            path[k, d] = path[k - 1, d]
        path[row + 1, d] = (1.0 - share) * path[row, d] + share * path[row + 2, d]
    return row + 1, count + 1


@internal
def straighten(path: Floats, joint: int, weight: float) -> None:
    """Move waypoints towards the straight motion between the ends of a path, shape (n, dof).

    A ``weight`` of 1 moves them all the way. If ``joint`` is none, all joints move.
    """
    dof = path.shape[1]
    length = measure_length(path)
    # Each waypoint has its place on the straight motion, at its share of the length.
    along = measure_length(path[:2])
    for k in range(1, len(path) - 1):
        step = measure_length(path[k : k + 2])
        for d in range(dof):
            if d == joint or joint >= dof:
                straight = path[0, d] + along / length * (path[-1, d] - path[0, d])
                path[k, d] += weight * (straight - path[k, d])
        along += step


@kernel
def pull_parts(
    prove: Address,
    scene: ArmScene,
    path: Floats,
    count: int,
    draws: Floats,
    spans: Floats,
    min_gain: float,
    trial: Floats,
    scratch: SceneScratch,
) -> int:
    """Pull random parts of a path towards their straight motions, where these are proven free.

    Each row of ``draws``, shape (n, 5), has random numbers in [0, 1) for one part, which must
    become shorter by ``min_gain``. The path is the first ``count`` rows of ``path``, shape (m,
    dof), which has 2 n more; ``trial`` is scratch of the same shape. Returns the new number of
    rows.
    """
    dof = path.shape[1]
    for k in range(len(draws)):
        # The part's ends, as rows of the path that need not be whole.
        first = min(draws[k, 0], draws[k, 1]) * (count - 1)
        last = max(draws[k, 0], draws[k, 1]) * (count - 1)
        # Share of the parts that end at waypoints; the others end between them.
        if draws[k, 2] < 0.5:
            first = math.floor(first + 0.5)
            last = math.floor(last + 0.5)
        # Half of the pulls move one joint, the others all joints; half go all the way.
        joint = int(2 * dof * draws[k, 3])
        weight = min(2.0 * draws[k, 4], 1.0)
        rows = copy_distinct(path[:count], trial)
        # The last end comes first, so that the other still is where it was.
        end, rows = insert_waypoint(trial, rows, last)
        start, more_rows = insert_waypoint(trial, rows, first)
        end += more_rows - rows
        rows = more_rows
        if end - start < 2:
            continue
        straighten(trial[start : end + 1], joint, weight)
        if len(scene.cones.bodies) > 0:
            for row in range(start + 1, end):
                move_into_cones(scene.chain, scene.cones, trial[row], scratch.slopes, scratch.poses)
        elif joint >= dof and weight == 1.0:
            # A straight motion needs no waypoints.
            for d in range(dof):
                for row in range(end, rows):
                    trial[start + 1 + row - end, d] = trial[row, d]
            rows -= end - start - 1
        # The motions from the row before the part to the row after it are new.
        before = path[math.floor(first) : math.ceil(last) + 1]
        pulled = trial[math.floor(first) : rows - (count - 1 - math.ceil(last))]
        gain = measure_length(before) - measure_length(pulled)
        if gain >= min_gain and path_is_free(prove, scene, pulled, spans, scratch):
            count = copy_distinct(trial[:rows], path)
    return count


class PathSearch:
    """A search for proven paths to one of several goals.

    Parameters
    ----------
    scene : Scene
    bounds : pair of ndarray of float64, shape (dof,)
        Lowest and highest values of the joints.
    start : ndarray of float64, shape (dof,)
        It must be free, and so must the goals.
    goals : ndarray of float64, shape (n, dof)
    spans : ndarray of float64, shape (dof,)
        Largest motion of each joint between rows of a path.
    rng : numpy.random.Generator
    limit : Effort
        At which the search ends.
    """

    def __init__(
        self,
        scene: ArmScene,
        bounds: tuple[Floats, Floats],
        start: Floats,
        goals: Floats,
        spans: Floats,
        rng: np.random.Generator,
        limit: Effort,
    ) -> None:
        """Sort the goals, the nearest to the start first, and begin to count."""
        self._scene = keep(scene)
        self._prove = find_proof(scene)
        self._scratch = make_scene_scratch(scene)
        self._end = now() + limit
        self._bounds = bounds
        self._start = start
        self._spans = spans
        self._rng = rng
        distances = np.linalg.norm(goals - start, axis=1)
        nearest_first = np.argsort(distances)
        self._goals = goals[nearest_first]
        self._distances = distances[nearest_first]
        # Batches of samples that each search used.
        self._batches: list[int] = []

    def find(self, straight: bool) -> Floats:
        """Find a path, shape (n, dof); empty if time ends.

        The first samples are the endpoints themselves. If ``straight``, it skips waypoints that
        straight motions do not need.
        """
        samples = np.vstack([self._goals, self._start])
        no_limit = math.inf
        return self._connect(self._goals, samples, no_limit, no_limit, straight)

    def shorten(self, path: Floats, searches: int | None) -> Floats:
        """Shorten a path by further searches, and by pulling its parts straight.

        It stops after ``searches``, or at the time limit; if the path is within :data:`MIN_GAIN` of
        the straight motion to the nearest goal; or, without a number of ``searches``, if the last
        :data:`MAX_VAIN_SEARCHES` gained less than that.
        """
        # Share of the length by which a pulled part must be shorter while further searches follow.
        min_pull_share = 1e-3
        path = self._pull(path, min_pull_share)
        # Length before and after each search.
        lengths = [measure_length(path)]
        while searches is None or len(lengths) <= searches:
            length = lengths[-1]
            near_goals = self._goals[self._distances < (1.0 - MIN_GAIN) * length]
            is_vain = False
            if searches is None and len(lengths) > MAX_VAIN_SEARCHES:
                is_vain = (1.0 - MIN_GAIN) * lengths[-1 - MAX_VAIN_SEARCHES] < length
            if not len(near_goals) or is_vain or is_over(self._end):
                break
            # A search that takes longer than the others is given up, because it rarely leads to a
            # shorter path.
            # Batches of samples that a further search may take beyond half the mean of the searches
            # before it.
            max_batches = 1 + 0.5 * sum(self._batches) / len(self._batches)
            other_path = self._connect(
                near_goals, _make_empty(near_goals), length, max_batches, straight=True
            )
            if len(other_path):
                other_path = self._pull(other_path, min_pull_share)
                path = min(path, other_path, key=measure_length)
            path = self._pull(path, min_pull_share)
            lengths.append(measure_length(path))
        return self._pull(path, 0.0)

    def _connect(
        self,
        goals: Floats,
        samples: Floats,
        length: float,
        max_batches: float,
        straight: bool,
    ) -> Floats:
        """Grow two trees until they meet; return the path, shape (n, dof), empty if they do not.

        Samples are ``samples`` first, shape (m, dof), then random ones on paths below ``length``.
        It gives up after ``max_batches`` of these, or when time ends. If ``straight``, the path
        skips waypoints that straight motions do not need.
        """
        forest = _plant_trees(self._start, goals)
        meeting = -1
        batches = 0
        while meeting < 0 and batches < max_batches and not is_over(self._end):
            samples = np.concatenate([samples, self._sample(goals, length)])
            meeting, meeting_at_goal = grow_trees(
                self._prove, self._scene, forest, samples, self._scratch
            )
            spend(NANOSECONDS_PER_SAMPLE * len(samples))
            samples = _make_empty(samples)
            batches += 1
            # This is why grow_trees may have stopped early.
            if forest.counts.max() + 2 >= forest.nodes.shape[1]:
                forest = _double_capacity(forest)
        self._batches.append(batches)
        if meeting < 0:
            return _make_empty(goals)
        from_start = reversed(_trace_branch(forest, 0, meeting))
        # Both trees have the configuration at which they meet.
        to_goal = _trace_branch(forest, 1, meeting_at_goal)[1:]
        path = np.array([*from_start, *to_goal])
        return self._skip_waypoints(path) if straight else path

    def _skip_waypoints(self, path: Floats) -> Floats:
        """Skip waypoints that straight motions do not need."""
        last = len(path) - 1
        kept = [0]
        while kept[-1] < last:
            here = kept[-1]
            # Strides double while motions are free; then the farthest one is found by bisection.
            near = here + 1
            far = last + 1
            stride = 2
            while far - near > 1:
                trial = min(here + stride, last) if far > last else (near + far) // 2
                stride *= 2
                rows = path[[here, trial]]
                if path_is_free(self._prove, self._scene, rows, self._spans, self._scratch):
                    near = trial
                else:
                    far = trial
            kept.append(near)
        return path[kept]

    def _sample(self, goals: Floats, length: float) -> Floats:
        """Sample configurations on possible paths of at most ``length``.

        They are uniform in the ellipsoid with foci at start and goal, and clipped to the bounds.
        """
        rng = self._rng
        shape = SAMPLES_PER_BATCH, len(self._start)
        if math.isinf(length):
            return rng.uniform(*self._bounds, shape)
        # Each sample belongs to the ellipsoid of a random goal.
        foci = goals[rng.integers(len(goals), size=SAMPLES_PER_BATCH)]
        axes = foci - self._start
        distances = np.linalg.norm(axes, axis=1, keepdims=True)
        axes /= distances
        # Normal samples have uniform directions; this power of a uniform radius fills the ball.
        directions = rng.normal(size=shape)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        in_ball = directions * rng.random((SAMPLES_PER_BATCH, 1)) ** (1.0 / shape[1])
        # Stretch the unit ball to the ellipsoid: by `minor` across the axis, by `length` along it.
        minor = np.sqrt(length**2 - distances**2)
        along = (in_ball * axes).sum(axis=1, keepdims=True)
        stretched = minor * in_ball + (length - minor) * along * axes
        samples: Floats = 0.5 * (self._start + foci + stretched)
        return samples.clip(*self._bounds)

    def _pull(self, path: Floats, min_share: float) -> Floats:
        """Pull parts of a path straight while it gains :data:`MIN_GAIN`.

        Each part gains at least ``min_share`` of the length, and :data:`MIN_PULL`.
        """
        length = measure_length(path)
        last = math.inf
        while len(path) > 2 and length < (1.0 - MIN_GAIN) * last and not is_over(self._end):
            draws = self._rng.random((PULLS_PER_BATCH, 5))
            # Each part may begin and end between waypoints, which adds two.
            rows = np.concatenate([path, np.empty((2 * PULLS_PER_BATCH, path.shape[1]))])
            trial = np.empty_like(rows)
            min_gain = max(MIN_PULL, min_share * length)
            count = pull_parts(
                self._prove,
                self._scene,
                rows,
                len(path),
                draws,
                self._spans,
                min_gain,
                trial,
                self._scratch,
            )
            spend(NANOSECONDS_PER_PULL * len(draws))
            path = rows[:count]
            if len(self._scene.cones.bodies):
                path = self._skip_waypoints(path)  # projected parts keep theirs
            last = length
            length = measure_length(path)
        return path


def _make_empty(path: Floats) -> Floats:
    """Return a path without rows, for the same number of joints."""
    return path[:0]


def _trace_branch(forest: Forest, side: int, node: int) -> list[Floats]:
    """Return the configurations, shape (dof,) each, from a node of tree ``side`` to its root."""
    rows = []
    while node >= 0:
        rows.append(forest.nodes[side, node])
        node = int(forest.parents[side, node])
    return rows


def _plant_trees(start: Floats, goals: Floats) -> Forest:
    """Return a tree that has only the start, and one that has only the goals, shape (n, dof)."""
    # Initial capacity of a tree.
    capacity = 1000 + len(goals)
    counts = np.array([1, len(goals)])
    nodes = np.empty((2, capacity, len(start)))
    parents = np.full((2, capacity), -1)
    nodes[0, 0] = start
    nodes[1, : len(goals)] = goals
    return Forest(nodes, parents, np.full((2, capacity), np.inf), counts)


def _double_capacity(forest: Forest) -> Forest:
    """Return the same trees with twice the capacity."""
    return Forest(
        nodes=np.concatenate([forest.nodes] * 2, axis=1),
        parents=np.concatenate([forest.parents] * 2, axis=1),
        reaches=np.concatenate([forest.reaches] * 2, axis=1),
        counts=forest.counts,
    )

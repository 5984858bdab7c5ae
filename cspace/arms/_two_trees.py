"""Short paths of arms along proven motions, by a compiled search with two trees.

J. J. Kuffner and S. M. LaValle, "RRT-Connect", 2000; J. D. Gammell and others, "Informed RRT*",
2014; R. Geraerts and M. H. Overmars, "Creating high-quality paths for motion planning", 2007.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace._support.arrays import Floats, Ints
from cspace._support.compiling import clock, internal, kernel
from cspace._support.deadlines import is_over
from cspace.arms._motion_proofs import ArmScene, SceneScratch, make_scene_scratch, motion_is_free

MAX_STRIDE: Final = 1.0
"""Longest motion by which a tree grows, radians or metres."""


NEAR_PER_SQRT_JOINT: Final = 1.25 * MAX_STRIDE
"""Radius of a blocked node's sampling domain, divided by the square root of the number of joints;
radians or metres.

A node from which a motion was blocked ignores farther samples (A. Yershova and others,
"Dynamic-domain RRTs", 2005). Distances between random configurations grow with that square root.
"""

SAMPLES_PER_BATCH: Final = 48
"""Samples between two checks of the clock."""


INITIAL_NODES: Final = 1000
"""Initial capacity of a tree."""

PULLS_PER_BATCH: Final = 64
"""Parts of a path that are pulled between two checks of the clock."""

WAYPOINT_SHARE: Final = 0.5
"""Share of the parts that end at waypoints; the others end between them."""

MIN_PULL: Final = 1e-3
"""Length by which a pulled part must be shorter, radians or metres; less would only add waypoints.
"""

MIN_GAIN: Final = 0.01
"""Share of the length that a batch of pulls, or MAX_VAIN_SEARCHES searches together, must gain for
more to follow."""

BATCHES_PER_SEARCH: Final = 4
"""Batches of attempts that a further search may take beyond the mean of the searches before it."""

MAX_VAIN_SEARCHES: Final = 10
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
    scene: ArmScene, forest: Forest, side: int, q: Floats, reaches: float, scratch: SceneScratch
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
    is_reached = distance <= MAX_STRIDE
    for d in range(len(q)):
        nodes[new, d] = q[d]
        if not is_reached:
            start = nodes[nearest, d]
            nodes[new, d] = start + MAX_STRIDE / distance * (q[d] - start)
    if not motion_is_free(scene, nodes[nearest], nodes[new], scratch):
        forest.reaches[side, nearest] = NEAR_PER_SQRT_JOINT * math.sqrt(len(q))
        return -1, False
    forest.parents[side, new] = nearest
    forest.reaches[side, new] = np.inf
    forest.counts[side] = new + 1
    return new, is_reached


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
    scene: ArmScene, forest: Forest, samples: Floats, scratch: SceneScratch
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
        new, _ = extend(scene, forest, side, samples[k], 1.0, scratch)
        # Grow the other tree towards the new node as far as possible.
        other = new
        meets = False
        while other >= 0 and not meets and counts[other_side] + 1 < capacity:
            target = forest.nodes[side, new]
            other, meets = extend(scene, forest, other_side, target, math.inf, scratch)
        if meets and side == 0:
            return new, other
        if meets:
            return other, new
    return -1, -1


@kernel
def path_is_free(scene: ArmScene, path: Floats, scratch: SceneScratch) -> bool:
    """Return True if the motions of a path, shape (n, dof), between free ends are proven free."""
    # Waypoints come first, because most colliding motions end in a collision.
    for k in range(1, len(path) - 1):
        if not motion_is_free(scene, path[k], path[k], scratch):
            return False
    is_free = True
    for k in range(len(path) - 1):
        is_free = is_free and motion_is_free(scene, path[k], path[k + 1], scratch)
    return is_free


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
    seconds : float
        Time after which the search ends.
    """

    def __init__(
        self,
        scene: ArmScene,
        bounds: tuple[Floats, Floats],
        start: Floats,
        goals: Floats,
        spans: Floats,
        rng: np.random.Generator,
        seconds: float,
    ) -> None:
        """Sort the goals, the nearest to the start first, and start the clock."""
        self._scene = scene
        self._scratch = make_scene_scratch(scene)
        self._end = clock() + seconds
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
        the straight motion to the nearest goal; or if the last :data:`MAX_VAIN_SEARCHES` searches
        gained less than that.
        """
        path = self._pull(path)
        # Length before and after each search.
        lengths = [_measure_length(path)]
        while searches is None or len(lengths) <= searches:
            length = lengths[-1]
            near_goals = self._goals[self._distances < (1.0 - MIN_GAIN) * length]
            is_vain = False
            if len(lengths) > MAX_VAIN_SEARCHES:
                is_vain = (1.0 - MIN_GAIN) * lengths[-1 - MAX_VAIN_SEARCHES] < length
            if not len(near_goals) or is_vain or is_over(self._end):
                break
            # A search that takes much longer than the others is given up, because it rarely leads
            # to a shorter path.
            max_batches = BATCHES_PER_SEARCH + sum(self._batches) / len(self._batches)
            other_path = self._connect(
                near_goals, _make_empty(near_goals), length, max_batches, straight=True
            )
            if len(other_path):
                path = min(path, self._pull(other_path), key=_measure_length)
            path = self._pull(path)
            lengths.append(_measure_length(path))
        return path

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
            meeting, meeting_at_goal = grow_trees(self._scene, forest, samples, self._scratch)
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
        """Return a path without the waypoints that straight motions do not need."""
        rows = [0]
        here = 0
        last = len(path) - 1
        while here < last:
            # Try the farthest waypoint first, then half as far; the next one is always reached.
            ahead = last
            while ahead > here + 1 and not self._is_free(path[[here, ahead]]):
                ahead = here + (ahead - here) // 2
            here = ahead
            rows.append(here)
        return path[rows]

    def _is_free(self, path: Floats) -> bool:
        """Return True if all motions from a configuration are within spans and proven free."""
        if (np.abs(np.diff(path, axis=0)) > self._spans).any():
            return False
        return path_is_free(self._scene, path, self._scratch)

    def _sample(self, goals: Floats, length: float) -> Floats:
        """Sample configurations on possible paths of at most ``length``.

        They are uniform in the ellipsoid with foci at start and goal. Samples outside the bounds
        are replaced by uniform ones within.
        """
        rng = self._rng
        dof = len(self._start)
        uniform = rng.uniform(*self._bounds, (SAMPLES_PER_BATCH, dof))
        if math.isinf(length):
            return uniform
        # Each sample belongs to the ellipsoid of a random goal.
        foci = goals[rng.integers(len(goals), size=SAMPLES_PER_BATCH)]
        axes = foci - self._start
        distances = np.linalg.norm(axes, axis=1, keepdims=True)
        axes /= distances
        # Normal samples have uniform directions; this power of a uniform radius fills the ball.
        directions = rng.normal(size=uniform.shape)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        in_ball = directions * rng.random((SAMPLES_PER_BATCH, 1)) ** (1.0 / dof)
        # Stretch the unit ball to the ellipsoid: by `minor` across the axis, by `length` along it.
        minor = np.sqrt(length**2 - distances**2)
        along = (in_ball * axes).sum(axis=1, keepdims=True)
        stretched = minor * in_ball + (length - minor) * along * axes
        samples = 0.5 * (self._start + foci + stretched)
        lowest, highest = self._bounds
        inside = ((samples >= lowest) & (samples <= highest)).all(axis=1, keepdims=True)
        return np.where(inside, samples, uniform)

    def _pull(self, path: Floats) -> Floats:
        """Pull parts of a path straight while it gains :data:`MIN_GAIN`."""
        length = _measure_length(path)
        last = math.inf
        while len(path) > 2 and length < (1.0 - MIN_GAIN) * last and not is_over(self._end):
            for _ in range(PULLS_PER_BATCH):
                path = self._pull_part(path)
            last = length
            length = _measure_length(path)
        return path

    def _pull_part(self, path: Floats) -> Floats:
        """Pull a random part of a path towards its straight motion.

        All joints of the part move, or a single one. The result is shorter and proven free, or the
        given path.
        """
        # Draw the part's ends, as rows of the path that need not be whole.
        first, last = np.sort(self._rng.uniform(0, len(path) - 1, 2))
        if self._rng.random() < WAYPOINT_SHARE:
            first, last = np.rint((first, last))
        start = math.floor(first)
        stop = math.ceil(last)
        rows = np.concatenate(
            [_interpolate(path, first), path[start + 1 : stop], _interpolate(path, last)]
        )
        if len(rows) < 3:
            return path
        # Each row has its place on the straight motion, at its share of the part's length.
        step_lengths = np.linalg.norm(np.diff(rows, axis=0), axis=1)
        along = np.append(0.0, np.cumsum(step_lengths))
        shares = along / max(along[-1], MIN_PULL)
        straight = rows[0] + shares[:, np.newaxis] * (rows[-1] - rows[0])
        towards_straight = straight - rows
        # Half of the pulls move one joint, half of them all; half of them go all the way.
        dof = path.shape[1]
        joint = self._rng.integers(2 * dof)
        weight = min(2.0 * self._rng.random(), 1.0)
        if joint < dof:
            rows[1:-1, joint] += weight * towards_straight[1:-1, joint]
        elif weight < 1.0:
            rows[1:-1] += weight * towards_straight[1:-1]
        else:
            rows = rows[[0, -1]]
        pulled = _drop_repeated(np.vstack([path[start], rows, path[stop]]))
        gain = _measure_length(path[start : stop + 1]) - _measure_length(pulled)
        if gain < MIN_PULL or not self._is_free(pulled):
            return path
        return np.concatenate([path[:start], pulled, path[stop + 1 :]])


def _make_empty(path: Floats) -> Floats:
    """Return a path without rows, for the same number of joints."""
    return path[:0]


def _interpolate(path: Floats, position: float) -> Floats:
    """Interpolate a path between its rows: position 1.5 is halfway from row 1 to row 2.

    Returns the configuration, shape (1, dof).
    """
    row = min(int(position), len(path) - 2)
    share = position - row
    before, after = path[row : row + 2]
    return np.asarray((1.0 - share) * before + share * after)[np.newaxis]


def _drop_repeated(path: Floats) -> Floats:
    """Return a path without rows that are equal to the row before."""
    differs = np.append(True, (path[1:] != path[:-1]).any(axis=1))
    return np.asarray(path[differs])


def _trace_branch(forest: Forest, side: int, node: int) -> list[Floats]:
    """Return the configurations, shape (dof,) each, from a node of tree ``side`` to its root."""
    rows = []
    while node >= 0:
        rows.append(forest.nodes[side, node])
        node = int(forest.parents[side, node])
    return rows


def _measure_length(path: Floats) -> float:
    """Return the length of a path, shape (n, dof), in the joints."""
    steps = np.diff(path, axis=0)
    return float(np.linalg.norm(steps, axis=1).sum())


def _plant_trees(start: Floats, goals: Floats) -> Forest:
    """Return a tree that has only the start, and one that has only the goals, shape (n, dof)."""
    capacity = INITIAL_NODES + len(goals)
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

"""Short paths of arms along proven motions, by a compiled search with two trees.

J. J. Kuffner and S. M. LaValle, "RRT-Connect", 2000; J. D. Gammell and others, "Informed RRT*", 2014; R. Geraerts and
M. H. Overmars, "Creating high-quality paths for motion planning", 2007.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.proofs import Scene, SceneScratch, make_scene_scratch, motion_is_free, point_is_free
from cspace.arrays import Floats, Ints
from cspace.compiling import clock, kernel

MAX_STRIDE: Final = 1.0
"""Longest motion by which a tree grows, radians or metres."""


NEAR_PER_SQRT_JOINT: Final = 1.25 * MAX_STRIDE
"""Radius of a blocked node's sampling domain, divided by the square root of the number of joints; radians or metres.

A node from which a motion was blocked ignores farther samples (A. Yershova and others, "Dynamic-domain RRTs", 2005).
Distances between random configurations grow with that square root.
"""

TRIES_PER_CLOCK_CHECK: Final = 32
"""Growth attempts between two checks of the clock."""


SAMPLES_PER_BATCH: Final = 256
"""Samples drawn at once; most are too far away to help in a narrow passage."""


INITIAL_NODES: Final = 1000
"""Initial capacity of a tree."""

PULLS_PER_BATCH: Final = 64
"""Parts of a path that are pulled between two checks of the clock."""

WAYPOINT_SHARE: Final = 0.5
"""Share of the parts that end at waypoints; the others end between them."""

MIN_PULL: Final = 1e-3
"""Length by which a pulled part must be shorter, radians or metres; less would only add waypoints."""

MIN_GAIN: Final = 0.01
"""Share of the length that a batch of pulls, or MAX_VAIN_SEARCHES searches together, must gain for more to follow."""

BATCHES_PER_SEARCH: Final = 4
"""Batches of attempts that a further search may take beyond the mean of the searches before it."""

BATCHES_BEFORE_MORE_GOALS: Final = 128
"""Batches of attempts after which further goals join a search; few searches take so many."""

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


@kernel
def nearest_node(forest: Forest, side: int, q: Floats) -> tuple[int, float]:
    """Return the nearest node of a tree, and its distance."""
    nodes, best, at = forest.nodes[side], np.inf, -1
    for n in range(forest.counts[side]):
        square = 0.0
        for d in range(len(q)):
            square += (nodes[n, d] - q[d]) ** 2
        if square < best:
            best, at = square, n
    return at, math.sqrt(best)


@kernel
def extend_tree(forest: Forest, scene: Scene, side: int, near: int, q: Floats, scratch: SceneScratch) -> int:
    """Grow a tree from a node by at most a stride.

    Returns the new node, or -1.
    """
    new, nodes, square = forest.counts[side], forest.nodes[side], 0.0
    for d in range(len(q)):
        square += (nodes[near, d] - q[d]) ** 2
    share = MAX_STRIDE / math.sqrt(square) if square > MAX_STRIDE**2 else 1.0
    for d in range(len(q)):
        nodes[new, d] = nodes[near, d] + share * (q[d] - nodes[near, d]) if share < 1.0 else q[d]
    if not (point_is_free(scene, nodes[new], scratch) and motion_is_free(scene, nodes[near], nodes[new], scratch)):
        forest.reaches[side, near] = NEAR_PER_SQRT_JOINT * math.sqrt(len(q))
        return -1
    forest.parents[side, new], forest.reaches[side, new] = near, np.inf
    forest.counts[side] = new + 1
    return int(new)


@kernel
def is_within(q0: Floats, q1: Floats, spans: Floats) -> bool:
    """Return True if no joint moves beyond its span."""
    within = True
    for d in range(len(q0)):
        within &= abs(q1[d] - q0[d]) <= spans[d]
    return within


@kernel
def connect_path(
    scene: Scene,
    forest: Forest,
    first: int,
    second: int,
    scratch: SceneScratch,
    straight: bool,
    spans: Floats,
    path: Floats,
) -> int:
    """Write the path through the two nodes where the trees meet.

    Returns its number of rows. If ``straight``, skip nodes that straight motions within the spans of the joints do not
    need.
    """
    stop = 0
    for side in range(2):
        at = second if side else first
        while at >= 0:
            for d in range(path.shape[1]):
                path[stop, d] = forest.nodes[side, at, d]
            at, stop = forest.parents[side, at], stop + 1
        if side == 0:
            # Reverse the first half so that it starts at the root, and drop the shared node.
            for k in range(stop // 2):
                for d in range(path.shape[1]):
                    path[k, d], path[stop - 1 - k, d] = path[stop - 1 - k, d], path[k, d]
            stop -= 1
    here, rows = 0, 1
    while here < stop - 1:
        ahead = stop - 1 if straight else here + 1
        while ahead > here + 1 and not (
            is_within(path[rows - 1], path[ahead], spans)
            and motion_is_free(scene, path[rows - 1], path[ahead], scratch)
        ):
            ahead = here + (ahead - here) // 2
        for d in range(path.shape[1]):
            path[rows, d] = path[ahead, d]
        here, rows = ahead, rows + 1
    return rows


@kernel
def grow_trees(
    scene: Scene, forest: Forest, samples: Floats, scratch: SceneScratch, straight: bool, spans: Floats, path: Floats
) -> tuple[int, int]:
    """Grow the smaller tree towards each sample, shape (n, dof).

    Returns the number of samples used, and the length of the path, 0 if the trees have not met. It stops after
    TRIES_PER_CLOCK_CHECK attempts, or if the capacity is nearly used up.
    """
    capacity, tries = forest.nodes.shape[1], 0
    for k in range(len(samples)):
        side = 0 if forest.counts[0] <= forest.counts[1] else 1
        if tries == TRIES_PER_CLOCK_CHECK or max(forest.counts[0], forest.counts[1]) + 2 >= capacity:
            return k, 0
        near, far = nearest_node(forest, side, samples[k])
        if far > forest.reaches[side, near]:
            continue
        tries += 1
        new = extend_tree(forest, scene, side, near, samples[k], scratch)
        if new < 0:
            continue
        # Grow the other tree towards the new node as far as possible.
        target, other = forest.nodes[side, new], 1 - side
        at, far = nearest_node(forest, other, target)
        while at >= 0 and far > 0.0 and forest.counts[other] + 1 < capacity:
            at, far = extend_tree(forest, scene, other, at, target, scratch), far - MAX_STRIDE
        if at >= 0 and far <= 0.0:
            first, second = (new, at) if side == 0 else (at, new)
            return k + 1, connect_path(scene, forest, first, second, scratch, straight, spans, path)
    return len(samples), 0


@kernel
def joint_distance(q0: Floats, q1: Floats) -> float:
    """Return the length of a motion in the joints."""
    square = 0.0
    for d in range(len(q0)):
        square += (q1[d] - q0[d]) ** 2
    return math.sqrt(square)


@kernel
def path_length(path: Floats, rows: int) -> float:
    """Return the length of the first rows of a path."""
    length = 0.0
    for k in range(rows - 1):
        length += joint_distance(path[k], path[k + 1])
    return length


@kernel
def copy_point(path: Floats, position: float, out: Floats) -> None:
    """Write the configuration at a position, counted in rows."""
    k, share = int(position), position - int(position)
    for d in range(len(out)):
        # The row after the last one may be uninitialised.
        out[d] = (1.0 - share) * path[k, d] + share * path[k + 1, d] if share > 0.0 else path[k, d]


@kernel
def copy_part(path: Floats, first: float, last: float, part: Floats) -> int:
    """Write the part of a path between two positions.

    The waypoints before and after frame it. Returns its number of rows.
    """
    count = 0
    copy_point(path, math.floor(first), part[0])
    copy_point(path, first, part[1])
    for k in range(math.floor(first) + 1, math.ceil(last)):
        copy_point(path, k, part[2 + count])
        count += 1
    copy_point(path, last, part[2 + count])
    copy_point(path, math.ceil(last), part[3 + count])
    return 4 + count


@kernel
def pull_part(part: Floats, count: int, joint: int, weight: float) -> int:
    """Pull the inner waypoints of a framed part towards its straight motion.

    ``weight`` is at most 1. Only one joint moves, or all if ``joint`` is -1. Returns the number of rows.
    """
    low, high = 1, count - 2
    if joint < 0 and weight == 1.0:
        copy_point(part, high, part[2])
        copy_point(part, high + 1, part[3])
        return 4
    whole = path_length(part, high + 1) - joint_distance(part[0], part[low])
    along = joint_distance(part[low], part[low + 1])
    for k in range(low + 1, high):
        step = joint_distance(part[k], part[k + 1])
        for d in range(part.shape[1]):
            if joint < 0 or d == joint:
                straight = part[low, d] + along / whole * (part[high, d] - part[low, d])
                part[k, d] += weight * (straight - part[k, d])
        along += step
    return count


@kernel
def part_is_free(scene: Scene, part: Floats, count: int, spans: Floats, scratch: SceneScratch) -> bool:
    """Return True if a part between proven waypoints is proven free."""
    for k in range(1, count - 1):
        if not point_is_free(scene, part[k], scratch):
            return False
    for k in range(count - 1):
        if not is_within(part[k], part[k + 1], spans) or not motion_is_free(scene, part[k], part[k + 1], scratch):
            return False
    return True


@kernel
def replace_part(path: Floats, rows: int, first: float, last: float, part: Floats, count: int) -> int:
    """Replace a framed part of a path, without repeated waypoints.

    Returns the number of rows of the path.
    """
    start, kept = int(first), 1
    for k in range(1, count):
        if joint_distance(part[kept - 1], part[k]) > 0.0:
            copy_point(part, k, part[kept])
            kept += 1
    for k in range(math.ceil(last) + 1, rows):
        copy_point(path, k, part[kept])
        kept += 1
    for k in range(kept):
        copy_point(part, k, path[start + k])
    return start + kept


@kernel
def pull_path(
    scene: Scene, path: Floats, rows: int, draws: Floats, spans: Floats, part: Floats, scratch: SceneScratch
) -> int:
    """Pull random parts of a path straight where proven free.

    Each row of ``draws``, shape (n, 5) in [0, 1), chooses one part: its ends, whether they are waypoints, the joint and
    the weight. ``part`` is scratch, of the shape of ``path``. Returns the number of rows.
    """
    size = path.shape[1]
    for k in range(len(draws)):
        if rows < 3 or rows + 3 > len(path):
            break
        first, last = draws[k, 0] * (rows - 1), draws[k, 1] * (rows - 1)
        if draws[k, 2] < WAYPOINT_SHARE:
            first, last = float(round(first)), float(round(last))
        first, last = min(first, last), max(first, last)
        count = copy_part(path, first, last, part)
        if count < 5:
            continue
        joint, before = int(2.0 * size * draws[k, 3]), path_length(part, count)
        count = pull_part(part, count, joint if joint < size else -1, min(2.0 * draws[k, 4], 1.0))
        if path_length(part, count) < before - MIN_PULL and part_is_free(scene, part, count, spans, scratch):
            rows = replace_part(path, rows, first, last, part, count)
    return rows


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
        scene: Scene,
        bounds: tuple[Floats, Floats],
        start: Floats,
        goals: Floats,
        spans: Floats,
        rng: np.random.Generator,
        seconds: float,
    ) -> None:
        self._scene, self._scratch, self._end = scene, make_scene_scratch(scene), clock() + seconds
        self._bounds, self._start, self._spans, self._rng = bounds, start, spans, rng
        self._set_goals(goals)
        self._batches: list[int] = []  # of attempts, used by each search

    def _set_goals(self, goals: Floats) -> None:
        """Set the goals, the nearest first."""
        distances = np.linalg.norm(goals - self._start, axis=1)
        order = np.argsort(distances)
        self._goals, self._distances = goals[order], distances[order]

    def find(self, straight: bool, find_more: Callable[[], Floats] | None = None) -> Floats:
        """Find a path, shape (n, dof); empty if time ends.

        The first samples are the endpoints themselves. If ``straight``, it skips waypoints that straight motions do not
        need. After :data:`BATCHES_BEFORE_MORE_GOALS`, or half the time, ``find_more`` gives further
        free goals, and the search begins again.
        """
        path = self._goals[:0]
        if find_more is not None:
            half_time = 0.5 * (clock() + self._end)
            path = self._connect_ends(BATCHES_BEFORE_MORE_GOALS, half_time, straight)
            if not len(path):
                self._set_goals(np.vstack([self._goals, find_more()]))
        return path if len(path) else self._connect_ends(math.inf, self._end, straight)

    def _connect_ends(self, max_batches: float, end: float, straight: bool) -> Floats:
        """Grow two trees until they meet, with the endpoints as first samples."""
        samples = np.vstack([self._goals, self._start])
        return self._connect(self._goals, samples, math.inf, max_batches, end, straight)

    def shorten(self, path: Floats, searches: int | None) -> Floats:
        """Shorten a path by further searches, and by pulling its parts straight.

        It stops after ``searches``, or at the time limit; if the path is within :data:`MIN_GAIN` of the straight motion
        to the nearest goal; or if the last :data:`MAX_VAIN_SEARCHES` searches gained less than that.
        """
        path = self._pull(path)
        lengths = [_length(path)]
        while searches is None or len(lengths) <= searches:
            goals = self._goals[self._distances < (1.0 - MIN_GAIN) * lengths[-1]]
            before = lengths[-1 - MAX_VAIN_SEARCHES] if len(lengths) > MAX_VAIN_SEARCHES else math.inf
            is_vain = (1.0 - MIN_GAIN) * before < lengths[-1]
            if not len(goals) or is_vain or clock() >= self._end:
                break
            # A search that takes much longer than the others is given up, because it rarely leads to a shorter path.
            batches = BATCHES_PER_SEARCH + sum(self._batches) / len(self._batches)
            other = self._connect(goals, goals[:0], lengths[-1], batches, self._end, True)
            if len(other):
                path = min(path, self._pull(other), key=_length)
            path = self._pull(path)
            lengths.append(_length(path))
        return path

    def _connect(
        self,
        goals: Floats,
        samples: Floats,
        length: float,
        max_batches: float,
        end: float,
        straight: bool,
    ) -> Floats:
        """Grow two trees until they meet on a path below ``length``, or until ``end``."""
        forest, rows, batches = _plant_trees(self._start, goals), 0, 0
        path = np.empty(forest.nodes[0].shape)
        while not rows and batches < max_batches and clock() < end:
            if len(samples) < TRIES_PER_CLOCK_CHECK:
                samples = np.concatenate([samples, self._sample(goals, length)])
            used, rows = grow_trees(self._scene, forest, samples, self._scratch, straight, self._spans, path)
            samples, batches = samples[used:], batches + 1
            if forest.counts.max() + 2 >= forest.nodes.shape[1]:
                forest = _double_capacity(forest)
                path = np.empty(forest.nodes[0].shape)
        self._batches.append(batches)
        return path[:rows]

    def _sample(self, goals: Floats, length: float) -> Floats:
        """Sample configurations on possible paths of at most ``length``.

        They are uniform in the ellipsoid with foci at start and goal. Samples outside the bounds are replaced by
        uniform ones within.
        """
        rng, size = self._rng, len(self._start)
        uniform = rng.uniform(*self._bounds, (SAMPLES_PER_BATCH, size))
        if math.isinf(length):
            return uniform
        ends = goals[rng.integers(len(goals), size=SAMPLES_PER_BATCH)]
        axes = ends - self._start
        distances = np.linalg.norm(axes, axis=1, keepdims=True)
        axes /= distances
        balls = rng.normal(size=uniform.shape)
        balls *= rng.random((len(balls), 1)) ** (1.0 / size) / np.linalg.norm(balls, axis=1, keepdims=True)
        minor = np.sqrt(length**2 - distances**2)
        along = (balls * axes).sum(axis=1, keepdims=True)
        samples = 0.5 * (self._start + ends + minor * balls + (length - minor) * along * axes)
        inside = ((samples >= self._bounds[0]) & (samples <= self._bounds[1])).all(axis=1, keepdims=True)
        return np.where(inside, samples, uniform)

    def _pull(self, path: Floats) -> Floats:
        """Pull parts of a path straight while it gains :data:`MIN_GAIN`."""
        rows = len(path)
        pulled = np.concatenate([path, np.empty((rows + 2 * PULLS_PER_BATCH, path.shape[1]))])
        part, length, last = np.empty_like(pulled), _length(path), math.inf
        while rows > 2 and length < (1.0 - MIN_GAIN) * last and clock() < self._end:
            draws, last = self._rng.random((PULLS_PER_BATCH, 5)), length
            rows = pull_path(self._scene, pulled, rows, draws, self._spans, part, self._scratch)
            length = _length(pulled[:rows])
        return pulled[:rows].copy()


def _length(path: Floats) -> float:
    """Return the length of a path in the joints."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _plant_trees(start: Floats, goals: Floats) -> Forest:
    """Return trees that consist of their roots."""
    capacity, counts = INITIAL_NODES + len(goals), np.array([1, len(goals)])
    nodes, parents = np.empty((2, capacity, len(start))), np.full((2, capacity), -1)
    nodes[0, 0], nodes[1, : len(goals)] = start, goals
    return Forest(nodes, parents, np.full((2, capacity), np.inf), counts)


def _double_capacity(forest: Forest) -> Forest:
    """Return the same trees with twice the capacity."""
    return forest._replace(
        nodes=np.concatenate([forest.nodes] * 2, axis=1),
        parents=np.concatenate([forest.parents] * 2, axis=1),
        reaches=np.concatenate([forest.reaches] * 2, axis=1),
    )

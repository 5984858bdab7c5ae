"""Compiled path search for arms, with two trees that grow towards each other along proven motions.

J. J. Kuffner and S. M. LaValle, "RRT-Connect", 2000.
"""

from __future__ import annotations

import math
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
    """Return the node of a tree nearest to a configuration, and its distance."""
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
    """Return True if each joint moves by at most its span, shape (dof,)."""
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


def search_path(
    scene: Scene,
    bounds: tuple[Floats, Floats],
    start: Floats,
    goals: Floats,
    rng: np.random.Generator,
    seconds: float,
    straight: bool,
    spans: Floats,
) -> Floats:
    """Find a proven path to one of several goals.

    The path has shape (n, dof), and is empty if none was found. Start and goals must be free. Samples are the endpoints
    themselves, then uniform within the bounds.
    """
    scratch, forest, length, end = make_scene_scratch(scene), _plant_trees(start, goals), 0, clock() + seconds
    path = np.empty(forest.nodes[0].shape)
    samples = np.concatenate([goals[np.argsort(((goals - start) ** 2).sum(axis=1))], start[np.newaxis]])
    while not length and clock() < end:
        if len(samples) < TRIES_PER_CLOCK_CHECK:
            samples = np.concatenate([samples, rng.uniform(*bounds, (SAMPLES_PER_BATCH, len(start)))])
        used, length = grow_trees(scene, forest, samples, scratch, straight, spans, path)
        samples = samples[used:]
        if forest.counts.max() + 2 >= forest.nodes.shape[1]:
            forest = _double_capacity(forest)
            path = np.empty(forest.nodes[0].shape)
    return path[:length]


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

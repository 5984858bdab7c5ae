"""Compiled search of a path for an arm: two trees that grow towards each other (J. J. Kuffner and S. M. LaValle,
"RRT-Connect", 2000), along motions that are proven free.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.proofs import Scene, Work, motion_is_free, point_is_free, work_of
from cspace.arrays import Floats, Ints
from cspace.compiling import clock, kernel

STRIDE: Final = 1.0
"""Longest motion that a tree grows by, radians or metres."""

NEAR_PER_SQRT_JOINT: Final = 1.25 * STRIDE
"""Radius of a blocked node's sampling domain, divided by the square root of the number of joints; radians or metres.

A node from which a motion was blocked ignores farther samples (A. Yershova and others, "Dynamic-domain RRTs", 2005).
Distances between random configurations grow with that square root.
"""

SLICE: Final = 32
"""How often a tree tries to grow between two looks at the clock."""

SAMPLES: Final = 256
"""Samples drawn at a time, most of which are too far off from where a narrow passage is."""

ROOM: Final = 1000
"""Nodes that there is room for in the beginning."""


class Forest(NamedTuple):
    """Two trees, one from the start and one from the goals, each of which is a root.

    Attributes
    ----------
    nodes : ndarray of float64, shape (2, n, dof)
    parents : ndarray of int64, shape (2, n)
        -1 for a root.
    reaches : ndarray of float64, shape (2, n)
        How far off a sample may be for a node to grow towards it.
    counts : ndarray of int64, shape (2,)
    """

    nodes: Floats
    parents: Ints
    reaches: Floats
    counts: Ints


@kernel
def nearest_to(forest: Forest, side: int, q: Floats) -> tuple[int, float]:
    """The node of a tree nearest to a configuration, and how far off it is."""
    nodes, best, at = forest.nodes[side], np.inf, -1
    for n in range(forest.counts[side]):
        square = 0.0
        for d in range(len(q)):
            square += (nodes[n, d] - q[d]) ** 2
        if square < best:
            best, at = square, n
    return at, math.sqrt(best)


@kernel
def stepped(forest: Forest, scene: Scene, side: int, near: int, q: Floats, work: Work) -> int:
    """Grow a tree from a node by a stride towards a configuration, or to it: the new node, or -1 if it is blocked."""
    new, nodes, square = forest.counts[side], forest.nodes[side], 0.0
    for d in range(len(q)):
        square += (nodes[near, d] - q[d]) ** 2
    share = STRIDE / math.sqrt(square) if square > STRIDE**2 else 1.0
    for d in range(len(q)):
        nodes[new, d] = nodes[near, d] + share * (q[d] - nodes[near, d]) if share < 1.0 else q[d]
    if not (point_is_free(scene, nodes[new], work) and motion_is_free(scene, nodes[near], nodes[new], work)):
        forest.reaches[side, near] = NEAR_PER_SQRT_JOINT * math.sqrt(len(q))
        return -1
    forest.parents[side, new], forest.reaches[side, new] = near, np.inf
    forest.counts[side] = new + 1
    return int(new)


@kernel
def is_within(q0: Floats, q1: Floats, spans: Floats) -> bool:
    """Return whether each joint moves by at most its span, shape (dof,)."""
    within = True
    for d in range(len(q0)):
        within &= abs(q1[d] - q0[d]) <= spans[d]
    return within


@kernel
def join(
    scene: Scene, forest: Forest, first: int, second: int, work: Work, straight: bool, spans: Floats, path: Floats
) -> int:
    """Write the way from the first tree's root to one of the second's by two nodes where they meet; its length.

    If ``straight``, leave out nodes that straight motions within the spans of the joints do not need.
    """
    stop = 0
    for side in range(2):
        at = second if side else first
        while at >= 0:
            for d in range(path.shape[1]):
                path[stop, d] = forest.nodes[side, at, d]
            at, stop = forest.parents[side, at], stop + 1
        if side == 0:
            # From the root on; where they meet, the node of the second tree stands for both.
            for k in range(stop // 2):
                for d in range(path.shape[1]):
                    path[k, d], path[stop - 1 - k, d] = path[stop - 1 - k, d], path[k, d]
            stop -= 1
    here, rows = 0, 1
    while here < stop - 1:
        ahead = stop - 1 if straight else here + 1
        while ahead > here + 1 and not (
            is_within(path[rows - 1], path[ahead], spans) and motion_is_free(scene, path[rows - 1], path[ahead], work)
        ):
            ahead = here + (ahead - here) // 2
        for d in range(path.shape[1]):
            path[rows, d] = path[ahead, d]
        here, rows = ahead, rows + 1
    return rows


@kernel
def grow(
    scene: Scene, forest: Forest, samples: Floats, work: Work, straight: bool, spans: Floats, path: Floats
) -> tuple[int, int]:
    """Grow the smaller tree towards each sample, shape (n, dof): how many were used, and how long a path is.

    There is none where the trees have not met by a proven one yet: after so many tries, or where room is scarce.
    """
    room, tries = forest.nodes.shape[1], 0
    for k in range(len(samples)):
        side = 0 if forest.counts[0] <= forest.counts[1] else 1
        if tries == SLICE or max(forest.counts[0], forest.counts[1]) + 2 >= room:
            return k, 0
        near, far = nearest_to(forest, side, samples[k])
        if far > forest.reaches[side, near]:
            continue
        tries += 1
        new = stepped(forest, scene, side, near, samples[k], work)
        if new < 0:
            continue
        # The other tree comes as far as it can.
        target, other = forest.nodes[side, new], 1 - side
        at, far = nearest_to(forest, other, target)
        while at >= 0 and far > 0.0 and forest.counts[other] + 1 < room:
            at, far = stepped(forest, scene, other, at, target, work), far - STRIDE
        if at >= 0 and far <= 0.0:
            first, second = (new, at) if side == 0 else (at, new)
            return k + 1, join(scene, forest, first, second, work, straight, spans, path)
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
    """A proven path from a free configuration to one of some free goals, shape (n, dof); empty where none was found.

    Samples are uniform within the bounds, after the ends themselves.
    """
    work, forest, length, end = work_of(scene), _planted(start, goals), 0, clock() + seconds
    path = np.empty(forest.nodes[0].shape)
    samples = np.concatenate([goals[np.argsort(((goals - start) ** 2).sum(axis=1))], start[np.newaxis]])
    while not length and clock() < end:
        if len(samples) < SLICE:
            samples = np.concatenate([samples, rng.uniform(*bounds, (SAMPLES, len(start)))])
        used, length = grow(scene, forest, samples, work, straight, spans, path)
        samples = samples[used:]
        if forest.counts.max() + 2 >= forest.nodes.shape[1]:
            forest = _doubled(forest)
            path = np.empty(forest.nodes[0].shape)
    return path[:length]


def _planted(start: Floats, goals: Floats) -> Forest:
    """Trees that are nothing but roots."""
    room, counts = ROOM + len(goals), np.array([1, len(goals)])
    nodes, parents = np.empty((2, room, len(start))), np.full((2, room), -1)
    nodes[0, 0], nodes[1, : len(goals)] = start, goals
    return Forest(nodes, parents, np.full((2, room), np.inf), counts)


def _doubled(forest: Forest) -> Forest:
    """The same trees with twice the room."""
    return forest._replace(
        nodes=np.concatenate([forest.nodes] * 2, axis=1),
        parents=np.concatenate([forest.parents] * 2, axis=1),
        reaches=np.concatenate([forest.reaches] * 2, axis=1),
    )

"""Compiled proofs that the links of an arm touch neither obstacles nor each other, anywhere on a motion of the joints.

A motion is cut into parts. In the middle of each, every link is so far from what it may not touch; the most that it can
move meanwhile (:mod:`cspace.arms.chain`) says how much of the part that proves, and the rest is looked at again. What
was nearest last is asked first.

Links and obstacles are triangles, grown by radii (:mod:`cspace.exact.triangles`). Where no borders meet, what hangs
together lies in a closed surface as a whole or not at all, so one point of it tells, once for all of a motion.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arms.chain import Chain, motion_of, place
from cspace.compiling import inner, jit
from cspace.exact import ADVANCE, MOST_DISTANCES, SHORTEST
from cspace.exact.triangles import DEPTH, Motion, Trees, share_apart
from cspace.raster.triangles import point_triangle
from cspace.raster.winding import turn_above

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

WAITING: Final = 1024
"""Parts of a motion that wait at a time, at most."""


_BEYOND: Final = 1.000001 / ADVANCE
"""How much farther than a part reaches is looked, so that what is used of it reaches all of it, rounding included."""


class Solids(NamedTuple):
    """Links and obstacles: what hangs on which body, with its tree, its closed surface and points of it.

    Attributes
    ----------
    bodies : ndarray of int64, shape (s,)
    trees : Trees
        Of all of them, each in the frame of its body.
    nodes : ndarray of int64, shape (s, 3)
        Roots.
    triangles : ndarray of float64, shape (n, 3, 3)
        Of closed surfaces.
    turns : ndarray of int64, shape (n,)
        How often each of them counts.
    boxes : ndarray of float64, shape (h, 6)
        Lower and upper corner of each surface.
    firsts : ndarray of int64, shape (h + 1,)
        The first triangle of each surface.
    anchors : ndarray of float64, shape (m, 3)
        A point of each part that hangs together.
    starts : ndarray of int64, shape (s + 1, 2)
        The first surface and the first anchor of each solid.
    """

    bodies: Ints
    trees: Trees
    nodes: Ints
    triangles: Floats
    turns: Ints
    boxes: Floats
    firsts: Ints
    anchors: Floats
    starts: Ints


class Scene(NamedTuple):
    """An arm among obstacles.

    Attributes
    ----------
    chain : Chain
    solids : Solids
    pairs : ndarray of int64, shape (p, 2)
        Solids that may not touch; the body of the second is the world, or moves too.
    least : float
        What a distance has to exceed.
    """

    chain: Chain
    solids: Solids
    pairs: Ints
    least: float


class Work(NamedTuple):
    """Room for one thread.

    Attributes
    ----------
    parts : ndarray of float64, shape (WAITING, 2)
        Parts of a motion that wait.
    poses, rates : ndarray of float64, shapes (b, 3, 4) and (b,)
    nearest : ndarray of int64, shape (p, 3)
        What was nearest to touching last, pair by pair.
    nodes : ndarray of int64, shape (DEPTH, 6)
    """

    parts: Floats
    poses: Floats
    rates: Floats
    nearest: Ints
    nodes: Ints


@jit
def work_of(scene: Scene) -> Work:
    """Room for the proofs of one thread."""
    bodies, pairs = len(scene.chain.parents), len(scene.pairs)
    return Work(
        np.empty((WAITING, 2)),
        np.empty((bodies, 3, 4)),
        np.zeros(bodies),
        np.full((pairs, 3), -1, np.int64),
        np.empty((DEPTH, 6), np.int64),
    )


@jit
def ask_motions(scene: Scene, starts: Floats, ends: Floats, out: Bools) -> None:
    """Whether all configurations of motions are free, shapes (n, dof); one that ends where it starts is a point."""
    work = work_of(scene)
    for k in range(len(starts)):
        out[k] = ask_motion(scene, starts[k], ends[k], work) >= 0


@inner(error_model="numpy")
def ask_motion(scene: Scene, q0: Floats, q1: Floats, work: Work) -> int:
    """Whether all configurations of a motion are free: how many looks that took, zero or above; or -1 less that."""
    chain, parts, rates, pairs, nearest = scene.chain, work.parts, work.rates, len(scene.pairs), 0
    for b in range(1, len(rates)):
        number = chain.numbers[b]
        rates[b] = chain.factors[b] * (q1[number] - q0[number]) if chain.kinds[b] else 0.0
    parts[0, 0], parts[0, 1] = 0.0, 1.0
    head, waiting, looks = 0, 1, 0
    while waiting > 0:
        waiting -= 1
        # The longest one, so that a collision far along the way shows early; where room gets scarce the shortest.
        row = head if waiting < WAITING - 64 else (head + waiting) % WAITING
        head = (head + 1) % WAITING if row == head else head
        first, last = parts[row, 0], parts[row, 1]
        half, middle = 0.5 * (last - first), 0.5 * (first + last)
        if looks == MOST_DISTANCES:
            return -1 - looks
        place(chain, q0, q1, middle, work.poses)
        part, begin = half * _BEYOND, nearest
        for k in range(pairs):
            n = (begin + k) % pairs
            found = share_of(scene, n, part, work)
            if found < part:
                part, nearest = found, n
            # As long as no borders meet, whether one lies within the other stays as it is.
            if found < 0.0 or (looks == 0 and nests(scene, n, work.poses, -1.0)):
                return -1 - looks
        looks += 1
        part *= ADVANCE
        if part < min(half, SHORTEST):
            return -1 - looks
        if part < half:
            row = (head + waiting) % WAITING
            parts[row, 0], parts[row, 1] = first, middle - part
            row = (row + 1) % WAITING
            parts[row, 0], parts[row, 1] = middle + part, last
            waiting += 2
    return looks


@inner(error_model="numpy")
def share_of(scene: Scene, n: int, enough: float, work: Work) -> float:
    """The part of a motion, ``enough`` at most, either way, in which a pair does not come to touch; or below zero."""
    solids, nodes, nearest = scene.solids, work.nodes, work.nearest
    i, j = scene.pairs[n]
    motion = motion_of(scene.chain, solids.bodies[i], solids.bodies[j], work.poses, work.rates, enough, scene.least)
    one, other = solids.nodes[i], solids.nodes[j]
    nodes[0, 0], nodes[0, 1], nodes[0, 2] = nearest[n, 0], nearest[n, 1], nearest[n, 2]
    found = share_apart(solids.trees, (one[0], one[1], one[2]), (other[0], other[1], other[2]), motion, enough, nodes)
    nearest[n, 0], nearest[n, 1], nearest[n, 2] = nodes[0, 0], nodes[0, 1], nodes[0, 2]
    return found


@inner(error_model="numpy")
def nests(scene: Scene, n: int, poses: Floats, deep: float) -> bool:
    """Whether an anchor of one solid of a pair lies in a closed surface of the other, so far from its triangles.

    Where no borders meet, an anchor tells of all that hangs together with it, and ``deep`` is -1.
    """
    i, j = scene.pairs[n]
    return bool(holds(scene, i, j, poses, deep) or holds(scene, j, i, poses, deep))


@inner(error_model="numpy")
def holds(scene: Scene, i: int, j: int, poses: Floats, deep: float) -> bool:
    """Whether an anchor of solid i lies in solid j, as :func:`nested`."""
    solids = scene.solids
    one, other = poses[solids.bodies[i]], poses[solids.bodies[j]]
    for surface in range(solids.starts[j, 0], solids.starts[j + 1, 0]):
        box = solids.boxes[surface]
        for n in range(solids.starts[i, 1], solids.starts[i + 1, 1]):
            anchor = solids.anchors[n]
            x = one[0, 0] * anchor[0] + one[0, 1] * anchor[1] + one[0, 2] * anchor[2] + one[0, 3] - other[0, 3]
            y = one[1, 0] * anchor[0] + one[1, 1] * anchor[1] + one[1, 2] * anchor[2] + one[1, 3] - other[1, 3]
            z = one[2, 0] * anchor[0] + one[2, 1] * anchor[1] + one[2, 2] * anchor[2] + one[2, 3] - other[2, 3]
            px = other[0, 0] * x + other[1, 0] * y + other[2, 0] * z
            py = other[0, 1] * x + other[1, 1] * y + other[2, 1] * z
            pz = other[0, 2] * x + other[1, 2] * y + other[2, 2] * z
            if not (box[0] <= px <= box[3] and box[1] <= py <= box[4] and box[2] <= pz <= box[5]):
                continue
            turns, near = 0, np.inf
            for t in range(solids.firsts[surface], solids.firsts[surface + 1]):
                turns += turn_above(solids.triangles[t], px, py, pz) * solids.turns[t]
                if deep >= 0.0:
                    near = min(near, point_triangle(px, py, pz, solids.triangles[t]))
            if turns != 0 and near > deep:
                return True
    return False


@jit
def distances(scene: Scene, points: Floats, out: Floats, nearest: Ints) -> None:
    """How far apart, at least, all pairs are at configurations, shape (n, dof): below zero where that is not proven.

    ``nearest``, shape (n, 3), is given the pair and the two triangles that set it.
    """
    work, solids, nodes = work_of(scene), scene.solids, np.empty((DEPTH, 6), np.int64)
    for k in range(len(points)):
        place(scene.chain, points[k], points[k], 0.0, work.poses)
        out[k] = np.inf
        for n in range(len(scene.pairs)):
            i, j = scene.pairs[n]
            one, other = solids.nodes[i], solids.nodes[j]
            at = motion_of(scene.chain, solids.bodies[i], solids.bodies[j], work.poses, work.rates, 0.0, 0.0)
            # What moves at the rate of one metre comes as far as the distance.
            motion = Motion(at.matrix, at.place, at.step, 0.0, scene.least, 1.0)
            nodes[0, 0] = -1
            found = share_apart(
                solids.trees, (one[0], one[1], one[2]), (other[0], other[1], other[2]), motion, out[k], nodes
            )
            if found >= 0.0 and nests(scene, n, work.poses, -1.0):
                found = -1.0
            if found < out[k]:
                out[k] = found
                nearest[k, 0], nearest[k, 1], nearest[k, 2] = n, nodes[0, 0], nodes[0, 1]


@jit
def ask_blocked(scene: Scene, points: Floats, out: Bools) -> None:
    """Whether an anchor of one solid lies in another one of its pair, farther from its surface than ``scene.least``."""
    work = work_of(scene)
    for k in range(len(points)):
        place(scene.chain, points[k], points[k], 0.0, work.poses)
        out[k] = False
        for n in range(len(scene.pairs)):
            out[k] = out[k] or nests(scene, n, work.poses, scene.least)

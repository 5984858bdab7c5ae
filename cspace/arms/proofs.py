"""Compiled proofs that the links of an arm touch neither obstacles nor each other, anywhere on a motion of the joints.

A motion is cut into halves again and again. In the middle of a part, each pair of solids that may not touch is so far
apart that it stays so for all of the part, or it is tested again in both halves of it: what is far from all else is
tested once (F. Schwarzer, M. Saha and J.-C. Latombe, "Adaptive dynamic collision checking for single and multiple
articulated robots in complex environments", 2005). Longer parts come first, so that a collision shows early, and in
each the pair that was not proven last.

Links and obstacles are trees of convex hulls, grown by radii (:mod:`cspace.arms.hulls`). Where no borders meet, a
connected part lies in a closed surface as a whole or not at all, so one point of it decides, once for all of a motion;
and where hulls that hold all of both sides are apart, none does.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace.arms.chain import Chain, bounds_of, flight_of, place, relative_pose
from cspace.arms.hulls import CACHED, Hulls, least_excess
from cspace.arrays import Bools, Floats, Ints, Matrix, Row
from cspace.compiling import kernel
from cspace.exact import ADVANCE_FACTOR, DISTANCE_ROUNDING, MAX_DISTANCES_PER_EDGE, MIN_ADVANCE
from cspace.exact.triangles import MAX_PENDING_PAIRS, Trees, crosses, pierces, read_box
from cspace.kernels import apply_pose, box_extent, dot, extent_along, minus, point_triangle, rotate_back, row_at
from cspace.raster.surfaces import signed_crossing

WAITING: Final = 1024
"""Parts of a motion that wait at a time, at most."""

STILL: Final = (0.0, 0.0, 0.0)
"""How a pair moves that does not."""


class Solids(NamedTuple):
    """Links and obstacles: what hangs on which body, with its tree, its closed surface and points of it.

    Attributes
    ----------
    bodies : ndarray of int64, shape (s,)
    hulls : Hulls
        Of all of them, each in the frame of its body.
    roots : ndarray of int64, shape (s,)
        -1 where there is nothing.
    part_roots : ndarray of int64, shape (k,)
        The first node of each part, solid by solid.
    levers : ndarray of float64, shape (s,)
        How far they reach from their body's origin.
    trees : Trees
        What BLOCKED is proven by: triangles, boxes and balls, each in the frame of its body.
    tree_roots : ndarray of int64, shape (s,)
        Roots of these.
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
    filled : ndarray of bool, shape (s,)
        Whether there are boxes or balls in its tree, which are solid; their levers are 1 where they could lie in others
        as a whole, and 0 for all else.
    starts : ndarray of int64, shape (s + 1, 2)
        The first surface and the first anchor of each solid.
    """

    bodies: Ints
    hulls: Hulls
    roots: Ints
    part_roots: Ints
    levers: Floats
    trees: Trees
    tree_roots: Ints
    triangles: Floats
    turns: Ints
    boxes: Floats
    firsts: Ints
    anchors: Floats
    filled: Bools
    starts: Ints


class Scene(NamedTuple):
    """An arm among obstacles.

    Attributes
    ----------
    chain : Chain
    solids : Solids
    pairs : ndarray of int64, shape (p, 2)
        Solids that may not touch; the body of the second is the world, or moves too.
    far : float
        The largest coordinate of all, at any configuration, metres.
    least : float
        What a distance has to exceed.
    """

    chain: Chain
    solids: Solids
    pairs: Ints
    far: float
    least: float


class Work(NamedTuple):
    """Room for one thread.

    Attributes
    ----------
    parts : ndarray of float64, shape (WAITING, 2)
        Parts of a motion that wait.
    left : ndarray of bool, shape (WAITING, p)
        Which pairs are to be proven in each.
    poses : ndarray of float64, shape (b, 3, 6)
    bounds : ndarray of float64, shape (p, 3)
        Of pairs, along all of the motion: how far the first moves at most, half its acceleration, how far joints turn.
    not_nested : ndarray of bool, shape (p,)
        Pairs that are known not to lie in each other.
    nearest : ndarray of int64, shape (p, 2)
        The nodes that were nearest to touching last, pair by pair.
    directions : ndarray of float64, shape (CACHED, 4)
        Along what pairs of hulls were apart last.
    nodes : ndarray of int64, shape (DEPTH, 2)
    """

    parts: Floats
    left: Bools
    poses: Floats
    bounds: Floats
    not_nested: Bools
    nearest: Ints
    directions: Floats
    nodes: Ints


def work_of(scene: Scene) -> Work:
    """Room for the proofs of one thread."""
    bodies, pairs = len(scene.chain.parents), len(scene.pairs)
    return Work(
        np.empty((WAITING, 2)),
        np.empty((WAITING, pairs), dtype=np.bool_),
        np.empty((bodies, 3, 6)),
        np.empty((pairs, 3)),
        np.empty(pairs, dtype=np.bool_),
        np.full((pairs, 2), -1),
        np.zeros((CACHED, 4)),
        np.empty((MAX_PENDING_PAIRS, 2), dtype=np.int64),
    )


def are_free(scene: Scene, firsts: Floats, lasts: Floats) -> Bools:
    """Whether motions are proven free, shapes (n, dof), in one thread."""
    out = np.empty(len(firsts), dtype=np.bool_)
    motions_are_free(scene, firsts, lasts, out, work_of(scene))
    return out


@kernel
def motions_are_free(scene: Scene, firsts: Floats, lasts: Floats, out: Bools, work: Work) -> None:
    """Whether all configurations of motions are free, shapes (n, dof); one that ends where it starts is a point."""
    for k in range(len(firsts)):
        # Most motions that are not free end in a collision.
        out[k] = point_is_free(scene, lasts[k], work) and motion_is_free(scene, firsts[k], lasts[k], work)


@kernel
def least_of(scene: Scene, q0: Floats, q1: Floats) -> float:
    """What a distance has to exceed on a motion: what a joint's value is off by moves all that hangs on it."""
    chain, size = scene.chain, 0.0
    for b in range(1, len(chain.parents)):
        q, r = q0[chain.numbers[b]], q1[chain.numbers[b]]
        size += abs(chain.factors[b]) * (abs(q) + abs(r)) + abs(chain.offsets[b])
    return scene.least + DISTANCE_ROUNDING * 2.0**-9 * size * scene.far


@kernel
def point_is_free(scene: Scene, q: Floats, work: Work) -> bool:
    """Whether a configuration is proven free."""
    place(scene.chain, q, q, 0.0, work.poses)
    least = least_of(scene, q, q)
    for n in range(len(scene.pairs)):
        if excess_of(scene, n, STILL, least, 0.0, work) < 0.0 or (work.nodes[1, 0] and is_nested(scene, n, work, -1.0)):
            return False
    return True


@kernel
def motion_is_free(scene: Scene, q0: Floats, q1: Floats, work: Work) -> bool:
    """Whether all configurations of a motion are proven free, the last of which is."""
    chain, solids, parts, left = scene.chain, scene.solids, work.parts, work.left
    pairs, nearest, far, least = len(scene.pairs), 0, 0.0, least_of(scene, q0, q1)
    if not least < np.inf:  # nor is NaN, which any number that is none makes of it
        return False
    for n in range(pairs):
        i, j = scene.pairs[n]
        most, curvature_bound, turned = bounds_of(chain, solids.bodies[i], solids.bodies[j], solids.levers[i], q0, q1)
        work.bounds[n, 0], work.bounds[n, 1], work.bounds[n, 2] = most, curvature_bound, turned
        work.not_nested[n], left[0, n] = False, True
        far = max(far, most)
    if far == 0.0:
        return True
    parts[0, 0], parts[0, 1] = 0.0, 1.0
    head, waiting, looks = 0, 1, 0
    while waiting > 0:
        waiting -= 1
        # The longest one, so that a collision far along the way shows early; where room gets scarce the shortest.
        row = head if waiting < WAITING - 64 else (head + waiting) % WAITING
        head = (head + 1) % WAITING if row == head else head
        first, last = parts[row, 0], parts[row, 1]
        half, middle = 0.5 * (last - first), 0.5 * (first + last)
        if looks == MAX_DISTANCES_PER_EDGE or half < MIN_ADVANCE:
            return False
        place(chain, q0, q1, middle, work.poses)
        looks += 1
        begin, undecided = nearest, False
        for k in range(pairs):
            n = (begin + k) % pairs
            if not left[row, n]:
                continue
            # The rounding of what moves is a small part of all that does.
            curvature_bound = half * (half * work.bounds[n, 1] + least * work.bounds[n, 2]) / ADVANCE_FACTOR
            bounds = half / ADVANCE_FACTOR, curvature_bound, half * work.bounds[n, 0] / ADVANCE_FACTOR
            slack = excess_of(scene, n, bounds, least, 0.0, work)
            left[row, n] = slack < 0.0
            if slack < 0.0:
                nearest, undecided = n, True
                if slack == -np.inf:
                    return False
            if work.nodes[1, 0] and not work.not_nested[n]:
                # As long as no borders meet, whether one lies within the other stays as it is.
                if is_nested(scene, n, work, -1.0):
                    return False
                work.not_nested[n] = True
        if undecided:
            one, other = (head + waiting) % WAITING, (head + waiting + 1) % WAITING
            parts[one, 0], parts[one, 1], parts[other, 0], parts[other, 1] = first, middle, middle, last
            for n in range(pairs):
                left[one, n] = left[other, n] = left[row, n]
            waiting += 2
    return True


@kernel
def excess_of(
    scene: Scene, n: int, bounds: tuple[float, float, float], least: float, enough: float, work: Work
) -> float:
    """:func:`cspace.arms.hulls.least_excess` of a pair, which is infinite where one of them is nothing.

    ``bounds``: the time to either side, and by how much the pair can leave its motion meanwhile, and can move in all.
    """
    solids, nodes, nearest, (half, curvature_bound, most) = scene.solids, work.nodes, work.nearest, bounds
    i, j = scene.pairs[n]
    if solids.roots[i] < 0 or solids.roots[j] < 0:
        nodes[1, 0] = 0
        return np.inf
    flight = flight_of(work.poses[solids.bodies[i]], work.poses[solids.bodies[j]], half, curvature_bound, most, least)
    nodes[0, 0], nodes[0, 1] = nearest[n, 0], nearest[n, 1]
    slack = least_excess(solids.hulls, solids.roots[i], solids.roots[j], flight, enough, nodes, work.directions)
    nearest[n, 0], nearest[n, 1] = nodes[0, 0], nodes[0, 1]
    return slack


@kernel
def is_nested(scene: Scene, n: int, work: Work, deep: float) -> bool:
    """Whether an anchor of one solid of a pair lies in a closed surface of the other, so far from its triangles.

    Where no borders meet, an anchor decides for its connected part, and ``deep`` is -1.
    """
    i, j = scene.pairs[n]
    if anchor_lies_in(scene, i, j, work, deep) or anchor_lies_in(scene, j, i, work, deep):
        return True
    return bool(scene.solids.filled[j] and piece_lies_in(scene, j, i, work, deep))


@kernel
def anchor_lies_in(scene: Scene, i: int, j: int, work: Work, deep: float) -> bool:
    """Whether an anchor of solid i lies in a closed surface of solid j, as :func:`is_nested`."""
    solids = scene.solids
    matrix, shift = relative_pose(work.poses[solids.bodies[i]], work.poses[solids.bodies[j]])
    for surface in range(solids.starts[j, 0], solids.starts[j + 1, 0]):
        for n in range(solids.starts[i, 1], solids.starts[i + 1, 1]):
            if encloses(solids, surface, apply_pose(matrix, shift, row_at(solids.anchors[n], 0)), deep):
                return True
    return False


@kernel
def piece_lies_in(scene: Scene, i: int, j: int, work: Work, deep: float) -> bool:
    """The same of the middles of boxes and balls of solid i that could lie in solid j as a whole."""
    solids, nodes = scene.solids, work.nodes
    trees, one, other = solids.trees, work.poses[solids.bodies[i]], work.poses[solids.bodies[j]]
    (matrix, shift), (back, shift_back) = relative_pose(one, other), relative_pose(other, one)
    for surface in range(solids.starts[j, 0], solids.starts[j + 1, 0]):
        whole = solids.boxes[surface]
        # The box around the surface, as it is placed in the frame of what does not move: what is near is looked for.
        middle = 0.5 * (whole[0] + whole[3]), 0.5 * (whole[1] + whole[4]), 0.5 * (whole[2] + whole[5])
        half = 0.5 * (whole[3] - whole[0]), 0.5 * (whole[4] - whole[1]), 0.5 * (whole[5] - whole[2])
        (x, y, z), (hx, hy, hz) = apply_pose(back, shift_back, middle), box_extent(back, half)
        nodes[1, 0], top = solids.tree_roots[i], 2
        while top > 1:
            top -= 1
            b = nodes[top, 0]
            box, (row, m) = trees.boxes[b], trees.spans[b]
            if box[6] == 0.0 or abs(x - box[0]) > hx + box[3]:
                continue
            if abs(y - box[1]) > hy + box[4] or abs(z - box[2]) > hz + box[5]:
                continue
            if m == 1:
                if encloses(solids, surface, apply_pose(matrix, shift, row_at(trees.triangles[row], 0)), deep):
                    return True
                continue
            nodes[top, 0], nodes[top + 1, 0] = b + 1, b + 2 * (m // 2)
            top += 2
    return False


@kernel
def encloses(solids: Solids, surface: int, point: Row, deep: float) -> bool:
    """Return whether a point lies in a closed surface and more than ``deep`` from its triangles.

    If ``deep`` is negative, the distance from the triangles does not matter.
    """
    x, y, z = point
    box = solids.boxes[surface]
    if not (box[0] <= x <= box[3] and box[1] <= y <= box[4] and box[2] <= z <= box[5]):
        return False
    turns = 0
    for t in range(solids.firsts[surface], solids.firsts[surface + 1]):
        turns += signed_crossing(solids.triangles[t], x, y, z) * solids.turns[t]
    if turns == 0:
        return False
    if deep >= 0.0:  # the distances cost far more than the turns, and few points get here
        for t in range(solids.firsts[surface], solids.firsts[surface + 1]):
            if point_triangle((x, y, z), solids.triangles[t]) <= deep:
                return False
    return True


@kernel
def borders_cross(scene: Scene, n: int, work: Work, least: float) -> bool:
    """Whether the first solid's border crosses that of the second one, or leads into a box or ball of it.

    By more than rounding can do: ``least`` is four times what a point may be off by, or more.
    """
    solids, trees, nodes = scene.solids, scene.solids.trees, work.nodes
    i, j = scene.pairs[n]
    if solids.tree_roots[i] < 0 or solids.tree_roots[j] < 0:
        return False
    matrix, shift = relative_pose(work.poses[solids.bodies[i]], work.poses[solids.bodies[j]])
    nodes[1, 0], nodes[1, 1], top = solids.tree_roots[i], solids.tree_roots[j], 2
    while top > 1:
        top -= 1
        a, b = nodes[top, 0], nodes[top, 1]
        box, against, (row, m), (piece, k) = trees.boxes[a], trees.boxes[b], trees.spans[a], trees.spans[b]
        middle, (hx, hy, hz) = apply_pose(matrix, shift, row_at(box, 0)), box_extent(matrix, row_at(box, 3))
        x, y, z = minus(middle, row_at(against, 0))
        if abs(x) > hx + against[3] or abs(y) > hy + against[4] or abs(z) > hz + against[5]:
            continue
        if k == 1 and is_beside(matrix, middle, row_at(box, 3), trees.triangles[piece]):
            continue
        if m == 1 and k == 1:
            p, q = trees.triangles[row], trees.triangles[piece]
            corners = (
                apply_pose(matrix, shift, row_at(p, 0)),
                apply_pose(matrix, shift, row_at(p, 3)),
                apply_pose(matrix, shift, row_at(p, 6)),
            )
            if q[9] != 0.0 and pierces(corners, q, least):
                return True
            if p[9] == 0.0 and q[9] == 0.0 and crosses(corners, (row_at(q, 0), row_at(q, 3), row_at(q, 6)), least):
                return True
        elif m == 1 or (k > 1 and against[3] + against[4] + against[5] > hx + hy + hz):
            nodes[top, 1], nodes[top + 1, 0], nodes[top + 1, 1] = b + 1, a, b + 2 * (k // 2)
            top += 2
        else:
            nodes[top, 0], nodes[top + 1, 0], nodes[top + 1, 1] = a + 1, a + 2 * (m // 2), b
            top += 2
    return False


@kernel
def is_beside(matrix: Matrix, middle: Row, half: Row, piece: Floats) -> bool:
    """Return True if a rotated box, with a middle and half sides, lies beyond a side of a solid box.

    ``piece`` is a row of :attr:`cspace.exact.triangles.Trees.triangles`; False if it is no box.
    """
    if piece[9] >= 0.0:
        return False
    offset, u, v, w = read_box(piece, middle)
    axes = u, v, w
    for k in range(3):
        axis = axes[k]
        if abs(dot(offset, axis)) > extent_along(rotate_back(matrix, axis), half) + dot(axis, axis):
            return True
    return False


@kernel
def distances(scene: Scene, points: Floats, out: Floats, nearest: Ints, work: Work) -> None:
    """Lower bounds of the distances of all pairs at configurations, shape (n, dof): below zero where nothing is proven.

    ``nearest``, shape (n, 3), is given the pair and the two nodes that set it.
    """
    nodes = work.nodes
    for k in range(len(points)):
        least = least_of(scene, points[k], points[k])
        place(scene.chain, points[k], points[k], 0.0, work.poses)
        out[k] = np.inf
        for n in range(len(scene.pairs)):
            work.nearest[n, 0] = -1  # so that the bound does not depend on what was looked at before
            slack = excess_of(scene, n, STILL, least, out[k], work)
            if slack >= 0.0 and nodes[1, 0] and is_nested(scene, n, work, -1.0):
                slack = -1.0
            if slack < out[k]:
                out[k] = slack
                nearest[k, 0], nearest[k, 1], nearest[k, 2] = n, nodes[0, 0], nodes[0, 1]


@kernel
def are_blocked(scene: Scene, points: Floats, out: Bools, work: Work) -> None:
    """Prove configurations BLOCKED: two borders cross, or one encloses a point of the other, beyond rounding."""
    for k in range(len(points)):
        least = least_of(scene, points[k], points[k])
        place(scene.chain, points[k], points[k], 0.0, work.poses)
        out[k] = False
        for n in range(len(scene.pairs)):
            # Solids whose hulls are apart have no borders that cross, and they have far fewer hulls than triangles.
            if not out[k] and excess_of(scene, n, STILL, least, 0.0, work) < 0.0:
                out[k] = borders_cross(scene, n, work, least)
        for n in range(len(scene.pairs)):
            out[k] = out[k] or is_nested(scene, n, work, least)

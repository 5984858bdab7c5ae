"""Compiled proofs about boxes of configurations: each joint anywhere within its interval, all of them at once.

*FREE.* The straight way from the middle of a box to any configuration in it is a motion on which no joint moves by more
than half of its interval. So what bounds a motion either way (:mod:`cspace.arms.chain`) with these halves for rates
bounds all of the box: two solids that are farther apart in the middle than one moves against the other do not touch
anywhere in it.

*BLOCKED.* A ball that lies in one solid moves by at most so much as well. What is left of its radius is a ball that the
solid holds, where it is, at every configuration of the box; if the other solid meets that one, they collide in all of
the box. Where nothing is left of it, its middle must lie in the other solid as deep as it lacks.

*Blocks.* All cells are looked at together first. A pair of solids that is proven apart is not tested again; where
some pairs are left, the block is halved along the joint that moves the arm the farthest, down to a cell, which is then
MIXED. So the work grows with the cells along the border of the C-obstacle, and not with all of them.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.chain import SLIDES, TURNS, column, place, relative_pose, rotation_of
from cspace.arms.proofs import Scene, Solids, Work, excess_of, is_nested, least_of
from cspace.arrays import BLOCKED, FREE, MIXED, Floats, Ints, Row, States
from cspace.compiling import kernel
from cspace.exact import ADVANCE_FACTOR
from cspace.exact.triangles import read_box
from cspace.grid import SLACK
from cspace.kernels import THIN, apply_pose, cross, dot, minus, point_triangle, rotate, row_at
from cspace.map.points import replaced
from cspace.raster.surfaces import signed_crossing

WAITING: Final = 96
"""Blocks that wait at a time, at most: one for each halving of three axes of 2^31 cells, and some."""

FINER: Final = 4
"""Parts of a step of a lattice in a closed surface, along each axis, that are looked at where it does not tell."""


class Cells(NamedTuple):
    """Which configurations the cells of a map are.

    Attributes
    ----------
    lower : ndarray of float64, shape (3,)
        Where the first cell begins, along three axes; a map of two joints has one cell along the first.
    spacing : float
    numbers : ndarray of int64, shape (3,)
        The number of a configuration that each axis is; -1 of an axis that is none.
    at : ndarray of float64, shape (dof,)
        Where the other numbers are.
    levers : ndarray of float64, shape (3,)
        How far a unit of each number moves the arm, about.
    """

    lower: Floats
    spacing: float
    numbers: Ints
    at: Floats
    levers: Floats


class Box(NamedTuple):
    """A box of configurations.

    Attributes
    ----------
    middle, halves : ndarray of float64, shape (dof,)
        Its middle, and half of its sides.
    least : float
        What distances have to exceed.
    """

    middle: Floats
    halves: Floats
    least: float


class Interiors(NamedTuple):
    """Balls that lie in solids, and how deep points of a lattice lie in closed surfaces.

    Attributes
    ----------
    centers : ndarray of float64, shape (n, 3)
        Of balls, in the frame of the solid's body.
    radii, levers : ndarray of float64, shape (n,)
        The latter is how far the center is from the body's origin.
    starts : ndarray of int64, shape (s + 1,)
        The first ball of each solid.
    deepest : ndarray of float64, shape (s,)
        No point of a solid lies much deeper in it.
    steps : ndarray of float64, shape (h, 3)
        Of the lattice in each surface's box; its points are in the middles of as many cells.
    shapes : ndarray of int64, shape (h, 3)
    deep : ndarray of float64, shape (m,)
        By :func:`depth`, of all lattices in a row.
    finer : ndarray of float64, shape (FINER**3 * m,)
        The same of lattices that are finer by so much; 0 where it was not needed yet, which takes no memory.
    firsts : ndarray of int64, shape (h + 1,)
        Where those of each one begin.
    """

    centers: Floats
    radii: Floats
    levers: Floats
    starts: Ints
    deepest: Floats
    steps: Floats
    shapes: Ints
    deep: Floats
    finer: Floats
    firsts: Ints


class Rest(NamedTuple):
    """Blocks of cells whose states are not known yet.

    Attributes
    ----------
    blocks : ndarray of int64, shape (WAITING, 6)
        First cells, and those behind the last, along three axes.
    waiting : ndarray of int64, shape (WAITING, p)
        Pairs of solids that are not proven apart all over each.
    counts : ndarray of int64, shape (WAITING,)
        Numbers of these.
    left : ndarray of int64, shape (p,)
        Room for those of one block.
    box : Box
        Room for one; what it holds for all numbers of a configuration that no axis is, stays.
    """

    blocks: Ints
    waiting: Ints
    counts: Ints
    left: Ints
    box: Box


def rest_of(block: Ints, cells: Cells, pairs: int) -> Rest:
    """A block, shape (6,), which so many pairs wait for."""
    blocks, counts = np.empty((WAITING, 6), dtype=np.int64), np.empty(WAITING, dtype=np.int64)
    waiting, left = np.empty((WAITING, pairs), dtype=np.int64), np.empty(pairs, dtype=np.int64)
    blocks[0], waiting[0], counts[0] = block, np.arange(pairs), pairs
    return Rest(blocks, waiting, counts, left, Box(cells.at.copy(), np.zeros(len(cells.at)), 0.0))


class Inside(NamedTuple):
    """What proves BLOCKED: the solids from within, and balls that lie in them."""

    scene: Scene
    balls: Interiors


@kernel
def fill(scene: Scene, inside: Inside, cells: Cells, rest: Rest, states: States, work: Work) -> None:
    """States of the cells of a block, the first that waits, which all pairs of solids wait for."""
    blocks, waiting, counts, left, empty = rest
    top = 1
    while top > 0:
        top -= 1
        box = Box(empty.middle, empty.halves, middle_of(cells, scene, blocks[top], empty))
        place(scene.chain, box.middle, box.middle, 0.0, work.poses)
        count = 0
        for n in range(counts[top]):
            pair = waiting[top, n]
            # Borders that stay apart keep one solid in the other, or out of it, all over the box.
            if are_near(scene, pair, box, work) or is_nested(scene, pair, work, -1.0):
                left[count] = pair
                count += 1
        if count == 0:
            write(states, blocks[top], FREE)
        elif collide(inside, left[:count], box, work):
            write(states, blocks[top], BLOCKED)
        else:
            axis = longest(cells, blocks[top])
            if axis < 0:
                write(states, blocks[top], MIXED)
                continue
            cut = (blocks[top, axis] + blocks[top, axis + 3]) // 2
            for n in range(6):
                blocks[top + 1, n] = blocks[top, n]
            blocks[top, axis + 3] = blocks[top + 1, axis] = cut
            for n in range(count):
                waiting[top, n] = waiting[top + 1, n] = left[n]
            counts[top] = counts[top + 1] = count
            top += 2


@kernel
def write(states: States, block: Ints, state: int) -> None:
    """Give all cells of a block a state."""
    for i in range(block[0], block[3]):
        for j in range(block[1], block[4]):
            for k in range(block[2], block[5]):
                states[i, j, k] = state


@kernel
def are_near(scene: Scene, pair: int, box: Box, work: Work) -> bool:
    """Whether the borders of a pair of solids may touch somewhere in a box.

    They do not where they are farther apart in its middle than the solids can move, each point as far as any.
    """
    solids = scene.solids
    i, j = scene.pairs[pair]
    slide, angle = displacement_bounds(scene, solids.bodies[i], solids.bodies[j], box, work)
    moved = (slide + angle * solids.levers[i]) / ADVANCE_FACTOR
    return excess_of(scene, pair, (0.0, moved, moved), box.least, 0.0, work) < 0.0


@kernel
def displacement_bounds(scene: Scene, a: int, b: int, box: Box, work: Work) -> tuple[float, float]:
    """How far the origin of body ``a`` can move within a box, as seen from body ``b``, and how far the body can turn.

    A joint moves it by no more than its way times the distance from its axis: what that is in the middle, and what the
    other joints between can add, and never more than the lengths between.
    """
    chain, poses, moving, lengths = scene.chain, work.poses, scene.chain.between[a, b], scene.chain.lengths[a]
    origin = column(poses[a], 3)
    slide = angle = drift = 0.0
    for j in range(1, len(moving)):
        if moving[j]:
            travel = abs(chain.factors[j]) * box.halves[chain.numbers[j]]
            drift += travel * (lengths[j] if chain.kinds[j] == TURNS else 1.0)
    for j in range(1, len(moving)):
        travel = abs(chain.factors[j]) * box.halves[chain.numbers[j]]
        if not moving[j] or travel == 0.0:
            continue
        if chain.kinds[j] == TURNS:
            joint = poses[j]
            axis = rotate(rotation_of(joint), row_at(chain.axes[j], 0))
            off = cross(axis, minus(origin, column(joint, 3)))
            now = math.sqrt(dot(off, off)) + box.least
            slide += travel * min(lengths[j], now + drift - travel * lengths[j])
            angle += travel
        elif chain.kinds[j] == SLIDES:
            slide += travel
    return slide, angle


@kernel
def middle_of(cells: Cells, scene: Scene, block: Ints, box: Box) -> float:
    """Put the middle of a block of cells into a box, and half of its sides, rounding of look-ups included.

    Gives what distances have to exceed there.
    """
    for axis in range(3):
        number = cells.numbers[axis]
        if number >= 0:
            box.middle[number] = cells.lower[axis] + 0.5 * cells.spacing * (block[axis] + block[axis + 3])
            box.halves[number] = cells.spacing * (0.5 * (block[axis + 3] - block[axis]) + SLACK)
    return least_of(scene, box.middle, box.middle)


@kernel
def longest(cells: Cells, block: Ints) -> int:
    """The axis along which a block moves the arm the farthest; -1 of a cell."""
    chosen, most = -1, 0.0
    for axis in range(3):
        count = block[axis + 3] - block[axis]
        if count > 1 and count * cells.levers[axis] > most:
            chosen, most = axis, count * cells.levers[axis]
    return chosen


@kernel
def collide(inside: Inside, pairs: Ints, box: Box, work: Work) -> bool:
    """Whether some pair of solids is proven to collide at every configuration of a box."""
    for pair in pairs:
        i, j = inside.scene.pairs[pair]
        if ball_meets(inside, i, j, box, work) or ball_meets(inside, j, i, box, work):
            return True
    return False


@kernel
def ball_meets(inside: Inside, i: int, j: int, box: Box, work: Work) -> bool:
    """Whether solid j meets, all over a box, what a ball in solid i keeps of itself; or its middle, deep enough."""
    scene, balls, solids = inside.scene, inside.balls, inside.scene.solids
    slide, angle = displacement_bounds(scene, solids.bodies[i], solids.bodies[j], box, work)
    matrix, shift = relative_pose(work.poses[solids.bodies[i]], work.poses[solids.bodies[j]])
    for n in range(balls.starts[i], balls.starts[i + 1]):
        rest = balls.radii[n] - (slide + angle * balls.levers[n] + box.least)
        if rest + balls.deepest[j] <= 0.0:
            continue
        x, y, z = point = apply_pose(matrix, shift, row_at(balls.centers[n], 0))
        if solids.filled[j] and reaches_piece(solids, j, point, rest, work):
            return True
        for surface in range(solids.starts[j, 0], solids.starts[j + 1, 0]):
            whole = solids.boxes[surface]
            # What a surface holds is no deeper in it than in its box: most balls are told by that.
            if min(x - whole[0], whole[3] - x) + rest <= 0.0 or min(y - whole[1], whole[4] - y) + rest <= 0.0:
                continue
            if min(z - whole[2], whole[5] - z) + rest <= 0.0:
                continue
            least, most = bounds_of_depth(inside, surface, 1, point)
            if least + rest <= 0.0 < most + rest:
                least, most = bounds_of_depth(inside, surface, FINER, point)
            if least + rest > 0.0 or (most + rest > 0.0 and depth(solids, surface, x, y, z) + rest > 0.0):
                return True
    return False


@kernel
def reaches_piece(solids: Solids, j: int, point: Row, rest: float, work: Work) -> bool:
    """Whether a box or ball of a solid lies in reach of a point; below zero, whether the point lies so deep in one."""
    trees, nodes, near, (x, y, z) = solids.trees, work.nodes, max(rest, 0.0), point
    nodes[1, 0], top = solids.tree_roots[j], 2
    while top > 1:
        top -= 1
        b = nodes[top, 0]
        box, (row, m) = trees.boxes[b], trees.spans[b]
        if abs(x - box[0]) > near + box[3] or abs(y - box[1]) > near + box[4] or abs(z - box[2]) > near + box[5]:
            continue
        if m == 1:
            if depth_in_row(trees.triangles[row], point) + rest > 0.0:
                return True
            continue
        nodes[top, 0], nodes[top + 1, 0] = b + 1, b + 2 * (m // 2)
        top += 2
    return False


@kernel
def depth_in_row(row: Floats, point: Row) -> float:
    """How deep a point lies in a box or ball; below zero outside, and in what is neither."""
    if row[9] >= 0.0:
        away = minus(point, (row[0], row[1], row[2]))
        return row[9] - math.sqrt(dot(away, away)) if row[9] > 0.0 else -np.inf
    away, one, other, third = read_box(row, point)
    deep, square = np.inf, 0.0
    for axis in (one, other, third):
        half = math.sqrt(dot(axis, axis))
        inward = half - abs(dot(away, axis)) / half
        deep = min(deep, inward)
        square += min(inward, 0.0) ** 2
    return -math.sqrt(square) if square > 0.0 else deep


@kernel
def bounds_of_depth(inside: Inside, surface: int, parts: int, point: Row) -> tuple[float, float]:
    """How deep a point in the box of a closed surface, or near it, lies at least and about at most; below zero outside.

    Depth changes by no more than the distance, so that the nearest point of a lattice bounds it all around. Points of
    the lattice that is finer by so many ``parts`` are computed at need, and cached.
    """
    balls, solids, number, distance = inside.balls, inside.scene.solids, 0, 0.0
    box, known, near = solids.boxes[surface], balls.deep if parts == 1 else balls.finer, (0.0, 0.0, 0.0)
    for axis in range(3):
        step, count = balls.steps[surface, axis] / parts, balls.shapes[surface, axis] * parts
        place = min(max(math.floor((point[axis] - box[axis]) / step), 0), count - 1)
        near = replaced(near, axis, box[axis] + (place + 0.5) * step)
        distance += (point[axis] - near[axis]) ** 2
        number = number * count + int(place)
    number += balls.firsts[surface] * parts**3
    deep, distance = known[number], math.sqrt(distance)
    if deep == 0.0:
        # Threads that do so at once find the same.
        deep = known[number] = depth(solids, surface, near[0], near[1], near[2])
    return deep - distance, deep + distance


@kernel
def depth(solids: Solids, surface: int, x: float, y: float, z: float) -> float:
    """How deep a point lies in a closed surface, at least; below zero outside."""
    box, turns, least = solids.boxes[surface], 0, np.inf
    for t in range(solids.firsts[surface], solids.firsts[surface + 1]):
        turns += signed_crossing(solids.triangles[t], x, y, z) * solids.turns[t]
        least = min(least, point_triangle((x, y, z), solids.triangles[t]))
    # Outside, the distance must not be too small, as it may be to thin triangles.
    return least if turns != 0 else -least - THIN * (box[3] - box[0] + box[4] - box[1] + box[5] - box[2])


@kernel
def depths(solids: Solids, surface: int, points: Floats, out: Floats) -> None:
    """How deep points, shape (n, 3), lie in a closed surface."""
    for n in range(len(points)):
        out[n] = depth(solids, surface, points[n, 0], points[n, 1], points[n, 2])

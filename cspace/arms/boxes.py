"""Compiled proofs about boxes of configurations, in which each joint varies within an interval.

*FREE.* The straight motion from the center of a box to any configuration in it moves each joint by at most half its
interval. So the bounds of such a motion (:mod:`cspace.arms.chain`) hold for the whole box: if two solids are farther
apart at the center than one can move against the other, they touch nowhere in the box.

*BLOCKED.* A ball inside one solid moves by at most the same bound. If the ball is shrunk by the bound, the remaining
ball, where it is, lies in the solid at every configuration of the box. If the other solid meets the remaining ball,
both collide in the whole box. If nothing remains, the center of the ball must lie in the other solid deeper than the
missing radius.

*Blocks.* All cells are tested together first. A pair of solids that is proven apart is not tested again. If pairs are
left, the block is halved along the joint that moves the arm farthest, down to single cells, which are then MIXED. So
the work grows with the boundary of the C-obstacle, not with the number of cells.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arms.chain import PRISMATIC, REVOLUTE, column, forward_kinematics, pose_rotation, relative_pose
from cspace.arms.proofs import Scene, SceneScratch, Solids, is_nested, pair_slack, required_distance
from cspace.arrays import BLOCKED, FREE, MIXED, Floats, Ints, Row, States
from cspace.compiling import kernel
from cspace.exact import ADVANCE_FACTOR
from cspace.exact.triangles import read_box
from cspace.grid import SLACK
from cspace.kernels import THIN, apply_pose, cross, dot, minus, point_triangle, rotate, row_at
from cspace.map.points import replaced
from cspace.raster.surfaces import signed_crossing

MAX_PENDING_BLOCKS: Final = 96
"""Capacity of the stack of blocks: one for each halving of three axes of 2^31 cells, and some spare."""


LATTICE_REFINEMENT: Final = 4
"""Factor by which the depth lattice is refined if the coarse lattice does not decide."""


class JointCells(NamedTuple):
    """Map cells as configurations of the arm.

    Attributes
    ----------
    lower : ndarray of float64, shape (3,)
        Start of the first cell along three axes; a map of two joints has one cell along the first axis.
    spacing : float
    joint_indices : ndarray of int64, shape (3,)
        Index of the joint of each axis; -1 for the added axis.
    held : ndarray of float64, shape (dof,)
        Values of the other joints.
    levers : ndarray of float64, shape (3,)
        Approximate motion of the arm per unit of each axis.
    """

    lower: Floats
    spacing: float
    joint_indices: Ints
    held: Floats
    levers: Floats


class JointBox(NamedTuple):
    """A box of configurations.

    Attributes
    ----------
    center, halves : ndarray of float64, shape (dof,)
        Center and half sides.
    required : float
        Distance that proves a pair apart.
    """

    center: Floats
    halves: Floats
    required: float


class InnerBalls(NamedTuple):
    """Balls inside solids, and depths of lattice points in closed surfaces.

    Attributes
    ----------
    centers : ndarray of float64, shape (n, 3)
        Centers of the balls, in the frame of the solid's body.
    radii, levers : ndarray of float64, shape (n,)
        Radii, and distances of the centers from the body's origin.
    starts : ndarray of int64, shape (s + 1,)
        First ball of each solid.
    deepest : ndarray of float64, shape (s,)
        Approximate largest depth of a point in each solid.
    steps : ndarray of float64, shape (h, 3)
        Lattice steps in the box of each surface; the points are the centers of the lattice cells.
    shapes : ndarray of int64, shape (h, 3)
    depth : ndarray of float64, shape (m,)
        Depths by :func:`surface_depth` at all lattice points in a row.
    fine_depth : ndarray of float64, shape (LATTICE_REFINEMENT**3 * m,)
        Depths on the refined lattices, computed at need; 0 means not yet computed, which takes no memory.
    depth_starts : ndarray of int64, shape (h + 1,)
        First lattice point of each surface.
    """

    centers: Floats
    radii: Floats
    levers: Floats
    starts: Ints
    deepest: Floats
    steps: Floats
    shapes: Ints
    depth: Floats
    fine_depth: Floats
    depth_starts: Ints


class PendingBlocks(NamedTuple):
    """Stack of blocks of cells whose states are unknown.

    Attributes
    ----------
    blocks : ndarray of int64, shape (MAX_PENDING_BLOCKS, 6)
        First cells and stop cells along three axes.
    pair_lists : ndarray of int64, shape (MAX_PENDING_BLOCKS, p)
        Pairs of solids not proven apart in the whole block.
    counts : ndarray of int64, shape (MAX_PENDING_BLOCKS,)
        Number of these pairs.
    open_pairs : ndarray of int64, shape (p,)
        Scratch for the pairs of one block.
    box : JointBox
        Scratch for one box; it keeps the values of the held joints.
    """

    blocks: Ints
    pair_lists: Ints
    counts: Ints
    open_pairs: Ints
    box: JointBox


def make_pending(block: Ints, cells: JointCells, pairs: int) -> PendingBlocks:
    """Return a stack with one block and all pairs open.

    The block has shape (6,).
    """
    blocks, counts = np.empty((MAX_PENDING_BLOCKS, 6), dtype=np.int64), np.empty(MAX_PENDING_BLOCKS, dtype=np.int64)
    pair_lists, open_pairs = np.empty((MAX_PENDING_BLOCKS, pairs), dtype=np.int64), np.empty(pairs, dtype=np.int64)
    blocks[0], pair_lists[0], counts[0] = block, np.arange(pairs), pairs
    return PendingBlocks(
        blocks, pair_lists, counts, open_pairs, JointBox(cells.held.copy(), np.zeros(len(cells.held)), 0.0)
    )


class InnerScene(NamedTuple):
    """Inner shapes of solids, and balls inside them, to prove BLOCKED."""

    scene: Scene
    balls: InnerBalls


@kernel
def classify_block(
    scene: Scene, inside: InnerScene, cells: JointCells, rest: PendingBlocks, states: States, scratch: SceneScratch
) -> None:
    """Write the states of the cells of the first pending block."""
    blocks, pair_lists, counts, open_pairs, empty = rest
    top = 1
    while top > 0:
        top -= 1
        box = JointBox(empty.center, empty.halves, center_box(cells, scene, blocks[top], empty))
        forward_kinematics(scene.chain, box.center, box.center, 0.0, scratch.poses)
        count = 0
        for n in range(counts[top]):
            pair = pair_lists[top, n]
            # While the boundaries stay apart, containment is the same in the whole box.
            if may_touch(scene, pair, box, scratch) or is_nested(scene, pair, scratch, -1.0):
                open_pairs[count] = pair
                count += 1
        if count == 0:
            write_block(states, blocks[top], FREE)
        elif is_blocked(inside, open_pairs[:count], box, scratch):
            write_block(states, blocks[top], BLOCKED)
        else:
            axis = longest_axis(cells, blocks[top])
            if axis < 0:
                write_block(states, blocks[top], MIXED)
                continue
            cut = (blocks[top, axis] + blocks[top, axis + 3]) // 2
            for n in range(6):
                blocks[top + 1, n] = blocks[top, n]
            blocks[top, axis + 3] = blocks[top + 1, axis] = cut
            for n in range(count):
                pair_lists[top, n] = pair_lists[top + 1, n] = open_pairs[n]
            counts[top] = counts[top + 1] = count
            top += 2


@kernel
def write_block(states: States, block: Ints, state: int) -> None:
    """Set the state of all cells of a block."""
    for i in range(block[0], block[3]):
        for j in range(block[1], block[4]):
            for k in range(block[2], block[5]):
                states[i, j, k] = state


@kernel
def may_touch(scene: Scene, pair: int, box: JointBox, scratch: SceneScratch) -> bool:
    """Return False if two boundaries are proven apart in a box.

    The proof compares their distance at the center with the largest displacement in the box.
    """
    solids = scene.solids
    i, j = scene.pairs[pair]
    slide, angle = displacement_bounds(scene, solids.bodies[i], solids.bodies[j], box, scratch)
    moved = (slide + angle * solids.levers[i]) / ADVANCE_FACTOR
    return pair_slack(scene, pair, (0.0, moved, moved), box.required, 0.0, scratch) < 0.0


@kernel
def displacement_bounds(scene: Scene, a: int, b: int, box: JointBox, scratch: SceneScratch) -> tuple[float, float]:
    """Return bounds of the relative motion of two bodies.

    They hold for body a, as seen from body b, in a whole box of joint values. Returns the translation of its origin and
    its rotation. A joint translates the origin by at most its travel times the distance from its axis. That distance is
    at most its value at the center plus the part that the other joints between can add, and never more than the lengths
    between.
    """
    chain, poses, moving, lengths = scene.chain, scratch.poses, scene.chain.between[a, b], scene.chain.lengths[a]
    origin = column(poses[a], 3)
    slide = angle = drift = 0.0
    for j in range(1, len(moving)):
        if moving[j]:
            travel = abs(chain.factors[j]) * box.halves[chain.joint_indices[j]]
            drift += travel * (lengths[j] if chain.kinds[j] == REVOLUTE else 1.0)
    for j in range(1, len(moving)):
        travel = abs(chain.factors[j]) * box.halves[chain.joint_indices[j]]
        if not moving[j] or travel == 0.0:
            continue
        if chain.kinds[j] == REVOLUTE:
            joint = poses[j]
            axis = rotate(pose_rotation(joint), row_at(chain.axes[j], 0))
            off = cross(axis, minus(origin, column(joint, 3)))
            now = math.sqrt(dot(off, off)) + box.required
            slide += travel * min(lengths[j], now + drift - travel * lengths[j])
            angle += travel
        elif chain.kinds[j] == PRISMATIC:
            slide += travel
    return slide, angle


@kernel
def center_box(cells: JointCells, scene: Scene, block: Ints, box: JointBox) -> float:
    """Set a box to a block of cells.

    It includes the rounding of queries. Returns the required distance.
    """
    for axis in range(3):
        number = cells.joint_indices[axis]
        if number >= 0:
            box.center[number] = cells.lower[axis] + 0.5 * cells.spacing * (block[axis] + block[axis + 3])
            box.halves[number] = cells.spacing * (0.5 * (block[axis + 3] - block[axis]) + SLACK)
    return required_distance(scene, box.center, box.center)


@kernel
def longest_axis(cells: JointCells, block: Ints) -> int:
    """Return the axis along which a block moves the arm farthest.

    The result is -1 for a single cell.
    """
    chosen, farthest = -1, 0.0
    for axis in range(3):
        count = block[axis + 3] - block[axis]
        if count > 1 and count * cells.levers[axis] > farthest:
            chosen, farthest = axis, count * cells.levers[axis]
    return chosen


@kernel
def is_blocked(inside: InnerScene, pairs: Ints, box: JointBox, scratch: SceneScratch) -> bool:
    """Return True if a pair provably collides in a whole box."""
    for pair in pairs:
        i, j = inside.scene.pairs[pair]
        if ball_collides(inside, i, j, box, scratch) or ball_collides(inside, j, i, box, scratch):
            return True
    return False


@kernel
def ball_collides(inside: InnerScene, i: int, j: int, box: JointBox, scratch: SceneScratch) -> bool:
    """Return True if a ball in solid i provably meets solid j.

    The proof holds in the whole box.
    """
    scene, balls, solids = inside.scene, inside.balls, inside.scene.solids
    slide, angle = displacement_bounds(scene, solids.bodies[i], solids.bodies[j], box, scratch)
    matrix, shift = relative_pose(scratch.poses[solids.bodies[i]], scratch.poses[solids.bodies[j]])
    for n in range(balls.starts[i], balls.starts[i + 1]):
        rest = balls.radii[n] - (slide + angle * balls.levers[n] + box.required)
        if rest + balls.deepest[j] <= 0.0:
            continue
        x, y, z = point = apply_pose(matrix, shift, row_at(balls.centers[n], 0))
        if solids.has_solids[j] and reaches_piece(solids, j, point, rest, scratch):
            return True
        for surface in range(solids.starts[j, 0], solids.starts[j + 1, 0]):
            whole = solids.boxes[surface]
            # A point is no deeper in a surface than in its box, which decides for most balls.
            if min(x - whole[0], whole[3] - x) + rest <= 0.0 or min(y - whole[1], whole[4] - y) + rest <= 0.0:
                continue
            if min(z - whole[2], whole[5] - z) + rest <= 0.0:
                continue
            low, high = bound_depth(inside, surface, 1, point)
            if low + rest <= 0.0 < high + rest:
                low, high = bound_depth(inside, surface, LATTICE_REFINEMENT, point)
            if low + rest > 0.0 or (high + rest > 0.0 and surface_depth(solids, surface, x, y, z) + rest > 0.0):
                return True
    return False


@kernel
def reaches_piece(solids: Solids, j: int, point: Row, rest: float, scratch: SceneScratch) -> bool:
    """Return True if a point is near a box or ball.

    A negative ``rest`` requires that the point lies deeper than that in the box or ball.
    """
    trees, nodes, near, (x, y, z) = solids.trees, scratch.nodes, max(rest, 0.0), point
    for part in range(solids.starts[j, 2], solids.starts[j + 1, 2]):
        nodes[1, 0], top = solids.tree_roots[part], 2 if solids.tree_roots[part] >= 0 else 1
        while top > 1:
            top -= 1
            b = nodes[top, 0]
            box, (row, m) = trees.boxes[b], trees.spans[b]
            if abs(x - box[0]) > near + box[3] or abs(y - box[1]) > near + box[4] or abs(z - box[2]) > near + box[5]:
                continue
            if m == 1:
                if piece_depth(trees.triangles[row], point) + rest > 0.0:
                    return True
                continue
            nodes[top, 0], nodes[top + 1, 0] = b + 1, b + 2 * (m // 2)
            top += 2
    return False


@kernel
def piece_depth(row: Floats, point: Row) -> float:
    """Return the depth of a point in a box or ball.

    It is negative outside and for other rows.
    """
    if row[9] >= 0.0:
        away = minus(point, (row[0], row[1], row[2]))
        return row[9] - math.sqrt(dot(away, away)) if row[9] > 0.0 else -np.inf
    away, one, other, third = read_box(row, point)
    depth, square = np.inf, 0.0
    for axis in (one, other, third):
        half = math.sqrt(dot(axis, axis))
        inward = half - abs(dot(away, axis)) / half
        depth = min(depth, inward)
        square += min(inward, 0.0) ** 2
    return -math.sqrt(square) if square > 0.0 else depth


@kernel
def bound_depth(inside: InnerScene, surface: int, parts: int, point: Row) -> tuple[float, float]:
    """Bound the depth of a point near a closed surface.

    The lower bound is exact, the upper bound approximate. Negative depths are outside. The depth changes no faster than
    the distance, so the nearest lattice point bounds it. Points of the refined lattice, with ``parts`` points per step,
    are computed at need and cached.
    """
    balls, solids, number, distance = inside.balls, inside.scene.solids, 0, 0.0
    box, known, near = solids.boxes[surface], balls.depth if parts == 1 else balls.fine_depth, (0.0, 0.0, 0.0)
    for axis in range(3):
        step, count = balls.steps[surface, axis] / parts, balls.shapes[surface, axis] * parts
        cell = min(max(math.floor((point[axis] - box[axis]) / step), 0), count - 1)
        near = replaced(near, axis, box[axis] + (cell + 0.5) * step)
        distance += (point[axis] - near[axis]) ** 2
        number = number * count + int(cell)
    number += balls.depth_starts[surface] * parts**3
    depth, distance = known[number], math.sqrt(distance)
    if depth == 0.0:
        # Threads that compute it at the same time store the same value.
        depth = known[number] = surface_depth(solids, surface, near[0], near[1], near[2])
    return depth - distance, depth + distance


@kernel
def surface_depth(solids: Solids, surface: int, x: float, y: float, z: float) -> float:
    """Bound the depth of a point in a surface from below.

    It is negative outside.
    """
    box, winding, nearest = solids.boxes[surface], 0, np.inf
    for t in range(solids.surface_spans[surface, 0], solids.surface_spans[surface, 1]):
        winding += signed_crossing(solids.triangles[t], x, y, z) * solids.windings[t]
        nearest = min(nearest, point_triangle((x, y, z), solids.triangles[t]))
    # Outside, the distance must not be too small, but the distance from thin triangles may be.
    return nearest if winding != 0 else -nearest - THIN * (box[3] - box[0] + box[4] - box[1] + box[5] - box[2])


@kernel
def surface_depths(solids: Solids, surface: int, points: Floats, out: Floats) -> None:
    """Compute the depths of points, shape (n, 3), in a surface."""
    for n in range(len(points)):
        out[n] = surface_depth(solids, surface, points[n, 0], points[n, 1], points[n, 2])

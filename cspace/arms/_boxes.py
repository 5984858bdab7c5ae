"""Compiled proofs about boxes of configurations, in which each joint varies within an interval.

*FREE.* The straight motion from the center of a box to any configuration in it moves each joint by
at most half its interval. So the bounds of such a motion (:mod:`cspace.arms._chain`) hold for the
whole box: if two solids are farther apart at the center than one can move against the other, they
touch nowhere in the box.

*BLOCKED.* A ball inside one solid moves by at most the same bound. If the ball is shrunk by the
bound, the remaining ball, where it is, lies in the solid at every configuration of the box. If the
other solid meets the remaining ball, both collide in the whole box. If nothing remains, the center
of the ball must lie in the other solid deeper than the missing radius.

*Blocks.* All cells are tested together first. A pair of solids that is proven apart is not tested
again. If pairs are left, the block is halved along the joint that moves the arm farthest, down to
single cells, which are then MIXED. So the work grows with the boundary of the C-obstacle, not with
the number of cells.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._bodies import ADVANCE_FACTOR
from cspace._bodies.triangle_proofs import (
    AXIS_POINT,
    CENTER,
    CHORD,
    DIRECTION,
    HALF_SIDES,
    TRANSLATION,
    boxes_are_apart,
    joint_displacement,
    piece_depth,
)
from cspace._grid import SLACK
from cspace._support.arrays import BLOCKED, FREE, MIXED, Floats, Ints, Row, States
from cspace._support.compiling import internal, kernel
from cspace._support.vectors import apply_pose, minus, rotate, rotate_back, row_at
from cspace.arms._chain import (
    FIXED,
    POSITION,
    REVOLUTE,
    Chain,
    column_at,
    forward_kinematics,
    relative_pose,
    rotation_rows,
)
from cspace.arms._motion_proofs import (
    FIRST_PART,
    FIRST_SURFACE,
    NO_MOTION,
    PIECE_STACK,
    ArmScene,
    SceneScratch,
    Solids,
    bound_slack,
    boundaries_cross,
    find_required_distance,
    is_nested,
    lies_deep,
    push_children,
)

MAX_PENDING_BLOCKS: Final = 128
"""Capacity of the stack of blocks: one for each halving of three axes of 2^31 cells and their
parts, and some spare."""


class JointCells(NamedTuple):
    """Map cells as configurations of the arm.

    Attributes
    ----------
    lower : ndarray of float64, shape (3,)
        Start of the first cell along three axes; a map of two joints has one cell along the first
        axis.
    spacing : float
    joint_indices : ndarray of int64, shape (3,)
        Index of the joint of each axis; -1 for the added axis.
    held : ndarray of float64, shape (dof,)
        Values of the other joints.
    levers : ndarray of float64, shape (3,)
        Approximate motion of the arm per unit of each axis.
    parts : int
        Parts into which each side of a cell is divided at most, to prove it; a power of two.
    """

    lower: Floats
    spacing: float
    joint_indices: Ints
    held: Floats
    levers: Floats
    parts: int


class InnerBalls(NamedTuple):
    """Balls inside solids.

    Attributes
    ----------
    centers : ndarray of float64, shape (n, 3)
        Centers of the balls, in the frame of the solid's body.
    radii : ndarray of float64, shape (n,)
    starts : ndarray of int64, shape (s + 1,)
        First ball of each solid.
    """

    centers: Floats
    radii: Floats
    starts: Ints


class PendingBlocks(NamedTuple):
    """Stack of blocks of cells whose states are unknown.

    Attributes
    ----------
    blocks : ndarray of int64, shape (MAX_PENDING_BLOCKS, 6)
        Start and stop along three axes, in parts of a cell.
    pair_lists : ndarray of int64, shape (MAX_PENDING_BLOCKS, p)
        Pairs of solids not proven apart in the whole block.
    counts : ndarray of int64, shape (MAX_PENDING_BLOCKS,)
        Number of these pairs.
    center, halves : ndarray of float64, shape (dof,)
        Scratch for one box of configurations; the center keeps the values of the held joints.
    """

    blocks: Ints
    pair_lists: Ints
    counts: Ints
    center: Floats
    halves: Floats


def make_pending(block: Ints, cells: JointCells, pairs: int) -> PendingBlocks:
    """Make a stack of one block, all pairs open.

    The block has shape (6,), in cells.
    """
    blocks = np.empty((MAX_PENDING_BLOCKS, 6), dtype=np.int64)
    counts = np.empty(MAX_PENDING_BLOCKS, dtype=np.int64)
    pair_lists = np.empty((MAX_PENDING_BLOCKS, pairs), dtype=np.int64)
    blocks[0] = block * cells.parts
    pair_lists[0] = np.arange(pairs)
    counts[0] = pairs
    return PendingBlocks(blocks, pair_lists, counts, cells.held.copy(), np.zeros(len(cells.held)))


class InnerScene(NamedTuple):
    """Inner shapes of solids, and balls inside them, to prove BLOCKED."""

    scene: ArmScene
    balls: InnerBalls


class CellStates(NamedTuple):
    """States of cells along three axes, and why they are MIXED.

    Attributes
    ----------
    states : ndarray of uint8, shape (nx, ny, nz)
    deciding_pairs : ndarray of int16, shape (nx, ny, nz)
        A pair that keeps the cell MIXED; -1 for other cells.
    """

    states: States
    deciding_pairs: NDArray[np.int16]


@kernel
def classify_block(
    scene: ArmScene,
    inside: InnerScene,
    cells: JointCells,
    pending: PendingBlocks,
    pair_numbers: Ints,
    out: CellStates,
    scratch: SceneScratch,
) -> None:
    """Write the states of the cells of the first pending block.

    A block is proven as a whole, or halved down to single cells. ``pair_numbers``, shape (p,), has
    the numbers that are written for the scene's pairs.
    """
    # Rows of the stack below `top` are filled.
    top = 1
    while top > 0:
        top -= 1
        state, pair = prove_block(scene, inside, cells, pending, top, scratch)
        if state == MIXED:
            if halve_block(cells, pending, top, cells.parts):
                top += 2
                continue
            # A single cell may still be proven by its parts.
            state, pair = refine_cell(scene, inside, cells, pending, top, scratch)
        deciding_pair = pair_numbers[pair] if state == MIXED else -1
        # A block has its starts along three axes, then its stops, in parts of a cell.
        block = pending.blocks[top]
        parts = cells.parts
        for i in range(block[0] // parts, block[3] // parts):
            for j in range(block[1] // parts, block[4] // parts):
                for k in range(block[2] // parts, block[5] // parts):
                    out.states[i, j, k] = state
                    out.deciding_pairs[i, j, k] = deciding_pair


@internal
def prove_block(
    scene: ArmScene,
    inside: InnerScene,
    cells: JointCells,
    pending: PendingBlocks,
    row: int,
    scratch: SceneScratch,
) -> tuple[int, int]:
    """Prove a pending block; return FREE, BLOCKED, or MIXED if unproven.

    Also returns a pair that proves BLOCKED, or that is open, or -1. Pairs whose boundaries are
    farther apart at the center than they move in the block are dropped from its list.
    """
    is_smallest = set_box(cells, pending, row)
    forward_kinematics(scene.chain, pending.center, pending.center, 0.0, scratch.poses)
    required = find_required_distance(scene, pending.center, pending.center)
    bodies = scene.solids.bodies
    # Open pairs move to the front of the block's list.
    still_open = 0
    for n in range(pending.counts[row]):
        pair = pending.pair_lists[row, n]
        i, j = scene.pairs[pair]
        count = write_axes(scene.chain, bodies[i], bodies[j], pending.halves, required, scratch)
        axes = scratch.axes[:count]
        scratch.directions[pair, :] = 0.0  # the state may not depend on earlier blocks
        slack = bound_slack(scene, pair, NO_MOTION, axes, required, 0.0, scratch)
        # While the boundaries stay apart, containment is the same in the whole box.
        if slack < 0.0 or is_nested(scene, pair, scratch, 0.0):
            pending.pair_lists[row, still_open] = pair
            still_open += 1
    pending.counts[row] = still_open
    if still_open == 0:
        return FREE, -1
    # Only small boxes leave triangles crossed, and the search for crossings is slow.
    blocking_pair = find_blocked_pair(inside, pending, row, is_smallest, scratch)
    if blocking_pair >= 0:
        return BLOCKED, blocking_pair
    return MIXED, pending.pair_lists[row, 0]


@internal
def set_box(cells: JointCells, pending: PendingBlocks, row: int) -> bool:
    """Write a pending block's center and half sides (dof,).

    Returns True if the block is the smallest part of a cell that is divided.
    """
    # Starts along three axes, then stops, in parts of a cell.
    block = pending.blocks[row]
    half_part = 0.5 * cells.spacing / cells.parts
    is_smallest = cells.parts > 1
    for axis in range(3):
        index = cells.joint_indices[axis]
        if index < 0:
            continue
        start = block[axis]
        stop = block[axis + 3]
        pending.center[index] = cells.lower[axis] + half_part * (start + stop)
        # The box includes the rounding of queries.
        pending.halves[index] = half_part * (stop - start) + cells.spacing * SLACK
        is_smallest = is_smallest and stop - start == 1
    return is_smallest


@internal
def refine_cell(
    scene: ArmScene,
    inside: InnerScene,
    cells: JointCells,
    pending: PendingBlocks,
    base: int,
    scratch: SceneScratch,
) -> tuple[int, int]:
    """Prove a cell by its parts; return state and MIXED pair.

    The cell is the pending block ``base``, and nothing is proven of it as a whole. It is FREE or
    BLOCKED if all parts are.
    """
    has_free = False
    blocking_pair = -1
    # Parts of the cell are pending in the rows from `bottom` on; the cell itself stays below.
    bottom = base + 1
    copy_block(pending, base, bottom)
    if not halve_block(cells, pending, bottom, 1):
        return MIXED, pending.pair_lists[base, 0]
    top = bottom + 2
    while top > bottom:
        top -= 1
        state, pair = prove_block(scene, inside, cells, pending, top, scratch)
        if state == FREE:
            has_free = True
        elif state == BLOCKED:
            blocking_pair = pair
        elif halve_block(cells, pending, top, 1):
            top += 2
        else:
            return MIXED, blocking_pair if blocking_pair >= 0 else pair
        # A cell with a FREE and a BLOCKED part is neither.
        if has_free and blocking_pair >= 0:
            return MIXED, blocking_pair
    return (FREE if has_free else BLOCKED), -1


@internal
def copy_block(pending: PendingBlocks, row: int, target: int) -> None:
    """Copy a pending block with its open pairs to the row ``target``."""
    for n in range(6):
        pending.blocks[target, n] = pending.blocks[row, n]
    for n in range(pending.counts[row]):
        pending.pair_lists[target, n] = pending.pair_lists[row, n]
    pending.counts[target] = pending.counts[row]


@internal
def halve_block(cells: JointCells, pending: PendingBlocks, row: int, parts: int) -> bool:
    """Replace a pending block by its halves; return True.

    The cut is across the axis along which the block moves the arm farthest. Whole multiples of
    ``parts`` stay together; returns False if no axis has more.
    """
    # Starts along three axes, then stops, in parts of a cell.
    block = pending.blocks[row]
    cut_axis = -1
    farthest = 0.0
    for axis in range(3):
        count = block[axis + 3] - block[axis]
        travel = count * cells.levers[axis]
        if count > parts and cells.joint_indices[axis] >= 0 and travel > farthest:
            cut_axis = axis
            farthest = travel
    if cut_axis < 0:
        return False
    middle = (block[cut_axis] + block[cut_axis + 3]) // 2
    whole_middle = middle // parts * parts
    # The copy becomes the upper half, and the block itself the lower one.
    copy_block(pending, row, row + 1)
    block[cut_axis + 3] = whole_middle
    pending.blocks[row + 1, cut_axis] = whole_middle
    return True


@internal
def write_axes(
    chain: Chain, a: int, b: int, halves: Floats, required: float, scratch: SceneScratch
) -> int:
    """Write axes of joints between bodies a and b in a box.

    ``halves``, shape (dof,), are the half sides of the box of configurations. Returns the number of
    rows written to ``scratch.axes``. They are those of
    :func:`cspace._bodies.triangle_proofs.joint_displacement`, in the frame of b, and include the
    rounding of points, ``required``.
    """
    between = chain.between[a, b]
    base_pose = scratch.poses[b]
    base_rotation = rotation_rows(base_pose)
    count = 0
    for j in range(1, len(between)):
        travel = abs(chain.factors[j]) * halves[chain.joint_indices[j]] / ADVANCE_FACTOR
        if not between[j] or travel == 0.0 or chain.kinds[j] == FIXED:
            continue
        # The axis passes through the origin of the joint's body.
        joint_pose = scratch.poses[j]
        world_axis = rotate(rotation_rows(joint_pose), row_at(chain.axes[j], 0))
        axis = rotate_back(base_rotation, world_axis)
        offset = minus(column_at(joint_pose, POSITION), column_at(base_pose, POSITION))
        origin = rotate_back(base_rotation, offset)
        row = scratch.axes[count]
        for k in range(3):
            row[DIRECTION + k] = axis[k]
            row[AXIS_POINT + k] = origin[k]
        if chain.kinds[j] == REVOLUTE:
            # A turn moves a point at distance 1 by the chord of its angle.
            chord = 2.0 * math.sin(0.5 * min(travel, math.pi)) / ADVANCE_FACTOR
            row[CHORD] = chord
            row[TRANSLATION] = chord * required
        else:
            row[CHORD] = 0.0
            row[TRANSLATION] = travel
        count += 1
    return count


@internal
def find_blocked_pair(
    inside: InnerScene,
    pending: PendingBlocks,
    row: int,
    with_crossings: bool,
    scratch: SceneScratch,
) -> int:
    """Return an open pair that collides in the whole block, or -1.

    The poses of ``scratch`` must be those of the block's center, and its half sides those of
    ``pending``. Triangles that cross are sought only ``with_crossings``.
    """
    scene = inside.scene
    bodies = scene.solids.bodies
    required = find_required_distance(scene, pending.center, pending.center)
    for n in range(pending.counts[row]):
        pair = pending.pair_lists[row, n]
        i, j = scene.pairs[pair]
        # First a ball in solid j, as seen from solid i, then one in solid i.
        count = write_axes(scene.chain, bodies[j], bodies[i], pending.halves, required, scratch)
        if ball_collides(inside, j, i, scratch.axes[:count], required, scratch):
            return int(pair)
        count = write_axes(scene.chain, bodies[i], bodies[j], pending.halves, required, scratch)
        axes = scratch.axes[:count]
        if ball_collides(inside, i, j, axes, required, scratch):
            return int(pair)
        if with_crossings and boundaries_cross(scene, pair, axes, required, scratch):
            return int(pair)
    return -1


@internal
def ball_collides(
    inside: InnerScene, i: int, j: int, axes: Floats, required: float, scratch: SceneScratch
) -> bool:
    """Return True if a ball in solid i provably meets solid j.

    The proof holds in a whole box of configurations, in which ``axes``, shape (k, 8), move solid i
    as seen from solid j.
    """
    balls = inside.balls
    solids = inside.scene.solids
    starts = solids.starts
    matrix, shift = relative_pose(scratch.poses[solids.bodies[i]], scratch.poses[solids.bodies[j]])
    for n in range(balls.starts[i], balls.starts[i + 1]):
        point = apply_pose(matrix, shift, row_at(balls.centers[n], 0))
        displacement = joint_displacement(axes, point, 0.0) + required
        # A ball of this radius stays in solid i; if negative, the center must lie that deep in j.
        rest = balls.radii[n] - displacement
        if solids.has_solids[j] and reaches_piece(solids, j, point, rest, scratch):
            return True
        for surface in range(starts[j, FIRST_SURFACE], starts[j + 1, FIRST_SURFACE]):
            root = solids.surface_roots[surface]
            surface_box = solids.surfaces.boxes[root]
            offset = minus(point, row_at(surface_box, CENTER))
            # A point is no deeper in a surface than in its box, which decides for most balls.
            if boxes_are_apart(offset, (rest, rest, rest), row_at(surface_box, HALF_SIDES)):
                continue
            if lies_deep(solids.surfaces, root, point, -rest, scratch.nodes):
                return True
    return False


@internal
def reaches_piece(solids: Solids, j: int, point: Row, rest: float, scratch: SceneScratch) -> bool:
    """Return True if a point is within ``rest`` of solid j's piece.

    A negative ``rest`` requires that the point lies deeper than that in the box or ball.
    """
    trees = solids.trees
    starts = solids.starts
    nodes = scratch.nodes
    reach = max(rest, 0.0)
    for part in range(starts[j, FIRST_PART], starts[j + 1, FIRST_PART]):
        # Rows of the stack from 1 to top - 1 are filled; an empty part has no root.
        nodes[1, PIECE_STACK] = solids.tree_roots[part]
        top = 2 if solids.tree_roots[part] >= 0 else 1
        while top > 1:
            top -= 1
            node = nodes[top, PIECE_STACK]
            box = trees.boxes[node]
            row, count = trees.spans[node]
            offset = minus(point, row_at(box, CENTER))
            if boxes_are_apart(offset, (reach, reach, reach), row_at(box, HALF_SIDES)):
                continue
            if count > 1:
                top = push_children(nodes, PIECE_STACK, top, node, count)
            elif piece_depth(trees.triangles[row], point) + rest > 0.0:
                return True
    return False

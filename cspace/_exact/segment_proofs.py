"""Compiled proofs that the segments of a moving robot in the plane stay apart from fixed segments.

The plane lies in space at z = 0. A segment is a triangle that repeats a corner; a ball repeats one
corner twice and has a radius.

*Bound.* For any vector n, the distance of two segments is at least the gap between their
projections onto a line along n::

    distance >= min n.(b_j - a_0) / |n| - max n.(a_i - a_0) / |n|        over their corners a_i and
    b_j

If the motion along n is smaller than that gap, the segments stay apart. The bound holds for every
n, so n may come from inexact geometry. With the shortest vector between the segments as n, it is
nearly sharp.

*Rounding.* Let u = 2^-53, and let D be the largest distance of any corner from a_0. Each ``n.(x -
a_0)`` is wrong by at most 4 u |n| D (a difference, a product, two sums), and the length of n by 4 u
of itself. The difference, the quotient and the radii add three roundings of numbers up to D or the
radii. The total is below 2^-48 times the sum of D and the radii. Lengths are multiplied by a power
of two that brings the coordinates to about one, and |n| is at least 2^-300, so underflow is far
below that. The allowance :data:`cspace._bodies.DISTANCE_ROUNDING` is more than fifty times the
total, including the placing of the corners.

If segments are nearly parallel, rounding loses the shortest vector. Distances below 1e-7 of their
lengths may then count as zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cspace._bodies.box_trees import (
    FIRST_ITEM,
    ITEM_COUNT,
    join_trees,
    push_halves,
)
from cspace._bodies.part_trees import (
    CENTER,
    HALF_SIDES,
    LEVER,
    NO_TREE,
    RADIUS,
    PartTree,
    build_tree,
    pack_triangles,
)
from cspace._shapes import RoundedSimplices
from cspace._support.arrays import Floats, Ints, Row
from cspace._support.compiling import internal, kernel
from cspace._support.vectors import (
    Matrix,
    apply_pose,
    box_extent,
    boxes_are_apart,
    dot,
    gap_between,
    minus,
    rotate,
    row_at,
)

MIN_SQUARED_LENGTH = 2.0**-600
"""Squared length of the shortest vector used as a projection axis."""


class Motion(NamedTuple):
    """Pose and motion of the robot.

    Attributes
    ----------
    matrix : tuple of tuple of float
        Rows of the rotation matrix.
    position : tuple of float
        Reference point.
    step : tuple of float
        Largest translation, in either direction.
    angle : float
        Largest rotation about the reference point, in either direction, radians.
    required : float
        Distance that proves the robot free.
    drift : float
        Largest additional translation, in any direction.
    """

    matrix: Matrix
    position: Row
    step: Row
    angle: float
    required: float
    drift: float


def build_trees(borders: Sequence[RoundedSimplices], about_z: bool) -> tuple[PartTree, list[int]]:
    """Build a tree for each set of segments, in one record.

    Also returns the root of each tree, -1 if it is empty. Levers are distances from the z axis if
    ``about_z``, else from the origin.
    """
    dims_across_axis = 2 if about_z else 3
    trees = [
        build_tree(
            pack_triangles(border),
            np.linalg.norm(border.simplices[..., :dims_across_axis], axis=-1).max(axis=1),
        )
        for border in borders
    ]
    joined, roots = join_trees(trees, NO_TREE)
    return joined, roots.tolist()


@kernel
def free_fraction(
    trees: PartTree, robot: int, others: tuple[int, int], motion: Motion, enough: float, nodes: Ints
) -> float:
    """Return the fraction of a motion proven free.

    The fraction is at most ``enough``. Robot and others are given by the roots of their trees, -1
    for none. The result is negative if the robot is too near at its current pose. ``nodes``, shape
    (MAX_PENDING_PAIRS, 2), is a stack of pairs of a robot's node and another node. It keeps in its
    first row the pair of segments that set the last bound, because the same pair often sets the
    next one; -1 means none.
    """
    best = float(enough)
    # Begin with the pairs of roots, and on top of them the pair of the last bound.
    top = 1
    for other in others:
        if other >= 0:
            nodes[top, 0] = robot
            nodes[top, 1] = other
            top += 1
    if nodes[0, 0] >= 0:
        nodes[top, 0] = nodes[0, 0]
        nodes[top, 1] = nodes[0, 1]
        top += 1
    while best >= 0.0:
        top = find_close_leaves(trees, motion, best, nodes, top)
        if top == 0:
            break
        a, b = nodes[top, 0], nodes[top, 1]
        a_row = trees.triangles[trees.spans[a, FIRST_ITEM]]
        b_row = trees.triangles[trees.spans[b, FIRST_ITEM]]
        # The robot's segment turns by at most its lever times the angle.
        drift = trees.boxes[a, LEVER] * motion.angle + motion.drift
        fraction = pair_free_fraction(a_row, b_row, motion, drift, best)
        # Pairs that follow must be apart for a shorter part of the motion only.
        if fraction < best:
            best = fraction
            nodes[0, 0] = a
            nodes[0, 1] = b
    return best


@internal
def find_close_leaves(
    trees: PartTree, motion: Motion, fraction: float, nodes: Ints, top: int
) -> int:
    """Find two leaves that may come too near during a motion.

    Only the given ``fraction`` of the motion counts. ``nodes``, shape (MAX_PENDING_PAIRS, 2), is a
    stack of pairs of nodes, of the moving and of the fixed tree, in the rows from 1 to ``top - 1``.
    Returns the row of the leaves, above the remaining pairs; 0 if there are none.
    """
    step = motion.step
    required = motion.required
    while top > 1:
        top -= 1
        a, b = nodes[top, 0], nodes[top, 1]
        a_box = trees.boxes[a]
        b_box = trees.boxes[b]
        a_center = apply_pose(motion.matrix, motion.position, row_at(a_box, CENTER))
        a_half = box_extent(motion.matrix, row_at(a_box, HALF_SIDES))
        b_half = row_at(b_box, HALF_SIDES)
        # The box that a sweeps, grown by the required distance.
        drift = a_box[LEVER] * motion.angle + motion.drift
        swept_half = (
            a_half[0] + required + fraction * (abs(step[0]) + drift),
            a_half[1] + required + fraction * (abs(step[1]) + drift),
            a_half[2] + required + fraction * (abs(step[2]) + drift),
        )
        if boxes_are_apart(minus(a_center, row_at(b_box, CENTER)), swept_half, b_half):
            continue
        a_count = trees.spans[a, ITEM_COUNT]
        b_count = trees.spans[b, ITEM_COUNT]
        b_size = b_half[0] + b_half[1] + b_half[2]
        if a_count == 1 and b_count == 1:
            return top
        # Split the node with the larger box.
        is_b_larger = b_size > a_half[0] + a_half[1] + a_half[2]
        top = push_halves(nodes, top, a_count, b_count, is_b_larger)
    return 0


@internal
def pair_free_fraction(p: Floats, q: Floats, motion: Motion, drift: float, enough: float) -> float:
    """Return the fraction of a motion with two segments proven apart.

    It is at most ``enough``, and -1 if they are too near at once. The rows p, of the robot, and q,
    shape (10,), hold three corners and a radius. The first also moves by up to ``drift`` in any
    direction.
    """
    # Use the first corner of the robot's segment as the origin, for the smaller rounding.
    first = row_at(p, 0)
    origin = apply_pose(motion.matrix, motion.position, first)
    a = rotate(motion.matrix, minus(row_at(p, 3), first))
    b0, b1 = minus(row_at(q, 0), origin), minus(row_at(q, 3), origin)
    # Any direction gives a lower bound; the shortest vector between the segments gives the best.
    n = gap_between((0.0, 0.0, 0.0), a, b0, minus(b1, b0))
    squared_length = dot(n, n)
    if not MIN_SQUARED_LENGTH < squared_length < math.inf:
        return -1.0
    length = math.sqrt(squared_length)
    # Heights along n; that of the first corner of a is zero.
    a_height, b0_height, b1_height = dot(n, a), dot(n, b0), dot(n, b1)
    gap_above = min(b0_height, b1_height) - max(a_height, 0.0)
    gap_below = min(a_height, 0.0) - max(b0_height, b1_height)
    required = motion.required + p[RADIUS] + q[RADIUS]
    slack: float = max(gap_above, gap_below) / length - required
    if not slack > 0.0:
        return -1.0
    return min(slack / (abs(dot(n, motion.step)) / length + drift), enough)

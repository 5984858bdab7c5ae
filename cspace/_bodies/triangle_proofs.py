"""Compiled proofs that the triangles of a moving robot stay apart from fixed triangles and boxes.

A ball is a triangle with three equal corners and a radius; a segment repeats one corner. Fixed
trees may also contain boxes, which are solid.

*Bound.* For any vector n, the distance of two triangles is at least the gap between their
projections onto a line along n::

    distance >= min n.(b_j - a_0) / |n| - max n.(a_i - a_0) / |n|        over their corners a_i and
    b_j

If the motion along n is smaller than that gap, the triangles stay apart. The bound holds for every
n, so n may come from inexact geometry, also of degenerate triangles. Candidates for n are the
normals of the faces, the vector between the nearest points of two edges, and the normal of both
edges. One of them is along the shortest vector between the triangles, so that the bound is nearly
sharp. For a triangle and a box, alternating projections find the nearest points; the normals of
faces and edges decide the other cases (S. Gottschalk, M. C. Lin and D. Manocha, 1996).

*Rounding.* Let u = 2^-53, and let D be the largest distance of any corner from a_0. Each ``n.(x -
a_0)`` is wrong by at most 4 u |n| D (a difference, a product, two sums), and the length of n by 4 u
of itself. The difference, the quotient and the radii add three roundings of numbers up to D or the
radii. The total is below 2^-48 times the sum of D and the radii. Lengths are multiplied by a power
of two that brings the coordinates to about one, and |n| is at least 2^-300, so underflow is far
below that. The allowance :data:`cspace._bodies.DISTANCE_ROUNDING` is more than fifty times the
total, including the placing of the corners.

If edges are nearly parallel or faces nearly degenerate, rounding loses the shortest vector.
Distances below 1e-7 of the edge lengths may then count as zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeVar

import numpy as np

from cspace._shapes import RoundedSimplices
from cspace._support.arrays import Floats, Ints, Matrix, Row
from cspace._support.compiling import internal, kernel
from cspace._support.vectors import (
    add_scaled,
    apply_pose,
    box_extent,
    cross,
    dot,
    gap_between,
    minus,
    nearest_of_triangle,
    rotate,
    row_at,
    scale_vector,
)

Corners = tuple[Row, Row, Row]
"""Three points of a triangle, or its edge vectors."""

OrientedBox = tuple[Row, Row, Row, Row]
"""Center and half axes of a box."""

MIN_SQUARED_LENGTH = 2.0**-600
"""Squared length of the shortest vector used as a projection axis."""


MAX_PROJECTIONS = 16
"""Alternating projections between a triangle and a box after which no common point is found."""


MAX_PENDING_PAIRS = 128
"""Capacity of the stack of node pairs; a search needs at most the levels of both trees, plus a few.
"""


CENTER, HALF_SIDES, LEVER = 0, 3, 6
"""Columns of a tree's ``boxes`` where the center, the half sides and the longest lever begin."""


FIRST_ITEM, ITEM_COUNT = range(2)
"""Columns of a tree's ``spans``."""


RADIUS = 9
"""Column of :attr:`Trees.triangles` after the three corners."""


DIRECTION, AXIS_POINT, CHORD, TRANSLATION = 0, 3, 6, 7
"""Columns of the ``axes`` of :func:`joint_displacement` where each entry begins."""


class Trees(NamedTuple):
    """Triangles in trees of boxes.

    A node with n triangles has two children: the next node has the first n // 2 of them, and the
    node 2 (n // 2) later the others.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 7)
        Center and half sides of each box, radii included, and the longest lever of its triangles.
    spans : ndarray of int64, shape (m, 2)
        Index of the first triangle of each node, and their number.
    triangles : ndarray of float64, shape (n, 10)
        Three corners and a radius, zero or above. A negative radius marks a box: then the row has
        its center, two half axes, and the negated length of the third.
    """

    boxes: Floats
    spans: Ints
    triangles: Floats


class SurfaceTree(NamedTuple):
    """A tree of the triangles of closed surfaces.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 6)
        Center and half sides of the box of each node.
    spans : ndarray of int64, shape (m, 2)
        First triangle of each node, and their number; children as in :class:`Trees`.
    triangles : ndarray of float64, shape (n, 3, 3)
    windings : ndarray of int64, shape (n,)
        Multiplicity of each triangle.
    """

    boxes: Floats
    spans: Ints
    triangles: Floats
    windings: Ints


AnyTree = TypeVar("AnyTree", Trees, SurfaceTree)

NO_TREE: Final = Trees(np.empty((0, 7)), np.empty((0, 2), dtype=np.int64), np.empty((0, 10)))
"""A tree without triangles."""


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


def build_trees(borders: Sequence[RoundedSimplices], about_z: bool) -> tuple[Trees, list[int]]:
    """Build a tree for each set of triangles, in one record.

    Also returns the root of each tree, -1 if it is empty. Levers are distances from the z axis if
    ``about_z``, else from the origin.
    """
    trees = []
    for border in borders:
        dims_across_axis = 2 if about_z else 3
        corner_levers = np.linalg.norm(border.simplices[..., :dims_across_axis], axis=-1)
        trees.append(build_tree(pack_triangles(border), corner_levers.max(axis=1)))
    joined, roots = join_trees(trees, NO_TREE)
    return joined, roots.tolist()


def build_tree(rows: Floats, levers: Floats) -> Trees:
    """Build a tree of triangles and boxes.

    ``rows``, shape (n, 10), are those of :attr:`Trees.triangles`; ``levers`` has shape (n,).
    """
    low, high = bound_rows(rows)
    boxes, order, spans = build_boxes(low, high)
    longest_levers = node_maxima(levers[order], spans)
    return Trees(np.column_stack([boxes, longest_levers]), spans, rows[order])


def join_trees(trees: Sequence[AnyTree], empty: AnyTree) -> tuple[AnyTree, Ints]:
    """Join trees in one record.

    Returns the record, and the root of each tree in it, -1 if the tree is empty. ``empty`` is a
    tree of the same type without triangles.
    """
    # Spans name triangles by their index, which moves up by the triangles of the trees before.
    shifted = [empty]
    roots = []
    node = 0
    triangle = 0
    for tree in trees:
        roots.append(node if len(tree.boxes) else -1)
        shifted.append(tree._replace(spans=tree.spans + np.array([triangle, 0])))
        node += len(tree.boxes)
        triangle += len(tree.triangles)
    joined = map(np.concatenate, zip(*shifted, strict=True))
    return type(empty)(*joined), np.array(roots, dtype=np.int64)


def pack_triangles(border: RoundedSimplices) -> Floats:
    """Return a boundary's triangles as rows of a tree, shape (n, 10)."""
    return np.hstack([border.simplices.reshape(-1, 9), border.radii[:, None]])


def pack_boxes(lows: Floats, highs: Floats, pose: Floats) -> Floats:
    """Return posed axis-aligned boxes as rows of a tree, shape (n, 10).

    Their lower and upper corners have shapes (n, 3), the pose (4, 4).
    """
    rotation = pose[:3, :3]
    half_x, half_y, half_z = 0.5 * (highs - lows).T
    centers = 0.5 * (lows + highs) @ rotation.T + pose[:3, 3]
    # Two half axes as vectors, and the length of the third, whose minus sign marks a box.
    first = half_x[:, np.newaxis] * rotation[:, 0]
    second = half_y[:, np.newaxis] * rotation[:, 1]
    return np.column_stack([centers, first, second, -half_z])


def half_axes(boxes: Floats) -> Floats:
    """Compute half axes of boxes, shape (n, 3, 3).

    ``boxes``, shape (n, 10), are rows of :attr:`Trees.triangles`.
    """
    first = boxes[:, 3:6]
    second = boxes[:, 6:9]
    # The third is normal to both; only its length is stored, negated.
    third = np.cross(first, second)
    scales = boxes[:, RADIUS] / np.linalg.norm(third, axis=1)
    return np.stack([first, second, scales[:, np.newaxis] * third], axis=1)


def bound_rows(rows: Floats) -> tuple[Floats, Floats]:
    """Return the corners of each row's bounding box, shapes (n, 3).

    ``rows``, shape (n, 10), are those of :attr:`Trees.triangles`.
    """
    corners = rows[:, :9].reshape(-1, 3, 3)
    radii = np.maximum(rows[:, RADIUS], 0.0)[:, np.newaxis]
    low = corners.min(axis=1) - radii
    high = corners.max(axis=1) + radii
    # Rows of boxes have no corners, but a center and half axes.
    is_box = rows[:, RADIUS] < 0.0
    centers = rows[is_box, :3]
    half_sides = np.abs(half_axes(rows[is_box])).sum(axis=1)
    low[is_box] = centers - half_sides
    high[is_box] = centers + half_sides
    return low, high


def build_boxes(low: Floats, high: Floats) -> tuple[Floats, Ints, Ints]:
    """Build the boxes of a tree around items, level by level.

    ``low`` and ``high``, shapes (n, 3), are the corners of the items' boxes. Each level halves the
    items of its nodes along the longest side. Returns the boxes, shape (m, 6), the order of the
    items in the tree, shape (n,), and the first item and number of items of each node, shape (m,
    2).
    """
    number_of_nodes = max(2 * len(low) - 1, 0)
    boxes = np.empty((number_of_nodes, 6))
    spans = np.empty((number_of_nodes, 2), dtype=np.int64)
    order = np.arange(len(low))
    centers = low + high
    # The nodes of a level, one entry each: index, first item and number of items.
    has_root = len(low) > 0
    node = np.zeros(int(has_root), dtype=np.int64)
    start = np.zeros_like(node)
    count = np.full_like(node, len(low))
    while len(node):
        # Write the nodes of this level.
        lower = -_maxima_of_ranges(-low[order], start, start + count)
        upper = _maxima_of_ranges(high[order], start, start + count)
        boxes[node] = np.hstack([0.5 * (lower + upper), 0.5 * (upper - lower)])
        spans[node] = np.column_stack([start, count])
        # Go on with the nodes that have children.
        has_children = count > 1
        longest_axis = (upper - lower).argmax(axis=1)[has_children]
        node = node[has_children]
        start = start[has_children]
        count = count[has_children]
        # Sort the items of each node by their centers along its longest side. For each of these
        # items: its node, and its place in the order.
        owner = np.repeat(np.arange(len(node)), count)
        items_before = np.cumsum(count) - count
        places = np.arange(len(owner)) + (start - items_before)[owner]
        items = order[places]
        keys = centers[items, longest_axis[owner]]
        order[places] = items[np.lexsort((keys, owner))]
        # The first child follows its parent, the second one follows the nodes of the first. A level
        # stays in the order of its items, because reductions also pass through the gaps.
        half = count // 2
        node = np.column_stack([node + 1, node + 2 * half]).ravel()
        start = np.column_stack([start, start + half]).ravel()
        count = np.column_stack([half, count - half]).ravel()
    return boxes, order, spans


def _maxima_of_ranges(rows: Floats, starts: Ints, stops: Ints) -> Floats:
    """Return the maximum of ``rows[starts[i]:stops[i]]`` for each i.

    ``rows`` has shape (n,) or (n, d), the result one entry or row for each i.
    """
    # ``reduceat`` also gives the maxima between a stop and the next start, which are left out.
    bounds = np.stack([starts, stops], axis=1).ravel()
    padded = np.append(rows, rows[:1], axis=0)  # a stop may be the number of rows
    return np.asarray(np.maximum.reduceat(padded, bounds)[::2])


def node_maxima(values: Floats, spans: Ints) -> Floats:
    """Return the largest value, shape (m,), among the items of each node.

    ``values``, shape (n,), are those of the items; ``spans``, shape (m, 2), has the first item of
    each node and their number.
    """
    if not len(spans):
        return np.empty(0)
    starts, counts = spans.T
    return _maxima_of_ranges(values, starts, starts + counts)


@kernel
def free_fraction(
    trees: Trees, robot: int, others: tuple[int, int], motion: Motion, enough: float, nodes: Ints
) -> float:
    """Return the fraction of a motion proven free.

    The fraction is at most ``enough``. Robot and others are given by the roots of their trees, -1
    for none. The result is negative if the robot is too near at its current pose. ``nodes``, shape
    (MAX_PENDING_PAIRS, 2), is a stack of pairs of a robot's node and another node. It keeps in its
    first row the pair of triangles that set the last bound, because the same pair often sets the
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
    no_axes = trees.boxes[:0]
    while best >= 0.0:
        top = find_close_leaves(trees, motion, best, no_axes, nodes, top)
        if top == 0:
            break
        a, b = nodes[top, 0], nodes[top, 1]
        a_row = trees.triangles[trees.spans[a, FIRST_ITEM]]
        b_row = trees.triangles[trees.spans[b, FIRST_ITEM]]
        # The robot's triangle turns by at most its lever times the angle.
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
    trees: Trees, motion: Motion, fraction: float, axes: Floats, nodes: Ints, top: int
) -> int:
    """Find two leaves that may come too near during a motion.

    Only the given ``fraction`` of the motion counts. With the ``axes``, shape (k, 8), of a box of
    configurations, skip nodes that may move past each other there. ``nodes``, shape
    (MAX_PENDING_PAIRS, 2), is a stack of pairs of nodes, of the moving and of the fixed tree, in
    the rows from 1 to ``top - 1``. Returns the row of the leaves, above the remaining pairs; 0 if
    there are none.
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
        a_count, b_count = trees.spans[a, ITEM_COUNT], trees.spans[b, ITEM_COUNT]
        unposed_half = row_at(a_box, HALF_SIDES)
        a_size = math.sqrt(dot(unposed_half, unposed_half))
        b_row = trees.triangles[trees.spans[b, FIRST_ITEM]]
        # An oblique box is much smaller than the box around it.
        reach = a_size + required + fraction * (math.sqrt(dot(step, step)) + drift)
        if b_count == 1 and lies_beside_box(b_row, a_center, reach):
            continue
        b_size = b_half[0] + b_half[1] + b_half[2]
        if len(axes) > 0:
            # Triangles stay crossed only if both are larger than twice the displacement. The
            # negative radius gives the least displacement of any part of the ball.
            radius = a_size if a_count == 1 else -a_size
            moved = joint_displacement(axes, a_center, radius)
            if b_size <= moved or (a_size <= moved and b_row[RADIUS] == 0.0):
                continue
        if a_count == 1 and b_count == 1:
            return top
        # Split the node with the larger box; its second child goes below the first. The first child
        # follows its parent, and the second child follows the nodes of the first.
        nodes[top + 1, 0] = a
        nodes[top + 1, 1] = b
        splits_b = a_count == 1 or (b_count > 1 and b_size > a_half[0] + a_half[1] + a_half[2])
        if splits_b:
            nodes[top, 1] = b + 2 * (b_count // 2)
            nodes[top + 1, 1] = b + 1
        else:
            nodes[top, 0] = a + 2 * (a_count // 2)
            nodes[top + 1, 0] = a + 1
        top += 2
    return 0


@internal
def joint_displacement(axes: Floats, point: Row, radius: float) -> float:
    """Bound how far deviations of joints move the points of a ball.

    The ball has the center ``point``. ``axes``, shape (k, 8), has a row for each joint between the
    ball and the observer: direction and a point of its axis without deviations, its rotation as a
    chord of the unit circle, and a translation. Move the joints one after another, beginning at the
    observer. Each moves the ball and the axes of all later joints together, so the distances of the
    ball from these axes are still those without deviations.
    """
    total = 0.0
    for k in range(len(axes)):
        axis = axes[k]
        # The lever arm is as long as the distance of the ball's center from the axis.
        arm = cross(row_at(axis, DIRECTION), minus(point, row_at(axis, AXIS_POINT)))
        total += axis[CHORD] * (math.sqrt(dot(arm, arm)) + radius) + axis[TRANSLATION]
    return total


@internal
def boxes_are_apart(offset: Row, half: Row, other_half: Row) -> bool:
    """Return True if two axis-aligned boxes are apart.

    ``offset`` leads between their centers; their half sides are ``half`` and ``other_half``.
    """
    largest_gap = 0.0
    for axis in range(3):
        gap = abs(offset[axis]) - (half[axis] + other_half[axis])
        largest_gap = max(largest_gap, gap)
    return largest_gap > 0.0


@internal
def pair_free_fraction(p: Floats, q: Floats, motion: Motion, drift: float, enough: float) -> float:
    """Return the fraction of a motion with two triangles proven apart.

    It is at most ``enough``, and negative if they are too near at once. The rows p, of the robot,
    and q, shape (10,), hold three corners and a radius. The first also moves by up to ``drift`` in
    any direction.
    """
    # Use the first corner of the robot's triangle as the origin, for the smaller rounding.
    first = row_at(p, 0)
    matrix = motion.matrix
    origin = apply_pose(matrix, motion.position, first)
    a1 = rotate(matrix, minus(row_at(p, 3), first))
    a2 = rotate(matrix, minus(row_at(p, 6), first))
    a = (0.0, 0.0, 0.0), a1, a2
    b = minus(row_at(q, 0), origin), minus(row_at(q, 3), origin), minus(row_at(q, 6), origin)
    a_edges, b_edges = edge_vectors(a), edge_vectors(b)
    step = motion.step
    required = motion.required + p[RADIUS] + q[RADIUS]
    # Any direction gives a lower bound, and the best one counts.
    a_normal = cross(a_edges[0], a_edges[1])
    b_normal = cross(b_edges[0], b_edges[1])
    best = free_fraction_along(a_normal, a, b, step, drift, required)
    best = max(best, free_fraction_along(b_normal, a, b, step, drift, required))
    # Try the shortest vector between edges each time that it becomes shorter, and in the end the
    # normal of the nearest edges.
    nearest = math.inf
    edges_normal = b_normal
    for k in range(count_edges(a_edges)):
        for m in range(count_edges(b_edges)):
            if best >= enough:
                return enough
            gap = gap_between(a[k], a_edges[k], b[m], b_edges[m])
            squared_length = dot(gap, gap)
            if squared_length < nearest:
                nearest = squared_length
                edges_normal = cross(a_edges[k], b_edges[m])
                best = max(best, free_fraction_along(gap, a, b, step, drift, required))
    best = max(best, free_fraction_along(edges_normal, a, b, step, drift, required))
    return min(best, enough)


@internal
def count_edges(edges: Corners) -> int:
    """Return the number of distinct edges: 3, or 1 for a segment.

    Segments and points repeat their last corner, so that all edges but the first have no length.
    """
    return 3 if dot(edges[1], edges[1]) > 0.0 else 1


@internal
def edge_vectors(a: Corners) -> Corners:
    """Return the three edge vectors of a triangle."""
    return minus(a[1], a[0]), minus(a[2], a[1]), minus(a[0], a[2])


@internal
def free_fraction_along(
    n: Row, a: Corners, b: Corners, step: Row, drift: float, required: float
) -> float:
    """Return the fraction of a motion with disjoint projections onto n.

    The projections are those of triangles a and b. The result is -1 if they are too near at once,
    or n is too short. Corners are relative to the first corner of a, which moves by ``step``,
    forwards or backwards, and by up to ``drift`` in any direction.
    """
    squared_length = dot(n, n)
    if not MIN_SQUARED_LENGTH < squared_length < math.inf:
        return -1.0
    length = math.sqrt(squared_length)
    # Heights along n; that of the first corner of a is zero.
    a1, a2 = dot(n, a[1]), dot(n, a[2])
    b0, b1, b2 = dot(n, b[0]), dot(n, b[1]), dot(n, b[2])
    gap_above = min(b0, b1, b2) - max(a1, a2, 0.0)
    gap_below = min(a1, a2, 0.0) - max(b0, b1, b2)
    gap = max(gap_above, gap_below)
    slack = gap / length - required
    if not slack > 0.0:
        return -1.0
    return slack / (abs(dot(n, step)) / length + drift)


@internal
def read_box(q: Floats) -> OrientedBox:
    """Return the center and half axes of a box.

    ``q``, shape (10,), is its row of :attr:`Trees.triangles`.
    """
    center, u, v = row_at(q, 0), row_at(q, 3), row_at(q, 6)
    # The third half axis is normal to the others; only its length is stored, negated.
    normal = cross(u, v)
    return center, u, v, scale_vector(normal, q[RADIUS] / math.sqrt(dot(normal, normal)))


@internal
def piece_depth(row: Floats, point: Row) -> float:
    """Return a point's depth in a box or ball, negative outside.

    ``row``, shape (10,), is one of :attr:`Trees.triangles`; the depth in a triangle is -inf.
    """
    radius = float(row[RADIUS])
    from_center = minus(point, row_at(row, 0))
    if radius == 0.0:
        return -np.inf
    if radius > 0.0:
        return radius - math.sqrt(dot(from_center, from_center))
    # In a box, the nearest face counts; outside, the distance from the box.
    _, first, second, third = read_box(row)
    depth = np.inf
    squared_distance = 0.0
    for axis in (first, second, third):
        half = math.sqrt(dot(axis, axis))
        inward = half - abs(dot(from_center, axis)) / half
        depth = min(depth, inward)
        squared_distance += min(inward, 0.0) ** 2
    if squared_distance > 0.0:
        return -math.sqrt(squared_distance)
    return depth


@internal
def lies_beside_box(row: Floats, point: Row, reach: float) -> bool:
    """Return True if a row is a box farther away than ``reach``.

    ``row``, shape (10,), is one of :attr:`Trees.triangles`.
    """
    return row[RADIUS] < 0.0 and piece_depth(row, point) < -reach


@internal
def pierces(corners: Corners, q: Floats, depth: float) -> bool:
    """Return True if a triangle provably pierces a box or ball.

    That is, a point of it lies deeper than ``depth``. ``q``, shape (10,), is the row of the box or
    ball. False proves nothing.
    """
    first = corners[0]
    to_second, to_third = minus(corners[1], first), minus(corners[2], first)
    is_ball = q[RADIUS] > 0.0
    target = row_at(q, 0)  # the center
    scale = 0.5  # of the shrunken box
    for _ in range(MAX_PROJECTIONS):
        from_first = nearest_of_triangle(minus(target, first), to_second, to_third)
        nearest = add_scaled(first, from_first, 1.0)
        if piece_depth(q, nearest) > depth:
            return True
        if is_ball:  # no point of the triangle is nearer to its center
            return False
        # Alternate projections between the triangle and a shrunken box, so that they can end inside
        # the box. The shrunken box grows towards the full box.
        target, first_axis, second_axis, third_axis = read_box(q)
        from_center = minus(nearest, target)
        for axis in (first_axis, second_axis, third_axis):
            coordinate = dot(from_center, axis) / dot(axis, axis)
            target = add_scaled(target, axis, min(max(coordinate, -scale), scale))
        scale = 0.5 + 0.5 * scale
    return False


@kernel
def crosses(a: Corners, b: Corners, tolerance: float, displacement: float) -> bool:
    """Return True if two triangles provably cross.

    An edge of one passes through the interior of the other. Rounding is covered: each corner may be
    off by a quarter of ``tolerance``. They still cross if all points of one triangle move by at
    most ``displacement``.
    """
    for triangle, other in ((a, b), (b, a)):
        for k in range(3):
            # The edge from corner k to the next one.
            p, q = triangle[k], triangle[(k + 1) % 3]
            if not _passes_through(p, q, other, tolerance):
                continue
            if displacement == 0.0 or _keeps_passing_through(p, q, other, displacement + tolerance):
                return True
    return False


@internal
def _passes_through(p: Row, q: Row, b: Corners, tolerance: float) -> bool:
    """Return True if a segment provably passes through triangle b.

    The ends of the segment lie on opposite sides of the plane of b, and its line passes all edges
    of b on the same side.
    """
    side = _side_of_plane(p, b, tolerance)
    if side == 0 or _side_of_plane(q, b, tolerance) != -side:
        return False
    turn = _side_of_plane(p, (q, b[0], b[1]), tolerance)
    return bool(
        turn != 0
        and _side_of_plane(p, (q, b[1], b[2]), tolerance) == turn
        and _side_of_plane(p, (q, b[2], b[0]), tolerance) == turn
    )


@internal
def _keeps_passing_through(p: Row, q: Row, b: Corners, displacement: float) -> bool:
    """Return True if a segment keeps passing through a moving triangle.

    The segment from p to q passes through b. All points of the one or the other move by at most
    ``displacement``. While the ends of the segment do not meet the triangle, and the segment does
    not meet its edges, the number of signed intersections cannot change. So it suffices that these
    distances exceed ``displacement``. Each is bounded by projections onto a line along the nearest
    points.
    """
    # Both ends of the segment must be far from the triangle.
    for end in (p, q):
        u, v, w = minus(b[0], end), minus(b[1], end), minus(b[2], end)
        from_u = nearest_of_triangle(scale_vector(u, -1.0), minus(v, u), minus(w, u))
        n = add_scaled(u, from_u, 1.0)
        gap = min(dot(n, u), dot(n, v), dot(n, w))
        if not gap > displacement * math.sqrt(dot(n, n)):
            return False
    # The segment must be far from the three edges.
    for k in range(3):
        c, d = b[k], b[(k + 1) % 3]
        n = gap_between(p, minus(q, p), c, minus(d, c))
        gap_of_p = min(dot(n, minus(p, c)), dot(n, minus(p, d)))
        gap_of_q = min(dot(n, minus(q, c)), dot(n, minus(q, d)))
        if not min(gap_of_p, gap_of_q) > displacement * math.sqrt(dot(n, n)):
            return False
    return True


@internal
def _side_of_plane(p: Row, corners: Corners, tolerance: float) -> int:
    """Return 1 or -1 for the side of a plane that has p.

    The plane passes through three corners. The result is 0 if rounding could change it. The
    determinant changes by less than ``(s + 2 e)^3 - s^3`` if each point moves by at most e and none
    is farther than s from p. Rounding adds less than ``64 * 2^-52 s^3``.
    """
    u, v, w = minus(corners[0], p), minus(corners[1], p), minus(corners[2], p)
    s = math.sqrt(max(dot(u, u), dot(v, v), dot(w, w)))
    volume = dot(u, cross(v, w))
    error = (2.0 * tolerance + 2.0**-46 * s) * (s + tolerance) * (s + tolerance)
    if volume > error:
        return 1
    if volume < -error:
        return -1
    return 0

"""Trees of the triangles, boxes and balls of a body, and compiled proofs that two bodies touch.

A ball is a triangle with three equal corners and a radius; a segment repeats one corner. Boxes and
balls are solid. Triangles prove a collision if an edge of one passes through the other, and a
triangle and a solid if a point of the triangle lies in the solid: alternating projections seek it.
Each proof leaves room for the rounding of the points.
"""

from __future__ import annotations

import math

import numpy as np

from cspace._bodies import box_trees
from cspace._bodies.part_trees import CENTER, HALF_SIDES, RADIUS, PartTree
from cspace._support import vectors
from cspace._support.arrays import Floats, Ints, Row
from cspace._support.compiling import internal, kernel

Corners = tuple[Row, Row, Row]
"""Three points of a triangle."""


OrientedBox = tuple[Row, Row, Row, Row]
"""Center and half axes of a box."""


DIRECTION, AXIS_POINT, CHORD, TRANSLATION = 0, 3, 6, 7
"""Columns of the ``axes`` of :func:`joint_displacement` where each entry begins."""


@internal
def find_near_leaves(
    trees: PartTree, matrix: vectors.Matrix, position: Row, axes: Floats, nodes: Ints, top: int
) -> int:
    """Find two leaves whose boxes meet.

    ``matrix`` and ``position`` are the pose of the first tree, as seen from the second. With the
    ``axes``, shape (k, 8), of a box of configurations, skip nodes that may move past each other
    there. ``nodes``, shape (MAX_PENDING_PAIRS, 2), is a stack of pairs of nodes, of the first and
    of the second tree, in the rows from 1 to ``top - 1``. Returns the row of the leaves, above the
    remaining pairs; 0 if there are none.
    """
    while top > 1:
        top -= 1
        a, b = nodes[top, 0], nodes[top, 1]
        a_box = trees.boxes[a]
        b_box = trees.boxes[b]
        center = vectors.apply_pose(matrix, position, vectors.row_at(a_box, CENTER))
        a_half = vectors.box_extent(matrix, vectors.row_at(a_box, HALF_SIDES))
        b_half = vectors.row_at(b_box, HALF_SIDES)
        offset = vectors.minus(center, vectors.row_at(b_box, CENTER))
        if vectors.boxes_are_apart(offset, a_half, b_half):
            continue
        a_count = trees.spans[a, box_trees.ITEM_COUNT]
        b_count = trees.spans[b, box_trees.ITEM_COUNT]
        unposed_half = vectors.row_at(a_box, HALF_SIDES)
        a_size = math.sqrt(vectors.dot(unposed_half, unposed_half))
        b_row = trees.triangles[trees.spans[b, box_trees.FIRST_ITEM]]
        # An oblique box is much smaller than the box around it.
        if b_count == 1 and lies_beside_box(b_row, center, a_size):
            continue
        b_size = b_half[0] + b_half[1] + b_half[2]
        if len(axes) > 0:
            # Triangles stay crossed only if both are larger than twice the displacement. The
            # negative radius gives the least displacement of any part of the ball.
            radius = a_size if a_count == 1 else -a_size
            moved = joint_displacement(axes, center, radius)
            if b_size <= moved or (a_size <= moved and b_row[RADIUS] == 0.0):
                continue
        if a_count == 1 and b_count == 1:
            return top
        # Split the node with the larger box.
        is_b_larger = b_size > a_half[0] + a_half[1] + a_half[2]
        top = box_trees.push_halves(nodes, top, a_count, b_count, is_b_larger)
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
        arm = vectors.cross(
            vectors.row_at(axis, DIRECTION), vectors.minus(point, vectors.row_at(axis, AXIS_POINT))
        )
        total += axis[CHORD] * (math.sqrt(vectors.dot(arm, arm)) + radius) + axis[TRANSLATION]
    return total


@internal
def read_box(q: Floats) -> OrientedBox:
    """Return the center and half axes of a box.

    ``q``, shape (10,), is its row of :attr:`PartTree.triangles`.
    """
    center, u, v = vectors.row_at(q, 0), vectors.row_at(q, 3), vectors.row_at(q, 6)
    # The third half axis is normal to the others; only its length is stored, negated.
    normal = vectors.cross(u, v)
    return (
        center,
        u,
        v,
        vectors.scale_vector(normal, q[RADIUS] / math.sqrt(vectors.dot(normal, normal))),
    )


@internal
def piece_depth(row: Floats, point: Row) -> float:
    """Return a point's depth in a box or ball, negative outside.

    ``row``, shape (10,), is one of :attr:`PartTree.triangles`; the depth in a triangle is -inf.
    """
    radius = float(row[RADIUS])
    from_center = vectors.minus(point, vectors.row_at(row, 0))
    if radius == 0.0:
        return -np.inf
    if radius > 0.0:
        return radius - math.sqrt(vectors.dot(from_center, from_center))
    # In a box, the nearest face counts; outside, the distance from the box.
    _, first, second, third = read_box(row)
    depth = np.inf
    squared_distance = 0.0
    for axis in (first, second, third):
        half = math.sqrt(vectors.dot(axis, axis))
        inward = half - abs(vectors.dot(from_center, axis)) / half
        depth = min(depth, inward)
        squared_distance += min(inward, 0.0) ** 2
    if squared_distance > 0.0:
        return -math.sqrt(squared_distance)
    return depth


@internal
def lies_beside_box(row: Floats, point: Row, reach: float) -> bool:
    """Return True if a row is a box farther away than ``reach``.

    ``row``, shape (10,), is one of :attr:`PartTree.triangles`.
    """
    return row[RADIUS] < 0.0 and piece_depth(row, point) < -reach


@internal
def pierces(corners: Corners, q: Floats, depth: float) -> bool:
    """Return True if a triangle provably pierces a box or ball.

    That is, a point of the triangle lies deeper than ``depth``. ``q``, shape (10,), is the row of
    the box or ball. False proves nothing.
    """
    first = corners[0]
    to_second, to_third = vectors.minus(corners[1], first), vectors.minus(corners[2], first)
    is_ball = q[RADIUS] > 0.0
    target = vectors.row_at(q, 0)  # the center
    scale = 0.5  # of the shrunken box
    # Alternating projections between a triangle and a box after which the search for a common point
    # ends.
    for _ in range(16):
        from_first = vectors.nearest_of_triangle(vectors.minus(target, first), to_second, to_third)
        nearest = vectors.add_scaled(first, from_first, 1.0)
        if piece_depth(q, nearest) > depth:
            return True
        if is_ball:  # no point of the triangle is nearer to its center
            return False
        # Alternate projections between the triangle and a shrunken box, so that they can end inside
        # the box. The shrunken box grows towards the full box.
        target, first_axis, second_axis, third_axis = read_box(q)
        from_center = vectors.minus(nearest, target)
        for axis in (first_axis, second_axis, third_axis):
            coordinate = vectors.dot(from_center, axis) / vectors.dot(axis, axis)
            target = vectors.add_scaled(target, axis, min(max(coordinate, -scale), scale))
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
        u, v, w = vectors.minus(b[0], end), vectors.minus(b[1], end), vectors.minus(b[2], end)
        from_u = vectors.nearest_of_triangle(
            vectors.scale_vector(u, -1.0), vectors.minus(v, u), vectors.minus(w, u)
        )
        n = vectors.add_scaled(u, from_u, 1.0)
        gap = min(vectors.dot(n, u), vectors.dot(n, v), vectors.dot(n, w))
        if not gap > displacement * math.sqrt(vectors.dot(n, n)):
            return False
    # The segment must be far from the three edges.
    for k in range(3):
        c, d = b[k], b[(k + 1) % 3]
        n = vectors.gap_between(p, vectors.minus(q, p), c, vectors.minus(d, c))
        gap_of_p = min(vectors.dot(n, vectors.minus(p, c)), vectors.dot(n, vectors.minus(p, d)))
        gap_of_q = min(vectors.dot(n, vectors.minus(q, c)), vectors.dot(n, vectors.minus(q, d)))
        if not min(gap_of_p, gap_of_q) > displacement * math.sqrt(vectors.dot(n, n)):
            return False
    return True


@internal
def _side_of_plane(p: Row, corners: Corners, tolerance: float) -> int:
    """Return 1 or -1 for the side of a plane that has p.

    The plane passes through three corners. The result is 0 if rounding could change it. The
    determinant changes by less than ``(s + 2 e)^3 - s^3`` if each point moves by at most e and none
    is farther than s from p. Rounding adds less than ``64 * 2^-52 s^3``.
    """
    u, v, w = (
        vectors.minus(corners[0], p),
        vectors.minus(corners[1], p),
        vectors.minus(corners[2], p),
    )
    s = math.sqrt(max(vectors.dot(u, u), vectors.dot(v, v), vectors.dot(w, w)))
    volume = vectors.dot(u, vectors.cross(v, w))
    error = (2.0 * tolerance + 2.0**-46 * s) * (s + tolerance) * (s + tolerance)
    if volume > error:
        return 1
    if volume < -error:
        return -1
    return 0

"""Trees of convex hulls around triangles, and proofs that two trees stay apart.

Each node has a box and a ball around all of its triangles. Some nodes also have the corners of a
convex hull, grown by a radius: whole parts and their large pieces, with enough corners to show
their shape; a few neighbouring triangles; and single triangles. A convex part, such as a box or a
cylinder, is one node.

*Bound.* For any vector n, the distance of two sets is at least the gap between their projections
onto a line along n. The projection of a hull is the projection of its corners, grown by its radius.
The bound holds for every n, such as the vector between the nearest points of two hulls, found by
the corners of their difference (E. G. Gilbert, D. W. Johnson and S. S. Keerthi, "A fast procedure
for computing the distance between complex objects in three-dimensional space", 1988).

*Motions.* As seen from the other body, a point p of a body moves at the velocity ``v + w x p``,
whose component along n is ``n.v + (n x w).p``. Let h be the time to either side, and let
``curvature_bound`` be half the square of h times a bound of all accelerations. Then the position of
p along n stays within h times that velocity of its central position, up to ``curvature_bound``.
This is linear in p, so two more projections, along ``n + h (n x w)`` and ``n - h (n x w)``, bound
the whole motion. A cheaper bound is tried first: the speed of the node's center, and of its ball
about the center.

*Rounding.* The projection of a corner takes a product of a matrix and a vector, and a scalar
product. With u = 2^-53, it is off by less than 16 u times the coordinates and the length of n,
which is 1 up to 4 u. The total is below 2^-48 of the coordinates; the allowance,
``DISTANCE_ROUNDING``, is 2^-40. That module bounds the rounding
of poses.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from cspace._bodies import box_trees
from cspace._bodies.crossings import CHORD, joint_displacement
from cspace._bodies.part_trees import (
    BALL,
    CENTER,
    HALF_SIDES,
    RADIUS,
    PartTree,
    distinct_rows,
    half_axes,
)
from cspace._support import vectors
from cspace._support.arrays import Bools, Floats, Ints, Row
from cspace._support.compiling import internal

MAX_TRIANGLES_PER_TILE: Final = 16
"""Largest number of neighbouring triangles tested as one hull."""


HULL_BRANCHING: Final = 16
"""Largest ratio of the triangles of a hull to the triangles of the hulls below it."""


_MAX_TRIANGLES_OF_RANKS: Final = MAX_TRIANGLES_PER_TILE * HULL_BRANCHING ** np.arange(12)
"""Largest number of triangles of a node of each rank; a tile has the rank 0."""


MAX_EXACT_CORNERS: Final = 192
"""Largest number of corners of a hull that is kept exactly: that of a convex part or of a flat set,
or one whose corners are all of its points."""


MAX_HULL_CORNERS: Final = 96
"""Largest number of corners of other hulls, which grow to hold the corners left out."""


HULL_ROUNDING: Final = 2.0**-48
"""Growth of a hull with points beside its corners, relative to the largest coordinate: the rounding
of distances from triangles."""


TINY: Final = 1e-300
"""Smallest decrease of a slack; it makes a slack of zero negative."""


_CUBE_CORNERS: Final = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Corners of the cube [-1, 1]^3, shape (8, 3)."""


def _spread_directions(count: int) -> Floats:
    """Spread directions evenly over a sphere, shape (count, 3).

    They lie on a Fibonacci spiral.
    """
    steps = np.arange(count) + 0.5
    heights = 1.0 - 2.0 * steps / count
    angles = math.pi * (1.0 + math.sqrt(5.0)) * steps
    radii = np.sqrt(1.0 - heights**2)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles), heights])


_DIRECTIONS: Final = _spread_directions(MAX_HULL_CORNERS)
"""Directions along which the corners of a large hull are extreme, shape (MAX_HULL_CORNERS, 3)."""


class Hulls(NamedTuple):
    """Trees of convex hulls around the bodies of links and obstacles.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 9)
        A row for each node: center ([:3]) and half sides ([3:6]) of its axis-aligned box, radius of
        its ball about that center ([6]), radius by which its hull is grown ([7]), and about how
        much the hull exceeds its contents ([8]).
    nodes : ndarray of int64, shape (m, 5)
        A row for each node. Column 0 is its second child, or 0 for a leaf. Columns 1 and 2 are the
        range [start, stop) of its hull's corners: 0, 0 without a hull, and start = stop for a leaf
        that fills its box. Column 3 is 1 if it contains whole connected parts only. Column 4 is its
        first child, or 0 for a leaf; in a part it is the next node.
    corners : ndarray of float64, shape (3, n)
        Corners of all hulls.
    """

    boxes: Floats
    nodes: Ints
    corners: Floats


SECOND_CHILD, FIRST_CORNER, STOP_CORNER, IS_WHOLE, FIRST_CHILD = range(5)
"""Columns of :attr:`Hulls.nodes`."""


BALL_RADIUS, HULL_RADIUS, LOOSENESS = range(6, 9)
"""Columns of :attr:`Hulls.boxes` after the center and the half sides."""


class RelativeMotion(NamedTuple):
    """Pose and motion of a body, as seen from another body.

    Attributes
    ----------
    matrix : tuple of tuple of float
        Rows of the rotation matrix.
    position : tuple of float
        Origin of the body's frame.
    spin, velocity : tuple of float
        A point p moves at ``velocity + spin x p`` at the central moment.
    half_time : float
        Time before and after the central moment that the proof covers.
    curvature_bound : float
        Largest deviation from the linear motion within that time.
    max_displacement : float
        Largest displacement of any point within that time.
    required : float
        Distance that proves the bodies apart.
    seeks_contact : bool
        Whether to look for a contact at the central moment if the motion is not proven.
    """

    matrix: vectors.Matrix
    position: Row
    spin: Row
    velocity: Row
    half_time: float
    curvature_bound: float
    max_displacement: float
    required: float
    seeks_contact: bool


def build_hulls(tree: PartTree, volume: float) -> Hulls:
    """Build the tree of hulls of a part.

    Its nodes are those of the tree of its triangles, ``tree``. ``volume`` is the volume that the
    triangles enclose. A part that fills its hull is one node.
    """
    rows = tree.triangles
    spans = tree.spans
    if not len(rows):
        return Hulls(np.empty((0, 9)), np.empty((0, 5), np.int64), np.empty((3, 0)))
    # Every node has a box and a ball; every leaf has the corners of its row.
    starts, counts = spans.T
    half_sides = tree.boxes[:, 3:6]
    ball_radii = np.linalg.norm(half_sides, axis=1)
    row_radii = rows[:, RADIUS]
    hull_radii = tree.boxes[:, BALL]
    looseness = np.zeros(len(counts))
    boxes = np.column_stack([tree.boxes[:, :6], ball_radii, hull_radii, looseness])
    corners, first_corners = _list_row_corners(rows)
    nodes = _link_nodes(spans, first_corners)
    is_leaf = counts == 1
    # Boxes and balls are solid, so each is a whole connected part.
    is_box = row_radii < 0.0  # boxes are marked by the sign
    is_ball = _are_balls(rows)
    ball_leaves = is_leaf & is_ball[starts]
    boxes[ball_leaves, BALL_RADIUS] = row_radii[starts[ball_leaves]]
    nodes[:, IS_WHOLE] = bool((is_box | is_ball).all())
    nodes[0, IS_WHOLE] = 1
    if nodes[:, IS_WHOLE].all():
        return Hulls(boxes, nodes, np.ascontiguousarray(corners.T))
    # Some inner nodes get hulls too, whose corners are appended.
    points, point_of_corner = distinct_rows(corners)
    is_rounded = bool(row_radii.any())
    ranks = np.searchsorted(_MAX_TRIANGLES_OF_RANKS, counts)
    corners_of_hulls = [corners]
    stop = len(corners)
    for node in np.flatnonzero(_choose_hulls(nodes, ranks) & ~is_leaf).tolist():
        is_tile = ranks[node] == 0
        if is_rounded and not is_tile:
            continue
        first_corner = first_corners[starts[node]]
        stop_corner = first_corners[starts[node] + counts[node]]
        # Most hulls have a handful of corners, for which numpy takes far longer.
        numbers = set(point_of_corner[first_corner:stop_corner].tolist())
        hull = points[sorted(numbers)]
        depth = half_sides[node].min()
        if not is_rounded and (node == 0 or not is_tile):
            fit = _fit_hull(hull, volume if node == 0 else 0.0)
            if fit is None:
                continue
            hull = fit.corners
            depth = fit.depth + fit.growth
            boxes[node, HULL_RADIUS] = fit.growth
            if fit.is_exact:
                return _make_node(boxes[:1], hull)
        boxes[node, LOOSENESS] = depth
        nodes[node, FIRST_CORNER] = stop
        nodes[node, STOP_CORNER] = stop + len(hull)
        corners_of_hulls.append(hull)
        stop += len(hull)
    return Hulls(boxes, nodes, np.ascontiguousarray(np.concatenate(corners_of_hulls).T))


def wrap_convex(triangles: Floats) -> Hulls | None:
    """Wrap a convex body in one node; return None unless it is convex and has few corners.

    ``triangles``, shape (n, 3, 3), are its closed surface, which faces outward.
    """
    corners, _ = distinct_rows(triangles.reshape(-1, 3))
    if len(corners) > MAX_EXACT_CORNERS:
        return None
    first, second, third = triangles.swapaxes(0, 1)
    normals = np.cross(second - first, third - first)
    # No corner of a convex body lies beyond the plane of a triangle, up to rounding; a flat body
    # has none below one either.
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    tolerances = 1e-9 * (upper - lower).max() * np.linalg.norm(normals, axis=1)
    heights = corners @ normals.T - (first * normals).sum(axis=1)
    if (heights > tolerances).any() or not (heights < -tolerances).any():
        return None
    half_sides = 0.5 * (upper - lower)
    box = [*(0.5 * (lower + upper)), *half_sides, np.linalg.norm(half_sides), 0.0, 0.0]
    # A body that fills its box stores no corners, because those of the box are found sooner.
    fills_box = len(corners) == 8 and ((corners == lower) | (corners == upper)).all()
    return _make_node(np.array([box]), corners[:0] if fills_box else corners)


def _make_node(box: Floats, corners: Floats) -> Hulls:
    """Make a tree of one node, which is a whole part.

    ``box``, shape (1, 9), is its row of :attr:`Hulls.boxes`; its ``corners`` have shape (n, 3).
    """
    node = np.zeros((1, 5), dtype=np.int64)
    node[0, STOP_CORNER] = len(corners)
    node[0, IS_WHOLE] = 1
    return Hulls(box, node, np.ascontiguousarray(corners.T))


def _link_nodes(spans: Ints, first_corners: Ints) -> Ints:
    """Return rows of :attr:`Hulls.nodes` with children, and with the corners of leaves.

    ``spans``, shape (m, 2), has the first row of each node in its tree and their number;
    ``first_corners``, shape (n + 1,), has the first corner of each row.
    """
    starts, counts = spans.T
    nodes = np.zeros((len(counts), 5), dtype=np.int64)
    is_leaf = counts == 1
    parents = np.flatnonzero(~is_leaf)
    # The first child follows its parent, and the second child follows the nodes of the first.
    nodes[parents, SECOND_CHILD] = parents + 2 * (counts[parents] // 2)
    nodes[parents, FIRST_CHILD] = parents + 1
    nodes[is_leaf, FIRST_CORNER] = first_corners[starts[is_leaf]]
    nodes[is_leaf, STOP_CORNER] = first_corners[starts[is_leaf] + 1]
    return nodes


def _choose_hulls(nodes: Ints, ranks: Ints) -> Bools:
    """Choose the nodes to test as hulls; return a mask, shape (m,).

    These are the root, and nodes whose parent has a larger rank. A rank counts the triangles of a
    node, each rank more of them by a constant factor.
    """
    inner = np.flatnonzero(nodes[:, SECOND_CHILD])
    parents = np.zeros(len(nodes), dtype=np.int64)
    parents[nodes[inner, SECOND_CHILD]] = inner
    parents[nodes[inner, FIRST_CHILD]] = inner
    is_chosen: Bools = ranks < ranks[parents]
    is_chosen[0] = True
    return is_chosen


def _are_balls(rows: Floats) -> Bools:
    """Return a mask of the rows of a tree that are balls.

    ``rows`` has shape (n, 10). A ball has three equal corners.
    """
    first_corners, other_corners = rows[:, :3], rows[:, 3:9]
    return np.asarray((other_corners == np.tile(first_corners, 2)).all(axis=1))


def _list_row_corners(rows: Floats) -> tuple[Floats, Ints]:
    """List the corners of all rows of a tree.

    Returns the corners, shape (m, 3), and the index of the first corner of each row, shape (n +
    1,). ``rows``, shape (n, 10), are :attr:`cspace._bodies.part_trees.PartTree.triangles`.
    Triangles have three corners, balls one, boxes eight, and axis-aligned boxes none.
    """
    is_box = rows[:, RADIUS] < 0.0  # boxes are marked by the sign
    is_ball = _are_balls(rows)
    off_axis = rows[:, [4, 5, 6, 8]]  # zero if the first half axes are along x and y
    is_aligned = ~off_axis.any(axis=1)
    counts = np.select([is_box & is_aligned, is_box, is_ball], [0, 8, 1], 3)
    places = np.arange(counts.max())
    # Give every row the number of corners of the largest, then drop the excess.
    corners = rows[:, :9].reshape(-1, 3, 3)[:, np.minimum(places, 2)]
    is_tilted = counts == 8
    if is_tilted.any():
        tilted = rows[is_tilted]
        corners[is_tilted] = tilted[:, None, :3] + _CUBE_CORNERS @ half_axes(tilted)
    is_used = places < counts[:, None]
    return corners[is_used], np.append(0, np.cumsum(counts))


class HullFit(NamedTuple):
    """Convex hull of points.

    The hull of the ``corners``, shape (n, 3), grown by ``growth``, contains all points. ``depth``
    is the largest depth of a point in the hull of the corners. Lengths are in metres. ``is_exact``
    means that the triangles of the points enclose the whole hull.
    """

    corners: Floats
    depth: float
    growth: float
    is_exact: bool


def _fit_hull(points: Floats, volume: float) -> HullFit | None:
    """Fit a convex hull with few corners to points, shape (n, 3).

    The points enclose ``volume``. A flat set keeps all points, or has no hull if they are too many.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
        kept = hull.vertices
        # Rounding of the volumes may not hide that a part is convex.
        is_convex = volume > (1.0 - 1e-9) * hull.volume
        # Meshes that are convex up to rounding keep all points, which shows their shape best.
        is_kept = is_convex or len(kept) == len(points)
        is_exact = is_convex and len(kept) <= MAX_EXACT_CORNERS
        if len(kept) > (MAX_EXACT_CORNERS if is_kept else MAX_HULL_CORNERS):
            extreme = (points[kept] @ _DIRECTIONS.T).argmax(axis=0)
            kept = kept[np.unique(extreme)]
            hull = ConvexHull(points[kept])
    except QhullError:
        return HullFit(points, 0.0, 0.0, False) if len(points) <= MAX_EXACT_CORNERS else None
    # The height of each point above the planes of the faces; it is negative inside.
    normals = hull.equations[:, :3]
    offsets = hull.equations[:, 3]
    blocks = _split_into_blocks(points, len(normals))
    heights = np.concatenate([(block @ normals.T + offsets).max(axis=1) for block in blocks])
    # Points left out may lie beside the hull; by rounding, so may those on its faces and edges.
    left_out = np.ones(len(points), dtype=np.bool_)
    left_out[kept] = False
    size = np.ptp(points, axis=0).max()
    points_beside = points[left_out & (heights > -1e-9 * size)]
    growth = _bound_largest_gap(points_beside, hull.points[hull.simplices])
    if len(points_beside):
        growth += HULL_ROUNDING * float(np.abs(points).max())
    return HullFit(points[kept], -float(heights.min()), growth, is_exact)


def _bound_largest_gap(points: Floats, triangles: Floats) -> float:
    """Bound the points' distances from their nearest triangles from above.

    ``points`` has shape (n, 3), ``triangles`` (m, 3, 3). Each point is compared with one point of
    each triangle: the nearest one if that is not on the border, and otherwise one near it.
    """
    if not len(points):
        return 0.0
    origins = triangles[:, 0]
    inverses = np.linalg.pinv(triangles[:, 1:] - triangles[:, :1])
    # Weights of a plane are linear in the point, so that two products give those of all planes.
    shifts = (origins[:, np.newaxis] @ inverses)[:, 0].T
    columns = inverses.transpose(2, 1, 0)
    largest = 0.0
    for block in _split_into_blocks(points, len(triangles)):
        # Barycentric weights of the nearest point of each plane, shape (3, points, triangles). The
        # weights of a point beside its triangle are cut to zero or above.
        second, third = block @ columns - shifts[:, np.newaxis]
        weights = np.maximum([1.0 - second - third, second, third], 0.0)
        weights /= weights.sum(axis=0)
        squares = np.zeros(second.shape)
        for axis in range(3):
            corners = triangles[:, :, axis].T[:, np.newaxis]
            offsets = (weights * corners).sum(axis=0) - block[:, [axis]]
            squares += offsets**2
        largest = max(largest, math.sqrt(squares.min(axis=1).max(initial=0.0)))
    return largest


def _split_into_blocks(points: Floats, others: int) -> list[Floats]:
    """Split points into blocks with few pairs between them.

    ``others`` is the number of planes or triangles with which each point is compared.
    """
    # Largest number of pairs of a point and a plane or a triangle that are compared at once.
    blocks = len(points) * others // 2**18 + 1
    return np.array_split(points, blocks)


def join_roots(boxes: Floats, roots: Ints, start: int) -> tuple[Floats, Ints]:
    """Build a tree whose leaves are the roots of hull trees.

    ``boxes``, shape (n, 9), are those of the ``roots``, shape (n,). Returns rows of
    :attr:`Hulls.boxes` and :attr:`Hulls.nodes` for the nodes from ``start`` on; the first is the
    root of all.
    """
    centers = boxes[:, :3]
    half_sides = boxes[:, 3:6]
    tree_boxes, order, spans = box_trees.build_boxes(centers - half_sides, centers + half_sides)
    starts, counts = spans.T
    inner = np.flatnonzero(counts > 1)
    # A leaf has the number of a given root; the nodes above are new.
    numbers = roots[order[starts]]
    numbers[inner] = start + np.arange(len(inner))
    # The first child follows its parent, the second one follows the nodes of the first.
    nodes = np.zeros((len(inner), 5), dtype=np.int64)
    nodes[:, SECOND_CHILD] = numbers[inner + 2 * (counts[inner] // 2)]
    nodes[:, IS_WHOLE] = 1
    nodes[:, FIRST_CHILD] = numbers[inner + 1]
    new_boxes = np.zeros((len(inner), 9))
    new_boxes[:, :6] = tree_boxes[inner]
    new_boxes[:, BALL_RADIUS] = np.linalg.norm(tree_boxes[inner, 3:], axis=1)
    return new_boxes, nodes


def node_corners(hulls: Hulls, node: int) -> tuple[Floats, float]:
    """Return the corners and radius of a node's hull.

    The corners have shape (n, 3); the hull is grown by the radius. A node without a hull has the
    corners of its box; metres.
    """
    first, stop = hulls.nodes[node, FIRST_CORNER], hulls.nodes[node, STOP_CORNER]
    if first < stop:
        return hulls.corners[:, first:stop].T, float(hulls.boxes[node, HULL_RADIUS])
    box = hulls.boxes[node]
    center, half_sides = box[:3], box[3:6]
    return center + _CUBE_CORNERS * half_sides, 0.0


@internal
def tree_slack(
    hulls: Hulls,
    one: int,
    other: int,
    motion: RelativeMotion,
    axes: Floats,
    enough: float,
    scratch: Ints,
    direction: Floats,
) -> float:
    """Return a lower bound of (distance - required distance) between trees.

    The bound is capped at ``enough``. The motion is the first tree's, as seen from the second.
    Deviations of joints move the first tree away from the motion, about ``axes``; see
    :func:`cspace._bodies.crossings.joint_displacement`. The result is negative if a pair of
    nodes is not proven to stay apart, and -inf if a pair is not apart at the central moment. That
    pair becomes row 0 of ``scratch``, shape (MAX_PENDING_PAIRS, 2). The pair given there is tested
    after the roots; -1 means none. Row 1 then starts with 1 if pieces of connected parts were
    proven apart separately. ``direction`` is that of :func:`hull_slack`, for each pair of hulls in
    turn.
    """
    best = enough
    partial = False  # whether pieces of connected parts were proven apart separately
    moves = False  # whether a pair is apart at the central moment, but not during the motion
    # Rows of the stack from 1 to top - 1 have pairs of nodes that are not proven apart yet.
    scratch[1, 0] = one
    scratch[1, 1] = other
    top = 2
    nearest_a, nearest_b = scratch[0, 0], scratch[0, 1]
    while top > 1:
        top -= 1
        a, b = scratch[top, 0], scratch[top, 1]
        # Boxes suffice for most nodes.
        slack, speed, center, away = box_slack(hulls.boxes[a], hulls.boxes[b], motion, axes, best)
        apart = True
        if slack <= best and has_hull(hulls, a) and has_hull(hulls, b):
            offset = vectors.minus(vectors.row_at(hulls.boxes[b], CENTER), center)
            slack, apart = hull_slack(hulls, a, b, motion, speed, away, best, offset, direction)
        if slack > best:
            partial = partial or hulls.nodes[a, IS_WHOLE] + hulls.nodes[b, IS_WHOLE] < 2
            continue
        if not is_fine_enough(hulls, a, b, motion, axes, apart, slack):
            split_pair(hulls, a, b, center, scratch, top)
            top += 2
            if nearest_a >= 0:
                scratch[top, 0] = nearest_a
                scratch[top, 1] = nearest_b
                top += 1
                nearest_a = -1
            continue
        scratch[0, 0] = a
        scratch[0, 1] = b
        if apart and motion.half_time > 0.0:
            moves = True
            if not motion.seeks_contact:
                break
            # The caller halves the motion next unless its central moment is blocked, so test at
            # most that now.
            motion = freeze_motion(motion)
            continue
        best = min(slack, best - TINY) if apart else -math.inf
        if best <= 0.0:
            break
    scratch[1, 0] = int(partial)
    return min(best, -TINY) if moves else best


@internal
def freeze_motion(motion: RelativeMotion) -> RelativeMotion:
    """Reduce a motion to its central moment, without duration."""
    matrix, position, spin, velocity = motion[:4]
    return RelativeMotion(matrix, position, spin, velocity, 0.0, 0.0, 0.0, motion.required, True)


@internal
def is_fine_enough(
    hulls: Hulls,
    a: int,
    b: int,
    motion: RelativeMotion,
    axes: Floats,
    apart: bool,
    slack: float,
) -> bool:
    """Return True if testing the children of two nodes would hardly help.

    The nodes are leaves, or the motion is too long for their children to be proven apart. ``apart``
    and ``slack`` are those of their hulls; ``axes``, shape (k, 8), are those of
    :func:`cspace._bodies.crossings.joint_displacement`.
    """
    if not (has_hull(hulls, a) and has_hull(hulls, b)):
        return False
    if hulls.nodes[a, SECOND_CHILD] == 0 and hulls.nodes[b, SECOND_CHILD] == 0:
        return True
    # The children may be apart even if the hulls are not, unless the motion is too long.
    loose = hulls.boxes[a, LOOSENESS] + hulls.boxes[b, LOOSENESS]
    if motion.half_time > 0.0:
        # Share of the looseness of hulls below which a motion is halved before their children are
        # tested. Most of a long motion is proven by fewer pairs of nodes if it is halved; 0 and 1
        # cost twice as many.
        loose *= 0.1
    for k in range(len(axes)):
        loose += 2.0 * axes[k, CHORD] * hulls.boxes[a, BALL_RADIUS]
    return bool(apart and slack + loose < 0.0)


@internal
def box_slack(
    box: Floats, fixed: Floats, motion: RelativeMotion, axes: Floats, enough: float
) -> tuple[float, float, Row, float]:
    """Bound the slack of two nodes from below, by their boxes.

    Slack is (distance - required distance). ``box`` and ``fixed``, shape (9,), are rows of
    :attr:`Hulls.boxes`; ``axes`` has shape (k, 8). The ball of the first node decides if the boxes'
    slack is at most ``enough``. Also returns a bound of the displacement of the first node during
    the motion, its center as seen from the second, and how far the ``axes`` move it away.
    """
    half_time = motion.half_time
    limit = motion.max_displacement
    ball_radius = box[BALL_RADIUS]
    center = vectors.apply_pose(motion.matrix, motion.position, vectors.row_at(box, CENTER))
    half = vectors.box_extent(motion.matrix, vectors.row_at(box, HALF_SIDES))
    velocity = vectors.add_scaled(motion.velocity, vectors.cross(motion.spin, center), 1.0)
    # Points move around the center, too.
    spin_speed = math.sqrt(vectors.dot(motion.spin, motion.spin)) * ball_radius
    around = half_time * spin_speed + motion.curvature_bound
    # During the motion, points come that much farther from the axes, or less.
    away = joint_displacement(axes, center, ball_radius + limit)
    slack = -math.inf
    squared_distance = 0.0  # of the center from the fixed box
    for axis in range(3):
        outside = abs(center[axis] - fixed[CENTER + axis]) - fixed[HALF_SIDES + axis]
        displacement = min(half_time * abs(velocity[axis]) + around, limit)
        slack = max(slack, outside - half[axis] - displacement)
        squared_distance += max(outside, 0.0) ** 2
    slack -= motion.required + away
    speed = min(half_time * math.sqrt(vectors.dot(velocity, velocity)) + around, limit)
    if slack <= enough:
        slack = math.sqrt(squared_distance) - ball_radius - motion.required - speed - away
    return slack, speed, center, away


@internal
def has_hull(hulls: Hulls, node: int) -> bool:
    """Return True if a node can be tested as a convex hull.

    Each leaf can: one without corners fills its box.
    """
    return bool(hulls.nodes[node, SECOND_CHILD] == 0 or hulls.nodes[node, STOP_CORNER] > 0)


@internal
def split_pair(hulls: Hulls, a: int, b: int, center: Row, scratch: Ints, row: int) -> None:
    """Split a pair of nodes into two pairs with children of one.

    Writes them to two rows of the stack ``scratch``, shape (MAX_PENDING_PAIRS, 2), from ``row`` on.
    A node without a hull is split first, then the larger node. ``center`` is that of node a, as
    seen from node b.
    """
    a_has_hull = has_hull(hulls, a)
    prefers_a = not a_has_hull
    if a_has_hull == has_hull(hulls, b):
        prefers_a = hulls.boxes[a, BALL_RADIUS] >= hulls.boxes[b, BALL_RADIUS]
    a_is_leaf = hulls.nodes[a, SECOND_CHILD] == 0
    b_is_leaf = hulls.nodes[b, SECOND_CHILD] == 0
    if b_is_leaf or (prefers_a and not a_is_leaf):
        scratch[row, 0] = hulls.nodes[a, SECOND_CHILD]
        scratch[row, 1] = b
        scratch[row + 1, 0] = hulls.nodes[a, FIRST_CHILD]
        scratch[row + 1, 1] = b
        return
    # The nearer child comes last, so that it is tested first and its bound prunes the other.
    nearer = hulls.nodes[b, FIRST_CHILD]
    farther = hulls.nodes[b, SECOND_CHILD]
    to_nearer = vectors.minus(center, vectors.row_at(hulls.boxes[nearer], CENTER))
    to_farther = vectors.minus(center, vectors.row_at(hulls.boxes[farther], CENTER))
    if vectors.dot(to_nearer, to_nearer) > vectors.dot(to_farther, to_farther):
        nearer, farther = farther, nearer
    scratch[row, 0] = a
    scratch[row, 1] = farther
    scratch[row + 1, 0] = a
    scratch[row + 1, 1] = nearer


@internal
def hull_slack(
    hulls: Hulls,
    a: int,
    b: int,
    motion: RelativeMotion,
    speed: float,
    away: float,
    enough: float,
    offset: Row,
    direction: Floats,
) -> tuple[float, bool]:
    """Bound the slack of two hulls from below; see :func:`tree_slack`.

    Slack is (distance - required distance). Also returns whether they are apart at the central
    moment. ``speed`` bounds the displacement of the first hull during the motion, and ``away`` that
    from the motion. The first direction tried is
    ``direction``, shape (3,), or the ``offset`` of the centers if that is zero; either may have any
    length. Later ones lead between the nearest points that the search has found. ``direction``
    becomes the best.
    """
    radii = hulls.boxes[a, HULL_RADIUS] + hulls.boxes[b, HULL_RADIUS]
    required = motion.required + away + radii
    best = -math.inf
    gap = -math.inf
    n = vectors.row_at(direction, 0)
    if vectors.dot(n, n) == 0.0:
        n = offset
    length = math.inf
    # The simplex of differences of corners that is nearest to the origin, with ``count`` corners.
    p = q = r = (0.0, 0.0, 0.0)
    count = 0
    # Largest number of steps of the search for the nearest points of two hulls.
    for _ in range(40):
        square = vectors.dot(n, n)
        if not 1e-200 < square < math.inf:
            # The vector is too short to be a direction, so the search ends; at first, any direction
            # will do.
            if count:
                break
            n = (1.0, 0.0, 0.0)
            square = 1.0
        n = vectors.scale_vector(n, 1.0 / math.sqrt(square))
        a_point, high = support_point(hulls, a, vectors.rotate_back(motion.matrix, n))
        b_point, low = support_point(hulls, b, vectors.scale_vector(n, -1.0))
        # The gap between the projections onto n bounds the distance from below.
        gap_along = -low - high - vectors.dot(n, motion.position)
        if gap_along - required > gap:
            gap = gap_along - required
            direction[0], direction[1], direction[2] = n
            limits = gap_along, required, speed, enough
            best = max(best, slack_along(hulls, a, motion, n, a_point, low, limits))
            if best > enough:
                break
        # The distance is at least any gap between projections, and at most the length of the vector
        # found.
        if length <= required:
            break
        # If no better direction could be enough, the caller halves the motion.
        largest_slack = best + length - required - gap
        if gap > 0.0 and speed > 0.0 and largest_slack <= enough:
            best = largest_slack
            break
        # The nearest points are exact up to rounding.
        if count and length - gap_along <= 1e-10 * length:
            break
        # Go on from the corners that are farthest along n.
        posed_point = vectors.apply_pose(motion.matrix, motion.position, a_point)
        n, p, q, r, count = nearest_in_simplex(vectors.minus(b_point, posed_point), p, q, r, count)
        before = length
        length = math.sqrt(vectors.dot(n, n))
        if count == 4 or not length < before:
            break
    return best, gap > 0.0


@internal
def slack_along(
    hulls: Hulls,
    a: int,
    motion: RelativeMotion,
    n: Row,
    a_point: Row,
    low: float,
    limits: tuple[float, float, float, float],
) -> float:
    """Bound the slack of two hulls from below, by projections onto n.

    Slack is (distance - required distance). The bound is that of any motion up to a speed, or that
    of the linear motion if larger. ``low`` is the coordinate of the second hull along -n.
    ``limits`` are the central gap, the required distance, the speed, and the slack that is enough.
    """
    gap, required, speed, enough = limits
    slack = gap - required - speed
    allowance = required + motion.curvature_bound
    # Along n the motion may be shorter than ``speed``.
    if slack <= enough and motion.half_time > 0.0:
        # This corner bounds the slack from above, so the motion is not proven: callers take no more
        # from a result of at most ``enough`` of a motion than that it must be halved.
        posed_point = vectors.apply_pose(motion.matrix, motion.position, a_point)
        velocity = vectors.add_scaled(motion.velocity, vectors.cross(motion.spin, posed_point), 1.0)
        largest_slack = gap - allowance - motion.half_time * abs(vectors.dot(n, velocity))
        if largest_slack <= enough:
            return max(slack, largest_slack)
        for time in (-motion.half_time, motion.half_time):
            # The projection along n of the body moved for that time is one along m now.
            m = vectors.add_scaled(n, vectors.cross(n, motion.spin), time)
            _, high = support_point(hulls, a, vectors.rotate_back(motion.matrix, m))
            gap_then = (
                -low
                - high
                - vectors.dot(m, motion.position)
                - time * vectors.dot(n, motion.velocity)
            )
            gap = min(gap, gap_then)
        slack = max(slack, gap - allowance)
    return slack


@internal
def support_point(hulls: Hulls, node: int, n: Row) -> tuple[Row, float]:
    """Return the farthest corner of a hull along n, and its coordinate."""
    first = hulls.nodes[node, FIRST_CORNER]
    stop = hulls.nodes[node, STOP_CORNER]
    x, y, z = n
    if first == stop:
        # A leaf that fills its axis-aligned box has no stored corners.
        center = vectors.row_at(hulls.boxes[node], CENTER)
        half = vectors.row_at(hulls.boxes[node], HALF_SIDES)
        corner = (
            center[0] + math.copysign(half[0], x),
            center[1] + math.copysign(half[1], y),
            center[2] + math.copysign(half[2], z),
        )
        return corner, vectors.dot(corner, n)
    xs, ys, zs = hulls.corners[0], hulls.corners[1], hulls.corners[2]
    highest = -math.inf
    farthest = 0
    for k in range(first, stop):
        height = x * xs[k] + y * ys[k] + z * zs[k]
        if height > highest:
            highest = height
            farthest = k
    return (xs[farthest], ys[farthest], zs[farthest]), highest


@internal
def nearest_in_simplex(
    new: Row, a: Row, b: Row, c: Row, count: int
) -> tuple[Row, Row, Row, Row, int]:
    """Add a corner to a simplex; find its point nearest the origin.

    The simplex has ``count`` corners, from 0 to 3, among ``a``, ``b`` and ``c``; unused places
    repeat a corner. Returns the nearest point, three corners of its face, padded likewise, and
    their number. The number is 4 if the tetrahedron contains the origin; the point then has no
    meaning. E. G. Gilbert, D. W. Johnson and S. S. Keerthi, 1988 (GJK).
    """
    if count == 0:
        return nearest_in_triangle(new, new, new)
    if count == 1:
        return nearest_in_triangle(new, a, a)
    if count == 2:
        return nearest_in_triangle(new, a, c)  # b repeats a or c
    # Find the barycentric weights of the origin by Cramer's rule; the new corner has the remaining
    # weight.
    origin = vectors.scale_vector(new, -1.0)
    to_a = vectors.minus(a, new)
    to_b = vectors.minus(b, new)
    to_c = vectors.minus(c, new)
    volume = vectors.dot(to_a, vectors.cross(to_b, to_c))
    weight_a = vectors.dot(origin, vectors.cross(to_b, to_c)) / volume
    weight_b = vectors.dot(to_a, vectors.cross(origin, to_c)) / volume
    weight_c = vectors.dot(to_a, vectors.cross(to_b, origin)) / volume
    is_inside = min(weight_a, weight_b, weight_c) >= 0.0 and weight_a + weight_b + weight_c <= 1.0
    if volume != 0.0 and is_inside:
        return origin, a, b, c, 4
    # Skip the face (a, b, c): the new corner lies on the origin's side of it, so a nearer point is
    # on another face.
    best = nearest_in_triangle(new, a, b)
    for first, second in ((b, c), (c, a)):
        other = nearest_in_triangle(new, first, second)
        if vectors.dot(other[0], other[0]) < vectors.dot(best[0], best[0]):
            best = other
    return best


@internal
def nearest_in_triangle(a: Row, b: Row, c: Row) -> tuple[Row, Row, Row, Row, int]:
    """Find the point of a triangle that is nearest the origin.

    The corners of the triangle may coincide. Returns the point, the corners of its corner, edge or
    face, padded to three, and their number, from 1 to 3.
    """
    # The point is a + s (b - a) + t (c - a). On a corner or edge, a weight is exactly 0, or 1.
    s, t = vectors.triangle_weights(a, b, c)
    if s == 0.0 and t == 0.0:
        return a, a, a, a, 1
    if s == 1.0:
        return b, b, b, b, 1
    if t == 1.0:
        return c, c, c, c, 1
    ab, ac = vectors.minus(b, a), vectors.minus(c, a)
    if t == 0.0:
        return vectors.add_scaled(a, ab, s), a, b, b, 2
    if s == 0.0:
        return vectors.add_scaled(a, ac, t), a, c, c, 2
    if s + t == 1.0:
        return vectors.add_scaled(b, vectors.minus(c, b), t), b, c, c, 2
    n = vectors.cross(ab, ac)
    return vectors.scale_vector(n, vectors.dot(n, a) / vectors.dot(n, n)), a, b, c, 3

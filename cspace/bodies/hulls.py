"""Trees of convex hulls around triangles, and proofs that two trees stay apart.

Each node has a box and a ball around all of its triangles. Some nodes also have the corners of a
convex hull, grown by the radius of their triangles: whole parts and their large pieces, unless they
have too many corners; a few neighbouring triangles; and single triangles. A convex part, such as a
box or a cylinder, is one node.

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
which is 1 up to 4 u. The total is below 2^-48 of the coordinates; the allowance
:data:`cspace.bodies.DISTANCE_ROUNDING` is 2^-40. :mod:`cspace.arms.chain` bounds the rounding of
poses.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from cspace.bodies.triangles import (
    Trees,
    build_boxes,
    half_axes,
    joint_displacement,
    node_maxima,
)
from cspace.support.arrays import Bools, Floats, Ints, Matrix, Row
from cspace.support.compiling import kernel
from cspace.support.vectors import (
    add_scaled,
    apply_pose,
    box_extent,
    cross,
    dot,
    minus,
    rotate_back,
    row_at,
    scale_vector,
    triangle_weights,
)

MAX_TRIANGLES_PER_TILE: Final = 16
"""Largest number of neighbouring triangles tested as one hull."""


HULL_BRANCHING: Final = 16
"""Largest ratio of the triangles of a hull to those of the hulls below it."""


MAX_HULL_CORNERS: Final = 192
"""Largest number of corners of a hull; nodes with larger hulls are tested by their children."""


HULL_ROUNDING: Final = 2.0**-48
"""Growth of a hull with points beside its corners, relative to the largest coordinate: the rounding
of distances from triangles."""


MAX_PAIRS_PER_BLOCK: Final = 2**18
"""Largest number of pairs of a point and a plane or a triangle that are compared at once."""


MAX_GJK_STEPS: Final = 40
"""Largest number of steps of the search for the nearest points of two hulls."""


_SIGNS: Final = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""Corners of a cube, shape (8, 3)."""


class Hulls(NamedTuple):
    """Trees of convex hulls around the bodies of links and obstacles.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 9)
        Of each node: center ([:3]) and half sides ([3:6]) of its axis-aligned box, radius of its
        ball about that center ([6]), radius by which its hull is grown ([7]), and about how much
        the hull exceeds its contents ([8]).
    nodes : ndarray of int64, shape (m, 5)
        The second child, or 0 for a leaf. Then the range [start, stop) of the corners of the hull:
        0, 0 without a hull, and start = stop for a leaf that fills its box. Then 1 if the node
        contains whole connected parts only. Last, the first child, or 0 for a leaf; in a part it is
        the next node.
    corners : ndarray of float64, shape (3, n)
        Corners of all hulls.
    """

    boxes: Floats
    nodes: Ints
    corners: Floats


class RelativeMotion(NamedTuple):
    """Pose and motion of a body, as seen from another body.

    Attributes
    ----------
    matrix : tuple of tuple of float
        Rows of the rotation matrix.
    position : tuple of float
    spin, velocity : tuple of float
        A point p moves at ``velocity + spin x p`` at the central moment.
    half_time : float
        Time to either side that the proof covers.
    curvature_bound : float
        Largest deviation from that linear motion meanwhile.
    max_displacement : float
        Largest displacement of any point meanwhile.
    required : float
        Distance that proves the bodies apart.
    """

    matrix: Matrix
    position: Row
    spin: Row
    velocity: Row
    half_time: float
    curvature_bound: float
    max_displacement: float
    required: float


def build_hulls(tree: Trees, volume: float) -> Hulls:
    """Build a part's tree with the nodes of its triangles' tree.

    ``volume`` is the volume that the triangles enclose.
    """
    box = tree.boxes[:, :6]
    rows = tree.triangles
    spans = tree.spans
    if not len(rows):
        return Hulls(np.empty((0, 9)), np.empty((0, 5), np.int64), np.empty((3, 0)))
    starts, counts = spans.T
    balls = np.linalg.norm(box[:, 3:], axis=1)
    radii = node_maxima(np.maximum(rows[:, 9], 0.0), spans)
    boxes = np.column_stack([box, balls, radii, np.zeros(len(box))])
    nodes = np.zeros((len(box), 5), dtype=np.int64)
    leaf = counts == 1
    inside = np.flatnonzero(~leaf)
    nodes[inside, 0] = inside + 2 * (counts[inside] // 2)
    nodes[inside, 4] = inside + 1
    corners, firsts = _row_corners(rows)
    nodes[leaf, 1] = firsts[starts[leaf]]
    nodes[leaf, 2] = firsts[starts[leaf] + 1]
    # Boxes and balls are solid, so each is a whole connected part.
    nodes[:, 3] = bool(((rows[:, 9] < 0.0) | _are_balls(rows)).all())
    nodes[0, 3] = 1
    if nodes[:, 3].all():
        return Hulls(boxes, nodes, np.ascontiguousarray(corners.T))
    parents = np.zeros(len(box), dtype=np.int64)
    parents[inside + 1] = parents[nodes[inside, 0]] = inside
    ranks = np.searchsorted(MAX_TRIANGLES_PER_TILE * HULL_BRANCHING ** np.arange(12), counts)
    has_hull = ranks < ranks[parents]
    has_hull[0] = True
    points, which = np.unique(corners, axis=0, return_inverse=True)
    is_rounded = bool(rows[:, 9].any())
    parts = [corners]
    stop = len(corners)
    for node in np.flatnonzero(has_hull & ~leaf).tolist():
        first, last = firsts[[starts[node], starts[node] + counts[node]]].tolist()
        hull = points[np.unique(which.ravel()[first:last])]
        is_tile = ranks[node] == 0
        if is_rounded and not is_tile:
            continue
        depth = boxes[node, 3:6].min()
        if not is_rounded and (node == 0 or not is_tile):
            fit = _fit_hull(hull)
            hull = fit.corners
            depth = fit.depth
            boxes[node, 7] = fit.growth
            is_convex = node == 0 and volume > (1.0 - 1e-9) * fit.volume
            if len(hull) > MAX_HULL_CORNERS:
                continue
            if is_convex:
                links = np.array([[0, 0, len(hull), 1, 0]])
                return Hulls(boxes[:1], links, np.ascontiguousarray(hull.T))
        boxes[node, 8] = depth
        nodes[node, 1] = stop
        nodes[node, 2] = stop + len(hull)
        parts.append(hull)
        stop += len(hull)
    return Hulls(boxes, nodes, np.ascontiguousarray(np.concatenate(parts).T))


def _are_balls(rows: Floats) -> Bools:
    """Return whether each row has three equal corners."""
    return np.asarray((rows[:, 3:9] == np.tile(rows[:, :3], 2)).all(axis=1))


def _row_corners(rows: Floats) -> tuple[Floats, Ints]:
    """Return the corners of all rows, and each row's first corner.

    Triangles have three corners, balls one, boxes eight, and axis-aligned boxes none.
    """
    is_box = rows[:, 9] < 0.0
    is_ball = _are_balls(rows)
    is_aligned = ~rows[:, [4, 5, 6, 8]].any(axis=1)
    counts = np.select([is_box & is_aligned, is_box, is_ball], [0, 8, 1], 3)
    places = np.arange(counts.max())
    corners = rows[:, :9].reshape(-1, 3, 3)[:, np.minimum(places, 2)]
    tilted = rows[counts == 8]
    if len(tilted):
        corners[counts == 8] = tilted[:, None, :3] + _SIGNS @ half_axes(tilted)
    return corners[places < counts[:, None]], np.append(0, np.cumsum(counts))


class HullFit(NamedTuple):
    """Convex hull of points.

    The hull of the ``corners``, shape (n, 3), grown by ``growth``, contains all points. ``depth``
    is the largest depth of a point in it. Metres.
    """

    corners: Floats
    volume: float
    depth: float
    growth: float


def _fit_hull(points: Floats) -> HullFit:
    """Fit a convex hull to points; a flat set keeps all points and has infinite volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return HullFit(points, math.inf, 0.0, 0.0)
    normals = hull.equations[:, :3]
    offsets = hull.equations[:, 3]
    heights = np.concatenate(
        [(part @ normals.T + offsets).max(axis=1) for part in _in_blocks(points, len(normals))]
    )
    # Qhull leaves out points on faces and edges; by rounding, they may lie beside the hull.
    left_out = np.ones(len(points), dtype=np.bool_)
    left_out[hull.vertices] = False
    beside = points[left_out & (heights > -1e-9 * np.ptp(points, axis=0).max())]
    growth = _largest_gap(beside, hull.points[hull.simplices])
    if len(beside):
        growth += HULL_ROUNDING * float(np.abs(points).max())
    return HullFit(points[hull.vertices], float(hull.volume), -float(heights.min()), growth)


def _largest_gap(points: Floats, triangles: Floats) -> float:
    """Return an upper bound of the points' distances from their nearest triangles.

    Each point is compared with one point of each triangle: the nearest one if that is not on the
    border, and otherwise one near it.
    """
    origins = triangles[:, 0]
    inverses = np.linalg.pinv(triangles[:, 1:] - triangles[:, :1])
    largest = 0.0
    for part in _in_blocks(points, len(triangles)):
        coordinates = np.einsum("pni,nij->pnj", part[:, np.newaxis] - origins, inverses)
        first = 1.0 - coordinates.sum(axis=2, keepdims=True)
        weights = np.maximum(np.concatenate([first, coordinates], axis=2), 0.0)
        weights /= weights.sum(axis=2, keepdims=True)
        members = np.einsum("pnk,nki->pni", weights, triangles)
        gaps = np.linalg.norm(members - part[:, np.newaxis], axis=2)
        largest = max(largest, float(gaps.min(axis=1).max(initial=0.0)))
    return largest


def _in_blocks(points: Floats, others: int) -> list[Floats]:
    """Split points so that each block has few pairs with ``others`` planes or triangles."""
    return np.array_split(points, len(points) * others // MAX_PAIRS_PER_BLOCK + 1)


def join_roots(boxes: Floats, roots: Ints, start: int) -> tuple[Floats, Ints]:
    """Build the nodes above several roots, whose boxes have shape (n, 9).

    Returns rows of :attr:`Hulls.boxes` and :attr:`Hulls.nodes` for the nodes from ``start`` on; the
    first is the root.
    """
    box, order, spans = build_boxes(boxes[:, :3] - boxes[:, 3:6], boxes[:, :3] + boxes[:, 3:6])
    inner = np.flatnonzero(spans[:, 1] > 1)
    numbers = roots[order[spans[:, 0]]]  # of leaves; the first root of other nodes is replaced
    numbers[inner] = start + np.arange(len(inner))
    nodes = np.zeros((len(inner), 5), dtype=np.int64)
    nodes[:, 0] = numbers[inner + 2 * (spans[inner, 1] // 2)]
    nodes[:, 3] = 1
    nodes[:, 4] = numbers[inner + 1]
    rows = np.zeros((len(inner), 9))
    rows[:, :6] = box[inner]
    rows[:, 6] = np.linalg.norm(box[inner, 3:], axis=1)
    return rows, nodes


def node_corners(hulls: Hulls, node: int) -> tuple[Floats, float]:
    """Return corners, shape (n, 3), and radius of a node's hull.

    A node without a hull has the corners of its box; metres.
    """
    first, stop = hulls.nodes[node, 1:3].tolist()
    if first < stop:
        return hulls.corners[:, first:stop].T, float(hulls.boxes[node, 7])
    box = hulls.boxes[node]
    return box[:3] + _SIGNS * box[3:6], 0.0


@kernel
def tree_slack(
    hulls: Hulls,
    one: int,
    other: int,
    motion: RelativeMotion,
    axes: Floats,
    enough: float,
    scratch: Ints,
) -> float:
    """Return a lower bound of (distance - required distance) between trees.

    The bound is capped at ``enough``. The motion is the first tree's, as seen from the second. For
    a box of configurations, ``axes`` are the joints that move the first tree
    (:func:`cspace.bodies.triangles.joint_displacement`), and the motion has ``half_time`` 0; a
    motion has none. The result is negative if a pair of nodes is not proven to stay apart, and -inf
    if a pair is not apart at the central moment. That pair becomes row 0 of ``scratch``, shape
    (MAX_PENDING_PAIRS, 2), which otherwise is -1. Row 1 then starts with 1 if pieces of connected
    parts were proven apart separately.
    """
    best = enough
    partial = False
    moves = False
    scratch[0, 0] = scratch[0, 1] = -1
    scratch[1, 0] = one
    scratch[1, 1] = other
    top = 2
    while top > 1:
        top -= 1
        a, b = scratch[top, 0], scratch[top, 1]
        # Boxes suffice for most nodes.
        slack, speed, center = box_slack(hulls.boxes[a], hulls.boxes[b], motion, axes, best)
        apart = True
        if slack <= best and has_hull(hulls, a) and has_hull(hulls, b):
            offset = minus(row_at(hulls.boxes[b], 0), center)
            slack, apart = hull_slack(hulls, a, b, motion, speed, best, offset)
        if slack > best:
            partial = partial or hulls.nodes[a, 3] + hulls.nodes[b, 3] < 2
            continue
        if not is_final(hulls, a, b, axes, apart, slack):
            split_pair(hulls, a, b, center, scratch, top)
            top += 2
            continue
        scratch[0, 0] = a
        scratch[0, 1] = b
        if apart and motion.half_time > 0.0:
            # The caller halves the motion next unless its central moment is blocked, so test only
            # that now.
            matrix, position, spin, velocity = motion[:4]
            motion = RelativeMotion(
                matrix, position, spin, velocity, 0.0, 0.0, 0.0, motion.required
            )
            moves = True
            continue
        best = min(slack, best - 1e-300) if apart else -math.inf
        if best <= 0.0:
            break
    scratch[1, 0] = 1 if partial else 0
    return min(best, -1e-300) if moves else best


@kernel
def is_final(hulls: Hulls, a: int, b: int, axes: Floats, apart: bool, slack: float) -> bool:
    """Return True if the children of two nodes are no better: leaves, or too long a motion."""
    if not (has_hull(hulls, a) and has_hull(hulls, b)):
        return False
    if hulls.nodes[a, 0] == 0 and hulls.nodes[b, 0] == 0:
        return True
    # The children may be apart even if the hulls are not, unless the motion is too long.
    loose = hulls.boxes[a, 8] + hulls.boxes[b, 8]
    for k in range(len(axes)):
        loose += 2.0 * axes[k, 6] * hulls.boxes[a, 6]
    return bool(apart and slack + loose < 0.0)


@kernel
def box_slack(
    box: Floats, fixed: Floats, motion: RelativeMotion, axes: Floats, enough: float
) -> tuple[float, float, Row]:
    """Return the slack of two nodes by their boxes, or by the first one's ball.

    The ball counts if its slack is below ``enough``.

    Also returns a bound of the displacement of the first node, and its center.
    """
    half_time = motion.half_time
    most = motion.max_displacement
    x, y, z = center = apply_pose(motion.matrix, motion.position, row_at(box, 0))
    hx, hy, hz = box_extent(motion.matrix, row_at(box, 3))
    u, v, w = drift = add_scaled(motion.velocity, cross(motion.spin, center), 1.0)
    swing = half_time * math.sqrt(dot(motion.spin, motion.spin)) * box[6] + motion.curvature_bound
    swing += joint_displacement(axes, center, box[6])
    dx = abs(x - fixed[0]) - fixed[3]
    dy = abs(y - fixed[1]) - fixed[4]
    dz = abs(z - fixed[2]) - fixed[5]
    along_x = dx - hx - min(half_time * abs(u) + swing, most)
    along_y = dy - hy - min(half_time * abs(v) + swing, most)
    along_z = dz - hz - min(half_time * abs(w) + swing, most)
    slack = max(along_x, along_y, along_z) - motion.required
    speed = min(half_time * math.sqrt(dot(drift, drift)) + swing, most)
    if slack <= enough:
        outside = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
        slack = math.sqrt(dot(outside, outside)) - box[6] - motion.required - speed
    return slack, speed, center


@kernel
def has_hull(hulls: Hulls, node: int) -> bool:
    """Return True if a node has a convex hull; leaves without corners fill their box."""
    return bool(hulls.nodes[node, 0] == 0 or hulls.nodes[node, 2] > 0)


@kernel
def split_pair(hulls: Hulls, a: int, b: int, center: Row, scratch: Ints, row: int) -> None:
    """Write the two pairs of a node and the children of the other node to ``scratch``.

    A node without a hull is split first, then the larger node. ``center`` is that of node a, as
    seen from node b.
    """
    a_is_plain = not has_hull(hulls, a)
    b_is_plain = not has_hull(hulls, b)
    splits_a = hulls.boxes[a, 6] >= hulls.boxes[b, 6] if a_is_plain == b_is_plain else a_is_plain
    if hulls.nodes[b, 0] == 0 or (hulls.nodes[a, 0] > 0 and splits_a):
        scratch[row, 0] = hulls.nodes[a, 0]
        scratch[row, 1] = b
        scratch[row + 1, 0] = hulls.nodes[a, 4]
        scratch[row + 1, 1] = b
        return
    # The nearer child comes last, so that it is tested first and its bound prunes the other.
    nearer = hulls.nodes[b, 4]
    farther = hulls.nodes[b, 0]
    to_one = minus(center, row_at(hulls.boxes[nearer], 0))
    to_other = minus(center, row_at(hulls.boxes[farther], 0))
    if dot(to_one, to_one) > dot(to_other, to_other):
        nearer, farther = farther, nearer
    scratch[row, 0] = a
    scratch[row, 1] = farther
    scratch[row + 1, 0] = a
    scratch[row + 1, 1] = nearer


@kernel
def hull_slack(
    hulls: Hulls, a: int, b: int, motion: RelativeMotion, speed: float, enough: float, n: Row
) -> tuple[float, bool]:
    """Return :func:`tree_slack` of two hulls, and whether they are apart at the central moment.

    ``speed`` bounds the displacement of the first hull. ``n``, of any length or zero, is the first
    direction tried.
    """
    required = motion.required + hulls.boxes[a, 7] + hulls.boxes[b, 7]
    best = -math.inf
    gap = -math.inf
    length = math.inf
    count = 0
    p = q = r = (0.0, 0.0, 0.0)
    for _ in range(MAX_GJK_STEPS):
        square = dot(n, n)
        if not 1e-200 < square < math.inf:
            if count:
                break
            n = (1.0, 0.0, 0.0)
            square = 1.0
        n = scale_vector(n, 1.0 / math.sqrt(square))
        one, high = support_point(hulls, a, rotate_back(motion.matrix, n))
        other, low = support_point(hulls, b, scale_vector(n, -1.0))
        gap_along = -low - high - dot(n, motion.position)
        if gap_along - required > gap:
            gap = gap_along - required
            best = max(
                best, slack_along(hulls, a, motion, n, low, (gap_along, required, speed, enough))
            )
            if best > enough:
                break
        # The distance is at least any gap between projections, and at most the length of the vector
        # found.
        if length <= required:
            break
        hoped = best + length - required - gap
        if gap > 0.0 and speed > 0.0 and hoped <= enough:
            best = hoped
            break
        if count and length - gap_along <= 1e-10 * length:
            break
        n, p, q, r, count = nearest_in_simplex(
            minus(other, apply_pose(motion.matrix, motion.position, one)), p, q, r, count
        )
        before = length
        length = math.sqrt(dot(n, n))
        if count == 4 or not length < before:
            break
    return best, gap > 0.0


@kernel
def slack_along(
    hulls: Hulls,
    a: int,
    motion: RelativeMotion,
    n: Row,
    low: float,
    limits: tuple[float, float, float, float],
) -> float:
    """Return the slack along n: of any motion up to a speed, or of the linear motion if larger.

    ``low`` is the coordinate of the second hull along -n. ``limits`` are the central gap, the
    required distance, the speed, and the slack that is enough.
    """
    gap, required, speed, enough = limits
    slack = gap - required - speed
    bend = motion.curvature_bound
    # Along n the motion may be shorter than ``speed``.
    if slack <= enough and gap - required - bend > enough and motion.half_time > 0.0:
        for step in (-motion.half_time, motion.half_time):
            m = add_scaled(n, cross(n, motion.spin), step)
            _, top = support_point(hulls, a, rotate_back(motion.matrix, m))
            end = -low - top - dot(m, motion.position) - step * dot(n, motion.velocity)
            gap = min(gap, end)
        slack = max(slack, gap - required - bend)
    return slack


@kernel
def support_point(hulls: Hulls, node: int, n: Row) -> tuple[Row, float]:
    """Return the farthest corner of a hull along n.

    Also returns its coordinate along n.
    """
    first = hulls.nodes[node, 1]
    stop = hulls.nodes[node, 2]
    best = -math.inf
    at = 0
    x, y, z = n
    if first == stop:
        # A leaf that fills its axis-aligned box has no stored corners.
        box = hulls.boxes[node]
        corner = (
            box[0] + math.copysign(box[3], x),
            box[1] + math.copysign(box[4], y),
            box[2] + math.copysign(box[5], z),
        )
        return corner, dot(corner, n)
    xs, ys, zs = hulls.corners[0], hulls.corners[1], hulls.corners[2]
    for k in range(first, stop):
        far = x * xs[k] + y * ys[k] + z * zs[k]
        if far > best:
            best = far
            at = k
    return (xs[at], ys[at], zs[at]), best


@kernel
def nearest_in_simplex(
    new: Row, a: Row, b: Row, c: Row, count: int
) -> tuple[Row, Row, Row, Row, int]:
    """Add a corner to a simplex; find its point nearest the origin.

    The simplex has ``count`` corners, from 0 to 3, among ``a``, ``b`` and ``c``; unused places
    repeat a corner. Returns the nearest point, three corners of its face, padded likewise, and
    their number. The number is 4 if the tetrahedron contains the origin; the point then has no
    meaning. E. G. Gilbert, D. W. Johnson and S. S. Keerthi, 1988 (GJK).
    """
    if count < 2:
        return nearest_in_triangle(new, a if count else new, a if count else new)
    if count == 2:
        return nearest_in_triangle(new, a, c)  # b repeats a or c
    # Find the barycentric weights of the origin by Cramer's rule; the new corner has the remaining
    # weight.
    origin = scale_vector(new, -1.0)
    to_a = minus(a, new)
    to_b = minus(b, new)
    to_c = minus(c, new)
    volume = dot(to_a, cross(to_b, to_c))
    weight_a = dot(origin, cross(to_b, to_c)) / volume
    weight_b = dot(to_a, cross(origin, to_c)) / volume
    weight_c = dot(to_a, cross(to_b, origin)) / volume
    is_inside = min(weight_a, weight_b, weight_c) >= 0.0 and weight_a + weight_b + weight_c <= 1.0
    if volume != 0.0 and is_inside:
        return origin, a, b, c, 4
    # Skip the face (a, b, c): the new corner lies on the origin's side of it, so a nearer point is
    # on another face.
    best = nearest_in_triangle(new, a, b)
    for first, second in ((b, c), (c, a)):
        other = nearest_in_triangle(new, first, second)
        if dot(other[0], other[0]) < dot(best[0], best[0]):
            best = other
    return best


@kernel
def nearest_in_triangle(a: Row, b: Row, c: Row) -> tuple[Row, Row, Row, Row, int]:
    """Find the point of a triangle nearest the origin.

    Returns as :func:`nearest_in_simplex`; corners may coincide.
    """
    s, t = triangle_weights(a, b, c)
    if s == 0.0 and t == 0.0:
        return a, a, a, a, 1
    if s == 1.0:
        return b, b, b, b, 1
    if t == 1.0:
        return c, c, c, c, 1
    ab, ac = minus(b, a), minus(c, a)
    if t == 0.0:
        return add_scaled(a, ab, s), a, b, b, 2
    if s == 0.0:
        return add_scaled(a, ac, t), a, c, c, 2
    if s + t == 1.0:
        return add_scaled(b, minus(c, b), t), b, c, c, 2
    n = cross(ab, ac)
    return scale_vector(n, dot(n, a) / dot(n, n)), a, b, c, 3

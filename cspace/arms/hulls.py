"""Hulls: convex bodies around the triangles of a solid, in trees, and compiled proofs that two of them stay apart.

Each node of a tree has a box and a ball that hold all of its triangles, and some nodes have the corners of a convex
hull of them, grown by a radius: the whole of a part and large pieces of it, by as many of their corners as tell their
shape; a few triangles that lie together; and single triangles. What is convex, as a box or a cylinder is, is one node.

*What is proven.* For any vector n, two sets are at least as far apart as their projections onto a line along n, and the
projection of a hull is that of its corners, grown by its radius. So nothing depends on where n comes from: it is that
of the last time, or the way between the nearest points of two hulls, which is found by their differences' corners (E.
G. Gilbert, D. W. Johnson and S. S. Keerthi, "A fast procedure for computing the distance between complex objects in
three-dimensional space", 1988).

*Motions.* As seen from the other one, a body moves at a moment as one that turns: a point p at the velocity ``v + w x
p``, of which the part along n is ``n.v + (n x w).p``. Let h be the time to either side, and ``curvature_bound`` half
the square of h times a bound of all accelerations. Then the place of p along n stays between those of p plus and minus
h times that velocity, give or take that bound. That is linear in p, so that two more shadows, along ``n + h (n x w)``
and ``n - h (n x w)``, bound the whole motion. Before that a cheaper bound is tried: the speed of the node's middle,
and that of its ball about it.

*Rounding.* The shadow of a corner passes a product of a matrix and a vector, and a scalar product: with u = 2^-53, it
is off by less than 16 u times the coordinates and the length of n, which is one but for 4 u. Below 2^-48 of the
coordinates in all, and the allowance :data:`cspace.exact.ROUNDING` is 2^-40; what placing the bodies costs is told in
:mod:`cspace.arms.chain`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Floats, Ints, Matrix, Row
from cspace.compiling import always_inline, kernel
from cspace.exact.triangles import bound_rows, build_boxes, node_maxima
from cspace.kernels import (
    THIN,
    add_scaled,
    apply_pose,
    box_extent,
    cross,
    dot,
    minus,
    point_triangle,
    rotate_back,
    row_at,
    scale_vector,
    triangle_weights,
)

TILE: Final = 16
"""Triangles that lie together and are tested as one hull, at most."""

WIDE: Final = 16
"""How many times as many triangles as the hulls below it has a hull has, at most."""

FULL: Final = 192
"""Corners of a part of nothing else, which stay as they are; of more, those farthest in so many directions."""

FEW: Final = 48
"""The same of all else, which is taken apart where the hull is too large."""

FLAT: Final = 2.0**-37
"""Growth of a hull from which corners were left out, relative to its size: the rounding of :func:`point_triangle`."""

STEPS: Final = 40
"""Corners of a difference after which the way between the nearest points is good enough."""

CACHED: Final = 256
"""Pairs of hulls whose separating direction is cached."""


class Hulls(NamedTuple):
    """Trees of hulls.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 9)
        The middle and half the sides of each node's box, the radius of its ball about the same middle, that by which
        its hull is grown, and about how much the hull is larger than what it holds.
    nodes : ndarray of int64, shape (m, 4)
        The second child, or 0 for a leaf; the first one is the next node. The first corner of the hull and that after
        its last one: both are 0 where there is none, and equal for a leaf that is all of its box. Whether it has all
        that hangs together with what it has.
    corners : ndarray of float64, shape (3, n)
    """

    boxes: Floats
    nodes: Ints
    corners: Floats


class RelativeMotion(NamedTuple):
    """How a body is placed and moves, as seen from another one.

    Attributes
    ----------
    matrix : tuple of tuple of float
        Rows of its rotation matrix.
    place : tuple of float
    spin, drift : tuple of float
        A point p moves at ``drift + spin x p`` at the moment.
    half : float
        The time to either side that the proof covers.
    curvature_bound : float
        Maximum deviation from that linear motion meanwhile.
    max_displacement : float
        Maximum displacement of any of its points meanwhile.
    least : float
        What a distance has to exceed.
    """

    matrix: Matrix
    place: Row
    spin: Row
    drift: Row
    half: float
    curvature_bound: float
    max_displacement: float
    least: float


def hulls_of(rows: Floats, volume: float) -> Hulls:
    """The tree of a part, by its triangles, or the boxes or balls that it is, and the volume that triangles enclose.

    They are rows of a tree (:attr:`cspace.exact.triangles.Trees.triangles`).
    """
    if not len(rows):
        return Hulls(np.empty((0, 9)), np.empty((0, 4), np.int64), np.empty((3, 0)))
    box, order, spans = build_boxes(*bound_rows(rows))
    rows, (starts, counts) = rows[order], spans.T
    boxes = np.column_stack(
        [box, np.linalg.norm(box[:, 3:], axis=1), node_maxima(np.maximum(rows[:, 9], 0.0), spans), 0.0 * starts]
    )
    nodes, leaf = np.zeros((len(box), 4), dtype=np.int64), counts == 1
    inside = np.flatnonzero(~leaf)
    nodes[inside, 0] = inside + 2 * (counts[inside] // 2)
    corners, firsts = _corners(rows)
    nodes[leaf, 1], nodes[leaf, 2] = firsts[starts[leaf]], firsts[starts[leaf] + 1]
    # Boxes and balls are solid: none of them has another part.
    nodes[:, 3] = bool(((rows[:, 9] < 0.0) | (rows[:, :9] == np.tile(rows[:, :3], 3)).all(axis=1)).all())
    nodes[0, 3] = 1
    if nodes[:, 3].all():
        return Hulls(boxes, nodes, np.ascontiguousarray(corners.T))
    points, which = np.unique(corners, axis=0, return_inverse=True)
    above = np.zeros(len(box), dtype=np.int64)
    above[inside + 1] = above[nodes[inside, 0]] = inside
    ranks = np.searchsorted(TILE * WIDE ** np.arange(12), counts)
    has_hull = ranks < ranks[above]
    has_hull[0] = True
    parts, stop = [corners], len(corners)
    large = np.flatnonzero(has_hull & ((ranks > 0) | (above == np.arange(len(box))))).tolist()
    for node in [] if rows[:, 9].any() else large:
        own = points[np.unique(which.ravel()[firsts[starts[node]] : firsts[starts[node] + counts[node]]])]
        hull, grown, depth, is_whole = _hull_of(own, -1.0 if node else volume)
        boxes[node, 7], boxes[node, 8] = grown, grown + depth
        if is_whole and grown <= 2.0 * FLAT * np.ptp(points, axis=0).max():
            boxes[0, 8] = 0.0
            return Hulls(boxes[:1], np.array([[0, 0, len(hull), 1]]), np.ascontiguousarray(hull.T))
        nodes[node, 1], nodes[node, 2], stop = stop, stop + len(hull), stop + len(hull)
        parts.append(hull)
    tiles = np.flatnonzero(~leaf & has_hull & (ranks == 0) & (nodes[:, 2] == 0))
    few = np.concatenate([np.arange(0), *(np.arange(firsts[s], firsts[s + c]) for s, c in spans[tiles].tolist())])
    tile = np.repeat(np.arange(len(tiles)), firsts[(starts + counts)[tiles]] - firsts[starts[tiles]])
    as_contiguous = np.unique(tile * len(points) + which.ravel()[few])
    stops = stop + np.searchsorted(as_contiguous, len(points) * np.arange(len(tiles) + 1))
    nodes[tiles, 1], nodes[tiles, 2], boxes[tiles, 8] = stops[:-1], stops[1:], boxes[tiles, 3:6].min(axis=1)
    return Hulls(boxes, nodes, np.ascontiguousarray(np.concatenate([*parts, points[as_contiguous % len(points)]]).T))


def _corners(rows: Floats) -> tuple[Floats, Ints]:
    """Corners of triangles, one of balls, eight of boxes but none of those along the axes; where each begins."""
    is_box, is_ball = rows[:, 9] < 0.0, (rows[:, :9] == np.tile(rows[:, :3], 3)).all(axis=1)
    u, v = rows[:, 3:6], rows[:, 6:9]
    upright = is_box & ~u[:, 1:].any(axis=1) & ~v[:, ::2].any(axis=1)
    counts = np.where(upright, 0, np.where(is_box, 8, np.where(is_ball, 1, 3)))
    firsts = np.append(0, np.cumsum(counts))
    corners = np.empty((int(firsts[-1]), 3))
    for k in range(3):
        chosen = counts > k if k == 0 else counts == 3
        chosen &= ~is_box
        corners[firsts[:-1][chosen] + k] = rows[chosen, 3 * k : 3 * k + 3]
    tilted = is_box & ~upright
    w = np.cross(u[tilted], v[tilted])
    w *= (rows[tilted, 9] / np.linalg.norm(w, axis=1))[:, None]
    for k in range(8):
        signs = 1.0 - 2.0 * np.array([k & 1, k >> 1 & 1, k >> 2])
        corner = rows[tilted, :3] + signs[0] * u[tilted] + signs[1] * v[tilted] + signs[2] * w
        corners[firsts[:-1][tilted] + k] = corner
    return corners, firsts


def _hull_of(points: Floats, volume: float) -> tuple[Floats, float, float, bool]:
    """Some points, by how much their hull must grow to hold all, how deep one lies in it, and whether that is all.

    Metres. It is all where so much volume is enclosed, below zero of a piece. A flat set has all of its points.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return points, 0.0, 0.0, False
    corners, is_whole = points[hull.vertices], volume > (1.0 - 1e-9) * float(hull.volume)
    count = FULL if is_whole or (volume >= 0.0 and len(corners) == len(points)) else FEW
    if len(corners) > count:
        # Directions spread evenly over a sphere, along Fibonacci's spiral.
        k = np.arange(count) + 0.5
        z, angle = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
        directions = np.stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z])
        corners = corners[np.unique((corners @ directions).argmax(axis=0))]
        hull = ConvexHull(corners)
    if len(corners) == len(points):
        return corners, 0.0, 0.0, is_whole
    parts = np.array_split(points, len(points) // 4096 + 1)  # of which the heights above all planes fit a cache
    heights = np.concatenate([(part @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1) for part in parts])
    size = float(np.ptp(points, axis=0).max())
    outside = points[heights > -1e-9 * size]
    sides = hull.points[hull.simplices]
    # Of thin triangles distances may be too small; without them they are too large at worst.
    edges = np.roll(sides, -1, axis=1) - sides
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    thin = areas <= 2.0 * THIN * (edges**2).sum(axis=2).max(axis=1)
    grown = farthest(outside, sides[~thin]) + FLAT * size
    return corners, grown, float(-heights.min()), is_whole


@kernel
def farthest(points: Floats, triangles: Floats) -> float:
    """How far the farthest point is from the nearest one of some triangles, none of which is thin."""
    largest = 0.0
    for p in range(len(points)):
        apart = math.inf
        for t in range(len(triangles)):
            apart = min(apart, point_triangle(row_at(points[p], 0), triangles[t]))
        largest = max(largest, apart)
    return largest


def forest_of(solids: Sequence[Sequence[Hulls]]) -> tuple[Hulls, Ints, Ints]:
    """A tree for each solid, of its parts; their roots, and the first node of each part, in order; -1 for none."""
    boxes, nodes, corners = [np.empty((0, 9))], [np.empty((0, 4), np.int64)], [np.empty((3, 0))]
    roots, firsts, size, count = list[int](), list[int](), 0, 0

    def add(parts: list[tuple[int, Hulls]]) -> None:
        nonlocal size, count
        if len(parts) == 1:
            ((number, part),) = parts
            firsts[number], shift = size, (part.nodes > 0) * np.array([size, count, count, 0])
            shift[:, 1] = shift[:, 2]
            boxes.append(part.boxes)
            nodes.append(part.nodes + shift)
            corners.append(part.corners)
            size, count = size + len(part.nodes), count + part.corners.shape[1]
            return
        extents = np.stack([part.boxes[0, :6] for _, part in parts])
        low, high = (extents[:, :3] - extents[:, 3:]).min(axis=0), (extents[:, :3] + extents[:, 3:]).max(axis=0)
        order = extents[:, int((high - low).argmax())].argsort(kind="stable").tolist()
        half, sides = len(order) // 2, 0.5 * (high - low)
        boxes.append(np.array([[*(0.5 * (low + high)), *sides, np.linalg.norm(sides), 0.0, 0.0]]))
        nodes.append(row := np.array([[0, 0, 0, 1]]))
        size += 1
        add([parts[k] for k in order[:half]])
        row[0, 0] = size
        add([parts[k] for k in order[half:]])

    for solid in solids:
        filled = [(len(firsts) + k, part) for k, part in enumerate(solid) if len(part.nodes)]
        firsts += [-1] * len(solid)
        roots.append(size if filled else -1)
        if filled:
            add(filled)
    hulls = Hulls(np.concatenate(boxes), np.concatenate(nodes), np.ascontiguousarray(np.concatenate(corners, axis=1)))
    return hulls, np.array(roots, dtype=np.int64), np.array(firsts, dtype=np.int64)


def corners_of(hulls: Hulls, node: int) -> tuple[Floats, float]:
    """The corners of a node's hull, or of its box where it has none, shape (n, 3), and its radius, metres."""
    _, first, stop, _ = hulls.nodes[node].tolist()
    if first < stop:
        return hulls.corners[:, first:stop].T, float(hulls.boxes[node, 7])
    box, signs = hulls.boxes[node], np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return box[:3] + signs * box[3:6], 0.0


@kernel
def least_excess(
    hulls: Hulls, one: int, other: int, flight: RelativeMotion, enough: float, work: Ints, directions: Floats
) -> float:
    """By how much what is apart exceeds what it has to, ``enough`` at most, in the trees of a body and of another one.

    The body is the one that the flight is of. Below zero where one pair of nodes is not proven to stay apart, and
    minus infinity where one is not apart in the middle of a motion, all of which is looked at. The pair is then the
    first row of ``work``, shape (DEPTH, 6), and tested first the next time. Row 1 begins with 1 if parts of what hangs
    together were looked at alone. ``directions``, shape (CACHED, 4), caches along what hulls were apart.
    """
    best, top, last, known, beside = enough, 1, -1, work[0, 0], work[0, 1]
    (wx, wy, wz), (vx, vy, vz) = flight.spin, flight.drift
    turn, least = math.sqrt(wx * wx + wy * wy + wz * wz), flight.least
    mx, my, mz, hx, hy, hz, sx, sy, sz, speed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    partial = proven = moves = False
    work[1, 0], work[1, 1], work[2, 0], work[2, 1] = one, other, known, beside
    top += 2 if known >= 0 else 1
    while top > 1:
        top -= 1
        a, b = work[top, 0], work[top, 1]
        again = a == known and b == beside
        if again and proven:
            continue
        proven = proven or again
        box, still = hulls.boxes[a], hulls.boxes[b]
        if a != last:
            last = a
            mx, my, mz = apply_pose(flight.matrix, flight.place, row_at(box, 0))
            hx, hy, hz = box_extent(flight.matrix, row_at(box, 3))
            # How far the node can move, along each axis and in all.
            x, y, z = vx + wy * mz - wz * my, vy + wz * mx - wx * mz, vz + wx * my - wy * mx
            half, max_displacement = flight.half, flight.max_displacement
            swing = half * turn * box[6] + flight.curvature_bound
            sx, sy, sz = (
                min(half * abs(x) + swing, max_displacement),
                min(half * abs(y) + swing, max_displacement),
                min(half * abs(z) + swing, max_displacement),
            )
            speed = min(half * math.sqrt(x * x + y * y + z * z) + swing, max_displacement)
        whole = hulls.nodes[a, 3] + hulls.nodes[b, 3] == 2
        dx, dy, dz = abs(mx - still[0]) - still[3], abs(my - still[1]) - still[4], abs(mz - still[2]) - still[5]
        excess = max(dx - hx - sx, dy - hy - sy, dz - hz - sz) - least
        if excess <= best:
            # The ball about the node, and the other one's box.
            dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
            excess = math.sqrt(dx * dx + dy * dy + dz * dz) - box[6] - least - speed
        if excess > best:
            partial = partial or not whole
            continue
        after, behind = hulls.nodes[a, 0], hulls.nodes[b, 0]
        held, beheld = after == 0 or hulls.nodes[a, 2] > 0, behind == 0 or hulls.nodes[b, 2] > 0
        if held and beheld:
            n, cached, number = (
                (still[0] - mx, still[1] - my, still[2] - mz),
                directions[(31 * a + b) % CACHED],
                a * 2.0**26 + b,
            )
            if cached[0] == number:
                n = (cached[1], cached[2], cached[3])
            excess, apart, n = excess_between(hulls, a, b, flight, speed, best, n)
            cached[0], cached[1], cached[2], cached[3] = number, n[0], n[1], n[2]
            if excess > best:
                partial = partial or not whole
                continue
            # Its parts may be apart where the hull is not, unless its motion is what is too much.
            loose = box[8] + still[8]
            if (after == 0 and behind == 0) or (apart and excess + loose < 0.0):
                work[0, 0], work[0, 1] = a, b
                if apart and flight.half > 0.0:
                    # A shorter motion is tested next, unless the middle of this one is in the way.
                    flight, moves, last = at_rest(flight), True, -1
                    continue
                best = min(excess, best - 1e-300) if apart else -math.inf
                if best <= 0.0:
                    break
                continue
        # What has no hull is taken apart first, then what is larger.
        if behind == 0 or (after > 0 and (held < beheld or (held == beheld and box[6] >= still[6]))):
            work[top, 0], work[top, 1], work[top + 1, 0], work[top + 1, 1] = after, b, a + 1, b
        else:
            # The nearer one comes last, and is tested first: the other need not prove more than it does.
            one_box, other_box = hulls.boxes[b + 1], hulls.boxes[behind]
            x, y, z = (
                2.0 * mx - one_box[0] - other_box[0],
                2.0 * my - one_box[1] - other_box[1],
                2.0 * mz - one_box[2] - other_box[2],
            )
            near = x * (one_box[0] - other_box[0]) + y * (one_box[1] - other_box[1]) + z * (one_box[2] - other_box[2])
            nearer, farther = (b + 1, behind) if near > 0.0 else (behind, b + 1)
            work[top, 0], work[top, 1], work[top + 1, 0], work[top + 1, 1] = a, farther, a, nearer
        top += 2
    work[1, 0] = 1 if partial else 0
    return min(best, -1e-300) if moves else best


@always_inline
def at_rest(flight: RelativeMotion) -> RelativeMotion:
    """The flight at its middle moment alone, where nothing moves."""
    return RelativeMotion(flight.matrix, flight.place, flight.spin, flight.drift, 0.0, 0.0, 0.0, flight.least)


@kernel
def excess_between(
    hulls: Hulls, a: int, b: int, flight: RelativeMotion, speed: float, enough: float, n: Row
) -> tuple[float, bool, Row]:
    """:func:`least_excess` of two hulls, more or less; whether they are apart in the middle, and along what.

    ``speed`` is by how much the first can move at most, and ``n`` where to begin: no matter how long, or zero.
    """
    least, half = flight.least + hulls.boxes[a, 7] + hulls.boxes[b, 7], flight.half
    best, gap, direction, length, count = -math.inf, -math.inf, n, math.inf, 0
    p = q = r = (0.0, 0.0, 0.0)
    for _ in range(STEPS):
        square = dot(n, n)
        if not 1e-200 < square < math.inf:
            if count:
                break
            n, square = (1.0, 0.0, 0.0), 1.0
        n = scale_vector(n, 1.0 / math.sqrt(square))
        one, high = highest(hulls, a, rotate_back(flight.matrix, n))
        other, low = highest(hulls, b, scale_vector(n, -1.0))
        shadow = -low - high - dot(n, flight.place)
        if shadow - least > gap:
            gap, direction = shadow - least, n
            best = max(best, gap - speed)
            # Along n it may move by less.
            if best <= enough and gap - flight.curvature_bound > enough and half > 0.0:
                tilt, along = scale_vector(cross(n, flight.spin), half), half * dot(n, flight.drift)
                for sign in (1.0, -1.0):
                    m = (n[0] + sign * tilt[0], n[1] + sign * tilt[1], n[2] + sign * tilt[2])
                    _, top = highest(hulls, a, rotate_back(flight.matrix, m))
                    shadow_m = -low - top - dot(m, flight.place) - sign * along
                    shadow = min(shadow, shadow_m)
                best = max(best, shadow - least - flight.curvature_bound)
                shadow = gap + least
            if best > enough:
                break
        # The way between the nearest points is no shorter than any shadow, and no longer than the one that is found.
        if length <= least:
            break
        hoped = best + length - least - gap
        if gap > 0.0 and speed > 0.0 and hoped <= enough:
            best = hoped
            break
        if count and length - shadow <= 1e-10 * length:
            break
        n, p, q, r, count = nearest(minus(other, apply_pose(flight.matrix, flight.place, one)), p, q, r, count)
        before, length = length, math.sqrt(dot(n, n))
        if count == 4 or not length < before:
            break
    return best, gap > 0.0, direction


@kernel
def highest(hulls: Hulls, node: int, n: Row) -> tuple[Row, float]:
    """The corner of a hull that is farthest along a direction, and how far that is."""
    first, stop, best, at = hulls.nodes[node, 1], hulls.nodes[node, 2], -math.inf, 0
    x, y, z = n
    if first == stop:
        # A box along the axes.
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
            best, at = far, k
    return (xs[at], ys[at], zs[at]), best


@kernel
def nearest(w: Row, p: Row, q: Row, r: Row, count: int) -> tuple[Row, Row, Row, Row, int]:
    """The point nearest to the origin of a simplex with one more corner, the corners that it is of, and how many.

    Corners that are not needed repeat others; four are in the way of nothing, for the origin lies between them.
    """
    if count < 2:
        return in_triangle(w, p if count else w, p if count else w)
    if count == 2:
        return in_triangle(w, p, r)
    o = scale_vector(w, -1.0)
    u, v, x = minus(p, w), minus(q, w), minus(r, w)
    volume = dot(u, cross(v, x))
    s, t, y = dot(o, cross(v, x)) / volume, dot(u, cross(o, x)) / volume, dot(u, cross(v, o)) / volume
    if volume != 0.0 and s >= 0.0 and t >= 0.0 and y >= 0.0 and s + t + y <= 1.0:
        return o, p, q, r, 4
    best = in_triangle(w, p, q)
    for one, two in ((q, r), (r, p)):
        other = in_triangle(w, one, two)
        if dot(other[0], other[0]) < dot(best[0], best[0]):
            best = other
    return best


@kernel
def in_triangle(a: Row, b: Row, c: Row) -> tuple[Row, Row, Row, Row, int]:
    """:func:`nearest` of a triangle, whose corners may coincide."""
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

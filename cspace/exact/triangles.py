"""Compiled proofs that the triangles of a robot that moves stay apart from those that do not, in trees of boxes.

A ball is a triangle without size, its middle, grown by its radius; a segment has one corner twice. What does not move
may also be of boxes, which are solid.

*What is proven.* For any vector n, two triangles are at least as far apart as their projections onto a line along n::

    distance >= min n.(b_j - a_0) / |n| - max n.(a_i - a_0) / |n|        over their corners a_i and b_j

and where one moves by less than that, along n, they stay apart. So n may come from anywhere: whatever rounding does to
it, the bound holds for the n that was found, and of triangles without height or length as of all others. It is taken
from what is nearest: the normals of the faces, the way between the nearest points of two edges, and the normal of both;
one of these is along the shortest way from one triangle to the other, so that little is lost. Of a triangle and a box,
the nearest points are found by going from one to the other and back; the normals of faces and of edges decide the rest
(S. Gottschalk, M. C. Lin and D. Manocha, 1996).

*Rounding.* With u = 2^-53 and D the largest distance of any corner from a_0, each ``n.(x - a_0)`` is wrong by at most
4 u |n| D (a difference, a product, two sums), the length of n by 4 u of itself, and the difference, the quotient and
the radii add three roundings of numbers up to D or the radii: below 2^-48 times D and the radii together. Lengths are
multiplied by a power of two that takes the coordinates to about one, and |n| is at least 2^-300: what falls below the
smallest double is far below that. The allowance :data:`cspace.exact.ROUNDING` is more than fifty times as much, placing
the corners included.

The shortest way itself is lost to rounding where edges are all but parallel or faces all but without height. Distances
below a ten-millionth of the edges' lengths may then count as none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cspace.arrays import Floats, Ints, Matrix, Row
from cspace.compiling import always_inline, kernel
from cspace.kernels import box_extent, cross, dot, gap_between, minus, nearest_of_triangle, placed, rotated, row_of
from cspace.shapes import Pieces

Corners = tuple[Row, Row, Row]
Box = tuple[Row, Row, Row, Row]
"""The middle of a box and its half axes."""
LEAST_SQUARE = 2.0**-600
"""Squared length of the shortest vector along which projections are compared."""

DEPTH = 128
"""Pairs of nodes that wait at a time, at most: fewer than the levels of two trees, and a few."""


PAIR = 32
OTHER = 2**PAIR - 1
"""A pair of nodes as one number, the first one in its upper half, and the mask of the other one."""


class Trees(NamedTuple):
    """Triangles in trees of boxes.

    The children of a node with n triangles have the first n // 2 of them, which is the next node, and the others, which
    comes 2 (n // 2) nodes later.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 7)
        The middle and half the sides of each node's box, radii included, and the triangles' longest lever.
    spans : ndarray of int64, shape (m, 2)
        The first triangle of each node, and how many it has.
    triangles : ndarray of float64, shape (n, 10)
        Three corners and a radius; of a box its middle, two half axes, and the length of the third one, below zero.
    """

    boxes: Floats
    spans: Ints
    triangles: Floats


class Motion(NamedTuple):
    """How the robot is placed and moves.

    Attributes
    ----------
    matrix : tuple of tuple of float
        Rows of its rotation matrix.
    place : tuple of float
    step : tuple of float
        By how much it moves, at most either way.
    angle : float
        By how much it turns, at most either way, about its reference point.
    least : float
        What a distance has to exceed.
    slide : float
        By how much its reference point moves besides, at most, in whatever direction.
    """

    matrix: Matrix
    place: Row
    step: Row
    angle: float
    least: float
    slide: float


def trees_of(borders: Sequence[Pieces], about_z: bool) -> tuple[Trees, list[int]]:
    """A tree for each of some sets of triangles, and their roots; levers are about the z axis, or about the origin."""
    levers = [np.linalg.norm(b.simplices[..., : 2 if about_z else 3], axis=-1).max(axis=1) for b in borders]
    return together([tree_of_rows(triangle_rows(b), each) for b, each in zip(borders, levers, strict=True)])


def tree_of_rows(rows: Floats, levers: Floats) -> Trees:
    """A tree of rows of :attr:`Trees.triangles`, and of the lever of each."""
    box, order, spans = boxes_of(*bounds_of_rows(rows))
    return Trees(np.column_stack([box, most(levers[order], spans)]), spans, rows[order])


def together(trees: Sequence[Trees]) -> tuple[Trees, list[int]]:
    """Trees as one, and their roots; -1 of those that have nothing."""
    roots, spans, nodes, rows = list[int](), list[Ints](), 0, 0
    for tree in trees:
        roots.append(nodes if len(tree.boxes) else -1)
        spans.append(tree.spans + np.array([rows, 0]))
        nodes, rows = nodes + len(tree.boxes), rows + len(tree.triangles)
    boxes, triangles = (np.concatenate(parts) for parts in zip(*((t.boxes, t.triangles) for t in trees), strict=True))
    return Trees(boxes, np.concatenate(spans), triangles), roots


def triangle_rows(border: Pieces) -> Floats:
    """Triangles as the rows of a tree, shape (n, 10)."""
    return np.hstack([border.simplices.reshape(-1, 9), border.radii[:, None]])


def box_rows(lows: Floats, highs: Floats, pose: Floats) -> Floats:
    """Boxes along the axes, shapes (n, 3), placed by a pose, shape (4, 4), as the rows of a tree."""
    turn, half = pose[:3, :3], 0.5 * (highs - lows)
    rows = np.empty((len(lows), 10))
    rows[:, :3] = 0.5 * (lows + highs) @ turn.T + pose[:3, 3]
    rows[:, 3:6], rows[:, 6:9], rows[:, 9] = half[:, :1] * turn[:, 0], half[:, 1:2] * turn[:, 1], -half[:, 2]
    return rows


def bounds_of_rows(rows: Floats) -> tuple[Floats, Floats]:
    """The lower and upper corners of what holds each row, shape (n, 3)."""
    is_box = rows[:, 9] < 0.0
    corners, grown = rows[:, :9].reshape(-1, 3, 3), np.maximum(rows[:, 9:], 0.0)
    low, high = corners.min(axis=1) - grown, corners.max(axis=1) + grown
    middle, first, second = np.moveaxis(corners[is_box], 1, 0)
    third = np.cross(first, second)
    third *= (rows[is_box, 9] / np.linalg.norm(third, axis=1))[:, None]
    half = np.abs(first) + np.abs(second) + np.abs(third)
    low[is_box], high[is_box] = middle - half, middle + half
    return low, high


def boxes_of(low: Floats, high: Floats) -> tuple[Floats, Ints, Ints]:
    """The boxes of a tree of what lies between corners, shape (m, 6), the order in which it has them, and which.

    The latter are the first one of each node and how many it has, shape (m, 2).
    """
    n = len(low)
    boxes, order, spans = np.empty((max(2 * n - 1, 0), 6)), np.arange(n), np.empty((max(2 * n - 1, 0), 2), np.int64)
    nodes, starts, counts = np.zeros(1, np.int64), np.zeros(1, np.int64), np.full(1, n)
    ranks = np.argsort(np.argsort(low + high, axis=0), axis=0).ravel()
    while n:
        lower, upper = np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts)
        boxes[nodes, :3], boxes[nodes, 3:] = 0.5 * (lower + upper), 0.5 * (upper - lower)
        spans[nodes, 0], spans[nodes, 1] = starts, counts
        if counts.max() == 1:
            break
        # Each node's triangles in order along its box's longest side; the first half of them go to one side.
        which = np.repeat(np.arange(len(nodes)), counts)
        axis = (upper - lower).argmax(axis=1)[which]
        order = order[np.argsort(which * n + ranks[3 * order + axis])]
        first, split = counts // 2, counts > 1
        there = np.stack([np.ones_like(split), split], axis=1)
        nodes = np.stack([nodes + split, nodes + 2 * first], axis=1)[there]
        starts = np.stack([starts, starts + first], axis=1)[there]
        counts = np.stack([np.where(split, first, 1), counts - first], axis=1)[there]
    return boxes, order, spans


def most(values: Floats, spans: Ints) -> Floats:
    """The largest value of each node of a tree, by those of its triangles."""
    bounds = np.stack([spans[:, 0], spans.sum(axis=1)], axis=1).ravel()
    return np.asarray(np.maximum.reduceat(np.append(values, 0.0), bounds)[::2]) if len(spans) else np.empty(0)


@kernel
def share_apart(trees: Trees, robot: int, others: tuple[int, int], motion: Motion, enough: float, work: Ints) -> float:
    """The part of a motion, ``enough`` at most, within which no triangle of a robot can reach others.

    All are given by the roots of their trees, -1 for none. Below zero where it is too near to them as it is placed.
    ``work``, shape (DEPTH,), is scratch space; its first number is the last pair of triangles that set the bound, which
    is likely to do so again, and -1 before there is one.
    """
    best, last, top, spans = float(enough), -1, 1, trees.spans
    middle = half = (0.0, 0.0, 0.0)
    turn = 0.0
    for other in others:
        if other >= 0:
            work[top] = robot << PAIR | other
            top += 1
    if work[0] >= 0:
        work[top] = work[0]
        top += 1
    while top > 1:
        top -= 1
        pair = work[top]
        a, b = pair >> PAIR, pair & OTHER
        if a != last:
            box, last = trees.boxes[a], a
            middle, half = box_around(motion, box)
            turn = box[6] * motion.angle + motion.slide
        box, n, m = trees.boxes[b], spans[a, 1], spans[b, 1]
        # Boxes that stay apart along one axis: so do all triangles in them.
        apart = False
        for k in range(3):
            gap = abs(middle[k] - box[k]) - half[k] - box[3 + k]
            apart = apart or gap > best * (abs(motion.step[k]) + turn)
        if apart:
            continue
        if n == 1 and m == 1:
            share = share_of_pair(trees.triangles[spans[a, 0]], trees.triangles[spans[b, 0]], motion, turn, best)
            if share < best:
                best, work[0] = share, pair
                if best < 0.0:
                    break
            continue
        # The one with the larger box is taken apart.
        fixed = n == 1 or (m > 1 and box[3] + box[4] + box[5] > half[0] + half[1] + half[2])
        count, shift = (m, 0) if fixed else (n, PAIR)
        first, second = pair + (1 << shift), pair + (2 * (count // 2) << shift)
        if fixed:
            # Its nearer half comes first: less need not be proven of the other.
            one, other, nearer = trees.boxes[first & OTHER], trees.boxes[second & OTHER], 0.0
            for k in range(3):
                nearer += (one[k] - other[k]) * (middle[k] - 0.5 * (one[k] + other[k]))
            if nearer < 0.0:
                first, second = second, first
        work[top], work[top + 1] = second, first
        top += 2
    return best


@always_inline
def box_around(motion: Motion, box: Floats) -> tuple[Row, Row]:
    """Return the middle and half the sides of a box around a node of the robot, grown by ``motion.least``."""
    x, y, z = box_extent(motion.matrix, row_of(box, 3))
    middle = placed(motion.matrix, motion.place, row_of(box, 0))
    return middle, (x + motion.least, y + motion.least, z + motion.least)


@kernel
def share_of_pair(p: Floats, q: Floats, motion: Motion, turn: float, enough: float) -> float:
    """:func:`share_apart` of two triangles, of which the first moves by ``turn`` at most as the robot turns."""
    # All from the first corner of the robot's triangle: it is at the origin.
    p0, matrix = row_of(p, 0), motion.matrix
    zero, p1, p2 = corners_from(p, p0)
    a, b = (zero, rotated(matrix, p1), rotated(matrix, p2)), corners_from(q, placed(matrix, motion.place, p0))
    u, v = sides_of(a), sides_of(b)
    step, least = motion.step, motion.least + p[9] + q[9]
    nearest, normal = math.inf, cross(v[0], v[1])
    best = max(share_along(cross(u[0], u[1]), a, b, step, turn, least), share_along(normal, a, b, step, turn, least))
    # Of a segment or point, which has its last corner twice, one side is all.
    for k in range(3 if dot(u[1], u[1]) > 0.0 else 1):
        for m in range(3 if dot(v[1], v[1]) > 0.0 else 1):
            if best >= enough:
                return enough
            gap = gap_between(a[k], u[k], b[m], v[m])
            square = dot(gap, gap)
            if square < nearest:
                nearest, normal = square, cross(u[k], v[m])
                best = max(best, share_along(gap, a, b, step, turn, least))
    return min(max(best, share_along(normal, a, b, step, turn, least)), enough)


@kernel
def corners_from(q: Floats, origin: Row) -> Corners:
    """The corners of a triangle of a tree, seen from a point."""
    x, y, z = origin
    return (q[0] - x, q[1] - y, q[2] - z), (q[3] - x, q[4] - y, q[5] - z), (q[6] - x, q[7] - y, q[8] - z)


@always_inline
def sides_of(a: Corners) -> Corners:
    """The sides of a triangle, each from its corner to the next one."""
    return minus(a[1], a[0]), minus(a[2], a[1]), minus(a[0], a[2])


@kernel
def share_along(n: Row, a: Corners, b: Corners, step: Row, turn: float, least: float) -> float:
    """Return :func:`share_apart` of triangles by their projections onto a line; -1 if too near, or n is too short.

    Corners are seen from the first one of a, which moves by ``step`` and by ``turn`` in any direction, either way.
    """
    (_, a1, a2), (b0, b1, b2), square = a, b, dot(n, n)
    if not LEAST_SQUARE < square < math.inf:
        return -1.0
    length = math.sqrt(square)
    s, t, x, y, z = dot(n, a1), dot(n, a2), dot(n, b0), dot(n, b1), dot(n, b2)
    above, below = min(x, min(y, z)) - max(s, max(t, 0.0)), min(s, min(t, 0.0)) - max(x, max(y, z))
    excess = max(above, below) / length - least
    if not excess > 0.0:
        return -1.0
    return excess / (abs(dot(n, step)) / length + turn)


@kernel
def box_of(q: Floats, origin: Row) -> Box:
    """A box of a tree, seen from a point."""
    u, v = row_of(q, 3), row_of(q, 6)
    w = cross(u, v)
    factor = q[9] / math.sqrt(dot(w, w))
    return minus(row_of(q, 0), origin), u, v, (factor * w[0], factor * w[1], factor * w[2])


@kernel
def pierces(corners: Corners, q: Floats, deep: float) -> bool:
    """Whether a point of a triangle is found in a box or ball of a tree, farther from its border than ``deep``."""
    a0 = corners[0]
    a1, a2, middle = minus(corners[1], a0), minus(corners[2], a0), minus(row_of(q, 0), a0)
    near = nearest_of_triangle(middle, a1, a2)
    if q[9] >= 0.0:
        offset = minus(near, middle)
        return bool(q[9] > deep and dot(offset, offset) < (q[9] - deep) ** 2)
    box = box_of(q, a0)
    part = 0.5
    for _ in range(16):
        offset, within = minus(near, box[0]), True
        for k in range(1, 4):
            length = math.sqrt(dot(box[k], box[k]))
            within = within and abs(dot(offset, box[k])) < length * (length - deep)
        if within:
            return True
        # To and fro between the triangle and a smaller box, so that it ends within; one that grows to all but the box.
        near = nearest_of_triangle(nearest_of_box(near, box, part), a1, a2)
        part = 0.5 + 0.5 * part
    return False


@kernel
def crosses(a: Corners, b: Corners, least: float) -> bool:
    """Whether a side of one triangle is proven to lead through the inside of the other one.

    It does, whatever rounding is: each corner may be off by a quarter of ``least``.
    """
    return _leads_through(a, b, least) or _leads_through(b, a, least)


@kernel
def _leads_through(a: Corners, b: Corners, least: float) -> bool:
    """Whether a side of the first triangle does so.

    Its ends lie on the two sides of the other one's plane, and its line winds about all sides of that alike.
    """
    for k in range(3):
        p, q = a[k], a[k + 1 if k < 2 else 0]
        one = _side_of(p, b[0], b[1], b[2], least)
        if one == 0 or _side_of(q, b[0], b[1], b[2], least) != -one:
            continue
        sign = _side_of(p, q, b[0], b[1], least)
        if sign != 0 and _side_of(p, q, b[1], b[2], least) == sign and _side_of(p, q, b[2], b[0], least) == sign:
            return True
    return False


@kernel
def _side_of(p: Row, a: Row, b: Row, c: Row, least: float) -> int:
    """On which side of a plane through three points another one is, 1 or -1; 0 where rounding decides.

    The determinant changes by less than ``(s + 2 e)^3 - s^3`` where each point moves by e and none is farther than s,
    and rounding adds less than ``64 * 2^-52 s^3``.
    """
    u, v, w = minus(a, p), minus(b, p), minus(c, p)
    s = math.sqrt(max(dot(u, u), dot(v, v), dot(w, w)))
    volume, doubt = dot(u, cross(v, w)), (2.0 * least + 2.0**-46 * s) * (s + least) * (s + least)
    return 1 if volume > doubt else -1 if volume < -doubt else 0


@kernel
def nearest_of_box(p: Row, box: Box, part: float) -> Row:
    """The point that is nearest to another one, of a part of a box about its middle, as well as rounding allows."""
    x, y, z = box[0]
    offset = minus(p, box[0])
    for k in range(1, 4):
        axis = box[k]
        t = min(max(dot(offset, axis) / dot(axis, axis), -part), part)
        x, y, z = x + t * axis[0], y + t * axis[1], z + t * axis[2]
    return x, y, z

"""Compiled proofs that boxes, balls and triangles, moved along a vector, stay clear of triangles.

Two convex sets are proven apart by a direction along which their projections are. Whatever the direction, rounded or
not, the projections on it are only a few roundings off; so a poor one can lose a proof, and never make a false one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Scene(NamedTuple):
    """Triangles in groups of neighbours, metres.

    Those of group g, shape (3, 3) each, begin at ``starts[g]``, are grown by ``radii[g]``, and lie in the box
    ``boxes[g]``, lower corner and upper one, radius included.
    """

    triangles: Floats
    starts: Ints
    radii: Floats
    boxes: Floats


@njit(cache=True, nogil=True)
def boxes_are_clear(
    scene: Scene, parts: Floats, x: float, y: float, z: float, vx: float, vy: float, vz: float, least: float
) -> bool:
    """Whether boxes, shape (n, 6), at a place and all along a vector, are proven farther than ``least`` from a scene.

    Without radii and for a small ``least``, what is not proven comes nearer than that, or nearly so.
    """
    q, v, whole, box = np.array([x, y, z]), np.array([vx, vy, vz]), np.empty(6), np.empty(6)
    _swept(parts, 0, parts.shape[0], q, v, whole)
    for g in range(scene.boxes.shape[0]):
        if _box_gap(scene.boxes[g], whole) > least:
            continue
        apart = least + scene.radii[g]
        for t in range(scene.starts[g], scene.starts[g + 1]):
            triangle = scene.triangles[t]
            if _triangle_gap(triangle, whole) > apart:
                continue
            for k in range(parts.shape[0]):
                _swept(parts, k, k + 1, q, v, box)
                if _triangle_gap(triangle, box) > apart:
                    continue
                if not _box_is_apart(parts[k], triangle, q, v, apart):
                    return False
    return True


@njit(cache=True, nogil=True)
def balls_are_clear(
    scene: Scene, parts: Floats, x: float, y: float, z: float, vx: float, vy: float, vz: float, least: float
) -> bool:
    """As :func:`boxes_are_clear` for balls, middles and radii, shape (n, 4); what is not proven comes that near."""
    q, v, whole, box = np.array([x, y, z]), np.array([vx, vy, vz]), np.empty(6), np.empty(6)
    boxes = np.empty((parts.shape[0], 6))
    for k in range(parts.shape[0]):
        for axis in range(3):
            boxes[k, axis] = parts[k, axis] - parts[k, 3]
            boxes[k, 3 + axis] = parts[k, axis] + parts[k, 3]
    _swept(boxes, 0, parts.shape[0], q, v, whole)
    for g in range(scene.boxes.shape[0]):
        if _box_gap(scene.boxes[g], whole) > least:
            continue
        for t in range(scene.starts[g], scene.starts[g + 1]):
            triangle = scene.triangles[t]
            apart = least + scene.radii[g]
            if _triangle_gap(triangle, whole) > apart:
                continue
            for k in range(parts.shape[0]):
                _swept(boxes, k, k + 1, q, v, box)
                if _triangle_gap(triangle, box) > apart:
                    continue
                if not _segment_gap(parts[k, :3] + q, v, triangle) > apart + parts[k, 3]:
                    return False
    return True


@njit(cache=True, nogil=True)
def meshes_are_clear(
    scene: Scene, robot: Scene, x: float, y: float, z: float, vx: float, vy: float, vz: float, least: float
) -> bool:
    """As :func:`boxes_are_clear` for the triangles of a robot, without what they enclose."""
    q, v, whole, box = np.array([x, y, z]), np.array([vx, vy, vz]), np.empty(6), np.empty(6)
    _swept(robot.boxes, 0, robot.boxes.shape[0], q, v, whole)
    for g in range(scene.boxes.shape[0]):
        if _box_gap(scene.boxes[g], whole) > least:
            continue
        apart = least + scene.radii[g]
        for t in range(scene.starts[g], scene.starts[g + 1]):
            triangle = scene.triangles[t]
            if _triangle_gap(triangle, whole) > apart:
                continue
            for r in range(robot.boxes.shape[0]):
                _swept(robot.boxes, r, r + 1, q, v, box)
                if _triangle_gap(triangle, box) > apart:
                    continue
                for k in range(robot.starts[r], robot.starts[r + 1]):
                    if not _triangle_is_apart(robot.triangles[k], triangle, q, v, apart):
                        return False
    return True


@njit(cache=True, nogil=True)
def _swept(boxes: Floats, first: int, stop: int, q: Floats, v: Floats, out: Floats) -> None:
    """Box round some boxes at a place and all along a vector."""
    for axis in range(3):
        low, high = math.inf, -math.inf
        for k in range(first, stop):
            low, high = min(low, boxes[k, axis]), max(high, boxes[k, 3 + axis])
        out[axis] = q[axis] + low + min(v[axis], 0.0)
        out[3 + axis] = q[axis] + high + max(v[axis], 0.0)


@njit(cache=True, nogil=True)
def _box_gap(a: Floats, b: Floats) -> float:
    """How far two boxes are apart along the axis along which they are farthest apart."""
    x, y, z = max(a[0] - b[3], b[0] - a[3]), max(a[1] - b[4], b[1] - a[4]), max(a[2] - b[5], b[2] - a[5])
    return float(max(x, y, z))


@njit(cache=True, nogil=True)
def _triangle_gap(triangle: Floats, box: Floats) -> float:
    """As :func:`_box_gap`, for the box round a triangle."""
    best = -math.inf
    for axis in range(3):
        a, b, c = triangle[0, axis], triangle[1, axis], triangle[2, axis]
        best = max(best, min(a, b, c) - box[3 + axis], box[axis] - max(a, b, c))
    return float(best)


@njit(cache=True, nogil=True)
def _box_is_apart(part: Floats, triangle: Floats, q: Floats, v: Floats, apart: float) -> bool:
    """Whether one of the directions that tell convex solids apart has a moved box and a triangle apart by so much.

    Those are the normals of both and the products of their edges (S. Gottschalk, "Separating axis theorem", 1996); the
    box that moves has the vector for a fourth edge, and the products of that with the others for normals.
    """
    edges = np.empty((3, 3))
    for axis in range(3):
        for corner in range(3):
            edges[corner, axis] = triangle[(corner + 1) % 3, axis] - triangle[corner, axis]
    n = np.empty(3)
    _cross(edges[0], edges[1], n)
    if _is_direction(part, triangle, q, v, n, apart):
        return True
    moves = v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0
    unit = np.zeros(3)
    for axis in range(3):
        unit[:] = 0.0
        unit[axis] = 1.0
        if _is_direction(part, triangle, q, v, unit, apart):
            return True
        if moves:
            _cross(v, unit, n)
            if _is_direction(part, triangle, q, v, n, apart):
                return True
        for corner in range(3):
            _cross(edges[corner], unit, n)
            if _is_direction(part, triangle, q, v, n, apart):
                return True
    if moves:
        for corner in range(3):
            _cross(edges[corner], v, n)
            if _is_direction(part, triangle, q, v, n, apart):
                return True
    return False


@njit(cache=True, nogil=True)
def _triangle_is_apart(part: Floats, triangle: Floats, q: Floats, v: Floats, apart: float) -> bool:
    """As :func:`_box_is_apart`, for a moved triangle; and for two that lie in one plane."""
    unit, n = np.zeros(3), np.empty(3)
    for axis in range(3):
        unit[:] = 0.0
        unit[axis] = 1.0
        if _is_between(part, triangle, q, v, unit, apart):
            return True
    edges, normals = np.empty((7, 3)), np.empty((2, 3))  # of the moved one, of the other, and the vector
    for axis in range(3):
        edges[6, axis] = v[axis]
        for corner in range(3):
            edges[corner, axis] = part[(corner + 1) % 3, axis] - part[corner, axis]
            edges[3 + corner, axis] = triangle[(corner + 1) % 3, axis] - triangle[corner, axis]
    for which in range(2):
        _cross(edges[3 * which], edges[3 * which + 1], normals[which])
        if _is_between(part, triangle, q, v, normals[which], apart):
            return True
    count = 7 if v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0 else 6
    for first in range(count):
        for second in range(max(first + 1, 3), count):
            if first < 3 or second == 6:
                _cross(edges[first], edges[second], n)
                if _is_between(part, triangle, q, v, n, apart):
                    return True
    for which in range(2):
        for edge in range(count):
            _cross(normals[which], edges[edge], n)
            if _is_between(part, triangle, q, v, n, apart):
                return True
    return False


@njit(cache=True, nogil=True)
def _is_between(part: Floats, triangle: Floats, q: Floats, v: Floats, n: Floats, apart: float) -> bool:
    """As :func:`_is_direction`, for a moved triangle."""
    low, high = math.inf, -math.inf
    least = most = 0.0
    for corner in range(3):
        at = other = 0.0
        for axis in range(3):
            at += n[axis] * (q[axis] + part[corner, axis] - triangle[0, axis])
            other += n[axis] * (triangle[corner, axis] - triangle[0, axis])
        low, high = min(low, at), max(high, at)
        least, most = min(least, other), max(most, other)
    along = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
    low, high = low + min(along, 0.0), high + max(along, 0.0)
    length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    return bool(max(low - most, least - high) > apart * length)


@njit(cache=True, nogil=True)
def _cross(a: Floats, b: Floats, out: Floats) -> None:
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def _is_direction(part: Floats, triangle: Floats, q: Floats, v: Floats, n: Floats, apart: float) -> bool:
    """Whether a moved box and a triangle are farther apart than so much along a direction of any length."""
    low = high = 0.0
    for axis in range(3):
        # Of the box, seen from a corner of the triangle, so that nothing large cancels.
        a, b = (
            n[axis] * (q[axis] + part[axis] - triangle[0, axis]),
            n[axis] * (q[axis] + part[3 + axis] - triangle[0, axis]),
        )
        low, high = low + min(a, b), high + max(a, b)
    along = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
    low, high = low + min(along, 0.0), high + max(along, 0.0)
    least = most = 0.0
    for corner in range(1, 3):
        at = 0.0
        for axis in range(3):
            at += n[axis] * (triangle[corner, axis] - triangle[0, axis])
        least, most = min(least, at), max(most, at)
    length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    return bool(max(low - most, least - high) > apart * length)


@njit(cache=True, nogil=True)
def _segment_gap(start: Floats, v: Floats, triangle: Floats) -> float:
    """Distance of a segment from a triangle, or less: how far they are apart along the line of their nearest points.

    Zero or below where they meet.
    """
    best = math.inf
    n, trial, point = np.zeros(3), np.empty(3), np.empty(3)
    for end in range(2 if v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0 else 1):
        for axis in range(3):
            point[axis] = start[axis] + end * v[axis]
        square = _from_point(point, triangle, trial)
        if square < best:
            best = square
            n[:] = trial
    if v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0:
        for corner in range(3):
            square = _from_segment(start, v, triangle[corner], triangle[(corner + 1) % 3], trial)
            if square < best:
                best = square
                n[:] = trial
    # The direction proves itself: both sets are projected on it.
    low = high = 0.0
    least, most = math.inf, -math.inf
    for axis in range(3):
        high += n[axis] * v[axis]
    low, high = min(high, 0.0), max(high, 0.0)
    for corner in range(3):
        at = 0.0
        for axis in range(3):
            at += n[axis] * (triangle[corner, axis] - start[axis])
        least, most = min(least, at), max(most, at)
    length = math.sqrt(best)
    return float(max(least - high, low - most) / length) if length > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _from_point(p: Floats, triangle: Floats, out: Floats) -> float:
    """Squared distance of a point from a triangle; ``out`` leads from the triangle's nearest point to it.

    By the regions of the triangle's corners, sides and inside (C. Ericson, "Real-time collision detection", 2005).
    """
    ab, ac, ap = np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        ab[axis] = triangle[1, axis] - triangle[0, axis]
        ac[axis] = triangle[2, axis] - triangle[0, axis]
        ap[axis] = p[axis] - triangle[0, axis]
    normal = np.empty(3)
    _cross(ab, ac, normal)
    square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
    if square > 0.0:
        inside, side = True, np.empty(3)
        edge, rest = np.empty(3), np.empty(3)
        for corner in range(3):
            for axis in range(3):
                edge[axis] = triangle[(corner + 1) % 3, axis] - triangle[corner, axis]
                rest[axis] = p[axis] - triangle[corner, axis]
            _cross(normal, edge, side)
            inside = inside and side[0] * rest[0] + side[1] * rest[1] + side[2] * rest[2] >= 0.0
        if inside:
            height = (normal[0] * ap[0] + normal[1] * ap[1] + normal[2] * ap[2]) / square
            for axis in range(3):
                out[axis] = height * normal[axis]
            return float(height * height * square)
    best, trial, none = math.inf, np.empty(3), np.zeros(3)
    for corner in range(3):
        square = _from_segment(p, none, triangle[corner], triangle[(corner + 1) % 3], trial)
        if square < best:
            best = square
            out[:] = trial
    return best


@njit(cache=True, nogil=True)
def _from_segment(start: Floats, v: Floats, a: Floats, b: Floats, out: Floats) -> float:
    """Squared distance of two segments, the first given by a vector; ``out`` leads from the second to the first."""
    vv = uu = uv = vw = uw = 0.0
    for axis in range(3):
        u, w = b[axis] - a[axis], start[axis] - a[axis]
        vv, uu, uv = vv + v[axis] * v[axis], uu + u * u, uv + u * v[axis]
        vw, uw = vw + v[axis] * w, uw + u * w
    area = vv * uu - uv * uv
    s = min(max((uv * uw - vw * uu) / area, 0.0), 1.0) if area > 0.0 else 0.0
    t = min(max((uv * s + uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    s = min(max((uv * t - vw) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    square = 0.0
    for axis in range(3):
        out[axis] = start[axis] - a[axis] + s * v[axis] - t * (b[axis] - a[axis])
        square += out[axis] * out[axis]
    return square


@njit(cache=True, nogil=True)
def cells_of_anchors(outer: Bools, inner: Bools, frame: Floats, anchors: Floats, x: float, y: float, z: float) -> int:
    """Whether one of some points, shape (n, 3), at a place, lies in an inner cell (2), else in an outer one (1).

    Points outside the grid lie in none.
    """
    found = 0
    nx, ny, nz = outer.shape
    for k in range(anchors.shape[0]):
        i = math.floor((x + anchors[k, 0] - frame[0]) / frame[3])
        j = math.floor((y + anchors[k, 1] - frame[1]) / frame[3])
        m = math.floor((z + anchors[k, 2] - frame[2]) / frame[3])
        if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz and outer[i, j, m]:
            if inner[i, j, m]:
                return 2
            found = 1
    return found

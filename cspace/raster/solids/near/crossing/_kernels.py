"""Compiled kernels of crossings. Triangles are on numbers up to 1; where rounding may hide a crossing, one is seen."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.raster.solids.inside._kernels import bucket_of
from cspace.raster.solids.near._kernels import cross, point_segment, point_triangle

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

ROUNDING = 2.0**-46
"""Bound of the rounding of a volume, over the product of the lengths that span it where these are 1 at least."""


@njit(cache=True, nogil=True)
def _segments(p: Floats, q: Floats, r: Floats, s: Floats) -> float:
    """Squared distance between two segments (Ericson, 2005), from all ends as well as from between them."""
    best = min(
        min(point_segment(p[0], p[1], p[2], r, s), point_segment(q[0], q[1], q[2], r, s)),
        min(point_segment(r[0], r[1], r[2], p, q), point_segment(s[0], s[1], s[2], p, q)),
    )
    d, e, w = q - p, s - r, p - r
    a, b, c = np.sum(d * d), np.sum(d * e), np.sum(e * e)
    f, g = np.sum(d * w), np.sum(e * w)
    spread = a * c - b * b
    if spread > 0.0:
        t, v = (b * g - c * f) / spread, (a * g - b * f) / spread
        if 0.0 <= t <= 1.0 and 0.0 <= v <= 1.0:
            gap = w + t * d - v * e
            best = min(best, np.sum(gap * gap))
    return best


@njit(cache=True, nogil=True)
def _side(a: Floats, b: Floats, c: Floats, p: Floats) -> float:
    """Volume of the parallelepiped that a point spans with a triangle; its sign tells the side."""
    nx, ny, nz = cross(a, b, c)
    return float(nx * (p[0] - a[0]) + ny * (p[1] - a[1]) + nz * (p[2] - a[2]))


@njit(cache=True, nogil=True)
def _pierces(p: Floats, q: Floats, triangle: Floats, slack: float) -> bool:
    """Whether a segment passes through a triangle; not asked of one that stays within ``slack`` of its plane."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    first, second = _side(a, b, c, p), _side(a, b, c, q)
    if first * second > 0.0:
        return False
    nx, ny, nz = cross(a, b, c)
    if max(abs(first), abs(second)) <= slack * math.sqrt(nx * nx + ny * ny + nz * nz):
        return False
    u, v, w = _side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)
    return min(u, v, w) >= 0.0 or max(u, v, w) <= 0.0


@njit(cache=True, nogil=True)
def _edge_meets(p: Floats, q: Floats, triangle: Floats, slack: float) -> bool:
    """Whether a segment comes within ``slack`` of a triangle."""
    if _pierces(p, q, triangle, slack):
        return True
    near = min(point_triangle(p[0], p[1], p[2], triangle), point_triangle(q[0], q[1], q[2], triangle))
    for e in range(3):
        near = min(near, math.sqrt(_segments(p, q, triangle[e], triangle[e + 1 if e < 2 else 0])))
    return near <= slack


@njit(cache=True, nogil=True)
def _boxes_apart(first: Floats, second: Floats, slack: float) -> bool:
    """Whether the bounding boxes of two triangles are more than ``slack`` apart."""
    for axis in range(3):
        a, b, c = first[0, axis], first[1, axis], first[2, axis]
        u, v, w = second[0, axis], second[1, axis], second[2, axis]
        if min(a, b, c) > max(u, v, w) + slack or min(u, v, w) > max(a, b, c) + slack:
            return True
    return False


@njit(cache=True, nogil=True)
def _beside(triangle: Floats, other: Floats, skipped: int, slack: float) -> bool:
    """Whether the corners of another triangle, but for those whose bit is skipped, lie farther than ``slack`` from the
    plane of one, and all on one side of it."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    nx, ny, nz = cross(a, b, c)
    normal = math.sqrt(nx * nx + ny * ny + nz * nz)
    size = 0.0
    for axis in range(3):
        size = max(size, abs(b[axis] - a[axis]), abs(c[axis] - a[axis]))
    low, high = math.inf, -math.inf
    for k in range(3):
        if skipped >> k & 1:
            continue
        p = other[k]
        height = nx * (p[0] - a[0]) + ny * (p[1] - a[1]) + nz * (p[2] - a[2])
        low, high = min(low, height), max(high, height)
    least = slack * normal + ROUNDING * size
    return low > least or high < -least


@njit(cache=True, nogil=True)
def _meet(first: Floats, second: Floats, slack: float) -> bool:
    """Whether two triangles cross or come within ``slack`` of each other."""
    if _beside(first, second, 0, slack) or _beside(second, first, 0, slack):
        return False
    for e in range(3):
        n = e + 1 if e < 2 else 0
        if _edge_meets(first[e], first[n], second, slack) or _edge_meets(second[e], second[n], first, slack):
            return True
    return False


@njit(cache=True, nogil=True)
def _hinged(first: Floats, second: Floats, i: int, j: int, slack: float) -> bool:
    """Whether two triangles that share an edge meet in nothing else; ``i`` and ``j`` are the corners not shared."""
    a, b, p, q = first[(i + 1) % 3], first[(i + 2) % 3], first[i], second[j]
    ux, uy, uz = cross(a, b, p)
    vx, vy, vz = cross(b, a, q)
    one, other = math.sqrt(ux * ux + uy * uy + uz * uz), math.sqrt(vx * vx + vy * vy + vz * vz)
    # Flat, or bent by less than a right angle.
    if ux * vx + uy * vy + uz * vz > 2.0**-20 * one * other + ROUNDING * (one + other):
        return True
    return _beside(first, second, 7 - (1 << j), slack)


@njit(cache=True, nogil=True)
def _wedged(first: Floats, second: Floats, i: int, j: int, slack: float) -> bool:
    """Whether two triangles that share corner ``i`` of the first, which is ``j`` of the second, meet elsewhere."""
    if _beside(first, second, 1 << j, slack) or _beside(second, first, 1 << i, slack):
        return False
    o, a, b, c, d = first[i], first[(i + 1) % 3], first[(i + 2) % 3], second[(j + 1) % 3], second[(j + 2) % 3]
    one, other = 0.0, 0.0
    for k in range(3):
        one += (a[k] + b[k] - 2.0 * o[k]) ** 2
        other += (c[k] + d[k] - 2.0 * o[k]) ** 2
    if one > 0.0 and other > 0.0:
        one, other = math.sqrt(one), math.sqrt(other)
        ha, hb, hc, hd = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            # From the middle of one to that of the other, seen from the corner; at most 2 long.
            u = (a[k] + b[k] - 2.0 * o[k]) / one - (c[k] + d[k] - 2.0 * o[k]) / other
            ha, hb, hc, hd = (
                ha + u * (a[k] - o[k]),
                hb + u * (b[k] - o[k]),
                hc + u * (c[k] - o[k]),
                hd + u * (d[k] - o[k]),
            )
        if min(ha, hb) > 2.0 * slack and max(hc, hd) < -2.0 * slack:
            return False
    # What they share is convex and ends where one of them does, across from the corner.
    return _edge_meets(a, b, second, slack) or _edge_meets(c, d, first, slack)


@njit(cache=True, nogil=True)
def _cross_within(first: Floats, second: Floats, ours: Integers, theirs: Integers, slack: float) -> bool:
    """Whether two triangles of one body, with the numbers of their corners, meet in more than these and their edges."""
    shared, i, j = 0, 0, 0
    for e in range(3):
        for f in range(3):
            if ours[e] == theirs[f]:
                shared += 1
                i += e
                j += f
    if shared == 0:
        return _meet(first, second, slack)
    if shared == 1:
        return _wedged(first, second, i, j, slack)
    return shared == 3 or not _hinged(first, second, 3 - i, 3 - j, slack)


@njit(cache=True, nogil=True)
def _first_met(first: Floats, second: Floats, low: Floats, scale: Floats, shape: Integers) -> int:
    """The first bucket that two triangles share, if they share one."""
    x = max(min(first[0, 0], first[1, 0], first[2, 0]), min(second[0, 0], second[1, 0], second[2, 0]))
    y = max(min(first[0, 1], first[1, 1], first[2, 1]), min(second[0, 1], second[1, 1], second[2, 1]))
    return int(bucket_of(x, low[0], scale[0], shape[0]) * shape[1] + bucket_of(y, low[1], scale[1], shape[1]))


@njit(cache=True, nogil=True)
def find_self_crossings(
    triangles: Floats,
    body: Integers,
    corners: Integers,
    low: Floats,
    scale: Floats,
    shape: Integers,
    starts: Integers,
    entries: Integers,
    slack: float,
    crossed: Bools,
) -> None:
    """Set ``crossed`` for bodies of which two triangles meet within ``slack`` in more than common corners and edges.

    Triangles are compared that share a bucket, in which they come in the order of their lowest points.
    """
    for bucket in range(len(starts) - 1):
        for x in range(starts[bucket], starts[bucket + 1]):
            s = entries[x]
            first = triangles[s]
            high = max(first[0, 2], first[1, 2], first[2, 2]) + slack
            for y in range(x + 1, starts[bucket + 1]):
                t = entries[y]
                second = triangles[t]
                if min(second[0, 2], second[1, 2], second[2, 2]) > high:
                    break
                if body[s] != body[t] or crossed[body[s]] or _boxes_apart(first, second, slack):
                    continue
                if _first_met(first, second, low, scale, shape) != bucket:
                    continue
                if _cross_within(first, second, corners[s], corners[t], slack):
                    crossed[body[s]] = True


@njit(cache=True, nogil=True)
def find_crossings(
    triangles: Floats,
    body: Integers,
    low: Floats,
    scale: Floats,
    shape: Integers,
    starts: Integers,
    entries: Integers,
    number: int,
    slack: float,
    recent: Integers,
    found: Integers,
) -> int:
    """Write ``a * number + b`` for pairs ``a < b`` of bodies that meet within ``slack``, some more than once.

    Triangles are compared that share a bucket, in which they come in the order of their lowest points. How many are
    written; beyond the length of ``found`` they are only counted. ``recent``, -1 at first, is room to remember pairs.
    """
    count = 0
    for bucket in range(len(starts) - 1):
        for x in range(starts[bucket], starts[bucket + 1]):
            s = entries[x]
            first = triangles[s]
            high = max(first[0, 2], first[1, 2], first[2, 2]) + slack
            for y in range(x + 1, starts[bucket + 1]):
                t = entries[y]
                second = triangles[t]
                if min(second[0, 2], second[1, 2], second[2, 2]) > high:
                    break
                key = min(body[s], body[t]) * number + max(body[s], body[t])
                if body[s] == body[t] or recent[key % len(recent)] == key or _boxes_apart(first, second, slack):
                    continue
                if _first_met(first, second, low, scale, shape) != bucket:
                    continue
                if not _meet(first, second, slack):
                    continue
                recent[key % len(recent)] = key
                if count < len(found):
                    found[count] = key
                count += 1
    return count

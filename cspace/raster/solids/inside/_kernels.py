"""Compiled kernels of the inside test: triangles sorted into buckets of a plane, and rays across it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]
Codes = NDArray[np.uint8]

OUTSIDE, INSIDE, HOLLOW, AMBIGUOUS, DOUBTED, ASKS_CROSSINGS = 0, 1, 2, 3, 4, 5


@njit(cache=True, nogil=True)
def bucket_of(value: float, low: float, scale: float, count: int) -> int:
    """Bucket of a coordinate; it never falls as the coordinate grows, whatever the rounding."""
    return int(min(max(math.floor((value - low) * scale), 0), count - 1))


@njit(cache=True, nogil=True)
def _buckets_of(triangle: Floats, low: Floats, scale: Floats, shape: Integers) -> tuple[int, int, int, int]:
    """First and last bucket, along x and along y, of a triangle's bounding box."""
    x0 = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
    x1 = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
    y0 = min(triangle[0, 1], triangle[1, 1], triangle[2, 1])
    y1 = max(triangle[0, 1], triangle[1, 1], triangle[2, 1])
    return (
        bucket_of(x0, low[0], scale[0], shape[0]),
        bucket_of(x1, low[0], scale[0], shape[0]),
        bucket_of(y0, low[1], scale[1], shape[1]),
        bucket_of(y1, low[1], scale[1], shape[1]),
    )


@njit(cache=True, nogil=True)
def count_entries(triangles: Floats, low: Floats, scale: Floats, shape: Integers) -> int:
    """Number of (bucket, triangle) pairs."""
    number = 0
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        number += (i1 - i0 + 1) * (j1 - j0 + 1)
    return number


@njit(cache=True, nogil=True)
def sort_into_buckets(
    triangles: Floats, low: Floats, scale: Floats, shape: Integers, starts: Integers, entries: Integers
) -> None:
    """Write the triangles of bucket ``b = i * shape[1] + j`` to ``entries[starts[b]:starts[b + 1]]``, in order."""
    starts[:] = 0
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                starts[i * shape[1] + j + 1] += 1
    for b in range(len(starts) - 1):
        starts[b + 1] += starts[b]
    free = starts[:-1].copy()
    for t in range(len(triangles)):
        i0, i1, j0, j1 = _buckets_of(triangles[t], low, scale, shape)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                b = i * shape[1] + j
                entries[free[b]] = t
                free[b] += 1


@njit(cache=True, nogil=True)
def _crossing(triangle: Floats, x: float, y: float) -> tuple[int, float]:
    """How a line along z at (x, y) crosses a triangle: 1 where its normal points up, -1 down, 0 not; and at which z.

    An edge is met where ``x`` lies in the half-open interval of its ends, and its point there is computed from its end
    with the smaller x or from the other one, whichever is nearer, so that all triangles at an edge find the same point.
    """
    sign = 0
    above_y, above_z, below_y, below_z = 0.0, 0.0, 0.0, 0.0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[e + 1 if e < 2 else 0]
        if (px <= x) == (qx <= x):
            continue
        turn = 1
        if px <= x:
            turn = -1
        else:
            px, py, pz, qx, qy, qz = qx, qy, qz, px, py, pz
        t = (x - px) / (qx - px)
        if t <= 0.5:
            ey, ez = py + t * (qy - py), pz + t * (qz - pz)
        else:
            t = (x - qx) / (px - qx)
            ey, ez = qy + t * (py - qy), qz + t * (pz - qz)
        if ey > y:
            sign += turn
            above_y, above_z = ey, ez
        else:
            below_y, below_z = ey, ez
    if sign == 0:
        return 0, 0.0
    t = (y - below_y) / (above_y - below_y)
    if t <= 0.5:
        return sign, below_z + t * (above_z - below_z)
    return sign, above_z + (y - above_y) / (below_y - above_y) * (below_z - above_z)


@njit(cache=True, nogil=True)
def _among(key: int, keys: Integers) -> bool:
    index = np.searchsorted(keys, key)
    return bool(index < len(keys) and keys[index] == key)


@njit(cache=True, nogil=True)
def _cast(
    triangles: Floats,
    body: Integers,
    turns: Integers,
    low: Floats,
    scale: Floats,
    shape: Integers,
    starts: Integers,
    entries: Integers,
    x: float,
    y: float,
    z: float,
    axis: int,
    met: int,
    seen: Integers,
    ways: Integers,
    winding: Integers,
    counted: Integers,
    tops: Floats,
) -> int:
    """Cast two rays along the last axis, and note for each body on which of them it was met; how many are met.

    For axis 0, also its winding number and number of triangles that count above the point, and where it was left.
    """
    b = bucket_of(x, low[0], scale[0], shape[0]) * shape[1] + bucket_of(y, low[1], scale[1], shape[1])
    for entry in range(starts[b], starts[b + 1]):
        t = entries[entry]
        sign, height = _crossing(triangles[t], x, y)
        if sign == 0:
            continue
        a = body[t]
        if ways[a] == 0:
            seen[met] = a
            met += 1
            winding[a], counted[a], tops[a] = 0, 0, height
        ways[a] |= (2 if height > z else 1) << (2 * axis)
        if axis == 0 and height > z:
            winding[a] += sign * turns[t]
            counted[a] += abs(turns[t])
            tops[a] = max(tops[a], height)
    return met


@njit(cache=True, nogil=True)
def _of_members(
    members: int,
    seen: Integers,
    winding: Integers,
    side: Integers,
    tops: Floats,
    crossings: Integers,
    number: int,
) -> int:
    """Code of a point in several bodies, not all of which face the same way."""
    # Innermost first: of bodies that do not cross, the inner one is left first.
    for s in range(1, members):
        r = s
        while r > 0 and tops[seen[r - 1]] > tops[seen[r]]:
            seen[r - 1], seen[r] = seen[r], seen[r - 1]
            r -= 1
    for s in range(members):
        a = seen[s]
        # From the outermost one inwards: outward, inward, outward ...
        if abs(winding[a]) != 1 or side[a] != (1 if (members - s) % 2 == 1 else -1):
            return AMBIGUOUS
    if len(crossings) and crossings[0] < 0:
        return ASKS_CROSSINGS
    for s in range(members):
        for r in range(s):
            a, c = seen[r], seen[s]
            if side[a] != side[c] and _among(min(a, c) * number + max(a, c), crossings):
                return AMBIGUOUS
    return INSIDE if members % 2 == 1 else HOLLOW


@njit(cache=True, nogil=True)
def classify(
    points: Floats,
    out: Codes,
    along: tuple[tuple[Floats, Floats, Floats, Integers, Integers, Integers], ...],
    body: Integers,
    turns: Integers,
    wound: Bools,
    facing: Integers,
    simple: Codes,
    crossings: Integers,
    asked: Bools,
) -> None:
    """Set ``out`` to the code of each point; to DOUBTED where it is in no body, but not proven out of all.

    ``along`` holds triangles and their buckets for rays along z, and, unless only those are to be cast, along x and y,
    with the coordinates in the order (x, y, z), (y, z, x), (z, x, y). ``simple`` is 1 for bodies that do not pass
    through themselves, 0 for those that may, 2 where that is not known. ``crossings`` holds
    ``a * number_of_bodies + b`` for the pairs of bodies that cross, ``a < b``, sorted; or -1, where they are not known.
    Where a code hangs on what is not known it is AMBIGUOUS or DOUBTED, and ``asked`` is set for the body, or at the end
    for the crossings.
    """
    number = len(facing)
    ways = np.zeros(number, dtype=np.int64)
    winding = np.empty(number, dtype=np.int64)
    counted = np.empty(number, dtype=np.int64)
    side = np.empty(number, dtype=np.int64)
    tops = np.empty(number)
    seen = np.empty(number, dtype=np.int64)
    around = (1 << (2 * len(along))) - 1 if len(along) > 1 else 2
    for p in range(len(points)):
        met = 0
        for axis in range(len(along)):
            triangles, low, scale, shape, starts, entries = along[axis]
            x, y, z = points[p, axis], points[p, (axis + 1) % 3], points[p, (axis + 2) % 3]
            met = _cast(
                triangles, body, turns, low, scale, shape, starts, entries, x, y, z, axis,
                met, seen, ways, winding, counted, tops,
            )  # fmt: skip
        members, doubts, up, down = 0, 0, False, False
        for s in range(met):
            a = seen[s]
            enclosed = ways[a] & around == around
            ways[a] = 0
            if not enclosed:
                continue
            if not wound[a]:
                winding[a] = counted[a] % 2
            if winding[a] == 0:
                if simple[a] == 1:
                    continue
                if simple[a] == 2:
                    asked[a] = True
                doubts += 1
                side[a] = facing[a]
            else:
                # What is turned inside out, of a body that faces outward as a whole, may be anything.
                side[a] = facing[a] if facing[a] * winding[a] > 0 else 0
                seen[members] = a
                members += 1
            up = up or side[a] >= 0
            down = down or side[a] <= 0
        if members == 0:
            out[p] = DOUBTED if doubts else OUTSIDE
        elif members + doubts == 1 or not up or not down:
            out[p] = INSIDE
        elif doubts:
            out[p] = AMBIGUOUS
        else:
            code = _of_members(members, seen, winding, side, tops, crossings, number)
            if code == ASKS_CROSSINGS:
                asked[number] = True
                code = AMBIGUOUS
            out[p] = code

"""Compiled distances from points to segments and triangles, by a tree of boxes.

Everything is in space; a plane lies in it as x = 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SEGMENT, THIN, FULL = 0, 1, 2
"""A piece is the segment between its first two corners; a triangle that counts as its edges; or a triangle."""

DEPTH = 64
"""Most boxes that wait at a time: twice the depth of a tree over 2^30 pieces."""


class Tree(NamedTuple):
    """Pieces, shape (n, 3, 3), and boxes round them: box ``b`` holds ``pieces[starts[b]:stops[b]]``.

    The children of a box are ``children[b]`` and the one after it; 0 where there are none.
    """

    pieces: Floats
    kinds: NDArray[np.uint8]
    lower: Floats
    upper: Floats
    children: Ints
    starts: Ints
    stops: Ints


@njit(cache=True, nogil=True)
def _to_segment(px: float, py: float, pz: float, a: Floats, b: Floats) -> float:
    """Squared distance from a point to a segment."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    x, y, z = px - a[0], py - a[1], pz - a[2]
    square = dx * dx + dy * dy + dz * dz
    if square > 0.0:
        t = min(max((x * dx + y * dy + z * dz) / square, 0.0), 1.0)
        x, y, z = x - t * dx, y - t * dy, z - t * dz
    return float(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _to_piece(px: float, py: float, pz: float, piece: Floats, kind: int) -> float:
    """Squared distance from a point to a piece."""
    a, b, c = piece[0], piece[1], piece[2]
    if kind == SEGMENT:
        return float(_to_segment(px, py, pz, a, b))
    if kind == FULL:
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        x, y, z = px - a[0], py - a[1], pz - a[2]
        # Signs of the point's barycentric coordinates.
        second = nx * (y * vz - z * vy) + ny * (z * vx - x * vz) + nz * (x * vy - y * vx)
        third = nx * (uy * z - uz * y) + ny * (uz * x - ux * z) + nz * (ux * y - uy * x)
        square = nx * nx + ny * ny + nz * nz
        if second >= 0.0 and third >= 0.0 and second + third <= square:
            height = x * nx + y * ny + z * nz
            return float(height * height / square)
    best = min(_to_segment(px, py, pz, a, b), _to_segment(px, py, pz, b, c))
    return float(min(best, _to_segment(px, py, pz, c, a)))


@njit(cache=True, nogil=True)
def _to_box(px: float, py: float, pz: float, lower: Floats, upper: Floats) -> float:
    """Squared distance from a point to a box."""
    x = max(0.0, lower[0] - px, px - upper[0])
    y = max(0.0, lower[1] - py, py - upper[1])
    z = max(0.0, lower[2] - pz, pz - upper[2])
    return float(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def distance(tree: Tree, px: float, py: float, pz: float, most: float) -> float:
    """Distance from a point to the nearest piece, if that is below ``most``, and else ``most``."""
    best = most * most
    waiting = np.empty(DEPTH, dtype=np.int64)
    squares = np.empty(DEPTH)
    waiting[0], squares[0] = 0, _to_box(px, py, pz, tree.lower[0], tree.upper[0])
    count = 1
    while count > 0:
        count -= 1
        if squares[count] >= best:
            continue
        box = waiting[count]
        child = tree.children[box]
        if child == 0:
            for n in range(tree.starts[box], tree.stops[box]):
                best = min(best, _to_piece(px, py, pz, tree.pieces[n], tree.kinds[n]))
            continue
        one = _to_box(px, py, pz, tree.lower[child], tree.upper[child])
        other = _to_box(px, py, pz, tree.lower[child + 1], tree.upper[child + 1])
        # The nearer box comes last, and so is looked at first.
        near, far = (child, child + 1) if one <= other else (child + 1, child)
        waiting[count], squares[count] = far, max(one, other)
        waiting[count + 1], squares[count + 1] = near, min(one, other)
        count += 2
    return math.sqrt(best)


@njit(cache=True, nogil=True)
def distances(tree: Tree, points: Floats, out: Floats) -> None:
    """Distances from points, shape (n, 3); quickest where neighbours follow one another."""
    x = y = z = 0.0
    found = math.inf
    for n in range(points.shape[0]):
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        # No farther than from the point before, and the way from there.
        way = math.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
        most = (found + way) * 1.000001 if n > 0 and found + way > 0.0 else math.inf
        found = distance(tree, px, py, pz, most)
        x, y, z = px, py, pz
        out[n] = found

"""Triangles in space: the boxes that they touch, those within a distance of them, and how far a point is.

A *box* ``i`` is ``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of a
robot, ``(0, 0)`` for lattice points. Lengths are in cells, in the index frame of the array that is written.

*Touched boxes.* For each slab of boxes across x, a triangle is cut to the slab, then, for each slab across y, what is
left of it to that; the part that remains is convex, so that its z-values are an interval, and it meets exactly the
boxes that meet that interval.

*Safety against rounding.* Let u = 2^-53, and all vertices lie within 2^22 cells of the frame's corner (for a robot: of
its origin), so that no two differ by more than 2^23 along an axis. In units of 2^-30 cells:

* A vertex in cells has two roundings relative to its size (the difference from the corner, the division by the
  spacing), and that of a whole number of cells subtracted: less than 1.5. Where it was turned, three more: less than
  1.5 again. (By how much a matrix misses a rotation belongs to the covering angle.)
* A corner made by a cut lies on the cutting plane to the bit. Its other coordinates are ``p + t (q - p)`` with ``t``
  at most 1/2, from the nearer end: ``t`` has three roundings relative to itself, the difference and the product one
  each, so that with that of the sum it is off by less than 5 u 2^22 + 2^-31, which is 3.
* The planes of one direction do not meet, so all corners of a first cut lie on the triangle's own edges, and those of
  the second on the edges of the first result. Which corners there are is decided on the numbers as they are, without
  rounding. So each point of the part of the triangle in a slab differs from a point of the computed part by less than
  3, and after two cuts by less than 6, in y and z each.
* The ends of a run of boxes have two more roundings: less than 1.

Together that is less than 10. The slabs, and the runs of boxes, are widened to each side by ``SLACK`` = 2^-26 cells,
which is 16. So every box that a triangle meets is marked, and no box farther than 2 ``SLACK`` from it along an axis;
what is left of ``SLACK`` covers the rounding of a look-up, 4.

*Boxes within a distance.* The distance of a triangle that a cube does not meet is that of two of their features: a
corner and the triangle, a corner of the triangle and the cube, or two edges. Before that, the nearest point of the
triangle to the cube's middle bounds it from both sides.

Let L be the size of all triangles together. A distance from the plane of a triangle is off by the rounding of its
normal, relative to it less than 2^-39 (thinner triangles than 2^-12 are taken to be as near as their height allows), so
by less than 2^-36 L. The bound by the nearest point is off by the rounding of the direction there, less than 2^-51 L,
over the length of the triangle: less than 2^-51 L^2. The radius grows by more than both, by 2^-20 + 2^-34 L + 2^-50
L^2. The result is complete, and holds no more than that, but for thin triangles: for those, what lies within 2^-12
times their length besides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.grid import SLACK
from cspace.threads import in_chunks

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

THIN: Final = 2.0**-12
"""Height of a triangle over its longest side below which its plane is not used."""

_ROUNDING: Final = 2.0**-20
_TRIANGLES_A_THREAD: Final = 2_000
_SLABS_A_THREAD: Final = 4


def mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float = SLACK) -> None:
    """Set ``out[i]`` where the box ``i + [b0, b1]^3`` meets a triangle.

    Parameters
    ----------
    out : ndarray of bool, shape (nx, ny, nz)
    triangles : ndarray, shape (n, 3, 3)
        In cells, in the index frame of ``out``; they may reach beyond it.
    b0, b1 : float
        In cells; multiples of one half.
    slack : float
        How much nearer than touching is near enough, in cells.
    """
    # Each thread has slabs of its own, about as many triangles in each, so that no two write to one cell.
    middles = np.sort(np.clip(triangles[..., 0].mean(axis=1), 0, len(out)).astype(np.int64))
    size = len(middles)

    def work(start: int, stop: int) -> int:
        first = int(middles[start]) if start > 0 else 0
        last = int(middles[stop]) if stop < size else len(out)
        _mark_touched(out, triangles, b0, b1, slack, first, last)
        return -1

    in_chunks(work, size, _TRIANGLES_A_THREAD)


def mark_within(out: Bools, triangles: Floats, half: float, radii: Floats) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` lies within its radius of a triangle.

    Parameters
    ----------
    out : ndarray of bool, shape (nx, ny, nz)
        The cubes that meet a triangle must be set already, unless ``half`` is zero.
    triangles : ndarray, shape (n, 3, 3)
        In cells, in the index frame of ``out``.
    half : float
        In cells.
    radii : ndarray, shape (n,)
        In cells.
    """
    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    slack = _ROUNDING + 2.0**-34 * size + 2.0**-50 * size * size

    def work(start: int, stop: int) -> int:
        _mark_within(out, triangles, radii, half, slack, start, stop)
        return -1

    in_chunks(work, len(out), _SLABS_A_THREAD)


def cut_to(triangles: Floats, longest: Callable[[Floats], Floats]) -> Floats:
    """Pieces of triangles, shape (n, 3, 3): halved across the longest side until it is no longer than it may be.

    ``longest`` gives the length for each of some triangles.
    """
    done = []
    while len(triangles):
        sides = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = sides.max(axis=1) > longest(triangles)
        done.append(triangles[~long])
        turned = (sides[long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[long], turned[..., None], axis=1), 1, 0)
        middle = (a + b) / 2.0
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)


@jit
def _at(plane: float, pa: float, qa: float, pc: float, qc: float) -> float:
    """Coordinate c where a segment meets a plane of axis a, computed from the nearer end for the smaller rounding."""
    t = (plane - pa) / (qa - pa)
    if t <= 0.5:
        return pc + t * (qc - pc)
    return qc + (plane - qa) / (pa - qa) * (pc - qc)


@jit
def _clip_to_slab(triangle: Floats, x0: float, x1: float, polygon: Floats) -> int:
    """The (y, z) of the corners, in order, of the part of a triangle over ``x0 <= x <= x1``; their number."""
    n = 0
    for e in range(3):
        px, py, pz = triangle[e]
        qx, qy, qz = triangle[(e + 1) % 3]
        if x0 <= px <= x1:
            polygon[n, 0], polygon[n, 1] = py, pz
            n += 1
        for side in range(2):
            plane = x0 if (side == 0) == (px < qx) else x1
            if (px < plane < qx) or (qx < plane < px):
                polygon[n, 0] = _at(plane, px, qx, py, qy)
                polygon[n, 1] = _at(plane, px, qx, pz, qz)
                n += 1
    return n


@jit
def _span_over_slab(polygon: Floats, n: int, y0: float, y1: float) -> tuple[float, float]:
    """z-interval of the part of a convex polygon (y, z) over ``y0 <= y <= y1``; (inf, -inf) where there is none."""
    low, high = math.inf, -math.inf
    for e in range(n):
        py, pz = polygon[e]
        qy, qz = polygon[e + 1 if e + 1 < n else 0]
        if y0 <= py <= y1:
            low, high = min(low, pz), max(high, pz)
        if (py < y0 < qy) or (qy < y0 < py):
            z = _at(y0, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
        if (py < y1 < qy) or (qy < y1 < py):
            z = _at(y1, py, qy, pz, qz)
            low, high = min(low, z), max(high, z)
    return low, high


@jit
def _mark_touched(out: Bools, triangles: Floats, b0: float, b1: float, slack: float, start: int, stop: int) -> None:
    """Set ``out[i]`` where box ``i`` comes within ``slack`` of a triangle, for first indices in ``[start, stop)``."""
    _, ny, nz = out.shape
    polygon = np.empty((9, 2))
    for t in range(triangles.shape[0]):
        triangle = triangles[t]
        low_x = min(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        high_x = max(triangle[0, 0], triangle[1, 0], triangle[2, 0])
        first = max(start, math.ceil(low_x - slack - b1))
        last = min(stop - 1, math.floor(high_x + slack - b0))
        for i in range(first, last + 1):
            n = _clip_to_slab(triangle, i + b0 - slack, i + b1 + slack, polygon)
            if n == 0:
                continue
            low_y, high_y = polygon[0, 0], polygon[0, 0]
            for e in range(1, n):
                low_y, high_y = min(low_y, polygon[e, 0]), max(high_y, polygon[e, 0])
            first_y = max(0, math.ceil(low_y - slack - b1))
            last_y = min(ny - 1, math.floor(high_y + slack - b0))
            for j in range(first_y, last_y + 1):
                low, high = _span_over_slab(polygon, n, j + b0 - slack, j + b1 + slack)
                if low > high:
                    continue
                first_z = max(0, math.ceil(low - slack - b1))
                last_z = min(nz - 1, math.floor(high + slack - b0))
                for k in range(first_z, last_z + 1):
                    out[i, j, k] = True


@jit
def _to_segment(x: float, y: float, z: float, p: Floats, q: Floats) -> tuple[float, float, float]:
    """Vector from a point to the nearest one of a segment."""
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    wx, wy, wz = x - p[0], y - p[1], z - p[2]
    square = dx * dx + dy * dy + dz * dz
    t = min(max((wx * dx + wy * dy + wz * dz) / square, 0.0), 1.0) if square > 0.0 else 0.0
    if t > 0.5:
        wx, wy, wz = x - q[0], y - q[1], z - q[2]
        t -= 1.0
    return t * dx - wx, t * dy - wy, t * dz - wz


@jit
def point_segment(x: float, y: float, z: float, p: Floats, q: Floats) -> float:
    """Squared distance between a point and a segment."""
    wx, wy, wz = _to_segment(x, y, z, p, q)
    return wx * wx + wy * wy + wz * wz


@jit
def cross(a: Floats, b: Floats, c: Floats) -> tuple[float, float, float]:
    """``(b - a) x (c - a)``."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@jit
def _to_triangle(x: float, y: float, z: float, triangle: Floats) -> tuple[float, float, float, float]:
    """Vector from a point to the nearest one of a triangle, and how much nearer a thin triangle might be than that."""
    square, longest = math.inf, 0.0
    bx, by, bz = 0.0, 0.0, 0.0
    for e in range(3):
        p, q = triangle[e], triangle[e + 1 if e < 2 else 0]
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        longest = max(longest, dx * dx + dy * dy + dz * dz)
        wx, wy, wz = _to_segment(x, y, z, p, q)
        if wx * wx + wy * wy + wz * wz < square:
            bx, by, bz = wx, wy, wz
            square = wx * wx + wy * wy + wz * wz
    longest = math.sqrt(longest)
    nx, ny, nz = cross(triangle[0], triangle[1], triangle[2])
    normal = math.sqrt(nx * nx + ny * ny + nz * nz)
    if normal <= THIN * longest * longest:
        # No point of the triangle is farther from its sides than its height.
        return bx, by, bz, THIN * longest
    nx, ny, nz = nx / normal, ny / normal, nz / normal
    for e in range(3):
        p, q = triangle[e], triangle[e + 1 if e < 2 else 0]
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        wx, wy, wz = x - p[0], y - p[1], z - p[2]
        if nx * (dy * wz - dz * wy) + ny * (dz * wx - dx * wz) + nz * (dx * wy - dy * wx) < 0.0:
            return bx, by, bz, 0.0
    p = triangle[0]
    height = nx * (p[0] - x) + ny * (p[1] - y) + nz * (p[2] - z)
    if height * height > square:
        return bx, by, bz, 0.0
    return nx * height, ny * height, nz * height, 0.0


@jit
def point_triangle(x: float, y: float, z: float, triangle: Floats) -> float:
    """Distance between a point and a triangle; up to ``THIN`` times its longest side less for a thin one."""
    wx, wy, wz, doubt = _to_triangle(x, y, z, triangle)
    return max(0.0, math.sqrt(wx * wx + wy * wy + wz * wz) - doubt)


@jit
def _box_point(dx: float, dy: float, dz: float, half: float) -> float:
    """Distance of a point from a cube about the origin."""
    dx, dy, dz = max(abs(dx) - half, 0.0), max(abs(dy) - half, 0.0), max(abs(dz) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@jit
def _box_edges(p: Floats, q: Floats, center: Floats, half: float) -> float:
    """Smallest distance of a segment from the edges of a cube, where both are met between their ends; else inf."""
    best = math.inf
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        du, dv, da = q[u] - p[u], q[v] - p[v], q[axis] - p[axis]
        square = du * du + dv * dv
        if square == 0.0:
            continue
        for corner in range(4):
            wu = center[u] + (half if corner & 1 else -half) - p[u]
            wv = center[v] + (half if corner & 2 else -half) - p[v]
            t = (wu * du + wv * dv) / square
            if 0.0 <= t <= 1.0 and abs(p[axis] + t * da - center[axis]) <= half:
                best = min(best, abs(wu * dv - wv * du) / math.sqrt(square))
    return best


@jit
def _box_triangle(triangle: Floats, center: Floats, half: float) -> float:
    """Distance of a triangle from a cube that it does not meet."""
    best = math.inf
    for corner in range(8):
        x = center[0] + (half if corner & 1 else -half)
        y = center[1] + (half if corner & 2 else -half)
        z = center[2] + (half if corner & 4 else -half)
        best = min(best, point_triangle(x, y, z, triangle))
    for e in range(3):
        p, q = triangle[e], triangle[e + 1 if e < 2 else 0]
        best = min(best, _box_point(p[0] - center[0], p[1] - center[1], p[2] - center[2], half))
        best = min(best, _box_edges(p, q, center, half))
    return best


@jit
def _mark_within(
    out: Bools, triangles: Floats, radii: Floats, half: float, slack: float, start: int, stop: int
) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` comes within ``radii[t] + slack`` of triangle ``t``.

    For first indices in ``[start, stop)``; the cubes that meet a triangle must be set already.
    """
    _, ny, nz = out.shape
    center = np.empty(3)
    for t in range(len(triangles)):
        radius = radii[t]
        reach = radius + half + slack
        triangle = triangles[t]
        a, b, c = triangle[0], triangle[1], triangle[2]
        mx, my, mz = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
        # Beyond this distance from its middle a cube is too far from all of the triangle.
        beyond = (
            radius
            + slack
            + math.sqrt(
                max(
                    (a[0] - mx) ** 2 + (a[1] - my) ** 2 + (a[2] - mz) ** 2,
                    (b[0] - mx) ** 2 + (b[1] - my) ** 2 + (b[2] - mz) ** 2,
                    (c[0] - mx) ** 2 + (c[1] - my) ** 2 + (c[2] - mz) ** 2,
                )
            )
        )
        first = max(start, math.ceil(min(triangle[0, 0], triangle[1, 0], triangle[2, 0]) - reach))
        last = min(stop - 1, math.floor(max(triangle[0, 0], triangle[1, 0], triangle[2, 0]) + reach))
        first_y = max(0, math.ceil(min(triangle[0, 1], triangle[1, 1], triangle[2, 1]) - reach))
        last_y = min(ny - 1, math.floor(max(triangle[0, 1], triangle[1, 1], triangle[2, 1]) + reach))
        first_z = max(0, math.ceil(min(triangle[0, 2], triangle[1, 2], triangle[2, 2]) - reach))
        last_z = min(nz - 1, math.floor(max(triangle[0, 2], triangle[1, 2], triangle[2, 2]) + reach))
        for i in range(first, last + 1):
            dx = max(0.0, abs(i - mx) - half)
            for j in range(first_y, last_y + 1):
                # What is within the radius of the middle is a run along z, and so is what may be near enough.
                dy = max(0.0, abs(j - my) - half)
                may = beyond * beyond - dx * dx - dy * dy
                if may < 0.0:
                    continue
                sure = radius * radius - dx * dx - dy * dy
                if sure >= 0.0:
                    low = max(first_z, math.ceil(mz - math.sqrt(sure) - half))
                    for k in range(low, min(last_z, math.floor(mz + math.sqrt(sure) + half)) + 1):
                        out[i, j, k] = True
                low = max(first_z, math.ceil(mz - math.sqrt(may) - half))
                for k in range(low, min(last_z, math.floor(mz + math.sqrt(may) + half)) + 1):
                    if out[i, j, k]:
                        continue
                    wx, wy, wz, doubt = _to_triangle(i, j, k, triangle)
                    if _box_point(wx, wy, wz, half) > radius:
                        # The triangle lies beyond the plane through its nearest point, across the way there.
                        length = math.sqrt(wx * wx + wy * wy + wz * wz)
                        if length - doubt - half * (abs(wx) + abs(wy) + abs(wz)) / length > radius + slack:
                            continue
                        center[0], center[1], center[2] = i, j, k
                        if _box_triangle(triangle, center, half) > radius + slack:
                            continue
                    out[i, j, k] = True

"""Compiled kernels of distances. Where a triangle is so thin that its plane is in doubt, they err to the small side."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]

THIN = 2.0**-12
"""Height of a triangle over its longest side below which its plane is not used."""


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def point_segment(x: float, y: float, z: float, p: Floats, q: Floats) -> float:
    """Squared distance between a point and a segment."""
    wx, wy, wz = _to_segment(x, y, z, p, q)
    return wx * wx + wy * wy + wz * wz


@njit(cache=True, nogil=True)
def cross(a: Floats, b: Floats, c: Floats) -> tuple[float, float, float]:
    """``(b - a) x (c - a)``."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def point_triangle(x: float, y: float, z: float, triangle: Floats) -> float:
    """Distance between a point and a triangle; up to ``THIN`` times its longest side less for a thin one."""
    wx, wy, wz, doubt = _to_triangle(x, y, z, triangle)
    return max(0.0, math.sqrt(wx * wx + wy * wy + wz * wz) - doubt)


@njit(cache=True, nogil=True)
def _box_point(dx: float, dy: float, dz: float, half: float) -> float:
    """Distance of a point from a cube about the origin."""
    dx, dy, dz = max(abs(dx) - half, 0.0), max(abs(dy) - half, 0.0), max(abs(dz) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def mark_within(out: Bools, triangles: Floats, half: float, radius: float, slack: float, start: int, stop: int) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` comes within ``radius + slack`` of a triangle.

    For first indices in ``[start, stop)``; the cubes that meet a triangle must be set already.
    """
    _, ny, nz = out.shape
    reach = radius + half + slack
    surely_not = radius + half * math.sqrt(3.0) + slack
    center = np.empty(3)
    for t in range(len(triangles)):
        triangle = triangles[t]
        a, b, c = triangle[0], triangle[1], triangle[2]
        mx, my, mz = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
        # Beyond this distance from its middle a cube is too far from all of the triangle.
        beyond = surely_not + math.sqrt(
            max(
                (a[0] - mx) ** 2 + (a[1] - my) ** 2 + (a[2] - mz) ** 2,
                (b[0] - mx) ** 2 + (b[1] - my) ** 2 + (b[2] - mz) ** 2,
                (c[0] - mx) ** 2 + (c[1] - my) ** 2 + (c[2] - mz) ** 2,
            )
        )
        first = max(start, math.ceil(min(triangle[0, 0], triangle[1, 0], triangle[2, 0]) - reach))
        last = min(stop - 1, math.floor(max(triangle[0, 0], triangle[1, 0], triangle[2, 0]) + reach))
        first_y = max(0, math.ceil(min(triangle[0, 1], triangle[1, 1], triangle[2, 1]) - reach))
        last_y = min(ny - 1, math.floor(max(triangle[0, 1], triangle[1, 1], triangle[2, 1]) + reach))
        first_z = max(0, math.ceil(min(triangle[0, 2], triangle[1, 2], triangle[2, 2]) - reach))
        last_z = min(nz - 1, math.floor(max(triangle[0, 2], triangle[1, 2], triangle[2, 2]) + reach))
        for i in range(first, last + 1):
            for j in range(first_y, last_y + 1):
                for k in range(first_z, last_z + 1):
                    if out[i, j, k] or (i - mx) ** 2 + (j - my) ** 2 + (k - mz) ** 2 > beyond * beyond:
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

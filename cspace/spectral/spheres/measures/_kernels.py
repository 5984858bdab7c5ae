"""Compiled measures of unions of balls, in the plane (two axes) or in space."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def gaps(points: Floats, half: float, centers: Floats, radii: Floats, near: Floats, far: Floats) -> None:
    """For cubes of half a side ``half`` round points: the distance of the middle from the nearest ball, and a length
    by which one ball must grow to hold the cube; both are below zero deep in a ball."""
    dim = points.shape[1]
    for n in range(points.shape[0]):
        least, most = math.inf, math.inf
        for m in range(centers.shape[0]):
            middle, corner = 0.0, 0.0
            for axis in range(dim):
                d = abs(points[n, axis] - centers[m, axis])
                middle += d * d
                corner += (d + half) * (d + half)
            least = min(least, math.sqrt(middle) - radii[m])
            most = min(most, math.sqrt(corner) - radii[m])
        near[n], far[n] = least, most


@njit(cache=True, nogil=True)
def split_volume(lower: Floats, side: float, levels: int, centers: Floats, radii: Floats, slack: float) -> Floats:
    """Volume of the cubes, of a cube cut in two ``levels`` times, that lie in one ball, and of those that meet some.

    A cube that one ball holds, or that none meets, is not cut.
    """
    inner, outer = 0.0, 0.0
    stack = np.empty((8 * levels + 8, 4))
    depth = np.empty(8 * levels + 8, dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = lower[0], lower[1], lower[2], side
    depth[0] = 0
    # Balls that meet a cube and do not hold it are all that its parts are asked of: one list for each level.
    lists = np.empty((levels + 2, len(radii)), dtype=np.int64)
    counts = np.zeros(levels + 2, dtype=np.int64)
    lists[0] = np.arange(len(radii))
    counts[0] = len(radii)
    waiting = 1
    while waiting > 0:
        waiting -= 1
        x, y, z, s = stack[waiting]
        level = depth[waiting]
        held, found = False, 0
        for index in range(counts[level]):
            m = lists[level, index]
            a, b, c = centers[m]
            nx, ny, nz = max(0.0, x - a, a - x - s), max(0.0, y - b, b - y - s), max(0.0, z - c, c - z - s)
            r = radii[m] + slack
            if nx * nx + ny * ny + nz * nz > r * r:
                continue
            fx, fy, fz = max(a - x, x + s - a), max(b - y, y + s - b), max(c - z, z + s - c)
            r = radii[m] - slack
            if r > 0.0 and fx * fx + fy * fy + fz * fz <= r * r:
                held = True
                break
            lists[level + 1, found] = m
            found += 1
        if held:
            inner += s * s * s
            outer += s * s * s
        elif found > 0:
            if level == levels:
                outer += s * s * s
                continue
            counts[level + 1] = found
            h = 0.5 * s
            for part in range(8):
                stack[waiting, 0] = x + h * (part & 1)
                stack[waiting, 1] = y + h * ((part >> 1) & 1)
                stack[waiting, 2] = z + h * (part >> 2)
                stack[waiting, 3] = h
                depth[waiting] = level + 1
                waiting += 1
    return np.array([inner, outer])

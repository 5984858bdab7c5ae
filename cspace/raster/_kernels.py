"""Compiled kernels of the rasters. Lengths are in cells, in the index frame of the array that is written.

A *box* ``i`` is ``i + [b0, b1]`` along each axis: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer
raster of a robot, ``(c, c)`` for sample points.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@njit(cache=True, nogil=True)
def _segment_over_slab(px: float, py: float, qx: float, qy: float, x0: float, x1: float) -> tuple[float, float]:
    """y-interval of a segment over the slab ``x0 <= x <= x1``; (inf, -inf) where they do not meet."""
    if max(px, qx) < x0 or min(px, qx) > x1:
        return math.inf, -math.inf
    if px == qx:
        return min(py, qy), max(py, qy)
    t0 = min(max((x0 - px) / (qx - px), 0.0), 1.0)
    t1 = min(max((x1 - px) / (qx - px), 0.0), 1.0)
    y0 = py + t0 * (qy - py)
    y1 = py + t1 * (qy - py)
    return min(y0, y1), max(y0, y1)


@njit(cache=True, nogil=True)
def _disc_over_slab(cx: float, cy: float, radius: float, x0: float, x1: float) -> tuple[float, float]:
    """y-interval of a disc over the slab ``x0 <= x <= x1``; (inf, -inf) where they do not meet."""
    dx = max(0.0, x0 - cx, cx - x1)
    if dx > radius:
        return math.inf, -math.inf
    half = math.sqrt(radius * radius - dx * dx)
    return cy - half, cy + half


@njit(cache=True, nogil=True)
def mark_touched(out: Bools, segments: Floats, radii: Floats, b0: float, b1: float, slack: float) -> None:
    """Set ``out[i]`` where box ``i`` comes within ``slack`` of a segment grown by its radius.

    The grown segment is convex, so that its part over the x-slab of a box spans an interval of y; the box meets it
    exactly where their y-intervals overlap. That interval is the hull of those of the two end discs and of the
    rectangle between them.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py, qx, qy = segments[e]
        radius = radii[e] + slack if radii[e] > 0.0 else 0.0
        ox, oy = 0.0, 0.0
        length = math.hypot(qx - px, qy - py)
        if radius > 0.0 and length > 0.0:
            ox = -(qy - py) / length * radius
            oy = (qx - px) / length * radius
        first = max(0, math.ceil(min(px, qx) - radius - slack - b1))
        last = min(nx - 1, math.floor(max(px, qx) + radius + slack - b0))
        for i in range(first, last + 1):
            x0 = i + b0 - slack
            x1 = i + b1 + slack
            low, high = _segment_over_slab(px, py, qx, qy, x0, x1)
            if radius > 0.0:
                for side in (-1.0, 1.0):
                    ax, ay = px + side * ox, py + side * oy
                    bx, by = qx + side * ox, qy + side * oy
                    lo, hi = _segment_over_slab(ax, ay, bx, by, x0, x1)
                    low, high = min(low, lo), max(high, hi)
                lo, hi = _disc_over_slab(px, py, radius, x0, x1)
                low, high = min(low, lo), max(high, hi)
                lo, hi = _disc_over_slab(qx, qy, radius, x0, x1)
                low, high = min(low, lo), max(high, hi)
            if low > high:
                continue
            start = max(0, math.ceil(low - slack - b1))
            stop = min(ny - 1, math.floor(high + slack - b0))
            for j in range(start, stop + 1):
                out[i, j] = True


@njit(cache=True, nogil=True)
def mark_inside(out: Bools, segments: Floats, c: float) -> None:
    """Set ``out[i, j]`` where the point ``(i + c, j + c)`` is inside closed curves, by even-odd parity.

    Exact for points farther from the curve than rounding; ``out`` must be all False.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py, qx, qy = segments[e]
        if px == qx:
            continue
        if px > qx:
            px, py, qx, qy = qx, qy, px, py
        # The column x = i + c is crossed where px <= x < qx: a vertex counts for one of its two edges.
        first = max(0, math.ceil(px - c))
        last = min(nx - 1, math.ceil(qx - c) - 1)
        for i in range(first, last + 1):
            y = py + (i + c - px) / (qx - px) * (qy - py)
            j = math.floor(y - c) + 1
            if j < ny:
                j = max(j, 0)
                out[i, j] = not out[i, j]
    for i in range(nx):
        inside = False
        for j in range(ny):
            inside ^= out[i, j]
            out[i, j] = inside


@njit(cache=True, nogil=True)
def mark_ball_points(out: Bools, centers: Floats, radii: Floats, slack: float) -> None:
    """Set ``out[i, j]`` where the lattice point ``(i, j)`` lies deeper than ``slack`` inside a disc."""
    nx, ny = out.shape
    for b in range(centers.shape[0]):
        cx, cy = centers[b]
        radius = radii[b] - 2.0 * slack
        if radius < 0.0:
            continue
        for i in range(max(0, math.ceil(cx - radius)), min(nx - 1, math.floor(cx + radius)) + 1):
            half = math.sqrt(max(0.0, radius * radius - (i - cx) * (i - cx))) - slack
            for j in range(max(0, math.ceil(cy - half)), min(ny - 1, math.floor(cy + half)) + 1):
                out[i, j] = True

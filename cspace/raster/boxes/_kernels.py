"""Compiled kernels of rounded boxes. Lengths are in cells, in the index frame of the array that is written.

A *rounded box* is an axis-aligned box, grown by a radius of zero or more; a ball is one without extents. Cube ``i`` is
``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of a robot, ``(0, 0)`` for
sample points. Each kernel writes ``out[start:stop]`` alone, so that threads may share ``out``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@njit(cache=True, nogil=True)
def mark_touched(
    out: Bools, lows: Floats, highs: Floats, radii: Floats, b0: float, b1: float, slack: float, start: int, stop: int
) -> None:
    """Set ``out[i]`` where cube ``i`` comes within ``slack`` of a rounded box.

    Along each axis the cube and the box are apart by a gap, zero where their intervals meet; the rounded box is met
    where the squares of the three gaps add up to at most that of the radius.
    """
    _, ny, nz = out.shape
    for n in range(lows.shape[0]):
        radius = radii[n] + slack if radii[n] > 0.0 else 0.0
        square = radius * radius
        xlow, ylow, zlow = lows[n, 0] - slack, lows[n, 1] - slack, lows[n, 2] - slack
        xhigh, yhigh, zhigh = highs[n, 0] + slack, highs[n, 1] + slack, highs[n, 2] + slack
        i_first = max(start, math.ceil(xlow - radius - b1))
        i_last = min(stop - 1, math.floor(xhigh + radius - b0))
        if i_first > i_last or zlow - radius - b1 > nz or zhigh + radius - b0 < -1.0:
            continue
        j_first = max(0, math.ceil(ylow - radius - b1))
        j_last = min(ny - 1, math.floor(yhigh + radius - b0))
        for i in range(i_first, i_last + 1):
            dx = max(0.0, xlow - (i + b1), (i + b0) - xhigh)
            for j in range(j_first, j_last + 1):
                dy = max(0.0, ylow - (j + b1), (j + b0) - yhigh)
                rest = square - dx * dx - dy * dy
                if rest < 0.0:
                    continue
                half = math.sqrt(rest)
                k_first = max(0, math.ceil(zlow - half - b1))
                k_last = min(nz - 1, math.floor(zhigh + half - b0))
                for k in range(k_first, k_last + 1):
                    out[i, j, k] = True


@njit(cache=True, nogil=True)
def mark_inside(
    out: Bools, lows: Floats, highs: Floats, radii: Floats, b0: float, b1: float, slack: float, start: int, stop: int
) -> None:
    """Set ``out[i]`` where cube ``i`` lies deeper than ``slack`` inside one rounded box.

    Along each axis the cube sticks out of the box by an excess, zero where it does not; its farthest corner is in the
    rounded box where the squares of the three excesses add up to at most that of the radius.
    """
    _, ny, nz = out.shape
    for n in range(lows.shape[0]):
        radius = max(0.0, radii[n] - 2.0 * slack)
        square = radius * radius
        xlow, ylow, zlow = lows[n, 0] + slack, lows[n, 1] + slack, lows[n, 2] + slack
        xhigh, yhigh, zhigh = highs[n, 0] - slack, highs[n, 1] - slack, highs[n, 2] - slack
        i_first = max(start, math.ceil(xlow - radius - b0))
        i_last = min(stop - 1, math.floor(xhigh + radius - b1))
        if i_first > i_last or zlow - radius - b0 > nz or zhigh + radius - b1 < -1.0:
            continue
        j_first = max(0, math.ceil(ylow - radius - b0))
        j_last = min(ny - 1, math.floor(yhigh + radius - b1))
        for i in range(i_first, i_last + 1):
            dx = max(0.0, xlow - (i + b0), (i + b1) - xhigh)
            for j in range(j_first, j_last + 1):
                dy = max(0.0, ylow - (j + b0), (j + b1) - yhigh)
                rest = square - dx * dx - dy * dy
                if rest < 0.0:
                    continue
                half = math.sqrt(rest)
                k_first = max(0, math.ceil(zlow - half - b0))
                k_last = min(nz - 1, math.floor(zhigh + half - b1))
                for k in range(k_first, k_last + 1):
                    out[i, j, k] = True


@njit(cache=True, nogil=True)
def merge_boxes(occupied: Bools) -> NDArray[np.int64]:
    """Disjoint boxes of cells whose union is the set, shape (n, 6): first cells, then the cells one past the last.

    From each cell that no box holds yet, the box grows along z, then y, then x, while every cell is set.
    """
    nx, ny, nz = occupied.shape
    left = occupied.copy()
    boxes = np.empty((64, 6), dtype=np.int64)
    count = 0
    for i in range(nx):
        for j in range(ny):
            k = 0
            while k < nz:
                if not left[i, j, k]:
                    k += 1
                    continue
                k_stop = k + 1
                while k_stop < nz and left[i, j, k_stop]:
                    k_stop += 1
                j_stop = j + 1
                while j_stop < ny and left[i, j_stop, k:k_stop].all():
                    j_stop += 1
                i_stop = i + 1
                while i_stop < nx and left[i_stop, j:j_stop, k:k_stop].all():
                    i_stop += 1
                left[i:i_stop, j:j_stop, k:k_stop] = False
                if count == len(boxes):
                    longer = np.empty((2 * count, 6), dtype=np.int64)
                    longer[:count] = boxes
                    boxes = longer
                boxes[count] = (i, j, k, i_stop, j_stop, k_stop)
                count += 1
                k = k_stop
    return boxes[:count].copy()

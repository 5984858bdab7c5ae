"""Compiled choice of balls among candidates, by the cells that they hold.

``times[i, j, k]`` is how many of the chosen balls hold a cell, or -1 for cells that do not matter. Lengths are in sides
of a cell. A ball holds a cell where ``sum (|middle - center| + half)^2 <= reach^2`` over the axes: its middle, with
``half`` zero, or all of it.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.spectral.spheres.fields._kernels import Tree, distance

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Times = NDArray[np.int32]

EPS = 2.0**-20
"""Rounding allowance, in sides of a cell: by this, a ball that holds a cell reaches beyond it."""


@njit(cache=True, nogil=True)
def _span(center: float, length: float, count: int) -> tuple[int, int]:
    """First and last of the middles within a length of a center along an axis."""
    return max(0, math.ceil(center - length - 0.5)), min(count - 1, math.floor(center + length - 0.5))


@njit(cache=True, nogil=True)
def gain(times: Times, center: Floats, reach: float, half: Floats) -> int:
    """How many cells a ball holds that none holds so far."""
    nx, ny, nz = times.shape
    r = reach - EPS
    found = 0
    i0, i1 = _span(center[0], r - half[0], nx)
    for i in range(i0, i1 + 1):
        x = r * r - (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x < 0.0:
            continue
        j0, j1 = _span(center[1], math.sqrt(x) - half[1], ny)
        for j in range(j0, j1 + 1):
            y = x - (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if y < 0.0:
                continue
            k0, k1 = _span(center[2], math.sqrt(y) - half[2], nz)
            for k in range(k0, k1 + 1):
                found += times[i, j, k] == 0
    return found


@njit(cache=True, nogil=True)
def add(times: Times, center: Floats, reach: float, half: Floats, step: int) -> None:
    """Count a ball in (``step`` 1) or out (-1)."""
    nx, ny, nz = times.shape
    r = reach - EPS
    i0, i1 = _span(center[0], r - half[0], nx)
    for i in range(i0, i1 + 1):
        x = r * r - (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x < 0.0:
            continue
        j0, j1 = _span(center[1], math.sqrt(x) - half[1], ny)
        for j in range(j0, j1 + 1):
            y = x - (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if y < 0.0:
                continue
            k0, k1 = _span(center[2], math.sqrt(y) - half[2], nz)
            for k in range(k0, k1 + 1):
                if times[i, j, k] >= 0:
                    times[i, j, k] += step


@njit(cache=True, nogil=True)
def needed(times: Times, center: Floats, reach: float, half: Floats) -> float:
    """The least reach with which a ball still holds the cells that only it holds; zero where there are none."""
    nx, ny, nz = times.shape
    r = reach - EPS
    most = -1.0
    i0, i1 = _span(center[0], r - half[0], nx)
    for i in range(i0, i1 + 1):
        dx = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        x = r * r - dx
        if x < 0.0:
            continue
        j0, j1 = _span(center[1], math.sqrt(x) - half[1], ny)
        for j in range(j0, j1 + 1):
            dy = (abs(j + 0.5 - center[1]) + half[1]) ** 2
            y = x - dy
            if y < 0.0:
                continue
            k0, k1 = _span(center[2], math.sqrt(y) - half[2], nz)
            for k in range(k0, k1 + 1):
                if times[i, j, k] == 1:
                    most = max(most, dx + dy + (abs(k + 0.5 - center[2]) + half[2]) ** 2)
    # Two allowances: one that the ball reaches beyond its cells, and one for the root.
    return min(reach, math.sqrt(most) + 2.0 * EPS) if most >= 0.0 else 0.0


@njit(cache=True, nogil=True)
def _sum_up(times: Times, sums: NDArray[np.int32], center: Floats, reach: float) -> None:
    """Count the cells that no ball holds along each row that a ball meets: ``sums[i, j, k]`` before the k-th."""
    nx, ny, nz = times.shape
    i0, i1 = _span(center[0], reach + 1.0, nx)
    j0, j1 = _span(center[1], reach + 1.0, ny)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            found = 0
            for k in range(nz):
                sums[i, j, k] = found
                found += times[i, j, k] == 0
            sums[i, j, nz] = found


@njit(cache=True, nogil=True)
def _gain_by(sums: NDArray[np.int32], center: Floats, reach: float, half: Floats) -> int:
    """As :func:`gain`, by the sums along rows."""
    nx, ny, nz = sums.shape
    r = reach - EPS
    found = 0
    i0, i1 = _span(center[0], r - half[0], nx)
    for i in range(i0, i1 + 1):
        x = r * r - (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x < 0.0:
            continue
        j0, j1 = _span(center[1], math.sqrt(x) - half[1], ny)
        for j in range(j0, j1 + 1):
            y = x - (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if y < 0.0 or sums[i, j, nz - 1] == 0:
                continue
            k0, k1 = _span(center[2], math.sqrt(y) - half[2], nz - 1)
            if k0 <= k1:
                found += sums[i, j, k1 + 1] - sums[i, j, k0]
    return found


@njit(cache=True, nogil=True)
def choose(times: Times, centers: Floats, reaches: Floats, half: Floats, bounds: Floats, most: int) -> Ints:
    """The balls that a greedy choice takes, each for the cells that it adds: numbers, in their order.

    A ball adds no more cells than it did before others were taken (M. Minoux, "Accelerated greedy algorithms for
    maximizing submodular set functions", 1978), nor than ``bounds``. It ends when no ball adds a cell.
    """
    chosen = np.empty(min(most, len(centers)), dtype=np.int64)
    nx, ny, nz = times.shape
    sums = np.empty((nx, ny, nz + 1), dtype=np.int32)
    _sum_up(times, sums, np.zeros(3), float(nx + ny + nz))
    count, left = 0, 0
    for state in times.ravel():
        left += state == 0
    queue = [(-bounds[n], n) for n in range(len(centers))]
    heapq.heapify(queue)
    while len(queue) > 0 and count < len(chosen) and left > 0:
        _, n = heapq.heappop(queue)
        found = float(_gain_by(sums, centers[n], reaches[n], half))
        if found == 0.0:
            continue
        if len(queue) > 0 and found < -queue[0][0]:
            heapq.heappush(queue, (-found, n))
            continue
        add(times, centers[n], reaches[n], half, 1)
        _sum_up(times, sums, centers[n], reaches[n])
        chosen[count] = n
        count += 1
        left -= int(found)
    return chosen[:count]


@njit(cache=True, nogil=True)
def shrink(times: Times, centers: Floats, reaches: Floats, half: Floats, order: Ints) -> None:
    """Cut balls, in an order, to the cells that only they hold; ``reaches`` become zero where there are none."""
    for n in order:
        least = needed(times, centers[n], reaches[n], half)
        if least < reaches[n]:
            add(times, centers[n], reaches[n], half, -1)
            if least > 0.0:
                add(times, centers[n], least, half, 1)
            reaches[n] = least


@njit(cache=True, nogil=True)
def spare(times: Times, centers: Floats, reaches: Floats, half: Floats, order: Ints) -> None:
    """Drop balls, in an order, that hold no cell alone: their ``reaches`` become zero."""
    for n in order:
        if needed(times, centers[n], reaches[n], half) == 0.0:
            add(times, centers[n], reaches[n], half, -1)
            reaches[n] = 0.0


@njit(cache=True, nogil=True)
def polish(
    times: Times, tree: Tree, centers: Floats, radii: Floats, corner: Floats, side: float, slack: float, rounds: int
) -> None:
    """Move balls that lie in a shape, as large as it allows, to where they hold more cells; in place.

    A step that stays in the ball stays in the shape, so that the distance from the border is the new radius.
    """
    half = np.zeros(3)
    trial = np.empty(3)
    for turn in range(rounds):
        moved = False
        for n in range(len(centers)):
            add(times, centers[n], radii[n], half, -1)
            best = gain(times, centers[n], radii[n], half)
            step = 2.0 / (1 << turn)
            for _ in range(4):
                found = False
                for axis in range(3):
                    if times.shape[axis] == 1:
                        continue
                    for sign in (-1.0, 1.0):
                        if step >= 0.9 * radii[n]:
                            continue
                        trial[:] = centers[n]
                        trial[axis] += sign * step
                        x, y, z = corner[0] + side * trial[0], corner[1] + side * trial[1], corner[2] + side * trial[2]
                        radius = (distance(tree, x, y, z, 2.0 * side * (radii[n] + step)) - slack) / side
                        if radius <= 0.0:
                            continue
                        number = gain(times, trial, radius, half)
                        if number > best or (number == best and radius > radii[n]):
                            found = moved = True
                            best = number
                            centers[n], radii[n] = trial, radius
                if not found:
                    step *= 0.5
            add(times, centers[n], radii[n], half, 1)
        if not moved:
            break

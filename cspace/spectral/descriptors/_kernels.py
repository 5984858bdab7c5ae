"""Compiled sums of bumps."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True, inline="always")
def _bump(square: float, alpha: float) -> float:
    """The bump at the square of a distance below 1, in radii."""
    if alpha == np.inf or square == 0.0:
        return 1.0
    power = np.expm1(-0.5 * alpha * np.log(square))
    return float(np.exp(-1.0 / power)) if power > 0.0 else 0.0


@njit(cache=True, nogil=True)
def add_balls(
    centers: Floats, radii: Floats, alpha: float, lower: Floats, spacing: float, values: Floats, start: int, stop: int
) -> int:
    """Add the bumps of balls, at the middles of cells, to the layers from ``start`` to ``stop`` of a grid.

    Parameters
    ----------
    centers : ndarray, shape (n, 3)
        Metres.
    radii : ndarray, shape (n,)
    alpha : float
    lower : ndarray, shape (3,)
        Middle of the first cell.
    spacing : float
    values : ndarray, shape (nx, ny, nz)
        Changed in place.
    start, stop : int

    Returns
    -------
    int
        -1.
    """
    for ball in range(len(radii)):
        radius = radii[ball]
        first = np.empty(3, np.int64)
        last = np.empty(3, np.int64)
        for axis in range(3):
            middle = (centers[ball, axis] - lower[axis]) / spacing
            reach = radius / spacing
            # One cell more on either side, for rounding; far outside is far outside.
            first[axis] = int(max(0.0, np.floor(middle - reach) - 1.0))
            last[axis] = int(min(float(values.shape[axis]), max(0.0, np.ceil(middle + reach) + 2.0)))
        for i in range(max(first[0], start), min(last[0], stop)):
            x = (lower[0] + spacing * i - centers[ball, 0]) / radius
            for j in range(first[1], last[1]):
                y = (lower[1] + spacing * j - centers[ball, 1]) / radius
                plane = x * x + y * y
                if plane < 1.0:
                    for k in range(first[2], last[2]):
                        z = (lower[2] + spacing * k - centers[ball, 2]) / radius
                        square = plane + z * z
                        if square < 1.0:
                            values[i, j, k] += _bump(square, alpha)
    return -1


@njit(cache=True, nogil=True)
def sum_at_points(
    centers: Floats, radii: Floats, alpha: float, points: Floats, values: Floats, start: int, stop: int
) -> int:
    """Sums of the bumps of balls at the points from ``start`` to ``stop``.

    Parameters
    ----------
    centers : ndarray, shape (n, dim)
    radii : ndarray, shape (n,)
    alpha : float
    points : ndarray, shape (m, dim)
    values : ndarray, shape (m,)
        Written.
    start, stop : int

    Returns
    -------
    int
        -1.
    """
    for point in range(start, stop):
        total = 0.0
        for ball in range(len(radii)):
            square = 0.0
            for axis in range(centers.shape[1]):
                away = (points[point, axis] - centers[ball, axis]) / radii[ball]
                square += away * away
            if square < 1.0:
                total += _bump(square, alpha)
        values[point] = total
    return -1

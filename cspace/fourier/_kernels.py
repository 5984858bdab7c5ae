"""Compiled loops over the sums that a transform yields."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

NEAREST = 1.5 * 2.0**52
"""A number below 2^50 that is added to this is rounded to the nearest whole one, which the low bits then hold."""


@njit(cache=True, nogil=True)
def round_sums(sums: NDArray[np.float64], missing: float) -> None:
    """Add to sums what they miss, and put the nearest whole numbers into the low bits of the results."""
    flat = sums.ravel()
    for k in range(flat.size):
        flat[k] = (flat[k] + missing) + NEAREST


@njit(cache=True, nogil=True)
def mark_digit(
    whole: NDArray[np.int64],
    mask: int,
    always: bool,
    add: bool,
    out: NDArray[np.uint8],
    corner: NDArray[np.int64],
    shape: NDArray[np.int64],
) -> None:
    """Whether bits of the first whole numbers, as many as ``shape``, are set, written or added to ``out`` at a corner.

    Arrays have three axes; those of the plane are one layer.
    """
    x, y, z = corner
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            row, numbers = out[x + i, y + j, z : z + nz], whole[i, j]
            if add:
                for k in range(nz):
                    row[k] += always or (numbers[k] & mask) != 0
            else:
                for k in range(nz):
                    row[k] = always or (numbers[k] & mask) != 0

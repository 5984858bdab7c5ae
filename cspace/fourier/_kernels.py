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
    x: int,
    y: int,
    nx: int,
    ny: int,
) -> None:
    """Whether bits of the first (nx, ny) whole numbers are set, written or added to ``out`` from (x, y) on."""
    for i in range(nx):
        row, numbers = out[x + i, y : y + ny], whole[i]
        if add:
            for j in range(ny):
                row[j] += always or (numbers[j] & mask) != 0
        else:
            for j in range(ny):
                row[j] = always or (numbers[j] & mask) != 0

"""Compiled making of coarse maps."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.coarse.sides import SHIFT, SIDE

Bytes = NDArray[np.uint8]


@njit(cache=True, nogil=True)
def mark_blocks(state: Bytes, coarse: Bytes, box: NDArray[np.int64], start: int, stop: int) -> None:
    """Mark the blocks that a box of cells touches by whether a cell in them is not FREE, which is zero.

    The box is given by its first cell and its last one, along three axes. Rows of blocks along the last axis are
    numbered, and those from ``start`` to before ``stop`` are marked.
    """
    first_a, first_b = box[0] >> SHIFT, box[1] >> SHIFT
    columns = (box[4] >> SHIFT) - first_b + 1
    low, high = (box[2] >> SHIFT) << SHIFT, min(((box[5] >> SHIFT) + 1) << SHIFT, state.shape[2])
    line = np.zeros(((high - low + SIDE - 1) >> SHIFT) << SHIFT, np.uint8)
    for row in range(start, stop):
        a, b = first_a + row // columns, first_b + row % columns
        line[:] = 0
        for i in range(a << SHIFT, min((a + 1) << SHIFT, state.shape[0])):
            for j in range(b << SHIFT, min((b + 1) << SHIFT, state.shape[1])):
                _unite(line, state[i, j, low:high])
        marks = coarse[a, b, (low >> SHIFT) :]
        for block in range(line.shape[0] >> SHIFT):
            mark = np.uint8(0)
            for k in range(SIDE):
                mark |= line[(block << SHIFT) + k]
            marks[block] = mark


@njit(cache=True, nogil=True)
def _unite(into: Bytes, cells: Bytes) -> None:
    for k in range(cells.shape[0]):
        into[k] |= cells[k]

"""Coarse maps: squares or cubes of cells, each with whether a cell in it is not FREE.

An edge that keeps to blocks of FREE cells need not be walked cell by cell, and a coarse map is so small that it stays
in the cache.
"""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import NDArray

from cspace.coarse.sides import SHIFT, SIDE
from cspace.once import Once
from cspace.threads import in_chunks

Bytes = NDArray[np.uint8]

CELLS_AN_EDGE = 4_000
"""Cells of a map for each edge that is asked about, below which a coarse map pays; making it takes some hundredths of a
nanosecond for each cell, and it saves a few hundred nanoseconds for each edge."""

CELLS_A_THREAD = 10_000_000
"""Cells below which a second thread costs more than it saves."""


def coarse_for(number: int, stack: Bytes, once: Once) -> Bytes:
    """The coarse map of a stack, if it was made before or pays for a number of edges; else one of no size."""
    made: Bytes | None = once.made("coarse")
    if made is None and number * CELLS_AN_EDGE >= stack.size:
        made = once("coarse", lambda: coarse_of(stack))
    if made is None:
        return stack[:, :0]
    seen = made.view()
    seen.flags.writeable = stack.flags.writeable  # one type for the compiler, be there a coarse map or not
    return seen


def coarse_of(stack: Bytes) -> Bytes:
    """The coarse map of a stack.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
        States, in one piece, in C order.

    Returns
    -------
    ndarray of uint8, shape (slices, ceil(nx / SIDE), ...)
        Zero where all cells of a block are FREE.
    """
    coarse = np.empty((len(stack), *((n + SIDE - 1) >> SHIFT for n in stack.shape[1:])), dtype=np.uint8)
    whole = np.array([[0] * 3 + [n - 1 for n in _layered(stack).shape[1:]]] * len(stack), dtype=np.int64)
    renew_coarse(stack, coarse, whole)
    return coarse


def renew_coarse(stack: Bytes, coarse: Bytes, boxes: NDArray[np.int64]) -> None:
    """Bring a coarse map up to date after cells of its stack changed.

    Parameters
    ----------
    stack, coarse : ndarray of uint8
        As :func:`coarse_of` takes and gives them; the second is changed in place. The stack may have a layer of its own
        for the plane, shape (slices, 1, nx, ny).
    boxes : ndarray of int64, shape (slices, 6)
        First and last cell, in the layered stack, of the box of changed cells in each slice; empty where a first one
        is beyond the last.
    """
    from cspace.coarse import _kernels

    cells, blocks = _layered(stack), _layered(coarse)
    for part, into, box in zip(cells, blocks, boxes, strict=True):
        if (box[:3] > box[3:]).any():
            continue
        first, last = box[:3] >> SHIFT, box[3:] >> SHIFT
        columns = int(last[1] - first[1]) + 1
        rows = (int(last[0] - first[0]) + 1) * columns

        def work(start: int, stop: int, part: Bytes = part, into: Bytes = into, box: NDArray[np.int64] = box) -> int:
            _kernels.mark_blocks(part, into, box, start, stop)
            return -1

        in_chunks(work, rows, least=max(1, CELLS_A_THREAD // (SIDE * SIDE * prod(part.shape[2:]))))


def _layered(stack: Bytes) -> Bytes:
    """A stack with three axes of cells; the plane gets one layer."""
    return stack if stack.ndim == 4 else stack[:, None]

"""Clearance: proven distances to the nearest configuration that is not FREE."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.states import FREE
from cspace.threads import in_chunks


@dataclass(frozen=True, slots=True)
class ClearanceField:
    """Distances over a map, in the form that the compiled look-up reads.

    Attributes
    ----------
    squares : ndarray of int32, shape (nx, ny) or (nx, ny, nz)
        Squared distance, in half cells, from the middle of each cell to the nearest closed cell of the grid that is not
        FREE; at most 2^31 - 1, which stands for every greater distance too.
    some : bool
        Whether the grid has a cell that is not FREE.
    """

    squares: NDArray[np.int32]
    some: bool


def clearance_field(state: NDArray[np.uint8], out: NDArray[np.int32] | None = None) -> ClearanceField:
    """Exact distance transform of a map to its cells that are not FREE.

    One pass over each axis, in place, of separable distances (Felzenszwalb and Huttenlocher, 2012), in threads, in
    integers; beside the answer it takes no memory to speak of.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny) or (nx, ny, nz)
    out : ndarray of int32, the shape of state, optional
        Where to write the squared distances; in one piece.

    Returns
    -------
    ClearanceField
    """
    from cspace.cells import _kernels

    squares = np.empty(state.shape, dtype=np.int32) if out is None else out
    rows, into = state.reshape(-1, state.shape[-1]), squares.reshape(-1, state.shape[-1])

    def along_rows(start: int, stop: int) -> int:
        _kernels.row_distances(rows[start:stop], into[start:stop])
        return -1

    in_chunks(along_rows, len(rows), least=64)
    for axis in range(state.ndim - 2, -1, -1):
        lines = squares.reshape(math.prod(state.shape[:axis]), state.shape[axis], -1)

        def along_lines(start: int, stop: int, lines: NDArray[np.int32] = lines) -> int:
            _kernels.spread_squares(lines, start, stop)
            return -1

        in_chunks(along_lines, _kernels.blocks_of(lines), least=4)
    return ClearanceField(squares, any(bool((part != FREE).any()) for part in state))


def renew_clearance(stack: NDArray[np.uint8], squares: NDArray[np.int32], boxes: NDArray[np.int64]) -> None:
    """Bring squared distances up to date after some cells became FREE, or stopped to be.

    *What can change.* Let D be the box of such cells, and d(c) the distance from the middle of a cell c to it. Where
    the old distance F(c) is less than d(c), the nearest cell that is not FREE lies outside D and stays, and what is new
    lies in D, farther away: the distance stays. Let S be the other cells, those with F >= d.

    *Where they are.* For c in S take the segment from its middle to the nearest point of D. At a point q of it, d has
    fallen by just the way gone, and F by no more, so F(q) >= d(q). If c lies outside a window of cells around D, the
    segment passes a cell r of the window's outermost layer. Its middle is within half a diagonal of q, sqrt(dim) half
    cells, so F(r) >= d(r) - 2 sqrt(dim). A window is grown until no cell of its outermost layers is like that, but for
    layers at the border of the grid, which no such segment passes; then it holds all of S.

    *What they become.* The window's outermost cells keep their distances. Let m be so large that those of one side are
    less than 2 m + 1 half cells, which is how far they are from what lies more than m cells beyond that side. A cell j
    layers farther inside has by at most 2 j more, and is 2 j farther from there. So what lies beyond a frame of these
    widths around the window is nearest to none of its cells, and a distance transform of window and frame is exact.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny, nz)
        States after the change; the plane has one layer.
    squares : ndarray of int32, shape (slices, nx, ny, nz)
        Those of :func:`clearance_field` before it, of each slice; changed in place.
    boxes : ndarray of int64, shape (slices, 6)
        First and last cell of D in each slice; empty where a first one is beyond the last.
    """
    from cspace.cells import _kernels

    for state, into, box in zip(stack, squares, boxes, strict=True):
        if box[0] <= box[3]:
            _kernels.renew_squares(state, into, box)

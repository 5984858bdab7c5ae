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

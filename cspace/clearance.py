"""Clearance: proven distances to the nearest configuration that is not FREE."""

from __future__ import annotations

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
    squares : ndarray of int32, shape (nx, ny)
        Squared distance, in half cells, from the middle of each cell to the nearest closed cell of the grid that is not
        FREE; at most 2^31 - 1, which stands for every greater distance too.
    some : bool
        Whether the grid has a cell that is not FREE.
    """

    squares: NDArray[np.int32]
    some: bool


def clearance_field(state: NDArray[np.uint8], out: NDArray[np.int32] | None = None) -> ClearanceField:
    """Exact distance transform of a map to its cells that are not FREE.

    Two passes over separable distances (Felzenszwalb and Huttenlocher, 2012), in threads, in integers.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny)
    out : ndarray of int32, shape (nx, ny), optional
        Where to write the squared distances.

    Returns
    -------
    ClearanceField
    """
    from cspace import _kernels

    nx, ny = state.shape
    closed = state != FREE
    gaps = np.empty(state.shape, dtype=np.int32)
    squares = np.empty(state.shape, dtype=np.int32) if out is None else out
    none = ny + 1  # farther than any cell of the column

    def along_columns(start: int, stop: int) -> int:
        _kernels.column_distances(closed[start:stop], gaps[start:stop], none)
        return -1

    def across_columns(start: int, stop: int) -> int:
        _kernels.square_distances(gaps, start, stop, none, squares)
        return -1

    in_chunks(along_columns, nx, least=64)
    in_chunks(across_columns, ny, least=64)
    return ClearanceField(squares, bool(closed.any()))

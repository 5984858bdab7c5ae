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
    walls : ndarray of float64, shape (n, 4)
        Rectangles ``(x0, y0, x1, y1)``, in cells, of what is not FREE outside the grid.
    """

    squares: NDArray[np.int32]
    some: bool
    walls: NDArray[np.float64]


def clearance_field(state: NDArray[np.uint8], box: NDArray[np.int64], beyond: int) -> ClearanceField:
    """Exact distance transform of a map to its cells that are not FREE.

    Two passes over separable distances (Felzenszwalb and Huttenlocher, 2012), in threads, in integers.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny)
    box, beyond
        What lies outside the grid, as :mod:`cspace._kernels` has it.

    Returns
    -------
    ClearanceField
    """
    from cspace import _kernels

    nx, ny = state.shape
    closed = state != FREE
    gaps = np.empty(state.shape, dtype=np.int32)
    squares = np.empty(state.shape, dtype=np.int32)
    none = ny + 1  # farther than any cell of the column

    def along_columns(start: int, stop: int) -> int:
        _kernels.column_distances(closed[start:stop], gaps[start:stop], none)
        return -1

    def across_columns(start: int, stop: int) -> int:
        _kernels.square_distances(gaps, start, stop, none, squares)
        return -1

    in_chunks(along_columns, nx, least=64)
    in_chunks(across_columns, ny, least=64)
    return ClearanceField(squares, bool(closed.any()), _walls(state.shape, box, beyond))


def _walls(shape: tuple[int, ...], box: NDArray[np.int64], beyond: int) -> NDArray[np.float64]:
    """What is not FREE outside the grid, as up to four rectangles in cells."""
    nx, ny = shape
    first_x, first_y, stop_x, stop_y = (-np.inf, -np.inf, np.inf, np.inf)
    if beyond == FREE:
        first_x, first_y, stop_x, stop_y = box[0], box[1], box[2] + 1, box[3] + 1
    walls = [
        (first_x, first_y, min(stop_x, 0.0), stop_y),
        (max(first_x, float(nx)), first_y, stop_x, stop_y),
        (first_x, first_y, stop_x, min(stop_y, 0.0)),
        (first_x, max(first_y, float(ny)), stop_x, stop_y),
    ]
    real = [wall for wall in walls if wall[0] < wall[2] and wall[1] < wall[3]]
    return np.asarray(real, dtype=np.float64).reshape(-1, 4)

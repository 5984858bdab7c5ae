"""Connectivity: which cells chains of FREE cells join, and which not even chains of undecided cells do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.states import BLOCKED, FREE


@dataclass(frozen=True, slots=True)
class Components:
    """Component labels of a map; 0 where a cell belongs to none.

    Attributes
    ----------
    free : ndarray of int32, shape (nx, ny)
        Components of the FREE cells: within one, a collision-free path exists.
    open : ndarray of int32, shape (nx + 2, ny + 2)
        Components of the cells that are not BLOCKED, with a rim of one cell for what lies outside the grid: between
        two of them, no collision-free path exists.
    """

    free: NDArray[np.int32]
    open: NDArray[np.int32]


def components(state: NDArray[np.uint8], rim_is_open: bool) -> Components:
    """Label a map.

    Cells that share a side are joined. For FREE cells that is a path. For the others it loses none: a path goes from
    one closed cell to the next through a side, or through a corner, all of whose cells are then not BLOCKED and are
    joined by their sides.

    Parameters
    ----------
    state : ndarray of uint8, shape (nx, ny)
    rim_is_open : bool
        Whether some configuration outside the grid is not BLOCKED.
    """
    rim = FREE if rim_is_open else BLOCKED
    passable = np.pad(state, 1, constant_values=rim) != BLOCKED
    return Components(_labels(state == FREE), _labels(passable))


def _labels(cells: NDArray[np.bool_]) -> NDArray[np.int32]:
    from scipy import ndimage

    labels = np.empty(cells.shape, dtype=np.int32)
    ndimage.label(cells, output=labels)
    return labels

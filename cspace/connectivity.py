"""Connectivity: which cells chains of FREE cells join, and which not even chains of undecided cells do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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


def path_exists(
    labels: Components,
    start: tuple[NDArray[np.int64], NDArray[np.uint8]],
    goal: tuple[NDArray[np.int64], NDArray[np.uint8]],
) -> Any:
    """Whether a path joins configurations: True, False (proven) or None (undecided), or an array of them.

    Parameters
    ----------
    labels : Components
    start, goal : tuple of ndarrays, shape (..., 2) and (...)
        Cells of the configurations, in the grid or not, and their states.
    """
    (free0, open0), (free1, open1) = _labels_of(labels, *start), _labels_of(labels, *goal)
    joined = (free0 == free1) & (free0 > 0)
    apart = (open0 != open1) | (open0 == 0) | (open1 == 0)
    answer = np.full(joined.shape, None, dtype=object)
    answer[joined] = True
    answer[apart] = False
    return answer if answer.ndim else answer[()]


def _labels_of(
    labels: Components, cells: NDArray[np.int64], states: NDArray[np.uint8]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels of cells among the free and the open ones; the rim stands for all cells outside the grid."""
    shape = labels.free.shape
    inside = np.asarray(((cells >= 0) & (cells < shape)).all(axis=-1))
    free = labels.free[tuple(np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0))]
    passable = labels.open[tuple(np.moveaxis(np.clip(cells, -1, shape) + 1, -1, 0))]
    return np.where(inside, free, 0), np.where(states == BLOCKED, 0, passable)


def _labels(cells: NDArray[np.bool_]) -> NDArray[np.int32]:
    from scipy import ndimage

    labels = np.empty(cells.shape, dtype=np.int32)
    ndimage.label(cells, output=labels)
    return labels

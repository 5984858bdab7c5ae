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
    free : ndarray of int32, shape (rotations, nx, ny)
        Components of the FREE cells: within one, a collision-free path exists.
    open : ndarray of int32, shape (rotations, nx + 2, ny + 2)
        Components of the cells that are not BLOCKED, with a rim of one cell for what lies outside the grid: between
        two of them, no collision-free path exists.
    """

    free: NDArray[np.int32]
    open: NDArray[np.int32]


def components(stack: NDArray[np.uint8], slice_of: NDArray[np.int64], rim_is_open: NDArray[np.bool_]) -> Components:
    """Label a map.

    Cells that share a side are joined, the last rotation cell with the first too. For FREE cells that is a path. For
    the others it loses none: a path goes from one closed cell to the next through a side, or through an edge or corner,
    all of whose cells are then not BLOCKED and are joined by their sides.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny)
    slice_of : ndarray of int64, shape (rotations,)
        One rotation stands for all where there is a single slice.
    rim_is_open : ndarray of bool, shape (slices,)
        Whether some configuration outside the grid is not BLOCKED.
    """
    order = slice_of if len(stack) > 1 else slice_of[:1]
    framed = np.empty((len(stack), stack.shape[1] + 2, stack.shape[2] + 2), dtype=np.bool_)
    framed[...] = rim_is_open[:, None, None]
    np.not_equal(stack, BLOCKED, out=framed[:, 1:-1, 1:-1])
    return Components(_labels((stack == FREE)[order]), _labels(framed[order]))


def path_exists(
    labels: Components,
    start: tuple[NDArray[np.int64], NDArray[np.uint8]],
    goal: tuple[NDArray[np.int64], NDArray[np.uint8]],
) -> Any:
    """Whether a path joins configurations: True, False (proven) or None (undecided), or an array of them.

    Parameters
    ----------
    labels : Components
    start, goal : tuple of ndarrays, shape (..., 3) and (...)
        Cells ``(rotation, x, y)`` of the configurations, in the grid or not, and their states.
    """
    (free0, open0), (free1, open1) = _labels_of(labels, *start), _labels_of(labels, *goal)
    joined = (free0 == free1) & (free0 > 0)
    apart = (open0 != open1) | (open0 == 0) | (open1 == 0)
    answer = np.full(joined.shape, None, dtype=object)
    answer[joined] = True
    answer[apart] = False
    return answer if answer.ndim else answer[()]


def chain(
    stack: NDArray[np.uint8],
    slice_of: NDArray[np.int64],
    closed: NDArray[np.bool_],
    start: NDArray[np.int64],
    goal: NDArray[np.int64],
) -> NDArray[np.int64]:
    """A chain of cells that are not BLOCKED, each sharing a side with the next, with the fewest MIXED ones.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny)
    slice_of : ndarray of int64, shape (rotations,)
    closed : ndarray of bool, shape (rotations, nx, ny)
        Cells that are left out.
    start, goal : ndarray of int64, shape (3,)
        Cells ``(rotation, x, y)`` in the grid.

    Returns
    -------
    ndarray of int64, shape (n, 3)
        From start to goal; of length 0 where there is none.
    """
    from cspace.turning import _kernels

    came = np.zeros(closed.shape, dtype=np.uint8)
    if not _kernels.trace_chain(stack, slice_of, closed, start, goal, came):
        return np.empty((0, 3), dtype=np.int64)
    moves = np.array([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)])
    cells = [tuple(goal.tolist())]
    while (step := int(came[cells[-1]])) != 7:
        k, i, j = (np.array(cells[-1]) - moves[step - 1]).tolist()
        cells.append((k % len(slice_of), i, j))
    return np.array(cells[::-1], dtype=np.int64)


def _labels_of(
    labels: Components, cells: NDArray[np.int64], states: NDArray[np.uint8]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels of cells among the free and the open ones; the rim stands for all cells outside the grid."""
    shape = np.asarray(labels.free.shape)
    turn = np.minimum(cells[..., 0], shape[0] - 1)  # one rotation may stand for all
    place = cells[..., 1:]
    inside = np.asarray(((place >= 0) & (place < shape[1:])).all(axis=-1))
    free = labels.free[(turn, *np.moveaxis(np.where(inside[..., None], place, 0), -1, 0))]
    passable = labels.open[(turn, *np.moveaxis(np.clip(place, -1, shape[1:]) + 1, -1, 0))]
    return np.where(inside, free, 0), np.where(states == BLOCKED, 0, passable)


def _labels(cells: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Components of cells of shape (rotations, nx, ny), joined through their sides, the first axis wrapping."""
    from scipy import ndimage, sparse

    labels = np.empty(cells.shape, dtype=np.int32)
    count = ndimage.label(cells, output=labels)
    if len(cells) < 2:
        return labels
    # Sides between the last rotation and the first join components that are apart within the array.
    first, last = labels[0].ravel(), labels[-1].ravel()
    both = (first > 0) & (last > 0)
    links = sparse.coo_array((np.ones(both.sum(), np.int8), (first[both], last[both])), shape=(count + 1, count + 1))
    _, merged = sparse.csgraph.connected_components(links, directed=False)
    names = np.where(np.arange(count + 1) > 0, merged + 1, 0).astype(np.int32)
    for part in labels:
        part[...] = names[part]
    return labels

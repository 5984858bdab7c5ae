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
    free : ndarray of int32, shape (rotations, *cells)
        Components of the FREE cells: within one, a collision-free path exists.
    open : ndarray of int32, shape (rotations, nx + 2, ny + 2) or (rotations, nx + 2, ny + 2, nz + 2)
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
    stack : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
        One rotation stands for all where there is a single slice.
    rim_is_open : ndarray of bool, shape (slices,)
        Whether some configuration outside the grid is not BLOCKED.
    """
    order = slice_of if len(stack) > 1 else None
    core = (slice(None), *[slice(1, -1)] * (stack.ndim - 1))
    framed = np.empty((len(stack), *(n + 2 for n in stack.shape[1:])), dtype=np.bool_)
    framed.T[...] = rim_is_open
    np.not_equal(stack, BLOCKED, out=framed[core])
    passable = _labels(framed, order)
    del framed  # as large as the map
    return Components(_labels(stack == FREE, order), passable)


def path_exists(
    labels: Components,
    start: tuple[NDArray[np.int64], NDArray[np.uint8]],
    goal: tuple[NDArray[np.int64], NDArray[np.uint8]],
) -> Any:
    """Whether a path joins configurations: True, False (proven) or None (undecided), or an array of them.

    Parameters
    ----------
    labels : Components
    start, goal : tuple of ndarrays, shape (..., 1 + d) and (...)
        Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` of the configurations, in the grid or not, and their
        states.
    """
    (free0, open0), (free1, open1) = _labels_of(labels, *start), _labels_of(labels, *goal)
    joined = (free0 == free1) & (free0 > 0)
    apart = (open0 != open1) | (open0 == 0) | (open1 == 0)
    answer = np.full(joined.shape, None, dtype=object)
    answer[joined] = True
    answer[apart] = False
    return answer if answer.ndim else answer[()]


def reach(labels: Components, label: int) -> NDArray[np.int64]:
    """First and last cell, shape (2, d), of the box around a component of the FREE cells."""
    ours = labels.free == label
    axes = range(1, ours.ndim)
    used = [np.flatnonzero(ours.any(axis=tuple({0, *axes} - {axis}))) for axis in axes]
    return np.array([[part[0] for part in used], [part[-1] for part in used]])


def chain(
    stack: NDArray[np.uint8],
    slice_of: NDArray[np.int64],
    closed: NDArray[np.bool_] | None,
    start: NDArray[np.int64],
    goal: NDArray[np.int64],
) -> NDArray[np.int64]:
    """A chain of cells that are not BLOCKED, each sharing a side with the next, with the fewest MIXED ones.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
    closed : ndarray of bool, shape (rotations, *cells), or None
        Cells that are left out.
    start, goal : ndarray of int64, shape (1 + d,)
        Cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid.

    Returns
    -------
    ndarray of int64, shape (n, 1 + d)
        From start to goal; of length 0 where there is none.
    """
    from cspace.cells import _kernels

    flat = (1,) * (4 - stack.ndim)  # the plane is space with one cell along z
    came = np.zeros((len(slice_of), *stack.shape[1:], *flat), dtype=np.uint8)
    if closed is not None:
        came[closed.reshape(came.shape)] = _kernels.CLOSED
    first, last = (np.array([*cell, *[0] * len(flat)], dtype=np.int64) for cell in (start, goal))
    if not _kernels.trace_chain(stack.reshape(len(stack), *came.shape[1:]), slice_of, first, last, came):
        return np.empty((0, stack.ndim), dtype=np.int64)
    cell, cells = last.tolist(), [last.tolist()]
    while (step := int(came[tuple(cell)])) != _kernels.START:
        axis, way = divmod(step - 1, 2)
        cell[axis] -= 2 * way - 1
        cell[0] %= len(slice_of)
        cells.append(cell.copy())
    return np.array(cells[::-1], dtype=np.int64)[:, : stack.ndim]


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


def _labels(cells: NDArray[np.bool_], order: NDArray[np.int64] | None) -> NDArray[np.int32]:
    """Components of slices of cells, joined through their sides.

    The slices are taken in an order, in which the first follows the last; a single one, without an order, is alone.
    """
    from scipy import ndimage, sparse

    if order is None:
        alone = np.empty(cells.shape, dtype=np.int32)
        ndimage.label(cells[0], output=alone[0])
        return alone
    labels = np.empty((len(order), *cells.shape[1:]), dtype=np.int32)
    count = ndimage.label(cells[order], output=labels)
    # Sides between the last rotation and the first join components that are apart within the array.
    first, last = labels[0].ravel(), labels[-1].ravel()
    both = (first > 0) & (last > 0)
    links = sparse.coo_array((np.ones(both.sum(), np.int8), (first[both], last[both])), shape=(count + 1, count + 1))
    _, merged = sparse.csgraph.connected_components(links, directed=False)
    names = np.where(np.arange(count + 1) > 0, merged + 1, 0).astype(np.int32)
    for part in labels:
        part[...] = names[part]
    return labels

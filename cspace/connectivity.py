"""Connectivity: which cells chains of FREE cells join, and which not even chains of undecided cells do."""

from __future__ import annotations

import threading
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.states import BLOCKED

Ints = NDArray[np.int64]
_Joined = tuple[Ints, Ints, NDArray[np.int32]]

_FACES: Final = 5


SIDES: Final = {2: (1, 64, 64), 3: (16, 16, 16)}
"""Cells of a block along each axis, by dimension; a plane has one layer. A block has at most 2^16 components."""


class Components:
    """The components of a map, in two levels, so that a change asks for few cells.

    The cells of each block have labels of their own; which labels meet at the faces of blocks is listed; and the
    labels of all blocks and rotations are joined by union-find (Tarjan, 1975) along these lists when they are next
    asked for. A change labels the blocks again that it touches. What lies outside the grid is one more component.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Kept, not copied; :meth:`renew` tells of changes.
    slice_of : ndarray of int64, shape (rotations,)
        One rotation stands for all where there is a single slice.
    rim_is_open : ndarray of bool, shape (slices,)
        Whether some configuration outside the grid is not BLOCKED.
    """

    def __init__(self, stack: NDArray[np.uint8], slice_of: NDArray[np.int64], rim_is_open: NDArray[np.bool_]) -> None:
        dim = stack.ndim - 1
        self._stack = stack.reshape(len(stack), *(1,) * (3 - dim), *stack.shape[1:])
        self._dim, self._sides = dim, np.array(SIDES[dim], dtype=np.int64)
        self._slice_of = np.ascontiguousarray(slice_of if len(stack) > 1 else slice_of[:1])
        self._rim_is_open = np.asarray(rim_is_open, dtype=np.bool_)
        self._shape = -(-np.array(self._stack.shape[1:]) // self._sides)
        blocks = (2, len(stack), *self._shape.tolist())
        self._labels = np.empty((2, *self._stack.shape), dtype=np.uint16)
        self._counts = np.zeros(blocks, dtype=np.int32)
        self._places = np.zeros((*blocks, _FACES, 3), dtype=np.int64)
        self._pool = np.empty((self._room(0), 2), dtype=np.uint16)
        self._filled = np.zeros(1, dtype=np.int64)
        self._joined: list[_Joined] | None = None
        self._boxes: dict[int, Ints] = {}
        self._lock = threading.Lock()
        whole = np.array([0, 0, 0, *(n - 1 for n in self._stack.shape[1:])], dtype=np.int64)
        self.renew(np.tile(whole, (len(stack), 1)))

    def renew(self, boxes: Ints) -> None:
        """Follow changes of the states.

        Parameters
        ----------
        boxes : ndarray of int64, shape (slices, 6)
            First and last cell ``(x, y, z)`` of the box around what has changed in each slice; x is 0 in the plane.
            Empty where a first one is beyond the last.
        """
        from cspace.blocks import _kernels

        empty = boxes[:, :1] > boxes[:, 3:4]
        touched = np.where(empty, np.repeat([self._shape.max(), -1], 3), boxes // np.tile(self._sides, 2))
        with self._lock:
            self._joined = None
            self._boxes.clear()
            _kernels.label_blocks(self._stack, self._labels, self._counts, self._sides, touched)
            start = 0
            while start >= 0:
                where = (self._sides, touched, self._places, self._pool, self._filled)
                start = _kernels.join_blocks(self._labels, self._counts, *where, start)
                if start >= 0:
                    pool = np.empty((self._room(int(self._places[..., 1].sum())), 2), dtype=np.uint16)
                    self._filled[0] = _kernels.compact(self._places, self._pool, pool)
                    self._pool = pool

    def of(self, cells: Ints) -> tuple[Ints, Ints]:
        """Numbers of the components of FREE cells, and of cells that are not BLOCKED, that cells belong to.

        Within one of the FREE cells, a collision-free path exists; between two of the others, none does. A cell
        outside the grid counts as not BLOCKED where any of them is.

        Parameters
        ----------
        cells : ndarray of int64, shape (..., 1 + d)
            ``(rotation, x, y)`` or ``(rotation, x, y, z)``, in the grid or not.

        Returns
        -------
        free, passable : ndarray of int64, shape (...)
            -1 where a cell belongs to none. The numbers hold until the next change.
        """
        from cspace.blocks import _kernels

        flat = cells.reshape(-1, cells.shape[-1])
        places = np.zeros((len(flat), 4), dtype=np.int64)
        places[:, 0], places[:, 4 - self._dim :] = flat[:, 0], flat[:, 1:]
        outside = ((flat[:, 1:] < 0) | (flat[:, 1:] >= self._stack.shape[4 - self._dim :])).any(axis=1)
        found = np.empty((2, len(flat)), dtype=np.int64)
        with self._lock:
            for kind, joined in enumerate(self._join()):
                known = (self._labels[kind], self._sides, self._shape, self._slice_of, *joined)
                _kernels.roots_of(*known, places, found[kind])
        turns = np.minimum(flat[:, 0], len(self._slice_of) - 1)
        found[0, outside] = -1
        found[1, outside & ~self._rim_is_open[self._slice_of[turns]]] = -1
        free, passable = found.reshape(2, *cells.shape[:-1])
        return free, passable

    def box(self, number: int) -> Ints:
        """First and last cell, shape (2, d), of the box around a component of the FREE cells, by its number."""
        from cspace.blocks import _kernels

        with self._lock:
            if number not in self._boxes:
                counts = self._counts[0].reshape(len(self._stack), -1)
                known = (self._labels[0], counts, self._sides, self._shape, self._slice_of, *self._join()[0])
                self._boxes[number] = _kernels.box_of(*known, number).reshape(2, 3)[:, 3 - self._dim :]
            return self._boxes[number]

    def _join(self) -> list[_Joined]:
        """Of both kinds, where the labels of each block and rotation are numbered from, and the root of each."""
        from cspace.blocks import _kernels

        if self._joined is None:
            made = []
            for kind, rim in enumerate((np.zeros_like(self._rim_is_open), self._rim_is_open)):
                counts = self._counts[kind].reshape(len(self._stack), -1)
                places = self._places[kind].reshape(*counts.shape, _FACES, 3)
                base, start = np.empty(counts.shape, np.int64), np.empty(len(self._slice_of) + 1, np.int64)
                roots = np.empty(_kernels.number_nodes(counts, self._slice_of, base, start), np.int32)
                _kernels.join_all(places, self._pool, self._shape, self._slice_of, rim, base, start, roots)
                made.append((base, start, roots))
            self._joined = made
        return self._joined

    def _room(self, pairs: int) -> int:
        """Size of a pool for some pairs: twice as many, and those of another block."""
        return 2 * (pairs + int(self._sides.prod()))


def components(stack: NDArray[np.uint8], slice_of: NDArray[np.int64], rim_is_open: NDArray[np.bool_]) -> Components:
    """Label a map.

    Cells that share a side are joined, the last rotation cell with the first too. For FREE cells that is a path. For
    the others it loses none: a path goes from one closed cell to the next through a side, or through an edge or corner,
    all of whose cells are then not BLOCKED and are joined by their sides.

    Parameters
    ----------
    stack, slice_of, rim_is_open
        As for :class:`Components`.
    """
    return Components(stack, slice_of, rim_is_open)


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
    (free0, open0), (free1, open1) = (_known(labels, *end) for end in (start, goal))
    joined = (free0 == free1) & (free0 >= 0)
    apart = (open0 != open1) | (open0 < 0) | (open1 < 0)
    answer = np.full(joined.shape, None, dtype=object)
    answer[joined] = True
    answer[apart] = False
    return answer if answer.ndim else answer[()]


def reach(labels: Components, cell: NDArray[np.int64]) -> Ints:
    """First and last cell, shape (2, d), of the box around the component of a FREE cell, shape (1 + d,)."""
    return labels.box(int(labels.of(cell)[0]))


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


def _known(labels: Components, cells: NDArray[np.int64], states: NDArray[np.uint8]) -> tuple[Ints, Ints]:
    """Numbers of the components of configurations; one outside the grid may be BLOCKED where others are not."""
    free, passable = labels.of(cells)
    return free, np.where(states == BLOCKED, -1, passable)

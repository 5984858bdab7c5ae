"""The solid cells of a map in space, cut open and joined in blocks, and what a camera sees of them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.grid import Grid
from cspace.plot.view import Floats

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

MOST: Final = 24_000
"""Faces that are drawn at most; cells are joined to blocks until there are no more."""
_FINE: Final = 200
"""Blocks along an axis at most; more would be smaller than a picture shows."""


class Faces(NamedTuple):
    """Faces of blocks.

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 4, 3)
        Metres.
    axes : ndarray of int64, shape (n,)
        The axis that a face is normal to.
    classes : ndarray of uint8, shape (n,)
        Class of the block behind a face.
    cut : ndarray of bool, shape (n,)
        Whether the block goes on beyond the face, in what was cut away or outside the grid.
    side : int
        Cells along an edge of a block.
    """

    corners: Floats
    axes: NDArray[np.int64]
    classes: Bytes
    cut: Bools
    side: int


class Solid:
    """The cells that are drawn, those of a class or above, as a camera far away sees them.

    A face is seen where a solid cell has a neighbour towards the camera that is not solid. What the cut or the end of
    the grid lays open is seen too; but an end of the grid that is mostly solid is a wall before the rest, and left out.

    Parameters
    ----------
    grid : Grid
    classes : ndarray of uint8, shape grid.shape
        Class of each cell; the larger, the more important to see.
    least : int
        Smallest class that is drawn.
    towards : ndarray of float64, shape (3,)
        Direction to the camera, in metres.
    cut : dict of int to float
        By axis, metres: what lies beyond on the camera's side is not drawn; cells that the plane runs through are.
    """

    def __init__(self, grid: Grid, classes: Bytes, least: int, towards: Floats, cut: dict[int, float]) -> None:
        self._grid, self._least, self._towards = grid, least, towards
        first, stop = np.zeros(3, dtype=np.int64), np.array(grid.shape)
        self._closed = []
        for axis in range(3):
            above = towards[axis] > 0.0
            if axis in cut:
                place = (cut[axis] - grid.lower[axis]) / grid.spacing
                # The plane may run along a border of cells, but for rounding.
                if above:
                    stop[axis] = np.clip(math.ceil(place - 1e-9), 1, stop[axis])
                else:
                    first[axis] = np.clip(math.floor(place + 1e-9), 0, stop[axis] - 1)
            end = classes.take(stop[axis] - 1 if above else first[axis], axis)
            whole = (stop[axis] == grid.shape[axis]) if above else (first[axis] == 0)
            self._closed.append(not whole or bool(np.mean(end >= least) < 0.5))
        self._first = first
        self._classes = classes[tuple(map(slice, first, stop))]

    def faces(self) -> Faces:
        """The faces that the camera sees, of blocks that are no larger than they must be.

        A block has the largest class of its cells: it is drawn where one of them is solid.
        """
        side = math.ceil(max(self._classes.shape) / _FINE)
        while True:
            classes = self._classes
            for axis in range(3) if side > 1 else ():
                classes = np.maximum.reduceat(classes, np.arange(0, classes.shape[axis], side), axis=axis)
            seen = [self._seen(classes, axis) for axis in range(3)]
            count = sum(int(np.count_nonzero(part)) for pair in seen for part in pair)
            if count <= MOST:
                return self._gather(classes, seen, side)
            side = max(side + 1, math.floor(side * math.sqrt(count / MOST)))

    def hides(self, points: Floats) -> Bools:
        """Whether a face that the camera sees stands before points, shape (n, 3), metres; shape (n,)."""
        shape = np.array(self._classes.shape)
        place = (points - self._grid.lower) / self._grid.spacing - self._first
        step = self._towards / np.linalg.norm(self._towards)
        up = step > 0.0
        with np.errstate(divide="ignore"):
            stride = 1.0 / np.abs(step)
        # A point outside begins where its ray reaches the last of the three slabs between the grid's sides.
        entry = np.where(step == 0.0, 0.0, np.where(up, -place, place - shape) * np.where(step == 0.0, 0.0, stride))
        place = place + np.maximum(entry.max(axis=1, initial=0.0), 0.0)[:, np.newaxis] * step
        cell = np.floor(place).astype(np.int64)
        # Cell by cell along the ray (Amanatides and Woo, 1987): the way to the next border across each axis.
        with np.errstate(invalid="ignore"):
            ahead = np.where(step == 0.0, np.inf, np.where(up, cell + 1 - place, place - cell) * stride)
        rows = np.arange(len(points))
        hidden, behind = np.zeros((2, len(points)), dtype=np.bool_)
        for _ in range(int(shape.sum()) + 4):
            beyond = np.where(up, cell >= shape, (cell < 0) & (step < 0.0))
            inside = ((cell >= 0) & (cell < shape)).all(axis=1)
            solid = np.zeros(len(points), dtype=np.bool_)
            solid[inside] = self._classes[tuple(cell[inside].T)] >= self._least
            # An end of the grid that is left out hides nothing.
            left_out = (beyond & ~np.array(self._closed)).any(axis=1)
            hidden |= behind & ~solid & (inside | ~left_out)
            behind = solid
            if (beyond.any(axis=1) | hidden).all():
                break
            axis = ahead.argmin(axis=1)
            cell[rows, axis] += np.sign(step[axis]).astype(np.int64)
            ahead[rows, axis] += stride[axis]
        return hidden

    def _seen(self, classes: Bytes, axis: int) -> tuple[Bools, Bools]:
        """Blocks whose face towards the camera along an axis is seen: before an empty block, and at the end."""
        solid = classes >= self._least
        between, end = np.zeros_like(solid), np.zeros_like(solid)
        if self._towards[axis] == 0.0:
            return between, end
        rows = [np.moveaxis(array, axis, 0) for array in (solid, between, end)]
        if self._towards[axis] < 0.0:
            rows = [row[::-1] for row in rows]
        rows[1][:-1] = rows[0][:-1] & ~rows[0][1:]
        rows[2][-1] = rows[0][-1] & self._closed[axis]
        return between, end

    def _gather(self, classes: Bytes, seen: list[tuple[Bools, Bools]], side: int) -> Faces:
        """Corners of the faces that are seen, and what is known of them."""
        h, lower = self._grid.spacing, self._grid.lower
        edges = [
            lower[axis] + h * (self._first[axis] + np.minimum(np.arange(count + 1) * side, cells))
            for axis, (count, cells) in enumerate(zip(classes.shape, self._classes.shape, strict=True))
        ]
        corners, axes, kinds, cut = [], [], [], []
        for axis, pair in enumerate(seen):
            for number, part in enumerate(pair):
                blocks = np.argwhere(part)
                rim = np.zeros((4, 3), dtype=np.int64)
                rim[:, axis] = self._towards[axis] > 0.0
                rim[[1, 2], (axis + 1) % 3] = 1
                rim[[2, 3], (axis + 2) % 3] = 1
                lattice = blocks[:, np.newaxis] + rim
                corners.append(np.stack([edges[k][lattice[..., k]] for k in range(3)], axis=-1))
                axes.append(np.full(len(blocks), axis))
                kinds.append(classes[part])
                cut.append(np.full(len(blocks), bool(number)))
        return Faces(np.concatenate(corners), np.concatenate(axes), np.concatenate(kinds), np.concatenate(cut), side)

"""Layers of a workspace: obstacles that are placed by name, in metres, over cells that stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from cspace.arrays import Bools, Ints
from cspace.grid import Grid
from cspace.shapes import Shape, Voxels

Box = tuple[Ints, Ints]
"""First cell, and the one after the last; with no cell in between where an obstacle lies outside the grid."""


class Obstacle(NamedTuple):
    """An obstacle, and what it is in the cells of a box of the grid.

    Attributes
    ----------
    shape : Shape
    box : Box
        All cells of the grid that the obstacle can meet.
    outer, inner : ndarray of bool
        The cells of the box that meet the obstacle, and those that lie in it.
    """

    shape: Shape
    box: Box
    outer: Bools
    inner: Bools

    @classmethod
    def of(cls, shape: Shape, grid: Grid, endless: Sequence[bool] = ()) -> Obstacle:
        """An obstacle where it is; what lies outside the grid is clipped, but for exact answers.

        Along axes that close in a circle nothing lies outside: there it comes in again, whole turns on.

        Raises InputError if it is so far from the grid that rounding could reach the certificate's slack, or its inside
        depends on the spacing.
        """
        shape.outer.boundary()  # exact look-ups will need it
        turn = grid.spacing * np.array(grid.shape) * (endless or np.zeros(grid.dim))
        low, high = (
            np.floor(np.divide(corner + more - grid.lower, turn, out=np.zeros(grid.dim), where=turn > 0.0)).astype(int)
            for corner, more in zip(shape.outer.bounds, (-grid.spacing, grid.spacing), strict=True)
        )
        times = product(*map(range, low.tolist(), (high + 1).tolist()))
        parts = [cls._clipped(shape, Grid(grid.lower + turn * each, grid.spacing, grid.shape)) for each in times]
        if len(parts) == 1:
            return parts[0]
        first = np.min([each.box[0] for each in parts], axis=0)
        stop = np.max([each.box[1] for each in parts], axis=0)
        outer, inner = np.zeros((2, *(stop - first)), dtype=np.bool_)
        for each in parts:
            window = tuple(map(slice, each.box[0] - first, each.box[1] - first))
            outer[window] |= each.outer
            inner[window] |= each.inner
        return cls(shape, (first, stop), outer, inner)

    @classmethod
    def _clipped(cls, shape: Shape, grid: Grid) -> Obstacle:
        low, high = ((corner - grid.lower) / grid.spacing for corner in shape.outer.bounds)
        first, stop = (np.clip(np.floor(cell), 0, grid.shape).astype(np.int64) for cell in (low - 1.0, high + 2.0))
        # The cells are those of a build to the bit, as they are counted from the same corner, and fewer.
        outer, inner = shape.cells(Grid(grid.lower, grid.spacing, np.maximum(stop, 1).tolist()))
        window = tuple(map(slice, first, stop))
        return cls(shape, (first, stop), outer[window].copy(), inner[window].copy())


@dataclass(slots=True, eq=False)
class ObstacleLayers:
    """What the cells of a workspace come from: those that stay, and those of obstacles that have a name.

    Attributes
    ----------
    outer, inner : ndarray of bool
        The cells that stay; its own.
    unknown : ndarray of bool, or None
        Which of them nothing is known of; its own, too.
    shapes : tuple or None
        The obstacles that stay, where they are known otherwise than by their cells.
    grid : Grid
    placed : dict of str to Obstacle
    """

    grid: Grid
    outer: Bools = field(repr=False)
    inner: Bools = field(repr=False)
    unknown: Bools | None = field(repr=False)
    shapes: tuple[Shape, ...] | None
    placed: dict[str, Obstacle] = field(default_factory=dict)
    _still: tuple[Shape, ...] | None = field(default=None, repr=False)

    def copy(self) -> ObstacleLayers:
        """The same, in arrays of its own."""
        outer, inner = self.outer.copy(), self.inner.copy()
        unknown = None if self.unknown is None else self.unknown.copy()
        return replace(self, outer=outer, inner=inner, unknown=unknown, placed=dict(self.placed))

    @property
    def obstacles(self) -> tuple[Shape, ...] | None:
        """All obstacles as shapes; None where only their cells are known."""
        if not self.placed:
            return self.shapes
        if self._still is None and self.shapes is None:
            cells = Voxels(self.outer.copy(), self.grid.spacing, np.array(self.grid.lower))
            self._still = (cells,) if self.outer.any() else ()
        return (*(self._still or self.shapes or ()), *(each.shape for each in self.placed.values()))

    def write(self, window: tuple[slice, ...], outer: Bools, inner: Bools) -> None:
        """Change a box of the cells that stay, which from then on are all that is known of what stays."""
        self.outer[window], self.inner[window] = outer, inner
        if self.unknown is not None:
            self.unknown[window] = False
        self.shapes = self._still = None

    def put(self, name: str, placed: Obstacle | None) -> list[Box]:
        """Place an obstacle, or take it away; the boxes of the cells that may differ from then on."""
        boxes = [each.box for each in (placed, self.placed.get(name)) if each is not None and each.outer.size]
        if placed is None:
            del self.placed[name]
        else:
            self.placed[name] = placed
        return boxes

    def cells(self, first: Ints, stop: Ints) -> tuple[Bools, Bools, Bools]:
        """The cells of a box that meet an obstacle, those that lie in one, and those that nothing is known of."""
        window = tuple(map(slice, first, stop))
        outer, inner = self.outer[window].copy(), self.inner[window].copy()
        unknown = np.zeros_like(outer) if self.unknown is None else self.unknown[window].copy()
        for each in self.placed.values():
            low, high = np.maximum(first, each.box[0]), np.minimum(stop, each.box[1])
            if (low < high).all():
                here = tuple(map(slice, low - first, high - first))
                there = tuple(map(slice, low - each.box[0], high - each.box[0]))
                outer[here] |= each.outer[there]
                inner[here] |= each.inner[there]
                unknown[here] &= ~each.outer[there]
        return outer, inner, unknown

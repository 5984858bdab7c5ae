"""Sources of the cells of a workspace, and named obstacles over them.

Sources are in memory or on disk.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from cspace._grid import Grid
from cspace._shapes import Shape, Voxels
from cspace._support.arrays import Bools, Box, Ints, intersect_boxes
from cspace._support.limits import MESH_CELL_BYTES, check_memory


class Source(Protocol):
    """Cells of a workspace, read a box at a time.

    Sources can be pickled and read by several threads.
    """

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return outer and inner cells of a box, one array if equal."""

    @property
    def stamp(self) -> str:
        """Digest that changes when the cells change."""


class CellsInMemory:
    """Outer and inner cells in memory; one array if they are equal."""

    def __init__(self, outer: Bools, inner: Bools) -> None:
        """Keep the arrays, without copies."""
        self.outer = outer
        self.inner = inner

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""
        outer = self.outer[box]
        inner = outer if self.inner is self.outer else self.inner[box]
        return outer, inner

    @cached_property
    def stamp(self) -> str:
        """Digest of the cells."""
        digest = hashlib.sha256(np.packbits(self.outer).data)
        if self.inner is not self.outer:
            digest.update(np.packbits(self.inner).data)
        return digest.hexdigest()


class ShapeCells:
    """Cells of a shape, rasterized a box at a time.

    A spatial index finds the parts near a box.
    """

    def __init__(self, shape: Shape, grid: Grid) -> None:
        """Keep the shape and the grid on which it is rasterized."""
        self.shape = shape
        self.grid = grid

    def read(self, box: Box) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""
        first = np.array([side.start for side in box])
        stop = np.array([side.stop for side in box])
        lower = self.grid.lower + self.grid.spacing * first
        return self.shape.cells(Grid(lower, self.grid.spacing, stop - first))

    @cached_property
    def stamp(self) -> str:
        """Digest of the shape."""
        text = json.dumps(self.shape.spec, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


CellBox = tuple[Ints, Ints]
"""First cell of a box, and the cell after the last one; empty for obstacles outside the grid."""


class Obstacle(NamedTuple):
    """A shape and its cells on a grid.

    Attributes
    ----------
    shape : Shape
    box : CellBox
        Box of the grid that contains all cells that the obstacle can touch.
    outer, inner : ndarray of bool
        Cells of the box that touch the obstacle, and cells inside it.
    """

    shape: Shape
    box: CellBox
    outer: Bools
    inner: Bools

    @classmethod
    def of(cls, shape: Shape, grid: Grid) -> Obstacle:
        """Rasterize a shape.

        Its cells are clipped to the grid, but its geometry is not.

        Raises InputError if the shape is so far from the grid that rounding could exceed the
        certificate's slack, or if its interior depends on the spacing.
        """
        shape.outer.boundary()  # raises the errors of later exact queries now
        low, high = (shape.outer.bounds - np.array(grid.lower)) / grid.spacing
        # One cell more on each side covers rounding.
        first = np.clip(np.floor(low - 1.0), 0, grid.shape).astype(np.int64)
        stop = np.clip(np.floor(high + 2.0), 0, grid.shape).astype(np.int64)
        # This grid has the same lower corner as that of a build, so that its cells are equal to the
        # bit.
        near = Grid(grid.lower, grid.spacing, np.maximum(stop, 1).tolist())
        check_memory(MESH_CELL_BYTES * near.size, "the obstacle", near)
        outer, inner = shape.cells(near)
        window = tuple(map(slice, first, stop))
        return cls(shape, (first, stop), outer[window].copy(), inner[window].copy())


@dataclass(slots=True, eq=False)
class ObstacleLayers:
    """Cells of a workspace: a base, and named obstacles on top of it.

    Attributes
    ----------
    grid : Grid
    outer, inner : ndarray of bool
        Cells of the base that meet obstacles, and cells inside obstacles; copies.
    unknown : ndarray of bool, or None
        Unknown cells of the base; a copy.
    shapes : tuple or None
        Obstacles of the base as shapes; None if only their cells are known.
    named : dict of str to Obstacle
        Obstacles on top of the base.
    """

    grid: Grid
    outer: Bools = field(repr=False)
    inner: Bools = field(repr=False)
    unknown: Bools | None = field(repr=False)
    shapes: tuple[Shape, ...] | None
    named: dict[str, Obstacle] = field(default_factory=dict)
    _base_shapes: tuple[Shape, ...] | None = field(default=None, repr=False)

    def copy(self) -> ObstacleLayers:
        """Return a copy that shares no arrays."""
        outer = self.outer.copy()
        inner = self.inner.copy()
        unknown = None if self.unknown is None else self.unknown.copy()
        return replace(self, outer=outer, inner=inner, unknown=unknown, named=dict(self.named))

    @property
    def obstacles(self) -> tuple[Shape, ...] | None:
        """All obstacles as shapes; None if only their cells are known."""
        if not self.named:
            return self.shapes
        if self._base_shapes is None and self.shapes is None:
            cells = Voxels(self.outer.copy(), self.grid.spacing, np.array(self.grid.lower))
            self._base_shapes = (cells,) if self.outer.any() else ()
        base = self._base_shapes or self.shapes or ()
        return (*base, *(obstacle.shape for obstacle in self.named.values()))

    def write(self, window: tuple[slice, ...], outer: Bools, inner: Bools) -> None:
        """Replace a box of the base's cells; forget the base's shapes."""
        self.outer[window] = outer
        self.inner[window] = inner
        if self.unknown is not None:
            self.unknown[window] = False
        self.shapes = self._base_shapes = None

    def set_obstacle(self, name: str, obstacle: Obstacle | None) -> list[CellBox]:
        """Add, replace or remove a named obstacle.

        Returns the boxes of cells that may have changed.
        """
        # Cells of the new and of the old obstacle may change.
        changed = [obstacle, self.named.get(name)]
        if obstacle is None:
            del self.named[name]
        else:
            self.named[name] = obstacle
        return [item.box for item in changed if item is not None and item.outer.size]

    def find_names(self, cells: Ints) -> set[str]:
        """Return names of obstacles that touch any cell, shape (n, d)."""
        names = set[str]()
        for name, obstacle in self.named.items():
            first, stop = obstacle.box
            near = cells[((cells >= first) & (cells < stop)).all(axis=1)] - first
            if obstacle.outer[tuple(near.T)].any():
                names.add(name)
        return names

    def cells(self, first: Ints, stop: Ints) -> tuple[Bools, Bools, Bools]:
        """Return the outer, inner and unknown cells from ``first`` to before ``stop``."""
        window = tuple(map(slice, first, stop))
        # The base, and over it each obstacle, under which nothing is unknown.
        outer = self.outer[window].copy()
        inner = self.inner[window].copy()
        unknown = np.zeros_like(outer) if self.unknown is None else self.unknown[window].copy()
        obstacles = list(self.named.values())
        # Compare all boxes at once, because few of many obstacles are near.
        firsts = np.array([obstacle.box[0] for obstacle in obstacles]).reshape(-1, len(first))
        stops = np.array([obstacle.box[1] for obstacle in obstacles]).reshape(-1, len(first))
        is_near = ((firsts < stop) & (first < stops) & (firsts < stops)).all(axis=1)
        for number in np.flatnonzero(is_near):
            obstacle = obstacles[number]
            box = tuple(map(slice, *obstacle.box))
            in_window, in_obstacle = intersect_boxes(window, box)
            outer[in_window] |= obstacle.outer[in_obstacle]
            inner[in_window] |= obstacle.inner[in_obstacle]
            unknown[in_window] &= ~obstacle.outer[in_obstacle]
        return outer, inner, unknown

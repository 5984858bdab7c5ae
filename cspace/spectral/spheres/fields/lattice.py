"""Lattice: the cells that cover a shape, and the depths of their middles."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import Grid
from cspace.memory import check_memory
from cspace.spectral.spheres.fields.regions import Region

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

BYTES: Final = 64
"""Memory for each cell of the box round a shape, at most."""

MOST: Final = {2: 2**24, 3: 2**24}
"""Cells of the box round a shape, at most."""

_THIN: Final = 2**20
"""Cells of the box up to which a shape that fills little of it gets a finer lattice."""

_BOX: Final = {2: 40_000, 3: 80_000}
_USED: Final = {2: 15_000, 3: 20_000}
_A_BALL: Final = {2: 100, 3: 60}


class Lattice:
    """Cells of a grid whose union covers a region; two axes are held as three, of which the first is one cell long.

    Lengths in *sides* are in sides of a cell, from the grid's lower corner; along an axis that is added, all is at 0.5.

    Parameters
    ----------
    region : Region
    grid : Grid
        One of ``region.grid_at``.

    Attributes
    ----------
    cells : ndarray of bool, three axes
    middles : ndarray, shape (n, 3)
        Of the cells, in sides.
    depths : ndarray, shape (n,)
        Lower bounds of their signed distances, in sides.
    half : ndarray, shape (3,)
        Half a cell along each axis that there is.
    """

    def __init__(self, region: Region, grid: Grid) -> None:
        self.region, self.grid, self.side = region, grid, grid.spacing
        found = region.cells(grid)
        self.cells = found[None] if grid.dim == 2 else found
        self.middles: Floats = np.argwhere(self.cells).astype(np.float64) + 0.5
        self.depths = region.depths(self.metres(self.middles)) / self.side
        self.half = np.array([0.0, 0.5, 0.5] if grid.dim == 2 else [0.5, 0.5, 0.5])

    @classmethod
    def fine(cls, region: Region, number: int, finer: int = 1) -> Lattice:
        """A lattice on which so many balls can be told apart, or one with more cells by a factor."""
        dim = region.dim
        sides = np.maximum(region.bounds[1] - region.bounds[0], 1e-3 * region.size)
        box = min(finer * max(_BOX[dim], number * _A_BALL[dim]), MOST[dim])
        while True:
            grid = grid_of(region, float((np.prod(sides) / box) ** (1.0 / dim)))
            used = int(np.count_nonzero(region.cells(grid)))
            enough = finer * max(_USED[dim], number * _A_BALL[dim] // 2)
            if used >= enough or 2 * box > _THIN:
                return cls(region, grid)
            # A thin shape fills little of its box.
            box = min(_THIN, int(box * min(max(2.0, (enough / max(used, 1)) ** (dim / (dim - 1.0))), 16.0)))

    def metres(self, points: Floats) -> Floats:
        """Points in sides, (n, 3), as points (n, d) in metres."""
        return np.asarray(np.asarray(self.grid.lower) + self.side * points[:, 3 - self.grid.dim :])

    def sides(self, points: Floats) -> Floats:
        """Points (n, d) in metres as points (n, 3) in sides."""
        local = (points - np.asarray(self.grid.lower)) / self.side
        return np.column_stack([np.full(len(points), 0.5), local]) if self.grid.dim == 2 else local

    @property
    def corner(self) -> Floats:
        """Where the point 0 in sides lies in the space of the border's tree, metres."""
        return np.array([-0.5 * self.side, *self.grid.lower]) if self.grid.dim == 2 else np.asarray(self.grid.lower)

    @property
    def diagonal(self) -> float:
        """Of a cell, in sides."""
        return math.sqrt(self.grid.dim)


def grid_of(region: Region, spacing: float) -> Grid:
    """The grid of a region at a spacing, where it fits.

    Raises
    ------
    InputError
        If it has too many cells, or needs more memory than there is.
    """
    counts = np.ceil((region.bounds[1] - region.bounds[0]) / spacing) + 1.0
    if float(np.prod(counts)) > 1.5 * MOST[region.dim]:
        raise InputError(
            f"the balls need a lattice of {' x '.join(f'{n:.4g}' for n in counts)} cells of {spacing:g} m; at most "
            f"{MOST[region.dim]} are looked at; use a larger tolerance or fewer balls"
        )
    mend = "use a larger tolerance or fewer balls"
    check_memory(BYTES * float(np.prod(counts)), "the lattice of the balls", counts.tolist(), spacing, mend=mend)
    return region.grid_at(spacing)

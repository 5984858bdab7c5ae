"""Descriptors sampled on a grid."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.spectral.descriptors.checks import check_axes

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.shapes import Balls
    from cspace.shapes.mesh import Mesh

    Shape: TypeAlias = BaseGeometry | Mesh | Balls

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Descriptor:
    """A function given by its values at the middles of a grid's cells; the shape that it stands for is where it is
    above zero.

    Parameters
    ----------
    grid : Grid
    values : array-like, shape grid.shape
        A copy is kept, as float64, read-only.

    Raises
    ------
    InputError
        If the values do not have the grid's shape, or one is not finite.
    """

    grid: Grid
    values: Floats = field(repr=False)

    def __post_init__(self) -> None:
        values = finite(self.values, "values")
        if values.shape != self.grid.shape:
            raise InputError(
                f"values has shape {values.shape} on a grid of {self.grid.shape}; both must be the same; pass one "
                "value for each cell, indexed in the order of the coordinates"
            )
        values = values.copy()
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.grid.dim

    @property
    def integral(self) -> float:
        """Sum of the values times the measure of a cell."""
        return float(self.values.sum() * self.grid.spacing**self.dim)


def indicator(shape: Shape | ArrayLike, grid: Grid) -> Descriptor:
    """1 at the middles of cells that lie in a shape, 0 elsewhere.

    Parameters
    ----------
    shape : shapely geometry, cspace.Mesh, cspace.shapes.Balls, or array-like of bool, shape grid.shape
        Metres; closed sets, for which a middle on the border counts as inside, or, of a mesh, within rounding of it
        (2^-25 cells). An array tells the cells themselves.
    grid : Grid

    Returns
    -------
    Descriptor

    Raises
    ------
    InputError
        If the shape and the grid do not have the same dimension, or an array has the wrong shape or holds more than 0
        and 1.
    """
    return Descriptor(grid, np.asarray(_inside(shape, grid), dtype=np.float64))


def _inside(shape: Any, grid: Grid) -> NDArray[np.bool_]:
    import shapely

    from cspace.covering import check_cells
    from cspace.raster.triangles import mark_touched
    from cspace.shapes import Balls
    from cspace.shapes.mesh import Mesh

    if isinstance(shape, shapely.Geometry):
        check_axes(grid, 2, "shape")
        x, y = (grid.centers(axis) for axis in range(2))
        shapely.prepare(shape)
        return np.asarray(shapely.intersects_xy(shape, x[:, None], y[None, :]))
    if isinstance(shape, Mesh):
        check_axes(grid, 3, "shape")
        found = np.asarray(shape.contains(_middles(grid)))
        # The inside test alone calls the points of some sides in, and those of others out.
        mark_touched(found, (shape.triangles - np.asarray(grid.lower)) / grid.spacing, 0.5, 0.5)
        return found
    if isinstance(shape, Balls):
        check_axes(grid, shape.dim, "shape")
        found = np.zeros(grid.shape, dtype=bool)
        squares = [(grid.centers(axis) - shape.centers[:, axis, None]) ** 2 for axis in range(grid.dim)]
        for number, radius in enumerate(shape.radii.tolist()):
            sums = [square[number].reshape([-1] + [1] * (grid.dim - 1 - a)) for a, square in enumerate(squares)]
            found |= sum(sums) <= radius * radius
        return found
    return check_cells(shape, "shape")


def check_sampled(descriptor: Any) -> Descriptor:
    """The descriptor, refused where it is not sampled."""
    if not isinstance(descriptor, Descriptor):
        raise InputError(
            f"{type(descriptor).__name__} is not a Descriptor; this takes descriptors sampled on a grid; make one with "
            "sample(grid) or indicator(shape, grid)"
        )
    return descriptor


def _middles(grid: Grid) -> Floats:
    axes = np.meshgrid(*(grid.centers(axis) for axis in range(grid.dim)), indexing="ij")
    return np.stack(axes, axis=-1)

"""Overlap fields: the overlap of a robot's balls with obstacles at the cell centers of a map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from cspace._limits import check_memory
from cspace._support.arrays import Floats
from cspace._support.check import check_finite, check_points
from cspace.errors import InputError
from cspace.spectral._descriptors import check_same_dim
from cspace.spectral._overlap import FourierOverlap

if TYPE_CHECKING:
    from cspace._space import CSpace


@dataclass(frozen=True, eq=False, slots=True)
class OverlapField:
    """Overlap of robot and obstacles at the cell centers of a map.

    It is positive if balls meet and grows with the depth, and it is as smooth as the descriptors.
    It proves nothing; the states of the map do. It stands beside the map: updates of the map leave
    it as it is, and files of the map do not hold it. ``numpy.save("field.npy", field.values)``
    keeps it, and ``OverlapField(space, numpy.load("field.npy"))`` brings it back.

    Attributes
    ----------
    space : CSpace
    values : ndarray of float64, shape (nx, ny(, nz)), or (slices, ...) for a robot that rotates
        The overlap at each cell center, metres to the power of the dimension; read-only.

    Raises InputError if the values have another shape or type than the map, or are not finite.
    """

    space: CSpace
    values: Floats

    def __post_init__(self) -> None:
        """Check the values, and make them read-only."""
        values = self.values
        shape = _shape_on(self.space)
        if values.shape != shape or values.dtype != np.float64:
            raise InputError(
                "values",
                f"has shape {values.shape} and type {values.dtype}",
                f"it must have the map's shape {shape} and type float64",
                "use OverlapField.of",
            )
        read_only_values = check_finite(values, "values").view()
        read_only_values.flags.writeable = False
        object.__setattr__(self, "values", read_only_values)

    @classmethod
    def of(cls, space: CSpace, overlap: FourierOverlap) -> OverlapField:
        """Compute the field of a map.

        If the robot rotates, a slice has the values at the representative of its first rotation
        cell. ``overlap`` is between the balls of the robot, in the robot's frame, and the balls of
        the obstacles, in the map's frame. Grown balls, such as those of
        :meth:`FourierOverlap.of_shapes`, overlap before the shapes do.

        Raises InputError if ``overlap`` is no FourierOverlap, has another dimension than the map,
        or memory is too small. Raises MissingPackageError if finufft is not installed.
        """
        argument: object = overlap
        if not isinstance(argument, FourierOverlap):
            raise InputError(
                "overlap",
                f"is a {type(argument).__name__}",
                "it must be a FourierOverlap",
                "make it with e.g. FourierOverlap.of_shapes",
            )
        grid = space.grid
        check_same_dim("overlap", overlap.dim, grid.dim)
        shape = _shape_on(space)
        check_memory(8.0 * math.prod(shape), "the overlap field", grid)
        axes = [grid.centers(axis) for axis in range(grid.dim)]
        centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        # Fill slice by slice, with the robot at the first rotation cell of each.
        values = np.empty(shape)
        slice_values = values.reshape(-1, *grid.shape)
        rotation_cells = space.rotations._make_shape_cells(grid.dim)
        for number in range(len(slice_values)):
            first_cell = int(np.argmax(space.slice_of == number))
            matrix = rotation_cells[first_cell].matrix
            placed = overlap if matrix is None else overlap.rotated(matrix)
            slice_values[number] = placed.value(centers)
        return cls(space, values)

    @property
    def cells(self) -> Floats:
        """Overlap by slice, for kernels, shape (slices, nx, ny(, nz))."""
        return np.ascontiguousarray(self.values).reshape(-1, *self.space.grid.shape)

    def at(self, q: ArrayLike) -> Floats:
        """Interpolate the overlap at configurations (..., size), metres and radians.

        The interpolation is linear between cell centers and never negative. Outside the grid it
        uses the nearest value; rotations use the value of their cell. Raises InputError if the last
        axis is not as long, or a value is NaN or infinite.
        """
        from scipy.ndimage import map_coordinates

        space = self.space
        grid = self.space.grid
        points = check_points(q, "q", space.size)
        rows = points.reshape(-1, space.size)
        # Coordinates in cells; the center of the first cell is at 0.
        positions = (rows[:, : grid.dim] - np.asarray(grid.lower)) / grid.spacing - 0.5
        slices = space.slice_of[space.rotations._find_cells(rows)]
        coordinates = np.column_stack([slices, positions]).T
        overlaps = map_coordinates(self.cells, coordinates, order=1, mode="nearest")
        return np.asarray(np.maximum(overlaps, 0.0).reshape(points.shape[:-1]))[()]


def _shape_on(space: CSpace) -> tuple[int, ...]:
    """Return the array shape of overlap fields on a map."""
    slices = int(space.slice_of.max()) + 1
    return (*space.rotations._leading_axes(slices), *space.grid.shape)

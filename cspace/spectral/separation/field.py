"""A smooth field on a map: how much descriptors overlap at each configuration, and which way that grows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.map.batches import answer
from cspace.map.fields import checked_fields
from cspace.memory import check_memory
from cspace.states import FIELDS

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.spectral.separation.fourier_overlap import FourierOverlap

Floats = NDArray[np.float64]

_AT_ONCE: Final = 2**20
"""Cells whose values are computed together."""


@dataclass(frozen=True, eq=False, slots=True)
class OverlapField:
    """The overlap of a robot's descriptor with that of the obstacles at the middles of a map's cells, and its gradient.

    A measure of penetration that is as smooth as the descriptors: above zero where balls meet, and growing with the
    depth. It is no certificate; the states of the map are.

    Parameters
    ----------
    space : CSpace
        The map.
    arrays : mapping of str to ndarray of float64, shape (nx, ny), (nx, ny, nz) or (slices, nx, ny)
        By the names in :data:`cspace.states.FIELDS`: the overlap, metres to the power of the dimension, and its
        derivatives along the axes, one power less.

    Raises
    ------
    InputError
        If an array is missing or there are others, or one has not the shape and type of the map's, or holds what is not
        finite.
    """

    space: CSpace
    arrays: Mapping[str, Floats]

    def __post_init__(self) -> None:
        grid = self.space.grid
        shape = grid.shape if self.space.rotations is None else self.space.stack.shape
        object.__setattr__(self, "arrays", checked_fields(self.arrays, grid.dim, shape))

    @classmethod
    def of(cls, space: CSpace, overlap: FourierOverlap) -> OverlapField:
        """The field of a map.

        The cells' middles are a lattice of placements, so that all values of a slice are one transform, and each
        derivative one more. Of a robot that turns, the values of a slice are those at the middle of the first rotation
        cell that it serves.

        Parameters
        ----------
        space : CSpace
        overlap : FourierOverlap
            Of the robot's balls, in the robot's frame, with the obstacles', in the map's. Grown balls, such as those of
            :meth:`FourierOverlap.of_shapes`, overlap before the shapes do.

        Raises
        ------
        InputError
            If the overlap is in the plane and the map is in space, or the other way around, or memory is too small.
        MissingPackageError
            If finufft is not installed.
        """
        grid = space.grid
        if overlap.dim != grid.dim:
            raise InputError(
                f"the overlap has {overlap.dim} coordinates and the map {grid.dim}; both must have as many"
            )
        names = FIELDS[: 1 + grid.dim]
        needed = len(names) * space.stack.size * np.dtype(np.float64).itemsize
        check_memory(needed, "the overlap field", grid.shape, grid.spacing)
        stacks = {name: np.empty(space.stack.shape) for name in names}
        step = max(1, _AT_ONCE * grid.shape[0] // grid.size)
        for number in range(len(space.stack)):
            placed = overlap
            if space.rotations is not None:
                first = int(np.argmax(space.slice_of == number))
                placed = overlap.rotated(float(space.rotations.representatives[first]))
            for start in range(0, grid.shape[0], step):
                rows = slice(start, min(start + step, grid.shape[0]))
                cells = np.indices((rows.stop - start, *grid.shape[1:])).transpose(*range(1, grid.dim + 1), 0)
                cells[..., 0] += start
                ts = grid.center_of(cells)
                stacks[FIELDS[0]][number, rows] = placed.values(ts)
                slopes = placed.gradients(ts)
                for axis in range(grid.dim):
                    stacks[FIELDS[1 + axis]][number, rows] = slopes[..., axis]
        turns = space.rotations is not None
        return cls(space, {name: stack if turns else stack[0] for name, stack in stacks.items()})

    @property
    def values(self) -> Floats:
        """The overlap at the middle of each cell, shape (nx, ny), (nx, ny, nz) or (slices, nx, ny)."""
        return self.arrays[FIELDS[0]]

    def at(self, q: ArrayLike) -> Any:
        """The overlap at configurations, linear between the middles of cells.

        Parameters
        ----------
        q : array-like, shape (dof,) or (..., dof)
            Metres, and radians. Outside the grid the nearest value in it is taken; of yaw, that of its rotation cell.

        Returns
        -------
        float or ndarray of float64, shape (...)
            Not below zero.

        Raises
        ------
        InputError
            If the last axis is not dof long, or a value is NaN or infinite.
        """
        from cspace.spectral.separation._kernels import field_values

        kernel: Callable[..., int] = partial(field_values, *self._fixed())
        return answer(q, self.space.dof, kernel, np.float64, float)

    def checker(self) -> Callable[..., float]:
        """A quick :meth:`at` of floats: ``check(*q) -> float``; they must be finite, and are not checked."""
        from cspace.compiling import entry
        from cspace.spectral.separation import _kernels

        dof = self.space.dof
        kernel = _kernels.field_of_two if dof == 2 else _kernels.field_of_three
        return entry(kernel, self._fixed(), dof)

    def _fixed(self) -> tuple[Any, ...]:
        space, grid = self.space, self.space.grid
        # In the plane there is one layer of cells; of a robot that only translates, one slice.
        shape = (len(space.stack), *grid.shape, *(1,) * (3 - grid.dim))
        borders = np.empty(0) if space.rotations is None else np.asarray(space.rotations.borders)
        frame = np.array([*grid.lower, grid.spacing])
        return np.ascontiguousarray(self.values).reshape(shape), space.slice_of, borders, frame

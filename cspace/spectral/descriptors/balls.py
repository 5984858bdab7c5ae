"""Descriptors of sets of balls: sums of bumps, known everywhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.spectral.descriptors.bump import Bump
from cspace.spectral.descriptors.checks import check_axes, check_solid_balls, check_vectors
from cspace.spectral.descriptors.descriptor import Descriptor
from cspace.threads import in_chunks

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BallDescriptor:
    """``f(x) = sum over balls of psi((x - center) / radius)``, above zero in the open balls and nowhere else.

    Where balls overlap their bumps add up.

    Parameters
    ----------
    centers : array-like, shape (n, 2) or (n, 3)
        Metres; a copy is kept, read-only.
    radii : array-like, shape (n,), or one number
        Metres, above zero.
    bump : Bump

    Raises
    ------
    InputError
        If there is no ball, the shapes do not fit, a value is not finite, or a radius is not above zero.
    """

    centers: Floats = field(repr=False)
    radii: Floats = field(repr=False)
    bump: Bump

    def __init__(self, centers: ArrayLike, radii: ArrayLike, bump: Bump | None = None) -> None:
        points, sizes = check_solid_balls(centers, radii)
        kind = Bump() if bump is None else bump
        if not isinstance(kind, Bump):
            raise InputError(f"bump is {bump!r}; it must be a Bump; pass e.g. Bump(2.0)")
        points.flags.writeable = sizes.flags.writeable = False
        object.__setattr__(self, "centers", points)
        object.__setattr__(self, "radii", sizes)
        object.__setattr__(self, "bump", kind)

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.centers.shape[1])

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the balls, metres."""
        reach = self.radii[:, None]
        return (self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)

    @property
    def integral(self) -> float:
        """Integral over the plane or space, metres to the power ``dim``."""
        return float(self.bump.radial_spectrum(0.0, self.dim) * np.sum(self.radii**self.dim))

    def __call__(self, points: ArrayLike) -> Floats:
        """Values at points.

        Parameters
        ----------
        points : array-like, shape (..., dim)
            Metres.

        Returns
        -------
        ndarray of float64, shape (...)

        Raises
        ------
        InputError
            If the last axis is not ``dim`` long, or a value is not finite.
        """
        from cspace.spectral.descriptors import _kernels

        array = check_vectors(points, "points", self.dim, "pass one point or a batch of them")
        flat = np.ascontiguousarray(array.reshape(-1, self.dim))
        values = np.zeros(len(flat))

        def work(start: int, stop: int) -> int:
            return int(_kernels.sum_at_points(self.centers, self.radii, self.bump.alpha, flat, values, start, stop))

        in_chunks(work, len(flat), least=1024)
        return values.reshape(array.shape[:-1])

    def sample(self, grid: Grid) -> Descriptor:
        """Values at the middles of a grid's cells.

        Raises
        ------
        InputError
            If the grid does not have as many axes as the balls.
        """
        from cspace.spectral.descriptors import _kernels

        check_axes(grid, self.dim, "set of balls")
        # In the plane, the third axis has one cell, in which all lies.
        more = 3 - self.dim
        values = np.zeros((*grid.shape, *(1,) * more))
        centers = np.pad(self.centers, ((0, 0), (0, more)))
        lower = np.pad(np.array(grid.center_of([0] * self.dim)), (0, more))

        def work(start: int, stop: int) -> int:
            return int(
                _kernels.add_balls(centers, self.radii, self.bump.alpha, lower, grid.spacing, values, start, stop)
            )

        in_chunks(work, grid.shape[0], least=32)
        return Descriptor(grid, values.reshape(grid.shape))

    def moved(self, translation: ArrayLike) -> BallDescriptor:
        """The same, moved by a vector, shape (dim,), metres."""
        shift = finite(translation, "translation")
        if shift.shape != (self.dim,):
            raise InputError(
                f"translation has shape {shift.shape}; it must hold {self.dim} numbers; pass one for each coordinate"
            )
        return BallDescriptor(self.centers + shift, self.radii, self.bump)

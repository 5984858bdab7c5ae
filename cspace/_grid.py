"""Grid of cells, the only place where metres and cell indices meet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._support.arrays import AXES, Bools, Floats, Ints
from cspace._support.check import (
    check_finite,
    check_points,
    check_positive,
    check_real,
)
from cspace._support.kinds import make_kind_error
from cspace.errors import InputError

SLACK: Final = 2.0**-26
"""Rounding allowance in cells.

Outer rasters grow by it, inner rasters shrink by it, and the rounding of every look-up stays below
it, so that no answer depends on floating-point rounding.
"""

MAX_COORDINATE: Final = 2.0**22
"""Largest coordinate, in cells from the origin, for which :data:`SLACK` covers the rounding."""


FARTHEST_CELL: Final = 2**62
"""Largest index of a cell; farther points get this index, and boxes that reach it have no end."""


OBSTACLE_REACH: Final = "an obstacle", "the map's corner"
"""Name and origin of the error for obstacles that reach too far."""


def check_reach(far: float, name: str, origin: str, hint: str = "") -> None:
    """Raise InputError if a shape is too far from an origin.

    ``far``, in cells, must be at most :data:`MAX_COORDINATE`, beyond which rounding could exceed
    :data:`SLACK`. ``name``, ``origin`` and ``hint`` are for the message.
    """
    if not far <= MAX_COORDINATE:
        rule = f"beyond {MAX_COORDINATE:.0f} cells rounding invalidates proofs"
        raise InputError(name, f"reaches {far:.3g} cells from {origin}", rule, hint)


@dataclass(frozen=True, slots=True)
class Grid:
    """A box of closed cubic cells.

    Cell ``i`` is ``lower + spacing * (i + [0, 1]^d)``. Arrays over the grid are indexed in the
    order of the coordinates, ``[x, y]`` or ``[x, y, z]``.

    Parameters
    ----------
    lower : sequence of float, length d
        Lower corner of cell 0, in metres; d is 2 or 3.
    spacing : float
        Side of a cell, in metres.
    shape : sequence of int, length d
        Number of cells along each axis.
    axes : sequence of str, length d, optional
        Names of the coordinates; by default x, y and, in space, z.
    units : sequence of str, length d, optional
        Units of the coordinates, "m" by default; the joints of an arm may have "rad".
    frame_id : str, optional
        Frame of the coordinates in ROS; empty if it is not known. Grids that differ in it alone are
        equal.

    Raises
    ------
    InputError
        If a value is not finite, the spacing or a count is not above zero, or the lengths differ;
        or if the grid lies so far from the origin (over 2^22 cells) that floating-point rounding
        could exceed the certificate's slack.

    Examples
    --------
    >>> import cspace
    >>> grid = cspace.Grid((0.0, 0.0), 0.5, (10, 8))
    >>> grid.cell_of((1.2, 3.9)).tolist()
    [2, 7]
    >>> grid.center_of((2, 7)).tolist()
    [1.25, 3.75]
    """

    lower: tuple[float, ...]
    spacing: float
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    units: tuple[str, ...]
    frame_id: str = field(default="", compare=False, repr=False)

    def __init__(
        self,
        lower: ArrayLike,
        spacing: float,
        shape: Sequence[int],
        axes: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
        frame_id: str = "",
    ) -> None:
        """Check numbers and names, and convert to tuples."""
        counts = check_real(shape, "shape")
        axes = "xyz"[: counts.size] if axes is None else axes
        units = "m" * counts.size if units is None else units
        corner = check_finite(lower, "lower", AXES[: counts.size])
        if corner.ndim != 1 or len(corner) not in (2, 3):
            rule = "it must have length 2 or 3"
            raise InputError("lower", f"is {lower!r}", rule)
        dim = len(corner)
        side = check_positive(spacing, "spacing")
        if counts.shape != corner.shape or counts.dtype.kind not in "iu" or (counts <= 0).any():
            problem = f"is {tuple(np.atleast_1d(counts).tolist())}"
            rule = f"it must have {dim} whole numbers above zero, the cells along each axis"
            raise InputError("shape", problem, rule)
        corners = np.stack([corner, corner + side * counts])
        check_reach(float(np.abs(corners).max() / side), "grid", "the origin")
        for values, name in ((axes, "axes"), (units, "units")):
            words = list(values) if isinstance(values, Iterable) else [None]
            if not all(isinstance(word, str) for word in words):
                raise make_kind_error(values, name, "it must be a list of names")
        names, unit_names = tuple(axes), tuple(units)
        rule = f"there must be {dim}, and axes must differ"
        if len(set(names)) != dim or len(names) != dim:
            raise InputError("axes", f"are {', '.join(names)}", rule)
        if len(unit_names) != dim:
            problem = f"are {', '.join(unit_names)}"
            raise InputError("units", problem, rule)
        # The class is frozen, so plain assignment is refused.
        object.__setattr__(self, "lower", tuple(corner.tolist()))
        object.__setattr__(self, "spacing", side)
        object.__setattr__(self, "shape", tuple(counts.tolist()))
        object.__setattr__(self, "axes", names)
        object.__setattr__(self, "units", unit_names)
        object.__setattr__(self, "frame_id", frame_id)

    @property
    def dim(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.shape)

    @property
    def unit(self) -> str:
        """Unit of the side of a cell."""
        return " or ".join(dict.fromkeys(self.units))

    @property
    def _measure_unit(self) -> str:
        """Unit of a cell's measure, such as "m2" or "rad m"."""
        powers = list[str]()
        for unit in sorted(set(self.units), reverse=True):
            power = self.units.count(unit)
            powers.append(f"{unit}{power}" if power > 1 else unit)
        return " ".join(powers)

    @property
    def size(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper corner, in metres."""
        return tuple(low + self.spacing * n for low, n in zip(self.lower, self.shape, strict=True))

    def _check(self, points: ArrayLike, name: str = "points") -> Floats:
        """Return points as an array of float64, shape (..., d), metres.

        Raises
        ------
        InputError
            If the last axis is not d long, or a value is not finite.
        """
        return check_points(points, name, self.axes)

    def contains(self, points: ArrayLike) -> Bools:
        """Return True for points in the closed box of the grid.

        Parameters
        ----------
        points : array-like, shape (..., d)

        Returns
        -------
        ndarray of bool, shape (...)
        """
        array = self._check(points)
        inside = (array >= self.lower) & (array <= self.upper)
        return np.asarray(inside.all(axis=-1))

    def cell_of(self, points: ArrayLike) -> Ints:
        """Return the cells that contain points.

        For points outside the grid, the cells continue without end. A point on a boundary belongs
        to the cell above it, except on the grid's own upper boundary, which belongs to the last
        cell: cell ``i`` owns ``lower + spacing * (i + [0, 1))``, the last one its upper boundary
        too.

        Parameters
        ----------
        points : array-like, shape (..., d)

        Returns
        -------
        ndarray of int64, shape (..., d)
        """
        array = self._check(points)
        cells = np.floor((array - self.lower) / self.spacing)
        # Points on the upper boundary belong to the last cell.
        cells -= (cells == self.shape) & (array <= self.upper)
        # Clip to a number of cells well within int64.
        return np.clip(cells, -FARTHEST_CELL, FARTHEST_CELL).astype(np.int64)

    def center_of(self, cells: ArrayLike) -> Floats:
        """Return the centers of cells.

        Parameters
        ----------
        cells : array-like of int, shape (..., d)

        Returns
        -------
        ndarray of float64, shape (..., d)
            Metres.
        """
        array = check_points(cells, "cells", self.axes)
        return np.asarray(self.lower + self.spacing * (array + 0.5))

    def centers(self, axis: int) -> Floats:
        """Return the cell centers along one axis, in metres, shape (shape[axis],)."""
        cells = np.arange(self.shape[axis])
        return np.asarray(self.lower[axis] + self.spacing * (cells + 0.5))

"""Rotation cells: how the circle of orientations is cut."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import finite

TURN: Final = 2.0 * math.pi

YAW_SLACK: Final = 1e-9
"""Rounding allowance in radians: rotation cells count as that much wider on both sides."""

MAX_YAW: Final = 2.0**20
"""Largest yaw, in radians, whose wrapping stays within :data:`YAW_SLACK`."""


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """A rotation cell as a shape meets it: one rotation, and how far the others of the cell are from it.

    Attributes
    ----------
    matrix : ndarray of float64, shape (d, d), or None
        The representative rotation; None for none at all, which leaves every number as it is.
    covering_angle : float
        Largest angle between a rotation of the cell and the representative, radians.
    about_z : bool
        Whether all rotations of the cell are about the z axis; then points on it stay where they are.
    """

    matrix: NDArray[np.float64] | None = None
    covering_angle: float = 0.0
    about_z: bool = False

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points, shape (..., d), turned about the origin by the representative rotation."""
        return points if self.matrix is None else np.ascontiguousarray(points @ self.matrix.T)

    def displacement(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far each of some points, shape (..., d), can come from its place within the cell, shape (...)."""
        lever = np.linalg.norm(points[..., :2] if self.about_z else points, axis=-1)
        return np.asarray(2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0) * lever)


STILL: Final = Turn()
"""No rotation at all."""


@dataclass(frozen=True, slots=True)
class Rotations:
    """Cells of the circle of yaw angles; cell ``k`` is ``[borders[k], borders[k + 1]]``.

    Attributes
    ----------
    borders : tuple of float, length n + 1
        Ascending, in radians; the last one is the first one plus a whole turn.
    """

    borders: tuple[float, ...]

    @classmethod
    def of(cls, value: int | Sequence[float] | Rotations | ArrayLike) -> Rotations:
        """Rotation cells from a count or from their borders.

        Parameters
        ----------
        value : int, or sequence of float
            A number of equal cells, the first of which has its middle at yaw 0; or n + 1 borders in radians, ascending,
            the last one a whole turn after the first.

        Raises
        ------
        InputError
            If the count is not a whole number above zero, or the borders do not ascend over a whole turn.
        """
        if isinstance(value, Rotations):
            return value
        if isinstance(value, bool) or np.ndim(value) == 0:
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
                raise InputError(
                    f"rotations is {value!r}; it must be a whole number above zero, or the cells' borders in radians; "
                    "pass e.g. 72"
                )
            count = int(value)
            width = TURN / count
            borders = [(k - 0.5) * width for k in range(count)]
        else:
            angles = finite(value, "rotations")
            if angles.ndim != 1 or len(angles) < 2:
                raise InputError(
                    f"rotations has shape {angles.shape}; it must hold at least two borders; pass e.g. 72, or "
                    "numpy.linspace(0, 2 * numpy.pi, 73)"
                )
            if (np.diff(angles) <= 0).any() or abs(angles[0]) > TURN:
                raise InputError(
                    "rotations are borders that do not ascend, or begin more than a turn from zero; sort them, in "
                    "radians, from one between -2 pi and 2 pi"
                )
            if abs(angles[-1] - angles[0] - TURN) > YAW_SLACK:
                raise InputError(
                    f"rotations reach from {angles[0]:g} to {angles[-1]:g} rad; they must cover the whole circle, "
                    f"2 pi = {TURN:.9f}; end with the first border plus 2 pi (numpy.radians turns degrees)"
                )
            borders = angles[:-1].tolist()
        return cls((*borders, borders[0] + TURN))

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.borders) - 1

    @property
    def representatives(self) -> NDArray[np.float64]:
        """Middle yaw of each cell, shape (n,)."""
        edges = np.asarray(self.borders)
        return np.asarray((edges[:-1] + edges[1:]) / 2)

    @property
    def covering_angles(self) -> NDArray[np.float64]:
        """Largest angle between a yaw of a cell and its representative, rounding included, shape (n,)."""
        return np.asarray(np.diff(self.borders) / 2 + YAW_SLACK)

    def is_uniform(self) -> bool:
        """Whether all cells are equally wide, but for rounding."""
        return bool(np.ptp(np.diff(self.borders)) < YAW_SLACK / self.count)

    def cell_of(self, yaw: ArrayLike) -> NDArray[np.int64]:
        """Cells that hold yaw angles; a border belongs to the cell above it.

        Parameters
        ----------
        yaw : array-like, any shape
            Radians, wrapped.

        Returns
        -------
        ndarray of int64, same shape
        """
        angles = finite(yaw, "yaw")
        if (np.abs(angles) > MAX_YAW).any():
            raise InputError(
                f"yaw is {np.abs(angles).max():g} rad; at most {MAX_YAW:.0f} can be wrapped exactly; wrap it first"
            )
        # As the compiled look-ups wrap, to the last bit; a yaw within the borders stays as it is.
        wrapped = angles - np.floor((angles - self.borders[0]) / TURN) * TURN
        return np.clip(np.searchsorted(self.borders, wrapped, side="right") - 1, 0, self.count - 1).astype(np.int64)


def check_rotations(value: Any) -> Rotations | None:
    """``value`` as rotation cells; None stays None."""
    return None if value is None else Rotations.of(value)

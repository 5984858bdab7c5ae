"""Rotation cells of yaw: angles about the z axis, or about the origin of the plane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._rotations.base import (
    ANGLE_SLACK,
    COVERING_ANGLE,
    MAX_ANGLE,
    TWO_PI,
    Coordinate,
    HasSymmetries,
    Rotations,
    RotationTable,
    wrap_angles,
    wrap_steps,
)
from cspace._support.arrays import Floats, Ints
from cspace._support.check import check_count, check_finite, check_real
from cspace.errors import InputError

MAX_YAW_CELLS: Final = 2**16
"""Maximum number of yaw cells, each 0.0055 degrees wide: 1 cm at 100 m from the axis."""


_QUARTER_MATRICES: Final = np.array(
    [[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]], dtype=float
)
"""Rotation matrices of 0 to 3 quarter turns in the plane."""


@dataclass(frozen=True, repr=False)
class YawRotations(Rotations):
    """Cells of yaw, in the plane or in space.

    They are for SE(2) and R^3 x SO(2). Cell ``k`` is ``[borders[k], borders[k + 1]]``. The
    boundaries ascend over one turn, from any angle. Yaws returned by the library are in [-pi, pi).

    Attributes
    ----------
    borders : tuple of float, length n + 1
        Boundaries in radians, ascending; the last is the first plus a whole turn.
    """

    borders: tuple[float, ...]
    names = ("yaw",)
    _about_z = True
    _limits = f"a yaw at most {MAX_ANGLE:.0f} rad"
    _COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "yaw": Coordinate("middle of a rotation cell, in [-pi, pi)", "rad", bounds="yaw_bounds"),
        "yaw_bounds": Coordinate(
            "borders of a rotation cell, ascending over one turn", "rad", {"bound": 2}
        ),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def _of_value(cls, value: ArrayLike | None) -> YawRotations:
        """Make cells from a count or from their boundaries, see :meth:`Rotations.of`."""
        if isinstance(value, list | tuple):
            value = check_real(value, "rotations")
        if value is None or np.ndim(value) == 0:
            count = check_count(value, "rotations", 1, MAX_YAW_CELLS)
            width = TWO_PI / count
            borders = [(k - 0.5) * width for k in range(count)]
        else:
            borders = _check_borders(value)[:-1].tolist()
        return cls((*borders, borders[0] + TWO_PI))

    @classmethod
    def _of_stored_arrays(cls, coordinates: Mapping[str, NDArray[Any]]) -> YawRotations:
        """Make cells from their stored boundaries."""
        starts, stops = coordinates["yaw_bounds"].T
        return cls._of_value([*starts.tolist(), float(stops[-1])])

    def _canonical_rotation(self, rotation: Floats, name: str) -> Floats:
        """Wrap yaws into [-pi, pi).

        Raises InputError if one is too large to be wrapped exactly.
        """
        check_wrappable(rotation, name)
        return wrap_angles(rotation)

    def _rotation_between(self, first: Floats, second: Floats) -> Floats:
        """Return the shorter angles from yaws to others, radians."""
        return wrap_steps(second - first)

    def _rotate(self, rotation: Floats, by: Floats) -> Floats:
        """Add angles to yaws."""
        return rotation + by

    def make_matrices(self, rotation: Floats, dim: int) -> Floats:
        """Convert yaws to matrices, shape (..., dim, dim)."""
        yaws = rotation[..., 0]
        cos = np.cos(yaws)
        sin = np.sin(yaws)
        # In space, the z axis stays.
        matrices = np.zeros((*rotation.shape[:-1], dim, dim)) + np.eye(dim)
        matrices[..., 0, 0] = cos
        matrices[..., 0, 1] = -sin
        matrices[..., 1, 0] = sin
        matrices[..., 1, 1] = cos
        return matrices

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.borders) - 1

    @property
    def _yaws(self) -> Floats:
        """Center of each cell, in [-pi, pi), shape (n,)."""
        edges = np.asarray(self.borders)
        return wrap_angles((edges[:-1] + edges[1:]) / 2)

    @property
    def covering_angles(self) -> Floats:
        """Half the width of each cell, with rounding, shape (n,)."""
        return np.asarray(np.diff(self.borders) / 2 + ANGLE_SLACK)

    def is_uniform(self) -> bool:
        """Return True if all cells have one width up to rounding.

        Then no boundary is off by more than ANGLE_SLACK / 8.
        """
        return bool(np.ptp(np.diff(self.borders)) < ANGLE_SLACK / (8.0 * len(self)))

    def cell_of(self, yaw: ArrayLike) -> Ints:
        """Return the cells that contain yaw angles, radians, of any shape.

        A boundary belongs to the cell above it.
        """
        angles = check_finite(yaw, "yaw")
        check_wrappable(angles, "yaw")
        # The same formula as in compiled look-ups, to the last bit; a yaw within the boundaries is
        # unchanged.
        whole_turns = np.floor((angles - self.borders[0]) / TWO_PI)
        in_cells = angles - whole_turns * TWO_PI
        cells = np.searchsorted(self.borders, in_cells, side="right") - 1
        # Rounding may move a yaw past the first or the last boundary.
        return np.clip(cells, 0, len(self) - 1).astype(np.int64)

    def _find_cells(self, q: Floats) -> Ints:
        """Return the cells of configurations."""
        return self.cell_of(q[..., -1])

    def _preserves(self, shape: HasSymmetries) -> bool:
        """Return True if a shape is round about the z axis."""
        return shape.symmetry == 0

    def _assign_slices(self, shape: HasSymmetries) -> Ints:
        """Return the slice of each cell.

        If all cells have one width, cells that a symmetry of the shape maps to each other share it.
        """
        cells = np.arange(len(self), dtype=np.int64)
        if shape.symmetry == 0:
            return np.zeros_like(cells)
        if len(self) % shape.symmetry == 0 and self.is_uniform():
            return cells % (len(self) // shape.symmetry)
        return cells

    @property
    def centers(self) -> Floats:
        """Center of each cell in [-pi, pi), (n, 1)."""
        return self._yaws[:, None]

    @property
    def _stored_arrays(self) -> dict[str, Floats]:
        """Center and boundaries of each cell, and its covering angle, radians."""
        bounds = np.stack([self.borders[:-1], self.borders[1:]], axis=1)
        arrays = self._yaws, bounds, self.covering_angles
        return dict(zip(self._COORDINATES, arrays, strict=True))

    @property
    def _volumes(self) -> Floats:
        """Width of each cell, radians."""
        return np.diff(self.borders)

    def _sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Draw a yaw from each cell, in [-pi, pi)."""
        low = np.asarray(self.borders)[cells]
        fractions = rng.uniform(margin, 1.0 - margin, len(cells))
        return wrap_angles(low + self._volumes[cells] * fractions)[:, None]

    def _angles_to_centers(self, q: Floats) -> Floats:
        """Return the angles to all representatives."""
        return np.abs(wrap_steps(self._yaws - q[..., -1:]))

    @property
    def neighbors(self) -> Ints:
        """Cells before and after each cell, in a ring."""
        # One cell has no neighbor, and the neighbor of one of two cells is on both sides of it.
        steps = np.arange(1, len(self)) if len(self) <= 2 else np.array([-1, 1])
        cells = np.arange(len(self))
        return (cells[:, None] + steps) % len(self)

    def _find_images(self, shape: HasSymmetries) -> list[tuple[Floats, Ints]]:
        """Return quarter turns and mirrors that permute yaw cells.

        Turns are about z; mirror planes contain z.
        """
        if not self.is_uniform():
            return Rotations._find_images(self, shape)
        images: list[tuple[Floats, Ints]] = []
        for determinant in (1.0, -1.0):  # turns, then mirrors
            # Any other symmetry of the robot gives the same images in another order.
            symmetry = _find_symmetry_about_z(shape, determinant)
            if symmetry is None:
                continue
            for quarter in _QUARTER_MATRICES:
                plane_matrix = quarter * (1.0, determinant)  # mirrors negate y first
                matrix = np.eye(len(symmetry))
                matrix[:2, :2] = plane_matrix
                x, y = plane_matrix @ symmetry[:2, 0]  # image of the robot's x axis
                # A mirror reverses the sense of rotation.
                yaws = determinant * self._yaws + np.arctan2(y, x)
                cells = self.cell_of(yaws)
                # The image of a center must be the center of a cell; the sine ignores whole turns.
                errors = np.abs(np.sin((yaws - self._yaws[cells]) / 2.0))
                if errors.max() < ANGLE_SLACK / 8.0:
                    images.append((matrix, cells))
        return images

    def _make_lookups(self, slice_of: Ints) -> RotationTable:
        """Return rotation cells in the form of kernels."""
        return RotationTable(np.array(self.borders), np.ascontiguousarray(slice_of))


def _check_borders(value: ArrayLike) -> Floats:
    """Return yaw borders that ascend over a turn.

    Raises InputError if they do not.
    """
    if np.ndim(value) != 1 or not 2 <= np.size(value) <= MAX_YAW_CELLS + 1:
        problem = f"has shape {np.shape(value)}"
        rule = f"it must be a count, or from 2 to {MAX_YAW_CELLS + 1} borders in radians"
        raise InputError("rotations", problem, rule)
    # They need not begin at any angle, but must end where they begin.
    angles = check_finite(value, "rotations")
    first = angles[0]
    last = angles[-1]
    ascends = (np.diff(angles) > 0).all()
    is_turn = abs(last - first - TWO_PI) <= ANGLE_SLACK
    if not ascends or not is_turn or abs(first) > TWO_PI:
        problem = f"reach from {first:g} to {last:g} rad, or do not ascend"
        rule = (
            f"borders, in radians, must ascend over {TWO_PI:.9f}, from one between -2 pi and 2 pi"
        )
        raise InputError("rotations", problem, rule)
    return angles


def check_wrappable(yaws: Floats, name: str) -> None:
    """Raise InputError if a yaw is too large to be wrapped exactly."""
    largest = float(np.abs(yaws).max(initial=0.0))
    if largest > MAX_ANGLE:
        rule = f"at most {MAX_ANGLE:.0f} can be wrapped exactly"
        raise InputError(name, f"has a yaw of {largest:g} rad", rule)


def _find_symmetry_about_z(shape: HasSymmetries, determinant: float) -> Floats | None:
    """Return a symmetry of a shape about the z axis, or None.

    Its determinant is 1 for a turn, -1 for a mirror.
    """
    for symmetry in shape.symmetries:
        # It acts on x and y by this matrix, and must leave z as it is.
        (a, b), (c, d) = symmetry[:2, :2].tolist()
        keeps_z = bool((symmetry[2:, 2:] == 1.0).all())
        if keeps_z and a * d - b * c == determinant:
            return symmetry
    return None

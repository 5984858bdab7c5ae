"""Interface of all kinds of rotation cells, and the cells of robots that only translate."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._support.arrays import Floats, Ints
from cspace._support.check import check_finite
from cspace._support.units import warn_of_large
from cspace.errors import InputError

METRES_PER_RADIAN: Final = 0.5
"""Length that a rotation by one radian adds to a path, as in OMPL's SE(2) and SE(3)."""

TWO_PI: Final = 2.0 * math.pi
"""A whole turn, in radians."""

MAX_ANGLE: Final = 2.0**20
"""Largest angle of a configuration, in radians, that is wrapped."""

ANGLE_SLACK: Final = 1e-9
"""Rounding allowance in radians, by which rotation cells are widened on both sides."""

ROTATION_UNITS: Final = {"yaw": "rad", "qx": "1", "qy": "1", "qz": "1", "qw": "1"}
"""Units of the coordinates of rotations, whose names no other coordinate of a pose has."""


def angle_axes(axes: Sequence[str], periodic_axes: Sequence[bool] = ()) -> dict[int, str]:
    """Return the names of the coordinates that are wrapped angles, by index.

    Yaws are wrapped, and the angles of continuous joints.
    """
    wrapped_axes = {k for k, is_periodic in enumerate(periodic_axes) if is_periodic}
    return {k: name for k, name in enumerate(axes) if name == "yaw" or k in wrapped_axes}


def wrap_steps(steps: Floats, periodic_axes: ArrayLike = True) -> Floats:
    """Wrap the angles of steps, shape (..., size), to [-pi, pi].

    The angles are those along ``periodic_axes``. The result equals :func:`math.remainder` to the
    last bit, so that half turns have the same sign everywhere.
    """
    # The remainder keeps up to two turns, because half turns go to the even number of turns. Both
    # the remainder and the difference are exact.
    remainder = np.fmod(steps, 2.0 * TWO_PI)
    shortest = remainder - TWO_PI * np.rint(remainder / TWO_PI)
    return np.where(periodic_axes, shortest, steps)


def measure_steps(steps: Floats, dim: int) -> tuple[Floats, Floats]:
    """Return the lengths and the angles, radians, of steps, shape (..., dim + k)."""
    return np.linalg.norm(steps[..., :dim], axis=-1), np.linalg.norm(steps[..., dim:], axis=-1)


def wrap_angles(angles: Floats, periodic_axes: ArrayLike = True) -> Floats:
    """Wrap angles to [-pi, pi); angles in that range are unchanged."""
    shortest = wrap_steps(angles, periodic_axes)
    is_half_turn = np.logical_and(periodic_axes, shortest >= math.pi)
    return np.where(is_half_turn, -math.pi, shortest)


def unwrap_near(angle: Floats, other: Floats) -> Floats:
    """Shift angles by whole turns, within pi of others."""
    whole_turns = np.rint((other - angle) / TWO_PI)
    return angle + TWO_PI * whole_turns


def turn_near(q: Floats, other: Floats, periodic_axes: ArrayLike) -> Floats:
    """Shift continuous joints by whole turns to within pi of other joints."""
    return np.where(periodic_axes, unwrap_near(q, other), q)


@dataclass(frozen=True, slots=True, eq=False)
class RotationCell:
    """A rotation cell in the form that shapes use.

    Attributes
    ----------
    matrix : ndarray of float64, shape (d, d), or None
        Representative rotation; None for the identity, which leaves coordinates unchanged to the
        last bit.
    covering_angle : float
        Largest angle between a rotation of the cell and the representative, radians.
    about_z : bool
        True if all rotations of the cell are about the z axis, on which points then stay.
    """

    matrix: Floats | None = None
    covering_angle: float = 0.0
    about_z: bool = False

    def apply(self, points: Floats) -> Floats:
        """Rotate points, shape (..., d), by the representative rotation.

        Equal points stay equal.
        """
        if self.matrix is None:
            return points
        # A matrix product may round equal points in different rows differently.
        rotated = np.zeros(points.shape)
        for k, column in enumerate(self.matrix.T):
            rotated += points[..., k, None] * column
        return rotated

    @property
    def in_plane(self) -> RotationCell:
        """The cell of rotations about z for points in the plane."""
        matrix = None if self.matrix is None else self.matrix[:2, :2]
        return RotationCell(matrix, self.covering_angle, self.about_z)

    def displacement(self, points: Floats) -> Floats:
        """Return the maximum displacement of points, shape (..., d), within the cell."""
        offsets = points[..., :2] if self.about_z else points
        levers = np.linalg.norm(offsets, axis=-1)
        # A point turns along a circle around its axis, by at most this chord of the unit circle.
        chord = 2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0)
        return np.asarray(chord * levers)


NO_ROTATION: Final[RotationCell] = RotationCell()
"""The cell of a robot that only translates."""


class Coordinate(NamedTuple):
    """Description of an array in files, with a value per rotation cell.

    Attributes
    ----------
    about : str
        Meaning of the values.
    units : str
        Unit of the values.
    axes : dict of str to int
        Names and lengths of its axes after the first.
    bounds : str
        Name of the array with the boundaries of the cells, if any.
    """

    about: str
    units: str
    axes: Mapping[str, int] = {}
    bounds: str = ""


COVERING_ANGLE: Final[Coordinate] = Coordinate(
    "largest angle between a rotation of a rotation cell and its representative", "rad"
)


class RotationTable(NamedTuple):
    """Rotation cells for kernels; see :mod:`cspace._rotations.lookup`.

    Attributes
    ----------
    borders : ndarray of float64
        Boundaries of the yaw cells, shape (n + 1,); or boundaries of the parts of an axis of
        quotients, shape (1, n + 1), for quaternions; or a number without meaning, shape (), for a
        robot that does not turn. Compiled code knows the number of axes, so it has no rotations
        unless the map has.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    """

    borders: Floats
    slice_of: Ints


class HasSymmetries(Protocol):
    """A robot's shape with its symmetries."""

    @property
    def symmetry(self) -> int:
        """Order of rotational symmetry about z; 0 if round."""

    @property
    def symmetries(self) -> list[Floats]:
        """Signed permutation matrices that map the shape to itself, with the identity."""

    @property
    def is_round(self) -> bool:
        """True if every rotation maps the shape to itself."""


class Rotations(ABC):
    """Rotation cells of a map.

    Each cell has a slice, and cells may share slices. There are three kinds: ``OneRotation`` of a
    robot that only translates, ``YawRotations`` in SE(2) and R^3 x SO(2), and
    ``QuaternionRotations`` in SE(3). :meth:`of` and :meth:`quaternions` make them. By default,
    methods are for a robot that only translates.

    A configuration consists of the d coordinates of a position, followed by the coordinates of a
    rotation. A *step* between configurations consists of d metres and a rotation vector, in
    radians, whose length is the angle. That vector has no entries, one in the plane and about z, or
    three in space, about axes fixed to the robot.

    Attributes
    ----------
    names : tuple of str
        Names of the coordinates of a rotation.
    """

    _KINDS: ClassVar[dict[str, Callable[[], type[Rotations]]]] = {}
    """Functions by name that return classes of rotation cells, see ``cspace._rotations``."""

    _COORDINATES: ClassVar[Mapping[str, Coordinate]] = {}
    """Descriptions of ``stored_arrays`` by name; the first name is unique to the kind."""

    names: ClassVar[tuple[str, ...]] = ()

    _limits: ClassVar[str] = ""
    """Rule for the coordinates, for messages; empty if there is none."""

    _slack: ClassVar[float] = ANGLE_SLACK
    """Maximum rotation error of a configuration due to rounding, in radians."""

    _about_z: ClassVar[bool] = False
    """True if all rotations are about the z axis."""

    @staticmethod
    def of(value: int | Sequence[float] | Rotations | ArrayLike | None) -> Rotations:
        """Make rotation cells from the argument of :func:`cspace.build`.

        Parameters
        ----------
        value : int, sequence of float, Rotations or None
            A number of equal cells of yaw, from 1 to 2^16, the first centered at 0; or the n + 1
            boundaries of such cells in radians, ascending over a whole turn; or rotation cells,
            which are returned. None for a robot that only translates.

        Raises
        ------
        InputError
            If the count is not a whole number from 1 to 2^16, or the boundaries do not ascend over
            a whole turn.
        """
        if isinstance(value, Rotations):
            return value
        kind = "fixed" if value is None else "yaw"
        return Rotations._KINDS[kind]()._of_value(value)

    @staticmethod
    def quaternions(n: int) -> Rotations:
        """Make 4 n^3 cells of all rotations in space, for SE(3).

        Their rotations are up to about 150 / n degrees from their centers. A unit quaternion (x, y,
        z, w), or its negative, is divided by its component of the largest modulus (the first of
        equals). The three quotients lie in [-1, 1], which is cut into n parts, at the tangents of
        equal angles.

        Parameters
        ----------
        n : int
            From 1 to 64; e.g. 4, 8, 12 or 16 for 256, 2,048, 6,912 or 16,384 cells.

        Raises
        ------
        InputError
            If `n` is not a whole number from 1 to 64.

        Examples
        --------
        >>> import cspace
        >>> len(cspace.Rotations.quaternions(8))
        2048
        """
        return Rotations._KINDS["quaternions"]()._of_value(n)

    @staticmethod
    def _from_stored_arrays(coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Make rotation cells from their ``stored_arrays``, exactly.

        Other arrays are ignored.
        """
        # OneRotation, the first kind, has no arrays, so it always matches; a later match wins.
        matching = [
            kind
            for kind in Rotations._list_kinds()
            if coordinates.keys() >= kind._COORDINATES.keys()
        ]
        return matching[-1]._of_stored_arrays(coordinates)

    @staticmethod
    def _list_kinds() -> tuple[type[Rotations], ...]:
        """List the classes of rotation cells."""
        return tuple(load() for load in Rotations._KINDS.values())

    @staticmethod
    def _all_limits() -> str:
        """Return the rule for configurations of all kinds, for messages."""
        limits = (kind._limits for kind in Rotations._list_kinds() if kind._limits)
        return f"numbers must be finite, {', '.join(limits)}"

    @classmethod
    @abstractmethod
    def _of_value(cls, value: ArrayLike | None) -> Rotations:
        """Make cells of one kind from the user's value, after checking it."""

    @classmethod
    @abstractmethod
    def _of_stored_arrays(cls, coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Make cells of one kind from their ``stored_arrays``."""

    # ---- rotations as numbers

    def make_canonical(self, q: Floats, name: str = "q") -> Floats:
        """Wrap yaws to [-pi, pi), and normalise quaternions.

        Configurations have the shape (..., d + size). Coordinates that are canonical stay unchanged
        to the last bit.

        Raises InputError if a yaw is too large to be wrapped exactly, or the norm of a quaternion
        is not 1 within 1e-6.
        """
        position, rotation = self._split_configurations(q)
        return np.concatenate([position, self._canonical_rotation(rotation, name)], axis=-1)

    def steps_between(self, q0: Floats, q1: Floats) -> Floats:
        """Return the steps between configurations, with the shorter rotation."""
        position0, rotation0 = self._split_configurations(q0)
        position1, rotation1 = self._split_configurations(q1)
        translation = position1 - position0
        rotation = self._rotation_between(rotation0, rotation1)
        return np.concatenate([translation, rotation], axis=-1)

    def add_steps(self, q: Floats, steps: Floats) -> Floats:
        """Return configurations after steps or fractions of steps.

        The rotation is even along a step.
        """
        position, rotation = self._split_configurations(q)
        dim = position.shape[-1]
        moved = position + steps[..., :dim]
        turned = self._rotate(rotation, steps[..., dim:])
        return np.concatenate([moved, turned], axis=-1)

    def check_rotation(self, rotation: ArrayLike, name: str = "rotation") -> Floats:
        """Return the canonical coordinates of one rotation, shape (size,).

        Raises InputError if it is not one rotation. ``name`` is for messages.
        """
        numbers = np.atleast_1d(check_finite(rotation, name, self.names))
        if numbers.shape != (len(self.names),):
            rule = "the robot does not turn"
            if self.names:
                rule = f"a rotation is given by {', '.join(self.names)}"
            problem = f"has shape {numbers.shape}"
            raise InputError(name, problem, rule)
        canonical = self._canonical_rotation(numbers, name)
        warn_of_large(numbers, "rad", name, angle_axes(self.names))
        return canonical

    def _split_configurations(self, q: Floats) -> tuple[Floats, Floats]:
        """Split configurations into position and rotation."""
        dim = q.shape[-1] - len(self.names)
        return q[..., :dim], q[..., dim:]

    def _canonical_rotation(self, rotation: Floats, name: str) -> Floats:
        """Return the canonical coordinates of rotations, shape (..., size)."""
        return rotation

    def _rotation_between(self, first: Floats, second: Floats) -> Floats:
        """Return the rotation vectors from first to second rotations."""
        return second - first

    def _rotate(self, rotation: Floats, by: Floats) -> Floats:
        """Rotate rotations further by rotation vectors."""
        return rotation

    def make_matrices(self, rotation: Floats, dim: int) -> Floats:
        """Return the matrices of rotations, shape (..., dim, dim).

        ``rotation`` has shape (..., size), as in a configuration; ``dim`` is 2 or 3.
        """
        return np.broadcast_to(np.eye(dim), (*rotation.shape[:-1], dim, dim))

    # ---- cells of rotations

    def __len__(self) -> int:
        """Return the number of cells."""
        return 1

    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Return the cells that contain rotations.

        Rotations are yaw angles (radians, any shape), or quaternions, shape (..., 4).
        """
        return np.zeros((), dtype=np.int64)

    def _find_cells(self, q: Floats) -> Ints:
        """Return cells of configurations, shape (..., d + size)."""
        return np.zeros(q.shape[:-1], dtype=np.int64)

    def _leading_axes(self, n: int) -> tuple[int, ...]:
        """Return the axes of an array of n slices before the grid's.

        They are (n,), or () if the robot does not turn.
        """
        return (n,)

    def _preserves(self, shape: HasSymmetries) -> bool:
        """Return True if every cell's rotations map a shape to itself."""
        return True

    def _check_dimension(self, dim: int) -> None:  # noqa: B027
        """Raise InputError if a space of ``dim`` dimensions has no such rotations."""

    def _assign_slices(self, shape: HasSymmetries) -> Ints:
        """Return the slice of each cell for a robot, shape (count,).

        Cells whose rotations differ by a symmetry of the robot share a slice. Slices are numbered
        from 0, in the order of their first cells.
        """
        return np.zeros(1, dtype=np.int64)

    def _make_shape_cells(self, dim: int) -> list[RotationCell]:
        """Return rotation cells in the form of shapes."""
        matrices = self.make_matrices(self.centers, dim)
        angles = self.covering_angles.tolist()
        return [
            RotationCell(matrix, angle, self._about_z)
            for matrix, angle in zip(matrices, angles, strict=True)
        ]

    @property
    def centers(self) -> Floats:
        """Representative rotation of each cell, shape (count, size)."""
        return np.zeros((1, 0))  # one cell, whose rotation has no coordinates

    @property
    def covering_angles(self) -> Floats:
        """Covering angle of each cell, radians.

        It is the largest angle between the center of a cell and a rotation in it; shape (count,).
        The angle includes rounding. It is 0 if the robot does not turn.
        """
        return np.zeros(1)

    @property
    def _stored_arrays(self) -> dict[str, Floats]:
        """Arrays that describe the cells in files, by name.

        The first axis counts the cells.
        """
        return {}

    @property
    def _volumes(self) -> Floats:
        """Volume of each cell, shape (count,), in any unit."""
        return np.ones(1)

    def _draw_cells(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Draw n cells with probabilities proportional to volume times share.

        ``shares``, shape (count,), has an entry above zero.
        """
        sizes = shares * self._volumes
        return rng.choice(len(self), size=n, p=sizes / sizes.sum())

    def _sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Draw a uniform rotation from each given cell, shape (n, size).

        ``margin`` is the fraction of a cell that is left out at each boundary.
        """
        return np.zeros((len(cells), 0))  # rotations without coordinates

    def _angles_to_centers(self, q: Floats) -> Floats:
        """Return the angles between rotations and the representatives of all cells.

        ``q`` are configurations, shape (..., d + size); the result has the shape (..., count),
        radians.
        """
        return np.zeros((*q.shape[:-1], 1))

    def find_cells_within(self, q: Floats, angles: Floats) -> tuple[Ints, Ints]:
        """Find the rotation cells within an angle of each configuration's rotation.

        ``q`` has the shape (n, d + size), ``angles``, in radians, the shape (n,). Returns pairs of
        configuration index and cell, shape (m,) each, in the order of the configurations; rounding
        is included.
        """
        indices = []
        cells = []
        # Maximum number of pairs of rotation and cell that are compared at a time.
        batch_size = max(1, 2**20 // len(self))
        for first in range(0, max(len(q), 1), batch_size):
            batch = slice(first, first + batch_size)
            reach = self.covering_angles + angles[batch, None]
            index, cell = np.nonzero(self._angles_to_centers(q[batch]) <= reach)
            indices.append(first + index)
            cells.append(cell)
        return np.concatenate(indices), np.concatenate(cells)

    @property
    def neighbors(self) -> Ints:
        """Cells that share a boundary with each cell, shape (count, n).

        Missing neighbours are -1.
        """
        return np.zeros((1, 0), dtype=np.int64)  # one cell without neighbours

    def _find_images(self, shape: HasSymmetries) -> list[tuple[Floats, Ints]]:
        """List rotations and mirrors that permute the rotation cells.

        Let S and M be signed permutation matrices, and M map the robot A to itself. Then S R A
        equals S R M A for every rotation R, so S maps the raster for R to that for S R M. Returns
        each S, shape (d, d), with the image of each cell, shape (count,); the identity is among
        them.
        """
        return [(np.eye(len(shape.symmetries[0])), np.arange(len(self)))]

    def _make_lookups(self, slice_of: Ints) -> RotationTable:
        """Return rotation cells in the form of kernels."""
        return RotationTable(np.zeros(()), np.ascontiguousarray(slice_of))

    @property
    def _facts(self) -> dict[str, object]:
        """Plain values of the cells, by name, for reports."""
        width = float(np.degrees(2.0 * self.covering_angles.max()))
        return {"rotations": len(self), "rotation_cell_deg": round(width, 6)}

    def __str__(self) -> str:
        """Return the number of cells in words."""
        return f"{len(self)} rotations"

    def __repr__(self) -> str:
        """Return the class and the number of cells."""
        return f"{type(self).__name__}({self})"


@dataclass(frozen=True, repr=False)
class OneRotation(Rotations):
    """The one rotation cell of a robot that only translates."""

    _slack: ClassVar[float] = 0.0

    @classmethod
    def _of_value(cls, value: ArrayLike | None = None) -> OneRotation:
        """Return the only cell."""
        return cls()

    @classmethod
    def _of_stored_arrays(cls, coordinates: Mapping[str, NDArray[Any]]) -> OneRotation:
        """Return the only cell."""
        return cls()

    @property
    def _facts(self) -> dict[str, object]:
        """An empty mapping, because one rotation needs no description."""
        return {}

    def _make_shape_cells(self, dim: int) -> list[RotationCell]:
        """Return the cell without a rotation."""
        return [NO_ROTATION]

    def _leading_axes(self, n: int) -> tuple[int, ...]:
        """Return (), because there is one slice."""
        return ()

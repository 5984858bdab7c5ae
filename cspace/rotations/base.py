"""What every kind of rotation cells is: numbers of a configuration, sets of rotations, and a record for look-ups."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints, Matrix, Numbers
from cspace.check import check_finite
from cspace.compiling import compilable
from cspace.errors import AngleWarning, InputError, warn_user

TWO_PI: Final = 2.0 * math.pi

MAX_ANGLE: Final = 2.0**20
"""Largest angle of a configuration, in radians, that is wrapped."""

MAX_JOINT_ANGLE: Final = 256.0
"""Largest angle of a continuous joint, in radians, that is wrapped: what rounding does to more turns could reach a
cell's slack."""

ANGLE_SLACK: Final = 1e-9
"""Rounding allowance in radians: rotation cells count as that much wider on both sides."""


LARGEST_EXPECTED: Final = TWO_PI * (1.0 + 1e-9)
"""Largest angle, in radians, that a user is expected to pass: beyond it, the angle is probably in degrees."""


def angle_axes(axes: Sequence[str], periodic_axes: Sequence[bool] = ()) -> dict[int, str]:
    """Return index and name of the numbers of a configuration that are wrapped: yaws and continuous joints."""
    joints = [*periodic_axes, *[False] * (len(axes) - len(periodic_axes))]
    return {k: name for k, (name, turns) in enumerate(zip(axes, joints, strict=True)) if name == "yaw" or turns}


def warn_of_degrees(q: Sequence[float] | Floats, angles: Mapping[int, str], name: str) -> None:
    """Warn the user about an angle of one configuration that is beyond a whole turn.

    ``angles`` are those of :func:`angle_axes`. The text leaves out the number, so that Python prints it once for each
    line of the user's program.
    """
    for k, axis in angles.items():
        if abs(q[k]) > LARGEST_EXPECTED:
            rule = "angles are in radians, and whole turns are ignored"
            warn_user(f"{name}: {axis} is beyond a whole turn; {rule}; use numpy.radians for degrees", AngleWarning)


def shorter(steps: Floats, periodic_axes: ArrayLike = True) -> Floats:
    """Steps, shape (..., k), without whole turns of the numbers that are angles without an end: the shorter way.

    It is what :func:`math.remainder` gives, to the last bit, so that also half a turn is gone the same way everywhere.
    """
    rest = np.fmod(steps, 2.0 * TWO_PI)  # exact, as is what follows
    return np.where(periodic_axes, rest - TWO_PI * np.rint(rest / TWO_PI), steps)


def wrapped(angles: Floats, periodic_axes: ArrayLike = True) -> Floats:
    """The same, with half a turn as -pi: in [-pi, pi). What is there already is unchanged."""
    near = shorter(angles, periodic_axes)
    return np.where(np.logical_and(periodic_axes, near >= math.pi), -math.pi, near)


def beside(angle: Floats, other: Floats) -> Floats:
    """Angles as many whole turns on as bring them next to others."""
    return angle + TWO_PI * np.rint((other - angle) / TWO_PI)


Cursor = Any
"""Where a walk over rotation cells is: numbers that only the kind itself reads."""

PAIRS: Final = 2**20
"""Rotations and cells that are compared together."""


@dataclass(frozen=True, slots=True, eq=False)
class RotationCell:
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

    matrix: Floats | None = None
    covering_angle: float = 0.0
    about_z: bool = False

    def apply(self, points: Floats) -> Floats:
        """Points, shape (..., d), turned about the origin by the representative rotation; equal ones stay so."""
        if self.matrix is None:
            return points
        # A product of matrices may round the same point differently in another row.
        return sum((points[..., k, None] * column for k, column in enumerate(self.matrix.T)), start=np.zeros(()))

    def displacement(self, points: Floats) -> Floats:
        """How far each of some points, shape (..., d), can come from its place within the cell, shape (...)."""
        lever = np.linalg.norm(points[..., :2] if self.about_z else points, axis=-1)
        return np.asarray(2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0) * lever)


NO_ROTATION: Final = RotationCell()
"""No rotation at all."""


class Coordinate(NamedTuple):
    """An array in files that describes rotation cells, one after the other.

    Attributes
    ----------
    about : str
    units : str
    axes : dict of str to int
        Names and lengths of its axes but the first.
    bounds : str
        Name of the array that has the borders of the cells, if there is one.
    """

    about: str
    units: str
    axes: Mapping[str, int] = {}
    bounds: str = ""


COVERING_ANGLE: Final = Coordinate("largest angle between a rotation of a rotation cell and its representative", "rad")


class Dial(NamedTuple):
    """A picture of rotations: a disc of radius 1, or a part of one.

    Attributes
    ----------
    title : str
    inside : ndarray of bool, shape (n, n)
        Which pixels belong to it.
    rotations : ndarray of float64, shape (2, m, k)
        Two of each of these, all but the same, as in configurations: they may lie in two cells with one border.
    marks : tuple of (str, float, float)
        Texts, and where they stand.
    """

    title: str
    inside: Bools
    rotations: Floats
    marks: tuple[tuple[str, float, float], ...]


DIAL_STEPS: Final = np.array([[-1e-6], [1e-6]])
"""Radians between the two rotations that a pixel of a dial is looked up at."""


class CompiledRotations(Protocol):
    """What compiled look-ups get: a NamedTuple of arrays with these methods, for numba to compile into its callers.

    Configurations are tuples of floats; the last of them are the rotation.
    """

    @property
    def slice_of(self) -> Sequence[int] | Ints:
        """The slice of each rotation cell."""

    def zeros(self) -> Numbers:
        """What the numbers of a rotation in a configuration are counted from, a yaw from the first border; a tuple."""

    def is_usable(self, q: Numbers) -> bool:
        """Whether a rotation's numbers are finite, and exact enough."""

    def states_at(self, q: Numbers) -> int:
        """The slice of the rotation cell that holds the rotation of a configuration."""

    def slices_at(self, numbers: Floats, size: int, out: Ints) -> None:
        """The same of many, whose numbers are in a row, for :meth:`slice_among` to read; any, if not usable."""

    def slice_among(self, slices: Ints, k: int) -> int:
        """One of those."""

    def first_piece(self, q0: Numbers, q1: Numbers) -> Cursor:
        """Begin a walk along an edge, on which the rotation goes the shortest way."""

    def next_piece(self, cursor: Cursor) -> tuple[bool, int, float, float, Cursor]:
        """The next piece of the edge: whether there is one, its slice, and where it begins and ends.

        Parameters along an edge go from 0 to 1. Cells count as wider by the rounding allowance: pieces overlap.
        """

    def first_around(self, q: Numbers, angle: float) -> Cursor:
        """Begin a walk over the rotation cells within an angle of the rotation of a configuration."""

    def next_around(self, cursor: Cursor) -> tuple[bool, int, Cursor]:
        """The next of these cells: whether there is one, and its slice."""

    def arc_count(self, q0: Numbers, q1: Numbers) -> int:
        """Number of shortest arcs from one rotation to another: two where they are equally long but for rounding."""

    def turn_of(self, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
        """The angle of one of these arcs, and how far from it a planner may take the rotation to be, radians."""

    def turned(self, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
        """The first configuration with the rotation at t in [0, 1] along one of these arcs."""

    def matrix_of(self, q: Numbers) -> Matrix:
        """The rows of the rotation matrix of a configuration in space."""


class Symmetric(Protocol):
    """What rotation cells need of a robot's shape."""

    @property
    def symmetry(self) -> int:
        """The number of turns about the z axis that map it to itself in each whole turn; 0 for all."""

    @property
    def symmetries(self) -> list[Floats]:
        """The matrices of one 1 or -1 in each row and column that map it to itself, the unit matrix among them."""

    @property
    def is_round(self) -> bool:
        """Whether every rotation about the reference point maps it to itself."""


class Rotations(ABC):
    """The rotation cells of a map; each has one slice, and cells may share theirs.

    There are three kinds: ``OneRotation`` of a robot that only translates, ``YawRotations`` in SE(2) and
    R^3 x SO(2), and ``QuaternionRotations`` in SE(3). :meth:`of` and :meth:`quaternions` make them. Methods that a kind
    does not define answer for the one cell of a robot that only translates.

    A configuration is d numbers of a position and then those of a rotation. A *step* from one to another is d metres
    and then a rotation vector, in radians, whose length is the angle: of no numbers, of one in the plane and about z,
    of three in space, about axes that turn with the robot.

    Attributes
    ----------
    names : tuple of str
        The numbers of a rotation.
    units : tuple of str
        Their units: "rad", or "1" for the numbers of a quaternion.
    examples : tuple of str
        Such numbers as texts: angles with their unit.
    limits : str
        What these must keep to, for messages; nothing, where there are none.
    slack : float
        Radians by which rounding may turn a robot farther than its configuration says.
    about_z : bool
        Whether all rotations are about the z axis.
    """

    KINDS: ClassVar[dict[str, type[Rotations]]] = {}
    """The kinds that there are, see ``cspace.rotations``."""

    COORDINATES: ClassVar[Mapping[str, Coordinate]] = {}
    """What :attr:`coordinates` are, by their names; the first one is of this kind alone."""

    names: ClassVar[tuple[str, ...]] = ()
    units: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[str, ...]] = ()
    limits: ClassVar[str] = ""
    slack: ClassVar[float] = ANGLE_SLACK
    about_z: ClassVar[bool] = False

    @staticmethod
    def of(value: int | Sequence[float] | Rotations | ArrayLike | None) -> Rotations:
        """Rotation cells as :func:`cspace.build` takes them.

        Parameters
        ----------
        value : int, sequence of float, Rotations or None
            A number of equal cells of yaw, from 1 to 2^16, the first of which has its middle at 0; or n + 1 borders of
            such cells in radians, ascending, the last one a whole turn after the first; or what this gave before. None
            for a robot that only translates.

        Raises
        ------
        InputError
            If the count is not a whole number from 1 to 2^16, or the borders do not ascend over a whole turn.
        """
        if isinstance(value, Rotations):
            return value
        return Rotations.KINDS["fixed" if value is None else "yaw"].of_value(value)

    @staticmethod
    def quaternions(n: int) -> Rotations:
        """Cells of all rotations in space, for SE(3): 4 n^3 of them, up to about 150 / n degrees from their middles.

        A unit quaternion (x, y, z, w), or its negative, is divided by its component of the largest modulus (the first
        one, where several are as large). The three quotients lie in [-1, 1], which is cut into n parts, at the
        tangents of equal angles.

        Parameters
        ----------
        n : int
            From 1 to 64; e.g. 4, 8, 12 or 16 for 256, 2,048, 6,912 or 16,384 cells.

        Raises
        ------
        InputError
            If it is not such a number.

        Examples
        --------
        >>> import cspace
        >>> cspace.Rotations.quaternions(8).count
        2048
        """
        return Rotations.KINDS["quaternions"].of_value(n)

    @staticmethod
    def from_coordinates(coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Rotation cells from their :attr:`coordinates`, to the last bit; there may be others among them."""
        kinds = reversed(Rotations.KINDS.values())  # that of no coordinates is the first
        return next(
            kind.of_coordinates(coordinates) for kind in kinds if all(name in coordinates for name in kind.COORDINATES)
        )

    @staticmethod
    def all_names() -> list[str]:
        """Return the names of the numbers of a rotation, of all kinds; no other number of a configuration has one."""
        return list(Rotations.all_units())

    @staticmethod
    def all_units() -> dict[str, str]:
        """Return the units of the numbers of a rotation, of all kinds, by their names."""
        kinds = Rotations.KINDS.values()
        return {name: unit for kind in kinds for name, unit in zip(kind.names, kind.units, strict=True)}

    @staticmethod
    def all_limits() -> str:
        """What numbers of a configuration must keep to, of all kinds, for messages."""
        limits = (kind.limits for kind in Rotations.KINDS.values() if kind.limits)
        return f"numbers must be finite, {', '.join(limits)}"

    @classmethod
    @abstractmethod
    def of_value(cls, value: ArrayLike | None) -> Rotations:
        """Cells of a kind from what users pass for them, checked."""

    @classmethod
    @abstractmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Cells of a kind from their :attr:`coordinates`."""

    # ---- rotations as numbers

    def canonical(self, q: Floats, name: str = "q") -> Floats:
        """Configurations, shape (..., d + k), with each yaw in [-pi, pi) and each quaternion of norm 1.

        Numbers that are so already stay as they are, to the last bit.

        Raises InputError if a yaw is too large to be wrapped exactly, or the norm of a quaternion is not 1 within 1e-6.
        """
        place, rotation = self._parts(q)
        return np.concatenate([place, self._canonical(rotation, name)], axis=-1)

    def steps(self, q0: Floats, q1: Floats) -> Floats:
        """The steps that lead from configurations to others, turning the shorter way."""
        (place0, rotation0), (place1, rotation1) = self._parts(q0), self._parts(q1)
        return np.concatenate([place1 - place0, self._between(rotation0, rotation1)], axis=-1)

    def moved(self, q: Floats, steps: Floats) -> Floats:
        """Configurations after steps, or after parts of them: a robot turns evenly along a step."""
        place, rotation = self._parts(q)
        dim = place.shape[-1]
        return np.concatenate([place + steps[..., :dim], self._turned(rotation, steps[..., dim:])], axis=-1)

    def matrices(self, q: Floats) -> Floats:
        """Rotation matrices of configurations, shape (..., d, d)."""
        place, rotation = self._parts(q)
        return self._matrices(rotation, place.shape[-1])

    def checked(self, rotation: ArrayLike, name: str = "rotation") -> Floats:
        """A rotation as its numbers, canonical, shape (k,).

        Raises InputError if it is not one rotation.
        """
        numbers = np.atleast_1d(check_finite(rotation, name))
        if numbers.shape != (len(self.names),):
            rule = f"a rotation is given by {', '.join(self.names)}" if self.names else "the robot does not turn"
            raise InputError(name, f"has shape {numbers.shape}", rule, "pass one rotation", value=rotation)
        canonical = self._canonical(numbers, name)
        warn_of_degrees(numbers, angle_axes(self.names), name)
        return canonical

    def text(self, rotation: Floats) -> str:
        """A rotation, shape (k,), as a text for people."""
        return ""

    def of_matrix(self, matrix: Floats) -> Floats:
        """The rotation, shape (k,), that a rotation matrix of space is; of a yaw, that about z alone."""
        return np.empty(0)

    def heading(self, q: Floats) -> float | None:
        """The yaw of a configuration, radians; None where its rotation is no yaw."""
        return None

    def sample_near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        """A rotation within an angle, made from uniform numbers of [0, 1); plain numbers, as it is made one by one."""
        return rotation

    def _parts(self, q: Floats) -> tuple[Floats, Floats]:
        dim = q.shape[-1] - len(self.names)
        return q[..., :dim], q[..., dim:]

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        return rotation

    def _between(self, first: Floats, second: Floats) -> Floats:
        return second - first

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        return rotation

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        return np.broadcast_to(np.eye(dim), (*rotation.shape[:-1], dim, dim))

    # ---- cells of rotations

    @property
    def count(self) -> int:
        """Number of cells."""
        return 1

    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Cells that hold rotations: yaw angles (radians, any shape), or quaternions, shape (..., 4)."""
        return np.zeros((), dtype=np.int64)

    def one_cell(self, rotation: ArrayLike | None, name: str, rule: str) -> int:
        """Number of the cell that holds a rotation; of the only cell, where none is given.

        Raises
        ------
        InputError
            If it is not one rotation, or none is given and there are several cells; ``rule`` says why one is needed.
        """
        if rotation is None and self.count > 1:
            rule = f"{rule}, and this map has {self.count} rotation cells"
            raise InputError(name, "is missing", rule, f"pass the one to take, by {', '.join(self.names)}")
        return int(self.cells_of(self.centers[0] if rotation is None else self.checked(rotation, name)))

    def cells_of(self, q: Floats) -> Ints:
        """Cells of configurations, shape (..., d + k), of which only the last k numbers count; shape (...)."""
        return np.zeros(q.shape[:-1], dtype=np.int64)

    def leading(self, n: int) -> tuple[int, ...]:
        """First axes of an array that holds n grids: none where there is only ever one, otherwise (n,)."""
        return (n,)

    def preserve(self, shape: Symmetric) -> bool:
        """Whether all rotations of all cells map a robot to itself."""
        return True

    def check_dimension(self, dim: int) -> None:  # noqa: B027
        """Refuse robots of a dimension in which there are no such rotations.

        Raises
        ------
        InputError
            If it is one.
        """

    def fewer(self, share: float) -> str:
        """What to pass instead to get at most a share of the cells, for messages."""
        return ""

    def slices_for(self, shape: Symmetric) -> Ints:
        """Number of the slice that each cell has for a robot, shape (count,).

        Cells whose rotations differ by one that maps the robot to itself share a slice. Slices are numbered from 0, in
        the order of the first cells that have them.
        """
        return np.zeros(1, dtype=np.int64)

    def turns(self, dim: int) -> list[RotationCell]:
        """The cells as shapes in the plane or in space meet them."""
        return [NO_ROTATION]

    @property
    def centers(self) -> Floats:
        """The representative rotation of each cell, as a configuration has it, shape (count, k)."""
        return np.zeros((1, 0))

    @property
    def covering_angles(self) -> Floats:
        """Largest angle between a rotation of a cell and its representative, rounding included, shape (count,)."""
        return np.zeros(1)

    @property
    def coordinates(self) -> dict[str, Floats]:
        """Arrays that describe the cells, by their names in files; the first axis of each counts the cells."""
        return {}

    @property
    def volumes(self) -> Floats:
        """How much of all rotations each cell is, in any unit, shape (count,)."""
        return np.ones(1)

    def draw_cells(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Cells drawn by their volumes times ``shares``, shape (count,), of which one is above zero; shape (n,)."""
        sizes = shares * self.volumes
        return rng.choice(self.count, size=n, p=sizes / sizes.sum())

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """A rotation drawn uniformly from each of some cells, shape (n, k); that part of a cell's border is left."""
        return np.zeros((len(cells), 0))

    def distances(self, q: Floats) -> Floats:
        """Angles between rotations of configurations, shape (..., d + k), and each cell's representative, radians.

        Of shape (..., count).
        """
        return np.zeros((*q.shape[:-1], 1))

    def cells_within(self, q: Floats, angles: Floats) -> tuple[Ints, Ints]:
        """Every cell with a rotation within an angle, shape (n,), of that of a configuration, shape (n, d + k).

        Gives pairs of a configuration and a cell, shape (m,) each, rounding included, in the order of the
        configurations.
        """
        rows, cells, room = [], [], max(1, PAIRS // self.count)
        for k in range(0, max(len(q), 1), room):
            reach = self.covering_angles + angles[k : k + room, None]
            row, cell = np.nonzero(self.distances(q[k : k + room]) <= reach)
            rows.append(row + k)
            cells.append(cell)
        return np.concatenate(rows), np.concatenate(cells)

    @property
    def neighbors(self) -> Ints:
        """The cells that each one shares a border with, shape (count, n); -1 fills up."""
        return np.zeros((1, 0), dtype=np.int64)

    def images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        """What turns or mirrors the world so that it maps cells of rotations to cells, for a robot.

        Let S and M be matrices of one 1 or -1 in each row and column, and M map the robot A to itself. Then S R A is S
        R M A for every rotation R, so that S makes the raster for S R M from that for R. Gives each S, shape (d, d),
        with the cell that each one becomes, shape (count,); the unit matrix among them.
        """
        return [(np.eye(len(shape.symmetries[0])), np.arange(self.count))]

    def compiled(self, slice_of: Ints) -> CompiledRotations:
        """What compiled look-ups get."""
        return OneCell((0,))

    def dials(self, x: Floats, y: Floats) -> list[Dial]:
        """All rotations as dials of pixels at x and y, shape (n, n) each; none, where nothing turns."""
        return []

    @property
    def _facts(self) -> dict[str, object]:
        """What there is to say of the cells, for people: plain values by what they are."""
        width = float(np.degrees(2.0 * self.covering_angles.max()))
        return {"rotations": self.count, "rotation_cell_deg": round(width, 6)}

    @property
    def fixed(self) -> Floats | None:
        """The rotation of a robot that only translates, shape (0,); None of one that turns."""
        return None

    def describe(self, rotation: Floats | None) -> str:
        """In words: the rotation cell that holds a rotation, or, where none is given, all of them."""
        angles = np.degrees(2.0 * self.covering_angles)
        if rotation is not None:
            return f"{self.text(rotation)}, in a rotation cell of {angles[self.cell_of(rotation)].item():.3g}°"
        width = f"{angles.min():.3g}°" + ("" if np.ptp(angles) < 1e-6 else f" to {angles.max():.3g}°")
        return f"over all rotations, {self.count} rotation cells of {width}"

    def __str__(self) -> str:
        return f"{self.count} rotations"

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self})"


@dataclass(frozen=True, repr=False)
class OneRotation(Rotations):
    """The one cell of a robot that only translates."""

    slack: ClassVar[float] = 0.0

    @classmethod
    def of_value(cls, value: ArrayLike | None = None) -> OneRotation:
        return cls()

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> OneRotation:
        return cls()

    @property
    def _facts(self) -> dict[str, object]:
        return {}

    @property
    def fixed(self) -> Floats:
        return np.empty(0)

    def describe(self, rotation: Floats | None) -> str:
        return ""

    def leading(self, n: int) -> tuple[int, ...]:
        return ()

    def draw_cells(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Return cell 0 `n` times, without a draw."""
        return np.zeros(n, dtype=np.int64)


@compilable
class OneCell(NamedTuple):
    """What compiled look-ups get of a robot that only translates."""

    slice_of: tuple[int]

    def zeros(self) -> tuple[()]:
        return ()

    def is_usable(self, q: Numbers) -> bool:
        return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start

    def states_at(self, q: Numbers) -> int:
        return 0

    def slices_at(self, numbers: Floats, size: int, out: Ints) -> None:
        pass

    def slice_among(self, slices: Ints, k: int) -> int:
        return 0

    def first_piece(self, q0: Numbers, q1: Numbers) -> bool:
        return np.bool_(True)  # type: ignore[return-value]  # of one type for the compiler from the start

    def next_piece(self, cursor: bool) -> tuple[bool, int, float, float, bool]:
        return cursor, 0, 0.0, 1.0, False

    def first_around(self, q: Numbers, angle: float) -> bool:
        return True

    def next_around(self, cursor: bool) -> tuple[bool, int, bool]:
        return cursor, 0, False

    def arc_count(self, q0: Numbers, q1: Numbers) -> int:
        return 1

    def turn_of(self, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
        return 0.0, 0.0

    def turned(self, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
        return q0

    def matrix_of(self, q: Numbers) -> Matrix:
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

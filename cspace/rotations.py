"""Rotation cells: the sets of rotations that a map tells apart.

A kind of rotation cells is a class here, the record that compiled look-ups get of it, and the compiled functions of
:mod:`cspace.map.turning` for that record. No look-up knows which kind it has.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import finite

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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


class OneCell(NamedTuple):
    """What compiled look-ups get of a robot that only translates."""

    slice_of: tuple[int]


class YawCells(NamedTuple):
    """What compiled look-ups get of yaw cells."""

    borders: Floats
    slice_of: Ints


CompiledRotations = OneCell | YawCells


class Symmetric(Protocol):
    """What rotation cells ask of a robot."""

    @property
    def symmetry(self) -> int:
        """The number of turns about the reference point that map it to itself in each whole turn; 0 for all."""


class Rotations(ABC):
    """The rotation cells of a map; each has one slice, and cells may share theirs.

    There are three kinds: :class:`OneRotation` of a robot that only translates, :class:`YawRotations` in SE(2) and
    R^3 x SO(2). :meth:`of` makes the one that a caller asks for.

    Attributes
    ----------
    names : tuple of str
        The numbers of a configuration that tell its rotation: those behind the position.
    dof : int
        How many they are.
    """

    names: ClassVar[tuple[str, ...]]
    dof: ClassVar[int]

    @staticmethod
    def of(value: int | Sequence[float] | Rotations | ArrayLike | None) -> Rotations:
        """Rotation cells as :func:`cspace.build` takes them.

        Parameters
        ----------
        value : int, sequence of float, Rotations or None
            A number of equal cells of yaw, the first of which has its middle at 0; or n + 1 borders of such cells in
            radians, ascending, the last one a whole turn after the first; or what this gave before. None for a robot
            that only translates.

        Raises
        ------
        InputError
            If the count is not a whole number above zero, or the borders do not ascend over a whole turn.
        """
        if isinstance(value, Rotations):
            return value
        return OneRotation() if value is None else YawRotations.from_borders(value)

    @staticmethod
    def from_coordinates(coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Rotation cells from their :attr:`coordinates`, to the last bit; there may be others among them."""
        for kind in (YawRotations,):
            if all(name in coordinates for name in kind.COORDINATES):
                return kind.of_coordinates(coordinates)
        return OneRotation()

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of cells."""

    @abstractmethod
    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Cells that hold rotations: yaw angles (radians, any shape); nothing, where there is one cell."""

    @abstractmethod
    def cells_of(self, q: Floats) -> Ints:
        """Cells of configurations, shape (..., d + dof), of which only the last dof numbers count; shape (...)."""

    @abstractmethod
    def leading(self, n: int) -> tuple[int, ...]:
        """First axes of an array that holds n grids: none where there is only ever one, otherwise (n,)."""

    @abstractmethod
    def slice_of(self, robot: Symmetric) -> Ints:
        """Number of the slice that each cell has for a robot, shape (count,).

        Cells whose rotations differ by one that maps the robot to itself share a slice. Slices are numbered from 0, in
        the order of the first cells that have them.
        """

    @abstractmethod
    def turns(self, dim: int) -> list[Turn]:
        """The cells as shapes in the plane or in space meet them."""

    @property
    @abstractmethod
    def centers(self) -> Floats:
        """The representative rotation of each cell, as a configuration tells it, shape (count, dof)."""

    @property
    @abstractmethod
    def covering_angles(self) -> Floats:
        """Largest angle between a rotation of a cell and its representative, rounding included, shape (count,)."""

    @property
    @abstractmethod
    def coordinates(self) -> dict[str, Floats]:
        """Arrays that tell of the cells, by their names in files; the first axis of each counts the cells."""

    @property
    @abstractmethod
    def volumes(self) -> Floats:
        """How much of all rotations each cell is, in any unit, shape (count,)."""

    @abstractmethod
    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """A rotation drawn uniformly from each of some cells, shape (n, dof); that part of a cell's border is left."""

    @abstractmethod
    def distances(self, q: Floats) -> Floats:
        """Angle between the rotation of a configuration and each cell's representative, radians, shape (count,)."""

    @property
    @abstractmethod
    def neighbors(self) -> Ints:
        """The cells that each one shares a border with, shape (count, n); -1 fills up."""

    @property
    def quarter(self) -> int:
        """How many cells farther lie those that are a quarter turn about the z axis away; 0 where none do."""
        return 0

    @abstractmethod
    def compiled(self, slice_of: Ints) -> CompiledRotations:
        """What compiled look-ups get."""

    def __str__(self) -> str:
        return f"{self.count} rotations"


@dataclass(frozen=True, slots=True)
class OneRotation(Rotations):
    """The one cell of a robot that only translates."""

    names: ClassVar[tuple[str, ...]] = ()
    dof: ClassVar[int] = 0
    COORDINATES: ClassVar[tuple[str, ...]] = ()

    @property
    def count(self) -> int:
        """One."""
        return 1

    def cell_of(self, rotation: ArrayLike = ()) -> Ints:
        """Cell 0, whatever the rotation."""
        return np.zeros((), dtype=np.int64)

    def cells_of(self, q: Floats) -> Ints:
        """Cell 0 for each."""
        return np.zeros(q.shape[:-1], dtype=np.int64)

    def leading(self, n: int) -> tuple[int, ...]:
        """None."""
        return ()

    def slice_of(self, robot: Symmetric) -> Ints:
        """Slice 0."""
        return np.zeros(1, dtype=np.int64)

    def turns(self, dim: int) -> list[Turn]:
        """No rotation at all."""
        return [STILL]

    @property
    def centers(self) -> Floats:
        """No numbers."""
        return np.zeros((1, 0))

    @property
    def covering_angles(self) -> Floats:
        """Zero."""
        return np.zeros(1)

    @property
    def coordinates(self) -> dict[str, Floats]:
        """None."""
        return {}

    @property
    def volumes(self) -> Floats:
        """All."""
        return np.ones(1)

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """No numbers."""
        return np.zeros((len(cells), 0))

    def distances(self, q: Floats) -> Floats:
        """Zero."""
        return np.zeros(1)

    @property
    def neighbors(self) -> Ints:
        """None."""
        return np.zeros((1, 0), dtype=np.int64)

    def compiled(self, slice_of: Ints) -> OneCell:
        """What compiled look-ups get."""
        return OneCell((0,))


@dataclass(frozen=True, slots=True)
class YawRotations(Rotations):
    """Cells of yaw, for SE(2) in the plane and R^3 x SO(2) in space; cell ``k`` is ``[borders[k], borders[k + 1]]``.

    Attributes
    ----------
    borders : tuple of float, length n + 1
        Ascending, in radians; the last one is the first one plus a whole turn.
    """

    borders: tuple[float, ...]
    names: ClassVar[tuple[str, ...]] = ("yaw",)
    dof: ClassVar[int] = 1
    COORDINATES: ClassVar[tuple[str, ...]] = ("yaw", "yaw_bounds", "covering_angle")

    @classmethod
    def from_borders(cls, value: Any) -> YawRotations:
        """Cells from a count or from their borders, as :meth:`Rotations.of` tells."""
        if isinstance(value, bool) or np.ndim(value) == 0:
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
                raise InputError(
                    "rotations",
                    f"is {value!r}",
                    "it must be a whole number above zero, or the cells' borders in radians",
                    "pass e.g. 72",
                    value=value,
                )
            count = int(value)
            width = TURN / count
            borders = [(k - 0.5) * width for k in range(count)]
        else:
            angles = finite(value, "rotations")
            if angles.ndim != 1 or len(angles) < 2:
                raise InputError(
                    "rotations",
                    f"has shape {angles.shape}",
                    "it must hold at least two borders",
                    "pass e.g. 72, or numpy.linspace(0, 2 * numpy.pi, 73)",
                    value=value,
                )
            if (np.diff(angles) <= 0).any() or abs(angles[0]) > TURN:
                raise InputError(
                    "rotations",
                    "are borders that do not ascend, or begin more than a turn from zero",
                    mend="sort them, in radians, from one between -2 pi and 2 pi",
                    value=value,
                )
            if abs(angles[-1] - angles[0] - TURN) > YAW_SLACK:
                raise InputError(
                    "rotations",
                    f"reach from {angles[0]:g} to {angles[-1]:g} rad",
                    f"they must cover the whole circle, 2 pi = {TURN:.9f}",
                    "end with the first border plus 2 pi (numpy.radians turns degrees)",
                    value=value,
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
            largest = float(np.abs(angles).max())
            raise InputError(
                "yaw",
                f"is {largest:g} rad",
                f"at most {MAX_YAW:.0f} can be wrapped exactly",
                "wrap it first",
                value=largest,
            )
        # As the compiled look-ups wrap, to the last bit; a yaw within the borders stays as it is.
        wrapped = angles - np.floor((angles - self.borders[0]) / TURN) * TURN
        return np.clip(np.searchsorted(self.borders, wrapped, side="right") - 1, 0, self.count - 1).astype(np.int64)

    def cells_of(self, q: Floats) -> Ints:
        """Cells of configurations whose last number is the yaw."""
        return self.cell_of(q[..., -1])

    def leading(self, n: int) -> tuple[int, ...]:
        """One axis of n."""
        return (n,)

    def slice_of(self, robot: Symmetric) -> Ints:
        """Cells a symmetry apart share a slice, where all cells are equally wide."""
        cells = np.arange(self.count, dtype=np.int64)
        if robot.symmetry == 0:
            return np.zeros_like(cells)
        if self.count % robot.symmetry == 0 and self.is_uniform():
            return cells % (self.count // robot.symmetry)
        return cells

    def turns(self, dim: int) -> list[Turn]:
        """Rotations about the z axis, or about the origin of the plane."""
        made = []
        for yaw, angle in zip(self.representatives.tolist(), self.covering_angles.tolist(), strict=True):
            matrix = np.eye(dim)
            matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
            made.append(Turn(matrix, angle, about_z=True))
        return made

    @property
    def centers(self) -> Floats:
        """The middle yaw of each cell."""
        return self.representatives[:, None]

    @property
    def coordinates(self) -> dict[str, Floats]:
        """The middle and the borders of each cell, and its covering angle, radians."""
        bounds = np.stack([self.borders[:-1], self.borders[1:]], axis=1)
        return dict(zip(self.COORDINATES, (self.representatives, bounds, self.covering_angles), strict=True))

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> YawRotations:
        """Cells from the bounds among their coordinates."""
        bounds = coordinates["yaw_bounds"]
        return cls.from_borders([*bounds[:, 0].tolist(), float(bounds[-1, 1])])

    @property
    def volumes(self) -> Floats:
        """The width of each cell, radians."""
        return np.diff(self.borders)

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Yaws uniform over cells."""
        within = rng.uniform(margin, 1.0 - margin, len(cells))
        return np.asarray(np.asarray(self.borders)[cells] + self.volumes[cells] * within)[:, None]

    def distances(self, q: Floats) -> Floats:
        """Along the shorter arc."""
        return np.asarray(np.abs((self.representatives - q[-1] + np.pi) % TURN - np.pi))

    @property
    def neighbors(self) -> Ints:
        """The cell before each and the one after it; the last and the first are neighbours too."""
        ways = [[], [1], [-1, 1]][min(self.count - 1, 2)]
        return (np.arange(self.count)[:, None] + np.array(ways, dtype=np.int64)) % self.count

    @property
    def quarter(self) -> int:
        """A fourth of the cells, where all are equally wide and it is a whole number."""
        return self.count // 4 if self.count % 4 == 0 and self.is_uniform() else 0

    def compiled(self, slice_of: Ints) -> YawCells:
        """What compiled look-ups get."""
        return YawCells(np.array(self.borders), np.ascontiguousarray(slice_of))

"""Rotation cells: the sets of rotations that a map distinguishes.

A kind of rotation cells is a class here, the record that compiled look-ups get of it, and the compiled functions of
:mod:`cspace.map.turning` for that record. No look-up knows which kind it has.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats, Ints, frozen
from cspace.errors import InputError
from cspace.grid import finite, whole
from cspace.orientation import MAX_YAW as MAX_YAW
from cspace.orientation import NORM_SLACK as NORM_SLACK
from cspace.orientation import TURN as TURN
from cspace.orientation import Orientation, Quaternion, Unturned, Yaw, product_of

PAIRS: Final = 2**20
"""Rotations and cells that are compared together."""

YAW_SLACK: Final = 1e-9
"""Rounding allowance in radians: rotation cells count as that much wider on both sides."""

QUOTIENT_SLACK: Final = 1e-9
"""Rounding allowance in the quotients of a quaternion: its cells count as that much wider at each border."""

MAX_CUTS: Final = 64
"""Most cuts of an axis of quaternions: a million cells."""

OTHERS: Final = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
"""Of each component of a quaternion, the other ones."""

_QUARTERS: Final = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]], dtype=float)
_HALF_TURNS: Final = np.array([np.diag(signs) for signs in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))], float)
"""About x, y and z, and none at all: those by the quaternions of the unit matrix."""


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


STILL: Final = Turn()
"""No rotation at all."""


class OneCell(NamedTuple):
    """What compiled look-ups get of a robot that only translates."""

    slice_of: tuple[int]


class YawCells(NamedTuple):
    """What compiled look-ups get of yaw cells."""

    borders: Floats
    slice_of: Ints


class QuaternionCells(NamedTuple):
    """What compiled look-ups get of quaternion cells: the borders along each axis of a chart, and the slices."""

    borders: Floats
    slice_of: Ints


CompiledRotations = OneCell | YawCells | QuaternionCells


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


class Rotations(Orientation):
    """The rotation cells of a map; each has one slice, and cells may share theirs.

    There are three kinds: ``OneRotation`` of a robot that only translates, ``YawRotations`` in SE(2) and
    R^3 x SO(2), and ``QuaternionRotations`` in SE(3). :meth:`of` and :meth:`quaternions` make them.

    Attributes
    ----------
    dof : int
        How many numbers of a configuration are its rotation: those behind the position.
    slack : float
        Radians by which rounding may turn a robot farther than its configuration says.
    """

    dof: ClassVar[int]
    slack: ClassVar[float] = YAW_SLACK

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
        return QuaternionRotations(whole(n, "rotations", 1, MAX_CUTS, "pass e.g. 8, for 2,048 cells of quaternions"))

    @staticmethod
    def from_coordinates(coordinates: Mapping[str, NDArray[Any]]) -> Rotations:
        """Rotation cells from their :attr:`coordinates`, to the last bit; there may be others among them."""
        for kind in (YawRotations, QuaternionRotations):
            if all(name in coordinates for name in kind.COORDINATES):
                return kind.of_coordinates(coordinates)
        return OneRotation()

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of cells."""

    @abstractmethod
    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Cells that hold rotations: yaw angles (radians, any shape), or quaternions, shape (..., 4)."""

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

    @abstractmethod
    def cells_of(self, q: Floats) -> Ints:
        """Cells of configurations, shape (..., d + dof), of which only the last dof numbers count; shape (...)."""

    def leading(self, n: int) -> tuple[int, ...]:
        """First axes of an array that holds n grids: none where there is only ever one, otherwise (n,)."""
        return (n,)

    @abstractmethod
    def keep(self, shape: Symmetric) -> bool:
        """Whether all rotations of all cells map a robot to itself."""

    def check_dimension(self, dim: int) -> None:
        """Refuse robots of a dimension in which there are no such rotations.

        Raises
        ------
        InputError
            If it is one.
        """

    @abstractmethod
    def fewer(self, share: float) -> str:
        """What to pass instead to get at most a share of the cells, for messages."""

    @abstractmethod
    def slice_of(self, shape: Symmetric) -> Ints:
        """Number of the slice that each cell has for a robot, shape (count,).

        Cells whose rotations differ by one that maps the robot to itself share a slice. Slices are numbered from 0, in
        the order of the first cells that have them.
        """

    def of_slices(self, shape: Symmetric) -> Floats:
        """A rotation of each slice of a robot, as in a configuration, shape (slices, dof)."""
        return self.centers[np.unique(self.slice_of(shape), return_index=True)[1]]

    @abstractmethod
    def turns(self, dim: int) -> list[Turn]:
        """The cells as shapes in the plane or in space meet them."""

    @property
    @abstractmethod
    def centers(self) -> Floats:
        """The representative rotation of each cell, as a configuration has it, shape (count, dof)."""

    @property
    @abstractmethod
    def covering_angles(self) -> Floats:
        """Largest angle between a rotation of a cell and its representative, rounding included, shape (count,)."""

    @property
    @abstractmethod
    def coordinates(self) -> dict[str, Floats]:
        """Arrays that describe the cells, by their names in files; the first axis of each counts the cells."""

    @property
    @abstractmethod
    def volumes(self) -> Floats:
        """How much of all rotations each cell is, in any unit, shape (count,)."""

    def drawn(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Cells drawn by their volumes times ``shares``, shape (count,), of which one is above zero; shape (n,)."""
        sizes = shares * self.volumes
        return rng.choice(self.count, size=n, p=sizes / sizes.sum())

    @abstractmethod
    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """A rotation drawn uniformly from each of some cells, shape (n, dof); that part of a cell's border is left."""

    @abstractmethod
    def distances(self, q: Floats) -> Floats:
        """Angles between rotations of configurations, shape (..., d + dof), and each cell's representative, radians.

        Of shape (..., count).
        """

    def cells_within(self, q: Floats, angles: Floats) -> tuple[Ints, Ints]:
        """Every cell with a rotation within an angle, shape (n,), of that of a configuration, shape (n, d + dof).

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
    @abstractmethod
    def neighbors(self) -> Ints:
        """The cells that each one shares a border with, shape (count, n); -1 fills up."""

    def images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        """What turns or mirrors the world so that it maps cells of rotations to cells, for a robot.

        Let S and M be matrices of one 1 or -1 in each row and column, and M map the robot A to itself. Then S R A is S
        R M A for every rotation R, so that S makes the raster for S R M from that for R. Gives each S, shape (d, d),
        with the cell that each one becomes, shape (count,); the unit matrix among them.
        """
        return [(np.eye(len(shape.symmetries[0])), np.arange(self.count))]

    @abstractmethod
    def compiled(self, slice_of: Ints) -> CompiledRotations:
        """What compiled look-ups get."""

    @property
    def facts(self) -> dict[str, Any]:
        """What there is to say of the cells, for people: plain values by what they are."""
        width = float(np.degrees(2.0 * self.covering_angles.max()))
        return {"rotations": self.count, "rotation_cell_deg": round(width, 6)}

    @property
    def only(self) -> Floats | None:
        """The rotation of a robot that only translates, shape (0,); None of one that turns."""
        return None

    def about(self, rotation: Floats | None) -> str:
        """In words: the rotation cell that holds a rotation, or, where none is given, all of them."""
        angles = np.degrees(2.0 * self.covering_angles)
        if rotation is not None:
            return f"{self.text(rotation)}, in a rotation cell of {angles[self.cell_of(rotation)].item():.3g}°"
        width = f"{angles.min():.3g}°" + ("" if np.ptp(angles) < 1e-6 else f" to {angles.max():.3g}°")
        return f"over all rotations, {self.count} rotation cells of {width}"

    def __str__(self) -> str:
        return f"{self.count} rotations"


@dataclass(frozen=True, slots=True)
class OneRotation(Unturned, Rotations):
    """The one cell of a robot that only translates."""

    dof: ClassVar[int] = 0
    slack: ClassVar[float] = 0.0
    COORDINATES: ClassVar[tuple[str, ...]] = ()

    @property
    def count(self) -> int:
        return 1

    @property
    def facts(self) -> dict[str, Any]:
        return {}

    @property
    def only(self) -> Floats:
        return np.empty(0)

    def about(self, rotation: Floats | None) -> str:
        return ""

    def cell_of(self, rotation: ArrayLike = ()) -> Ints:
        return np.zeros((), dtype=np.int64)

    def cells_of(self, q: Floats) -> Ints:
        return np.zeros(q.shape[:-1], dtype=np.int64)

    def leading(self, n: int) -> tuple[int, ...]:
        return ()

    def keep(self, shape: Symmetric) -> bool:
        return True

    def fewer(self, share: float) -> str:
        return ""

    def slice_of(self, shape: Symmetric) -> Ints:
        return np.zeros(1, dtype=np.int64)

    def turns(self, dim: int) -> list[Turn]:
        return [STILL]

    @property
    def centers(self) -> Floats:
        return np.zeros((1, 0))

    @property
    def covering_angles(self) -> Floats:
        return np.zeros(1)

    @property
    def coordinates(self) -> dict[str, Floats]:
        return {}

    @property
    def volumes(self) -> Floats:
        return np.ones(1)

    def drawn(self, shares: Ints, n: int, rng: np.random.Generator) -> Ints:
        """Cell 0, without a draw."""
        return np.zeros(n, dtype=np.int64)

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        return np.zeros((len(cells), 0))

    def distances(self, q: Floats) -> Floats:
        return np.zeros((*q.shape[:-1], 1))

    @property
    def neighbors(self) -> Ints:
        return np.zeros((1, 0), dtype=np.int64)

    def compiled(self, slice_of: Ints) -> OneCell:
        return OneCell((0,))


@dataclass(frozen=True, slots=True)
class YawRotations(Yaw, Rotations):
    """Cells of yaw, for SE(2) in the plane and R^3 x SO(2) in space; cell ``k`` is ``[borders[k], borders[k + 1]]``.

    Attributes
    ----------
    borders : tuple of float, length n + 1
        Ascending, in radians; the last one is the first one plus a whole turn.
    """

    borders: tuple[float, ...]
    dof: ClassVar[int] = 1
    COORDINATES: ClassVar[tuple[str, ...]] = ("yaw", "yaw_bounds", "covering_angle")

    @classmethod
    def from_borders(cls, value: Any) -> YawRotations:
        """Cells from a count or from their borders, see :meth:`Rotations.of`."""
        if isinstance(value, bool) or np.ndim(value) == 0:
            mend = "pass e.g. 72, the cells' borders in radians, or Rotations.quaternions(8) for all rotations in space"
            count = whole(value, "rotations", 1, mend=mend)
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
        return len(self.borders) - 1

    @property
    def representatives(self) -> Floats:
        """Middle yaw of each cell, shape (n,)."""
        edges = np.asarray(self.borders)
        return np.asarray((edges[:-1] + edges[1:]) / 2)

    @property
    def covering_angles(self) -> Floats:
        return np.asarray(np.diff(self.borders) / 2 + YAW_SLACK)

    def is_uniform(self) -> bool:
        """Whether all cells are equally wide, but for rounding."""
        return bool(np.ptp(np.diff(self.borders)) < YAW_SLACK / self.count)

    def cell_of(self, yaw: ArrayLike) -> Ints:
        """Cells that hold yaw angles, radians, of any shape; a border belongs to the cell above it."""
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
        return self.cell_of(q[..., -1])

    def keep(self, shape: Symmetric) -> bool:
        """Whether it is round about the z axis."""
        return shape.symmetry == 0

    def fewer(self, share: float) -> str:
        return f"rotations={int(share * self.count)}" if share * self.count >= 1 else ""

    def slice_of(self, shape: Symmetric) -> Ints:
        """Cells a symmetry apart share a slice, where all cells are equally wide."""
        cells = np.arange(self.count, dtype=np.int64)
        if shape.symmetry == 0:
            return np.zeros_like(cells)
        if self.count % shape.symmetry == 0 and self.is_uniform():
            return cells % (self.count // shape.symmetry)
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
        return np.asarray(np.abs((self.representatives - q[..., -1:] + np.pi) % TURN - np.pi))

    def cells_within(self, q: Floats, angles: Floats) -> tuple[Ints, Ints]:
        """As of all rotations; found by the borders alone."""
        reach = np.minimum(angles + YAW_SLACK, math.pi)
        limits = q[:, -1] + np.stack([-reach, reach])
        turns = np.floor((limits - self.borders[0]) / TURN)
        within = np.searchsorted(self.borders, limits - turns * TURN, side="right") - 1
        low, high = (turns * self.count + np.clip(within, 0, self.count - 1)).astype(np.int64)
        counts = np.minimum(high - low + 1, self.count)
        rows = np.repeat(np.arange(len(q)), counts)
        steps = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        return rows, (low[rows] + steps) % self.count

    @property
    def neighbors(self) -> Ints:
        """The cell before each and the one after it; the last and the first are neighbours too."""
        steps = [[], [1], [-1, 1]][min(self.count - 1, 2)]
        return (np.arange(self.count)[:, None] + np.array(steps, dtype=np.int64)) % self.count

    def images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        """Of quarter turns about the z axis, and of mirrors along it, those that map the middles of cells to such."""
        if not self.is_uniform():
            return Rotations.images(self, shape)
        images: list[tuple[Floats, Ints]] = []
        for mirror in (1.0, -1.0):
            for own in shape.symmetries:
                (a, b), (c, d) = own[:2, :2].tolist()
                if a * d - b * c == mirror and (own[2:, 2:] == 1.0).all():
                    break
            else:
                continue
            # Another symmetry of the robot would give the same ones in another order.
            matrices = np.tile(np.eye(len(own)), (4, 1, 1))
            matrices[:, :2, :2] = _QUARTERS * (1.0, mirror)
            turns = np.arctan2(*(matrices[:, 1::-1, :2] @ own[:2, 0]).T)
            # Of a mirror and a turn, either may come first, if the turn is the other way.
            yaws = mirror * self.representatives + turns[:, None]
            cells = self.cell_of(yaws)
            off = np.abs(np.sin((yaws - self.representatives[cells]) / 2.0)).max(axis=1)
            images += [(matrices[k], cells[k]) for k in np.flatnonzero(off < YAW_SLACK / 8.0)]
        return images

    def compiled(self, slice_of: Ints) -> YawCells:
        return YawCells(np.array(self.borders), np.ascontiguousarray(slice_of))


@dataclass(frozen=True, slots=True)
class QuaternionRotations(Quaternion, Rotations):
    """Cells of quaternions, for SE(3); see :meth:`Rotations.quaternions`.

    A cell is numbered ``((c * n + i) * n + j) * n + k`` by the component c that is largest and the parts i, j and k of
    the quotients of the others, in the order x, y, z, w. A border belongs to the cell above it.

    Attributes
    ----------
    n : int
        Parts of an axis.
    """

    n: int
    dof: ClassVar[int] = 4
    COORDINATES: ClassVar[tuple[str, ...]] = ("quaternion", "covering_angle")

    @property
    def count(self) -> int:
        return 4 * self.n**3

    @property
    def borders(self) -> Floats:
        """Where quotients are cut, from -1 to 1, shape (n + 1,)."""
        return _chart(self.n).borders

    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Cells that hold quaternions (x, y, z, w), of norm 1 and of either sign, shape (..., 4)."""
        q = finite(rotation, "rotation")
        if q.ndim == 0 or q.shape[-1] != 4:
            rule = "a rotation in space is a quaternion, four numbers (x, y, z, w)"
            raise InputError("rotation", f"has shape {q.shape}", rule, "pass e.g. (0, 0, 0, 1)", value=rotation)
        wrong = np.abs((q * q).sum(axis=-1) - 1.0) > 2.0 * NORM_SLACK
        if wrong.any():
            norm = float(np.linalg.norm(q[wrong][0]))
            rule = f"a quaternion's norm must be 1, within {NORM_SLACK:g}"
            raise InputError("rotation", f"has a norm of {norm:.9g}", rule, "divide it by its norm", value=norm)
        largest = np.abs(q).argmax(axis=-1)  # the first of equals
        others = np.take_along_axis(q, np.asarray(OTHERS)[largest], axis=-1)
        quotients = others / np.take_along_axis(q, largest[..., None], axis=-1)
        parts = np.clip(np.searchsorted(self.borders, quotients, side="right") - 1, 0, self.n - 1)
        return np.asarray(largest * self.n**3 + parts @ np.array([self.n**2, self.n, 1]), dtype=np.int64)

    def cells_of(self, q: Floats) -> Ints:
        return self.cell_of(q[..., -4:])

    def check_dimension(self, dim: int) -> None:
        if dim == 2:
            rule, mend = "a robot in the plane turns by its yaw", "pass e.g. rotations=72"
            raise InputError("rotations", f"are {self}", rule, mend, value=self)

    def keep(self, shape: Symmetric) -> bool:
        """Whether it is a ball about its reference point."""
        return shape.is_round

    def fewer(self, share: float) -> str:
        n = int((share * self.count / 4.0) ** (1.0 / 3.0) + 1e-9)
        return f"Rotations.quaternions({n})" if n else ""

    def slice_of(self, shape: Symmetric) -> Ints:
        """Cells that a half turn of the robot, about one of its axes, maps to each other share a slice.

        In quaternions such a turn is a change of places and signs, and so maps cells to cells; a quarter turn is not.
        """
        if shape.is_round:
            return np.zeros(self.count, dtype=np.int64)
        least = np.arange(self.count)
        for matrix, cells in self.images(shape):
            if (matrix == np.eye(3)).all():
                least = np.minimum(least, least[cells])
        return np.unique(least, return_inverse=True)[1].astype(np.int64)

    def images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        """Of turns and mirrors, those that change places and signs in quaternions, and so map cells to cells.

        These are all where M puts the axes back that S permutes, whatever their signs.
        """
        known: dict[bytes, tuple[Floats, Floats]] = {}
        owns = np.array(shape.symmetries)
        for own in owns[np.argsort(-np.linalg.det(owns), kind="stable")]:
            # Two mirrors are two turns, each with the mirror of all three axes; the turns come first.
            turn = self.of_matrix(own * np.linalg.det(own))
            turns_back = product_of(np.eye(4), turn * (-1.0, -1.0, -1.0, 1.0))
            changes = np.round(product_of(product_of(turns_back[:, None], np.eye(4)), turn))
            for matrix, change in zip(_HALF_TURNS @ own.T, changes, strict=True):
                known.setdefault(change.tobytes(), (matrix, change))
        return [(matrix, self.cell_of(self.centers @ change)) for matrix, change in known.values()]

    def turns(self, dim: int) -> list[Turn]:
        matrices = self._matrices(self.centers, dim)
        return [Turn(matrix, a) for matrix, a in zip(matrices, self.covering_angles.tolist(), strict=True)]

    @property
    def centers(self) -> Floats:
        """The quaternion of the least covering angle in each cell."""
        return _chart(self.n).centers

    @property
    def covering_angles(self) -> Floats:
        """Of each cell, the angle between its middle and the farthest of its corners."""
        return _chart(self.n).covering_angles

    @property
    def coordinates(self) -> dict[str, Floats]:
        """The middle of each cell, shape (count, 4), and its covering angle, radians."""
        return dict(zip(self.COORDINATES, (self.centers, self.covering_angles), strict=True))

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> QuaternionRotations:
        """As many cells as there are middles."""
        return cls(max(1, round((len(coordinates["quaternion"]) / 4.0) ** (1.0 / 3.0))))

    @property
    def volumes(self) -> Floats:
        """Haar measure; 1 together."""
        return _chart(self.n).volumes

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Quaternions uniform in Haar measure over cells."""
        n, borders = self.n, self.borders
        parts = np.stack(np.unravel_index(cells, (4, n, n, n)), axis=-1)
        low, wide = borders[parts[:, 1:]], np.diff(borders)[parts[:, 1:]]
        # Quotients u have the density (1 + |u|^2)^-2, which is largest where a cell is nearest to zero.
        most = 1.0 + (np.maximum(np.maximum(low, -low - wide), 0.0) ** 2).sum(axis=1)
        quotients, missing = np.empty((len(cells), 3)), np.arange(len(cells))
        while len(missing):
            drawn = low[missing] + wide[missing] * rng.uniform(margin, 1.0 - margin, (len(missing), 3))
            accepted = rng.random(len(missing)) * (1.0 + (drawn**2).sum(axis=1)) ** 2 <= most[missing] ** 2
            quotients[missing[accepted]] = drawn[accepted]
            missing = missing[~accepted]
        return _quaternions(parts[:, 0], quotients)

    def distances(self, q: Floats) -> Floats:
        return np.asarray(2.0 * np.arccos(np.minimum(np.abs(q[..., -4:] @ self.centers.T), 1.0)))

    @property
    def neighbors(self) -> Ints:
        """The cells before and after each along the axes of its chart, in which that of another chart may lie."""
        n = self.n
        charts = np.indices((4, n, n, n)).reshape(4, -1)
        columns = []
        for axis in range(3):
            for way in (-1, 1):
                parts = charts.copy()
                parts[1 + axis] += way
                # Past a quotient of -1 or 1 that component is the largest, and all signs are those of the quotient.
                for c in range(4):
                    over = np.flatnonzero((charts[0] == c) & ((parts[1 + axis] < 0) | (parts[1 + axis] == n)))
                    place = dict(zip(OTHERS[c], charts[1:, over], strict=True))
                    largest = OTHERS[c][axis]
                    place[c] = place.pop(largest)
                    others = np.array([place[k] if way > 0 else n - 1 - place[k] for k in OTHERS[largest]])
                    others[OTHERS[largest].index(c)] = n - 1 if way > 0 else 0
                    parts[:, over] = [np.full(len(over), largest), *others]
                columns.append(np.ravel_multi_index(tuple(parts), (4, n, n, n)))
        return np.stack(columns, axis=1).astype(np.int64)

    def compiled(self, slice_of: Ints) -> QuaternionCells:
        return QuaternionCells(self.borders.copy(), np.ascontiguousarray(slice_of))

    def __str__(self) -> str:
        return f"{self.count} rotations in space"


class _Chart(NamedTuple):
    """What quaternion cells are, computed once for each n."""

    borders: Floats
    centers: Floats
    covering_angles: Floats
    volumes: Floats


@lru_cache(maxsize=4)
def _chart(n: int) -> _Chart:
    """The cells of n parts to an axis; first those of one chart, which are the same in all."""
    borders = np.tan(np.pi / 4.0 * np.linspace(-1.0, 1.0, n + 1))
    borders = (borders - borders[::-1]) / 2.0  # symmetric to the last bit
    borders[[0, -1]] = -1.0, 1.0
    parts = np.indices((n, n, n)).reshape(3, -1).T
    # A cell has the middle of its mirror image, and of itself with the axes in another order.
    mirrored = np.minimum(parts, n - 1 - parts)
    order = np.argsort(mirrored, axis=1, kind="stable")
    kinds, kind = np.unique(np.take_along_axis(mirrored, order, axis=1), axis=0, return_inverse=True)
    middles, least = _smallest_caps(borders[kinds[:, None] + _CORNERS])
    quotients = np.empty((n**3, 3))
    np.put_along_axis(quotients, order, middles[kind.ravel()], axis=1)
    quotients *= np.where(mirrored == parts, 1.0, -1.0)
    # Gauss-Legendre over the angles whose tangents the quotients are.
    nodes, weights = np.polynomial.legendre.leggauss(max(4, 4 + 24 // n))
    widths = np.pi / (2.0 * n)
    tangents = np.tan(-np.pi / 4.0 + widths * (np.arange(n)[:, None] + (nodes + 1.0) / 2.0)).ravel()
    by_axis = np.tile(weights, n) * (1.0 + tangents**2)
    shares = np.empty((n, n, n))
    cut = np.arange(n) * len(nodes)
    squares = 1.0 + (tangents**2)[:, None] + tangents**2
    for i in range(n):
        part = sum(
            by_axis[m] * (by_axis[:, None] * by_axis / (squares + tangents[m] ** 2) ** 2)
            for m in range(i * len(nodes), (i + 1) * len(nodes))
        )
        shares[i] = np.add.reduceat(np.add.reduceat(part, cut, axis=0), cut, axis=1)
    volumes = np.tile(shares.ravel() / (4.0 * shares.sum()), 4)
    charts = np.repeat(np.arange(4), n**3)
    made = borders, _quaternions(charts, np.tile(quotients, (4, 1))), np.tile(least[kind.ravel()], 4), volumes
    return _Chart(*map(frozen, made))


_CORNERS: Final = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)])


def _smallest_caps(boxes: Floats) -> tuple[Floats, Floats]:
    """The quotients of the rotation nearest to all of the corners of boxes, shape (m, 8, 3), and the covering angles.

    The smallest ball about the corners on the sphere has two to four of them on its border, and its middle in the
    direction of the point nearest to zero of all that is level with these. All choices of corners are tried.
    """
    corners = np.concatenate([boxes, np.ones((*boxes.shape[:2], 1))], axis=2)
    corners /= np.linalg.norm(corners, axis=2, keepdims=True)
    best, middle = np.full(len(boxes), -1.0), np.zeros((len(boxes), 4))
    for chosen in (chosen for size in (2, 3, 4) for chosen in combinations(range(8), size)):
        first, sides = corners[:, chosen[0]], corners[:, chosen[1:]] - corners[:, chosen[:1]]
        gram = sides @ sides.swapaxes(1, 2)
        flat = np.linalg.det(gram) <= 1e-9 * np.prod(np.diagonal(gram, axis1=1, axis2=2), axis=1)
        gram[flat] = np.eye(len(chosen) - 1)
        steps = np.linalg.solve(gram, -(sides @ first[..., None]))
        point = first + (steps * sides).sum(axis=1)
        point /= np.linalg.norm(point, axis=1, keepdims=True)
        cosine = (corners @ point[..., None]).min(axis=(1, 2))
        better = ~flat & (cosine > best)
        best[better], middle[better] = cosine[better], point[better]
    # The angle of a rotation is twice that of its quaternion; a step of the quotients is at least as long as its angle.
    angles = 2.0 * np.arccos(best) + 4.0 * QUOTIENT_SLACK
    return middle[:, :3] / middle[:, 3:], angles


def _quaternions(charts: Ints, quotients: Floats) -> Floats:
    """Unit quaternions, shape (n, 4), from their largest components, shape (n,), and quotients, shape (n, 3)."""
    made = np.ones((len(charts), 4))
    np.put_along_axis(made, np.asarray(OTHERS)[charts], quotients, axis=1)
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))

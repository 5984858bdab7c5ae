"""Yaw: cells of angles about the z axis, or about the origin of the plane."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats, Ints, Matrix, Numbers
from cspace.check import check_count, check_finite
from cspace.compiling import compilable
from cspace.errors import InputError
from cspace.rotations.base import (
    ANGLE_SLACK,
    COVERING_ANGLE,
    DIAL_STEPS,
    MAX_ANGLE,
    TWO_PI,
    Coordinate,
    Dial,
    RotationCell,
    Rotations,
    Symmetric,
    wrapped,
)

MAX_YAWS: Final = 2**16
"""Largest number of yaw cells, each 0.0055 degrees wide: at 100 m from the axis they are as wide as a cell of 1 cm."""

DIAL_HOLE: Final = 0.6
"""Inner radius of a ring of yaws; the outer one is 1."""

_QUARTERS: Final = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]], dtype=float)


@dataclass(frozen=True, repr=False)
class YawRotations(Rotations):
    """Cells of yaw, for SE(2) in the plane and R^3 x SO(2) in space; cell ``k`` is ``[borders[k], borders[k + 1]]``.

    Borders ascend over one turn, wherever it begins. A yaw that the library returns is in [-pi, pi).

    Attributes
    ----------
    borders : tuple of float, length n + 1
        Ascending, in radians; the last one is the first one plus a whole turn.
    """

    borders: tuple[float, ...]
    names = ("yaw",)
    units = ("rad",)
    about_z = True
    examples = ("90deg",)
    limits = f"a yaw at most {MAX_ANGLE:.0f} rad"
    COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "yaw": Coordinate("middle of a rotation cell, in [-pi, pi)", "rad", bounds="yaw_bounds"),
        "yaw_bounds": Coordinate("borders of a rotation cell, ascending over one turn", "rad", {"bound": 2}),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def of_value(cls, value: ArrayLike | None) -> YawRotations:
        """Cells from a count or from their borders, see :meth:`Rotations.of`."""
        if value is None or np.ndim(value) == 0:
            hint = "pass e.g. 72, the cells' borders in radians, or Rotations.quaternions(8) for all rotations in space"
            count = check_count(value, "rotations", 1, MAX_YAWS, hint)
            width = TWO_PI / count
            borders = [(k - 0.5) * width for k in range(count)]
        else:
            if np.size(value) > MAX_YAWS + 1:
                problem, rule = f"has {np.size(value)} borders", f"at most {MAX_YAWS} cells are taken"
                raise InputError("rotations", problem, rule, "pass fewer, e.g. 72 cells", value=value)
            angles = check_finite(value, "rotations")
            if angles.ndim != 1 or len(angles) < 2:
                rule, hint = "it must hold at least two borders", "pass e.g. 72, or numpy.linspace(0, 2 * numpy.pi, 73)"
                raise InputError("rotations", f"has shape {angles.shape}", rule, hint, value=value)
            if (np.diff(angles) <= 0).any() or abs(angles[0]) > TWO_PI:
                raise InputError(
                    "rotations",
                    "are borders that do not ascend, or begin more than a turn from zero",
                    "they must ascend, from one between -2 pi and 2 pi",
                    "sort them, in radians",
                    value=value,
                )
            if abs(angles[-1] - angles[0] - TWO_PI) > ANGLE_SLACK:
                raise InputError(
                    "rotations",
                    f"reach from {angles[0]:g} to {angles[-1]:g} rad",
                    f"they must cover the whole circle, 2 pi = {TWO_PI:.9f}",
                    "end with the first border plus 2 pi (numpy.radians turns degrees)",
                    value=value,
                )
            borders = angles[:-1].tolist()
        return cls((*borders, borders[0] + TWO_PI))

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> YawRotations:
        """Cells from the bounds among their coordinates."""
        bounds = coordinates["yaw_bounds"]
        return cls.of_value([*bounds[:, 0].tolist(), float(bounds[-1, 1])])

    def text(self, rotation: Floats) -> str:
        angle = (round(math.degrees(rotation[0]), 1) + 180.0) % 360.0 - 180.0
        return f"yaw {round(angle, 1) + 0.0:g}°"  # no minus sign before zero

    def of_matrix(self, matrix: Floats) -> Floats:
        return wrapped(np.arctan2(matrix[1, :1], matrix[0, :1]))

    def heading(self, q: Floats) -> float | None:
        return float(q[-1])

    def sample_near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        yaw = rotation[0] + (2.0 * next(numbers) - 1.0) * angle
        turned = math.remainder(yaw, TWO_PI)
        return (turned if turned < math.pi else -math.pi,)

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        if (np.abs(rotation) > MAX_ANGLE).any():
            largest = float(np.abs(rotation).max())
            rule = f"at most {MAX_ANGLE:.0f} can be wrapped exactly"
            raise InputError(name, f"has a yaw of {largest:g} rad", rule, "wrap it first", value=largest)
        return wrapped(rotation)

    def _between(self, first: Floats, second: Floats) -> Floats:
        apart = second - first
        return np.asarray(apart - TWO_PI * np.round(apart / TWO_PI))

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        return rotation + by

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        cos, sin = np.cos(rotation[..., 0]), np.sin(rotation[..., 0])
        made = np.zeros((*rotation.shape[:-1], dim, dim)) + np.eye(dim)
        made[..., 0, 0], made[..., 0, 1], made[..., 1, 0], made[..., 1, 1] = cos, -sin, sin, cos
        return made

    @property
    def count(self) -> int:
        return len(self.borders) - 1

    @property
    def representatives(self) -> Floats:
        """Middle yaw of each cell, in [-pi, pi), shape (n,)."""
        edges = np.asarray(self.borders)
        return wrapped((edges[:-1] + edges[1:]) / 2)

    @property
    def covering_angles(self) -> Floats:
        return np.asarray(np.diff(self.borders) / 2 + ANGLE_SLACK)

    def is_uniform(self) -> bool:
        """Whether all cells are equally wide, but for rounding, so that none is off its place by ANGLE_SLACK / 8."""
        return bool(np.ptp(np.diff(self.borders)) < ANGLE_SLACK / (8.0 * self.count))

    def cell_of(self, yaw: ArrayLike) -> Ints:
        """Cells that hold yaw angles, radians, of any shape; a border belongs to the cell above it."""
        angles = check_finite(yaw, "yaw")
        if (np.abs(angles) > MAX_ANGLE).any():
            largest = float(np.abs(angles).max())
            rule = f"at most {MAX_ANGLE:.0f} can be wrapped exactly"
            raise InputError("yaw", f"is {largest:g} rad", rule, "wrap it first", value=largest)
        # As the compiled look-ups wrap, to the last bit; a yaw within the borders stays as it is.
        wrapped = angles - np.floor((angles - self.borders[0]) / TWO_PI) * TWO_PI
        return np.clip(np.searchsorted(self.borders, wrapped, side="right") - 1, 0, self.count - 1).astype(np.int64)

    def cells_of(self, q: Floats) -> Ints:
        return self.cell_of(q[..., -1])

    def preserve(self, shape: Symmetric) -> bool:
        """Whether it is round about the z axis."""
        return shape.symmetry == 0

    def fewer(self, share: float) -> str:
        return f"rotations={int(share * self.count)}" if share * self.count >= 1 else ""

    def slices_for(self, shape: Symmetric) -> Ints:
        """Cells a symmetry apart share a slice, where all cells are equally wide."""
        cells = np.arange(self.count, dtype=np.int64)
        if shape.symmetry == 0:
            return np.zeros_like(cells)
        if self.count % shape.symmetry == 0 and self.is_uniform():
            return cells % (self.count // shape.symmetry)
        return cells

    def turns(self, dim: int) -> list[RotationCell]:
        """Rotations about the z axis, or about the origin of the plane."""
        made = []
        for yaw, angle in zip(self.representatives.tolist(), self.covering_angles.tolist(), strict=True):
            matrix = np.eye(dim)
            matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
            made.append(RotationCell(matrix, angle, about_z=True))
        return made

    @property
    def centers(self) -> Floats:
        """Middle yaw of each cell, in [-pi, pi), shape (n, 1)."""
        return self.representatives[:, None]

    @property
    def coordinates(self) -> dict[str, Floats]:
        """The middle and the borders of each cell, and its covering angle, radians."""
        bounds = np.stack([self.borders[:-1], self.borders[1:]], axis=1)
        return dict(zip(self.COORDINATES, (self.representatives, bounds, self.covering_angles), strict=True))

    @property
    def volumes(self) -> Floats:
        """The width of each cell, radians."""
        return np.diff(self.borders)

    def sample(self, cells: Ints, margin: float, rng: np.random.Generator) -> Floats:
        """Draw a yaw uniformly from each cell, in [-pi, pi)."""
        within = rng.uniform(margin, 1.0 - margin, len(cells))
        return wrapped(np.asarray(self.borders)[cells] + self.volumes[cells] * within)[:, None]

    def distances(self, q: Floats) -> Floats:
        return np.asarray(np.abs((self.representatives - q[..., -1:] + np.pi) % TWO_PI - np.pi))

    def cells_within(self, q: Floats, angles: Floats) -> tuple[Ints, Ints]:
        """As of all rotations; found by the borders alone."""
        reach = np.minimum(angles + ANGLE_SLACK, math.pi)
        limits = q[:, -1] + np.stack([-reach, reach])
        turns = np.floor((limits - self.borders[0]) / TWO_PI)
        within = np.searchsorted(self.borders, limits - turns * TWO_PI, side="right") - 1
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
            images += [(matrices[k], cells[k]) for k in np.flatnonzero(off < ANGLE_SLACK / 8.0)]
        return images

    def dials(self, x: Floats, y: Floats) -> list[Dial]:
        """A ring of yaws, from the x axis on, to the left."""
        inside = (np.hypot(x, y) <= 1.0) & (np.hypot(x, y) >= DIAL_HOLE)
        marks = [(f"{k * 45}°", k * np.pi / 4.0) for k in range(8)]
        around = tuple((label, 1.14 * float(np.cos(angle)), 1.14 * float(np.sin(angle))) for label, angle in marks)
        return [Dial("", inside, (np.arctan2(y, x)[inside] + DIAL_STEPS)[..., None], (("yaw", 0.0, 0.0), *around))]

    def compiled(self, slice_of: Ints) -> YawCells:
        return YawCells(np.array(self.borders), np.ascontiguousarray(slice_of))


@compilable
class YawCells(NamedTuple):
    """What compiled look-ups get of yaw cells.

    Where a walk may pass the last border, cells are counted on below 0 and above n, n of them to a turn.
    """

    borders: Floats
    slice_of: Ints

    def zeros(self) -> tuple[float]:
        return (self.borders[0],)

    def is_usable(self, q: Numbers) -> bool:
        return abs(q[-1]) <= MAX_ANGLE  # nor is NaN

    def states_at(self, q: Numbers) -> int:
        return int(self.slice_of[cell_of_wrapped(self.borders, in_turn(self.borders, q[-1]))])

    def slices_at(self, numbers: Floats, size: int, out: Ints) -> None:
        angles = np.empty(len(out))
        for k in range(len(out)):
            angles[k] = in_turn(self.borders, numbers[np.uint64(size * k + size - 1)])  # not counted from the end
        for k in range(len(out)):
            out[k] = self.slice_of[np.uint64(cell_of_wrapped(self.borders, angles[k]))]

    def slice_among(self, slices: Ints, k: int) -> int:
        return int(slices[k])

    def first_piece(self, q0: Numbers, q1: Numbers) -> tuple[float, float, float, int]:
        turn = shorter_turn(q0[-1], q1[-1])
        other = 0.0
        if math.pi - abs(turn) <= ANGLE_SLACK:  # both arcs are equally long but for rounding, and both are walked
            other = yaw_arc(q0, q1, 1)
        start = in_turn(self.borders, q0[-1])
        return start, turn, other, first_cell(self.borders, min(start, start + turn))

    def next_piece(
        self, cursor: tuple[float, float, float, int]
    ) -> tuple[bool, int, float, float, tuple[float, float, float, int]]:
        start, turn, other, cell = cursor
        k, low, high = widened(self.borders, cell)
        if low > max(start, start + turn) and other != 0.0:
            turn, other = other, 0.0
            cell = first_cell(self.borders, min(start, start + turn))
            k, low, high = widened(self.borders, cell)
        if low > max(start, start + turn):  # NaN is not, and fails where its position is looked at
            return False, 0, 0.0, 0.0, cursor
        a, b = share(low, high, start, turn)
        return True, self.slice_of[k], a, b, (start, turn, other, cell + 1)

    def first_around(self, q: Numbers, angle: float) -> tuple[float, int, int]:
        start, reach = in_turn(self.borders, q[-1]), min(angle, math.pi)
        return start + reach, first_cell(self.borders, start - reach), len(self.borders) - 1

    def next_around(self, cursor: tuple[float, int, int]) -> tuple[bool, int, tuple[float, int, int]]:
        most, cell, left = cursor
        k, low, _ = widened(self.borders, cell)
        return left > 0 and not low > most, self.slice_of[k], (most, cell + 1, left - 1)

    def arc_count(self, q0: Numbers, q1: Numbers) -> int:
        return 2 if math.pi - abs(yaw_arc(q0, q1, 0)) <= ANGLE_SLACK else 1

    def turn_of(self, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
        return abs(yaw_arc(q0, q1, arc)), 0.0

    def turned(self, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
        return (*q0[:-1], q0[-1] + t * yaw_arc(q0, q1, arc))

    def matrix_of(self, q: Numbers) -> Matrix:
        cosine, sine = math.cos(q[-1]), math.sin(q[-1])
        return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


@compilable
def in_turn(borders: Floats, yaw: float) -> float:
    """A yaw from the first border to the last, but for rounding."""
    return yaw - math.floor((yaw - float(borders[0])) / TWO_PI) * TWO_PI


@compilable
def cell_of_wrapped(borders: Floats, yaw: float) -> int:
    """Rotation cell of a wrapped yaw, a border belonging to the cell above it: guessed as if all were equally wide."""
    count = borders.shape[0] - 1
    guess = (yaw - borders[0]) * (count / TWO_PI)
    low = np.int64(guess) if 0.0 <= guess < count else 0
    if borders[np.uint64(low)] <= yaw < borders[np.uint64(low + 1)]:
        return int(low)
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if yaw >= borders[middle]:
            low = middle
        else:
            high = middle
    return low


@compilable
def first_cell(borders: Floats, least: float) -> int:
    """First cell, widened by ANGLE_SLACK, that holds an angle."""
    turns = math.floor((least - borders[0]) / TWO_PI)
    k = cell_of_wrapped(borders, in_turn(borders, least))
    on_border = least - (borders[k] + turns * TWO_PI) <= ANGLE_SLACK
    return int(k + turns * (borders.shape[0] - 1) - (1 if on_border else 0))


@compilable
def widened(borders: Floats, cell: int) -> tuple[int, float, float]:
    """A cell's own number, and its borders widened by ANGLE_SLACK."""
    count = borders.shape[0] - 1
    turns = math.floor(cell / count)
    k = cell - turns * count
    return k, borders[k] + turns * TWO_PI - ANGLE_SLACK, borders[k + 1] + turns * TWO_PI + ANGLE_SLACK


@compilable
def shorter_turn(first: float, second: float) -> float:
    """Signed angle from one yaw to another along the shorter arc, in [-pi, pi]."""
    turn = second - first
    turn -= math.floor(turn / TWO_PI) * TWO_PI
    return turn - TWO_PI if turn > math.pi else turn


@compilable
def share(low: float, high: float, start: float, turn: float) -> tuple[float, float]:
    """The parameters between which a turn from a yaw is between two angles."""
    if turn == 0.0:
        return 0.0, 1.0
    a = min(max((low - start) / turn, 0.0), 1.0)
    b = min(max((high - start) / turn, 0.0), 1.0)
    return min(a, b), max(a, b)


@compilable
def yaw_arc(q0: Numbers, q1: Numbers, arc: int) -> float:
    """Signed angle from one yaw to another along the shorter arc, or along the other one."""
    turn = shorter_turn(q0[-1], q1[-1])
    return turn if arc == 0 else (turn - TWO_PI if turn > 0.0 else turn + TWO_PI)

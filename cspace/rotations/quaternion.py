"""Quaternions: cells of all rotations in space."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats, Ints, Matrix, Numbers, frozen
from cspace.check import check_count, check_finite
from cspace.compiling import compilable
from cspace.errors import InputError
from cspace.rotations.base import COVERING_ANGLE, DIAL_STEPS, Coordinate, Dial, RotationCell, Rotations, Symmetric

NORM_SLACK: Final = 1e-6
"""How far the norm of a quaternion may be from 1."""

QUOTIENT_SLACK: Final = 1e-9
"""Rounding allowance in the quotients of a quaternion: its cells count as that much wider at each border."""

MAX_CUTS: Final = 64
"""Most cuts of an axis of quaternions: a million cells."""

OTHERS: Final = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
"""Of each component of a quaternion, the other ones."""

DIAL_HEADINGS: Final = (0, 60, 120, 180, 240, 300)
"""Degrees about z, one for each disc."""

_HALF_TURNS: Final = np.array([np.diag(signs) for signs in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))], float)
"""About x, y and z, and none at all: those by the quaternions of the unit matrix."""

QUARTER = math.pi / 4.0

EQUAL = 4e-9
"""Unit quaternions whose dot product is as near to 1 count as equal for OMPL, which then lets the rotation jump.

It takes 1e-9, of numbers whose norm it lets be off by as much.
"""

SHORT = 1e-9
"""Angle between two quaternions below which the chord between them is as good as the arc."""

Parts = tuple[int, int, int, int, int, int]
Walk = tuple[Numbers, Numbers, float, float, float, float, bool, bool, bool]
Look = tuple[Numbers, float, int, Parts, int, int, int]


@dataclass(frozen=True, repr=False)
class QuaternionRotations(Rotations):
    """Cells of quaternions, for SE(3); see :meth:`Rotations.quaternions`.

    A cell is numbered ``((c * n + i) * n + j) * n + k`` by the component c that is largest and the parts i, j and k of
    the quotients of the others, in the order x, y, z, w. A border belongs to the cell above it.

    Attributes
    ----------
    n : int
        Parts of an axis.
    """

    n: int
    names = ("qx", "qy", "qz", "qw")
    units = ("1",) * 4
    examples = ("0", "0", "0", "1")
    limits = "a quaternion (qx, qy, qz, qw) of norm 1"
    COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "quaternion": Coordinate("representative of a rotation cell, as (x, y, z, w)", "1", {"component": 4}),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def of_value(cls, value: ArrayLike | None) -> QuaternionRotations:
        """Cells from their number of parts of an axis, see :meth:`Rotations.quaternions`."""
        return cls(check_count(value, "rotations", 1, MAX_CUTS, "pass e.g. 8, for 2,048 cells of quaternions"))

    @classmethod
    def of_coordinates(cls, coordinates: Mapping[str, NDArray[Any]]) -> QuaternionRotations:
        """As many cells as there are middles."""
        return cls(max(1, round((len(coordinates["quaternion"]) / 4.0) ** (1.0 / 3.0))))

    def text(self, rotation: Floats) -> str:
        by = self._between(np.array([0.0, 0.0, 0.0, 1.0]), rotation)
        angle = float(np.linalg.norm(by))
        axis = ", ".join(f"{x + 0.0:.2g}" for x in np.round(by / max(angle, 1e-9), 2).tolist())
        degrees = f"{round(math.degrees(angle), 1):g}°"
        return f"turned {degrees} about ({axis})" if angle > 1e-9 else "not turned"

    def of_matrix(self, matrix: Floats) -> Floats:
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(matrix).as_quat())

    def sample_near(self, rotation: Sequence[float], angle: float, numbers: Iterator[float]) -> Sequence[float]:
        by = [(2.0 * next(numbers) - 1.0) * angle / math.sqrt(3.0) for _ in range(3)]
        turned: list[float] = self._turned(np.array(rotation), np.array(by)).tolist()
        return turned

    def _canonical(self, rotation: Floats, name: str) -> Floats:
        norms = np.linalg.norm(rotation, axis=-1, keepdims=True)
        off = np.abs(norms - 1.0)
        if not (off <= NORM_SLACK).all():
            worst = float(norms.reshape(-1)[np.argmax(off)])
            hint = "divide it by its norm; the order is qx, qy, qz, qw"
            raise InputError(name, f"has a quaternion of norm {worst:.9g}", "it must be 1", hint, value=worst)
        return np.where(off <= 4e-16, rotation, rotation / norms)

    def _between(self, first: Floats, second: Floats) -> Floats:
        cosine = (first * second).sum(axis=-1, keepdims=True)
        # Of the difference: nothing but zero where both are the same.
        nearer = np.where(cosine < 0.0, -second, second)
        apart = product_of(first * [-1.0, -1.0, -1.0, 1.0], nearer - first)[..., :3]
        sine = np.linalg.norm(apart, axis=-1, keepdims=True)
        angle = 2.0 * np.arctan2(sine, np.abs(cosine))
        return np.asarray(apart * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0))

    def _turned(self, rotation: Floats, by: Floats) -> Floats:
        half = np.linalg.norm(by, axis=-1, keepdims=True) / 2.0
        turned = product_of(rotation, np.concatenate([by * np.sinc(half / np.pi) / 2.0, np.cos(half)], axis=-1))
        return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))

    def _matrices(self, rotation: Floats, dim: int) -> Floats:
        x, y, z, w = np.moveaxis(rotation / np.linalg.norm(rotation, axis=-1, keepdims=True), -1, 0)
        rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    @property
    def count(self) -> int:
        return 4 * self.n**3

    @property
    def borders(self) -> Floats:
        """Where quotients are cut, from -1 to 1, shape (n + 1,)."""
        return _chart(self.n).borders

    def cell_of(self, rotation: ArrayLike) -> Ints:
        """Cells that hold quaternions (x, y, z, w), of norm 1 and of either sign, shape (..., 4)."""
        q = check_finite(rotation, "rotation")
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
            rule, hint = "a robot in the plane turns by its yaw", "pass e.g. rotations=72"
            raise InputError("rotations", f"are {self}", rule, hint, value=self)

    def preserve(self, shape: Symmetric) -> bool:
        """Whether it is a ball about its reference point."""
        return shape.is_round

    def fewer(self, share: float) -> str:
        n = int((share * self.count / 4.0) ** (1.0 / 3.0) + 1e-9)
        return f"rotations=Rotations.quaternions({n})" if n else ""

    def slices_for(self, shape: Symmetric) -> Ints:
        """Cells that a half turn of the robot, about one of its axes, maps to each other share a slice.

        In quaternions such a turn is a change of places and signs, and so maps cells to cells; a quarter turn is not.
        """
        if shape.is_round:
            return np.zeros(self.count, dtype=np.int64)
        least = np.arange(self.count)
        for matrix, change in self._changes(shape):
            if (matrix == np.eye(3)).all():
                least = np.minimum(least, least[self.cell_of(self.centers @ change)])
        return np.unique(least, return_inverse=True)[1].astype(np.int64)

    def images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        """Of turns and mirrors, those that change places and signs in quaternions, and so map cells to cells.

        These are all where M puts the axes back that S permutes, whatever their signs.
        """
        return [(matrix, self.cell_of(self.centers @ change)) for matrix, change in self._changes(shape)]

    def _changes(self, shape: Symmetric) -> Iterable[tuple[Floats, Floats]]:
        """What :meth:`images` does to matrices, and to quaternions."""
        owns = np.array(shape.symmetries)
        signs = np.linalg.det(owns)
        # Two mirrors are two turns, each with the mirror of all three axes; the turns come first.
        order = np.argsort(-signs, kind="stable")
        turns = self.of_matrix(owns[order] * signs[order, None, None])[:, None, None]
        turns_back = product_of(np.eye(4), turns * (-1.0, -1.0, -1.0, 1.0))
        changes = np.round(product_of(product_of(turns_back.swapaxes(1, 2), np.eye(4)), turns))
        matrices = _HALF_TURNS @ owns[order, None].swapaxes(-1, -2)
        known: dict[bytes, tuple[Floats, Floats]] = {}
        for matrix, change in zip(matrices.reshape(-1, 3, 3), changes.reshape(-1, 4, 4), strict=True):
            known.setdefault(change.tobytes(), (matrix, change))
        return known.values()

    def turns(self, dim: int) -> list[RotationCell]:
        matrices = self._matrices(self.centers, dim)
        return [RotationCell(matrix, a) for matrix, a in zip(matrices, self.covering_angles.tolist(), strict=True)]

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
            for step in (-1, 1):
                parts = charts.copy()
                parts[1 + axis] += step
                # Past a quotient of -1 or 1 that component is the largest, and all signs are those of the quotient.
                for c in range(4):
                    over = np.flatnonzero((charts[0] == c) & ((parts[1 + axis] < 0) | (parts[1 + axis] == n)))
                    place = dict(zip(OTHERS[c], charts[1:, over], strict=True))
                    largest = OTHERS[c][axis]
                    place[c] = place.pop(largest)
                    others = np.array([place[k] if step > 0 else n - 1 - place[k] for k in OTHERS[largest]])
                    others[OTHERS[largest].index(c)] = n - 1 if step > 0 else 0
                    parts[:, over] = [np.full(len(over), largest), *others]
                columns.append(np.ravel_multi_index(tuple(parts), (4, n, n, n)))
        return np.stack(columns, axis=1).astype(np.int64)

    def dials(self, x: Floats, y: Floats) -> list[Dial]:
        """Discs of tilts: after a turn about z, the robot is tipped over, by no turn in the middle up to half a one."""
        from scipy.spatial.transform import Rotation

        inside = np.hypot(x, y) <= 1.0
        tips = Rotation.from_rotvec(np.pi * np.column_stack([-y[inside], x[inside], np.zeros(inside.sum())])).as_quat()
        marks = (("upright", 0.0, 0.0), ("tipped to x", 0.6, 0.0), ("tipped to y", 0.0, 0.72))
        dials = []
        for degrees in DIAL_HEADINGS:
            turns = (np.radians(degrees) + DIAL_STEPS) * (0.0, 0.0, 1.0)
            rotations = np.array([self._turned(tips, turn) for turn in turns])
            dials.append(Dial(f"heading {degrees}°", inside, rotations, () if degrees else marks))
        return dials

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


def product_of(first: Floats, second: Floats) -> Floats:
    """Products of quaternions, shapes (..., 4): the second rotation about axes that the first has turned."""
    (x, y, z, w), (a, b, c, d) = np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)
    return np.stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ],
        axis=-1,
    )


@compilable
class QuaternionCells(NamedTuple):
    """What compiled look-ups get of quaternion cells: the borders along each axis of a chart, and the slices."""

    borders: Floats
    slice_of: Ints

    def zeros(self) -> tuple[float, float, float, float]:
        return (0.0, 0.0, 0.0, 0.0)

    def is_usable(self, q: Numbers) -> bool:
        return is_unit(q[-4:])

    def states_at(self, q: Numbers) -> int:
        chart, i, j, k = parts_of(self.borders, q[-4:])
        return int(self.slice_of[cell_of_parts(self.borders, chart, i, j, k)])

    def slices_at(self, numbers: Floats, size: int, out: Ints) -> None:
        borders = self.borders
        for m in range(len(out)):
            first = size * m + size - 4
            q = (numbers[first], numbers[first + 1], numbers[first + 2], numbers[first + 3])
            chart, i, j, k = parts_of(borders, q)
            out[m] = self.slice_of[np.uint64(cell_of_parts(borders, chart, i, j, k))]

    def slice_among(self, slices: Ints, k: int) -> int:
        return int(slices[k])

    def first_piece(self, q0: Numbers, q1: Numbers) -> Walk:
        a, b, _ = arc_endpoints(q0, q1, 0)
        return begin_arc(a, b, both_arcs(a, b))

    def next_piece(self, cursor: Walk) -> tuple[bool, int, float, float, Walk]:
        if not cursor[8]:
            if not cursor[6]:
                return False, 0, 0.0, 0.0, cursor
            cursor = begin_arc(cursor[0], normalised(cursor[1], -1.0), False)
        cell, start, stop, rest = next_part(self.borders, cursor)
        return True, self.slice_of[cell], start, stop, rest

    def first_around(self, q: Numbers, angle: float) -> Look:
        # A rotation's angle is twice that of its quaternion.
        reach = math.sin(min(angle / 2.0, 2.0 * QUARTER)) + QUOTIENT_SLACK
        return next_chart(self.borders, normalised(q[-4:], 1.0), reach, 0)

    def next_around(self, cursor: Look) -> tuple[bool, int, Look]:
        q, reach, chart, ranges, i, j, k = cursor
        while i > ranges[1]:
            if chart == 3:
                return False, 0, cursor
            q, reach, chart, ranges, i, j, k = next_chart(self.borders, q, reach, chart + 1)
        number = self.slice_of[cell_of_parts(self.borders, chart, i, j, k)]
        k += 1
        if k > ranges[5]:
            k = ranges[4]
            j += 1
        if j > ranges[3]:
            j = ranges[2]
            i += 1
        return True, number, (q, reach, chart, ranges, i, j, k)

    def arc_count(self, q0: Numbers, q1: Numbers) -> int:
        return 2 if both_arcs(normalised(q0[-4:], 1.0), normalised(q1[-4:], 1.0)) else 1

    def turn_of(self, q0: Numbers, q1: Numbers, arc: int) -> tuple[float, float]:
        # A rotation's angle is twice that of its quaternion.
        a, b, angle = arc_endpoints(q0, q1, arc)
        return 2.0 * angle, 2.0 * angle if begin_arc(a, b, False)[7] else 0.0

    def turned(self, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
        return q0[:-4] + slerp(q0, q1, arc, t)

    def matrix_of(self, q: Numbers) -> Matrix:
        x, y, z, w = normalised(q[-4:], 1.0)
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)),
        )


@compilable
def part_of(borders: Floats, quotient: float) -> int:
    """The part of an axis that holds a quotient, a border belonging to the part above it."""
    parts = borders.shape[0] - 1
    # The arc tangent to a few thousandths, which is enough of a guess.
    angle = quotient * (QUARTER + 0.273 * (1.0 - abs(quotient)))
    guess = (angle + QUARTER) * (parts / (2.0 * QUARTER))
    k = np.int64(guess) if 0.0 <= guess < parts else (0 if guess < 0.0 else parts - 1)
    while k > 0 and quotient < borders[np.uint64(k)]:
        k -= 1
    while k < parts - 1 and quotient >= borders[np.uint64(k + 1)]:
        k += 1
    return int(k)


@compilable
def chart_of(x: float, y: float, z: float, w: float) -> int:
    """The component of the largest modulus; the first of equals."""
    chart, most = 0, abs(x)
    if abs(y) > most:
        chart, most = 1, abs(y)
    if abs(z) > most:
        chart, most = 2, abs(z)
    return 3 if abs(w) > most else chart


@compilable
def split(q: Numbers, chart: int) -> tuple[float, float, float, float]:
    """A component of a quaternion, and the others in their order."""
    x, y, z, w = q
    if chart == 0:
        return x, y, z, w
    if chart == 1:
        return y, x, z, w
    if chart == 2:
        return z, x, y, w
    return w, x, y, z


@compilable
def parts_of(borders: Floats, q: Numbers) -> tuple[int, int, int, int]:
    """Chart of a quaternion, and the parts that hold its quotients there."""
    chart = chart_of(q[0], q[1], q[2], q[3])
    largest, a, b, c = split(q, chart)
    return chart, part_of(borders, a / largest), part_of(borders, b / largest), part_of(borders, c / largest)


@compilable
def cell_of_parts(borders: Floats, chart: int, i: int, j: int, k: int) -> int:
    """Number of a cell."""
    n = borders.shape[0] - 1
    return int(((chart * n + i) * n + j) * n + k)


@compilable
def is_unit(q: Numbers) -> bool:
    """Whether the norm of a quaternion is 1, but for what is normalised away."""
    return abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 2.0 * NORM_SLACK  # nor is NaN


@compilable
def normalised(q: Numbers, scale: float) -> Numbers:
    """A quaternion as long as a scale."""
    scale /= math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@compilable
def begin_arc(a: Numbers, b: Numbers, other: bool) -> Walk:
    """A walk from one unit quaternion to another, no farther than a right angle and a rounding error.

    SLERP turns evenly from a to b, and meets the chord between them at ``m + s d`` for s from -1 to 1, m the middle and
    d half of the way: at the time t with ``tan((2 t - 1) angle) = s tan(angle)``, ``angle`` being half of that between
    a and b. The chord is straight in every chart, and so it meets borders where linear functions of s are zero.
    """
    half, middle, dot = 0.0, 0.0, 0.0
    for n in range(4):
        half += (b[n] - a[n]) ** 2
        middle += (b[n] + a[n]) ** 2
        dot += a[n] * b[n]
    tangent = math.sqrt(half / middle)
    return a, b, 0.0, 0.0, tangent, math.atan(tangent), other, dot > 1.0 - EQUAL, True


@compilable
def arc_endpoints(q0: Numbers, q1: Numbers, arc: int) -> tuple[Numbers, Numbers, float]:
    """Unit quaternions between which SLERP goes along one of the shortest arcs, and the angle between them."""
    a, b = normalised(q0[-4:], 1.0), normalised(q1[-4:], 1.0)
    if (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0.0) != (arc == 1):
        b = normalised(b, -1.0)
    return a, b, 2.0 * begin_arc(a, b, False)[5]


@compilable
def both_arcs(a: Numbers, b: Numbers) -> bool:
    """Whether both arcs between two unit quaternions are equally long but for rounding: then both are walked."""
    return abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]) <= QUOTIENT_SLACK


@compilable
def leaving(
    share: float, largest: float, largest1: float, other: float, other1: float, low: float, high: float
) -> float:
    """How much of the way from one quaternion to another is in a part of an axis, widened, and no more than a share.

    Of both the largest component is given, which is above zero in the first, and another one.
    """
    for side in range(2):
        # Zero on the border, and below it inside.
        here = other - high * largest if side == 0 else low * largest - other
        there = other1 - high * largest1 if side == 0 else low * largest1 - other1
        if there > 0.0:
            share = min(share, here / (here - there))
    return share


@compilable
def next_part(borders: Floats, walk: Walk) -> tuple[int, float, float, Walk]:
    """The next cell of a walk, where the walk is in it, widened by QUOTIENT_SLACK, and the rest of the walk.

    What is farther than rounding from the cell that was left is in another one: there are as many cells as borders on
    the way, and no border is passed twice.
    """
    a, b, done, start, tangent, angle, other, equal, _ = walk
    q = (
        a[0] + done * (b[0] - a[0]),
        a[1] + done * (b[1] - a[1]),
        a[2] + done * (b[2] - a[2]),
        a[3] + done * (b[3] - a[3]),
    )
    chart, i, j, k = parts_of(borders, q)
    p, p1 = split(q, chart), split(b, chart)
    sign = math.copysign(1.0, p[0])
    share, parts = 1.0, (i, j, k)
    for n in range(3):
        low, high = borders[parts[n]] - QUOTIENT_SLACK, borders[parts[n] + 1] + QUOTIENT_SLACK
        share = leaving(share, sign * p[0], sign * p1[0], sign * p[n + 1], sign * p1[n + 1], low, high)
    more, stop = share < 1.0, 1.0
    if more:
        done += (1.0 - done) * share
        stop = min(max(0.5 + 0.5 * math.atan((2.0 * done - 1.0) * tangent) / angle, start), 1.0)
    if not tangent < 2.0:  # nor is NaN, with which the position then fails
        start = stop = math.nan
    cell = cell_of_parts(borders, chart, i, j, k)
    rest = (a, b, done, stop, tangent, angle, other, equal, more)
    return (cell, 0.0, 1.0, rest) if equal else (cell, start, stop, rest)


@compilable
def parts_around(borders: Floats, largest: float, other: float, reach: float) -> tuple[int, int]:
    """First and last part of an axis that the quaternions near one may be in; the first above the last if none.

    Those within an angle whose sine is ``reach``, of which two components are given. The quotient is u on a plane
    through zero, and that is within reach where ``r |sin(atan u - atan(other / largest))| <= reach``, r the length of
    the two components.
    """
    last, length = borders.shape[0] - 2, math.hypot(largest, other)
    if not reach < length:
        return 0, last
    middle = math.atan(other / largest) if largest != 0.0 else 2.0 * QUARTER
    swing = math.asin(reach / length) + 2.0 * QUOTIENT_SLACK
    if middle - swing <= -3.0 * QUARTER or middle + swing >= 3.0 * QUARTER:  # past the other end as well
        return 0, last
    low, high = max(middle - swing, -QUARTER), min(middle + swing, QUARTER)
    if low > high:
        return 0, -1
    return part_of(borders, math.tan(low) - QUOTIENT_SLACK), part_of(borders, math.tan(high) + QUOTIENT_SLACK)


@compilable
def next_chart(borders: Floats, q: Numbers, reach: float, chart: int) -> Look:
    """Begin with the cells of a chart."""
    largest, a, b, c = split(q, chart)
    i, i1 = parts_around(borders, largest, a, reach)
    j, j1 = parts_around(borders, largest, b, reach)
    k, k1 = parts_around(borders, largest, c, reach)
    if j > j1 or k > k1:
        i1 = i - 1
    return q, reach, chart, (i, i1, j, j1, k, k1), i, j, k


@compilable
def slerp(q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    """The unit quaternion at t."""
    a, b, angle = arc_endpoints(q0, q1, arc)
    first, second = 1.0 - t, t
    if angle > SHORT:
        first, second = math.sin(first * angle), math.sin(second * angle)
    q = (
        first * a[0] + second * b[0],
        first * a[1] + second * b[1],
        first * a[2] + second * b[2],
        first * a[3] + second * b[3],
    )
    return normalised(q, 1.0)

"""What every shape of a robot or an obstacle offers, and shapes known by an outer and an inner shape."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from itertools import permutations, product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints, Surface
from cspace.errors import GeometryError, InputError
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import NO_ROTATION, RotationCell

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class Pieces(NamedTuple):
    """A border as a union of points, segments or triangles, each grown by a radius.

    Attributes
    ----------
    simplices : ndarray of float64, shape (n, k, d)
        Points (k = 1), segments (2) or triangles (3), metres.
    radii : ndarray of float64, shape (n,)
        Metres.
    """

    simplices: Floats
    radii: Floats


class Boxes(NamedTuple):
    """Boxes along the axes.

    Attributes
    ----------
    lows, highs : ndarray of float64, shape (n, d)
        Their corners, metres.
    sizes : ndarray of float64, shape (n,)
        Lower bound of the length, along some axis, of the body that each of them belongs to, metres.
    """

    lows: Floats
    highs: Floats
    sizes: Floats


class Shape(ABC):
    """A rigid, closed, bounded set of points in the plane or in space, metres.

    A shape is known exactly (:class:`ExactShape`), or only by two exact shapes: :attr:`outer` contains it and
    :attr:`inner` lies in it. Area, bounds, border and the like belong to exact shapes, so that every caller names the
    one it needs: ``shape.outer.bounds`` contain the shape, ``shape.inner.measure`` is at most its area or volume.

    Robots are given in a frame whose origin is their reference point, obstacles in that of the map.

    Attributes
    ----------
    dim : int
        2 in the plane, 3 in space.
    shown : bool
        Whether pictures show it, and the obstacles that it is held against.
    """

    dim: int
    shown: bool = True

    @property
    @abstractmethod
    def outer(self) -> ExactShape:
        """An exact shape that contains this one; itself if it is exact."""

    @property
    @abstractmethod
    def inner(self) -> ExactShape:
        """An exact shape that lies in this one; itself if it is exact."""

    @property
    def span(self) -> float:
        """Largest modulus of the numbers that the shape was computed from, metres."""
        return max(self.outer.span, self.inner.span)

    @property
    def place(self) -> str:
        """ "the plane" or "space", for people."""
        return ("the plane", "space")[self.dim - 2]

    @abstractmethod
    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """The shape as a robot: the offsets that it meets, and those that lie in it.

        Parameters
        ----------
        spacing : float
            Side of the map's cells, ``h``, metres.
        margin : float
            Metres by which the shape is grown, on the outer side only.
        rotation : RotationCell
            The rotations for which the rasters are to hold.

        Returns
        -------
        outer : Raster
            Every offset ``m`` for which the grown shape meets ``h * (m + [-1, 1]^d)`` at some rotation of the cell.
        inner : Raster
            Only offsets ``m`` for which ``h * m`` lies in the shape at all of them.

        Raises InputError if the shape is too many cells large, or so far from its reference point that rounding could
        reach the certificate's slack.
        """

    @abstractmethod
    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """The shape as an obstacle: the cells that it meets, and those that lie in it.

        Parameters
        ----------
        grid : Grid
            Of the shape's dimension. What lies outside it is clipped.

        Returns
        -------
        outer, inner : ndarray of bool, shape grid.shape

        Raises InputError if the shape is so far from the grid that rounding could reach the certificate's slack.
        """

    def flattened(self) -> Shape:
        """The shape that this one casts on the plane of x and y; itself, of a shape in the plane."""
        return self

    @property
    def is_round(self) -> bool:
        """Whether every rotation about the origin maps the shape to itself."""
        return False

    @property
    def is_round_about_z(self) -> bool:
        """Whether every rotation about the z axis maps the shape to itself; in the plane, every rotation."""
        return self.is_round

    @cached_property
    def symmetries(self) -> list[Floats]:
        """The matrices, shape (dim, dim), of one 1 or -1 in each row and column that map the shape to itself."""
        matrices, bounds = _signed_permutations(self.dim), np.array(self.outer.bounds)
        corners = np.sort(bounds @ matrices.mT, axis=1)
        return [matrix for matrix in matrices[(corners == bounds).all(axis=(1, 2))] if self.is_same(matrix)]

    @cached_property
    def symmetry(self) -> int:
        """How many turns about the z axis in a circle map the shape to itself: 1, 2 or 4, or 0 for all turns."""
        if self.is_round_about_z:
            return 0
        turns = (each for each in self.symmetries if (each[2:, 2:] == 1.0).all())
        return sum(each[0, 0] * each[1, 1] - each[0, 1] * each[1, 0] == 1.0 for each in turns)

    def check_origin(self, warn: bool = False) -> None:  # noqa: B027 - most shapes have nothing to refuse
        """Refuse a robot whose reference point, its origin, can hardly be meant; with ``warn``, warn of a doubtful one.

        Only meshes, which are drawn elsewhere, are checked; others are placed by their numbers.

        Raises GeometryError if it lies too far off.
        """

    def is_same(self, matrix: Floats) -> bool:
        """Whether a matrix, shape (dim, dim), maps the shape to itself, to the last bit."""
        if not (matrix == np.sign(matrix)).all():
            return False
        return np.array_equal(self._own_features, ordered_rows(self._features(matrix) + 0.0)[0])

    @cached_property
    def _own_features(self) -> Floats:
        return ordered_rows(self._features(np.eye(self.dim)) + 0.0)[0]

    @abstractmethod
    def _features(self, matrix: Floats) -> Floats:
        """Rows of numbers that identify the shape turned by a matrix of entries -1, 0 and 1."""

    @property
    @abstractmethod
    def spec(self) -> dict[str, object]:
        """Plain numbers, strings and lists from which ``cspace.shapes.shape_from_spec`` makes it again."""


class ExactShape(Shape):
    """A shape that its own numbers define, so that its area, bounds and border are known.

    Attributes
    ----------
    encloses : bool
        Whether it has an inside, that is, more than its boundary.
    is_boxes : bool
        Whether it is a union of boxes along the axes in space.
    """

    encloses: bool = True
    is_boxes: bool = False

    @property
    def outer(self) -> ExactShape:
        return self

    @property
    def inner(self) -> ExactShape:
        return self

    @property
    @abstractmethod
    def span(self) -> float: ...

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (dim,) each."""

    @property
    @abstractmethod
    def measure(self) -> float:
        """Area in the plane, volume in space, for people; NaN where it is not known."""

    @property
    def _facts(self) -> dict[str, object]:
        """What there is to say of the shape, for people: plain values by what they are."""
        return {("area_m2", "volume_m3")[self.dim - 2]: self.measure}

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle around the origin in a shape in the plane, metres; 0 if the origin is outside.

        Right within rounding; of several discs together, a lower bound.
        """
        import shapely

        outline, origin = self.outline, shapely.Point(0.0, 0.0)
        return float(shapely.distance(outline.boundary, origin)) if shapely.covers(outline, origin) else 0.0

    @abstractmethod
    def contains(self, points: ArrayLike) -> Bools:
        """Whether points lie in the shape, for points farther from its border than rounding.

        Parameters
        ----------
        points : array-like, shape (..., dim)
            Metres.

        Returns
        -------
        ndarray of bool, shape (...)

        Raises InputError if the last axis is not ``dim`` long, or a value is not finite.
        """

    @abstractmethod
    def boundary(self) -> Pieces:
        """The border, for exact tests; parts of it that lie within the shape may be among its pieces."""

    @property
    def boxes(self) -> Boxes:
        """A shape that :attr:`is_boxes`, as boxes along the axes."""
        raise GeometryError(
            "shape", "is no union of boxes", "boxes and cells in space are", "ask for its boundary", value=self
        )

    @property
    def regions(self) -> list[Floats]:
        """What a shape in the plane fills, part by part: segments, shape (E, 4); by even-odd parity a point lies in it.

        A shape in space has none, and neither has one of balls.
        """
        simplices = self.boundary().simplices
        return [simplices.reshape(-1, 4)] if simplices.shape[1:] == (2, 2) else []

    @property
    def outline(self) -> BaseGeometry:
        """A shape in the plane as a shapely geometry, for drawing."""
        raise GeometryError(
            "shape", "is in space", "an outline needs one in the plane", "ask for its surface", value=self
        )

    @property
    def surface(self) -> Surface:
        """A shape in space as vertices and triangles, for drawing."""
        raise GeometryError(
            "shape", "is in the plane", "a surface needs one in space", "ask for its outline", value=self
        )


@cache
def _signed_permutations(dim: int) -> Floats:
    """All matrices of one 1 or -1 in each row and column, shape (n, dim, dim)."""
    orders, signs = permutations(np.eye(dim)), product((1.0, -1.0), repeat=dim)
    return np.array([np.array(sign)[:, None] * order for order, sign in product(orders, signs)])


def ordered_rows(rows: NDArray[Any]) -> tuple[NDArray[Any], Ints]:
    """The different rows of an array, shape (n, k), in order, and the number of each one among them, shape (n,)."""
    order = np.lexsort(rows.T[::-1])
    rows = rows[order]
    fresh = np.append(True, (rows[1:] != rows[:-1]).any(axis=1))[: len(rows)]
    numbers = np.empty(len(rows), dtype=np.int64)
    numbers[order] = np.cumsum(fresh) - 1
    return rows[fresh], numbers


SIDES: Final = 64
"""Sides of the polygons that stand for circles: their radii differ by 0.12 % from those that they touch."""

_WIDER: Final = 1.0 / math.cos(math.pi / SIDES)
"""Radius of a polygon's corners where the sides touch a circle of radius 1."""

_ROUNDING: Final = 2.0**-40
"""By how much of itself a solid around another one is larger than it need be, for its corners are rounded."""

_BLURRED: Final = 2.0**-20
"""Largest part of itself by which an ellipse's polygons may be larger or smaller to allow for rounding."""

_QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""

Pair = tuple[Surface, Surface]
"""Two surfaces, the first of which encloses a solid that encloses the second."""


class BoundedShape(Shape):
    """A shape that is known only by an exact shape around it and an exact shape within it.

    FREE is proven for the outer shape and BLOCKED for the inner one, so that both hold for the shape itself. Exact
    answers prove only FREE, for the outer shape; drawings show the outer shape.

    Parameters
    ----------
    outer, inner : ExactShape
        Of the same dimension; ``outer`` contains the shape, which contains ``inner``.
    is_round_about_z : bool
        Whether every rotation about the z axis maps the shape to itself, even if it does not so map the bounds.
    """

    def __init__(self, outer: ExactShape, inner: ExactShape, is_round_about_z: bool = False) -> None:
        self._outer, self._inner, self.dim = outer, inner, outer.dim
        self._turns = is_round_about_z

    @property
    def outer(self) -> ExactShape:
        return self._outer

    @property
    def inner(self) -> ExactShape:
        return self._inner

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        return self.outer.rasters(spacing, margin, rotation)[0], self.inner.rasters(spacing, 0.0, rotation)[1]

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        return self.outer.cells(grid)[0], self.inner.cells(grid)[1]

    @property
    def is_round(self) -> bool:
        return self.dim == 2 and self._turns

    @property
    def is_round_about_z(self) -> bool:
        return self._turns

    def _features(self, matrix: Floats) -> Floats:
        rows = [side._features(matrix) for side in (self.outer, self.inner)]
        return np.concatenate([np.insert(part, 0, number, axis=1) for number, part in enumerate(rows)])

    def flattened(self) -> Shape:
        return BoundedShape(self.outer.flattened().outer, self.inner.flattened().inner, self._turns)

    @property
    def spec(self) -> dict[str, object]:
        sides = {"outer": self.outer.spec, "inner": self.inner.spec}
        return {"kind": "bounded", **sides, "is_round_about_z": self._turns}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any], of: Callable[[Mapping[str, Any]], Shape]) -> BoundedShape:
        """Make the shape of a :attr:`spec`; ``of`` makes its two exact shapes."""
        return cls(of(spec["outer"]).outer, of(spec["inner"]).inner, bool(spec["is_round_about_z"]))


def cylinder_bounds(radius: float, height: float) -> Pair:
    """A cylinder around the z axis with its middle in the origin, metres: a surface around it and one within."""
    profile = np.array([(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)]) * (radius, height)
    return _revolved(profile * (_WIDER, 1.0) * (1.0 + _ROUNDING)), _revolved(profile * (1.0 - _ROUNDING))


def cone_bounds(radius: float, height: float) -> Pair:
    """Return a surface around a cone, and one within it, metres.

    The cone stands upright around the z axis, tip up; the origin is halfway up.
    """
    profile = np.array([(0.0, -0.5), (1.0, -0.5), (0.0, 0.5)]) * (radius, height)
    return _revolved(profile * (_WIDER, 1.0) * (1.0 + _ROUNDING)), _revolved(profile * (1.0 - _ROUNDING))


def capsule_bounds(radius: float, length: float) -> Pair:
    """All within ``radius`` of a segment of the z axis with its middle in the origin; a ball, where it has no length.

    Gives a surface around it and one within, metres.
    """
    angle = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arc[-1, 0] = 0.0

    def profile(factor: float) -> Floats:
        upper = factor * arc + (0.0, length / 2.0)
        return np.concatenate([upper[::-1] * (1.0, -1.0), upper[0 if length else 1 :]])

    # The polygon of the arc touches it from outside, as that of each of its circles does.
    outer = profile(_WIDER) * (_WIDER, 1.0)
    return _revolved(outer * (1.0 + _ROUNDING)), _revolved(profile(1.0) * (1.0 - _ROUNDING))


def ellipse_bounds(radii: tuple[float, float], center: Floats) -> tuple[Floats, Floats]:
    """Return the corners of a polygon around an ellipse and of one within it, shape (SIDES, 2) each, metres.

    ``radii`` are the semi-axes along x and y. Scaled along the axes to a circle of radius 1, the corners lie on circles
    whose radii leave room for the rounding of corners, also at a center far from the origin.

    Raises InputError if the center is so far from the origin that rounding blurs the ellipse.
    """
    slack = _ROUNDING + 2.0**-50 * float((1.0 + np.abs(center) / radii).max())
    if slack > _BLURRED:
        rule = f"at most {_BLURRED * 2.0**50:.1g} times the radius along each axis keeps its shape in floating point"
        raise InputError("center", f"is {tuple(center.tolist())}", rule, "check the units (metres)", value=center)
    ring = _ring() * radii
    return center + _WIDER * (1.0 + slack) * ring, center + (1.0 - slack) * ring


def _ring() -> Floats:
    """Return the corners of a polygon in the unit circle, shape (SIDES, 2); quarter turns map it to itself exactly."""
    angle = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    cosines = np.append(np.cos(angle)[:-1], 0.0)
    quarter = np.stack([cosines, cosines[::-1]], axis=1)[:-1]
    return np.concatenate([np.stack([quarter @ (c, -s), quarter @ (s, c)], axis=1) for c, s in _QUARTERS])


def _revolved(profile: Floats) -> Surface:
    """The surface that a polygon makes about the z axis, with as many sides as there are to stand for a circle.

    Quarter turns about the axis map it to itself to the last bit; so do half turns about the others, where the profile
    is its own mirror image. That is, for each corner, shape (n, 2), its distance from the axis and its height, from the
    lowest to the highest, which are on the axis.
    """
    ring = _ring()
    rings = [np.insert(radius * ring, 2, height, axis=1) for radius, height in profile[1:-1].tolist()]
    poles = np.array([(0.0, 0.0, profile[0, 1]), (0.0, 0.0, profile[-1, 1])])
    first, count = np.arange(SIDES), SIDES * len(rings)
    second = (first + 1) % SIDES
    faces: list[tuple[ArrayLike, ...]] = [
        (count, second, first),
        (count + 1, first + count - SIDES, second + count - SIDES),
    ]
    for low in range(0, count - SIDES, SIDES):
        above = low + SIDES
        faces += [(low + first, low + second, above + second), (low + first, above + second, above + first)]
    triangles = [np.stack(np.broadcast_arrays(*corners), axis=1) for corners in faces]
    return np.concatenate([*rings, poles]), np.concatenate(triangles)

"""Shape: what every kind of robot and obstacle can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cache, cached_property
from itertools import permutations, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints, Surface
from cspace.errors import GeometryError
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import STILL, Turn

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
    def rasters(self, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
        """The shape as a robot: the offsets that it meets, and those that lie in it.

        Parameters
        ----------
        spacing : float
            Side of the map's cells, ``h``, metres.
        margin : float
            Metres by which the shape is grown, on the outer side only.
        turn : Turn
            The rotations for which the rasters are to hold.

        Returns
        -------
        outer : Raster
            Every offset ``m`` for which the grown shape meets ``h * (m + [-1, 1]^d)`` at some rotation of the turn.
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
    def facts(self) -> dict[str, object]:
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

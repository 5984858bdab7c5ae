"""Base classes of shapes, and shapes between two bounds."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache, cached_property
from itertools import permutations, product
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._grid import Grid
from cspace._raster import Raster
from cspace._raster.bitmaps import QUARTER_TURNS
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._support.arrays import Bools, Floats, Ints, Surface
from cspace._support.reporting import format_sides
from cspace.errors import GeometryError, InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class RoundedSimplices(NamedTuple):
    """Points, segments or triangles of a boundary, each grown by a radius.

    Attributes
    ----------
    simplices : ndarray of float64, shape (n, k, d)
        Points (k = 1), segments (2) or triangles (3), metres.
    radii : ndarray of float64, shape (n,)
        Radii, at least zero, metres.
    """

    simplices: Floats
    radii: Floats


class Boxes(NamedTuple):
    """Axis-aligned boxes, each around a part of a body.

    Attributes
    ----------
    lows, highs : ndarray of float64, shape (n, d)
        Lower and upper corners, metres.
    sizes : ndarray of float64, shape (n,)
        Lower bound, metres, on the longest axis-parallel extent of the body that contains each box.
    """

    lows: Floats
    highs: Floats
    sizes: Floats


class Shape(ABC):
    """A rigid, closed, bounded set of points; metres.

    A shape is known exactly (:class:`ExactShape`), or by two exact shapes: :attr:`outer` contains
    it and :attr:`inner` lies in it. Area, bounds and boundary belong to exact shapes, so that every
    caller names the shape it needs: ``shape.outer.bounds`` contain the shape,
    ``shape.inner.measure`` is at most its area or volume.

    The origin of a robot's frame is its reference point; obstacles are in the frame of the map.

    Attributes
    ----------
    dim : int
        2 in the plane, 3 in space.
    shown : bool
        True if pictures show the shape, and the obstacles with it.
    """

    dim: int
    shown: bool = True
    kind: ClassVar[str]
    """Name of the class in its :attr:`spec`."""

    KINDS: ClassVar[dict[str, type[Shape]]] = {}
    """Classes of shapes by kind."""

    def __init_subclass__(cls) -> None:
        """Add the class to :attr:`KINDS`, by its kind."""
        if "kind" in vars(cls):
            Shape.KINDS[cls.kind] = cls

    def __repr__(self) -> str:
        """Return the class, and the sides of the box around the shape."""
        return f"{type(self).__name__}({format_sides(np.ptp(self.outer.bounds, axis=0))})"

    @property
    @abstractmethod
    def outer(self) -> ExactShape:
        """Exact shape that contains this one; itself if it is exact."""

    @property
    @abstractmethod
    def inner(self) -> ExactShape:
        """Exact shape that lies in this one; itself if it is exact."""

    @property
    def span(self) -> float:
        """Largest modulus of the numbers that define the shape, metres."""
        return max(self.outer.span, self.inner.span)

    @property
    def place(self) -> str:
        """Name of its space: "the plane" or "space"."""
        return ("the plane", "space")[self.dim - 2]

    @abstractmethod
    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the rasters of the shape as a robot.

        Parameters
        ----------
        spacing : float
            Side ``h`` of the map's cells, metres.
        margin : float
            Growth of the outer shape, metres.
        rotation : RotationCell
            Rotations for which the rasters hold.

        Returns
        -------
        outer : Raster
            Every offset ``m`` for which the grown shape touches ``h * (m + [-1, 1]^d)`` at some
            rotation of the cell.
        inner : Raster
            Only offsets ``m`` for which ``h * m`` lies in the shape at all rotations of the cell.

        Raises InputError if the shape has too many cells, or lies so far from its reference point
        that rounding could exceed the certificate's slack.
        """

    @abstractmethod
    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the cells of the shape as an obstacle.

        The outer cells touch the shape, the inner cells lie in it.

        Parameters
        ----------
        grid : Grid
            Of the same dimension. The shape is clipped to it.

        Returns
        -------
        outer, inner : ndarray of bool, shape grid.shape

        Raises InputError if the shape lies so far from the grid that rounding could exceed the
        certificate's slack.
        """

    def project_to_plane(self) -> Shape:
        """Project the shape onto the xy plane.

        A shape in the plane is returned unchanged.
        """
        return self

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above.

        Parameters
        ----------
        low, high : float
            Heights, metres, farther apart than twice the slack.
        slack : float
            Rounding allowance of heights, metres. What only touches a height counts for the outer
            shape, and not for the inner one.

        Returns
        -------
        outer, inner : ExactShape or None
            Plane shapes outside and inside the part's shadow; None where there is none.

        Raises GeometryError for a shape in the plane, and InputError for a mesh whose inside
        depends on the spacing.
        """
        raise GeometryError("shape", "is in the plane", "a shape in space has heights")

    @property
    def is_round(self) -> bool:
        """True if every rotation about the origin maps the shape to itself."""
        return False

    @property
    def is_round_about_z(self) -> bool:
        """True if every rotation about z maps the shape to itself.

        In the plane, that is every rotation.
        """
        return self.is_round

    @cached_property
    def symmetries(self) -> list[Floats]:
        """Signed permutation matrices, shape (dim, dim), that map the shape to itself."""
        # Few matrices keep the bounding box, which is tested quickly.
        matrices = _signed_permutations(self.dim)
        bounds = np.array(self.outer.bounds)
        mapped_bounds = np.sort(bounds @ np.swapaxes(matrices, 1, 2), axis=1)
        keeps_bounds = (mapped_bounds == bounds).all(axis=(1, 2))
        return [matrix for matrix in matrices[keeps_bounds] if self.is_same(matrix)]

    @cached_property
    def symmetry(self) -> int:
        """Order of rotational symmetry about z: 1, 2 or 4.

        It is 0 if all angles map the shape to itself.
        """
        if self.is_round_about_z:
            return 0
        # Count the turns about z among the symmetries; mirrors have the determinant -1.
        order = 0
        for matrix in self.symmetries:
            keeps_z = bool((matrix[2:, 2:] == 1.0).all())
            (a, b), (c, d) = matrix[:2, :2].tolist()
            is_turn = keeps_z and a * d - b * c == 1.0
            order += is_turn
        return order

    def check_origin(self, warn: bool = False) -> None:  # noqa: B027 - most shapes have nothing to refuse
        """Raise GeometryError if a mesh is too far from its origin.

        A robot's origin is its reference point. With `warn`, warn of a doubtful one. Only meshes
        are checked, because other shapes are placed by their numbers.
        """

    def is_same(self, matrix: Floats) -> bool:
        """Return True if a matrix maps the shape to itself exactly.

        The matrix has shape (dim, dim).
        """
        if not (matrix == np.sign(matrix)).all():
            return False
        return np.array_equal(self._features, self._sort_features(matrix))

    @cached_property
    def _features(self) -> Floats:
        """Sorted rows that identify the shape."""
        return self._sort_features(np.eye(self.dim))

    def _sort_features(self, matrix: Floats) -> Floats:
        """Return the sorted rows that identify the shape after a linear map."""
        rows, _ = unique_rows(self.transform_features(matrix) + 0.0)  # -0 becomes 0
        return rows

    @abstractmethod
    def transform_features(self, matrix: Floats) -> Floats:
        """Return rows of numbers that identify the shape after a linear map.

        The entries of its ``matrix`` are -1, 0 and 1.
        """

    @property
    def lever(self) -> float:
        """Distance, metres, that no point of the shape exceeds from the z axis."""
        corner = np.abs(self.outer.bounds).max(axis=0)[:2]
        # Rounding may make a lever smaller.
        return float(np.hypot(*corner)) * (1.0 + 1e-9)

    @property
    @abstractmethod
    def spec(self) -> dict[str, object]:
        """Plain values from which ``cspace._shapes.shape_from_spec`` makes the shape again."""

    @classmethod
    @abstractmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Shape:
        """Make the shape of a :attr:`spec`."""


class ExactShape(Shape):
    """A shape defined exactly by its own numbers.

    Its area, bounds and boundary are known.

    Attributes
    ----------
    is_boxes : bool
        True for a union of boxes along the axes in space.
    """

    is_boxes: bool = False

    @property
    def encloses(self) -> bool:
        """True if the shape has an interior."""
        return True

    @property
    def outer(self) -> ExactShape:
        """The shape itself."""
        return self

    @property
    def inner(self) -> ExactShape:
        """The shape itself."""
        return self

    def with_inner(self, inner: ExactShape, is_round_about_z: bool = False) -> BoundedShape:
        """Return a shape of which this one is the outer and ``inner`` the inner bound.

        The parameters are those of :class:`BoundedShape`.
        """
        return BoundedShape(self, inner, is_round_about_z)

    @property
    @abstractmethod
    def span(self) -> float:
        """Largest modulus of the numbers that define the shape, metres."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (dim,) each."""

    @property
    @abstractmethod
    def measure(self) -> float:
        """Area in the plane, volume in space, for reports; NaN if unknown."""

    @property
    def facts(self) -> dict[str, object]:
        """Plain values about the shape, by name, for reports."""
        return {("area_m2", "volume_m3")[self.dim - 2]: self.measure}

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle around the origin, metres.

        It is 0 if the origin is outside the plane shape. It is accurate within rounding; for
        several discs it is a lower bound.
        """
        import shapely

        outline = self.outline
        origin = shapely.Point(0.0, 0.0)
        if not shapely.covers(outline, origin):
            return 0.0
        return float(shapely.distance(outline.boundary, origin))

    @abstractmethod
    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the shape.

        It holds for points farther from the boundary than rounding.

        Parameters
        ----------
        points : array-like, shape (..., dim)
            Metres.

        Returns
        -------
        ndarray of bool, shape (...)

        Raises InputError if the last axis is not `dim` long, or a value is not finite.
        """

    @abstractmethod
    def boundary(self) -> RoundedSimplices:
        """Return the boundary for exact tests, perhaps with inner pieces."""

    @property
    def boxes(self) -> Boxes:
        """Boxes along the axes that make up the shape, if :attr:`is_boxes`."""
        problem = "is not a union of boxes"
        rule = "only boxes and cells in space are"
        raise GeometryError("shape", problem, rule)

    @property
    def filled_boundaries(self) -> list[Floats]:
        """Boundary segments of a plane shape's filled parts.

        They are ``(x0, y0, x1, y1)``, shape (E, 4), and enclose the part by even-odd parity. The
        list is empty for a shape in space or of balls.
        """
        simplices = self.boundary().simplices
        return [simplices.reshape(-1, 4)] if simplices.shape[1:] == (2, 2) else []

    @property
    def outline(self) -> BaseGeometry:
        """A plane shape as a shapely geometry, for drawing."""
        rule = "an outline needs a shape in the plane"
        raise GeometryError("shape", "is in space", rule)

    @property
    def surface(self) -> Surface:
        """Shape in space as vertices and triangles, for drawing."""
        rule = "a surface needs a shape in space"
        raise GeometryError("shape", "is in the plane", rule)


def clip_to_half_space(
    simplices: Floats, axis: int, wall: float, sign: float, slack: float
) -> Floats:
    """Clip segments or triangles to one side of a wall.

    The side is that of ``sign * (coordinate - wall) >= 0`` along the axis. ``simplices`` have shape
    (n, corners, d), with two or three corners. Those beyond by more than ``slack`` are dropped.
    """
    corners = simplices.shape[1]
    heights = sign * (simplices[:, :, axis] - wall)
    is_above = heights >= -slack
    corners_above = is_above.sum(axis=1)
    clipped = [simplices[corners_above == corners]]
    for count in range(1, corners):
        cut = np.flatnonzero(corners_above == count)
        # Rotate the corners so that the only corner on its side of the wall comes first.
        alone = np.argmax(is_above[cut] == (count == 1), axis=1)
        order = (alone[:, None] + np.arange(corners)) % corners
        first, *others = np.moveaxis(simplices[cut[:, None], order], 1, 0)
        first_height, *other_heights = np.moveaxis(heights[cut[:, None], order], 1, 0)
        # Where the edges from that corner cross the wall.
        crossings = []
        for other, other_height in zip(others, other_heights, strict=True):
            # A corner beyond the wall by less than the slack counts as on the wall.
            fraction = np.clip(first_height / (first_height - other_height), 0.0, 1.0)
            crossing = first + fraction[:, None] * (other - first)
            crossing[:, axis] = wall
            crossings.append(crossing)
        if count == 1:
            clipped.append(np.stack([first, *crossings], axis=1))
        else:
            # What is left of the triangle (a, b, c) is a quadrilateral: two triangles.
            ab, ac = crossings
            b, c = others
            clipped.append(np.stack([ab, b, c], axis=1))
            clipped.append(np.stack([ab, c, ac], axis=1))
    return np.concatenate(clipped)


@cache
def _signed_permutations(dim: int) -> Floats:
    """Return all signed permutation matrices, shape (n, dim, dim)."""
    permutation_matrices = permutations(np.eye(dim))
    sign_matrices = [np.diag(signs) for signs in product((1.0, -1.0), repeat=dim)]
    pairs = product(permutation_matrices, sign_matrices)
    return np.array([signs @ np.array(permutation) for permutation, signs in pairs])


def unique_rows(rows: NDArray[Any]) -> tuple[NDArray[Any], Ints]:
    """Return the sorted unique rows, and the index of each row.

    `rows` has shape (n, k), the indices (n,).
    """
    last_column_first = rows.T[::-1]  # as lexsort expects
    order = np.lexsort(last_column_first)
    # Equal rows follow each other now; the first one of them is new.
    rows = rows[order]
    is_new = np.ones(len(rows), dtype=np.bool_)
    is_new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    numbers = np.empty(len(rows), dtype=np.int64)
    numbers[order] = np.cumsum(is_new) - 1
    return rows[is_new], numbers


CIRCLE_SIDES: Final = 64
"""Number of sides of the polygons that approximate circles; the radii differ by 0.12 %."""

_CORNER_RADIUS: Final = 1.0 / math.cos(math.pi / CIRCLE_SIDES)
"""Radius of the corners of a regular polygon whose sides touch the unit circle."""

_BOUND_SLACK: Final = 2.0**-40
"""Relative growth of an outer bound, and shrinkage of an inner one, that covers the rounding of
corners."""

Slab: TypeAlias = tuple["ExactShape | None", "ExactShape | None"]
"""Plane shapes outside and inside a part between two heights, seen from above."""

BoundsPair = tuple[Surface, Surface]
"""An outer and an inner surface; the outer solid contains the inner one."""


class BoundedShape(Shape):
    """A shape between an outer and an inner exact shape.

    FREE is proven for the outer shape and BLOCKED for the inner shape, so both hold for the shape
    itself. Exact queries prove only FREE, with the outer shape; drawings show the outer shape.

    Parameters
    ----------
    outer, inner : ExactShape
        Of the same dimension; ``outer`` contains the shape, which contains ``inner``.
    is_round_about_z : bool
        True if every rotation about the z axis maps the shape to itself, even if not its bounds.
    """

    kind = "bounded"

    def __init__(
        self, outer: ExactShape, inner: ExactShape, is_round_about_z: bool = False
    ) -> None:
        """Keep both bounds."""
        self._outer = outer
        self._inner = inner
        self.dim = outer.dim
        self._is_round_about_z = is_round_about_z

    @property
    def outer(self) -> ExactShape:
        """Exact shape that contains this one."""
        return self._outer

    @property
    def inner(self) -> ExactShape:
        """Exact shape that lies in this one."""
        return self._inner

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see ``Shape.rasters``."""
        outer, _ = self.outer.rasters(spacing, margin, rotation)
        _, inner = self.inner.rasters(spacing, 0.0, rotation)
        return outer, inner

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see ``Shape.cells``."""
        outer, _ = self.outer.cells(grid)
        _, inner = self.inner.cells(grid)
        return outer, inner

    @property
    def is_round(self) -> bool:
        """True for a disc in the plane."""
        return self.dim == 2 and self._is_round_about_z

    @property
    def is_round_about_z(self) -> bool:
        """True if every rotation about z maps the shape to itself."""
        return self._is_round_about_z

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed rows; see ``Shape.transform_features``."""
        # The first column tells the bounds apart.
        outer_rows = np.insert(self.outer.transform_features(matrix), 0, 0, axis=1)
        inner_rows = np.insert(self.inner.transform_features(matrix), 0, 1, axis=1)
        return np.concatenate([outer_rows, inner_rows])

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``."""
        outer, _ = self.outer.slab(low, high, slack)
        _, inner = self.inner.slab(low, high, slack)
        return outer, inner

    def project_to_plane(self) -> Shape:
        """Project both bounds onto the xy plane."""
        return BoundedShape(
            self.outer.project_to_plane().outer,
            self.inner.project_to_plane().inner,
            self._is_round_about_z,
        )

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        bounds = {"outer": self.outer.spec, "inner": self.inner.spec}
        return {"kind": self.kind, **bounds, "is_round_about_z": self._is_round_about_z}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> BoundedShape:
        """Make the shape of a :attr:`spec`."""
        outer, inner = (
            Shape.KINDS[bound["kind"]].from_spec(bound) for bound in (spec["outer"], spec["inner"])
        )
        return cls(outer.outer, inner.inner, bool(spec["is_round_about_z"]))


def cylinder_bounds(radius: float, height: float) -> BoundsPair:
    """Return an outer and an inner surface of a cylinder, metres.

    Its axis is the z axis, with the origin halfway up.
    """
    # Corners (distance from the axis, height), from the bottom up.
    profile = np.array([(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)]) * (radius, height)
    return _revolve_bounds(profile * (_CORNER_RADIUS, 1.0), profile)


def capsule_bounds(radius: float, length: float) -> BoundsPair:
    """Return an outer and an inner surface of a capsule, metres.

    The capsule is centered at the origin; `length` is the length of its cylinder, and 0 for a ball.
    """
    # A quarter circle from the equator to the pole, as (distance from the axis, height).
    angle = np.linspace(0.0, math.pi / 2.0, CIRCLE_SIDES // 4 + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arc[-1, 0] = 0.0  # the pole lies on the axis, in spite of rounding

    def make_profile(factor: float) -> Floats:
        upper = factor * arc + (0.0, length / 2.0)
        lower = upper[::-1] * (1.0, -1.0)
        if length == 0.0:
            upper = upper[1:]  # the halves of a ball share the corner at the equator
        return np.concatenate([lower, upper])

    # The polygon of the arc touches the arc from outside, like the polygons of its circles.
    outer = make_profile(_CORNER_RADIUS) * (_CORNER_RADIUS, 1.0)
    return _revolve_bounds(outer, make_profile(1.0))


def _revolve_bounds(outer: Floats, inner: Floats) -> BoundsPair:
    """Revolve an outer and an inner profile, with slack for rounding."""
    return _revolve(outer * (1.0 + _BOUND_SLACK)), _revolve(inner * (1.0 - _BOUND_SLACK))


def ellipse_bounds(radii: tuple[float, float], center: Floats) -> tuple[Floats, Floats]:
    """Return an outer and an inner polygon of an ellipse, metres.

    Both have shape (CIRCLE_SIDES, 2). `radii` are the semi-axes along x and y. If the axes are
    scaled to make the ellipse a unit circle, the corners lie on circles whose radii allow for the
    rounding of corners, also far from the origin.

    Raises InputError if the center is so far from the origin that rounding blurs the ellipse.
    """
    # A corner is rounded in proportion to its distance from the origin, measured in radii.
    slack = _BOUND_SLACK + 2.0**-50 * float((1.0 + np.abs(center) / radii).max())
    # Maximum relative growth of an ellipse's bounds that covers rounding.
    max_ellipse_slack = 2.0**-20
    if slack > max_ellipse_slack:
        problem = f"is {tuple(center.tolist())}"
        max_ratio = max_ellipse_slack * 2.0**50
        rule = f"it may be at most {max_ratio:.1g} times the radius along each axis"
        raise InputError("center", problem, rule)
    ring = _make_unit_polygon() * radii
    outer = center + _CORNER_RADIUS * (1.0 + slack) * ring
    inner = center + (1.0 - slack) * ring
    return outer, inner


def _make_unit_polygon() -> Floats:
    """Return a regular polygon inscribed in the unit circle, shape (CIRCLE_SIDES, 2).

    Quarter turns map it to itself exactly.
    """
    angles = np.linspace(0.0, math.pi / 2.0, CIRCLE_SIDES // 4 + 1)
    cosines = np.cos(angles)
    cosines[-1] = 0.0  # exactly, so that the sines mirror the cosines
    sines = cosines[::-1]
    # The last angle begins the next quarter.
    x = cosines[:-1]
    y = sines[:-1]
    quarters = [np.stack([c * x - s * y, s * x + c * y], axis=1) for c, s in QUARTER_TURNS]
    return np.concatenate(quarters)


def _revolve(profile: Floats) -> Surface:
    """Revolve a profile about z, in `CIRCLE_SIDES` steps.

    `profile`, shape (n, 2), holds the distance of each corner from the axis and its height, from
    the lowest corner to the highest, which lie on the axis. Quarter turns about the axis map the
    surface to itself, bit for bit. So do half turns about the other axes if the profile is its own
    mirror image.
    """
    ring = _make_unit_polygon()
    (_, lowest), *inner_corners, (_, highest) = profile.tolist()
    rings = [np.insert(radius * ring, 2, height, axis=1) for radius, height in inner_corners]
    poles = np.array([(0.0, 0.0, lowest), (0.0, 0.0, highest)])
    # Vertices are numbered ring by ring, from the bottom; the poles come last.
    lower_pole = CIRCLE_SIDES * len(rings)
    upper_pole = lower_pole + 1
    first = np.arange(CIRCLE_SIDES)
    second = (first + 1) % CIRCLE_SIDES
    top_ring = lower_pole - CIRCLE_SIDES
    faces: list[tuple[ArrayLike, ...]] = [
        (lower_pole, second, first),
        (upper_pole, top_ring + first, top_ring + second),
    ]
    # Two triangles for each side, between a ring and the next one above.
    for low in range(0, top_ring, CIRCLE_SIDES):
        high = low + CIRCLE_SIDES
        faces.append((low + first, low + second, high + second))
        faces.append((low + first, high + second, high + first))
    triangles = [np.stack(np.broadcast_arrays(*corners), axis=1) for corners in faces]
    return np.concatenate([*rings, poles]), np.concatenate(triangles)

"""Balls: discs, balls in space, and points."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from cspace._grid import Grid
from cspace._raster import Raster
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.shape import ExactShape, RoundedSimplices, Slab
from cspace._support.arrays import AXES, Bools, Floats, Surface, frozen
from cspace._support.check import check_finite, check_points, select_positions
from cspace.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


_DISC_SIDES: Final = 128
"""Number of sides of the polygons that approximate discs in drawings."""

_POLYGON_AREA_RATIO: Final = _DISC_SIDES / 2 * math.sin(2 * math.pi / _DISC_SIDES) / math.pi
"""Area of a regular polygon of `_DISC_SIDES` sides, relative to its circumscribed disc."""


@runtime_checkable
class BallSet(Protocol):
    """A decomposition into balls."""

    @property
    def centers(self) -> Floats:
        """Centers, shape (n, dim), metres."""
        ...

    @property
    def radii(self) -> Floats:
        """Radii, shape (n,), metres."""
        ...


class Balls(ExactShape):
    """A union of balls.

    `centers` has shape (n, dim), and `radii`, at least zero, has shape (n,); metres.
    """

    kind = "balls"

    def __init__(self, centers: Floats, radii: Floats) -> None:
        """Keep the balls, and make their arrays read-only."""
        self.centers = frozen(centers)
        self.radii = frozen(radii)
        self.dim = centers.shape[1]

    @classmethod
    def of(
        cls,
        centers: ArrayLike | BallSet,
        radii: ArrayLike | None = None,
        names: tuple[str, str] = ("centers", "radii"),
    ) -> Balls:
        """Make balls from centers and radii, or from a decomposition; metres.

        `centers` has shape (n, dim); `radii` has shape (n,), or is one number, or None for a
        decomposition. `names` are the caller's arguments, for messages.

        Raises InputError if there is no ball, the shapes do not match, a value is not finite, or a
        radius is negative.
        """
        return cls(*check_balls(centers, radii, names))

    @property
    def noun(self) -> str:
        """Word for one ball: "disc" in the plane, "ball" in space."""
        return ("disc", "ball")[self.dim - 2]

    @property
    def encloses(self) -> bool:
        """True if a ball has a positive radius."""
        return bool((self.radii > 0.0).any())

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, metres."""
        return float((np.abs(self.centers).max(axis=1) + self.radii).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (dim,) each."""
        reach = self.radii[:, None]
        return (self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)

    @property
    def measure(self) -> float:
        """Area, or volume, of the union.

        In space it is NaN for several balls.
        """
        if self.dim == 2:
            return float(self.outline.area) / _POLYGON_AREA_RATIO
        if len(self.radii) > 1:
            return math.nan
        return float(4.0 / 3.0 * np.pi * self.radii[0] ** 3)

    @property
    def inscribed_radius(self) -> float:
        """Radius of a circle around the origin inside the discs, metres.

        It is a lower bound of the largest one.
        """
        # The polygons of the outline can give less than a single disc around the origin does.
        radii_around_origin = self.radii - np.linalg.norm(self.centers, axis=1)
        return max(super().inscribed_radius, float(radii_around_origin.max()))

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see ``Shape.rasters``."""
        from cspace._raster.rounded_boxes import RoundedBoxes, rounded_rasters

        growth = rotation.displacement(self.centers)
        centers = rotation.apply(self.centers)
        balls = RoundedBoxes(centers, centers, self.radii)
        return rounded_rasters(balls, spacing, margin + growth, growth)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see ``Shape.cells``."""
        from cspace._raster.rounded_boxes import RoundedBoxes, rounded_cells

        return rounded_cells(RoundedBoxes(self.centers, self.centers, self.radii), grid)

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the shape; see ``ExactShape.contains``."""
        from scipy.spatial import cKDTree

        array = check_points(points, "points", AXES[: self.dim])
        inside = np.zeros(array.shape[:-1], dtype=np.bool_)
        # For balls of one radius, the nearest center decides.
        for radius in np.unique(self.radii):
            centers = self.centers[self.radii == radius]
            distances, _ = cKDTree(centers).query(array)
            inside |= distances <= radius
        return inside

    def boundary(self) -> RoundedSimplices:
        """Return the centers, grown by the radii."""
        return RoundedSimplices(self.centers[:, None], self.radii)

    @property
    def outline(self) -> BaseGeometry:
        """Discs as a shapely geometry, for drawing."""
        if self.dim == 3:
            return super().outline
        import shapely

        points = shapely.points(self.centers)
        discs = shapely.buffer(points, self.radii, quad_segs=_DISC_SIDES // 4)  # a quarter's sides
        return shapely.union_all(discs)

    @property
    def surface(self) -> Surface:
        """Balls as vertices and triangles, for drawing."""
        if self.dim == 2:
            return super().surface
        import trimesh

        # Many balls are drawn coarsely: 80 triangles each instead of 1,280.
        subdivisions = 3 if len(self.radii) < 64 else 1
        ball = trimesh.creation.icosphere(subdivisions=subdivisions)
        corners = np.asarray(ball.vertices)
        corners_of_balls = self.centers[:, None] + self.radii[:, None, None] * corners
        # The corners of a ball are numbered after those of the balls before it.
        first_corners = len(corners) * np.arange(len(self.radii))
        faces_of_balls = np.asarray(ball.faces, dtype=np.int64) + first_corners[:, None, None]
        return corners_of_balls.reshape(-1, 3), faces_of_balls.reshape(-1, 3)

    def project_to_plane(self) -> Balls:
        """Project the balls onto the xy plane."""
        return Balls(self.centers[:, :2].copy(), self.radii)

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``."""
        discs = []
        heights = self.centers[:, 2]
        for room in (slack, -slack):
            gaps = np.maximum(np.maximum(low - room - heights, heights - high - room), 0.0)
            meets = gaps <= self.radii
            radii = np.sqrt((self.radii + gaps) * (self.radii - gaps), where=meets, out=gaps)
            discs.append(Balls(self.centers[meets, :2], radii[meets]) if meets.any() else None)
        return discs[0], discs[1]

    @property
    def is_round(self) -> bool:
        """True if all centers are at the origin."""
        return not self.centers.any()

    @property
    def is_round_about_z(self) -> bool:
        """True if all centers are on the z axis."""
        return not self.centers[:, :2].any()

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed rows; see ``Shape.transform_features``."""
        return np.column_stack([self.centers @ matrix.T, self.radii])

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        return {"kind": self.kind, "centers": self.centers.tolist(), "radii": self.radii.tolist()}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Balls:
        """Make the balls of a :attr:`spec`."""
        return cls.of(spec["centers"], spec["radii"])


class OriginPoint(Balls):
    """The origin, the robot in the joint space of an arm.

    A point inside a cell touches no other cell. So the workspace must mark every cell that
    obstacles touch, even if only on the cell's boundary. Then the map equals the workspace, cell
    for cell.
    """

    kind = "point"
    shown = False

    @classmethod
    def at_origin(cls, dim: int) -> OriginPoint:
        """Make the origin of the plane or of space."""
        return cls(np.zeros((1, dim)), np.zeros(1))

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster: without a margin, one cell."""
        if margin > 0.0:
            return super().rasters(spacing, margin, rotation)
        cell = Raster.from_bitmap(np.ones((1,) * self.dim, dtype=np.bool_), (0,) * self.dim)
        return cell, cell

    @property
    def outline(self) -> BaseGeometry:
        """The origin as a degenerate polygon, for drawing."""
        if self.dim == 3:
            return super().outline
        import shapely

        return shapely.Polygon(np.zeros((4, 2)))

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        return {"kind": self.kind, "dim": self.dim}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> OriginPoint:
        """Make the point of a :attr:`spec`."""
        return cls.at_origin(int(spec["dim"]))


def check_balls(
    centers: ArrayLike | BallSet,
    radii: ArrayLike | None,
    names: tuple[str, str] = ("centers", "radii"),
) -> tuple[Floats, Floats]:
    """Check centers and radii of balls; return copies.

    Centers have shape (n, 2) or (n, 3), radii (n,).

    Raises InputError as :meth:`Balls.of`.
    """
    name, radii_name = names
    if isinstance(centers, BallSet):
        if radii is not None:
            problem = "is given besides a decomposition"
            rule = "a decomposition has its own"
            raise InputError(radii_name, problem, rule)
        radii = centers.radii
        centers = centers.centers
    elif radii is None:
        rule = "balls need one number, or one per center"
        raise InputError(radii_name, "is missing", rule)
    # From here on, the radii are given: one for all balls, or one for each.
    points = check_finite(select_positions(centers, name), name)
    sizes = check_finite(radii, radii_name)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        problem = f"has shape {points.shape}"
        rule = "it must be (n, 2) or (n, 3) with n at least 1"
        raise InputError(name, problem, rule)
    if sizes.shape not in {(), (len(points),)}:
        rule = f"it must be one number or ({len(points)},)"
        raise InputError(radii_name, f"has shape {sizes.shape}", rule)
    if (sizes < 0).any():
        problem = f"holds {sizes.min():g}"
        raise InputError(radii_name, problem, "none may be below zero")
    return points.copy(), np.broadcast_to(sizes, len(points)).copy()

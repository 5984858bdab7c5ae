"""Balls: discs in the plane, balls in space, and points where the radius is zero."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats, Surface, frozen
from cspace.check import check_points, finite
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import NO_ROTATION, RotationCell
from cspace.shapes.shape import ExactShape, Pieces

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


_SIDES: Final = 128
"""Sides of the polygons that stand for discs in drawings."""

_POLYGON_AREA: Final = _SIDES / 2 * math.sin(2 * math.pi / _SIDES) / math.pi
"""Area of such a polygon divided by the area of the disc around it."""


@runtime_checkable
class BallSet(Protocol):
    """A decomposition into balls."""

    @property
    def centers(self) -> Floats: ...

    @property
    def radii(self) -> Floats: ...


class Balls(ExactShape):
    """A union of balls.

    ``centers`` have the shape (n, dim), and ``radii``, zero or above, (n,); metres.
    """

    def __init__(self, centers: Floats, radii: Floats) -> None:
        self.centers, self.radii = frozen(centers), frozen(radii)
        self.dim = centers.shape[1]

    @classmethod
    def of(cls, centers: ArrayLike | BallSet, radii: ArrayLike | None = None) -> Balls:
        """Balls from arrays, shapes (n, dim) and (n,), or one number, or from a decomposition with its radii; metres.

        Raises InputError if there is no ball, the shapes do not fit, a value is not finite, or a radius is below zero.
        """
        return cls(*check_balls(centers, radii))

    @property
    def noun(self) -> str:
        """What one of them is called."""
        return ("disc", "ball")[self.dim - 2]

    @property
    def encloses(self) -> bool:  # type: ignore[override]
        return bool((self.radii > 0.0).any())

    @property
    def span(self) -> float:
        return float((np.abs(self.centers).max(axis=1) + self.radii).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        reach = self.radii[:, None]
        return (self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)

    @property
    def measure(self) -> float:
        if self.dim == 2:
            return float(self.outline.area) / _POLYGON_AREA
        return float(4.0 / 3.0 * np.pi * self.radii[0] ** 3) if len(self.radii) == 1 else float("nan")

    @property
    def inscribed_radius(self) -> float:
        # The outline, of polygons in the discs, gives less than one disc around the origin may.
        around = self.radii - np.linalg.norm(self.centers, axis=1)
        return max(super().inscribed_radius, float(around.max()))

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        from cspace.raster.boxes import RoundedBoxes, rounded_rasters

        growth = rotation.displacement(self.centers)
        centers = rotation.apply(self.centers)
        return rounded_rasters(RoundedBoxes(centers, centers, self.radii), spacing, margin + growth, growth)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        from cspace.raster.boxes import RoundedBoxes, rounded_cells

        return rounded_cells(RoundedBoxes(self.centers, self.centers, self.radii), grid)

    def contains(self, points: ArrayLike) -> Bools:
        from scipy.spatial import cKDTree

        array = check_points(points, "points", self.dim)
        inside = np.zeros(array.shape[:-1], dtype=np.bool_)
        different, which = np.unique(self.radii, return_inverse=True)
        if len(different) <= 8:
            for number, radius in enumerate(different.tolist()):
                inside |= cKDTree(self.centers[which == number]).query(array)[0] <= radius
            return inside
        for center, radius in zip(self.centers, self.radii.tolist(), strict=True):
            inside |= ((array - center) ** 2).sum(axis=-1) <= radius * radius
        return inside

    def boundary(self) -> Pieces:
        return Pieces(self.centers[:, None], self.radii)

    @property
    def outline(self) -> BaseGeometry:
        if self.dim == 3:
            return super().outline
        import shapely

        return shapely.union_all(shapely.buffer(shapely.points(self.centers), self.radii, quad_segs=_SIDES // 4))

    @property
    def surface(self) -> Surface:
        if self.dim == 2:
            return super().surface
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=3 if len(self.radii) < 64 else 1)
        corners, faces = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64)
        vertices = self.centers[:, None] + self.radii[:, None, None] * corners
        shifts = len(corners) * np.arange(len(self.radii))
        return vertices.reshape(-1, 3), (faces + shifts[:, None, None]).reshape(-1, 3)

    def flattened(self) -> Balls:
        return Balls(self.centers[:, :2].copy(), self.radii)

    @property
    def is_round(self) -> bool:
        return not self.centers.any()

    @property
    def is_round_about_z(self) -> bool:
        return not self.centers[:, :2].any()

    def _features(self, matrix: Floats) -> Floats:
        return np.column_stack([self.centers @ matrix.T, self.radii])

    @property
    def spec(self) -> dict[str, object]:
        return {"kind": "balls", "centers": self.centers.tolist(), "radii": self.radii.tolist()}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Balls:
        """The shape of a :attr:`spec`."""
        return cls.of(spec["centers"], spec["radii"])


class Point(Balls):
    """The origin alone, as an arm is in the space of its joints.

    Where it is in a cell, it meets no other one: the workspace must name all cells that obstacles touch, those on whose
    border alone they do among them. Then its map is the workspace, cell for cell.
    """

    shown = False

    @classmethod
    def at_origin(cls, dim: int) -> Point:
        """The one of the plane, or of space."""
        return cls(np.zeros((1, dim)), np.zeros(1))

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        if margin > 0.0:
            return super().rasters(spacing, margin, rotation)
        own = Raster.from_bitmap(np.ones((1,) * self.dim, dtype=np.bool_), (0,) * self.dim)
        return own, own

    @property
    def outline(self) -> BaseGeometry:
        if self.dim == 3:
            return super().outline
        import shapely

        return shapely.Polygon(np.zeros((4, 2)))

    @property
    def spec(self) -> dict[str, object]:
        return {"kind": "point", "dim": self.dim}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Point:
        """The shape of a :attr:`spec`."""
        return cls.at_origin(int(spec["dim"]))


def check_balls(centers: ArrayLike | BallSet, radii: ArrayLike | None) -> tuple[Floats, Floats]:
    """Copies of the centers, shape (n, 2) or (n, 3), and radii, shape (n,), of balls; see :meth:`Balls.of`."""
    if isinstance(centers, BallSet):
        if radii is not None:
            raise InputError(
                "radii", "is given beside a decomposition", "a decomposition has its own", "leave it out", value=radii
            )
        radii, centers = centers.radii, centers.centers
    elif radii is None:
        raise InputError("radii", "is missing", "balls need one number, or one for each center", "pass it in metres")
    points, sizes = finite(centers, "centers"), finite(radii, "radii")
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        rule = "it must be (n, 2) or (n, 3) with n at least 1"
        raise InputError("centers", f"has shape {points.shape}", rule, "pass one row for each ball", value=centers)
    if sizes.shape not in {(), (len(points),)}:
        rule, hint = f"it must be one number or ({len(points)},)", "pass one number, or one for each center"
        raise InputError("radii", f"has shape {sizes.shape}", rule, hint, value=radii)
    if (sizes < 0).any():
        raise InputError(
            "radii", f"holds {sizes.min():g}", "none may be below zero", "pass lengths in metres", value=radii
        )
    return points.copy(), np.broadcast_to(sizes, len(points)).copy()

"""Plane shapes between two heights, such as keep-out zones for robots on a floor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cspace._grid import SLACK, Grid
from cspace._raster import Raster
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.polygon import Polygons
from cspace._shapes.shape import ExactShape, RoundedSimplices, Shape, Slab
from cspace._support.arrays import AXES, Bools, Floats, Surface
from cspace._support.check import check_finite, check_points
from cspace.errors import GeometryError


class Prism(ExactShape):
    """A plane shape between two heights.

    `base` is an exact shape in the plane, and `low` and `high` are heights; metres.
    """

    kind = "prism"
    dim = 3

    def __init__(self, base: ExactShape, low: float, high: float) -> None:
        """Keep the plane shape and the heights."""
        self.base = base
        self.low = low
        self.high = high

    @property
    def encloses(self) -> bool:
        """True if the plane shape has an interior."""
        return self.base.encloses

    @property
    def span(self) -> float:
        """Largest modulus of the numbers that define the shape, metres."""
        return max(self.base.span, abs(self.low), abs(self.high))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (3,) each."""
        lower, upper = self.base.bounds
        return np.append(lower, self.low), np.append(upper, self.high)

    @property
    def measure(self) -> float:
        """Volume, cubic metres."""
        return self.base.measure * (self.high - self.low)

    @property
    def is_round_about_z(self) -> bool:
        """True if the plane shape is round."""
        return self.base.is_round

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Stack the rasters of the plane shape; see ``Shape.rasters``."""
        if rotation.matrix is not None and not rotation.about_z:
            rule = "it turns about z alone"
            raise GeometryError("shape", "is a plane shape between two heights", rule)
        outer, inner = self.base.rasters(spacing, margin, rotation.in_plane)
        low, high = self.low / spacing, self.high / spacing
        # The box around an offset reaches one cell up and down.
        reach = 1.0 + margin / spacing + SLACK
        return _stack(outer, low - reach, high + reach), _stack(inner, low + SLACK, high - SLACK)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see ``Shape.cells``."""
        outer, inner = self.base.cells(Grid(grid.lower[:2], grid.spacing, grid.shape[:2]))
        bottoms = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
        tops = bottoms + grid.spacing
        room = SLACK * grid.spacing
        is_touched = (bottoms <= self.high + room) & (tops >= self.low - room)
        is_within = (bottoms >= self.low + room) & (tops <= self.high - room)
        return outer[..., np.newaxis] & is_touched, inner[..., np.newaxis] & is_within

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the shape; see :meth:`ExactShape.contains`."""
        array = check_points(points, "points", AXES)
        heights = array[..., 2]
        is_between = (self.low <= heights) & (heights <= self.high)
        return np.asarray(is_between & self.base.contains(array[..., :2]))

    def boundary(self) -> RoundedSimplices:
        """Return the sides: triangles, or for discs the axes of cylinders with their radii.

        Bottom and top are left out, because a robot on a floor keeps between these heights.
        """
        simplices, radii = self.base.boundary()
        bottom, top = (np.insert(simplices, 2, height, axis=2) for height in (self.low, self.high))
        sides = np.concatenate([bottom, top], axis=1)
        if simplices.shape[1] == 1:
            return RoundedSimplices(sides, radii)
        triangles = sides[:, [[0, 1, 3], [0, 3, 2]]].reshape(-1, 3, 3)
        return RoundedSimplices(triangles, np.repeat(radii, 2))

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``."""
        outer = self.base if self.low <= high + slack and self.high >= low - slack else None
        inner = self.base if self.low <= high - slack and self.high >= low + slack else None
        return outer, inner

    def project_to_plane(self) -> ExactShape:
        """Return the plane shape."""
        return self.base

    @property
    def surface(self) -> Surface:
        """Sides, bottom and top as vertices and triangles, for drawing."""
        import shapely

        drawn = Polygons([self.base.outline])
        sides = Prism(drawn, self.low, self.high).boundary().simplices
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(drawn.outline))
        flat = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
        caps = [np.insert(flat, 2, height, axis=2) for height in (self.low, self.high)]
        vertices = np.concatenate([sides, *caps]).reshape(-1, 3)
        return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed rows, with both heights; see ``Shape.transform_features``."""
        rows = self.base.transform_features(matrix[:2, :2])
        heights = np.sort(matrix[2, 2] * np.array([self.low, self.high]))
        return np.column_stack([rows, np.tile(heights, (len(rows), 1))])

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        return {"kind": self.kind, "base": self.base.spec, "low": self.low, "high": self.high}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Prism:
        """Make the prism of a :attr:`spec`."""
        base = Shape.KINDS[spec["base"]["kind"]].from_spec(spec["base"])
        low, high = check_finite([spec["low"], spec["high"]], "heights").tolist()
        if base.dim != 2 or low > high:
            raise GeometryError("base", f"is in {base.place}", "a prism has a plane shape")
        return cls(base.outer, low, high)


def extrude(shape: Shape, low: float, high: float) -> Shape:
    """Return a plane shape, or that of a prism, between two heights; other shapes unchanged."""
    if shape.dim == 3 and not isinstance(shape.outer, Prism):
        return shape
    flat = shape.project_to_plane()
    outer = Prism(flat.outer, low, high)
    if isinstance(flat, ExactShape):
        return outer
    return outer.with_inner(Prism(flat.inner, low, high), flat.is_round_about_z)


def _stack(plane: Raster, low: float, high: float) -> Raster:
    """Repeat a plane raster at the offsets between two heights, in cells."""
    first = math.ceil(low)
    count = max(math.floor(high) - first + 1, 0)
    cells = np.repeat(plane.cells[..., np.newaxis], count, axis=2)
    return Raster.from_bitmap(cells, (*plane.lower, first))

"""Polygons with holes, lines and points of the plane."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._files.geometries import check_shapes, split_parts
from cspace._grid import Grid
from cspace._raster import Raster
from cspace._raster.bitmaps import point_segments, ring_segments
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.shape import ExactShape, RoundedSimplices
from cspace._support.arrays import AXES, Bools, Floats
from cspace._support.check import check_finite, check_points
from cspace.errors import GeometryError

if TYPE_CHECKING:
    from shapely import STRtree
    from shapely.geometry.base import BaseGeometry

_MIN_COORDINATE: Final = 1e-200
"""Smallest modulus of a coordinate, metres; smaller ones are set to zero, because shapely fails if
products underflow."""


class Polygons(ExactShape):
    """A union of polygons, lines and points of the plane.

    The shapely geometries must be valid, not empty, and without z; metres.

    Attributes
    ----------
    geometries : tuple of shapely geometries
        The geometries as given.
    """

    kind = "polygon"
    dim = 2

    def __init__(self, geometries: Sequence[BaseGeometry]) -> None:
        """Keep the geometries, with tiny coordinates set to zero."""
        import shapely

        coordinates = shapely.get_coordinates(list(geometries))
        if (_drop_tiny(coordinates) != coordinates).any():
            geometries = shapely.transform(list(geometries), _drop_tiny).tolist()
        self.geometries = tuple(geometries)

    @classmethod
    def of(cls, shape: ArrayLike | BaseGeometry | Sequence[BaseGeometry]) -> Polygons:
        """Make polygons from the values that :meth:`cspace.Robot.polygon` takes.

        They must have an area. Raises GeometryError if a part is empty, has no area, crosses
        itself, or is not a polygon. Raises InputError if a coordinate is NaN or infinite.
        """
        # Split the shape into its parts, which messages number if there are several.
        parts = [part for each in _as_geometries(shape) for part in split_parts(each, "polygon")]
        if not parts:
            raise GeometryError("polygon", "is empty", "it must have an area")
        names = ["polygon"]
        if len(parts) > 1:
            names = [f"polygon[{number}]" for number in range(len(parts))]
        check_shapes(parts, names)
        for name, polygon in zip(names, parts, strict=True):
            if polygon.geom_type != "Polygon":
                problem = f"is a {polygon.geom_type}"
                rule = "each part must be a Polygon"
                raise GeometryError(name, problem, rule)
            if not polygon.area > 0.0:
                problem = f"has area {polygon.area:g}"
                rule = "it must be above zero"
                raise GeometryError(name, problem, rule)
        return cls(parts)

    @cached_property
    def parts(self) -> list[tuple[Floats, bool]]:
        """Boundary segments of each simple geometry, and True for a polygon.

        Segments are ``(x0, y0, x1, y1)``. The segments of a polygon form closed curves, which
        enclose it by even-odd parity.
        """
        return list(_iterate_parts(self.geometries))

    @property
    def encloses(self) -> bool:
        """True if a part is a polygon."""
        return any(filled for _, filled in self.parts)

    @cached_property
    def span(self) -> float:
        """Largest modulus of a coordinate, metres."""
        return max(float(np.abs(segments).max()) for segments, _ in self.parts)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (2,) each."""
        import shapely

        lower, upper = shapely.total_bounds(list(self.geometries)).reshape(2, 2)
        return lower, upper

    @property
    def measure(self) -> float:
        """Area, square metres."""
        return float(self.outline.area)

    @property
    def corners(self) -> int:
        """Number of corners of all boundaries."""
        return sum(len(segments) for segments, _ in self.parts)

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see ``Shape.rasters``."""
        from cspace._raster.rounded_segments import outline_rasters

        return outline_rasters(self.parts, spacing, margin, rotation)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see ``Shape.cells``."""
        from cspace._raster.rounded_segments import outline_cells

        return outline_cells(self._find_parts_near(grid), grid)

    def _find_parts_near(self, grid: Grid) -> list[tuple[Floats, bool]]:
        """Return the parts that can touch a grid."""
        import shapely

        # One cell more on each side covers rounding.
        lower = np.asarray(grid.lower) - grid.spacing
        upper = np.asarray(grid.upper) + grid.spacing
        low, high = self.bounds
        if (lower <= low).all() and (high <= upper).all():
            return self.parts
        # Parts keep their order.
        near = np.sort(self._index.query(shapely.box(*lower, *upper)))
        return list(_iterate_parts(self._index.geometries[near]))

    @cached_property
    def _index(self) -> STRtree:
        """Spatial index of the parts."""
        import shapely

        return shapely.STRtree(shapely.get_parts(list(self.geometries)))

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the shape; see :meth:`ExactShape.contains`."""
        import shapely

        array = check_points(points, "points", AXES[: self.dim])
        shapely.prepare(self.outline)
        x, y = np.moveaxis(array, -1, 0)
        return np.asarray(shapely.intersects_xy(self.outline, x, y))

    def boundary(self) -> RoundedSimplices:
        """Return the boundary as segments."""
        segments = np.concatenate([segments for segments, _ in self.parts]).reshape(-1, 2, 2)
        return RoundedSimplices(segments, np.zeros(len(segments)))

    @property
    def filled_boundaries(self) -> list[Floats]:
        """Boundary segments of each polygon; lines and points are left out.

        They are ``(x0, y0, x1, y1)``, shape (E, 4), and enclose the polygon by even-odd parity.
        """
        return [segments for segments, filled in self.parts if filled]

    @cached_property
    def outline(self) -> BaseGeometry:
        """Union of the geometries."""
        import shapely

        if len(self.geometries) == 1:
            return self.geometries[0]
        return shapely.union_all(list(self.geometries))

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed segments, both ways, with their part's number."""
        segments_of_parts = [segments for segments, _ in self.parts]
        part_numbers = np.repeat(np.arange(len(self.parts)), list(map(len, segments_of_parts)))
        # A segment (x0, y0, x1, y1) has a start and an end.
        segments = np.concatenate(segments_of_parts)
        starts = segments[:, :2] @ matrix.T
        ends = segments[:, 2:] @ matrix.T
        forward = np.column_stack([starts, ends, part_numbers])
        backward = np.column_stack([ends, starts, part_numbers])
        return np.concatenate([forward, backward])

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        texts = [base64.b64encode(geometry.wkb).decode() for geometry in self.geometries]
        return {"kind": self.kind, "wkb": texts}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Polygons:
        """Make the polygons of a :attr:`spec`."""
        import shapely

        contents = [base64.b64decode(text, validate=True) for text in spec["wkb"]]
        geometries = shapely.from_wkb(contents).tolist()
        if all(geometry.geom_type == "Polygon" for geometry in geometries):
            return cls.of(geometries)
        return cls(geometries)


def _drop_tiny(coordinates: Floats) -> Floats:
    """Set coordinates below `_MIN_COORDINATE` to zero."""
    return np.where(np.abs(coordinates) < _MIN_COORDINATE, 0.0, coordinates)


def _as_geometries(
    shape: ArrayLike | BaseGeometry | Sequence[BaseGeometry],
) -> Sequence[BaseGeometry]:
    """Return geometries, or the polygon of vertices."""
    import shapely

    if isinstance(shape, shapely.Geometry):
        return [shape]
    if isinstance(shape, Sequence) and shape and isinstance(shape[0], shapely.Geometry):
        return shape
    vertices = check_finite(shape, "polygon", AXES[:2])
    if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3:
        rule = "it must be (n, 2) with n at least 3"
        raise GeometryError("polygon", f"has shape {vertices.shape}", rule)
    return [shapely.Polygon(vertices)]


def _iterate_parts(geometries: Iterable[BaseGeometry]) -> Iterator[tuple[Floats, bool]]:
    """Yield the boundary segments of each part.

    The second value is True for polygons, False for lines and points.
    """
    import shapely

    for shape in shapely.get_parts(list(geometries)):
        if shape.geom_type == "Polygon":
            yield ring_segments(shape), True
        elif hasattr(shape, "geoms"):
            yield from _iterate_parts(list(shape.geoms))
        else:
            points = np.asarray(shape.coords)
            yield point_segments(points[:, :2]), False

"""Boxes along the axes, and unions of the cells of a bitmap."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # loads its submodules on first use
from numpy.typing import ArrayLike

from cspace._grid import Grid
from cspace._raster import Raster
from cspace._raster.bitmaps import (
    boundary_mesh,
    boundary_segments,
    boundary_triangles,
    boxes_within_cells,
    cover_with_boxes,
)
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.polygon import Polygons
from cspace._shapes.shape import Boxes, ExactShape, RoundedSimplices, Slab
from cspace._support.arrays import AXES, Bools, Floats, Surface, find_box, frozen
from cspace._support.check import check_cells, check_point, check_points, check_positive
from cspace.errors import GeometryError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._raster.rounded_boxes import RoundedBoxes
    from cspace._raster.surfaces import SolidSurface

# Corners, triangles and facing of the unit cube.
_UNIT_CORNERS, _FACES, _WINDINGS = boundary_mesh(np.array([[[True]]]), 1.0, np.zeros(3))
_BOX_TRIANGLES = np.where(_WINDINGS[:, None] > 0, _FACES, _FACES[:, ::-1])
"""Triangles of a box with the corners `_UNIT_CORNERS`, facing outward."""


class Box(ExactShape):
    """A box along the axes in space.

    `extents`, shape (3,), are its positive side lengths; metres.
    """

    kind = "box"
    dim = 3
    is_boxes = True

    def __init__(self, extents: Floats, center: Floats) -> None:
        """Keep the box by its sides and center, and by its corners."""
        self.extents = frozen(extents)
        self.center = frozen(center)
        self.lower = frozen(center - extents / 2)
        self.upper = frozen(center + extents / 2)

    @classmethod
    def of(cls, extents: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)) -> Box:
        """Make a box from side lengths and center, metres.

        Raises InputError if a number is missing or not finite, or a side length is not above zero.
        """
        sides = check_point(extents, "extents", dim=3)
        for number, side in enumerate(sides.tolist()):
            check_positive(side, f"extents[{number}]")
        return cls(sides, check_point(center, dim=3))

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, metres."""
        return float(np.abs([self.lower, self.upper]).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner, shape (3,) each."""
        return self.lower, self.upper

    @property
    def measure(self) -> float:
        """Volume, cubic metres."""
        return float(np.prod(self.upper - self.lower))

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see :meth:`Shape.rasters`."""
        if rotation.matrix is not None:
            from cspace._raster.surfaces import SolidSurface, surface_rasters

            triangles = self.boundary().simplices
            windings = np.ones(len(triangles), dtype=np.int64)
            solid = SolidSurface(triangles, triangles, windings, source="box")
            return surface_rasters(solid, spacing, margin, rotation)
        from cspace._raster.rounded_boxes import RoundedBoxes, rounded_rasters

        box = RoundedBoxes(self.lower[None], self.upper[None], np.zeros(1))
        return rounded_rasters(box, spacing, np.full(1, margin), np.zeros(1))

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see :meth:`Shape.cells`."""
        from cspace._raster.rounded_boxes import RoundedBoxes, rounded_cells

        return rounded_cells(RoundedBoxes(self.lower[None], self.upper[None], np.zeros(1)), grid)

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the box; see :meth:`ExactShape.contains`."""
        array = check_points(points, "points", AXES[: self.dim])
        return np.asarray(((self.lower <= array) & (array <= self.upper)).all(axis=-1))

    def boundary(self) -> RoundedSimplices:
        """Return the boundary as triangles."""
        vertices, faces = self.surface
        return RoundedSimplices(vertices[faces], np.zeros(len(faces)))

    @property
    def boxes(self) -> Boxes:
        """The box itself."""
        size = (self.upper - self.lower).max(keepdims=True)
        return Boxes(self.lower[None], self.upper[None], size)

    @property
    def surface(self) -> Surface:
        """Vertices and triangles, facing outward."""
        return self.lower + _UNIT_CORNERS * (self.upper - self.lower), _BOX_TRIANGLES.copy()

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``."""
        rectangle = self.project_to_plane()
        bottom, top = float(self.lower[2]), float(self.upper[2])
        outer = rectangle if bottom <= high + slack and top >= low - slack else None
        inner = rectangle if bottom <= high - slack and top >= low + slack else None
        return outer, inner

    def project_to_plane(self) -> Polygons:
        """Project the box onto the xy plane."""
        import shapely

        return Polygons([shapely.box(*self.lower[:2], *self.upper[:2])])

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed rows; see ``Shape.transform_features``."""
        corners = np.array([self.lower, self.upper]) @ matrix.T
        return np.hstack([corners.min(axis=0), corners.max(axis=0)])[None]

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        return {"kind": self.kind, "extents": self.extents.tolist(), "center": self.center.tolist()}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Box:
        """Make the box of a :attr:`spec`."""
        return cls.of(spec["extents"], spec["center"])


class Voxels(ExactShape):
    """The union of the closed cells of a bitmap.

    They are ``lower + side * (i + [0, 1]^dim)`` for every ``occupied[i]``. There are two or three
    axes, and at least one cell is set; metres.
    """

    kind = "cells"

    def __init__(self, occupied: Bools, side: float, lower: Floats) -> None:
        """Keep the bitmap and the place of its cells."""
        self.occupied = frozen(occupied)
        self.side = side
        self.lower = frozen(lower)
        self.dim = occupied.ndim
        self.is_boxes = occupied.ndim == 3

    @classmethod
    def of(cls, occupied: ArrayLike, spacing: float, lower: ArrayLike | None = None) -> Voxels:
        """Make the union of a bitmap's cells; metres.

        `lower` is the corner of the first cell, by default the origin.

        Raises GeometryError if no cell is occupied. Raises InputError if `occupied` is not an array
        of booleans, or of 0 and 1, with two or three axes, or another value is invalid.
        """
        bitmap = check_cells(occupied, "occupied")
        if not bitmap.any():
            rule = "at least one cell must be occupied"
            raise GeometryError("occupied", "holds no True cell", rule)
        side = check_positive(spacing, "spacing")
        if lower is None:
            lower = np.zeros(bitmap.ndim)
        return cls(bitmap, side, check_point(lower, "lower", dim=bitmap.ndim))

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, metres."""
        return float(np.abs(self.lower).max() + self.side * max(self.occupied.shape))

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the bounding box, shape (dim,) each."""
        first, stop = np.array([(side.start, side.stop) for side in find_box(self.occupied)]).T
        return self.lower + self.side * first, self.lower + self.side * stop

    @property
    def measure(self) -> float:
        """Area or volume, in square or cubic metres."""
        return float(np.count_nonzero(self.occupied)) * self.side**self.dim

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Compute the outer and inner raster; see :meth:`Shape.rasters`."""
        if self.dim == 2:
            from cspace._raster.rounded_segments import outline_rasters

            return outline_rasters([(self._segments, True)], spacing, margin, rotation)
        if rotation.matrix is not None:
            from cspace._raster.surfaces import surface_rasters

            return surface_rasters(self._solid, spacing, margin, rotation)
        from cspace._raster.rounded_boxes import rounded_rasters

        boxes = self._boxes
        # The boxes give the outer raster only; inner offsets need to lie in the union, not one box.
        outward = np.full(len(boxes.radii), margin)
        no_inner = np.full(len(boxes.radii), np.inf)
        outer, _ = rounded_rasters(boxes, spacing, outward, no_inner)
        # Offsets of the raster along each axis, from the corner of the first cell.
        offsets = [
            low + np.arange(count, dtype=np.float64) - corner
            for low, count, corner in zip(
                outer.lower, outer.cells.shape, self.lower / spacing, strict=True
            )
        ]
        inside = boxes_within_cells(self.occupied, offsets, 0.0, self.side / spacing)
        return outer, Raster.from_bitmap(inside, outer.lower)

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        """Compute the outer and inner cells; see :meth:`Shape.cells`."""
        from cspace._raster.rounded_boxes import rounded_cells

        outer, _ = rounded_cells(self._boxes, grid)
        starts = [
            (low - corner) / grid.spacing + np.arange(count, dtype=np.float64)
            for low, corner, count in zip(grid.lower, self.lower, grid.shape, strict=True)
        ]
        return outer, boxes_within_cells(self.occupied, starts, 1.0, self.side / grid.spacing)

    def contains(self, points: ArrayLike) -> Bools:
        """Return a mask of the points in the cells; see :meth:`ExactShape.contains`."""
        array = check_points(points, "points", AXES[: self.dim])
        # Points outside are clipped into the padding, which is empty.
        padded = np.pad(self.occupied, 1)
        cells = np.floor((array - self.lower) / self.side) + 1.0  # in the padded bitmap
        cells = np.clip(cells, 0, np.array(padded.shape) - 1).astype(np.int64)
        indices = tuple(np.moveaxis(cells, -1, 0))
        return np.asarray(padded[indices])

    def boundary(self) -> RoundedSimplices:
        """Return the boundary as segments in the plane, or triangles in space."""
        if self.dim == 2:
            return RoundedSimplices(self._segments.reshape(-1, 2, 2), np.zeros(len(self._segments)))
        triangles = boundary_triangles(self.occupied, self.side, self.lower)
        return RoundedSimplices(triangles, np.zeros(len(triangles)))

    @property
    def boxes(self) -> Boxes:
        """Boxes that cover the cells in space."""
        if self.dim == 2:
            return super().boxes
        # The size of a box is that of the connected part that it belongs to.
        labels, _ = scipy.ndimage.label(self.occupied)
        extents_of_parts = [
            max(cells.stop - cells.start for cells in box)
            for box in scipy.ndimage.find_objects(labels)
        ]
        lows, highs = cover_with_boxes(self.occupied, 1.0, np.zeros(3))
        x, y, z = lows.astype(np.int64).T
        part_of_boxes = labels[x, y, z] - 1
        sizes = self.side * np.array(extents_of_parts)[part_of_boxes]
        return Boxes(self.lower + self.side * lows, self.lower + self.side * highs, sizes)

    @cached_property
    def _segments(self) -> Floats:
        """Boundary of the cells in the plane, shape (E, 4), metres."""
        return boundary_segments(self.occupied, self.side, self.lower)

    @cached_property
    def _boxes(self) -> RoundedBoxes:
        """Disjoint boxes that cover exactly the occupied cells."""
        from cspace._raster.rounded_boxes import RoundedBoxes

        lows, highs = cover_with_boxes(self.occupied, self.side, self.lower)
        return RoundedBoxes(lows, highs, np.zeros(len(lows)))

    @cached_property
    def _solid(self) -> SolidSurface:
        """Boundary of the cells, with a shell without T-junctions."""
        from cspace._raster.surfaces import SolidSurface

        vertices, faces, windings = boundary_mesh(self.occupied, self.side, self.lower)
        triangles = self.boundary().simplices
        return SolidSurface(triangles, vertices[faces], windings, source="bitmap")

    @cached_property
    def outline(self) -> BaseGeometry:
        """Union of the cells as a shapely geometry, for drawing."""
        if self.dim == 3:
            return super().outline
        import shapely

        return shapely.union_all(shapely.box(*self._boxes.lows.T, *self._boxes.highs.T))

    @property
    def surface(self) -> Surface:
        """Boundary triangles, for drawing."""
        if self.dim == 2:
            return super().surface
        vertices = self.boundary().simplices.reshape(-1, 3)
        return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)

    @property
    def closed_surface(self) -> Surface:
        """Boundary triangles in space, which share all corners, facing outward."""
        vertices, faces, windings = boundary_mesh(self.occupied, self.side, self.lower)
        # Reversing the order of its corners reverses the normal of a face.
        return vertices, np.where(windings[:, None] < 0, faces[:, ::-1], faces)

    def slab(self, low: float, high: float, slack: float) -> Slab:
        """Return the part between two heights, seen from above; see ``Shape.slab``."""
        if self.dim == 2:
            return super().slab(low, high, slack)
        bottoms = self.lower[2] + self.side * np.arange(self.occupied.shape[2])
        tops = self.lower[2] + self.side * np.arange(1, self.occupied.shape[2] + 1)
        parts = []
        for room in (slack, -slack):
            meets = (bottoms <= high + room) & (tops >= low - room)
            cells = np.asarray(self.occupied[:, :, meets].any(axis=2))
            parts.append(Voxels(cells, self.side, self.lower[:2].copy()) if cells.any() else None)
        return parts[0], parts[1]

    def project_to_plane(self) -> Voxels:
        """Project the cells onto the xy plane."""
        if self.dim == 2:
            return self
        return Voxels(np.asarray(self.occupied.any(axis=2)), self.side, self.lower[:2].copy())

    def transform_features(self, matrix: Floats) -> Floats:
        """Return transformed rows; see ``Shape.transform_features``."""
        cells = np.argwhere(self.occupied)
        low = self.lower + self.side * cells
        high = self.lower + self.side * (cells + 1)
        corners = np.stack([low, high]) @ matrix.T
        return np.hstack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def spec(self) -> dict[str, object]:
        """Plain values for :meth:`from_spec`."""
        bits = np.packbits(self.occupied).tobytes()
        return {
            "kind": self.kind,
            "bits": base64.b64encode(bits).decode(),
            "shape": list(self.occupied.shape),
            "spacing": self.side,
            "lower": self.lower.tolist(),
        }

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Voxels:
        """Make the cells of a :attr:`spec`."""
        shape = tuple(int(n) for n in spec["shape"])
        packed = np.frombuffer(base64.b64decode(spec["bits"], validate=True), dtype=np.uint8)
        bits = np.unpackbits(packed, count=math.prod(shape))
        return cls.of(bits.astype(np.bool_).reshape(shape), spec["spacing"], spec["lower"])

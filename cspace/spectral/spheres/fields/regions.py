"""Region: a shape in the plane or in space, asked for its signed distance and its cells."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.covering import check_cells
from cspace.errors import GeometryError, InputError
from cspace.grid import Grid, finite, positive
from cspace.raster.bitmaps import point_segments, polygon_outline
from cspace.spectral.spheres.fields.border import Border

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.shapes.mesh import Mesh

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ALIGNED: Final = 1e-6
"""Part of a cell that two grids may be off each other by rounding."""

_MEASURED: Final = 2**21
"""Cells of the box of a mesh by which its volume is bounded where bodies may overlap."""


class Region(ABC):
    """A closed set.

    Attributes
    ----------
    shape : shapely geometry, Mesh, or None
        What it was made from, for pictures.
    border : Border
        Holds the border of the set, and maybe more of it.
    bounds : ndarray, shape (2, d)
        Corners of its bounding box, metres.
    """

    shape: Any
    border: Border
    bounds: Floats

    @property
    def dim(self) -> int:
        """Number of axes."""
        return int(self.border.dim)

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @abstractmethod
    def holds(self, points: Floats) -> Bools:
        """Whether points (n, d) lie inside, for those farther from the border than rounding."""

    def may_hold(self, points: Floats) -> Bools:
        """Whether points (n, d) lie inside by any reading of the shape."""
        return self.holds(points)

    @abstractmethod
    def cells(self, grid: Grid) -> Bools:
        """Cells of a grid of :meth:`grid_at` whose union is proven to cover the set."""

    def grid_at(self, spacing: float) -> Grid:
        """A grid that covers the set, with cells of about this side (metres), and no larger."""
        counts = np.ceil((self.bounds[1] - self.bounds[0]) / spacing) + 1.0
        return Grid(self.bounds.mean(axis=0) - 0.5 * spacing * counts, spacing, counts.astype(np.int64))

    @abstractmethod
    def measure(self) -> tuple[float, float]:
        """Bounds of the area or volume, which differ where bodies of a mesh may overlap."""

    def depths(self, points: Floats) -> Floats:
        """A lower bound of the signed distance from the border, above zero inside, shape (n,), metres."""
        found = self.border.distances(points)
        return np.asarray(np.where(self.holds(points), found, -found) - self.border.slack)

    def interior(self, points: Floats) -> tuple[Floats, Floats]:
        """Those among points (n, d) that are proven to lie inside, and their depths."""
        depths = self.depths(points)
        kept = depths > 0.0
        return points[kept], depths[kept]

    def gaps(self, points: Floats) -> Floats:
        """A lower bound of the distance from points (n, d) to the set, shape (n,), metres."""
        found = self.border.distances(points)
        return np.where(self.may_hold(points), 0.0, np.maximum(found - self.border.slack, 0.0))

    def may_meet(self, middles: Floats, reach: float) -> Bools:
        """Whether balls of one radius (metres) may meet the set; surely where not so."""
        found = self.border.distances(middles)
        return np.asarray((found <= reach + self.border.slack) | self.may_hold(middles))


class FlatRegion(Region):
    """Valid shapely geometries in the plane; lines and points have no inside."""

    def __init__(self, shapes: Sequence[BaseGeometry]) -> None:
        import shapely

        self.shape = shapes[0] if len(shapes) == 1 else shapely.union_all(list(shapes))
        parts = list(shapely.get_parts([self.shape]))
        # What is to be covered are the shapes themselves: the corners of their union are rounded.
        self._parts = list(shapely.get_parts(shapely.get_parts(list(shapes))))
        self.border = Border(np.concatenate([_segments(part) for part in parts]).reshape(-1, 2, 2))
        self.bounds = shapely.total_bounds(self._parts).reshape(2, 2)
        shapely.prepare(self.shape)

    def holds(self, points: Floats) -> Bools:
        import shapely

        return np.asarray(shapely.contains_xy(self.shape, points[:, 0], points[:, 1]))

    def cells(self, grid: Grid) -> Bools:
        from cspace.shapes import Polygons

        return Polygons(self._parts).cells(grid)[0]

    def measure(self) -> tuple[float, float]:
        return float(self.shape.area), float(self.shape.area)


class SolidRegion(Region):
    """A mesh: its triangles, and what closed bodies enclose."""

    def __init__(self, mesh: Mesh) -> None:
        if mesh.solid == "fill":
            raise InputError(
                f"{mesh.source} has solid='fill', and what is filled depends on the spacing; a decomposition needs a "
                "shape of its own; close the mesh and pass solid='auto', or fill it with Workspace.from_mesh and pass "
                "its outer cells"
            )
        self.shape, self.bounds = mesh, np.stack(mesh.bounds)
        self.border = Border(mesh.triangles)

    def holds(self, points: Floats) -> Bools:
        return np.asarray(self.shape.contains(points))

    def may_hold(self, points: Floats) -> Bools:
        return self.holds(points)

    def cells(self, grid: Grid) -> Bools:
        return np.asarray(self.shape.cells(grid)[0])

    def measure(self) -> tuple[float, float]:
        if not self.shape.encloses:
            return 0.0, 0.0
        volume = abs(self.shape.volume)
        closed = [body for body in self.shape.bodies if body.closed]
        alone = len(closed) == 1 and bool((np.abs(closed[0].turns) == 1).all())
        return (volume, volume) if alone else self._between()

    def _between(self) -> tuple[float, float]:
        """Bounds of the volume by cells, where bodies may overlap."""
        spacing = float(np.cbrt(np.prod(self.bounds[1] - self.bounds[0]) / _MEASURED))
        outer, inner = self.shape.cells(Region.grid_at(self, spacing))
        return float(np.count_nonzero(inner)) * spacing**3, float(np.count_nonzero(outer)) * spacing**3


class CellRegion(Region):
    """Cells of a bitmap."""

    def __init__(self, occupied: Bools, spacing: float, lower: Floats) -> None:
        import shapely

        from cspace.raster.bitmaps import boundary_segments, cell_faces

        self.shape = None
        self._grid, self._occupied = Grid(lower, spacing, occupied.shape), occupied
        used = np.argwhere(occupied)
        self.bounds = np.array([lower + spacing * used.min(axis=0), lower + spacing * (used.max(axis=0) + 1)])
        if occupied.ndim == 2:
            self.border = Border(boundary_segments(occupied, spacing, lower).reshape(-1, 2, 2))
            self.shape = shapely.MultiLineString(list(self.border.pieces))
        else:
            self.border = Border(cell_faces(occupied, spacing, lower))

    def holds(self, points: Floats) -> Bools:
        cells = np.floor((points - self._grid.lower) / self._grid.spacing)
        known = ((cells >= 0) & (cells < self._grid.shape)).all(axis=1)
        out = np.zeros(len(points), dtype=np.bool_)
        out[known] = self._occupied[tuple(cells[known].astype(np.int64).T)]
        return out

    def grid_at(self, spacing: float) -> Grid:
        # Cells are cut into whole parts, or taken together.
        side = self._grid.spacing
        if spacing < side:
            parts = int(np.ceil(side / spacing - _ALIGNED))
            return Grid(self._grid.lower, side / parts, [parts * n for n in self._grid.shape])
        joined = int(spacing / side + _ALIGNED)
        return Grid(self._grid.lower, side * joined, [-(-n // joined) for n in self._grid.shape])

    def cells(self, grid: Grid) -> Bools:
        cells, scale = self._occupied, self._grid.spacing / grid.spacing
        for axis in range(self.dim):
            if scale > 1.0 - _ALIGNED:
                cells = np.repeat(cells, round(scale), axis=axis)
            else:
                cells = np.logical_or.reduceat(cells, np.arange(0, cells.shape[axis], round(1.0 / scale)), axis=axis)
        return cells

    def measure(self) -> tuple[float, float]:
        measure = float(np.count_nonzero(self._occupied)) * self._grid.spacing**self.dim
        return measure, measure


def region_of(shape: Any, spacing: float | None, lower: ArrayLike | None) -> Region:
    """The region of anything that describes a shape; as :func:`cspace.spectral.spheres.decompose` tells."""
    from cspace.shapes.mesh import Mesh

    if isinstance(shape, np.ndarray) and not shape.ndim:
        raise InputError(
            f"shape is {shape!r}, an array without axes; it must have two or three; pass a shape or its cells"
        )
    if isinstance(shape, np.ndarray | list | tuple) and not len(shape):
        raise GeometryError(f"shape is {shape!r}; an empty shape has no balls; pass one that has an area or a volume")
    if spacing is not None or getattr(shape, "dtype", None) == np.bool_:
        return _cell_region(shape, spacing, lower)
    if lower is not None:
        raise InputError(f"lower is {lower!r}; only a bitmap has cells; leave it out, or pass spacing too")
    if _is_flat(shape):
        return FlatRegion(_checked_shapes(shape))
    return SolidRegion(Mesh.of(shape))


def _is_flat(shape: Any) -> bool:
    """Whether a shape is one of the plane."""
    import shapely

    from cspace.io.vector import SUFFIXES

    if isinstance(shape, str | os.PathLike):
        return Path(shape).suffix.lower() in SUFFIXES or not Path(shape).suffix
    if isinstance(shape, list | tuple) and isinstance(shape[0], shapely.Geometry | Mapping):
        return True
    return isinstance(shape, shapely.Geometry | Mapping) or _shape_of(shape)[1:] == (2,)


def _shape_of(values: Any) -> tuple[int, ...]:
    """Lengths of the axes of an array or of nested lists; none for anything else."""
    try:
        return np.shape(values) if isinstance(values, np.ndarray | list | tuple) else ()
    except ValueError:
        return ()


def _segments(part: Any) -> Floats:
    """Segments of a polygon, line or point, shape (n, 4)."""
    if part.geom_type == "Polygon":
        return polygon_outline(part)
    return point_segments(np.asarray(part.coords)[:, :2])


def _checked_shapes(shape: Any) -> list[Any]:
    import shapely

    from cspace.io.vector import read_shapes

    if isinstance(shape, np.ndarray | list | tuple) and not isinstance(shape[0], shapely.Geometry | Mapping):
        vertices = finite(shape, "polygon")
        if len(vertices) < 3:
            raise GeometryError(f"polygon has {len(vertices)} vertices; it must have three or more; pass them in order")
        return read_shapes(shapely.Polygon(vertices))
    return read_shapes(shape)


def _cell_region(shape: Any, spacing: float | None, lower: ArrayLike | None) -> CellRegion:
    cells = check_cells(shape, "shape")
    if not cells.any():
        raise GeometryError(f"no cell of the {cells.shape} bitmap is set; an empty shape has no balls; set some cells")
    if spacing is None:
        raise InputError("spacing is left out; a bitmap needs the side of its cells; pass it in metres, e.g. 0.05")
    side = positive(spacing, "spacing")
    corner = finite(np.zeros(cells.ndim) if lower is None else lower, "lower")
    if corner.shape != (cells.ndim,):
        raise InputError(f"lower has shape {corner.shape}; it must hold {cells.ndim} coordinates; pass them in metres")
    return CellRegion(cells, side, corner)

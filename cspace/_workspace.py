"""Workspace: obstacle cells on a grid."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cspace import _outside
from cspace._files.access import UNKNOWNS
from cspace._files.crs import check_own_crs, warn_of_likely_degrees
from cspace._grid import FARTHEST_CELL, MAX_COORDINATE, SLACK, Grid, check_reach
from cspace._shapes import Balls, Polygons, Shape, ShapeLike, Voxels, as_shape
from cspace._support.arrays import Bools, Floats, StrPath, frozen
from cspace._support.check import (
    AnswersNames,
    check_bounds,
    check_cells,
    check_dims,
    check_number,
    check_point,
    check_positive,
    check_real,
    check_word,
    find_sizes,
    names_options,
    select_positions,
)
from cspace._support.column_names import list_columns
from cspace._support.kinds import make_kind_error, suggest_call
from cspace._support.limits import (
    MESH_CELL_BYTES,
    SHAPE_CELL_BYTES,
    WORKSPACE_CELL_BYTES,
    PlannedGrid,
    check_memory,
)
from cspace._support.reporting import warn_user
from cspace._support.units import check_unit
from cspace.errors import CspaceError, FileError, InputError, UnitWarning

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._files.meshes import Up
    from cspace._obstacles import Source
    from cspace._shapes.balls import BallSet
    from cspace._shapes.mesh import MeshLike, Solid

Geometries: TypeAlias = "BaseGeometry | Mapping[str, object] | StrPath | Iterable[Geometries]"


_SLIVER: Final = 1e-9
"""Rounding allowance of the upper bound, in cells. It is far below the slack of an outer raster, so
that an obstacle in this sliver still marks the last cell."""

_ZERO_BOUND: Final = SLACK / 2**14
"""Bounds nearer to zero than this, in cells, count as zero."""

_SINGLE_SUFFIXES: Final = (".stl", ".ply", ".pcd", ".glb", ".gltf")
"""Suffixes of files of points whose numbers often have 32 bits."""

_MOVABLE: Final = ("set of polygons", "mesh", "cloud")
"""Kinds of obstacles of the methods that take an offset."""

_MIN_EXTENT: Final = 1.0 - 2.0**-20
"""Extent of all obstacles, in cells, below which their unit is probably wrong."""

_MIN_EXTENT_IN_BOUNDS: Final = 0.25
"""Extent of all obstacles, in cells, below which their unit is probably wrong if the map has
bounds."""


class OpenOptions(TypedDict, total=False):
    """Options of :meth:`Workspace.open`."""

    spacing: float
    lower: ArrayLike
    bounds: ArrayLike
    inner: ArrayLike
    radius: float
    drop_missing: bool
    offset: ArrayLike
    solid: Solid
    up: Up
    unknown: str
    threshold: float
    dark: str
    lazy: bool


@dataclass(frozen=True, slots=True, eq=False)
class Workspace(metaclass=AnswersNames):
    """Obstacles as two sets of closed grid cells.

    `outer` cells touch obstacles, `inner` cells lie inside them. The two sets are equal if the
    obstacles are given as cells. Use a ``from_...`` method or :meth:`open` to make one.

    Attributes
    ----------
    grid : Grid
    outer : ndarray of bool, shape grid.shape
        Cells that meet an obstacle; read-only, a copy of what was passed.
    inner : ndarray of bool, shape grid.shape
        Cells that lie in obstacles; the same object as ``outer`` if the obstacles are given as
        cells.
    source : str
        File or kind of input, for messages.
    unknown : ndarray of bool, shape grid.shape, or None
        Unknown cells of a sensor map; None if there are none. `outer` says whether they count as
        free or occupied. Pictures draw them in a colour of their own.
    shapes : tuple or None
        The obstacles as shapes, metres, unclipped; exact queries use them. None if the obstacles
        are given as cells.

    Raises
    ------
    InputError
        If an array is not boolean (0 and 1 are accepted), does not have the grid's shape, or a cell
        is in ``inner`` and not in ``outer``.

    Examples
    --------
    >>> import shapely, cspace
    >>> cspace.Workspace.from_polygons([shapely.box(1, 1, 2, 3)], spacing=0.1, bounds=(0, 0, 5, 4))
    Workspace(1 polygon: 50 x 40 cells of 0.1 m, 13.2 % occupied)
    """

    grid: Grid
    outer: Bools = field(repr=False)
    inner: Bools = field(repr=False)
    source: str = "array"
    unknown: Bools | None = field(default=None, repr=False)
    shapes: tuple[Shape, ...] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check and freeze the arrays."""
        outer = check_cells(self.outer, "outer")
        inner = outer if self.inner is self.outer else check_cells(self.inner, "inner")
        unknown = None if self.unknown is None else check_cells(self.unknown, "unknown")
        for name, cells in (("outer", outer), ("inner", inner), ("unknown", unknown)):
            if cells is not None and cells.shape != self.grid.shape:
                problem = f"has shape {cells.shape} but the grid has {self.grid.shape}"
                raise InputError(name, problem, "they must be equal")
        if inner is not outer:
            not_outer = inner > outer
            if not_outer.any():
                cell = tuple(np.argwhere(not_outer)[0].tolist())
                problem = f"has cell {cell}, which is not in outer"
                rule = "it must be a subset of outer"
                raise InputError("inner", problem, rule)
            if np.array_equal(inner, outer):
                inner = outer
        if unknown is not None and not unknown.any():
            unknown = None
        # The class is frozen, so plain assignment is refused.
        shapes = None if self.shapes is None else tuple(self.shapes)
        object.__setattr__(self, "outer", outer)
        object.__setattr__(self, "inner", inner)
        object.__setattr__(self, "unknown", unknown)
        object.__setattr__(self, "shapes", shapes)

    def __repr__(self) -> str:
        """Return source, cells, and the occupied and unknown shares."""
        grid = self.grid
        known_occupied = self.outer
        unknown_text = ""
        if self.unknown is not None:
            known_occupied = self.outer & ~self.unknown
            unknown_text = f", {_percent_text(self.unknown)} unknown"
            if not self.outer[self.unknown].any():
                unknown_text += ", taken as free"
            elif self.outer[self.unknown].all():
                unknown_text += ", taken as occupied"
        cells = f"{' x '.join(map(str, grid.shape))} cells of {grid.spacing:g} {grid.unit}"
        occupied = f"{_percent_text(known_occupied)} occupied"
        return f"Workspace({self.source}: {cells}, {occupied}{unknown_text})"

    @classmethod
    @names_options
    def from_array(
        cls,
        occupied: ArrayLike | StrPath,
        spacing: float,
        lower: ArrayLike | None = None,
        *,
        inner: ArrayLike | None = None,
        lazy: bool = False,
    ) -> Workspace:
        """Make a workspace of an array of cells.

        A lazy array (zarr, dask, xarray on dask, ``numpy.memmap``) is read when needed: see
        ``LazyWorkspace``.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny) or (nx, ny, nz), or path-like
            Cells that meet an obstacle, indexed in the order of the coordinates; 0 and 1 are
            accepted. A path names a ``.npy`` file or a ``.zarr`` array. The coordinates of an
            xarray, if it has them, are the centers of the cells, in metres.
        spacing : float
            Side of a cell, in metres.
        lower : array-like, shape (d,), optional
            Lower corner of the first cell, in metres. If left out, it is that of an xarray's
            coordinates, or the origin.
        inner : array-like of bool, same shape, optional
            Cells that lie in obstacles; ``occupied`` if left out.
        lazy : bool
            Read the values of a ``.npy`` file when they are needed.

        Raises
        ------
        InputError
            If an array is empty, not boolean or of the wrong shape, or a number is invalid.
        """
        check_positive(spacing, "spacing", "metres, after the array of cells")
        # Open a file first. Then a lazy array stays as it is, and any other becomes an array.
        source = "array"
        array = occupied
        if isinstance(array, str | os.PathLike):
            from cspace._files.lazy_arrays import read_npy, read_zarr_array
            from cspace._support.limits import check_cells as check_file_cells

            source = str(array)
            if Path(array).suffix.lower() == ".zarr":
                array = read_zarr_array(array)
            else:
                array = read_npy(source)
                if not lazy:
                    check_file_cells(source, array.shape, memory=WORKSPACE_CELL_BYTES)
                    array = np.asarray(array)
        cells, own_lower = _place_cells(array, spacing, "occupied", stays_lazy=inner is None)
        dim = len(cells.shape)
        if lower is None:
            lower = np.zeros(dim) if own_lower is None else own_lower
        corner = check_point(lower, "lower", dim)
        if not isinstance(cells, np.ndarray):
            return LazyWorkspace(Grid(corner, spacing, cells.shape), cells, source)
        grid = Grid(corner, spacing, cells.shape)
        inside = cells
        if inner is not None:
            inside, inner_lower = _place_cells(inner, spacing, "inner")
            place = corner if own_lower is None else own_lower
            if inner_lower is not None and np.abs(inner_lower - place).max() > 1e-3 * spacing:
                problem = f"begins at {inner_lower.tolist()} but occupied at {place.tolist()}"
                raise InputError("inner", problem, "both must cover the same cells")
        return cls(grid, cells, inside, source=source)

    @classmethod
    def _from_ros_map(cls, path: StrPath, unknown: str = "occupied") -> Workspace:
        """Read the YAML file of a ROS map; see :meth:`open`."""
        from cspace._files.ros_maps import read_ros_map
        from cspace._raster.bitmaps import align_image

        check_word(unknown, "unknown", UNKNOWNS)
        image = read_ros_map(path, unknown)
        with _naming_file(path):
            grid, outer, inner, unseen = align_image(*image, unknown)
        return cls(grid, outer, inner, source=str(path), unknown=unseen)

    @classmethod
    @names_options
    def from_occupancy_grid(
        cls,
        msg: object,
        unknown: str = "occupied",
        *,
        free_thresh: float = 0.25,
        occupied_thresh: float = 0.65,
    ) -> Workspace:
        """Convert a ROS occupancy grid message; ROS itself is not needed.

        Parameters
        ----------
        msg : object, mapping or path-like
            With the fields of ``nav_msgs/OccupancyGrid``, of ROS 1 or 2, of rosbridge or
            :class:`cspace.ros.OccupancyGrid`, or a YAML file of them: ``info.resolution``,
            ``width``, ``height`` and ``origin``, and ``data``, row by row in per cent, -1 for
            unknown. The yaw of the origin applies as in a ROS map. The resolution is a float32 in
            messages; it is read as the shortest decimal number that rounds to it: 0.05, not
            0.0500000007. The frame in the header becomes that of the :attr:`grid`.
        unknown : {"occupied", "free"}
            State of unknown cells: of value -1, or between the thresholds.
        free_thresh, occupied_thresh : float
            From 0 to 1: a cell is free below the first and occupied from the second on. The
            defaults are Nav2's, of its map saver. Costmaps that Nav2 publishes are already
            inflated: use 0.995 and 1.0 to read only their obstacles.

        Raises
        ------
        InputError
            If a field is missing or malformed, the origin is tilted, or an argument is invalid.
        FileError
            If the map has more cells than the limit, or than fit into memory.
        """
        from cspace._files.ros_maps import read_occupancy_grid
        from cspace._raster.bitmaps import align_image

        check_word(unknown, "unknown", UNKNOWNS)
        grid, outer, inner, unseen = align_image(
            *read_occupancy_grid(msg, free_thresh, occupied_thresh), unknown
        )
        return cls(grid, outer, inner, source="occupancy grid", unknown=unseen)

    @classmethod
    def _from_image(
        cls,
        path: StrPath,
        spacing: float,
        *,
        lower: ArrayLike | None = None,
        threshold: float = 0.5,
        dark: str = "occupied",
    ) -> Workspace:
        """Read an image, one cell per pixel; see :meth:`open`."""
        from cspace._files.images import read_image

        check_positive(spacing, "spacing")
        cells, unseen = read_image(path, spacing, threshold, dark)
        grid = Grid((0.0, 0.0) if lower is None else lower, spacing, cells.shape)
        return cls(grid, cells, cells, source=str(path), unknown=unseen)

    @classmethod
    def _from_movingai(cls, path: StrPath, spacing: float = 1.0) -> Workspace:
        """Read a map of the MovingAI benchmarks, whose lower corner is the origin."""
        from cspace._files.images import read_movingai_map, read_movingai_voxels

        is_in_space = Path(path).suffix.lower() == ".3dmap"
        cells = read_movingai_voxels(path) if is_in_space else read_movingai_map(path)
        return cls(Grid(np.zeros(cells.ndim), spacing, cells.shape), cells, cells, source=str(path))

    @classmethod
    def _of(
        cls,
        shapes: Sequence[Shape],
        spacing: float,
        bounds: ArrayLike | None,
        source: str,
        kind: str = "",
        points: Floats | None = None,
        lazy: bool = False,
    ) -> Workspace:
        """Rasterize shapes of one dimension on a grid.

        The grid covers the bounds, or the bounding box of the shapes. If ``kind`` names the
        shapes, warn if the extent of their points, or of their corners, can hardly be in metres.
        ``points`` are where they were before an offset moved them.
        """
        from cspace._obstacles import Obstacle, ShapeCells

        check_positive(spacing, "spacing")
        # The box around the boxes of all shapes; each is (lower, upper), shape (2, dim).
        lowers, uppers = zip(*(shape.outer.bounds for shape in shapes), strict=True)
        corners = np.stack([np.min(lowers, axis=0), np.max(uppers, axis=0)])
        box = corners if bounds is None else check_bounds(bounds, shapes[0].dim)
        if kind in _MOVABLE:
            hint = _suggest_offset(box, spacing, bounds is not None)
            check_reach(float(np.abs(box).max()) / spacing, "grid", "the origin", hint)
        grid = covering_grid(box, spacing, 0 if lazy else count_cell_bytes(shapes))
        extent = corners
        if points is not None:
            extent = np.stack([points.min(axis=0), points.max(axis=0)])
        if kind:
            warn_of_units(extent, spacing, kind, bounds is not None)
        if points is not None or shapes[0].kind == "polygon":
            warn_of_likely_degrees(box if points is None else extent, source)
        if lazy:
            return LazyWorkspace(grid, ShapeCells(shapes[0], grid), source, tuple(shapes))
        if len(shapes) == 1:
            outer, inner = shapes[0].cells(grid)
        else:
            outer = np.zeros(grid.shape, dtype=np.bool_)
            inner = np.zeros(grid.shape, dtype=np.bool_)
            for shape in shapes:
                obstacle = Obstacle.of(shape, grid)
                window = tuple(map(slice, *obstacle.box))
                outer[window] |= obstacle.outer
                inner[window] |= obstacle.inner
        warn_of_nothing(outer, grid, corners)
        return cls(grid, outer, inner, source=source, shapes=tuple(shapes))

    @classmethod
    def _of_scene(
        cls,
        read: Callable[[], tuple[list[Shape], str, str]],
        spacing: float,
        bounds: ArrayLike | None,
    ) -> Workspace:
        """Rasterize a scene, whose shapes, source and frame ``read`` returns."""
        box = check_extent(spacing, bounds, 3)
        shapes, source, frame = read()
        workspace = cls._of(shapes, spacing, box, source, "planning scene")
        return replace(workspace, grid=replace(workspace.grid, frame_id=frame))

    @classmethod
    @names_options
    def from_shapes(
        cls, shapes: Iterable[ShapeLike], spacing: float, bounds: ArrayLike | None = None
    ) -> Workspace:
        """Rasterize shapes of any kind.

        All lie in the plane, or all in space.

        Parameters
        ----------
        shapes : iterable of Shape, Robot, shapely geometry, trimesh.Trimesh, str, ...
            As for :meth:`cspace.CSpace.add_obstacle`, in metres. A robot, or a text such as
            ``"ellipse:0.5,0.3@2,1"``, is placed with its reference point at the origin of the map.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (2 d,) or (2, d), optional
            Lower, then upper corner of the map, in metres; the bounding box of the shapes if left
            out. **Obstacles are clipped to it.**

        Raises
        ------
        InputError
            If there is no shape, a shape is invalid, their dimensions differ, or the map does not
            fit into memory. For shapes with names, build the map first and
            :meth:`cspace.CSpace.add_obstacle` each of them.
        FileError
            If a file is missing or malformed.

        Examples
        --------
        >>> import cspace, shapely
        >>> disc = cspace.Robot.disc(0.5, (3, 1))
        >>> shapes = [shapely.box(0, 0, 1, 3), disc, "ellipse:0.6,0.3@2,2.5"]
        >>> cspace.Workspace.from_shapes(shapes, 0.1, bounds=(0, 0, 4, 3))
        Workspace(3 shapes: 40 x 30 cells of 0.1 m, 42.5 % occupied)
        """
        if isinstance(shapes, Mapping | str) or not isinstance(shapes, Iterable):
            raise make_kind_error(shapes, "shapes", "it must be a list of shapes")
        check_own_crs(shapes, "shapes")
        made = [as_shape(shape, name=f"shapes[{index}]") for index, shape in enumerate(shapes)]
        if not made:
            raise InputError("shapes", "is empty", "at least one shape is needed")
        place = made[0].place
        for index, shape in enumerate(made):
            shape.outer.boundary()  # raises the errors of later exact queries now
            if shape.place != place:
                problem = f"is in {shape.place}"
                rule = f"all must be in {place}, as shapes[0] is"
                raise InputError(f"shapes[{index}]", problem, rule)
        source = "1 shape" if len(made) == 1 else f"{len(made)} shapes"
        return cls._of(made, spacing, bounds, source, "set of shapes")

    @property
    def cells(self) -> Source:
        """Source of the cells, read by boxes."""
        from cspace._obstacles import CellsInMemory

        return CellsInMemory(self.outer, self.inner)

    @property
    def obstacles(self) -> tuple[Shape, ...]:
        """The obstacles as shapes.

        They are :attr:`shapes`, or one shape of the outer cells; empty if no cell is occupied.
        """
        if self.shapes is not None:
            return self.shapes
        if not self.outer.any():
            return ()
        return (Voxels(self.outer, self.grid.spacing, np.asarray(self.grid.lower)),)

    @classmethod
    @names_options
    def from_polygons(
        cls,
        polygons: Geometries,
        spacing: float,
        bounds: ArrayLike | None = None,
        *,
        offset: ArrayLike | None = None,
        lazy: bool = False,
    ) -> Workspace:
        """Rasterize polygons, lines and points in the plane.

        ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        polygons : shapely geometry, GeoJSON mapping, WKT string, path-like, or iterable of these
            Closed sets, in metres, without z; files end in ``.geojson``, ``.json`` or ``.wkt``.
            Also objects with ``__geo_interface__``, such as a GeoDataFrame, and zone sets of VDA
            5050, of which zones of type BLOCKED are read.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (4,) or (2, 2), optional
            ``xmin, ymin, xmax, ymax`` of the map, as in shapely, or its lower and its upper corner,
            as in trimesh, in metres; the bounding box of the obstacles if left out. The grid begins
            at the lower corner and covers the upper one, except for a strip of at most 1e-9 cells
            due to rounding. **Obstacles are clipped to it.**
        offset : array-like, shape (2,), optional
            Metres added to all coordinates, before the bounds apply. It moves a frame whose origin
            is far away, such as UTM, to the map.
        lazy : bool
            Rasterize cells when they are read: see ``LazyWorkspace``.

        Raises
        ------
        GeometryError
            If a geometry is empty, self-crossing, not finite or not in the plane; the message names
            it.
        InputError
            If ``bounds`` is reversed or a number is invalid.
        FileError
            If the file is missing or malformed.
        """
        import shapely

        from cspace._files.vector import POLYGON_SUFFIXES, read_shapes

        bounds = check_extent(spacing, bounds, 2)
        geometries = read_shapes(polygons)
        points = None
        if offset is not None:
            step = check_point(offset, "offset", 2)
            points = shapely.total_bounds(geometries).reshape(2, 2)
            geometries = list(shapely.transform(geometries, lambda points: points + step))
        shape = Polygons(geometries)
        count = len(shape.geometries)
        source = "1 polygon" if count == 1 else f"{count} polygons"
        is_text = isinstance(polygons, str | os.PathLike)  # a path, or WKT
        if is_text and str(polygons).lower().endswith(POLYGON_SUFFIXES):
            source = str(polygons)
        return cls._of([shape], spacing, bounds, source, "set of polygons", points, lazy)

    @classmethod
    @names_options
    def from_mesh(
        cls,
        mesh: MeshLike,
        spacing: float,
        bounds: ArrayLike | None = None,
        *,
        solid: Solid = "auto",
        up: Up | None = None,
        offset: ArrayLike | None = None,
        lazy: bool = False,
    ) -> Workspace:
        """Rasterize a triangle mesh in space; ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        mesh : trimesh.Trimesh, trimesh.Scene, path-like, or (vertices, faces)
            Metres; files are ``.stl``, ``.obj``, ``.ply``, ``.glb``, ``.gltf`` and ``.dae``.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (6,) or (2, 3), optional
            ``xmin, ymin, zmin, xmax, ymax, zmax`` of the map, or its lower and its upper corner, in
            metres; the bounding box of the mesh if left out, as for :meth:`from_polygons`.
            **Obstacles are clipped to it.**
        solid : {"auto", "surface", "fill"}
            Parts with an interior. "auto": the closed parts, with a warning if others are open.
            "surface": none. "fill": all that the surface encloses at this spacing, with a warning
            if an open mesh encloses no cell.
        up : {"x", "y", "z"}, optional
            Axis that points up and becomes z; see :func:`cspace.make_mesh`.
        offset : array-like, shape (3,), optional
            As for :meth:`from_polygons`.
        lazy : bool
            As for :meth:`from_polygons`; not for "fill", which needs all cells at once.

        Raises
        ------
        GeometryError
            If the mesh has no triangle or a vertex is NaN or infinite.
        InputError
            If ``bounds`` is reversed, a number or word is invalid, or the map does not fit into
            memory.
        FileError
            If the file is missing or malformed.
        """
        bounds = check_extent(spacing, bounds, 3)
        from cspace._shapes.mesh import make_mesh

        shape = make_mesh(mesh, solid, up)
        warn_of_rounding(mesh, shape.vertices, spacing)
        if offset is not None:
            shape = replace(shape, vertices=shape.vertices + check_point(offset, "offset", 3))
        source = str(mesh) if isinstance(mesh, str | os.PathLike) else shape.source
        if shape.solid != "fill":
            return cls._of([shape], spacing, bounds, source, "mesh", lazy=lazy)
        if lazy:
            problem = "is True with solid='fill'"
            raise InputError("lazy", problem, "filling needs all cells at once")
        workspace = cls._of([shape], spacing, bounds, source, "mesh")
        # The filled cells depend on the spacing, so the mesh does not stand for them.
        return replace(workspace, shapes=None)

    @classmethod
    @names_options
    def from_balls(
        cls,
        centers: ArrayLike | BallSet,
        radii: ArrayLike | None = None,
        spacing: float = 0.0,
        bounds: ArrayLike | None = None,
    ) -> Workspace:
        """Rasterize balls in space or discs.

        Discs lie in the plane. ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        centers : array-like, shape (n, 2) or (n, 3), or BallDecomposition
            Metres. A decomposition has its own radii.
        radii : array-like, shape (n,), or one number
            Metres, zero or above.
        spacing : float
            Side of a cell, in metres; needed.
        bounds : array-like, shape (2 d,) or (2, d), optional
            Lower, then upper corner of the map, in metres; the bounding box of the balls if left
            out. **Obstacles are clipped to it.**

        Raises
        ------
        InputError
            If shapes of arrays disagree, a value is invalid, or the map does not fit into memory.
        """
        balls = Balls.of(centers, radii)
        return cls._of([balls], spacing, bounds, f"{len(balls.radii)} balls")

    @classmethod
    @names_options
    def from_heights(
        cls,
        heights: ArrayLike,
        spacing: float,
        lower: ArrayLike | None = None,
        *,
        bottom: float | None = None,
        top: float | None = None,
        unknown: str | None = None,
    ) -> Workspace:
        """Fill each column of cells up to a height, as of a terrain.

        ``outer`` cells are filled in part, ``inner`` ones wholly.

        Parameters
        ----------
        heights : array-like, shape (nx, ny)
            Height of each cell's highest point, metres, indexed ``[x, y]``. NaN and heights beyond
            9,998 m, such as -9999, are no data. The coordinates of an xarray, if it has them, are
            the centers of the cells.
        spacing : float
            Side of a cell, in metres.
        lower : array-like, shape (2,), optional
            Lower corner of the first column, metres. If left out, it is that of an xarray's
            coordinates, or the origin.
        bottom, top : float, optional
            Heights between which the map lies, metres; the lowest and the highest height if left
            out.
        unknown : {"occupied", "free"}, optional
            State of columns without data; they are refused if it is left out.

        Raises
        ------
        InputError
            If an array or a number is invalid, a column has no data, or the map does not fit into
            memory.
        """
        from cspace._files.rasters import place_raster

        spacing = check_positive(spacing, "spacing", "metres, after the array of heights")
        if unknown is not None:
            check_word(unknown, "unknown", UNKNOWNS)
        check_unit(heights, "heights")
        placed, corner = place_raster(heights, spacing, "heights")
        check_dims(placed, "heights")
        surface = np.array(check_real(placed, "heights"), dtype=np.float64)
        # Files write -9999, -32768 or 3.4e38 where they have no data.
        missing = ~(np.abs(surface) < 9999.0)
        if surface.ndim != 2 or missing.all():
            problem = f"has shape {surface.shape} and {np.count_nonzero(~missing)} heights"
            raise InputError("heights", problem, "it must have the axes x, y, and a height")
        if missing.any() and unknown is None:
            problem = f"has {np.count_nonzero(missing)} columns without data"
            hint = "pass unknown='occupied' or unknown='free'"
            raise InputError("heights", problem, "each must have a height", hint)
        known = surface[~missing]
        corner = np.zeros(2) if corner is None else corner
        corner = corner if lower is None else check_point(lower, "lower", 2)
        low, high = check_point(
            (known.min() if bottom is None else bottom, known.max() if top is None else top),
            "bottom and top",
        )
        layers = max(1, math.ceil((high - low) / spacing - _SLIVER))
        shape = (*surface.shape, layers)
        needed = WORKSPACE_CELL_BYTES * float(math.prod(shape))
        check_memory(needed, "the map", PlannedGrid(shape, spacing))
        grid = Grid((*corner, low), spacing, shape)
        surface[missing] = -np.inf if unknown == "free" else np.inf
        faces = grid.lower[2] + spacing * np.arange(grid.shape[2] + 1)
        outer = surface[..., np.newaxis] > faces[:-1]
        inner = (surface[..., np.newaxis] >= faces[1:]) & ~missing[..., np.newaxis]
        unseen = np.broadcast_to(missing[..., np.newaxis], grid.shape)
        return cls(grid, outer, inner, source="heights", unknown=unseen)

    def between(self, bottom: float, top: float) -> Workspace:
        """Return the obstacles between two heights, metres, as a workspace in the plane.

        It is the world of a robot in the plane whose parts have these heights. Obstacles that touch
        a height count; beyond the heights of the map there are none.

        Raises
        ------
        InputError
            If the workspace is in the plane, or no cell lies between the heights.
        """
        grid = self.grid
        if grid.dim != 3:
            raise InputError("workspace", "is in the plane", "heights are those of one in space")
        faces = grid.lower[2] + grid.spacing * np.arange(grid.shape[2] + 1)
        bottom, top = check_number(bottom, "bottom"), check_number(top, "top")
        layers = (faces[1:] >= bottom) & (faces[:-1] <= top)
        if not (bottom <= top and layers.any()):
            problem = f"are {bottom:g} and {top:g} m"
            rule = f"they must ascend, and meet the map, from {faces[0]:g} to {faces[-1]:g} m"
            raise InputError("bottom and top", problem, rule)
        plane = Grid(grid.lower[:2], grid.spacing, grid.shape[:2], frame_id=grid.frame_id)
        outer = np.asarray(self.outer[..., layers].any(axis=2))
        inner = np.asarray(self.inner[..., layers].any(axis=2))
        return Workspace(plane, outer, inner, source=f"{self.source} at {bottom:g} to {top:g} m")

    @classmethod
    @names_options
    def from_points(
        cls,
        points: ArrayLike | StrPath,
        spacing: float,
        bounds: ArrayLike | None = None,
        *,
        radius: float = 0.0,
        drop_missing: bool = False,
        offset: ArrayLike | None = None,
    ) -> Workspace:
        """Rasterize a point cloud, as points or as balls.

        Parameters
        ----------
        points : array-like, shape (n, 2) or (n, 3), or path-like
            Metres; files are ``.npy``, ``.xyz``, ``.txt``, ``.csv``, ``.ply`` and ``.pcd``, of
            points in space.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (2 d,) or (2, d), optional
            As for :meth:`from_balls`.
        radius : float
            Radius of the balls, metres, zero or above.
        drop_missing : bool
            Leave out points that are not finite: many sensors write NaN where they saw nothing,
            which is neither free nor occupied.
        offset : array-like, shape (d,), optional
            As for :meth:`from_polygons`.

        Raises
        ------
        InputError
            As :meth:`from_balls`.
        FileError
            If the file is missing, truncated or malformed.
        """
        from cspace._files.fields import warn_of_names
        from cspace._files.point_clouds import read_points

        if isinstance(points, str | os.PathLike):
            bounds = check_extent(spacing, bounds, 3)
            cloud = Balls.of(read_points(points, drop_missing), radius, ("points", "radius"))
            source = str(points)
        else:
            check_positive(spacing, "spacing")
            warn_of_names("points", find_sizes(list_columns(points)), ())
            centers = select_positions(points, "points")
            if drop_missing:
                centers = centers[np.isfinite(centers).all(axis=-1)]
            cloud = Balls.of(centers, radius, ("points", "radius"))
            source = f"{len(cloud.radii)} points"
            points = centers
        given = cloud.centers
        warn_of_rounding(points, given, spacing)
        if offset is not None:
            cloud = Balls(cloud.centers + check_point(offset, "offset", cloud.dim), cloud.radii)
        # The extent of the points shows a wrong unit; the balls around them would hide it.
        return cls._of([cloud], spacing, bounds, source, "cloud", given)

    @classmethod
    def _from_octomap(
        cls, path: StrPath, unknown: str = "occupied", bounds: ArrayLike | None = None
    ) -> Workspace:
        """Read an OctoMap at finest resolution; see :meth:`open`."""
        from cspace._files.octomap import read_octomap

        check_word(unknown, "unknown", UNKNOWNS)
        box = None if bounds is None else check_bounds(bounds, 3)
        lower, spacing, cells, unseen = read_octomap(path, unknown == "occupied", box)
        with _naming_file(path):
            grid = Grid(lower, spacing, cells.shape)
        return cls(grid, cells, cells, source=str(path), unknown=unseen)

    @classmethod
    @names_options
    def from_moveit_scene(
        cls,
        source: object,
        spacing: float,
        bounds: ArrayLike | None = None,
        *,
        package_dirs: StrPath | Sequence[StrPath] = (),
    ) -> Workspace:
        """Read the obstacles of a MoveIt planning scene.

        Boxes, spheres, cylinders, cones and meshes of collision objects are read; all objects must
        be in one frame, the planning frame, which becomes that of the :attr:`grid`. Cylinders and
        cones lie between two polyhedra, as :meth:`cspace.Robot.cylinder` does.

        Parameters
        ----------
        source : path-like, mapping, or message
            A ``moveit_msgs/PlanningScene``, a mapping with its fields, or a file of it in YAML: as
            ROS prints it, or as MotionBenchMaker and robowflex write it.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (6,) or (2, 3), optional
            As for :meth:`from_mesh`.
        package_dirs : path-like, or sequence of path-like
            Folders that hold the folders of packages, for meshes, as for
            :meth:`cspace.Robot.from_urdf`.

        Raises
        ------
        FileError
            If a file is missing or malformed, only changes another scene, or holds anything else:
            an OctoMap, a plane, a subframe, a transform, a padded link, a primitive of another
            type, or an unknown field. For a mapping or a message, InputError.
        GeometryError
            If a mesh has no triangle, or there is no shape at all.
        InputError
            If ``bounds`` is reversed, a number is invalid, or the map does not fit into memory.

        See Also
        --------
        cspace.arms.read_moveit_scene : The same obstacles for an arm.
        """
        from cspace._files.formats import read_obstacles

        return cls._of_scene(partial(read_obstacles, source, package_dirs), spacing, bounds)

    @classmethod
    def open(cls, path: StrPath, **options: Unpack[OpenOptions]) -> Workspace:
        """Read a workspace from a file, in the format of its suffix.

        The image of a ROS map becomes cells as in map_server of ROS 1 and Navigation2. Here *shade*
        is the mean of the colour channels from 0 (black) to 1 (white); ``p = 1 - shade``, or ``p =
        shade`` if ``negate`` is 1:

        * ``trinary`` (the default): ``p >= occupied_thresh`` is occupied, ``p < free_thresh`` is
          free, the rest is unknown. Grey 205, which map savers write for unknown cells, is unknown
          also if it is below ``free_thresh``, and in a JPEG, or beside grey 205, so are greys up to
          229; a warning counts such cells;
        * ``scale``: ``p < free_thresh`` is free, except grey 205 as in ``trinary``, and the rest is
          occupied, because a cell with some probability of being occupied is not proven free;
        * ``raw``: ``round(255 * shade)`` is the occupancy in per cent; below ``100 * free_thresh``
          is free, up to 100 is occupied, above is unknown.

        A pixel that is not fully opaque is unknown, as in Navigation2 since 2025, and in ``raw``
        mode too. Releases disagree about ``p`` equal to a threshold; here it is never free.

        An image has one cell per pixel; its first row is the top, after its EXIF orientation, and
        pixels that are not fully opaque are occupied. In a ``.map`` of MovingAI, ``.``, ``G`` and
        ``S`` are passable, ``@``, ``O``, ``T`` and ``W`` blocked, and the first row is the top.

        Parameters
        ----------
        path : path-like
            A map, an image, polygons, a mesh, an OctoMap, a point cloud or an array. The page on
            files (docs/reference/files.md) has a table of all suffixes.
        unknown : {"occupied", "free"}
            State of unknown cells of a ROS map or an OctoMap.
        spacing : float
            Side of a cell or pixel, in metres; not for ROS maps and OctoMaps, and 1 m by default
            for MovingAI.
        lower : array-like, shape (d,), optional
            Lower corner of an image or an array, in metres; by default the origin.
        threshold : float
            Pixels of an image are dark if the mean of their colour channels, from 0 (black) to 1
            (white), is below this; 0.5 by default.
        dark : {"occupied", "free"}
            State of dark pixels of an image; bright pixels have the other.
        bounds : array-like, shape (2 d,) or (2, d), optional
            Lower, then upper corner of the map, in metres, for polygons, meshes and points, and for
            an OctoMap, whose whole cells cover them; by default those of what is known. **Obstacles
            are clipped to it.**
        **options
            ``offset``, ``solid``, ``up``, ``radius``, ``drop_missing``, ``inner`` and ``lazy``: of
            :meth:`from_polygons`, :meth:`from_mesh`, :meth:`from_points` and :meth:`from_array`.

        Raises
        ------
        InputError
            If the suffix is unknown, an option does not apply to the format, ``spacing`` is
            missing, or a value is invalid.
        FileError
            If the file is missing, truncated or malformed.

        Warns
        -----
        UnitWarning
            If a GeoTIFF states its placement, which is not read.
        """
        reader = reader_of(path, options)
        for name, parameter in _options_of(reader).items():
            if parameter.default is parameter.empty and name not in options:
                rule = "it is in metres, and not in the file"
                raise _make_option_error(path, name, "is missing", rule)
        return reader(path, **options)

    plot = _outside.plot
    _repr_png_ = _outside.show_png


class LiveWorkspace(Workspace):
    """A workspace to whose cells a map's updates write, so that other maps copy them first."""

    __slots__ = ()


class LazyWorkspace(Workspace):
    """A workspace whose cells are read or rasterized when they are needed.

    :func:`cspace.build` with a ``store`` reads a tile at a time. Any other use reads all cells into
    memory, if they fit, at the first access.

    Parameters
    ----------
    grid : Grid
    cells : cspace._obstacles.Source
    source : str
        File or kind of input, for messages.
    shapes : tuple or None
        The obstacles as shapes, metres.
    """

    __slots__ = ("_cells", "_whole")

    _cells: Source
    _whole: list[tuple[Bools, Bools]]

    def __init__(
        self, grid: Grid, cells: Source, source: str, shapes: tuple[Shape, ...] | None = None
    ) -> None:
        """Keep the source of the cells, as frozen as its base."""
        object.__setattr__(self, "grid", grid)
        object.__setattr__(self, "source", source)
        object.__setattr__(self, "shapes", shapes)
        object.__setattr__(self, "unknown", None)
        object.__setattr__(self, "_cells", cells)
        object.__setattr__(self, "_whole", [])

    @property
    def cells(self) -> Source:
        """Source of the cells, read by boxes."""
        return self._cells

    @property
    def outer(self) -> Bools:
        """Cells that meet an obstacle; the first access reads all cells."""
        return self._read()[0]

    @property
    def inner(self) -> Bools:
        """Cells that lie in obstacles; the first access reads all cells."""
        return self._read()[1]

    def _read(self) -> tuple[Bools, Bools]:
        """Return the outer and inner cells; the first call reads them."""
        if not self._whole:
            grid = self.grid
            planned = PlannedGrid(grid.shape, grid.spacing)
            check_memory(count_cell_bytes(self.shapes) * grid.size, "the workspace", planned)
            whole_grid = tuple(slice(0, n) for n in grid.shape)
            outer, inner = map(frozen, self.cells.read(whole_grid))
            if np.array_equal(outer, inner):
                inner = outer
            self._whole.append((outer, inner))
        return self._whole[0]

    def __repr__(self) -> str:
        """Return source and number of cells."""
        shape = " x ".join(map(str, self.grid.shape))
        cells = f"{shape} cells of {self.grid.spacing:g} m"
        return f"LazyWorkspace({self.source}: {cells}, read at need)"

    def __reduce__(
        self,
    ) -> tuple[type[LazyWorkspace], tuple[Grid, Source, str, tuple[Shape, ...] | None]]:
        """Pickle the source of the cells, not the cells."""
        return LazyWorkspace, (self.grid, self.cells, self.source, self.shapes)


def count_cell_bytes(shapes: Sequence[Shape] | None) -> int:
    """Return the bytes for each cell while shapes are rasterized, or cells without shapes read."""
    if shapes is None:
        return WORKSPACE_CELL_BYTES + 1  # while both bitmaps are compared
    is_simple = len(shapes) == 1 and shapes[0].kind != "mesh"
    return SHAPE_CELL_BYTES if is_simple else MESH_CELL_BYTES


def load_workspace(workspace: Workspace) -> Workspace:
    """Return a workspace with all its cells in memory."""
    if not isinstance(workspace, LazyWorkspace):
        return workspace
    source = workspace.source
    shapes = workspace.shapes
    return Workspace(workspace.grid, workspace.outer, workspace.inner, source=source, shapes=shapes)


@contextmanager
def _naming_file(path: StrPath) -> Iterator[None]:
    """Turn InputErrors of the block into FileErrors with the file's name."""
    try:
        yield
    except InputError as error:
        problem = f"{error.argument} {error.problem}"
        raise FileError(os.fspath(path), problem, error.rule, error.hint) from error


def copy_workspace(workspace: Workspace, kind: type[Workspace] = Workspace) -> Workspace:
    """Copy a workspace and its arrays, as one of this kind."""
    outer = frozen(workspace.outer.copy())
    inner = outer if workspace.inner is workspace.outer else frozen(workspace.inner.copy())
    unknown = None if workspace.unknown is None else frozen(workspace.unknown.copy())
    return kind(workspace.grid, outer, inner, workspace.source, unknown, workspace.shapes)


def reader_of(path: StrPath, options: Iterable[str] = ()) -> Callable[..., Workspace]:
    """Return the classmethod that reads a file with these options.

    Raises InputError if the suffix is unknown or an option does not apply, and FileError if the
    format depends on the content and the file is missing.
    """
    from cspace._files.formats import find_constructor

    reader: Callable[..., Workspace] = getattr(Workspace, find_constructor(path))
    accepted = _options_of(reader)
    for name in options:
        if name not in accepted:
            rule = f"its format takes {', '.join(accepted)}"
            raise _make_option_error(path, name, "is given", rule)
    return reader


def _make_option_error(path: StrPath, name: str, problem: str, rule: str) -> CspaceError:
    """Make the error for an option of a file, or for the file if it is missing."""
    from cspace._files.access import suggest_file
    from cspace._files.plain import read_document

    file = Path(path)
    if not os.path.exists(file):  # noqa: PTH110 - a Path refuses long names
        return FileError(str(file), "does not exist", "it must be a plain file", suggest_file(file))
    hint = ""
    with suppress(CspaceError):
        hint = suggest_call(read_document(path, "file"), str(file))
    return InputError(name, f"{problem} for {file}", rule, hint)


def measure_shapes(path: StrPath, **options: Any) -> tuple[Floats, dict[str, object]] | None:
    """Return the bounding box and facts of the shapes in a file, without rasterizing them.

    The box has shape (2, d), metres. A file of cells gives None. ``options`` are those of
    :meth:`Workspace.open`; raises errors as it does.
    """
    import shapely

    from cspace._files.point_clouds import read_points
    from cspace._files.vector import read_shapes

    match reader_of(path, options).__name__:
        case "from_mesh":
            from cspace._shapes.mesh import make_mesh

            mesh = make_mesh(path, options.get("solid", "auto"))
            return np.array(mesh.bounds), mesh.facts
        case "from_points":
            points = read_points(path, options.get("drop_missing", False))
            box = np.array([points.min(axis=0), points.max(axis=0)])
            facts: dict[str, object] = {"points": len(points)}
        case "from_polygons":
            shapes = read_shapes(path)
            count = int(shapely.get_num_coordinates(shapes).sum())
            box = shapely.total_bounds(shapes).reshape(2, 2)
            facts = {"shapes": len(shapes), "points": count}
        case _:
            return None
    warn_of_likely_degrees(box, os.fspath(path))
    return box, facts


def _options_of(reader: Callable[..., Workspace]) -> dict[str, inspect.Parameter]:
    """Return the parameters of a reader except the path, which comes first."""
    _, *options = inspect.signature(reader).parameters.values()
    return {option.name: option for option in options}


def check_extent(spacing: float, bounds: ArrayLike | None, dim: int) -> Floats | None:
    """Check a map's spacing before reading a file; return its corners, if it has bounds."""
    check_positive(spacing, "spacing")
    return None if bounds is None else check_bounds(bounds, dim)


def covering_shape(corners: Floats, spacing: float) -> list[int]:
    """Return the cells along each axis of the grid between corners."""
    lower, upper = corners
    with np.errstate(over="ignore"):
        counts = np.maximum(1.0, np.ceil((upper - lower) / spacing - _SLIVER))
    # Numbers beyond int64 are refused later, because they do not fit into memory.
    return [int(min(n, FARTHEST_CELL)) for n in counts]


def covering_grid(corners: Floats, spacing: float, bytes_a_cell: int) -> Grid:
    """Return the grid between two corners, shape (2, dim).

    Raises InputError if its cells do not fit into memory.
    """
    # No raster can tell such numbers from zero, and shapely fails on numbers below 1e-308.
    corners = np.where(np.abs(corners) < _ZERO_BOUND * spacing, 0.0, corners)
    shape = covering_shape(corners, spacing)
    check_memory(bytes_a_cell * float(math.prod(shape)), "the map", PlannedGrid(shape, spacing))
    return Grid(corners[0], spacing, shape)


def _suggest_offset(corners: Floats, spacing: float, bounded: bool) -> str:
    """Return a hint that moves the corners of a map, shape (2, d), to the origin, or ""."""
    lower, upper = corners
    if (upper - lower).max() > 0.5 * MAX_COORDINATE * spacing:
        return ""
    hint = f"pass offset=({', '.join(f'{-x:.0f}' for x in lower)})"
    return f"{hint}, with bounds that are moved so, too" if bounded else hint


def warn_of_units(corners: Floats, spacing: float, what: str, bounded: bool) -> None:
    """Warn if obstacles smaller than a cell suggest another unit.

    If the map has bounds, which are in metres, small obstacles may be intended; the limit is then a
    quarter of a cell. ``corners``, shape (2, d), is the box of the obstacles; a single point raises
    no warning. ``what`` names the obstacles in the message.
    """
    lower, upper = corners
    sides = upper - lower
    min_extent = _MIN_EXTENT_IN_BOUNDS if bounded else _MIN_EXTENT
    if 0.0 < sides.max() < min_extent * spacing:
        size = " m x ".join(f"{side:g}" for side in sides)
        warn_user(
            f"the {what} is {size} m large and fits into one cell of {spacing:g} m; units are "
            "metres",
            UnitWarning,
        )


def warn_of_rounding(source: object, points: Floats, spacing: float) -> None:
    """Warn of short coordinates that round over a tenth of a cell.

    ``source`` is the array or file of the points, shape (n, d).
    """
    if isinstance(source, str | os.PathLike):
        from cspace._files.lazy_arrays import read_npy

        suffix, name = Path(source).suffix.lower(), os.fspath(source)
        dtype = np.dtype(np.float32 if suffix in _SINGLE_SUFFIXES else np.float64)
        if suffix == ".npy":
            dtype = read_npy(source).dtype
    else:
        dtype = getattr(source, "dtype", np.dtype(np.float64))
        name = "points"
    if dtype.kind != "f" or dtype.itemsize >= np.float64().itemsize:
        return
    largest = np.abs(points).max(initial=0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # then they need more bits
        stored = points.astype(dtype)
        rounding = 0.5 * float(np.spacing(dtype.type(largest)))
    if rounding > 0.1 * spacing and (stored == points).all():
        warn_user(
            f"{name}: its numbers have {8 * dtype.itemsize} bits, which round coordinates near "
            f"{largest:.7g} m by up to {rounding:.2g} m, more than a tenth of a cell of "
            f"{spacing:g} m",
        )


def warn_of_nothing(outer: Bools, grid: Grid, corners: Floats) -> None:
    """Warn if no obstacle lies in the bounds of a map.

    ``corners``, shape (2, d), is the obstacles' box in metres.
    """
    if not outer.any():
        lower, upper = corners
        obstacles = f"from {in_metres(lower)} to {in_metres(upper)}"
        bounds = f"{in_metres(grid.lower)} to {in_metres(grid.upper)}"
        warn_user(
            f"the obstacles reach {obstacles} and none lies within the bounds, {bounds}; the map "
            "has no obstacle; units are metres"
        )


def _percent_text(cells: Bools) -> str:
    """Format the share of the cells that are set."""
    return f"{100.0 * np.count_nonzero(cells) / cells.size:.3g} %"


def in_metres(point: Iterable[float]) -> str:
    """Format a point as ``(x, y, z) m``."""
    return f"({', '.join(f'{x:g}' for x in point)}) m"


def _place_cells(
    array: Any, spacing: float, name: str, *, stays_lazy: bool = False
) -> tuple[Any, Floats | None]:
    """Return the cells of an array, checked, and the corner that its coordinates name.

    The cells are an array, or :class:`LazyCells` of an array that may stay lazy and is.
    """
    if type(array) is np.ndarray:  # it has no coordinates, and is in memory
        return check_cells(array, name), None
    from cspace._files.lazy_arrays import LazyCells, check_no_chunk_missing, is_lazy
    from cspace._files.rasters import place_raster

    array, lower = place_raster(array, spacing, name)
    check_no_chunk_missing(array)
    if stays_lazy and is_lazy(array):
        return LazyCells(array), lower
    return check_cells(array, name), lower

"""Workspace: obstacle cells on a grid."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats, StrPath, frozen
from cspace.check import check_bounds, check_cells, check_word, finite, positive
from cspace.errors import FileError, InputError, warn_user
from cspace.files.access import UNKNOWNS
from cspace.grid import SLACK, Grid
from cspace.limits import MESH_BYTES, WORKSPACE_BYTES, Planned, check_memory
from cspace.shapes import Balls, Mesh, Polygons, Shape, ShapeLike, Voxels, shape_of
from cspace.shown import WorkspacePlot

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.files.ros import GridMessage
    from cspace.files.urdf import PackageDirs
    from cspace.obstacles import Source
    from cspace.shapes.balls import BallSet
    from cspace.shapes.mesh import MeshLike, Solid

_IN_TILES = "build its map tile by tile, with cspace.build(..., store='map.zarr')"
Geometries: TypeAlias = "BaseGeometry | Mapping[str, object] | StrPath | Iterable[Geometries]"


_SLIVER: Final = 1e-9
"""Part of a cell that the upper bound may be off by rounding; far below the slack of an outer raster, so that an
obstacle in that sliver still marks the last cell."""

_NOUGHT: Final = SLACK / 2**14
"""Part of a cell below which a bound counts as zero."""

_SMALL: Final = 1.0 - 2.0**-20
"""Part of a cell below which all obstacles together are smaller than one, whatever the rounding."""

_SMALL_WITHIN: Final = 0.25
"""The same, where the map has bounds."""


class OpenOptions(TypedDict, total=False):
    """What :meth:`Workspace.open` takes beside a file's name."""

    spacing: float
    lower: ArrayLike
    bounds: ArrayLike
    inner: ArrayLike
    radius: float
    solid: Solid
    unknown: str
    threshold: float
    dark: str
    lazy: bool


@dataclass(frozen=True, slots=True, eq=False)
class Workspace(WorkspacePlot):
    """The obstacles, as two sets of closed cells: those that meet an obstacle, and those that lie in obstacles.

    A map that is itself a grid has both the same. Make one with a ``from_...`` method or :meth:`open`.

    Attributes
    ----------
    grid : Grid
    outer : ndarray of bool, shape grid.shape
        Cells that meet an obstacle; read-only, a copy of what was passed.
    inner : ndarray of bool, shape grid.shape
        Cells that lie in obstacles; the same object as ``outer`` for a map that is itself a grid.
    source : str
        What it was read from.
    unknown : ndarray of bool, shape grid.shape, or None
        Unknown cells of a sensor map, which count as free or as occupied by ``outer``; pictures
        draw them apart. None where there are none.
    shapes : tuple or None
        The obstacles themselves, metres, also where they reach out of the grid. None for a map that is itself a grid,
        whose outer cells are the obstacles. Exact look-ups use them.
    live : bool
        Whether it belongs to a map that is updated, which writes into its cells; other maps of it take a copy.

    Raises
    ------
    InputError
        If an array is not boolean (0 and 1 are accepted), does not have the grid's shape, or a cell is in ``inner``
        and not in ``outer``.

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
    live: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        outer = check_cells(self.outer, "outer")
        inner = outer if self.inner is self.outer else check_cells(self.inner, "inner")
        unknown = None if self.unknown is None else check_cells(self.unknown, "unknown")
        for name, cells in (("outer", outer), ("inner", inner), ("unknown", unknown)):
            if cells is not None and cells.shape != self.grid.shape:
                raise InputError(
                    name,
                    f"has shape {cells.shape} on a grid of {self.grid.shape}",
                    "both must be the same",
                    "pass one entry for each cell, indexed in the order of the coordinates",
                    value=cells,
                )
        if inner is not outer and (lost := inner > outer).any():
            problem = f"holds cell {tuple(np.argwhere(lost)[0].tolist())}, which is not in outer"
            raise InputError(
                "inner", problem, "a cell that lies in an obstacle also meets it", "add it to outer", value=self.inner
            )
        object.__setattr__(self, "shapes", None if self.shapes is None else tuple(self.shapes))
        object.__setattr__(self, "unknown", unknown if unknown is not None and unknown.any() else None)
        object.__setattr__(self, "outer", outer)
        object.__setattr__(self, "inner", outer if inner is outer or np.array_equal(inner, outer) else inner)

    def __repr__(self) -> str:
        grid, occupied, unknown = self.grid, np.count_nonzero(self.outer), ""
        if self.unknown is not None:
            count, taken = int(np.count_nonzero(self.unknown)), 0
            for outer, unseen in zip(self.outer, self.unknown, strict=True):  # slab by slab, to spare memory
                taken += int(np.count_nonzero(outer & unseen))
            occupied -= taken
            unknown = f", {100.0 * count / self.outer.size:.3g} % unknown"
            unknown += {0: ", taken as free", count: ", taken as occupied"}.get(taken, "")
        cells = f"{' x '.join(map(str, grid.shape))} cells of {grid.spacing:g} {grid.unit}"
        return f"Workspace({self.source}: {cells}, {100.0 * occupied / self.outer.size:.3g} % occupied{unknown})"

    @classmethod
    def from_array(
        cls,
        occupied: ArrayLike | StrPath,
        spacing: float,
        lower: ArrayLike | None = None,
        *,
        inner: ArrayLike | None = None,
        lazy: bool = False,
    ) -> Workspace:
        """Obstacles that are already cells of a grid: an array.

        A lazy array (zarr, dask, h5py, xarray on dask, ``numpy.memmap``) is not read: see
        :class:`cspace.workspace.LazyWorkspace`.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny) or (nx, ny, nz), or path-like
            Cells that meet an obstacle, indexed in the order of the coordinates; 0 and 1 are accepted. A path is that
            of a ``.npy`` file, or of an array in the Zarr format, ``.zarr``.
        spacing : float
            Side of a cell, in metres.
        lower : array-like, shape (d,), optional
            Lower corner of the first cell, in metres; the origin if left out.
        inner : array-like of bool, same shape, optional
            Cells that lie in obstacles; ``occupied`` if left out.
        lazy : bool
            Leave the values of a ``.npy`` file in it until they are used.

        Raises
        ------
        InputError
            If an array is empty, not boolean or of the wrong shape, or a number is not usable.
        """
        from cspace.files.formats import read_cells, read_zarr_array
        from cspace.limits import check_cells as check_file_cells
        from cspace.obstacles import Lazy, check_no_chunk_missing, is_away

        positive(spacing, "spacing", "metres, after the array of cells")
        source, array = "array", occupied
        if isinstance(array, str | os.PathLike):
            source = str(array)
            if Path(array).suffix.lower() == ".zarr":
                array = read_zarr_array(array)
            else:
                array = read_cells(source)
                if not lazy:
                    check_file_cells(source, array.shape, memory=WORKSPACE_BYTES)
                    array = np.asarray(array)
        check_no_chunk_missing(array)
        away = inner is None and is_away(array)
        cells = Lazy(array) if away else check_cells(array, "occupied")
        dim = len(cells.shape)
        corner = finite(np.zeros(dim) if lower is None else lower, "lower")
        if corner.shape != (dim,):
            rule = f"occupied has {dim} axes and lower must have as many coordinates"
            raise InputError("lower", f"is {lower!r}", rule, f"pass e.g. {(0.0,) * dim}", value=lower)
        if isinstance(cells, Lazy):
            return LazyWorkspace(Grid(corner, spacing, cells.shape), cells, source)
        made = cls(Grid(corner, spacing, cells.shape), cells, cells if inner is None else check_cells(inner, "inner"))
        return made if source == made.source else replace(made, source=source)

    @classmethod
    def from_ros_map(cls, path: StrPath, unknown: str = "occupied") -> Workspace:
        """A ROS map: a YAML file and the PGM or PNG image beside it.

        Modes, thresholds, ``negate`` and the origin with its yaw are honoured as
        :func:`cspace.files.ros.read_ros_map` says.

        Parameters
        ----------
        path : path-like
            The YAML file.
        unknown : {"occupied", "free"}
            What unknown cells are.

        Raises
        ------
        InputError
            If ``unknown`` is neither word.
        FileError
            If the YAML or its image is missing or malformed.
        """
        from cspace.files.ros import read_ros_map
        from cspace.raster.bitmaps import align_image

        check_word(unknown, "unknown", UNKNOWNS)
        image = read_ros_map(path)
        with _placing(path):
            grid, outer, inner, unseen = align_image(*image, unknown)
        return cls(grid, outer, inner, source=str(path), unknown=unseen)

    @classmethod
    def from_occupancy_grid(
        cls, msg: GridMessage, unknown: str = "occupied", *, free_thresh: float = 0.25, occupied_thresh: float = 0.65
    ) -> Workspace:
        """An occupancy grid of ROS, as a message; ROS itself is not needed.

        Parameters
        ----------
        msg : object
            With the fields of ``nav_msgs/OccupancyGrid``, of ROS 1 or 2 or
            :class:`cspace.files.ros.OccupancyGrid`: ``info.resolution``, ``width``, ``height`` and ``origin``, and
            ``data``, row by row in per cent, -1 where nothing is known. A yaw of the origin is honoured as that of a
            ROS map is. A resolution in single precision, as messages keep it, is the shortest number that becomes it:
            0.05, and not 0.0500000007.
        unknown : {"occupied", "free"}
            What unknown cells are: those of -1, and those between the thresholds.
        free_thresh, occupied_thresh : float
            From 0 to 1: below the first, a cell is free; from the second on, it is occupied. The defaults are those of
            Nav2's map saver. A costmap that Nav2 publishes is inflated already: with 0.995 and 1.0 only its obstacles
            are occupied.

        Raises
        ------
        InputError
            If a field is missing or not as it must be, the origin is tilted, or an argument is not usable.
        FileError
            If a turned map takes more cells than are read, or than fit into memory.
        """
        from cspace.files.ros import read_occupancy_grid
        from cspace.raster.bitmaps import align_image

        check_word(unknown, "unknown", UNKNOWNS)
        grid, outer, inner, unseen = align_image(*read_occupancy_grid(msg, free_thresh, occupied_thresh), unknown)
        return cls(grid, outer, inner, source="occupancy grid", unknown=unseen)

    @classmethod
    def from_image(
        cls,
        path: StrPath,
        spacing: float,
        *,
        lower: ArrayLike | None = None,
        threshold: float = 0.5,
        dark: str = "occupied",
    ) -> Workspace:
        """An image, one cell for each pixel; its first row is the top.

        Parameters
        ----------
        path : path-like
            Any image that Pillow reads.
        spacing : float
            Side of a pixel, in metres.
        lower : array-like, shape (2,), optional
            Lower left corner of the image, in metres; the origin if left out.
        threshold : float
            Pixels whose shade, the mean of their colour channels from 0 (black) to 1 (white), is below this are dark.
        dark : {"occupied", "free"}
            What dark pixels are; bright ones are the other. A pixel that is not fully opaque is occupied either way.

        Raises
        ------
        InputError
            If a number or word is not usable.
        FileError
            If the file is missing or cannot be decoded.
        """
        from cspace.files.images import read_image

        cells = read_image(path, threshold, dark)
        corner = (0.0, 0.0) if lower is None else lower
        return cls(Grid(corner, spacing, cells.shape), cells, cells, source=str(path))

    @classmethod
    def from_movingai(cls, path: StrPath, spacing: float = 1.0) -> Workspace:
        """A MovingAI ``.map`` in the plane, or ``.3dmap`` of voxels in space.

        In a ``.map``, ``.``, ``G`` and ``S`` are passable, ``@``, ``O``, ``T`` and ``W`` blocked.

        Parameters
        ----------
        path : path-like
            The first row of a ``.map`` is the top; the lower corner of the map is the origin.
        spacing : float
            Side of a cell, in metres.

        Raises
        ------
        InputError
            If ``spacing`` is not above zero.
        FileError
            If the file is missing, truncated or malformed; the message names the line.
        """
        from cspace.files.images import read_movingai_map, read_movingai_voxels

        solid = str(path).lower().endswith(".3dmap")
        cells = read_movingai_voxels(path) if solid else read_movingai_map(path)
        return cls(Grid(np.zeros(cells.ndim), spacing, cells.shape), cells, cells, source=str(path))

    @classmethod
    def _of(
        cls,
        shape: Shape,
        spacing: float,
        box: Floats | None,
        source: str,
        kind: str = "",
        points: Floats | None = None,
        cost: int = WORKSPACE_BYTES,
        lazy: bool = False,
    ) -> Workspace:
        """The cells of a shape, on the grid of a box, shape (2, dim), or else of its own bounds.

        Where ``kind`` names the shape, a warning says if the units of the points that it was made of, or else of its
        corners, can hardly be metres. ``cost`` is in bytes a cell.
        """
        corners = np.stack(shape.outer.bounds)
        grid = covering_grid(corners if box is None else box, spacing, 0 if lazy else cost)
        if kind:
            extent = corners if points is None else np.stack([points.min(axis=0), points.max(axis=0)])
            warn_of_units(extent, spacing, kind, box is not None)
        if lazy:
            from cspace.obstacles import Drawn

            return LazyWorkspace(grid, Drawn(shape, grid), source, (shape,))
        outer, inner = shape.cells(grid)
        warn_of_nothing(outer, grid, corners)
        return cls(grid, outer, inner, source=source, shapes=(shape,))

    @classmethod
    def from_shapes(cls, shapes: Iterable[ShapeLike], spacing: float, bounds: ArrayLike | None = None) -> Workspace:
        """Make a workspace of shapes of any kind, all in the plane or all in space.

        Parameters
        ----------
        shapes : iterable of Shape, Robot, shapely geometry, trimesh.Trimesh, str, ...
            Each is what :meth:`cspace.CSpace.add_obstacle` takes, also a robot or a short text such as
            ``"ellipse:0.5,0.3@2,1"``, whose reference point is then the origin of the map. Metres.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (2 d,) or (2, d), optional
            Lower, then upper corner of the map, in metres; the bounding box of the shapes if left out. **What lies
            outside it is clipped.**

        Raises
        ------
        InputError
            If there is no shape, one is not usable, they are not all in the plane or all in space, or the map does not
            fit into memory. For shapes with names, build the map first and :meth:`cspace.CSpace.add_obstacle` each of
            them.
        FileError
            If a file is missing or malformed.

        Examples
        --------
        >>> import cspace, shapely
        >>> shapes = [shapely.box(0, 0, 1, 3), cspace.Robot.disc(0.5, (3, 1)), "ellipse:0.6,0.3@2,2.5"]
        >>> cspace.Workspace.from_shapes(shapes, 0.1, bounds=(0, 0, 4, 3))
        Workspace(3 shapes: 40 x 30 cells of 0.1 m, 42.5 % occupied)
        """
        positive(spacing, "spacing")
        hint = "pass a list of them"
        if isinstance(shapes, Mapping):
            hint += "; obstacles with names are added to a map, with space.add_obstacle(name, shape)"
        if isinstance(shapes, Mapping | str) or not isinstance(shapes, Iterable):
            raise InputError("shapes", f"is a {type(shapes).__name__}", "it must be several shapes", hint, value=shapes)
        made = [shape_of(shape, name=f"shapes[{number}]") for number, shape in enumerate(shapes)]
        if not made:
            hint = "pass at least one, or use Workspace.from_array for a map without obstacles"
            raise InputError("shapes", "holds no shape", "obstacles must cover some ground", hint, value=shapes)
        for number, shape in enumerate(made):
            if shape.dim != made[0].dim:
                rule = f"shapes[0] is in {made[0].place}, and all must be alike"
                raise InputError(f"shapes[{number}]", f"is in {shape.place}", rule, "leave it out", value=shape)
        box = None if bounds is None else check_bounds(bounds, made[0].dim)
        return cls._of_shapes(made, spacing, box, f"{len(made)} shape{'s' * (len(made) > 1)}", "set of shapes")

    @classmethod
    def _of_shapes(
        cls, shapes: Sequence[Shape], spacing: float, box: Floats | None, source: str, kind: str
    ) -> Workspace:
        """Make a workspace of several shapes of one dimension; arguments are those of :meth:`_of`."""
        from cspace.obstacles import Obstacle

        bounds = np.array([shape.outer.bounds for shape in shapes])
        corners = np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
        grid = covering_grid(corners if box is None else box, spacing, MESH_BYTES)
        warn_of_units(corners, spacing, kind, box is not None)
        outer, inner = np.zeros((2, *grid.shape), dtype=np.bool_)
        for shape in shapes:
            part = Obstacle.of(shape, grid)
            window = tuple(map(slice, *part.box))
            outer[window] |= part.outer
            inner[window] |= part.inner
        warn_of_nothing(outer, grid, corners)
        return cls(grid, outer, inner, source=source, shapes=tuple(shapes))

    def in_memory(self) -> Workspace:
        """The same workspace, with all its cells in memory."""
        return self

    @property
    def cells(self) -> Source:
        """What the cells are read from, a box at a time."""
        from cspace.obstacles import Held

        return Held(self.outer, self.inner)

    @property
    def obstacles(self) -> tuple[Shape, ...]:
        """The obstacles as shapes: :attr:`shapes`, or else the outer cells; none where no cell is occupied."""
        if self.shapes is not None:
            return self.shapes
        if not self.outer.any():
            return ()
        return (Voxels(self.outer, self.grid.spacing, np.asarray(self.grid.lower)),)

    @classmethod
    def from_polygons(
        cls, polygons: Geometries, spacing: float, bounds: ArrayLike | None = None, *, lazy: bool = False
    ) -> Workspace:
        """Polygons, lines and points in the plane, rasterised so that ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        polygons : shapely geometry, GeoJSON mapping, WKT string, path-like, or iterable of these
            Closed sets, in metres, without z; files end in ``.geojson``, ``.json`` or ``.wkt``.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (4,) or (2, 2), optional
            ``xmin, ymin, xmax, ymax`` of the map, as shapely has them, or its lower and its upper corner, as trimesh
            has them, in metres; the bounding box of the obstacles if left out. The grid begins at the lower corner and
            has as many cells as reach the upper one, less a strip of up to 1e-9 cells from rounding. **What lies
            outside it is clipped.**
        lazy : bool
            Rasterise them only where cells are read, and not now: see :class:`cspace.workspace.LazyWorkspace`.

        Raises
        ------
        GeometryError
            If a geometry is empty, self-crossing, not finite or not in the plane; the message says which.
        InputError
            If ``bounds`` is reversed or a number is not usable.
        FileError
            If the file is missing or malformed.
        """
        from cspace.files.vector import POLYGON_SUFFIXES, read_shapes

        positive(spacing, "spacing")
        box = None if bounds is None else check_bounds(bounds)
        shape = Polygons(read_shapes(polygons))
        count = len(shape.geometries)
        named = isinstance(polygons, str | os.PathLike) and Path(polygons).suffix.lower() in POLYGON_SUFFIXES
        source = str(polygons) if named else f"{count} polygon{'s' * (count > 1)}"
        return cls._of(shape, spacing, box, source, "set of polygons", lazy=lazy)

    @classmethod
    def from_mesh(
        cls,
        mesh: MeshLike,
        spacing: float,
        bounds: ArrayLike | None = None,
        *,
        solid: Solid = "auto",
        lazy: bool = False,
    ) -> Workspace:
        """A triangle mesh in space, rasterised so that ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        mesh : trimesh.Trimesh, trimesh.Scene, cspace.Mesh, path-like, or (vertices, faces)
            Metres; files are ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf`` and ``.dae``.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (6,) or (2, 3), optional
            ``xmin, ymin, zmin, xmax, ymax, zmax`` of the map, or its lower and its upper corner, in metres; the
            bounding box of the mesh if left out, as for :meth:`from_polygons`. **What lies outside it is clipped.**
        solid : {"auto", "surface", "fill"}
            What has an inside: "auto", the closed parts of the mesh, with a warning if there are others; "surface",
            nothing; "fill", whatever the surface encloses at this spacing, with a warning where a mesh that is open
            encloses no cell.
        lazy : bool
            As for :meth:`from_polygons`; not for "fill", which looks at all cells at once.

        Raises
        ------
        GeometryError
            If the mesh has no triangle or a vertex is NaN or infinite.
        InputError
            If ``bounds`` is reversed, a number or word is not usable, or the map does not fit into memory.
        FileError
            If the file is missing or malformed.
        """
        positive(spacing, "spacing")
        box = None if bounds is None else check_bounds(bounds, 3)
        shape = Mesh.of(mesh, solid)
        source = str(mesh) if isinstance(mesh, str | os.PathLike) else shape.source
        if lazy and shape.solid == "fill":
            rule = "what a surface encloses is found on all of its cells at once"
            raise InputError(
                "lazy", "is True for solid='fill'", rule, "close the mesh, and pass solid='auto'", value=lazy
            )
        made = cls._of(shape, spacing, box, source, "mesh", cost=MESH_BYTES, lazy=lazy)
        return replace(made, shapes=None) if shape.solid == "fill" else made

    @classmethod
    def from_balls(
        cls,
        centers: ArrayLike | BallSet,
        radii: ArrayLike | None = None,
        spacing: float = 0.0,
        bounds: ArrayLike | None = None,
    ) -> Workspace:
        """Balls in space, or discs in the plane, rasterised so that ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        centers : array-like, shape (n, 2) or (n, 3), or BallDecomposition
            Metres. A decomposition brings its radii.
        radii : array-like, shape (n,), or one number
            Metres, zero or above.
        spacing : float
            Side of a cell, in metres; needed.
        bounds : array-like, shape (2 d,) or (2, d), optional
            Lower, then upper corner of the map, in metres; the bounding box of the balls if left out. **What lies
            outside it is clipped.**

        Raises
        ------
        InputError
            If the shapes do not fit, a value is not usable, or the map does not fit into memory.
        """
        balls = Balls.of(centers, radii)
        positive(spacing, "spacing")
        box = None if bounds is None else check_bounds(bounds, balls.dim)
        return cls._of(balls, spacing, box, f"{len(balls.radii)} balls")

    @classmethod
    def from_points(
        cls, points: ArrayLike | StrPath, spacing: float, bounds: ArrayLike | None = None, *, radius: float = 0.0
    ) -> Workspace:
        """A point cloud: every point an obstacle, alone or with a ball around it.

        Parameters
        ----------
        points : array-like, shape (n, 2) or (n, 3), or path-like
            Metres; files are ``.npy``, ``.xyz``, ``.txt``, ``.csv``, ``.ply`` and ``.pcd``, of points in space.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (2 d,) or (2, d), optional
            As for :meth:`from_balls`.
        radius : float
            Of the balls, metres, zero or above.

        Raises
        ------
        InputError
            As :meth:`from_balls`.
        FileError
            If the file is missing, truncated or malformed.
        """
        from cspace.files.points import read_points

        positive(spacing, "spacing")
        named = isinstance(points, str | os.PathLike)
        if named and bounds is not None:
            check_bounds(bounds, 3)
        cloud = Balls.of(read_points(points) if isinstance(points, str | os.PathLike) else points, radius)
        box = None if bounds is None else check_bounds(bounds, cloud.dim)
        # The points of a cloud tell of its units, the balls around them do not.
        source = str(points) if named else f"{len(cloud.radii)} points"
        return cls._of(cloud, spacing, box, source, "cloud", cloud.centers)

    @classmethod
    def from_octomap(cls, path: StrPath, unknown: str = "occupied") -> Workspace:
        """An OctoMap, ``.bt`` or ``.ot``, at its own resolution; coarse leaves are filled with its finest cells.

        Parameters
        ----------
        path : path-like
        unknown : {"occupied", "free"}
            What unknown cells are, within the bounding box of the known ones.

        Raises
        ------
        InputError
            If ``unknown`` is neither word.
        FileError
            If the file is missing, truncated or malformed.
        """
        from cspace.files.voxels import read_octomap

        check_word(unknown, "unknown", UNKNOWNS)
        lower, spacing, cells, unseen = read_octomap(path, unknown == "occupied")
        with _placing(path):
            grid = Grid(lower, spacing, cells.shape)
        return cls(grid, cells, cells, source=str(path), unknown=unseen)

    @classmethod
    def from_nrrd(
        cls,
        path: StrPath,
        spacing: float | None = None,
        lower: ArrayLike | None = None,
        *,
        threshold: float | None = None,
    ) -> Workspace:
        """Read a grid of values in the NRRD format, such as a label map of 3D Slicer.

        The header is attached to the values, which are raw or compressed with gzip. Voxels must be cubes along the
        axes of the file's space; axes that run downward or in another order are turned. Lengths are metres, unless the
        file names another unit, such as mm.

        Parameters
        ----------
        path : path-like
            Of two or three axes.
        spacing : float, optional
            Side of a cell, in metres; that of the file if left out.
        lower : array-like, shape (d,), optional
            Lower corner of the grid, in metres. If left out, half a cell before the file's ``space origin``, which is
            the center of its first voxel, or the origin if the file has none.
        threshold : float, optional
            Voxels of at least this value are occupied. If left out, all must be 0, free, or 1, occupied.

        Raises
        ------
        InputError
            If a number is not usable, neither you nor the file give the spacing, or values are not 0 and 1 and
            ``threshold`` is left out.
        FileError
            If the file is missing, truncated or malformed, holds NaN, is detached from its values, or its voxels are
            not cubes along the axes.
        """
        from cspace.files.voxels import read_nrrd

        corner, side, cells = read_nrrd(path, spacing, lower, threshold)
        with _placing(path):
            grid = Grid(corner, side, cells.shape)
        return cls(grid, cells, cells, source=str(path))

    @classmethod
    def from_moveit_scene(
        cls, path: StrPath, spacing: float, bounds: ArrayLike | None = None, *, package_dirs: PackageDirs = ()
    ) -> Workspace:
        """Read the obstacles of a MoveIt planning scene.

        Boxes, spheres, cylinders, cones, meshes and planes are read, in the frame of their headers. If these differ,
        ``fixed_frame_transforms`` must lead to one frame. Cylinders and cones lie between two polyhedra, as
        :meth:`cspace.Robot.cylinder` does. A plane is a surface without an inside and ends where the bounds do.

        Parameters
        ----------
        path : path-like
            YAML of a ``moveit_msgs/PlanningScene``: as ROS prints it, or as MotionBenchMaker and robowflex write it.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (6,) or (2, 3), optional
            As for :meth:`from_mesh`; needed if the scene has planes.
        package_dirs : path-like, or sequence of path-like
            Folders that hold the folders of packages, for meshes, as for :meth:`cspace.Robot.from_urdf`.

        Raises
        ------
        FileError
            If the file is missing or malformed, or holds an OctoMap or a primitive of another type.
        GeometryError
            If a mesh has no triangle, or there is no shape at all.
        InputError
            If ``bounds`` is reversed, a number is not usable, or the map does not fit into memory.

        See Also
        --------
        cspace.arms.read_moveit_scene : The same obstacles for an arm.
        """
        from cspace.shapes.scenes import read_moveit_scene

        positive(spacing, "spacing")
        box = None if bounds is None else check_bounds(bounds, 3)
        ball = None if box is None else (box.mean(axis=0), float(np.linalg.norm(np.ptp(box, axis=0))))
        shapes = [part.moved() for part in read_moveit_scene(path, ball, package_dirs)]
        return cls._of_shapes(shapes, spacing, box, str(path), "planning scene")

    @classmethod
    def open(cls, path: StrPath, **options: Unpack[OpenOptions]) -> Workspace:
        """Read a map from a file, by its suffix.

        Parameters
        ----------
        path : path-like
            ``.yaml``, ``.yml`` (ROS map); ``.map``, ``.3dmap`` (MovingAI); ``.geojson``, ``.json``, ``.wkt``
            (polygons); ``.png``, ``.pgm``, ``.ppm``, ``.pbm``, ``.pnm``, ``.jpg``, ``.jpeg``, ``.bmp``, ``.tif``,
            ``.tiff`` (image); ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf``, ``.dae`` (mesh); ``.bt``,
            ``.ot`` (OctoMap); ``.xyz``, ``.txt``, ``.csv``, ``.pcd``, and ``.ply`` without faces (point cloud);
            ``.npy`` (boolean array, or rows of three floats: points); ``.zarr`` (boolean array, read when needed);
            ``.nrrd`` (grid of values).
        **options
            What the method for that format takes: ``spacing`` for all but ROS maps and OctoMaps (needed for all but
            MovingAI, and NRRD files that hold it), ``unknown``, ``threshold``, ``dark``, ``lower``, ``bounds``,
            ``solid``, ``radius``.

        Raises
        ------
        InputError
            If the suffix is unknown, an option does not apply to the format, or ``spacing`` is missing.
        FileError
            If the file is missing or malformed.
        """
        reader = reader_of(path, options)
        for name, parameter in _options_of(reader).items():
            if parameter.default is parameter.empty and name not in options:
                raise InputError(
                    name, f"is missing for {os.fspath(path)}", "such a file does not hold it", f"pass e.g. {name}=0.05"
                )
        return reader(path, **options)


class LazyWorkspace(Workspace):
    """A workspace whose cells are read, or made, part by part at need.

    :func:`cspace.build` with a ``store`` reads a tile at a time. All else reads the whole into memory, where it fits,
    at its first use.

    Parameters
    ----------
    grid : Grid
    cells : cspace.obstacles.Source
    source : str
        What it is read from.
    shapes : tuple or None
    """

    __slots__ = ("_cells", "_whole")

    def __init__(self, grid: Grid, cells: Source, source: str, shapes: tuple[Shape, ...] | None = None) -> None:
        for name, value in (("grid", grid), ("source", source), ("shapes", shapes), ("live", False)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_cells", cells)
        object.__setattr__(self, "_whole", [])

    @property
    def cells(self) -> Source:
        return self._cells  # type: ignore[no-any-return, attr-defined]

    @property
    def outer(self) -> Bools:
        return self._read()[0]

    @property
    def inner(self) -> Bools:
        return self._read()[1]

    def in_memory(self) -> Workspace:
        return Workspace(self.grid, self.outer, self.inner, source=self.source, shapes=self.shapes)

    def _read(self) -> tuple[Bools, Bools]:
        whole: list[tuple[Bools, Bools]] = self._whole  # type: ignore[attr-defined]
        if not whole:
            grid = self.grid
            check_memory(WORKSPACE_BYTES * grid.size, "the workspace", grid, hint=_IN_TILES)
            outer, inner = map(frozen, self.cells.read(tuple(slice(0, n) for n in grid.shape)))
            whole.append((outer, outer if np.array_equal(outer, inner) else inner))
        return whole[0]

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.grid.shape))
        return f"LazyWorkspace({self.source}: {shape} cells of {self.grid.spacing:g} m, read at need)"

    def __reduce__(self) -> tuple[type[LazyWorkspace], tuple[Grid, Source, str, tuple[Shape, ...] | None]]:
        return LazyWorkspace, (self.grid, self.cells, self.source, self.shapes)


@contextmanager
def _placing(path: StrPath) -> Iterator[None]:
    """Within the block, name the file if its cells make no grid."""
    try:
        yield
    except InputError as error:
        problem = f"{error.argument} {error.problem}"
        raise FileError(os.fspath(path), problem, error.rule, error.hint, value=error.value) from error


def copied(workspace: Workspace, live: bool = False) -> Workspace:
    """Return a workspace with arrays of its own; ``live`` ones are written by the updates of a map."""
    outer = frozen(workspace.outer.copy())
    inner = outer if workspace.inner is workspace.outer else frozen(workspace.inner.copy())
    unknown = None if workspace.unknown is None else frozen(workspace.unknown.copy())
    return Workspace(workspace.grid, outer, inner, workspace.source, unknown, workspace.shapes, live)


def reader_of(path: StrPath, options: Iterable[str] = ()) -> Callable[..., Workspace]:
    """The classmethod that reads a workspace's file, which must take some options.

    Raises InputError if the suffix is unknown, or an option does not apply, and FileError if the file had to be looked
    into and is missing.
    """
    from cspace.files.formats import find_constructor

    reader: Callable[..., Workspace] = getattr(Workspace, find_constructor(path))
    known = _options_of(reader)
    for name in options:
        if name not in known:
            raise InputError(
                name, f"is given for {os.fspath(path)}", f"such a file takes {', '.join(known)}", "leave it out"
            )
    return reader


def _options_of(reader: Callable[..., Workspace]) -> dict[str, inspect.Parameter]:
    return dict(list(inspect.signature(reader).parameters.items())[1:])


def covering_shape(corners: Floats, spacing: float) -> list[int]:
    """Cells along each axis of the grid that begins at the lower of two corners and reaches the upper one."""
    with np.errstate(over="ignore"):
        counts = np.maximum(1.0, np.ceil((corners[1] - corners[0]) / spacing - _SLIVER))
    return [int(min(n, 2.0**62)) for n in counts]


def covering_grid(corners: Floats, spacing: float, bytes_a_cell: int) -> Grid:
    """The grid that begins at the lower of two corners, shape (2, dim), and reaches the upper one.

    Raises InputError if a workspace of so many cells does not fit into memory.
    """
    # What no raster can distinguish from zero is zero: shapely goes wrong on numbers below 1e-308.
    corners = np.where(np.abs(corners) < _NOUGHT * spacing, 0.0, corners)
    shape = covering_shape(corners, spacing)
    cells = float(np.prod(shape, dtype=float))
    # A spacing at which the map fits as well, beside its workspace.
    later, planned = (WORKSPACE_BYTES + 1) * cells, Planned(shape, spacing, *corners)
    check_memory(bytes_a_cell * cells, "the map", planned, later=later)
    return Grid(corners[0], spacing, shape)


def warn_of_units(corners: Floats, spacing: float, what: str, bounded: bool) -> None:
    """Warn of obstacles that are smaller than a cell: they are hardly in metres.

    Within bounds, which are in metres, something a little smaller than a cell may well be meant; there it is warned of
    from a quarter of a cell down. ``corners``, shape (2, d), are those of their box; nothing is said of a single point.
    ``what`` says in the message what they are: "mesh".
    """
    sides = corners[1] - corners[0]
    if 0.0 < sides.max() < (_SMALL_WITHIN if bounded else _SMALL) * spacing:
        size = " m x ".join(f"{side:g}" for side in sides)
        warn_user(
            f"the {what} is {size} m large and fits into one cell of {spacing:g} m; its units are probably wrong "
            "(metres are needed): scale it, or use a smaller spacing"
        )


def warn_of_nothing(outer: Bools, grid: Grid, corners: Floats) -> None:
    """Warn where no obstacle, of a box, shape (2, d), metres, lies in the bounds of a map: no ``outer`` cell is set."""
    if not outer.any():
        warn_user(
            f"the obstacles reach from {in_metres(corners[0])} to {in_metres(corners[1])} and none lies within the "
            f"bounds, {in_metres(grid.lower)} to {in_metres(grid.upper)}; the map has no obstacle at all: check the "
            "bounds, and the units (metres)"
        )


def in_metres(point: Iterable[float]) -> str:
    """A point for people, as ``(x, y, z) m``."""
    return f"({', '.join(f'{x:g}' for x in point)}) m"

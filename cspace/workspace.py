"""Workspace: obstacle cells on a grid."""

from __future__ import annotations

import inspect
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import FileError, InputError
from cspace.grid import Grid, finite, positive, unmasked

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """The obstacles, as two sets of closed cells: those that meet an obstacle, and those that lie in obstacles.

    A map that is itself a grid of obstacle cells has both the same. Make one with a ``from_...`` method or
    :meth:`open`.

    Attributes
    ----------
    grid : Grid
    outer : ndarray of bool, shape grid.shape
        Cells that meet an obstacle; read-only, a copy of what was passed.
    inner : ndarray of bool, shape grid.shape
        Cells that lie in obstacles; the same object as ``outer`` for a map that is itself a grid.
    source : str
        What it was read from.
    shapes : tuple of shapely geometries or None
        The obstacles themselves, metres, also where they reach beyond the grid; None for a map that is itself a grid,
        whose outer cells are the obstacles. Exact look-ups ask them.

    Raises
    ------
    InputError
        If an array is not boolean (0 and 1 are accepted), does not have the grid's shape, or a cell is in ``inner``
        and not in ``outer``.
    """

    grid: Grid
    outer: NDArray[np.bool_] = field(repr=False)
    inner: NDArray[np.bool_] = field(repr=False)
    source: str = "array"
    shapes: tuple[BaseGeometry, ...] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        outer = _cells(self.outer, "outer")
        inner = outer if self.inner is self.outer else _cells(self.inner, "inner")
        for name, cells in (("outer", outer), ("inner", inner)):
            if cells.shape != self.grid.shape:
                raise InputError(
                    f"{name} has shape {cells.shape} on a grid of {self.grid.shape}; both must be the same; pass one "
                    "entry for each cell, indexed in the order of the coordinates"
                )
        lost = np.argwhere(inner & ~outer)
        if len(lost):
            raise InputError(
                f"cell {tuple(lost[0].tolist())} is in inner and not in outer; a cell that lies in an obstacle also "
                "meets it; add it to outer"
            )
        object.__setattr__(self, "shapes", None if self.shapes is None else tuple(self.shapes))
        object.__setattr__(self, "outer", outer)
        object.__setattr__(self, "inner", outer if np.array_equal(inner, outer) else inner)

    @classmethod
    def from_array(
        cls, occupied: ArrayLike, spacing: float, lower: ArrayLike | None = None, *, inner: ArrayLike | None = None
    ) -> Workspace:
        """A map that is already a grid.

        Parameters
        ----------
        occupied : array-like of bool, shape (nx, ny) or (nx, ny, nz)
            Cells that meet an obstacle, indexed in the order of the coordinates; 0 and 1 are accepted.
        spacing : float
            Side of a cell, in metres.
        lower : array-like, shape (d,), optional
            Lower corner of the first cell, in metres; the origin if left out.
        inner : array-like of bool, same shape, optional
            Cells that lie in obstacles; ``occupied`` if left out.

        Returns
        -------
        Workspace

        Raises
        ------
        InputError
            If an array is empty, not boolean or of the wrong shape, or a number is not usable.
        """
        cells = _cells(occupied, "occupied")
        corner = finite(np.zeros(cells.ndim) if lower is None else lower, "lower")
        if corner.shape != (cells.ndim,):
            raise InputError(
                f"lower is {lower!r}; occupied has {cells.ndim} axes and lower must have as many coordinates; pass "
                f"e.g. {(0.0,) * cells.ndim}"
            )
        return cls(Grid(corner, spacing, cells.shape), cells, cells if inner is None else _cells(inner, "inner"))

    @classmethod
    def from_ros_map(cls, path: str | os.PathLike[str], unknown: str = "occupied") -> Workspace:
        """A ROS map: a YAML file and the PGM or PNG image beside it.

        Modes, thresholds, ``negate`` and the origin with its yaw are honoured as
        :func:`cspace.io.rosmap.read_ros_map` tells.

        Parameters
        ----------
        path : path-like
            The YAML file.
        unknown : {"occupied", "free"}
            What unknown cells are.

        Returns
        -------
        Workspace

        Raises
        ------
        InputError
            If ``unknown`` is neither word.
        FileError
            If the YAML or its image is missing or malformed.
        """
        from cspace.io.rosmap import read_ros_map

        return cls(*read_ros_map(path, unknown), source=str(path))

    @classmethod
    def from_image(
        cls,
        path: str | os.PathLike[str],
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

        Returns
        -------
        Workspace

        Raises
        ------
        InputError
            If a number or word is not usable.
        FileError
            If the file is missing or cannot be decoded.
        """
        from cspace.io.image import read_image

        cells = read_image(path, threshold, dark)
        corner = (0.0, 0.0) if lower is None else lower
        return cls(Grid(corner, spacing, cells.shape), cells, cells, source=str(path))

    @classmethod
    def from_movingai(cls, path: str | os.PathLike[str], spacing: float = 1.0) -> Workspace:
        """A MovingAI ``.map``: ``.``, ``G`` and ``S`` are passable, ``@``, ``O``, ``T`` and ``W`` blocked.

        Parameters
        ----------
        path : path-like
            Its first row is the top; the lower left corner of the map is the origin.
        spacing : float
            Side of a cell, in metres.

        Returns
        -------
        Workspace

        Raises
        ------
        InputError
            If ``spacing`` is not above zero.
        FileError
            If the file is missing, truncated or malformed; the message names the line.
        """
        from cspace.io.movingai import read_map

        cells = read_map(path)
        return cls(Grid((0.0, 0.0), spacing, cells.shape), cells, cells, source=str(path))

    @classmethod
    def from_polygons(cls, polygons: Any, spacing: float, bounds: ArrayLike | None = None) -> Workspace:
        """Polygons, lines and points in the plane, rasterised so that ``outer`` and ``inner`` are proven.

        Parameters
        ----------
        polygons : shapely geometry, GeoJSON mapping, WKT string, path-like, or iterable of these
            Closed sets, in metres, without z; files end in ``.geojson``, ``.json`` or ``.wkt``.
        spacing : float
            Side of a cell, in metres.
        bounds : array-like, shape (4,), optional
            ``xmin, ymin, xmax, ymax`` of the map, in metres; the bounding box of the obstacles if left out. The grid
            begins at the lower corner and has as many cells as reach the upper one, less a strip of up to 1e-9 cells
            from rounding. **What lies beyond it is clipped.**

        Returns
        -------
        Workspace

        Raises
        ------
        GeometryError
            If a geometry is empty, self-crossing, not finite or not in the plane; the message says which.
        InputError
            If ``bounds`` is reversed or a number is not usable.
        FileError
            If the file is missing or malformed.
        """
        from cspace.io.vector import SUFFIXES, read_shapes
        from cspace.raster import rasterize_obstacles

        side = positive(spacing, "spacing")
        shapes = read_shapes(polygons)
        grid = _cover(_bounding_box(shapes) if bounds is None else _bounds(bounds), side)
        outer, inner = rasterize_obstacles(shapes, grid)
        named = isinstance(polygons, str | os.PathLike) and Path(polygons).suffix.lower() in SUFFIXES
        source = str(polygons) if named else f"{len(shapes)} polygon{'s' * (len(shapes) > 1)}"
        return cls(grid, outer, inner, source=source, shapes=tuple(shapes))

    @classmethod
    def open(cls, path: str | os.PathLike[str], **options: Any) -> Workspace:
        """Read a map from a file, by its suffix.

        Parameters
        ----------
        path : path-like
            ``.yaml``, ``.yml`` (ROS map); ``.map`` (MovingAI); ``.geojson``, ``.json``, ``.wkt`` (polygons);
            ``.png``, ``.pgm``, ``.ppm``, ``.jpg``, ``.bmp`` and the like (image); ``.npy`` (boolean array).
        **options
            What the method for that format takes: ``spacing`` for all but ROS maps (needed for all but MovingAI),
            ``unknown``, ``threshold``, ``dark``, ``lower``, ``bounds``.

        Returns
        -------
        Workspace

        Raises
        ------
        InputError
            If the suffix is unknown, an option does not apply to the format, or ``spacing`` is missing.
        FileError
            If the file is missing or malformed.
        """
        try:
            suffix = Path(path).suffix.lower()
        except TypeError as error:
            raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
        if suffix not in READERS:
            raise InputError(
                f"{os.fspath(path)} ends in {suffix!r}; the suffix says which format to read; use one of "
                f"{', '.join(READERS)}"
            )
        reader = getattr(cls, READERS[suffix])
        known = dict(list(inspect.signature(reader).parameters.items())[1:])
        for name in options:
            if name not in known:
                raise InputError(
                    f"{name} is given for {os.fspath(path)}; a {suffix} file takes {', '.join(known)}; leave it out"
                )
        for name, parameter in known.items():
            if parameter.default is parameter.empty and name not in options:
                raise InputError(
                    f"{name} is missing for {os.fspath(path)}; a {suffix} file does not hold it; pass e.g. "
                    f"{name}=0.05 (metres)"
                )
        workspace: Workspace = reader(path, **options)
        return workspace

    @classmethod
    def _from_npy(cls, path: str | os.PathLike[str], spacing: float, lower: ArrayLike | None = None) -> Workspace:
        """A boolean array saved by :func:`numpy.save`."""
        from cspace.io.input import existing

        file = existing(path, "NumPy array")
        try:
            with file.open("rb") as stream:
                array = np.lib.format.read_array(stream, allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise FileError(
                f"{file} cannot be read: {error}; it must hold one boolean array; write it with numpy.save"
            ) from error
        found = cls.from_array(array, spacing, lower)
        return cls(found.grid, found.outer, found.outer, source=str(path))


READERS: Final = {
    ".yaml": "from_ros_map",
    ".yml": "from_ros_map",
    ".map": "from_movingai",
    ".geojson": "from_polygons",
    ".json": "from_polygons",
    ".wkt": "from_polygons",
    ".npy": "_from_npy",
    **dict.fromkeys((".png", ".pgm", ".ppm", ".pbm", ".pnm", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"), "from_image"),
}
"""The method that reads a file, by its suffix."""

_MAX_CELLS: Final = 2**32

_STRIP: Final = 1e-9
"""Part of a cell that the upper bound may be off by rounding; far below the slack of an outer raster, so that an
obstacle in that strip still marks the last cell."""


def _cells(values: ArrayLike, name: str) -> NDArray[np.bool_]:
    """A read-only copy of a boolean array of two or three axes."""
    dims = getattr(values, "dims", None)
    if dims is not None and tuple(dims) != ("x", "y", "z")[: len(dims)]:
        raise InputError(
            f"{name} has the dimensions {tuple(dims)}; they must be named x, y (and z), in this order; "
            'rename or transpose it, e.g. array.transpose("x", "y")'
        )
    unmasked(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} is ragged: {error}; its rows must have one length; pad or cut them") from error
    if array.ndim not in (2, 3) or array.size == 0:
        raise InputError(
            f"{name} has shape {array.shape}; it must have two or three axes and at least one cell; pass an array "
            "indexed [x, y] or [x, y, z]"
        )
    if array.dtype.kind == "f":
        finite(array, name)
    if array.dtype.kind not in "biu":
        raise InputError(
            f"{name} has dtype {array.dtype}; cells are occupied or not, so that it must be boolean; compare it with a "
            "threshold first, e.g. array > 0.5"
        )
    if array.dtype.kind != "b":
        wrong = np.argwhere((array != 0) & (array != 1))
        if len(wrong):
            index = tuple(wrong[0].tolist())
            raise InputError(
                f"{name}[{', '.join(map(str, index))}] is {array[index]}; whole numbers must be 0 or 1; compare with a "
                "threshold first, e.g. array >= 50"
            )
    copy = np.array(array != 0, order="C")  # a boolean array may hold other bytes than 0 and 1; a comparison does not
    copy.setflags(write=False)
    return copy


def _bounding_box(shapes: list[Any]) -> NDArray[np.float64]:
    import shapely

    return np.asarray(shapely.total_bounds(shapes), dtype=np.float64)


def _bounds(bounds: ArrayLike) -> NDArray[np.float64]:
    """``xmin, ymin, xmax, ymax``, checked."""
    box = finite(bounds, "bounds")
    if box.shape != (4,):
        raise InputError(f"bounds is {bounds!r}; it must hold four numbers; pass (xmin, ymin, xmax, ymax) in metres")
    if (box[2:] <= box[:2]).any():
        raise InputError(
            f"bounds is {tuple(box.tolist())}; xmax must be above xmin and ymax above ymin; pass (xmin, ymin, xmax, "
            "ymax) in metres"
        )
    return box


def _cover(box: NDArray[np.float64], spacing: float) -> Grid:
    """The grid that begins at the lower corner of a box and reaches its upper one."""
    with np.errstate(over="ignore"):
        counts = np.maximum(1.0, np.ceil((box[2:] - box[:2]) / spacing - _STRIP))
    if counts.prod() > _MAX_CELLS:
        raise InputError(
            f"spacing is {spacing}; the map would have {' x '.join(f'{n:.0f}' for n in counts)} cells, and at most "
            f"{_MAX_CELLS} are made; use a larger spacing or smaller bounds, or check the units (metres)"
        )
    return Grid(box[:2], spacing, [int(n) for n in counts])

"""Shapes of robots and obstacles, with their rasters, boundaries and drawings."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cspace._files.access import suggest_file
from cspace._shapes.balls import Balls as Balls
from cspace._shapes.balls import BallSet as BallSet
from cspace._shapes.balls import OriginPoint as OriginPoint
from cspace._shapes.balls import check_balls as check_balls
from cspace._shapes.polygon import Polygons as Polygons
from cspace._shapes.primitives import is_shorthand, parse_shorthand
from cspace._shapes.shape import BoundedShape as BoundedShape
from cspace._shapes.shape import ExactShape as ExactShape
from cspace._shapes.shape import RoundedSimplices as RoundedSimplices
from cspace._shapes.shape import Shape as Shape
from cspace._shapes.voxels import Box as Box
from cspace._shapes.voxels import Voxels as Voxels
from cspace._support.kinds import make_kind_error
from cspace.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._shapes.mesh import Mesh, MeshLike


class HasShape(Protocol):
    """A robot, or anything else with a name and a shape."""

    @property
    def name(self) -> str:
        """Name for messages and drawings."""
        ...

    @property
    def shape(self) -> Shape:
        """Shape of the object, metres."""
        ...


ShapeLike: TypeAlias = (
    "Shape | HasShape | BaseGeometry | Mapping[str, object] | Iterable[BaseGeometry] | MeshLike "
    "| BallSet | ArrayLike"
)
"""Types that :func:`as_shape` converts."""


def as_shape(source: ShapeLike, radius: ArrayLike | None = None, name: str = "shape") -> Shape:
    """Convert anything that describes a shape to a Shape.

    Every function that takes a shape calls this function.

    Parameters
    ----------
    source : Shape, Robot, shapely geometry, GeoJSON mapping, mesh, path, or array-like
        Or an iterable of shapes, robots, geometries or mappings.
        Anything that :meth:`Polygons.of`, :func:`cspace._files.vector.read_shapes` or
        :func:`cspace.make_mesh` takes, metres. A string is a shorthand such as
        ``"ellipse:0.5,0.3"`` (:data:`cspace._shapes.primitives.SHORTHANDS`), WKT, or the path of a
        file of polygons or a mesh.
    radius : array-like, shape () or (n,), optional
        Metres. With a radius, or for a decomposition, the shape is balls around points, shape (n,
        2) or (n, 3).
    name : str
        The caller's argument, for messages.

    Raises InputError if `source` describes no shape, and FileError if it names a missing or
    malformed file.
    """
    # Test for the most specific types first.
    if isinstance(source, Shape) and radius is None:
        return source
    value: Any = source
    if radius is not None or isinstance(source, BallSet):
        return Balls.of(value, radius, (name, "radius"))
    if isinstance(source, str | os.PathLike):
        return _read_text(source, name)
    shape = getattr(source, "shape", None)
    # Robots have names. Other objects with a shape may have a pose too, such as PosedShape.
    is_robot = isinstance(getattr(source, "name", None), str)
    if is_robot and isinstance(shape, Shape):
        return shape
    is_array = isinstance(value, np.ndarray) and value.ndim > 0
    if is_array or isinstance(value, list | tuple):
        return _convert_sequence(value, name)
    if isinstance(value, Mapping) or hasattr(value, "__geo_interface__"):
        from cspace._files.vector import read_shapes

        return Polygons(read_shapes(value, name))
    if hasattr(value, "vertices") or hasattr(value, "geometry"):
        return _make_mesh(value)
    raise make_kind_error(value, name, _SHAPE_NEEDED)


_SHAPE_NEEDED: Final = "a polygon or a mesh is needed"
"""Rule of messages about a value that is no shape."""


def _convert_sequence(values: Any, name: str) -> Shape:
    """Make the shape of a list or array.

    It holds geometries, the corners of a polygon, or vertices and faces.
    """
    from cspace._files.vector import read_shapes

    if getattr(values, "dtype", None) == np.bool_:
        raise InputError(name, "is an array of cells", "their size must be given")
    first: Any = next(iter(values), {})  # read_shapes refuses an empty list
    if isinstance(first, Mapping) or hasattr(first, "__geo_interface__"):
        return Polygons(read_shapes(values, name))
    # The shape of a row tells points from vertices and faces; () is a plain number.
    try:
        row_shape = np.shape(first)
    except ValueError as error:  # of rows of different lengths
        raise make_kind_error(values, name, _SHAPE_NEEDED) from error
    if row_shape == (2,) and len(values) > 2:
        return Polygons.of(values)
    is_one_point = row_shape == () and len(values) in (2, 3)
    if is_one_point or row_shape in ((2,), (3,)):
        rule = "points need a radius, and a polygon 3 corners"
        if row_shape == (3,) and len(values) > 2:
            rule = "points need a radius, and corners of a polygon have no height"
            hint = f"use [corner[:2] for corner in {name}]"
            raise InputError(name, f"is {len(values)} points in space", rule, hint)
        raise InputError(name, "is points", rule)
    if row_shape == ():
        raise InputError(name, f"is {len(values)} numbers", _SHAPE_NEEDED)
    if len(values) != 2 or row_shape[-1] != 3:
        raise make_kind_error(values, name, _SHAPE_NEEDED)
    return _make_mesh(values)


def _make_mesh(source: MeshLike) -> Mesh:
    """Make a mesh with a warning of open bodies.

    The caller takes shapes, but has no option ``solid``.
    """
    from cspace._shapes.mesh import Mesh

    mesh = Mesh.convert(source)
    mesh.warn_if_open("cspace.make_mesh(mesh, solid={!r})", fills=False)
    return mesh


def _read_text(source: str | os.PathLike[str], name: str) -> Shape:
    """Make a shape of a shorthand, WKT or file.

    A file holds polygons or a mesh.
    """
    from cspace._files.meshes import MESH_SUFFIXES
    from cspace._files.vector import POLYGON_SUFFIXES, is_wkt, read_shapes

    suffix = Path(source).suffix.lower()
    if isinstance(source, str) and is_shorthand(source):
        return parse_shorthand(source, name).shape
    if suffix in MESH_SUFFIXES:
        return _make_mesh(source)
    if suffix in POLYGON_SUFFIXES or (isinstance(source, str) and is_wkt(source)):
        return Polygons(read_shapes(source))
    suffixes = ", ".join((*POLYGON_SUFFIXES, *MESH_SUFFIXES))
    rule = f"it must be a shorthand, WKT, or a file that ends in {suffixes}"
    hint = suggest_file(Path(source))
    raise InputError(name, f"is {os.fspath(source)[:60]!r}", rule, hint)


def shape_from_spec(spec: Mapping[str, Any]) -> Shape:
    """Make the shape that a :attr:`Shape.spec` describes.

    Raises KeyError, TypeError or ValueError if the spec is malformed.
    """
    import cspace._shapes.mesh  # noqa: F401 - adds its kind

    return Shape.KINDS[spec["kind"]].from_spec(spec)

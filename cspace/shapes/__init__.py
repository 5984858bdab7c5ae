"""Shapes: what robots and obstacles are made of; each knows its rasters, its border and how it is drawn."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.shapes.balls import Balls as Balls
from cspace.shapes.balls import BallSet as BallSet
from cspace.shapes.balls import Point as Point
from cspace.shapes.balls import check_balls as check_balls
from cspace.shapes.bracketed import Bracketed as Bracketed
from cspace.shapes.mesh import Mesh as Mesh
from cspace.shapes.mesh import MeshLike as MeshLike
from cspace.shapes.mesh import MeshWarning as MeshWarning
from cspace.shapes.polygon import Polygons as Polygons
from cspace.shapes.shape import Pieces as Pieces
from cspace.shapes.shape import Shape as Shape
from cspace.shapes.voxels import Box as Box
from cspace.shapes.voxels import Voxels as Voxels

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

ShapeLike: TypeAlias = (
    "Shape | BaseGeometry | Mapping[str, object] | Iterable[BaseGeometry] | MeshLike | BallSet | ArrayLike"
)
"""What :func:`shape_of` takes."""

_FROM_SPEC: Final[dict[str, Callable[[Mapping[str, Any]], Shape]]] = {
    "balls": Balls.from_spec,
    "box": Box.from_spec,
    "bracketed": lambda spec: Bracketed.from_spec(spec, shape_from_spec),
    "cells": Voxels.from_spec,
    "mesh": Mesh.from_spec,
    "point": Point.from_spec,
    "polygon": Polygons.from_spec,
}


def shape_from_spec(spec: Mapping[str, Any]) -> Shape:
    """The shape that a :attr:`Shape.spec` describes.

    Raises KeyError, TypeError or ValueError if it describes none.
    """
    return _FROM_SPEC[spec["kind"]](spec)


def shape_of(source: ShapeLike, radius: ArrayLike | None = None) -> Shape:
    """The shape that anything stands for.

    Parameters
    ----------
    source : Shape, shapely geometry, GeoJSON mapping, or iterable of these; mesh; path-like or WKT; or array-like
        What :meth:`Polygons.of`, :func:`cspace.io.vector.read_shapes` or :meth:`Mesh.of` take, metres.
    radius : array-like, shape () or (n,), optional
        Metres. With it, or where ``source`` is a decomposition, it is balls around points, shape (n, 2) or (n, 3).

    Raises InputError if it stands for none, and FileError if it names a file that is missing or malformed.
    """
    import shapely

    from cspace.io.meshes import SUFFIXES
    from cspace.io.vector import read_shapes

    if isinstance(source, Shape) and radius is None:
        return source
    given: Any = source
    if radius is not None or isinstance(source, BallSet):
        return Balls.of(given, radius)
    if isinstance(source, str | os.PathLike):
        solid = Path(source).suffix.lower() in SUFFIXES
        return Mesh.of(source) if solid else Polygons(read_shapes(source))
    if getattr(source, "dtype", None) == np.bool_:
        mend = "pass cspace.shapes.Voxels.of(cells, spacing), in metres"
        raise InputError("shape", "is an array of cells", "their size must be given", mend, value=source)
    several = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim > 0)
    first = next(iter(given), {}) if several else given
    if isinstance(first, shapely.Geometry | Mapping):
        return Polygons(read_shapes(given))
    if several and np.shape(first) == (2,):
        return Polygons.of(given)
    if several and np.shape(first) == (3,):
        raise InputError(
            "shape", "is points", "they are balls around them", "pass their radius, 0.0 for points alone", value=source
        )
    return Mesh.of(given)

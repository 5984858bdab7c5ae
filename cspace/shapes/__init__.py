"""Shapes: what robots and obstacles are made of; each knows its rasters, its border and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from cspace.shapes.balls import Balls as Balls
from cspace.shapes.balls import check_balls as check_balls
from cspace.shapes.bracketed import Bracketed as Bracketed
from cspace.shapes.mesh import Mesh as Mesh
from cspace.shapes.mesh import MeshWarning as MeshWarning
from cspace.shapes.polygon import Polygons as Polygons
from cspace.shapes.shape import Pieces as Pieces
from cspace.shapes.shape import Shape as Shape
from cspace.shapes.voxels import Box as Box
from cspace.shapes.voxels import Voxels as Voxels

_FROM_SPEC: Final[dict[str, Callable[[Mapping[str, Any]], Shape]]] = {
    "balls": Balls.from_spec,
    "box": Box.from_spec,
    "bracketed": lambda spec: Bracketed.from_spec(spec, shape_from_spec),
    "cells": Voxels.from_spec,
    "mesh": Mesh.from_spec,
    "polygon": Polygons.from_spec,
}


def shape_from_spec(spec: Mapping[str, Any]) -> Shape:
    """The shape that a :attr:`Shape.spec` describes.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it describes none.
    """
    return _FROM_SPEC[spec["kind"]](spec)

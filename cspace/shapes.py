"""Shapes that a caller passes for a robot, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from cspace.errors import GeometryError, InputError
from cspace.grid import finite


def check_polygons(shape: Any) -> list[Any]:
    """The polygons of ``shape``, checked."""
    import shapely

    if isinstance(shape, shapely.Geometry):
        shapes = [shape]
    elif isinstance(shape, Sequence) and shape and all(isinstance(part, shapely.Geometry) for part in shape):
        shapes = list(shape)
    else:
        vertices = finite(shape, "polygon")
        if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3:
            raise GeometryError(
                f"polygon has shape {vertices.shape}; it must be (n, 2) with n at least 3; pass its vertices in order"
            )
        shapes = [shapely.Polygon(vertices)]
    parts = [part for whole in shapes for part in shapely.get_parts(whole)]
    if not parts or any(part.is_empty for part in parts):
        raise GeometryError("the robot's polygon is empty; a robot must have an area; pass at least three vertices")
    for number, part in enumerate(parts):
        if part.geom_type != "Polygon":
            raise GeometryError(f"part {number} of the robot is a {part.geom_type}; each must be a Polygon")
        finite(shapely.get_coordinates(part), f"polygon {number}")
        if not part.is_valid:
            raise GeometryError(
                f"part {number} of the robot is not a simple polygon: {shapely.is_valid_reason(part)}; "
                "rings must not cross themselves or each other; mend it, e.g. with shapely.make_valid"
            )
        if not part.area > 0.0:
            raise GeometryError(f"part {number} of the robot has area {part.area:g}; it must be above zero")
    return parts


def polygon_name(parts: Sequence[Any]) -> str:
    corners = sum(len(ring.coords) - 1 for part in parts for ring in (part.exterior, *part.interiors))
    return f"polygon with {corners} corners" + (f" in {len(parts)} parts" if len(parts) > 1 else "")


def check_point(value: ArrayLike, name: str = "center") -> tuple[float, float]:
    point = finite(value, name)
    if point.shape != (2,):
        raise InputError(f"{name} has shape {point.shape}; it must be two coordinates in metres; pass e.g. (0.0, 0.0)")
    return float(point[0]), float(point[1])

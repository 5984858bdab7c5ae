"""Shapes that a caller passes for a robot, checked."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import GeometryError, InputError
from cspace.grid import finite

MOST_OFF: Final = 100.0
"""How many times its own size a robot's mesh may lie off its reference point."""


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


def check_point(value: ArrayLike, name: str = "center", dim: int = 2) -> tuple[float, ...]:
    """The coordinates of one point."""
    point = finite(value, name)
    if point.shape != (dim,):
        raise InputError(
            f"{name} has shape {point.shape}; it must be {dim} numbers in metres; pass e.g. {(0.5,) * dim}"
        )
    return tuple(point.tolist())


def check_balls(centers: Any, radii: ArrayLike | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Copies of the centers, shape (n, 2) or (n, 3), and radii, shape (n,), of balls; radii below zero are refused.

    A decomposition into balls, in place of the centers, brings its radii.
    """
    decomposed = hasattr(centers, "centers") and hasattr(centers, "radii")
    if decomposed == (radii is not None):
        raise InputError(
            "radii is given beside a decomposition, which has its own; leave it out"
            if decomposed
            else "radii is missing; pass one number, or one for each center"
        )
    if decomposed:
        centers, radii = centers.centers, centers.radii
    points = finite(centers, "centers")
    if points.ndim != 2 or points.shape[1] not in (2, 3) or not len(points):
        raise InputError(
            f"centers has shape {points.shape}; it must be (n, 2) or (n, 3) with n at least 1; pass one row for each "
            "ball"
        )
    sizes = finite(0.0 if radii is None else radii, "radii")
    if sizes.shape not in {(), (len(points),)}:
        raise InputError(
            f"radii has shape {sizes.shape}; it must be one number or ({len(points)},), one for each center"
        )
    if (sizes < 0).any():
        raise InputError(f"radii holds {sizes.min():g}; none may be below zero; pass lengths in metres")
    return points.copy(), np.broadcast_to(sizes, len(points)).copy()


def check_origin(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> None:
    """Refuse a robot that lies so far from its reference point that this can hardly be meant."""
    size, far = _size_and_distance(lower, upper)
    if far > MOST_OFF * size:
        raise GeometryError(
            f"the robot's mesh is {size:g} m across and lies {far:g} m from its origin, which is its reference point; "
            f"at most {MOST_OFF:g} times its size is accepted; move it there first, by {_to_middle(lower, upper)} for "
            "its middle"
        )


def warn_of_origin(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> None:
    """Warn of a robot that lies off its reference point by more than its own size."""
    size, far = _size_and_distance(lower, upper)
    if far > size:
        warnings.warn(
            f"the robot's mesh is {size:g} m across and lies {far:g} m from its origin, which is its reference point: "
            "a configuration is where that point is; unless this is meant, move the mesh there first, by "
            f"{_to_middle(lower, upper)} for its middle",
            stacklevel=3,
        )


def _size_and_distance(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> tuple[float, float]:
    """Diagonal of a box, and how far it lies from the origin."""
    return float(np.linalg.norm(upper - lower)), float(np.linalg.norm(np.maximum(np.maximum(lower, -upper), 0.0)))


def _to_middle(lower: NDArray[np.float64], upper: NDArray[np.float64]) -> str:
    """The move that puts the middle of a box at the origin."""
    return f"({', '.join(f'{-x:g}' for x in (lower + upper) / 2)}) m"

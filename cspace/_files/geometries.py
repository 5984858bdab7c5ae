"""Checks of shapely geometries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cspace._files.crs import check_crs
from cspace._support.check import MAX_NUMBER
from cspace.errors import GeometryError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


def split_parts(shape: BaseGeometry, name: str) -> list[BaseGeometry]:
    """Return a nested collection's simple geometries, in order.

    Raises GeometryError if one of them is a curve.
    """
    import shapely

    # Type number of a multipoint in GEOS; all larger ones are collections too.
    if shapely.get_type_id(shape) < 4 or shape.is_empty:
        return [_drop_zero_heights(shape)]
    parts: list[BaseGeometry] = []
    try:
        members = shapely.get_parts(shape)
    except NotImplementedError as error:
        raise make_curve_error(name) from error
    for member in members:
        parts += split_parts(member, name)
    return parts


def _drop_zero_heights(shape: BaseGeometry) -> BaseGeometry:
    """Return a geometry without z if all its heights are zero."""
    import shapely

    if not shapely.has_z(shape) or shapely.get_coordinates(shape, include_z=True)[:, 2].any():
        return shape
    return shapely.force_2d(shape)


def check_shapes(shapes: Sequence[BaseGeometry], names: Sequence[str]) -> None:
    """Raise GeometryError for the first unusable shape.

    Shapes must be plane, valid and filled with points, in metres, within 1e100 m of the origin.

    ``names`` name the shapes in messages.
    """
    import shapely

    array = np.array(shapes, dtype=object)
    for srid, index in zip(*np.unique(shapely.get_srid(array), return_index=True), strict=True):
        if srid:
            check_crs(f"EPSG:{srid}", names[index])
    points, owners = shapely.get_coordinates(array, return_index=True)
    # The owner of a point is the index of its shape.
    # Beyond this distance, sums and areas overflow, and GEOS may loop forever.
    broken = np.flatnonzero(~(np.abs(points) <= MAX_NUMBER).all(axis=1))
    if len(broken):
        first = broken[0]
        x, y = points[first]
        index = int(owners[first])
        problem = f"has a vertex at ({x}, {y})"
        rule = f"coordinates must be finite, and at most {MAX_NUMBER:g}"
        raise GeometryError(names[index], problem, rule)
    is_invalid = ~shapely.is_valid(array)
    reason = shapely.is_valid_reason(array[is_invalid.argmax()])
    # For each reason, the mask of the shapes to refuse, and the parts of the message.
    for refused, problem, rule in (
        (shapely.is_empty(array), "is empty", "it must cover some ground"),
        (
            shapely.has_z(array),
            "has z coordinates",
            "obstacles in the plane have two; shapely.force_2d drops heights",
        ),
        (
            is_invalid,
            f"is not valid: {reason}",
            "a boundary may not cross itself",
        ),
    ):
        if refused.any():
            index = int(refused.argmax())
            raise GeometryError(names[index], problem, rule)


def make_curve_error(name: str) -> GeometryError:
    """Return the error for a geometry that shapely does not support."""
    problem = "is or holds a curve, such as CIRCULARSTRING or CURVEPOLYGON"
    rule = "only straight lines are read"
    return GeometryError(name, problem, rule)

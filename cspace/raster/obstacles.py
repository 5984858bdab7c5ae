"""Outer and inner cells of obstacles in the plane.

Outer cells are those that meet an obstacle, inner ones those that lie in one obstacle. Both are safe against rounding
in the way that :mod:`cspace.raster.robots` tells: outer cells may include a cell within 2 ``SLACK`` of an obstacle, and
inner ones leave out a cell whose border an obstacle's border touches from outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import MAX_COORDINATE, SLACK, Grid
from cspace.raster.outlines import point_segments, polygon_outline

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


def rasterize_obstacles(shapes: Sequence[BaseGeometry], grid: Grid) -> tuple[Bools, Bools]:
    """Cells of a union of shapely geometries.

    Parameters
    ----------
    shapes : sequence of shapely geometries
        Polygons, lines, rings, points and collections of them, valid and in metres. Lines and points have no inside.
    grid : Grid
        In the plane. What lies beyond it is clipped.

    Returns
    -------
    outer, inner : ndarray of bool, shape grid.shape

    Raises
    ------
    InputError
        If a coordinate is so far from the grid that rounding could reach the certificate's slack.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    for segments, filled in _parts(shapes):
        local, window = _localise(segments, grid)
        if local is None:
            continue
        touched, inside = _touched_and_inside(local, outer[window].shape, filled)
        outer[window] |= touched | inside
        inner[window] |= inside & ~touched
    return outer, inner


def cells_touched_and_inside(segments: Floats, grid: Grid) -> tuple[Bools, Bools]:
    """Cells that a set of closed curves touches, and cells whose middle they enclose.

    Parameters
    ----------
    segments : ndarray, shape (E, 4)
        ``(x0, y0, x1, y1)`` in metres; together they form closed curves, in any order.
    grid : Grid

    Returns
    -------
    touched, inside : ndarray of bool, shape grid.shape
        ``inside`` is by even-odd parity and holds for untouched cells.
    """
    touched = np.zeros(grid.shape, dtype=np.bool_)
    inside = np.zeros(grid.shape, dtype=np.bool_)
    local, window = _localise(segments, grid)
    if local is not None:
        touched[window], inside[window] = _touched_and_inside(local, touched[window].shape, True)
    return touched, inside


def _parts(shapes: Sequence[BaseGeometry]) -> Iterator[tuple[Floats, bool]]:
    """The segments of each polygon, line and point, and whether they enclose an area."""
    import shapely

    for shape in shapely.get_parts(list(shapes)):
        if shape.geom_type == "Polygon":
            yield polygon_outline(shape), True
        elif hasattr(shape, "geoms"):
            yield from _parts(list(shape.geoms))
        else:
            yield point_segments(np.asarray(shape.coords)[:, :2]), False


def _localise(segments: Floats, grid: Grid) -> tuple[Floats | None, tuple[slice, slice]]:
    """Segments in cells from the first cell of the window of the grid that they can touch, and that window.

    The window reaches one cell beyond the grid's part of their bounding box; None where they miss the grid.
    """
    local = (segments - np.tile(grid.lower, 2)) / grid.spacing
    far = float(np.abs(local).max(initial=0.0))
    if far > MAX_COORDINATE:
        raise InputError(
            f"an obstacle reaches {far:.3g} cells from the map's corner; at most {MAX_COORDINATE:.0f} keep the answers "
            "proven against rounding; clip the obstacles to the map, or check their units (metres)"
        )
    points = local.reshape(-1, 2)
    first = np.maximum(np.floor(points.min(axis=0)).astype(int) - 1, 0)
    stop = np.minimum(np.floor(points.max(axis=0)).astype(int) + 2, grid.shape)
    window = (slice(int(first[0]), int(stop[0])), slice(int(first[1]), int(stop[1])))
    if (first >= stop).any():
        return None, window
    return np.ascontiguousarray(local - np.tile(first, 2)), window


def _touched_and_inside(local: Floats, shape: tuple[int, ...], filled: bool) -> tuple[Bools, Bools]:
    from cspace.raster import _kernels

    touched = np.zeros(shape, dtype=np.bool_)
    inside = np.zeros(shape, dtype=np.bool_)
    _kernels.mark_touched(touched, local, np.zeros(len(local)), 0.0, 1.0, SLACK)
    if filled:
        _kernels.mark_inside(inside, local, 0.5)
    return touched, inside

"""Outlines: the border of a shape as an array of segments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely.geometry import Polygon

Floats = NDArray[np.float64]


def polygon_outline(polygon: Polygon) -> Floats:
    """Segments ``(x0, y0, x1, y1)`` of all rings of a polygon, shape (E, 4)."""
    rings = [polygon.exterior, *polygon.interiors]
    return np.concatenate([point_segments(np.asarray(ring.coords)[:, :2]) for ring in rings])


def point_segments(points: Floats) -> Floats:
    """Segments between consecutive points, shape (n - 1, 4); one point gives one segment of length zero."""
    if len(points) == 1:
        points = np.repeat(points, 2, axis=0)
    return np.hstack([points[:-1], points[1:]])

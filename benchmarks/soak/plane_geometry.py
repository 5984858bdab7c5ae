"""Exact geometry, as an oracle: shapely on the shapes themselves, never on our rasters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cspace import Grid
from cspace.arrays import Bools, Floats

ROUNDING = 1e-9
"""Metres within which the decision between free and collision is left open."""


def union_of_cells(occupied: Bools, grid: Grid) -> Any:
    """The closed cells as one shapely geometry."""
    import shapely

    steps = np.diff(np.pad(occupied.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (x, first), stop = np.nonzero(steps > 0), np.nonzero(steps < 0)[1]
    lower, spacing = grid.lower, grid.spacing
    left, right = lower[0] + spacing * x, lower[0] + spacing * (x + 1)
    return shapely.union_all(shapely.box(left, lower[1] + spacing * first, right, lower[1] + spacing * stop))


def frame(grid: Grid, width: float) -> Any:
    """What lies around a grid, up to some width, as one shapely geometry."""
    import shapely

    (left, low), (right, high) = grid.lower, grid.upper
    hole = [(left, low), (right, low), (right, high), (left, high)]
    return shapely.Polygon(shapely.box(left - width, low - width, right + width, high + width).exterior, [hole])


@dataclass(frozen=True)
class Shape:
    """An exact robot: polygons, or discs by middle and radius.

    Configurations are ``(x, y)``, shape (n, 2), or ``(x, y, yaw)``, shape (n, 3); what turns is turned by its
    coordinates, so that discs stay discs.

    Attributes
    ----------
    polygons : sequence of shapely Polygon
    centers, radii : ndarray, shape (n, 2) and (n,)
    """

    polygons: Sequence[Any]
    centers: Floats
    radii: Floats

    def meets(self, obstacles: Sequence[Any], q: Floats, distance: float | Floats) -> Bools:
        """Whether the robot comes within a distance, or one for each configuration, of obstacles."""
        import shapely

        hit = np.zeros(len(q), dtype=np.bool_)
        for center, radius in zip(self.centers, self.radii, strict=True):
            points = shapely.points(moved(center[None], q)[:, 0])
            for obstacle in obstacles:
                hit |= shapely.dwithin(obstacle, points, radius + distance)
        for polygon in self.polygons:
            turned = placed(polygon, q)
            for obstacle in obstacles:
                # Of a prepared polygon alone, dwithin misses some that cross it (GEOS 3.14).
                hit |= shapely.intersects(obstacle, turned)
                if np.any(np.asarray(distance) > 0.0):
                    hit |= shapely.dwithin(obstacle, turned, distance)
        return hit

    def lies_in(self, whole: Any, q: Floats, distance: float) -> Bools:
        """Whether the robot, grown by a distance, lies in a region."""
        import shapely

        border = whole.boundary
        inside = np.ones(len(q), dtype=np.bool_)
        for center, radius in zip(self.centers, self.radii, strict=True):
            points = shapely.points(moved(center[None], q)[:, 0])
            inside &= shapely.intersects(whole, points)
            inside &= shapely.distance(border, points) >= radius + distance - ROUNDING
        for polygon in self.polygons:
            turned = placed(polygon, q)
            inside &= shapely.covers(whole, turned) & (shapely.distance(border, turned) >= distance - ROUNDING)
        return inside

    def reach(self) -> float:
        """Largest distance of a point of the robot from its reference point."""
        import shapely

        far = [np.hypot(*shapely.get_coordinates(polygon).T).max() for polygon in self.polygons]
        return float(max([*far, *(np.hypot(*self.centers.T) + self.radii)]))


def placed(polygon: Any, q: Floats) -> Any:
    """Copies of a polygon at configurations."""
    import shapely

    def rings(ring: Any) -> Any:
        return shapely.linearrings(moved(np.asarray(ring.coords)[:, :2], q))

    if not polygon.interiors:
        return shapely.polygons(rings(polygon.exterior))
    holes = np.stack([rings(ring) for ring in polygon.interiors], axis=1)
    return shapely.polygons(rings(polygon.exterior), holes=holes)


def moved(points: Floats, q: Floats) -> Floats:
    """Points of the robot, shape (m, 2), at configurations: shape (n, m, 2)."""
    if q.shape[1] == 2:
        return np.asarray(points[None] + q[:, None])
    cosine, sine = np.cos(q[:, 2])[:, None], np.sin(q[:, 2])[:, None]
    x, y = points[:, 0], points[:, 1]
    return np.stack([cosine * x - sine * y + q[:, :1], sine * x + cosine * y + q[:, 1:2]], axis=-1)

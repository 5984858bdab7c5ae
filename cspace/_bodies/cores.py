"""Shapes of the plane as geometries with radii, laid down at poses."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cspace._shapes import ExactShape
from cspace._shapes.balls import Balls
from cspace._support.arrays import Floats


class Cores:
    """Geometries of the plane, each grown by a radius, that make up a shape exactly.

    Attributes
    ----------
    parts : list of tuple
        Shapely geometry and radius, metres; the center of each disc, or all polygons.
    """

    def __init__(self, shape: ExactShape) -> None:
        """Split a shape of the plane into its parts."""
        self.parts: list[tuple[BaseGeometry, float]] = [(shape.outline, 0.0)]
        if isinstance(shape, Balls):
            points = map(shapely.Point, shape.centers.tolist())
            self.parts = list(zip(points, shape.radii.tolist(), strict=True))
        for geometry, _ in self.parts:
            shapely.prepare(geometry)

    def place(self, poses: Floats) -> list[tuple[Any, float]]:
        """Return arrays of geometries at poses, shape (n, 3), with their radii."""
        placed = []
        for geometry, radius in self.parts:
            corners = place_points(shapely.get_coordinates(geometry), poses).reshape(-1, 2)
            copies = np.repeat(geometry, len(poses))
            placed.append((shapely.set_coordinates(copies, corners), radius))
        return placed

    def measure_distances(
        self, poses: Floats, second: Cores, others: Floats
    ) -> tuple[Floats, Floats]:
        """Return distances to a second shape at poses, and the cores' nearest points.

        Distances, shape (n,), are within :meth:`bound_rounding`; points have shape (n, 2, 2). A
        negative distance is a depth: shapes that overlap only by rounding are less deep than that.
        The depth of polygons is the area that they share over its perimeter.
        """
        distances = np.full(len(poses), np.inf)
        lines = np.zeros((len(poses), 2, 2))
        for one, radius in self.place(poses):
            for other, other_radius in second.place(others):
                joins = shapely.shortest_line(one, other)
                found = shapely.length(joins) - radius - other_radius
                if radius == other_radius == 0.0:
                    meet = np.flatnonzero(found == 0.0)
                    common = shapely.intersection(one[meet], other[meet])
                    found[meet] = -shapely.area(common) / np.maximum(shapely.length(common), 1e-300)
                nearer = found < distances
                distances[nearer] = found[nearer]
                lines[nearer] = shapely.get_coordinates(joins[nearer]).reshape(-1, 2, 2)
        return distances, lines

    @staticmethod
    def bound_rounding(largest: Floats) -> Floats:
        """Return a distance, metres, that covers the rounding of placed shapes.

        ``largest`` are the moduli of their largest coordinates, metres.
        """
        return 1e-9 + 1e-11 * largest


def place_points(offsets: Floats, points: Floats) -> Floats:
    """Return the robot's points (k, 2) at configurations, shape (n, k, 2)."""
    yaws = points[:, 2] if points.shape[1] > 2 else np.zeros(len(points))
    cos, sin = np.cos(yaws), np.sin(yaws)
    turns = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=1)
    return np.asarray(offsets @ turns.swapaxes(1, 2) + points[:, np.newaxis, :2])

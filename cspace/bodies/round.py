"""Balls, in the plane (discs) or in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cspace.bodies.body import Body, Floats, Surface, frozen
from cspace.raster.raster import Raster

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class Balls(Body):
    """A union of balls.

    Parameters
    ----------
    centers : ndarray, shape (n, dim)
    radii : ndarray, shape (n,)
    """

    def __init__(self, centers: Floats, radii: Floats) -> None:
        self.centers, self.radii = frozen(centers), frozen(radii)
        self.dim = centers.shape[1]

    @property
    def span(self) -> float:
        return float((np.abs(self.centers).max(axis=1) + self.radii).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        reach = self.radii[:, None]
        return (self.centers - reach).min(axis=0), (self.centers + reach).max(axis=0)

    @property
    def measure(self) -> float:
        if self.dim == 2:
            return float(self.geometry.area)
        return float(4.0 / 3.0 * np.pi * self.radii[0] ** 3) if len(self.radii) == 1 else float("nan")

    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        if self.dim == 2:
            from cspace.raster.robots import ball_rasters

            return ball_rasters(self.centers, self.radii, spacing, margin, yaw, sweep)
        from cspace.raster.boxes import solid_ball_rasters

        return solid_ball_rasters(self.centers, self.radii, spacing, margin)

    def is_same_turned(self, turn: Floats) -> bool:
        turned = self.centers @ turn + 0.0
        sets = [
            {(x, y, radius) for (x, y), radius in zip(points.tolist(), self.radii.tolist(), strict=True)}
            for points in (self.centers + 0.0, turned)
        ]
        return sets[0] == sets[1]

    @property
    def is_round(self) -> bool:
        return len(self.radii) == 1 and not self.centers.any()

    @property
    def geometry(self) -> BaseGeometry:
        if self.dim == 3:
            return super().geometry
        import shapely

        return shapely.union_all(shapely.buffer(shapely.points(self.centers), self.radii, quad_segs=32))

    @property
    def surface(self) -> Surface:
        if self.dim == 2:
            return super().surface
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=3 if len(self.radii) < 64 else 1)
        corners, faces = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64)
        vertices = self.centers[:, None] + self.radii[:, None, None] * corners
        shifts = len(corners) * np.arange(len(self.radii))
        return vertices.reshape(-1, 3), (faces + shifts[:, None, None]).reshape(-1, 3)

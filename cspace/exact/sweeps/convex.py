"""Robots as convex parts: whole stretches are proven at once, by planes that separate them from triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.exact.surfaces import groups_of
from cspace.raster.bitmaps import cell_boxes
from cspace.shapes import Balls, Box, Shape, Voxels
from cspace.translating import entry

if TYPE_CHECKING:
    from cspace.exact.surfaces import Surface
    from cspace.exact.sweeps._kernels import Scene

Floats = NDArray[np.float64]
Point = tuple[float, float, float]


class Convex:
    """A robot as a union of boxes, balls or triangles, against the surfaces of obstacles.

    Parameters
    ----------
    body : Body
        Of the robot.
    robot, obstacles : sequence of Surface
        Metres.
    scale : float
        A power of two that takes the largest coordinate to a number whose fourth power neither overflows nor leaves
        small ones to underflow.
    margin : float
        Metres.

    Attributes
    ----------
    refutes : bool
        Whether what is not proven comes too near. Otherwise it may pass an edge or a corner at a distance that no
        plane shows.
    """

    def __init__(
        self, body: Shape, robot: Sequence[Surface], obstacles: Sequence[Surface], scale: float, margin: float
    ) -> None:
        from cspace.exact.sweeps import _kernels

        scene = _scene(obstacles, scale)
        self._scale, self._margin, self._bare = scale, margin, not scene.radii.any()
        self.refutes = self._bare and margin == 0.0
        if isinstance(body, Balls):
            self.refutes = True
            parts = scale * np.column_stack([body.centers, body.radii])
            self._clear = entry(_kernels.balls_are_clear, (scene, parts), 7)
        elif isinstance(body, Box | Voxels):
            self._clear = entry(_kernels.boxes_are_clear, (scene, scale * boxes_of(body)), 7)
        else:
            self._clear = entry(_kernels.meshes_are_clear, (scene, _scene(robot, scale)), 7)

    def clear(self, q: Point, end: Point, least: float) -> bool | None:
        """Whether the robot stays farther than ``least`` from all surfaces on its way from q; None if not decided."""
        h, (x, y, z), (u, v, w) = self._scale, q, end
        way = (x * h, y * h, z * h, (u - x) * h, (v - y) * h, (w - z) * h)
        if self._clear(*way, least * h):
            return True
        # Where no plane separates them without the margin either, they meet.
        meets = self.refutes or (self._bare and not self._clear(*way, (least - self._margin) * h))
        return False if meets else None


def _scene(surfaces: Sequence[Surface], scale: float) -> Scene:
    """Surfaces, scaled, in groups of neighbours."""
    from cspace.exact.sweeps._kernels import Scene

    groups = [(group, surface.radius) for surface in surfaces for group in groups_of(scale * surface.triangles)]
    radii = scale * np.array([radius for _, radius in groups], dtype=np.float64)
    starts = np.cumsum([0, *(len(group) for group, _ in groups)], dtype=np.int64)
    corners: list[Any] = [(*group.min(axis=(0, 1)), *group.max(axis=(0, 1))) for group, _ in groups]
    grown = np.array(corners, dtype=np.float64).reshape(-1, 6) + radii[:, None] * np.repeat([-1.0, 1.0], 3)
    return Scene(np.concatenate([np.empty((0, 3, 3)), *(group for group, _ in groups)]), starts, radii, grown)


def boxes_of(body: Shape) -> Floats:
    """Lower and upper corners of the boxes that a robot is made of, shape (n, 6)."""
    if isinstance(body, Voxels):
        return np.hstack(cell_boxes(body.occupied, body.side, body.lower))
    lower, upper = body.bounds
    return np.concatenate([lower, upper])[None]

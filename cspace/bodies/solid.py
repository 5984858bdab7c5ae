"""Bodies in space: boxes, unions of voxels, and meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cspace.bodies.body import Body, Floats, Surface, frozen
from cspace.raster.raster import Raster

if TYPE_CHECKING:
    from cspace.mesh import Mesh

_CORNERS = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], dtype=np.float64)
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_FACES = np.array([t for a, b, c, d in _QUADS for t in ((a, b, c), (a, c, d))], dtype=np.int64)


class Box(Body):
    """A box along the axes, from a lower to an upper corner, shape (3,) each."""

    dim = 3

    def __init__(self, lower: Floats, upper: Floats) -> None:
        self.lower, self.upper = frozen(lower), frozen(upper)

    @property
    def span(self) -> float:
        return float(np.abs([self.lower, self.upper]).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        return self.lower, self.upper

    @property
    def measure(self) -> float:
        return float(np.prod(self.upper - self.lower))

    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        from cspace.raster.boxes import box_rasters

        return box_rasters(self.lower, self.upper, spacing, margin)

    @property
    def surface(self) -> Surface:
        return self.lower + _CORNERS * (self.upper - self.lower), _FACES.copy()


class Voxels(Body):
    """The union of the closed voxels ``lower + side * (i + [0, 1]^3)`` where ``occupied[i]`` is set."""

    dim = 3

    def __init__(self, occupied: NDArray[np.bool_], side: float, lower: Floats) -> None:
        self.occupied, self.side, self.lower = frozen(occupied), side, frozen(lower)

    @property
    def span(self) -> float:
        return float(np.abs(self.lower).max() + self.side * max(self.occupied.shape))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        used = np.argwhere(self.occupied)
        return self.lower + self.side * used.min(axis=0), self.lower + self.side * (used.max(axis=0) + 1)

    @property
    def measure(self) -> float:
        return float(np.count_nonzero(self.occupied)) * self.side**3

    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        from cspace.raster.boxes import voxel_rasters

        return voxel_rasters(self.occupied, self.side, self.lower, spacing, margin)

    @property
    def surface(self) -> Surface:
        used = np.argwhere(self.occupied).astype(np.float64)
        padded = np.pad(self.occupied, 1)
        inside = np.ones(len(used), dtype=np.bool_)
        for axis in range(3):
            for step in (-1, 1):
                inside &= np.roll(padded, -step, axis)[1:-1, 1:-1, 1:-1][self.occupied]
        corners = self.lower + self.side * (used[~inside, None] + _CORNERS)
        faces = _FACES + 8 * np.arange(len(corners))[:, None, None]
        return corners.reshape(-1, 3), faces.reshape(-1, 3)


class Solid(Body):
    """A triangle mesh; its closed parts are solid, as :class:`cspace.mesh.Mesh` tells."""

    dim = 3

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    @property
    def span(self) -> float:
        return float(np.abs(self.mesh.bounds).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        lower, upper = self.mesh.bounds
        return lower, upper

    @property
    def measure(self) -> float:
        return float(self.mesh.volume) if self.mesh.is_watertight else float("nan")

    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        from cspace.raster.solids import mesh_rasters

        return mesh_rasters(self.mesh, spacing, margin)

    @property
    def surface(self) -> Surface:
        return self.mesh.vertices, self.mesh.faces

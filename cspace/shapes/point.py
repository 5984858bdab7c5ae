"""Point: a robot without extent, for maps of which every point is a whole configuration already."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.raster.raster import Raster
from cspace.rotations import STILL, Turn
from cspace.shapes.balls import Balls

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class Point(Balls):
    """The origin alone, as an arm is in the space of its joints.

    Where it is in a cell, it meets no other one: the workspace must name all cells that obstacles touch, those on whose
    border alone they do among them. Then its map is the workspace, cell for cell.
    """

    shown = False

    @classmethod
    def at_origin(cls, dim: int) -> Point:
        """The one of the plane, or of space."""
        return cls(np.zeros((1, dim)), np.zeros(1))

    def rasters(self, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
        if margin > 0.0:
            return super().rasters(spacing, margin, turn)
        own = Raster.trimmed(np.ones((1,) * self.dim, dtype=np.bool_), (0,) * self.dim)
        return own, own

    @property
    def outline(self) -> BaseGeometry:
        if self.dim == 3:
            return super().outline
        import shapely

        return shapely.Polygon(np.zeros((4, 2)))

    @property
    def spec(self) -> dict[str, Any]:
        return {"kind": "point", "dim": self.dim}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any]) -> Point:
        """The shape of a :attr:`spec`."""
        return cls.at_origin(int(spec["dim"]))

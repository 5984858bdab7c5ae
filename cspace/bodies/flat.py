"""Regions of the plane, given by their borders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cspace.bodies.body import Body, Floats, frozen
from cspace.raster.raster import Raster

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


class Regions(Body):
    """A union of regions of the plane.

    Parameters
    ----------
    outlines : sequence of ndarray, shape (E, 4)
        Border segments ``(x0, y0, x1, y1)`` of each region; a point is in the region by even-odd parity.
    span : float
        Largest modulus of the numbers that the borders were computed from, if larger than theirs.
    """

    dim = 2

    def __init__(self, outlines: Sequence[Floats], span: float = 0.0) -> None:
        self.outlines = tuple(frozen(outline) for outline in outlines)
        self._span = max(span, *(float(np.abs(outline).max()) for outline in self.outlines))

    @property
    def span(self) -> float:
        return self._span

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        points = np.concatenate([outline.reshape(-1, 2) for outline in self.outlines])
        return points.min(axis=0), points.max(axis=0)

    @property
    def measure(self) -> float:
        return float(self.geometry.area)

    def rasters(self, spacing: float, margin: float, yaw: float = 0.0, sweep: float = 0.0) -> tuple[Raster, Raster]:
        from cspace.raster.robots import outline_rasters

        return outline_rasters(self.outlines, spacing, margin, yaw, sweep)

    def is_same_turned(self, turn: Floats) -> bool:
        return self._segments(np.eye(2)) == self._segments(turn)

    @property
    def geometry(self) -> BaseGeometry:
        import shapely

        regions = [
            shapely.build_area(shapely.union_all(shapely.linestrings(outline.reshape(-1, 2, 2))))
            for outline in self.outlines
        ]
        return shapely.union_all(regions)

    def _segments(self, turn: Floats) -> set[tuple[float, ...]]:
        """Border segments without direction, turned, with the number of their region."""
        found: set[tuple[float, ...]] = set()
        for number, outline in enumerate(self.outlines):
            ends = (outline.reshape(-1, 2) @ turn + 0.0).reshape(-1, 2, 2).tolist()
            found.update((*min(first, last), *max(first, last), number) for first, last in ends)
        return found

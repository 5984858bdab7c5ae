"""Shapes in space cut into layers, for robots that drive on a floor.

Layer k of a scene is ``[z_k, z_k + h]``. A robot that drives on a floor keeps its heights, so its
part between the heights of a layer meets that layer alone, and seen from above it is a plane robot.
"""

from __future__ import annotations

import json
import math
from typing import NamedTuple

import numpy as np

from cspace._grid import SLACK, Grid
from cspace._raster import Raster
from cspace._rotations import NO_ROTATION, RotationCell
from cspace._shapes.shape import BoundedShape, ExactShape, Shape, Slab


class Heights(NamedTuple):
    """Layers of a scene, by their heights in the frame of a robot.

    Attributes
    ----------
    lowest : float
        Lower border of the first layer, metres.
    layers : int
        Number of layers.
    """

    lowest: float
    layers: int

    @classmethod
    def of(cls, grid: Grid, floor: float | None) -> Heights | None:
        """Return the layers of a grid in space for a robot on a floor; None without a floor."""
        return None if floor is None else cls(grid.lower[2] - floor, grid.shape[2])

    def find_layers(self, shape: Shape, spacing: float) -> slice:
        """Return the layers that a shape may touch, ``spacing`` high each."""
        first, stop = np.clip(self._find_range(shape, spacing), 0, self.layers).tolist()
        return slice(first, stop)

    def contain(self, shape: Shape, spacing: float) -> bool:
        """Return True if a shape touches nothing above or below the layers."""
        first, stop = self._find_range(shape, spacing)
        return first >= 0 and stop <= self.layers

    def _find_range(self, shape: Shape, spacing: float) -> tuple[int, int]:
        """Return the first layer that a shape may touch, and that after the last one."""
        bottom, top = (float(corner[2]) for corner in shape.outer.bounds)
        first = math.floor((bottom - self.lowest) / spacing - SLACK)
        # A border of two layers belongs to both.
        return first, math.floor((top - self.lowest) / spacing + SLACK) + 1


class LayeredShape(BoundedShape):
    """A shape in space whose rasters are those of its layers, seen from above.

    Offsets of a raster are (x, y, layer), where the layer is one of the scene.
    """

    def __init__(self, shape: Shape, heights: Heights, spacing: float) -> None:
        """Cut a shape into layers that are ``spacing`` high, metres."""
        super().__init__(shape.outer, shape.inner, shape.is_round_about_z)
        self._slabs: list[tuple[int, Slab]] = []
        same_shapes: dict[str, ExactShape] = {}

        def share(part: ExactShape | None) -> ExactShape | None:
            """Return the first of all equal parts, whose rasters are made once."""
            return part and same_shapes.setdefault(json.dumps(part.spec), part)

        layers = heights.find_layers(shape, spacing)
        for layer in range(layers.start, layers.stop):
            low = heights.lowest + spacing * layer
            outer, inner = shape.slab(low, heights.lowest + spacing * (layer + 1), SLACK * spacing)
            self._slabs.append((layer, (share(outer), share(inner))))

    @property
    def layers_of_parts(self) -> dict[ExactShape, list[int]]:
        """Layers of each part that contains the shape between their heights, seen from above."""
        layers: dict[ExactShape, list[int]] = {}
        for layer, (outer, _) in self._slabs:
            if outer is not None:
                layers.setdefault(outer, []).append(layer)
        return layers

    def rasters(
        self, spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
    ) -> tuple[Raster, Raster]:
        """Stack the rasters of the layers; see ``Shape.rasters``."""
        pairs: dict[ExactShape, tuple[Raster, Raster]] = {}
        sides: tuple[list[tuple[int, Raster]], ...] = ([], [])
        for layer, parts in self._slabs:
            for side, part in enumerate(parts):
                if part is None:
                    continue
                if part not in pairs:
                    pairs[part] = part.rasters(spacing, margin, rotation.in_plane)
                sides[side].append((layer, pairs[part][side]))
        outer, inner = map(_stack, sides)
        return outer, inner


def _stack(layers: list[tuple[int, Raster]]) -> Raster:
    """Stack plane rasters of layers, as offsets (x, y, layer)."""
    layers = [(layer, raster) for layer, raster in layers if raster.cells.size]
    if not layers:
        return Raster(np.zeros((0, 0, 0), dtype=np.bool_), (0, 0, 0))
    lower = np.min([raster.lower for _, raster in layers], axis=0)
    upper = np.max([raster.upper for _, raster in layers], axis=0)
    first, last = layers[0][0], layers[-1][0]
    cells = np.zeros((*(upper - lower + 1), last - first + 1), dtype=np.bool_)
    for layer, raster in layers:
        start = raster.lower - lower
        x, y = map(slice, start, start + raster.cells.shape)
        cells[x, y, layer - first] = raster.cells
    return Raster.from_bitmap(cells, (*lower.tolist(), first))

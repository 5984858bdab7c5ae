"""Images that are turned about their corner, rasterised onto an upright grid."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.files.ros import MapInfo
from cspace.grid import SLACK, Grid
from cspace.limits import check_cells
from cspace.raster.bitmaps import boundary_segments
from cspace.raster.segments import outline_cells

QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""


def upright(info: MapInfo, free: Bools, occupied: Bools, unknown: str) -> tuple[Grid, Bools, Bools, Bools]:
    """Return the upright grid of an image, its cells that meet and that lie in obstacles, and the unknown ones.

    What is neither free nor occupied is unknown, and counts as ``unknown`` says: "occupied" or "free". ``free`` and
    ``occupied`` may be overwritten.

    An image that is turned by a whole number of quarter turns stays exact. By any other ``yaw`` its cells become
    squares turned about the origin's corner; they are rasterised onto an upright grid of the same spacing that covers
    them. A cell of it is unknown if its middle lies in an unknown cell or beyond the image.

    Raises InputError if no grid can lie there, and FileError if it has more cells than are read, or than fit into
    memory.
    """
    unsure = free | occupied
    np.logical_not(unsure, out=unsure)
    solid = np.logical_not(free, out=free) if unknown == "occupied" else occupied
    turns = _quarter_turns(info.yaw, solid.shape)
    if turns is None:
        return _turned(info, solid, unsure, solid_around=unknown == "occupied")
    lower, _ = _extent(info, solid.shape, *QUARTERS[turns])
    cells = np.rot90(solid, turns)
    return Grid(lower, info.resolution, cells.shape), cells, cells, np.rot90(unsure, turns)


def _quarter_turns(yaw: float, shape: tuple[int, ...]) -> int | None:
    """Number of quarter turns, 0 to 3, where ``yaw`` is a multiple of them up to rounding; else None."""
    if abs(yaw) > 4.0 * math.pi:  # so far out, multiples of pi / 2 are off by more than the yaw that is asked for
        return None
    turns = round(yaw / (math.pi / 2))
    error = abs(yaw - turns * (math.pi / 2))
    return turns % 4 if error * math.hypot(*shape) <= SLACK / 64 else None


def _extent(info: MapInfo, shape: tuple[int, ...], cos: float, sin: float) -> tuple[Floats, Floats]:
    """Lower and upper corner of the box around the turned map, in metres."""
    corners = np.array([(0, 0), (shape[0], 0), shape, (0, shape[1])]) @ np.array([(cos, sin), (-sin, cos)])
    return (
        np.asarray(info.origin + info.resolution * corners.min(axis=0)),
        np.asarray(info.origin + info.resolution * corners.max(axis=0)),
    )


def _turned(info: MapInfo, solid: Bools, unknown: Bools, solid_around: bool) -> tuple[Grid, Bools, Bools, Bools]:
    """The map turned by its yaw, on an upright grid; ``solid_around``: whether the ground around it is solid."""
    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    lower, upper = _extent(info, solid.shape, cos, sin)
    # The corners are rounded, so that the grid is wider than their box by more than that.
    counts = np.ceil((upper - lower) / info.resolution + 2.0 * SLACK)
    middle = 0.5 * (lower + upper)
    shape = tuple(int(n) for n in counts)
    check_cells(info.source, shape, memory=8.0)
    grid = Grid(middle - 0.5 * info.resolution * counts, info.resolution, shape)
    # The border of whichever set lies within the turned map: the ground around it then needs no border of its own.
    bounded = ~solid if solid_around else solid
    segments = boundary_segments(bounded, 1.0, (0.0, 0.0)).reshape(-1, 2)
    turned = info.origin + info.resolution * (segments @ np.array([(cos, sin), (-sin, cos)]))
    outer, inner = outline_cells([(turned.reshape(-1, 4), True)] if len(segments) else [], grid)
    if solid_around:
        outer, inner = ~inner, ~outer
    return grid, outer, inner, _sampled(info, unknown, grid)


def _sampled(info: MapInfo, cells: Bools, grid: Grid) -> Bools:
    """Cells of a grid whose middle lies in a given cell of the turned map, or beyond it."""
    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    x, y = (grid.centers(axis) - info.origin[axis] for axis in range(2))
    sampled = np.ones(grid.shape, dtype=np.bool_)
    for column, along in enumerate(x):  # a column at a time: places of all cells would take 32 bytes each
        places = np.stack([cos * along + sin * y, cos * y - sin * along], axis=-1) / info.resolution
        cell = np.floor(places).astype(np.int64)
        within = ((cell >= 0) & (cell < cells.shape)).all(axis=-1)
        sampled[column, within] = cells[tuple(cell[within].T)]
    return sampled

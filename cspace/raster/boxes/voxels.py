"""A union of voxels as a robot in R^3."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.grid import SLACK
from cspace.raster.boxes.rounded import mark_touched
from cspace.raster.raster import Raster, blank

Bools = NDArray[np.bool_]


def voxel_rasters(
    occupied: Bools, voxel: float, lower: ArrayLike, spacing: float, margin: float = 0.0
) -> tuple[Raster, Raster]:
    """Rasters of the union of the closed voxels ``lower + voxel * (n + [0, 1]^3)`` where ``occupied[n]`` is set.

    Outer: the voxels are merged into boxes with the same union. Inner: a lattice point lies in one of the voxels whose
    intervals, grown by ``SLACK``, hold its coordinates; it is in the robot where all of these are occupied. So points
    on borders between occupied voxels count, and those on the border of the robot do not.

    Parameters
    ----------
    occupied : ndarray of bool, shape (nx, ny, nz)
        Indexed ``[x, y, z]``, at least one True.
    voxel : float
        Side of a voxel, metres; it need not fit the map's spacing, nor ``lower`` its lattice.
    lower : array-like, shape (3,)
        Lower corner of voxel (0, 0, 0) in the robot's frame, metres.
    spacing, margin : float
        Metres.

    Returns
    -------
    outer, inner : Raster
        As for :func:`~cspace.raster.boxes.solid_ball_rasters`.

    Raises
    ------
    InputError
        If the robot is too many cells large.
    """
    from cspace.raster.boxes import _kernels

    corner, side, radius = np.asarray(lower, dtype=np.float64) / spacing, voxel / spacing, margin / spacing
    boxes = _kernels.merge_boxes(np.ascontiguousarray(occupied))
    lows, highs = corner + side * boxes[:, :3], corner + side * boxes[:, 3:]
    outer, first = blank(lows.min(axis=0) - radius - 1.0, highs.max(axis=0) + radius + 1.0)
    shift = np.asarray(first, dtype=np.float64)
    mark_touched(outer, lows - shift, highs - shift, np.full(len(boxes), radius), -1.0, 1.0)
    inner = np.asarray(occupied)
    for axis in range(3):
        points = np.arange(outer.shape[axis], dtype=np.float64) + first[axis]
        inner = _held(inner, axis, points - corner[axis], side)
    return Raster.trimmed(outer, first), Raster.trimmed(inner, first)


def _held(cells: Bools, axis: int, points: NDArray[np.float64], side: float) -> Bools:
    """Along one axis, whether all the cells that could hold each coordinate are set.

    Parameters
    ----------
    cells : ndarray of bool
    axis : int
    points : ndarray, shape (m,)
        Coordinates in lattice steps from the lower border of cell 0; cells are ``side`` long.

    Returns
    -------
    ndarray of bool
        As ``cells``, with m entries along the axis.
    """
    count = cells.shape[axis]
    # Rounding up less one, and down, takes both neighbours of a border; SLACK, both neighbours of one that is near.
    first = np.clip(np.ceil((points - SLACK) / side) - 1.0, -1, count).astype(np.int64)
    last = np.clip(np.floor((points + SLACK) / side), -1, count).astype(np.int64)
    within = (first >= 0) & (last < count)
    first, last = np.where(within, first, 0), np.where(within, last, 0)
    held = np.take(cells, first, axis=axis)
    for step in range(1, int((last - first).max()) + 1):
        held &= np.take(cells, np.minimum(first + step, last), axis=axis)
    return np.asarray(held & within.reshape(tuple(-1 if a == axis else 1 for a in range(cells.ndim))))

"""A box as a robot in R^3."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cspace.raster.boxes.rounded import mark_inside, mark_touched
from cspace.raster.raster import Raster, blank


def box_rasters(lower: ArrayLike, upper: ArrayLike, spacing: float, margin: float = 0.0) -> tuple[Raster, Raster]:
    """Rasters of an axis-aligned box; the margin rounds the outer one's edges.

    Parameters
    ----------
    lower, upper : array-like, shape (3,)
        Corners in the robot's frame, metres.
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
    low = np.atleast_2d(np.asarray(lower, dtype=np.float64) / spacing)
    high = np.atleast_2d(np.asarray(upper, dtype=np.float64) / spacing)
    radius = margin / spacing
    outer, first = blank(low[0] - radius - 1.0, high[0] + radius + 1.0)
    inner = np.zeros_like(outer)
    shift = np.asarray(first, dtype=np.float64)
    mark_touched(outer, low - shift, high - shift, np.array([radius]), -1.0, 1.0)
    mark_inside(inner, low - shift, high - shift, np.zeros(1), 0.0, 0.0)
    return Raster.trimmed(outer, first), Raster.trimmed(inner, first)

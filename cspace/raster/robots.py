"""Outer and inner rasters of robots in the plane.

With ``h`` the spacing and ``A`` the robot, grown by the margin on the outer side,

* outer = { m : A meets h * (m + [-1, 1]^2) },
* inner = { m : h * m lies in A }.

*Safety against rounding.* All work is done in cells, on numbers below 2^22. The scaled vertices and each interval end
computed from them are then off by less than 2^-28 cells: a few roundings of 2^-53 relative to such numbers, and no
difference is ever divided by a smaller one (the clip parameter of an edge is a ratio in [0, 1] whose relative error is
three roundings; the half chord of a disc is taken of a radius that was enlarged or reduced first, by more than the
rounding of its square). Outer rasters grow by ``SLACK`` = 2^-26 cells and inner ones shrink by as much. So the outer
raster holds every offset that the definition asks for, and at most those within 2 ``SLACK`` of it besides; the inner
one holds no offset that the definition forbids, and leaves out at most those within 3 ``SLACK`` of the robot's border,
among them lattice points exactly on it. The rounding of a look-up (also below 2^-28 cells) is covered by the same
slack.

The work grows with the length of the boundary; only the parity fill visits every cell of the bounding box, at one byte
each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cspace.grid import SLACK
from cspace.raster.raster import Raster, blank

Floats = NDArray[np.float64]


def outline_rasters(outlines: Sequence[Floats], spacing: float, margin: float = 0.0) -> tuple[Raster, Raster]:
    """Rasters of a union of regions, each given by the segments of its border.

    Parameters
    ----------
    outlines : sequence of ndarray, shape (E, 4)
        Segments ``(x0, y0, x1, y1)`` in metres; those of one region form closed curves, in any order, and the region
        is what they enclose by even-odd parity.
    spacing, margin : float
        Metres.

    Returns
    -------
    outer, inner : Raster
    """
    from cspace.raster import _kernels

    scaled = [outline / spacing for outline in outlines]
    radius = margin / spacing
    every = np.concatenate(scaled).reshape(-1, 2)
    outer, lower = blank(every.min(axis=0) - radius - 1.0, every.max(axis=0) + radius + 1.0)
    inner = np.zeros_like(outer)
    shift = np.tile(np.asarray(lower, dtype=np.float64), 2)
    for outline in scaled:
        local = np.ascontiguousarray(outline - shift)
        _kernels.mark_touched(outer, local, np.full(len(local), radius), -1.0, 1.0, SLACK)
        inside = np.zeros_like(outer)
        _kernels.mark_inside(inside, local, 0.0)
        outer |= inside
        border = np.zeros_like(outer)
        _kernels.mark_touched(border, local, np.zeros(len(local)), 0.0, 0.0, SLACK)
        inner |= inside & ~border
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def ball_rasters(centers: Floats, radii: Floats, spacing: float, margin: float = 0.0) -> tuple[Raster, Raster]:
    """Rasters of a union of discs.

    Parameters
    ----------
    centers : ndarray, shape (n, 2)
    radii : ndarray, shape (n,)
    spacing, margin : float
        Metres.

    Returns
    -------
    outer, inner : Raster
    """
    from cspace.raster import _kernels

    points, inner_radii = centers / spacing, radii / spacing
    outer_radii = (radii + margin) / spacing
    reach = outer_radii[:, None] + 1.0
    outer, lower = blank((points - reach).min(axis=0), (points + reach).max(axis=0))
    inner = np.zeros_like(outer)
    local = points - np.asarray(lower, dtype=np.float64)
    _kernels.mark_touched(outer, np.hstack([local, local]), outer_radii, -1.0, 1.0, SLACK)
    _kernels.mark_ball_points(inner, local, inner_radii, SLACK)
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)

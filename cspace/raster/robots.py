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

*Turning.* A rotation cell holds the turns within an angle a of its representative. A point p of the robot moves by at
most ``2 |p| sin(a / 2)`` within it. So the robot at any turn of the cell lies in the representative one with each piece
of its border grown by that, for the farthest point of the piece; and a point that is farther from each piece of the
border than that is inside at all turns, if it is inside at one. Pieces are cut short enough for the growth to vary by
less than a quarter of a cell along one.

The work grows with the length of the boundary; only the parity fill visits every cell of the bounding box, at one byte
each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cspace.grid import SLACK
from cspace.raster.raster import Raster, blank

Floats = NDArray[np.float64]


def outline_rasters(
    outlines: Sequence[Floats], spacing: float, margin: float = 0.0, yaw: float = 0.0, sweep: float = 0.0
) -> tuple[Raster, Raster]:
    """Rasters of a union of regions, each given by the segments of its border.

    Parameters
    ----------
    outlines : sequence of ndarray, shape (E, 4)
        Segments ``(x0, y0, x1, y1)`` in metres; those of one region form closed curves, in any order, and the region
        is what they enclose by even-odd parity.
    spacing, margin : float
        Metres.
    yaw : float
        Turn of the robot about its reference point, radians.
    sweep : float
        The rasters hold for all turns within this angle of ``yaw``, radians.

    Returns
    -------
    outer, inner : Raster
    """
    from cspace.raster import _kernels

    swing = 2.0 * math.sin(min(sweep, math.pi) / 2.0)
    scaled = [_turned(_cut(outline / spacing, swing), yaw) for outline in outlines]
    growths = [swing * _farthest(outline) for outline in scaled]
    radius = margin / spacing
    every = np.concatenate(scaled).reshape(-1, 2)
    reach = radius + max(float(growth.max()) for growth in growths) + 1.0
    outer, lower = blank(every.min(axis=0) - reach, every.max(axis=0) + reach)
    inner = np.zeros_like(outer)
    shift = np.tile(np.asarray(lower, dtype=np.float64), 2)
    for outline, growth in zip(scaled, growths, strict=True):
        local = np.ascontiguousarray(outline - shift)
        _kernels.mark_touched(outer, local, growth + radius, -1.0, 1.0, SLACK)
        inside = np.zeros_like(outer)
        _kernels.mark_inside(inside, local, 0.0)
        outer |= inside
        border = np.zeros_like(outer)
        _kernels.mark_touched(border, local, growth, 0.0, 0.0, SLACK)
        inner |= inside & ~border
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def ball_rasters(
    centers: Floats, radii: Floats, spacing: float, margin: float = 0.0, yaw: float = 0.0, sweep: float = 0.0
) -> tuple[Raster, Raster]:
    """Rasters of a union of discs, which turn by turning their centers.

    Parameters
    ----------
    centers : ndarray, shape (n, 2)
    radii : ndarray, shape (n,)
    spacing, margin : float
        Metres.
    yaw, sweep : float
        As for :func:`outline_rasters`.

    Returns
    -------
    outer, inner : Raster
    """
    from cspace.raster import _kernels

    points = centers / spacing
    growth = 2.0 * math.sin(min(sweep, math.pi) / 2.0) * np.hypot(points[:, 0], points[:, 1])
    points = _turned(points, yaw)
    inner_radii, outer_radii = radii / spacing - growth, (radii + margin) / spacing + growth
    reach = outer_radii[:, None] + 1.0
    outer, lower = blank((points - reach).min(axis=0), (points + reach).max(axis=0))
    inner = np.zeros_like(outer)
    local = points - np.asarray(lower, dtype=np.float64)
    _kernels.mark_touched(outer, np.hstack([local, local]), outer_radii, -1.0, 1.0, SLACK)
    _kernels.mark_ball_points(inner, local, inner_radii, SLACK)
    return Raster.trimmed(outer, lower), Raster.trimmed(inner, lower)


def _turned(points: Floats, yaw: float) -> Floats:
    """Points or segments, shape (n, 2) or (n, 4), turned about the origin."""
    if yaw == 0.0:
        return points
    cosine, sine = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    return np.ascontiguousarray((points.reshape(-1, 2) @ turn).reshape(points.shape))


def _cut(segments: Floats, swing: float) -> Floats:
    """Segments in cells, cut into pieces along which the growth ``swing * |p|`` varies by less than a quarter."""
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    pieces = np.maximum(np.ceil(4.0 * swing * lengths).astype(int), 1)
    if (pieces == 1).all():
        return segments
    whole = np.repeat(np.arange(len(segments)), pieces)
    number = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    starts, steps = segments[whole, :2], segments[whole, 2:] - segments[whole, :2]
    # Neighbouring pieces must share their ends to the last bit, so each end is computed by one formula.
    first = starts + steps * (number / pieces[whole])[:, None]
    last = np.where(
        (number + 1 == pieces[whole])[:, None],
        segments[whole, 2:],
        starts + steps * ((number + 1) / pieces[whole])[:, None],
    )
    return np.hstack([first, last])


def _farthest(segments: Floats) -> Floats:
    """Largest distance of each segment from the origin, shape (E,)."""
    return np.asarray(np.maximum(np.hypot(segments[:, 0], segments[:, 1]), np.hypot(segments[:, 2], segments[:, 3])))

"""Segments of the plane, each grown by a radius, and what closed curves of them enclose: robots and obstacles.

A *box* ``i`` is ``i + [b0, b1]^2``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of a
robot, ``(c, c)`` for sample points. Lengths are in cells, as the indices of the array that is written.

*Robots.* With ``h`` the spacing and ``A`` the robot, grown by the margin on the outer side,

* outer = { m : A meets h * (m + [-1, 1]^2) },
* inner = { m : h * m lies in A }.

*Obstacles.* Outer cells are those that meet an obstacle, inner ones those that lie in one obstacle.

*Safety against rounding.* All work is done in cells, on numbers below 2^22. The scaled vertices and each interval end
computed from them are then off by less than 2^-28 cells: a few roundings of 2^-53 relative to such numbers, and no
difference is ever divided by a smaller one (the clip parameter of an edge is a ratio in [0, 1] whose relative error is
three roundings; the half chord of an end disc is taken of a radius that was enlarged first, by more than the rounding
of its square). Outer rasters grow by ``SLACK`` = 2^-26 cells and inner ones shrink by as much. So the outer
raster holds every offset of the definition, and at most those within 2 ``SLACK`` of it besides; the inner
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
from typing import Final

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.compiling import kernel
from cspace.grid import SLACK, Grid, check_reach
from cspace.raster import Raster, allocate_bitmap
from cspace.rotations import NO_ROTATION, RotationCell

OBSTACLE: Final = ("an obstacle", "the map's corner", "clip the obstacles to the map, or check their units (metres)")
"""Subject and mend of the error about obstacles that reach too far."""


def outline_rasters(
    parts: Sequence[tuple[Floats, bool]], spacing: float, margin: float = 0.0, rotation: RotationCell = NO_ROTATION
) -> tuple[Raster, Raster]:
    """Outer and inner raster of a robot that is a union of regions and lines; all in metres.

    Each part has its border segments ``(x0, y0, x1, y1)``, shape (E, 4), and whether they form closed curves, in any
    order, and the part is what these enclose by even-odd parity. The rasters hold for all rotations of the cell.
    """
    scaled = [_turned(_cut(segments / spacing, rotation), rotation) for segments, _ in parts]
    growths = [rotation.displacement(outline.reshape(-1, 2, 2)).max(axis=1) for outline in scaled]
    radius = margin / spacing
    every = np.concatenate(scaled).reshape(-1, 2)
    reach = radius + max(float(growth.max()) for growth in growths) + 1.0
    outer, lower = allocate_bitmap(every.min(axis=0) - reach, every.max(axis=0) + reach)
    inner = np.zeros_like(outer)
    shift = np.tile(np.asarray(lower, dtype=np.float64), 2)
    for outline, growth, (_, filled) in zip(scaled, growths, parts, strict=True):
        local = np.ascontiguousarray(outline - shift)
        mark_touched(outer, local, growth + radius, -1.0, 1.0, SLACK)
        if not filled:
            continue
        inside = np.zeros_like(outer)
        mark_inside(inside, local, 0.0)
        outer |= inside
        border = np.zeros_like(outer)
        mark_touched(border, local, growth, 0.0, 0.0, SLACK)
        inner |= inside & ~border
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def outline_cells(parts: Sequence[tuple[Floats, bool]], grid: Grid) -> tuple[Bools, Bools]:
    """Outer and inner cells of a union of obstacles, parts as of :func:`outline_rasters`.

    What lies outside the grid is clipped. Raises InputError if a coordinate is so far from the grid that rounding could
    reach the certificate's slack.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    for segments, filled in parts:
        local, window = _localise(segments, grid)
        if local is None:
            continue
        touched = np.zeros(outer[window].shape, dtype=np.bool_)
        inside = np.zeros_like(touched)
        mark_touched(touched, local, np.zeros(len(local)), 0.0, 1.0, SLACK)
        if filled:
            mark_inside(inside, local, 0.5)
        outer[window] |= touched | inside
        inner[window] |= inside & ~touched
    return outer, inner


def _localise(segments: Floats, grid: Grid) -> tuple[Floats | None, tuple[slice, slice]]:
    """Segments in cells from the first cell of the window of the grid that they can touch, and that window.

    The window reaches one cell past the grid's part of their bounding box; None where they miss the grid.
    """
    local = (segments - np.tile(grid.lower, 2)) / grid.spacing
    check_reach(float(np.abs(local).max(initial=0.0)), *OBSTACLE)
    points = local.reshape(-1, 2)
    first = np.maximum(np.floor(points.min(axis=0)).astype(int) - 1, 0)
    stop = np.minimum(np.floor(points.max(axis=0)).astype(int) + 2, grid.shape)
    window = (slice(int(first[0]), int(stop[0])), slice(int(first[1]), int(stop[1])))
    if (first >= stop).any():
        return None, window
    return np.ascontiguousarray(local - np.tile(first, 2)), window


def _turned(segments: Floats, rotation: RotationCell) -> Floats:
    return rotation.apply(segments.reshape(-1, 2)).reshape(-1, 4)


def _cut(segments: Floats, rotation: RotationCell) -> Floats:
    """Segments in cells, cut into pieces along which the displacement within a turn varies by less than a quarter."""
    swing = float(rotation.displacement(np.array([1.0, 0.0])))
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    pieces = np.maximum(np.ceil(4.0 * swing * lengths).astype(int), 1)
    if (pieces == 1).all():
        return segments
    whole = np.repeat(np.arange(len(segments)), pieces)
    number = np.arange(len(whole)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    starts, steps = segments[whole, :2], segments[whole, 2:] - segments[whole, :2]
    # Neighbouring pieces must share their endpoints to the last bit, so each one is computed by one formula.
    first = starts + steps * (number / pieces[whole])[:, None]
    last = np.where(
        (number + 1 == pieces[whole])[:, None],
        segments[whole, 2:],
        starts + steps * ((number + 1) / pieces[whole])[:, None],
    )
    return np.hstack([first, last])


@kernel
def _segment_over_slab(px: float, py: float, qx: float, qy: float, x0: float, x1: float) -> tuple[float, float]:
    """y-interval of a segment over the slab ``x0 <= x <= x1``; (inf, -inf) where they do not meet."""
    if max(px, qx) < x0 or min(px, qx) > x1:
        return math.inf, -math.inf
    if px == qx:
        return min(py, qy), max(py, qy)
    t0 = min(max((x0 - px) / (qx - px), 0.0), 1.0)
    t1 = min(max((x1 - px) / (qx - px), 0.0), 1.0)
    y0 = py + t0 * (qy - py)
    y1 = py + t1 * (qy - py)
    return min(y0, y1), max(y0, y1)


@kernel
def _disc_over_slab(cx: float, cy: float, radius: float, x0: float, x1: float) -> tuple[float, float]:
    """y-interval of a disc over the slab ``x0 <= x <= x1``; (inf, -inf) where they do not meet."""
    dx = max(max(0.0, x0 - cx), cx - x1)
    if dx > radius:
        return math.inf, -math.inf
    half = math.sqrt(radius * radius - dx * dx)
    return cy - half, cy + half


@kernel
def mark_touched(out: Bools, segments: Floats, radii: Floats, b0: float, b1: float, slack: float) -> None:
    """Set ``out[i]`` where box ``i`` comes within ``slack`` of a segment grown by its radius.

    The grown segment is convex, so that its part over the x-slab of a box spans an interval of y; the box meets it
    exactly where their y-intervals overlap. That interval is the hull of those of the two end discs and of the
    rectangle between them.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py = segments[e, 0], segments[e, 1]
        qx, qy = segments[e, 2], segments[e, 3]
        radius = radii[e] + slack if radii[e] > 0.0 else 0.0
        # From the segment to a side of the rectangle.
        ox, oy = py - qy, qx - px
        length = math.sqrt(ox * ox + oy * oy)
        scale = radius / length if length > 0.0 else 0.0
        ox, oy = scale * ox, scale * oy
        first = max(0, math.ceil(min(px, qx) - radius - slack - b1))
        last = min(nx - 1, math.floor(max(px, qx) + radius + slack - b0))
        for i in range(first, last + 1):
            x0 = i + b0 - slack
            x1 = i + b1 + slack
            low, high = _segment_over_slab(px + ox, py + oy, qx + ox, qy + oy, x0, x1)
            if radius > 0.0:
                lo, hi = _segment_over_slab(px - ox, py - oy, qx - ox, qy - oy, x0, x1)
                low, high = min(low, lo), max(high, hi)
                lo, hi = _disc_over_slab(px, py, radius, x0, x1)
                low, high = min(low, lo), max(high, hi)
                lo, hi = _disc_over_slab(qx, qy, radius, x0, x1)
                low, high = min(low, lo), max(high, hi)
            if low > high:
                continue
            start = max(0, math.ceil(low - slack - b1))
            stop = min(ny - 1, math.floor(high + slack - b0))
            for j in range(start, stop + 1):
                out[i, j] = True


@kernel
def mark_inside(out: Bools, segments: Floats, c: float) -> None:
    """Set ``out[i, j]`` where the point ``(i + c, j + c)`` is inside closed curves, by even-odd parity.

    Exact for points farther from the curve than rounding; ``out`` must be all False.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py = segments[e, 0], segments[e, 1]
        qx, qy = segments[e, 2], segments[e, 3]
        if px == qx:
            continue
        if px > qx:
            px, qx = qx, px
            py, qy = qy, py
        # The column x = i + c is crossed where px <= x < qx: a vertex counts for one of its two edges.
        first = max(0, math.ceil(px - c))
        last = min(nx - 1, math.ceil(qx - c) - 1)
        for i in range(first, last + 1):
            y = py + (i + c - px) / (qx - px) * (qy - py)
            j = math.floor(y - c) + 1
            if j < ny:
                j = max(j, 0)
                out[i, j] = not out[i, j]
    for i in range(nx):
        inside: bool = np.bool_(False)  # type: ignore[assignment]  # of one type for the compiler from the start
        for j in range(ny):
            inside ^= out[i, j]
            out[i, j] = inside

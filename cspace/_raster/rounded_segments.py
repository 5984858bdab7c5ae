"""Rasters of plane segments, each grown by a radius, and of the regions enclosed by closed curves.

A *box* ``i`` is ``i + [b0, b1]^2``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the
outer raster of a robot, ``(c, c)`` for sample points. Lengths are in cells, in the index frame of
the output array.

*Robots.* With spacing ``h`` and robot ``A``, grown by the margin on the outer side,

* outer = { m : A meets h * (m + [-1, 1]^2) },
* inner = { m : h * m lies in A }.

*Obstacles.* Outer cells meet an obstacle, inner cells lie in one obstacle.

*Rounding.* All work is done in cells, on numbers below 2^22. The scaled vertices and each interval
end computed from them have errors below 2^-28 cells: a few roundings of 2^-53 relative to such
numbers, and no difference is divided by a smaller one (the clip parameter of an edge is a ratio in
[0, 1] whose relative error is three roundings; the half chord of an end disc is computed from a
radius enlarged by more than the rounding of its square). Outer rasters grow by ``SLACK`` = 2^-26
cells and inner rasters shrink by as much. So the outer raster contains every offset of the
definition, and at most those within 2 ``SLACK`` of it besides. The inner raster contains only
offsets of the definition, and misses at most those within 3 ``SLACK`` of the robot's boundary,
among them lattice points exactly on it. The same slack covers the rounding of a look-up (also below
2^-28 cells).

*Rotation.* A rotation cell contains the rotations within an angle a of its representative. Within
the cell, a robot point p moves by at most ``2 |p| sin(a / 2)``. So the robot at any rotation of the
cell lies in the robot at the representative rotation with each piece of its boundary grown by that
displacement, for the farthest point of the piece. A point farther than that from each piece of the
boundary is inside at all rotations if it is inside at one. Pieces are so short that the growth
varies by less than a quarter of a cell along each.

The work grows with the length of the boundary; only the parity fill visits every cell of the
bounding box, at one byte each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cspace._grid import OBSTACLE_REACH, SLACK, Grid, check_reach
from cspace._raster import Raster, allocate_bitmap
from cspace._rotations import RotationCell
from cspace._support.arrays import Bools, Floats, number_parts
from cspace._support.compiling import internal, kernel


def outline_rasters(
    parts: Sequence[tuple[Floats, bool]],
    spacing: float,
    margin: float,
    rotation: RotationCell,
) -> tuple[Raster, Raster]:
    """Rasterise a robot that is a union of regions and lines.

    Returns the outer and the inner raster; lengths are in metres. Each part is a pair: boundary
    segments ``(x0, y0, x1, y1)``, shape (E, 4), and whether they form closed curves, in any order.
    If they do, the part is the region that they enclose by even-odd parity. The rasters hold for
    all rotations of the rotation cell.
    """
    # Segments of each part at the representative rotation, and how far they move within the cell.
    outlines = []
    growths = []
    for segments, _ in parts:
        pieces = _cut_segments(segments / spacing, rotation)
        ends = rotation.apply(pieces.reshape(-1, 2, 2))
        outlines.append(ends)
        growths.append(rotation.displacement(ends).max(axis=1))
    radius = margin / spacing
    points = np.concatenate(outlines).reshape(-1, 2)
    reach = radius + float(np.concatenate(growths).max()) + 1.0
    outer, lower = allocate_bitmap(points.min(axis=0) - reach, points.max(axis=0) + reach)
    inner = np.zeros_like(outer)
    origin = np.asarray(lower, dtype=np.float64)
    for outline, growth, (_, filled) in zip(outlines, growths, parts, strict=True):
        segments = np.ascontiguousarray(outline - origin).reshape(-1, 4)
        # Outer offsets m have squares m + [-1, 1]^2 that meet the part.
        mark_touched(outer, segments, growth + radius, -1.0, 1.0, SLACK)
        if not filled:
            continue
        # Inner offsets are enclosed points that the boundary cannot reach.
        enclosed = np.zeros_like(outer)
        mark_inside(enclosed, segments, 0.0)
        outer |= enclosed
        near_boundary = np.zeros_like(outer)
        mark_touched(near_boundary, segments, growth, 0.0, 0.0, SLACK)
        inner |= enclosed & ~near_boundary
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def outline_cells(parts: Sequence[tuple[Floats, bool]], grid: Grid) -> tuple[Bools, Bools]:
    """Rasterise obstacles that are regions and lines.

    Returns the outer and the inner cells; parts as for :func:`outline_rasters`. Obstacles are
    clipped to the grid. Raises InputError if a coordinate is so far from the grid that rounding
    could exceed ``SLACK``.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    for segments, filled in parts:
        local, window = _find_window(segments, grid)
        if local is None:
            continue
        # A cell that the boundary does not touch lies in the region if its center does.
        touched = np.zeros(outer[window].shape, dtype=np.bool_)
        enclosed = np.zeros_like(touched)
        mark_touched(touched, local, np.zeros(len(local)), 0.0, 1.0, SLACK)
        if filled:
            mark_inside(enclosed, local, 0.5)
        outer[window] |= touched | enclosed
        inner[window] |= enclosed & ~touched
    return outer, inner


def _find_window(segments: Floats, grid: Grid) -> tuple[Floats | None, tuple[slice, slice]]:
    """Find the window of a grid that segments (E, 4) touch.

    Returns the segments in cells from the window's corner, or None if they miss the grid. Also
    returns the window, which reaches one cell past their bounding box.
    """
    local = (segments - np.tile(grid.lower, 2)) / grid.spacing
    check_reach(float(np.abs(local).max(initial=0.0)), *OBSTACLE_REACH)
    points = local.reshape(-1, 2)
    lowest_cell = np.floor(points.min(axis=0)).astype(int)
    highest_cell = np.floor(points.max(axis=0)).astype(int)
    first = np.maximum(lowest_cell - 1, 0)
    stop = np.minimum(highest_cell + 2, grid.shape)
    window_x, window_y = map(slice, first.tolist(), stop.tolist())
    window = window_x, window_y
    if (first >= stop).any():
        return None, window
    return np.ascontiguousarray(local - np.tile(first, 2)), window


def _cut_segments(segments: Floats, rotation: RotationCell) -> Floats:
    """Cut segments so that the displacement by rotation hardly varies along each.

    Along a piece, the largest displacement within the rotation cell varies by less than a quarter
    of a cell. ``segments`` and the pieces are ``(x0, y0, x1, y1)``, shape (n, 4), in cells.
    """
    # Displacement of a point at distance 1 from the origin.
    unit_displacement = float(rotation.displacement(np.array([1.0, 0.0])))
    x0, y0, x1, y1 = segments.T
    lengths = np.hypot(x1 - x0, y1 - y0)
    # Along a piece the distance from the origin varies by at most its length.
    counts = np.maximum(np.ceil(4.0 * unit_displacement * lengths).astype(np.int64), 1)
    # For each piece: its segment, its index within the segment, and the pieces of that segment.
    owner, index = number_parts(counts)
    count = counts[owner]
    begin = np.stack([x0, y0], axis=1)[owner]
    end = np.stack([x1, y1], axis=1)[owner]
    # Neighbouring pieces must share endpoints to the last bit, so both ends use the same formula.
    piece_begin = begin + (end - begin) * (index / count)[:, None]
    piece_end = begin + (end - begin) * ((index + 1) / count)[:, None]
    is_last = index + 1 == count
    piece_end[is_last] = end[is_last]
    return np.hstack([piece_begin, piece_end])


@internal
def _segment_over_slab(
    px: float,
    py: float,
    qx: float,
    qy: float,
    x0: float,
    x1: float,
) -> tuple[float, float]:
    """Return a segment's y-interval in a slab.

    The slab is ``x0 <= x <= x1``. The segment leads from p to q. Returns (inf, -inf) if they are
    disjoint.
    """
    if max(px, qx) < x0 or min(px, qx) > x1:
        return math.inf, -math.inf
    if px == qx:
        return min(py, qy), max(py, qy)
    # Clip the segment, from 0 at p to 1 at q, to both sides of the slab.
    t0 = min(max((x0 - px) / (qx - px), 0.0), 1.0)
    t1 = min(max((x1 - px) / (qx - px), 0.0), 1.0)
    y0 = py + t0 * (qy - py)
    y1 = py + t1 * (qy - py)
    return min(y0, y1), max(y0, y1)


@kernel
def mark_touched(
    out: Bools,
    segments: Floats,
    radii: Floats,
    b0: float,
    b1: float,
    slack: float,
) -> None:
    """Set ``out[i]`` if box ``i`` meets a segment grown by its radius.

    Box ``i`` is ``i + [b0, b1]^2``. ``segments`` are (px, py, qx, qy), shape (n, 4), in cells;
    ``radii`` have shape (n,). Gaps up to ``slack`` count as touching. The grown segment is convex,
    so its part over the x-slab of a box spans a y-interval; the box meets it if and only if their
    y-intervals overlap. That interval is the hull of the intervals of the two end discs and the
    rectangle between them.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py, qx, qy = segments[e]
        radius = radii[e] + slack if radii[e] > 0.0 else 0.0
        # Offset from the segment to one side of the rectangle: normal, as long as the radius.
        length = math.sqrt((py - qy) * (py - qy) + (qx - px) * (qx - px))
        scale = radius / length if length > 0.0 else 0.0
        ox = scale * (py - qy)
        oy = scale * (qx - px)
        first_x = max(0, math.ceil(min(px, qx) - radius - slack - b1))
        last_x = min(nx - 1, math.floor(max(px, qx) + radius + slack - b0))
        # For each column of boxes, the y-interval of the grown segment.
        for i in range(first_x, last_x + 1):
            x0 = i + b0 - slack
            x1 = i + b1 + slack
            low, high = _segment_over_slab(px + ox, py + oy, qx + ox, qy + oy, x0, x1)
            if radius > 0.0:
                low_side, high_side = _segment_over_slab(px - ox, py - oy, qx - ox, qy - oy, x0, x1)
                low = min(low, low_side)
                high = max(high, high_side)
                for center_x, center_y in ((px, py), (qx, qy)):
                    gap_x = max(max(0.0, x0 - center_x), center_x - x1)
                    if gap_x <= radius:
                        half_chord = math.sqrt(radius * radius - gap_x * gap_x)
                        low = min(low, center_y - half_chord)
                        high = max(high, center_y + half_chord)
            if low > high:
                continue
            first_y = max(0, math.ceil(low - slack - b1))
            last_y = min(ny - 1, math.floor(high + slack - b0))
            for j in range(first_y, last_y + 1):
                out[i, j] = True


@kernel
def mark_inside(out: Bools, segments: Floats, c: float) -> None:
    """Mark points inside closed curves by even-odd parity.

    ``segments`` are (px, py, qx, qy), shape (n, 4), in cells. Sets ``out[i, j]`` if the point
    ``(i + c, j + c)`` is inside. Exact for points farther from the curve than rounding; ``out``
    must be all False.
    """
    nx, ny = out.shape
    for e in range(segments.shape[0]):
        px, py, qx, qy = segments[e]
        if px == qx:
            continue
        if px > qx:
            px, qx = qx, px
            py, qy = qy, py
        # An edge crosses the column x = i + c if px <= x < qx, so a vertex counts for one edge.
        first = max(0, math.ceil(px - c))
        last = min(nx - 1, math.ceil(qx - c) - 1)
        for i in range(first, last + 1):
            y = py + (i + c - px) / (qx - px) * (qy - py)
            # Flip the first point above the crossing; the sweep below spreads it upwards.
            first_above = max(math.floor(y - c) + 1, 0)
            if first_above < ny:
                out[i, first_above] = not out[i, first_above]
    for i in range(nx):
        inside = False
        for j in range(ny):
            if out[i, j]:
                inside = not inside
            out[i, j] = inside

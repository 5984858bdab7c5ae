"""Rounded boxes: balls, points, boxes and the cells of bitmaps, as robots and as obstacles.

A *rounded box* is a closed axis-aligned box ``[low, high]`` grown by a radius ``r >= 0``: the points within ``r`` of
it. A ball is one with ``low = high``, a point one with ``r = 0`` as well. Cube ``i`` is ``i + [b0, b1]^3``: ``(0, 1)``
for the cells of a workspace, ``(-1, 1)`` for the outer raster of a robot, ``(0, 0)`` for lattice points. All lengths
are in cells, and no coordinate or radius is above 2^22. In the plane, everything is pulled out along a third axis of
one cell, so far that the cell lies deep inside.

*What is computed.* The distance of two axis-aligned boxes is the length of the vector of the gaps between their
intervals. So cube ``i`` meets the rounded box exactly where ``dx^2 + dy^2 + dz^2 <= r^2`` for the gaps ``d``. The
corner of the cube that is farthest from the box is farthest along each axis by itself, and a rounded box is convex; so
the cube lies in the rounded box exactly where the same holds for the excesses by which it sticks out of the box.
Column by column, ``dx`` and ``dy`` leave a half chord ``sqrt(r^2 - dx^2 - dy^2)`` for the z-interval.

*Safety against rounding.* Let ``s`` = ``SLACK`` = 2^-26. Corners are scaled, moved to the array's indices and
subtracted from whole numbers; each of these few steps rounds by at most 2^-30, so that gaps and interval ends are off
by less than 2^-27 = s / 2.

Outer: the box is grown by ``s`` along each axis first, so that no computed gap exceeds the true one and each interval
end along z has ``s / 2`` to spare. A radius above zero is taken as ``r + s``. The three squares and two differences
under the root round by at most ``5 * 2^-53 (r + s)^2`` together, where enlarging the radius has added ``2 r s + s^2``:
that is ten times as much at ``r`` = 2^22 and more below, which leaves room for the rounding of ``r`` itself. So no
computed half chord is shorter than the true one by more than the rounding of the root, 2^-31.

Inner: the box is shrunk by ``s`` along each axis, and ``r`` is taken as ``r - 2 s``, or as 0 where that is negative.
The square loses ``4 r s - 4 s^2 >= 2 r s`` thereby, which covers the rounding under the root in the same way.

Hence outer cubes are all of the definition and at most those within 4 ``s`` of the rounded box besides;
inner ones are none that the definition forbids, all but those that come within 4 ``s`` of its border. Cubes that touch
the border are outer and not inner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats
from cspace.compiling import kernel
from cspace.grid import SLACK, Grid, check_reach
from cspace.raster import Raster, allocate_bitmap
from cspace.raster.segments import OBSTACLE
from cspace.threads import in_chunks

_COLUMNS_A_THREAD = 100_000


class Rounded(NamedTuple):
    """Boxes, each grown by a radius.

    Attributes
    ----------
    lows, highs : ndarray of float64, shape (n, dim)
        Their corners.
    radii : ndarray of float64, shape (n,)
        Zero or above.
    """

    lows: Floats
    highs: Floats
    radii: Floats

    def moved(self, shift: Floats) -> Rounded:
        """The boxes moved."""
        return self._replace(lows=self.lows + shift, highs=self.highs + shift)


def rounded_rasters(boxes: Rounded, spacing: float, outward: Floats, inward: Floats) -> tuple[Raster, Raster]:
    """Outer and inner raster of a robot that is a union of rounded boxes, in its frame; all in metres.

    On the outer side each box grows by ``outward``, and on the inner one it shrinks by ``inward``, both shape (n,).
    Raises InputError if the robot is too many cells large.
    """
    wide = Rounded(boxes.lows / spacing, boxes.highs / spacing, (boxes.radii + outward) / spacing)
    tight = wide._replace(radii=boxes.radii / spacing - inward / spacing)
    reach = wide.radii[:, None] + 1.0
    outer, lower = allocate_bitmap((wide.lows - reach).min(axis=0), (wide.highs + reach).max(axis=0))
    inner = np.zeros_like(outer)
    shift = -np.asarray(lower, dtype=np.float64)
    mark_touched(outer, wide.moved(shift), -1.0, 1.0)
    remaining = tight.radii >= 0.0
    mark_inside(inner, Rounded(*(part[remaining] for part in tight.moved(shift))), 0.0, 0.0)
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def rounded_cells(boxes: Rounded, grid: Grid) -> tuple[Bools, Bools]:
    """Cells that meet a union of rounded boxes, metres, and cells that lie wholly in one of them.

    What lies outside the grid is clipped. Raises InputError if one reaches so far from the grid that rounding could
    reach the certificate's slack.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    lower = np.asarray(grid.lower)
    lows, highs = (boxes.lows - lower) / grid.spacing, (boxes.highs - lower) / grid.spacing
    local = Rounded(lows, highs, boxes.radii / grid.spacing)
    first, last = lows - local.radii[:, None], highs + local.radii[:, None]
    check_reach(float(max(-first.min(initial=0.0), last.max(initial=0.0))), *OBSTACLE)
    # What stays a cell clear of the grid meets none of its cells.
    near = ((last > -1.0) & (first < np.add(grid.shape, 1.0))).all(axis=1)
    local = Rounded(*(part[near] for part in local))
    mark_touched(outer, local, 0.0, 1.0)
    # One that holds a cell is at least as long as the cell's diagonal.
    size = np.linalg.norm(local.highs - local.lows, axis=1) + 2.0 * local.radii
    large = size**2 >= 0.999 * grid.dim
    mark_inside(inner, Rounded(*(part[large] for part in local)), 0.0, 1.0)
    return outer, inner


def mark_touched(out: Bools, boxes: Rounded, b0: float, b1: float) -> None:
    """Set ``out[i]`` where cube ``i + [b0, b1]^d`` meets a rounded box; what lies outside ``out`` is clipped.

    ``out`` has two or three axes; the boxes are in cells, as its indices.
    """
    radii = np.where(boxes.radii > 0.0, boxes.radii + SLACK, 0.0)
    _in_slabs(out, Rounded(boxes.lows - SLACK, boxes.highs + SLACK, radii), b0, b1)


def mark_inside(out: Bools, boxes: Rounded, b0: float, b1: float) -> None:
    """Set ``out[i]`` where a cube lies wholly in one rounded box; parameters as for :func:`mark_touched`.

    The farthest corner of a cube is in the box where the nearest one of the cube turned inside out is.
    """
    radii = np.maximum(boxes.radii - 2.0 * SLACK, 0.0)
    _in_slabs(out, Rounded(boxes.lows + SLACK, boxes.highs - SLACK, radii), b1, b0)


def _in_slabs(out: Bools, boxes: Rounded, b0: float, b1: float) -> None:
    """Run the kernel in threads, each of which writes a slab of ``out`` of its own."""
    missing = [1] * (3 - out.ndim)  # an axis along which all are as long as the single layer of cells, and longer
    lows, highs = np.insert(boxes.lows, missing, -2.0, axis=1), np.insert(boxes.highs, missing, 3.0, axis=1)
    lows, highs, radii = (np.ascontiguousarray(part) for part in (lows, highs, boxes.radii))
    out = np.expand_dims(out, missing)

    def work(start: int, stop: int) -> int:
        _mark(out, Rounded(lows, highs, radii), b0, b1, start, stop)
        return -1

    sides = np.minimum(highs[:, :2] - lows[:, :2] + 2.0 * radii[:, None] + abs(b1 - b0) + 1.0, out.shape[:2])
    columns = float(np.prod(sides, axis=1).sum())
    in_chunks(work, out.shape[0], 1 if columns > _COLUMNS_A_THREAD else out.shape[0])


@kernel
def _mark(out: Bools, boxes: Rounded, b0: float, b1: float, start: int, stop: int) -> None:
    """Set ``out[i]``, for first indices in ``[start, stop)``, where the gaps to a box are no longer than its radius.

    Along each axis the cube and the box are apart by a gap, zero where their intervals meet; the rounded box is met
    where the squares of the three gaps add up to at most that of the radius. With ``b0`` above ``b1`` a gap is that to
    the farther end of the cube, by which it sticks out.
    """
    lows, highs, radii = boxes
    _, ny, nz = out.shape
    for n in range(lows.shape[0]):
        radius = radii[n]
        square = radius * radius
        xlow, ylow, zlow = lows[n, 0], lows[n, 1], lows[n, 2]
        xhigh, yhigh, zhigh = highs[n, 0], highs[n, 1], highs[n, 2]
        i_first = max(start, math.ceil(xlow - radius - b1))
        i_last = min(stop - 1, math.floor(xhigh + radius - b0))
        if i_first > i_last or zlow - radius - b1 > nz or zhigh + radius - b0 < -1.0:
            continue
        j_first = max(0, math.ceil(ylow - radius - b1))
        j_last = min(ny - 1, math.floor(yhigh + radius - b0))
        for i in range(i_first, i_last + 1):
            dx = max(0.0, xlow - (i + b1), (i + b0) - xhigh)
            for j in range(j_first, j_last + 1):
                dy = max(0.0, ylow - (j + b1), (j + b0) - yhigh)
                rest = square - dx * dx - dy * dy
                if rest < 0.0:
                    continue
                # The rest of the radius is left for the gap along z: what it reaches is a run of cubes.
                half = math.sqrt(rest)
                k_first = max(0, math.ceil(zlow - half - b1))
                k_last = min(nz - 1, math.floor(zhigh + half - b0))
                for k in range(k_first, k_last + 1):
                    out[i, j, k] = True

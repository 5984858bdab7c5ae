"""Rasters of rounded boxes: balls, points, boxes and the cells of bitmaps.

A *rounded box* is a closed axis-aligned box ``[low, high]`` grown by a radius ``r >= 0``: the
points within ``r`` of the box. A ball has ``low = high``, a point has ``r = 0`` as well. Cube ``i``
is ``i + [b0, b1]^3``: ``(0, 1)`` for the cells of a workspace, ``(-1, 1)`` for the outer raster of
a robot, ``(0, 0)`` for lattice points. All lengths are in cells, and no coordinate or radius
exceeds 2^22. In the plane, boxes are extruded along a third axis of one cell, so far that the cell
lies deep inside.

*Method.* The distance between two axis-aligned boxes is the length of the vector of gaps between
their intervals. So cube ``i`` meets the rounded box if and only if ``dx^2 + dy^2 + dz^2 <= r^2``
for the gaps ``d``. The farthest corner of the cube is farthest along each axis, and a rounded box
is convex; so the cube lies in the rounded box if and only if the same holds for the excesses of the
cube over the box. In each column, ``dx`` and ``dy`` leave a half chord ``sqrt(r^2 - dx^2 - dy^2)``
for the z-interval.

*Rounding.* Let ``s`` = ``SLACK`` = 2^-26. Corners are scaled, moved to the array's indices and
subtracted from whole numbers; each of these few steps rounds by at most 2^-30, so gaps and interval
ends have errors below 2^-27 = s / 2.

Outer: the box first grows by ``s`` along each axis, so no computed gap exceeds the true gap and
each interval end along z has ``s / 2`` to spare. A radius above zero becomes ``r + s``. The three
squares and two differences under the root round by at most ``5 * 2^-53 (r + s)^2`` together, while
enlarging the radius added ``2 r s + s^2``: ten times as much at ``r`` = 2^22 and more below, which
also covers the rounding of ``r`` itself. So a computed half chord is shorter than the true one by
at most the rounding of the root, 2^-31.

Inner: the box shrinks by ``s`` along each axis, and ``r`` becomes ``max(r - 2 s, 0)``. The square
loses ``4 r s - 4 s^2 >= 2 r s``, which covers the rounding under the root in the same way.

Hence the outer cubes contain all cubes of the definition, and at most those within 4 ``s`` of the
rounded box besides. The inner cubes are a subset of the definition that misses at most the cubes
within 4 ``s`` of the boundary. Cubes that touch the boundary are outer and not inner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cspace._grid import OBSTACLE_REACH, SLACK, Grid, check_reach
from cspace._raster import Raster, allocate_bitmap, find_index_ranges, run_in_slabs
from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.compiling import kernel


class RoundedBoxes(NamedTuple):
    """Boxes, each grown by a radius.

    Attributes
    ----------
    lows, highs : ndarray of float64, shape (n, dim)
        Corners of the boxes.
    radii : ndarray of float64, shape (n,)
        Zero or above.
    """

    lows: Floats
    highs: Floats
    radii: Floats


def rounded_rasters(
    boxes: RoundedBoxes,
    spacing: float,
    outward: Floats,
    inward: Floats,
) -> tuple[Raster, Raster]:
    """Rasterise a robot of united rounded boxes.

    Returns the outer and the inner raster. The boxes are in the robot's frame, in metres. Each box
    grows by ``outward`` for the outer raster and shrinks by ``inward`` for the inner raster, both
    shape (n,), metres. Raises InputError if the robot has too many cells.
    """
    lows = boxes.lows / spacing
    highs = boxes.highs / spacing
    outer_radii = (boxes.radii + outward) / spacing
    inner_radii = boxes.radii / spacing - inward / spacing
    reach = outer_radii[:, None] + 1.0
    outer, lower = allocate_bitmap((lows - reach).min(axis=0), (highs + reach).max(axis=0))
    inner = np.zeros_like(outer)
    lows = lows - lower
    highs = highs - lower
    # Outer offsets m have cubes m + [-1, 1]^d that meet a box; inner offsets are points.
    mark_touched(outer, RoundedBoxes(lows, highs, outer_radii), -1.0, 1.0)
    mark_inside(inner, RoundedBoxes(lows, highs, inner_radii), 0.0, 0.0)
    return Raster.from_bitmap(outer, lower), Raster.from_bitmap(inner, lower)


def rounded_cells(boxes: RoundedBoxes, grid: Grid) -> tuple[Bools, Bools]:
    """Rasterise obstacles that are a union of rounded boxes.

    Returns the cells that meet a box, and the cells that lie in one box. The boxes are in metres;
    they are clipped to the grid. Raises InputError if a box reaches so far from the grid that
    rounding could exceed ``SLACK``.
    """
    outer = np.zeros(grid.shape, dtype=np.bool_)
    inner = np.zeros(grid.shape, dtype=np.bool_)
    # From metres to cells, from the corner of the grid on.
    lower = np.asarray(grid.lower)
    lows = (boxes.lows - lower) / grid.spacing
    highs = (boxes.highs - lower) / grid.spacing
    radii = boxes.radii / grid.spacing
    below = -(lows - radii[:, None]).min(initial=0.0)
    above = (highs + radii[:, None]).max(initial=0.0)
    check_reach(max(below, above), *OBSTACLE_REACH)
    local = RoundedBoxes(lows, highs, radii)
    mark_touched(outer, local, 0.0, 1.0)
    mark_inside(inner, local, 0.0, 1.0)
    return outer, inner


def mark_touched(out: Bools, boxes: RoundedBoxes, b0: float, b1: float) -> None:
    """Set ``out[i]`` if cube ``i`` meets a rounded box.

    Cube ``i`` is ``i + [b0, b1]^d``; cubes outside ``out``, of two or three axes, are ignored. The
    boxes are in cells, in the index frame of ``out``.
    """
    radii = np.where(boxes.radii > 0.0, boxes.radii + SLACK, 0.0)
    grown = RoundedBoxes(boxes.lows - SLACK, boxes.highs + SLACK, radii)
    _mark_in_slabs(out, grown, b0, b1)


def mark_inside(out: Bools, boxes: RoundedBoxes, b0: float, b1: float) -> None:
    """Set ``out[i]`` if cube ``i`` lies wholly in one rounded box.

    Parameters as for :func:`mark_touched`; boxes of negative radius are left out. The farthest
    corner of a cube is in the box if and only if the nearest corner of the inverted cube (b0 and b1
    swapped) is.
    """
    is_used = boxes.radii >= 0.0
    lows = boxes.lows[is_used] + SLACK
    highs = boxes.highs[is_used] - SLACK
    radii = np.maximum(boxes.radii[is_used] - 2.0 * SLACK, 0.0)
    _mark_in_slabs(out, RoundedBoxes(lows, highs, radii), b1, b0)


def _mark_in_slabs(out: Bools, boxes: RoundedBoxes, b0: float, b1: float) -> None:
    """Mark cubes near boxes, in threads with a slab each; see :func:`_mark_near`."""
    # In the plane, boxes extend along a third axis past the single layer of cells.
    lows = boxes.lows
    highs = boxes.highs
    if out.ndim == 2:
        out = out[:, None]
        # The layer lies between 0 and 1; two cells more on both sides are farther than any cube.
        lows = np.insert(lows, 1, -2.0, axis=1)
        highs = np.insert(highs, 1, 3.0, axis=1)
    radii = boxes.radii[:, None]
    first, last = find_index_ranges(lows - radii - b1, highs + radii - b0, out.shape)
    contiguous = RoundedBoxes(*map(np.ascontiguousarray, (lows, highs, boxes.radii)))
    # Few cubes take less time than threads.
    # Smallest number of cubes near boxes that are marked in threads.
    if np.maximum(last - first + 1, 0).prod(axis=1).sum() < 2**17:
        _mark_near(out, contiguous, first, last, b0, b1, 0, len(out))
    else:
        run_in_slabs(_mark_near, out, contiguous, first, last, b0, b1)


@kernel
def _mark_near(
    out: Bools,
    boxes: RoundedBoxes,
    first: Ints,
    last: Ints,
    b0: float,
    b1: float,
    start: int,
    stop: int,
) -> None:
    """Set ``out[i]`` if cube ``i`` is within the radius of a box.

    Cube ``i`` is ``i + [b0, b1]^3``. Covers first indices in ``[start, stop)``. ``first`` and
    ``last``, shape (n, 3), are the indices of the cubes around each box. The gap along an axis is
    zero if the intervals of cube and box meet. With ``b0`` above ``b1`` it is measured to the
    farther end of the cube, so it becomes the excess of the cube over the box.
    """
    lows, highs, radii = boxes
    for n in range(len(radii)):
        low_x, low_y, low_z = lows[n]
        high_x, high_y, high_z = highs[n]
        first_x, first_y, first_z = first[n]
        last_x, last_y, last_z = last[n]
        squared_radius = radii[n] * radii[n]
        for i in range(max(start, first_x), min(stop - 1, last_x) + 1):
            gap_x = max(0.0, low_x - (i + b1), (i + b0) - high_x)
            for j in range(first_y, last_y + 1):
                gap_y = max(0.0, low_y - (j + b1), (j + b0) - high_y)
                rest = squared_radius - gap_x * gap_x - gap_y * gap_y
                if rest < 0.0:
                    continue
                # The rest of the squared radius bounds the gap along z: one run of cubes.
                half_chord = math.sqrt(rest)
                k_first = max(first_z, math.ceil(low_z - half_chord - b1))
                k_last = min(last_z, math.floor(high_z + half_chord - b0))
                for k in range(k_first, k_last + 1):
                    out[i, j, k] = True

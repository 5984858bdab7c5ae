"""Rounded boxes against the lattice: the kernels in threads, and why rounding cannot break them.

A *rounded box* is a closed axis-aligned box ``[low, high]`` grown by a radius ``r >= 0``: the points within ``r`` of
it. A ball is one with ``low = high``, a point one with ``r = 0`` as well. Cube ``i`` is ``i + [b0, b1]^3``. All lengths
are in cells, and no coordinate or radius is above 2^22.

*What is computed.* The distance of two axis-aligned boxes is the length of the vector of the gaps between their
intervals. So cube ``i`` meets the rounded box exactly where ``dx^2 + dy^2 + dz^2 <= r^2`` for the gaps ``d``. The
corner of the cube that is farthest from the box is farthest along each axis by itself, and a rounded box is convex; so
the cube lies in the rounded box exactly where the same holds for the excesses by which it sticks out of the box.
Column by column, ``dx`` and ``dy`` leave a half chord ``sqrt(r^2 - dx^2 - dy^2)`` for the z-interval.

*Safety against rounding.* Let ``s`` = ``SLACK`` = 2^-26. Corners are scaled, moved to the frame of the array and
subtracted from whole numbers; each of these few steps rounds by at most 2^-30, so that gaps and interval ends are off
by less than 2^-27 = s / 2.

Outer: the box is grown by ``s`` along each axis first, so that no computed gap exceeds the true one and each interval
end along z has ``s / 2`` to spare. A radius above zero is taken as ``r + s``. The three squares and two differences
under the root round by at most ``5 * 2^-53 (r + s)^2`` together, where enlarging the radius has added ``2 r s + s^2``:
that is ten times as much at ``r`` = 2^22 and more below, which leaves room for the rounding of ``r`` itself. So no
computed half chord is shorter than the true one by more than the rounding of the root, 2^-31.

Inner: the box is shrunk by ``s`` along each axis, and ``r`` is taken as ``r - 2 s``, or as 0 where that is negative.
The square loses ``4 r s - 4 s^2 >= 2 r s`` thereby, which covers the rounding under the root in the same way.

Hence outer cubes are all that the definition asks for and at most those within 4 ``s`` of the rounded box besides;
inner ones are none that the definition forbids, all but those that come within 4 ``s`` of its border. Cubes that touch
the border are outer and not inner.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cspace.grid import SLACK
from cspace.threads import in_chunks

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_Kernel = Callable[[Bools, Floats, Floats, Floats, float, float, float, int, int], None]

SMALL = 100_000
"""Columns and boxes below which one thread does."""


def mark_touched(out: Bools, lows: Floats, highs: Floats, radii: Floats, b0: float, b1: float) -> None:
    """Set the cubes that meet a rounded box.

    Parameters
    ----------
    out : ndarray of bool, shape (nx, ny, nz)
        Written; what lies beyond it is clipped.
    lows, highs : ndarray, shape (n, 3)
        Corners of the boxes in cells, in the index frame of ``out``.
    radii : ndarray, shape (n,)
        In cells, zero or above.
    b0, b1 : float
        Cube ``i`` is ``i + [b0, b1]^3``.
    """
    from cspace.raster.boxes import _kernels

    _in_slabs(_kernels.mark_touched, out, lows, highs, radii, b0, b1)


def mark_inside(out: Bools, lows: Floats, highs: Floats, radii: Floats, b0: float, b1: float) -> None:
    """Set the cubes that lie wholly in one rounded box; parameters as for :func:`mark_touched`."""
    from cspace.raster.boxes import _kernels

    _in_slabs(_kernels.mark_inside, out, lows, highs, radii, b0, b1)


def _in_slabs(kernel: _Kernel, out: Bools, lows: Floats, highs: Floats, radii: Floats, b0: float, b1: float) -> None:
    """Run a kernel in threads, each of which writes a slab of ``out`` of its own."""

    def work(start: int, stop: int) -> int:
        kernel(out, lows, highs, radii, b0, b1, SLACK, start, stop)
        return -1

    sides = np.minimum(highs[:, :2] - lows[:, :2] + 2.0 * radii[:, None] + (b1 - b0) + 1.0, out.shape[:2])
    columns = float(np.prod(sides, axis=1).sum())
    in_chunks(work, out.shape[0], 1 if columns > SMALL else out.shape[0])

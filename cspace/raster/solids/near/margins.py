"""Boxes within a distance of triangles."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.threads import in_chunks

_SLACK: Final = 2.0**-20
_SLABS_A_THREAD: Final = 4


def mark_within(out: NDArray[np.bool_], triangles: NDArray[np.float64], half: float, radius: float) -> None:
    """Set ``out[i]`` where the cube ``i + [-half, half]^3`` lies within ``radius`` of a triangle.

    The distance of a triangle that a cube does not meet is that of two of their features: a corner and the triangle, a
    corner of the triangle and the cube, or two edges. Before that, the nearest point of the triangle to the cube's
    middle bounds it from both sides.

    Let L be the size of all triangles together. A distance from the plane of a triangle is off by the rounding of its
    normal, relative to it less than 2^-39 (thinner triangles than 2^-12 are taken to be as near as their height
    allows), so by less than 2^-36 L. The bound by the nearest point is off by the rounding of the direction there, less
    than 2^-51 L, over the length of the triangle: less than 2^-51 L^2. The radius grows by more than both, by
    2^-20 + 2^-34 L + 2^-50 L^2. The result is complete, and holds no more than that, but for thin triangles: for
    those, what lies within 2^-12 times their length besides.

    Parameters
    ----------
    out : ndarray of bool, shape (nx, ny, nz)
        The cubes that meet a triangle must be set already.
    triangles : ndarray, shape (n, 3, 3)
        In cells, in the index frame of ``out``.
    half, radius : float
        In cells.
    """
    from cspace.raster.solids.near import _kernels

    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    slack = _SLACK + 2.0**-34 * size + 2.0**-50 * size * size

    def work(start: int, stop: int) -> int:
        _kernels.mark_within(out, triangles, half, radius, slack, start, stop)
        return -1

    in_chunks(work, len(out), _SLABS_A_THREAD)

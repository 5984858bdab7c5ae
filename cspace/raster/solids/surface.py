"""The boxes that triangles touch.

Boxes and lengths are in cells, in the index frame of the array that is written. For each slab of boxes across x, a
triangle is cut to the slab, then, for each slab across y, what is left of it to that; the part that remains is convex,
so that its z-values are an interval, and it meets exactly the boxes that meet that interval.

*Safety against rounding.* Let u = 2^-53, and all vertices lie within 2^22 cells of the frame's corner (for a robot: of
its origin), so that no two differ by more than 2^23 along an axis. In units of 2^-30 cells:

* A vertex in cells has two roundings relative to its size (the difference from the corner, the division by the
  spacing), and that of a whole number of cells subtracted: less than 1.5.
* A corner made by a cut lies on the cutting plane to the bit. Its other coordinates are ``p + t (q - p)`` with ``t``
  at most 1/2, from the nearer end: ``t`` has three roundings relative to itself, the difference and the product one
  each, so that with that of the sum it is off by less than 5 u 2^22 + 2^-31, which is 3.
* The planes of one direction do not meet, so all corners of a first cut lie on the triangle's own edges, and those of
  the second on the edges of the first result. Which corners there are is decided on the numbers as they are, without
  rounding. So each point of the part of the triangle in a slab differs from a point of the computed part by less than
  3, and after two cuts by less than 6, in y and z each.
* The ends of a run of boxes have two more roundings: less than 1.

Together that is less than 8.5. The slabs, and the runs of boxes, are widened to each side by ``SLACK`` = 2^-26 cells,
which is 16. So every box that a triangle meets is marked, and no box farther than 2 ``SLACK`` from it along an axis;
what is left of ``SLACK`` covers the rounding of a look-up, 4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.grid import SLACK
from cspace.threads import in_chunks

_TRIANGLES_A_THREAD = 2_000


def mark_touched(
    out: NDArray[np.bool_], triangles: NDArray[np.float64], b0: float, b1: float, slack: float = SLACK
) -> None:
    """Set ``out[i]`` where the box ``i + [b0, b1]^3`` meets a triangle.

    Parameters
    ----------
    out : ndarray of bool, shape (nx, ny, nz)
    triangles : ndarray, shape (n, 3, 3)
        In cells, in the index frame of ``out``; they may reach beyond it.
    b0, b1 : float
        In cells; multiples of one half.
    slack : float
        How much nearer than touching is near enough, in cells.
    """
    from cspace.raster.solids import _kernels

    # Each thread has slabs of its own, about as many triangles in each, so that no two write to one cell.
    middles = np.sort(np.clip(triangles[..., 0].mean(axis=1), 0, len(out)).astype(np.int64))
    size = len(middles)

    def work(start: int, stop: int) -> int:
        first = int(middles[start]) if start > 0 else 0
        last = int(middles[stop]) if stop < size else len(out)
        _kernels.mark_touched(out, triangles, b0, b1, slack, first, last)
        return -1

    in_chunks(work, size, _TRIANGLES_A_THREAD)

"""InsideTester: whether points lie inside the closed bodies of a mesh.

A ray runs from the point along an axis, and the triangles that it crosses are counted, body by body. Each edge is
crossed where half-open intervals say, at a point that all of its triangles compute alike; so the crossings of a closed
body are those of a closed surface that differs from it by the rounding of one interpolation, and another one gives
their height. Each is off by less than 3 * 2^-30 cells at coordinates of 2^22 cells (see
:mod:`cspace.raster.solids.surface`). So a point that is farther from the surface than 2^-27 cells is told right,
however the ray meets edges, vertices, or triangles seen from the side.

A point is *in* a body where its winding number is not zero, or where the body cannot be turned alike, where the parity
of the crossings is odd. Where it is zero, or even, the point is proven to lie *out* of the body

* if one of the six rays along the axes misses the body, with all triangles that belong to it, so that the point is
  joined to infinity,
* or if the body is a closed surface at which triangles meet in twos and do not cross, so that there are two sides and
  no pocket (see :class:`cspace.raster.solids.near.Crossings`; looked for only where the first proof fails).

Else it is *in doubt*: a pocket between parts of a body that pass through each other may be meant as solid.

Where a point is in several bodies, they are sorted by where the ray leaves them last, which is from the innermost to
the outermost if they do not cross.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.raster.solids.inside.bodies import Bodies
from cspace.threads import in_chunks

if TYPE_CHECKING:
    from cspace.raster.solids.near import Crossings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Codes = NDArray[np.uint8]

OUTSIDE: Final = 0
"""Out of every body."""

INSIDE: Final = 1
"""In the solid: in one body and out of the others, or in several that all face outward, or all inward; or, from the
outermost one inwards, in one that faces outward, one that faces inward, and so on, and last in one that faces
outward."""

HOLLOW: Final = 2
"""In a cavity: as before, but last in one that faces inward."""

AMBIGUOUS: Final = 3
"""Anything else, where one reading of the mesh says inside and another outside: in doubt of a body; or in several that
do not all face the same way, or of which one does not tell, and which cross, do not alternate, or face inward first."""

_DOUBTED: Final = 4
"""In no body, and in doubt of some."""

_MOST_BUCKETS: Final = 1024
_ENTRIES_A_TRIANGLE: Final = 12
_POINTS_A_THREAD: Final = 2_000


class InsideTester:
    """The inside test of a set of closed bodies, prepared.

    Parameters
    ----------
    triangles : ndarray of float64, shape (n, 3, 3)
        Those of ``bodies``. Neighbours share their corners to the last bit.
    bodies : Bodies
    crossings : Crossings
        Of the same bodies; asked only where the answer hangs on it.
    """

    def __init__(self, triangles: Floats, bodies: Bodies, crossings: Crossings) -> None:
        self._triangles = np.ascontiguousarray(triangles)
        self._bodies = bodies
        self._crossings = crossings
        self._upward = self._prepared(0) if len(triangles) else None
        self._sideways: tuple[Any, ...] | None = None

    def codes(self, points: Floats) -> Codes:
        """Where points lie.

        Parameters
        ----------
        points : ndarray of float64, shape (n, 3)

        Returns
        -------
        ndarray of uint8, shape (n,)
            OUTSIDE, INSIDE, HOLLOW or AMBIGUOUS; for points farther from the surface than rounding.
        """
        out = self._resolved(points, (AMBIGUOUS, _DOUBTED))
        out[out == _DOUBTED] = AMBIGUOUS
        return out

    def inside(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points are INSIDE, shape (n,); ``points`` as for :meth:`codes`, which asks more."""
        return np.asarray(self._resolved(points, (AMBIGUOUS,)) == INSIDE)

    def _resolved(self, points: Floats, open_codes: tuple[int, ...]) -> Codes:
        """Codes of points, found from rays upward, and where they are among ``open_codes``, from all that tells."""
        if self._upward is None:
            return np.zeros(len(points), dtype=np.uint8)
        out, _ = self._classified(points, (self._upward,))
        left = np.flatnonzero(np.isin(out, open_codes))
        if len(left) and self._sideways is None:
            self._sideways = self._prepared(1), self._prepared(2)
        while len(left):
            out[left], asked = self._classified(points[left], (self._upward, *(self._sideways or ())))
            if not asked.any():
                break
            self._crossings.learn(np.flatnonzero(asked[:-1]), pairs=bool(asked[-1]))
            left = left[np.isin(out[left], open_codes)]
        return out

    def _prepared(self, axis: int) -> Any:
        """Triangles, with the coordinates moved so that an axis before z comes last, and their buckets."""
        turned = np.ascontiguousarray(np.roll(self._triangles, -axis, axis=-1))
        return (turned, *buckets(turned))

    def _classified(self, points: Floats, along: tuple[Any, ...]) -> tuple[Codes, NDArray[np.bool_]]:
        from cspace.raster.solids.inside import _kernels

        points = np.ascontiguousarray(points)
        out = np.empty(len(points), dtype=np.uint8)
        bodies, known = self._bodies, self._crossings
        asked = np.zeros(len(bodies.facing) + 1, dtype=np.bool_)
        read = bodies.body, bodies.turns, bodies.wound, bodies.facing, known.simple, known.pairs

        def work(start: int, stop: int) -> int:
            _kernels.classify(points[start:stop], out[start:stop], along, *read, asked)
            return -1

        in_chunks(work, len(points), _POINTS_A_THREAD)
        return out, asked


def buckets(triangles: Floats) -> tuple[Floats, Floats, Integers, Integers, Integers]:
    """Triangles by the rectangles of the plane (x, y) that their bounding boxes meet.

    Returns
    -------
    low, scale, shape : ndarray, shape (2,)
        Low corner, buckets per unit length and number of buckets, along x and y.
    starts, entries : ndarray of int64
        The triangles of bucket ``b = i * shape[1] + j`` are ``entries[starts[b]:starts[b + 1]]``.
    """
    from cspace.raster.solids.inside import _kernels

    flat = triangles[..., :2].reshape(-1, 2)
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    count = min(_MOST_BUCKETS, max(1, int(np.sqrt(len(triangles)))))
    while True:
        shape = np.full(2, count, dtype=np.int64)
        scale = np.divide(shape, extent, out=np.zeros(2), where=extent > 0.0)
        number = int(_kernels.count_entries(triangles, low, scale, shape))
        # Large triangles meet many buckets: rather few buckets than long lists of them.
        if count == 1 or number <= _ENTRIES_A_TRIANGLE * len(triangles):
            break
        count //= 2
    starts = np.empty(count * count + 1, dtype=np.int64)
    entries = np.empty(number, dtype=np.int64)
    _kernels.sort_into_buckets(triangles, low, scale, shape, starts, entries)
    return low, scale, shape, starts, entries

"""Crossings: which bodies of a mesh cross one another, and which cross themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cspace.raster.solids.inside import Bodies

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_TOUCH: Final = 2.0**-30
"""Distance, over the size of the mesh, below which two triangles count as crossing."""

_NOT_KNOWN: Final = 2

_REMEMBERED: Final = 2**16
"""Pairs of bodies that are remembered as crossing while others are looked for."""


class Crossings:
    """Which of some bodies cross, found when it is asked for.

    Triangles cross that meet, but for common corners and edges of one body, or come so near that rounding could hide
    it.

    Parameters
    ----------
    triangles : ndarray, shape (n, 3, 3)
        Those of ``bodies``.
    corners : ndarray of int64, shape (n, 3)
        Numbers of their corners, the same for coincident ones.
    bodies : Bodies

    Attributes
    ----------
    simple : ndarray of uint8
        For each body 1 where two triangles meet at each edge and none cross, 0 where not, 2 where it is not known.
    pairs : ndarray of int64
        ``a * number_of_bodies + b`` for each pair ``a < b`` of bodies that cross, sorted; -1 alone where not known.
    """

    def __init__(self, triangles: Floats, corners: Integers, bodies: Bodies) -> None:
        self._triangles, self._corners, self._bodies = triangles, corners, bodies
        self.simple = np.where(bodies.manifold, _NOT_KNOWN, 0).astype(np.uint8)
        self.pairs = np.full(1, -1, dtype=np.int64)

    def learn(self, simple: Integers, *, pairs: bool) -> None:
        """Find out which of some bodies are simple and, if so asked, the pairs."""
        from cspace.raster.solids.near.crossing import _kernels

        body = self._bodies.body
        if len(simple):
            asked = np.zeros(len(self.simple), dtype=np.bool_)
            asked[simple] = True
            # What is left out equals one that is kept.
            kept = asked[body] & (self._bodies.turns != 0)
            crossed = np.zeros(len(self.simple), dtype=np.bool_)
            unit, buckets = _prepared(self._triangles[kept])
            _kernels.find_self_crossings(unit, body[kept], self._corners[kept], *buckets, _TOUCH, crossed)
            self.simple[simple] = ~crossed[simple]
        if pairs:
            unit, buckets = _prepared(self._triangles)
            found = np.empty(4 * len(body), dtype=np.int64)
            while True:
                recent = np.full(_REMEMBERED, -1, dtype=np.int64)
                count = _kernels.find_crossings(unit, body, *buckets, len(self.simple), _TOUCH, recent, found)
                if count <= len(found):
                    break
                found = np.empty(count, dtype=np.int64)
            self.pairs = np.unique(found[:count])


def _prepared(triangles: Floats) -> tuple[Floats, tuple[Floats, Floats, Integers, Integers, Integers]]:
    """Triangles on numbers up to 1, so that products of lengths neither overflow nor vanish, and their buckets.

    In each bucket they come in the order of their lowest points.
    """
    from cspace.raster.solids.inside.tester import buckets

    corners = triangles.reshape(-1, 3)
    unit = np.ascontiguousarray((triangles - corners.min(axis=0)) / (float(np.ptp(corners, axis=0).max()) or 1.0))
    low, scale, shape, starts, entries = buckets(unit)
    bucket = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    order = np.lexsort((unit[:, :, 2].min(axis=1)[entries], bucket))
    return unit, (low, scale, shape, starts, entries[order])

"""Border: the segments or triangles that bound a shape, and distances to them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.threads import in_chunks

if TYPE_CHECKING:
    from cspace.spectral.spheres.fields._kernels import Tree

Floats = NDArray[np.float64]

UNIT: Final = 2.0**-52
"""Rounding unit."""

ROUNDING: Final = 2.0**-44
"""Rounding of a distance, in the largest coordinate: some hundred units, of which few are used up."""

THIN: Final = 2.0**-26
"""Height of a triangle, in its longest edges, below which it counts as its edges."""

_LEAF: Final = 6
_POINTS_A_THREAD: Final = 4_000


class Border:
    """Pieces of a border in the plane or in space.

    Parameters
    ----------
    pieces : ndarray, shape (n, 2, 2) or (n, 3, 3)
        Ends of segments, or corners of triangles, metres.

    Attributes
    ----------
    slack : float
        By how much a distance may be wrong, metres.
    """

    def __init__(self, pieces: Floats) -> None:
        self.dim = pieces.shape[2]
        self.pieces = pieces
        corners = pieces.reshape(-1, self.dim)
        self._kinds, error = _kinds_of(pieces)
        self.slack = ROUNDING * float(np.abs(corners).max()) + error

    @property
    def corners(self) -> Floats:
        """Corners of the pieces, shape (m, d)."""
        return np.unique(self.pieces.reshape(-1, self.dim), axis=0)

    def distances(self, points: Floats) -> Floats:
        """Distances from points (n, d), metres, wrong by :attr:`slack` at most, beside the rounding of the points."""
        from cspace.spectral.spheres.fields import _kernels

        spatial = in_space(points)
        out = np.empty(len(points))

        def work(start: int, stop: int) -> int:
            _kernels.distances(self.tree, spatial[start:stop], out[start:stop])
            return -1

        in_chunks(work, len(points), _POINTS_A_THREAD)
        return out

    @cached_property
    def tree(self) -> Tree:
        """The tree by which distances are found."""
        from cspace.spectral.spheres.fields._kernels import Tree

        pieces = np.zeros((len(self.pieces), 3, 3))
        corners = self.pieces.shape[1]
        pieces[:, :corners, 3 - self.dim :] = self.pieces
        pieces[:, corners:] = pieces[:, corners - 1 : corners]
        low, high, middles = pieces.min(axis=1), pieces.max(axis=1), pieces.mean(axis=1)
        order = np.arange(len(pieces))
        # Boxes, level by level, each halved along the longest side of the box round the middles.
        starts, stops, children = [0], [len(pieces)], [0]
        box = 0
        while box < len(starts):
            start, stop = starts[box], stops[box]
            if stop - start > _LEAF:
                some = order[start:stop]
                around, half = middles[some], (stop - start) // 2
                axis = int(np.argmax(np.ptp(around, axis=0)))
                order[start:stop] = some[np.argpartition(around[:, axis], half)]
                children[box] = len(starts)
                starts += [start, start + half]
                stops += [start + half, stop]
                children += [0, 0]
            box += 1
        spans = list(zip(starts, stops, strict=True))
        return Tree(
            np.ascontiguousarray(pieces[order]),
            np.ascontiguousarray(self._kinds[order]),
            np.array([low[order[start:stop]].min(axis=0) for start, stop in spans]),
            np.array([high[order[start:stop]].max(axis=0) for start, stop in spans]),
            np.array(children, dtype=np.int64),
            np.array(starts, dtype=np.int64),
            np.array(stops, dtype=np.int64),
        )


def in_space(points: Floats) -> Floats:
    """Points (n, d) as points in space; a plane lies in it as x = 0."""
    if points.shape[1] == 3:
        return np.ascontiguousarray(points, dtype=np.float64)
    return np.column_stack([np.zeros(len(points)), points])


def _kinds_of(pieces: Floats) -> tuple[NDArray[np.uint8], float]:
    """What each piece counts as, and by how much the shape of triangles makes distances to them wrong.

    The normal of a triangle loses as many digits as its height lacks, and the distance from its plane with it. A
    triangle of hardly any height counts as its edges, which are no farther from any of its points than half of it.
    """
    from cspace.spectral.spheres.fields._kernels import FULL, SEGMENT
    from cspace.spectral.spheres.fields._kernels import THIN as EDGES

    if pieces.shape[2] == 2:
        return np.full(len(pieces), SEGMENT, dtype=np.uint8), 0.0
    edges = np.roll(pieces, -1, axis=1) - pieces
    longest = np.sqrt((edges**2).sum(axis=2)).max(axis=1)
    areas = np.sqrt((np.cross(edges[:, 0], edges[:, 1]) ** 2).sum(axis=1))
    thin = areas <= THIN * longest**2
    size = float(np.linalg.norm(np.ptp(pieces.reshape(-1, 3), axis=0)))
    lost = 16.0 * UNIT * size * float((longest[~thin] ** 2 / areas[~thin]).max(initial=0.0))
    return np.where(thin, EDGES, FULL).astype(np.uint8), max(lost, THIN * float(longest[thin].max(initial=0.0)))

"""Candidates: balls among which some are chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.spheres.fields import Lattice

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

CANDIDATES: Final = 6_000
"""Centers that are looked at first, at most."""

NEIGHBOURS: Final = 2
"""How far, in cells, a ball is looked for that holds another."""

_LOST: Final = 0.02
"""Part of the way between two middles that a ball may stick out of another one and still count as held by it."""

_MOVED: Final = 1e-6
"""Part of a shape's size by which points of its border are moved where only candidates come of them."""

_CUTS: Final = (2, 4, 8, 16)
"""Into how many parts a cell's sides are cut where no ball lies near."""

_SAMPLES: Final = {2: 6_000, 3: 8_000}
"""Points of a border whose Voronoi cells give the medial axis."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Centers, shape (n, 3), and lower bounds of their depths, shape (n,), both in sides of a lattice's cell."""

    centers: Floats
    depths: Floats

    def where(self, kept: Bools) -> Candidates:
        """Those of a mask."""
        return Candidates(self.centers[kept], self.depths[kept])

    def joined(self, other: Candidates) -> Candidates:
        """Both together."""
        return Candidates(np.vstack([self.centers, other.centers]), np.append(self.depths, other.depths))

    def thinned(self, most: int) -> Candidates:
        """Every few of them, so that at most so many are left, always with the deepest."""
        step = max(1, -(-len(self.depths) // most))
        kept = np.arange(len(self.depths)) % step == 0
        if len(kept):
            kept[np.argmax(self.depths)] = True
        return self.where(kept)


def on_lattice(lattice: Lattice) -> Candidates:
    """Every middle of a cell."""
    return Candidates(lattice.middles, lattice.depths)


def maximal(lattice: Lattice) -> Candidates:
    """Middles of cells whose balls no ball round a middle near by holds, but for a sliver.

    They lie along the medial axis. Balls that are grown by one length hold each other just as before.
    """
    depths = np.full(lattice.cells.shape, -np.inf)
    depths[lattice.cells] = lattice.depths
    around = np.pad(depths, NEIGHBOURS, constant_values=-np.inf)
    shape: tuple[int, ...] = lattice.cells.shape
    held = np.zeros(shape, dtype=np.bool_)
    steps = range(-NEIGHBOURS, NEIGHBOURS + 1)
    for offset in product(*(steps if half else (0,) for half in lattice.half.tolist())):
        way = float(np.linalg.norm(offset))
        if way == 0.0:
            continue
        window = tuple(slice(NEIGHBOURS + o, NEIGHBOURS + o + n) for o, n in zip(offset, shape, strict=True))
        held |= around[window] >= depths + (1.0 - _LOST) * way
    return on_lattice(lattice).where(~held[lattice.cells]).thinned(CANDIDATES)


def medial(lattice: Lattice) -> Candidates:
    """Corners of the Voronoi cells of points on the border, which lie along the medial axis.

    N. Amenta, S. Choi and R. K. Kolluri, "The power crust, unions of balls, and the medial axis transform", 2001.
    """
    from scipy.spatial import QhullError, Voronoi

    region = lattice.region
    samples = border_samples(region.border.pieces, _SAMPLES[region.dim])
    # Points of a lattice lie on common spheres, over which Voronoi cells take long: they are moved a little.
    samples = samples + _MOVED * region.size * np.random.default_rng(0).uniform(-1.0, 1.0, samples.shape)
    try:
        corners = Voronoi((samples - region.bounds[0]) / region.size).vertices * region.size + region.bounds[0]
    except QhullError:  # the border is flat, or has too few points
        corners = np.empty((0, region.dim))
    inside = ((corners > region.bounds[0]) & (corners < region.bounds[1])).all(axis=1)
    corners = corners[inside]
    # Several points on one circle give one corner many times.
    cells = np.floor(2.0 * (corners - region.bounds[0]) / lattice.side)
    corners = corners[np.unique(cells, axis=0, return_index=True)[1]]
    points, depths = region.interior(corners)
    return Candidates(lattice.sides(points), depths / lattice.side).thinned(3 * CANDIDATES)


def within(lattice: Lattice, cells: Floats, *, inside: bool) -> Candidates:
    """Points in cells, given by their middles: the middles, and where ``inside``, finer ones that lie in the shape."""
    if not inside:
        return Candidates(cells, lattice.region.depths(lattice.metres(cells)) / lattice.side)
    found = Candidates(np.empty((0, 3)), np.empty(0))
    left = cells
    for cuts in (1, *_CUTS):
        if not len(left):
            break
        ticks = [(np.arange(cuts) + 0.5) / cuts - 0.5 if h else np.zeros(1) for h in lattice.half]
        offsets = np.array(list(product(*ticks)))
        points = (left[:, None] + offsets).reshape(-1, 3)
        depths = (lattice.region.depths(lattice.metres(points)) / lattice.side).reshape(len(left), -1)
        best = depths.argmax(axis=1)
        kept = depths.max(axis=1) > 0.0
        some = points.reshape(len(left), -1, 3)[kept, best[kept]]
        found = found.joined(Candidates(some, depths.max(axis=1)[kept]))
        left = left[~kept]
    return found


METHODS: Final[dict[str, Callable[[Lattice], Candidates]]] = {"greedy": maximal, "medial": medial}
"""Where balls are looked for."""


def border_samples(pieces: Floats, number: int) -> Floats:
    """About so many points of a border, evenly spread over each piece, with all corners."""
    if pieces.shape[1] == 2:
        lengths = np.sqrt(((pieces[:, 1] - pieces[:, 0]) ** 2).sum(axis=1))
        step = max(float(lengths.sum()) / number, 1e-300)
    else:
        a, b, c = np.moveaxis(pieces, 1, 0)
        areas = 0.5 * np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1))
        lengths = np.sqrt(((np.roll(pieces, -1, axis=1) - pieces) ** 2).sum(axis=2)).max(axis=1)
        # A lattice on a triangle of area A has 2 A / step^2 points; long thin ones have more along their length.
        step = max(float(np.sqrt(2.0 * areas.sum() / number)), 1e-300)
    counts = np.minimum(np.ceil(lengths / step), number).astype(np.int64)
    parts = []
    for count in np.unique(counts).tolist():
        some = pieces[counts == count]
        weights = _weights(max(count, 1), pieces.shape[1])
        parts.append(np.einsum("wk,nkd->nwd", weights, some).reshape(-1, pieces.shape[2]))
    return np.unique(np.concatenate(parts), axis=0)


def _weights(count: int, corners: int) -> Floats:
    """Barycentric coordinates of a lattice on a piece whose sides it cuts into so many parts."""
    i = np.arange(count + 1)
    if corners == 2:
        return np.column_stack([i, count - i]) / count
    first, second = (part.ravel() for part in np.meshgrid(i, i, indexing="ij"))
    kept = first + second <= count
    first, second = first[kept], second[kept]
    return np.column_stack([first, second, count - first - second]) / count

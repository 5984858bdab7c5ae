"""Cover: how often each cell of a lattice is held by chosen balls."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.spheres.choice.candidates import Candidates, on_lattice, within

if TYPE_CHECKING:
    from cspace.spectral.spheres.fields import Lattice

Floats = NDArray[np.float64]

_VOLUME: Final = {2: math.pi, 3: 4.0 / 3.0 * math.pi}


class Cover:
    """The cells of a lattice, and balls chosen to hold them.

    Parameters
    ----------
    lattice : Lattice
    whole : bool
        Whether a ball holds a cell if all of the cell lies in it, and every cell is to be held; or else, if its middle
        does, and only those in the shape are.

    Attributes
    ----------
    times : ndarray of int32
        As :mod:`cspace.spectral.spheres.choice._kernels` tells.
    """

    def __init__(self, lattice: Lattice, *, whole: bool) -> None:
        self.lattice = lattice
        self.half = lattice.half if whole else np.zeros(3)
        self.times = np.full(lattice.cells.shape, -1, dtype=np.int32)
        self.times[lattice.cells] = 0 if whole else np.where(lattice.depths > 0.0, 0, -1)

    def choose(self, candidates: Candidates, reaches: Floats, most: int) -> NDArray[np.int64]:
        """Numbers of those candidates, each with its reach in sides, that a greedy choice takes."""
        from cspace.spectral.spheres.choice import _kernels

        dim, cells = self.lattice.grid.dim, float(self.lattice.cells.sum())
        large = np.maximum(reaches, 0.0) + 0.5 * self.lattice.diagonal
        bounds = np.minimum(_VOLUME[dim] * large**dim, cells)
        chosen: NDArray[np.int64] = _kernels.choose(self.times, candidates.centers, reaches, self.half, bounds, most)
        return chosen

    @property
    def open_cells(self) -> Floats:
        """Middles of the cells that no ball holds, shape (n, 3), in sides."""
        return np.argwhere(self.times == 0).astype(np.float64) + np.float64(0.5)

    @property
    def held(self) -> int:
        """Number of cells that balls hold."""
        return int(np.count_nonzero(self.times > 0))

    def trim(self, centers: Floats, reaches: Floats, depths: Floats) -> Floats:
        """Drop balls that hold no cell alone, then cut the others to what they hold alone: reaches, 0 if dropped.

        Those that stick out most are first.
        """
        from cspace.spectral.spheres.choice import _kernels

        left = reaches.copy()
        _kernels.spare(self.times, centers, left, self.half, np.argsort(reaches, kind="stable"))
        _kernels.shrink(self.times, centers, left, self.half, np.argsort(depths - left, kind="stable"))
        return left


def covered(
    lattice: Lattice, candidates: Candidates, reach: Floats | float, least: float, *, grown: bool, most: int
) -> tuple[Cover, Candidates, Floats]:
    """Choose balls until every cell lies in one, or there are so many.

    Parameters
    ----------
    lattice : Lattice
    candidates : Candidates
    reach : float
        Of the balls, in sides; where ``grown``, beyond their depths.
    least : float
        Depth that a ball's center must have.
    grown : bool
    most : int

    Returns
    -------
    cover : Cover
        With open cells if so many balls did not do.
    balls : Candidates
    reaches : ndarray
    """
    from scipy.spatial import KDTree

    cover = Cover(lattice, whole=True)
    balls = Candidates(np.empty((0, 3)), np.empty(0))
    reaches = np.empty(0)
    # What candidates leave open, middles of cells near by may hold, and else finer points.
    for stage in (0, 1, 2):
        left = cover.open_cells
        if not len(left) or len(reaches) == most:
            break
        some = (candidates, on_lattice(lattice), None)[stage] or within(lattice, left, inside=least >= 0.0)
        some = some.where(some.depths >= least)
        lengths = some.depths + reach if grown else np.full(len(some.depths), float(reach))
        if stage == 1:
            near = KDTree(left).query(some.centers, distance_upper_bound=max(float(lengths.max(initial=0.0)), 1.0))[0]
            some, lengths = some.where(near <= lengths), lengths[near <= lengths]
        chosen = cover.choose(some, lengths, most - len(reaches))
        balls = balls.joined(Candidates(some.centers[chosen], some.depths[chosen]))
        reaches = np.append(reaches, lengths[chosen])
    return cover, balls, reaches

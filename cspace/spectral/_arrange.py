"""Few balls in or around a shape, by alternating assignment.

The growth of a ball is the length by which the largest ball in the shape around its center must
grow to contain its part of the shape. Balls are placed to make the largest growth small. It is the
distance of the shape from inner balls, and bounds how far outer balls stick out.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cspace._support.arrays import Floats, Ints
from cspace.spectral._regions import Lattice

STARTS: Final = 4
"""Number of random arrangements that few balls start from."""

MAX_ARRANGED_BALLS: Final = 64
"""Largest number of balls that are arranged; for more, greedy choices are as good."""

MAX_ROUNDS: Final = 8
"""Largest number of assignments of cells to balls."""

MAX_STEPS: Final = 6
"""Number of steps that each ball takes between two assignments."""

MIN_POINTS: Final = 2_000
"""Smallest number of points that stand for a shape while balls are placed."""

MAX_REPLACED_BALLS: Final = 12
"""Number of balls within a tolerance up to which fewer ones are searched, for the time it takes."""

MAX_POINTS: Final = 20_000
"""Largest number of points of a shape that balls are placed by."""

POINTS_PER_BALL: Final = 50
"""Smallest number of such points for each ball."""

SMALLEST_LENGTH: Final = 1e-300
"""Smallest length that others are divided by, metres."""

MAX_NEIGHBOURS: Final = 12
"""Number of centers near a point among which its ball is found."""


class Arrangement:
    """Places for few balls in or around a shape, by alternating assignment.

    Each point of the shape belongs to the ball that must grow least to contain it, and each ball
    moves to where its growth is smallest, in turns (R. Wang and others, "Variational sphere set
    approximation for solid objects", 2006).
    """

    def __init__(self, lattice: Lattice, *, inside: bool) -> None:
        """Choose points that stand for the shape; with ``inside``, centers must lie in it."""
        self.lattice = lattice
        self.is_inner = inside
        cells = lattice.to_metres(lattice.cell_centers)
        # Some points stand for all, because all are proven later; corners reach farthest.
        corners = np.unique(lattice.region.inner.pieces.reshape(-1, lattice.region.dim), axis=0)
        order = np.random.default_rng(0).permutation(len(cells) + len(corners))[:MAX_POINTS]
        self.points = np.concatenate([cells, corners])[order]

    def place(self, number: int, *starts: Floats) -> Floats:
        """Return at most ``number`` centers (n, d), metres, with a small largest growth.

        Known arrangements ``starts`` are improved, too.
        """
        from scipy.cluster.vq import kmeans2

        few = self.points[: max(MIN_POINTS, POINTS_PER_BALL * number)]
        best = np.empty((0, self.points.shape[1]))
        smallest = math.inf
        arrangements = list(starts)
        # Many arrangements are poor, so several random ones are improved.
        for seed in range(STARTS):
            rng = np.random.default_rng(seed)
            means, _ = kmeans2(few, number, minit="++", rng=rng, missing="warn")
            arrangements.append(means)
        for centers in arrangements:
            usable = centers
            if self.is_inner:
                usable = centers[self.lattice.region.depths(centers) > 0.0]
            if not len(usable):
                continue
            moved, growth = self._alternate(usable, few)
            if growth < smallest:
                smallest = growth
                best = moved
        if len(best):
            best, _ = self._alternate(best, self.points)
        return best

    def _alternate(self, centers: Floats, points: Floats) -> tuple[Floats, float]:
        """Assign points and move balls in turns; return the best centers and largest growth."""
        best = centers
        smallest = math.inf
        for _ in range(MAX_ROUNDS):
            depths = self.lattice.region.depths(centers)
            owners, growths = self._assign(centers, depths, points)
            growth = float(growths.max())
            if growth < smallest:
                best, smallest = centers, growth
            centers = self._move(centers, depths, points, owners)
        return best, smallest

    def _assign(self, centers: Floats, depths: Floats, points: Floats) -> tuple[Ints, Floats]:
        """Return the ball of each point, and the growth that each takes, shape (n,) each."""
        from scipy.spatial import cKDTree

        # The ball that needs least growth is nearly always among the nearest centers.
        near = min(len(centers), MAX_NEIGHBOURS)
        distances, balls = cKDTree(centers).query(points, k=np.arange(1, near + 1))
        growths = distances - depths[balls]
        rows = np.arange(len(points))
        least = growths.argmin(axis=1)
        return balls[rows, least], growths[rows, least]

    def _move(self, centers: Floats, depths: Floats, points: Floats, owners: Ints) -> Floats:
        """Move each ball to lower its growth, by steps that halve if none helps."""
        order = np.argsort(owners, kind="stable")
        owners = owners[order]
        points = points[order]
        # Balls without a point stay; the others are rows of the arrays below.
        present, starts, rows = np.unique(owners, return_index=True, return_inverse=True)
        placed = centers[present]
        dim = centers.shape[1]

        def square_distances(places: Floats) -> Floats:
            """Return squared distances of the points to their balls at places (n, d)."""
            return np.asarray(((points - places[rows]) ** 2).sum(axis=1))

        reaches = np.sqrt(np.maximum.reduceat(square_distances(placed), starts))
        growths = reaches - depths[present]
        steps = 0.25 * reaches
        axes = np.vstack([np.eye(dim), -np.eye(dim)])
        balls = np.arange(len(placed))
        for _ in range(MAX_STEPS):
            # Steps along the axes, and towards the farthest point.
            squares = square_distances(placed)
            is_farthest = squares >= np.maximum.reduceat(squares, starts)[rows]
            towards = np.zeros_like(placed)
            towards[rows[is_farthest]] = (points - placed[rows])[is_farthest]
            towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), SMALLEST_LENGTH)
            moves = [*np.broadcast_to(axes[:, None], (2 * dim, *placed.shape)), towards]
            places = placed + steps[:, None] * np.array(moves)
            new_depths = self.lattice.region.depths(places.reshape(-1, dim)).reshape(len(moves), -1)
            new_reaches = [np.maximum.reduceat(square_distances(each), starts) for each in places]
            new_growths = np.sqrt(new_reaches) - new_depths
            if self.is_inner:
                new_growths[new_depths <= 0.0] = np.inf
            best = new_growths.argmin(axis=0)
            is_better = new_growths[best, balls] < growths
            placed[is_better] = places[best, balls][is_better]
            growths[is_better] = new_growths[best, balls][is_better]
            steps[~is_better] *= 0.5
        moved = centers.copy()
        moved[present] = placed
        return moved

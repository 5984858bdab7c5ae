"""Few balls in or around a shape, by alternating assignment.

The growth of a ball is the length by which the largest ball in the shape around its center must
grow to contain its part of the shape. Balls are placed to make the largest growth small. It is the
distance of the shape from inner balls, and bounds how far outer balls stick out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from scipy.spatial.distance import cdist

from cspace.inside import Floats, Ints
from cspace.spectral._regions import SMALLEST_LENGTH, Lattice

MAX_SEARCHED_BALLS: Final = 16
"""Largest number of balls for which further arrangements are searched, for the time it takes."""

STARTS: Final = 4
"""Number of random arrangements that few balls start from."""

MAX_FAILURES: Final = 6
"""Number of balls that move to another part of the shape in vain before the search ends."""

MAX_ROUNDS: Final = 8
"""Largest number of assignments of cells to balls."""

MAX_STEPS: Final = 6
"""Number of steps that each ball takes between two assignments."""

MAX_CELLS: Final = 1_500
"""Largest number of points inside a shape that stand for it."""

Depths: TypeAlias = Callable[[Floats], Floats]
"""Type of a function from points (n, d) to their depths in a shape (n,), metres."""


class Arrangement:
    """Places for few balls in or around a shape, by alternating assignment.

    Each point of the shape belongs to the ball that must grow least to contain it, and each ball
    moves to where its growth is smallest, in turns (R. Wang and others, "Variational sphere set
    approximation for solid objects", 2006).
    """

    def __init__(self, lattice: Lattice, measure_depths: Depths, *, inside: bool) -> None:
        """Choose points for a shape; ``inside`` keeps centers in it.

        ``measure_depths`` gives the radii of the largest balls in the shape around points (n, d).
        """
        self.region = lattice.region
        self.measure_depths = measure_depths
        self.is_inner = inside
        # Some points stand for all, because all are proven later: some of the boundary, which lies
        # farthest from the balls, and fewer of the inside.
        rng = np.random.default_rng(0)
        self.cells = lattice.to_metres(rng.permutation(lattice.cell_centers)[:MAX_CELLS])
        corners = self.region.inner.pieces.reshape(-1, self.region.dim)
        corners = rng.permutation(np.unique(corners, axis=0))
        # Largest number of points that stand for a shape while balls are placed.
        max_points = 2_000
        boundary, _ = self.region.inner.sample(max_points, rng)
        self.points = rng.permutation(np.concatenate([self.cells, corners[:max_points], boundary]))

    def place(self, number: int, *starts: Floats) -> Floats:
        """Return up to ``number`` centers (n, d), metres, with small growth.

        Known arrangements ``starts`` are improved, too.
        """
        from scipy.cluster.vq import kmeans2

        # Many arrangements are poor, so several are improved.
        arrangements = list(starts)
        is_few = number <= MAX_SEARCHED_BALLS
        for seed in range(min(STARTS, number) if is_few else 1):
            rng = np.random.default_rng(seed)
            means, _ = kmeans2(self.cells, number, minit="++", rng=rng, missing="warn")
            arrangements.append(means)
        if not is_few:
            return self._improve(arrangements, 0)[0]
        # The better of two searches: neither is always the better one.
        best, growth = self._improve(arrangements, MAX_FAILURES)
        other, growth_of_other = self._improve([self._spread(number)], MAX_FAILURES)
        return other if growth_of_other < growth else best

    def _improve(self, arrangements: list[Floats], max_failures: int) -> tuple[Floats, float]:
        """Search from the best arrangements; return centers and growth."""
        best = np.empty((0, self.region.dim))
        smallest = math.inf
        for start in arrangements:
            centers, growth = self._alternate(start)
            if growth < smallest:
                best, smallest = centers, growth
        failures = 0
        while failures < min(max_failures, len(best) - 1):
            centers, growth = self._alternate(self._relocate(best, failures))
            failures += 1
            if growth < smallest:
                best, smallest = centers, growth
                failures = 0
        return best, smallest

    def _spread(self, number: int) -> Floats:
        """Return centers far apart: the deepest, then the neediest."""
        centers = self.cells[[self.measure_depths(self.cells).argmax()]]
        for _ in range(number - 1):
            growths = cdist(self.cells, centers) - self.measure_depths(centers)
            centers = np.vstack([centers, self.cells[growths.min(axis=1).argmax()]])
        return centers

    def _alternate(self, centers: Floats) -> tuple[Floats, float]:
        """Assign points and move balls alternately; return the best."""
        if self.is_inner:
            centers = centers[self.measure_depths(centers) > 0.0]
        best = centers
        smallest = math.inf
        for _ in range(MAX_ROUNDS if len(centers) else 0):
            growths, depths = self._grow(centers)
            owners = growths.argmin(axis=1)
            growth = float(growths.min(axis=1).max())
            if growth < smallest:
                best, smallest = centers, growth
            centers = self._move(centers, depths, self.points, owners)
        return best, smallest

    def _grow(self, centers: Floats) -> tuple[Floats, Floats]:
        """Return points' growths of balls, and the balls' depths."""
        depths = self.measure_depths(centers)
        return cdist(self.points, centers) - depths, depths

    def _relocate(self, centers: Floats, rank: int) -> Floats:
        """Move a replaceable ball to the point of the largest growth.

        ``rank`` balls are replaced better.
        """
        growths, _ = self._grow(centers)
        owners = growths.argmin(axis=1)
        rows = np.arange(len(owners))
        worst = growths[rows, owners].argmax()
        # Without a ball, its points belong to the next one.
        growths[rows, owners] = np.inf
        costs = np.full(len(centers), -np.inf)
        np.maximum.at(costs, owners, growths.min(axis=1))
        costs[owners[worst]] = np.inf
        moved = centers.copy()
        moved[costs.argsort()[rank]] = (centers[owners[worst]] + self.points[worst]) / 2.0
        return moved

    def _move(self, centers: Floats, depths: Floats, points: Floats, owners: Ints) -> Floats:
        """Move balls to lower their growth, by halving steps."""
        order = np.argsort(owners, kind="stable")
        owners = owners[order]
        points = points[order]
        # Balls without a point stay; the others are rows of the arrays below.
        present, starts, rows = np.unique(owners, return_index=True, return_inverse=True)
        placed = centers[present]
        dim = centers.shape[1]
        offsets = points - placed[rows]
        squares = np.einsum("ij,ij->i", offsets, offsets)
        reaches = np.sqrt(np.maximum.reduceat(squares, starts))
        growths = reaches - depths[present]
        steps = 0.25 * reaches
        axes = np.vstack([np.eye(dim), -np.eye(dim)])
        balls = np.arange(len(placed))
        for _ in range(MAX_STEPS):
            # Steps along the axes, and towards the farthest point.
            offsets = points - placed[rows]
            squares = np.einsum("ij,ij->i", offsets, offsets)
            is_farthest = squares >= np.maximum.reduceat(squares, starts)[rows]
            towards = np.zeros_like(placed)
            towards[rows[is_farthest]] = offsets[is_farthest]
            towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), SMALLEST_LENGTH)
            moves = np.array([*np.broadcast_to(axes[:, None], (2 * dim, *placed.shape)), towards])
            places = placed + steps[:, None] * moves
            new_depths = self.measure_depths(places.reshape(-1, dim)).reshape(len(moves), -1)
            # A step s along a unit vector m leads to the square |o|^2 - 2 s o.m + s^2.
            along = np.einsum("ij,ij->i", offsets, towards[rows])
            ahead = np.vstack([offsets.T, -offsets.T, along])
            largest = np.maximum.reduceat(squares - 2.0 * steps[rows] * ahead, starts, axis=1)
            new_growths = np.sqrt(np.maximum(largest + steps**2, 0.0)) - new_depths
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

"""Places of balls in or around a shape.

The growth of a ball is the length by which the largest ball in the shape around its center must
grow to contain its part of the shape. Balls are placed to make the largest growth small. It is the
distance of the shape from inner balls, and bounds how far outer balls stick out.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from cspace._support.arrays import Floats, Ints
from cspace.spectral._regions import Lattice, cube_gaps

MAX_SEARCHED_BALLS: Final = 16
"""Largest number of balls for which further arrangements are searched, for the time it takes."""

STARTS: Final = 2
"""Number of first balls from which few balls are placed one by one."""

MAX_FAILURES: Final = 6
"""Number of balls that move to another part of the shape in vain before the search ends."""

MAX_ROUNDS: Final = 8
"""Largest number of assignments of points to balls."""

MAX_STEPS: Final = 6
"""Number of steps that each ball takes between two assignments."""

MAX_CELLS: Final = 1_500
"""Largest number of points inside a shape that stand for it."""

MIN_POINTS: Final = 2_000
"""Smallest number of points of a boundary, and largest number of its corners, that stand for a
shape."""

POINTS_PER_BALL: Final = 30
"""Points of a boundary for each ball."""

MAX_BALLS_WITH_POINTS: Final = 400
"""Number of balls that get points of their own, to bound memory; more share them."""

MAX_CANDIDATES: Final = 2_000
"""Largest number of centers that a greedy choice chooses from."""

POINTS_PER_CELL: Final = 20
"""Points of a cell that are tried for centers in a shape thinner than cells."""

REACH_HALVINGS: Final = 9
"""Number of times that the range of the reach of a greedy choice is halved."""

INSERTED_SHARES: Final = np.array([[0.2], [0.5], [0.7], [0.85], [0.95], [0.98]])
"""Places of a further ball, as shares of the way from the nearest center to the farthest point."""

SMALLEST_LENGTH: Final = 1e-300
"""Smallest length that others are divided by, metres."""


class Arrangement:
    """Places for balls in or around a shape, by a greedy choice and alternating assignment.

    A greedy choice among centers along the medial axis (V. Chvatal, "A greedy heuristic for the
    set-covering problem", 1979) is improved: each point of the shape belongs to the ball that must
    grow least to contain it, and each ball moves to where its growth is smallest, in turns (R. Wang
    and others, "Variational sphere set approximation for solid objects", 2006).
    """

    def __init__(self, lattice: Lattice, number: int, *, inside: bool) -> None:
        """Choose points that stand for the shape, enough for ``number`` balls.

        With ``inside``, centers must lie in the shape.
        """
        self.region = lattice.region
        self.is_inner = inside
        dim = self.region.dim
        # Some points stand for all, because all are proven later: some of the boundary, which lies
        # farthest from the balls, and fewer of the inside.
        rng = np.random.default_rng(0)
        cells = rng.permutation(lattice.cell_centers)[:MAX_CELLS]
        inner_cells = cells[self.region.depths(cells) > 0.0]
        pieces = self.region.inner.pieces
        corners = rng.permutation(np.unique(pieces.reshape(-1, dim), axis=0))
        sides = np.diff(pieces, axis=1)
        sizes = np.linalg.norm(sides[:, 0], axis=1)
        if dim == 3:
            sizes = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        count = MIN_POINTS + POINTS_PER_BALL * min(number, MAX_BALLS_WITH_POINTS)
        chosen = rng.choice(len(pieces), count, p=sizes / sizes.sum() if sizes.any() else None)
        weights = rng.dirichlet(np.ones(dim), count)
        boundary = np.einsum("ij,ijk->ik", weights, pieces[chosen])
        self.points = rng.permutation(np.concatenate([inner_cells, corners[:MIN_POINTS], boundary]))
        candidates = self._keep_valid(lattice.find_medial_centers())
        if not len(candidates):
            shifts = rng.uniform(-0.5, 0.5, (POINTS_PER_CELL, *cells.shape)) * lattice.side
            candidates = self._keep_valid((cells + shifts).reshape(-1, dim))
        self.candidates = rng.permutation(candidates)[:MAX_CANDIDATES]
        depths = self.region.depths(self.candidates)
        self.candidate_growths = cdist(self.points, self.candidates) - depths

    def place(self, number: int) -> Floats:
        """Return at most ``number`` centers (n, d), metres, with a small largest growth."""
        # Many arrangements are poor, so several are improved.
        starts = [self._choose_nearest(number)]
        is_few = number <= MAX_SEARCHED_BALLS
        if is_few:
            for first in self.candidates[:STARTS]:
                grown = first[None]
                for count in range(2, number + 1):
                    grown, _ = self._alternate(self._insert(grown, count))
                starts.append(grown)
        best, smallest = min(map(self._alternate, starts), key=lambda arranged: arranged[1])
        if len(best) < number:
            best, smallest = self._alternate(self._insert(best, number))
        failures = 0
        while is_few and failures < min(MAX_FAILURES, len(best) - 1):
            centers, growth = self._alternate(self._relocate(best, failures))
            failures += 1
            if growth < smallest:
                best, smallest = centers, growth
                failures = 0
        return best

    def cover(self, reach: float) -> Floats:
        """Return centers (n, d), metres, whose growth is about a reach, or less."""
        centers, _ = self._alternate(self._choose(reach, len(self.points)))
        return self._insert(centers, len(self.points), reach)

    def _keep_valid(self, centers: Floats) -> Floats:
        """Return the centers that a ball may have."""
        return centers[self.region.depths(centers) > 0.0] if self.is_inner else centers

    def _choose_nearest(self, number: int) -> Floats:
        """Choose at most ``number`` candidates that cover all points with a small growth."""
        enough = float(self.candidate_growths.max(initial=0.0))
        too_small = 0.0
        best = self._choose(enough, number)
        for _ in range(REACH_HALVINGS):
            reach = math.sqrt(enough * max(too_small, 1e-3 * enough))
            centers = self._choose(reach, number + 1)
            if len(centers) <= number:
                best, enough = centers, reach
            else:
                too_small = reach
        return best

    def _choose(self, reach: float, number: int) -> Floats:
        """Choose at most ``number`` candidates, each of which, grown by a reach, adds most points.

        The choice ends if no candidate adds a point.
        """
        contains = self.candidate_growths <= reach
        gains = np.count_nonzero(contains, axis=0)
        is_open = np.ones(len(contains), dtype=np.bool_)
        chosen: list[int] = []
        while len(chosen) < number and gains.any():
            ball = int(gains.argmax())
            added = np.flatnonzero(contains[:, ball] & is_open)
            is_open[added] = False
            gains -= np.count_nonzero(contains[added], axis=0)
            chosen.append(ball)
        return self.candidates[chosen]

    def _insert(self, centers: Floats, number: int, reach: float = 0.0) -> Floats:
        """Add balls near the points of the largest growth, until it is at most a reach.

        The result has at most ``number`` centers.
        """
        growths, owners, _ = self._grow(centers)
        places = list(centers)
        while places and len(places) < number and growths.max() > reach:
            worst = growths.argmax()
            center = places[owners[worst]]
            tried = self._keep_valid(center + INSERTED_SHARES * (self.points[worst] - center))
            tried_growths = cdist(tried, self.points) - self.region.depths(tried)[:, None]
            lowered = np.minimum(tried_growths, growths)
            # Of the balls that help the farthest point much, take the one that helps others most.
            helps = np.flatnonzero(lowered[:, worst] <= 0.7 * growths[worst])
            if not len(helps):
                break
            ball = helps[(np.maximum(lowered[helps], 0.0) ** 2).sum(axis=1).argmin()]
            owners[tried_growths[ball] < growths] = len(places)
            growths = lowered[ball]
            places.append(tried[ball])
        return np.array(places).reshape(-1, centers.shape[1])

    def _alternate(self, centers: Floats) -> tuple[Floats, float]:
        """Assign points and move balls in turns; return the best centers and largest growth."""
        best = centers
        smallest = math.inf
        for _ in range(MAX_ROUNDS if len(centers) else 0):
            growths, owners, depths = self._grow(centers)
            growth = float(growths.max())
            if growth < smallest:
                best, smallest = centers, growth
            centers = self._move(centers, depths, self.points, owners)
        return best, smallest

    def _grow(self, centers: Floats) -> tuple[Floats, Ints, Floats]:
        """Return the least growth of each point and its ball, and the depth of each ball."""
        depths = self.region.depths(centers)
        if not len(centers):
            return np.empty(0), np.empty(0, dtype=np.int64), depths
        growths, _, owners = cube_gaps(self.points, 0.0, centers, depths)
        return growths, owners, depths

    def _relocate(self, centers: Floats, rank: int) -> Floats:
        """Move a ball that others replace well to the point that takes the largest growth.

        ``rank`` balls are replaced better.
        """
        growths, owners, depths = self._grow(centers)
        worst = growths.argmax()
        # Without a ball, its points belong to the next one.
        others = cdist(self.points, centers) - depths
        others[np.arange(len(owners)), owners] = np.inf
        costs = np.full(len(centers), -np.inf)
        np.maximum.at(costs, owners, others.min(axis=1))
        costs[owners[worst]] = np.inf
        return self._insert(np.delete(centers, costs.argsort()[rank], axis=0), len(centers))

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
            offsets = points - places[rows]
            return np.asarray(np.einsum("ij,ij->i", offsets, offsets))

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
            new_depths = self.region.depths(places.reshape(-1, dim)).reshape(len(moves), -1)
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

"""Ball sets, and what pairs of their balls have in common: the norms and thresholds that proofs stand on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.spectral.bump import FLOOR, PAIR_TOLERANCE, Bump, check_bump
from cspace.spectral.inputs import check_solid_balls
from cspace.spectral.radial import (
    chebyshev_coefficients,
    chebyshev_nodes,
    lens_measure,
    product_integrals,
    radial_transform,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Table = Callable[[Floats], tuple[Floats, float]]

ROUNDING: Final = 2.0**-50
"""Bound, with room to spare, of the relative error of the few operations that turn and shift a coordinate."""

COUNTS: Final = (26, 32)
"""Of nodes of two rules; what they differ by bounds the error of the finer one, which is far less."""

NODES: Final = 64
"""Distances in a table of pairs of two radii."""

SAFETY: Final = 4.0
"""By how much measured errors are multiplied before they are relied upon."""

FEW: Final = 8
"""Pairs up to which each is integrated by itself, to :data:`PAIR_TOLERANCE`."""

ALONE: Final = 1e-13
"""Relative error of the integral of a bump's own square."""

AT_ONCE: Final = 2**21
"""Pairs that are held at once."""


@dataclass(frozen=True, eq=False, slots=True)
class BallSet:
    """Balls in one frame: centers, shape (n, d), and radii above zero, shape (n,), metres."""

    centers: Floats
    radii: Floats

    @classmethod
    def of(cls, source: Any, name: str) -> BallSet:
        """The balls of an object with ``centers`` and ``radii``, of a robot of balls, or of a pair of arrays.

        Raises
        ------
        InputError
            If there is no ball, the shapes do not fit, a value is not finite, or a radius is not above zero.
        """
        if isinstance(source, BallSet):
            return source
        pair: Any = source
        balls: Any
        for balls in (source, getattr(source, "shape", None)):  # of a robot, its shape has them
            if not isinstance(pair, tuple) and hasattr(balls, "centers") and hasattr(balls, "radii"):
                pair = (balls.centers, balls.radii)
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            rule, mend = (
                "it must have centers and radii, or be a pair of them",
                "decompose other shapes first",
            )
            raise InputError(name, f"is a {type(source).__name__}", rule, mend, value=source)
        return cls(*check_solid_balls(*pair))

    @property
    def dim(self) -> int:
        """2 or 3."""
        return int(self.centers.shape[1])

    @property
    def span(self) -> float:
        """Largest modulus of a coordinate, plus the largest radius: to what the rounding is relative, metres."""
        return float(np.abs(self.centers).max() + self.radii.max())

    @property
    def middle(self) -> Floats:
        """Middle of the box around the centers, shape (d,)."""
        return np.asarray((self.centers.min(axis=0) + self.centers.max(axis=0)) / 2)

    def reach(self, middle: Floats) -> float:
        """Radius of the ball around a point that holds all balls."""
        return float((np.linalg.norm(self.centers - middle, axis=1) + self.radii).max())

    def sides(self, middle: Floats) -> Floats:
        """Half the sides of the box around a point that holds all balls, shape (d,)."""
        return np.asarray((np.abs(self.centers - middle) + self.radii[:, None]).max(axis=0))

    def grown(self, distance: float) -> BallSet:
        """The same with ``distance`` added to every radius, metres."""
        return BallSet(self.centers, self.radii + distance)

    def turned(self, matrix: Floats) -> BallSet:
        """The same with every center turned about the origin."""
        return BallSet(self.centers @ matrix.T, self.radii)

    def rounded(self, number: int, up: bool) -> BallSet:
        """The same with at most ``number`` different radii, each ball grown (``up``) or shrunk to the next of them.

        Each serves about as many balls.
        """
        if len(np.unique(self.radii)) <= number:
            return self
        shares = np.arange(number) / number
        if up:
            steps = np.unique(np.quantile(self.radii, 1.0 - shares, method="higher"))
            return BallSet(self.centers, steps[np.searchsorted(steps, self.radii, side="left")])
        steps = np.unique(np.quantile(self.radii, shares, method="lower"))
        return BallSet(self.centers, steps[np.searchsorted(steps, self.radii, side="right") - 1])


def bump_of(bump: Bump | None, *sources: Any) -> Bump:
    """The bump that was asked for, or else that of the sources that have one, or else the usual one.

    Raises InputError if it is no bump, or none was asked for and those of the sources differ.
    """
    bumps = {source.bump for source in sources if isinstance(getattr(source, "bump", None), Bump)}
    if bump is None and len(bumps) > 1:
        raise InputError("bump", f"is left out, and the descriptors have {bumps}", "both must have one", "pass bump=")
    return check_bump(bumps.pop() if bump is None and bumps else bump)


# ---- integrals -------------------------------------------------------------------------------------------------------


def pair_integrals(bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int) -> tuple[Floats, Floats]:
    """Integrals of ``psi(x / first) psi((x - distance e) / second)``, all shape (n,), and by how much each may be off.

    Of more than a few pairs, that is what two rules differ by, at most, for any of the pairs, relative to the smaller
    ball: on a single pair rules may agree by chance.
    """
    if bump.is_indicator:
        values = lens_measure(first, second, distances, dim)
        return values, SAFETY * ROUNDING * values
    sizes = np.minimum(first, second) ** dim
    if len(sizes) <= FEW:
        triples = zip(first.tolist(), second.tolist(), distances.tolist(), strict=True)
        values = np.array([bump.pair_integral(*triple, dim) for triple in triples])
        return values, SAFETY * PAIR_TOLERANCE * values + FLOOR * sizes
    rough, values = (product_integrals(bump.values, first, second, distances, dim, count) for count in COUNTS)
    worst = SAFETY * float((np.abs(rough - values) / sizes).max())
    return values, worst * sizes + 2.0**-46 * values


def norm_square(bump: Bump, balls: BallSet) -> tuple[float, float]:
    """Integral of the square of a descriptor, the sum of what all pairs of its balls have in common; and its error."""
    radii, which = np.unique(balls.radii, return_inverse=True)
    tables: dict[int, Table] = {}
    # Each with itself, and twice all others.
    own = radial_transform(lambda s: bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(own[0] * (balls.radii**balls.dim).sum())
    error = SAFETY * ALONE * value
    for i, j in _meeting(balls):
        gaps = np.sqrt(((balls.centers[i] - balls.centers[j]) ** 2).sum(axis=1))
        keys, group, counts = np.unique(which[i] * len(radii) + which[j], return_inverse=True, return_counts=True)
        many = (counts > NODES) & (not bump.is_indicator)  # whose integrals are no smooth function of the distance
        for number in np.flatnonzero(many):
            key = int(keys[number])
            if key not in tables:
                one, other = divmod(key, len(radii))
                tables[key] = _tabled(bump, float(radii[one]), float(radii[other]), balls.dim)
            values, off = tables[key](gaps[group == number])
            value += 2.0 * float(values.sum())
            error += 2.0 * len(values) * off
        few = ~many[group]
        if few.any():
            values, offs = pair_integrals(bump, balls.radii[i[few]], balls.radii[j[few]], gaps[few], balls.dim)
            value += 2.0 * float(values.sum())
            error += 2.0 * float(offs.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


def _meeting(balls: BallSet) -> Iterator[tuple[Ints, Ints]]:
    """Each pair of balls that meet, once, the larger of the two first; some at a time."""
    from scipy.spatial import cKDTree

    centers, radii = balls.centers, balls.radii
    tree = cKDTree(centers)
    place = np.empty(len(radii), dtype=np.int64)
    place[np.argsort(radii, kind="stable")] = np.arange(len(radii))
    # No ball that is smaller, and meets one, is farther away than this one is wide.
    reaches = 2.0 * radii * (1.0 + 2.0**-40)
    totals = np.cumsum(tree.query_ball_point(centers, reaches, return_length=True))
    start = 0
    while start < len(radii):
        before = totals[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(totals, before + AT_ONCE, side="right")))
        near = tree.query_ball_point(centers[start:stop], reaches[start:stop])
        i = np.repeat(np.arange(start, stop), [len(some) for some in near])
        j = np.concatenate([np.asarray(some, dtype=np.int64) for some in near])
        square = ((centers[i] - centers[j]) ** 2).sum(axis=1)
        kept = (place[j] < place[i]) & (square <= (radii[i] + radii[j]) ** 2)
        yield i[kept], j[kept]
        start = stop


def _tabled(bump: Bump, first: float, second: float, dim: int) -> Table:
    """A function from distances to the integrals for two radii, and by how much each may be off."""
    reach = first + second
    nodes = chebyshev_nodes(NODES)
    between = np.cos(math.pi * np.arange(NODES + 1) / NODES)
    gaps = 0.5 * reach * (1.0 + np.concatenate([nodes, between]))
    values, errors = pair_integrals(bump, np.full_like(gaps, first), np.full_like(gaps, second), gaps, dim)
    fit = np.polynomial.Chebyshev(chebyshev_coefficients(values[:NODES]))
    off = float(errors.max()) + SAFETY * float(np.abs(fit(between) - values[NODES:]).max())
    return lambda distances: (np.asarray(fit(np.minimum(2.0 * distances / reach, 2.0) - 1.0)), off)


def touching_overlap(bump: Bump, first: BallSet, second: BallSet, swell: float, slack: float) -> float:
    """A lower bound of what two balls have in common, after each has grown by ``swell``, if before they touched.

    A bump is a mixture of indicators of balls about its center, and what two balls have in common falls with the
    distance of their centers; so does, then, the integral of the product of two bumps. So it is least, for two radii,
    where the balls only just touch; and all pairs of radii are looked at. By ``slack``, in metres, balls that touch may
    be apart, from rounding.
    """
    a, b = (part.ravel() for part in np.meshgrid(np.unique(first.radii), np.unique(second.radii)))
    gaps = a + b + slack
    values, errors = pair_integrals(bump, a + swell, b + swell, gaps, first.dim)
    least = math.inf
    # Each by itself, to more digits, but only those pairs that may be the least.
    for n in np.argsort(values - errors):
        if values[n] - errors[n] > least:
            break
        exact = bump.pair_integral(a[n] + swell, b[n] + swell, gaps[n], first.dim)
        floor = FLOOR * (min(a[n], b[n]) + swell) ** first.dim
        least = min(least, exact * (1.0 - SAFETY * PAIR_TOLERANCE) - floor)
    return max(0.0, least)

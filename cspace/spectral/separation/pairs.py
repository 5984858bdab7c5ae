"""What two balls of a descriptor have in common, for many pairs at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.descriptors.lenses import FLOOR

if TYPE_CHECKING:
    from cspace.spectral.descriptors import Bump
    from cspace.spectral.separation.balls import BallSet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Table = Callable[[Floats], tuple[Floats, float]]

RULES: Final = (40, 49, 57, 64)
"""Nodes along each axis of Gauss-Legendre rules; what the finest differs from any other by bounds its error. With one
other rule it would be by chance, now and then, that both are off by the same."""

NODES: Final = 64
"""Distances in a table of pairs of two radii."""

SAFETY: Final = 4.0
"""By how much measured errors are multiplied before they are relied upon."""

FEW: Final = 8
"""Pairs up to which each is integrated by the rule that adapts itself."""

ADAPTED: Final = 1e-9
"""Relative error of that rule."""

ALONE: Final = 1e-13
"""Relative error of the integral of a bump's own square."""

AT_ONCE: Final = 2**21
"""Pairs that are held at once."""


def pair_integrals(bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int) -> tuple[Floats, float]:
    """Integrals of ``psi(x / first) psi((x - distance e) / second)`` over the plane or space.

    Parameters
    ----------
    bump : Bump
    first, second, distances : ndarray of float64, shape (n,)
        Radii, and the distances of the centers, metres.
    dim : int

    Returns
    -------
    values : ndarray of float64, shape (n,)
        Metres to the power ``dim``.
    error : float
        By how much a value may be off.
    """
    values, errors = _integrals(bump, first, second, distances, dim)
    return values, float(errors.max(initial=0.0))


def _integrals(bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int) -> tuple[Floats, Floats]:
    """The same, with the error of each value.

    Of more than a few pairs, errors are what rules differ by, at most, for any of the pairs, relative to the smaller
    ball: on a single pair rules may agree by chance.
    """
    triples = np.stack([first, second, distances], axis=1)
    if math.isinf(bump.alpha):
        values = np.array([bump.pair_integral(a, b, gap, dim) for a, b, gap in triples.tolist()])
        return values, SAFETY * 2.0**-50 * values
    sizes = triples[:, :2].min(axis=1) ** dim
    if len(triples) <= FEW:
        values = np.array([bump.pair_integral(a, b, gap, dim, ADAPTED) for a, b, gap in triples.tolist()])
        return values, SAFETY * ADAPTED * values + FLOOR * sizes
    # A few at a time, so that the nodes of a step fit into the cache.
    parts = np.array_split(triples, max(1, len(triples) // 8))
    *others, values = (np.concatenate([_by_rule(bump, part, dim, nodes) for part in parts]) for nodes in RULES)
    worst = SAFETY * float((np.abs(np.array(others) - values) / sizes).max())
    return values, worst * sizes + 2.0**-46 * values


def norm_square(bump: Bump, balls: BallSet) -> tuple[float, float]:
    """Integral of the square of a descriptor: the sum of what all pairs of its balls have in common.

    Returns
    -------
    value, error : float
        Metres to the power of the dimension; by how much it may be off.
    """
    radii, which = np.unique(balls.radii, return_inverse=True)
    tables: dict[int, Table] = {}
    # Each with itself, and twice all others.
    own = _square_alone(bump, balls.dim)
    value = own * float((balls.radii**balls.dim).sum())
    error = SAFETY * ALONE * value
    for i, j in _meeting(balls):
        gaps = np.sqrt(((balls.centers[i] - balls.centers[j]) ** 2).sum(axis=1))
        _, group, counts = np.unique(which[i] * len(radii) + which[j], return_inverse=True, return_counts=True)
        many = counts > NODES
        for one in np.flatnonzero(many):
            some = np.flatnonzero(group == one)
            first, second = balls.radii[i[some[0]]], balls.radii[j[some[0]]]
            key = int(which[i[some[0]]] * len(radii) + which[j[some[0]]])
            if key not in tables:
                tables[key] = _tabled(bump, float(first), float(second), balls.dim)
            values, off = tables[key](gaps[some])
            value += 2.0 * float(values.sum())
            error += 2.0 * len(some) * off
        few = ~many[group]
        if few.any():
            values, offs = _integrals(bump, balls.radii[i[few]], balls.radii[j[few]], gaps[few], balls.dim)
            value += 2.0 * float(values.sum())
            error += 2.0 * float(offs.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


def _square_alone(bump: Bump, dim: int) -> float:
    """Integral of the square of the bump of radius 1."""
    from cspace.spectral.descriptors.hankel import RadialTransform

    if math.isinf(bump.alpha):
        return bump.pair_integral(1.0, 1.0, 0.0, dim)
    return float(RadialTransform(lambda s: bump.profile(s) ** 2, dim, ALONE)(np.zeros(1))[0])


def _meeting(balls: BallSet) -> Iterator[tuple[Ints, Ints]]:
    """Each pair of balls that meet, once, the larger of the two first; some at a time."""
    from scipy.spatial import cKDTree

    centers, radii = balls.centers, balls.radii
    tree = cKDTree(centers)
    place = np.empty(len(radii), dtype=np.int64)
    place[np.argsort(radii, kind="stable")] = np.arange(len(radii))
    # No ball that is smaller, and meets one, is farther away than this one is wide.
    reaches = 2.0 * radii * (1.0 + 2.0**-40)
    found = np.cumsum(tree.query_ball_point(centers, reaches, return_length=True))
    start = 0
    while start < len(radii):
        before = found[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(found, before + AT_ONCE, side="right")))
        near = tree.query_ball_point(centers[start:stop], reaches[start:stop])
        i = np.repeat(np.arange(start, stop), [len(some) for some in near])
        j = np.concatenate([np.asarray(some, dtype=np.int64) for some in near])
        square = ((centers[i] - centers[j]) ** 2).sum(axis=1)
        kept = (place[j] < place[i]) & (square <= (radii[i] + radii[j]) ** 2)
        yield i[kept], j[kept]
        start = stop


def touching_overlap(bump: Bump, first: BallSet, second: BallSet, swell: float, slack: float) -> float:
    """A lower bound of what two balls have in common, after each has grown by ``swell``, if before they touched.

    A bump is a mixture of indicators of balls about its center, and what two balls have in common falls with the
    distance of their centers; so does, then, the integral of the product of two bumps. So it is least, for two radii,
    where the balls only just touch; and all pairs of radii are looked at.

    Parameters
    ----------
    bump : Bump
    first, second : BallSet
        Before they have grown.
    swell : float
        Metres.
    slack : float
        By how much balls that touch may be apart, from rounding, metres.
    """
    a, b = (part.ravel() for part in np.meshgrid(np.unique(first.radii), np.unique(second.radii)))
    gaps = a + b + slack
    values, errors = _integrals(bump, a + swell, b + swell, gaps, first.dim)
    least = math.inf
    # By the rule that adapts itself, but only those pairs that may be the least.
    for n in np.argsort(values - errors):
        if values[n] - errors[n] > least:
            break
        exact = bump.pair_integral(a[n] + swell, b[n] + swell, gaps[n], first.dim, ADAPTED)
        floor = FLOOR * (min(a[n], b[n]) + swell) ** first.dim
        least = min(least, exact * (1.0 - SAFETY * ADAPTED) - floor)
    return max(0.0, least)


def _tabled(bump: Bump, first: float, second: float, dim: int) -> Table:
    """A function from distances to the integrals for two radii, and by how much each may be off."""
    if math.isinf(bump.alpha):

        def exact(distances: Floats) -> tuple[Floats, float]:
            some, which = np.unique(distances, return_inverse=True)
            values, error = pair_integrals(bump, np.full_like(some, first), np.full_like(some, second), some, dim)
            return values[which], error

        return exact
    reach = first + second
    nodes = np.cos(math.pi * (np.arange(NODES) + 0.5) / NODES)
    between = np.cos(math.pi * np.arange(NODES + 1) / NODES)
    known = 0.5 * reach * (1.0 + np.concatenate([nodes, between]))
    values, error = pair_integrals(bump, np.full_like(known, first), np.full_like(known, second), known, dim)
    fit = np.polynomial.Chebyshev.fit(nodes, values[:NODES], NODES - 1, domain=[-1.0, 1.0])
    off = error + SAFETY * float(np.abs(fit(between) - values[NODES:]).max())
    return lambda distances: (np.asarray(fit(np.minimum(2.0 * distances / reach, 2.0) - 1.0)), off)


def _by_rule(bump: Bump, triples: Floats, dim: int, nodes: int) -> Floats:
    """By one rule, in polar coordinates around the smaller ball, over the part of it that the other one covers."""
    x, weights = np.polynomial.legendre.leggauss(nodes)
    x, weights = 0.5 * (1.0 + x), 0.5 * weights
    a, b, gap = triples[:, :2].min(axis=1)[:, None], triples[:, :2].max(axis=1)[:, None], triples[:, 2:]
    nearest = np.clip(gap - b, 0.0, a)
    s = nearest + (a - nearest) * x
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.arccos(np.clip((s * s + gap * gap - b * b) / (2.0 * s * gap), -1.0, 1.0))
    most = np.where(s + gap <= b, math.pi, np.where(np.isnan(most), 0.0, most))
    theta = most[..., None] * x
    square = (s - gap)[..., None] ** 2 + 4.0 * (s * gap)[..., None] * np.sin(0.5 * theta) ** 2
    values = bump.profile(np.sqrt(square) / b[..., None])
    if dim == 3:
        values *= math.pi * np.sin(theta)
    around = 2.0 * most * (values @ weights)
    return np.asarray((bump.profile(s / a) * s ** (dim - 1) * around * weights).sum(axis=1) * (a - nearest)[:, 0])

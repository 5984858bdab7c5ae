"""What pairs of balls have in common: the norms and thresholds that proofs stand on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.bump import (
    FLOOR,
    PAIR_TOLERANCE,
    Bump,
    chebyshev_coefficients,
    chebyshev_nodes,
    lens_measure,
    product_integrals,
    radial_transform,
)
from cspace.spectral.descriptors import ROUNDING, BallDescriptor

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Table = Callable[[Floats], tuple[Floats, float]]

COUNTS: Final = (26, 32)
"""Of nodes of two rules; what they differ by bounds the error of the finer one, which is far less."""

NODES: Final = 64  # distances in a table of pairs of two radii
SAFETY: Final = 4.0  # by how much measured errors are multiplied before they are relied upon

FEW: Final = 8
"""Pairs up to which each is integrated by itself, to :data:`PAIR_TOLERANCE`."""

ALONE: Final = 1e-13  # relative error of the integral of a bump's own square
AT_ONCE: Final = 2**8  # balls whose neighbours are held at once


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


def norm_square(balls: BallDescriptor) -> tuple[float, float]:
    """Integral of the square of a descriptor, the sum of what all pairs of its balls have in common; and its error."""
    bump = balls.bump
    radii, which = np.unique(balls.radii, return_inverse=True)
    tables: dict[int, Table] = {}
    # Each with itself, and twice all others.
    own = radial_transform(lambda s: bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(own[0] * (balls.radii**balls.dim).sum())
    error = SAFETY * ALONE * value
    for i, j in _meeting(balls):
        gaps = np.linalg.norm(balls.centers[i] - balls.centers[j], axis=1)
        keys, group, counts = np.unique(which[i] * len(radii) + which[j], return_inverse=True, return_counts=True)
        many = (counts > NODES) & (not bump.is_indicator)  # whose integrals are no smooth function of the distance
        for number in np.flatnonzero(many):
            key = int(keys[number])
            if key not in tables:
                one, other = divmod(key, len(radii))
                tables[key] = _tabled(bump, float(radii[one]), float(radii[other]), balls.dim)
            values, off = tables[key](gaps[group == number])
            value, error = value + 2.0 * float(values.sum()), error + 2.0 * len(values) * off
        few = ~many[group]
        if few.any():
            values, offs = pair_integrals(bump, balls.radii[i[few]], balls.radii[j[few]], gaps[few], balls.dim)
            value, error = value + 2.0 * float(values.sum()), error + 2.0 * float(offs.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


def _meeting(balls: BallDescriptor) -> Iterator[tuple[Ints, Ints]]:
    """Each pair of balls that meet, once, the larger of the two first; those of some balls at a time."""
    from scipy.spatial import cKDTree

    centers, radii = balls.centers, balls.radii
    tree, place = cKDTree(centers), np.empty(len(radii), dtype=np.int64)
    place[np.argsort(radii, kind="stable")] = np.arange(len(radii))
    for some in np.array_split(np.arange(len(radii)), math.ceil(len(radii) / AT_ONCE)):
        # No ball that is smaller, and meets one, is farther away than this one is wide.
        near = tree.query_ball_point(centers[some], 2.0 * radii[some] * (1.0 + 2.0**-40))
        i = np.repeat(some, [len(each) for each in near])
        j = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        square = ((centers[i] - centers[j]) ** 2).sum(axis=1)
        kept = (place[j] < place[i]) & (square <= (radii[i] + radii[j]) ** 2)
        yield i[kept], j[kept]


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


def touching_overlap(first: BallDescriptor, second: BallDescriptor, swell: float, slack: float) -> float:
    """A lower bound of what two balls have in common, after each has grown by ``swell``, if before they touched.

    A bump is a mixture of indicators of balls about its center, and what two balls have in common falls with the
    distance of their centers; so does, then, the integral of the product of two bumps. So it is least, for two radii,
    where the balls only just touch; and all pairs of radii are looked at. By ``slack``, in metres, balls that touch may
    be apart, from rounding.
    """
    bump = first.bump
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

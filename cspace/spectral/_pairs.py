"""Integrals of products of descriptors, as sums over pairs of balls with bounds of their errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

import numpy as np

from cspace._support.arrays import Floats, Ints
from cspace.spectral._bump import (
    SAFETY_FACTOR,
    Bump,
    chebyshev_coefficients,
    chebyshev_nodes,
    pair_integrals,
    radial_transform,
)
from cspace.spectral._descriptors import BallDescriptor

PAIR_TABLE_NODES: Final = 64
"""Number of distances in a table for pairs of two radii."""

SELF_INTEGRAL_ERROR: Final = 1e-13
"""Relative error of the integral of the squared bump."""

MAX_PAIRS_PER_BLOCK: Final = 2**20
"""Number of pairs of balls whose distances are held in memory at once."""


def norm_square(balls: BallDescriptor) -> tuple[float, float]:
    """Return the integral of a descriptor's square, and a bound of its error."""
    # Each ball with itself once, and each pair of different balls twice.
    unit_ball = radial_transform(lambda s: balls.bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(unit_ball[0] * (balls.radii**balls.dim).sum())
    error = SAFETY_FACTOR * SELF_INTEGRAL_ERROR * value
    centers = balls.centers
    radii = balls.radii
    for i, j, distances in _find_close_pairs(centers, radii, centers, radii, 0.0):
        is_first = i < j  # each pair is listed in both orders
        first_radii = radii[i[is_first]]
        second_radii = radii[j[is_first]]
        values, errors = tabulated_integrals(
            balls.bump, first_radii, second_radii, distances[is_first], balls.dim
        )
        value += 2.0 * float(values.sum())
        error += 2.0 * float(errors.sum())
    summing_error = 2.0**-52 * (len(radii) + 2) * value
    return value, error + summing_error


def sum_pairs(
    bump: Bump,
    moved: Iterable[Floats],
    radii: Floats,
    fixed: tuple[Floats, Floats, Floats],
    slack: float,
) -> tuple[Floats, Floats]:
    """Sum the overlaps of pairs of balls at placements, with error bounds.

    ``moved`` yields the centers (k, d) of the moved balls at each of n placements, whose radii are
    ``radii``; ``fixed`` are the centers, radii and weights of the others. ``slack`` bounds the
    rounding of a distance, metres. The results have shape (n,).
    """
    centers, other_radii, weights = fixed
    pairs = [np.empty((5, 0))]  # placement, radius, other radius, distance and weight
    number = 0
    dim = centers.shape[1]
    for points in moved:
        for i, j, distances in _find_close_pairs(points, radii, centers, other_radii, slack):
            placement = np.full(len(i), number)
            pairs.append(np.stack([placement, radii[i], other_radii[j], distances, weights[j]]))
        number += 1
    placements, first, second, distances, factors = np.concatenate(pairs, axis=1)
    values, errors = tabulated_integrals(bump, first, second, distances, dim)
    # The common part of two balls changes by at most a cross-section of the smaller one times a
    # change of distance.
    cross_sections = {2: 2.0, 3: math.pi}[dim] * np.minimum(first, second) ** (dim - 1)
    errors += slack * cross_sections + 2.0**-40 * np.abs(values)
    rows = placements.astype(np.int64)
    totals = np.bincount(rows, factors * values, number)
    bounds = np.bincount(rows, np.abs(factors) * errors, number)
    return totals.astype(np.float64), bounds.astype(np.float64)


def tabulated_integrals(
    bump: Bump,
    first: Floats,
    second: Floats,
    distances: Floats,
    dim: int,
) -> tuple[Floats, Floats]:
    """Integrate products of two bumps, for many pairs, of which those of equal radii share a table.

    Arguments and results, shapes (n,), are those of :func:`cspace.spectral._bump.pair_integrals`.
    """
    values, errors = np.zeros((2, len(distances)))
    # Pairs of radii as complex numbers, which np.unique finds fast.
    radii = np.maximum(first, second) + 1j * np.minimum(first, second)
    keys, group, counts = np.unique(radii, return_inverse=True, return_counts=True)
    # The integrals of indicators are not smooth in the distance.
    is_tabulated = (counts > PAIR_TABLE_NODES) & (not bump.is_indicator)
    for number in np.flatnonzero(is_tabulated):
        large = float(keys[number].real)
        small = float(keys[number].imag)
        is_member = group == number
        fit, error = _tabulate_pair(bump, large, small, dim)
        shares = np.minimum(2.0 * distances[is_member] / (large + small), 2.0)
        values[is_member] = fit(shares - 1.0)
        errors[is_member] = error
    # Radii of few pairs are integrated pair by pair.
    is_rare = ~is_tabulated[group]
    if is_rare.any():
        values[is_rare], errors[is_rare] = pair_integrals(
            bump, first[is_rare], second[is_rare], distances[is_rare], dim
        )
    return values, errors


def _find_close_pairs(
    points: Floats, radii: Floats, others: Floats, other_radii: Floats, slack: float
) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Yield blocks of pairs of balls that may meet: two indices, and the distance of centers.

    ``points``, shape (n, d), and ``others``, shape (m, d), are the centers. Blocks bound the
    memory.
    """
    from scipy.spatial.distance import cdist

    blocks = math.ceil(len(radii) * len(other_radii) / MAX_PAIRS_PER_BLOCK)
    for block in np.array_split(np.arange(len(radii)), blocks):
        distances = cdist(points[block], others)
        reaches = np.add.outer(radii[block], other_radii) + slack
        rows, columns = np.nonzero(distances < reaches)
        yield block[rows], columns, distances[rows, columns]


@lru_cache(maxsize=4096)
def _tabulate_pair(
    bump: Bump, first: float, second: float, dim: int
) -> tuple[np.polynomial.Chebyshev, float]:
    """Fit the integral of two bumps as a function of the distance, with its error.

    Distances from 0 to the sum of the radii are mapped to [-1, 1].
    """
    # Fit at Chebyshev nodes, and measure the error halfway between them, where it is largest.
    nodes = chebyshev_nodes(PAIR_TABLE_NODES)
    midpoints = np.cos(math.pi * np.arange(PAIR_TABLE_NODES + 1) / PAIR_TABLE_NODES)
    distances = 0.5 * (first + second) * (1.0 + np.concatenate([nodes, midpoints]))
    radii = np.full_like(distances, first), np.full_like(distances, second)
    values, errors = pair_integrals(bump, *radii, distances, dim)
    at_nodes, at_midpoints = np.split(values, [PAIR_TABLE_NODES])
    fit = np.polynomial.Chebyshev(chebyshev_coefficients(at_nodes))
    largest_miss = float(np.abs(fit(midpoints) - at_midpoints).max())
    return fit, float(errors.max()) + SAFETY_FACTOR * largest_miss

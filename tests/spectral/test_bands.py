"""Bounds of overlaps summed ring by ring, and of the norm of ball sets."""

import math
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace.spectral import BallDescriptor, Bump
from cspace.spectral._bands import Rings, Spectrum, Terms
from cspace.spectral._pairs import norm_square
from tests.helpers.strategies import seeds

pytest.importorskip("finufft")


@settings(max_examples=10)
@given(st.sampled_from([2, 3]), seeds)
def test_bounds_include_the_full_errors_of_spectra(dim, seed):
    """Reduce every modulus by the full error of its spectrum."""
    rng = np.random.default_rng(seed)
    rings = Rings.of(rng.uniform(1.0, 1.5, dim), (4, 5, 3)[:dim])
    shape = 2, len(rings.indices)
    true_moduli = rng.uniform(1.0, 2.0, shape)
    phases = np.exp(2j * np.pi * rng.random(shape))
    spectra = [
        Spectrum((moduli - error) * phase, error)
        for moduli, phase, error in zip(true_moduli, phases, (0.3, 0.7), strict=True)
    ]
    tail = 1.5
    still, moved = (Terms.of(*spectra, rings, far, tail) for far in (0.0, 2.0))
    products = rings.twice * true_moduli.prod(axis=0) / np.prod(rings.lengths)
    ring_sums = rings.sums(products)
    summed_errors = np.cumsum(ring_sums - rings.sums(np.abs(still.products)))
    remaining = np.cumsum(ring_sums[::-1])[::-1]
    expected = np.append(0.0, summed_errors) + np.append(remaining, 0.0) + tail
    assert (still.bounds >= expected).all()
    assert still.bounds == pytest.approx(expected, rel=1e-6)
    turns = np.cumsum(rings.sums(2.0 * np.pi * 2.0 * rings.moduli * products))
    assert (moved.bounds - still.bounds >= np.append(0.0, turns) * (1.0 - 1e-12)).all()


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4])
def test_tail_bounds_the_energy_outside_the_band(accuracy):
    """Use few frequencies, and an inaccurate spectrum."""
    balls = BallDescriptor(np.random.default_rng(0).uniform(0.0, 1.0, (6, 2)), np.full(6, 0.1))
    rings = Rings.of(np.full(2, 3.0), (6, 6))
    norm, _ = norm_square(balls)
    norm_error = 0.125
    exact = Spectrum.of(balls, balls.center, rings)
    rough = Spectrum.of(balls, balls.center, rings, accuracy)
    weights = rings.twice / 9.0
    moduli = np.abs(rough.values)
    largest = norm - float((weights * np.maximum(moduli - rough.error, 0.0) ** 2).sum())
    outside = norm - float((weights * np.abs(exact.values) ** 2).sum())
    tail = rough.tail(rings, (norm, norm_error))
    assert outside + norm_error <= tail
    assert tail <= largest + norm_error + 4.0 * rough.error**2 * len(moduli)
    assert rough.error >= 1.9 * accuracy * np.abs(exact.values[0])
    far = BallDescriptor(balls.centers + 1e6, balls.radii)
    assert Spectrum.of(far, far.center, rings).error > 100.0 * exact.error


@settings(max_examples=15)
@given(
    seeds,
    st.sampled_from([2, 3]),
    st.sampled_from([0.03, 0.5, 2.0, 40.0, 300.0, math.inf]),
    st.integers(1, 14),
    st.sampled_from([1, 2, 14]),
)
def test_norm_square_sums_all_pairs_within_its_error(seed, dim, alpha, number, radius_count):
    """Draw balls of equal and of different radii; some coincide."""
    rng = np.random.default_rng(seed)
    bump = Bump(alpha)
    centers = rng.uniform(0.0, 0.6, (number, dim))
    centers[rng.random(number) < 0.2] = centers[0]
    radii = rng.choice(rng.uniform(0.1, 0.5, radius_count), number)
    with patch("cspace.spectral._pairs.MAX_PAIRS_PER_BLOCK", int(rng.choice([20, 2**20]))):
        value, error = norm_square(BallDescriptor(centers, radii, bump))
    distances = np.linalg.norm(centers[:, None] - centers, axis=2)
    expected = sum(
        bump.pair_integral(radii[i], radii[j], distances[i, j], dim)
        for i, j in np.ndindex(number, number)
    )
    assert abs(value - expected) <= error + 1e-8 * expected
    assert error <= 0.02 * expected

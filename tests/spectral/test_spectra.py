"""Spectra of balls and of sampled descriptors, against direct sums."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import Grid, InputError
from cspace.spectral import BallDescriptor, Bump, ball_spectrum
from cspace.spectral.spectra import radius_basis
from tests.helpers.missing import output_without
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds

pytest.importorskip("finufft")

BUMPS = [Bump(2.0), Bump(math.inf)]


def sum_directly(centers, radii, bump, frequencies):
    """Sum over the balls, term by term."""
    dim = centers.shape[1]
    moduli = np.linalg.norm(frequencies, axis=1)
    sizes, which = np.unique(radii, return_inverse=True)
    table = bump.table(dim, float(moduli.max() * sizes.max()), 1e-13)
    radial = (sizes**dim * table(moduli[:, None] * sizes))[:, which]
    return (radial * np.exp(-2j * math.pi * (frequencies @ centers.T))).sum(axis=1)


def draw_scene(dim, number, classes, seed=0, size=1.0):
    rng = np.random.default_rng(seed)
    radii = rng.uniform(0.02, 0.3, classes)[rng.integers(0, classes, number)] * size
    return rng.uniform(-size, size, (number, dim)) + rng.uniform(-9, 9, dim), radii


def draw_lattice(lengths, counts, number=50, seed=1):
    """Draw positions in a spectrum, and their frequencies."""
    rng = np.random.default_rng(seed)
    positions = np.concatenate(
        [
            rng.integers(0, counts, (number, len(counts))),
            list(itertools.product(*((0, m // 2, (m - 1) // 2, m - 1) for m in counts))),
        ]
    )
    k = np.stack(
        [np.fft.fftfreq(m, 1.0 / m)[positions[:, a]] for a, m in enumerate(counts)], axis=1
    )
    return tuple(positions.T), k / lengths


@pytest.mark.parametrize("bump", BUMPS, ids=str)
@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
@pytest.mark.parametrize(("number", "classes"), [(30, 2), (700, 3), (110, 110)])
@pytest.mark.parametrize(
    ("counts", "lengths"), [((64, 45), (2.7, 4.1)), ((24, 17, 20), (2.9, 3.0, 2.7))]
)
def test_ball_spectrum_agrees_with_the_direct_sum(
    bump, tolerance, number, classes, counts, lengths
):
    centers, radii = draw_scene(len(counts), number, classes)
    spectrum = ball_spectrum(centers, radii, bump, lengths, counts, tolerance)
    assert spectrum.shape == counts
    position, frequencies = draw_lattice(lengths, counts)
    expected = sum_directly(centers, radii, bump, frequencies)
    whole = float(bump.radial_spectrum(0.0, len(counts)) * (radii ** len(counts)).sum())
    assert np.abs(spectrum[position] - expected).max() <= tolerance * whole
    assert spectrum[(0,) * len(counts)] == pytest.approx(whole, rel=tolerance)


@pytest.mark.parametrize("bump", BUMPS, ids=str)
@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
@pytest.mark.parametrize(
    ("counts", "lengths"), [((40, 33), (2.7, 4.1)), ((14, 17, 10), (2.9, 3.0, 2.7))]
)
def test_radius_basis_replaces_a_thousand_radii(bump, tolerance, counts, lengths):
    centers, radii = draw_scene(len(counts), 1000, 100_000)
    position, frequencies = draw_lattice(lengths, counts, number=5)
    largest = float(np.linalg.norm(np.divide(counts, lengths) / 2.0))
    moduli = np.linspace(0.0, largest, 9)
    basis = radius_basis(
        bump, radii, moduli, len(counts), tolerance, max_terms={2: 30, 3: 15}[len(counts)]
    )
    assert basis is not None and len(list(basis)) < 30
    spectrum = ball_spectrum(centers, radii, bump, lengths, counts, tolerance)
    expected = sum_directly(centers, radii, bump, frequencies)
    whole = spectrum[(0,) * len(counts)].real
    assert np.abs(spectrum[position] - expected).max() <= tolerance * whole
    assert radius_basis(bump, radii, moduli, len(counts), tolerance, max_terms=2) is None


@settings(max_examples=25)
@given(st.sampled_from([2, 3]), seeds)
def test_spectra_are_hermitian_additive_and_shift_by_phases(dim, seed):
    rng = np.random.default_rng(seed)
    centers, radii = draw_scene(dim, int(rng.integers(1, 120)), int(rng.integers(1, 4)), seed)
    counts, lengths, bump = (
        tuple(rng.integers(3, 20, dim).tolist()),
        rng.uniform(2.7, 5.0, dim),
        Bump(2.0),
    )
    spectrum = ball_spectrum(centers, radii, bump, lengths, counts)
    size = 1e-8 * spectrum.flat[0].real
    # The spectrum of a real function is Hermitian; the Nyquist frequency of an even count has no
    # partner.
    position = np.ix_(*(np.setdiff1d(np.arange(m), [m // 2] if m % 2 == 0 else []) for m in counts))
    partner = np.ix_(
        *(-np.setdiff1d(np.arange(m), [m // 2] if m % 2 == 0 else []) % m for m in counts)
    )
    np.testing.assert_allclose(spectrum[position], spectrum[partner].conj(), atol=size)
    # A translation multiplies by a phase, which is 1 for a whole period.
    shift = rng.uniform(-3, 3, dim)
    axes = [np.fft.fftfreq(m, 1.0 / m) / length for m, length in zip(counts, lengths, strict=True)]
    phase = np.exp(
        -2j
        * math.pi
        * sum(np.meshgrid(*(a * s for a, s in zip(axes, shift, strict=True)), indexing="ij"))
    )
    np.testing.assert_allclose(
        ball_spectrum(centers + shift, radii, bump, lengths, counts), spectrum * phase, atol=size
    )
    np.testing.assert_allclose(
        ball_spectrum(centers + 5 * lengths, radii, bump, lengths, counts), spectrum, atol=size
    )
    # Balls add up.
    half = len(centers) // 2
    if half:
        parts = [
            ball_spectrum(centers[s], radii[s], bump, lengths, counts)
            for s in (slice(half), slice(half, None))
        ]
        np.testing.assert_allclose(sum(parts), spectrum, atol=size)


@pytest.mark.parametrize("dim", [2, 3])
def test_ball_spectrum_is_the_fourier_series_of_the_descriptor(dim):
    centers, radii = draw_scene(dim, 12, 12, seed=5)
    balls = BallDescriptor(centers, radii + 0.45)
    counts, length = (96,) * dim, 3.6
    spectrum = ball_spectrum(centers, balls.radii, balls.bump, length, counts, 1e-10)
    lower = (centers.min(axis=0) + centers.max(axis=0)) / 2 - length / 2
    grid = Grid(lower, length / 96, counts)
    # Its inverse, shifted to the cell centers, equals the samples except for the frequencies above
    # the band.
    shift = np.array(grid.center_of([0] * dim))
    axes = [np.fft.fftfreq(96, 1.0 / 96) / length] * dim
    phase = np.exp(
        2j
        * math.pi
        * sum(np.meshgrid(*(a * s for a, s in zip(axes, shift, strict=True)), indexing="ij"))
    )
    back = np.fft.ifftn(spectrum * phase).real * 96**dim / length**dim
    assert np.abs(back - balls.sample(grid).values).max() < 5e-3


POINTS = np.zeros((2, 2))


@refusals(
    "arguments, match",
    ((POINTS, 0.0, Bump(), 1.0, 4), "above zero"),
    ((POINTS, math.nan, Bump(), 1.0, 4), "must be finite"),
    ((POINTS, [0.1, 0.1, 0.1], Bump(), 1.0, 4), "radii has shape"),
    ((np.zeros((2, 4)), 0.1, Bump(), 1.0, 4), "centers has shape"),
    ((POINTS, 0.1, 2.0, 1.0, 4), "must be a Bump"),
    ((POINTS, 0.1, Bump(), 0.0, 4), "lengths"),
    ((POINTS, 0.1, Bump(), (1.0, 1.0, 1.0), 4), "lengths"),
    ((POINTS, 0.1, Bump(), math.inf, 4), "lengths"),
    ((POINTS, 0.1, Bump(), 1.0, 0), "counts"),
    ((POINTS, 0.1, Bump(), 1.0, 4.0), "counts"),
    ((POINTS, 0.1, Bump(), 1.0, (4, 4, 4)), "counts"),
    ((POINTS, 0.1, Bump(), 1.0, 10**9), "smaller counts"),
    ((POINTS, 0.1, Bump(), 1.0, 4, 1e-14), "tolerance"),
    ((POINTS, 0.1, Bump(), 1.0, 4, 0.2), "tolerance"),
    ((POINTS, 0.6, Bump(), 1.0, 4), "fit into one period"),
    (([[0.0, 0.0], [0.0, 0.9]], 0.1, Bump(), 1.0, 4), "along y"),
)
def test_ball_spectrum_refuses_invalid_arguments(arguments, match):
    with pytest.raises(InputError, match=match):
        ball_spectrum(*arguments)


def test_ball_spectrum_accepts_balls_that_fill_a_period():
    assert ball_spectrum([[7.0, 0.1], [7.8, 0.1]], 0.1, Bump(), (1.0, 0.2), 4).shape == (4, 4)


def test_missing_finufft_refuses_only_transforms():
    output = output_without(
        "finufft",
        """
from cspace.spectral import Bump, ball_spectrum

assert ball_spectrum([[0.0, 0.0]], 0.2, Bump(), 1.0, 8).shape == (8, 8)
try:
    ball_spectrum(np.random.default_rng(0).random((500, 2)), 0.2, Bump(), 2.0, 8)
except cspace.MissingPackageError as error:
    print(error)
""",
    )
    assert 'pip install "cspace[spectral]"' in output


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("number", [5, 120])
def test_weights_multiply_the_bumps(dim: int, number: int) -> None:
    rng = np.random.default_rng(number)
    centers, radii = rng.uniform(0.0, 1.0, (number, dim)), rng.choice([0.1, 0.2], number)
    weights = rng.normal(size=number)
    found = ball_spectrum(centers, radii, Bump(), 2.0, 9, weights=weights)
    expected = sum(
        weight * ball_spectrum(center[None], radius, Bump(), 2.0, 9, 1e-12)
        for weight, center, radius in zip(weights, centers, radii, strict=True)
    )
    scale = ball_spectrum(centers, radii, Bump(), 2.0, 9).flat[0].real
    assert np.abs(found - expected).max() <= 1e-9 * scale * np.abs(weights).max()
    with pytest.raises(InputError, match="one for each of"):
        ball_spectrum(centers, radii, Bump(), 2.0, 9, weights=weights[1:])

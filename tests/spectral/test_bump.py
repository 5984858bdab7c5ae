"""Bumps and their radial spectra, against plain quadrature."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.special import j0, j1

from cspace.spectral import Bump
from cspace.spectral._bump import radial_table
from tests.helpers.strategies import examples

dims = st.sampled_from([2, 3])
alphas = st.sampled_from([0.01, 0.3, 1.0, 2.0, 10.0, 300.0, 1e4, math.inf])


def evaluate_plainly(s, alpha):
    """Evaluate the definition of a bump at one distance."""
    if s >= 1.0:
        return 0.0
    if s == 0.0 or alpha == math.inf:
        return 1.0
    try:
        return math.exp(1.0 / (1.0 - float(s) ** -alpha))
    except OverflowError:
        return 1.0
    except ZeroDivisionError:
        return 0.0


def gauss_rule(borders):
    """Return the nodes and weights of Gauss and Legendre between successive borders."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    starts = borders[:-1, None]
    widths = np.diff(borders)[:, None]
    return (starts + widths * (0.5 + 0.5 * nodes)).ravel(), (0.5 * widths * weights).ravel()


@given(alphas, st.lists(st.floats(0.0, 1.2), min_size=1))
@example(2.0, [0.0, 1e-300, 1e-9, 1.0 - 1e-3, 1.0, 1.0 + 1e-9, 1e300])
def test_profile_agrees_with_the_definition(alpha, distances):
    expected = [evaluate_plainly(s, alpha) for s in distances]
    values = Bump(alpha).profile(distances)
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-300)
    np.testing.assert_array_equal(Bump(alpha).profile(np.negative(distances)), values)
    assert Bump(alpha).profile(distances[0]).shape == ()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [0.01, 0.5, 2.0, 30.0, 1e4, math.inf])
def test_radial_spectrum_agrees_with_a_dense_quadrature(alpha, dim):
    near_ends = [0.5 ** np.arange(60.0), 1.0 - 0.5 ** np.arange(1.0, 40.0)]
    s, weights = gauss_rule(np.unique(np.concatenate([*near_ends, np.linspace(0.0, 1.0, 1500)])))
    profile = np.array([evaluate_plainly(each, alpha) for each in s.tolist()])
    k = np.array([0.0, 1e-9, 1e-3, 0.0795, 0.37, 1.0, 4.6, 33.3, 150.3, 500.0])
    phases = np.outer(k, s)
    if dim == 2:
        kernel = 2.0 * math.pi * s * j0(2.0 * math.pi * phases)
    else:
        kernel = 4.0 * math.pi * s**2 * np.sinc(2.0 * phases)
    expected = kernel @ (profile * weights)
    spectrum = Bump(alpha).radial_spectrum(k, dim)
    assert np.abs(spectrum - expected).max() <= 1e-12 * expected[0]


def test_radial_spectrum_of_the_ball_is_accurate_at_high_frequencies():
    k = np.append(2.0 ** np.arange(6, 17), 1e5)
    angles = 2.0 * math.pi * k
    disc, ball = (Bump(math.inf).radial_spectrum(k, dim) for dim in (2, 3))
    assert np.abs(disc - j1(angles) / k).max() <= 1e-13 * math.pi
    expected = (np.sin(angles) - angles * np.cos(angles)) / (2.0 * math.pi**2 * k**3)
    assert np.abs(ball - expected).max() <= 1e-13 * math.pi


@examples(10)
@given(alphas, dims, st.floats(0.0, 90.0))
def test_table_interpolates_the_spectrum(alpha, dim, highest):
    bump = Bump(alpha)
    borders = np.arange(0.0, highest, 0.5)
    k = np.concatenate([np.linspace(0.0, highest, 200), borders]).reshape(1, -1)
    table = radial_table(bump, dim, 1 + int(highest))
    whole = bump.radial_spectrum(0.0, dim)
    assert np.abs(table(k) - bump.radial_spectrum(k, dim)).max() <= 2e-13 * whole


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [0.5, 2.0, 30.0, math.inf])
def test_energy_is_the_integral_of_the_square(alpha, dim):
    s, weights = gauss_rule(np.linspace(0.0, 1.0, 2000))
    square = np.array([evaluate_plainly(each, alpha) for each in s.tolist()]) ** 2
    sphere = 2.0 * math.pi * s if dim == 2 else 4.0 * math.pi * s**2
    assert Bump(alpha).energy(dim) == pytest.approx((square * sphere) @ weights, rel=1e-9)

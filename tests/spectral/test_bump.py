"""Bumps, their radial spectra and the integrals of pairs, against plain quadrature."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import integrate
from scipy.special import j0

from cspace import InputError
from cspace.spectral import Bump
from tests.helpers.refusals import refusals

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


@settings(max_examples=10)
@given(alphas, dims, st.floats(0.0, 90.0), st.sampled_from([1e-3, 1e-6, 1e-12]))
def test_table_interpolates_the_spectrum(alpha, dim, highest, tolerance):
    bump = Bump(alpha)
    borders = np.arange(0.0, highest, 0.5)
    k = np.concatenate([np.linspace(0.0, highest, 200), borders]).reshape(1, -1)
    table = bump.table(dim, highest, tolerance)
    whole = bump.radial_spectrum(0.0, dim)
    assert np.abs(table(k) - bump.radial_spectrum(k, dim)).max() <= tolerance * whole
    with pytest.raises(InputError, match="make a larger table"):
        table(np.array([highest + 2.0]))


def integrate_cap(radius, height, dim):
    """Integrate the slices of a cap of a ball by their depth."""

    def slice_measure(depth):
        square = depth * (2.0 * radius - depth)
        return math.pi * square if dim == 3 else 2.0 * math.sqrt(square)

    return integrate.quad(slice_measure, 0.0, height, epsabs=0.0, epsrel=1e-11)[0]


@given(dims, st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(1e-3, 0.99))
def test_pair_integral_of_indicators_is_the_lens(dim, a, b, share):
    bump = Bump(math.inf)
    distance = a + b - 2.0 * share * min(a, b)
    center = (distance**2 + a**2 - b**2) / (2.0 * distance)
    lens = integrate_cap(a, a - center, dim) + integrate_cap(b, b - (distance - center), dim)
    assert bump.pair_integral(a, b, distance, dim) == pytest.approx(lens, rel=1e-7)
    assert bump.pair_integral(a, b, a + b, dim) == 0.0


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9])
def test_thin_lenses_keep_their_relative_accuracy(depth):
    """Compare with two parabolic caps, the leading order in the depth."""
    bump = Bump(math.inf)
    area = bump.pair_integral(1.0, 1.0, 2.0 - depth, 2)
    assert area == pytest.approx(4.0 / 3.0 * depth**1.5, rel=depth + 1e-6)
    volume = bump.pair_integral(1.0, 1.0, 2.0 - depth, 3)
    assert volume == pytest.approx(math.pi / 2.0 * depth**2, rel=depth + 1e-6)


@settings(max_examples=25)
@given(dims, st.floats(0.3, 3.0), st.floats(0.3, 3.0), st.floats(0.02, 1.0))
def test_pair_integral_of_bumps_is_the_integral_of_their_product(dim, a, b, share):
    """Integrate over half the plane of the distances along and from the common axis."""
    distance = (1.0 - share) * (a + b)
    x_borders = np.linspace(max(-a, distance - b), min(a, distance + b), 24)
    y_borders = np.linspace(0.0, min(a, b), 12)
    x, x_weights = gauss_rule(x_borders)
    y, y_weights = gauss_rule(y_borders)
    first = ((x[:, None] ** 2 + y**2) / a**2).clip(1e-30, 1.0 - 1e-12)
    second = (((x[:, None] - distance) ** 2 + y**2) / b**2).clip(1e-30, 1.0 - 1e-12)
    product = np.exp(first / (first - 1.0) + second / (second - 1.0))
    circle = 2.0 * math.pi * y if dim == 3 else 2.0
    expected = x_weights @ product @ (y_weights * circle)
    integral = Bump(2.0).pair_integral(a, b, distance, dim)
    assert integral == pytest.approx(expected, rel=1e-6, abs=1e-12)


@refusals(
    "make, arguments, message",
    (Bump, (0.0,), "alpha is 0.0"),
    (Bump().profile, (-1.0,), "none may be below zero"),
    (Bump().radial_spectrum, (2e5, 2), "units"),
    (Bump().table, (2, math.nan), "max_frequency"),
)
def test_bump_refuses_invalid_arguments(make, arguments, message):
    with pytest.raises(InputError, match=message):
        make(*arguments)

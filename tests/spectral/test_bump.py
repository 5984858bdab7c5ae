"""Bump values, radial spectra and pair integrals, against adaptive quadrature."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate
from scipy.special import j0

from cspace import Grid, InputError
from cspace.spectral import BallDescriptor, Bump, intersection
from tests.helpers.refusals import refusals

ALPHAS = [0.01, 0.1, 0.5, 1.0, 2.0, 3.7, 10.0, 100.0, 1e4, math.inf]
SMOOTH = [2.0, 8.0]


def evaluate_plainly(s, alpha):
    """Evaluate the definition in plain Python."""
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


def integrate_reference(alpha, dim, k):
    """Compute the transform by adaptive quadrature.

    Integrate over log(s) near the cusp of the bump.
    """
    kernel = j0 if dim == 2 else lambda x: np.sinc(x / math.pi)
    surface = 2.0 * math.pi if dim == 2 else 4.0 * math.pi

    def in_log(u):
        s = math.exp(-u)
        return s**dim * evaluate_plainly(s, alpha) * kernel(2.0 * math.pi * k * s)

    def direct(s):
        return s ** (dim - 1) * evaluate_plainly(s, alpha) * kernel(2.0 * math.pi * k * s)

    steps = np.linspace(0.1, 1.0, 2 + math.ceil(2.0 * k))
    if 1.0 < alpha < math.inf:
        steps = np.unique(np.concatenate([steps, 1.0 - 0.5 ** np.arange(1, 20)]))
    options = {"epsabs": 1e-16, "epsrel": 1e-13, "limit": 200}
    outer = sum(integrate.quad(direct, a, b, **options)[0] for a, b in itertools.pairwise(steps))
    boundaries = np.linspace(-math.log(0.1), 60.0, 40)
    inner = sum(
        integrate.quad(in_log, a, b, **options)[0] for a, b in itertools.pairwise(boundaries)
    )
    return surface * (inner + outer)


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [0.01, 0.5, 2.0, 10.0, 1e4, math.inf])
def test_radial_spectrum_agrees_with_adaptive_quadrature(alpha, dim):
    bump = Bump(alpha)
    k = np.array([0.0, 1e-9, 1e-3, 0.0795, 0.0797, 0.37, 1.0, 4.6, 33.3])
    expected = np.array([integrate_reference(alpha, dim, each) for each in k])
    assert np.abs(bump.radial_spectrum(k, dim) - expected).max() <= 1e-12 * expected[0]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", [0.3, 2.0, 30.0])
def test_radial_spectrum_agrees_with_oscillatory_quadrature_at_high_frequencies(alpha, dim):
    k = np.array([150.3, 500.0, 2000.7])
    if dim == 3:
        options = {"epsabs": 1e-15, "limit": 2000, "weight": "sin"}
        expected = []
        for each in k:
            pieces = np.concatenate(
                [[0.0], 0.5 ** np.arange(24.0, 0.0, -1.0), 1.0 - 0.5 ** np.arange(2.0, 12.0), [1.0]]
            )
            parts = [
                integrate.quad(
                    lambda s: s * evaluate_plainly(s, alpha),
                    a,
                    b,
                    wvar=2.0 * math.pi * each,
                    **options,
                )[0]
                for a, b in itertools.pairwise(pieces)
            ]
            expected.append(2.0 / each * sum(parts))
    else:
        # Use many more nodes than the rule under test.
        nodes, weights = np.polynomial.legendre.leggauss(20)
        boundaries = np.unique(
            np.concatenate(
                [0.5 ** np.arange(60.0), 1.0 - 0.5 ** np.arange(1.0, 30.0), np.linspace(0, 1, 1500)]
            )
        )
        s = (boundaries[:-1, None] + np.diff(boundaries)[:, None] * (0.5 + 0.5 * nodes)).ravel()
        w = (np.diff(boundaries)[:, None] * 0.5 * weights).ravel()
        values = np.array([evaluate_plainly(each, alpha) for each in s]) * s * w
        expected = [2.0 * math.pi * float(values @ j0(2.0 * math.pi * each * s)) for each in k]
    spectrum = Bump(alpha).radial_spectrum(k, dim)
    assert np.abs(spectrum - expected).max() <= 1e-12 * Bump(alpha).radial_spectrum(0.0, dim)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("alpha", "most"), [(0.2, 60.0), (40.0, 200.0), (math.inf, 60.0)])
def test_table_interpolates_the_spectrum(alpha, most, dim):
    """Test all intervals of tables, including one computed in parts."""
    bump = Bump(alpha)
    k = np.concatenate(
        [np.random.default_rng(0).uniform(0.0, most, 500), np.arange(0.0, most + 0.5, 0.5), [most]]
    )
    exact = bump.radial_spectrum(k, dim)
    for tolerance in (1e-6, 1e-12):
        table = bump.table(dim, most, tolerance)
        assert np.abs(table(k) - exact).max() <= tolerance * bump.radial_spectrum(0.0, dim)
    assert table(k[:500].reshape(2, -1)).shape == (2, 250)
    with pytest.raises(InputError, match="make a larger table"):
        table(np.array([most + 2.0]))


@pytest.mark.parametrize("alpha", ALPHAS)
def test_profile_agrees_with_the_definition(alpha):
    s = np.array(
        [0.0, 1e-300, 1e-9, 0.1, 0.3, 0.5, 0.77, 0.9, 1.0 - 1e-3, 1.0, 1.0 + 1e-9, 3.0, 1e300]
    )
    expected = np.array([evaluate_plainly(each, alpha) for each in s])
    values = Bump(alpha).profile(s)
    np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-300)
    assert values.shape == s.shape and Bump(alpha).profile(0.5).shape == ()
    assert values[0] == 1.0 and not values[-4:].any()


@given(st.floats(0.01, 1e4), st.floats(0.0, 1.2), st.floats(0.0, 1.2))
def test_profile_decreases_with_distance_and_increases_with_alpha(alpha, first, second):
    near, far = sorted([first, second])
    bump = Bump(alpha)
    assert bump.profile(near) >= bump.profile(far)
    assert Bump(min(1e4, 2.0 * alpha)).profile(near) >= bump.profile(near)
    assert Bump(math.inf).profile(near) >= bump.profile(near)


@pytest.mark.parametrize("dim", [2, 3])
def test_spectrum_converges_to_the_indicator_for_large_alpha(dim):
    k = np.linspace(0.0, 5.0, 50)
    exact = Bump(math.inf).radial_spectrum(k, dim)
    errors = [
        np.abs(Bump(alpha).radial_spectrum(k, dim) - exact).max() for alpha in (10.0, 100.0, 1000.0)
    ]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]


def integrate_lens(a, b, distance, dim):
    """Integrate slices by the depth of each cap.

    This avoids cancellation.
    """
    center = (distance**2 + a**2 - b**2) / (2.0 * distance)
    total = 0.0
    for radius, height in ((a, a - center), (b, b - (distance - center))):
        slices = {
            2: lambda t, r=radius: 2.0 * math.sqrt(t * (2.0 * r - t)),
            3: lambda t, r=radius: math.pi * t * (2.0 * r - t),
        }
        total += integrate.quad(slices[dim], 0.0, height, epsabs=0.0, epsrel=1e-11)[0]
    return total


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.3, 1.1), (2.0, 0.7)])
def test_indicator_pairs_agree_with_the_lens(a, b, dim):
    bump = Bump(math.inf)
    for share in (1e-3, 0.01, 0.3, 0.8, 0.99):
        distance = abs(a - b) + (1.0 - share) * (a + b - abs(a - b))
        integral = bump.pair_integral(a, b, distance, dim)
        assert integral == pytest.approx(integrate_lens(a, b, distance, dim), rel=1e-9)
    whole = bump.radial_spectrum(0.0, dim) * min(a, b) ** dim
    assert bump.pair_integral(a, b, abs(a - b), dim) == pytest.approx(float(whole), rel=1e-12)
    assert bump.pair_integral(a, b, a + b, dim) == 0.0


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9])
def test_thin_lenses_keep_their_relative_accuracy(depth):
    # To leading order in the depth, the lens of two unit balls consists of two parabolic caps.
    bump = Bump(math.inf)
    assert bump.pair_integral(1.0, 1.0, 2.0 - depth, 2) == pytest.approx(
        4.0 / 3.0 * depth**1.5, rel=depth + 1e-6
    )
    assert bump.pair_integral(1.0, 1.0, 2.0 - depth, 3) == pytest.approx(
        math.pi / 2.0 * depth**2, rel=depth + 1e-6
    )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("alpha", SMOOTH)
@pytest.mark.parametrize(("a", "b"), [(0.4, 1.1)])
def test_pair_integral_agrees_with_the_inverse_transform(alpha, a, b, dim):
    bump = Bump(alpha)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    boundaries = np.linspace(0.0, 40.0 / a, math.ceil(120 / a))
    k = (boundaries[:-1, None] + np.diff(boundaries)[:, None] * (0.5 + 0.5 * nodes)).ravel()
    w = (0.5 * np.diff(boundaries)[:, None] * weights).ravel()
    spectrum = (
        (a * b) ** dim * bump.table(dim, 41.0, 1e-13)(a * k) * bump.table(dim, 111.0, 1e-13)(b * k)
    )
    size = bump.pair_integral(a, b, 0.0, dim)
    for distance in (0.0, 0.05, 0.4, b - a, 0.9, 0.97 * (a + b)):
        wave = j0(2.0 * math.pi * k * distance) * 2.0 * math.pi * k
        if dim == 3:
            wave = np.sinc(2.0 * k * distance) * 4.0 * math.pi * k * k
        assert bump.pair_integral(a, b, distance, dim) == pytest.approx(
            float((spectrum * wave) @ w), abs=1e-8 * size
        )


@pytest.mark.parametrize("depth", [0.5, 0.1, 0.03])
def test_barely_overlapping_pairs_keep_their_relative_accuracy(depth):
    a, b, distance = 0.6, 1.0, 1.6 - depth

    def product(y, x):
        s, t = math.hypot(x, y) / a, math.hypot(x - distance, y) / b
        return evaluate_plainly(s, 2.0) * evaluate_plainly(t, 2.0) * scale

    scale = 1.0 / Bump().pair_integral(a, b, distance, 2)
    x, height = np.linspace(distance - b, a, 9), math.sqrt(2.0 * depth)
    y = np.linspace(-height, height, 9)
    total = sum(
        integrate.dblquad(product, x0, x1, y0, y1, epsabs=1e-9, epsrel=1e-7)[0]
        for x0, x1 in itertools.pairwise(x)
        for y0, y1 in itertools.pairwise(y)
    )
    assert total == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("alpha", [0.3, 2.0, 20.0, math.inf])
@pytest.mark.parametrize("dim", [2, 3])
def test_pair_integral_decreases_with_distance_and_is_symmetric(alpha, dim):
    bump = Bump(alpha)
    distances = np.linspace(0.0, 1.75, 15)
    integrals = np.array([bump.pair_integral(0.5, 1.2, each, dim) for each in distances])
    assert (np.diff(integrals) <= 1e-9 * integrals[:-1]).all() and integrals[-1] == 0.0
    assert bump.pair_integral(1.2, 0.5, 1.1, dim) == pytest.approx(
        bump.pair_integral(0.5, 1.2, 1.1, dim), rel=1e-9
    )
    assert bump.pair_integral(5.0, 12.0, 11.0, dim) == pytest.approx(
        10.0**dim * bump.pair_integral(0.5, 1.2, 1.1, dim), rel=1e-9
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_pair_integral_is_the_integral_of_the_product_of_descriptors(dim):
    grid = Grid((-1.3,) * dim, 0.02, (150,) * dim)
    centers = np.array([[0.1, 0.05, 0.0], [0.75, 0.3, -0.2]])[:, :dim]
    first, second = BallDescriptor(centers[:1], 1.0), BallDescriptor(centers[1:], 0.6)
    product = intersection(first.sample(grid), second.sample(grid))
    distance = float(np.linalg.norm(centers[1] - centers[0]))
    assert product.integral == pytest.approx(
        Bump().pair_integral(1.0, 0.6, distance, dim), rel=1e-5
    )


FREQUENCIES = [
    ((-1.0, 2), "below zero|zero or above"),
    ((math.nan, 2), "frequency"),
    ((math.inf, 3), "frequency"),
    ((2e5, 2), "units"),
    ((1.0, 1), "dim is 1"),
    ((1.0, 4), "dim is 4"),
    ((1.0, True), "dim is True"),
]


@refusals(
    "make, arguments, message",
    *[
        (Bump, (alpha,), "alpha")
        for alpha in (0.0, -1.0, math.nan, -math.inf, 1e-3, 1e5, "two", None, [1.0, 2.0])
    ],
    (Bump, (np.ma.masked,), "alpha"),
    *[(Bump().radial_spectrum, arguments, message) for arguments, message in FREQUENCIES],
    *[
        (lambda k, dim: Bump().table(dim, k), arguments, message)
        for arguments, message in FREQUENCIES
    ],
    *[
        (Bump().table, (2, 1.0, tolerance), "tolerance")
        for tolerance in (0.0, 1e-15, 0.5, math.nan, [1e-6])
    ],
    (Bump().pair_integral, (0.0, 1.0, 1.0, 2), "first"),
    (Bump().pair_integral, (1.0, -1.0, 1.0, 2), "second"),
    *[
        (Bump().pair_integral, (1.0, 1.0, distance, 2), "distance")
        for distance in (-1.0, [1.0], math.nan)
    ],
    (Bump().pair_integral, (1.0, 1.0, 1.0, 5), "dim"),
)
def test_bump_refuses_invalid_arguments(make, arguments, message):
    with pytest.raises(InputError, match=message):
        make(*arguments)

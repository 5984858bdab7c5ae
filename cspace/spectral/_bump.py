"""The bump of ball descriptors, its Fourier transform, and integrals of products of two bumps.

The bump is a radial function. All integrals are trapezoidal sums in u with ``s = 1 / (1 + exp(-pi
sinh(u)))`` (H. Takahasi and M. Mori, "Double exponential formulas for numerical integration",
1974). They converge geometrically if the function is smooth inside an interval, even if it has a
singularity at an end: the cusp of a bump at 0, a steep flank next to 1, or a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._support.arrays import Floats
from cspace._support.check import (
    check_finite,
    check_not_negative,
    check_positive,
    check_unmasked,
    check_word,
)
from cspace.errors import CspaceError, InputError

Radial = Callable[[Floats], Floats]
"""Function of the distance from the center, in radii."""

MIN_TOLERANCE: Final = 1e-13
"""Smallest tolerance of a table, relative to the largest value, because of rounding."""

UNIT_BALL_VOLUME: Final = {2: math.pi, 3: 4.0 / 3.0 * math.pi}
"""Area of the unit disc and volume of the unit ball, by dimension."""

ALPHA_RANGE: Final = (0.01, 1e4)
"""Smallest and largest finite exponent of a bump."""

MAX_RADIAL_FREQUENCY: Final = 1e5
"""Largest frequency of a spectrum, cycles per radius; up to it, rounded phases are accurate to
1e-10 radians."""

PAIR_TOLERANCE: Final = 1e-9
"""Relative error of the integral of the product of two bumps."""

PAIR_FLOOR: Final = 1e-60
"""Absolute error of such an integral, relative to ``radius^dim`` of the smaller ball: the radii
round as much."""

BATCH_RULE_SIZES: Final = (26, 32)
"""Node counts of two quadrature rules; their difference bounds the error of the finer rule."""

SAFETY_FACTOR: Final = 4.0
"""Factor by which measured errors are enlarged before proofs use them."""

MAX_ABSCISSA: Final = 3.3
"""Largest modulus of u in a sum; nodes beyond it lie within 1e-18 of the ends of the interval."""

MIN_TRANSFORM_NODES: Final = 160
"""Nodes on either side of u = 0 for frequency 0; two thirds leave errors of 1e-14 for all alpha."""

TABLE_HALF_WIDTH: Final = 0.5
"""Half the width of a table interval, cycles per radius."""


@dataclass(frozen=True, slots=True)
class Bump:
    """Radial function that is positive in a ball.

    It is ``psi(x) = exp(1 / (1 - |x|^-alpha))`` for ``0 < |x| < 1``, 1 at 0, and 0 from ``|x| = 1``
    on. In float64 it underflows in a layer at the boundary, at most ``1 / (745 alpha)`` of the
    radius thick. It is smooth except at the center, where it is as smooth as ``|x|^alpha``. A ball
    of radius r around p has the descriptor ``psi((x - p) / r)`` (Lysenko, 2013; Behandish and
    Ilies, 2016).

    Parameters
    ----------
    alpha : float
        From 0.01 (a needle) to 1e4 (nearly flat), or ``inf``: the indicator of the open ball.

    Raises InputError if ``alpha`` is none of these.
    """

    alpha: float = 2.0

    def __post_init__(self) -> None:
        """Check the exponent."""
        check_unmasked(self.alpha, "alpha")
        try:
            alpha = float(self.alpha)
        except (TypeError, ValueError):
            alpha = math.nan
        low, high = ALPHA_RANGE
        if not (low <= alpha <= high or alpha == math.inf):
            raise InputError(
                "alpha",
                f"is {self.alpha!r}",
                f"it must be one number from {low:g} to {high:g}, or infinite",
                "pass e.g. 2.0, or math.inf",
            )
        object.__setattr__(self, "alpha", alpha)

    @property
    def is_indicator(self) -> bool:
        """Whether the bump is 1 in the whole open ball."""
        return self.alpha == math.inf

    def profile(self, distance: ArrayLike) -> Floats:
        """Evaluate the bump at distances, in radii, zero or above."""
        distances = check_finite(distance, "distance")
        if (distances < 0.0).any():
            raise InputError(
                "distance",
                f"holds {distances.min():g}",
                "none may be below zero",
                "pass the modulus",
            )
        return self.values(distances)

    def values(self, distance: Floats) -> Floats:
        """Evaluate the bump at an array of distances, in radii, without checks."""
        if self.is_indicator:
            return (distance < 1.0).astype(np.float64)
        with np.errstate(divide="ignore", over="ignore"):
            logarithms = np.log(np.minimum(distance, 1.0))
            # expm1 avoids the cancellation in s^-alpha - 1; it is infinite at s = 0, and +0 from s
            # = 1 on.
            powers = np.expm1(0.0 - self.alpha * logarithms)
            return np.asarray(np.exp(-1.0 / powers))

    def radial_spectrum(self, frequency: ArrayLike, dim: int) -> Floats:
        """Compute the Fourier transform of the bump.

        It is ``integral psi(x) exp(-2 pi i w.x) dx``, for radius 1; a bump of radius r has
        ``r^dim`` times its value at ``k = r |w|``. ``frequency``, shape (...), is in cycles per
        radius, from 0 to 1e5; ``dim`` is 2 or 3. The error is at most 1e-13 of the value at 0.
        Raises InputError for other frequencies or dimensions.
        """
        check_word(dim, "dim", (2, 3))
        return radial_transform(self.values, _check_frequency(frequency, "frequency"), dim)

    def table(
        self, dim: int, max_frequency: float, tolerance: float = 1e-12
    ) -> Callable[[Floats], Floats]:
        """Return a function that interpolates :meth:`radial_spectrum`.

        ``tolerance``, from 1e-13 to 0.1, is relative to the value at 0. Raises InputError if a
        value is not usable, as the returned function does for frequencies above ``max_frequency``.
        """
        check_word(dim, "dim", (2, 3))
        check_not_negative(max_frequency, "max_frequency")
        highest = _check_frequency(max_frequency, "max_frequency")
        return _table(self, dim, math.ceil(highest), check_tolerance(tolerance))

    def pair_integral(self, first: float, second: float, distance: float, dim: int) -> float:
        """Integrate ``psi(x / first) psi((x - distance e) / second)`` over the plane or space.

        The integral decreases with the distance of the centers. Radii and ``distance`` are in
        metres; the result, metres to the power ``dim``, has a relative error of 1e-9 or an absolute
        error of 1e-60 of the smaller ball. It is 0 if the balls are apart, or if it underflows.
        Raises InputError if a value is not usable, and CspaceError if the quadrature does not
        converge.
        """
        first_radii = np.array([check_positive(first, "first")])
        second_radii = np.array([check_positive(second, "second")])
        distances = np.array([check_not_negative(distance, "distance")])
        check_word(dim, "dim", (2, 3))
        integrals, _ = pair_integrals(self, first_radii, second_radii, distances, dim)
        return float(integrals[0])


def check_bump(bump: Any) -> Bump:
    """Return a bump, or ``Bump()`` for None; raise InputError otherwise."""
    if bump is None:
        return Bump()
    if not isinstance(bump, Bump):
        raise InputError("bump", f"is {bump!r}", "it must be a Bump", "pass e.g. Bump(2.0)")
    return bump


def check_tolerance(tolerance: Any, min_tolerance: float = MIN_TOLERANCE) -> float:
    """Return a tolerance from ``min_tolerance`` to 0.1, or raise InputError."""
    value = check_finite(tolerance, "tolerance")
    if value.ndim or not min_tolerance <= value <= 0.1:
        raise InputError(
            "tolerance",
            f"is {tolerance!r}",
            f"it must be one number from {min_tolerance:g} to 0.1, relative to the largest value",
            "pass e.g. 1e-9",
        )
    return float(value)


def _check_frequency(frequency: ArrayLike, name: str) -> Floats:
    """Return usable frequencies, cycles per radius, or raise InputError."""
    k = check_finite(frequency, name)
    for value in (k.min(initial=0.0), k.max(initial=0.0)):
        if not 0.0 <= value <= MAX_RADIAL_FREQUENCY:
            raise InputError(
                name,
                f"holds {value:g} cycles per radius",
                f"it must be zero or above, and at most {MAX_RADIAL_FREQUENCY:g}",
                "check its units",
            )
    return k


@lru_cache(maxsize=16)
def _table(bump: Bump, dim: int, max_frequency: int, tolerance: float) -> RadialTable:
    """Tabulate the spectrum of a bump, with a cache of recent tables."""
    frequencies = table_points(max_frequency, 0.5 * tolerance)
    return RadialTable(radial_transform(bump.values, frequencies, dim), max_frequency)


@lru_cache(maxsize=16)
def double_exponential_rule(count: int) -> tuple[Floats, Floats]:
    """Return ``2 count + 1`` nodes and weights of a quadrature on [0, 1].

    The nodes are ``1 / (1 + exp(-pi sinh(u)))`` at equal steps of u (Takahasi and Mori, 1974).
    """
    step = MAX_ABSCISSA / count
    u = step * np.arange(-count, count + 1)
    decay = np.exp(-math.pi * np.sinh(u))
    nodes = 1.0 / (1.0 + decay)
    complements = decay * nodes  # 1 - nodes, without cancellation
    return nodes, step * math.pi * np.cosh(u) * nodes * complements


def pair_integrals(
    bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int
) -> tuple[Floats, Floats]:
    """Integrate products of two bumps, for many pairs.

    ``first`` and ``second`` are the radii of the bumps, and ``distances`` those of their centers,
    in one unit; shape (n,). Returns the integrals over the plane or space, and bounds of their
    errors, shape (n,) each. For more than 8 pairs, the bound is the largest difference of two
    quadrature rules over all pairs, relative to ``radius^dim`` of the smaller ball. On a single
    pair, two rules may agree by chance.
    """
    if bump.is_indicator:
        # The integral is the measure of a lens, in closed form; 2^-50 allows for its rounding.
        values = lens_measure(first, second, distances, dim)
        return values, SAFETY_FACTOR * 2.0**-50 * values
    sizes = np.minimum(first, second) ** dim
    if len(sizes) <= 8:
        return _converged_integrals(bump, first, second, distances, dim)
    # Compare a coarse and a fine quadrature rule on all pairs at once.
    coarse_values, values = (
        product_integrals(bump.values, first, second, distances, dim, count)
        for count in BATCH_RULE_SIZES
    )
    differences = np.abs(coarse_values - values) / sizes
    worst = SAFETY_FACTOR * float(differences.max())
    # Both rules may round alike, so their difference misses rounding; 2^-46 allows for that of the
    # sums.
    return values, worst * sizes + 2.0**-46 * values


def _converged_integrals(
    bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int
) -> tuple[Floats, Floats]:
    """Integrate products of two bumps until two successive rules agree.

    Arguments and results are those of :func:`pair_integrals`. Raises CspaceError if no rules agree.
    """
    # Integrals below the floor count as zero.
    floors = PAIR_FLOOR * np.minimum(first, second) ** dim
    previous = np.full(len(first), math.nan)
    for count in (48, 96, 192, 384):  # nodes of the rule
        values = product_integrals(bump.values, first, second, distances, dim, count)
        tolerances = PAIR_TOLERANCE * np.maximum(values, floors)
        if (np.abs(values - previous) <= tolerances).all():
            return values, SAFETY_FACTOR * PAIR_TOLERANCE * values + floors
        previous = values
    raise CspaceError(
        "distance",
        f"is {distances}",
        "the integrals of two bumps must converge",
        "please report it",
    )


def sphere_measure(radius: Floats, dim: int) -> Floats:
    """Return the length of circles or the area of spheres."""
    return np.asarray(dim * UNIT_BALL_VOLUME[dim] * radius ** (dim - 1))


# ---- transforms ----------------------------------------------------------------------------------


def radial_transform(function: Radial, frequencies: Floats, dim: int) -> Floats:
    """Compute the Fourier transform of a non-negative radial function.

    In the plane it is ``2 pi integral_0^1 f(s) J0(2 pi k s) s ds``, in space ``4 pi integral_0^1
    f(s) sinc(2 k s) s^2 ds`` with ``sinc(x) = sin(pi x) / (pi x)``. The error is at most 1e-13 of
    the value at 0.
    """
    from scipy.special import j0

    kernel = {2: lambda x: j0(math.pi * x), 3: np.sinc}[dim]
    flat = np.ravel(frequencies)
    result = np.empty(flat.shape)
    # Frequencies of an octave share a rule, because higher frequencies need more nodes.
    octaves = np.ceil(np.log2(np.maximum(flat, 1.0)))
    for octave in np.unique(octaves).tolist():
        rows = np.flatnonzero(octaves == octave)
        # The phase of the kernel advances by 2 pi k ds/du, and ds/du is at most pi / 4; add samples
        # accordingly.
        count = math.ceil(MIN_TRANSFORM_NODES + MAX_ABSCISSA * math.pi / 4.0 * 2.0**octave)
        s, weights = double_exponential_rule(count)
        measure = weights * function(s) * sphere_measure(s, dim)
        # Blocks of rows bound the memory.
        blocks = math.ceil(len(rows) * len(s) / 2**21)
        for block in np.array_split(rows, blocks):
            result[block] = kernel(2.0 * np.outer(flat[block], s)) @ measure
    return result.reshape(np.shape(frequencies))


class RadialTable:
    """A radial spectrum interpolated from its values at :func:`table_points`.

    A function that vanishes outside the unit ball has a spectrum that is a mixture of ``exp(2 pi i
    k x)`` with ``|x| <= 1``. If the function is not negative, the weights of the mixture sum to the
    spectrum at 0. So the relative error of interpolation at Chebyshev nodes is at most its error
    for one such exponential: four times the sum of the Bessel functions ``J_n(2 pi
    TABLE_HALF_WIDTH)`` from the first omitted degree on (Trefethen, 2013, chapter 4).
    """

    def __init__(self, values: Floats, max_frequency: float) -> None:
        """Fit each interval to values, shape (intervals, nodes), at :func:`table_points`."""
        self.max_frequency = max_frequency
        self._coefficients = np.ascontiguousarray(chebyshev_coefficients(values.T))

    def __call__(self, frequencies: Floats) -> Floats:
        """Interpolate the spectrum; raises InputError above the table."""
        k = np.asarray(frequencies, dtype=np.float64)
        highest = self.max_frequency * (1.0 + 1e-9) + 1e-9  # for rounding
        if k.size and not (k.min() >= 0.0 and k.max() <= highest):
            raise InputError(
                "frequencies",
                f"reach from {k.min():g} to {k.max():g}",
                f"the table ends at {self.max_frequency:g}",
                "make a larger table",
            )
        # Find the interval of each frequency, and its place there, from -1 to 1.
        last = self._coefficients.shape[1] - 1
        interval = np.minimum((k / (2.0 * TABLE_HALF_WIDTH)).astype(np.intp), last)
        x = k / TABLE_HALF_WIDTH - (2.0 * interval + 1.0)
        coefficients = self._coefficients[:, interval]
        return np.asarray(np.polynomial.chebyshev.chebval(x, coefficients, tensor=False))


def table_points(max_frequency: float, tolerance: float) -> Floats:
    """Return the frequencies that a table needs, shape (intervals, nodes).

    The last interval may end above ``max_frequency``. The tolerance is the interpolation error
    relative to the value at 0; the error of the spectrum itself adds to it.
    """
    width = 2.0 * TABLE_HALF_WIDTH
    count = count_nodes(tolerance, math.pi * width)
    offsets = TABLE_HALF_WIDTH * (1.0 + chebyshev_nodes(count))
    intervals = max(1, math.ceil(max_frequency / width))
    starts = width * np.arange(intervals)
    return np.asarray(starts[:, None] + offsets)


def count_nodes(tolerance: float, phase: float) -> int:
    """Count the Chebyshev nodes that an interval needs.

    With them, exponentials of ``phase`` radians in half an interval are interpolated within
    ``tolerance``.
    """
    from scipy.special import jv

    # The error is at most four times the sum of Bessel functions from the first omitted degree on
    # (Trefethen, 2013, chapter 4). They vanish quickly beyond the phase.
    degrees = np.arange(int(2.0 * phase) + 80)
    terms = np.abs(jv(degrees, phase))
    sums_from_degree = np.cumsum(terms[::-1])[::-1]
    return int(np.argmax(4.0 * sums_from_degree <= tolerance))


def chebyshev_nodes(count: int) -> Floats:
    """Return the zeros of a Chebyshev polynomial, descending, shape (count,)."""
    return np.asarray(np.cos(math.pi * (np.arange(count) + 0.5) / count))


def chebyshev_coefficients(values: Floats) -> Floats:
    """Return Chebyshev coefficients of values at :func:`chebyshev_nodes`, along the first axis."""
    from scipy.fft import dct

    coefficients = dct(values, axis=0) / len(values)
    coefficients[0] /= 2.0
    return np.asarray(coefficients)


# ---- products of two -----------------------------------------------------------------------------


def product_integrals(
    function: Radial, a: Floats, b: Floats, distance: Floats, dim: int, count: int
) -> Floats:
    """Integrate products of two radial functions, for many pairs.

    The integrals of ``f(|x| / a) f(|x - distance e| / b)`` over the plane or space are computed by
    one rule. All arrays have shape (n,). The rule uses polar coordinates around the center of the
    smaller ball, in units of its radius, over the part inside the other ball,

        integral f(s) s^(dim - 1) integral f(rho / b) dOmega ds,
        rho^2 = s^2 + D^2 - 2 s D cos(theta).

    The interval of s is cut at the other center, and at the radius from which the other ball covers
    only some directions. Each piece has ``2 count + 1`` nodes.
    """
    # In units of the smaller radius: the larger radius and the distance.
    small = np.minimum(a, b)
    large = np.maximum(a, b)
    radii = large / small
    gaps = distance / small
    x, weights = double_exponential_rule(count)
    # Arrays over the borders or pieces, the pairs and the nodes of s.
    first = np.clip(gaps - radii, 0.0, 1.0)
    cuts = [np.clip(cut, first, 1.0) for cut in (gaps, radii - gaps)]
    borders = np.sort([first, *cuts, np.ones_like(first)], axis=0)[..., None]
    lengths = np.diff(borders, axis=0)
    # Measure from the near side of the lens, so that thin lenses keep their digits.
    rise = (borders[:-1] - first[:, None]) + lengths * x
    radial = first[:, None] + rise
    mass = lengths * weights * function(radial) * radial ** (dim - 1)
    # Keep the nodes with a weight, in one row.
    positive = np.nonzero(mass)
    mass = mass[positive]
    rise = rise[positive]
    radial = radial[positive]
    _, pairs, _ = positive
    totals = np.zeros(len(gaps))
    blocks = math.ceil(len(mass) * len(x) / 2**14) or 1  # a block fits into the cache
    for block in np.array_split(np.arange(len(mass)), blocks):
        pair = pairs[block]
        s = radial[block]
        gap = gaps[pair]
        radius = radii[pair]
        depth = np.where(first[pair] > 0.0, rise[block], radius + s - gap)
        with np.errstate(divide="ignore", over="ignore"):  # coinciding centers cover all directions
            covered = np.clip(depth * (radius + gap - s) / (4.0 * s * gap), 0.0, 1.0)
        half_sine_squares, densities = _direction_rule(covered[:, None], x, dim)
        # The law of cosines, without cancellation.
        squares = ((s - gap) ** 2)[:, None] + 4.0 * (s * gap)[:, None] * half_sine_squares
        values = function(np.sqrt(squares) / radius[:, None]) * densities
        totals += np.bincount(pair, mass[block] * (values @ weights), len(gaps))
    return np.asarray(totals * small**dim)


def _direction_rule(covered: Floats, x: Floats, dim: int) -> tuple[Floats, Floats]:
    """Return nodes ``sin(theta / 2)^2`` and densities of the integral over directions.

    ``covered``, shape (n, 1), is the largest ``sin(theta / 2)^2``; ``x``, shape (nodes,), are nodes
    in [0, 1]. No sine is needed: on a sphere, the area between two circles is proportional to the
    difference of their ``sin(theta / 2)^2``; on a circle, both are rational in ``tan(theta / 4)``.
    """
    if dim == 3:
        return covered * x, 4.0 * math.pi * covered
    largest_tangent = np.sqrt(covered) / (1.0 + np.sqrt(1.0 - covered))
    tangents = largest_tangent * x
    cosine_squares = 1.0 / (1.0 + tangents * tangents)
    half_sines = 2.0 * tangents * cosine_squares
    return np.asarray(half_sines**2), np.asarray(8.0 * largest_tangent * cosine_squares)


def lens_measure(a: Floats, b: Floats, distance: Floats, dim: int) -> Floats:
    """Return the area or volume common to two balls, for many pairs.

    The radii ``a`` and ``b``, and the distances of the centers, have shape (n,).
    """
    small = np.minimum(a, b)
    # Subtract similar lengths first, because such differences are exact.
    depth = (np.maximum(a, b) - distance) + small
    with np.errstate(all="ignore"):  # np.where drops the invalid values below
        if dim == 3:
            spread = distance * (distance + 2.0 * (a + b)) - 3.0 * (a - b) ** 2
            lens = np.asarray(math.pi * depth**2 * spread / (12.0 * distance))
        else:
            share = (b - a) / distance  # first, because a product may underflow
            lens = _segment_area(a, 0.5 * depth * (1.0 + share))
            lens += _segment_area(b, 0.5 * depth * (1.0 - share))
    # One ball may contain the other, or they may be apart.
    lens = np.where(distance <= np.abs(a - b), UNIT_BALL_VOLUME[dim] * small**dim, lens)
    return np.where(distance >= a + b, 0.0, lens)


def _segment_area(radius: Floats, height: Floats) -> Floats:
    """Return areas of disc segments, accurate also for flat ones."""
    angle = 4.0 * np.arcsin(np.sqrt(np.minimum(1.0, height / (2.0 * radius))))
    # For a small angle, the Taylor series of angle - sin(angle) avoids the cancellation.
    coefficients = [(-1.0) ** n / math.factorial(2 * n + 3) for n in range(6)]
    series = angle**3 * np.polynomial.polynomial.polyval(angle * angle, coefficients)
    difference = np.where(angle > 0.25, angle - np.sin(angle), series)
    return np.asarray(0.5 * radius**2 * difference)

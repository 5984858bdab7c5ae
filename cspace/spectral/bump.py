"""The bump, a radial function that is 1 at the centre of a ball and fades to 0 at its border: its Fourier transform,
tables of that, and integrals of the product of two, each around its own centre.

All integrals are trapezoidal sums in u with ``s = 1 / (1 + exp(-pi sinh(u)))`` (H. Takahasi and M. Mori, "Double
exponential formulas for numerical integration", 1974). They converge geometrically for functions that are smooth but
for the ends of an interval, whatever they do there: the cusp of a bump at 0, a steep flank next to 1, or a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Floats
from cspace.check import check_word, finite, not_negative, positive, unmasked
from cspace.errors import CspaceError, InputError

Radial = Callable[[Floats], Floats]

LEAST_TOLERANCE: Final = 1e-13  # below this, rounding in float64 leaves nothing to ask for

MOST_TOLERANCE: Final = 0.1

VOLUME: Final = {2: math.pi, 3: 4.0 / 3.0 * math.pi}  # of the unit ball

LEAST_ALPHA: Final = 0.01
MOST_ALPHA: Final = 1e4

MOST_FREQUENCY: Final = 1e5
"""Up to here the phases that rounding leaves are right to 1e-10 radians, where the spectrum is small."""

PAIR_TOLERANCE: Final = 1e-9  # relative error of a pair's integral

FLOOR: Final = 1e-60
"""Part of the smaller ball's ``radius^dim`` below which the integral of a pair is known to that part of it only: there
the result depends on the last bits of the radii."""

TWO_RULES: Final = (26, 32)
"""Of nodes; what two rules differ by bounds the error of the finer one, which is far less."""

SAFETY: Final = 4.0  # by how much measured errors are multiplied before they are relied upon
FEW: Final = 8  # pairs up to which each is integrated by itself, to ``PAIR_TOLERANCE``
COUNTS: Final = (48, 96, 192, 384)  # of nodes, for a pair's integral; two that follow each other must agree
REACH: Final = 3.3  # largest modulus of u in a sum; above, what an interval has left is below 1e-18 of it

NODES: Final = 160
"""Nodes on either side of u = 0 for frequency 0. Two thirds of them leave 1e-14 of bumps from alpha = 0.01 to 1e4."""

CHUNK: Final = 2**21  # values of the kernel held together
IN_CACHE: Final = 2**14  # values of a product held together
HALF: Final = 0.5  # half the width of an interval of a table, in ``k``
SMALL_ANGLE: Final = 0.25  # below this the series of ``x - sin(x)`` loses less than the difference
SLACK: Final = 1e-9  # by how much a frequency may lie above a table, relative, from rounding


@dataclass(frozen=True, slots=True)
class Bump:
    """``psi(x) = exp(1 / (1 - |x|^-alpha))`` for ``0 < |x| < 1``, 1 at 0 and 0 from ``|x| = 1`` on.

    It is above zero in the open unit ball and nowhere else (in float64 it underflows in a skin next to the border,
    of ``1 / (745 alpha)`` of the radius or less), and smooth but for the centre, where it is as smooth as
    ``|x|^alpha``. A ball of radius r around p has the descriptor ``psi((x - p) / r)`` (Lysenko, 2013; Behandish and
    Ilies, 2016).

    Parameters
    ----------
    alpha : float
        From 0.01 (a needle) to 1e4 (nearly flat), or ``inf``: the indicator of the open ball.

    Raises InputError if ``alpha`` is none of these.
    """

    alpha: float = 2.0

    def __post_init__(self) -> None:
        unmasked(self.alpha, "alpha")
        try:
            alpha = float(self.alpha)
        except (TypeError, ValueError):
            alpha = math.nan
        if not (LEAST_ALPHA <= alpha <= MOST_ALPHA or alpha == math.inf):
            rule = f"it must be one number between {LEAST_ALPHA:g} and {MOST_ALPHA:g}, or infinite"
            raise InputError("alpha", f"is {self.alpha!r}", rule, "pass e.g. 2.0, or math.inf", value=self.alpha)
        object.__setattr__(self, "alpha", alpha)

    @property
    def is_indicator(self) -> bool:
        """Whether it is 1 all over the open ball."""
        return self.alpha == math.inf

    def profile(self, distance: ArrayLike) -> Floats:
        """Values at distances from the centre, in radii, of any shape; InputError if one is not zero or above."""
        return self.values(_check_not_negative(distance, "distance"))

    def values(self, distance: Floats) -> Floats:
        """:meth:`profile` of an array, unchecked."""
        if self.is_indicator:
            return (distance < 1.0).astype(np.float64)
        with np.errstate(divide="ignore", over="ignore"):
            # s^-alpha - 1, without the difference of two numbers near one: infinite at s = 0, and +0 from s = 1 on.
            powers = np.expm1(0.0 - self.alpha * np.log(np.minimum(distance, 1.0)))
            return np.asarray(np.exp(-1.0 / powers))

    def radial_spectrum(self, frequency: ArrayLike, dim: int) -> Floats:
        """Fourier transform ``integral psi(x) exp(-2 pi i w.x) dx`` of the bump of radius 1, a function of ``k = |w|``.

        That of radius r is ``r^dim`` times this at ``k = r |w|``. For ``frequency``, shape (...), in cycles per radius,
        from 0 to 1e5, and ``dim`` 2 or 3, it is right to 1e-13 of the value at 0; InputError for other values.
        """
        k = _check_frequency(frequency, "frequency")
        check_word(dim, "dim", (2, 3))
        return radial_transform(self.values, k, dim)

    def table(self, dim: int, most: float, tolerance: float = 1e-12) -> Callable[[Floats], Floats]:
        """The same spectrum for many frequencies, computed at some of them, and interpolated: a function of ``k``.

        The tolerance, from 1e-13 to 0.1, is relative to the value at 0. Raises InputError where a value is not usable,
        then, and when the function is called above ``most``.
        """
        within = check_tolerance(tolerance)
        check_word(dim, "dim", (2, 3))
        return _table(
            self, dim, math.ceil(_check_frequency(not_negative(most, "most", "pass cycles per radius"), "most")), within
        )

    def pair_integral(self, first: float, second: float, distance: float, dim: int) -> float:
        """Integral of ``psi(x / first) psi((x - distance e) / second)`` over the plane or space.

        It falls with the distance: both functions are spherically symmetric and fall towards their borders. Radii and
        the distance of the centres are metres; the result, metres to the power ``dim``, is right to 1e-9 of itself, or
        to 1e-60 of the smaller ball, and 0 from the sum of the radii on, or where it underflows.

        Raises InputError if a value is not usable, and CspaceError if the quadrature does not converge.
        """
        a, b = (np.array([positive(*named)]) for named in ((first, "first"), (second, "second")))
        gap = np.array([not_negative(distance, "distance")])
        check_word(dim, "dim", (2, 3))
        if self.is_indicator:
            return float(lens_measure(a, b, gap, dim)[0])
        if gap[0] >= a[0] + b[0]:
            return 0.0
        last = math.nan
        for count in COUNTS:
            value = float(product_integrals(self.values, a, b, gap, dim, count)[0])
            if abs(value - last) <= PAIR_TOLERANCE * max(value, FLOOR * min(a[0], b[0]) ** dim):
                return value
            last = value
        raise CspaceError(
            "distance",
            f"is {distance!r}",
            "the integral of the two bumps must be within reach of rules",
            "please report it",
            value=distance,
        )


def check_bump(bump: Any) -> Bump:
    """The bump itself, or the usual one for None; InputError if it is neither."""
    if bump is not None and not isinstance(bump, Bump):
        raise InputError("bump", f"is {bump!r}", "it must be a Bump", "pass e.g. Bump(2.0)", value=bump)
    return Bump() if bump is None else bump


def check_tolerance(tolerance: Any, least: float = LEAST_TOLERANCE) -> float:
    """A relative tolerance from ``least`` to 0.1."""
    value = finite(tolerance, "tolerance")
    if value.ndim or not least <= value <= MOST_TOLERANCE:
        rule = f"it must be one number from {least:g} to {MOST_TOLERANCE:g}, for it is relative to the largest value"
        raise InputError("tolerance", f"is {tolerance!r}", rule, "pass e.g. 1e-9", value=tolerance)
    return float(value)


def _check_not_negative(values: ArrayLike, name: str) -> Floats:
    """Finite numbers, none below zero, of any shape."""
    array = finite(values, name)
    if (array < 0.0).any():
        raise InputError(name, f"holds {array.min():g}", "none may be below zero", "pass the modulus", value=values)
    return array


def _check_frequency(frequency: ArrayLike, name: str) -> Floats:
    k = _check_not_negative(frequency, name)
    most = float(k.max(initial=0.0))
    if most > MOST_FREQUENCY:
        rule = f"up to {MOST_FREQUENCY:g} are computed"
        raise InputError(name, f"holds {most:g} cycles per radius", rule, "check its units", value=most)
    return k


@lru_cache(maxsize=16)
def _table(bump: Bump, dim: int, most: int, tolerance: float) -> RadialTable:
    return RadialTable(radial_transform(bump.values, table_points(most, 0.5 * tolerance), dim), most)


@lru_cache(maxsize=16)
def double_exponential(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights on [0, 1], ``2 count + 1`` of them, the middle one at 1/2."""
    u = REACH / count * np.arange(-count, count + 1)
    down = np.exp(-math.pi * np.sinh(u))
    nodes = 1.0 / (1.0 + down)
    return nodes, REACH / count * math.pi * np.cosh(u) * nodes * (down * nodes)


def pair_integrals(bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int) -> tuple[Floats, Floats]:
    """Integrals of ``psi(x / first) psi((x - distance e) / second)``, all shape (n,), and by how much each may be off.

    Of more than a few pairs, that is what two rules differ by, at most, for any of the pairs, relative to the smaller
    ball: on a single pair rules may agree by chance.
    """
    if bump.is_indicator:
        values = lens_measure(first, second, distances, dim)
        return values, SAFETY * 2.0**-50 * values
    sizes = np.minimum(first, second) ** dim
    if len(sizes) <= FEW:
        triples = zip(first.tolist(), second.tolist(), distances.tolist(), strict=True)
        values = np.array([bump.pair_integral(*triple, dim) for triple in triples])
        return values, SAFETY * PAIR_TOLERANCE * values + FLOOR * sizes
    rough, values = (product_integrals(bump.values, first, second, distances, dim, count) for count in TWO_RULES)
    worst = SAFETY * float((np.abs(rough - values) / sizes).max())
    return values, worst * sizes + 2.0**-46 * values


def around(radius: Floats, dim: int) -> Floats:
    """Length of a circle, or area of a sphere."""
    return np.asarray(dim * VOLUME[dim] * radius ** (dim - 1))


# ---- transforms ------------------------------------------------------------------------------------------------------


def radial_transform(function: Radial, frequencies: Floats, dim: int) -> Floats:
    """The Fourier transform of a radial function at ``k = |w|``, of any shape, to 1e-13 of its value at 0:

    2 pi integral_0^1 f(s) J0(2 pi k s) s ds   in the plane,      4 pi integral_0^1 f(s) sinc(2 k s) s^2 ds   in space,

    with ``sinc(x) = sin(pi x) / (pi x)``. The function is not below zero.
    """
    from scipy.special import j0

    kernel = {2: lambda x: j0(math.pi * x), 3: np.sinc}[dim]
    flat = np.ravel(frequencies)
    result = np.empty(flat.shape)
    octaves = np.ceil(np.log2(np.maximum(flat, 1.0)))
    for octave in np.unique(octaves).tolist():
        rows = np.flatnonzero(octaves == octave)
        # A kernel that turns by 2 pi k ds/du, at most pi / 4 of that, needs as many samples more.
        s, weights = double_exponential(math.ceil(NODES + REACH * math.pi / 4.0 * 2.0**octave))
        measure = weights * function(s) * around(s, dim)
        for part in np.array_split(rows, math.ceil(len(rows) * len(s) / CHUNK)):
            result[part] = kernel(2.0 * flat[part][:, None] * s) @ measure
    return result.reshape(np.shape(frequencies))


class RadialTable:
    """A radial spectrum up to ``most``, interpolated between values (intervals, nodes) at :func:`table_points`.

    What vanishes outside the unit ball has a spectrum that is a mixture of ``exp(2 pi i k x)`` with ``|x| <= 1``; where
    the function is not below zero, the mixture's weights sum to the spectrum at 0. So interpolation at Chebyshev nodes
    errs, relative to that value, by at most what it errs for one such exponential: four times the sum of the Bessel
    functions ``J_n(2 pi HALF)`` from the first degree left out (Trefethen, 2013, chapter 4).
    """

    def __init__(self, values: Floats, most: float) -> None:
        self.most = most
        self._coefficients = np.ascontiguousarray(chebyshev_coefficients(values.T))

    def __call__(self, frequencies: Floats) -> Floats:
        """The spectrum at ``k``, of any shape, from 0 to :attr:`most`; InputError above."""
        k = np.asarray(frequencies, dtype=np.float64)
        if k.size and not (k.min() >= 0.0 and k.max() <= self.most * (1.0 + SLACK) + SLACK):
            problem, rule = f"reach from {k.min():g} to {k.max():g}", f"the table holds those from 0 to {self.most:g}"
            raise InputError("frequencies", problem, rule, "make it for the largest one", value=frequencies)
        interval = np.minimum((k / (2.0 * HALF)).astype(np.intp), self._coefficients.shape[1] - 1)
        x = k / HALF - (2.0 * interval + 1.0)
        # Clenshaw's recurrence.
        one, two, doubled = np.zeros_like(k), np.zeros_like(k), 2.0 * x
        for row in self._coefficients[:0:-1]:
            one, two = row[interval] + doubled * one - two, one
        return np.asarray(self._coefficients[0][interval] + x * one - two)


def table_points(most: float, tolerance: float) -> Floats:
    """Where a table up to ``most`` needs a spectrum, shape (intervals, nodes); the last may lie an interval above.

    The tolerance, relative to the value at 0, is that of the interpolation; the spectrum's own error comes on top.
    """
    nodes = HALF * (1.0 + chebyshev_nodes(nodes_needed(tolerance, 2.0 * math.pi * HALF)))
    intervals = max(1, math.ceil(most / (2.0 * HALF)))
    return np.asarray(2.0 * HALF * np.arange(intervals)[:, None] + nodes)


def nodes_needed(tolerance: float, phase: float) -> int:
    """How many Chebyshev nodes an interval takes in whose half the exponentials turn by ``phase`` radians."""
    from scipy.special import jv

    terms = np.abs(jv(np.arange(int(2.0 * phase) + 80), phase))
    return int(np.argmax(4.0 * np.cumsum(terms[::-1])[::-1] <= tolerance))


def chebyshev_nodes(count: int) -> Floats:
    """Zeros of the Chebyshev polynomial of a degree, falling."""
    return np.asarray(np.cos(math.pi * (np.arange(count) + 0.5) / count))


def chebyshev_coefficients(values: Floats) -> Floats:
    """Of the polynomials through values (count, ...) at :func:`chebyshev_nodes`, by a cosine transform."""
    from scipy.fft import dct

    coefficients = dct(values, axis=0) / len(values)
    coefficients[0] /= 2.0
    return np.asarray(coefficients)


# ---- products of two -------------------------------------------------------------------------------------------------


def product_integrals(function: Radial, a: Floats, b: Floats, distance: Floats, dim: int, count: int) -> Floats:
    """Integrals of ``f(|x| / a) f(|x - distance e| / b)`` over the plane or space, all shape (n,), by one rule.

    In polar coordinates around the centre of the smaller ball, in its radius, over the part that the other one covers,

        integral f(s) s^(dim - 1) integral f(rho / b) dOmega ds,    rho^2 = s^2 + D^2 - 2 s D cos(theta).

    The interval of s is cut where it meets the other centre, and where the other ball begins to cover less than all
    directions. There are ``2 count + 1`` nodes in each part of it.
    """
    small, large = np.minimum(a, b), np.maximum(a, b)
    radii, gaps = large / small, distance / small
    x, weights = double_exponential(count)
    first = np.clip(gaps - radii, 0.0, 1.0)
    cuts = [np.clip(cut, first, 1.0) for cut in (gaps, radii - gaps)]
    borders = np.sort([first, *cuts, np.ones_like(first)], axis=0)[..., None]
    # From the near side of a lens, however thin, so that no digits of it are lost.
    rise = (borders[:-1] - first[:, None]) + np.diff(borders, axis=0) * x
    radial = first[:, None] + rise
    mass = np.diff(borders, axis=0) * weights * function(radial) * radial ** (dim - 1)
    positive = np.nonzero(mass)
    mass, rise, radial, pairs = mass[positive], rise[positive], radial[positive], positive[1]
    totals = np.zeros(len(gaps))
    for part in np.array_split(np.arange(len(mass)), math.ceil(len(mass) * len(x) / IN_CACHE) or 1):
        s, gap, radius = radial[part], gaps[pairs[part]], radii[pairs[part]]
        depth = np.where(first[pairs[part]] > 0.0, rise[part], radius + s - gap)
        with np.errstate(divide="ignore", over="ignore"):  # all directions are covered where centres coincide
            covered = np.clip(depth * (radius + gap - s) / (4.0 * s * gap), 0.0, 1.0)[:, None]
        sines, densities = _directions(covered, x, dim)
        square = ((s - gap) ** 2)[:, None] + 4.0 * (s * gap)[:, None] * sines
        values = function(np.sqrt(square) / radius[:, None]) * densities
        totals += np.bincount(pairs[part], mass[part] * (values @ weights), len(gaps))
    return np.asarray(totals * small**dim)


def _directions(covered: Floats, x: Floats, dim: int) -> tuple[Floats, Floats]:
    """``sin(theta / 2)^2`` from 0 to ``covered``, shape (n, 1), at parts x of the way, and ``dOmega / dx``, without a
    sine: on a sphere the area between two circles is proportional to the difference of the former, and on a circle both
    are fractions in ``tan(theta / 4)``."""
    if dim == 3:
        return covered * x, 4.0 * math.pi * covered
    last = np.sqrt(covered) / (1.0 + np.sqrt(1.0 - covered))
    quarter = last * x
    share = 1.0 / (1.0 + quarter * quarter)
    return np.asarray((2.0 * quarter * share) ** 2), np.asarray(8.0 * last * share)


def lens_measure(a: Floats, b: Floats, distance: Floats, dim: int) -> Floats:
    """Area or volume that two balls have in common, with small relative error also for thin lenses."""
    least = np.minimum(a, b)
    # Differences of like lengths first: they are exact, and what is left of them is all that counts.
    depth = (np.maximum(a, b) - distance) + least
    with np.errstate(all="ignore"):  # of values that are not taken
        lens = {2: _lens_area, 3: _lens_volume}[dim](a, b, distance, depth)
    whole = VOLUME[dim] * least**dim
    return np.where(distance >= a + b, 0.0, np.where(distance <= np.abs(a - b), whole, lens))


def _lens_volume(a: Floats, b: Floats, distance: Floats, depth: Floats) -> Floats:
    spread = distance * (distance + 2.0 * (a + b)) - 3.0 * (a - b) ** 2
    return np.asarray(math.pi * depth**2 * spread / (12.0 * distance))


def _lens_area(a: Floats, b: Floats, distance: Floats, depth: Floats) -> Floats:
    share = (b - a) / distance  # halves of quotients, for the product may underflow
    return _segment(a, 0.5 * depth * (1.0 + share)) + _segment(b, 0.5 * depth * (1.0 - share))


def _segment(radius: Floats, height: Floats) -> Floats:
    """Area of the segment of a disc that is ``height`` high."""
    angle = 4.0 * np.arcsin(np.sqrt(np.minimum(1.0, height / (2.0 * radius))))
    series = [(-1.0) ** n / math.factorial(2 * n + 3) for n in range(6)]
    small = angle**3 * np.polynomial.polynomial.polyval(angle * angle, series)
    return np.asarray(0.5 * radius**2 * np.where(angle > SMALL_ANGLE, angle - np.sin(angle), small))

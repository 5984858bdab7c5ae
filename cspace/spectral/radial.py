"""Radial functions that vanish beyond the unit ball: their Fourier transforms, tables of these, and integrals of the
product of two, each around its own centre.

For ``f(|x|)`` and ``k = |w|`` the transform ``integral f(|x|) exp(-2 pi i w.x) dx`` is

    2 pi integral_0^1 f(s) J0(2 pi k s) s ds   in the plane,      4 pi integral_0^1 f(s) sinc(2 k s) s^2 ds   in space

with ``sinc(x) = sin(pi x) / (pi x)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import CspaceError, InputError

Floats = NDArray[np.float64]
Radial = Callable[[Floats], Floats]

NODES: Final = 32
"""Gauss-Legendre nodes in a panel."""

RESOLVED: Final = 20
"""Legendre coefficients of a panel from this one on must be negligible; the rest of the rule's degree, 43, is left to
the kernel."""

PHASE: Final = 20.0
"""Radians by which the kernel may turn in a panel: from 43 on, the Legendre coefficients of exp(10 i x) are below
1e-17."""

NEGLIGIBLE: Final = 1e-2
"""Part of the tolerance that all unresolved coefficients together may take."""

MOST_HALVINGS: Final = 200

CHUNK: Final = 2**21
"""Values of the kernel held at once."""

HALF: Final = 1.0
"""Half the width of an interval of a table, in ``k``."""

SLACK: Final = 1e-9
"""By how much a frequency may lie beyond a table, relative, from rounding."""

RULES: Final = ((8, 8), (12, 12), (16, 20), (24, 32), (32, 48))
"""Nodes in a panel, and halvings of panels towards each end, from coarse to fine."""

FLOOR: Final = 1e-60
"""Part of the smaller ball's ``radius^dim`` below which the integral of a product is known to that part of it only:
there the result hangs on the last bits of the radii."""

SMALL_ANGLE: Final = 0.25
"""Below this the series of ``x - sin(x)`` loses less than the difference."""


@cache
def legendre_rule(count: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * nodes, 0.5 * weights


# ---- transforms ------------------------------------------------------------------------------------------------------


class RadialTransform:
    """The Fourier transform of one radial function.

    The integral is a composite Gauss-Legendre rule: panels are halved until each holds ``f(s) s^(dim - 1)`` as a
    polynomial of two thirds of the degree that the nodes resolve, which grades them towards a cusp at 0 and a steep
    flank near 1, and then cut evenly until the kernel turns by less than :data:`PHASE` in each. The function is
    smooth but for 0 and 1, and not below zero; the tolerance is relative to the transform's value at 0, its largest.
    """

    def __init__(self, function: Radial, dim: int, tolerance: float) -> None:
        self._function, self._dim = function, dim
        self._lows, self._highs = self._panels(tolerance)

    def __call__(self, frequencies: Floats) -> Floats:
        """The transform at ``k``, none below zero, of any shape."""
        flat = np.ravel(frequencies)
        order = np.argsort(flat)
        result = np.empty(flat.shape)
        start = 0
        while start < len(flat):
            # What turns at most twice as fast shares a rule.
            first = max(1.0, float(flat[order[start]]))
            stop = int(np.searchsorted(flat, 2.0 * first, side="right", sorter=order))
            nodes, weights = self._rule(float(flat[order[stop - 1]]))
            for part in np.array_split(order[start:stop], math.ceil((stop - start) * len(nodes) / CHUNK)):
                result[part] = self._kernel(flat[part][:, None] * nodes) @ weights
            start = stop
        return result.reshape(np.shape(frequencies))

    def _kernel(self, product: Floats) -> Floats:
        from scipy.special import j0

        return np.asarray(np.sinc(2.0 * product) if self._dim == 3 else j0(2.0 * math.pi * product))

    def _rule(self, most: float) -> tuple[Floats, Floats]:
        """Nodes, and weights times the function, for frequencies up to ``most``."""
        parts = np.maximum(1, np.ceil(2.0 * math.pi * most * (self._highs - self._lows) / PHASE)).astype(np.int64)
        widths = np.repeat((self._highs - self._lows) / parts, parts)
        number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        nodes, weights = legendre_rule(NODES)
        s = (np.repeat(self._lows, parts) + widths * number)[:, None] + widths[:, None] * nodes
        measure = 2.0 * math.pi * s if self._dim == 2 else 4.0 * math.pi * s * s
        return s.ravel(), (widths[:, None] * weights * measure * self._function(s)).ravel()

    def _panels(self, tolerance: float) -> tuple[Floats, Floats]:
        """Lower and upper ends of panels that resolve the function."""
        nodes, weights = legendre_rule(NODES)
        degrees = np.arange(NODES)[:, None]
        to_coefficients = np.polynomial.legendre.legvander(2.0 * nodes - 1.0, NODES - 1).T * weights * (2 * degrees + 1)
        lows, widths = np.array([0.0]), 1.0
        done: list[tuple[Floats, Floats]] = []
        settled = 0.0
        for _ in range(MOST_HALVINGS):
            s = lows[:, None] + widths * nodes
            values = self._function(s) * s ** (self._dim - 1)
            masses = widths * (values @ weights)
            tails = widths * np.abs(values @ to_coefficients.T)[:, RESOLVED:].sum(axis=1)
            rough = tails > NEGLIGIBLE * tolerance * (settled + masses.sum())
            settled += float(masses[~rough].sum())
            done.append((lows[~rough], lows[~rough] + widths))
            if not rough.any():
                break
            widths *= 0.5
            lows = np.concatenate([lows[rough], lows[rough] + widths])
        return np.concatenate([low for low, _ in done]), np.concatenate([high for _, high in done])


class RadialTable:
    """A radial spectrum up to ``most``, interpolated between values (intervals, nodes) at :func:`table_points`.

    What vanishes beyond the unit ball has a spectrum that is a mixture of ``exp(2 pi i k x)`` with ``|x| <= 1``; where
    the function is not below zero, the mixture's weights sum to the spectrum at 0. So interpolation at Chebyshev nodes
    errs, relative to that value, by at most what it errs for one such exponential: four times the sum of the Bessel
    functions ``J_n(2 pi HALF)`` from the first degree left out (Trefethen, 2013, chapter 4).
    """

    def __init__(self, values: Floats, most: float) -> None:
        self.most = most
        self._coefficients = np.ascontiguousarray(chebyshev_matrix(values.shape[1]) @ values.T)

    def __call__(self, frequencies: Floats) -> Floats:
        """The spectrum at ``k``, of any shape, from 0 to :attr:`most`; InputError beyond."""
        k = np.asarray(frequencies, dtype=np.float64)
        if k.size and not (k.min() >= 0.0 and k.max() <= self.most * (1.0 + SLACK) + SLACK):
            found, rule = f"reach from {k.min():g} to {k.max():g}", f"the table holds those from 0 to {self.most:g}"
            raise InputError("frequencies", found, rule, "make it for the largest one")
        interval = np.minimum((k / (2.0 * HALF)).astype(np.intp), self._coefficients.shape[1] - 1)
        x = k / HALF - (2.0 * interval + 1.0)
        # Clenshaw's recurrence.
        one, two, doubled = np.zeros_like(k), np.zeros_like(k), 2.0 * x
        for row in self._coefficients[:0:-1]:
            one, two = row[interval] + doubled * one - two, one
        return np.asarray(self._coefficients[0][interval] + x * one - two)


def table_points(most: float, tolerance: float) -> Floats:
    """Where a table up to ``most`` needs a spectrum, shape (intervals, nodes); the last may lie an interval beyond.

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


def chebyshev_matrix(count: int) -> Floats:
    """From values at the nodes to coefficients of Chebyshev polynomials, shape (count, count)."""
    matrix = 2.0 / count * np.cos(math.pi * np.arange(count)[:, None] * (np.arange(count) + 0.5) / count)
    matrix[0] /= 2.0
    return np.asarray(matrix)


# ---- products of two -------------------------------------------------------------------------------------------------


def product_integral(function: Radial, a: float, b: float, distance: float, dim: int, tolerance: float) -> float:
    """Integral of ``f(|x| / a) f(|x - distance e| / b)`` over the plane or space; 0 from the distance ``a + b`` on.

    The number of nodes is raised until two rules agree. Panels shrink towards the ends, where the functions are steep,
    and towards the second centre, so that the error is relative to the integral itself, or to :data:`FLOOR`, however
    thin the lens is.

    Raises
    ------
    CspaceError
        If the finest rules do not agree within the tolerance.
    """
    if distance >= a + b:
        return 0.0
    # Around the smaller ball; in its radius, so that no power of it overflows.
    a, b = min(a, b), max(a, b)
    radius, gap = np.array([b / a]), np.array([distance / a])
    first = max(0.0, gap[0] - radius[0])
    inner = (s for s in (gap[0], radius[0] - gap[0]) if first < s < 1.0)
    ends = np.array(sorted({first, 1.0, *inner}))
    last, known = 0.0, 0.0
    for nodes, halvings in RULES:
        s = _graded_rule(ends, nodes, halvings)
        share = _graded_rule(np.array([0.0, 1.0]), nodes, halvings)
        last, known = known, float(polar_integral(function, radius, gap, dim, s, share)[0])
        if nodes > RULES[0][0] and abs(known - last) <= tolerance * max(known, FLOOR):
            return known * a**dim
    found = f"is {tolerance:g}, and the integral is {last:g} or {known:g}, by rules of different order"
    raise CspaceError("tolerance", found, "they must agree within it", "pass a larger tolerance")


Rule = tuple[Floats, Floats]
"""Nodes and weights, shape (m,), or (n, m) for n integrals."""


def polar_integral(function: Radial, b: Floats, distance: Floats, dim: int, radial: Rule, share: Rule) -> Floats:
    """Integrals of ``f(|x|) f(|x - distance e| / b)`` for radii ``b`` of 1 and more, shape (n,), by one rule.

    In polar coordinates around the first centre, over the part of the unit ball that the second one covers,

        integral f(s) s^(dim - 1) integral f(rho / b) dOmega ds,    rho^2 = s^2 + D^2 - 2 s D cos(theta).

    ``radial`` is the rule in s; ``share``, on [0, 1], that in theta as a part of the largest one.
    """
    s, weights = np.atleast_2d(radial[0]), np.atleast_2d(radial[1])
    b, gap = b[:, None], distance[:, None]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        cosine = (s * s + gap * gap - b * b) / (2.0 * s * gap)
    # Where the centres coincide the quotient may be 0 / 0, and then all of the sphere is covered, or none of it.
    most = np.where(s + gap <= b, math.pi, np.arccos(np.clip(np.nan_to_num(cosine, nan=1.0), -1.0, 1.0)))
    theta = most[..., None] * share[0]
    square = ((s - gap) ** 2)[..., None] + 4.0 * (s * gap)[..., None] * np.sin(0.5 * theta) ** 2
    values = function(np.sqrt(square) / b[..., None])
    if dim == 3:
        values = values * (math.pi * np.sin(theta))
    around = 2.0 * most * (values @ share[1])
    return np.asarray((weights * function(s) * s ** (dim - 1) * around).sum(axis=1))


def _graded_rule(ends: Floats, nodes: int, halvings: int) -> Rule:
    """A rule over neighbouring intervals, with panels that halve towards both ends of each."""
    shares = 0.5 ** np.arange(1.0, halvings + 1.0)
    breaks = np.concatenate([[0.0], shares[::-1], 1.0 - shares[1:], [1.0]])
    panels = ends[:-1, None] + np.diff(ends)[:, None] * breaks
    widths, starts = np.diff(panels, axis=1).ravel(), panels[:, :-1].ravel()
    x, weights = legendre_rule(nodes)
    return (starts[:, None] + widths[:, None] * x).ravel(), (widths[:, None] * weights).ravel()


def lens_measure(a: Floats, b: Floats, distance: Floats, dim: int) -> Floats:
    """Area or volume that two balls have in common, with small relative error also for thin lenses."""
    least = np.minimum(a, b)
    # Differences of like lengths first: they are exact, and what is left of them is all that counts.
    depth = (np.maximum(a, b) - distance) + least
    with np.errstate(all="ignore"):  # of values that are not taken
        if dim == 3:
            spread = distance * (distance + 2.0 * (a + b)) - 3.0 * (a - b) ** 2
            lens = math.pi * depth**2 * spread / (12.0 * distance)
        else:  # halves of quotients, for the product may underflow
            share = (b - a) / distance
            lens = _segment(a, 0.5 * depth * (1.0 + share)) + _segment(b, 0.5 * depth * (1.0 - share))
    whole = math.pi * least**2 if dim == 2 else 4.0 / 3.0 * math.pi * least**3
    return np.where(distance >= a + b, 0.0, np.where(distance <= np.abs(a - b), whole, lens))


def _segment(radius: Floats, height: Floats) -> Floats:
    """Area of the segment of a disc that is ``height`` high."""
    angle = 4.0 * np.arcsin(np.sqrt(np.minimum(1.0, height / (2.0 * radius))))
    series = [(-1.0) ** n / math.factorial(2 * n + 3) for n in range(6)]
    small = angle**3 * np.polynomial.polynomial.polyval(angle * angle, series)
    return np.asarray(0.5 * radius**2 * np.where(angle > SMALL_ANGLE, angle - np.sin(angle), small))

"""The bump: a radial function that is 1 at the centre of a ball and fades to 0 at its border."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import positive, unmasked
from cspace.spectral.inputs import check_kind, check_not_negative, check_number, check_tolerance
from cspace.spectral.radial import RadialTable, RadialTransform, lens_measure, product_integral, table_points

Floats = NDArray[np.float64]

LEAST_ALPHA: Final = 0.01
MOST_ALPHA: Final = 1e4

MOST_FREQUENCY: Final = 1e5
"""Up to here the phases that rounding leaves are right to 1e-10 radians, where the spectrum is small."""

LEAST_PAIR_TOLERANCE: Final = 1e-12
"""Least tolerance of a pair's integral."""


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

    Raises
    ------
    InputError
        If ``alpha`` is none of these.
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
        return self.values(check_not_negative(distance, "distance"))

    def values(self, distance: Floats) -> Floats:
        """:meth:`profile` of an array, unchecked."""
        inside = distance < 1.0
        if self.is_indicator:
            return inside.astype(np.float64)
        with np.errstate(divide="ignore", over="ignore"):
            # 1 / (1 - s^-alpha), without the difference of two numbers near one; 0 at s = 0.
            powers = np.expm1(-self.alpha * np.log(np.minimum(distance, 1.0)))
            return np.where(inside, np.exp(-1.0 / powers), 0.0)

    def radial_spectrum(self, frequency: ArrayLike, dim: int, tolerance: float = 1e-12) -> Floats:
        """Fourier transform ``integral psi(x) exp(-2 pi i w.x) dx`` of the bump of radius 1, a function of ``k = |w|``.

        That of radius r is ``r^dim`` times this at ``k = r |w|``.

        Parameters
        ----------
        frequency : array-like, shape (...)
            ``k``, in cycles per radius, from 0 to 1e5 (any, for the indicator).
        dim : int
            2 or 3.
        tolerance : float
            Largest error, relative to the value at 0; from 1e-13 to 0.1.

        Raises
        ------
        InputError
            If a value is not usable.
        """
        k = check_not_negative(frequency, "frequency")
        within = check_tolerance(tolerance)
        check_kind(dim, "dim", (2, 3))
        if self.is_indicator:
            return _INDICATOR_SPECTRA[dim](k)
        self._check_frequency(float(k.max(initial=0.0)))
        return _transform(self, dim, within)(k)

    def table(self, dim: int, most: float, tolerance: float = 1e-12) -> Callable[[Floats], Floats]:
        """The same spectrum for many frequencies, computed once at some, and interpolated: a function of ``k``.

        Raises InputError where a value is not usable, then and when the function is asked beyond ``most``.
        """
        within = check_tolerance(tolerance)
        check_kind(dim, "dim", (2, 3))
        top = check_number(most, "most")
        if self.is_indicator:
            return _INDICATOR_SPECTRA[dim]
        self._check_frequency(top)
        return _table(self, dim, math.ceil(top), within)

    def pair_integral(self, first: float, second: float, distance: float, dim: int, tolerance: float = 1e-10) -> float:
        """Integral of ``psi(x / first) psi((x - distance e) / second)`` over the plane or space.

        It falls with the distance: both functions are spherically symmetric and fall towards their borders.

        Parameters
        ----------
        first, second, distance : float
            Radii, and the distance of the centres, metres.
        dim : int
        tolerance : float
            Largest error, relative to the integral itself or to 1e-60 of the smaller ball; from 1e-12 to 0.1.

        Returns
        -------
        float
            Metres to the power ``dim``; 0 from the sum of the radii on, or where it underflows.

        Raises
        ------
        InputError
            If a value is not usable.
        CspaceError
            If quadrature does not reach the tolerance.
        """
        a, b = positive(first, "first"), positive(second, "second")
        gap = check_number(distance, "distance")
        within = check_tolerance(tolerance, LEAST_PAIR_TOLERANCE)
        check_kind(dim, "dim", (2, 3))
        if self.is_indicator:
            return float(lens_measure(np.array(a), np.array(b), np.array(gap), dim))
        return product_integral(self.values, a, b, gap, dim, within)

    def _check_frequency(self, most: float) -> None:
        if most > MOST_FREQUENCY:
            rule = f"up to {MOST_FREQUENCY:g} are computed for finite alpha"
            raise InputError("frequency", f"holds {most:g} cycles per radius", rule, "check its units", value=most)


def check_bump(bump: Any) -> Bump:
    """The bump itself, or the usual one for None; InputError if it is neither."""
    if bump is not None and not isinstance(bump, Bump):
        raise InputError("bump", f"is {bump!r}", "it must be a Bump", "pass e.g. Bump(2.0)", value=bump)
    return Bump() if bump is None else bump


@lru_cache(maxsize=16)
def _transform(bump: Bump, dim: int, tolerance: float) -> RadialTransform:
    return RadialTransform(bump.values, dim, tolerance)


@lru_cache(maxsize=16)
def _table(bump: Bump, dim: int, most: int, tolerance: float) -> RadialTable:
    return RadialTable(_transform(bump, dim, 0.25 * tolerance)(table_points(most, 0.5 * tolerance)), most)


def _disc_spectrum(k: Floats) -> Floats:
    """Of the indicator of the unit disc: ``J1(2 pi k) / k``."""
    from scipy.special import j1

    small = k < 1e-150
    return np.where(small, math.pi, j1(2.0 * math.pi * k) / np.where(small, 1.0, k))


def _ball_spectrum(k: Floats) -> Floats:
    """Of the indicator of the unit ball: ``4 pi j1(x) / x`` with the spherical Bessel function and ``x = 2 pi k``."""
    from scipy.special import spherical_jn

    small = k < 1e-150
    x = 2.0 * math.pi * np.where(small, 1.0, k)
    return np.where(small, 4.0 / 3.0 * math.pi, 4.0 * math.pi * spherical_jn(1, x) / x)


_INDICATOR_SPECTRA: Final = {2: _disc_spectrum, 3: _ball_spectrum}

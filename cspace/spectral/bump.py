"""The bump: a radial function that is 1 at the centre of a ball and fades to 0 at its border."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import CspaceError, InputError
from cspace.grid import positive, unmasked
from cspace.spectral.inputs import check_kind, check_not_negative, check_number, check_tolerance
from cspace.spectral.radial import RadialTable, lens_measure, product_integrals, radial_transform, table_points

Floats = NDArray[np.float64]

LEAST_ALPHA: Final = 0.01
MOST_ALPHA: Final = 1e4

MOST_FREQUENCY: Final = 1e5
"""Up to here the phases that rounding leaves are right to 1e-10 radians, where the spectrum is small."""

PAIR_TOLERANCE: Final = 1e-9
"""Relative error of a pair's integral."""

FLOOR: Final = 1e-60
"""Part of the smaller ball's ``radius^dim`` below which the integral of a pair is known to that part of it only: there
the result hangs on the last bits of the radii."""

COUNTS: Final = (24, 48, 96, 192, 384)
"""Of nodes, for a pair's integral; two that follow each other must agree."""


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

    def radial_spectrum(self, frequency: ArrayLike, dim: int) -> Floats:
        """Fourier transform ``integral psi(x) exp(-2 pi i w.x) dx`` of the bump of radius 1, a function of ``k = |w|``.

        That of radius r is ``r^dim`` times this at ``k = r |w|``.

        Parameters
        ----------
        frequency : array-like, shape (...)
            ``k``, in cycles per radius, from 0 to 1e5.
        dim : int
            2 or 3.

        Returns
        -------
        ndarray of float64, shape (...)
            Right to 1e-13 of the value at 0.

        Raises
        ------
        InputError
            If a value is not usable.
        """
        k = _check_frequency(frequency, "frequency")
        check_kind(dim, "dim", (2, 3))
        return radial_transform(self.values, k, dim)

    def table(self, dim: int, most: float, tolerance: float = 1e-12) -> Callable[[Floats], Floats]:
        """The same spectrum for many frequencies, computed once at some, and interpolated: a function of ``k``.

        The tolerance, from 1e-13 to 0.1, is relative to the value at 0. Raises InputError where a value is not usable,
        then and when the function is asked beyond ``most``.
        """
        within = check_tolerance(tolerance)
        check_kind(dim, "dim", (2, 3))
        return _table(self, dim, math.ceil(_check_frequency(check_number(most, "most"), "most")), within)

    def pair_integral(self, first: float, second: float, distance: float, dim: int) -> float:
        """Integral of ``psi(x / first) psi((x - distance e) / second)`` over the plane or space.

        It falls with the distance: both functions are spherically symmetric and fall towards their borders.

        Parameters
        ----------
        first, second, distance : float
            Radii, and the distance of the centres, metres.
        dim : int

        Returns
        -------
        float
            Metres to the power ``dim``, right to 1e-9 of itself, or to 1e-60 of the smaller ball; 0 from the sum of
            the radii on, or where it underflows.

        Raises
        ------
        InputError
            If a value is not usable.
        CspaceError
            If the quadrature does not converge.
        """
        a, b = (np.array([positive(*named)]) for named in ((first, "first"), (second, "second")))
        gap = np.array([check_number(distance, "distance")])
        check_kind(dim, "dim", (2, 3))
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
        raise CspaceError("distance", f"is {distance!r}", "the integral of the two bumps must be within reach of rules")


def check_bump(bump: Any) -> Bump:
    """The bump itself, or the usual one for None; InputError if it is neither."""
    if bump is not None and not isinstance(bump, Bump):
        raise InputError("bump", f"is {bump!r}", "it must be a Bump", "pass e.g. Bump(2.0)", value=bump)
    return Bump() if bump is None else bump


def _check_frequency(frequency: ArrayLike, name: str) -> Floats:
    k = check_not_negative(frequency, name)
    most = float(k.max(initial=0.0))
    if most > MOST_FREQUENCY:
        rule = f"up to {MOST_FREQUENCY:g} are computed"
        raise InputError(name, f"holds {most:g} cycles per radius", rule, "check its units", value=most)
    return k


@lru_cache(maxsize=16)
def _table(bump: Bump, dim: int, most: int, tolerance: float) -> RadialTable:
    return RadialTable(radial_transform(bump.values, table_points(most, 0.5 * tolerance), dim), most)

"""Tables of radial spectra: Chebyshev interpolation, with an error that is proven from the band limit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError

Floats = NDArray[np.float64]

HALF: Final = 1.0
"""Half the width of an interval, in ``k``."""

SLACK: Final = 1e-9
"""By how much a frequency may lie beyond the table, relative, from rounding."""


class RadialTable:
    """A radial spectrum, interpolated.

    What vanishes beyond the unit ball has a spectrum that is a mixture of ``exp(2 pi i k x)`` with ``|x| <= 1``; where
    the function is not below zero, the mixture's weights sum to the spectrum at 0. So interpolation at Chebyshev nodes
    errs, relative to that value, by at most what it errs for one such exponential: four times the sum of the Bessel
    functions ``J_n(2 pi HALF)`` from the first degree left out (Trefethen, 2013, chapter 4).

    Parameters
    ----------
    values : ndarray, shape (intervals, nodes)
        The spectrum at :func:`table_points`.
    most : float
        Largest ``k`` that will be asked for.

    Attributes
    ----------
    most : float
    """

    def __init__(self, values: Floats, most: float) -> None:
        self.most = most
        count = values.shape[1]
        angles = math.pi * (np.arange(count) + 0.5) / count
        to_coefficients = 2.0 / count * np.cos(np.arange(count)[:, None] * angles)
        to_coefficients[0] /= 2.0
        self._coefficients = np.ascontiguousarray((values @ to_coefficients.T).T)

    @classmethod
    def of(cls, spectrum: Callable[[Floats], Floats], most: float, tolerance: float) -> RadialTable:
        """The table of a spectrum, known at any ``k`` from 0 on.

        Parameters
        ----------
        spectrum : callable
        most : float
            Largest ``k`` that will be asked for.
        tolerance : float
            Of the interpolation, relative to the value at 0; the spectrum's own error comes on top.
        """
        return cls(spectrum(table_points(most, tolerance)), most)

    def __call__(self, frequencies: Floats) -> Floats:
        """The spectrum at ``k``, of any shape, from 0 to :attr:`most`.

        Raises
        ------
        InputError
            If a frequency lies beyond the table.
        """
        k = np.asarray(frequencies, dtype=np.float64)
        if k.size and not (k.min() >= 0.0 and k.max() <= self.most * (1.0 + SLACK) + SLACK):
            raise InputError(
                f"the table is asked for frequencies from {k.min():g} to {k.max():g}; it holds those from 0 to "
                f"{self.most:g}; make it for the largest one"
            )
        interval = np.minimum((k / (2.0 * HALF)).astype(np.intp), self._coefficients.shape[1] - 1)
        x = k / HALF - (2.0 * interval + 1.0)
        # Clenshaw's recurrence.
        one, two, doubled = np.zeros_like(k), np.zeros_like(k), 2.0 * x
        for row in self._coefficients[:0:-1]:
            one, two = row[interval] + doubled * one - two, one
        return np.asarray(self._coefficients[0][interval] + x * one - two)


def table_points(most: float, tolerance: float) -> Floats:
    """Where a table up to ``most`` needs a spectrum, shape (intervals, nodes); the last may lie an interval beyond."""
    count = nodes_needed(tolerance, 2.0 * math.pi * HALF)
    intervals = max(1, math.ceil(most / (2.0 * HALF)))
    nodes = HALF * (1.0 + np.cos(math.pi * (np.arange(count) + 0.5) / count))
    return np.asarray(2.0 * HALF * np.arange(intervals)[:, None] + nodes)


def nodes_needed(tolerance: float, phase: float) -> int:
    """How many Chebyshev nodes an interval takes in whose half the exponentials turn by ``phase`` radians."""
    from scipy.special import jv

    terms = np.abs(jv(np.arange(int(2.0 * phase) + 80), phase))
    return int(np.argmax(4.0 * np.cumsum(terms[::-1])[::-1] <= tolerance))

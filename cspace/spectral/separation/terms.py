"""The terms of an overlap, and how far partial sums of them can be off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.separation.band import Spectrum
from cspace.spectral.separation.rings import Rings

Floats = NDArray[np.float64]

UNIT: Final = 2.0**-52
"""Relative rounding error of one operation, doubled."""

_ROOM: Final = 1.0 + 2.0**-30
"""For the rounding of the bounds themselves."""


@dataclass(frozen=True, eq=False, slots=True)
class Terms:
    """What each frequency adds to the overlap, and bounds for what is left out.

    Attributes
    ----------
    products : ndarray of complex128, shape (n,)
        ``F_B conj(F_A) / V``, in the order of the rings; doubled, but for frequency zero, for the opposite frequency.
    tails : ndarray of float64, shape (rings + 1,)
        Entry r bounds what all frequencies from ring r on can add, whatever the placement: within the band the sum of
        the moduli of their terms, and beyond it, by Cauchy and Schwarz, the product of the two norms there.
    slacks : ndarray of float64, shape (rings + 1, 2)
        How far the sum of the rings before r can be off, by rounding and by errors of the spectra: at any placement;
        and for each metre by which the placement itself may be off.
    """

    products: NDArray[np.complex128]
    tails: Floats
    slacks: Floats

    @classmethod
    def of(cls, first: Spectrum, second: Spectrum, rings: Rings) -> Terms:
        """The terms of the overlap of ``first`` (A), which is moved, with ``second`` (B)."""
        weights = rings.twice / float(np.prod(rings.lengths))
        products = weights * second.values * first.values.conj()
        a, b = np.abs(first.values), np.abs(second.values)
        moduli = np.abs(products)
        errors = weights * (a * second.error + b * first.error + first.error * second.error)
        per_ring, errors_per_ring = rings.sums(moduli), rings.sums(errors)
        beyond = math.sqrt(first.beyond) * math.sqrt(second.beyond)
        after = np.cumsum((per_ring + errors_per_ring)[::-1])[::-1]
        tails = _ROOM * (np.append(after, 0.0) + beyond)
        # A phase k t / L of an axis is off by some units times k; sums, by one for each term of a ring and each ring.
        counts = np.diff(rings.starts)
        units = 64.0 + counts + len(counts) + 8.0 * rings.reaches.sum(axis=1)
        off = errors_per_ring + UNIT * units * per_ring
        slopes = rings.sums(2.0 * math.pi * rings.moduli * (moduli + errors))
        slacks = _ROOM * np.cumsum(np.stack([off, slopes], axis=1), axis=0)
        return cls(products, tails, np.vstack([np.zeros((1, 2)), slacks]))

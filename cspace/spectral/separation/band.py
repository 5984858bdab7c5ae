"""How high the frequencies must go, and the spectra up to there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.separation.balls import ROUNDING

if TYPE_CHECKING:
    from cspace.spectral.descriptors import Bump
    from cspace.spectral.separation.balls import BallSet
    from cspace.spectral.separation.rings import Rings

Floats = NDArray[np.float64]

TOP: Final = 32.0
"""Highest frequency that is thought of, in cycles per radius of the smallest ball."""

_SAMPLES: Final = 4096


def highest_frequency(bump: Bump, a: BallSet, b: BallSet, bound: float) -> float:
    """An estimate of the frequency beyond which the overlap of two ball sets has less than ``bound``.

    Above the frequencies of the gaps between them, balls add their energies. So the energy of a set beyond a frequency
    is the sum of those of its bumps.

    Parameters
    ----------
    bump : Bump
    a, b : BallSet
    bound : float
        Metres to the power of the dimension.

    Returns
    -------
    float
        Cycles per metre; at most :data:`TOP` per radius of the smallest ball.
    """
    k = np.linspace(0.0, TOP, _SAMPLES)
    around = 2.0 * math.pi * k if a.dim == 2 else 4.0 * math.pi * k * k
    energy = bump.table(a.dim, TOP, 1e-9)(k) ** 2 * around
    beyond = np.cumsum(energy[::-1])[::-1] * k[1]
    least, most = (float(end([end(a.radii), end(b.radii)])) for end in (np.min, np.max))
    frequencies = np.geomspace(0.1 / most, TOP / least, 400)
    tails = []
    for balls in (a, b):
        radii, counts = np.unique(balls.radii, return_counts=True)
        tail = sum(n * r**a.dim * np.interp(r * frequencies, k, beyond) for r, n in zip(radii, counts, strict=True))
        tails.append(tail)
    enough = np.sqrt(tails[0]) * np.sqrt(tails[1]) <= bound
    return float(frequencies[np.argmax(enough)] if enough.any() else frequencies[-1])


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """A descriptor's spectrum within a band, and what is known of it beyond.

    Attributes
    ----------
    values : ndarray of complex128, shape (n,)
        ``F(w)``, with the origin in the balls' middle, in the order of the rings; metres to the power ``dim``.
    error : float
        By how much each may be off.
    beyond : float
        Upper bound of the energy of all frequencies outside the band: the integral of the descriptor's square, known
        exactly from the pairs of its balls, less what the band holds (Parseval).
    """

    values: NDArray[np.complex128]
    error: float
    beyond: float

    @classmethod
    def of(
        cls, balls: BallSet, middle: Floats, bump: Bump, rings: Rings, accuracy: float, norm: tuple[float, float]
    ) -> Spectrum:
        """The spectrum of a ball set.

        Parameters
        ----------
        balls : BallSet
        middle : ndarray of float64, shape (d,)
            The point that becomes the origin.
        bump : Bump
        rings : Rings
        accuracy : float
            Of the transform, relative to the value at frequency zero.
        norm : tuple of float
            As from :func:`cspace.spectral.separation.pairs.norm_square`.
        """
        from cspace.spectral.descriptors import ball_spectrum

        box = ball_spectrum(balls.centers - middle, balls.radii, bump, rings.lengths, rings.counts, accuracy)
        values = rings.half_of(box)
        mass = float(bump.radial_spectrum(0.0, balls.dim)) * float((balls.radii**balls.dim).sum())
        moved = ROUNDING * (balls.span + float(np.abs(middle).max()))
        error = mass * (2.0 * accuracy + 2.0 * math.pi * float(rings.moduli.max()) * moved)
        moduli, volume = np.abs(values), float(np.prod(rings.lengths))
        inside = float((rings.twice * moduli * (moduli - 2.0 * error)).sum()) / volume
        total, off = norm
        return cls(values, error, max(0.0, total - inside) + off + 2.0**-44 * total)

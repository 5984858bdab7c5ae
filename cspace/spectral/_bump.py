"""The bump of ball descriptors, and its Fourier transform.

The bump is a radial function. Its integrals are trapezoidal sums in u with ``s = 1 / (1 + exp(-pi
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

from cspace.errors import InputError
from cspace.inside import Floats, check_finite, check_real, check_word

Radial = Callable[[Floats], Floats]
"""Function of the distance from the center, in radii, or of a frequency."""

UNIT_BALL_VOLUME: Final = {2: math.pi, 3: 4.0 / 3.0 * math.pi}
"""Area of the unit disc and volume of the unit ball, by dimension."""

TRANSFORM_ERROR: Final = 1e-13
"""Relative error of radial spectra and their tables."""

NODES_PER_CYCLE: Final = 24
"""Chebyshev nodes in an interval of a table, which is one cycle per radius wide.

A function that vanishes outside the unit ball has a spectrum that is a mixture of ``exp(2 pi i k
x)`` with ``|x| <= 1``. If it is not negative, the weights of the mixture sum to the spectrum at 0.
So the relative error of interpolation is at most that for one such exponential: four times the sum
of the Bessel functions ``J_n(pi)`` from n = 24 on, below 1e-18 (Trefethen, 2013, chapter 4).
"""


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
        given = check_real(self.alpha, "alpha")
        alpha = math.nan if given.ndim else float(given)
        # Smallest and largest finite exponent of a bump.
        low, high = 0.01, 1e4
        if not (low <= alpha <= high or alpha == math.inf):
            raise InputError(
                "alpha",
                f"is {self.alpha!r}",
                f"it must be one number from {low:g} to {high:g}, or infinite",
            )
        object.__setattr__(self, "alpha", alpha)

    def profile(self, distance: ArrayLike) -> Floats:
        """Evaluate the bump at signed distances, in radii."""
        distances = np.abs(check_finite(distance, "distance"))
        if self.alpha == math.inf:
            return np.asarray((distances < 1.0).astype(np.float64))
        with np.errstate(divide="ignore", over="ignore"):
            logarithms = np.log(np.minimum(distances, 1.0))
            # expm1 avoids the cancellation in s^-alpha - 1; it is infinite at s = 0, and +0 from s
            # = 1 on.
            powers = np.expm1(0.0 - self.alpha * logarithms)
            return np.asarray(np.exp(-1.0 / powers))

    def radial_spectrum(self, frequency: ArrayLike, dim: int) -> Floats:
        """Compute the Fourier transform of the bump.

        It is ``integral psi(x) exp(-2 pi i w.x) dx``, for radius 1; a bump of radius r has
        ``r^dim`` times its value at ``k = r |w|``. ``frequency``, shape (...), is in cycles per
        radius, up to 1e5 in modulus; ``dim`` is 2 or 3. The error is at most 1e-13 of the value at
        0. Raises InputError for other frequencies or dimensions.
        """
        check_word(dim, "dim", (2, 3))
        k = np.abs(check_finite(frequency, "frequency"))
        highest = k.max(initial=0.0)
        # Largest frequency of a spectrum, cycles per radius; up to it, rounded phases are accurate
        # to 1e-10 radians.
        max_radial_frequency = 1e5
        if highest > max_radial_frequency:
            raise InputError(
                "frequency",
                f"holds {highest:g} cycles per radius",
                f"it must be at most {max_radial_frequency:g}",
            )
        return _transform(self.profile, k, dim)

    def energy(self, dim: int) -> float:
        """Return the integral of the square of the bump, for radius 1."""
        return float(_transform(lambda s: self.profile(s) ** 2, np.zeros(1), dim)[0])


def check_bump(bump: Any) -> Bump:
    """Return a bump, or ``Bump()`` for None; raise InputError otherwise."""
    if bump is None:
        return Bump()
    if not isinstance(bump, Bump):
        raise InputError("bump", f"is {bump!r}", "it must be a Bump")
    return bump


def sphere_measure(radius: Floats, dim: int) -> Floats:
    """Return a circle's length or a sphere's area."""
    return np.asarray(dim * UNIT_BALL_VOLUME[dim] * radius ** (dim - 1))


@lru_cache(maxsize=16)
def radial_table(bump: Bump, dim: int, highest: int) -> Radial:
    """Return a function that interpolates :meth:`Bump.radial_spectrum` up to ``highest``.

    Its error is at most 2e-13 of the value at 0. Its intervals are one cycle per radius wide.
    """
    from scipy.fft import dct

    nodes = np.cos(math.pi * (np.arange(NODES_PER_CYCLE) + 0.5) / NODES_PER_CYCLE)
    places = np.arange(highest)[:, None] + 0.5 * (1.0 + nodes)
    coefficients = dct(bump.radial_spectrum(places, dim), axis=1).T / NODES_PER_CYCLE
    coefficients[0] /= 2.0

    def interpolate(frequencies: Floats) -> Floats:
        """Evaluate the polynomial of the interval of each frequency."""
        interval = np.minimum(frequencies.astype(np.intp), highest - 1)
        x = 2.0 * (frequencies - interval) - 1.0
        chosen = coefficients[:, interval]
        return np.asarray(np.polynomial.chebyshev.chebval(x, chosen, tensor=False))

    return interpolate


def _transform(function: Radial, frequencies: Floats, dim: int) -> Floats:
    """Compute the Fourier transform of a non-negative radial function.

    In the plane it is ``2 pi integral_0^1 f(s) J0(2 pi k s) s ds``, in space ``4 pi integral_0^1
    f(s) sinc(2 k s) s^2 ds`` with ``sinc(x) = sin(pi x) / (pi x)``. The error is at most 1e-13 of
    the value at 0.
    """
    from scipy.special import j0

    kernel = {2: lambda x: j0(math.pi * x), 3: np.sinc}[dim]
    flat = np.ravel(frequencies)
    # The phase of the kernel advances by 2 pi k ds/du, and ds/du is at most pi / 4; add samples
    # accordingly, a tenth more than that because errors die out only some way beyond it.
    highest = flat.max(initial=0.0)
    # Nodes on either side of u = 0 for frequency 0; two thirds leave errors of 1e-14 for all
    # alpha.
    # Largest modulus of u in a sum; nodes beyond it lie within 1e-18 of the ends of the interval.
    max_abscissa = 3.3
    count = math.ceil(160 + 1.1 * max_abscissa * math.pi / 4.0 * highest)
    step = max_abscissa / count
    u = step * np.arange(-count, count + 1)
    decay = np.exp(-math.pi * np.sinh(u))
    s = 1.0 / (1.0 + decay)
    complements = decay * s  # 1 - s, without cancellation
    weights = step * math.pi * np.cosh(u) * s * complements
    measure = weights * function(s) * sphere_measure(s, dim)
    # Blocks of frequencies bound the memory.
    blocks = np.array_split(flat, math.ceil((1 + flat.size) * s.size / 2**21))
    values = [kernel(2.0 * np.outer(block, s)) @ measure for block in blocks]
    return np.concatenate(values).reshape(np.shape(frequencies))

"""Proofs that an overlap is below or above a threshold, from few frequencies."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._shapes import Balls
from cspace._support.arrays import Bytes, Floats, Ints
from cspace._support.check import check_points, check_positive
from cspace._support.compiling import allocating
from cspace.errors import InputError
from cspace.spectral._ball_sets import PLACEMENT_ROUNDING
from cspace.spectral._bump import TRANSFORM_ERROR
from cspace.spectral._overlap import FourierOverlap
from cspace.spectral._spectra import MIN_SPECTRUM_TOLERANCE, Complexes, RadialFactors
from cspace.spectral._trees import HIT, MISS, UNDECIDED

ROUNDING_UNIT: Final = 2.0**-52
"""Twice the relative rounding error of one operation."""

BOUND_ROUNDING: Final = 1.0 + 2.0**-30
"""Factor that covers the rounding of the bounds themselves."""


class Comparison(NamedTuple):
    """Verdicts about an overlap at placements, and their cost; arrays of one shape (...).

    ``verdict`` is of uint8, :attr:`Verdict.MISS` if the overlap is below the threshold,
    :attr:`Verdict.HIT` if above, else :attr:`Verdict.UNDECIDED`. ``frequencies`` is the number of
    frequencies summed, opposite ones counted once. ``overlap`` is their sum, and ``bound`` its
    largest difference to the ideal overlap of all frequencies, in square or cubic metres.
    """

    verdict: Bytes
    frequencies: Ints
    overlap: Floats
    bound: Floats


class EarlyTest:
    """Test whether an overlap is below or above a threshold, by as few frequencies as decide.

    The terms of an overlap are summed from the largest down, until the sum and a bound of the
    remainder prove the answer about the ideal overlap, which has all frequencies. Whether two ball
    sets touch at all, :class:`ContactTest` tells sooner.

    Parameters
    ----------
    overlap : FourierOverlap
        Flat bumps and low bands leave more undecided.
    threshold : float
        Square or cubic metres, above zero.

    Raises InputError if the threshold is not usable.
    """

    def __init__(self, overlap: FourierOverlap, threshold: float) -> None:
        """Sort the terms, and bound what is left after each."""
        argument: object = overlap
        if not isinstance(argument, FourierOverlap):
            raise InputError(
                "overlap",
                f"is a {type(argument).__name__}",
                "it must be a FourierOverlap",
                "pass FourierOverlap(a, b)",
            )
        self.overlap = overlap
        self.threshold = check_positive(threshold, "threshold", "square or cubic metres")
        lattice = overlap.lattice
        volume = float(np.prod(lattice.periods))
        moduli_a, moduli_b, frequencies, products = (
            _keep_half(values)
            for values in (
                np.abs(overlap.spectrum_a),
                np.abs(overlap.spectrum_b),
                lattice.moduli,
                overlap.products,
            )
        )
        grids = np.meshgrid(*lattice.indices, indexing="ij")
        indices = np.stack([_keep_half(k) for k in grids], axis=1).astype(np.int32)
        twice = np.full(len(products), 2.0)
        twice[0] = 1.0
        weights = twice / volume
        moduli = weights * moduli_a * moduli_b
        order = np.argsort(-moduli, kind="stable")
        self._products = (products * twice)[order]
        self._indices = indices[order]
        # Within the band, the sum of the moduli bounds the remaining terms. Beyond, the product of
        # the two norms does (Cauchy and Schwarz).
        remaining = np.append(np.cumsum(moduli[order][::-1])[::-1], 0.0)
        energy = overlap.bump.energy(overlap.dim)
        tail_a, tail_b = (
            _bound_norm_beyond(factors, energy, volume)
            for factors in (overlap.factors_a, overlap.factors_b)
        )
        error_a, error_b = (
            _bound_spectrum_error(balls, overlap, float(frequencies.max()))
            for balls in (overlap.a, overlap.b)
        )
        errors = weights * (moduli_a * error_b + moduli_b * error_a + error_a * error_b)
        # The phases of an axis have an error of a few units times k; sums add one unit per term.
        units = 64.0 + len(products) + 4.0 * sum(lattice.counts)
        placing = 2.0 * math.pi * overlap.placement_error * frequencies @ (moduli + errors)
        fixed = errors.sum() + ROUNDING_UNIT * units * moduli.sum() + placing + tail_a * tail_b
        self._bounds = BOUND_ROUNDING * (remaining + fixed)

    @property
    def bound(self) -> float:
        """Largest difference of the sum of all frequencies of the band from the ideal overlap."""
        return float(self._bounds[-1])

    def compare(self, t: ArrayLike) -> Comparison:
        """Compare the overlap with A moved by t, shape (..., d), metres, with the threshold."""
        overlap = self.overlap
        placements = check_points(t, "t", overlap.dim)
        shares = overlap.relative(placements) / overlap.lattice.periods
        # Beyond a period, copies of A would meet B; the sets are apart there.
        is_far = (np.abs(shares) > 0.5).any(axis=-1)
        terms = self._products, self._indices, self._bounds
        half = max(overlap.lattice.counts) // 2
        columns = Comparison(*sum_until_decided(shares, *terms, half, self.threshold))
        shaped: list[NDArray[Any]] = []
        for column in columns:
            column[is_far] = 0
            shaped.append(column.reshape(placements.shape[:-1]))
        return Comparison(*shaped)


def _keep_half(values: NDArray[Any]) -> NDArray[Any]:
    """Return the values of frequency zero, and of one of each two opposite frequencies.

    Descriptors are real, so opposite frequencies have conjugate terms.
    """
    # Along each axis the number of frequencies is odd: zero has the middle, and opposite ones lie
    # as far before it as behind.
    return np.fft.fftshift(values).reshape(-1)[values.size // 2 :]


def _bound_norm_beyond(factors: RadialFactors, energy: float, volume: float) -> float:
    """Bound the norm of what a set of balls has beyond the band.

    It is at most the sum of the norms of its balls. By Parseval's theorem, the square of such a
    norm is the energy of a ball, ``energy`` times ``radius^dim``, minus its energy in the band.
    """
    total = 0.0
    dim = len(factors.lattice.counts)
    for members, factor in factors.groups:
        at_zero = float(factor.reshape(-1)[0])
        in_band = float((factor**2).sum()) / volume
        error = 8.0 * TRANSFORM_ERROR * at_zero * float(np.abs(factor).sum()) / volume
        whole = energy * factors.radii[members[0]] ** dim
        beyond = max(0.0, whole - in_band) + error + 1e-12 * whole
        total += len(members) * math.sqrt(beyond)
    return total


def _bound_spectrum_error(balls: Balls, overlap: FourierOverlap, highest: float) -> float:
    """Bound the error of the spectrum of balls about their center."""
    whole = float(overlap.bump.radial_spectrum(0.0, balls.dim) * (balls.radii**balls.dim).sum())
    rounding = 2.0 * PLACEMENT_ROUNDING * overlap.span
    error = whole * (2.0 * MIN_SPECTRUM_TOLERANCE + 2.0 * math.pi * highest * rounding)
    # A step replaces a part of the spectrum: it adds the errors of the part before and after.
    return (1.0 + 2.0 * overlap.steps) * error


@allocating
def sum_until_decided(
    shares: Floats,
    products: Complexes,
    indices: NDArray[np.int32],
    bounds: Floats,
    half: int,
    threshold: float,
) -> tuple[Bytes, Ints, Floats, Floats]:
    """Sum terms at placements until they are proven below or above a threshold.

    ``shares``, shape (n, d), are placements as shares of a period. ``products`` and ``indices``,
    shapes (m,) and (m, d), are the factors of the waves and their frequencies, at most ``half``.
    ``bounds``, shape (m + 1,), bound what is left after each number of terms. Returns verdicts,
    numbers of terms, sums, and their bounds, shape (n,) each.
    """
    number, dim = shares.shape
    verdicts = np.full(number, UNDECIDED, dtype=np.uint8)
    counts = np.zeros(number, dtype=np.int64)
    sums = np.zeros(number)
    rests = np.zeros(number)
    # waves[axis, half + k] is exp(2 pi i k t / L) along an axis.
    waves = np.empty((dim, 2 * half + 1), np.complex128)
    for n in range(number):
        for axis in range(dim):
            for k in range(half + 1):
                # Each factor is computed on its own, so that errors do not accumulate.
                turns = k * shares[n, axis]
                angle = 2.0 * math.pi * (turns - round(turns))
                wave = complex(math.cos(angle), math.sin(angle))
                waves[axis, half + k] = wave
                waves[axis, half - k] = wave.conjugate()
        total = 0.0
        count = 0
        while True:
            if total + bounds[count] < threshold:
                verdicts[n] = MISS
            elif total - bounds[count] > threshold:
                verdicts[n] = HIT
            if verdicts[n] != UNDECIDED or count == len(products):
                break
            product = products[count]
            wave = waves[0, half + indices[count, 0]] * waves[1, half + indices[count, 1]]
            if dim == 3:
                wave *= waves[2, half + indices[count, 2]]
            total += product.real * wave.real - product.imag * wave.imag
            count += 1
        counts[n] = count
        sums[n] = total
        rests[n] = bounds[count]
    return verdicts, counts, sums, rests

"""Proofs that an overlap is below or above a threshold, from few frequencies."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.inside import AXES, Balls, Bytes, Ints, check_points, check_positive
from cspace.spectral._ball_sets import PLACEMENT_ROUNDING
from cspace.spectral._bump import TRANSFORM_ERROR
from cspace.spectral._overlap import FourierOverlap
from cspace.spectral._spectra import MIN_SPECTRUM_TOLERANCE, RadialFactors
from cspace.spectral._trees import HIT, MISS, UNDECIDED

MIN_TERMS_PER_BLOCK: Final = 32
"""Number of terms that are summed before the first placements are decided."""

MAX_BLOCK_SIZE: Final = 2**21
"""Number of terms at all placements that are summed at a time, to bound the memory."""


class Comparison(NamedTuple):
    """Verdicts about an overlap at placements, and their cost; arrays of one shape (...).

    ``verdict`` is of uint8, :attr:`Verdict.MISS` if the overlap is below the threshold,
    :attr:`Verdict.HIT` if above, else :attr:`Verdict.UNDECIDED`. ``frequencies`` is the number of
    frequencies summed, opposite ones counted once.
    """

    verdict: Bytes
    frequencies: Ints


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
        """Sort the terms, and bound the rest after each."""
        argument: object = overlap
        if not isinstance(argument, FourierOverlap):
            raise InputError(
                "overlap",
                f"is a {type(argument).__name__}",
                "it must be a FourierOverlap",
            )
        self.overlap = overlap
        self.threshold = check_positive(threshold, "threshold", "square or cubic metres")
        lattice = overlap.lattice
        volume = float(np.prod(lattice.periods))
        moduli_a, moduli_b, frequencies, phases = (
            _keep_half(values)
            for values in (
                np.abs(overlap.spectrum_a),
                np.abs(overlap.spectrum_b),
                lattice.moduli,
                np.angle(overlap._products),
            )
        )
        grids = np.meshgrid(*lattice.indices, indexing="ij")
        weights = np.full(len(phases), 2.0 / volume)
        weights[0] = 1.0 / volume
        moduli = weights * moduli_a * moduli_b
        order = np.argsort(-moduli, kind="stable")
        self._moduli = moduli[order]
        self._phases = phases[order]
        self._indices = np.stack([_keep_half(k)[order] for k in grids])
        # Within the band, the sum of the moduli bounds the remaining terms. Beyond, the product of
        # the two norms does (Cauchy and Schwarz).
        remaining = np.append(np.cumsum(self._moduli[::-1])[::-1], 0.0)
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
        # Angles have an error of a few units times k of each axis; sums add one unit per term.
        units = 64.0 + len(moduli) + 8.0 * sum(lattice.counts)
        placing = 2.0 * math.pi * overlap._placement_error * frequencies @ (moduli + errors)
        # Twice the relative rounding error of one operation.
        fixed = errors.sum() + 2.0**-52 * units * moduli.sum() + placing + tail_a * tail_b
        # Factor that covers the rounding of the bounds themselves.
        self._bounds = (1.0 + 2.0**-30) * (remaining + fixed)

    def __repr__(self) -> str:
        """Return the overlap and the threshold."""
        return f"EarlyTest({self.overlap!r}, threshold={self.threshold:g})"

    @property
    def bound(self) -> float:
        """Largest difference of the band's sum from the ideal overlap."""
        return float(self._bounds[-1])

    def compare(self, t: ArrayLike) -> Comparison:
        """Compare the overlap at t (..., d), metres, with the threshold."""
        overlap = self.overlap
        placements = check_points(t, "t", AXES[: overlap.dim])
        shares = overlap._relative(placements) / overlap.lattice.periods
        # Beyond a period, copies of A would meet B; the sets are apart there.
        is_near = (np.abs(shares) <= 0.5).all(axis=-1)
        verdicts = np.where(is_near, UNDECIDED, MISS).astype(np.uint8)
        counts = np.where(is_near, len(self._moduli), 0)
        sums = np.zeros(len(shares))
        rows = np.flatnonzero(is_near)  # the placements that are not decided yet
        start = 0
        while len(rows) and start < len(self._moduli):
            # Sum as many terms as before, so that few placements take few steps.
            size = min(max(start, MIN_TERMS_PER_BLOCK), 1 + MAX_BLOCK_SIZE // len(rows))
            block = slice(start, start + size)
            turns = np.einsum("nd,dm->nm", shares[rows], self._indices[:, block])
            terms = self._moduli[block] * np.cos(2.0 * math.pi * turns + self._phases[block])
            # The sums before the block and after each of its terms.
            partial = np.cumsum(np.column_stack([sums[rows], terms]), axis=1)
            bounds = self._bounds[start : start + partial.shape[1]]
            is_below = partial + bounds < self.threshold
            is_decided = is_below | (partial - bounds > self.threshold)
            first = is_decided.argmax(axis=1)
            is_done = is_decided.any(axis=1)
            done = rows[is_done]
            counts[done] = start + first[is_done]
            verdicts[done] = np.where(is_below[is_done, first[is_done]], MISS, HIT)
            sums[rows] = partial[:, -1]
            rows = rows[~is_done]
            start += size
        shape = placements.shape[:-1]
        return Comparison(verdicts.reshape(shape), counts.reshape(shape))


def _keep_half(values: NDArray[Any]) -> NDArray[Any]:
    """Keep values of one of each two opposite frequencies.

    Descriptors are real, so opposite frequencies have conjugate terms.
    """
    # Along each axis the number of frequencies is odd: zero has the middle, and opposite ones lie
    # as far before it as behind.
    return np.fft.fftshift(values).reshape(-1)[values.size // 2 :]


def _bound_norm_beyond(factors: RadialFactors, energy: float, volume: float) -> float:
    """Bound the norm of balls beyond the band.

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

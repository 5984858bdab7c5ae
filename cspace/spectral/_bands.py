"""Bands of frequencies: overlaps summed ring by ring, with bounds of what is left out.

Proofs of overlaps sum the terms of two spectra from the lowest frequency, and bound the remainder.
Norms come from the overlaps of pairs of balls.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._support.arrays import Bytes, Floats, Ints
from cspace._support.compiling import allocating
from cspace.spectral._bump import sphere_measure
from cspace.spectral._descriptors import PLACEMENT_ROUNDING, BallDescriptor
from cspace.spectral._spectra import MIN_SPECTRUM_TOLERANCE, Complexes, ball_spectrum
from cspace.spectral._trees import HIT, MISS, UNDECIDED

ROUNDING_UNIT: Final = 2.0**-52
"""Twice the relative rounding error of one operation."""

MAX_CYCLES_PER_RADIUS: Final = 32.0
"""Highest frequency considered for a band, cycles per radius of the smallest ball."""

BOUND_ROUNDING: Final = 1.0 + 2.0**-30
"""Factor that covers the rounding of the bounds themselves."""


def estimate_band(a: BallDescriptor, b: BallDescriptor, bound: float) -> float:
    """Estimate the frequency, cycles per metre, with ``bound`` left above it.

    Above the frequencies of the gaps between balls, their energies add up: the energy of a set is
    the sum of the energies of its bumps. The result is at most :data:`MAX_CYCLES_PER_RADIUS` of the
    smallest ball.
    """
    # Energy of the unit bump above each frequency k, in cycles per radius.
    k = np.linspace(0.0, MAX_CYCLES_PER_RADIUS, 4096)
    spectrum = a.bump.table(a.dim, MAX_CYCLES_PER_RADIUS, 1e-9)
    densities = spectrum(k) ** 2 * sphere_measure(k, a.dim)
    sums_from_above = np.cumsum(densities[::-1])[::-1]
    energies_above = sums_from_above * k[1]
    # Energies of both sets above each candidate; a ball of radius r scales them by r^dim.
    all_radii = np.concatenate([a.radii, b.radii])
    frequencies = np.geomspace(0.1 / all_radii.max(), MAX_CYCLES_PER_RADIUS / all_radii.min(), 400)
    tail_a, tail_b = (
        balls.radii**a.dim @ np.interp(np.outer(balls.radii, frequencies), k, energies_above)
        for balls in (a, b)
    )
    is_enough = np.sqrt(tail_a) * np.sqrt(tail_b) <= bound
    is_enough[-1] = True
    return float(frequencies[np.argmax(is_enough)])


class Rings(NamedTuple):
    """Frequencies ``k / lengths``, ``|k| <= halves``, in rings of similar moduli.

    Descriptors are real, so opposite frequencies have conjugate terms; only frequency zero and the
    frequencies whose first non-zero entry is positive are stored. ``lengths`` are the periods,
    metres. ``indices``, shape (n, d), are k, ``moduli`` are ``|w|`` in cycles per metre, and
    ``twice`` is 1 for frequency zero and 2 for the others, all in ring order. Ring r starts at
    ``starts[r]``; the first one is frequency zero alone.
    """

    lengths: Floats
    halves: tuple[int, ...]
    indices: NDArray[np.int16]
    moduli: Floats
    twice: Floats
    starts: Ints

    @classmethod
    def of(cls, lengths: Floats, halves: tuple[int, ...]) -> Rings:
        """Build rings, each one cycle wide in the longest period."""
        axes = [np.arange(-half, half + 1, dtype=np.int16) for half in halves]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(halves))
        # The middle one is frequency zero, and those before are opposite to those after.
        stored = box[len(box) // 2 :]
        # Sort by rings; 1e-9 keeps rounding from moving a frequency to the next ring.
        moduli = np.linalg.norm(stored / lengths, axis=1)
        ring_numbers = np.ceil(moduli * lengths.max() - 1e-9).astype(np.int64)
        order = np.argsort(ring_numbers, kind="stable")
        ring_sizes = np.bincount(ring_numbers)
        starts = np.append(0, np.cumsum(ring_sizes[ring_sizes > 0]))
        indices = np.ascontiguousarray(stored[order])
        twice = np.full(len(order), 2.0)
        twice[0] = 1.0
        return cls(lengths, halves, indices, moduli[order], twice, starts)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of frequencies along each axis, both halves, so odd."""
        return tuple(2 * half + 1 for half in self.halves)

    @property
    def volume(self) -> float:
        """Volume of a period, metres to the power ``dim``."""
        return float(np.prod(self.lengths))

    def sums(self, values: Floats) -> Floats:
        """Sum values, given in ring order, over each ring."""
        return np.asarray(np.add.reduceat(values, self.starts[:-1]))

    def to_rings(self, box: Complexes) -> Complexes:
        """Convert a spectrum, shape ``counts``, from numpy's order to ring order, shape (n,)."""
        return box.reshape(-1)[self._flat_indices(1)]

    def to_box(self, half: Complexes) -> Complexes:
        """Convert half a spectrum in ring order, shape (n,), to numpy's order.

        Opposite frequencies get the conjugate values.
        """
        flat = np.empty(math.prod(self.counts), dtype=np.complex128)
        flat[self._flat_indices(-1)] = half.conj()
        flat[self._flat_indices(1)] = half
        return flat.reshape(self.counts)

    def _flat_indices(self, sign: int) -> Ints:
        """Return flat indices in numpy's order of the frequencies times ``sign``."""
        columns = sign * self.indices.T.astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(columns), self.counts, mode="wrap"))


class Spectrum(NamedTuple):
    """Band-limited spectrum of a descriptor, about the center of its balls.

    ``values``, in ring order, are in metres to the power ``dim``; ``error`` bounds the error of
    each.
    """

    values: Complexes
    error: float

    @classmethod
    def of(
        cls,
        balls: BallDescriptor,
        center: Floats,
        rings: Rings,
        accuracy: float = MIN_SPECTRUM_TOLERANCE,
        weights: Floats | None = None,
    ) -> Spectrum:
        """Compute the spectrum of balls about a point, times ``weights``, at most 1."""
        box = ball_spectrum(
            balls.centers - center,
            balls.radii,
            balls.bump,
            rings.lengths,
            rings.counts,
            accuracy,
            weights=weights,
        )
        rounding = PLACEMENT_ROUNDING * (balls.span + float(np.abs(center).max()))
        phase_error = 2.0 * math.pi * float(rings.moduli.max()) * rounding
        return cls(rings.to_rings(box), balls.integral * (2.0 * accuracy + phase_error))

    def tail(self, rings: Rings, norm: tuple[float, float]) -> float:
        """Return an upper bound of the energy outside the band.

        By Parseval's theorem, that is the whole energy minus the energy in the band. ``norm`` is
        the result of :func:`cspace.spectral._pairs.norm_square`.
        """
        moduli = np.abs(self.values)
        total, total_error = norm
        squares = moduli * (moduli - 2.0 * self.error)  # lower bounds
        energy_in_band = float((rings.twice * squares).sum()) / rings.volume
        # 2^-44 allows for the rounding of the sum.
        return max(0.0, total - energy_in_band) + total_error + 2.0**-44 * total


class Terms(NamedTuple):
    """Terms of the overlap, with bounds of partial sums, for kernels.

    ``products`` are ``F_B conj(F_A) / V`` in ring order, doubled for the opposite frequency.
    ``bounds[r]``, shape (rings + 1,), is the largest difference of the sum of the rings before r
    from the sum of all frequencies, at any placement: the remaining rings, rounding and the errors
    of the spectra.
    """

    products: Complexes
    bounds: Floats
    rings: Rings

    @classmethod
    def of(cls, first: Spectrum, second: Spectrum, rings: Rings, far: float, tail: float) -> Terms:
        """Build the terms of the overlap of A, first, with B.

        Within the band, the sum of the moduli bounds the remaining terms. Outside, ``tail`` does,
        the product of the two tail norms (Cauchy and Schwarz). ``far``, in metres, bounds the
        rounding of a placement.
        """
        weights = rings.twice / rings.volume
        products = weights * second.values * first.values.conj()
        moduli_a = np.abs(first.values)
        moduli_b = np.abs(second.values)
        moduli = np.abs(products)
        errors = weights * (
            moduli_a * second.error + moduli_b * first.error + first.error * second.error
        )
        # What is left from each ring on: the sum of the rings from the last one backwards.
        moduli_per_ring = rings.sums(moduli)
        errors_per_ring = rings.sums(errors)
        remaining = np.cumsum((moduli_per_ring + errors_per_ring)[::-1])[::-1]
        # The phase k t / L of an axis has an error of a few units times k. Sums add one unit per
        # term and per ring.
        counts = np.diff(rings.starts)
        units = 64.0 + counts + len(counts) + 8.0 * sum(rings.halves)
        rounding = ROUNDING_UNIT * units * moduli_per_ring
        placement_errors = 2.0 * math.pi * far * rings.sums(rings.moduli * (moduli + errors))
        summed = np.cumsum(errors_per_ring + rounding + placement_errors)
        bounds = BOUND_ROUNDING * (np.append(remaining, 0.0) + tail + np.append(0.0, summed))
        return cls(products, bounds, rings)


# ---- compiled sums, ring by ring -----------------------------------------------------------------


@allocating
def separate_all(placements: Floats, terms: Terms, threshold: float) -> tuple[Bytes, Ints, Floats]:
    """Sum overlaps ring by ring until they are proven below or above a threshold.

    Placements (n, d), metres, are those of the center of A relative to the center of B. Returns
    verdicts (n,): MISS or HIT if the sum and its bound prove it, else UNDECIDED, as for a threshold
    of NaN; the numbers of frequencies summed (n,); and the sums with their bounds (n, 2).
    """
    products = terms.products
    indices = terms.rings.indices
    starts = terms.rings.starts
    number, dim = placements.shape
    zero = max(terms.rings.halves)
    verdicts = np.full(number, UNDECIDED, dtype=np.uint8)
    counts = np.empty(number, np.int64)
    sums = np.empty((number, 2))
    # waves[axis, zero + k] is exp(2 pi i k t / L) along an axis.
    waves = np.empty((dim, 2 * zero + 1), np.complex128)
    for n in range(number):
        for axis in range(dim):
            share = placements[n, axis] / terms.rings.lengths[axis]
            for k in range(terms.rings.halves[axis] + 1):
                # Each factor is computed on its own, so that errors do not accumulate.
                turns = k * share
                angle = 2.0 * math.pi * (turns - round(turns))
                wave = complex(math.cos(angle), math.sin(angle))
                waves[axis, zero + k] = wave
                waves[axis, zero - k] = wave.conjugate()
        # Sum ring by ring; a wave of k is the product of its waves along the axes.
        total = 0.0
        for ring in range(len(starts) - 1):
            for term in range(starts[ring], starts[ring + 1]):
                product = products[term]
                wave = waves[0, zero + indices[term, 0]] * waves[1, zero + indices[term, 1]]
                if dim == 3:
                    wave *= waves[2, zero + indices[term, 2]]
                total += product.real * wave.real - product.imag * wave.imag
            bound = terms.bounds[ring + 1]
            if total + bound < threshold:
                verdicts[n] = MISS
            elif total - bound > threshold:
                verdicts[n] = HIT
            counts[n] = starts[ring + 1]
            sums[n, 0] = total
            sums[n, 1] = bound
            if verdicts[n] != UNDECIDED:
                break
    return verdicts, counts, sums

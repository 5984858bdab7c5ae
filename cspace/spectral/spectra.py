"""Spectra of sets of balls with arbitrary centers.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of one radius have
that radial factor times the spectrum of their centers, which one non-uniform FFT of type 1 computes (Dutt and Rokhlin,
1993; Barnett, Magland and af Klinteberg, 2019). For a radius of few balls, their terms are summed as products of one
factor per axis; for many radii, a few transforms serve all (:func:`radius_basis`).

*Error.* All bumps are non-negative, so the spectrum is largest at frequency 0, where it is the integral of the
descriptor; tolerances are relative to that value. Half of a tolerance is for the table of ``psi^``, half for the
transforms.

*Bands.* Proofs of overlaps sum the terms of two spectra ring by ring, from the lowest frequency, and bound the
remainder. Norms and thresholds come from the overlaps of pairs of balls.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bytes, Floats, Ints
from cspace.check import check_finite
from cspace.compiling import allocating, kernel
from cspace.errors import InputError, import_optional
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, count_cells, free_bytes
from cspace.spectral.bump import (
    MIN_TOLERANCE,
    SAFETY_FACTOR,
    TABLE_HALF_WIDTH,
    Bump,
    RadialTable,
    chebyshev_coefficients,
    chebyshev_nodes,
    check_bump,
    check_tolerance,
    count_nodes,
    pair_integrals,
    radial_transform,
    sphere_measure,
    table_points,
)
from cspace.spectral.descriptors import PLACEMENT_ROUNDING, BallDescriptor, check_solid_balls
from cspace.spectral.trees import HIT, MISS, UNDECIDED
from cspace.threads import cores

Complexes = NDArray[np.complex128]
"""Array of complex numbers."""

MIN_SPECTRUM_TOLERANCE: Final = 1e-12
"""Smallest tolerance of a spectrum; non-uniform transforms round more than tables."""

TRANSFORM_TOLERANCE_SHARE: Final = 0.03
"""Share of the tolerance that a transform must meet; errors up to 7 times that, which bounds a 2-norm, were observed.
"""

MIN_TRANSFORM_TOLERANCE: Final = 2e-14
"""Smallest tolerance that a non-uniform transform can meet, because of its rounding."""

MAX_SUMMED_BALLS: Final = {2: 48, 3: 96}
"""Number of balls of one radius up to which sums of products are faster than a transform, by dimension."""

BYTES_PER_FREQUENCY: Final = {2: 120.0, 3: 184.0}
"""Upper bound of the memory per value of a spectrum, bytes, by dimension."""

BASIS_TOLERANCE_SHARE: Final = 0.02
"""Share of the tolerance for each source of error of a basis: spectra, nodes, decomposition and tables.

The first three errors grow by the Lebesgue constant of the nodes, below 6 for a thousand nodes.
"""


def ball_spectrum(
    centers: ArrayLike,
    radii: ArrayLike,
    bump: Bump,
    lengths: ArrayLike,
    counts: ArrayLike,
    tolerance: float = 1e-9,
    *,
    weights: ArrayLike | None = None,
) -> Complexes:
    """Compute the spectrum of balls.

    It is ``F(w) = integral f(x) exp(-2 pi i w.x) dx`` on a lattice of frequencies, ``w = k / lengths``, in the order of
    ``numpy.fft.fftfreq``. These are the Fourier coefficients of ``f``, repeated with these periods, times the product
    of ``lengths``.

    Parameters
    ----------
    centers : array-like, shape (n, dim)
        Metres, anywhere; only the extent of the balls must fit into one period.
    radii : array-like, shape (n,), or one number
        Metres. Balls of equal radii share a transform.
    bump : Bump
    lengths, counts : array-like, shape (dim,), or one number
        Periods, metres, and number of frequencies along each axis: ``k`` from ``-(count // 2)`` to ``(count - 1) //
        2``.
    tolerance : float
        Largest error, relative to the largest value ``F(0)``; from 1e-12 to 0.1. With weights, relative to the sum of
        the moduli of the balls' integrals.
    weights : array-like, shape (n,), optional
        Factor of each ball's bump, of any sign.

    Returns
    -------
    ndarray of complex128, shape counts
        Metres to the power ``dim``.

    Raises InputError if a value is not usable, the balls do not fit into one period, or the result does not fit into
    memory. Raises MissingPackageError if finufft is needed, for many balls of one radius, and is not installed.
    """
    points, sizes = check_solid_balls(centers, radii)
    kind, within, dim = check_bump(bump), check_tolerance(tolerance, MIN_SPECTRUM_TOLERANCE), points.shape[1]
    periods, numbers = _check_lengths(lengths, dim), _check_counts(counts, dim)
    factors = None if weights is None else check_finite(weights, "weights")
    if factors is not None and factors.shape != sizes.shape:
        rule = f"there must be one for each of {len(sizes)} balls"
        raise InputError("weights", f"has shape {factors.shape}", rule, "pass numbers", value=weights)
    extent = (points + sizes[:, None]).max(axis=0) - (points - sizes[:, None]).min(axis=0)
    if (extent > periods * (1.0 + 1e-9)).any():  # 1e-9 for rounding; larger balls would overlap their copies
        axis = int(np.argmax(extent / periods))
        problem = f"holds {periods[axis]:g} m along {'xyz'[axis]}, but the balls extend over {extent[axis]:g} m"
        raise InputError("lengths", problem, "they must fit into one period", "pass a longer period", value=lengths)
    lattice = FrequencyLattice.of(numbers, periods)
    return sum_terms(lattice, points, radial_terms(lattice, kind, sizes, within, factors), within)


# ---- non-uniform transforms ------------------------------------------------------------------------------------------


def finufft_module() -> Any:
    """Import finufft; raises MissingPackageError if it is not installed."""
    return import_optional("finufft", "spectra at centers that lie on no lattice need it", "spectral")


def evaluate_real_series(points: Floats, spectra: Complexes, tolerance: float) -> Floats:
    """Evaluate Fourier series of real functions at points.

    ``points`` has shape (n, d), in radians. ``spectra``, shape (m, counts), are the coefficients in the order of
    numpy.fft; the result has shape (m, n). The tolerance is relative to the 2-norm of the coefficients of a series. One
    complex transform evaluates two series: scaled alike, one becomes the real part and the other the imaginary part.
    """
    sizes = np.linalg.norm(spectra.reshape(len(spectra), -1), axis=1)
    scaled = spectra / np.where(sizes > 0.0, sizes, 1.0).reshape(-1, *[1] * points.shape[1])
    # Odd series become the imaginary parts of the even ones; the last one may be single.
    pairs = scaled[::2].copy()
    pairs[: len(scaled) // 2] += 1j * scaled[1::2]
    transform = getattr(finufft_module(), f"nufft{points.shape[1]}d2")
    options = _transform_options(tolerance, spectra.size + len(points))
    series = np.atleast_2d(transform(*points.T.copy(), pairs, isign=1, **options))
    parts = np.stack([series.real, series.imag], axis=1).reshape(-1, len(points))[: len(sizes)]
    return np.asarray(parts * sizes[:, None])


def _transform_options(tolerance: float, samples: int, upsampled_axes: int = 0) -> dict[str, Any]:
    """Return a transform's options; large ones take several threads."""
    finer = (
        1.25 if tolerance >= 1e-8 else 1.5 if tolerance >= 1e-11 else 2.0
    )  # with less, errors exceeded the tolerance
    threads = cores() if samples * finer**upsampled_axes >= 2**19 else 1
    return {"eps": tolerance, "modeord": 1, "nthreads": threads, "upsampfac": finer}


# ---- terms -----------------------------------------------------------------------------------------------------------


class Term(NamedTuple):
    """Waves around points, times a radial factor.

    ``members``, shape (n,), are the indices of the points, ``strengths``, shape (n,), the factors of their waves, and
    ``factor``, shape (moduli,), is the factor of each modulus of the frequency.
    """

    members: NDArray[np.intp]
    strengths: Floats
    factor: Floats


def radial_terms(
    lattice: FrequencyLattice, bump: Bump, radii: Floats, tolerance: float, weights: Floats | None = None
) -> Iterator[Term]:
    """Return the terms of balls, wherever their centers are."""
    dim = len(lattice.counts)
    # The cost without a basis, in transforms: even a sum over one ball, at half of that, evaluates its table at each
    # frequency. Below 8 transforms, a basis saves none.
    shares = np.unique(radii, return_counts=True)[1] / MAX_SUMMED_BALLS[dim]
    alone = float(np.clip(shares, 0.5, 1.0).sum())
    terms = radius_basis(bump, radii, lattice.moduli, dim, tolerance, alone) if alone > 8.0 else None
    if terms is None:
        terms = _terms_by_radius(bump, radii, lattice.moduli, dim, tolerance)
    if weights is not None:
        terms = (term._replace(strengths=term.strengths * weights[term.members]) for term in terms)
    return terms


def _terms_by_radius(bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float) -> Iterator[Term]:
    """Yield one term for each radius."""
    table = bump.table(dim, float(radii.max() * moduli.max()), 0.5 * tolerance)
    order = np.argsort(radii, kind="stable")
    different, starts = np.unique(radii[order], return_index=True)
    for radius, members in zip(different.tolist(), np.split(order, starts[1:]), strict=True):
        yield Term(members, np.full(len(members), radius**dim), table(radius * moduli))


def radius_basis(
    bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float, alone: float
) -> Iterator[Term] | None:
    """Return a few terms that serve all radii.

    Returns None unless there are fewer than ``alone`` terms, the cost without a basis. As a function of the radius,
    ``psi^(r |w|)`` is a mixture of exponentials whose phase is at most ``2 pi |w| r``. So it is interpolated between
    Chebyshev nodes in the radius with the same proven error as in the frequency (:class:`RadialTable`). A singular
    value decomposition of the spectra at the nodes leaves as many combinations as the tolerance needs. The strength of
    a ball in each combination depends on its radius.
    """
    max_modulus, max_radius, within = float(moduli.max()), float(radii.max()), BASIS_TOLERANCE_SHARE * tolerance
    center, half = 0.5 * (float(radii.min()) + max_radius), 0.5 * (max_radius - float(radii.min()))
    count, highest = count_nodes(within, 2.0 * math.pi * max_modulus * half), max_radius * max_modulus
    if count > 6.0 * alone:  # finding the basis would take longer than it saves
        return None
    spectrum = bump.table(dim, highest + 2.0 * TABLE_HALF_WIDTH, max(MIN_TOLERANCE, within))
    nodes = center + half * chebyshev_nodes(count)
    samples = max_modulus * np.linspace(0.0, 1.0, 4 * count)
    left, sizes, _ = np.linalg.svd(spectrum(nodes[:, None] * samples), full_matrices=False)
    rank = int(np.count_nonzero(sizes > within * spectrum(np.zeros(1))[0]))
    if rank >= alone:
        return None
    combinations, all_balls = left[:, :rank], np.arange(len(radii))
    # Tables need unit band limit, so frequencies are in cycles per largest radius.
    values = spectrum((nodes / max_radius)[:, None, None] * table_points(highest, within / math.sqrt(count)))
    position = np.clip((radii - center) / half, -1.0, 1.0)
    strengths = np.polynomial.chebyshev.chebval(position, chebyshev_coefficients(combinations)) * radii**dim
    return (
        Term(all_balls, row, RadialTable(np.tensordot(column, values, axes=1), highest)(max_radius * moduli))
        for row, column in zip(strengths, combinations.T, strict=True)
    )


class FrequencyLattice(NamedTuple):
    """Frequencies ``k / periods``, in the order of numpy.fft.

    ``counts`` are their numbers along the axes, ``moduli`` their distinct moduli, ascending, cycles per metre.
    ``which`` is the index of the modulus of each frequency, on a lattice that contains ``-w`` with each ``w``.
    """

    periods: Floats
    counts: tuple[int, ...]
    moduli: Floats
    which: NDArray[np.int32]

    @classmethod
    def of(cls, counts: tuple[int, ...], periods: Floats) -> FrequencyLattice:
        """Build the lattice."""
        shape = tuple(2 * (m // 2) + 1 for m in counts)
        # All orthants have the same moduli, so one is enough.
        axes = [np.arange(m // 2 + 1) / period for m, period in zip(shape, periods.tolist(), strict=True)]
        orthant = np.sqrt(sum(part * part for part in np.meshgrid(*axes, indexing="ij", sparse=True)))
        moduli, which = np.unique(orthant, return_inverse=True)
        indices = np.ix_(*(np.abs(_frequency_indices(m)) for m in shape))
        return cls(periods, counts, moduli, which.reshape(orthant.shape).astype(np.int32)[indices])


def sum_terms(
    lattice: FrequencyLattice, points: Floats, terms: Iterable[Term], tolerance: float, *, half: bool = False
) -> Complexes:
    """Return the spectrum of terms around points, shape ``lattice.counts``.

    With ``half``, only the frequencies whose last one is not negative are returned, and counts must be odd.
    """
    found = _LatticeSum(lattice, points / lattice.periods, 0.5 * tolerance).spectrum(terms)
    if half:
        return found
    whole = np.empty(lattice.which.shape, dtype=np.complex128)
    last = found.shape[-1]
    whole[..., :last] = found
    others = np.roll(np.flip(found[..., 1:]), 1, axis=tuple(range(found.ndim - 1)))
    np.conj(others, out=whole[..., last:])
    return whole if whole.shape == lattice.counts else whole[np.ix_(*map(_frequency_indices, lattice.counts))]


class Correlation:
    """Overlaps with weighted balls on a lattice, by inverse FFTs.

    Spectra are those of :class:`cspace.spectral.FourierOverlap`. The lattice has ``shape`` steps to a period.

    *Rounding.* A pass of an inverse FFT changes a value by at most 23 units of roundoff times ``S = sum |F_B| |F_A| /
    V`` (:mod:`cspace.engines.fft`), and a transform of 2^26 cells has fewer than 40 passes. So a value errs by less
    than 1e-13 S, a 40th of what an accuracy of 1e-12 of both spectra adds to the bound of :class:`Terms`.
    """

    def __init__(
        self,
        body: BallDescriptor,
        target: BallDescriptor,
        lengths: Floats,
        counts: tuple[int, ...],
        shape: tuple[int, ...],
        accuracy: float,
        weights: Floats | None = None,
    ) -> None:
        self.body, self.lengths, self.shape, self._accuracy = body, lengths, shape, accuracy
        self.lattice = FrequencyLattice.of(counts, lengths)
        self.terms = list(radial_terms(self.lattice, body.bump, body.radii, accuracy))
        balls = target.centers - target.center, target.radii, target.bump
        self.spectrum = _first_half(ball_spectrum(*balls, lengths, counts, accuracy, weights=weights)).copy()

    def values(self, matrix: Floats, start: Floats | None = None) -> Floats:
        """Return the overlaps with A rotated, at all steps of the lattice.

        ``start``, metres, is the place of the center of A relative to that of B at the first step; zero if left out.
        """
        moved = (self.body.centers - self.body.center) @ matrix.T
        products = sum_terms(self.lattice, moved, self.terms, self._accuracy, half=True)
        np.multiply(self.spectrum, np.conj(products, out=products), out=products)
        if start is not None:
            for axis, (count, share) in enumerate(zip(self.lattice.counts, start / self.lengths, strict=True)):
                turns = _frequency_indices(count)[: products.shape[axis]] * share
                phases = np.exp(2j * math.pi * (turns - np.round(turns)))
                products *= phases.reshape(-1, *[1] * (products.ndim - 1 - axis))
        return self._inverse(products)

    def splines(self) -> Iterator[Floats]:
        """Yield cubic spline coefficients of each term's field on the lattice."""
        which = _first_half(self.lattice.which)
        return (self._inverse(self.spectrum * term.factor[which], spline=True) for term in self.terms)

    def _inverse(self, half: Complexes, *, spline: bool = False) -> Floats:
        """Return lattice values, or spline coefficients, from half a spectrum."""
        from scipy.fft import irfftn

        # Frequencies that differ by a multiple of the lattice's size are one frequency there, so they are added.
        for axis, (count, size) in enumerate(zip(self.lattice.counts[:-1], self.shape[:-1], strict=True)):
            half = _fold(half, axis, count // 2 + 1, size)
        size, shared = self.shape[-1], half[..., 0].copy()
        half = _fold(half, half.ndim - 1, half.shape[-1], size)
        if 2 * (self.lattice.counts[-1] // 2) >= size:  # the other half of the spectrum folds onto this one
            others = half.copy()
            others[..., 0] -= shared  # which is in both halves
            half += _opposite(others).conj()
        half = _first_half(half)
        if spline:
            for axis, size in enumerate(self.shape):
                cosines = np.cos(2.0 * math.pi / size * np.arange(half.shape[axis]))
                half /= ((2.0 + cosines) / 3.0).reshape(-1, *[1] * (half.ndim - 1 - axis))
        scale = math.prod(self.shape) / math.prod(self.lengths)
        return np.asarray(irfftn(half, s=self.shape, workers=cores(), overwrite_x=True)) * scale


def _fold(spectrum: Complexes, axis: int, positive: int, size: int) -> Complexes:
    """Add frequencies along an axis that are equal modulo ``size``.

    The first ``positive`` frequencies are 0, 1, ..., the others ..., -2, -1.
    """
    before, (*shape, count) = spectrum.shape[:axis], (*spectrum.shape[axis + 1 :], spectrum.shape[axis])
    padded = np.zeros((*before, -(-count // size) * size, *shape), dtype=np.complex128)
    padded[(slice(None),) * axis + (slice(positive),)] = spectrum[(slice(None),) * axis + (slice(positive),)]
    if count > positive:
        others = (slice(None),) * axis + (slice(positive - count, None),)
        padded[others] = spectrum[others]
    return np.asarray(padded.reshape(*before, -1, size, *shape).sum(axis=axis))


def _first_half(spectrum: NDArray[Any]) -> NDArray[Any]:
    """Select the frequencies whose last one is not negative."""
    return spectrum[..., : spectrum.shape[-1] // 2 + 1]


def _opposite(spectrum: Complexes) -> Complexes:
    """Move each frequency of a spectrum to its opposite."""
    return np.roll(np.flip(spectrum), 1, axis=tuple(range(spectrum.ndim)))


class _LatticeSum:
    """Sum of terms, for the frequencies whose last one is not negative.

    A descriptor is real, so ``F(-w)`` is the conjugate of ``F(w)``. With strengths ``a + i b``, one transform G holds
    the transforms A and B of two real terms. With radial factors g and h, ``g A + h B`` is ``X(w) + conj(X(-w))`` for
    ``X = G (g - i h) / 2``. So the X of all pairs are summed and mirrored once. Points are given in periods.
    """

    def __init__(self, lattice: FrequencyLattice, shares: Floats, tolerance: float) -> None:
        self._shares = shares - np.round(shares)
        self._which, self._tolerance = lattice.which, tolerance
        self._transforms: Complexes | None = None
        self._sums = np.zeros(_first_half(lattice.which).shape, dtype=np.complex128)
        self._current_points: NDArray[np.intp] | None = None
        self._summed_points: NDArray[np.intp] | None = None

    def spectrum(self, terms: Iterable[Term]) -> Complexes:
        """Return half of the spectrum."""
        waiting: Term | None = None
        for term in terms:
            if len(term.members) <= MAX_SUMMED_BALLS[self._which.ndim]:
                waves = self._sum_waves(term)
                waves *= term.factor[_first_half(self._which)]
                self._sums += waves
            elif waiting is None:
                waiting = term
            else:
                self._transform(waiting, term)
                waiting = None
        if waiting is not None:
            self._transform(waiting, Term(waiting.members[:0], waiting.strengths[:0], np.zeros_like(waiting.factor)))
        if self._transforms is not None:
            self._sums += _first_half(self._transforms)
            self._sums += _first_half(_opposite(self._transforms)).conj()
        return self._sums

    @cached_property
    def _plan(self) -> Any:
        """Plan of the non-uniform transforms."""
        demanded = max(MIN_TRANSFORM_TOLERANCE, TRANSFORM_TOLERANCE_SHARE * self._tolerance)
        options = _transform_options(demanded, self._which.size, self._which.ndim)
        return finufft_module().Plan(1, self._which.shape, dtype="complex128", isign=-1, **options)

    def _transform(self, first: Term, second: Term) -> None:
        """Add two terms by one complex transform."""
        # Terms of the same points combine their strengths; other terms are concatenated.
        if first.members is second.members:
            points, strengths = first.members, first.strengths + 1j * second.strengths
        else:
            points = np.concatenate([first.members, second.members])
            strengths = np.concatenate([first.strengths, 1j * second.strengths])
        if points is not self._current_points:
            self._angles = (2.0 * math.pi * self._shares[points]).T.copy()  # the plan does not keep them alive
            self._plan.setpts(*self._angles)
            self._current_points = points
        waves = self._plan.execute(strengths)
        waves *= (0.5 * (first.factor - 1j * second.factor))[self._which]
        self._transforms = waves if self._transforms is None else self._transforms + waves

    def _sum_waves(self, term: Term) -> Complexes:
        """Sum ``strength exp(-2 pi i k.share)`` over the points of a term."""
        if term.members is not self._summed_points:  # terms of a basis share their points
            self._summed_points = term.members
            indices = [_frequency_indices(count) for count in self._which.shape]
            indices[-1] = _first_half(indices[-1])
            first, *rest = (
                np.exp(-2j * math.pi * numbers[:, None] * column)
                for numbers, column in zip(indices, self._shares[term.members].T, strict=True)
            )
            others = rest[0] if len(rest) == 1 else (rest[0][:, None] * rest[1]).reshape(-1, len(term.members))
            self._factors = first, others
        first, others = self._factors
        return np.asarray(((first * term.strengths) @ others.T).reshape(self._sums.shape))


def _frequency_indices(count: int) -> NDArray[np.intp]:
    """Return integer frequencies in the order of numpy.fft."""
    return np.fft.fftfreq(count, 1.0 / count).astype(np.intp)


# ---- arguments -------------------------------------------------------------------------------------------------------


def _check_lengths(lengths: ArrayLike, dim: int) -> Floats:
    """Return the periods, shape (dim,), or raise InputError."""
    periods = check_finite(lengths, "lengths")
    if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
        rule = f"it must be one number above zero or {dim} of them, in metres"
        raise InputError("lengths", f"is {lengths!r}", rule, "pass the period along each axis", value=lengths)
    return np.broadcast_to(periods, dim).copy()


def _check_counts(counts: ArrayLike, dim: int) -> tuple[int, ...]:
    """Return the number of frequencies along each axis.

    Raises InputError for anything else, or if the spectrum would not fit into memory.
    """
    numbers = np.asarray(counts)
    if numbers.shape not in {(), (dim,)} or numbers.dtype.kind not in "iu" or (numbers <= 0).any():
        rule = f"it must be one whole number above zero or {dim} of them"
        raise InputError("counts", f"is {counts!r}", rule, "pass e.g. 256", value=counts)
    shape = tuple(int(n) for n in np.broadcast_to(numbers, dim))
    free, needed = free_bytes(), BYTES_PER_FREQUENCY[dim] * float(count_cells(shape))
    if needed > MAX_MEMORY_FRACTION * free:
        problem = f"is {' x '.join(map(str, shape))}, which needs about {bytes_text(needed)} of memory"
        raise InputError("counts", problem, f"{bytes_text(free)} are free", "pass smaller counts", value=counts)
    return shape


ROUNDING_UNIT: Final = 2.0**-52
"""Twice the relative rounding error of one operation."""

MAX_CYCLES_PER_RADIUS: Final = 32.0
"""Highest frequency considered for a band, cycles per radius of the smallest ball."""

BOUND_ROUNDING: Final = 1.0 + 2.0**-30
"""Factor that covers the rounding of the bounds themselves."""

PAIR_TABLE_NODES: Final = 64
"""Number of distances in a table for pairs of two radii."""

SELF_INTEGRAL_ERROR: Final = 1e-13
"""Relative error of the integral of the squared bump."""

BALLS_PER_BATCH: Final = 2**8
"""Number of balls whose neighbors are held in memory at once."""


def estimate_band(a: BallDescriptor, b: BallDescriptor, bound: float) -> float:
    """Estimate the frequency, cycles per metre, with ``bound`` left above it.

    Above the frequencies of the gaps between balls, their energies add up: the energy of a set is the sum of the
    energies of its bumps. The result is at most :data:`MAX_CYCLES_PER_RADIUS` of the smallest ball.
    """
    k = np.linspace(0.0, MAX_CYCLES_PER_RADIUS, 4096)
    energy = a.bump.table(a.dim, MAX_CYCLES_PER_RADIUS, 1e-9)(k) ** 2 * sphere_measure(k, a.dim)
    above = np.cumsum(energy[::-1])[::-1] * k[1]
    all_radii = np.concatenate([a.radii, b.radii])
    frequencies = np.geomspace(0.1 / all_radii.max(), MAX_CYCLES_PER_RADIUS / all_radii.min(), 400)
    tails = [
        sum(
            count * radius**a.dim * np.interp(radius * frequencies, k, above)
            for radius, count in zip(*np.unique(balls.radii, return_counts=True), strict=True)
        )
        for balls in (a, b)
    ]
    is_enough = np.sqrt(tails[0]) * np.sqrt(tails[1]) <= bound
    return float(frequencies[np.argmax(is_enough)] if is_enough.any() else frequencies[-1])


class Rings(NamedTuple):
    """Frequencies ``k / lengths``, ``|k| <= halves``, in rings of similar moduli.

    Descriptors are real, so opposite frequencies have conjugate terms; only frequency zero and the frequencies whose
    first non-zero entry is positive are stored. ``lengths`` are the periods, metres. ``indices``, shape (n, d), are k,
    ``moduli`` are ``|w|`` in cycles per metre, and ``twice`` is 1 for frequency zero and 2 for the others, all in ring
    order. Ring r starts at ``starts[r]``; the first one is frequency zero alone. ``reaches``, shape (rings, d), are the
    largest moduli of k along the axes up to a ring.
    """

    lengths: Floats
    halves: tuple[int, ...]
    indices: NDArray[np.int16]
    moduli: Floats
    twice: Floats
    starts: Ints
    reaches: Ints

    @classmethod
    def of(cls, lengths: Floats, halves: tuple[int, ...]) -> Rings:
        """Build rings, each one cycle wide in the longest period."""
        axes = [np.arange(-half, half + 1, dtype=np.int16) for half in halves]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(halves))
        half = box[len(box) // 2 :]
        moduli = np.linalg.norm(half / lengths, axis=1)
        ring = np.ceil(moduli * lengths.max() - 1e-9).astype(np.int64)
        order = np.argsort(ring.astype(np.min_scalar_type(ring.max())), kind="stable")  # short integers sort faster
        counts = np.bincount(ring)
        starts = np.concatenate([[0], np.cumsum(counts[counts > 0])])
        indices = np.ascontiguousarray(half[order])
        reaches = np.maximum.accumulate(np.maximum.reduceat(np.abs(indices), starts[:-1], axis=0), axis=0)
        twice = np.where(np.arange(len(order)) > 0, 2.0, 1.0)
        return cls(lengths, halves, indices, moduli[order], twice, starts, reaches.astype(np.int64))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of frequencies along each axis, both halves, so odd."""
        return tuple(2 * half + 1 for half in self.halves)

    @property
    def volume(self) -> float:
        """Volume of a period, metres to the power ``dim``."""
        return float(np.prod(self.lengths))

    def sums(self, values: Floats) -> Floats:
        """Sum values, in ring order, over each ring."""
        return np.asarray(np.add.reduceat(values, self.starts[:-1]))

    def to_rings(self, box: Complexes) -> Complexes:
        """Convert a spectrum from numpy's order to ring order."""
        return box.reshape(-1)[self._flat_indices(1)]

    def to_box(self, half: Complexes) -> Complexes:
        """Convert half a spectrum in ring order to numpy's order."""
        flat = np.empty(math.prod(self.counts), dtype=np.complex128)
        flat[self._flat_indices(-1)], flat[self._flat_indices(1)] = half.conj(), half
        return flat.reshape(self.counts)

    def _flat_indices(self, sign: int) -> Ints:
        """Return flat indices in numpy's order, or those of opposite frequencies."""
        columns = sign * self.indices.T.astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(columns), self.counts, mode="wrap"))


class Spectrum(NamedTuple):
    """Band-limited spectrum of a descriptor, about the center of its balls.

    ``values``, in ring order, are in metres to the power ``dim``; ``error`` bounds the error of each.
    """

    values: Complexes
    error: float

    @classmethod
    def of(cls, balls: BallDescriptor, center: Floats, rings: Rings, accuracy: float) -> Spectrum:
        """Compute the spectrum of balls about a point."""
        box = ball_spectrum(balls.centers - center, balls.radii, balls.bump, rings.lengths, rings.counts, accuracy)
        moved = PLACEMENT_ROUNDING * (balls.span + float(np.abs(center).max()))
        error = balls.integral * (2.0 * accuracy + 2.0 * math.pi * float(rings.moduli.max()) * moved)
        return cls(rings.to_rings(box), error)

    def tail(self, rings: Rings, norm: tuple[float, float]) -> float:
        """Return an upper bound of the energy outside the band.

        By Parseval's theorem, that is :func:`norm_square` minus the energy in the band.
        """
        moduli, (total, off) = np.abs(self.values), norm
        inside = float((rings.twice * moduli * (moduli - 2.0 * self.error)).sum()) / rings.volume
        return max(0.0, total - inside) + off + 2.0**-44 * total


class Terms(NamedTuple):
    """Terms of the overlap, with bounds of partial sums, for kernels.

    ``products`` are ``F_B conj(F_A) / V`` in ring order, doubled for the opposite frequency. ``bounds[r]``, shape
    (rings + 1,), is the largest difference of the sum of the rings before r from the sum of all frequencies, at any
    placement: the remaining rings, rounding and the errors of the spectra. The other arrays are those of
    :class:`Rings`.
    """

    products: Complexes
    bounds: Floats
    indices: NDArray[np.int16]
    starts: Ints
    reaches: Ints
    lengths: Floats

    @classmethod
    def of(cls, first: Spectrum, second: Spectrum, rings: Rings, far: float, tail: float) -> Terms:
        """Build the terms of the overlap of A, first, with B.

        Within the band, the sum of the moduli bounds the remaining terms. Outside, ``tail`` does, the product of the
        two tail norms (Cauchy and Schwarz). ``far``, in metres, bounds the rounding of a placement.
        """
        weights = rings.twice / rings.volume
        products = weights * second.values * first.values.conj()
        moduli_a, moduli_b = np.abs(first.values), np.abs(second.values)
        moduli = np.abs(products)
        errors = weights * (moduli_a * second.error + moduli_b * first.error + first.error * second.error)
        per_ring, errors_per_ring = rings.sums(moduli), rings.sums(errors)
        after = np.cumsum((per_ring + errors_per_ring)[::-1])[::-1]
        # The phase k t / L of an axis has an error of a few units times k. Sums add one unit per term and per ring.
        counts = np.diff(rings.starts)
        units = 64.0 + counts + len(counts) + 8.0 * rings.reaches.sum(axis=1)
        moved = 2.0 * math.pi * far * rings.sums(rings.moduli * (moduli + errors))
        before = np.cumsum(errors_per_ring + ROUNDING_UNIT * units * per_ring + moved)
        bounds = BOUND_ROUNDING * (np.append(after, 0.0) + tail + np.append(0.0, before))
        return cls(products, bounds, rings.indices, rings.starts, rings.reaches, rings.lengths)


# ---- compiled sums, ring by ring -------------------------------------------------------------------------------------


@kernel
def add_phases(share: float, first: int, last: int, phases: Complexes) -> None:
    """Write ``exp(2 pi i k share)`` for ``first <= |k| <= last`` to ``phases[center + k]``.

    ``share`` is the placement along an axis, in periods. Each factor is computed on its own, so that errors do not
    accumulate.
    """
    center = len(phases) // 2
    for k in range(first, last + 1):
        turns = k * share
        angle = 2.0 * math.pi * (turns - round(turns))
        value = complex(math.cos(angle), math.sin(angle))
        phases[center + k] = value
        phases[center - k] = value.conjugate()


@kernel
def add_terms(terms: Terms, phases: Complexes, start: int, stop: int) -> float:
    """Sum ``Re(products * exp(2 pi i k.t))`` over frequencies [start, stop).

    ``phases``, shape (d, 2 m + 1), are those of each axis.
    """
    products, indices = terms.products, terms.indices
    center = phases.shape[1] // 2
    total = 0.0
    for n in range(start, stop):
        phase = phases[0, center + indices[n, 0]] * phases[1, center + indices[n, 1]]
        if len(phases) == 3:
            phase *= phases[2, center + indices[n, 2]]
        total += products[n].real * phase.real - products[n].imag * phase.imag
    return total


@kernel
def separate(placement: Floats, terms: Terms, threshold: float, phases: Complexes) -> tuple[int, int, float, float]:
    """Sum ring after ring until the sum decides.

    Returns MISS or HIT if the sum and its bound prove it, else UNDECIDED, as for a threshold of NaN; the number of
    frequencies; the sum; and its bound. ``placement``, shape (d,), metres, is the center of A relative to the center of
    B. ``phases`` is scratch of shape (d, 2 m + 1) for the highest frequency m of an axis.
    """
    starts, reaches = terms.starts, terms.reaches
    total = 0.0
    for ring in range(len(starts) - 1):
        for axis in range(len(placement)):
            first = reaches[ring - 1, axis] + 1 if ring > 0 else 0
            add_phases(placement[axis] / terms.lengths[axis], first, reaches[ring, axis], phases[axis])
        total += add_terms(terms, phases, starts[ring], starts[ring + 1])
        bound = terms.bounds[ring + 1]
        if total + bound < threshold:
            return MISS, starts[ring + 1], total, bound
        if total - bound > threshold:
            return HIT, starts[ring + 1], total, bound
    return UNDECIDED, starts[-1], total, terms.bounds[-1]


@allocating
def separate_all(placements: Floats, terms: Terms, threshold: float) -> tuple[Bytes, Ints, Floats]:
    """Return verdicts, counts, and sums with bounds of :func:`separate`."""
    number = len(placements)
    verdicts, counts, sums = np.empty(number, np.uint8), np.empty(number, np.int64), np.empty((number, 2))
    phases = np.empty((placements.shape[1], 2 * terms.reaches[-1].max() + 1), np.complex128)
    for n in range(number):
        verdicts[n], counts[n], sums[n, 0], sums[n, 1] = separate(placements[n], terms, threshold, phases)
    return verdicts, counts, sums


def norm_square(balls: BallDescriptor) -> tuple[float, float]:
    """Return the integral of a descriptor's square and its error."""
    # Each ball with itself once, and each pair of different balls twice.
    square = radial_transform(lambda s: balls.bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(square[0] * (balls.radii**balls.dim).sum())
    error = SAFETY_FACTOR * SELF_INTEGRAL_ERROR * value
    for i, j in _touching_pairs(balls):
        gaps = np.linalg.norm(balls.centers[i] - balls.centers[j], axis=1)
        values, errors = tabulated_integrals(balls.bump, balls.radii[i], balls.radii[j], gaps, balls.dim)
        value, error = value + 2.0 * float(values.sum()), error + 2.0 * float(errors.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


def sum_pairs(
    bump: Bump,
    moved: Iterable[Floats],
    radii: Floats,
    fixed: tuple[Floats, Floats, Floats],
    slack: float,
    many: int = PAIR_TABLE_NODES,
) -> tuple[Floats, Floats]:
    """Return overlaps as sums over pairs of balls, with error bounds.

    ``moved`` yields the centers (k, d) of the moved balls at each of n placements, whose radii are ``radii``; ``fixed``
    are the centers, radii and weights of the others. ``slack`` bounds the rounding of a distance, metres. The results
    have shape (n,). More than ``many`` pairs of equal radii get a table.
    """
    centers, other_radii, weights = fixed
    found, number, dim = [np.empty((5, 0))], 0, centers.shape[1]
    for placement, points in enumerate(moved):
        number = placement + 1
        for part in np.array_split(np.arange(len(radii)), math.ceil(len(radii) * len(other_radii) / 2**20)):
            gaps = np.linalg.norm(points[part, None] - centers, axis=2)
            i, j = np.nonzero(gaps < radii[part, None] + other_radii + slack)
            rows = np.full(len(i), placement), radii[part][i], other_radii[j], gaps[i, j], weights[j]
            found.append(np.stack(rows))
    rows, first, second, distances, factors = np.concatenate(found, axis=1)
    values, errors = tabulated_integrals(bump, first, second, distances, dim, many)
    # The common part of two balls changes by at most a cross-section of the smaller one times a change of distance.
    edges = {2: 2.0, 3: math.pi}[dim] * np.minimum(first, second) ** (dim - 1)
    errors += slack * edges + 2.0**-40 * np.abs(values)
    sums = (factors * values, np.abs(factors) * errors)
    totals, bounds = (np.bincount(rows.astype(np.int64), each, number).astype(np.float64) for each in sums)
    return totals, bounds


def tabulated_integrals(
    bump: Bump, first: Floats, second: Floats, distances: Floats, dim: int, many: int = PAIR_TABLE_NODES
) -> tuple[Floats, Floats]:
    """Compute many :func:`pair_integrals`; equal radii share a table."""
    values, errors = np.zeros((2, len(distances)))
    pairs = np.maximum(first, second) + 1j * np.minimum(first, second)
    keys, group, counts = np.unique(pairs, return_inverse=True, return_counts=True)
    # The integrals of indicators are not smooth in the distance.
    tabulated = (counts > many) & (not bump.is_indicator)
    for number in np.flatnonzero(tabulated):
        (large, small), members = (keys[number].real, keys[number].imag), group == number
        fit, error = _tabulate_pair(bump, float(large), float(small), dim)
        values[members] = fit(np.minimum(2.0 * distances[members] / (large + small), 2.0) - 1.0)
        errors[members] = error
    few = ~tabulated[group]
    if few.any():
        values[few], errors[few] = pair_integrals(bump, first[few], second[few], distances[few], dim)
    return values, errors


def _touching_pairs(balls: BallDescriptor) -> Iterator[tuple[Ints, Ints]]:
    """Yield batches of pairs of touching balls, larger ones first."""
    from scipy.spatial import cKDTree

    centers, radii = balls.centers, balls.radii
    tree, rank = cKDTree(centers), np.empty(len(radii), dtype=np.int64)
    rank[np.argsort(radii, kind="stable")] = np.arange(len(radii))
    for batch in np.array_split(np.arange(len(radii)), math.ceil(len(radii) / BALLS_PER_BATCH)):
        # A smaller ball that touches this one has its center within twice this radius.
        near = tree.query_ball_point(centers[batch], 2.0 * radii[batch] * (1.0 + 2.0**-40))
        i = np.repeat(batch, [len(each) for each in near])
        j = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        square = ((centers[i] - centers[j]) ** 2).sum(axis=1)
        meeting = (rank[j] < rank[i]) & (square <= (radii[i] + radii[j]) ** 2)
        yield i[meeting], j[meeting]


@lru_cache(maxsize=4096)
def _tabulate_pair(bump: Bump, first: float, second: float, dim: int) -> tuple[np.polynomial.Chebyshev, float]:
    """Return integrals as a function of [-1, 1], and their error."""
    nodes = chebyshev_nodes(PAIR_TABLE_NODES)
    between = np.cos(math.pi * np.arange(PAIR_TABLE_NODES + 1) / PAIR_TABLE_NODES)
    gaps = 0.5 * (first + second) * (1.0 + np.concatenate([nodes, between]))
    values, errors = pair_integrals(bump, np.full_like(gaps, first), np.full_like(gaps, second), gaps, dim)
    fit = np.polynomial.Chebyshev(chebyshev_coefficients(values[:PAIR_TABLE_NODES]))
    error = float(errors.max()) + SAFETY_FACTOR * float(np.abs(fit(between) - values[PAIR_TABLE_NODES:]).max())
    return fit, error

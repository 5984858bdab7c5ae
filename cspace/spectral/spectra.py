"""Spectra of sets of balls with arbitrary centers.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of one radius have
that radial factor times the spectrum of their centers, which one non-uniform FFT of type 1 computes (Dutt and Rokhlin,
1993; Barnett, Magland and af Klinteberg, 2019). If a radius has too few balls for a transform, their terms are summed
as products of one factor per axis. If there are many radii, a few transforms serve all radii (:func:`radius_basis`).

*Error.* All bumps are non-negative, so the spectrum is largest at frequency 0, where it is the integral of the
descriptor; tolerances are relative to that value. Half of a tolerance is for the table of ``psi^``, half for the
transforms.

*Bands.* Proofs of overlaps sum the terms of two spectra ring by ring, from the lowest frequency, and bound the
remainder. Norms and thresholds come from the overlaps of pairs of balls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bytes, Floats, Ints
from cspace.check import check_finite
from cspace.compiling import kernel
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
from cspace.threads import cores

Complexes = NDArray[np.complex128]
"""Array of complex numbers."""

MIN_SPECTRUM_TOLERANCE: Final = 1e-12
"""Smallest tolerance of a spectrum; non-uniform transforms round more than tables."""


TRANSFORM_TOLERANCE_SHARE: Final = 0.03
"""Fraction of the tolerance that a non-uniform transform must meet.

The tolerance of a transform bounds a 2-norm; errors of single values up to seven times larger were observed.
"""


MIN_TRANSFORM_TOLERANCE: Final = 2e-14
"""Smallest tolerance that a non-uniform transform can meet, because of its rounding."""


UPSAMPLING_FACTORS: Final = ((1e-8, 1.25), (1e-11, 1.5), (0.0, 2.0))
"""Pairs of a transform tolerance and the upsampling factor for it and above.

With less upsampling, errors exceeded the tolerance.
"""


MIN_THREADED_SAMPLES: Final = 2**19
"""Number of samples of a transform from which several threads save time."""

MAX_SUMMED_BALLS: Final = {
    2: 48,
    3: 96,
}
"""Number of balls of one radius up to which sums of products are faster than a transform, by dimension."""

BYTES_PER_FREQUENCY: Final = {
    2: 120.0,
    3: 184.0,
}
"""Upper bound of the memory per value of a spectrum, bytes, by dimension."""

MIN_SUM_COST: Final = 0.5
"""Smallest cost of summing a radius with few balls, relative to a transform."""

MIN_BASIS_TRANSFORMS: Final = 8.0
"""Number of transforms above which a basis of radii is tried."""


BASIS_TOLERANCE_SHARE: Final = 0.02
"""Fraction of the tolerance for each source of error of a basis: spectra, nodes, decomposition and tables.

The first three errors grow by the Lebesgue constant of the nodes, below 6 for a thousand nodes.
"""


MAX_NODES_PER_TRANSFORM: Final = 6.0
"""Largest number of nodes of a basis for each transform that it saves."""

SAMPLES_PER_NODE: Final = 4
"""Number of frequencies per node at which spectra are decomposed."""

PERIOD_SLACK: Final = 1e-9
"""Relative rounding error by which balls may exceed the period."""


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
    factors = None
    if weights is not None:
        factors = check_finite(weights, "weights")
        if factors.shape != sizes.shape:
            rule = f"there must be one for each of {len(sizes)} balls"
            raise InputError("weights", f"has shape {factors.shape}", rule, "pass numbers", value=weights)
    reach = sizes[:, None]
    _check_fits((points + reach).max(axis=0) - (points - reach).min(axis=0), periods)
    lattice = FrequencyLattice.of(numbers, periods)
    return sum_terms(lattice, points, radial_terms(lattice, kind, sizes, within, factors), within)


# ---- non-uniform transforms ------------------------------------------------------------------------------------------


def finufft_module() -> Any:
    """Import finufft.

    Raises MissingPackageError if it is not installed.
    """
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
    transform, finer = getattr(finufft_module(), f"nufft{points.shape[1]}d2"), _upsampling_factor(tolerance)
    options = {"isign": 1, "modeord": 1, "nthreads": _threads(spectra.size + len(points)), "upsampfac": finer}
    series = np.atleast_2d(transform(*points.T.copy(), pairs, eps=tolerance, **options))
    parts = np.stack([series.real, series.imag], axis=1).reshape(-1, len(points))[: len(sizes)]
    return np.asarray(parts * sizes[:, None])


def _upsampling_factor(tolerance: float) -> float:
    """Return the upsampling factor for a transform tolerance."""
    return next(finer for least, finer in UPSAMPLING_FACTORS if tolerance >= least)


def _threads(samples: float) -> int:
    """Return the number of threads for a transform."""
    return cores() if samples >= MIN_THREADED_SAMPLES else 1


# ---- terms -----------------------------------------------------------------------------------------------------------


class Term(NamedTuple):
    """Waves around points, times a radial factor.

    Attributes
    ----------
    members : ndarray of int, shape (n,)
        Indices of the points.
    strengths : ndarray of float64, shape (n,)
        Factor of each point's wave.
    factor : ndarray of float64, shape (moduli,)
        Factor of each modulus of the frequency.
    """

    members: NDArray[np.intp]
    strengths: Floats
    factor: Floats


def radial_terms(
    lattice: FrequencyLattice, bump: Bump, radii: Floats, tolerance: float, weights: Floats | None = None
) -> Iterator[Term]:
    """Return the terms of balls, wherever their centers are."""
    dim = len(lattice.counts)
    # The cost without a basis, in transforms: even a sum over one ball evaluates its table at each frequency.
    shares = np.unique(radii, return_counts=True)[1] / MAX_SUMMED_BALLS[dim]
    alone = float(np.clip(shares, MIN_SUM_COST, 1.0).sum())
    terms = radius_basis(bump, radii, lattice.moduli, dim, tolerance, alone) if alone > MIN_BASIS_TRANSFORMS else None
    if terms is None:
        terms = _terms_by_radius(bump, radii, lattice.moduli, dim, tolerance)
    if weights is not None:
        terms = (term._replace(strengths=term.strengths * weights[term.members]) for term in terms)
    return terms


def _terms_by_radius(bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float) -> Iterator[Term]:
    """Yield one term for each radius.

    ``moduli``, ascending, are the moduli of the frequencies, in cycles per metre.
    """
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
    max_modulus, max_radius = float(moduli.max()), float(radii.max())
    center, half = 0.5 * (float(radii.min()) + max_radius), 0.5 * (max_radius - float(radii.min()))
    within = BASIS_TOLERANCE_SHARE * tolerance
    count = count_nodes(within, 2.0 * math.pi * max_modulus * half)
    if count > MAX_NODES_PER_TRANSFORM * alone:
        return None
    spectrum = bump.table(dim, max_radius * max_modulus + 2.0 * TABLE_HALF_WIDTH, max(MIN_TOLERANCE, within))
    nodes = center + half * chebyshev_nodes(count)
    left, sizes, _ = np.linalg.svd(
        spectrum(nodes[:, None] * (max_modulus * np.linspace(0.0, 1.0, SAMPLES_PER_NODE * count))), full_matrices=False
    )
    rank = int(np.count_nonzero(sizes > within * spectrum(np.zeros(1))[0]))
    if rank >= alone:
        return None
    combinations = left[:, :rank]
    # Tables need unit band limit, so frequencies are in cycles per largest radius.
    values = spectrum(
        (nodes / max_radius)[:, None, None] * table_points(max_radius * max_modulus, within / math.sqrt(count))
    )
    position = np.clip((radii - center) / half, -1.0, 1.0)
    strengths = np.polynomial.chebyshev.chebval(position, chebyshev_coefficients(combinations)) * radii**dim
    all_balls = np.arange(len(radii))
    return (
        Term(
            all_balls,
            row,
            RadialTable(np.tensordot(column, values, axes=1), max_radius * max_modulus)(max_radius * moduli),
        )
        for row, column in zip(strengths, combinations.T, strict=True)
    )


class FrequencyLattice(NamedTuple):
    """Frequencies ``k / periods``, in the order of numpy.fft.

    ``counts`` are their numbers along the axes. ``moduli`` are their distinct moduli, ascending, cycles per metre.
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
    """Return the spectrum of terms around points (n, d), metres, to a tolerance.

    Its shape is ``lattice.counts``; with ``half``, only the frequencies whose last one is not negative are returned,
    and counts must be odd.
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
    """Overlaps of A with weighted balls of B at the translations of a lattice, by one inverse FFT for each rotation.

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
        """Yield the coefficients of cubic splines, on the lattice, of the field that the balls of each term see."""
        which = _first_half(self.lattice.which)
        return (self._inverse(self.spectrum * term.factor[which], spline=True) for term in self.terms)

    def _inverse(self, half: Complexes, *, spline: bool = False) -> Floats:
        """Return the values on the lattice of a function with half a spectrum, or coefficients of its cubic spline."""
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
    """Add the frequencies along an axis that are equal modulo ``size``.

    The first ``positive`` frequencies are 0, 1, ..., the others ..., -2, -1. The result has length ``size``.
    """
    folded = np.zeros((*spectrum.shape[:axis], size, *spectrum.shape[axis + 1 :]), dtype=np.complex128)
    before = (slice(None),) * axis
    for start in range(0, positive, size):
        stop = min(positive, start + size)
        folded[*before, : stop - start] += spectrum[*before, start:stop]
    for stop in range(spectrum.shape[axis], positive, -size):
        start = max(positive, stop - size)
        folded[*before, size - (stop - start) :] += spectrum[*before, start:stop]
    return folded


def _first_half(spectrum: NDArray[Any]) -> NDArray[Any]:
    """Select the frequencies of a spectrum whose last one is not negative."""
    return spectrum[..., : spectrum.shape[-1] // 2 + 1]


def _opposite(spectrum: Complexes) -> Complexes:
    """Return a spectrum in the order of numpy.fft with each frequency moved to its opposite."""
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
        """Return half of the spectrum.

        Terms of few points are summed, the others transformed in pairs.
        """
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
        finer = _upsampling_factor(demanded)
        threads = _threads(self._which.size * finer**self._which.ndim)
        options = {"eps": demanded, "isign": -1, "modeord": 1, "nthreads": threads, "upsampfac": finer}
        return finufft_module().Plan(1, self._which.shape, dtype="complex128", **options)

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
        """Sum the waves of a term.

        They are ``exp(-2 pi i k.share)`` for each point, times its strength. The sums are products of one factor per
        axis.
        """
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
    """Return positive periods along the axes, shape (dim,).

    One number applies to all axes. Raises InputError for anything else.
    """
    periods = check_finite(lengths, "lengths")
    if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
        rule = f"it must be one number above zero or {dim} of them, in metres"
        raise InputError("lengths", f"is {lengths!r}", rule, "pass the period along each axis", value=lengths)
    return np.broadcast_to(periods, dim).copy()


def _check_counts(counts: ArrayLike, dim: int) -> tuple[int, ...]:
    """Return the number of frequencies along each axis.

    One number applies to all axes.

    Raises InputError if the spectrum would not fit into memory.
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


def _check_fits(sizes: Floats, lengths: Floats) -> None:
    """Raise InputError if balls exceed one period.

    ``sizes`` are their extents and ``lengths`` the periods, shape (d,), metres. Balls that exceed it would overlap
    their copies.
    """
    if (sizes > lengths * (1.0 + PERIOD_SLACK)).any():
        axis = int(np.argmax(sizes / lengths))
        problem = f"holds {lengths[axis]:g} m along {'xyz'[axis]}, but the balls extend over {sizes[axis]:g} m"
        raise InputError("lengths", problem, "they must fit into one period", "pass a longer period", value=lengths)


PairTable = Callable[[Floats], tuple[Floats, float]]
"""Function that maps the distances of pairs, metres, to integrals and their error."""

ROUNDING_UNIT: Final = 2.0**-52
"""Twice the relative rounding error of one operation."""

MAX_CYCLES_PER_RADIUS: Final = 32.0
"""Highest frequency considered for a band, cycles per radius of the smallest ball."""

BOUND_ROUNDING: Final = 1.0 + 2.0**-30
"""Factor that covers the rounding of the bounds themselves."""

ENERGY_SAMPLES: Final = 4096
"""Number of samples of the energy of a bump from which the band is chosen."""

PAIR_TABLE_NODES: Final = 64
"""Number of distances in a table for pairs of two radii."""

SELF_INTEGRAL_ERROR: Final = 1e-13
"""Relative error of the integral of the squared bump."""

BALLS_PER_BATCH: Final = 2**8
"""Number of balls whose neighbors are held in memory at once."""


def estimate_band(a: BallDescriptor, b: BallDescriptor, bound: float) -> float:
    """Estimate the highest frequency that matters.

    It is in cycles per metre. Frequencies above it contribute less than ``bound`` to the overlap. Above the frequencies
    of the gaps between balls, their energies add up. So the energy of a set above a frequency is the sum of the
    energies of its bumps. The result is at most :data:`MAX_CYCLES_PER_RADIUS` of the smallest ball.
    """
    k = np.linspace(0.0, MAX_CYCLES_PER_RADIUS, ENERGY_SAMPLES)
    energy = a.bump.table(a.dim, MAX_CYCLES_PER_RADIUS, 1e-9)(k) ** 2 * sphere_measure(k, a.dim)
    above = np.cumsum(energy[::-1])[::-1] * k[1]
    all_radii = np.concatenate([a.radii, b.radii])
    frequencies = np.geomspace(0.1 / all_radii.max(), MAX_CYCLES_PER_RADIUS / all_radii.min(), 400)
    tails = []
    for balls in (a, b):
        radii, counts = np.unique(balls.radii, return_counts=True)
        tails.append(
            sum(
                count * radius**a.dim * np.interp(radius * frequencies, k, above)
                for radius, count in zip(radii, counts, strict=True)
            )
        )
    is_enough = np.sqrt(tails[0]) * np.sqrt(tails[1]) <= bound
    return float(frequencies[np.argmax(is_enough)] if is_enough.any() else frequencies[-1])


class Rings(NamedTuple):
    """Frequencies of a band, ordered by rings.

    They are ``w = k / lengths`` with ``|k| <= halves``; the frequencies of a ring have similar moduli. Descriptors are
    real, so opposite frequencies have conjugate terms. Only frequency zero and the frequencies whose first non-zero
    entry is positive are stored.

    Attributes
    ----------
    lengths, halves
        The period along each axis, metres, and the highest frequency there, in cycles per period.
    indices, moduli, twice : ndarray of int16, shape (n, d), and of float64, shape (n,)
        k, ``|w|`` in cycles per metre, and the multiplicity of each frequency: 1 for zero, else 2. In ring order.
    starts : ndarray of int64, shape (rings + 1,)
        Start of each ring; the first ring is frequency zero alone.
    reaches : ndarray of int64, shape (rings, d)
        Largest modulus of k along each axis up to a ring.
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
        """Build the rings of a period.

        ``lengths``, shape (d,), are the periods, metres. A ring is as wide as one cycle in the longest of them.
        """
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
        """Number of frequencies along each axis.

        Both halves count, so the numbers are odd.
        """
        return tuple(2 * half + 1 for half in self.halves)

    @property
    def volume(self) -> float:
        """Volume of a period, metres to the power ``dim``."""
        return float(np.prod(self.lengths))

    def sums(self, values: Floats) -> Floats:
        """Sum values over each ring.

        ``values``, shape (n,), are in ring order; the result has shape (rings,).
        """
        return np.asarray(np.add.reduceat(values, self.starts[:-1]))

    def to_rings(self, box: Complexes) -> Complexes:
        """Convert a spectrum to ring order.

        It must be in the order of numpy.fft.
        """
        return box.reshape(-1)[self._flat_indices(1)]

    def to_box(self, half: Complexes) -> Complexes:
        """Convert a half spectrum to the order of numpy.fft.

        The half spectrum, in ring order, belongs to a real function.
        """
        flat = np.empty(math.prod(self.counts), dtype=np.complex128)
        flat[self._flat_indices(-1)], flat[self._flat_indices(1)] = half.conj(), half
        return flat.reshape(self.counts)

    def _flat_indices(self, sign: int) -> Ints:
        """Return the index of each frequency in a spectrum.

        The spectrum is full, flat and in the order of numpy.fft. ``sign`` -1 gives the opposite frequency.
        """
        columns = sign * self.indices.T.astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(columns), self.counts, mode="wrap"))


class Spectrum(NamedTuple):
    """Band-limited spectrum of a descriptor.

    ``values``, shape (n,), in ring order, metres to the power ``dim``, are ``F(w)`` with the origin in the center of
    the balls, and ``error`` bounds the error of each.
    """

    values: Complexes
    error: float

    @classmethod
    def of(cls, balls: BallDescriptor, center: Floats, rings: Rings, accuracy: float) -> Spectrum:
        """Compute the spectrum of balls about a point.

        ``center`` has shape (d,), metres; ``accuracy`` is relative to the largest value.
        """
        box = ball_spectrum(balls.centers - center, balls.radii, balls.bump, rings.lengths, rings.counts, accuracy)
        moved = PLACEMENT_ROUNDING * (balls.span + float(np.abs(center).max()))
        error = balls.integral * (2.0 * accuracy + 2.0 * math.pi * float(rings.moduli.max()) * moved)
        return cls(rings.to_rings(box), error)

    def tail(self, rings: Rings, norm: tuple[float, float]) -> float:
        """Return an upper bound of the energy outside the band.

        By Parseval's theorem, it is the integral of the squared descriptor, :func:`norm_square`, minus the energy in
        the band.
        """
        moduli, (total, off) = np.abs(self.values), norm
        inside = float((rings.twice * moduli * (moduli - 2.0 * self.error)).sum()) / rings.volume
        return max(0.0, total - inside) + off + 2.0**-44 * total


class Terms(NamedTuple):
    """Terms of the overlap, with bounds of partial sums.

    There is a term for each frequency. Kernels take this record.

    Attributes
    ----------
    products : ndarray of complex128, shape (n,)
        ``F_B conj(F_A) / V``, in ring order; doubled for the opposite frequency, except at frequency zero.
    bounds : ndarray of float64, shape (rings + 1,)
        Largest difference of the sum of the rings before r from the sum of all frequencies, at any placement. It
        includes the remaining rings, rounding and the errors of the spectra.
    indices, starts, reaches, lengths : ndarray
        As in :class:`Rings`.
    """

    products: Complexes
    bounds: Floats
    indices: NDArray[np.int16]
    starts: Ints
    reaches: Ints
    lengths: Floats

    @classmethod
    def of(cls, first: Spectrum, second: Spectrum, rings: Rings, far: float, tail: float) -> Terms:
        """Build the terms of an overlap.

        ``first`` is the spectrum of A, which moves, ``second`` the spectrum of B. Within the band, the sum of the
        moduli bounds the remaining terms. Outside, ``tail`` does, the product of the two tail norms (Cauchy and
        Schwarz). ``far``, in metres, bounds the rounding of a placement.
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

BELOW, ABOVE, OPEN = range(3)
"""Verdicts about an overlap and a threshold, equal to MISS, HIT and UNDECIDED of :class:`cspace.spectral.Verdict`."""


@kernel
def add_phases(share: float, first: int, last: int, phases: Complexes) -> None:
    """Write the phases of a range of frequencies.

    It sets ``phases[center + k]`` to exp(2 pi i k share) for ``first <= |k| <= last``. ``share`` is the placement along
    an axis, in periods. Each factor is computed independently, so that errors do not accumulate.
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
    """Sum the real parts of a range of terms.

    The terms are ``products * exp(2 pi i k.t)`` for the frequencies [start, stop) in ring order. ``phases``, shape (d,
    2 m + 1), are those of each axis.
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

    Returns the verdict, the number of frequencies, the sum and its bound. The verdict is BELOW or ABOVE if the sum and
    its bound prove it, otherwise OPEN; if the threshold is NaN, it is OPEN. ``placement``, shape (d,), metres, is the
    center of A relative to the center of B. ``phases`` is scratch of shape (d, 2 m + 1) for the highest frequency m of
    an axis.
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
            return BELOW, starts[ring + 1], total, bound
        if total - bound > threshold:
            return ABOVE, starts[ring + 1], total, bound
    return OPEN, starts[-1], total, terms.bounds[-1]


def separate_all(placements: Floats, terms: Terms, threshold: float) -> tuple[Bytes, Ints, Floats]:
    """Apply :func:`separate` to many placements.

    They have shape (n, d), metres. Returns verdicts (n,), numbers of frequencies (n,), and sums with their bounds (n,
    2).
    """
    number = len(placements)
    out = np.empty(number, np.uint8), np.empty(number, np.int64), np.empty((number, 2))
    phases = np.empty((placements.shape[1], 2 * int(terms.reaches[-1].max()) + 1), np.complex128)
    separate_each(np.ascontiguousarray(placements), terms, threshold, phases, out)
    return out


@kernel
def separate_each(
    placements: Floats, terms: Terms, threshold: float, phases: Complexes, out: tuple[Bytes, Ints, Floats]
) -> None:
    """Apply :func:`separate` to each placement.

    ``placements`` has shape (n, d); the results fill ``out``.
    """
    verdicts, counts, sums = out
    for n in range(len(placements)):
        verdicts[n], counts[n], sums[n, 0], sums[n, 1] = separate(placements[n], terms, threshold, phases)


def norm_square(balls: BallDescriptor) -> tuple[float, float]:
    """Integrate the square of a descriptor.

    Returns the integral, a sum over all pairs of balls, and a bound of its error.
    """
    # Each ball with itself once, and each pair of different balls twice.
    square = radial_transform(lambda s: balls.bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(square[0] * (balls.radii**balls.dim).sum())
    error = SAFETY_FACTOR * SELF_INTEGRAL_ERROR * value
    integrals = PairIntegrals(balls.bump, balls.dim)
    for i, j in _touching_pairs(balls):
        gaps = np.linalg.norm(balls.centers[i] - balls.centers[j], axis=1)
        values, errors = integrals.at(balls.radii[i], balls.radii[j], gaps)
        value, error = value + 2.0 * float(values.sum()), error + 2.0 * float(errors.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


class PairIntegrals:
    """Integrals of products of two bumps; radii with many pairs get a table."""

    def __init__(self, bump: Bump, dim: int) -> None:
        self._bump, self._dim = bump, dim
        self._tables: dict[complex, PairTable] = {}

    def at(self, first: Floats, second: Floats, distances: Floats) -> tuple[Floats, Floats]:
        """Return the integrals of pairs (n,) and bounds of their errors."""
        values, errors = np.zeros((2, len(distances)))
        pairs = np.maximum(first, second) + 1j * np.minimum(first, second)
        keys, group, counts = np.unique(pairs, return_inverse=True, return_counts=True)
        # The integrals of indicators are not smooth in the distance.
        many = (counts > PAIR_TABLE_NODES) & (not self._bump.is_indicator)
        for number in np.flatnonzero(many):
            key = complex(keys[number])
            if key not in self._tables:
                self._tables[key] = _tabulate_pair(self._bump, key.real, key.imag, self._dim)
            members = group == number
            values[members], errors[members] = self._tables[key](distances[members])
        few = ~many[group]
        if few.any():
            values[few], errors[few] = pair_integrals(self._bump, first[few], second[few], distances[few], self._dim)
        return values, errors


def _touching_pairs(balls: BallDescriptor) -> Iterator[tuple[Ints, Ints]]:
    """Yield the pairs of touching balls, in batches.

    Each batch is two index arrays, shape (n,), the larger ball first.
    """
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


def _tabulate_pair(bump: Bump, first: float, second: float, dim: int) -> PairTable:
    """Tabulate the integrals of pairs of two radii.

    ``first`` and ``second`` are the radii, metres.
    """
    reach = first + second
    nodes = chebyshev_nodes(PAIR_TABLE_NODES)
    between = np.cos(math.pi * np.arange(PAIR_TABLE_NODES + 1) / PAIR_TABLE_NODES)
    gaps = 0.5 * reach * (1.0 + np.concatenate([nodes, between]))
    values, errors = pair_integrals(bump, np.full_like(gaps, first), np.full_like(gaps, second), gaps, dim)
    fit = np.polynomial.Chebyshev(chebyshev_coefficients(values[:PAIR_TABLE_NODES]))
    error = float(errors.max()) + SAFETY_FACTOR * float(np.abs(fit(between) - values[PAIR_TABLE_NODES:]).max())
    return lambda distances: (np.asarray(fit(np.minimum(2.0 * distances / reach, 2.0) - 1.0)), error)

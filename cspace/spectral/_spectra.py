"""Spectra of sets of balls with arbitrary centers.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of
one radius have that radial factor times the spectrum of their centers, which one non-uniform FFT of
type 1 computes (Dutt and Rokhlin, 1993; Barnett, Magland and af Klinteberg, 2019). For a radius of
few balls, their terms are summed as products of one factor per axis; for many radii, a few
transforms serve all (:func:`radius_basis`).

*Error.* All bumps are non-negative, so the spectrum is largest at frequency 0, where it is the
integral of the descriptor; tolerances are relative to that value. Half of a tolerance is for the
table of ``psi^``, half for the transforms.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._support.arrays import Floats
from cspace._support.check import check_finite
from cspace._support.reporting import import_optional
from cspace._support.threads import cores
from cspace.errors import InputError
from cspace.spectral._bump import (
    MIN_TOLERANCE,
    TABLE_HALF_WIDTH,
    Bump,
    RadialTable,
    chebyshev_coefficients,
    chebyshev_nodes,
    check_bump,
    check_tolerance,
    count_nodes,
    table_points,
)
from cspace.spectral._descriptors import check_solid_balls

Complexes = NDArray[np.complex128]
"""Array of complex numbers."""

MIN_SPECTRUM_TOLERANCE: Final = 1e-12
"""Smallest tolerance of a spectrum; non-uniform transforms round more than tables."""

TRANSFORM_TOLERANCE_SHARE: Final = 0.015
"""Share of the tolerance of a spectrum that its transforms must meet.

Errors up to 7 times the tolerance of a transform, which bounds a 2-norm, were observed.
"""

MIN_TRANSFORM_TOLERANCE: Final = 2e-14
"""Smallest tolerance that a non-uniform transform can meet, because of its rounding."""

MIN_SAMPLES_FOR_THREADS: Final = 2**18
"""Number of frequencies and points of a transform from which several threads are faster than one.
"""

MAX_SUMMED_BALLS: Final = {2: 48, 3: 96}
"""Number of balls of one radius up to which sums of products are faster than a transform, by
dimension."""

MIN_RADII_FOR_BASIS: Final = 8
"""Number of different radii up to which a basis saves no transform."""

MAX_FREQUENCIES: Final = 2**26
"""Largest number of frequencies of a spectrum, whose values take a gigabyte."""

BASIS_TOLERANCE_SHARE: Final = 0.02
"""Share of the tolerance for each source of error of a basis: spectra, nodes, decomposition and
tables.

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

    It is ``F(w) = integral f(x) exp(-2 pi i w.x) dx`` on a lattice of frequencies, ``w = k /
    lengths``, in the order of ``numpy.fft.fftfreq``. These are the Fourier coefficients of ``f``,
    repeated with these periods, times the product of ``lengths``.

    Parameters
    ----------
    centers : array-like, shape (n, dim)
        Metres, anywhere; only the extent of the balls must fit into one period.
    radii : array-like, shape (n,), or one number
        Metres. Balls of equal radii share a transform.
    bump : Bump
    lengths, counts : array-like, shape (dim,), or one number
        Periods, metres, and number of frequencies along each axis: ``k`` from ``-(count // 2)`` to
        ``(count - 1) // 2``.
    tolerance : float
        Largest error, relative to the largest value ``F(0)``; from 1e-12 to 0.1. With weights,
        relative to the sum of the moduli of the balls' integrals.
    weights : array-like, shape (n,), optional
        Factor of each ball's bump, of any sign.

    Returns
    -------
    ndarray of complex128, shape counts
        Metres to the power ``dim``.

    Raises InputError if a value is not usable, the balls do not fit into one period, or there are
    more than 2^26 frequencies. Raises MissingPackageError if finufft is needed, for many balls of
    one radius, and is not installed.
    """
    points, sizes = check_solid_balls(centers, radii)
    kind = check_bump(bump)
    dim = points.shape[1]
    within = check_tolerance(tolerance, MIN_SPECTRUM_TOLERANCE)
    lattice = FrequencyLattice(_check_lengths(lengths, dim), _check_counts(counts, dim))
    factors = np.ones_like(sizes) if weights is None else check_finite(weights, "weights")
    if factors.shape != sizes.shape:
        raise InputError(
            "weights",
            f"has shape {factors.shape}",
            f"there must be one for each of {len(sizes)} balls",
            "pass numbers",
        )
    lower = (points - sizes[:, None]).min(axis=0)
    upper = (points + sizes[:, None]).max(axis=0)
    extent = upper - lower
    # 1e-9 allows for rounding; larger balls would overlap their copies.
    if (extent > lattice.periods * (1.0 + 1e-9)).any():
        axis = int(np.argmax(extent / lattice.periods))
        length = f"{lattice.periods[axis]:g} m along {'xyz'[axis]}"
        raise InputError(
            "lengths",
            f"holds {length}, but the balls extend over {extent[axis]:g} m",
            "they must fit into one period",
            "pass a longer period",
        )
    terms = [
        term._replace(strengths=term.strengths * factors[term.members])
        for term in radial_terms(lattice, kind, sizes, within)
    ]
    return sum_terms(lattice, points, terms, within)


# ---- terms ---------------------------------------------------------------------------------------


class FrequencyLattice(NamedTuple):
    """Frequencies ``k / periods``, in the order of numpy.fft.

    ``periods``, shape (d,), are in metres; ``counts`` are the numbers of frequencies along the
    axes.
    """

    periods: Floats
    counts: tuple[int, ...]

    @property
    def moduli(self) -> Floats:
        """Moduli of the frequencies without negative parts, cycles per metre."""
        axes = [np.arange(count // 2 + 1) for count in self.counts]
        indices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return np.asarray(np.linalg.norm(indices / self.periods, axis=-1))

    def spread(self, values: Floats) -> Floats:
        """Copy values of :attr:`moduli` to all frequencies of these moduli."""
        sources = [np.abs(frequency_indices(count)) for count in self.counts]
        return values[np.ix_(*sources)]


class Term(NamedTuple):
    """Waves around points, times a radial factor.

    ``members``, shape (n,), are the indices of the points, ``strengths``, shape (n,), the factors
    of their waves, and ``factor`` is the factor of each of the moduli of a
    :class:`FrequencyLattice`.
    """

    members: NDArray[np.intp]
    strengths: Floats
    factor: Floats


def radial_terms(
    lattice: FrequencyLattice, bump: Bump, radii: Floats, tolerance: float
) -> Iterator[Term]:
    """Return terms that describe balls of given radii, shape (n,), around any centers.

    Few radii have a term each; many share a basis.
    """
    moduli = lattice.moduli
    dim = len(lattice.counts)
    radius_count = len(np.unique(radii))
    terms = None
    if radius_count > MIN_RADII_FOR_BASIS:
        terms = radius_basis(bump, radii, moduli, dim, tolerance, radius_count)
    if terms is None:
        terms = _terms_by_radius(bump, radii, moduli, dim, tolerance)
    return terms


def _terms_by_radius(
    bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float
) -> Iterator[Term]:
    """Yield one term for each different radius, which has all balls of that radius."""
    table = bump.table(dim, float(radii.max() * moduli.max()), 0.5 * tolerance)
    for radius in np.unique(radii).tolist():
        members = np.flatnonzero(radii == radius)
        strengths = np.full(len(members), radius**dim)
        yield Term(members, strengths, table(radius * moduli))


def radius_basis(
    bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float, max_terms: int
) -> Iterator[Term] | None:
    """Return a few terms that represent balls of all radii.

    Returns None unless there are fewer than ``max_terms`` terms. As a function of the radius,
    ``psi^(r |w|)`` is a mixture of exponentials whose phase is at most ``2 pi |w| r``. So it is
    interpolated between Chebyshev nodes in the radius with the same proven error as in the
    frequency (:class:`RadialTable`). A singular value decomposition of the spectra at the nodes
    leaves as many combinations as the tolerance needs. The strength of a ball in each combination
    depends on its radius.
    """
    # Chebyshev nodes between the smallest and the largest radius.
    max_modulus = float(moduli.max())
    max_radius = float(radii.max())
    min_radius = float(radii.min())
    within = BASIS_TOLERANCE_SHARE * tolerance
    center = 0.5 * (min_radius + max_radius)
    half = 0.5 * (max_radius - min_radius)
    highest = max_radius * max_modulus
    count = count_nodes(within, 2.0 * math.pi * max_modulus * half)
    if count > 6 * max_terms:  # finding the basis would take longer than it saves
        return None
    spectrum = bump.table(dim, highest + 2.0 * TABLE_HALF_WIDTH, max(MIN_TOLERANCE, within))
    nodes = center + half * chebyshev_nodes(count)
    samples = max_modulus * np.linspace(0.0, 1.0, 4 * count)
    # Columns of ``left`` are combinations of the radii at the nodes, the largest first.
    left, sizes, _ = np.linalg.svd(spectrum(np.outer(nodes, samples)), full_matrices=False)
    rank = int(np.count_nonzero(sizes > within * spectrum(np.zeros(1))[0]))
    if rank >= max_terms:
        return None
    combinations = left[:, :rank]
    # Tables need unit band limit, so frequencies are in cycles per largest radius.
    points = table_points(highest, within / math.sqrt(count))
    values = spectrum(np.multiply.outer(nodes / max_radius, points))
    # The share of each ball in each combination, from its radius.
    positions = np.clip((radii - center) / half, -1.0, 1.0)
    shares = np.polynomial.chebyshev.chebval(positions, chebyshev_coefficients(combinations))
    strengths = shares * radii**dim
    all_balls = np.arange(len(radii))
    frequencies = max_radius * moduli

    def make_terms() -> Iterator[Term]:
        """Yield the term of each combination."""
        for combination, row in zip(combinations.T, strengths, strict=True):
            table = RadialTable(np.tensordot(combination, values, axes=1), highest)
            yield Term(all_balls, row, table(frequencies))

    return make_terms()


# ---- non-uniform transforms ----------------------------------------------------------------------


def finufft_module() -> Any:
    """Import finufft; raises MissingPackageError if it is not installed."""
    return import_optional(
        "finufft", "spectra at centers that lie on no lattice need it", "spectral"
    )


def sum_terms(
    lattice: FrequencyLattice, points: Floats, terms: Iterable[Term], tolerance: float
) -> Complexes:
    """Compute the spectrum of terms around points (n, d), shape ``lattice.counts``."""
    # Places as shares of a period, which repeat with it.
    shares = points / lattice.periods
    shares -= np.round(shares)
    total = np.zeros(lattice.counts, dtype=np.complex128)
    for term in terms:
        sum_waves = _transform
        if len(term.members) <= MAX_SUMMED_BALLS[len(lattice.counts)]:
            sum_waves = _sum_products
        waves = sum_waves(lattice, shares[term.members], term.strengths, tolerance)
        waves *= lattice.spread(term.factor)
        total += waves
    return total


def _transform(
    lattice: FrequencyLattice, shares: Floats, strengths: Floats, tolerance: float
) -> Complexes:
    """Sum ``strength exp(-2 pi i k.share)`` over points by a non-uniform transform.

    ``shares``, shape (n, d), are the places of the points in a period.
    """
    demanded = max(MIN_TRANSFORM_TOLERANCE, TRANSFORM_TOLERANCE_SHARE * tolerance)
    transform = getattr(finufft_module(), f"nufft{shares.shape[1]}d1")
    angles = 2.0 * math.pi * shares.T.copy()
    options = _transform_options(demanded, math.prod(lattice.counts))
    waves: Complexes = transform(
        *angles, strengths.astype(np.complex128), lattice.counts, isign=-1, **options
    )
    return waves


def _sum_products(
    lattice: FrequencyLattice, shares: Floats, strengths: Floats, tolerance: float
) -> Complexes:
    """Sum ``strength exp(-2 pi i k.share)`` over points, as products of one factor per axis.

    ``shares``, shape (n, d), are the places of the points in a period. The tolerance is met anyway.
    """
    # Factors have shape (frequencies, points); those of all axes but the first are merged.
    first, *others = (
        np.exp(-2j * math.pi * np.outer(frequency_indices(count), column))
        for count, column in zip(lattice.counts, shares.T, strict=True)
    )
    merged = others[0]
    if len(others) == 2:
        merged = (merged[:, None] * others[1]).reshape(-1, len(strengths))
    return np.asarray(((first * strengths) @ merged.T).reshape(lattice.counts))


def evaluate_real_series(points: Floats, spectra: Complexes, tolerance: float) -> Floats:
    """Evaluate Fourier series of real functions at points.

    ``points`` has shape (n, d), in radians. ``spectra``, shape (m, counts), are the coefficients in
    the order of numpy.fft; the result has shape (m, n). The tolerance is relative to the 2-norm of
    the coefficients of a series.
    """
    transform = getattr(finufft_module(), f"nufft{points.shape[1]}d2")
    options = _transform_options(tolerance, spectra.size + len(points))
    series = transform(*points.T.copy(), spectra, isign=1, **options)
    return np.asarray(np.atleast_2d(series).real)


def _transform_options(tolerance: float, samples: int) -> dict[str, Any]:
    """Choose the options of a transform; large ones take several threads."""
    upsampling = 1.25
    if tolerance < 1e-8:  # with a coarser grid, errors exceeded the tolerance
        upsampling = 1.5 if tolerance >= 1e-11 else 2.0
    threads = cores() if samples >= MIN_SAMPLES_FOR_THREADS else 1
    return {"eps": tolerance, "modeord": 1, "nthreads": threads, "upsampfac": upsampling}


def frequency_indices(count: int) -> NDArray[np.intp]:
    """Return integer frequencies in the order of numpy.fft."""
    return np.fft.fftfreq(count, 1.0 / count).astype(np.intp)


# ---- arguments -----------------------------------------------------------------------------------


def _check_lengths(lengths: ArrayLike, dim: int) -> Floats:
    """Check period lengths and return one per axis, shape (dim,)."""
    periods = check_finite(lengths, "lengths")
    if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
        raise InputError(
            "lengths",
            f"is {lengths!r}",
            f"it must be one number above zero or {dim} of them, in metres",
            "pass the period along each axis",
        )
    return np.broadcast_to(periods, dim).copy()


def _check_counts(counts: ArrayLike, dim: int) -> tuple[int, ...]:
    """Return the number of frequencies along each axis.

    Raises InputError for anything else, or for too many frequencies.
    """
    numbers = np.asarray(counts)
    is_whole = numbers.dtype.kind in "iu"
    if numbers.shape not in {(), (dim,)} or not is_whole or (numbers <= 0).any():
        raise InputError(
            "counts",
            f"is {counts!r}",
            f"it must be one whole number above zero or {dim} of them",
            "pass e.g. 256",
        )
    shape = tuple(np.broadcast_to(numbers, dim).tolist())
    if math.prod(shape) > MAX_FREQUENCIES:
        raise InputError(
            "counts",
            f"is {counts!r}",
            f"at most {MAX_FREQUENCIES} frequencies are computed",
            "pass smaller counts",
        )
    return shape

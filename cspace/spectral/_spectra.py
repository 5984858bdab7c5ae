"""Spectra of sets of balls with arbitrary centers.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of
one radius have that radial factor times the spectrum of their centers, which one non-uniform FFT of
type 1 computes (Dutt and Rokhlin, 1993; Barnett, Magland and af Klinteberg, 2019), or for few balls
a sum of products of one factor per axis.

*Error.* All bumps are non-negative, so the spectrum is largest at frequency 0, where it is the
integral of the descriptor; tolerances are relative to that value.
"""

from __future__ import annotations

import math
import os
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.inside import Bools, Floats, check_finite, count_cores, import_optional
from cspace.spectral._ball_sets import as_balls
from cspace.spectral._bump import Bump, check_bump, radial_table

Complexes = NDArray[np.complex128]
"""Array of complex numbers."""

MIN_SPECTRUM_TOLERANCE: Final = 1e-12
"""Smallest tolerance of a spectrum, because of the rounding of non-uniform transforms."""

MAX_SUMMED_BALLS: Final = {2: 48, 3: 96}
"""Number of balls of one radius up to which sums of products are faster than a transform, by
dimension."""

PROCESS: Final = os.getpid()
"""Process that imported the module; in a fork of it, threads of OpenMP wait for ever."""


def ball_spectrum(
    centers: ArrayLike,
    radii: ArrayLike,
    bump: Bump,
    lengths: ArrayLike,
    counts: ArrayLike,
    tolerance: float = 1e-9,
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
        Largest error, relative to the largest value ``F(0)``; from 1e-12 to 0.1.

    Returns
    -------
    ndarray of complex128, shape counts
        Metres to the power ``dim``.

    Raises InputError if a value is not usable, the balls do not fit into one period, or there are
    more than 2^26 frequencies. Raises MissingPackageError if finufft is needed, for many balls of
    one radius, and is not installed.
    """
    balls = as_balls((centers, radii), "radii")
    kind = check_bump(bump)
    within = check_finite(tolerance, "tolerance")
    if within.ndim or not MIN_SPECTRUM_TOLERANCE <= within <= 0.1:
        raise InputError(
            "tolerance",
            f"is {tolerance!r}",
            f"it must be one number from {MIN_SPECTRUM_TOLERANCE:g} to 0.1",
        )
    lattice = FrequencyLattice.of(lengths, counts, balls.dim)
    extent = np.ptp(balls.bounds, axis=0)
    # 1e-9 allows for rounding; larger balls would overlap their copies.
    if (extent > lattice.periods * (1.0 + 1e-9)).any():
        axis = int(np.argmax(extent / lattice.periods))
        length = f"{lattice.periods[axis]:g} m along {'xyz'[axis]}"
        raise InputError(
            "lengths",
            f"holds {length}, but the balls extend over {extent[axis]:g} m",
            "they must fit into one period",
        )
    return RadialFactors(lattice, kind, balls.radii).spectrum(balls.centers, float(within))


class FrequencyLattice(NamedTuple):
    """Frequencies ``k / periods``, in the order of numpy.fft.

    ``periods``, shape (d,), are in metres; ``counts`` are the numbers of frequencies along the
    axes.
    """

    periods: Floats
    counts: tuple[int, ...]

    @classmethod
    def of(cls, lengths: ArrayLike, counts: ArrayLike, dim: int) -> FrequencyLattice:
        """Create a lattice from periods and counts, one or per axis.

        Raises InputError if a value is not usable, or there are too many frequencies.
        """
        ones = np.ones(dim)
        periods = check_finite(lengths, "lengths")
        if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
            raise InputError(
                "lengths",
                f"is {lengths!r}",
                f"it must be one number above zero or {dim} of them, in metres",
            )
        numbers = check_finite(counts, "counts")
        is_usable = numbers.shape in {(), (dim,)} and (numbers >= 1.0).all()
        # Largest number of frequencies of a spectrum, whose values take a gigabyte.
        max_frequencies = 2**26
        if not is_usable or (numbers % 1.0).any() or np.prod(numbers * ones) > max_frequencies:
            raise InputError(
                "counts",
                f"is {counts!r}",
                f"it must be one whole number above zero or {dim} of them, and at most "
                f"{max_frequencies} frequencies in all",
            )
        return cls(periods * ones, tuple((numbers * ones).astype(int).tolist()))

    @property
    def indices(self) -> list[NDArray[Any]]:
        """Whole numbers k along each axis."""
        return [np.asarray(np.fft.fftfreq(count, 1.0 / count)) for count in self.counts]

    @property
    def waves(self) -> list[Floats]:
        """Broadcastable frequencies along each axis, cycles per metre."""
        axes = [k / period for k, period in zip(self.indices, self.periods, strict=True)]
        return list(np.meshgrid(*axes, indexing="ij", sparse=True))

    @property
    def moduli(self) -> Floats:
        """Moduli of the frequencies, shape ``counts``, cycles per metre."""
        return np.asarray(np.sqrt(sum(wave**2 for wave in self.waves)))


class RadialFactors:
    """Spectra of balls of given radii, around any centers.

    Attributes
    ----------
    radii : ndarray of float64, shape (n,)
        Radii of the balls, metres.
    groups : list of tuple
        For each radius r, the indices of its balls, and the radial factor ``r^dim psi^(r |w|)`` at
        all frequencies.
    """

    def __init__(self, lattice: FrequencyLattice, bump: Bump, radii: Floats) -> None:
        """Compute the radial factor of each radius."""
        self.lattice = lattice
        self.radii = radii
        self.groups = []
        dim = len(lattice.counts)
        # Frequencies of one modulus share a value: those without negative parts have all moduli.
        corner = tuple(slice(0, count // 2 + 1) for count in lattice.counts)
        places = np.ix_(*(np.abs(k).astype(np.intp) for k in lattice.indices))
        moduli = lattice.moduli[corner]
        table = radial_table(bump, dim, 1 + int(radii.max() * moduli.max()))
        for radius in np.unique(radii).tolist():
            factor = radius**dim * table(radius * moduli)
            self.groups.append((np.flatnonzero(radii == radius), factor[places]))

    def spectrum(
        self, centers: Floats, tolerance: float, is_chosen: Bools | None = None
    ) -> Complexes:
        """Compute the spectrum of balls at centers (n, d), or chosen."""
        # Places as shares of a period, which repeat with it.
        shares = centers / self.lattice.periods
        shares -= np.round(shares)
        total = np.zeros(self.lattice.counts, dtype=np.complex128)
        for group, factor in self.groups:
            members = group if is_chosen is None else group[is_chosen[group]]
            if not len(members):
                continue
            sum_waves = _transform
            if len(members) <= MAX_SUMMED_BALLS[len(self.lattice.counts)]:
                sum_waves = _sum_products
            total += sum_waves(self.lattice, shares[members], tolerance) * factor
        return total


def _transform(lattice: FrequencyLattice, shares: Floats, tolerance: float) -> Complexes:
    """Sum ``exp(-2 pi i k.share)`` over points by a non-uniform transform.

    ``shares``, shape (n, d), are the places of the points in a period.
    """
    # Smallest tolerance that a non-uniform transform can meet, because of its rounding.
    # Share of the tolerance of a spectrum that its transforms must meet. Errors up to 7 times the
    # tolerance of a transform, which bounds a 2-norm, were observed.
    demanded = max(2e-14, 0.015 * tolerance)
    transform = getattr(_import_finufft(), f"nufft{shares.shape[1]}d1")
    angles = 2.0 * math.pi * shares.T.copy()
    ones = np.ones(len(shares), dtype=np.complex128)
    options = _transform_options(demanded, math.prod(lattice.counts))
    waves: Complexes = transform(*angles, ones, lattice.counts, isign=-1, **options)
    return waves


def _sum_products(lattice: FrequencyLattice, shares: Floats, tolerance: float) -> Complexes:
    """Sum ``exp(-2 pi i k.share)`` over points, by factors per axis.

    ``shares``, shape (n, d), are the places of the points in a period. The tolerance is met anyway.
    """
    rows, *others = (
        np.exp(-2j * math.pi * np.outer(k, column))
        for k, column in zip(lattice.indices, shares.T, strict=True)
    )
    if len(others) == 2:
        rows = (rows[:, None] * others[0]).reshape(-1, len(shares))
    columns = others[-1].T
    total = np.empty((len(rows), columns.shape[1]), dtype=np.complex128)
    # One large product would wake all threads of the linear algebra, which takes longer than many
    # small ones.
    # Largest number of multiplications of a matrix product that linear algebra leaves to one
    # thread.
    size = max(2, (2**16 - 1) // columns.size)
    for start in range(0, len(rows), size):
        np.matmul(rows[start : start + size], columns, out=total[start : start + size])
    return total.reshape(lattice.counts)


def evaluate_real_series(points: Floats, spectra: Complexes, tolerance: float) -> Floats:
    """Evaluate Fourier series of real functions at points.

    ``points`` has shape (n, d), in radians. ``spectra``, shape (m, counts), are the coefficients in
    the order of numpy.fft; the result has shape (m, n). The tolerance is relative to the 2-norm of
    the coefficients of a series.
    """
    transform = getattr(_import_finufft(), f"nufft{points.shape[1]}d2")
    options = _transform_options(tolerance, spectra.size + len(points))
    # FINUFFT warns of arrays that it must copy.
    series = transform(*points.T.copy(), np.ascontiguousarray(spectra), isign=1, **options)
    return np.asarray(np.atleast_2d(series).real)


def _import_finufft() -> Any:
    """Import finufft; raises MissingPackageError if it is not installed."""
    return import_optional(
        "finufft", "spectra at centers that lie on no lattice need it", "spectral"
    )


def _transform_options(tolerance: float, samples: int) -> dict[str, Any]:
    """Choose the options of a transform; large ones take several threads."""
    upsampling = 1.25
    if tolerance < 1e-8:  # with a coarser grid, errors exceeded the tolerance
        upsampling = 1.5 if tolerance >= 1e-11 else 2.0
    # Number of frequencies and points of a transform from which several threads are faster than
    # one.
    threads = count_cores() if samples >= 2**18 and os.getpid() == PROCESS else 1
    return {
        "eps": tolerance,
        "modeord": 1,
        "nthreads": threads,
        "upsampfac": upsampling,
        "showwarn": 0,  # of roundings, which the tolerances of the results include
    }

"""Spectra of sets of balls, with centres anywhere.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of one radius have
that radial factor times the spectrum of their centres: one non-uniform FFT (Dutt and Rokhlin, 1993; Barnett, Magland
and af Klinteberg, 2019), of type 1 for frequencies on a lattice and of type 3 for any others. Where a radius has so few
balls that a transform would not pay, their terms are summed, on a lattice as products of factors for each axis; and
where there are many radii, a few transforms stand for all (:mod:`cspace.spectral.descriptors.radius_basis`).

*Two by one.* A descriptor is real, so that ``F(-w)`` is the conjugate of ``F(w)``. With strengths ``a + i b`` one
transform G holds those of two real sets, and what they add up to with radial factors g and h, ``g A + h B``, is
``X(w) + conj(X(-w))`` with ``X = G (g - i h) / 2``. So the X of all pairs are summed, on a lattice that holds ``-w``
with each ``w``, and are mirrored once.

*Error.* All bumps are above zero, so the spectrum is largest at frequency 0, where it is the integral of the
descriptor, and tolerances are relative to that. Half of one is left to the table of ``psi^``, half to the transforms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.spectral.descriptors.bump import Bump
from cspace.spectral.descriptors.checks import (
    LEAST_SPECTRUM_TOLERANCE,
    check_counts,
    check_fits,
    check_frequencies,
    check_lengths,
    check_solid_balls,
    check_spectrum_memory,
    check_tolerance,
    finufft_module,
    tolerance_to_ask,
    transform_threads,
)
from cspace.spectral.descriptors.radius_basis import RadiusBasis

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FEW: Final = {2: 48, 3: 96}
"""Balls of one radius up to which sums of products are quicker than a transform of type 1."""

MANY: Final = 8.0
"""Transforms from which on it is tried whether fewer can stand for all radii."""

FEW_PAIRS: Final = 2**18
"""Pairs of a ball and a frequency up to which their sum is quicker than any transform of type 3."""

CHUNK: Final = 2**20
"""Pairs of a ball and a frequency that are held at once."""

SAMPLING: Final = ((1e-8, 1.25), (1e-11, 1.5), (0.0, 2.0))
"""How much more finely than its result a transform samples, from which tolerance on that is asked of it: with less, its
errors were seen to stay above the tolerance."""

ARRAYS: Final = {2: 7.5, 3: 11.5}
"""Complex arrays of the result's size that a transform of type 1 holds at once, if it samples twice as finely."""


def ball_spectrum(
    centers: ArrayLike,
    radii: ArrayLike,
    bump: Bump,
    lengths: ArrayLike,
    counts: Any,
    tolerance: float = 1e-9,
) -> Complexes:
    """Spectrum of the sum of balls' bumps on a lattice of frequencies.

    ``F(w) = integral f(x) exp(-2 pi i w.x) dx`` at ``w = k / lengths``, in the order of :func:`numpy.fft.fftfreq`: the
    coefficients, times the product of ``lengths``, of the Fourier series of ``f`` repeated with these periods.

    Parameters
    ----------
    centers : array-like, shape (n, dim)
        Metres, anywhere: only what the balls span must fit into one period.
    radii : array-like, shape (n,), or one number
        Metres. Balls of equal radii share a transform.
    bump : Bump
    lengths : array-like, shape (dim,), or one number
        Periods, metres.
    counts : sequence of int, length dim, or one int
        Frequencies along each axis: ``k`` from ``-(m // 2)`` to ``(m - 1) // 2``.
    tolerance : float
        Largest error, relative to the largest value, which is ``F(0)``; from 1e-12 to 0.1.

    Returns
    -------
    ndarray of complex128, shape counts
        Metres to the power ``dim``.

    Raises
    ------
    InputError
        If a value is not usable, the balls do not fit into one period, or the result does not fit into memory.
    MissingPackageError
        If finufft is needed, for many balls of one radius, and is not installed.
    """
    points, sizes, within = _checked(centers, radii, bump, tolerance)
    dim = points.shape[1]
    periods, numbers = check_lengths(lengths, dim), check_counts(counts, dim)
    check_fits((points - sizes[:, None]).min(axis=0), (points + sizes[:, None]).max(axis=0), periods)
    check_spectrum_memory(numbers, ARRAYS[dim])
    lattice = _Lattice.of(points / periods, numbers, periods)
    # In transforms, what each radius by itself would take.
    alone = float(np.minimum(1.0, np.unique(sizes, return_counts=True)[1] / FEW[dim]).sum())
    most = float(lattice.moduli[-1])
    basis = RadiusBasis.of(bump, sizes, most, dim, within, alone) if alone > MANY else None
    if basis is not None:
        everywhere = np.arange(len(sizes))
        lattice.transform([(everywhere, *term) for term in basis.terms(sizes)], 0.5 * within)
        return lattice.spectrum()
    table = bump.table(dim, float(sizes.max() * most), 0.5 * within)
    terms = [
        (members, np.full(len(members), radius**dim), partial(_scaled, table, radius))
        for radius, members in _classes(sizes)
    ]
    lattice.sum([term for term in terms if len(term[0]) <= FEW[dim]])
    lattice.transform([term for term in terms if len(term[0]) > FEW[dim]], 0.5 * within)
    return lattice.spectrum()


def ball_spectrum_at(
    centers: ArrayLike, radii: ArrayLike, bump: Bump, frequencies: ArrayLike, tolerance: float = 1e-9
) -> Complexes:
    """Spectrum of the sum of balls' bumps at any frequencies, such as those of rings.

    Parameters
    ----------
    centers : array-like, shape (n, dim)
        Metres.
    radii : array-like, shape (n,), or one number
        Metres. Balls of equal radii share a transform.
    bump : Bump
    frequencies : array-like, shape (..., dim)
        Cycles per metre.
    tolerance : float
        Largest error, relative to the value at frequency 0; from 1e-12 to 0.1.

    Returns
    -------
    ndarray of complex128, shape (...)
        Metres to the power ``dim``.

    Raises
    ------
    InputError
        If a value is not usable.
    MissingPackageError
        If finufft is needed, for many balls and frequencies, and is not installed.
    """
    points, sizes, within = _checked(centers, radii, bump, tolerance)
    dim = points.shape[1]
    waves = check_frequencies(frequencies, dim)
    flat = waves.reshape(-1, dim)
    total = np.zeros(len(flat), dtype=np.complex128)
    if not flat.size:
        return total.reshape(waves.shape[:-1])
    moduli = np.linalg.norm(flat, axis=1)
    table = bump.table(dim, float(sizes.max() * moduli.max()), 0.5 * within)
    for radius, members in _classes(sizes):
        part = points[members]
        sums = _type3(part, flat, 0.5 * within) if _type3_pays(part, flat) else _sum(part, flat)
        total += radius**dim * table(radius * moduli) * sums
    return total.reshape(waves.shape[:-1])


def _checked(centers: ArrayLike, radii: ArrayLike, bump: Bump, tolerance: float) -> tuple[Floats, Floats, float]:
    points, sizes = check_solid_balls(centers, radii)
    if not isinstance(bump, Bump):
        raise InputError(f"bump is {bump!r}; it must be a Bump; pass e.g. Bump(2.0)")
    return points, sizes, check_tolerance(tolerance, LEAST_SPECTRUM_TOLERANCE)


def _classes(sizes: Floats) -> Iterator[tuple[float, NDArray[np.intp]]]:
    """Each radius, and the balls that have it."""
    order = np.argsort(sizes, kind="stable")
    radii, starts = np.unique(sizes[order], return_index=True)
    return zip(radii.tolist(), np.split(order, starts[1:]), strict=True)


Term = tuple[NDArray[np.intp], Floats, Callable[[Floats], Floats]]
"""Which points, their strengths, and the factor by the modulus of the frequency."""


@dataclass(frozen=True, eq=False, slots=True)
class _Lattice:
    """The sum X of which a spectrum is ``X(w) + conj(X(-w))``, on a lattice that holds ``-w`` with each ``w``.

    Attributes
    ----------
    shares : ndarray of float64, shape (n, dim)
        Points, in periods, from -0.5 to 0.5.
    numbers : tuple of int
        Frequencies along each axis of the spectrum.
    moduli : ndarray of float64, shape (m,)
        Those that occur, from the smallest on, cycles per metre.
    which : ndarray of int32
        Which of them each frequency has, in numpy.fft's order.
    half : ndarray of complex128
        X, in the same order: odd numbers along each axis.
    """

    shares: Floats
    numbers: tuple[int, ...]
    moduli: Floats
    which: NDArray[np.int32]
    half: Complexes

    @classmethod
    def of(cls, shares: Floats, numbers: tuple[int, ...], periods: Floats) -> _Lattice:
        """An empty sum."""
        odd = tuple(2 * (m // 2) + 1 for m in numbers)
        # Moduli are the same in each orthant.
        axes = [np.arange(m // 2 + 1) / period for m, period in zip(odd, periods.tolist(), strict=True)]
        orthant = np.sqrt(sum(part * part for part in np.meshgrid(*axes, indexing="ij", sparse=True)))
        moduli, which = np.unique(orthant, return_inverse=True)
        place = np.ix_(*(np.abs(_waves(m)) for m in odd))
        spread = which.reshape(orthant.shape).astype(np.int32)[place]
        return cls(shares - np.round(shares), numbers, moduli, spread, np.zeros(odd, dtype=np.complex128))

    def transform(self, terms: list[Term], tolerance: float) -> None:
        """Add terms, two by one non-uniform FFT."""
        if not terms:
            return
        asked = tolerance_to_ask(tolerance)
        finer = next(finer for least, finer in SAMPLING if asked >= least)
        threads = transform_threads(self.half.size * finer**self.half.ndim)
        plan = finufft_module().Plan(
            1, self.half.shape, eps=asked, isign=-1, modeord=1, nthreads=threads, dtype="complex128", upsampfac=finer
        )
        angles = 2.0 * math.pi * self.shares.T
        placed = None
        for first, second in zip_longest(terms[::2], terms[1::2]):
            points, strengths, factor = first[0], first[1].astype(np.complex128), 0.5 * first[2](self.moduli)
            if second is not None:
                # Terms of the same points share them; others lie side by side.
                same = second[0] is points
                points = points if same else np.concatenate([points, second[0]])
                more = 1j * second[1]
                strengths = strengths + more if same else np.concatenate([strengths, more])
                factor = factor - 0.5j * second[2](self.moduli)
            if points is not placed:
                held = [np.ascontiguousarray(column[points]) for column in angles]
                plan.setpts(*held)
                placed = points
            self._add(plan.execute(strengths), factor)

    def sum(self, terms: list[Term]) -> None:
        """Add terms of a few points with strengths that are all the same, summed."""
        for members, strengths, factor in terms:
            self._add(_sum_on_lattice(self.shares[members], self.half.shape), 0.5 * strengths[0] * factor(self.moduli))

    def spectrum(self) -> Complexes:
        """``X(w) + conj(X(-w))``."""
        waves = [_waves(m) for m in self.numbers]
        total = self.half[np.ix_(*waves)]
        total += self.half[np.ix_(*(-k for k in waves))].conj()
        return total

    def _add(self, waves: Complexes, factor: Floats | Complexes) -> None:
        waves *= factor[self.which]
        self.half[...] += waves


def _waves(count: int) -> NDArray[np.intp]:
    """Whole frequencies in numpy.fft's order."""
    return np.fft.fftfreq(count, 1.0 / count).astype(np.intp)


def _scaled(table: Callable[[Floats], Floats], radius: float, moduli: Floats) -> Floats:
    return table(radius * moduli)


def _sum_on_lattice(shares: Floats, counts: tuple[int, ...]) -> Complexes:
    """Sums over points of ``exp(-2 pi i k.share)``: the term of a point is a product of one factor for each axis."""
    factors = [np.exp(-2j * math.pi * _waves(m)[:, None] * column) for m, column in zip(counts, shares.T, strict=True)]
    total = np.zeros(counts, dtype=np.complex128)
    step = max(1, CHUNK // math.prod(counts[1:]))
    for start in range(0, len(shares), step):
        first, *rest = (factor[:, start : start + step] for factor in factors)
        others = rest[0] if len(rest) == 1 else (rest[0][:, None] * rest[1][None]).reshape(-1, rest[0].shape[1])
        total += (first @ others.T).reshape(counts)
    return total


def _type3(points: Floats, frequencies: Floats, tolerance: float) -> Complexes:
    """Sum over points of ``exp(-2 pi i w.p)``, at any frequencies, by a non-uniform FFT."""
    module = finufft_module()
    transform = getattr(module, f"nufft{points.shape[1]}d3")
    angles = [np.ascontiguousarray(2.0 * math.pi * column) for column in points.T]
    targets = [np.ascontiguousarray(column) for column in frequencies.T]
    ones = np.ones(len(points), dtype=np.complex128)
    asked = tolerance_to_ask(tolerance)
    threads = transform_threads(len(points) + len(frequencies))
    return np.asarray(transform(*angles, ones, *targets, eps=asked, isign=-1, nthreads=threads))


def _type3_pays(points: Floats, frequencies: Floats) -> bool:
    """Whether a transform, whose inner grid grows with both extents, is smaller than the sum."""
    pairs = float(len(points)) * len(frequencies)
    inner = np.prod(2.0 * np.ptp(points, axis=0) * np.ptp(frequencies, axis=0) + 32.0)
    return bool(pairs > max(FEW_PAIRS, inner))


def _sum(points: Floats, frequencies: Floats) -> Complexes:
    """The same, term by term."""
    step = max(1, CHUNK // len(points))
    chunks = (frequencies[start : start + step] for start in range(0, len(frequencies), step))
    return np.concatenate([np.exp(-2j * math.pi * (chunk @ points.T)).sum(axis=1) for chunk in chunks])

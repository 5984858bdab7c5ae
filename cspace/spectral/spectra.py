"""Spectra of sets of balls, with centres anywhere.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of one radius have
that radial factor times the spectrum of their centres: one non-uniform FFT (Dutt and Rokhlin, 1993; Barnett, Magland
and af Klinteberg, 2019) of type 1. Where a radius has so few balls that a transform would not pay, their terms are
summed, as products of factors for each axis; and where there are many radii, a few transforms stand for all
(:func:`radius_basis`).

*Error.* All bumps are above zero, so the spectrum is largest at frequency 0, where it is the integral of the
descriptor, and tolerances are relative to that. Half of one is left to the table of ``psi^``, half to the transforms.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Floats
from cspace.check import finite
from cspace.errors import InputError, optional
from cspace.limits import KEEP, bytes_text, cells_of, free_bytes
from cspace.spectral.bump import (
    HALF,
    LEAST_TOLERANCE,
    Bump,
    RadialTable,
    chebyshev_coefficients,
    chebyshev_nodes,
    check_bump,
    check_tolerance,
    nodes_needed,
    table_points,
)
from cspace.spectral.descriptors import check_solid_balls
from cspace.threads import cores

Complexes = NDArray[np.complex128]

LEAST_SPECTRUM_TOLERANCE: Final = 1e-12  # of non-uniform transforms, whose rounding is larger

STRICTER: Final = 0.03
"""Part of a tolerance that is demanded of a non-uniform transform, whose own tolerance is that of a 2-norm: errors of
single values up to seven times that were seen."""

LEAST_DEMANDED: Final = 2e-14  # less is not demanded of a non-uniform transform: rounding would be left

SAMPLING: Final = ((1e-8, 1.25), (1e-11, 1.5), (0.0, 2.0))
"""How much more finely than its result a transform samples, by its tolerance: with less, its errors were seen to stay
above the tolerance."""

THREADED: Final = 2**19  # samples of a transform from which on several threads pay: they wait for each other
FEW: Final = {2: 48, 3: 96}  # balls of one radius up to which sums of products are quicker than a transform of type 1
BYTES: Final = {2: 120.0, 3: 184.0}  # memory for each value of a spectrum, at most, of a transform that samples finely
MANY: Final = 8.0  # transforms from which on it is tried whether fewer can stand for all radii

SHARE: Final = 0.02
"""Part of the tolerance of a basis for each of: the spectra, the nodes, the decomposition, and the tables of its
functions. Errors of the first three grow by the nodes' Lebesgue constant, below 6 for a thousand of them."""

MOST_NODES: Final = 6.0  # nodes, for each transform that radii by themselves would take, above which none is sought
SAMPLES: Final = 4  # frequencies at which spectra are decomposed, for each node
FIT_SLACK: Final = 1e-9  # part of a period by which what is transformed may be longer, from rounding


def ball_spectrum(
    centers: ArrayLike, radii: ArrayLike, bump: Bump, lengths: ArrayLike, counts: ArrayLike, tolerance: float = 1e-9
) -> Complexes:
    """Spectrum of the sum of balls' bumps on a lattice of frequencies.

    ``F(w) = integral f(x) exp(-2 pi i w.x) dx`` at ``w = k / lengths``, in the order of ``numpy.fft.fftfreq``: the
    coefficients, times the product of ``lengths``, of the Fourier series of ``f`` repeated with these periods.

    Parameters
    ----------
    centers : array-like, shape (n, dim)
        Metres, anywhere: only what the balls span must fit into one period.
    radii : array-like, shape (n,), or one number
        Metres. Balls of equal radii share a transform.
    bump : Bump
    lengths, counts : array-like, shape (dim,), or one number
        Periods, metres, and frequencies along each axis: ``k`` from ``-(count // 2)`` to ``(count - 1) // 2``.
    tolerance : float
        Largest error, relative to the largest value, which is ``F(0)``; from 1e-12 to 0.1.

    Returns
    -------
    ndarray of complex128, shape counts
        Metres to the power ``dim``.

    Raises InputError if a value is not usable, the balls do not fit into one period, or the result does not fit into
    memory, and MissingPackageError if finufft is needed, for many balls of one radius, and is not installed.
    """
    points, sizes = check_solid_balls(centers, radii)
    kind, within, dim = check_bump(bump), check_tolerance(tolerance, LEAST_SPECTRUM_TOLERANCE), points.shape[1]
    periods, numbers = _check_lengths(lengths, dim), _check_counts(counts, dim)
    reach = sizes[:, None]
    _check_fits((points + reach).max(axis=0) - (points - reach).min(axis=0), periods)
    lattice = _LatticeSum(points / periods, numbers, periods, 0.5 * within)
    # In transforms, what each radius by itself would take.
    alone = float(np.minimum(1.0, np.unique(sizes, return_counts=True)[1] / FEW[dim]).sum())
    terms = radius_basis(kind, sizes, lattice.moduli, dim, within, alone) if alone > MANY else None
    return lattice.spectrum(_terms_by_radius(kind, sizes, lattice.moduli, dim, within) if terms is None else terms)


# ---- non-uniform transforms ------------------------------------------------------------------------------------------


def finufft_module() -> Any:
    """The package finufft; MissingPackageError where it is not installed."""
    return optional("finufft", "spectra at centers that lie on no lattice need it", "spectral")


def real_series(points: Floats, spectra: Complexes, tolerance: float) -> Floats:
    """Fourier series of real functions at points, shape (n, d), radians: of coefficients (m, counts) in numpy.fft's
    order; (m, n). The tolerance is relative to the root of the sum of the squares of a series' coefficients.

    They are transformed two by two, one as the real part, the other, of the same size, as the imaginary one.
    """
    sizes = np.linalg.norm(spectra.reshape(len(spectra), -1), axis=1)
    scaled = spectra / np.where(sizes > 0.0, sizes, 1.0).reshape(-1, *[1] * points.shape[1])
    pairs = scaled[::2].copy()
    pairs[: len(scaled) // 2] += 1j * scaled[1::2]
    transform, finer = getattr(finufft_module(), f"nufft{points.shape[1]}d2"), _sampling(tolerance)
    options = {"isign": 1, "modeord": 1, "nthreads": _threads(spectra.size + len(points)), "upsampfac": finer}
    series = np.atleast_2d(transform(*points.T.copy(), pairs, eps=tolerance, **options))
    parts = np.stack([series.real, series.imag], axis=1).reshape(-1, len(points))[: len(sizes)]
    return np.asarray(parts * sizes[:, None])


def _sampling(tolerance: float) -> float:
    return next(finer for least, finer in SAMPLING if tolerance >= least)


def _threads(samples: float) -> int:
    return cores() if samples >= THREADED else 1


# ---- terms -----------------------------------------------------------------------------------------------------------


class Term(NamedTuple):
    """Waves around some points, with a strength each, times a function of the modulus of the frequency."""

    members: NDArray[np.intp]
    strengths: Floats
    factor: Floats


def _terms_by_radius(bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float) -> Iterator[Term]:
    """One term for each radius, at given moduli of the frequency."""
    table = bump.table(dim, float(radii.max() * moduli.max()), 0.5 * tolerance)
    order = np.argsort(radii, kind="stable")
    different, starts = np.unique(radii[order], return_index=True)
    for radius, members in zip(different.tolist(), np.split(order, starts[1:]), strict=True):
        yield Term(members, np.full(len(members), radius**dim), table(radius * moduli))


def radius_basis(
    bump: Bump, radii: Floats, moduli: Floats, dim: int, tolerance: float, alone: float
) -> Iterator[Term] | None:
    """Terms of all balls, fewer than ``alone``, that add up to those of all radii; None where it takes as many.

    As a function of the radius, ``psi^(r |w|)`` is a mixture of exponentials that turn by at most ``2 pi |w| r``. So it
    is interpolated between Chebyshev nodes in the radius with the same proven error as in the frequency
    (:class:`RadialTable`). A singular value decomposition of the nodes' spectra leaves as many combinations as the
    tolerance needs, each with strengths that depend on the radii.
    """
    most, largest = float(moduli.max()), float(radii.max())
    middle, half = 0.5 * (float(radii.min()) + largest), 0.5 * (largest - float(radii.min()))
    within = SHARE * tolerance
    count = nodes_needed(within, 2.0 * math.pi * most * half)
    if count > MOST_NODES * alone:
        return None
    spectrum = bump.table(dim, largest * most + 2.0 * HALF, max(LEAST_TOLERANCE, within))
    nodes = middle + half * chebyshev_nodes(count)
    left, sizes, _ = np.linalg.svd(
        spectrum(nodes[:, None] * (most * np.linspace(0.0, 1.0, SAMPLES * count))), full_matrices=False
    )
    rank = int(np.count_nonzero(sizes > within * spectrum(np.zeros(1))[0]))
    if rank >= alone:
        return None
    combinations = left[:, :rank]
    # Of unit band limit, as a table needs, in cycles per largest radius.
    values = spectrum((nodes / largest)[:, None, None] * table_points(largest * most, within / math.sqrt(count)))
    position = np.clip((radii - middle) / half, -1.0, 1.0)
    strengths = np.polynomial.chebyshev.chebval(position, chebyshev_coefficients(combinations)) * radii**dim
    everywhere = np.arange(len(radii))
    return (
        Term(everywhere, row, RadialTable(np.tensordot(column, values, axes=1), largest * most)(largest * moduli))
        for row, column in zip(strengths, combinations.T, strict=True)
    )


class _LatticeSum:
    """The sum X of which a spectrum is ``X(w) + conj(X(-w))``, on a lattice that holds ``-w`` with each ``w``.

    A descriptor is real, so that ``F(-w)`` is the conjugate of ``F(w)``. With strengths ``a + i b`` one transform G
    holds those of two real terms, and what they add up to with radial factors g and h, ``g A + h B``, is
    ``X(w) + conj(X(-w))`` with ``X = G (g - i h) / 2``. So the X of all pairs are summed, and mirrored together.

    The points are given in periods; :attr:`moduli` are those that occur, from the smallest on, cycles per metre.
    """

    def __init__(self, shares: Floats, counts: tuple[int, ...], periods: Floats, tolerance: float) -> None:
        self._shares = shares - np.round(shares)
        self._counts, self._tolerance = counts, tolerance
        shape = tuple(2 * (m // 2) + 1 for m in counts)
        # Moduli are the same in each orthant.
        axes = [np.arange(m // 2 + 1) / period for m, period in zip(shape, periods.tolist(), strict=True)]
        orthant = np.sqrt(sum(part * part for part in np.meshgrid(*axes, indexing="ij", sparse=True)))
        self.moduli, which = np.unique(orthant, return_inverse=True)
        self._which = which.reshape(orthant.shape).astype(np.int32)[np.ix_(*(np.abs(_waves(m)) for m in shape))]
        self._half = np.zeros(shape, dtype=np.complex128)
        self._placed: NDArray[np.intp] | None = None

    def spectrum(self, terms: Iterable[Term]) -> Complexes:
        """``X(w) + conj(X(-w))``; terms of a few points are summed, others two by one non-uniform FFT."""
        waiting: Term | None = None
        for term in terms:
            if len(term.members) <= FEW[len(self._counts)]:
                self._add(self._summed(term), 0.5 * term.factor)
            elif waiting is None:
                waiting = term
            else:
                self._transform(waiting, term)
                waiting = None
        if waiting is not None:
            self._transform(waiting, Term(waiting.members[:0], waiting.strengths[:0], np.zeros_like(self.moduli)))
        total = np.roll(np.flip(self._half), 1, axis=tuple(range(self._half.ndim)))  # -k in the place of k
        np.add(self._half, np.conj(total, out=total), out=total)
        return total if total.shape == self._counts else total[np.ix_(*map(_waves, self._counts))]

    @cached_property
    def _plan(self) -> Any:
        demanded = max(LEAST_DEMANDED, STRICTER * self._tolerance)
        finer = _sampling(demanded)
        threads = _threads(self._half.size * finer**self._half.ndim)
        options = {"eps": demanded, "isign": -1, "modeord": 1, "nthreads": threads, "upsampfac": finer}
        return finufft_module().Plan(1, self._half.shape, dtype="complex128", **options)

    def _transform(self, first: Term, second: Term) -> None:
        # Terms of the same points share them; others lie side by side.
        if first.members is second.members:
            points, strengths = first.members, first.strengths + 1j * second.strengths
        else:
            points = np.concatenate([first.members, second.members])
            strengths = np.concatenate([first.strengths, 1j * second.strengths])
        if points is not self._placed:
            self._angles = (2.0 * math.pi * self._shares[points]).T.copy()  # the plan does not keep them alive
            self._plan.setpts(*self._angles)
            self._placed = points
        self._add(self._plan.execute(strengths), 0.5 * (first.factor - 1j * second.factor))

    def _summed(self, term: Term) -> Complexes:
        """Sums over points of ``exp(-2 pi i k.share)``, products of one factor for each axis."""
        first, *rest = (
            np.exp(-2j * math.pi * _waves(m)[:, None] * column)
            for m, column in zip(self._half.shape, self._shares[term.members].T, strict=True)
        )
        others = rest[0]
        if len(rest) == 2:
            others = (rest[0][:, None] * rest[1][None]).reshape(-1, len(term.members))
        return np.asarray(((first * term.strengths) @ others.T).reshape(self._half.shape))

    def _add(self, waves: Complexes, factor: Floats | Complexes) -> None:
        waves *= factor[self._which]
        self._half += waves


def _waves(count: int) -> NDArray[np.intp]:
    """Whole frequencies in numpy.fft's order."""
    return np.fft.fftfreq(count, 1.0 / count).astype(np.intp)


# ---- arguments -------------------------------------------------------------------------------------------------------


def _check_lengths(lengths: ArrayLike, dim: int) -> Floats:
    """Periods along the axes, above zero, shape (dim,); one number stands for all."""
    periods = finite(lengths, "lengths")
    if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
        rule = f"it must be one number above zero or {dim} of them, in metres"
        raise InputError("lengths", f"is {lengths!r}", rule, "pass the period along each axis", value=lengths)
    return np.broadcast_to(periods, dim).copy()


def _check_counts(counts: ArrayLike, dim: int) -> tuple[int, ...]:
    """Numbers of frequencies along the axes; one stands for all. What does not fit into memory is refused."""
    numbers = np.asarray(counts)
    if numbers.shape not in {(), (dim,)} or numbers.dtype.kind not in "iu" or (numbers <= 0).any():
        rule = f"it must be one whole number above zero or {dim} of them"
        raise InputError("counts", f"is {counts!r}", rule, "pass e.g. 256", value=counts)
    shape = tuple(int(n) for n in np.broadcast_to(numbers, dim))
    free, needed = free_bytes(), BYTES[dim] * float(cells_of(shape))
    if needed > KEEP * free:
        fault = f"is {' x '.join(map(str, shape))}, which needs about {bytes_text(needed)} of memory"
        raise InputError("counts", fault, f"{bytes_text(free)} are free", "pass smaller counts", value=counts)
    return shape


def _check_fits(sizes: Floats, lengths: Floats) -> None:
    """Refuse what does not fit into one period: its Fourier series would be that of something that overlaps itself."""
    if (sizes > lengths * (1.0 + FIT_SLACK)).any():
        axis = int(np.argmax(sizes / lengths))
        fault = f"holds {lengths[axis]:g} m along {'xyz'[axis]}, and what is transformed is {sizes[axis]:g} m long"
        raise InputError(
            "lengths", fault, "it must fit into one period, wherever it lies", "pass a longer period", value=lengths
        )

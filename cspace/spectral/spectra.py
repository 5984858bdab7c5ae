"""Spectra of sets of balls, with centres anywhere.

A ball of radius r around p has the spectrum ``r^dim psi^(r |w|) exp(-2 pi i w.p)``. So the balls of one radius have
that radial factor times the spectrum of their centres: one non-uniform FFT (Dutt and Rokhlin, 1993; Barnett, Magland
and af Klinteberg, 2019) of type 1. Where a radius has so few balls that a transform would not pay, their terms are
summed, as products of factors for each axis; and where there are many radii, a few transforms stand for all
(:func:`radius_basis`).

*Error.* All bumps are above zero, so the spectrum is largest at frequency 0, where it is the integral of the
descriptor, and tolerances are relative to that. Half of one is left to the table of ``psi^``, half to the transforms.

*Bands.* Proofs of overlaps sum the terms of two spectra, ring by ring from the lowest frequency, and bound all that is
left; norms and thresholds are made of what pairs of balls have in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Bytes, Floats, Ints
from cspace.check import finite
from cspace.compiling import kernel
from cspace.errors import InputError, optional
from cspace.limits import KEEP, bytes_text, cells_of, free_bytes
from cspace.spectral.bump import (
    FLOOR,
    HALF,
    LEAST_TOLERANCE,
    PAIR_TOLERANCE,
    SAFETY,
    Bump,
    RadialTable,
    around,
    chebyshev_coefficients,
    chebyshev_nodes,
    check_bump,
    check_tolerance,
    nodes_needed,
    pair_integrals,
    radial_transform,
    table_points,
)
from cspace.spectral.descriptors import ROUNDING, BallDescriptor, check_solid_balls
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
        problem = f"is {' x '.join(map(str, shape))}, which needs about {bytes_text(needed)} of memory"
        raise InputError("counts", problem, f"{bytes_text(free)} are free", "pass smaller counts", value=counts)
    return shape


def _check_fits(sizes: Floats, lengths: Floats) -> None:
    """Refuse what does not fit into one period: its Fourier series would be that of something that overlaps itself."""
    if (sizes > lengths * (1.0 + FIT_SLACK)).any():
        axis = int(np.argmax(sizes / lengths))
        problem = f"holds {lengths[axis]:g} m along {'xyz'[axis]}, and what is transformed is {sizes[axis]:g} m long"
        raise InputError(
            "lengths", problem, "it must fit into one period, wherever it lies", "pass a longer period", value=lengths
        )


Table = Callable[[Floats], tuple[Floats, float]]

UNIT: Final = 2.0**-52  # relative rounding error of one operation, doubled
TOP: Final = 32.0  # highest frequency that is considered, in cycles per radius of the smallest ball
ROOM: Final = 1.0 + 2.0**-30  # for the rounding of the bounds themselves
ENERGY_SAMPLES: Final = 4096  # of a bump's energy, from which the band is chosen
NODES: Final = 64  # distances in a table of pairs of two radii
ALONE: Final = 1e-13  # relative error of the integral of a bump's own square
BATCH: Final = 2**8  # balls whose neighbours are held together


def highest_frequency(a: BallDescriptor, b: BallDescriptor, bound: float) -> float:
    """An estimate of the frequency (cycles per metre) above which the overlap of two ball sets is below ``bound``.

    Above the frequencies of the gaps between them, balls add their energies. So the energy of a set above a frequency
    is the sum of those of its bumps. At most :data:`TOP` per radius of the smallest ball.
    """
    k = np.linspace(0.0, TOP, ENERGY_SAMPLES)
    energy = a.bump.table(a.dim, TOP, 1e-9)(k) ** 2 * around(k, a.dim)
    above = np.cumsum(energy[::-1])[::-1] * k[1]
    every = np.concatenate([a.radii, b.radii])
    frequencies = np.geomspace(0.1 / every.max(), TOP / every.min(), 400)
    tails = []
    for balls in (a, b):
        radii, counts = np.unique(balls.radii, return_counts=True)
        tails.append(
            sum(n * r**a.dim * np.interp(r * frequencies, k, above) for r, n in zip(radii, counts, strict=True))
        )
    enough = np.sqrt(tails[0]) * np.sqrt(tails[1]) <= bound
    return float(frequencies[np.argmax(enough)] if enough.any() else frequencies[-1])


class Rings(NamedTuple):
    """Half of the frequencies ``k / lengths`` with ``|k| <= halves``, ordered by rings of their modulus.

    Descriptors are real, so that opposite frequencies have conjugate terms, and one of the two is enough: the one whose
    first entry that is not zero is above zero; and zero itself.

    Attributes
    ----------
    lengths, halves
        The period along each axis, metres, and the highest frequency there, in cycles per period.
    indices, moduli, twice : ndarray of int16, shape (n, d), and of float64, shape (n,)
        k, ``|w|`` in cycles per metre, and how often each counts: twice, but for zero. In the order of the rings.
    starts : ndarray of int64, shape (rings + 1,)
        Where each ring begins; the first is frequency zero alone.
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
        """The rings of a period, each as wide as one cycle in its longest side."""
        axes = [np.arange(-half, half + 1, dtype=np.int16) for half in halves]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(halves))
        half = box[len(box) // 2 :]
        moduli = np.linalg.norm(half / lengths, axis=1)
        ring = np.ceil(moduli * lengths.max() - 1e-9).astype(np.int64)
        order = np.argsort(ring.astype(np.min_scalar_type(ring.max())), kind="stable")  # the quicker, the shorter
        counts = np.bincount(ring)
        starts = np.concatenate([[0], np.cumsum(counts[counts > 0])])
        indices = np.ascontiguousarray(half[order])
        reaches = np.maximum.accumulate(np.maximum.reduceat(np.abs(indices), starts[:-1], axis=0), axis=0)
        twice = np.where(np.arange(len(order)) > 0, 2.0, 1.0)
        return cls(lengths, halves, indices, moduli[order], twice, starts, reaches.astype(np.int64))

    @property
    def counts(self) -> tuple[int, ...]:
        """Frequencies along each axis, both halves: odd numbers."""
        return tuple(2 * half + 1 for half in self.halves)

    @property
    def volume(self) -> float:
        """Of a period, metres to the power ``dim``."""
        return float(np.prod(self.lengths))

    def sums(self, values: Floats) -> Floats:
        """Sum over each ring of values in the order of the rings, shape (rings,)."""
        return np.asarray(np.add.reduceat(values, self.starts[:-1]))

    def half_of(self, box: Complexes) -> Complexes:
        """A spectrum over all frequencies, in numpy.fft's order, brought into the order of the rings."""
        return box.reshape(-1)[self._places(1)]

    def box_of(self, half: Complexes) -> Complexes:
        """The spectrum over all frequencies, in numpy.fft's order, of a real function, from the half of it."""
        flat = np.empty(math.prod(self.counts), dtype=np.complex128)
        flat[self._places(-1)], flat[self._places(1)] = half.conj(), half
        return flat.reshape(self.counts)

    def _places(self, sign: int) -> Ints:
        """Where each frequency, or its opposite, is in a flattened box."""
        columns = sign * self.indices.T.astype(np.int64)
        return np.asarray(np.ravel_multi_index(tuple(columns), self.counts, mode="wrap"))


class Spectrum(NamedTuple):
    """A descriptor's spectrum within a band, and a bound of its tail outside.

    ``values``, shape (n,), in the order of the rings, metres to the power ``dim``, are ``F(w)`` with the origin in the
    balls' middle, and ``error`` is by how much each may be off. ``tail`` bounds the energy of all frequencies outside
    the band: the integral of the descriptor's square less what the band holds (Parseval).
    """

    values: Complexes
    error: float
    tail: float

    @classmethod
    def of(
        cls, balls: BallDescriptor, middle: Floats, rings: Rings, accuracy: float, norm: tuple[float, float]
    ) -> Spectrum:
        """That of a ball set about a point, by a transform of an accuracy, with the ``norm`` of :func:`norm_square`."""
        box = ball_spectrum(balls.centers - middle, balls.radii, balls.bump, rings.lengths, rings.counts, accuracy)
        values = rings.half_of(box)
        moved = ROUNDING * (balls.span + float(np.abs(middle).max()))
        error = balls.integral * (2.0 * accuracy + 2.0 * math.pi * float(rings.moduli.max()) * moved)
        moduli = np.abs(values)
        inside = float((rings.twice * moduli * (moduli - 2.0 * error)).sum()) / rings.volume
        total, off = norm
        return cls(values, error, max(0.0, total - inside) + off + 2.0**-44 * total)


class Terms(NamedTuple):
    """What each frequency adds to the overlap, and bounds of what is left out; compiled functions take it as it is.

    Attributes
    ----------
    products : ndarray of complex128, shape (n,)
        ``F_B conj(F_A) / V``, in the order of the rings; doubled, but for frequency zero, for the opposite frequency.
    bounds : ndarray of float64, shape (rings + 1,)
        By how much the sum of the rings before r can differ from that of all frequencies, whatever the placement: what
        those from r on can add, and what rounding and errors of the spectra change.
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
    def of(cls, first: Spectrum, second: Spectrum, rings: Rings, far: float) -> Terms:
        """The terms of the overlap of ``first`` (A), which is moved, with ``second`` (B).

        What is left within the band is bounded by the sum of the moduli of its terms; outside it, by the product of the
        two norms there (Cauchy and Schwarz). By ``far``, in metres, a placement may be off.
        """
        weights = rings.twice / rings.volume
        products = weights * second.values * first.values.conj()
        a, b = np.abs(first.values), np.abs(second.values)
        moduli = np.abs(products)
        errors = weights * (a * second.error + b * first.error + first.error * second.error)
        per_ring, errors_per_ring = rings.sums(moduli), rings.sums(errors)
        tail = math.sqrt(first.tail) * math.sqrt(second.tail)
        after = np.cumsum((per_ring + errors_per_ring)[::-1])[::-1]
        # A phase k t / L of an axis is off by some units times k; sums, by one for each term of a ring and each ring.
        counts = np.diff(rings.starts)
        units = 64.0 + counts + len(counts) + 8.0 * rings.reaches.sum(axis=1)
        moved = 2.0 * math.pi * far * rings.sums(rings.moduli * (moduli + errors))
        before = np.cumsum(errors_per_ring + UNIT * units * per_ring + moved)
        bounds = ROOM * (np.append(after, 0.0) + tail + np.append(0.0, before))
        return cls(products, bounds, rings.indices, rings.starts, rings.reaches, rings.lengths)


# ---- compiled sums, ring by ring -------------------------------------------------------------------------------------


@kernel
def add_phases(share: float, first: int, last: int, phases: Complexes) -> None:
    """Set ``phases[middle + k]`` to exp(2 pi i k share) for ``first <= |k| <= last``.

    ``share`` is the placement along an axis in periods. Each factor is computed by itself, so that errors do not add
    up.
    """
    middle = len(phases) // 2
    for k in range(first, last + 1):
        turns = k * share
        angle = 2.0 * math.pi * (turns - round(turns))
        value = complex(math.cos(angle), math.sin(angle))
        phases[middle + k] = value
        phases[middle - k] = value.conjugate()


@kernel
def add_terms(terms: Terms, phases: Complexes, start: int, stop: int) -> float:
    """Sum of the real parts of ``products * exp(2 pi i k.t)`` over a stretch of frequencies."""
    products, indices = terms.products, terms.indices
    middle = phases.shape[1] // 2
    total = 0.0
    for n in range(start, stop):
        turn = phases[0, middle + indices[n, 0]] * phases[1, middle + indices[n, 1]]
        if len(phases) == 3:
            turn *= phases[2, middle + indices[n, 2]]
        total += products[n].real * turn.real - products[n].imag * turn.imag
    return total


@kernel
def separate(place: Floats, terms: Terms, threshold: float, phases: Complexes) -> tuple[int, int, float, float]:
    """Sum ring after ring until the sum decides: the verdict, the number of frequencies, the sum and its bound.

    It never does where the threshold is NaN.

    ``place`` is relative to the middles, in metres; ``phases``, of shape (d, 2 m + 1) with the highest frequency m of
    an axis, is room for them.
    """
    starts, reaches = terms.starts, terms.reaches
    total = 0.0
    for ring in range(len(starts) - 1):
        for axis in range(len(place)):
            first = reaches[ring - 1, axis] + 1 if ring > 0 else 0
            add_phases(place[axis] / terms.lengths[axis], first, reaches[ring, axis], phases[axis])
        total += add_terms(terms, phases, starts[ring], starts[ring + 1])
        bound = terms.bounds[ring + 1]
        if total + bound < threshold:
            return 0, starts[ring + 1], total, bound
        if total - bound > threshold:
            return 1, starts[ring + 1], total, bound
    return 2, starts[-1], total, terms.bounds[-1]


def separate_all(places: Floats, near: Bools, terms: Terms, threshold: float) -> tuple[Bytes, Ints, Floats]:
    """:func:`separate` at ``near`` placements, of places of shape (n, d); at the others nothing overlaps.

    Gives verdicts (n,), numbers of frequencies (n,), and sums with their bounds (n, 2).
    """
    out = (
        np.zeros(len(places), np.uint8),
        np.zeros(len(places), np.int64),
        np.tile([0.0, terms.bounds[0]], (len(places), 1)),
    )
    phases = np.empty((places.shape[1], 2 * int(terms.reaches[-1].max()) + 1), np.complex128)
    separate_each(places, np.flatnonzero(near), terms, threshold, phases, out)
    return out


@kernel
def separate_each(
    places: Floats, numbers: Ints, terms: Terms, threshold: float, phases: Complexes, out: tuple[Bytes, Ints, Floats]
) -> None:
    """The same of placements by their numbers, with room as in :func:`separate`."""
    verdicts, counts, sums = out
    for n in numbers:
        verdicts[n], counts[n], sums[n, 0], sums[n, 1] = separate(places[n], terms, threshold, phases)


def norm_square(balls: BallDescriptor) -> tuple[float, float]:
    """Integral of the square of a descriptor, the sum of what all pairs of its balls have in common; and its error."""
    bump = balls.bump
    radii, which = np.unique(balls.radii, return_inverse=True)
    tables: dict[int, Table] = {}
    # Each with itself, and twice all others.
    own = radial_transform(lambda s: bump.values(s) ** 2, np.zeros(1), balls.dim)
    value = float(own[0] * (balls.radii**balls.dim).sum())
    error = SAFETY * ALONE * value
    for i, j in _meeting(balls):
        gaps = np.linalg.norm(balls.centers[i] - balls.centers[j], axis=1)
        keys, group, counts = np.unique(which[i] * len(radii) + which[j], return_inverse=True, return_counts=True)
        many = (counts > NODES) & (not bump.is_indicator)  # whose integrals are no smooth function of the distance
        for number in np.flatnonzero(many):
            key = int(keys[number])
            if key not in tables:
                one, other = divmod(key, len(radii))
                tables[key] = _tabled(bump, float(radii[one]), float(radii[other]), balls.dim)
            values, off = tables[key](gaps[group == number])
            value, error = value + 2.0 * float(values.sum()), error + 2.0 * len(values) * off
        few = ~many[group]
        if few.any():
            values, offs = pair_integrals(bump, balls.radii[i[few]], balls.radii[j[few]], gaps[few], balls.dim)
            value, error = value + 2.0 * float(values.sum()), error + 2.0 * float(offs.sum())
    return value, error + 2.0**-52 * (len(balls.radii) + 2) * value


def _meeting(balls: BallDescriptor) -> Iterator[tuple[Ints, Ints]]:
    """Each pair of balls that meet, the larger of the two first, in batches."""
    from scipy.spatial import cKDTree

    centers, radii = balls.centers, balls.radii
    tree, place = cKDTree(centers), np.empty(len(radii), dtype=np.int64)
    place[np.argsort(radii, kind="stable")] = np.arange(len(radii))
    for part in np.array_split(np.arange(len(radii)), math.ceil(len(radii) / BATCH)):
        # No ball that is smaller, and meets one, is farther away than this one is wide.
        near = tree.query_ball_point(centers[part], 2.0 * radii[part] * (1.0 + 2.0**-40))
        i = np.repeat(part, [len(each) for each in near])
        j = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        square = ((centers[i] - centers[j]) ** 2).sum(axis=1)
        meeting = (place[j] < place[i]) & (square <= (radii[i] + radii[j]) ** 2)
        yield i[meeting], j[meeting]


def _tabled(bump: Bump, first: float, second: float, dim: int) -> Table:
    """A function from distances to the integrals for two radii, and by how much each may be off."""
    reach = first + second
    nodes = chebyshev_nodes(NODES)
    between = np.cos(math.pi * np.arange(NODES + 1) / NODES)
    gaps = 0.5 * reach * (1.0 + np.concatenate([nodes, between]))
    values, errors = pair_integrals(bump, np.full_like(gaps, first), np.full_like(gaps, second), gaps, dim)
    fit = np.polynomial.Chebyshev(chebyshev_coefficients(values[:NODES]))
    off = float(errors.max()) + SAFETY * float(np.abs(fit(between) - values[NODES:]).max())
    return lambda distances: (np.asarray(fit(np.minimum(2.0 * distances / reach, 2.0) - 1.0)), off)


def touching_overlap(first: BallDescriptor, second: BallDescriptor, swell: float, slack: float) -> float:
    """A lower bound of what two balls have in common, after each has grown by ``swell``, if before they touched.

    A bump is a mixture of indicators of balls about its center, and what two balls have in common falls with the
    distance of their centers; so does, then, the integral of the product of two bumps. So it is least, for two radii,
    where the balls only just touch; and all pairs of radii are looked at. By ``slack``, in metres, balls that touch may
    be apart, from rounding.
    """
    bump = first.bump
    a, b = (part.ravel() for part in np.meshgrid(np.unique(first.radii), np.unique(second.radii)))
    gaps = a + b + slack
    values, errors = pair_integrals(bump, a + swell, b + swell, gaps, first.dim)
    least = math.inf
    # Each by itself, to more digits, but only those pairs that may be the least.
    for n in np.argsort(values - errors):
        if values[n] - errors[n] > least:
            break
        exact = bump.pair_integral(a[n] + swell, b[n] + swell, gaps[n], first.dim)
        floor = FLOOR * (min(a[n], b[n]) + swell) ** first.dim
        least = min(least, exact * (1.0 - SAFETY * PAIR_TOLERANCE) - floor)
    return max(0.0, least)

"""What proofs of overlaps stand on: sums of terms, ring by ring from the lowest frequency, bounds of all that is left,
and what pairs of balls have in common, of which norms and thresholds are made."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Bytes, Floats, Ints
from cspace.compiling import kernel
from cspace.spectral.bump import (
    FLOOR,
    PAIR_TOLERANCE,
    SAFETY,
    Bump,
    around,
    chebyshev_coefficients,
    chebyshev_nodes,
    pair_integrals,
    radial_transform,
)
from cspace.spectral.descriptors import ROUNDING, BallDescriptor
from cspace.spectral.spectra import ball_spectrum

Complexes = NDArray[np.complex128]
Table = Callable[[Floats], tuple[Floats, float]]

UNIT: Final = 2.0**-52  # relative rounding error of one operation, doubled
TOP: Final = 32.0  # highest frequency that is considered, in cycles per radius of the smallest ball
ROOM: Final = 1.0 + 2.0**-30  # for the rounding of the bounds themselves
SAMPLES: Final = 4096  # of a bump's energy, from which the band is chosen
NODES: Final = 64  # distances in a table of pairs of two radii
ALONE: Final = 1e-13  # relative error of the integral of a bump's own square
BATCH: Final = 2**8  # balls whose neighbours are held together


def highest_frequency(a: BallDescriptor, b: BallDescriptor, bound: float) -> float:
    """An estimate of the frequency (cycles per metre) above which the overlap of two ball sets is below ``bound``.

    Above the frequencies of the gaps between them, balls add their energies. So the energy of a set above a frequency
    is the sum of those of its bumps. At most :data:`TOP` per radius of the smallest ball.
    """
    k = np.linspace(0.0, TOP, SAMPLES)
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

"""Overlap of two ball sets at any placement of the first one, and overlap fields on maps."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._support.arrays import Bytes, Floats, Ints
from cspace._support.check import (
    check_count,
    check_finite,
    check_not_negative,
    check_points,
    check_positive,
)
from cspace.errors import InputError
from cspace.spectral._bands import Rings, Spectrum, Terms, estimate_band, separate_all
from cspace.spectral._bump import Bump, pair_integrals
from cspace.spectral._descriptors import (
    PLACEMENT_ROUNDING,
    BallDescriptor,
    BallsLike,
    as_balls,
    check_same_dim,
    common_bump,
)
from cspace.spectral._pairs import norm_square, sum_pairs
from cspace.spectral._spectra import (
    MAX_FREQUENCIES,
    evaluate_real_series,
)
from cspace.spectral._trees import HIT, MISS, UNDECIDED, ContactTest, build_tree, rotate_tree

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


MAX_WAVE_INDEX: Final = 2**15 - 1
"""Highest frequency along an axis, cycles per period, that int16 holds."""

MAX_SUMMED_PAIRS: Final = 2**22
"""Number of placements times pairs of balls up to which a verdict sums over pairs instead of
another band."""

PERIOD_MARGIN: Final = 1e-6
"""Relative margin of the period, so that rounding cannot make any ball wrap around."""

MAX_PLACEMENTS_PER_TRANSFORM: Final = 2**20
"""Number of placements evaluated by one transform, to bound the memory."""

NO_TREE: Final = np.empty((0, 5))
"""Tree of no balls."""

MAX_PLACEMENTS_ONE_BY_ONE: Final = 32
"""Number of placements up to which values are summed ring by ring, without a transform."""


class Verdict(IntEnum):
    """Whether two ball sets are apart; ``bool(verdict)`` raises."""

    MISS = 0
    HIT = 1
    UNDECIDED = 2

    def __bool__(self) -> bool:
        """Raise InputError, because UNDECIDED is neither true nor false."""
        raise InputError(
            "verdict",
            f"is {self.name}",
            "a verdict is neither true nor false",
            "compare it, e.g. verdict == Verdict.MISS",
        )


@dataclass(frozen=True, slots=True)
class Separation:
    """Verdict about placements, and its cost.

    It is about one placement or a batch.

    Attributes
    ----------
    verdict : Verdict, or ndarray of uint8
    frequencies : int, or ndarray of int64
        Number of frequencies summed, opposite ones counted once; 0 if the balls alone decided.
    overlap, bound : float, or ndarray of float64
        The partial sum, square or cubic metres, and its largest difference to the ideal overlap of
        all frequencies, rounding included. Both are 0 if the balls are apart. The bound is infinite
        if no frequency was summed.
    """

    verdict: Verdict | Bytes
    frequencies: int | Ints
    overlap: float | Floats
    bound: float | Floats


class FourierOverlap:
    """Overlap of a moving ball set A with B.

    With the descriptors ``f(x) = sum over balls of psi((x - center) / radius)`` and A moved by t,
    the overlap is

        c(t) = integral f_B(x) f_A(x - t) dx = 1/V sum_w F_B(w) conj(F_A(w)) exp(2 pi i w.t),

    in square or cubic metres. V is the volume of a period so long that nothing wraps around
    (Lysenko, 2013). c(t) is positive exactly if an open ball of the moved A meets one of B, and
    grows with the depth of the collision. Every t is valid: outside :attr:`domain`, A is far from B
    and c is exactly zero.

    Parameters
    ----------
    a, b : object with ``centers`` and ``radii``, or (centers, radii)
        Balls of A, in its own frame, and of B; both in the plane or in space; metres. For example a
        result of :func:`cspace.spectral.decompose`, or a :class:`cspace.Robot` of balls.
    bump : Bump, optional
        Bump of both sets. The default is the bump of a or b, if they are descriptors, else
        ``Bump(2.0)``. Smooth bumps need few frequencies; flat ones (alpha above about 8, or
        infinite) up to a hundred times as many.
    threshold : float
        Overlap that :meth:`separated` decides about, zero or above; square or cubic metres.
    band : float, optional
        Highest frequency along each axis, cycles per metre. By default :attr:`bound` becomes about
        ``tolerance`` times the threshold. If the threshold is zero, it becomes about ``tolerance``
        times the overlap of two balls of median radius, the center of one on the boundary of the
        other. At most about two million frequencies are used.
    tolerance : float

    Spectra are computed at first use; verdicts about ball sets that are apart need none. Raises
    InputError if a value is not as stated. Methods raise MissingPackageError if finufft is needed
    and not installed.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import FourierOverlap, decompose
    >>> a, b = (decompose(shapely.box(0, 0, 2, 1), kind="outer", number=8) for _ in range(2))
    >>> FourierOverlap.of_shapes(a, b, swell=0.2).separated((5.0, 0.0)).verdict.name
    'MISS'
    """

    def __init__(
        self,
        a: BallsLike,
        b: BallsLike,
        *,
        bump: Bump | None = None,
        threshold: float = 0.0,
        band: float | None = None,
        tolerance: float = 1e-3,
    ) -> None:
        """Check both ball sets, and choose the period and the band of their spectra."""
        shared_bump = common_bump(bump, a, b)
        first = as_balls(a, "a", shared_bump)
        second = as_balls(b, "b", shared_bump)
        check_same_dim("b", second.dim, first.dim)
        self.threshold = check_not_negative(threshold, "threshold", "pass square or cubic metres")
        # A period is as long as both sets side by side, with A at any rotation.
        reaches = np.linalg.norm(first.centers - first.center, axis=1) + first.radii
        reach = float(reaches.max()) * (1.0 + 2.0**-40)
        extents = np.abs(second.centers - second.center) + second.radii[:, None]
        half_sides = (extents.max(axis=0) + reach) * (1.0 + 0.1 * PERIOD_MARGIN)
        lengths = 2.0 * (1.0 + PERIOD_MARGIN) * half_sides
        farthest = max(first.span, second.span)
        shortest = float(lengths.min())
        if farthest > min(1e40, 1e6 * shortest):  # above 1e40, squares of volumes overflow
            problem = f"or a reaches {farthest:g} m from the origin of its frame, but both span "
            problem += f"only {shortest:g} m"
            raise InputError(
                "b",
                problem,
                "rounding would matter",
                "move the origin nearer, or check the units",
            )
        if lengths.max() < 1e-100:
            raise InputError(
                "b",
                f"and a span only {lengths.max():g} m",
                "squares would underflow",
                "check the units",
            )
        halves = _choose_halves(first, second, lengths, self.threshold, band, tolerance)
        trees = _build_trees(first, second, first.center, second.center)
        span = math.sqrt(first.dim) * (first.span + second.span)
        bands = _make_bands(first, second, lengths, halves)
        self.pair = BallPair(bands, half_sides, span, trees, trees, np.eye(first.dim))

    @classmethod
    def of_shapes(
        cls,
        outer_a: BallsLike,
        outer_b: BallsLike,
        inner_a: BallsLike | None = None,
        inner_b: BallsLike | None = None,
        *,
        swell: float = 0.0,
        classes: int = 8,
        bump: Bump | None = None,
        tolerance: float = 1e-3,
    ) -> FourierOverlap:
        """Build an overlap whose verdicts are proofs about shapes.

        The shapes are given by balls. *MISS* proves that the closed shapes have no common point: no
        two outer balls touch. *HIT* proves that they have one: an inner ball of A and one of B
        overlap. Other placements are *UNDECIDED*. Verdicts come from trees of the balls, without
        any frequency. ``docs/explanation/certificate_frequency.md`` has the proofs.

        Values and gradients belong to the outer balls, grown by ``swell``.

        Parameters
        ----------
        outer_a, outer_b : object with ``centers`` and ``radii``, or (centers, radii)
            Balls whose union covers A, and B; metres.
        inner_a, inner_b : the same, optional
            Balls that lie in A, and B; without them there is no HIT.
        swell : float
            Metres, zero or above. Values are positive before the shapes touch, and need fewer
            frequencies.
        classes : int
            Largest number of different radii of each set in values and gradients, because each
            radius takes a transform; radii grow to the next of these. Verdicts use the radii as
            passed.
        bump, tolerance
            As for the class.

        Raises as the class does. Also raises InputError if only one inner set is given.
        """
        given = {"outer_a": outer_a, "outer_b": outer_b, "inner_a": inner_a, "inner_b": inner_b}
        # Decompositions know whether they are outer or inner.
        for name, source in given.items():
            needed_kind, _, _ = name.partition("_")
            kind = getattr(source, "kind", needed_kind)
            if kind in ("inner", "outer") and kind != needed_kind:
                raise InputError(
                    name,
                    f"is of kind {kind!r}",
                    f"it must be {needed_kind!r}",
                    "decompose the shape with that kind",
                )
        shared_bump = common_bump(bump, *given.values())
        growth = check_not_negative(swell, "swell", "pass metres")
        number = check_count(classes, "classes", 1, hint="pass e.g. 8")
        if (inner_a is None) is not (inner_b is None):
            raise InputError(
                "inner_a", "or inner_b is missing", "a HIT needs both", "pass both or neither"
            )
        sets = {
            name: as_balls(source, name, shared_bump)
            for name, source in given.items()
            if source is not None
        }
        a, b, *inner_sets = sets.values()
        for name, balls in sets.items():
            check_same_dim(name, balls.dim, a.dim)
        # Values come from grown balls, verdicts from the trees of the balls as passed.
        rounded = a.round_radii(number), b.round_radii(number)
        grown = (
            BallDescriptor(balls.centers, balls.radii + growth, shared_bump) for balls in rounded
        )
        overlap = cls(*grown, tolerance=tolerance)
        inner = NO_TREE, NO_TREE
        if inner_sets:
            inner_balls_a, inner_balls_b = inner_sets
            inner = _build_trees(inner_balls_a, inner_balls_b, a.center, b.center)
        span = math.sqrt(a.dim) * sum(balls.span for balls in sets.values())
        overlap.pair = replace(
            overlap.pair,
            span=overlap.pair.span + span,
            outer=_build_trees(a, b, a.center, b.center),
            inner=inner,
        )
        return overlap

    def __repr__(self) -> str:
        """Return the numbers of balls and of frequencies, and the threshold."""
        sizes = f"{len(self.pair.a.radii):,} and {len(self.pair.b.radii):,} balls"
        place = "in the plane" if self.dim == 2 else "in space"
        threshold = f", threshold {self.threshold:g}" if self.threshold else ""
        return f"FourierOverlap({sizes} {place}, {self.frequencies:,} frequencies{threshold})"

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.pair.b.dim

    @property
    def lengths(self) -> tuple[float, ...]:
        """Period along each axis, metres."""
        return tuple(self.pair.bands[-1].lengths.tolist())

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of frequencies ``k / length`` along each axis, odd."""
        return tuple(2 * half + 1 for half in self.pair.bands[-1].halves)

    @property
    def frequencies(self) -> int:
        """Number of frequencies in the band; opposite ones count once."""
        return (math.prod(self.counts) + 1) // 2

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the placements with any overlap."""
        return self.pair.domain

    @property
    def bound(self) -> float:
        """Largest difference of :meth:`value` from the ideal overlap."""
        return float(self.pair.levels[-1].terms.bounds[-1])

    def value(self, t: ArrayLike) -> Floats:
        """Compute the band-limited overlap with A moved by t.

        ``t``, shape (..., d), is in metres; the result, shape (...), in square or cubic metres. It
        is 0 outside the domain. More than a few dozen placements share one non-uniform transform,
        with a tolerance of 1e-9 times the 2-norm of the terms. Raises as the class does.
        """
        sums = self._sums(t, [self.pair.levels[-1].sums])
        return np.asarray(sums[..., 0])[()]

    def gradient(self, t: ArrayLike) -> Floats:
        """Compute the derivatives of :meth:`value`, shape (..., d)."""
        return self._sums(t, self.pair.levels[-1].slopes)

    def value_and_gradient(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """Compute :meth:`value` and :meth:`gradient` together, which is faster."""
        level = self.pair.levels[-1]
        sums = self._sums(t, [level.sums, *level.slopes])
        return sums[..., 0], sums[..., 1:]

    def rotation_gradient(self, t: ArrayLike) -> Floats:
        """Compute the derivative of :meth:`value` with respect to rotations of A.

        A rotates about the origin of its frame. In the plane, the derivative with respect to the
        angle, shape (...); in space, the vector whose product with a unit axis is the derivative
        with respect to the angle about it, shape (..., 3). Square or cubic metres per radian:
        :meth:`gradient` corresponds to a force, this to a torque.
        """
        sums = self._sums(t, self.pair.levels[-1].twists)
        return sums if self.dim == 3 else sums[..., 0]

    def rotated(self, rotation: ArrayLike | Rotation) -> FourierOverlap:
        """Return the overlap with A rotated.

        A rotates about the origin of its frame. ``rotation`` is an angle in the plane, radians, a
        matrix of shape (d, d), or a scipy Rotation; raises InputError for anything else. The
        period, the band and the threshold stay; the spectrum of A is recomputed at first use.
        """
        matrix = rotation_matrix(rotation, self.dim)
        # Rotate the original balls, so that rounding does not accumulate over repeated rotations.
        whole_rotation = rotation_matrix(matrix @ self.pair.rotation, self.dim)
        rotated = copy.copy(self)
        rotated.pair = replace(self.pair, rotation=whole_rotation)
        return rotated

    def separated(self, t: ArrayLike) -> Separation:
        """Decide whether A and B are apart, or overlap by less than a :attr:`threshold`.

        The threshold matters if it is above zero. First, trees
        of balls tell whether two balls touch. If none do, it is a *MISS*: the overlap is zero. If
        two overlap and the threshold is zero, it is a *HIT*. For a threshold above zero,
        frequencies are summed ring by ring, from low to high, until the sum and a bound of the
        remainder decide: *MISS* proves that the ideal overlap of all frequencies is below the
        threshold, *HIT* that it is above. If few placements remain after a small band, their pairs
        of balls are summed instead. Otherwise, it is *UNDECIDED*. For an overlap made by
        :meth:`of_shapes`, the verdict is about the shapes, and takes no frequency.

        ``t``, shape (..., d), is in metres.
        """
        placements = check_points(t, "t", self.dim)
        relative = self.pair.relative(placements)
        verdicts = self.pair.contacts.test(_in_space(relative))
        touching = np.flatnonzero(verdicts != MISS)
        counts = np.zeros(len(relative), dtype=np.int64)
        # Without a sum, nothing is known of the overlap of sets that touch.
        sums_and_bounds = np.zeros((len(relative), 2))
        sums_and_bounds[touching, 1] = math.inf
        if self.threshold > 0.0 and len(touching):
            answers = self._compare_with_threshold(relative[touching])
            verdicts[touching], counts[touching], sums_and_bounds[touching] = answers
        totals, bounds = sums_and_bounds.T
        if placements.ndim == 1:
            verdict = Verdict(int(verdicts[0]))
            return Separation(verdict, int(counts[0]), float(totals[0]), float(bounds[0]))
        shape = placements.shape[:-1]
        return Separation(
            verdicts.reshape(shape),
            counts.reshape(shape),
            totals.reshape(shape),
            bounds.reshape(shape),
        )

    def _compare_with_threshold(self, relative: Floats) -> tuple[Bytes, Ints, Floats]:
        """Sum frequencies at placements (n, d) until the sums decide.

        Returns verdicts (n,), numbers of frequencies (n,), and sums with their bounds (n, 2).
        """
        verdicts = np.full(len(relative), UNDECIDED, dtype=np.uint8)
        counts = np.zeros(len(relative), dtype=np.int64)
        sums = np.zeros((len(relative), 2))
        pairs_per_placement = len(self.pair.b.radii) * len(self.pair.a.radii)
        undecided = np.arange(len(relative))
        for level in self.pair.levels:
            verdicts[undecided], summed, sums[undecided] = separate_all(
                relative[undecided], level.terms, self.threshold
            )
            counts[undecided] += summed
            undecided = undecided[verdicts[undecided] == UNDECIDED]
            if len(undecided) * pairs_per_placement <= MAX_SUMMED_PAIRS:
                break
        # For few placements, sums over pairs of balls are faster than spectra in the next band, and
        # decide.
        if 0 < len(undecided) * pairs_per_placement <= MAX_SUMMED_PAIRS:
            sums[undecided] = self.pair.sum_pairs(relative[undecided])
            totals, bounds = sums[undecided].T
            verdicts[undecided[totals + bounds < self.threshold]] = MISS
            verdicts[undecided[totals - bounds > self.threshold]] = HIT
        return verdicts, counts, sums

    def _sums(self, t: ArrayLike, sums: list[Terms]) -> Floats:
        """Sum several lists of terms at placements (..., d); return shape (..., lists)."""
        placements = check_points(t, "t", self.dim)
        relative = self.pair.relative(placements)
        out = np.zeros((len(relative), len(sums)))
        # Outside the domain, sums are zero.
        in_domain = np.flatnonzero((np.abs(relative) <= self.pair.half_sides).all(axis=-1))
        if len(in_domain) <= MAX_PLACEMENTS_ONE_BY_ONE:
            for column, terms in enumerate(sums):
                # No sum is below or above NaN, so all frequencies are summed.
                _, _, totals = separate_all(relative[in_domain], terms, math.nan)
                out[in_domain, column] = totals[:, 0]
        else:
            rings = self.pair.levels[-1].band.rings
            spectra = np.stack([rings.to_box(terms.products / rings.twice) for terms in sums])
            blocks = math.ceil(len(in_domain) / MAX_PLACEMENTS_PER_TRANSFORM)
            for block in np.array_split(in_domain, blocks):
                angles = 2.0 * math.pi * relative[block] / rings.lengths
                out[block] = evaluate_real_series(angles, spectra, 1e-9).T
        return out.reshape(*placements.shape[:-1], len(sums))


@dataclass(eq=False)
class BallPair:
    """Two ball sets A and B, with A rotated about the origin of its frame.

    ``half_sides``, shape (d,), are the largest coordinates of A's center relative to B's center
    with any overlap, and ``span`` is the largest distance of balls from the origins of their
    frames; metres. The trees ``outer`` prove misses, and ``inner`` hits; each pair holds those of A
    before the rotation and of B, relative to the centers.
    """

    bands: list[_Band]
    half_sides: Floats
    span: float
    outer: tuple[Floats, Floats]
    inner: tuple[Floats, Floats]
    rotation: Floats

    @property
    def a(self) -> BallDescriptor:
        """Balls of A before the rotation."""
        return self.bands[-1].a

    @property
    def b(self) -> BallDescriptor:
        """Balls of B."""
        return self.bands[-1].b

    @cached_property
    def pivot(self) -> Floats:
        """Center of A after the rotation, metres."""
        return np.asarray(self.rotation @ self.a.center)

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the placements with any overlap."""
        center = self.b.center - self.pivot
        return center - self.half_sides, center + self.half_sides

    @property
    def error(self) -> float:
        """Largest rounding error of a placement in the domain, metres."""
        return PLACEMENT_ROUNDING * (float(np.abs(self.domain).max()) + self.span)

    @cached_property
    def contacts(self) -> ContactTest:
        """Contact test of A, rotated, and B."""
        outer_a, outer_b = self.outer
        inner_a, inner_b = self.inner
        outer_a = rotate_tree(outer_a, self.rotation)
        inner_a = rotate_tree(inner_a, self.rotation)
        (half_sides,) = _in_space(self.half_sides[None])
        return ContactTest(outer_a, outer_b, inner_a, inner_b, half_sides, 4.0 * self.error)

    @cached_property
    def levels(self) -> list[_Level]:
        """Terms of the overlap in each band, smallest first."""
        centers = self.a.centers @ self.rotation.T
        return [_Level(band, centers, self.pivot, self.error) for band in self.bands]

    def relative(self, placements: Floats) -> Floats:
        """Return placements (..., d) of A's center relative to B's center, shape (n, d)."""
        flat = placements.reshape(-1, self.b.dim)
        return np.asarray((flat + self.pivot) - self.b.center)

    def sum_pairs(self, relative: Floats) -> Floats:
        """Compute ideal overlaps at placements (n, d), and bounds of their errors.

        The result has shape (n, 2).
        """
        rotated = (self.a.centers - self.a.center) @ self.rotation.T
        moved = (rotated + placement for placement in relative)
        weights = np.ones(len(self.b.radii))
        fixed = self.b.centers - self.b.center, self.b.radii, weights
        # A distance is rounded by at most four times the error of a placement.
        overlaps_and_bounds = sum_pairs(self.a.bump, moved, self.a.radii, fixed, 4.0 * self.error)
        return np.stack(overlaps_and_bounds, axis=1)


def _build_trees(
    a: BallDescriptor, b: BallDescriptor, center_a: Floats, center_b: Floats
) -> tuple[Floats, Floats]:
    """Build the trees of two ball sets, each relative to its own center."""
    return build_tree(a.centers - center_a, a.radii), build_tree(b.centers - center_b, b.radii)


def _choose_halves(
    a: BallDescriptor,
    b: BallDescriptor,
    lengths: Floats,
    threshold: float,
    band: float | None,
    tolerance: float,
) -> tuple[int, ...]:
    """Choose the highest frequency along each axis, cycles per period.

    It follows from ``band``, or is chosen by ``tolerance``; see :class:`FourierOverlap`. Raises
    InputError if the band is too large.
    """
    if band is not None:
        highest = check_positive(band, "band", "cycles per metre")
    else:
        # Two balls of median radius, the center of one on the boundary of the other, set the scale.
        radius_a = np.median(a.radii, keepdims=True)
        radius_b = np.median(b.radii, keepdims=True)
        distance = np.maximum(radius_a, radius_b)
        overlaps, _ = pair_integrals(a.bump, radius_a, radius_b, distance, a.dim)
        scale = threshold or float(overlaps[0])
        wanted = estimate_band(a, b, check_positive(tolerance, "tolerance", "parts") * scale)
        # Two million frequencies, opposite ones counted once, fill the box of this half side.
        affordable = 0.5 * (2.0**22 / float(np.prod(lengths))) ** (1.0 / a.dim)
        highest = min(wanted, affordable, MAX_WAVE_INDEX / float(lengths.max()))
    halves = tuple(max(1, math.floor(highest * length)) for length in lengths.tolist())
    counts = [2 * half + 1 for half in halves]
    if math.prod(counts) > MAX_FREQUENCIES or max(halves) > MAX_WAVE_INDEX:
        raise InputError(
            "band",
            f"is {band!r}, which takes {' x '.join(map(str, counts))} frequencies",
            f"at most {MAX_FREQUENCIES} are computed",
            "pass a lower one",
        )
    return halves


@dataclass(eq=False)
class _Band:
    """One band of frequencies for all rotations, with B's spectrum.

    ``lengths``, shape (d,), are the periods, metres.
    """

    a: BallDescriptor
    b: BallDescriptor
    lengths: Floats
    halves: tuple[int, ...]

    @cached_property
    def rings(self) -> Rings:
        """Frequencies of the band, ring by ring."""
        return Rings.of(self.lengths, self.halves)

    @cached_property
    def spectrum_b(self) -> Spectrum:
        """Spectrum of B in the band."""
        return Spectrum.of(self.b, self.b.center, self.rings)

    @cached_property
    def tail_b(self) -> float:
        """Upper bound of the energy of B outside the band."""
        return self.spectrum_b.tail(self.rings, _norm(self.b))


_SMALLEST_BAND: Final = 2_000
"""Product of the halves up to which a band is not divided further."""

_norm = lru_cache(maxsize=64)(norm_square)
"""Integral of a squared descriptor, and its error; bands and rotations share it."""


def _make_bands(
    a: BallDescriptor, b: BallDescriptor, lengths: Floats, halves: tuple[int, ...]
) -> list[_Band]:
    """Make nested frequency bands, the smallest first.

    The last band is the whole one. Each has about an eighth of the frequencies of the next. Small
    bands come first because they decide most queries.
    """
    shrinkage = 8.0 ** (1.0 / len(halves))
    bands = [_Band(a, b, lengths, halves)]
    while math.prod(halves) > _SMALLEST_BAND:
        halves = tuple(math.ceil(half / shrinkage) for half in halves)
        bands.append(_Band(a, b, lengths, halves))
    return bands[::-1]


class _Level:
    """Terms of the overlap in one band at one rotation of A.

    ``centers``, shape (n, d), are the rotated centers of A's balls, ``pivot``, shape (d,), is the
    center of A, and ``error`` is the error of placements, metres.
    """

    def __init__(self, band: _Band, centers: Floats, pivot: Floats, error: float) -> None:
        """Place the balls of A; spectra and terms are computed when first needed."""
        self.band = band
        self._a = BallDescriptor(centers, band.a.radii, band.a.bump)
        self._pivot = pivot
        self._error = error

    @cached_property
    def _spectrum(self) -> Spectrum:
        """Spectrum of A in the band."""
        return Spectrum.of(self._a, self._pivot, self.band.rings)

    @cached_property
    def sums(self) -> Terms:
        """Terms for values, with bounds of the band alone."""
        return self._make_terms(0.0)

    @cached_property
    def terms(self) -> Terms:
        """Terms for verdicts, with bounds of all frequencies."""
        tail_a = self._spectrum.tail(self.band.rings, _norm(self.band.a))
        return self._make_terms(math.sqrt(tail_a) * math.sqrt(self.band.tail_b))

    def _make_terms(self, tail: float) -> Terms:
        """Make the terms of values; ``tail`` bounds the sum of all terms outside the band."""
        band = self.band
        return Terms.of(self._spectrum, band.spectrum_b, band.rings, self._error, tail)

    @cached_property
    def twists(self) -> list[Terms]:
        """Terms of the derivative by rotations about the origin of A.

        A rotation by the vector e moves a ball around p by ``e x p``, so F_A changes by ``-2 pi i
        w.(e x p)`` times the ball's part. The sums of ``p`` times these parts are spectra of
        weighted balls.
        """
        rings = self.band.rings
        a = self._a
        moments = [
            Spectrum.of(a, self._pivot, rings, weights=column).values for column in a.centers.T
        ]
        waves = (rings.indices / rings.lengths).T
        planes = [(0, 1)] if a.dim == 2 else [(1, 2), (2, 0), (0, 1)]  # of the rotations
        scale = rings.twice / rings.volume * self.band.spectrum_b.values
        twists = []
        for i, j in planes:
            change = -2j * math.pi * (moments[i] * waves[j] - moments[j] * waves[i])
            twists.append(self.sums._replace(products=scale * change.conj()))
        return twists

    @cached_property
    def slopes(self) -> list[Terms]:
        """Terms of the derivative along each axis."""
        # A derivative multiplies each wave by 2 pi i times its frequency along the axis.
        waves = 2j * math.pi * self.band.rings.indices / self.band.rings.lengths
        return [self.sums._replace(products=self.sums.products * wave) for wave in waves.T]


def _in_space(points: Floats) -> Floats:
    """Return points (n, d) in space, with z = 0 if they lie in the plane."""
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def as_matrices(rotations: ArrayLike | Rotation) -> ArrayLike:
    """Convert a scipy Rotation to matrices; return anything else unchanged."""
    converted: ArrayLike = rotations.as_matrix() if hasattr(rotations, "as_matrix") else rotations
    return converted


def rotation_matrix(rotation: ArrayLike | Rotation, dim: int) -> Floats:
    """Return the rotation matrix nearest to an angle, matrix or Rotation.

    Raises InputError for anything else.
    """
    values = check_finite(as_matrices(rotation), "rotation")
    if dim == 2 and values.ndim == 0:
        sine = math.sin(float(values))
        cosine = math.cos(float(values))
        return np.array([[cosine, -sine], [sine, cosine]])
    if values.shape == (dim, dim):
        # By a singular value decomposition, whose singular values are 1 for a rotation.
        left, stretch, right = np.linalg.svd(values)
        if np.abs(stretch - 1.0).max() <= 1e-6 and np.linalg.det(values) > 0.0:
            return np.asarray(left @ right)
    form, example = "a Rotation", "Rotation.identity()"
    if dim == 2:
        form, example = "an angle in radians", "1.57"
    raise InputError(
        "rotation",
        f"is {rotation!r}",
        f"it must be {form} or a rotation matrix of shape {dim, dim}",
        f"pass e.g. {example}",
    )

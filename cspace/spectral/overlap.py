"""How much two ball sets have in common, for any placement of one of them, and that overlap as a field on a map."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import FIELD_NAMES, Bytes, Floats, Ints, Numbers
from cspace.check import check_points, finite, not_negative, positive, whole
from cspace.compiling import compilable, kernel
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.limits import check_memory
from cspace.map.batches import Configuration, ConfigurationBatch, answer, in_threaded_chunks
from cspace.map.callbacks import callback
from cspace.map.contents import checked_fields
from cspace.map.points import configuration, is_usable, replaced
from cspace.map.storage import Map
from cspace.rotations import Rotations
from cspace.spectral.bump import Bump, pair_integrals
from cspace.spectral.descriptors import ROUNDING, BallDescriptor, BallsLike, balls_of, bump_of, check_dims
from cspace.spectral.regions import gaps
from cspace.spectral.spectra import (
    Rings,
    Spectrum,
    Terms,
    highest_frequency,
    norm_square,
    real_series,
    separate_all,
    touching_overlap,
)

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MOST: Final = 2**21  # frequencies, opposite ones counted as one, up to which the band is chosen where none is given
LARGEST: Final = 2**26  # frequencies up to which a band may be given
HIGHEST: Final = 2**15 - 1  # cycles per period, along an axis, that a short integer holds

PERIOD_ROOM: Final = 1e-6
"""By how much, relative, the period is longer than it must be, so that rounding cannot make anything wrap around."""

LONGEST: Final = 1e40  # metres, above which squares of volumes overflow
FARTHEST: Final = 1e6  # how many periods the balls may lie from the origin of their frame
ACCURACY: Final = 1e-9  # of the values at many placements, relative to the root of the sum of the squares of the terms
FEW: Final = 32  # placements up to which sums are quicker than a transform of the whole band
NEAR: Final = 1e-6  # how far a matrix may be from a rotation; the nearest one is taken


class Verdict(IntEnum):
    """Whether two ball sets are apart; the method that returns it states what it proves."""

    MISS = 0
    HIT = 1
    UNDECIDED = 2


@dataclass(frozen=True, slots=True)
class Separation:
    """The verdict about one placement, and what it took; or about a batch, all in arrays of its shape.

    Attributes
    ----------
    verdict : Verdict, or ndarray of uint8
    frequencies : int, or ndarray of int64
        How many were summed; 0 where the swollen obstacles alone proved the miss. Opposite ones count as one.
    overlap, bound : float, or ndarray of float64
        The partial sum that was reached, square or cubic metres, of the outer balls, where there are inner ones too;
        and by how much the ideal overlap, with all frequencies, can differ from it, rounding included.
    """

    verdict: Verdict | Bytes
    frequencies: int | Ints
    overlap: float | Floats
    bound: float | Floats


class FourierOverlap:
    """The overlap of a ball set A, placed anywhere, with a ball set B, for many placements.

    With the descriptors ``f(x) = sum over balls of psi((x - center) / radius)`` and A moved by t, the two overlap by

        c(t) = integral f_B(x) f_A(x - t) dx = 1/V sum_w F_B(w) conj(F_A(w)) exp(2 pi i w.t),

    in square or cubic metres, with V the volume of a period so long that nothing wraps around (Lysenko, 2013). c is
    above zero exactly where an open ball of the moved A meets one of B, and grows with the depth of the collision.
    *Every* t is answered: outside :attr:`domain` nothing of A comes near B, and c is exactly zero.

    Parameters
    ----------
    a, b : object with ``centers`` and ``radii``, or (centers, radii)
        Balls of A, in its own frame, and of B; both in the plane or in space; metres. Such as what
        :func:`cspace.spectral.decompose` returns, or a :class:`cspace.Robot` of balls.
    bump : Bump, optional
        Of both; if left out, that of a or b, where they are descriptors, or else ``Bump(2.0)``. Smooth ones need few
        frequencies; flat ones (alpha above 8 or so, and infinite) up to a hundred times as many.
    threshold : float
        Overlap that :meth:`separated` decides about, zero or above; square or cubic metres.
    band : float, optional
        Highest frequency along each axis, cycles per metre. If left out, chosen so that :attr:`bound` is about
        ``tolerance`` times the threshold, or, where that is zero, times what a ball of A and one of B have in common,
        both of median radius, when the center of one lies on the border of the other; but at most so high that there
        are about two million frequencies.
    tolerance : float
    accuracy : float
        Of the spectra, relative to their largest values.

    Raises
    ------
    InputError
        If a value is not as stated.
    MissingPackageError
        If finufft is not installed.

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
        accuracy: float = 1e-12,
    ) -> None:
        kind = bump_of(bump, a, b)
        first, second = balls_of(a, "a", kind), balls_of(b, "b", kind)
        check_dims("b", second.dim, first.dim)
        self.threshold = not_negative(threshold, "threshold", "pass square or cubic metres")
        self._accuracy = accuracy
        self._swell = 0.0  # by how much the balls are larger than those that the verdicts are about
        self._inner: FourierOverlap | None = None  # that of the inner balls, where there are any
        self._b, self._unturned, self._turn = second, first, np.eye(first.dim)
        self._pivot, self._middle_b = first.middle, second.middle
        reach = np.linalg.norm(first.centers - self._pivot, axis=1) + first.radii
        self._reach = float(reach.max()) * (1.0 + 2.0**-40)
        sides = (np.abs(second.centers - self._middle_b) + second.radii[:, None]).max(axis=0)
        self._limits = (sides + self._reach) * (1.0 + 0.1 * PERIOD_ROOM)
        lengths = 2.0 * (1.0 + PERIOD_ROOM) * self._limits
        far = max(first.span, second.span)
        if far > min(LONGEST, FARTHEST * float(lengths.min())):
            problem = f"or a reaches {far:g} m from the origin of its frame, and both take up {lengths.min():g} m"
            raise InputError("b", problem, "rounding would count", "move the origin nearer to them, or check the units")
        self._rings = self._make_rings(first, lengths, band, tolerance)
        self._norms = norm_square(first), norm_square(second)
        self._spectrum_b = Spectrum.of(second, self._middle_b, self._rings, accuracy, self._norms[1])
        self._place(first)

    @classmethod
    def of_shapes(
        cls,
        outer_a: BallsLike,
        outer_b: BallsLike,
        inner_a: BallsLike | None = None,
        inner_b: BallsLike | None = None,
        *,
        swell: float,
        classes: int = 8,
        bump: Bump | None = None,
        tolerance: float = 1e-3,
        accuracy: float = 1e-12,
    ) -> FourierOverlap:
        """An overlap whose verdicts are proofs about the shapes that the balls stand for (``docs/frequency.md``).

        *MISS* proves that the closed shapes have no point in common. *HIT* proves that they do: an inner ball of A and
        one of B overlap. Between the two lie placements closer than twice ``swell``, or than the balls resolve.
        Values and gradients are those of the outer balls, grown by ``swell``; the threshold is what any two of these
        have in common at least, if they touched before they grew.

        Parameters
        ----------
        outer_a, outer_b : object with ``centers`` and ``radii``, or (centers, radii)
            Balls whose union covers A, and B; metres.
        inner_a, inner_b : the same, optional
            Balls that lie in A, and B; without them there is no HIT.
        swell : float
            Metres, above zero. Half a radius of the typical ball and more makes early verdicts; less makes fewer
            placements undecided.
        classes : int
            How many different radii there may be in each set, for each takes a transform: outer balls grow and inner
            balls shrink to the next of them.
        bump, tolerance, accuracy
            As for the class.

        Raises as the class does; InputError also if only one of the inner sets is given, or the bump is so flat, or
        ``swell`` so small, that grown balls that touched have too little in common to be computed.
        """
        given = {"outer_a": outer_a, "outer_b": outer_b, "inner_a": inner_a, "inner_b": inner_b}
        for name, source in given.items():
            kind = getattr(source, "kind", name[:5])
            if kind in ("inner", "outer") and kind != name[:5]:
                hint = "decompose the shape with that kind"
                raise InputError(name, f"is of kind {kind!r}", f"it must be {name[:5]!r}", hint, value=source)
        chosen, more = bump_of(bump, *given.values()), positive(swell, "swell")
        number = whole(classes, "classes", 1, hint="pass e.g. 8")
        if (inner_a is None) is not (inner_b is None):
            raise InputError("inner_a", "is given without inner_b, or b without a", "a hit needs both", "pass both")
        sets = [
            balls_of(source, name, chosen).rounded(number, up=name.startswith("outer"))
            for name, source in given.items()
            if source is not None
        ]
        a, b, *inner = sets
        for name, balls in zip(given, sets, strict=False):
            check_dims(name, balls.dim, a.dim)
        level = touching_overlap(a, b, more, ROUNDING * (a.span + b.span))
        if level <= 0.0:
            rule = f"grown balls that touched must share more than can be computed with alpha = {chosen.alpha:g}"
            raise InputError("swell", f"is {more:g}", rule, "pass a larger swell", value=swell)
        grown = (BallDescriptor(balls.centers, balls.radii + more, chosen) for balls in (a, b))
        made = cls(*grown, threshold=level, tolerance=tolerance, accuracy=accuracy)
        made._swell = more
        made._inner = cls(*inner, tolerance=tolerance, accuracy=accuracy) if inner else None
        return made

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self._b.dim

    @property
    def lengths(self) -> tuple[float, ...]:
        """The period along each axis, metres."""
        return tuple(self._rings.lengths.tolist())

    @property
    def counts(self) -> tuple[int, ...]:
        """Frequencies along each axis, odd numbers: ``k / length``, k from ``-(count // 2)`` to ``count // 2``."""
        return self._rings.counts

    @property
    def frequencies(self) -> int:
        """How many frequencies there are up to the band limit, opposite ones counted as one; of inner balls too."""
        return len(self._rings.indices) + (self._inner.frequencies if self._inner else 0)

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner, metres, of the placements t where there can be any overlap; outside, it is zero."""
        middle = self._middle_b - self._pivot
        return middle - self._limits, middle + self._limits

    @property
    def bound(self) -> float:
        """By how much :meth:`value` can differ from the ideal overlap: by the band limit and by rounding."""
        return float(self._terms.bounds[-1])

    @overload
    def value(self, t: Configuration) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def value(self, t: ConfigurationBatch) -> Floats: ...
    @overload
    def value(self, t: ArrayLike) -> float | Floats: ...
    def value(self, t: ArrayLike) -> float | Floats:
        """The overlap up to the band limit with A moved by t, shape (..., d), metres: square or cubic metres, (...).

        It is 0 outside the domain. More than a few dozen placements take one non-uniform transform together, whose
        tolerance is 1e-9 of the root of the sum of the squares of the terms. Raises as the class does.
        """
        sums = self._sums(t, [self._terms])
        return sums[..., 0] if sums.ndim > 1 else float(sums[0])

    def gradient(self, t: ArrayLike) -> Floats:
        """The derivatives of :meth:`value`, shape (..., d): metres, or square metres in space."""
        return self._sums(t, self._slopes)

    def value_and_gradient(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """:meth:`value`, shape (...), and :meth:`gradient`, in less time than one after the other."""
        sums = self._sums(t, [self._terms, *self._slopes])
        return sums[..., 0], sums[..., 1:]

    def rotated(self, rotation: ArrayLike | Rotation) -> FourierOverlap:
        """The same with A turned about the origin of its frame: by an angle in the plane, radians, a matrix of shape
        (d, d) or a scipy Rotation; InputError if it is none of these.

        Only the spectrum of A is made anew, from turned centers; the period, the band and the threshold stay.
        """
        matrix = _rotation_matrix(rotation, self.dim)
        other = copy.copy(self)
        # From the first position, so that rounding does not change the shape, however often it is turned.
        other._turn = _rotation_matrix(matrix @ self._turn, self.dim)
        other._pivot = other._turn @ self._unturned.middle
        first = self._unturned
        other._place(BallDescriptor(first.centers @ other._turn.T, first.radii, first.bump))
        other._inner = self._inner.rotated(matrix) if self._inner else None
        return other

    def separated(self, t: ArrayLike, *, swelling: bool = True) -> Separation:
        """Whether A, moved by t, and B are apart, from as few frequencies as possible.

        First, B's balls are swollen by a ball that holds A: where the middle of that lies in none of them, it is a MISS
        without any frequency. Then the frequencies are summed ring by ring, from low to high, until the sum and a bound
        of all that it leaves out decide: *MISS* proves that the ideal overlap, of all frequencies, lies below
        :attr:`threshold`, or, from swollen balls, that it is zero; *HIT* that it lies above; *UNDECIDED* is what all
        frequencies up to the band limit do not decide. With a threshold of zero a HIT proves that two balls overlap.
        Of one made by :meth:`of_shapes`, MISS and HIT are proofs about the shapes, as stated there.

        ``t`` is in metres, shape (..., d); without ``swelling`` the swollen balls are not looked at.
        """
        places = check_points(t, "t", self.dim)
        verdicts, counts, sums = self._decide(np.ascontiguousarray(places.reshape(-1, self.dim)), swelling)
        if places.ndim == 1:
            return Separation(Verdict(int(verdicts[0])), int(counts[0]), *sums[0].tolist())
        shape = places.shape[:-1]
        totals, bounds = (column.reshape(shape) for column in sums.T)
        return Separation(verdicts.reshape(shape), counts.reshape(shape), totals, bounds)

    def _decide(self, ts: Floats, swelling: bool) -> tuple[Bytes, Ints, Floats]:
        """Verdicts, numbers of frequencies, and sums with their bounds."""
        places, balls = self._relative(ts), self._b
        close = (np.abs(places) <= self._limits).all(axis=1)
        if swelling:
            # Balls that were grown for the threshold are taken as they were: where those are apart, so are the shapes.
            near, _ = gaps(places, 0.0, balls.centers - self._middle_b, balls.radii - self._swell)
            close &= near <= self._reach - self._swell + 4.0 * self._far
        verdicts, counts, sums = separate_all(places, close, self._terms, self.threshold)
        if self._swell:  # what grown balls do not prove a miss, only inner ones prove a hit
            rest = np.flatnonzero(verdicts != Verdict.MISS)
            verdicts[rest] = Verdict.UNDECIDED
            if self._inner is not None and len(rest):
                inner, more, _ = self._inner._decide(ts[rest], swelling=True)
                verdicts[rest[inner == Verdict.HIT]] = Verdict.HIT
                counts[rest] += more
        return verdicts, counts, sums

    def _make_rings(self, a: BallDescriptor, lengths: Floats, band: float | None, tolerance: float) -> Rings:
        if band is not None:
            highest = positive(band, "band", "cycles per metre")
        else:
            typical = np.median(a.radii, keepdims=True), np.median(self._b.radii, keepdims=True)
            scale = self.threshold or float(pair_integrals(a.bump, *typical, np.maximum(*typical), self.dim)[0][0])
            highest = highest_frequency(a, self._b, positive(tolerance, "tolerance", "parts") * scale)
            fitting = 0.5 * (2.0 * MOST / float(np.prod(lengths))) ** (1.0 / self.dim)
            highest = min(highest, fitting, HIGHEST / float(lengths.max()))
        halves = tuple(max(1, math.floor(highest * length)) for length in lengths.tolist())
        if math.prod(2 * half + 1 for half in halves) > LARGEST or max(halves) > HIGHEST:
            problem = f"is {band!r}, which takes {' x '.join(str(2 * half + 1) for half in halves)} frequencies"
            raise InputError("band", problem, f"at most {LARGEST} are computed", "pass a lower one", value=band)
        return Rings.of(lengths, halves)

    def _place(self, a: BallDescriptor) -> None:
        """Take over the balls of A, whose middle and reach are known."""
        self._a = a
        # By so much rounding may move a placement at which there can be any overlap.
        self._far = ROUNDING * (float(np.abs(self.domain).max()) + a.span + self._b.span)
        for made in ("_terms", "_slopes"):
            self.__dict__.pop(made, None)

    @cached_property
    def _terms(self) -> Terms:
        """The terms of the overlap, made when they are asked for."""
        spectrum = Spectrum.of(self._a, self._pivot, self._rings, self._accuracy, self._norms[0])
        return Terms.of(spectrum, self._spectrum_b, self._rings, self._far)

    @cached_property
    def _slopes(self) -> list[Terms]:
        """The terms of the derivative along each axis."""
        waves = 2j * math.pi * self._rings.indices / self._rings.lengths
        return [self._terms._replace(products=self._terms.products * wave) for wave in waves.T]

    def _relative(self, places: Floats) -> Floats:
        """Placements of the middle of A relative to that of B."""
        return np.asarray((places + self._pivot) - self._middle_b)

    def _sums(self, t: ArrayLike, sums: list[Terms]) -> Floats:
        """Several sums of terms at placements, shape (..., sums)."""
        places = check_points(t, "t", self.dim)
        relative = self._relative(places.reshape(-1, self.dim))
        inside = (np.abs(relative) <= self._limits).all(axis=-1)
        out = np.zeros((len(relative), len(sums)))
        if np.count_nonzero(inside) > FEW:
            boxes = np.stack([self._rings.box_of(terms.products / self._rings.twice) for terms in sums])
            out[inside] = real_series(2.0 * math.pi * relative[inside] / self._rings.lengths, boxes, ACCURACY).T
        else:
            for column, terms in zip(out.T, sums, strict=True):
                column[:] = separate_all(relative, inside, terms, math.nan)[2][:, 0]
        return out.reshape(*places.shape[:-1], len(sums))


def _rotation_matrix(rotation: ArrayLike | Rotation, dim: int) -> Floats:
    """The rotation matrix next to an angle in the plane, a matrix or a scipy Rotation, shape (dim, dim)."""
    values = finite(rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation, "rotation")
    if dim == 2 and values.ndim == 0:
        sine, cosine = math.sin(float(values)), math.cos(float(values))
        return np.array([[cosine, -sine], [sine, cosine]])
    if values.shape == (dim, dim):
        left, stretch, right = np.linalg.svd(values)
        if np.abs(stretch - 1.0).max() <= NEAR and np.linalg.det(values) > 0.0:
            return np.asarray(left @ right)
    kinds, example = (("an angle in radians", "1.57"), ("a Rotation", "Rotation.identity()"))[dim - 2]
    rule = f"it must be {kinds} or a matrix of shape {dim, dim} that turns and neither stretches nor mirrors"
    raise InputError("rotation", f"is {rotation!r}", rule, f"pass e.g. {example}", value=rotation)


BATCH: Final = 2**20  # cells whose values are computed together


class Space(Protocol):
    """What a field needs of a map; :class:`cspace.CSpace` has it all."""

    @property
    def grid(self) -> Grid: ...
    @property
    def rotations(self) -> Rotations: ...
    @property
    def record(self) -> Map: ...


@dataclass(frozen=True, eq=False, slots=True)
class OverlapField:
    """The overlap of a robot's descriptor with that of the obstacles at the middles of a map's cells, and its gradient.

    A measure of penetration that is as smooth as the descriptors: above zero where balls meet, and growing with the
    depth. It is no certificate; the states of the map are.

    Attributes
    ----------
    space : CSpace
    arrays : mapping of str to ndarray of float64, shape (nx, ny(, nz)), or (slices, ...) of a robot that turns
        By the names in ``cspace.arrays.FIELD_NAMES``: the overlap, metres to the power of the dimension, and its
        derivatives along the axes, one power less.

    Raises InputError if arrays are missing or superfluous, or one has not the shape and type of the map's, or is not
    finite.
    """

    space: Space
    arrays: Mapping[str, Floats]

    def __post_init__(self) -> None:
        grid = self.space.grid
        object.__setattr__(self, "arrays", checked_fields(self.arrays, grid.dim, _shape(self.space)))

    @classmethod
    def of(cls, space: Space, overlap: FourierOverlap) -> OverlapField:
        """The field of a map.

        Of a robot that turns, the values of a slice are those at the representative of the first rotation cell that it
        serves.

        ``overlap`` is that of the robot's balls, in the robot's frame, with the obstacles', in the map's. Grown balls,
        such as those of :meth:`FourierOverlap.of_shapes`, overlap before the shapes do.

        Raises InputError if it is none, has another dimension than the map, or memory is too small, and
        MissingPackageError if finufft is not installed.
        """
        given: object = overlap
        if not isinstance(given, FourierOverlap):
            rule, hint = "it must be a FourierOverlap", "make it with e.g. FourierOverlap.of_shapes"
            raise InputError("overlap", f"is a {type(given).__name__}", rule, hint, value=given)
        grid, map_ = space.grid, space.record
        check_dims("overlap", overlap.dim, grid.dim)
        shape, count = map_.states.shape, 1 + grid.dim
        check_memory(8.0 * count * math.prod(shape), "the overlap field", grid)
        arrays = {name: np.empty(shape) for name in FIELD_NAMES[:count]}
        turns = space.rotations.turns(grid.dim)
        for number in range(shape[0]):
            matrix = turns[int(np.argmax(map_.slice_of == number))].matrix
            placed = overlap if matrix is None else overlap.rotated(matrix)
            for rows in np.array_split(np.arange(shape[1]), -(-grid.size // BATCH)):
                cells = np.stack(np.meshgrid(rows, *map(np.arange, shape[2:]), indexing="ij"), axis=-1)
                places = grid.center_of(cells)
                value, gradient = placed.value_and_gradient(places)
                for name, array in zip(arrays, (value, *np.moveaxis(gradient, -1, 0)), strict=True):
                    arrays[name][number, rows] = array
        return cls(space, {name: array.reshape(_shape(space)) for name, array in arrays.items()})

    @property
    def values(self) -> Floats:
        """The overlap at the middle of each cell, shape (nx, ny(, nz)), or (slices, ...) of a robot that turns."""
        return self.arrays[FIELD_NAMES[0]]

    @property
    def cells(self) -> Floats:
        """The same by slice, shape (slices, nx, ny(, nz)), as ``field_at`` takes it."""
        return np.ascontiguousarray(self.values).reshape(self.space.record.states.shape)

    @overload
    def at(self, q: Configuration) -> float: ...  # type: ignore[overload-overlap]
    @overload
    def at(self, q: ConfigurationBatch) -> Floats: ...
    @overload
    def at(self, q: ArrayLike) -> float | Floats: ...
    def at(self, q: ArrayLike) -> float | Floats:
        """The overlap at configurations (..., dof), linear between the middles of cells, and not below zero: shape
        (...).

        Metres, and radians. Outside the grid the nearest value in it is taken; of a rotation, that of its cell.

        Raises InputError if the last axis is not dof long, or a value is NaN or infinite.
        """
        overlaps: float | Floats = answer(
            q, self._dof, in_threaded_chunks(partial(fields_at, *self._fixed())), np.float64, float
        )
        return overlaps

    def checker(self) -> Callable[..., float]:
        """A quick :meth:`at` of floats: ``check(*q) -> float``; they must be finite, and are not checked."""
        check: Callable[..., float] = callback(Field(*self._fixed()), self._dof)
        return check

    @property
    def _dof(self) -> int:
        return self.space.grid.dim + self.space.rotations.dof

    def _fixed(self) -> tuple[Any, ...]:
        return self.space.record, self.cells


def _shape(space: Space) -> tuple[int, ...]:
    return (*space.rotations.leading(space.record.states.shape[0]), *space.grid.shape)


@kernel
def field_at(map_: Map, values: Floats, q: tuple[float, ...]) -> float:
    """A field, linear between the middles of cells, at a configuration."""
    dim = len(map_.lower)
    cell, shares = replaced(map_.states.shape, 0, map_.rotations.states_at(q)), map_.lower
    for axis in range(dim):
        n = map_.states.shape[axis + 1]
        place = min(max((q[axis] - map_.lower[axis]) / map_.spacing - 0.5, 0.0), n - 1.0)
        first = min(int(place), max(n - 2, 0))
        cell, shares = replaced(cell, axis + 1, first), replaced(shares, axis, place - first)
    total = 0.0
    for corner in range(1 << dim):
        share, other = 1.0, cell
        for axis in range(dim):
            upper = (corner >> axis) & 1
            share *= shares[axis] if upper else 1.0 - shares[axis]
            other = replaced(other, axis + 1, cell[axis + 1] + upper)
        if share > 0.0:
            total += share * float(values[other])
    return max(total, 0.0)


@compilable
class Field(NamedTuple):
    """The value of a field at a configuration."""

    map_: Map
    values: Floats

    def answer(self, q: Numbers) -> float:
        return field_at(self.map_, self.values, q)


@kernel
def fields_at(map_: Map, values: Floats, points: Floats, out: Floats) -> int:
    """``field_at`` for many configurations; the index of the first that is not usable, or -1."""
    for k in range(len(points)):
        q = configuration(map_, points, k)
        if not is_usable(map_, q):
            return k
        out[k] = field_at(map_, values, q)
    return -1

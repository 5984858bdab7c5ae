"""Overlaps of ball sets, summed up to a band limit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import finite, positive
from cspace.spectral.separation.balls import ROUNDING, BallSet, bump_of
from cspace.spectral.separation.band import Spectrum, highest_frequency
from cspace.spectral.separation.pairs import norm_square, pair_integrals
from cspace.spectral.separation.rings import Rings
from cspace.spectral.separation.terms import Terms

if TYPE_CHECKING:
    from cspace.spectral.descriptors import Bump

Floats = NDArray[np.float64]

MOST: Final = 2**21
"""Frequencies, opposite ones counted once, up to which the band is chosen where none is given."""

LARGEST: Final = 2**26
"""Frequencies up to which a band may be given."""

HIGHEST: Final = 2**15 - 1
"""Cycles per period, along an axis, that a short integer holds."""

PERIOD_ROOM: Final = 1e-6
"""By how much, relative, the period is longer than it must be, so that rounding cannot make anything wrap around."""

LONGEST: Final = 1e40
"""Metres, beyond which squares of volumes overflow."""

FARTHEST: Final = 1e6
"""How many periods the balls may lie from the origin of their frame."""


class BandOverlap:
    """The overlap of two ball sets and its gradient, up to a band limit; see :class:`FourierOverlap`."""

    def __init__(
        self,
        a: Any,
        b: Any,
        *,
        bump: Bump | None = None,
        threshold: float = 0.0,
        band: float | None = None,
        tolerance: float = 1e-3,
        accuracy: float = 1e-12,
    ) -> None:
        first, second = BallSet.of(a, "a"), BallSet.of(b, "b")
        if first.dim != second.dim:
            raise InputError(
                f"a has {first.dim} coordinates and b has {second.dim}; both must lie in the plane or both in space"
            )
        level = finite(threshold, "threshold")
        if level.ndim or level < 0.0:
            raise InputError(f"threshold is {threshold!r}; it must be one number, zero or above; pass e.g. 0.0")
        self.threshold = float(level)
        self._bump = bump_of(bump, a, b)
        self._accuracy = accuracy
        self._b, self._unturned, self._turn = second, first, np.eye(first.dim)
        self._pivot, self._middle_b = first.middle, second.middle
        self._reach = first.reach(self._pivot) * (1.0 + 2.0**-40)
        self._limits = (second.sides(self._middle_b) + self._reach) * (1.0 + 0.1 * PERIOD_ROOM)
        lengths = 2.0 * (1.0 + PERIOD_ROOM) * self._limits
        far = max(first.span, second.span)
        if far > LONGEST:
            raise InputError(f"the balls reach {far:g} m from the origin; at most {LONGEST:g} m can be computed with")
        if far > FARTHEST * lengths.min():
            raise InputError(
                f"the balls lie {far:g} m from the origin of their frame and take up {lengths.min():g} m; rounding "
                "would count; move the origin nearer to them"
            )
        self._rings = self._make_rings(first, lengths, band, tolerance)
        self._norms = norm_square(self._bump, first), norm_square(self._bump, second)
        self._spectrum_b = self._spectrum(second, self._middle_b, self._norms[1])
        self._place(first)

    # ---- what it is --------------------------------------------------------------------------------------------------

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
        """How many frequencies there are up to the band limit, opposite ones counted once."""
        return self._rings.size

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner, metres, of the placements t where there can be any overlap; beyond, it is zero."""
        middle = self._middle_b - self._pivot
        return middle - self._limits, middle + self._limits

    @property
    def bound(self) -> float:
        """By how much :meth:`value` can differ from the ideal overlap: by the band limit and by rounding."""
        slack, slope = self._terms.slacks[-1]
        farthest = max(float(np.abs(corner).max()) for corner in self.domain)
        return float(self._terms.tails[-1] + slack + slope * ROUNDING * (farthest + self._a.span + self._b.span))

    # ---- how much --------------------------------------------------------------------------------------------------

    def value(self, t: ArrayLike) -> float:
        """The overlap, up to the band limit, with A moved by t.

        Parameters
        ----------
        t : array-like, shape (d,)
            Metres.

        Returns
        -------
        float
            Square or cubic metres; zero outside :attr:`domain`.
        """
        from cspace.spectral.separation._kernels import sum_of_terms

        shares, rings = self._shares(t), self._rings
        if shares is None:
            return 0.0
        return float(sum_of_terms(shares, self._terms.products, rings.indices, rings.reaches[-1]))

    def gradient(self, t: ArrayLike) -> Floats:
        """The derivatives of :meth:`value`, shape (d,): metres, or square metres in space."""
        from cspace.spectral.separation._kernels import sum_of_slopes

        shares, rings, out = self._shares(t), self._rings, np.zeros(self.dim)
        if shares is not None:
            sum_of_slopes(shares, self._terms.products, rings.indices, rings.reaches[-1], rings.lengths, out)
        return out

    def values(self, ts: ArrayLike, tolerance: float = 1e-9) -> Floats:
        """:meth:`value` at many placements, by one non-uniform transform.

        Parameters
        ----------
        ts : array-like, shape (..., d)
            Metres.
        tolerance : float
            Of the transform, relative to the root of the sum of the squares of the terms; from 1e-13 to 0.1.

        Returns
        -------
        ndarray of float64, shape (...)
        """
        return np.asarray(self._transformed(ts, tolerance, np.zeros((1, self.dim), dtype=np.int64))[0])

    def gradients(self, ts: ArrayLike, tolerance: float = 1e-9) -> Floats:
        """:meth:`gradient` at many placements, shape (..., d), as :meth:`values`."""
        return np.moveaxis(self._transformed(ts, tolerance, np.eye(self.dim, dtype=np.int64)), 0, -1)

    # ---- how it is done ----------------------------------------------------------------------------------------------

    def _make_rings(self, a: BallSet, lengths: Floats, band: float | None, tolerance: float) -> Rings:
        if band is not None:
            highest = positive(band, "band", "cycles per metre")
        else:
            typical = np.median(a.radii, keepdims=True), np.median(self._b.radii, keepdims=True)
            scale = self.threshold or float(pair_integrals(self._bump, *typical, np.maximum(*typical), self.dim)[0][0])
            highest = highest_frequency(self._bump, a, self._b, positive(tolerance, "tolerance", "parts") * scale)
            fitting = 0.5 * (2.0 * MOST / float(np.prod(lengths))) ** (1.0 / self.dim)
            highest = min(highest, fitting, HIGHEST / float(lengths.max()))
        halves = tuple(max(1, math.floor(highest * length)) for length in lengths.tolist())
        if math.prod(2 * half + 1 for half in halves) > LARGEST or max(halves) > HIGHEST:
            raise InputError(
                f"band is {band!r}, which takes {' x '.join(str(2 * half + 1) for half in halves)} frequencies; at "
                f"most {LARGEST} are computed; pass a lower one"
            )
        return Rings.of(lengths, halves)

    def _spectrum(self, balls: BallSet, middle: Floats, norm: tuple[float, float]) -> Spectrum:
        return Spectrum.of(balls, middle, self._bump, self._rings, self._accuracy, norm)

    def _place(self, a: BallSet) -> None:
        """Take over the balls of A, whose middle and reach are known."""
        self._a = a
        self._terms = Terms.of(self._spectrum(a, self._pivot, self._norms[0]), self._spectrum_b, self._rings)
        self._box: NDArray[np.complex128] | None = None

    def _checked(self, t: ArrayLike, name: str) -> Floats:
        places = finite(t, name)
        if places.ndim == 0 or places.shape[-1] != self.dim:
            raise InputError(
                f"{name} has shape {places.shape}; its last axis must be {self.dim} long, one entry for each coordinate"
            )
        return places

    def _relative(self, places: Floats) -> Floats:
        """Placements of the middle of A relative to that of B."""
        return np.asarray((places + self._pivot) - self._middle_b)

    def _shares(self, t: ArrayLike) -> Floats | None:
        """One placement of the middle of A relative to that of B, in periods; None where there is no overlap."""
        place = self._checked(t, "t")
        if place.ndim != 1:
            raise InputError(
                f"t has shape {place.shape}; this is about one placement; use values or gradients for many"
            )
        place = self._relative(place)
        return place / self._rings.lengths if (np.abs(place) <= self._limits).all() else None

    def _transformed(self, ts: ArrayLike, tolerance: float, orders: NDArray[np.int64]) -> Floats:
        """Derivatives of the overlap, of an order along each axis, shape (orders, ...)."""
        from cspace.spectral.descriptors.checks import check_tolerance, finufft_module, transform_threads

        within = check_tolerance(tolerance)
        places = self._checked(ts, "ts")
        flat = self._relative(places.reshape(-1, self.dim))
        inside = (np.abs(flat) <= self._limits).all(axis=1)
        out = np.zeros((len(orders), len(flat)))
        if inside.any():
            finufft = finufft_module()
            turns = np.ascontiguousarray(2.0 * math.pi * (flat[inside] / self._rings.lengths).T)
            boxes = np.stack([self._derived(order) for order in orders])
            transform = finufft.nufft2d2 if self.dim == 2 else finufft.nufft3d2
            threads = transform_threads(boxes.size + turns.shape[1])
            out[:, inside] = transform(*turns, boxes, eps=within, isign=1, nthreads=threads).real
        return np.asarray(out.reshape(len(orders), *places.shape[:-1]))

    def _derived(self, order: NDArray[np.int64]) -> NDArray[np.complex128]:
        """The terms of all frequencies, zero in the middle, of a derivative."""
        if self._box is None:
            self._box = self._rings.box_of(self._terms.products / self._rings.twice)
        box = self._box
        for axis, times in enumerate(order):
            if times:
                half = self._rings.halves[axis]
                steps = 2j * math.pi / self._rings.lengths[axis] * np.arange(-half, half + 1)
                box = box * steps.reshape([-1 if i == axis else 1 for i in range(self.dim)]) ** times
        return box

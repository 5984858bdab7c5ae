"""FourierOverlap: how much two ball sets have in common, for any placement of one of them, from their spectra."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import positive
from cspace.spectral.separation.balls import ROUNDING, BallSet, bump_of
from cspace.spectral.separation.band_overlap import BandOverlap
from cspace.spectral.separation.pairs import touching_overlap
from cspace.spectral.separation.turns import rotation_matrix
from cspace.spectral.separation.verdict import Separation, Verdict

if TYPE_CHECKING:
    from cspace.spectral.descriptors import Bump

Floats = NDArray[np.float64]


class FourierOverlap(BandOverlap):
    """The overlap of a ball set A, placed anywhere, with a ball set B; made once, and asked many times.

    A ball set has the descriptor ``f(x) = sum over balls of psi((x - center) / radius)``, with the bump psi. With A
    moved by t the two overlap by

        c(t) = integral f_B(x) f_A(x - t) dx = 1/V sum_w F_B(w) conj(F_A(w)) exp(2 pi i w.t),

    in square or cubic metres, with V the volume of a period so long that nothing that meets B wraps around, whatever t
    and however A is turned. c is above zero exactly where an open ball of the moved A meets one of B, and grows with
    the depth of the collision. A translation is a phase, so that t need not lie on a lattice; the gradient is the same
    sum times ``2 pi i w`` (Lysenko, 2013); and many t at once are one non-uniform transform (finufft).

    :meth:`value`, :meth:`gradient` and the like sum all frequencies up to the band limit, and so differ from the ideal
    c by at most :attr:`bound`. :meth:`separated` sums no more of them than it must to tell whether the ideal c, with
    all frequencies, lies below or above :attr:`threshold`.

    *Every* t is answered. Where t lies outside :attr:`domain`, nothing of A comes near B, and c is exactly zero.

    Parameters
    ----------
    a, b : object with ``centers`` and ``radii``, or (centers, radii)
        Balls of A, in its own frame, and of B; both in the plane or in space; metres. Such as what
        :func:`cspace.spectral.spheres.decompose` returns, or a :class:`cspace.Robot` of balls.
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

    Attributes
    ----------
    threshold : float
    bound : float
        By how much the sums over the band can differ from the ideal overlap, rounding included.

    Raises
    ------
    InputError
        If a value is not as stated.
    MissingPackageError
        If finufft is not installed.

    Notes
    -----
    *Why low frequencies first.* After all ``|w| <= R`` have been summed, to s, the rest is at most T: the moduli of the
    terms that are left within the band, and for those beyond it, by Cauchy and Schwarz, the product of the norms of the
    two spectra there. T falls by what has been summed, so the terms with the most energy should come first, and these
    are the low frequencies: those of a smooth descriptor fall faster than any power of ``|w|``. From the other end
    nearly all terms would have to be summed before T falls at all. There is a second reason: the norms beyond the band
    are known (the integral of the square, from the pairs of balls, less what the band holds), so that low first gives
    a bound for *all* frequencies, of which high first never sees the last.
    """

    _swell: float = 0.0
    """By how much the balls are grown beyond those whose shapes the verdicts are about."""

    _inner: FourierOverlap | None = None
    """The overlap of the inner balls, where there are any."""

    @classmethod
    def of_shapes(
        cls,
        outer_a: Any,
        outer_b: Any,
        inner_a: Any = None,
        inner_b: Any = None,
        *,
        swell: float,
        classes: int = 8,
        bump: Bump | None = None,
        tolerance: float = 1e-3,
        accuracy: float = 1e-12,
    ) -> FourierOverlap:
        """An overlap whose verdicts are proofs about the shapes that the balls stand for.

        The outer balls cover the shapes, and the inner ones lie in them. Every outer ball is grown by ``swell``. Where
        the shapes touch, so do an outer ball of A and one of B, before they grow; after it, the two overlap by at least
        as much as any two balls of these radii that only just touched. That is the threshold. So:

        *MISS* proves that the closed shapes have no point in common. *HIT* proves that they do: an inner ball of A and
        one of B overlap. Between the two lie placements that are closer than twice ``swell``, or than the balls tell.

        The values and gradients are those of the grown outer balls.

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
            How many different radii there may be in each set: outer balls grow and inner balls shrink to the next of
            them. Each takes a transform.
        bump, tolerance, accuracy
            As for the class.

        Raises
        ------
        InputError
            If a value is not as stated, only one of the inner sets is given, or the bump is so flat, or ``swell`` so
            small, that grown balls that touched have too little in common to be computed.
        MissingPackageError
            If finufft is not installed.
        """
        given = {"outer_a": outer_a, "outer_b": outer_b, "inner_a": inner_a, "inner_b": inner_b}
        for name, source in given.items():
            word = getattr(source, "kind", None)
            if word in ("inner", "outer") and word != name[:5]:
                raise InputError(
                    f"{name} is of kind {word!r}; it must be {name[:5]!r}; decompose the shape with that kind"
                )
        kind = bump_of(bump, outer_a, outer_b, inner_a, inner_b)
        more = positive(swell, "swell")
        if isinstance(classes, bool) or not isinstance(classes, int | np.integer) or classes < 1:
            raise InputError(f"classes is {classes!r}; it must be a whole number above zero; pass e.g. 8")
        if (inner_a is None) is not (inner_b is None):
            raise InputError("only one of inner_a and inner_b is given; a hit needs both; pass both, or neither")
        a, b = (
            BallSet.of(x, name).rounded(classes, up=True) for x, name in ((outer_a, "outer_a"), (outer_b, "outer_b"))
        )
        level = touching_overlap(kind, a, b, more, ROUNDING * (a.span + b.span)) if a.dim == b.dim else 0.0
        if a.dim == b.dim and level <= 0.0:
            raise InputError(
                f"swell is {more:g} and balls of {min(a.radii.min(), b.radii.min()):g} m that touched have nothing in "
                f"common that could be computed with alpha = {kind.alpha:g}; pass a larger swell"
            )
        options: dict[str, Any] = {"bump": kind, "tolerance": tolerance, "accuracy": accuracy}
        made = cls(a.grown(more), b.grown(more), threshold=level, **options)
        made._swell = more
        if inner_a is not None:
            sets = (BallSet.of(x, name) for x, name in ((inner_a, "inner_a"), (inner_b, "inner_b")))
            made._inner = cls(*(balls.rounded(classes, up=False) for balls in sets), **options)
            if made._inner.dim != made.dim:
                raise InputError(
                    f"the outer balls have {made.dim} coordinates and the inner ones {made._inner.dim}; both must have "
                    "as many; pass balls of the same shapes"
                )
        return made

    @property
    def frequencies(self) -> int:
        """How many frequencies there are up to the band limit, opposite ones counted once; of inner balls too."""
        return super().frequencies + (self._inner.frequencies if self._inner else 0)

    def rotated(self, rotation: Any) -> FourierOverlap:
        """The same with A turned about the origin of its frame.

        Only the spectrum of A is made anew, from turned centers; nothing is sampled, and the period, the band and the
        threshold stay.

        Parameters
        ----------
        rotation : float, array-like of shape (d, d), or scipy.spatial.transform.Rotation
            An angle in radians, in the plane; or a matrix.

        Raises
        ------
        InputError
            If it is none of these.
        """
        matrix = rotation_matrix(rotation, self.dim)
        other = copy.copy(self)
        # From the first position, so that rounding does not change the shape, however often it is turned.
        other._turn = rotation_matrix(matrix @ self._turn, self.dim)
        other._pivot = other._turn @ self._unturned.middle
        other._place(self._unturned.turned(other._turn))
        other._inner = self._inner.rotated(matrix) if self._inner else None
        return other

    # ---- whether at all ----------------------------------------------------------------------------------------------

    def separated(self, t: ArrayLike, *, swelling: bool = True) -> Separation:
        """Whether A, moved by t, and B are apart, from as few frequencies as possible.

        First, B's balls are swollen by a ball that holds A: where the middle of that lies in none of them, it is a MISS
        without any frequency. Then the frequencies are summed ring by ring from low to high, to s, until s and T, which
        bounds all that has not been summed, the rounding and the errors of the spectra, decide:

        *MISS* (``s + T < threshold``) proves that the ideal overlap ``c(t)``, of the exact sums of bumps, with all
        frequencies, lies below :attr:`threshold`; or, from swollen balls, that it is zero. *HIT*
        (``s - T > threshold``) proves that it lies above. With a threshold of zero a HIT proves that two balls overlap,
        and a MISS that none do. *UNDECIDED*: all frequencies up to the band limit do not tell.

        Of one made by :meth:`of_shapes`, MISS and HIT are proofs about the shapes, as stated there.

        Parameters
        ----------
        t : array-like, shape (d,)
            Metres.
        swelling : bool
            Whether to ask the swollen balls first.

        Returns
        -------
        Separation
        """
        place = self._checked(t, "t")
        if place.ndim != 1:
            raise InputError(f"t has shape {place.shape}; separated is about one placement; use verdicts for many")
        verdicts, counts, sums = self._decide(place[None], swelling)
        verdict = Verdict(int(verdicts[0]))
        total = self._rings.size if verdict is Verdict.MISS else self.frequencies
        return Separation(verdict, int(counts[0]), total, *sums[0].tolist())

    def verdicts(self, ts: ArrayLike, *, swelling: bool = True) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """:meth:`separated` at many placements.

        Parameters
        ----------
        ts : array-like, shape (..., d)
            Metres.
        swelling : bool

        Returns
        -------
        verdicts : ndarray of uint8, shape (...)
            Values of :class:`Verdict`.
        frequencies : ndarray of int64, shape (...)
            How many each took.
        """
        places = self._checked(ts, "ts")
        verdicts, counts, _ = self._decide(np.ascontiguousarray(places.reshape(-1, self.dim)), swelling)
        return verdicts.reshape(places.shape[:-1]), counts.reshape(places.shape[:-1])

    def _decide(self, ts: Floats, swelling: bool) -> tuple[NDArray[np.uint8], NDArray[np.int64], Floats]:
        """Verdicts, numbers of frequencies, and sums with their bounds."""
        from cspace.spectral.separation._kernels import separate_all

        rings, terms = self._rings, self._terms
        places = self._relative(ts)
        fars = ROUNDING * (np.abs(ts).max(axis=1, initial=0.0) + self._a.span + self._b.span)
        verdicts = np.empty(len(ts), dtype=np.uint8)
        counts, sums = np.empty(len(ts), dtype=np.int64), np.empty((len(ts), 2))
        centers = self._b.centers - self._middle_b
        # Balls that were grown for the threshold are taken as they were: where those are apart, so are the shapes.
        reach = self._reach - self._swell + 4.0 * float(fars.max(initial=0.0)) if swelling else math.inf
        swollen = (self._limits, centers, self._b.radii - self._swell, reach)
        known = (terms.products, rings.indices, rings.starts, rings.reaches, rings.lengths, terms.tails, terms.slacks)
        separate_all(places, fars, *swollen, *known, self.threshold, verdicts, counts, sums)  # type: ignore[arg-type]
        if self._swell:
            self._ask_inner(ts, verdicts, counts, sums)
        return verdicts, counts, sums

    def _ask_inner(self, ts: Floats, verdicts: NDArray[np.uint8], counts: NDArray[np.int64], sums: Floats) -> None:
        """Replace what the outer balls do not prove a miss by what the inner ones prove, in place."""
        rest = np.flatnonzero(verdicts != Verdict.MISS)
        verdicts[rest] = Verdict.UNDECIDED
        if self._inner is not None and len(rest):
            found, more, _ = self._inner._decide(ts[rest], swelling=True)
            verdicts[rest] = np.where(found == Verdict.HIT, Verdict.HIT, Verdict.UNDECIDED)
            counts[rest] += more

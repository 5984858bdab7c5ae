"""Overlap of two ball sets at any placement of the first one, with its derivatives."""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._shapes import Balls
from cspace._support.arrays import Floats
from cspace._support.check import check_point, check_points, check_positive
from cspace.errors import InputError
from cspace.spectral._ball_sets import (
    PLACEMENT_ROUNDING,
    BallsLike,
    Rotates,
    as_balls,
    find_center,
    rotation_matrix,
    round_radii,
)
from cspace.spectral._bump import Bump, check_bump, radial_table, sphere_measure
from cspace.spectral._spectra import (
    MAX_FREQUENCIES,
    MIN_SPECTRUM_TOLERANCE,
    Complexes,
    FrequencyLattice,
    RadialFactors,
    evaluate_real_series,
)

MAX_RADII: Final = 8
"""Largest number of different radii of a set of balls; each takes a transform."""

MAX_CYCLES_PER_RADIUS: Final = 32.0
"""Highest frequency considered for a band, cycles per radius of the smallest ball."""

MAX_CHOSEN_FREQUENCIES: Final = 2.0**22
"""Largest number of frequencies of a band that is chosen by a tolerance."""

PERIOD_MARGIN: Final = 1e-6
"""Relative margin of the period, so that rounding cannot make any ball wrap around."""

MAX_PLACEMENTS_PER_TRANSFORM: Final = 2**20
"""Number of placements evaluated by one transform, to bound the memory."""

MAX_PLACEMENTS_ONE_BY_ONE: Final = 8
"""Number of placements up to which values are summed one by one, without a transform."""


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
        result of :func:`cspace.spectral.decompose`, or a :class:`cspace.Robot` of balls. Radii of
        more than eight sizes grow to the next of eight, because each takes a transform.
    bump : Bump, optional
        Bump of both sets, ``Bump(2.0)`` if left out. Smooth bumps need few frequencies; flat ones
        (alpha above about 8, or infinite) up to a hundred times as many.
    band : float, optional
        Highest frequency along each axis, cycles per metre. By default, what is left out is about
        ``tolerance`` times the overlap of two balls of median radius that coincide. At most about
        two million frequencies are used.
    tolerance : float

    Spectra are computed at first use. Raises InputError if a value is not as stated. Methods raise
    MissingPackageError if finufft is needed and not installed.

    Examples
    --------
    >>> from cspace.spectral import FourierOverlap
    >>> overlap = FourierOverlap(([[0.0, 0.0]], 0.3), ([[1.0, 0.0], [2.0, 0.0]], 0.4))
    >>> bool(overlap.value((0.5, 0.0)) > 0.0), float(overlap.value((9.0, 0.0)))
    (True, 0.0)
    """

    def __init__(
        self,
        a: BallsLike,
        b: BallsLike,
        *,
        bump: Bump | None = None,
        band: float | None = None,
        tolerance: float = 1e-3,
    ) -> None:
        """Check both ball sets, and choose the period and the band of their spectra."""
        self.bump = check_bump(bump)
        self.a = round_radii(as_balls(a, "a"), MAX_RADII)
        self.dim = self.a.dim
        self.b = round_radii(as_balls(b, "b", self.dim), MAX_RADII)
        self._centers = find_center(self.a), find_center(self.b)
        self._rotation = np.eye(self.dim)
        # A period is as long as both sets side by side, with A at any rotation.
        reaches = np.linalg.norm(self.a.centers - self._centers[0], axis=1) + self.a.radii
        extents = np.abs(self.b.centers - self._centers[1]) + self.b.radii[:, None]
        self._extents = extents.max(axis=0)
        self._half_sides = (self._extents + reaches.max()) * (1.0 + 0.1 * PERIOD_MARGIN)
        periods = 2.0 * (1.0 + PERIOD_MARGIN) * self._half_sides
        self.span = self.a.span + self.b.span
        # Squares of volumes overflow above 1e40, and underflow below 1e-100.
        if self.span > min(1e40, 1e6 * periods.min()) or periods.max() < 1e-100:
            raise InputError(
                "b",
                f"or a reaches {self.span:g} m from its origin, over a period of {periods} m",
                "rounding would matter",
                "move the origin nearer, or check the units",
            )
        self.lattice = _choose_lattice(self.a, self.b, self.bump, periods, band, tolerance)
        self.steps = 0
        # The balls of B that moved last, and their spectrum.
        self._part = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.complex128)

    def __repr__(self) -> str:
        """Return the numbers of balls and of frequencies."""
        sizes = f"{len(self.a.radii):,} and {len(self.b.radii):,} balls"
        place = "in the plane" if self.dim == 2 else "in space"
        return f"FourierOverlap({sizes} {place}, {self.frequencies:,} frequencies)"

    @property
    def frequencies(self) -> int:
        """Number of frequencies in the band; opposite ones count once."""
        return (math.prod(self.lattice.counts) + 1) // 2

    @property
    def pivot(self) -> Floats:
        """Center of A after the rotation, metres."""
        return np.asarray(self._rotation @ self._centers[0])

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the placements with any overlap."""
        center = self._centers[1] - self.pivot
        return center - self._half_sides, center + self._half_sides

    @property
    def placement_error(self) -> float:
        """Largest rounding error of a placement in the domain, metres."""
        farthest = float(np.abs(self.domain).max())
        return PLACEMENT_ROUNDING * (farthest + math.sqrt(self.dim) * self.span)

    def rotated(self, rotation: Rotates) -> FourierOverlap:
        """Return the overlap with A rotated.

        A rotates about the origin of its frame. ``rotation`` is an angle in the plane, radians, a
        matrix of shape (d, d), or a scipy Rotation; raises InputError for anything else. The period
        and the band stay; the spectrum of A is recomputed at first use.
        """
        rotated = copy.copy(self)
        # Rotate the original balls, so that rounding does not accumulate over repeated rotations.
        matrix = rotation_matrix(rotation, self.dim) @ self._rotation
        rotated._rotation = rotation_matrix(matrix, self.dim)
        for name in ("spectrum_a", "_slopes"):
            rotated.__dict__.pop(name, None)
        return rotated

    def moved(self, chosen: ArrayLike, step: ArrayLike) -> FourierOverlap:
        """Return the overlap with some balls of B moved.

        A step multiplies the spectrum of the balls by a phase, and the spectrum of the others
        stays. Steps of the same balls, one after the other or from the same overlap, share their
        spectrum. To move balls of the first set, swap both sets, and negate t.

        Parameters
        ----------
        chosen : array-like of int, shape (m,), or of bool, one for each ball of B
            Indices of the balls, or a mask.
        step : array-like, shape (d,)
            Metres. The balls must stay in the bounding box that B had at first, because the period
            is as long as that needs.

        Raises InputError if a value is not usable, or balls leave that box.
        """
        shift = check_point(step, "step", self.dim)
        try:
            members = np.unique(np.arange(len(self.b.radii))[np.asarray(chosen)])
        except IndexError:
            members = np.empty(0, dtype=np.int64)
        if not len(members):
            raise InputError(
                "chosen",
                f"is {chosen!r}",
                f"it must be indices of the {len(self.b.radii)} balls of b, or a mask of them",
                "pass e.g. [0]",
            )
        centers = self.b.centers.copy()
        centers[members] += shift
        reaches = np.abs(centers - self._centers[1]) + self.b.radii[:, None]
        if (reaches > self._extents * (1.0 + 0.01 * PERIOD_MARGIN)).any():
            raise InputError(
                "step",
                f"is {step!r}, which moves balls out of the bounding box of b",
                "periods are as long as that box needs",
                "pass the moved balls to a new FourierOverlap",
            )
        kept, part = self._part
        if not np.array_equal(kept, members):
            weights = np.zeros(len(centers))
            weights[members] = 1.0
            part = self._transform_b(weights)
            self._part = members, part
        phases = [
            np.exp(-2j * math.pi * length * wave)
            for length, wave in zip(shift, self.lattice.waves, strict=True)
        ]
        moved = copy.copy(self)
        moved.b = Balls(centers, self.b.radii)
        moved.steps = self.steps + 1
        moved._part = members, part * math.prod(phases[1:], start=phases[0])
        moved.__dict__["spectrum_b"] = self.spectrum_b + (moved._part[1] - part)
        moved.__dict__.pop("_slopes", None)
        return moved

    @cached_property
    def factors_a(self) -> RadialFactors:
        """Radial factors of A, at any rotation."""
        return RadialFactors(self.lattice, self.bump, self.a.radii)

    @cached_property
    def factors_b(self) -> RadialFactors:
        """Radial factors of B."""
        return RadialFactors(self.lattice, self.bump, self.b.radii)

    @cached_property
    def spectrum_a(self) -> Complexes:
        """Spectrum of A about its center, in the order of numpy.fft."""
        placed = (self.a.centers - self._centers[0]) @ self._rotation.T
        return self.factors_a.spectrum(placed, MIN_SPECTRUM_TOLERANCE)

    @cached_property
    def spectrum_b(self) -> Complexes:
        """Spectrum of B about its center, in the order of numpy.fft."""
        return self._transform_b(np.ones(len(self.b.radii)))

    def _transform_b(self, weights: Floats) -> Complexes:
        """Compute the spectrum of B about its center, with a weight for each ball (n,)."""
        relative = self.b.centers - self._centers[1]
        return self.factors_b.spectrum(relative, MIN_SPECTRUM_TOLERANCE, weights)

    @property
    def products(self) -> Complexes:
        """Terms ``F_B conj(F_A) / V`` of the overlap, in the order of numpy.fft."""
        return self.spectrum_b * self.spectrum_a.conj() / float(np.prod(self.lattice.periods))

    def value(self, t: ArrayLike) -> Floats:
        """Compute the band-limited overlap with A moved by t.

        ``t``, shape (..., d), is in metres; the result, shape (...), in square or cubic metres. It
        is 0 outside the domain. More than a few placements share one non-uniform transform, with a
        tolerance of 1e-9 times the 2-norm of the terms. Raises as the class does.
        """
        return np.asarray(self._sum(t, [self.products])[..., 0])[()]

    def gradient(self, t: ArrayLike) -> Floats:
        """Compute the derivatives of :meth:`value`, shape (..., d)."""
        return self._sum(t, self._slopes)

    def value_and_gradient(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """Compute :meth:`value` and :meth:`gradient` together, which is faster."""
        sums = self._sum(t, [self.products, *self._slopes])
        return sums[..., 0], sums[..., 1:]

    @cached_property
    def _slopes(self) -> list[Complexes]:
        """Terms of the derivative along each axis: each wave times 2 pi i times its frequency."""
        products = 2j * math.pi * self.products
        return [products * wave for wave in self.lattice.waves]

    def relative(self, placements: Floats) -> Floats:
        """Return placements (..., d) of A's center relative to B's center, shape (n, d)."""
        flat = placements.reshape(-1, self.dim)
        return np.asarray((flat + self.pivot) - self._centers[1])

    def _sum(self, t: ArrayLike, series: list[Complexes]) -> Floats:
        """Sum several series at placements (..., d); return shape (..., series)."""
        placements = check_points(t, "t", self.dim)
        relative = self.relative(placements)
        out = np.zeros((len(relative), len(series)))
        # Outside the domain, sums are zero.
        in_domain = np.flatnonzero((np.abs(relative) <= self._half_sides).all(axis=-1))
        angles = 2.0 * math.pi * relative / self.lattice.periods
        terms = np.stack(series)
        if len(in_domain) <= MAX_PLACEMENTS_ONE_BY_ONE:
            for n in in_domain:
                sums: Complexes = terms
                # Sum along the axes in turn, the last one first.
                for k, angle in zip(self.lattice.indices[::-1], angles[n, ::-1], strict=True):
                    sums = sums @ np.exp(1j * k * angle)
                out[n] = sums.real
        else:
            blocks = math.ceil(len(in_domain) / MAX_PLACEMENTS_PER_TRANSFORM)
            for block in np.array_split(in_domain, blocks):
                out[block] = evaluate_real_series(angles[block], terms, 1e-9).T
        return out.reshape(*placements.shape[:-1], len(series))


def _choose_lattice(
    a: Balls,
    b: Balls,
    bump: Bump,
    periods: Floats,
    band: float | None,
    tolerance: float,
) -> FrequencyLattice:
    """Choose the frequencies by ``band``, or by ``tolerance``; see :class:`FourierOverlap`.

    Raises InputError if the band is too large.
    """
    if band is not None:
        highest = check_positive(band, "band", "cycles per metre")
    else:
        smaller = min(np.median(a.radii), np.median(b.radii))
        scale = bump.energy(a.dim) * float(smaller) ** a.dim
        wanted = _estimate_band(a, b, bump, check_positive(tolerance, "tolerance", "parts") * scale)
        affordable = (MAX_CHOSEN_FREQUENCIES / float(np.prod(periods))) ** (1.0 / a.dim)
        highest = min(wanted, 0.5 * affordable)
    counts = [2 * max(1, math.floor(highest * period)) + 1 for period in periods.tolist()]
    if math.prod(counts) > MAX_FREQUENCIES:
        raise InputError(
            "band",
            f"is {band!r}, which takes {' x '.join(map(str, counts))} frequencies",
            f"at most {MAX_FREQUENCIES} are computed",
            "pass a lower one",
        )
    return FrequencyLattice(periods, tuple(counts))


def _estimate_band(a: Balls, b: Balls, bump: Bump, bound: float) -> float:
    """Estimate the frequency, cycles per metre, with ``bound`` left above it.

    Above the frequencies of the gaps between balls, their energies add up: the energy of a set is
    the sum of the energies of its bumps. The result is at most :data:`MAX_CYCLES_PER_RADIUS` of the
    smallest ball.
    """
    # Energy of the unit bump above each frequency k, in cycles per radius.
    k = np.linspace(0.0, MAX_CYCLES_PER_RADIUS, 4096)
    densities = radial_table(bump, a.dim, MAX_CYCLES_PER_RADIUS)(k) ** 2 * sphere_measure(k, a.dim)
    energies_above = np.cumsum(densities[::-1])[::-1] * k[1]
    # Energies of both sets above each candidate; a ball of radius r scales them by r^dim.
    all_radii = np.concatenate([a.radii, b.radii])
    frequencies = np.geomspace(0.1 / all_radii.max(), MAX_CYCLES_PER_RADIUS / all_radii.min(), 400)
    tails = [
        balls.radii**a.dim @ np.interp(np.outer(balls.radii, frequencies), k, energies_above)
        for balls in (a, b)
    ]
    is_enough = np.sqrt(tails[0]) * np.sqrt(tails[1]) <= bound
    is_enough[-1] = True
    return float(frequencies[np.argmax(is_enough)])

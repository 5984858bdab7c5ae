"""Overlap of two ball sets at any placement of the first one, with its derivatives."""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import AXES, Balls, Bools, Floats, check_point, check_points, check_positive
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
    MIN_SPECTRUM_TOLERANCE,
    Complexes,
    FrequencyLattice,
    RadialFactors,
    evaluate_real_series,
)

MAX_RADII: Final = 8
"""Largest number of different radii of a set of balls; each takes a transform."""

MAX_CYCLES_PER_RADIUS: Final = 32
"""Highest frequency considered for a band, cycles per radius of the smallest ball."""

MAX_OVERLAP_FREQUENCIES: Final = 2**22
"""Largest number of frequencies of an overlap, opposite ones counted both."""

PERIOD_MARGIN: Final = 1e-6
"""Relative margin of the period, so that rounding cannot make any ball wrap around."""


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
    tolerance : float
        What is left out beyond the highest frequency is about ``tolerance`` times the overlap of
        two balls of median radius that coincide. At most about two million frequencies are used.

    Raises InputError if a value is not as stated. Raises MissingPackageError, as methods do, if
    finufft is needed and not installed.

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
        tolerance: float = 1e-3,
    ) -> None:
        """Check both ball sets, and compute their spectra."""
        self.bump = check_bump(bump)
        self.a = round_radii(as_balls(a, "a"), MAX_RADII)
        self.dim = self.a.dim
        self.b = round_radii(as_balls(b, "b", self.dim), MAX_RADII)
        self.span = self.a.span + self.b.span
        self.lattice = choose_lattice(self.a, self.b, self.bump, tolerance, MAX_OVERLAP_FREQUENCIES)
        self.factors_a, self.factors_b = (
            RadialFactors(self.lattice, self.bump, balls.radii) for balls in (self.a, self.b)
        )
        self._centers = find_center(self.a), find_center(self.b)
        self._extents = np.abs(self.b.bounds - self._centers[1]).max(axis=0)
        self._rotation = np.eye(self.dim)
        self.spectrum_a = self._transform_a()
        self.spectrum_b = self._transform_b()
        self.steps = 0
        # The balls of B that moved last, as a mask, and their spectrum.
        self._part = np.zeros(len(self.b.radii), dtype=np.bool_), np.zeros_like(self.spectrum_b)

    def __repr__(self) -> str:
        """Return the numbers of balls and of frequencies."""
        sizes = f"{len(self.a.radii):,} and {len(self.b.radii):,} balls"
        place = "in the plane" if self.dim == 2 else "in space"
        return f"FourierOverlap({sizes} {place}, {self.frequencies:,} frequencies)"

    @property
    def frequencies(self) -> int:
        """Number of frequencies; opposite ones count once."""
        return (math.prod(self.lattice.counts) + 1) // 2

    @property
    def _offset(self) -> Floats:
        """B's center relative to that of the turned A, metres."""
        return np.asarray(self._centers[1] - self._rotation @ self._centers[0])

    @property
    def domain(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of placements with overlap."""
        half_sides = 0.5 * self.lattice.periods
        return self._offset - half_sides, self._offset + half_sides

    @property
    def _placement_error(self) -> float:
        """Largest rounding error of a placement, metres."""
        farthest = float(np.abs(self.domain).max())
        return PLACEMENT_ROUNDING * (farthest + math.sqrt(self.dim) * self.span)

    def rotated(self, rotation: Rotates) -> FourierOverlap:
        """Return the overlap with A rotated.

        A rotates about the origin of its frame. ``rotation`` is an angle in the plane, radians, a
        matrix of shape (d, d), or a scipy Rotation; raises InputError for anything else. The period
        and the frequencies stay; the spectrum of A is computed anew.
        """
        # Rotate the original balls, so that rounding does not accumulate over repeated rotations.
        matrix = rotation_matrix(rotation, self.dim) @ self._rotation
        rotated = copy.copy(self)
        rotated._rotation = rotation_matrix(matrix, self.dim)
        rotated.spectrum_a = rotated._transform_a()
        rotated.__dict__.pop("_terms", None)
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
        is_chosen = np.zeros(len(self.b.radii), dtype=np.bool_)
        try:
            is_chosen[np.asarray(chosen)] = True
        except IndexError as error:
            raise InputError(
                "chosen",
                f"is {chosen!r}",
                f"it must be indices of the {len(is_chosen)} balls of b, or a mask of them",
            ) from error
        moved = copy.copy(self)
        moved.b = Balls(self.b.centers + is_chosen[:, None] * shift, self.b.radii)
        extents = np.abs(moved.b.bounds - self._centers[1]).max(axis=0)
        if (extents > self._extents + 0.1 * PERIOD_MARGIN * self.lattice.periods).any():
            raise InputError(
                "step",
                f"is {step!r}, which moves balls out of the bounding box of b",
                "periods are as long as that box needs",
            )
        kept, part = self._part
        if not np.array_equal(kept, is_chosen):
            part = self._transform_b(is_chosen)
            self._part = is_chosen, part
        phases = [
            np.exp(-2j * math.pi * length * wave)
            for length, wave in zip(shift, self.lattice.waves, strict=True)
        ]
        moved_part = part * math.prod(phases[1:], start=phases[0])
        moved.spectrum_b = self.spectrum_b + (moved_part - part)
        moved.steps = self.steps + 1
        moved._part = is_chosen, moved_part
        moved.__dict__.pop("_terms", None)
        return moved

    def _transform_a(self) -> Complexes:
        """Compute A's spectrum about its center, in numpy.fft's order."""
        placed = (self.a.centers - self._centers[0]) @ self._rotation.T
        return self.factors_a.spectrum(placed, MIN_SPECTRUM_TOLERANCE)

    def _transform_b(self, is_chosen: Bools | None = None) -> Complexes:
        """Compute the spectrum of B, or chosen balls, about its center."""
        relative = self.b.centers - self._centers[1]
        return self.factors_b.spectrum(relative, MIN_SPECTRUM_TOLERANCE, is_chosen)

    @property
    def _products(self) -> Complexes:
        """Terms ``F_B conj(F_A) / V`` of the overlap, in numpy.fft's order."""
        return self.spectrum_b * self.spectrum_a.conj() / float(np.prod(self.lattice.periods))

    @cached_property
    def _terms(self) -> Complexes:
        """Terms of the overlap and its derivatives, shape (1 + d, counts)."""
        products = self._products
        slopes = [2j * math.pi * wave * products for wave in self.lattice.waves]
        return np.stack([products, *slopes])

    def value(self, t: ArrayLike) -> Floats:
        """Compute the band-limited overlap with A moved by t.

        ``t``, shape (..., d), is in metres; the result, shape (...), in square or cubic metres. It
        is 0 outside the domain. More than a few placements share one non-uniform transform, with a
        tolerance of 1e-9 times the 2-norm of the terms. Raises as the class does.
        """
        return np.asarray(self._sum(t, self._terms[:1])[..., 0])[()]

    def value_and_gradient(self, t: ArrayLike) -> tuple[Floats, Floats]:
        """Compute :meth:`value`, and its derivatives, shape (..., d)."""
        sums = self._sum(t, self._terms)
        return sums[..., 0][()], sums[..., 1:]

    def _relative(self, placements: Floats) -> Floats:
        """Return placements (..., d) relative to B's center, shape (n, d)."""
        return np.asarray(placements.reshape(-1, self.dim) - self._offset)

    def _sum(self, t: ArrayLike, terms: Complexes) -> Floats:
        """Sum series (m, counts) at placements (..., d); return (..., m)."""
        placements = check_points(t, "t", AXES[: self.dim])
        shares = self._relative(placements) / self.lattice.periods
        out = np.zeros((len(shares), len(terms)))
        # Outside the domain, sums are zero.
        in_domain = np.flatnonzero((np.abs(shares) <= 0.5).all(axis=-1))
        angles = 2.0 * math.pi * shares
        # Number of placements up to which values are summed one by one, without a transform.
        if len(in_domain) <= 8:
            for n in in_domain:
                sums = terms
                # Sum along the axes in turn, the last one first.
                for k, angle in zip(self.lattice.indices[::-1], angles[n, ::-1], strict=True):
                    sums = np.einsum("...k,k->...", sums, np.exp(1j * k * angle))
                out[n] = sums.real
        else:
            # Number of placements evaluated by one transform, to bound the memory.
            blocks = math.ceil(len(in_domain) / 2**20)
            for block in np.array_split(in_domain, blocks):
                out[block] = evaluate_real_series(angles[block], terms, 1e-9).T
        return out.reshape(*placements.shape[:-1], len(terms))


def choose_lattice(a: Balls, b: Balls, bump: Bump, tolerance: float, most: int) -> FrequencyLattice:
    """Choose at most about ``most`` frequencies by a tolerance; see :class:`FourierOverlap`.

    Raises InputError if rounding would matter.
    """
    dim = a.dim
    # A period is as long as both sets side by side, with A at any rotation.
    reach = (np.linalg.norm(a.centers - find_center(a), axis=1) + a.radii).max()
    extents = np.abs(b.bounds - find_center(b)).max(axis=0)
    periods = 2.0 * (1.0 + PERIOD_MARGIN) * (extents + reach)
    span = a.span + b.span
    # Squares of volumes overflow above 1e40, and underflow below 1e-100.
    if span > min(1e40, 1e6 * periods.min()) or periods.max() < 1e-100:
        raise InputError(
            "b",
            f"or a reaches {span:g} m from its origin, over a period of {periods} m",
            "rounding would matter",
        )
    smaller = float(min(np.median(a.radii), np.median(b.radii)))
    bound = check_positive(tolerance, "tolerance", "parts") * bump.energy(dim) * smaller**dim
    affordable = 0.5 * (most / float(np.prod(periods))) ** (1.0 / dim)
    highest = min(_estimate_band(a, b, bump, bound), affordable)
    counts = tuple(2 * max(1, math.floor(highest * period)) + 1 for period in periods.tolist())
    return FrequencyLattice(periods, counts)


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

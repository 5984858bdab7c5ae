"""Best placements of one ball set on another, and the overlap of balls that move, each on its own.

A search correlates by FFT at each rotation, then climbs along the gradient, which comes from cubic
splines of fields.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspace._rotations import Rotations
from cspace._shapes import Balls
from cspace._support.arrays import Floats
from cspace._support.check import (
    check_count,
    check_finite,
    check_flag,
    check_not_negative,
    check_positive,
)
from cspace._support.threads import count_cores
from cspace.errors import InputError
from cspace.spectral._ball_sets import (
    BallsLike,
    Rotates,
    as_balls,
    as_matrices,
    find_center,
    rotation_matrix,
    round_radii,
)
from cspace.spectral._bump import Bump, check_bump
from cspace.spectral._overlap import MAX_RADII, FourierOverlap
from cspace.spectral._spectra import Complexes

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

MAX_SEARCH_FREQUENCIES: Final = 2**19
"""Largest number of frequencies of a search, opposite ones counted both."""

SEARCH_ACCURACY: Final = 1e-5
"""Accuracy of the spectra of a search, relative to their largest values."""

ASCENT_LENGTHS: Final = (1e-3, 2.0)
"""Length of the last steps and of the longest steps of an ascent, in spacings of the lattice."""

SMALLEST_LENGTH: Final = float(np.finfo(np.float64).tiny)
"""Smallest length that others are divided by."""


class Placements(NamedTuple):
    """Placements of a ball set A and their scores, best first.

    A point p of A lies at ``rotations[k] @ p + translations[k]``: matrices (n, d, d), and metres
    (n, d). ``scores``, shape (n,), are in square or cubic metres.
    """

    scores: Floats
    translations: Floats
    rotations: Floats

    @property
    def configurations(self) -> Floats:
        """Placements as configurations of maps, with a yaw or a quaternion."""
        from scipy.spatial.transform import Rotation

        coordinates = np.empty((0, 4))
        if self.translations.shape[1] == 2:
            coordinates = np.arctan2(self.rotations[:, 1, 0], self.rotations[:, 0, 0])[:, None]
        elif len(self.scores):
            coordinates = Rotation.from_matrix(self.rotations).as_quat()
        return np.column_stack([self.translations, coordinates])


def best_placements(
    a: BallsLike,
    b: BallsLike,
    rotations: int | Rotations | Rotates,
    n: int = 10,
    *,
    avoid: BallsLike | None = None,
    penalty: float = 100.0,
    separation: float | None = None,
    refine_rotations: bool = True,
    bump: Bump | None = None,
    tolerance: float = 0.01,
) -> Placements:
    """Find the best placements of A over a grid of rotations.

    The score is the overlap of A with B, minus ``penalty`` times its overlap with ``avoid``;
    overlaps as in :class:`FourierOverlap`. At each rotation, one inverse FFT gives the scores at
    all translations of a lattice, the rotational search of docking (Chen and Weng, 2002; Kozakov
    and others, 2006). The highest peaks then climb along the gradient with respect to translation
    and rotation. A peak narrower than the steps of the lattice and of ``rotations`` may be missed;
    scores are those of the search.

    Parameters
    ----------
    a, b, avoid : object with ``centers`` and ``radii``, or (centers, radii)
        Balls of A, in its own frame, of what A shall overlap, and of what it shall not; metres. To
        put a part into a pocket, pass the pocket as ``b`` and the material around it as ``avoid``.
        To put it next to others, pass their balls with larger radii as ``b``, and as they are as
        ``avoid``.
    rotations : int, Rotations, scipy Rotation, or array-like of angles (m,) or matrices (m, d, d)
        Rotations of A about the origin of its frame. A whole number means as many yaws. Spacings of
        10 degrees are usual.
    n : int
        Largest number of placements.
    penalty : float
        Zero or above.
    separation : float, optional
        Smallest root mean square displacement of the centers of A's balls between two of the
        placements, metres. By default half the radius of gyration of A. Rotations that leave A as
        it looks are placements of their own.
    refine_rotations : bool
        Whether the ascent rotates A too. Otherwise, it keeps to ``rotations``.
    bump : Bump, optional
        As for :class:`FourierOverlap`.
    tolerance : float
        Scores err by about this times the summed overlaps of the balls of A with themselves. At
        most about 260,000 frequencies are used, opposite ones counted once.

    Returns
    -------
    Placements
        Fewer than ``n`` if the search found fewer with scores above its error.

    Memory is that of one rotation and the best placements so far. Raises InputError if a value is
    not as stated. Raises MissingPackageError if finufft is not installed.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import best_placements, decompose
    >>> part, pocket = (decompose(shapely.box(0, 0, x, 1), kind="inner", number=16) for x in (2, 4))
    >>> best = best_placements(part, pocket, 36, n=1)
    >>> best.translations.shape, best.rotations.shape
    ((1, 2), (1, 2, 2))
    """
    body = as_balls(a, "a")
    target = as_balls(b, "b", body.dim)
    number = check_count(n, "n", 1, hint="pass e.g. 10")
    cost = check_not_negative(penalty, "penalty", "pass e.g. 100")
    check_flag(refine_rotations, "refine_rotations")
    # Both targets are one set of balls, with negative weights for those to avoid.
    sets = [round_radii(target, MAX_RADII // 2, grow=False)]
    if avoid is not None:
        avoided = as_balls(avoid, "avoid", body.dim)
        sets.append(round_radii(avoided, MAX_RADII // 2, grow=False))
    targets = Balls(
        np.concatenate([balls.centers for balls in sets]),
        np.concatenate([balls.radii for balls in sets]),
    )
    weights = np.full(len(targets.radii), -cost)
    weights[: len(target.radii)] = 1.0
    # The search places the centroid of the balls of A.
    centroid = body.centers.mean(axis=0)
    part = round_radii(body, MAX_RADII, grow=False)
    part = Balls(part.centers - centroid, part.radii)
    score = _Score(part, targets, weights, check_bump(bump), tolerance)
    matrices = _make_rotation_matrices(rotations, body.dim)
    gap = 0.5 * score.gyration if separation is None else check_positive(separation, "separation")
    # More placements are refined than returned, and closer ones, because some climb to one peak.
    most = 2 * number + 8
    best = Placements(np.empty(0), np.empty((0, body.dim)), np.empty((0, body.dim, body.dim)))
    for matrix in matrices:
        floor = score.error
        if len(best.scores) == most:
            floor = float(best.scores[-1])
        peaks = score.find_peaks(matrix, floor, most)
        if peaks is not None:
            columns = zip(best, peaks, strict=True)
            both = Placements(*map(np.concatenate, columns))
            best = _select_distinct(both, part.centers, 0.5 * gap, most)
    best = score.climb(best, refine_rotations)
    best = _select_distinct(best, part.centers, gap, number)
    return best._replace(translations=best.translations - best.rotations @ centroid)


class Correlation:
    """Overlaps of a body's balls with weighted target balls, from spectra.

    Inverse FFTs give the overlaps at the steps of a lattice, ``shape`` of them in a period. Cubic
    splines of the fields that the target makes, one for each radius of the body, give them
    elsewhere.
    """

    def __init__(self, overlap: FourierOverlap, weights: Floats | None = None) -> None:
        """Choose a lattice for FFTs, and compute the spectrum of the target."""
        from scipy.fft import next_fast_len

        self.lattice = overlap.lattice
        self.shape = tuple(next_fast_len(count, real=True) for count in self.lattice.counts)
        self.cells_per_metre = self.shape / self.lattice.periods
        self.center = find_center(overlap.b)
        self.factors = overlap.factors_a
        self.spectrum = overlap.factors_b.spectrum(
            overlap.b.centers - self.center, SEARCH_ACCURACY, weights
        )

    def overlaps(self, centers: Floats) -> Floats:
        """Return the overlaps of the body around centers, at all steps of the lattice.

        ``centers``, shape (k, d), are relative to a point that lies at the target's center at the
        first step.
        """
        body_spectrum = self.factors.spectrum(centers, SEARCH_ACCURACY)
        return self._invert(self.spectrum * body_spectrum.conj())

    def _invert(self, spectrum: Complexes) -> Floats:
        """Return the values of a spectrum of a real function on the lattice, by an inverse FFT."""
        from scipy.fft import irfftn

        padded = np.zeros(self.shape, dtype=np.complex128)
        # Negative frequencies count from the end.
        padded[np.ix_(*(k.astype(np.intp) for k in self.lattice.indices))] = spectrum
        # Half of the frequencies suffice, because opposite ones have conjugate values.
        half = padded[..., : self.shape[-1] // 2 + 1]
        values = irfftn(half, s=self.shape, workers=count_cores())
        return np.asarray(values * self.cells_per_metre.prod())

    @cached_property
    def splines(self) -> list[NdBSpline]:
        """Spline of the field of each radius, at places in cells, from 0 to the period."""
        from scipy.interpolate import NdBSpline
        from scipy.ndimage import spline_filter

        knots = tuple(np.arange(count + 7) - 3.0 for count in self.shape)
        splines = []
        for _, factor in self.factors.groups:
            coefficients = spline_filter(self._invert(self.spectrum * factor), mode="grid-wrap")
            # The splines are periodic: one cell before and two cells after the period.
            periodic = np.pad(coefficients, (1, 2), mode="wrap")
            splines.append(NdBSpline(knots, periodic, 3))
        return splines

    def evaluate(self, centers: Floats) -> Floats:
        """Return the overlaps of moved balls and their derivatives, shape (n, k, 1 + d).

        ``centers``, shape (n, k, d), are the places of the k balls of the body, metres. Fields
        repeat with the period.
        """
        dim = len(self.shape)
        places = (centers - self.center) * self.cells_per_metre % self.shape
        orders = np.eye(1 + dim, dtype=np.int64)[:, 1:]  # the value, and each derivative
        sums = np.zeros((*centers.shape[:2], 1 + dim))
        for (members, _), spline in zip(self.factors.groups, self.splines, strict=True):
            for column, order in enumerate(orders):
                sums[:, members, column] = spline(places[:, members], nu=tuple(order))
        sums[..., 1:] *= self.cells_per_metre
        return sums


class BallPenetration:
    """Overlap of independently moving balls with fixed ones, and its derivatives.

    For optimizers: the overlap is zero if no balls meet, grows with the depth, and is as smooth as
    the descriptors. Cubic splines of the fields that fixed balls make give it, within about
    ``tolerance``; it proves nothing. :class:`cspace.arms.ArmPenetration` moves the balls with the
    links of an arm.

    Parameters
    ----------
    radii : array-like, shape (k,)
        Radii of the balls that move, metres.
    fixed : object with ``centers`` and ``radii``, or (centers, radii)
        The other balls, in the plane or in space, metres.
    bump, tolerance
        As for :class:`FourierOverlap`.

    Raises InputError if a value is not as stated. Raises MissingPackageError if finufft is needed,
    for many balls of one radius, and is not installed.

    Examples
    --------
    >>> from cspace.spectral import BallPenetration
    >>> field = BallPenetration([0.2, 0.1], ([[0.0, 0.0]], 0.5))
    >>> value, gradient = field.value_and_gradient([[0.4, 0.0], [0.0, 0.9]])
    >>> bool(value > 0.0), bool(gradient[0, 0] < 0.0), gradient[1].tolist()
    (True, True, [0.0, 0.0])
    """

    def __init__(
        self,
        radii: ArrayLike,
        fixed: BallsLike,
        *,
        bump: Bump | None = None,
        tolerance: float = 0.01,
    ) -> None:
        """Check all balls, and compute the spectrum of the fixed ones."""
        balls = as_balls(fixed, "fixed")
        sizes = np.atleast_1d(check_finite(radii, "radii"))
        # Only the radii of the moving balls matter, so all stand at the origin.
        moving = np.zeros((len(sizes), balls.dim)), sizes
        overlap = FourierOverlap(moving, balls, bump=bump, tolerance=tolerance)
        self._lower, self._upper = overlap.domain
        self._fields = Correlation(overlap)

    def value_and_gradient(self, centers: ArrayLike) -> tuple[Floats, Floats]:
        """Compute the summed overlap and its derivatives by the centers.

        ``centers``, shape (..., k, d), are in metres. The results have shapes (...) and (..., k,
        d), in square or cubic metres, and that per metre. Raises InputError if the shape is
        another, or a value is not finite.
        """
        points = check_finite(centers, "centers")
        dim = len(self._lower)
        count = len(self._fields.factors.radii)
        if points.ndim < 2 or points.shape[-2:] != (count, dim):
            raise InputError(
                "centers",
                f"has shape {points.shape}",
                f"the last axes must be {count} balls and {dim} coordinates",
                "pass all balls",
            )
        # The value of each ball, and its derivatives.
        sums = self._fields.evaluate(points.reshape(-1, count, dim))
        sums = sums.reshape(*points.shape[:-1], 1 + dim)
        # Fields repeat with the period, but the overlap does not.
        is_near = ((self._lower <= points) & (points <= self._upper)).all(axis=-1)
        sums[~is_near] = 0.0
        return sums[..., 0].sum(axis=-1), sums[..., 1:]


def _select_distinct(
    placements: Placements, centers: Floats, min_displacement: float, most: int
) -> Placements:
    """Select at most ``most`` best placements, none within ``min_displacement`` of a better one.

    The displacement is the root mean square over the balls of A, with centers (k, d).
    """
    placed = centers @ np.swapaxes(placements.rotations, 1, 2) + placements.translations[:, None]
    chosen: list[int] = []
    for pose in np.argsort(-placements.scores, kind="stable").tolist():
        if len(chosen) == most:
            break
        squares = ((placed[chosen] - placed[pose]) ** 2).sum(axis=2).mean(axis=1)
        if (squares >= min_displacement**2).all():
            chosen.append(pose)
    return Placements(*(column[chosen] for column in placements))


class _Score:
    """Score of A at any pose of the centroid of its balls: its overlap with weighted balls.

    With the terms ``s_i g(|w|)`` of a ball i of A, and the fields ``G`` with spectrum ``F_B g``,
    the score is the sum of ``s_i G(R p_i + t)`` over balls and terms. So the ascent needs no
    spectrum of A: it takes cubic splines of G.
    """

    def __init__(
        self,
        body: Balls,
        target: Balls,
        weights: Floats,
        bump: Bump,
        tolerance: float,
    ) -> None:
        """Choose the band of the search, and measure how the balls of A spread."""
        within = check_positive(tolerance, "tolerance", "parts")
        volume = float((body.radii**body.dim).sum())
        self.error = within * bump.energy(body.dim) * volume
        # An overlap refers its tolerance to one ball. What costs more must be more accurate.
        smaller = float(min(np.median(body.radii), np.median(target.radii)))
        within *= volume / smaller**body.dim / max(1.0, float(np.abs(weights).max()))
        self.body = body
        self.dim = body.dim
        overlap = FourierOverlap(body, target, bump=bump, tolerance=within)
        shrink = (0.5 * MAX_SEARCH_FREQUENCIES / overlap.frequencies) ** (1.0 / self.dim)
        if shrink < 1.0:
            highest = max(float(wave.max()) for wave in overlap.lattice.waves)
            overlap = FourierOverlap(body, target, bump=bump, band=shrink * highest)
        self.correlation = Correlation(overlap, weights)
        squares = (body.centers**2).sum(axis=1) + body.radii**2
        self.gyration = math.sqrt(float(squares.mean()))

    def find_peaks(self, matrix: Floats, floor: float, most: int) -> Placements | None:
        """Find the highest local maxima on the lattice, above a score.

        A is rotated by ``matrix``, shape (d, d); at most ``most`` are returned, or None.
        """
        from scipy.ndimage import maximum_filter

        scores = self.correlation.overlaps(self.body.centers @ matrix.T)
        if scores.max() <= floor:
            return None
        is_peak = (scores > floor) & (scores == maximum_filter(scores, 3, mode="wrap"))
        highest = np.argsort(-scores[is_peak])[:most]
        steps = np.argwhere(is_peak)[highest]
        shares = steps / scores.shape  # of the period
        # Take the nearest of all periods.
        periods = self.correlation.lattice.periods
        translations = (shares - np.round(shares)) * periods + self.correlation.center
        rotations = np.broadcast_to(matrix, (len(steps), *matrix.shape))
        return Placements(scores[is_peak][highest], translations, rotations)

    def climb(self, poses: Placements, turn: bool) -> Placements:
        """Move poses along the gradient to near maxima, by BFGS.

        Steps are in metres: along the axes, and for rotations, if ``turn``, the arc at the radius
        of gyration.
        """
        poses, slopes = self._score_poses(poses, turn)
        spacing = float((1.0 / self.correlation.cells_per_metre).min())
        last_length, max_length = spacing * np.array(ASCENT_LENGTHS)
        trust = np.full(len(slopes), 0.5 * spacing)  # largest length of the next step
        sizes = np.maximum(np.linalg.norm(slopes, axis=1), SMALLEST_LENGTH)
        inverse = np.eye(slopes.shape[1]) * (trust / sizes)[:, None, None]
        for _ in range(40):
            steps = np.einsum("nij,nj->ni", inverse, slopes)
            lengths = np.maximum(np.linalg.norm(steps, axis=1), SMALLEST_LENGTH)
            if (lengths <= last_length).all():
                break
            steps *= np.minimum(1.0, trust / lengths)[:, None]
            lengths = np.minimum(lengths, trust)
            moved, moved_slopes = self._score_poses(self._move_poses(poses, steps), turn)
            inverse = _update_inverse(inverse, steps, slopes - moved_slopes)
            # Take the steps that lead up, and trust them more; shorten the others.
            is_better = moved.scores > poses.scores
            longer = np.minimum(2.0 * lengths, max_length)
            trust = np.where(is_better, longer, 0.3 * lengths)
            slopes[is_better] = moved_slopes[is_better]
            for column, moved_column in zip(poses, moved, strict=True):
                column[is_better] = moved_column[is_better]
        return poses

    def _move_poses(self, poses: Placements, steps: Floats) -> Placements:
        """Move poses by steps, shape (n, d + rotations): translations, then turns of A."""
        from scipy.spatial.transform import Rotation

        rotations = poses.rotations
        turns = steps[:, self.dim :] / self.gyration
        if turns.size:
            vectors = np.pad(turns, ((0, 0), (3 - turns.shape[1], 0)))  # about z in the plane
            matrices = Rotation.from_rotvec(vectors).as_matrix()
            rotations = matrices[:, : self.dim, : self.dim] @ rotations
        translations = poses.translations + steps[:, : self.dim]
        return Placements(poses.scores, translations, rotations)

    def _score_poses(self, poses: Placements, turn: bool) -> tuple[Placements, Floats]:
        """Score poses, and compute the derivatives by steps, shape (n, d), or with turns.

        The derivative by the center of a ball is a force on it.
        """
        arms = np.einsum("nij,kj->nki", poses.rotations, self.body.centers)
        sums = self.correlation.evaluate(poses.translations[:, None] + arms)
        forces = sums[..., 1:]
        slopes = forces.sum(axis=1)
        if turn:
            # A turn feels the moment of the forces about the centroid.
            margins = (0, 0), (0, 0), (0, 3 - self.dim)
            twists = np.cross(np.pad(arms, margins), np.pad(forces, margins)).sum(axis=1)
            if self.dim == 2:
                twists = twists[:, 2:]
            slopes = np.column_stack([slopes, twists / self.gyration])
        scores = sums[..., 0].sum(axis=1)
        return Placements(scores, poses.translations.copy(), poses.rotations.copy()), slopes


def _update_inverse(inverse: Floats, steps: Floats, changes: Floats) -> Floats:
    """Update negated inverse Hessians (n, k, k) by the formula of BFGS.

    ``steps`` and ``changes``, shape (n, k), are steps and the falls of the slopes along them.
    """
    # Keep the matrix if the slope did not fall, which would make it indefinite.
    products = (steps * changes).sum(axis=1)
    lengths = np.linalg.norm(steps, axis=1) * np.linalg.norm(changes, axis=1)
    is_usable = products > 1e-10 * lengths
    rho = np.where(is_usable, 1.0 / np.where(is_usable, products, 1.0), 0.0)[:, None, None]
    columns = steps[:, :, None]
    left = np.eye(steps.shape[1]) - rho * columns * changes[:, None, :]
    squares = rho * columns * steps[:, None, :]
    return np.asarray(left @ inverse @ np.swapaxes(left, 1, 2) + squares)


def _make_rotation_matrices(rotations: int | Rotations | Rotates, dim: int) -> Floats:
    """Convert rotations to matrices (m, d, d).

    They are a number of yaws, rotation cells, a scipy Rotation, or an array of angles or matrices.
    """
    if isinstance(rotations, Rotations | int | np.integer):
        cells = Rotations.of(rotations)
        cells._check_dimension(dim)
        return cells._make_matrices(cells.centers, dim)
    values = check_finite(as_matrices(rotations), "rotations")
    if dim == 2 and values.ndim < 2:
        values = np.atleast_1d(values)
    else:
        values = values.reshape(-1, *values.shape[-2:])
    if not len(values):
        raise InputError(
            "rotations",
            "is empty",
            "there must be one",
            "pass e.g. Rotations.of(36)",
        )
    return np.stack([rotation_matrix(value, dim) for value in values])

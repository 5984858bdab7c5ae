"""Best placements of one ball set on another, and the overlap of balls that move, each on its own.

A search correlates by FFT at each rotation, then climbs along the gradient, which comes from cubic
splines of fields.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cspace import Rotations
from cspace.errors import InputError
from cspace.inside import (
    Balls,
    Floats,
    check_count,
    check_finite,
    check_not_negative,
    check_positive,
    count_cores,
    names_options,
)
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
from cspace.spectral._overlap import MAX_OVERLAP_FREQUENCIES, MAX_RADII, choose_lattice
from cspace.spectral._spectra import Complexes, RadialFactors

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

SPECTRUM_ACCURACY: Final = 1e-5
"""Accuracy of the spectra of fields, relative to their largest values."""


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
        if self.translations.shape[1] == 2:
            coordinates = np.arctan2(self.rotations[:, 1, 0], self.rotations[:, 0, 0])
        else:
            coordinates = Rotation.from_matrix(self.rotations).as_quat()
        return np.column_stack([self.translations, coordinates])


@names_options
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
) -> Placements:
    """Find the best placements of A over a grid of rotations.

    The score is the overlap of A with B, minus ``penalty`` times its overlap with ``avoid``;
    overlaps as in :class:`FourierOverlap`. At each rotation, one inverse FFT gives the scores at
    all translations of a lattice, the rotational search of docking (Chen and Weng, 2002; Kozakov
    and others, 2006). The highest peaks then climb along the gradient with respect to translation
    and rotation. A peak narrower than the steps of the lattice and of ``rotations`` may be missed;
    scores are those of the search, and err by about 1 % of the summed overlaps of the balls of A
    with themselves.

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
    targets = [as_balls(b, "b", body.dim)]
    weights = [1.0]
    cost = check_not_negative(penalty, "penalty", "")
    if avoid is not None:
        targets.append(as_balls(avoid, "avoid", body.dim))
        weights.append(-cost)
    number = check_count(n, "n", 1)
    # The search places the centroid of the balls of A.
    centroid = body.centers.mean(axis=0)
    search = _Search(Balls(body.centers - centroid, body.radii), targets, weights, check_bump(bump))
    gap = 0.5 * search.gyration
    if separation is not None:
        gap = check_positive(separation, "separation")
    # More placements are refined than returned, and closer ones, because some climb to one peak.
    most = 2 * number + 8
    best = Placements(np.empty(0), np.empty((0, body.dim)), np.empty((0, body.dim, body.dim)))
    for matrix in _list_rotations(rotations, body.dim):
        floor = search.error
        if len(best.scores) == most:
            floor = float(best.scores[-1])
        both = zip(best, search.find_peaks(matrix, floor, most), strict=True)
        best = search.select_distinct(Placements(*map(np.concatenate, both)), 0.5 * gap, most)
    if len(best.scores):
        best = search.climb(best, refine_rotations)
    best = search.select_distinct(best, gap, number)
    return best._replace(translations=best.translations - best.rotations @ centroid)


def _list_rotations(rotations: int | Rotations | Rotates, dim: int) -> Iterable[Floats]:
    """Return matrices (d, d) of rotations.

    They are a number of yaws, rotation cells, a scipy Rotation, or an array of angles or matrices.
    """
    if isinstance(rotations, Rotations | int | np.integer):
        cells = Rotations.of(rotations)
        return cells.make_matrices(cells.centers, dim)
    values = check_finite(as_matrices(rotations), "rotations")
    shape = values.shape[-2:] if values.ndim > 1 else ()
    return [rotation_matrix(value, dim) for value in values.reshape(-1, *shape)]


class _Fields:
    """Fields that fixed balls make: the overlap of one moving ball of each radius, at any place.

    ``targets`` are the fixed balls, in sets with a weight each.
    """

    def __init__(
        self,
        moving: Balls,
        targets: Sequence[Balls],
        weights: Sequence[float],
        bump: Bump,
        tolerance: float,
        most: int,
    ) -> None:
        """Choose a lattice of at most about ``most`` frequencies; compute the spectrum."""
        from scipy.fft import next_fast_len

        fixed = Balls(
            np.concatenate([balls.centers for balls in targets]),
            np.concatenate([balls.radii for balls in targets]),
        )
        self.lattice = choose_lattice(moving, fixed, bump, tolerance, most)
        self.shape = tuple(next_fast_len(count, real=True) for count in self.lattice.counts)
        self.cells_per_metre = self.shape / self.lattice.periods
        self.center = find_center(fixed)
        self.factors = RadialFactors(self.lattice, bump, moving.radii)
        self.spectrum = np.zeros(self.lattice.counts, dtype=np.complex128)
        for balls, weight in zip(targets, weights, strict=True):
            factors = RadialFactors(self.lattice, bump, balls.radii)
            spectrum = factors.spectrum(balls.centers - self.center, SPECTRUM_ACCURACY)
            self.spectrum += weight * spectrum

    def correlate(self, centers: Floats) -> Floats:
        """Return moving balls' summed overlap at all lattice steps.

        ``centers``, shape (k, d), are relative to a point that lies at the fixed balls' center at
        the first step.
        """
        return self._invert(
            self.spectrum * self.factors.spectrum(centers, SPECTRUM_ACCURACY).conj()
        )

    def _invert(self, spectrum: Complexes) -> Floats:
        """Transform a spectrum to a real function on lattices."""
        from scipy.fft import irfftn

        padded = np.zeros(self.shape, dtype=np.complex128)
        # Negative frequencies count from the end.
        padded[np.ix_(*(k.astype(np.intp) for k in self.lattice.indices))] = spectrum
        half = padded[..., : self.shape[-1] // 2 + 1]
        values = irfftn(half, s=self.shape, workers=count_cores())
        return np.asarray(values * self.cells_per_metre.prod())

    @cached_property
    def _splines(self) -> list[NdBSpline]:
        """Spline of each radius's field, at periodic places in cells."""
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
        """Return moving balls' overlaps and derivatives, (n, k, 1 + d).

        ``centers``, shape (n, k, d), are the places of the balls, metres.
        """
        dim = len(self.shape)
        relative = centers - self.center
        places = relative * self.cells_per_metre % self.shape
        orders = np.eye(1 + dim, dtype=np.int64)[:, 1:]  # the value, and each derivative
        sums = np.zeros((*centers.shape[:2], 1 + dim))
        for (members, _), spline in zip(self.factors.groups, self._splines, strict=True):
            for column, order in enumerate(orders):
                sums[:, members, column] = spline(places[:, members], nu=tuple(order))
        sums[..., 1:] *= self.cells_per_metre
        # Splines repeat with the period, but fields do not.
        sums[(np.abs(relative) > 0.5 * self.lattice.periods).any(axis=-1)] = 0.0
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
        balls = round_radii(as_balls(fixed, "fixed"), MAX_RADII)
        sizes = np.atleast_1d(check_finite(radii, "radii"))
        # Only the radii of the moving balls matter, so all stand at the origin.
        moving = as_balls((np.zeros((len(sizes), balls.dim)), sizes), "radii")
        moving = round_radii(moving, MAX_RADII)
        self._radii = moving.radii
        self._fixed = [
            (radius, cKDTree(balls.centers[balls.radii == radius]))
            for radius in np.unique(balls.radii).tolist()
        ]
        limits = tolerance, MAX_OVERLAP_FREQUENCIES
        self._fields = _Fields(moving, [balls], [1.0], check_bump(bump), *limits)

    def __repr__(self) -> str:
        """Return the numbers of balls."""
        fixed = sum(tree.n for _, tree in self._fixed)
        return f"BallPenetration({len(self._radii):,} balls among {fixed:,})"

    def value_and_gradient(self, centers: ArrayLike) -> tuple[Floats, Floats]:
        """Compute the summed overlap and derivatives by centers.

        ``centers``, shape (..., k, d), are in metres. The results have shapes (...) and (..., k,
        d), in square or cubic metres, and that per metre. Raises InputError if the shape is
        another, or a value is not finite.
        """
        points = check_finite(centers, "centers")
        count = len(self._fields.factors.radii)
        dim = len(self._fields.shape)
        if points.ndim < 2 or points.shape[-2:] != (count, dim):
            raise InputError(
                "centers",
                f"has shape {points.shape}",
                f"the last axes must be {count} balls and {dim} coordinates",
            )
        # The value of each ball, and its derivatives.
        sums = self._fields.evaluate(points.reshape(-1, count, dim))
        sums = sums.reshape(*points.shape[:-1], 1 + dim)
        # Splines leave a rest where a ball meets none.
        meets = np.zeros(points.shape[:-1], dtype=np.bool_)
        for radius, tree in self._fixed:
            distances, _ = tree.query(points)
            meets |= distances < radius + self._radii
        sums[~meets] = 0.0
        return sums[..., 0].sum(axis=-1), sums[..., 1:]


class _Search:
    """Search for poses of the centroid of A's balls whose overlap with weighted balls is large.

    The ascent needs no spectrum of A, because it sums fields of the targets at A's balls.
    """

    def __init__(
        self, body: Balls, targets: Sequence[Balls], weights: Sequence[float], bump: Bump
    ) -> None:
        """Round radii, compute fields, and measure how the balls of A spread."""
        self.body = round_radii(body, MAX_RADII, grow=False)
        rounded = [round_radii(balls, MAX_RADII, grow=False) for balls in targets]
        # A lattice refers its tolerance to one ball; the error is that of all balls of A, and what
        # costs more must be more accurate.
        # Error of the scores of a search, over the summed overlaps of A's balls with themselves.
        score_error = 0.01
        tolerance = score_error * len(body.radii) / max(map(abs, weights))
        # Largest number of frequencies of a search, opposite ones counted both.
        self.fields = _Fields(self.body, rounded, weights, bump, tolerance, 2**19)
        volume = float((body.radii**body.dim).sum())
        self.error = score_error * bump.energy(body.dim) * volume
        squares = (body.centers**2).sum(axis=1) + body.radii**2
        self.gyration = math.sqrt(float(squares.mean()))

    def find_peaks(self, matrix: Floats, floor: float, most: int) -> Placements:
        """Find up to ``most`` highest maxima above a score.

        A is rotated by ``matrix``, shape (d, d).
        """
        from scipy.ndimage import maximum_filter

        scores = self.fields.correlate(self.body.centers @ matrix.T)
        is_peak = scores > floor
        if is_peak.any():
            is_peak &= scores == maximum_filter(scores, 3, mode="wrap")
        highest = np.argsort(-scores[is_peak])[:most]
        shares = np.argwhere(is_peak)[highest] / scores.shape  # of the period
        # Take the nearest of all periods.
        steps = (shares - np.round(shares)) * self.fields.lattice.periods
        rotations = np.broadcast_to(matrix, (len(highest), *matrix.shape))
        return Placements(scores[is_peak][highest], steps + self.fields.center, rotations)

    def select_distinct(self, poses: Placements, min_displacement: float, most: int) -> Placements:
        """Select up to ``most`` best poses, ``min_displacement`` apart.

        The displacement is the root mean square over the balls of A.
        """
        placed = (
            self.body.centers @ np.swapaxes(poses.rotations, 1, 2) + poses.translations[:, None]
        )
        chosen: list[int] = []
        for pose in np.argsort(-poses.scores, kind="stable").tolist():
            squares = ((placed[chosen] - placed[pose]) ** 2).sum(axis=2).mean(axis=1)
            if len(chosen) < most and (squares >= min_displacement**2).all():
                chosen.append(pose)
        return Placements(*(column[chosen] for column in poses))

    def climb(self, poses: Placements, turn: bool) -> Placements:
        """Climb to near maxima, also by rotations with ``turn``."""
        from scipy.optimize import minimize

        dim = self.body.dim
        size = dim
        if turn:
            size += 2 * dim - 3
        spacing = float((1.0 / self.fields.cells_per_metre).min())

        def move_poses(x: Floats) -> tuple[Rotation, Placements]:
            """Move all poses by steps; return their turns and the moved poses.

            ``x``, shape (n * size,), has for each pose a translation of A, and then its turn, as
            arcs at its radius of gyration; all in lattice spacings.
            """
            steps = spacing * x.reshape(-1, size)
            # A turn in the plane is one about z.
            vectors = np.pad(steps[:, dim:] / self.gyration, ((0, 0), (3 + dim - size, 0)))
            turns = Rotation.from_rotvec(vectors)
            rotations = turns.as_matrix()[:, :dim, :dim] @ poses.rotations
            return turns, Placements(poses.scores, poses.translations + steps[:, :dim], rotations)

        def evaluate(x: Floats) -> tuple[Floats, Floats]:
            """Return scores after steps x, and derivatives, (n, size)."""
            turns, moved = move_poses(x)
            arms = self.body.centers @ np.swapaxes(moved.rotations, 1, 2)
            sums = self.fields.evaluate(moved.translations[:, None] + arms)
            # The derivative by the center of a ball is a force on it; turns feel its moment.
            forces = sums[..., 1:]
            margins = (0, 0), (0, 0), (0, 3 - dim)
            moments = np.cross(np.pad(arms, margins), np.pad(forces, margins)).sum(axis=1)
            # The axes of a rotation vector turn with it, on average by half.
            twists = (turns**-0.5).apply(moments) / self.gyration
            slopes = np.column_stack([forces.sum(axis=1), twists[:, 3 + dim - size :]])
            return sums[..., 0].sum(axis=1), spacing * slopes

        def descend(x: Floats) -> tuple[float, Floats]:
            """Return the negated, scaled scores and their derivatives."""
            scores, slopes = evaluate(x)
            return -scores.sum() / self.error, -slopes.ravel() / self.error

        start = np.zeros(len(poses.scores) * size)
        # Relative rise of the summed scores at which an ascent ends.
        found = minimize(descend, start, jac=True, method="L-BFGS-B", tol=1e-5)
        return move_poses(found.x)[1]._replace(scores=evaluate(found.x)[0])

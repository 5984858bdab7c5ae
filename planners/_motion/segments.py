"""Straight lines, arcs and cubic curves of a path, with their proofs."""

from __future__ import annotations

import itertools
from typing import Final, NamedTuple, TypeGuard

import numpy as np

from cspace import Rotations, Space
from cspace.inside import (
    Bools,
    ConfigurationMap,
    ConfigurationSpace,
    Floats,
    Ints,
    cells_of,
    number_parts,
    tubes_are_free,
)
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import read_bounds

CUTS: Final = 4
"""Number of pieces into which an unproven piece is cut."""

MAX_PIECES: Final = 1000
"""Largest number of pieces into which a curve is cut at first."""

ROUNDING: Final = 1e-12
"""Growth of bounds for rounding: radians, metres of joints, or relative rates."""

MIN_AHEAD: Final = 1e-30
"""Smallest rate along the mean direction of a curve at which its direction has bounds."""

UNBOUNDED: Final = 1e100
"""Stands for the bound of an unbounded derivative."""

MAX_EDGE_TURN: Final = 3.0
"""Largest turn of an edge that is proven as a whole, radians; at pi rounding decides its side."""


class Segments(NamedTuple):
    """The m lines, arcs and cubic curves of a path.

    A curve is a polynomial in each coordinate. The yaw of a robot that drives is the direction of
    its curve instead.
    """

    starts: Floats  # (m, size), configurations
    rates: Floats  # (m, k), translation and rotation vector, or joints, per unit of length
    bends: Floats  # (m, k), second derivatives at the start
    twists: Floats  # (m, k), third derivatives
    curvatures: Floats  # (m,), radians per unit of length by which arcs turn left
    drives: Ints  # (m,), 1 if the yaw is the direction of a curve, -1 in reverse, otherwise 0
    lengths: Floats  # (m,)
    ends: Floats  # (m, size), configurations

    def select(self, index: Ints | Bools | list[int] | slice) -> Segments:
        """Return some of the segments."""
        if isinstance(index, np.ndarray) and index.dtype == np.int64:
            # numpy takes rows by numbers in a fifth of the time.
            return Segments._make(column.take(index, axis=0) for column in self)
        return Segments._make(column[index] for column in self)

    @property
    def is_curve(self) -> Bools:
        """Whether each segment is a cubic curve, shape (m,)."""
        return np.asarray(self.bends.any(axis=1) | self.twists.any(axis=1) | (self.drives != 0))


def make_lines(starts: Floats, rates: Floats, lengths: Floats, ends: Floats) -> Segments:
    """Make straight segments."""
    none = np.zeros(len(lengths))
    zeros = np.zeros(rates.shape)
    drives = np.zeros(len(lengths), dtype=np.int64)
    return Segments(starts, rates, zeros, zeros, none, drives, lengths, ends)


def join_segments(parts: list[Segments]) -> Segments:
    """Join segments that follow each other."""
    return Segments._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def measure_sizes(rows: Floats, rotations: Rotations) -> Floats:
    """Return the largest coordinates of a path, with 1 radian for rotations.

    The shape is (k,). The translation of a robot that rotates has one size, because its axes mix.
    """
    dim = rows.shape[1] - len(rotations.names)
    sizes = np.abs(rows[:, :dim]).max(axis=0)
    if not rotations.names:
        return np.asarray(sizes)
    angles = rotations.steps_between(rows[:1], rows[:1])[0, dim:]
    return np.concatenate([np.full(dim, sizes.max()), np.ones(len(angles))])


def align_quaternions(rows: Floats, rotations: Rotations) -> Floats:
    """Choose the signs of quaternions so that they continue each other."""
    if "qw" not in rotations.names:
        return rows
    # Rotations take the shorter way, at whose end the next quaternion or its negative lies.
    aligned = rows.copy()
    quaternions = aligned[:, -4:]
    cosines = (quaternions[:-1] * quaternions[1:]).sum(axis=1)
    signs = np.where(cosines < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(signs)[:, np.newaxis]
    return aligned


def place_along(
    segments: Segments, rotations: Rotations, s: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return configurations at lengths along segments, and their derivatives.

    ``s``, shape (m,), are lengths along the segments. The derivatives by the length are
    translations and rotation vectors, shape (m, k).
    """
    length = s[:, np.newaxis]
    bends = segments.bends
    twists = segments.twists
    steps = length * (segments.rates + length * (bends / 2.0 + length * twists / 6.0))
    first = segments.rates + length * (bends + length * twists / 2.0)
    second = bends + length * twists
    arcs = np.flatnonzero(segments.curvatures)
    if len(arcs):
        curvatures = segments.curvatures[arcs]
        half = 0.5 * curvatures * s[arcs]
        # The chord of an arc, over the arc, is the sinc of half its angle.
        steps[arcs, :2] = turn_left(steps[arcs, :2], half) * np.sinc(half / np.pi)[:, np.newaxis]
        first[arcs, :2] = turn_left(first[arcs, :2], 2.0 * half)
        sideways = np.column_stack([-first[arcs, 1], first[arcs, 0]])
        second[arcs, :2] = curvatures[:, np.newaxis] * sideways
    q = rotations.add_steps(segments.starts, steps)
    driven = np.flatnonzero(segments.drives)
    if len(driven):
        signs = segments.drives[driven, np.newaxis]
        x, y = first[driven, :2].T
        ahead = signs * first[driven, :2]
        q[driven, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
        # Derivatives of the angle of (x, y), from its first, second and third derivatives.
        squares = x**2 + y**2
        ddx, ddy = second[driven, :2].T
        dddx, dddy = twists[driven, :2].T
        turn_rates = (x * ddy - y * ddx) / squares
        first[driven, 2] = turn_rates
        second[driven, 2] = (x * dddy - y * dddx) / squares
        second[driven, 2] -= 2.0 * turn_rates * (x * ddx + y * ddy) / squares
    return q, first, second


def cut_segments(segments: Segments, rotations: Rotations, begin: float, end: float) -> Segments:
    """Cut the first segment at ``begin``, and the last at ``end``."""
    cut = Segments._make(column.copy() for column in segments)
    if end < (1.0 - ROUNDING) * cut.lengths[-1]:
        cut.lengths[-1] = end
        cut.ends[-1:] = place_along(cut.select([-1]), rotations, np.array([end]))[0]
    if begin > 0.0:
        q, rates, _ = place_along(cut.select([0]), rotations, np.array([begin]))
        if cut.drives[0]:
            rates[:, 2:] = cut.rates[:1, 2:]
        cut.starts[:1] = q
        cut.rates[:1] = rates
        cut.bends[0] += begin * cut.twists[0]
        cut.lengths[0] -= begin
    return cut


def scale_segments(segments: Segments, factor: float) -> Segments:
    """Return the same segments by a new unit of length."""
    return segments._replace(
        rates=factor * segments.rates,
        bends=factor**2 * segments.bends,
        twists=factor**3 * segments.twists,
        curvatures=factor * segments.curvatures,
        lengths=segments.lengths / factor,
    )


def bound_derivatives(segments: Segments, begins: Floats, widths: Floats) -> tuple[Floats, Floats]:
    """Bound the first and second derivatives on intervals, shape (m, k).

    A polynomial of degree 2 or 3 deviates from its chord by at most 1/8 of the squared width times
    its largest second derivative. The tangent of an arc gives its bounds.
    """
    s = np.array([begins, begins + widths])[:, :, np.newaxis]
    both_bends = segments.bends + s * segments.twists
    both_rates = segments.rates + 0.5 * s * (segments.bends + both_bends)
    eighths = widths[:, np.newaxis] ** 2 / 8.0
    rates = np.abs(both_rates).max(axis=0) + eighths * np.abs(segments.twists)
    bends = np.abs(both_bends).max(axis=0)
    driven = np.flatnonzero(segments.drives)
    if not len(driven):
        return rates, bends
    # The yaw rate is c / s, with the cross product c of the first and second derivative, and the
    # square s of the first. So its derivative is c' / s - c s' / s^2.
    twists = segments.twists[driven, :2]
    both_rates, both_bends = both_rates[:, driven, :2], both_bends[:, driven, :2]
    eighths = eighths[driven, 0]
    twist = np.linalg.norm(twists, axis=1)
    bend = np.linalg.norm(both_bends, axis=2).max(axis=0)
    crosses = np.abs(_cross(both_rates, both_bends)).max(axis=0)
    crosses += eighths * np.abs(_cross(both_bends[0], twists))
    cross_slopes = np.abs(_cross(both_rates, twists)).max(axis=0)
    half_slopes = np.abs((both_rates * both_bends).sum(axis=2)).max(axis=0)
    half_slopes += 3.0 * eighths * bend * twist
    # The first derivative is at least as long as its part along the mean direction.
    mean = both_rates.sum(axis=0)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), MIN_AHEAD)
    ahead = (both_rates * mean).sum(axis=2).min(axis=0) - eighths * twist
    squares = np.maximum(ahead, MIN_AHEAD) ** 2
    yaw_bends = cross_slopes / squares + 2.0 * crosses * half_slopes / squares**2
    rates[driven, 2] = np.where(ahead > MIN_AHEAD, crosses / squares, UNBOUNDED)
    bends[driven, 2] = np.where(ahead > MIN_AHEAD, yaw_bends, UNBOUNDED)
    return rates, bends


def _cross(first: Floats, second: Floats) -> Floats:
    """Return the cross products of plane vectors, shape (...)."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def turn_left(vectors: Floats, angles: Floats) -> Floats:
    """Turn plane vectors, shape (n, 2), left by angles."""
    cos = np.cos(angles)
    sin = np.sin(angles)
    x, y = vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def can_prove_curves(space: Space) -> TypeGuard[ConfigurationSpace]:
    """Return True for maps and arms, which prove tubes around motions."""
    return isinstance(space, ConfigurationSpace)


def prove_segments(space: Space, segments: Segments) -> Bools:
    """Return whether segments are proven free, shape (m,).

    Straight ones are proven as edges, and curves piece by piece, on a map by its cells alone.
    """
    is_curve = segments.is_curve
    proven = np.zeros(len(is_curve), dtype=np.bool_)
    if not is_curve.all():
        proven[~is_curve] = _prove_lines(space, segments.select(~is_curve))
    if is_curve.any() and can_prove_curves(space):
        proven[is_curve] = _prove_curves(space, segments.select(is_curve))
    return proven


def _prove_lines(space: Space, lines: Segments) -> Bools:
    """Return whether straight segments are proven free, shape (m,)."""
    steps = lines.rates * lines.lengths[:, np.newaxis]
    first_angle = space.dim if space.has_poses else steps.shape[1]
    turned = np.abs(steps[:, first_angle:]).max(axis=1, initial=0.0)
    middles = place_along(lines, space.rotations, 0.5 * lines.lengths)[0]
    check = LocalPlanner(space).edge_checker()
    proven = np.zeros(len(turned), dtype=np.bool_)
    for k, turn in enumerate(turned.tolist()):
        rows = [lines.starts[k].tolist(), lines.ends[k].tolist()]
        if turn > MAX_EDGE_TURN:
            # Edges turn the shorter way, so a large turn is proven in two parts.
            rows.insert(1, middles[k].tolist())
        proven[k] = all(check(*first, *last) for first, last in itertools.pairwise(rows))
    return proven


def _prove_curves(space: ConfigurationSpace, curves: Segments) -> Bools:
    """Return whether curves are proven free, shape (m,).

    Each is cut into pieces. Unproven pieces are cut again up to twice, unless a point of
    their curve is not free. The proof of a curve does not depend on other curves.
    """
    counts = np.ones(len(curves.lengths), dtype=np.int64)
    if isinstance(space, ConfigurationMap):
        rates, _ = bound_derivatives(curves, 0.0 * curves.lengths, curves.lengths)
        moved = rates * curves.lengths[:, np.newaxis]
        # The first tubes are at most four cells long along each axis, and turn by 0.4 rad.
        parts = moved[:, : space.dim].max(axis=1) / (4.0 * 2.0 * space.resolution)
        turns = np.linalg.norm(moved[:, space.dim :], axis=1) / 0.4
        counts += np.minimum(np.maximum(parts, turns), MAX_PIECES).astype(np.int64)
    owners, numbers = number_parts(counts)
    widths = (curves.lengths / counts)[owners]
    begins = numbers * widths
    proven = np.ones(len(counts), dtype=np.bool_)
    left = ~_test_tubes(space, curves.select(owners), begins, widths)
    for _ in range(2):
        if not left.any():
            break
        owners, widths, begins = owners[left], widths[left], begins[left]
        middles = begins + 0.5 * widths
        count = len(owners)
        parts = np.repeat(owners, CUTS)
        widths = np.repeat(widths, CUTS) / CUTS
        begins = np.repeat(begins, CUTS) + np.arange(len(parts)) % CUTS * widths
        # One call tests the middles, as tubes without length, and the parts.
        is_free = _test_tubes(
            space,
            curves.select(np.append(owners, parts)),
            np.append(middles, begins),
            np.append(np.zeros(count), widths),
        )
        proven[owners[~is_free[:count]]] = False
        owners = parts
        left = ~is_free[count:] & proven[parts]
    proven[owners[left]] = False
    return proven


def _test_tubes(
    space: ConfigurationSpace, curves: Segments, begins: Floats, widths: Floats
) -> Bools:
    """Return whether pieces lie in free tubes around chords, shape (n,).

    A coordinate strays from even motion along the chord by at most 1/8 of the squared width times
    its largest second derivative. A rotation about any axis stays within half the width times its
    largest rate of the middle.
    """
    rotations = space.rotations
    dim = space.dim
    firsts, _, _ = place_along(curves, rotations, begins)
    lasts, _, _ = place_along(curves, rotations, begins + widths)
    rates, bends = bound_derivatives(curves, begins, widths)
    radii = bends * widths[:, np.newaxis] ** 2 / 8.0
    turns = np.linalg.norm(rates[:, dim:], axis=1) * widths
    if len(rotations.names) == 4:
        middles, _, _ = place_along(curves, rotations, begins + 0.5 * widths)
        firsts[:, dim:] = lasts[:, dim:] = middles[:, dim:]
        radii = np.column_stack([radii[:, :dim], 0.5 * turns])
    # A chord turns the shorter way.
    fits: Bools = turns <= MAX_EDGE_TURN
    if not isinstance(space, ConfigurationMap):
        # Joints keep their limits.
        lower, upper = read_bounds(space)
        lowest = np.minimum(firsts, lasts) - radii + ROUNDING
        highest = np.maximum(firsts, lasts) + radii - ROUNDING
        is_inside = (lowest >= lower) & (highest <= upper) | np.array(space.is_periodic)
        fits &= is_inside.all(axis=1)
    space = cells_of(space)  # the geometry is slow
    fits[fits] = tubes_are_free(space, firsts[fits], lasts[fits], radii[fits] + ROUNDING)
    return fits

"""Fastest motions along segments, within limits of velocity and acceleration.

The squared speed along a path is limited at each point by the velocities, and its slope, twice the
acceleration along the path, by the accelerations. A pass back finds the largest squared speeds from
which the robot can still slow down in time, and a pass ahead the largest ones that it reaches
(J. E. Bobrow, S. Dubowsky and J. S. Gibson, 1985; H. Pham and Q.-C. Pham, "A new approach to
time-optimal path parameterization based on reachability analysis", 2018).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace._rotations import Rotations
from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.compiling import internal, kernel
from planners._segments import Segments, place_along
from planners._smoothing import LimitRates, measure_sizes

INTERVALS_PER_CURVE: Final = 2
"""Number of constant accelerations along each curve."""

HALVINGS = 40
"""Number of halvings in the search for the largest squared speed."""

MIN_COEFFICIENT = 1e-300
"""Smallest squared acceleration that counts, relative to the limit."""

MIN_RAMP_SHARE: Final = 1e-6
"""Smallest share of the duration in which the robot reaches full speed. Numbers for times resolve
no larger accelerations."""

MIN_PHASE_SHARE: Final = 1e-12
"""Smallest share of the duration that a phase takes; shorter ones are rounding errors, and skipped.
"""

MIN_SPEED: Final = 1e-150
"""Smallest speed on a segment, which makes a path with such a curve slower than one without."""

PARTS_PER_INTERVAL: Final = 2
"""Number of parts of an interval in which the limits are bounded each."""

DEGREE: Final = 8
"""Degree of the polynomials that bound rates in a part."""

ORDERS: Final = np.arange(DEGREE + 1)
"""Numbers of their Bernstein coefficients."""

PART_SHARES: Final = ORDERS[:, np.newaxis] / DEGREE
"""Shares of a part at which rates are known."""

TO_BERNSTEIN: Final = np.linalg.inv(
    np.poly([-1.0] * DEGREE) * PART_SHARES**ORDERS * (1.0 - PART_SHARES) ** ORDERS[::-1]
).astype(np.float64)
"""Matrix from the values of a polynomial at these shares to its Bernstein coefficients.

The coefficients of ``(x + 1)^n`` are the binomials.
"""

MIN_WEIGHT: Final = 1e-9
"""Smallest Bernstein coefficient of a divisor, relative to the divisor, for rounding."""

MAX_RATE_STEP: Final = 1e-8
"""Largest jump of a rate between two segments without a stop, relative to the rate."""

MIN_RATE_STEP: Final = 1e-10
"""Smallest jump of a rate, relative to full speed; smaller ones are rounding errors."""

MAX_ERROR: Final = 1e-9
"""Largest relative gap between the parts of a motion, and excess over its limits, for rounding."""

MAX_SPEED_GAP: Final = 1e-5
"""Largest jump of the speed between phases, relative to the largest: that of skipped phases."""


class Phases(NamedTuple):
    """Parts of a motion with constant acceleration.

    Each is on one segment; in the last part the robot rests.
    """

    times: Floats  # seconds at which they start
    segments: Ints
    positions: Floats  # length along the segment at that time, and its derivatives by time
    speeds: Floats
    accelerations: Floats


class MotionBounds(NamedTuple):
    """Limits of a motion."""

    velocity: LimitRates
    acceleration: LimitRates
    lateral: float  # largest acceleration across the direction of driving
    gap: float  # largest relative gap between segments

    def limit_ramps(self, segments: Segments) -> MotionBounds:
        """Return bounds without accelerations that times of a motion do not resolve."""
        velocity, acceleration = self.velocity, self.acceleration
        lengths = segments.lengths
        ramps = velocity.largest(segments.rates) / acceleration.largest(segments.rates)
        shortest = MIN_RAMP_SHARE * (lengths + 2.0 * np.sqrt(lengths * ramps)).sum()
        if shortest == 0.0:
            return self
        speeds = velocity.linear if acceleration.linear.ndim else velocity.linear.max()
        linear = np.minimum(acceleration.linear, speeds / shortest)
        angular = acceleration.angular
        if angular is not None and velocity.angular is not None:
            angular = min(angular, velocity.angular / shortest)
        return self._replace(acceleration=LimitRates(linear, angular, acceleration.dim))


def find_phases(
    segments: Segments, rotations: Rotations, passes: Bools, bounds: MotionBounds
) -> Phases:
    """Return the fastest motion along segments, from rest to rest.

    On curves, it obeys its limits at the ends of intervals only; see :func:`obey_limits`.
    ``passes``, shape (m - 1,), is True if no stop is needed between two segments. A straight
    segment or an arc has one largest speed and acceleration, so it is accelerated, driven and
    slowed down as a whole. A curve is cut into intervals of constant acceleration.
    """
    is_curve = segments.is_curve
    counts = np.where(is_curve, INTERVALS_PER_CURVE, 1)
    owners = np.repeat(np.arange(len(counts)), counts)
    lengths = segments.lengths[owners] / counts[owners]
    begins = (np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)) * lengths
    parts = segments.select(owners)
    ends = [place_along(parts, rotations, s)[1:] for s in (begins, begins + lengths)]
    is_curved = is_curve[owners]
    turns_ahead = _turns_ahead(parts)
    caps = []
    terms = []
    for share, (first, second) in zip((0.0, 2.0), ends, strict=True):
        bent = np.where(is_curved[:, np.newaxis], second, 0.0)
        caps.append(bounds.velocity.largest(first) ** 2)
        # The acceleration is first u + bent x, where x is the squared speed here, and the one at
        # the start plus 2 u times the length at the end.
        along = first + share * lengths[:, np.newaxis] * bent
        pairs = (along, along), (along, bent), (bent, bent)
        terms.append(np.stack([bounds.acceleration.multiply(*pair) for pair in pairs], axis=2))
        if turns_ahead.any():
            sideways = np.abs(first[:, 2]) * np.linalg.norm(first[:, :2], axis=1)
            with np.errstate(divide="ignore"):
                largest = np.where(turns_ahead, bounds.lateral / sideways, np.inf)
            caps[-1] = np.minimum(caps[-1], largest)
    # A curve rests where it has no direction.
    begin_caps, end_caps = (np.where(np.isinf(cap), 0.0, cap) for cap in caps)
    may_pass = np.ones(len(owners) - 1, dtype=np.bool_)
    may_pass[np.cumsum(counts)[:-1] - 1] = passes
    nodes = np.zeros(len(owners) + 1)
    nodes[1:-1] = np.where(may_pass, np.minimum(end_caps[:-1], begin_caps[1:]), 0.0)
    bound_squares(lengths, np.concatenate(terms, axis=1), is_curved, nodes)
    gains = bounds.acceleration.largest(ends[0][0])
    return _fill_phases(owners, begins, lengths, is_curved, begin_caps, gains, nodes)


def obey_limits(
    segments: Segments, rotations: Rotations, phases: Phases, bounds: MotionBounds
) -> Phases:
    """Slow a motion down to its limits at every instant."""
    excess = _find_excess(segments, rotations, phases, bounds)
    return slow_down(phases, max(excess - MAX_ERROR, 1.0))


def _turns_ahead(segments: Segments) -> Bools:
    """Return True for arcs, and for curves along which a robot drives."""
    return np.asarray((segments.drives != 0) | (segments.curvatures != 0.0))


@kernel
def bound_squares(lengths: Floats, terms: Floats, is_curved: Bools, squares: Floats) -> None:
    """Lower squared speeds to the largest ones that the accelerations allow.

    Arrays of n intervals, in which the acceleration u along the path is constant:

    * ``lengths``, shape (n,)
    * ``terms``, shape (n, c, 3): coefficients p, q, r of constraints
      ``p u^2 + 2 q u x + r x^2 <= 1``, where x is the squared speed at the start
    * ``is_curved``, shape (n,): False if q and r are zero
    * ``squares``, shape (n + 1,): the largest squared speeds by the velocities, and the result
    """
    n = len(lengths)
    for k in range(n - 1, -1, -1):
        squares[k] = find_largest(lengths[k], terms[k], is_curved[k], squares[k], squares[k + 1])
    for k in range(n):
        _, highest = find_accelerations(terms[k], squares[k])
        reached = squares[k] + 2.0 * lengths[k] * highest
        squares[k + 1] = max(min(squares[k + 1], reached), 0.0)


@internal
def find_largest(length: float, terms: Floats, is_curved: bool, cap: float, end: float) -> float:
    """Return the largest squared speed up to ``cap`` from which the robot slows down to ``end``."""
    if not is_curved:
        lowest, _ = find_accelerations(terms, 0.0)
        return min(cap, end - 2.0 * length * lowest)
    if can_slow_down(length, terms, cap, end):
        return cap
    low = 0.0
    high = cap
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if can_slow_down(length, terms, middle, end):
            low = middle
        else:
            high = middle
    return low


@internal
def can_slow_down(length: float, terms: Floats, square: float, end: float) -> bool:
    """Return True if an allowed acceleration leads from a squared speed to at most another."""
    lowest, highest = find_accelerations(terms, square)
    most = 0.5 * (end - square) / length
    least = -0.5 * square / length
    return lowest <= min(highest, most) and highest >= least


@internal
def find_accelerations(terms: Floats, square: float) -> tuple[float, float]:
    """Return the least and the largest acceleration at a squared speed; least > largest if none."""
    lowest = -np.inf
    highest = np.inf
    for k in range(len(terms)):
        p = terms[k, 0]
        q = terms[k, 1] * square
        r = terms[k, 2] * square * square
        if p <= MIN_COEFFICIENT:
            if r > 1.0:
                return 1.0, -1.0
            continue
        discriminant = q * q - p * (r - 1.0)
        if discriminant < 0.0:
            return 1.0, -1.0
        root = np.sqrt(discriminant)
        lowest = max(lowest, (-q - root) / p)
        highest = min(highest, (-q + root) / p)
    return lowest, highest


def _fill_phases(
    owners: Ints,
    begins: Floats,
    lengths: Floats,
    is_curved: Bools,
    caps: Floats,
    gains: Floats,
    squares: Floats,
) -> Phases:
    """Return the phases between squared speeds at the ends of n intervals, shape (n + 1,).

    A straight interval has three: it is accelerated, driven at the largest speed if that is
    reached, and slowed down. ``caps`` and ``gains`` are its largest squared speed and acceleration.
    """
    before = squares[:-1]
    after = squares[1:]
    # Rounding must not put the peak below the speed at an end.
    peaks = np.minimum(caps, 0.5 * (before + after) + gains * lengths)
    peaks = np.maximum(peaks, np.maximum(before, after))
    up = (peaks - before) / (2.0 * gains)
    down = (peaks - after) / (2.0 * gains)
    fastest = np.sqrt(peaks)
    first = np.sqrt(before)
    last = np.sqrt(after)
    cruise = np.where(peaks >= caps, np.maximum(lengths - up - down, 0.0), 0.0)
    even = np.where(is_curved, 2.0 * lengths / np.maximum(first + last, MIN_SPEED), 0.0)
    zeros = np.zeros(len(lengths))
    changes = 0.5 * (after - before) / np.where(is_curved, lengths, 1.0)
    columns = (
        (
            np.where(is_curved, even, (fastest - first) / gains),
            np.where(is_curved, 0.0, cruise / np.maximum(fastest, MIN_SPEED)),
            np.where(is_curved, 0.0, (fastest - last) / gains),
        ),
        (owners, owners, owners),
        (begins, begins + up, begins + lengths - down),
        (first, fastest, fastest),
        (np.where(is_curved, changes, gains), zeros, -gains),
    )
    table = np.array(columns).transpose(2, 1, 0).reshape(-1, 5)
    table = table[table[:, 0] > MIN_PHASE_SHARE * table[:, 0].sum()]
    rest = (0.0, owners[-1], begins[-1] + lengths[-1], 0.0, 0.0)
    durations, segments, *motion = np.vstack([table, rest]).T
    times = np.cumsum(durations) - durations
    return Phases(times, segments.astype(np.int64), *motion)


def _find_excess(
    segments: Segments, rotations: Rotations, phases: Phases, bounds: MotionBounds
) -> float:
    """Return the factor by which a motion must be slower to obey its limits at every instant.

    The squared speed is linear in the length. So accelerations, squared velocities, and the squared
    acceleration across the direction of driving are polynomials in the length. The rates of a
    direction of driving are such, too, over a power of the squared length of the derivative.
    """
    durations = np.diff(phases.times)
    moved = durations * (phases.speeds[:-1] + 0.5 * durations * phases.accelerations[:-1])
    shares = (PART_SHARES + np.arange(PARTS_PER_INTERVAL)) / PARTS_PER_INTERVAL
    rows = np.tile(np.arange(len(moved)), shares.size)
    passed = np.outer(shares, moved).reshape(-1, 1)
    parts = segments.select(phases.segments[rows])
    turns_ahead = _turns_ahead(parts)[:, np.newaxis]
    # The limits along an arc are those along its tangent.
    parts = parts._replace(curvatures=np.zeros(len(rows)))
    _, first, second = place_along(parts, rotations, phases.positions[rows] + passed[:, 0])
    accelerations = phases.accelerations[rows, np.newaxis]
    squares = phases.speeds[rows, np.newaxis] ** 2 + 2.0 * accelerations * passed
    changes = first * accelerations + second * squares
    velocities = bounds.velocity.multiply(first, first) * squares
    metres = np.ones_like(passed)
    excess = [1.0]
    if turns_ahead.any():
        metres = (first[:, :2] ** 2).sum(axis=1, keepdims=True)
        sideways = turns_ahead * (first[:, 2:] * squares) ** 2 * metres
        metres = np.where(parts.drives[:, np.newaxis] != 0, metres, 1.0)
        excess.append(np.sqrt(_bound(sideways, metres).max()) / bounds.lateral)
    weights = metres**2
    excess.append(_bound(velocities, weights).max(initial=0.0))
    shares_used = bounds.acceleration.shares(_bound(changes, weights))
    excess.append(shares_used.max(initial=0.0))
    return float(np.sqrt(np.max(excess)))


def _bound(values: Floats, weights: Floats) -> Floats:
    """Return rows whose convex hulls contain the values everywhere, from values at the shares.

    A polynomial stays in the hull of its Bernstein coefficients. The last column is a polynomial
    over the weights, and stays in the hull of their quotients if the weights' are positive.
    """
    weighted = np.column_stack([values[:, :-1], values[:, -1:] * weights, weights])
    rows = (TO_BERNSTEIN @ weighted.reshape(DEGREE + 1, -1)).reshape(weighted.shape)
    scales = rows[:, -1]
    largest = weights.reshape(DEGREE + 1, -1).max(axis=0)
    unsafe = scales <= np.tile(MIN_WEIGHT * largest, DEGREE + 1)
    rows[:, -2] /= scales
    rows[unsafe, -2] = np.inf
    return rows[:, :-1]


def slow_down(phases: Phases, factor: float) -> Phases:
    """Slow a motion evenly by a factor."""
    return Phases(
        phases.times * factor,
        phases.segments,
        phases.positions,
        phases.speeds / factor,
        phases.accelerations / factor**2,
    )


def find_passes(segments: Segments, rotations: Rotations, bounds: MotionBounds) -> Bools:
    """Return whether the rates continue from each segment to the next, shape (m - 1,)."""
    ends = place_along(segments, rotations, segments.lengths)[1][:-1]
    begins = place_along(segments, rotations, np.zeros(len(segments.lengths)))[1][1:]
    turn_rate = bounds.velocity.angular or float(np.abs(segments.curvatures).max()) or 1.0
    # A yaw rate without a limit of acceleration may jump.
    angular = None if bounds.acceleration.angular is None else turn_rate
    full_speed = bounds.velocity._replace(angular=angular)
    jumps = full_speed.shares(ends - begins)
    largest = full_speed.shares(np.maximum(np.abs(ends), np.abs(begins)))
    are_small = jumps <= max(MAX_RATE_STEP, bounds.gap) * largest + MIN_RATE_STEP
    return np.asarray(are_small.all(axis=1))


def is_motion(
    rows: Floats,
    segments: Segments,
    rotations: Rotations,
    passes: Bools,
    phases: Phases,
    bounds: MotionBounds,
) -> bool:
    """Return True if phases move along a path from its start to its goal, from rest to rest.

    ``rows`` begin and end the path. Other arguments are as for :func:`find_phases`. Comparisons are
    False for NaN.
    """
    ends, _, _ = place_along(segments, rotations, segments.lengths)
    before = np.concatenate([rows[:1], ends])
    after = np.concatenate([segments.starts, rows[-1:]])
    gaps = np.abs(rotations._steps_between(before, after))
    durations = np.diff(phases.times)
    changes = durations * phases.accelerations[:-1]
    moved = durations * (phases.speeds[:-1] + 0.5 * changes)
    total = segments.lengths.sum()
    begins = (np.cumsum(segments.lengths) - segments.lengths)[phases.segments] + phases.positions
    slips = np.diff(begins, prepend=0.0, append=total)
    slips[1:-1] -= moved
    jumps = np.diff(phases.speeds) - changes
    stops = np.cumsum(np.append(False, ~passes))
    is_stop = np.diff(stops[phases.segments], prepend=-1) > 0
    is_stop[-1] = True
    return bool(
        (gaps <= bounds.gap * measure_sizes(before, rotations)).all()
        and (durations > 0.0).all()
        and (np.abs(slips) <= MAX_ERROR * total).all()
        and (np.abs(jumps) <= MAX_SPEED_GAP * phases.speeds.max()).all()
        and not phases.speeds[is_stop].any()
    )

"""Fastest motions along segments, within limits of velocity and acceleration.

The squared speed along a path is limited at each point by the velocities, and its slope, twice the
acceleration along the path, by the accelerations. A pass back finds the largest squared speeds from
which the robot can still slow down in time, and a pass ahead the largest squared speeds that it
reaches (J. E. Bobrow, S. Dubowsky and J. S. Gibson, 1985; H. Pham and Q.-C. Pham, "A new approach
to time-optimal path parameterization based on reachability analysis", 2018).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace import Rotations
from cspace.inside import Bools, Floats, Ints, internal, kernel, number_parts
from planners._motion.segments import Segments, bound_derivatives, measure_sizes, place_along
from planners._motion.speed_limits import PlacedLimits, Stretches

INTERVALS_PER_CURVE: Final = 4
"""Number of constant accelerations along each curve."""

ROOT_STEPS: Final = 60
"""Number of halvings that find a time."""

MIN_RAMP_SHARE: Final = 1e-6
"""Smallest share of the duration in which the robot reaches full speed. Numbers for times resolve
no larger accelerations."""

MIN_PHASE_SHARE: Final = 1e-12
"""Smallest share of the duration that a phase takes; shorter ones are rounding errors, and skipped.
"""

MIN_SPEED: Final = 1e-150
"""Smallest speed on a segment; a path with such a curve is slower than one without."""

MAX_RATE_STEP: Final = 1e-8
"""Largest jump of a rate between two segments without a stop, relative to the rate."""

MIN_RATE_STEP: Final = 1e-10
"""Smallest jump of a rate, relative to full speed; smaller ones are rounding errors."""

MAX_ERROR: Final = 1e-9
"""Largest relative gap between the parts of a motion by rounding."""

MAX_EXCESS: Final = 1e-6
"""Largest relative excess over a limit by rounding."""

MAX_GAIN_GAP: Final = 1e-6
"""Largest jump of the acceleration between phases with limited jerk, relative to the largest
acceleration."""

MAX_SPEED_GAP: Final = 1e-5
"""Largest jump of the speed between phases, left by skipped phases, relative to the largest
speed."""


class Phases(NamedTuple):
    """Parts of a motion with constant jerk; it is zero if jerk has no limit.

    Each is on one segment; in the last phase the robot rests.
    """

    times: Floats  # seconds at which they start
    segments: Ints
    positions: Floats  # length along the segment at the start, and its derivatives by time
    speeds: Floats
    accelerations: Floats
    jerks: Floats

    @property
    def durations(self) -> Floats:
        """Durations of all phases except the rest, seconds."""
        return self.times[1:] - self.times[:-1]

    def at(self, numbers: Ints | slice, elapsed: Floats) -> tuple[Floats, Floats, Floats]:
        """Return lengths, speeds and accelerations at seconds after phases' starts."""
        speeds = self.speeds[numbers]
        accelerations = self.accelerations[numbers]
        jerks = self.jerks[numbers] * elapsed
        mean_speeds = speeds + elapsed * (0.5 * accelerations + jerks / 6.0)
        lengths = self.positions[numbers] + elapsed * mean_speeds
        return lengths, speeds + elapsed * (accelerations + 0.5 * jerks), accelerations + jerks

    def peaks(self) -> Floats:
        """Return the largest speeds of phases except the rest."""
        _, end_speeds, end_gains = self.ends()
        speeds = np.maximum(self.speeds[:-1], end_speeds)
        gains, jerks = self.accelerations[:-1], self.jerks[:-1]
        # Between the ends, the speed is largest at zero acceleration.
        turns = gains * end_gains < 0.0
        inner = self.speeds[:-1] - 0.5 * gains**2 / np.where(turns, jerks, 1.0)
        return np.asarray(np.maximum(speeds, np.where(turns, inner, 0.0)))

    def ends(self) -> tuple[Floats, Floats, Floats]:
        """Return lengths, speeds and accelerations at ends of phases.

        The rest, without an end, is left out.
        """
        return self.at(slice(-1), self.durations)


def cut_phases(phases: Phases, t: float) -> Phases:
    """Cut phases at a time."""
    first = int(np.searchsorted(phases.times, t, side="right")) - 1
    cut = Phases._make(column[first:].copy() for column in phases)
    place, speed, gain = phases.at(np.array([first]), np.array([t - phases.times[first]]))
    cut.positions[0], cut.speeds[0], cut.accelerations[0] = place[0], speed[0], gain[0]
    cut.times[0] = t
    return cut._replace(times=cut.times - t)


def cut_at_rest(phases: Phases) -> Phases:
    """Cut phases of a robot in motion at its next rest."""
    rests = np.flatnonzero(phases.speeds[1:] == 0.0)
    cut = Phases._make(column[: 2 + rests[0]].copy() for column in phases)
    if cut.segments[-1] != cut.segments[-2]:  # it rests at the end of a segment
        cut.segments[-1] = cut.segments[-2]
        cut.positions[-1] = cut.ends()[0][-1]
    cut.accelerations[-1] = cut.jerks[-1] = 0.0
    return cut


class LimitRates(NamedTuple):
    """Limits of velocity or acceleration."""

    linear: Floats  # shape (), of the whole translation, or (dim,), of each axis
    angular: float | None
    dim: int

    def largest(self, rates: Floats) -> Floats:
        """Return the largest multiples of rates within limits, (m,)."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.shares(rates).max(axis=1))

    def shares(self, rates: Floats) -> Floats:
        """Return rates as shares of their limits, (..., limits)."""
        linear = np.abs(rates[..., : self.dim])
        if not self.linear.ndim:
            linear = np.linalg.norm(linear, axis=-1, keepdims=True)
        shares = np.asarray(linear / self.linear)
        if self.angular is None:
            return shares
        angular = np.linalg.norm(rates[..., self.dim :], axis=-1, keepdims=True) / self.angular
        return np.concatenate([shares, angular], axis=-1)

    def multiply(self, first: Floats, second: Floats) -> Floats:
        """Return products of rates over squared limits, (m, limits)."""
        products = first * second
        linear = products[:, : self.dim] / self.linear**2
        if not self.linear.ndim:
            linear = linear.sum(axis=1, keepdims=True)
        if self.angular is None:
            return linear
        angular = products[:, self.dim :].sum(axis=1, keepdims=True) / self.angular**2
        return np.concatenate([linear, angular], axis=1)


class MotionBounds(NamedTuple):
    """Limits of a motion."""

    velocity: LimitRates
    acceleration: LimitRates
    lateral: float  # largest acceleration across the direction of driving
    gap: float  # largest relative gap between segments
    jerk: LimitRates | None = None
    places: PlacedLimits | None = None
    memo: IntervalMemo | None = None

    def list_limits(self) -> list[Floats]:
        """Return limits of velocity, acceleration and jerk, default infinite."""
        infinite = LimitRates(np.array(np.inf), None, 0)
        limits = self.velocity, self.acceleration, self.jerk or infinite
        return [np.hstack([each.linear.ravel(), each.angular or np.inf]) for each in limits]

    def lateral_shares(self, segments: Segments, rates: Floats) -> list[Floats]:
        """Return rates as shares of the lateral limit, shape (m, 1).

        The list is empty if no segment turns.
        """
        turns_ahead = (segments.drives != 0) | (segments.curvatures != 0.0)
        if not turns_ahead.any():
            return []
        sideways = turns_ahead * np.abs(rates[:, 2]) * np.linalg.norm(rates[:, :2], axis=1)
        return [sideways[:, np.newaxis] / self.lateral]


class IntervalMemo:
    """Cache of intervals, because a motion is made, limited and checked on the same intervals.

    ``known`` holds segments, limits of places, and their intervals.
    """

    def __init__(self) -> None:
        """Begin without intervals."""
        self.known: tuple[tuple[Segments, PlacedLimits | None, Intervals], ...] = ()

    def __reduce__(self) -> tuple[type[IntervalMemo], tuple[()]]:
        """Pickle no intervals."""
        return IntervalMemo, ()


def are_same_bounds(first: MotionBounds, second: MotionBounds) -> bool:
    """Return True if two motions have the same limits."""
    pairs = zip(first.list_limits(), second.list_limits(), strict=True)
    rules = [each.places.rules if each.places is not None else () for each in (first, second)]
    same = first.lateral == second.lateral and rules[0] == rules[1]
    return same and all(np.array_equal(*pair) for pair in pairs)


class Intervals(NamedTuple):
    """The n parts of segments; each has one acceleration, or up to three on a straight or an arc.

    The velocity is the rate times the speed. The acceleration is the rate times the acceleration u
    along the path, plus the bend times the squared speed x. So c limits are ``p |u| + q x <= 1``.
    """

    owners: Ints  # (n,), the segments
    begins: Floats  # (n,), lengths along these
    lengths: Floats  # (n,)
    is_curved: Bools  # (n,)
    rates: Floats  # (n, k), bounds of the path's first derivatives
    bends: Floats  # (n, k), bounds of the second derivatives
    twists: Floats  # (n, k), bounds of the third derivatives
    rate_shares: Floats  # (n, c), the numbers p
    bend_shares: Floats  # (n, c), the numbers q
    hard_caps: Floats  # (n,), the largest squared speeds by the velocities
    caps: Floats  # (n,), the largest squared speeds by limits of places, too
    end_caps: Floats  # (n + 1,), the largest squared speeds at the ends; zero for a stop

    def head(self, count: int) -> Intervals:
        """Return the first intervals."""
        columns = Intervals._make(column[:count] for column in self)
        return columns._replace(end_caps=self.end_caps[: count + 1])


def measure_intervals(
    segments: Segments, rotations: Rotations, bounds: MotionBounds, begin: float = 0.0
) -> Intervals:
    """Cut segments into intervals with one limit each.

    A straight segment or an arc has one largest speed and acceleration, so it is one interval. A
    curve is cut into intervals, whose limits hold for bounds of the derivatives. Both are cut again
    at changes of the limits of places. The robot begins at a length along the first segment.
    """
    whole = _find_intervals(segments, rotations, bounds)
    # At the end of the first segment the robot begins in its last interval, without length.
    is_before = (whole.owners[1:] == 0) & ((whole.begins + whole.lengths)[:-1] <= begin)
    ahead = Intervals._make(column[np.count_nonzero(is_before) :].copy() for column in whole)
    ahead.lengths[0] -= min(max(begin - ahead.begins[0], 0.0), ahead.lengths[0])
    ahead.begins[0] = max(begin, ahead.begins[0])
    return ahead


def _find_intervals(segments: Segments, rotations: Rotations, bounds: MotionBounds) -> Intervals:
    """Return all intervals of segments, cached."""
    places = bounds.places
    known = bounds.memo.known if bounds.memo is not None else ()
    for others, limits, intervals in known:
        if others is segments and limits is places:
            return intervals
    if places is None:
        intervals = _find_hard_intervals(segments, rotations, bounds)
    else:
        hard = _find_intervals(segments, rotations, bounds._replace(places=None))
        parts = segments.select(hard.owners)
        ends = hard.begins, hard.lengths, np.sqrt(hard.caps)
        found = places.find_stretches(parts, ends, hard.rates, hard.bends)
        intervals = _cut_intervals(hard, found)
    if bounds.memo is not None:
        bounds.memo.known = (*known[-2:], (segments, places, intervals))
    return intervals


def _find_hard_intervals(
    segments: Segments, rotations: Rotations, bounds: MotionBounds
) -> Intervals:
    """Return all intervals of segments, without limits of places."""
    is_curve = segments.is_curve
    counts = np.where(is_curve, INTERVALS_PER_CURVE, 1)
    owners, numbers = number_parts(counts)
    lengths = (segments.lengths / counts)[owners]
    begins = numbers * lengths
    parts = segments.select(owners)
    rates, bends = bound_derivatives(parts, begins, lengths)
    rate_shares, bend_shares = bounds.acceleration.shares(np.array([rates, bends]))
    shares = [bounds.velocity.shares(rates) ** 2, bend_shares]
    shares += bounds.lateral_shares(parts, rates)
    caps = 1.0 / np.concatenate(shares, axis=1).max(axis=1)
    # Numbers for times resolve no larger accelerations.
    duration = (lengths + np.sqrt(lengths * rate_shares.max(axis=1))).sum()
    rate_shares = np.maximum(rate_shares, MIN_RAMP_SHARE * duration)
    may_pass = np.ones(len(owners) - 1, dtype=np.bool_)
    may_pass[owners[1:] != owners[:-1]] = find_passes(segments, rotations, bounds)
    end_caps = np.zeros(len(owners) + 1)
    end_caps[1:-1] = np.where(may_pass, np.minimum(caps[:-1], caps[1:]), 0.0)
    return Intervals(
        *(owners, begins, lengths, is_curve[owners], rates, bends, np.abs(parts.twists)),
        *(rate_shares, bend_shares, caps, caps, end_caps),
    )


def _cut_intervals(hard: Intervals, found: Stretches) -> Intervals:
    """Cut intervals at changes of the limits of places."""
    squares = found.tops**2
    caps = hard.caps[found.numbers]
    squares = np.where(squares < (1.0 - MAX_ERROR) * caps, squares, caps)
    is_new = np.ones(len(squares), dtype=np.bool_)
    is_new[1:] = (np.diff(found.numbers) != 0) | (np.diff(squares) != 0.0)
    numbers = found.numbers[is_new]
    cut = Intervals._make(column[numbers] for column in hard)
    begins = found.begins[is_new]
    lengths = cut.lengths.copy()
    is_cut = np.bincount(numbers)[numbers] > 1
    ends = cut.begins + lengths
    is_inner = numbers[1:] == numbers[:-1]
    inner = np.flatnonzero(is_inner)
    ends[inner] = begins[inner + 1]
    lengths[is_cut] = (ends - begins)[is_cut]
    caps = squares[is_new]
    may_pass = is_inner | (cut.end_caps[1:] > 0.0)
    end_caps = np.zeros(len(caps) + 1)
    end_caps[1:-1] = np.where(may_pass, np.minimum(caps[:-1], caps[1:]), 0.0)
    return cut._replace(begins=begins, lengths=lengths, caps=caps, end_caps=end_caps)


def find_phases(
    segments: Segments,
    rotations: Rotations,
    bounds: MotionBounds,
    begin: float = 0.0,
    begin_speed: float = 0.0,
) -> Phases | None:
    """Find the phases of the fastest motion along segments.

    It begins at the length ``begin`` along the first segment, with ``begin_speed``, a length per
    second, and ends at rest. Return None if the robot is too fast to stop.
    """
    intervals = measure_intervals(segments, rotations, bounds, begin)
    if begin_speed > 0.0 and bounds.places is not None:
        intervals = _allow_braking(intervals, begin_speed**2)
    lengths = intervals.lengths
    squares = intervals.end_caps
    squares[0] = min(begin_speed**2, intervals.caps[0])
    bound_squares(lengths, intervals.rate_shares, intervals.bend_shares, squares)
    if squares[0] < (1.0 - MAX_ERROR) * begin_speed**2:
        return None

    # A curved interval has one acceleration, so its squared speed is largest at an end.
    is_curved = intervals.is_curved
    changes = np.abs(np.diff(squares)) / (2.0 * np.maximum(lengths, MIN_SPEED))
    gains = np.where(is_curved, changes, 1.0 / intervals.rate_shares.max(axis=1))
    caps = np.where(is_curved, 0.0, intervals.caps)
    return _make_phases(intervals.owners, intervals.begins, lengths, caps, gains, squares)


def _allow_braking(intervals: Intervals, square: float) -> Intervals:
    """Raise limits of places to the speeds of the quickest stop.

    The stop begins at a squared speed; no other motion from there is slower. An interval in which
    the stop comes below its limit is cut.
    """
    k = 0
    while k < len(intervals.lengths):
        cap, hard = float(intervals.caps[k]), float(intervals.hard_caps[k])
        room = np.maximum(1.0 - intervals.bend_shares[k] * square, 0.0)
        slowing = 2.0 * float((room / np.maximum(intervals.rate_shares[k], MIN_SPEED)).min())
        if square > (1.0 + MAX_ERROR) * cap:
            place = (square - cap) / max(slowing, MIN_SPEED)
            if place < intervals.lengths[k]:
                intervals = cut_interval(intervals, k, place)
            intervals.caps[k] = min(square, hard)
        square -= slowing * float(intervals.lengths[k])
        if square <= 0.0 or intervals.end_caps[k + 1] == 0.0:
            break
        square = min(square, float(intervals.hard_caps[k : k + 2].min()))
        intervals.end_caps[k + 1] = max(float(intervals.end_caps[k + 1]), square)
        k += 1
    return intervals


def cut_interval(intervals: Intervals, number: int, length: float) -> Intervals:
    """Cut one interval at a length from its begin."""
    rows = np.insert(np.arange(len(intervals.lengths)), number, number)
    end_caps = np.insert(intervals.end_caps, number + 1, intervals.caps[number])
    cut = Intervals._make(column[rows] for column in intervals._replace(end_caps=intervals.caps))
    cut = cut._replace(end_caps=end_caps)
    cut.lengths[number] = length
    cut.lengths[number + 1] -= length
    cut.begins[number + 1] += length
    return cut


def find_stop(
    segments: Segments, rotations: Rotations, bounds: MotionBounds, begin: float, speed: float
) -> Phases:
    """Find a stop from a speed along segments.

    It begins at a length along the first segment. In each interval the robot slows down evenly, by
    the most that the limits allow at the interval's begin. From a lower speed it may slow down
    more, so by induction it is nowhere faster than the motion, which keeps the limits.
    """
    intervals = measure_intervals(segments, rotations, bounds, begin)
    lengths = intervals.lengths.tolist()
    # Caps at ends are zero at the motion's own stops; all others are reached up to rounding. Limits
    # of places that came after the motion was made may be below its speed.
    hard = intervals.hard_caps
    end_caps = np.append(np.minimum(hard[:-1], hard[1:]), 0.0)
    speed_caps = np.sqrt(np.where(intervals.end_caps[1:] > 0.0, end_caps, 0.0)).tolist()
    speeds: list[float] = []
    slowings: list[float] = []
    durations: list[float] = []
    for k, length in enumerate(lengths):
        # At a limit of the curve the room is zero, or negative by rounding.
        room = np.maximum(1.0 - intervals.bend_shares[k] * speed**2, 0.0)
        slowing = float((room / np.maximum(intervals.rate_shares[k], MIN_SPEED)).min())
        after = min(max(speed**2 - 2.0 * slowing * length, 0.0) ** 0.5, speed_caps[k])
        stops = after == 0.0
        duration = speed / max(slowing, MIN_SPEED) if stops else 2.0 * length / (speed + after)
        if not stops and length > MAX_ERROR * intervals.begins[k]:
            slowing = (speed - after) / duration  # it reaches the cap; in a tiny rest it may not
        speeds.append(speed)
        slowings.append(slowing)
        durations.append(duration)
        if stops:
            break
        speed = after
    count = len(speeds)
    begins = intervals.begins[:count]
    end = begins[-1] + min(0.5 * speed * durations[-1], lengths[count - 1])
    owners = intervals.owners[[*range(count), count - 1]]
    gains = -np.array(slowings)
    return join_phases(
        np.array(durations), owners, np.append(begins, end), np.array(speeds), gains, 0.0 * gains
    )


@kernel
def bound_squares(
    lengths: Floats, rate_shares: Floats, bend_shares: Floats, squares: Floats
) -> None:
    """Lower squared speeds to limits of acceleration.

    Arrays of n intervals, in which the acceleration u along the path is constant:

    * ``lengths``, shape (n,)
    * ``rate_shares``, ``bend_shares``, shape (n, c): p and q of c limits ``p |u| + q x <= 1`` for
      the squared speed x
    * ``squares``, shape (n + 1,): the largest squared speeds by the velocities, and the result
    """
    n = len(lengths)
    for k in range(n - 1, -1, -1):
        largest = find_largest(lengths[k], rate_shares[k], bend_shares[k], squares[k + 1])
        squares[k] = min(squares[k], largest)
    for k in range(n):
        largest = find_largest(lengths[k], rate_shares[k], bend_shares[k], squares[k])
        squares[k + 1] = min(squares[k + 1], largest)


@internal
def find_largest(length: float, rate_shares: Floats, bend_shares: Floats, square: float) -> float:
    """Return the largest squared speed at one end of an interval.

    ``square`` is the squared speed at the other end.
    """
    largest = np.inf
    for k in range(len(rate_shares)):
        rate = rate_shares[k]
        reached = (2.0 * length + rate * square) / (rate + 2.0 * length * bend_shares[k])
        largest = min(largest, reached)
    return max(largest, square)


def _make_phases(
    owners: Ints, begins: Floats, lengths: Floats, caps: Floats, gains: Floats, squares: Floats
) -> Phases:
    """Make phases from squared speeds at ends of intervals, (n + 1,).

    Each interval has up to three phases: the robot accelerates by the gain, drives at the capped
    squared speed if it reaches the cap, and slows down by the gain.
    """
    before = squares[:-1]
    after = squares[1:]
    peaks = np.minimum(caps, 0.5 * (before + after) + gains * lengths)
    # Rounding must not put the peak below the speed at an end.
    peaks = np.maximum(peaks, np.maximum(before, after))
    divisors = 2.0 * np.maximum(gains, MIN_SPEED)
    up = (peaks - before) / divisors
    down = (peaks - after) / divisors
    moved = np.column_stack([up, np.maximum(lengths - up - down, 0.0), down]).ravel()
    speeds = np.sqrt(np.column_stack([before, peaks, peaks, after]))
    mean_speeds = 0.5 * (speeds[:, :-1] + speeds[:, 1:]).ravel()
    durations = moved / np.maximum(mean_speeds, MIN_SPEED)
    positions = np.column_stack([begins, begins + up, begins + lengths - down]).ravel()
    accelerations = np.column_stack([gains, 0.0 * gains, -gains]).ravel()
    ends = np.append(positions, begins[-1] + lengths[-1])
    segments = np.append(np.repeat(owners, 3), owners[-1])
    begin_speeds = speeds[:, :-1].ravel()
    return join_phases(durations, segments, ends, begin_speeds, accelerations, 0.0 * accelerations)


def join_phases(
    durations: Floats,
    segments: Ints,
    positions: Floats,
    speeds: Floats,
    accelerations: Floats,
    jerks: Floats,
) -> Phases:
    """Join n successive phases, and append the rest.

    ``segments`` and ``positions``, shape (n + 1,), end with the place of the rest.
    """
    kept = durations > MIN_PHASE_SHARE * durations.sum()
    rest = np.zeros(1)
    times = np.cumsum(np.concatenate([rest, durations[kept]]))
    columns = [np.concatenate([column[kept], rest]) for column in (speeds, accelerations, jerks)]
    kept = np.concatenate([kept, [True]])
    return Phases(times, segments[kept], positions[kept], *columns)


def join_motions(first: Phases, second: Phases, segments: int) -> Phases:
    """Join a motion to rest, and the motion along further segments.

    ``segments`` is the number of the first motion's segments.
    """
    second = second._replace(
        times=second.times + first.times[-1], segments=second.segments + segments
    )
    pairs = zip(first, second, strict=True)
    return Phases._make(np.concatenate([before[:-1], after]) for before, after in pairs)


def slow_down(phases: Phases, factor: float) -> Phases:
    """Slow down a motion evenly by a factor."""
    return Phases(
        phases.times * factor,
        phases.segments,
        phases.positions,
        phases.speeds / factor,
        phases.accelerations / factor**2,
        phases.jerks / factor**3,
    )


def find_passes(segments: Segments, rotations: Rotations, bounds: MotionBounds) -> Bools:
    """Return whether segments join without stop, shape (m - 1,).

    Rates continue from each segment to the next. A yaw rate without a limit of acceleration may
    jump. With a limit of jerk, the second derivatives continue, too.
    """
    numbers = np.arange(len(segments.lengths))
    if len(numbers) == 1:
        return np.ones(0, dtype=np.bool_)
    parts = segments.select(np.concatenate([numbers[:-1], numbers[1:]]))
    places = np.concatenate([segments.lengths[:-1], 0.0 * segments.lengths[1:]])
    _, rates, bends = place_along(parts, rotations, places)
    ends, begins = np.split(rates, 2)
    jumps = bounds.acceleration.shares(ends - begins)
    largest = bounds.acceleration.shares(np.maximum(np.abs(ends), np.abs(begins)))
    allowed = max(MAX_RATE_STEP, bounds.gap) * largest
    allowed += MIN_RATE_STEP * largest.max(axis=1, keepdims=True)
    passes = np.asarray((jumps <= allowed).all(axis=1))
    if bounds.jerk is None:
        return passes
    # The acceleration across an arc has a separate limit.
    ends, begins = np.split(np.where(parts.curvatures[:, np.newaxis], 0.0, bends), 2)
    sizes = bounds.jerk.shares(np.maximum(np.abs(ends), np.abs(begins)))
    allowed = MAX_RATE_STEP * (sizes + bounds.jerk.shares(np.split(rates, 2)[0]))
    return passes & np.asarray((bounds.jerk.shares(ends - begins) <= allowed).all(axis=1))


def is_motion(
    ends: Floats,
    segments: Segments,
    rotations: Rotations,
    phases: Phases,
    bounds: MotionBounds,
    begin_velocity: Floats | float = 0.0,
    begin_acceleration: Floats | float = 0.0,
) -> bool:
    """Return True if phases are a valid motion.

    It moves along segments from the first row of ``ends``, with a velocity and an acceleration,
    shape (k,), to rest at the last row. Phases take time and stay on their segments,
    configurations, velocities and, if the jerk has a limit, accelerations do not jump between them,
    and limits hold: with a limit of jerk at each instant, otherwise at the ends of phases.
    Comparisons are False for NaN.
    """
    positions, speeds, gains = (
        np.concatenate([begins[:-1], ends])
        for begins, ends in zip(phases[2:5], phases.ends(), strict=True)
    )
    numbers = phases.segments[:-1]
    parts = segments.select(np.concatenate([numbers, numbers]))
    rows, rates, bends = place_along(parts, rotations, positions)
    before, after = _pair(rows, ends[:1], ends[-1:])
    gaps = np.abs(rotations.steps_between(before, after))
    velocities = rates * speeds[:, np.newaxis]
    rest = np.zeros((1, rates.shape[1]))
    velocities_before, velocities_after = _pair(velocities, rest + begin_velocity, rest)
    jumps = bounds.acceleration.shares(velocities_after - velocities_before)
    largest = bounds.acceleration.shares(velocities_before).max()
    slack = measure_slack(segments, parts)
    is_one = (
        (phases.durations > 0.0).all()
        and ((-slack <= positions) & (positions <= parts.lengths + slack)).all()
        and (gaps <= bounds.gap * measure_sizes(before, rotations)).all()
        and (jumps <= MAX_SPEED_GAP * largest).all()
    )
    # The acceleration across an arc has a separate limit.
    bends = np.where(parts.curvatures[:, np.newaxis], 0.0, bends)
    accelerations = rates * gains[:, np.newaxis] + bends * (speeds**2)[:, np.newaxis]
    if bounds.jerk is None:
        shares = [bounds.velocity.shares(velocities), bounds.acceleration.shares(accelerations)]
        shares += bounds.lateral_shares(parts, velocities)
        return bool(is_one and (np.concatenate(shares, axis=1) <= 1.0 + MAX_EXCESS).all())
    gains_before, gains_after = _pair(accelerations, rest + begin_acceleration, rest)
    jumps = bounds.jerk.shares(gains_after - gains_before)
    is_even = (jumps <= MAX_GAIN_GAP * bounds.jerk.shares(gains_before).max()).all()
    return bool(is_one and is_even and keeps_jerk(segments, phases, bounds, bounds.jerk))


def _pair(values: Floats, first: Floats, last: Floats) -> tuple[Floats, Floats]:
    """Return values before and after n + 1 instants.

    ``values``, shape (2 n, k), are at the begins of n phases, then at their ends.
    """
    count = len(values) // 2
    before = np.concatenate([first, values[count:]])
    return before, np.concatenate([values[:count], last])


def keeps_jerk(segments: Segments, phases: Phases, bounds: MotionBounds, jerk: LimitRates) -> bool:
    """Return True if all limits hold at each instant, also of jerk.

    Derivatives of the path are bounded over the length of a phase. In a phase, the acceleration is
    largest at an end, and the speed at an end or at zero acceleration.
    """
    parts = segments.select(phases.segments[:-1])
    begins, _, begin_gains, jerks = (column[:-1] for column in phases[2:])
    ends, _, end_gains = phases.ends()
    *derivatives, borders = _bound_around(parts, 0.5 * (begins + ends))
    slack = measure_slack(segments, parts)
    if not ((borders[0] - slack <= begins) & (ends <= borders[1] + slack)).all():
        return False
    speeds = phases.peaks()[:, np.newaxis]
    gains = np.abs([begin_gains, end_gains]).max(axis=0)[:, np.newaxis]
    velocities = derivatives[0] * speeds
    rates, bends = bounds.acceleration.shares(np.array(derivatives))
    shares = [bounds.velocity.shares(velocities), rates * gains + bends * speeds**2]
    shares += bounds.lateral_shares(parts, velocities)
    rates, bends, twists = jerk.shares(np.array([*derivatives, np.abs(parts.twists)]))
    along = rates * np.abs(jerks)[:, np.newaxis]
    shares.append(along + 3.0 * bends * speeds * gains + twists * speeds**3)
    return bool((np.concatenate(shares, axis=1) <= 1.0).all())


def _bound_around(parts: Segments, lengths: Floats) -> tuple[Floats, Floats, Floats]:
    """Bound derivatives in the intervals around lengths along segments.

    The last array holds the borders of the intervals, shape (2, m).
    """
    counts = np.where(parts.is_curve, INTERVALS_PER_CURVE, 1)
    widths = parts.lengths / counts
    numbers = lengths // np.where(widths > 0.0, widths, 1.0)
    numbers = np.minimum(np.maximum(numbers, 0.0), counts - 1)
    borders = np.array([numbers * widths, (numbers + 1.0) * widths])
    rates, bends = bound_derivatives(parts, borders[0], widths)
    return rates, bends, borders


def find_excess(
    segments: Segments, rotations: Rotations, bounds: MotionBounds, phases: Phases
) -> float:
    """Return the seconds after which phases keep limits of places."""
    exceeds = np.flatnonzero(find_excesses(segments, rotations, bounds, phases))
    if not len(exceeds):
        return 0.0
    last = exceeds[-1]
    intervals = measure_intervals(segments, rotations, bounds)
    is_met = intervals.owners == phases.segments[last]
    is_met &= intervals.begins < phases.ends()[0][last]
    is_met &= intervals.begins + intervals.lengths > phases.positions[last]
    squared = float(intervals.caps[is_met].min(initial=np.inf))
    return float(phases.times[last]) + _find_slow(phases, last, math.sqrt(squared))


def _find_slow(phases: Phases, number: int, speed: float) -> float:
    """Return the seconds after which a phase stays below a speed.

    They are its whole duration if it never does.
    """
    duration = float(phases.durations[number])
    begin, gain, jerk = (float(column[number]) for column in phases[3:])
    if not phases.ends()[1][number] <= speed < math.inf:
        return duration
    # After its peak, the speed falls below the limit once.
    peak = -gain / jerk if jerk < 0.0 < gain else 0.0
    low, high = min(peak, duration), duration
    for _ in range(ROOT_STEPS):
        middle = 0.5 * (low + high)
        if begin + middle * (gain + 0.5 * middle * jerk) > (1.0 + MAX_EXCESS) * speed:
            low = middle
        else:
            high = middle
    return high


def find_excesses(
    segments: Segments, rotations: Rotations, bounds: MotionBounds, phases: Phases
) -> Bools:
    """Return whether phases exceed the limits of places in their intervals."""
    if bounds.places is None:
        return np.zeros(len(phases.times) - 1, dtype=np.bool_)
    intervals = measure_intervals(segments, rotations, bounds)
    firsts = np.cumsum(segments.lengths) - segments.lengths
    starts = firsts[intervals.owners] + intervals.begins
    owners = phases.segments[:-1]
    begins, ends = phases.positions[:-1], phases.ends()[0]
    middles = firsts[owners] + 0.5 * (begins + ends)
    numbers = np.maximum(np.searchsorted(starts, middles, side="right") - 1, 0)
    borders = intervals.begins[numbers], (intervals.begins + intervals.lengths)[numbers]
    slack = measure_slack(segments, segments.select(owners))
    keeps = (intervals.owners[numbers] == owners) & (begins >= borders[0] - slack)
    keeps &= ends <= borders[1] + slack
    keeps &= phases.peaks() <= (1.0 + MAX_EXCESS) * np.sqrt(intervals.caps[numbers])
    return np.asarray(~keeps)


def measure_slack(segments: Segments, parts: Segments) -> Floats:
    """Bound rounding errors of lengths along segments, shape (m,).

    The length from the start rounds once at each interval, also on tiny segments.
    """
    roundings = INTERVALS_PER_CURVE * len(segments.lengths)
    rounding = roundings * float(np.spacing(segments.lengths.sum()))
    return np.maximum(MAX_ERROR * parts.lengths, rounding)


def trim_segments(segments: Segments, phases: Phases) -> tuple[Segments, Phases]:
    """Remove segments outside the phases."""
    first, last = phases.segments[[0, -1]].tolist()
    if (first, last + 1) == (0, len(segments.lengths)):
        return segments, phases
    kept = segments.select(slice(first, last + 1))
    return kept, phases._replace(segments=phases.segments - first)

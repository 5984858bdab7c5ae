"""Motions along segments with limited jerk.

Legs of the path meet at local minima of the speed of the fastest motion without a limit of jerk.
There the acceleration along the path is zero. On each leg the robot changes its speed by a ramp,
drives evenly, and changes it again. A ramp raises the acceleration evenly, keeps it, and lowers it
evenly: a double S (L. Biagiotti and C. Melchiorri, "Trajectory planning for automatic machines and
robots", 2008). Its acceleration and jerk are lowered until the limits hold on each piece, by bounds
of the derivatives of the path.

If v, a and j are speed, acceleration and jerk along the path, and r, b and w bound the first,
second and third derivatives of the path, the limits are

* ``r |a| + b v^2 <= 1`` for the acceleration, and
* ``r |j| + 3 b v |a| + w v^3 <= 1`` for the jerk.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace import Rotations
from cspace.inside import Bools, Floats, Ints, internal, kernel
from planners._motion.segments import Segments
from planners._motion.timing import (
    MAX_ERROR,
    Intervals,
    LimitRates,
    MotionBounds,
    Phases,
    bound_squares,
    cut_interval,
    find_phases,
    join_phases,
    measure_intervals,
    slow_down,
)

BEND_ROOM: Final = 0.85
"""Largest share of a limit of acceleration that the bend of a curve uses between two legs."""

MAX_ROUNDS: Final = 100
"""Largest number of times that ramps are lowered."""

BORDER_RATIO: Final = 1.2
"""Least ratio of the largest squared speeds at a border of places where a leg ends."""

LEAST_LESS, MOST_LESS = 0.98, 0.85
"""Factors of a ramp's limits in a round: the largest and the smallest."""

ROOT_STEPS: Final = 60
"""Number of halvings that find a speed or a time."""

MIN_JERK_SHARE: Final = 1e-6
"""Smallest share of the duration in which the largest jerk reaches the largest acceleration.
Numbers for times resolve no larger jerks."""

SLACK: Final = 1e-7
"""Share of each limit that is reserved for rounding."""

LEG_ERROR: Final = 1e-10
"""Largest relative excess of a leg's length by rounding."""

ROUNDING: Final = 1e-8
"""Excess of a factor of time that is a rounding error; its third power is below the slack."""

TINY: Final = 1e-300
"""Smallest divisor."""

LEG_PHASES: Final = 7
"""Number of phases of a leg: three of each ramp, and an even one between these."""


class JerkIntervals(NamedTuple):
    """The n parts of a path within which bounds hold, one limit of each kind in a column."""

    borders: Floats  # (n + 1,), lengths from the start of the first interval
    speeds: Floats  # (n,), the largest speeds
    rates: Floats  # (n, c), r of the acceleration
    bends: Floats  # (n, c), b of the acceleration
    jerk_rates: Floats  # (n, d), r of the jerk
    jerk_bends: Floats  # (n, d), b of the jerk
    jerk_twists: Floats  # (n, d), w of the jerk


def find_motion(
    segments: Segments,
    rotations: Rotations,
    bounds: MotionBounds,
    begin: float = 0.0,
    begin_speed: float = 0.0,
    begin_acceleration: float = 0.0,
) -> Phases | None:
    """Find a fast motion along segments to rest.

    It begins at a length along the first segment, with a speed and an acceleration along it, by
    default at rest. The acceleration counts only if the jerk has a limit. Return None if the robot
    is too fast to stop.
    """
    if bounds.jerk is None:
        return find_phases(segments, rotations, bounds, begin, begin_speed)
    intervals = measure_intervals(segments, rotations, bounds, begin)
    state = begin_speed, begin_acceleration
    phases = _solve(intervals, bounds.jerk, *state)
    if phases is not None or begin_speed == 0.0 or bounds.places is None:
        return phases
    # Ignore the limits of places up to a border, and find the nearest border that a motion allows.
    # First try the speed at which the acceleration is back at zero, then any.
    shares = bounds.jerk.shares(intervals.rates[0])
    square = (begin_speed + 0.5 * max(begin_acceleration, 0.0) ** 2 * float(shares.max())) ** 2
    length = float(intervals.lengths.sum())
    for top in ((1.0 + SLACK) ** 3 * square, math.inf):
        far = length
        phases = _solve(_raise_caps(intervals, far, top), bounds.jerk, *state)
        if phases is not None:
            break
    near = 0.0
    # Halve the distance between a border too near and a feasible border.
    for _ in range(12 if phases is not None else 0):
        middle = 0.5 * (near + far)
        raised = _raise_caps(intervals, middle, top)
        found = _solve(raised, bounds.jerk, *state, middle)
        if found is None:
            found = _solve(raised, bounds.jerk, *state)
        if found is None:
            near = middle
        else:
            phases, far = found, middle
    return phases


def _raise_caps(intervals: Intervals, length: float, top: float) -> Intervals:
    """Raise the limits of places on the first part.

    Up to ``length``, they are at least the squared speed ``top``.
    """
    borders = np.cumsum(intervals.lengths)
    number = min(int(np.searchsorted(borders, length)), len(borders) - 1)
    most = float(intervals.lengths[number])
    place = min(max(length - float(borders[number]) + most, 0.0), most)
    raised = cut_interval(intervals, number, place)
    caps = raised.caps[: number + 1]
    caps[:] = np.minimum(raised.hard_caps[: number + 1], np.maximum(caps, top))
    ends = np.minimum(raised.caps[:-1], raised.caps[1:])
    raised.end_caps[1:-1] = np.where(raised.end_caps[1:-1] > 0.0, ends, 0.0)
    return raised


def _solve(
    intervals: Intervals,
    jerk: LimitRates,
    begin_speed: float,
    begin_acceleration: float,
    first_length: float = 0.0,
) -> Phases | None:
    """Find a fast motion through intervals to rest.

    The first leg has at least the length ``first_length``. Return None if the robot is too fast to
    stop.
    """
    limited = _limit_jerk(intervals, jerk)
    squares = intervals.end_caps.copy()
    squares[0] = min(begin_speed**2, intervals.caps[0])
    caps = 1.0 / np.maximum(limited.bends.max(axis=1) / BEND_ROOM, limited.speeds**-2.0)
    squares[1:-1] = np.minimum(squares[1:-1], np.minimum(caps[:-1], caps[1:]))
    tops = squares.copy()
    bound_squares(intervals.lengths, limited.rates, limited.bends, squares)
    is_soft = intervals.caps < intervals.hard_caps
    ratios = np.abs(np.diff(np.log(intervals.caps)))
    is_border = (is_soft[1:] | is_soft[:-1]) & (ratios > math.log(BORDER_RATIO))
    is_border &= squares[1:-1] >= (1.0 - MAX_ERROR) * tops[1:-1]
    keys = _choose_keys(
        squares, tops, caps, limited, begin_speed, begin_acceleration, is_border, first_length
    )
    speeds = np.sqrt(squares[keys])
    speeds[0] = begin_speed
    gains = 1.0 / limited.rates.max(axis=1)
    jerks = 1.0 / limited.jerk_rates.max(axis=1)
    legs = keys[:-1]
    most = np.column_stack([gains, jerks, gains, jerks, limited.speeds])
    limits = (1.0 - SLACK) * np.maximum.reduceat(most, legs)
    # Below a tenth of its limits no ramp is lowered; the speeds at its ends are.
    floors = 0.1 * np.minimum.reduceat(most[:, :4], legs)
    pieces = np.zeros((LEG_PHASES * len(legs) + len(gains), 6))
    work = np.zeros(LEG_PHASES), np.zeros(LEG_PHASES), np.zeros(LEG_PHASES)
    start = keys, speeds, begin_acceleration
    excess = solve_legs(pieces, limits, floors, *work, np.zeros((len(legs), 3)), *start, limited)
    begins_moving = begin_speed > 0.0 or begin_acceleration != 0.0
    if excess == np.inf or (excess > 1.0 + ROUNDING and begins_moving):
        return None
    phases = _join_pieces(intervals, limited, pieces[pieces[:, 5] > 0.0])
    return slow_down(phases, excess) if excess > 1.0 + ROUNDING else phases


def find_jerk_stop(
    segments: Segments,
    rotations: Rotations,
    bounds: MotionBounds,
    jerk: LimitRates,
    begin: float,
    speed: float,
    acceleration: float,
) -> Phases | None:
    """Find a stop with limited jerk.

    It begins at a length along the first segment, with a speed and an acceleration along it. Return
    None if no single ramp stops the robot.
    """
    intervals = measure_intervals(segments, rotations, bounds, begin)
    stops = np.flatnonzero(intervals.end_caps[1:] == 0.0)
    intervals = intervals.head(int(stops[0]) + 1)
    limited = _limit_jerk(intervals, jerk)
    limits = 1.0 / np.array([limited.rates.max(axis=1).min(), limited.jerk_rates.max(axis=1).min()])
    limits *= 1.0 - SLACK
    pieces = np.zeros((LEG_PHASES + len(limited.speeds), 6))
    work = np.zeros(3), np.zeros(3), np.zeros(3)
    ends = np.array([0, len(limited.speeds)])
    count, excess = solve_stop(pieces, limits, *work, ends, speed, acceleration, limited)
    return _join_pieces(intervals, limited, pieces[:count]) if excess <= 1.0 + ROUNDING else None


def _limit_jerk(intervals: Intervals, jerk: LimitRates) -> JerkIntervals:
    """Return the limits of intervals, including jerk."""
    derivatives = np.array([intervals.rates, intervals.bends, intervals.twists])
    jerk_rates, jerk_bends, jerk_twists = jerk.shares(derivatives)
    lengths = intervals.lengths
    # Numbers for times resolve no larger jerks.
    rates = intervals.rate_shares.max(axis=1, keepdims=True)
    duration = (lengths + np.sqrt(lengths * rates[:, 0])).sum()
    jerk_rates = np.maximum(jerk_rates, MIN_JERK_SHARE * duration * rates)
    with np.errstate(divide="ignore"):
        speeds = np.minimum(np.sqrt(intervals.caps), jerk_twists.max(axis=1) ** (-1.0 / 3.0))
    grown = 1.0 + SLACK
    return JerkIntervals(
        borders=np.cumsum(np.concatenate([np.zeros(1), lengths])),
        speeds=speeds / grown,
        rates=grown * intervals.rate_shares,
        bends=grown * intervals.bend_shares,
        jerk_rates=grown * jerk_rates,
        jerk_bends=grown * jerk_bends,
        jerk_twists=grown * jerk_twists,
    )


def _choose_keys(
    squares: Floats,
    tops: Floats,
    caps: Floats,
    limited: JerkIntervals,
    speed: float,
    acceleration: float,
    is_border: Bools,
    reach: float,
) -> Ints:
    """Choose the borders between legs; return their numbers.

    The fastest motion without a limit of jerk has the given squared speeds. A border is chosen if
    this motion is slowest there, begins or ends to follow the largest squared speeds ``tops``, is
    faster between two borders of one speed, or reaches a border of places. ``caps``, shape (n,),
    are the largest squared speeds of intervals; ``is_border``, shape (n - 1,), marks borders of
    places. The first leg has at least the length ``reach``, unless the robot must stop before.
    """
    steps = np.diff(squares)
    flat = np.abs(steps) <= MAX_ERROR * np.maximum(squares[1:], squares[:-1])
    falls = (steps < 0.0) & ~flat
    rises = (steps > 0.0) & ~flat
    is_key = squares == 0.0
    is_key[1:-1] |= (falls[:-1] & ~falls[1:]) | (rises[1:] & ~rises[:-1])
    is_top = squares >= (1.0 - MAX_ERROR) * tops
    is_key[1:-1] |= is_top[1:-1] & ~(is_top[:-2] & is_top[2:]) | is_border
    is_faster = flat & is_top[:-1] & is_top[1:] & (caps > (1.0 + MAX_ERROR) * tops[1:])
    is_key[:-1] |= is_faster
    is_key[1:] |= is_faster
    if acceleration:
        # The robot first brings its acceleration to zero.
        time = abs(acceleration) * float(limited.jerk_rates[0].max())
        reach = max(reach, time * (speed + acceleration * time / 3.0))
    is_key[(limited.borders < (1.0 - MAX_ERROR) * reach) & (squares > 0.0)] = False
    is_key[0] = True
    is_key[-1] = True
    return np.flatnonzero(is_key)


def _join_pieces(intervals: Intervals, limited: JerkIntervals, pieces: Floats) -> Phases:
    """Join successive pieces into phases, and add the rest."""
    numbers = pieces[:, 0].astype(np.int64)
    _, places, speeds, accelerations, jerks, durations = pieces.T
    begins = intervals.begins - limited.borders[:-1]
    positions = np.append(places + begins[numbers], intervals.begins[0])
    owners = intervals.owners[np.append(numbers, numbers[-1:] if len(numbers) else 0)]
    phases = join_phases(durations, owners, positions, speeds, accelerations, jerks)
    if len(numbers):
        phases.positions[-1] = phases.ends()[0][-1]
    return phases


@internal
def move(speed: float, acceleration: float, jerk: float, time: float) -> float:
    """Return the length moved at constant jerk."""
    return time * (speed + time * (acceleration / 2.0 + time * jerk / 6.0))


@internal
def fill_ramp(
    durations: Floats, jerks: Floats, speed: float, acceleration: float, to: float, limits: Floats
) -> float:
    """Fill a ramp's three phases; return its length.

    The ramp ends at the even speed ``to``. ``limits`` are the largest acceleration and jerk.
    """
    jerk = limits[1]
    even = speed + acceleration * abs(acceleration) / (2.0 * jerk)
    sign = 1.0 if to >= even else -1.0
    begin = sign * acceleration
    square = max(sign * jerk * (to - speed) + 0.5 * begin**2, 0.0)
    peak = max(min(math.sqrt(square), limits[0]), begin)
    gained = (peak**2 - 0.5 * begin**2) / jerk
    durations[0] = max(peak - begin, 0.0) / jerk
    durations[1] = 0.0
    if peak > 0.0:
        durations[1] = max(sign * (to - speed) - gained, 0.0) / peak
    durations[2] = peak / jerk
    jerks[0] = sign * jerk
    jerks[1] = 0.0
    jerks[2] = -sign * jerk
    length = 0.0
    for k in range(3):
        time = durations[k]
        length += move(speed, acceleration, jerks[k], time)
        speed += time * (acceleration + 0.5 * time * jerks[k])
        acceleration += time * jerks[k]
    return length


@internal
def find_reach(
    durations: Floats,
    jerks: Floats,
    speed: float,
    acceleration: float,
    most: float,
    length: float,
    limits: Floats,
) -> float:
    """Find the largest speed that a ramp reaches within a length.

    It is at most ``most``.
    """
    if fill_ramp(durations, jerks, speed, acceleration, most, limits) <= length:
        return most
    low = max(speed + acceleration * abs(acceleration) / (2.0 * limits[1]), 0.0)
    high = most
    for _ in range(ROOT_STEPS):
        middle = 0.5 * (low + high)
        if fill_ramp(durations, jerks, speed, acceleration, middle, limits) <= length:
            low = middle
        else:
            high = middle
    return float(min(low, most))


@internal
def fill_ramps(
    durations: Floats,
    jerks: Floats,
    speed: float,
    acceleration: float,
    even: float,
    to: float,
    limits: Floats,
) -> float:
    """Fill both ramps of a leg; return their length.

    The first ends, and the second begins, at the speed ``even``.
    """
    first = fill_ramp(durations[:3], jerks[:3], speed, acceleration, even, limits[:2])
    return first + fill_ramp(durations[4:], jerks[4:], even, 0.0, to, limits[2:4])


@internal
def fill_leg(
    durations: Floats,
    jerks: Floats,
    speed: float,
    acceleration: float,
    to: float,
    length: float,
    limits: Floats,
) -> bool:
    """Fill a leg's seven phases; return False if it is too short.

    ``limits`` are acceleration and jerk of each ramp, and the largest speed.
    """
    eased = max(speed + acceleration * abs(acceleration) / (2.0 * limits[1]), 0.0)
    even = max(limits[4], to)
    low = max(min(eased, even), to)
    moved = fill_ramps(durations, jerks, speed, acceleration, even, to, limits)
    if moved > length:
        high = even
        least = fill_ramps(durations, jerks, speed, acceleration, low, to, limits)
        if least > (1.0 + LEG_ERROR) * length and low > to:
            # The robot slows down at once, and again from the even speed.
            high = low
            low = to
        for _ in range(ROOT_STEPS):
            even = 0.5 * (low + high)
            if fill_ramps(durations, jerks, speed, acceleration, even, to, limits) <= length:
                low = even
            else:
                high = even
        even = low
        moved = fill_ramps(durations, jerks, speed, acceleration, even, to, limits)
    durations[3] = 0.0
    if even > 0.0:
        durations[3] = max(length - moved, 0.0) / even
    jerks[3] = 0.0
    return moved <= (1.0 + LEG_ERROR) * length


@internal
def find_time(speed: float, acceleration: float, jerk: float, most: float, length: float) -> float:
    """Return the time, up to ``most``, of moving a length."""
    low, high = 0.0, most
    time = 0.5 * most
    for _ in range(ROOT_STEPS):
        error = move(speed, acceleration, jerk, time) - length
        if error > 0.0:
            high = time
        else:
            low = time
        slope = speed + time * (acceleration + 0.5 * time * jerk)
        new = 0.5 * (low + high)
        if slope > 0.0 and low < time - error / slope < high:
            new = time - error / slope
        if abs(new - time) <= 1e-15 * most:
            break
        time = new
    return time


@internal
def check_piece(
    k: int, speed: float, acceleration: float, jerk: float, limited: JerkIntervals
) -> tuple[float, float, float]:
    """Return three factors that bring a piece within limits.

    The first, 1 or above, stretches time; instead, the second lowers the acceleration, or the third
    the jerk. Speed, acceleration and jerk are the largest in the piece, which lies in interval
    ``k``.
    """
    excess = speed / limited.speeds[k]
    by_acceleration, by_jerk = 1.0, 1.0
    if excess > 1.0:
        by_acceleration = by_jerk = excess**-2.0
    for c in range(limited.rates.shape[1]):
        bend = limited.bends[k, c] * speed**2
        along = limited.rates[k, c] * acceleration
        if bend + along > 1.0:
            excess = max(excess, math.sqrt(bend + along))
            by_acceleration = min(by_acceleration, max(1.0 - bend, 0.0) / max(along, TINY))
            if bend > 1.0:
                by_jerk = MOST_LESS
    for c in range(limited.jerk_rates.shape[1]):
        twist = limited.jerk_twists[k, c] * speed**3
        bend = 3.0 * limited.jerk_bends[k, c] * speed * acceleration
        along = limited.jerk_rates[k, c] * jerk
        share = twist + bend + along
        if share > 1.0:
            excess = max(excess, share ** (1.0 / 3.0))
            by_jerk = min(by_jerk, max(1.0 - bend - twist, 0.0) / max(along, TINY))
            if bend > along:
                by_acceleration = min(by_acceleration, max(1.0 - twist - along, 0.0) / bend)
    return excess, by_acceleration, by_jerk


@internal
def reduce_factors(
    factors: Floats, phase: int, is_fastest: bool, excess: float, by_gain: float, by_jerk: float
) -> None:
    """Lower factors of a leg's limits after an excess.

    ``factors`` scale the acceleration and jerk of the first ramp (phases 0 to 2), of the second
    ramp (phases 4 to 6), and the largest speed. In the even phase 3, the limit is the largest
    speed, or else both ramps'. ``excess``, ``by_gain`` and ``by_jerk`` come from
    :func:`check_piece`. One round lowers a limit by MOST_LESS to LEAST_LESS.
    """
    if phase == 3 and is_fastest:
        factors[4] = min(factors[4], max(1.0 / excess, MOST_LESS))
        return
    by_gain = min(max(by_gain, MOST_LESS), LEAST_LESS)
    by_jerk = min(max(by_jerk, MOST_LESS), LEAST_LESS)
    if phase <= 3:
        factors[0] = min(factors[0], by_gain)
        factors[1] = min(factors[1], by_jerk)
    if phase >= 3:
        factors[2] = min(factors[2], by_gain)
        factors[3] = min(factors[3], by_jerk)


@internal
def lay_leg(
    pieces: Floats,
    count: int,
    durations: Floats,
    jerks: Floats,
    speed: float,
    acceleration: float,
    first: int,
    last: int,
    limits: Floats,
    factors: Floats,
    limited: JerkIntervals,
) -> tuple[int, float]:
    """Cut a leg's phases into pieces, and check these.

    Cuts are at the borders of intervals ``first`` to ``last``. Lower the limits if the pieces need
    more time. Return the new number of pieces, and the factor of time that they need. Rows of
    ``pieces`` are the interval, the length from the first border, and speed, acceleration, jerk and
    duration. ``factors``, shape (5,), is working memory.
    """
    excess = 0.0
    top = limits[4] if len(limits) > 4 else math.inf
    factors[:] = 1.0
    k = first
    place = limited.borders[first]
    for phase in range(len(durations)):
        left = durations[phase]
        jerk = jerks[phase]
        while left > 0.0:
            time = left
            room = limited.borders[k + 1] - place
            passes = k < last and move(speed, acceleration, jerk, left) > room
            if passes:
                time = find_time(speed, acceleration, jerk, left, room)
            after = max(speed + time * (acceleration + 0.5 * time * jerk), 0.0)
            later = acceleration + time * jerk
            most = max(speed, after)
            if acceleration > 0.0 > later:
                most = max(most, speed - 0.5 * acceleration**2 / jerk)
            pieces[count, 0] = k
            pieces[count, 1] = place
            pieces[count, 2] = speed
            pieces[count, 3] = acceleration
            pieces[count, 4] = jerk
            pieces[count, 5] = time
            count += 1
            gain = max(abs(acceleration), abs(later))
            need, by_gain, by_jerk = check_piece(k, most, gain, abs(jerk), limited)
            excess = max(excess, need)
            if need > 1.0 + ROUNDING:
                is_fastest = most >= (1.0 - MAX_ERROR) * top
                reduce_factors(factors, phase, is_fastest, need, by_gain, by_jerk)
            place += move(speed, acceleration, jerk, time)
            speed = after
            acceleration = later
            left -= time
            if passes:
                k += 1
                place = limited.borders[k]
        if phase >= 2 and phase != 4 and phase != 5:
            acceleration = 0.0
    for column in range(len(limits)):
        limits[column] *= factors[column]
    return count, excess


@internal
def slow_ends(key_speeds: Floats, leg: int, limits: Floats, floors: Floats, faster: float) -> None:
    """Lower the speeds at a leg's ends to the leg's limits.

    They become lower still if a ramp's limits are at their floors. ``faster`` is the higher speed
    of its ends. Limits below ``floors`` are raised to these.
    """
    is_low = False
    for column in range(4):
        is_low = is_low or limits[column] < floors[column]
        limits[column] = max(limits[column], floors[column])
    most = limits[4]
    if is_low:
        # Small steps keep the leg fast.
        most = min(most, 0.96 * faster)
    for end in (leg, leg + 1):
        if end > 0:
            key_speeds[end] = min(key_speeds[end], most)


@kernel
def solve_legs(
    pieces: Floats,
    limits: Floats,
    floors: Floats,
    durations: Floats,
    jerks: Floats,
    factors: Floats,
    laid: Floats,
    keys: Ints,
    key_speeds: Floats,
    acceleration: float,
    limited: JerkIntervals,
) -> float:
    """Lay the pieces of m legs in n intervals.

    Speeds at borders are lowered to the speeds reached. Return the factor of time that the pieces
    need; infinity if the robot is too fast at the start. A leg is laid again only if its limits or
    the speeds at its ends have changed. Arrays:

    * ``pieces``, shape (7 m + n, 6), as of :func:`lay_leg`, with a duration of zero in between
    * ``limits``, shape (m, 5), as of :func:`fill_leg`; ``floors``, shape (m, 4), their least values
    * ``durations``, ``jerks``, ``factors``, shape (7,), working memory
    * ``laid``, shape (m, 3): the speeds at the ends of each leg, and the factor of time, when laid
    * ``keys``, ``key_speeds``, shape (m + 1,): borders between legs, and speeds there
    """
    laid[:, 2] = math.inf
    excess = math.inf
    for _ in range(MAX_ROUNDS):
        for i in range(len(limits) - 1, 0, -1):
            length = limited.borders[keys[i + 1]] - limited.borders[keys[i]]
            key_speeds[i] = find_reach(
                durations[:3],
                jerks[:3],
                key_speeds[i + 1],
                0.0,
                key_speeds[i],
                length,
                limits[i, 2:4],
            )
        begin = acceleration
        excess = 0.0
        for i in range(len(limits)):
            length = limited.borders[keys[i + 1]] - limited.borders[keys[i]]
            speed = key_speeds[i]
            key_speeds[i + 1] = find_reach(
                durations[:3], jerks[:3], speed, begin, key_speeds[i + 1], length, limits[i, :2]
            )
            after = key_speeds[i + 1]
            if laid[i, 0] != speed or laid[i, 1] != after or laid[i, 2] > 1.0 + ROUNDING:
                if not fill_leg(durations, jerks, speed, begin, after, length, limits[i]):
                    return math.inf
                first = LEG_PHASES * i + keys[i]
                last = LEG_PHASES * (i + 1) + keys[i + 1]
                pieces[first:last, 5] = 0.0
                _, need = lay_leg(
                    pieces,
                    first,
                    durations,
                    jerks,
                    speed,
                    begin,
                    keys[i],
                    keys[i + 1] - 1,
                    limits[i],
                    factors,
                    limited,
                )
                laid[i, 0] = speed
                laid[i, 1] = after
                laid[i, 2] = need
                slow_ends(key_speeds, i, limits[i], floors[i], max(speed, after))
            excess = max(excess, laid[i, 2])
            begin = 0.0
        if excess <= 1.0 + ROUNDING:
            break
    return excess


@kernel
def solve_stop(
    pieces: Floats,
    limits: Floats,
    durations: Floats,
    jerks: Floats,
    factors: Floats,
    ends: Ints,
    speed: float,
    acceleration: float,
    limited: JerkIntervals,
) -> tuple[int, float]:
    """Lay the pieces of one ramp to rest.

    ``limits`` are its acceleration and jerk; ``ends``, shape (2,), are the first and last border.
    Return the number of pieces and the factor of time that they need; arrays are as in
    :func:`solve_legs`.
    """
    # Numba would compile its callees anew for a literal zero.
    first = ends[0]
    count = first
    excess = math.inf
    least = 0.5 * acceleration**2 / max(speed, TINY)
    for _ in range(MAX_ROUNDS):
        if acceleration < 0.0:
            # A slower change would turn the robot back.
            limits[1] = max(limits[1], least)
        if fill_ramp(durations, jerks, speed, acceleration, 0.0, limits) > limited.borders[ends[1]]:
            return 0, math.inf
        count, excess = lay_leg(
            pieces,
            first,
            durations,
            jerks,
            speed,
            acceleration,
            first,
            ends[1] - 1,
            limits,
            factors,
            limited,
        )
        if excess <= 1.0 + ROUNDING:
            break
    return count, excess

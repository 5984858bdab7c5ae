"""Paths of trajectories without their times, and other motions along them.

A motion that waits and slows down on its way is searched among labels: a place between two pieces,
a speed there, and how much later the robot gets there than at full speed. On a piece, the
acceleration is constant. Of labels that are nearly alike the earliest is kept, as in safe intervals
(M. Phillips and M. Likhachev, "SIPP: safe interval path planning for dynamic environments", 2011).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cspace.inside import Bools, Floats, Ints, number_parts
from planners._motion.segments import place_along
from planners._motion.timing import (
    MIN_SPEED,
    Phases,
    bound_squares,
    find_excess,
    is_motion,
    join_phases,
    measure_intervals,
)
from planners._motion.trajectory import SPEED_ROUNDING, Trajectory

TIME_SHARE: Final = 1.0 - 1e-5
"""Share of a least time that is proven. The rest covers rounding and the largest ramps."""

PLACE_SHARE: Final = 1e-9
"""Largest distance of equal places, as a share of the length of the way."""

ROOT_STEPS: Final = 50
"""Number of halvings that find a time."""

SPEED_BINS: Final = 16
"""Number of speeds that labels of one place and time tell apart."""

MAX_DELAYS: Final = 400
"""Largest number of times, one window apart, by which a robot may be late."""

CONTROLS: Final = 0.0, 0.5, 1.0
"""Shares of the largest change of the squared speed on a piece that are tried, up and down."""


class PathPieces(NamedTuple):
    """The path of a trajectory, cut into n pieces, which the robot drives from rest to rest.

    Attributes
    ----------
    segments : ndarray of int, shape (n,)
    begins, lengths : ndarray of float64, shape (n,)
        Length along the segment before each piece, and of the piece.
    rate_shares, bend_shares : ndarray of float64, shape (n, c)
        Numbers p and q of c limits ``p |u| + q x <= 1`` of the acceleration u along the path and
        the squared speed x.
    squares : ndarray of float64, shape (n + 1,)
        Largest squared speeds between pieces.
    poses : ndarray of float64, shape (2 n + 1, size)
        Configurations at ends and in the middles of pieces.
    travel : ndarray of float64, shape (2 n + 1,)
        Bounds of how far any point of the robot moves up to these, metres.
    metres : ndarray of float64, shape (n + 1,)
        How far the reference point moves up to the ends of pieces.
    least_times : ndarray of float64, shape (n,)
        Seconds that no motion from rest to rest within the limits falls below on a piece.
    passes : ndarray of float64, shape (2, n + 1)
        Seconds at which the trajectory reaches and leaves the ends of pieces.
    """

    segments: Ints
    begins: Floats
    lengths: Floats
    rate_shares: Floats
    bend_shares: Floats
    squares: Floats
    poses: Floats
    travel: Floats
    metres: Floats
    least_times: Floats
    passes: Floats


def cut_way(trajectory: Trajectory, lever: float, size: float, most: int) -> PathPieces:
    """Cut the path of a trajectory that begins at rest into pieces.

    ``lever`` is the largest distance of a point of the robot from its reference point. No point of
    the robot moves farther than ``size`` in a piece, metres; if that makes more than ``most``
    pieces, somewhat farther.
    """
    segments, rotations, bounds = trajectory._segments, trajectory._rotations, trajectory._bounds
    first = float(trajectory._phases.positions[0])
    whole = measure_intervals(segments, rotations, bounds, first)
    dim = bounds.velocity.dim
    ahead = np.linalg.norm(whole.rates[:, :dim], axis=1)
    around = lever * np.linalg.norm(whole.rates[:, dim:], axis=1)
    travel = (ahead + around) * whole.lengths
    largest = max(size, float(travel.sum()) / most)
    counts = np.maximum(np.ceil(travel / largest), 1.0).astype(np.int64)
    owners, numbers = number_parts(counts)
    lengths = (whole.lengths / counts)[owners]
    begins = whole.begins[owners] + numbers * lengths
    # Between parts with one limit, the robot keeps both limits, or stops.
    joins = np.cumsum(counts)[:-1]

    def bound(caps: Floats, rate_shares: Floats, bend_shares: Floats) -> Floats:
        """Return the largest squared speeds (n + 1,)."""
        squares = np.zeros(len(owners) + 1)
        squares[1:-1] = np.minimum(caps[owners[:-1]], caps[owners[1:]])
        squares[joins] = np.where(whole.end_caps[1:-1] > 0.0, squares[joins], 0.0)
        bound_squares(lengths, rate_shares, bend_shares, squares)
        return squares

    rate_shares, bend_shares = whole.rate_shares[owners], whole.bend_shares[owners]
    squares = bound(whole.caps, rate_shares, bend_shares)
    # Bounds on curves are not reached, so there the robot is as fast as it likes.
    is_curved = whole.is_curved[owners]
    shares = np.where(is_curved[:, np.newaxis], MIN_SPEED, rate_shares)
    caps = np.where(whole.is_curved, np.inf, whole.hard_caps)
    tops = bound(caps, shares, np.where(is_curved[:, np.newaxis], 0.0, bend_shares))

    rows = np.repeat(np.arange(len(owners)), 2)
    places = begins[rows] + np.arange(len(rows)) % 2 * 0.5 * lengths[rows]
    places = np.append(places, begins[-1] + lengths[-1])
    parts = segments.select(whole.owners[owners[np.append(rows, rows[-1])]])
    poses = place_along(parts, rotations, places)[0]
    # Configurations at the ends of pieces are joined by chords, in the least time.
    steps = rotations.steps_between(poses[:-1:2], poses[2::2])
    chords = bounds.velocity.shares(steps).max(axis=1)
    even = np.flatnonzero(~is_curved)
    limits = lengths[even], rate_shares[even].max(axis=1), caps[owners[even]]
    chords[even] = np.maximum(chords[even], _measure_times(tops[even], tops[even + 1], *limits))
    moved = (0.5 * travel / counts)[owners[rows]] * (1.0 + SPEED_ROUNDING)
    numbers = whole.owners[owners]
    return PathPieces(
        *(numbers, begins, lengths, rate_shares, bend_shares, squares, poses),
        travel=np.append(0.0, np.cumsum(moved)),
        metres=np.append(0.0, np.cumsum(ahead[owners] * lengths)),
        least_times=TIME_SHARE * chords,
        passes=_find_passes(trajectory, numbers, begins, lengths),
    )


def _measure_times(
    before: Floats, after: Floats, lengths: Floats, rates: Floats, caps: Floats
) -> Floats:
    """Return the least seconds on pieces with one limit, between squared speeds at their ends."""
    means = 0.5 * (before + after)
    peaks = np.minimum(caps, means + lengths / rates)
    speeds = np.sqrt(np.maximum(peaks, MIN_SPEED))
    changes = rates * (2.0 * speeds - np.sqrt(before) - np.sqrt(after))
    return np.asarray(changes + np.maximum(lengths - rates * (peaks - means), 0.0) / speeds)


def _find_passes(trajectory: Trajectory, segments: Ints, begins: Floats, lengths: Floats) -> Floats:
    """Return the seconds at which a trajectory reaches and leaves ends of pieces, (2, n + 1)."""
    phases = trajectory._phases
    firsts = np.cumsum(trajectory._segments.lengths) - trajectory._segments.lengths
    places = firsts[segments] + begins
    places = np.append(places, places[-1] + lengths[-1])
    slack = PLACE_SHARE * max(float(places[-1]), 1.0)
    targets = np.array([places - slack, places + slack])
    low, high = np.zeros(targets.shape), np.full(targets.shape, phases.times[-1])
    for _ in range(ROOT_STEPS):
        middle = 0.5 * (low + high)
        numbers = np.maximum(np.searchsorted(phases.times, middle, side="right") - 1, 0)
        along = phases.at(numbers, middle - phases.times[numbers])[0]
        is_before = firsts[phases.segments[numbers]] + along < targets
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return np.asarray(high)


def wait_first(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Return a trajectory that begins at rest, after a wait at its start."""
    if seconds <= 0.0:
        return trajectory
    phases = trajectory._phases
    later = phases._replace(times=phases.times + seconds)
    wait = Phases._make(column[:1].copy() for column in phases)
    wait.speeds[0] = wait.accelerations[0] = wait.jerks[0] = 0.0
    joined = Phases._make(np.concatenate(pair) for pair in zip(wait, later, strict=True))
    made = replace(trajectory, _phases=joined)
    return made._set_rows(made._row_times(0.1))  # seconds


class Labels(NamedTuple):
    """Motions up to one place between pieces, by which a search goes on, shape (k,) each.

    Attributes
    ----------
    times : ndarray of float64
        Seconds at which the robot goes on.
    squares : ndarray of float64
        Squared speeds.
    arrivals : ndarray of float64
        Seconds at which the robot gets there; before ``times`` if it waits.
    origins : ndarray of int
        Numbers of labels at the place before.
    """

    times: Floats
    squares: Floats
    arrivals: Floats
    origins: Ints


def drive_around(
    trajectory: Trajectory,
    way: PathPieces,
    is_free: Bools,
    borders: Floats,
    arrivals: tuple[float, float],
) -> Trajectory | None:
    """Find an early motion along a way that keeps to free cells, with waits on the way.

    Parameters
    ----------
    trajectory : Trajectory
    way : PathPieces
        The path of the trajectory, in n pieces.
    is_free : ndarray of bool, shape (n, count)
        Whether the robot may be on a piece in a window of time.
    borders : ndarray of float64, shape (count + 1,)
        Seconds at which windows of one length begin and end.
    arrivals : tuple of float
        Seconds, a lower bound of the arrival, and the latest one. The robot stays at the end until
        the last border.

    Returns
    -------
    Trajectory or None
        None if no motion is found, or the trajectory limits its jerk.
    """
    speeds = np.sqrt(way.squares)
    full = 2.0 * way.lengths / np.maximum(speeds[:-1] + speeds[1:], MIN_SPEED)
    fastest = np.append(0.0, np.cumsum(full))
    if trajectory._bounds.jerk is not None or not way.metres[-1] or not is_free[0, 0]:
        return None
    bound, last = (each - float(fastest[-1]) for each in arrivals)
    law, delay = None, max(bound, 0.0) + 1.0  # seconds
    while law is None:
        # Few labels are late by little, so the delay grows.
        most = min(delay, last)
        law = _DriveSearch(way, is_free, borders, fastest, most).run()
        if law is None and (delay >= last or delay > MAX_DELAYS * borders[1]):
            return None
        delay *= 2.0
    rests, squares = law
    before, after = np.sqrt(squares[:-1]), np.sqrt(squares[1:])
    drives = 2.0 * way.lengths / (before + after)
    gains = np.diff(squares) / (2.0 * way.lengths)
    # Each piece has two phases: a rest before it, and the drive.
    none = 0.0 * rests
    ends = np.append(np.repeat(way.begins, 2), way.begins[-1] + way.lengths[-1])
    phases = join_phases(
        np.column_stack([rests, drives]).ravel(),
        np.append(np.repeat(way.segments, 2), way.segments[-1]),
        ends,
        np.column_stack([none, before]).ravel(),
        np.column_stack([none, gains]).ravel(),
        np.zeros(2 * len(rests)),
    )
    path = trajectory._segments, trajectory._rotations, phases, trajectory._bounds
    places = np.concatenate([trajectory.positions[:1], trajectory.positions[-1:]])
    segments, rotations, _, bounds = path
    if not is_motion(places, *path) or find_excess(segments, rotations, bounds, phases):
        return None
    made = replace(trajectory, _phases=phases)
    return made._set_rows(made._row_times(0.1))  # seconds


class _DriveSearch:
    """The search for a motion along a way; see :func:`drive_around`."""

    def __init__(
        self, way: PathPieces, is_free: Bools, borders: Floats, fastest: Floats, delay: float
    ) -> None:
        """Count the windows that are not free."""
        self._way = way
        self._is_free = is_free
        self._borders = borders
        self._window = float(borders[1])
        self._fastest = fastest
        # Number of times, one window apart, by which the robot may be late.
        self._delays = min(int(delay / self._window), MAX_DELAYS) + 1
        taken = np.cumsum(~is_free, axis=1)
        self._taken = np.pad(taken, ((0, 0), (1, 0)))

    def run(self) -> tuple[Floats, Floats] | None:
        """Return the rests before pieces (n,) and squared speeds (n + 1,), or None."""
        n = len(self._way.lengths)
        start = np.zeros(1)
        labels = [self._wait(0, Labels(start, start, start, np.zeros(1, dtype=np.int64)))]
        for piece in range(n):
            found = self._drive(piece, labels[-1])
            if not len(found.times):
                return None
            labels.append(self._wait(piece + 1, found) if piece + 1 < n else found)
        # It stays at the end.
        windows = self._find_windows(labels[n].times)
        stays = self._taken[n - 1, -1] == self._taken[n - 1, windows]
        if not stays.any():
            return None
        number = int(np.argmin(np.where(stays, labels[n].times, np.inf)))
        rests, squares = np.zeros(n), np.zeros(n + 1)
        for piece in range(n - 1, -1, -1):
            number = int(labels[piece + 1].origins[number])
            label = labels[piece]
            rests[piece] = label.times[number] - label.arrivals[number]
            squares[piece] = label.squares[number]
        return rests, squares

    def _find_windows(self, times: Floats) -> Ints:
        """Return the windows that hold times."""
        windows = (times / self._window).astype(np.int64)
        return np.minimum(windows, len(self._borders) - 2)

    def _wait(self, place: int, labels: Labels) -> Labels:
        """Add labels of robots that wait at a place with a free cell before or behind."""
        rests = np.flatnonzero(labels.squares == 0.0)
        if not len(rests):
            return labels
        rests = rests[np.argsort(labels.times[rests])]
        ahead = self._is_free[place]
        may_stay = ahead | self._is_free[place - 1] if place else ahead
        leaves = self._fastest[place] + self._window * np.arange(1, self._delays)
        leaves = leaves[leaves < self._borders[-1]]
        windows = self._find_windows(leaves)
        numbers = np.arange(len(may_stay))
        since = np.maximum.accumulate(np.where(may_stay, -1, numbers)) + 1
        # The first one that arrived since the place became free waits, too.
        arrivals = labels.times[rests]
        first = np.searchsorted(arrivals, self._borders[since[windows]])
        waits = may_stay[windows] & (first < len(rests))
        waits[waits] = arrivals[first[waits]] < leaves[waits]
        first = rests[first[waits]]
        moving = np.arange(len(labels.times))
        rows = np.concatenate([moving, first])
        times = np.concatenate([labels.times, leaves[waits]])
        return Labels(times, labels.squares[rows], labels.arrivals[rows], labels.origins[rows])

    def _drive(self, piece: int, labels: Labels) -> Labels:
        """Return the labels after a piece, the earliest of those that are nearly alike."""
        way = self._way
        length, top = way.lengths[piece], float(way.squares[piece + 1])
        rates, bends = way.rate_shares[piece][:, np.newaxis], way.bend_shares[piece][:, np.newaxis]
        before = labels.squares
        slowing = (np.maximum(1.0 - bends * before, 0.0) / np.maximum(rates, MIN_SPEED)).min(axis=0)
        least = np.maximum(before - 2.0 * slowing * length, 0.0)
        most = ((2.0 * length + rates * before) / (rates + 2.0 * length * bends)).min(axis=0)
        most = np.minimum(np.maximum(most, before), top)
        ups = [most + share * (before - most) for share in CONTROLS]
        downs = [before + share * (least - before) for share in CONTROLS[1:]]
        after = np.array([*ups, *downs])
        speeds = np.sqrt(before) + np.sqrt(after)
        times = labels.times + 2.0 * length / np.maximum(speeds, MIN_SPEED)
        delays = np.maximum(times - self._fastest[piece + 1], 0.0) / self._window
        is_good = (after >= least) & (after <= most) & (delays < self._delays)
        is_good &= times < self._borders[-1]
        _, origins = np.nonzero(is_good)
        times, after, delays = times[is_good], after[is_good], delays[is_good]
        first, last = self._find_windows(labels.times[origins]), self._find_windows(times)
        is_open = self._taken[piece, last + 1] == self._taken[piece, first]
        times, after, origins = times[is_open], after[is_open], origins[is_open]
        shares = np.sqrt(after / top) if top else after
        bins = np.ceil(shares * (SPEED_BINS - 1)).astype(np.int64)
        bins[after >= (1.0 - 1e-9) * top] = SPEED_BINS
        bins[after == 0.0] = 0
        keys = bins * self._delays + delays[is_open].astype(np.int64)
        # On short pieces the speed changes by less than a bin, so the slowest is kept, too.
        is_kept = np.zeros(len(keys), dtype=np.bool_)
        for values in (times, after):
            order = np.argsort(-values)
            chosen = np.full((SPEED_BINS + 1) * self._delays, -1)
            # The last one of equal keys stays.
            chosen[keys[order]] = order
            is_kept[chosen[chosen >= 0]] = True
        kept = np.flatnonzero(is_kept)
        return Labels(times[kept], after[kept], times[kept], origins[kept])

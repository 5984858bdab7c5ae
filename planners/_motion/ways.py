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
from planners._motion.segments import bound_derivatives, place_along
from planners._motion.timing import (
    MAX_ERROR,
    MIN_SPEED,
    Phases,
    find_excess,
    is_motion,
    join_phases,
)
from planners._motion.trajectory import SPEED_ROUNDING, Trajectory

ROOT_STEPS: Final = 50
"""Number of halvings that find a time."""

SPEED_BINS: Final = 16
"""Number of speeds that labels of one place and time tell apart."""

MAX_DELAYS: Final = 400
"""Largest number of times, one window apart, by which a robot may be late."""

CONTROLS: Final = 0.0, 0.5, 1.0
"""Shares of the largest change of the squared speed on a piece that are tried, up and down."""


class PathPieces(NamedTuple):
    """The path of a trajectory, cut into n pieces of its phases; the last piece is the end.

    Attributes
    ----------
    segments : ndarray of int, shape (n,)
    begins, lengths : ndarray of float64, shape (n,)
        Length along the segment before each piece, and of the piece.
    rate_shares, bend_shares : ndarray of float64, shape (n, c)
        Numbers p and q of c limits ``p |u| + q x <= 1`` of the acceleration u along the path and
        the squared speed x.
    squares : ndarray of float64, shape (n + 1,)
        Squared speeds of the trajectory between pieces. Without a limit of jerk, they change evenly
        along each piece.
    poses : ndarray of float64, shape (2 n + 1, size)
        Configurations at ends and in the middles of pieces.
    travel : ndarray of float64, shape (2 n + 1,)
        Bounds of how far any point of the robot moves up to these, metres.
    metres : ndarray of float64, shape (n + 1,)
        How far the reference point moves up to the ends of pieces.
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
    passes: Floats

    @property
    def least_times(self) -> Floats:
        """Seconds on pieces of a robot that is as fast as the trajectory, shape (n,)."""
        return np.asarray(self.passes[0, 1:] - self.passes[1, :-1])


def cut_way(trajectory: Trajectory, lever: float, size: float, most: int) -> PathPieces:
    """Cut the path of a trajectory that begins at rest into pieces.

    ``lever`` is the largest distance of a point of the robot from its reference point. No point of
    the robot moves farther than ``size`` in a piece, metres; if that makes more than ``most``
    pieces, somewhat farther.
    """
    bounds, phases = trajectory._bounds, trajectory._phases
    lengths = np.append(np.maximum(phases.ends()[0] - phases.positions[:-1], 0.0), 0.0)
    driven = trajectory._segments.select(phases.segments)
    derivatives = np.array(bound_derivatives(driven, phases.positions, lengths))
    dim = bounds.velocity.dim
    ahead = np.linalg.norm(derivatives[0, :, :dim], axis=1) * lengths
    around = lever * np.linalg.norm(derivatives[0, :, dim:], axis=1) * lengths
    travel = ahead + around
    largest = max(size, float(travel.sum()) / most)
    counts = np.ceil(travel / largest).astype(np.int64)
    # Rests are no pieces, except the end.
    counts = np.maximum(counts, np.append(lengths[:-1] > 0.0, True))
    owners, numbers = number_parts(counts)
    lengths = lengths[owners] / counts[owners]
    begins = phases.positions[owners] + numbers * lengths
    elapsed = np.where(numbers > 0, _find_elapsed(phases, owners, begins), 0.0)
    leaves = phases.times[owners] + elapsed
    reaches = np.where(numbers > 0, leaves, np.append(0.0, phases.times[owners[:-1] + 1]))
    passes = np.array([reaches, leaves])

    rows = np.repeat(np.arange(len(owners)), 2)
    places = begins[rows] + np.arange(len(rows)) % 2 * 0.5 * lengths[rows]
    poses = place_along(driven.select(owners[rows]), trajectory._rotations, places)[0]
    moved = (0.5 * travel / np.maximum(counts, 1))[owners[rows]] * (1.0 + SPEED_ROUNDING)
    # Rounding must not exclude the accelerations of the trajectory.
    rate_shares, bend_shares = bounds.acceleration.shares(derivatives)[:, owners] * (1 - MAX_ERROR)
    return PathPieces(
        *(phases.segments[owners], begins, lengths, np.maximum(rate_shares, MIN_SPEED)),
        bend_shares=bend_shares,
        squares=np.append(phases.at(owners, elapsed)[1] ** 2, 0.0),
        poses=np.concatenate([poses, poses[-1:]]),
        travel=np.append(0.0, np.cumsum(moved)),
        metres=np.append(0.0, np.cumsum((ahead / np.maximum(counts, 1))[owners])),
        passes=np.column_stack([passes, phases.times[[-1, -1]]]),
    )


def _find_elapsed(phases: Phases, numbers: Ints, places: Floats) -> Floats:
    """Return the seconds after the starts of phases until lengths along segments, shape (n,)."""
    low, high = np.zeros(len(numbers)), np.append(phases.durations, 0.0)[numbers]
    for _ in range(ROOT_STEPS):
        middle = 0.5 * (low + high)
        is_before = phases.at(numbers, middle)[0] < places
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

    It is nowhere faster than the trajectory.

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
    fastest = np.append(0.0, np.cumsum(way.least_times))
    bound, last = (each - float(fastest[-1]) for each in arrivals)
    if trajectory._bounds.jerk is not None or last < 0.0 or not is_free[0, 0]:
        return None
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
    drives = 2.0 * way.lengths / np.maximum(before + after, MIN_SPEED)
    gains = np.diff(squares) / (2.0 * np.maximum(way.lengths, MIN_SPEED))
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
        slowing = (np.maximum(1.0 - bends * before, 0.0) / rates).min(axis=0)
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
        is_good &= times <= self._borders[-1]
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

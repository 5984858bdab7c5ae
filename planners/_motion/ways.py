"""Paths of trajectories without their times, and other motions along them."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cspace.inside import Floats, Ints, number_parts
from planners._motion.segments import place_along
from planners._motion.timing import MIN_SPEED, Phases, bound_squares, measure_intervals
from planners._motion.trajectory import SPEED_ROUNDING, Trajectory

TIME_SHARE: Final = 1.0 - 1e-5
"""Share of a least time that is proven. The rest covers rounding and the largest ramps."""

PLACE_SHARE: Final = 1e-9
"""Largest distance of equal places, as a share of the length of the way."""

ROOT_STEPS: Final = 50
"""Number of halvings that find a time."""


class Way(NamedTuple):
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


def cut_way(trajectory: Trajectory, lever: float, size: float, most: int) -> Way:
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
    return Way(
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

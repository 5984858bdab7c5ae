"""Smooth paths: proven curves in place of the corners of a path.

A robot that follows straight edges stops at their corners. A smooth path turns evenly instead, so
that the robot may drive on. It is a uniform cubic B-spline, whose curvature is continuous.

*Smoothing.* The path is sampled evenly in the time that it takes at full speed. Two filters
``1 / (1 - l^2 d^2)`` in turn smooth the control points, where l is about the time in which the
robot reaches full speed. Such a filter is positive, so it adds no waves. Corners close together
become one wide turn.

*Pegs.* Short paths pass obstacles closely at their corners, and a smoothed path would cut these. So
each corner is a peg, and the curve passes outside it. The pushes of the pegs are the smallest that
do so: a quadratic programme, solved by non-negative least squares.

*Proofs.* All curves and the straight edges that are left are proven together. A peg pulls an
unproven part back towards the path, at most twice. If it is still unproven, the corner beside it
becomes a stop; after some rounds this happens at once. Between two stops without a corner, the path
is the edge again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from scipy.linalg.lapack import dptsv, dtrtrs

from cspace._rotations import Rotations
from cspace._rotations.base import shorter
from cspace._support.arrays import Bools, Floats, Ints
from planners._segments import (
    Segments,
    align_quaternions,
    join_segments,
    make_lines,
    place_along,
)

SMOOTHING: Final = 1.0
"""Length of the filters, relative to the time in which the robot reaches full speed."""

STEPS_PER_RAMP: Final = 6
"""Number of control points in the time in which the robot reaches full speed."""

MIN_STEPS: Final = 12
"""Smallest number of steps between the control points of a curve."""

MAX_STEPS_PER_EDGE: Final = 12
"""Largest mean number of steps for each edge that a curve replaces. A long edge is nearly straight
in its middle, where more would gain nothing."""

PEG_CELLS: Final = 0.1
"""Distance in cells by which a curve passes outside its corners, for the boxes that prove it."""

PEG_SOFTNESS: Final = 1e-6
"""Share of the largest effect of a push that is added to each, because corners may coincide."""

PULL_SHARE: Final = 0.75
"""Share of the way to the path that such a peg pulls a curve back."""

MAX_PULLS: Final = 2
"""Largest number of pegs that pull an unproven part of a curve back towards the path."""

MAX_PULL_ROUNDS: Final = 6
"""Number of proofs after which unproven parts are no longer pulled, but lead to stops at once."""

MAX_TURN: Final = 2.8
"""Largest turn of a robot between two drives without a stop, radians."""

MIN_BEND: Final = 1e-9
"""Smallest change of the velocities at a corner, relative to full speed."""

ROUNDING: Final = 1e-13
"""Largest step that is a rounding error, relative to the coordinates of the path, or radians."""

MIN_TURN: Final = 1e-12
"""Smallest turn on the spot, radians; rounding decides the directions of edges that closely."""

TO_POLYNOMIAL: Final = (
    np.array(
        [
            [1.0, 4.0, 1.0, 0.0],
            [-3.0, 0.0, 3.0, 0.0],
            [6.0, -12.0, 6.0, 0.0],
            [-6.0, 18.0, -18.0, 6.0],
        ]
    )
    / 6.0
)
"""Matrix from four control points to the value and the three derivatives at the start of a span."""


class LimitRates(NamedTuple):
    """Limits of velocity or acceleration."""

    linear: Floats  # shape (), of the whole translation, or (dim,), of each axis
    angular: float | None
    dim: int

    def largest(self, rates: Floats) -> Floats:
        """Return the largest multiple of each row of rates within the limits, shape (m,)."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.shares(rates).max(axis=1))

    def shares(self, rates: Floats) -> Floats:
        """Return the shares of the limits that rates use, shape (m, limits)."""
        return np.sqrt(self.multiply(rates, rates))

    def multiply(self, first: Floats, second: Floats) -> Floats:
        """Return the products of rates over the squares of their limits, shape (m, limits)."""
        products = first * second
        linear = products[:, : self.dim] / self.linear**2
        if not self.linear.ndim:
            linear = linear.sum(axis=1, keepdims=True)
        if self.angular is None:
            return linear
        angular = products[:, self.dim :].sum(axis=1, keepdims=True) / self.angular**2
        return np.concatenate([linear, angular], axis=1)


@dataclass(frozen=True, slots=True)
class Course:
    """Places that straight edges join, and what a robot does there.

    Attributes
    ----------
    rows : ndarray of float64, shape (n, size)
        Configurations, no two after each other equal up to rounding.
    places : ndarray of float64, shape (n, k)
        The same in coordinates that are added like vectors; only x and y of a robot that drives.
    signs : ndarray of int64, shape (n - 1,)
        1 if the robot drives an edge ahead, -1 in reverse, 0 if it need not point ahead.
    stops : ndarray of bool, shape (n,)
        Whether the robot must stop, as at start and goal.
    yaws : tuple of n lists of float
        Yaws between which a robot that drives turns on the spot, for each place.
    """

    rows: Floats
    places: Floats
    signs: Ints
    stops: Bools
    yaws: tuple[list[float], ...]


def measure_sizes(rows: Floats, rotations: Rotations) -> Floats:
    """Return the largest coordinates of a path, shape (k,); 1 radian for rotations.

    The translation of a robot that rotates has one size, because its axes mix.
    """
    dim = rows.shape[1] - len(rotations.names)
    sizes = np.abs(rows[:, :dim]).max(axis=0)
    if not rotations.names:
        return np.asarray(sizes)
    angles = rotations._steps_between(rows[:1], rows[:1])[0, dim:]
    return np.concatenate([np.full(dim, sizes.max()), np.ones(len(angles))])


def find_moves(rows: Floats, rotations: Rotations) -> Bools:
    """Return which coordinates change by more than rounding between rows, shape (n - 1, k)."""
    steps = rotations._steps_between(rows[:-1], rows[1:])
    return np.asarray(np.abs(steps) > ROUNDING * measure_sizes(rows, rotations))


def find_course(rows: Floats, rotations: Rotations) -> Course:
    """Return the course of a robot that moves in all directions."""
    moves = find_moves(rows, rotations).any(axis=1)
    rows = align_quaternions(rows[np.concatenate([[True], moves])], rotations)
    steps = rotations._steps_between(rows[:-1], rows[1:])
    stops = np.zeros(len(rows), dtype=np.bool_)
    if "qw" in rotations.names:
        # Rotations in space do not add up like vectors.
        rotates = find_moves(rows, rotations)[:, -3:].any(axis=1)
        stops[:-1] |= rotates
        stops[1:] |= rotates
    stops[[0, -1]] = True
    start = np.zeros((1, steps.shape[1]))
    places = np.concatenate([start, np.cumsum(steps, axis=0)])
    return Course(rows, places, np.zeros(len(steps), dtype=np.int64), stops, ())


def find_driven_course(rows: Floats, rotations: Rotations) -> Course:
    """Return the course of a robot that drives and turns on the spot."""
    drives = np.flatnonzero(find_moves(rows, rotations)[:, :2].any(axis=1))
    first_rows = np.concatenate([[0], drives + 1])
    last_rows = np.concatenate([drives, [len(rows) - 1]])
    spans = zip(first_rows, last_rows, strict=True)
    yaws = tuple(rows[first : last + 1, 2].tolist() for first, last in spans)
    places = np.column_stack([rows[first_rows, :2], np.zeros(len(first_rows))])
    steps = np.diff(places[:, :2], axis=0)
    headings = rows[last_rows[:-1], 2]
    ahead = np.cos(headings) * steps[:, 0] + np.sin(headings) * steps[:, 1]
    signs = np.where(ahead < 0.0, -1, 1)
    stops = np.ones(len(places), dtype=np.bool_)
    stops[1:-1] = (signs[1:] != signs[:-1]) | (np.abs(shorter(np.diff(headings))) > MAX_TURN)
    return Course(places, places, signs, stops, yaws)


class Peg(NamedTuple):
    """A half space in which the curve lies at a time."""

    time: float  # seconds at full speed
    place: Floats  # (k,), a point of its border
    direction: Floats  # (k,), unit vector inward, in seconds at full speed


class Layout(NamedTuple):
    """A path with some smooth parts."""

    segments: Segments
    windows: Floats  # (m, 2), full-speed times of the path between which each segment lies
    is_smooth: bool  # whether there is a curve


@dataclass(slots=True)
class Smoother:
    """Smooth versions of a course.

    Attributes
    ----------
    course : Course
    rotations : Rotations
    fastest : ndarray of float64, shape (k,)
        Largest velocity along each coordinate.
    bounds : tuple of two ndarray of float64, shape (dim,)
        Bounds of the positions.
    times : ndarray of float64, shape (n,)
        Seconds from the start to each place at full speed.
    ramps : ndarray of float64, shape (n - 1,)
        Seconds in which the robot reaches full speed along each edge.
    stops : ndarray of bool, shape (n,)
        Places where the robot stops.
    pegs : list of Peg
        Those at corners, then those that pull the curve back.
    corners : int
        Number of pegs at corners.
    runs : dict
        Paths between two stops, by these and the number of pegs in between.
    """

    course: Course
    rotations: Rotations
    fastest: Floats
    bounds: tuple[Floats, Floats]
    times: Floats
    ramps: Floats
    stops: Bools
    pegs: list[Peg]
    corners: int
    runs: dict[tuple[int, int, int], Layout]

    @classmethod
    def of(
        cls,
        course: Course,
        rotations: Rotations,
        velocity: LimitRates,
        acceleration: LimitRates,
        bounds: tuple[Floats, Floats],
        gap: float,
    ) -> Smoother:
        """Make the smoother of a course."""
        steps = np.diff(course.places, axis=0)
        durations = 1.0 / velocity.largest(steps)
        rates = steps / durations[:, np.newaxis]
        times = np.concatenate([[0.0], np.cumsum(durations)])
        ramps = 1.0 / acceleration.largest(rates)
        units = np.eye(steps.shape[1])
        fastest = np.minimum(velocity.largest(units), np.finfo(float).max)
        pegs = _find_corner_pegs(course.places, times, fastest, gap)
        return cls(
            course=course,
            rotations=rotations,
            fastest=fastest,
            bounds=bounds,
            times=times,
            ramps=ramps,
            stops=course.stops.copy(),
            pegs=pegs,
            corners=len(pegs),
            runs={},
        )

    def lay_out(self) -> Layout | None:
        """Lay out the smooth path, with turns on the spot at its stops.

        If the pegs between two stops contradict each other, return None and stop in between.
        """
        ends = np.flatnonzero(self.stops)
        runs = []
        for first, last in itertools.pairwise(ends.tolist()):
            try:
                runs.append(self._find_run(first, last))
            except (RuntimeError, np.linalg.LinAlgError):
                self._add_stop(0.5 * float(self.times[first] + self.times[last]))
                return None
        parts: list[Segments] = []
        windows: list[Floats] = []
        if not self.course.yaws:
            parts = [run.segments for run in runs]
            windows = [run.windows for run in runs]
        else:
            arrivals = [None, *(float(run.segments.ends[-1, 2]) for run in runs)]
            leavings = [*(float(run.segments.starts[0, 2]) for run in runs), None]
            for k, place in enumerate(ends.tolist()):
                turns = self._lay_turns(place, arrivals[k], leavings[k])
                parts.append(turns)
                windows.append(np.full((len(turns.lengths), 2), self.times[place]))
                if k < len(runs):
                    parts.append(runs[k].segments)
                    windows.append(runs[k].windows)
        is_smooth = any(run.is_smooth for run in runs)
        return Layout(join_segments(parts), np.concatenate(windows), is_smooth)

    def repair(self, layout: Layout, proven: Bools, may_pull: bool) -> bool:
        """Add pegs or stops near unproven segments; return False if nothing is left to change.

        Unless it ``may_pull`` curves back by pegs, it adds stops only.
        """
        failed = np.flatnonzero(~proven)
        stretches = np.split(failed, np.flatnonzero(np.diff(failed) > 1) + 1)
        is_curve = layout.segments.is_curve
        peg_times = np.array([peg.time for peg in self.pegs])
        is_changed = False
        pulled: list[int] = []
        for stretch in stretches:
            begin = layout.windows[stretch[0], 0]
            end = layout.windows[stretch[-1], 1]
            is_pulled = may_pull and bool(is_curve[stretch].all())
            near = (peg_times[self.corners :] >= begin) & (peg_times[self.corners :] <= end)
            if is_pulled and np.count_nonzero(near) < MAX_PULLS:
                pulled.append(int(stretch[len(stretch) // 2]))
                is_changed = True
            else:
                is_changed |= self._add_stop(0.5 * (begin + end))
        if pulled:
            self.pegs += self._find_pegs(layout, pulled)
        return is_changed

    def _add_stop(self, time: float) -> bool:
        """Stop at a corner near a time; return False if the robot stops at both corners beside."""
        after = int(np.searchsorted(self.times, time))
        near = np.arange(max(after - 2, 0), min(after + 2, len(self.stops)))
        near = near[~self.stops[near]]
        if not len(near):
            return False
        self.stops[near[np.argmin(np.abs(self.times[near] - time))]] = True
        return True

    def _find_pegs(self, layout: Layout, middles: list[int]) -> list[Peg]:
        """Return pegs that pull unproven curves back towards the path."""
        curves = layout.segments.select(np.array(middles))
        points = place_along(curves, self.rotations, 0.5 * curves.lengths)[0]
        times = layout.windows[middles].mean(axis=1)
        edges = np.clip(np.searchsorted(self.times, times) - 1, 0, len(self.ramps) - 1)
        places = np.column_stack(
            [np.interp(times, self.times, column) for column in self.course.places.T]
        )
        steps = places - self.course.places[edges]
        rows = self.rotations._add_steps(self.course.rows[edges], steps)
        offsets = self.rotations._steps_between(rows, points)
        if self.course.yaws:
            offsets[:, 2] = 0.0
        pegs = []
        for time, place, offset in zip(times, places, offsets, strict=True):
            inward = -offset / self.fastest
            size = np.linalg.norm(inward)
            if size > 0.0:
                pegs.append(Peg(float(time), place + (1.0 - PULL_SHARE) * offset, inward / size))
        return pegs

    def _find_run(self, first: int, last: int) -> Layout:
        """Return the path between two stops, laid out once for the same pegs."""
        begin, end = self.times[[first, last]].tolist()
        pegs = [peg for peg in self.pegs if begin < peg.time < end]
        key = (first, last, len(pegs))
        if key not in self.runs:
            self.runs[key] = self._lay_run(first, last, pegs)
        return self.runs[key]

    def _lay_run(self, first: int, last: int, pegs: list[Peg]) -> Layout:
        """Lay out the path between two stops: a straight edge or a smooth curve."""
        course = self.course
        window = self.times[[first, last]]
        sign = int(course.signs[first])
        if last == first + 1:
            step = course.places[last] - course.places[first]
            length = np.linalg.norm(step)
            rates = (step / length)[np.newaxis]
            starts = course.rows[[first]]
            ends = course.rows[[last]]
            if sign:
                yaw = math.atan2(sign * step[1], sign * step[0])
                starts = np.array([[*starts[0, :2], yaw]])
                ends = np.array([[*ends[0, :2], yaw]])
            line = make_lines(starts, rates, np.array([length]), ends)
            return Layout(line, window[np.newaxis], False)
        points = self._smooth(first, last, pegs)
        step_time = float((window[1] - window[0]) / (len(points) - 1))
        control = _add_ends(points)
        spans = np.stack([control[k : len(control) - 3 + k] for k in range(4)])
        values = np.tensordot(TO_POLYNOMIAL, spans, axes=1)
        offsets = values[0] - course.places[first]
        starts = self.rotations._add_steps(
            np.repeat(course.rows[[first]], len(offsets), 0), offsets
        )
        rates = values[1] / step_time
        if sign:
            starts[:, 2] = np.arctan2(sign * rates[:, 1], sign * rates[:, 0])
        last_rate = sign * (points[-1] - points[-2])
        end = course.rows[last].copy()
        if sign:
            end[2] = math.atan2(last_rate[1], last_rate[0])
        count = len(starts)
        # Where bounds stop several control points in one place, the curve has no length.
        sizes = measure_sizes(course.rows, self.rotations)
        moves = (np.ptp(spans, axis=0) > ROUNDING * sizes).any(axis=1)
        curves = Segments(
            starts=starts,
            rates=rates,
            bends=values[2] / step_time**2,
            twists=values[3] / step_time**3,
            curvatures=np.zeros(count),
            drives=np.full(count, sign),
            lengths=np.full(count, step_time),
            ends=np.concatenate([starts[1:], [end]]),
        )
        knots = np.linspace(window[0], window[1], count + 1)
        windows = np.column_stack([knots[:-1], knots[1:]])
        return Layout(curves.select(moves), windows[moves], True)

    def _smooth(self, first: int, last: int, pegs: list[Peg]) -> Floats:
        """Return the control points of a smooth curve between two stops, shape (m + 1, k)."""
        times = self.times[first : last + 1]
        places = self.course.places[first : last + 1]
        ramps = self.ramps[first:last]
        total = float(times[-1] - times[0])
        median = float(np.sort(ramps)[len(ramps) // 2])
        steps = math.ceil(STEPS_PER_RAMP * total / median)
        steps = min(max(steps, MIN_STEPS), MAX_STEPS_PER_EDGE * (last - first))
        knots = np.linspace(times[0], times[-1], steps + 1)
        points = np.column_stack([np.interp(knots, times, column) for column in places.T])
        if not pegs:
            return points
        # The filters' squared lengths in steps, between the points.
        halfway = 0.5 * (knots[1:] + knots[:-1])
        edges = np.clip(np.searchsorted(times, halfway) - 1, 0, len(ramps) - 1)
        lengths = SMOOTHING * ramps[edges]
        squares = (lengths * steps / total) ** 2
        diagonal = 1.0 + squares[:-1] + squares[1:]
        beside = -squares[1:-1]
        forces = -np.diff(squares[:, np.newaxis] * np.diff(points, axis=0), axis=0)
        size = points.shape[1]

        # The columns are displacements of the polygon, and responses to unit forces at the pegs.
        # All are zero at both ends.
        outward = np.array([peg.direction for peg in pegs])
        targets = np.array([peg.place for peg in pegs])
        peg_times = np.array([peg.time for peg in pegs])
        index, weights = _weigh_points((peg_times - times[0]) / total * steps, steps)
        units = np.zeros((steps + 3, len(pegs)))
        units[index.T, np.arange(len(pegs))] = weights.T
        # The outermost control points continue the lines of the two beside them.
        units[2] -= units[0]
        units[-3] -= units[-1]
        once = dptsv(diagonal, beside, np.column_stack([forces, units[2:-2]]))[2]
        once[:, :size] += forces
        columns = np.zeros((steps + 1, size + len(pegs)))
        columns[1:-1] = dptsv(diagonal, beside, once)[2]
        columns[:, :size] = points - columns[:, :size]
        at_pegs = np.einsum("cj,cjk->ck", weights, _add_ends(columns)[index])
        depths = ((targets - at_pegs[:, :size]) / self.fastest * outward).sum(axis=1)
        pushes = _solve_pushes((outward @ outward.T) * at_pegs[:, size:], depths)
        pushed = columns[:, size:] @ (pushes[:, np.newaxis] * outward)
        if not np.abs(pushed).max() <= self.times[-1]:
            raise RuntimeError("pegs push the curve farther away than the path is long")
        moved: Floats = columns[:, :size] + pushed * self.fastest

        lower, upper = self.bounds
        dim = min(len(lower), self.course.rows.shape[1])
        offset = self.course.rows[first, :dim] - places[0, :dim]
        inner = moved[1:-1, :dim] + offset
        moved[1:-1, :dim] = np.clip(inner, lower[:dim], upper[:dim]) - offset
        return moved

    def _lay_turns(self, place: int, arrival: float | None, leaving: float | None) -> Segments:
        """Lay out the turns on the spot at a stop."""
        x, y = self.course.places[place, :2].tolist()
        given = self.course.yaws[place]
        yaws = given[1:-1]
        yaws = [given[0] if arrival is None else arrival, *yaws]
        yaws = [*yaws, given[-1] if leaving is None else leaving]
        rows: list[tuple[float, ...]] = []
        for first, last in itertools.pairwise(yaws):
            turn = float(shorter(np.array(last - first)))
            if abs(turn) > MIN_TURN:
                rows.append((x, y, first, math.copysign(1.0, turn), abs(turn), x, y, last))
        table = np.array(rows).reshape(-1, 8)
        none = np.zeros((len(table), 2))
        rates = np.column_stack([none, table[:, 3]])
        return make_lines(table[:, :3], rates, table[:, 4], table[:, 5:])


def _find_corner_pegs(places: Floats, times: Floats, fastest: Floats, gap: float) -> list[Peg]:
    """Return the pegs at corners, ``gap`` metres outside them."""
    rates = np.diff(places, axis=0) / np.diff(times)[:, np.newaxis]
    bends = np.diff(rates / fastest, axis=0)
    sizes = np.linalg.norm(bends, axis=1)
    pegs = []
    for k in np.flatnonzero(sizes > MIN_BEND).tolist():
        outward = -bends[k] / sizes[k]
        place = places[k + 1] + gap / fastest[0] * outward * fastest
        pegs.append(Peg(float(times[k + 1]), place, outward))
    return pegs


def _weigh_points(shares: Floats, steps: int) -> tuple[Ints, Floats]:
    """Return the control points of a B-spline's values, and their weights, shape (c, 4).

    ``shares``, shape (c,), count steps from the start.
    """
    spans = np.minimum(shares.astype(np.int64), steps - 1)
    u = shares - spans
    powers = np.column_stack([np.ones(len(u)), u, u**2 / 2.0, u**3 / 6.0])
    return spans[:, np.newaxis] + np.arange(4), powers @ TO_POLYNOMIAL


def _add_ends(points: Floats) -> Floats:
    """Add the control points that continue the lines of the first and the last two."""
    ahead = 2.0 * points[:1] - points[1:2]
    behind = 2.0 * points[-1:] - points[-2:-1]
    return np.concatenate([ahead, points, behind])


def _solve_pushes(effects: Floats, depths: Floats) -> Floats:
    """Return the smallest pushes, shape (c,), whose effects reach the depths.

    They minimise ``p @ effects @ p / 2 - depths @ p`` for p >= 0, by least squares with a root of
    the matrix.
    """
    softness = PEG_SOFTNESS * effects.max()
    root = np.linalg.cholesky(effects + softness * np.eye(len(depths)))
    target, _ = dtrtrs(root, depths, lower=True)
    pushes, _ = scipy.optimize.nnls(root.T, target)
    return np.asarray(pushes)


def smooth_path(smoother: Smoother, prove: Callable[[Segments], Bools]) -> Layout | None:
    """Return the smoothest proven path, or None if there is none with a curve.

    It ends: after the rounds that may pull, each round adds a stop, and there are as many as
    corners.
    """
    known: dict[bytes, bool] = {}
    rounds = 0
    while True:
        layout = smoother.lay_out()
        if layout is None:
            continue
        if not layout.is_smooth:
            return None
        proven = _prove_new(layout.segments, prove, known)
        if proven.all():
            return layout
        if not smoother.repair(layout, proven, rounds < MAX_PULL_ROUNDS):
            return None
        rounds += 1


def _prove_new(
    segments: Segments, prove: Callable[[Segments], Bools], known: dict[bytes, bool]
) -> Bools:
    """Return which segments are proven, and prove those that are not known yet."""
    table = np.column_stack(segments)
    keys = table.view(f"V{table.strides[0]}").ravel().tolist()
    new = np.array([key not in known for key in keys], dtype=np.bool_)
    if new.any():
        answers = prove(segments.select(new)).tolist()
        new_keys = (keys[k] for k in np.flatnonzero(new))
        known.update(zip(new_keys, answers, strict=True))
    return np.array([known[key] for key in keys], dtype=np.bool_)

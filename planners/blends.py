"""Blends: proven curves in place of the corners of a path.

A robot that follows straight edges stops at their corners. A blend leaves the edge before a corner,
and joins the next one beyond it, without a jump of the velocity. Like an edge, it is proven free.

*Parabolas.* A holonomic robot or an arm takes a corner with constant acceleration, along a parabola
in its configurations (T. Kunz and M. Stilman, "Time-optimal trajectory generation for path
following with bounded acceleration and velocity", 2012, section IV).

*Turns while driving.* A differential drive drives on at constant speed, and turns as it would on
the spot. Its curvature rises and falls evenly, along clothoids, with an arc in between if it
reaches the limit of the angular velocity or the lateral acceleration.

*Corners move.* Short paths pass obstacles closely, and a curve inside such a corner would cut it.
So the corner is moved outward, such that the middle of its blend comes to lie where the corner was.

*Proofs.* All blends, and the straight lines that are left, are proven together. Blends beside an
unproven part become smaller by half, until all is proven; tiny ones are the corners again. If an
edge without blends is unproven, the path keeps all its edges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from cspace.interface import Space
from cspace.rotations import Rotations
from cspace.rotations.base import wrapped
from cspace.support.arrays import Bools, Floats, Ints
from planners.local_planner import LocalPlanner

MIN_SHARE: Final = 1e-3
"""Smallest size of a parabola, relative to its edges or to what full speed needs; at corners of
smaller ones the robot stops."""

MIN_REACH_CELLS: Final = 0.01
"""Smallest distance in cells from the start of a turn while driving to its corner."""

BOX_CELLS: Final = 0.5
"""Half sides of the largest boxes that prove a blend on a map, in cells."""

BOX_LEVELS: Final = 3
"""Number of sizes of boxes, each a quarter of the one before."""

BOX_RADIANS: Final = math.radians(2.5)
"""Largest rotation of the largest boxes to either side, radians."""

MAX_TURN: Final = 2.8
"""Largest turn of a differential drive in a blend, radians; near pi its corner is far away."""

CORNER_SHIFT_CELLS: Final = 0.2
"""Distance in cells by which the middle of a blend passes outside its corner, for the boxes."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
QUADRATURE: Final = (0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS)
"""Nodes and weights on [0, 1]; exact to rounding along a clothoid that turns by half a blend."""

MIN_LENGTH: Final = 1e-12
"""Smallest length of a straight line, metres, radians or seconds; shorter ones are left out."""

MAX_BLEND_STEP: Final = 1e-8
"""Largest jump of the rates between a blend and a line, relative to these, for rounding."""

MAX_EDGE_TURN: Final = 3.0
"""Largest turn of an edge that is proven as a whole, radians; at pi rounding decides its side."""

FITS: Final = 3
"""Rounds in which the speeds of turns are fitted to the lengths of drives."""

MIN_TURN: Final = 1e-9
"""Change of direction, relative to the rates, below which an edge goes straight on."""


class Segments(NamedTuple):
    """The m straight parts, arcs, clothoids and parabolas of a path."""

    starts: Floats  # (m, size), configurations
    rates: Floats  # (m, k), translation and rotation vector, or joints, per unit of length
    bends: Floats  # (m, k), change of the rates per unit of length, in fixed directions
    curvatures: Floats  # (m,), radians per unit of length by which the direction turns left
    sharpness: Floats  # (m,), change of the curvature per unit of length
    lengths: Floats  # (m,)
    ends: Floats  # (m, size), configurations

    def select(self, index: Ints | Bools) -> Segments:
        """Return some of the segments."""
        return Segments(*(column[index] for column in self))


class LimitRates(NamedTuple):
    """Limits of velocity or acceleration."""

    linear: Floats  # shape (), of the whole translation, or (dim,), of each axis
    angular: float | None
    dim: int

    def largest(self, rates: Floats) -> Floats:
        """Return the largest multiple of each row of rates within the limits, shape (m,)."""
        dim = self.dim
        moved = np.abs(rates[:, :dim])
        if not self.linear.ndim:
            moved = np.linalg.norm(rates[:, :dim], axis=1, keepdims=True)
        turned = np.linalg.norm(rates[:, dim:], axis=1)
        with np.errstate(divide="ignore"):
            largest: Floats = (self.linear / moved).min(axis=1)
            return largest if self.angular is None else np.minimum(largest, self.angular / turned)


def align_quaternions(rows: Floats, rotations: Rotations) -> Floats:
    """Return configurations whose quaternions continue the ones before, for any rotations."""
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
    """Return configurations at lengths along segments, and their derivatives by the length.

    ``s`` has shape (m,). The derivatives are translations and rotation vectors, shape (m, k).
    """
    length = s[:, np.newaxis]
    curvatures = segments.curvatures + segments.sharpness * s
    turned = s * (segments.curvatures + 0.5 * segments.sharpness * s)
    steps = segments.rates * length
    bent = np.flatnonzero(segments.sharpness)
    arcs = np.flatnonzero((segments.sharpness == 0.0) & (segments.curvatures != 0.0))
    half = 0.5 * turned[arcs]
    # The chord of an arc, over the arc, is the sinc of half its angle.
    steps[arcs, :2] = turn_left(steps[arcs, :2], half) * np.sinc(half / np.pi)[:, np.newaxis]
    if len(bent):
        parts = QUADRATURE[0][:, np.newaxis] * s[bent]
        headings = np.arctan2(segments.rates[bent, 1], segments.rates[bent, 0])
        speeds = np.hypot(segments.rates[bent, 0], segments.rates[bent, 1])
        angles = headings + parts * (
            segments.curvatures[bent] + 0.5 * segments.sharpness[bent] * parts
        )
        steps[bent, 0] = speeds * s[bent] * (QUADRATURE[1] @ np.cos(angles))
        steps[bent, 1] = speeds * s[bent] * (QUADRATURE[1] @ np.sin(angles))
    steps += 0.5 * segments.bends * length**2
    first = segments.rates + segments.bends * length
    second = segments.bends.copy()
    if len(bent) or len(arcs):
        first[:, :2] = turn_left(first[:, :2], turned)
        sideways = np.column_stack([-first[:, 1], first[:, 0]])
        second[:, :2] += curvatures[:, np.newaxis] * sideways
    return rotations.add_steps(segments.starts, steps), first, second


def turn_left(vectors: Floats, angles: Floats) -> Floats:
    """Turn plane vectors, shape (n, 2), left by angles."""
    cos = np.cos(angles)
    sin = np.sin(angles)
    x, y = vectors.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


class Layout(NamedTuple):
    """A path with some blends, in m segments."""

    segments: Segments
    speeds: Floats  # (m,), largest speeds, lengths per second
    accelerations: Floats  # (m,), largest accelerations; zero where the speed is constant
    corners: Ints  # (m, 2), corners whose blends shape each segment; -1 for none
    sizes: Floats  # (n - 2,), sizes of the blends, zero where the robot stops


@dataclass(frozen=True, slots=True)
class MotionBounds:
    """Limits of a robot, and the bounds of its positions.

    Attributes
    ----------
    velocity, acceleration : LimitRates
    lateral : float
        Largest lateral acceleration of a differential drive.
    lower, upper : ndarray of float64, shape (dim,)
        Bounds that moved corners keep.
    gap : float
        Distance by which the middle of a blend passes outside its corner.
    min_reach : float
        Smallest distance from the start of a turn while driving to its corner.
    """

    velocity: LimitRates
    acceleration: LimitRates
    lateral: float
    lower: Floats
    upper: Floats
    gap: float
    min_reach: float

    @property
    def turning_acceleration(self) -> float:
        """Largest angular acceleration of a robot that turns."""
        return float(self.acceleration.angular or math.inf)


class Parabolas:
    """Parabolic blends of straight edges.

    The length of an edge is its duration at full speed, so that the rates are the velocities then.
    The size of a blend is the time from its start to its corner, and from there to its end. It
    wants as much as full speed needs.

    Attributes
    ----------
    rows : ndarray of float64, shape (n, size)
        Configurations that edges join, no two after each other equal.
    """

    def __init__(self, rows: Floats, rotations: Rotations, bounds: MotionBounds) -> None:
        self.rows = align_quaternions(rows, rotations)
        self.rotations = rotations
        self.bounds = bounds
        self.largest = np.full(max(len(rows) - 2, 0), np.inf)
        if "qw" in rotations.names:
            # Rotations in space do not add up like vectors.
            steps = rotations.steps_between(rows[:-1], rows[1:])
            rotates = np.abs(steps[:, -3:]).max(axis=1) > MIN_LENGTH
            self.largest[rotates[:-1] | rotates[1:]] = 0.0

    def lay_out(self, largest: Floats) -> Layout:
        """Lay out blends of at most the ``largest`` sizes, shape (n - 2,)."""
        bounds = self.bounds
        while True:
            _, rates, sizes = self._fit(self.rows, largest)
            is_moved = sizes > 0.0
            rows = self._move_corners(rates, sizes)
            times, rates, sizes = self._fit(rows, np.where(is_moved, largest, 0.0))
            if (sizes[is_moved] > 0.0).all():
                break
            # Corners without a blend stay where they were.
            largest = np.where(sizes > 0.0, largest, 0.0)
        before = np.concatenate([[0.0], sizes])
        after = np.concatenate([sizes, [0.0]])
        starts = self.rotations.add_steps(rows[:-1], rates * before[:, np.newaxis])
        ends = self.rotations.add_steps(rows[1:], -rates * after[:, np.newaxis])
        edges = np.arange(len(rates))
        zeros = np.zeros(len(rates))
        ends_of_edges = np.column_stack([edges - 1, np.where(edges < len(sizes), edges, -1)])
        lines = Layout(
            Segments(starts, rates, 0.0 * rates, zeros, zeros, times - before - after, ends),
            zeros + 1.0,
            bounds.acceleration.largest(rates),
            ends_of_edges,
            sizes,
        )
        corners = np.flatnonzero(sizes)
        half = sizes[corners, np.newaxis]
        bends = (rates[corners + 1] - rates[corners]) / (2.0 * half)
        entries = self.rotations.add_steps(rows[corners + 1], -half * rates[corners])
        exits = self.rotations.add_steps(rows[corners + 1], half * rates[corners + 1])
        none = np.zeros(len(corners))
        blends = Layout(
            Segments(entries, rates[corners], bends, none, none, 2.0 * sizes[corners], exits),
            np.minimum(np.sqrt(bounds.acceleration.largest(bends)), 1.0),
            none,
            np.column_stack([corners, corners]),
            sizes,
        )
        kept = np.flatnonzero(lines.segments.lengths > MIN_LENGTH)
        order = np.argsort(np.concatenate([2 * edges[kept], 2 * corners + 1]))
        return _join_layouts(_select(lines, kept), blends, order)

    def _fit(self, rows: Floats, largest: Floats) -> tuple[Floats, Floats, Floats]:
        """Return durations and rates of edges, and the sizes that fit into them."""
        steps = self.rotations.steps_between(rows[:-1], rows[1:])
        times = 1.0 / self.bounds.velocity.largest(steps)
        rates = steps / times[:, np.newaxis]
        turns = np.diff(rates, axis=0)
        needs = 0.5 / self.bounds.acceleration.largest(turns)
        needs[np.abs(turns).max(axis=1, initial=0.0) <= MIN_TURN] = 0.0
        smallest = MIN_SHARE * np.minimum(needs, np.minimum(times[:-1], times[1:]))
        sizes = np.minimum(np.minimum(needs, largest), self.largest)
        sizes *= _shares(sizes, times)
        return times, rates, np.where(sizes > smallest, sizes, 0.0)

    def _move_corners(self, rates: Floats, sizes: Floats) -> Floats:
        """Return the rows, corners moved outward so that blends pass outside them."""
        turns = np.diff(rates, axis=0)
        turned = np.maximum(np.linalg.norm(turns, axis=1), np.finfo(float).tiny)
        distances = np.where(sizes > 0.0, 0.25 * sizes + self.bounds.gap / turned, 0.0)
        rows = self.rows.copy()
        rows[1:-1] = self.rotations.add_steps(rows[1:-1], -distances[:, np.newaxis] * turns)
        dim = len(self.bounds.lower)
        moved = 1 + np.flatnonzero(sizes)
        rows[moved, :dim] = np.clip(rows[moved, :dim], self.bounds.lower, self.bounds.upper)
        return rows


class DrivingTurns:
    """Blends of a differential drive, which turns while it drives at constant speed.

    The size of a blend is its speed. It wants full speed.

    Attributes
    ----------
    places : ndarray of float64, shape (n, 2)
        Positions that straight drives join, no two after each other equal.
    yaws : list of n lists of float
        Yaws between which the robot turns on the spot at each place.
    headings : ndarray of float64, shape (n - 1,)
        Yaws of the robot while it drives.
    signs : ndarray of float64, shape (n - 1,)
        1 if the robot drives ahead, -1 in reverse.
    """

    def __init__(self, rows: Floats, rotations: Rotations, bounds: MotionBounds) -> None:
        drives = np.flatnonzero((rows[1:, :2] != rows[:-1, :2]).any(axis=1))
        first_rows = np.concatenate([[0], drives + 1])
        last_rows = np.concatenate([drives, [len(rows) - 1]])
        self.rotations = rotations
        self.bounds = bounds
        self.places = rows[first_rows, :2]
        self.yaws = [
            rows[first : last + 1, 2].tolist()
            for first, last in zip(first_rows, last_rows, strict=True)
        ]
        yaws = rows[last_rows[:-1], 2]
        self.headings = yaws
        steps = np.diff(self.places, axis=0)
        ahead = np.cos(yaws) * steps[:, 0] + np.sin(yaws) * steps[:, 1]
        self.signs = np.where(ahead < 0.0, -1.0, 1.0)
        fastest = float(np.min(bounds.velocity.linear))
        self.largest = np.where(self.signs[1:] == self.signs[:-1], fastest, 0.0)

    def lay_out(self, largest: Floats) -> Layout:
        """Lay out blends of at most the ``largest`` speeds, shape (n - 2,)."""
        while True:
            drives, sizes = self._fit(self.places, largest)
            is_moved = sizes > 0.0
            places = self._move_corners(drives, sizes)
            drives, sizes = self._fit(places, np.where(is_moved, largest, 0.0))
            if (sizes[is_moved] > 0.0).all():
                break
            # Corners without a blend stay where they were.
            largest = np.where(sizes > 0.0, largest, 0.0)
        turns = _measure_turns(drives.angles, sizes, self.bounds)
        blends = self._lay_blends(places, drives, sizes, turns)
        lines = self._lay_lines(places, drives, sizes, turns)
        corners = np.repeat(np.flatnonzero(sizes), 3)
        ranks = np.concatenate([lines.ranks, 2 * corners + 2])
        return _join_layouts(lines.layout, blends, np.argsort(ranks, kind="stable"))

    def _fit(self, places: Floats, largest: Floats) -> tuple[Drives, Floats]:
        """Return the drives between places, and the speeds at which blends fit between them."""
        steps = self.signs[:, np.newaxis] * np.diff(places, axis=0)
        metres = np.linalg.norm(steps, axis=1)
        is_kept = (places == self.places).all(axis=1)
        keeps_yaw = is_kept[:-1] & is_kept[1:]
        headings = np.where(keeps_yaw, self.headings, np.arctan2(steps[:, 1], steps[:, 0]))
        angles = wrapped(np.diff(headings))
        drives = Drives(headings, metres, angles)
        turned = np.abs(angles)
        sizes = np.minimum(largest, self.largest)
        sizes[(turned > MAX_TURN) | (turned <= MIN_TURN)] = 0.0
        for _ in range(FITS):
            reaches = _measure_turns(angles, sizes, self.bounds).reaches
            sizes *= _shares(reaches, metres)
        # A slower turn is shorter at least in proportion, so that rounding alone is left.
        sizes[_shares(reaches, metres) < 1.0] *= 1.0 - 1e-9
        reaches = _measure_turns(angles, sizes, self.bounds).reaches
        sizes[(_shares(reaches, metres) < 1.0) | (reaches < self.bounds.min_reach)] = 0.0
        return drives, sizes

    def _move_corners(self, drives: Drives, sizes: Floats) -> Floats:
        """Return the places, corners moved outward so that blends pass outside them."""
        apexes = _measure_turns(drives.angles, sizes, self.bounds).apexes
        ahead = self.signs * np.stack([np.cos(drives.headings), np.sin(drives.headings)])
        inward = np.diff(ahead).T
        inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), np.finfo(float).tiny)
        distances = np.where(sizes > 0.0, apexes + self.bounds.gap, 0.0)
        places = self.places.copy()
        places[1:-1] -= distances[:, np.newaxis] * inward
        moved = 1 + np.flatnonzero(sizes)
        places[moved] = np.clip(places[moved], self.bounds.lower, self.bounds.upper)
        return places

    def _lay_blends(self, places: Floats, drives: Drives, sizes: Floats, turns: Turns) -> Layout:
        """Lay out two clothoids, with an arc in between, for each blend."""
        corners = np.flatnonzero(sizes)
        speeds = sizes[corners]
        lefts = np.sign(drives.angles[corners])
        headings = drives.headings[corners]
        ramps = speeds * turns.ramps[corners]
        arcs = speeds * turns.arcs[corners]
        sharpness = lefts * self.bounds.turning_acceleration / speeds**2
        peaks = sharpness * ramps
        ahead = self.signs[corners, np.newaxis] * np.column_stack(
            [np.cos(headings), np.sin(headings)]
        )
        entries = places[corners + 1] - turns.reaches[corners, np.newaxis] * ahead
        starts = np.column_stack([entries, headings])
        none = np.zeros(len(corners))
        parts = []
        for curvature, change, length in (
            (none, sharpness, ramps),
            (peaks, none, arcs),
            (peaks, -sharpness, ramps),
        ):
            yaw = starts[:, 2]
            ahead = self.signs[corners, np.newaxis] * np.column_stack([np.cos(yaw), np.sin(yaw)])
            rates = np.column_stack([ahead, curvature])
            bends = np.column_stack([none, none, change])
            part = Segments(starts, rates, bends, curvature, change, length, starts)
            starts = place_along(part, self.rotations, length)[0]
            parts.append(part._replace(ends=starts))
        order = np.arange(3 * len(corners)).reshape(3, -1).T.ravel()
        joined = Segments(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        numbers = np.repeat(corners, 3)
        return Layout(
            joined.select(order),
            sizes[numbers],
            np.zeros(len(numbers)),
            np.column_stack([numbers, numbers]),
            sizes,
        )

    def _lay_lines(
        self, places: Floats, drives: Drives, sizes: Floats, turns: Turns
    ) -> RankedLayout:
        """Lay out the straight drives, and the turns on the spot where there is no blend."""
        reaches = np.concatenate([[0.0], np.where(sizes > 0.0, turns.reaches, 0.0), [0.0]])
        rows: list[tuple[float, ...]] = []
        for place in range(len(places)):
            is_blend = 0 < place <= len(sizes) and sizes[place - 1] > 0.0
            x, y = places[place].tolist()
            yaws = [] if is_blend else self._list_yaws(place, drives.headings)
            for first, last in itertools.pairwise(yaws):
                turn = float(wrapped(np.array(last - first)))
                if abs(turn) > MIN_LENGTH:
                    left = math.copysign(1.0, turn)
                    corners = place - 2, place if place < len(sizes) else -1
                    rates = (0.0, 0.0, left)
                    ends = (x, y, first, x, y, last)
                    rows.append((2 * place, *corners, *ends, *rates, abs(turn)))
            if place == len(drives.headings):
                break
            yaw = float(drives.headings[place])
            ahead_x = float(self.signs[place]) * math.cos(yaw)
            ahead_y = float(self.signs[place]) * math.sin(yaw)
            before = float(reaches[place])
            length = float(drives.metres[place]) - before - float(reaches[place + 1])
            if length > MIN_LENGTH:
                corners = place - 1, place if place < len(sizes) else -1
                x1, y1 = places[place + 1].tolist()
                after = float(reaches[place + 1])
                start = (x + before * ahead_x, y + before * ahead_y, yaw)
                end = (x1 - after * ahead_x, y1 - after * ahead_y, yaw)
                rates = (ahead_x, ahead_y, 0.0)
                rows.append((2 * place + 1, *corners, *start, *end, *rates, length))
        table = np.array(rows).reshape(-1, 13)
        rows_of_rates = table[:, 9:12]
        none = np.zeros(len(rows))
        layout = Layout(
            Segments(
                table[:, 3:6],
                rows_of_rates,
                0.0 * rows_of_rates,
                none,
                none,
                table[:, 12],
                table[:, 6:9],
            ),
            self.bounds.velocity.largest(rows_of_rates),
            self.bounds.acceleration.largest(rows_of_rates),
            table[:, 1:3].astype(np.int64),
            sizes,
        )
        return RankedLayout(layout, table[:, 0].astype(np.int64))

    def _list_yaws(self, place: int, headings: Floats) -> list[float]:
        """List the yaws between which the robot turns on the spot at a place."""
        yaws = list(self.yaws[place])
        if place == 0 or place == len(headings):
            yaws = yaws if len(yaws) > 1 else 2 * yaws
        else:
            yaws = [0.0, *yaws[1:-1], 0.0]
        if place > 0:
            yaws[0] = float(headings[place - 1])
        if place < len(headings):
            yaws[-1] = float(headings[place])
        return yaws


class Drives(NamedTuple):
    """Straight drives between places."""

    headings: Floats  # (n - 1,), yaws of the robot
    metres: Floats  # (n - 1,)
    angles: Floats  # (n - 2,), radians by which the robot turns left between two drives


class RankedLayout(NamedTuple):
    """A layout, and the rank of each segment along the path."""

    layout: Layout
    ranks: Ints


class Turns(NamedTuple):
    """Turns of n blends: a ramp of the angular velocity, a constant part, and a ramp."""

    ramps: Floats  # (n,), seconds of each ramp
    arcs: Floats  # (n,), seconds in between
    reaches: Floats  # (n,), metres from the start of the blend to the corner of its tangents
    apexes: Floats  # (n,), metres from that corner to the middle of the blend


def _measure_turns(angles: Floats, speeds: Floats, bounds: MotionBounds) -> Turns:
    """Return the fastest turns by angles, at constant speeds, shapes (n,)."""
    turned = np.abs(angles)
    acceleration = bounds.turning_acceleration
    speed = np.where(speeds > 0.0, speeds, 1.0)  # any, as a turn on the spot has no reach
    peaks = np.minimum(float(bounds.velocity.angular or math.inf), bounds.lateral / speed)
    ramps = np.minimum(np.sqrt(turned / acceleration), peaks / acceleration)
    at_peak = np.maximum(turned - acceleration * ramps**2, 0.0)
    rates = np.maximum(acceleration * ramps, np.finfo(float).tiny)
    arcs = at_peak / rates
    ramp_turns = 0.5 * acceleration * ramps**2
    nodes = QUADRATURE[0][:, np.newaxis]
    yaws = ramp_turns * nodes**2
    arc_yaws = ramp_turns + 0.5 * nodes * at_peak
    x = QUADRATURE[1] @ (ramps * np.cos(yaws) + 0.5 * arcs * np.cos(arc_yaws))
    y = QUADRATURE[1] @ (ramps * np.sin(yaws) + 0.5 * arcs * np.sin(arc_yaws))
    reaches = speeds * (x + y * np.tan(0.5 * turned))
    apexes = speeds * y / np.cos(0.5 * turned)
    return Turns(ramps, arcs, reaches, apexes)


def _shares(needs: Floats, lengths: Floats) -> Floats:
    """Return the share of each corner's need that fits, shape (n - 2,).

    ``lengths``, shape (n - 1,), are those of edges, which the corners at both ends share by their
    needs. At least half of an edge is left if the robot stops at one of its ends.
    """
    if not len(needs):
        return needs
    before = np.concatenate([[0.0], needs])
    after = np.concatenate([needs, [0.0]])
    # Beside a stop, a blend leaves half of the edge, on which the robot gathers speed.
    both = np.where(before == 0.0, after, before) + np.where(after == 0.0, before, after)
    shares = np.minimum(lengths, both) / np.maximum(both, np.finfo(float).tiny)
    return np.asarray(np.minimum(shares[:-1], shares[1:]))


def _select(layout: Layout, index: Ints) -> Layout:
    """Return some segments of a layout."""
    segments = layout.segments.select(index)
    speeds = layout.speeds[index]
    accelerations = layout.accelerations[index]
    return Layout(segments, speeds, accelerations, layout.corners[index], layout.sizes)


def _join_layouts(lines: Layout, blends: Layout, order: Ints) -> Layout:
    """Join lines and blends, and sort them along the path."""
    pairs = zip(lines.segments, blends.segments, strict=True)
    segments = Segments(*(np.concatenate(pair) for pair in pairs))
    joined = Layout(
        segments,
        np.concatenate([lines.speeds, blends.speeds]),
        np.concatenate([lines.accelerations, blends.accelerations]),
        np.concatenate([lines.corners, blends.corners]),
        lines.sizes,
    )
    return _select(joined, order)


def round_corners(
    corners: Parabolas | DrivingTurns, prove: Callable[[Segments], Bools]
) -> tuple[Layout, Bools]:
    """Lay out the largest blends that are proven, and return which segments are.

    ``prove`` returns whether segments are proven free.
    """
    largest = np.full(len(corners.largest), np.inf)
    known: dict[bytes, bool] = {}
    while True:
        layout = _shrink_slow_blends(corners, largest)
        proven = _prove_new(layout.segments, prove, known)
        failed = np.unique(layout.corners[~proven])
        failed = failed[failed >= 0]
        failed = failed[layout.sizes[failed] > 0.0]
        if not len(failed):
            return layout, proven
        largest[failed] = 0.5 * layout.sizes[failed]


def _shrink_slow_blends(corners: Parabolas | DrivingTurns, largest: Floats) -> Layout:
    """Lay out blends that are no larger than the speeds need that the robot can reach there.

    A blend has one speed, so a large one would slow the robot down beside a small one.
    """
    largest = largest.copy()
    while True:
        layout = corners.lay_out(largest)
        squares = find_squares(layout, corners.rotations)
        is_slow = (layout.accelerations == 0.0) & (squares[:-1] < 0.5 * layout.speeds**2)
        slow = np.unique(layout.corners[is_slow, 0])
        if not len(slow):
            return layout
        largest[slow] = 0.5 * layout.sizes[slow]


def find_squares(layout: Layout, rotations: Rotations) -> Floats:
    """Return the squares of the largest speeds at the ends of segments, shape (m + 1,)."""
    passes = find_passes(layout.segments, rotations)
    caps = layout.speeds**2
    squares = np.zeros(len(caps) + 1)
    squares[1:-1] = np.where(passes, np.minimum(caps[:-1], caps[1:]), 0.0)
    gains = 2.0 * layout.accelerations * layout.segments.lengths
    for k, gain in enumerate(gains.tolist()):
        squares[k + 1] = min(squares[k + 1], squares[k] + gain)
    for k, gain in reversed(list(enumerate(gains.tolist()))):
        squares[k] = min(squares[k], squares[k + 1] + gain)
    return squares


def find_passes(segments: Segments, rotations: Rotations) -> Bools:
    """Return whether the rates continue from each segment to the next, shape (m - 1,)."""
    ends = place_along(segments, rotations, segments.lengths)[1]
    jumps = np.abs(ends[:-1] - segments.rates[1:]).max(axis=1, initial=0.0)
    largest = np.maximum(np.abs(ends[:-1]), np.abs(segments.rates[1:])).max(axis=1, initial=0.0)
    return np.asarray(jumps <= MAX_BLEND_STEP * largest)


def _prove_new(
    segments: Segments, prove: Callable[[Segments], Bools], known: dict[bytes, bool]
) -> Bools:
    """Return which segments are proven, and prove those that are not known yet."""
    table = np.column_stack(segments)
    keys = [row.tobytes() for row in table]
    new = np.array([key not in known for key in keys], dtype=np.bool_)
    if new.any():
        answers = prove(segments.select(new)).tolist()
        new_keys = (keys[k] for k in np.flatnonzero(new))
        known.update(zip(new_keys, answers, strict=True))
    return np.array([known[key] for key in keys], dtype=np.bool_)


def prove_segments(space: Space, exact: bool, segments: Segments) -> Bools:
    """Return whether segments are proven free: straight ones as edges, blends by boxes or hulls.

    With ``exact``, the geometry decides straight ones in MIXED cells.
    """
    is_blend = segments.bends.any(axis=1) | (segments.curvatures != 0.0)
    proven = np.zeros(len(is_blend), dtype=np.bool_)
    lines = segments.select(~is_blend)
    steps = lines.rates * lines.lengths[:, np.newaxis]
    first_angle = space.dim if space.has_poses else 0
    turned = np.abs(steps[:, first_angle:]).max(axis=1, initial=0.0)
    # Edges turn the shorter way, so a large turn is proven in parts.
    counts = np.where(turned > MAX_EDGE_TURN, 2, 1)
    owners = np.repeat(np.arange(len(counts)), counts)
    parts = lines.select(owners)
    lengths = parts.lengths / counts[owners]
    begins = np.where(np.diff(owners, prepend=-1) == 0, lengths, 0.0)
    firsts = place_along(parts, space.rotations, begins)[0]
    halfway = place_along(parts, space.rotations, begins + lengths)[0]
    is_last = np.append(np.diff(owners) > 0, True)[: len(owners), np.newaxis]
    lasts = np.where(is_last, parts.ends, halfway)
    check = LocalPlanner(space, exact).edge_checker()
    edges = np.column_stack([firsts, lasts]).tolist()
    free = np.array([check(*edge) for edge in edges], dtype=np.bool_)
    unproven = np.bincount(owners[~free], minlength=len(counts))
    proven[~is_blend] = unproven == 0
    if is_blend.any():
        proven[is_blend] = prove_blends(space, segments.select(is_blend))
    return proven


def can_prove_blends(space: Space) -> bool:
    """Return True if a space has a proof for curves: cells, or hulls of an arm."""
    return hasattr(space, "is_free_around") or hasattr(space, "parabolas_are_free")


def prove_blends(space: Space, segments: Segments) -> Bools:
    """Return whether blends are proven free, shape (m,)."""
    if hasattr(space, "is_free_around"):
        return _prove_by_boxes(space, segments)
    if hasattr(space, "parabolas_are_free"):
        half = 0.5 * segments.lengths[:, np.newaxis]
        controls = segments.starts + half * segments.rates
        return np.asarray(space.parabolas_are_free(segments.starts, controls, segments.ends))
    return np.zeros(len(segments.lengths), dtype=np.bool_)


def _prove_by_boxes(space: Any, segments: Segments) -> Bools:
    """Return whether the cells around blends are FREE, shape (m,).

    Each blend is cut into pieces. A piece of length w stays within ``|q'| w / 2`` of its middle
    along each axis, where ``|q'|`` is the largest derivative on the blend. Pieces that are not
    proven are cut into four, twice. The proof of a blend does not depend on the others.
    """
    dim = space.dim
    cell = 2.0 * space.resolution
    m = len(segments.lengths)
    most = np.abs(segments.rates) + np.abs(segments.bends) * segments.lengths[:, np.newaxis]
    most[:, :2] = np.where(
        (segments.curvatures != 0.0)[:, np.newaxis] | (segments.sharpness != 0.0)[:, np.newaxis],
        1.0,
        most[:, :2],
    )
    proven = np.ones(m, dtype=np.bool_)
    moved = most[:, :dim].max(axis=1) * segments.lengths
    turned = most[:, dim:].max(axis=1, initial=0.0) * segments.lengths
    counts = np.ceil(np.maximum(moved / (2.0 * BOX_CELLS * cell), turned / (2.0 * BOX_RADIANS)))
    counts = np.maximum(counts, 1.0).astype(np.int64)
    owners = np.repeat(np.arange(m), counts)
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    widths = (segments.lengths / counts)[owners]
    middles = (np.arange(len(owners)) - firsts[owners] + 0.5) * widths
    for level in range(BOX_LEVELS):
        if level:
            owners = np.repeat(owners, 4)
            widths = 0.25 * np.repeat(widths, 4)
            middles = np.repeat(middles, 4) + np.tile([-1.5, -0.5, 0.5, 1.5], len(middles)) * widths
        q = place_along(segments.select(owners), space.rotations, middles)[0]
        distance = (BOX_CELLS / 4.0**level + 1e-9) * cell
        angle = BOX_RADIANS / 4.0**level + 1e-12
        free = np.asarray(space.is_free_around(q, distance, angle))
        owners = owners[~free]
        widths = widths[~free]
        middles = middles[~free]
        if not len(owners):
            break
    proven[owners] = False
    return proven

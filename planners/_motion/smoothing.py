"""Smooth paths: proven curves in place of the corners of a path.

A robot that follows straight edges stops at their corners. A smooth path turns evenly instead, so
that the robot may drive on. Between two stops it is a uniform cubic B-spline, whose curvature is
continuous.

*Fit.* The control points are sampled on the edges, evenly in the time at full speed. They move by
the least squares of their displacements and, weighed by the smoothing length, of their second
differences (a Whittaker smoother; P. Eilers, "A perfect smoother", 2003). Corners close together
become one wide turn.

*Via points.* Short paths pass obstacles closely at their corners, and a smoothed path would cut
these. So the curve passes through each corner with a large weight, unless it lies outside that
corner anyway (asymmetric least squares).

*Places on the way.* The fit has equations, with Lagrange multipliers, that make the curve pass
through these. A robot that drives straight through one also keeps its direction there. A place
becomes a stop if the curve has too few control points for it.

*Proofs.* All curves are proven together. Around an unproven part the smoothing length is reduced,
and after some tries the corner beside it becomes a stop. Between two stops without a corner, the
path keeps its edge.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded
from scipy.sparse.linalg import splu

from cspace import Rotations
from cspace.inside import Bools, Floats, Ints, wrap_angles
from planners._motion.segments import Segments, join_segments
from planners._motion.timing import MotionBounds

MAX_STEPS: Final = 200
"""Largest number of spans of a curve after a junction, unless its edges need more."""

FIXED: Final = 3
"""Number of control points at either end that stay on the edge, so the curve begins along it."""

VIA_CELLS: Final = 0.1
"""Distance in cells of a curve outside its corners, for the boxes that prove it."""

VIA_WEIGHT: Final = 1e5
"""Weight of a via point, relative to that of a displacement."""

MAX_MISS: Final = 1e-9
"""Largest error of the equations of a curve, relative to the size of its control points."""

REACH: Final = 2.0
"""Reach around an unproven part within which the curve is smoothed less, relative to the time in
which the robot reaches full speed."""

MAX_TURN: Final = 2.8
"""Largest turn of a robot between two drives without a stop, radians."""

MIN_BEND: Final = 1e-9
"""Smallest change of the velocities at a corner, relative to full speed."""

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


class Junction(NamedTuple):
    """Derivatives, at the start of a path, of the curve on which a moving robot arrives."""

    rates: Floats  # (k,), per second at full speed
    bends: Floats  # (k,), second derivatives


class Polyline(NamedTuple):
    """A path's m edges and m + 1 waypoints, without turns on the spot.

    Its k coordinates are added like vectors: translations and angles, or only x and y of a robot
    that drives. Times are seconds at full speed.
    """

    edges: Segments  # m straight ones
    numbers: Ints  # (m,), numbers of these edges in the path
    signs: Ints  # (m,), 1 if the robot drives ahead, -1 in reverse, 0 if it need not point ahead
    rates: Floats  # (m, k), changes of the coordinates per second
    ramps: Floats  # (m,), seconds in which the robot reaches full speed
    times: Floats  # (m + 1,), seconds from the start to each waypoint
    waypoints: Floats  # (m + 1, k), coordinates of the ends of the edges
    outward: Floats  # (m + 1, k), gradients of the time by which a point is outside a corner
    via_points: Floats  # (m + 1, k), points just outside the corners
    stops: Bools  # (m + 1,), True if the robot must stop at the waypoint
    held: Bools  # (m + 1,), True if it must pass through the waypoint
    junction: Junction | None  # None if the robot starts from rest


def make_polyline(
    edges: Segments,
    rotations: Rotations,
    bounds: MotionBounds,
    drives: bool,
    gap: float,
    junction: Junction | None,
    vias: Floats,
) -> Polyline:
    """Make the polyline of a path.

    Its via points lie ``gap`` metres outside the corners. It passes through the configurations
    ``vias``, shape (v, size), which are ends of edges.
    """
    numbers = np.arange(len(edges.lengths))
    if drives:
        numbers = np.flatnonzero(edges.rates[:, :2].any(axis=1))
    edges = edges.select(numbers)
    rates = edges.rates.copy()
    signs = np.zeros(len(numbers), dtype=np.int64)
    stops = np.zeros(len(numbers) + 1, dtype=np.bool_)
    stops[[0, -1]] = True
    if drives:
        rates[:, 2] = 0.0
        yaws = edges.starts[:, 2]
        ahead = np.cos(yaws) * rates[:, 0] + np.sin(yaws) * rates[:, 1]
        signs = np.where(ahead < 0.0, -1, 1)
        turns = np.abs(wrap_angles(np.diff(yaws)))
        stops[1:-1] = (signs[1:] != signs[:-1]) | (turns > MAX_TURN)
    if "qw" in rotations.names:
        # Rotations in space do not add up like vectors.
        rotates = rates[:, -3:].any(axis=1)
        stops[:-1] |= rotates
        stops[1:] |= rotates
    columns = slice(2) if drives else slice(None)
    is_via = (edges.ends[:-1, np.newaxis, columns] == vias[:, columns]).all(axis=2).any(axis=1)
    held = np.zeros_like(stops)
    held[1:-1] = is_via
    start = np.zeros((1, rates.shape[1]))
    steps = rates * edges.lengths[:, np.newaxis]
    waypoints = np.concatenate([start, np.cumsum(steps, axis=0)])
    fastest = np.minimum(bounds.velocity.largest(np.eye(rates.shape[1])), np.finfo(float).max)
    bends = np.zeros(waypoints.shape)
    bends[1:-1] = np.diff(rates / fastest, axis=0)
    sizes = np.linalg.norm(bends, axis=1, keepdims=True)
    outward = np.where(sizes > MIN_BEND, -bends / np.maximum(sizes, MIN_BEND), 0.0)
    return Polyline(
        edges=edges,
        numbers=numbers,
        signs=signs,
        rates=rates,
        ramps=1.0 / bounds.acceleration.largest(rates),
        times=np.append(0.0, np.cumsum(edges.lengths)),
        waypoints=waypoints,
        outward=outward / fastest,
        via_points=waypoints
        + np.where(held, 0.0, gap / fastest[0])[:, np.newaxis] * outward * fastest,
        stops=stops,
        held=held,
        junction=junction,
    )


@dataclass(slots=True)
class CurveSection:
    """Part of a polyline between two stops, which becomes one curve of n spans.

    Attributes
    ----------
    first, last : int
        Numbers of the waypoints at its ends.
    step : float
        Seconds at full speed between control points.
    points : ndarray of float64, shape (n + 3, k)
        Control points on the edges.
    smoothing : ndarray of float64, shape (n + 1,)
        Smoothing lengths at the inner control points, in steps.
    tries : int
        Number of times that the curve was not proven.
    """

    first: int
    last: int
    step: float
    points: Floats
    smoothing: Floats
    tries: int = 0

    @classmethod
    def between(cls, polyline: Polyline, first: int, last: int) -> CurveSection:
        """Sample the control points of a section."""
        times = polyline.times[first : last + 1]
        ramps = polyline.ramps[first:last]
        # A curve has eight spans, and four more for each edge that it replaces.
        steps = 8 + 4 * (last - first)
        junction = polyline.junction if first == 0 else None
        if junction is not None:
            # The robot reaches full speed within four spans or more.
            short_steps = 4 * (times[-1] - times[0]) / ramps[0]
            steps = int(np.clip(short_steps, steps, MAX_STEPS))
        step = float(times[-1] - times[0]) / steps
        marks = times[0] + step * np.arange(-1, steps + 2)
        waypoints = polyline.waypoints[first : last + 1]
        points = np.column_stack([np.interp(marks, times, column) for column in waypoints.T])
        shifts = step * np.array([[-1.0], [0.0], [1.0]])
        points[:FIXED] = waypoints[0] + shifts * polyline.rates[first]
        if junction is not None:
            # A B-spline begins at (P0 + 4 P1 + P2) / 6, with (P2 - P0) / 2 and P0 - 2 P1 + P2.
            bends = step**2 * junction.bends * np.array([[1.0 / 3.0], [-1.0 / 6.0], [1.0 / 3.0]])
            points[:FIXED] = waypoints[0] + shifts * junction.rates + bends
        points[-FIXED:] = waypoints[-1] + shifts * polyline.rates[last - 1]
        edges = np.clip(np.searchsorted(times, marks[1:-1]) - 1, 0, len(ramps) - 1)
        return cls(first, last, step, points, ramps[edges] / step)

    def fit(self, polyline: Polyline) -> tuple[Floats, list[int]]:
        """Fit a smooth curve.

        Return its control points, shape (n + 3, k), and the places on the way that it misses.
        """
        corners = np.arange(self.first + 1, self.last)
        corners = corners[polyline.outward[corners].any(axis=1) | polyline.held[corners]]
        outward = polyline.outward[corners]
        shares = (polyline.times[corners] - polyline.times[self.first]) / self.step
        spans = np.minimum(shares.astype(np.int64), len(self.points) - 4)
        u = shares - spans
        powers = np.column_stack([np.ones(len(u)), u, u**2 / 2.0, u**3 / 6.0])
        rows = powers @ TO_POLYNOMIAL
        slopes = powers[:, :3] @ TO_POLYNOMIAL[1:]
        columns = spans[:, np.newaxis] + np.arange(4)
        residuals = polyline.via_points[corners] - _combine(rows, self.points[columns])

        normal = np.zeros((4, len(self.points)))
        normal[3] = 1.0
        forces = np.zeros_like(self.points)
        bends = np.tile([1.0, -2.0, 1.0], (len(self.smoothing), 1))
        firsts = np.arange(len(bends))
        _add_rows(normal, forces, firsts, bends, self.smoothing**4, -np.diff(self.points, 2, 0))
        inner = slice(FIXED, -FIXED)
        is_place = polyline.held[corners]
        places = corners[is_place]
        matrix, sums = self.list_equations(
            polyline, places, spans[is_place], rows[is_place], slopes[is_place]
        )
        held = ~is_place
        # At most five fits find the corners through which the curve must pass.
        for _ in range(5):
            weights = np.where(held, VIA_WEIGHT, 0.0)
            held_normal = normal.copy()
            held_forces = forces.copy()
            _add_rows(held_normal, held_forces, spans, rows, weights, residuals)
            steps = np.zeros_like(self.points)
            steps[inner] = _solve(held_normal[:, inner], held_forces[inner], matrix, sums)
            left = residuals - _combine(rows, steps[columns])
            is_inside = ~is_place & ((left * outward).sum(axis=1) > 0.0)
            if (is_inside == held).all():
                break
            held = is_inside
        points = self.points + steps
        errors = np.abs(sums - matrix @ steps[inner].T.ravel())
        size = points.shape[1]
        largest = errors[: size * len(places)].reshape(-1, size).max(axis=1)
        return points, places[largest > MAX_MISS * np.abs(points).max()].tolist()

    def list_equations(
        self, polyline: Polyline, places: Ints, spans: Ints, rows: Floats, slopes: Floats
    ) -> tuple[sparse.csc_array, Floats]:
        """List the equations of a curve through waypoints.

        ``rows`` and ``slopes`` have shape (p, 4). Returns the factors of the steps of the inner
        control points, axis by axis, and the sums: first for each waypoint and each axis.
        """
        count, size = self.points.shape
        if not len(places):
            return sparse.csc_array((0, size * (count - 2 * FIXED))), np.zeros(0)
        is_straight = (polyline.signs[places] != 0) & ~polyline.outward[places].any(axis=1)
        rates = polyline.rates[places[is_straight]]
        across = np.zeros((len(rates), size))
        if len(rates):  # of a robot that drives
            x, y = rates[:, :2].T
            across[:, :2] = np.column_stack([-y, x]) / np.hypot(x, y)[:, np.newaxis]
        positions = np.einsum("pj,ab->pabj", rows, np.eye(size)).reshape(-1, size, 4)
        directions = np.einsum("sj,sb->sbj", slopes[is_straight], across)
        factors = np.concatenate([positions, directions])
        firsts = np.append(spans.repeat(size), spans[is_straight])
        offsets = count * np.arange(size)[:, np.newaxis] + np.arange(4)
        columns = firsts[:, np.newaxis, np.newaxis] + offsets
        numbers = np.broadcast_to(np.arange(len(factors))[:, np.newaxis, np.newaxis], columns.shape)
        shape = (len(factors), size * count)
        matrix = sparse.csc_array(
            (factors.ravel(), (numbers.ravel(), columns.ravel())), shape=shape
        )
        sums = np.append(polyline.waypoints[places], np.zeros(len(rates)))
        inner = np.arange(size * count).reshape(size, count)[:, FIXED:-FIXED]
        return matrix[:, inner.ravel()], sums - matrix @ self.points.T.ravel()

    def smooth_less(self, proven: Bools, reach: float) -> None:
        """Reduce smoothing lengths within ``reach`` seconds of unproven spans."""
        # Point p lies between spans p - 1 and p; count the unproven spans around it.
        reached_spans = reach / self.step + 0.5
        before = np.arange(len(self.smoothing)) - 0.5
        first = np.ceil(before - reached_spans).clip(0, len(proven)).astype(np.int64)
        last = np.floor(before + reached_spans).clip(-1, len(proven) - 1).astype(np.int64)
        counts = np.append(0, np.cumsum(~proven))
        is_near = counts[last + 1] > counts[first]
        # Shrink the lengths to a fifth at a time.
        self.smoothing = np.where(is_near, 0.2 * self.smoothing, self.smoothing)
        self.tries += 1

    def split(self, polyline: Polyline, proven: Bools) -> list[CurveSection]:
        """Split the section at the corners beside unproven spans."""
        middles = np.flatnonzero(~proven) + 0.5
        corners = np.arange(self.first + 1, self.last)
        times = polyline.times[self.first] + self.step * middles
        corner_times = polyline.times[corners]
        nearest = np.searchsorted(0.5 * (corner_times[1:] + corner_times[:-1]), times)
        stops = np.unique([self.first, *corners[nearest].tolist(), self.last]).tolist()
        return _make_sections(polyline, stops)


def _make_sections(polyline: Polyline, stops: list[int]) -> list[CurveSection]:
    """Make sections with a corner or junction between stops."""
    least = 1 if polyline.junction is not None and polyline.times[-1] > 0.0 else 2
    return [
        CurveSection.between(polyline, first, last)
        for first, last in itertools.pairwise(stops)
        if last - first >= (least if first == 0 else 2)
    ]


def _fit_sections(
    polyline: Polyline, sections: Sequence[CurveSection]
) -> list[tuple[CurveSection, Floats]]:
    """Fit curves to sections.

    A place on the way that a curve misses becomes a stop, which cuts the section.
    """
    fits: list[tuple[CurveSection, Floats]] = []
    waiting = list(sections)
    while waiting:
        section = waiting.pop()
        points, missed = section.fit(polyline)
        if missed:
            waiting += _make_sections(polyline, [section.first, *missed, section.last])
        else:
            fits.append((section, points))
    return fits


def _combine(rows: Floats, values: Floats) -> Floats:
    """Sum values, (c, 4, k), weighted by rows, (c, 4)."""
    return np.asarray(np.einsum("cj,cjk->ck", rows, values))


def _solve(normal: Floats, forces: Floats, matrix: sparse.csc_array, sums: Floats) -> Floats:
    """Solve banded normal equations under linear equations.

    ``normal`` has shape (4, c), ``forces`` and the result (c, k); the columns of the matrix go axis
    by axis. Linear equations that contradict each other keep errors.
    """
    if not len(sums):
        return np.asarray(solveh_banded(normal, forces))
    size = forces.shape[1]
    scale = normal.max()
    bands = [normal[3 - abs(k), abs(k) :] / scale for k in range(-3, 4)]
    form = sparse.kron(sparse.eye_array(size), sparse.diags_array(bands, offsets=range(-3, 4)))
    # Without the last block, equations that cannot hold would make it singular.
    # An equation errs by the slack for each unit of force, relative to the largest weight.
    slack = 1e-13 * sparse.eye_array(len(sums))
    right = np.append(forces.T / scale, sums)
    factors = splu(sparse.block_array([[form, matrix.T], [matrix, -slack]], format="csc"))
    solved = factors.solve(right)
    return np.asarray(solved[: forces.size].reshape(size, -1).T)


def _add_rows(
    normal: Floats, forces: Floats, firsts: Ints, rows: Floats, weights: Floats, targets: Floats
) -> None:
    """Add weighted rows to banded normal equations of least squares.

    Row i has nonzero numbers from column ``firsts[i]`` on. ``normal``, shape (4, n), holds the
    upper diagonals, the main one last.
    """
    for i, row in enumerate(rows.T):
        weighted = weights * row
        np.add.at(forces, firsts + i, weighted[:, np.newaxis] * targets)
        for j in range(i, rows.shape[1]):
            np.add.at(normal[3 - j + i], firsts + j, weighted * rows[:, j])


def make_curves(
    polyline: Polyline, rotations: Rotations, section: CurveSection, points: Floats
) -> Segments:
    """Make a B-spline's spans from its control points."""
    count = len(points) - 3
    spans = np.stack([points[k : count + k] for k in range(4)])
    offsets, rates, bends, twists = np.tensordot(TO_POLYNOMIAL, spans, axes=1)
    offsets -= polyline.waypoints[section.first]
    start = polyline.edges.starts[[section.first]]
    starts = rotations.add_steps(start.repeat(count, axis=0), offsets)
    sign = polyline.signs[section.first]
    if sign:
        starts[:, 2] = np.arctan2(sign * rates[:, 1], sign * rates[:, 0])
    return Segments(
        starts=starts,
        rates=rates / section.step,
        bends=bends / section.step**2,
        twists=twists / section.step**3,
        curvatures=np.zeros(count),
        drives=np.full(count, sign),
        lengths=np.full(count, section.step),
        ends=np.concatenate([starts[1:], polyline.edges.ends[[section.last - 1]]]),
    )


def smooth_path(
    edges: Segments,
    polyline: Polyline,
    rotations: Rotations,
    prove: Callable[[Segments], Bools],
) -> Segments | None:
    """Replace corners by proven curves.

    Return None if no curve is proven.
    """
    waiting = _make_sections(polyline, np.flatnonzero(polyline.stops).tolist())
    proven_curves: dict[int, tuple[int, Segments]] = {}
    while waiting:
        fits = _fit_sections(polyline, waiting)
        if not fits:
            break
        curves = [make_curves(polyline, rotations, *fit) for fit in fits]
        ends = np.cumsum([len(curve.lengths) for curve in curves])
        parts = np.split(prove(join_segments(curves)), ends[:-1])
        unproven: list[CurveSection] = []
        for (section, _), curve, proven in zip(fits, curves, parts, strict=True):
            if proven.all():
                proven_curves[section.first] = section.last, curve
            elif section.tries < 2:
                # Smooth an unproven curve less before it is split.
                ramps = polyline.ramps[section.first : section.last]
                section.smooth_less(proven, REACH * float(np.median(ramps)))
                unproven.append(section)
            elif section.last - section.first > 1:
                unproven += section.split(polyline, proven)
            elif section.first == 0 and polyline.junction is not None:
                return None
        waiting = unproven
    if not proven_curves:
        return None
    joined: list[Segments] = []
    # A curve from the junction also replaces a turn on the spot before the first edge.
    done = 0 if polyline.junction is None else int(polyline.numbers[0])
    for first, (last, curve) in sorted(proven_curves.items()):
        joined += [edges.select(np.arange(done, polyline.numbers[first])), curve]
        done = int(polyline.numbers[last - 1]) + 1
    joined.append(edges.select(np.arange(done, len(edges.lengths))))
    return join_segments(joined)

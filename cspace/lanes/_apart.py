"""Whether two timed motions of two robots stay apart, by intervals of time.

Within an interval, points of a robot move from where they are in its middle by at most half its
width times the robot's largest speed; relative to the other robot, by at most the relative speed in
the middle and what it may change. If the distance in the middle exceeds what both may move, and
their errors, the robots are apart all along the interval; otherwise it is halved.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike

from cspace import Robot, Rotations
from cspace.errors import InputError
from cspace.inside import (
    AXES,
    Cores,
    Floats,
    Part,
    Solid,
    StaticShape,
    are_free,
    bound_distances,
    check_finite,
    check_not_negative,
    check_number,
    check_point,
    keep,
    make_floating_chain,
    make_scene,
    make_scene_scratch,
    names_options,
    pack_parts,
    robot_of,
    tell_apart,
    warn_of_large,
    warn_user,
    wrap_angles,
)

if TYPE_CHECKING:
    from cspace.inside import Shape, ShapeLike
    from planners import Trajectory

MotionState: TypeAlias = Literal["apart", "touch", "undecided"]
"""Verdicts about two motions."""

SPEED_ROUNDING: Final = 1e-9
"""Share of a bound of a speed by which it grows, for rounding."""

MAX_CLOCK_STEP: Final = 1e-3
"""Largest difference, seconds, between two successive times of a clock."""

DAY: Final = 86_400.0
"""Seconds between the beginnings of two motions beyond which they may be of two clocks."""

MAX_SAMPLES: Final = 300
"""Number of points of a solid that are tried to be inside another one."""


@dataclass(frozen=True, eq=False)
class Mover:
    """A robot on a timed motion, or a thing that stands or moves at a constant velocity.

    Attributes
    ----------
    robot : Robot, or what makes one
        Shape, with its reference point at the origin, such as ``"rect:0.7x0.5"``.
    motion : Trajectory or array-like
        A trajectory of a rigid robot, or a configuration: x, y, or x, y, z, and perhaps a yaw;
        metres and radians.
    at : float
        Time, seconds, at which the motion begins, or at which the thing is at the configuration.
    velocity : array-like, shape (2,) or (3,), optional
        Constant velocity of a thing, m/s, before and after ``at``.
    error : float
        Largest distance, metres, of the robot from its motion.
    growth : float
        Growth of the error after ``at``, m/s.
    """

    robot: Robot | ShapeLike
    motion: Trajectory | ArrayLike
    at: float = 0.0
    velocity: ArrayLike | None = None
    error: float = 0.0
    growth: float = 0.0


@dataclass(frozen=True, eq=False)
class Separation:
    """Whether two motions stay apart; true in conditions if they are proven to.

    Attributes
    ----------
    verdict : str
        "apart": at every instant; "touch": the robots are within the margin at :attr:`time`;
        otherwise "undecided".
    distance : float
        Lower bound of the distance of the robots at every instant, metres, if they are apart.
    time : float or None
        Seconds: an instant at which they touch, or the first one that is undecided.
    poses : tuple of ndarray or None
        Poses at which they touch then, within the errors of their motions: x, y, in space z, and
        yaw.
    interval : tuple of float
        First and last instant, seconds.
    """

    verdict: MotionState
    distance: float = 0.0
    time: float | None = None
    poses: tuple[Floats, Floats] | None = None
    interval: tuple[float, float] = (0.0, 0.0)

    def __bool__(self) -> bool:
        """Return True if the motions are proven apart."""
        return self.verdict == "apart"


@names_options
def apart(
    first: Mover, second: Mover, *, margin: float = 0.0, until: float | None = None
) -> Separation:
    """Prove two timed motions apart, or find when they touch.

    Time begins at the earlier ``at``, except that of a thing that stands without growth. A robot
    stands at its start before its trajectory begins, and at its end ever after. Both robots move
    in the plane, or both in space, with or without a yaw.

    Parameters
    ----------
    first, second : Mover
    margin : float
        Distance that the robots must keep, metres.
    until : float, optional
        Last instant, seconds; by default the last one at which a trajectory ends, or ``at``. Two
        things need it if one moves or its error grows.

    Returns
    -------
    Separation

    Raises
    ------
    InputError
        If a motion is that of an arm, or rotates about other axes than z; if a number is not
        finite or beyond 1e100; if frames differ; if the robots touch at the start.

    Examples
    --------
    >>> import cspace
    >>> person = cspace.lanes.Mover("disc:0.3", (0.0, 2.0), velocity=(1.0, 0.0))
    >>> crate = cspace.lanes.Mover("rect:1x1", (3.0, 0.8, 0.5), error=0.05)
    >>> separation = cspace.lanes.apart(person, crate, until=10.0)
    >>> separation.verdict, separation.distance > 0.1
    ('apart', True)
    """
    movers = read_mover(first, "first"), read_mover(second, "second")
    gap = check_not_negative(margin, "margin")
    check_pair(*movers, ("first", "second"))
    begin, duration = _find_interval(movers, until)
    # Times count from the first instant, because stamps of clocks have few digits of a second.
    one, other = (each._replace(at=each.at - begin) for each in movers)
    measure = make_measure(one.robot.shape, other.robot.shape)
    search = ApartSearch((one, other), measure, gap, duration)
    if search.find_touch(np.zeros(1)) is not None:
        problem = f"touches second at the start, at {begin:g} s"
        rule = f"their distance must exceed {gap:g} m and their errors"
        raise InputError("first", problem, rule)
    found = search.run()
    time = None if found.time is None else begin + found.time
    return replace(found, time=time, interval=(begin, begin + duration))


class Timed(NamedTuple):
    """A checked motion.

    Attributes
    ----------
    robot : Robot
    trajectory : Trajectory or None
    pose : ndarray of float64, shape (dim + 1,)
        Position and yaw of a thing.
    velocity : ndarray of float64, shape (dim,)
    at, error, growth : float
        Seconds, metres and m/s.
    times : ndarray of float64, shape (n,)
        Seconds after ``at`` at which bounds change.
    bounds : ndarray of float64, shape (3, n + 1)
        Bounds before, between and after these times: speed of the reference point, speed of any
        other point around it, and acceleration of the reference point, m/s and m/s^2.
    """

    robot: Robot
    trajectory: Trajectory | None
    pose: Floats
    velocity: Floats
    at: float
    error: float
    growth: float
    times: Floats
    bounds: Floats

    def place(self, t: Floats) -> tuple[Floats, Floats]:
        """Return poses (n, dim + 1) and velocities (n, dim) at times."""
        dim = len(self.velocity)
        poses = np.tile(self.pose, (len(t), 1))
        velocities = np.tile(self.velocity, (len(t), 1))
        elapsed = t - self.at
        if self.trajectory is None:
            poses[:, :dim] += elapsed[:, np.newaxis] * self.velocity
        else:
            found, rates, _ = self.trajectory.sample(np.maximum(elapsed, 0.0))
            poses[:, : found.shape[1]] = found
            velocities[elapsed >= 0.0] = rates[elapsed >= 0.0, :dim]
        return poses, velocities

    def bound_errors(self, t: Floats) -> Floats:
        """Return largest errors up to times, metres, (n,)."""
        return np.asarray(self.error + self.growth * np.maximum(t - self.at, 0.0))

    def bound_rates(self, t: Floats) -> Floats:
        """Return the bounds around times, shape (3, n)."""
        return np.asarray(self.bounds[:, np.searchsorted(self.at + self.times, t)])

    def bound_rounding(self, t: Floats) -> Floats:
        """Bound how far rounding moves any point up to times, metres, (n,)."""
        speeds, turns, _ = self.bounds
        # Error of a time, as a share of it, that covers rounding.
        errors = 2.0**-50 * (np.abs(self.at) + np.abs(t))
        return np.asarray((speeds + turns).max() * errors)


def read_mover(mover: object, name: str) -> Timed:
    """Check a mover."""
    from planners import Trajectory
    from planners.inside import bound_rates

    if not isinstance(mover, Mover):
        raise InputError(name, f"is a {type(mover).__name__}", "it must be a Mover")
    robot = robot_of(mover.robot)
    dim = robot.dim
    at = _check_clock(mover.at, f"{name}.at")
    numbers = (
        check_not_negative(mover.error, f"{name}.error"),
        check_not_negative(mover.growth, f"{name}.growth", "m/s"),
    )
    velocity = np.zeros(dim)
    if mover.velocity is not None:
        velocity = check_point(mover.velocity, f"{name}.velocity", dim)
        warn_of_large(velocity, "m/s", f"{name}.velocity")
    if isinstance(mover.motion, Trajectory):
        if mover.velocity is not None:
            rule = "a trajectory has its own"
            raise InputError(f"{name}.velocity", "is given", rule)
        _check_axes(mover.motion.axes, robot, name)
        pose = np.zeros(dim + 1)
        times, bounds = bound_rates(mover.motion, robot.shape.lever)
        return Timed(robot, mover.motion, pose, velocity, at, *numbers, times, bounds)
    names = (*AXES[:dim], "yaw")[: np.size(mover.motion)]
    # Squares of numbers up to this one are finite.
    row = check_finite(mover.motion, f"{name}.motion", names, largest=1e100)
    if row.shape not in ((dim,), (dim + 1,)):
        axes = ", ".join(AXES[:dim])
        rule = f"it must be a trajectory, or {axes}, and perhaps a yaw, of {robot.name}"
        raise InputError(f"{name}.motion", f"has shape {row.shape}", rule)
    if len(row) > dim:
        Rotations.of(1).check_rotation(row[dim:], f"{name}.motion")
    pose = np.append(row, np.zeros(dim + 1 - len(row)))
    speed = float(np.linalg.norm(velocity)) * (1.0 + SPEED_ROUNDING)
    bounds = np.array([[speed], [0.0], [0.0]])
    return Timed(robot, None, pose, velocity, at, *numbers, np.zeros(0), bounds)


def _check_clock(value: float, name: str) -> float:
    """Return a time, or raise InputError if its clock has large steps."""
    time = check_number(value, name)
    step = float(np.spacing(abs(time)))
    if step > MAX_CLOCK_STEP:
        rule = f"times are seconds, and float64 has steps of {step:g} s there"
        raise InputError(name, f"is {value!r}", rule)
    return time


def _check_axes(axes: tuple[str, ...], robot: Robot, name: str) -> None:
    """Raise InputError unless a trajectory is a rigid robot's."""
    known = AXES[: robot.dim]
    if axes not in (known, (*known, "yaw")):
        rule = f"that of {robot.name} has {', '.join(known)}, and perhaps yaw"
        hint = (
            f"use {name}.robot.footprint()" if known == AXES and axes[2:] in ((), ("yaw",)) else ""
        )
        raise InputError(f"{name}.motion", f"has the axes {', '.join(axes)}", rule, hint)


def check_pair(first: Timed, second: Timed, names: tuple[str, str]) -> None:
    """Raise InputError unless two motions are in one space and frame; warn of two clocks."""
    if first.robot.dim != second.robot.dim:
        places = [each.robot.shape.place for each in (first, second)]
        problem = f"moves in {places[1]}, but {names[0]} in {places[0]}"
        raise InputError(names[1], problem, "both must move in one space")
    frames = [each.trajectory and each.trajectory.frame_id for each in (first, second)]
    if None not in frames and frames[0] != frames[1]:
        problem = f"has the frame {frames[1]!r}, but {names[0]} has {frames[0]!r}"
        raise InputError(f"{names[1]}.motion", problem, "positions must be in one frame")
    both_move = all(
        each.trajectory or each.velocity.any() or each.growth for each in (first, second)
    )
    if both_move and abs(first.at - second.at) > DAY:
        warn_user(
            f"{names[0]} begins at {first.at:g} s and {names[1]} at {second.at:g} s, days apart; "
            "`at` is of one clock"
        )


def _find_interval(movers: tuple[Timed, Timed], until: float | None) -> tuple[float, float]:
    """Return the first instant, and the seconds until the last one."""
    driven = [each for each in movers if each.trajectory is not None]
    changing = [each for each in movers if each.velocity.any() or each.growth]
    # Other things stand at all times, so that their ``at`` says nothing.
    timed = driven + changing or movers
    begin = min(each.at for each in timed)
    return begin, find_duration(begin, timed, until, has_end=bool(driven or not changing))


def find_duration(
    begin: float, movers: Sequence[Timed], until: float | None, has_end: bool
) -> float:
    """Return the seconds from the first instant until the last one.

    By default motions end, or ``has_end`` is False.
    """
    if until is not None:
        duration = check_number(until, "until") - begin
        if duration < 0.0:
            last, first = tell_apart(begin + duration, begin)
            raise InputError("until", f"is {last}", f"the motions begin at {first} s")
        return duration
    if not has_end:
        rule = "a thing that moves, or an error that grows, has no end"
        raise InputError("until", "is missing", rule)
    ends = [each.at - begin + float(each.times.max(initial=0.0)) for each in movers]
    return max(ends, default=0.0)


class Measure(Protocol):
    """Distances of two shapes at poses, shape (n, dim + 1) each."""

    def bound_below(self, poses: Floats, others: Floats) -> Floats:
        """Return lower bounds, within rounding, of the distances, metres, shape (n,)."""

    def bound_above(self, poses: Floats, others: Floats) -> tuple[Floats, Floats]:
        """Return upper bounds of distances (n,), and steps between points."""


def make_measure(first: Shape, second: Shape) -> Measure:
    """Return the measure of two shapes in one space."""
    return PlaneMeasure(first, second) if first.dim == 2 else SolidMeasure(first, second)


class PlaneMeasure:
    """Distances of two shapes in the plane."""

    def __init__(self, first: Shape, second: Shape) -> None:
        """Lay the outer and inner shapes ready."""
        self._outer = Cores(first.outer), Cores(second.outer)
        self._inner = Cores(first.inner), Cores(second.inner)
        parts = shapely.get_parts([first.inner.outline, second.inner.outline])
        self._has_holes = bool(shapely.get_num_interior_rings(parts).any())

    def bound_below(self, poses: Floats, others: Floats) -> Floats:
        """Return the distances of the outer shapes."""
        distances, _ = self._outer[0].measure_distances(poses, self._outer[1], others)
        return np.maximum(distances, 0.0)

    def bound_above(self, poses: Floats, others: Floats) -> tuple[Floats, Floats]:
        """Return the distances of the inner shapes, negative ones for depths.

        A disc with the depth as its radius fits into what both have in common, because the area of
        a shape without holes is at most its perimeter times the largest such radius.
        """
        distances, lines = self._inner[0].measure_distances(poses, self._inner[1], others)
        if self._has_holes:
            distances = np.maximum(distances, 0.0)
        return distances, lines[:, 1] - lines[:, 0]


class SolidMeasure:
    """Distances of two solids, as seen from the second."""

    def __init__(self, first: Shape, second: Shape) -> None:
        """Lay both solids ready as bodies, of which the first moves."""
        reach = float(np.linalg.norm(np.ptp(first.outer.bounds, axis=0)))
        moved, fixed = Part(first, np.eye(4)), StaticShape(second, np.eye(4), reach)
        solids = [Solid("first", 1, (moved,)), Solid("second", 0, (fixed,))]
        self._scene = keep(make_scene(make_floating_chain(), solids, [(0, 1)], pack_parts([])))
        self._inner = first.inner, second.inner
        self._samples = _sample_solid(first.inner), _sample_solid(second.inner)

    def bound_below(self, poses: Floats, others: Floats) -> Floats:
        """Return lower bounds by hulls, 0 for nesting."""
        x, y, z, yaws = _relate(poses, others).T
        rows = np.column_stack([yaws, x, y, z])
        is_free = are_free(self._scene, rows, rows)  # which is found sooner than a distance
        distances = np.empty(np.count_nonzero(is_free))
        nearest = np.empty((len(distances), 3), dtype=np.int64)
        scratch = make_scene_scratch(self._scene)
        bound_distances(self._scene, rows[is_free], distances, nearest, scratch)
        bounds = np.zeros(len(poses))
        bounds[is_free] = np.maximum(distances, 0.0)
        return bounds

    def bound_above(self, poses: Floats, others: Floats) -> tuple[Floats, Floats]:
        """Return distances of both solids' points, 0 for nesting."""
        from scipy.spatial.distance import cdist

        bounds, steps = np.zeros(len(poses)), np.zeros((len(poses), 3))
        (points, radii), (other_points, other_radii) = self._samples
        for k, row in enumerate(_relate(poses, others)):
            turn = _turn_about_z(row[3])
            placed = points @ turn.T + row[:3]
            back = (other_points - row[:3]) @ turn
            if self._inner[1].contains(placed).any() or self._inner[0].contains(back).any():
                continue
            gaps = cdist(placed, other_points) - radii[:, np.newaxis] - other_radii
            a, b = np.unravel_index(gaps.argmin(), gaps.shape)
            bounds[k] = max(float(gaps[a, b]), 0.0)
            steps[k] = _turn_about_z(others[k, 3]) @ (other_points[b] - placed[a])
        return bounds, steps


def _sample_solid(shape: Shape) -> tuple[Floats, Floats]:
    """Return a solid's points, and radii inside it."""
    simplices, radii = shape.outer.boundary()
    middles = simplices.mean(axis=1)
    points = np.concatenate([middles, *np.moveaxis(simplices, 1, 0)])
    radii = np.tile(radii, 1 + simplices.shape[1])
    chosen = np.linspace(0, len(points) - 1, min(len(points), MAX_SAMPLES)).astype(np.int64)
    return points[chosen], radii[chosen]


def _relate(poses: Floats, others: Floats) -> Floats:
    """Return poses, shape (n, 4), as seen from others."""
    steps = poses[:, :3] - others[:, :3]
    cos, sin = np.cos(others[:, 3]), np.sin(others[:, 3])
    x, y, z = steps.T
    yaws = wrap_angles(poses[:, 3] - others[:, 3])
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, z, yaws])


def _turn_about_z(yaw: float) -> Floats:
    """Return the matrix of a yaw."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


class Touch(NamedTuple):
    """An instant at which two robots touch, seconds, and their poses."""

    time: float
    poses: tuple[Floats, Floats]


class ApartSearch:
    """The search for an instant at which two robots are within a distance."""

    def __init__(
        self, movers: tuple[Timed, Timed], measure: Measure, margin: float, duration: float
    ) -> None:
        """Remember the motions, from 0 on, and their duration."""
        self._movers = movers
        self._measure = measure
        self._margin = margin
        self._duration = duration

    def run(self, *, finds_first: bool = True) -> Separation:
        """Halve intervals until all are proven, or contact is found, perhaps not the first one."""
        lows, highs = self._cut_first()
        # Number of intervals, besides the first, that are tried at once before motions stay
        # undecided.
        most = 4096 + len(lows)
        touch: Touch | None = None
        least, proven = math.inf, math.inf
        undecided = math.inf
        while len(lows):
            middles = 0.5 * (lows + highs)
            gaps, bounds = self._bound(middles, lows, highs)
            found = self.find_touch(middles[gaps <= self._margin])
            if found is not None and (touch is None or found.time < touch.time):
                touch = found
            least = min(least, float(gaps.min()))
            # Share of the least distance found that each interval is to prove.
            enough = self._margin + 0.8 * max(least - self._margin, 0.0)
            # Width of an interval, seconds, that is not halved; nor are those between two floats.
            is_narrow = highs - lows <= np.maximum(1e-6, np.spacing(highs))
            settled = (bounds > enough) | (is_narrow & (bounds > self._margin))
            proven = min(proven, float(bounds[settled].min(initial=math.inf)))
            left = ~settled
            if touch is not None:
                # Width of an interval, seconds, in which no earlier instant of contact is
                # searched.
                left &= finds_first & (lows < touch.time) & (highs - lows > 1e-3)
            stuck = left & is_narrow
            if len(lows) > most:
                # What proves enough for the distance settles, too.
                stuck = left & (bounds <= self._margin)
                proven = min(proven, float(bounds[left & ~stuck].min(initial=math.inf)))
                left = stuck
            undecided = min(undecided, float(middles[stuck].min(initial=math.inf)))
            left &= ~stuck & (middles < undecided)
            lows, middles, highs = lows[left], middles[left], highs[left]
            lows, highs = np.concatenate([lows, middles]), np.concatenate([middles, highs])
        if touch is not None:
            return Separation("touch", 0.0, touch.time, touch.poses)
        if undecided < math.inf:
            return Separation("undecided", 0.0, undecided)
        return Separation("apart", proven)

    def _cut_first(self) -> tuple[Floats, Floats]:
        """Return the first intervals, within which bounds of speeds do not change."""
        end = self._duration
        # Number of intervals into which the time is cut at first.
        times = [
            np.linspace(0.0, end, 16 + 1),
            *(each.at + each.times for each in self._movers),
        ]
        borders = np.unique(np.clip(np.concatenate(times), 0.0, end))
        return (borders[:-1], borders[1:]) if len(borders) > 1 else (borders, borders)

    def _bound(self, middles: Floats, lows: Floats, highs: Floats) -> tuple[Floats, Floats]:
        """Bound distances from below, midway and all along intervals."""
        one, other = self._movers
        (poses, velocities), (others, other_velocities) = one.place(middles), other.place(middles)
        far = np.maximum(np.abs(poses).max(axis=1), np.abs(others).max(axis=1))
        gaps = self._measure.bound_below(poses, others) - Cores.bound_rounding(far)
        gaps -= one.bound_rounding(highs) + other.bound_rounding(highs)
        halves = 0.5 * (highs - lows)
        speeds, turns, gains = one.bound_rates(middles) + other.bound_rates(middles)
        # Robots that move alike keep their distance.
        relative = np.linalg.norm(velocities - other_velocities, axis=1)
        relative += SPEED_ROUNDING * speeds + 0.5 * gains * halves
        moved = halves * (np.minimum(speeds, relative) + turns) * (1.0 + SPEED_ROUNDING)
        errors = one.bound_errors(highs) + other.bound_errors(highs)
        near = one.bound_errors(middles) + other.bound_errors(middles)
        # A bound that is not finite proves nothing.
        both = np.stack([gaps - near, gaps - moved - errors])
        gaps, bounds = np.where(np.isfinite(both), both, -math.inf)
        return gaps, bounds

    def find_touch(self, t: Floats) -> Touch | None:
        """Return the first instant at which the robots touch."""
        if not len(t):
            return None
        one, other = self._movers
        (poses, _), (others, _) = one.place(t), other.place(t)
        bounds, steps = self._measure.bound_above(poses, others)
        errors, other_errors = one.bound_errors(t), other.bound_errors(t)
        touching = np.flatnonzero(bounds <= self._margin + errors + other_errors)
        if not len(touching):
            return None
        k = touching[np.argmin(t[touching])]
        # Errors bring the robots together along the line between near points.
        length = float(np.linalg.norm(steps[k]))
        ahead = steps[k] / length if length > 0.0 else steps[k]
        share = min(float(errors[k]), max(float(bounds[k]) - self._margin, 0.0))
        rest = min(float(other_errors[k]), max(float(bounds[k]) - self._margin - share, 0.0))
        dim = len(ahead)
        poses[k, :dim] += share * ahead
        others[k, :dim] -= rest * ahead
        return Touch(float(t[k]), (poses[k], others[k]))

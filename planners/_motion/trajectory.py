"""Trajectories: planned paths with times."""

from __future__ import annotations

import csv
import itertools
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from cspace import Rotations, Space
from cspace.errors import InputError
from cspace.inside import (
    Bools,
    ConfigurationMap,
    ConfigurationSpace,
    Drive,
    Floats,
    Ints,
    Upright,
    check_each,
    check_finite,
    check_number,
    check_positive,
    frozen,
    names_options,
    number_parts,
    replacing,
    show_png,
    tell_apart,
    warn_user,
)
from planners._edges.drives import check_axes, edges_of, local_planner
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import check_space
from planners._motion.jerk import find_jerk_stop, find_motion
from planners._motion.joint_limits import read_joint_limits
from planners._motion.segments import (
    MAX_EDGE_TURN,
    Segments,
    align_quaternions,
    bound_derivatives,
    can_prove_curves,
    cut_segments,
    join_segments,
    make_lines,
    measure_sizes,
    place_along,
    prove_segments,
    scale_segments,
)
from planners._motion.smoothing import VIA_CELLS, Junction, make_polyline, smooth_path
from planners._motion.speed_limits import PlacedLimits, place_limits
from planners._motion.timing import (
    MAX_ERROR,
    IntervalMemo,
    LimitRates,
    MotionBounds,
    Phases,
    are_same_bounds,
    cut_at_rest,
    cut_phases,
    find_excess,
    find_excesses,
    find_passes,
    find_stop,
    is_motion,
    join_motions,
    slow_down,
    trim_segments,
)
from planners._space_kinds import ARMS, JOINT_MAPS, find_space_kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Limits = ArrayLike | Mapping[str, Any] | os.PathLike[str] | None
"""A limit: one number, or one for each axis."""

ROUNDING: Final = 1e-13
"""Largest step that is a rounding error, relative to the coordinates of the path, or radians."""

ROW_ERROR: Final = 1e-5
"""Largest distance of each joint, radians or metres, from rows that a straight motion joins."""

VIA_ERROR: Final = 1e-5
"""Largest distance of a place from a curve through it, relative to the extent of the path."""

VIA_STEPS: Final = 16
"""Parts of a phase in which a robot passes a place once."""

SPEED_ROUNDING: Final = 1e-9
"""Share by which a bound of a speed grows for rounding."""

MAX_ROWS: Final = 10**6
"""Largest number of rows of a trajectory."""


class LinearMotion(Protocol):
    """A motion along straight lines, as :meth:`cspace.ArmSpace.follow_line` makes it."""

    path: Floats
    certified: bool


@names_options
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory:
    """A path with times, that ends at rest.

    :meth:`planners.Plan.trajectory`, :meth:`planners.Trajectory.along` and
    :meth:`planners.Trajectory.braked` make it.

    Attributes
    ----------
    times : ndarray of float64, shape (n,), read-only
        Seconds from the start, increasing.
    positions : ndarray of float64, shape (n, size), read-only
        Configurations. Yaw is in [-pi, pi). Quaternions never jump to their negative, so their sign
        may differ from that in the plan.
    velocities, accelerations : ndarray of float64, shape (n, size), read-only
        First and second derivative of the positions by time. Accelerations jump unless the jerk has
        a limit; each is the value just after its time.
    axes, units : tuple of str
        Names and units of the columns, as of the plan.
    certified : bool
        Whether every part was proven free when the trajectory was made: edges as
        :meth:`planners.Plan.recheck` proves them, and curves. Without a map, as the plan says.
    exceeds_until : float
        Seconds until which it exceeds limits of places. If the motion before was faster than these,
        or too near to brake in time, it brakes as quickly as its other limits allow; with limited
        jerk nearly so. Otherwise zero.
    stop_reason : str
        Why the trajectory is only a stop, as :meth:`braked` returns it. Empty if it ends at the
        goal of a plan.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats
    axes: tuple[str, ...]
    units: tuple[str, ...]
    certified: bool
    _route: DrivenPath
    _rotations: Rotations
    _segments: Segments
    _phases: Phases
    _bounds: MotionBounds
    stop_reason: str = ""
    exceeds_until: float = 0.0

    @classmethod
    @names_options
    def along(
        cls,
        space: ConfigurationSpace,
        path: LinearMotion | ArrayLike,
        *,
        max_velocity: Limits = None,
        max_acceleration: ArrayLike | Mapping[str, float],
        max_jerk: Limits = None,
        duration: float | None = None,
        time_step: float = 0.1,
    ) -> Trajectory:
        """Compute an arm's fastest motion along a path.

        It begins and ends at rest, and stays on the motions between the rows. So it also stops at
        each row at which the joints change their direction, and warns of many stops. Configurations
        within 1e-5 rad (m) of a straight motion, as rounded rows, are passed on it. These motions
        are proven free again.

        Parameters
        ----------
        space : ArmSpace
        path : LineMotion, or array-like of shape (n, dof)
            A certified line of :meth:`cspace.ArmSpace.follow_line`, or configurations, radians and
            metres.
        max_velocity, max_acceleration, max_jerk, duration, time_step
            As for :meth:`planners.Plan.trajectory`.

        Raises
        ------
        InputError
            If the space is not an arm's, the line is not certified, or a motion is not proven free;
            and as :meth:`planners.Plan.trajectory` and :meth:`cspace.ArmSpace.certify_path`.

        Examples
        --------
        >>> import pathlib, tempfile, numpy as np, cspace, planners
        >>> box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
        >>> joint = '<joint name="slide" type="prismatic"><parent link="base"/>'
        >>> joint += '<child link="cart"/><axis xyz="1 0 0"/>'
        >>> joint += '<limit lower="0" upper="2" effort="1" velocity="0.5"/></joint>'
        >>> path = pathlib.Path(tempfile.mkdtemp(), "slide.urdf")
        >>> links = f'<link name="base"/><link name="cart">{box}</link>'
        >>> _ = path.write_text(f'<robot name="s">{links}{joint}</robot>')
        >>> space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
        >>> pose = np.eye(4)
        >>> pose[0, 3] = 1.0
        >>> motion = space.follow_line((0.0,), "cart", pose)
        >>> planners.Trajectory.along(space, motion, max_acceleration=1.0).duration
        2.5
        """
        if find_space_kind(space) not in (JOINT_MAPS, ARMS):
            raise InputError(
                "space",
                f"is {space!r}",
                "it must be the space of an arm",
            )
        if not getattr(path, "certified", True):
            raise InputError(
                "path",
                f"is not certified: {getattr(path, 'status', '')}",
                "a trajectory follows the whole line",
            )
        rows: Any = path
        given = check_finite(getattr(path, "path", rows), "path", space.axes)
        if given.ndim != 2 or not len(given):
            raise InputError(
                "path",
                f"has shape {given.shape}",
                "it must be rows of configurations",
            )
        free = np.asarray(space.certify_path(given))
        if not free.all():
            raise InputError(
                "path",
                f"has {np.count_nonzero(~free)} of {len(free)} motions that are not proven free",
                "a trajectory follows proven motions",
            )
        waypoints = given
        if not hasattr(path, "path"):  # the rows of a line were proven near to it
            joined = _join_rows(space, given)
            waypoints = joined if np.asarray(space.certify_path(joined)).all() else given
            _warn_of_stops(waypoints, given)
        driven = DrivenPath(
            space=space.exact,
            waypoints=waypoints,
            axes=space.axes,
            units=space.units,
            frame_id=space.frame_id,
            moves_joints=True,
            drive=None,
            exact=True,
            certified=True,
            blend=False,
        )
        limits = MotionLimits(max_velocity, max_acceleration, max_jerk=max_jerk)
        return make_trajectory(driven, limits, duration, time_step)

    @property
    def duration(self) -> float:
        """Seconds from start to goal."""
        return float(self.times[-1])

    @property
    def path(self) -> Floats:
        """The positions, rows of the proven curve, as pictures draw paths."""
        return self.positions

    @property
    def frame_id(self) -> str:
        """Frame of the positions in ROS, as of the plan."""
        return self._route.frame_id

    @names_options
    def recheck(self, space: Space, *, after: float = 0.0) -> Bools:
        """Prove each part of the curve again, among present obstacles.

        Limits of places are checked again, too, :class:`planners.SlowNear` on its own map. A part
        of a smooth path that exceeds them after :attr:`exceeds_until` is False; without curves, all
        parts are.

        Parameters
        ----------
        space : Space
            A map of the same robot, such as ``plan.space``.
        after : float
            Seconds. Only what the robot has ahead at this time is proven, from exactly where it is
            then; what it has passed may be blocked. The part that it is on is cut there. A motion
            that is proven as a whole is proven ahead, too.

        Returns
        -------
        ndarray of bool, shape (m,)
            True if a part is proven free now, and slow enough. The parts of a smooth path are its
            straight lines, its turns on the spot, and the spans of its curves. Without curves, they
            are the edges, as in :meth:`planners.Plan.recheck`. With ``after``, the last ones, and
            the edges may be cut into more.

        Raises
        ------
        InputError
            If ``space`` is no :class:`cspace.Space`, or has other axes, or ``after`` is not from 0
            to :attr:`duration`.
        """
        check_space(space)
        check_axes(space, self.axes, "trajectory")
        begin = check_number(after, "after")
        if not 0.0 <= begin <= self.duration:
            last, first = tell_apart(self.duration, begin)
            raise InputError("after", f"is {first}", f"the motion takes from 0 to {last} s")
        if begin:
            ahead = self._cut(self._segments, cut_phases(self._phases, begin))
            ahead = replace(ahead, exceeds_until=max(self.exceeds_until - begin, 0.0))
            proven = ahead.recheck(space)
            # Proofs of a part and of the whole may differ in narrow places.
            return proven if proven.all() else proven | self.recheck(space).all()
        is_slow = ~self._find_fast()
        if not self._segments.is_curve.any():
            is_slow = np.asarray(is_slow.all())
        return np.asarray(self._prove_parts(space) & is_slow)

    def _prove_parts(self, space: Space) -> Bools:
        """Prove each part of the curve, whatever its speed."""
        route = self._route
        edges = local_planner(space, route.drive, exact=route.exact, keep=route.keep)
        if self._segments.is_curve.any():
            driven = _cut_driven(self._segments, self._phases, self._rotations)
            return prove_segments(edges.space, driven)
        return edges.edges_are_free(route.waypoints)

    def _find_fast(self) -> Bools:
        """Return which segments exceed present limits of places, shape (m,)."""
        fast = np.zeros(len(self._segments.lengths), dtype=np.bool_)
        bounds = self._bounds._replace(memo=None)
        exceeds = find_excesses(self._segments, self._rotations, bounds, self._phases)
        later = self._phases.times[:-1] >= self.exceeds_until
        fast[self._phases.segments[:-1][exceeds & later]] = True
        return fast

    def braked(self, t: float) -> Trajectory:
        """Return a stop on this curve from the state at a time.

        It begins in motion and keeps the limits of this trajectory, so positions and velocities are
        continuous if the robot drives it from ``t`` on. So are accelerations if the jerk has a
        limit; then the stop is longer. It is a part of the proven motion, and :meth:`recheck`
        proves this part alone. Without a limit of jerk no stop on lines and arcs is quicker. On a
        curve the robot slows down by bounds for pieces of the curve, so a quicker stop may exist.

        Parameters
        ----------
        t : float
            Seconds. From the end on, and wherever the robot rests, the stop takes no time.

        Returns
        -------
        Trajectory
            Its time 0 is ``t``.

        Raises
        ------
        InputError
            If the time is not one finite number.

        Examples
        --------
        >>> import numpy as np, cspace, planners
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> plan = planners.plan(space, (0.5, 1.5), (3.5, 1.5))
        >>> trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
        >>> stop = trajectory.braked(1.0)  # at 0.5 m/s
        >>> stop.duration, stop.positions[-1].tolist()
        (1.0, [1.0, 1.5])
        """
        at = check_finite(t, "t")
        if at.ndim:
            raise InputError("t", f"has shape {at.shape}", "it is one time")
        clipped = np.clip(at.reshape(1), 0.0, self.duration)
        (first,), length, ((speed,), (gain,)) = _locate(self._phases, clipped)
        place, velocity, acceleration = _move_along(
            self._segments.select([first]), self._rotations, length, speed, gain
        )
        ahead = self._segments.select(slice(first, None))
        path = ahead, self._rotations, self._bounds
        state = float(length[0]), float(speed)
        if self._bounds.jerk is None or speed == 0.0:
            phases = find_stop(*path, *state)
        else:
            later = cut_at_rest(cut_phases(self._phases, float(clipped[0])))
            later = later._replace(segments=later.segments - first)
            jerk = self._bounds.jerk
            stops = [find_jerk_stop(*path, jerk, *state, float(gain))]
            if self._bounds.places is not None:
                # Limits of places that came after the motion was made may be below its speed.
                free = ahead, self._rotations, self._bounds._replace(places=None)
                stops.append(find_jerk_stop(*free, jerk, *state, float(gain)))
            # The robot can also follow its motion until it rests.
            found = [phases for phases in (*stops, later) if phases is not None]
            phases = min(found, key=lambda each: (find_excess(*path, each), _last_time(each)))
        stop = self._cut(ahead, phases)
        segments, phases = stop._segments, stop._phases
        ends = np.concatenate([place, stop._route.waypoints[-1:]])
        timing = ends, segments, self._rotations, phases, self._bounds
        stop = replace(
            stop,
            certified=self.certified and is_motion(*timing, velocity, acceleration),
            stop_reason="braked() was called",
            exceeds_until=find_excess(segments, self._rotations, self._bounds, phases),
        )
        return stop._set_rows(stop._row_times(0.1))  # seconds

    def _cut(self, segments: Segments, phases: Phases) -> Trajectory:
        """Return the part of the motion that has these phases, without its rows."""
        segments, phases = trim_segments(segments, phases)
        cut = _cut_driven(segments, phases, self._rotations)
        waypoints = self._rotations.make_canonical(_make_waypoints(cut, self._rotations))
        return replace(
            self,
            _route=self._route._replace(waypoints=waypoints, vias=()),
            _segments=segments,
            _phases=phases,
        )

    def starts_after(self, t: float) -> Floats:
        """Return the starts of plans that continue from a time.

        The first row is the place at the time. A plan from there goes on at once, if a curve along
        it is proven and allows the speed. The second row is the end of :meth:`braked`, from which a
        proven plan with the same limits goes on. If the robot rests, there is only one row.

        Parameters
        ----------
        t : float
            Seconds, by when the plan will be made: the present time and the latency.

        Returns
        -------
        ndarray of float64, shape (2, size) or (1, size)

        Raises
        ------
        InputError
            As for :meth:`braked`.
        """
        stop = self.braked(t)
        return stop.positions[[0, -1]] if stop.duration else stop.positions[:1]

    def stop_distance(self, t: float) -> float:
        """Return the distance of a stop at a time; see :meth:`braked`.

        It is measured along the curve as :attr:`planners.Plan.length`: in metres that the reference
        point moves, or for an arm in its joints.
        """
        stop = self.braked(t)
        # The speed of each part of a stop is summed at eight instants.
        nodes, weights = np.polynomial.legendre.leggauss(8)
        begins = stop._phases.times[:-1, np.newaxis]
        halves = 0.5 * stop._phases.durations[:, np.newaxis]
        _, velocities, _ = stop.sample(begins + halves * (1.0 + nodes))
        dim = self._bounds.velocity.dim
        speeds = np.linalg.norm(velocities[..., :dim], axis=-1)
        return float((halves * weights * speeds).sum())

    def __repr__(self) -> str:
        """Return the duration, the number of rows, and a stop's reason."""
        rows = f"{len(self.times)} rows of {', '.join(self.axes)}"
        stop = f"; a stop: {self.stop_reason}" if self.stop_reason else ""
        return f"Trajectory({self.duration:.3f} s, {rows}{stop})"

    def sample(self, t: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return exact positions, velocities and accelerations at any times.

        Parameters
        ----------
        t : array-like, shape (...)
            Seconds. The robot rests after the end, and before the start unless it begins in motion.

        Returns
        -------
        tuple of three ndarray of float64, shape (..., size)

        Raises
        ------
        InputError
            If a time is not finite.
        """
        times = check_finite(t, "t")
        rows = _evaluate(self._segments, self._phases, self._rotations, times.reshape(-1))
        shape = (*times.shape, len(self.axes))
        positions, velocities, accelerations = (values.reshape(shape) for values in rows)
        return positions, velocities, accelerations

    @property
    def via_times(self) -> Floats:
        """When the robot reaches each place of ``via``, seconds, shape (v,).

        A turn on the spot or a rest there comes after it. A motion of :meth:`braked` has no places.
        """
        begins, ends = self._phases.times[:-1], self._phases.times[1:]
        grid = np.append(np.linspace(begins, ends, VIA_STEPS, endpoint=False, axis=1), ends[-1:])
        times = [0.0]
        for place in self._route.waypoints[list(self._route.vias)]:
            times.append(self._find_pass(place, grid, times[-1]))
        return np.array(times[1:])

    def _find_pass(self, place: Floats, grid: Floats, after: float) -> float:
        """Return when the robot first reaches a place on its way, at ``after`` or later.

        Between two times of ``grid``, it comes nearest to a place at most once.
        """
        from scipy.optimize import brentq

        columns = slice(self._bounds.velocity.dim)

        def approach(t: float | Floats) -> tuple[Floats, Floats]:
            """Return the distance along each axis, and the rate at which its square falls."""
            rows, velocities, _ = self.sample(t)
            steps = self._rotations.steps_between(rows, place)[..., columns]
            return np.abs(steps), (steps * velocities[..., columns]).sum(axis=-1)

        ends = grid[1:]
        # At a rest the rate is zero, and soon after it is not.
        begins = np.where(approach(grid)[1][:-1] > 0.0, grid[:-1], grid[:-1] + 1e-6 * np.diff(grid))
        passes = (approach(begins)[1] > 0.0) & (approach(ends)[1] <= 0.0) & (ends >= after)
        nearest = (
            brentq(lambda t: approach(t)[1], begins[row], ends[row], xtol=1e-12)
            for row in np.flatnonzero(passes)
        )
        error = VIA_ERROR * np.ptp(self._route.waypoints, axis=0)[columns].max()
        passed, least = after, math.inf
        for t in itertools.chain([after], (t for t in nearest if t >= after)):
            distance = approach(t)[0].max()
            if distance < least:
                passed, least = t, distance
            if distance <= error:
                break
        return float(passed)

    def sample_uniform(self, rate: float) -> Trajectory:
        """Return the same motion with rows at a controller's rate.

        Parameters
        ----------
        rate : float
            Rows a second. The last row is the first one at which the robot rests at the goal.

        Returns
        -------
        Trajectory
            Its rows are also the rows of :meth:`to_csv`, of messages, and of ``v`` and ``omega``.

        Raises
        ------
        InputError
            If the rate is not above zero, makes a million rows, or may leave more than half a turn
            between two.

        Examples
        --------
        >>> import numpy as np, cspace, planners
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> plan = planners.plan(space, (0.5, 1.5), (3.5, 1.5))
        >>> trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
        >>> trajectory.sample_uniform(20.0).times[:3].tolist()
        [0.0, 0.05, 0.1]
        """
        checked = check_positive(rate, "rate", "rows a second")
        # Rounding must not add a row.
        rows = math.ceil(self.duration * checked * (1.0 - 1e-12))
        if rows >= MAX_ROWS:
            raise InputError(
                "rate",
                f"is {rate:g}",
                f"it makes {rows} rows; at most {MAX_ROWS} are possible",
            )
        if (step := self._largest_step(1.0 / checked)) < 1.0 / checked:
            raise InputError(
                "rate",
                f"is {rate:g}",
                "rows may lie more than half a turn of the robot apart",
                f"pass rate={math.ceil(1.0 / step)}",
            )
        return self._set_rows(np.arange(rows + 1) / checked)

    def _row_times(self, time_step: float) -> Floats:
        """Return row times, at most ``time_step`` apart, with phase starts."""
        phases = self._phases
        durations = phases.durations
        counts = np.maximum(np.ceil(durations / self._largest_step(time_step)), 1.0)
        total = counts.sum()
        if total >= MAX_ROWS:
            raise InputError(
                "time_step",
                f"is {time_step:g}",
                f"it makes {total:.2g} rows; at most {MAX_ROWS} are possible",
            )
        owners, numbers = number_parts(counts.astype(np.int64))
        rows = phases.times[owners] + numbers / counts[owners] * durations[owners]
        return np.append(rows, phases.times[-1])

    def _largest_step(self, step: float) -> float:
        """Return the longest step in which the robot turns less than halfway."""
        segments = self._segments
        limit = self._bounds.velocity.angular or math.inf
        if step * limit <= MAX_EDGE_TURN:
            return step
        rates, _ = bound_derivatives(segments, 0.0 * segments.lengths, segments.lengths)
        angular = np.linalg.norm(rates[:, self._bounds.velocity.dim :], axis=1)
        fastest = min(float(angular.max(initial=0.0) * self._phases.speeds.max()), limit)
        return step / max(step * fastest / MAX_EDGE_TURN, 1.0)

    def _set_rows(self, times: Floats) -> Trajectory:
        """Return the same motion with rows at these times."""
        positions, velocities, accelerations = self.sample(times)
        return replace(
            self,
            times=frozen(times),
            positions=frozen(positions),
            velocities=frozen(velocities),
            accelerations=frozen(accelerations),
        )

    @property
    def v(self) -> Floats:
        """Velocities ahead of a robot that drives, m/s, shape (n,).

        They are negative in reverse. Raises InputError for holonomic robots and arms; controllers
        take their ``velocities``.
        """
        self._check_drives()
        return self._project_ahead(self.velocities)

    @property
    def omega(self) -> Floats:
        """Yaw rates of a robot that drives, rad/s, shape (n,).

        Errors are as for :attr:`v`.
        """
        self._check_drives()
        return self.velocities[:, 2]

    def steering(self, wheelbase: float) -> Floats:
        """Return a car's steering angles, radians, shape (n,).

        The angle of the front wheels is ``atan(wheelbase * curvature)``, to the left if positive,
        for a reference point in the middle of the rear axle. It is also defined at rest.

        Parameters
        ----------
        wheelbase : float
            Distance of the axles, metres.

        Raises
        ------
        InputError
            If the robot is no car, or the wheelbase is not above zero.
        """
        if not self._route.edges.has_curves:
            raise InputError(
                "trajectory",
                f"is of a robot with drive {self._route.drive!r}",
                "a car steers",
            )
        metres = check_positive(wheelbase, "wheelbase")
        segments, lengths, _ = _locate(self._phases, self.times)
        parts = self._segments.select(segments)
        slopes = place_along(parts, self._rotations, lengths)[1]
        return np.arctan(metres * slopes[:, 2] / self._project_ahead(slopes))

    def _check_drives(self) -> None:
        """Raise InputError if the robot does not drive along its x axis."""
        if not self._route.edges.has_heading:
            raise InputError(
                "trajectory",
                "is of a robot without a drive",
                "only a robot that drives has v and omega",
            )

    def _project_ahead(self, rates: Floats) -> Floats:
        """Return the parts of rates along the robot's x axis, shape (n,)."""
        yaw = self.positions[:, 2]
        return np.cos(yaw) * rates[:, 0] + np.sin(yaw) * rates[:, 1]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw speed and angular speed over time.

        For an arm, draw the velocity of each joint.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            By default of a new figure without a window. A second unit gets an axis on the right.
        """
        from cspace.plot import plot_rates

        dim = self._bounds.velocity.dim
        linear = self.velocities[:, :dim]
        angular = self.velocities[:, dim:]
        labels = [f"velocity ({unit}/s)" for unit in self.units]
        curves = list(zip(self.axes, labels, linear.T, strict=False))
        if not self._route.moves_joints:
            curves = [("speed", "speed (m/s)", np.linalg.norm(linear, axis=1))]
            # The derivative of a quaternion is half as long as the angular velocity.
            factor = 2.0 if "qw" in self.axes else 1.0
            if angular.size:
                turned = factor * np.linalg.norm(angular, axis=1)
                curves.append(("angular speed", "angular speed (rad/s)", turned))
        return plot_rates(self.times, curves, ax)

    _repr_png_ = show_png

    def to_path(self, msg: Any = None, *, frame_id: str | None = None) -> Any:
        """Return the rows as a ``nav_msgs/Path`` of ROS.

        The stamp of each pose is the message's stamp plus the time of the row. Parameters, result
        and errors are as for :meth:`planners.Plan.to_path`.
        """
        from cspace.export import fill_path
        from cspace.ros import Path

        if self._route.moves_joints:
            raise InputError(
                "trajectory",
                f"moves the joints {', '.join(self.axes)}",
                "a path holds poses",
            )
        filled = Path() if msg is None else msg
        frame = self._route.frame_id if frame_id is None else frame_id
        return fill_path(self.axes, self.positions, filled, frame, self.times)

    def to_joint_trajectory(self, msg: Any = None, *, frame_id: str = "") -> Any:
        """Return an arm's trajectory as a ``trajectory_msgs/JointTrajectory`` of ROS.

        Each row becomes a point with positions, velocities and ``time_from_start``. Controllers
        join such points by cubic polynomials, which are this very motion on straight edges. On
        curves they deviate by some 1e-4 rad; at a higher rate by :meth:`sample_uniform`, less. With
        accelerations they would use quintic polynomials, which are another motion. ``msg`` is any
        object with the fields of the message, of ROS 1 or 2; a new one if left out. Its header
        keeps its stamp.

        Raises
        ------
        InputError
            If the plan moves no joints, or the message lacks a field.
        """
        from cspace.export import fill_joint_trajectory
        from cspace.ros import JointTrajectory

        if not self._route.moves_joints:
            raise InputError(
                "trajectory",
                f"moves {', '.join(self.axes)}",
                "a joint trajectory holds joints",
            )
        filled = JointTrajectory() if msg is None else msg
        return fill_joint_trajectory(
            self.axes, self.positions, self.velocities, self.times, filled, frame_id
        )

    def to_twists(self, make: Callable[[], Any] | None = None) -> list[Any]:
        """Return the commands as ``geometry_msgs/Twist`` of ROS.

        Each row of a robot that drives becomes a message, with :attr:`v` as ``linear.x`` and
        :attr:`omega` as ``angular.z``.

        Parameters
        ----------
        make : callable, optional
            The class of the messages, of ROS 1 or 2; by default objects with the same fields.

        Raises
        ------
        InputError
            If the robot does not drive, or a message lacks a field.
        """
        from cspace.export import make_twists
        from cspace.ros import Twist

        if make is not None and not callable(make):
            raise InputError("make", f"is a {type(make).__name__}", "it is called for messages")
        return make_twists(make or Twist, self.v, self.omega)

    @names_options
    def to_csv(
        self,
        path: str | os.PathLike[str],
        overwrite: bool = False,
        *,
        wheelbase: float | None = None,
    ) -> None:
        """Write the rows as CSV, in full precision.

        The columns are ``time``, the axes, and their velocities, such as ``x_velocity``; for a
        robot that drives also ``v`` and ``omega``, and for a car with a ``wheelbase`` in metres its
        ``steering``. Other parameters and errors are as for :meth:`planners.Plan.to_csv`.
        """
        names = ["time", *self.axes, *(f"{axis}_velocity" for axis in self.axes)]
        columns = [self.times, self.positions, self.velocities]
        if self._route.edges.has_heading:
            names += ["v", "omega"]
            columns += [self.v, self.omega]
        if wheelbase is not None:
            names.append("steering")
            columns.append(self.steering(wheelbase))
        write_csv(path, overwrite, names, np.column_stack(columns).tolist())


def bound_rates(trajectory: Trajectory, lever: float) -> tuple[Floats, Floats]:
    """Bound speeds and accelerations between times of a trajectory.

    Parameters
    ----------
    trajectory : Trajectory
    lever : float
        Largest distance of a point of the robot from its reference point, metres.

    Returns
    -------
    ndarray of float64, shape (n,)
        Times at which the bounds change, seconds.
    ndarray of float64, shape (3, n + 1)
        Bounds before, between and after these times: speed of the reference point, speed of any
        other point around it, and acceleration of the reference point, m/s and m/s^2. They are
        zero before the first time and after the last, because the robot rests.
    """
    dim = trajectory._bounds.velocity.dim
    phases = trajectory._phases
    lengths, _, last_gains = phases.ends()
    lengths = np.maximum(lengths - phases.positions[:-1], 0.0)
    speeds = phases.peaks()
    gains = np.abs([phases.accelerations[:-1], last_gains]).max(axis=0)
    segments = trajectory._segments.select(phases.segments[:-1])
    rates, bends = bound_derivatives(segments, phases.positions[:-1], lengths)
    ahead = np.linalg.norm(rates[:, :dim], axis=1)
    aside = np.linalg.norm(bends[:, :dim], axis=1) + np.abs(segments.curvatures) * ahead
    around = lever * np.linalg.norm(rates[:, dim:], axis=1)
    bounds = np.array([ahead * speeds, around * speeds, ahead * gains + aside * speeds**2])
    bounds *= 1.0 + SPEED_ROUNDING
    return phases.times, np.pad(bounds, ((0, 0), (1, 1)))


def write_csv(
    path: str | os.PathLike[str],
    overwrite: bool,
    names: Sequence[str],
    rows: Iterable[Sequence[float]],
) -> None:
    """Write names and rows of numbers as CSV; see :meth:`planners.Plan.to_csv`."""
    with (
        replacing(path, overwrite) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(rows)


class MotionLimits(NamedTuple):
    """Limits of a motion, as :meth:`planners.Plan.trajectory` takes them."""

    max_velocity: Limits
    max_acceleration: Limits
    max_angular_velocity: float | None = None
    max_angular_acceleration: float | None = None
    max_jerk: Limits = None
    max_angular_jerk: float | None = None
    speed: object = ()  # limits of places


class TimedMotion(NamedTuple):
    """A path with a time law."""

    segments: Segments
    phases: Phases
    begin_velocity: Floats | float = 0.0
    begin_acceleration: Floats | float = 0.0
    olds: int = 0  # number of segments of the motion before, with curves proven then


class DrivenPath(NamedTuple):
    """A path without times, and the robot's motion along it."""

    space: Space | None  # that proved it
    waypoints: Floats
    axes: tuple[str, ...]
    units: tuple[str, ...]
    frame_id: str
    moves_joints: bool
    drive: Drive | None
    exact: bool
    certified: bool  # as the plan is
    blend: bool  # whether corners become curves
    keep: tuple[Upright, ...] = ()  # directions that links of an arm keep
    vias: tuple[int, ...] = ()  # waypoints that curves pass through
    stops: tuple[int, ...] = ()  # waypoints at which the robot rests

    @property
    def edges(self) -> LocalPlanner:
        """Edges of the drive; without a space they prove nothing."""
        return edges_of(self.drive)(cast("Space", self.space), self.drive)


def make_trajectory(
    path: DrivenPath,
    limits: MotionLimits,
    duration: float | None,
    time_step: float,
) -> Trajectory:
    """Make the fastest trajectory along a path; see :meth:`planners.Plan.trajectory`."""
    step = check_positive(time_step, "time_step", "seconds")
    bounds = _check_bounds(path, limits)
    rotations = _rotations_along(path)
    first, *others = _cut_at_stops(path, rotations)
    motion = _start(first, _split(first, rotations, bounds), rotations, bounds)
    motion = _rest_between(motion, others, rotations, bounds)
    phases = _stretch(motion.phases, duration)
    made = _make(path, motion._replace(phases=phases), rotations, bounds, step)
    if made is None:
        raise InputError(
            "limits",
            "differ so much that rounding exceeds them",
            "a motion goes from start to goal within its limits at every instant",
        )
    return made


def check_after(after: object, axes: tuple[str, ...], duration: float | None) -> None:
    """Raise InputError if a path cannot go on after an object."""
    if not isinstance(after, Trajectory) or after.axes != axes:
        raise InputError(
            "after",
            f"is {after!r}",
            f"it must be a trajectory of the axes {', '.join(axes)}",
        )
    if duration is not None:
        raise InputError(
            "duration",
            f"is {duration!r}",
            "a motion that begins at a speed is not slowed down",
        )


def continue_trajectory(
    stop: Trajectory, path: DrivenPath, limits: MotionLimits, time_step: float
) -> Trajectory:
    """Make the fastest trajectory along a stop and a path.

    It follows ``stop`` in part or whole. Without a proven trajectory, return the stop with its
    reason; see :meth:`planners.Plan.trajectory`.
    """
    step = check_positive(time_step, "time_step", "seconds")
    bounds = _check_bounds(path, limits)
    if not len(path.waypoints):
        return _rest(stop, bounds, "the plan has no path")
    rotations = stop._rotations
    onward = _start_at(path, stop.positions[-1], rotations)
    from_rest = onward is not None
    onward = onward or _start_at(path, stop.positions[0], rotations)
    if onward is None:
        places = map(tuple, stop.positions[[0, -1]].tolist())
        raise InputError(
            "at",
            f"is a time at which the robot is at {next(places)}, and can rest at {next(places)}",
            f"the plan starts at {tuple(path.waypoints[0].tolist())}",
        )
    path = onward
    first, *others = _cut_at_stops(path, rotations)
    edges = _split(first, rotations, bounds)
    motion: TimedMotion | None
    if stop.duration == 0.0:
        motion = _start(first, edges, rotations, bounds)
    else:
        motion = _go_on(stop, first, edges, bounds, from_rest)
        if from_rest:
            rows = np.concatenate([stop._route.waypoints, path.waypoints[1:]])
            shift = len(rows) - len(path.waypoints)
            path = path._replace(waypoints=rows, vias=tuple(row + shift for row in path.vias))
    reason = "no curve along the plan is proven and allows the speed and the limits"
    if motion is not None:
        motion = _rest_between(motion, others, rotations, bounds)
        made = _make(path, motion, rotations, bounds, step)
        if made is not None and made.certified:
            return made
        reason = "the motion along the plan is not proven free, or rounding exceeds its limits"
    elif bounds.velocity.shares(stop.velocities[0]).max() > 1.0:
        reason = _describe_speed(stop, bounds)
    return _rest(stop, bounds, reason)


def _describe_speed(stop: Trajectory, bounds: MotionBounds) -> str:
    """Return why a robot cannot go on within limits of velocity that it exceeds."""
    limit = bounds.velocity.linear
    reason = "the robot drives faster than max_velocity, which holds at once"
    if stop._route.moves_joints or limit.ndim:
        return reason
    return f"{reason}; speed={limit:g} with the max_velocity of before slows it down on the way"


def _rest(stop: Trajectory, bounds: MotionBounds, reason: str) -> Trajectory:
    """Return a stop with its reason and new limits of places."""
    bounds = stop._bounds._replace(places=bounds.places, memo=None)
    exceeds_until = find_excess(stop._segments, stop._rotations, bounds, stop._phases)
    return replace(stop, stop_reason=reason, exceeds_until=exceeds_until, _bounds=bounds)


def _start_at(path: DrivenPath, q: Floats, rotations: Rotations) -> DrivenPath | None:
    """Return a path from exactly a configuration, or None."""
    rows = path.waypoints.copy()
    # Continuous joints count whole turns, and quaternions have two signs.
    if path.moves_joints:
        rows += math.tau * np.rint((q - rows[0]) / math.tau)
    elif "qw" in path.axes and q[-4:] @ rows[0, -4:] < 0.0:
        rows[:, -4:] *= -1.0
    gaps = np.abs(rotations.steps_between(rows[0], q))
    # Relative, in metres or radians.
    if (gaps > 1e-6 * np.maximum(measure_sizes(q[np.newaxis], rotations), 1.0)).any():
        return None
    rows[0] = q
    return path._replace(waypoints=rows)


def _join_rows(space: ConfigurationSpace, rows: Floats) -> Floats:
    """Join rows by straight motions within :data:`ROW_ERROR`, shape (n, dof)."""
    parts: list[Floats] = []
    first = 0
    last = len(rows) - 1
    while first < last:
        # The next corner lies between row ``end`` and row ``beyond``, which doubling finds first.
        end = first + 1
        beyond = min(first + 2, last + 1)
        while beyond <= last and _is_straight(rows[first : beyond + 1]):
            end = beyond
            beyond = min(2 * beyond - first, last + 1)
        while beyond - end > 1:
            middle = (end + beyond) // 2
            if _is_straight(rows[first : middle + 1]):
                end = middle
            else:
                beyond = middle
        turns = np.abs(rows[end] - rows[first])[list(space.is_periodic)]
        count = math.ceil(turns.max(initial=0.0) / MAX_EDGE_TURN) if end > first + 1 else 1
        parts.append(np.linspace(rows[first], rows[end], max(count, 1), endpoint=False))
        first = end
    return np.concatenate([*parts, rows[-1:]])


def _is_straight(rows: Floats) -> bool:
    """Return True if rows follow each other along a straight motion."""
    steps = rows - rows[0]
    square = float(steps[-1] @ steps[-1])
    shares = np.clip(steps @ steps[-1] / square, 0.0, 1.0) if square else np.zeros(len(rows))
    # The motion does not turn back.
    nearest = np.maximum.accumulate(shares)[:, np.newaxis] * steps[-1]
    return bool((np.abs(nearest - steps) <= ROW_ERROR).all())


def _warn_of_stops(waypoints: Floats, rows: Floats) -> None:
    """Warn if an arm stops at most of its rows."""
    stops = len(waypoints) - 2
    # Ten stops along rows are no surprise.
    if stops > 10 and stops > len(rows) // 2:
        warn_user(
            f"path: the arm stops at {stops} of {len(rows)} rows, because its joints change their "
            "direction there"
        )


def _cut_at_stops(path: DrivenPath, rotations: Rotations) -> list[DrivenPath]:
    """Cut a path at the waypoints at which the robot rests."""
    rows = align_quaternions(path.waypoints, rotations)
    last = max(len(rows) - 1, 0)
    ends = [0, *sorted({row for row in path.stops if 0 < row < last}), last]
    return [
        path._replace(
            waypoints=rows[first : end + 1],
            vias=tuple(row - first for row in path.vias if first < row < end),
            stops=(),
        )
        for first, end in itertools.pairwise(ends)
    ]


def _rest_between(
    motion: TimedMotion, others: Sequence[DrivenPath], rotations: Rotations, bounds: MotionBounds
) -> TimedMotion:
    """Append other paths to a motion that ends at rest."""
    for path in others:
        onward = _start(path, _split(path, rotations, bounds), rotations, bounds)
        count = len(motion.segments.lengths)
        motion = motion._replace(
            segments=join_segments([motion.segments, onward.segments]),
            phases=join_motions(motion.phases, onward.phases, count),
        )
    return motion


def _start(
    path: DrivenPath, edges: Segments, rotations: Rotations, bounds: MotionBounds
) -> TimedMotion:
    """Return the fastest motion along a path, from rest.

    Limits of places do not change its curve.
    """
    smooth = _smooth(path, edges, rotations, bounds, None)
    curves = [edges] if smooth is None else [smooth, edges]
    if bounds.places is not None and smooth is not None:
        free = bounds._replace(places=None)
        curves = [_find_quickest(curves, rotations, free).segments]
    return _find_quickest(curves, rotations, bounds)


def _find_quickest(
    curves: Sequence[Segments], rotations: Rotations, bounds: MotionBounds
) -> TimedMotion:
    """Return the fastest motion from rest along any of the curves."""
    motions: list[TimedMotion] = []
    for segments in curves:
        phases = find_motion(segments, rotations, bounds)
        if phases is not None:
            motions.append(TimedMotion(segments, phases))
    return min(motions, key=_end_time)


def _go_on(
    stop: Trajectory, path: DrivenPath, edges: Segments, bounds: MotionBounds, from_rest: bool
) -> TimedMotion | None:
    """Return the fastest motion on along a path, perhaps after a stop.

    It leaves the stop at once, or with ``from_rest`` at the stop's end. If no proven curve goes on
    there, or the robot arrives too fast for the curve, the robot rests at the end. Return None if
    that fails: without ``from_rest``, or with other limits than before, which the stop does not
    keep.
    """
    rotations = stop._rotations
    begin, end = stop._phases.positions[[0, -1]].tolist()
    speed = float(stop._phases.speeds[0])
    gain = float(stop._phases.accelerations[0])
    first = stop._segments.select([0])
    state = _move_along(first, rotations, np.array([begin]), speed, gain)[1:]
    driven, length = (stop._segments, end) if from_rest else (first, begin)
    head = cut_segments(driven, rotations, 0.0, length)
    last = head.select([-1])
    _, rates, bends = place_along(last, rotations, last.lengths)
    if not from_rest:
        head, begin = head.select([]), 0.0
    # Below half of full speed, a stop may be quicker than a curve that goes on.
    is_slow = float(bounds.velocity.shares(state[0]).max()) < 0.5
    junction = _make_junction(rates, bends, rotations, bounds, path)
    smooth = _smooth(path, edges, rotations, bounds, junction)
    olds = len(head.lengths)
    motions: list[TimedMotion] = []
    for tail in (edges,) if smooth is None else (smooth, edges):
        # Both curves get the same unit of length if they have the same direction.
        firsts = place_along(tail.select([0]), rotations, np.zeros(1))[1]
        along = bounds.acceleration.multiply(rates, firsts).sum()
        factor = float(along / bounds.acceleration.multiply(rates, rates).sum())
        factor = factor if factor > 1e-3 else 1.0  # rates in other directions have no ratio
        joined = join_segments([scale_segments(last, factor), tail.select([0])])
        if not (from_rest or find_passes(joined, rotations, bounds).all()):
            continue
        segments = join_segments([scale_segments(head, factor), tail])
        begin_state = speed / factor, gain / factor
        if not from_rest:
            begin_state = _project_state(tail.select([0]), rotations, *state)
        phases = find_motion(segments, rotations, bounds, begin / factor, *begin_state)
        if phases is not None:
            motions.append(TimedMotion(segments, phases, *state, olds))
    may_stop = from_rest and are_same_bounds(bounds, stop._bounds)
    if may_stop and (smooth is None or not motions or is_slow):
        rest = _start(path, edges, rotations, bounds)
        segments = join_segments([head, rest.segments])
        phases = join_motions(stop._phases, rest.phases, olds)
        motions.append(TimedMotion(segments, phases, *state, olds))
    return min(motions, key=_end_time, default=None)


def _move_along(
    segments: Segments, rotations: Rotations, length: Floats, speed: float, gain: float
) -> tuple[Floats, Floats, Floats]:
    """Return place, velocity and acceleration at a length, shapes (1, k)."""
    place, rates, bends = place_along(segments, rotations, length)
    # The acceleration across an arc has a separate limit.
    bends = np.where(segments.curvatures[:, np.newaxis], 0.0, bends)
    return place, rates * speed, rates * gain + bends * speed**2


def _project_state(
    segments: Segments, rotations: Rotations, velocity: Floats, acceleration: Floats
) -> tuple[float, float]:
    """Project a velocity and acceleration onto the start of a segment."""
    _, rates, bends = _move_along(segments, rotations, np.zeros(1), 1.0, 0.0)
    square = float((rates * rates).sum())
    speed = float((rates * velocity).sum()) / square
    return speed, float((rates * (acceleration - bends * speed**2)).sum()) / square


def _last_time(phases: Phases) -> float:
    """Return the duration of phases."""
    return float(phases.times[-1])


def _end_time(motion: TimedMotion) -> float:
    """Return the duration of a motion."""
    return _last_time(motion.phases)


def _make(
    path: DrivenPath,
    motion: TimedMotion,
    rotations: Rotations,
    bounds: MotionBounds,
    time_step: float,
) -> Trajectory | None:
    """Make and prove a trajectory; None if rounding exceeds its limits."""
    segments, phases = trim_segments(motion.segments, motion.phases)
    timing = path.waypoints, segments, rotations, phases, bounds
    if not is_motion(*timing, motion.begin_velocity, motion.begin_acceleration):
        return None
    exceeds_until = find_excess(segments, rotations, bounds, phases)
    if exceeds_until and not np.any(motion.begin_velocity):
        return None
    none = np.zeros(0)
    made = Trajectory(
        times=none,
        positions=none,
        velocities=none,
        accelerations=none,
        axes=path.axes,
        units=path.units,
        certified=path.certified,
        _route=path._replace(space=None, stops=()),
        _rotations=rotations,
        _segments=segments,
        _phases=phases,
        _bounds=bounds,
        exceeds_until=exceeds_until,
    )
    made = made._set_rows(made._row_times(time_step))
    space = path.space
    if space is None:
        return made
    if not segments.is_curve.any():
        return replace(made, certified=bool(made._prove_parts(space).all()))
    is_old = np.arange(len(segments.lengths)) < motion.olds - motion.phases.segments[0]
    left = _cut_driven(segments, phases, rotations).select(is_old | ~segments.is_curve)
    return replace(made, certified=bool(prove_segments(space, left).all()))


def _smooth(
    path: DrivenPath,
    edges: Segments,
    rotations: Rotations,
    bounds: MotionBounds,
    junction: Junction | None,
) -> Segments | None:
    """Return a proven smooth path; None if it keeps its edges."""
    space = path.space
    drive = path.edges
    is_straight = junction is None and len(edges.lengths) == 1
    keeps_edges = not path.blend or is_straight or drive.has_curves
    if keeps_edges or space is None or not can_prove_curves(space):
        return None
    if drive.has_heading and bounds.jerk is not None and bounds.jerk.angular is not None:
        return None  # The angular acceleration of a drive jumps along its curves.
    gap = VIA_CELLS * 2.0 * space.resolution if isinstance(space, ConfigurationMap) else 0.0
    vias = align_quaternions(path.waypoints, rotations)[list(path.vias)]
    polyline = make_polyline(edges, rotations, bounds, drive.has_heading, gap, junction, vias)
    return smooth_path(edges, polyline, rotations, lambda parts: prove_segments(space, parts))


def _make_junction(
    rates: Floats, bends: Floats, rotations: Rotations, bounds: MotionBounds, path: DrivenPath
) -> Junction | None:
    """Return the derivatives, at full speed, for a curve to continue.

    Return None if a curve cannot continue the motion. Without a limit of jerk, a change of speed
    along the curve is left out of the second derivatives.
    """
    rates, bends = rates.copy(), bends.copy()
    if path.edges.turns_on_spot:
        # The yaw follows the curve.
        rates[:, 2] = bends[:, 2] = 0.0
    full = float(bounds.velocity.shares(rates).max())
    if full == 0.0 or ("qw" in rotations.names and rates[:, -3:].any()):
        return None
    if bounds.jerk is None:
        squares = bounds.velocity.multiply(rates, rates).sum()
        bends -= bounds.velocity.multiply(rates, bends).sum() / squares * rates
    # Bends at the very end of a motion may be of micrometres, so the robot must be able to follow
    # the bend at 2 % of full speed.
    if float(bounds.acceleration.shares(bends).max()) * 0.02**2 > full**2:
        return None
    return Junction(rates[0] / full, bends[0] / full**2)


def _check_bounds(path: DrivenPath, limits: MotionLimits) -> MotionBounds:
    """Return checked limits of a motion."""
    dim = len(path.axes) - len(_rotations_along(path).names)
    drive = path.edges
    rotates = dim < len(path.axes)
    needs_angular = rotates and not drive.has_curves
    known = path.space.max_velocity if path.space is not None else {}
    max_velocity = _check_limits(path, dim, limits.max_velocity, "max_velocity", "s", known)
    max_acceleration = _check_limits(
        path, dim, limits.max_acceleration, "max_acceleration", "s^2", {}
    )
    max_turn_rate = _check_option(limits, "max_angular_velocity", "rad/s", rotates, needs_angular)
    max_turn_gain = _check_option(
        limits, "max_angular_acceleration", "rad/s^2", rotates, needs_angular
    )
    jerk = None
    max_turn_jerk = _check_option(limits, "max_angular_jerk", "rad/s^3", needs_angular, False)
    if limits.max_jerk is not None:
        max_jerk = _check_limits(path, dim, limits.max_jerk, "max_jerk", "s^3", {})
        jerk = LimitRates(max_jerk, max_turn_jerk, dim)
    elif max_turn_jerk is not None:
        raise InputError(
            "max_jerk",
            "is missing",
            "max_angular_jerk has a value",
        )
    rules = place_limits(limits.speed, path.space, path.axes, path.frame_id)
    max_lateral = drive.max_lateral_acceleration
    return MotionBounds(
        velocity=LimitRates(max_velocity, max_turn_rate, dim),
        acceleration=LimitRates(max_acceleration, max_turn_gain, dim),
        lateral=float(max_acceleration.min()) if max_lateral is None else max_lateral,
        gap=max(drive.max_gap, MAX_ERROR),
        jerk=jerk,
        places=PlacedLimits(rules, _rotations_along(path), dim) if rules else None,
        memo=IntervalMemo(),
    )


def _check_limits(
    path: DrivenPath, dim: int, value: Limits, name: str, time: str, known: Mapping[str, float]
) -> Floats:
    """Return checked limits of the first ``dim`` axes.

    They are per ``time``, "s", "s^2" or "s^3". The shape is (dim,), or () for the whole
    translation. ``known`` are the defaults of axes.
    """
    axes = path.axes[:dim]
    holds_tables = isinstance(value, Mapping) and any(
        isinstance(each, Mapping) for each in value.values()
    )
    if holds_tables or isinstance(value, str | os.PathLike):
        value = read_joint_limits(value, name, dict(zip(axes, path.units, strict=False)))
    finite = {axis: known[axis] for axis in axes if math.isfinite(known.get(axis, math.inf))}
    units = [f"{unit}/{time}" for unit in path.units[:dim]]
    limits = check_each({} if value is None else value, name, axes, units, finite)
    for limit in limits.ravel().tolist():
        check_positive(limit, name, "metres, radians, seconds")
    if path.edges.has_curves and limits.ndim:
        raise InputError(name, f"has shape {limits.shape}", "a car has one for its way ahead")
    return limits + np.zeros(dim) if path.moves_joints else limits


def _check_option(
    limits: MotionLimits, name: str, unit: str, is_allowed: bool, is_needed: bool
) -> float | None:
    """Return a limit that only some robots have, or None."""
    value: float | None = getattr(limits, name)
    if value is None and is_needed:
        raise InputError(name, "is missing", "the robot turns")
    if value is not None and not is_allowed:
        raise InputError(name, f"is {value!r}", "the robot does not turn so")
    return None if value is None else check_positive(value, name, unit)


def _rotations_along(path: DrivenPath) -> Rotations:
    """Return the rotations of the configurations of a path."""
    if path.moves_joints:
        return Rotations.of(None)
    if "qw" in path.axes:
        return Rotations.quaternions(1)
    return Rotations.of(1 if "yaw" in path.axes else None)


def _split(path: DrivenPath, rotations: Rotations, bounds: MotionBounds) -> Segments:
    """Return the straights and arcs of a path."""
    rows = align_quaternions(path.waypoints, rotations)
    return _make_segments(*path.edges.list_segments(rows, rotations), rotations, bounds.velocity)


def _make_segments(
    points: Floats, steps: Floats, radians: Floats, rotations: Rotations, velocity: LimitRates
) -> Segments:
    """Return the segments between points, except rounding errors.

    ``points`` have shape (m + 1, size). Each segment is as long as its seconds at full speed.
    ``radians`` turn the direction of motion.
    """
    moves = np.abs(steps) > ROUNDING * measure_sizes(points, rotations)
    if velocity.angular is None:  # a car only turns as it moves
        moves &= moves[:, : velocity.dim].any(axis=1, keepdims=True)
    steps = np.where(moves, steps, 0.0)
    kept = moves.any(axis=1)
    if not kept.any():  # a plan without motion becomes a segment without length
        return make_lines(points[:1], np.eye(1, steps.shape[1]), np.zeros(1), points[:1])
    lengths = 1.0 / velocity.largest(steps[kept])
    rates = steps[kept] / lengths[:, np.newaxis]
    lines = make_lines(points[:-1][kept], rates, lengths, points[1:][kept])
    return lines._replace(curvatures=radians[kept] / lengths)


def _cut_driven(segments: Segments, phases: Phases, rotations: Rotations) -> Segments:
    """Cut segments at the first and the last phase."""
    return cut_segments(segments, rotations, *phases.positions[[0, -1]].tolist())


def _make_waypoints(segments: Segments, rotations: Rotations) -> Floats:
    """Return configurations between which a drive follows straights and arcs."""
    turns = np.abs(segments.curvatures * segments.lengths)
    # No other curve of a car is as short as an arc of at most 1 rad.
    counts = np.ceil(np.maximum(turns, 1.0)).astype(np.int64)
    owners, numbers = number_parts(counts)
    parts = segments.select(owners)
    rows = place_along(parts, rotations, numbers / counts[owners] * parts.lengths)[0]
    return np.concatenate([rows, segments.ends[-1:]])


def _stretch(phases: Phases, duration: float | None) -> Phases:
    """Slow a motion evenly, to take ``duration`` seconds."""
    total = float(phases.times[-1])
    if duration is None or total == 0.0:
        return phases
    factor = check_positive(duration, "duration", "seconds") / total
    if factor < 1.0 - MAX_ERROR:
        raise InputError(
            "duration",
            f"is {duration!r}",
            f"the limits need {tell_apart(total, factor * total)[0]} s",
        )
    return slow_down(phases, factor)


def _locate(phases: Phases, t: Floats) -> tuple[Ints, Floats, tuple[Floats, Floats]]:
    """Return segments, lengths, speeds and accelerations at times, shape (n,)."""
    phase = np.maximum(np.searchsorted(phases.times, t, side="right") - 1, 0)
    elapsed = np.maximum(t - phases.times[phase], 0.0)
    lengths, speeds, accelerations = phases.at(phase, elapsed)
    return phases.segments[phase], lengths, (speeds, np.where(t < 0.0, 0.0, accelerations))


def _evaluate(
    segments: Segments, phases: Phases, rotations: Rotations, t: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and accelerations at times of shape (n,)."""
    segment, length, (speed, acceleration) = _locate(phases, t)
    positions, first, second = place_along(segments.select(segment), rotations, length)
    velocities = first * speed[:, np.newaxis]
    accelerations = first * acceleration[:, np.newaxis] + second * (speed**2)[:, np.newaxis]
    if "qw" not in rotations.names:
        return rotations.make_canonical(positions), velocities, accelerations
    # The derivative of a quaternion is its product with half the angular velocity, in the robot's
    # frame.
    q = positions[:, -4:]
    half_velocity = 0.5 * velocities[:, -3:]
    half_acceleration = 0.5 * accelerations[:, -3:]
    real_part = -(half_velocity**2).sum(axis=1)
    first = _multiply(q, half_velocity, np.zeros(len(q)))
    second = _multiply(q, half_acceleration, real_part)
    velocities = np.column_stack([velocities[:, :-3], first])
    accelerations = np.column_stack([accelerations[:, :-3], second])
    return positions, velocities, accelerations


def _multiply(q: Floats, vectors: Floats, real_parts: Floats) -> Floats:
    """Multiply quaternions (n, 4) by ``vectors`` (n, 3) and real parts (n,)."""
    own_vectors = q[:, :3]
    own_parts = q[:, 3]
    products = real_parts[:, np.newaxis] * own_vectors + own_parts[:, np.newaxis] * vectors
    products += np.cross(own_vectors, vectors)
    return np.column_stack([products, own_parts * real_parts - (own_vectors * vectors).sum(axis=1)])

"""Plans: the paths that searches found, with their proofs."""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace import CSpace, Space
from cspace.errors import InputError
from cspace.inside import (
    Bools,
    Drive,
    Floats,
    Upright,
    check_number,
    check_positive,
    names_options,
    replacing,
    show_png,
)
from planners._catalogue import PlannerName
from planners._edges.drives import check_axes, edges_of, local_planner
from planners._edges.local_planner import LocalPlanner
from planners._edges.own_space import POSE_AXES
from planners._space_kinds import is_tiled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.plot import PlotOptions
    from cspace.reasons import Explanation
    from cspace.regions import Corridor
    from planners._motion.speed_limits import SlowNear, SpeedZones, ToolSpeed
    from planners._motion.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Times:
    """Durations of the steps of :func:`planners.plan`, in seconds.

    The time limit applies to planning. The first plan on a map also computes the caches that all
    later plans use, such as components and, for the objective "clearance", every cell's clearance.
    Caches take seconds on a map of 10^8 cells.

    Attributes
    ----------
    setup : float
        Checks of the input, the test whether a path exists, OMPL's set-up, caches of the map, and
        compilation.
    planning : float
        The search, and shortening the path, as the time limit counts them, without compilation.
    checking : float
        The final check of every edge; without a path, the searches that test the hint.
    """

    setup: float = 0.0
    planning: float = 0.0
    checking: float = 0.0


@names_options
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Plan:
    """A path and its proofs.

    Without a path, the status gives the reason.

    Attributes
    ----------
    path : ndarray of float64, shape (n, size), read-only
        Configurations from start to goal, in metres; shape (0, size) if not solved. If the robot
        turns on the way, rows are added on the edges between waypoints, at most a cell and 5
        degrees apart, so that the path can be driven and drawn. Yaw is in radians, in [-pi, pi): it
        jumps by 2 pi when it passes pi.
    waypoints : ndarray of float64, shape (m, size), read-only
        Rows of the path that edges join. For a differential drive, they include the rows at which
        it begins to turn or to drive: straight edges join them, so that
        :meth:`cspace.CSpace.certify_path` proves both waypoints and path.
    start, goal : ndarray of float64, shape (size,), read-only
        Endpoints of the search, as planners hold them: yaw in [-pi, pi), a quaternion of norm 1,
        the joints of an arm within their limits. A continuous joint starts at the given number, and
        its goal is within half a turn; the path may end whole turns from that. Among several, the
        ends of the path, or if not solved the most promising ones.
    axes : tuple of str
        Names of the columns of the path, equal to :attr:`cspace.CSpace.axes`.
    units : tuple of str
        Units of these columns: "m", "rad", or "1" for the numbers of a quaternion.
    length_unit : str
        Unit of :attr:`length` and :attr:`clearance`: "m"; for motions of joints "rad", or "rad or
        m" if some joints slide. The unit of :attr:`obstacle_distance` is always metres.
    direction : ndarray of int8, shape (n,), read-only, or None
        Motion of the robot from the previous row to each row: 1 ahead, -1 in reverse, 0 turning on
        the spot. The first row repeats the second. None for a holonomic robot.
    certified : bool
        Whether every edge between the waypoints was proven free **when it was planned**, by the
        map, or with ``exact`` by the map and the geometry, checked again after OMPL was done;
        curves are proven along the real curve. It does not change when obstacles change:
        :meth:`recheck` proves the edges now.
    status : str
        The result in a line: a path, or whether one is proven to exist.
    hint : str
        Advice if the search found no path though one may exist; otherwise empty.
    length : float
        Metres that the reference point moves, along curves too; turning on the spot counts nothing.
        For an arm, the length in its joints, in which a radian counts as a metre. NaN if not
        solved.
    total_rotation : float
        Radians that the robot turns along the path. Planners minimise the length plus half a metre
        for each radian, but along curves the length alone. Zero for an arm, NaN if not solved.
    is_connected : bool
        Whether the map, or the path itself, proves that a path exists for a holonomic robot, from
        a start through each place on the way to a goal.
    is_disconnected : bool
        Whether the map proves that none exists. If both are False, the map does not decide.
    planner : str
        Name of the planner.
    objective : str
        Quantity that was minimised: ``"length"``, ``"clearance"``, ``"time"``,
        ``"WeightedLength"``, or ``"custom"`` by a function.
    drive : Car, Differential or None
        Motion of the robot along edges; None for a holonomic robot.
    exact : bool
        Whether the geometry itself decided edges in MIXED cells; True for an arm and a space of
        your own.
    times : Times
    frame_id : str
        Frame of the map in ROS, :attr:`cspace.CSpace.frame_id`.
    keep : tuple of Upright
        Directions that links of an arm keep along every certified edge.
    space : Space or None
        The map that it was planned on; None after pickling or copying, which drop the map and keep
        the present values of :attr:`clearance`, or for an arm :attr:`obstacle_distance`, and
        :attr:`lower_bound`.
    via_rows : tuple of int
        Row of the path at each place of ``via``; empty without places, and if not solved.
    """

    path: Floats
    waypoints: Floats
    start: Floats
    goal: Floats
    axes: tuple[str, ...]
    units: tuple[str, ...]
    length_unit: str
    direction: NDArray[np.int8] | None
    certified: bool
    status: str
    hint: str
    length: float
    total_rotation: float
    is_connected: bool
    is_disconnected: bool
    planner: PlannerName
    objective: str
    drive: Drive | None
    exact: bool
    times: Times
    frame_id: str = "map"
    keep: tuple[Upright, ...] = ()
    space: Space | None = None
    via_rows: tuple[int, ...] = ()
    _vias: tuple[int, ...] = ()  # waypoints at the places of ``via``
    _via_stops: tuple[int, ...] = ()  # waypoints of ``via`` with a turn on the spot to a given yaw
    _kept: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    def __getstate__(self) -> list[Any]:
        """Return the state for pickling: distances instead of the map."""
        clearance = self.clearance
        distance = self.obstacle_distance if math.isnan(clearance) else math.nan
        state = {field.name: getattr(self, field.name) for field in fields(self)}
        state |= {"space": None, "_kept": (clearance, distance, self.lower_bound)}
        return list(state.values())

    @property
    def clearance(self) -> float:
        """Proven lower bound of the path's clearance, in :attr:`length_unit`.

        It holds in the map as it is now. Clearance is the distance from a configuration on the path
        to the nearest configuration that is not FREE, at the same rotation. Zero along a path
        through MIXED cells. NaN for an arm, and if not solved. Computed at each access; the first
        one on a map takes longer.
        """
        edges = self._edges
        return self._kept[0] if edges is None else edges.clearance(self.waypoints)

    @property
    def obstacle_distance(self) -> float:
        """Proven lower bound of the distance from obstacles, metres.

        The distance is measured from the robot itself, without margin, to the obstacles as they are
        now. These are their shapes if the map has them, otherwise the outer cells; and, unless the
        map is open, its border. For an arm and a map of joints, distances between links count too.
        The bound is at least the margin, which a map on a floor keeps sideways alone, and at most a
        quarter of a cell below the true minimum; on a map of joints, at most the travel of the
        links in a quarter of a cell. It is infinite if there is no obstacle, and zero if the path
        is no longer proven free.

        NaN if not solved, or if the map was left behind (except for an arm), is tiled, or is a map
        of joints from a file. Also NaN if the interior of a mesh depends on the spacing. Computed
        at each access; the first one on a map takes longer.
        """
        edges = self._edges
        return self._kept[1] if edges is None else edges.obstacle_distance(self.waypoints)

    @property
    def lower_bound(self) -> float:
        """Proven lower bound of the lengths of collision-free paths.

        A radian of rotation counts as half a metre, but along curves nothing. On a map, the bound
        comes from :meth:`cspace.CSpace.min_path_length` and the rotation between start and goal. On
        a tiled map it is the straight distance, and for an arm the distance in the joints,
        continuous ones the shorter way. Among several starts and goals, the path's ends count; with
        places on the way, the sum of the bounds between them. It holds for the obstacles as they
        are now, and for a robot that may move in any direction. NaN if not solved. Computed at each
        access.
        """
        edges = self._edges
        if edges is None:
            return self._kept[2]
        places = [self.start, *self.waypoints[list(self._vias)], self.goal]
        return math.fsum(edges.min_length(*ends) for ends in itertools.pairwise(places))

    @property
    def gap(self) -> float:
        """Fraction by which the path may be too long.

        It is the weighted length / :attr:`lower_bound` - 1. The true excess may be far smaller,
        because no path need be as short as the bound. NaN if not solved.
        """
        length = self.length + edges_of(self.drive).rotation_weight * self.total_rotation
        bound = self.lower_bound
        if bound > 0.0:
            return max(0.0, length / bound - 1.0)
        return math.inf if length > 0.0 else length

    @property
    def _edges(self) -> LocalPlanner | None:
        """Local planner on the map; None without path or map."""
        if self.space is None or not self:
            return None
        return self._edges_on(self.space)

    def _edges_on(self, space: Space) -> LocalPlanner:
        """Return the local planner on a map."""
        return local_planner(space, self.drive, exact=self.exact, keep=self.keep)

    def _map(self) -> Space:
        """Return the map, or raise InputError after pickling."""
        if self.space is None:
            raise InputError("plan", "has no map", "pickling leaves the map behind")
        return self.space

    def _picture(self) -> Any:
        """Return the space to draw, or raise InputError after pickling."""
        space: Any = self._map()
        if is_tiled(space):
            return space.overview()
        if not hasattr(type(space), "plot"):  # a space of the user's may have it
            raise InputError("plan", f"is in {space!r}", "only maps and arms are drawn")
        return space

    def recheck(self, space: Space | None = None) -> Bools:
        """Prove each edge again, among present obstacles.

        Edges are proven like the plan's: with the same ``exact`` and drive, along the same curves.

        Parameters
        ----------
        space : Space, optional
            Map to prove them on; by default the map of the plan.

        Returns
        -------
        ndarray of bool, shape (m - 1,)
            True if the edge from a waypoint to the next is proven free now. Shape (1,) for a path
            of one configuration.

        Raises
        ------
        InputError
            If the plan has no path, or was pickled and ``space`` is left out, or ``space`` has
            other axes.

        Examples
        --------
        >>> import numpy as np, shapely, cspace, planners
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> plan = planners.plan(space, (1.0, 1.5), (3.0, 1.5))
        >>> update = space.add_obstacle("cart", shapely.box(1.8, 1.3, 2.2, 1.7))
        >>> plan.certified, plan.recheck().tolist()
        (True, [False])
        """
        self._check_solved("only a path has edges")
        space = self._map() if space is None else space
        edges = self._edges_on(space)
        check_axes(space, self.axes, "plan")
        return edges.edges_are_free(self.waypoints)

    @names_options
    def explain(self, *, refine: bool = False) -> Explanation:
        """Explain why a path from start to goal exists, or does not.

        See :meth:`cspace.CSpace.explain`, which this calls. It is about a holonomic robot, and
        says so if the plan has another drive.

        Parameters
        ----------
        refine : bool
            Build finer maps, which narrow the margins and may decide.

        Returns
        -------
        cspace.reasons.Explanation

        Raises
        ------
        InputError
            If the plan has no map in memory of positions, with or without a yaw.
        """
        space = self._map()
        if not isinstance(space, CSpace):
            raise InputError("plan", f"is in {space!r}", "only maps in memory explain")
        explanation = space.explain(self.start, self.goal, refine=refine)
        return replace(explanation, moves_sideways=not edges_of(self.drive).has_heading)

    def __bool__(self) -> bool:
        """Return whether the path reaches the goal; approximate solutions are discarded."""
        return len(self.waypoints) > 0

    def __repr__(self) -> str:
        """Return a summary in a few lines.

        It omits :attr:`obstacle_distance`, whose proof compiles for seconds at its first use.
        Without a path it has the reason, which may take some seconds for a large map.
        """
        return "Plan(" + "\n     ".join(self._lines()) + ")"

    def _lines(self) -> list[str]:
        """Return the lines of the summary."""
        axes = ", ".join(self.axes)
        result = f"{self.planner}: {self.status}"
        ends = self.waypoints[[0, -1]] if self else np.array([self.start, self.goal])
        # Nanometres and nanoradians are enough.
        between = " to ".join(str(tuple(q)) for q in np.round(ends, 9).tolist())
        if not self:
            hints = [f"try {self.hint}"] if self.hint else []
            return [result, f"from {between} ({axes})", *self._reasons, *hints]
        measures = [f"{self.length:.3f} {self.length_unit}"]
        if self.total_rotation:
            measures.append(f"total rotation {self.total_rotation:.2f} rad")
        edges = "straight edges" if self.drive is None else f"drive: {self.drive}"
        times = self.times
        return [
            f"{result}, {self._proof}; {', '.join(measures)}",
            f"{len(self.waypoints)} waypoints ({axes}) from {between}, {edges}",
            *([self.space.unchecked] if self.space and self.space.unchecked else []),
            f"planned in {_format_seconds(times.planning)}, "
            f"set up in {_format_seconds(times.setup)}, "
            f"checked in {_format_seconds(times.checking)}",
        ]

    @property
    def _reasons(self) -> list[str]:
        """First sentence of the explanation without a path, if known."""
        if find_spec("cspace.reasons") is None:  # the package works without it
            return []
        try:
            explanation = self.explain()
        except InputError:  # the space explains nothing
            return []
        return [] if explanation.verdict == "connected" else explanation.sentences[:1]

    @property
    def _proof(self) -> str:
        """Text about the proof, when planned and now."""
        if not self.certified:
            return "not certified"
        if self.space is None:
            return "certified when planned"
        free = self.recheck()
        if free.all():
            return "certified"
        lost = np.count_nonzero(~free)
        return f"certified when planned, {lost} of {len(free)} edges no longer proven free"

    def plot(self, **options: Unpack[PlotOptions]) -> Axes:
        """Draw map, path and the robot along it.

        A map in tiles is drawn as an overview.

        Parameters
        ----------
        **options
            Of :meth:`cspace.CSpace.plot`, e.g. ``view="3d"``.

        Returns
        -------
        matplotlib.axes.Axes
            The axes, which a notebook shows as the picture; ``ax.figure`` is the figure.

        Raises
        ------
        InputError
            If the plan was pickled, which leaves the map behind; or as
            :meth:`cspace.CSpace.plot`.
        """
        options.setdefault("path", self)
        axes: Axes = self._picture().plot(**options)
        return axes

    _repr_png_ = show_png

    @names_options
    def corridor(self, *, reach: float = 5.0, margin: float = 0.0) -> Corridor:
        """Find convex regions of FREE configurations along the path.

        Each edge lies in one region, as it is driven: a car's curve, too. Each region overlaps the
        next in a row of the path. From the start on, each region takes the largest number of edges
        that the search finds. See :meth:`cspace.CSpace.free_region` for the maps that have regions.

        Parameters
        ----------
        reach, margin : float
            As for :meth:`cspace.CSpace.free_region`, around edges. Shortest paths pass corners of
            cells nearer than a hundredth of a cell, so plan with ``objective="clearance"`` for a
            larger margin.

        Returns
        -------
        cspace.regions.Corridor

        Raises
        ------
        InputError
            If the plan has no path or no proof, was pickled, or crosses MIXED cells or passes them
            within the margin: the message names the edge and a smaller margin; or its space is no
            map in memory of positions, with or without a yaw.

        Examples
        --------
        >>> import numpy as np, cspace, planners
        >>> occupied = np.zeros((60, 40), dtype=bool)
        >>> occupied[30, :25] = True
        >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
        >>> plan = planners.plan(space, (1.0, 1.0), (5.0, 1.0))
        >>> corridor = plan.corridor()
        >>> corridor, corridor.junctions.shape
        (Corridor(5 regions along 5 edges), (4, 2))
        """
        from cspace.regions import make_corridor

        self._check_solved("a corridor follows a path")
        if not self.certified:
            rule = "regions contain what is proven"
            raise InputError("plan", "is not certified", rule)
        space = self._map()
        edges = self._edges_on(space)
        rows, deviation = edges.list_chords(self.waypoints)
        return make_corridor(space, rows, reach, margin, deviation)

    @names_options
    def to_path(
        self, msg: Any = None, *, frame_id: str | None = None, step: float | None = None
    ) -> Any:
        """Convert a rigid robot's path to ``nav_msgs/Path``.

        Parameters
        ----------
        msg : object, optional
            A message to fill, of ROS 1 or 2: any object with the fields of ``nav_msgs/Path``. A new
            object with these if left out.
        frame_id : str, optional
            Frame of the header and of each pose; by default :attr:`frame_id`. The header keeps its
            stamp, and each pose gets it.
        step : float, optional
            Largest distance of successive poses along the path, metres, as controllers want it;
            they also turn by 5 degrees at most.

        Returns
        -------
        object
            The message, with one pose for each row of :attr:`path`, or by ``step``. A map of the
            plane gives z = 0; a robot that does not turn has the identity as its orientation. The
            message cannot hold :attr:`direction`.

        Raises
        ------
        InputError
            If the plan has no path or moves joints, the message lacks a field, or ``step`` is not
            above zero, makes a million poses, or comes with a plan that was pickled, which leaves
            the map behind.
        """
        from cspace.export import fill_path
        from cspace.ros import Path
        from planners._motion.trajectory import MAX_ROWS

        if self._moves_joints:
            raise InputError(
                "plan",
                f"moves the joints {', '.join(self.axes)}",
                "a path holds poses",
            )
        self._check_solved("a message holds a path")
        filled = Path() if msg is None else msg
        rows = self.path
        if step is not None:
            metres = check_positive(step, "step", "metres")
            if self.length / metres >= MAX_ROWS:
                rule = f"it makes {self.length / metres:.2g} poses; at most {MAX_ROWS} are possible"
                raise InputError("step", f"is {step!r}", rule)
            rows = self._edges_on(self._map()).resample(self.waypoints, metres)
        frame = self.frame_id if frame_id is None else frame_id
        return fill_path(self.axes, rows, filled, frame)

    @names_options
    def trajectory(
        self,
        *,
        max_velocity: ArrayLike | Mapping[str, Any] | os.PathLike[str] | None = None,
        max_acceleration: ArrayLike | Mapping[str, Any] | os.PathLike[str],
        max_angular_velocity: float | None = None,
        max_angular_acceleration: float | None = None,
        max_jerk: ArrayLike | Mapping[str, Any] | os.PathLike[str] | None = None,
        max_angular_jerk: float | None = None,
        speed: SpeedZones | SlowNear | ToolSpeed | Sequence[SpeedZones | SlowNear | ToolSpeed] = (),
        duration: float | None = None,
        time_step: float = 0.1,
        blend: bool = True,
        stop_at_via: bool = False,
        after: Trajectory | None = None,
        at: float = 0.0,
    ) -> Trajectory:
        """Compute the fastest motion along the path within limits.

        It ends at rest, and begins at rest unless it continues another motion. The path becomes a
        smooth curve that passes outside its corners, a cubic B-spline, wherever the map proves it
        free. The robot stops at corners without a proven curve, at cusps, and before and after
        other turns on the spot. It does not stop between edges of the same direction, nor between
        the arcs and straights of a car.

        Limits hold at every instant. Speeds along a curve are the largest that they allow, with
        constant accelerations between points of the curve (J. E. Bobrow and others, 1985; H. Pham
        and Q.-C. Pham, 2018). With ``max_jerk`` they are the shortest on a straight line, and near
        the shortest on curves.

        Curves are proven by FREE cells alone, even if the plan is ``exact``, or by the hulls of an
        arm. Without a proof, as in a space of your own or after pickling, all corners stop the
        robot; so do corners of quaternions beside an edge that rotates.

        Parameters
        ----------
        max_velocity : float, array-like of shape (k,), or mapping of axes to floats, optional
            Largest speed, in m/s or rad/s. One number is for the reference point, or for each
            joint; several are for the axes, without rotations. The joints that are not given have
            the velocity limits of the URDF. A path is of MoveIt's ``joint_limits.yaml``.
        max_acceleration : float, array-like of shape (k,), or mapping of axes to floats
            Largest acceleration along the path, likewise. A URDF has none.
        max_angular_velocity, max_angular_acceleration : float, optional
            Of a robot that turns, rad/s and rad/s^2; required except for cars. A car given a
            largest angular acceleration stops to steer, since its yaw rate cannot jump; by default
            its steering is instant.
        max_jerk : float, array-like of shape (k,), or mapping of axes to floats, optional
            Largest jerk, like ``max_acceleration``, in m/s^3 or rad/s^3. The acceleration is then
            continuous; for a car, only the acceleration along its curve. Ramps of the speed are
            double S (L. Biagiotti and C. Melchiorri, 2008). Default: no limit.
        max_angular_jerk : float, optional
            Of a robot that turns, but no car, rad/s^3; only with ``max_jerk``. A differential drive
            given one stops at corners, since its angular acceleration jumps along curves.
        speed : SpeedZones, SlowNear, ToolSpeed, or a list of these
            Largest speeds, which hold at every instant: in zones and near obstacles, or of links of
            an arm. The lowest one counts. If a motion begins too fast, it brakes at once, and
            :attr:`planners.Trajectory.exceeds_until` says until when.
        duration : float, optional
            Seconds of the whole trajectory, to which the fastest one is slowed down evenly.
        time_step : float
            Largest time between rows, seconds. Each jump of acceleration or jerk adds a row, and
            between two rows the robot turns less than halfway.
        blend : bool
            Whether corners become curves. If False, the robot stays on the edges of the path, and
            stops at corners.
        stop_at_via : bool
            Whether the robot rests at each place of ``via``. Otherwise curves pass through these
            places. It rests there all the same if no curve is proven, and if it has to turn on the
            spot to a yaw that the place asks for. For a robot that turns on the spot, a curve
            through a sharp corner may take longer than a rest.
        after : Trajectory, optional
            A motion of this robot, which it drives until the time ``at``. The new one begins in
            that state, with a continuous velocity and curvature. The plan starts at a row of
            ``after.starts_after(at)``: the place of that state, or the end of ``after.braked(at)``,
            to which the robot follows the old curve. There it does not stop if a curve goes on
            smoothly. If the plan has no path, or none that is proven and that the speed allows, it
            is ``after.braked(at)``, and ``stop_reason`` says why.
        at : float
            Seconds from the start of ``after``, time 0 of the new trajectory.

        Raises
        ------
        InputError
            If the plan has no path; a limit is missing, not above zero, or for another kind of
            robot; all zones lie off the map, or in another frame, or an arm has no such link; the
            limits do not allow the duration; or the plan does not start at a row of
            ``after.starts_after(at)``, or ``after`` has other axes.

        Examples
        --------
        >>> import numpy as np, cspace, planners
        >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
        >>> plan = planners.plan(space, (0.5, 1.5), (3.5, 1.5))
        >>> trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
        >>> trajectory.duration, trajectory.sample(2.0)[0].tolist()
        (5.0, [1.5, 1.5])
        """
        from planners._motion.trajectory import (
            DrivenPath,
            MotionLimits,
            check_after,
            continue_trajectory,
            make_trajectory,
        )

        if after is None:
            self._check_solved("a trajectory follows a path")
            if check_number(at, "at") != 0.0:
                raise InputError("at", f"is {at!r}", "it is a time of the motion given as after")
        limits = MotionLimits(
            max_velocity,
            max_acceleration,
            max_angular_velocity,
            max_angular_acceleration,
            max_jerk,
            max_angular_jerk,
            speed,
        )
        path = DrivenPath(
            space=None if self.space is None else self._edges_on(self.space).space,
            waypoints=self.waypoints,
            axes=self.axes,
            units=self.units,
            frame_id=self.frame_id,
            moves_joints=self._moves_joints,
            drive=self.drive,
            exact=self.exact,
            certified=self.certified,
            blend=bool(blend),
            keep=self.keep,
            vias=self._vias,
            stops=self._vias if stop_at_via else self._via_stops,
        )
        if after is None:
            return make_trajectory(path, limits, duration, time_step)
        check_after(after, self.axes, duration)
        return continue_trajectory(after.braked(at), path, limits, time_step)

    @property
    def _moves_joints(self) -> bool:
        """Whether configurations are joint positions instead of poses."""
        if self.space is None:
            return not POSE_AXES.issuperset(self.axes)
        return not self.space.has_poses

    def _check_solved(self, rule: str) -> None:
        """Raise InputError with `rule` without a path."""
        if not self:
            raise InputError("plan", f"has no path: {self.status}", rule)

    @names_options
    def to_csv(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the path as CSV, in full precision.

        The first row holds the names of the columns. The columns are the :attr:`axes`, in metres
        and radians, and :attr:`direction` unless the robot is holonomic.

        Parameters
        ----------
        path : path-like
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        InputError
            If the plan has no path.
        FileError
            If the file exists and may not be replaced, or cannot be written.
        """
        from planners._motion.trajectory import write_csv

        self._check_solved("a table has the rows of a path")
        names = self.axes
        rows = self.path.tolist()
        if self.direction is not None:
            names = (*names, "direction")
            rows = [[*q, sign] for q, sign in zip(rows, self.direction.tolist(), strict=True)]
        write_csv(path, overwrite, names, rows)

    @names_options
    def to_json(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write all attributes except the map as JSON.

        NaN and infinity become null; a drive is its ``type`` and its fields. Parameters and errors
        are as for :meth:`to_csv`.
        """
        names = [
            field.name for field in fields(self) if field.name != "space" and field.name[0] != "_"
        ]
        names += ["clearance", "obstacle_distance", "lower_bound", "gap"]
        record = {name: _to_json_type(getattr(self, name)) for name in names}
        text = json.dumps(record, indent=2, allow_nan=False) + "\n"
        with replacing(path, overwrite) as temporary:
            temporary.write_text(text, "utf-8", newline="")


def _to_json_type(value: object) -> object:
    """Convert a value to a JSON type."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Drive):
        return {"type": type(value).__name__, **asdict(value)}
    if isinstance(value, Times | Upright):
        return asdict(value)
    if isinstance(value, tuple):
        return [_to_json_type(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _format_seconds(seconds: float) -> str:
    """Format a duration in seconds or milliseconds."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"

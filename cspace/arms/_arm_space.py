"""ArmSpace: proofs of the configurations and motions of an arm among obstacles."""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace import BLOCKED, FREE, MIXED, Workspace
from cspace.arms._checks import check_mapping, check_names, check_rigid
from cspace.arms._inverse import (
    PoseGoal,
    check_pose_tolerance,
    descend,
    make_pose_problem,
    make_pose_scratch,
)
from cspace.arms._model import (
    CONTACT_SAMPLES,
    LIMIT_SLACK,
    Arm,
    Names,
    list_untested,
    sort_pair,
    tell_untested,
)
from cspace.arms._moveit import PlanningScene, find_base_pose
from cspace.arms._paths.lines import (
    DEFAULT_LINE_TOLERANCE,
    LineMotion,
    check_corners,
    follow_lines,
    make_lines,
)
from cspace.arms._paths.two_trees import PathSearch
from cspace.arms._posed_shapes import PosedShape, named_obstacles, place_obstacle, place_shape
from cspace.arms._snapshots import Contact, Snapshot, make_snapshot
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    Bools,
    ConfigurationSpace,
    Endpoint,
    Floats,
    Ints,
    PlaceLike,
    SearchOptions,
    ShapeLike,
    States,
    Upright,
    as_shape,
    bind_kernel,
    check_finite,
    check_known,
    check_not_negative,
    check_rng,
    check_text,
    make_scene_scratch,
    motion_is_free,
    names_options,
    show_png,
    turn_near,
    wrap_angles,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.plot import HasPath

CHECKING_STEP: Final = 0.01
"""Joint distance (rad, m) between states when OMPL itself checks a motion."""


_DISTANCE_SHARES: Final = (0.95, 0.8, 0.6, 0.4, 0.2, 0.1, 0.03, 0.0)
"""Fractions of (smallest distance at points of a path - margin) tried for the whole path; 0 tries
the margin itself."""


class ArmSpace(ConfigurationSpace):
    """Configurations of an arm among obstacles.

    :func:`build_arm_space` makes one. A configuration is FREE if no link touches an obstacle, or
    another link that it may not touch, according to the given collision geometry. Touching is a
    collision. A configuration is BLOCKED if a link and such an obstacle or link have a proven
    common point, and MIXED if neither is proven. A motion moves all joints along the straight line
    between two configurations, and is proven as a whole.

    Configurations up to 1e-5 rad (m) beyond a limit are accepted, because files round limits and
    configurations differently. States and proofs hold for the configuration as given. Paths stay
    within the limits: :func:`planners.plan` moves a start or goal onto a limit that it exceeds.

    The scene may change: :meth:`add_obstacle`, :meth:`remove_obstacle`, :meth:`attach`,
    :meth:`detach`, :meth:`set_padding`, :meth:`allow_collisions` and :meth:`forbid_collisions` make
    the space equal to a new one, without building it again. A query of another thread sees the
    scene before a change or after it, never a mixture. Checkers follow the changes.
    ``copy.copy(space)``, as quick as a query, does not: plan in a copy if other threads change the
    scene. Maps of joints (:func:`cspace.build_joint_map`) are not updated; build them again.
    """

    has_poses = False
    resolution = CHECKING_STEP
    searches = ("BiRRT",)

    def __init__(self, snapshot: Snapshot, base: Floats) -> None:
        """Begin with a scene; ``base``, shape (4, 4), places further obstacles in its frame."""
        self.snapshot = snapshot
        self._base = base
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy or pickle the scene, without locks and scratch memory."""
        return type(self), (self.snapshot, self._base)

    @property
    def arm(self) -> Arm:
        """The arm with all attached objects."""
        return self.snapshot.arm

    @property
    def obstacles(self) -> dict[str, PosedShape]:
        """The obstacles by name, a copy, as :meth:`add_obstacle` takes them.

        Their poses lead to the frame of the obstacles; see ``base_pose`` of
        :func:`cspace.build_arm_space`.
        """
        to_obstacles = np.linalg.inv(self._base)
        return {
            name: PosedShape(placed.shape, to_obstacles @ placed.pose)
            for name, placed in self._placed_obstacles.items()
        }

    @property
    def _placed_obstacles(self) -> dict[str, PosedShape]:
        """The obstacles in the frame of the arm's base."""
        obstacles = self.snapshot.obstacles
        return {name: placed for name, placed in obstacles.items() if placed is not None}

    @property
    def margin(self) -> float:
        """Metres that FREE keeps between links and everything else."""
        return self.snapshot.margin

    @property
    def padding(self) -> dict[str, float]:
        """Metres added to the margin by name, a copy; see :meth:`set_padding`."""
        return dict(self.snapshot.padding)

    @property
    def allowed_collisions(self) -> list[tuple[str, str]]:
        """Pairs that may touch, in addition to :attr:`Arm.allowed_collisions`."""
        return sorted(self.snapshot.allowed)

    @property
    def unchecked(self) -> str:
        """Text about the pairs that may touch, which no proof tests; empty if there are none."""
        now = self.snapshot
        # No proof moves obstacles against each other.
        bodies = {link.name: link.body for link in now.arm.links} | dict.fromkeys(now.obstacles, -1)
        pairs = [*now.arm.allowed_collisions, *sorted(now.allowed)]
        return tell_untested(list_untested(bodies, dict.fromkeys(pairs)))

    def __repr__(self) -> str:
        """Return the arm and the number of joints and obstacles."""
        return f"ArmSpace({self.arm.name}: {self.arm.dof} joints, {len(self.obstacles)} obstacles)"

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the joints of a configuration."""
        return self.arm.joints

    @property
    def units(self) -> tuple[str, ...]:
        """Units of joints: "rad", or "m" for prismatic ones."""
        return self.arm.units

    @property
    def periodic_axes(self) -> tuple[bool, ...]:
        """Whether each joint is continuous.

        A whole turn of a continuous joint leads to the same configuration. A joint that moves
        another joint by a fraction of its angle is not periodic.
        """
        return tuple((np.isinf(self.arm.upper) & self.arm._whole_turns).tolist())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Limits of the joints, of joints that turn at most two revolutions to each side.

        A joint may have no limits and still not be periodic: if another follows it by half, it
        repeats after two revolutions.
        """
        most = np.where(np.array(self.units) == "rad", 2.0 * math.tau, np.inf)
        return np.maximum(self.arm.lower, -most), np.minimum(self.arm.upper, most)

    @property
    def max_velocity(self) -> dict[str, float]:
        """Velocity limits of the URDF by joint; infinite if it has none."""
        return dict(zip(self.arm.joints, self.arm.max_velocity.tolist(), strict=True))

    # ---- changes of the scene --------------------------------------------------------------------

    @names_options
    def add_obstacle(
        self,
        name: str,
        shape: Workspace | PosedShape | ShapeLike,
        pose: ArrayLike | None = None,
        *,
        radius: ArrayLike | None = None,
        padding: float | None = None,
        touch_links: str | Iterable[str] = (),
    ) -> None:
        """Add a named obstacle, or replace an obstacle of the same name.

        A shape that is replaced keeps its padding and the links that may touch it.

        Parameters
        ----------
        name : str
            A name that no link and no attached object has.
        shape : Workspace, PosedShape or shape
            As for :func:`cspace.build_arm_space`; or points, shape (n, 3), with their radius, such
            as a point cloud.
        pose : array-like, shape (4, 4), optional
            From the frame of the shape to that of the obstacles; the identity by default.
        radius : array-like, shape () or (n,), optional
            Radius of the balls around points, metres, zero or above.
        padding : float, optional
            Metres added to the margin; see :meth:`set_padding`.
        touch_links : str or iterable of str
            Links and attached objects that may touch it.

        Raises
        ------
        InputError
            If the name is taken, a link is unknown, or the obstacle is invalid, as for
            :func:`cspace.build_arm_space`; nothing changes then.
        ConfigurationError
            If no configuration would be free, as for :func:`cspace.build_arm_space`; nothing
            changes then.

        Examples
        --------
        >>> import pathlib, tempfile, cspace
        >>> box = '<geometry><box size="1 0.1 0.1"/></geometry>'
        >>> bar = f'<collision><origin xyz="0.5 0 0"/>{box}</collision>'
        >>> ends = '<parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>'
        >>> joint = f'<joint name="turn" type="continuous">{ends}</joint>'
        >>> path = pathlib.Path(tempfile.mkdtemp(), "one.urdf")
        >>> links = f'<link name="base"/><link name="bar">{bar}</link>'
        >>> _ = path.write_text(f'<robot name="one">{links}{joint}</robot>')
        >>> space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
        >>> space.add_obstacle("post", cspace.Robot.box((0.1, 0.1, 1.0), center=(0.8, 0.0, 0.0)))
        >>> space.add_obstacle("cloud", [(0.0, 0.6, 0.0), (0.0, 0.7, 0.1)], radius=0.01)
        >>> space.is_free([(0.0,), (1.5708,), (3.0,)]).tolist()
        [False, False, True]
        >>> space.remove_obstacle("post")
        >>> space.is_free((0.0,))
        True
        """
        check_text(name, "name")
        base = self._base if pose is None else self._base @ check_rigid(pose, "pose")
        if isinstance(shape, Workspace | PosedShape):
            if radius is not None:
                raise InputError(
                    "radius",
                    f"is given with a {type(shape).__name__}",
                    "only points have a radius",
                )
            placed = place_obstacle(shape, name, base)
        else:
            placed = place_shape(as_shape(shape, radius, "shape"), name, base)
        extra = None if padding is None else check_not_negative(padding, "padding")
        # One change at a time, each of the scene that the last one left.
        with self._lock:
            now = self.snapshot
            links = {link.name for link in now.arm.links}
            if name in links:
                raise InputError(
                    "name",
                    f"is {name!r}",
                    "a link or an attached object has it",
                )
            pairs = now.allowed | _pair_with_links(name, touch_links, links)
            obstacles = {**now.obstacles, name: placed}
            self._replace(now, obstacles, pairs, _set_entry(now.padding, name, extra))

    def remove_obstacle(self, name: str) -> None:
        """Remove an obstacle with its padding and allowed pairs.

        Raises
        ------
        InputError
            If no obstacle has the name; nothing changes then.
        """
        with self._lock:
            now = self.snapshot
            check_known(name, "name", now.obstacles)
            others = dict(now.obstacles)
            del others[name]
            padding = _set_entry(now.padding, name, 0.0)
            self._replace(now, others, _drop_name(now.allowed, name), padding)

    @names_options
    def attach(
        self,
        name: str,
        shape: ShapeLike | None = None,
        link: str | None = None,
        pose: ArrayLike | None = None,
        touch_links: str | Iterable[str] = (),
        *,
        q: ArrayLike | None = None,
        padding: float | None = None,
    ) -> None:
        """Attach a new object or obstacle to a link.

        An obstacle keeps its padding and the pairs that may touch. For instance, a box that is
        picked up from a table needs ``allow_collisions([("box", "table")])``.

        Parameters
        ----------
        name : str
            Name of the object, or of an obstacle if ``shape`` is left out.
        shape : shape, optional
            As for :meth:`Arm.attach`; by default the obstacle of that name, which is removed.
        link, pose, touch_links
            As for :meth:`Arm.attach`; an obstacle has no ``pose``.
        q : array-like, shape (dof,), optional
            Configuration at which the arm picks up an obstacle.
        padding : float, optional
            Metres added to the margin; see :meth:`set_padding`.

        Raises
        ------
        InputError
            As :meth:`Arm.attach`; also if an obstacle has the name of a new object, or no obstacle
            has the name. Nothing changes then.
        ConfigurationError
            If no configuration would be free, or ``q`` is outside the limits; nothing changes then.
        """
        check_text(name, "name")
        extra = None if padding is None else check_not_negative(padding, "padding")
        with self._lock:
            now = self.snapshot
            obstacles = dict(now.obstacles)
            carrier = check_known(link, "link", now.arm.frames)
            if shape is None:
                # An obstacle becomes an object at the pose that it has on the link at q.
                if pose is not None:
                    raise InputError(
                        "pose",
                        "is given for an obstacle",
                        "the obstacle is where it is",
                    )
                placed_by_name = self._placed_obstacles
                placed = placed_by_name[check_known(name, "name", placed_by_name)]
                del obstacles[name]
                on_base = now.arm.pose(self.arm._check_configuration(q, "q"), carrier)
                shape = placed.shape
                pose = np.linalg.inv(on_base) @ placed.pose
            elif q is not None:
                raise InputError(
                    "q",
                    "is given for a new object",
                    "only an obstacle is picked up at q",
                )
            elif name in obstacles:
                raise InputError(
                    "name",
                    f"is {name!r}",
                    "an obstacle has it",
                )
            arm = now.arm.attach(name, shape, carrier, pose, touch_links)
            padding_now = _set_entry(now.padding, name, extra)
            self._replace(now, obstacles, now.allowed, padding_now, arm)

    @names_options
    def detach(
        self, name: str, q: ArrayLike | None = None, *, touch_links: str | Iterable[str] = ()
    ) -> None:
        """Detach an object: take it away, or place it as an obstacle.

        Parameters
        ----------
        name : str
            An attached object.
        q : array-like, shape (dof,), optional
            Configuration at which the object stays as an obstacle of the same name, with its
            padding and the pairs of :attr:`allowed_collisions`. By default it is taken away, with
            both.
        touch_links : str or iterable of str
            Links that may touch the obstacle, such as the fingers that let it go.

        Raises
        ------
        InputError
            If no attached object has the name, another one is attached to it, or a link is unknown;
            nothing changes then.
        ConfigurationError
            If no configuration would be free, or ``q`` is outside the limits; nothing changes then.
        """
        with self._lock:
            now = self.snapshot
            arm = now.arm.detach(name)
            obstacles = dict(now.obstacles)
            allowed: Collection[Names] = now.allowed
            padding = now.padding
            if q is not None:
                # The object becomes an obstacle at its pose at q.
                (held,) = next(link.parts for link in now.arm.links if link.name == name)
                pose = now.arm.pose(self.arm._check_configuration(q, "q"), name)
                obstacles[name] = place_shape(held.shape, name, pose)
                links = [link.name for link in arm.links]
                allowed = now.allowed | _pair_with_links(name, touch_links, links)
            elif touch_links:
                raise InputError(
                    "touch_links",
                    "are given without q",
                    "they are those of the obstacle",
                )
            else:
                allowed = _drop_name(allowed, name)
                padding = _set_entry(padding, name, 0.0)
            self._replace(now, obstacles, allowed, padding, arm)

    def set_padding(self, name: str, padding: float) -> None:
        """Set the padding of a link, an attached object or an obstacle.

        A link and an obstacle are FREE of each other if they are farther apart than :attr:`margin`
        and the padding of both. Links have no padding against each other.

        Parameters
        ----------
        name : str
        padding : float
            Metres, zero or above; zero by default.

        Raises
        ------
        InputError
            If the name is unknown, or the padding is negative; nothing changes then.
        ConfigurationError
            If no configuration would be free; nothing changes then.
        """
        extra = check_not_negative(padding, "padding")
        with self._lock:
            now = self.snapshot
            check_known(name, "name", now.names)
            self._replace(now, now.obstacles, now.allowed, _set_entry(now.padding, name, extra))

    def allow_collisions(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Let pairs of links, attached objects and obstacles touch.

        A pair of two obstacles matters once one of them is attached.

        Raises
        ------
        InputError
            If a name is unknown; nothing changes then.
        """
        with self._lock:
            now = self.snapshot
            allowed = now.allowed | _check_allowed(pairs, "pairs", now.names)
            self._replace(now, now.obstacles, allowed, now.padding)

    def forbid_collisions(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Test pairs of :attr:`allowed_collisions` or :attr:`Arm.allowed_collisions`.

        Raises
        ------
        InputError
            If a name is unknown, a pair is not one of these, or its links are on one body; nothing
            changes then.
        ConfigurationError
            If no configuration would be free; nothing changes then.
        """
        with self._lock:
            now = self.snapshot
            given = _check_allowed(pairs, "pairs", now.names)
            for pair in sorted(given.difference(now.allowed, now.arm._untested)):
                raise InputError(
                    "pairs",
                    f"hold {pair}",
                    "only pairs that may touch, on two bodies, are taken back",
                )
            before = now.arm.allowed_collisions
            kept = {pair: reason for pair, reason in before.items() if pair not in given}
            arm = now.arm if kept == before else replace(now.arm, allowed_collisions=kept)
            self._replace(now, now.obstacles, now.allowed - given, now.padding, arm)

    def _replace(
        self,
        now: Snapshot,
        obstacles: Mapping[str, PosedShape | None],
        allowed: Collection[Names],
        padding: Mapping[str, float],
        arm: Arm | None = None,
    ) -> None:
        """Replace the snapshot ``now`` by a scene's.

        It is one assignment, so that readers in other threads see a whole scene.
        """
        scene = arm or now.arm, obstacles, allowed, padding, now.margin
        self.snapshot = make_snapshot(*scene, now, now.uprights)

    _repr_png_ = show_png

    @names_options
    def plot(
        self,
        *,
        q: ArrayLike | None = None,
        path: ArrayLike | HasPath | None = None,
        camera: ArrayLike | None = None,
        ax: Axes | None = None,
        legend: bool = True,
        title: str | None = None,
    ) -> Axes:
        """Draw the arm, its obstacles and, as pale arms, a path.

        No window opens; notebooks show the axes as the picture.

        Parameters
        ----------
        q : array-like, shape (size,), optional
            Configuration of the arm; by default the end of the path, or zero.
        path : array-like, shape (n, size), or Plan, optional
        camera : array-like, shape (2,), optional
            Elevation and azimuth, degrees.
        ax : matplotlib.axes.Axes, optional
            Axes in three dimensions; by default of a new figure.
        legend : bool
        title : str, optional
            Default: the name of the arm.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        InputError, ConfigurationError
            If a configuration has the wrong shape or is outside the limits, or ``ax`` has two
            dimensions.
        """
        from cspace.plot import draw_arm

        return draw_arm(self, q, path, camera, ax, legend, title)

    # ---- queries ---------------------------------------------------------------------------------

    @cached_property
    def _look_up_state(self) -> Callable[..., int]:
        """Look-up of one configuration; see the base class."""
        prove = self._look_up_motion
        return lambda q: prove(q + q)

    @cached_property
    def _look_up_motion(self) -> Callable[..., int]:
        """Look-up of a motion; see the base class. It has no answer beyond the limits."""
        # Each thread has its own scratch memory. Limits are those of both endpoints.
        local = threading.local()
        lower = (self.arm.lower - LIMIT_SLACK).tolist() * 2
        upper = (self.arm.upper + LIMIT_SLACK).tolist() * 2

        def prove(endpoints: tuple[float, ...]) -> int:
            """Prove the motion between two configurations, given as their numbers in a row."""
            for low, x, high in zip(lower, endpoints, upper, strict=True):
                if not low <= x <= high:
                    return -1  # only arrays have an answer
            scene = self.snapshot.outer
            # At the first call of a thread, and after a change.
            if getattr(local, "scene", None) is not scene:
                local.scene = scene
                local.scratch = make_scene_scratch(scene)
                local.ends = np.empty((2, self.size))
                rows = *local.ends, local.scratch
                local.prove = partial(bind_kernel(motion_is_free, (scene,), *rows), *rows)
            local.ends.ravel()[:] = endpoints
            return FREE if local.prove() else MIXED

        return prove

    def obstacle_distance(self, q: ArrayLike) -> float | Floats:
        """Compute a lower bound of the distance from collision.

        The bound is in metres, between links and obstacles and between links, without the margin.
        It is zero if a configuration is not proven free, and infinite if there is nothing to touch.
        Only pairs that joints move count, so not an obstacle and a link of the base.

        Parameters
        ----------
        q : array-like, shape (..., dof)

        Returns
        -------
        float, or ndarray of float64, shape (...)

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`is_free`.
        """
        points = self._check_configurations(q, "q")
        distances, _ = self.snapshot.distances(points.reshape(-1, self.size))
        if points.ndim == 1:
            return float(distances[0])
        return distances.reshape(points.shape[:-1])

    def path_obstacle_distance(self, path: ArrayLike) -> float:
        """Bound the distance along a path from below.

        It bounds :meth:`obstacle_distance`, in metres, along all motions of the path. It is 0 if
        the path is not proven free. Fractions of the smallest distance at waypoints and halfway
        between them are tried, largest first.

        Parameters
        ----------
        path : array-like, shape (n, dof)

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`certify_path`.
        """
        rows = self._check_configurations(path, "path").reshape(-1, self.size)
        self._check_path(rows)
        starts, ends = rows[:-1], rows[1:]
        self._check_spans(starts, ends)
        midpoints = 0.5 * (starts + ends)
        snapshot = self.snapshot
        distances, _ = snapshot.distances(np.concatenate([rows, midpoints]))
        limit = float(distances.min())
        if len(rows) < 2 or math.isinf(limit) or limit == 0.0:
            return limit
        # The path keeps a distance if it is free with all pairs padded by that distance.
        for share in _DISTANCE_SHARES:
            extra = share * (limit - snapshot.margin)
            wider = snapshot.outer._replace(padding=np.maximum(snapshot.outer.padding, extra))
            if snapshot.are_free(starts, ends, wider).all():
                return snapshot.margin + extra
        return 0.0

    def clearance(self, q: ArrayLike) -> float | Floats:
        """Return :meth:`obstacle_distance`, the clearance that planners see."""
        return self.obstacle_distance(q)

    def check_configuration(self, q: ArrayLike, name: str = "q") -> Floats:
        """Return one configuration, shape (dof,).

        Raises InputError if it is no configuration, and ConfigurationError if it is beyond the
        limits.
        """
        return self._check_configurations(super().check_configuration(q, name), name)

    def check_endpoint(self, q: ArrayLike, name: str) -> Endpoint:
        """Return a start or goal with joints clamped; continuous ones keep their whole turns.

        Raises ConfigurationError if it is beyond the limits or not proven free, and InputError if
        it is no configuration.
        """
        point = self.arm._clamp(self.check_configuration(q, name))
        if not self.is_free(point):
            raise _make_collision_error(self.snapshot, point, name)
        return tuple(point.tolist())

    def _solve_goal(
        self, goal: PlaceLike, name: str, start: Endpoint, seed: int | None
    ) -> list[Endpoint]:
        """Return the configurations of one goal that are proven free; a pose has several."""
        if isinstance(goal, PoseGoal):
            return self._solve_pose(goal, name, start, seed)
        return super()._solve_goal(goal, name, start, seed)

    def _solve_pose(
        self, goal: PoseGoal, name: str, start: Endpoint, seed: int | None
    ) -> list[Endpoint]:
        """Solve a pose goal; return the configurations that are proven free.

        Raises ConfigurationError, which blames ``name``, if there are none.
        """
        # Configurations at one pose that may be goals of a search.
        solutions = self.arm._solve_pose(goal, name, start, 128, seed or 0)
        if self.snapshot.uprights:
            solutions = self._find_upright(goal, name, solutions)
        points = wrap_angles(solutions, self.is_periodic)
        free_points = points[np.asarray(self.is_free(points))]
        if len(free_points):
            return [tuple(q) for q in free_points.tolist()]
        # The error names the pair that is in the way most often.
        contacts = [self.closest(q) for q in points]
        pairs = Counter((contact.link, contact.other) for contact in contacts)
        (((link, other), number),) = pairs.most_common(1)
        problem = (
            f"has {len(points)} configurations that reach the pose, and none is proven free: "
            f"{link} is in collision with {other}, or nearly so, in {number} of them"
        )
        nearest = tuple(points[0].tolist())
        raise ConfigurationError(
            name, problem, "a path must begin and end in FREE", nearest=nearest
        )

    def _find_upright(self, goal: PoseGoal, name: str, solutions: Floats) -> Floats:
        """Return upright configurations at a pose, shape (m, dof), that begin at ``solutions``.

        They move in turns into the cones and back to the pose, which may leave some freedom. Raises
        ConfigurationError, which blames ``name``, if none becomes upright.
        """
        snapshot = self.snapshot
        branch, tool = snapshot.arm._branch_to(goal.frame)
        joints = branch.joints
        limits = snapshot.arm.lower[joints], snapshot.arm.upper[joints]
        tolerance = np.array(goal.tolerance)
        problem = make_pose_problem(branch, tool, np.array(goal.pose), tolerance, limits)
        scratch = make_pose_scratch(branch)
        upright = []
        for q in solutions.copy():
            gaps = np.zeros(2)
            # Times that a configuration at a pose is moved upright, and back to the pose.
            for _ in range(30):
                if snapshot.find_tilt(q) is None or (gaps > tolerance).any():
                    break
                (q[:],) = snapshot.move_upright(q[np.newaxis])
                moved = q[joints]
                gaps[:] = descend(problem, moved, scratch)[:2]
                q[joints] = moved
            if snapshot.find_tilt(q) is None and (gaps <= tolerance).all():
                upright.append(q)
        if not upright:
            raise ConfigurationError(
                name,
                f"has {len(solutions)} configurations that reach the pose, none is upright",
                "a path keeps the axis of its link within the tolerance",
                nearest=tuple(solutions[0].tolist()),
            )
        return np.array(upright)

    def keep(self, uprights: Sequence[Upright]) -> ArmSpace:
        """Return a space whose FREE also keeps axes of frames upright; see the base class."""
        return ArmSpace(self.snapshot.keep(uprights), self._base) if uprights else self

    def search(self, name: str, endpoints: Sequence[Endpoint], options: SearchOptions) -> Floats:
        """Search by "BiRRT": two trees of proven motions grow towards each other.

        The first path is not the shortest. Further searches only sample where a shorter path may
        lead (Gammell and others, 2014), and parts of the path are pulled towards straight motions,
        as far as these are proven free. Continuous joints may turn either way: the path ends at a
        goal, or whole turns from it.
        """
        start, *goals = np.array(endpoints)
        snapshot = self.snapshot
        images = self._list_images(start, np.array(goals))
        images = images[snapshot.are_free(images, images)]
        if not len(images):  # the scene has changed since the goals were checked
            return np.empty((0, self.size))
        rng = np.random.default_rng(options.seed or 0)
        ranges = snapshot.arm._ranges(np.vstack([start, images]))
        search = PathSearch(snapshot.outer, ranges, start, images, self._spans, rng, options.limit)
        path = search.find(options.simplify)
        if not (len(path) and options.simplify):
            return path
        return search.shorten(path, options.iterations)

    def closest(self, q: ArrayLike) -> Contact:
        """Return the link and obstacle nearest to touching.

        Instead of an obstacle, it may be another link. Only pairs that joints move count. ``q`` has
        shape (dof,).

        Raises
        ------
        ConfigurationError, InputError
            As :meth:`is_free`; also if there is nothing to touch.
        """
        point = self.arm._check_configuration(q, "q")
        snapshot = self.snapshot
        if not len(snapshot.outer.pairs):
            raise InputError("obstacles", "are none", "there is nothing to touch")
        return snapshot.contact(snapshot.outer, point[np.newaxis])

    def sample_free(self, n: int | None = None, rng: np.random.Generator | None = None) -> Floats:
        """Sample free configurations uniformly within the joint limits.

        Continuous joints are sampled within a turn.

        Parameters
        ----------
        n : int, optional
            How many; by default one, without a batch axis.
        rng : numpy.random.Generator, optional
            Source of randomness; by default a new ``numpy.random.default_rng()`` at each call.

        Returns
        -------
        ndarray of float64, shape (n, dof), or (dof,)

        Raises
        ------
        ConfigurationError
            If none of very many samples is free.
        InputError
            If ``n`` is negative or too large for the memory, or ``rng`` is neither None nor a
            Generator.
        """
        count = self._count_samples(n)
        generator = check_rng(rng)
        snapshot = self.snapshot
        batches = [np.empty((0, self.size))]
        number_free = 0
        number_drawn = 0
        while number_free < count:
            # Twice as many as are missing, because about half of them may be free.
            batch_size = min(max(2 * (count - number_free), 16), 10_000)
            points = snapshot.move_upright(
                generator.uniform(*snapshot.arm._ranges(), (batch_size, self.size))
            )
            batches.append(points[snapshot.are_free(points, points)])
            number_free += len(batches[-1])
            number_drawn += batch_size
            # Samples after which sampling fails without a free one.
            if number_drawn >= 100_000 and not number_free:
                touching = snapshot.always_touching(snapshot.outer)
                always = ", ".join(f"{link} touches {other}" for link, other in touching)
                raise ConfigurationError(
                    snapshot.arm.name,
                    f"was free in none of {number_drawn} configurations",
                    f"of {CONTACT_SAMPLES}, these touch in all: {always or 'none'}",
                )
        samples = np.concatenate(batches)[:count]
        return samples[0] if n is None else samples

    @names_options
    def follow_line(
        self,
        q0: ArrayLike,
        frame: str,
        poses: ArrayLike,
        *,
        tolerance: tuple[float, float] = DEFAULT_LINE_TOLERANCE,
    ) -> LineMotion:
        """Bring a frame along straight lines by proven motions.

        The line begins at the pose of the frame at ``q0``. On the way to the next pose the frame's
        origin moves straight, and the frame turns about one axis; poses of equal rotation keep it.
        The joints follow inverse kinematics, each configuration near the one before. All motions
        between the waypoints are proven free, and proven to stay within the tolerance of the line,
        so that no jump between two branches of solutions remains unseen.

        The motion ends before the first step that is not proven; :attr:`LineMotion.stopped_by` says
        why. From another configuration with the same pose it may reach farther; see
        :meth:`Arm.inverse`.

        Parameters
        ----------
        q0 : array-like, shape (dof,)
            A FREE configuration.
        frame : str
            One of :attr:`Arm.frames`, such as ``"tool0"``.
        poses : array-like, shape (4, 4) or (m, 4, 4)
            From the frame to that of the arm's base, metres, as :meth:`Arm.pose` returns them.
        tolerance : pair of float
            Largest distance in metres, and largest angle in radians, by which the frame may leave
            the line. One may be infinite: ``(1e-3, math.inf)`` lets the frame turn freely.

        Returns
        -------
        LineMotion

        Raises
        ------
        ConfigurationError
            If the start is not FREE, or more than 1e-5 rad (m) beyond the limits of a joint.
        InputError
            If the frame is unknown or no joint moves it, a pose is no rigid motion, two poses
            differ by half a turn, so that both ways round are as short, or a coordinate exceeds
            1e100 m. Also if the tolerance is not two numbers above zero, or is below rounding:
            about 4e-12 rad, and 4e-12 times the largest coordinate.

        Examples
        --------
        >>> import pathlib, tempfile, numpy as np, cspace
        >>> box = '<geometry><box size="1 0.1 0.1"/></geometry>'
        >>> bar = f'<collision><origin xyz="0.5 0 0"/>{box}</collision>'
        >>> joint = '<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{2}"/>'
        >>> joint += '<axis xyz="{3}"/>'
        >>> joint += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        >>> parts = joint.format("x", "base", "cart", "1 0 0")
        >>> parts += joint.format("y", "cart", "bar", "0 1 0")
        >>> links = f'<link name="base"/><link name="cart"/><link name="bar">{bar}</link>'
        >>> path = pathlib.Path(tempfile.mkdtemp(), "table.urdf")
        >>> _ = path.write_text(f'<robot name="table">{links}{parts}</robot>')
        >>> space = cspace.build_arm_space({}, cspace.Arm.from_urdf(path))
        >>> corner = np.eye(4)
        >>> corner[:2, 3] = 0.5, 0.5
        >>> motion = space.follow_line((0.0, 0.0), "bar", corner)
        >>> motion.certified, motion.path[-1].round(3).tolist(), motion.deviation < 1e-3
        (True, [0.5, 0.5], True)
        >>> corner[1, 3] = 2.0
        >>> motion = space.follow_line((0.0, 0.0), "bar", corner)
        >>> motion.certified, round(motion.fraction, 3), motion.stopped_by
        (False, 0.5, 'limit')
        """
        snapshot = self.snapshot
        arm = snapshot.arm
        start = arm._clamp(self.arm._check_configuration(q0, "q0"))
        arm._branch_to(frame)  # refuses unknown frames before the poses
        max_deviation = check_pose_tolerance(tolerance)
        # The line begins at the pose of the frame.
        first_corner = arm.pose(start, frame)[np.newaxis]
        corners = np.concatenate([first_corner, check_corners(poses)])
        lines = make_lines(corners)
        start_row = start[np.newaxis]
        if not snapshot.are_free(start_row, start_row)[0]:
            raise _make_collision_error(snapshot, start, "q0")
        return follow_lines(snapshot, start, frame, corners, lines, max_deviation)

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None) -> Bools:
        """Return whether each edge is proven collision-free.

        The edges join the rows of a path, of several paths, or of a roadmap. Along an edge, all
        joints move together, each from its value to the next, as in :meth:`motion_is_free`. An edge
        that turns a continuous joint by more than half a turn is refused, because planners and
        controllers that wrap angles would take the shorter way, a different motion. For all other
        edges both motions are the same.

        Parameters
        ----------
        path : array-like, shape (n, dof) or (..., n, dof)
            Configurations, radians and metres: of a path in order, of several paths of equal
            length, or the vertices of a roadmap. Continuous joints count whole turns: 3.1 is
            followed by 3.2, not by 3.2 - 2 pi.
        edges : array-like of int, shape (m, 2), optional
            Indices, from 0, of the two vertices of each edge; ``path`` must then have shape (n,
            dof); by default each configuration is joined to the next.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            A path of one configuration counts as one edge from it to itself.

        Raises
        ------
        InputError
            If an edge turns a continuous joint by more than half a turn; or as
            :meth:`cspace.CSpace.certify_path`.
        ConfigurationError
            If a configuration is more than 1e-5 rad (m) beyond a limit.
        """
        return super().certify_path(path, edges)

    def _list_images(self, start: Floats, goals: Floats) -> Floats:
        """Return the goals both ways around each continuous joint.

        ``start`` has shape (dof,), ``goals`` (n, dof), the result (m, dof). Its first n rows are
        the goals the shorter way round; a goal that already is, is unchanged to the last bit.
        """
        images = turn_near(goals, start, self.is_periodic)
        # Largest number of continuous joints that :meth:`ArmSpace.search` tries both ways; others
        # go the shorter way.
        for joint in np.flatnonzero(self.is_periodic)[:8]:
            # Each joint doubles the images: all so far, and all with this joint a turn further.
            other_way = images.copy()
            other_way[:, joint] += np.where(images[:, joint] > start[joint], -math.tau, math.tau)
            images = np.concatenate([images, other_way])
        return images

    def _write_states(self, rows: Floats, out: States) -> int:
        """Write the states of configurations, shape (n, dof), to ``out``, shape (n,).

        Returns -1, because no row fails; see the base class.
        """
        self.arm._check_limits(check_finite(rows, "q"), "q")
        snapshot = self.snapshot
        free = snapshot.are_free(rows, rows)
        out[:] = np.where(free, FREE, MIXED)
        # BLOCKED is sought only for configurations that are not proven FREE.
        unproven = np.flatnonzero(~free)
        blocked = snapshot.are_blocked(rows[unproven])
        out[unproven[blocked]] = BLOCKED
        return -1

    def _write_free(self, rows: Floats, out: Bools) -> int:
        """Write whether configurations, shape (n, dof), are proven free to ``out``, shape (n,).

        Returns -1, because no row fails; see the base class.
        """
        self.arm._check_limits(check_finite(rows, "q"), "q")
        out[:] = self.snapshot.are_free(rows, rows)
        return -1

    def _write_motions(self, starts: Floats, ends: Floats, out: Bools) -> int:
        """Write whether motions, shapes (n, dof), are proven free to ``out``, shape (n,).

        Returns -1, because no row fails; see the base class.
        """
        self.arm._check_limits(check_finite(starts, "q0"), "q0")
        self.arm._check_limits(check_finite(ends, "q1"), "q1")
        out[:] = self.snapshot.are_free(starts, ends)
        return -1

    def _count_free_tubes(self, starts: Floats, ends: Floats, radii: Floats, counts: Ints) -> None:
        """Lower counts to the number of tubes that are free, from the first on.

        Arguments are as for the base class.
        """
        self.snapshot.count_free(starts, ends, radii, counts)

    def _bound_link_speeds(
        self, link: str, q: Floats, velocity: Floats, within: Floats, max_velocity: Floats
    ) -> Floats:
        """Bound the speed of a link; see the base class."""
        return self.arm.link_speed(link, q, velocity, within, max_velocity)

    def _excesses(self, targets: Floats) -> Floats:
        """Return the excesses of targets over the limits of the joints; see the base class."""
        excesses = np.maximum(self.arm.lower - targets, targets - self.arm.upper)
        return np.where(excesses > LIMIT_SLACK, excesses, 0.0)

    def _convert_message(self, msg: object) -> ArrayLike:
        """Return the configuration of a state of joints."""
        return self.arm.configuration(msg)

    def _explain_tube(self, rows: Floats, radii: Floats) -> tuple[tuple[str, ...], str]:
        """Name the bodies that come nearest to touching in a tube."""
        snapshot = self.snapshot
        outer = snapshot.outer
        displacements = snapshot.bound_displacements(radii[np.newaxis])[0]
        scene = outer._replace(padding=outer.padding + displacements)
        distances, _ = snapshot.distances(rows, scene)
        nearest = int(distances.argmin())
        contact = snapshot.contact(scene, rows[nearest : nearest + 1])
        names = contact.link, contact.other
        return names, f"{contact.link} is not proven apart from {contact.other}"

    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Check configurations, and return them as an array.

        Raises ConfigurationError beyond the limits of a joint.
        """
        points = self.arm._check_configurations(q, name)
        self.arm._check_limits(points, name)
        return points


def _make_collision_error(snapshot: Snapshot, q: Floats, name: str) -> ConfigurationError:
    """Make the error for a start or goal that is not proven free.

    ``q`` has shape (dof,); ``name`` is the argument. The message names the link and the obstacle
    that touch.
    """
    point = f"({', '.join(f'{x:.6g}' for x in q)})"
    if tilt := snapshot.find_tilt(q):
        upright, angle = tilt
        problem = f"{point} is not upright: the axis of {upright.frame} is {angle:.6g} rad "
        problem += f"from the direction {upright.direction}"
        rule = f"keep= wants {upright.angle:.6g} rad, within {upright.tolerance:.6g} rad"
        return ConfigurationError(name, problem, rule, reason="mixed")
    link, other, *_ = snapshot.contact(snapshot.outer, q[np.newaxis])
    problem = f"is not proven free: {link} is in collision with {other}, or nearly so"
    rule = "a path must start and end in FREE"
    return ConfigurationError(name, f"{point} {problem}", rule, reason="mixed")


@names_options
def build_arm_space(
    obstacles: Workspace | PlanningScene | Mapping[str, Workspace | PosedShape | ShapeLike],
    arm: Arm,
    *,
    allowed_collisions: Iterable[tuple[str, str]] = (),
    margin: float = 0.0,
    padding: Mapping[str, float] | None = None,
    base_pose: ArrayLike | None = None,
) -> ArmSpace:
    """Build the space of an arm among obstacles.

    Its obstacles can change later; see :class:`ArmSpace`.

    Parameters
    ----------
    obstacles : Workspace, PlanningScene, or mapping of str to Workspace, PosedShape or shape
        Obstacles in space by name, metres. A shape is a ``trimesh.Trimesh``, a file of one, or
        anything else that :meth:`CSpace.add_obstacle` takes. A single workspace is called
        ``"workspace"``. A workspace made from a mesh or point cloud is used exactly, any other by
        its cells; everything beyond the grid is free. But a workspace of one mesh or other exact
        shape is that shape as a whole, so its part beyond the ``bounds`` still blocks. Unknown
        cells of ``outer`` are obstacles, and never prove a configuration BLOCKED. A
        planning scene of :func:`cspace.arms.read_moveit_scene` also attaches its objects; if it has
        an allowed collision matrix, that replaces :attr:`Arm.allowed_collisions`.
    arm : Arm
    allowed_collisions : iterable of pairs of str
        A link, and an obstacle or link that it may touch, in addition to
        :attr:`Arm.allowed_collisions`.
    margin : float
        Metres by which FREE stays clear.
    padding : mapping of str to float, optional
        Metres, by link or obstacle, that are added to the margin between links and obstacles.
    base_pose : array-like, shape (4, 4), optional
        Pose of the arm's base in the frame of the obstacles; the identity by default. For a
        planning scene, the default is the pose in the frame of the scene, which must be ``"world"``
        or a frame of the arm that no joint moves; ``"world"`` is the frame of the base, if that is
        the root of the URDF.

    Raises
    ------
    InputError
        If a name is taken by a link or unknown, an obstacle is in the plane, a pose is no rigid
        motion, the margin is negative, or cells do not fit into memory.
    ConfigurationError
        If an obstacle touches a link that no joint moves, or if a pair that at most two joints move
        touches in all 1000 random configurations.
    """
    _check_arm(arm)
    pairs = set[Names]()
    pose = np.eye(4) if base_pose is None else check_rigid(base_pose, "base_pose")
    # A planning scene also has a frame, attached objects, and pairs that may touch.
    if isinstance(obstacles, PlanningScene):
        scene = obstacles
        if base_pose is None:
            pose = find_base_pose(scene.frame, arm, scene._source)
        arm, pairs = scene._place(arm, pose)
        obstacles = scene.obstacles
    named = named_obstacles(obstacles)
    links = {link.name for link in arm.links}
    for name in named:
        if name in links:
            raise InputError(
                "obstacles",
                f"name one {name!r}",
                "a link has that name",
            )
    known = (*links, *named)
    pairs |= _check_allowed(allowed_collisions, "allowed_collisions", known)
    min_distance = check_not_negative(margin, "margin")
    extra = {}
    for name, metres in check_mapping(padding or {}, "padding", known).items():
        extra[name] = check_not_negative(metres, f"padding of {name}")
    # Kernels know only the frame of the base.
    base = np.linalg.inv(pose).astype(np.float64)
    placed = {name: place_obstacle(obstacle, name, base) for name, obstacle in named.items()}
    return ArmSpace(make_snapshot(arm, placed, pairs, extra, min_distance), base)


def _check_arm(arm: object) -> None:
    """Raise InputError unless it is an Arm."""
    if not isinstance(arm, Arm):
        raise InputError("arm", f"is a {type(arm).__name__}", "it must be an Arm")


def _check_allowed(
    pairs: Iterable[tuple[str, str]], argument: str, known: Collection[str]
) -> set[Names]:
    """Return pairs of known names, each in alphabetical order.

    Raises InputError, which blames ``argument``, if they are no pairs or a name is unknown.
    """
    try:
        given = [(one, other) for one, other in pairs]
    except (TypeError, ValueError) as error:
        raise InputError(
            argument,
            f"is {pairs!r}",
            "it must hold pairs of names",
        ) from error
    for name in chain.from_iterable(given):
        check_known(name, argument, known, "names")
    return {sort_pair(one, other) for one, other in given}


def _pair_with_links(name: str, links: str | Iterable[str], known: Collection[str]) -> set[Names]:
    """Pair a name with links that it may touch, each pair in alphabetical order."""
    names = check_names(links, "touch_links")
    return {sort_pair(name, check_known(link, "touch_links", known, "names")) for link in names}


def _drop_name(pairs: Iterable[Names], name: str) -> set[Names]:
    """Return the pairs that do not contain a name."""
    return {pair for pair in pairs if name not in pair}


def _set_entry(padding: Mapping[str, float], name: str, metres: float | None) -> dict[str, float]:
    """Return a copy of the padding with one name set to ``metres``, unless that is None.

    Names without padding are left out.
    """
    changed = dict(padding)
    if metres is not None:
        changed[name] = metres
    return {padded_name: value for padded_name, value in changed.items() if value}

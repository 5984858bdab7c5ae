"""Spaces of configurations: the interface that planners see, and the queries of maps and arms."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Final,
    NamedTuple,
    Self,
    TypeAlias,
    TypeVar,
    cast,
    overload,
)

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import MultiPolygon, Polygon

from cspace import _outside
from cspace._queries.batches import Configuration, evaluate, evaluate_edges, evaluate_rows
from cspace._queries.upright import Upright
from cspace._rotations import Rotations
from cspace._rotations.base import (
    METRES_PER_RADIAN,
    ROTATION_UNITS,
    angle_axes,
    measure_steps,
    turn_near,
    wrap_angles,
    wrap_steps,
)
from cspace._support.arrays import FREE, MAX_EXPECTED_ANGLE, Bools, Floats, Ints, States
from cspace._support.check import (
    check_finite,
    check_known,
    check_pairs,
    check_real,
    check_rows,
    names_options,
    order_labels,
)
from cspace._support.deadlines import Effort
from cspace._support.limits import check_samples
from cspace._support.reporting import tell_apart
from cspace.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from cspace._record.cells import Map

Endpoint = tuple[float, ...]
"""A start or goal in canonical form."""

Alternative = TypeVar("Alternative")
Found = TypeVar("Found")

LookUp: TypeAlias = Callable[..., Any]
"""Compiled query of configurations, given by a tuple of their numbers; below 0 without answer."""

SpaceT = TypeVar("SpaceT", bound="Space")
"""A kind of space."""

Checker = Callable[..., bool]
"""Test of a configuration or a motion, given by its numbers."""

NUMBERS: Final = frozenset({float, int, np.float64, np.float32, np.int64})
"""Types of the entries of plain rows; all others go through the query of arrays."""

ANSWERS: Final = ("classify", "is_free", "motion_is_free")
"""Methods of maps and arms that kernels answer, without a call of the method."""

HALF_TURN: Final = math.pi + 1e-9
"""Largest turn of a continuous joint between path rows, radians, with a rounding error."""


class Goal:
    """A goal that a space turns into configurations, such as a pose of an arm's tool."""

    __slots__ = ()


PlacePart: TypeAlias = float | Polygon | MultiPolygon | None
"""A coordinate of a pose, None for any rotation, or a region of positions."""

PlaceLike: TypeAlias = (
    ArrayLike
    | Goal
    | Polygon
    | MultiPolygon
    | Sequence[Goal | ArrayLike | PlacePart | Sequence[PlacePart]]
)
"""A place of a plan, or a list of alternatives."""


class SearchOptions(NamedTuple):
    """Options of one of a space's own searches."""

    simplify: bool  # whether to shorten the path
    exact: bool  # whether geometry decides what cells do not
    iterations: int | None  # largest number of further searches for a shorter path
    seed: int | None
    limit: Effort  # at which the search ends


def list_alternatives(place: PlaceLike, name: str, axes: Sequence[str]) -> Sequence[PlaceLike]:
    """List the alternatives of a place, or the place alone if it has none.

    A list of numbers is one configuration, a region and a number are one place, and every other
    list is of alternatives. Raises InputError for a list of both.
    """
    ordered = order_labels(place, name, axes)
    if getattr(ordered, "ndim", 0) == 2:
        ordered = list(check_finite(ordered, name, axes))
    if not isinstance(ordered, list | tuple):
        return [ordered]
    are_places = list(map(_is_place, ordered))
    has_turn = are_places == [True, False] and isinstance(ordered[0], shapely.Geometry)
    if has_turn or not any(are_places):
        return [ordered]
    if not all(are_places):
        rule = "numbers are one configuration, places are alternatives"
        raise InputError(name, f"is {place!r}, numbers and places", rule)
    return [order_labels(each, name, axes) for each in ordered]


def _is_place(item: object) -> bool:
    """Return True if an item of a list is a place, and False if it is a number."""
    kinds = (list, tuple, Goal, shapely.Geometry)
    return isinstance(item, kinds) or getattr(item, "ndim", 0) > 0


def gather_goals(
    name: str,
    alternatives: Sequence[Alternative],
    find_goals: Callable[[Alternative, str], Sequence[Found]],
) -> list[Found]:
    """Return what all alternatives of a place have that is proven free, such as configurations.

    ``find_goals`` returns that of an alternative, by its name in messages, or raises
    ConfigurationError if it has none. If all raise, so does this.
    """
    goals: list[Found] = []
    errors: list[ConfigurationError] = []
    for number, alternative in enumerate(alternatives):
        label = f"{name}[{number}]" if len(alternatives) > 1 else name
        try:
            goals += find_goals(alternative, label)
        except ConfigurationError as error:
            errors.append(error)
    if goals:
        return goals
    if len(errors) == 1:
        raise errors[0]
    raise ConfigurationError(
        name,
        f"has {len(errors)} alternatives, none of them proven free",
        "a path must begin and end in FREE",
        str(errors[0]),
        nearest=errors[0].nearest,
    )


def _take_row(q: Any) -> tuple[Any, ...]:
    """Return a list, or an array of one axis, as a tuple; raise TypeError for anything else."""
    if type(q) is np.ndarray and q.ndim == 1:
        return tuple(q.tolist())
    if type(q) is not list:
        raise TypeError(type(q))
    return tuple(q)


class Space(ABC):
    """A space of configurations that ``planners`` searches.

    Maps and the spaces of arms are such spaces. For a space of your own, write a subclass with
    :attr:`axes`, :attr:`bounds`, :meth:`is_free` and :meth:`motion_is_free`; everything else has a
    default.

    A motion is straight: all coordinates change evenly. The axes ``x, y``, then perhaps ``z``, then
    perhaps ``yaw`` or ``qx, qy, qz, qw``, are the pose of a rigid body, which rotates evenly the
    shorter way. All other coordinates are plain numbers, such as joints.

    Attributes
    ----------
    searches : tuple of str
        Names of the space's own searches, which :meth:`search` runs; the first is the default of
        :func:`planners.plan`.
    """

    searches: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return the class and the names of the coordinates."""
        axes: object = self.axes
        # A method's repr would be that of the space again.
        names = map(str, axes if isinstance(axes, tuple) else ())
        return f"{type(self).__name__}({', '.join(names)})"

    # ---- what every space says -------------------------------------------------------------------

    @property
    @abstractmethod
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a configuration."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[ArrayLike, ArrayLike]:
        """Lowest and highest values of the coordinates before the rotation, shapes (dim,).

        Those of continuous joints are ignored.
        """

    @abstractmethod
    def is_free(self, q: ArrayLike) -> bool | Bools:
        """Return True if a configuration is collision-free.

        Planners pass one configuration, a tuple of floats.
        """

    @abstractmethod
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if the whole motion between two configurations is collision-free.

        Planners pass tuples of floats. A path is as certain as this answer.
        """

    @property
    def unchecked(self) -> str:
        """Text about contacts that no proof tests, such as those of an arm; empty by default."""
        return ""

    # ---- what follows from the axes --------------------------------------------------------------

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates of a configuration.

        They are "m", "rad", or "1" for a quaternion; by default "m" except for rotations.
        """
        return tuple(ROTATION_UNITS.get(axis, "m") for axis in self.axes)

    @cached_property
    def size(self) -> int:
        """Length of a configuration, ``len(axes)``.

        It is 7 in SE(3), because a quaternion has four coordinates.
        """
        return len(self.axes)

    @cached_property
    def has_poses(self) -> bool:
        """Whether configurations are poses of a rigid body."""
        are_names = set(self.axes) <= {"x", "y", "z", *ROTATION_UNITS}
        return are_names and not any(self.is_periodic)

    @property
    def exact(self) -> Self:
        """The space in which geometry decides every configuration; itself unless it is a map.

        See :attr:`cspace.CSpace.exact`.
        """
        return self

    @property
    def _cells(self) -> Space:
        """The space without the geometry that a map asks; see :func:`cells_of`."""
        return self

    @property
    def _kernel_map(self) -> Map:
        """Cells of a map in memory, as compiled functions take them."""
        raise InputError("space", f"is {self!r}", "it must be a map in memory")

    @property
    def frame_id(self) -> str:
        """Frame of the coordinates in ROS; "map" if it is not known."""
        return "map"

    @cached_property
    def rotations(self) -> Rotations:
        """Rotations at the end of a configuration."""
        names = self.axes if self.has_poses else ()
        if "qw" in names:
            return Rotations.quaternions(1)
        return Rotations.of(1 if "yaw" in names else None)

    @cached_property
    def dim(self) -> int:
        """Number of coordinates before the rotation."""
        return self.size - len(self.rotations.names)

    @property
    def periodic_axes(self) -> Sequence[bool] | Sequence[str]:
        """Whether each coordinate is a continuous joint's angle, or the names of these.

        Such angles have a period of 2 pi.
        """
        return (False,) * self.size

    @cached_property
    def is_periodic(self) -> tuple[bool, ...]:
        """Whether each coordinate has a period of 2 pi, by :attr:`periodic_axes`."""
        given: object = self.periodic_axes
        parts = given if isinstance(given, list | tuple) else ()
        if parts and all(isinstance(part, str) for part in parts):
            named = [check_known(part, "periodic_axes", self.axes, "has") for part in parts]
            return tuple(axis in named for axis in self.axes)
        if len(parts) != self.size or not all(isinstance(part, bool) for part in parts):
            rule = f"it must have names, or one bool for each of {', '.join(self.axes)}"
            raise InputError("periodic_axes", f"is {given!r}", rule)
        return tuple(parts)

    def steps_between(self, q0: Floats, q1: Floats) -> Floats:
        """Return the steps between configurations, with the shorter rotation.

        A step consists of :attr:`dim` numbers and a rotation vector, radians.
        """
        firsts = check_rows(q0, "q0", self.axes)
        lasts = check_rows(q1, "q1", self.axes)
        steps = self.rotations.steps_between(firsts, lasts)
        return wrap_steps(steps, self.is_periodic) if any(self.is_periodic) else steps

    def distance(self, q0: Floats, q1: Floats) -> Floats:
        """Return the lengths of motions; a radian of rotation counts as half a metre."""
        lengths, angles = measure_steps(self.steps_between(q0, q1), self.dim)
        return np.asarray(lengths + METRES_PER_RADIAN * angles)

    def interpolate(self, q0: Floats, q1: Floats, t: ArrayLike) -> Floats:
        """Return the configurations at fractions ``t``, shape (..., 1), of motions."""
        # A step has an entry for each degree of freedom, so only its leading axes are those of
        # starts.
        fractions, steps = check_real(t, "t"), self.steps_between(q0, q1)
        try:
            steps = fractions * steps
        except ValueError as error:
            problem = f"has shape {fractions.shape}, and motions have {steps.shape}"
            raise InputError(
                "t", problem, "it needs a last axis of 1, beside one number"
            ) from error
        starts = check_rows(q0, "q0", self.axes)
        starts = np.broadcast_to(starts, (*steps.shape[:-1], self.size))
        return self.rotations.add_steps(starts, steps)

    # ---- what some spaces know better ------------------------------------------------------------

    @property
    def resolution(self) -> float:
        """Distance between states that OMPL checks along a motion itself."""
        lower, upper = map(np.asarray, self.bounds)
        return 0.01 * float(np.linalg.norm(upper - lower))

    @property
    def max_velocity(self) -> Mapping[str, float]:
        """Largest velocities by axis, where they are known."""
        return {}

    def clearance(self, q: ArrayLike) -> float | Floats:
        """Return a lower bound of the distance from collision, or NaN."""
        return math.nan

    def point_checker(self) -> Checker:
        """Return ``check(*q)``, a fast :meth:`is_free`."""
        return lambda *q: bool(self.is_free(q))

    def edge_checker(self) -> Checker:
        """Return ``check(*q0, *q1)``, a fast :meth:`motion_is_free`."""
        size = self.size

        def check(*endpoints: float) -> bool:
            """Return True if the motion between both configurations is free."""
            return bool(self.motion_is_free(endpoints[:size], endpoints[size:]))

        return check

    def path_obstacle_distance(self, path: ArrayLike) -> float:
        """Return a lower bound of a path's distance from obstacles, or NaN.

        The motions between its rows are straight.
        """
        return math.nan

    def min_path_length(self, q0: ArrayLike, q1: ArrayLike) -> float:
        """Return a lower bound of free paths' lengths, without rotations.

        By default, it is the straight distance.
        """
        start = self.check_configuration(q0, "q0")
        end = self.check_configuration(q1, "q1")
        steps = self.steps_between(start, end)
        return float(np.linalg.norm(steps[: self.dim]))

    def path_exists(self, q0: ArrayLike, q1: ArrayLike) -> bool | None:
        """Return whether a free path is proven, or disproven; None if undecided."""
        return None

    def keep(self, uprights: Sequence[Upright]) -> Space:
        """Return a space whose FREE motions also keep axes upright.

        Raises InputError if the space has no links, or none of that name.
        """
        if uprights:
            raise InputError(
                "keep",
                f"is given and space is {self!r}",
                "only the links of an arm are kept upright",
            )
        return self

    def search(self, name: str, endpoints: Sequence[Endpoint], options: SearchOptions) -> Floats:
        """Run one of :attr:`searches`, from the first configuration to any other.

        Returns waypoints, shape (n, size); n is 0 if no path was found.
        """
        return np.empty((0, self.size))

    def check_configuration(self, q: ArrayLike, name: str = "q") -> Floats:
        """Return one configuration in canonical form, shape (size,).

        Its yaw is in [-pi, pi), and its quaternion has norm 1. ``q`` may be a message with a
        header: a stamped pose, or the state of an arm's joints.

        Raises InputError if it is not one configuration, or not finite. ``name`` is for messages.
        """
        point = check_finite(self._read_message(q), name, self.axes)
        if point.shape != (self.size,):
            raise InputError(
                name,
                f"has shape {point.shape}",
                f"it must be one configuration of {self.size} numbers: {', '.join(self.axes)}",
            )
        return self.rotations.make_canonical(point, name)

    def check_endpoint(self, q: ArrayLike, name: str) -> Endpoint:
        """Return a canonical start or goal, with whole turns of joints.

        Raises InputError if it is no configuration, and ConfigurationError if no motion from it can
        be proven free.
        """
        canonical = self.check_configuration(q, name)
        point = tuple(canonical.tolist())
        # Continuous joints have no bounds.
        position = canonical[: self.dim]
        lower, upper = map(np.asarray, self.bounds)
        is_bounded = ~np.array(self.is_periodic)[: self.dim]
        if (is_bounded & ((position < lower) | (position > upper))).any():
            problem = "lies outside the bounds"
            rule = "a path stays within them"
        elif not self.is_free(tuple(wrap_angles(canonical, self.is_periodic).tolist())):
            problem = "is not free"
            rule = "a path starts and ends in free configurations"
        else:
            return point
        problem = f"{point} {problem}"
        raise ConfigurationError(name, problem, rule)

    def find_goals(
        self,
        goal: PlaceLike,
        start: Endpoint,
        seed: int | None,
        name: str = "goal",
    ) -> list[Endpoint]:
        """Return the checked goals that a path may end at.

        Of several goals, those that are not proven free are left out. Continuous joints are within
        half a turn of the start. ``seed`` is that of inverse kinematics; ``name`` is for messages.

        Raises errors as :meth:`check_endpoint`, if no goal is left.
        """
        alternatives = list_alternatives(goal, name, self.axes)
        start = tuple(check_finite(start, "start", self.axes).tolist())
        goals = gather_goals(
            name,
            alternatives,
            lambda alternative, label: self._solve_goal(alternative, label, start, seed),
        )
        turned = turn_near(np.array(goals), np.array(start), self.is_periodic)
        return [tuple(q) for q in turned.tolist()]

    def _solve_goal(
        self, goal: PlaceLike, name: str, start: Endpoint, seed: int | None
    ) -> list[Endpoint]:
        """Return a goal's configurations that are proven free.

        Raises errors as :meth:`check_endpoint`, if there is none.
        """
        if isinstance(goal, Goal):
            raise InputError(
                name,
                f"is a {type(goal).__name__}",
                "the space of an arm is needed for that",
            )
        return [self.check_endpoint(cast("ArrayLike", goal), name)]

    def _read_message(self, q: ArrayLike | object) -> ArrayLike:
        """Return the configuration of a message with a header, or anything else as it is."""
        if not (hasattr(q, "header") or (isinstance(q, Mapping) and "header" in q)):
            return cast("ArrayLike", q)
        return self._convert_message(q)

    def _convert_message(self, msg: object) -> ArrayLike:
        """Return the configuration of a stamped pose."""
        from cspace.ros import configuration_of

        return configuration_of(msg, self)


class ConfigurationSpace(Space):
    """The configurations of a robot, with the queries of all maps and arms.

    :class:`cspace.CSpace` and :class:`cspace.TiledCSpace` read cells, :class:`cspace.ArmSpace`
    tests the geometry. Each has its own kernels for batches of configurations, and proves tubes:
    chunks, gates and curves take no other space.
    """

    _has_cells: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        """Refuse a class with answers of its own, which the kernels would not ask."""
        # They may also come from another of its parents.
        own = [
            name for name in ANSWERS if getattr(cls, name) is not getattr(ConfigurationSpace, name)
        ]
        if own:
            raise _make_own_answer_error(cls, own)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse an answer of its own for a single map or arm, too."""
        if name in ANSWERS:
            raise _make_own_answer_error(type(self), [name])
        super().__setattr__(name, value)

    @property
    def dof(self) -> int:
        """Degrees of freedom, such as 3 in SE(2) and 6 in SE(3)."""
        return self.size

    @cached_property
    def _angles(self) -> dict[int, str]:
        """Names of wrapped angles, by index."""
        return angle_axes(self.axes, self.is_periodic)

    def _bound_link_speeds(
        self, link: str, q: Floats, velocity: Floats, within: Floats, max_velocity: Floats
    ) -> Floats:
        """Bound the speed of a link, as :meth:`cspace.Arm.link_speed`; InputError for a map."""
        raise InputError("speed", f"is one of the link {link!r}", "links are those of an arm")

    @abstractmethod
    def _check_configurations(self, q: ArrayLike, name: str = "q") -> Floats:
        """Check configurations; return an array of floats.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.
        name : str
            Name of the argument, for errors.

        Returns
        -------
        ndarray of float64, the shape of q

        Raises
        ------
        InputError, ConfigurationError
            As :meth:`classify`.
        """

    @overload
    def classify(self, q: Configuration) -> int: ...  # type: ignore[overload-overlap]
    @overload
    def classify(self, q: ArrayLike) -> States: ...
    @names_options
    def classify(self, q: ArrayLike) -> int | States:
        """Return the state of configurations: FREE, MIXED or BLOCKED.

        Parameters
        ----------
        q : array-like, shape (size,) or (..., size)
            Metres, and radians.

        Returns
        -------
        int or ndarray of uint8, shape (...)
            FREE (0), MIXED (1) or BLOCKED (2).

        Raises
        ------
        InputError
            If the last axis is not :attr:`size` long, or a value is NaN or infinite.
        ConfigurationError
            If a configuration is outside the limits of an arm's joints.

        Warns
        -----
        AngleWarning
            If an angle exceeds 2 pi, as if it were in degrees.
        """
        state: int | None = self._ask_one(self._look_up_state, q)
        # Only the query of arrays tells whether an arm collides.
        if state is not None and (self._has_cells or state == FREE):
            return state
        states: int | States = evaluate(q, self.axes, self._write_states, np.uint8, self._angles)
        return states

    @overload
    def is_free(self, q: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def is_free(self, q: ArrayLike) -> Bools: ...
    @names_options
    def is_free(self, q: ArrayLike) -> bool | Bools:
        """Return True if configurations are proven collision-free.

        Arguments and errors as :meth:`classify`.

        Cells decide on a map, and geometry on its view :attr:`exact`. For an arm, geometry always
        does.
        """
        state: int | None = self._ask_one(self._look_up_state, q)
        if state is not None:
            return state == FREE
        free: bool | Bools = evaluate(q, self.axes, self._write_free, np.bool_, self._angles)
        return free

    @overload
    def motion_is_free(self, q0: Configuration, q1: Configuration) -> bool: ...  # type: ignore[overload-overlap]
    @overload
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike) -> Bools: ...
    @names_options
    def motion_is_free(self, q0: ArrayLike, q1: ArrayLike) -> bool | Bools:
        """Return True if straight motions are proven free throughout.

        On a map, a motion is proven if every closed cell that it touches, even in a corner, is
        FREE. A motion on the boundary of two cells touches both, so a motion that starts on the
        boundary of a cell that is not FREE is not proven. All joints of an arm move in proportion.

        Parameters
        ----------
        q0, q1 : array-like, shape (size,) or (..., size)
            Endpoints of the motions, metres and radians; broadcast against each other.

        Returns
        -------
        bool or ndarray of bool, shape (...)

        Raises
        ------
        InputError, ConfigurationError
            As :meth:`classify`.
        """
        state: int | None = self._ask_one(self._look_up_motion, q0, q1)
        if state is not None:
            return state == FREE
        free: bool | Bools = evaluate_edges(q0, q1, self.axes, self._write_motions, self._angles)
        return free

    def certify_path(self, path: ArrayLike, edges: ArrayLike | None = None) -> Bools:
        """Return whether each edge is proven collision-free.

        The edges belong to a path, to several paths, or to a roadmap. Edges are straight and rotate
        along the shorter arc, as OMPL interpolates, and answers are as for :meth:`motion_is_free`;
        for arms see :meth:`cspace.ArmSpace.certify_path`. Many edges are tested in threads.

        Parameters
        ----------
        path : array-like, shape (n, size) or (..., n, size)
            Configurations, metres and radians: a path, several paths of equal length, or the
            vertices of a roadmap.
        edges : array-like of int, shape (m, 2), optional
            Indices of the two vertices of each edge; ``path`` must then have shape (n, size). If
            left out, edges join consecutive configurations.

        Returns
        -------
        ndarray of bool, shape (n - 1,), (..., n - 1) or (m,)
            A path of one configuration counts as one edge from it to itself.

        Raises
        ------
        InputError
            If a configuration is invalid, even if no edge uses it; if a path is empty; if an edge
            is not a pair of indices of vertices; or if a joint turns by more than half a turn along
            an edge, unless a limit of the joint ends a map of it.
        ConfigurationError
            As :meth:`classify`.

        Examples
        --------
        >>> import numpy as np, cspace
        >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
        >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
        >>> corners = [(0.5, 1.5), (0.5, 2.5), (1.5, 2.5), (1.5, 0.5)]
        >>> space.certify_path(corners).tolist()
        [True, True, False]
        >>> space.certify_path(corners, [(0, 2), (2, 3)]).tolist()
        [True, False]
        """
        points = self._check_configurations(path, "path")
        write = self._write_motions
        if edges is not None:
            pairs = check_pairs(edges, points)
            first, second = pairs.T
            self._check_spans(points[first], points[second], pairs)
            return evaluate_rows(points[first], points[second], write)
        self._check_path(points)
        starts = points[..., :-1, :]
        ends = points[..., 1:, :]
        if not starts.shape[-2]:
            starts = ends = points  # one configuration stays where it is
        self._check_spans(starts, ends)
        rows = evaluate_rows(starts.reshape(-1, self.size), ends.reshape(-1, self.size), write)
        return rows.reshape(starts.shape[:-1])

    # ---- for planners ----------------------------------------------------------------------------

    def point_checker(self) -> Checker:
        """Return ``check(*q)``, a fast :meth:`is_free`; False beyond the limits of joints."""
        look_up = self._look_up_state
        if look_up is None:
            return lambda *q: self.is_free(q)
        return lambda *q: look_up(q) == FREE

    def edge_checker(self) -> Checker:
        """Return ``check(*q0, *q1)``, a fast :meth:`motion_is_free`; False beyond the limits."""
        look_up = self._look_up_motion
        size = self.size
        if look_up is None:
            return lambda *q: self.motion_is_free(q[:size], q[size:])
        return lambda *endpoints: look_up(endpoints) == FREE

    # ---- pages -----------------------------------------------------------------------------------

    view = _outside.view

    # ---- one configuration, given as a plain row: the same look-ups, without arrays --------------

    @property
    def _look_up_state(self) -> LookUp | None:
        """Look-up of one configuration's state; FREE or MIXED for an arm."""
        return None

    @property
    def _look_up_motion(self) -> LookUp | None:
        """Look-up of a motion, from the numbers of both ends: FREE if it is proven, else MIXED."""
        return None

    def _ask_one(self, look_up: LookUp | None, *points: Any) -> Any:
        """Return the answer of a look-up for configurations given as plain rows, or None.

        A plain row is a tuple, a list or an array of one axis, of numbers without labels, units or
        masks. None means that only the query of arrays can answer, warn or raise the error.
        """
        if look_up is None:
            return None
        numbers: tuple[Any, ...] = ()
        is_array = False
        try:
            for q in points:
                if type(q) is not tuple:  # as planners give them, so tested first
                    is_array |= type(q) is np.ndarray
                    q = _take_row(q)
                if len(q) != self.size:
                    return None
                # Compiled look-ups parse texts, and drop the labels, units and masks of entries.
                for x in q:
                    if type(x) not in NUMBERS:
                        return None
                for axis in self._angles:
                    if abs(q[axis]) > MAX_EXPECTED_ANGLE:
                        return None
                numbers += q
            answer = look_up(numbers)
        except (TypeError, ValueError, OverflowError):  # the type of rows or entries is wrong
            return None
        if not answer >= 0:
            return None
        if is_array:
            return np.float64(answer) if isinstance(answer, float) else np.uint8(answer)
        return answer

    # ---- what differs ----------------------------------------------------------------------------

    @abstractmethod
    def _write_states(self, rows: Floats, out: States) -> int:
        """Write the states of configurations.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """

    @abstractmethod
    def _write_free(self, rows: Floats, out: Bools) -> int:
        """Write whether configurations are free.

        ``rows`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable row, or
        -1.
        """

    @abstractmethod
    def _write_motions(self, starts: Floats, ends: Floats, out: Bools) -> int:
        """Write whether motions are free.

        ``starts`` and ``ends`` have shape (n, size), ``out`` (n,). Returns the index of the first
        unusable motion, or -1.
        """

    @abstractmethod
    def _count_free_tubes(self, starts: Floats, ends: Floats, radii: Floats, counts: Ints) -> None:
        """Lower counts to the number of first tubes that are free.

        Tubes lead from ``starts``, shape (b, size), to each of ``ends``, shape (b, n, size), in
        turn. ``radii``, shape (b, k), has the error of each coordinate; a quaternion has one.
        ``counts``, shape (b,), says how many to test.
        """

    @abstractmethod
    def _explain_tube(self, rows: Floats, radii: Floats) -> tuple[tuple[str, ...], str]:
        """Return names of obstacles near an unproven tube, and a sentence.

        A tube has all configurations within ``radii``, shape (k,), of a motion, in metres and
        radians; a quaternion has one radius. ``rows``, shape (n, size), are instants of the motion.
        """

    def _find_leaving_seconds(
        self, q: Floats, twist: Floats, seconds: float, tracking: Floats
    ) -> float:
        """Return for how long a twist comes no nearer to anything; see :meth:`Gate.slow_down`."""
        raise InputError(
            "leaving",
            f"is True, on {self!r}",
            "distances that never fall are proven on maps in memory",
        )

    def _find_unusable(self, rows: Floats) -> int:
        """Return the first unusable row's index, or -1.

        Limits of joints do not count.
        """
        unusable = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        return int(unusable[0]) if len(unusable) else -1

    def _check_path(self, points: Floats) -> None:
        """Raise InputError unless configurations are those of a path, or of several."""
        if points.ndim < 2 or not points.shape[-2]:
            raise InputError(
                "path",
                f"has shape {points.shape}",
                f"a path has the shape (n, {self.size}), with n above zero",
            )

    @cached_property
    def _spans(self) -> Floats:
        """Largest motion of coordinates between rows, shape (size,).

        It is half a turn for continuous joints, otherwise infinite.
        """
        return np.where(self.is_periodic, HALF_TURN, math.inf)

    def _check_spans(self, q0: Floats, q1: Floats, pairs: Ints | None = None) -> None:
        """Raise InputError if a continuous joint turns too far.

        Along an edge it may turn by half a turn. Edges lead from ``q0`` to ``q1``, shape (..., n,
        size). ``pairs``, shape (n, 2), are the rows that each edge joins; by default each row and
        the next.
        """
        spans = self._spans
        if np.isinf(spans).all():
            return
        steps = np.abs(q1 - q0)
        # The error names the first joint that turns too far.
        for *path, edge, joint in np.argwhere(steps > spans)[:1].tolist():
            first = edge
            last = edge + 1
            if pairs is not None:
                first, last = pairs[edge].tolist()
            angle, _ = tell_apart(steps[*path, edge, joint], math.pi)
            turn = f"turns {self.axes[joint]} by {angle} rad"
            raise InputError(
                "path",
                f"{turn} from row {first} to row {last}",
                "a joint turns by at most half a turn, so that the edge is the shorter way",
            )

    def _excesses(self, targets: Floats) -> Floats:
        """Return by how much targets, shape (b, n, size), exceed limits; 0 where they do not."""
        return np.zeros_like(targets)

    def _count_samples(self, n: int | None) -> int:
        """Return the number of configurations to draw, 1 for None; see :func:`check_samples`."""
        return check_samples(n, self.size)


def cells_of(space: SpaceT) -> SpaceT:
    """Return the map whose cells alone answer, for a map or its ``exact``.

    Regions, reasons and searches of cells need it: a configuration that the geometry proves free
    says nothing about the rest of its cell. A space without cells is returned as it is.
    """
    return cast(SpaceT, space._cells)


def map_record(space: Space) -> Map:
    """Return a map's cells as compiled functions take them; they follow updates.

    Raises InputError if the space is no map in memory.
    """
    return space._kernel_map


def tubes_are_free(space: ConfigurationSpace, starts: Floats, ends: Floats, radii: Floats) -> Bools:
    """Return whether the tube around each straight motion is proven free, shape (n,).

    Motions lead from ``starts`` to ``ends``, shape (n, size), rotations the shorter way. The tube
    of a motion has all configurations whose coordinates differ from it, at the same time, by at
    most its row of ``radii``, shape (n, k), metres and radians; a quaternion has one radius. Limits
    of joints do not count.
    """
    counts = np.ones(len(starts), dtype=np.int64)
    space._count_free_tubes(starts, ends[:, np.newaxis], radii, counts)
    return counts > 0


def _make_own_answer_error(kind: type, own: Sequence[str]) -> InputError:
    """Make the error for a map or an arm with answers that its kernels would not ask."""
    return InputError(
        kind.__name__,
        f"has its own {' and '.join(own)}",
        "cells and geometry prove without them",
    )

"""Local planners: edges between two configurations, by the robot's drive.

A holonomic robot follows the straight edge. A differential drive turns on the spot, drives straight
on and turns again. A car follows a curve.

References
----------
L. E. Dubins, "On curves of minimal length with a constraint on average curvature", 1957;
J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", 1990.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from ompl import base as ob

from cspace.arms.inverse import PoseGoal
from cspace.arms.space import ArmSpace, collision_error
from cspace.arrays import BLOCKED, FREE, MIXED, STATE_NAMES, Bools, Floats, Ints
from cspace.check import check_finite, check_flag, check_positive, check_word
from cspace.configuration_space import ConfigurationSpace
from cspace.errors import ConfigurationError, InputError
from cspace.map.callbacks import bind_kernel
from cspace.rotations.base import (
    ANGLE_SLACK,
    METRES_PER_RADIAN,
    TWO_PI,
    angle_axes,
    shorter,
    warn_of_degrees,
    wrapped,
)
from cspace.space import CSpace
from cspace.words import Drive
from planners.car_curves import advance, curve_cost, curve_lengths, prove_length, shortest_word
from planners.integrals import CostDensity, Field, bind_cost, make_edge_cost
from planners.states import (
    Configuration,
    check_space,
    format_configuration,
    kind_of,
    with_wrapped_angles,
)

if TYPE_CHECKING:
    from cspace.tiles.space import TiledCSpace

Endpoints = tuple[Configuration, ...]
"""A start and its alternative goals. Only arms have several goals."""

GoalLike = ArrayLike | PoseGoal | Sequence[PoseGoal | ArrayLike]
"""A goal of a plan, or several for an arm."""

MAX_SOLUTIONS_PER_POSE: Final = 128
"""Configurations at one pose that may be goals of a search."""

MAX_RADIANS_PER_ROW: Final = math.radians(5.0)
"""Largest rotation between rows of a resampled path, radians (5 degrees)."""

CAR_AXES: Final = ("x", "y", "yaw")
"""Axes of the maps for drives other than the holonomic one."""

HOLONOMIC: Final = "holonomic"
"""Drive that moves in any direction and turns while moving."""

_CURVE_SPACES: Final[dict[Drive, Callable[[float], ob.StateSpace]]] = {
    "dubins": ob.DubinsStateSpace,
    "reeds-shepp": ob.ReedsSheppStateSpace,
    "differential": ob.DubinsStateSpace,
    "differential-reverse": ob.ReedsSheppStateSpace,
}
"""OMPL's state spaces of curves, made from a turning radius, by drive."""

CURVES: Final[tuple[Drive, ...]] = ("dubins", "reeds-shepp")
"""Drives of cars, which follow curves; kernels use their indices."""

ON_THE_SPOT: Final[tuple[Drive, ...]] = tuple(name for name in _CURVE_SPACES if name not in CURVES)
"""Drives that turn on the spot; OMPL's lengths count only metres."""

DRIVES: Final[tuple[Drive, ...]] = get_args(Drive)
"""All drives."""

LENGTH_ROUNDING_SHARE: Final = 1e-12
"""Share by which rounding may change a length."""

JOINT_CHECKING_STEP: Final = 0.01
"""Joint distance (rad, m) between states when OMPL itself checks a motion."""

PIVOT_RADIUS_PER_SIDE: Final = 1e-9
"""OMPL's pivot radius, as a share of the map's longest side.

Curves of this radius stand for turning on the spot, and leave the driven edge by at most two radii.
With a radius a hundred times smaller, rounding would decide the direction of a turn.
"""


class Pieces(NamedTuple):
    """Short pieces of a path.

    ``centers``, shape (n, size), are the configurations halfway along each piece. ``lengths`` and
    ``rotations``, shape (n,), are the translation, metres, and the rotation, radians, along each
    piece.
    """

    centers: Floats
    lengths: Floats
    rotations: Floats


@dataclass(frozen=True, slots=True)
class LocalPlanner(ABC):
    """Edges between configurations of a space: their proofs, lengths and costs.

    Paths have shape (n, size).

    Attributes
    ----------
    space : CSpace, TiledCSpace or ArmSpace
        Space whose cells or geometry prove edges. Subclasses narrow its type. On a
        :class:`cspace.TiledCSpace` only the methods that :func:`planners.plan` calls before and
        after its search work; the search runs on parts in memory.
    exact : bool
        Whether the geometry itself decides edges that a map does not.
    drive : Drive
    turning_radius : float or None
        Turning radius of curves, metres.
    bidirectional : bool
        Whether an edge that OMPL checks must also be free from its end to its start. The two differ
        if the robot does not reverse.
    """

    space: ConfigurationSpace
    exact: bool = False
    drive: Drive = HOLONOMIC
    turning_radius: float | None = None
    bidirectional: bool = False

    has_cells: ClassVar[bool] = True
    """Whether the space is a map."""

    @property
    def in_memory(self) -> bool:
        """Whether the space is in memory."""
        return True

    @property
    def has_cheap_search(self) -> bool:
        """Whether a search costs less than :meth:`prove_existence`."""
        return False

    @property
    @abstractmethod
    def units(self) -> tuple[str, str]:
        """Units of lengths ("m", "rad" or "rad or m") and of distances."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest numbers of a configuration that OMPL bounds, shapes (k,)."""

    @property
    @abstractmethod
    def checking_step(self) -> float:
        """Distance between the states that OMPL itself checks along a motion."""

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space, without bounds."""
        return kind_of(self.space).make()

    @abstractmethod
    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves a configuration free."""

    @abstractmethod
    def clearance_checker(self) -> Callable[..., float]:
        """Make ``clearance(*q)``, a lower bound of the clearance.

        For an arm, it bounds the obstacle distance.
        """

    @abstractmethod
    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the edge free."""

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """Make ``check(first, second)``, which proves a motion between OMPL states free."""
        check = kind_of(self.space).of_states(self.edge_checker())
        return (
            (lambda first, second: check(first, second) and check(second, first))
            if self.bidirectional
            else check
        )

    def edges_are_free(self, path: Floats) -> Bools:
        """Return whether each edge is proven free, shape (n - 1,).

        A path of one configuration counts as one edge from it to itself.
        """
        check, rows = self.edge_checker(), path.tolist()
        pairs = itertools.pairwise(rows if len(rows) > 1 else 2 * rows)
        return np.array([check(*a, *b) for a, b in pairs], dtype=np.bool_)

    def are_free(self, path: Floats) -> bool:
        """Return True if every edge is proven free."""
        return bool(self.edges_are_free(path).all())

    def wrap_yaws(self, path: Floats) -> Floats:
        """Wrap the yaws of a path into [-pi, pi)."""
        return path

    def breakpoints(self, path: Floats) -> Floats:
        """Insert the configurations at which the motion changes."""
        return path

    def remove_turns(self, path: Floats) -> Floats:
        """Remove needless turns while all edges remain proven free."""
        return path

    @abstractmethod
    def resample(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """Add rows to drive and draw a path.

        Returns the path and its :attr:`planners.Plan.direction`.
        """

    @abstractmethod
    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the lengths of edges, shape (n,), with weighted rotations."""

    @abstractmethod
    def measure(self, path: Floats) -> tuple[float, float]:
        """Return ``length`` and ``total_rotation`` of a path, as :class:`planners.Plan` has."""

    @abstractmethod
    def min_length(self, first: Floats, last: Floats) -> float:
        """Bound the weighted lengths of all free paths from below."""

    @abstractmethod
    def clearance(self, path: Floats) -> float:
        """Bound the clearance along a path from below, as :attr:`planners.Plan.clearance`.

        Returns NaN for an arm.
        """

    @abstractmethod
    def obstacle_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along a path from below.

        See :attr:`planners.Plan.obstacle_distance`.
        """

    # ---- before and after a search ---------------------------------------------------------------

    @abstractmethod
    def check_endpoint(self, q: ArrayLike, name: str) -> Configuration:
        """Return a start or goal in canonical form, as OMPL holds it.

        Yaws are wrapped, quaternions have norm 1, and joints lie within limits. Raises
        ConfigurationError if no motion from it can be proven free, and InputError if it is no
        configuration.
        """

    def find_goals(
        self, goal: GoalLike, start: Configuration, seed: int | None
    ) -> list[Configuration]:
        """Return the checked goals that a path may end at, nearest first.

        Raises errors as :meth:`check_endpoint`; also if an arm reaches none of the poses given, or
        collides there.
        """
        if isinstance(goal, PoseGoal):
            rule, hint = "a map has no frames", "pass a configuration"
            raise InputError("goal", f"is a pose of {goal.frame!r}", rule, hint, value=goal)
        given = check_finite(goal, "goal")  # type: ignore[arg-type]  # pose goals are not numeric
        return [self.check_endpoint(given, "goal")]

    def prove_existence(self, endpoints: Endpoints) -> bool | None:
        """Prove or disprove that a path exists; None if undecided."""
        return None

    def may_join(self, exists: bool | None) -> bool:
        """Return False if no path can join start and goal.

        ``exists`` is the result of :meth:`prove_existence`.
        """
        return exists is not False

    def _check_size(self, q: ArrayLike, name: str) -> Floats:
        """Check one configuration's length and finiteness; return it as an array."""
        point = check_finite(q, name)
        if point.shape != (self.space.size,):
            rule = f"it must be one configuration of {self.space.size} numbers"
            hint = f"pass ({', '.join(self.space.axes)}), in metres and radians"
            raise InputError(name, f"has shape {point.shape}", rule, hint, value=q)
        return point


class EdgesOnMap(LocalPlanner):
    """Edges between configurations of a map."""

    space: CSpace

    @property
    def in_memory(self) -> bool:
        """Whether the map is in memory, not in a store."""
        return isinstance(self.space, CSpace)

    @property
    def has_cheap_search(self) -> bool:
        """Whether a search costs less than to label the components."""
        return self.in_memory and not self.exact and not self.space._is_labelled

    @property
    @abstractmethod
    def rotation_weight(self) -> float:
        """Metres that a radian of rotation adds to an edge's length."""

    @abstractmethod
    def edge_cost(self, field: Field, density: CostDensity) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the edge between configurations."""

    @abstractmethod
    def split_path(self, path: Floats, step: float, rotation: float) -> Pieces:
        """Split a path into pieces of at most ``step`` and ``rotation``.

        ``step`` is in metres, ``rotation`` in radians. A single configuration is one piece.
        """

    @property
    def units(self) -> tuple[str, str]:
        """Unit of the grid, for lengths and distances."""
        return self.space.grid.unit, self.space.grid.unit

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the grid."""
        return np.asarray(self.space.grid.lower), np.asarray(self.space.grid.upper)

    @property
    def checking_step(self) -> float:
        """Half a cell, in metres."""
        return 0.5 * self.space.grid.spacing

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves a configuration free."""
        return map_in_memory(self.space, "point_checker").point_checker(exact=self.exact)

    def clearance_checker(self) -> Callable[..., float]:
        """Make ``clearance(*q)``, a lower bound of the clearance, metres."""
        return self.space.clearance_checker()

    def straight_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves a straight edge free.

        The map may be in a store.
        """
        if self.in_memory:
            return self.space.edge_checker(exact=self.exact)
        size = self.space.size
        return lambda *edge: self.space.motion_is_free(edge[:size], edge[size:], exact=self.exact)

    def wrap_yaws(self, path: Floats) -> Floats:
        """Wrap the yaws of a path into [-pi, pi)."""
        return wrapped(path, [name == "yaw" for name in self.space.axes])

    def measure(self, path: Floats) -> tuple[float, float]:
        """Return the metres and radians of a path."""
        pieces = self.split_path(path, math.inf, math.inf)
        return math.fsum(pieces.lengths), math.fsum(pieces.rotations)

    def min_length(self, first: Floats, last: Floats) -> float:
        """Bound the lengths of all free paths from below."""
        space, dim = self.space, self.space.grid.dim
        steps = space.rotations.steps_between(first, last)
        metres = (
            space.min_path_length(first, last)
            if self.in_memory
            else float(np.linalg.norm(steps[:dim]))
        )
        return (1.0 - LENGTH_ROUNDING_SHARE) * (
            metres + self.rotation_weight * float(np.linalg.norm(steps[dim:]))
        )

    def clearance(self, path: Floats) -> float:
        """Bound the clearance along a path from below, metres.

        Each edge is split into pieces of at most half a cell and 5 degrees. All points of a piece
        lie within half its length of its center, and clearance changes by at most the length moved.
        So the clearance at the center minus half the length bounds the piece, in each rotation cell
        within half the piece's rotation.
        """
        space, dim = self.space, self.space.grid.dim
        pieces = self.split_path(path, 0.5 * space.grid.spacing, MAX_RADIANS_PER_ROW)
        rows, cells = space.rotations.find_cells_within(
            pieces.centers, 0.5 * pieces.rotations + 2.0 * ANGLE_SLACK
        )
        q = pieces.centers[rows]
        q[:, dim:] = space.rotations.centers[cells]  # clearance is constant in a rotation cell
        return max(0.0, float(np.min(space.clearance(q) - 0.5 * pieces.lengths[rows])))

    def obstacle_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along a path from below, metres.

        Returns NaN if the map has no geometry, or is tiled. Each edge is split into pieces on which
        no point of the robot moves by more than half a cell. Each point stays within a quarter of a
        cell of its position at the piece's center. The distance there minus that much bounds the
        piece.
        """
        if not self.in_memory:
            return math.nan
        space, step = self.space, 0.25 * self.space.grid.spacing
        pieces = self.split_path(path, step, step / max(space.robot.span, step))
        try:
            distance = space.obstacle_distance(pieces.centers, pieces.lengths, pieces.rotations)
        except InputError:  # the map has no geometry
            return math.nan
        return distance if self.are_free(path) else 0.0

    def check_endpoint(self, q: ArrayLike, name: str) -> Configuration:
        """Return a start or goal in canonical form.

        Raises ConfigurationError unless the configuration lies in the grid and a motion that stays
        there is proven free; the error names the nearest FREE configuration.
        """
        space = self.space
        given = self._check_size(q, name)
        point: Configuration = tuple(space.rotations.make_canonical(given, name).tolist())
        warn_of_degrees(given, angle_axes(space.axes, space.periodic_axes), name)
        inside = all(
            low <= x <= high
            for low, x, high in zip(space.grid.lower, point, space.grid.upper, strict=False)
        )
        if inside and self.straight_checker()(*point, *point):
            return point
        raise self._make_endpoint_error(point, name, inside)

    def _make_endpoint_error(
        self, point: Configuration, name: str, inside: bool
    ) -> ConfigurationError:
        """Make the error for a refused start or goal."""
        space = self.space
        state = space.classify(point)
        if not inside:
            box = f"from {_format_corner(space.grid.lower)} to {_format_corner(space.grid.upper)}"
            problem, rule = (
                f"lies outside the map, which reaches {box}",
                "a path stays within the map",
            )
        elif self.exact and state != BLOCKED:
            problem = "is in collision or too close to decide"
            rule = f"the {name} must be proven collision-free, by the map or by the geometry"
        elif state != FREE:
            problem = f"lies in a {STATE_NAMES[state].upper()} cell"
            rule = f"the {name} must be FREE, that is proven collision-free"
        else:
            problem = "is FREE but lies on the border of a cell that is not"
            rule = (
                f"a motion from or to it would touch that cell too, so the {name} must lie inside "
                "a FREE cell"
            )
        hints = []
        is_turned = self.in_memory and not space.rotations.preserve(space.robot.shape)
        if is_turned and state == MIXED and not self.exact:
            hints.append("build the map with more rotations")
        nearest: Configuration | None = None
        try:
            nearest = tuple(space.nearest_free(point).tolist())
            hints.append(f"the nearest is {format_configuration(nearest)}")
        except ConfigurationError:
            where = "at all" if self.in_memory else "near there"
            hints = hints or ["use a smaller robot, margin or spacing"]
            hints.insert(0, f"the map has no FREE configuration {where}")
        problem = f"{format_configuration(point)} {problem}"
        return ConfigurationError(
            name, problem, rule, "; ".join(hints), value=point, nearest=nearest
        )

    def prove_existence(self, endpoints: Endpoints) -> bool | None:
        """Prove or disprove that a path exists; None if undecided."""
        if self.space.is_connected(*endpoints):
            return True
        return False if self.space.is_disconnected(*endpoints) else None

    def may_join(self, exists: bool | None) -> bool:
        """Return False if no proven edges can join start and goal.

        Unless the geometry decides, an edge of any drive is proven only if every closed cell that
        it touches is FREE. The cells of the grid that contain a point of the edge form a block in
        position and rotation, so they are joined through sides. Along the edge, the cells change
        only at points that lie in both the old and the new cells. So all cells of a path, start and
        goal included, belong to one component of FREE cells, and ``exists`` is True. No path leaves
        the grid, even if the outside is free. Start and goal lie in the grid, straight edges
        between such points stay there, and curves that leave it are not proven.
        """
        return exists is not False if self.exact else exists is True


class StraightEdges(EdgesOnMap):
    """Straight edges of a holonomic robot.

    The robot turns evenly the shorter way, as in OMPL's SE(2) and SE(3).
    """

    rotation_weight = METRES_PER_RADIAN

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves a straight edge free."""
        return self.straight_checker()

    def edge_cost(self, field: Field, density: CostDensity) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the straight edge."""
        return make_edge_cost(self.space, field, density)

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the metres of straight edges plus half their radians, shape (n,)."""
        metres, radians = self._displacements(starts, ends)[1:]
        return metres + self.rotation_weight * radians

    def split_path(self, path: Floats, step: float, rotation: float) -> Pieces:
        """Split each edge into equal pieces of at most ``step`` and ``rotation``."""
        if len(path) == 1:
            return Pieces(path, np.zeros(1), np.zeros(1))
        steps, lengths, rotations, counts = self._count_pieces(path, step, rotation)
        edge, index = _index_pieces(counts)
        centers = self.space.rotations.add_steps(
            path[:-1][edge], ((index + 0.5) / counts[edge])[:, None] * steps[edge]
        )
        return Pieces(centers, (lengths / counts)[edge], (rotations / counts)[edge])

    def resample(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """Add rows to a path, at most 5 degrees of rotation apart."""
        if len(path) < 2:
            return path, None
        steps, _, radians, counts = self._count_pieces(
            path, self.space.grid.spacing, MAX_RADIANS_PER_ROW
        )
        if not radians.any():
            return path, None
        counts = np.where(radians > 0.0, counts, 1)
        edge, index = _index_pieces(counts)
        rotations, shares = self.space.rotations, (index / counts[edge])[:, None]
        rows = rotations.make_canonical(rotations.add_steps(path[:-1][edge], shares * steps[edge]))
        rows[index == 0] = path[:-1]
        return np.concatenate([rows, path[-1:]]), None

    def _count_pieces(
        self, path: Floats, step: float, rotation: float
    ) -> tuple[Floats, Floats, Floats, Ints]:
        """Return each edge's displacement, metres, radians and number of pieces."""
        steps, metres, radians = self._displacements(path[:-1], path[1:])
        counts = np.maximum(np.ceil(np.maximum(metres / step, radians / rotation)), 1.0).astype(
            np.int64
        )
        return steps, metres, radians, counts

    def _displacements(self, starts: Floats, ends: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the displacements along straight edges, and their metres and radians."""
        dim, steps = self.space.grid.dim, self.space.rotations.steps_between(starts, ends)
        return steps, np.linalg.norm(steps[:, :dim], axis=1), np.linalg.norm(steps[:, dim:], axis=1)


class TurnDriveTurn(StraightEdges):
    """Edges of a differential drive: turn, drive straight, turn.

    It turns on the spot, the shorter way, and drives with its x axis ahead. If it reverses, it
    drives backwards when that takes less rotation. Each of the three parts is proven as a straight
    edge; :meth:`breakpoints` gives their endpoints.

    OMPL gets curves with a turning radius of almost zero (:data:`PIVOT_RADIUS_PER_SIDE`). Its
    interpolation stays within 1e-8 of the map's side of the line, and its distance counts metres
    alone.
    """

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space of curves with a tiny turning radius."""
        return _CURVE_SPACES[self.drive](
            PIVOT_RADIUS_PER_SIDE * self.space.grid.spacing * max(self.space.grid.shape)
        )

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves all three parts free."""
        is_free, heading = self.straight_checker(), self.heading

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            yaw = heading(x0, y0, yaw0, x1, y1, yaw1)
            # The drive between the turns comes first: it is the longest part and the likeliest to
            # meet an obstacle.
            between = is_free(x0, y0, yaw, x1, y1, yaw)
            return (
                between
                and is_free(x0, y0, yaw0, x0, y0, yaw)
                and is_free(x1, y1, yaw, x1, y1, yaw1)
            )

        return check

    def edge_cost(self, field: Field, density: CostDensity) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of all three parts."""
        cost, heading = super().edge_cost(field, density), self.heading

        def total(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
            yaw = heading(x0, y0, yaw0, x1, y1, yaw1)
            turns = cost(x0, y0, yaw0, x0, y0, yaw) + cost(x1, y1, yaw, x1, y1, yaw1)
            return turns + cost(x0, y0, yaw, x1, y1, yaw)

        return total

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the metres of edges plus half their radians, shape (n,)."""
        yaws = [
            self.heading(*first, *last)
            for first, last in zip(starts.tolist(), ends.tolist(), strict=True)
        ]
        radians = np.abs(wrapped(yaws - starts[:, 2])) + np.abs(wrapped(ends[:, 2] - yaws))
        metres: Floats = np.linalg.norm(ends[:, :2] - starts[:, :2], axis=1)
        return metres + self.rotation_weight * radians

    def heading(
        self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
    ) -> float:
        """Return the yaw while driving an edge; ``yaw0`` for a pure turn."""
        if x0 == x1 and y0 == y1:
            return yaw0
        ahead = _wrap_yaw(math.atan2(y1 - y0, x1 - x0))
        if self.drive == "differential":
            return ahead
        back = _wrap_yaw(ahead + math.pi)
        return min(
            ahead,
            back,
            key=lambda yaw: abs(_shorter_angle(yaw0, yaw)) + abs(_shorter_angle(yaw, yaw1)),
        )

    def are_free(self, path: Floats) -> bool:
        """Return True if every edge is proven free."""
        return super().are_free(self.breakpoints(path))

    def breakpoints(self, path: Floats) -> Floats:
        """Insert the configurations at which turns and drives begin."""
        rows = path.tolist()
        waypoints = rows[:1]
        for first, last in itertools.pairwise(rows):
            yaw = self.heading(*first, *last)
            waypoints += [
                [*q[:2], yaw] for q in (first, last) if q[2] != yaw and first[:2] != last[:2]
            ]
            waypoints.append(last)
        return np.array(waypoints).reshape(-1, 3)

    def remove_turns(self, path: Floats) -> Floats:
        """Give waypoints the yaw of arrival, if their edges remain proven free."""
        check, rows = self.edge_checker(), path.tolist()
        for k in range(1, len(rows) - 1):
            arrival = [*rows[k][:2], self.heading(*rows[k - 1], *rows[k])]
            if check(*rows[k - 1], *arrival) and check(*arrival, *rows[k + 1]):
                rows[k] = arrival
        return np.array(rows).reshape(-1, 3)

    def split_path(self, path: Floats, step: float, rotation: float) -> Pieces:
        """Split turns and drives into pieces of at most ``step`` and ``rotation``."""
        return super().split_path(self.breakpoints(path), step, rotation)

    def resample(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """Add rows to the turns of a path and return directions."""
        rows, _ = super().resample(self.breakpoints(path))
        ahead = np.stack([np.cos(rows[1:, 2]), np.sin(rows[1:, 2])], axis=-1)
        signs = np.sign((np.diff(rows[:, :2], axis=0) * ahead).sum(axis=1)).astype(np.int8)
        return rows, np.concatenate(
            [signs[:1] if len(signs) else np.ones(len(rows), dtype=np.int8), signs]
        )


class JointMotions(LocalPlanner):
    """Straight motions of an arm in its joints.

    All joints move in step, continuous joints the shorter way.
    """

    space: ArmSpace
    has_cells = False
    checking_step = JOINT_CHECKING_STEP

    @property
    def units(self) -> tuple[str, str]:
        """Units of the joints and of distances."""
        return " or ".join(dict.fromkeys(self.space.units)), "m"

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves a configuration free."""
        return self.space.point_checker()

    def clearance_checker(self) -> Callable[..., float]:
        """Make ``clearance(*q)``, a lower bound of the obstacle distance, metres.

        It is 0 beyond the limits of the joints.
        """

        def clearance(*q: float) -> float:
            try:
                return float(self.space.obstacle_distance(q))
            except ConfigurationError:  # beyond the limits
                return 0.0

        return clearance

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the motion free."""
        return with_wrapped_angles(self.space.edge_checker(), self.space.periodic_axes)

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the lengths of motions in the joints, shape (n,)."""
        return np.asarray(np.linalg.norm(shorter(ends - starts, self.space.periodic_axes), axis=1))

    def measure(self, path: Floats) -> tuple[float, float]:
        """Return a path's length in the joints, and 0 for rotation."""
        return math.fsum(np.linalg.norm(np.diff(path, axis=0), axis=1)), 0.0

    def min_length(self, first: Floats, last: Floats) -> float:
        """Return the length of the straight motion, less rounding."""
        return (1.0 - LENGTH_ROUNDING_SHARE) * float(self.edge_lengths(first[None], last[None])[0])

    def clearance(self, path: Floats) -> float:
        """Return NaN: an arm has no cells."""
        return math.nan

    def obstacle_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along a path from below, metres.

        Distances between links count too.
        """
        return self.space.path_obstacle_distance(path)

    def resample(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """Return the path itself, without direction."""
        return path, None

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Limits of the joints, at most two revolutions to each side."""
        # A joint may have no limits and still not be periodic: if another follows it by half, it
        # repeats after two revolutions.
        return np.maximum(self.space.arm.lower, -2.0 * TWO_PI), np.minimum(
            self.space.arm.upper, 2.0 * TWO_PI
        )

    def check_endpoint(self, q: ArrayLike, name: str) -> Configuration:
        """Return a start or goal with joints clamped and angles wrapped.

        Raises ConfigurationError if it is beyond the limits or not proven free, and InputError if
        it is no configuration.
        """
        space = self.space
        given = self._check_size(q, name)
        point = space.arm._clamp(space._check_configurations(given, name))
        warn_of_degrees(given, angle_axes(space.axes, space.periodic_axes), name)
        if not space.is_free(point):
            raise collision_error(space, point, name)
        periodic = np.array(space.periodic_axes)
        point[periodic] = wrapped(point[periodic])
        return tuple(point.tolist())

    def find_goals(
        self, goal: GoalLike, start: Configuration, seed: int | None
    ) -> list[Configuration]:
        """Return the goals that are proven free, the nearest first.

        A pose gives several goals.
        """
        alternatives = _list_alternatives(goal)
        goals: list[Configuration] = []
        errors: list[ConfigurationError] = []
        for number, each in enumerate(alternatives):
            name = f"goal[{number}]" if len(alternatives) > 1 else "goal"
            try:
                if isinstance(each, PoseGoal):
                    goals += self._solve_pose(each, name, start, seed)
                else:
                    goals.append(self.check_endpoint(each, name))
            except ConfigurationError as error:
                errors.append(error)
        if not goals and len(alternatives) == 1:
            raise errors[0]
        if not goals:
            problem, rule = (
                f"has {len(alternatives)} alternatives, none of them proven free",
                "a path must end in FREE",
            )
            raise ConfigurationError(
                "goal", problem, rule, str(errors[0]), value=goal, nearest=errors[0].nearest
            )
        lengths = self.edge_lengths(np.array(start)[np.newaxis], np.array(goals))
        return [goals[row] for row in np.argsort(lengths, kind="stable").tolist()]

    def _solve_pose(
        self, goal: PoseGoal, name: str, start: Configuration, seed: int | None
    ) -> list[Configuration]:
        """Return the proven free configurations found at a pose."""
        space, contacts = self.space, Counter[tuple[str, str]]()
        points = space.arm._solve_pose(goal, name, start, MAX_SOLUTIONS_PER_POSE, seed or 0)
        points = wrapped(points, space.periodic_axes)
        free = points[np.asarray(space.is_free(points))]
        if len(free):
            return [tuple(q) for q in free.tolist()]
        contacts.update(space.closest(q)[:2] for q in points)
        ((link, other), number), *_ = contacts.most_common(1)
        problem = (
            f"has {len(points)} configurations that reach the pose, and none is proven free: "
            f"{link} is in collision with {other}, or nearly so, in {number} of them"
        )
        hint = (
            f"choose another pose, or pass allowed_collisions=[({link!r}, {other!r})] if they may "
            "touch"
        )
        nearest = tuple(points[0].tolist())
        raise ConfigurationError(
            name, problem, "a path must end in FREE", hint, value=goal, nearest=nearest
        )


class CarCurves(EdgesOnMap):
    """Edges along the shortest curve of a car.

    The map has the axes x, y, yaw. Each edge is proven along the curve itself, which is split into
    pieces. All cells that meet the box around a piece must be FREE (:mod:`planners.car_curves`). A
    curve that leaves the grid is not proven. If several curves are equally short, OMPL may drive
    any of these, so all are proven.
    """

    rotation_weight = 0.0

    @property
    def radius(self) -> float:
        """Turning radius in metres."""
        return float(self.turning_radius or math.nan)

    @property
    def kind(self) -> int:
        """Index of the drive in :data:`CURVES`."""
        return CURVES.index(self.drive)

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space of the curves, without bounds."""
        return _CURVE_SPACES[self.drive](self.radius)

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the shortest curves free."""
        prove = self.length_prover()
        return lambda *q: prove(*q) >= 0.0

    def edge_cost(self, field: Field, density: CostDensity) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the shortest curve."""
        return bind_cost(curve_cost, self.space, field, density, (self.kind, self.radius), count=6)

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """Make ``check(first, second)``, which proves a curve between OMPL states free.

        OMPL's curve must be as short as ours, because only the shortest curves are proven.
        """
        prove, states = kind_of(self.space).of_states(self.length_prover()), self.make_states()
        tolerance = 1e-6 * self.radius

        def check(first: ob.State, second: ob.State) -> bool:
            length = prove(first, second)
            return length >= 0.0 and bool(states.distance(first, second) <= length + tolerance)

        return check

    def length_prover(self) -> Callable[..., float]:
        """Make ``prove(*q0, *q1)``, the metres of the shortest curve.

        It returns -1 unless the curve is proven free.
        """
        if not self.in_memory:
            return lambda *q: self._window_around(np.reshape(q, (2, 3))).length_prover()(*q)
        map_ = self.space._kernel_map
        # Curves that leave the grid must not be proven, so the exterior counts as MIXED.
        map_ = map_._replace(exterior=np.full_like(map_.exterior, MIXED))
        return bind_kernel(prove_length, (map_, self.kind, self.radius), *[0.0] * 6)

    def _window_around(self, edge: Floats) -> CarCurves:
        """Return the curves in a part of the map around an edge, in memory."""
        space, margin = cast("TiledCSpace", self.space), 2.0 * self.space.grid.spacing
        centers = self.split_path(edge, space.grid.spacing, MAX_RADIANS_PER_ROW).centers
        positions = np.concatenate([edge, centers])[:, :2]
        return replace(
            self, space=space.window(positions.min(axis=0) - margin, positions.max(axis=0) + margin)
        )

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the metres of the shortest curves, shape (n,)."""
        return curve_lengths(
            self.kind, self.radius, np.ascontiguousarray(starts), np.ascontiguousarray(ends)
        )

    def metres(self, first: Floats, last: Floats) -> float:
        """Return the metres of the shortest curve between two configurations."""
        return float(self.edge_lengths(first[None], last[None])[0])

    def split_path(self, path: Floats, step: float, rotation: float) -> Pieces:
        """Split each curve into pieces of at most ``step`` and ``rotation``."""
        if len(path) == 1:
            return Pieces(path, np.zeros(1), np.zeros(1))
        curves = [
            self.split_curve(a, b, step, rotation, 0.5)[:3] for a, b in itertools.pairwise(path)
        ]
        centers, lengths, rotations = map(np.concatenate, zip(*curves, strict=True))
        return Pieces(centers, lengths, np.abs(rotations))

    def resample(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """Sample the curves of a path and return directions.

        Rows are at most a cell and 5 degrees apart.
        """
        rows, signs = [path[:1]], [np.ones(int(len(path) == 1), dtype=np.int8)]
        for a, b in itertools.pairwise(path):
            points, _, _, ahead = self.split_curve(
                a, b, self.space.grid.spacing, MAX_RADIANS_PER_ROW, 1.0
            )
            points[:, 2] = wrapped(points[:, 2])
            points[-1] = b
            rows.append(points)
            signs.append(ahead)
        direction = np.concatenate(signs)
        return np.concatenate(rows), np.concatenate([direction[:1], direction]) if len(
            path
        ) > 1 else direction

    def points(self, first: Floats, last: Floats, position: Floats) -> Floats:
        """Return configurations along a curve, shape (n, 3).

        ``position`` gives their distances from its start, metres, shape (n,).
        """
        steering, lengths = self._word(first, last)
        rows = []
        for left in (position / self.radius).tolist():
            pose = (0.0, 0.0, float(first[2]))
            for steer, length in zip(steering.tolist(), lengths.tolist(), strict=True):
                part = min(left, abs(length))
                pose = advance(pose, steer, math.copysign(part, length))
                left -= part
            rows.append(pose)
        points = np.array(rows).reshape(-1, 3)
        points[:, :2] = first[:2] + self.radius * points[:, :2]
        return points

    def _word(self, first: Floats, last: Floats) -> tuple[Ints, Floats]:
        """Return the steering and lengths of a curve's segments.

        Steering is 1, -1 or 0. Lengths are in radii, negative in reverse.
        """
        steering, lengths, _ = shortest_word(
            self.kind, self.radius, tuple(first.tolist()), tuple(last.tolist())
        )
        return steering, lengths

    def split_curve(
        self, first: Floats, last: Floats, step: float, rotation: float, share: float
    ) -> tuple[Floats, Floats, Floats, NDArray[np.int8]]:
        """Split a curve into pieces of at most ``step`` and ``rotation``.

        ``share`` selects the configuration of each piece: 0.5 its center, 1 its end. Returns these
        configurations, metres, signed radians, and 1 ahead or -1 in reverse. Segments that are only
        rounding errors are left out, but a curve has at least one piece.
        """
        steering, lengths = self._word(first, last)
        metres = self.radius * np.abs(lengths)
        longest = np.where(steering != 0.0, min(step, rotation * self.radius), step)
        counts = np.where(
            metres > 1e-9 * self.radius, np.maximum(np.ceil(metres / longest), 1.0), 0.0
        ).astype(np.int64)
        counts[np.argmax(metres)] += not counts.any()
        segment, index = _index_pieces(counts)
        each = (metres / np.maximum(counts, 1))[segment]
        position = (np.cumsum(metres) - metres)[segment] + (index + share) * each
        signs = np.where(lengths < 0.0, -1, 1).astype(np.int8)[segment]
        return (
            self.points(first, last, position),
            each,
            steering[segment] * signs * each / self.radius,
            signs,
        )


def local_planner(
    space: ConfigurationSpace,
    exact: bool = False,
    drive: Drive = HOLONOMIC,
    turning_radius: float | None = None,
    bidirectional: bool = False,
) -> LocalPlanner:
    """Make the local planner of a space from :class:`LocalPlanner` options.

    Raises InputError if ``space`` is no map or arm's space; the drive is unknown, or given for a
    space without the axes x, y, yaw; the turning radius is missing, given without a curve, or out
    of range; or ``exact`` is set for curves.
    """
    check_space(space)
    check_flag(exact, "exact")
    radius = check_drive(space.axes, drive, turning_radius, exact)
    if isinstance(space, ArmSpace):
        return JointMotions(space, True)  # without cells, the geometry always decides
    if radius is None:
        edges = StraightEdges if drive == HOLONOMIC else TurnDriveTurn
        return edges(space, bool(exact), drive, None, bidirectional)
    curves = CarCurves(space, False, drive, radius, bidirectional)
    lowest, highest = 1e-3 * curves.space.grid.spacing, 1e3 * curves.space.grid.spacing
    if not lowest <= radius <= highest:
        rule = f"it must be {lowest:g} to {highest:g} m, to keep rounding errors small"
        hint = "for a robot that turns on the spot, use drive='differential'"
        raise InputError("turning_radius", f"is {radius!r}", rule, hint, value=radius)
    return curves


def map_in_memory(space: object, needed_by: str) -> CSpace:
    """Return a map; raise ConfigurationError if it stays in its folder."""
    if isinstance(space, CSpace):
        return space
    hint = "use a part of it: space.window(lower, upper)"
    raise ConfigurationError(
        needed_by, "needs a map in memory", "this one stays in its folder", hint
    )


def _list_alternatives(goal: GoalLike) -> list[PoseGoal | ArrayLike]:
    """Return the goals of an arm, one by one."""
    if isinstance(goal, PoseGoal):
        return [goal]
    if isinstance(goal, Sequence) and any(isinstance(each, PoseGoal) for each in goal):
        return list(goal)
    rows = check_finite(goal, "goal")  # type: ignore[arg-type]
    return list(rows) if rows.ndim == 2 and len(rows) else [rows]


def check_drive(
    axes: tuple[str, ...], drive: Drive, turning_radius: float | None, exact: bool = False
) -> float | None:
    """Check a drive and return its turning radius, metres, or None.

    Drives without curves have no radius. Raises InputError as :func:`local_planner`, which also
    compares the radius with the map's spacing.
    """
    check_word(drive, "drive", DRIVES)
    if drive != HOLONOMIC and axes != CAR_AXES:
        problem, rule = (
            f"is {drive!r} and the axes are ({', '.join(axes)})",
            "it is for the axes (x, y, yaw)",
        )
        hint = "build a map of a plane with rotations=72, or leave drive out"
        raise InputError("drive", problem, rule, hint, value=drive)
    if drive not in CURVES:
        if turning_radius is not None:
            problem = f"is {turning_radius!r} and drive is {drive!r}"
            hint = "add drive='dubins' or drive='reeds-shepp', or leave the radius out"
            raise InputError(
                "turning_radius", problem, "a radius is for curves", hint, value=turning_radius
            )
        return None
    if turning_radius is None:
        rule = f"drive={drive!r} needs the radius of its tightest curve"
        raise InputError("turning_radius", "is missing", rule, "pass it in metres, e.g. 0.5")
    radius = check_positive(turning_radius, "turning_radius")
    if exact:
        problem, rule = f"is True and drive is {drive!r}", "curves are proven by FREE cells alone"
        hint = "leave exact out, or build the map with a finer spacing or more rotations"
        raise InputError("exact", problem, rule, hint, value=exact)
    return radius


def _format_corner(corner: Iterable[float]) -> str:
    """Format a corner of a map for a message."""
    return "(" + ", ".join(f"{x:.6g}" for x in corner) + ")"


def _index_pieces(counts: Ints) -> tuple[Ints, Ints]:
    """Return each piece's edge and its index on that edge.

    Edge k has ``counts[k]`` pieces.
    """
    edge = np.repeat(np.arange(len(counts)), counts)
    return edge, np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)


def _wrap_yaw(yaw: float) -> float:
    """Wrap a yaw from (-2 pi, 2 pi) into [-pi, pi)."""
    return yaw - TWO_PI if yaw >= math.pi else yaw + TWO_PI if yaw < -math.pi else yaw


def _shorter_angle(first: float, second: float) -> float:
    """Return the signed shorter angle from one yaw to another."""
    return math.remainder(second - first, TWO_PI)

"""The local planner: how two configurations are joined, as the drive of the robot has it.

A robot that goes to all sides takes the straight edge; one on two driven wheels turns on the spot, drives straight on
and turns again; a car follows a curve.

References
----------
L. E. Dubins, "On curves of minimal length with a constraint on average curvature", 1957; J. A. Reeds and L. A. Shepp,
"Optimal paths for a car that goes both forwards and backwards", 1990.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from ompl import base as ob

from cspace.arms.space import ArmSpace, collision_error
from cspace.arrays import BLOCKED, FREE, STATE_NAMES, Bools, Floats, Ints
from cspace.check import check_finite, check_flag, check_positive, check_word
from cspace.configuration_map import ConfigurationMap
from cspace.configuration_space import ConfigurationSpace
from cspace.errors import ConfigurationError, InputError
from cspace.map.periodic import with_wrapped_angles
from cspace.rotations.base import ANGLE_SLACK, TWO_PI, angle_axes, shorter, warn_of_degrees, wrapped
from cspace.space import CSpace
from planners.catalogue import BIRRT, GRID, MAX_CLEARANCE, OWN, planner_named
from planners.states import TURN_WEIGHT, Configuration, check_space, kind_of

if TYPE_CHECKING:
    from planners.integrals import CostDensity, Field

Endpoints = tuple[Configuration, Configuration]

DENSE_TURN: Final = math.radians(5.0)
"""Largest turn, in radians, between two rows of a dense path."""

CAR_AXES: Final = ("x", "y", "yaw")

HOLONOMIC: Final = "holonomic"
"""The drive of a robot that moves to all sides, and turns as it does so."""

_SPACES: Final[dict[str, Callable[[float], ob.StateSpace]]] = {
    "dubins": ob.DubinsStateSpace,
    "reeds-shepp": ob.ReedsSheppStateSpace,
    "differential": ob.DubinsStateSpace,
    "differential-reverse": ob.ReedsSheppStateSpace,
}

CURVES: Final = ("dubins", "reeds-shepp")
"""Drives that are curves of a car, in the order of their numbers in the kernels."""

ON_THE_SPOT: Final = tuple(name for name in _SPACES if name not in CURVES)
"""Drives that turn on the spot: OMPL's own length of their edges is in metres alone."""

DRIVES: Final = (HOLONOMIC, *ON_THE_SPOT, *CURVES)

ARM_STEP: Final = 0.01
"""How far apart OMPL looks at configurations of an arm where it steps along a motion by itself."""

POINT: Final = 1e-9
"""Turning radius, in sides of the map, of curves that OMPL is given for turning on the spot. They leave what is driven
by two of them at most, and with radii a hundred times smaller rounding would choose the way to turn."""


@dataclass(frozen=True, slots=True)
class Pieces:
    """A path cut into short pieces.

    Attributes
    ----------
    middles : ndarray of float64, shape (n, size)
    lengths : ndarray of float64, shape (n,)
        Metres of translation along each piece.
    turns : ndarray of float64, shape (n,)
        Radians by which the robot turns along each piece, zero or above.
    """

    middles: Floats
    lengths: Floats
    turns: Floats


@dataclass(frozen=True, slots=True)
class LocalPlanner(ABC):
    """What a plan has to know of the edges between its configurations.

    Attributes
    ----------
    space : CSpace or ArmSpace
        Decides whether an edge is free.
    exact : bool
        Whether the geometry itself decides where a map cannot.
    drive : str
        One of :data:`DRIVES`.
    turning_radius : float or None
        Of the curves, metres.
    bidirectional : bool
        Whether an edge that OMPL checks must also be free from its end to its start, which is another one where the
        robot does not reverse.
    """

    space: Any  # a ConfigurationSpace, as the classes below say
    exact: bool = False
    drive: str = HOLONOMIC
    turning_radius: float | None = None
    bidirectional: bool = False

    own: ClassVar[tuple[str, ...]] = ()
    """Searches of our own that go along such edges."""

    follows_cells = False
    """Whether such edges can follow a chain of cells of the map."""

    @property
    @abstractmethod
    def length_unit(self) -> str:
        """Unit of lengths: "m", "rad", or "rad or m" if an arm's joints have both."""

    @property
    @abstractmethod
    def distance_unit(self) -> str:
        """Unit of clearances and obstacle distances."""

    @property
    def quickest(self) -> str:
        """The planner that mostly finds a path soonest."""
        return planner_named(None, self.drive)

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments with which :func:`local_planner` makes it again, beside the map."""
        names = ("exact", "drive", "turning_radius", "bidirectional")
        return {name: getattr(self, name) for name in names}

    def states(self) -> ob.StateSpace:
        """OMPL's state space, without bounds."""
        return kind_of(self.space).make()

    @abstractmethod
    def edge_checker(self) -> Callable[..., bool]:
        """``check`` of the floats of two configurations: whether the edge between them is proven free."""

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """As :meth:`edge_checker`, of two states of OMPL and the edge that OMPL means."""
        check = kind_of(self.space).of_states(self.edge_checker())
        return (lambda first, second: check(first, second) and check(second, first)) if self.bidirectional else check

    def wrap_yaws(self, path: Floats) -> Floats:
        """Return a path, shape (n, size), with its yaws in [-pi, pi)."""
        return path

    def corners(self, path: Floats) -> Floats:
        """The configurations of a path, and those between where the motion changes: straight edges join them all."""
        return path

    def settled(self, path: Floats) -> Floats:
        """A path without the turns that it does not need, where that is proven too."""
        return path

    def edges_are_free(self, path: Floats) -> Bools:
        """Return whether each edge of a path is proven free, shape (n - 1,).

        Of a path of one configuration, whether that is, shape (1,).
        """
        check, rows = self.edge_checker(), path.tolist()
        pairs = itertools.pairwise(rows if len(rows) > 1 else 2 * rows)
        return np.array([check(*a, *b) for a, b in pairs], dtype=np.bool_)

    def are_free(self, path: Floats) -> bool:
        """Return True if every edge of a path is proven free; of a path of one configuration, if that is."""
        return bool(self.edges_are_free(path).all())

    @abstractmethod
    def search(self, planner: str, endpoints: Endpoints, straight: bool, seed: int | None, seconds: float) -> Floats:
        """A path by one of our own searches, shape (n, size); of none if it finds none."""

    @abstractmethod
    def lengths(self, firsts: Floats, lasts: Floats) -> Floats:
        """Lengths of the edges from some configurations to others, with what their turns count as, shape (n,)."""

    @abstractmethod
    def measured(self, path: Floats) -> tuple[float, float]:
        """Return :attr:`planners.Plan.length` and :attr:`planners.Plan.total_rotation` of a path."""

    @abstractmethod
    def clearance(self, path: Floats) -> float:
        """Bound the clearance along a path from below, as :attr:`planners.Plan.clearance`; NaN for an arm."""

    @abstractmethod
    def distance(self, path: Floats) -> float:
        """The robot's distance from obstacles along a path, as :attr:`planners.Plan.obstacle_distance`."""

    @abstractmethod
    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        """A path with rows near enough to drive and to draw; of a drive, 1, -1 or 0: ahead, back, on the spot."""

    # ---- what a plan asks before and after its search ----------------------------------------------------------------

    @property
    @abstractmethod
    def bounds(self) -> tuple[Floats, Floats]:
        """The lowest and the highest numbers that configurations may have, where OMPL wants to know."""

    @property
    @abstractmethod
    def step(self) -> float:
        """How far apart OMPL looks at states where it steps along a motion by itself, as a share of the whole."""

    @abstractmethod
    def endpoint(self, q: ArrayLike, name: str) -> Configuration:
        """A start or goal as OMPL holds it (yaw wrapped, quaternion of norm 1), if a motion can be proven free there.

        Raises ConfigurationError if it cannot, and InputError if it is no configuration.
        """

    def explain_clamping(self, q: ArrayLike, name: str) -> str:
        """Say which joints of a start or goal :meth:`endpoint` moves onto their limits; empty if none."""
        return ""

    def prove_existence(self, endpoints: Endpoints) -> bool | None:
        """Return True if a path is proven to exist, False if none is proven to, and None if undecided."""
        return None

    def may_join(self, exists: bool | None) -> bool:
        """Return False if no path of such edges can join start and goal, by what is proven of a path."""
        return exists is not False

    def known(self, exists: bool | None) -> str:
        """Say what is known of a path if a planner found none."""
        return "unknown whether one exists"

    def limits_at(self, endpoints: Endpoints) -> list[str]:
        """Say what limits motions at start and goal, for the status of a plan without a path."""
        return []

    def decide(self, planner: str) -> list[str]:
        """List what to try if no chain of FREE cells joins start and goal."""
        return []

    def advise(self, exists: bool | None, planner: str, named: bool, time: str, without: list[str]) -> list[str]:
        """List what to try if a planner found no path.

        ``named`` is whether the user chose the planner, ``time`` a longer time limit, and ``without`` the options that
        the map's own search does not take.
        """
        return [f"more time ({time})", "another seed", "another planner"]

    def _point(self, q: ArrayLike, name: str) -> Floats:
        """One configuration, its length checked."""
        point = check_finite(q, name)
        if point.shape != (self.space.size,):
            rule = f"it must be one configuration of {self.space.size} numbers"
            hint = f"pass ({', '.join(self.space.axes)}), in metres and radians"
            raise InputError(name, f"has shape {point.shape}", rule, hint, value=q)
        return point


class EdgesOnMap(LocalPlanner):
    """Edges between configurations of a map."""

    space: CSpace
    own = (GRID, MAX_CLEARANCE)

    @property
    def length_unit(self) -> str:
        return self.space.grid.unit

    @property
    def distance_unit(self) -> str:
        return self.space.grid.unit

    @property
    @abstractmethod
    def turn_weight(self) -> float:
        """Metres that a radian of turn counts as in the length of an edge."""

    @abstractmethod
    def edge_cost(self, field: Field, law: CostDensity) -> Callable[..., float]:
        """``cost`` of the floats of two configurations: that of the edge between them, by a law for each metre."""

    @abstractmethod
    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        """A path in pieces of at most ``step`` metres and ``turn`` radians."""

    def wrap_yaws(self, path: Floats) -> Floats:
        return wrapped(path, [name == "yaw" for name in self.space.axes])

    def edges_are_free(self, path: Floats) -> Bools:
        space: Any = self.space
        if isinstance(space, CSpace):
            return super().edges_are_free(path)
        # A map in a store has no edge checker; a window around each edge does.
        grid, free = space.grid, []
        for edge in np.stack([path[:-1], path[1:]], axis=1) if len(path) > 1 else [path]:
            places = np.concatenate([edge, self.pieces(edge, grid.spacing, DENSE_TURN).middles])[:, : grid.dim]
            room = 2.0 * grid.spacing
            window = space.window(places.min(axis=0) - room, places.max(axis=0) + room)
            free += replace(self, space=window).edges_are_free(edge).tolist()
        return np.array(free, dtype=np.bool_)

    def search(self, planner: str, endpoints: Endpoints, straight: bool, seed: int | None, seconds: float) -> Floats:
        find = {GRID: self.space.find_path, MAX_CLEARANCE: self.space.find_widest_path}
        return find[planner](*endpoints, straight=straight, time_limit=seconds)

    def measured(self, path: Floats) -> tuple[float, float]:
        pieces = self.pieces(path, math.inf, math.inf)
        return math.fsum(pieces.lengths), math.fsum(pieces.turns)

    def clearance(self, path: Floats) -> float:
        """Lower bound of the clearance all along a path.

        Each edge is cut into pieces of at most half a cell and 5 degrees. No point of a piece is further than half a
        piece from its middle, and distance changes by no more than the length moved; so the clearance at the middle
        less half the piece holds for the whole piece, in each rotation cell that the robot can come to within half the
        piece's turn; the smallest of them counts.
        """
        space, dim = self.space, self.space.grid.dim
        pieces = self._pieces(path, 0.5 * space.grid.spacing, DENSE_TURN)
        rows, cells = space.rotations.cells_within(pieces.middles, 0.5 * pieces.turns + 2.0 * ANGLE_SLACK)
        q = pieces.middles[rows]
        q[:, dim:] = space.rotations.centers[cells]  # clearance is one of the rotation cell
        return max(0.0, float(np.min(space.clearance(q) - 0.5 * pieces.lengths[rows])))

    def distance(self, path: Floats) -> float:
        """Lower bound of the robot's distance from the obstacles all along a path.

        Each edge is cut into pieces on which no point of the robot moves by more than half a cell: none is more than a
        quarter from where it is in the middle of the piece, so that the distance there, less as much, holds for all of
        it.
        """
        space, step = self.space, 0.25 * self.space.grid.spacing
        pieces = self._pieces(path, step, step / max(space.robot.span, step))
        try:
            distance = space.obstacle_distance(pieces.middles, pieces.lengths, pieces.turns)
        except InputError:  # there is no geometry to be asked
            return math.nan
        return distance if self.are_free(path) else 0.0

    def _pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        """As :meth:`pieces`; a path of one configuration is one piece."""
        return self.pieces(path, step, turn) if len(path) > 1 else Pieces(path, np.zeros(1), np.zeros(1))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        grid = self.space.grid
        return np.asarray(grid.lower), np.asarray(grid.upper)

    @property
    def step(self) -> float:
        return 0.5 * self.space.grid.spacing

    def endpoint(self, q: ArrayLike, name: str) -> Configuration:
        space = self.space
        given = self._point(q, name)
        point: Configuration = tuple(space.rotations.canonical(given, name).tolist())
        warn_of_degrees(given, angle_axes(space.axes, space.periodic_axes), name)
        inside = all(low <= x <= high for low, x, high in zip(space.grid.lower, point, space.grid.upper, strict=False))
        if inside and _stays_free(space, point, self.exact):
            return point
        raise self._unusable(point, name, inside)

    def _unusable(self, point: Configuration, name: str, inside: bool) -> ConfigurationError:
        """The error that says what is wrong with a configuration, and which one is near and right."""
        space = self.space
        state = space.classify(point)
        if not inside:
            reason = f"lies outside the map, which reaches from {text(space.grid.lower)} to {text(space.grid.upper)}"
            rule = "a path stays within the map"
        elif self.exact and state != BLOCKED:
            reason = "is in collision, or cannot be told from it"
            rule = f"the {name} must be proven collision-free, by the map or by the geometry"
        elif state != FREE:
            reason = f"lies in a {STATE_NAMES[state].upper()} cell"
            rule = f"the {name} must be FREE, which is to say proven collision-free"
        else:
            reason = "is FREE but lies on the border of a cell that is not"
            rule = f"a motion from or to it would touch that cell too, so the {name} must lie inside"
        nearest: Configuration | None = None
        try:
            nearest = tuple(space.nearest_free(point).tolist())
            hint = f"the nearest is {text(nearest)}"
        except ConfigurationError:
            where = "at all" if isinstance(space, CSpace) else "near there"
            hint = f"the map has no FREE configuration {where}; use a smaller robot, margin or spacing"
        return ConfigurationError(name, f"{text(point)} {reason}", rule, hint, value=point, nearest=nearest)

    def prove_existence(self, endpoints: Endpoints) -> bool | None:
        connected, disconnected = self.space._connectivity(*endpoints)
        return True if connected else False if disconnected else None

    def may_join(self, exists: bool | None) -> bool:
        """Return False if no path of such edges can join start and goal.

        Unless the geometry decides, an edge of any drive is proven only if every closed cell that it touches is FREE.
        At each of its points, the cells of the grid that contain the point are joined to each other through sides: in
        position and rotation they form a block. Along the edge, the cells change only at points that lie in both the
        old and the new ones. So all cells of a path belong to one component of FREE cells, those of start and goal
        included, and ``exists`` is True for these. No path leaves the grid, also if all around it is free: start and
        goal lie in the grid, straight edges between such points stay there, and curves that leave it are not proven.
        """
        return exists is not False if self.exact else exists is True

    def known(self, exists: bool | None) -> str:
        if exists is None:
            return "undecided whether one exists"
        return "a path exists" if self.drive == HOLONOMIC else "one exists for a robot that also moves sideways"

    def limits_at(self, endpoints: Endpoints) -> list[str]:
        if self.drive == HOLONOMIC:
            return []
        limits = []
        for name, q in zip(("start", "goal"), endpoints, strict=True):
            low, high = self._free_yaws(q)
            if high - low < TWO_PI - ANGLE_SLACK:
                yaws = f"{math.ceil(1e3 * low) / 1e3:g} to {math.floor(1e3 * high) / 1e3:g} rad"
                few = ", too few to turn around" * (self.drive in ON_THE_SPOT)
                limits.append(f"at the {name} only yaws {yaws} are proven free{few}")
        return limits

    def _free_yaws(self, q: Configuration) -> tuple[float, float]:
        """Return the yaws to which FREE cells let the robot turn on the spot, without wrapping; a turn if unknown."""
        rotations = self.space.rotations
        free = self.space.is_free(np.column_stack([np.tile(q[:2], (rotations.count, 1)), rotations.centers]))
        cell, borders = int(rotations.cell_of(q[2])), np.asarray(rotations.coordinates["yaw_bounds"])
        if free.all() or not free[cell]:
            return -math.pi, math.pi
        free, widths = np.roll(free, -cell), np.roll(np.diff(borders, axis=1)[:, 0], -cell)
        above, below = int(np.argmin(free)), int(np.argmin(free[::-1]))  # FREE cells from this one on, and before it
        low = q[2] - (q[2] - borders[cell, 0]) % TWO_PI
        return low - float(widths[len(widths) - below :].sum()), low + float(widths[:above].sum())

    @property
    def _finer(self) -> str:
        return "a finer spacing" + " or more rotations" * bool(self.space.rotations.names)

    def decide(self, planner: str) -> list[str]:
        exact = "exact=True" if planner not in OWN else "planner='RRTConnect' with exact=True"
        part = "" if isinstance(self.space, CSpace) else " on space.window(lower, upper)"
        wider = ["a workspace with wider bounds"] * (self.space.outside == "free")
        return [*([] if self.drive in CURVES else [exact + part]), self._finer, *wider]

    def advise(self, exists: bool | None, planner: str, named: bool, time: str, without: list[str]) -> list[str]:
        more = f"more time ({time})"
        if exists is None:
            return [self._finer, more]
        if self.drive != HOLONOMIC:
            return [more, *["a smaller turning_radius"] * (self.drive in CURVES), "another planner"]
        if planner == GRID:
            return [more, "planner='RRTConnect'"]
        options = f" without {' and '.join(without)}" if without else ""
        return [*[f"planner='Grid'{options}, which finds one"] * named, more]


class StraightEdges(EdgesOnMap):
    """Straight edges, along which the robot turns evenly and the shorter way, as in OMPL's SE(2) and SE(3)."""

    turn_weight = TURN_WEIGHT
    follows_cells = True

    def edge_checker(self) -> Callable[..., bool]:
        return self.space.edge_checker(exact=self.exact)

    def edge_cost(self, field: Field, law: CostDensity) -> Callable[..., float]:
        from planners.integrals import edge_cost

        return with_wrapped_angles(edge_cost(self.space, field, law), self.space.periodic_axes)

    def lengths(self, firsts: Floats, lasts: Floats) -> Floats:
        metres, turns = self._moved(firsts, lasts)[1:]
        return metres + self.turn_weight * turns

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        steps, lengths, turns, counts = self._measured(path, step, turn)
        edge, number = _numbered(counts)
        middles = self.space.rotations.moved(path[:-1][edge], ((number + 0.5) / counts[edge])[:, None] * steps[edge])
        return Pieces(middles, (lengths / counts)[edge], (turns / counts)[edge])

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        if len(path) < 2:
            return path, None
        steps, _, turns, counts = self._measured(path, self.space.grid.spacing, DENSE_TURN)
        if not turns.any():
            return path, None
        counts = np.where(turns > 0.0, counts, 1)
        edge, number = _numbered(counts)
        rotations, shares = self.space.rotations, (number / counts[edge])[:, None]
        rows = rotations.canonical(rotations.moved(path[:-1][edge], shares * steps[edge]))
        rows[number == 0] = path[:-1]
        return np.concatenate([rows, path[-1:]]), None

    def _measured(self, path: Floats, step: float, turn: float) -> tuple[Floats, Floats, Floats, Ints]:
        """Displacement along each edge, its metres and radians, and the number of pieces that it is cut into."""
        steps, lengths, turns = self._moved(path[:-1], path[1:])
        counts = np.maximum(np.ceil(np.maximum(lengths / step, turns / turn)), 1.0).astype(np.int64)
        return steps, lengths, turns, counts

    def _moved(self, firsts: Floats, lasts: Floats) -> tuple[Floats, Floats, Floats]:
        """Displacements along straight edges, and their metres and radians."""
        dim, steps = self.space.grid.dim, self.space.rotations.steps(firsts, lasts)
        return steps, np.linalg.norm(steps[:, :dim], axis=1), np.linalg.norm(steps[:, dim:], axis=1)


class TurnDriveTurn(StraightEdges):
    """Edges of a robot on two driven wheels: it turns on the spot, drives straight on, and turns on the spot.

    It turns the shorter way, and drives with its x axis ahead; one that reverses drives backwards where that takes less
    turning. Each of the three parts is a straight edge of the map, and proven as one; ``corners`` are their endpoints.

    OMPL is given curves of a car that turns on a point (:data:`POINT`): its interpolation gives configurations on the
    way, straight on the line but for a hundred-millionth, and its distance counts metres alone.
    """

    follows_cells = False

    def states(self) -> ob.StateSpace:
        return _SPACES[self.drive](POINT * self.space.grid.spacing * max(self.space.grid.shape))

    def edge_checker(self) -> Callable[..., bool]:
        free, heading = self.space.edge_checker(exact=self.exact), self.heading

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            yaw = heading(x0, y0, yaw0, x1, y1, yaw1)
            # The drive between the turns is the longest part, and the likeliest to meet an obstacle.
            between = free(x0, y0, yaw, x1, y1, yaw)
            return between and free(x0, y0, yaw0, x0, y0, yaw) and free(x1, y1, yaw, x1, y1, yaw1)

        return check

    def edge_cost(self, field: Field, law: CostDensity) -> Callable[..., float]:
        cost, heading = super().edge_cost(field, law), self.heading

        def total(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
            yaw = heading(x0, y0, yaw0, x1, y1, yaw1)
            turns = cost(x0, y0, yaw0, x0, y0, yaw) + cost(x1, y1, yaw, x1, y1, yaw1)
            return turns + cost(x0, y0, yaw, x1, y1, yaw)

        return total

    def lengths(self, firsts: Floats, lasts: Floats) -> Floats:
        offsets = lasts[:, :2] - firsts[:, :2]
        ahead, here = np.arctan2(offsets[:, 1], offsets[:, 0]), (offsets == 0.0).all(axis=1)
        yaws = np.where(here, firsts[:, 2], ahead), np.where(here, firsts[:, 2], ahead + math.pi)
        turns = [np.abs(wrapped(yaw - firsts[:, 2])) + np.abs(wrapped(lasts[:, 2] - yaw)) for yaw in yaws]
        fewest = turns[0] if self.drive == "differential" else np.minimum(*turns)
        return np.asarray(np.linalg.norm(offsets, axis=1) + self.turn_weight * fewest)

    def heading(self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
        """The yaw at which the robot drives from one configuration to another; the first one's, if it only turns."""
        if x0 == x1 and y0 == y1:
            return yaw0
        ahead = _canonical(math.atan2(y1 - y0, x1 - x0))
        if self.drive == "differential":
            return ahead
        back = _canonical(ahead + math.pi)
        return min(ahead, back, key=lambda yaw: abs(_turn(yaw0, yaw)) + abs(_turn(yaw, yaw1)))

    def are_free(self, path: Floats) -> bool:
        return super().are_free(self.corners(path))

    def corners(self, path: Floats) -> Floats:
        rows = path.tolist()
        waypoints = rows[:1]
        for first, last in itertools.pairwise(rows):
            yaw = self.heading(*first, *last)
            waypoints += [[*q[:2], yaw] for q in (first, last) if q[2] != yaw and first[:2] != last[:2]]
            waypoints.append(last)
        return np.array(waypoints).reshape(-1, 3)

    def settled(self, path: Floats) -> Floats:
        """The path, on which the robot leaves each waypoint as it came, where that is proven: it turns once."""
        check, rows = self.edge_checker(), path.tolist()
        for k in range(1, len(rows) - 1):
            came = [*rows[k][:2], self.heading(*rows[k - 1], *rows[k])]
            if check(*rows[k - 1], *came) and check(*came, *rows[k + 1]):
                rows[k] = came
        return np.array(rows).reshape(-1, 3)

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        return super().pieces(self.corners(path), step, turn)

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        rows, _ = super().dense(self.corners(path))
        ahead = np.stack([np.cos(rows[1:, 2]), np.sin(rows[1:, 2])], axis=-1)
        signs = np.sign((np.diff(rows[:, :2], axis=0) * ahead).sum(axis=1)).astype(np.int8)
        return rows, np.concatenate([signs[:1] if len(signs) else np.ones(len(rows), dtype=np.int8), signs])


class JointMotions(LocalPlanner):
    """Motions of an arm: all joints move in step, continuous ones the shorter way."""

    space: ArmSpace
    own = (BIRRT,)
    quickest = BIRRT
    distance_unit = "m"

    @property
    def length_unit(self) -> str:
        return " or ".join(dict.fromkeys(self.space.units))

    def edge_checker(self) -> Callable[..., bool]:
        return with_wrapped_angles(self.space.edge_checker(), self.space.periodic_axes)

    def edges_are_free(self, path: Floats) -> Bools:
        firsts, lasts = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
        return np.asarray(self.space.motion_is_free(firsts, lasts))

    def search(self, planner: str, endpoints: Endpoints, straight: bool, seed: int | None, seconds: float) -> Floats:
        return self.space.find_path(*endpoints, straight=straight, seed=seed, time_limit=seconds)

    def lengths(self, firsts: Floats, lasts: Floats) -> Floats:
        return np.asarray(np.linalg.norm(shorter(lasts - firsts, self.space.periodic_axes), axis=1))

    def measured(self, path: Floats) -> tuple[float, float]:
        return math.fsum(np.linalg.norm(np.diff(path, axis=0), axis=1)), 0.0

    def clearance(self, path: Floats) -> float:
        return math.nan

    def distance(self, path: Floats) -> float:
        return self.space.path_obstacle_distance(path)

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        return path, None

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        # Joints without limits that are no circles: those that others follow by half are the same after two turns.
        return np.maximum(self.space.arm.lower, -2.0 * TWO_PI), np.minimum(self.space.arm.upper, 2.0 * TWO_PI)

    @property
    def step(self) -> float:
        return ARM_STEP

    def endpoint(self, q: ArrayLike, name: str) -> Configuration:
        space = self.space
        given = self._point(q, name)
        point = space.arm.clamp(space._check_configurations(given, name))
        warn_of_degrees(given, angle_axes(space.axes, space.periodic_axes), name)
        if not space.is_free(point):
            raise collision_error(space, point, name)
        circles = np.array(space.periodic_axes)
        point[circles] = wrapped(point[circles])
        return tuple(point.tolist())

    def explain_clamping(self, q: ArrayLike, name: str) -> str:
        arm, point = self.space.arm, self._point(q, name)
        moved = np.abs(arm.clamp(point) - point)
        rows = zip(arm.joints, moved.tolist(), arm.units, strict=True)
        joints = [f"{joint} by {by:.2g} {unit}" for joint, by, unit in rows if by]
        return f"{name} moved onto the limit of {', '.join(joints)}" if joints else ""


class CarCurves(EdgesOnMap):
    """Edges along the shortest curve of a car, of a map of a robot that turns in the plane.

    Every edge is proven along the real curve: it is cut into pieces, and all cells are FREE that meet the box of
    configurations which a piece cannot leave (:mod:`planners.car_curves`). A curve that leaves the grid is not proven.
    Where several curves are equally short, ours may be another than OMPL's; all of them are proven.
    """

    turn_weight = 0.0

    @property
    def radius(self) -> float:
        """Turning radius, metres."""
        return float(self.turning_radius or math.nan)

    def states(self) -> ob.StateSpace:
        return _SPACES[self.drive](self.radius)

    def edge_checker(self) -> Callable[..., bool]:
        prove = self.length_prover()
        return lambda *q: prove(*q) >= 0.0

    def edge_cost(self, field: Field, law: CostDensity) -> Callable[..., float]:
        from planners.car_curves import cost

        return cost(self.space, self.kind, self.radius, field, law)

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """Whether a curve is proven free, and is no longer than OMPL's, so that it is the one that OMPL means."""
        prove, states = kind_of(self.space).of_states(self.length_prover()), self.states()
        tolerance = 1e-6 * self.radius

        def check(first: ob.State, second: ob.State) -> bool:
            length = prove(first, second)
            return length >= 0.0 and bool(states.distance(first, second) <= length + tolerance)

        return check

    def length_prover(self) -> Callable[..., float]:
        """``prove`` of the floats of two configurations: the metres of the curve where it is proven free, else -1."""
        from planners.car_curves import prover

        return prover(self.space, self.kind, self.radius)

    def lengths(self, firsts: Floats, lasts: Floats) -> Floats:
        return np.array([self.metres(*edge) for edge in zip(firsts, lasts, strict=True)])

    def metres(self, first: Floats, last: Floats) -> float:
        """Metres of the curve between two configurations."""
        return self.radius * float(np.abs(self._word(first, last)[1]).sum())

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        cuts = [self._cut(a, b, step, turn, 0.5)[:3] for a, b in itertools.pairwise(path)]
        if not cuts:
            return Pieces(np.empty((0, 3)), np.empty(0), np.empty(0))
        return Pieces(*(np.concatenate(column) for column in zip(*cuts, strict=True)))

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        rows, signs = [path[:1]], [np.ones(0, dtype=np.int8)]
        for a, b in itertools.pairwise(path):
            points, _, _, ahead = self._cut(a, b, self.space.grid.spacing, DENSE_TURN, 1.0)
            points[:, 2] = wrapped(points[:, 2])
            points[-1] = b
            rows.append(points)
            signs.append(ahead)
        direction = np.concatenate(signs)
        first = direction[:1] if len(direction) else np.ones(1, dtype=np.int8)
        return np.concatenate(rows), np.concatenate([first, direction])

    def points(self, first: Floats, last: Floats, position: Floats) -> Floats:
        """Configurations at distances in metres, shape (n,), along the curve from one to another; shape (n, 3)."""
        turns, lengths = self._word(first, last)
        yaws = first[2] + np.cumsum([0.0, *turns * lengths])
        begins = np.cumsum([0.0, *np.abs(lengths[:-1])])
        corners = np.cumsum([(0.0, 0.0), *_offsets(turns, lengths, yaws[:-1])], axis=0)
        distance = position / self.radius
        # Where two parts meet, a point is on the later one.
        part = np.maximum(np.searchsorted(begins, distance + 1e-12, side="right") - 1, 0)
        along = np.copysign(np.clip(distance - begins[part], 0.0, np.abs(lengths[part])), lengths[part])
        places = corners[part] + _offsets(turns[part], along, yaws[part])
        return np.column_stack([first[:2] + self.radius * places, yaws[part] + turns[part] * along])

    @property
    def kind(self) -> int:
        """Index into :data:`CURVES`."""
        return CURVES.index(self.drive)

    def _word(self, first: Floats, last: Floats) -> tuple[Floats, Floats]:
        """The turns of the parts of a curve, 1, -1 or 0, and their lengths in radii, below zero in reverse."""
        from planners.car_curves import shortest

        turns, lengths, _ = shortest(self.kind, self.radius, tuple(first.tolist()), tuple(last.tolist()))
        return np.asarray(turns, dtype=np.float64), np.asarray(lengths)

    def _cut(
        self, first: Floats, last: Floats, step: float, turn: float, where: float
    ) -> tuple[Floats, Floats, Floats, NDArray[np.int8]]:
        """A curve in steps: a configuration of each, at its middle (where = 0.5) or its end (1); metres, radians, sign.

        Rounding makes some parts a hair long, which are left out; but a curve has one step at least.
        """
        turns, lengths = self._word(first, last)
        metres = self.radius * np.abs(lengths)
        longest = np.where(turns != 0.0, min(step, turn * self.radius), step)
        counts = np.where(metres > 1e-9 * self.radius, np.maximum(np.ceil(metres / longest), 1.0), 0.0).astype(np.int64)
        counts[np.argmax(metres)] += not counts.any()
        part, number = _numbered(counts)
        each = (metres / np.maximum(counts, 1))[part]
        position = (np.cumsum(metres) - metres)[part] + (number + where) * each
        signs = np.where(lengths < 0.0, -1, 1).astype(np.int8)[part]
        return self.points(first, last, position), each, np.abs(turns[part]) * each / self.radius, signs


def local_planner(
    space: ConfigurationSpace,
    exact: bool = False,
    drive: str = HOLONOMIC,
    turning_radius: float | None = None,
    bidirectional: bool = False,
) -> LocalPlanner:
    """How configurations are joined; the options are those of :class:`LocalPlanner`.

    Raises InputError if ``space`` is no map; or it is not one of a robot that turns in the plane and a drive is set,
    the turning radius is missing, unwanted, or not above zero, the drive is unknown, or ``exact`` is wanted along a
    curve.
    """
    check_space(space)
    check_flag(exact, "exact")
    radius = check_drive(space.axes, drive, turning_radius, exact)
    if isinstance(space, ArmSpace):
        return JointMotions(space, True)  # there are no cells to be asked first
    if radius is None:
        made = StraightEdges if drive == HOLONOMIC else TurnDriveTurn
        return made(space, bool(exact), drive, None, bidirectional)
    curves = CarCurves(space, False, drive, radius, bidirectional)
    least, most = 1e-3 * curves.space.grid.spacing, 1e3 * curves.space.grid.spacing
    if not least <= radius <= most:
        rule = f"it must be {least:g} to {most:g} m, so that rounding does not count"
        hint = "for a robot that turns on the spot, use drive='differential'"
        raise InputError("turning_radius", f"is {radius!r}", rule, hint, value=radius)
    return curves


def check_drive(axes: tuple[str, ...], drive: str, turning_radius: float | None, exact: bool = False) -> float | None:
    """The turning radius of a drive that goes with a map of configurations with some axes; None if it has none.

    Raises InputError as :func:`local_planner`, which looks at the map's spacing besides.
    """
    check_word(drive, "drive", DRIVES)
    if drive != HOLONOMIC and axes != CAR_AXES:
        problem = f"is {drive!r} and the map's configurations are ({', '.join(axes)})"
        rule = f"it is for a robot that drives and turns in the plane: ({', '.join(CAR_AXES)})"
        hint = "build a map of a plane with rotations=72, or leave drive out"
        raise InputError("drive", problem, rule, hint, value=drive)
    if drive not in CURVES:
        if turning_radius is not None:
            problem = f"is {turning_radius!r} and drive is {drive!r}"
            hint = f"add {' or '.join(f'drive={name!r}' for name in CURVES)}, or leave the radius out"
            raise InputError("turning_radius", problem, "a radius is for curves", hint, value=turning_radius)
        return None
    if turning_radius is None:
        rule, hint = f"drive={drive!r} needs the radius of its tightest turn", "pass it in metres, e.g. 0.5"
        raise InputError("turning_radius", "is missing", rule, hint)
    radius = check_positive(turning_radius, "turning_radius")
    if exact:
        hint = "leave exact out, or build the map with a finer spacing or more rotations"
        raise InputError(
            "exact", f"is True and drive is {drive!r}", "curves are proven by FREE cells alone", hint, value=exact
        )
    return radius


def text(point: Iterable[float]) -> str:
    """A configuration for messages."""
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"


def _stays_free(space: ConfigurationMap, q: Configuration, exact: bool) -> bool:
    """Whether a motion that stays at a configuration is proven free."""
    if isinstance(space, CSpace):
        return space.edge_checker(exact=exact)(*q, *q)
    return space.motion_is_free(q, q, exact=exact)


def _numbered(counts: Ints) -> tuple[Ints, Ints]:
    """For ``counts[k]`` pieces of each edge k: the edge of each piece, and the piece's number on it."""
    edge = np.repeat(np.arange(len(counts)), counts)
    return edge, np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)


def _offsets(turns: Floats, lengths: Floats, yaws: Floats) -> Floats:
    """How far parts of a curve lead from where they begin, at some yaws, in turning radii, shape (n, 2)."""
    after = yaws + turns * lengths
    x = np.where(turns, turns * (np.sin(after) - np.sin(yaws)), lengths * np.cos(yaws))
    y = np.where(turns, turns * (np.cos(yaws) - np.cos(after)), lengths * np.sin(yaws))
    return np.stack([x, y], axis=-1)


def _canonical(yaw: float) -> float:
    """A yaw from (-2 pi, 2 pi) in [-pi, pi)."""
    return yaw - TWO_PI if yaw >= math.pi else yaw + TWO_PI if yaw < -math.pi else yaw


def _turn(first: float, second: float) -> float:
    """The angle from one yaw to another, the shorter way."""
    return math.remainder(second - first, TWO_PI)

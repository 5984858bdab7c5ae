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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace import MIXED, CSpace, Space
from cspace.inside import (
    ANGLE_SLACK,
    METRES_PER_RADIAN,
    Bools,
    Car,
    ConfigurationMap,
    Differential,
    Endpoint,
    Floats,
    Map,
    cells_of,
    map_record,
    measure_steps,
    proofs_of,
)
from planners._integrals import CellCost, bind_cost, integrate_straight_edge
from planners._ompl_states import find_state_kind, with_wrapped_angles

if TYPE_CHECKING:
    from cspace import TiledCSpace
    from cspace.inside import Geometry

Endpoints = tuple[Endpoint, ...]
"""A start and its alternative goals. Only arms have several goals."""

MAX_RADIANS: Final = math.radians(5.0)
"""Largest rotation between rows of a resampled path, and of a piece of a path, radians."""

Drive: TypeAlias = Car | Differential
"""A robot that drives along its x axis; others move in any direction."""

MAX_TURN: Final = 0.499 * math.tau
"""Largest turn of a joint along an edge, radians; below half a turn, so that rounding does not
decide its direction."""

PIVOT_RADIUS_PER_SIDE: Final = 1e-9
"""OMPL's pivot radius, as a share of the map's longest side.

Curves of this radius stand for turning on the spot, and leave the driven edge by at most two radii.
With a radius a hundred times smaller, rounding would decide the direction of a turn.
"""


def make_curve_states(reverses: bool, radius: float) -> ob.StateSpace:
    """Make OMPL's state space of curves of a turning radius, metres."""
    kind = ob.ReedsSheppStateSpace if reverses else ob.DubinsStateSpace
    return kind(radius)


class Pieces(NamedTuple):
    """Short pieces of a path."""

    points: Floats  # (n, size), a configuration on each piece, by default its center
    lengths: Floats  # (n,), metres of translation along each piece
    rotations: Floats  # (n,), radians of rotation


@dataclass(frozen=True, slots=True)
class LocalPlanner:
    """Straight edges between configurations of a space: their proofs, lengths and costs.

    Poses rotate evenly the shorter way, as in OMPL's SE(2) and SE(3); continuous joints turn the
    shorter way. Paths have shape (n, size).

    Attributes
    ----------
    space : Space
        Space that proves edges. On a :class:`cspace.TiledCSpace` only the methods that
        :func:`planners.plan` calls before and after its search work; the search runs on parts in
        memory.
    drive : Drive or None
        None for a holonomic robot.
    bidirectional : bool
        Whether an edge that OMPL checks must also be free from its end to its start. The two differ
        if the robot does not reverse.
    weights : CellCost or None
        What a metre costs on a map in memory; None if it is the length.
    """

    space: Space
    drive: Drive | None = None
    bidirectional: bool = False
    weights: CellCost | None = None

    rotation_weight: ClassVar[float] = METRES_PER_RADIAN
    """Metres that a radian of rotation adds to an edge's length."""

    @property
    def exact(self) -> bool:
        """Whether more than cells decides edges, such as geometry."""
        space = self.space
        return not isinstance(space, ConfigurationMap) or cells_of(space) is not space

    @property
    def cells(self) -> CSpace:
        """The space as a map in memory, as known, whose cells alone answer."""
        return cast(CSpace, cells_of(self.space))

    @property
    def tiles(self) -> TiledCSpace:
        """The space as a map in tiles, as known."""
        return cast("TiledCSpace", self.space)

    @property
    def turning_radius(self) -> float | None:
        """Turning radius of a car, metres; None for other robots."""
        return self.drive.turning_radius if isinstance(self.drive, Car) else None

    @property
    def reverses(self) -> bool:
        """Whether the robot also drives backwards."""
        return self.drive is not None and self.drive.reverse

    def bounded_map(self) -> Map:
        """Return the map for kernels, MIXED outside."""
        map_ = map_record(self.cells)
        return map_._replace(exterior=np.full_like(map_.exterior, MIXED))

    def geometry(self) -> Geometry:
        """Return the geometry that decides MIXED cells for kernels; None unless exact."""
        if not self.exact:
            return None
        geometry: Geometry = proofs_of(self.cells).geometry
        return geometry

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space, without bounds."""
        return find_state_kind(self.space).make()

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves a configuration free."""
        return self.space.point_checker()

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the edge free."""
        check = self.space.edge_checker()
        return with_wrapped_angles(check, self.space.is_periodic)

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """Make ``check(first, second)``, which proves a motion between OMPL states free."""
        check = find_state_kind(self.space).of_states(self.edge_checker())
        if not self.bidirectional:
            return check
        return lambda first, second: check(first, second) and check(second, first)

    def edges_are_free(self, path: Floats) -> Bools:
        """Return whether each edge is proven free, shape (n - 1,).

        A path of one configuration counts as one edge from it to itself.
        """
        return np.fromiter(self._check_edges(path), dtype=np.bool_)

    def are_free(self, path: Floats) -> bool:
        """Return True if every edge is proven free, else stop early."""
        return all(self._check_edges(path))

    def _check_edges(self, path: Floats) -> Iterator[bool]:
        """Yield whether each edge is proven free."""
        check = self.edge_checker()
        rows = path.tolist()
        if len(rows) == 1:
            rows *= 2
        for first, last in itertools.pairwise(rows):
            yield check(*first, *last)

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the edge on a map."""
        size = self.space.size
        weight = self.rotation_weight
        return bind_cost(integrate_straight_edge, self.cells, weights, weight, size)

    def weigh(self) -> Callable[..., float] | None:
        """Make ``cost(*q0, *q1)``, the cost of the edge; None if it is the length."""
        return None if self.weights is None else self.edge_cost(self.weights)

    def edge_costs(self, starts: Floats, ends: Floats) -> Floats:
        """Return the costs of edges, shape (n,), at least their lengths."""
        cost = self.weigh()
        if cost is None:
            return self.edge_lengths(starts, ends)
        return np.array([cost(*row) for row in np.hstack([starts, ends]).tolist()])

    def path_cost(self, path: Floats) -> float:
        """Return the cost of a path, shape (n, size)."""
        return float(self.edge_costs(path[:-1], path[1:]).sum())

    def path_length(self, path: Floats) -> float:
        """Return the length of a path, shape (n, size), with weighted rotations."""
        return float(self.edge_lengths(path[:-1], path[1:]).sum())

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the lengths of edges, shape (n,), with weighted rotations."""
        if self.drive is None:
            return self.space.distance(starts, ends)
        rows = np.hstack([starts, ends]).tolist()
        return np.array([self.edge_length(*row) for row in rows])

    def edge_length(self, *ends: float) -> float:
        """Return an edge's length, from numbers of both ends."""
        return float(self.space.distance(*np.reshape(ends, (2, -1))))

    def insert_breakpoints(self, path: Floats) -> Floats:
        """Insert configurations where motions change, or joints turn widely.

        From row to row, a joint turns by less than half a turn, so that a controller that takes the
        shorter way makes the same motion.
        """
        if self.space.has_poses:
            return path
        angles = np.array(self.space.units) == "rad"
        rows = [path[:1]]
        for first, last in itertools.pairwise(path):
            turn = np.abs(last - first)[angles].max(initial=0.0)
            rows.append(np.linspace(first, last, int(turn // MAX_TURN) + 2)[1:])
        return np.concatenate(rows)

    def remove_turns(self, path: Floats) -> Floats:
        """Remove needless turns while all edges remain proven free."""
        return path

    def split_edge(
        self, first: Floats, last: Floats, step: float, rotation: float, share: float
    ) -> Pieces:
        """Split an edge into equal pieces of at most ``step`` and ``rotation``.

        ``share`` selects the configuration of each piece: 0.5 its center, 1 its end. Along curves,
        lengths are negative in reverse, and rotations negative to the right.
        """
        change = self.space.steps_between(first, last)
        dim = self.space.dim
        metres = np.linalg.norm(change[:dim])
        radians = np.linalg.norm(change[dim:])
        # As many pieces as the longer of both needs, at least one.
        count = max(math.ceil(max(metres / step, radians / rotation)), 1)
        shares = (np.arange(count) + share) / count
        points = self.space.interpolate(first, last, shares[:, None])
        return Pieces(points, np.full(count, metres / count), np.full(count, radians / count))

    def split_path(self, path: Floats, step: float, rotation: float) -> Pieces:
        """Split each edge into pieces of at most ``step`` and ``rotation``.

        ``step`` is in metres, ``rotation`` in radians. A single configuration is one piece.
        """
        path = self.insert_breakpoints(path)
        if len(path) == 1:
            return Pieces(path, np.zeros(1), np.zeros(1))
        edges = itertools.pairwise(path)
        at_center = 0.5
        pieces = [self.split_edge(*ends, step, rotation, at_center) for ends in edges]
        centers, lengths, rotations = map(np.concatenate, zip(*pieces, strict=True))
        return Pieces(centers, np.abs(lengths), np.abs(rotations))

    def resample(self, path: Floats, step: float | None = None) -> Floats:
        """Add rows to curves, at most a cell and 5 degrees apart.

        With a ``step`` in metres, add rows to all edges, at most that far apart.
        """
        path = self.insert_breakpoints(path)
        cell = 2.0 * self.space.resolution if step is None else step
        at_end = 1.0
        turns = self.space.steps_between(path[:-1], path[1:])[:, self.space.dim :]
        rows = [path[:1]]
        for first, last, turn in zip(path[:-1], path[1:], turns, strict=True):
            if step is not None or turn.any() or isinstance(self.drive, Car):
                points = self.split_edge(first, last, cell, MAX_RADIANS, at_end).points
                rows.append(self.space.rotations.make_canonical(points[:-1]))
            rows.append(last[np.newaxis])
        return np.concatenate(rows)

    def find_directions(self, rows: Floats) -> NDArray[np.int8] | None:
        """Return whether rows (n, 3) go ahead (1), back (-1) or neither.

        None for a holonomic robot; see :attr:`planners.Plan.direction`.
        """
        if self.drive is None:
            return None
        if len(rows) < 2:
            return np.ones(len(rows), dtype=np.int8)
        dx, dy = np.diff(rows[:, :2], axis=0).T
        yaws = rows[1:, 2]
        # The sign of the step along the heading; the first row has that of the second.
        signs = np.sign(dx * np.cos(yaws) + dy * np.sin(yaws)).astype(np.int8)
        return np.concatenate([signs[:1], signs])

    def measure(self, path: Floats) -> tuple[float, float]:
        """Measure ``length`` and ``total_rotation`` of a path, as of :class:`planners.Plan`."""
        path = self.insert_breakpoints(path)
        steps = self.space.steps_between(path[:-1], path[1:])
        lengths, rotations = measure_steps(steps, self.space.dim)
        return math.fsum(lengths), math.fsum(rotations)

    def min_length(self, first: Floats, last: Floats) -> float:
        """Bound weighted lengths of free paths from below."""
        rotation = self.space.steps_between(first, last)[self.space.dim :]
        radians = self.rotation_weight * float(np.linalg.norm(rotation))
        # Share by which rounding may change a length.
        return (1.0 - 1e-12) * (self.space.min_path_length(first, last) + radians)

    def clearance(self, path: Floats) -> float:
        """Bound the clearance along a path from below, as :attr:`planners.Plan.clearance`.

        Each edge is split into pieces of at most half a cell and 5 degrees. All points of a piece
        lie within half its length of its center, and clearance changes by at most the length moved.
        So the clearance at the center minus half the length bounds the piece, in each rotation cell
        within half the piece's rotation.
        """
        if not isinstance(self.space, ConfigurationMap):
            return math.nan
        pieces = self.split_path(path, self.space.resolution, MAX_RADIANS)
        rotations = self.cells.rotations
        max_turns = 0.5 * pieces.rotations + 2.0 * ANGLE_SLACK
        rows, cells = rotations.find_cells_within(pieces.points, max_turns)
        q = pieces.points[rows]
        # Clearance is constant in a rotation cell.
        q[:, self.space.dim :] = rotations.centers[cells]
        bounds = self.cells.clearance(q) - 0.5 * pieces.lengths[rows]
        return max(0.0, float(np.min(bounds)))

    def obstacle_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along a path from below.

        See :attr:`planners.Plan.obstacle_distance`, and for the pieces of curves
        :meth:`cspace.CSpace.path_obstacle_distance`.
        """
        if isinstance(self.drive, Car) and isinstance(self.space, CSpace):
            step = 0.5 * self.space.resolution
            pieces = self.split_path(path, step, step / max(self.cells.robot.shape.span, step))
            # Proven edges keep the margin free, even if a piece has nothing left.
            distances = self.cells.obstacle_distance(*pieces)
            distance = max(self.cells.margin, float(np.min(distances)))
        else:
            distance = self.space.path_obstacle_distance(self.insert_breakpoints(path))
        if math.isnan(distance) or self.are_free(path):
            return distance
        return 0.0

    def may_join(self, exists: bool | None) -> bool:
        """Return False if no proven edges can join start and goal.

        ``exists`` is what :meth:`cspace.Space.path_exists` says. Unless the geometry decides, an
        edge of any drive is proven only if every closed cell that it touches is FREE. The cells of
        the grid that contain a point of the edge form a block in position and rotation, so they are
        joined through sides. Along the edge, the cells change only at points that lie in both the
        old and the new cells. So all cells of a path, start and goal included, belong to one
        component of FREE cells, and ``exists`` is True. No path leaves the grid, even if the
        outside is free. Start and goal lie in the grid, straight edges between such points stay
        there, and curves that leave it are not proven.
        """
        if self.exact:
            return exists is not False
        return exists is True


class TurnDriveTurn(LocalPlanner):
    """Edges of a differential drive: turn, drive straight, turn.

    It turns on the spot, the shorter way, and drives with its x axis ahead. If it reverses, it
    drives backwards when that takes less rotation. Each of the three motions is proven as a
    straight edge; :meth:`insert_breakpoints` gives their endpoints.

    OMPL gets curves with a turning radius of almost zero (:data:`PIVOT_RADIUS_PER_SIDE`). Its
    interpolation stays within 1e-8 of the map's side of the line, and its distance counts metres
    alone.
    """

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space of curves with a tiny turning radius."""
        grid = self.cells.grid
        longest_side = grid.spacing * max(grid.shape)
        return make_curve_states(self.reverses, PIVOT_RADIUS_PER_SIDE * longest_side)

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves both turns and the drive free.

        The drive comes first: it is the longest motion and the likeliest to meet an obstacle. It
        proves turns of zero, too.
        """
        is_free = super().edge_checker()
        choose_yaw = self.choose_yaw

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            """Return True if both turns and the drive are proven free."""
            yaw = choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
            return (
                is_free(x0, y0, yaw, x1, y1, yaw)
                and (yaw == yaw0 or is_free(x0, y0, yaw0, x0, y0, yaw))
                and (yaw == yaw1 or is_free(x1, y1, yaw, x1, y1, yaw1))
            )

        return check

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of both turns and the drive."""
        cost = super().edge_cost(weights)

        def add(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
            """Return the cost of both turns and the drive."""
            yaw = self.choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
            total = cost(x0, y0, yaw, x1, y1, yaw)
            # Most edges have few turns.
            if yaw != yaw0:
                total += cost(x0, y0, yaw0, x0, y0, yaw)
            if yaw != yaw1:
                total += cost(x1, y1, yaw, x1, y1, yaw1)
            return total

        return add

    def edge_length(self, *ends: float) -> float:
        """Return an edge's metres plus half its radians."""
        x0, y0, yaw0, x1, y1, yaw1 = ends
        yaw = self.choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
        turns = _turn_by_way_of(yaw, yaw0, yaw1)
        return math.hypot(x1 - x0, y1 - y0) + METRES_PER_RADIAN * turns

    def choose_yaw(
        self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
    ) -> float:
        """Choose the yaw of a drive, with less rotation; ``yaw0`` for a pure turn."""
        if x0 == x1 and y0 == y1:
            return yaw0
        ahead = wrap_yaw(math.atan2(y1 - y0, x1 - x0))
        if not self.reverses:
            return ahead
        back = wrap_yaw(ahead + math.pi)
        is_less = _turn_by_way_of(back, yaw0, yaw1) < _turn_by_way_of(ahead, yaw0, yaw1)
        return back if is_less else ahead

    def insert_breakpoints(self, path: Floats) -> Floats:
        """Insert the configurations at which turns and drives begin."""
        rows = path.tolist()
        waypoints = rows[:1]
        for first, last in itertools.pairwise(rows):
            yaw = self.choose_yaw(*first, *last)
            drive_start = [*first[:2], yaw]
            drive_end = [*last[:2], yaw]
            # Turns of zero add no row.
            for q in (drive_start, drive_end, last):
                if q != waypoints[-1]:
                    waypoints.append(q)
        return np.array(waypoints).reshape(-1, 3)

    def remove_turns(self, path: Floats) -> Floats:
        """Give waypoints the yaw of arrival, if their edges remain proven free."""
        check = self.edge_checker()
        rows = path.tolist()
        for k in range(1, len(rows) - 1):
            before = rows[k - 1]
            after = rows[k + 1]
            x, y, _ = rows[k]
            arrival = [x, y, self.choose_yaw(*before, *rows[k])]
            if check(*before, *arrival) and check(*arrival, *after):
                rows[k] = arrival
        return np.array(rows).reshape(-1, 3)


def _turn_by_way_of(yaw: float, before: float, after: float) -> float:
    """Return the radians of two turns, to a yaw and on to another."""
    first = math.remainder(yaw - before, math.tau)
    return abs(first) + abs(math.remainder(after - yaw, math.tau))


def wrap_yaw(yaw: float) -> float:
    """Wrap a yaw from (-2 pi, 2 pi) into [-pi, pi)."""
    wrapped_yaw = math.remainder(yaw, math.tau)
    return wrapped_yaw if wrapped_yaw < math.pi else -math.pi

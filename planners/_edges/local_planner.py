"""Local planners: edges between two configurations, by the robot's drive.

A holonomic robot follows the straight edge. The edges of drives are in modules of their own, which
:func:`planners._edges.drives.local_planner` loads.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cspace import FREE, MIXED, CSpace, Rotations, Space
from cspace.inside import (
    ANGLE_SLACK,
    METRES_PER_RADIAN,
    Bools,
    Drive,
    Endpoint,
    Floats,
    Map,
    cells_of,
    map_record,
    measure_steps,
    proofs_of,
    wrap_angles,
)

if TYPE_CHECKING:
    from cspace import TiledCSpace
    from cspace.inside import Geometry
    from planners._edges.integrals import CellCost

Endpoints = tuple[Endpoint, ...]
"""A start and its alternative goals. Only arms have several goals."""

MAX_RADIANS: Final = math.radians(5.0)
"""Largest rotation between rows of a resampled path, and of a piece of a path, radians."""

MAX_TURN: Final = 0.499 * math.tau
"""Largest turn of a joint along an edge, radians; below half a turn, so that rounding does not
decide its direction."""


class Pieces(NamedTuple):
    """Short pieces of a path."""

    points: Floats  # (n, size), a configuration on each piece, by default its center
    lengths: Floats  # (n,), metres of translation along each piece
    rotations: Floats  # (n,), radians of rotation


@dataclass(frozen=True, slots=True)
class LocalPlanner:
    """Straight edges between configurations, with proofs, lengths and costs.

    A class for each drive derives from it, and answers for the drive in searches and trajectories.

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
        Cost of a metre on a map in memory; None for the length.
    """

    space: Space
    drive: Drive | None = None
    bidirectional: bool = False
    weights: CellCost | None = None

    rotation_weight: ClassVar[float] = METRES_PER_RADIAN
    """Metres that a radian of rotation adds to an edge's length."""

    examples: ClassVar[tuple[Drive | None, ...]] = (None,)
    """Drives of this kind, for messages and pages."""

    has_cells: ClassVar[bool] = True
    """Whether the space consists of cells, so that places may have room."""

    has_heading: ClassVar[bool] = False
    """Whether the robot moves along its x axis alone."""

    has_curves: ClassVar[bool] = False
    """Whether edges are curves, on which the robot turns only as it moves.

    A part of such an edge need not be an edge.
    """

    narrow_cost: ClassVar[float] = 1.0
    """Share by which a block of cells costs more where the robot passes at few rotations.

    Searches lose the most time where a chain leads through a gap in which the robot cannot turn.
    """

    max_gap: ClassVar[float] = 0.0
    """Largest distance between the end of an arc and the start of the next one, metres."""

    turns_on_spot: ClassVar[bool] = False
    """Whether a robot that drives turns on the spot to the yaw of each motion."""

    hints: ClassVar[tuple[str, ...]] = ()
    """Changes of the drive that may give a plan a path."""

    @property
    def name(self) -> str:
        """Name of the drive, in messages."""
        return "None"

    @property
    def search(self) -> str:
        """Search of a default plan."""
        return "Grid"

    @property
    def search_by_length(self) -> str:
        """Search of a default plan for the length."""
        return self.search

    @property
    def tree_planner(self) -> Literal["RRT", "RRTConnect"]:
        """Planner of OMPL for default plans."""
        return "RRTConnect"

    @property
    def tries_trees(self) -> bool:
        """Whether a default plan first tries :attr:`tree_planner` for a short time."""
        return bool(self.space.rotations.names)

    @property
    def exact(self) -> bool:
        """Whether more than cells decides edges, such as geometry."""
        return cells_of(self.space) is not self.space

    @property
    def in_memory(self) -> bool:
        """Whether the cells are an array in memory."""
        return isinstance(self.space, CSpace)

    @property
    def worst_state(self) -> int:
        """Largest state of cells that edges may pass."""
        return MIXED if self.exact else FREE

    @property
    def cells(self) -> CSpace:
        """The map in memory, as known, without its geometry."""
        return cast(CSpace, cells_of(self.space))

    @property
    def tiles(self) -> TiledCSpace:
        """The space as a map in tiles, as known."""
        return cast("TiledCSpace", self.space)

    @property
    def has_costs(self) -> bool:
        """Whether an edge may cost more than its length."""
        return self.weights is not None

    @property
    def reverses(self) -> bool:
        """Whether the robot also moves backwards."""
        return True

    @property
    def max_lateral_acceleration(self) -> float | None:
        """Largest acceleration across the way, m/s^2, if the drive has one."""
        return None

    @property
    def metres_per_radian(self) -> float:
        """Metres that turning by a radian costs."""
        return METRES_PER_RADIAN

    @property
    def sample_drive(self) -> Drive | None:
        """A drive of the same kind, for cells of 0.1 m."""
        return self.drive

    @property
    def curve_states(self) -> tuple[bool, float] | None:
        """Whether OMPL's curves reverse, and their radius in metres, if any."""
        return None

    def check_drive(self) -> None:
        """Raise InputError unless the drive fits the cells."""

    def bounded_map(self) -> Map:
        """Return the map for kernels, MIXED outside."""
        map_ = map_record(self.cells)
        return map_._replace(exterior=np.full_like(map_.exterior, MIXED))

    def geometry(self) -> Geometry:
        """Return the geometry for kernels; None unless exact."""
        if not self.exact:
            return None
        geometry: Geometry = proofs_of(self.cells).geometry
        return geometry

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves a configuration free."""
        return self.space.point_checker()

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the edge free."""
        check = self.space.edge_checker()
        return _wrap_arguments(check, self.space.is_periodic)

    def curve_prover(self) -> Callable[..., float] | None:
        """Make ``prove(*q0, *q1)``, the metres of a free curve, otherwise -1.

        None if edges are no curves.
        """
        return None

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
        from planners._edges.integrals import bind_cost, integrate_straight_edge

        size = self.space.size
        weight = self.rotation_weight
        return bind_cost(integrate_straight_edge, self.cells, weights, weight, size)

    def weigh(self) -> Callable[..., float] | None:
        """Make ``cost(*q0, *q1)``; None if the cost is the length."""
        return None if self.weights is None else self.edge_cost(self.weights)

    def cost(self) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the edge."""
        return self.weigh() or self.edge_length

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
        """Return the length of a path with weighted rotations."""
        return float(self.edge_lengths(path[:-1], path[1:]).sum())

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return edges' lengths with weighted rotations, shape (n,)."""
        return self.space.distance(starts, ends)

    def curve_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Bound lengths from below by curves, shape (n,)."""
        return np.zeros(len(starts))

    def edge_length(self, *ends: float) -> float:
        """Return an edge's length, from numbers of both ends."""
        return float(self.space.distance(*np.reshape(ends, (2, -1))))

    def insert_breakpoints(self, path: Floats) -> Floats:
        """Insert configurations at which motions change, or joints turn widely.

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

    def turns_at(self, path: Floats, row: int) -> bool:
        """Return True if a drive turns on the spot at a row."""
        return False

    def split_edge(
        self, first: Floats, last: Floats, step: float, rotation: float, share: float
    ) -> Pieces:
        """Split an edge into equal pieces.

        They have at most ``step``, metres, and ``rotation``, radians. ``share`` selects the
        configuration of each piece: 0.5 its center, 1 its end. Along curves, lengths are negative
        in reverse, and rotations negative to the right.
        """
        change = self.space.steps_between(first, last)
        dim = self.space.dim
        metres = np.linalg.norm(change[:dim])
        radians = np.linalg.norm(change[dim:])
        # The translation or the rotation decides the number of pieces.
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
        """Add rows to curves, every cell and 5 degrees.

        With a ``step`` in metres, add rows to all edges, at most that far apart.
        """
        path = self.insert_breakpoints(path)
        cell = 2.0 * self.space.resolution if step is None else step
        at_end = 1.0
        turns = self.space.steps_between(path[:-1], path[1:])[:, self.space.dim :]
        rows = [path[:1]]
        for first, last, turn in zip(path[:-1], path[1:], turns, strict=True):
            if step is not None or turn.any() or self.has_curves:
                points = self.split_edge(first, last, cell, MAX_RADIANS, at_end).points
                rows.append(self.space.rotations.make_canonical(points[:-1]))
            rows.append(last[np.newaxis])
        return np.concatenate(rows)

    def find_directions(self, rows: Floats) -> NDArray[np.int8] | None:
        """Return whether rows go ahead (1), back (-1) or neither.

        None for a holonomic robot; see :attr:`planners.Plan.direction`.
        """
        return None

    def list_drives(self) -> list[Drive | None]:
        """List the drive, and others to try without a path."""
        return [self.drive]

    def list_chords(self, path: Floats) -> tuple[Floats, float]:
        """Return rows, and a bound of the motion's distance from chords."""
        return self.insert_breakpoints(path), 0.0

    def list_segments(self, path: Floats, rotations: Rotations) -> tuple[Floats, Floats, Floats]:
        """Return the ends, steps and turns of straights and arcs.

        Their shapes are (m + 1, size), (m, size) and (m,). Turns are of the direction of motion,
        radians. It needs no space.
        """
        steps = rotations.steps_between(path[:-1], path[1:])
        return path, steps, np.zeros(len(steps))

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

        See :attr:`planners.Plan.obstacle_distance`.
        """
        distance = self.measure_distance(path)
        if math.isnan(distance) or self.are_free(path):
            return distance
        return 0.0

    def measure_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along a proven path from below."""
        return self.space.path_obstacle_distance(self.insert_breakpoints(path))


class EdgesWithoutCells(LocalPlanner):
    """Edges of a space without cells, such as an arm's or a user's own."""

    has_cells = False
    exact = True

    @property
    def search(self) -> str:
        """The first search of the space, otherwise trees."""
        return next(iter(self.space.searches), self.tree_planner)

    def clearance(self, path: Floats) -> float:
        """Return NaN, because there are no cells to measure from."""
        return math.nan


def _wrap_arguments(
    check: Callable[..., bool], periodic_axes: Sequence[bool]
) -> Callable[..., bool]:
    """Wrap a function to get angles in [-pi, pi).

    Angles of the second configuration are within half a turn of the first.
    """
    if not any(periodic_axes):
        return check

    def check_wrapped(*ends: float) -> bool:
        """Call the function with wrapped angles."""
        q0, q1 = np.reshape(ends, (2, -1))
        first = wrap_angles(q0, periodic_axes)
        steps = zip((q1 - q0).tolist(), periodic_axes, strict=True)
        # Half turns go the same way as along edges, which are proven the shorter way.
        shortest = [math.remainder(step, math.tau) if turns else step for step, turns in steps]
        last = first + shortest
        return check(*first.tolist(), *last.tolist())

    return check_wrapped


def wrap_yaw(yaw: float) -> float:
    """Wrap a yaw from (-2 pi, 2 pi) into [-pi, pi)."""
    wrapped_yaw = math.remainder(yaw, math.tau)
    return wrapped_yaw if wrapped_yaw < math.pi else -math.pi

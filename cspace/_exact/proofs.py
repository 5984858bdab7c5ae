"""Exact queries: map cells answer first, then the boundaries of robot and obstacles.

The plane lies in space at z = 0; its segments are triangles with a repeated corner. In space,
trees of hulls prove that bodies stay apart.
"""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from cspace._bodies import DISTANCE_ROUNDING
from cspace._bodies.box_trees import FIRST_ITEM, find_nearest
from cspace._bodies.hulls import node_corners
from cspace._bodies.motion_proofs import find_proof, winding_number
from cspace._bodies.part_trees import RADIUS, SurfaceTree
from cspace._bodies.parts import as_triangles, part_anchors, sort_by_part
from cspace._bodies.scenes import NO_SURFACE
from cspace._bodies.solids import Part
from cspace._exact.arcs import (
    EdgeArc,
    reference_point,
)
from cspace._exact.boundaries import ObstacleBoundary, Problem, Proofs, obstacle_boundary
from cspace._exact.plane import (
    BoundaryTrees,
    Geometry,
    Scratch,
    make_scratch,
    path_slack,
    prove_arc,
)
from cspace._exact.rigid import (
    Bodies,
    BoundaryPart,
    RigidScratch,
    make_bodies,
    make_part,
    make_rigid_scratch,
    rigid_arc_is_free,
    rigid_slack,
)
from cspace._exact.segment_proofs import build_trees
from cspace._grid import MAX_COORDINATE
from cspace._queries.batches import as_contiguous
from cspace._queries.edges import edges_are_free
from cspace._queries.points import (
    classify,
    configuration_in,
    is_usable,
)
from cspace._record.cells import Map, hide_cells
from cspace._rotations.lookup import (
    arc_angle_and_error,
    arc_count,
    matrix_rows,
)
from cspace._shapes import Box, ExactShape, RoundedSimplices
from cspace._support.addresses import Address
from cspace._support.arrays import (
    BLOCKED,
    FREE,
    MIXED,
    Bools,
    Floats,
    Ints,
    Numbers,
    Row,
    States,
    frozen,
)
from cspace._support.compiling import internal, kernel
from cspace._support.records import keep
from cspace._support.threads import run_in_chunks
from cspace._support.vectors import Matrix, apply_pose, minus, rotate_back, row_at
from cspace.errors import InputError


class ExactQueries:
    """Queries of a map with exact geometry.

    Cells answer if they decide, and proofs decide the rest.

    Parameters
    ----------
    make_problem : callable
        Returns the map and the geometry as they are now.
    find_proofs : callable
        Returns proofs of their own, or None: then boundaries of robot and obstacles prove.
    """

    def __init__(
        self, make_problem: Callable[[], Problem], find_proofs: Callable[[], Proofs | None]
    ) -> None:
        """Remember how to make proofs at the first query."""
        self._make_problem = make_problem
        self._find_proofs = find_proofs
        self._proofs: Proofs | None = None
        self._lock = threading.RLock()

    def write_states(self, map_: Map, q: Floats, out: States) -> int:
        """Write the states of configurations, shape (n, size), to ``out``, shape (n,).

        Returns the index of the first invalid one, or -1.
        """
        proofs = self.current_proofs()
        bad = classify(map_, q, out)
        undecided = np.flatnonzero(out == MIXED)
        if bad < 0 and len(undecided):
            # A configuration is an edge with equal endpoints.
            ends = q[undecided]
            out[undecided[proofs.are_free(ends, ends)]] = FREE
        return bad

    def write_edges(self, map_: Map, blocks: Map, q0: Floats, q1: Floats, out: Bools) -> int:
        """Write whether edges, shapes (n, size), are free to ``out``, shape (n,).

        Edges rotate along the shorter arc. Returns the index of the first invalid edge, or -1.
        """
        proofs = self.current_proofs()
        bad = edges_are_free(map_, blocks, q0, q1, out)
        undecided = np.flatnonzero(~out)
        if bad < 0 and len(undecided):
            out[undecided] = proofs.are_free(q0[undecided], q1[undecided])
        return bad

    def distance(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Bound the obstacle distance from below, metres.

        The bound holds along a free path. The path is given in pieces: their midpoints, shape (n,
        size), in metres and radians, and the length and rotation angle of each, shape (n,). From
        its midpoint, a piece extends by half its length and half its angle. A blocked exterior
        counts as an obstacle. The bound is infinite if there are no obstacles.
        """
        slack = self.current_proofs().slack(as_contiguous(points), lengths, angles)
        return self._make_problem().sure_distance + slack

    def refine(self, look_up: Callable[..., int], repeats: int) -> Callable[..., int]:
        """Make a look-up that asks the geometry if another look-up, by cells, gives MIXED.

        Its numbers are an edge after so many ``repeats``: 1 if they are both ends of one, and 2 if
        they are a configuration, which is an edge without length.
        """
        self.current_proofs()  # made now, not at the first call

        def decide(numbers: tuple[float, ...]) -> int:
            """Return the state, FREE if cells or the geometry prove that."""
            state = look_up(numbers)
            if state == MIXED and self.current_proofs().edge(*repeats * numbers):
                return FREE
            return state

        return decide

    def drop(self) -> None:
        """Drop the proofs, because obstacles change.

        Existing checkers use new ones from their next call on.
        """
        with self._lock:
            self._proofs = None

    def current_proofs(self) -> Proofs:
        """Return the proofs for the current obstacles, made at the first call."""
        proofs = self._proofs
        if proofs is None:
            with self._lock:
                # Another thread may have made them while this one waited.
                if self._proofs is None:
                    self._proofs = self._find_proofs() or make_boundary_proofs(self._make_problem())
                proofs = self._proofs
        return proofs


class Containment(NamedTuple):
    """Robot and obstacles as solids, for containment tests.

    If a connected part does not meet the other boundary, it lies entirely inside or entirely
    outside the other solid, so that a single point of it decides. For a part of the robot, any of
    its corners decides.

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 4)
        Corners of the robot, sorted by part, each with the index of the first corner of the next
        part.
    exterior_blocked : bool
        True if everything outside the grid is an obstacle; otherwise nothing outside is.
    lower, spacing : tuple of float, float
        Lower corner of the grid and side of its cells, metres.
    outer, inner : ndarray of bool, shape (nx, ny, nz)
        Cells that meet obstacles, and cells inside obstacles; nz is 1 in the plane.
    anchors : ndarray of float64, shape (m, 3)
        One point of each obstacle part that could fit into the robot, sorted by x.
    reach : float
        Largest distance of the robot's corners from its reference point. Boundaries are apart by
        more than rounding, so anchors inside the robot are nearer.
    low, high : tuple of float
        Corners of the bounding box of the robot.
    is_box : bool
        True if the robot fills its bounding box.
    has_solids : bool
        True if some obstacles have an inside that their cells do not decide.
    surfaces : SurfaceTree
        Closed surfaces of a robot in space that is not convex; else none.
    """

    corners: Floats
    exterior_blocked: bool
    lower: Row
    spacing: float
    outer: Bools
    inner: Bools
    anchors: Floats
    reach: float
    low: Row
    high: Row
    is_box: bool
    has_solids: bool
    surfaces: SurfaceTree


class ProofInputs(NamedTuple):
    """Inputs of every edge proof beside the map: the boundaries or bodies, and the solids."""

    boundaries: Any
    containment: Containment


class Closest(NamedTuple):
    """The obstacle nearest to a robot, and the way from it.

    Attributes
    ----------
    distance : float
        As :meth:`CSpace.obstacle_distance`: a lower bound, metres, and zero if the configuration is
        not proven free.
    points : ndarray of float64, shape (2, 2) or (2, 3)
        Nearest points of robot and obstacle, metres, within rounding; on a floor in space.
    gradient : ndarray of float64, shape (dim + k,)
        Change of the distance by the configuration: the unit vector from the obstacle to the robot,
        without its height on a floor; then metres per radian, by the yaw, or by k = 3 turns about
        the axes of the map. Zero in a collision, and if the points are equal.
    """

    distance: float
    points: Floats
    gradient: Floats


class BoundaryProofs(ABC):
    """Proofs for one robot among the obstacles of one workspace."""

    def __init__(self, problem: Problem) -> None:
        """Build the trees and the containment tests for a robot among obstacles."""
        self._robot = problem.robot.shape.outer
        self._size = problem.size
        self._rotations = problem.rotations
        self._dim = problem.map.dim
        grid = problem.workspace.grid
        self._lift = problem.lift
        # Part of the margin that a free configuration may lack.
        self._unsure = problem.margin - problem.sure_distance
        self._margin = problem.margin
        self._on_floor = problem.floor is not None
        self._bounds = (np.asarray(grid.lower), np.asarray(grid.upper))
        walls = obstacle_boundary(
            problem.workspace,
            exterior_blocked=problem.exterior_blocked,
            on_floor=self._on_floor,
        )
        # Balls and points need no containment test, because the distance from their center decides.
        self._shapes = []
        for obstacle, pieces in zip(problem.workspace.shapes or (), walls.pieces, strict=False):
            has_faces = pieces.simplices.shape[1] == grid.dim
            if obstacle.outer.encloses and has_faces:
                self._shapes.append(obstacle.outer)
        # On a floor, the robot is lifted, so that the plane at z = 0 is that of its positions.
        boundary = as_triangles([self._robot.boundary()])
        boundary = boundary._replace(simplices=boundary.simplices + self._lift)
        self.boundaries = self._build(problem, boundary, walls)
        containment = self._make_containment(problem, boundary, walls.pieces)
        self._map = problem.map
        self._inputs = keep(ProofInputs(self.boundaries, containment))
        # Configurations whose anchors, of robot and obstacles, are tested at once.
        anchors_per_configuration = len(self._anchors) + len(containment.anchors)
        # Largest number of anchors tested for containment at once.
        self._batch_size = 1 + 1_000_000 // (1 + anchors_per_configuration)

    @abstractmethod
    def _build(self, problem: Problem, robot: RoundedSimplices, walls: ObstacleBoundary) -> Any:
        """Build the trees of the robot, whose boundary is given, the obstacles and the walls."""

    @abstractmethod
    def _make_scratch(self) -> Any:
        """Allocate scratch memory for one thread."""

    @cached_property
    def _spare_scratch(self) -> list[Any]:
        """Scratch memory that no thread uses now."""
        return []

    def _take_scratch(self) -> Any:
        """Return scratch memory for one call."""
        with suppress(IndexError):
            return self._spare_scratch.pop()
        return self._make_scratch()

    def _find_surfaces(self) -> SurfaceTree:
        """Return the closed surfaces of the robot in which anchors are sought first."""
        return NO_SURFACE

    @abstractmethod
    def _write_states(
        self, map_: Map, required: float, q0: Floats, q1: Floats, out: States
    ) -> None:
        """Write the states of edges, shapes (n, size), to ``out``; see `edge_state`."""

    @abstractmethod
    def _bound_slack(
        self, required: float, positions: Floats, matrices: Floats, spans: Floats
    ) -> tuple[float, list[tuple[Floats, float]]]:
        """Bound (distance - required distance) along a path; see `path_slack`.

        Also returns the corners (n, 3) and radii of two hulls, in the frames of robot and
        obstacles, that set the last bound; there are none without obstacles.
        """

    def _make_containment(
        self, problem: Problem, boundary: RoundedSimplices, pieces: Sequence[RoundedSimplices]
    ) -> Containment:
        """Collect the points that containment tests need.

        ``boundary`` is that of the robot, as triangles in space; ``pieces`` are those of obstacles.
        """
        workspace = problem.workspace
        grid = workspace.grid
        robot = self._robot
        missing_axis = (0, 3 - grid.dim)  # padding of plane corners to space
        # The robot's corners by part; the first of each part is an anchor of the robot.
        corners, starts = sort_by_part(boundary)
        stops = np.append(starts[1:], len(corners))
        self._anchors = corners[starts]
        stop_of_corners = np.repeat(stops, stops - starts)
        reach = float(np.linalg.norm(corners, axis=1).max())
        anchors = [np.empty((0, 3))]
        # A robot of balls needs no anchors either. Only parts no larger than the robot can lie
        # inside it.
        is_balls = (boundary.simplices == boundary.simplices[:, :1]).all()
        if robot.encloses and not is_balls:
            for part in pieces:
                points, sizes = part_anchors(as_triangles([part]))
                anchors.append(points[sizes <= 2.0 * reach])
        points = np.concatenate(anchors)
        low, high = (np.pad(corner, missing_axis) + self._lift for corner in robot.bounds)
        # Without shapes, the obstacles are exactly the outer cells.
        outer = workspace.outer
        inner = workspace.inner if workspace.shapes else outer
        lower = np.pad(grid.lower, missing_axis)
        if problem.floor is not None:
            # A robot that keeps its heights touches no ceiling or ground of the grid.
            layers = (0, 0), (0, 0), (1, 1)
            outer, inner = (frozen(np.pad(cells, layers)) for cells in (outer, inner))
            lower[2] -= grid.spacing
        shape_in_space = outer.shape if grid.dim == 3 else (*grid.shape, 1)
        return Containment(
            corners=np.column_stack([corners, stop_of_corners]),
            exterior_blocked=problem.exterior_blocked,
            lower=tuple(lower.tolist()),
            spacing=grid.spacing,
            outer=outer.reshape(shape_in_space),
            inner=inner.reshape(shape_in_space),
            anchors=points[np.argsort(points[:, 0])],
            reach=reach,
            low=tuple(low.tolist()),
            high=tuple(high.tolist()),
            is_box=robot.encloses and _lies_on_sides(boundary, low, high, robot.dim),
            has_solids=bool(self._shapes),
            surfaces=self._find_surfaces(),
        )

    def edge(self, *ends: float) -> bool:
        """Return True if an edge is proven free.

        ``ends`` are the coordinates of both configurations.
        """
        q0, q1 = np.array(ends, dtype=np.float64).reshape(2, 1, self._size)
        states = np.empty(1, dtype=np.uint8)
        self._write_states(self._map, self.boundaries.required, q0, q1, states)
        state = int(states[0])
        return state == FREE or (state == MIXED and not self._are_nested(q0)[0])

    def are_free(self, q0: Floats, q1: Floats, growth: float = 0.0) -> Bools:
        """Return whether edges, shapes (n, size), are proven free.

        The robot is grown by ``growth``, metres, of which cells prove nothing.
        """
        boundaries = self.boundaries
        required = boundaries.required + boundaries.scale * growth
        map_ = hide_cells(self._map) if growth > 0.0 else self._map
        states = np.empty(len(q0), dtype=np.uint8)

        def prove_chunk(start: int, stop: int) -> int:
            """Write the states of some edges; -1 means that none is invalid."""
            chunk = slice(start, stop)
            self._write_states(map_, required, q0[chunk], q1[chunk], states[chunk])
            return -1

        # Edges below which a second thread costs more than it saves.
        run_in_chunks(prove_chunk, len(q0), 500)
        is_free: Bools = states == FREE
        # Along a MIXED edge no boundaries meet, so containment at its first end decides.
        undecided = np.flatnonzero(states == MIXED)
        if len(undecided):
            batches = np.array_split(q0[undecided], 1 + len(undecided) // self._batch_size)
            is_free[undecided] = ~np.concatenate([self._are_nested(batch) for batch in batches])
        return is_free

    def bound_growth(self, radii: Floats) -> float:
        """Bound how far errors of coordinates, shape (k,), move points of the robot, metres."""
        lever = float(self.boundaries.max_lever / self.boundaries.scale)
        moved = math.hypot(*radii[: self._dim]) + lever * float(radii[self._dim :].sum())
        # Share by which the growth for errors is rounded up.
        return (1.0 + 1e-9) * moved

    def is_outside(self, *q: float) -> bool:
        """Return True if neither solid contains the other.

        No boundaries may meet there.
        """
        row = np.array([q])
        positions, matrices = self._place_robot(row)
        position = cast(Row, tuple(positions[0].tolist()))
        matrix = cast(Matrix, tuple(map(tuple, matrices[0].tolist())))
        state = corner_state(self._inputs.containment, position, matrix)
        return state != BLOCKED and not self._are_nested(row)[0]

    def slack(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Return a path's lower bound of (distance - required distance), metres.

        On a floor, the required distance is taken without what the margin asks for above and below.
        The path is given in pieces: their midpoints, shape (n, size), their lengths and their
        rotation angles, shape (n,).
        """
        boundaries = self.boundaries
        required = boundaries.required - boundaries.scale * self._unsure
        positions, matrices = self._place_robot(points)
        # Largest displacement of a point of the robot from its place at the midpoint.
        spans = 0.5 * (lengths + boundaries.max_lever / boundaries.scale * angles)
        slack, _ = self._bound_slack(required, positions, matrices, spans)
        return float(slack)

    def find_closest(self, q: Floats, distance: float) -> Closest:
        """Find the nearest points at a configuration, shape (size,), with this distance.

        Raises InputError if there are no obstacles.
        """
        boundaries = self.boundaries
        positions, matrices = self._place_robot(q[np.newaxis])
        # Without the margin, the search does not end at a pair of triangles within it.
        required = boundaries.required - boundaries.scale * self._margin
        slack, nearest = self._bound_slack(required, positions, matrices, np.zeros(1))
        if not nearest:
            raise InputError("obstacles", "are none", "there is nothing to touch")
        (robot, radius), (obstacle, obstacle_radius) = nearest
        placed = robot @ matrices[0].T + positions[0]
        points = find_nearest(placed, obstacle, radius, obstacle_radius)
        away = points[0] - points[1]
        away /= max(float(np.linalg.norm(away)), np.finfo(float).tiny)
        turns = np.cross(points[0] - positions[0], away)
        first_axis = {(): 3, ("yaw",): 2}.get(self._rotations.names, 0)
        gradient = np.concatenate([away[: self._dim], turns[first_axis:]])
        # In a collision, the nearest points of the boundaries do not tell the way out.
        if slack <= 0.0 or not self.is_outside(*q.tolist()):
            gradient[:] = 0.0
        return Closest(distance, points if self._on_floor else points[:, : self._dim], gradient)

    def _place_robot(self, points: Floats) -> tuple[Floats, Floats]:
        """Return reference points (n, 3) and rotation matrices (n, 3, 3).

        ``points`` are configurations, shape (n, size). The plane lies at z = 0.
        """
        positions = np.zeros((len(points), 3))
        matrices = np.zeros((len(points), 3, 3))
        positions[:, : self._dim] = points[:, : self._dim]
        matrices[:, 2, 2] = 1.0
        matrices[:, : self._dim, : self._dim] = self._rotations.make_matrices(
            points[:, self._dim :], self._dim
        )
        return positions, matrices

    def _are_nested(self, q: Floats) -> Bools:
        """Return whether robot or obstacles contain a part of each other (n,).

        ``q``, shape (n, size), are configurations at which no boundaries meet, so that one point of
        each part, its anchor, decides.
        """
        positions, matrices = self._place_robot(q)
        # Points of the robot in the world, shape (n, robot anchors, 3).
        robot_points = self._anchors @ matrices.swapaxes(1, 2) + positions[:, None]
        dim = self._robot.dim
        rows, offsets = self._near_anchors(positions)
        # Points of obstacles in the robot's frame, shape (pairs, 1, 3).
        obstacle_points = (offsets[:, None] @ matrices[rows] - self._lift)[..., :dim]
        is_nested = np.zeros(len(q), dtype=np.bool_)
        is_nested[rows[_contain_any(self._robot, self._robot.bounds, obstacle_points)]] = True
        for shape in self._shapes:
            # Obstacles end at the bounds of the grid.
            is_nested |= _contain_any(shape, self._bounds, robot_points[..., :dim])
        return is_nested

    def _near_anchors(self, positions: Floats) -> tuple[Ints, Floats]:
        """Return pairs of positions, shape (n, 3), and anchors of obstacles in reach.

        A pair has the row of its position, shape (pairs,), and the vector to its anchor, shape
        (pairs, 3).
        """
        containment = self._inputs.containment
        anchors = containment.anchors
        x = positions[:, 0]
        starts = np.searchsorted(anchors[:, 0], x - containment.reach)
        counts = np.searchsorted(anchors[:, 0], x + containment.reach, side="right") - starts
        rows = np.repeat(np.arange(len(x)), counts)
        before = np.cumsum(counts) - counts
        indices = np.arange(len(rows)) + np.repeat(starts - before, counts)
        is_near = np.abs(anchors[indices, 1] - positions[rows, 1]) <= containment.reach
        rows = rows[is_near]
        return rows, anchors[indices[is_near]] - positions[rows]


class PlaneProofs(BoundaryProofs):
    """Proofs by the segments of boundaries in the plane.

    Trees of hulls would take three times as long there, because most of the time goes by before
    the first two hulls are tested.
    """

    boundaries: BoundaryTrees

    @property
    def geometry(self) -> Geometry:
        """The boundaries with new scratch memory, for :func:`poses_are_free`."""
        return self.boundaries, make_scratch().node_pairs

    def _build(
        self, problem: Problem, robot: RoundedSimplices, walls: ObstacleBoundary
    ) -> BoundaryTrees:
        """Build trees, scaled to coordinates of about one."""
        max_coordinate, max_lever, required = _bound_proofs(problem, robot, walls)
        # A power of two scales without rounding.
        _, exponent = math.frexp(max_coordinate)
        scale = 2.0**-exponent
        scaled = [
            RoundedSimplices(scale * part.simplices, scale * part.radii)
            for part in map(as_triangles, ([robot], walls.pieces, _list_walls(problem)))
        ]
        trees, roots = build_trees(scaled, problem.rotations._about_z)
        robot_root, obstacle_root, wall_root = roots
        boundaries = BoundaryTrees(
            trees=trees,
            robot=robot_root,
            others=(wall_root, obstacle_root),
            max_lever=scale * max_lever,
            scale=scale,
            required=scale * required,
        )
        return keep(boundaries)

    def _write_states(
        self, map_: Map, required: float, q0: Floats, q1: Floats, out: States
    ) -> None:
        """Write the states of edges."""
        scratch = self._take_scratch()
        prove_edges(map_, self._inputs, required, scratch, None, None, q0, q1, out)
        self._spare_scratch.append(scratch)

    def _make_scratch(self) -> Scratch:
        """Allocate scratch memory for one thread."""
        return make_scratch()

    def _bound_slack(
        self, required: float, positions: Floats, matrices: Floats, spans: Floats
    ) -> tuple[float, list[tuple[Floats, float]]]:
        """Bound the slack along a path, and find the nearest segments."""
        scale, trees = self.boundaries.scale, self.boundaries.trees
        scratch = self._take_scratch()
        pairs = scratch.node_pairs
        pairs[0] = -1
        path = scale * positions, matrices, scale * spans
        slack = path_slack(self.boundaries, required, *path, pairs)
        found = (
            [] if pairs[0, 0] < 0 else trees.triangles[trees.spans[pairs[0], FIRST_ITEM]] / scale
        )
        self._spare_scratch.append(scratch)
        nearest = [(row[:RADIUS].reshape(3, 3), float(row[RADIUS])) for row in found]
        return float(slack) / scale, nearest


class SolidProofs(BoundaryProofs):
    """Proofs by trees of hulls in space."""

    boundaries: Bodies

    @cached_property
    def _part(self) -> Part:
        """The robot, lifted to the floor."""
        pose = np.eye(4)
        pose[:3, 3] = self._lift
        return Part(self._robot, pose)

    def _build(self, problem: Problem, robot: RoundedSimplices, walls: ObstacleBoundary) -> Bodies:
        """Build the scene of robot, obstacles and walls."""
        max_coordinate, max_lever, required = _bound_proofs(problem, robot, walls)
        parts = [
            make_part(obstacle.outer, pieces, is_whole)
            for obstacle, pieces, is_whole in zip(
                problem.workspace.obstacles, walls.pieces, walls.are_whole, strict=True
            )
        ]
        # Each triangle of the walls is a part, because their hull holds the whole grid.
        parts += [
            BoundaryPart(
                self._robot, np.eye(4), RoundedSimplices(triangle[np.newaxis], np.zeros(1))
            )
            for wall in _list_walls(problem)
            for triangle in wall.simplices
        ]
        return make_bodies(self._part, parts, max_coordinate, max_lever, required)

    def _find_surfaces(self) -> SurfaceTree:
        """Return the surfaces of a robot of several hulls, lifted."""
        part = self._part
        return NO_SURFACE if len(part.hulls.nodes) == 1 else part.surface_tree

    def _make_scratch(self) -> RigidScratch:
        """Allocate scratch memory for one thread."""
        return make_rigid_scratch(self.boundaries)

    @cached_property
    def _prove(self) -> Address:
        """Address of the compiled proof."""
        return find_proof(self.boundaries.scene)

    def _write_states(
        self, map_: Map, required: float, q0: Floats, q1: Floats, out: States
    ) -> None:
        """Write the states of edges."""
        scratch = self._take_scratch()
        prove_edges(map_, self._inputs, required, None, self._prove, scratch, q0, q1, out)
        self._spare_scratch.append(scratch)

    def _bound_slack(
        self, required: float, positions: Floats, matrices: Floats, spans: Floats
    ) -> tuple[float, list[tuple[Floats, float]]]:
        """Bound the slack along a path, and find the nearest hulls."""
        scratch = self._take_scratch()
        slack = rigid_slack(required, positions, matrices, spans, scratch)
        hulls = self.boundaries.scene.solids.hulls
        nodes = scratch.memory.nodes[0].tolist()
        nearest = [node_corners(hulls, node) for node in nodes if nodes[0] >= 0]
        self._spare_scratch.append(scratch)
        return float(slack), nearest


def make_boundary_proofs(problem: Problem) -> BoundaryProofs:
    """Make the proofs of a robot in the plane or in space."""
    return PlaneProofs(problem) if problem.workspace.grid.dim == 2 else SolidProofs(problem)


def _bound_proofs(
    problem: Problem, robot: RoundedSimplices, walls: ObstacleBoundary
) -> tuple[float, float, float]:
    """Return the largest coordinate, the longest lever, and the required distance, metres.

    The lever is a distance from the reference point, or from the z axis if the robot turns about z
    alone. ``robot`` is its boundary.
    """
    sizes = [
        np.abs(part.simplices).max() + part.radii.max() for part in walls.pieces if len(part.radii)
    ]
    max_coordinate = problem.max_coordinate + float(max(sizes, default=0.0))
    dims_across_axis = 2 if problem.rotations._about_z else 3
    levers = np.linalg.norm(robot.simplices[..., :dims_across_axis], axis=-1)
    required = problem.required_distance + walls.error + DISTANCE_ROUNDING * max_coordinate
    return max_coordinate, float(levers.max()), required


def _list_walls(problem: Problem) -> list[RoundedSimplices]:
    """Return the sides of the grid, if the exterior is blocked."""
    if not problem.exterior_blocked:
        return []
    grid = problem.workspace.grid
    if grid.dim == 2:
        (x0, y0), (x1, y1) = grid.lower, grid.upper
        corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        segments = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        return [RoundedSimplices(segments, np.zeros(4))]
    sides = np.subtract(grid.upper, grid.lower)
    center = np.add(grid.lower, grid.upper) / 2.0
    if problem.floor is not None:
        sides[2] += 2.0 * sides[:2].max()  # so that neither ground nor ceiling is nearest
    return [Box.of(sides, center).boundary()]


def _lies_on_sides(boundary: RoundedSimplices, low: Floats, high: Floats, dim: int) -> bool:
    """Return whether each simplex of a boundary lies in a side of a box."""
    corners = boundary.simplices[..., :dim]
    is_on_side = [(corners == side[:dim]).all(axis=1).any(axis=1) for side in (low, high)]
    return bool(np.logical_or(*is_on_side).all() and not boundary.radii.any())


def _contain_any(shape: ExactShape, bounds: tuple[Floats, Floats], points: Floats) -> Bools:
    """Return whether a shape contains any of the points in its bounds.

    The points have shape (n, m, d), the result (n,).
    """
    low, high = bounds
    is_inside: Bools = np.asarray(((low <= points) & (points <= high)).all(axis=2))
    # Most points are outside the bounds, which takes no time to find.
    if is_inside.any():
        is_inside[is_inside] = shape.contains(points[is_inside])
    return np.asarray(is_inside.any(axis=1))


@kernel
def prove_edges(
    map_: Map,
    inputs: ProofInputs,
    required: float,
    plane: Scratch | None,
    prove: Address | None,
    solid: RigidScratch | None,
    first: Floats,
    second: Floats,
    out: States,
) -> None:
    """Write the states of edges; see `edge_state`.

    Edges lead from ``first`` to ``second``, shape (n, size); ``out`` has shape (n,).
    """
    for k in range(first.shape[0]):
        p0, r0 = configuration_in(map_, first, k)
        p1, r1 = configuration_in(map_, second, k)
        out[k] = edge_state(map_, inputs, required, plane, prove, solid, p0, r0, p1, r1)


@internal
def edge_state(
    map_: Map,
    inputs: ProofInputs,
    required: float,
    plane: Scratch | None,
    prove: Address | None,
    solid: RigidScratch | None,
    p0: Row,
    r0: Numbers,
    p1: Row,
    r1: Numbers,
) -> int:
    """Return FREE for a proven edge, and BLOCKED for an unproven one.

    The edge leads from position p0 and rotation r0 to p1 and r1. MIXED means that no boundaries
    meet along the edge: it is free if neither robot nor obstacles contain the other at the first
    endpoint. An edge with equal endpoints is a point. If two arcs are equally long up to rounding,
    both must be proven.
    """
    boundaries = inputs.boundaries
    if not (is_usable(p0, r0) and is_usable(p1, r1)):
        return BLOCKED
    # Rounding grows with the coordinates; a plane map has no first axis.
    coordinates = 0.0
    for axis in range(3 - map_.dim, 3):
        length = abs(p0[axis]) + abs(p1[axis])
        # The negated comparison refuses NaN too.
        if not length <= 2.0 * MAX_COORDINATE * map_.spacing:
            return BLOCKED
        coordinates += length
    # Hulls take longest to tell that a point of an obstacle is inside the robot.
    if solid is not None and contains_anchor(map_, inputs, p0, r0, p1, r1, solid.memory.nodes):
        return BLOCKED
    if plane is not None:  # in space, the proof adds it
        required += 2.0 * DISTANCE_ROUNDING * boundaries.scale * coordinates
        plane.measured[0] = 0
    for number in range(arc_count(r0, r1)):
        angle, error = arc_angle_and_error(r0, r1, number)
        enough = required + error * boundaries.max_lever
        arc = EdgeArc(p0, r0, p1, r1, number, angle, error, enough)
        if not arc_is_free(map_, boundaries, plane, prove, solid, arc):
            return BLOCKED
    # The cells alone prove the edge.
    if plane is not None and plane.measured[0] == 0:
        return FREE
    # While no boundaries meet, containment cannot change, so one test is enough.
    place = reference_point(map_, p0, 1.0)
    matrix = matrix_rows(r0)
    state = corner_state(inputs.containment, place, matrix)
    first = first_anchor(inputs.containment, place)
    near, _ = find_near_anchor(inputs.containment, place, matrix, first)
    if state == FREE and near >= 0:
        return BLOCKED if inputs.containment.is_box else MIXED
    return state


@internal
def arc_is_free(
    map_: Map,
    boundaries: Any,
    plane: Scratch | None,
    prove: Address | None,
    solid: RigidScratch | None,
    arc: EdgeArc,
) -> bool:
    """Return True if an arc is proven free; see `edge_state`."""
    # Numba leaves out a branch whose scratch memory is None.
    if plane is not None:
        return prove_arc(map_, boundaries, arc, plane)
    if prove is not None and solid is not None:
        return rigid_arc_is_free(map_, prove, arc, solid)
    return False


@kernel
def corner_state(containment: Containment, position: Row, matrix: Matrix) -> int:
    """Test by cells whether obstacles contain a part of the robot.

    Returns BLOCKED if they do, MIXED if that is undecided, otherwise FREE. No boundaries may meet,
    so that any corner of a part decides for the whole part.
    """
    spacing = containment.spacing
    state = FREE
    k = 0
    nx, ny, nz = containment.outer.shape
    while k < len(containment.corners):
        # A row has a corner, and the index of the first corner of the next part.
        corner = containment.corners[k]
        posed_corner = apply_pose(matrix, position, row_at(corner, 0))
        x, y, z = minus(posed_corner, containment.lower)
        i, j, m = math.floor(x / spacing), math.floor(y / spacing), math.floor(z / spacing)
        next_part = int(corner[3])
        if not (0 <= i < nx and 0 <= j < ny and 0 <= m < nz):
            if containment.exterior_blocked:
                return BLOCKED
            k = next_part
        elif containment.inner[i, j, m]:
            return BLOCKED
        elif not containment.outer[i, j, m]:
            k = next_part
        else:
            # This cell decides nothing, so try the next corner of the part.
            k += 1
            all_corners_undecided = k == next_part
            if all_corners_undecided and containment.has_solids:
                state = MIXED
    return state


@internal
def find_near_anchor(
    containment: Containment, position: Row, matrix: Matrix, first: int
) -> tuple[int, Row]:
    """Find an obstacle anchor in the robot's bounding box, from the anchor ``first`` on.

    Returns its index, -1 if there is none, and the anchor in the frame of the robot.
    """
    low = containment.low
    high = containment.high
    farthest = position[0] + containment.reach
    for k in range(first, len(containment.anchors)):
        if containment.anchors[k, 0] > farthest:
            break
        offset = minus(row_at(containment.anchors[k], 0), position)
        x, y, z = rotate_back(matrix, offset)
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            return k, (x, y, z)
    return -1, position


@internal
def first_anchor(containment: Containment, position: Row) -> int:
    """Return the index of the first anchor in reach of a position along x."""
    return int(np.searchsorted(containment.anchors[:, 0], position[0] - containment.reach))


@internal
def contains_anchor(
    map_: Map, inputs: ProofInputs, p0: Row, r0: Numbers, p1: Row, r1: Numbers, nodes: Ints
) -> bool:
    """Return True if an obstacle anchor lies inside the robot's surfaces at an end of an edge.

    This holds up to rounding. ``nodes`` is scratch, shape (MAX_PENDING_PAIRS, 2).
    """
    containment = inputs.containment
    if len(containment.surfaces.boxes) == 0:
        return False
    for p, r in ((p0, r0), (p1, r1)):
        position = reference_point(map_, p, 1.0)
        matrix = matrix_rows(r)
        first = first_anchor(containment, position)
        k, anchor = find_near_anchor(containment, position, matrix, first)
        while k >= 0:
            if winding_number(containment.surfaces, 0, anchor, nodes) != 0:
                return True
            k, anchor = find_near_anchor(containment, position, matrix, k + 1)
    return False

"""Exact queries: map cells answer first, then the boundaries of robot and obstacles.

The plane lies in space at z = 0; its segments are triangles with a repeated corner.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, Matrix, Numbers, Row, States
from cspace.compiling import kernel
from cspace.exact import ADVANCE_FACTOR, DISTANCE_ROUNDING, MAX_DISTANCES_PER_EDGE, MIN_ADVANCE
from cspace.exact.boundaries import Problem, Proofs, as_triangles, connected_parts, obstacle_boundary, part_anchors
from cspace.exact.triangles import MAX_PENDING_PAIRS, Motion, Trees, build_trees, free_fraction, place_box
from cspace.grid import MAX_COORDINATE
from cspace.kernels import apply_pose, dot, minus, rotate_back, row_at
from cspace.map.batches import as_contiguous
from cspace.map.callbacks import MAX_SIZE, bind_kernel, position_before, rotation_before
from cspace.map.edges import edge_is_free, edges_are_free, position_along
from cspace.map.points import classify, is_usable, position_in, state_at
from cspace.map.record import Map
from cspace.rotations.lookup import arc_angle_and_error, arc_count, matrix_rows, rotation_along, rotation_in
from cspace.shapes import Box, RoundedSimplices
from cspace.threads import in_chunks

MAX_MOTION_CELLS: Final = 2.0
"""Longest part of an edge that one distance query tries to prove, in cells; longer parts make the tree search slow."""


GOLDEN_RATIO: Final = 0.618
"""Inverse of the golden ratio; the fractional parts of its multiples fill [0, 1) evenly."""


MAX_PENDING_PARTS: Final = 1024
"""Capacity of the queue of unproven parts of an edge."""


ANCHORS_PER_BATCH: Final = 100_000
"""Approximate number of anchors tested for containment at once."""


MIN_PROOFS_PER_THREAD: Final = 500
"""Edges below which a second thread costs more than it saves."""


class ExactQueries:
    """Queries of a map with exact geometry.

    Cells answer if they decide, and proofs decide the rest.
    """

    def __init__(self, make_problem: Callable[[], Problem]) -> None:
        self._make_problem = make_problem
        self._proofs: Proofs | None = None
        self._lock = threading.RLock()

    def points(self, map_: Map, q: Floats, out: Bools) -> int:
        """Fill ``out`` with whether points, shape (n, size), are free.

        Returns the index of the first invalid point, or -1.
        """
        proofs, states = self._current_proofs(), np.empty(len(q), dtype=np.uint8)
        bad = classify(map_, q, states)
        if bad < 0:
            np.equal(states, FREE, out=out)
            _prove(proofs, np.flatnonzero(states == MIXED), q, q, out)
        return bad

    def edges(self, map_: Map, q0: Floats, q1: Floats, out: Bools) -> int:
        """Write whether edges are free.

        Edges, shapes (n, size), rotate along the shorter arc. Returns the index of the first invalid edge, or -1.
        """
        proofs = self._current_proofs()
        bad = edges_are_free(map_, q0, q1, out)
        if bad < 0:
            _prove(proofs, np.flatnonzero(~out), q0, q1, out)
        return bad

    def distance(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Return a proven lower bound of the obstacle distance, metres.

        The bound holds along a free path. The path is given in pieces: their midpoints, shape (n, size), in metres and
        radians, and the length and rotation angle of each, shape (n,). From its midpoint, a piece extends by half its
        length and half its angle. A blocked exterior counts as an obstacle. The bound is infinite if there are no
        obstacles.
        """
        return self._make_problem().margin + self._current_proofs().slack(as_contiguous(points), lengths, angles)

    def point_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """Make ``check(*q)``, which returns True only if a configuration is proven free.

        ``quick(*q)`` must return True only if q is in a FREE cell. The geometry decides the rest, as an edge without
        length.
        """
        self._current_proofs()  # made now, not at the first check
        return lambda *q: quick(*q) or self._current_proofs().edge(*q, *q)

    def edge_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """Return ``check(*q0, *q1)``.

        ``quick(*q0, *q1)`` must return True only if the edge lies in FREE cells.
        """
        self._current_proofs()
        return lambda *both: quick(*both) or self._current_proofs().edge(*both)

    def drop(self) -> None:
        """Drop the proofs, because obstacles change.

        Existing checkers use new ones from their next call on.
        """
        with self._lock:
            self._proofs = None

    def _current_proofs(self) -> Proofs:
        """Return the proofs for the current obstacles, made at the first call."""
        proofs = self._proofs
        if proofs is None:
            with self._lock:
                if self._proofs is None:
                    problem = self._make_problem()
                    self._proofs = (problem.prove or BoundaryProofs)(problem)
                proofs = self._proofs
        return proofs


def _prove(proofs: Proofs, left: Ints, q0: Floats, q1: Floats, out: Bools) -> None:
    """Prove the edges at the indices ``left``."""
    if len(left):
        starts = q0[left]
        out[left] = proofs.are_free(starts, starts if q1 is q0 else q1[left])


class Containment(NamedTuple):
    """Robot and obstacles as solids, for containment tests.

    If a connected part does not meet the other boundary, it lies entirely inside or entirely outside the other solid,
    so that a single point of it decides. For a part of the robot, any of its corners decides.

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 4)
        Corners of the robot, sorted by part, each with the index of the first corner of the next part.
    exterior_blocked : bool
        True if everything outside the grid is an obstacle; otherwise nothing outside is.
    lower, spacing : tuple of float, float
        Lower corner of the grid and side of its cells, metres.
    outer, inner : ndarray of bool, shape (nx, ny, nz)
        Cells that meet obstacles, and cells inside obstacles; nz is 1 in the plane.
    anchors : ndarray of float64, shape (m, 3)
        One point of each obstacle part that could fit into the robot, sorted by x.
    low, high : tuple of float
        Corners of the bounding box of the robot.
    reach : float
        Upper bound of the distance between the reference point and any point of the robot.
    has_solids : bool
        True if some obstacles have an inside that their cells do not decide.
    is_box : bool
        True if the robot fills its bounding box.
    regions : ndarray of float64, shape (m, 4)
        Segments around the regions that a robot of the plane fills, sorted by region.
    region_stops : ndarray of int64, shape (regions,)
        Index after the last segment of each region.
    """

    corners: Floats
    exterior_blocked: bool
    lower: Row
    spacing: float
    outer: Bools
    inner: Bools
    anchors: Floats
    low: Row
    high: Row
    reach: float
    has_solids: bool
    is_box: bool
    regions: Floats
    region_stops: Ints


class BoundaryTrees(NamedTuple):
    """Trees of robot, obstacles and walls, given by their roots.

    All lengths are scaled: metres times ``scale``. ``max_lever`` is the longest lever of the robot, and ``required``
    the distance that proves a configuration free. Walls are the faces of the grid, used if the exterior is blocked.
    """

    trees: Trees
    robot: int
    obstacles: int
    walls: int
    max_lever: float
    scale: float
    required: float


class ProofInputs(NamedTuple):
    """The map, the boundaries and the solids that every proof uses."""

    map: Map
    boundaries: BoundaryTrees
    containment: Containment


class BoundaryProofs:
    """Proofs for one robot among the obstacles of one workspace.

    Each kernel is compiled at its first call.
    """

    def __init__(self, problem: Problem) -> None:
        workspace, self._robot = problem.workspace, problem.robot.shape.outer
        boundaries, grid = obstacle_boundary(workspace, exterior_blocked=problem.exterior_blocked), workspace.grid
        # Balls and points need no containment test, because the distance from their center decides.
        parts = zip((each.outer for each in workspace.shapes or ()), boundaries.pieces, strict=False)
        self._shapes = [shape for shape, part in parts if shape.encloses and part.simplices.shape[1] == grid.dim]
        boundary, fixed = as_triangles([self._robot.boundary()]), as_triangles(boundaries.pieces)
        # Walls of a plane grid are so high that their sides, not their tops, are nearest.
        sides = np.pad(np.subtract(grid.upper, grid.lower), (0, 3 - grid.dim), mode="maximum")
        walls_box = Box.of(sides, np.pad(np.add(grid.lower, grid.upper) / 2.0, (0, 3 - grid.dim)))
        walls = as_triangles([walls_box.boundary()] if problem.exterior_blocked else [])
        max_coordinate = problem.max_coordinate + float(
            np.abs(fixed.simplices).max(initial=0.0) + fixed.radii.max(initial=0.0)
        )
        scale = 2.0 ** -math.frexp(max_coordinate)[1]
        trees, roots = build_trees(
            [RoundedSimplices(scale * part.simplices, scale * part.radii) for part in (boundary, fixed, walls)],
            problem.rotations.about_z,
        )
        corners, starts = connected_parts(boundary)
        part_stops = np.append(starts[1:], len(corners))
        self._anchors, reach = corners[starts], float(np.sqrt((corners**2).sum(axis=1)).max())
        anchors = [np.empty((0, 3))]
        # A robot of balls needs no anchors either. Only parts no larger than the robot can lie inside it.
        if self._robot.encloses and (boundary.simplices != boundary.simplices[:, :1]).any():
            anchored = (part_anchors(as_triangles([part])) for part in boundaries.pieces)
            anchors += [points[sizes <= 2.0 * reach] for points, sizes in anchored]
        small = np.concatenate(anchors)
        low, high = (np.pad(corner, (0, 3 - grid.dim)) for corner in self._robot.bounds)
        regions, cells = self._robot.regions, (*grid.shape, 1)[:3]
        containment = Containment(
            corners=np.hstack([corners, np.repeat(part_stops, part_stops - starts)[:, None]]),
            exterior_blocked=problem.exterior_blocked,
            lower=tuple(np.pad(grid.lower, (0, 3 - grid.dim)).tolist()),
            spacing=grid.spacing,
            outer=workspace.outer.reshape(cells),
            inner=(workspace.inner if workspace.shapes else workspace.outer).reshape(cells),
            anchors=small[np.argsort(small[:, 0])],
            low=tuple(low.tolist()),
            high=tuple(high.tolist()),
            reach=1.001 * reach,
            has_solids=bool(self._shapes),
            is_box=isinstance(self._robot, Box),
            regions=np.concatenate([np.empty((0, 4)), *regions]),
            region_stops=np.cumsum([len(region) for region in regions], dtype=np.int64),
        )
        required = scale * (problem.required_distance + boundaries.error + DISTANCE_ROUNDING * max_coordinate)
        max_lever = float(trees.boxes[0, 6])
        self._boundaries = BoundaryTrees(trees, roots[0], roots[1], roots[2], max_lever, scale, required)
        self._inputs = ProofInputs(problem.map, self._boundaries, containment)
        self._size, self._dim, self._rotations = problem.size, grid.dim, problem.rotations
        self._bounds = np.asarray(grid.lower), np.asarray(grid.upper)
        self._batch_size = 1 + ANCHORS_PER_BATCH // (1 + len(self._anchors) + len(small))

    @cached_property
    def edge(self) -> Callable[..., bool]:
        """Compiled ``edge(*q0, *q1)`` of :class:`Proofs`."""
        size, local = self._size, threading.local()
        padding = (0.0,) * (2 * (MAX_SIZE - size))
        prove = bind_kernel(state_of_edge, (self._inputs, size), make_scratch(), (0.0,) * (2 * MAX_SIZE))

        def edge(*both: float) -> bool:
            try:
                scratch = local.scratch
            except AttributeError:  # the first call of a thread
                scratch = local.scratch = make_scratch()
            state = prove(scratch, padding + both)
            return state == FREE or (state == MIXED and not self._are_nested(np.array([both[:size]]))[0])

        return edge

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        """Return whether each edge, shapes (n, size), is proven free."""
        states = np.empty(len(q0), dtype=np.uint8)

        def prove_chunk(start: int, stop: int) -> int:
            prove_edges(self._inputs, q0[start:stop], q1[start:stop], make_scratch(), states[start:stop])
            return -1

        in_chunks(prove_chunk, len(q0), MIN_PROOFS_PER_THREAD)
        free: Bools = states == FREE
        left = np.flatnonzero(states == MIXED)
        if len(left):
            # Edges often share their start, so each start is tested once.
            starts, which = np.unique(q0[left], axis=0, return_inverse=True)
            nested = [self._are_nested(part) for part in np.array_split(starts, 1 + len(starts) // self._batch_size)]
            free[left] = ~np.concatenate(nested)[which.reshape(-1)]
        return free

    def slack(self, points: Floats, lengths: Floats, angles: Floats) -> float:
        """Return a lower bound of (distance - required distance), metres.

        See :class:`Proofs`.
        """
        boundaries, (positions, matrices) = self._boundaries, self._place_robot(points)
        spans = 0.5 * (boundaries.scale * lengths + boundaries.max_lever * angles)
        pairs = make_scratch().node_pairs
        return float(path_slack(boundaries, boundaries.scale * positions, matrices, spans, pairs)) / boundaries.scale

    def _place_robot(self, points: Floats) -> tuple[Floats, Floats]:
        """Return reference points and rotation matrices of configurations.

        The shapes are (n, 3) and (n, 3, 3).
        """
        positions, matrices = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
        positions[:, : self._dim], matrices[:, 2, 2] = points[:, : self._dim], 1.0
        matrices[:, : self._dim, : self._dim] = self._rotations.rotation_matrices(points)
        return positions, matrices

    def _are_nested(self, q: Floats) -> Bools:
        """Return whether a part of one side lies inside the other.

        No boundaries may meet. Tests only the cases that :func:`containment_state` leaves MIXED.
        """
        containment, (positions, angles) = self._inputs.containment, self._place_robot(q)
        nested, (low, high) = np.zeros(len(q), dtype=np.bool_), self._bounds
        if self._shapes:
            anchors = (self._anchors @ angles.swapaxes(1, 2) + positions[:, None])[..., : self._dim]
            # Obstacles end at the bounds of the grid.
            which, points = _select_points((low <= anchors) & (anchors <= high), anchors)
            for part in self._shapes if len(points) else ():
                inside = which[part.contains(points)]
                nested[inside] = True
                if len(inside) and nested.all():
                    break
        # If the robot has regions of the plane, compiled code has tested the anchors already.
        if len(containment.anchors) and not len(containment.region_stops):
            near = (containment.anchors - positions[:, None]) @ angles
            which, points = _select_points((near >= containment.low) & (near <= containment.high), near)
            if len(points):
                nested[which[self._robot.contains(points)]] = True
        return nested


def _select_points(within: Bools, points: Floats) -> tuple[Ints, Floats]:
    """Select the points inside along every axis.

    Returns the first index of each and the points; ``points`` has shape (n, m, d).
    """
    chosen = np.asarray(within.all(axis=2))
    return np.nonzero(chosen)[0], points[chosen]


class Scratch(NamedTuple):
    """Scratch memory of an edge proof: unproven parts and node pairs."""

    parts: Floats
    node_pairs: Ints


def make_scratch() -> Scratch:
    """Allocate scratch memory."""
    return Scratch(np.empty((MAX_PENDING_PARTS, 2)), np.full(MAX_PENDING_PAIRS, -1))


@kernel
def prove_edges(inputs: ProofInputs, first: Floats, second: Floats, scratch: Scratch, out: States) -> None:
    """Fill ``out`` with :func:`edge_state` of edges, shapes (n, size)."""
    for k in range(first.shape[0]):
        p0, r0 = position_in(inputs.map, first, k), rotation_in(inputs.map.rotations.borders, first[k])
        p1, r1 = position_in(inputs.map, second, k), rotation_in(inputs.map.rotations.borders, second[k])
        out[k] = edge_state(inputs, p0, r0, p1, r1, scratch)


@kernel
def state_of_edge(inputs: ProofInputs, size: int, scratch: Scratch, both: Numbers) -> int:
    """Return :func:`edge_state` of an edge by the numbers of its ends, each of length ``size``, after zeros."""
    middle, end = 2 * MAX_SIZE - size, 2 * MAX_SIZE
    p0, r0 = position_before(inputs.map, both, middle), rotation_before(inputs.map.rotations.borders, both, middle)
    p1, r1 = position_before(inputs.map, both, end), rotation_before(inputs.map.rotations.borders, both, end)
    return edge_state(inputs, p0, r0, p1, r1, scratch)


@kernel
def edge_state(inputs: ProofInputs, p0: Row, r0: Numbers, p1: Row, r1: Numbers, scratch: Scratch) -> int:
    """Return FREE if a whole edge is proven free, BLOCKED if not.

    MIXED means that no boundaries meet along the edge: it is free if neither robot nor obstacles contain the other at
    the first endpoint. An edge with equal endpoints is a point. If two arcs are equally long up to rounding, both must
    be proven.

    The map proves a part of an arc, or the distance at its midpoint proves an interval around the midpoint and leaves
    the remainders on both sides. The endpoint is tested first, then mostly longer parts before shorter ones, so that a
    collision anywhere on the edge is found early.
    """
    (map_, boundaries, containment), parts, size, nested = inputs, scratch.parts, 0.0, FREE
    if not (is_usable(p0, r0) and is_usable(p1, r1)):
        return BLOCKED
    scale, spacing = boundaries.scale, boundaries.scale * map_.spacing
    for axis in range(3 - map_.dim, 3):
        length = abs(p0[axis]) + abs(p1[axis])
        if not length <= 2.0 * MAX_COORDINATE * map_.spacing:  # the negated comparison refuses NaN too
            return BLOCKED
        size += length
    step = minus(reference_point(map_, p1, scale), reference_point(map_, p0, scale))
    for arc in range(arc_count(r0, r1)):
        angle, angle_error = arc_angle_and_error(r0, r1, arc)
        required = boundaries.required + 2.0 * DISTANCE_ROUNDING * scale * size + angle_error * boundaries.max_lever
        speed = math.sqrt(dot(step, step)) + angle * boundaries.max_lever
        # Most colliding edges of a planner collide at an endpoint. For a point, the endpoint is the whole edge.
        parts[0, 0], parts[0, 1], parts[1, 0], parts[1, 1] = 1.0, 1.0, 0.0, 1.0
        scratch.node_pairs[0] = -1
        head, pending, measured = 0, 2 if speed > 0.0 else 1, 0
        while pending > 0:
            pending -= 1
            # Pick parts from all over the queue, because neighbours mostly both collide or are both free.
            # When the queue is nearly full, pick the newest part: it is short and adds few others.
            nearly_full = pending >= MAX_PENDING_PARTS - MAX_PENDING_PAIRS
            pick = pending if nearly_full else int(pending * (GOLDEN_RATIO * measured % 1.0))
            row = (head + pick) % MAX_PENDING_PARTS
            first, last = parts[row, 0], parts[row, 1]
            if not nearly_full:
                parts[row, 0], parts[row, 1] = parts[head, 0], parts[head, 1]
                head = (head + 1) % MAX_PENDING_PARTS
            half, center = 0.5 * (last - first), 0.5 * (first + last)
            # If the rotation jumps, a part may be at any rotation of the whole arc, so cells prove nothing.
            if angle_error == 0.0 and 0.0 < last - first < 1.0:
                begin, end = position_along(p0, p1, first), position_along(p0, p1, last)
                before = rotation_along(r0, r1, arc, first)
                after = rotation_along(r0, r1, arc, last)
                if edge_is_free(map_, begin, before, end, after):
                    continue
            place, rotation = position_along(p0, p1, center), rotation_along(r0, r1, arc, center)
            state, travel, proven = state_at(map_, place, rotation), 2.0 * half * speed, 0.0
            if state == FREE and travel == 0.0:
                continue
            if state == BLOCKED or measured == MAX_DISTANCES_PER_EDGE:
                return BLOCKED
            if travel <= (spacing if state == FREE else MAX_MOTION_CELLS * spacing):
                position = reference_point(map_, place, scale)
                motion = Motion(matrix_rows(rotation), position, step, angle, required, 0.0)
                enough = half / ADVANCE_FACTOR
                walls, pairs = boundaries.walls, scratch.node_pairs
                if walls >= 0 and stays_within_walls(boundaries, motion, enough):
                    walls = -1
                others = walls, boundaries.obstacles
                proven = free_fraction(boundaries.trees, boundaries.robot, others, motion, enough, pairs)
                measured += 1
                if proven < 0.0:
                    return BLOCKED
                # While no boundaries meet, containment cannot change, so it is tested once.
                if measured == 1:
                    position = reference_point(map_, place, 1.0)
                    nested = max(nested, containment_state(containment, position, motion.matrix))
                    if nested == BLOCKED:
                        return BLOCKED
                proven *= ADVANCE_FACTOR
                if proven < min(half, MIN_ADVANCE):
                    return BLOCKED
            if proven < half:
                row = (head + pending) % MAX_PENDING_PARTS
                parts[row, 0], parts[row, 1] = first, center - proven
                row = (row + 1) % MAX_PENDING_PARTS
                parts[row, 0], parts[row, 1] = center + proven, last
                pending += 2
    return nested


@kernel
def stays_within_walls(boundaries: BoundaryTrees, motion: Motion, fraction: float) -> bool:
    """Return True if the robot stays within the walls.

    Tests its bounding box during a fraction of a motion.
    """
    box, wall = boundaries.trees.boxes[boundaries.robot], boundaries.trees.boxes[boundaries.walls]
    center, half = place_box(motion, box)
    center = minus(center, row_at(wall, 0))
    drift = box[6] * motion.angle + motion.drift
    for axis in range(3):
        # An infinite fraction of a zero motion is NaN; the negated comparison makes it prove nothing.
        if not abs(center[axis]) + half[axis] + fraction * (abs(motion.step[axis]) + drift) < wall[3 + axis]:
            return False
    return True


@kernel
def path_slack(boundaries: BoundaryTrees, positions: Floats, matrices: Floats, spans: Floats, scratch: Ints) -> float:
    """Return a lower bound of (distance - required distance) along a path.

    The bound is at least zero. The robot is placed at the midpoint of each piece of the path. No point of the robot
    moves farther than the span of the piece from there. All lengths are scaled like the trees. No part of robot or
    obstacles may lie inside the other.
    """
    best, fixed = math.inf, (0.0, 0.0, 0.0)
    for k in range(len(positions)):
        x, y, z = position = row_at(positions[k], 0)
        rows = matrices[k]
        matrix = row_at(rows[0], 0), row_at(rows[1], 0), row_at(rows[2], 0)
        required = boundaries.required + 2.0 * DISTANCE_ROUNDING * (abs(x) + abs(y) + abs(z))
        # With a drift of 1 and no other motion, the free fraction is the distance itself, capped at best + span.
        motion = Motion(matrix, position, fixed, 0.0, required, 1.0)
        others, enough = (boundaries.walls, boundaries.obstacles), best + spans[k]
        best = min(best, free_fraction(boundaries.trees, boundaries.robot, others, motion, enough, scratch) - spans[k])
        if best <= 0.0:
            return 0.0
    return best


@kernel
def reference_point(map_: Map, position: Row, scale: float) -> Row:
    """Return the reference point of the robot in space, times ``scale``."""
    x, y, z = position
    if map_.dim == 2:
        return scale * y, scale * z, 0.0
    return scale * x, scale * y, scale * z


@kernel
def containment_state(containment: Containment, position: Row, matrix: Matrix) -> int:
    """Return whether robot or obstacles contain the other.

    The state is BLOCKED if a part of one side lies inside the other, MIXED if undecided, otherwise FREE. The robot's
    reference point is at ``position``; no boundaries of robot and obstacles may meet.
    """
    lower, spacing, state, k = containment.lower, containment.spacing, FREE, 0
    (nx, ny, nz), count = containment.outer.shape, containment.corners.shape[0]
    while k < count:
        corner = containment.corners[k]
        x, y, z = minus(apply_pose(matrix, position, row_at(corner, 0)), lower)
        i, j, m = math.floor(x / spacing), math.floor(y / spacing), math.floor(z / spacing)
        after = int(corner[3])
        if not (0 <= i < nx and 0 <= j < ny and 0 <= m < nz):
            if containment.exterior_blocked:
                return BLOCKED
            k = after
        elif containment.inner[i, j, m]:
            return BLOCKED
        elif not containment.outer[i, j, m]:
            k = after
        else:
            k += 1
            if k == after and containment.has_solids:  # all corners of the part are in undecided cells
                state = MIXED
    first, last = 0, containment.anchors.shape[0]
    while first < last:
        center = (first + last) // 2
        if containment.anchors[center, 0] < position[0] - containment.reach:
            first = center + 1
        else:
            last = center
    low, high = containment.low, containment.high
    for k in range(first, containment.anchors.shape[0]):
        anchor = containment.anchors[k]
        x, y, z = minus(row_at(anchor, 0), position)
        if x > containment.reach:
            break
        x, y, z = rotate_back(matrix, (x, y, z))
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            if containment.is_box or is_in_region(containment, x, y):
                return BLOCKED
            if not len(containment.region_stops):
                state = MIXED
    return state


@kernel
def is_in_region(containment: Containment, x: float, y: float) -> bool:
    """Return True if a point lies in a region of the robot.

    Uses ray parity; the point must not lie on the boundary.
    """
    first = 0
    for stop in containment.region_stops:
        inside = False
        for k in range(first, stop):
            ax, ay, bx, by = containment.regions[k]
            if (ay <= y) != (by <= y) and ax + (y - ay) / (by - ay) * (bx - ax) > x:
                inside = not inside
        if inside:
            return True
        first = stop
    return False

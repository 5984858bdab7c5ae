"""Exact look-ups: the cells of a map answer where they decide, and the borders of robot and obstacles elsewhere.

The plane lies in space at z = 0, where segments are triangles that have a corner twice.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, Matrix, Row, States
from cspace.compiling import bind_row_kernel, jit, kernel
from cspace.exact import ADVANCE, MOST_DISTANCES, ROUNDING, SHORTEST
from cspace.exact.boundaries import Problem, Proofs, anchors_of, in_space, obstacle_border, parts_of
from cspace.exact.triangles import DEPTH, Motion, Trees, box_around, share_apart, trees_of
from cspace.grid import MAX_COORDINATE
from cspace.kernels import dot, minus, placed, rotated_back, row_of
from cspace.map.batches import own
from cspace.map.edges import along, edge_is_free, edges_are_free
from cspace.map.points import Numbers, classify, configuration, halves, state_at
from cspace.map.storage import Map
from cspace.shapes import Box, Pieces
from cspace.threads import in_chunks

SLIDE: Final = 2.0
"""Longest part of an edge that one distance is to prove, in cells: longer ones take a search far and wide."""

GOLDEN: Final = 0.618
"""Multiples of the golden section, but for whole numbers, are spread evenly however many there are."""

WAITING: Final = 1024
"""Parts of an edge that wait at a time, at most."""

ANCHORS: Final = 100_000
"""Points of configurations that are looked at together, about."""

THREAD: Final = 500
"""Motions below which a second thread costs more than it saves."""


class Exact:
    """Exact look-ups of a map: its cells answer where they decide, and proofs decide what they leave open."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._proofs: Proofs | None = None
        self._lock = threading.RLock()

    def points(self, map_: Map, q: Floats, out: Bools) -> int:
        """Kernel of points, shape (n, dof): whether they are free."""
        proofs, states = self._made(), np.empty(len(q), dtype=np.uint8)
        bad = classify(map_, q, states)
        if bad < 0:
            np.equal(states, FREE, out=out)
            _prove(proofs, np.flatnonzero(states == MIXED), q, q, out)
        return bad

    def edges(self, map_: Map, q0: Floats, q1: Floats, out: Bools) -> int:
        """Kernel of edges, shapes (n, dof), along the shorter arc: whether they are free."""
        proofs = self._made()
        bad = edges_are_free(map_, None, q0, q1, out)
        if bad < 0:
            _prove(proofs, np.flatnonzero(~out), q0, q1, out)
        return bad

    def distance(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        """Lower bound, proven, of the distance between robot and obstacles on a path that is free, metres.

        The path is given in pieces: by their middles, shape (n, dof), in metres and radians, and by the metres and the
        radians along each of them, shape (n,). No point of the robot is farther than half of both from where it is in
        the middle. Where all outside the grid is obstacle, that counts too. Infinite where there is none.
        """
        return self._problem.margin + self._made().excess(own(points), lengths, turns)

    def point_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """``check(*q)``; ``quick`` is whether a point is FREE."""
        self._made()
        return lambda *q: quick(*q) or self._made().edge(*q, *q)

    def edge_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """``check(*q0, *q1)``; ``quick`` is whether an edge leads through FREE cells."""
        self._made()
        return lambda *both: quick(*both) or self._made().edge(*both)

    def renew(self, problem: Callable[[], Problem]) -> None:
        """Solve another problem of the same map; checkers that were handed out do so from their next call on."""
        with self._lock:
            self._problem, self._proofs = problem(), None

    def _made(self) -> Proofs:
        """The proofs among the obstacles as they are now."""
        proofs = self._proofs
        if proofs is None:
            with self._lock:
                if self._proofs is None:
                    self._proofs = (self._problem.prove or BorderProofs)(self._problem)
                proofs = self._proofs
        return proofs


def _prove(proofs: Proofs, left: Ints, q0: Floats, q1: Floats, out: Bools) -> None:
    """Fill ``out`` for the edges that the cells leave open, by their indices."""
    if len(left):
        starts = q0[left]
        out[left] = proofs.are_free(starts, starts if q1 is q0 else q1[left])


class Nesting(NamedTuple):
    """A robot and obstacles as solids.

    A connected part that meets no border of the other side lies in its solid as a whole, or not at all, so that one
    point of it decides; of the robot's parts, any of their corners.

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 4)
        Of the robot, part by part, each with the number of the next part's first.
    walled : bool
        Whether all outside the grid is obstacle; otherwise none is.
    outer, inner : ndarray of bool, shape (nx, ny, nz)
        Cells that meet obstacles, and those that lie in them; in the plane nz is 1.
    anchors : ndarray of float64, shape (m, 3)
        One point of each part of obstacles that could lie in the robot, in order of x.
    low, high : tuple of float
        Corners of the robot's bounding box.
    reach : float
        How far the robot reaches from its reference point, and a little more.
    solid : bool
        Whether there are obstacles with an inside that their borders do not decide.
    boxed : bool
        Whether the robot is all of its bounding box.
    regions : ndarray of float64, shape (m, 4)
        Segments around what a robot of the plane fills, part by part.
    stops : ndarray of int64, shape (parts,)
        Where each of these ends.
    """

    corners: Floats
    exterior_blocked: bool
    outer: Bools
    inner: Bools
    anchors: Floats
    low: Row
    high: Row
    reach: float
    solid: bool
    boxed: bool
    regions: Floats
    stops: Ints


class Borders(NamedTuple):
    """Trees of robot, obstacles and walls, by their roots.

    Lengths of trees, ``rho``, the robot's longest lever, and ``least``, what a distance has to exceed, are those in
    metres times ``scale``. Walls are the sides of the grid's box, where all outside it is obstacle.
    """

    trees: Trees
    robot: int
    obstacles: int
    walls: int
    rho: float
    scale: float
    least: float


class World(NamedTuple):
    """What every proof needs."""

    map: Map
    borders: Borders
    nesting: Nesting


class BorderProofs:
    """Proofs for one robot among the obstacles of one workspace; each kernel is compiled at its first call."""

    def __init__(self, problem: Problem) -> None:
        workspace, self._robot = problem.workspace, problem.robot.shape.outer
        borders, grid = obstacle_border(workspace, exterior_blocked=problem.exterior_blocked), workspace.grid
        # Balls and points have no inside but what is near their middle: the distance decides.
        parts = zip((each.outer for each in workspace.shapes or ()), borders.pieces, strict=False)
        self._shapes = [shape for shape, part in parts if shape.encloses and part.simplices.shape[1] == grid.dim]
        border, still = in_space([self._robot.boundary()]), in_space(borders.pieces)
        # Over the plane the walls rise so high that it is their sides that are near.
        sides = np.pad(np.subtract(grid.upper, grid.lower), (0, 3 - grid.dim), mode="maximum")
        room = Box.of(sides, np.pad(np.add(grid.lower, grid.upper) / 2.0, (0, 3 - grid.dim)))
        walls = in_space([room.boundary()] if problem.exterior_blocked else [])
        far = problem.far + float(np.abs(still.simplices).max(initial=0.0) + still.radii.max(initial=0.0))
        scale = 2.0 ** -math.frexp(far)[1]
        trees, roots = trees_of(
            [Pieces(scale * part.simplices, scale * part.radii) for part in (border, still, walls)],
            problem.rotations.about_z,
        )
        corners, starts = parts_of(border)
        stops = np.append(starts[1:], len(corners))
        self._anchors, reach = corners[starts], float(np.sqrt((corners**2).sum(axis=1)).max())
        anchors = [np.empty((0, 3))]
        # The same of balls of the robot; elsewhere only what is small fits in.
        if self._robot.encloses and (border.simplices != border.simplices[:, :1]).any():
            anchored = (anchors_of(in_space([part])) for part in borders.pieces)
            anchors += [points[sizes <= 2.0 * reach] for points, sizes in anchored]
        small = np.concatenate(anchors)
        low, high = (np.pad(corner, (0, 3 - grid.dim)) for corner in self._robot.bounds)
        regions, cells = self._robot.regions, (*grid.shape, 1)[:3]
        nesting = Nesting(
            corners=np.hstack([corners, np.repeat(stops, stops - starts)[:, None]]),
            exterior_blocked=problem.exterior_blocked,
            outer=workspace.outer.reshape(cells),
            inner=(workspace.inner if workspace.shapes else workspace.outer).reshape(cells),
            anchors=small[np.argsort(small[:, 0])],
            low=tuple(low.tolist()),
            high=tuple(high.tolist()),
            reach=1.001 * reach,
            solid=bool(self._shapes),
            boxed=isinstance(self._robot, Box),
            regions=np.concatenate([np.empty((0, 4)), *regions]),
            stops=np.cumsum([len(region) for region in regions], dtype=np.int64),
        )
        least = scale * (problem.least + borders.error + ROUNDING * far)
        rho = float(trees.boxes[0, 6])
        self._borders = Borders(trees, roots[0], roots[1], roots[2], rho, scale, least)
        self._world = World(problem.map, self._borders, nesting)
        self._dof, self._dim, self._rotations = problem.dof, grid.dim, problem.rotations
        self._bounds = np.asarray(grid.lower), np.asarray(grid.upper)
        self._together = 1 + ANCHORS // (1 + len(self._anchors) + len(small))

    @cached_property
    def edge(self) -> Callable[..., bool]:
        dof = self._dof
        kernel = bind_row_kernel(prove_edge, self._world, 2 * dof)

        def edge(*both: float) -> bool:
            state = kernel(both)
            return state == FREE or (state == MIXED and not self._are_nested(np.array([both[:dof]]))[0])

        return edge

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        states = np.empty(len(q0), dtype=np.uint8)

        def work(first: int, last: int) -> int:
            prove_edges(self._world, q0[first:last], q1[first:last], room(), states[first:last])
            return -1

        in_chunks(work, len(q0), THREAD)
        free: Bools = states == FREE
        left = np.flatnonzero(states == MIXED)
        if len(left):
            # Many edges may begin at one configuration.
            starts, which = np.unique(q0[left], axis=0, return_inverse=True)
            nested = [self._are_nested(part) for part in np.array_split(starts, 1 + len(starts) // self._together)]
            free[left] = ~np.concatenate(nested)[which.reshape(-1)]
        return free

    def excess(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        borders, (places, matrices) = self._borders, self._placed(points)
        spans = 0.5 * (borders.scale * lengths + borders.rho * turns)
        return float(least_excess(borders, borders.scale * places, matrices, spans, room().pairs)) / borders.scale

    def _placed(self, points: Floats) -> tuple[Floats, Floats]:
        """Reference points in space, shape (n, 3), and rotation matrices, shape (n, 3, 3), of configurations."""
        places, matrices = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
        places[:, : self._dim], matrices[:, 2, 2] = points[:, : self._dim], 1.0
        matrices[:, : self._dim, : self._dim] = self._rotations.matrices(points)
        return places, matrices

    def _are_nested(self, q: Floats) -> Bools:
        """Whether a part of one side lies in the other, where no borders meet and compiled code does not decide."""
        nesting, (places, turns) = self._world.nesting, self._placed(q)
        nested, (low, high) = np.zeros(len(q), dtype=np.bool_), self._bounds
        if self._shapes:
            anchors = (self._anchors @ turns.swapaxes(1, 2) + places[:, None])[..., : self._dim]
            # Obstacles end where the grid does.
            which, points = _chosen((low <= anchors) & (anchors <= high), anchors)
            for part in self._shapes if len(points) else ():
                inside = which[part.contains(points)]
                nested[inside] = True
                if len(inside) and nested.all():
                    break
        if len(nesting.anchors) and not len(nesting.stops):  # else compiled code has looked at what lies in the robot
            near = (nesting.anchors - places[:, None]) @ turns
            which, points = _chosen((near >= nesting.low) & (near <= nesting.high), near)
            if len(points):
                nested[which[self._robot.contains(points)]] = True
        return nested


def _chosen(within: Bools, points: Floats) -> tuple[Ints, Floats]:
    """The points, shape (n, m, d), that are within along every axis, and the first index of each."""
    chosen = np.asarray(within.all(axis=2))
    return np.nonzero(chosen)[0], points[chosen]


class Work(NamedTuple):
    """Room for parts of an edge that wait, as a ring, and for pairs of nodes."""

    parts: Floats
    pairs: Ints


def room() -> Work:
    """New room."""
    return Work(np.empty((WAITING, 2)), np.full(DEPTH, -1))


@kernel
def prove_edges(world: World, first: Floats, second: Floats, work: Work, out: States) -> None:
    """:func:`edge_state` of edges, shapes (n, dof)."""
    for k in range(first.shape[0]):
        q0, q1 = configuration(world.map, first, k), configuration(world.map, second, k)
        out[k] = edge_state(world, q0, q1, work)


@jit
def prove_edge(world: World, both: Numbers) -> int:
    """:func:`edge_state` of an edge, given by its endpoints in a row."""
    q0, q1 = halves(world.map, both)
    rotations = world.map.rotations
    if not (rotations.is_usable(q0) and rotations.is_usable(q1)):
        return BLOCKED
    work = Work(np.empty((WAITING, 2)), np.empty(DEPTH, np.int64))
    return edge_state(world, q0, q1, work)


@kernel
def edge_state(world: World, q0: Numbers, q1: Numbers, work: Work) -> int:
    """FREE where all configurations of an edge are free, and BLOCKED where that is not proven.

    MIXED where they are free if neither the robot nor an obstacle lies in the other at the first of them. An edge that
    ends where it starts is a point. Where two arcs are equally long but for rounding, both are proven.
    """
    state = FREE
    for arc in range(world.map.rotations.arc_count(q0, q1)):
        state = max(state, arc_state(world, q0, q1, arc, work)) if state != BLOCKED else BLOCKED
    return state


@kernel
def arc_state(world: World, q0: Numbers, q1: Numbers, arc: int, work: Work) -> int:
    """The same along one of the shortest arcs.

    Parts are proven by the map, or by how far apart all is in their middle, which may leave something on either side.
    The end comes first, and then longer parts mostly before shorter ones, so that a collision far along shows early.
    """
    (map_, borders, nesting), parts, size = world, work.parts, 0.0
    scale = borders.scale
    for axis in range(len(map_.lower)):
        length = abs(q0[axis]) + abs(q1[axis])
        if not length <= 2.0 * MAX_COORDINATE * map_.spacing:  # nor is NaN
            return BLOCKED
        size += length
    angle, jump = map_.rotations.turn_of(q0, q1, arc)
    step = minus(place_of(map_, q1, scale), place_of(map_, q0, scale))
    least, spacing = borders.least + 2.0 * ROUNDING * scale * size + jump * borders.rho, scale * map_.spacing
    speed = math.sqrt(dot(step, step)) + angle * borders.rho
    # At their endpoints most of a planner's edges collide; of a point that is all.
    parts[0, 0], parts[0, 1], parts[1, 0], parts[1, 1] = 1.0, 1.0, 0.0, 1.0
    work.pairs[0] = -1
    head, waiting, measured, nested = 0, 2 if speed > 0.0 else 1, 0, FREE
    while waiting > 0:
        waiting -= 1
        # Now from here, now from there: of neighbours mostly both collide, or neither. Where room gets scarce the
        # newest, which is short, so that few are added before some are done.
        scarce = waiting >= WAITING - DEPTH
        row = (head + (waiting if scarce else int(waiting * (GOLDEN * measured % 1.0)))) % WAITING
        first, last = parts[row, 0], parts[row, 1]
        if not scarce:
            parts[row, 0], parts[row, 1] = parts[head, 0], parts[head, 1]
            head = (head + 1) % WAITING
        half, middle = 0.5 * (last - first), 0.5 * (first + last)
        # Where the rotation jumps, a part may be at any rotation of the whole.
        if (
            jump == 0.0
            and 0.0 < last - first < 1.0
            and edge_is_free(map_, None, along(map_, q0, q1, arc, first), along(map_, q0, q1, arc, last))
        ):
            continue
        q = along(map_, q0, q1, arc, middle)
        state, reach, part = state_at(map_, q), 2.0 * half * speed, 0.0
        if state == FREE and reach == 0.0:
            continue
        if state == BLOCKED or measured == MOST_DISTANCES:
            return BLOCKED
        if reach <= (spacing if state == FREE else SLIDE * spacing):
            place = place_of(map_, q, scale)
            motion = Motion(map_.rotations.matrix_of(q), place, step, angle, least, 0.0)
            part = half / ADVANCE
            walls = -1 if borders.walls < 0 or is_within(borders, motion, part) else borders.walls
            part = share_apart(borders.trees, borders.robot, (walls, borders.obstacles), motion, part, work.pairs)
            measured += 1
            if part < 0.0:
                return BLOCKED
            # As long as no borders meet, whether one lies within the other stays as it is.
            if measured == 1:
                nested = nested_at(nesting, map_, q, motion.matrix)
                if nested == BLOCKED:
                    return BLOCKED
            part *= ADVANCE
            if part < min(half, SHORTEST):
                return BLOCKED
        if part < half:
            row = (head + waiting) % WAITING
            parts[row, 0], parts[row, 1] = first, middle - part
            row = (row + 1) % WAITING
            parts[row, 0], parts[row, 1] = middle + part, last
            waiting += 2
    return nested


@kernel
def is_within(borders: Borders, motion: Motion, part: float) -> bool:
    """Whether the box around a robot stays within the walls for a part of a motion."""
    box, wall = borders.trees.boxes[borders.robot], borders.trees.boxes[borders.walls]
    middle, half = box_around(motion, box)
    middle = minus(middle, row_of(wall, 0))
    turn = box[6] * motion.angle + motion.slide
    for axis in range(3):
        # An infinite part of no way at all is no number, and proves nothing.
        if not abs(middle[axis]) + half[axis] + part * (abs(motion.step[axis]) + turn) < wall[3 + axis]:
            return False
    return True


@kernel
def least_excess(borders: Borders, places: Floats, matrices: Floats, spans: Floats, work: Ints) -> float:
    """By how much the least distance on pieces of a path exceeds what it has to; zero if not proven to.

    The robot is placed in the middle of each piece, from where no point of it moves farther than the piece's span. All
    lengths are those of trees, and no borders may lie nested there.
    """
    best, still = math.inf, (0.0, 0.0, 0.0)
    for k in range(len(places)):
        x, y, z = place = row_of(places[k], 0)
        turn = matrices[k]
        matrix = row_of(turn[0], 0), row_of(turn[1], 0), row_of(turn[2], 0)
        # What moves by a metre to whatever side comes as far as the distance; what is farther does not matter.
        least = borders.least + 2.0 * ROUNDING * (abs(x) + abs(y) + abs(z))
        motion = Motion(matrix, place, still, 0.0, least, 1.0)
        others = borders.walls, borders.obstacles
        best = min(best, share_apart(borders.trees, borders.robot, others, motion, best + spans[k], work) - spans[k])
        if best <= 0.0:
            return 0.0
    return best


@kernel
def place_of(map_: Map, q: Numbers, scale: float) -> Row:
    """The reference point of the robot, in space and in lengths of trees."""
    z = 0.0
    for axis in range(2, len(map_.lower)):
        z = q[axis]
    return scale * q[0], scale * q[1], scale * z


@kernel
def nested_at(nesting: Nesting, map_: Map, q: Numbers, matrix: Matrix) -> int:
    """Whether a part of one side lies in the other, where no borders meet: FREE, BLOCKED, or MIXED for unknown."""
    place, lower, state, k = place_of(map_, q, 1.0), place_of(map_, map_.lower, 1.0), FREE, 0
    (nx, ny, nz), count = nesting.outer.shape, nesting.corners.shape[0]
    while k < count:
        corner = nesting.corners[k]
        x, y, z = minus(placed(matrix, place, row_of(corner, 0)), lower)
        i, j, m = math.floor(x / map_.spacing), math.floor(y / map_.spacing), math.floor(z / map_.spacing)
        after = int(corner[3])
        if not (0 <= i < nx and 0 <= j < ny and 0 <= m < nz):
            if nesting.exterior_blocked:
                return BLOCKED
            k = after
        elif nesting.inner[i, j, m]:
            return BLOCKED
        elif not nesting.outer[i, j, m]:
            k = after
        else:
            k += 1
            if k == after and nesting.solid:  # no corner of the part decides
                state = MIXED
    first, last = 0, nesting.anchors.shape[0]
    while first < last:
        middle = (first + last) // 2
        if nesting.anchors[middle, 0] < place[0] - nesting.reach:
            first = middle + 1
        else:
            last = middle
    low, high = nesting.low, nesting.high
    for k in range(first, nesting.anchors.shape[0]):
        anchor = nesting.anchors[k]
        x, y, z = minus(row_of(anchor, 0), place)
        if x > nesting.reach:
            break
        x, y, z = rotated_back(matrix, (x, y, z))
        if low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            if nesting.boxed or is_filled(nesting, x, y):
                return BLOCKED
            if not len(nesting.stops):
                state = MIXED
    return state


@kernel
def is_filled(nesting: Nesting, x: float, y: float) -> bool:
    """Whether a point that is not on the border lies in a region of the robot, by the parity of a ray to the right."""
    first = 0
    for stop in nesting.stops:
        inside = False
        for k in range(first, stop):
            ax, ay, bx, by = nesting.regions[k]
            if (ay <= y) != (by <= y) and ax + (y - ay) / (by - ay) * (bx - ax) > x:
                inside = not inside
        if inside:
            return True
        first = stop
    return False

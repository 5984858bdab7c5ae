"""Proofs in space, of configurations and of motions, where the map cannot decide."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import entry, jit
from cspace.exact import ADVANCE, MOST_DISTANCES, ROUNDING, SHORTEST
from cspace.exact.boundaries import Obstacles, Problem, anchors_of, joined, obstacle_border
from cspace.exact.triangles import Distances
from cspace.grid import MAX_COORDINATE
from cspace.map.edges import between, edge_is_free, edges_are_free
from cspace.map.points import classify, configuration, replaced, state_at
from cspace.map.record import Map
from cspace.rotations import TURN, YAW_SLACK
from cspace.shapes import Pieces
from cspace.states import BLOCKED, FREE, MIXED

Floats = NDArray[np.float64]
Place = tuple[float, ...]
"""A configuration: x, y, z, and yaw for a robot that turns."""

IDENTITY: Final = np.eye(3)

ALL_FREE: Final = -1
"""Not a state: of a part of a motion, of which every configuration is FREE."""

SLIDE: Final = 8.0
"""Longest part of an edge that one distance is to prove, in cells: longer ones take a search far and wide."""


class SolidProofs:
    """Proofs for one robot among the obstacles of one workspace."""

    def __init__(self, problem: Problem) -> None:
        grid, robot = problem.workspace.grid, problem.robot
        self._map, self._spacing, self._walled = problem.map, grid.spacing, problem.walled
        self._look = _looker(self._map, problem.dof)
        border, obstacles = (
            joined([robot.shape.boundary()], 3, 3),
            obstacle_border(problem.workspace, walled=self._walled),
        )
        self._least = problem.least + obstacles.error
        self._distances = Distances(border, joined(obstacles.pieces, 3, 3), problem.far)
        self._nesting = _Nesting(problem, border, obstacles)
        self._border, self._rho = border, float(np.hypot(*border.simplices[..., :2].T).max())
        self._walls = np.asarray(grid.lower), np.asarray(grid.upper)
        self._limits = self._limits_at(np.eye(3))

    def point(self, *q: float) -> int:
        """Whether a configuration is free: how many distances that took, zero or above; or -1 less that number."""
        state = self._look(np.array([q, q]), 0.0, 0.0)
        if state != MIXED:
            return -1 if state == BLOCKED else 0
        if not sum(map(abs, q[:3])) <= 2.0 * MAX_COORDINATE * self._spacing or self._room(q) <= 0.0:
            return -2
        return -2 if self._spare(q, 0.0) <= 0.0 or self._nesting.at(q, _turned(q)) else 1

    def edge(self, *ends: float) -> int:
        """As :meth:`point`, for an edge along the shorter arc; along both where they are equal but for rounding."""
        start, end = ends[: len(ends) // 2], ends[len(ends) // 2 :]
        if self._look(np.array([start, end]), 0.0, 1.0) == ALL_FREE:
            return 0
        if not sum(map(abs, (*start[:3], *end[:3]))) <= 2.0 * MAX_COORDINATE * self._spacing:
            return -1
        asked = 0
        for stop in _stops(start, end):
            free, more = self._advance(start, stop)
            asked += more
            if not free:
                return -1 - asked
        return asked

    def points(self, points: Floats, out: NDArray[np.bool_], counts: NDArray[np.int64]) -> int:
        """:meth:`point` of points, shape (n, dof); the index of the first one that is not usable, or -1.

        ``counts`` grows by how many points took a distance, and by how many distances were taken.
        """
        states = np.empty(len(points), dtype=np.uint8)
        bad: int = classify(self._map, points, states)
        if bad < 0:
            out[...] = states == FREE
            for k in np.flatnonzero((states != FREE) & (states != BLOCKED)).tolist():
                out[k] = _counted(self.point(*points[k].tolist()), counts)
        return bad

    def edges(self, starts: Floats, ends: Floats, out: NDArray[np.bool_], counts: NDArray[np.int64]) -> int:
        """:meth:`edge` of edges, shapes (n, dof); as :meth:`points`."""
        bad: int = edges_are_free(self._map, None, starts, ends, out)
        if bad < 0:
            for k in np.flatnonzero(~out).tolist():
                out[k] = _counted(self.edge(*starts[k].tolist(), *ends[k].tolist()), counts)
        return bad

    def _advance(self, start: Place, stop: Place) -> tuple[bool, int]:
        """Whether a motion is free, and how many distances that took.

        Parts are proven by the map, or by the distance in their middle, which may leave something on either side. They
        are looked at from the longest to the shortest, so that a collision far along the way shows early.
        """
        turn = math.dist(start[3:], stop[3:])
        speed = math.dist(start[:3], stop[:3]) + self._rho * turn
        # The room of a robot that does not turn is least at an end.
        if not turn and min(self._room(start), self._room(stop)) <= 0.0:
            return False, 0
        motion, parts, asked = np.array([start, stop]), deque([(0.0, 1.0)]), 0
        while parts:
            first, last = parts.popleft()
            state = self._look(motion, first, last)
            if state == ALL_FREE:
                continue
            if state == BLOCKED or asked == MOST_DISTANCES:
                return False, asked
            middle, reach = 0.5 * (first + last), (last - first) * speed
            if reach > (self._spacing if state == FREE else SLIDE * self._spacing):
                parts += [(first, middle), (middle, last)]
                continue
            q = tuple(a + middle * (b - a) for a, b in zip(start, stop, strict=True))
            asked += 1
            spare = self._spare(q, 0.5 * reach / ADVANCE)
            if turn:
                spare = min(spare, self._room(q))
            # As long as no borders meet, whether one lies within the other stays as it is.
            if spare <= 0.0 or (asked == 1 and self._nesting.at(q, _turned(q))):
                return False, asked
            part = ADVANCE * spare / speed if speed > 0.0 else math.inf
            if part < SHORTEST:
                return False, asked
            if part < 0.5 * (last - first):
                parts += [(first, middle - part), (middle + part, last)]
        return True, asked

    def _counts_from(self, q: Place) -> float:
        """What a distance has to exceed, but for the error of coal."""
        return self._least + 2.0 * ROUNDING * (abs(q[0]) + abs(q[1]) + abs(q[2]))

    def _spare(self, q: Place, enough: float) -> float:
        """By how much the distance at a configuration is more than counts, or a lower bound above ``enough``."""
        least = self._counts_from(q) + self._distances.error
        # The next float above, so that zero is never enough.
        return self._distances(q[:3], _turned(q), math.nextafter(least + enough, math.inf)) - least

    def _room(self, q: Place) -> float:
        """By how much the robot is farther from the walls than it has to be; infinite where there are none."""
        if not self._walled:
            return math.inf
        limits = self._limits if len(q) == 3 else self._limits_at(_turned(q))
        return min(min(x - low, high - x) for x, (low, high) in zip(q[:3], limits, strict=True)) - self._counts_from(q)

    def _limits_at(self, turn: Floats) -> list[list[float]]:
        """Least and largest coordinates with the turned robot in the grid's box, for each axis."""
        points, radii = self._border.simplices.reshape(-1, 3) @ turn.T, np.repeat(self._border.radii, 3)[:, None]
        lower, upper = self._walls
        limits: list[list[float]] = np.array(
            [lower - (points - radii).min(axis=0), upper - (points + radii).max(axis=0)]
        ).T.tolist()
        return limits


class _Nesting:
    """A robot and obstacles as solids.

    What hangs together and meets no border of the other side lies in its solid as a whole, or not at all, so that one
    point of it tells.
    """

    def __init__(self, problem: Problem, border: Pieces, obstacles: Obstacles) -> None:
        from scipy.spatial import cKDTree

        workspace = problem.workspace
        self._shapes = [shape for shape in workspace.shapes or () if shape.encloses]
        self._robot, self._anchors = problem.robot.shape, anchors_of(border)[0]
        inner = workspace.inner if workspace.shapes else workspace.outer
        fixed = Cells(workspace.outer, inner, workspace.grid.lower, workspace.grid.spacing), self._anchors
        self._cells, self._in_cells = fixed[0], _compiled(_in_cells, fixed, 3)
        # An obstacle in a ball is near its middle, which the distance tells; elsewhere only what is small fits in.
        self._tree, self._reach = None, float(np.sqrt((border.simplices**2).sum(axis=-1)).max())
        if self._robot.encloses and (border.simplices != border.simplices[:, :1]).any():
            parts = [points[sizes <= 2.0 * self._reach] for points, sizes in map(anchors_of, obstacles.pieces)]
            self._points = np.concatenate([np.empty((0, 3)), *parts])
            self._tree = cKDTree(self._points) if len(self._points) else None

    def at(self, q: Place, turn: Floats) -> bool:
        """Whether a part of one lies in the other, where no borders meet."""
        anchors = self._anchors if len(q) == 3 else self._anchors @ turn.T
        found = self._in_cells(self._cells, anchors, *q[:3])
        if found == BLOCKED or (
            found == MIXED and any(np.any(part.contains(anchors + q[:3])) for part in self._shapes)
        ):
            return True
        if self._tree is None:
            return False
        # A little more than the ball around the robot, for rounding.
        near = (self._points[self._tree.query_ball_point(q[:3], 1.001 * self._reach)] - q[:3]) @ turn
        low, high = self._robot.bounds
        near = near[((near >= low) & (near <= high)).all(axis=1)]
        return bool(len(near)) and bool(np.any(self._robot.contains(near)))


def _turned(q: Place) -> Floats:
    """The rotation of a configuration, as a matrix."""
    if len(q) == 3:
        return IDENTITY
    cosine, sine = math.cos(q[3]), math.sin(q[3])
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _stops(start: Place, end: Place) -> Iterator[Place]:
    """Where the motions of an edge end: that along the shorter arc, or two along both if they are as good as equal."""
    if len(end) == 3:
        yield end
        return
    turn = math.remainder(end[3] - start[3], TURN)
    yield *end[:3], start[3] + turn
    if math.pi - abs(turn) <= YAW_SLACK:
        yield *end[:3], start[3] + turn - math.copysign(TURN, turn)


def _counted(asked: int, counts: NDArray[np.int64]) -> bool:
    """Whether an answer says free; what it took is added to the counts."""
    number = asked if asked >= 0 else -1 - asked
    counts[0] += number > 0
    counts[1] += number
    return asked >= 0


class Cells(NamedTuple):
    """Cells that meet obstacles, and those that lie in them."""

    outer: NDArray[np.bool_]
    inner: NDArray[np.bool_]
    lower: tuple[float, ...]
    spacing: float


@jit
def _in_cells(cells: Cells, anchors: Floats, x: float, y: float, z: float) -> int:
    """Whether some of some points, shape (n, 3), at a place, lie in an obstacle: BLOCKED, FREE, or MIXED for unknown.

    What lies outside the grid lies in none.
    """
    found, (nx, ny, nz) = FREE, cells.outer.shape
    for k in range(anchors.shape[0]):
        i = math.floor((x + anchors[k, 0] - cells.lower[0]) / cells.spacing)
        j = math.floor((y + anchors[k, 1] - cells.lower[1]) / cells.spacing)
        m = math.floor((z + anchors[k, 2] - cells.lower[2]) / cells.spacing)
        if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz and cells.outer[i, j, m]:
            if cells.inner[i, j, m]:
                return BLOCKED
            found = MIXED
    return found


@jit
def _look(map_: Map, motion: Floats, first: float, last: float) -> int:
    """ALL_FREE if every cell is FREE that a part of a motion touches, otherwise the state of its middle.

    A motion is where it starts and where it stops, shape (2, dof).
    """
    start = configuration(map_, motion, 0)
    stop, middle = start, start
    for axis in range(len(start)):
        a, b = motion[0, axis], motion[1, axis]
        start = replaced(start, axis, between(a, b, first))
        stop = replaced(stop, axis, between(a, b, last))
        middle = replaced(middle, axis, between(a, b, 0.5 * (first + last)))
    return ALL_FREE if edge_is_free(map_, None, start, stop) else state_at(map_, middle)


def _compiled(function: Any, samples: tuple[Any, ...], floats: int) -> Callable[..., int]:
    """A compiled function, for arguments like samples and some floats, without numba's dispatch on every call."""
    return cast("partial[int]", entry(function, samples, floats)).func


def _looker(map_: Map, dof: int) -> Callable[[Floats, float, float], int]:
    """``look(motion, first, last)``."""
    return partial(_compiled(_look, (map_, np.empty((2, dof))), 2), map_)

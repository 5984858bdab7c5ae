"""Exact look-ups in space: the geometry itself is asked where the map cannot decide.

FREE and BLOCKED cells answer at once. In MIXED ones, and outside the grid, the distance between the surfaces of the
robot and of the obstacles decides; where they are apart, one point of each part tells whether it lies within the other
side.

* A robot is boxes, balls or triangles. Planes that separate what each of them sweeps along a piece of an edge from each
  triangle of the obstacles prove that piece at once (:mod:`cspace.exact.sweeps.convex`).
* Where a margin, or obstacles that are balls, leave that open for a robot that is no ball: FCL's distances
  (:mod:`cspace.exact.distances`). A distance d proves all configurations within d, as no point of a robot that does
  not turn moves by more (B. Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996).

*Rounding.* All sets are closed: touching is a collision. A distance counts only where it exceeds the margin by 1e-12
times the largest coordinates of the map, the robot and the configuration, and FCL's by
:attr:`cspace.exact.distances.Distances.error` more.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.exact import ROUNDING
from cspace.exact.distances import fcl_module
from cspace.grid import MAX_COORDINATE
from cspace.once import Once
from cspace.outside import Outside
from cspace.shapes import Mesh
from cspace.spatial.lookups import SpatialLookups
from cspace.states import BLOCKED, FREE
from cspace.translating import Kernel, entry

if TYPE_CHECKING:
    from cspace.exact.distances import Distances
    from cspace.exact.nesting import Nesting
    from cspace.exact.surfaces import Surface
    from cspace.exact.sweeps.convex import Convex
    from cspace.questions import Questions
    from cspace.workspace import Workspace

Point = tuple[float, float, float]

ADVANCE: Final = 0.999
"""Part of a proven distance that is used, so that its end is proven too."""

MOST_DISTANCES: Final = 10_000
"""Distances after which an edge is given up as not proven: it grazes an obstacle."""

SHORTEST: Final = 2.0**-44
"""Least part of an edge to advance by; below it the edge grazes an obstacle."""


SLIDE: Final = 16.0
"""Longest sweep, in cells: longer ones meet many triangles, of which few come near."""

REACH: Final = 40
"""The largest coordinate in proofs is about two to this power, so that products of small ones stay above zero."""


class SolidLookups:
    """Exact look-ups of a map of a robot that translates in space.

    Each kernel takes arrays of shape (n, 3) and fills one of shape (n,).

    Parameters
    ----------
    space : CSpace
    outsides : sequence of Outside
        What is known outside the grid; one.
    """

    def __init__(self, space: Questions, outsides: Sequence[Outside]) -> None:
        grid = space.grid
        self._workspace, self._body, self._margin = space.workspace, space.robot.body, space.margin
        self._walled, self._spacing = space.outside == "blocked", grid.spacing
        frame = np.array([*grid.lower, grid.spacing, *grid.upper])
        self._map = (space.stack[0], frame, outsides[0].box, outsides[0].state)
        self._lookups = SpatialLookups(space.stack[0], frame, outsides[0])
        self._far = float(np.abs([*grid.lower, *grid.upper]).max()) + space.robot.span
        self._scale = float(2.0 ** (REACH - math.frexp(self._far)[1]))
        lower, upper = self._body.bounds
        # Configurations with the robot in the grid's box.
        self._room: list[list[float]] = np.array([grid.lower - lower, grid.upper - upper]).T.tolist()
        self._once = Once()
        self._lock = threading.Lock()
        self._counts = {"point": 0, "edge": 0, "distance": 0}

    @property
    def counts(self) -> dict[str, int]:
        """How many points and edges the map could not decide, and how many distances were computed for them."""
        with self._lock:
            return dict(self._counts)

    def points(self) -> Kernel:
        """Kernel of points: whether they are free."""
        classify = self._lookups.classify()

        def run(points: NDArray[np.float64], out: NDArray[np.bool_]) -> int:
            states = np.empty(len(points), dtype=np.uint8)
            bad = classify(points, states)
            if bad < 0:
                out[...] = states == FREE
                for number in np.flatnonzero((states != FREE) & (states != BLOCKED)).tolist():
                    out[number] = self._ask_point(tuple(points[number].tolist()))
            return bad

        return run

    def edges(self) -> Kernel:
        """Kernel of straight edges: whether they are free."""
        by_map = self._lookups.edges()

        def run(starts: NDArray[np.float64], ends: NDArray[np.float64], out: NDArray[np.bool_]) -> int:
            bad = by_map(starts, ends, out)
            if bad < 0:
                for number in np.flatnonzero(~out).tolist():
                    out[number] = self._ask_edge(tuple(starts[number].tolist()), tuple(ends[number].tolist()))
            return bad

        return run

    def point_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """``check(x, y, z)``; ``quick`` tells whether a point is FREE."""
        state_at = self._state_at()
        self._scene()

        def check(x: float, y: float, z: float) -> bool:
            return quick(x, y, z) or (state_at(x, y, z) != BLOCKED and self._ask_point((x, y, z)))

        return check

    def edge_checker(self) -> Callable[..., bool]:
        """``check(x0, y0, z0, x1, y1, z1)``: whether an edge is free."""
        walk = self._lookups.edge_checker()
        self._scene()

        def check(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> bool:
            return walk(x0, y0, z0, x1, y1, z1) or self._ask_edge((x0, y0, z0), (x1, y1, z1))

        return check

    def follow(self, workspace: Workspace, outsides: Sequence[Outside]) -> None:
        """Go on with other obstacles; checkers that were handed out ask them too, from their next call on.

        What is known outside the grid is read from the box of ``outsides`` itself, which is the one passed before.
        """
        with self._once.lock:
            self._workspace = workspace
            self._once.drop("scene", "distances")

    def _count(self, kind: str, distances: int) -> None:
        with self._lock:
            self._counts[kind] += distances > 0
            self._counts["distance"] += distances

    def _ask_point(self, q: Point) -> bool:
        """Whether a configuration is free, by the geometry alone."""
        self._count("point", 1)
        if self._room_at(q) <= 0.0:
            return False
        scene = self._scene()
        found = scene.convex.clear(q, q, self._least(q))
        if found is None:
            found = self._spare(q, 0.0) > 0.0
        return found and not scene.nesting.at(q)

    def _ask_edge(self, start: Point, end: Point) -> bool:
        """Whether an edge is free that the map alone does not prove."""
        if not sum(map(abs, (*start, *end))) <= 2.0 * MAX_COORDINATE * self._spacing:
            return False
        if min(self._room_at(start), self._room_at(end)) <= 0.0:
            return False
        free, asked = self._advance(start, end)
        self._count("edge", asked)
        return free

    def _advance(self, start: Point, end: Point) -> tuple[bool, int]:
        """Whether an edge is free, and how many distances that took.

        Pieces are proven by the map; by planes that separate all that the robot sweeps from the obstacles; or by the
        distance in their middle, which may leave a part on either side.
        """
        walk, state_at, scene = self._lookups.edge_checker(), self._state_at(), self._scene()
        length, asked, pieces, nested = math.dist(start, end), 0, [(0.0, 1.0)], False
        while pieces:
            first, last = pieces.pop()
            middle = 0.5 * (first + last)
            q, ends = _between(start, end, middle), (_between(start, end, first), _between(start, end, last))
            if walk(*ends[0], *ends[1]):
                continue
            state = state_at(*q)
            if state == BLOCKED or asked == MOST_DISTANCES:
                return False, asked
            reach = (last - first) * length
            if reach > SLIDE * self._spacing or (not scene.convex.refutes and state == FREE and reach > self._spacing):
                pieces += [(middle, last), (first, middle)]
                continue
            asked += 1
            found = scene.convex.clear(*ends, self._least(start, end))
            part = math.inf
            if found is None:
                spare = self._spare(q, 0.5 * reach / ADVANCE)
                found, part = spare > 0.0, ADVANCE * spare / length if length > 0.0 else math.inf
            # As long as no surfaces meet, whether one lies within the other stays as it is.
            if not found or part < SHORTEST or (not nested and scene.nesting.at(q)):
                return False, asked
            nested = True
            if part < 0.5 * (last - first):
                pieces += [(middle + part, last), (first, middle - part)]
        return True, asked

    def _least(self, *places: Point) -> float:
        """What a distance has to exceed, but for the error of FCL."""
        return self._margin + ROUNDING * (self._far + self._margin + sum(abs(x) for q in places for x in q))

    def _room_at(self, q: Point) -> float:
        """By how much the robot is farther from the walls than it has to be; infinite where there are none."""
        if not self._walled:
            return math.inf
        return min(min(x - low, high - x) for x, (low, high) in zip(q, self._room, strict=True)) - self._least(q)

    def _spare(self, q: Point, enough: float) -> float:
        """By how much FCL's distance at a configuration is more than counts, or a lower bound above ``enough``."""
        distances = self._once("distances", self._make_distances)
        least = self._least(q) + distances.error
        # The next float above, so that zero is never enough.
        return distances.least(*q, math.nextafter(least + enough, math.inf)) - least

    def _state_at(self) -> Callable[..., int]:
        from cspace.spatial import _kernels

        return self._once("state of", lambda: entry(_kernels.state_at, self._map, 3))

    def _scene(self) -> _Scene:
        """The surfaces of the robot and of the obstacles, and what they enclose."""
        return self._once("scene", self._make_scene)

    def _make_scene(self) -> _Scene:
        from cspace.exact.nesting import Nesting
        from cspace.exact.surfaces import obstacle_surfaces, robot_surfaces
        from cspace.exact.sweeps.convex import Convex

        robot = robot_surfaces(self._body)
        obstacles = obstacle_surfaces(self._workspace, walled=self._walled)
        convex = Convex(self._body, robot, obstacles, self._scale, self._margin)
        if not convex.refutes:
            fcl_module()  # tells at once if it is not there
        deep = not convex.refutes or isinstance(self._body, Mesh)
        return _Scene(robot, obstacles, Nesting(self._workspace, obstacles, self._body, robot, deep), convex)

    def _make_distances(self) -> Distances:
        from cspace.exact.distances import Distances

        return Distances(self._scene().robot, self._scene().obstacles, self._scale)


@dataclass(frozen=True, slots=True)
class _Scene:
    """Surfaces of the robot and of the obstacles, what they enclose, and proofs for a robot of convex parts."""

    robot: list[Surface]
    obstacles: list[Surface]
    nesting: Nesting
    convex: Convex


def _between(start: Point, end: Point, part: float) -> Point:
    (x, y, z), (u, v, w) = start, end
    return x + part * (u - x), y + part * (v - y), z + part * (w - z)

"""Look-ups that ask the geometry itself where the map cannot decide.

FREE and BLOCKED cells answer at once. In MIXED ones, and outside the grid, distances between the borders of the placed
robot and of the obstacles decide. A motion without a turn is proven by the distance from what the border sweeps; one
with a turn by conservative advancement (B. Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996): a
distance proves all configurations that are so near that no point of the robot can cross it.

*Rounding.* All sets are closed: touching is a collision. A distance counts only where it exceeds the margin by
``YAW_SLACK`` (1e-9) times the robot's span and 1e-12 times the largest coordinates of the map, the robot and the
configurations. The first covers yaws that are off by the rounding of their wrapping; the second the few roundings of
placing a point (relative 2^-53) and of a distance between segments, with a factor of a thousand to spare.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.exact import ROUNDING
from cspace.exact.borders.pieces import body_of, scene_of
from cspace.once import Once
from cspace.outside import Outside
from cspace.rotations import YAW_SLACK
from cspace.translating import Kernel, entry

if TYPE_CHECKING:
    from cspace.questions import Questions
    from cspace.workspace import Workspace


class ExactLookups:
    """Exact look-ups of a map; each kernel takes arrays of shape (n, dof) and fills one of shape (n,).

    Parameters
    ----------
    space : CSpace
    outsides : sequence of Outside
        What is known outside the grid, for each slice.
    """

    def __init__(self, space: Questions, outsides: Sequence[Outside]) -> None:
        self._workspace, self._robot, self._margin = space.workspace, space.robot, space.margin
        self._walled, self._flat = space.outside == "blocked", space.rotations is None
        grid = space.grid
        self._map = (
            space.stack,
            space.slice_of,
            np.asarray((-np.pi, np.pi) if space.rotations is None else space.rotations.borders),
            np.array([*grid.lower, grid.spacing, *grid.upper]),
            np.array([outside.box for outside in outsides], dtype=np.int64),
            np.array([outside.state for outside in outsides], dtype=np.int64),
        )
        self._once = Once()
        self._asks: dict[str, Callable[..., int]] = {}
        self._kernels: dict[str, tuple[Any, int]] = {}
        self._lock = threading.Lock()
        self._counts = {"point": 0, "edge": 0, "distance": 0}

    @property
    def counts(self) -> dict[str, int]:
        """How many points and edges the map could not decide, and how many distances were computed for them."""
        with self._lock:
            return dict(self._counts)

    def points(self) -> Kernel:
        """Kernel of points: whether they are free."""
        from cspace.exact import _kernels

        return self._counting("point", _kernels.ask_points)

    def edges(self) -> Kernel:
        """Kernel of edges, along the shorter arc: whether they are free."""
        from cspace.exact import _kernels

        return self._counting("edge", _kernels.ask_edges)

    def point_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """``check(x, y)`` or ``check(x, y, yaw)``; ``quick`` tells whether a point is FREE."""
        from cspace.exact import _kernels

        asks, count = self._aimed("point", _kernels.ask_point, 3), self._count
        rest = (0.0,) if self._flat else ()

        def check(*q: float) -> bool:
            if quick(*q):
                return True
            asked = asks["point"](*q, *rest)
            if asked > 0 or asked < -1:
                count("point", 1, 1)
            return asked >= 0

        return check

    def edge_checker(self) -> Callable[..., bool]:
        """``check(x0, y0, x1, y1)`` or ``check(x0, y0, yaw0, x1, y1, yaw1)``: whether an edge is free."""
        from cspace.exact import _kernels

        asks, count = self._aimed("edge", _kernels.ask_edge, 6), self._count

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            asked = asks["edge"](x0, y0, yaw0, x1, y1, yaw1)
            if asked > 0 or asked < -1:
                count("edge", 1, asked if asked > 0 else -1 - asked)
            return asked >= 0

        def check_plane(x0: float, y0: float, x1: float, y1: float) -> bool:
            return check(x0, y0, 0.0, x1, y1, 0.0)

        return check_plane if self._flat else check

    def follow(self, workspace: Workspace, outsides: Sequence[Outside]) -> None:
        """Go on with other obstacles; checkers that were handed out ask them too, from their next call on."""
        with self._once.lock:
            self._workspace = workspace
            self._map[4][...] = [outside.box for outside in outsides]
            self._once.drop("scene")
            for kind, (kernel, floats) in self._kernels.items():
                self._asks[kind] = partial(self._aim, kind, kernel, floats)

    def _aimed(self, kind: str, kernel: Any, floats: int) -> dict[str, Callable[..., int]]:
        """The compiled questions by kind, this one among them; what it asks is made at once."""
        with self._once.lock:
            if kind not in self._kernels:
                self._kernels[kind] = kernel, floats
                self._asks[kind] = entry(kernel, self._scene(), floats)
        return self._asks

    def _aim(self, kind: str, kernel: Any, floats: int, *q: float) -> int:
        """The first question of a kind after the obstacles have changed."""
        with self._once.lock:
            self._asks[kind] = entry(kernel, self._scene(), floats)
        return self._asks[kind](*q)

    def _count(self, kind: str, asked: int, distances: int) -> None:
        with self._lock:
            self._counts[kind] += asked
            self._counts["distance"] += distances

    def _counting(self, kind: str, kernel: Any) -> Kernel:
        """A kernel that takes configurations of the map and adds to the counts what it took."""
        bound, flat = partial(kernel, *self._scene()), self._flat

        def run(*arrays: NDArray[Any]) -> int:
            counts = np.zeros(2, dtype=np.int64)
            points = [np.pad(part, ((0, 0), (0, 1))) if flat else part for part in arrays[:-1]]
            bad: int = bound(*points, arrays[-1], counts)
            self._count(kind, *counts.tolist())
            return bad

        return run

    def _scene(self) -> tuple[Any, ...]:
        """What every kernel takes first: the map, the obstacles and the robot."""
        return self._once("scene", self._make_scene)

    def _make_scene(self) -> tuple[Any, ...]:
        from cspace.exact._kernels import Map

        grid = self._workspace.grid
        far = float(np.abs([*grid.lower, *grid.upper]).max()) + self._robot.span
        least = self._margin + YAW_SLACK * self._robot.span + ROUNDING * (far + self._margin)
        scene = scene_of(self._workspace, walled=self._walled, least=least)
        return Map(*self._map), scene, body_of(self._robot)

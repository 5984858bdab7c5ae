"""Look-ups that ask the geometry itself where the map cannot decide."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.exact.boundaries import Kernel, Problem, Proofs
from cspace.map.batches import own
from cspace.workspace import Workspace

Floats = NDArray[np.float64]


def _in_plane(problem: Problem) -> Proofs:
    from cspace.exact.outlines import PlaneProofs

    return PlaneProofs(problem)


def _in_space(problem: Problem) -> Proofs:
    from cspace.exact.solids import SolidProofs

    return SolidProofs(problem)


_PROOFS: Final = {2: _in_plane, 3: _in_space}


def proofs_by_borders(problem: Problem) -> Proofs:
    """Proofs by the distance between the borders of the robot and of the obstacles."""
    return _PROOFS[problem.workspace.grid.dim](problem)


class Exact:
    """Exact look-ups of a map; each kernel takes arrays of shape (n, dof) and fills one of shape (n,)."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._proofs: Proofs | None = None
        self._lock = threading.RLock()

    def points(self) -> Kernel:
        """Kernel of points: whether they are free."""
        return self._made().points

    def edges(self) -> Kernel:
        """Kernel of edges, along the shorter arc: whether they are free."""
        return self._made().edges

    def distance(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        """Lower bound, proven, of the distance between robot and obstacles on a path that is free, metres.

        The path is given in pieces: by their middles, shape (n, dof), in metres and radians, and by the metres and the
        radians along each of them, shape (n,). No point of the robot is farther than half of both from where it is in
        the middle. Where all beyond the grid is obstacle, that counts too. Infinite where there is none.
        """
        return self._problem.margin + self._made().spare(own(points), lengths, turns)

    def point_checker(self, quick: Callable[..., bool]) -> Callable[..., bool]:
        """``check(*q)``; ``quick`` tells whether a point is FREE."""
        self._made()

        def check(*q: float) -> bool:
            return quick(*q) or self._made().point(*q) >= 0

        return check

    def edge_checker(self) -> Callable[..., bool]:
        """``check(*q0, *q1)``: whether an edge is free."""
        self._made()

        def check(*ends: float) -> bool:
            return self._made().edge(*ends) >= 0

        return check

    def renew(self, workspace: Workspace) -> None:
        """Ask the obstacles as they are now; checkers that were handed out do so from their next call on."""
        with self._lock:
            self._problem, self._proofs = self._problem._replace(workspace=workspace, prove=None), None

    def _made(self) -> Proofs:
        """The proofs among the obstacles as they are now."""
        proofs = self._proofs
        if proofs is None:
            with self._lock:
                if self._proofs is None:
                    self._proofs = (self._problem.prove or proofs_by_borders)(self._problem)
                proofs = self._proofs
        return proofs

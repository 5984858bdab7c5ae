"""Exact look-ups: the cells of the map answer where they decide, the geometry itself where they do not."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from cspace.arrays import FREE, MIXED, Bools, Floats, Ints
from cspace.exact.boundaries import Problem, Proofs
from cspace.exact.proofs import BorderProofs
from cspace.map.batches import own
from cspace.map.edges import edges_are_free
from cspace.map.points import classify
from cspace.map.storage import Map


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

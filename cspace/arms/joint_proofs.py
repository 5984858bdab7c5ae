"""Exact answers of a map of joints: the arm itself is asked where the cells do not decide."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cspace.arms.proofs import Scene, are_free
from cspace.exact.boundaries import Problem, Proofs
from cspace.exact.queries import proofs_by_borders
from cspace.map.edges import NO_BLOCKS, edges_are_free
from cspace.map.points import classify
from cspace.states import FREE, MIXED

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class JointProofs:
    """Proofs by an arm in a scene, as :class:`cspace.exact.boundaries.Proofs`, of a few of its joints.

    Parameters
    ----------
    scene : Scene
    numbers : ndarray of int64, shape (d,)
        Which numbers of the arm's configuration those of the map are.
    held : ndarray of float64, shape (arm.dof,)
        What the others are.
    ends : ndarray of float64, shape (d, 2)
        The part of each joint's way that is mapped; infinite where it turns for ever.
    problem : Problem
        The map.
    """

    def __init__(self, scene: Scene, numbers: Ints, held: Floats, ends: Floats, problem: Problem) -> None:
        self._scene, self._numbers, self._held, self._ends = scene, numbers, held, ends
        self._problem = problem

    @property
    def point(self) -> Callable[..., int]:
        return lambda *q: self._one(self.points, np.array([q]))

    @property
    def edge(self) -> Callable[..., int]:
        return lambda *ends: self._one(self.edges, *np.array(ends).reshape(2, 1, -1))

    def points(self, q: Floats, out: Bools) -> int:
        states = np.empty(len(q), dtype=np.uint8)
        bad = classify(self._problem.map, q, states)
        np.equal(states, FREE, out=out)
        return bad if bad >= 0 else self._ask(np.flatnonzero(states == MIXED), q, q, out)

    def edges(self, q0: Floats, q1: Floats, out: Bools) -> int:
        bad = edges_are_free(self._problem.map, NO_BLOCKS, q0, q1, out)
        return bad if bad >= 0 else self._ask(np.flatnonzero(~out), q0, q1, out)

    def spare(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        return self._in_joints.spare(points, lengths, turns)

    @cached_property
    def _in_joints(self) -> Proofs:
        """What tells distances in the joints, to the cells that are not FREE."""
        return proofs_by_borders(self._problem)

    def _ask(self, left: Ints, q0: Floats, q1: Floats, out: Bools) -> int:
        """Ask the arm about some of the motions, of which nothing is proven beyond the ends of the map."""
        low, high = self._ends.T
        inside = [((low <= q[left]) & (q[left] <= high)).all(axis=1) for q in (q0, q1)]
        left = left[inside[0] & inside[1]]
        out[left] = are_free(self._scene, *(self._whole(q[left]) for q in (q0, q1)))
        return -1

    def _whole(self, q: Floats) -> Floats:
        """Configurations of the arm, shape (n, arm.dof)."""
        rows = np.tile(self._held, (len(q), 1))
        rows[:, self._numbers] = q
        return rows

    @staticmethod
    def _one(ask: Callable[..., int], *rows: Floats) -> int:
        out = np.zeros(1, dtype=np.bool_)
        ask(*rows, out)
        return 0 if out[0] else -1

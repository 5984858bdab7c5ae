"""Exact answers of a map of joints: the arm's geometry decides where the cells do not."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from cspace.arms.proofs import Scene, are_free
from cspace.arrays import Bools, Floats, Ints
from cspace.exact.boundaries import Problem, Proofs
from cspace.exact.proofs import BorderProofs


class JointProofs:
    """Proofs by an arm in a scene, as :class:`cspace.exact.boundaries.Proofs`, of a few of its joints.

    Parameters
    ----------
    scene : Scene
    numbers : ndarray of int64, shape (d,)
        Which numbers of the arm's configuration those of the map are.
    held : ndarray of float64, shape (arm.dof,)
        What the others are.
    intervals : ndarray of float64, shape (d, 2)
        The part of each joint's range that is mapped; infinite for continuous joints.
    problem : Problem
        The map.
    """

    def __init__(self, scene: Scene, numbers: Ints, held: Floats, intervals: Floats, problem: Problem) -> None:
        self._scene, self._numbers, self._held, self._intervals = scene, numbers, held, intervals
        self._problem = problem

    def edge(self, *endpoints: float) -> bool:
        return bool(self.are_free(*np.array(endpoints).reshape(2, 1, -1))[0])

    def are_free(self, q0: Floats, q1: Floats) -> Bools:
        free, (low, high) = np.zeros(len(q0), dtype=np.bool_), self._intervals.T  # beyond them nothing is proven
        first, last = (((low <= q) & (q <= high)).all(axis=1) for q in (q0, q1))
        inside = np.flatnonzero(first & last)
        free[inside] = are_free(self._scene, *(self._whole(q[inside]) for q in (q0, q1)))
        return free

    def spare(self, points: Floats, lengths: Floats, turns: Floats) -> float:
        return self._in_joints.spare(points, lengths, turns)

    @cached_property
    def _in_joints(self) -> Proofs:
        """Proofs of distances in joint space, to the cells that are not FREE."""
        return BorderProofs(self._problem)

    def _whole(self, q: Floats) -> Floats:
        """Configurations of the arm, shape (n, arm.dof)."""
        rows = np.tile(self._held, (len(q), 1))
        rows[:, self._numbers] = q
        return rows

"""Straight edges, and what a path is cut into."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.space import CSpace
from planners.states import Floats, kind_of

DENSE_TURN: Final = math.radians(5.0)
"""Largest turn, in radians, between two rows of a dense path."""


@dataclass(frozen=True, slots=True)
class Pieces:
    """A path cut into short pieces.

    Attributes
    ----------
    middles : ndarray of float64, shape (n, dof)
    lengths : ndarray of float64, shape (n,)
        Metres of translation along each piece.
    turns : ndarray of float64, shape (n,)
        Radians by which the robot turns along each piece, zero or above.
    """

    middles: Floats
    lengths: Floats
    turns: Floats


@dataclass(frozen=True, slots=True)
class StraightEdges:
    """Straight edges, along which the robot turns evenly and the shorter way, as in OMPL's SE(2) and SE(3).

    Parameters
    ----------
    space : CSpace
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.
    """

    space: CSpace
    exact: bool = False

    def states(self) -> ob.StateSpace:
        return kind_of(self.space).make()

    def edge_checker(self) -> Callable[..., bool]:
        return self.space.edge_checker(exact=self.exact)

    def are_free(self, path: Floats) -> bool:
        firsts, lasts = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
        return bool(np.all(self.space.motion_is_free(firsts, lasts, exact=self.exact)))

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        steps, lengths, turns, counts = self._measured(path, step, turn)
        edge, number = numbered(counts)
        middles = self.space.rotations.moved(path[:-1][edge], ((number + 0.5) / counts[edge])[:, None] * steps[edge])
        return Pieces(middles, (lengths / counts)[edge], (turns / counts)[edge])

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        if len(path) < 2:
            return path, None
        steps, _, turns, counts = self._measured(path, self.space.grid.spacing, DENSE_TURN)
        if not turns.any():
            return path, None
        counts = np.where(turns > 0.0, counts, 1)
        edge, number = numbered(counts)
        rotations, shares = self.space.rotations, (number / counts[edge])[:, None]
        rows = rotations.canonical(rotations.moved(path[:-1][edge], shares * steps[edge]))
        rows[number == 0] = path[:-1]
        return np.concatenate([rows, path[-1:]]), None

    def _measured(self, path: Floats, step: float, turn: float) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
        """What leads along each edge, its metres and radians, and the number of pieces that it is cut into."""
        dim = self.space.grid.dim
        steps = self.space.rotations.steps(path[:-1], path[1:])
        lengths, turns = np.linalg.norm(steps[:, :dim], axis=1), np.linalg.norm(steps[:, dim:], axis=1)
        counts = np.maximum(np.ceil(np.maximum(lengths / step, turns / turn)), 1.0).astype(np.int64)
        return steps, lengths, turns, counts


def numbered(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For ``counts[k]`` pieces of each edge k: the edge of each piece, and the piece's number on it."""
    edge = np.repeat(np.arange(len(counts)), counts)
    return edge, np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)

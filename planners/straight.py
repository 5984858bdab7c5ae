"""Straight edges, and what a path is cut into."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.rotations import TURN
from planners.states import kind_of

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]

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
        Radians by which yaw changes along each piece, zero or above.
    """

    middles: Floats
    lengths: Floats
    turns: Floats


@dataclass(frozen=True, slots=True)
class Straight:
    """Straight edges; yaw, where there is one, turns evenly along the shorter arc, as OMPL's SE(2) does.

    Parameters
    ----------
    space : CSpace
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.
    """

    space: CSpace
    exact: bool = False

    def states(self) -> Any:
        return kind_of(self.space).states()

    def edge_checker(self) -> Callable[..., bool]:
        return self.space.edge_checker(**exactly(self.exact))

    def are_free(self, path: Floats) -> bool:
        firsts, lasts = (path[:-1], path[1:]) if len(path) > 1 else (path, path)
        return bool(np.all(self.space.motion_is_free(firsts, lasts, **exactly(self.exact))))

    def lengths(self, path: Floats) -> Floats:
        places = path[:, : self.space.grid.dim]
        return np.asarray([math.dist(a, b) for a, b in itertools.pairwise(places)])

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        dim = self.space.grid.dim
        steps = _steps(path, dim)
        lengths, turns = np.linalg.norm(steps[:, :dim], axis=1), np.abs(steps[:, dim:]).sum(axis=1)
        counts = np.maximum(np.ceil(np.maximum(lengths / step, turns / turn)), 1.0).astype(np.int64)
        edge, number = _numbered(counts)
        middles = path[:-1][edge] + ((number + 0.5) / counts[edge])[:, None] * steps[edge]
        return Pieces(middles, (lengths / counts)[edge], (turns / counts)[edge])

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        if self.space.rotations is None or len(path) < 2:
            return path, None
        steps = _steps(path, 2)
        far = np.hypot(steps[:, 0], steps[:, 1]) / self.space.grid.spacing
        counts = np.maximum(np.ceil(np.maximum(far, np.abs(steps[:, 2]) / DENSE_TURN)), 1.0).astype(np.int64)
        edge, number = _numbered(counts)
        rows = path[:-1][edge] + (number / counts[edge])[:, None] * steps[edge]
        rows[:, 2] = np.where(number == 0, rows[:, 2], wrapped(rows[:, 2]))
        return np.concatenate([rows, path[-1:]]), None


def exactly(exact: bool) -> dict[str, bool]:
    """The argument that asks a look-up to be exact; none where it shall not be."""
    return {"exact": True} if exact else {}


def wrap(yaw: float) -> float:
    """Yaw in [-pi, pi); unchanged, to the last bit, where it is there already."""
    if -math.pi <= yaw < math.pi:
        return yaw
    turned = (yaw + math.pi) % TURN - math.pi
    return turned if turned < math.pi else -math.pi


def wrapped(yaw: Floats) -> Floats:
    """An array of yaw in [-pi, pi); what is there already is unchanged."""
    turned = (yaw + math.pi) % TURN - math.pi
    turned[turned >= math.pi] = -math.pi
    return np.where((yaw >= -math.pi) & (yaw < math.pi), yaw, turned)


def _steps(path: Floats, dim: int) -> Floats:
    """Differences of the rows of a path: of positions in ``dim`` numbers, and of yaw along the shorter arc."""
    steps = np.diff(path, axis=0)
    steps[:, dim:] -= TURN * np.round(steps[:, dim:] / TURN)
    return steps


def _numbered(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For ``counts[k]`` pieces of each edge k: the edge of each piece, and the piece's number on it."""
    edge = np.repeat(np.arange(len(counts)), counts)
    return edge, np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)

"""Curves of cars: shortest ways of a bounded curvature, forwards alone or in both directions.

References
----------
L. E. Dubins, "On curves of minimal length with a constraint on average curvature", 1957; J. A. Reeds and L. A. Shepp,
"Optimal paths for a car that goes both forwards and backwards", 1990.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.compiling import entry
from planners.straight import DENSE_TURN, Pieces, wrapped

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]

CURVES: Final = ("dubins", "reeds-shepp")
"""Names of the curves, in the order of their numbers in the kernels."""

_SPACES: Final[tuple[Callable[[float], Any], ...]] = (ob.DubinsStateSpace, ob.ReedsSheppStateSpace)


@dataclass(frozen=True, slots=True)
class Curve:
    """Edges along the shortest curve of a car.

    Every edge is proven along the real curve: it is cut into pieces, and all cells are FREE that meet the box of
    configurations which a piece cannot leave (:func:`planners._kernels.curve_is_free`). A curve that leaves the grid is
    not proven. Where several curves are equally short, ours may be another than OMPL's; all of them are proven.

    Parameters
    ----------
    space : CSpace
        With rotations.
    kind : int
        Index into :data:`CURVES`.
    radius : float
        Turning radius in metres.
    """

    space: CSpace
    kind: int
    radius: float

    def states(self) -> Any:
        return _SPACES[self.kind](self.radius)

    def edge_checker(self) -> Callable[..., bool]:
        return self._checker(measured=False)

    def length_prover(self) -> Callable[..., float]:
        """As :meth:`edge_checker`; it gives the metres of the curve where that is proven free, and otherwise -1."""
        return self._checker(measured=True)

    def _checker(self, measured: bool) -> Callable[..., Any]:
        from planners import _kernels

        space, grid = self.space, self.space.grid
        frame = np.array([*grid.lower, grid.spacing, *grid.upper])
        nothing = np.array([0, 0, -1, -1], dtype=np.int64)
        borders = np.asarray(space.rotations.borders) if space.rotations else np.empty(0)
        fixed = (space.stack, space.slice_of, borders, frame, nothing, self.kind, self.radius)
        return entry(_kernels.proven_length if measured else _kernels.curve_is_free, fixed, 6)

    def are_free(self, path: Floats) -> bool:
        check = self.edge_checker()
        rows = path.tolist()
        lasts = rows[1:] if len(rows) > 1 else rows
        return all(check(*a, *b) for a, b in zip(rows, lasts, strict=False))

    def lengths(self, path: Floats) -> Floats:
        return np.asarray([self._cut(a, b)[1].sum() for a, b in itertools.pairwise(path)])

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        parts = []
        for a, b in itertools.pairwise(path):
            turns, lengths = self._cut(a, b)
            counts = self._counts(turns, lengths, step, turn)
            number, position = _positions(counts, lengths, 0.5)
            # Both ends, too: an edge may be a hair long and have no step at all.
            parts.append((np.stack([a, b]), np.zeros(2), np.zeros(2)))
            each = (lengths / np.maximum(counts, 1))[number]
            parts.append((self.points(a, b, position), each, np.abs(turns[number]) * each / self.radius))
        if not parts:
            return Pieces(np.empty((0, 3)), np.empty(0), np.empty(0))
        middles, sizes, angles = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Pieces(middles, sizes, angles)

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        rows, ways = [path[:1]], [np.ones(0, dtype=np.int8)]
        for a, b in itertools.pairwise(path):
            turns, lengths = self._cut(a, b)
            number, position = _positions(
                self._counts(turns, lengths, self.space.grid.spacing, DENSE_TURN), lengths, 1.0
            )
            if not len(position):
                number, position = np.zeros(1, dtype=np.int64), np.zeros(1)
            points = self.points(a, b, position)
            points[:, 2] = wrapped(points[:, 2])
            points[-1] = b
            rows.append(points)
            ways.append(self._signs(a, b)[number])
        direction = np.concatenate(ways)
        first = direction[:1] if len(direction) else np.ones(1, dtype=np.int8)
        return np.concatenate(rows), np.concatenate([first, direction])

    def points(self, first: Floats, last: Floats, position: Floats) -> Floats:
        """Configurations at distances in metres, shape (n,), along the curve from one to another; shape (n, 3)."""
        from planners.words import _kernels

        turns, lengths, _ = self._word(first, last)
        out = np.empty((len(position), 3))
        x, y, yaw, begin = 0.0, 0.0, float(first[2]), 0.0
        distance = position / self.radius
        for turn, length in zip(turns, lengths, strict=True):
            # Whoever lies further on is overwritten by a later piece.
            on = distance >= begin - 1e-12
            along = math.copysign(1.0, length) * np.clip(distance[on] - begin, 0.0, abs(length))
            after = yaw + turn * along
            if turn:
                dx, dy = turn * (np.sin(after) - math.sin(yaw)), turn * (math.cos(yaw) - np.cos(after))
            else:
                dx, dy = along * math.cos(yaw), along * math.sin(yaw)
            out[on] = np.stack([first[0] + self.radius * (x + dx), first[1] + self.radius * (y + dy), after], axis=-1)
            x, y, yaw = _kernels.onwards(x, y, yaw, turn, length)
            begin += abs(length)
        return out

    def _word(self, first: Floats, last: Floats) -> Any:
        from planners.words import _kernels

        return _kernels.shortest(self.kind, self.radius, *map(float, first), *map(float, last))

    def _cut(self, first: Floats, last: Floats) -> tuple[Floats, Floats]:
        """Turns, and lengths in metres without sign, of the parts of a curve."""
        turns, lengths, _ = self._word(first, last)
        return np.asarray(turns, dtype=np.float64), self.radius * np.abs(lengths)

    def _signs(self, first: Floats, last: Floats) -> NDArray[np.int8]:
        return np.where(np.asarray(self._word(first, last)[1]) < 0.0, -1, 1).astype(np.int8)

    def _counts(self, turns: Floats, lengths: Floats, step: float, turn: float) -> NDArray[np.int64]:
        """In how many steps to take each part of a curve; rounding makes some parts a hair long, which are left out."""
        steps = np.where(turns != 0.0, min(step, turn * self.radius), step)
        return np.where(lengths > 1e-9 * self.radius, np.ceil(lengths / steps), 0.0).astype(np.int64)


def _positions(counts: NDArray[np.int64], lengths: Floats, where: float) -> tuple[NDArray[np.int64], Floats]:
    """Part of each step, and how far along the curve it is: at its middle (where = 0.5) or at its end (1)."""
    number = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts)
    begin = np.cumsum(lengths) - lengths
    return number, begin[number] + (step + where) / counts[number] * lengths[number]

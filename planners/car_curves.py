"""Curves of cars: the shortest curves of a bounded curvature, forwards alone or in both directions.

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
from typing import Final

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

from cspace.orientation import wrapped
from cspace.space import CSpace
from planners.states import Floats
from planners.straight_edges import DENSE_TURN, Pieces, numbered

CURVES: Final = ("dubins", "reeds-shepp")
"""Names of the curves, in the order of their numbers in the kernels."""

_SPACES: Final[tuple[Callable[[float], ob.StateSpace], ...]] = (ob.DubinsStateSpace, ob.ReedsSheppStateSpace)


@dataclass(frozen=True, slots=True)
class CarCurves:
    """Edges along the shortest curve of a car.

    Every edge is proven along the real curve: it is cut into pieces, and all cells are FREE that meet the box of
    configurations which a piece cannot leave (:mod:`planners.curve_proof`). A curve that leaves the grid is not proven.
    Where several curves are equally short, ours may be another than OMPL's; all of them are proven.

    Parameters
    ----------
    space : CSpace
        Of a robot that turns in the plane.
    kind : int
        Index into :data:`CURVES`.
    radius : float
        Turning radius in metres.
    """

    space: CSpace
    kind: int
    radius: float

    def states(self) -> ob.StateSpace:
        return _SPACES[self.kind](self.radius)

    def edge_checker(self) -> Callable[..., bool]:
        prove = self.length_prover()
        return lambda *q: prove(*q) >= 0.0

    def length_prover(self) -> Callable[..., float]:
        """``prove`` of the floats of two configurations: the metres of the curve where it is proven free, else -1."""
        from planners.curve_proof import prover

        return prover(self.space, self.kind, self.radius)

    def are_free(self, path: Floats) -> bool:
        check = self.edge_checker()
        rows = path.tolist()
        lasts = rows[1:] if len(rows) > 1 else rows
        return all(check(*a, *b) for a, b in zip(rows, lasts, strict=False))

    def length(self, first: Floats, last: Floats) -> float:
        """Metres of the curve between two configurations."""
        return self.radius * float(np.abs(self._word(first, last)[1]).sum())

    def pieces(self, path: Floats, step: float, turn: float) -> Pieces:
        cuts = [self._cut(a, b, step, turn, 0.5)[:3] for a, b in itertools.pairwise(path)]
        if not cuts:
            return Pieces(np.empty((0, 3)), np.empty(0), np.empty(0))
        return Pieces(*(np.concatenate(column) for column in zip(*cuts, strict=True)))

    def dense(self, path: Floats) -> tuple[Floats, NDArray[np.int8] | None]:
        rows, signs = [path[:1]], [np.ones(0, dtype=np.int8)]
        for a, b in itertools.pairwise(path):
            points, _, _, ahead = self._cut(a, b, self.space.grid.spacing, DENSE_TURN, 1.0)
            points[:, 2] = wrapped(points[:, 2])
            points[-1] = b
            rows.append(points)
            signs.append(ahead)
        direction = np.concatenate(signs)
        first = direction[:1] if len(direction) else np.ones(1, dtype=np.int8)
        return np.concatenate(rows), np.concatenate([first, direction])

    def points(self, first: Floats, last: Floats, position: Floats) -> Floats:
        """Configurations at distances in metres, shape (n,), along the curve from one to another; shape (n, 3)."""
        turns, lengths = self._word(first, last)
        out = np.empty((len(position), 3))
        x, y, yaw, begin = 0.0, 0.0, float(first[2]), 0.0
        distance = position / self.radius
        for turn, length in zip(turns.tolist(), lengths.tolist(), strict=True):
            # Whoever lies further on is overwritten by a later piece.
            on = np.append(distance >= begin - 1e-12, True)
            along = np.append(distance, begin + abs(length))[on] - begin
            along = math.copysign(1.0, length) * np.clip(along, 0.0, abs(length))
            after = yaw + turn * along
            if turn:
                dx, dy = turn * (np.sin(after) - math.sin(yaw)), turn * (math.cos(yaw) - np.cos(after))
            else:
                dx, dy = along * math.cos(yaw), along * math.sin(yaw)
            placed = np.stack([first[0] + self.radius * (x + dx), first[1] + self.radius * (y + dy), after], axis=-1)
            out[on[:-1]] = placed[:-1]
            x, y, yaw, begin = x + float(dx[-1]), y + float(dy[-1]), float(after[-1]), begin + abs(length)
        return out

    def _word(self, first: Floats, last: Floats) -> tuple[Floats, Floats]:
        """The turns of the parts of a curve, 1, -1 or 0, and their lengths in radii, below zero in reverse."""
        from planners.shortest_curves import shortest

        turns, lengths, _ = shortest(self.kind, self.radius, tuple(first.tolist()), tuple(last.tolist()))
        return np.asarray(turns, dtype=np.float64), np.asarray(lengths)

    def _cut(
        self, first: Floats, last: Floats, step: float, turn: float, where: float
    ) -> tuple[Floats, Floats, Floats, NDArray[np.int8]]:
        """A curve in steps: a configuration of each, at its middle (where = 0.5) or its end (1); metres, radians, sign.

        Rounding makes some parts a hair long, which are left out; but a curve has one step at least.
        """
        turns, lengths = self._word(first, last)
        metres = self.radius * np.abs(lengths)
        longest = np.where(turns != 0.0, min(step, turn * self.radius), step)
        counts = np.where(metres > 1e-9 * self.radius, np.maximum(np.ceil(metres / longest), 1.0), 0.0).astype(np.int64)
        counts[np.argmax(metres)] += not counts.any()
        part, number = numbered(counts)
        each = (metres / np.maximum(counts, 1))[part]
        position = (np.cumsum(metres) - metres)[part] + (number + where) * each
        signs = np.where(lengths < 0.0, -1, 1).astype(np.int8)[part]
        return self.points(first, last, position), each, np.abs(turns[part]) * each / self.radius, signs

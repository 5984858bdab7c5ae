"""Links and obstacles as the proofs take them: borders in trees, closed surfaces, and points of what hangs together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arms.chain import Chain
from cspace.arms.proofs import Scene, Solids
from cspace.exact import ROUNDING
from cspace.exact.boundaries import anchors_of, joined
from cspace.exact.triangles import trees_of
from cspace.shapes import Mesh, Pieces, Shape

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


PROBES: Final = 60
"""About how many corners of each part, and points within, are looked for in others, to prove that they collide."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A shape where it is in the frame of a body.

    Attributes
    ----------
    shape : Shape
        In space, metres.
    pose : ndarray of float64, shape (4, 4)
        From its own frame to that of the body.
    """

    shape: Shape
    pose: Floats

    @cached_property
    def sides(self) -> tuple[Placed, Placed]:
        """It from outside, and from within, where it is known by two others."""
        outer, inner = self.shape.sides
        placed = Placed(outer, self.pose)
        return placed, placed if inner is outer else Placed(inner, self.pose)

    def moved(self, points: Floats) -> Floats:
        """Points of its own frame in that of the body, shape (..., 3)."""
        return np.asarray(points @ self.pose[:3, :3].T + self.pose[:3, 3])

    @cached_property
    def border(self) -> Pieces:
        """Its border, as triangles."""
        simplices, radii = self.shape.boundary()
        return joined([Pieces(self.moved(simplices), radii)], 3, 3)

    @cached_property
    def surface(self) -> tuple[Floats, Ints]:
        """The triangles that enclose something, shape (n, 3, 3), and how often each counts."""
        if not self.shape.encloses or self.shape.boundary().simplices.shape[1] < 3:
            return np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
        vertices, faces = self.shape.surface
        return Mesh(self.moved(vertices), faces).closed  # corners stay shared to the last bit

    @cached_property
    def anchors(self) -> Floats:
        """A point of each part that hangs together, shape (n, 3)."""
        return anchors_of(self.border)[0]

    @cached_property
    def probes(self) -> Floats:
        """Some corners of its border, and points of a lattice that lie in it, shape (n, 3)."""
        corners = np.unique(self.border.simplices.reshape(-1, 3), axis=0)
        some = corners[:: -(-len(corners) // PROBES)]
        if not self.shape.encloses:
            return some
        lower, upper = self.shape.bounds
        sides = upper - lower
        step = max(float(np.cbrt(sides.prod() / PROBES)), float(sides.max()) / PROBES)
        counts = np.maximum(1, np.rint(sides / step)).astype(np.int64)
        lattice = lower + (np.indices(tuple(counts.tolist())).reshape(3, -1).T + 0.5) * sides / counts
        return np.concatenate([some, self.moved(lattice[self.shape.contains(lattice)])])


class Solid(NamedTuple):
    """What moves as one and is asked about as one: a link, or an obstacle.

    Attributes
    ----------
    name : str
    body : int
    parts : tuple of Placed
    """

    name: str
    body: int
    parts: tuple[Placed, ...]


def solids_of(solids: Sequence[Solid], side: int) -> Solids:
    """The solids from outside, 0, or from within, 1, as compiled code takes them.

    From outside, their anchors are one point of each part that hangs together, from within :attr:`Placed.probes`.
    """
    parts = [[part.sides[side] for part in solid.parts] for solid in solids]
    surfaces = [[part.surface for part in each if len(part.surface[0])] for each in parts]
    points = [[part.probes if side else part.anchors for part in each] for each in parts]
    trees, roots = trees_of([joined([part.border for part in each], 3, 3) for each in parts], about_z=False)
    closed = [surface for each in surfaces for surface in each]
    return Solids(
        bodies=np.array([solid.body for solid in solids], dtype=np.int64),
        trees=trees,
        nodes=np.array(roots, dtype=np.int64).reshape(-1, 3),
        triangles=np.concatenate([np.empty((0, 3, 3)), *(corners for corners, _ in closed)]),
        turns=np.concatenate([np.empty(0, np.int64), *(turns for _, turns in closed)]),
        boxes=np.array([[*c.min((0, 1)), *c.max((0, 1))] for c, _ in closed]).reshape(-1, 6),
        firsts=_starts(len(corners) for corners, _ in closed),
        anchors=np.concatenate([np.empty((0, 3)), *(part for each in points for part in each)]),
        starts=np.stack([_starts(map(len, surfaces)), _starts(sum(map(len, each)) for each in points)], axis=1),
    )


def _starts(counts: Iterable[int]) -> Ints:
    return np.cumsum([0, *counts], dtype=np.int64)


def scene_of(
    chain: Chain, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]], side: int, margin: float = 0.0
) -> Scene:
    """Solids from outside, 0, or from within, 1, of which those of some pairs, by their numbers, may not touch."""
    borders = [part.sides[0].border for solid in solids for part in solid.parts]
    far = max((float(np.abs(b.simplices).max() + b.radii.max()) for b in borders), default=0.0)
    far += float(chain.lengths.max())
    chosen = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return Scene(chain, solids_of(solids, side), chosen, margin + 2.0 * ROUNDING * far)

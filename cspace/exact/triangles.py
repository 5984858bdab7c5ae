"""Distances in space between the border of a placed robot and that of the obstacles, by coal.

coal (J. Pan, S. Chitta, D. Manocha, "FCL: a general purpose library for collision and proximity queries", 2012, and
its heirs) is asked for the distance between sets of triangles in trees of bounding volumes, and never for its convex
shapes: those go through an iteration that stops at about 1e-6. A ball is a triangle without size, its middle, grown by
its radius; triangles of one radius share a tree.

*Rounding.* The distance of two triangles can be too large in three ways, and :attr:`Distances.error` bounds them:

* Edges that cross and are all but parallel: the parameter of the nearest point loses all its digits at an angle of
  the square root of the rounding unit, which is about 1e-8 of the geometric mean of the edges' lengths. Where their
  direction apart is as wrong, coal may also take them for what is nearest and pass over a corner near a face. This is
  measured, not proven: among 10^5 pairs of such triangles one distance was too large by 3e-8 of their edges' lengths;
  four times that is allowed for.
* Triangles of hardly any height: their normal loses as many digits as the height lacks. Those below a millionth of a
  hundredth of their length are replaced by their longest edge, and the height counts as error.
* Triangles whose normal is shorter than a fixed number: they are treated as if they had no inside. So all lengths are
  multiplied by a power of two before coal sees them, which makes that number too small to matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import MissingPackageError
from cspace.shapes import Pieces

Floats = NDArray[np.float64]

THIN: Final = 2.0**-26
"""Height of a triangle, in its longest edges, below which it counts as that edge."""

UNIT: Final = 2.0**-52
"""Rounding unit."""

REACH: Final = 40
"""The largest coordinate that coal sees is about two to this power, so that products of small ones stay above zero."""

FEW: Final = 8
"""Trees that are all asked; of more, boxes tell which."""


def coal_module() -> Any:
    """The package coal.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    try:
        import coal
    except ImportError as error:
        raise MissingPackageError(
            "coal", "is not installed", "exact answers in space need it", 'install it: pip install "cspace[exact]"'
        ) from error
    return coal


class Distances:
    """Distances between borders in space, the first of which is that of a robot that moves.

    Parameters
    ----------
    robot, obstacles : Pieces
        Triangles, metres.
    far : float
        A bound on the coordinates of either, placed, metres.

    Attributes
    ----------
    error : float
        By how much a distance may be too large at most, beside the rounding of the coordinates, metres.
    """

    def __init__(self, robot: Pieces, obstacles: Pieces, far: float) -> None:
        self._coal = coal_module()
        self._scale = float(2.0 ** (REACH - math.frexp(far)[1]))
        self._request = self._coal.DistanceRequest(False, 0.0, 0.0)
        self._request.enable_signed_distance = False
        self._home = self._coal.Transform3s.Identity()
        (moved, moved_error, moved_edge), (still, still_error, still_edge) = map(self._sized, (robot, obstacles))
        error = 32.0 * math.sqrt(UNIT * (moved_edge + still_edge) * min(moved_edge, still_edge))
        self.error = (error + moved_error + still_error) / self._scale
        self._robot, self._obstacles = self._trees(moved, robot.radii), self._trees(still, obstacles.radii)
        boxes = np.array([tree.box for tree in self._obstacles]).reshape(-1, 2, 3)
        self._lower, self._upper = boxes[:, 0], boxes[:, 1]

    def __call__(self, place: Sequence[float], turn: Floats, enough: float) -> float:
        """The distance with the robot turned by a matrix, shape (3, 3), and moved to a place, or ``enough`` if less.

        Zero or below where the borders meet.
        """
        coal, scale, best = self._coal, self._scale, enough
        at, result = coal.Transform3s(turn, scale * np.array(place)), coal.DistanceResult()
        for part in self._robot:
            for tree in self._obstacles if len(self._obstacles) <= FEW else self._near(part, place, turn, best):
                grown = part.radius + tree.radius
                # coal looks for what is nearer than the least distance found so far, which we set: then it is quick.
                result.min_distance = cut = scale * (best + grown)
                found: float = coal.distance(part.model, at, tree.model, self._home, self._request, result)
                if found < cut:
                    best = min(best, found / scale - grown)
                    if best <= 0.0:
                        return best
        return best

    def _near(self, part: _Tree, place: Sequence[float], turn: Floats, best: float) -> list[_Tree]:
        """The trees of obstacles that may be nearer to a part of the robot than a distance, the nearest box first."""
        half = np.abs(turn) @ (0.5 * (part.box[1] - part.box[0]))
        middle = place + turn @ (0.5 * (part.box[0] + part.box[1]))
        apart = np.maximum(np.maximum(self._lower - (middle + half), (middle - half) - self._upper), 0.0)
        # What is that far is not asked, and its square would overflow.
        bounds = np.sqrt((np.minimum(apart, 1e100) ** 2).sum(axis=1))
        near = np.flatnonzero(bounds < best)
        return [self._obstacles[k] for k in near[np.argsort(bounds[near])].tolist()]

    def _trees(self, triangles: Floats, radii: Floats) -> list[_Tree]:
        """A tree for each radius."""
        different, first = np.unique(np.sort(radii), return_index=True)
        parts = np.split(triangles[np.argsort(radii, kind="stable")], first[1:])
        return [_Tree(self._coal, part, r, self._scale) for part, r in zip(parts, different.tolist(), strict=False)]

    def _sized(self, pieces: Pieces) -> tuple[Floats, float, float]:
        """Scaled triangles that have some height, with the error that they allow and their longest edge."""
        triangles = self._scale * pieces.simplices
        edges = np.roll(triangles, -1, axis=1) - triangles
        lengths = np.sqrt((edges**2).sum(axis=2))
        longest = lengths.max(axis=1)
        areas = np.sqrt((np.cross(edges[:, 0], edges[:, 1]) ** 2).sum(axis=1))
        thin = areas <= THIN * longest**2
        which, first = np.flatnonzero(thin), lengths[thin].argmax(axis=1)
        start, end = triangles[which, first], triangles[which, (first + 1) % 3]
        triangles[thin] = np.stack([start, end, end], axis=1)
        error = 2.0 * THIN * float(longest[thin].max(initial=0.0))
        error = max(error, 8.0 * UNIT * float((longest[~thin] ** 3 / areas[~thin]).max(initial=0.0)))
        return triangles, error, float(longest.max(initial=0.0))


class _Tree:
    """Scaled triangles of one radius in a tree, and the box around them in metres, radius included."""

    def __init__(self, coal: Any, triangles: Floats, radius: float, scale: float) -> None:
        points = np.ascontiguousarray(triangles.reshape(-1, 3))
        self.radius = radius
        self.box = np.array([points.min(axis=0) / scale - radius, points.max(axis=0) / scale + radius])
        self.model = coal.BVHModelOBBRSS()
        self.model.beginModel(len(triangles), len(points))
        self.model.addVertices(points)
        self.model.addTriangles(np.arange(len(points)).reshape(-1, 3))
        self.model.endModel()

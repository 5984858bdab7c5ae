"""Distances between the surface of a robot that translates and that of obstacles, by FCL.

FCL (Pan, Chitta, Manocha, "FCL: a general purpose library for collision and proximity queries", 2012) is asked for the
distance between sets of triangles in trees of bounding volumes, and never for its shapes: those go through an iteration
that stops at about 1e-6. The obstacles are cut into groups of a few hundred triangles; a box round each tells which are
to be asked.

*Rounding.* FCL's distance of two triangles can be too large in three ways, and :attr:`Distances.error` bounds them:

* Edges that cross and are all but parallel: the parameter of the nearest point loses all its digits at an angle of
  the square root of the rounding unit, which is about 1e-8 of the geometric mean of the edges' lengths.
* Triangles of hardly any height: their normal loses as many digits as the height lacks. Those below a millionth of a
  hundredth of their length are replaced by their longest edge, and the height counts as error.
* Triangles whose normal is shorter than a fixed number: they are treated as if they had no inside. So all lengths are
  multiplied by a power of two before FCL sees them, which makes that number too small to matter.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import MissingPackageError
from cspace.exact.surfaces import groups_of

if TYPE_CHECKING:
    from cspace.exact.surfaces import Surface

Floats = NDArray[np.float64]

THIN: Final = 2.0**-26
"""Height of a triangle, in its longest edges, below which it counts as that edge."""

UNIT: Final = 2.0**-52
"""Rounding unit."""


def fcl_module() -> Any:
    """The package python-fcl.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    try:
        import fcl
    except ImportError as error:
        raise MissingPackageError(
            "exact answers in space need the package python-fcl, which is not installed; "
            'install it with: pip install "cspace[exact]"'
        ) from error
    return fcl


class Distances:
    """Distances between surfaces, of which the first moves without turning.

    Parameters
    ----------
    robot, obstacles : sequence of Surface
        Metres.
    scale : float
        A power of two that takes the largest coordinate far from one.

    Attributes
    ----------
    error : float
        By how much a distance may be too large at most, beside the rounding of the coordinates, metres.
    """

    def __init__(self, robot: Sequence[Surface], obstacles: Sequence[Surface], scale: float) -> None:
        self._fcl = fcl_module()
        self._scale = scale
        self._request = self._fcl.DistanceRequest()
        self._lock = threading.Lock()
        moved, still = ([_Sized.of(surface, self._scale) for surface in side] for side in (robot, obstacles))
        edges = [max((surface.longest for surface in side), default=0.0) for side in (moved, still)]
        error = 4.0 * float(np.sqrt(UNIT * sum(edges) * min(edges)))
        error += sum(max((surface.error for surface in side), default=0.0) for side in (moved, still))
        self.error = error / self._scale
        self._parts = [_Part(self._model(s.triangles), s.radius, *self._bounds(s.triangles, s.radius)) for s in moved]
        self._groups = [_Group(triangles, s.radius) for s in still for triangles in groups_of(s.triangles)]
        corners = np.array([self._bounds(group.triangles, group.radius) for group in self._groups]).reshape(-1, 2, 3)
        self._lower, self._upper = corners[:, 0], corners[:, 1]

    def least(self, x: float, y: float, z: float, enough: float) -> float:
        """The distance with the robot at a place, or some lower bound of it that is ``enough`` or above.

        Zero or below where the surfaces meet.
        """
        q, best = np.array([x, y, z]), math.inf
        for part in self._parts:
            apart = np.maximum(self._lower - (q + part.upper), (q + part.lower) - self._upper)
            # What is that far is not asked, and its square would overflow.
            bounds: Floats = np.sqrt((np.clip(apart, 0.0, 1e100) ** 2).sum(axis=1))
            near = np.flatnonzero(bounds < min(best, enough))
            best = min(best, float(bounds[bounds >= enough].min(initial=math.inf)))
            for number in near[np.argsort(bounds[near])].tolist():
                if bounds[number] >= best:
                    break
                best = min(best, self._ask(part, self._groups[number], q))
                if best <= 0.0:
                    return best
        return best

    def _ask(self, part: _Part, group: _Group, q: Floats) -> float:
        """FCL's distance between a part of the robot and a group of triangles."""
        with self._lock:  # a part has one place at a time
            if group.model is None:
                group.model = self._model(group.triangles)
            part.model.setTranslation(self._scale * q)
            found: float = self._fcl.distance(part.model, group.model, self._request, self._fcl.DistanceResult())
        return float(found / self._scale - part.radius - group.radius)

    def _bounds(self, triangles: Floats, radius: float) -> tuple[Floats, Floats]:
        """Box round scaled triangles that are grown by a radius, metres."""
        points = triangles.reshape(-1, 3)
        return points.min(axis=0) / self._scale - radius, points.max(axis=0) / self._scale + radius

    def _model(self, triangles: Floats) -> Any:
        """Scaled triangles as an object of FCL."""
        model = self._fcl.BVHModel()
        model.beginModel(3 * len(triangles), len(triangles))
        model.addSubModel(np.ascontiguousarray(triangles.reshape(-1, 3)), np.arange(3 * len(triangles)).reshape(-1, 3))
        model.endModel()
        return self._fcl.CollisionObject(model)


@dataclass(slots=True)
class _Part:
    """A part of the robot, with its bounding box."""

    model: Any
    radius: float
    lower: Floats
    upper: Floats


@dataclass(slots=True)
class _Group:
    """Some triangles of the obstacles; their tree is made when it is first asked."""

    triangles: Floats
    radius: float
    model: Any = None


@dataclass(frozen=True, slots=True)
class _Sized:
    """A scaled surface whose triangles have some height, with the error that they allow and their longest edge."""

    triangles: Floats
    radius: float
    error: float
    longest: float

    @classmethod
    def of(cls, surface: Surface, scale: float) -> _Sized:
        triangles = scale * surface.triangles
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
        return cls(triangles, surface.radius, error, float(longest.max(initial=0.0)))

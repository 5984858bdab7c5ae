"""Shapes that are known by two others, one around them and one within; and solids of revolution, which are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats, Surface
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import STILL, Turn
from cspace.shapes.shape import Pieces, Shape

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

SIDES: Final = 64
"""Sides of the polygons that stand for circles: their radii differ by 0.12 % from those that they touch."""

_WIDER: Final = 1.0 / math.cos(math.pi / SIDES)
"""Radius of a polygon's corners where the sides touch a circle of radius 1."""

_ROUNDING: Final = 2.0**-40
"""By how much of itself a solid around another one is larger than it need be, for its corners are rounded."""

_QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""

Pair = tuple[Surface, Surface]
"""Two surfaces, the first of which encloses a solid that encloses the second."""


class Bracketed(Shape):
    """A shape that lies between two others.

    What is FREE is proven for the outer one and what is BLOCKED for the inner one, so that both hold for the shape.
    Exact answers, which only ever prove that a configuration is free, and drawings are about the outer one.

    Parameters
    ----------
    outer, inner : Shape
        Of one dimension; the shape encloses ``inner``, and ``outer`` encloses it.
    is_round_about_z : bool
        Whether every rotation about the z axis maps the shape to itself, whatever the two others look like.
    """

    def __init__(self, outer: Shape, inner: Shape, is_round_about_z: bool = False) -> None:
        self.outer, self.inner, self.dim = outer, inner, outer.dim
        self._turns = is_round_about_z

    @property
    def encloses(self) -> bool:  # type: ignore[override]
        return self.outer.encloses

    @property
    def span(self) -> float:
        return self.outer.span

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        return self.outer.bounds

    @property
    def measure(self) -> float:
        return self.outer.measure

    def rasters(self, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
        return self.outer.rasters(spacing, margin, turn)[0], self.inner.rasters(spacing, 0.0, turn)[1]

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        return self.outer.cells(grid)[0], self.inner.cells(grid)[1]

    def contains(self, points: ArrayLike) -> Bools:
        return self.outer.contains(points)

    def boundary(self) -> Pieces:
        return self.outer.boundary()

    @property
    def regions(self) -> list[Floats]:
        return self.outer.regions

    @property
    def outline(self) -> BaseGeometry:
        return self.outer.outline

    @property
    def surface(self) -> Surface:
        return self.outer.surface

    @property
    def is_round(self) -> bool:
        return self.dim == 2 and self._turns

    @property
    def is_round_about_z(self) -> bool:
        return self._turns

    def _features(self, matrix: Floats) -> Floats:
        rows = [side._features(matrix) for side in (self.outer, self.inner)]
        return np.concatenate([np.insert(part, 0, number, axis=1) for number, part in enumerate(rows)])

    def flattened(self) -> Shape:
        return Bracketed(self.outer.flattened().sides[0], self.inner.flattened().sides[1], self._turns)

    @property
    def sides(self) -> tuple[Shape, Shape]:
        return self.outer, self.inner

    @property
    def spec(self) -> dict[str, object]:
        sides = {"outer": self.outer.spec, "inner": self.inner.spec}
        return {"kind": "bracketed", **sides, "is_round_about_z": self._turns}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any], of: Callable[[Mapping[str, Any]], Shape]) -> Bracketed:
        """The shape of a :attr:`spec`, of which ``of`` makes the two others."""
        return cls(of(spec["outer"]), of(spec["inner"]), bool(spec["is_round_about_z"]))


def cylinder(radius: float, height: float) -> Pair:
    """A cylinder around the z axis with its middle in the origin, metres: a surface around it and one within."""
    profile = np.array([(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)]) * (radius, height)
    return _revolved(profile * (_WIDER, 1.0) * (1.0 + _ROUNDING)), _revolved(profile * (1.0 - _ROUNDING))


def cone(radius: float, height: float) -> Pair:
    """Return a surface around a cone, and one within it, metres.

    The cone stands upright around the z axis, tip up; the origin is halfway up.
    """
    profile = np.array([(0.0, -0.5), (1.0, -0.5), (0.0, 0.5)]) * (radius, height)
    return _revolved(profile * (_WIDER, 1.0) * (1.0 + _ROUNDING)), _revolved(profile * (1.0 - _ROUNDING))


def capsule(radius: float, length: float) -> Pair:
    """All within ``radius`` of a segment of the z axis with its middle in the origin; a ball, where it has no length.

    Gives a surface around it and one within, metres.
    """
    angle = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arc[-1, 0] = 0.0

    def profile(factor: float) -> Floats:
        upper = factor * arc + (0.0, length / 2.0)
        return np.concatenate([upper[::-1] * (1.0, -1.0), upper[0 if length else 1 :]])

    # The polygon of the arc touches it from outside, as that of each of its circles does.
    outer = profile(_WIDER) * (_WIDER, 1.0)
    return _revolved(outer * (1.0 + _ROUNDING)), _revolved(profile(1.0) * (1.0 - _ROUNDING))


def _revolved(profile: Floats) -> Surface:
    """The surface that a polygon makes about the z axis, with as many sides as there are to stand for a circle.

    Quarter turns about the axis map it to itself to the last bit; so do half turns about the others, where the profile
    is its own mirror image. That is, for each corner, shape (n, 2), its distance from the axis and its height, from the
    lowest to the highest, which are on the axis.
    """
    angle = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    cosines = np.append(np.cos(angle)[:-1], 0.0)
    quarter = np.stack([cosines, cosines[::-1]], axis=1)[:-1]
    ring = np.concatenate([np.stack([quarter @ (c, -s), quarter @ (s, c)], axis=1) for c, s in _QUARTERS])
    rings = [np.insert(radius * ring, 2, height, axis=1) for radius, height in profile[1:-1].tolist()]
    poles = np.array([(0.0, 0.0, profile[0, 1]), (0.0, 0.0, profile[-1, 1])])
    first, count = np.arange(SIDES), SIDES * len(rings)
    second = (first + 1) % SIDES
    faces: list[tuple[ArrayLike, ...]] = [
        (count, second, first),
        (count + 1, first + count - SIDES, second + count - SIDES),
    ]
    for low in range(0, count - SIDES, SIDES):
        above = low + SIDES
        faces += [(low + first, low + second, above + second), (low + first, above + second, above + first)]
    triangles = [np.stack(np.broadcast_arrays(*corners), axis=1) for corners in faces]
    return np.concatenate([*rings, poles]), np.concatenate(triangles)

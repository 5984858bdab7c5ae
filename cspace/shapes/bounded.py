"""Shapes that are known by an outer and an inner shape, such as solids of revolution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats, Surface
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.raster import Raster
from cspace.rotations import STILL, Turn
from cspace.shapes.shape import ExactShape, Shape

SIDES: Final = 64
"""Sides of the polygons that stand for circles: their radii differ by 0.12 % from those that they touch."""

_WIDER: Final = 1.0 / math.cos(math.pi / SIDES)
"""Radius of a polygon's corners where the sides touch a circle of radius 1."""

_ROUNDING: Final = 2.0**-40
"""By how much of itself a solid around another one is larger than it need be, for its corners are rounded."""

_BLURRED: Final = 2.0**-20
"""Largest part of itself by which an ellipse's polygons may be larger or smaller to allow for rounding."""

_QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""

Pair = tuple[Surface, Surface]
"""Two surfaces, the first of which encloses a solid that encloses the second."""


class BoundedShape(Shape):
    """A shape that is known only by an exact shape around it and an exact shape within it.

    FREE is proven for the outer shape and BLOCKED for the inner one, so that both hold for the shape itself. Exact
    answers prove only FREE, for the outer shape; drawings show the outer shape.

    Parameters
    ----------
    outer, inner : ExactShape
        Of the same dimension; ``outer`` contains the shape, which contains ``inner``.
    is_round_about_z : bool
        Whether every rotation about the z axis maps the shape to itself, even if it does not so map the bounds.
    """

    def __init__(self, outer: ExactShape, inner: ExactShape, is_round_about_z: bool = False) -> None:
        self._outer, self._inner, self.dim = outer, inner, outer.dim
        self._turns = is_round_about_z

    @property
    def outer(self) -> ExactShape:
        return self._outer

    @property
    def inner(self) -> ExactShape:
        return self._inner

    def rasters(self, spacing: float, margin: float = 0.0, turn: Turn = STILL) -> tuple[Raster, Raster]:
        return self.outer.rasters(spacing, margin, turn)[0], self.inner.rasters(spacing, 0.0, turn)[1]

    def cells(self, grid: Grid) -> tuple[Bools, Bools]:
        return self.outer.cells(grid)[0], self.inner.cells(grid)[1]

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
        return BoundedShape(self.outer.flattened().outer, self.inner.flattened().inner, self._turns)

    @property
    def spec(self) -> dict[str, object]:
        sides = {"outer": self.outer.spec, "inner": self.inner.spec}
        return {"kind": "bounded", **sides, "is_round_about_z": self._turns}

    @classmethod
    def from_spec(cls, spec: Mapping[str, Any], of: Callable[[Mapping[str, Any]], Shape]) -> BoundedShape:
        """Make the shape of a :attr:`spec`; ``of`` makes its two exact shapes."""
        return cls(of(spec["outer"]).outer, of(spec["inner"]).inner, bool(spec["is_round_about_z"]))


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


def ellipse(radii: tuple[float, float], center: Floats) -> tuple[Floats, Floats]:
    """Return the corners of a polygon around an ellipse and of one within it, shape (SIDES, 2) each, metres.

    ``radii`` are the semi-axes along x and y. Scaled along the axes to a circle of radius 1, the corners lie on circles
    whose radii leave room for the rounding of corners, also at a center far from the origin.

    Raises InputError if the center is so far from the origin that rounding blurs the ellipse.
    """
    slack = _ROUNDING + 2.0**-50 * float((1.0 + np.abs(center) / radii).max())
    if slack > _BLURRED:
        rule = f"at most {_BLURRED * 2.0**50:.1g} times the radius along each axis keeps its shape in floating point"
        raise InputError("center", f"is {tuple(center.tolist())}", rule, "check the units (metres)", value=center)
    ring = _ring() * radii
    return center + _WIDER * (1.0 + slack) * ring, center + (1.0 - slack) * ring


def _ring() -> Floats:
    """Return the corners of a polygon in the unit circle, shape (SIDES, 2); quarter turns map it to itself exactly."""
    angle = np.linspace(0.0, math.pi / 2.0, SIDES // 4 + 1)
    cosines = np.append(np.cos(angle)[:-1], 0.0)
    quarter = np.stack([cosines, cosines[::-1]], axis=1)[:-1]
    return np.concatenate([np.stack([quarter @ (c, -s), quarter @ (s, c)], axis=1) for c, s in _QUARTERS])


def _revolved(profile: Floats) -> Surface:
    """The surface that a polygon makes about the z axis, with as many sides as there are to stand for a circle.

    Quarter turns about the axis map it to itself to the last bit; so do half turns about the others, where the profile
    is its own mirror image. That is, for each corner, shape (n, 2), its distance from the axis and its height, from the
    lowest to the highest, which are on the axis.
    """
    ring = _ring()
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

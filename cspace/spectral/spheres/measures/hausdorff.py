"""One-sided Hausdorff distances between a shape and balls, with bounds.

Each is bounded from both sides: from below by points at which it is taken, from above by boxes that hold all points, or
by one length for each ball.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cspace.spectral.spheres.fields import Lattice, Region

Floats = NDArray[np.float64]

CLOSE: Final = 0.02
"""Part of a distance by which its bounds may be apart, once that can be had."""

SMALL: Final = 1e-4
"""Part of the size of a shape by which the bounds may be apart in any case."""

LEVELS: Final = 14
"""How often boxes are halved, at most."""

MOST: Final = 1_000_000
"""Boxes that are looked at together, at most."""

DIRECTIONS: Final = {2: 90, 3: 200}
"""Points of each sphere that are asked how far they stick out."""

_ROUNDING: Final = 2.0**-40


def shape_to_balls(lattice: Lattice, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the shape is from the union of balls, metres.

    Boxes that may hold the farthest point are halved until the bounds are close.
    """
    region, side = lattice.region, lattice.side
    slack = _ROUNDING * (region.size + float(np.abs(region.bounds).max()))
    corners = region.border.corners
    near, _ = _gaps(corners, 0.0, centers, radii)
    low = float(near.max(initial=0.0))
    middles, half, high = lattice.metres(lattice.middles), 0.5 * side, 0.0
    halves = 0.5 * np.array(list(product((-1.0, 1.0), repeat=region.dim)))
    for level in range(LEVELS + 1):
        near, far = _gaps(middles, half, centers, radii)
        inside = near > low
        if inside.any():
            points, gaps = middles[inside], near[inside]
            low = max(low, float(gaps[region.depths(points) > 0.0].max(initial=0.0)))
        enough = low + max(CLOSE * low, SMALL * region.size)
        left = far > enough
        high = max(high, float(far[~left].max(initial=0.0)))
        if not left.any() or level == LEVELS or np.count_nonzero(left) * len(halves) > MOST:
            high = max(high, float(far[left].max(initial=0.0)))
            break
        middles = (middles[left, None] + half * halves).reshape(-1, region.dim)
        half *= 0.5
        middles = middles[region.may_meet(middles, half * np.sqrt(region.dim) * (1.0 + 1e-9) + slack)]
        if not len(middles):
            break
    return max(low - slack, 0.0), max(high, low) + slack


def balls_to_shape(region: Region, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the union of balls is from the shape, metres.

    A ball reaches beyond its depth in the shape by no more than the difference of the two lengths.
    """
    high = max(0.0, float((radii - region.depths(centers)).max()))
    directions = _directions(region.dim, DIRECTIONS[region.dim])
    low = 0.0
    group = max(1, MOST // len(directions))
    for start in range(0, len(radii), group):
        some = slice(start, start + group)
        reach = radii[some, None, None] * (1.0 - _ROUNDING)
        points = (centers[some, None] + reach * directions).reshape(-1, region.dim)
        low = max(low, float(region.gaps(points).max()))
    return min(low, high), high


def _gaps(points: Floats, half: float, centers: Floats, radii: Floats) -> tuple[Floats, Floats]:
    from cspace.spectral.spheres.measures import _kernels

    near, far = np.empty(len(points)), np.empty(len(points))
    _kernels.gaps(np.ascontiguousarray(points), half, centers, radii, near, far)
    return near, far


def _directions(dim: int, number: int) -> Floats:
    """Unit vectors spread evenly, in space along a spiral."""
    n = np.arange(number)
    if dim == 2:
        angles = 2.0 * np.pi * n / number
        return np.column_stack([np.cos(angles), np.sin(angles)])
    z = 1.0 - (2.0 * n + 1.0) / number
    around, wide = np.pi * (3.0 - np.sqrt(5.0)) * n, np.sqrt(1.0 - z * z)
    return np.column_stack([wide * np.cos(around), wide * np.sin(around), z])

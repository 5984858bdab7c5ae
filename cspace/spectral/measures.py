"""Areas and volumes of unions of balls, and how far shape and balls are from each other; all as two bounds."""

from __future__ import annotations

import math
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.spectral.regions import Lattice, Region

Floats = NDArray[np.float64]

ROUNDING: Final = 2.0**-40
"""Rounding of a length or an area, in the size of the whole, with room to spare."""

SNAPPED: Final = 1e-9
"""Part of an area that the union of polygons may add or lose, where it snaps corners to each other."""

CORNERS: Final = 2**16
"""Of the polygons that stand for discs, together, if that leaves each from 64 to 1024."""

CUTS: Final = (7, 8, 9, 10)
"""How often the box round balls in space is halved: on, while bounds are apart by more than :data:`APART`."""

APART: Final = 0.01
"""Part of a volume by which its bounds may be apart."""

CLOSE: Final = 0.02
"""Part of a distance by which its bounds may be apart, once that can be had."""

SMALL: Final = 1e-4
"""Part of the size of a shape by which the bounds of a distance may be apart in any case."""

LEVELS: Final = 14
"""How often boxes are halved for a distance, at most."""

MOST: Final = 1_000_000
"""Boxes that are looked at together, at most."""

DIRECTIONS: Final = 200
"""Points of each sphere that are asked how far they stick out."""


def measure_of_balls(centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of the area (d = 2) or volume (d = 3) of a union of balls, centers (n, d) and radii (n,) in metres."""
    reach = radii[:, None]
    lower, upper = (centers - reach).min(axis=0), (centers + reach).max(axis=0)
    if centers.shape[1] == 2:
        return _area(centers - lower, radii, float((upper - lower).max()))
    side = float((upper - lower).max())
    for cuts in CUTS:
        low, high = split_volume(side, cuts, np.ascontiguousarray(centers - lower), radii, ROUNDING * side)
        if high - low <= APART * low:
            break
    return low, high


def _area(centers: Floats, radii: Floats, size: float) -> tuple[float, float]:
    """By polygons in the discs, and around them."""
    import shapely

    corners = int(np.clip(CORNERS // len(radii), 64, 1024))
    angles = 2.0 * math.pi * np.arange(corners) / corners
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    wider = 1.0 / math.cos(math.pi / corners)
    inner, outer = (
        float(shapely.union_all(shapely.polygons(centers[:, None] + (scale * radii)[:, None, None] * circle)).area)
        for scale in (1.0, wider)
    )
    slack = ROUNDING * size * size
    return max(0.0, inner * (1.0 - SNAPPED) - slack), outer * (1.0 + SNAPPED) + slack


def shape_to_balls(lattice: Lattice, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the shape is from the union of balls, metres.

    From below by points at which it is taken, from above by boxes that hold all points: those that may hold the
    farthest one are halved until the bounds are close.
    """
    region, half, dim = lattice.region, 0.5 * lattice.side, lattice.region.dim
    slack = ROUNDING * (region.size + float(np.abs(region.bounds).max()))
    low = float(gaps(region.pieces.reshape(-1, dim), 0.0, centers, radii)[0].max())
    middles, high = lattice.metres(lattice.middles), 0.0
    halves = 0.5 * np.array(list(product((-1.0, 1.0), repeat=dim)))
    for level in range(LEVELS + 1):
        near, far = gaps(middles, half, centers, radii)
        deeper = near > low
        low = max(low, float(near[deeper][region.depths(middles[deeper]) > 0.0].max(initial=0.0)))
        left = far > low + max(CLOSE * low, SMALL * region.size)
        if level == LEVELS or np.count_nonzero(left) * len(halves) > MOST:
            left[:], high = False, max(high, float(far[left].max(initial=0.0)))
        high = max(high, float(far[~left].max(initial=0.0)))
        middles, half = (middles[left, None] + half * halves).reshape(-1, dim), 0.5 * half
        middles = middles[region.gaps(middles) <= half * math.sqrt(dim) * (1.0 + 1e-9) + slack]
        if not len(middles):
            break
    return max(low - slack, 0.0), max(high, low) + slack


def balls_to_shape(region: Region, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the union of balls is from the shape, metres.

    A ball reaches beyond its depth in the shape by no more than the difference of the two lengths.
    """
    high = max(0.0, float((radii - region.depths(centers)).max()))
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, region.dim))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    low = 0.0
    for some in np.array_split(np.arange(len(radii)), math.ceil(len(radii) * len(directions) / MOST)):
        points = centers[some, None] + radii[some, None, None] * (1.0 - ROUNDING) * directions
        low = max(low, float(region.gaps(points.reshape(-1, region.dim)).max()))
    return min(low, high), high


@jit
def gaps(points: Floats, half: float, centers: Floats, radii: Floats) -> tuple[Floats, Floats]:
    """For cubes of half a side ``half`` round points: the distance of the middle from the nearest ball, and a length
    by which one ball must grow to hold the cube, both shape (n,); both are below zero deep in a ball."""
    dim = points.shape[1]
    near, far = np.empty(len(points)), np.empty(len(points))
    for n in range(len(points)):
        least, most = math.inf, math.inf
        for m in range(len(centers)):
            middle, corner = 0.0, 0.0
            for axis in range(dim):
                d = abs(points[n, axis] - centers[m, axis])
                middle += d * d
                corner += (d + half) * (d + half)
            least = min(least, math.sqrt(middle) - radii[m])
            most = min(most, math.sqrt(corner) - radii[m])
        near[n], far[n] = least, most
    return near, far


@jit
def split_volume(side: float, levels: int, centers: Floats, radii: Floats, slack: float) -> tuple[float, float]:
    """Volume of the cubes, of one at the origin cut in two ``levels`` times, that lie in one ball, and of those that
    meet some.

    A cube that one ball holds, or that none meets, is not cut.
    """
    inner, outer = 0.0, 0.0
    corners = np.zeros((8 * levels + 8, 3))
    depth = np.zeros(8 * levels + 8, dtype=np.int64)
    # Balls that meet a cube and do not hold it are all that its parts are asked of: one list for each level.
    lists = np.empty((levels + 2, len(radii)), dtype=np.int64)
    counts = np.zeros(levels + 2, dtype=np.int64)
    lists[0] = np.arange(len(radii))
    counts[0] = len(radii)
    waiting = 1
    while waiting > 0:
        waiting -= 1
        (x, y, z), level = corners[waiting], depth[waiting]
        s = side / (1 << level)
        held, meeting = False, 0
        for index in range(counts[level]):
            m = lists[level, index]
            a, b, c = centers[m]
            dx, dy, dz = max(0.0, x - a, a - x - s), max(0.0, y - b, b - y - s), max(0.0, z - c, c - z - s)
            if dx * dx + dy * dy + dz * dz > (radii[m] + slack) ** 2:
                continue
            dx, dy, dz = max(a - x, x + s - a), max(b - y, y + s - b), max(c - z, z + s - c)
            if radii[m] > slack and dx * dx + dy * dy + dz * dz <= (radii[m] - slack) ** 2:
                held = True
                break
            lists[level + 1, meeting] = m
            meeting += 1
        if held:
            inner += s * s * s
        if held or (meeting > 0 and level == levels):
            outer += s * s * s
        elif meeting > 0:
            counts[level + 1] = meeting
            for part in range(8):
                corners[waiting, 0] = x + 0.5 * s * (part & 1)
                corners[waiting, 1] = y + 0.5 * s * ((part >> 1) & 1)
                corners[waiting, 2] = z + 0.5 * s * (part >> 2)
                depth[waiting] = level + 1
                waiting += 1
    return inner, outer

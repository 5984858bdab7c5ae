"""Minkowski sums of geometries in the plane, between two polygons that are proven to bound them.

The sum of two convex sets is the convex hull of the sums of their corners, and the sum of two unions is the union of
the sums of their parts. Polygons are cut into convex parts, which is checked exactly. The sums are grown, or shrunk, by
a slack that exceeds all later rounding a hundred times: that of the corners (2^-53 of the largest coordinate), and that
of the union (GEOS snaps vertices within 1e-12 of it, if it must).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cspace.arrays import Floats
from cspace.errors import GeometryError, InputError
from cspace.files.vector import read_shapes

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

SLACK: Final = 2.0**-33
"""Distance by which sums are grown or shrunk, as a share of the largest coordinate."""

MAX_CORNERS: Final = 10_000_000
"""Largest number of sums of corners, of all pairs of convex parts."""

Corner = tuple[float, float]


class PolygonSum(NamedTuple):
    """A Minkowski sum between two polygons.

    Attributes
    ----------
    inner : shapely geometry
        Lies in the sum. Empty if the sum has no area.
    outer : shapely geometry
        Contains the sum.
    """

    inner: BaseGeometry
    outer: BaseGeometry


def sum_polygons(first: BaseGeometry, second: BaseGeometry) -> PolygonSum:
    """Bound the set of all sums of a point of ``first`` and a point of ``second``."""
    import shapely

    one, other = _convex_parts(first), _convex_parts(second)
    corners = len(one) * len(other) * one.shape[1] * other.shape[1]
    if corners > MAX_CORNERS:
        fault = f"and first make {corners:,} sums of corners of their {len(other)} and {len(one)} convex parts"
        hint = "simplify both, e.g. with shapely.simplify"
        raise InputError("second", fault, f"at most {MAX_CORNERS:,} are united", hint, value=second)
    points = (one[:, np.newaxis, :, np.newaxis] + other[:, np.newaxis]).reshape(len(one) * len(other), -1, 2)
    slack = SLACK * float(np.abs(points).max())
    sums = shapely.convex_hull(shapely.linestrings(points))
    grown = shapely.buffer(sums, slack, join_style="mitre", cap_style="square")
    shrunk = shapely.buffer(sums[shapely.get_dimensions(sums) == 2], -slack, join_style="mitre")
    # Corners that differ by the slack alone are merged, at the cost of half of it.
    outer, inner = (shapely.simplify(shapely.union_all(parts), slack / 2.0) for parts in (grown, shrunk))
    shapely.prepare(outer)
    if not shapely.covers(outer, sums).all():
        hint = "round both with shapely.set_precision"
        raise GeometryError(
            "first", "has a sum that GEOS unites wrongly", "its parts must be covered", hint, value=first
        )
    return PolygonSum(inner, outer)


def _convex_parts(geometry: BaseGeometry) -> Floats:
    """Return convex sets whose union is a geometry, by their corners, shape (n, k, 2); corners may be repeated."""
    import shapely

    rings: list[list[Corner]] = []
    for part in read_shapes(geometry):
        if part.geom_type == "Polygon":
            rings += _merged(_triangles(part))
        else:
            points = list(map(tuple, shapely.get_coordinates(part).tolist()))
            rings += [[*pair] for pair in pairwise(points)] or [points]
    most = max(map(len, rings))
    return np.array([ring + ring[-1:] * (most - len(ring)) for ring in rings])


def _triangles(polygon: BaseGeometry) -> list[list[Corner]]:
    """Cut a polygon into triangles, whose corners turn to the left, and check exactly that they tile it.

    If the border of the polygon is the sum of the borders of such triangles, the winding number of the polygon around
    any point is the number of triangles around it: one inside the polygon, and zero outside.

    Raises GeometryError if it is not.
    """
    import shapely

    rings = [_without_straight_corners(list(ring.coords)[:-1]) for ring in (polygon.exterior, *polygon.interiors)]
    cleaned = shapely.orient_polygons(shapely.Polygon(rings[0], rings[1:]))
    border: Counter[tuple[Corner, Corner]] = Counter()
    triangles = []
    for part in shapely.get_parts(shapely.constrained_delaunay_triangles(cleaned)):
        a, b, c = list(part.exterior.coords)[:3]
        turn = _orientation(a, b, c)
        if turn:
            triangles.append([a, b, c] if turn > 0 else [a, c, b])
            _add_ring(border, triangles[-1], 1)
    for ring in (cleaned.exterior, *cleaned.interiors):
        _add_ring(border, list(ring.coords)[:-1], -1)
    if not triangles or any(border.values()):
        hint = "round it with shapely.set_precision"
        raise GeometryError("polygon", "is not cut into triangles exactly", "they must tile it", hint, value=polygon)
    return triangles


def _merged(rings: list[list[Corner]]) -> list[list[Corner]]:
    """Merge convex polygons that share an edge, as long as the result is convex (Hertel and Mehlhorn, 1983)."""
    pieces = dict(enumerate(rings))
    owner = {(ring[k - 1], ring[k]): number for number, ring in pieces.items() for k in range(len(ring))}
    for a, b in list(owner):
        one, other = owner[a, b], owner.get((b, a))
        if other is None or one == other:
            continue
        left, right = _ending(pieces[one], a), _ending(pieces[other], b)  # b ... a, and a ... b
        if _orientation(left[-2], a, right[1]) < 0 or _orientation(right[-2], b, left[1]) < 0:
            continue
        right = pieces.pop(other)
        owner.update({(right[k - 1], right[k]): one for k in range(len(right))})
        pieces[one] = left + _ending(right, b)[1:-1]
    return list(pieces.values())


def _ending(ring: list[Corner], corner: Corner) -> list[Corner]:
    """Return a ring that ends with a corner."""
    stop = ring.index(corner) + 1
    return ring[stop:] + ring[:stop]


def _add_ring(border: Counter[tuple[Corner, Corner]], ring: Sequence[Corner], times: int) -> None:
    """Add the directed edges of a ring to a border, in which opposite edges cancel."""
    for k in range(len(ring)):
        a, b = ring[k - 1], ring[k]
        if a < b:
            border[a, b] += times
        else:
            border[b, a] -= times


def _without_straight_corners(ring: list[Corner]) -> list[Corner]:
    """Return a ring without repeated corners, and without corners on the straight line between their neighbours."""
    start = ring.index(min(ring))  # a true corner
    kept: list[Corner] = []
    for corner in [*ring[start:], *ring[: start + 1]]:
        while len(kept) > 1 and not _orientation(kept[-2], kept[-1], corner):
            kept.pop()
        if not kept or kept[-1] != corner:
            kept.append(corner)
    return kept[:-1]


def _orientation(a: Corner, b: Corner, c: Corner) -> int:
    """Return 1 if three points turn to the left, -1 if to the right, 0 if they lie on a line: exactly."""
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(x), Fraction(y)) for x, y in (a, b, c))
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return (area > 0) - (area < 0)

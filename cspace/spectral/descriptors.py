"""Descriptors: functions that are above zero in a shape and nowhere else, and their algebra (Lysenko, 2013).

With ``U_t(f) = {x : f(x) > t}`` and descriptors that are nowhere below zero, ``U_0(f + g) = U_0(f) | U_0(g)``,
``U_0(f g) = U_0(f) & U_0(g)``, and ``U_0(f * g)`` is the Minkowski sum of ``U_0(f)`` and ``U_0(g)``.

*Sums of polygons.* The sum of two convex sets is the convex hull of the sums of their corners, and the sum of two
unions is the union of the sums of their parts. Polygons are cut into convex parts, which is checked exactly. The sums
are grown, or shrunk, by a slack that exceeds all later rounding a hundred times: that of the corners (2^-53 of the
largest coordinate), and that of the union (GEOS snaps vertices within 1e-12 of it, if it must).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats
from cspace.check import check_cells, check_word, finite
from cspace.errors import GeometryError, InputError
from cspace.files.vector import read_shapes
from cspace.grid import Grid
from cspace.raster.triangles import mark_touched
from cspace.shapes import Balls, BallSet, ExactShape, Mesh, ShapeLike, check_balls, shape_of
from cspace.spectral.bump import Bump, check_bump

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.robot import Robot

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
        problem = f"and first make {corners:,} sums of corners of their {len(other)} and {len(one)} convex parts"
        hint = "simplify both, e.g. with shapely.simplify"
        raise InputError("second", problem, f"at most {MAX_CORNERS:,} are united", hint, value=second)
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


BallsLike: TypeAlias = "BallSet | Robot | tuple[ArrayLike, ArrayLike]"
"""Balls: what has ``centers`` and ``radii``, a robot of balls, or a pair of arrays of these."""

ROUNDING: Final = 2.0**-50
"""Bound, with room to spare, of the relative error of the few operations that turn and shift a coordinate."""

SAME: Final = 1e-9  # part of a cell or of the spacing by which grids may differ, from rounding, and still be the same

MOST_WHOLE: Final = 2.0**40
"""Product of 2-norms up to which transforms in float64 leave whole sums whole: their error is below 1000 rounding units
of it, so below an eighth."""

_TINY: Final = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class Descriptor:
    """A function given by its values at the middles of a grid's cells; the shape that it stands for is where it is
    above zero.

    Of the values, shape grid.shape, a copy is stored, as float64, read-only.

    Raises InputError if the values do not have the grid's shape, or one is not finite.
    """

    grid: Grid
    values: Floats = field(repr=False)

    def __post_init__(self) -> None:
        values = finite(self.values, "values")
        if values.shape != self.grid.shape:
            problem = f"has shape {values.shape} on a grid of {self.grid.shape}"
            raise InputError(
                "values", problem, "both must be the same", "pass one value for each cell", value=self.values
            )
        values = values.copy()
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.grid.dim

    @property
    def integral(self) -> float:
        """Sum of the values times the measure of a cell."""
        return float(self.values.sum() * self.grid.spacing**self.dim)


class BallDescriptor(Balls):
    """``f(x) = sum over balls of psi((x - center) / radius)``, above zero in the open balls and nowhere else.

    Parameters
    ----------
    centers : array-like, shape (n, 2) or (n, 3)
        Metres; a copy is stored, read-only.
    radii : array-like, shape (n,), or one number
        Metres, above zero.
    bump : Bump, optional
        ``Bump(2.0)`` if left out.

    Raises InputError if there is no ball, the shapes do not fit, a value is not finite, or a radius is not above zero.
    """

    def __init__(self, centers: ArrayLike, radii: ArrayLike, bump: Bump | None = None) -> None:
        super().__init__(*check_solid_balls(centers, radii))
        self.bump = check_bump(bump)

    @property
    def integral(self) -> float:
        """Integral over the plane or space, metres to the power ``dim``."""
        return float(self.bump.radial_spectrum(0.0, self.dim) * np.sum(self.radii**self.dim))

    @property
    def middle(self) -> Floats:
        """Middle of the box around the centers, shape (d,)."""
        return np.asarray((self.centers.min(axis=0) + self.centers.max(axis=0)) / 2)

    def sample(self, grid: Grid) -> Descriptor:
        """Values at the middles of the cells of a grid, which must have as many axes as the balls, or InputError."""
        check_dims("set of balls", self.dim, grid.dim)
        values = np.zeros(grid.shape)
        for window, squares in _near_balls(self.centers, self.radii, grid):
            values[window] += self.bump.values(np.sqrt(squares))
        return Descriptor(grid, values)

    def rounded(self, number: int, up: bool) -> BallDescriptor:
        """The same with at most ``number`` different radii, each ball grown (``up``) or shrunk to the next of them.

        Each serves about as many balls.
        """
        if len(np.unique(self.radii)) <= number:
            return self
        shares = np.arange(number) / number
        steps = np.unique(np.quantile(self.radii, 1.0 - shares if up else shares, method="higher" if up else "lower"))
        places = np.searchsorted(steps, self.radii, side="left" if up else "right")
        return BallDescriptor(self.centers, steps[places if up else places - 1], self.bump)


def check_solid_balls(centers: ArrayLike, radii: ArrayLike) -> tuple[Floats, Floats]:
    """Copies of the centers, shape (n, dim), and radii above zero, shape (n,), of balls."""
    points, sizes = check_balls(centers, radii)
    if (sizes <= 0.0).any():
        hint = "drop balls that have no volume"
        raise InputError("radii", f"holds {sizes.min():g}", "each must be above zero", hint, value=radii)
    return points, sizes


def check_dims(name: str, dim: int, other: int) -> None:
    """Refuse what is in the plane beside what is in space, or the other way around."""
    if dim != other:
        problem, rule = f"has {dim} coordinates and what it goes with {other}", "both must have as many"
        raise InputError(name, problem, rule, "pass all in the plane or all in space", value=dim)


def balls_of(source: BallsLike, name: str, bump: Bump) -> BallDescriptor:
    """The balls of an object with ``centers`` and ``radii``, of a robot of balls, or of a pair of arrays; InputError if
    it is none of these."""
    pair: Any = source
    balls: Any
    for balls in (source, getattr(source, "shape", None)):  # of a robot, its shape has them
        if not isinstance(pair, tuple) and isinstance(balls, BallSet):
            pair = (balls.centers, balls.radii)
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        problem, rule = f"is a {type(source).__name__}", "it must have centers and radii, or be a pair of them"
        raise InputError(name, problem, rule, "decompose other shapes first", value=source)
    return BallDescriptor(pair[0], pair[1], bump)


def bump_of(bump: Bump | None, *sources: object) -> Bump:
    """The bump that was passed, or else that of the sources that have one, or else the usual one.

    Raises InputError if it is no bump, or none was passed and those of the sources differ.
    """
    bumps = {own for source in sources if isinstance(own := getattr(source, "bump", None), Bump)}
    if bump is None and len(bumps) > 1:
        raise InputError("bump", f"is left out, and the descriptors have {bumps}", "both must have one", "pass bump=")
    return check_bump(bumps.pop() if bump is None and bumps else bump)


def indicator(shape: ShapeLike, grid: Grid) -> Descriptor:
    """1 at the middles of cells that lie in a shape, 0 elsewhere.

    Parameters
    ----------
    shape : shapely geometry, trimesh.Trimesh or other shape, set of balls, or array-like of bool, shape grid.shape
        Metres; closed sets, for which a middle on the border counts as inside, or, of a mesh, within rounding of it. An
        array gives the cells themselves.
    grid : Grid

    Raises InputError if the shape and the grid do not have the same dimension, or an array has the wrong shape or holds
    more than 0 and 1.
    """
    return Descriptor(grid, np.asarray(_inside(shape, grid), dtype=np.float64))


def _inside(shape: Any, grid: Grid) -> Bools:
    balls = isinstance(shape, BallSet)
    if hasattr(shape, "dtype") or isinstance(shape, list | tuple | int | float):
        return check_cells(shape, "shape")
    known: Any = shape if balls else shape_of(shape)
    check_dims("shape", known.centers.shape[1] if balls else known.dim, grid.dim)
    if balls:
        inside = np.zeros(grid.shape, dtype=bool)
        for window, squares in _near_balls(known.centers, np.maximum(known.radii, _TINY), grid):
            inside[window] |= squares <= 1.0
        return inside
    if not isinstance(known, ExactShape):
        rule = "cells are decided by one that is known exactly"
        raise InputError("shape", "is known by an outer and an inner shape", rule, "pass shape.outer or shape.inner")
    middles = np.meshgrid(*(grid.centers(axis) for axis in range(grid.dim)), indexing="ij")
    inside = known.contains(np.stack(middles, axis=-1))
    if isinstance(known, Mesh):  # which calls the points of some sides in, and those of others out
        mark_touched(inside, (known.triangles - np.asarray(grid.lower)) / grid.spacing, 0.5, 0.5)
    return np.asarray(inside)


def _near_balls(centers: Floats, radii: Floats, grid: Grid) -> Iterator[tuple[Any, Floats]]:
    """For each ball that reaches into a grid, a window of cells and their middles' squared distances, in radii."""
    lower = np.array(grid.lower)
    for center, radius in zip(centers, radii.tolist(), strict=True):
        # One cell more on either side, for rounding; far outside is far outside.
        first = np.floor((center - radius - lower) / grid.spacing) - 1.0
        last = np.ceil((center + radius - lower) / grid.spacing) + 1.0
        first, last = np.clip([first, last], 0, grid.shape).astype(np.int64)
        if (first < last).all():
            window = tuple(map(slice, first, last))
            squares = (((grid.centers(axis)[part] - center[axis]) / radius) ** 2 for axis, part in enumerate(window))
            yield window, np.asarray(sum(np.meshgrid(*squares, indexing="ij", sparse=True)))


def check_sampled(descriptor: Any) -> Descriptor:
    """The descriptor, refused where it is not sampled."""
    if not isinstance(descriptor, Descriptor):
        rule, hint = "this takes descriptors sampled on a grid", "make one with sample(grid) or indicator(shape, grid)"
        raise InputError(
            "descriptor", f"is a {type(descriptor).__name__}, and no Descriptor", rule, hint, value=descriptor
        )
    return descriptor


# ---- algebra ---------------------------------------------------------------------------------------------------------


@overload
def union(first: BallDescriptor, *others: BallDescriptor) -> BallDescriptor: ...
@overload
def union(first: Descriptor, *others: Descriptor) -> Descriptor: ...
def union(first: Descriptor | BallDescriptor, *others: Descriptor | BallDescriptor) -> Descriptor | BallDescriptor:
    """The sum of descriptors: of sampled ones on one grid, or of balls of one bump, whose sum is that of all balls.

    Raises InputError if the kinds, grids, bumps or dimensions differ.
    """
    given = (first, *others)
    balls = [each for each in given if isinstance(each, BallDescriptor)]
    if len(balls) != len(given):
        sampled = _on_one_grid(given)
        return Descriptor(sampled[0].grid, reduce(np.add, [each.values for each in sampled]))
    for each in balls[1:]:
        if each.bump != balls[0].bump or each.dim != balls[0].dim:
            problem = (
                f"holds balls of {each.bump} with {each.dim} coordinates, the first {balls[0].bump}, {balls[0].dim}"
            )
            raise InputError("others", problem, "both must be the same", "sample them on one grid first", value=each)
    centers, radii = (np.concatenate([getattr(each, name) for each in balls]) for name in ("centers", "radii"))
    return BallDescriptor(centers, radii, balls[0].bump)


def intersection(first: Descriptor, *others: Descriptor) -> Descriptor:
    """The product of descriptors on one grid.

    Raises InputError if one is not sampled (the product of two bumps is no bump), or the grids differ.
    """
    sampled = _on_one_grid((first, *others))
    return Descriptor(sampled[0].grid, reduce(np.multiply, [each.values for each in sampled]))


def superlevel(descriptor: Descriptor, threshold: float = 0.0) -> Bools:
    """``U_t``: the cells at whose middle a descriptor is above a threshold, which itself does not count.

    Raises InputError if the descriptor is not sampled, or the threshold is not one finite number.
    """
    level = finite(threshold, "threshold")
    if level.ndim:
        raise InputError("threshold", f"is {threshold!r}", "it must be one number", "pass e.g. 0.0", value=threshold)
    return np.asarray(check_sampled(descriptor).values > level)


@overload
def minkowski_sum(first: Descriptor, second: Descriptor, method: Literal["fft", "direct"] = "fft") -> Descriptor: ...
@overload
def minkowski_sum(
    first: BaseGeometry, second: BaseGeometry, method: Literal["fft", "direct"] = "fft"
) -> PolygonSum: ...
def minkowski_sum(
    first: Descriptor | BaseGeometry, second: Descriptor | BaseGeometry, method: Literal["fft", "direct"] = "fft"
) -> Descriptor | PolygonSum:
    """Compute the Minkowski sum of two descriptors, or of two geometries in the plane.

    Parameters
    ----------
    first, second : Descriptor, or shapely geometry
        Both of one kind. Descriptors are sampled on grids of one spacing. Geometries are polygons, lines, points, or
        collections of these, in metres.
    method : {"fft", "direct"}
        Of descriptors only. "direct" adds product after product, which is faster if both are small, or one is a few
        cells large.

    Returns
    -------
    Descriptor
        The convolution ``h(x) = integral f(y) g(x - y) dy``, as the sum over cells times their measure. Its grid holds
        every sum of a cell of one and a cell of the other; the centers of its cells are sums of theirs.
    PolygonSum
        For geometries: ``inner`` and ``outer``, two geometries. The sum of all points of one and all points of the
        other contains ``inner``, and ``outer`` contains the sum. Their borders lie about 2e-10 of the largest
        coordinate apart, except where the sum is thinner than that.

    Raises
    ------
    InputError
        If one is a descriptor and the other is not, a descriptor is not sampled, the dimensions or spacings differ,
        ``method`` is neither word, or polygons have too many corners.
    GeometryError
        If a geometry is empty, crosses itself, or is not finite.

    Notes
    -----
    If all values of descriptors are whole numbers (indicators), the sums are rounded to such: exact, also by FFT, for
    ``|f|_2 |g|_2`` below 2^40. If no value is below zero, the cells in which the sum is above zero are exactly the
    Minkowski sum of those of ``first`` and ``second``: the rounding of an FFT neither adds cells nor loses any.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import minkowski_sum
    >>> inner, outer = minkowski_sum(shapely.box(0, 0, 2, 1), shapely.box(-0.5, -0.5, 0.5, 0.5))
    >>> bool(outer.covers(shapely.box(-0.5, -0.5, 2.5, 1.5))), round(inner.area, 6)
    (True, 6.0)
    """
    from shapely import Geometry

    if isinstance(first, Geometry) and isinstance(second, Geometry):
        return sum_polygons(first, second)
    one, other = check_sampled(first), check_sampled(second)
    f, g = one.grid, other.grid
    if not _alike(f, g):
        problem = f"has {g.dim} axes and a spacing of {g.spacing:g} m, the first {f.dim} and {f.spacing:g} m"
        raise InputError("second", problem, "both must be the same", "sample the descriptors alike", value=second)
    check_word(method, "method", ("fft", "direct"))
    lower = np.add(f.lower, g.lower) + 0.5 * f.spacing
    grid = Grid(lower, f.spacing, [n + m - 1 for n, m in zip(f.shape, g.shape, strict=True)])
    return Descriptor(grid, _convolution(one.values, other.values, method) * f.spacing**f.dim)


def _convolution(f: Floats, g: Floats, method: str) -> Floats:
    """Sums over cells, rounded and cut as by :func:`minkowski_sum`."""
    from scipy.signal import convolve, convolve2d, fftconvolve

    if method == "fft":
        sums = np.asarray(fftconvolve(f, g))
    else:  # in the plane there is a quicker loop than the one for all dimensions
        sums = np.asarray(convolve2d(f, g) if f.ndim == 2 else convolve(f, g, method="direct"))
    whole = all(np.array_equal(values, np.rint(values)) for values in (f, g))
    if whole and np.linalg.norm(f) * np.linalg.norm(g) < MOST_WHOLE:
        return np.asarray(np.rint(sums))
    if (f < 0.0).any() or (g < 0.0).any():
        return sums
    pairs = fftconvolve((f > 0.0).astype(np.float64), (g > 0.0).astype(np.float64))
    return np.where(pairs > 0.5, np.maximum(sums, _TINY), 0.0)


def _alike(f: Grid, g: Grid) -> bool:
    """Whether two grids have as many axes and one spacing, but for rounding."""
    return f.dim == g.dim and abs(f.spacing - g.spacing) * max(f.shape + g.shape) <= SAME * f.spacing


def _on_one_grid(given: tuple[Any, ...]) -> list[Descriptor]:
    """The descriptors, all sampled on the grid of the first."""
    sampled = [check_sampled(each) for each in given]
    grid = sampled[0].grid
    for other in (each.grid for each in sampled):
        same = grid.shape == other.shape and _alike(grid, other)
        if not same or np.abs(np.subtract(grid.lower, other.lower)).max() > SAME * grid.spacing:
            raise InputError("others", f"holds one on {other}", f"all must be on {grid}", "sample them alike")
    return sampled

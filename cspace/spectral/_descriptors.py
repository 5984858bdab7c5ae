"""Descriptors: functions that are positive in a shape only, and their algebra.

Source: Lysenko, 2013.

Let ``U_t(f) = {x : f(x) > t}``. For non-negative descriptors, ``U_0(f + g) = U_0(f) | U_0(g)`` and
``U_0(f g) = U_0(f) & U_0(g)``, and ``U_0(f * g)`` is the Minkowski sum of ``U_0(f)`` and
``U_0(g)``.

*Sums of polygons.* The sum of two convex sets is the convex hull of the sums of their corners, and
the sum of two unions is the union of the sums of their parts. Polygons are cut into convex parts,
and the cut is checked exactly. The sums grow, or shrink, by a slack that exceeds all later rounding
a hundred times: the rounding of the corners (2^-53 of the largest coordinate) and of the union
(GEOS snaps vertices within 1e-12 of it, if necessary).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, reduce
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace._files.vector import read_shapes
from cspace._grid import Grid
from cspace._raster.triangles import mark_touched
from cspace._shapes import Balls, BallSet, ExactShape, Mesh, ShapeLike, as_shape, check_balls
from cspace._support.arrays import Bools, Floats
from cspace._support.check import check_cells, check_finite
from cspace.errors import GeometryError, InputError
from cspace.spectral._bump import Bump, check_bump

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace._robot import Robot


MAX_SUM_CORNERS: Final = 10_000_000
"""Largest number of corners of all pairwise sums of convex parts."""


Corner = tuple[float, float]
"""Coordinates (x, y) of a corner, metres."""


class PolygonSum(NamedTuple):
    """Inner and outer bound of a Minkowski sum of polygons.

    ``inner`` lies in the sum, and is empty if the sum has no area; ``outer`` contains the sum.
    """

    inner: BaseGeometry
    outer: BaseGeometry


def sum_polygons(first: BaseGeometry, second: BaseGeometry) -> PolygonSum:
    """Compute inner and outer bounds of a Minkowski sum.

    Raises InputError if the polygons have too many corners, and GeometryError if GEOS unites the
    parts wrongly.
    """
    import shapely

    first_parts = _split_into_convex_parts(first)
    second_parts = _split_into_convex_parts(second)
    corners = len(first_parts) * len(second_parts) * first_parts.shape[1] * second_parts.shape[1]
    if corners > MAX_SUM_CORNERS:
        parts = f"{len(second_parts)} and {len(first_parts)} convex parts"
        raise InputError(
            "second",
            f"and first make {corners:,} sums of corners of their {parts}",
            f"at most {MAX_SUM_CORNERS:,} are united",
            "simplify both, e.g. with shapely.simplify",
        )
    # One row of sums of corners for each pair of parts.
    sums_of_corners = first_parts[:, np.newaxis, :, np.newaxis] + second_parts[:, np.newaxis]
    points = sums_of_corners.reshape(len(first_parts) * len(second_parts), -1, 2)
    slack = 2.0**-33 * float(np.abs(points).max())
    sums = shapely.convex_hull(shapely.linestrings(points))
    has_area = shapely.get_dimensions(sums) == 2
    grown = shapely.buffer(sums, slack, join_style="mitre", cap_style="square")
    shrunk = shapely.buffer(sums[has_area], -slack, join_style="mitre")
    # Merge corners that differ only by the slack; this costs half of the slack.
    outer, inner = (
        shapely.simplify(shapely.union_all(parts), slack / 2.0) for parts in (grown, shrunk)
    )
    shapely.prepare(outer)
    if not shapely.covers(outer, sums).all():
        raise GeometryError(
            "first",
            "has a sum that GEOS unites wrongly",
            "the union must cover its parts",
            "round both with shapely.set_precision",
        )
    return PolygonSum(inner, outer)


def _split_into_convex_parts(geometry: BaseGeometry) -> Floats:
    """Split a geometry into ``n`` convex parts, and return their corners (n, k, 2).

    Parts with fewer than ``k`` corners repeat the last one.
    """
    import shapely

    rings: list[list[Corner]] = []
    for shape in read_shapes(geometry):
        if shape.geom_type == "Polygon":
            rings += _merge_convex(_cut_into_triangles(shape))
            continue
        # A line has a part for each segment, and a point is a part.
        points = [(x, y) for x, y in shapely.get_coordinates(shape).tolist()]
        segments = [[*pair] for pair in pairwise(points)]
        rings += segments or [points]
    max_corners = max(map(len, rings))
    return np.array([ring + ring[-1:] * (max_corners - len(ring)) for ring in rings])


def _cut_into_triangles(polygon: BaseGeometry) -> list[list[Corner]]:
    """Cut a polygon into counterclockwise triangles, checked exactly.

    If the boundary of the polygon is the sum of the boundaries of the triangles, the number of
    triangles around a point is the winding number of the polygon, one inside and zero outside.
    Raises GeometryError if the triangles do not tile the polygon.
    """
    import shapely

    exterior, *holes = (_drop_straight_corners(ring) for ring in _list_rings(polygon))
    cleaned = shapely.orient_polygons(shapely.Polygon(exterior, holes))
    triangulation = shapely.constrained_delaunay_triangles(cleaned)
    triangles = []
    for triangle in shapely.get_parts(triangulation):
        a, b, c = list(triangle.exterior.coords)[:3]
        orientation = _find_orientation(a, b, c)
        if orientation:
            triangles.append([a, b, c] if orientation > 0 else [a, c, b])
    if not triangles or _count_edges(triangles) != _count_edges(_list_rings(cleaned)):
        raise GeometryError(
            "polygon",
            "is not cut into triangles exactly",
            "they must tile it",
            "round it with shapely.set_precision",
        )
    return triangles


def _list_rings(polygon: Any) -> list[list[Corner]]:
    """List the rings of a polygon, the exterior first, without the repeated last corner."""
    return [list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _list_edges(ring: list[Corner]) -> list[tuple[Corner, Corner]]:
    """List the directed edges of a ring without a repeated last corner."""
    return list(pairwise([ring[-1], *ring]))


def _count_edges(rings: list[list[Corner]]) -> Counter[tuple[Corner, Corner]]:
    """Count the directed edges of rings; opposite edges cancel, so that the boundary is left."""
    edges = Counter(chain.from_iterable(map(_list_edges, rings)))
    return edges - Counter((b, a) for a, b in edges.elements())


def _merge_convex(rings: list[list[Corner]]) -> list[list[Corner]]:
    """Merge adjacent rings while they stay convex (Hertel and Mehlhorn, 1983).

    Rings are counterclockwise, so that an edge from a to b has its ring on the left.
    """
    pieces = dict(enumerate(rings))
    owner: dict[tuple[Corner, Corner], int] = {}
    for number, ring in pieces.items():
        owner.update(dict.fromkeys(_list_edges(ring), number))
    # Drop each edge between two pieces unless the merged piece turns right at one of its ends.
    for a, b in list(owner):
        left_piece = owner[a, b]
        right_piece = owner.get((b, a))
        if right_piece is None or left_piece == right_piece:
            continue
        left = _rotate_ring(pieces[left_piece], a)  # b ... a
        right = _rotate_ring(pieces[right_piece], b)  # a ... b
        is_reflex_at_a = _find_orientation(left[-2], a, right[1]) < 0
        is_reflex_at_b = _find_orientation(right[-2], b, left[1]) < 0
        if is_reflex_at_a or is_reflex_at_b:
            continue
        owner.update(dict.fromkeys(_list_edges(right), left_piece))
        pieces[left_piece] = left + right[1:-1]
        del pieces[right_piece]
    return list(pieces.values())


def _rotate_ring(ring: list[Corner], corner: Corner) -> list[Corner]:
    """Rotate the list of a ring's corners to end with ``corner``."""
    stop = ring.index(corner) + 1
    return ring[stop:] + ring[:stop]


def _drop_straight_corners(ring: list[Corner]) -> list[Corner]:
    """Drop repeated and straight corners from a ring."""
    start = ring.index(min(ring))  # a true corner
    corners: list[Corner] = []
    for corner in [*ring[start:], *ring[: start + 1]]:
        # The last corner is straight if this one lies in line with it.
        while len(corners) > 1 and not _find_orientation(corners[-2], corners[-1], corner):
            corners.pop()
        if not corners or corners[-1] != corner:
            corners.append(corner)
    return corners[:-1]


def _find_orientation(a: Corner, b: Corner, c: Corner) -> int:
    """Compute the exact orientation of three points: 1 left, -1 right, 0 straight."""
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(x), Fraction(y)) for x, y in (a, b, c))
    doubled_area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return (doubled_area > 0) - (doubled_area < 0)


BallsLike: TypeAlias = "BallSet | Robot | tuple[ArrayLike, ArrayLike]"
"""Types that give balls: an object with ``centers`` and ``radii``, a robot of balls, or a pair of
arrays."""

PLACEMENT_ROUNDING: Final = 2.0**-50
"""Upper bound of the relative error of rotating and translating a coordinate."""

GRID_TOLERANCE: Final = 1e-9
"""Largest difference of equal grids by rounding, relative to a cell or to the spacing."""

MAX_EXACT_NORM: Final = 2.0**40
"""Largest product of 2-norms for which FFTs of whole numbers can be rounded exactly.

The error of a transform in float64 is below 1000 rounding units of the product, so below 1/8.
"""

SMALLEST_NORMAL: Final = float(np.finfo(np.float64).tiny)
"""Smallest normal float64."""


@dataclass(frozen=True, eq=False)
class Descriptor:
    """Function sampled at cell centers; the shape is its positive set.

    Stores a read-only float64 copy of the values, shape grid.shape. Raises InputError if the values
    do not have the shape of the grid, or one is not finite.
    """

    grid: Grid
    values: Floats = field(repr=False)

    def __post_init__(self) -> None:
        """Check and copy the values."""
        values = check_finite(self.values, "values")
        if values.shape != self.grid.shape:
            raise InputError(
                "values",
                f"has shape {values.shape} on a grid of {self.grid.shape}",
                "the shapes must be equal",
                "pass one value for each cell",
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
        """Sum of the values times the volume of a cell."""
        return float(self.values.sum() * self.grid.spacing**self.dim)


class BallDescriptor(Balls):
    """Sum of a bump around each of several balls.

    It is ``f(x) = sum over balls of psi((x - center) / radius)``, which is above zero in the open
    balls and zero elsewhere.

    Parameters
    ----------
    centers : array-like, shape (n, 2) or (n, 3)
        Metres; a copy is stored, read-only.
    radii : array-like, shape (n,), or one number
        Metres, above zero.
    bump : Bump, optional
        ``Bump(2.0)`` if left out.

    Raises InputError if there is no ball, the shapes do not fit, a value is not finite, or a radius
    is not above zero.
    """

    def __init__(self, centers: ArrayLike, radii: ArrayLike, bump: Bump | None = None) -> None:
        """Check and copy centers, radii and bump."""
        super().__init__(*check_solid_balls(centers, radii))
        self.bump = check_bump(bump)

    @property
    def integral(self) -> float:
        """Integral over the plane or space, metres to ``dim``."""
        return float(self.bump.radial_spectrum(0.0, self.dim) * np.sum(self.radii**self.dim))

    @cached_property
    def center(self) -> Floats:
        """Center of the bounding box of the centers, metres."""
        return np.asarray((self.centers.min(axis=0) + self.centers.max(axis=0)) / 2)

    def sample(self, grid: Grid) -> Descriptor:
        """Evaluate the descriptor at the centers of cells."""
        check_same_dim("set of balls", self.dim, grid.dim)
        values = np.zeros(grid.shape)
        for window, squares in _measure_windows(self.centers, self.radii, grid):
            values[window] += self.bump.values(np.sqrt(squares))
        return Descriptor(grid, values)

    def round_radii(self, number: int) -> BallDescriptor:
        """Grow balls to at most ``number`` different radii.

        Each radius serves about equally many balls.
        """
        if len(np.unique(self.radii)) <= number:
            return self
        # Each radius grows to the next of these quantiles.
        shares = 1.0 - np.arange(number) / number
        quantiles = np.unique(np.quantile(self.radii, shares, method="higher"))
        next_quantiles = np.searchsorted(quantiles, self.radii)
        return BallDescriptor(self.centers, quantiles[next_quantiles], self.bump)


def check_solid_balls(centers: ArrayLike, radii: ArrayLike) -> tuple[Floats, Floats]:
    """Check and copy centers, shape (n, d), and radii, shape (n,); raise InputError if not usable.

    Radii must be above zero.
    """
    points, sizes = check_balls(centers, radii)
    if (sizes <= 0.0).any():
        raise InputError(
            "radii",
            f"holds {sizes.min():g}",
            "each must be above zero",
            "drop balls that have no volume",
        )
    return points, sizes


def check_same_dim(name: str, dim: int, other: int) -> None:
    """Raise InputError if two dimensions differ."""
    if dim != other:
        raise InputError(
            name,
            f"has {dim} dimensions, its counterpart has {other}",
            "they must agree",
            "pass all in the plane or all in space",
        )


def as_balls(source: BallsLike, name: str, bump: Bump) -> BallDescriptor:
    """Convert balls, as :class:`cspace.spectral.FourierOverlap` accepts them, to a descriptor.

    Raises InputError, which names the argument ``name``, for anything else.
    """
    pair: Any = source
    if not isinstance(source, tuple):
        for balls in (source, getattr(source, "shape", None)):  # a robot's shape has its balls
            if isinstance(balls, BallSet):
                pair = (balls.centers, balls.radii)
                break
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(
            name,
            f"is a {type(source).__name__}",
            "it must have centers and radii, or be a pair of them",
            "decompose other shapes first",
        )
    return BallDescriptor(pair[0], pair[1], bump)


def common_bump(bump: Bump | None, *sources: object) -> Bump:
    """Return a given bump, else the common bump of descriptors, or ``Bump()``.

    Raises InputError if ``bump`` is no bump, or if it is None and the bumps of the sources differ.
    """
    if bump is not None:
        return check_bump(bump)
    bumps = {source.bump for source in sources if isinstance(source, BallDescriptor)}
    if len(bumps) > 1:
        raise InputError(
            "bump",
            f"is missing, but the descriptors have {bumps}",
            "they must agree",
            "pass bump=",
        )
    return bumps.pop() if bumps else Bump()


def indicator(shape: ShapeLike, grid: Grid) -> Descriptor:
    """Sample a shape on a grid: 1 at cell centers in the shape, else 0.

    Parameters
    ----------
    shape : shapely geometry, trimesh.Trimesh, other shape, set of balls, or array-like
        Metres. Shapes are closed sets: a cell center on the boundary counts as inside, for a mesh
        also within rounding of it. An array gives the cells themselves.
    grid : Grid

    Raises InputError if shape and grid differ in dimension, or an array has the wrong shape or
    values other than 0 and 1.
    """
    source: Any = shape
    if hasattr(source, "dtype") or isinstance(source, list | tuple | int | float):
        return Descriptor(grid, check_cells(source, "shape").astype(np.float64))
    if isinstance(source, BallSet):
        check_same_dim("shape", source.centers.shape[1], grid.dim)
        is_inside = np.zeros(grid.shape, dtype=bool)
        radii = np.maximum(source.radii, SMALLEST_NORMAL)
        for window, squares in _measure_windows(source.centers, radii, grid):
            is_inside[window] |= squares <= 1.0
        return Descriptor(grid, is_inside.astype(np.float64))
    known = as_shape(source)
    check_same_dim("shape", known.dim, grid.dim)
    if not isinstance(known, ExactShape):
        raise InputError(
            "shape",
            "is bounded by an outer and an inner shape",
            "it must be an exact shape",
            "pass shape.outer or shape.inner",
        )
    centers = np.meshgrid(*map(grid.centers, range(grid.dim)), indexing="ij")
    is_inside = np.asarray(known.contains(np.stack(centers, axis=-1)))
    if isinstance(known, Mesh):
        # A mesh contains the points of only some of its faces, so mark them all.
        triangles = (known.triangles - np.asarray(grid.lower)) / grid.spacing
        mark_touched(is_inside, triangles, 0.5, 0.5)
    return Descriptor(grid, is_inside.astype(np.float64))


def _measure_windows(centers: Floats, radii: Floats, grid: Grid) -> Iterator[tuple[Any, Floats]]:
    """Yield the cells around each ball that meets the grid, with their distances.

    Yields the slices of a window of cells, and the squared distances of the cell centers in radii
    of the ball.
    """
    lower = np.array(grid.lower)
    cell_centers = [grid.centers(axis) for axis in range(grid.dim)]
    for center, radius in zip(centers, radii.tolist(), strict=True):
        # Add one cell on either side, for rounding.
        start = np.floor((center - radius - lower) / grid.spacing) - 1.0
        stop = np.ceil((center + radius - lower) / grid.spacing) + 1.0
        start, stop = np.clip([start, stop], 0, grid.shape).astype(np.int64)
        if not (start < stop).all():
            continue
        window = tuple(map(slice, start, stop))
        # The squared distance of a cell is the sum of squares along the axes.
        squares = [
            ((coordinates[cells] - coordinate) / radius) ** 2
            for coordinates, cells, coordinate in zip(cell_centers, window, center, strict=True)
        ]
        yield window, np.asarray(sum(np.meshgrid(*squares, indexing="ij", sparse=True)))


def check_sampled(descriptor: Any) -> Descriptor:
    """Return a descriptor sampled on a grid; raise InputError otherwise."""
    if not isinstance(descriptor, Descriptor):
        raise InputError(
            "descriptor",
            f"is a {type(descriptor).__name__}, no Descriptor",
            "it must be sampled on a grid",
            "make one with sample(grid) or indicator(shape, grid)",
        )
    return descriptor


# ---- algebra -------------------------------------------------------------------------------------


@overload
def union(first: BallDescriptor, *others: BallDescriptor) -> BallDescriptor: ...
@overload
def union(first: Descriptor, *others: Descriptor) -> Descriptor: ...
def union(
    first: Descriptor | BallDescriptor, *others: Descriptor | BallDescriptor
) -> Descriptor | BallDescriptor:
    """Add sampled descriptors, or join descriptors of balls.

    Sampled descriptors share a grid, descriptors of balls a bump. Raises InputError if the kinds,
    grids, bumps or dimensions differ.
    """
    descriptors = (first, *others)
    ball_sets = [balls for balls in descriptors if isinstance(balls, BallDescriptor)]
    # Unless all are sets of balls, all must be sampled.
    if len(ball_sets) != len(descriptors):
        sampled = _check_one_grid(descriptors)
        values = [descriptor.values for descriptor in sampled]
        return Descriptor(sampled[0].grid, reduce(np.add, values))
    bump = ball_sets[0].bump
    dim = ball_sets[0].dim
    for balls in ball_sets[1:]:
        if balls.bump != bump or balls.dim != dim:
            raise InputError(
                "others",
                f"holds balls of {balls.bump} in {balls.dim}D, the first is {bump} in {dim}D",
                "they must agree",
                "sample them on one grid first",
            )
    centers = np.concatenate([balls.centers for balls in ball_sets])
    radii = np.concatenate([balls.radii for balls in ball_sets])
    return BallDescriptor(centers, radii, bump)


def intersection(first: Descriptor, *others: Descriptor) -> Descriptor:
    """Multiply descriptors sampled on one grid.

    A product of values other than zero that underflows becomes the smallest normal number, with its
    sign, so that exactly the cells of the intersection are above zero. Raises InputError if one is
    not sampled (the product of two bumps is no bump), or the grids differ.
    """
    sampled = _check_one_grid((first, *others))
    factors = [descriptor.values for descriptor in sampled]
    product = reduce(np.multiply, factors)
    signs = reduce(np.multiply, map(np.sign, factors))
    has_underflowed = (np.abs(product) < SMALLEST_NORMAL) & (signs != 0.0)
    return Descriptor(sampled[0].grid, np.where(has_underflowed, SMALLEST_NORMAL * signs, product))


def superlevel(descriptor: Descriptor, threshold: float = 0.0) -> Bools:
    """Return a mask of the cells at whose centers a descriptor exceeds a threshold.

    Raises InputError if the descriptor is not sampled, or the threshold is not one finite number.
    """
    level = check_finite(threshold, "threshold")
    if level.ndim:
        raise InputError(
            "threshold",
            f"is {threshold!r}",
            "it must be one number",
            "pass e.g. 0.0",
        )
    return np.asarray(check_sampled(descriptor).values > level)


@overload
def minkowski_sum(first: Descriptor, second: Descriptor) -> Descriptor: ...
@overload
def minkowski_sum(first: BaseGeometry, second: BaseGeometry) -> PolygonSum: ...
def minkowski_sum(
    first: Descriptor | BaseGeometry, second: Descriptor | BaseGeometry
) -> Descriptor | PolygonSum:
    """Compute a Minkowski sum of two descriptors or geometries.

    Geometries lie in the plane.

    Parameters
    ----------
    first, second : Descriptor, or shapely geometry
        Two descriptors or two geometries. Descriptors are sampled on grids of one spacing.
        Geometries are polygons, lines, points, or collections of these, in metres.

    Returns
    -------
    Descriptor
        The convolution ``h(x) = integral f(y) g(x - y) dy``, as the sum over cells times their
        measure. The centers of the cells of its grid are the sums of a cell center of ``first`` and
        one of ``second``.
    PolygonSum
        For geometries: ``inner`` and ``outer``, two geometries. The Minkowski sum contains
        ``inner`` and lies in ``outer``. Their borders lie about 2e-10 of the largest coordinate
        apart, except where the sum is thinner than that.

    Raises
    ------
    InputError
        If only one is a descriptor, a descriptor is not sampled, the dimensions or spacings differ,
        or polygons have too many corners.
    GeometryError
        If a geometry is empty, crosses itself, or is not finite.

    Notes
    -----
    If all values of descriptors are whole numbers (indicators), the sums are rounded to whole
    numbers: exact for ``|f|_2 |g|_2`` below 2^40. If no value is below zero, the cells above zero
    of the sum are exactly the Minkowski sum of the cells above zero of ``first`` and ``second``:
    the rounding of an FFT neither adds nor loses cells.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import minkowski_sum
    >>> inner, outer = minkowski_sum(shapely.box(0, 0, 2, 1), shapely.box(-0.5, -0.5, 0.5, 0.5))
    >>> bool(outer.covers(shapely.box(-0.5, -0.5, 2.5, 1.5))), round(inner.area, 6)
    (True, 6.0)
    """
    from scipy.signal import fftconvolve
    from shapely import Geometry

    if isinstance(first, Geometry) and isinstance(second, Geometry):
        return sum_polygons(first, second)
    first, second = check_sampled(first), check_sampled(second)
    f, g = first.values, second.values
    grid, second_grid = first.grid, second.grid
    if not _have_same_spacing(grid, second_grid):
        problem = f"has {second_grid.dim} axes and a spacing of {second_grid.spacing:g} m, "
        problem += f"the first {grid.dim} and {grid.spacing:g} m"
        raise InputError(
            "second",
            problem,
            "they must agree",
            "sample both on similar grids",
        )
    sums = np.asarray(fftconvolve(f, g))
    are_whole = all(np.array_equal(values, np.rint(values)) for values in (f, g))
    if are_whole and np.linalg.norm(f) * np.linalg.norm(g) < MAX_EXACT_NORM:
        sums = np.rint(sums)
    elif min(f.min(), g.min()) >= 0.0:
        # The sum is positive exactly where it has a pair of positive cells; count these pairs,
        # which are whole numbers up to the rounding of the FFT.
        pairs = fftconvolve((f > 0.0).astype(np.float64), (g > 0.0).astype(np.float64))
        sums = np.where(pairs > 0.5, np.maximum(sums, SMALLEST_NORMAL), 0.0)
    lower = np.add(grid.lower, second_grid.lower) + 0.5 * grid.spacing
    return Descriptor(Grid(lower, grid.spacing, sums.shape), sums * grid.spacing**grid.dim)


def _have_same_spacing(f: Grid, g: Grid) -> bool:
    """Return True if two grids agree in dimension and spacing."""
    if f.dim != g.dim:
        return False
    # Differences of the spacing add up over the cells of a grid.
    difference_over_grid = abs(f.spacing - g.spacing) * max(f.shape + g.shape)
    return difference_over_grid <= GRID_TOLERANCE * f.spacing


def _check_one_grid(descriptors: tuple[Any, ...]) -> list[Descriptor]:
    """Check that descriptors are sampled on one grid; return them as a list.

    Raises InputError if one is not sampled, or its grid differs from that of the first.
    """
    sampled = list(map(check_sampled, descriptors))
    grid = sampled[0].grid
    max_shift = GRID_TOLERANCE * grid.spacing
    for other in (descriptor.grid for descriptor in sampled[1:]):
        has_same_cells = grid.shape == other.shape and _have_same_spacing(grid, other)
        if not has_same_cells or not np.allclose(grid.lower, other.lower, rtol=0.0, atol=max_shift):
            raise InputError(
                "others",
                f"holds one on {other}",
                f"all must be on {grid}",
                "sample all on it",
            )
    return sampled

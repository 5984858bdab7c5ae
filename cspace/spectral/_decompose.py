"""Decomposition of shapes into balls that fill or cover them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np

from cspace._shapes import ShapeLike, as_shape
from cspace._support.arrays import Floats, frozen
from cspace._support.check import check_count, check_positive, check_word
from cspace.errors import GeometryError, InputError
from cspace.spectral._arrange import MAX_BALLS_WITH_POINTS, Arrangement
from cspace.spectral._regions import (
    Lattice,
    Region,
    bound_ball_measure,
    bound_balls_to_shape,
    bound_shape_to_balls,
)

Kind = Literal["inner", "outer"]

BALL_KINDS: Final = ("inner", "outer")
"""Values of ``kind``: balls in the shape, or balls that cover it."""

Gap = tuple[float, float]
"""Lower and upper bound of a one-sided Hausdorff distance, metres."""


class Bounds(NamedTuple):
    """Lower and upper bound of a number."""

    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class BallDecomposition:
    """Balls that fill or cover a shape.

    In the plane they are discs. Made by :func:`cspace.spectral.decompose`.

    Attributes
    ----------
    centers : ndarray, shape (n, d)
        Metres; read-only, the largest ball first.
    radii : ndarray, shape (n,)
        Metres; read-only.
    kind : {"inner", "outer"}
        Whether each ball lies in the shape, or the union covers it.
    measure, shape_measure : Bounds
        Bounds of the area or volume of the union, and of the shape, square or cubic metres.
    hausdorff : Bounds
        Bounds of the non-zero one-sided Hausdorff distance, metres. For "inner", this is the
        largest distance of a point of the shape from the balls; for "outer", the largest distance
        of a point of the balls from the shape.
    """

    centers: Floats = field(repr=False)
    radii: Floats = field(repr=False)
    kind: Kind
    measure: Bounds
    shape_measure: Bounds
    hausdorff: Bounds

    def __len__(self) -> int:
        """Return the number of balls."""
        return len(self.radii)

    @property
    def dim(self) -> int:
        """Number of axes, 2 or 3."""
        return int(self.centers.shape[1])

    @property
    def volume_bounds(self) -> Bounds:
        """Bounds of the area or volume of the balls divided by that of the shape."""
        shape_low, shape_high = self.shape_measure
        lower = upper = math.inf
        if shape_high > 0.0:
            lower = self.measure.lower / shape_high
        if shape_low > 0.0:
            upper = self.measure.upper / shape_low
        return Bounds(lower, upper)

    @property
    def volume_ratio(self) -> float:
        """Mean of the bounds in :attr:`volume_bounds`."""
        lower, upper = self.volume_bounds
        return (lower + upper) / 2.0


MAX_REPLACED_BALLS: Final = 12
"""Number of balls within a tolerance up to which fewer ones are searched, for the time it takes."""

MIN_TOLERANCE_SHARES: Final = {2: 1e-3, 3: 3e-3}
"""Smallest tolerance, in diagonals of the bounding box, by dimension; a smaller one takes too many
balls."""

MAX_CELLS_PER_TOLERANCE: Final = 16.0
"""Largest ratio of the tolerance to the side of a lattice cell."""

REACHES: Final = (1.2, 1.0, 0.85, 0.7, 0.5)
"""Reaches of a greedy choice that are tried, in tolerances.

Arrangement lowers growths, but points between those that stand for the shape take more.
"""


def decompose(
    shape: ShapeLike,
    *,
    kind: Kind = "inner",
    number: int | None = None,
    tolerance: float | None = None,
) -> BallDecomposition:
    """Decompose a shape into balls.

    The balls fill the shape or cover it. Up to 64 balls are arranged by alternating assignment. For
    more, a greedy choice takes the ball that adds most cells of a lattice (V. Chvatal, "A greedy
    heuristic for the set-covering problem", 1979); candidates have their centers along the medial
    axis. The results are proven, not sampled: an "inner" ball is no
    larger than the distance of its center from the boundary. For "outer", cells cover the shape,
    and each cell lies entirely in one ball.

    Parameters
    ----------
    shape : Shape, shapely geometry, trimesh.Trimesh, array-like, path-like, mapping or str
        In the plane: polygons (a list means their union; "outer" also accepts lines and points),
        GeoJSON, WKT, a file of these, or vertices (n, 2). In space: whatever :meth:`cspace.Mesh.of`
        accepts. For cells, pass ``cspace.Robot.from_bitmap(cells, spacing)``. Metres.
    kind : {"inner", "outer"}
        Whether every ball lies in the shape, or the union of the balls covers it.
    number : int, optional
        Largest number of balls. Their distance is the smallest that was found, and is at most, or
        nearly, the tolerance that takes as many balls.
    tolerance : float, optional
        Metres. For "inner", the largest distance of a point of the shape from the balls; for
        "outer", the largest distance of a point of the balls from the shape. Pass either this or
        ``number``.

    Raises GeometryError if the shape is empty, malformed, or has no inside for inner balls. Raises
    FileError if a file is missing or malformed. Raises InputError if both or neither of ``number``
    and ``tolerance`` are passed, an argument is not usable, balls cannot meet the tolerance, or the
    lattice does not fit into memory.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import decompose
    >>> discs = decompose(shapely.box(0, 0, 2, 1), kind="outer", number=8)
    >>> len(discs.radii) <= 8
    True
    """
    check_word(kind, "kind", BALL_KINDS)
    if (number is None) == (tolerance is None):
        raise InputError(
            "number",
            f"is {number!r} and tolerance is {tolerance!r}",
            "exactly one of them chooses the balls",
            "pass e.g. number=64, or tolerance=0.01 in metres",
        )
    length = None if tolerance is None else check_positive(tolerance, "tolerance")
    count = None if number is None else check_count(number, "number", 1, hint="pass e.g. 64")
    region = Region(as_shape(shape))
    if kind == "inner" and not region.inner.measure[1] > 0.0:
        raise GeometryError(
            "shape",
            "has no inside",
            "inner balls need one",
            "pass kind='outer', or a shape with an area or volume",
        )
    if count is not None and not 0.0 < region.size < np.inf:
        raise GeometryError(
            "shape",
            f"is {region.size:g} m across",
            "balls by number need a finite size",
            "pass a tolerance instead",
        )
    if count:
        lattice = Lattice(region)
        centers = Arrangement(lattice, count, inside=kind == "inner").place(count)
        balls = _prove(lattice, kind, centers)
    else:
        balls = _find_within(region, kind, length or 0.0)
    centers, radii, gap = balls
    if not len(radii):
        raise InputError(
            "shape",
            "is too thin for any ball that was found",
            "inner balls need an inside",
            "pass kind='outer', or a thicker shape",
        )
    largest_first = np.argsort(-radii, kind="stable")
    centers = frozen(centers[largest_first])
    radii = frozen(radii[largest_first])
    measure = Bounds(*bound_ball_measure(centers, radii))
    return BallDecomposition(centers, radii, kind, measure, Bounds(*region.measure), Bounds(*gap))


def _prove(lattice: Lattice, kind: Kind, centers: Floats) -> tuple[Floats, Floats, Gap]:
    """Prove the largest balls in a shape around centers, or grow them until they cover it.

    Returns centers (n, d) and radii (n,), and bounds of the one-sided distance; metres. Balls
    without a part of the shape are dropped.
    """
    radii = lattice.region.depths(centers)
    if not len(centers):
        return centers, radii, (0.0, math.inf)
    low, high, growths = bound_shape_to_balls(lattice, centers, radii)
    if kind == "inner":
        return centers, radii, (low, high)
    radii = (radii + growths) * (1.0 + 2.0**-40)  # above the sum in spite of rounding
    is_needed = radii > 0.0
    centers = centers[is_needed]
    radii = radii[is_needed]
    return centers, radii, bound_balls_to_shape(lattice.region, centers, radii)


def _find_within(region: Region, kind: Kind, tolerance: float) -> tuple[Floats, Floats, Gap]:
    """Find few balls within a tolerance, metres; see :func:`_prove`.

    Raises InputError if none are found.
    """
    smallest = MIN_TOLERANCE_SHARES[region.dim] * region.size
    if tolerance < smallest:
        raise InputError(
            "tolerance",
            f"is {tolerance:g} m, but the shape is {region.size:g} m across",
            "it takes too many balls",
            f"pass at least about {1.2 * smallest:.2g} m",
        )
    lattice = Lattice(region, tolerance / MAX_CELLS_PER_TOLERANCE)
    arrangement = Arrangement(lattice, MAX_BALLS_WITH_POINTS, inside=kind == "inner")
    for reach in REACHES:
        balls = _prove(lattice, kind, arrangement.cover(reach * tolerance))
        if balls[2][1] <= tolerance:
            break
    else:
        raise InputError(
            "tolerance",
            f"is {tolerance:g} m, but {len(balls[1])} balls are proven within {balls[2][1]:g} m "
            "of the shape only",
            "parts thinner than the lattice have no balls",
            "pass a larger tolerance, or kind='outer'",
        )
    # Few balls are arranged anew, by bisection of their number.
    too_few = 0
    number = len(balls[1])
    arrangement = Arrangement(lattice, MAX_REPLACED_BALLS, inside=kind == "inner")
    while number - too_few > 1 and number <= MAX_REPLACED_BALLS:
        middle = (number + too_few) // 2
        fewer = _prove(lattice, kind, arrangement.place(middle))
        if fewer[2][1] <= tolerance:
            balls, number = fewer, middle
        else:
            too_few = middle
    return balls

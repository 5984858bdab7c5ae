"""Decomposition of shapes into balls that fill or cover them.

Few balls are arranged (:mod:`cspace.spectral._arrange`); more are chosen greedily by the lattice
cells that they add. Lengths in this module are in sides of a cell, unless they say metres. A ball
contains a cell if ``sum (|cell_center - center| + half)^2 <= reach^2`` over the axes. With ``half``
zero it contains the cell's center, otherwise the whole cell. An *open* cell lies in no chosen ball.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import GeometryError, InputError
from cspace.inside import (
    Floats,
    Ints,
    ShapeLike,
    SurfaceTree,
    allocating,
    as_shape,
    bound_point_distance,
    box_trees,
    check_count,
    check_positive,
    check_word,
    frozen,
    internal,
    kernel,
)
from cspace.spectral._arrange import MAX_SEARCHED_BALLS, Arrangement, Depths
from cspace.spectral._regions import (
    Lattice,
    Region,
    bound_ball_measure,
    bound_balls_to_shape,
    bound_shape_to_balls,
)

Kind = Literal["inner", "outer"]

Gap = tuple[float, float]
"""Lower and upper bound of a one-sided Hausdorff distance, metres."""

ProvenBalls = tuple[Floats, Floats, Gap]
"""Centers (n, d) and radii (n,) of balls, metres, and bounds of their distance, or infinity."""


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
    measure : Bounds
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
    _shape_measure: Bounds
    hausdorff: Bounds

    def __len__(self) -> int:
        """Return the number of balls."""
        return len(self.radii)

    @property
    def volume_ratio(self) -> float:
        """The balls' measure divided by the shape's, each in the middle of its bounds."""
        if self._shape_measure.lower == 0.0:
            return math.inf
        return sum(self.measure) / sum(self._shape_measure)


MAX_SAMPLES: Final = 20_000
"""Number of points of the boundary next to which balls in thin parts are searched."""

UNLIMITED_BALLS: Final = 2**40
"""Limit of the number of balls that is never reached."""

LATTICE_ROUNDING: Final = 2.0**-20
"""Rounding allowance, in sides of a cell: a ball reaches this far beyond the cells it contains."""


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
    axis. The results are proven, not sampled: an "inner" ball is no larger than the distance of its
    center from the boundary. For "outer", cells cover the shape, and each cell lies entirely in one
    ball.

    Parameters
    ----------
    shape : Shape, shapely geometry, trimesh.Trimesh, array-like, path-like, mapping or str
        In the plane: polygons (a list means their union; "outer" also accepts lines and points),
        GeoJSON, WKT, a file of these, or vertices (n, 2). In space: whatever
        :func:`cspace.make_mesh` accepts. For cells, pass
        ``cspace.Robot.from_bitmap(cells, spacing)``. Metres.
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
    # Values of ``kind``: balls in the shape, or balls that cover it.
    check_word(kind, "kind", ("inner", "outer"))
    if (number is None) == (tolerance is None):
        raise InputError(
            "number",
            f"is {number!r} and tolerance is {tolerance!r}",
            "exactly one of them chooses the balls",
        )
    length = None if tolerance is None else check_positive(tolerance, "tolerance")
    count = None if number is None else check_count(number, "number", 1)
    region = Region(as_shape(shape))
    if kind == "inner" and not region.inner.measure[1] > 0.0:
        raise GeometryError(
            "shape",
            "has no inside",
            "inner balls need one",
        )
    if count is not None and not 0.0 < region.size < np.inf:
        raise GeometryError(
            "shape",
            f"is {region.size:g} m across",
            "balls by number need a finite size",
        )
    if length is None:
        number = count or UNLIMITED_BALLS
        balls = _select_nearest(Lattice.for_count(region, number), number, kind)
    else:
        lattice = Lattice.for_tolerance(region, length)
        choose_balls = _fill_shape if kind == "inner" else _cover_shape
        balls = choose_balls(lattice, length)
        # Number of balls within a tolerance up to which fewer ones are searched, for the time it
        # takes.
        if len(balls[1]) <= 12:
            balls = _arrange_fewer(lattice, kind, length, balls)
    centers, radii, gap = balls
    if not len(radii):
        raise InputError(
            "shape",
            "is too thin for any ball that was found",
            "inner balls need an inside",
        )
    largest_first = np.argsort(-radii, kind="stable")
    centers = frozen(centers[largest_first])
    radii = frozen(radii[largest_first])
    measure = Bounds(*bound_ball_measure(centers, radii))
    return BallDecomposition(centers, radii, kind, measure, Bounds(*region.measure), Bounds(*gap))


# ---- choice of balls -----------------------------------------------------------------------------


def _fill_shape(lattice: Lattice, tolerance: float) -> ProvenBalls:
    """Choose balls in a shape within a tolerance, metres.

    Raises InputError if the shape is too thin or the tolerance too small.
    """
    candidates = _list_inner_candidates(lattice)
    balls, is_proven = _choose_cover(lattice, candidates, tolerance / lattice.side)
    centers = lattice.to_metres(balls.centers)
    radii = lattice.region.depths(centers)  # recomputed as proven lower bounds
    is_whole = is_proven and bool((radii > 0.0).all())
    centers, radii, (low, high) = _prove(lattice, "inner", centers, radii)
    if len(radii) and high > tolerance:
        # All cells may lie in the balls grown by less than the tolerance.
        if is_whole:
            return centers, radii, (min(low, tolerance), tolerance)
        problem = (
            f"is {tolerance:g} m, but {len(radii)} balls are proven within {high:g} m of the "
            "shape only"
        )
        rule = "parts thinner than the lattice have no balls"
        raise InputError("tolerance", problem, rule)
    return centers, radii, (low, high)


def _cover_shape(lattice: Lattice, tolerance: float) -> ProvenBalls:
    """Choose balls that cover a shape within a tolerance.

    Raises InputError if no such balls are found.
    """
    candidates = _list_medial_balls(lattice)
    balls, is_whole = _choose_cover(lattice, candidates, tolerance / lattice.side, inside=False)
    if not is_whole:
        raise InputError(
            "tolerance",
            f"is {tolerance:g}, but no such balls that cover the shape were found",
            "their union must contain the shape",
        )
    centers = lattice.to_metres(balls.centers)
    # Half of the allowance exceeds the rounding of coordinates and depths, so that balls contain
    # their cells and no ball sticks out too far.
    radii = (balls.reaches - 0.5 * LATTICE_ROUNDING) * lattice.side
    return centers, radii, bound_balls_to_shape(lattice.region, centers, radii)


def _prove(lattice: Lattice, kind: Kind, centers: Floats, depths: Floats) -> ProvenBalls:
    """Prove balls by centers (n, d) and depths (n,), metres.

    Inner balls are the largest ones in the shape. Outer balls are as large as their parts of the
    shape need; their depths only choose these parts. Balls outside, or without a part, are dropped.
    """
    is_needed = depths > 0.0
    if kind == "outer":
        is_needed = np.ones(len(depths), dtype=np.bool_)
    if not is_needed.any():
        return centers[:0], depths[:0], (0.0, math.inf)
    centers = centers[is_needed]
    depths = depths[is_needed]
    low, high, growths = bound_shape_to_balls(lattice, centers, depths)
    if kind == "inner":
        return centers, depths, (low, high)
    radii = (depths + growths) * (1.0 + 2.0**-40)  # above the sum in spite of rounding
    is_needed = radii > 0.0
    centers = centers[is_needed]
    radii = radii[is_needed]
    return centers, radii, bound_balls_to_shape(lattice.region, centers, radii)


def _arrange(lattice: Lattice, kind: Kind, number: int, *starts: Floats) -> ProvenBalls:
    """Arrange up to ``number`` balls; return best and starts."""
    # Balls outside may also fill hollows, such as the inside of a mesh with small gaps.
    measures: list[Depths] = [lattice.region.depths]
    if kind == "outer" and lattice.hollows.any():
        measures.append(lattice.filled_depths)
    best: ProvenBalls = np.empty((0, lattice.region.dim)), np.empty(0), (0.0, math.inf)
    for measure_depths in measures:
        places = list(starts)
        # Largest number of balls that are arranged; for more, greedy choices are as good.
        if number <= 64:
            arrangement = Arrangement(lattice, measure_depths, inside=kind == "inner")
            places.append(arrangement.place(number, *starts))
        for centers in places:
            balls = _prove(lattice, kind, centers, measure_depths(centers))
            if balls[2][1] < best[2][1]:
                best = balls
    return best


def _arrange_fewer(
    lattice: Lattice, kind: Kind, tolerance: float, balls: ProvenBalls
) -> ProvenBalls:
    """Replace balls within a tolerance, metres, by fewer arranged ones."""
    too_few = 0
    number = len(balls[1]) + 1  # as many balls are mostly arranged better
    while number - too_few > 1:
        middle = (number + too_few) // 2
        fewer = _arrange(lattice, kind, middle)
        if fewer[2][1] > tolerance:
            too_few = middle
        else:
            number = middle
            balls = fewer
    return balls


def _select_nearest(lattice: Lattice, number: int, kind: Kind) -> ProvenBalls:
    """Select at most ``number`` balls with a small distance from the shape.

    Few balls are arranged. Many are those that cover all cells, or those that fill most cells.
    """
    places = []
    if lattice.region.inner.measure[1] > 0.0:
        places.append(lattice.to_metres(_fill_greedily(lattice, number).centers))
    if number > MAX_SEARCHED_BALLS:
        balls, _ = _cover_with(lattice, number, inside=kind == "inner")
        places.append(lattice.to_metres(balls.centers))
    return _arrange(lattice, kind, number, *places)


def _list_inner_candidates(lattice: Lattice) -> LatticeBalls:
    """List candidate balls in the shape."""
    balls = _list_medial_balls(lattice)
    inner_balls = balls.select(balls.depths > 0.0)
    if not len(inner_balls.depths):  # the shape is thinner than a cell
        return _find_deepest_points(lattice, lattice.cell_centers)
    return inner_balls


def _fill_greedily(lattice: Lattice, number: int) -> LatticeBalls:
    """Choose up to ``number`` balls containing many cell centers."""
    candidates = _list_inner_candidates(lattice)
    cells = CellCounts.of(lattice, whole=False)
    boundary = lattice.region.inner
    chosen = choose(cells, candidates.centers, candidates.reaches, number)
    if not len(chosen):  # the shape is so thin that it contains no cell center
        deepest_first = np.argsort(-candidates.depths)
        chosen = deepest_first[:number]
    balls = candidates.select(chosen)
    # Move the balls a little, to contain more.
    frame = lattice.corner, lattice.side, boundary.error
    nodes = np.empty((box_trees.MAX_PENDING_PAIRS, 2), dtype=np.int64)
    polish(cells, boundary.tree, balls.centers, balls.depths, *frame, nodes)
    return balls


def _cover_with(lattice: Lattice, number: int, *, inside: bool) -> tuple[LatticeBalls, bool]:
    """Choose up to ``number`` balls; return True if they cover all.

    They grow, beyond their depth in the shape, by the smallest length, by bisection, for which such
    balls are found. With ``inside``, centers must lie in the shape.
    """
    candidates = _list_inner_candidates(lattice) if inside else _list_medial_balls(lattice)
    # No ball covers a cell unless it grows by about a diagonal; twice the size is always enough.
    too_small = 1.001 * lattice.diagonal
    enough = 2.0 * lattice.region.size / lattice.side
    best, is_whole = _choose_cover(lattice, candidates, enough, inside=inside, max_balls=number)
    # Twelve halvings of the ratio, or to within 2 %.
    for _ in range(12):
        if not is_whole or enough < 1.02 * too_small:
            break
        length = math.sqrt(enough * too_small)
        balls, covers = _choose_cover(lattice, candidates, length, inside=inside, max_balls=number)
        if covers:
            best = balls
            enough = length
        else:
            too_small = length
    return best, is_whole


def _choose_cover(
    lattice: Lattice,
    candidates: LatticeBalls,
    reach: float,
    *,
    inside: bool = True,
    max_balls: int = UNLIMITED_BALLS,
) -> tuple[LatticeBalls, bool]:
    """Choose up to ``max_balls`` balls; return True if they cover cells.

    The reach of a ball is its depth in the shape plus ``reach``, in sides, or less. With
    ``inside``, centers must lie in the shape.
    """
    cells = CellCounts.of(lattice, whole=True)
    balls = candidates.select(np.zeros(0, dtype=np.int64))
    find_balls = _find_deepest_points if inside else _find_balls_around
    for is_last in (False, True):
        candidates = candidates._replace(reaches=candidates.depths + reach)
        max_more = max_balls - len(balls.reaches)
        chosen = choose(cells, candidates.centers, candidates.reaches, max_more)
        balls = balls.append(candidates.select(chosen))
        open_cells = cells.open_cells
        if is_last or not len(open_cells) or len(balls.reaches) == max_balls:
            break
        # Cells that the candidates leave open get balls of their own.
        candidates = find_balls(lattice, open_cells)
    return cells.trim(balls), not len(cells.open_cells)


# ---- candidates ----------------------------------------------------------------------------------


def _find_balls_around(lattice: Lattice, points: Floats) -> LatticeBalls:
    """Find the largest ball around each point (n, 3)."""
    depths = lattice.depths_at(points)
    return LatticeBalls(points, depths, depths)


def _list_medial_balls(lattice: Lattice) -> LatticeBalls:
    """List the largest balls around cell centers that no neighboring ball contains.

    They lie along the medial axis of the shape. Growing all balls by one length does not change
    which balls contain others.
    """
    from scipy.ndimage import grey_dilation

    # A ball is contained if a neighbor's depth exceeds its own by the distance of the two centers:
    # a grey dilation.
    depths = np.full(lattice.cells.shape, -np.inf)
    depths[lattice.cells] = lattice.depths
    # Neighbors are up to two cells away, and a contained ball may stick out by 2 % of that
    # distance.
    steps = (np.arange(-2, 3) if half else np.zeros(1) for half in lattice.half)
    distances = np.linalg.norm(np.meshgrid(*steps, indexing="ij"), axis=0)
    options = {
        "footprint": distances > 0.0,
        "structure": -0.98 * distances,
        "mode": "constant",
        "cval": -np.inf,
    }
    is_medial = ~(grey_dilation(depths, **options) >= depths)[lattice.cells]
    balls = _find_balls_around(lattice, lattice.cell_centers[is_medial])
    number = len(balls.depths)
    if not number:
        return balls
    # Thin out the candidates evenly, but keep the largest ball.
    is_candidate = np.zeros(number, dtype=np.bool_)
    # Approximate number of candidate balls in the first choice.
    is_candidate[:: math.ceil(number / 6_000)] = True
    is_candidate[np.argmax(balls.depths)] = True
    return balls.select(is_candidate)


def _find_deepest_points(lattice: Lattice, cells: Floats) -> LatticeBalls:
    """Find a deep ball near each cell among points.

    ``cells`` are cell centers, shape (n, 3). The points are the center and points on either side of
    the nearest boundary. A cell without such a point in the shape gets no ball.
    """
    from scipy.spatial import KDTree

    region = lattice.region
    places, normals = region.inner.sample(MAX_SAMPLES, np.random.default_rng(0))
    centers = lattice.to_metres(cells)
    _, nearest = KDTree(places).query(centers)
    # Number of distances from the boundary, from a side of a cell on, each half the one before.
    lengths = lattice.side * 0.5 ** np.arange(8)
    steps = np.concatenate([lengths, -lengths])[:, None, None]
    points = np.concatenate([centers[None], places[nearest] + steps * normals[nearest]])
    depths = region.depths(points.reshape(-1, region.dim)).reshape(len(points), -1) / lattice.side
    best = depths.argmax(axis=0), np.arange(len(cells))
    deepest = LatticeBalls(lattice.from_metres(points[best]), depths[best], depths[best])
    return deepest.select(deepest.depths > 0.0)


class LatticeBalls(NamedTuple):
    """Balls in lattice coordinates, in units of the side of a cell.

    ``centers`` have shape (n, 3). ``depths``, shape (n,), are lower bounds of the depth of a center
    in the shape, and ``reaches``, shape (n,), the radii.
    """

    centers: Floats
    depths: Floats
    reaches: Floats

    def select(self, chosen: NDArray[Any]) -> LatticeBalls:
        """Select balls by a mask or by indices."""
        return LatticeBalls(*(column[chosen] for column in self))

    def append(self, other: LatticeBalls) -> LatticeBalls:
        """Return these balls, followed by others."""
        columns = zip(self, other, strict=True)
        return LatticeBalls(*map(np.concatenate, columns))


class CellCounts(NamedTuple):
    """Number of chosen balls that contain each cell, for kernels.

    A ball contains a cell if it contains the center, or all of the cell.

    ``counts``, shape (nx, ny, nz), are the numbers of chosen balls that contain a cell, or -1 for
    ignored cells. ``open_before``, shape (nx, ny, nz + 1), are the numbers of open cells before a
    cell in its row. ``half``, shape (3,), is half a cell along each axis if balls must contain
    whole cells, else 0. Scratch for the rows of cells in a ball: ``rows``, shape (nx * ny, 4), are
    i, j, first k and stop k, and ``squares`` the part of the squared distance along the first two
    axes.
    """

    counts: NDArray[np.int32]
    open_before: NDArray[np.int32]
    half: Floats
    rows: Ints
    squares: Floats

    @classmethod
    def of(cls, lattice: Lattice, *, whole: bool) -> CellCounts:
        """Create counts of no ball.

        If ``whole``, balls contain a cell if they contain all of it; otherwise its center, and
        cells whose center is not proven to lie in the shape are ignored.
        """
        counts = np.full(lattice.cells.shape, -1, dtype=np.int32)
        counts[lattice.cells] = 0 if whole else np.where(lattice.depths > 0.0, 0, -1)
        nx, ny, nz = counts.shape
        open_before = np.zeros((nx, ny, nz + 1), dtype=np.int32)
        np.cumsum(counts == 0, axis=2, out=open_before[:, :, 1:])
        half = lattice.half if whole else np.zeros(3)
        rows = np.empty((nx * ny, 4), dtype=np.int64)
        return cls(counts, open_before, half, rows, np.empty(len(rows)))

    @property
    def open_cells(self) -> Floats:
        """Centers of cells in no ball, shape (n, 3)."""
        return np.argwhere(self.counts == 0) + np.float64(0.5)

    def trim(self, balls: LatticeBalls) -> LatticeBalls:
        """Shrink balls to their own cells; drop empty ones.

        Small balls are dropped first; then balls that stick out most are shrunk first.
        """
        reaches = balls.reaches.copy()
        by_size = np.argsort(reaches, kind="stable")
        trim(self, balls.centers, reaches, by_size, only_drop=True)
        by_growth = np.argsort(balls.depths - reaches, kind="stable")
        trim(self, balls.centers, reaches, by_growth, only_drop=False)
        return balls._replace(reaches=reaches).select(reaches > 0.0)


@internal
def _find_cell_range(center: float, length: float, count: int) -> tuple[int, int]:
    """Find cells along an axis with centers within ``length``.

    Returns the first one and the end, both within ``count`` cells.
    """
    first = math.ceil(center - length - 0.5)
    stop = math.floor(center + length + 0.5)
    return max(0, first), min(count, stop)


@internal
def _find_rows(cells: CellCounts, center: Floats, reach: float) -> tuple[int, int]:
    """Find a ball's rows of cells; count cells and open ones.

    They fill the first rows of ``cells.rows``. ``center`` has shape (3,).
    """
    half = cells.half
    nx, ny, nz = cells.counts.shape
    radius = reach - LATTICE_ROUNDING
    square = radius * radius
    count = 0
    gain = 0
    # Along each further axis, the ball reaches as far as the axes before leave of its square.
    for i in range(*_find_cell_range(center[0], radius - half[0], nx)):
        square_x = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if square_x > square:
            continue
        reach_y = math.sqrt(square - square_x) - half[1]
        for j in range(*_find_cell_range(center[1], reach_y, ny)):
            square_xy = square_x + (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if square_xy > square:
                continue
            reach_z = math.sqrt(square - square_xy) - half[2]
            first, stop = _find_cell_range(center[2], reach_z, nz)
            if first < stop:
                row = cells.rows[count]
                row[0] = i
                row[1] = j
                row[2] = first
                row[3] = stop
                cells.squares[count] = square_xy
                count += 1
                gain += cells.open_before[i, j, stop] - cells.open_before[i, j, first]
    return count, gain


@internal
def _count_ball(cells: CellCounts, center: Floats, reach: float, step: int) -> None:
    """Add (1) or remove (-1) a ball from its cells' counts."""
    counts = cells.counts
    open_before = cells.open_before
    row_count, _ = _find_rows(cells, center, reach)
    for row in range(row_count):
        i, j, first, stop = cells.rows[row]
        for k in range(first, stop):
            if counts[i, j, k] >= 0:
                counts[i, j, k] += step
        # Sum the open cells of the row again, from the first change on.
        for k in range(first, counts.shape[2]):
            open_before[i, j, k + 1] = open_before[i, j, k] + (counts[i, j, k] == 0)


@allocating
def choose(cells: CellCounts, centers: Floats, reaches: Floats, max_balls: int) -> Ints:
    """Choose up to ``max_balls`` balls adding most cells, greedily.

    Returns their indices, in that order. ``centers`` has shape (n, 3), ``reaches`` (n,). A ball
    never adds more cells than before other balls were chosen (M. Minoux, "Accelerated greedy
    algorithms for maximizing submodular set functions", 1978).
    """
    chosen = np.empty(min(max_balls, len(centers)), dtype=np.int64)
    count = 0
    # The queue has the negative gain of each ball, as last computed, so that the largest is first.
    queue = [(-math.inf, ball) for ball in range(len(centers))]
    heapq.heapify(queue)
    while len(queue) > 0 and count < len(chosen):
        _, ball = heapq.heappop(queue)
        _, gain = _find_rows(cells, centers[ball], reaches[ball])
        if gain == 0:
            continue
        # The gain is up to date. If another ball may gain more, queue this one again.
        if len(queue) > 0 and gain < -queue[0][0]:
            heapq.heappush(queue, (-float(gain), ball))
            continue
        _count_ball(cells, centers[ball], reaches[ball], 1)
        chosen[count] = ball
        count += 1
    return chosen[:count]


@kernel
def trim(cells: CellCounts, centers: Floats, reaches: Floats, order: Ints, only_drop: bool) -> None:
    """Shrink balls, in order, to the cells that only they contain.

    Reaches change in place, to 0 for balls without such cells. With ``only_drop``, only these balls
    change.
    """
    for ball in order:
        farthest = -1.0  # square of the reach that the cells only in this ball need
        row_count, _ = _find_rows(cells, centers[ball], reaches[ball])
        for row in range(row_count):
            i, j, first, stop = cells.rows[row]
            for k in range(first, stop):
                if cells.counts[i, j, k] == 1:
                    offset = abs(k + 0.5 - centers[ball, 2]) + cells.half[2]
                    farthest = max(farthest, cells.squares[row] + offset * offset)
        min_reach = 0.0
        if farthest >= 0.0:
            # One allowance for the reach beyond the cells, one for the rounding of the root.
            min_reach = math.sqrt(farthest) + 2.0 * LATTICE_ROUNDING
        if min_reach < reaches[ball] and not (only_drop and min_reach > 0.0):
            _count_ball(cells, centers[ball], reaches[ball], -1)
            if min_reach > 0.0:
                _count_ball(cells, centers[ball], min_reach, 1)
            reaches[ball] = min_reach


@kernel
def polish(
    cells: CellCounts,
    tree: SurfaceTree,
    centers: Floats,
    radii: Floats,
    corner: Floats,
    side: float,
    error: float,
    nodes: Ints,
) -> None:
    """Move balls inside the shape to contain more cells, in place.

    A step ends inside the ball, and the distance from the boundary becomes the new radius. Steps go
    along the axes, and halve if none helps. ``centers`` has shape (n, 3), ``radii`` (n,).
    ``corner``, shape (3,), is that of the lattice in the space of the tree, ``side`` the side of a
    cell, and ``error`` that of distances; metres. ``nodes`` is scratch.
    """
    first_step = 2.0  # sides of a cell
    for _ in range(6):
        moved = False
        for ball in range(len(centers)):
            # Take the ball out, to count what it would add anywhere else.
            center = centers[ball]
            _count_ball(cells, center, radii[ball], -1)
            _, most = _find_rows(cells, center, radii[ball])
            step = first_step
            for _ in range(4):
                is_better = False
                for direction in range(6):  # -x, +x, -y, +y, -z, +z
                    axis = direction // 2
                    if cells.counts.shape[axis] == 1 or step >= 0.9 * radii[ball]:
                        continue
                    before = center[axis]
                    center[axis] += step * (2 * (direction % 2) - 1)
                    x = corner[0] + side * center[0]
                    y = corner[1] + side * center[1]
                    z = corner[2] + side * center[2]
                    # A radius grows by a step at most.
                    cap = 1.01 * side * (radii[ball] + step) + 4.0 * error
                    distance, _ = bound_point_distance(tree, 0, (x, y, z), cap, 0.0, nodes)
                    radius = (distance - error) / side
                    gain = -1
                    if radius > 0.0:
                        _, gain = _find_rows(cells, center, radius)
                    if gain > most or (gain == most and radius > radii[ball]):
                        is_better = True
                        most = gain
                        radii[ball] = radius
                    else:
                        center[axis] = before
                if is_better:
                    moved = True
                else:
                    step *= 0.5
            _count_ball(cells, center, radii[ball], 1)
        first_step *= 0.5
        if not moved:
            break

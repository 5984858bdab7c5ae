"""Regions to decompose, lattices over them, and bounds of distances and volumes."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from cspace._bodies.triangle_proofs import RADIUS, build_trees
from cspace._grid import Grid
from cspace._limits import check_memory
from cspace._shapes import Balls, ExactShape, Polygons, RoundedSimplices, Shape
from cspace._support.arrays import Floats, Ints, Row
from cspace._support.compiling import allocating, kernel
from cspace._support.threads import run_in_chunks
from cspace._support.vectors import box_distance, row_at, segment_distance_square, triangle_distance
from cspace.errors import InputError

BOUNDARY_ROUNDING: Final = 2.0**-44
"""Rounding error of a distance, relative to the largest coordinate: some hundred units, mostly
unused."""

NORMAL_ROUNDING: Final = 2.0**-36
"""Additional rounding error of distances from triangles that are not thin, relative to the size of
the shape."""

THIN_HEIGHT: Final = 2.0**-12 * (1.0 + 2.0**-20)
"""Height of thin triangles, relative to their longest side; distances from them may be too small by
as much."""

MIN_DEPTHS_PER_THREAD: Final = 4_000
"""Points per thread below which a further thread costs more time than it saves."""

MAX_PIECES_PER_LEAF: Final = 6
"""Pieces of a node that are measured at once, because further boxes would take longer."""

MAX_PENDING_NODES: Final = 64
"""Capacity of the stack of tree nodes: twice the depth of a tree over 2^30 pieces."""

MIN_BOX_CELLS: Final = {2: 40_000, 3: 80_000}
"""Smallest number of cells of the bounding box, by dimension."""

MIN_SHAPE_CELLS: Final = {2: 15_000, 3: 20_000}
"""Number of cells that should meet the shape, by dimension."""

MEASURE_ROUNDING: Final = 2.0**-40
"""Rounding error of a length or an area, relative to the whole."""

MAX_GAP_HALVINGS: Final = 14
"""Largest number of times that the boxes that bound a distance are halved."""

MAX_GAP_BOXES: Final = 4_000_000
"""Largest number of boxes processed at once."""

MAX_DISTANCES_PER_BLOCK: Final = 2**18
"""Number of distances held at once, which fit into a cache."""


class ShapeBoundary:
    """Boundary of an exact shape, and distances from it, in metres.

    Shapes of the plane are placed in space at x = 0. ``pieces``, segments (n, 2, 2) or triangles
    (n, 3, 3), contain the boundary and possibly more. ``error`` is the largest error of a distance.
    """

    def __init__(self, shape: ExactShape) -> None:
        """Take the boundary of a shape; raise InputError if it consists of balls."""
        exact = shape
        if isinstance(shape, Polygons):
            # Unite overlapping polygons, so that only the boundary of the union remains.
            exact = Polygons([shape.outline])
        self.pieces, radii = exact.boundary()
        if radii.any():
            raise InputError(
                "shape",
                "consists of balls already",
                "decompose() finds balls for other shapes",
                "use these balls",
            )
        self.shape = shape
        self.dim = shape.dim
        corners = self.pieces.reshape(-1, self.dim)
        # Distances from triangles have a further rounding error.
        self.error = BOUNDARY_ROUNDING * float(np.abs(corners).max())
        if self.dim == 3:
            self.error += NORMAL_ROUNDING * float(np.linalg.norm(np.ptp(corners, axis=0)))

    @cached_property
    def measure(self) -> tuple[float, float]:
        """Lower and upper bound of the area or volume."""
        if not self.shape.encloses:
            return 0.0, 0.0
        # The volumes of bodies add up only if there is one, which winds once around its inside.
        closed = [body for body in getattr(self.shape, "bodies", ()) if body.closed]
        if not closed or (len(closed) == 1 and (np.abs(closed[0].multiplicities) == 1).all()):
            measure = abs(self.shape.measure)
            return measure, measure
        return _bound_volume(self.shape)

    def depths(self, points: Floats, cap: float = math.inf) -> Floats:
        """Compute lower bounds of the depths of points, negative outside, at most ``cap``."""
        near, far = self.distances(points, cap)
        return np.where(self.shape.contains(points), near, -far) - self.error

    def gaps(self, points: Floats, cap: float = math.inf) -> Floats:
        """Compute lower bounds of the distances of points to the shape, at most ``cap``."""
        is_outside = ~self.shape.contains(points)
        near, _ = self.distances(points[is_outside], cap)
        gaps = np.zeros(len(points))
        gaps[is_outside] = np.maximum(near - self.error, 0.0)
        return gaps

    def distances(self, points: Floats, cap: float = math.inf) -> tuple[Floats, Floats]:
        """Compute lower and upper bounds of distances to the boundary, at most ``cap``."""
        spatial = np.ascontiguousarray(np.pad(points, ((0, 0), (3 - self.dim, 0))))
        near = np.empty(len(points))
        far = np.empty(len(points))

        def bound_chunk(start: int, stop: int) -> int:
            """Bound the distances of some points; -1 means that none is invalid."""
            chunk = slice(start, stop)
            bound_distances(self.tree, spatial[chunk], cap, near[chunk], far[chunk])
            return -1

        run_in_chunks(bound_chunk, len(points), MIN_DEPTHS_PER_THREAD)
        return near, far

    @cached_property
    def tree(self) -> PieceTree:
        """Tree of the pieces, for distances."""
        # Segments of the plane get x = 0 and repeat their last corner.
        missing = 3 - self.dim
        triangles = np.pad(self.pieces, ((0, 0), (0, missing), (missing, 0)), mode="edge")
        triangles[..., :missing] = 0.0
        # Distances from thin triangles may be too small, by as much as their height.
        edges = np.roll(triangles, -1, axis=1) - triangles
        edge_lengths = np.linalg.norm(edges, axis=2)
        longest = edge_lengths.max(axis=1)
        doubled_areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        is_spatial = self.dim == 3
        is_thin = is_spatial & (doubled_areas <= THIN_HEIGHT * longest**2)
        errors = np.where(is_thin, THIN_HEIGHT * longest, 0.0)
        # The tree sorts the pieces; its rows have three corners and the error as a radius.
        (boxes, spans, rows), _ = build_trees([RoundedSimplices(triangles, errors)], about_z=False)
        corners = np.ascontiguousarray(rows[:, :9]).reshape(-1, 3, 3)
        return PieceTree(corners, rows[:, RADIUS].copy(), boxes, spans, is_spatial)


class Region:
    """A shape to decompose, with its two boundaries.

    The shape contains the inner boundary's shape and lies in the outer one's; both are equal if the
    shape is exact. ``depths`` are those of the inner one, and ``gaps`` those of the outer one.
    ``bounds``, shape (2, d), are the corners of a box that contains the shape, and ``size`` is the
    diagonal of the box; metres.
    """

    def __init__(self, shape: Shape) -> None:
        """Take the outer and the inner boundary of a shape."""
        self.shape = shape
        self.dim = shape.dim
        self.bounds = np.array(shape.outer.bounds)
        self.outer = ShapeBoundary(shape.outer)
        self.inner = self.outer if shape.inner is shape.outer else ShapeBoundary(shape.inner)
        self.depths = self.inner.depths
        self.gaps = self.outer.gaps
        self.size = float(np.linalg.norm(np.ptp(self.bounds, axis=0)))

    @property
    def measure(self) -> tuple[float, float]:
        """Lower and upper bound of the area or volume."""
        return self.inner.measure[0], self.outer.measure[1]

    @property
    def box_volume(self) -> float:
        """Volume of the bounding box, thickened to 0.001 diagonals."""
        sides = np.ptp(self.bounds, axis=0)
        return float(np.prod(np.maximum(sides, 1e-3 * self.size)))

    def make_grid(self, spacing: float) -> Grid:
        """Create a grid, of a spacing in metres, that just covers the region.

        Raises InputError if it does not fit into memory.
        """
        counts = np.ceil(np.ptp(self.bounds, axis=0) / spacing).astype(np.int64) + 1
        grid = Grid(self.bounds.mean(axis=0) - 0.5 * spacing * counts, spacing, counts)
        hint = "use a larger tolerance or fewer balls"
        check_memory(64.0 * float(grid.size), "the lattice of the balls", grid, hint=hint)
        return grid


class Lattice:
    """Grid cells that are proven to cover a region.

    ``side`` is the side of a cell, metres. ``cells`` is a mask of the cells of a grid that meet the
    shape, and ``cell_centers``, shape (n, d), are their centers, metres.
    """

    def __init__(self, region: Region, least_side: float = 0.0) -> None:
        """Choose a grid, with sides of at least some metres, and find its cells in a region."""
        self.region = region
        self.least_side = least_side
        dim = region.dim
        self._find_cells(MIN_BOX_CELLS[dim])
        missing = MIN_SHAPE_CELLS[dim] / max(len(self.cell_centers), 1)
        if missing > 1.0:
            # A thin shape fills little of its box, so it needs more cells in the box.
            self._find_cells(MIN_BOX_CELLS[dim] * min(16.0, 2.0 * missing ** (dim / (dim - 1.0))))

    def _find_cells(self, box_cells: float) -> None:
        """Find the cells that meet the region, of a grid of so many cells in its box."""
        region = self.region
        side = float((region.box_volume / box_cells) ** (1.0 / region.dim))
        grid = region.make_grid(max(side, self.least_side))
        self.side = grid.spacing
        self.cells, _ = region.shape.cells(grid)
        centers = grid.lower + self.side * (np.argwhere(self.cells) + 0.5)
        self.cell_centers: Floats = centers.astype(np.float64)

    def find_medial_centers(self) -> Floats:
        """Find cell centers, shape (n, d), around which no neighboring ball contains the ball.

        The balls are the largest ones in the shape. They lie along its medial axis. Growing all
        balls by one length does not change which balls contain others.
        """
        from scipy.ndimage import grey_dilation

        # A ball is contained if a neighbor's depth exceeds its own by the distance of the two
        # centers: a grey dilation.
        depths = np.full(self.cells.shape, -np.inf)
        depths[self.cells] = self.region.depths(self.cell_centers) / self.side
        # Neighbors are up to two cells away, and a contained ball may stick out by 2 % of that
        # distance.
        steps = np.meshgrid(*[np.arange(-2, 3)] * self.region.dim, indexing="ij")
        distances = np.linalg.norm(steps, axis=0)
        highest = grey_dilation(
            depths,
            footprint=distances > 0.0,
            structure=-0.98 * distances,
            mode="constant",
            cval=-np.inf,
        )
        return np.asarray(self.cell_centers[(highest < depths)[self.cells]])


# ---- distances -----------------------------------------------------------------------------------


class PieceTree(NamedTuple):
    """Pieces of a boundary and the boxes of their tree.

    ``pieces``, shape (n, 3, 3), are triangles or, unless ``spatial``, segments between their first
    two corners. ``errors``, shape (n,), bound how much the distances to them may be too small.
    ``boxes`` and ``spans``, shapes (m, 7) and (m, 2), are as in
    :class:`cspace._bodies.triangle_proofs.Trees`.
    """

    pieces: Floats
    errors: Floats
    boxes: Floats
    spans: Ints
    spatial: bool


@allocating
def bound_distance(tree: PieceTree, position: Row, cap: float) -> tuple[float, float]:
    """Return lower and upper bounds of the distance to a boundary, at most ``cap``.

    ``position`` has three coordinates, metres.
    """
    near = cap
    far = cap
    # A stack of nodes, each with its distance, which begins with the root.
    pending = np.empty(MAX_PENDING_NODES, dtype=np.int64)
    gaps = np.empty(MAX_PENDING_NODES)
    pending[0] = 0
    gaps[0] = 0.0
    count = 1
    while count > 0:
        count -= 1
        # Boxes include the errors of their pieces, so no piece is nearer than its box.
        if gaps[count] >= far:
            continue
        node = pending[count]
        start, size = tree.spans[node]
        if size <= MAX_PIECES_PER_LEAF:
            for n in range(start, start + size):
                piece = tree.pieces[n]
                if tree.spatial:
                    gap = triangle_distance(position, piece)
                else:
                    start_corner = row_at(piece[0], 0)
                    stop_corner = row_at(piece[1], 0)
                    gap = math.sqrt(segment_distance_square(position, start_corner, stop_corner))
                near = min(near, gap)
                far = min(far, gap + tree.errors[n])
            continue
        child_a = node + 1
        child_b = node + 2 * (size // 2)
        gap_a = box_distance(tree.boxes[child_a], position)
        gap_b = box_distance(tree.boxes[child_b], position)
        # Push the nearer box last, so that it is popped first.
        if gap_a < gap_b:
            child_a, child_b, gap_a, gap_b = child_b, child_a, gap_b, gap_a
        pending[count] = child_a
        pending[count + 1] = child_b
        gaps[count] = gap_a
        gaps[count + 1] = gap_b
        count += 2
    return near, far


@kernel
def bound_distances(tree: PieceTree, points: Floats, cap: float, near: Floats, far: Floats) -> None:
    """Bound distances of points, shape (n, 3), from the boundary, up to ``cap``.

    ``near`` and ``far``, shape (n,), receive the lower and upper bounds.
    """
    for n in range(len(points)):
        near[n], far[n] = bound_distance(tree, row_at(points[n], 0), cap)


def bound_ball_measure(centers: Floats, radii: Floats) -> tuple[float, float]:
    """Return lower and upper bounds of the area or volume of a union of balls."""
    if centers.shape[1] == 3:
        return _bound_volume(Balls(centers, radii))
    import shapely

    # Inscribed and circumscribed polygons bound the area of the discs.
    quarter = int(np.clip(2**16 // len(radii), 64, 1024)) // 4  # sides in a quarter of a circle
    lower, upper = Balls(centers, radii).bounds
    points = shapely.points(centers - lower)
    circumscribed = radii / math.cos(math.pi / (4 * quarter))
    inner, outer = (
        float(shapely.union_all(shapely.buffer(points, sizes, quad_segs=quarter)).area)
        for sizes in (radii, circumscribed)
    )
    # GEOS may snap corners, for which 1e-9 allows.
    error = MEASURE_ROUNDING * float(np.subtract(upper, lower).max()) ** 2
    return max(0.0, inner * (1.0 - 1e-9) - error), outer * (1.0 + 1e-9) + error


def _bound_volume(shape: ExactShape) -> tuple[float, float]:
    """Return lower and upper bounds of a volume, from cells inside and cells that cover it."""
    lower, upper = np.array(shape.bounds)
    sides = upper - lower
    # About two million cells; flat boxes count as thicker, to bound the number.
    box_volume = np.prod(np.maximum(sides, 1e-3 * sides.max()))
    spacing = float(np.cbrt(box_volume / 2**21))
    counts = np.ceil(sides / spacing) + 1.0
    corner = 0.5 * (lower + upper - spacing * counts)
    outer, inner = shape.cells(Grid(corner, spacing, counts.astype(np.int64)))
    cell_volume = spacing**3
    return np.count_nonzero(inner) * cell_volume, np.count_nonzero(outer) * cell_volume


def bound_shape_to_balls(
    lattice: Lattice, centers: Floats, radii: Floats
) -> tuple[float, float, Floats]:
    """Bound the largest distance from a shape to balls, metres.

    Points give the lower bound. Boxes that cover the shape give the upper bound; boxes that may
    contain the farthest point are halved until the bounds differ by 2 % or by 1e-4 of the size of
    the shape.

    Returns the bounds, in metres, and the growth of each ball, shape (n,). Each box is assigned to
    the ball nearest to its center, which grows to contain it, so the grown balls cover the shape.
    The growth is -inf for a ball without boxes.
    """
    region = lattice.region
    half = 0.5 * lattice.side
    dim = lattice.region.dim
    error = MEASURE_ROUNDING * (region.size + float(np.abs(region.bounds).max()))
    corners = region.inner.pieces.reshape(-1, dim)
    corner_gaps, _, _ = cube_gaps(corners, 0.0, centers, radii)
    low = float(corner_gaps.max())
    box_centers = lattice.cell_centers
    high = 0.0
    growths = np.full(len(radii), -np.inf)
    child_offsets = 0.5 * np.array(list(product((-1.0, 1.0), repeat=dim)))  # in half sides
    for level in range(MAX_GAP_HALVINGS + 1):
        near, far, owners = cube_gaps(box_centers, half, centers, radii)
        # Drop boxes that change no result, and boxes that are proven to lie outside the shape.
        relevant = np.flatnonzero((near > low) | (far > np.minimum(growths[owners], high)))
        radius = half * math.sqrt(dim) * (1.0 + 1e-9) + error  # of a ball around a box
        cap = 1.01 * radius + 2.0 * region.outer.error
        relevant = relevant[region.gaps(box_centers[relevant], cap) <= radius]
        farther = relevant[near[relevant] > low]
        # A point of the shape lies within the negative depth of a center.
        depths = region.depths(box_centers[farther], cap)
        lows = near[farther] + np.minimum(depths, 0.0)
        low = max(low, float(lows[depths > -cap].max(initial=0.0)))
        box_centers = box_centers[relevant]
        far = far[relevant]
        owners = owners[relevant]
        # Boxes that reach little beyond the lower bound are final; the others are halved.
        is_open = far > low + max(0.02 * low, 1e-4 * region.size)
        child_count = np.count_nonzero(is_open) * len(child_offsets)
        if level == MAX_GAP_HALVINGS or child_count > MAX_GAP_BOXES:
            is_open[:] = False
        high = max(high, float(far[~is_open].max(initial=0.0)))
        np.maximum.at(growths, owners[~is_open], far[~is_open])
        box_centers = (box_centers[is_open, None] + half * child_offsets).reshape(-1, dim)
        half = 0.5 * half
        if not len(box_centers):
            break
    return max(low - error, 0.0), max(high, low) + error, growths + error


def bound_balls_to_shape(region: Region, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bound the largest distance from balls to a shape, metres.

    The upper bound comes from the depths of the centers: a ball sticks out of the shape by at most
    its radius minus that depth. The lower bound comes from points of the spheres.
    """
    excesses = radii - region.depths(centers)
    high = max(0.0, float(excesses.max()))
    # Points of each sphere in random directions, as many as memory allows, at most 200.
    count = max(1, min(200, MAX_GAP_BOXES // len(radii)))
    directions = np.random.default_rng(0).normal(size=(count, region.dim))
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    directions *= (1.0 - MEASURE_ROUNDING) / lengths
    points = centers[:, None] + radii[:, None, None] * directions
    low = float(region.gaps(points.reshape(-1, region.dim)).max())
    return min(low, high), high


def cube_gaps(
    points: Floats, half: float, centers: Floats, radii: Floats
) -> tuple[Floats, Floats, Ints]:
    """Measure cubes around points against balls.

    ``points`` has shape (n, d); ``half`` is half the side of a cube; metres. Returns three arrays
    of shape (n,): the distance from each point to the nearest ball, the length by which that ball
    must grow to contain the cube, and the index of the ball. Lengths are negative deep in a ball.
    """
    from scipy.spatial.distance import cdist

    near, far = np.empty((2, len(points)))
    owners = np.empty(len(points), dtype=np.int64)
    # Blocks of points bound the memory of all distances.
    size = max(1, MAX_DISTANCES_PER_BLOCK // len(radii))
    for start in range(0, len(points), size):
        block = slice(start, start + size)
        gaps = cdist(points[block], centers) - radii
        nearest = gaps.argmin(axis=1)
        near[block] = gaps.min(axis=1)
        farthest_corners = np.abs(points[block] - centers[nearest]) + half
        far[block] = np.linalg.norm(farthest_corners, axis=1) - radii[nearest]
        owners[block] = nearest
    return near, far, owners

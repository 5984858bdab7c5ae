"""Regions to decompose, lattices over them, and bounds of distances and volumes."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace import Grid
from cspace.errors import InputError
from cspace.inside import (
    Balls,
    ExactShape,
    Floats,
    Ints,
    Shape,
    SurfaceTree,
    as_shape,
    bound_point_distance,
    box_trees,
    check_memory,
    kernel,
    run_in_chunks,
    vectors,
)

NORMAL_ROUNDING: Final = 2.0**-36
"""Additional rounding error of distances from triangles that are not thin, relative to the size of
the shape."""

MAX_LATTICE_CELLS: Final = 2**24
"""Largest number of cells of the lattice over a shape's bounding box."""

MAX_CELLS_PER_TOLERANCE: Final = {2: 12.0, 3: 6.0}
"""Largest ratio of the tolerance to the side of a lattice cell, by dimension."""

USUAL_LATTICE_CELLS: Final = {2: 150_000, 3: 120_000}
"""Cells of the bounding box up to which the lattice may have MAX_CELLS_PER_TOLERANCE, by dimension.
"""

MIN_BOX_CELLS: Final = {2: 40_000, 3: 80_000}
"""Smallest number of cells of the bounding box, by dimension."""

MIN_SHAPE_CELLS: Final = {2: 15_000, 3: 20_000}
"""Smallest number of cells that meet the shape, by dimension."""

BOX_CELLS_PER_BALL: Final = {2: 100, 3: 60}
"""Smallest number of cells of the bounding box for each ball, by dimension."""

MEASURE_ROUNDING: Final = 2.0**-40
"""Rounding error of a length or an area, relative to the whole."""

MAX_GAP_HALVINGS: Final = 14
"""Largest number of times that the boxes that bound a distance are halved."""

MAX_GAP_BOXES: Final = 4_000_000
"""Largest number of boxes processed at once."""

SMALLEST_LENGTH: Final = 1e-300
"""Smallest length that others are divided by, metres."""


class ShapeBoundary:
    """Boundary of an exact shape, and distances from it, in metres.

    Shapes of the plane are placed in space at x = 0. ``pieces``, segments (n, 2, 2) or triangles
    (n, 3, 3), contain the boundary and possibly more. ``error`` is the largest error of a distance.
    """

    def __init__(self, shape: ExactShape) -> None:
        """Take a shape's boundary; raise InputError for balls."""
        exact = shape
        if shape.kind == "polygon":
            # Unite overlapping polygons, so that only the boundary of the union remains.
            exact = as_shape(shape.outline).outer
        self.pieces, radii = exact.boundary()
        if radii.any():
            raise InputError(
                "shape",
                "consists of balls already",
                "decompose() finds balls for other shapes",
            )
        self.shape = shape
        self.dim = shape.dim
        corners = self.pieces.reshape(-1, self.dim)
        # Distances from triangles have a further rounding error.
        # Rounding error of a distance, relative to the largest coordinate: some hundred units,
        # mostly unused.
        self.error = 2.0**-44 * float(np.abs(corners).max())
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
        """Bound depths of points, negative outside, from below, to ``cap``."""
        near, far = self.distances(points, cap)
        return np.where(self.shape.contains(points), near, -far) - self.error

    def gaps(self, points: Floats, cap: float = math.inf) -> Floats:
        """Bound distances of points to the shape from below, to ``cap``."""
        is_outside = ~self.shape.contains(points)
        near, _ = self.distances(points[is_outside], cap)
        gaps = np.zeros(len(points))
        gaps[is_outside] = np.maximum(near - self.error, 0.0)
        return gaps

    def distances(self, points: Floats, cap: float = math.inf) -> tuple[Floats, Floats]:
        """Bound distances to the boundary, both ways, to ``cap``."""
        spatial = np.ascontiguousarray(np.pad(points, ((0, 0), (3 - self.dim, 0))))
        near = np.empty(len(points))
        far = np.empty(len(points))

        def bound_chunk(start: int, stop: int) -> int:
            """Bound the distances of some points; -1 means that none is invalid."""
            chunk = slice(start, stop)
            nodes = np.empty((box_trees.MAX_PENDING_PAIRS, 2), dtype=np.int64)
            bound_distances(self.tree, spatial[chunk], cap, near[chunk], far[chunk], nodes)
            return -1

        # Points per thread below which a further thread costs more time than it saves.
        run_in_chunks(bound_chunk, len(points), 4_000)
        return near, far

    def sample(self, number: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Draw evenly spread boundary points and normals, (number, d) each."""
        sides = np.diff(self.pieces, axis=1)
        normals = (
            sides[:, 0, ::-1] * (1.0, -1.0) if self.dim == 2 else np.cross(*sides.swapaxes(0, 1))
        )
        sizes = np.linalg.norm(normals, axis=1)
        shares = sizes / sizes.sum() if sizes.any() else None
        chosen = rng.choice(len(sizes), number, p=shares)
        weights = rng.dirichlet(np.ones(self.dim), number)
        points = np.einsum("ij,ijk->ik", weights, self.pieces[chosen])
        lengths = np.maximum(sizes, SMALLEST_LENGTH)[chosen, None]
        return points, normals[chosen] / lengths

    @cached_property
    def tree(self) -> SurfaceTree:
        """Tree of the pieces, for distances."""
        # Segments of the plane get x = 0 and repeat their last corner.
        missing = 3 - self.dim
        triangles = np.pad(self.pieces, ((0, 0), (0, missing), (missing, 0)), mode="edge")
        triangles[..., :missing] = 0.0
        boxes, order, spans = box_trees.build_boxes(triangles.min(axis=1), triangles.max(axis=1))
        return SurfaceTree(boxes, spans, triangles[order], np.ones(len(order), dtype=np.int64))


class Region:
    """A shape to decompose, with its two boundaries.

    The shape contains the inner boundary's shape and lies in the outer one's; both are equal if the
    shape is exact. ``depths`` are those of the inner one, and ``gaps`` those of the outer one.
    ``bounds``, shape (2, d), are the corners of a box that contains the shape, and ``size`` is the
    diagonal of the box; metres.
    """

    def __init__(self, shape: Shape) -> None:
        """Take the outer and inner boundary of a shape."""
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
        """Create a grid that just covers the region, metres.

        Raises InputError if it does not fit into memory.
        """
        counts = np.ceil(np.ptp(self.bounds, axis=0) / spacing).astype(np.int64) + 1
        grid = Grid(self.bounds.mean(axis=0) - 0.5 * spacing * counts, spacing, counts)
        check_memory(64.0 * float(grid.size), "the lattice of the balls", grid)
        return grid


class Lattice:
    """Grid cells that are proven to cover a region.

    A lattice of the plane gets a first axis of one cell. Lattice coordinates are in cell sides,
    from the lower corner of the grid; along the added axis they are 0.5. ``side`` is the side of a
    cell, metres, and ``diagonal`` its diagonal, in sides. ``cells``, shape (nx, ny, nz), is a mask
    of the cells that meet the shape, and ``cell_centers``, shape (n, 3), are their centers.
    ``half``, shape (3,), is half a cell along each real axis, and ``corner``, shape (3,), the
    lattice origin in the space of the region's tree, metres.
    """

    def __init__(self, region: Region, spacing: float) -> None:
        """Find the cells, with sides of ``spacing`` metres, that meet a region."""
        grid = region.make_grid(spacing)
        added_axes = 3 - region.dim
        cells, _ = region.shape.cells(grid)
        self.region = region
        self.side = grid.spacing
        self.diagonal = math.sqrt(region.dim)
        self.half = np.array([0.0] * added_axes + [0.5] * region.dim)
        self.corner = np.array([-0.5 * self.side] * added_axes + list(grid.lower))
        self.cells = cells.reshape((1,) * added_axes + cells.shape)
        self.cell_centers: Floats = np.argwhere(self.cells) + np.float64(0.5)

    @cached_property
    def depths(self) -> Floats:
        """Lower bounds of the depths at the cell centers, in sides."""
        return self.depths_at(self.cell_centers)

    @classmethod
    def for_tolerance(cls, region: Region, tolerance: float) -> Lattice:
        """Create a lattice on which a tolerance, in metres, can be proven.

        Raises InputError if that takes too many cells.
        """
        usual = _find_cell_side(region, USUAL_LATTICE_CELLS[region.dim])
        finest = _find_cell_side(region, MAX_LATTICE_CELLS)
        # Smallest ratio of the tolerance to the side of a cell, whose diagonal must be well below
        # the tolerance.
        min_cells_per_tolerance = 2.6
        if tolerance < min_cells_per_tolerance * finest:
            raise InputError(
                "tolerance",
                f"is {tolerance:g} m, but the shape is {region.size:g} m across",
                f"its proof needs too many cells below {min_cells_per_tolerance * finest:.2g} m",
            )
        side = max(usual, tolerance / MAX_CELLS_PER_TOLERANCE[region.dim])
        return cls(region, min(side, tolerance / min_cells_per_tolerance))

    @classmethod
    def for_count(cls, region: Region, number: int) -> Lattice:
        """Create a lattice that resolves ``number`` balls."""
        dim = region.dim
        cells_for_balls = number * BOX_CELLS_PER_BALL[dim]
        box_cells = min(max(MIN_BOX_CELLS[dim], cells_for_balls), MAX_LATTICE_CELLS)
        enough_cells = max(MIN_SHAPE_CELLS[dim], cells_for_balls // 2)
        # Cells of the bounding box up to which the lattice of a thin shape is refined.
        max_refined_cells = 2**20
        while True:
            lattice = cls(region, _find_cell_side(region, box_cells))
            shape_cells = len(lattice.cell_centers)
            if shape_cells >= enough_cells or 2 * box_cells > max_refined_cells:
                return lattice
            # A thin shape fills little of its box, so it needs more cells in the box.
            factor = (enough_cells / max(shape_cells, 1)) ** (dim / (dim - 1.0))
            factor = min(max(2.0, factor), 16.0)
            box_cells = min(max_refined_cells, int(box_cells * factor))

    @cached_property
    def hollows(self) -> NDArray[np.bool_]:
        """Mask of cells that no way from outside reaches."""
        from scipy.ndimage import binary_fill_holes

        return np.asarray(binary_fill_holes(self.cells) & ~self.cells)

    def filled_depths(self, points: Floats) -> Floats:
        """Estimate depths of points (n, d) with hollows filled."""
        depths = self.region.depths(points)
        cells = np.floor(self.from_metres(points)).astype(np.int64)
        cells = np.clip(cells, 0, np.array(self.cells.shape) - 1)  # the outermost are no hollows
        return np.where(self.hollows[tuple(cells.T)], -depths, depths)

    def to_metres(self, points: Floats) -> Floats:
        """Convert lattice coordinates (n, 3) to metres (n, d)."""
        in_space = self.corner + self.side * points
        return np.asarray(in_space[:, 3 - self.region.dim :])

    def from_metres(self, points: Floats) -> Floats:
        """Convert points (n, d) in metres to lattice coordinates (n, 3)."""
        in_space = np.pad(points, ((0, 0), (3 - self.region.dim, 0)))
        return np.asarray((in_space - self.corner) / self.side)

    def depths_at(self, points: Floats) -> Floats:
        """Bound depths of points (n, 3) from below, in sides."""
        return self.region.depths(self.to_metres(points)) / self.side


def _find_cell_side(region: Region, box_cells: float) -> float:
    """Find the side, metres, for ``box_cells`` cells in the box."""
    return float((region.box_volume / box_cells) ** (1.0 / region.dim))


# ---- distances -----------------------------------------------------------------------------------


@kernel
def bound_distances(
    tree: SurfaceTree, points: Floats, cap: float, near: Floats, far: Floats, nodes: Ints
) -> None:
    """Bound distances of points (n, 3) from the boundary, up to ``cap``.

    ``near`` and ``far``, shape (n,), receive the lower and upper bounds; ``nodes`` is scratch.
    """
    for n in range(len(points)):
        point = vectors.row_at(points[n], 0)
        near[n], far[n] = bound_point_distance(tree, 0, point, cap, 0.0, nodes)


def bound_ball_measure(centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bound united balls' area or volume, both ways."""
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
    """Bound a volume both ways, by inner and covering cells."""
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
    """Bound the largest distance from shape to balls, metres.

    Points give the lower bound. Boxes that cover the shape give the upper bound; boxes that may
    contain the farthest point are halved until the bounds differ by 0.5 % or by 1e-4 of the size of
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
    box_centers = lattice.to_metres(lattice.cell_centers)
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
        is_open = far > low + max(0.005 * low, 1e-4 * region.size)
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
    """Bound the largest distance from balls to shape, metres.

    Points of the balls give the lower bound. The upper bound comes from boxes around the balls:
    the part of a ball in a box sticks out by at most half the diagonal minus the depth of the point
    of the ball nearest to the center of the box. Boxes that may stick out most are halved until the
    bounds differ by 0.5 % or by 1e-4 of the size of the shape.
    """
    # Points of each sphere in random directions, as many as memory allows, at most 200.
    count = max(1, min(200, MAX_GAP_BOXES // len(radii)))
    directions = np.random.default_rng(0).normal(size=(count, region.dim))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inner_radii = radii * (1.0 - MEASURE_ROUNDING)
    points = centers[:, None] + inner_radii[:, None, None] * directions
    low = float(region.gaps(points.reshape(-1, region.dim)).max())
    excesses = radii - region.depths(centers)
    owners = np.arange(len(radii))
    offsets = np.zeros_like(centers)  # from the center of the ball to that of the box
    halves = radii[:, None]  # halves of the sides of the boxes
    child_offsets = np.array(list(product((-1.0, 1.0), repeat=region.dim)))
    high = 0.0
    for _ in range(MAX_GAP_HALVINGS):
        is_open = excesses > low + max(0.005 * low, 1e-4 * region.size)
        high = max(high, float(excesses[~is_open].max(initial=0.0)))
        children = np.flatnonzero(is_open).repeat(len(child_offsets))
        excesses = excesses[is_open]
        # Largest number of boxes of balls processed at once, for the time they take.
        if not 0 < len(children) <= 200_000:
            break
        halves = 0.5 * halves[children]
        offsets = offsets[children] + halves * np.resize(child_offsets, (len(children), region.dim))
        owners = owners[children]
        excesses = excesses.repeat(len(child_offsets))
        # Only boxes that meet their ball count.
        gaps = np.linalg.norm(np.maximum(np.abs(offsets) - halves, 0.0), axis=1)
        meets = gaps <= radii[owners]
        halves, offsets, owners, excesses = (
            values[meets] for values in (halves, offsets, owners, excesses)
        )
        shares = inner_radii[owners] / np.linalg.norm(offsets, axis=1)
        points = centers[owners] + offsets * np.minimum(shares, 1.0)[:, None]
        depths = region.depths(points)
        low = max(low, float(region.gaps(points[-depths > low]).max(initial=0.0)))
        diagonals = math.sqrt(region.dim) * halves[:, 0] + 2.0**-38 * radii[owners]
        excesses = np.minimum(excesses, diagonals - depths)
    high = max(high, float(excesses.max(initial=0.0)))
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
    # Number of distances held at once, which fit into a cache.
    size = max(1, 2**18 // len(radii))
    for start in range(0, len(points), size):
        block = slice(start, start + size)
        gaps = cdist(points[block], centers) - radii
        nearest = gaps.argmin(axis=1)
        near[block] = gaps.min(axis=1)
        farthest_corners = np.abs(points[block] - centers[nearest]) + half
        far[block] = np.linalg.norm(farthest_corners, axis=1) - radii[nearest]
        owners[block] = nearest
    return near, far, owners

"""Region: a shape to be decomposed, by its signed distance; the lattice of its cells; and how far the shape and
balls are from each other, and how much balls take up, each as two bounds."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Floats, Ints
from cspace.compiling import jit, kernel
from cspace.errors import InputError
from cspace.exact.triangles import build_trees
from cspace.grid import Grid
from cspace.kernels import point_segment, point_triangle, row_of
from cspace.limits import check_memory
from cspace.shapes import Balls, ExactShape, Pieces, Polygons, Shape
from cspace.threads import in_chunks

ROUNDING: Final = 2.0**-44
"""Rounding of a distance, in the largest coordinate: some hundred units, of which few are used up."""

TILTED: Final = 2.0**-36
"""What the rounding of normals adds to it, in the size of the shape, of triangles that are not thin."""

THIN: Final = 2.0**-12 * (1.0 + 2.0**-20)
"""Height of a triangle, in its longest side, up to which a distance may be that much too small."""

POINTS_A_THREAD: Final = 4_000
LEAF: Final = 6  # pieces that are looked at together
DEPTH: Final = 64  # most boxes of a tree that wait at a time: twice the depth of one over 2^30 pieces
MOST: Final = 2**24  # cells of the box round a shape, at most
BYTES: Final = 64  # memory for each of them, at most
FINEST: Final = {2: 12.0, 3: 6.0}  # cells of the lattice that a tolerance is long, at most
COARSEST: Final = 2.6  # the same, at least: a cell's diagonal must be well below it
USUAL: Final = {2: 150_000, 3: 120_000}  # cells of the box round a shape up to which it may be FINEST cells long
MEASURED: Final = 2**23  # cells of a box by which the volume of what is in it is bounded
FEW: Final = 2**20  # cells of the box up to which a shape that fills little of it gets a finer lattice

BOX: Final = {2: 40_000, 3: 80_000}
USED: Final = {2: 15_000, 3: 20_000}
A_BALL: Final = {2: 100, 3: 60}
"""Cells of the box, those that meet the shape, and those of the box for each ball, that resolve balls."""

ROUNDED: Final = 2.0**-40  # rounding of a length or an area, in the size of the whole, with room to spare
SNAPPED: Final = 1e-9  # part of an area that the union of polygons may add or lose, where it snaps corners
CORNERS: Final = 2**16  # of the polygons that stand for discs, together, if that leaves each from 64 to 1024
CLOSE: Final = 0.02  # part of a distance by which its bounds may be apart, where that can be had
SMALL: Final = 1e-4  # part of the size of a shape by which the bounds of a distance may be apart in any case
LEVELS: Final = 14  # how often boxes are halved for a distance, at most
BOXES: Final = 1_000_000  # boxes that are looked at together, at most
DIRECTIONS: Final = 200  # points of each sphere whose distance from the shape is measured


class Border:
    """The border of an exact shape, and distances from it; a plane lies in space as x = 0.

    ``pieces``, segments (n, 2, 2) or triangles (n, 3, 3), contain the border, and maybe more. ``slack`` is the largest
    error of a distance. All is in metres.
    """

    def __init__(self, shape: ExactShape) -> None:
        # Of polygons that overlap, the border is that of their union.
        self.pieces, radii = (Polygons([shape.outline]) if isinstance(shape, Polygons) else shape).boundary()
        if radii.any():
            raise InputError(
                "shape", "is made of balls already", "a decomposition finds such", "use them as they are", value=shape
            )
        self.shape, self.dim = shape, shape.dim
        corners = self.pieces.reshape(-1, self.dim)
        self.slack = ROUNDING * float(np.abs(corners).max())
        if self.dim == 3:
            self.slack += TILTED * float(np.linalg.norm(np.ptp(corners, axis=0)))

    @cached_property
    def measure(self) -> tuple[float, float]:
        """Bounds of the area or volume, which differ where bodies of a mesh may overlap."""
        if not self.shape.encloses:
            return 0.0, 0.0
        closed = [body for body in getattr(self.shape, "bodies", ()) if body.closed]
        if not closed or (len(closed) == 1 and (np.abs(closed[0].turns) == 1).all()):
            return abs(self.shape.measure), abs(self.shape.measure)
        return _volume(self.shape)

    def depths(self, points: Floats) -> Floats:
        """A lower bound of the signed distance from the border, above zero inside, shape (n,), metres."""
        near, far = self._distances(points)
        return np.where(self.shape.contains(points), near, -far) - self.slack

    def gaps(self, points: Floats) -> Floats:
        """A lower bound of the distance from points (n, d) to the shape, shape (n,), metres."""
        outside, gaps = ~self.shape.contains(points), np.zeros(len(points))
        gaps[outside] = np.maximum(self._distances(points[outside])[0] - self.slack, 0.0)
        return gaps

    def _distances(self, points: Floats) -> tuple[Floats, Floats]:
        """Bounds of the distances from points (n, d), metres, wrong by :attr:`slack` at most."""
        spatial = np.ascontiguousarray(np.pad(points, ((0, 0), (3 - self.dim, 0))))
        near, far = np.empty(len(points)), np.empty(len(points))

        def work(start: int, stop: int) -> int:
            part = slice(start, stop)
            distances(self.tree, spatial[part], near[part], far[part])
            return -1

        in_chunks(work, len(points), POINTS_A_THREAD)
        return near, far

    @cached_property
    def tree(self) -> Tree:
        """The pieces, in the tree by which distances are found."""
        triangles = np.pad(self.pieces, ((0, 0), (0, 3 - self.dim), (3 - self.dim, 0)), mode="edge")
        triangles[..., : 3 - self.dim] = 0.0
        edges = np.roll(triangles, -1, axis=1) - triangles
        longest = np.linalg.norm(edges, axis=2).max(axis=1)
        areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        doubts = np.where((areas <= THIN * longest**2) & (self.dim == 3), THIN * longest, 0.0)
        (boxes, spans, rows), _ = build_trees([Pieces(triangles, doubts)], about_z=False)
        corners = np.ascontiguousarray(rows[:, :9]).reshape(-1, 3, 3)
        return Tree(corners, rows[:, 9].copy(), boxes, spans, self.dim == 3)


class Region:
    """A shape to be decomposed, by the borders of its outer and of its inner shape, which are the same if it is exact.

    ``bounds`` are the corners of a box that contains it, shape (2, d), and ``size`` is the diagonal of that; metres.
    """

    def __init__(self, shape: Shape) -> None:
        self.shape, self.dim, self.bounds = shape, shape.dim, np.array(shape.outer.bounds)
        self.outer = self.inner = Border(shape.outer)
        if shape.inner is not shape.outer:
            self.inner = Border(shape.inner)
        self.size = float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def measure(self) -> tuple[float, float]:
        """Bounds of the area or volume."""
        return self.inner.measure[0], self.outer.measure[1]

    @property
    def box_volume(self) -> float:
        """Of the bounding box, whose sides are taken to be at least a thousandth of its diagonal long."""
        return float(np.prod(np.maximum(self.bounds[1] - self.bounds[0], 1e-3 * self.size)))

    def grid_at(self, spacing: float) -> Grid:
        """A grid that covers the set, with cells of this side (metres), and no larger; InputError if too many."""
        counts = np.ceil((self.bounds[1] - self.bounds[0]) / spacing) + 1.0
        hint = "use a larger tolerance or fewer balls"
        if float(np.prod(counts)) > 1.5 * MOST:
            problem = f"or number needs a lattice of {' x '.join(f'{n:.4g}' for n in counts)} cells of {spacing:g} m"
            raise InputError("tolerance", problem, f"at most {MOST} are looked at", hint)
        grid = Grid(self.bounds.mean(axis=0) - 0.5 * spacing * counts, spacing, counts.astype(np.int64))
        check_memory(BYTES * float(grid.size), "the lattice of the balls", grid, hint=hint)
        return grid

    def depths(self, points: Floats) -> Floats:
        """A lower bound of how deep points lie in the shape, negative outside, shape (n,), metres."""
        return self.inner.depths(points)

    def gaps(self, points: Floats) -> Floats:
        """A lower bound of the distance from points (n, d) to the shape, shape (n,), metres."""
        return self.outer.gaps(points)


class Lattice:
    """Cells of a grid, of a spacing and no larger, whose union is proven to cover a region.

    Two axes are held as three, of which the first is one cell long. Lengths in *sides* are in sides of a cell, from the
    grid's lower corner; along an axis that is added, all is at 0.5. Of a cell, ``side`` is in metres and ``diagonal``
    in sides; ``middles``, shape (n, 3), are those of the cells, in sides; ``half`` is half a cell along each axis that
    there is; and ``corner`` is where the point 0 in sides lies in the space of the region's tree, metres.
    """

    def __init__(self, region: Region, spacing: float) -> None:
        grid, flat = region.grid_at(spacing), 3 - region.dim
        cells = region.shape.cells(grid)[0]
        self.region, self.side, self.diagonal = region, grid.spacing, math.sqrt(region.dim)
        self.half = np.array([0.0] * flat + [0.5] * region.dim)
        self.corner = np.array([-0.5 * self.side] * flat + list(grid.lower))
        self.cells = cells.reshape((1,) * flat + cells.shape)
        self.middles: Floats = np.argwhere(self.cells) + np.float64(0.5)

    @cached_property
    def depths(self) -> Floats:
        """Lower bounds of the signed distances of the middles, in sides."""
        return self.depths_at(self.middles)

    @classmethod
    def within(cls, region: Region, tolerance: float) -> Lattice:
        """A lattice on which a tolerance, metres, can be proven."""
        usual, least = (float((region.box_volume / n) ** (1.0 / region.dim)) for n in (USUAL[region.dim], MOST))
        if tolerance < COARSEST * least:
            problem, rule = (
                f"is {tolerance:g} m, and the shape {region.size:g} m across",
                "to prove it takes many cells",
            )
            raise InputError(
                "tolerance", problem, rule, f"pass at least about {1.2 * COARSEST * least:.2g} m", value=tolerance
            )
        return cls(region, min(max(usual, tolerance / FINEST[region.dim]), tolerance / COARSEST))

    @classmethod
    def fine(cls, region: Region, number: int, finer: int = 1) -> Lattice:
        """A lattice on which so many balls can be resolved, or one with more cells by a factor."""
        dim = region.dim
        box = min(finer * max(BOX[dim], number * A_BALL[dim]), MOST)
        enough = finer * max(USED[dim], number * A_BALL[dim] // 2)
        while True:
            lattice = cls(region, float((region.box_volume / box) ** (1.0 / dim)))
            if len(lattice.middles) >= enough or 2 * box > FEW:
                return lattice
            # A thin shape fills little of its box.
            short = (enough / max(len(lattice.middles), 1)) ** (dim / (dim - 1.0))
            box = min(FEW, int(box * min(max(2.0, short), 16.0)))

    def metres(self, points: Floats) -> Floats:
        """Points in sides, (n, 3), as points (n, d) in metres."""
        return np.asarray((self.corner + self.side * points)[:, 3 - self.region.dim :])

    def depths_at(self, points: Floats) -> Floats:
        """The region's depths at points in sides, (n, 3), in sides, shape (n,)."""
        return self.region.depths(self.metres(points)) / self.side


# ---- distances -------------------------------------------------------------------------------------------------------


class Tree(NamedTuple):
    """Pieces of a border in space, and boxes round them.

    ``pieces`` (n, 3, 3) are triangles or, unless ``solid``, segments between their first two corners, and ``doubts`` by
    how much a distance to each may be too small; ``boxes`` (m, 7) and ``spans`` (m, 2) are as in
    :class:`cspace.exact.triangles.Trees`.
    """

    pieces: Floats
    doubts: Floats
    boxes: Floats
    spans: Ints
    solid: bool


@kernel
def _to_box(point: Floats, box: Floats) -> float:
    """Distance from a point to a box."""
    square = 0.0
    for axis in range(3):
        square += max(0.0, abs(point[axis] - box[axis]) - box[3 + axis]) ** 2
    return math.sqrt(square)


@jit  # it makes arrays
def distance(tree: Tree, point: Floats, most: float) -> tuple[float, float]:
    """Bounds of the distance from a point to the nearest piece, if they are below ``most``, and else ``most``."""
    place, near, far = row_of(point, 0), most, most
    waiting, gaps = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    waiting[0], gaps[0], count = 0, 0.0, 1
    while count > 0:
        count -= 1
        # A box holds all that its pieces may be by doubt; none in it is nearer than the box.
        if gaps[count] >= far:
            continue
        node = waiting[count]
        start, size = tree.spans[node]
        if size <= LEAF:
            for n in range(start, start + size):
                piece = tree.pieces[n]
                if tree.solid:
                    gap = point_triangle(place, piece)
                else:
                    gap = math.sqrt(point_segment(place, row_of(piece[0], 0), row_of(piece[1], 0)))
                near, far = min(near, gap), min(far, gap + tree.doubts[n])
            continue
        first, second = node + 1, node + 2 * (size // 2)
        one, other = _to_box(point, tree.boxes[first]), _to_box(point, tree.boxes[second])
        # The nearer box comes last, and so is looked at first.
        if one < other:
            first, second, one, other = second, first, other, one
        waiting[count], waiting[count + 1], gaps[count], gaps[count + 1] = first, second, one, other
        count += 2
    return near, far


@kernel
def distances(tree: Tree, points: Floats, near: Floats, far: Floats) -> None:
    """Bounds of distances from points, shape (n, 3); quickest where neighbours follow one another."""
    for n in range(len(points)):
        most = math.inf
        if n > 0:  # no farther than from the point before, and the way from there
            square = 0.0
            for axis in range(3):
                square += (points[n, axis] - points[n - 1, axis]) ** 2
            most = (far[n - 1] + math.sqrt(square)) * 1.000001 + 1e-300
        near[n], far[n] = distance(tree, points[n], most)


def measure_of_balls(centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of the area (d = 2) or volume (d = 3) of a union of balls, centers (n, d) and radii (n,) in metres."""
    if centers.shape[1] == 3:
        return _volume(Balls(centers, radii))
    import shapely

    # By polygons in the discs, and around them.
    quarter = int(np.clip(CORNERS // len(radii), 64, 1024)) // 4
    lower, upper = Balls(centers, radii).bounds
    middles = shapely.points(centers - lower)
    inner, outer = (
        float(shapely.union_all(shapely.buffer(middles, scale * radii, quad_segs=quarter)).area)
        for scale in (1.0, 1.0 / math.cos(math.pi / (4 * quarter)))
    )
    slack = ROUNDED * float(np.subtract(upper, lower).max()) ** 2
    return max(0.0, inner * (1.0 - SNAPPED) - slack), outer * (1.0 + SNAPPED) + slack


def _volume(shape: ExactShape) -> tuple[float, float]:
    """Bounds of the volume of a shape in space: by its inner and its outer cells."""
    lower, upper = np.array(shape.bounds)
    spacing = float(np.cbrt(np.prod(np.maximum(upper - lower, 1e-3 * (upper - lower).max())) / MEASURED))
    counts = np.ceil((upper - lower) / spacing) + 1.0
    outer, inner = shape.cells(Grid(0.5 * (lower + upper - spacing * counts), spacing, counts.astype(np.int64)))
    return float(np.count_nonzero(inner)) * spacing**3, float(np.count_nonzero(outer)) * spacing**3


def shape_to_balls(lattice: Lattice, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the shape is from the union of balls, metres.

    From below by points at which it is taken, from above by boxes that hold all points: those that may hold the
    farthest one are halved until the bounds are close.
    """
    region, half, dim = lattice.region, 0.5 * lattice.side, lattice.region.dim
    slack = ROUNDED * (region.size + float(np.abs(region.bounds).max()))
    low = float(gaps(region.inner.pieces.reshape(-1, dim), 0.0, centers, radii)[0].max())
    middles, high = lattice.metres(lattice.middles), 0.0
    halves = 0.5 * np.array(list(product((-1.0, 1.0), repeat=dim)))
    for level in range(LEVELS + 1):
        near, far = gaps(middles, half, centers, radii)
        deeper = near > low
        low = max(low, float(near[deeper][region.depths(middles[deeper]) > 0.0].max(initial=0.0)))
        left = far > low + max(CLOSE * low, SMALL * region.size)
        if level == LEVELS or np.count_nonzero(left) * len(halves) > BOXES:
            left[:], high = False, max(high, float(far[left].max(initial=0.0)))
        high = max(high, float(far[~left].max(initial=0.0)))
        middles, half = (middles[left, None] + half * halves).reshape(-1, dim), 0.5 * half
        middles = middles[region.gaps(middles) <= half * math.sqrt(dim) * (1.0 + 1e-9) + slack]
        if not len(middles):
            break
    return max(low - slack, 0.0), max(high, low) + slack


def balls_to_shape(region: Region, centers: Floats, radii: Floats) -> tuple[float, float]:
    """Bounds of how far a point of the union of balls is from the shape, metres.

    A ball reaches farther than its depth in the shape by no more than the difference of the two lengths.
    """
    high = max(0.0, float((radii - region.depths(centers)).max()))
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, region.dim))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    low = 0.0
    for part in np.array_split(np.arange(len(radii)), math.ceil(len(radii) * len(directions) / BOXES)):
        points = centers[part, None] + radii[part, None, None] * (1.0 - ROUNDED) * directions
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

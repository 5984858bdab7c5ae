"""Region: a shape to be decomposed, asked for its signed distance and its cells; and the lattice of such cells."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.memory import check_memory
from cspace.raster.triangles import point_segment, point_triangle
from cspace.shapes import Mesh, Polygons, Shape
from cspace.threads import in_chunks

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING: Final = 2.0**-44
"""Rounding of a distance, in the largest coordinate: some hundred units, of which few are used up."""

TILTED: Final = 2.0**-36
"""What the rounding of normals adds to it, in the size of the shape, of triangles that are not thin."""

THIN: Final = 2.0**-12 * (1.0 + 2.0**-20)
"""Height of a triangle, in its longest side, up to which a distance may be that much too small."""

MOST: Final = 2**24
"""Cells of the box round a shape, at most."""

BYTES: Final = 64
"""Memory for each of them, at most."""

DEPTH: Final = 64
"""Most boxes of a tree that wait at a time: twice the depth of one over 2^30 pieces."""

_LEAF: Final = 6
_POINTS_A_THREAD: Final = 4_000


FINEST: Final = {2: 12.0, 3: 6.0}
"""Cells of the lattice that a tolerance is long, at most."""

COARSEST: Final = 2.6
"""Cells of the lattice that a tolerance is long, at least: a cell's diagonal must be well below it."""

_USUAL: Final = {2: 150_000, 3: 120_000}
"""Cells of the box round a shape up to which a tolerance may be as many cells as :data:`FINEST` long."""

_MEASURED: Final = 2**21
"""Cells of the box of a mesh by which its volume is bounded where bodies may overlap."""

_FEW: Final = 2**20
"""Cells of the box up to which a shape that fills little of it gets a finer lattice."""

_BOX: Final = {2: 40_000, 3: 80_000}
_USED: Final = {2: 15_000, 3: 20_000}
_A_BALL: Final = {2: 100, 3: 60}


class Region:
    """A closed set, asked for its signed distance; a plane lies in space as x = 0.

    Attributes
    ----------
    shape : Shape
    pieces : ndarray, shape (n, 2, 2) or (n, 3, 3)
        Segments or triangles that hold the border, and maybe more.
    bounds : ndarray, shape (2, d)
        Corners of the bounding box, metres.
    slack : float
        By how much a distance may be wrong, metres.
    """

    def __init__(self, shape: Shape) -> None:
        # Of polygons that overlap, the border is that of their union.
        pieces, radii = (Polygons([shape.outline]) if isinstance(shape, Polygons) else shape).boundary()
        if radii.any():
            raise InputError("shape", "is made of balls already", "a decomposition finds such", "use them as they are")
        self.shape, self.dim = shape, shape.dim
        self.pieces = pieces
        self.bounds = np.array(shape.bounds)
        corners = pieces.reshape(-1, self.dim)
        self.slack = ROUNDING * float(np.abs(corners).max())
        if self.dim == 3:
            self.slack += TILTED * float(np.linalg.norm(np.ptp(corners, axis=0)))

    @property
    def corners(self) -> Floats:
        """Corners of the pieces, shape (m, d)."""
        return np.unique(self.pieces.reshape(-1, self.dim), axis=0)

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @cached_property
    def measure(self) -> tuple[float, float]:
        """Bounds of the area or volume, which differ where bodies of a mesh may overlap."""
        if not self.shape.encloses:
            return 0.0, 0.0
        closed = [body for body in getattr(self.shape, "bodies", ()) if body.closed]
        if not closed or (len(closed) == 1 and (np.abs(closed[0].turns) == 1).all()):
            return abs(self.shape.measure), abs(self.shape.measure)
        side = float(np.cbrt(np.prod(self.bounds[1] - self.bounds[0]) / _MEASURED))
        outer, inner = self.shape.cells(self.grid_at(side))
        return float(np.count_nonzero(inner)) * side**3, float(np.count_nonzero(outer)) * side**3

    def grid_at(self, spacing: float) -> Grid:
        """A grid that covers the set, with cells of about this side (metres), and no larger."""
        counts = np.ceil((self.bounds[1] - self.bounds[0]) / spacing) + 1.0
        return Grid(self.bounds.mean(axis=0) - 0.5 * spacing * counts, spacing, counts.astype(np.int64))

    def depths(self, points: Floats) -> Floats:
        """A lower bound of the signed distance from the border, above zero inside, shape (n,), metres."""
        near, far = self._distances(points)
        return np.where(self.shape.contains(points), near, -far) - self.slack

    def gaps(self, points: Floats) -> Floats:
        """A lower bound of the distance from points (n, d) to the set, shape (n,), metres."""
        near = self._distances(points)[0] - self.slack
        return np.where(self.shape.contains(points), 0.0, np.maximum(near, 0.0))

    def may_meet(self, middles: Floats, reach: float) -> Bools:
        """Whether balls of one radius (metres) may meet the set; surely where not so."""
        return np.asarray((self._distances(middles)[0] <= reach + self.slack) | self.shape.contains(middles))

    def _distances(self, points: Floats) -> tuple[Floats, Floats]:
        """Bounds of the distances from points (n, d), metres, wrong by :attr:`slack` at most."""
        spatial = np.ascontiguousarray(np.pad(points, ((0, 0), (3 - self.dim, 0))))
        near, far = np.empty(len(points)), np.empty(len(points))

        def work(start: int, stop: int) -> int:
            part = slice(start, stop)
            distances(self.tree, spatial[part], near[part], far[part])
            return -1

        in_chunks(work, len(points), _POINTS_A_THREAD)
        return near, far

    @cached_property
    def tree(self) -> Tree:
        """The tree by which distances are found."""
        pieces = np.zeros((len(self.pieces), 3, 3))
        corners = self.pieces.shape[1]
        pieces[:, :corners, 3 - self.dim :] = self.pieces
        pieces[:, corners:] = pieces[:, corners - 1 : corners]
        edges = np.roll(pieces, -1, axis=1) - pieces
        longest = np.sqrt((edges**2).sum(axis=2)).max(axis=1)
        areas = np.sqrt((np.cross(edges[:, 0], edges[:, 1]) ** 2).sum(axis=1))
        doubts = np.where((areas <= THIN * longest**2) & (self.dim == 3), THIN * longest, 0.0)
        low, high = pieces.min(axis=1) - doubts[:, None], pieces.max(axis=1) + doubts[:, None]
        middles = pieces.mean(axis=1)
        order = np.arange(len(pieces))
        # Boxes, level by level, each halved along the longest side of the box round the middles.
        starts, stops, children = [0], [len(pieces)], [0]
        box = 0
        while box < len(starts):
            start, stop = starts[box], stops[box]
            if stop - start > _LEAF:
                some = order[start:stop]
                around, half = middles[some], (stop - start) // 2
                axis = int(np.argmax(np.ptp(around, axis=0)))
                order[start:stop] = some[np.argpartition(around[:, axis], half)]
                children[box] = len(starts)
                starts += [start, start + half]
                stops += [start + half, stop]
                children += [0, 0]
            box += 1
        spans = [order[start:stop] for start, stop in zip(starts, stops, strict=True)]
        return Tree(
            np.ascontiguousarray(pieces[order]),
            doubts[order],
            np.array([low[some].min(axis=0) for some in spans]),
            np.array([high[some].max(axis=0) for some in spans]),
            np.array([children, starts, stops]).T.copy(),
            self.dim == 3,
        )


def region_of(shape: Any) -> Region:
    """The region of anything that describes a shape; as :func:`cspace.spectral.decompose` tells."""
    import shapely

    from cspace.io.vector import SUFFIXES, read_shapes

    if isinstance(shape, Shape):
        return Region(shape)
    several = isinstance(shape, list | tuple) or (isinstance(shape, np.ndarray) and shape.ndim > 0)
    if getattr(shape, "dtype", None) == np.bool_:
        mend = "pass cspace.shapes.Voxels.of(cells, spacing), in metres"
        raise InputError("shape", "is an array of cells", "it must be told how large they are", mend)
    first = shape[0] if several and len(shape) else shape
    if isinstance(shape, str | os.PathLike):
        flat = Path(shape).suffix.lower() in (*SUFFIXES, "")
    else:
        flat = isinstance(first, shapely.Geometry | Mapping) or (several and not len(shape))
    if flat:
        return Region(Polygons(read_shapes(shape)))
    return Region(Polygons.of(shape) if several and np.shape(first) == (2,) else Mesh.of(shape))


class Lattice:
    """Cells of a grid, of about a spacing and no larger, whose union is proven to cover a region.

    Two axes are held as three, of which the first is one cell long. Lengths in *sides* are in sides of a cell, from the
    grid's lower corner; along an axis that is added, all is at 0.5.

    Attributes
    ----------
    cells : ndarray of bool, three axes
    middles, depths : ndarray, shape (n, 3) and (n,)
        Of the cells, in sides: their middles, and lower bounds of the signed distances of these.
    half : ndarray, shape (3,)
        Half a cell along each axis that there is.

    Raises
    ------
    InputError
        If it has too many cells, or needs more memory than there is.
    """

    def __init__(self, region: Region, spacing: float) -> None:
        self.region, self._grid = region, _grid_of(region, spacing)
        self.side = self._grid.spacing
        cells = region.shape.cells(self._grid)[0]
        self.cells = cells[None] if region.dim == 2 else cells
        self.middles: Floats = np.argwhere(self.cells).astype(np.float64) + 0.5
        self.depths = region.depths(self.metres(self.middles)) / self.side
        self.half = np.array([0.0, 0.5, 0.5] if region.dim == 2 else [0.5, 0.5, 0.5])

    @classmethod
    def within(cls, region: Region, tolerance: float) -> Lattice:
        """A lattice on which a tolerance, metres, can be proven."""
        volume = box_volume(region)
        usual = float((volume / _USUAL[region.dim]) ** (1.0 / region.dim))
        least = COARSEST * float((volume / MOST) ** (1.0 / region.dim))
        if tolerance < least:
            found, rule = f"is {tolerance:g} m, and the shape {region.size:g} m across", "to prove it takes many cells"
            raise InputError("tolerance", found, rule, f"pass at least about {1.2 * least:.2g} m")
        return cls(region, min(max(usual, tolerance / FINEST[region.dim]), tolerance / COARSEST))

    @classmethod
    def fine(cls, region: Region, number: int, finer: int = 1) -> Lattice:
        """A lattice on which so many balls can be told apart, or one with more cells by a factor."""
        dim = region.dim
        volume = box_volume(region)
        box = min(finer * max(_BOX[dim], number * _A_BALL[dim]), MOST)
        while True:
            spacing = float((volume / box) ** (1.0 / dim))
            used = int(np.count_nonzero(region.shape.cells(_grid_of(region, spacing))[0]))
            enough = finer * max(_USED[dim], number * _A_BALL[dim] // 2)
            if used >= enough or 2 * box > _FEW:
                return cls(region, spacing)
            # A thin shape fills little of its box.
            box = min(_FEW, int(box * min(max(2.0, (enough / max(used, 1)) ** (dim / (dim - 1.0))), 16.0)))

    def metres(self, points: Floats) -> Floats:
        """Points in sides, (n, 3), as points (n, d) in metres."""
        return np.asarray(np.asarray(self._grid.lower) + self.side * points[:, 3 - self.region.dim :])

    @property
    def corner(self) -> Floats:
        """Where the point 0 in sides lies in the space of the region's tree, metres."""
        return np.array([*[-0.5 * self.side] * (3 - self.region.dim), *self._grid.lower])

    @property
    def diagonal(self) -> float:
        """Of a cell, in sides."""
        return math.sqrt(self.region.dim)


def box_volume(region: Region) -> float:
    """Of the bounding box, whose sides are taken to be at least a thousandth of its diagonal long."""
    return float(np.prod(np.maximum(region.bounds[1] - region.bounds[0], 1e-3 * region.size)))


def _grid_of(region: Region, spacing: float) -> Grid:
    counts = np.ceil((region.bounds[1] - region.bounds[0]) / spacing) + 1.0
    mend = "use a larger tolerance or fewer balls"
    if float(np.prod(counts)) > 1.5 * MOST:
        found = f"or number needs a lattice of {' x '.join(f'{n:.4g}' for n in counts)} cells of {spacing:g} m"
        raise InputError("tolerance", found, f"at most {MOST} are looked at", mend)
    check_memory(BYTES * float(np.prod(counts)), "the lattice of the balls", counts.tolist(), spacing, mend=mend)
    return region.grid_at(spacing)


# ---- distances -------------------------------------------------------------------------------------------------------


class Tree(NamedTuple):
    """Pieces of a border in space, and boxes round them; compiled functions take it as it is.

    ``pieces`` (n, 3, 3) are triangles or, unless ``solid``, segments between their first two corners, and ``doubts`` by
    how much a distance to each may be too small. Each box has in ``spans`` the first of its two children, which follow
    each other, or 0; its first piece, and the one after its last.
    """

    pieces: Floats
    doubts: Floats
    lower: Floats
    upper: Floats
    spans: Ints
    solid: bool


@jit
def _to_box(point: Floats, lower: Floats, upper: Floats) -> float:
    """Distance from a point to a box."""
    square = 0.0
    for axis in range(3):
        square += max(0.0, lower[axis] - point[axis], point[axis] - upper[axis]) ** 2
    return math.sqrt(square)


@jit
def distance(tree: Tree, point: Floats, most: float) -> tuple[float, float]:
    """Bounds of the distance from a point to the nearest piece, if they are below ``most``, and else ``most``."""
    near, far = most, most
    waiting, gaps = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    waiting[0], gaps[0] = 0, _to_box(point, tree.lower[0], tree.upper[0])
    count = 1
    while count > 0:
        count -= 1
        # A box holds all that its pieces may be by doubt; none in it is nearer than the box.
        if gaps[count] >= far:
            continue
        child, start, stop = tree.spans[waiting[count]]
        if child == 0:
            for n in range(start, stop):
                piece = tree.pieces[n]
                if tree.solid:
                    gap = point_triangle(point[0], point[1], point[2], piece)
                else:
                    gap = math.sqrt(point_segment(point[0], point[1], point[2], piece[0], piece[1]))
                near, far = min(near, gap), min(far, gap + tree.doubts[n])
            continue
        one = _to_box(point, tree.lower[child], tree.upper[child])
        other = _to_box(point, tree.lower[child + 1], tree.upper[child + 1])
        # The nearer box comes last, and so is looked at first.
        first, last = (child, child + 1) if one > other else (child + 1, child)
        waiting[count], gaps[count] = first, max(one, other)
        waiting[count + 1], gaps[count + 1] = last, min(one, other)
        count += 2
    return near, far


@jit
def distances(tree: Tree, points: Floats, near: Floats, far: Floats) -> None:
    """Bounds of distances from points, shape (n, 3); quickest where neighbours follow one another."""
    for n in range(len(points)):
        most = math.inf
        if n > 0:  # no farther than from the point before, and the way from there
            way = math.sqrt(((points[n] - points[n - 1]) ** 2).sum())
            most = (far[n - 1] + way) * 1.000001 + 1e-300
        near[n], far[n] = distance(tree, points[n], most)

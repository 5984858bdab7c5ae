"""Margins by which a robot may grow, or must shrink, for a path.

A robot A grown by m contains every point within m of A; A shrunk by m contains the points whose
ball of radius m lies in A. Let h be the spacing and d the dimension; a cell reaches
``h * sqrt(d) / 2`` from its center; distances are in the translation, at one rotation.

* Growing, with a path: if all configurations within m of q are FREE, the grown robot is free at q.
  So it has a path along cells whose centers are farther than m + h sqrt(d) / 2 from cells that are
  not FREE.
* Growing, without a path: if a configuration within m of q is BLOCKED, the grown robot collides at
  q. So it has no path if each chain has a cell whose center is within m - h sqrt(d) / 2 of BLOCKED
  cells.
* Shrinking, with a path: an offset o of the outer raster is needed only if all offsets within m / h
  of o are in the raster. Otherwise a box ``h * (o' + [-1, 1]^d)`` without a point of A is a copy of
  the box of o, moved by at most m, so that no point in the box of o has its ball in A.
* Shrinking, without a path: an offset of the inner raster deeper than m below the surface of A, at
  all rotations of the slice, lies in the shrunk robot.

The robot of FREE states is grown by the map's margin, the robot of BLOCKED states is not.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy import ndimage

from cspace.engines import ENGINES, choose_engine
from cspace.engines.slices import slice_rasters
from cspace.queries.components import Components
from cspace.queries.distance import Distances, compute_distances
from cspace.queries.search import turn_costs
from cspace.queries.widest import LEVELS_PER_CELL, MAX_LEVEL, WidthMap
from cspace.raster import Raster
from cspace.record.exterior import Exterior
from cspace.rotations import RotationCell
from cspace.shapes.shape import ExactShape
from cspace.support.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, States

if TYPE_CHECKING:
    from cspace.space import CSpace

LEVEL: Final = 1.0 / LEVELS_PER_CELL
"""Step of the widths of a search by width, in cells."""

MAX_WIDTH: Final = MAX_LEVEL / LEVELS_PER_CELL
"""Largest width of a search by width, in cells."""

DEPTH_SLACK: Final = 1e-9
"""Rounding of a depth below a surface, per metre of the shape's largest number."""

MAX_PAIRS: Final = 2**25
"""Points times pieces of a surface up to which depths are computed: some seconds."""

STEPS_PER_CELL: Final = 2
"""Depths per cell that are tried for a robot that must shrink."""


class Way(NamedTuple):
    """The widest chain of cells between two cells, or the one that is least blocked.

    Attributes
    ----------
    cells : ndarray of int64, shape (n, 1 + d)
        Cells ``(rotation, x, ...)`` from start to goal, joined by moves of up to two cells.
    passed : ndarray of int64, shape (m, 1 + d)
        Cells that the moves pass, which are joined by their sides.
    low : float
        Margin for which a path is proven, metres; minus infinity if nothing is left of the robot.
    narrowest : int
        Index of its narrowest cell, or of the one farthest from FREE cells.
    """

    cells: Ints
    passed: Ints
    low: float
    narrowest: int


def states_of_slices(space: CSpace) -> States:
    """Return the states of a map, shape (slices, x, y) or (slices, x, y, z)."""
    states = space.kernel_map.states
    return states.reshape(len(states), *space.grid.shape)


def find_free_way(space: CSpace, ends: Ints) -> Way:
    """Find the widest chain of FREE cells between two cells that FREE cells join.

    ``ends``, shape (2, 1 + d), are the cells of start and goal.
    """
    width_map = _make_width_map(space, space.distances.array())
    cells, width = _find_widest_chain(width_map, ends)
    cells_wide = max(width - cell_reach(space.dim) - LEVEL, 0.0)
    low = space.margin + cells_wide * space.grid.spacing
    return Way(cells, cells, low, _find_narrowest(width_map, cells))


def find_shrunk_way(space: CSpace, ends: Ints) -> Way:
    """Find the chain that keeps nearest to FREE cells, for the robot that must shrink least.

    ``ends``, shape (2, 1 + d), are the cells of start and goal, which FREE cells do not join.
    """
    pairs = slice_rasters(space.robot, space.grid.spacing, space.margin, space.rotations)
    rasters = [outer for outer, _ in pairs]
    failed = 0
    largest = max(max(raster.cells.shape) for raster in rasters)
    enough = STEPS_PER_CELL * (largest + 1)  # nothing is left of the robot
    passable = np.ones((len(rasters), *space.grid.shape), dtype=np.bool_)
    vanishes = True
    while enough - failed > 1:
        middle = (failed + enough) // 2
        shrunk = [_shrink_outer(raster, middle / STEPS_PER_CELL) for raster in rasters]
        is_free = ~_collide(space, space.workspace.outer, shrunk)
        if _are_joined(space, is_free, ends):
            enough = middle
            passable = is_free
            vanishes = not any(raster.count for raster in shrunk)
        else:
            failed = middle
    widths = np.float32(MAX_WIDTH) - distances_to(states_of_slices(space) == FREE)
    widths = np.where(passable, np.maximum(widths, np.float32(LEVEL)), np.float32(0.0))
    width_map = _make_width_map(space, widths)
    cells, width = _find_widest_chain(width_map, ends)
    passed = _list_passed(width_map, cells, width)
    low = -math.inf if vanishes else space.margin - enough / STEPS_PER_CELL * space.grid.spacing
    return Way(cells, passed, low, _find_narrowest(width_map, cells))


def _make_width_map(space: CSpace, widths: Distances) -> WidthMap:
    """Return widths of the cells of all slices for a search."""
    turns = turn_costs(space.rotations, space.dim, space.grid.spacing)
    return WidthMap(widths, space.slice_of, space.rotations, turns)


def _find_widest_chain(width_map: WidthMap, ends: Ints) -> tuple[Ints, float]:
    """Return a shortest one of the widest chains between two cells, and its width in cells."""
    width = width_map.bottleneck(ends[0], ends[1], math.inf)
    return width_map.shortest(ends[0], ends[1], width, math.inf), width


def _list_passed(width_map: WidthMap, cells: Ints, width: float) -> Ints:
    """List the cells at least as wide as ``width`` in the boxes around the moves of a chain."""
    passed = {tuple(cell) for cell in cells.tolist()}
    for first, second in itertools.pairwise(cells):
        low = np.minimum(first, second)
        high = np.maximum(first, second)
        if first[0] != second[0]:
            continue  # it turns on the spot
        ranges = [range(start, stop + 1) for start, stop in zip(low, high, strict=True)]
        passed.update(cell for cell in itertools.product(*ranges) if width_map.width(cell) >= width)
    return np.array(sorted(passed))


def _find_narrowest(width_map: WidthMap, cells: Ints) -> int:
    """Return the index of the narrowest of some cells."""
    return int(np.argmin([width_map.width(cell) for cell in cells]))


def _shrink_outer(raster: Raster, radius: float) -> Raster:
    """Return the offsets of a raster that have all offsets within ``radius`` cells in it."""
    reach = math.floor(radius)
    axes = np.ogrid[(slice(-reach, reach + 1),) * raster.cells.ndim]
    ball = sum(axis * axis for axis in axes) <= radius * radius
    return Raster.from_bitmap(ndimage.binary_erosion(raster.cells, ball), raster.lower)


def _collide(space: CSpace, occupied: Bools, rasters: Sequence[Raster]) -> Bools:
    """Return the cells of each slice at which a raster meets occupied cells."""
    hits = np.zeros((len(rasters), *space.grid.shape), dtype=np.bool_)
    engine = ENGINES[choose_engine(rasters)]
    engine.collide(occupied, rasters, list(hits), outside=space.outside == "blocked")
    return hits


def _are_joined(space: CSpace, is_free: Bools, ends: Ints) -> bool:
    """Return True if free cells of the grid join two cells."""
    never_open = np.zeros(len(is_free), dtype=np.bool_)
    states = (~is_free).view(np.uint8)  # True is MIXED
    components = Components(states, space.slice_of, space.rotations.neighbors, never_open)
    start, goal = components.of(ends)
    return bool(start != -1 and start == goal)


def bound_growth(space: CSpace, ends: Ints) -> float:
    """Return a margin, metres, by which the robot cannot grow and still have a path.

    It is infinite if a path may lead around outside the grid.
    """
    states = states_of_slices(space)
    is_open = ~Exterior(space.kernel_map.exterior).is_all_blocked(space.grid.shape)
    # A layer of cells around the grid stands for all space outside.
    around = [(0, 0)] + [(1, 1)] * space.dim
    is_blocked = np.pad(states == BLOCKED, around, constant_values=True)
    for number in np.flatnonzero(is_open):
        _fill_border(is_blocked[number], False)
    widths = distances_to(is_blocked)
    for number in np.flatnonzero(is_open):
        _fill_border(widths[number], MAX_WIDTH)
    start, goal = ends + np.array([0] + [1] * space.dim)
    width = _make_width_map(space, widths).bottleneck(start, goal, math.inf)
    if width + LEVEL >= MAX_WIDTH:
        return math.inf
    return (width + LEVEL + cell_reach(space.dim)) * space.grid.spacing


def bound_shrinkage(space: CSpace, ends: Ints, low: float) -> float:
    """Return a margin, metres, by which the robot may shrink and still has no path.

    The margin is zero or negative, and above ``low``, at which a path is proven. Start and goal are
    proven disconnected for the robot as it is. The result is 0 for robots whose surface has too
    many pieces.
    """
    shrunk = ShrunkRobot.of(space)
    if shrunk is None:
        return 0.0
    step = space.grid.spacing / STEPS_PER_CELL
    deepest = max((float(depths.max(initial=0.0)) for depths in shrunk.depths), default=0.0)
    proven = 0
    failed = math.floor(min(-low, deepest) / step) + 1
    while failed - proven > 1:
        middle = (proven + failed) // 2
        if shrunk.is_disconnected(ends, middle * step):
            proven = middle
        else:
            failed = middle
    return -proven * step


class ShrunkRobot(NamedTuple):
    """Inner rasters of a robot, with the depth of each offset.

    Attributes
    ----------
    space : CSpace
    rasters : list of (outer, inner) Raster
        Rasters of each slice.
    depths : list of ndarray of float64
        Lower bound of the depth of each offset of an inner raster below the robot's surface, at all
        rotations of the slice; metres, in the shape of the raster's cells.
    """

    space: CSpace
    rasters: Sequence[tuple[Raster, Raster]]
    depths: Sequence[Floats]

    @classmethod
    def of(cls, space: CSpace) -> ShrunkRobot | None:
        """Measure the depths of a map's inner rasters; None if they are too many."""
        shape = space.robot.shape.inner
        rotations = space.rotations
        rasters = slice_rasters(space.robot, space.grid.spacing, 0.0, rotations)
        rotation_cells = [RotationCell()]
        if not rotations.preserve(space.robot.shape):
            _, first_cells = np.unique(space.slice_of, return_index=True)
            all_cells = rotations.make_shape_cells(space.dim)
            rotation_cells = [all_cells[number] for number in first_cells]
        n_points = sum(inner.count for _, inner in rasters)
        if n_points * len(shape.boundary().simplices) > MAX_PAIRS:
            return None
        depths = [
            measure_depths(shape, inner, cell, space.grid.spacing)
            for (_, inner), cell in zip(rasters, rotation_cells, strict=True)
        ]
        return cls(space, rasters, depths)

    def is_disconnected(self, ends: Ints, depth: float) -> bool:
        """Return True if the robot, shrunk by ``depth``, is proven to have no path."""
        space = self.space
        inner_rasters = [
            Raster.from_bitmap(inner.cells & (depths >= depth), inner.lower)
            for (_, inner), depths in zip(self.rasters, self.depths, strict=True)
        ]
        hits = _collide(space, space.workspace.inner, inner_rasters)
        states = np.where(hits, np.uint8(BLOCKED), np.uint8(MIXED))
        pairs = [
            (outer, inner) for (outer, _), inner in zip(self.rasters, inner_rasters, strict=True)
        ]
        exterior = Exterior.of(space.workspace.outer, pairs, space.outside)
        is_open = ~exterior.is_all_blocked(space.grid.shape)
        components = Components(states, space.slice_of, space.rotations.neighbors, is_open)
        start, goal = components.of(ends, mixed=True)
        return bool(start == -1 or goal == -1 or start != goal)


def measure_depths(shape: ExactShape, raster: Raster, cell: RotationCell, spacing: float) -> Floats:
    """Bound the depth of each offset of an inner raster below the surface of a shape, metres.

    The bounds hold at all rotations of the cell. They have the shape of the raster's cells, and are
    negative at offsets that the raster lacks.
    """
    points = spacing * (np.argwhere(raster.cells) + np.array(raster.lower))
    in_robot = points if cell.matrix is None else points @ cell.matrix  # by the inverse rotation
    simplices, radii = shape.boundary()
    if radii.any():
        # A union of balls: the depth in one of them.
        gaps = np.linalg.norm(in_robot[:, np.newaxis] - simplices[:, 0], axis=-1)
        depths = (radii - gaps).max(axis=1, initial=-math.inf)
    else:
        depths = np.full(len(points), math.inf)
        for simplex in simplices:
            np.minimum(depths, distance_to_simplex(in_robot, simplex), out=depths)
    depths = depths - cell.displacement(points) - DEPTH_SLACK * (1.0 + shape.span)
    table = np.full(raster.cells.shape, -1.0)
    table[raster.cells] = depths
    return table


def distance_to_simplex(points: Floats, simplex: Floats) -> Floats:
    """Return the distance of points, shape (n, d), to a point, segment or triangle (k, d)."""
    corners = [simplex[0], *simplex]
    gaps = [
        _distance_to_segment(points, corners[k - 1], corners[k]) for k in range(1, len(corners))
    ]
    if len(simplex) < 3:
        return gaps[-1]
    gaps[0] = _distance_to_segment(points, simplex[-1], simplex[0])
    # Points over the inside of a triangle are nearest to its plane.
    first, second, third = simplex
    normal = np.cross(second - first, third - first)
    doubled_area = float(np.linalg.norm(normal))
    if doubled_area > 0.0:
        edges = np.roll(simplex, -1, axis=0) - simplex
        sides = np.cross(edges, points[:, np.newaxis] - simplex) @ normal
        heights = np.abs((points - first) @ normal) / doubled_area
        gaps.append(np.where((sides >= 0.0).all(axis=1), heights, math.inf))
    return np.asarray(np.min(gaps, axis=0))


def _distance_to_segment(points: Floats, first: Floats, last: Floats) -> Floats:
    """Return the distance of points, shape (n, d), to the segment between two points."""
    direction = last - first
    square = float(direction @ direction)
    along = np.zeros(len(points))
    if square > 0.0:
        along = np.clip((points - first) @ direction / square, 0.0, 1.0)
    nearest = first + along[:, np.newaxis] * direction
    return np.asarray(np.linalg.norm(points - nearest, axis=-1))


def distances_to(members: Bools) -> Distances:
    """Return the distance of each cell's center to the nearest closed member cell, in cells.

    ``members`` and the result have shape (slices, x, y) or (slices, x, y, z).
    """
    dim = members.ndim - 1
    nothing_outside = np.array([*[0] * dim, *[-1] * dim, FREE])
    distances = np.empty(members.shape, dtype=np.float32)
    for part, out in zip(members, distances, strict=True):
        compute_distances(part.view(np.uint8), nothing_outside, out)
    return distances


def cell_reach(dim: int) -> float:
    """Return the distance from a cell's center to its corners, in cells."""
    return math.sqrt(dim) / 2.0


def _fill_border(cells: Bools | Distances, value: float) -> None:
    """Set the outermost cells of one slice to a value."""
    for axis in range(cells.ndim):
        along = np.moveaxis(cells, axis, 0)
        along[0] = value
        along[-1] = value

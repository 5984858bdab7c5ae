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
  of o are in the raster too. Otherwise one of them, o', has a box ``h * (o' + [-1, 1]^d)`` without
  a point of A. It is the box of o moved by at most m, so no point in that box has its ball in A.
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
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cspace.engines import ENGINES, choose_engine
from cspace.engines.slices import slice_rasters
from cspace.errors import InputError
from cspace.queries.components import Components
from cspace.queries.distance import Distances, compute_distances
from cspace.queries.search import find_chain, turn_costs
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
    """A way between two cells, for the robot that may grow most, or must shrink least.

    Attributes
    ----------
    cells : ndarray of int64, shape (n, 1 + d)
        Cells ``(rotation, x, ...)`` from start to goal, joined by moves of up to two cells.
    barrier : ndarray of int64, shape (m, 1 + d)
        Cells that are not FREE, and that would join start and goal if they were.
    bottleneck : ndarray of int64, shape (1 + d,)
        The narrowest cell, or the cell of the barrier that is farthest from FREE cells.
    low : float
        Margin for which a path is proven, metres; minus infinity if nothing is left of the robot.
    """

    cells: Ints
    barrier: Ints
    bottleneck: Ints
    low: float


def states_of_slices(space: CSpace) -> States:
    """Return the states of a map, shape (slices, x, y) or (slices, x, y, z)."""
    states = space.kernel_map.states
    return states.reshape(len(states), *space.grid.shape)


def find_free_way(space: CSpace, ends: Ints) -> Way:
    """Find the widest chain of FREE cells between two cells that FREE cells join.

    ``ends``, shape (2, 1 + d), are the cells of start and goal.
    """
    start, goal = ends
    width_map = _make_width_map(space, space.distances.array())
    width = width_map.bottleneck(start, goal, math.inf)
    cells = width_map.shortest(start, goal, width, math.inf)
    narrowest = int(np.argmin([width_map.width(cell) for cell in cells]))
    cells_wide = max(width - cell_reach(space.dim) - LEVEL, 0.0)
    low = space.margin + cells_wide * space.grid.spacing
    return Way(cells, cells[:0], cells[narrowest], low)


def find_shrunk_way(space: CSpace, ends: Ints) -> Way:
    """Find a way for the robot that must shrink least, and the cells that bar it.

    ``ends``, shape (2, 1 + d), are the cells of start and goal, which FREE cells do not join.
    """
    pairs = slice_rasters(space.robot, space.grid.spacing, space.margin, space.rotations)
    # Distance from each offset to the nearest one that the outer raster lacks, in cells.
    depths = [ndimage.distance_transform_edt(np.pad(outer.cells, 1)) for outer, _ in pairs]
    failed = 0
    enough = 1 + math.ceil(STEPS_PER_CELL * max(map(np.max, depths)))  # nothing is left
    is_free = np.ones((len(pairs), *space.grid.shape), dtype=np.bool_)
    while enough - failed > 1:
        middle = (failed + enough) // 2
        shrunk = [
            Raster.from_bitmap(
                depth > middle / STEPS_PER_CELL, tuple(low - 1 for low in outer.lower)
            )
            for depth, (outer, _) in zip(depths, pairs, strict=True)
        ]
        # An unknown outside, as of a window, may be occupied.
        is_hit = _collide(space, space.workspace.outer, shrunk, space.outside != "free")
        candidates = ~is_hit
        if _are_joined(space, candidates, ends):
            enough = middle
            is_free = candidates
        else:
            failed = middle
    turns = space.rotations.neighbors, turn_costs(space.rotations, space.dim, space.grid.spacing)
    states = (~is_free).view(np.uint8)  # False is FREE, and True is MIXED
    start, goal = ends
    slice_of = space.slice_of.copy()  # writeable, as kernels are compiled for
    cells = find_chain(states, slice_of, turns, start, goal, math.inf)
    barrier = find_barrier(space, _list_passed(cells, slice_of, is_free))
    depth = enough / STEPS_PER_CELL
    vanishes = depth >= max(map(np.max, depths))
    low = -math.inf if vanishes else space.margin - depth * space.grid.spacing
    return Way(cells, barrier, _find_deepest(space, barrier), low)


def find_barrier(space: CSpace, passed: Ints) -> Ints:
    """Find the fewest cells that are not FREE on a way from the first to the last of some cells.

    The way leads through the cells ``passed``, shape (n, 1 + d), and through FREE components.
    """
    states = states_of_slices(space)
    never_open = np.zeros(len(states), dtype=np.bool_)
    neighbors = space.rotations.neighbors
    components = Components(states, space.slice_of, neighbors, never_open).of(passed)
    # Nodes are the cells that are not FREE, and after them the components of the others.
    nodes = np.where(components == -1, np.arange(len(passed)), len(passed) + components)
    node_of = dict(zip(map(tuple, passed.tolist()), nodes.tolist(), strict=True))
    links = []
    for cell, node in node_of.items():
        near_nodes = [node_of.get(near, node) for near in _list_neighbors(cell, neighbors)]
        links += [(node, other) for other in near_nodes if other != node]
    first, second = np.array(links, dtype=np.int64).reshape(-1, 2).T
    n_nodes = int(nodes.max()) + 1
    # A cell costs more than all components together.
    costs = np.where(second < len(passed), float(len(passed)), 1.0)
    graph = sparse.coo_array((costs, (first, second)), (n_nodes, n_nodes)).tocsr()
    _, previous = csgraph.dijkstra(graph, indices=nodes[0], return_predecessors=True)
    on_way = [int(nodes[-1])]
    while on_way[-1] != nodes[0]:
        on_way.append(int(previous[on_way[-1]]))
    in_way = np.array([node for node in on_way if node < len(passed)], dtype=np.int64)
    barrier: Ints = passed[np.sort(in_way)]
    return barrier


def _list_neighbors(cell: tuple[int, ...], neighbors: Ints) -> list[tuple[int, ...]]:
    """List the cells that share a side with a cell, and the cell at neighbouring rotations."""
    rotation, *position = cell
    near = [(other, *position) for other in neighbors[rotation].tolist()]
    for axis in range(1, len(cell)):
        near += [(*cell[:axis], cell[axis] + step, *cell[axis + 1 :]) for step in (-1, 1)]
    return near


def _list_passed(cells: Ints, slice_of: Ints, is_free: Bools) -> Ints:
    """List the free cells in the boxes around the moves of a chain, its ends first and last."""
    passed = dict.fromkeys(map(tuple, cells.tolist()))
    for first, second in itertools.pairwise(cells):
        if first[0] != second[0]:
            continue  # it turns on the spot
        low = np.minimum(first, second)
        high = np.maximum(first, second)
        ranges = [range(start, stop + 1) for start, stop in zip(low, high, strict=True)]
        for cell in itertools.product(*ranges):
            if is_free[slice_of[cell[0]], *cell[1:]]:
                passed[cell] = None
    last = tuple(cells[-1].tolist())
    del passed[last]
    return np.array([*passed, last])


def _find_deepest(space: CSpace, barrier: Ints) -> Ints:
    """Return the cell of a barrier that is farthest from FREE cells."""
    slices, positions = np.unique(space.slice_of[barrier[:, 0]], return_inverse=True)
    depths = distances_to(states_of_slices(space)[slices] == FREE)
    deepest = int(np.argmax(depths[positions, *barrier[:, 1:].T]))
    cell: Ints = barrier[deepest]
    return cell


def _make_width_map(space: CSpace, widths: Distances) -> WidthMap:
    """Return widths of the cells of all slices for a search."""
    turns = turn_costs(space.rotations, space.dim, space.grid.spacing)
    return WidthMap(widths, space.slice_of.copy(), space.rotations, turns)  # writeable, as above


def _collide(space: CSpace, occupied: Bools, rasters: Sequence[Raster], outside: bool) -> Bools:
    """Return the cells of each slice at which a raster meets occupied cells.

    All space outside the grid is occupied too if ``outside``.
    """
    hits = np.zeros((len(rasters), *space.grid.shape), dtype=np.bool_)
    engine = ENGINES[choose_engine(rasters)]
    engine.collide(occupied, rasters, list(hits), outside=outside)
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
    many pieces, and for filled meshes.
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
        """Measure the depths of a map's inner rasters; None if they are unknown or too many."""
        shape = space.robot.shape.inner
        rotations = space.rotations
        rasters = slice_rasters(space.robot, space.grid.spacing, 0.0, rotations)
        rotation_cells = [RotationCell()]
        if not rotations.preserve(space.robot.shape):
            _, first_cells = np.unique(space.slice_of, return_index=True)
            all_cells = rotations.make_shape_cells(space.dim)
            rotation_cells = [all_cells[number] for number in first_cells]
        n_points = sum(inner.count for _, inner in rasters)
        try:
            n_pieces = len(shape.boundary().simplices)
        except InputError:  # the inside of a filled mesh depends on the spacing
            return None
        if n_points * n_pieces > MAX_PAIRS:
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
        hits = _collide(space, space.workspace.inner, inner_rasters, space.outside == "blocked")
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

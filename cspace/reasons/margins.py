"""Margins by which a robot may grow, or must shrink, for a path.

A robot A grown by m contains every point within m of A; A shrunk by m contains the points whose
ball of radius m lies in A. The margins are found by bisection: at each margin, the rasters of the
resized robot give a map of FREE cells, which may join start and goal, or one of BLOCKED cells,
which may separate them. Let h be the spacing.

* Outer rasters of the grown robot are those of a build with that margin.
* An outer offset o of the shrunk robot is needed only if a point in its box ``h * (o + [-1, 1]^d)``
  lies m deep in A. The depth of a point is at most that below any plane that bounds A. If A has no
  point in the box of another offset o', it is also at most ``h * |o - o'|``, because the two boxes
  are translates.
* Growing the robot by m is growing the obstacles by m. Large margins grow both.
* An inner offset of the shrunk robot lies deeper than m below the surface of A, at all rotations of
  the slice. An inner offset of the grown robot lies within m of one of A, less the depth of that.

The robot of FREE states is grown by the map's margin, the robot of BLOCKED states is not.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cspace.engines import ENGINES, choose_engine
from cspace.engines.slices import slice_rasters
from cspace.errors import InputError
from cspace.queries.components import Components
from cspace.queries.distance import ROUNDING_FACTOR, Distances, compute_distances
from cspace.queries.search import find_chain, turn_costs
from cspace.raster import Raster
from cspace.record.exterior import Exterior
from cspace.rotations import RotationCell
from cspace.shapes.shape import ExactShape
from cspace.support.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, States

if TYPE_CHECKING:
    from cspace.space import CSpace

DEPTH_SLACK: Final = 1e-9
"""Rounding of a depth below a surface, per metre of the shape's largest number."""

MAX_PAIRS: Final = 2**25
"""Points times pieces of a surface up to which depths are computed: some seconds."""

MAX_GROWTH_CELLS: Final = 16
"""Cells by which rasters grow; larger margins grow the obstacles by the rest."""

STEPS_PER_CELL: Final = 8
"""Margins per cell that are told apart."""

DIRECTIONS_PER_AXIS: Final = {2: 11, 3: 5}
"""Points along each axis of the lattice whose directions bound a robot by planes, by dimension."""


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
    high : float
        Margin for which it is proven that no path exists, metres; infinity if there is none.
    """

    cells: Ints
    barrier: Ints
    bottleneck: Ints
    low: float
    high: float


def states_of_slices(space: CSpace) -> States:
    """Return the states of a map, shape (slices, x, y) or (slices, x, y, z)."""
    states = space.kernel_map.states
    return states.reshape(len(states), *space.grid.shape)


def find_cells(space: CSpace, points: Floats) -> Ints:
    """Return the cells ``(rotation, x, ...)`` of configurations in the grid, shape (n, 1 + d)."""
    positions = space.grid.cell_of(points[:, : space.dim])
    return np.column_stack([space.rotations.find_cells(points), positions])


def find_way(space: CSpace, points: Floats) -> Way:
    """Find the way of the largest robot that is proven to have one, and the cells that bar it.

    ``points``, shape (2, size), are start and goal.
    """
    ends = find_cells(space, points)
    is_connected = bool(space.is_connected(*points))
    robot = ResizedRobot(space)
    low, failed = _find_low(robot, ends, is_connected)
    is_free = robot.find_free(low)
    turns = space.rotations.neighbors, turn_costs(space.rotations, space.dim, space.grid.spacing)
    states = (~is_free).view(np.uint8)  # False is FREE, and True is MIXED
    slice_of = space.slice_of.copy()  # writeable, as kernels are compiled for
    cells = find_chain(states, slice_of, turns, *ends, math.inf)
    barrier = cells[:0]
    if is_connected:
        wider = min(failed, low + robot.step)
        is_narrow = ~robot.find_free(wider)[slice_of[cells[:, 0]], *cells[:, 1:].T]
        narrow = cells[is_narrow] if is_narrow.any() else cells
        bottleneck = narrow[len(narrow) // 2]
    else:
        barrier = find_barrier(space, _list_passed(cells, slice_of, is_free))
        bottleneck = _find_deepest(space, barrier)
    is_apart = not is_connected and bool(space.is_disconnected(*points))
    high = _find_high(robot, ends, low, is_apart)
    # A robot that is nowhere that deep has no point left.
    return Way(cells, barrier, bottleneck, low if -low < robot.depth else -math.inf, high)


def _find_low(robot: ResizedRobot, ends: Ints, is_connected: bool) -> tuple[float, float]:
    """Return a margin at which FREE cells join two, and a slightly larger one at which they do not.

    At the first, nothing may be left of the robot.
    """
    margin = robot.space.margin

    def joins(margin: float) -> bool:
        """Return True if FREE cells of the robot with a margin join start and goal."""
        return _are_joined(robot.space, robot.find_free(margin), ends)

    if is_connected:
        return robot.bisect(joins, *robot.bracket(joins, margin))
    nothing_left = -robot.step - max(float(depths.max()) for depths in robot.outer_depths)
    return robot.bisect(joins, nothing_left, margin)


def _find_high(robot: ResizedRobot, ends: Ints, low: float, is_apart: bool) -> float:
    """Return a margin, metres, at which no path is proven; infinity if there is none."""

    def is_open(margin: float) -> bool:
        """Return True if the robot with a margin is not proven to have no path."""
        return not robot.is_disconnected(ends, margin)

    if is_apart:
        return robot.bisect(is_open, max(low, -robot.depth - robot.step), 0.0)[1]
    return robot.bisect(is_open, *robot.bracket(is_open, max(low, 0.0)))[1]


class Planes(NamedTuple):
    """Planes that bound a shape.

    Attributes
    ----------
    normals : ndarray of float64, shape (n, d)
    heights : ndarray of float64, shape (n,)
        Largest coordinate of the shape along each normal, metres.
    """

    normals: Floats
    heights: Floats

    @classmethod
    def around(cls, shape: ExactShape) -> Planes:
        """Bound a shape along the directions of a lattice."""
        count = DIRECTIONS_PER_AXIS[shape.dim]
        lattice = np.indices((count,) * shape.dim).reshape(shape.dim, -1).T - count // 2
        lattice = lattice[lattice.any(axis=1)]
        normals = lattice / np.linalg.norm(lattice, axis=1, keepdims=True)
        try:
            simplices, radii = shape.boundary()
        except InputError:  # the inside of a filled mesh depends on the spacing
            return cls(normals[:0], np.empty(0))
        heights = [((simplices @ normal).max(axis=1) + radii).max() for normal in normals]
        return cls(normals, np.array(heights) + DEPTH_SLACK * (1.0 + shape.span))


class ResizedRobot:
    """Rasters of a map's robot, grown or shrunk by a margin.

    Parameters
    ----------
    space : CSpace

    Attributes
    ----------
    rasters : list of (outer, inner) Raster
        Rasters of each slice, without a margin.
    step : float
        Difference of margins that are told apart, metres.
    """

    def __init__(self, space: CSpace) -> None:
        """Compute the rasters of the robot as it is."""
        self.space = space
        self.step = space.grid.spacing / STEPS_PER_CELL
        self.rasters = slice_rasters(space.robot, space.grid.spacing, 0.0, space.rotations)
        self._levels = cache(self._measure_levels)

    def bracket(self, holds: Callable[[float], bool], low: float) -> tuple[float, float]:
        """Return two margins such that a condition holds at the first alone.

        It holds at ``low``. The second is infinite if it holds for a robot as large as the map.
        """
        grid = self.space.grid
        growth = 2.0 * grid.spacing
        while low < grid.spacing * max(grid.shape):
            high = low + growth
            if not holds(high):
                return low, high
            low = high
            growth *= 2.0
        return low, math.inf

    def bisect(
        self, holds: Callable[[float], bool], low: float, high: float
    ) -> tuple[float, float]:
        """Return two margins, at most a step apart, such that a condition holds at the first alone.

        It holds at ``low`` and fails at ``high``, unless that is infinite.
        """
        while math.isfinite(high) and high - low > self.step:
            middle = (low + high) / 2.0
            if holds(middle):
                low = middle
            else:
                high = middle
        return low, high

    def find_free(self, margin: float) -> Bools:
        """Return the cells of each slice at which the robot with a margin is free."""
        space = self.space
        own, rest = self._split(margin)
        if margin >= 0.0:
            pairs = slice_rasters(space.robot, space.grid.spacing, own, space.rotations)
            rasters = [outer for outer, _ in pairs]
        else:
            rasters = [
                Raster.from_bitmap(outer.cells & (depths >= -margin), outer.lower)
                for (outer, _), depths in zip(self.rasters, self.outer_depths, strict=True)
            ]
        # An unknown outside, as of a window, may be occupied.
        outside = space.outside != "free"
        occupied = space.workspace.outer
        if rest > 0.0:
            gaps = self._outer_gaps * ROUNDING_FACTOR - math.sqrt(space.dim) / 2.0
            occupied = gaps <= rest
        return ~_collide(space, occupied, rasters, outside)

    def is_disconnected(self, ends: Ints, margin: float) -> bool:
        """Return True if the robot with a margin is proven to have no path between two cells."""
        space = self.space
        own, rest = self._split(margin)
        added = 0
        while added * space.grid.spacing < own:
            added = max(2 * added, 4)  # few sizes, because tables are kept
        inner_rasters = [
            Raster.from_bitmap(levels <= own, tuple(low - added for low in inner.lower))
            for levels, (_, inner) in zip(self._levels(added), self.rasters, strict=True)
        ]
        outside = space.outside == "blocked"
        occupied = space.workspace.inner
        if rest > 0.0:
            gaps = self._inner_gaps / ROUNDING_FACTOR + math.sqrt(space.dim) / 2.0
            occupied = gaps <= rest
        hits = _collide(space, occupied, inner_rasters, outside)
        states = np.where(hits, np.uint8(BLOCKED), np.uint8(MIXED))
        pairs = [(inner, inner) for inner in inner_rasters]
        exterior = Exterior.of(space.workspace.outer, pairs, space.outside)
        is_open = ~exterior.is_all_blocked(space.grid.shape)
        components = Components(states, space.slice_of, space.rotations.neighbors, is_open)
        start, goal = components.of(ends, mixed=True)
        return bool(start == -1 or goal == -1 or start != goal)

    def _split(self, margin: float) -> tuple[float, float]:
        """Split a margin into metres for the robot, and cells for the obstacles."""
        spacing = self.space.grid.spacing
        own = min(margin, MAX_GROWTH_CELLS * spacing)
        return own, (margin - own) / spacing

    @cached_property
    def _outer_gaps(self) -> Distances:
        """Distance of the center of each workspace cell to outer cells, in cells."""
        return _distances_around(self.space.workspace.outer, self.space.outside != "free")

    @cached_property
    def _inner_gaps(self) -> Distances:
        """Distance of the center of each workspace cell to inner cells, in cells."""
        return _distances_around(self.space.workspace.inner, self.space.outside == "blocked")

    @cached_property
    def depth(self) -> float:
        """Depth of the deepest inner offset below the robot's surface, metres: about its inradius.

        Without a surface, it is estimated from the offsets.
        """
        if self._inner_depths is None:
            depths = [
                ndimage.distance_transform_edt(np.pad(inner.cells, 1)) for _, inner in self.rasters
            ]
            return self.space.grid.spacing * max(float(table.max()) - 1.0 for table in depths)
        return max(float(depths.max(initial=0.0)) for depths in self._inner_depths)

    @cached_property
    def _rotation_cells(self) -> list[RotationCell]:
        """Rotations of each slice."""
        space = self.space
        if space.rotations.preserve(space.robot.shape):
            return [RotationCell()]
        _, first_cells = np.unique(space.slice_of, return_index=True)
        all_cells = space.rotations.make_shape_cells(space.dim)
        return [all_cells[number] for number in first_cells]

    @cached_property
    def outer_depths(self) -> list[Floats]:
        """Upper bound of the depth in the box of each outer offset, in each slice."""
        planes = Planes.around(self.space.robot.shape.outer)
        return [
            bound_depths(planes, outer, cell, self.space.grid.spacing)
            for (outer, _), cell in zip(self.rasters, self._rotation_cells, strict=True)
        ]

    @cached_property
    def _inner_depths(self) -> list[Floats] | None:
        """Lower bound of the depth of each inner offset, in each slice.

        None for robots whose surface has too many pieces, and for filled meshes.
        """
        shape = self.space.robot.shape.inner
        n_points = sum(inner.count for _, inner in self.rasters)
        try:
            n_pieces = len(shape.boundary().simplices)
        except InputError:  # the inside of a filled mesh depends on the spacing
            return None
        if n_points * n_pieces > MAX_PAIRS:
            return None
        return [
            measure_depths(shape, inner, cell, self.space.grid.spacing)
            for (_, inner), cell in zip(self.rasters, self._rotation_cells, strict=True)
        ]

    def _measure_levels(self, added: int) -> list[Floats]:
        """Return margins at which offsets are proven to lie in the robot, in each slice.

        Tables have the shapes of the inner rasters with ``added`` offsets on each side.
        """
        spacing = self.space.grid.spacing
        inner_depths = self._inner_depths
        tables = []
        for number, (_, inner) in enumerate(self.rasters):
            depths = np.where(inner.cells, 0.0, -math.inf)
            if inner_depths is not None:
                depths = np.maximum(depths, inner_depths[number])
            cells = np.pad(inner.cells, added)
            depths = np.pad(depths, added)
            if not inner.count:
                tables.append(np.full(cells.shape, math.inf))
                continue
            # The way to the nearest inner offset and on to the surface, or by the deepest one.
            gaps, nearest = ndimage.distance_transform_edt(
                ~cells, sampling=spacing, return_indices=True
            )
            deepest = np.argwhere(cells)[np.argmax(depths[cells])]
            far_gaps = np.linalg.norm(
                np.moveaxis(np.indices(cells.shape), 0, -1) - deepest, axis=-1
            )
            levels = np.minimum(
                gaps - depths[tuple(nearest)], spacing * far_gaps - depths[tuple(deepest)]
            )
            tables.append(levels)
        return tables


def bound_depths(planes: Planes, raster: Raster, cell: RotationCell, spacing: float) -> Floats:
    """Bound the depth of a shape in the boxes of outer offsets from above, metres.

    The bounds hold at all rotations of the cell, and have the shape of the raster's cells.
    """
    # The nearest box without a point of the shape.
    padded: Floats = ndimage.distance_transform_edt(np.pad(raster.cells, 1), sampling=spacing)
    bounds = padded[(slice(1, -1),) * padded.ndim]
    points = spacing * (np.argwhere(raster.cells) + np.array(raster.lower))
    normals = planes.normals
    turned = normals if cell.matrix is None else normals @ cell.matrix.T
    to_corners = spacing * np.abs(turned).sum(axis=1)
    below = (planes.heights + to_corners - points @ turned.T).min(axis=1, initial=math.inf)
    below += cell.displacement(np.abs(points) + spacing)
    bounds[raster.cells] = np.minimum(bounds[raster.cells], below)
    return bounds


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


def _collide(space: CSpace, occupied: Bools, rasters: Sequence[Raster], outside: bool) -> Bools:
    """Return the cells of each slice at which a raster meets occupied cells.

    All space outside the grid is occupied too if ``outside``.
    """
    hits = np.zeros((len(rasters), *space.grid.shape), dtype=np.bool_)
    engine = ENGINES[choose_engine(rasters)]
    engine.collide(occupied, rasters, list(hits), outside=outside)
    return hits


def _distances_around(occupied: Bools, outside: bool) -> Distances:
    """Return the distance of each cell's center to occupied cells, in cells.

    All space outside the grid is occupied too if ``outside``.
    """
    distances = distances_to(np.pad(occupied, 1, constant_values=outside)[np.newaxis])
    return distances[0][(slice(1, -1),) * occupied.ndim]


def _are_joined(space: CSpace, is_free: Bools, ends: Ints) -> bool:
    """Return True if free cells of the grid join two cells."""
    never_open = np.zeros(len(is_free), dtype=np.bool_)
    states = (~is_free).view(np.uint8)  # True is MIXED
    components = Components(states, space.slice_of, space.rotations.neighbors, never_open)
    start, goal = components.of(ends)
    return bool(start != -1 and start == goal)


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

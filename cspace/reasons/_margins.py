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

A robot on a floor grows and shrinks sideways. Then all of this holds in each layer, where planes
are upright, depths are those below the side of the part in the layer, and inner depths unknown.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.errors import ConfigurationError, InputError
from cspace.inside import (
    Bools,
    Bytes,
    ExactShape,
    Exterior,
    Floats,
    Ints,
    Raster,
    States,
    allocating,
    cells_of,
    contents_of,
    find_overlaps,
    map_record,
    rasters_of,
)

Number = TypeVar("Number", bound=np.generic)

DEPTH_SLACK: Final = 1e-9
"""Rounding of a depth below a surface, per metre of the shape's largest number."""

STEPS_PER_CELL: Final = 8
"""Resolution of margins: number of steps per cell."""

DIRECTION_STEPS: Final = {2: range(-5, 6), 3: range(-2, 3)}
"""Coordinates of the integer vectors that are normals of bounding planes, by dimension."""


LAYER_GAP: Final = 2.0**30
"""Distance of layers for a robot on a floor, in cells, so that nothing grows beyond its own."""


class Way(NamedTuple):
    """The widest chain of cells from start to goal.

    It is that of the largest resized robot that has one.

    Attributes
    ----------
    cells : ndarray of int64, shape (n, 1 + d)
        Cells ``(rotation, x, ...)`` from start to goal, each beside the one before.
    barred : ndarray of int64, shape (m,)
        Indices of its cells that are not FREE, and that would join start and goal if they were.
    bottleneck : ndarray of int64, shape (1 + d,)
        The cell at which the way is narrowest.
    low : float
        Largest margin with a proven path, metres; minus infinity if nothing is left
        of a robot shrunk so far.
    high : float
        Smallest margin with proof that no path exists, metres; infinity if none.
    depth : float
        Depth of a point below the robot's surface, about the inradius, metres.
    """

    cells: Ints
    barred: Ints
    bottleneck: Ints
    low: float
    high: float
    depth: float


def states_of_slices(space: CSpace) -> States:
    """Return the states of a map, shape (slices, x, y(, z))."""
    states = map_record(space).states
    return states.reshape(len(states), *space.grid.shape)


def copy_with_ends(space: CSpace, start: ArrayLike, goal: ArrayLike) -> tuple[CSpace, Floats]:
    """Copy a map, with start and goal as rows (2, size).

    Updates of the map do not change the copy. Raises InputError for maps of other kinds,
    ConfigurationError for configurations outside.
    """
    space = cells_of(space)
    if len(space.rotations.names) > 1:
        problem = f"has the axes {', '.join(space.axes)}"
        rule = "reasons are for maps of positions, with or without a yaw"
        raise InputError("space", problem, rule)
    points = [space.check_configuration(q, name) for q, name in ((start, "start"), (goal, "goal"))]
    for q, name in zip(points, ("start", "goal"), strict=True):
        if not space.grid.contains(q[: space.dim]):
            ends = f"from {space.grid.lower} to {space.grid.upper}"
            rule = f"it must be one configuration in the grid, {ends}"
            raise ConfigurationError(name, f"is {q.tolist()}", rule)
    return copy.copy(space), np.stack(points)


def find_cells(space: CSpace, points: Floats) -> Ints:
    """Return cells ``(rotation, x, ...)`` of configurations, (n, 1 + d)."""
    positions = space.grid.cell_of(points[:, : space.dim])
    # Without a yaw, the only rotation cell is 0.
    rotations = np.broadcast_to(space.rotations.cell_of(points[:, space.dim :]), (len(points), 1))
    return np.column_stack([rotations, positions])


def find_way(space: CSpace, points: Floats) -> Way:
    """Find the widest way from start to goal, and its barrier.

    ``points``, shape (2, size), are start and goal.
    """
    robot = ResizedRobot(space)

    def joins(margin: float) -> bool:
        """Return True if start and goal are connected with a margin."""
        return bool(robot.make_free_map(margin).is_connected(*points))

    def is_open(margin: float) -> bool:
        """Return True unless start and goal are proven disconnected with a margin."""
        return not robot.make_blocked_map(margin).is_disconnected(*points)

    # The largest proven margin is at least the map's own if the map connects the points. Otherwise
    # it is below that, but above a margin at which nothing is left of the robot.
    if space.is_connected(*points):
        low, failed = robot.search(joins, space.margin)
    else:
        nothing_left = -robot.step - max(float(depths.max()) for depths in robot.outer_depths)
        low, failed = robot.search(joins, nothing_left, space.margin)
    # BLOCKED states are those of the robot without a margin, so 0 splits the search.
    if space.is_disconnected(*points):
        _, high = robot.search(is_open, max(low, -robot.depth - robot.step), 0.0)
    else:
        _, high = robot.search(is_open, max(low, 0.0))
    # The way passes FREE cells of the resized robot. Few of them are not FREE in the map, and few
    # are closed to a robot one step larger.
    is_open_cell = robot.find_free(low)
    is_barred = states_of_slices(space) != FREE
    is_narrow = ~robot.find_free(min(failed, low + robot.step))
    costs = is_open_cell * (1 + 3 * (is_barred.astype(np.uint8) + is_narrow))
    start, goal = find_cells(space, points)
    cells = find_chain(costs[space.slice_of], space.rotations.neighbors, start, goal)
    in_slices = (space.slice_of[cells[:, 0]], *cells[:, 1:].T)
    barred = np.flatnonzero(is_barred[in_slices])
    # The narrowest cells; all cells, if the larger robot passes everywhere.
    narrow = cells[is_narrow[in_slices]]
    narrow = narrow if len(narrow) else cells
    # A robot shrunk by more than its depth has no point left.
    low = low if low >= 0.0 or -low < robot.depth else -math.inf
    return Way(cells, barred, narrow[len(narrow) // 2], low, high, robot.depth)


def find_chain(costs: Bytes, neighbors: Ints, start: Ints, goal: Ints) -> Ints:
    """Find the cheapest chain of cells, each beside the one before.

    Parameters
    ----------
    costs : ndarray of uint8, shape (rotations, x, y(, z))
        Cost of entering each cell, at most 7, or 0 if no chain enters it.
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    start, goal : ndarray of int64, shape (1 + d,)

    Returns
    -------
    ndarray of int64, shape (n, 1 + d)
        Cells from start to goal; n is 0 if no chain exists.
    """
    # With a border that no chain enters, cells have their neighbours at equal offsets.
    border = np.array([0] + [1] * (costs.ndim - 1))
    costs = np.pad(costs, np.tile(border[:, np.newaxis], 2))
    shape = costs.shape
    strides = np.array(costs.strides)  # as many cells, because each takes one byte
    # A missing neighbour is the cell itself, which was entered already.
    rotations = np.arange(len(costs))[:, np.newaxis]
    turns = strides[0] * np.where(neighbors < 0, 0, neighbors - rotations)
    moves = np.tile([*strides[1:], *-strides[1:]], (len(costs), 1))
    first, last = (np.stack([start, goal]) + border) @ strides
    # The least number of moves from each position to the goal's.
    axes = np.ogrid[tuple(map(slice, shape[1:]))]
    left = sum(abs(axis - at) for axis, at in zip(axes, goal[1:] + 1, strict=True))
    before = np.full(costs.size, -1)
    enter_cells(
        costs.ravel(), np.hstack([moves, turns]), np.ravel(left), int(first), int(last), before
    )
    if before[last] < 0:
        return np.empty((0, len(shape)), dtype=np.int64)
    # Follow the chain back from the goal.
    chain = [last]
    while chain[-1] != first:
        chain.append(before[chain[-1]])
    way: Ints = np.stack(np.unravel_index(chain[::-1], shape), axis=1) - border
    return way


@allocating
def enter_cells(
    costs: Bytes, offsets: Ints, left: Ints, first: int, last: int, before: Ints
) -> None:
    """Write the cell before each cell that is entered, until the last one is.

    Cells are entered by the cost of the chain to them and the number of moves that are left (P.
    Hart, N. Nilsson and B. Raphael, 1968), from circular buckets (R. Dial, "Algorithm 360:
    Shortest-path forest with topological ordering", 1969).
    """
    size = left.shape[0]
    # Entries are lists: one for each bucket, and one of entries that are free.
    capacity = 1024
    cells = np.empty(capacity, np.int64)
    sources = np.empty(capacity, np.int64)
    following = np.arange(1, capacity + 1)
    buckets = np.full(16, -1)  # a step costs up to 7, and may lead one move away
    cells[0] = sources[0] = first
    following[0] = -1
    buckets[0] = 0
    free = 1
    cost = 0
    waiting = 1
    while waiting:
        bucket = cost % len(buckets)
        entry = buckets[bucket]
        if entry < 0:
            cost += 1
            continue
        buckets[bucket] = following[entry]
        following[entry] = free
        free = entry
        waiting -= 1
        cell = cells[entry]
        if before[cell] >= 0:
            continue
        before[cell] = sources[entry]
        if cell == last:
            return
        for offset in offsets[cell // size]:
            beside = cell + offset
            if costs[beside] == 0 or before[beside] >= 0:
                continue
            if free == capacity:
                cells = np.concatenate((cells, np.empty(capacity, np.int64)))
                sources = np.concatenate((sources, np.empty(capacity, np.int64)))
                following = np.concatenate((following, np.arange(1, capacity + 1) + capacity))
                capacity *= 2
            entry = free
            free = following[entry]
            cells[entry] = beside
            sources[entry] = cell
            later = np.int64(costs[beside]) + left[beside % size] - left[cell % size]
            bucket = (cost + later) % len(buckets)
            following[entry] = buckets[bucket]
            buckets[bucket] = entry
            waiting += 1


class Planes(NamedTuple):
    """Half-spaces that contain a shape.

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
        """Bound a shape along all integer vectors with coordinates in DIRECTION_STEPS."""
        steps = DIRECTION_STEPS[shape.dim]
        lattice = np.array(
            [step for step in itertools.product(steps, repeat=shape.dim) if any(step)]
        )
        normals = lattice / np.linalg.norm(lattice, axis=1, keepdims=True)
        try:
            simplices, radii = shape.boundary()
        except InputError:  # a filled mesh has no boundary, as its inside depends on the spacing
            return cls(normals[:0], np.empty(0))
        heights = [((simplices @ normal).max(axis=1) + radii).max() for normal in normals]
        return cls(normals, np.array(heights) + DEPTH_SLACK * (1.0 + shape.span))


class ResizedRobot:
    """The robot of a map, grown or shrunk by a margin, and its maps.

    Parameters
    ----------
    space : CSpace

    Attributes
    ----------
    rasters : list of (outer, inner) Raster
        Rasters of each slice, without a margin.
    step : float
        Resolution of margins, metres.
    """

    def __init__(self, space: CSpace) -> None:
        """Compute the rasters of the robot without a margin."""
        self.space = space
        self.step = space.grid.spacing / STEPS_PER_CELL
        self.rasters = rasters_of(contents_of(space), 0.0)
        self._on_floor = space.floor is not None
        self._sides = space.grid.spacing * measure_sides(space.workspace.grid.dim, space.dim)
        cells = contents_of(space).slice_cells
        self._rotation_cells = [cell.in_plane for cell in cells] if self._on_floor else cells
        self._levels = cache(self._measure_levels)

    def search(
        self, holds: Callable[[float], bool], low: float, high: float = math.inf
    ) -> tuple[float, float]:
        """Bracket the largest margin at which a condition holds, within one step.

        The condition holds at ``low`` and fails at ``high``. Returns a margin at which it holds and
        one at which it fails; the latter is infinite if it holds for a robot as large as the map.
        """
        grid = self.space.grid
        growth = 2.0 * grid.spacing
        while high - low > self.step and low < grid.spacing * max(grid.shape):
            # Double the growth until the condition fails, then bisect.
            middle = low + growth if math.isinf(high) else (low + high) / 2.0
            growth *= 2.0
            if holds(middle):
                low = middle
            else:
                high = middle
        return low, high

    def find_free(self, margin: float) -> Bools:
        """Return a mask of the FREE cells with a margin, by slice."""
        space = self.space
        own, rest = self._split_margin(margin)
        if margin >= 0.0:
            rasters = [outer for outer, _ in rasters_of(contents_of(space), own)]
        else:
            rasters = [
                Raster.from_bitmap(outer.cells & (depths >= -margin), outer.lower)
                for (outer, _), depths in zip(self.rasters, self.outer_depths, strict=True)
            ]
        # Space outside that is unknown, as around a window, may be occupied.
        outside = space.outside != "free"
        occupied = space.workspace.outer
        if rest > 0.0:
            occupied = grow_cells(occupied, rest, outside, space.dim, outwards=True)
        is_free = ~find_overlaps(occupied, rasters, outside=outside, on_floor=self._on_floor)
        if margin <= space.margin:
            # A window also knows what is FREE by the obstacles around it.
            is_free |= states_of_slices(space) == FREE
        return is_free

    def make_free_map(self, margin: float) -> CSpace:
        """Return the robot's map of FREE and MIXED with a margin."""
        states = (~self.find_free(margin)).view(np.uint8)  # False is FREE, and True is MIXED
        return self._make_map(states, Exterior(map_record(self.space).exterior))

    def make_blocked_map(self, margin: float) -> CSpace:
        """Return the robot's map of BLOCKED and MIXED with a margin."""
        space = self.space
        own, rest = self._split_margin(margin)
        # Offsets to add on each side. Few sizes occur, because their tables are cached.
        added = 0
        while added * space.grid.spacing < own:
            added = max(2 * added, 4)
        shift = added * (np.arange(space.workspace.grid.dim) < space.dim)
        rasters = [
            Raster.from_bitmap(levels <= own, tuple((inner.lower - shift).tolist()))
            for levels, (_, inner) in zip(self._levels(added), self.rasters, strict=True)
        ]
        # Joints may go on beyond the mapped part of their ranges.
        outside = space.outside == "blocked" and space.has_poses
        occupied = space.workspace.inner
        if rest > 0.0:
            occupied = grow_cells(occupied, rest, outside, space.dim, outwards=False)
        hits = find_overlaps(occupied, rasters, outside=outside, on_floor=self._on_floor)
        if margin >= 0.0:  # as above
            hits |= states_of_slices(space) == BLOCKED
        states = np.where(hits, np.uint8(BLOCKED), np.uint8(MIXED))
        exterior = Exterior(map_record(space).exterior)
        if space.has_poses:
            pairs = [(raster, raster) for raster in rasters]
            outer = space.workspace.outer
            exterior = Exterior.of(outer, pairs, space.outside, self._on_floor)
        return self._make_map(states, exterior)

    def _make_map(self, states: States, exterior: Exterior) -> CSpace:
        """Return a map with other states, in the grid and outside."""
        contents = replace(contents_of(self.space), states=states, exterior=exterior)
        return CSpace(replace(contents, margin=0.0, overlap_counts=None))

    def _split_margin(self, margin: float) -> tuple[float, float]:
        """Split a margin into metres of robot and cells of obstacles."""
        spacing = self.space.grid.spacing
        # Largest growth of the robot's rasters, in cells; the rest of a margin grows the
        # obstacles.
        own = min(margin, 16 * spacing)
        return own, (margin - own) / spacing

    @cached_property
    def depth(self) -> float:
        """Depth of the deepest inner offset below the robot's surface, metres.

        That is about the inradius. Without a surface, it is half the shortest side of the robot.
        """
        if self._inner_depths is None:
            sides = np.ptp(self.space.robot.shape.inner.bounds, axis=0)[: self.space.dim]
            return float(sides.min()) / 2.0
        return max(float(depths.max(initial=0.0)) for depths in self._inner_depths)

    @cached_property
    def outer_depths(self) -> list[Floats]:
        """Upper bounds of depth in each outer offset's box, by slice."""
        planes = Planes.around(self.space.drawn_robot.shape.outer)
        return [self._bound_depths(planes, number) for number in range(len(self.rasters))]

    @cached_property
    def _inner_depths(self) -> list[Floats] | None:
        """Lower bounds of the depth of each inner offset, by slice.

        None for a robot whose surface has too many pieces, for a filled mesh, and on a floor.
        """
        if self._on_floor:
            return None
        shape = self.space.robot.shape.inner
        n_points = sum(inner.count for _, inner in self.rasters)
        try:
            n_pieces = len(shape.boundary().simplices)
        except InputError:  # a filled mesh has no boundary, as its inside depends on the spacing
            return None
        # Number of pairs of a point and a piece of a surface above which depths are not computed.
        # So many pairs take some seconds.
        if n_points * n_pieces > 2**25:
            return None
        return [self._measure_depths(shape, number) for number in range(len(self.rasters))]

    def _bound_depths(self, planes: Planes, number: int) -> Floats:
        """Return upper bounds of depth at the outer offsets of a slice, metres.

        A bound holds in the whole box around an offset.

        The bounds hold at all rotations of the slice, and have the shape of the raster's cells.
        """
        raster, _ = self.rasters[number]
        cell = self._rotation_cells[number]
        spacing = self.space.grid.spacing
        # The first bound is the distance to the nearest box without a point of the shape.
        cells = np.pad(raster.cells, 1)
        padded: Floats = ndimage.distance_transform_edt(cells, sampling=self._sides)
        bounds = padded[(slice(1, -1),) * padded.ndim]
        # The second is the depth below each plane, at the corner of the box that is deepest.
        points = spacing * (np.argwhere(raster.cells) + np.array(raster.lower))
        points = points[:, : self.space.dim]
        normals = planes.normals
        turned = normals if cell.matrix is None else normals @ cell.matrix.T
        to_corners = spacing * np.abs(turned).sum(axis=1)
        below = (planes.heights + to_corners - points @ turned.T).min(axis=1, initial=math.inf)
        below += cell.displacement(np.abs(points) + spacing)
        bounds[raster.cells] = np.minimum(bounds[raster.cells], below)
        return bounds

    def _measure_depths(self, shape: ExactShape, number: int) -> Floats:
        """Bound the depths of a slice's inner offsets from below, metres.

        The bounds hold at all rotations of the slice. They have the shape of the raster's cells,
        and are -1 at offsets that the raster lacks.
        """
        _, raster = self.rasters[number]
        cell = self._rotation_cells[number]
        points = self.space.grid.spacing * (np.argwhere(raster.cells) + np.array(raster.lower))
        # Points move into the robot's frame by the inverse rotation.
        in_robot = points if cell.matrix is None else points @ cell.matrix
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

    def _measure_levels(self, added: int) -> list[Floats]:
        """Return the margins at which offsets enter the grown robot, by slice.

        Tables have the shapes of the inner rasters with ``added`` offsets on each side.
        """
        dim = self.space.dim
        inner_depths = self._inner_depths
        tables = []
        for number, (_, inner) in enumerate(self.rasters):
            depths = np.where(inner.cells, 0.0, -math.inf)
            if inner_depths is not None:
                depths = np.maximum(depths, inner_depths[number])
            cells = pad_cells(inner.cells, added, dim, value=False)
            depths = pad_cells(depths, added, dim, value=0.0)
            if not inner.count:
                tables.append(np.full(cells.shape, math.inf))
                continue
            # An inner offset, deep below the surface by d, puts all offsets within m + d of it in
            # the robot grown by m. Take the better of two: the nearest and the deepest one.
            gaps, nearest = ndimage.distance_transform_edt(
                ~cells, sampling=self._sides, return_indices=True
            )
            deepest = np.argwhere(cells)[np.argmax(depths[cells])]
            steps = np.moveaxis(np.indices(cells.shape), 0, -1) - deepest
            far_gaps = np.linalg.norm(steps * self._sides, axis=-1)
            levels = np.minimum(gaps - depths[tuple(nearest)], far_gaps - depths[tuple(deepest)])
            tables.append(levels)
        return tables


def measure_sides(axes: int, dim: int) -> Floats:
    """Return the side of a cell along each axis, in cells; only the first ``dim`` axes can grow."""
    return np.where(np.arange(axes) < dim, 1.0, LAYER_GAP)


def pad_cells(values: NDArray[Number], count: int, dim: int, *, value: float) -> NDArray[Number]:
    """Pad an array by a value on both sides of its first ``dim`` axes."""
    widths = [(count, count)] * dim + [(0, 0)] * (values.ndim - dim)
    return np.pad(values, widths, constant_values=value)


def grow_cells(cells: Bools, distance: float, outside: bool, dim: int, *, outwards: bool) -> Bools:
    """Grow occupied cells by a distance, in cells, along the first ``dim`` axes.

    ``outwards``, the result has all cells that meet the grown region; otherwise, only cells that
    lie in it. With ``outside``, all space outside the grid is occupied too.
    """
    near = pad_cells(cells, 1, dim, value=outside)
    sides = measure_sides(cells.ndim, dim)
    # Each point of a cell has one of another cell as far away as their centers are. Their nearest
    # points are as far away as the centers of neighbours of theirs, or touch.
    slack = -1e-9
    if outwards:
        near = ndimage.binary_dilation(near, np.ones(np.where(sides > 1.0, 1, 3)))
        slack = 1e-9
    if not near.any():  # nothing to measure distances from
        return cells.copy()
    gaps = ndimage.distance_transform_edt(~near, sampling=sides)[(slice(1, -1),) * dim]
    return np.asarray(gaps <= distance * (1.0 + slack))


def distance_to_simplex(points: Floats, simplex: Floats) -> Floats:
    """Return points' distances to a point, segment or triangle.

    ``simplex`` has one to three corners, shape (k, d).
    """
    sides = itertools.pairwise([*simplex, simplex[0]])
    gaps = [_distance_to_segment(points, *ends) for ends in sides]
    if len(simplex) == 3:
        # Points over the inside of a triangle are nearest to its plane.
        first, second, third = simplex
        normal = np.cross(second - first, third - first)
        doubled_area = float(np.linalg.norm(normal))
        if doubled_area > 0.0:
            edges = np.roll(simplex, -1, axis=0) - simplex
            heights = np.cross(edges, points[:, np.newaxis] - simplex) @ normal
            over = np.abs((points - first) @ normal) / doubled_area
            gaps.append(np.where((heights >= 0.0).all(axis=1), over, math.inf))
    return np.asarray(np.min(gaps, axis=0))


def _distance_to_segment(points: Floats, first: Floats, last: Floats) -> Floats:
    """Return the distance of points, shape (n, d), to a segment."""
    direction = last - first
    square = float(direction @ direction)
    along = np.zeros(len(points))
    if square > 0.0:
        along = np.clip((points - first) @ direction / square, 0.0, 1.0)
    nearest = first + along[:, np.newaxis] * direction
    return np.asarray(np.linalg.norm(points - nearest, axis=-1))

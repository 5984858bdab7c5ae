"""Paths of maximum bottleneck clearance, then minimum length.

The *width* of a cell is its distance (:mod:`cspace._queries.distance`). The *bottleneck* of two
cells is the largest width at which cells of that width or above connect them, found in 64ths of a
cell. Among these cells, the shortest chain is searched.

If the start or the goal is the narrowest place, for example beside a wall, every path is that
narrow. So the path first climbs steeply from both, and the bottleneck connects the two local
maxima. The result is still among the widest paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace import CSpace, Workspace
from cspace.inside import (
    Bools,
    Bytes,
    Contents,
    DistanceTable,
    Effort,
    Exterior,
    Floats,
    Ints,
    check_memory,
    frozen,
    kernel,
    map_record,
    now,
    spend,
)
from planners._searches.chains import find_cells, find_chain
from planners._searches.estimate import Costs
from planners._searches.frontier import check_deadline
from planners._searches.paths import MAX_SHORTENING, pulled_straight, waypoints

LEVELS_PER_CELL: Final = 64
"""Levels of width per cell."""

MAX_LEVEL: Final = 65535
"""Highest level, which is 1024 cells; larger widths count as this."""

SEARCH_BYTES_PER_CELL: Final = 20
"""Memory of a search by clearance for each cell of each rotation, with the distances, bytes."""

CELLS_PER_FLOOD: Final = 2**12
"""Cells expanded between two checks of the time limit, at most."""

NANOSECONDS_PER_CELL: Final = 1_000
"""Work of expanding a cell by its width."""

N_SIDE_STEPS: Final = 6
"""Number of steps to cells that share a side; steps from this number on rotate."""


@dataclass(frozen=True, slots=True, eq=False)
class WidthMap:
    """Widths of the cells of a map.

    Attributes
    ----------
    space : CSpace
    widths : ndarray of float32, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Width of each cell, in cells.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    """

    space: CSpace
    widths: Costs
    slice_of: Ints

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of rotation cells, and cells along each axis."""
        return (len(self.slice_of), *self.widths.shape[1:])

    def width(self, cell: Sequence[int] | Ints) -> float:
        """Return the width of a cell ``(rotation, x, ...)``, in cells."""
        return float(self.widths[self.slice_of[cell[0]], *cell[1:]])

    def climb(self, cell: Ints) -> Ints:
        """Follow the steepest ascent to a local maximum.

        Return the cells ``(rotation, x, ...)``, from ``cell`` on, shape (n, 1 + d). Ties go to the
        larger cell index.
        """
        neighbors = self.space.rotations.neighbors
        path = [tuple(cell.tolist())]
        while True:
            # The cell itself, neighbouring rotations, and cells that share a side.
            rotation, *position = path[-1]
            rotations = neighbors[rotation].tolist()
            candidates = [path[-1]] + [(other, *position) for other in rotations if other >= 0]
            for axis, step in product(range(len(position)), (-1, 1)):
                near = position.copy()
                near[axis] += step
                if 0 <= near[axis] < self.shape[axis + 1]:
                    candidates.append((rotation, *near))
            best = max(candidates, key=lambda candidate: (self.width(candidate), candidate))
            if best == path[-1]:
                return np.array(path)
            path.append(best)

    def find_bottleneck(self, start: Ints, goal: Ints, until: Effort) -> float:
        """Return the largest minimum width among all chains between two cells.

        ``start`` and ``goal`` are cells, shape (1 + d,). The width is rounded down to a 64th of a
        cell. The result is 0 if no chain exists. Raises TimeoutError after ``until``.
        """
        check_deadline(until)  # a large map takes long to copy
        first = int(np.ravel_multi_index(tuple(start), self.shape))
        last = int(np.ravel_multi_index(tuple(goal), self.shape))
        levels = np.minimum(LEVELS_PER_CELL * self.widths, MAX_LEVEL).astype(np.uint16)
        start_level = int(levels[self.slice_of[start[0]], *start[1:]])
        queue = LevelQueue.of(math.prod(self.shape), first, start_level)
        missing_axes = (1,) * (4 - self.widths.ndim)
        layered = levels.reshape(len(levels), *missing_axes, *self.shape[1:])
        neighbors = self.space.rotations.neighbors
        is_done = False
        while not is_done:
            check_deadline(until)
            is_done = flood(layered, self.slice_of, neighbors, last, queue)
            spend(CELLS_PER_FLOOD * NANOSECONDS_PER_CELL)
        return float(queue.level[0]) / LEVELS_PER_CELL

    def find_short_chain(self, start: Ints, goal: Ints, min_width: float, until: Effort) -> Ints:
        """Find a short chain of at least ``min_width``.

        The chain has shape (n, 1 + d). Raises TimeoutError after ``until``.
        """
        states = threshold_widths(self.widths, min_width)
        return find_chain(self.space, states, self.slice_of, start, goal, until)


def threshold_widths(widths: Costs, min_width: float) -> Bytes:
    """Return states that are FREE for cells wide enough, else MIXED.

    These cells have a width of ``min_width`` or above.
    """
    is_narrow = widths < np.float32(min_width)
    return frozen(is_narrow.view(np.uint8))  # False is FREE, and True is MIXED


# ---- the bottleneck ------------------------------------------------------------------------------


class LevelQueue(NamedTuple):
    """Bucket queue of cells, widest first, with a list per level.

    Attributes
    ----------
    level : ndarray of int64, shape (1,)
        Lowest level of the cells taken from the queue so far.
    first : ndarray of int64, shape (MAX_LEVEL + 1,)
        First queued cell of each level; -1 if there is none.
    following : ndarray of int64, shape (cells,)
        Next cell of the same level, for each queued cell; -1 at the end.
    reached : ndarray of bool, shape (cells,)
        True for cells that are or were queued. Like ``following``, it takes memory only where
        written.
    """

    level: Ints
    first: Ints
    following: Ints
    reached: Bools

    @classmethod
    def of(cls, cells: int, start: int, level: int) -> LevelQueue:
        """Create a queue with one cell."""
        queue = cls(
            level=np.array([level]),
            first=np.full(MAX_LEVEL + 1, -1),
            following=np.empty(cells, dtype=np.int64),
            reached=np.zeros(cells, dtype=np.bool_),
        )
        queue.first[level] = start
        queue.following[start] = -1
        queue.reached[start] = True
        return queue


@kernel
def flood(
    levels: NDArray[np.uint16], slice_of: Ints, neighbors: Ints, goal: int, queue: LevelQueue
) -> bool:
    """Expand cells, widest first; return True if the search has ended.

    It ends at the goal, or without any cell. The level of the queue is then the bottleneck's, or 0
    if no chain leads to the goal. False means that a clock check is due; the next call goes on from
    there. ``levels``, shape (slices, nx, ny, nz), are those of the widths.
    """
    _, nx, ny, nz = levels.shape
    level = queue.level[0]
    for _ in range(CELLS_PER_FLOOD):
        # Take a cell of the highest level that has one.
        while level > 0 and queue.first[level] < 0:
            level -= 1
        queue.level[0] = level
        cell = queue.first[level]
        if level == 0 or cell == goal:
            return True
        queue.first[level] = queue.following[cell]
        # Decode the cell's index over all rotation cells.
        rotation = cell // (nx * ny * nz)
        x = cell // (ny * nz) % nx
        y = cell // nz % ny
        z = cell % nz
        for step in range(N_SIDE_STEPS + neighbors.shape[1]):
            # Steps 0 to 5 go down and up along the three axes; later ones rotate.
            other = rotation
            i, j, k = x, y, z
            axis = step // 2
            sign = 2 * (step % 2) - 1
            if step >= N_SIDE_STEPS:
                other = neighbors[rotation, step - N_SIDE_STEPS]
            elif axis == 0:
                i += sign
            elif axis == 1:
                j += sign
            else:
                k += sign
            if other < 0 or not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
                continue
            near = ((other * nx + i) * ny + j) * nz + k
            if queue.reached[near]:
                continue
            queue.reached[near] = True
            # A cell cannot be wider than the chain that leads to it.
            near_level = min(level, levels[slice_of[other], i, j, k])
            queue.following[near] = queue.first[near_level]
            queue.first[near_level] = near
    return False


# ---- paths ---------------------------------------------------------------------------------------


def find_widest_path(space: CSpace, endpoints: Floats, straight: bool, limit: Effort) -> Floats:
    """Find a path of largest clearance, shape (n, size), then a short one.

    ``endpoints``, shape (2, size), are FREE and canonical. The length n is 0 if no path exists, or
    its edges are not proven. If not ``straight``, waypoints are the centers of the cells passed.
    Raises TimeoutError at the limit.
    """
    widths = WidthMap(space, measure_widths(space), map_record(space).rotations.slice_of)
    until = now() + limit
    path = _find_wide_path(space, widths, endpoints, straight, until)
    return path if len(path) and space.certify_path(path).all() else path[:0]


def measure_widths(space: CSpace) -> Costs:
    """Return the distance of each cell, by slice, for a search.

    Raises InputError if the search does not fit into memory.
    """
    needed = SEARCH_BYTES_PER_CELL * space.grid.size * len(space.rotations)
    check_memory(needed, "the map, to search it by clearance,", space.grid)
    return DistanceTable.of(space).cells.reshape(-1, *space.grid.shape)


def _find_wide_path(
    space: CSpace, widths: WidthMap, endpoints: Floats, straight: bool, until: Effort
) -> Floats:
    """Find a path along a chain of largest minimum width.

    Arguments, result and errors are those of :func:`find_widest_path`, except that the path is not
    proven.
    """
    rotations = space.rotations
    start, goal = find_cells(space, endpoints)
    # Climb from both ends, and connect the two local maxima.
    from_start = widths.climb(start)
    from_goal = widths.climb(goal)
    width = widths.find_bottleneck(from_start[-1], from_goal[-1], until)
    if width == 0.0:
        return endpoints[:0]
    # Cut both climbs where they reach the width of the bottleneck.
    n_ascent = sum(widths.width(cell) < width for cell in from_start)
    n_descent = sum(widths.width(cell) < width for cell in from_goal)
    chain = widths.find_short_chain(from_start[n_ascent], from_goal[n_descent], width, until)
    descent = np.flipud(from_goal[:n_descent])
    cells = np.concatenate([from_start[:n_ascent], chain, descent])
    path = waypoints(space, endpoints, cells)
    if not straight:
        return path
    # Each of the three parts is shortened within cells at least as wide as its own narrowest cell.
    end = len(path) - 1
    first = n_ascent + 1 if n_ascent else 0
    last = n_ascent + len(chain) if n_descent else end
    parts = (
        (0, first, widths.width(start)),
        (first, last, width),
        (last, end, widths.width(goal)),
    )
    pieces = [path[:1]]
    end_time = until + MAX_SHORTENING
    for begin, stop, min_width in parts:
        if begin < stop:
            positions = cells[max(begin - 1, 0) : stop, 1:]
            is_free = _make_wide_checker(widths.widths, space, positions, min_width)
            piece = pulled_straight(path[begin : stop + 1], rotations, is_free, until=end_time)
            pieces.append(piece[1:])
    return np.concatenate(pieces)


def _make_wide_checker(
    widths: Costs, space: CSpace, positions: Ints, min_width: float
) -> Callable[..., bool]:
    """Make ``check(*q0, *q1)``, which is True for motions through cells wide enough.

    They are those around ``positions`` from ``min_width`` on. ``positions``, shape (n, d),
    are indices of cells along the axes.
    """
    # One more cell on each side, because edges may touch it.
    first = np.maximum(positions.min(axis=0) - 1, 0)
    stop = np.minimum(positions.max(axis=0) + 2, widths.shape[1:])
    window = (slice(None), *map(slice, first, stop))
    states = threshold_widths(widths[window], min_width)
    grid = space.grid
    lower = grid.lower + grid.spacing * first
    workspace = Workspace.from_array(np.zeros(states.shape[1:], np.bool_), grid.spacing, lower)
    map_ = map_record(space)
    # Outside the window, the map's states outside its own grid hold.
    exterior = Exterior(map_.exterior)
    slice_of = map_.rotations.slice_of
    contents = Contents(
        workspace, space.robot, space.rotations, slice_of, states, exterior=exterior
    )
    return CSpace(contents).edge_checker()

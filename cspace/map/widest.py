"""Paths of maximum bottleneck clearance, then minimum length.

The *level* of a FREE cell is the distance from its center to the nearest cell that is not FREE, in the grid or outside.
The *bottleneck* of two configurations is the highest level at which FREE cells of that level or above connect them.
Among these cells, the shortest chain is searched. If the robot rotates, the heuristic is the length of the shortest
chain over positions that are as wide at any rotation.

If the start or the goal is the narrowest place, for example beside a wall, every path is that narrow. So the path first
climbs steeply from both, and the bottleneck connects the two local maxima. The result is still among the widest
paths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np

from cspace.arrays import FREE, Bools, Bytes, Floats, Ints
from cspace.compiling import kernel
from cspace.grid import Grid
from cspace.map.callbacks import edge_checker
from cspace.map.clearance import Squares, range_outside
from cspace.map.components import Components
from cspace.map.derived import Lock
from cspace.map.paths import in_time, pulled_straight, unwind, waypoints
from cspace.map.periodic import below_half_a_turn
from cspace.map.search import Graph, Guide, Levels, check_deadline, turn_costs
from cspace.map.storage import Map, Stack, read_only
from cspace.rotations import Rotations
from cspace.rotations.records import always_inline, jit
from cspace.threads import cores, in_chunks, in_threads

Join = Callable[[Bytes], Components]
"""Returns the components of states."""

LEVELS_PER_CELL: Final = 64
"""Levels per cell of clearance."""

MAX_LEVEL: Final = 65535
"""Highest level, which is 1024 cells of clearance; larger clearances count as this."""

INFINITE_SQUARE: Final = 2**30
"""Squared distance, in half cells, that stands for infinity."""

FAR_HALF_CELLS: Final = 2**30
"""End of a range of half cells that stands for infinity."""

WIDEST_BYTES_PER_CELL: Final = 28
"""Memory for each cell, bytes: its level, and the arrays of searches and components (measured: 10 to 25)."""

MIN_LINES_PER_THREAD: Final = 64
"""Lines of cells per thread below which a further thread costs more time than it saves."""

MAX_CACHED_LEVELS: Final = 8
"""Number of levels whose components are cached, at 1.1 bytes per cell of a slice."""

NO_PERIODIC_AXES: Final = np.zeros(3, dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Widest:
    """Levels of a map, and components of wide cells.

    Attributes
    ----------
    levels : ndarray of uint16, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Level of each cell.
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    rotations : Rotations
        Rotation cells.
    turns : ndarray of float64, shape (rotations, n)
        Cost of rotating to each neighbor, in cells.
    periodic_axes : sequence of bool
        True for each periodic axis.
    outside : ndarray of int32, shape (slices, sides, 3, 2)
        Result of :func:`find_outside_ranges`.
    cached : dict of int to Components
        Components of the levels around the last bottlenecks.
    lock : Lock
        Guards ``cached``.
    """

    levels: Levels
    slice_of: Ints
    rotations: Rotations
    turns: Floats
    periodic_axes: Sequence[bool]
    outside: Squares
    dirty_boxes: list[Ints] = field(default_factory=list)
    cached: dict[int, Components] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    @classmethod
    def of(cls, map_: Map, states: Iterable[Bytes], rotations: Rotations, periodic_axes: Sequence[bool]) -> Widest:
        """Compute the levels of a map from its states."""
        levels, periodic = np.empty(map_.states.shape, dtype=np.uint16), _three_axes(periodic_axes)
        layered, outside = _with_three_axes(levels), find_outside_ranges(map_, periodic)

        def fill(item: tuple[int, Bytes]) -> None:
            s, state = item
            layered[s] = compute_levels(state.reshape(layered.shape[1:]), outside[s], periodic)

        in_threads(fill, list(enumerate(states)), cores())
        costs = turn_costs(rotations, levels.ndim - 1, map_.spacing)
        return cls(levels, map_.slice_of, rotations, costs, periodic_axes, outside)

    def refresh(self, boxes: Ints) -> None:
        """Record boxes of changed states, shape (slices, 6)."""
        self.dirty_boxes.append(boxes)

    def updated(self, map_: Map, states: Stack) -> Widest:
        """Return a copy with all changes applied.

        Searches may still use this one, which stays as it is.
        """
        if not self.dirty_boxes:
            return self
        levels, periodic, dirty = self.levels.copy(), _three_axes(self.periodic_axes), np.array(self.dirty_boxes)
        layered, outside = _with_three_axes(levels), find_outside_ranges(map_, periodic)
        boxes = np.concatenate([dirty[..., :3].min(axis=0), dirty[..., 3:].max(axis=0)], axis=1)
        boxes[(outside != self.outside).any(axis=(1, 2, 3))] = 0, 0, 0, *(n - 1 for n in layered.shape[1:])

        def refresh_slice(s: int) -> None:
            state = states[s].reshape(layered.shape[1:])
            if periodic.any():
                layered[s] = compute_levels(state, outside[s], periodic)
            else:
                refresh_levels(layered[s], state, boxes[s], outside[s])

        in_threads(refresh_slice, np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1)).tolist(), cores())
        return replace(self, levels=levels, outside=outside, dirty_boxes=[], cached={})

    def level(self, cell: Sequence[int] | Ints) -> int:
        """Return the level of a cell ``(rotation, x, ...)``."""
        return int(self.levels[self.slice_of[cell[0]], *cell[1:]])

    def states(self, min_level: int) -> Bytes:
        """Return states with only wide cells FREE.

        Wide cells have ``min_level`` or above.
        """
        return read_only((self.levels < min_level).view(np.uint8))  # FREE is 0, and MIXED 1

    def climb(self, cell: Ints) -> Ints:
        """Follow the steepest ascent of clearance.

        Return the cells, from ``cell`` on. Ties go to the larger cell index.
        """
        shape, path = self.levels.shape[1:], [tuple(cell.tolist())]
        while True:
            rotation, *position = path[-1]
            candidates = [(other, *position) for other in self.rotations._neighbors[rotation].tolist() if other >= 0]
            for axis, step in product(range(len(shape)), (-1, 1)):
                coordinate = position[axis] + step
                if self.periodic_axes[axis] or 0 <= coordinate < shape[axis]:
                    candidates.append((rotation, *position[:axis], coordinate % shape[axis], *position[axis + 1 :]))
            best = max([path[-1], *candidates], key=lambda each: (self.level(each), each))
            if best == path[-1]:
                return np.array(path)
            path.append(best)

    def bottleneck(self, start: Ints, goal: Ints, join: Join, until: float) -> int:
        """Return the largest minimum level of a chain.

        Bisect on the level; return 0 if no chain exists. Raises TimeoutError after ``until``.
        """
        low, high = 0, min(self.level(start), self.level(goal))
        upper, tested = high, dict[bool, tuple[int, Components]]()
        while low < high:
            check_deadline(until)
            with self.lock:
                levels = sorted(cached_level for cached_level in self.cached if low < cached_level <= high)
                level = levels[len(levels) // 2] if levels else upper if high == upper else (low + high + 1) // 2
                components = self.cached.get(level) or join(self.states(level))
                first, last = components.of(np.stack([start, goal])).tolist()
            connected = first == last
            low, high = (level, high) if connected else (low, level - 1)
            tested[connected] = level, components  # keep only the last level tested on each side
        with self.lock:
            for cached_level, components in tested.values():
                self.cached.pop(cached_level, None)
                self.cached[cached_level] = components
            for cached_level in list(self.cached)[:-MAX_CACHED_LEVELS]:
                del self.cached[cached_level]
        return low

    def shortest(self, start: Ints, goal: Ints, min_level: int, until: float) -> Ints:
        """Return the shortest chain of wide cells.

        The result has shape (n, 1 + d). Raises TimeoutError after ``until``.
        """
        states, guides = self.states(min_level), []
        graph = Graph.of(states, self.slice_of, self.rotations._neighbors, self.turns, self.periodic_axes)
        if len(self.slice_of) > 1:
            no_rotations = np.zeros(1, dtype=np.int64), self.rotations._neighbors[:1, :0], self.turns[:1, :0]
            positions = Graph.of(read_only(states.min(axis=0, keepdims=True)), *no_rotations, self.periodic_axes)
            guides.append(Guide(positions, np.zeros_like(self.slice_of), 1))
        return graph.chain(start, goal, until, guides=guides)


def _with_three_axes(levels: Levels) -> Levels:
    """Return levels with three grid axes.

    A plane has one layer.
    """
    slices, *shape = levels.shape
    return levels.reshape(slices, *[1] * (3 - len(shape)), *shape)


def _three_axes(periodic_axes: Sequence[bool]) -> Bools:
    """Return which of three axes are periodic.

    A plane has no x.
    """
    return np.array([*[False] * (3 - len(periodic_axes)), *periodic_axes])


def compute_levels(state: Bytes, outside: Squares, periodic: Bools) -> Levels:
    """Compute the levels of cells, shape (nx, ny, nz).

    ``outside`` has the ranges of one slice. ``periodic``, shape (3,), is True for each periodic axis. Cells outside
    the grid count last, because their distances are simple.
    """
    # Along a periodic axis, the nearest cell is at most half a period away.
    padding = np.where(periodic, np.array(state.shape) // 2 + 1, 0)
    padded = np.pad(state, np.column_stack([padding, padding]), "wrap") if periodic.any() else state
    squares, (nx, ny, nz) = np.empty(padded.shape, dtype=np.int32), padded.shape
    write_rows = partial(write_row_squares, padded.reshape(-1, nz), squares.reshape(-1, nz))
    in_chunks(write_rows, nx * ny, MIN_LINES_PER_THREAD)
    in_chunks(partial(extend_squares, squares), nx * nz, MIN_LINES_PER_THREAD)
    if nx > 1:
        in_chunks(partial(extend_squares, squares.reshape(1, nx, ny * nz)), ny * nz, MIN_LINES_PER_THREAD)
    center = tuple(slice(width, width + n) for width, n in zip(padding.tolist(), state.shape, strict=True))
    squares = np.ascontiguousarray(squares[center])
    in_chunks(partial(lower_squares, squares, outside), state[..., 0].size, MIN_LINES_PER_THREAD)
    return np.minimum(LEVELS_PER_CELL / 2 * np.sqrt(squares, dtype=np.float32), MAX_LEVEL).astype(np.uint16)


def find_outside_ranges(map_: Map, periodic: Bools) -> Squares:
    """Return the boxes of non-FREE cells beyond each side of the grid.

    The result has the first half cell along three axes, and the one after the last, shape (slices, sides, 3, 2).
    Nothing is beyond a periodic side.
    """
    ranges = np.empty((len(map_.exterior), 2 * len(map_.lower), 3, 2), dtype=np.int32)
    write_outside_ranges(map_.exterior, map_.states.shape, periodic, ranges)
    return ranges


def refresh_levels(levels: Levels, state: Bytes, box: Ints, outside: Squares) -> None:
    """Update levels after states changed in a box.

    ``box`` has the first and last changed cell. Cells whose level was below their distance from the box keep it, and no
    distance was above the highest level.
    """
    shape, highest = np.array(levels.shape), int(levels.max())
    reach = highest // LEVELS_PER_CELL + 2
    low, high = np.maximum(box[:3] - reach, 0), np.minimum(box[3:] + 1 + reach, shape)
    first, stop = np.maximum(low - reach, 0), np.minimum(high + reach, shape)
    window = np.ascontiguousarray(state[tuple(map(slice, first, stop))])
    # Cells around the window count as FREE, but those outside the grid as what they are.
    fresh = compute_levels(window, outside - np.int32(2) * first[:, np.newaxis].astype(np.int32), NO_PERIODIC_AXES)
    inner = tuple(map(slice, low - first, high - first))
    if highest == MAX_LEVEL or fresh[inner].max() >= LEVELS_PER_CELL * reach:  # cells outside the window may be nearer
        levels[...] = compute_levels(np.ascontiguousarray(state), outside, NO_PERIODIC_AXES)
    else:
        levels[tuple(map(slice, low, high))] = fresh[inner]


# ---- distances -------------------------------------------------------------------------------------------------------
#
# Squared distances from the center of a cell to cells that are not FREE, as closed squares or cubes, in half cells.
# Along an axis, cells k apart are 2 |k| - 1 half cells apart, and a cell is 0 from itself. The algorithm works line by
# line (A. Meijster, J. Roerdink and W. Hesselink, "A general algorithm for computing distance transforms in linear
# time", 2000).


@kernel
def write_outside_ranges(exterior: Ints, shape: tuple[int, ...], periodic: Bools, ranges: Squares) -> None:
    """Write the ranges of :func:`find_outside_ranges`."""
    dim = len(shape) - 1
    for s in range(len(exterior)):
        for side in range(2 * dim):
            empty = periodic[3 - dim + side // 2]
            ranges[s, side, :, 0], ranges[s, side, :, 1] = -FAR_HALF_CELLS, FAR_HALF_CELLS
            for axis in range(dim):
                low, high = range_outside(exterior, shape, s, side, axis)
                empty |= low >= high
                if not periodic[3 - dim + axis]:
                    ranges[s, side, 3 - dim + axis, 0] = np.int64(max(2.0 * low, -float(FAR_HALF_CELLS)))
                    ranges[s, side, 3 - dim + axis, 1] = np.int64(min(2.0 * high, float(FAR_HALF_CELLS)))
            if empty:
                ranges[s, side, :, 0], ranges[s, side, :, 1] = FAR_HALF_CELLS, -FAR_HALF_CELLS


@kernel
def lower_squares(squares: Squares, outside: Squares, start: int, stop: int) -> int:
    """Lower squared distances of rows [start, stop) to those of cells outside the grid.

    ``outside`` has the ranges of one slice.
    """
    _, ny, nz = squares.shape
    for row in range(start, stop):
        x, y = row // ny, row % ny
        line = squares[x, y]
        for side in range(len(outside)):
            x_gap = _half_cells_to(outside[side, 0, 0], outside[side, 0, 1], x)
            y_gap = _half_cells_to(outside[side, 1, 0], outside[side, 1, 1], y)
            across = np.int64(x_gap) ** 2 + np.int64(y_gap) ** 2
            if across >= INFINITE_SQUARE:
                continue
            base, low, high = np.int32(across), outside[side, 2, 0], outside[side, 2, 1]
            for k in range(nz):
                z_gap = _half_cells_to(low, high, k)
                line[k] = min(line[k], np.int32(base + np.int32(z_gap * z_gap)))
    return -1


@always_inline
def _half_cells_to(low: np.int32, high: np.int32, k: int) -> np.int32:
    """Return the distance from the center of cell k to a range, in half cells.

    Its square is at most :data:`INFINITE_SQUARE`, so that two of them do not exceed 32 bits if one is below.
    """
    center = np.int32(2 * k + 1)
    outward = max(np.int32(low - center), np.int32(center - high), np.int32(0))
    return np.int32(min(outward, np.int32(2**15)))


@kernel
def write_row_squares(states: Bytes, squares: Squares, start: int, stop: int) -> int:
    """Write squared distances within rows [start, stop)."""
    n = states.shape[1]
    for row in range(start, stop):
        for backwards in range(2):
            nearest = -INFINITE_SQUARE
            for step in range(n):
                k = step if backwards == 0 else n - 1 - step
                if states[row, k] != FREE:
                    nearest = step
                distance = np.int64(step - nearest)
                # From 2**14 on, squares would exceed the number that stands for infinity.
                square = INFINITE_SQUARE if distance >= 2**14 else (2 * distance - 1) ** 2 if distance > 0 else 0
                squares[row, k] = square if backwards == 0 else min(square, squares[row, k])
    return -1


@jit
def extend_squares(squares: Squares, first_line: int, stop_line: int) -> int:
    """Extend squared distances from rows to the middle axis."""
    n = squares.shape[1]
    values, cells, starts = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    for line in range(first_line, stop_line):
        a, b = line // squares.shape[2], line % squares.shape[2]
        for k in range(n):
            values[k] = squares[a, k, b]
        # Stack of the cells that are nearest at some position, and the position from which on.
        top, cells[0], starts[0] = 0, 0, 0
        for v in range(1, n):
            while top >= 0 and _square(values, cells[top], starts[top]) > _square(values, v, starts[top]):
                top -= 1
            if top < 0:
                top, cells[0], starts[0] = 0, v, 0
                continue
            start_of_v = _last_closer(cells[top], v, values[v] - values[cells[top]]) + 1
            if start_of_v < n:
                top += 1
                cells[top], starts[top] = v, start_of_v
        for k in range(n - 1, -1, -1):
            squares[a, k, b] = min(_square(values, cells[top], k), INFINITE_SQUARE)
            if k == starts[top]:
                top -= 1
    return -1


@jit
def _square(values: Ints, cell: int, k: int) -> int:
    """Return the squared distance by way of a cell.

    ``values`` has the squared distance of each cell across the line.
    """
    half_cells: int = max(2 * abs(k - cell) - 1, 0)
    return int(values[cell]) + half_cells * half_cells


@jit
def _last_closer(u: int, v: int, more: int) -> int:
    """Return the last position no farther from u than from v.

    ``more`` is the square of v minus the square of u.
    """
    distance, reach = v - u, (2 * (v - u) - 1) ** 2
    if more >= reach:  # beyond v
        return max(v, (more + 4 * distance * (u + v + 1)) // (8 * distance))
    if more < -reach:  # before u
        return min(u - 1, (more + 4 * distance * (u + v - 1)) // (8 * distance))
    if distance == 1:
        return u
    return min(max(u, (more + 4 * (distance - 1) * (u + v)) // (8 * (distance - 1))), v - 1)


# ---- paths -----------------------------------------------------------------------------------------------------------


def find_widest_path(
    widest: Widest,
    map_: Map,
    grid: Grid,
    endpoints: tuple[Floats, Ints],
    join: Join,
    straight: bool,
    until: float,
) -> Floats:
    """Return waypoints of the widest path between two configurations.

    ``endpoints`` are the configurations, shape (2, size), and their cells, shape (2, 1 + d). The result has length 0 if
    no path exists. If not ``straight``, waypoints are the centers of the cells passed. Values of periodic axes are
    unwrapped. Raises TimeoutError after ``until``.
    """
    rotations, q, cells_of_q = widest.rotations, widest.rotations._make_canonical(endpoints[0]), endpoints[1]
    climbs = [widest.climb(cell) for cell in cells_of_q]
    level = widest.bottleneck(climbs[0][-1], climbs[1][-1], join, until)
    if not level:
        return np.empty((0, q.shape[1]))
    ascent, descent = (climb[[widest.level(cell) < level for cell in climb]] for climb in climbs)
    chain = widest.shortest(climbs[0][len(ascent)], climbs[1][len(descent)], level, until)
    cells = unwind(np.concatenate([ascent, chain, descent[::-1]]), grid.shape, widest.periodic_axes)
    path = waypoints(grid, rotations, q, cells, widest.periodic_axes)
    if not straight:
        return path
    # Each of the three parts is shortened within cells at least as wide as its own narrowest cell.
    first, last = len(ascent) + 1 if len(ascent) else 0, len(ascent) + len(chain) if len(descent) else len(path) - 1
    low, high = map(widest.level, cells_of_q)
    pieces = [path[:1]]
    for begin, end, min_level in ((0, first, low), (first, last, level), (last, len(path) - 1, high)):
        if begin < end:
            wide_map = _cut_wide_map(widest, map_, cells[max(begin - 1, 0) : end, 1:], min_level)
            is_free = in_time(below_half_a_turn(edge_checker(wide_map, path.shape[1]), widest.periodic_axes), until)
            pieces.append(pulled_straight(path[begin : end + 1], rotations, is_free)[1:])
    return np.concatenate(pieces)


def _cut_wide_map(widest: Widest, map_: Map, positions: Ints, min_level: int) -> Map:
    """Return a map around positions with wide cells FREE.

    Cells of ``min_level`` or above are FREE.
    """
    levels, first, stop = widest.levels, positions.min(axis=0) - 1, positions.max(axis=0) + 2
    for axis, periodic in enumerate(widest.periodic_axes):
        if periodic:
            levels = levels.take(np.arange(first[axis], stop[axis]), axis=axis + 1, mode="wrap")
        else:
            first[axis], stop[axis] = max(first[axis], 0), min(stop[axis], levels.shape[axis + 1])
            levels = np.moveaxis(np.moveaxis(levels, axis + 1, 0)[first[axis] : stop[axis]], 0, axis + 1)
    states = read_only((levels < min_level).view(np.uint8))
    lower, upper = (tuple((map_.lower + map_.spacing * cell).tolist()) for cell in (first, stop))
    return map_._replace(states=states, cells=states.reshape(-1), lower=lower, upper=upper)

"""The widest path between two configurations: the one whose smallest clearance is the largest, and then the shortest.

Each FREE cell has a *level*, the distance from its middle to the nearest cell that is not FREE, in parts of a cell. The
largest level that the smallest one of a path can have is the *bottleneck* of its endpoints: the highest one of which
cells of that level or above join them. Among these, the shortest chain is searched; where the robot turns, it is led by
the lengths of the shortest ones over places that are as wide at any rotation.

Where the start or the goal itself is the narrowest place, as beside a wall, all paths are as narrow as that. So both
are left the steepest way up, and the bottleneck is that between the tops; the path is among the widest all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, MIXED, Bools, Bytes, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.grid import Grid
from cspace.map.callbacks import edge_checker
from cspace.map.components import Components
from cspace.map.derived import Lock
from cspace.map.paths import in_time, pulled_straight, unwind, waypoints
from cspace.map.periodic import below_half_a_turn
from cspace.map.search import Graph, keep_on
from cspace.map.storage import Map, Stack, read_only
from cspace.rotations import Rotations
from cspace.threads import cores, in_chunks, in_threads

Levels = NDArray[np.uint16]
Squares = NDArray[np.int32]
Join = Callable[[Bytes], Components]
"""The components of some states."""

LEVELS: Final = 64
"""Levels to a cell."""

TOP: Final = 65535
"""The highest level: 1024 cells of clearance; more does not count."""

FAR: Final = 2**30
"""Square of a distance, in half cells, that stands for infinity."""

BYTES: Final = 28
"""For each cell: its level, which stays, and what searches and components take. Measured: 10 to 25 at most at a
time."""

METRES_A_RADIAN: Final = 0.5
"""What a turn counts as in the length, as in OMPL's SE(2)."""

LINES: Final = 64
"""Lines of cells below which a second thread costs more than it saves."""

CACHED: Final = 8
"""Levels whose components stay, in 1.1 bytes for each cell of a slice."""

NO_WALLS: Final = np.zeros(3, dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Widest:
    """What widest paths derive from a map.

    Attributes
    ----------
    levels : ndarray of uint16, shape (slices, nx, ny) or (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
    rotations : Rotations
    turns : ndarray of float64, shape (rotations, n)
        What it costs to turn to each neighbour, in cells.
    endless : sequence of bool
        Which axes close in a circle.
    walls : ndarray of bool, shape (slices, 3)
        As of :func:`walls_of`.
    noted : list of ndarray of int64, shape (slices, 6)
        Boxes of each slice in which states have changed since.
    cached : dict of int to Components
        Those of the levels between which the last bottlenecks were found.
    lock : Lock
        Held while these are used.
    """

    levels: Levels
    slice_of: Ints
    rotations: Rotations
    turns: Floats
    periodic_axes: Sequence[bool]
    walls: Bools
    noted: list[Ints] = field(default_factory=list)
    cached: dict[int, Components] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    @classmethod
    def of(cls, map_: Map, states: Iterable[Bytes], rotations: Rotations, periodic_axes: Sequence[bool]) -> Widest:
        """Of a map, by the states of each slice; some axes of it close in a circle."""
        levels, walls = np.empty(map_.states.shape, dtype=np.uint16), walls_of(map_)
        layered, closed = _layered(levels), _in_space(periodic_axes)

        def fill(item: tuple[int, Bytes]) -> None:
            number, state = item
            layered[number] = levels_around(state.reshape(layered.shape[1:]), walls[number], closed)

        in_threads(fill, list(enumerate(states)), cores())
        middles = np.column_stack([np.zeros((rotations.count, levels.ndim - 1)), rotations.centers])
        turns = np.linalg.norm(rotations.steps(middles[:, None], middles[rotations.neighbors]), axis=-1)
        costs = METRES_A_RADIAN / map_.spacing * turns
        return cls(levels, map_.slice_of, rotations, costs, periodic_axes, walls)

    def refresh(self, boxes: Ints) -> None:
        """Note the box in which states of each slice have changed, shape (slices, 6)."""
        self.noted.append(boxes)

    def renewed(self, map_: Map, states: Stack) -> Widest:
        """The same with all changes followed; this one stays as it is, for searches that still use it."""
        if not self.noted:
            return self
        levels, walls, noted = self.levels.copy(), walls_of(map_), np.array(self.noted)
        layered, closed = _layered(levels), _in_space(self.periodic_axes)
        boxes = np.concatenate([noted[..., :3].min(axis=0), noted[..., 3:].max(axis=0)], axis=1)
        boxes[(walls != self.walls).any(axis=1)] = 0, 0, 0, *(n - 1 for n in layered.shape[1:])

        def follow(number: int) -> None:
            state = states[number].reshape(layered.shape[1:])
            if closed.any():
                layered[number] = levels_around(state, walls[number], closed)
            else:
                refresh_levels(layered[number], state, boxes[number], walls[number])

        in_threads(follow, np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1)).tolist(), cores())
        return replace(self, levels=levels, walls=walls, noted=[], cached={})

    def level(self, cell: Sequence[int] | Ints) -> int:
        """Level of a cell, ``(rotation, x, y)`` or ``(rotation, x, y, z)``."""
        return int(self.levels[self.slice_of[cell[0]], *cell[1:]])

    def states(self, least: int) -> Bytes:
        """States in which cells of a level or above are FREE, and no others."""
        return read_only((self.levels < least).view(np.uint8))  # FREE is 0, and MIXED 1

    def climb(self, cell: Ints) -> Ints:
        """Cells from one up to a top, each the highest beside the one before; of one level, the later is higher."""
        shape, path = self.levels.shape[1:], [tuple(cell.tolist())]
        while True:
            rotation, *place = path[-1]
            beside = [(other, *place) for other in self.rotations.neighbors[rotation].tolist() if other >= 0]
            for axis, step in product(range(len(shape)), (-1, 1)):
                at = place[axis] + step
                if self.periodic_axes[axis] or 0 <= at < shape[axis]:
                    beside.append((rotation, *place[:axis], at % shape[axis], *place[axis + 1 :]))
            above = max([path[-1], *beside], key=lambda each: (self.level(each), each))
            if above == path[-1]:
                return np.array(path)
            path.append(above)

    def bottleneck(self, start: Ints, goal: Ints, join: Join, until: float) -> int:
        """The largest level that the lowest cell of a chain from one to the other can have; 0 where there is none.

        TimeoutError is raised from a time on.
        """
        known, most = 0, min(self.level(start), self.level(goal))
        top, sides = most, dict[bool, tuple[int, Components]]()
        while known < most:
            keep_on(until)
            with self.lock:
                inside = sorted(level for level in self.cached if known < level <= most)
                ask = inside[len(inside) // 2] if inside else top if most == top else (known + most + 1) // 2
                components = self.cached.get(ask) or join(self.states(ask))
                first, last = components.of(np.stack([start, goal])).tolist()
            joined = first == last
            known, most = (ask, most) if joined else (known, ask - 1)
            sides[joined] = ask, components  # those asked before are asked no more
        with self.lock:
            for level, components in sides.values():
                self.cached.pop(level, None)
                self.cached[level] = components
            for level in list(self.cached)[:-CACHED]:
                del self.cached[level]
        return known

    def shortest(self, start: Ints, goal: Ints, least: int, until: float) -> Ints:
        """The shortest chain of cells of a level or above from one to another, shape (n, 1 + d).

        TimeoutError is raised from a time on.
        """
        states, places = self.states(least), None
        graph = Graph.of(states, self.slice_of, self.rotations.neighbors, self.turns, self.periodic_axes)
        if len(self.slice_of) > 1:
            alone = np.zeros(1, dtype=np.int64), self.rotations.neighbors[:1, :0], self.turns[:1, :0]
            places = Graph.of(read_only(states.min(axis=0, keepdims=True)), *alone, self.periodic_axes)
        return graph.chain(start, goal, until, places=places)


def _layered(levels: Levels) -> Levels:
    """The same, shape (slices, nx, ny, nz); a plane has one layer along x."""
    slices, *shape = levels.shape
    return levels.reshape(slices, *[1] * (3 - len(shape)), *shape)


def _in_space(periodic_axes: Sequence[bool]) -> Bools:
    """Which of three axes close in a circle; a plane has no x."""
    return np.array([*[False] * (3 - len(periodic_axes)), *periodic_axes])


def levels_of(state: Bytes, walls: Bools) -> Levels:
    """Levels of cells, shape (nx, ny, nz); along which axes what lies around them is not FREE, shape (3,)."""
    squares, (nx, ny, nz) = np.empty(state.shape, dtype=np.int32), state.shape
    in_x, in_y, in_z = walls.tolist()
    in_chunks(partial(begin, state.reshape(-1, nz), squares.reshape(-1, nz), in_z), nx * ny, LINES)
    in_chunks(partial(extend, squares, in_y), nx * nz, LINES)
    if nx > 1 or in_x:
        in_chunks(partial(extend, squares.reshape(1, nx, ny * nz), in_x), ny * nz, LINES)
    return np.minimum(LEVELS / 2 * np.sqrt(squares, dtype=np.float32), TOP).astype(np.uint16)


def levels_around(state: Bytes, walls: Bools, closed: Bools) -> Levels:
    """As :func:`levels_of`, where some axes close in a circle, shape (3,)."""
    if not closed.any():
        return levels_of(state, walls)
    # Along a circle, what is nearest is no farther than half a turn.
    padding = np.where(closed, np.array(state.shape) // 2 + 1, walls)
    around = state
    for axis, width in enumerate(padding.tolist()):
        sides = [(width, width) if each == axis else (0, 0) for each in range(3)]
        around = np.pad(around, sides, "wrap") if closed[axis] else np.pad(around, sides, constant_values=MIXED)
    inner = tuple(slice(width, width + n) for width, n in zip(padding, state.shape, strict=True))
    return levels_of(around, NO_WALLS)[inner]


def walls_of(map_: Map) -> Bools:
    """Of each slice, along which axes what lies around its cells is not FREE, shape (slices, 3); a plane has no x."""
    _, *shape = map_.states.shape
    boxes, dim = map_.exterior[:, :-1], len(shape)
    empty = (boxes[:, :dim] > boxes[:, dim:]).any(axis=1)
    inside = empty | ((boxes[:, :dim] >= 0) & (boxes[:, dim:] < shape)).all(axis=1)
    exterior_blocked: Bools = (map_.exterior[:, -1] != FREE) | ~inside
    return exterior_blocked[:, None] & (np.arange(3) >= 3 - dim)


def refresh_levels(levels: Levels, state: Bytes, box: Ints, walls: Bools) -> None:
    """Bring the levels of a slice up to date where states have changed within a box, its first and last cell.

    A cell whose level was below its distance from the box keeps it, and none was farther than the highest level.
    """
    shape, most = np.array(levels.shape), int(levels.max())
    reach = most // LEVELS + 2
    low, high = np.maximum(box[:3] - reach, 0), np.minimum(box[3:] + 1 + reach, shape)
    first, stop = np.maximum(low - reach, 0), np.minimum(high + reach, shape)
    around = np.ascontiguousarray(state[tuple(map(slice, first, stop))])
    # What lies around the window is taken as FREE, and where it is the grid's side, as what it is.
    sides = np.stack([walls & (first == 0), walls & (stop == shape)], axis=1).astype(int)
    fresh = levels_of(np.pad(around, sides, constant_values=MIXED), NO_WALLS)
    inner = tuple(map(slice, low - first + sides[:, 0], high - first + sides[:, 0]))
    if most == TOP or fresh[inner].max() >= LEVELS * reach:  # what is outside the window may count
        levels[...] = levels_of(np.ascontiguousarray(state), walls)
    else:
        levels[tuple(map(slice, low, high))] = fresh[inner]


# ---- distances -------------------------------------------------------------------------------------------------------
#
# Squares of distances from the middle of a cell to the cells that are not FREE, as closed squares or cubes, in half
# cells: along an axis, two cells are 2 |k| - 1 half cells apart, or none. Line by line, as of A. Meijster, J. Roerdink
# and W. Hesselink, "A general algorithm for computing distance transforms in linear time", 2000.


@kernel
def begin(states: Bytes, squares: Squares, exterior_blocked: bool, start: int, stop: int) -> int:
    """Write squares of the distances within each row from ``start`` on and before ``stop``."""
    n = states.shape[1]
    for row in range(start, stop):
        for backwards in range(2):
            last = -1 if exterior_blocked else -FAR
            for step in range(n):
                k = step if backwards == 0 else n - 1 - step
                if states[row, k] != FREE:
                    last = step
                apart = np.int64(step - last)
                square = 0 if apart == 0 else min((2 * apart - 1) ** 2, FAR) if apart < 2**14 else FAR
                squares[row, k] = square if backwards == 0 else min(square, squares[row, k])  # type: ignore[assignment]
    return -1


@jit
def extend(squares: Squares, exterior_blocked: bool, start: int, stop: int) -> int:
    """Make squares of distances within rows those along one more axis, the middle one, of lines from ``start`` on."""
    n = squares.shape[1]
    values, cells, firsts = np.empty(n + 2, np.int64), np.empty(n + 2, np.int64), np.empty(n + 2, np.int64)
    border = 0 if exterior_blocked else FAR
    for line in range(start, stop):
        a, b = line // squares.shape[2], line % squares.shape[2]
        values[0] = values[n + 1] = border
        for k in range(n):
            values[k + 1] = squares[a, k, b]
        # The cells that are nearest somewhere, and from which place on.
        top, cells[0], firsts[0] = 0, 0, 0
        for v in range(1, n + 2):
            while top >= 0 and _square(values, cells[top], firsts[top]) > _square(values, v, firsts[top]):
                top -= 1
            if top < 0:
                top, cells[0], firsts[0] = 0, v, 0
                continue
            after = _last_of(cells[top], v, values[v] - values[cells[top]]) + 1
            if after < n + 2:
                top += 1
                cells[top], firsts[top] = v, after
        for k in range(n + 1, 0, -1):
            if k <= n:
                squares[a, k - 1, b] = min(_square(values, cells[top], k), FAR)
            if k == firsts[top]:
                top -= 1
    return -1


@jit
def _square(values: Ints, cell: int, k: int) -> int:
    apart: int = max(2 * abs(k - cell) - 1, 0)
    return int(values[cell]) + apart * apart


@jit
def _last_of(u: int, v: int, more: int) -> int:
    """The last place at which cell u < v is no farther than v, of which the square is larger by ``more``."""
    apart, reach = v - u, (2 * (v - u) - 1) ** 2
    if more >= reach:  # beyond v
        return max(v, (more + 4 * apart * (u + v + 1)) // (8 * apart))
    if more < -reach:  # before u
        return min(u - 1, (more + 4 * apart * (u + v - 1)) // (8 * apart))
    if apart == 1:
        return u
    return min(max(u, (more + 4 * (apart - 1) * (u + v)) // (8 * (apart - 1))), v - 1)


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
    """Waypoints of the widest path between two configurations and their cells, shapes (2, size) and (2, 1 + d).

    Of length 0 where there is none; TimeoutError from a time on. If not ``straight``, they are all the middles of cells
    that it passes. Along axes that close, rows count whole turns.
    """
    rotations, ends, starts = widest.rotations, widest.rotations.canonical(endpoints[0]), endpoints[1]
    climbs = [widest.climb(cell) for cell in starts]
    level = widest.bottleneck(climbs[0][-1], climbs[1][-1], join, until)
    if not level:
        return np.empty((0, ends.shape[1]))
    up, down = (climb[[widest.level(cell) < level for cell in climb]] for climb in climbs)
    chain = widest.shortest(climbs[0][len(up)], climbs[1][len(down)], level, until)
    cells = unwind(np.concatenate([up, chain, down[::-1]]), grid.shape, widest.periodic_axes)
    path = waypoints(grid, rotations, ends, cells, widest.periodic_axes)
    if not straight:
        return path
    # Each part keeps to the cells that are as wide as its own narrowest one.
    first, last = len(up) + 1 if len(up) else 0, len(up) + len(chain) if len(down) else len(path) - 1
    low, high = map(widest.level, starts)
    pieces = [path[:1]]
    for begin, end, least in ((0, first, low), (first, last, level), (last, len(path) - 1, high)):
        if begin < end:
            wide = _wide_part(widest, map_, cells[max(begin - 1, 0) : end, 1:], least)
            shorter = in_time(below_half_a_turn(edge_checker(wide, path.shape[1]), widest.periodic_axes), until)
            pieces.append(pulled_straight(path[begin : end + 1], grid.dim, shorter, 2.0 * grid.spacing)[1:])
    return np.concatenate(pieces)


def _wide_part(widest: Widest, map_: Map, places: Ints, least: int) -> Map:
    """The map around places, shape (n, d), in which cells of a level or above are FREE, and no others."""
    levels, first, stop = widest.levels, places.min(axis=0) - 1, places.max(axis=0) + 2
    for axis, turns in enumerate(widest.periodic_axes):
        if turns:
            levels = levels.take(np.arange(first[axis], stop[axis]), axis=axis + 1, mode="wrap")
        else:
            first[axis], stop[axis] = max(first[axis], 0), min(stop[axis], levels.shape[axis + 1])
            levels = np.moveaxis(np.moveaxis(levels, axis + 1, 0)[first[axis] : stop[axis]], 0, axis + 1)
    states = read_only((levels < least).view(np.uint8))
    lower, upper = (tuple((map_.lower + map_.spacing * cell).tolist()) for cell in (first, stop))
    return map_._replace(states=states, cells=states.reshape(-1), lower=lower, upper=upper)

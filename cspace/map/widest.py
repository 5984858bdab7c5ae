"""The widest path between two configurations: the one whose smallest clearance is the largest, and then the shortest.

Each FREE cell has a *level*, the distance from its middle to the nearest cell that is not FREE, in parts of a cell. The
largest level that the smallest one of a path can have is the *bottleneck* of its endpoints; a flood finds it.
Among the cells of that level or above, A* finds the shortest chain; where the robot turns, led by the lengths of the
shortest paths over places that are as wide at any rotation.

Where the start or the goal itself is the narrowest place, as beside a wall, all paths are as narrow as that. So both
are left the steepest way up, and the bottleneck is that between the tops; the path is among the widest all the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspace.angles import TURN, beside
from cspace.arrays import Bools, Bytes, Floats, Ints
from cspace.compiling import inner, jit, reader
from cspace.grid import Grid
from cspace.map.callbacks import below_half_a_turn, edge_checker
from cspace.map.free_path import doubled, in_time, keep_on, pulled_straight
from cspace.map.record import Map
from cspace.map.storage import Stack, read_only
from cspace.rotations import Rotations
from cspace.states import FREE, MIXED
from cspace.threads import cores, in_chunks, in_threads

T = TypeVar("T")
Levels = NDArray[np.uint16]
Squares = NDArray[np.int32]
Cells = NDArray[np.uint32]
Spot = tuple[int, int, int, int]
"""Rotation cell, and place along three axes."""

LEVELS: Final = 64
"""Levels to a cell."""

TOP: Final = 65535
"""The highest level: 1024 cells of clearance; more does not count."""

FAR: Final = 2**30
"""Square of a distance, in half cells, that stands for infinity."""

BYTES: Final = 28
"""For each cell: its level, which stays, what came before it, its distance, and what waits. Measured: 10 to 25 at
most at a time."""

METRES_A_RADIAN: Final = 0.5
"""What a turn counts as in the length, as in OMPL's SE(2)."""

LARGEST: Final = 2**22
"""Cells of the largest map whose room for searches is reused by the next one, in 12 bytes for each that a search
came to: 50 MB at most. To take it anew is up to a third of the time."""

MARGIN: Final = 16.0
"""Cells by which a chain may be longer than without its turns before it is led less well."""

SAME: Final = 1e-5
"""Cells of way that rounding may make of nothing."""

LATE: Final = 0.01
"""The same of estimates, in single precision."""

SPENT: Final = 2.0**20
"""Cells of way of searches, all in all, after which what they left is wiped away."""

NO_MOVE: Final = 255
"""What stands for the move to the start."""

LISTS: Final = 8
"""Lists of what waits for each cell of way: within one of them, order does not count."""

STEPS: Final = 2**11
"""Cells that a search takes between two looks at the clock: half a millisecond, or 100 where all memory is new."""

ENTRIES: Final = 4096
"""Entries that there is room for in the beginning."""

LINES: Final = 64
"""Lines of cells below which a second thread costs more than it saves."""


NO_WALLS: Final = np.zeros(3, dtype=np.bool_)


class Graph(NamedTuple):
    """Cells, and what leads from one to the next.

    Cells are numbered in a row, rotation cell by rotation cell, along three axes; the plane has one layer along x.

    Attributes
    ----------
    levels : ndarray of uint16, shape (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
    neighbors : ndarray of int64, shape (rotations, n)
        Of rotation cells; -1 fills up.
    turns : ndarray of float64, shape (rotations, n)
        What it costs to turn to each of them, in cells.
    moves : ndarray of int64, shape (m, 3)
        Steps from cell to cell: across sides, and then across edges and corners.
    faces : int
        How many of them lead across sides.
    rings : ndarray of int64, shape (3,)
        Cells around the axes that close in a circle, so that the last one along them is a neighbour of the first;
        :data:`FAR` of others. Where the robot turns, none close.
    """

    levels: Levels
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Ints
    faces: int
    rings: Ints

    @property
    def closed(self) -> Bools:
        """Which axes close in a circle, shape (3,)."""
        return np.asarray(self.rings < FAR)


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
    walled: Bools = (map_.exterior[:, -1] != FREE) | ~inside
    return walled[:, None] & (np.arange(3) >= 3 - dim)


def renew_levels(levels: Levels, state: Bytes, box: Ints, walls: Bools) -> None:
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


def graph_of(map_: Map, states: Iterable[Bytes], rotations: Rotations, endless: Sequence[bool] = ()) -> Graph:
    """The cells of a map, by the states of each slice, with their levels; some axes of it close in a circle."""
    _, *shape = map_.states.shape
    dim, layered, turning = len(shape), (1,) * (3 - len(shape)) + tuple(shape), rotations.centers
    levels, walls = np.empty((map_.states.shape[0], *layered), dtype=np.uint16), walls_of(map_)
    closed = np.zeros(3, dtype=np.bool_)
    closed[3 - len(endless) :] = endless
    rings = np.where(closed, layered, FAR)

    def fill(item: tuple[int, Bytes]) -> None:
        number, state = item
        levels[number] = levels_around(np.ascontiguousarray(state).reshape(layered), walls[number], closed)

    in_threads(fill, list(enumerate(states)), cores())
    steps = np.array([-1, 0, 1])
    moves = np.stack(np.meshgrid(steps if dim == 3 else [0], steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.abs(moves).sum(axis=1)
    moves = moves[np.argsort(number, kind="stable")][1:]
    middles = np.column_stack([np.zeros((rotations.count, dim)), turning])
    turns = rotations.steps(middles[:, None], middles[rotations.neighbors])
    costs = METRES_A_RADIAN / map_.spacing * np.linalg.norm(turns, axis=-1)
    return Graph(levels, map_.slice_of, rotations.neighbors, costs, moves, int(np.count_nonzero(number == 1)), rings)


# ---- distances -------------------------------------------------------------------------------------------------------
#
# Squares of distances from the middle of a cell to the cells that are not FREE, as closed squares or cubes, in half
# cells: along an axis, two cells are 2 |k| - 1 half cells apart, or none. Line by line, as of A. Meijster, J. Roerdink
# and W. Hesselink, "A general algorithm for computing distance transforms in linear time", 2000.


@reader
def begin(states: Bytes, squares: Squares, walled: bool, start: int, stop: int) -> int:
    """Write squares of the distances within each row from ``start`` on and before ``stop``."""
    n = states.shape[1]
    for row in range(start, stop):
        for backwards in range(2):
            last = -1 if walled else -FAR
            for step in range(n):
                k = step if backwards == 0 else n - 1 - step
                if states[row, k] != FREE:
                    last = step
                apart = np.int64(step - last)
                square = 0 if apart == 0 else min((2 * apart - 1) ** 2, FAR) if apart < 2**14 else FAR
                squares[row, k] = square if backwards == 0 else min(square, squares[row, k])  # type: ignore[assignment]
    return -1


@jit
def extend(squares: Squares, walled: bool, start: int, stop: int) -> int:
    """Make squares of distances within rows those along one more axis, the middle one, of lines from ``start`` on."""
    n = squares.shape[1]
    values, cells, firsts = np.empty(n + 2, np.int64), np.empty(n + 2, np.int64), np.empty(n + 2, np.int64)
    border = 0 if walled else FAR
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


# ---- from cell to cell -----------------------------------------------------------------------------------------------


@jit
def level_of(graph: Graph, cell: int) -> int:
    """Level of a cell, by its number."""
    size = graph.levels.shape[1] * graph.levels.shape[2] * graph.levels.shape[3]
    return int(graph.levels.ravel()[graph.slice_of[cell // size] * size + cell % size])


# ---- bottlenecks -----------------------------------------------------------------------------------------------------
#
# From each cell the steepest way up ends at a top. A flood goes from one cell on, always to that beside those behind it
# to which the widest step leads (R. C. Prim, 1957). Then the lowest step between its coming to one cell and to another
# is the bottleneck of the two. It is stored for tops alone, and the flood goes no further than the two.


@inner
def _moved(graph: Graph, i: int, j: int, k: int) -> tuple[int, int, int]:
    """A place, or where it comes in again along axes that close; -1 along others where it is outside the grid."""
    _, nx, ny, nz = graph.levels.shape
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return i, j, k
    return _around(graph, 0, i), _around(graph, 1, j), _around(graph, 2, k)


@inner
def _around(graph: Graph, axis: int, i: int) -> int:
    count = graph.levels.shape[axis + 1]
    return i % count if graph.rings[axis] == count else i if i < count else -1


@inner
def _beside(graph: Graph, at: Spot, move: int) -> tuple[int, int]:
    """The cell that a step across a side, or past those a turn, leads to, and its level; -1 and 0 where there is none.

    What a step across a corner joins is joined by steps across sides that touch no other cells.
    """
    _, nx, ny, nz = graph.levels.shape
    rotation, i, j, k = at
    if move < graph.faces:
        u, v, w = graph.moves[move, 0], graph.moves[move, 1], graph.moves[move, 2]
        i, j, k = _moved(graph, i + u, j + v, k + w)
        if min(i, j, k) < 0:
            return -1, 0
    else:
        rotation = graph.neighbors[rotation, move - graph.faces]
        if rotation < 0:
            return -1, 0
    return int(((rotation * nx + i) * ny + j) * nz + k), int(graph.levels[graph.slice_of[rotation], i, j, k])


@inner
def _spot(graph: Graph, cell: int) -> Spot:
    _, nx, ny, nz = graph.levels.shape
    # A division takes as long as all else; in the plane, and of one rotation, one is enough.
    rotation = cell // (nx * ny * nz) if cell >= nx * ny * nz else 0
    cell -= rotation * nx * ny * nz
    i = cell // (ny * nz) if cell >= ny * nz else 0
    cell -= i * ny * nz
    return rotation, i, cell // nz, cell % nz


@inner
def _above(graph: Graph, at: Spot, cell: int) -> int:
    """The highest cell beside one, or itself where none is higher; of one level, larger numbers count as higher."""
    best, highest = cell, int(graph.levels[graph.slice_of[at[0]], at[1], at[2], at[3]])
    for move in range(graph.faces + graph.neighbors.shape[1]):
        other, level = _beside(graph, at, move)
        if level > highest or (level == highest and other > best):
            best, highest = other, level
    return best


class Flood(NamedTuple):
    """How far the cells have been gone over, and the tops that were come to.

    Attributes
    ----------
    seen : ndarray of uint8
        A bit for each cell: whether it has been gone over, or waits at its own level.
    lists : ndarray of int32, shape (TOP + 1,)
        For each level, the entry that waits last; -1 for none.
    cells, before : ndarray of uint32 and int32, shape (m,)
        Entries: a cell, and the entry of that level that came before it, or of those that are free.
    tops, gaps : ndarray of int64 and uint16, shape (t,)
        Cells that none beside is higher than, in the order in which they were come to; and the lowest level at which a
        cell was taken since the one before.
    state : ndarray of int64
        Number of entries; the one that is free, or -1; number of tops; the highest level at which one waits; and the
        lowest at which one was taken since the last top.
    """

    seen: Bytes
    lists: NDArray[np.int32]
    cells: Cells
    before: NDArray[np.int32]
    tops: Ints
    gaps: Levels
    state: Ints

    @classmethod
    def of(cls, cells: int) -> Flood:
        """Of no cell yet, of that many."""
        return cls(
            np.zeros(cells // 8 + 1, dtype=np.uint8),
            np.full(TOP + 1, -1, dtype=np.int32),
            np.empty(ENTRIES, dtype=np.uint32),
            np.empty(ENTRIES, dtype=np.int32),
            np.empty(ENTRIES, dtype=np.int64),
            np.empty(ENTRIES, dtype=np.uint16),
            np.array([0, -1, 0, 0, TOP]),
        )

    def roomy(self, more: int, until: float) -> Flood:
        """With room for some more entries and tops, that of twice as many where it was scarce."""
        if max(self.state[0], self.state[2]) + more < len(self.cells):
            return self
        return self._replace(**doubled(until, cells=self.cells, before=self.before, tops=self.tops, gaps=self.gaps))


@inner
def _is_seen(flood: Flood, cell: int) -> bool:
    return bool((flood.seen[cell >> 3] >> (cell & 7)) & 1)


@inner
def _see(flood: Flood, cell: int) -> None:
    flood.seen[cell >> 3] |= 1 << (cell & 7)


@inner
def _wait(flood: Flood, cell: int, level: int) -> None:
    """Have a cell wait at a level; there must be room for one more entry."""
    lists, cells, before, state = flood.lists, flood.cells, flood.before, flood.state
    entry = state[1]
    if entry < 0:
        entry = state[0]
        state[0] += 1
    else:
        state[1] = before[entry]
    cells[entry], before[entry], lists[level] = cell, lists[level], entry
    state[3] = max(state[3], level)


@reader
def bottleneck(graph: Graph, flood: Flood, one: int, other: int, pair: Ints) -> int:
    """The largest level that the lowest cell of a chain from one top to another can have; 0 where there is none.

    The flood goes on from where it was until it has come to both; -1 where it needs more room, and now and then.
    ``pair`` holds from call to call the numbers of the two among the tops, or -1, and how many were looked through.
    """
    degree, state, steps = graph.faces + graph.neighbors.shape[1], flood.state, 0
    first, second = pair[0], pair[1]
    if one == other:
        return level_of(graph, one)
    for number in range(pair[2], state[2]):
        first = number if flood.tops[number] == one else first
        second = number if flood.tops[number] == other else second
    while first < 0 or second < 0:
        if steps == STEPS or max(state[0], state[2]) + degree >= len(flood.cells):
            pair[0], pair[1], pair[2] = first, second, state[2]
            return -1
        steps += 1
        level = state[3]
        while level > 0 and flood.lists[level] < 0:
            level -= 1
        state[3] = level
        if flood.lists[level] < 0:  # nothing more is joined to what has been gone over
            _wait(flood, one if first < 0 else other, 0)
        entry = flood.lists[level]
        cell = np.int64(flood.cells[entry])
        flood.lists[level], flood.before[entry], state[1] = flood.before[entry], state[1], entry
        at = _spot(graph, cell)  # type: ignore[arg-type]
        own = int(graph.levels[graph.slice_of[at[0]], at[1], at[2], at[3]])
        if own > level and _is_seen(flood, cell):  # type: ignore[arg-type]
            continue
        _see(flood, cell)  # type: ignore[arg-type]
        state[4] = min(state[4], level)
        is_top = True
        for move in range(degree):
            beside, height = _beside(graph, at, move)
            if height > own or (height == own and beside > cell):
                is_top = False
            if height > 0 and not _is_seen(flood, beside):
                if height <= own:  # at its own level it need not wait again
                    _see(flood, beside)
                _wait(flood, beside, min(height, own))
        if is_top:
            number = state[2]
            flood.tops[number], flood.gaps[number] = cell, state[4]
            state[2], state[4] = number + 1, TOP
            first = number if cell == one else first
            second = number if cell == other else second
    best: int = level_of(graph, one)
    for number in range(min(first, second) + 1, max(first, second) + 1):
        best = min(best, np.int64(flood.gaps[number]))  # type: ignore[assignment]
    return best


@jit
def climb(graph: Graph, cell: int) -> Ints:
    """Cells from one up to a top, each the highest beside the one before."""
    path, count, after = np.empty(256, np.int64), 1, _above(graph, _spot(graph, cell), cell)
    path[0] = cell
    while after != path[count - 1]:
        if count == len(path):
            path = np.concatenate((path, np.empty_like(path)))
        path[count], count = after, count + 1
        after = _above(graph, _spot(graph, after), after)
    return path[:count]


def _taken(spare: list[T], make: Callable[[], T]) -> T:
    """What is spare, for one thread at a time; a new one where there is none, or others have it."""
    try:
        return spare.pop()
    except IndexError:
        return make()


@dataclass(frozen=True, slots=True, eq=False)
class Widest:
    """What widest paths derive from a map.

    Attributes
    ----------
    graph : Graph
    rotations : Rotations
    highest : ndarray of uint16, shape (nx, ny, nz)
        The highest level of each place at any rotation.
    moves : Moves
    rooms : list of (ndarray of float64, ndarray of uint32), shapes (n,)
        Room for searches, each for one at a time, a number for each cell, the first with one more, see
        :func:`chain_of`. Memory is taken where they wrote.
    walls : ndarray of bool, shape (slices, 3)
        As of :func:`walls_of`.
    floods : list of Flood
        The one that goes on, while no thread has it. Each slice of its work ends at a cell, so that what was broken
        off there, by a time limit or by Ctrl-C, is as good as new.
    noted : list of ndarray of int64, shape (slices, 6)
        Boxes of each slice in which states have changed since.
    """

    graph: Graph
    rotations: Rotations
    highest: Levels
    moves: Moves
    rooms: list[tuple[Floats, Cells]]
    walls: Bools
    floods: list[Flood]
    noted: list[Ints]

    @classmethod
    def of(cls, map_: Map, states: Iterable[Bytes], rotations: Rotations, endless: Sequence[bool] = ()) -> Widest:
        graph = graph_of(map_, states, rotations, endless)
        return cls(graph, rotations, graph.levels.max(axis=0), moves_of(graph), [], walls_of(map_), [], [])

    def renew(self, boxes: Ints) -> None:
        """Note the box in which states of each slice have changed, shape (slices, 6)."""
        self.noted.append(boxes)

    def renewed(self, map_: Map, states: Stack) -> Widest:
        """The same with all changes followed; this one stays as it is, for searches that still use it."""
        if not self.noted:
            return self
        levels, walls, noted = self.graph.levels.copy(), walls_of(map_), np.array(self.noted)
        closed = self.graph.closed
        boxes = np.concatenate([noted[..., :3].min(axis=0), noted[..., 3:].max(axis=0)], axis=1)
        boxes[(walls != self.walls).any(axis=1)] = 0, 0, 0, *(n - 1 for n in levels.shape[1:])

        def follow(number: int) -> None:
            state = states[number].reshape(levels.shape[1:])
            if closed.any():
                levels[number] = levels_around(state, walls[number], closed)
            else:
                renew_levels(levels[number], state, boxes[number], walls[number])

        in_threads(follow, np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1)).tolist(), cores())
        graph = self.graph._replace(levels=levels)
        return replace(self, graph=graph, highest=levels.max(axis=0), walls=walls, floods=[], noted=[])

    def bottleneck(self, start: int, goal: int, until: float = math.inf) -> int:
        """:func:`bottleneck`, of two cells; TimeoutError from a time on."""
        graph, level = self.graph, min(level_of(self.graph, start), level_of(self.graph, goal))
        if not level:
            return 0
        one, other = (int(climb(graph, cell)[-1]) for cell in (start, goal))
        size, more = graph.levels[0].size * len(graph.slice_of), graph.faces + graph.neighbors.shape[1]
        flood, pair = _taken(self.floods, lambda: Flood.of(size)), np.array([-1, -1, 0])
        try:
            while (best := bottleneck(graph, flood, one, other, pair)) < 0:
                keep_on(until)
                flood = flood.roomy(more, until)
        finally:
            if not self.floods:
                self.floods.append(flood)
        return min(level, best)

    def shortest(self, start: int, goal: int, least: int, until: float = math.inf) -> Ints:
        """The shortest chain of cells of a level or above from one to another; empty where there is none.

        TimeoutError from a time on.
        """
        graph, (_, nx, ny, nz) = self.graph, self.graph.levels.shape
        size, count, more = nx * ny * nz, len(graph.slice_of), len(graph.moves) + graph.neighbors.shape[1]
        flat, bound, lists = np.zeros(0), 0.0, LISTS * (4 * (nx + ny + nz) + 64)
        if count > 1:
            flat, wide, queue = np.zeros(size), self.highest >= least, Queue.of(goal % size, lists)
            flat[goal % size] = 1.0
            while (bound := flat_distances(graph, wide, goal % size, start % size, flat, queue)) < 0.0:
                keep_on(until)
                queue = queue.roomy(more, until)
        room = far, came = _taken(self.rooms, lambda: (np.zeros(size * count + 1), np.zeros(size * count, np.uint32)))
        if far[-1] > SPENT:
            far[:] = 0.0
        far[-1] = max(far[-1], 1.0)
        far[start], came[start], queue = far[-1], 0, Queue.of(start, lists)
        task, led = (start, goal, least), (flat, float(bound), _turns_to(graph, goal // size))
        while not (result := chain_of(graph, self.moves, task, led, room, queue))[0]:
            keep_on(until)  # a room that was written to in vain is thrown away
            queue = queue.roomy(more, until)
        if not self.rooms and size * count <= LARGEST:
            self.rooms.append(room)
        return result[1]


class Queue(NamedTuple):
    """What waits in a search, in lists by its cost, and how far the search has come.

    Attributes
    ----------
    heads : ndarray of int64, shape (lists,)
        The first entry of each list; -1 for none.
    cells, arrivals, after, estimates : ndarray of uint32, uint8, int32 and float32, shape (n,)
        Entries: a cell, by which move it was come to, the next entry, and the least cost of a chain over it.
    state : ndarray of float64, shape (4,)
        Number of entries; the list that is taken from; the highest cost of a cell; and that of the goal, if it was
        come to.
    """

    heads: Ints
    cells: Cells
    arrivals: Bytes
    after: NDArray[np.int32]
    estimates: NDArray[np.float32]
    state: Floats

    @classmethod
    def of(cls, cell: int, lists: int) -> Queue:
        """Of one cell."""
        heads = np.full(lists, -1)
        cells, arrivals = np.empty(ENTRIES, dtype=np.uint32), np.empty(ENTRIES, dtype=np.uint8)
        after, estimates = np.empty(ENTRIES, dtype=np.int32), np.empty(ENTRIES, dtype=np.float32)
        heads[0], cells[0], arrivals[0], after[0], estimates[0] = 0, cell, NO_MOVE, -1, 0.0
        return cls(heads, cells, arrivals, after, estimates, np.array([1.0, 0.0, 0.0, np.inf]))

    def roomy(self, more: int, until: float) -> Queue:
        """With room for some more entries, that of twice as many where it was scarce."""
        if self.state[0] + more <= len(self.cells):
            return self
        arrays = doubled(until, cells=self.cells, arrivals=self.arrivals, after=self.after, estimates=self.estimates)
        return self._replace(**arrays)


@reader
def flat_distances(graph: Graph, wide: Bools, goal: int, start: int, flat: Floats, queue: Queue) -> float:
    """From places, 1 and the length of the shortest chain to one, over places that are wide at any rotation, in cells.

    Cells of one rotation allow no shorter way. Places are looked at that may lie on a chain from ``start`` of at most
    the length that is given back, which is :data:`MARGIN` more than the shortest one's; others are left at zero. -1
    where the queue needs more room, and now and then: it goes on from there.
    """
    nx, ny, nz = wide.shape
    heads, cells, after = queue.heads, queue.cells, queue.after
    si, sj, sk = start // (ny * nz), start // nz % ny, start % nz
    base = 1.0 + _on_empty_grid(graph, goal // (ny * nz) - si, goal // nz % ny - sj, goal % nz - sk)
    count, bucket, steps = int(queue.state[0]), int(queue.state[1]), 0
    while bucket < len(heads):
        if steps == STEPS or count + len(graph.moves) > len(cells):
            queue.state[0], queue.state[1] = count, bucket
            return -1.0
        steps += 1
        entry = heads[bucket]
        if entry < 0:
            bucket += 1
            if flat[start] > 0.0 and bucket > LISTS * (MARGIN + flat[start] - base):
                break
            continue
        heads[bucket] = after[entry]
        cell = np.int64(cells[entry])
        i, j, k = cell // (ny * nz), cell // nz % ny, cell % nz
        for move in range(len(graph.moves)):
            u, v, w = graph.moves[move, 0], graph.moves[move, 1], graph.moves[move, 2]
            if not (0 <= i + u < nx and 0 <= j + v < ny and 0 <= k + w < nz):
                continue
            other = ((i + u) * ny + j + v) * nz + k + w
            cost = flat[cell] + math.sqrt(float(u * u + v * v + w * w))
            if 0.0 < flat[other] <= cost or not wide[i + u, j + v, k + w]:
                continue
            flat[other] = cost
            estimate = cost + _on_empty_grid(graph, i + u - si, j + v - sj, k + w - sk) - base
            number = min(max(int(LISTS * estimate), bucket), len(heads) - 1)
            cells[count], after[count], heads[number] = other, heads[number], count
            count += 1
    return base + bucket / LISTS


class Moves(NamedTuple):
    """What leads from cell to cell, as bits of words: those of moves, and past them those of turns.

    Attributes
    ----------
    steps, lengths : ndarray, shape (m,)
        Of moves: by how much the number of the cell changes, and cells of way.
    parts : ndarray of int64, shape (m,)
        For each move itself and those along some of its axes alone: they lead to the cells that it touches.
    """

    steps: Ints
    lengths: Floats
    parts: Ints


def moves_of(graph: Graph) -> Moves:
    """The moves of a graph."""
    _, _, ny, nz = graph.levels.shape
    among = (graph.moves == 0) | (graph.moves == graph.moves[:, None])
    parts = (among.all(axis=2) << np.arange(len(graph.moves))).sum(axis=1)
    return Moves((graph.moves * (ny * nz, nz, 1)).sum(axis=1), np.linalg.norm(graph.moves, axis=1), parts)


@inner
def _open(graph: Graph, levels: Levels, moves: Moves, first: int, at: Spot, least: int) -> tuple[int, int]:
    """The moves from a place to cells of a level or above, by the number of its cell among all; and those allowed."""
    _, nx, ny, nz = graph.levels.shape
    _, i, j, k = at
    wide, allowed = 0, 0
    deep = 1 if len(moves.steps) > 8 else 0
    if deep <= i < nx - deep and 0 < j < ny - 1 and 0 < k < nz - 1:
        for move in range(len(moves.steps)):
            wide |= (levels[first + moves.steps[move]] >= least) << move
    else:
        first -= (i * ny + j) * nz + k
        for move in range(len(moves.steps)):
            u, v, w = graph.moves[move, 0], graph.moves[move, 1], graph.moves[move, 2]
            u, v, w = _moved(graph, i + u, j + v, k + w)
            if min(u, v, w) >= 0:
                wide |= (levels[first + (u * ny + v) * nz + w] >= least) << move
    if wide == (1 << len(moves.steps)) - 1:
        return wide, wide
    for move in range(len(moves.steps)):
        allowed |= ((wide & moves.parts[move]) == moves.parts[move]) << move
    return wide, allowed


@jit
def chain_of(
    graph: Graph,
    moves: Moves,
    task: tuple[int, int, int],
    led: tuple[Floats, float, Floats],
    room: tuple[Floats, Cells],
    queue: Queue,
) -> tuple[bool, Ints]:
    """Whether :meth:`Widest.shortest` is through, and its chain, of a start, a goal and a level.

    Else it goes on from there: it also ends where the queue needs more room, and now and then. It is led by
    :func:`flat_distances`, or none of one rotation, and :func:`_turns_to`.

    In the room, ``far`` is the cost of a cell, above the last number in it, below which are those of searches before;
    at the end that is above all of this one. ``came`` has a bit for each move that led there as soon, or turn that
    leads back.
    What waits lies in lists by its cost, of :data:`LISTS` to a cell; a cell that is reached anew, sooner, waits again,
    and so does one that is reached as soon by another move, after which others are tried. The search ends when all is
    done that could be cheaper than what has come to the goal: of equal ones, one is enough. So of chains of one cost,
    that with the longest moves first and turns last will do: what another chain than over a cell does as well is not
    tried from there, where all around is wide, as by D. Harabor and A. Grastien, "Online graph pruning for pathfinding
    on grid maps", 2011. Moves and turns add up, so that the shortest chain without turns and the turns to the goal's
    rotation are a bound of what is still to come.
    """
    _, nx, ny, nz = graph.levels.shape
    (start, goal, least), (flat, bound, ahead), (far, came) = task, led, room
    size, straight, levels = nx * ny * nz, len(moves.steps), graph.levels.ravel()
    every, count, bucket, steps = (1 << straight) - 1, int(queue.state[0]), int(queue.state[1]), 0
    heads, cells, arrivals, after, estimates = queue.heads, queue.cells, queue.arrivals, queue.after, queue.estimates
    gi, gj, gk = goal % size // (ny * nz), goal % size // nz % ny, goal % size % nz
    si, sj, sk = start % size // (ny * nz), start % size // nz % ny, start % size % nz
    began = far[-1]
    base = ahead[start // size] + (
        flat[start % size] - 1.0 if len(flat) else _on_empty_grid(graph, si - gi, sj - gj, sk - gk)
    )
    most, best = max(queue.state[2], began), queue.state[3] if start != goal else 0.0
    while bucket < len(heads) and base + bucket / LISTS < best:
        if steps == STEPS or count + straight + graph.neighbors.shape[1] > len(cells):
            queue.state[0], queue.state[1], queue.state[2], queue.state[3] = count, bucket, most, best
            return False, np.empty(0, np.int64)
        steps += 1
        entry = heads[bucket]
        if entry < 0:
            bucket += 1
            continue
        heads[bucket] = after[entry]
        cell, by = np.int64(cells[entry]), np.int64(arrivals[entry])
        # A cell that was reached sooner by now drops the moves of later chains.
        late = by != NO_MOVE and not came[cell] & np.uint32(1) << np.uint32(by)
        if late or estimates[entry] > best + LATE:
            continue
        at = _spot(graph, cell)  # type: ignore[arg-type]
        rotation, i, j, k = at
        place = cell - rotation * size
        wide, tries = _open(graph, levels, moves, graph.slice_of[rotation] * size + place, at, least)
        if by != NO_MOVE and by >= straight:
            # What could have been done before the turn was.
            before = graph.slice_of[graph.neighbors[rotation, by - straight]] * size + place
            tries &= ~_open(graph, levels, moves, before, at, least)[1]
        elif by != NO_MOVE and wide == every:
            tries = moves.parts[by]
        for move in range(straight + graph.neighbors.shape[1]):
            turn, u, v, w, back = rotation, i, j, k, move
            if move < straight:
                if not (tries >> move) & 1:
                    continue
                u, v, w = graph.moves[move, 0], graph.moves[move, 1], graph.moves[move, 2]
                u, v, w = _moved(graph, i + u, j + v, k + w)
                other, cost = rotation * size + (u * ny + v) * nz + w, far[cell] + moves.lengths[move]
            else:
                turn = graph.neighbors[rotation, move - straight]
                if turn < 0:
                    continue
                other, cost = turn * size + place, far[cell] + graph.turns[rotation, move - straight]
                if levels[graph.slice_of[turn] * size + place] < least:
                    continue
                back = straight
                while graph.neighbors[turn, back - straight] != rotation:
                    back += 1
            bit = np.uint32(1) << np.uint32(back)
            seen = far[other] >= began and other != start
            if other == start or (
                seen and (cost > far[other] + SAME or (cost >= far[other] - SAME and came[other] & bit))
            ):
                continue
            to_come = _on_empty_grid(graph, u - gi, v - gj, w - gk)
            if len(flat):
                known = flat[other - turn * size] - 1.0
                more = bound - 1.0 - _on_empty_grid(graph, u - si, v - sj, w - sk)
                to_come = max(to_come, more if known < 0.0 else min(known, more))
            estimate = cost - began + to_come + ahead[turn]
            if estimate >= best:
                continue
            if seen and cost >= far[other] - SAME:
                came[other] = came[other] | bit
            else:
                far[other], came[other] = cost, bit
            most = max(most, cost)
            if other == goal:
                best = cost - began - SAME
            number = min(max(int(LISTS * (estimate - base)), bucket), len(heads) - 1)
            cells[count], arrivals[count], estimates[count] = other, back, estimate
            after[count], heads[number] = heads[number], count
            count += 1
    far[-1] = most + 1.0
    return True, _back(graph, moves, start, goal, came) if best < np.inf else np.empty(0, np.int64)


@jit
def _back(graph: Graph, moves: Moves, start: int, goal: int, came: Cells) -> Ints:
    """The cells from one to another, by the moves that each was reached by."""
    _, nx, ny, nz = graph.levels.shape
    straight, cell, length = len(moves.steps), goal, 1
    path = np.empty(256, np.int64)
    path[0] = goal
    while cell != start:
        move, bits = 0, came[cell]
        while not (bits >> np.uint32(move)) & np.uint32(1):
            move += 1
        rotation, i, j, k = _spot(graph, cell)
        if move < straight:
            i, j, k = _moved(graph, i - graph.moves[move, 0], j - graph.moves[move, 1], k - graph.moves[move, 2])
        else:
            rotation = graph.neighbors[rotation, move - straight]
        cell = ((rotation * nx + i) * ny + j) * nz + k
        if length == len(path):
            path = np.concatenate((path, np.empty_like(path)))
        path[length], length = cell, length + 1
    return path[:length][::-1].copy()


@inner
def _on_empty_grid(graph: Graph, i: int, j: int, k: int) -> float:
    """Length of the shortest chain from a cell to one that many cells away, with nothing between."""
    i, j, k = abs(i), abs(j), abs(k)
    i, j, k = min(i, graph.rings[0] - i), min(j, graph.rings[1] - j), min(k, graph.rings[2] - k)
    most, least = max(i, j, k), min(i, j, k)
    middle = i + j + k - most - least
    return most + (math.sqrt(2.0) - 1.0) * middle + (math.sqrt(3.0) - math.sqrt(2.0)) * least


@jit
def _turns_to(graph: Graph, goal: int) -> Floats:
    """The least cost of turns from each rotation cell to one of them."""
    costs = np.full(len(graph.slice_of), np.inf)
    costs[goal], changed = 0.0, True
    while changed:
        changed = False
        for rotation in range(len(costs)):
            for move in range(graph.neighbors.shape[1]):
                other = graph.neighbors[rotation, move]
                if other >= 0 and costs[other] + graph.turns[rotation, move] < costs[rotation]:
                    costs[rotation], changed = costs[other] + graph.turns[rotation, move], True
    return costs


# ---- paths -----------------------------------------------------------------------------------------------------------


def widest_path(
    widest: Widest,
    map_: Map,
    grid: Grid,
    endpoints: Sequence[tuple[Floats, Ints]],
    check: Callable[..., bool],
    straight: bool,
    until: float,
) -> Floats:
    """Waypoints of the widest path between two configurations, each given with its cell, shape (n, dof).

    Of length 0 where there is none, or ``check`` does not prove an edge of it free; TimeoutError from a time on. If not
    ``straight``, they are all the middles of cells that it passes. Along axes that close, rows count whole turns.
    """
    graph, rotations = widest.graph, widest.rotations
    shape = (rotations.count, *grid.shape)
    start, goal = (int(np.ravel_multi_index(tuple(cell), shape)) for _, cell in endpoints)
    tops = [climb(graph, start), climb(graph, goal)]
    level = widest.bottleneck(int(tops[0][-1]), int(tops[1][-1]), until)
    if not level:
        return np.empty((0, len(endpoints[0][0])))
    up, down = ([cell for cell in climbed.tolist() if level_of(graph, cell) < level] for climbed in tops)
    chain = widest.shortest(int(tops[0][len(up)]), int(tops[1][len(down)]), level, until)
    rotation, *place = np.unravel_index(np.concatenate([up, chain, down[::-1]]).astype(np.int64), shape)
    places, endless = np.stack(place, axis=-1), graph.closed[3 - grid.dim :]
    middles = np.column_stack([grid.center_of(places), rotations.centers[rotation]])
    path = rotations.canonical(np.concatenate([endpoints[0][0][None], middles, endpoints[1][0][None]]))
    for axis in np.flatnonzero(endless).tolist():
        unwound, angles = np.unwrap(places[:, axis], period=grid.shape[axis]), path[:, axis]
        angles[1:-1] += TURN * ((unwound - places[:, axis]) / grid.shape[axis])
        angles[[0, -1]] = beside(angles[[0, -1]], angles[[1, -2]])  # on a border, they may be in a cell across the seam
        places[:, axis] = unwound
    if not all(check(*a, *b) for a, b in pairwise(path.tolist())):
        return path[:0]
    if not straight:
        return path
    # Each part keeps to the cells that are as wide as its own narrowest one.
    first, last = len(up) + 1 if up else 0, len(up) + len(chain) if down else len(path) - 1
    parts = (0, first, level_of(graph, start)), (first, last, level), (last, len(path) - 1, level_of(graph, goal))
    pieces = [path[:1]]
    for begin, end, least in parts:
        if begin < end:
            wide = _wide_part(graph, map_, places[max(begin - 1, 0) : end], least)
            shorter = below_half_a_turn(edge_checker(wide, path.shape[1]), endless.tolist())
            shorter = in_time(shorter, until)
            pieces.append(pulled_straight(path[begin : end + 1], grid.dim, shorter, 2.0 * grid.spacing)[1:])
    return np.concatenate(pieces)


def _wide_part(graph: Graph, map_: Map, places: Ints, least: int) -> Map:
    """The map around some places, shape (n, d), in which cells of a level or above are FREE, and no others."""
    shape, endless = map_.states.shape[1:], graph.closed[3 - len(map_.lower) :]
    first = np.where(endless, places.min(axis=0) - 1, np.maximum(places.min(axis=0) - 1, 0))
    stop = np.where(endless, places.max(axis=0) + 2, np.minimum(places.max(axis=0) + 2, shape))
    window = np.where(endless, None, first), np.where(endless, None, stop)
    levels = graph.levels.reshape(map_.states.shape)[:, *map(slice, *window)]
    for axis in np.flatnonzero(endless).tolist():
        levels = levels.take(np.arange(first[axis], stop[axis]), axis=axis + 1, mode="wrap")
    states = read_only((levels < least).view(np.uint8))  # FREE is 0, and MIXED 1
    lower, upper = (tuple((map_.lower + map_.spacing * cell).tolist()) for cell in (first, stop))
    return map_._replace(states=states, cells=states.reshape(-1), lower=lower, upper=upper)

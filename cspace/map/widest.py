"""The widest path between two configurations: the one whose smallest clearance is the largest, and then the shortest.

Each FREE cell has a *level*, the distance from its middle to the nearest cell that is not FREE, in parts of a cell. A
flood from one cell, ever on from the highest level that it has reached (R. Barnes, C. Lehman, D. Mulla,
"Priority-flood", 2014), meets the other at the largest level that the smallest one of a path can have, its
*bottleneck*. Among the cells of that level or above, A* finds the shortest chain.

Where the start or the goal itself is the narrowest place, as beside a wall, all paths are as narrow as that. So both
are left the steepest way up, and the bottleneck is that between the tops; the path is among the widest all the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit, reader
from cspace.grid import Grid
from cspace.map.callbacks import edge_checker
from cspace.map.free_path import pulled_straight
from cspace.map.record import Map
from cspace.map.storage import Stack
from cspace.rotations import Rotations
from cspace.states import FREE, MIXED
from cspace.threads import cores, in_chunks, in_threads

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Levels = NDArray[np.uint16]
Squares = NDArray[np.int32]

LEVELS: Final = 64
"""Levels to a cell."""

TOP: Final = 65535
"""The highest level: 1024 cells of clearance, beyond which more does not count."""

FAR: Final = 2**30
"""Square of a distance, in half cells, that stands for infinity."""

BYTES: Final = 24
"""For each cell, while a path is looked for: its level, what came before it, its distance, and what waits;
measured, 15 to 17 at most at a time, and more where the search goes far."""

METRES_A_RADIAN: Final = 0.5
"""What a turn counts as in the length, as in OMPL's SE(2)."""

UNSEEN, LAST = np.uint32(2**32 - 1), np.uint32(2**32 - 2)
"""What stands in a list in place of the next cell."""

LISTS: Final = 8
"""Lists of what waits for each cell of way: within one of them, order does not count."""

LINES: Final = 64
"""Lines of cells below which a second thread costs more than it saves."""


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
    """

    levels: Levels
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Ints
    faces: int


def graph_of(map_: Map, states: Iterable[Bytes], rotations: Rotations) -> Graph:
    """The cells of a map, by the states of each slice, with their levels."""
    _, *shape = map_.states.shape
    dim, layered, turning = len(shape), (1,) * (3 - len(shape)) + tuple(shape), rotations.centers
    levels = np.empty((map_.states.shape[0], *layered), dtype=np.uint16)
    boxes = map_.exterior[:, :-1]
    empty = (boxes[:, :dim] > boxes[:, dim:]).any(axis=1)
    inside = empty | ((boxes[:, :dim] >= 0) & (boxes[:, dim:] < shape)).all(axis=1)
    walled = (map_.exterior[:, -1] != FREE) | ~inside

    def fill(item: tuple[int, Bytes]) -> None:
        number, state = item
        state, wall = np.ascontiguousarray(state).reshape(layered), bool(walled[number])
        squares, (nx, ny, nz) = np.empty(layered, dtype=np.int32), layered
        in_chunks(partial(begin, state.reshape(-1, nz), squares.reshape(-1, nz), wall), nx * ny, LINES)
        in_chunks(partial(extend, squares, wall), nx * nz, LINES)
        if nx > 1:
            in_chunks(partial(extend, squares.reshape(1, nx, ny * nz), wall), ny * nz, LINES)
        levels[number] = np.minimum(LEVELS / 2 * np.sqrt(squares, dtype=np.float32), TOP)

    in_threads(fill, list(enumerate(states)), cores())
    ways = np.array([-1, 0, 1])
    moves = np.stack(np.meshgrid(ways if dim == 3 else [0], ways, ways, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.abs(moves).sum(axis=1)
    moves = moves[np.argsort(number, kind="stable")][1:]
    middles = np.column_stack([np.zeros((rotations.count, dim)), turning])
    turns = rotations.steps(middles[:, None], middles[rotations.neighbors])
    costs = METRES_A_RADIAN / map_.spacing * np.linalg.norm(turns, axis=-1)
    return Graph(levels, map_.slice_of, rotations.neighbors, costs, moves, int(np.count_nonzero(number == 1)))


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
        for way in range(2):
            last = -1 if walled else -FAR
            for step in range(n):
                k = step if way == 0 else n - 1 - step
                if states[row, k] != FREE:
                    last = step
                apart = np.int64(step - last)
                square = 0 if apart == 0 else min((2 * apart - 1) ** 2, FAR) if apart < 2**14 else FAR
                squares[row, k] = square if way == 0 else min(square, squares[row, k])  # type: ignore[assignment]
    return -1


@jit
def extend(squares: Squares, walled: bool, start: int, stop: int) -> int:
    """Make squares of distances within rows those along one more axis, the middle one, of lines from ``start`` on."""
    n = squares.shape[1]
    values, cells, firsts = np.empty(n + 2, np.int64), np.empty(n + 2, np.int64), np.empty(n + 2, np.int64)
    beyond = 0 if walled else FAR
    for line in range(start, stop):
        a, b = line // squares.shape[2], line % squares.shape[2]
        values[0] = values[n + 1] = beyond
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
def next_cell(graph: Graph, cell: int, way: int, least: int) -> int:
    """The cell to which a move or a turn leads, if all that it touches is of a level or above, else -1."""
    _, nx, ny, nz = graph.levels.shape
    size = nx * ny * nz
    rotation, place = cell // size, cell % size
    if way >= graph.moves.shape[0]:
        other = graph.neighbors[rotation, way - graph.moves.shape[0]]
        if other < 0:
            return -1
        i, j, k = place // (ny * nz), place // nz % ny, place % nz
        return int(other * size + place) if graph.levels[graph.slice_of[other], i, j, k] >= least else -1
    u, v, w = graph.moves[way, 0], graph.moves[way, 1], graph.moves[way, 2]
    i, j, k, part = place // (ny * nz), place // nz % ny, place % nz, graph.slice_of[rotation]
    if not (0 <= i + u < nx and 0 <= j + v < ny and 0 <= k + w < nz):
        return -1
    # A diagonal step touches all cells of the block of two along each axis.
    for a in range(2 if u != 0 else 1):
        for b in range(2 if v != 0 else 1):
            for c in range(2 if w != 0 else 1):
                if graph.levels[part, i + a * u, j + b * v, k + c * w] < least:
                    return -1
    return int(cell + (u * ny + v) * nz + w)


@jit
def level_of(graph: Graph, cell: int) -> int:
    """Level of a cell, by its number."""
    size = graph.levels.shape[1] * graph.levels.shape[2] * graph.levels.shape[3]
    return int(graph.levels.ravel()[graph.slice_of[cell // size] * size + cell % size])


@jit
def climb(graph: Graph, cell: int) -> Ints:
    """Cells from one up to where none beside it is of a higher level, each the highest beside the one before."""
    path, count, ways = np.empty(256, np.int64), 1, graph.moves.shape[0] + graph.neighbors.shape[1]
    path[0] = cell
    while True:
        here = path[count - 1]
        best, highest = here, level_of(graph, here)
        for way in range(ways):
            other = next_cell(graph, here, way, 1)
            if other >= 0 and level_of(graph, other) > highest:
                best, highest = other, level_of(graph, other)
        if best == here:
            return path[:count]
        if count == len(path):
            path = np.concatenate((path, np.empty_like(path)))
        path[count] = best
        count += 1


@jit
def bottleneck(graph: Graph, start: int, goal: int) -> int:
    """The largest level that the lowest cell of a chain from one cell to another can have; 0 where there is none."""
    straight, ways = graph.moves.shape[0], graph.moves.shape[0] + graph.neighbors.shape[1]
    cells = graph.levels.shape[1] * graph.levels.shape[2] * graph.levels.shape[3] * len(graph.slice_of)
    # What waits, in lists by level; each cell once, as it is never reached from a higher level than at first.
    after, heads = np.full(cells, UNSEEN, np.uint32), np.full(TOP + 1, LAST, np.uint32)
    level = level_of(graph, start)
    after[start], heads[level] = LAST, np.uint32(start)
    while level > 0:
        if heads[level] == LAST:
            level -= 1
            continue
        cell: int = np.int64(heads[level])  # type: ignore[assignment]  # one type, for the compiler
        heads[level] = after[cell]
        if cell == goal:
            return level
        for way in range(ways):
            # What a step across a corner joins is joined by steps across sides that touch no other cells.
            if graph.faces <= way < straight:
                continue
            other = next_cell(graph, cell, way, 1)
            if other < 0 or after[other] != UNSEEN:
                continue
            reached = min(level, level_of(graph, other))
            after[other], heads[reached] = heads[reached], np.uint32(other)
    return 0


@jit
def shortest(graph: Graph, start: int, goal: int, least: int) -> Ints:
    """The shortest chain of cells of a level or above from one to another; empty where there is none.

    What waits lies in lists by its cost, of :data:`LISTS` to a cell; a cell that is reached anew, sooner, waits again,
    and the search ends when all that could be cheaper is done. Moves and turns add up, so that the shortest chain on an
    empty grid and the turns to the goal's rotation are a bound of what is still to come.
    """
    _, nx, ny, nz = graph.levels.shape
    size, straight, levels = nx * ny * nz, graph.moves.shape[0], graph.levels.ravel()
    far, came = np.full(size * len(graph.slice_of), np.inf, np.float32), np.empty(size * len(graph.slice_of), np.uint32)
    ahead = _turns_to(graph, goal // size)
    heads = np.full(LISTS * (4 * (nx + ny + nz) + 64), LAST, np.uint32)
    cells, costs, after = np.empty(4096, np.uint32), np.empty(4096, np.float32), np.empty(4096, np.uint32)
    moves, steps, lengths = graph.moves, np.empty(straight, np.int64), np.empty(straight)
    for way in range(straight):
        steps[way] = (moves[way, 0] * ny + moves[way, 1]) * nz + moves[way, 2]
        lengths[way] = math.sqrt(float((moves[way] ** 2).sum()))
    gi, gj, gk = goal % size // (ny * nz), goal % size // nz % ny, goal % size % nz
    i, j, k = start % size // (ny * nz), start % size // nz % ny, start % size % nz
    base = _on_empty_grid(i - gi, j - gj, k - gk) + ahead[start // size]
    cells[0], costs[0], after[0], far[start], heads[0] = start, 0.0, LAST, 0.0, 0
    count, bucket = 1, 0
    while bucket < len(heads):
        entry = np.int64(heads[bucket])
        if entry == LAST:
            bucket += 1
            if far[goal] < base + bucket / LISTS:
                break
            continue
        heads[bucket] = after[entry]
        cell: int = np.int64(cells[entry])  # type: ignore[assignment]  # one type, for the compiler
        if costs[entry] > far[cell]:
            continue
        rotation, place = cell // size, cell % size
        rest, first = place // nz, graph.slice_of[rotation] * size + place
        i, j, k = rest // ny, rest % ny, place % nz
        for way in range(straight + graph.neighbors.shape[1]):
            turn, u, v, w = rotation, 0, 0, 0
            if way < straight:
                u, v, w = moves[way, 0], moves[way, 1], moves[way, 2]
                if not (0 <= i + u < nx and 0 <= j + v < ny and 0 <= k + w < nz):
                    continue
                other, cost = cell + steps[way], np.float32(far[cell] + lengths[way])
                if cost >= far[other]:
                    continue
                wide = levels[first + steps[way]] >= least
                if way >= graph.faces:
                    # It touches all cells of the block of two along each axis.
                    x, y = u * ny * nz, v * nz
                    wide = wide and levels[first + x] >= least and levels[first + y] >= least
                    wide = wide and levels[first + w] >= least and levels[first + x + y] >= least
                    wide = wide and levels[first + x + w] >= least and levels[first + y + w] >= least
            else:
                turn = graph.neighbors[rotation, way - straight]
                if turn < 0:
                    continue
                other = turn * size + place
                cost = np.float32(far[cell] + graph.turns[rotation, way - straight])
                wide = cost < far[other] and levels[graph.slice_of[turn] * size + place] >= least
            if not wide:
                continue
            far[other], came[other] = cost, np.uint32(cell)
            estimate = cost + _on_empty_grid(i + u - gi, j + v - gj, k + w - gk) + ahead[turn] - base
            if count == len(cells):
                cells, costs = (
                    np.concatenate((cells, np.empty_like(cells))),
                    np.concatenate((costs, np.empty_like(costs))),
                )
                after = np.concatenate((after, np.empty_like(after)))
            number = min(max(int(LISTS * estimate), bucket), len(heads) - 1)
            cells[count], costs[count], after[count], heads[number] = other, cost, heads[number], np.uint32(count)
            count += 1
    length, cell = 0, goal
    if far[goal] < np.inf:
        length = 1
        while cell != start:
            cell = np.int64(came[cell])  # type: ignore[assignment]
            length += 1
    path, cell = np.empty(length, np.int64), goal
    for row in range(length - 1, -1, -1):
        path[row] = cell
        if row:
            cell = np.int64(came[cell])  # type: ignore[assignment]
    return path


@inner
def _on_empty_grid(i: int, j: int, k: int) -> float:
    """Length of the shortest chain from a cell to one that many cells away, with nothing between."""
    i, j, k = abs(i), abs(j), abs(k)
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
            for way in range(graph.neighbors.shape[1]):
                other = graph.neighbors[rotation, way]
                if other >= 0 and costs[other] + graph.turns[rotation, way] < costs[rotation]:
                    costs[rotation], changed = costs[other] + graph.turns[rotation, way], True
    return costs


# ---- paths -----------------------------------------------------------------------------------------------------------


def widest_path(
    map_: Map, states: Stack, rotations: Rotations, grid: Grid, ends: Sequence[tuple[Floats, Ints]], straight: bool
) -> Floats:
    """Waypoints of the widest path between two configurations, each given with its cell, shape (n, dof).

    Of length 0 where there is none, or an edge of it is not proven free. If not ``straight``, they are all the middles
    of cells that it passes.
    """
    graph, shape = graph_of(map_, states, rotations), (rotations.count, *grid.shape)
    start, goal = (int(np.ravel_multi_index(tuple(cell), shape)) for _, cell in ends)
    tops = [climb(graph, start), climb(graph, goal)]
    level = bottleneck(graph, int(tops[0][-1]), int(tops[1][-1]))
    if not level:
        return np.empty((0, len(ends[0][0])))
    up, down = ([cell for cell in way.tolist() if level_of(graph, cell) < level] for way in tops)
    chain = shortest(graph, int(tops[0][len(up)]), int(tops[1][len(down)]), level)
    rotation, *place = np.unravel_index(np.concatenate([up, chain, down[::-1]]).astype(np.int64), shape)
    middles = np.column_stack([grid.center_of(np.stack(place, axis=-1)), rotations.centers[rotation]])
    path = rotations.canonical(np.concatenate([ends[0][0][None], middles, ends[1][0][None]]))
    check, rows = edge_checker(map_, path.shape[1]), path.tolist()
    if not all(check(*a, *b) for a, b in pairwise(rows)):
        return path[:0]
    if not straight:
        return path
    # Each part keeps to the cells that are as wide as its own narrowest one.
    first, last = len(up) + 1 if up else 0, len(up) + len(chain) if down else len(path) - 1
    parts = (0, first, level_of(graph, start)), (first, last, level), (last, len(path) - 1, level_of(graph, goal))
    found = [path[:1]]
    for begin, end, least in parts:
        if begin < end:
            wide = np.where(graph.levels >= least, FREE, MIXED).astype(np.uint8).reshape(map_.states.shape)
            check = edge_checker(map_._replace(states=wide, cells=wide.reshape(-1)), path.shape[1])
            found.append(pulled_straight(path[begin : end + 1], grid.dim, check, 2.0 * grid.spacing)[1:])
    return np.concatenate(found)

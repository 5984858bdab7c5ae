"""Searches over cells: FREE chains, and chains that are not BLOCKED with the fewest MIXED cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Bytes, Floats, Ints
from cspace.compiling import clock, jit, kernel
from cspace.map.storage import Cells, Map, Stack, cells_of, check_bytes, state_in

Costs = NDArray[np.float32]
Place = tuple[int, int, int]
Spot = tuple[int, int, int, int]
"""Rotation cell, and place along three axes."""

GREED: Final = 8.0
"""Weight of the way ahead against the way behind where any chain will do: above 1 it is found sooner, and is longer."""

TURN_COST: Final = 4.0
"""Cells of way that a turn into the next rotation cell counts as there: straight on is tried first."""

MARGIN: Final = 16.0
"""Cells by which a chain may be longer than without its turns before it is led less well."""

FAR: Final = 2**30
"""In place of the number of cells around an axis that does not close in a circle."""

STEPS: Final = 2**11
"""Cells that a search takes between two looks at the clock: half a millisecond, or 100 where all memory is new."""

ENTRIES: Final = 4096
"""Entries that there is room for in the beginning."""

SAME: Final = 1e-6
"""Share of a cost that rounding may make of nothing, in single precision."""

FIRST, TAKEN = 127, 128
"""How the start was reached; and the bit of cells that wait no more."""

LISTS: Final = 8
"""Lists of what waits for each cell of way: within one of them, order does not count."""

RING: Final = 4096
"""Lists that there are. What costs more than they hold waits in the last one: then order does not count either."""


class Graph(NamedTuple):
    """The cells of a map, and what leads from one to the next.

    Cells are numbered in a row, rotation cell by rotation cell, along three axes; the plane has one layer along x.

    Attributes
    ----------
    cells : ndarray of uint8, shape (n,), or TwoBits
        States of all slices in a row.
    shape : tuple of int, length 3
        Of a slice.
    slice_of : ndarray of int64, shape (rotations,)
    neighbors : ndarray of int64, shape (rotations, n)
        Of rotation cells; -1 fills up.
    turns : ndarray of float64, shape (rotations, n)
        What it costs to turn to each of them, in cells.
    moves : ndarray of int64, shape (m, 3)
        Steps from cell to cell: across sides, and then across edges and corners; the first ones lead to each cell that
        the last ones touch.
    steps, lengths : ndarray, shape (m,)
        Of moves: by how much the number of the cell changes, and cells of way.
    parts : ndarray of int64, shape (m,)
        For each move, the bits of those that lead to the cells that it touches.
    rings : tuple of int, length 3
        Cells around the axes that close in a circle, so that the last one along them is a neighbour of the first;
        :data:`FAR` of others.
    """

    cells: Cells
    shape: Place
    slice_of: Ints
    neighbors: Ints
    turns: Floats
    moves: Ints
    steps: Ints
    lengths: Floats
    parts: Ints
    rings: Place

    @classmethod
    def of(cls, states: Stack, slice_of: Ints, neighbors: Ints, turns: Floats, periodic_axes: Sequence[bool]) -> Graph:
        """From states by slice, shape (slices, *cells); some axes of the grid close in a circle."""
        dim = states.ndim - 1
        nx, ny, nz = (1,) * (3 - dim) + tuple(states.shape[1:])
        around = [(-1, 0, 1)] * dim
        moves = np.stack(np.meshgrid(*[[0]] * (3 - dim), *around, indexing="ij"), axis=-1).reshape(-1, 3)
        moves = moves[np.argsort(np.abs(moves).sum(axis=1), kind="stable")][1:]
        touched = ((moves == 0) | (moves == moves[:, None])).all(axis=2)
        parts, steps = (touched << np.arange(len(moves))).sum(axis=1), (moves * (ny * nz, nz, 1)).sum(axis=1)
        closed = (False,) * (3 - dim) + tuple(periodic_axes)
        rings = nx if closed[0] else FAR, ny if closed[1] else FAR, nz if closed[2] else FAR
        lengths = np.linalg.norm(moves, axis=1)
        return cls(cells_of(states), (nx, ny, nz), slice_of, neighbors, turns, moves, steps, lengths, parts, rings)

    def chain(self, start: Ints, goal: Ints, until: float, *, greed: float = 1.0, places: Graph | None = None) -> Ints:
        """The shortest chain of FREE cells ``(rotation, x, y)`` or ``(rotation, x, y, z)`` from one to another.

        Shape (n, 1 + d), where n is 0 if there is none. With more ``greed``, it is one that is found sooner. The search
        is led by the lengths of the shortest chains over ``places``, those of the map that are FREE at any rotation.
        TimeoutError is raised from a time on, in seconds of :data:`cspace.compiling.clock`.
        """
        shape, size, bound = (len(self.slice_of), *self.shape[4 - len(start) :]), math.prod(self.shape), 0.0
        first, last = (int(np.ravel_multi_index(tuple(cell), shape)) for cell in (start, goal))
        flat = np.empty(0, dtype=np.float32)
        if first == last:
            return start[None]
        if places is not None:
            task = Task(last % size, first % size, 1.0, MARGIN, flat, bound, np.zeros(1))
            flat = places._searched(task, until).far
            bound = float(flat[first % size]) + MARGIN
        trace = self._searched(Task(first, last, greed, 0.0, flat, bound, self._turns_to(goal[0])), until)
        numbers = np.empty(back(self, trace.came, first, last, np.empty(0, dtype=np.int64)), dtype=np.int64)
        back(self, trace.came, first, last, numbers)
        return np.stack(np.unravel_index(numbers, shape), axis=-1)

    def _searched(self, task: Task, until: float) -> Trace:
        trace = Trace.of(len(self.slice_of) * math.prod(self.shape), task.start, task.greed > 1.0)
        while not best_first(self, task, trace):
            keep_on(until)
            if trace.state[3] + len(self.moves) + self.neighbors.shape[1] >= len(trace.after):
                waiting, after, costs = (np.concatenate([each, each]) for each in trace[3:6])
                trace = trace._replace(waiting=waiting, after=after, costs=costs)
        return trace

    def _turns_to(self, goal: int) -> Floats:
        """The least cost of turns from each rotation cell to one of them."""
        costs, before = np.full(len(self.slice_of), np.inf), np.empty(0)
        costs[goal] = 0.0
        while self.neighbors.size and not np.array_equal(costs, before):
            before = costs
            beside = np.where(self.neighbors < 0, np.inf, costs[self.neighbors] + self.turns)
            costs = np.minimum(costs, beside.min(axis=1))
        return costs


class Task(NamedTuple):
    """What is searched.

    Attributes
    ----------
    start, goal : int
        Cells.
    greed : float
        Weight of the way ahead against the way behind.
    margin : float
        Cells by which chains may be longer than the shortest to the goal for their cells to be looked at.
    flat : ndarray of float32
        Length of the shortest chain from the place of each cell to the goal's, at any rotation, and zero where it was
        not looked at; none where that is not known.
    bound : float
        Length that chains over such places have at least.
    ahead : ndarray of float64, shape (rotations,)
        The least cost of turns from each rotation cell to the goal's.
    """

    start: int
    goal: int
    greed: float
    margin: float
    flat: Costs
    bound: float
    ahead: Floats


class Trace(NamedTuple):
    """How far a search has come.

    Attributes
    ----------
    far : ndarray of float32, shape (cells,)
        The least cost of a chain to each cell; none with greed. Memory is taken where this, and the next one, are
        written.
    came : ndarray of uint8, shape (cells,)
        Zero of a cell that was not reached, else 1 and the move that led there, or the turn that leads back, with
        :data:`TAKEN` once the search went on from there.
    heads : ndarray of int64, shape (RING,)
        What waits, in lists by its cost: the first entry of each; -1 for none.
    waiting, after, costs : ndarray of int64, int64 and float64, shape (n,)
        Entries: a cell, the next entry of its list, or of those that are free, and the cost that it had.
    state : ndarray of float64, shape (5,)
        How many wait, the lowest list of them, the first entry that is free, how many were used, and the cost of the
        goal.
    """

    far: Costs
    came: Bytes
    heads: Ints
    waiting: Ints
    after: Ints
    costs: Floats
    state: Floats

    @classmethod
    def of(cls, cells: int, start: int, greedy: bool) -> Trace:
        """Of a start, among so many cells."""
        far, came = np.zeros(0 if greedy else cells, dtype=np.float32), np.zeros(cells, dtype=np.uint8)
        heads, waiting, after = np.full(RING, -1), np.full(ENTRIES, start), np.full(ENTRIES, -1)
        came[start], heads[0] = FIRST, 0
        return cls(far, came, heads, waiting, after, np.zeros(ENTRIES), np.array([1.0, 0.0, -1.0, 1.0, np.inf]))


def keep_on(until: float) -> None:
    """Raise TimeoutError from a time on, in seconds of :data:`cspace.compiling.clock`."""
    if clock() > until:
        raise TimeoutError


@kernel
def _spot(graph: Graph, cell: int) -> Spot:
    nx, ny, nz = graph.shape
    # A division takes as long as all else; in the plane, and of one rotation, one is enough.
    rotation = cell // (nx * ny * nz) if cell >= nx * ny * nz else 0
    cell -= rotation * nx * ny * nz
    i = cell // (ny * nz) if cell >= ny * nz else 0
    cell -= i * ny * nz
    return rotation, i, cell // nz, cell % nz


@kernel
def _moved(graph: Graph, at: Spot, move: int, sign: int) -> Place:
    """Where a move leads, or leads from: in again along axes that close; -1 along others where there is no cell."""
    (nx, ny, nz), moves = graph.shape, graph.moves
    i, j, k = at[1] + sign * moves[move, 0], at[2] + sign * moves[move, 1], at[3] + sign * moves[move, 2]
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return i, j, k
    return _around(i, nx, graph.rings[0]), _around(j, ny, graph.rings[1]), _around(k, nz, graph.rings[2])


@kernel
def _around(i: int, count: int, ring: int) -> int:
    return i % count if ring == count else i if i < count else -1


@kernel
def _open(graph: Graph, first: int, at: Spot) -> int:
    """The moves from a place of a slice, which begins with a cell, that touch FREE cells alone, by bits."""
    (nx, ny, nz), (_, i, j, k), place = graph.shape, at, (at[1] * graph.shape[1] + at[2]) * graph.shape[2] + at[3]
    free, allowed, deep = 0, 0, 1 if len(graph.moves) > 8 else 0
    if deep <= i < nx - deep and 0 < j < ny - 1 and 0 < k < nz - 1:
        for move in range(len(graph.moves)):
            free |= (state_in(graph.cells, first + place + graph.steps[move]) == FREE) << move
    else:
        for move in range(len(graph.moves)):
            u, v, w = _moved(graph, at, move, 1)
            if min(u, v, w) >= 0:
                free |= (state_in(graph.cells, first + (u * ny + v) * nz + w) == FREE) << move
    if free == (1 << len(graph.moves)) - 1:
        return free
    for move in range(len(graph.moves)):
        allowed |= ((free & graph.parts[move]) == graph.parts[move]) << move
    return allowed


@kernel
def _on_empty_grid(graph: Graph, one: Place, other: Place) -> float:
    """Length of the shortest chain of moves with nothing between."""
    i, j, k = abs(one[0] - other[0]), abs(one[1] - other[1]), abs(one[2] - other[2])
    i, j, k = min(i, graph.rings[0] - i), min(j, graph.rings[1] - j), min(k, graph.rings[2] - k)
    most, least = max(i, j, k), min(i, j, k)
    middle = i + j + k - most - least
    return most + (math.sqrt(2.0) - 1.0) * middle + (math.sqrt(3.0) - math.sqrt(2.0)) * least


@kernel
def _to_come(graph: Graph, task: Task, start: Place, goal: Place, rotation: int, at: Place) -> float:
    """The least that the way from a cell to the goal can cost."""
    ahead = _on_empty_grid(graph, at, goal)
    if len(task.flat):
        known = task.flat[(at[0] * graph.shape[1] + at[1]) * graph.shape[2] + at[2]]
        more = task.bound - _on_empty_grid(graph, at, start)
        ahead = max(ahead, min(known, more) if known > 0.0 or at == goal else more)
    return ahead + float(task.ahead[rotation])


@kernel
def best_first(graph: Graph, task: Task, trace: Trace) -> bool:
    """Whether a search is through; else it goes on from there: it also ends where there is no room, and now and then.

    The way ahead is not taken for longer than it is (P. Hart, N. Nilsson and B. Raphael, "A formal basis for the
    heuristic determination of minimum cost paths", 1968), but for greed; then each cell is reached but once.
    """
    size, straight = graph.shape[0] * graph.shape[1] * graph.shape[2], len(graph.moves)
    far, came, heads, waiting, after, costs, state = trace
    count, lowest, spare, used, best = int(state[0]), int(state[1]), int(state[2]), int(state[3]), state[4]
    degree, greedy = straight + graph.neighbors.shape[1], task.greed > 1.0
    _, si, sj, sk = _spot(graph, task.start % size)
    _, gi, gj, gk = _spot(graph, task.goal % size)
    for _ in range(STEPS):
        # What waits is kept in lists by cost, in a circle, instead of in a heap: the next one is found without
        # comparing any (R. Dial, "Algorithm 360: Shortest-path forest with topological ordering", 1969).
        while count > 0 and heads[lowest % RING] < 0:
            lowest += 1
        if count == 0 or lowest >= LISTS * (best + task.margin):
            return True
        if used + degree >= len(after):
            break
        # The entry is spare from here on, for what comes to wait next: memory grows with the front alone.
        entry = heads[lowest % RING]
        cell, heads[lowest % RING], after[entry] = waiting[entry], after[entry], spare
        count, spare = count - 1, entry
        # An entry stays where it is when a shorter way to its cell is found, which waits beside it, and is taken first.
        if came[cell] & TAKEN:
            continue
        came[cell] |= TAKEN
        at, way = _spot(graph, cell), costs[entry] if greedy else float(far[cell])
        rotation, i, j, k = at
        allowed = _open(graph, graph.slice_of[rotation] * size, at)
        for move in range(degree):
            turn, u, v, w, arrival = rotation, i, j, k, move
            if move < straight:
                if not (allowed >> move) & 1:
                    continue
                u, v, w = _moved(graph, at, move, 1)
                cost = way + graph.lengths[move]
            else:
                turn, arrival = graph.neighbors[rotation, move - straight], straight
                if turn < 0:
                    continue
                cost = way + graph.turns[rotation, move - straight]
            place = (u * graph.shape[1] + v) * graph.shape[2] + w
            other = turn * size + place
            if came[other] and (greedy or cost >= far[other] * (1.0 - SAME)):
                continue
            if move >= straight:
                if state_in(graph.cells, graph.slice_of[turn] * size + place) != FREE:
                    continue
                # As the place in which the other rotation cell has this one, for the way back.
                while graph.neighbors[turn, arrival - straight] != rotation:
                    arrival += 1
            ahead = _to_come(graph, task, (si, sj, sk), (gi, gj, gk), turn, (u, v, w))
            if cost + ahead >= best + task.margin:
                continue
            came[other] = arrival + 1
            if not greedy:
                far[other] = cost
            if other == task.goal:
                best = cost
                if greedy:
                    return True
            if spare >= 0:
                entry, spare = spare, after[spare]
            else:
                entry, used = used, used + 1
            # Costs only rise, but for greed; where they fall, lists are mixed up at worst.
            number = min(int(LISTS * (cost + task.greed * ahead)), lowest + RING - 1)
            waiting[entry], costs[entry], after[entry], heads[number % RING] = other, cost, heads[number % RING], entry
            count, lowest = count + 1, min(lowest, number)
    state[0], state[1], state[2], state[3], state[4] = count, lowest, spare, used, best
    return False


@kernel
def back(graph: Graph, came: Bytes, start: int, goal: int, cells: Ints) -> int:
    """How many cells lead from one to another, by the moves that each was reached by; written where there is room."""
    cell, count, straight = goal, 0, len(graph.moves)
    while came[cell]:
        count += 1
        if count <= len(cells):
            cells[len(cells) - count] = cell
        if cell == start:
            break
        at, move = _spot(graph, cell), int(came[cell] & (TAKEN - 1)) - 1
        rotation, i, j, k = at
        if move < straight:
            i, j, k = _moved(graph, at, move, -1)
        else:
            rotation = graph.neighbors[rotation, move - straight]
        cell = ((rotation * graph.shape[0] + i) * graph.shape[1] + j) * graph.shape[2] + k
    return count


START, CLOSED = 254, 255
"""How a cell was reached: not at all, if 0; by the steps from 1 to 6, down and up along x, y and z; from 7 on, out of
the rotation cell that its own has for a neighbour in that place; or these."""

TURNS = 7


@jit
def trace_chain(cells: Cells, slice_of: Ints, neighbors: Ints, start: Ints, goal: Ints, came: Bytes) -> bool:
    """Search a chain of cells ``(rotation, x, y, z)`` from start to goal, none BLOCKED, with the fewest MIXED ones.

    Breadth first, all FREE cells that can be reached before the next MIXED ones; only the front is held. ``came`` is 0,
    or CLOSED where a cell is left out, and is given the step by which each cell was reached. In the plane x has a
    single cell.
    """
    _, nx, ny, nz = came.shape
    size, most = nx * ny * nz, neighbors.shape[1]
    reached = came.reshape(-1)
    origin = ((start[0] * nx + start[1]) * ny + start[2]) * nz + start[3]
    if state_in(cells, slice_of[start[0]] * size + origin % size) == BLOCKED:
        return False
    target = ((goal[0] * nx + goal[1]) * ny + goal[2]) * nz + goal[3]
    # Breadth first where a step costs 0 or 1: a MIXED cell costs one more than all that FREE cells still lead to. So it
    # waits in ``later``, which becomes the front when nothing else is left. As the cost of a step is that of the cell
    # that it enters, the first way into a cell is a cheapest one.
    front, ahead, later = [origin], [origin], [origin]
    ahead.clear()
    later.clear()
    reached[origin] = START
    strides = (ny * nz, nz, 1)
    while len(front) > 0:
        for cell in front:
            if cell == target:
                return True
            r, place = cell // size, cell % size
            at = (place // (ny * nz), place // nz % ny, place % nz)
            for step in range(1, TURNS + most):
                a, near = r, place
                if step < TURNS:
                    axis, up = (step - 1) // 2, (step - 1) % 2
                    if at[axis] == (came.shape[1 + axis] - 1 if up else 0):
                        continue
                    near += strides[axis] if up else -strides[axis]
                else:
                    a = neighbors[r, step - TURNS]
                    if a < 0:
                        continue
                there = a * size + near
                if reached[there] != 0:
                    continue
                state = state_in(cells, slice_of[a] * size + near)
                if state != FREE and state != MIXED:
                    continue
                reached[there] = step
                if step >= TURNS:
                    # As the place in which the other rotation cell has this one, for the way back.
                    for back in range(most):
                        if neighbors[a, back] == r:
                            reached[there] = TURNS + back
                if state == FREE:
                    ahead.append(there)
                else:
                    later.append(there)
        front, ahead = ahead, front
        ahead.clear()
        if len(front) == 0:
            front, later = later, front
    return False


def open_chain(map_: Map, neighbors: Ints, start: Ints, goal: Ints, closed: Bools | None = None) -> Ints:
    """A chain of FREE and MIXED cells, each sharing a side with the next, with as few MIXED ones as can be.

    If a map proves neither that a path exists nor that none does, a path has to be looked for along this chain, with
    ``exact=True``.
    Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid, and the chain has the shape (n, 1 + d), from
    start to goal; n is 0 where there is none. ``neighbors``, shape (rotations, n), are the rotation cells that each one
    shares a border with; -1 fills up. Cells that are ``closed``, shape (rotations, *cells), are left out.
    """
    shape, slice_of = map_.states.shape[1:], map_.slice_of
    flat = (1,) * (3 - len(shape))  # the plane is space with one layer
    check_bytes(len(slice_of) * math.prod(shape))
    came = np.zeros((len(slice_of), *flat, *shape), dtype=np.uint8)
    if closed is not None:
        came[closed.reshape(came.shape)] = CLOSED
    first, last = (np.array([cell[0], *[0] * len(flat), *cell[1:]], dtype=np.int64) for cell in (start, goal))
    if not trace_chain(map_.cells, slice_of, neighbors, first, last, came):
        return np.empty((0, 1 + len(shape)), dtype=np.int64)
    cell, cells = last.tolist(), [last.tolist()]
    while (step := int(came[tuple(cell)])) != START:
        if step < TURNS:
            cell[1 + (step - 1) // 2] -= 2 * ((step - 1) % 2) - 1
        else:
            cell[0] = int(neighbors[cell[0], step - TURNS])
        cells.append(cell.copy())
    rows = np.array(cells[::-1], dtype=np.int64)
    return np.delete(rows, 1, axis=1) if flat else rows

"""Sampling of FREE cells, and the nearest one."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Bytes, Floats, Ints
from cspace.compiling import kernel
from cspace.grid import Grid
from cspace.map.storage import Cells, PackedStates, Stack, popcount, row_in
from cspace.rotations import Rotations
from cspace.rotations.records import jit

Chunks = NDArray[np.int32]

BORDER_MARGIN: Final = 2.0**-20
"""Share of a cell, along its border, without samples, so that rounding never moves one into the next cell."""

CELLS_PER_CHUNK: Final = 8
"""Cells of a chunk; chunks with a FREE cell are drawn from."""

EXTRA_DRAWS: Final = 4
"""Draws in addition to those needed if all cells are FREE."""

MAX_DRAW_ROUNDS: Final = 2**12
"""Maximum rounds of draws; cells still missing are 0. All rounds fail only if another thread removes the last FREE cell
meanwhile."""

_ONE, _ONES, _TOPS = np.uint64(1), np.uint64(0x0101010101010101), np.uint64(0x8080808080808080)

# ---- drawing ---------------------------------------------------------------------------------------------------------


@kernel
def find_chunks(states: Bytes, each: bool, chunks: Chunks, stops: Ints) -> None:
    """List chunks with FREE cells, or with ``each`` the cells.

    ``states`` has shape (slices, cells). ``stops`` receives the end of each slice's list.
    """
    count = 0
    for s in range(len(states)):
        cells = states[s]
        words = cells[: len(cells) // CELLS_PER_CHUNK * CELLS_PER_CHUNK].view(np.uint64)
        for chunk in range((len(cells) + CELLS_PER_CHUNK - 1) // CELLS_PER_CHUNK):
            if chunk < len(words):
                word = words[chunk]
                if ((word - _ONES) & ~word & _TOPS) == 0:  # no byte is 0, which is FREE
                    continue
            for cell in range(chunk * CELLS_PER_CHUNK, min((chunk + 1) * CELLS_PER_CHUNK, len(cells))):
                if cells[cell] == FREE:
                    chunks[count] = cell if each else chunk
                    count += 1
                    if not each:
                        break
        stops[s] = count


@kernel
def draw_cells(states: Bytes, each: bool, chunks: Chunks, stops: Ints, slices: Ints, draws: Floats, drawn: Ints) -> int:
    """Draw FREE cells; return the number drawn so far.

    ``draws`` are random numbers in [0, 1); each gives one cell of the chunks of a slice, and cells that are not FREE
    are skipped. ``drawn[0]`` is the number of cells drawn.
    """
    done, size = drawn[0], states.shape[1]
    for draw in draws:
        if done + 1 == len(drawn):
            break
        s = slices[done]
        first = stops[s - 1] if s > 0 else 0
        position = draw * (stops[s] - first)
        chunk = int(position)
        cell = np.int64(chunks[first + chunk])
        if not each:
            cell = CELLS_PER_CHUNK * cell + int((position - chunk) * CELLS_PER_CHUNK)
        if cell < size and states[s, cell] == FREE:
            done += 1
            drawn[done] = cell
    drawn[0] = done
    return int(done)


@kernel
def find_ranks(cells: Cells, size: int, slices: Ints, ranks: Ints, drawn: Ints) -> None:
    """Find FREE cells by rank in their slice, or 0."""
    for n in range(len(slices)):
        left, begin = ranks[n], slices[n] * size
        for first in range(0, size, 64):
            free = ~row_in(cells, begin + first, min(64, size - first))[0]
            count = popcount(free)
            if left < count:
                for _ in range(left):
                    free &= free - _ONE
                drawn[n] = first + popcount((free & (~free + _ONE)) - _ONE)
                break
            left -= count


class FreeCells:
    """FREE cells of each slice, for sampling.

    If few cells are FREE, their indices are stored. Otherwise cells are drawn from all chunks with a FREE cell until
    one is FREE, which takes half of the map's memory, and rarely more than two draws. For packed states nothing is
    stored; the FREE cells of the slice are counted up to the one drawn.

    Attributes
    ----------
    counts : ndarray of int64, shape (slices,)
        Number of FREE cells of each slice.
    """

    def __init__(self, states: Stack) -> None:
        self._packed = states if isinstance(states, PackedStates) else None
        if self._packed is not None:
            self.counts = self._packed.counts()[:, FREE]
            return
        self._states = np.asarray(states).reshape(len(states), -1)
        slices, cells = self._states.shape
        self.counts = np.array([cells - np.count_nonzero(part) for part in self._states], dtype=np.int64)
        free = int(self.counts.sum())
        self._each = free * CELLS_PER_CHUNK <= self._states.size
        chunks = np.empty(free if self._each else slices * -(-cells // CELLS_PER_CHUNK), dtype=np.int32)
        self._stops = np.empty(slices, dtype=np.int64)
        find_chunks(self._states, self._each, chunks, self._stops)
        self._chunks = chunks[: self._stops[-1]].copy()

    def draw(self, slices: Ints, rng: np.random.Generator) -> Ints:
        """Return flat indices of uniformly drawn FREE cells.

        Each slice must have a FREE cell.
        """
        if self._packed is not None:
            cells, ranks = np.zeros(len(slices), dtype=np.int64), rng.integers(0, self.counts[slices])
            find_ranks(self._packed.cells, self._packed.size // len(self._packed), slices, ranks, cells)
            return cells
        drawn, done = np.zeros(len(slices) + 1, dtype=np.int64), 0
        for _ in range(MAX_DRAW_ROUNDS):
            draws = rng.random(len(slices) - done + EXTRA_DRAWS)
            done = draw_cells(self._states, self._each, self._chunks, self._stops, slices, draws, drawn)
            if done == len(slices):
                break
        return drawn[1:]


def sample(
    free: FreeCells, slice_of: Ints, rotations: Rotations, grid: Grid, n: int, rng: np.random.Generator
) -> Floats:
    """Return uniform configurations from all FREE cells.

    There must be at least one FREE cell.
    """
    rotation_cells = rotations._draw_cells(free.counts[slice_of], n, rng)
    cells, positions = free.draw(slice_of[rotation_cells], rng), np.empty((n, grid.dim))
    for axis in range(grid.dim - 1, 0, -1):  # faster than numpy.unravel_index
        rows = cells // grid.shape[axis]
        positions[:, axis], cells = cells - rows * grid.shape[axis], rows
    positions[:, 0] = cells
    positions += rng.uniform(BORDER_MARGIN, 1.0 - BORDER_MARGIN, size=positions.shape)
    positions *= grid.spacing
    positions += grid.lower
    return np.concatenate([positions, rotations._sample(rotation_cells, BORDER_MARGIN, rng)], axis=1)


# ---- the nearest one -------------------------------------------------------------------------------------------------


@jit
def nearest_cell(cells: Bytes, position: Floats, low: Ints, high: Ints) -> Ints:
    """Return the nearest FREE cell of a slice, or none.

    ``cells`` has shape (nx, ny, nz); the distance is to the center, in cells. Rows along the last axis are visited in
    order of their distance along the first two, while within reach of the best cell so far, and each row from the
    nearest cell outwards. Distant cells are not read. ``low`` and ``high``, shape (2,), are scratch.

    Costs are squared distances less a common term, and scaled, because distances from far positions would overflow.
    """
    sizes = cells.shape
    scale = 1.0
    for axis in range(3):
        scale = max(scale, abs(position[axis] - sizes[axis] / 2.0))
    cell = np.empty(0, np.int64)
    best = math.inf
    i, j, k = (
        nearest_index(position[0], sizes[0]),
        nearest_index(position[1], sizes[1]),
        nearest_index(position[2], sizes[2]),
    )
    least_y, least_z = axis_cost(j, position[1], sizes[1], scale), axis_cost(k, position[2], sizes[2], scale)
    low[0], high[0] = i, i + 1
    while True:
        x, x_cost = next_layer(low, high, 0, position[0], sizes[0], scale)
        if x < 0 or not x_cost + least_y + least_z < best:
            return cell
        low[1], high[1] = j, j + 1
        while True:
            y, y_cost = next_layer(low, high, 1, position[1], sizes[1], scale)
            if y < 0 or not x_cost + y_cost + least_z < best:
                break
            row = cells[x, y]
            for side in range(2):
                z = k if side == 0 else k - 1
                while 0 <= z < sizes[2]:
                    if row[z] == FREE:
                        total = x_cost + y_cost + axis_cost(z, position[2], sizes[2], scale)
                        if total < best:
                            best, cell = total, np.array([x, y, z])
                        break
                    # Leave the row where it gets farther than the best cell.
                    if best < math.inf and not x_cost + y_cost + axis_cost(z, position[2], sizes[2], scale) < best:
                        break
                    z += 1 if side == 0 else -1


@kernel
def nearest_index(value: float, count: int) -> int:
    """Return the cell whose center is nearest to a value."""
    return int(min(max(math.floor(min(max(value, 0.0), float(count))), 0), count - 1))


@kernel
def axis_cost(cell: int, value: float, count: int, scale: float) -> float:
    """Return an axis's part of a squared distance.

    The distance is that from a value to a cell's center. It is divided by ``scale``, and lacks the square of the value,
    which all cells share: if ``o`` is the cell's offset from the middle of the axis and ``v`` the value's, it is ``(o²
    - 2 o v) / scale``.
    """
    center = count / 2.0
    offset = cell + 0.5 - center
    return offset * offset / scale - 2.0 * offset * ((value - center) / scale)


@kernel
def next_layer(low: Ints, high: Ints, axis: int, value: float, count: int, scale: float) -> tuple[int, float]:
    """Return the next cell by cost, and its cost.

    At the end the cell is -1. Cells from ``low + 1`` to before ``high`` are done.
    """
    below = axis_cost(low[axis], value, count, scale) if low[axis] >= 0 else math.inf
    above = axis_cost(high[axis], value, count, scale) if high[axis] < count else math.inf
    if below == math.inf and above == math.inf:
        return -1, math.inf
    if below <= above:
        low[axis] -= 1
        return low[axis] + 1, below
    high[axis] += 1
    return high[axis] - 1, above


def nearest(states: Stack, slice_of: Ints, rotations: Rotations, grid: Grid, q: Floats) -> Floats | None:
    """Return the nearest FREE cell's center, or None.

    A radian counts as half a metre. Distant cells are not read.
    """
    dim = grid.dim
    position = np.full(3, 0.5)
    position[3 - dim :] = (q[:dim] - grid.lower) / grid.spacing
    angular = rotations._angles_to_centers(q) / 2.0
    best, min_distance = None, math.inf
    seen: set[int] = set()
    for r in np.argsort(angular, kind="stable").tolist():
        s = int(slice_of[r])
        if angular[r] >= min_distance:
            break
        if s in seen:  # the nearest rotation cell of this slice was tested
            continue
        seen.add(s)
        cell = nearest_cell(
            states[s].reshape(*(1,) * (3 - dim), *grid.shape), position, np.empty(2, np.int64), np.empty(2, np.int64)
        )
        if len(cell):
            center = grid.center_of(cell[3 - dim :])
            distance = math.hypot(*(center - q[:dim])) + angular[r]
            if distance < min_distance:
                best, min_distance = np.array([*center, *rotations.centers[r]]), distance
    return best

"""The set of FREE cells: drawing from it, and the member nearest to a place."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Bytes, Floats, Ints
from cspace.compiling import jit, kernel
from cspace.grid import Grid
from cspace.map.storage import Cells, PackedStates, Stack, popcount, row_in
from cspace.rotations import Rotations

Chunks = NDArray[np.int32]

EDGE: Final = 2.0**-20
"""Part of a cell, along its border, that samples keep off, so that rounding never puts one into the next cell."""

CHUNK: Final = 8
"""Cells that are drawn from where one of them is FREE."""

SPARE: Final = 4
"""Draws more than are needed where all are FREE."""

TRIES: Final = 2**12
"""Rounds of draws; cells that are missing after them are 0. While no other thread changes the map and takes the last
FREE cell away, as many never fail."""

_ONE, _ONES, _TOPS = np.uint64(1), np.uint64(0x0101010101010101), np.uint64(0x8080808080808080)

# ---- drawing ---------------------------------------------------------------------------------------------------------


@kernel
def find_chunks(states: Bytes, each: bool, chunks: Chunks, stops: Ints) -> None:
    """Numbers of the chunks of slices, shape (slices, cells), that have a FREE cell; with ``each``, of the FREE cells.

    ``stops`` gets where those of each slice end.
    """
    count = 0
    for s in range(len(states)):
        cells = states[s]
        eights = cells[: len(cells) // CHUNK * CHUNK].view(np.uint64)
        for chunk in range((len(cells) + CHUNK - 1) // CHUNK):
            if chunk < len(eights):
                eight = eights[chunk]
                if ((eight - _ONES) & ~eight & _TOPS) == 0:  # no byte is 0, which is FREE
                    continue
            for cell in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(cells))):
                if cells[cell] == FREE:
                    chunks[count] = cell if each else chunk
                    count += 1
                    if not each:
                        break
        stops[s] = count


@kernel
def pick(states: Bytes, each: bool, chunks: Chunks, stops: Ints, slices: Ints, draws: Floats, drawn: Ints) -> int:
    """Go on with drawing FREE cells, ``drawn[0]`` of which are there, by numbers from 0 to 1; how many there are now.

    Each number gives one cell of the chunks of a slice; what is not FREE is passed over.
    """
    done, size = drawn[0], states.shape[1]
    for draw in draws:
        if done + 1 == len(drawn):
            break
        s = slices[done]
        first = stops[s - 1] if s > 0 else 0
        place = draw * (stops[s] - first)
        chunk = int(place)
        cell = np.int64(chunks[first + chunk])
        if not each:
            cell = CHUNK * cell + int((place - chunk) * CHUNK)
        if cell < size and states[s, cell] == FREE:
            done += 1
            drawn[done] = cell
    drawn[0] = done
    return int(done)


@kernel
def find_ranks(cells: Cells, size: int, slices: Ints, ranks: Ints, drawn: Ints) -> None:
    """The FREE cells of slices of a size that have so many FREE ones before them; 0 where there is none left."""
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
    """The FREE cells of each slice, to be drawn from.

    Where few are FREE, their numbers are stored. Otherwise a cell is drawn from all cells of the chunks of CHUNK that
    have a FREE one, until it is FREE itself: that takes half of the map's memory, and rarely more than two draws. Of
    states in two bits nothing is stored, and the FREE cells of the slice are counted up to the one that is drawn.

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
        self._each = free * CHUNK <= self._states.size
        chunks = np.empty(free if self._each else slices * -(-cells // CHUNK), dtype=np.int32)
        self._stops = np.empty(slices, dtype=np.int64)
        find_chunks(self._states, self._each, chunks, self._stops)
        self._chunks = chunks[: self._stops[-1]].copy()

    def draw(self, slices: Ints, rng: np.random.Generator) -> Ints:
        """Flat indices of cells drawn uniformly from the FREE ones of slices, each of which must have one."""
        if self._packed is not None:
            cells, ranks = np.zeros(len(slices), dtype=np.int64), rng.integers(0, self.counts[slices])
            find_ranks(self._packed.cells, self._packed.size // len(self._packed), slices, ranks, cells)
            return cells
        drawn, done = np.zeros(len(slices) + 1, dtype=np.int64), 0
        for _ in range(TRIES):
            draws = rng.random(len(slices) - done + SPARE)
            done = pick(self._states, self._each, self._chunks, self._stops, slices, draws, drawn)
            if done == len(slices):
                break
        return drawn[1:]


def sample(
    free: FreeCells, slice_of: Ints, rotations: Rotations, grid: Grid, n: int, rng: np.random.Generator
) -> Floats:
    """Configurations uniform over the volume of the FREE cells of all rotations, of which there must be one."""
    turns = rotations.draw_cells(free.counts[slice_of], n, rng)
    cells, place = free.draw(slice_of[turns], rng), np.empty((n, grid.dim))
    for axis in range(grid.dim - 1, 0, -1):  # sooner than numpy.unravel_index
        rows = cells // grid.shape[axis]
        place[:, axis], cells = cells - rows * grid.shape[axis], rows
    place[:, 0] = cells
    place += rng.uniform(EDGE, 1.0 - EDGE, size=place.shape)
    place *= grid.spacing
    place += grid.lower
    return np.concatenate([place, rotations.sample(turns, EDGE, rng)], axis=1)


# ---- the nearest one -------------------------------------------------------------------------------------------------


@jit
def nearest_cell(cells: Bytes, place: Floats, low: Ints, high: Ints) -> Ints:
    """The FREE cell of a slice, shape (nx, ny, nz), whose middle is nearest to a place, in cells; of length 0 if none.

    Rows along the last axis are looked at by their distance along the first two, those within reach of the best cell so
    far, and each row from the nearest cell outwards. What is far from the place is not read. ``low`` and ``high`` are
    for its own use, shape (2,).

    Costs are squared distances less what they share, scaled: those of places very far off would overflow.
    """
    sizes = cells.shape
    scale = 1.0
    for axis in range(3):
        scale = max(scale, abs(place[axis] - sizes[axis] / 2.0))
    cell = np.empty(0, np.int64)
    best = math.inf
    i, j, k = middle_of(place[0], sizes[0]), middle_of(place[1], sizes[1]), middle_of(place[2], sizes[2])
    least_y, least_z = cost(j, place[1], sizes[1], scale), cost(k, place[2], sizes[2], scale)
    low[0], high[0] = i, i + 1
    while True:
        x, x_cost = next_layer(low, high, 0, place[0], sizes[0], scale)
        if x < 0 or not x_cost + least_y + least_z < best:
            return cell
        low[1], high[1] = j, j + 1
        while True:
            y, y_cost = next_layer(low, high, 1, place[1], sizes[1], scale)
            if y < 0 or not x_cost + y_cost + least_z < best:
                break
            row = cells[x, y]
            for side in range(2):
                z = k if side == 0 else k - 1
                while 0 <= z < sizes[2]:
                    if row[z] == FREE:
                        total = x_cost + y_cost + cost(z, place[2], sizes[2], scale)
                        if total < best:
                            best, cell = total, np.array([x, y, z])
                        break
                    # Far from the best cell it is enough to look where the row still comes near.
                    if best < math.inf and not x_cost + y_cost + cost(z, place[2], sizes[2], scale) < best:
                        break
                    z += 1 if side == 0 else -1


@kernel
def middle_of(value: float, count: int) -> int:
    """The cell along an axis whose middle is nearest to a value."""
    return int(min(max(math.floor(min(max(value, 0.0), float(count))), 0), count - 1))


@kernel
def cost(cell: int, value: float, count: int, scale: float) -> float:
    """What a cell along an axis adds to the squared distance, but for what all cells share; over a scale."""
    middle = count / 2.0
    offset = cell + 0.5 - middle
    return offset * offset / scale - 2.0 * offset * ((value - middle) / scale)


@kernel
def next_layer(low: Ints, high: Ints, axis: int, value: float, count: int, scale: float) -> tuple[int, float]:
    """The next cell along an axis by its cost, and the cost; -1 after the last.

    What lies from ``low + 1`` to before ``high`` has been taken.
    """
    below = cost(low[axis], value, count, scale) if low[axis] >= 0 else math.inf
    above = cost(high[axis], value, count, scale) if high[axis] < count else math.inf
    if below == math.inf and above == math.inf:
        return -1, math.inf
    if below <= above:
        low[axis] -= 1
        return low[axis] + 1, below
    high[axis] += 1
    return high[axis] - 1, above


def nearest(states: Stack, slice_of: Ints, rotations: Rotations, grid: Grid, q: Floats) -> Floats | None:
    """Middle of the FREE cell nearest to a configuration, shape (size,), half a metre counting as much as a radian.

    None where there is no FREE cell. What is far from the configuration is not looked at.
    """
    dim = grid.dim
    place = np.full(3, 0.5)
    place[3 - dim :] = (q[:dim] - grid.lower) / grid.spacing
    apart = rotations.distances(q) / 2.0
    best, least = None, math.inf
    seen: set[int] = set()
    for r in np.argsort(apart, kind="stable").tolist():
        s = int(slice_of[r])
        if apart[r] >= least:
            break
        if s in seen:  # of rotation cells that share a slice, the nearest one
            continue
        seen.add(s)
        cell = nearest_cell(
            states[s].reshape(*(1,) * (3 - dim), *grid.shape), place, np.empty(2, np.int64), np.empty(2, np.int64)
        )
        if len(cell):
            center = grid.center_of(cell[3 - dim :])
            distance = math.hypot(*(center - q[:dim])) + apart[r]
            if distance < least:
                best, least = np.array([*center, *rotations.centers[r]]), distance
    return best

"""The set of FREE cells: drawing from it, and the member nearest to a place."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit, reader
from cspace.grid import Grid
from cspace.rotations import RotationCells
from cspace.states import FREE
from cspace.threads import in_chunks

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EDGE: Final = 2.0**-20
"""Part of a cell, along its border, that samples keep off, so that rounding never puts one into the next cell."""

CHUNK: Final = 64
"""Cells whose FREE ones are counted together."""


# ---- drawing ---------------------------------------------------------------------------------------------------------


@reader
def count_free(cells: Bytes, first: int, stop: int, counts: Ints) -> None:
    """Number of FREE cells in some of the chunks of a flat row of cells."""
    for chunk in range(first, stop):
        part = cells[chunk * CHUNK : min((chunk + 1) * CHUNK, len(cells))]
        count = 0
        for k in range(len(part)):
            count += part[k] == FREE
        counts[chunk] = count


@reader
def guide_to(ends: Ints, guide: Ints) -> None:
    """For each of as many parts of all ranks, as many as there are chunks, the chunk that has the first of them."""
    chunk = 0
    for part in range(len(guide)):
        while chunk < len(ends) - 1 and ends[chunk] <= part * ends[-1] // len(guide):
            chunk += 1
        guide[part] = chunk


@reader
def select_free(states: Bytes, ends: Ints, guide: Ints, slices: Ints, ranks: Ints) -> None:
    """Of each of some slices, the flat index of the FREE cell of a rank, counted from 0, which it is put in place of.

    ``states`` has the shape (slices, cells); ``ends`` counts the FREE cells up to the end of each chunk, and ``guide``
    tells where in it to begin.
    """
    for n in range(len(ranks)):
        cells, until = states[slices[n]], ends[slices[n]]
        chunk = guide[slices[n], ranks[n] * guide.shape[1] // until[-1]]
        while until[chunk] <= ranks[n]:
            chunk += 1
        left = ranks[n] - (until[chunk - 1] if chunk > 0 else 0)
        cell = chunk * CHUNK
        while cell + 8 <= len(cells):  # eight cells in one step
            count = 0
            for k in range(8):
                count += cells[cell + k] == FREE
            if count > left:
                break
            left -= count
            cell += 8
        # A map that another thread changes meanwhile may have fewer.
        while cell < len(cells) - 1 and (left > 0 or cells[cell] != FREE):
            left -= cells[cell] == FREE
            cell += 1
        ranks[n] = cell


class FreeCells:
    """The FREE cells of each slice, counted chunk by chunk, so that any of them can be found by its rank.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, ...)

    Attributes
    ----------
    counts : ndarray of int64, shape (slices,)
        Number of FREE cells of each slice.
    """

    def __init__(self, states: Bytes) -> None:
        self._states = states.reshape(len(states), -1)
        chunks = -(-self._states.shape[1] // CHUNK)
        self._ends, self._guide = (np.empty((len(states), chunks), dtype=np.int64) for _ in range(2))
        for cells, ends, guide in zip(self._states, self._ends, self._guide, strict=True):

            def work(start: int, stop: int, cells: Bytes = cells, ends: Ints = ends) -> int:
                count_free(cells, start, stop, ends)
                return -1

            in_chunks(work, chunks)
            np.cumsum(ends, out=ends)
            guide_to(ends, guide)
        self.counts = self._ends[:, -1].copy()

    def draw(self, slices: Ints, rng: np.random.Generator) -> Ints:
        """Flat indices of cells drawn uniformly from the FREE ones of slices, each of which must have one."""
        counts = self.counts[0] if len(self.counts) == 1 else self.counts[slices]
        chosen = rng.integers(counts, size=len(slices))
        select_free(self._states, self._ends, self._guide, slices, chosen)
        return chosen


def sample(
    free: FreeCells, slice_of: Ints, rotations: RotationCells, grid: Grid, n: int, rng: np.random.Generator
) -> Floats:
    """Configurations uniform over the volume of the FREE cells of all rotations, of which there must be one.

    Returns
    -------
    ndarray of float64, shape (n, dof)
    """
    turns = np.zeros(n, dtype=np.int64)
    if rotations.dof:
        sizes = free.counts[slice_of] * rotations.volumes
        turns = rng.choice(rotations.count, size=n, p=sizes / sizes.sum())
    cells = np.stack(np.unravel_index(free.draw(slice_of[turns], rng), grid.shape), axis=-1)
    place = grid.lower + grid.spacing * (cells + rng.uniform(EDGE, 1.0 - EDGE, size=cells.shape))
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
    found = np.empty(0, np.int64)
    best = math.inf
    i, j, k = middle_of(place[0], sizes[0]), middle_of(place[1], sizes[1]), middle_of(place[2], sizes[2])
    least_y, least_z = cost(j, place[1], sizes[1], scale), cost(k, place[2], sizes[2], scale)
    low[0], high[0] = i, i + 1
    while True:
        x, x_cost = next_layer(low, high, 0, place[0], sizes[0], scale)
        if x < 0 or not x_cost + least_y + least_z < best:
            return found
        low[1], high[1] = j, j + 1
        while True:
            y, y_cost = next_layer(low, high, 1, place[1], sizes[1], scale)
            if y < 0 or not x_cost + y_cost + least_z < best:
                break
            row = cells[x, y]
            for way in range(2):
                z = k if way == 0 else k - 1
                while 0 <= z < sizes[2]:
                    if row[z] == FREE:
                        total = x_cost + y_cost + cost(z, place[2], sizes[2], scale)
                        if total < best:
                            best, found = total, np.array([x, y, z])
                        break
                    # Far from the best cell it is enough to look where the row still comes near.
                    if best < math.inf and not x_cost + y_cost + cost(z, place[2], sizes[2], scale) < best:
                        break
                    z += 1 if way == 0 else -1


@reader
def middle_of(value: float, count: int) -> int:
    """The cell along an axis whose middle is nearest to a value."""
    return int(min(max(math.floor(min(max(value, 0.0), float(count))), 0), count - 1))


@reader
def cost(cell: int, value: float, count: int, scale: float) -> float:
    """What a cell along an axis adds to the squared distance, but for what all cells share; over a scale."""
    middle = count / 2.0
    offset = cell + 0.5 - middle
    return offset * offset / scale - 2.0 * offset * ((value - middle) / scale)


@reader
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


def nearest(states: Bytes, slice_of: Ints, rotations: RotationCells, grid: Grid, q: Floats) -> Floats | None:
    """Middle of the FREE cell nearest to a configuration, shape (dof,), half a metre counting as much as a radian.

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

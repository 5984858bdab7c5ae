"""Cells of a lattice, how many of some chosen balls hold each, and the greedy choice among balls by what they add.

Lengths are in sides of a cell. A ball holds a cell where ``sum (|middle - center| + half)^2 <= reach^2`` over the axes:
its middle, with ``half`` zero, or all of it.
"""

from __future__ import annotations

import heapq
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit
from cspace.spectral.regions import Lattice, Tree, distance

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EPS: Final = 2.0**-20
"""Rounding allowance, in sides of a cell: by this, a ball that holds a cell reaches beyond it."""

ROUNDS: Final = 6
"""How often every ball is moved, at most."""

_VOLUME: Final = {2: math.pi, 3: 4.0 / 3.0 * math.pi}


class Cells(NamedTuple):
    """The cells; compiled functions take them as they are.

    ``times`` (nx, ny, nz) is how many of the chosen balls hold a cell, or -1 for cells that do not matter. ``rows`` (nx
    * ny, 4) is room for the rows of cells that a ball holds: i, j, and the first and last k; and ``squares`` (nx * ny,)
    for the part of the squared distance that the first two axes make up.
    """

    times: NDArray[np.int32]
    half: Floats
    rows: Ints
    squares: Floats


class Cover:
    """The cells of a lattice, and balls chosen to hold them.

    Where ``whole``, a ball holds a cell if all of the cell lies in it, and every cell is to be held; or else, if its
    middle does, and only those in the shape are.
    """

    def __init__(self, lattice: Lattice, *, whole: bool) -> None:
        self._lattice = lattice
        times = np.full(lattice.cells.shape, -1, dtype=np.int32)
        times[lattice.cells] = 0 if whole else np.where(lattice.depths > 0.0, 0, -1)
        rows = math.prod(times.shape[:2])
        half = lattice.half if whole else np.zeros(3)
        self._cells = Cells(times, half, np.empty((rows, 4), dtype=np.int64), np.empty(rows))

    @property
    def open_cells(self) -> Floats:
        """Middles of the cells that no ball holds, shape (n, 3)."""
        return np.argwhere(self._cells.times == 0).astype(np.float64) + np.float64(0.5)

    @property
    def held(self) -> int:
        """Number of cells that balls hold."""
        return int(np.count_nonzero(self._cells.times > 0))

    def choose(self, centers: Floats, reaches: Floats, most: int) -> Ints:
        """Numbers of those among balls that a greedy choice takes, in their order."""
        lattice = self._lattice
        large = np.maximum(reaches, 0.0) + 0.5 * lattice.diagonal
        bounds = np.minimum(_VOLUME[lattice.region.dim] * large**lattice.region.dim, float(lattice.cells.sum()))
        chosen: Ints = choose(self._cells, centers, reaches, bounds, most)
        return chosen

    def trim(self, centers: Floats, reaches: Floats, depths: Floats) -> Floats:
        """Drop balls that hold no cell alone, then cut the others to what they hold alone: reaches, 0 if dropped.

        Those that stick out most are first.
        """
        left = reaches.copy()
        trim(self._cells, centers, left, np.argsort(reaches, kind="stable"), only_drop=True)
        trim(self._cells, centers, left, np.argsort(depths - left, kind="stable"), only_drop=False)
        return left

    def polish(self, centers: Floats, radii: Floats) -> None:
        """Move balls that lie in the shape, as large as it allows, to where they hold more cells; in place."""
        region, lattice = self._lattice.region, self._lattice
        polish(self._cells, region.tree, centers, radii, (lattice.corner, lattice.side, region.slack), ROUNDS)


@jit
def _span(center: float, length: float, count: int) -> tuple[int, int]:
    """First and last of the middles within a length of a center along an axis."""
    return max(0, math.ceil(center - length - 0.5)), min(count - 1, math.floor(center + length - 0.5))


@jit
def _find_rows(cells: Cells, center: Floats, reach: float) -> int:
    """Fill ``cells.rows`` with the rows of cells that a ball holds; how many there are."""
    nx, ny, nz = cells.times.shape
    half = cells.half
    r = reach - EPS
    count = 0
    i0, i1 = _span(center[0], r - half[0], nx)
    for i in range(i0, i1 + 1):
        x = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x > r * r:
            continue
        j0, j1 = _span(center[1], math.sqrt(r * r - x) - half[1], ny)
        for j in range(j0, j1 + 1):
            xy = x + (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if xy > r * r:
                continue
            k0, k1 = _span(center[2], math.sqrt(r * r - xy) - half[2], nz)
            if k0 <= k1:
                cells.rows[count, 0], cells.rows[count, 1] = i, j
                cells.rows[count, 2], cells.rows[count, 3] = k0, k1
                cells.squares[count] = xy
                count += 1
    return count


@jit
def _add(cells: Cells, center: Floats, reach: float, step: int) -> None:
    """Count a ball in (``step`` 1) or out (-1)."""
    for n in range(_find_rows(cells, center, reach)):
        i, j, k0, k1 = cells.rows[n]
        for k in range(k0, k1 + 1):
            if cells.times[i, j, k] >= 0:
                cells.times[i, j, k] += step


@jit
def _gain(cells: Cells, center: Floats, reach: float) -> int:
    """How many cells a ball holds that none holds so far."""
    gain = 0
    for n in range(_find_rows(cells, center, reach)):
        i, j, k0, k1 = cells.rows[n]
        for k in range(k0, k1 + 1):
            gain += cells.times[i, j, k] == 0
    return gain


@jit
def _needed(cells: Cells, center: Floats, reach: float) -> float:
    """The least reach with which a ball still holds the cells that only it holds; zero where there are none."""
    most = -1.0
    for n in range(_find_rows(cells, center, reach)):
        i, j, k0, k1 = cells.rows[n]
        for k in range(k0, k1 + 1):
            if cells.times[i, j, k] == 1:
                most = max(most, cells.squares[n] + (abs(k + 0.5 - center[2]) + cells.half[2]) ** 2)
    # Two allowances: one that the ball reaches beyond its cells, and one for the root.
    return min(reach, math.sqrt(most) + 2.0 * EPS) if most >= 0.0 else 0.0


@jit
def _sum_row(times: NDArray[np.int32], sums: NDArray[np.int32], i: int, j: int) -> int:
    """Count the cells of a row that no ball holds: ``sums[i, j, k]`` before the k-th."""
    count = 0
    for k in range(times.shape[2]):
        sums[i, j, k] = count
        count += times[i, j, k] == 0
    sums[i, j, times.shape[2]] = count
    return count


@jit
def choose(cells: Cells, centers: Floats, reaches: Floats, bounds: Floats, most: int) -> Ints:
    """The balls that a greedy choice takes, each for the cells that it adds: numbers, in their order.

    A ball adds no more cells than it did before others were taken (M. Minoux, "Accelerated greedy algorithms for
    maximizing submodular set functions", 1978), nor than ``bounds``. It ends when no ball adds a cell.
    """
    times = cells.times
    nx, ny, nz = times.shape
    chosen = np.empty(min(most, len(centers)), dtype=np.int64)
    sums = np.empty((nx, ny, nz + 1), dtype=np.int32)
    count, left = 0, 0
    for i in range(nx):
        for j in range(ny):
            left += _sum_row(times, sums, i, j)
    queue = [(-bounds[n], n) for n in range(len(centers))]
    heapq.heapify(queue)
    while len(queue) > 0 and count < len(chosen) and left > 0:
        _, n = heapq.heappop(queue)
        rows = _find_rows(cells, centers[n], reaches[n])
        gain = 0
        for row in range(rows):
            i, j, k0, k1 = cells.rows[row]
            gain += sums[i, j, k1 + 1] - sums[i, j, k0]
        if gain == 0:
            continue
        # The gain is up to date; if it no longer leads, the ball waits with it.
        if len(queue) > 0 and gain < -queue[0][0]:
            heapq.heappush(queue, (-float(gain), n))
            continue
        for row in range(rows):
            i, j, k0, k1 = cells.rows[row]
            for k in range(k0, k1 + 1):
                if times[i, j, k] >= 0:
                    times[i, j, k] += 1
            _sum_row(times, sums, i, j)
        chosen[count] = n
        count += 1
        left -= gain
    return chosen[:count]


@jit
def trim(cells: Cells, centers: Floats, reaches: Floats, order: Ints, only_drop: bool) -> None:
    """Cut balls, in an order, to the cells that only they hold; ``reaches`` become zero where there are none."""
    for n in order:
        least = _needed(cells, centers[n], reaches[n])
        if least < reaches[n] and not (only_drop and least > 0.0):
            _add(cells, centers[n], reaches[n], -1)
            if least > 0.0:
                _add(cells, centers[n], least, 1)
            reaches[n] = least


@jit
def polish(
    cells: Cells, tree: Tree, centers: Floats, radii: Floats, frame: tuple[Floats, float, float], rounds: int
) -> None:
    """Move balls that lie in a shape, as large as it allows, to where they hold more cells; in place.

    A step that stays in the ball stays in the shape, so that the distance from the border is the new radius. Steps go
    along the axes, and halve where none helps. ``frame`` is the corner of the lattice in the space of the tree, its
    side, and the slack of distances.
    """
    corner, side, slack = frame
    trial = np.empty(3)
    for turn in range(rounds):
        moved = False
        for n in range(len(centers)):
            _add(cells, centers[n], radii[n], -1)
            best = _gain(cells, centers[n], radii[n])
            step = 2.0 / (1 << turn)
            for _ in range(4):
                better = False
                for direction in range(6):
                    axis = direction // 2
                    if cells.times.shape[axis] == 1 or step >= 0.9 * radii[n]:
                        continue
                    trial[:] = centers[n]
                    trial[axis] += step if direction % 2 else -step
                    place = corner + side * trial
                    radius = (distance(tree, place, 2.0 * side * (radii[n] + step))[0] - slack) / side
                    if radius <= 0.0:
                        continue
                    gain = _gain(cells, trial, radius)
                    if gain > best or (gain == best and radius > radii[n]):
                        better = moved = True
                        best = gain
                        centers[n], radii[n] = trial, radius
                if not better:
                    step *= 0.5
            _add(cells, centers[n], radii[n], 1)
        if not moved:
            break

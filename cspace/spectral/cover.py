"""Cells of a lattice, how many of some chosen balls hold each, and the greedy choice among balls by what they add.

Lengths are in sides of a cell. A ball holds a cell where ``sum (|middle - center| + half)^2 <= reach^2`` over the axes:
its middle, with ``half`` zero, or all of it.
"""

from __future__ import annotations

import heapq
import math
from typing import Any, Final, NamedTuple

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


class Balls(NamedTuple):
    """Balls, in sides of a cell.

    Attributes
    ----------
    centers : ndarray, shape (n, 3)
    depths : ndarray, shape (n,)
        Lower bounds of how deep the centers lie in the shape, below zero outside.
    reaches : ndarray, shape (n,)
        Radii.
    """

    centers: Floats
    depths: Floats
    reaches: Floats

    def where(self, chosen: NDArray[Any]) -> Balls:
        """Those of a mask, or of some numbers."""
        return Balls(*(column[chosen] for column in self))

    def joined(self, other: Balls) -> Balls:
        """Both together."""
        return Balls(*map(np.concatenate, zip(self, other, strict=True)))


class Cells(NamedTuple):
    """The cells; compiled functions take them as they are.

    ``times`` (nx, ny, nz) is how many of the chosen balls hold a cell, or -1 for cells that do not matter, and ``sums``
    (nx, ny, nz + 1) how many cells of its row that none holds come before it. ``rows`` (nx * ny, 4) is room for the
    rows of cells that a ball holds: i, j, and the first k and the one after the last; and ``squares`` (nx * ny,) for
    the part of the squared distance that the first two axes make up.
    """

    times: NDArray[np.int32]
    sums: NDArray[np.int32]
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
        sums = np.cumsum(np.pad(times == 0, ((0, 0), (0, 0), (1, 0))), axis=2, dtype=np.int32)
        rows = math.prod(times.shape[:2])
        half = lattice.half if whole else np.zeros(3)
        self._cells = Cells(times, sums, half, np.empty((rows, 4), dtype=np.int64), np.empty(rows))

    @property
    def open_cells(self) -> Floats:
        """Middles of the cells that no ball holds, shape (n, 3)."""
        return np.argwhere(self._cells.times == 0) + np.float64(0.5)

    def choose(self, balls: Balls, most: int) -> Ints:
        """Numbers of those among balls that a greedy choice takes, in their order."""
        lattice, dim = self._lattice, self._lattice.region.dim
        large = np.maximum(balls.reaches, 0.0) + 0.5 * lattice.diagonal
        bounds = np.minimum(_VOLUME[dim] * large**dim, float(len(lattice.middles)))
        chosen: Ints = choose(self._cells, balls.centers, balls.reaches, bounds, most)
        return chosen

    def trim(self, balls: Balls) -> Floats:
        """Drop balls that hold no cell alone, then cut the others to what they hold alone: reaches, 0 if dropped.

        Those that stick out most are first.
        """
        left = balls.reaches.copy()
        trim(self._cells, balls.centers, left, np.argsort(left, kind="stable"), only_drop=True)
        trim(self._cells, balls.centers, left, np.argsort(balls.depths - left, kind="stable"), only_drop=False)
        return left

    def polish(self, centers: Floats, radii: Floats) -> None:
        """Move balls that lie in the shape, as large as it allows, to where they hold more cells; in place."""
        region, lattice = self._lattice.region, self._lattice
        polish(self._cells, region.tree, centers, radii, (lattice.corner, lattice.side, region.slack))


@jit
def _span(center: float, length: float, count: int) -> tuple[int, int]:
    """The middles within a length of a center along an axis: the first, and the one after the last."""
    return max(0, math.ceil(center - length - 0.5)), min(count, math.floor(center + length + 0.5))


@jit
def _find_rows(cells: Cells, center: Floats, reach: float) -> int:
    """Fill ``cells.rows`` with the rows of cells that a ball holds; how many there are."""
    nx, ny, nz = cells.times.shape
    half = cells.half
    r = reach - EPS
    count = 0
    for i in range(*_span(center[0], r - half[0], nx)):
        x = (abs(i + 0.5 - center[0]) + half[0]) ** 2
        if x > r * r:
            continue
        for j in range(*_span(center[1], math.sqrt(r * r - x) - half[1], ny)):
            xy = x + (abs(j + 0.5 - center[1]) + half[1]) ** 2
            if xy > r * r:
                continue
            first, stop = _span(center[2], math.sqrt(r * r - xy) - half[2], nz)
            if first < stop:
                cells.rows[count, 0], cells.rows[count, 1] = i, j
                cells.rows[count, 2], cells.rows[count, 3] = first, stop
                cells.squares[count] = xy
                count += 1
    return count


@jit
def _add(cells: Cells, rows: int, step: int) -> None:
    """Count a ball, whose rows were found, in (``step`` 1) or out (-1)."""
    times, sums = cells.times, cells.sums
    for n in range(rows):
        i, j, first, stop = cells.rows[n]
        for k in range(first, stop):
            if times[i, j, k] >= 0:
                times[i, j, k] += step
        for k in range(first, times.shape[2]):
            sums[i, j, k + 1] = sums[i, j, k] + (times[i, j, k] == 0)


@jit
def _gain(cells: Cells, rows: int) -> int:
    """How many cells a ball, whose rows were found, holds that none holds so far."""
    gain = 0
    for n in range(rows):
        i, j, first, stop = cells.rows[n]
        gain += cells.sums[i, j, stop] - cells.sums[i, j, first]
    return gain


@jit
def choose(cells: Cells, centers: Floats, reaches: Floats, bounds: Floats, most: int) -> Ints:
    """The balls that a greedy choice takes, each for the cells that it adds: numbers, in their order.

    A ball adds no more cells than it did before others were taken (M. Minoux, "Accelerated greedy algorithms for
    maximizing submodular set functions", 1978), nor than ``bounds``. It ends when no ball adds a cell.
    """
    chosen = np.empty(min(most, len(centers)), dtype=np.int64)
    count, left = 0, cells.sums[:, :, -1].sum()
    queue = [(-bounds[n], n) for n in range(len(centers))]
    heapq.heapify(queue)
    while len(queue) > 0 and count < len(chosen) and left > 0:
        _, n = heapq.heappop(queue)
        rows = _find_rows(cells, centers[n], reaches[n])
        gain = _gain(cells, rows)
        if gain == 0:
            continue
        # The gain is up to date; if it no longer leads, the ball waits with it.
        if len(queue) > 0 and gain < -queue[0][0]:
            heapq.heappush(queue, (-float(gain), n))
            continue
        _add(cells, rows, 1)
        chosen[count] = n
        count += 1
        left -= gain
    return chosen[:count]


@jit
def trim(cells: Cells, centers: Floats, reaches: Floats, order: Ints, only_drop: bool) -> None:
    """Cut balls, in an order, to the cells that only they hold; ``reaches`` become zero where there are none."""
    for n in order:
        rows = _find_rows(cells, centers[n], reaches[n])
        square = -1.0
        for row in range(rows):
            i, j, first, stop = cells.rows[row]
            for k in range(first, stop):
                if cells.times[i, j, k] == 1:
                    square = max(square, cells.squares[row] + (abs(k + 0.5 - centers[n, 2]) + cells.half[2]) ** 2)
        # Two allowances: one that the ball reaches beyond its cells, and one for the root.
        least = math.sqrt(square) + 2.0 * EPS if square >= 0.0 else 0.0
        if least < reaches[n] and not (only_drop and least > 0.0):
            _add(cells, rows, -1)
            if least > 0.0:
                _add(cells, _find_rows(cells, centers[n], least), 1)
            reaches[n] = least


@jit
def polish(cells: Cells, tree: Tree, centers: Floats, radii: Floats, frame: tuple[Floats, float, float]) -> None:
    """Move balls that lie in a shape, as large as it allows, to where they hold more cells; in place.

    A step that stays in the ball stays in the shape, so that the distance from the border is the new radius. Steps go
    along the axes, and halve where none helps. ``frame`` is the corner of the lattice in the space of the tree, its
    side, and the slack of distances.
    """
    corner, side, slack = frame
    trial = np.empty(3)
    for turn in range(ROUNDS):
        moved = False
        for n in range(len(centers)):
            rows = _find_rows(cells, centers[n], radii[n])
            _add(cells, rows, -1)
            best = _gain(cells, rows)
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
                    gain = _gain(cells, _find_rows(cells, trial, radius))
                    if gain > best or (gain == best and radius > radii[n]):
                        better = moved = True
                        best = gain
                        centers[n], radii[n] = trial, radius
                if not better:
                    step *= 0.5
            _add(cells, _find_rows(cells, centers[n], radii[n]), 1)
        if not moved:
            break

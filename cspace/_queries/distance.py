"""Distances to cells that are not FREE, and clearance.

The *distance* of a cell is that from its center c to the nearest point of a closed cell that is
not FREE, in its slice, in the grid or outside. The table of a slice is computed when it is first
needed, axis by axis: the lowest sum of squares along one axis is a lower envelope of parabolas (A.
Meijster, J. Roerdink and W. Hesselink, "A general algorithm for computing distance transforms in
linear time", 2000; P. Felzenszwalb and D. Huttenlocher, "Distance transforms of sampled functions",
2012). The nearest point of another cell lies on its borders, so parabolas stand on the
borders between cells.

*Clearance* D(p) is the distance from position p to the same cells. The largest of three lower
bounds is taken; c are the centers of the 2^d cells around p:

* D(c) - |p - c| for each c, because D changes by at most the length of a move.
* D^2(p) - |p|^2 is concave, because it is the least of affine functions: |x|^2 - 2 p x for all
  points x of the cells. So if p is the mean of the c with weights w, D^2(p) is at least the mean
  of D^2(c) - |p - c|^2. The weights are those of linear interpolation along each axis, for which
  the mean of |p - c|^2 is the sum of w (1 - w) over the axes. Beyond the outermost centers, the
  bound is that of the nearest position among centers, less the distance to it.
* the distance from p to the box that contains all cells that are not FREE, for p outside the grid.

In the grid, one c is at most sqrt(d) / 2 cells away, and D(p) <= D(c) + |p - c|. So by the first
bound alone, the result is less than sqrt(d) cells below D(p).

Rounding: the table rounds a square at most three times and its root once, by 2^-24 of each, so a
distance by at most 2.5 * 2^-24 of it. A look-up rounds by 2^-50. Distances are multiplied by
1 - 2^-22 before they are used, which covers both. The rounding of a position is below SLACK along
each axis in and around the grid, so 4 SLACK are subtracted; far away, it is below 2^-50 of the
distance.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cspace._grid import SLACK
from cspace._queries.callbacks import MAX_SIZE, NO_ANSWER, configuration_before
from cspace._queries.points import MAX_CELL, configuration_in, is_usable, slice_of, state_at
from cspace._record.cells import Map
from cspace._support.arrays import FREE, Bools, Floats, Ints, Numbers, Row, States, find_box
from cspace._support.compiling import internal, kernel
from cspace._support.threads import count_cores, map_in_threads, run_in_chunks

Distances = NDArray[np.float32]
"""Distances of cells, or their squares, in cells."""

BYTES_PER_CELL: Final = 4
"""Memory of a distance, bytes."""

ROUNDING_FACTOR: Final = 1.0 - 2.0**-22
"""Factor that keeps a computed distance below the true one, despite rounding."""


class HasDistances(Protocol):
    """A map in memory, with the distances of its cells."""

    @property
    def _distances(self) -> DistanceMap: ...


class DistanceTable(NamedTuple):
    """Distances of a map's cells, for kernels.

    Attributes
    ----------
    cells : ndarray of float32, shape (slices * cells,)
        Distance of each cell of all slices in a row, in cells; zero if the cell is not FREE.
    boxes : ndarray of float64, shape (slices, 2, d)
        Corners, in cells, of the box that contains all cells that are not FREE, in the grid and
        outside. Without such cells, the lower corner is inf and the upper one -inf.
    is_ready : ndarray of bool, shape (slices,)
        True for slices whose distances are computed.
    """

    cells: Distances
    boxes: Floats
    is_ready: Bools

    @classmethod
    def of(cls, space: HasDistances, slices: Sequence[int] | None = None) -> DistanceTable:
        """Return the distances of cells of a map in memory as they are now.

        Those of the given slices, or of all, are computed at the first call after a change of the
        map.
        """
        distances = space._distances
        return distances.compute_all() if slices is None else distances.compute_slices(slices)


class DistanceMap:
    """Distances of a map, computed slice by slice when needed.

    The states and the exterior table are shared, not copied. The lock is held while they change,
    and while distances are computed.

    Attributes
    ----------
    table : DistanceTable or None
        The table, once it has distances after the last change.
    known : DistanceTable or None
        The table, once it has the distances of all slices.
    """

    def __init__(self, states: States, exterior: Ints, lock: AbstractContextManager[Any]) -> None:
        """Keep the shared states and exterior table, without distances."""
        self._states = states
        self._exterior = exterior
        self._lock = lock
        self.table: DistanceTable | None = None
        self.known: DistanceTable | None = None

    def drop(self) -> None:
        """Drop all distances, because states changed.

        Tables returned earlier stay as they are.
        """
        self.table = self.known = None

    def compute_all(self) -> DistanceTable:
        """Compute missing distances of all slices; return the table."""
        return self.known or self.compute_slices(range(len(self._states)))

    def array(self) -> Distances:
        """Return the distances of all slices.

        They have shape (slices, x, y) or (slices, x, y, z).
        """
        return self.compute_all().cells.reshape(self._states.shape)

    def compute_slices(self, slices: Iterable[int]) -> DistanceTable:
        """Compute missing distances of the given slices, and return the table.

        Slices are computed in threads.
        """
        with self._lock:
            if self.table is None:
                n_slices, *shape = self._states.shape
                cells = np.empty(self._states.size, dtype=np.float32)
                boxes = np.empty((n_slices, 2, len(shape)))
                self.table = DistanceTable(cells, boxes, np.zeros(n_slices, dtype=np.bool_))
            table = self.table
            missing = [number for number in slices if not table.is_ready[number]]
            map_in_threads(partial(self._fill, table), missing, count_cores())
            table.is_ready[missing] = True
            if table.is_ready.all():
                self.known = table
            return table

    def _fill(self, table: DistanceTable, number: int) -> None:
        """Write the distances and the box of a slice to the table."""
        states = self._states[number]
        exterior = self._exterior[number]
        table.boxes[number] = find_bounding_box(states, exterior)
        distances = table.cells.reshape(self._states.shape)
        compute_distances(states, exterior, distances[number])


# ---- the table -----------------------------------------------------------------------------------


def find_bounding_box(states: States, exterior: Ints) -> Floats:
    """Return the bounding box of cells not FREE, shape (2, d).

    ``exterior`` is a row of :attr:`cspace._record.exterior.Exterior.table`.
    """
    dim = states.ndim
    # A row has the first and the last cell of a MIXED box, then the state of all other cells.
    first = exterior[:dim]
    last = exterior[dim:-1]
    state_beyond = exterior[-1]
    if state_beyond != FREE:
        return np.stack([np.full(dim, -math.inf), np.full(dim, math.inf)])
    low = np.full(dim, math.inf)
    high = np.full(dim, -math.inf)
    if (first <= last).all():
        low = first.astype(np.float64)
        high = last + 1.0
    box = find_box(states != FREE)
    if box[0].stop > 0:
        low = np.minimum(low, [side.start for side in box])
        high = np.maximum(high, [side.stop for side in box])
    return np.stack([low, high])


def compute_distances(states: States, exterior: Ints, out: Distances) -> None:
    """Write the distances, in cells, of the cells of a slice.

    ``states`` and ``out`` have the shape of the grid; ``exterior`` is a row of the exterior table.
    """
    # Squared distances spread from cells that are not FREE, along one axis after the other.
    out.fill(0.0)
    np.copyto(out, math.inf, where=states == FREE)
    for axis, count in enumerate(out.shape):
        n_before = math.prod(out.shape[:axis])
        _transform_axis(out.reshape(n_before, count, -1))
    for low, high in boxes_outside(exterior, out.shape):
        np.minimum(out, squared_box_distances(low, high, out.shape), out=out)
    np.sqrt(out, out=out)


def boxes_outside(exterior: Ints, shape: tuple[int, ...]) -> list[tuple[Floats, Floats]]:
    """List boxes of the cells outside the grid that are not FREE.

    Boxes are given by their corners, in cells. There is at most one box beyond each side of the
    grid.
    """
    dim = len(shape)
    # The exterior row has the first and the last cell of a box, then the state of all other cells.
    low = exterior[:dim].astype(np.float64)
    high = exterior[dim:-1].astype(np.float64) + 1.0
    state_beyond = exterior[-1]
    if state_beyond != FREE:
        low = np.full(dim, -math.inf)
        high = np.full(dim, math.inf)
    # Cut the box at both sides of the grid along each axis.
    boxes = list[tuple[Floats, Floats]]()
    for axis, count in enumerate(shape):
        high_below = high.copy()
        low_above = low.copy()
        high_below[axis] = min(high[axis], 0.0)
        low_above[axis] = max(low[axis], count)
        boxes += [(low, high_below), (low_above, high)]
    return [(first, stop) for first, stop in boxes if (first < stop).all()]


def squared_box_distances(low: Floats, high: Floats, shape: tuple[int, ...]) -> Distances:
    """Compute squared distances of cell centers from a box.

    ``low`` and ``high`` are the corners of the box, in cells; ``shape`` is that of the grid.
    """
    # Each axis adds its squared gap, and a dimension of the result.
    squares = np.zeros(1, dtype=np.float32)
    for axis, count in enumerate(shape):
        centers = np.arange(count) + 0.5
        gaps = np.maximum(np.maximum(low[axis] - centers, centers - high[axis]), 0.0)
        squares = squares[..., np.newaxis] + (gaps * gaps).astype(np.float32)
    return squares.reshape(shape)


def _transform_axis(squares: Distances) -> None:
    """Transform distances along the middle axis, in place.

    ``squares`` has shape (cells before, cells along the axis, cells after).
    """
    n_before, count, n_after = squares.shape
    n_borders = count + 1

    def spread_lines(start: int, stop: int) -> int:
        """Transform lines [start, stop) with their own scratch.

        Returns -1, because no line is invalid.
        """
        borders = np.empty(n_borders, dtype=np.int64)
        heights = np.empty(n_borders)
        firsts = np.empty(n_borders, dtype=np.int64)
        transform_lines(squares, borders, heights, firsts, start, stop)
        return -1

    # Lines of cells below which a further thread costs more time than it saves.
    run_in_chunks(spread_lines, n_before * n_after, 64)


@kernel
def transform_lines(
    squares: Distances,
    borders: Ints,
    heights: Floats,
    firsts: Ints,
    start: int,
    stop: int,
) -> None:
    """Apply the distance transform to some lines of cells, in place.

    They are lines [start, stop) of ``squares``. Lines lie along the middle axis. Each square
    becomes the lowest sum of the square at a cell of the line and the squared gap to that cell.
    Border j lies between cells j - 1 and j, so half a cell below the center of cell j. A parabola
    stands on it, as high as the lower square of the two cells. The scratch arrays are a stack of
    the parabolas of the lower envelope: border, height, and the first cell whose center is nearer
    to this parabola than to the one below it in the stack.
    """
    _, count, depth = squares.shape
    for line in range(start, stop):
        i = line // depth
        k = line % depth
        top = -1
        square_before = math.inf
        for border in range(count + 1):
            square_after = float(squares[i, border, k]) if border < count else math.inf
            height = min(square_before, square_after)
            square_before = square_after
            if height == math.inf:
                continue
            # Remove the parabolas that lie above this one wherever they are the lowest.
            first = 0
            while top >= 0:
                width = border - borders[top]
                crossing = 0.5 * ((height - heights[top]) / width + width)
                first = borders[top] + math.floor(crossing + 0.5)
                if first > firsts[top]:
                    break
                top -= 1
                first = 0
            if first < count:
                top += 1
                borders[top] = border
                heights[top] = height
                firsts[top] = first
        if top < 0:
            continue
        # Read the envelope backwards, one parabola after the other.
        for j in range(count - 1, -1, -1):
            while firsts[top] > j:
                top -= 1
            gap = j + 0.5 - borders[top]  # of the cell's center
            square = heights[top] + gap * gap
            if square < squares[i, j, k]:
                squares[i, j, k] = square


# ---- look-ups ------------------------------------------------------------------------------------


@internal
def clearance_at(map_: Map, table: DistanceTable, position: Row, rotation: Numbers) -> float:
    """Return a lower bound of the clearance of a configuration, in metres.

    The table has the distances of its slice.
    """
    if state_at(map_, position, rotation) != FREE:
        return 0.0
    s = slice_of(map_, rotation)
    first_axis = 3 - map_.dim
    # Squared distances to the box of cells that are not FREE, and to the nearest position among
    # centers; and the mean of squared distances to the centers, by which interpolation overstates.
    box_square = 0.0
    beyond_square = 0.0
    spread = 0.0
    for axis in range(first_axis, 3):
        place, nearest = center_coordinates(map_, position, axis)
        cell_place = place + 0.5
        low = table.boxes[s, 0, axis - first_axis]
        high = table.boxes[s, 1, axis - first_axis]
        box_gap = max(0.0, low - cell_place, cell_place - high)
        box_square += box_gap * box_gap
        beyond = place - nearest
        beyond_square += beyond * beyond
        share = nearest - math.floor(nearest)
        spread += share * (1.0 - share)
    best = math.sqrt(box_square) * ROUNDING_FACTOR
    # The distance at each of the 2^d centers around, and their mean with linear weights.
    mean_square = 0.0
    for corner in range(2**map_.dim):
        cell = s
        weight = 1.0
        gap_square = 0.0
        for axis in range(first_axis, 3):
            place, nearest = center_coordinates(map_, position, axis)
            count = map_.states.shape[axis + 1]
            k = math.floor(nearest)
            share = nearest - k
            # Each bit of the corner selects the lower or the upper center along an axis.
            is_upper = (corner >> (axis - first_axis)) & 1
            if is_upper:
                k = min(k + 1, count - 1)
            else:
                share = 1.0 - share
            weight *= share
            gap = place - k
            gap_square += gap * gap
            cell = cell * count + k
        distance = table.cells[cell] * ROUNDING_FACTOR
        best = max(best, distance - math.sqrt(gap_square))
        mean_square += weight * distance * distance
    # False for NaN, which a weight of zero makes of an infinite distance.
    if mean_square > spread:
        best = max(best, math.sqrt(mean_square - spread) - math.sqrt(beyond_square))
    return max(0.0, best - 4.0 * SLACK) * map_.spacing


@internal
def center_coordinates(map_: Map, position: Row, axis: int) -> tuple[float, float]:
    """Return a coordinate, and the nearest one between the outermost centers.

    Both are in cells from the first center. Coordinates farther than MAX_CELL are as far from
    everything.
    """
    cell_place = (position[axis] - map_.lower[axis]) / map_.spacing
    place = min(max(cell_place, -MAX_CELL), MAX_CELL) - 0.5
    last = float(map_.states.shape[axis + 1] - 1)
    return place, min(max(place, 0.0), last)


@kernel
def write_clearances(map_: Map, table: DistanceTable, points: Floats, out: Floats) -> int:
    """Write the clearances of configurations, metres.

    ``points`` has shape (n, size), ``out`` (n,). Returns the index of the first unusable
    configuration, or -1.
    """
    for n in range(points.shape[0]):
        position, rotation = configuration_in(map_, points, n)
        if not is_usable(position, rotation):
            return n
        out[n] = clearance_at(map_, table, position, rotation)
    return -1


@kernel
def look_up_clearance(map_: Map, table: DistanceTable, numbers: Numbers) -> float:
    """Return the clearance of one configuration, in metres.

    It is NO_ANSWER if the configuration is not usable, or the table lacks its slice. The numbers
    are those of :func:`cspace._queries.callbacks.bind_numbers`.
    """
    position, rotation = configuration_before(map_, numbers, MAX_SIZE)
    if not is_usable(position, rotation) or not table.is_ready[slice_of(map_, rotation)]:
        return float(NO_ANSWER)
    return clearance_at(map_, table, position, rotation)

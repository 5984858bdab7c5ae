"""Compiled tests whether an edge is FREE.

An edge is cut at the borders of rotation cells. Each piece lies in one slice of the map and is walked slab by slab.
Positions are in cells along three axes; a map of the plane has one layer of cells along the first.
"""

from __future__ import annotations

import math

import numpy as np

from cspace.arrays import FREE, Bools, Floats
from cspace.compiling import kernel
from cspace.grid import SLACK
from cspace.map.points import (
    MAX_POSITION,
    Cell,
    Numbers,
    Slice,
    configuration,
    get_slice,
    is_usable,
    replaced,
    run_is_free,
)
from cspace.map.storage import Map

MIN_EXTENT_CELLS = 2.0**-500
"""Extent of a segment along an axis, in cells, below which it counts as zero, because dividing by it would overflow."""


@kernel
def edges_are_free(map_: Map, starts: Floats, ends: Floats, out: Bools) -> int:
    """Test whether edges are FREE.

    Edges lead from `starts` to `ends`, shape (n, size); ``out`` has shape (n,). Returns the index of the first
    unusable edge, or -1.
    """
    for edge in range(starts.shape[0]):
        q0, q1 = configuration(map_, starts, edge), configuration(map_, ends, edge)
        if not (is_usable(map_, q0) and is_usable(map_, q1)):
            return edge
        out[edge] = edge_is_free(map_, q0, q1)
    return -1


@kernel
def edge_is_free(map_: Map, q0: Numbers, q1: Numbers) -> bool:
    """Return True if an edge is FREE.

    All closed cells within SLACK of it must be FREE. Along an edge the position moves straight and the rotation takes
    the shortest arc.
    """
    cursor = map_.rotations.first_piece(q0, q1)
    while True:
        more, slice_index, start, stop, cursor = map_.rotations.next_piece(cursor)
        if not more:
            return True
        first, last = map_.lower, map_.lower
        for axis in range(len(map_.lower)):
            first = replaced(first, axis, between(q0[axis], q1[axis], start))
            last = replaced(last, axis, between(q0[axis], q1[axis], stop))
        if not segment_is_free(map_, slice_index, first, last):
            return False


@kernel
def along(map_: Map, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    """Return the configuration at t along an edge.

    ``t`` runs from 0 to 1. ``arc`` selects one of several shortest arcs of the rotation; see ``arc_count``.
    """
    q = map_.rotations.turned(q0, q1, arc, t)
    for axis in range(len(map_.lower)):
        q = replaced(q, axis, between(q0[axis], q1[axis], t))
    return q


@kernel
def between(first: float, second: float, t: float) -> float:
    """Interpolate between two numbers at t in [0, 1].

    Rounding does not lead beyond them.
    """
    if t == 0.0:
        return first
    if t == 1.0:
        return second
    value = first + t * (second - first)
    return min(max(value, min(first, second)), max(first, second))


@kernel
def segment_is_free(map_: Map, slice_index: int, first: Numbers, last: Numbers) -> bool:
    """Return True if a segment in one slice is FREE.

    It leads from position `first` to `last`, metres.
    """
    inside: bool = np.bool_(True)  # type: ignore[assignment]  # numba requires one type from the start
    dim, total = len(map_.lower), 0.0
    p, q = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
    for axis in range(dim):
        lower, upper, start, stop = map_.lower[axis], map_.upper[axis], first[axis], last[axis]
        start_cells, stop_cells = (start - lower) / map_.spacing, (stop - lower) / map_.spacing
        inside &= (min(start, stop) >= lower) & (max(start, stop) <= upper)
        total += abs(start_cells) + abs(stop_cells)
        p, q = replaced(p, 3 - dim + axis, start_cells), replaced(q, 3 - dim + axis, stop_cells)
    if not total <= MAX_POSITION:  # True for NaN
        return False
    # A segment that leaves the grid is proven only if all cells outside both grid and box are FREE.
    if not inside and map_.exterior[slice_index, 2 * dim] != FREE:
        return False
    slice_ = get_slice(map_, slice_index, inside)
    low, high = slice_.low, slice_.high
    for axis in range(3):
        low = replaced(low, axis, min(low[axis], 0))
        high = replaced(high, axis, max(high[axis], slice_.shape[axis] - 1))
    return segment_is_free_in_box(slice_, p, q, low, high)


@kernel
def slab_times(p: float, q: float, first: int, last: int) -> tuple[float, float]:
    """Return the range of t in a slab of cells.

    A segment has the coordinates p + t (q - p), in cells; the slab has cells `first` to `last`. The range is widened by
    SLACK; it is empty, with start > stop, if the segment misses the slab. Every operation rounds monotonically, so the
    range of several cells contains the range of each. SLACK covers rounding, which grows with the length of the
    segment.
    """
    if abs(q - p) < MIN_EXTENT_CELLS:
        return 0.0, 1.0
    scale = 1.0 / (q - p)
    enter, leave = (first - SLACK - p) * scale, (last + 1 + SLACK - p) * scale
    return max(min(enter, leave), 0.0), min(max(enter, leave), 1.0)


@kernel
def cells_between(p: float, q: float, start: float, stop: float) -> tuple[int, int]:
    """Return the range of cells in a range of t.

    The result is the first and the last cell. A segment has the coordinates p + t (q - p), in cells, for t from
    ``start`` to ``stop``.
    """
    begin, end = p + start * (q - p), p + stop * (q - p)
    return math.ceil(min(begin, end) - SLACK) - 1, math.floor(max(begin, end) + SLACK)


@kernel
def segment_is_free_in_box(slice_: Slice, p: Numbers, q: Numbers, low: Cell, high: Cell) -> bool:
    """Return True if a segment touches only FREE cells in a box.

    The segment leads from `p` to `q`, in cells. The box has the cells from `low` to `high`, both included; cells
    outside it are not tested.
    """
    # Cut the segment into slabs along x, and each slab along y. Each piece touches one run of cells along z.
    first, last = cells_between(p[0], q[0], 0.0, 1.0)
    for i in range(max(low[0], first), min(high[0], last) + 1):
        start, stop = slab_times(p[0], q[0], i, i)
        if start > stop:
            continue
        left, right = cells_between(p[1], q[1], start, stop)
        for j in range(max(low[1], left), min(high[1], right) + 1):
            enter, leave = slab_times(p[1], q[1], j, j)
            enter, leave = max(enter, start), min(leave, stop)
            if enter > leave:
                continue
            bottom, top = cells_between(p[2], q[2], enter, leave)
            if not run_is_free(slice_, i, j, max(low[2], bottom), min(high[2], top)):
                return False
    return True

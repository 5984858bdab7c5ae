"""Compiled tests whether an edge is FREE.

An edge is cut at the borders of rotation cells. Each piece lies in one slice of the map and is walked slab by slab.
Positions are in cells along three axes; a map of the plane has one layer of cells along the first.
"""

from __future__ import annotations

import math

import numpy as np

from cspace.arrays import FREE, Bools, Floats, Words
from cspace.compiling import kernel
from cspace.grid import SLACK
from cspace.map.mip import BLOCK_SHIFT, BLOCK_SIDE, ONE
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
from cspace.map.storage import Map, state_in
from cspace.rotations.records import always_inline

MIN_PROBE_SHARE = 1.0 / 16.0
"""Smallest distance of probes on an edge, as a fraction of its length."""

MIN_PROBE_SPACING_CELLS = 2.0
"""Smallest distance of probes on an edge, in cells."""

MIN_EXTENT_CELLS = 2.0**-500
"""Extent of a segment along an axis, in cells, below which it counts as zero, because dividing by it would overflow."""


@kernel
def edges_are_free(map_: Map, blocks: Words | None, starts: Floats, ends: Floats, out: Bools) -> int:
    """Test whether edges are FREE.

    Edges lead from `starts` to `ends`, shape (n, size); ``out`` has shape (n,). Returns the index of the first
    unusable edge, or -1.
    """
    for edge in range(starts.shape[0]):
        q0, q1 = configuration(map_, starts, edge), configuration(map_, ends, edge)
        if not (is_usable(map_, q0) and is_usable(map_, q1)):
            return edge
        out[edge] = edge_is_free(map_, blocks, q0, q1)
    return -1


@always_inline
def edge_is_free(map_: Map, blocks: Words | None, q0: Numbers, q1: Numbers) -> bool:
    """Return True if an edge is FREE.

    All closed cells within SLACK of it must be FREE. Along an edge the position moves straight and the rotation takes
    the shortest arc. ``blocks`` are those of :class:`cspace.map.mip.OccupancyBits`; if None, the walk over blocks is
    not compiled.
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
        if not segment_is_free(map_, blocks, slice_index, first, last):
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


@always_inline
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


@always_inline
def segment_is_free(map_: Map, blocks: Words | None, slice_index: int, first: Numbers, last: Numbers) -> bool:
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
    if inside:
        if len(first) == 3 and not probes_are_free(slice_, p, q):  # planar maps compile no probes
            return False
        if blocks is not None:
            return segment_is_free_by_blocks(slice_, blocks, slice_index, p, q)
    low, high = slice_.low, slice_.high
    for axis in range(3):
        low = replaced(low, axis, min(low[axis], 0))
        high = replaced(high, axis, max(high[axis], slice_.shape[axis] - 1))
    return segment_is_free_in_box(slice_, p, q, low, high)


@kernel
def probes_are_free(slice_: Slice, p: Numbers, q: Numbers) -> bool:
    """Test a few points of a segment.

    They are its end, its middle, its quarters, and so on. The segment leads from `p` to `q`, in cells. Most edges of a
    planner collide, and probes show it sooner than a walk. If a probe fails, the walk fails too: probes lie on the
    segment up to rounding, which is far below SLACK.
    """
    nx, ny, nz = slice_.shape
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    length = max(max(abs(dx), abs(dy)), abs(dz))
    step = 1.0
    while step >= MIN_PROBE_SHARE and step * length >= MIN_PROBE_SPACING_CELLS:
        t = step
        while t <= 1.0:
            i, j = min(math.floor(p[0] + t * dx), nx - 1), min(math.floor(p[1] + t * dy), ny - 1)
            k = min(math.floor(p[2] + t * dz), nz - 1)
            if state_in(slice_.cells, slice_.start + (i * ny + j) * nz + k) != FREE:
                return False
            t += 2.0 * step
        step *= 0.5
    return True


@always_inline
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


@always_inline
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


@kernel
def segment_is_free_by_blocks(slice_: Slice, blocks: Words, slice_index: int, p: Numbers, q: Numbers) -> bool:
    """Return True if a segment touches only FREE cells of the grid.

    Blocks of FREE cells are skipped. The segment leads from `p` to `q`, in cells. A set bit in ``blocks`` marks a block
    with cells that are not FREE; only there, the cells are tested.
    """
    ground: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type for all three
    nx, ny, nz = slice_.shape
    first, last = cells_between(p[0], q[0], 0.0, 1.0)
    first, last = max(first, 0), min(last, nx - 1)
    # Slabs of blocks along x.
    for a in range(first >> BLOCK_SHIFT, (last >> BLOCK_SHIFT) + 1):
        begin, end = max(first, a << BLOCK_SHIFT), min(last, (a << BLOCK_SHIFT) + BLOCK_SIDE - 1)
        start, stop = slab_times(p[0], q[0], begin, end)
        if start > stop:
            continue
        layer = blocks[slice_index, a >> BLOCK_SHIFT, :, :, a & (BLOCK_SIDE - 1)]
        near, far = cells_between(p[1], q[1], start, stop)
        near, far = max(near, 0), min(far, ny - 1)
        # Rows of blocks along y; `marked` collects the bits of the blocks along z that the segment touches.
        for b in range(near >> BLOCK_SHIFT, (far >> BLOCK_SHIFT) + 1):
            left, right = max(near, b << BLOCK_SHIFT), min(far, (b << BLOCK_SHIFT) + BLOCK_SIDE - 1)
            enter, leave = slab_times(p[1], q[1], left, right)
            enter, leave = max(enter, start), min(leave, stop)
            if enter > leave:
                continue
            bottom, top = cells_between(p[2], q[2], enter, leave)
            line, bit, marked = layer[np.uint64(b >> BLOCK_SHIFT)], b & (BLOCK_SIDE - 1), np.uint64(0)
            for c in range(max(bottom, 0) >> BLOCK_SHIFT, (min(top, nz - 1) >> BLOCK_SHIFT) + 1):
                marked |= line[np.uint64(c >> BLOCK_SHIFT)] >> np.uint64(((c & (BLOCK_SIDE - 1)) << BLOCK_SHIFT) + bit)
            if marked & ONE and not segment_is_free_in_box(slice_, p, q, (begin, left, ground), (end, right, nz - 1)):
                return False
    return True

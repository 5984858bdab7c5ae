"""Compiled tests that all cells on an edge are FREE.

An edge is cut where it leaves a rotation cell. Each piece is walked in that cell's slice, slab by slab. Positions are
in cells along three axes; the plane is space with one layer of cells along the first.
"""

from __future__ import annotations

import math

import numpy as np

from cspace.arrays import FREE, Bools, Floats, Words
from cspace.compiling import always_inline, kernel
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

MIN_PROBE_SHARE = 1.0 / 16.0
"""Minimum distance of probes on an edge, as a share of the edge."""

MIN_PROBE_SPACING_CELLS = 2.0
"""Minimum distance of probes on an edge, in cells."""

MIN_EXTENT_CELLS = 2.0**-500
"""Extent of a segment along an axis, in cells, below which it counts as zero, because dividing by it would overflow."""


@kernel
def edges_are_free(map_: Map, blocks: Words | None, first: Floats, second: Floats, out: Bools) -> int:
    """Test edges (n, size); return the first unusable one, or -1."""
    for k in range(first.shape[0]):
        q0, q1 = configuration(map_, first, k), configuration(map_, second, k)
        if not (is_usable(map_, q0) and is_usable(map_, q1)):
            return k
        out[k] = edge_is_free(map_, blocks, q0, q1)
    return -1


@always_inline
def edge_is_free(map_: Map, blocks: Words | None, q0: Numbers, q1: Numbers) -> bool:
    """Return True if all cells near an edge are FREE.

    They are the closed cells within SLACK of it. Along an edge the position moves straight and the rotation takes the
    shortest arc. ``blocks`` are those of :class:`cspace.map.mip.OccupancyBits`; if None, the walk over blocks is not
    compiled.
    """
    cursor = map_.rotations.first_piece(q0, q1)
    while True:
        more, number, start, stop, cursor = map_.rotations.next_piece(cursor)
        if not more:
            return True
        first, last = map_.lower, map_.lower
        for axis in range(len(map_.lower)):
            first = replaced(first, axis, between(q0[axis], q1[axis], start))
            last = replaced(last, axis, between(q0[axis], q1[axis], stop))
        if not segment_is_free(map_, blocks, number, first, last):
            return False


@kernel
def along(map_: Map, q0: Numbers, q1: Numbers, arc: int, t: float) -> Numbers:
    """Return the configuration at t along a shortest arc.

    ``arc`` selects one of several shortest arcs; see ``arc_count``.
    """
    q = map_.rotations.turned(q0, q1, arc, t)
    for axis in range(len(map_.lower)):
        q = replaced(q, axis, between(q0[axis], q1[axis], t))
    return q


@always_inline
def between(first: float, second: float, t: float) -> float:
    """Interpolate at t in [0, 1], within the ends."""
    if t == 0.0:
        return first
    if t == 1.0:
        return second
    value = first + t * (second - first)
    return min(max(value, min(first, second)), max(first, second))


@always_inline
def segment_is_free(map_: Map, blocks: Words | None, number: int, first: Numbers, last: Numbers) -> bool:
    """Return True if a segment in one slice is FREE."""
    inside: bool = np.bool_(True)  # type: ignore[assignment]  # numba requires one type from the start
    dim, total = len(map_.lower), 0.0
    p, q = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)
    for axis in range(dim):
        lower, upper, a, b = map_.lower[axis], map_.upper[axis], first[axis], last[axis]
        u, v = (a - lower) / map_.spacing, (b - lower) / map_.spacing
        inside &= (min(a, b) >= lower) & (max(a, b) <= upper)
        total += abs(u) + abs(v)
        p, q = replaced(p, 3 - dim + axis, u), replaced(q, 3 - dim + axis, v)
    if not total <= MAX_POSITION:  # True for NaN
        return False
    # A segment that leaves the grid is proven only if all cells outside both grid and box are FREE.
    if not inside and map_.exterior[number, 2 * dim] != FREE:
        return False
    part = get_slice(map_, number, inside)
    if inside:
        if len(first) == 3 and not probes_are_free(part, p, q):  # planar maps compile no probes
            return False
        if blocks is not None:
            return blocks_are_free(part, blocks, number, p, q)
    low, high = part.low, part.high
    for axis in range(3):
        low = replaced(low, axis, min(low[axis], 0))
        high = replaced(high, axis, max(high[axis], part.shape[axis] - 1))
    return slabs_are_free(part, p, q, low, high)


@kernel
def probes_are_free(part: Slice, p: Numbers, q: Numbers) -> bool:
    """Test the end, middle, quarters, ... of a segment.

    Most edges of a planner collide, and probes show it sooner than a walk. If a probe fails, the walk fails too: probes
    lie on the segment up to rounding, which is far below SLACK.
    """
    nx, ny, nz = part.shape
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    cells = max(max(abs(dx), abs(dy)), abs(dz))
    step = 1.0
    while step >= MIN_PROBE_SHARE and step * cells >= MIN_PROBE_SPACING_CELLS:
        t = step
        while t <= 1.0:
            i, j = min(math.floor(p[0] + t * dx), nx - 1), min(math.floor(p[1] + t * dy), ny - 1)
            k = min(math.floor(p[2] + t * dz), nz - 1)
            if state_in(part.cells, part.start + (i * ny + j) * nz + k) != FREE:
                return False
            t += 2.0 * step
        step *= 0.5
    return True


@always_inline
def slab_times(p: float, q: float, first: int, last: int) -> tuple[float, float]:
    """Return the first and last t in some cells.

    The range is widened by SLACK; first > last if there is none. Every operation rounds monotonically, so the range of
    several cells contains the range of each. SLACK covers rounding, which grows with the length of the segment.
    """
    if abs(q - p) < MIN_EXTENT_CELLS:
        return 0.0, 1.0
    scale = 1.0 / (q - p)
    a, b = (first - SLACK - p) * scale, (last + 1 + SLACK - p) * scale
    return max(min(a, b), 0.0), min(max(a, b), 1.0)


@always_inline
def cells_between(p: float, q: float, start: float, stop: float) -> tuple[int, int]:
    """Return the first and last cell for a range of t."""
    a, b = p + start * (q - p), p + stop * (q - p)
    return math.ceil(min(a, b) - SLACK) - 1, math.floor(max(a, b) + SLACK)


@kernel
def slabs_are_free(part: Slice, p: Numbers, q: Numbers, low: Cell, high: Cell) -> bool:
    """Return True if a segment's cells in a range are FREE.

    The segment is cut into slabs along x, and each slab along y; each part meets a run of cells along z.
    """
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
            if not run_is_free(part, i, j, max(low[2], bottom), min(high[2], top)):
                return False
    return True


@kernel
def blocks_are_free(part: Slice, blocks: Words, number: int, p: Numbers, q: Numbers) -> bool:
    """Return True if a segment is FREE, by marked blocks."""
    ground: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type for all three
    nx, ny, nz = part.shape
    first, last = cells_between(p[0], q[0], 0.0, 1.0)
    first, last = max(first, 0), min(last, nx - 1)
    for a in range(first >> BLOCK_SHIFT, (last >> BLOCK_SHIFT) + 1):
        begin, end = max(first, a << BLOCK_SHIFT), min(last, (a << BLOCK_SHIFT) + BLOCK_SIDE - 1)
        start, stop = slab_times(p[0], q[0], begin, end)
        if start > stop:
            continue
        layer = blocks[number, a >> BLOCK_SHIFT, :, :, a & (BLOCK_SIDE - 1)]
        near, far = cells_between(p[1], q[1], start, stop)
        near, far = max(near, 0), min(far, ny - 1)
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
            if marked & ONE and not slabs_are_free(part, p, q, (begin, left, ground), (end, right, nz - 1)):
                return False
    return True

"""Compiled tests whether an edge is FREE.

An edge is cut at the borders of rotation cells. Each piece lies in one slice of the map and is
walked slab by slab. Positions and rotations are as in :mod:`cspace._queries.points`. Each piece of
many edges is tested on a map of blocks of cells first.

A tube is an edge with all configurations near it: each coordinate of the position may differ by a
radius of its own, and the rotation by an angle. The walk is that of an edge, with wider cells.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cspace._grid import SLACK
from cspace._queries.points import (
    MAX_POSITION,
    box_to_test,
    closed_cells,
    configuration_in,
    is_usable,
    neighborhood_is_free,
    position_in_cells,
    quaternion_neighborhood_is_free,
    run_is_free,
    state_at,
)
from cspace._record.cells import Map
from cspace._rotations.lookup import (
    arc_angle_and_error,
    arc_count,
    find_arc,
    find_cell_exit,
    first_widened_cell,
    rotation_along,
    signed_angle,
    widened_bounds,
    wrap_to_cells,
)
from cspace._support.arrays import FREE, MIXED, Bools, Floats, Ints, Numbers, Row, States, read_only
from cspace._support.compiling import inlined, internal, kernel

MIN_EXTENT_CELLS: Final = 2.0**-500
"""Extent of a segment along an axis, in cells, below which it counts as zero, because dividing by
it would overflow."""

BLOCK_SIDE: Final = 8
"""Cells along each side of a block; a power of 2, so that positions in blocks are exact."""

CELLS_PER_EDGE: Final = 1_600
"""Number of cells that are joined to blocks in about the time that they save for one edge."""

MIN_EDGES_FOR_BLOCKS: Final = 100
"""Edges of a batch below which blocks save too little."""

NO_RADII: Final = (0.0, 0.0, 0.0)
"""Radii of a tube that is an edge, metres."""


def coarsen_map(map_: Map) -> Map:
    """Coarsen a map into blocks of cells.

    A block is FREE if all of its cells are. An edge that touches a cell touches its block, also by
    SLACK, which is as many blocks as cells. So edges that are FREE in the result are FREE in
    ``map_``. Nothing outside the grid is FREE.
    """
    slices = map_.states
    # About the number of cells that are joined at once, so that a processor's cache holds them.
    at_once = max(1, 2**22 // slices[0].size)
    parts = [
        _join_cells(slices[first : first + at_once], map_.dim)
        for first in range(0, len(slices), at_once)
    ]
    spacing = BLOCK_SIDE * map_.spacing
    x, y, z = map_.upper
    return map_._replace(
        states=read_only(np.concatenate(parts)),
        spacing=spacing,
        # The last blocks may reach beyond the grid. The layer of the plane is a block thick.
        upper=(spacing if map_.dim == 2 else x, y, z),
        exterior=np.full_like(map_.exterior, MIXED),
    )


def _join_cells(states: States, dim: int) -> States:
    """Return the highest state in each block of slices, shape (slices, nx, ny, nz)."""
    for axis in range(4 - dim, 4):
        cells = np.moveaxis(states, axis, 0)
        blocks = cells[::BLOCK_SIDE].copy(order="K")
        for k in range(1, BLOCK_SIDE):
            layer = cells[k::BLOCK_SIDE]
            np.maximum(blocks[: len(layer)], layer, out=blocks[: len(layer)])
        states = np.moveaxis(blocks, 0, axis)
    return states


@kernel
def edges_are_free(map_: Map, blocks: Map, starts: Floats, ends: Floats, out: Bools) -> int:
    """Write which edges are FREE.

    Returns the index of the first unusable edge, or -1. Edges lead from `starts` to `ends`, shape
    (n, size); ``out`` has shape (n,). ``blocks`` are those of `coarsen_map`, or ``map_`` itself.
    """
    for k in range(starts.shape[0]):
        p0, r0 = configuration_in(map_, starts, k)
        p1, r1 = configuration_in(map_, ends, k)
        if not (is_usable(p0, r0) and is_usable(p1, r1)):
            return k
        out[k] = tube_is_free(map_, p0, r0, p1, r1, NO_RADII, 0.0, blocks)
    return -1


@kernel
def count_free_tubes(map_: Map, sizes: Floats, starts: Floats, ends: Floats, counts: Ints) -> int:
    """Lower the counts to the numbers of tubes that are FREE, from the first on.

    In each of b chunks, tubes lead from a row of ``starts``, shape (b, size), to each of ``ends``,
    shape (b, n, size), in turn. Only as many as ``counts``, shape (b,), are tested. ``sizes``,
    shape (b, 4), are the radii and the turn of the tubes of each chunk; see `tube_is_free`. A tube
    with an end that is not usable is not FREE. Returns -1.
    """
    # Number of short tubes that are tested together.
    tubes_per_box = 4
    for chunk in range(starts.shape[0]):
        radii = sizes[chunk, 0], sizes[chunk, 1], sizes[chunk, 2]
        turn = min(sizes[chunk, 3], math.pi)  # which leads to all rotations
        p0, r0 = configuration_in(map_, starts, chunk)
        wanted = counts[chunk] if is_usable(p0, r0) else 0
        counts[chunk] = 0
        in_free_box = False
        for row in range(wanted):
            if row % tubes_per_box == 0:
                rows = ends[chunk, row : min(row + tubes_per_box, wanted)]
                in_free_box = short_tubes_are_free(map_, p0, r0, rows, max(radii), turn)
            p1, r1 = configuration_in(map_, ends[chunk], row)
            if not (
                in_free_box
                or (is_usable(p1, r1) and tube_is_free(map_, p0, r0, p1, r1, radii, turn))
            ):
                break
            counts[chunk] = row + 1
            p0 = p1
            r0 = r1
    return -1


@internal
def short_tubes_are_free(
    map_: Map, start: Row, first: Numbers, ends: Floats, radius: float, turn: float
) -> bool:
    """Return True if a box of cells around a few short tubes is FREE.

    The tubes lead from the position ``start`` and the yaw ``first`` to each of ``ends``, shape (n,
    size), in turn. The box costs less than the tubes, and proves most of them. False proves
    nothing.
    """
    if len(first) == 4:
        return False
    middle, rotation = configuration_in(map_, ends, len(ends) // 2)
    x, y, z = middle
    reach = max(abs(start[0] - x), abs(start[1] - y), abs(start[2] - z))
    swing, _ = arc_angle_and_error(rotation, first, 0)
    for k in range(len(ends)):
        p, r = configuration_in(map_, ends, k)
        if not is_usable(p, r):
            return False
        reach = max(reach, abs(p[0] - x), abs(p[1] - y), abs(p[2] - z))
        angle, _ = arc_angle_and_error(rotation, r, 0)
        swing = max(swing, angle)
    # Far beyond a right angle, the shortest arc between two yaws would leave the box.
    # Turn from the middle of short tubes, radians, beyond which each is tested alone.
    # Distance from the middle of short tubes, in cells, beyond which each is tested alone.
    if reach > 2.0 * map_.spacing or swing > 0.2:
        return False
    return neighborhood_is_free(map_, middle, rotation, reach + radius, swing + turn)


@inlined
def tube_is_free(
    map_: Map,
    p0: Row,
    r0: Numbers,
    p1: Row,
    r1: Numbers,
    radii: Row,
    turn: float,
    blocks: Map | None = None,
) -> bool:
    """Return True if an edge is FREE with all configurations near it.

    All closed cells within SLACK of these must be FREE. Along an edge the position moves straight
    and the rotation takes the shortest arc; if two arcs are equally short up to rounding, both must
    be FREE. Configurations near it differ from those of the edge by at most ``radii`` along each
    axis, metres, and are rotated by at most ``turn``. In the plane, the first radius is zero.
    ``blocks`` are those of `coarsen_map`, which prove most of an edge.
    """
    if len(r0) == 4:
        if turn > 0.0:
            return quaternion_tube_is_free(map_, p0, r0, p1, r1, max(radii), turn)
        return quaternion_edge_is_free(map_, p0, r0, p1, r1, radii, blocks)
    # Most edges of a planner that collide do so at their end.
    if (blocks is None or state_at(blocks, p1, r1) != FREE) and state_at(map_, p1, r1) != FREE:
        return False
    if len(r0) == 0:
        return piece_is_free(map_, int(map_.rotations.slice_of[0]), p0, p1, radii, blocks)
    borders = map_.rotations.borders
    # Cut the edge at the borders of rotation cells, from the lowest yaw on.
    start = wrap_to_cells(borders, r0[0])
    for arc in range(arc_count(r0, r1)):
        angle = signed_angle(r0[0], r1[0], arc)
        cell = first_widened_cell(borders, min(start, start + angle) - turn)
        index, low, high = widened_bounds(borders, cell)
        # This goes on for NaN as well, which the test of the segment refuses.
        while not low > max(start, start + angle) + turn:
            # Within the turn of the cell, a yaw of the edge may differ so much that it lies there.
            enter, leave = turn_fractions(start, angle, low - turn, high + turn)
            s = int(map_.rotations.slice_of[index])
            first = position_along(p0, p1, enter)
            last = position_along(p0, p1, leave)
            if not piece_is_free(map_, s, first, last, radii, blocks):
                return False
            cell += 1
            index, low, high = widened_bounds(borders, cell)
    return True


@inlined
def turn_fractions(start: float, angle: float, low: float, high: float) -> tuple[float, float]:
    """Return the fractions at which a turn enters and leaves an interval.

    The interval is of yaws, from ``low`` to ``high``. The turn leads from the yaw ``start`` by
    ``angle``; fractions are from 0 to 1.
    """
    if angle == 0.0:
        return 0.0, 1.0
    at_low = min(max((low - start) / angle, 0.0), 1.0)
    at_high = min(max((high - start) / angle, 0.0), 1.0)
    return min(at_low, at_high), max(at_low, at_high)


@internal
def quaternion_edge_is_free(
    map_: Map, p0: Row, r0: Numbers, p1: Row, r1: Numbers, radii: Row, blocks: Map | None
) -> bool:
    """Return True if an edge of a robot with quaternions is FREE, with all positions near it.

    It leads from position p0 and quaternion r0 to p1 and r1. All closed cells within SLACK and
    ``radii`` of it must be FREE, along both arcs if they are equally short up to rounding.
    """
    borders = map_.rotations.borders[0]
    for number in range(arc_count(r0, r1)):
        arc = find_arc(r0, r1, number)
        if not arc.tangent < 2.0:  # only for NaN
            return False
        # Each part of the arc lies in one rotation cell.
        chord_share = 0.0
        enter = 0.0
        has_next = True
        while has_next:
            cell, chord_share, time, has_next = find_cell_exit(borders, arc, chord_share)
            leave = max(time, enter) if has_next else 1.0
            first = p0
            last = p1
            # OMPL's rotation may jump along a tiny arc, so each part must be FREE everywhere.
            if not arc.is_tiny:
                first = position_along(p0, p1, enter)
                last = position_along(p0, p1, leave)
            s = int(map_.rotations.slice_of[cell])
            if not piece_is_free(map_, s, first, last, radii, blocks):
                return False
            enter = leave
    return True


@internal
def quaternion_tube_is_free(
    map_: Map, p0: Row, r0: Numbers, p1: Row, r1: Numbers, radius: float, turn: float
) -> bool:
    """Return True if an edge of a robot with quaternions is FREE with all configurations near it.

    They are at most ``radius`` away along each axis, metres, and rotated by at most ``turn``. Each
    piece of the edge is proven with all configurations near its middle.
    """
    length = max(abs(p1[0] - p0[0]), abs(p1[1] - p0[1]), abs(p1[2] - p0[2]))
    for number in range(arc_count(r0, r1)):
        angle, error = arc_angle_and_error(r0, r1, number)
        # Turn of the pieces of a tube of quaternions, radians, unless the rotation may differ by
        # more.
        pieces = max(length / max(radius, 0.5 * map_.spacing), angle / max(turn, 0.05))
        # Number of pieces beyond which a tube of quaternions counts as not free.
        if not pieces < 2.0**16:  # refuses NaN too
            return False
        count = math.ceil(max(pieces, 1.0))
        reach = radius + 0.5 * length / count
        swing = turn + 0.5 * angle / count + error
        for piece in range(count):
            middle = (piece + 0.5) / count
            position = position_along(p0, p1, middle)
            rotation = rotation_along(r0, r1, number, middle)
            if not quaternion_neighborhood_is_free(map_, position, rotation, reach, swing):
                return False
    return True


@inlined
def position_along(p0: Row, p1: Row, t: float) -> Row:
    """Return the position at t, from 0 to 1, between two positions."""
    return interpolate(p0[0], p1[0], t), interpolate(p0[1], p1[1], t), interpolate(p0[2], p1[2], t)


@inlined
def interpolate(first: float, second: float, t: float) -> float:
    """Interpolate linearly between two numbers, at t in [0, 1].

    Despite rounding, the result stays between them.
    """
    if t == 0.0:
        return first
    if t == 1.0:
        return second
    value = first + t * (second - first)
    return min(max(value, min(first, second)), max(first, second))


@inlined
def piece_is_free(map_: Map, s: int, first: Row, last: Row, radii: Row, blocks: Map | None) -> bool:
    """Return True if a segment touches only FREE cells, as blocks of these may tell sooner."""
    # The map itself stands for blocks that few edges do without.
    if (
        blocks is not None
        and blocks.spacing > map_.spacing
        and segment_is_free(blocks, s, first, last, radii)
    ):
        return True
    return segment_is_free(map_, s, first, last, radii)


@internal
def segment_is_free(map_: Map, s: int, first: Row, last: Row, radii: Row) -> bool:
    """Return True if a segment touches only FREE cells of a slice.

    It leads from `first` to `last`. Cells within ``radii`` of it along each axis, metres, and SLACK
    must be FREE as well.
    """
    p = position_in_cells(map_, first)
    q = position_in_cells(map_, last)
    h = map_.spacing
    reach = radii[0] / h + SLACK, radii[1] / h + SLACK, radii[2] / h + SLACK
    total = 0.0
    for axis in range(3):
        total += abs(p[axis]) + abs(q[axis]) + reach[axis]
    inside = total <= MAX_POSITION  # False for NaN
    if not inside:
        return False
    for axis in range(3):
        # Rounding counts where a radius is added. A mere segment may lie on the border of the grid.
        radius = reach[axis] * h if radii[axis] > 0.0 else 0.0
        inside &= min(first[axis], last[axis]) - radius >= map_.lower[axis]
        inside &= max(first[axis], last[axis]) + radius <= map_.upper[axis]
    # The closed cells of the grid contain all of a segment inside. Any other segment is proven only
    # if all cells outside both grid and exterior box are FREE.
    if not inside and map_.exterior[s, 2 * map_.dim] != FREE:
        return False
    low, high = box_to_test(map_, s, inside)
    # Cut the segment into slabs along x, and each slab along y. Each piece touches one run of cells
    # along z.
    west, east = cells_between(p[0], q[0], 0.0, 1.0, reach[0])
    for i in range(max(low[0], west), min(high[0], east) + 1):
        start, stop = slab_times(p[0], q[0], i, reach[0])
        if start > stop:
            continue
        left, right = cells_between(p[1], q[1], start, stop, reach[1])
        for j in range(max(low[1], left), min(high[1], right) + 1):
            enter, leave = slab_times(p[1], q[1], j, reach[1])
            enter = max(enter, start)
            leave = min(leave, stop)
            if enter > leave:
                continue
            bottom, top = cells_between(p[2], q[2], enter, leave, reach[2])
            if not run_is_free(map_, s, i, j, max(low[2], bottom), min(high[2], top)):
                return False
    return True


@inlined
def slab_times(p: float, q: float, cell: int, reach: float) -> tuple[float, float]:
    """Return the times at which a segment enters and leaves a slab.

    The segment is p + t (q - p) for times t in [0, 1]. Coordinates are in cells. The slab is
    widened by ``reach``, at least SLACK, which covers rounding, because that grows with the length
    of the segment. If the segment misses the slab, start > stop.
    """
    if abs(q - p) < MIN_EXTENT_CELLS:
        return 0.0, 1.0
    rate = 1.0 / (q - p)
    enter = (cell - reach - p) * rate
    leave = (cell + 1 + reach - p) * rate
    return max(min(enter, leave), 0.0), min(max(enter, leave), 1.0)


@inlined
def cells_between(p: float, q: float, start: float, stop: float, reach: float) -> tuple[int, int]:
    """Return the first and last cell within reach of part of a segment.

    The part is p + t (q - p) for t from start to stop. Coordinates are in cells.
    """
    begin = p + start * (q - p)
    end = p + stop * (q - p)
    return closed_cells(min(begin, end) - reach, max(begin, end) + reach)

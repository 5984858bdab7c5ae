"""Compiled passes over the part of a map that a change of the workspace reaches. The plane has one layer of cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Bytes, Ints, Words
from cspace.compiling import jit, reader
from cspace.engines.dilation import FOUR, dilate_block, spread

LOOKED, CHANGED, COUNT = 0, 6, 12
"""Where a row of what :func:`renew_states` gives for a slice has its boxes, first cells and then last ones, and the
number of cells that changed their state."""

ROW = 13
"""Length of such a row."""

_GATHER = np.uint64(0x0102040810204080)
_BYTE = np.uint64(255)


class Robots(NamedTuple):
    """The offsets of a robot's slices, of one side, as rows (first offset, length).

    runs, stops : ndarray of int64, shapes (n, 4) and (slices,)
        Each offset a single time, and where the rows of each slice end.
    fours, fours_stops : ndarray of int64, shapes (m, 4) and (slices,)
        The same by ascending length, in fours of one length, the last of them repeated to fill them up.
    fixed : ndarray of bool, shape (slices,)
        Whether the robot meets the outside from everywhere.
    """

    runs: Ints
    stops: Ints
    fours: Ints
    fours_stops: Ints
    fixed: Bools

    def of(self, start: int, stop: int) -> Robots:
        """Those of some slices, from ``start`` to before ``stop``."""
        first, four = (int(stops[start - 1]) if start else 0 for stops in (self.stops, self.fours_stops))
        last, last_four = int(self.stops[stop - 1]), int(self.fours_stops[stop - 1])
        runs, fours = self.runs[first:last], self.fours[four:last_four]
        stops, fours_stops = self.stops[start:stop] - first, self.fours_stops[start:stop] - four
        return Robots(runs, stops, fours, fours_stops, self.fixed[start:stop])


class MapArrays(NamedTuple):
    """The arrays of a map, and of its workspace, that an update writes to; a plane has one layer of cells.

    states : ndarray of uint8, shape (slices, nx, ny, nz)
    overlaps : ndarray of int32, shape (slices, nx, ny, nz)
        Stored overlaps; empty where there are none.
    outer, inner : ndarray of uint8, shape (nx, ny, nz)
        The cells of the workspace, 0 or 1; ``inner`` may be the same array as ``outer``.
    tallies : ndarray of int64, shape (nx + ny + nz,)
        Numbers of outer cells in each layer along each axis, one axis after the other; empty where they are not needed.
    far, near : Robots
        Outer and inner offsets.
    weights : ndarray of int64, shape (slices,)
        Number of rotation cells that share each slice.
    one, blocked, walled : bool
        Whether ``inner`` is the same array as ``outer``; whether BLOCKED is proven at all; and whether all outside the
        map is obstacle.
    """

    states: Bytes
    overlaps: NDArray[np.int32]
    outer: Bytes
    inner: Bytes
    tallies: Ints
    far: Robots
    near: Robots
    weights: Ints
    one: bool
    blocked: bool
    walled: bool


@jit
def renew(map_: MapArrays, outer: Bytes, inner: Bytes, lower: Ints) -> tuple[Ints, Ints]:
    """Write new cells, and what follows from them, in one call, so that an interrupt finds all of it done or nothing.

    ``outer`` and ``inner`` are the new cells from ``lower`` on. Gives the results of :func:`renew_cells` and
    :func:`renew_states`.
    """
    change = np.empty(outer.shape if map_.overlaps.size > 0 else (0, 0, 0), np.int8)
    changed = renew_cells(map_, outer, inner, lower, change)
    box = changed[:6]
    if changed[6] == 0:
        return changed, np.zeros((len(map_.states) + 1, ROW), np.int64)
    if map_.overlaps.size > 0:
        renew_overlaps(map_.overlaps, change, lower, box, map_.far)
    return changed, renew_states(map_, box)


@jit
def renew_cells(map_: MapArrays, new_outer: Bytes, new_inner: Bytes, lower: Ints, change: NDArray[np.int8]) -> Ints:
    """Write the new cells of a box into a workspace; the box around those that differ, and their number.

    ``change``, empty or of the shape of the new cells, gets what is added to each outer cell.
    """
    outer, inner, tallies = map_.outer, map_.inner, map_.tallies
    nx, ny, nz = new_outer.shape
    x, y, z = lower
    changed = np.array([nx + x, ny + y, nz + z, -1, -1, -1, 0])
    for i in range(nx):
        for j in range(ny):
            old_row, new_row = outer[x + i, y + j], new_outer[i, j]
            old_within, new_within = inner[x + i, y + j], new_inner[i, j]
            for k in range(nz):
                step = int(new_row[k]) - int(old_row[z + k])
                if change.size > 0:
                    change[i, j, k] = step
                if step == 0 and new_within[k] == old_within[z + k]:
                    continue
                old_row[z + k] = new_row[k]
                old_within[z + k] = new_within[k]
                if tallies.size > 0:
                    tallies[x + i] += step
                    tallies[outer.shape[0] + y + j] += step
                    tallies[outer.shape[0] + outer.shape[1] + z + k] += step
                changed[0], changed[3] = min(changed[0], x + i), max(changed[3], x + i)
                changed[1], changed[4] = min(changed[1], y + j), max(changed[4], y + j)
                changed[2], changed[5] = min(changed[2], z + k), max(changed[5], z + k)
                changed[6] += 1
    return changed


@jit
def extents(tallies: Ints, shape: Ints) -> Ints:
    """First and last layer along each axis that is not empty, from numbers of cells in each; (0, -1) without any."""
    layers = np.empty(6, np.int64)
    start = 0
    for axis in range(3):
        first, last = 0, shape[axis] - 1
        while first <= last and tallies[start + first] == 0:
            first += 1
        while last >= first and tallies[start + last] == 0:
            last -= 1
        layers[axis], layers[3 + axis] = first, last
        start += shape[axis]
    return layers


@jit
def renew_states(map_: MapArrays, box: Ints) -> Ints:
    """States of all configurations that a changed box of cells can touch; what has changed, shape (slices + 1, ROW).

    The last row is of all slices together, each counted by its weight.
    """
    stack = map_.states
    rows = np.zeros((stack.shape[0] + 1, ROW), np.int64)
    for s in range(stack.shape[0]):
        far, near = _fours_of(map_.far, s), _fours_of(map_.near, s)
        if not map_.blocked:
            near = near[:0]
        part, row = stack[s], rows[s]
        for axis in range(3):
            row[LOOKED + axis], row[LOOKED + 3 + axis] = part.shape[axis], -1
            row[CHANGED + axis], row[CHANGED + 3 + axis] = part.shape[axis], -1
        if len(far) + len(near) == 0:
            continue
        # Cell k meets obstacle cells k + m, m an offset: what can change lies in the box less the reach of all offsets.
        low, high = np.full(3, 2**62, np.int64), np.full(3, -(2**62), np.int64)
        _reach(far, low, high)
        _reach(near, low, high)
        first, last = np.empty(3, np.int64), np.empty(3, np.int64)
        for axis in range(3):
            first[axis] = max(0, box[axis] - high[axis])
            last[axis] = min(part.shape[axis] - 1, box[3 + axis] - low[axis])
        if first[0] > last[0] or first[1] > last[1] or first[2] > last[2]:
            continue
        for axis in range(3):
            row[LOOKED + axis], row[LOOKED + 3 + axis] = first[axis], last[axis]
        # The obstacles that those cells can meet, in rows of bits, so that 64 cells are dilated at a time.
        tall = last[1] - first[1] + 1 + high[1] - low[1]
        wide = (last[2] - first[2] + high[2] - low[2] + 64) // 64
        words = _pack(map_.outer, first + low, last + high, map_.walled, tall, wide)
        hits = _hits(words, far, low, last - first + 1, tall, wide)
        if not map_.one and len(near) > 0:  # obstacles whose cells met and cells within are not the same
            words = _pack(map_.inner, first + low, last + high, map_.walled, tall, wide)
        deep = _hits(words, near, low, last - first + 1, tall, wide)
        always = _BYTE if map_.far.fixed[s] else np.uint64(0)
        deep_always = _BYTE if map_.near.fixed[s] and map_.blocked else np.uint64(0)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                at = ((x - first[0]) * tall + y - first[1]) * wide
                line = part[x, y][first[2] : last[2] + 1]
                # A state is the sum of two bits. Most cells stay as they are, so that eight are compared in one word.
                eights = line[: len(line) // 8 * 8].view(np.uint64)
                for k in range(len(eights)):
                    place, bit = k // 8, np.uint64(8 * (k % 8))
                    far_byte = ((hits[at + place] >> bit) & _BYTE) | always
                    near_byte = ((deep[at + place] >> bit) & _BYTE) | deep_always
                    states = spread(far_byte) + spread(near_byte)
                    if states != eights[k]:
                        for n in range(8):
                            state = int((states >> np.uint64(8 * n)) & _BYTE)
                            _settle(line, 8 * k + n, state, x, y, first[2], row)
                for k in range(8 * len(eights), len(line)):
                    bit = np.uint64(k % 64)
                    far_byte = (hits[at + k // 64] >> bit) | always
                    near_byte = (deep[at + k // 64] >> bit) | deep_always
                    state = int((far_byte & np.uint64(1)) + (near_byte & np.uint64(1)))
                    _settle(line, k, state, x, y, first[2], row)
    whole = rows[-1]
    for k in range(COUNT):
        whole[k] = rows[0, k]
    for s in range(stack.shape[0]):
        row = rows[s]
        for start in (LOOKED, CHANGED):
            for axis in range(start, start + 3):
                whole[axis] = min(whole[axis], row[axis])
                whole[3 + axis] = max(whole[3 + axis], row[3 + axis])
        whole[COUNT] += map_.weights[s] * row[COUNT]
    return rows


@jit
def _fours_of(robots: Robots, s: int) -> Ints:
    """Rows of a slice, in fours; none where the robot meets the outside from everywhere, and no cell matters."""
    first, end = robots.fours_stops[s - 1] if s > 0 else 0, robots.fours_stops[s]
    return robots.fours[first : first if robots.fixed[s] else end]


@reader
def _settle(line: Bytes, at: int, state: int, x: int, y: int, z: int, row: Ints) -> None:
    """Write the state of a cell, whose line begins at ``z``, and note it if it is another."""
    old = line[at]
    if state == old:
        return
    line[at] = state
    row[COUNT] += 1
    _include(row[CHANGED : CHANGED + 6], x, y, z + at)


@reader
def _include(box: Ints, x: int, y: int, z: int) -> None:
    box[0], box[3] = min(box[0], x), max(box[3], x)
    box[1], box[4] = min(box[1], y), max(box[4], y)
    box[2], box[5] = min(box[2], z), max(box[5], z)


@reader
def _reach(runs: Ints, low: Ints, high: Ints) -> None:
    """Widen the bounds of offsets by those of runs."""
    for n in range(len(runs)):
        for axis in range(3):
            low[axis] = min(low[axis], runs[n, axis])
            high[axis] = max(high[axis], runs[n, axis] + (runs[n, 3] - 1 if axis == 2 else 0))


@jit
def _pack(cells: Bytes, first: Ints, last: Ints, outside: bool, tall: int, wide: int) -> Words:
    """A box of cells, which may stick out of the map, in rows of ``wide`` words, of which a layer has ``tall``.

    Behind them are as many words as the dilation reads past them, at most.
    """
    words = np.zeros((last[0] - first[0] + 1) * tall * wide + 2 * wide + 3, np.uint64)
    begin, end = max(0, first[2]), min(cells.shape[2], last[2] + 1)
    for x in range(max(0, first[0]), min(cells.shape[0], last[0] + 1)):
        for y in range(max(0, first[1]), min(cells.shape[1], last[1] + 1)):
            at = ((x - first[0]) * tall + y - first[1]) * wide
            _pack_row(cells[x, y, begin:end], outside, begin - first[2], words[at : at + wide])
    if outside:  # the free cells were packed
        for k in range(words.size):
            words[k] = ~words[k]
    return words


@jit
def _hits(words: Words, runs: Ints, low: Ints, sizes: Ints, tall: int, wide: int) -> Words:
    """Whether a robot meets any cell of a packed box from each place of another, whose rows are as long.

    The packed box begins ``low`` before the places.
    """
    size = ((sizes[0] - 1) * tall + sizes[1]) * wide
    result = np.zeros(size, np.uint64)
    if len(runs) == 0:
        return result
    table = np.empty((len(runs) // FOUR, 1 + 2 * FOUR), np.uint64)
    most = np.int64(0)
    for n in range(len(runs)):
        bit = ((runs[n, 0] - low[0]) * tall + runs[n, 1] - low[1]) * wide * 64 + runs[n, 2] - low[2]
        four, place = table[n // FOUR], 2 * (n % FOUR)
        four[0], four[1 + place], four[2 + place] = runs[n, 3], bit // 64, bit % 64
        most = max(most, bit // 64)
    reach = size + most + runs[-1, 3] // 64 + 3
    dilate_block(words[:reach], table, np.empty(reach, np.uint64), np.empty(reach, np.uint64), result)
    return result


@reader
def _pack_row(cells: Bytes, flip: bool, first: int, words: Words) -> None:
    """Put cells, each 0 or 1, or what they are not, into words that are 0 from bit ``first`` on."""
    whole, turn = cells.size // 8, _BYTE if flip else np.uint64(0)
    eights = cells[: 8 * whole].view(np.uint64)
    place, filled, word = first // 64, np.uint64(first % 64), np.uint64(0)
    for k in range(whole):
        byte = ((eights[k] * _GATHER) >> np.uint64(56)) ^ turn
        word |= byte << filled
        filled += np.uint64(8)
        if filled >= np.uint64(64):
            words[place] |= word
            place += 1
            filled -= np.uint64(64)
            word = byte >> (np.uint64(8) - filled)
    if word:
        words[place] |= word
    for k in range(8 * whole, cells.size):
        place = first + k
        words[place // 64] |= ((np.uint64(cells[k]) ^ turn) & np.uint64(1)) << np.uint64(place % 64)


@jit
def renew_overlaps(
    overlaps: NDArray[np.int32], change: NDArray[np.int8], lower: Ints, box: Ints, robots: Robots
) -> None:
    """Add the overlaps with changed cells to stored ones, shape (slices, nx, ny, nz).

    ``change``, the first of whose entries is cell ``lower``, is what was added to each cell, all within ``box``.
    """
    runs, stops = robots.runs, robots.stops
    first, last = box[:3], box[3:]
    sums = np.zeros((last[0] - first[0] + 1, last[1] - first[1] + 1, last[2] - first[2] + 2), np.int64)
    for x in range(sums.shape[0]):
        for y in range(sums.shape[1]):
            line = change[first[0] - lower[0] + x, first[1] - lower[1] + y]
            for z in range(sums.shape[2] - 1):
                sums[x, y, z + 1] = sums[x, y, z] + line[first[2] - lower[2] + z]
    count = sums.shape[2] - 1
    for s in range(overlaps.shape[0]):
        part = overlaps[s]
        for n in range(stops[s - 1] if s > 0 else 0, stops[s]):
            length = runs[n, 3]
            for i in range(sums.shape[0]):
                x = first[0] + i - runs[n, 0]
                for j in range(sums.shape[1]):
                    y = first[1] + j - runs[n, 1]
                    if not (0 <= x < part.shape[0] and 0 <= y < part.shape[1]):
                        continue
                    column, line = sums[i, j], part[x, y]
                    # The run covers the cells from z + offset on.
                    shift = runs[n, 2] - first[2]
                    for z in range(max(0, 1 - length - shift), min(part.shape[2], count - shift)):
                        low, high = max(0, z + shift), min(count, z + shift + length)
                        line[z] += column[high] - column[low]

"""Compiled passes over the part of a map that a change of the workspace reaches. The plane has one layer of cells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Bytes, Ints, Words
from cspace.compiling import kernel
from cspace.engines.dilation import FOUR, dilate_block, spread
from cspace.unaligned import load

LOOKED, CHANGED, COUNT = 0, 6, 12
"""Where a row of what :func:`renew` says of a slice has its boxes, first cells and then last ones, and the number of
cells that changed their state."""

ROW = 13
"""Length of such a row."""

_GATHER = np.uint64(0x0102040810204080)
_BYTE, _EIGHT = np.uint64(255), np.uint64(8)


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


class Notes(NamedTuple):
    """What an update says of itself, and what it needs for that.

    changed : ndarray of int64, shape (7,)
        The box around the workspace cells that differ, empty at first, and their number.
    rows : ndarray of int64, shape (slices + 1, ROW)
        What has changed in each slice, and in all together, each counted by its weight; of empty boxes at first, whose
        first cell is the map's shape and whose last one is -1.
    reach : ndarray of int64, shape (6,)
        Room for the least and the greatest offset of a slice.
    sums : ndarray of int64, shape (nx, ny, nz + 1)
        Room for the sums of what is added to the cells of a patch along each row; empty where no overlaps are stored.
    words : ndarray of uint64, shape (5, n)
        Room for what a slice can meet, in rows of bits, for what it meets, and for what that is made from.
    table : ndarray of uint64, shape (n, 1 + 2 * FOUR)
        Room for the offsets of a slice.
    """

    changed: Ints
    rows: Ints
    reach: Ints
    sums: Ints
    words: Words
    table: Words


@kernel
def renew(map_: MapArrays, outer: Bytes, inner: Bytes, lower: Ints, notes: Notes) -> None:
    """Write new cells, and what follows from them, in one call, so that an interrupt finds all of it done or nothing.

    ``outer`` and ``inner`` are the new cells from ``lower`` on; of none, what follows from those noted already.
    """
    renew_cells(map_, outer, inner, lower, notes.changed, notes.sums)
    if notes.changed[6] > 0:
        if map_.overlaps.size > 0:
            renew_overlaps(map_.overlaps, notes.sums, lower, notes.changed, map_.far)
        renew_states(map_, notes)


@kernel
def renew_cells(map_: MapArrays, new_outer: Bytes, new_inner: Bytes, lower: Ints, changed: Ints, sums: Ints) -> None:
    """Write the new cells of a box into a workspace; note those that differ, and sum up what is added to outer ones."""
    tallies, shape = map_.tallies, map_.outer.shape
    for i in range(new_outer.shape[0]):
        for j in range(new_outer.shape[1]):
            x, y, total = lower[0] + i, lower[1] + j, np.int64(0)
            old_row, new_row = map_.outer[x, y], new_outer[i, j]
            old_within, new_within = map_.inner[x, y], new_inner[i, j]
            if sums.size > 0:
                sums[i, j, 0] = 0
            for k in range(new_outer.shape[2]):
                z = lower[2] + k
                step = np.int64(new_row[k]) - np.int64(old_row[z])
                if sums.size > 0:
                    total += step
                    sums[i, j, k + 1] = total
                if step == 0 and new_within[k] == old_within[z]:
                    continue
                old_row[z] = new_row[k]
                old_within[z] = new_within[k]
                if tallies.size > 0:
                    tallies[x] += step
                    tallies[shape[0] + y] += step
                    tallies[shape[0] + shape[1] + z] += step
                _include(changed, 0, x, y, z)
                changed[6] += 1


@kernel
def _include(row: Ints, start: int, x: int, y: int, z: int) -> None:
    """Widen the box that a row has from ``start`` on, by a cell."""
    _widen(row, start, x, x)
    _widen(row, start + 1, y, y)
    _widen(row, start + 2, z, z)


@kernel
def _widen(row: Ints, at: int, first: int, last: int) -> None:
    """Widen a box along one axis."""
    row[at] = min(row[at], first)
    row[at + 3] = max(row[at + 3], last)


@kernel
def extents(tallies: Ints, shape: Ints, layers: Ints) -> None:
    """First and last layer along each axis that is not empty, from numbers of cells in each; (0, -1) without any."""
    start = 0
    for axis in range(3):
        first, last = 0, shape[axis] - 1
        while first <= last and tallies[start + first] == 0:
            first += 1
        while last >= first and tallies[start + last] == 0:
            last -= 1
        layers[axis], layers[3 + axis] = first, last
        start += shape[axis]


@kernel
def renew_states(map_: MapArrays, notes: Notes) -> None:
    """States of all configurations that a changed box of cells can touch."""
    reach, words, whole = notes.reach, notes.words, notes.rows[len(map_.states)]
    for s in range(len(map_.states)):
        part, row = map_.states[s], notes.rows[s]
        start, stop = _fours_of(map_.far, s, True)
        far = map_.far.fours[start:stop]
        start, stop = _fours_of(map_.near, s, map_.blocked)
        near = map_.near.fours[start:stop]
        for axis in range(3):
            reach[axis], reach[3 + axis] = 2**62, -(2**62)
        _reach(far, reach)
        _reach(near, reach)
        if len(far) + len(near) == 0 or not _look(notes.changed, reach, row):
            continue
        # The obstacles that those cells can meet, in rows of bits, so that 64 cells are dilated at a time.
        first_x, first_y, first_z, count = row[0], row[1], row[2], row[5] - row[2] + 1
        tall = row[4] - first_y + 1 + reach[4] - reach[1]
        wide = (count + reach[5] - reach[2] + 63) >> 6
        _pack(map_.outer, row, reach, map_.walled, tall, wide, words[0])
        hits, deep = words[1], words[2]
        _meet(words, far, row, reach, tall, wide, notes.table, hits)
        if not map_.one and len(near) > 0:  # obstacles whose cells met and cells within are not the same
            _pack(map_.inner, row, reach, map_.walled, tall, wide, words[0])
        _meet(words, near, row, reach, tall, wide, notes.table, deep)
        always = _BYTE if map_.far.fixed[s] else np.uint64(0)
        deep_always = _BYTE if map_.near.fixed[s] and map_.blocked else np.uint64(0)
        for x in range(first_x, row[3] + 1):
            for y in range(first_y, row[4] + 1):
                line, at = part[x, y], ((x - first_x) * tall + y - first_y) * wide
                # A state is the sum of two bits. Most cells stay as they are, so that eight are compared in one word.
                for k in range(0, count, 8):
                    word, bit = at + (k >> 6), np.uint64(k & 63)
                    far_byte = ((hits[word] >> bit) & _BYTE) | always
                    near_byte = ((deep[word] >> bit) & _BYTE) | deep_always
                    states = spread(far_byte) + spread(near_byte)
                    if k + 8 > count or states != load(line, first_z + k):
                        for n in range(k, min(k + 8, count)):
                            _settle(line, first_z + n, np.uint8(states & _BYTE), x, y, row)
                            states >>= _EIGHT
        for axis in range(3):
            _widen(whole, LOOKED + axis, row[LOOKED + axis], row[LOOKED + 3 + axis])
            _widen(whole, CHANGED + axis, row[CHANGED + axis], row[CHANGED + 3 + axis])
        whole[COUNT] += map_.weights[s] * row[COUNT]


@kernel
def _fours_of(robots: Robots, s: int, wanted: bool) -> tuple[int, int]:
    """Where the fours of a slice are; none where the robot meets the outside from everywhere, and no cell matters."""
    first: int = robots.fours_stops[s - 1] if s > 0 else 0
    return first, first if robots.fixed[s] or not wanted else robots.fours_stops[s]


@kernel
def _settle(line: Bytes, z: int, state: np.uint8, x: int, y: int, row: Ints) -> None:
    """Write the state of a cell, and note it if it is another."""
    if state != line[z]:
        line[z] = state
        row[COUNT] += 1
        _include(row, CHANGED, x, y, z)


@kernel
def _reach(runs: Ints, reach: Ints) -> None:
    """Widen the bounds of offsets by those of runs."""
    for n in range(len(runs)):
        for axis in range(3):
            _widen(reach, axis, runs[n, axis], runs[n, axis] + (runs[n, 3] - 1 if axis == 2 else 0))


@kernel
def _look(changed: Ints, reach: Ints, row: Ints) -> bool:
    """Note the cells that changed ones can matter to; False, and nothing is noted, without any.

    Cell k meets obstacle cells k + m, m an offset: what can change lies in the box less the reach of all offsets.
    """
    for axis in range(3):
        if changed[3 + axis] < reach[axis] or changed[axis] - reach[3 + axis] >= row[axis]:
            return False
    for axis in range(3):
        row[3 + axis] = min(row[axis] - 1, changed[3 + axis] - reach[axis])
        row[axis] = max(0, changed[axis] - reach[3 + axis])
    return True


@kernel
def _pack(cells: Bytes, row: Ints, reach: Ints, outside: bool, tall: int, wide: int, words: Words) -> None:
    """The cells that those of a row can meet, which may stick out of the map, in rows of words; a layer has ``tall``.

    Behind them are as many words as the dilation reads past them, at most.
    """
    first_x, first_y, first_z = row[0] + reach[0], row[1] + reach[1], row[2] + reach[2]
    begin, end = max(0, first_z), min(cells.shape[2], row[5] + reach[5] + 1)
    size = (row[3] + reach[3] - first_x + 1) * tall * wide + 2 * wide + 3
    for k in range(size):
        words[k] = 0
    for x in range(max(0, first_x), min(cells.shape[0], row[3] + reach[3] + 1)):
        for y in range(max(0, first_y), min(cells.shape[1], row[4] + reach[4] + 1)):
            at = ((x - first_x) * tall + y - first_y) * wide
            _pack_row(cells[x, y], outside, begin, end, 64 * at + begin - first_z, words)
    if outside:  # the free cells were packed
        for k in range(size):
            words[k] = ~words[k]


@kernel
def _meet(words: Words, runs: Ints, row: Ints, reach: Ints, tall: int, wide: int, table: Words, result: Words) -> None:
    """Whether a robot meets any packed cell from each of those of a row, whose rows are as long."""
    size = ((row[3] - row[0]) * tall + row[4] - row[1] + 1) * wide
    most, length = np.int64(0), np.int64(0)
    for n in range(len(runs)):
        bit = ((runs[n, 0] - reach[0]) * tall + runs[n, 1] - reach[1]) * wide * 64 + runs[n, 2] - reach[2]
        four, place, length = table[n // FOUR], 1 + 2 * (n % FOUR), runs[n, 3]
        four[0], four[place], four[place + 1] = length, bit >> 6, bit & 63
        most = max(most, bit >> 6)
    stop, fours = size + most + (length >> 6) + 3, table[: len(runs) // FOUR]
    if len(runs) == 0 or not dilate_block(words[0, :stop], fours, words[3, :stop], words[4, :stop], result[:size]):
        for k in range(size):
            result[k] = 0


@kernel
def _pack_row(cells: Bytes, flip: bool, begin: int, end: int, first: int, words: Words) -> None:
    """Put cells, each 0 or 1, or what they are not, into words that are 0 from bit ``first`` on."""
    turn, eights = _BYTE if flip else np.uint64(0), (end - begin) >> 3
    place, filled, word = first >> 6, np.uint64(first & 63), np.uint64(0)
    for k in range(eights):
        byte = ((load(cells, begin + 8 * k) * _GATHER) >> np.uint64(56)) ^ turn
        word |= byte << filled
        filled += _EIGHT
        if filled >= np.uint64(64):
            words[place] |= word
            place += 1
            filled -= np.uint64(64)
            word = byte >> (_EIGHT - filled)
    if word:
        words[place] |= word
    for k in range(8 * eights, end - begin):
        bit = first + k
        words[bit >> 6] |= ((np.uint64(cells[begin + k]) ^ turn) & np.uint64(1)) << np.uint64(bit & 63)


@kernel
def renew_overlaps(overlaps: NDArray[np.int32], sums: Ints, lower: Ints, box: Ints, robots: Robots) -> None:
    """Add the overlaps with changed cells to stored ones, shape (slices, nx, ny, nz).

    ``sums``, of a patch that begins with cell ``lower``, are those of what was added before each cell of a row, all
    within ``box``.
    """
    runs, count = robots.runs, sums.shape[2] - 1
    for s in range(len(overlaps)):
        part = overlaps[s]
        for n in range(robots.stops[s - 1] if s > 0 else 0, robots.stops[s]):
            i, j, k, length = runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3]
            # The run covers the cells from z + offset on.
            first, stop = max(0, box[2] - k - length + 1), min(part.shape[2], box[5] - k + 1)
            for x in range(max(0, box[0] - i), min(part.shape[0], box[3] - i + 1)):
                for y in range(max(0, box[1] - j), min(part.shape[1], box[4] - j + 1)):
                    column, line = sums[x + i - lower[0], y + j - lower[1]], part[x, y]
                    for z in range(first, stop):
                        low = z + k - lower[2]
                        line[z] += column[min(count, low + length)] - column[max(0, low)]

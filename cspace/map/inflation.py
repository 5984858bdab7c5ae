"""Inflation: the largest clearance that a robot has in each cell of the plane, over all of its rotations.

Clearance is counted from the middle of a cell to the nearest cell that is not FREE, a closed square. In half cells, two
cells that are k cells apart along an axis are ``2 k - 1`` apart, so that squares of distances are exact integers.
Distances within columns come first, then the nearest of the columns around. Both end at a limit, and a cell is skipped
as soon as a slice before has a larger clearance there: for costs, few of all distances are needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Floats, Ints, States
from cspace.compiling import kernel
from cspace.errors import InputError
from cspace.grid import SLACK
from cspace.map.derived import Lock
from cspace.map.storage import Stack
from cspace.threads import in_chunks

Squares = NDArray[np.int32]

MAX_REACH: Final = 16_000
"""Largest distance in cells whose squares, in half cells, two of them added, are integers of 32 bits."""

ROWS_PER_STRIP: Final = 64
"""Rows of cells that are computed together, so that their scratch stays in the cache."""

MIN_ROWS_PER_THREAD: Final = 16
"""Rows of cells below which a second thread costs more than it saves."""

SLICES_PER_BATCH: Final = 8
"""Slices of packed states that are unpacked together."""

MAX_NOTED: Final = 32
"""Changed windows that are noted one by one; of more, the window around all of them."""


class Inflation:
    """The largest clearances over all slices of a map of the plane; they follow updates of the map.

    The states and the table of the exterior are shared, not copied; the lock is held while they change, and while
    clearances are computed.
    """

    def __init__(self, states: Stack, exterior: Ints, lock: Lock) -> None:
        self._states, self._exterior, self._lock = states, exterior, lock
        self._squares = np.empty(states.shape[1:], dtype=np.int32)
        self._reach, self._seen, self._noted = -1, exterior.copy(), list[Ints]()

    def renew(self, boxes: Ints) -> None:
        """Note the box in which states of each slice have changed, shape (slices, 6)."""
        changed = boxes[(boxes[:, :3] <= boxes[:, 3:]).all(axis=1)]
        if len(changed):
            self._noted.append(np.array([changed[:, 1:3].min(axis=0), changed[:, 4:].max(axis=0) + 1]))
        if len(self._noted) > MAX_NOTED:
            self._noted = [_around(self._noted)]

    def clearances(self, limit: float) -> Floats:
        """Return the clearances in cells, shape (nx, ny); infinite where they are above ``limit``.

        Raises InputError if the limit and the map are more than :data:`MAX_REACH` cells wide.
        """
        with self._lock:
            reach = reach_of(limit, self._squares.shape, self._exterior)
            if reach != self._reach or not np.array_equal(self._seen, self._exterior):
                self._reach, self._seen = reach, self._exterior.copy()
                self._noted = [np.array([(0, 0), self._squares.shape])]
            grown = np.array([[-reach], [reach]])
            for window in self._noted:
                # A cell that is farther from the change than the reach keeps its square.
                write_squares(self._states, self._exterior, reach, window + grown, self._squares)
            self._noted = []
            return in_cells(self._squares, reach)


def clearances_of(states: States, exterior: Ints, limit: float) -> Floats:
    """As :meth:`Inflation.clearances`, of one slice, states of shape (nx, ny)."""
    reach, squares = reach_of(limit, states.shape, exterior), np.empty(states.shape, dtype=np.int32)
    write_squares(states[np.newaxis], exterior[np.newaxis], reach, np.array([(0, 0), states.shape]), squares)
    return in_cells(squares, reach)


def reach_of(limit: float, shape: Sequence[int], exterior: Ints) -> int:
    """Return how many cells away the search ends: at the limit, or where nothing follows that is not FREE."""
    boxes = exterior.reshape(-1, exterior.shape[-1])[:, :-1].reshape(-1, 2, len(shape))
    farthest = np.maximum(boxes[:, 1], shape).max() - min(int(boxes[:, 0].min()), 0)
    reach = int(min(math.ceil(max(limit, 0.0)), farthest))
    if reach > MAX_REACH:
        rule, hint = f"at most {MAX_REACH} cells are searched", "pass a smaller radius, or a part of the map"
        raise InputError("inflation_radius", f"reaches {reach} cells beyond the robot", rule, hint, value=limit)
    return reach


def in_cells(squares: Squares, reach: int) -> Floats:
    """Return squares as distances in cells, rounded down as :func:`cspace.map.clearance.clearance_at` does."""
    cells = np.maximum(0.5 * np.sqrt(squares) * (1.0 - 2.0**-48) - 4.0 * SLACK, 0.0)
    cells[squares == (2 * reach + 1) ** 2] = np.inf
    return np.asarray(cells)


def write_squares(states: Stack, exterior: Ints, reach: int, window: Ints, out: Squares) -> None:
    """Write the largest square over some slices into a window of ``out``, its first cell and the one after its last."""
    first, last = np.maximum(window[0], 0).tolist(), np.minimum(window[1], out.shape).tolist()
    part = out[first[0] : last[0], first[1] : last[1]]
    part[...] = 0
    for number, batch in _batches(states):
        table = exterior[number : number + len(batch)]

        def work(start: int, stop: int, batch: States = batch, table: Ints = table) -> int:
            rows, width = min(ROWS_PER_STRIP, stop - start), part.shape[1] + 2 * reach
            counts, line, row = np.empty((rows, width), np.int32), np.empty(width, np.int32), np.empty(width, np.int32)
            mask, best = np.empty(width, np.uint8), np.empty(part.shape[1], np.int32)
            for begin in range(start, stop, ROWS_PER_STRIP):
                strip = part[begin : min(begin + ROWS_PER_STRIP, stop)]
                corner = (first[0] + begin, first[1])
                raise_squares(batch, table, reach, corner, (counts, line, row, mask, best), strip)
            return -1

        in_chunks(work, len(part), MIN_ROWS_PER_THREAD)


def _batches(states: Stack) -> Iterator[tuple[int, States]]:
    """Yield all slices as bytes, some at a time, with the number of the first."""
    if isinstance(states, np.ndarray):
        yield 0, states
        return
    for first in range(0, len(states), SLICES_PER_BATCH):
        yield first, states[first : first + SLICES_PER_BATCH]


def _around(windows: list[Ints]) -> Ints:
    """Return the window around some windows."""
    corners = np.array(windows)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


@kernel
def raise_squares(
    states: States,
    exterior: Ints,
    reach: int,
    corner: tuple[int, int],
    scratch: tuple[Squares, Squares, Squares, States, Squares],
    out: Squares,
) -> None:
    """Raise squares in a window, shape (nx, ny), to those of each slice; its first cell is at ``corner``."""
    counts, line, row, mask, best = scratch
    nx, ny = out.shape
    cap, width, top = np.int32(reach + 1), ny + 2 * reach, np.int32((2 * reach + 1) ** 2)
    for s in range(len(states)):
        # Cells to the nearest one that is not FREE in the same column, from below and from above.
        for backwards in range(2):
            line[:] = cap
            for step in range(nx + reach):
                x = step - reach if backwards == 0 else nx - 1 + reach - step
                read_row(states[s], exterior[s], corner[0] + x, corner[1] - reach, mask)
                for k in range(width):
                    more = min(np.int32(line[k] + np.int32(1)), cap)
                    line[k] = np.int32(0) if mask[k] != FREE else more
                if step >= reach:
                    near = counts[x]
                    for k in range(width):
                        near[k] = line[k] if backwards == 0 else min(near[k], line[k])
        for x in range(nx):
            near, result = counts[x], out[x]
            for k in range(width):
                half = np.int32(np.int32(2) * near[k] - np.int32(1))
                row[k] = np.int32(half * half) if near[k] > 0 else np.int32(0)
            middle = row[reach : reach + ny]
            for k in range(ny):
                best[k] = middle[k]
            for apart in range(1, reach + 1):
                step_square = np.int32((2 * apart - 1) ** 2)
                open_ = np.int32(0)
                for k in range(ny):
                    open_ |= np.int32(best[k] > max(result[k], step_square))
                if open_ == 0:
                    break
                left, right = row[reach - apart : reach - apart + ny], row[reach + apart : reach + apart + ny]
                for k in range(ny):
                    best[k] = min(best[k], np.int32(min(left[k], right[k]) + step_square))
            for k in range(ny):
                result[k] = max(result[k], min(best[k], top))


@kernel
def read_row(states: States, table: Ints, x: int, y: int, mask: States) -> None:
    """Write the states of a row of cells from ``(x, y)`` on; all that is not FREE outside the grid counts as taken."""
    nx, ny = states.shape
    before, stop = min(max(-y, 0), len(mask)), min(max(ny - y, 0), len(mask))
    if x < 0 or x >= nx:
        before, stop = len(mask), len(mask)
    outside = table[4] != FREE
    for k in range(before):
        mask[k] = outside or (table[0] <= x <= table[2] and table[1] <= y + k <= table[3])
    for k in range(stop, len(mask)):
        mask[k] = outside or (table[0] <= x <= table[2] and table[1] <= y + k <= table[3])
    if before < stop:
        cells, inside = states[x, y + before : y + stop], mask[before:stop]
        for k in range(len(inside)):
            inside[k] = cells[k]

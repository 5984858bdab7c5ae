"""Room of lanes: how far one may shift to either side, and how much its robot may grow.

A straight lane at a constant yaw that shifts sideways sweeps a parallelogram. A robot grown by m
lies within m of itself. So both rooms are regions of positions. A cell that meets a strip narrower
than a cell meets the outline of the strip, too. So motions along the outlines of strips prove a
region, if each is narrower than a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace._support.arrays import Bools, Floats, Ints
from cspace.lanes._tubes import Tubes, tubes_are_free
from cspace.lanes._verdicts import LaneMotions

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap

STRIP_CELLS: Final = 0.9
"""Width of the widest strip, in cells."""

LEAST_STEP: Final = 1.0 / 16.0
"""Width of the narrowest strip that is tried, in cells."""

Prove = Callable[[Ints, Floats, Floats], Bools]
"""``prove(rows, low, high)`` returns whether the strips between two rooms are proven free."""


def measure_rooms(
    space: ConfigurationMap,
    motions: LaneMotions,
    by_cells: Bools,
    is_simple: Bools,
    max_room: float,
) -> tuple[Floats, Floats]:
    """Return lower bounds of the rooms of proven motions, and of their margins, metres.

    The rooms have shape (n, 2), left and right in the direction of travel, the margins (n,).
    ``by_cells`` says which motions cells alone prove, ``is_simple`` which shift sideways; all
    others have their margin as room. No bound exceeds ``max_room``.
    """
    tubes = motions.tubes
    count = len(motions.lanes)
    rooms = np.zeros((count, 2))
    margins = np.zeros(count)
    steps = (tubes.ends - tubes.starts)[:, :2]
    lengths = np.hypot(*steps.T)
    ahead = np.zeros((count, 2))
    moves = lengths > 0.0
    ahead[moves] = steps[moves] / lengths[moves, None]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    by_lines = by_cells & is_simple & motions.is_plain

    def shifted(rows: Ints, along: Floats, sideways: Floats) -> tuple[Floats, Floats]:
        """Return the starts and ends of motions, extended along and shifted sideways."""
        first, last = tubes.starts[rows].copy(), tubes.ends[rows].copy()
        aside = left[rows] * sideways[:, None]
        first[:, :2] += aside - ahead[rows] * along[:, None]
        last[:, :2] += aside + ahead[rows] * along[:, None]
        return first, last

    def are_free(*pairs: tuple[Floats, Floats]) -> Bools:
        """Return whether all of several motions of each row are proven by cells."""
        starts, ends = (np.concatenate(rows) for rows in zip(*pairs, strict=True))
        free = np.asarray(space.motion_is_free(starts, ends))
        return np.asarray(free.reshape(len(pairs), -1).all(axis=0))

    def prove_strips(side: float) -> Prove:
        """Return the proof of strips beside straight motions, by cells."""

        def prove(rows: Ints, low: Floats, high: Floats) -> Bools:
            none = np.zeros(len(rows))
            near, far = (shifted(rows, none, side * room) for room in (low, high))
            return are_free(far, (near[0], far[0]), (near[1], far[1]))

        return prove

    def prove_rings(rows: Ints, low: Floats, high: Floats) -> Bools:
        """Prove the ring between two rectangles around straight motions, by cells."""
        one, other = shifted(rows, high, high), shifted(rows, high, -high)
        return are_free(one, other, (one[0], other[0]), (one[1], other[1]))

    def prove_tube_strips(side: float) -> Prove:
        """Return the proof of strips beside straight motions, by the geometry."""

        def prove(rows: Ints, low: Floats, high: Floats) -> Bools:
            first, last = shifted(rows, np.zeros(len(rows)), side * 0.5 * (low + high))
            drifts = 0.5 * (high - low) + tubes.drifts[rows]
            return tubes_are_free(space, Tubes(first, last, drifts, tubes.turns[rows]), True, True)

        return prove

    def prove_grown(rows: Ints, low: Floats, high: Floats) -> Bools:
        """Prove motions of the robot grown by ``high``, by the geometry if cells do not."""
        grown = tubes.take(rows)._replace(drifts=tubes.drifts[rows] + high)
        exact = ~by_cells[rows]
        free = np.zeros(len(rows), dtype=np.bool_)
        for way in (False, True):
            these = exact == way
            free[these] = tubes_are_free(space, grown.take(these), way, True)
        return free

    spacing = space.grid.spacing
    for column, side in enumerate((1.0, -1.0)):
        exact = is_simple & ~by_cells
        for rows, prove in ((by_lines, prove_strips(side)), (exact, prove_tube_strips(side))):
            rooms[rows, column] = _widen(prove, np.flatnonzero(rows), spacing, max_room)
    for rows, prove in ((by_lines, prove_rings), (~by_lines, prove_grown)):
        margins[rows] = _widen(prove, np.flatnonzero(rows), spacing, max_room)
    others = ~(by_lines | (is_simple & ~by_cells))
    rooms[others] = margins[others, None]
    return rooms, margins


def _widen(prove: Prove, rows: Ints, spacing: float, max_room: float) -> Floats:
    """Return the rooms, shape (n,), that strips prove one after another.

    The first strip that is not proven is halved until the rest is a fraction of a cell.
    """
    rooms = np.zeros(len(rows))
    steps = np.full(len(rows), STRIP_CELLS * spacing)
    halved = np.zeros(len(rows), dtype=np.bool_)
    active = np.arange(len(rows))
    while len(active):
        low = rooms[active]
        high = np.minimum(low + steps[active], max_room)
        is_free = prove(rows[active], low, high)
        rooms[active[is_free]] = high[is_free]
        halved[active[~is_free]] = True
        steps[active[halved[active]]] *= 0.5
        is_open = (steps[active] >= LEAST_STEP * spacing) & (rooms[active] < max_room)
        active = active[is_open]
    return rooms

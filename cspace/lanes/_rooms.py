"""Proofs of motions, and room of lanes: how far one may shift, and how much its robot may grow.

The robot in the middle of a strip of positions, grown by half the width of the strip, contains the
robot at each of them. So the strips beside a lane are motions of a grown robot, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace._support.arrays import Bools, Floats, Ints
from cspace.lanes._motions import LaneMotions

if TYPE_CHECKING:
    from cspace._space import CSpace

ROOM_STEP: Final = 1.0 / 8.0
"""Largest step, in cells, in which rooms are measured."""


def prove(space: CSpace, motions: LaneMotions, by_geometry: bool) -> Bools:
    """Return whether cells, or the geometry, prove each motion free, shape (n,)."""
    is_free = np.zeros(len(motions.lanes), dtype=np.bool_)
    growths = motions.growths + motions.spares if by_geometry else motions.growths
    for growth in np.unique(growths):
        rows = np.flatnonzero(growths == growth)
        starts, ends = motions.starts[rows], motions.ends[rows]
        if by_geometry:
            is_free[rows] = space._boundary_proofs().are_free(starts, ends, float(growth))
        elif growth == 0.0:
            is_free[rows] = space.motion_is_free(starts, ends)
        else:
            counts = np.ones(len(rows), dtype=np.int64)
            radii = np.array([growth, growth, 0.0])[: space.size]
            space._count_free_tubes(starts, ends[:, np.newaxis], radii, counts)
            is_free[rows] = counts > 0
    return is_free


def measure_rooms(
    space: CSpace, motions: LaneMotions, by_cells: Bools, is_straight: Bools, max_room: float
) -> Floats:
    """Return lower bounds of the rooms of proven motions, and of their margins, metres.

    The result has shape (n, 3): left and right in the direction of travel, and the margin.
    ``by_cells`` says of which motions cells alone prove rooms; ``is_straight`` which motions shift
    sideways; the margin of others is their room. No bound exceeds ``max_room``.
    """
    steps = (motions.ends - motions.starts)[:, :2]
    lengths = np.hypot(*steps.T)
    shifts = is_straight & (lengths > 0.0)
    left = np.column_stack([-steps[:, 1], steps[:, 0]])
    left[shifts] /= lengths[shifts, np.newaxis]

    def prove_beyond(side: float, rows: Ints, low: Floats, high: Floats) -> Bools:
        """Return whether rooms are ``high``, if they are ``low``; ``side`` is 0 for margins."""
        strips = motions.take(rows)
        aside = 0.5 * side * (low + high)[:, np.newaxis] * left[rows]
        strips.starts[:, :2] += aside
        strips.ends[:, :2] += aside
        strips = strips._replace(growths=strips.growths + (0.5 * (high - low) if side else high))
        is_free = prove(space, strips, by_geometry=False)
        rest = np.flatnonzero(~is_free & ~by_cells[rows])
        is_free[rest] = prove(space, strips.take(rest), by_geometry=True)
        return is_free

    rooms = np.zeros((len(lengths), 3))
    for column, side in enumerate((1.0, -1.0, 0.0)):
        rows = np.flatnonzero(shifts) if side else np.arange(len(lengths))

        def prove_rows(
            chosen: Ints, low: Floats, high: Floats, side: float = side, rows: Ints = rows
        ) -> Bools:
            """Prove some of the rows; see ``prove_beyond``."""
            return prove_beyond(side, rows[chosen], low, high)

        rooms[rows, column] = _widen(prove_rows, len(rows), space.grid.spacing, max_room)
    rooms[~shifts, :2] = rooms[~shifts, 2:]
    return rooms


def _widen(
    prove_beyond: Callable[[Ints, Floats, Floats], Bools],
    count: int,
    spacing: float,
    max_room: float,
) -> Floats:
    """Return the rooms, shape (count,), that steps prove one after another.

    A step that is not proven is halved. Rooms are whole numbers of the least step, so that steps of
    many motions are equal, and are proven at once.
    """
    halvings = math.ceil(math.log2(max(max_room / (ROOM_STEP * spacing), 1.0)))
    least = max_room / 2**halvings
    rooms = np.zeros(count, dtype=np.int64)
    steps = np.full(count, 2**halvings)
    active = np.arange(count if max_room > 0.0 else 0)
    while len(active):
        next_rooms = np.minimum(rooms[active] + steps[active], 2**halvings)
        is_free = prove_beyond(active, least * rooms[active], least * next_rooms)
        rooms[active[is_free]] = next_rooms[is_free]
        steps[active[~is_free]] //= 2
        active = active[(steps[active] > 0) & (rooms[active] < 2**halvings)]
    return least * rooms

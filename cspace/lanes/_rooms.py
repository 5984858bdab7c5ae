"""Proofs of motions, and room of lanes: how far one may shift, and how much its robot may grow.

The robot in the middle of a strip of positions, grown by half the width of the strip, contains the
robot at each of them. So the strips beside a lane are motions of a grown robot, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from cspace.inside import Bools, Floats, Ints, proofs_of, tubes_are_free
from cspace.lanes._lane_motions import LaneMotions

if TYPE_CHECKING:
    from cspace import CSpace

Corners = list[tuple[Floats, Floats, Floats]]
"""Configurations, and how far they are shifted along motions and to the left, metres."""

ARC_CHORDS: Final = 8
"""Number of chords of the half circles around the ends of a motion."""


def prove(space: CSpace, motions: LaneMotions, by_geometry: bool) -> Bools:
    """Return whether cells, or the geometry, prove each motion free, shape (n,)."""
    if not by_geometry:
        radii = np.zeros((len(motions.lanes), space.size))
        radii[:, :2] = motions.growths[:, np.newaxis]
        return tubes_are_free(space, motions.starts, motions.ends, radii)
    is_free = np.zeros(len(motions.lanes), dtype=np.bool_)
    growths = motions.growths + motions.spares
    for growth in np.unique(growths):
        rows = np.flatnonzero(growths == growth)
        starts, ends = motions.starts[rows], motions.ends[rows]
        is_free[rows] = proofs_of(space).are_free(starts, ends, float(growth))
    return is_free


def measure_rooms(
    space: CSpace, motions: LaneMotions, by_cells: Bools, is_straight: Bools, max_room: float
) -> Floats:
    """Bound rooms and margins of proven motions from below, metres.

    The result has shape (n, 3): left and right in the direction of travel, and the margin.
    ``by_cells`` says of which motions cells alone prove rooms; ``is_straight`` which motions shift
    sideways; the margin of others is their room. No bound exceeds ``max_room``.
    """
    steps = (motions.ends - motions.starts)[:, :2]
    lengths = np.hypot(*steps.T)
    shifts = is_straight & (lengths > 0.0)
    ahead = steps / np.where(shifts, lengths, 1.0)[:, np.newaxis]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])

    def shift(points: Floats, rows: Ints, along: Floats, aside: Floats) -> Floats:
        """Shift configurations along motions and to the left."""
        shifted = points[rows]
        shifted[:, :2] += along[:, np.newaxis] * ahead[rows] + aside[:, np.newaxis] * left[rows]
        return shifted

    def prove_outline(rows: Ints, corners: Corners, growth: Floats | float) -> Bools:
        """Return whether cells prove motions between corners, in turn.

        A corner has the end that is shifted, and how far along and to the left.
        """
        is_free = np.ones(len(rows), dtype=np.bool_)
        places = [shift(points, rows, along, aside) for points, along, aside in corners]
        for starts, ends in pairwise(places):
            side = motions.take(rows)
            side = side._replace(starts=starts, ends=ends, growths=side.growths + growth)
            is_free[is_free] = prove(space, side.take(is_free), by_geometry=False)
        return is_free

    def prove_ring(rows: Ints, low: Floats, high: Floats) -> Bools:
        """Return whether cells prove all between two distances from straight motions."""
        middle = 0.5 * (low + high)
        angles = np.linspace(0.5, -0.5, ARC_CHORDS + 1) * math.pi
        around = [
            (motions.ends, math.cos(angle) * middle, math.sin(angle) * middle) for angle in angles
        ]
        around += [(motions.starts, -along, -aside) for _, along, aside in around]
        # The chords of an arc leave it by its height.
        height = middle * (1.0 - math.cos(0.5 * math.pi / ARC_CHORDS))
        return prove_outline(rows, [*around, around[0]], 0.5 * (high - low) + height)

    def prove_strip(side: float, rows: Ints, low: Floats, high: Floats) -> Bools:
        """Return whether cells prove strips beside straight motions free.

        Strip k lies between the distances ``low[k]`` and ``high[k]`` from motion ``rows[k]``,
        metres, on its left if ``side`` is 1, on its right if it is -1.
        """
        start, end = motions.starts, motions.ends
        along = np.zeros_like(low)
        corners = [(start, along, side * low), (start, along, side * high)]
        corners += [(end, along, side * high), (end, along, side * low)]
        # No cell fits inside a strip this narrow: any that meets it meets its outline.
        is_narrow = high - low < 0.9 * space.grid.spacing
        return is_narrow & prove_outline(rows, corners, 0.0)

    def prove_beyond(side: float, rows: Ints, low: Floats, high: Floats) -> Bools:
        """Return whether ``low`` rooms are ``high``; ``side`` 0 for margins."""
        aside = 0.5 * side * (low + high)
        growth = 0.5 * (high - low) if side else high
        strips = motions.take(rows)._replace(
            starts=shift(motions.starts, rows, 0.0 * aside, aside),
            ends=shift(motions.ends, rows, 0.0 * aside, aside),
            growths=motions.growths[rows] + growth,
        )
        is_free = prove(space, strips, by_geometry=False)
        rest = np.flatnonzero(~is_free & shifts[rows])
        prove_cells = partial(prove_strip, side) if side else prove_ring
        is_free[rest] = prove_cells(rows[rest], low[rest], high[rest])
        rest = np.flatnonzero(~is_free & ~by_cells[rows])
        is_free[rest] = prove(space, strips.take(rest), by_geometry=True)
        return is_free

    rooms = np.full((len(lengths), 3), max_room)
    straight, whole = np.flatnonzero(shifts), np.arange(len(lengths))
    for column, side, rows in ((0, 1.0, straight), (1, -1.0, straight), (2, 0.0, whole)):
        # No margin exceeds a room, so that margins come last.
        limits = rooms[:, column] if side else rooms.min(axis=1)
        prove_more = partial(prove_beyond, side)
        rooms[rows, column] = _widen(prove_more, rows, limits, space.grid.spacing)[rows]
    rooms[~shifts, :2] = rooms[~shifts, 2:]
    return rooms


def _widen(
    prove_more: Callable[[Ints, Floats, Floats], Bools], rows: Ints, limits: Floats, spacing: float
) -> Floats:
    """Return rooms of some rows, up to limits, proven stepwise.

    A step that is not proven is halved. Rooms are whole numbers of the least step, so that steps of
    many motions are equal, and are proven at once.
    """
    largest = float(limits.max(initial=np.finfo(np.float64).tiny))
    # Largest step, in cells, in which rooms are measured.
    halvings = math.ceil(math.log2(max(largest / (spacing / 8.0), 1.0)))
    least = largest / 2**halvings
    limits = np.rint(limits / least).astype(np.int64)
    rooms = np.zeros(len(limits), dtype=np.int64)
    steps = np.full(len(limits), 2**halvings)
    active = rows[limits[rows] > 0]
    while len(active):
        more = np.minimum(rooms[active] + steps[active], limits[active])
        is_free = prove_more(active, least * rooms[active], least * more)
        rooms[active[is_free]] = more[is_free]
        steps[active[~is_free]] //= 2
        active = active[(steps[active] > 0) & (rooms[active] < limits[active])]
    return np.asarray(least * rooms)

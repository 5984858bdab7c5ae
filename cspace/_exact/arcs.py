"""Arcs along which a rigid robot moves, and the cells that prove parts of them."""

from __future__ import annotations

from typing import Final, NamedTuple

from cspace._queries.edges import NO_RADII, position_along, tube_is_free
from cspace._queries.points import state_at
from cspace._record.cells import Map
from cspace._rotations.lookup import rotation_along
from cspace._support.arrays import Numbers, Row
from cspace._support.compiling import internal

MAX_PENDING_PARTS: Final = 64
"""Capacity of the stack of unproven parts of an arc; each level halves the parts, down to
:data:`cspace._bodies.MIN_ADVANCE`."""


class EdgeArc(NamedTuple):
    """One of the arcs along which the robot may move between two configurations.

    Attributes
    ----------
    p0, p1 : tuple of float
        Positions at both ends.
    r0, r1 : tuple of float
        Rotations at both ends.
    number : int
        Number of the arc; 0 for the shorter one.
    angle : float
        Rotation, radians.
    angle_error : float
        Angle by which the rotation may jump. If it is not zero, a part may be at any rotation of
        the whole arc, so that cells prove nothing.
    required : float
        Distance that proves a configuration free, in the lengths of the bodies.
    """

    p0: Row
    r0: Numbers
    p1: Row
    r1: Numbers
    number: int
    angle: float
    angle_error: float
    required: float


@internal
def reference_point(map_: Map, position: Row, scale: float) -> Row:
    """Return the reference point of the robot in space, times ``scale``."""
    x, y, z = position
    # Positions of the plane have their two coordinates last; the plane lies at z = 0.
    if map_.dim == 2:
        return scale * y, scale * z, 0.0
    return scale * x, scale * y, scale * z


@internal
def arc_state(map_: Map, arc: EdgeArc, t: float) -> int:
    """Return the state of an arc's cell at t, from 0 to 1."""
    position = position_along(arc.p0, arc.p1, t)
    return int(state_at(map_, position, rotation_along(arc.r0, arc.r1, arc.number, t)))


@internal
def cells_are_free(map_: Map, arc: EdgeArc, first: float, last: float) -> bool:
    """Return True if FREE cells prove a part of an arc.

    The part reaches from ``first`` to ``last``, in [0, 1].
    """
    if arc.angle_error > 0.0:
        return False
    start = position_along(arc.p0, arc.p1, first)
    end = position_along(arc.p0, arc.p1, last)
    start_rotation = rotation_along(arc.r0, arc.r1, arc.number, first)
    end_rotation = rotation_along(arc.r0, arc.r1, arc.number, last)
    return bool(tube_is_free(map_, start, start_rotation, end, end_rotation, NO_RADII, 0.0))

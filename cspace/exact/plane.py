"""Compiled proofs in the plane, of configurations and of motions, where the map cannot decide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit, reader
from cspace.exact import ADVANCE, MOST_DISTANCES, ROUNDING, SHORTEST
from cspace.exact.segments import Border, Outline, Scene, gap, is_nested, place
from cspace.grid import MAX_COORDINATE
from cspace.map import turning
from cspace.map.edges import NO_BLOCKS, along, edge_is_free
from cspace.map.points import Numbers, configuration, halves, is_usable, state_at
from cspace.map.record import Map
from cspace.states import BLOCKED, FREE

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SLIDE = 4.0
"""Length of a sweep, in shortest walks: longer ones meet many segments, of which few come near."""


class World(NamedTuple):
    """What every proof needs: the map, the obstacles and the robot."""

    map: Map
    scene: Scene
    outline: Outline


@inner(forceinline=True)
def yaw_of(q: Numbers) -> float:
    """The yaw of a configuration, zero where the robot does not turn."""
    yaw = 0.0
    for axis in range(2, len(q)):
        yaw = q[axis]
    return yaw


@jit
def ask_point(world: World, q: Numbers) -> int:
    """Whether a configuration is free: how many distances that took, zero or above; or -1 less that number."""
    return _ask_point(world, room_for(world.outline), q)


@inner(_nrt=True)
def room_for(outline: Outline) -> Floats:
    """Room for the segments of the placed robot; threads that shared it would spoil each other's."""
    return np.empty((len(outline.segments), 8))


@inner
def _ask_point(world: World, rows: Floats, q: Numbers) -> int:
    state = state_at(world.map, q)
    if state == FREE:
        return 0
    if state == BLOCKED:
        return -1
    scene, border, outline = world.scene, world.scene.border, world.outline
    placed = place(outline, rows, q[0], q[1], yaw_of(q), (0.0, 0.0))
    least = border.least + ROUNDING * (abs(q[0]) + abs(q[1]))
    if gap(border, outline, placed, least, border.reach) <= least or is_nested(scene, outline, placed):
        return -2
    return 1


@inner
def _ask_way(world: World, rows: Floats, q0: Numbers, q1: Numbers, way: int) -> int:
    """As :func:`ask_point`, for all configurations on one of the shortest ways from one to another.

    FREE cells are walked without asking for distances. Elsewhere, a way without a turn is proven by distances from
    what the border sweeps; one with a turn by conservative advancement: a point of the robot moves by at most ``speed``
    times the part of the way, so that a distance proves the configurations before and after it.
    """
    space, scene, border, outline = world.map, world.scene, world.scene.border, world.outline
    dx, dy, angle = q1[0] - q0[0], q1[1] - q0[1], turning.turn_of(space.rotations, q0, q1, way)[0]
    size = abs(q0[0]) + abs(q0[1]) + abs(q1[0]) + abs(q1[1])
    if not size <= 2.0 * MAX_COORDINATE * space.spacing:
        return -1
    least = border.least + ROUNDING * size
    speed = math.hypot(dx, dy) + outline.rho * angle
    walk = shortest_walk = 4.0 * space.spacing / speed if speed > 0.0 else 1.0
    slides = outline.rho * angle == 0.0
    proven, leap, asked = 0.0, 0.0, 0
    while True:
        # All before `proven` is free. A distance a leap ahead may reach back to there, and proves twice as much.
        at = min(proven + leap, 1.0)
        q = along(space, q0, q1, way, at)
        state = state_at(space, q)
        if state == BLOCKED:
            return -1 - asked
        if state == FREE:
            # Walks grow as long as they succeed, so that a long way through FREE cells is few calls.
            stop = min(max(at, proven + walk), 1.0)
            if edge_is_free(space, NO_BLOCKS, along(space, q0, q1, way, proven), along(space, q0, q1, way, stop)):
                if stop == 1.0:
                    return asked
                proven, leap, walk = stop, 0.0, 2.0 * walk
                continue
            walk = max(0.5 * walk, shortest_walk)
        if asked == MOST_DISTANCES:
            return -1 - asked
        asked += 1
        stop = min(at + SLIDE * shortest_walk, 1.0) if slides else at
        placed = place(outline, rows, q[0], q[1], yaw_of(q), ((stop - at) * dx, (stop - at) * dy))
        spare = gap(border, outline, placed, least, border.reach) - least
        if spare <= 0.0:
            return -1 - asked
        # As long as no borders meet, whether one lies within the other stays as it is.
        if asked == 1 and is_nested(scene, outline, placed):
            return -1 - asked
        if slides:
            if stop == 1.0:
                return asked
            proven = stop
            continue
        part = ADVANCE * spare / speed
        if at - part > proven:  # too far ahead: the distance does not reach back
            leap = 0.0
            continue
        if at + part >= 1.0:
            return asked
        if part < SHORTEST:
            return -1 - asked
        proven, leap = at + part, 0.9 * part


@jit
def ask_edge(world: World, both: Numbers) -> int:
    """As :func:`ask_point`, for an edge by its ends in a row; where two ways are equally long, both are proven."""
    q0, q1 = halves(world.map, both)
    return _ask_edge(world, room_for(world.outline), q0, q1)


@inner
def _ask_edge(world: World, rows: Floats, q0: Numbers, q1: Numbers) -> int:
    asked = 0
    if edge_is_free(world.map, NO_BLOCKS, q0, q1):
        return asked
    for way in range(turning.arc_count(world.map.rotations, q0, q1)):
        more = _ask_way(world, rows, q0, q1, way)
        if more < 0:
            return more - asked
        asked += more
    return asked


@jit
def ask_points(world: World, points: Floats, out: Bools) -> int:
    """Whether points, shape (n, dof), are free; the index of the first one that is not usable, or -1."""
    rows = room_for(world.outline)
    for k in range(points.shape[0]):
        q = configuration(world.map, points, k)
        if not is_usable(world.map, q):
            return k
        out[k] = _ask_point(world, rows, q) >= 0
    return -1


@jit
def ask_edges(world: World, starts: Floats, ends: Floats, out: Bools) -> int:
    """The same of edges, shapes (n, dof)."""
    rows = room_for(world.outline)
    for k in range(starts.shape[0]):
        q0, q1 = configuration(world.map, starts, k), configuration(world.map, ends, k)
        if not (is_usable(world.map, q0) and is_usable(world.map, q1)):
            return k
        out[k] = _ask_edge(world, rows, q0, q1) >= 0
    return -1


@reader
def least_spare(
    border: Border, outline: Outline, rows: Floats, points: Floats, lengths: Floats, turns: Floats
) -> float:
    """By how much the least distance on pieces of a path exceeds what it has to, metres; zero if not proven to.

    The pieces are given by their middles, shape (n, 2) or (n, 3), metres and radians; no borders may lie nested there.
    ``rows`` is room for the segments of the placed robot.
    """
    best = math.inf
    for k in range(len(points)):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2] if points.shape[1] == 3 else 0.0
        least, half = border.least + ROUNDING * (abs(x) + abs(y)), 0.5 * (lengths[k] + outline.rho * turns[k])
        # What is farther away than elsewhere on the path is not looked for.
        apart = gap(border, outline, place(outline, rows, x, y, yaw, (0.0, 0.0)), least, best + half)
        best = min(best, apart - least - half)
        if best <= 0.0:
            return 0.0
    return best

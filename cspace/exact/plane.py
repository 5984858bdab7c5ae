"""Compiled proofs in the plane, of configurations and of motions, where the map cannot decide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit
from cspace.exact import ADVANCE, MOST_DISTANCES, ROUNDING, SHORTEST
from cspace.exact.segments import Outline, Scene, gap, is_nested, place
from cspace.grid import MAX_COORDINATE
from cspace.map import turning
from cspace.map.edges import NO_BLOCKS, edge_is_free
from cspace.map.points import Numbers, is_usable, replaced, state_at
from cspace.map.record import Map
from cspace.map.turning import shorter_turn
from cspace.rotations import TURN, YAW_SLACK
from cspace.states import BLOCKED, FREE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SLIDE = 4.0
"""Length of a sweep, in shortest walks: longer ones meet many segments, of which few come near."""


class World(NamedTuple):
    """What every proof needs: the map, the obstacles and the robot."""

    map: Map
    scene: Scene
    outline: Outline


class Stretch(NamedTuple):
    """A motion on which x, y and yaw change linearly; the end is kept as it was given, for no rounding to move it."""

    x: float
    y: float
    yaw: float
    end_x: float
    end_y: float
    turn: float


@inner(forceinline=True)
def _configuration(map_: Map, x: float, y: float, yaw: float) -> Numbers:
    """What the map is asked about: without the yaw, if the robot does not turn."""
    q: Numbers = map_.lower + turning.origin(map_.rotations)
    for axis in range(2, len(q)):
        q = replaced(q, axis, yaw)
    return replaced(replaced(q, 0, x), 1, y)


@inner
def _state(map_: Map, x: float, y: float, yaw: float) -> int:
    """State of one configuration."""
    return state_at(map_, _configuration(map_, x, y, yaw))


@inner
def _walk(map_: Map, way: Stretch, start: float, stop: float) -> bool:
    """Whether every closed cell that meets a part of a stretch is FREE."""
    dx, dy = way.end_x - way.x, way.end_y - way.y
    q0 = _configuration(map_, way.x + start * dx, way.y + start * dy, way.yaw + start * way.turn)
    x1, y1 = (way.end_x, way.end_y) if stop == 1.0 else (way.x + stop * dx, way.y + stop * dy)
    q1 = _configuration(map_, x1, y1, way.yaw + stop * way.turn)
    return bool(edge_is_free(map_, NO_BLOCKS, q0, q1))


@jit
def ask_point(world: World, x: float, y: float, yaw: float) -> int:
    """Whether a configuration is free: how many distances that took, zero or above; or -1 less that number."""
    state = _state(world.map, x, y, yaw)
    if state == FREE:
        return 0
    if state == BLOCKED:
        return -1
    scene, outline = world.scene, world.outline
    placed = place(outline, x, y, yaw, (0.0, 0.0))
    least = scene.least + ROUNDING * (abs(x) + abs(y))
    if gap(scene, outline, placed, least, scene.reach) <= least or is_nested(scene, outline, placed):
        return -2
    return 1


@inner(_nrt=True)
def _ask_stretch(world: World, way: Stretch) -> int:
    """As :func:`ask_point`, for all configurations of a stretch.

    FREE cells are walked without asking for distances. Elsewhere, a stretch without a turn is proven by distances from
    what the border sweeps; one with a turn by conservative advancement: a point of the robot moves by at most ``speed``
    times the part of the stretch, so that a distance proves the configurations before and after it.
    """
    space, scene, outline = world.map, world.scene, world.outline
    if _walk(space, way, 0.0, 1.0):
        return 0
    dx, dy = way.end_x - way.x, way.end_y - way.y
    size = abs(way.x) + abs(way.y) + abs(way.end_x) + abs(way.end_y)
    if not size <= 2.0 * MAX_COORDINATE * space.spacing:
        return -1
    least = scene.least + ROUNDING * size
    speed = math.hypot(dx, dy) + outline.rho * abs(way.turn)
    walk = shortest_walk = 4.0 * space.spacing / speed if speed > 0.0 else 1.0
    slides = outline.rho * way.turn == 0.0
    proven, leap, asked = 0.0, 0.0, 0
    while True:
        # All before `proven` is free. A distance a leap ahead may reach back to there, and proves twice as much.
        at = min(proven + leap, 1.0)
        x, y, yaw = way.x + at * dx, way.y + at * dy, way.yaw + at * way.turn
        state = _state(space, x, y, yaw)
        if state == BLOCKED:
            return -1 - asked
        if state == FREE:
            # Walks grow as long as they succeed, so that a long way through FREE cells is few calls.
            stop = min(max(at, proven + walk), 1.0)
            if _walk(space, way, proven, stop):
                if stop == 1.0:
                    return asked
                proven, leap, walk = stop, 0.0, 2.0 * walk
                continue
            walk = max(0.5 * walk, shortest_walk)
        if asked == MOST_DISTANCES:
            return -1 - asked
        asked += 1
        stop = min(at + SLIDE * shortest_walk, 1.0) if slides else at
        placed = place(outline, x, y, yaw, ((stop - at) * dx, (stop - at) * dy))
        spare = gap(scene, outline, placed, least, scene.reach) - least
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
def ask_edge(world: World, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> int:
    """As :func:`ask_point`, for an edge along the shorter arc; along both where they are equal but for rounding."""
    turn = shorter_turn(yaw0, yaw1)
    asked = _ask_stretch(world, Stretch(x0, y0, yaw0, x1, y1, turn))
    if asked < 0 or math.pi - abs(turn) > YAW_SLACK:
        return asked
    other = turn - TURN if turn > 0.0 else turn + TURN
    more = _ask_stretch(world, Stretch(x0, y0, yaw0, x1, y1, other))
    return asked + more if more >= 0 else more - asked


@jit
def ask_points(world: World, points: Floats, out: Bools, counts: Ints) -> int:
    """``ask_point`` of points, shape (n, 2) or (n, 3); the index of the first one that is not usable, or -1.

    ``counts`` grows by how many points took a distance, and by how many distances were taken.
    """
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2] if points.shape[1] == 3 else 0.0
        if not is_usable(world.map, _configuration(world.map, x, y, yaw)):
            return k
        asked = ask_point(world, x, y, yaw)
        out[k] = asked >= 0
        number = asked if asked >= 0 else -1 - asked
        counts[0] += number > 0
        counts[1] += number
    return -1


@jit
def ask_edges(world: World, starts: Floats, ends: Floats, out: Bools, counts: Ints) -> int:
    """``ask_edge`` of edges, shapes (n, 2) or (n, 3); as :func:`ask_points`."""
    for k in range(starts.shape[0]):
        x0, y0, yaw0 = starts[k, 0], starts[k, 1], starts[k, 2] if starts.shape[1] == 3 else 0.0
        x1, y1, yaw1 = ends[k, 0], ends[k, 1], ends[k, 2] if ends.shape[1] == 3 else 0.0
        if not is_usable(world.map, _configuration(world.map, x0, y0, yaw0)):
            return k
        if not is_usable(world.map, _configuration(world.map, x1, y1, yaw1)):
            return k
        asked = ask_edge(world, x0, y0, yaw0, x1, y1, yaw1)
        out[k] = asked >= 0
        number = asked if asked >= 0 else -1 - asked
        counts[0] += number > 0
        counts[1] += number
    return -1


@jit
def least_spare(world: World, points: Floats, lengths: Floats, turns: Floats) -> float:
    """By how much the least distance on pieces of a path exceeds what it has to, metres; zero if not proven to.

    The pieces are given by their middles, shape (n, 2) or (n, 3), metres and radians; no borders may lie nested there.
    """
    scene, outline, best = world.scene, world.outline, math.inf
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2] if points.shape[1] == 3 else 0.0
        least, half = scene.least + ROUNDING * (abs(x) + abs(y)), 0.5 * (lengths[k] + outline.rho * turns[k])
        # What is farther away than elsewhere on the path is not looked for.
        apart = gap(scene, outline, place(outline, x, y, yaw, (0.0, 0.0)), least, best + half)
        best = min(best, apart - least - half)
        if best <= 0.0:
            return 0.0
    return best

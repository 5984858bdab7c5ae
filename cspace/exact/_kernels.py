"""Compiled proofs by distances, of configurations and of motions, where the map cannot decide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.exact import ROUNDING
from cspace.exact.borders._kernels import Body, Scene, gap, is_nested, place
from cspace.grid import MAX_COORDINATE
from cspace.rotations import TURN, YAW_SLACK
from cspace.states import BLOCKED, FREE
from cspace.turning._kernels import is_usable, shorter_turn, stretch_is_free, turning_state_at

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ADVANCE = 0.999
"""Part of a proven distance that is used, so that its end is proven too."""

MOST_DISTANCES = 10_000
"""Distances after which a stretch is given up as not proven: it grazes an obstacle."""

SLIDE = 4.0
"""Length of a sweep, in shortest walks: longer ones meet many pieces, of which few come near."""

SHORTEST = 2.0**-44
"""Least part of a stretch to advance by; below it the stretch grazes an obstacle."""


class Map(NamedTuple):
    """A stack of slices, as :mod:`cspace.turning._kernels` has it; one slice for a robot that only translates."""

    state: NDArray[np.uint8]
    slice_of: Ints
    borders: Floats
    frame: Floats
    boxes: Ints
    beyonds: Ints


@njit(cache=True, nogil=True)
def _state(space: Map, x: float, y: float, yaw: float) -> int:
    """State of one configuration."""
    boxes, beyonds = space.boxes, space.beyonds
    return int(turning_state_at(space.state, space.slice_of, space.borders, space.frame, boxes, beyonds, x, y, yaw))


@njit(cache=True, nogil=True)
def _walk(space: Map, x0: float, y0: float, yaw0: float, x1: float, y1: float, turn: float) -> bool:
    """Whether every closed cell that meets a stretch is FREE."""
    state, slice_of, borders, frame = space.state, space.slice_of, space.borders, space.frame
    boxes, beyonds = space.boxes, space.beyonds
    return bool(stretch_is_free(state, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, turn))


@njit(cache=True, nogil=True)
def ask_point(space: Map, scene: Scene, body: Body, x: float, y: float, yaw: float) -> int:
    """Whether a configuration is free: how many distances that took, zero or above; or -1 less that number."""
    state = _state(space, x, y, yaw)
    if state == FREE:
        return 0
    if state == BLOCKED:
        return -1
    placed, box = np.empty((body.pieces.shape[0], 8)), np.empty(4)
    place(body, x, y, yaw, 0.0, 0.0, placed, box)
    least = scene.least + ROUNDING * (abs(x) + abs(y))
    if gap(scene, space.frame, body, placed, box, 0.0, 0.0, least) <= least:
        return -2
    return -2 if is_nested(scene, space.frame, body, placed, box, x, y, yaw) else 1


@njit(cache=True, nogil=True)
def _ask_stretch(
    space: Map,
    scene: Scene,
    body: Body,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    turn: float,
) -> int:
    """As :func:`ask_point`, for all configurations of a stretch on which x, y and yaw change linearly.

    FREE cells are walked without asking for distances. Elsewhere, a stretch without a turn is proven by distances from
    what the border sweeps; one with a turn by conservative advancement: a point of the robot moves by at most ``speed``
    times the part of the stretch, so that a distance proves the configurations before and after it.
    """
    if _walk(space, x0, y0, yaw0, x1, y1, turn):
        return 0
    size, dx, dy = abs(x0) + abs(y0) + abs(x1) + abs(y1), x1 - x0, y1 - y0
    if not size <= 2.0 * MAX_COORDINATE * space.frame[2]:
        return -1
    least = scene.least + ROUNDING * size
    placed, box = np.empty((body.pieces.shape[0], 8)), np.empty(4)
    speed = math.hypot(dx, dy) + body.rho * abs(turn)
    walk = shortest_walk = 4.0 * space.frame[2] / speed if speed > 0.0 else 1.0
    slides = body.rho * turn == 0.0
    proven, leap, asked = 0.0, 0.0, 0
    while True:
        # All before `proven` is free. A distance a leap ahead may reach back to there, and proves twice as much.
        at = min(proven + leap, 1.0)
        x, y, yaw = x0 + at * dx, y0 + at * dy, yaw0 + at * turn
        state = _state(space, x, y, yaw)
        if state == BLOCKED:
            return -1 - asked
        if state == FREE:
            stop = min(max(at, proven + walk), 1.0)
            x, y, yaw = x0 + proven * dx, y0 + proven * dy, yaw0 + proven * turn
            if _walk(space, x, y, yaw, x0 + stop * dx, y0 + stop * dy, (stop - proven) * turn):
                if stop == 1.0:
                    return asked
                proven, leap, walk = stop, 0.0, 2.0 * walk
                continue
            walk = max(0.5 * walk, shortest_walk)
            x, y, yaw = x0 + at * dx, y0 + at * dy, yaw0 + at * turn
        if asked == MOST_DISTANCES:
            return -1 - asked
        asked += 1
        stop = min(at + SLIDE * shortest_walk, 1.0) if slides else at
        vx, vy = (stop - at) * dx, (stop - at) * dy
        place(body, x, y, yaw, vx, vy, placed, box)
        spare = gap(scene, space.frame, body, placed, box, vx, vy, least) - least
        if spare <= 0.0:
            return -1 - asked
        # As long as no borders meet, whether one lies within the other stays as it is.
        if asked == 1 and is_nested(scene, space.frame, body, placed, box, x, y, yaw):
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


@njit(cache=True, nogil=True)
def ask_edge(
    space: Map,
    scene: Scene,
    body: Body,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> int:
    """As :func:`ask_point`, for an edge along the shorter arc; along both where they are equal but for rounding."""
    turn = shorter_turn(yaw0, yaw1)
    asked = _ask_stretch(space, scene, body, x0, y0, yaw0, x1, y1, turn)
    if asked < 0 or math.pi - abs(turn) > YAW_SLACK:
        return asked
    other = turn - TURN if turn > 0.0 else turn + TURN
    more = _ask_stretch(space, scene, body, x0, y0, yaw0, x1, y1, other)
    return asked + more if more >= 0 else more - asked


@njit(cache=True, nogil=True)
def ask_points(space: Map, scene: Scene, body: Body, points: Floats, out: Bools, counts: Ints) -> int:
    """``ask_point`` of points, shape (n, 3); the index of the first one that is not usable, or -1.

    ``counts`` grows by how many points took a distance, and by how many distances were taken.
    """
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2]
        if not is_usable(x, y, yaw):
            return k
        asked = ask_point(space, scene, body, x, y, yaw)
        out[k] = asked >= 0
        number = asked if asked >= 0 else -1 - asked
        counts[0] += number > 0
        counts[1] += number
    return -1


@njit(cache=True, nogil=True)
def ask_edges(space: Map, scene: Scene, body: Body, starts: Floats, ends: Floats, out: Bools, counts: Ints) -> int:
    """``ask_edge`` of edges, shapes (n, 3); as :func:`ask_points`."""
    for k in range(starts.shape[0]):
        x0, y0, yaw0 = starts[k, 0], starts[k, 1], starts[k, 2]
        x1, y1, yaw1 = ends[k, 0], ends[k, 1], ends[k, 2]
        if not (is_usable(x0, y0, yaw0) and is_usable(x1, y1, yaw1)):
            return k
        asked = ask_edge(space, scene, body, x0, y0, yaw0, x1, y1, yaw1)
        out[k] = asked >= 0
        number = asked if asked >= 0 else -1 - asked
        counts[0] += number > 0
        counts[1] += number
    return -1

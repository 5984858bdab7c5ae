"""Compiled look-ups of configurations ``(x, y, yaw)``.

A *stack* ``(state, slice_of, borders, frame, boxes, beyonds)`` holds the slices, shape (slices, nx, ny); the slice of
each rotation cell; the ascending borders of the rotation cells; and, as :mod:`cspace._kernels` has them, the frame and
what lies outside the grid of each slice.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace._kernels import clearance_at, edge_is_free, overlap_at, square_is_free, state_at
from cspace.rotations import MAX_YAW, TURN, YAW_SLACK

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stack = NDArray[np.uint8]


@njit(cache=True, nogil=True)
def is_usable(x: float, y: float, yaw: float) -> bool:
    """Whether all is finite, and the yaw can be wrapped exactly enough."""
    return math.isfinite(x) and math.isfinite(y) and abs(yaw) <= MAX_YAW


@njit(cache=True, nogil=True)
def rotation_cell(borders: Floats, yaw: float) -> int:
    """Rotation cell of a yaw, wrapped; a border belongs to the cell above it."""
    wrapped = yaw - math.floor((yaw - borders[0]) / TURN) * TURN
    low, high = 0, borders.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if wrapped >= borders[middle]:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def turning_state_at(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    x: float,
    y: float,
    yaw: float,
) -> int:
    """State of one configuration."""
    s = slice_of[rotation_cell(borders, yaw)]
    return int(state_at(state[s], frame, boxes[s], beyonds[s], x, y))


@njit(cache=True, nogil=True)
def classify(
    state: Stack, slice_of: Ints, borders: Floats, frame: Floats, boxes: Ints, beyonds: Ints, points: Floats, out: Stack
) -> int:
    """States of points, shape (n, 3); the index of the first point that is not usable, or -1."""
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2]
        if not is_usable(x, y, yaw):
            return k
        out[k] = turning_state_at(state, slice_of, borders, frame, boxes, beyonds, x, y, yaw)
    return -1


@njit(cache=True, nogil=True)
def shorter_turn(first: float, second: float) -> float:
    """Signed angle from one yaw to another along the shorter arc, in [-pi, pi]."""
    turn = second - first
    turn -= math.floor(turn / TURN) * TURN
    return turn - TURN if turn > math.pi else turn


@njit(cache=True, nogil=True)
def first_cell(borders: Floats, least: float) -> int:
    """First rotation cell, widened by YAW_SLACK, that holds an angle; counted beyond 0 and n, n cells to a turn."""
    count = borders.shape[0] - 1
    wraps = math.floor((least - borders[0]) / TURN)
    k = rotation_cell(borders, least)
    on_border = least - (borders[k] + wraps * TURN) <= YAW_SLACK
    return int(k + wraps * count - (1 if on_border else 0))


@njit(cache=True, nogil=True)
def stretch_is_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    turn: float,
) -> bool:
    """Whether every closed cell that meets a stretch, on which x, y and yaw change linearly, is FREE.

    The stretch is cut where it leaves a rotation cell, widened by YAW_SLACK, and each part is walked in its slice.
    """
    count = slice_of.shape[0]
    start = yaw0 - math.floor((yaw0 - borders[0]) / TURN) * TURN
    least, most = min(start, start + turn), max(start, start + turn)
    cell = first_cell(borders, least)
    while True:
        wraps = math.floor(cell / count)
        k = cell - wraps * count
        low = borders[k] + wraps * TURN - YAW_SLACK
        high = borders[k + 1] + wraps * TURN + YAW_SLACK
        if low > most:
            return True
        a, b = 0.0, 1.0
        if turn != 0.0:
            a = min(max((low - start) / turn, 0.0), 1.0)
            b = min(max((high - start) / turn, 0.0), 1.0)
            a, b = min(a, b), max(a, b)
        ax, ay = _between(x0, x1, a), _between(y0, y1, a)
        bx, by = _between(x0, x1, b), _between(y0, y1, b)
        s = slice_of[k]
        if not edge_is_free(state[s], frame, boxes[s], beyonds[s], ax, ay, bx, by):
            return False
        cell += 1


@njit(cache=True, nogil=True)
def _between(first: float, second: float, t: float) -> float:
    """The number at t in [0, 1] on the way from one to another, never outside."""
    value = first + t * (second - first)
    return min(max(value, min(first, second)), max(first, second))


@njit(cache=True, nogil=True)
def boxes_are_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    distance: float,
    angle: float,
    points: Floats,
    out: NDArray[np.bool_],
) -> int:
    """Whether all cells are FREE that meet a box of configurations around points, shape (n, 3).

    The box reaches ``distance`` along x and along y, and ``angle`` in yaw. Gives the index of the first point that is
    not usable, or -1.
    """
    count = slice_of.shape[0]
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2]
        if not is_usable(x, y, yaw):
            return k
        start = yaw - math.floor((yaw - borders[0]) / TURN) * TURN
        reach = min(angle, math.pi)
        cell = first_cell(borders, start - reach)
        out[k] = True
        for _ in range(count):
            wraps = math.floor(cell / count)
            if borders[cell - wraps * count] + wraps * TURN - YAW_SLACK > start + reach:
                break
            s = slice_of[cell - wraps * count]
            if not square_is_free(state[s], frame, boxes[s], beyonds[s], x, y, distance):
                out[k] = False
                break
            cell += 1
    return -1


@njit(cache=True, nogil=True)
def turning_edge_is_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    x0: float,
    y0: float,
    yaw0: float,
    x1: float,
    y1: float,
    yaw1: float,
) -> bool:
    """``stretch_is_free`` along the shorter arc; along both where they are equally long but for rounding."""
    turn = shorter_turn(yaw0, yaw1)
    if not stretch_is_free(state, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, turn):
        return False
    if math.pi - abs(turn) > YAW_SLACK:
        return True
    other = turn - TURN if turn > 0.0 else turn + TURN
    return stretch_is_free(state, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, other)


@njit(cache=True, nogil=True)
def edges_are_free(
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    starts: Floats,
    ends: Floats,
    out: NDArray[np.bool_],
) -> int:
    """``turning_edge_is_free`` of edges, shapes (n, 3); the index of the first one that is not usable, or -1."""
    for k in range(starts.shape[0]):
        x0, y0, yaw0 = starts[k, 0], starts[k, 1], starts[k, 2]
        x1, y1, yaw1 = ends[k, 0], ends[k, 1], ends[k, 2]
        if not (is_usable(x0, y0, yaw0) and is_usable(x1, y1, yaw1)):
            return k
        out[k] = turning_edge_is_free(state, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, yaw1)
    return -1


@njit(cache=True, nogil=True)
def turning_clearance_at(
    squares: NDArray[np.int32],
    some: NDArray[np.bool_],
    walls: Floats,
    wall_ends: Ints,
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    x: float,
    y: float,
    yaw: float,
) -> float:
    """Clearance of one configuration in the slice of its yaw; ``walls`` of slice s end before ``wall_ends[s]``."""
    s = slice_of[rotation_cell(borders, yaw)]
    own = walls[(wall_ends[s - 1] if s > 0 else 0) : wall_ends[s]]
    return clearance_at(squares[s], state[s], frame, boxes[s], beyonds[s], own, some[s], x, y)


@njit(cache=True, nogil=True)
def clearances(
    squares: NDArray[np.int32],
    some: NDArray[np.bool_],
    walls: Floats,
    wall_ends: Ints,
    state: Stack,
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    boxes: Ints,
    beyonds: Ints,
    points: Floats,
    out: Floats,
) -> int:
    """``turning_clearance_at`` of points, shape (n, 3); the index of the first one that is not usable, or -1."""
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2]
        if not is_usable(x, y, yaw):
            return k
        out[k] = turning_clearance_at(
            squares, some, walls, wall_ends, state, slice_of, borders, frame, boxes, beyonds, x, y, yaw
        )
    return -1


@njit(cache=True, nogil=True)
def overlaps(
    sums: NDArray[np.int32],
    slice_of: Ints,
    borders: Floats,
    frame: Floats,
    runs: Ints,
    run_ends: Ints,
    outside: int,
    points: Floats,
    out: Ints,
) -> int:
    """Overlaps at points, shape (n, 3); ``runs`` of slice s end before ``run_ends[s]``."""
    for k in range(points.shape[0]):
        x, y, yaw = points[k, 0], points[k, 1], points[k, 2]
        if not is_usable(x, y, yaw):
            return k
        s = slice_of[rotation_cell(borders, yaw)]
        own = runs[(run_ends[s - 1] if s > 0 else 0) : run_ends[s]]
        out[k] = overlap_at(sums, frame, own, outside, x, y)
    return -1

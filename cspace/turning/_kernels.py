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

from cspace._kernels import (
    ASK,
    BLOCK,
    INSIDE,
    clearance_at,
    coarse_edge_is_free,
    edge_is_free,
    overlap_at,
    read_states,
    scaled,
    square_is_free,
    state_at,
)
from cspace.rotations import MAX_YAW, TURN, YAW_SLACK

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stack = NDArray[np.uint8]

MOST_TURNS = MAX_YAW / TURN - 4.0
"""Turns from the first border within which a yaw is usable for sure."""


@njit(cache=True, nogil=True)
def is_usable(x: float, y: float, yaw: float) -> bool:
    """Whether all is finite, and the yaw can be wrapped exactly enough."""
    return math.isfinite(x) and math.isfinite(y) and abs(yaw) <= MAX_YAW


@njit(cache=True, nogil=True)
def rotation_cell(borders: Floats, yaw: float) -> int:
    """Rotation cell of a yaw, wrapped; a border belongs to the cell above it."""
    return cell_of_wrapped(borders, yaw - math.floor((yaw - borders[0]) / TURN) * TURN)


@njit(cache=True, nogil=True)
def cell_of_wrapped(borders: Floats, wrapped: float) -> int:
    """Rotation cell of a yaw from the first border to the last: guessed as if cells were equal, and searched if not."""
    count = borders.shape[0] - 1
    guess = (wrapped - borders[0]) * (count / TURN)
    low = np.int64(guess) if 0.0 <= guess < count else 0
    if borders[np.uint64(low)] <= wrapped < borders[np.uint64(low + 1)]:
        return int(low)
    low, high = 0, count
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
def cells_of(uvw: Floats, slices: Ints, shape: tuple[int, int, int], cells: Ints, codes: Stack) -> int:
    """Cells and codes of points, as :func:`cspace._kernels.cells_of` has them; of ``uvw`` the third is in whole turns.

    Whatever is outside the grid has the code ASK.
    """
    nx, ny = float(shape[1]), float(shape[2])
    asked = 0
    for k in range(cells.shape[0]):
        u, v, turns = uvw[3 * k], uvw[3 * k + 1], uvw[3 * k + 2]
        inside = (u >= 0.0) & (u < nx) & (v >= 0.0) & (v < ny) & (abs(turns) < MOST_TURNS)
        cells[k] = (slices[k] * shape[1] + np.int64(u)) * shape[2] + np.int64(v) if inside else 0
        codes[k] = INSIDE if inside else ASK
        asked += 0 if inside else 1
    return asked


@njit(cache=True, nogil=True)
def slices_at(points: Floats, uvw: Floats, slice_of: Ints, borders: Floats, out: Ints) -> None:
    """Slices of points whose yaws are, in ``uvw``, whole turns above the first border; of unusable ones any."""
    for k in range(points.shape[0]):
        wrapped = points[k, 2] - math.floor(uvw[3 * k + 2]) * TURN
        out[k] = slice_of[np.uint64(cell_of_wrapped(borders, wrapped))]


@njit(cache=True, nogil=True)
def classify(
    state: Stack, slice_of: Ints, borders: Floats, frame: Floats, boxes: Ints, beyonds: Ints, points: Floats, out: Stack
) -> int:
    """States of points, shape (n, 3); the index of the first point that is not usable, or -1."""
    flat, numbers = state.ravel(), points.reshape(-1)
    size = min(BLOCK, len(points))
    lows, scales, uvw = np.empty(3 * size), np.full(3 * size, frame[2]), np.empty(3 * size)
    lows[0::3], lows[1::3], lows[2::3], scales[2::3] = frame[0], frame[1], borders[0], TURN
    cells, codes, slices = np.empty(size, np.int64), np.empty(size, np.uint8), np.empty(size, np.int64)
    for first in range(0, points.shape[0], BLOCK):
        last = min(first + BLOCK, points.shape[0])
        scaled(numbers[3 * first : 3 * last], lows, scales, uvw)
        slices_at(points[first:last], uvw, slice_of, borders, slices)
        asked = cells_of(uvw, slices, state.shape, cells[: last - first], codes)
        read_states(flat, cells[: last - first], codes, out[first:last])
        if asked == 0:
            continue
        for k in range(first, last):
            if codes[k - first] == ASK:
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
    """Whether every closed cell that meets a stretch, on which x, y and yaw change linearly, is FREE."""
    return coarse_stretch_is_free(
        state, state[:0], slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, turn
    )


@njit(cache=True, nogil=True, inline="always")  # a call takes as long as a short edge
def coarse_stretch_is_free(
    state: Stack,
    coarse: Stack,
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
    """``stretch_is_free`` with the help of a coarse map, which may be empty.

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
        if coarse.shape[0] == 0:
            free = edge_is_free(state[s], frame, boxes[s], beyonds[s], ax, ay, bx, by)
        else:
            free = coarse_edge_is_free(state[s], coarse[s], frame, boxes[s], beyonds[s], ax, ay, bx, by)
        if not free:
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

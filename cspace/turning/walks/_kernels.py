"""Compiled walks along edges on which a robot turns; a stack is as in :mod:`cspace.turning._kernels`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.rotations import TURN, YAW_SLACK
from cspace.turning._kernels import coarse_stretch_is_free, is_usable, shorter_turn

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Stack = NDArray[np.uint8]


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
    return coarse_turn_is_free(state, state[:0], slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, yaw1)


@njit(cache=True, nogil=True, inline="always")  # a call takes as long as a short edge
def coarse_turn_is_free(
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
    yaw1: float,
) -> bool:
    """``coarse_stretch_is_free`` along the shorter arc; along both where they are equally long but for rounding."""
    turn = shorter_turn(yaw0, yaw1)
    if not coarse_stretch_is_free(state, coarse, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, turn):
        return False
    if math.pi - abs(turn) > YAW_SLACK:
        return True
    other = turn - TURN if turn > 0.0 else turn + TURN
    return coarse_stretch_is_free(state, coarse, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, other)


@njit(cache=True, nogil=True)
def edges_are_free(
    state: Stack,
    coarse: Stack,
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
        out[k] = coarse_turn_is_free(
            state, coarse, slice_of, borders, frame, boxes, beyonds, x0, y0, yaw0, x1, y1, yaw1
        )
    return -1

"""Moves between the centers of cells, or other nodes of a grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from cspace.inside import Floats, Ints


class Moves(NamedTuple):
    """Moves from a node to near nodes of its slice.

    Attributes
    ----------
    steps : ndarray of int64, shape (m, 3)
        Offset of the node that each move leads to.
    lengths : ndarray of float64, shape (m,)
        Length of each move, in cells.
    near_cells : ndarray of int64, shape (n, 3)
        Offsets from the node to the cells that its moves may touch.
    needed : ndarray of int64, shape (m,)
        Bit mask of the near cells that must be passable for each move.
    """

    steps: Ints
    lengths: Floats
    near_cells: Ints
    needed: Ints


@cache
def list_moves(dim: int) -> Moves:
    """List moves between centers of cells, shortest first.

    The offsets of a move have no common divisor.
    """
    largest = (0, 2, 2) if dim == 2 else (1, 1, 1)
    ranges = [range(-offset, offset + 1) for offset in largest]
    steps = [step for step in product(*ranges) if math.gcd(*step) == 1]
    # Largest sum of the offsets of a move along all axes, in cells.
    steps = [step for step in steps if sum(map(abs, step)) <= 3]
    steps.sort(key=lambda step: math.hypot(*step))
    # The near cells are the ends of the moves, so bit b of a mask is the end of move b.
    masks = []
    for step in steps:
        touched_bits = [_touches(step, cell) << bit for bit, cell in enumerate(steps)]
        masks.append(sum(touched_bits))
    offsets = np.array(steps)
    return Moves(offsets, np.linalg.norm(offsets, axis=1), offsets, np.array(masks))


def _touches(move: tuple[int, ...], cell: tuple[int, ...]) -> bool:
    """Return True if a move touches a cell.

    The move is the segment from the center of cell (0, 0, 0) to the center of cell ``move``; the
    cell is closed.
    """
    lower = [index - 0.5 for index in cell]
    enter, leave = times_in_box(move, lower)
    return enter <= leave


def times_in_box(step: Sequence[int], lower: Sequence[float]) -> tuple[float, float]:
    """Return the fractions at which a segment enters and leaves a box.

    The segment starts at zero; the box is a cell with the corner ``lower``. The first fraction is
    above the second if the segment misses the box.
    """
    enter = 0.0
    leave = 1.0
    for length, low in zip(step, lower, strict=True):
        high = low + 1.0
        if length != 0:
            enter = max(enter, min(low / length, high / length))
            leave = min(leave, max(low / length, high / length))
        elif not low <= 0.0 <= high:
            return 1.0, 0.0
    return enter, leave

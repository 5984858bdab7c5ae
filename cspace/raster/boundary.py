"""The outline of a set of grid cells, as straight segments."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import finite, positive


def boundary_segments(occupied: ArrayLike, spacing: float, lower: ArrayLike) -> NDArray[np.float64]:
    """Segments between the occupied cells of a plane grid and everything else.

    Unit edges that follow one another are merged, so that the count grows with the corners of the outline and not with
    its length. Every piece of the outline is in exactly one segment, which is what even-odd parity needs; where two
    cells touch only in a corner, both pass through it. All coordinates come from ``lower + spacing * index``, so
    segments that meet share the corner to the last bit.

    Parameters
    ----------
    occupied : array-like of bool, shape (nx, ny)
        The cells; whatever lies beyond the array is not occupied.
    spacing : float
        Side of a cell, in metres.
    lower : array-like, shape (2,)
        Lower corner of cell (0, 0), in metres.

    Returns
    -------
    ndarray of float64, shape (E, 4)
        ``x0, y0, x1, y1`` in metres, each with the occupied cells on its left hand; first the upright segments, then
        the level ones. ``(0, 4)`` where nothing is occupied.

    Raises
    ------
    InputError
        If ``occupied`` is not a boolean array of two axes, or ``spacing`` or ``lower`` is not usable.
    """
    cells = np.asarray(occupied)
    if cells.ndim != 2 or cells.dtype != np.bool_:
        raise InputError(
            f"occupied has shape {cells.shape} and dtype {cells.dtype}; an outline needs a boolean array of two axes; "
            "pass occupied.astype(bool) indexed [x, y]"
        )
    cells = cells.view(np.uint8) != 0  # a boolean array may hold other bytes than 0 and 1
    side = positive(spacing, "spacing")
    corner = finite(lower, "lower")
    if corner.shape != (2,):
        raise InputError(f"lower has shape {corner.shape}; it must hold two coordinates; pass e.g. (0.0, 0.0)")
    x, start, stop, step = _runs(cells.view(np.int8))
    # The cells lie on the left of an upright segment that runs down where occupied cells begin, and up where they end.
    upright = np.column_stack((x, np.where(step > 0, stop, start), x, np.where(step > 0, start, stop)))
    y, start, stop, step = _runs(cells.T.view(np.int8))
    level = np.column_stack((np.where(step > 0, start, stop), y, np.where(step > 0, stop, start), y))
    return np.asarray(np.tile(corner, 2) + side * np.concatenate((upright, level)))


def _runs(cells: NDArray[np.int8]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Runs of equal steps across the lattice lines of the first axis: line, start, stop (both along it) and step."""
    lines, length = len(cells) + 1, cells.shape[1]
    steps = np.zeros((lines, length + 2), dtype=np.int8)
    steps[:-1, 1:-1] = cells
    steps[1:, 1:-1] -= cells
    change = steps[:, 1:] != steps[:, :-1]
    line, start = np.nonzero(change & (steps[:, 1:] != 0))
    # Starts and stops pair up: both lists are in reading order, and every run ends before the padding of its line.
    stop = np.nonzero(change & (steps[:, :-1] != 0))[1]
    return line, start, stop, steps[line, start + 1]

"""The border of a set of cells, as few rectangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def cell_faces(cells: NDArray[np.bool_], spacing: float, lower: Any) -> Floats:
    """Triangles of the border of the union of closed cells, shape (n, 3, 3).

    Sides that lie in one plane are merged to rectangles. Whatever lies beyond the array is not in the union.

    Parameters
    ----------
    cells : ndarray of bool, shape (nx, ny, nz)
    spacing : float
        Side of a cell, metres.
    lower : array-like, shape (3,)
        Lower corner of the first cell, metres.
    """
    found = [np.empty((0, 3, 3))]
    for axis in range(3):
        columns = np.moveaxis(cells, axis, 0)
        sides = np.zeros((columns.shape[0] + 1, *columns.shape[1:]), dtype=np.bool_)
        sides[:-1] = columns
        sides[1:] ^= columns
        found.append(rectangle_triangles(sides, axis, spacing, lower))
    return np.concatenate(found)


def rectangle_triangles(sides: NDArray[np.bool_], axis: int, spacing: float, lower: Any) -> Floats:
    """Triangles of the squares ``sides[k, i, j]`` that lie in the lattice plane k across an axis, shape (n, 3, 3)."""
    low, high = _rectangles(sides)
    first, second = low.copy(), low.copy()
    first[:, 1], second[:, 2] = high[:, 1], high[:, 2]
    corners = np.stack([low, first, high, second], axis=1)
    order = np.argsort([axis, *(other for other in range(3) if other != axis)])
    points = np.asarray(lower, dtype=np.float64) + spacing * corners[..., order]
    return np.asarray(points[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3))


def cell_boxes(cells: NDArray[np.bool_], spacing: float, lower: Any) -> Floats:
    """Boxes whose union is that of closed cells, as few as runs along two axes leave: corners, shape (n, 6), metres."""
    low, high = _rectangles(cells)
    high[:, 0] += 1
    corner = np.asarray(lower, dtype=np.float64)
    return np.asarray(np.hstack([corner + spacing * low, corner + spacing * high]))


def _rectangles(sides: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Rectangles that cover the set entries of each layer: lattice corners ``(layer, row, column)``, lower and upper.

    Runs along a row, and rows with the same run that follow one another taken together.
    """
    steps = np.diff(np.pad(sides, ((0, 0), (0, 0), (1, 1))).view(np.int8), axis=2)
    layer, row, start = np.nonzero(steps == 1)
    stop = np.nonzero(steps == -1)[2]
    order = np.lexsort((row, stop, start, layer))
    layer, row, start, stop = layer[order], row[order], start[order], stop[order]
    fresh = np.ones(len(row), dtype=np.bool_)
    fresh[1:] = (np.diff(layer) != 0) | (np.diff(start) != 0) | (np.diff(stop) != 0) | (np.diff(row) != 1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(row))[: len(first)] - 1
    return (
        np.stack([layer[first], row[first], start[first]], axis=1),
        np.stack([layer[first], row[last] + 1, stop[first]], axis=1),
    )

"""Connected parts of a body's boundary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cspace._shapes import RoundedSimplices
from cspace._shapes.bodies import label_components
from cspace._shapes.shape import unique_rows
from cspace._support.arrays import Floats, Ints


def as_triangles(parts: Sequence[RoundedSimplices]) -> RoundedSimplices:
    """Convert points, segments and triangles, with their radii, to triangles in space.

    Points and segments repeat their last corner. Pieces of the plane lie at z = 0.
    """
    simplices = [np.empty((0, 3, 3))]
    radii = [np.empty(0)]
    for part in parts:
        _, corners, dim = part.simplices.shape
        repeating_last = np.minimum(range(3), corners - 1)
        triangles = part.simplices[:, repeating_last]
        simplices.append(np.pad(triangles, ((0, 0), (0, 0), (0, 3 - dim))))
        radii.append(part.radii)
    return RoundedSimplices(np.concatenate(simplices), np.concatenate(radii))


def sort_by_part(border: RoundedSimplices) -> tuple[Floats, Ints]:
    """Sort the vertices of a boundary by connected part.

    Returns the vertices, shape (n, d), and the index of the first vertex of each part.
    """
    corners, dim = border.simplices.shape[1:]
    points, indices = unique_rows(border.simplices.reshape(-1, dim))
    simplices = indices.reshape(-1, corners)
    # Corners of a simplex are connected, so link each to the next.
    edge_starts = simplices[:, :-1].ravel()
    edge_ends = simplices[:, 1:].ravel()
    labels = label_components(edge_starts, edge_ends, len(points))
    order = np.argsort(labels, kind="stable")
    is_first = np.diff(labels[order], prepend=-1) != 0
    return np.ascontiguousarray(points[order]), np.flatnonzero(is_first)


def part_anchors(border: RoundedSimplices) -> tuple[Floats, Floats]:
    """Return a vertex and the size of each part.

    The vertices have shape (n, d); the sizes, in metres, shape (n,).
    """
    points, starts = sort_by_part(border)
    if not len(points):
        return points, np.empty(0)
    low = np.minimum.reduceat(points, starts)
    high = np.maximum.reduceat(points, starts)
    return points[starts], (high - low).max(axis=1)

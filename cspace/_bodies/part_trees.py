"""Trees of the triangles, boxes and balls of a body, or of its closed surfaces.

A ball is a triangle with three equal corners and a radius; a segment repeats one corner.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace._bodies import box_trees
from cspace._shapes import RoundedSimplices
from cspace._support.arrays import Floats, Ints

CENTER, HALF_SIDES, LEVER, BALL = 0, 3, 6, 7
"""Columns of a tree's ``boxes`` where the center, the half sides, the longest lever and the largest
radius begin."""


RADIUS = 9
"""Column of :attr:`PartTree.triangles` after the three corners."""


class PartTree(NamedTuple):
    """The triangles, boxes and balls of a part, in a tree of boxes.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 8)
        Center and half sides of each box, radii included, the longest lever of its triangles, and
        their largest radius, zero or above; children as in :mod:`cspace.inside.box_trees`.
    spans : ndarray of int64, shape (m, 2)
        Index of the first triangle of each node, and their number.
    triangles : ndarray of float64, shape (n, 10)
        Three corners and a radius, zero or above. A negative radius marks a box: then the row has
        its center, two half axes, and the negated length of the third.
    """

    boxes: Floats
    spans: Ints
    triangles: Floats


class SurfaceTree(NamedTuple):
    """A tree of the triangles of closed surfaces.

    Attributes
    ----------
    boxes : ndarray of float64, shape (m, 6)
        Center and half sides of the box of each node.
    spans : ndarray of int64, shape (m, 2)
        First triangle of each node, and their number; children as in :class:`PartTree`.
    triangles : ndarray of float64, shape (n, 3, 3)
    windings : ndarray of int64, shape (n,)
        Multiplicity of each triangle.
    """

    boxes: Floats
    spans: Ints
    triangles: Floats
    windings: Ints


NO_TREE: Final[PartTree] = PartTree(
    np.empty((0, 8)), np.empty((0, 2), dtype=np.int64), np.empty((0, 10))
)
"""A tree without triangles."""


def build_tree(rows: Floats, levers: Floats) -> PartTree:
    """Build a tree of triangles and boxes.

    ``rows``, shape (n, 10), are those of :attr:`PartTree.triangles`; ``levers`` has shape (n,).
    """
    low, high = bound_rows(rows)
    radii = np.maximum(rows[:, RADIUS], 0.0)
    boxes, order, spans = box_trees.build_boxes(low, high, np.column_stack([levers, radii]))
    return PartTree(boxes, spans, rows[order])


def pack_triangles(triangles: RoundedSimplices) -> Floats:
    """Return grown triangles in space as rows of a tree, shape (n, 10)."""
    return np.hstack([triangles.simplices.reshape(-1, 9), triangles.radii[:, np.newaxis]])


def distinct_rows(rows: Floats) -> tuple[Floats, Ints]:
    """Return the sorted distinct rows, shape (m, k), and the number of each row, (n,)."""
    order = np.lexsort(rows.T[::-1])  # the last key is the first column
    rows = rows[order]
    is_new = np.ones(len(rows), dtype=np.bool_)
    is_new[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    numbers = np.empty(len(rows), dtype=np.int64)
    numbers[order] = np.cumsum(is_new) - 1
    return rows[is_new], numbers


def pack_boxes(lows: Floats, highs: Floats, pose: Floats) -> Floats:
    """Return posed axis-aligned boxes as rows of a tree, shape (n, 10).

    Their lower and upper corners have shapes (n, 3), the pose (4, 4).
    """
    rotation = pose[:3, :3]
    half_x, half_y, half_z = 0.5 * (highs - lows).T
    centers = 0.5 * (lows + highs) @ rotation.T + pose[:3, 3]
    # Two half axes as vectors, and the length of the third, whose minus sign marks a box.
    first = half_x[:, np.newaxis] * rotation[:, 0]
    second = half_y[:, np.newaxis] * rotation[:, 1]
    return np.column_stack([centers, first, second, -half_z])


def half_axes(boxes: Floats) -> Floats:
    """Compute half axes of boxes, shape (n, 3, 3).

    ``boxes``, shape (n, 10), are rows of :attr:`PartTree.triangles`.
    """
    first = boxes[:, 3:6]
    second = boxes[:, 6:9]
    # The third is normal to both; only its length is stored, negated.
    third = np.cross(first, second)
    scales = boxes[:, RADIUS] / np.linalg.norm(third, axis=1)
    return np.stack([first, second, scales[:, np.newaxis] * third], axis=1)


def bound_rows(rows: Floats) -> tuple[Floats, Floats]:
    """Return the corners of each row's bounding box, shapes (n, 3).

    ``rows``, shape (n, 10), are those of :attr:`PartTree.triangles`.
    """
    corners = rows[:, :9].reshape(-1, 3, 3)
    radii = np.maximum(rows[:, RADIUS], 0.0)[:, np.newaxis]
    low = corners.min(axis=1) - radii
    high = corners.max(axis=1) + radii
    # Rows of boxes have no corners, but a center and half axes.
    is_box = rows[:, RADIUS] < 0.0
    centers = rows[is_box, :3]
    half_sides = np.abs(half_axes(rows[is_box])).sum(axis=1)
    low[is_box] = centers - half_sides
    high[is_box] = centers + half_sides
    return low, high

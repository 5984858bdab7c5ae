"""Trees of boxes around items, such as triangles: how they are built, and how two are searched.

A node with n items has two children: the next node has the first n // 2 of them, and the node
2 (n // 2) later the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from cspace._support.arrays import Floats, Ints
from cspace._support.compiling import inlined

MAX_PENDING_PAIRS = 128
"""Capacity of a stack of pairs of nodes; a search needs the levels of both trees, plus a few."""


FIRST_ITEM, ITEM_COUNT = range(2)
"""Columns of a tree's ``spans``."""


Tree = TypeVar("Tree")
"""A named tuple of arrays: ``boxes``, ``spans``, ``triangles``, and perhaps more of triangles."""


def build_boxes(
    low: Floats, high: Floats, values: Floats | None = None
) -> tuple[Floats, Ints, Ints]:
    """Build the boxes of a binary tree around items, level by level.

    ``low`` and ``high``, shapes (n, 3), are the corners of the items' boxes. Each level halves the
    items of its nodes along the longest side.

    Returns the boxes, shape (m, 6 + k), the order of the items in the tree, shape (n,), and the
    first item and number of items of each node, shape (m, 2). A box is its center, its half sides,
    and the largest of the k ``values``, shape (n, k), of its items; none by default.
    """
    number_of_nodes = max(2 * len(low) - 1, 0)
    values = np.empty((len(low), 0)) if values is None else values
    boxes = np.empty((number_of_nodes, 6 + values.shape[1]))
    spans = np.empty((number_of_nodes, 2), dtype=np.int64)
    order = np.arange(len(low))
    centers = low + high
    # The nodes of a level, one entry each: index, first item and number of items.
    has_root = len(low) > 0
    node = np.zeros(int(has_root), dtype=np.int64)
    start = np.zeros_like(node)
    count = np.full_like(node, len(low))
    while len(node):
        # Write the nodes of this level.
        lower = -_maxima_of_ranges(-low[order], start, start + count)
        upper = _maxima_of_ranges(high[order], start, start + count)
        largest = _maxima_of_ranges(values[order], start, start + count)
        boxes[node] = np.hstack([0.5 * (lower + upper), 0.5 * (upper - lower), largest])
        spans[node] = np.column_stack([start, count])
        # Go on with the nodes that have children.
        has_children = count > 1
        longest_axis = (upper - lower).argmax(axis=1)[has_children]
        node = node[has_children]
        start = start[has_children]
        count = count[has_children]
        # Sort the items of each node by their centers along its longest side. For each of these
        # items: its node, and its place in the order.
        owner = np.repeat(np.arange(len(node)), count)
        items_before = np.cumsum(count) - count
        places = np.arange(len(owner)) + (start - items_before)[owner]
        items = order[places]
        keys = centers[items, longest_axis[owner]]
        order[places] = items[np.lexsort((keys, owner))]
        # The first child follows its parent, the second one follows the nodes of the first. A level
        # stays in the order of its items, because reductions also pass through the gaps.
        half = count // 2
        node = np.column_stack([node + 1, node + 2 * half]).ravel()
        start = np.column_stack([start, start + half]).ravel()
        count = np.column_stack([half, count - half]).ravel()
    return boxes, order, spans


def _maxima_of_ranges(rows: Floats, starts: Ints, stops: Ints) -> Floats:
    """Return the maximum of ``rows[starts[i]:stops[i]]`` for each i.

    ``rows`` has shape (n, d), the result one row for each i.
    """
    # ``reduceat`` also gives the maxima between a stop and the next start, which are left out.
    bounds = np.stack([starts, stops], axis=1).ravel()
    padded = np.append(rows, rows[:1], axis=0)  # a stop may be the number of rows
    return np.asarray(np.maximum.reduceat(padded, bounds)[::2])


def join_trees(trees: Sequence[Tree], before: Tree) -> tuple[Tree, Ints]:
    """Join trees in one record, after those joined ``before``.

    Returns the record, and the root of each tree in it, -1 if the tree is empty.
    """
    records: list[Any] = [before, *trees]
    nodes = np.array([len(record.boxes) for record in records])
    triangles = np.cumsum([len(record.triangles) for record in records])
    # Spans name triangles by their index, which moves up by the triangles of the trees before.
    for k, first in enumerate(triangles[:-1].tolist(), start=1):
        records[k] = records[k]._replace(spans=records[k].spans + np.array([first, 0]))
    joined: Any = type(before)(*map(np.concatenate, zip(*records, strict=True)))
    return joined, np.where(nodes[1:] > 0, np.cumsum(nodes)[:-1], -1)


@inlined
def push_halves(nodes: Ints, top: int, a_count: int, b_count: int, is_b_larger: bool) -> int:
    """Replace a pair of nodes by the pairs with both children of one; return the new top.

    The pair, of trees a and b, stands in row ``top`` of the stack ``nodes``, and its nodes have so
    many items; not both are leaves. The first child of the larger one comes to the top.
    """
    a, b = nodes[top, 0], nodes[top, 1]
    nodes[top + 1, 0] = a
    nodes[top + 1, 1] = b
    if a_count == 1 or (b_count > 1 and is_b_larger):
        nodes[top, 1] = b + 2 * (b_count // 2)
        nodes[top + 1, 1] = b + 1
    else:
        nodes[top, 0] = a + 2 * (a_count // 2)
        nodes[top + 1, 0] = a + 1
    return top + 2


def find_nearest(points_a: Floats, points_b: Floats, radius_a: float, radius_b: float) -> Floats:
    """Return the nearest points of two convex hulls, shape (2, 3).

    The hulls are those of two point sets, shapes (n, 3) and (m, 3), each grown by a radius; all in
    metres. The nearest points follow from the point nearest to zero in the hull of all differences
    (C. L. Lawson and R. J. Hanson, "Solving Least Squares Problems", 1974, chapter 23), of which
    some are tried (P. Wolfe, "Finding the nearest point in a polytope", 1976).
    """
    import scipy.optimize

    a_rows, b_rows = [0], [0]  # pairs of corners whose differences span the nearest point
    while True:
        # Find weights, zero or above, with sum 1, that bring the mean of the differences nearest
        # to zero: three equations of the mean, and an equation of the sum.
        differences = points_a[a_rows] - points_b[b_rows]
        equations = np.vstack([differences.T, np.ones(len(differences))])
        # scipy's nnls misses the least sum on some machines if points lie symmetrically.
        solution = scipy.optimize.lsq_linear(
            equations, [0, 0, 0, 1], (0, np.inf), method="bvls", tol=1e-15, max_iter=1000
        )
        weights = solution.x / solution.x.sum()
        nearest_a, nearest_b = weights @ points_a[a_rows], weights @ points_b[b_rows]
        # Add the pair of corners that are nearest along the way between the points.
        offset = nearest_b - nearest_a
        pair = (int((points_a @ offset).argmax()), int((points_b @ offset).argmin()))
        gain = offset @ (offset - points_b[pair[1]] + points_a[pair[0]])
        if gain <= 1e-15 * (offset @ offset) or pair in zip(a_rows, b_rows, strict=True):
            break
        a_rows.append(pair[0])
        b_rows.append(pair[1])
    # Move both by the radii towards each other.
    direction = offset / max(float(np.linalg.norm(offset)), np.finfo(float).tiny)
    return np.stack([nearest_a + radius_a * direction, nearest_b - radius_b * direction])

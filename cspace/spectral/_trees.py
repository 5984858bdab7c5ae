"""Trees of balls, which prove that ball sets are apart or overlap.

A tree is an array of nodes, shape (2 n - 1, 5), for n balls: the center (z = 0 in the plane) and
the radius of a ball that contains all balls of the node, and their number. A leaf is a ball. The
children of node k, which has m balls, are k + 1 and k + 2 * (m // 2).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cspace._support.arrays import Bytes, Floats, Ints
from cspace._support.compiling import allocating, internal
from cspace._support.threads import in_chunks

RADIUS, BALL_COUNT = 3, 4
"""Columns of a tree's nodes after the three coordinates of the center."""

MISS, HIT, UNDECIDED = range(3)
"""Values of :class:`cspace.spectral.Verdict`: balls are apart, open balls overlap, or neither is
proven."""

MAX_PENDING_NODE_PAIRS: Final = 256
"""Capacity of the stack of pairs of nodes: four times the summed depth of two trees over 2^30
balls."""

MIN_PLACEMENTS_PER_THREAD: Final = 2_000
"""Placements per thread below which a further thread costs more time than it saves."""


def build_tree(centers: Floats, radii: Floats) -> Floats:
    """Build the tree of one or more balls, shapes (n, d) and (n,)."""
    from scipy.spatial import cKDTree

    order = cKDTree(centers, leafsize=1).indices
    points = np.pad(centers, ((0, 0), (0, 3 - centers.shape[1])))
    nodes: list[Floats] = []
    _add_nodes(nodes, points[order], radii[order, None])
    return np.array(nodes)


def _add_nodes(nodes: list[Floats], points: Floats, radii: Floats) -> None:
    """Append the tree of balls, with centers (n, 3) and radii (n, 1), to the nodes."""
    size = len(points)
    if size == 1:
        nodes.append(np.concatenate([points[0], radii[0], [1.0]]))
        return
    # The node has the center of the bounding box; its radius reaches beyond the farthest ball, in
    # spite of rounding.
    center = 0.5 * ((points - radii).min(axis=0) + (points + radii).max(axis=0))
    distances = np.linalg.norm(points - center, axis=1, keepdims=True)
    reach = (1.0 + 2.0**-40) * (distances + radii).max(axis=0)
    nodes.append(np.concatenate([center, reach, [size]]))
    half = size // 2
    _add_nodes(nodes, points[:half], radii[:half])
    _add_nodes(nodes, points[half:], radii[half:])


def rotate_tree(tree: Floats, matrix: Floats) -> Floats:
    """Rotate a tree about the origin by a matrix (d, d)."""
    rotated = tree.copy()
    dim = len(matrix)
    rotated[:, :dim] = tree[:, :dim] @ matrix.T
    return rotated


@internal
def compare_placed(
    a: Floats, b: Floats, x: float, y: float, z: float, slack: float, pending: Ints
) -> int:
    """Compare tree a, moved by (x, y, z), with tree b; return MISS, HIT or UNDECIDED.

    ``slack``, metres, bounds the rounding of the distance between two centers. ``pending`` is
    scratch of shape (MAX_PENDING_NODE_PAIRS, 2).
    """
    result = MISS
    # A stack of pairs of nodes, which begins with both roots; an empty tree touches nothing.
    count = min(1, len(a), len(b))
    pending[0, 0] = 0
    pending[0, 1] = 0
    while count > 0:
        count -= 1
        i, j = pending[count]
        node_a = a[i]
        node_b = b[j]
        dx = node_a[0] + x - node_b[0]
        dy = node_a[1] + y - node_b[1]
        dz = node_a[2] + z - node_b[2]
        square = dx * dx + dy * dy + dz * dz
        reach = node_a[RADIUS] + node_b[RADIUS]
        if square > (reach + slack) * (reach + slack):
            continue
        size_a = int(node_a[BALL_COUNT])
        size_b = int(node_b[BALL_COUNT])
        # Leaves are the balls themselves.
        if size_a == 1 and size_b == 1:
            if reach > slack and square < (reach - slack) * (reach - slack):
                return HIT
            result = UNDECIDED
            continue
        # Replace the node with the larger ball by its two children.
        pending[count + 1, 0] = i
        pending[count + 1, 1] = j
        if size_b == 1 or (size_a > 1 and node_a[RADIUS] > node_b[RADIUS]):
            pending[count, 0] = i + 1
            pending[count + 1, 0] = i + 2 * (size_a // 2)
        else:
            pending[count, 1] = j + 1
            pending[count + 1, 1] = j + 2 * (size_b // 2)
        count += 2
    return result


class ContactTest(NamedTuple):
    """Ball trees that decide whether two bodies touch.

    The balls of ``outer_a`` and ``outer_b`` cover bodies a and b; they prove that the bodies are
    apart. The balls of ``inner_a`` and ``inner_b`` prove that they overlap: balls inside them, the
    outer balls again, or none. The trees are relative to the centers of a and b. ``half_sides``,
    shape (3,), metres, are the largest absolute coordinates of center a relative to center b at
    which the bodies can touch. ``slack`` bounds the rounding of the distance between two centers
    there.
    """

    outer_a: Floats
    outer_b: Floats
    inner_a: Floats
    inner_b: Floats
    half_sides: Floats
    slack: float

    def test(self, relative: Floats) -> Bytes:
        """Return the verdicts of placements, MISS, HIT or UNDECIDED, shape (n,).

        ``relative``, shape (n, 3), are the placements of center a relative to center b, metres.
        """
        out = np.empty(len(relative), dtype=np.uint8)

        def test_chunk(start: int, stop: int) -> int:
            """Write the verdicts of some placements; -1 means that none is invalid."""
            test_placements(*self, relative[start:stop], out[start:stop])
            return -1

        in_chunks(test_chunk, len(relative), MIN_PLACEMENTS_PER_THREAD)
        return out


@allocating
def test_placements(
    outer_a: Floats,
    outer_b: Floats,
    inner_a: Floats,
    inner_b: Floats,
    half_sides: Floats,
    slack: float,
    relative: Floats,
    out: Bytes,
) -> None:
    """Write the verdicts of placements (n, 3) to ``out``.

    The outer trees decide first, then the inner ones. The other arguments are those of
    :class:`ContactTest`.
    """
    pending = np.empty((MAX_PENDING_NODE_PAIRS, 2), dtype=np.int64)
    for n in range(len(relative)):
        x, y, z = relative[n]
        out[n] = MISS
        # Bodies this far apart cannot touch.
        if not (abs(x) <= half_sides[0] and abs(y) <= half_sides[1] and abs(z) <= half_sides[2]):
            continue
        if compare_placed(outer_a, outer_b, x, y, z, slack, pending) == MISS:
            continue
        out[n] = UNDECIDED
        if compare_placed(inner_a, inner_b, x, y, z, slack, pending) == HIT:
            out[n] = HIT

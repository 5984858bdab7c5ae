"""Trees of balls, which prove that ball sets are apart or overlap."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.support.arrays import Bytes, Floats, Ints
from cspace.support.compiling import kernel
from cspace.support.threads import in_chunks

MISS, HIT, UNDECIDED = range(3)
"""Values of :class:`cspace.spectral.Verdict`: balls are apart, open balls overlap, or neither is
proven."""

MAX_PENDING_NODE_PAIRS: Final = 256
"""Capacity of the stack of pairs of nodes: four times the summed depth of two trees over 2^30
balls."""

MIN_PLACEMENTS_PER_THREAD: Final = 2_000
"""Placements per thread below which a further thread costs more time than it saves."""


class BallTree(NamedTuple):
    """Binary tree of balls, for kernels.

    ``nodes``, shape (2 n - 1, 4), are the center, with z = 0 in the plane, and the radius of a ball
    that contains all balls of the node; a leaf is a ball. ``sizes`` are the numbers of balls of the
    nodes; the children of node k are k + 1 and k + 2 * (size // 2). ``order``, shape (n,), are the
    indices of the balls of the leaves.
    """

    nodes: Floats
    sizes: Ints
    order: Ints

    @classmethod
    def of(cls, centers: Floats, radii: Floats) -> BallTree:
        """Build the tree of balls; without balls, it is empty."""
        if not len(centers):
            return cls(np.empty((0, 4)), *np.empty((2, 0), dtype=np.int64))
        from scipy.spatial import cKDTree

        flat = 3 - centers.shape[1]
        order = cKDTree(centers, leafsize=1).indices
        balls = np.column_stack([np.pad(centers, ((0, 0), (0, flat))), radii])[order]
        nodes = np.empty((2 * len(balls) - 1, 4))
        sizes = np.empty(2 * len(balls) - 1, dtype=np.int64)
        fill_tree(balls, nodes, sizes, np.zeros_like(sizes))
        return cls(nodes, sizes, order.astype(np.int64))

    def rotated(self, matrix: Floats) -> BallTree:
        """Rotate the tree about the origin."""
        nodes, dim = self.nodes.copy(), len(matrix)
        nodes[:, :dim] = nodes[:, :dim] @ matrix.T
        return self._replace(nodes=nodes)


@kernel
def fill_tree(balls: Floats, nodes: Floats, sizes: Ints, starts: Ints) -> None:
    """Fill a tree with balls, shape (n, 4), halving by distance.

    Node k gets the ball of ``nodes[k]`` and ``sizes[k]`` balls from ``starts[k]`` on; ``starts`` is
    scratch, zero on input.
    """
    sizes[0] = len(balls)
    for node in range(len(nodes)):
        start, size = starts[node], sizes[node]
        radius = balls[start, 3]
        if size == 1:
            for axis in range(3):
                nodes[node, axis] = balls[start, axis]
        else:
            # The center is the bounding box's; the radius reaches beyond the farthest ball, in
            # spite of rounding.
            for axis in range(3):
                low, high = math.inf, -math.inf
                for n in range(start, start + size):
                    low = min(low, balls[n, axis] - balls[n, 3])
                    high = max(high, balls[n, axis] + balls[n, 3])
                nodes[node, axis] = 0.5 * (low + high)
            for n in range(start, start + size):
                square = 0.0
                for axis in range(3):
                    square += (balls[n, axis] - nodes[node, axis]) ** 2
                radius = max(radius, (1.0 + 2.0**-40) * (math.sqrt(square) + balls[n, 3]))
            half = size // 2
            starts[node + 1], sizes[node + 1] = start, half
            starts[node + 2 * half] = start + half
            sizes[node + 2 * half] = size - half
        nodes[node, 3] = radius


@kernel
def compare_placed(
    a: BallTree, b: BallTree, x: float, y: float, z: float, slack: float, pending: Ints
) -> int:
    """Return MISS, HIT or UNDECIDED, the first tree moved by (x, y, z).

    ``slack``, metres, bounds the rounding of the distance between two centers. ``pending`` is
    scratch of shape (MAX_PENDING_NODE_PAIRS, 2).
    """
    result = MISS
    count = min(1, len(a.sizes), len(b.sizes))
    pending[0, 0], pending[0, 1] = 0, 0
    while count > 0:
        count -= 1
        i, j = pending[count]
        p, q = a.nodes[i], b.nodes[j]
        dx, dy, dz = p[0] + x - q[0], p[1] + y - q[1], p[2] + z - q[2]
        square = dx * dx + dy * dy + dz * dz
        reach = p[3] + q[3]
        if square > (reach + slack) * (reach + slack):
            continue
        size_a, size_b = a.sizes[i], b.sizes[j]
        if size_a == 1 and size_b == 1:
            if reach > slack and square < (reach - slack) * (reach - slack):
                return HIT
            result = UNDECIDED
            continue
        # Replace the node with the larger ball by its two children.
        i1, i2, j1, j2 = i, i, j, j
        if size_b == 1 or (size_a > 1 and p[3] > q[3]):
            i1, i2 = i + 1, i + 2 * (size_a // 2)
        else:
            j1, j2 = j + 1, j + 2 * (size_b // 2)
        pending[count, 0], pending[count, 1] = i1, j1
        pending[count + 1, 0], pending[count + 1, 1] = i2, j2
        count += 2
    return result


class ContactTest(NamedTuple):
    """Ball trees that decide whether two bodies touch, for kernels.

    The balls of ``outer_a`` and ``outer_b`` cover bodies a and b; they prove that the bodies are
    apart. The balls of ``inner_a`` and ``inner_b`` prove that they overlap: balls inside them, the
    outer balls again, or none. ``frame``, shape (3, 3), metres, has the centers of a and b, to
    which the trees are relative, and the largest absolute coordinates of center a relative to b at
    which the bodies can touch. ``slack`` bounds the rounding of the distance between two centers
    there.
    """

    outer_a: BallTree
    outer_b: BallTree
    inner_a: BallTree
    inner_b: BallTree
    frame: Floats
    slack: float

    def test(self, placements: Floats) -> Bytes:
        """Return the verdicts of placements, shape (n, 3), in threads."""
        out = np.empty(len(placements), dtype=np.uint8)

        def work(start: int, stop: int) -> int:
            pending = np.empty((MAX_PENDING_NODE_PAIRS, 2), dtype=np.int64)
            test_each(self, placements[start:stop], pending, out[start:stop])
            return -1

        in_chunks(work, len(placements), MIN_PLACEMENTS_PER_THREAD)
        return out


@kernel
def test_each(test: ContactTest, placements: Floats, pending: Ints, out: Bytes) -> None:
    """Write the verdicts of placements (n, 3)."""
    for n in range(len(placements)):
        out[n] = test_placement(test, placements[n, 0], placements[n, 1], placements[n, 2], pending)


@kernel
def test_placement(test: ContactTest, x: float, y: float, z: float, pending: Ints) -> int:
    """Test a placement of a: the outer trees, then the inner ones."""
    a, b, half = test.frame
    x = (x + a[0]) - b[0]
    y = (y + a[1]) - b[1]
    z = (z + a[2]) - b[2]
    if not (abs(x) <= half[0] and abs(y) <= half[1] and abs(z) <= half[2]):
        return MISS
    if compare_placed(test.outer_a, test.outer_b, x, y, z, test.slack, pending) == MISS:
        return MISS
    inner = compare_placed(test.inner_a, test.inner_b, x, y, z, test.slack, pending)
    return HIT if inner == HIT else UNDECIDED

"""Trees of balls, which prove that ball sets are apart or overlap."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bytes, Floats, Ints
from cspace.compiling import kernel
from cspace.threads import in_chunks

APART: Final = 0
"""No two balls touch."""

OVERLAPPING: Final = 1
"""Two open balls overlap."""

TOUCHING: Final = 2
"""Neither is proven; for single balls, rounding decides."""

NODE_ROUNDING: Final = 1.0 + 2.0**-40
"""Factor by which the ball of a node grows, so that rounding cannot leave a ball outside."""

MAX_PENDING_PAIRS: Final = 256
"""Capacity of the stack of pairs of nodes: four times the summed depth of two trees over 2^30 balls."""

MIN_PLACEMENTS_PER_THREAD: Final = 2_000
"""Placements below which a second thread does not pay."""


class BallTree(NamedTuple):
    """A binary tree of balls; compiled functions take this record.

    Attributes
    ----------
    nodes : ndarray of float64, shape (2 n - 1, 4)
        Center, with z = 0 in the plane, and radius of a ball that contains all balls of the node. A leaf is a ball.
    sizes : ndarray of int64, shape (2 n - 1,)
        Balls of the node. The children of node k are k + 1 and k + 2 * (size // 2).
    """

    nodes: Floats
    sizes: Ints

    @classmethod
    def of(cls, centers: Floats, radii: Floats) -> BallTree:
        """Build the tree of balls with centers (n, d), metres; without balls, an empty tree."""
        if not len(centers):
            return cls(np.empty((0, 4)), np.empty(0, dtype=np.int64))
        from scipy.spatial import cKDTree

        flat, order = 3 - centers.shape[1], cKDTree(centers, leafsize=1).indices
        balls = np.column_stack([np.pad(centers, ((0, 0), (0, flat))), radii])[order]
        nodes, sizes = np.empty((2 * len(balls) - 1, 4)), np.empty(2 * len(balls) - 1, dtype=np.int64)
        fill_tree(balls, nodes, sizes, np.zeros_like(sizes))
        return cls(nodes, sizes)

    def rotated(self, matrix: Floats) -> BallTree:
        """Rotate the tree about the origin."""
        nodes, dim = self.nodes.copy(), len(matrix)
        nodes[:, :dim] = nodes[:, :dim] @ matrix.T
        return BallTree(nodes, self.sizes)


@kernel
def fill_tree(balls: Floats, nodes: Floats, sizes: Ints, starts: Ints) -> None:
    """Fill a tree with balls (n, 4), sorted so that halves are far apart; ``starts``, zeros, is scratch."""
    sizes[0] = len(balls)
    for k in range(len(nodes)):
        start, size = starts[k], sizes[k]
        radius = balls[start, 3]
        if size == 1:
            for along in range(3):
                nodes[k, along] = balls[start, along]
        else:
            for along in range(3):
                low, high = math.inf, -math.inf
                for n in range(start, start + size):
                    low, high = min(low, balls[n, along] - balls[n, 3]), max(high, balls[n, along] + balls[n, 3])
                nodes[k, along] = 0.5 * (low + high)
            for n in range(start, start + size):
                square = 0.0
                for along in range(3):
                    square += (balls[n, along] - nodes[k, along]) ** 2
                radius = max(radius, NODE_ROUNDING * (math.sqrt(square) + balls[n, 3]))
            half = size // 2
            starts[k + 1], sizes[k + 1] = start, half
            starts[k + 2 * half], sizes[k + 2 * half] = start + half, size - half
        nodes[k, 3] = radius


@kernel
def compare_placed(a: BallTree, b: BallTree, placement: Floats, slack: float, pending: Ints) -> int:
    """Return APART, OVERLAPPING or TOUCHING for tree a, moved by ``placement`` (d,), and tree b.

    ``slack``, metres, bounds the rounding of a distance of two centers. ``pending`` is scratch, MAX_PENDING_PAIRS long.
    """
    x, y, z = placement[0], placement[1], 0.0
    if len(placement) == 3:
        z = placement[2]
    result, count = APART, min(1, len(a.sizes), len(b.sizes))
    pending[0] = 0
    while count > 0:
        count -= 1
        i, j = pending[count] >> 32, pending[count] & 0xFFFFFFFF
        dx, dy, dz = (
            a.nodes[i, 0] + x - b.nodes[j, 0],
            a.nodes[i, 1] + y - b.nodes[j, 1],
            a.nodes[i, 2] + z - b.nodes[j, 2],
        )
        square, reach = dx * dx + dy * dy + dz * dz, a.nodes[i, 3] + b.nodes[j, 3]
        if square > (reach + slack) * (reach + slack):
            continue
        m, n = a.sizes[i], b.sizes[j]
        if m == 1 and n == 1:
            if reach > slack and square < (reach - slack) * (reach - slack):
                return OVERLAPPING
            result = TOUCHING
        elif n == 1 or (m > 1 and a.nodes[i, 3] > b.nodes[j, 3]):
            pending[count], pending[count + 1] = (i + 1) << 32 | j, (i + 2 * (m // 2)) << 32 | j
            count += 2
        else:
            pending[count], pending[count + 1] = i << 32 | (j + 1), i << 32 | (j + 2 * (n // 2))
            count += 2
    return result


class ContactTest(NamedTuple):
    """What decides whether body a, placed, and body b touch; compiled functions take this record.

    Attributes
    ----------
    outer_a, outer_b : BallTree
        Balls of the bodies; they prove that the bodies are apart.
    inner_a, inner_b : BallTree
        Balls that prove that they overlap: those inside the bodies, the same balls, or none.
    half_sides : ndarray, shape (d,)
        Largest moduli of placements, metres, at which the bodies can touch.
    slack : float
        Bound of the rounding of a distance of two centers, metres, at such placements.
    """

    outer_a: BallTree
    outer_b: BallTree
    inner_a: BallTree
    inner_b: BallTree
    half_sides: Floats
    slack: float

    def evaluate(self, placements: Floats) -> Bytes:
        """Return APART, OVERLAPPING or TOUCHING for each placement (n, d) of a, in threads."""
        out = np.empty(len(placements), dtype=np.uint8)

        def work(start: int, stop: int) -> int:
            pending = np.empty(MAX_PENDING_PAIRS, dtype=np.int64)
            test_each(self, placements[start:stop], pending, out[start:stop])
            return -1

        if len(placements) < MIN_PLACEMENTS_PER_THREAD:
            work(0, len(placements))
        else:
            in_chunks(work, len(placements), MIN_PLACEMENTS_PER_THREAD)
        return out


@kernel
def test_each(test: ContactTest, placements: Floats, pending: Ints, out: Bytes) -> None:
    """Test placements (n, d)."""
    for n in range(len(placements)):
        out[n] = APART
        inside = True
        for axis in range(placements.shape[1]):
            inside = inside and abs(placements[n, axis]) <= test.half_sides[axis]
        if inside and compare_placed(test.outer_a, test.outer_b, placements[n], test.slack, pending) != APART:
            found = compare_placed(test.inner_a, test.inner_b, placements[n], test.slack, pending)
            out[n] = OVERLAPPING if found == OVERLAPPING else TOUCHING

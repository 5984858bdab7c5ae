"""Proofs, by trees of balls, that bodies are apart or overlap.

A tree is an array of nodes, shape (2 n - 1, 5), for n balls: the center (z = 0 in the plane) and
the radius of a ball that contains all balls of the node, and their number. A leaf is a ball. The
children of node k, which has m balls, are k + 1 and k + 2 * (m // 2).
"""

from __future__ import annotations

import copy
import math
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import (
    AXES,
    Bytes,
    Floats,
    Ints,
    allocating,
    box_trees,
    check_points,
    internal,
    run_in_chunks,
)
from cspace.spectral._ball_sets import (
    PLACEMENT_ROUNDING,
    BallsLike,
    Rotates,
    as_balls,
    rotation_matrix,
)

RADIUS, BALL_COUNT = 3, 4
"""Columns of a tree's nodes after the three coordinates of the center."""

MISS, HIT, UNDECIDED = range(3)
"""Values of :class:`Verdict`, for kernels: bodies are apart, they overlap, or neither is proven."""

NO_TREE: Final = np.empty((0, 5))
"""Tree of no balls."""

MAX_PENDING_NODE_PAIRS: Final = 256
"""Capacity of the stack of pairs of nodes: four times the summed depth of two trees over 2^30
balls."""


def build_tree(centers: Floats, radii: Floats) -> Floats:
    """Build the tree of balls (n, d) and (n,)."""
    from scipy.spatial import cKDTree

    order = cKDTree(centers, leafsize=1).indices
    points = np.pad(centers, ((0, 0), (0, 3 - centers.shape[1])))
    nodes: list[list[float]] = []
    _add_nodes(nodes, points[order], radii[order])
    return np.array(nodes)


def _add_nodes(nodes: list[list[float]], points: Floats, radii: Floats) -> None:
    """Append the tree of balls (n, 3) and (n,) to nodes."""
    size = len(points)
    # For one ball, the center and the reach are exactly those of the ball.
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = float((np.linalg.norm(points - center, axis=1) + radii).max())
    if size == 1:
        nodes.append([*center, reach, 1.0])
        return
    # The node reaches beyond the farthest ball, in spite of rounding.
    nodes.append([*center, (1.0 + 2.0**-40) * reach, size])
    half = size // 2
    for side in (slice(half), slice(half, size)):
        _add_nodes(nodes, points[side], radii[side])


@internal
def compare_placed(
    a: Floats, b: Floats, x: float, y: float, z: float, slack: float, pending: Ints
) -> int:
    """Compare moved tree a with b: MISS, HIT or UNDECIDED.

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
        # Split the node with the larger ball.
        is_b_larger = node_b[RADIUS] >= node_a[RADIUS]
        count = box_trees.push_halves(pending, count, size_a, size_b, is_b_larger)
    return result


class Verdict(IntEnum):
    """What is proven about two bodies, or about an overlap; ``bool(verdict)`` raises."""

    MISS = MISS
    HIT = HIT
    UNDECIDED = UNDECIDED

    def __bool__(self) -> bool:
        """Raise InputError, because UNDECIDED is neither true nor false."""
        raise InputError(
            "verdict",
            f"is {self.name}",
            "a verdict is neither true nor false",
        )


class ContactTest:
    """Proofs that two shapes, given by balls, are apart or meet, at any placement of the first.

    *MISS* proves that the closed shapes have no common point: no two outer balls touch. *HIT*
    proves that they have one: an inner ball of A and one of B overlap. Other placements are
    *UNDECIDED*. ``docs/explanation/frequency.md`` has the proofs. For bodies that are
    balls, pass the same balls as outer and as inner ones.

    Parameters
    ----------
    outer_a, outer_b : object with ``centers`` and ``radii``, or (centers, radii)
        Balls whose union covers A, in its own frame, and B; both in the plane or in space; metres.
        For example a result of :func:`cspace.spectral.decompose`, or a :class:`cspace.Robot` of
        balls.
    inner_a, inner_b : the same, optional
        Balls that lie in A, and B; without them there is no HIT.

    Raises InputError if a value is not as stated, or only one inner set is given.

    Examples
    --------
    >>> import shapely
    >>> from cspace.spectral import ContactTest, decompose
    >>> a, b = (decompose(shapely.box(0, 0, 2, 1), kind="outer", number=8) for _ in range(2))
    >>> ContactTest(a, b).separated((5.0, 0.0)).name
    'MISS'
    """

    def __init__(
        self,
        outer_a: BallsLike,
        outer_b: BallsLike,
        inner_a: BallsLike | None = None,
        inner_b: BallsLike | None = None,
    ) -> None:
        """Build the trees of all balls."""
        if (inner_a is None) is not (inner_b is None):
            raise InputError("inner_a", "or inner_b is missing", "a HIT needs both")
        self.dim = as_balls(outer_a, "outer_a").dim
        sources = {"outer_a": outer_a, "outer_b": outer_b, "inner_a": inner_a, "inner_b": inner_b}
        self._trees = []
        span = 0.0
        for name, source in sources.items():
            tree = NO_TREE
            if source is not None:
                _check_kind(source, name)
                balls = as_balls(source, name, self.dim)
                tree = build_tree(balls.centers, balls.radii)
                span += balls.span
            self._trees.append(tree)
        # Bounds the rounding of the distance between two centers, if the distance is about the
        # span or less; farther balls are apart anyway.
        self._slack = 4.0 * PLACEMENT_ROUNDING * math.sqrt(self.dim) * span
        self._rotation = np.eye(self.dim)
        self._placed = self._trees

    def __repr__(self) -> str:
        """Return the dimension, and whether the test can prove that shapes meet."""
        ending = ", with inner balls" if len(self._trees[2]) else ""
        return f"ContactTest(in {self.dim} dimensions{ending})"

    def rotated(self, rotation: Rotates) -> ContactTest:
        """Return the test with A rotated about the origin of its frame.

        ``rotation`` is an angle in the plane, radians, a matrix of shape (d, d), or a scipy
        Rotation; raises InputError for anything else.
        """
        # Rotate the original balls, so that rounding does not accumulate over repeated rotations.
        matrix = rotation_matrix(rotation, self.dim) @ self._rotation
        rotated = copy.copy(self)
        rotated._rotation = rotation_matrix(matrix, self.dim)
        rotated._placed = [tree.copy() for tree in self._trees]
        for tree in rotated._placed[::2]:  # those of A
            tree[:, : self.dim] = tree[:, : self.dim] @ rotated._rotation.T
        return rotated

    def separated(self, t: ArrayLike) -> Verdict | Bytes:
        """Decide whether the moved A and B are apart.

        ``t``, shape (..., d), is in metres. Returns a Verdict for one placement, and values of
        :class:`Verdict` as uint8 of shape (...) for more.
        """
        placements = check_points(t, "t", AXES[: self.dim])
        spatial = np.pad(placements.reshape(-1, self.dim), ((0, 0), (0, 3 - self.dim)))
        verdicts = np.empty(len(spatial), dtype=np.uint8)
        outer_a, outer_b, inner_a, inner_b = self._placed

        def test_chunk(start: int, stop: int) -> int:
            """Write the verdicts of some placements; -1 means that none is invalid."""
            chunk = slice(start, stop)
            test_placements(
                outer_a, outer_b, inner_a, inner_b, self._slack, spatial[chunk], verdicts[chunk]
            )
            return -1

        # Placements per thread below which a further thread costs more time than it saves.
        run_in_chunks(test_chunk, len(spatial), 2_000)
        if placements.ndim == 1:
            return Verdict(int(verdicts[0]))
        return verdicts.reshape(placements.shape[:-1])


def _check_kind(source: BallsLike, name: str) -> None:
    """Raise InputError for inner balls as outer ones, or reverse.

    Decompositions know their kind.
    """
    needed, _, _ = name.partition("_")
    kind = getattr(source, "kind", needed)
    if kind in ("inner", "outer") and kind != needed:
        raise InputError(
            name,
            f"is of kind {kind!r}",
            f"it must be {needed!r}",
        )


@allocating
def test_placements(
    outer_a: Floats,
    outer_b: Floats,
    inner_a: Floats,
    inner_b: Floats,
    slack: float,
    placements: Floats,
    out: Bytes,
) -> None:
    """Write the verdicts of placements (n, 3) of A to ``out``.

    ``slack``, metres, bounds the rounding of the distance between two centers.
    """
    pending = np.empty((MAX_PENDING_NODE_PAIRS, 2), dtype=np.int64)
    for n in range(len(placements)):
        x, y, z = placements[n]
        out[n] = MISS
        if compare_placed(outer_a, outer_b, x, y, z, slack, pending) == MISS:
            continue
        out[n] = UNDECIDED
        if compare_placed(inner_a, inner_b, x, y, z, slack, pending) == HIT:
            out[n] = HIT

"""Distances and motions of segments in the plane, against rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace._bodies.box_trees import MAX_PENDING_PAIRS
from cspace._exact.segment_proofs import Motion, build_trees, free_fraction
from cspace._shapes import RoundedSimplices
from cspace._support.compiling import kernel
from tests.helpers.strategies import examples, seeds
from tests.helpers.triangles import squared_triangle_distance, triangle_pairs

HERE = (0.0, 0.0, 0.0)
STILL = np.eye(3)
FLAT = np.array([1.0, 1.0, 0.0])


def segment_pairs():
    """Draw pairs of segments in the plane, as triangles that repeat a corner."""
    return triangle_pairs().map(lambda pair: [part[[0, 1, 1]] * FLAT for part in pair])


def turn_by(angle):
    return Rotation.from_rotvec((0.0, 0.0, angle)).as_matrix()


ERROR = 2.0**-48
"""Largest excess of a distance, relative to the diameter of both triangles together."""


def to_pieces(triangles, radius=0.0):
    return RoundedSimplices(np.asarray(triangles, dtype=float), np.full(len(triangles), radius))


@kernel
def share(trees, roots, motion, enough, work):
    return free_fraction(trees, roots[0], (-1, roots[1]), motion, enough, work)


class Pair:
    """A robot and obstacles; ``work`` is reused."""

    def __init__(self, robot, obstacles):
        self.trees, roots = build_trees([robot, obstacles], False)
        self.roots, self.work = tuple(roots), np.full((MAX_PENDING_PAIRS, 2), -1)

    def share(self, place=HERE, turn=STILL, step=HERE, angle=0.0, required=0.0, enough=np.inf):
        matrix = tuple(tuple(row) for row in turn.tolist())
        motion = Motion(matrix, tuple(place), tuple(step), float(angle), float(required), 0.0)
        return share(self.trees, self.roots, motion, float(enough), self.work)

    def distance(self, place=HERE, turn=STILL, enough=np.inf):
        """Return the distance at a pose.

        It is the free fraction of a motion by one in every direction.
        """
        self.trees.boxes[:, 6] = 1.0
        return self.share(place, turn, angle=1.0, enough=enough)


# ---- segments ------------------------------------------------------------------------------------


@examples(200)
@given(segment_pairs())
def test_distances_are_never_too_large_and_at_most_slightly_too_small(pair):
    square = squared_triangle_distance(*pair)
    size = np.linalg.norm(np.ptp(np.concatenate(pair), axis=0))
    distance = Pair(*(to_pieces(part[None]) for part in pair)).distance()
    proven = Fraction(max(distance, 0.0)) - Fraction(ERROR * size)
    assert proven <= 0 or proven**2 <= square
    assert distance > float(square) ** 0.5 - 1e-7 * size or (
        distance < 0.0 and float(square) ** 0.5 < 1e-7 * size
    )
    assert square > 0 or distance <= ERROR * size


@examples(60)
@given(segment_pairs(), seeds, st.sampled_from([0.0, 0.2]))
def test_distances_include_pose_and_radius(pair, seed, radius):
    first, second = pair
    rng = np.random.default_rng(seed)
    turn = turn_by(seed % 7)
    position = rng.uniform(-1, 1, 3) * FLAT
    true = float(squared_triangle_distance(first @ turn.T + position, second)) ** 0.5 - radius
    distance = Pair(
        to_pieces(first[None], 0.75 * radius), to_pieces(second[None], 0.25 * radius)
    ).distance(position, turn)
    allowed = 1e-11 * np.abs(pair).sum()
    assert distance <= max(true, 0.0) + allowed and (distance > true - 1e-6 or true < 1e-6)


@examples(60)
@given(segment_pairs(), seeds)
def test_free_fractions_hold_along_the_motion(pair, seed):
    first, second = pair
    rng = np.random.default_rng(seed)
    step = rng.uniform(-2, 2, 3) * FLAT
    angle = rng.choice([0.0, 0.3, 3.0])
    center = first.mean(axis=0)  # the center of rotation
    robot = first - center
    position = tuple(center)
    required = 1e-12 * np.abs(pair).sum()  # for rounding
    proven = Pair(to_pieces(robot[None]), to_pieces(second[None])).share(
        position, STILL, step, angle, required, enough=1.0
    )
    for t in max(proven, 0.0) * rng.uniform(-1.0, 1.0, 9):
        turn = turn_by(t * angle)
        placed = robot @ turn.T + position + t * step
        assert proven < 0.0 or squared_triangle_distance(placed, second) > 0


# ---- trees ---------------------------------------------------------------------------------------


def test_trees_find_the_smallest_distance():
    rng = np.random.default_rng(1)
    body = np.array([(0, 0, 0), (0.3, 0.2, 0), (0.3, -0.1, 0)])[[[0, 1, 1], [1, 2, 2], [2, 0, 0]]]
    triangles = rng.uniform(-2, 2, (100, 1, 3)) + rng.normal(0, 0.3, (100, 3, 3))
    triangles = triangles[:, [0, 1, 1]] * FLAT
    radii = rng.choice(np.linspace(0.0, 0.1, 40), 100)
    every = Pair(to_pieces(body), RoundedSimplices(triangles, radii))
    singly = [
        Pair(to_pieces(body), to_pieces(part[None], r))
        for part, r in zip(triangles, radii, strict=True)
    ]
    for seed, q in enumerate((rng.uniform(-2, 2, (20, 3)) * FLAT).tolist()):
        turn = turn_by(seed % 7)
        true = min(part.distance(q, turn) for part in singly)
        for enough in (0.01, 0.1, 0.5, np.inf):
            assert every.distance(q, turn, enough) == pytest.approx(min(true, enough), abs=1e-12)

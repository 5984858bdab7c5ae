"""Best placements, against brute force and sums over pairs of balls."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Rotations
from cspace.spectral import Bump, FourierOverlap, best_placements
from tests.helpers.balls import draw_rotations, move, sum_pairs
from tests.helpers.strategies import examples, seeds

pytest.importorskip("finufft")

dims = st.sampled_from([2, 3])
BUMP = Bump(2.0)


def draw_balls(rng, number, dim, side):
    """Draw balls of three radii."""
    return rng.uniform(0.0, side, (number, dim)), rng.choice([0.15, 0.2, 0.3], number)


def turn_plane(yaws):
    """Return the matrices (n, 2, 2) of yaws (n,)."""
    vectors = np.outer(yaws, [0.0, 0.0, 1.0])
    return Rotation.from_rotvec(vectors).as_matrix()[:, :2, :2]


def score_of(a, b, t, matrix, bump=BUMP):
    """Return the overlap of a placed set of balls with another."""
    return sum_pairs(move(a, t, matrix), b, bump.alpha, np.zeros((1, len(t))))[0]


@examples(6)
@given(seeds, st.integers(1, 5), st.integers(1, 8), st.floats(0.05, 0.6))
def test_no_placement_of_brute_force_is_better_in_the_plane(seed, few, more, separation):
    rng = np.random.default_rng(seed)
    a = draw_balls(rng, few, 2, 0.6)
    b = draw_balls(rng, more, 2, 1.2)
    best = best_placements(a, b, 24, n=4, bump=Bump(math.inf), separation=separation)
    placed = [
        move(a, t, matrix)[0] for t, matrix in zip(best.translations, best.rotations, strict=True)
    ]
    for one, other in itertools.combinations(placed, 2):
        assert math.sqrt(((one - other) ** 2).sum(axis=1).mean()) >= separation * (1.0 - 1e-9)
    # Shapes meet most where some centers nearly coincide.
    highest = 0.0
    for matrix in turn_plane(2.0 * math.pi * np.arange(12) / 12):
        turned = move(a, 0.0, matrix)
        steps = (b[0] - turned[0][:, None]).reshape(-1, 2)
        highest = max(highest, sum_pairs(turned, b, math.inf, steps).max())
    assert score_of(a, b, best.translations[0], best.rotations[0], Bump(math.inf)) >= highest * (
        1.0 - 0.01
    )


@examples(6)
@given(dims, seeds)
def test_a_copy_among_decoys_is_found_at_its_pose(dim, seed):
    rng = np.random.default_rng(seed)
    a = draw_balls(rng, 6, dim, 1.0)
    (matrix,) = draw_rotations(rng, 1, dim)
    t = rng.uniform(-5.0, 5.0, dim)
    b = move(a, t, matrix)
    decoys = b[0][0] + rng.uniform(-3.0, 3.0, (40, dim))
    decoys = decoys[np.linalg.norm(decoys[:, None] - b[0], axis=2).min(axis=1) > 0.8]
    among = np.vstack([b[0], decoys]), np.append(b[1], np.full(len(decoys), 0.15))
    axis = rng.dirichlet(np.ones(3)) if dim == 3 else np.array([0.0, 0.0, 1.0])
    near = matrix @ Rotation.from_rotvec(0.1 * axis).as_matrix()[:dim, :dim]
    best = best_placements(a, among, near, n=1)
    # By Cauchy and Schwarz no score of a copy is above the integral of the squared descriptor.
    assert best.scores[0] == pytest.approx(score_of(a, b, t, matrix), rel=0.08)
    assert move(a, best.translations[0], best.rotations[0])[0] == pytest.approx(b[0], abs=0.01)


@pytest.mark.thorough
@examples(12)
@given(seeds, dims, st.sampled_from([1.0, 2.0, math.inf]), st.floats(0.0, 20.0))
def test_scores_are_overlaps_less_the_penalty(seed, dim, alpha, penalty):
    rng = np.random.default_rng(seed)
    a, b, avoid = (draw_balls(rng, 5, dim, side) for side in (0.5, 1.5, 1.5))
    options = {"avoid": avoid, "penalty": penalty, "bump": Bump(alpha)}
    best = best_placements(a, b, draw_rotations(rng, 4, dim), n=4, **options)
    assert (np.diff(best.scores) <= 0.0).all()
    scale = score_of(a, a, np.zeros(dim), np.eye(dim), Bump(alpha))
    for score, t, matrix in zip(best.scores, best.translations, best.rotations, strict=True):
        expected, avoided = (score_of(a, balls, t, matrix, Bump(alpha)) for balls in (b, avoid))
        error = 0.03 * scale * (1.0 + penalty)
        assert score == pytest.approx(expected - penalty * avoided, abs=error)


@pytest.mark.parametrize("dim", [2, 3])
def test_refined_placements_are_peaks_of_the_overlap(dim):
    rng = np.random.default_rng(5)
    a = draw_balls(rng, 5, dim, 0.6)
    b = draw_balls(rng, 9, dim, 1.5)
    rotations = draw_rotations(rng, 6, dim)
    best, unturned = (
        best_placements(a, b, rotations, n=3, refine_rotations=turn) for turn in (True, False)
    )
    assert best.scores[0] > unturned.scores[0]
    overlap = FourierOverlap(a, b, tolerance=1e-3 if dim == 2 else 0.03)
    for t, matrix in zip(best.translations, best.rotations, strict=True):
        rotated = overlap.rotated(matrix)
        slopes = [np.linalg.norm(rotated.value_and_gradient(t + step)[1]) for step in (0.0, 0.05)]
        assert slopes[0] < 0.05 * slopes[1]
        # Turns about the origin of A, by differences.
        for axis in np.eye(3)[2 if dim == 2 else 0 :]:
            twists = []
            for step in (0.0, 0.05):
                turns = Rotation.from_rotvec(np.outer([-1e-4, 1e-4], axis)).as_matrix()
                values = [rotated.rotated(turn[:dim, :dim]).value(t + step) for turn in turns]
                twists.append(abs(values[1] - values[0]) / 2e-4)
            moment = np.linalg.norm(a[0], axis=1).max() * slopes[1]
            assert twists[0] < 0.05 * moment
    for matrix in unturned.rotations:
        assert np.abs(rotations - matrix).max(axis=(1, 2)).min() < 1e-12


@pytest.mark.parametrize("dim, rotations", [(2, 7), (3, Rotations.quaternions(1))])
def test_configurations_hold_a_yaw_or_a_quaternion(dim, rotations):
    rng = np.random.default_rng(3)
    best = best_placements(draw_balls(rng, 3, dim, 0.5), draw_balls(rng, 3, dim, 1.0), rotations, 2)
    q = best.configurations
    turns = turn_plane(q[:, 2]) if dim == 2 else Rotation.from_quat(q[:, 3:]).as_matrix()
    assert q[:, :dim] == pytest.approx(best.translations)
    assert turns == pytest.approx(best.rotations)


def test_nothing_is_returned_if_no_score_is_positive():
    disc = ([[0.0, 0.0]], [0.3])
    for rotations, avoid in (([0.0, 1.0], disc), ([], None)):
        best = best_placements(disc, disc, rotations, avoid=avoid)
        assert best.scores.shape == (0,)
        assert best.configurations.shape == (0, 3)

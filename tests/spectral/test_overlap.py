"""Values, slopes and thresholds of overlaps, against sums over pairs of balls."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace import MissingPackageError
from cspace.spectral import Bump, EarlyTest, FourierOverlap, Verdict
from cspace.spectral._ball_sets import as_balls, round_radii
from cspace.spectral._spectra import RadialFactors
from tests.helpers.balls import draw_pairs, draw_rotations, move, sum_pairs
from tests.helpers.strategies import examples, seeds

pytest.importorskip("finufft")

dims = st.sampled_from([2, 3])
QUADRATURE_ERRORS = {1.0: 1e-3, 2.0: 1e-7, 4.0: 1e-7, math.inf: 1e-9}
"""Relative errors of sums over pairs, by alpha; bumps with alpha 1 have a cusp."""


def draw_ball_sets(rng, dim):
    """Draw two ball sets with few radii, in frames with arbitrary origins."""
    sets = []
    for most, side, largest in ((8, 0.5, 0.2), (24, {2: 2.0, 3: 0.9}[dim], 0.3)):
        number = int(rng.integers(1, most))
        radii = rng.choice(rng.uniform(0.08, largest, 3), number)
        centers = rng.uniform(0.0, side, (number, dim)) + rng.choice([0.0, 1.0, -20.0])
        sets.append((centers, radii))
    return sets


def choose_tolerance(dim, alpha):
    """Choose a tolerance that takes some ten thousand frequencies."""
    return 1e-3 if dim == 2 and alpha == 2.0 else 0.1 if dim == 2 else 0.3


def draw_near_placements(rng, a, b, number):
    """Draw placements of a at which two balls overlap, or nearly."""
    placements, _ = draw_pairs(rng, a, b, number)
    return placements + rng.normal(0.0, 0.12, placements.shape)


@examples(16)
@given(seeds, dims, st.sampled_from([1.0, 2.0, math.inf]))
def test_values_are_within_their_bound_of_the_sum_over_pairs(seed, dim, alpha):
    rng = np.random.default_rng(seed)
    a, b = draw_ball_sets(rng, dim)
    first, second = draw_rotations(rng, 2, dim)
    matrix = second @ first
    overlap = FourierOverlap(a, b, bump=Bump(alpha), tolerance=choose_tolerance(dim, alpha))
    overlap = overlap.rotated(first).rotated(second)
    turned_a = move(a, 0.0, matrix)
    placements = draw_near_placements(rng, turned_a, b, 36)
    expected = sum_pairs(turned_a, b, alpha, placements)
    assert expected.max() > 0.0
    values = overlap.value(placements.reshape(6, 6, dim)).ravel()
    slack = QUADRATURE_ERRORS[alpha] * expected.max()
    bound = EarlyTest(overlap, 1.0).bound
    assert np.abs(values - expected).max() <= bound + slack
    # Few placements are summed one by one, many by a transform; both sum the same terms.
    alone = [overlap.value(t) for t in placements[:5]]
    assert alone == pytest.approx(values[:5], abs=1e-8 * values.max())
    if alpha == 2.0 and dim == 2:
        assert bound < 0.2 * expected.max()
    upper = overlap.domain[1]
    outside = np.array([upper + 0.5 * overlap.lattice.periods, upper + 1e6])
    assert not overlap.value(outside).any()
    assert not overlap.value_and_gradient(outside)[1].any()


@examples(8)
@given(seeds, dims)
def test_gradients_agree_with_finite_differences(seed, dim):
    rng = np.random.default_rng(seed)
    a, b = draw_ball_sets(rng, dim)
    first, second = draw_rotations(rng, 2, dim)
    matrix = second @ first
    overlap = FourierOverlap(a, b, tolerance=0.03).rotated(first).rotated(second)
    placements = draw_near_placements(rng, move(a, 0.0, matrix), b, 40)
    h = 1e-5

    slopes = [
        (overlap.value(placements + h * step) - overlap.value(placements - h * step)) / (2.0 * h)
        for step in np.eye(dim)
    ]
    values, gradients = overlap.value_and_gradient(placements)
    scale = np.abs(gradients).max()
    assert gradients == pytest.approx(np.transpose(slopes), abs=1e-4 * scale)
    value, gradient = overlap.value_and_gradient(placements[0])
    assert values == pytest.approx(overlap.value(placements), abs=1e-7 * scale)
    assert value == pytest.approx(values[0], abs=1e-7 * scale)
    assert gradient == pytest.approx(gradients[0], abs=1e-7 * scale)


def move_inside(rng, balls, chosen):
    """Draw a step of some balls that keeps them in the bounding box of all."""
    (centers, radii), reach = balls, balls[1][:, None]
    lower, upper = (centers - reach).min(axis=0), (centers + reach).max(axis=0)
    lowest, highest = (centers - reach)[chosen].min(axis=0), (centers + reach)[chosen].max(axis=0)
    step = rng.uniform(lower - lowest, upper - highest)
    moved = centers.copy()
    moved[chosen] += step
    return step, (moved, radii)


@examples(16)
@given(seeds, dims, st.sampled_from([2.0, math.inf]), st.integers(1, 4), st.booleans())
def test_moved_balls_overlap_as_sums_over_pairs_tell(seed, dim, alpha, moves, same):
    rng = np.random.default_rng(seed)
    a, b = draw_ball_sets(rng, dim)
    (matrix,) = draw_rotations(rng, 1, dim)
    overlap = FourierOverlap(a, b, bump=Bump(alpha), tolerance=choose_tolerance(dim, alpha))
    first, chosen = overlap, []
    for _ in range(moves):
        if not (same and len(chosen)):
            chosen = np.unique(rng.integers(len(b[1]), size=rng.integers(1, 6)))
        step, b = move_inside(rng, b, chosen)
        mask = np.isin(np.arange(len(b[1])), chosen)
        overlap = overlap.moved(mask if rng.random() < 0.5 else chosen, step)
    overlap = overlap.rotated(matrix)
    turned_a = move(a, 0.0, matrix)
    placements = draw_near_placements(rng, turned_a, b, 36)
    expected = sum_pairs(turned_a, b, alpha, placements)
    slack = QUADRATURE_ERRORS[alpha] * expected.max()
    bound = EarlyTest(overlap, 1.0).bound
    assert np.abs(overlap.value(placements) - expected).max() <= bound + slack
    assert overlap.b.centers == pytest.approx(b[0])
    # The overlap that was moved first stays.
    fresh = FourierOverlap(
        first.a, first.b, bump=Bump(alpha), tolerance=choose_tolerance(dim, alpha)
    )
    near = placements[:9]
    assert first.value(near) == pytest.approx(fresh.value(near), abs=1e-9 * expected.max())


def test_steps_of_the_same_balls_take_one_transform(monkeypatch):
    rng = np.random.default_rng(2)
    b = rng.uniform(0.0, 3.0, (60, 2)), np.full(60, 0.1)
    overlap = FourierOverlap(([[0.0, 0.0]], 0.2), b)
    chosen = [3, 5, 8]
    step, b = move_inside(rng, b, chosen)
    moved = overlap.moved(chosen, step)
    assert EarlyTest(moved, 1.0).bound > EarlyTest(overlap, 1.0).bound
    # Steps from the same overlap and from the moved one, without any further transform.
    monkeypatch.setattr(RadialFactors, "spectrum", None)
    again = overlap.moved(chosen, 0.5 * step)
    back = again.moved(chosen, -0.5 * step)
    t = rng.uniform(0.0, 3.0, (40, 2))
    scale = overlap.value(t).max()
    assert back.value(t) == pytest.approx(overlap.value(t), abs=1e-9 * scale)
    assert np.abs(moved.value(t) - overlap.value(t)).max() > 1e-3 * scale


@examples(8)
@given(seeds, dims, st.sampled_from([1.0, 2.0, 4.0, math.inf]), st.sampled_from([0.5, 0.01]))
def test_early_verdicts_are_right_about_the_ideal_overlap(seed, dim, alpha, tolerance):
    rng = np.random.default_rng(seed)
    a, b = draw_ball_sets(rng, dim)
    placements = draw_near_placements(rng, a, b, 12)
    placements[0] += 1e3
    expected = sum_pairs(a, b, alpha, placements)
    error = QUADRATURE_ERRORS[alpha] * expected.max()
    threshold = max(float(np.median(expected)), error)
    overlap = FourierOverlap(a, b, bump=Bump(alpha), tolerance=tolerance)
    test = EarlyTest(overlap, threshold)
    verdict, frequencies = test.compare(placements.reshape(3, 4, dim))
    assert (expected[verdict.ravel() == Verdict.MISS] < threshold + error).all()
    assert (expected[verdict.ravel() == Verdict.HIT] > threshold - error).all()
    is_clear = np.abs(expected - threshold) > 2.0 * test.bound + error
    assert (verdict.ravel()[is_clear] != Verdict.UNDECIDED).all()
    assert (frequencies <= overlap.frequencies).all() and frequencies[0, 0] == 0
    single = test.compare(placements[1])
    assert single.frequencies.shape == () and single.frequencies == frequencies[0, 1]


def test_smooth_bumps_decide_early():
    rng = np.random.default_rng(0)
    a, b = (rng.uniform(0.0, 1.0, (20, 2)), 0.1), (rng.uniform(0.0, 3.0, (60, 2)), 0.15)
    overlap = FourierOverlap(a, b, tolerance=1e-4)
    verdict, frequencies = EarlyTest(overlap, 1e-2).compare(rng.uniform(-1, 3, (500, 2)))
    assert (verdict != Verdict.UNDECIDED).mean() > 0.98
    assert np.median(frequencies) < 0.1 * overlap.frequencies


def test_bound_holds_far_from_the_origin():
    """Compare with the same balls near the origin, where placements have more digits."""
    far = 2.0**19
    discs = np.array([[0.0, 0.0], [0.4, 0.0]])
    origin = np.array([far, -far])
    overlap = FourierOverlap(([[far, far]], 0.3), (discs + origin, 0.3), tolerance=1e-12)
    near = FourierOverlap(([[0.0, 0.0]], 0.3), (discs, 0.3), tolerance=1e-12)
    step = np.array([0.0, -2.0 * far])
    placements = np.random.default_rng(0).uniform(-0.4, 0.4, (100, 2)) + step
    differences = overlap.value(placements[:30]) - near.value(placements[:30] - step)
    bound, near_bound = (EarlyTest(each, 1.0).bound for each in (overlap, near))
    assert np.abs(differences).max() <= bound + near_bound
    assert bound > 1e3 * near_bound


@given(seeds, dims, st.integers(1, 9))
def test_radii_grow_to_few_sizes(seed, dim, number):
    rng = np.random.default_rng(seed)
    balls = as_balls((rng.normal(size=(30, dim)), rng.uniform(0.1, 1.0, 30)), "balls")
    grown, kept = (round_radii(balls, number, grow=grow) for grow in (True, False))
    assert len(np.unique(grown.radii)) <= number and len(np.unique(kept.radii)) <= number
    assert (grown.radii >= balls.radii).all() and grown.radii.max() == balls.radii.max()
    assert (kept.radii**dim).sum() == pytest.approx((balls.radii**dim).sum())


ONE = ([[0.0, 0.0]], 0.2)


def test_missing_finufft_names_the_extra(monkeypatch):
    overlap = FourierOverlap(ONE, ONE)
    monkeypatch.setitem(sys.modules, "finufft", None)
    assert overlap.value([0.1, 0.0]) > 0.0
    with pytest.raises(MissingPackageError, match=r"pip install .*\[spectral\]"):
        overlap.value(np.zeros((40, 2)))
